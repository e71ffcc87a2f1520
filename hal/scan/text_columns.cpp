// SPDX-License-Identifier: Apache-2.0
#include "hal/scan/text_columns.h"

#include <algorithm>
#include <array>
#include <cctype>
#include <cmath>
#include <limits>

#include "hal/scan/text_lines.h"

namespace slabd::hal {

Separator separator_of(std::string_view line) {
  for (const Separator separator : {Separator::semicolon, Separator::tab, Separator::comma})
    if (line.find(static_cast<char>(separator)) != std::string_view::npos) return separator;
  return Separator::blanks;
}

namespace {

/// Spreadsheets write every cell in quotes, numbers too.
std::string_view without_quotes(std::string_view field) {
  if (field.size() < 2 || field.front() != '"' || field.back() != '"') return field;
  return trimmed(field.substr(1, field.size() - 2));
}

}  // namespace

bool FieldReader::next(std::string_view& field) {
  if (used_up_) return false;
  if (separator_ == Separator::blanks) {
    field = take_word(rest_);
    used_up_ = field.empty();
    return !used_up_;
  }
  const std::size_t end = rest_.find(static_cast<char>(separator_));
  used_up_ = end == std::string_view::npos;
  field = without_quotes(trimmed(rest_.substr(0, end)));
  rest_.remove_prefix(used_up_ ? rest_.size() : end + 1);
  return true;
}

namespace {

/// A separate field with a unit after a name ("x [mm] y [mm]" between blanks) is not a column.
bool is_unit_in_brackets(std::string_view field) {
  return field.starts_with('[') || field.starts_with('(');
}

/// `"X [mm]"` -> axis 0 and "mm". Axis 3: another name.
struct ColumnName {
  std::size_t axis = 3;
  std::string_view unit;
};
ColumnName parse_name(std::string_view field) {
  constexpr std::string_view kAround = " \t\"'";
  constexpr std::string_view kBetween = " \t_[(";
  ColumnName name;
  const std::size_t begin = field.find_first_not_of(kAround);
  if (begin == std::string_view::npos) return name;
  field = field.substr(begin, field.find_last_not_of(kAround) - begin + 1);
  const bool alone = field.size() == 1 || kBetween.find(field[1]) != std::string_view::npos;
  const std::size_t axis = std::string_view("xyz").find(static_cast<char>(field[0] | 0x20));
  if (!alone || axis == std::string_view::npos) return name;
  name.axis = axis;
  const std::size_t unit = field.find_first_not_of(kBetween, 1);
  if (unit != std::string_view::npos) name.unit = field.substr(unit, field.find_last_not_of(")] \t") - unit + 1);
  return name;
}

/// `"PosX [mm]"` -> PosX and mm.
struct BareName {
  std::string_view name;
  std::string_view unit;
};
BareName bare_name(std::string_view field) {
  constexpr std::string_view kAround = " \t\"'";
  const auto without = [&](std::string_view text) {
    const std::size_t begin = text.find_first_not_of(kAround);
    if (begin == std::string_view::npos) return std::string_view();
    return text.substr(begin, text.find_last_not_of(kAround) - begin + 1);
  };
  field = without(field);
  const std::size_t bracket = field.find_first_of("[(");
  if (bracket == std::string_view::npos || bracket == 0) return {field, {}};
  const std::string_view inside = field.substr(bracket + 1);
  return {without(field.substr(0, bracket)), without(inside.substr(0, inside.find_first_of("])")))};
}

bool is_column_number(std::string_view wanted, std::size_t& place) {
  std::uint64_t number = 0;
  if (!parse_count(wanted, number) || number == 0 || number > kTextLineBytesMax) return false;
  place = number - 1;
  return true;
}

bool same_letters(std::string_view a, std::string_view b) {
  return std::equal(a.begin(), a.end(), b.begin(), b.end(), [](char p, char q) {
    return std::tolower(static_cast<unsigned char>(p)) == std::tolower(static_cast<unsigned char>(q));
  });
}

bool find_name(std::string_view line, Separator separator, std::string_view wanted, std::size_t& place,
               std::string_view& unit) {
  FieldReader fields(line, separator);
  std::size_t column = 0;
  for (std::string_view field; fields.next(field);) {
    if (separator == Separator::blanks && is_unit_in_brackets(field)) continue;
    const BareName bare = bare_name(field);
    if (same_letters(bare.name, wanted) || same_letters(field, wanted)) {
      place = column;
      unit = bare.unit;
      return true;
    }
    ++column;
  }
  return false;
}

}  // namespace

Result<TableColumns> parse_table_columns(std::string_view text) {
  TableColumns columns;
  std::string_view rest = text;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const std::size_t comma = rest.find(',');
    const std::string_view one = trimmed(rest.substr(0, comma));
    const bool is_last = comma == std::string_view::npos;
    if (one.empty() || one.size() > FixedString<40>::capacity() || is_last != (axis == 2))
      return error(Code::config, "columns \"%s\": expected are three names or numbers with commas between, as in 2,3,4",
                   shown(text).c_str());
    columns.xyz[axis] = one;
    rest.remove_prefix(is_last ? rest.size() : comma + 1);
  }
  return columns;
}

bool is_line_of_names(std::string_view line, Separator separator) {
  if (line.find('\0') != std::string_view::npos) return false;  // UTF-16, or not a text
  bool any = false;
  FieldReader fields(line, separator);
  for (std::string_view field; fields.next(field);) {
    double value = 0.0;
    // Also "1,5" and "12.3.4": a malformed number is not a name, or a malformed first line would lose a point.
    if (field.find_first_of("0123456789+-.") == 0 || parse_number(field, value)) return false;
    any = any || !field.empty();
  }
  return any;
}

std::optional<LikelyColumns> likely_columns(std::string_view line, Separator separator) {
  FixedVector<std::string_view, 64> names;
  FieldReader fields(line, separator);
  for (std::string_view field; fields.next(field);)
    if (!names.push(bare_name(field).name)) break;
  const auto place_of = [&names](std::string_view wanted, std::size_t letter, char axis) -> std::optional<std::size_t> {
    for (std::size_t i = 0; i < names.size(); ++i) {
      const std::string_view name = names[i];
      if (name.size() == wanted.size() && name[letter] == axis && name.substr(0, letter) == wanted.substr(0, letter) &&
          name.substr(letter + 1) == wanted.substr(letter + 1))
        return i;
    }
    return std::nullopt;
  };
  for (std::size_t x = 0; x < names.size(); ++x) {
    for (std::size_t letter = 0; letter < names[x].size(); ++letter) {
      const char c = names[x][letter];
      if (c != 'x' && c != 'X') continue;
      const auto y = place_of(names[x], letter, static_cast<char>(c + 1));
      const auto z = place_of(names[x], letter, static_cast<char>(c + 2));
      if (y && z) return LikelyColumns{{x, *y, *z}, {names[x], names[*y], names[*z]}};
    }
  }
  return std::nullopt;
}

namespace {

Error refuse_names(const TextLines& lines, std::string_view line, Separator separator) {
  const std::optional<LikelyColumns> likely = likely_columns(line, separator);
  FixedString<130> three("A,B,C");
  const auto is_typed_everywhere = [](std::string_view name) {
    return std::all_of(name.begin(), name.end(), [](char c) { return c > ' ' && c <= '~'; });
  };
  if (likely && !std::all_of(likely->names.begin(), likely->names.end(), is_typed_everywhere))
    three.printf("%zu,%zu,%zu", likely->xyz[0] + 1, likely->xyz[1] + 1, likely->xyz[2] + 1);
  else if (likely)
    three.printf("%s,%s,%s", shown(likely->names[0].substr(0, 40)).c_str(),
                 shown(likely->names[1].substr(0, 40)).c_str(), shown(likely->names[2].substr(0, 40)).c_str());
  return lines.refuse("no column is named x, y or z: rename three, or choose them with %s; the names are \"%s\"%s",
                      how_to_choose(three.view()).c_str(), shown(line).c_str(),
                      is_utf8(line) ? " (a line that names no columns begins with #)" : hint_of_encoding(line));
}

}  // namespace

FixedString<300> how_to_choose(std::string_view three) {
  FixedString<300> text;
  const int size = static_cast<int>(three.size());
  text.printf("--columns %.*s (on the line: scanner.columns = \"%.*s\")", size, three.data(), size, three.data());
  return text;
}

bool has_chosen_columns(std::string_view line, Separator separator, const TableColumns& chosen) {
  return std::all_of(chosen.xyz.begin(), chosen.xyz.end(), [&](const FixedString<40>& one) {
    std::size_t place = 0;
    std::string_view unit;
    return is_column_number(one.view(), place) || find_name(line, separator, one.view(), place, unit);
  });
}

bool is_chosen_by_name(const TableColumns& chosen) {
  std::size_t place = 0;
  return std::any_of(chosen.xyz.begin(), chosen.xyz.end(), [&place](const FixedString<40>& one) {
    return !one.empty() && !is_column_number(one.view(), place);
  });
}

Status find_chosen_columns(const TextLines& lines, std::string_view line, Separator separator, LengthUnit unit,
                           const TableColumns& chosen, TextColumns& columns) {
  TextColumns found;
  found.needed = 0;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const std::string_view wanted = chosen.xyz[axis].view();
    std::string_view column_unit;
    if (!is_column_number(wanted, found.xyz[axis]) &&
        !find_name(line, separator, wanted, found.xyz[axis], column_unit)) {
      if (line.empty())
        return lines.refuse(
            "no column is named \"%s\", for this table does not name its columns: choose them by number",
            shown(wanted).c_str());
      return lines.refuse("no column is named \"%s\", the names are \"%s\"%s", shown(wanted).c_str(),
                          shown(line).c_str(), hint_of_encoding(line));
    }
    if (!unit_name_agrees(column_unit, unit)) return unit_contradicted(lines.file(), lines.number(), column_unit, unit);
    found.needed = std::max(found.needed, found.xyz[axis] + 1);
  }
  columns = found;
  return success();
}

Status find_columns(const TextLines& lines, std::string_view line, Separator separator, LengthUnit unit,
                    TextColumns& columns) {
  std::array<bool, 3> seen{};
  TextColumns found;
  FieldReader fields(line, separator);
  std::size_t column = 0;
  std::size_t axis = 3;
  for (std::string_view field; fields.next(field);) {
    const bool unit_only = separator == Separator::blanks && is_unit_in_brackets(field);
    const ColumnName name = unit_only ? ColumnName{3, trimmed(field.substr(1, field.size() - 2))} : parse_name(field);
    if (!unit_only) axis = name.axis;
    if (axis < 3 && !unit_name_agrees(name.unit, unit))
      return unit_contradicted(lines.file(), lines.number(), name.unit, unit);
    if (unit_only) continue;
    if (axis < 3) {
      if (seen[axis]) return lines.refuse("a second column named \"%s\"", shown(field).c_str());
      seen[axis] = true;
      found.xyz[axis] = column;
    }
    ++column;
  }
  const auto named = std::count(seen.begin(), seen.end(), true);
  if (named == 0) return refuse_names(lines, line, separator);
  if (named < 3)
    return lines.refuse("of x, y and z only %d are among the column names%s", static_cast<int>(named),
                        hint_of_encoding(line));
  found.needed = *std::max_element(found.xyz.begin(), found.xyz.end()) + 1;
  columns = found;
  return success();
}

std::string_view names_in_comment(std::string_view comment) {
  comment.remove_prefix(std::min(comment.find_first_not_of("#/"), comment.size()));
  const std::size_t colon = comment.find(':');
  return colon == std::string_view::npos ? comment : comment.substr(colon + 1);
}

bool names_every_axis(std::string_view line, Separator separator) {
  if (!is_line_of_names(line, separator)) return false;
  std::array<bool, 3> seen{};
  FieldReader fields(line, separator);
  for (std::string_view field; fields.next(field);) {
    const ColumnName name = parse_name(field);
    if (name.axis == 3) continue;
    // The text after the letter is a unit if it is one word.
    if (name.unit.find_first_of(" \t") != std::string_view::npos) return false;
    const std::string_view bare = field.substr(std::min(field.find_first_not_of(" \t\"'"), field.size()));
    const bool unit_is_marked = bare.find_first_of("_[(") != std::string_view::npos;
    if (!name.unit.empty() && !unit_is_marked) return false;
    seen[name.axis] = true;
  }
  return seen[0] && seen[1] && seen[2];
}

bool is_line_of_column_numbers(std::string_view line, Separator separator) {
  if (separator == Separator::blanks) return false;
  FieldReader fields(line, separator);
  std::string_view field;
  std::uint64_t expected = 0;
  for (bool is_first = true; fields.next(field); is_first = false) {
    if (is_first && field.empty()) continue;  // above an index without a name
    std::uint64_t number = 0;
    if (!parse_count(field, number) || number != expected) return false;
    ++expected;
  }
  return expected >= 3;
}

bool is_line_of_tuples(std::string_view line, Separator separator) {
  constexpr std::size_t kPointsMin = 4;
  std::array<double, 3> before{};
  double of_neighbours = 0.0;
  double of_axes = 0.0;
  std::size_t column = 0;
  FieldReader fields(line, separator);
  for (std::string_view field; fields.next(field); ++column) {
    double value = 0.0;
    if (!parse_number(field, value)) return false;
    if (column >= 3) of_axes += std::abs(value - before[column % 3]);
    if (column >= 1) of_neighbours += std::abs(value - before[(column - 1) % 3]);
    before[column % 3] = value;
  }
  return column % 3 == 0 && column >= 3 * kPointsMin && of_axes < 0.1 * of_neighbours;
}

std::size_t count_columns(std::string_view line, Separator separator) {
  std::size_t fields_read = 0;
  std::size_t count = 0;
  FieldReader fields(line, separator);
  for (std::string_view field; fields.next(field);) {
    if (separator == Separator::blanks && is_unit_in_brackets(field)) continue;
    ++fields_read;
    if (!field.empty()) count = fields_read;
  }
  return count;
}

namespace {

/// Splits off the next complete line that is not blank. False if there is none.
bool next_row(std::string_view& text, LineEnd end, std::string_view& row) {
  for (std::size_t at = text.find(static_cast<char>(end)); at != std::string_view::npos;
       at = text.find(static_cast<char>(end))) {
    row = text.substr(0, at);
    text.remove_prefix(at + 1);
    while (row.ends_with('\r')) row.remove_suffix(1);
    if (!trimmed(row).empty()) return true;
  }
  return false;
}

}  // namespace

bool is_number_header(std::string_view line, std::string_view behind, LineEnd end, Separator separator,
                      std::array<std::uint64_t, 3>& numbers) {
  constexpr std::size_t kRowsToTell = 20;
  FieldReader fields(line, separator);
  std::size_t count = 0;
  for (std::string_view field; fields.next(field); ++count) {
    std::uint64_t number = 0;
    if (!parse_count(field, number)) return false;
    if (count < numbers.size()) numbers[count] = number;
  }
  // Three equal numbers mark a missing point.
  if (count < 3 || (numbers[0] == numbers[1] && numbers[1] == numbers[2])) return false;
  std::string_view row;
  for (std::size_t rows = 0; rows < kRowsToTell; ++rows) {
    if (!next_row(behind, end, row)) return false;
    const Separator of_row = separator_of(row);
    FieldReader words(row, of_row);
    std::size_t column = 0;
    std::size_t decimals = 0;
    std::size_t leading = 0;
    for (std::string_view word; words.next(word); ++column) {
      double value = 0.0;
      const bool is_decimal = word.find('.') != std::string_view::npos && parse_number(word, value);
      decimals += is_decimal ? 1U : 0U;
      if (is_decimal && leading == column) ++leading;
    }
    const bool other_width = count_columns(row, of_row) != count;
    if (leading < 3 && !(other_width && decimals >= 3)) return false;
  }
  return true;
}

bool are_column_numbers(std::string_view line, Separator separator) {
  FieldReader fields(line, separator);
  std::uint64_t first = 0;
  std::uint64_t count = 0;
  for (std::string_view field; fields.next(field); ++count) {
    std::uint64_t number = 0;
    if (!parse_count(field, number)) return false;
    if (count == 0) first = number;
    if (number != first + count) return false;
  }
  return first <= 1 && count >= 3;
}

bool FirstRows::add(std::string_view row, Separator separator) {
  FieldReader fields(row, separator);
  std::size_t column = 0;
  for (std::string_view field; column < kTableColumnsMax && fields.next(field); ++column) {
    double& value = values_[rows_ * kTableColumnsMax + column];
    if (field.empty())
      value = std::numeric_limits<double>::quiet_NaN();
    else if (!parse_number(field, value))
      break;  // a word after the numbers
  }
  if (rows_ == 0) columns_ = column;
  if (column < columns_) return false;
  ++rows_;
  return true;
}

void FirstRows::take(std::string_view row, std::string_view behind, LineEnd end, Separator separator) {
  rows_ = 0;
  while (rows_ < kRowsMax && add(row, separator) && next_row(behind, end, row)) {
  }
}

FirstRows::Step FirstRows::commonest_step(std::size_t column) const {
  // The majority vote of Boyer and Moore; "the same" allows for the jitter of a clock.
  const auto is_like = [](double a, double b) { return std::abs(a - b) <= 0.5 * std::abs(b); };
  Step step;
  for (std::size_t row = 1; row < rows_; ++row) {
    const double here = at(row, column) - at(row - 1, column);
    if (step.rows == 0)
      step = {here, 1};
    else if (is_like(here, step.step))
      ++step.rows;
    else
      --step.rows;
  }
  step.rows = 0;
  for (std::size_t row = 1; row < rows_; ++row)
    step.rows += is_like(at(row, column) - at(row - 1, column), step.step) ? 1U : 0U;
  return step;
}

int FirstRows::even_direction(std::size_t column) const {
  if (!knows(column)) return 0;
  const Step step = commonest_step(column);
  if (!(step.step != 0.0) || 10 * step.rows < 9 * (rows_ - 1)) return 0;
  for (std::size_t row = 1; row < rows_; ++row)
    if (!((at(row, column) - at(row - 1, column)) * step.step > 0.0)) return 0;
  return step.step > 0.0 ? 1 : -1;
}

bool FirstRows::jumps(std::size_t column) const {
  if (!knows(column)) return false;
  std::size_t turns = 0;
  double before = 0.0;  // the last step that is not 0
  for (std::size_t row = 1; row < rows_; ++row) {
    const double step = at(row, column) - at(row - 1, column);
    turns += step * before < 0.0 ? 1U : 0U;
    if (step != 0.0) before = step;
  }
  return 10 * turns > rows_;
}

bool FirstRows::is_whole(std::size_t column) const {
  if (!knows(column)) return false;
  for (std::size_t row = 0; row < rows_; ++row)
    if (at(row, column) != std::floor(at(row, column))) return false;
  return true;
}

bool FirstRows::has_fractions(std::size_t column) const {
  if (!knows(column)) return false;
  std::size_t fractions = 0;
  for (std::size_t row = 0; row < rows_; ++row) fractions += at(row, column) != std::floor(at(row, column)) ? 1U : 0U;
  return 10 * fractions >= 9 * rows_;
}

std::size_t FirstRows::bytes_in_front() const {
  constexpr double kByteMax = 255.0;
  for (std::size_t column = 0; knows(column); ++column)
    for (std::size_t row = 0; row < rows_; ++row)
      if (const double v = at(row, column); v != std::floor(v) || v < 0.0 || v > kByteMax) return column;
  return rows_ < kRowsMin ? 0 : columns_;
}

bool FirstRows::are_normals(std::size_t first) const {
  if (!knows(first + 2)) return false;
  for (std::size_t row = 0; row < rows_; ++row)
    if (std::abs(std::hypot(at(row, first), at(row, first + 1), at(row, first + 2)) - 1.0) > 0.01) return false;
  return true;
}

bool FirstRows::has_points_side_by_side() const {
  if ((columns_ != 6 && columns_ != 9) || !knows(columns_ - 1) || are_normals(3)) return false;
  std::size_t rows_of_points = 0;
  for (std::size_t row = 0; row < rows_; ++row) {
    double of_axes = 0.0;
    double of_neighbours = 0.0;
    for (std::size_t column = 1; column < columns_; ++column) {
      of_neighbours += std::abs(at(row, column) - at(row, column - 1));
      if (column >= 3) of_axes += std::abs(at(row, column) - at(row, column - 3));
    }
    rows_of_points += of_axes < 0.1 * of_neighbours ? 1U : 0U;
  }
  return 10 * rows_of_points >= 9 * rows_;
}

}  // namespace slabd::hal
