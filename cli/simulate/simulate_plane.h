// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "base/base.h"

namespace slabd::args {
class Command;
}  // namespace slabd::args

/// `slabctl simulate plane`: the set-up of the paper's Table 1, a plane with noise and outliers, as XYZ text.
namespace slabd::simulate {

struct PlaneOrder {
  std::string out;
  std::uint64_t seed = 2024;
  std::size_t points = 2000;
  std::size_t outliers = 500;
  double noise_mm = 0.01;
};

/// z = x + 2 y + 1 over |x|, |y| <= 1 with noise along its normal (sum of twelve uniform numbers), then outliers
/// spread evenly over the box around it. The same seed gives the same points everywhere.
[[nodiscard]] std::vector<Vec3> draw_plane(const PlaneOrder& order);

void add_simulate_plane(args::Command& simulate);

}  // namespace slabd::simulate
