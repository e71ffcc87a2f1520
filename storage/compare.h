// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <string>
#include <vector>

#include "base/fields.h"
#include "base/jobs.h"

/// Comparison of a repeated measurement with the stored one.
namespace slabd::storage {

/// A stored figure that differs from the new one.
struct Difference {
  std::string figure;  ///< "item seat_slope U", "plane jaw_inner offset_mm", "station 4 verdict"
  std::string stored;  ///< full precision; "none" if the number is absent
  std::string now;
};
SLABD_FIELDS(Difference, figure, stored, now);
struct Comparison {
  std::size_t figures = 0;  ///< number of compared figures
  std::vector<Difference> differences;
};
SLABD_FIELDS(Comparison, figures, differences);
/// Adds to `out` the values of a block, of its maps or of a slab's end that differ in any bit stored in the database.
/// Times are not compared, and neither is a map that was not stored.
void compare(const BlockResult& stored, const BlockResult& now, Comparison& out);
void compare(const BlockMaps& stored, const BlockMaps& now, Comparison& out);
void compare(const SlabResult& stored, const SlabResult& now, Comparison& out);

}  // namespace slabd::storage
