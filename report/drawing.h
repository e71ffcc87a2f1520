// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <string>

#include "base/result.h"
#include "report/canvas.h"

namespace slabd::report {

/// Draws one picture of this size and writes it as PNG. config: the file cannot be written; none remains.
[[nodiscard]] Status write_drawing(const std::string& path, double width_mm, double height_mm, double dots_per_inch,
                                   const std::function<void(Canvas&)>& draw);

}  // namespace slabd::report
