// SPDX-License-Identifier: Apache-2.0
//
// Sector of a point without an angle: 48 sectors are six per octant. Signs and a swap of the coordinates map a point to
// the first octant; there its sector is the number of tangents that it exceeds. Five products and comparisons for
// sixteen points replace an arctangent each.
//
// Few points are the innermost of their sector when they are processed; those are handled one by one.
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "algo/features/casing_points.cpp"
#include <hwy/foreach_target.h>
//
#include <algorithm>
#include <bit>
#include <cmath>

#include "algo/features/casing_points.h"
#include "algo/lanes-inl.h"

HWY_BEFORE_NAMESPACE();
namespace slabd::algo {
namespace HWY_NAMESPACE {
namespace {

constexpr std::size_t kPerOctant = limits::kRimSectors / 8;
static_assert(limits::kRimSectors == 48, "the tangents below are those of 48 sectors");
/// tan of 7.5, 15, 22.5, 30 and 37.5 degrees.
constexpr std::array<float, kPerOctant - 1> kTangents = {
    0.13165249758739583F, 0.26794919243112270F, 0.41421356237309503F, 0.57735026918962573F, 0.76732698797896033F};

/// Sixteen points in the casing's frame, x and y from the ring's centre.
struct Seen {
  F16 x, y, height, radius2;
  M16 in_ring;
};

class Ring {
 public:
  Ring(const CasingAxes& a, const CasingRing& r)
      : place_x_(f16(a.x_mm)),
        place_s_(f16(a.s_mm)),
        across_{f16(a.across[0]), f16(a.across[1]), f16(a.across[2])},
        along_{f16(a.along[0]), f16(a.along[1]), f16(a.along[2])},
        up_{f16(a.up[0]), f16(a.up[1]), f16(a.up[2])},
        up_mm_(f16(a.up_mm)),
        centre_x_(f16(r.centre_x_mm)),
        centre_y_(f16(r.centre_y_mm)),
        inner2_(f16(r.inner_mm * r.inner_mm)),
        outer2_(f16(r.outer_mm * r.outer_mm)),
        low_(f16(r.low_mm)),
        high_(f16(r.high_mm)) {}

  HWY_INLINE Seen look(const float* x, const float* s, const float* h) const {
    const F16 dx = load(x) - place_x_;
    const F16 ds = load(s) - place_s_;
    const F16 dh = load(h);
    Seen p;
    p.x = across_[0] * dx + across_[1] * ds + across_[2] * dh - centre_x_;
    p.y = along_[0] * dx + along_[1] * ds + along_[2] * dh - centre_y_;
    p.height = up_[0] * dx + up_[1] * ds + up_[2] * dh + up_mm_;
    p.radius2 = p.x * p.x + p.y * p.y;
    p.in_ring = (p.radius2 >= inner2_) & (p.radius2 < outer2_) & (p.height >= low_) & (p.height <= high_);
    return p;
  }

 private:
  F16 place_x_, place_s_;
  F16 across_[3];
  F16 along_[3];
  F16 up_[3];
  F16 up_mm_, centre_x_, centre_y_, inner2_, outer2_, low_, high_;
};

/// Calls take(seen, first, lanes) for every sixteen points. The last group is padded with points far outside any ring.
template <typename Take>
HWY_INLINE void for_sixteen(const SeatPoints& points, const Ring& ring, const Take& take) {
  std::size_t i = 0;
  for (; i + kLanes <= points.size(); i += kLanes) take(ring.look(&points.x[i], &points.s[i], &points.h[i]));
  if (i == points.size()) return;
  alignas(64) std::array<float, kLanes> x, s, h;
  x.fill(1e6F);
  s.fill(1e6F);
  h.fill(0.0F);
  const std::size_t left = points.size() - i;
  std::copy_n(&points.x[i], left, x.begin());
  std::copy_n(&points.s[i], left, s.begin());
  std::copy_n(&points.h[i], left, h.begin());
  take(ring.look(x.data(), s.data(), h.data()));
}

/// Number of the sector, 0..47 anticlockwise from the x axis.
HWY_INLINE I16 sector_of(const F16& x, const F16& y) {
  const F16 wide = abs(x);
  const F16 high = abs(y);
  const F16 small = min(wide, high);
  const F16 large = max(wide, high);
  const F16 zero = f16(0.0F);
  F16 sector = zero;
  for (const float tangent : kTangents) sector = sector + keep(small >= f16(tangent) * large, f16(1.0F));
  constexpr auto kAll = static_cast<float>(limits::kRimSectors);
  sector = select(high > wide, f16(0.25F * kAll - 1.0F) - sector, sector);
  sector = select(x < zero, f16(0.5F * kAll - 1.0F) - sector, sector);
  sector = select(y < zero, f16(kAll - 1.0F) - sector, sector);
  return to_int(sector);
}

void FindInnermost(const SeatPoints& points, const CasingAxes& axes, const CasingRing& limits, Innermost& innermost) {
  for_sixteen(points, Ring(axes, limits), [&](const Seen& p) {
    if (bits(p.in_ring) == 0) return;
    const I16 sectors = sector_of(p.x, p.y);
    std::uint32_t nearer = bits(p.in_ring & (p.radius2 < gather(innermost.radius2.data(), sectors)));
    if (nearer == 0) return;
    alignas(64) std::array<std::int32_t, kLanes> sector;
    alignas(64) std::array<float, kLanes> radius2, x, y;
    store(sectors, sector.data());
    store(p.radius2, radius2.data());
    store(p.x, x.data());
    store(p.y, y.data());
    for (; nearer != 0; nearer &= nearer - 1) {
      const auto lane = static_cast<std::size_t>(std::countr_zero(nearer));
      const auto k = static_cast<std::size_t>(sector[lane]);
      if (radius2[lane] >= innermost.radius2[k]) continue;
      innermost.radius2[k] = radius2[lane];
      innermost.x[k] = x[lane] + limits.centre_x_mm;
      innermost.y[k] = y[lane] + limits.centre_y_mm;
    }
  });
}

std::size_t HeightsInRing(const SeatPoints& points, const CasingAxes& axes, const CasingRing& limits,
                          std::span<float> heights) {
  std::size_t count = 0;
  for_sixteen(points, Ring(axes, limits), [&](const Seen& p) {
    std::uint32_t in_ring = bits(p.in_ring);
    if (in_ring == 0) return;
    alignas(64) std::array<float, kLanes> height;
    store(p.height, height.data());
    for (; in_ring != 0; in_ring &= in_ring - 1)
      heights[count++] = height[static_cast<std::size_t>(std::countr_zero(in_ring))];
  });
  return count;
}

}  // namespace
}  // namespace HWY_NAMESPACE
}  // namespace slabd::algo
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace slabd::algo {

HWY_EXPORT(FindInnermost);
HWY_EXPORT(HeightsInRing);

void find_innermost(const SeatPoints& points, const CasingAxes& axes, const CasingRing& ring, Innermost& innermost) {
  HWY_DYNAMIC_DISPATCH(FindInnermost)(points, axes, ring, innermost);
}

std::size_t heights_in_ring(const SeatPoints& points, const CasingAxes& axes, const CasingRing& ring,
                            std::span<float> heights) {
  return HWY_DYNAMIC_DISPATCH(HeightsInRing)(points, axes, ring, heights);
}

}  // namespace slabd::algo
#endif
