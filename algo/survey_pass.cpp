// SPDX-License-Identifier: Apache-2.0
//
// Sixteen consecutive points at a time: their places in the block's frame, then the face each belongs to and what it is
// measured for. Consecutive points are neighbours, so nearly always one look into the table answers for all sixteen:
// its entry says how far around everything is alike (single face, one region). Only where an edge is near are the
// faces compared lane by lane, and only points within a tenth of a millimetre of a region's border, or off their face
// by more than the band the table vouches for, are asked for one by one, exactly.
//
// Precision: a point minus the shift is exact or nearly so; the distance to a face is a product with the face's normal
// and one subtraction, good to 1e-5 mm. Sums are taken in float over at most sixteen sixteens, then in double.
//
// The lanes, the blocks and the order of the sums are fixed, hence the bits.
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "algo/survey_pass.cpp"
// clang-format off
#include <hwy/foreach_target.h>
#include "algo/lanes-inl.h"
// clang-format on

#include "algo/survey_pass.h"
#include "algo/segmentation.h"

HWY_BEFORE_NAMESPACE();
namespace slabd::algo {
namespace HWY_NAMESPACE {

/// Sixteens between two transfers of the float sums to double ones.
constexpr int kFlush = 16;

HWY_INLINE F16 apply(const Row& row, const Points16& d) {
  return f16(row.a[0]) * d.x + f16(row.a[1]) * d.y + f16(row.a[2]) * d.z + f16(row.b);
}

/// A sum that stays exact enough: in float for a while, then in double.
struct LongSum {
  F16 now;
  D16 total;
  HWY_INLINE void clear() {
    now = f16(0.0F);
    total = d16(0.0);
  }
  HWY_INLINE void flush() {
    total = total + to_double(now);
    now = f16(0.0F);
  }
};

/// Counts and sums of TiltedSums.
struct TiltedLanes {
  F16 count;
  std::array<LongSum, 9> sums;
  HWY_INLINE void clear() {
    count = f16(0.0F);
    for (LongSum& s : sums) s.clear();
  }
  HWY_INLINE void add(const M16& in, const F16& all_u, const F16& all_v, const F16& all_r) {
    const F16 u = keep(in, all_u);
    const F16 v = keep(in, all_v);
    const F16 r = keep(in, all_r);
    count = count + keep(in, f16(1.0F));
    sums[0].now = sums[0].now + u;
    sums[1].now = sums[1].now + v;
    sums[2].now = sums[2].now + r;
    sums[3].now = sums[3].now + u * u;
    sums[4].now = sums[4].now + u * v;
    sums[5].now = sums[5].now + u * r;
    sums[6].now = sums[6].now + v * v;
    sums[7].now = sums[7].now + v * r;
    sums[8].now = sums[8].now + r * r;
  }
  HWY_INLINE void flush() {
    for (LongSum& s : sums) s.flush();
  }
  void close(TiltedSums& out) {
    flush();
    out.count += sum_of_lanes(count);
    for (std::size_t i = 0; i < sums.size(); ++i) out.sums[i] += sum_of_lanes(sums[i].total);
  }
};

HWY_INLINE F16 above(const Tilt& tilt, const F16& u, const F16& v, const F16& h) {
  return h - f16(tilt.a0) - f16(tilt.a1) * u - f16(tilt.a2) * v;
}

/// Where the next points of a list go.
struct Cursor {
  float* to = nullptr;
  std::size_t count = PointPool::kPiece;
  std::uint32_t piece = PointPool::kNone;
};

class Surveyor {
 public:
  Surveyor(const SurveyTask& task, PointPool& pool, const MapSums& map, SurveySums& out)
      : task_(task), pool_(pool), map_(map), out_(out) {
    out = SurveySums{};
    out.first.fill(PointPool::kNone);
    out.last.fill(PointPool::kNone);
    for (TiltedLanes& m : moments_) m.clear();
    for (F16& c : face_points_) c = f16(0.0F);
    near_ = f16(0.0F);
    sum_.clear();
    squares_.clear();
    for (F16& c : shares_) c = f16(0.0F);
  }

  HWY_INLINE void look_at(const float* xyz, const Points16& p) {
    const SurveyFrame& frame = task_.frame;
    const Points16 d{p.x - f16(frame.shift[0]), p.y - f16(frame.shift[1]), p.z - f16(frame.shift[2])};
    const F16 x = apply(frame.x, d);
    const F16 y = apply(frame.y, d);
    // False for NaN.
    const M16 active = (abs(x) < f16(kHalfX)) & (abs(y) < f16(kHalfY));
    const std::uint32_t lanes = bits(active);
    if (lanes == 0) return;
    alignas(64) std::array<float, kLanes> xs;
    alignas(64) std::array<float, kLanes> ys;
    store(x, xs.data());
    store(y, ys.data());
    constexpr std::uint32_t kMiddle = 8;
    const auto anchor = (lanes >> kMiddle & 1U) != 0 ? kMiddle : static_cast<std::uint32_t>(__builtin_ctz(lanes));
    const std::uint32_t entry = task_.table[cell_of(xs[anchor], ys[anchor])];
    if (entry >> survey_cell::kReachShift != 0) {
      const F16 reach = f16(static_cast<float>(entry >> survey_cell::kReachShift));
      const M16 near = (abs(x - f16(xs[anchor])) <= reach) & (abs(y - f16(ys[anchor])) <= reach);
      const auto face = static_cast<std::size_t>(__builtin_ctz(entry));
      const F16 r = apply(frame.height[face], d);
      if (bits(near & active & (abs(r) <= f16(task_.band_mm))) == lanes) {
        add_deviation(active, r);
        if (map_lane_in(lanes)) add_to_map(xs, ys, r);
        const auto region =
            static_cast<Region>(__builtin_ctz((entry & survey_cell::kRegionBits) >> survey_cell::kRegionShift));
        if (region != Region::none) add_to(region, active, d, x);
        return tick();
      }
    }
    look_closely(xyz, active, d, x, y, xs, ys);
    tick();
  }

  void close() {
    flush();
    out_.near = sum_of_lanes(near_);
    out_.sum_mm = sum_of_lanes(sum_.total);
    out_.sum_mm2 = sum_of_lanes(squares_.total);
    for (std::size_t i = 0; i < shares_.size(); ++i)
      out_.within[i] = i < kAlways ? sum_of_lanes(shares_[i]) : out_.near - sum_of_lanes(shares_[i]);
    for (std::size_t i = 0; i < kLargeFaces; ++i) {
      moments_[i].close(out_.moments[i]);
      out_.points[i] = sum_of_lanes(face_points_[i]);
    }
    for (const Cursor& c : cursors_)
      if (c.piece != PointPool::kNone) pool_.count(c.piece) = static_cast<std::uint32_t>(c.count);
  }

 private:
  static constexpr float kHalfX = 0.5F * static_cast<float>(limits::kFaceTableX);
  static constexpr float kHalfY = 0.5F * static_cast<float>(limits::kFaceTableY);
  /// Thresholds within which points are counted; beyond the others they are, which is rare.
  static constexpr std::size_t kAlways = 5;

  static HWY_INLINE std::size_t cell_of(float x, float y) {
    const auto column = std::min(static_cast<std::size_t>(x + kHalfX), limits::kFaceTableX - 1);
    const auto row = std::min(static_cast<std::size_t>(y + kHalfY), limits::kFaceTableY - 1);
    return row * limits::kFaceTableX + column;
  }

  HWY_INLINE void tick() {
    if (++since_flush_ == kFlush) flush();
  }
  HWY_INLINE void flush() {
    since_flush_ = 0;
    sum_.flush();
    squares_.flush();
    for (TiltedLanes& m : moments_) m.flush();
  }

  HWY_INLINE void add_deviation(const M16& in, const F16& all_r) {
    const F16 one = f16(1.0F);
    const F16 r = keep(in, all_r);
    near_ = near_ + keep(in, one);
    sum_.now = sum_.now + r;
    squares_.now = squares_.now + r * r;
    const F16 a = abs(all_r);
    for (std::size_t i = 0; i < kAlways; ++i) shares_[i] = shares_[i] + keep(in & (a <= f16(task_.share_mm[i])), one);
    if (!any(in & (a > f16(task_.share_mm[kAlways])))) return;
    for (std::size_t i = kAlways; i < shares_.size(); ++i)
      shares_[i] = shares_[i] + keep(in & (a > f16(task_.share_mm[i])), one);
  }

  /// Is it the turn of a lane that is set?
  [[nodiscard]] HWY_INLINE bool map_lane_in(std::uint32_t lanes) {
    map_lane_ = (map_lane_ + 1) % kLanes;
    return (lanes >> map_lane_ & 1U) != 0 && !map_.count.empty();
  }
  HWY_INLINE void add_to_map(const std::array<float, kLanes>& xs, const std::array<float, kLanes>& ys, const F16& r) {
    constexpr std::size_t kCell = limits::kDeviationMapCell_mm;
    alignas(64) std::array<float, kLanes> rs;
    store(r, rs.data());
    const std::size_t cell = cell_of(xs[map_lane_], ys[map_lane_]);
    const std::size_t map_cell =
        cell / limits::kFaceTableX / kCell * (limits::kFaceTableX / kCell) + cell % limits::kFaceTableX / kCell;
    map_.sum_nm[map_cell] += static_cast<std::int64_t>(rs[map_lane_] * 1e6F);
    ++map_.count[map_cell];
  }

  HWY_INLINE void append(PointList list, const M16& in, const F16& u, const F16& v, const F16& h) {
    Cursor& c = cursors_[static_cast<std::size_t>(list)];
    if (c.count + kLanes > PointPool::kPiece && !next_piece(list, c)) return;
    float* to = c.to + c.count;
    store_set(in, u, to);
    store_set(in, v, to + PointPool::kPiece);
    c.count += store_set(in, h, to + 2 * PointPool::kPiece);
  }
  HWY_NOINLINE bool next_piece(PointList list, Cursor& c) {
    const auto l = static_cast<std::size_t>(list);
    if (c.piece != PointPool::kNone) pool_.count(c.piece) = static_cast<std::uint32_t>(c.count);
    const std::uint32_t piece = pool_.take();
    if (piece == PointPool::kNone) return false;
    if (c.piece != PointPool::kNone)
      pool_.next(c.piece) = piece;
    else
      out_.first[l] = piece;
    out_.last[l] = piece;
    c = {pool_.at(piece), 0, piece};
    return true;
  }

  HWY_INLINE void add_to_large(LargeFace face, PointList edge, const M16& in, const F16& u, const F16& v,
                               const F16& h) {
    const auto f = static_cast<std::size_t>(face);
    const F16 r = above(task_.tilt[f], u, v, h);
    const F16 a = abs(r);
    face_points_[f] = face_points_[f] + keep(in, f16(1.0F));
    const M16 inner = in & (a <= f16(task_.inner_mm[f]));
    moments_[f].add(inner, u, v, r);
    const M16 listed = and_not(inner, in & (a <= f16(task_.outer_mm[f])));
    if (any(listed)) append(edge, listed, u, v, r);
  }

  HWY_INLINE void add_to(Region region, const M16& in, const Points16& d, const F16& x) {
    const auto on = [&](Face face) {
      struct OnFace {
        F16 v, h;
      };
      const auto f = static_cast<std::size_t>(face);
      return OnFace{apply(task_.frame.along[f], d), apply(task_.frame.height[f], d)};
    };
    switch (region) {
      case Region::none: return;
      case Region::seat_off: {
        const auto q = on(Face::seat);
        return append(PointList::seat_off, in, x, q.v, q.h);
      }
      case Region::seat_crop: {
        const auto q = on(Face::seat);
        append(PointList::seat_crop, in, x, q.v, q.h);
        return add_to_large(LargeFace::seat, PointList::seat_edge, in, x, q.v, q.h);
      }
      case Region::seat_rest: {
        const auto q = on(Face::seat);
        return add_to_large(LargeFace::seat, PointList::seat_edge, in, x, q.v, q.h);
      }
      case Region::jaw_inner: {
        const auto q = on(Face::jaw_inner);
        return append(PointList::jaw_inner, in, x, q.v, q.h);
      }
      case Region::jaw_outer: {
        const auto q = on(Face::jaw_outer);
        return append(PointList::jaw_outer, in, x, q.v, q.h);
      }
      case Region::top: {
        const auto q = on(Face::top);
        return add_to_large(LargeFace::top, PointList::top_edge, in, x, q.v, q.h);
      }
      case Region::casing_inner: {
        const auto q = on(Face::seat);
        return append(PointList::casing_inner, in, x, q.v, q.h);
      }
      case Region::casing_outer: {
        const auto q = on(Face::seat);
        return append(PointList::casing_outer, in, x, q.v, q.h);
      }
    }
  }

  HWY_NOINLINE void look_closely(const float* xyz, const M16& active, const Points16& d, const F16& x, const F16& y,
                                 const std::array<float, kLanes>& xs, const std::array<float, kLanes>& ys) {
    using namespace survey_cell;
    const F16 column = floor(min(keep(active, x) + f16(kHalfX), f16(2.0F * kHalfX - 1.0F)));
    const F16 row = floor(min(keep(active, y) + f16(kHalfY), f16(2.0F * kHalfY - 1.0F)));
    const I16 cell = to_int(row * f16(2.0F * kHalfX) + column);
    const I16 entry = gather(reinterpret_cast<const std::int32_t*>(task_.table), cell);
    alignas(64) std::array<std::int32_t, kLanes> entries;
    store(entry, entries.data());
    std::uint32_t all = 0;
    for (const std::int32_t e : entries) all |= static_cast<std::uint32_t>(e);

    F16 best = f16(1e9F);
    F16 r = f16(1e9F);
    for (std::uint32_t left = all & kFaceBits; left != 0; left &= left - 1) {
      const auto f = static_cast<std::size_t>(__builtin_ctz(left));
      const F16 here = apply(task_.frame.height[f], d);
      const F16 a = abs(here);
      const M16 closer = active & has_bits(entry, i16(1 << f)) & (a < best);
      best = select(closer, a, best);
      r = select(closer, here, r);
    }
    const M16 near = active & (best < f16(task_.gate_mm));
    if (any(near)) {
      add_deviation(near, r);
      if (map_lane_in(bits(near))) add_to_map(xs, ys, r);
    }

    const M16 known =
        active & (best <= f16(task_.band_mm)) & has_bits(entry, i16(static_cast<std::int32_t>(kRegionBits)));
    std::array<std::uint32_t, kRegions> lanes{};
    const std::uint32_t known_lanes = bits(known);
    if (known_lanes != 0)
      for (std::uint32_t left = (all & kRegionBits) >> kRegionShift; left != 0; left &= left - 1) {
        const auto region = static_cast<unsigned>(__builtin_ctz(left));
        lanes[region] = bits(known & has_bits(entry, i16(static_cast<std::int32_t>(1U << (kRegionShift + region)))));
      }
    for (std::uint32_t left = bits(active) & ~known_lanes; left != 0; left &= left - 1) {
      const int lane = __builtin_ctz(left);
      lanes[task_.ask(task_.ask_context, xyz + 3 * lane)] |= 1U << lane;
    }
    for (std::size_t region = 1; region < kRegions; ++region)
      if (lanes[region] != 0) add_to(static_cast<Region>(region), lanes_of(lanes[region]), d, x);
  }

  const SurveyTask& task_;
  PointPool& pool_;
  const MapSums& map_;
  SurveySums& out_;
  std::array<TiltedLanes, kLargeFaces> moments_;
  std::array<F16, kLargeFaces> face_points_;
  F16 near_;
  LongSum sum_, squares_;
  std::array<F16, 12> shares_;
  std::array<Cursor, kPointLists> cursors_;
  int since_flush_ = 0;
  std::size_t map_lane_ = 0;
};

void survey_lanes(const float* xyz, std::size_t count, std::size_t stride, const SurveyTask& task, PointPool& pool,
                  const MapSums& map, SurveySums& sums) {
  Surveyor surveyor(task, pool, map, sums);
  const std::size_t whole = count / kLanes * kLanes;
  for (std::size_t i = 0; i < whole; i += stride * kLanes) {
    const float* at = xyz + 3 * i;
    surveyor.look_at(at, load_points(at));
  }
  if (whole < count) surveyor.look_at(xyz + 3 * whole, load_points(xyz + 3 * whole, count - whole));
  surveyor.close();
}

TiltedSums tilted_sums_lanes(const SeatPoints* runs, std::size_t count, const Tilt& tilt, float within_mm) {
  TiltedSums out;
  const F16 limit = f16(within_mm);
  const SeatPoints* const end = runs + count;
  for (const SeatPoints* run = runs; run < end; ++run) {
    TiltedLanes lanes;
    lanes.clear();
    int since_flush = 0;
    const std::size_t size = run->size();
    for (std::size_t i = 0; i < size; i += kLanes) {
      F16 u, v, h;
      M16 there;
      if (i + kLanes <= size) {
        u = load(run->x.data() + i);
        v = load(run->s.data() + i);
        h = load(run->h.data() + i);
        there = u == u;
      } else {
        alignas(64) std::array<float, kLanes> rest[3] = {};
        for (std::size_t k = 0; k < size - i; ++k) {
          rest[0][k] = run->x[i + k];
          rest[1][k] = run->s[i + k];
          rest[2][k] = run->h[i + k];
        }
        u = load(rest[0].data());
        v = load(rest[1].data());
        h = load(rest[2].data());
        there = lanes_of((1U << (size - i)) - 1U);
      }
      lanes.add(there & (abs(above(tilt, u, v, h)) <= limit), u, v, h);
      if (++since_flush == kFlush) {
        lanes.flush();
        since_flush = 0;
      }
    }
    lanes.close(out);
  }
  return out;
}

}  // namespace HWY_NAMESPACE
}  // namespace slabd::algo
HWY_AFTER_NAMESPACE();

#if HWY_ONCE

namespace slabd::algo {
HWY_EXPORT(survey_lanes);
HWY_EXPORT(tilted_sums_lanes);

void survey_points(const float* xyz, std::size_t count, std::size_t stride, const SurveyTask& task, PointPool& pool,
                   const MapSums& map, SurveySums& sums) {
  HWY_DYNAMIC_DISPATCH(survey_lanes)(xyz, count, stride, task, pool, map, sums);
}
TiltedSums tilted_sums(std::span<const SeatPoints> runs, const Tilt& tilt, float within_mm) {
  return HWY_DYNAMIC_DISPATCH(tilted_sums_lanes)(runs.data(), runs.size(), tilt, within_mm);
}

}  // namespace slabd::algo

#endif
