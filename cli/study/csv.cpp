// SPDX-License-Identifier: Apache-2.0
#include "cli/study/csv.h"

#include <iconv.h>

#include <algorithm>
#include <charconv>
#include <cmath>

#include "base/items.h"
#include "base/limits.h"
#include "base/plain_text.h"
#include "cli/calibrate/calibrate.h"

namespace slabd::cli::study {
namespace {

std::string trimmed(std::string_view text) {
  const std::size_t first = text.find_first_not_of(" \t\r");
  if (first == std::string_view::npos) return {};
  return std::string(text.substr(first, text.find_last_not_of(" \t\r") - first + 1));
}

/// False if a quote is not closed.
bool split(std::string_view line, char separator, std::vector<std::string>& cells) {
  std::string cell;
  bool quoted = false;
  bool was_quoted = false;
  for (std::size_t i = 0; i < line.size(); ++i) {
    const char c = line[i];
    if (quoted) {
      if (c != '"') {
        cell += c;
      } else if (i + 1 < line.size() && line[i + 1] == '"') {
        cell += line[++i];
      } else {
        quoted = false;
      }
    } else if (c == '"' && trimmed(cell).empty()) {
      cell.clear();
      quoted = was_quoted = true;
    } else if (c == separator) {
      cells.push_back(was_quoted ? cell : trimmed(cell));
      cell.clear();
      was_quoted = false;
    } else if (!was_quoted || (c != ' ' && c != '\r')) {
      cell += c;
    }
  }
  cells.push_back(was_quoted ? cell : trimmed(cell));
  return !quoted;
}

char separator_of(std::string_view heading) {
  for (const char c : {'\t', ';', ','})
    if (heading.find(c) != std::string_view::npos) return c;
  return ',';
}

}  // namespace

namespace {

Result<std::string> converted(std::string text, const char* encoding, const std::string& path) {
  iconv_t how = ::iconv_open("UTF-8", encoding);
  if (how == reinterpret_cast<iconv_t>(-1))  // NOLINT(performance-no-int-to-ptr): iconv's own way to fail
    return error(Code::config, "%s: it is %s, which this computer cannot convert: save it as UTF-8", path.c_str(),
                 encoding);
  std::string out(4 * text.size() + 4, '\0');
  char* from = text.data();
  char* to = out.data();
  std::size_t left = text.size();
  std::size_t room = out.size();
  const bool whole = ::iconv(how, &from, &left, &to, &room) != static_cast<std::size_t>(-1) && left == 0;
  ::iconv_close(how);
  if (!whole)
    return error(Code::config, "%s: byte %zu is neither UTF-8 nor %s: save the table as UTF-8", path.c_str(),
                 text.size() - left, encoding);
  out.resize(out.size() - room);
  return out;
}

/// Converts to UTF-8: Excel saves "Unicode text" as UTF-16 and, in China, CSV as GBK, which GB 18030 contains.
Result<std::string> as_utf8(std::string text, const std::string& path) {
  if (text.starts_with("\xFF\xFE") || text.starts_with("\xFE\xFF")) return converted(std::move(text), "UTF-16", path);
  for (std::size_t at = 0; at < text.size();) {
    const CodePoint c = code_point_at(std::string_view(text).substr(at));
    if (!c.is_utf8) return converted(std::move(text), "GB18030", path);
    at += c.bytes;
  }
  return text;
}

}  // namespace

Result<CsvTable> CsvTable::read(const std::string& path) {
  Result<std::string> text = text_file(path);
  if (text.ok()) text = as_utf8(std::move(text.value()), path);
  if (!text.ok()) return text.error();
  return parse(text.value(), path);
}

Result<CsvTable> CsvTable::parse(std::string_view text, const std::string& path) {
  CsvTable table;
  table.path_ = path;
  if (text.starts_with("\xEF\xBB\xBF")) text.remove_prefix(3);
  char separator = 0;
  int line = 0;
  while (!text.empty()) {
    const std::size_t end = std::min(text.find('\n'), text.size());
    const std::string_view here = text.substr(0, end);
    text.remove_prefix(std::min(end + 1, text.size()));
    ++line;
    const std::string content = trimmed(here);
    if (content.empty() || content.front() == '#') continue;
    if (separator == 0) separator = separator_of(here);
    std::vector<std::string> cells;
    if (!split(here, separator, cells))
      return error(Code::config, "%s:%d: a quote is opened and not closed", path.c_str(), line);
    if (table.columns_.empty()) {
      table.columns_ = cells;
      for (std::size_t i = 0; i < cells.size(); ++i)
        if (std::find(cells.begin(), cells.begin() + static_cast<std::ptrdiff_t>(i), cells[i]) !=
            cells.begin() + static_cast<std::ptrdiff_t>(i))
          return error(Code::config, "%s:%d: two columns are named '%s'", path.c_str(), line, cells[i].c_str());
      continue;
    }
    if (cells.size() != table.columns_.size())
      return error(Code::config, "%s:%d: %zu cells, but the first line names %zu columns", path.c_str(), line,
                   cells.size(), table.columns_.size());
    table.rows_.push_back({line, std::move(cells)});
  }
  if (table.rows_.empty())
    return error(Code::config, "%s: no values; expected a line of column names and lines of values", path.c_str());
  return table;
}

bool CsvTable::has(std::string_view column) const {
  return std::find(columns_.begin(), columns_.end(), column) != columns_.end();
}

const std::string& CsvTable::cell(std::size_t row, std::string_view column) const {
  static const std::string kEmpty;
  const auto found = std::find(columns_.begin(), columns_.end(), column);
  if (found == columns_.end()) return kEmpty;
  return rows_[row].cells[static_cast<std::size_t>(found - columns_.begin())];
}

Result<double> CsvTable::number(std::size_t row, std::string_view column) const {
  const std::string& text = cell(row, column);
  if (text.empty()) return kNoValue;
  double value = 0.0;
  const char* first = text.data() + (text.front() == '+' ? 1 : 0);
  const auto [stop, fault] = std::from_chars(first, text.data() + text.size(), value);
  if (fault != std::errc{} || stop != text.data() + text.size() || !std::isfinite(value))
    return error(Code::config, "%s: %s '%s' is not a number such as 1.4321 (decimal point, no comma)",
                 place(row).c_str(), std::string(column).c_str(), text.c_str());
  return value;
}

Result<CsvTable::Limits> CsvTable::limits(std::size_t row) const {
  const Result<double> lower = number(row, "lower");
  if (!lower.ok()) return lower.error();
  const Result<double> upper = number(row, "upper");
  if (!upper.ok()) return upper.error();
  // With a tolerance of zero or below, every gauge would be capable.
  if (lower.value() >= upper.value())
    return error(Code::config, "%s: lower %g is not below upper %g", place(row).c_str(), lower.value(), upper.value());
  return Limits{lower.value(), upper.value()};
}

Result<int> CsvTable::block(std::size_t row, std::string_view column) const {
  const std::string& text = cell(row, column);
  if (text.empty()) return 0;
  int value = 0;
  const auto [stop, fault] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (fault != std::errc{} || stop != text.data() + text.size() || value < 0 ||
      value > static_cast<int>(limits::kStationsMax))
    return error(Code::config, "%s: %s '%s' is not a block number 1..%zu", place(row).c_str(),
                 std::string(column).c_str(), text.c_str(), static_cast<std::size_t>(limits::kStationsMax));
  return value;
}

std::string CsvTable::place(std::size_t row) const {
  return path_ + ":" + std::to_string(rows_[row].line);
}

Status CsvTable::expect(std::initializer_list<std::string_view> needed,
                        std::initializer_list<std::string_view> optional) const {
  std::string missing;
  for (const std::string_view column : needed)
    if (!has(column)) missing += (missing.empty() ? "" : ", ") + std::string(column);
  if (!missing.empty()) return error(Code::config, "%s: column missing: %s", path_.c_str(), missing.c_str());
  for (const std::string& column : columns_) {
    const bool known = std::find(needed.begin(), needed.end(), column) != needed.end() ||
                       std::find(optional.begin(), optional.end(), column) != optional.end();
    if (known) continue;
    std::string all;
    for (const auto& list : {needed, optional})
      for (const std::string_view name : list) all += (all.empty() ? "" : ", ") + std::string(name);
    return error(Code::config, "%s: no column '%s' is read here; columns are %s", path_.c_str(), column.c_str(),
                 all.c_str());
  }
  return success();
}

}  // namespace slabd::cli::study
