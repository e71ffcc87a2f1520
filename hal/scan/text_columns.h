// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
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
/// True for a first line of whole numbers >= 0, at least three and not all equal, if the lines `behind` it have decimal
/// points: in each of their first three numbers, or in any three and their number of columns is another. `numbers`: the
/// first three.
[[nodiscard]] bool is_number_header(std::string_view line, std::string_view behind, LineEnd end, Separator separator,
                                    std::array<std::uint64_t, 3>& numbers);
/// True for 0, 1, 2 ... or 1, 2, 3 ...
[[nodiscard]] bool are_column_numbers(std::string_view line, Separator separator);
/// Several points in one row, x,y,z,x,y,z: each number is like the third before it and unlike its neighbour.
[[nodiscard]] bool is_line_of_tuples(std::string_view line, Separator separator);
/// Number of columns in a line of names or of numbers, without empty ones at its end.
[[nodiscard]] std::size_t count_columns(std::string_view line, Separator separator);

/// The numbers of the first rows of a table without names: content of the columns behind x, y, z, and values that a
/// float cannot hold. All answers are false if there are too few rows.
class FirstRows {
 public:
  /// Fills the sample from the first row and the text behind it, which may end within a line. Stops at the first row
  /// that is not a row of numbers, or has fewer columns.
  void take(std::string_view row, std::string_view behind, LineEnd end, Separator separator);

  /// 1 if the values of the column rise from row to row, nine of ten times by about the same step; -1 if they fall;
  /// else 0.
  [[nodiscard]] int even_direction(std::size_t column) const;
  /// True if the values rise and fall in turn more often than along profiles of twenty points.
  [[nodiscard]] bool jumps(std::size_t column) const;
  [[nodiscard]] bool is_whole(std::size_t column) const;
  /// True if nine of ten numbers of the column are not whole.
  [[nodiscard]] bool has_fractions(std::size_t column) const;
  /// Number of the first columns that contain only whole numbers of 0..255.
  [[nodiscard]] std::size_t bytes_in_front() const;
  /// True if the three columns from `first` on are a vector of unit length.
  [[nodiscard]] bool are_normals(std::size_t first) const;
  /// True for x,y,z,x,y,z and x,y,z,x,y,z,x,y,z: neighbouring points of a scan are close to each other.
  [[nodiscard]] bool has_points_side_by_side() const;

 private:
  static constexpr std::size_t kRowsMin = 20;
  static constexpr std::size_t kRowsMax = 64;

  bool add(std::string_view row, Separator separator);
  [[nodiscard]] double at(std::size_t row, std::size_t column) const {
    return values_[row * kTableColumnsMax + column];
  }
  /// The step of the column that most rows have, and the number of these rows.
  struct Step {
    double step = 0.0;
    std::size_t rows = 0;
  };
  [[nodiscard]] Step commonest_step(std::size_t column) const;
  [[nodiscard]] bool knows(std::size_t column) const { return rows_ >= kRowsMin && column < columns_; }

  std::array<double, kRowsMax * kTableColumnsMax> values_;  // not initialised: only rows_ rows are read
  std::size_t rows_ = 0;
  std::size_t columns_ = 0;
};

}  // namespace slabd::hal
