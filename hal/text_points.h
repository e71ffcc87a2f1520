// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <span>

#include "hal/hal.h"
#include "hal/scan_window.h"

namespace slabd::hal {

/// Reads points as lines of numbers (XYZ, ASC, TXT, CSV) from `window`, of which nothing is consumed yet, as
/// `read_scan` promises. Separators: blanks, tab, comma or semicolon, one kind per file. `#` and `//` begin a comment,
/// empty lines count for nothing, one line of column names may stand first, or in a comment above the points (as many
/// names as columns, x, y and z among them), further columns are ignored. nan, inf or nothing between two separators: a
/// missing point. A decimal comma is recognised and refused. No heap.
template <typename Real>  // float or double
[[nodiscard]] Result<ScanShape> read_text_points(ScanWindow& window, LengthUnit unit, std::span<Real> xyz);

}  // namespace slabd::hal
