// SPDX-License-Identifier: Apache-2.0
//
// The loops of an ICP step, compiled for each instruction set. icp_kernels.h has the idea: sums per face instead of
// sums per point. Sixteen points on one face, the usual case in a sorted sample, cost the arithmetic of one face. Where
// faces meet, each face in turn selects its points by a mask.
//
// Sums of a step are floats for at most 512 points, then doubles; those of counting for a block of the sample. A float
// sum of so few weights and coordinates is accurate to 1e-6 of itself, and the sums that decide the pose (the v's) are
// of small numbers of both signs.
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "algo/register/icp_kernels.cpp"
// clang-format off
#include <hwy/foreach_target.h>
#include "algo/lanes-inl.h"
// clang-format on

#include <limits>

#include "algo/register/icp_kernels.h"

HWY_BEFORE_NAMESPACE();
namespace slabd::algo {
namespace HWY_NAMESPACE {

inline constexpr std::size_t kFloatGroups = 32;
inline constexpr std::size_t kSums = FaceSums::points;

/// A face's sums of up to 512 points.
struct GroupSums {
  alignas(64) float lane[kSums][kLanes];
};

/// Sums of one face in registers.
struct RunSums {
  F16 s[kSums];

  HWY_INLINE void clear() {
    for (F16& sum : s) sum = f16(0.0F);
  }
  HWY_INLINE void add(F16 x, F16 y, F16 z, F16 w, F16 v) {
    const F16 wx = w * x;
    const F16 wy = w * y;
    const F16 wz = w * z;
    s[0] = s[0] + w;
    s[1] = s[1] + wx;
    s[2] = s[2] + wy;
    s[3] = s[3] + wz;
    s[4] = s[4] + wx * x;
    s[5] = s[5] + wx * y;
    s[6] = s[6] + wx * z;
    s[7] = s[7] + wy * y;
    s[8] = s[8] + wy * z;
    s[9] = s[9] + wz * z;
    s[10] = s[10] + v;
    s[11] = s[11] + v * x;
    s[12] = s[12] + v * y;
    s[13] = s[13] + v * z;
  }
  HWY_INLINE void flush(FaceSums& to) const {
    for (std::size_t k = 0; k < kSums; ++k) to.s[k] += sum_of_lanes(s[k]);
  }
  HWY_INLINE void load_from(const GroupSums& from) {
    for (std::size_t k = 0; k < kSums; ++k) s[k] = load(from.lane[k]);
  }
  HWY_INLINE void store_to(GroupSums& to) const {
    for (std::size_t k = 0; k < kSums; ++k) store(s[k], to.lane[k]);
  }
};

/// A face's plane, in every lane.
struct Slope16 {
  F16 x, y, z, d;
  explicit HWY_INLINE Slope16(const Slope& s)
      : x(f16(static_cast<float>(s.n.x()))),
        y(f16(static_cast<float>(s.n.y()))),
        z(f16(static_cast<float>(s.n.z()))),
        d(f16(static_cast<float>(s.d))) {}
  [[nodiscard]] HWY_INLINE F16 at(F16 px, F16 py, F16 pz) const { return x * px + y * py + (z * pz + d); }
};

/// The same in double, for distances as accurate as the scan.
HWY_INLINE D16 exact_distance(const Slope& s, D16 x, D16 y, D16 z) {
  return d16(s.n.x()) * x + d16(s.n.y()) * y + (d16(s.n.z()) * z + d16(s.d));
}

/// Looks up the faces visible around points.
class FacesSeen {
 public:
  explicit FacesSeen(const IcpView& view)
      : pairs_(reinterpret_cast<const std::int32_t*>(view.cells.data())),
        xx_(f16(static_cast<float>(view.R(0, 0)))),
        xy_(f16(static_cast<float>(view.R(0, 1)))),
        xz_(f16(static_cast<float>(view.R(0, 2)))),
        yx_(f16(static_cast<float>(view.R(1, 0)))),
        yy_(f16(static_cast<float>(view.R(1, 1)))),
        yz_(f16(static_cast<float>(view.R(1, 2)))),
        x0_(f16(static_cast<float>(view.t.x() + 0.5 * static_cast<double>(limits::kFaceTableX)))),
        y0_(f16(static_cast<float>(view.t.y() + 0.5 * static_cast<double>(limits::kFaceTableY)))) {}

  /// Bits of faces, 0 outside the table and for NaN; `inside` marks the points in it.
  HWY_INLINE I16 at(F16 x, F16 y, F16 z, M16& inside) const {
    const F16 column = xx_ * x + xy_ * y + (xz_ * z + x0_);
    const F16 row = yx_ * x + yy_ * y + (yz_ * z + y0_);
    const F16 zero = f16(0.0F);
    inside = (column >= zero) & (column < f16(kColumns)) & (row >= zero) & (row < f16(kRows));
    const I16 cell =
        to_int(keep(inside, row)) * i16(static_cast<std::int32_t>(limits::kFaceTableX)) + to_int(keep(inside, column));
    // Each 32 bits contain two cells.
    const I16 odd = bit_and(cell, i16(1));
    const I16 pair = gather(pairs_, shift_right<1>(cell));
    const I16 seen = bit_and(shift_right(pair, odd * i16(16)), i16(kAllFaces));
    return keep_int(inside, seen);
  }

 private:
  static constexpr float kColumns = static_cast<float>(limits::kFaceTableX);
  static constexpr float kRows = static_cast<float>(limits::kFaceTableY);
  static_assert(limits::kFaceTableX % 2 == 0, "cells are read in pairs");
  const std::int32_t* pairs_;
  F16 xx_, xy_, xz_, yx_, yy_, yz_, x0_, y0_;
};

/// OR of all lanes.
HWY_INLINE std::uint32_t any_bits(const I16& a) {
  alignas(64) std::uint32_t lane[kLanes];
  store(a, reinterpret_cast<std::int32_t*>(lane));
  std::uint32_t all = 0;
  for (const std::uint32_t v : lane) all |= v;
  return all;
}

struct Closest {
  F16 distance, face;
};
/// The closest visible face, in the order of the faces at equal distance. The distance is infinite if no face is
/// visible.
HWY_INLINE Closest closest(const Slopes& slopes, F16 x, F16 y, F16 z, const I16& seen, std::uint32_t any) {
  const F16 nothing = f16(std::numeric_limits<float>::infinity());
  Closest c{nothing, f16(kNoFace)};
  F16 least = nothing;
  for (std::uint32_t left = any; left != 0; left &= left - 1) {
    const auto f = static_cast<unsigned>(__builtin_ctz(left));
    const F16 r = Slope16(slopes[f]).at(x, y, z);
    const M16 better = test_bits(seen, i16(static_cast<std::int32_t>(1U << f))) & (abs(r) < least);
    least = select(better, abs(r), least);
    c.distance = select(better, r, c.distance);
    c.face = select(better, f16(static_cast<float>(f)), c.face);
  }
  return c;
}

HWY_INLINE F16 tukey(F16 r, float per_gate2) {
  const F16 a = f16(1.0F) - r * r * f16(per_gate2);
  return a * a;
}

void sum_closest_kernel(const IcpSample& points, const IcpView& view, double gate_mm, SumsOfFaces& sums) {
  const FacesSeen faces(view);
  const auto gate = static_cast<float>(gate_mm);
  const float per_gate2 = 1.0F / (gate * gate);
  GroupSums group[kFaces];
  for (std::size_t first = 0; first < points.size(); first += kFloatGroups * kLanes) {
    const std::size_t last =
        first + kFloatGroups * kLanes < points.size() ? first + kFloatGroups * kLanes : points.size();
    std::uint32_t open = 0;
    for (std::size_t i = first; i < last; i += kLanes) {
      const F16 x = load(&points.x[i]);
      const F16 y = load(&points.y[i]);
      const F16 z = load(&points.z[i]);
      M16 inside;
      const I16 seen = faces.at(x, y, z, inside);
      const std::uint32_t any = any_bits(seen);
      if (any == 0) continue;
      const Closest c = closest(view.slopes, x, y, z, seen, any);
      const M16 in_gate = abs(c.distance) < f16(gate);
      const F16 w0 = tukey(c.distance, per_gate2);
      for (std::uint32_t left = any; left != 0; left &= left - 1) {
        const auto f = static_cast<unsigned>(__builtin_ctz(left));
        const M16 mine = in_gate & (c.face == f16(static_cast<float>(f)));
        const std::uint32_t which = bits(mine);
        if (which == 0) continue;
        sums[f].s[FaceSums::points] += static_cast<double>(__builtin_popcount(which));
        const F16 w = keep(mine, w0);
        const F16 v = keep(mine, w0 * c.distance);
        RunSums run;
        if ((open & (1U << f)) != 0)
          run.load_from(group[f]);
        else
          run.clear();
        run.add(keep(mine, x), keep(mine, y), keep(mine, z), w, v);
        run.store_to(group[f]);
        open |= 1U << f;
      }
    }
    for (; open != 0; open &= open - 1) {
      const auto f = static_cast<unsigned>(__builtin_ctz(open));
      RunSums run;
      run.load_from(group[f]);
      run.flush(sums[f]);
    }
  }
}

void count_and_associate_kernel(const IcpSample& points, const IcpView& view, double gate_mm, const Association& to,
                                FaceCounts& counts) {
  const FacesSeen faces(view);
  const auto gate = static_cast<float>(gate_mm);
  const F16 nan = f16(std::numeric_limits<float>::quiet_NaN());
  // Sums of at most kIcpBlock distances within the gate, only to assess a face: floats are accurate enough.
  F16 sum[kFaces], squares[kFaces];
  for (std::size_t f = 0; f < kFaces; ++f) sum[f] = squares[f] = f16(0.0F);
  for (std::size_t i = 0; i < points.size(); i += kLanes) {
    const F16 x = load(&points.x[i]);
    const F16 y = load(&points.y[i]);
    const F16 z = load(&points.z[i]);
    M16 inside;
    const I16 seen = faces.at(x, y, z, inside);
    const std::uint32_t any = any_bits(seen);
    std::uint16_t here = 0;
    F16 distance = nan;
    F16 face = f16(kNoFace);
    counts.in_field += static_cast<std::size_t>(__builtin_popcount(bits(inside)));
    if (any != 0) {
      // A single face is visible if clearing the lowest bit leaves zero.
      const M16 single = inside & is_zero(bit_and(seen, seen + i16(-1)));
      const Closest c = closest(view.slopes, x, y, z, seen, any);
      counts.near_model += static_cast<std::size_t>(__builtin_popcount(bits(abs(c.distance) <= f16(gate))));
      const D16 dx = to_double(x);
      const D16 dy = to_double(y);
      const D16 dz = to_double(z);
      for (std::uint32_t left = any; left != 0; left &= left - 1) {
        const auto f = static_cast<unsigned>(__builtin_ctz(left));
        const M16 mine = single & (c.face == f16(static_cast<float>(f)));
        const std::uint32_t which = bits(mine);
        if (which == 0) continue;
        counts.expected[f] += static_cast<std::size_t>(__builtin_popcount(which));
        const F16 r = to_float(exact_distance(view.slopes[f], dx, dy, dz));
        const M16 found = mine & (abs(r) < f16(gate));
        const std::uint32_t on_it = bits(found);
        if (on_it == 0) continue;
        counts.found[f] += static_cast<std::size_t>(__builtin_popcount(on_it));
        const F16 kept = keep(found, r);
        sum[f] = sum[f] + kept;
        squares[f] = squares[f] + kept * kept;
        distance = select(found, r, distance);
        face = select(found, f16(static_cast<float>(f)), face);
        here = static_cast<std::uint16_t>(here | (1U << f));
      }
    }
    if (to.face.empty()) continue;
    store(distance, &to.distance_mm[i]);
    alignas(64) float number[kLanes];
    store(face, number);
    for (std::size_t k = 0; k < kLanes; ++k) to.face[i + k] = static_cast<std::uint8_t>(number[k]);
    to.groups[i / kLanes] = here;
  }
  for (std::size_t f = 0; f < kFaces; ++f) {
    counts.sum_mm[f] += sum_of_lanes(sum[f]);
    counts.sum_mm2[f] += sum_of_lanes(squares[f]);
  }
}

void sort_keys_kernel(const IcpSample& points, const IcpView& view, std::span<std::uint8_t> keys) {
  const FacesSeen faces(view);
  for (std::size_t i = 0; i < points.size(); i += kLanes) {
    const F16 x = load(&points.x[i]);
    const F16 y = load(&points.y[i]);
    const F16 z = load(&points.z[i]);
    M16 inside;
    const I16 seen = faces.at(x, y, z, inside);
    // The exponent of a lane as float is the number of its highest bit.
    const F16 face = to_float(shift_right<23>(pattern(to_float(seen))) + i16(-127));
    const M16 single = is_zero(bit_and(seen, seen + i16(-1)));
    // Points between faces are sorted after those on one face: the last steps do not use them.
    const F16 key = select(is_zero(seen), f16(2 * kFaces), select(single, face, face + f16(kFaces)));
    alignas(64) std::int32_t number[kLanes];
    store(to_int(key), number);
    for (std::size_t k = 0; k < kLanes; ++k) keys[i + k] = static_cast<std::uint8_t>(number[k]);
  }
}

/// Lanes of sixteen points that belong to a face.
HWY_INLINE M16 lanes_of(const std::uint8_t* face, unsigned f) {
  alignas(64) float number[kLanes];
  for (std::size_t k = 0; k < kLanes; ++k) number[k] = static_cast<float>(face[k]);
  return load(number) == f16(static_cast<float>(f));
}

template <Weights kWeights>
HWY_INLINE void add_weighted(RunSums& run, F16 x, F16 y, F16 z, F16 r, const M16& mine, float per_gate2, float mean) {
  const F16 one = f16(1.0F);
  const F16 u2 = r * r * f16(per_gate2);
  const F16 a = one - u2;
  const F16 v = keep(mine, r * (a * a));
  F16 w;
  if constexpr (kWeights == Weights::tukey) {
    w = keep(mine, a * a);
  } else if constexpr (kWeights == Weights::newton) {
    w = keep(mine, a * (one - f16(5.0F) * u2));
  } else {
    const F16 off = v - f16(mean);
    w = keep(mine, off * off);
  }
  run.add(x, y, z, w, v);
}

template <Weights kWeights>
void sum_associated_as(const IcpSample& points, const Association& from, const Slopes& moved, double gate_mm,
                       const std::array<double, kFaces>& means, SumsOfFaces& sums) {
  const auto gate = static_cast<float>(gate_mm);
  const float per_gate2 = 1.0F / (gate * gate);
  const std::size_t groups = points.size() / kLanes;
  for (std::size_t g = 0; g < groups;) {
    const std::uint32_t here = from.groups[g];
    if (here == 0) {
      ++g;
      continue;
    }
    std::size_t end = g + 1;
    const bool one_face = (here & (here - 1)) == 0;
    while (one_face && end < groups && end - g < kFloatGroups && from.groups[end] == here) ++end;
    for (std::uint32_t left = here; left != 0; left &= left - 1) {
      const auto f = static_cast<unsigned>(__builtin_ctz(left));
      const Slope16 slope(moved[f]);
      const auto mean = static_cast<float>(means[f]);
      RunSums run;
      run.clear();
      std::size_t count = 0;
      for (std::size_t k = g; k < end; ++k) {
        const std::size_t i = k * kLanes;
        const F16 x = load(&points.x[i]);
        const F16 y = load(&points.y[i]);
        const F16 z = load(&points.z[i]);
        const F16 r = load(&from.distance_mm[i]) + slope.at(x, y, z);
        M16 mine = abs(r) < f16(gate);
        if (!one_face) mine = mine & lanes_of(&from.face[i], f);
        const std::uint32_t which = bits(mine);
        count += static_cast<std::size_t>(__builtin_popcount(which));
        // Coordinates are masked, because NaN of a missing point times weight zero is NaN.
        add_weighted<kWeights>(run, keep(mine, x), keep(mine, y), keep(mine, z), r, mine, per_gate2, mean);
      }
      run.flush(sums[f]);
      sums[f].s[FaceSums::points] += static_cast<double>(count);
    }
    g = end;
  }
}

void sum_associated_kernel(const IcpSample& points, const Association& from, const Slopes& moved, double gate_mm,
                           Weights weights, const std::array<double, kFaces>& means, SumsOfFaces& sums) {
  switch (weights) {
    case Weights::tukey: return sum_associated_as<Weights::tukey>(points, from, moved, gate_mm, means, sums);
    case Weights::newton: return sum_associated_as<Weights::newton>(points, from, moved, gate_mm, means, sums);
    case Weights::scatter: return sum_associated_as<Weights::scatter>(points, from, moved, gate_mm, means, sums);
  }
}

void magnitudes_kernel(const IcpSample& points, const Association& from, const Slopes& moved, double gate_mm,
                       std::span<float> out) {
  const F16 gate = f16(static_cast<float>(gate_mm));
  const F16 none = f16(std::numeric_limits<float>::infinity());
  for (std::size_t i = 0; i < points.size(); i += kLanes) {
    F16 r = none;
    const F16 x = load(&points.x[i]);
    const F16 y = load(&points.y[i]);
    const F16 z = load(&points.z[i]);
    const std::uint32_t here = from.groups[i / kLanes];
    const bool one_face = (here & (here - 1)) == 0;
    for (std::uint32_t left = here; left != 0; left &= left - 1) {
      const auto f = static_cast<unsigned>(__builtin_ctz(left));
      const F16 now = abs(load(&from.distance_mm[i]) + Slope16(moved[f]).at(x, y, z));
      M16 mine = now < gate;
      if (!one_face) mine = mine & lanes_of(&from.face[i], f);
      r = select(mine, now, r);
    }
    store(r, &out[i]);
  }
}

std::size_t count_up_to_kernel(std::span<const float> values, float limit) {
  const F16 bound = f16(limit);
  F16 count = f16(0.0F);
  for (std::size_t i = 0; i < values.size(); i += kLanes) count = count + keep(load(&values[i]) <= bound, f16(1.0F));
  return static_cast<std::size_t>(sum_of_lanes(count));
}

}  // namespace HWY_NAMESPACE
}  // namespace slabd::algo
HWY_AFTER_NAMESPACE();

#if HWY_ONCE

namespace slabd::algo {
HWY_EXPORT(sum_closest_kernel);
HWY_EXPORT(count_and_associate_kernel);
HWY_EXPORT(sort_keys_kernel);
HWY_EXPORT(sum_associated_kernel);
HWY_EXPORT(magnitudes_kernel);
HWY_EXPORT(count_up_to_kernel);

void FaceCounts::add(const FaceCounts& other) {
  in_field += other.in_field;
  near_model += other.near_model;
  for (std::size_t f = 0; f < kFaces; ++f) {
    expected[f] += other.expected[f];
    found[f] += other.found[f];
    sum_mm[f] += other.sum_mm[f];
    sum_mm2[f] += other.sum_mm2[f];
  }
}

void sum_closest(const IcpSample& points, const IcpView& view, double gate_mm, SumsOfFaces& sums) {
  HWY_DYNAMIC_DISPATCH(sum_closest_kernel)(points, view, gate_mm, sums);
}
void count_and_associate(const IcpSample& points, const IcpView& view, double gate_mm, const Association& to,
                         FaceCounts& counts) {
  HWY_DYNAMIC_DISPATCH(count_and_associate_kernel)(points, view, gate_mm, to, counts);
}
void sort_keys(const IcpSample& points, const IcpView& view, std::span<std::uint8_t> keys) {
  HWY_DYNAMIC_DISPATCH(sort_keys_kernel)(points, view, keys);
}
void sum_associated(const IcpSample& points, const Association& from, const Slopes& moved, double gate_mm,
                    Weights weights, const std::array<double, kFaces>& means, SumsOfFaces& sums) {
  HWY_DYNAMIC_DISPATCH(sum_associated_kernel)(points, from, moved, gate_mm, weights, means, sums);
}
void magnitudes(const IcpSample& points, const Association& from, const Slopes& moved, double gate_mm,
                std::span<float> out) {
  HWY_DYNAMIC_DISPATCH(magnitudes_kernel)(points, from, moved, gate_mm, out);
}
std::size_t count_up_to(std::span<const float> values, float limit) {
  return HWY_DYNAMIC_DISPATCH(count_up_to_kernel)(values, limit);
}

}  // namespace slabd::algo
#endif
