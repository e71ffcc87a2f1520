// SPDX-License-Identifier: Apache-2.0
//
// Which points are noise? Not those without neighbours: a reflection a millimetre off the seat has hundreds of them,
// and on a steep face a good point of a coarse scan has two. Noise is what no surface goes through: a surface is a
// sheet, and around each of its points a good part of all points lies in one plane with it, whatever the plane's slope.
// The yardstick is the scan's own pitch. A speck smaller than about three pitches is noise, an object is not.
#include "algo/denoise.h"

#include <cassert>

#include "algo/denoise_cloud.h"
#include "algo/denoise_grid.h"

namespace slabd::algo {

void remove_isolated(Cloud& cloud, const DenoiseWorkspace& work, Team& team, ScanCounts& counts) {
  assert(cloud.points <= work.keep.size());
  counts = ScanCounts{};
  counts.points_read = cloud.points;
  // A scan whose header says grid and whose points do not lie in one is a cloud like any other.
  if (!denoise_grid(cloud, work, team, counts)) denoise_cloud(cloud, work, counts);
}

}  // namespace slabd::algo
