// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <string_view>

#include "hal/scan/text_columns.h"

/// Fast path of text scans: rows as programs write them, millions in the same form. A row that is not plain is left to
/// the ordinary readers, which handle every spelling and every error; so only the speed differs.
namespace slabd::hal {

/// Form of the rows; x, y, z are the first three fields.
struct PlainRowForm {
  Separator separator = Separator::blanks;
  /// Words after x, y, z: exactly `words_more`, or any text if `any_more`.
  bool any_more = false;
  std::size_t words_more = 0;
};

struct PlainRows {
  std::size_t rows = 0;
  std::size_t bytes = 0;  ///< of `text`, all complete lines
};

/// Reads plain rows from `text`, which starts with a line, into `xyz` (3 a row, in mm, not finite where the text is).
/// Reads at most `rows_max` rows. A plain row has three numbers, the fields of `form`, and LF or CR LF at its end. A
/// plain number is "nan", or digits with optional sign, point and exponent, at most 8 digits in front of the point and
/// 19 in all. Stops at the first row that is not plain, or that reaches into the last kPlainRowTail bytes of `text`.
/// Numbers are rounded exactly as `parse_coordinate` rounds them. No heap; about 10 ns a row.
template <typename Real>  // float or double
[[nodiscard]] PlainRows read_plain_rows(std::string_view text, const PlainRowForm& form, double mm_per_unit, Real* xyz,
                                        std::size_t rows_max);

/// Bytes that reading may reach beyond the end of a number, because eight bytes are read at a time.
inline constexpr std::size_t kPlainRowTail = 48;

}  // namespace slabd::hal
