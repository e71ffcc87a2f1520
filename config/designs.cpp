// SPDX-License-Identifier: Apache-2.0
#include "config/designs.h"

#include <fmt/core.h>

#include <algorithm>
#include <array>
#include <cctype>
#include <charconv>
#include <cmath>
#include <filesystem>
#include <map>
#include <optional>

#include "calib/calib.h"
#include "config/toml_reader.h"

namespace slabd::config {
namespace {

constexpr std::size_t kColumns = 7;
constexpr std::array<std::string_view, kColumns> kNames = {"slab_id", "slab_type", "station",   "dx_mm",
                                                           "dy_mm",   "dz_mm",     "dslope_deg"};
/// Larger differences belong to another slab type. Registration searches 60 mm around the designed place.
constexpr double kOffsetMax_mm = 50.0;
constexpr double kSlopeMax_deg = 1.0;
/// A year's production of a plant is 5 MB.
constexpr std::size_t kFileBytesMax = 64'000'000;

struct Row {
  std::size_t line = 0;
  int slab_type = 0;
  int station = 0;
  std::array<double, 4> numbers{};  ///< dx, dy, dz in mm, dslope in deg
};

/// Lines of one slab in a file.
struct Sheet {
  std::vector<Row> rows;
};

class Reading {
 public:
  Reading(const std::string& path, DesignSet& set) : path_(path), set_(set) {}

  void read(std::string_view bytes) {
    constexpr std::string_view kByteOrderMark = "\xEF\xBB\xBF";
    if (bytes.starts_with(kByteOrderMark)) bytes.remove_prefix(kByteOrderMark.size());
    const std::size_t before = set_.problems.size();
    const bool is_whole = bytes.empty() || bytes.ends_with('\n');
    std::size_t line = 1;
    for (; !bytes.empty(); ++line) {
      std::string_view text = bytes.substr(0, bytes.find('\n'));
      bytes.remove_prefix(std::min(text.size() + 1, bytes.size()));
      if (text.ends_with('\r')) text.remove_suffix(1);
      if (line == 1) {
        if (text != kDesignHeading)
          return problem(1, 1, fmt::format("found \"{}\", the first line must be {}", shown(text), kDesignHeading));
        has_heading_ = true;
      } else if (!text.empty()) {
        read_line(line, text);
      }
    }
    if (!has_heading_)
      return problem(1, 1, fmt::format("the file is empty, the first line must be {}", kDesignHeading));
    // A file that was cut off inside its last number would still be one.
    if (!is_whole) problem(line - 1, 1, "the last line has no line end, so the file may be cut off");
    for (const auto& [id, sheet] : sheets_) check(id, sheet);
    if (set_.problems.size() == before)
      for (const auto& [id, sheet] : sheets_) set_.sheets.push_back(made(id, sheet));
  }

 private:
  void problem(std::size_t line, std::size_t column, const std::string& text) {
    set_.problems.push_back({fmt::format("{}:{}:{}: {}", path_, line, column, text)});
  }
  /// The beginning of a foreign text, without control characters.
  static std::string shown(std::string_view text) {
    std::string out(text.substr(0, 60));
    std::replace_if(
        out.begin(), out.end(), [](char c) { return static_cast<unsigned char>(c) < 0x20; }, '?');
    return out;
  }

  void read_line(std::size_t line, std::string_view text) {
    std::array<std::string_view, kColumns> cells;
    std::array<std::size_t, kColumns> places{};
    std::size_t count = 0;
    for (std::size_t begin = 0;;) {
      const std::size_t end = std::min(text.find(',', begin), text.size());
      if (count < kColumns) {
        cells[count] = text.substr(begin, end - begin);
        places[count] = begin + 1;
      }
      ++count;
      if (end == text.size()) break;
      begin = end + 1;
    }
    if (count != kColumns)
      return problem(line, 1,
                     fmt::format("found {} fields, allowed are {} (decimal point, no decimal comma)", count, kColumns));
    Row row;
    row.line = line;
    const auto bad = [&](std::size_t k, std::string_view allowed) {
      problem(line, places[k], fmt::format("{}: found \"{}\", allowed is {}", kNames[k], shown(cells[k]), allowed));
    };
    const std::string_view id = cells[0];
    const bool printable = std::all_of(id.begin(), id.end(), [](char c) { return c > 0x20 && c < 0x7F && c != '"'; });
    if (id.empty() || id.size() > limits::kSlabIdBytes || !printable)
      return bad(
          0, fmt::format("a SLAB_ID of 1 to {} printable characters without blanks and quotes", limits::kSlabIdBytes));
    if (!number(cells[1], row.slab_type) || row.slab_type < 1 || row.slab_type > 65'535) return bad(1, "1..65535");
    if (!number(cells[2], row.station) || row.station < 1 || row.station > static_cast<int>(limits::kStationsMax))
      return bad(2, fmt::format("1..{}", limits::kStationsMax));
    for (std::size_t k = 0; k < row.numbers.size(); ++k) {
      const double most = k < 3 ? kOffsetMax_mm : kSlopeMax_deg;
      if (!number(cells[3 + k], row.numbers[k]) || !(std::abs(row.numbers[k]) <= most))
        return bad(3 + k, fmt::format("a number within +-{}", most));
    }
    sheets_[std::string(id)].rows.push_back(row);
  }

  template <typename Number>
  static bool number(std::string_view cell, Number& out) {
    if (cell.starts_with("+-")) return false;
    if (cell.starts_with('+')) cell.remove_prefix(1);
    const auto [stop, fault] = std::from_chars(cell.data(), cell.data() + cell.size(), out);
    return fault == std::errc() && stop == cell.data() + cell.size() && !cell.empty();
  }

  /// One type, and each station from 1 to the last once: a seat without a line would silently be a straight one.
  void check(const std::string& id, const Sheet& sheet) {
    std::array<std::size_t, limits::kStationsMax + 1> line_of{};
    for (const Row& row : sheet.rows) {
      std::size_t& line = line_of.at(static_cast<std::size_t>(row.station));
      if (line != 0)
        return problem(row.line, 1, fmt::format("{}: station {} is in line {} already", id, row.station, line));
      line = row.line;
      if (row.slab_type != sheet.rows.front().slab_type)
        return problem(row.line, 1,
                       fmt::format("{}: slab type {}, but {} in line {}", id, row.slab_type,
                                   sheet.rows.front().slab_type, sheet.rows.front().line));
    }
    for (std::size_t station = 1; station <= sheet.rows.size(); ++station)
      if (line_of.at(station) == 0)
        return problem(sheet.rows.back().line, 1,
                       fmt::format("{}: {} stations, but none is {}; allowed is a line for each station of the slab",
                                   id, sheet.rows.size(), station));
  }

  static DesignSheet made(const std::string& id, Sheet sheet) {
    std::sort(sheet.rows.begin(), sheet.rows.end(), [](const Row& a, const Row& b) { return a.station < b.station; });
    DesignSheet out;
    out.slab_id = std::string_view(id);
    out.slab_type = static_cast<std::uint16_t>(sheet.rows.front().slab_type);
    out.stations = static_cast<std::uint8_t>(sheet.rows.size());
    std::string text;
    for (const Row& row : sheet.rows) {
      text += std::to_string(row.station);
      for (const double value : row.numbers) text += fmt::format(",{:.9g}", value);
      text += ';';
    }
    out.text = std::string_view(text);
    out.sha256 = std::string_view(calib::sha256_hex(text));
    return out;
  }

  const std::string& path_;
  DesignSet& set_;
  std::map<std::string, Sheet> sheets_;
  bool has_heading_ = false;
};

}  // namespace

bool same(const DesignSet& a, const DesignSet& b) {
  return std::ranges::equal(a.sheets, b.sheets,
                            [](const DesignSheet& x, const DesignSheet& y) {
                              return x.slab_id == y.slab_id && x.slab_type == y.slab_type && x.sha256 == y.sha256;
                            }) &&
         std::ranges::equal(a.problems, b.problems, {}, &Problem::text, &Problem::text);
}

void parse_designs(const std::string& path, std::string_view bytes, DesignSet& set) {
  Reading(path, set).read(bytes);
}

void load_design_file(const std::string& path, DesignSet& set) {
  if (const std::optional<std::string> bytes = read_text_file(path, set.problems, kFileBytesMax))
    parse_designs(path, *bytes, set);
}

DesignSet load_designs(const std::string& dir) {
  namespace fs = std::filesystem;
  DesignSet set;
  if (dir.empty()) return set;
  std::vector<std::string> paths;
  std::error_code fault;
  for (fs::directory_iterator entry(dir, fault), end; !fault && entry != end; entry.increment(fault)) {
    std::string name = entry->path().filename().string();
    if (name.starts_with('.') || name.ends_with('~')) continue;  // a file that a program is writing, or has kept
    std::transform(name.begin(), name.end(), name.begin(), [](unsigned char c) { return std::tolower(c); });
    if (name.ends_with(".csv") && !entry->is_directory(fault))
      paths.push_back(entry->path().string());
    else  // it may hold a sheet, and its slab would be measured as a straight one
      set.problems.push_back(
          {fmt::format("{}: is not read; allowed in this folder are files *.csv", entry->path().string())});
  }
  if (fault) set.problems.push_back({fmt::format("{}: {}", dir, fault.message())});
  std::sort(paths.begin(), paths.end());
  std::map<std::string, std::string> file_of;
  for (const std::string& path : paths) {
    const std::size_t before = set.sheets.size();
    load_design_file(path, set);
    for (std::size_t i = before; i < set.sheets.size(); ++i) {
      const auto [known, is_new] = file_of.emplace(std::string(set.sheets[i].slab_id.view()), path);
      if (!is_new)
        set.problems.push_back(
            {fmt::format("{}:1:1: slab {} has a sheet in {} too; allowed is one", path, known->first, known->second)});
    }
  }
  const auto by_id = [](const DesignSheet& a, const DesignSheet& b) { return a.slab_id.view() < b.slab_id.view(); };
  std::sort(set.sheets.begin(), set.sheets.end(), by_id);
  // Two sheets of one slab are both left out, because the cast one is unknown.
  std::vector<DesignSheet> once;
  for (std::size_t i = 0; i < set.sheets.size(); ++i) {
    const auto same = [&](std::size_t k) {
      return k < set.sheets.size() && set.sheets[k].slab_id.view() == set.sheets[i].slab_id.view();
    };
    if (!same(i + 1) && !(i > 0 && same(i - 1))) once.push_back(set.sheets[i]);
  }
  set.sheets = std::move(once);
  return set;
}

}  // namespace slabd::config
