// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>

#include "hal/hal.h"
#include "hal/scan/scan_window.h"

namespace slabd::hal {

/// Reads points as lines of numbers (XYZ, ASC, TXT, CSV) from `window`, of which nothing is consumed yet, as
/// `read_scan` promises. Separators: blanks, tab, comma or semicolon, one kind per file. `#` and `//` begin a comment,
/// empty lines count for nothing. The number of points may stand alone in a line before them; then there are as many.
/// One line of column names may stand before the points, or in a comment above them (as many names as columns); x, y
/// and z must be among them unless `columns` chooses others; further columns are ignored. nan, inf or nothing between
/// two separators: a missing point. Refused, because x, y and z are not known or not there: other names, more than
/// kTableColumnsMax columns without names, a first column that counts the rows, a decimal comma. No heap.
template <typename Real>  // float or double
[[nodiscard]] Result<ScanShape> read_text_points(ScanWindow& window, LengthUnit unit, std::span<Real> xyz,
                                                 const TableColumns& columns = {});

}  // namespace slabd::hal
