// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <string_view>

#include "hal/scan/text_columns.h"

/// The fast way through a text scan: rows as programs write them, millions alike. A row that is not plain is left to
/// the ordinary readers, which know every spelling and every error; so this changes speed and nothing else.
namespace slabd::hal {

/// How the rows look; x, y, z are the first three fields.
struct PlainRowForm {
  Separator separator = Separator::blanks;
  /// Words behind x, y, z: exactly `words_more`, or whatever stands there.
  bool any_more = false;
  std::size_t words_more = 0;
};

struct PlainRows {
  std::size_t rows = 0;
  std::size_t bytes = 0;  ///< of `text`, all of them whole lines
};

/// Reads rows from the beginning of `text`, which begins at a line, as long as they are plain, into `xyz` (3 a row, in
/// mm, not finite as the text has it), at most `rows_max`. Plain: three numbers of digits with perhaps a sign, a point
/// and an exponent, at most 8 digits in front of the point and 19 in all, or "nan"; the fields of `form`; LF or CR LF
/// at the end. Stops at the first row that is not, or that reaches into the last kPlainRowTail bytes of `text`.
/// Numbers are rounded exactly as `parse_coordinate` rounds them. No heap; about 10 ns a row.
template <typename Real>  // float or double
[[nodiscard]] PlainRows read_plain_rows(std::string_view text, const PlainRowForm& form, double mm_per_unit, Real* xyz,
                                        std::size_t rows_max);

/// Numbers are looked at eight bytes at a time, which may reach so far behind their end.
inline constexpr std::size_t kPlainRowTail = 48;

}  // namespace slabd::hal
