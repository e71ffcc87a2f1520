// SPDX-License-Identifier: Apache-2.0
#include "report/table.h"

#include <fmt/core.h>

#include <algorithm>
#include <cmath>

#include "report/json.h"

namespace slabd::report {
namespace {

struct Look {
  std::string_view unicode;
  std::string_view ascii;
  std::string_view colour;  ///< SGR parameters
};

Look look_of(Verdict verdict) {
  switch (verdict) {
    case Verdict::pass: return {"✓", "+", "32"};
    case Verdict::fail: return {"✗", "X", "1;31"};
    case Verdict::indeterminate: return {"?", "?", "33"};
    case Verdict::not_measured: return {"∅", "0", "35"};
    case Verdict::aborted: return {"⊘", "/", "35"};
    case Verdict::none: return {"·", ".", "2"};
  }
  return {"·", ".", "2"};
}

/// A field that contains a quote, a comma or a line end is quoted, and its quotes are doubled.
std::string csv_field(std::string_view text) {
  if (text.find_first_of("\",\r\n") == std::string_view::npos) return std::string(text);
  std::string quoted = "\"";
  for (const char c : text) {
    if (c == '"') quoted += '"';
    quoted += c;
  }
  return quoted + "\"";
}

std::string csv_text(const Cell& cell, TableFor reader) {
  if (const double* value = std::get_if<double>(&cell.number))
    return has_value(*value) ? fmt::format("{}", *value) : "";
  if (const std::int64_t* count = std::get_if<std::int64_t>(&cell.number)) return std::to_string(*count);
  const bool computed =
      !cell.text.empty() && std::string_view("=+-@\t\r\n").find(cell.text.front()) != std::string_view::npos;
  return csv_field((reader == TableFor::spreadsheet && computed ? "'" : "") + cell.text);
}

template <typename FieldOf>
std::string csv_line(const Table& table, const FieldOf& field_of) {
  std::string line;
  for (std::size_t c = 0; c < table.columns.size(); ++c)
    if (!table.columns[c].key.empty()) line += field_of(c) + ",";
  line.pop_back();
  return line + "\r\n";
}

}  // namespace

std::string_view symbol(Verdict verdict, Style style) {
  return style.unicode ? look_of(verdict).unicode : look_of(verdict).ascii;
}

std::string coloured(std::string_view text, std::string_view colour, Style style) {
  return style.colour ? fmt::format("\x1b[{}m{}\x1b[0m", colour, text) : std::string(text);
}

std::string coloured(std::string_view text, Verdict verdict, Style style) {
  return coloured(text, look_of(verdict).colour, style);
}

std::string cell_text(const Cell& cell, Style style) {
  if (!cell.verdict) return cell.text;
  return coloured(fmt::format("{} {}", symbol(*cell.verdict, style), cell.text), *cell.verdict, style);
}

std::string verdict_text(Verdict verdict, Style style) {
  return cell_text(verdict, style);
}

std::size_t display_width(std::string_view text) {
  std::size_t width = 0;
  for (std::size_t at = 0; at < text.size();) {
    const auto byte = [&](std::size_t i) {
      return at + i < text.size() ? static_cast<unsigned char>(text[at + i]) : 0U;
    };
    if (text[at] == '\x1b') {
      while (at < text.size() && text[at] != 'm') ++at;
      ++at;
      continue;
    }
    const unsigned first = byte(0);
    const std::size_t length = first < 0x80 ? 1 : first < 0xE0 ? 2 : first < 0xF0 ? 3 : 4;
    unsigned code = length == 1 ? first : first & (0xFFU >> (length + 1));
    for (std::size_t i = 1; i < length; ++i) code = code << 6U | (byte(i) & 0x3FU);
    // East Asian Width W and F (Unicode TR 11), in whole blocks.
    const bool wide = (code >= 0x1100 && code <= 0x115F) || (code >= 0x2E80 && code <= 0xA4CF) ||
                      (code >= 0xAC00 && code <= 0xD7A3) || (code >= 0xF900 && code <= 0xFAFF) ||
                      (code >= 0xFE30 && code <= 0xFE6F) || (code >= 0xFF00 && code <= 0xFF60) ||
                      (code >= 0xFFE0 && code <= 0xFFE6) || (code >= 0x1F300 && code <= 0x3FFFD);
    width += wide ? 2 : 1;
    at += length;
  }
  return width;
}

Cell::Cell(double value) : text(has_value(value) ? fmt::format("{}", value) : "-"), number(value) {}

Column::Column(std::string_view words, std::string name_for_programs)
    : heading(words),
      key(std::move(name_for_programs)),
      left(heading.ends_with('<')),
      optional(heading.ends_with('?')) {
  if (left || optional) heading.pop_back();
}

Table visible(const Table& table) {
  Table kept;
  kept.title = table.title;
  kept.rows.resize(table.rows.size());
  for (std::size_t c = 0; c < table.columns.size(); ++c) {
    const auto says = [&](const Table::Row& row) { return c < row.size() && !row[c].text.empty(); };
    if (table.columns[c].optional && std::none_of(table.rows.begin(), table.rows.end(), says)) continue;
    kept.columns.push_back(table.columns[c]);
    for (std::size_t r = 0; r < table.rows.size(); ++r)
      if (c < table.rows[r].size()) kept.rows[r].push_back(table.rows[r][c]);
  }
  return kept;
}

Verdict verdict_of(const Table::Row& row) {
  for (auto cell = row.rbegin(); cell != row.rend(); ++cell)
    if (cell->verdict) return *cell->verdict;
  return Verdict::none;
}

std::string text_of(const Table& whole, Style style) {
  const Table table = visible(whole);
  std::vector<std::vector<std::string>> lines(1);
  for (const Column& column : table.columns) lines[0].push_back(column.heading);
  for (const Table::Row& row : table.rows) {
    lines.emplace_back();
    for (const Cell& cell : row) lines.back().push_back(cell_text(cell, style));
  }
  std::vector<std::size_t> widths(table.columns.size(), 0);
  for (const auto& line : lines)
    for (std::size_t c = 0; c < line.size(); ++c) widths[c] = std::max(widths[c], display_width(line[c]));
  std::string text;
  for (const auto& line : lines) {
    std::string padded;
    for (std::size_t c = 0; c < line.size(); ++c) {
      const std::string space(widths[c] - display_width(line[c]), ' ');
      padded += (c == 0 ? "" : "  ") + (c == 0 || table.columns[c].left ? line[c] + space : space + line[c]);
    }
    padded.erase(padded.find_last_not_of(' ') + 1);
    text += padded + "\n";
    if (&line != &lines[0]) continue;
    std::size_t total = 0;
    for (const std::size_t width : widths) total += width + 2;
    text += std::string(total - 2, '-') + "\n";
  }
  return text;
}

std::string csv_heading(const Table& table) {
  return csv_line(table, [&](std::size_t c) { return table.columns[c].key; });
}

std::string csv_rows(const Table& table, TableFor reader) {
  std::string text;
  for (const Table::Row& row : table.rows)
    text += csv_line(table, [&](std::size_t c) { return csv_text(row[c], reader); });
  return text;
}

void write_rows(Json& json, std::string_view name, const Table& table) {
  json.list(name, table.rows, [&](const Table::Row& row) {
    for (std::size_t c = 0; c < table.columns.size(); ++c) {
      if (table.columns[c].key.empty()) continue;
      json.key(table.columns[c].key);
      if (const double* value = std::get_if<double>(&row[c].number))
        json.value(*value);
      else if (const std::int64_t* count = std::get_if<std::int64_t>(&row[c].number))
        json.value(*count);
      else
        json.value(only_if(!row[c].text.empty(), row[c].text));
    }
  });
}

}  // namespace slabd::report
