// SPDX-License-Identifier: Apache-2.0
#include "hal/scan/text_lines.h"

#include "base/plain_text.h"

#include <fast_float/fast_float.h>

#include <algorithm>
#include <array>
#include <charconv>
#include <cstdarg>
#include <cstring>
#include <limits>
#include <optional>

#include "hal/scan/scan_points.h"

namespace slabd::hal {

LineEnd first_line_end(std::string_view head) {
  const std::size_t end = head.find_first_of("\r\n");
  const bool cr = end != std::string_view::npos && head[end] == '\r' && head.substr(end + 1, 1) != "\n";
  return cr ? LineEnd::cr : LineEnd::lf;
}

std::size_t byte_order_mark_bytes(std::string_view head) {
  constexpr std::string_view kMark = "\xEF\xBB\xBF";
  return head.starts_with(kMark) ? kMark.size() : 0;
}

bool next_header_line(std::string_view head, LineEnd end, std::size_t& position, std::string_view& line) {
  const std::size_t at = head.find(static_cast<char>(end), position);
  if (at == std::string_view::npos) return false;
  line = head.substr(position, at - position);
  if (line.ends_with('\r')) line.remove_suffix(1);
  position = at + 1;
  return true;
}

bool HeaderLines::next_line(std::string_view& line) {
  if (!next_header_line(head_, line_end_, position_, line)) return false;
  ++line_number_;
  return true;
}

Error HeaderLines::refuse(const char* what, std::string_view subject, const char* hint) const {
  FixedString<70> quoted;
  if (!subject.empty()) quoted.printf(" \"%s\"", shown(subject).c_str());
  const bool hinted = hint != nullptr;
  return error(Code::frame_incomplete, "%s: header line %zu: %s%s%s%s%s", file_, line_number_, what, quoted.c_str(),
               hinted ? " (" : "", hinted ? hint : "", hinted ? ")" : "");
}

bool TextLines::next(std::string_view& line) {
  window_.consume(handed_out_);
  handed_out_ = 0;
  if (!status_) return false;
  for (std::size_t searched = 0;;) {
    const std::string_view view = window_.view();
    const std::size_t newline = view.find(static_cast<char>(end_), searched);
    const bool found = newline != std::string_view::npos;
    const std::size_t length = found ? newline : view.size();
    if (length > kTextLineBytesMax) {
      ++number_;
      status_ = refuse("longer than %zu bytes", kTextLineBytesMax);
      return false;
    }
    if (!found && window_.have(view.size() + 1)) {
      searched = view.size();
      continue;
    }
    if (window_.broken()) {
      status_ = window_.failure();
      return false;
    }
    if (!found && view.empty()) return false;
    ++number_;
    handed_out_ = found ? length + 1 : length;
    line = window_.view().substr(0, length);  // read again, because `have` moves the visible bytes
    while (line.ends_with('\r')) line.remove_suffix(1);
    return true;
  }
}

std::string_view TextLines::with_more(std::string_view line, std::size_t bytes) {
  // At the end of the file, or after a read error, `next` repeats the call and reports it.
  static_cast<void>(window_.have(handed_out_ + bytes));
  return window_.view().substr(0, line.size());
}

bool TextLines::skip() {
  window_.consume(handed_out_);
  handed_out_ = 0;
  if (!status_) return false;
  bool blank = true;
  while (window_.have(1)) {
    const std::string_view view = window_.view();
    const std::size_t newline = view.find(static_cast<char>(end_));
    const std::string_view line = view.substr(0, newline);
    blank = blank && line.find_first_not_of(" \t\r") == std::string_view::npos;
    window_.consume(newline == std::string_view::npos ? view.size() : newline + 1);
    if (newline == std::string_view::npos) continue;
    ++number_;
    if (!blank) return true;
  }
  if (window_.broken()) status_ = window_.failure();
  if (!status_ || blank) return false;
  ++number_;  // the last line had no end
  return true;
}

std::string_view TextLines::ahead() {
  window_.consume(handed_out_);
  handed_out_ = 0;
  if (end_ == LineEnd::cr) return {};
  // At the end of the file, or after a read error, `next` repeats the call and reports it.
  static_cast<void>(window_.have(kTextAheadMin));
  return window_.view();
}

void TextLines::took(std::size_t bytes, std::size_t lines) {
  window_.consume(bytes);
  number_ += lines;
}

Error TextLines::refuse(const char* format, ...) const {
  std::array<char, limits::kErrorTextBytes> text{};
  va_list args;
  va_start(args, format);
  std::vsnprintf(text.data(), text.size(), format, args);
  va_end(args);
  return error(Code::frame_incomplete, "%s: line %zu: %s", window_.name(), number_, text.data());
}

Error TextLines::not_a_number(std::string_view line, std::string_view word, const char* hint) const {
  const auto column = static_cast<std::size_t>(word.data() - line.data()) + 1;
  return error(Code::frame_incomplete, "%s: line %zu, column %zu: \"%s\" is not a number%s%s%s", window_.name(),
               number_, column, shown(word).c_str(), hint == nullptr ? "" : " (", hint == nullptr ? "" : hint,
               hint == nullptr ? "" : ")");
}

std::string_view trimmed(std::string_view text) {
  const std::size_t begin = text.find_first_not_of(" \t");
  if (begin == std::string_view::npos) return {text.data(), 0};
  return text.substr(begin, text.find_last_not_of(" \t") - begin + 1);
}

FixedString<16> lower_case(std::string_view text) {
  FixedString<16> lower;
  for (const char c : text) {
    const char l = c >= 'A' && c <= 'Z' ? static_cast<char>(c + ('a' - 'A')) : c;
    lower.append({&l, 1});
  }
  return lower;
}

namespace {

/// Text of the C runtime of older Windows programs for NaN and infinity: 1.#QNAN, -1.#IND0, 1.#INF.
bool is_msvc_special(std::string_view word) {
  if (word.starts_with('-')) word.remove_prefix(1);
  return word.starts_with("1.#IND") || word.starts_with("1.#QNAN") || word.starts_with("1.#SNAN") ||
         word.starts_with("1.#INF");
}

template <typename Real>
bool parse_real(std::string_view word, Real& value) {
  const char* begin = word.data();
  const char* const end = begin + word.size();
  if (begin != end && *begin == '+') {
    ++begin;
    if (begin != end && (*begin == '+' || *begin == '-')) return false;
  }
  Real number = 0;
  const fast_float::from_chars_result result = fast_float::from_chars(begin, end, number);
  const bool beyond = result.ec == std::errc::result_out_of_range;
  if ((result.ec == std::errc{} || beyond) && result.ptr == end && begin != end) {
    value = number;
    return true;
  }
  if (!is_msvc_special(word)) return false;
  value = std::numeric_limits<Real>::quiet_NaN();
  return true;
}

}  // namespace

bool parse_number(std::string_view word, double& value) {
  return parse_real(word, value);
}

template <typename Real>
bool parse_coordinate(std::string_view word, double mm_per_unit, Real& mm) {
  // Not via a double: rounding twice can end on the other side of a midpoint between two floats.
  if (mm_per_unit == 1.0) return parse_real(word, mm);
  double value = 0.0;
  if (!parse_real(word, value)) return false;
  mm = coordinate_mm<Real>(value, mm_per_unit);
  return true;
}
template bool parse_coordinate(std::string_view, double, float&);
template bool parse_coordinate(std::string_view, double, double&);

const char* hint_of_comma(std::string_view word) {
  const auto commas = std::count(word.begin(), word.end(), ',');
  if (commas == 0) return nullptr;
  return commas == 1 && word.find('.') == std::string_view::npos
             ? "a decimal comma is not read: save the scan with decimal points"
             : "values are separated by blanks here";
}

bool parse_count(std::string_view word, std::uint64_t& value) {
  std::uint64_t count = 0;
  const auto [end, failed] = std::from_chars(word.data(), word.data() + word.size(), count);
  if (failed != std::errc{} || end != word.data() + word.size() || count > kScanCountMax) return false;
  value = count;
  return true;
}

bool is_utf8(std::string_view text) {
  for (std::size_t at = 0; at < text.size();) {
    const CodePoint c = code_point_at(text.substr(at));
    if (!c.is_utf8) return false;
    at += c.bytes;
  }
  return true;
}

const char* hint_of_encoding(std::string_view line) {
  return is_utf8(line) ? "" : " (this text is not UTF-8, perhaps GBK: save it as UTF-8, or choose by number)";
}

FixedString<63> shown(std::string_view text) {
  constexpr std::size_t kShownMax = 60;
  FixedString<63> out;
  std::size_t at = 0;
  while (at < text.size()) {
    const CodePoint c = code_point_at(text.substr(at));
    if (at + c.bytes > kShownMax) break;
    out.append(c.is_utf8 && !is_control(c.value) ? text.substr(at, c.bytes) : "?");
    at += c.bytes;
  }
  if (at < text.size()) out.append("...");
  return out;
}

namespace {

/// Metres per unit name. Also contains units that slabd does not read: a file in inches must not pass for mm.
struct UnitName {
  std::string_view name;
  double metres;
};
constexpr std::array<UnitName, 40> kUnitNames = {{
    {"m", 1.0},           {"meter", 1.0},        {"meters", 1.0},      {"metre", 1.0},
    {"metres", 1.0},      {"mm", 1e-3},          {"millimeter", 1e-3}, {"millimeters", 1e-3},
    {"millimetre", 1e-3}, {"millimetres", 1e-3}, {"um", 1e-6},         {"\xC2\xB5m", 1e-6},
    {"\xCE\xBCm", 1e-6},  {"\xB5m", 1e-6},       {"micron", 1e-6},     {"microns", 1e-6},
    {"micrometer", 1e-6}, {"micrometers", 1e-6}, {"micrometre", 1e-6}, {"micrometres", 1e-6},
    {"nm", 1e-9},         {"cm", 1e-2},          {"centimeter", 1e-2}, {"centimeters", 1e-2},
    {"centimetre", 1e-2}, {"centimetres", 1e-2}, {"dm", 1e-1},         {"km", 1e3},
    {"in", 0.0254},       {"inch", 0.0254},      {"inches", 0.0254},   {"mil", 2.54e-5},
    {"mils", 2.54e-5},    {"thou", 2.54e-5},     {"ft", 0.3048},       {"foot", 0.3048},
    {"feet", 0.3048},     {"yd", 0.9144},        {"yard", 0.9144},     {"yards", 0.9144},
}};

double metres_per(LengthUnit unit) {
  switch (unit) {
    case LengthUnit::mm: return 1e-3;
    case LengthUnit::m: return 1.0;
    case LengthUnit::um: return 1e-6;
  }
  return 1e-3;
}

bool is_one_of(std::string_view word, std::initializer_list<std::string_view> words) {
  const FixedString<16> wanted = lower_case(word);
  return std::find(words.begin(), words.end(), wanted.view()) != words.end();
}

/// Next word of a comment; separators are blanks, ':', '=', ',', quotes and brackets.
std::string_view take_comment_word(std::string_view& rest) {
  constexpr std::string_view kBetween = " \t:=,;\"'()[]";
  const std::size_t begin = rest.find_first_not_of(kBetween);
  if (begin == std::string_view::npos) {
    rest = {};
    return {};
  }
  const std::size_t end = std::min(rest.find_first_of(kBetween, begin), rest.size());
  const std::string_view word = rest.substr(begin, end - begin);
  rest.remove_prefix(end);
  return word;
}

std::optional<double> metres_of(std::string_view word) {
  if (word.size() > FixedString<16>::capacity()) return std::nullopt;
  const FixedString<16> wanted = lower_case(word);
  for (const UnitName& unit : kUnitNames)
    if (wanted == unit.name) return unit.metres;
  return std::nullopt;
}

/// Words without meaning, as in "unit of length is mm".
bool is_filler(std::string_view word) {
  return is_one_of(word, {"is", "are", "of", "length"});
}

}  // namespace

double mm_per(LengthUnit unit) {
  switch (unit) {
    case LengthUnit::mm: return 1.0;
    case LengthUnit::m: return kMmPerM;
    case LengthUnit::um: return 0.001;
  }
  return 1.0;
}

const char* name(LengthUnit unit) {
  switch (unit) {
    case LengthUnit::mm: return "mm";
    case LengthUnit::m: return "m";
    case LengthUnit::um: return "um";
  }
  return "mm";
}

bool comment_agrees(std::string_view text, LengthUnit configured, std::string_view& found) {
  std::string_view word = take_comment_word(text);
  if (is_one_of(word, {"length"})) word = take_comment_word(text);
  if (!is_one_of(word, {"unit", "units", "length_unit", "length_units"})) return true;
  do {
    found = take_comment_word(text);
  } while (is_filler(found));
  // "in" is not inches in "units in mm".
  if (const std::string_view after = take_comment_word(text); is_one_of(found, {"in"}) && metres_of(after))
    found = after;
  return unit_name_agrees(found, configured);
}

bool declares_unit(std::string_view text) {
  std::string_view found;
  static_cast<void>(comment_agrees(text, LengthUnit::mm, found));
  return metres_of(found).has_value();
}

void DeclaredEmulation::take(std::string_view comment) {
  if (!is_one_of(take_comment_word(comment), {"emulated"})) return;
  emulated = true;
  while (!comment.empty())
    if (take_comment_word(comment) == "block") {
      std::uint64_t number = 0;
      if (parse_count(take_comment_word(comment), number) && number <= limits::kStationsMax)
        block = static_cast<std::uint8_t>(number);
      return;
    }
}

bool DeclaredTemperature::take(std::string_view comment, std::string_view& found) {
  if (take_comment_word(comment) != "scanner_temperature_c") return true;
  found = take_comment_word(comment);
  double value = kNoValue;
  const auto [rest, failed] = std::from_chars(found.data(), found.data() + found.size(), value);
  const bool is_number = failed == std::errc{} && rest == found.data() + found.size();
  if (!is_number || !(value >= kScannerTemperatureMin_c && value <= kScannerTemperatureMax_c)) return false;
  temperature_c = value;
  return true;
}

Error temperature_refused(const char* file, std::size_t line, std::string_view found) {
  return error(Code::frame_incomplete,
               "%s: line %zu: scanner_temperature_c \"%s\", allowed is a number of %.0f..%.0f deg C", file, line,
               shown(found).c_str(), kScannerTemperatureMin_c, kScannerTemperatureMax_c);
}

bool unit_name_agrees(std::string_view word, LengthUnit configured) {
  const std::optional<double> metres = metres_of(word);
  return !metres || *metres == metres_per(configured);
}

Error unit_contradicted(const char* file, std::size_t line, std::string_view found, LengthUnit configured) {
  return error(Code::frame_incomplete, "%s: line %zu: the file declares unit \"%s\", but \"%s\" is configured (%s)",
               file, line, shown(found).c_str(), name(configured), "[scanner] unit, or --unit; known: mm, m, um");
}

}  // namespace slabd::hal
