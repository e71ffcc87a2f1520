// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "base/fields.h"
#include "base/jobs.h"

/// Is what was measured again what was stored?
namespace slabd::storage {

/// A stored figure that came out otherwise.
struct Difference {
  std::string figure;  ///< "item seat_slope U", "plane jaw_inner offset_mm", "station 4 verdict"
  std::string stored;  ///< every digit of it; "none" for a number that is not there
  std::string now;
};
SLABD_FIELDS(Difference, figure, stored, now);
struct Comparison {
  std::size_t figures = 0;  ///< compared
  std::vector<Difference> differences;
};
SLABD_FIELDS(Comparison, figures, differences);
/// Adds to `out` what of a block, of its maps or of a slab's end differs in any bit that the database would hold. Times
/// are not compared, nor is a map that was not kept.
void compare(const BlockResult& stored, const BlockResult& now, Comparison& out);
void compare(const BlockMaps& stored, const BlockMaps& now, Comparison& out);
void compare(const SlabResult& stored, const SlabResult& now, Comparison& out);

}  // namespace slabd::storage
