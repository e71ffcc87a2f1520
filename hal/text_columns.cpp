// SPDX-License-Identifier: Apache-2.0
#include "hal/text_columns.h"

#include <algorithm>

#include "hal/declared_unit.h"

namespace slabd::hal {

Separator separator_of(std::string_view line) {
  for (const Separator separator : {Separator::semicolon, Separator::tab, Separator::comma})
    if (line.find(static_cast<char>(separator)) != std::string_view::npos) return separator;
  return Separator::blanks;
}

bool FieldReader::next(std::string_view& field) {
  if (used_up_) return false;
  if (separator_ == Separator::blanks) {
    field = take_word(rest_);
    used_up_ = field.empty();
    return !used_up_;
  }
  const std::size_t end = rest_.find(static_cast<char>(separator_));
  used_up_ = end == std::string_view::npos;
  field = trimmed(rest_.substr(0, end));
  rest_.remove_prefix(used_up_ ? rest_.size() : end + 1);
  return true;
}

namespace {

/// A unit in words of its own behind a name ("x [mm] y [mm]" between blanks) is no column.
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

}  // namespace

bool is_line_of_names(std::string_view line, Separator separator) {
  if (line.find('\0') != std::string_view::npos) return false;  // UTF-16, or no text at all
  bool any = false;
  FieldReader fields(line, separator);
  for (std::string_view field; fields.next(field);) {
    double value = 0.0;
    // Also "1,5" and "12.3.4": a broken number is not a name, or a broken first line would be a lost point.
    if (field.find_first_of("0123456789+-.") == 0 || parse_number(field, value)) return false;
    any = any || !field.empty();
  }
  return any;
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
  if (named == 0) return success();
  if (named < 3) return lines.refuse("of x, y and z only %d are among the column names", static_cast<int>(named));
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
    // What is behind the letter is a unit if it is one word.
    if (name.unit.find_first_of(" \t") != std::string_view::npos) return false;
    const std::string_view bare = field.substr(std::min(field.find_first_not_of(" \t\"'"), field.size()));
    const bool unit_is_marked = bare.find_first_of("_[(") != std::string_view::npos;
    if (!name.unit.empty() && !unit_is_marked) return false;
    seen[name.axis] = true;
  }
  return seen[0] && seen[1] && seen[2];
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

}  // namespace slabd::hal
