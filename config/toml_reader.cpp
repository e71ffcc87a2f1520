// SPDX-License-Identifier: Apache-2.0
#include "config/toml_reader.h"

#include <fmt/format.h>
#include <toml++/toml.h>

#include <algorithm>
#include <cerrno>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <filesystem>
#include <memory>

namespace slabd::config {
namespace {

constexpr double kUnitTolerance = 1e-3;

/// Converts the library's nodes. Members keep the order of the file.
void convert(const toml::node& node, TomlValue& out) {
  out.line = std::max(1U, node.source().begin.line);
  out.column = std::max(1U, node.source().begin.column);
  if (const auto* table = node.as_table()) {
    out.kind = TomlValue::Kind::table;
    for (const auto& [key, child] : *table) {
      TomlValue::Member& member = out.members.emplace_back();
      member.key = std::string(key.str());
      member.line = std::max(1U, key.source().begin.line);
      member.column = std::max(1U, key.source().begin.column);
      convert(child, member.value);
    }
    std::stable_sort(out.members.begin(), out.members.end(), [](const auto& a, const auto& b) {
      return std::pair(a.line, a.column) < std::pair(b.line, b.column);
    });
  } else if (const auto* array = node.as_array()) {
    out.kind = TomlValue::Kind::array;
    for (const auto& child : *array) convert(child, out.items.emplace_back());
  } else if (const auto* text = node.as_string()) {
    out.kind = TomlValue::Kind::text;
    out.text = text->get();
  } else if (const auto* integer = node.as_integer()) {
    out.kind = TomlValue::Kind::integer;
    out.integer = integer->get();
  } else if (const auto* real = node.as_floating_point()) {
    out.kind = TomlValue::Kind::real;
    out.real = real->get();
  } else if (const auto* boolean = node.as_boolean()) {
    out.kind = TomlValue::Kind::boolean;
    out.boolean = boolean->get();
  } else {
    out.kind = TomlValue::Kind::date;
  }
}

/// Returns the characters of a TOML text one by one, without strings and comments.
class TomlMarks {
 public:
  explicit TomlMarks(std::string_view text) : rest_(text) {}

  /// Sets `mark` to the next character outside strings and comments; false at the end.
  bool next(char& mark) {
    while (!rest_.empty()) {
      const char c = rest_.front();
      if (c == '"' || c == '\'')
        step_over_string(c);
      else if (c == '#')
        step(std::min(rest_.find('\n'), rest_.size()));
      else {
        mark = c;
        step(1);
        return true;
      }
    }
    return false;
  }
  [[nodiscard]] std::uint32_t line() const { return line_; }

 private:
  void step(std::size_t bytes) {
    line_ += static_cast<std::uint32_t>(std::count(rest_.begin(), rest_.begin() + static_cast<long>(bytes), '\n'));
    rest_.remove_prefix(bytes);
  }
  /// Skips a string. A string on one line without an end stops at the end of the line; the library reports the error.
  void step_over_string(char quote) {
    const std::string three(3, quote);
    const bool many_lines = rest_.starts_with(three);
    const std::string_view end = many_lines ? std::string_view(three) : std::string_view(three).substr(0, 1);
    step(end.size());
    while (!rest_.empty() && !rest_.starts_with(end)) {
      if (!many_lines && rest_.front() == '\n') return;
      step(quote == '"' && rest_.front() == '\\' && rest_.size() > 1 && rest_[1] != '\n' ? 2 : 1);
    }
    step(std::min(end.size(), rest_.size()));
    // Up to two additional quotes before the closing three belong to the string.
    for (int i = 0; many_lines && i < 2 && rest_.starts_with(quote); ++i) step(1);
  }

  std::string_view rest_;
  std::uint32_t line_ = 1;
};

/// First line nested deeper than kTomlNestingMax; 0 if there is none.
std::uint32_t too_deep_at(std::string_view bytes) {
  TomlMarks marks(bytes);
  std::size_t brackets = 0;
  std::size_t key_dots = 0;
  for (char mark = 0; marks.next(mark);) {
    switch (mark) {
      case '.': ++key_dots; break;
      case '[':
      case '{':
        ++brackets;
        key_dots = 0;
        break;
      case ']':
      case '}':
        brackets -= brackets > 0 ? 1 : 0;
        key_dots = 0;
        break;
      case '=':
      case ',':
      case '\n': key_dots = 0; break;
      default: break;
    }
    if (brackets > kTomlNestingMax || key_dots > kTomlNestingMax) return marks.line();
  }
  return 0;
}

/// Text safe for a log line and a terminal: control characters are replaced by their numbers, UTF-8 is kept.
std::string visible(std::string_view text) {
  std::string out;
  for (std::size_t i = 0; i < text.size(); ++i) {
    const auto byte = static_cast<unsigned char>(text[i]);
    const bool c1 = byte == 0xC2 && i + 1 < text.size() && static_cast<unsigned char>(text[i + 1]) < 0xA0;
    if (byte >= ' ' && byte != 0x7F && !c1)
      out += text[i];
    else
      out += fmt::format("\\x{:02X}", c1 ? static_cast<unsigned char>(text[++i]) : byte);
  }
  return out;
}

/// Parses the part above line `line`; `root` is empty if that fails too.
void parse_above(const std::string& bytes, std::uint32_t line, TomlValue& root) {
  std::size_t end = 0;
  for (std::uint32_t i = 1; i < line && end != std::string::npos; ++i) {
    end = bytes.find('\n', end);
    if (end != std::string::npos) ++end;
  }
  if (end == std::string::npos) return;
  try {
    convert(toml::parse(std::string_view(bytes).substr(0, end)), root);
  } catch (const toml::parse_error&) {
    root = TomlValue{};
  }
}

}  // namespace

const TomlValue::Member* TomlValue::find(std::string_view key) const {
  for (const Member& member : members)
    if (member.key == key) return &member;
  return nullptr;
}

std::optional<std::string> read_text_file(const std::string& path, std::vector<Problem>& problems,
                                          std::size_t bytes_max) {
  // Folders and devices can be opened like files.
  std::error_code status_error;
  const auto status = std::filesystem::status(path, status_error);
  if (std::filesystem::exists(status) && !std::filesystem::is_regular_file(status)) {
    problems.push_back({fmt::format("{}: not a regular file", path)});
    return std::nullopt;
  }
  const std::unique_ptr<std::FILE, int (*)(std::FILE*)> file(std::fopen(path.c_str(), "rbe"), &std::fclose);
  if (!file) {
    const char* why = errno == ENOENT ? "no such file" : std::strerror(errno);
    problems.push_back({fmt::format("{}: cannot be read: {}", path, why)});
    return std::nullopt;
  }
  std::string bytes;
  constexpr std::size_t kPiece = 65'536;
  for (std::size_t got = kPiece; got == kPiece && bytes.size() <= bytes_max;) {
    const std::size_t before = bytes.size();
    bytes.resize(before + kPiece);
    got = std::fread(bytes.data() + before, 1, kPiece, file.get());
    bytes.resize(before + got);
  }
  if (std::ferror(file.get()) != 0) {
    problems.push_back({fmt::format("{}: cannot be read: {}", path, std::strerror(errno))});
    return std::nullopt;
  }
  if (bytes.size() > bytes_max) {
    problems.push_back({fmt::format("{}: longer than {} bytes, the most that are allowed here", path, bytes_max)});
    return std::nullopt;
  }
  return bytes;
}

bool parse_toml(const std::string& path, const std::string& bytes, TomlValue& root, std::vector<Problem>& problems) {
  root = TomlValue{};
  if (const std::uint32_t line = too_deep_at(bytes); line != 0) {
    problems.push_back({fmt::format("{}:{}:1: keys or brackets nest deeper than {} levels; this is not a configuration",
                                    path, line, kTomlNestingMax)});
    parse_above(bytes, line, root);
    return false;
  }
  try {
    convert(toml::parse(std::string_view(bytes)), root);
    return true;
  } catch (const toml::parse_error& e) {
    const auto& at = e.source().begin;
    problems.push_back({fmt::format("{}:{}:{}: not valid TOML: {}", path, std::max(1U, at.line),
                                    std::max(1U, at.column), visible(e.description()))});
    root = TomlValue{};
    parse_above(bytes, at.line, root);
    return false;
  }
}

std::size_t edit_distance(std::string_view a, std::string_view b) {
  std::vector<std::size_t> row(b.size() + 1);
  for (std::size_t j = 0; j <= b.size(); ++j) row[j] = j;
  for (std::size_t i = 1; i <= a.size(); ++i) {
    std::size_t diagonal = row[0];
    row[0] = i;
    for (std::size_t j = 1; j <= b.size(); ++j) {
      const std::size_t above = row[j];
      const std::size_t replaced = diagonal + (a[i - 1] == b[j - 1] ? 0 : 1);
      row[j] = std::min({replaced, above + 1, row[j - 1] + 1});
      diagonal = above;
    }
  }
  return row.back();
}

std::string_view nearest(std::string_view word, const std::set<std::string, std::less<>>& candidates) {
  std::string_view best;
  std::size_t best_distance = std::string_view::npos;
  for (const std::string& candidate : candidates) {
    const std::size_t distance = edit_distance(word, candidate);
    if (distance < best_distance) {
      best = candidate;
      best_distance = distance;
    }
  }
  return best;
}

std::string found(const TomlValue& value) {
  switch (value.kind) {
    case TomlValue::Kind::boolean: return value.boolean ? "true" : "false";
    case TomlValue::Kind::integer: return fmt::format("{}", value.integer);
    case TomlValue::Kind::real: return fmt::format("{:#}", value.real);  // prints 20.0 as a real number
    case TomlValue::Kind::text: return fmt::format("\"{}\"", value.text.substr(0, 60));
    case TomlValue::Kind::array: return fmt::format("a list of {}", value.items.size());
    case TomlValue::Kind::table: return "a table";
    case TomlValue::Kind::date: return "a date or time";
  }
  return "something else";
}

void doubt_degrees(TableReader& table, std::string_view key, double angle_deg, Allowed allowed_deg) {
  constexpr double kRound = 1e-3;
  const double as_rad = deg_from_rad(angle_deg);
  const double whole = 0.5 * std::round(2.0 * as_rad);
  if (!(whole >= 0.5) || !(std::abs(as_rad - whole) <= kRound * whole) || !(whole <= allowed_deg.high)) return;
  table.doubt(key, fmt::format("found {}, which is {} deg in radians; the unit is degrees, allowed is {}..{}",
                               angle_deg, whole, allowed_deg.low, allowed_deg.high));
}

std::optional<double> as_number(const TomlValue& value) {
  if (value.kind == TomlValue::Kind::integer) return static_cast<double>(value.integer);
  if (value.kind == TomlValue::Kind::real) return value.real;
  return std::nullopt;
}

// ---- TableReader -------------------------------------------------------------------------------------------------

TableReader::TableReader(const std::string& file, const TomlValue* table, std::string name,
                         std::vector<Problem>& problems)
    : file_(file), table_(table), name_(std::move(name)), problems_(problems) {
  if (table != nullptr) {
    line_ = table->line;
    column_ = table->column;
  }
}

const TomlValue* TableReader::value(std::string_view key) {
  known_.emplace(key);
  if (table_ == nullptr) return nullptr;
  const TomlValue::Member* member = table_->find(key);
  return member == nullptr ? nullptr : &member->value;
}

bool TableReader::has(std::string_view key) {
  return value(key) != nullptr;
}

void TableReader::optional_number(std::string_view key, double& out, Allowed allowed) {
  const TomlValue* v = value(key);
  if (v == nullptr) return;
  const std::optional<double> number = as_number(*v);
  if (!number || !std::isfinite(*number) || *number < allowed.low || *number > allowed.high) {
    problem_at(*v, key, fmt::format("found {}, allowed is a number {}..{}", found(*v), allowed.low, allowed.high));
    return;
  }
  out = *number;
}

void TableReader::required_number(std::string_view key, double& out, Allowed allowed) {
  if (!has(key)) return missing(key, fmt::format("a number {}..{}", allowed.low, allowed.high));
  optional_number(key, out, allowed);
}

void TableReader::optional_integer(std::string_view key, std::int64_t& out, std::int64_t low, std::int64_t high) {
  const TomlValue* v = value(key);
  if (v == nullptr) return;
  if (v->kind != TomlValue::Kind::integer || v->integer < low || v->integer > high) {
    problem_at(*v, key, fmt::format("found {}, allowed is a whole number {}..{}", found(*v), low, high));
    return;
  }
  out = v->integer;
}

void TableReader::required_integer(std::string_view key, std::int64_t& out, std::int64_t low, std::int64_t high) {
  if (!has(key)) return missing(key, fmt::format("a whole number {}..{}", low, high));
  optional_integer(key, out, low, high);
}

void TableReader::optional_boolean(std::string_view key, bool& out) {
  const TomlValue* v = value(key);
  if (v == nullptr) return;
  if (v->kind != TomlValue::Kind::boolean)
    return problem_at(*v, key, fmt::format("found {}, allowed is true or false", found(*v)));
  out = v->boolean;
}

void TableReader::required_boolean(std::string_view key, bool& out) {
  if (!has(key)) return missing(key, "true or false");
  optional_boolean(key, out);
}

void TableReader::optional_text(std::string_view key, std::string& out, std::size_t bytes_max) {
  const TomlValue* v = value(key);
  if (v == nullptr) return;
  const bool text = v->kind == TomlValue::Kind::text && v->text.find('\0') == std::string::npos;
  if (!text || v->text.empty() || v->text.size() > bytes_max)
    return problem_at(*v, key, fmt::format("found {}, allowed is text of 1..{} bytes", found(*v), bytes_max));
  out = v->text;
}

void TableReader::required_text(std::string_view key, std::string& out, std::size_t bytes_max) {
  if (!has(key)) return missing(key, fmt::format("text of 1..{} bytes", bytes_max));
  optional_text(key, out, bytes_max);
}

void TableReader::optional_word(std::string_view key, std::size_t& index, const std::vector<std::string_view>& words) {
  const TomlValue* v = value(key);
  if (v == nullptr) return;
  const auto word = std::find(words.begin(), words.end(), v->text);
  if (v->kind != TomlValue::Kind::text || word == words.end()) {
    problem_at(*v, key, fmt::format("found {}, allowed is \"{}\"", found(*v), fmt::join(words, "\" or \"")));
    return;
  }
  index = static_cast<std::size_t>(word - words.begin());
}

void TableReader::required_pose(std::string_view key, std::array<double, 7>& out, double reach_mm) {
  const TomlValue* v = value(key);
  const std::string expected =
      fmt::format("seven numbers [x, y, z, qw, qx, qy, qz], x y z in mm and within +-{}", reach_mm);
  if (v == nullptr) return missing(key, expected);
  if (v->kind != TomlValue::Kind::array || v->items.size() != 7)
    return problem_at(*v, key, fmt::format("found {}, allowed is {}", found(*v), expected));
  std::array<double, 7> pose{};
  for (std::size_t i = 0; i < 7; ++i) {
    const TomlValue& item = v->items[i];
    const std::optional<double> number = as_number(item);
    const double limit = i < 3 ? reach_mm : 1.0 + kUnitTolerance;
    if (!number || !std::isfinite(*number) || std::abs(*number) > limit) {
      problem_at(item, key,
                 fmt::format("number {} of 7: found {}, allowed is {}..{}", i + 1, found(item), -limit, limit));
      return;
    }
    pose[i] = *number;
  }
  const double norm = std::hypot(std::hypot(pose[3], pose[4]), std::hypot(pose[5], pose[6]));
  if (std::abs(norm - 1.0) > kUnitTolerance)
    return problem_at(
        *v, key,
        fmt::format("the quaternion (qw, qx, qy, qz) has length {:.6f}, allowed is 1 within {}", norm, kUnitTolerance));
  out = pose;
}

TableReader TableReader::table(std::string_view key) {
  const TomlValue* v = value(key);
  if (v != nullptr && v->kind != TomlValue::Kind::table) {
    problem_at(*v, key, fmt::format("found {}, allowed is a table", found(*v)));
    v = nullptr;
  }
  TableReader reader(file_, v, path_of(key), problems_);
  reader.doubts_ = doubts_;
  if (v == nullptr) {
    reader.line_ = line_;
    reader.column_ = column_;
  }
  return reader;
}

std::string TableReader::path_of(std::string_view key) const {
  return name_.empty() ? std::string(key) : fmt::format("{}.{}", name_, key);
}

Problem TableReader::placed(std::uint32_t line, std::uint32_t column, std::string_view key,
                            const std::string& what) const {
  return {fmt::format("{}:{}:{}: {}: {}", file_, line, column, visible(path_of(key)), visible(what))};
}

void TableReader::report(std::uint32_t line, std::uint32_t column, std::string_view key, const std::string& what) {
  problems_.push_back(placed(line, column, key, what));
}

void TableReader::doubt(std::string_view key, const std::string& what) {
  const TomlValue* v = value(key);
  if (doubts_ == nullptr) return;
  doubts_->push_back(placed(v == nullptr ? line_ : v->line, v == nullptr ? column_ : v->column, key, what));
}

void TableReader::problem(std::string_view key, const std::string& what) {
  const TomlValue* v = value(key);
  if (v == nullptr) return report(line_, column_, key, what);
  problem_at(*v, key, what);
}

void TableReader::problem_at(const TomlValue& at, std::string_view key, const std::string& what) {
  report(at.line, at.column, key, what);
}

void TableReader::missing(std::string_view key, const std::string& expected) {
  known_.emplace(key);
  report(line_, column_, key, "missing; expected " + expected);
}

void TableReader::finish() {
  if (table_ == nullptr) return;
  for (const TomlValue::Member& member : table_->members) {
    if (known_.contains(member.key)) continue;
    report(member.line, member.column, member.key,
           fmt::format("unknown key; the nearest known one is \"{}\"", nearest(member.key, known_)));
  }
}

}  // namespace slabd::config
