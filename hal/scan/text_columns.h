// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <optional>
#include <string_view>

#include "hal/hal.h"
#include "hal/scan/text_lines.h"

/// Separator of a text scan and the columns of its x, y, z: determined by its first line that is not a comment, then
/// the same for the whole file.
namespace slabd::hal {

enum class Separator : char { blanks = ' ', tab = '\t', comma = ',', semicolon = ';' };

/// The strongest one on the line: semicolon, tab, comma, blanks. Blanks separate in runs, the others one by one.
[[nodiscard]] Separator separator_of(std::string_view line);

/// Splits off the next field, without blanks around it and the quotes around those; an empty field is a missing value.
/// False at the end of the line.
class FieldReader {
 public:
  FieldReader(std::string_view line, Separator separator) : rest_(line), separator_(separator) {}
  [[nodiscard]] bool next(std::string_view& field);

 private:
  std::string_view rest_;
  Separator separator_;
  bool used_up_ = false;
};

struct TextColumns {
  std::array<std::size_t, 3> xyz = {0, 1, 2};  ///< columns, from 0
  std::size_t needed = 3;                      ///< minimum number of fields in a line
};

/// A line of names: none of its fields is a number or begins like one. `columns`: where x, y, z are named (any case,
/// quotes, a unit in brackets behind: `"X [mm]"`, x_mm). frame_incomplete: they are not named, only some are, one is
/// named twice, or a unit contradicts `unit`; the text has the names and what to do.
[[nodiscard]] bool is_line_of_names(std::string_view line, Separator separator);
[[nodiscard]] Status find_columns(const TextLines& lines, std::string_view line, Separator separator, LengthUnit unit,
                                  TextColumns& columns);

/// Three columns whose names are one name with x, y and z in it: PosX, PosY, PosZ. Looks at the first 64.
struct LikelyColumns {
  std::array<std::size_t, 3> xyz{};
  std::array<std::string_view, 3> names;
};
[[nodiscard]] std::optional<LikelyColumns> likely_columns(std::string_view line, Separator separator);

/// Columns that were chosen by name or by number, in a table whose line of names is `line` (empty: it has none).
/// frame_incomplete: a name is not there, or a unit contradicts `unit`.
[[nodiscard]] Status find_chosen_columns(const TextLines& lines, std::string_view line, Separator separator,
                                         LengthUnit unit, const TableColumns& chosen, TextColumns& columns);
/// The option of the shell and the key of the configuration that select the columns `three`, for messages.
[[nodiscard]] FixedString<300> how_to_choose(std::string_view three);
/// True if all columns chosen by name are in `line`.
[[nodiscard]] bool has_chosen_columns(std::string_view line, Separator separator, const TableColumns& chosen);
/// True if at least one column is chosen by name.
[[nodiscard]] bool is_chosen_by_name(const TableColumns& chosen);

/// The part of a comment that may be a line of names: without the comment's mark and a label ("# columns: x y z").
[[nodiscard]] std::string_view names_in_comment(std::string_view comment);
/// A line of names in which x, y and z are separate words (or with a unit after them). Stricter than is_line_of_names:
/// "z up, x along, y across" is a free comment.
[[nodiscard]] bool names_every_axis(std::string_view line, Separator separator);
/// A header that only numbers its columns, "0,1,2" or ",0,1,2", as pandas writes it.
[[nodiscard]] bool is_line_of_column_numbers(std::string_view line, Separator separator);
/// Several points in one row, x,y,z,x,y,z: each number is like the third before it and unlike its neighbour.
[[nodiscard]] bool is_line_of_tuples(std::string_view line, Separator separator);
/// Number of columns in a line of names or of numbers, without empty ones at its end.
[[nodiscard]] std::size_t count_columns(std::string_view line, Separator separator);

}  // namespace slabd::hal
