// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "algo/algo.h"
#include "scene.h"

/// Runs a drawn block through the whole inspection.
namespace slabd::algo {

/// `room`: capacity of the scan's buffer in points; at least the size of the scan.
inline BlockResult inspect(scene::Cloud cloud, const Recipe& recipe = scene::p5600(),
                           const Pose& T_base_block = Pose::identity(), std::size_t room = 0,
                           const SlabFacts& slab = {}) {
  static BlockInspector inspector;  // one for all scans of a test, as in the daemon
  inspector.use(recipe);
  inspector.begin(4, T_base_block, T_base_block * nominal_T_block_scanner(), {}, slab);
  Cloud view = cloud.view();
  if (room > view.points) {
    cloud.xyz.resize(3 * room);
    view.xyz = cloud.xyz;
  }
  Status status = inspector.denoise(view);
  if (status) status = inspector.register_to_model(view);
  if (status) status = inspector.extract(view);
  inspector.judge(status ? Code::ok : status.error().code);
  return inspector.result();
}

inline BlockResult inspect(const scene::Block& block) {
  scene::Scan scan;
  scan.displacement = scene::displaced(1.2, -0.8, 0.5, 0.15, -0.2, 0.1);
  return inspect(scene::take(block, scan));
}

inline const Item& item(const BlockResult& r, ItemId id) {
  const Item* found = find_item(r.items.begin(), r.items.end(), id);
  EXPECT_NE(found, nullptr);
  return *found;
}

/// The same scan in an image of 2448 x 2048 pixels, of which the others are empty.
inline scene::Cloud in_large_image(const scene::Cloud& small) {
  scene::Cloud large = small;
  large.width = 2'448;
  large.height = 2'048;
  EXPECT_LE(small.width + 500, large.width);
  EXPECT_LE(small.height + 300, large.height);
  large.xyz.assign(3 * large.width * large.height, std::nanf(""));
  for (std::size_t row = 0; row < small.height; ++row)
    std::copy_n(&small.xyz[3 * row * small.width], 3 * small.width, &large.xyz[3 * ((row + 300) * large.width + 500)]);
  return large;
}

/// Expects that every item passes (or is information, or a skew without an insert) except `failing`.
inline void expect_only_failure(const BlockResult& r, ItemId failing) {
  EXPECT_EQ(r.verdict, Verdict::fail);
  EXPECT_EQ(r.reason, kReasonItemBase + static_cast<int>(failing));
  for (const Item& i : r.items) {
    if (i.id == failing) {
      EXPECT_EQ(i.verdict, Verdict::fail) << info(i.id).name << " " << i.value;
    } else if (i.id == ItemId::seat_std) {
      EXPECT_EQ(i.verdict, Verdict::none);
    } else if (i.id == ItemId::casing_skew_inner || i.id == ItemId::casing_skew_outer) {
      EXPECT_EQ(i.verdict, Verdict::not_measured);
    } else {
      EXPECT_EQ(i.verdict, Verdict::pass) << info(i.id).name << " " << i.value;
    }
  }
}

/// True for a point of the block in a whole scan, by its z in the block frame.
inline bool on_block(double z) {
  return z > -27.0;
}

}  // namespace slabd::algo
