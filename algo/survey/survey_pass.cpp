// SPDX-License-Identifier: Apache-2.0
//
// Idea: sixteen consecutive points at a time are moved into the block's frame and assigned to a face and a region.
// Consecutive points are neighbours, so one table lookup is valid for many: its entry contains the distance over which
// face and region are the same. Over such an area the pass sums in registers. It only tests whether a point has left
// the area, or is too far off the face for the table's region to be valid. Near an edge, each of the sixteen gets its
// own face and, if the table does not have it, its region by the rules, still all at once.
//
// Precision: a point minus the shift is exact or nearly so. The distance to a face is a product with the face's normal
// and one subtraction, accurate to 1e-5 mm; a point that close to a border may be on either side of it. Sums are in
// float over at most two times 64 sixteens, then in double.
//
// The lanes, the blocks and the order of the sums are fixed, hence the bits.
#include <bit>
#include <cmath>
#include <limits>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "algo/survey/survey_pass.cpp"
// clang-format off
#include <hwy/foreach_target.h>
#include "algo/lanes-inl.h"
// clang-format on

#include "algo/survey/segmentation.h"
#include "algo/survey/survey_lanes-inl.h"
#include "algo/survey/survey_pass.h"

HWY_BEFORE_NAMESPACE();
namespace slabd::algo {
namespace HWY_NAMESPACE {

/// Number of sixteens between two transfers of the float sums to double, and in a run.
constexpr int kFlush = 64;

HWY_INLINE F16 apply(const Row& row, const Points16& d) {
  return f16(row.a[0]) * d.x + f16(row.a[1]) * d.y + f16(row.a[2]) * d.z + f16(row.b);
}
/// a + b in the set lanes, a in the others.
HWY_INLINE F16 add_where(const M16& mask, const F16& a, const F16& b) {
  return select(mask, a + b, a);
}
HWY_INLINE F16 above(const Tilt& tilt, const F16& u, const F16& v, const F16& h) {
  return h - f16(tilt.a0) - f16(tilt.a1) * u - f16(tilt.a2) * v;
}

/// Float sums of TiltedSums for a few sixteens.
struct TiltedLanes {
  F16 count, u, v, r, uu, uv, ur, vv, vr, rr;
  HWY_INLINE void clear() { count = u = v = r = uu = uv = ur = vv = vr = rr = f16(0.0F); }
  HWY_INLINE void add(const M16& in, const F16& all_u, const F16& all_v, const F16& all_r) {
    const F16 pu = keep(in, all_u);
    const F16 pv = keep(in, all_v);
    const F16 pr = keep(in, all_r);
    count = add_where(in, count, f16(1.0F));
    u = u + pu;
    v = v + pv;
    r = r + pr;
    uu = uu + pu * pu;
    uv = uv + pu * pv;
    ur = ur + pu * pr;
    vv = vv + pv * pv;
    vr = vr + pv * pr;
    rr = rr + pr * pr;
  }
  HWY_INLINE void add(const TiltedLanes& o) {
    count = count + o.count;
    u = u + o.u;
    v = v + o.v;
    r = r + o.r;
    uu = uu + o.uu;
    uv = uv + o.uv;
    ur = ur + o.ur;
    vv = vv + o.vv;
    vr = vr + o.vr;
    rr = rr + o.rr;
  }
};
/// The same in double.
struct TiltedTotals {
  D16 count;
  std::array<D16, 9> sums;
  HWY_INLINE void clear() {
    count = d16(0.0);
    sums.fill(d16(0.0));
  }
  HWY_INLINE void take(TiltedLanes& now) {
    count = count + to_double(now.count);
    const std::array<const F16*, 9> from = {&now.u,  &now.v,  &now.r,  &now.uu, &now.uv,
                                            &now.ur, &now.vv, &now.vr, &now.rr};
    for (std::size_t i = 0; i < sums.size(); ++i) sums[i] = sums[i] + to_double(*from[i]);
    now.clear();
  }
  void close(TiltedSums& out) const {
    out.count += sum_of_lanes(count);
    for (std::size_t i = 0; i < sums.size(); ++i) out.sums[i] += sum_of_lanes(sums[i]);
  }
};

/// Distances to the model: count, sum, squares, and counts within the lower limits.
struct DistanceLanes {
  static constexpr std::size_t kWithin = 5;
  F16 count, sum, squares, within0, within1, within2, within3, within4;
  HWY_INLINE void clear() { count = sum = squares = within0 = within1 = within2 = within3 = within4 = f16(0.0F); }
  /// `distance`: |r|; NaN where `in` is not set.
  HWY_INLINE void add(const M16& in, const F16& all_r, const F16& distance, const float* limits) {
    const F16 one = f16(1.0F);
    const F16 r = keep(in, all_r);
    count = add_where(in, count, one);
    sum = sum + r;
    squares = squares + r * r;
    within0 = add_where(distance <= f16(limits[0]), within0, one);
    within1 = add_where(distance <= f16(limits[1]), within1, one);
    within2 = add_where(distance <= f16(limits[2]), within2, one);
    within3 = add_where(distance <= f16(limits[3]), within3, one);
    within4 = add_where(distance <= f16(limits[4]), within4, one);
  }
  HWY_INLINE void add(const DistanceLanes& o) {
    count = count + o.count;
    sum = sum + o.sum;
    squares = squares + o.squares;
    within0 = within0 + o.within0;
    within1 = within1 + o.within1;
    within2 = within2 + o.within2;
    within3 = within3 + o.within3;
    within4 = within4 + o.within4;
  }
  /// Writes the sums of all lanes.
  void close(std::array<double, 12>& within) const {
    const std::array<const F16*, kWithin> all = {&within0, &within1, &within2, &within3, &within4};
    for (std::size_t i = 0; i < kWithin; ++i) within[i] = sum_of_lanes(*all[i]);
  }
};

/// Write position of a list.
struct Cursor {
  float* to = nullptr;
  std::size_t count = PointPool::kPiece;
  std::uint32_t piece = PointPool::kNone;
};

/// Use of a region's points: face, list, large face or count.
struct RegionUse {
  Face face = Face::seat;
  std::int8_t list = -1;
  std::int8_t large = -1;
  std::int8_t jaw_off = -1;  ///< only counted, for the inner (0) or the outer jaw (1)
};
constexpr std::array<RegionUse, kRegions> region_uses() {
  std::array<RegionUse, kRegions> uses;
  const auto use = [&uses](Region region, Face face, int list, int large) {
    uses[static_cast<std::size_t>(region)] = {face, static_cast<std::int8_t>(list), static_cast<std::int8_t>(large),
                                              -1};
  };
  const auto list = [](PointList l) { return static_cast<int>(l); };
  constexpr int kSeat = static_cast<int>(LargeFace::seat);
  constexpr int kTop = static_cast<int>(LargeFace::top);
  use(Region::seat_off, Face::seat, list(PointList::seat_off), -1);
  use(Region::seat_crop, Face::seat, list(PointList::seat_crop), kSeat);
  use(Region::seat_rest, Face::seat, -1, kSeat);
  use(Region::jaw_inner, Face::jaw_inner, list(PointList::jaw_inner), -1);
  use(Region::jaw_outer, Face::jaw_outer, list(PointList::jaw_outer), -1);
  use(Region::top, Face::top, -1, kTop);
  use(Region::casing_inner, Face::seat, list(PointList::casing_inner), -1);
  use(Region::casing_outer, Face::seat, list(PointList::casing_outer), -1);
  uses[static_cast<std::size_t>(Region::jaw_off_inner)] = {Face::jaw_inner, -1, -1, 0};
  uses[static_cast<std::size_t>(Region::jaw_off_outer)] = {Face::jaw_outer, -1, -1, 1};
  return uses;
}
constexpr std::array<RegionUse, kRegions> kUses = region_uses();
constexpr std::array<PointList, kLargeFaces> kEdges = {PointList::seat_edge, PointList::top_edge};

class Surveyor {
 public:
  Surveyor(const SurveyTask& task, PointPool& pool, const MapSums& map, const SurfaceSums& surface, SurveySums& out)
      : task_(task), pool_(pool), map_(map), surface_(surface), out_(out) {
    out = SurveySums{};
    out.first.fill(PointPool::kNone);
    out.last.fill(PointPool::kNone);
    for (TiltedLanes& t : tilted_) t.clear();
    for (TiltedTotals& t : totals_) t.clear();
    for (F16& c : face_points_) c = f16(0.0F);
    for (F16& c : beyond_) c = f16(0.0F);
    distances_.clear();
    sum_ = squares_ = d16(0.0);
  }

  /// Surveys `count` sixteens, every `stride`-th.
  void survey(const float* xyz, std::size_t count, std::size_t stride) {
    std::size_t i = 0;
    while (i < count) {
      const Points16 d = points_at(xyz + 3 * kLanes * i);
      const F16 x = apply(task_.frame.x, d);
      // False for NaN.
      const M16 in_x = abs(x) < f16(kHalfX);
      if (!any(in_x)) {
        i += stride;
        continue;
      }
      const F16 y = apply(task_.frame.y, d);
      const M16 active = in_x & (abs(y) < f16(kHalfY));
      if (!any(active)) {
        i += stride;
        continue;
      }
      Ground ground;
      const std::size_t first = i;
      if (find_ground(active, x, y, ground)) {
        const std::size_t end = std::min(count, i + static_cast<std::size_t>(kFlush) * stride);
        i = follow(ground, xyz, i, end, stride);
        since_flush_ += static_cast<int>((i - first) / stride);
      }
      if (i == first) {
        look_closely(i, active, d, x, y);
        ++since_flush_;
        i += stride;
      }
      if (since_flush_ >= kFlush) flush();
    }
  }
  /// Surveys fewer than sixteen points.
  void survey_rest(std::size_t number, const float* xyz, std::size_t count) {
    const Points16 d = relative(load_points(xyz, count));
    const F16 x = apply(task_.frame.x, d);
    const F16 y = apply(task_.frame.y, d);
    const M16 active = (abs(x) < f16(kHalfX)) & (abs(y) < f16(kHalfY));
    if (any(active)) look_closely(number, active, d, x, y);
  }

  void close() {
    flush();
    map_.put();
    surface_.flush();
    out_.near = sum_of_lanes(distances_.count);
    out_.sum_mm = sum_of_lanes(sum_);
    out_.sum_mm2 = sum_of_lanes(squares_);
    distances_.close(out_.within);
    for (std::size_t i = 0; i < beyond_.size(); ++i)
      out_.within[DistanceLanes::kWithin + i] = out_.near - sum_of_lanes(beyond_[i]);
    for (std::size_t i = 0; i < kLargeFaces; ++i) {
      totals_[i].close(out_.moments[i]);
      out_.points[i] = sum_of_lanes(face_points_[i]);
    }
    for (const Cursor& c : cursors_)
      if (c.piece != PointPool::kNone) pool_.count(c.piece) = static_cast<std::uint32_t>(c.count);
  }

 private:
  static constexpr float kHalfX = 0.5F * static_cast<float>(limits::kFaceTableX);
  static constexpr float kHalfY = 0.5F * static_cast<float>(limits::kFaceTableY);
  static constexpr float kFarthest = 1e9F;    ///< distance of a point without a face near it ...
  static constexpr float kNoFaceNear = 1e8F;  ///< ... and a bound above all real distances

  /// A rectangle of the block's (x, y) with one face and one region.
  struct Ground {
    std::uint32_t kind = 0;  ///< of the table's entry: face and region
    float middle_x = 0.0F;
    float middle_y = 0.0F;
    float half_x = 0.0F;
    float half_y = 0.0F;
    [[nodiscard]] HWY_INLINE M16 away(const F16& x, const F16& y) const {
      return (abs(x - f16(middle_x)) > f16(half_x)) | (abs(y - f16(middle_y)) > f16(half_y));
    }
    [[nodiscard]] int face() const { return std::countr_zero(kind); }
    [[nodiscard]] std::size_t region() const { return (kind >> survey_cell::kRegionShift) - 1; }
  };

  /// Loads sixteen points and prefetches later ones.
  [[nodiscard]] HWY_INLINE Points16 points_at(const float* xyz) const {
    constexpr std::size_t kAhead = 3 * kLanes * 32;
    fetch_points(xyz + kAhead);
    return relative(load_points(xyz));
  }
  [[nodiscard]] HWY_INLINE Points16 relative(const Points16& p) const {
    const std::array<float, 3>& shift = task_.frame.shift;
    return {p.x - f16(shift[0]), p.y - f16(shift[1]), p.z - f16(shift[2])};
  }

  static HWY_INLINE std::size_t cell_of(float x, float y) {
    const auto column = std::min(static_cast<std::size_t>(x + kHalfX), limits::kFaceTableX - 1);
    const auto row = std::min(static_cast<std::size_t>(y + kHalfY), limits::kFaceTableY - 1);
    return row * limits::kFaceTableX + column;
  }

  /// Finds the ground around one of the points. False if no area is uniform, or it does not cover all sixteen.
  HWY_INLINE bool find_ground(const M16& active, const F16& x, const F16& y, Ground& ground) const {
    alignas(64) std::array<float, kLanes> xs;
    alignas(64) std::array<float, kLanes> ys;
    store(x, xs.data());
    store(y, ys.data());
    constexpr std::uint32_t kMiddle = 8;
    const std::uint32_t lanes = bits(active);
    const auto anchor = (lanes >> kMiddle & 1U) != 0 ? kMiddle : static_cast<std::uint32_t>(std::countr_zero(lanes));
    const std::uint32_t entry = task_.table[cell_of(xs[anchor], ys[anchor])];
    if (entry >> survey_cell::kReachShift[0] == 0) return false;
    const auto reach = [entry](std::size_t direction) {
      return static_cast<float>(survey_cell::kReachCells[entry >> survey_cell::kReachShift[direction] & 0xfU]);
    };
    // The strip along x, else the one along y.
    ground.kind = entry & (survey_cell::kFaceBits | survey_cell::kRegionBits);
    ground.middle_x = xs[anchor] + 0.5F * (reach(1) - reach(0));
    ground.half_x = 0.5F * (reach(1) + reach(0));
    ground.middle_y = ys[anchor];
    ground.half_y = 1.0F;
    if (!any(ground.away(x, y))) return true;
    ground.middle_x = xs[anchor];
    ground.half_x = 1.0F;
    ground.middle_y = ys[anchor] + 0.5F * (reach(3) - reach(2));
    ground.half_y = 0.5F * (reach(3) + reach(2));
    return !any(ground.away(x, y));
  }

  /// Processes a run of sixteens on one kind of ground while no point is off its face by more than the band: everything
  /// is summed in registers. Returns the sixteen after the run.
  HWY_INLINE std::size_t follow(Ground& ground, const float* xyz, std::size_t i, std::size_t end, std::size_t stride) {
    const RegionUse& use = kUses[ground.region()];
    if (use.large < 0 && use.list < 0) return follow<false, false>(ground, use, xyz, i, end, stride);
    if (use.large < 0) return follow<true, false>(ground, use, xyz, i, end, stride);
    if (ground.face() != static_cast<int>(use.face)) return i;
    if (use.list < 0) return follow<false, true>(ground, use, xyz, i, end, stride);
    return follow<true, true>(ground, use, xyz, i, end, stride);
  }
  template <bool kListed, bool kLarge>
  HWY_NOINLINE std::size_t follow(Ground& ground, const RegionUse& use, const float* xyz, std::size_t i,
                                  std::size_t end, std::size_t stride) {
    const Row& height = task_.frame.height[static_cast<std::size_t>(ground.face())];
    const auto face = static_cast<std::size_t>(use.face);
    const auto large = static_cast<std::size_t>(kLarge ? use.large : 0);
    // Beyond this distance a point needs more than summing.
    const F16 rare = f16(std::min(task_.share_mm[DistanceLanes::kWithin], task_.band_mm));
    const bool on_block = ground.face() != static_cast<int>(Face::top);
    std::array<std::size_t, kFlush + 1> special;
    std::size_t specials = 0;
    DistanceLanes distances;
    TiltedLanes tilted;
    distances.clear();
    tilted.clear();
    for (; i < end; i += stride) {
      const Points16 d = points_at(xyz + 3 * kLanes * i);
      const F16 x = apply(task_.frame.x, d);
      const F16 y = apply(task_.frame.y, d);
      const F16 r = apply(height, d);
      const F16 distance = abs(r);
      // A missing point is NaN everywhere: neither away nor off.
      const M16 in = r == r;
      if (any(ground.away(x, y)) && !walk_on(in, x, y, ground)) break;
      // The table's region is valid for points near the face only.
      if (any(distance > f16(task_.band_mm))) break;
      M16 rarely = distance > rare;
      if constexpr (kLarge) {
        const F16 v = apply(task_.frame.along[face], d);
        const F16 off = above(task_.tilt[large], x, v, r);
        const F16 size = abs(off);
        const M16 inner = size <= f16(task_.inner_mm[large]);
        rarely = rarely | and_not(inner, size <= f16(task_.outer_mm[large]));
        tilted.add(inner, x, v, off);
        if constexpr (kListed) append(static_cast<PointList>(use.list), in, x, v, r);
      } else if constexpr (kListed) {
        append(static_cast<PointList>(use.list), in, x, apply(task_.frame.along[face], d),
               apply(task_.frame.height[face], d));
      }
      // Without a branch, because it would be unpredictable.
      special[specials] = i;
      specials += static_cast<std::size_t>(any(rarely));
      distances.add(in, r, distance, task_.share_mm.data());
      map_.take(x, y, r);
      if (on_block) surface_.take(i, x, y, r);
    }
    distances_.add(distances);
    if constexpr (kLarge) {
      tilted_[large].add(tilted);
      face_points_[large] = face_points_[large] + distances.count;
    }
    for (std::size_t k = 0; k < specials; ++k) {
      const Points16 d = points_at(xyz + 3 * kLanes * special[k]);
      const F16 r = apply(height, d);
      count_beyond(r == r, abs(r));
      if constexpr (kLarge) {
        const F16 x = apply(task_.frame.x, d);
        const F16 v = apply(task_.frame.along[face], d);
        const F16 off = above(task_.tilt[large], x, v, r);
        const F16 size = abs(off);
        const M16 listed = and_not(size <= f16(task_.inner_mm[large]), size <= f16(task_.outer_mm[large]));
        if (any(listed)) append(kEdges[large], listed, x, v, off);
      }
    }
    return i;
  }
  /// Moves on to ground of the same kind under these points.
  HWY_INLINE bool walk_on(const M16& there, const F16& x, const F16& y, Ground& ground) const {
    const M16 active = there & (abs(x) < f16(kHalfX)) & (abs(y) < f16(kHalfY));
    Ground next;
    if (!any(active) || !find_ground(active, x, y, next) || next.kind != ground.kind) return false;
    ground = next;
    return true;
  }

  void flush() {
    since_flush_ = 0;
    sum_ = sum_ + to_double(distances_.sum);
    squares_ = squares_ + to_double(distances_.squares);
    distances_.sum = distances_.squares = f16(0.0F);
    for (std::size_t i = 0; i < kLargeFaces; ++i) totals_[i].take(tilted_[i]);
  }

  /// Counts points beyond the upper limits, which are few.
  HWY_NOINLINE void count_beyond(const M16& in, const F16& distance) {
    for (std::size_t i = 0; i < beyond_.size(); ++i)
      beyond_[i] = beyond_[i] + keep(in & (distance > f16(task_.share_mm[DistanceLanes::kWithin + i])), f16(1.0F));
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

  /// Processes sixteen points over mixed ground: each separately, but all at once.
  HWY_NOINLINE void look_closely(std::size_t number, const M16& active, const Points16& d, const F16& x, const F16& y) {
    using namespace survey_cell;
    const F16 column = floor(min(keep(active, x) + f16(kHalfX), f16(2.0F * kHalfX - 1.0F)));
    const F16 row = floor(min(keep(active, y) + f16(kHalfY), f16(2.0F * kHalfY - 1.0F)));
    const I16 cell = to_int(row * f16(2.0F * kHalfX) + column);
    // A point outside the table or a missing one has no face or region.
    const I16 entry = keep_int(active, gather(reinterpret_cast<const std::int32_t*>(task_.table), cell));
    // The faces near any of the points, and above them a bit for each region; bit 0 of those: unknown.
    const I16 code = bit_and(shift_right<kRegionShift>(entry), i16(kRegionBits >> kRegionShift));
    const std::uint32_t all =
        any_bits(bit_or(bit_and(entry, i16(kFaceBits)), shift_left(i16(1 << kRegionShift), code)));

    F16 best = f16(kFarthest);
    F16 r = f16(kFarthest);
    for (std::uint32_t left = all & kFaceBits; left != 0; left &= left - 1) {
      const auto f = static_cast<std::size_t>(std::countr_zero(left));
      const F16 here = apply(task_.frame.height[f], d);
      const F16 a = abs(here);
      const M16 closer = active & has_bits(entry, i16(1 << f)) & (a < best);
      best = select(closer, a, best);
      r = select(closer, here, r);
    }
    const M16 near = active & (best < f16(task_.gate_mm));
    if (any(near)) {
      const F16 none = f16(std::numeric_limits<float>::quiet_NaN());
      const F16 distance = select(near, best, none);
      distances_.add(near, r, distance, task_.share_mm.data());
      if (any(distance > f16(task_.share_mm[DistanceLanes::kWithin]))) count_beyond(near, distance);
      map_.take(x, y, select(near, r, none));
    }
    // Includes points further off than the gate: the remainder of a broken corner.
    const M16 of_a_face = active & (best < f16(kNoFaceNear));
    if (any(of_a_face)) surface_.take(number, x, y, select(of_a_face, r, f16(std::numeric_limits<float>::quiet_NaN())));

    // By region, so that each list stays in the order of the scan.
    const M16 close = active & (best <= f16(task_.band_mm));
    std::array<std::uint32_t, kRegions> lanes{};
    constexpr std::uint32_t kNothing = 1U << static_cast<unsigned>(Region::none);
    std::uint32_t regions = all >> (kRegionShift + 1) & ~kNothing;
    for (std::uint32_t left = regions; left != 0; left &= left - 1) {
      const auto region = static_cast<std::size_t>(std::countr_zero(left));
      lanes[region] = bits(close & is_zero(bit_xor(code, i16(static_cast<std::int32_t>(region + 1)))));
    }
    const std::uint32_t unknown = bits(active) & ~bits(and_not(is_zero(code), close));
    if (unknown != 0) regions |= apply_rules(lanes_of(unknown), d, x, lanes);
    for (std::uint32_t left = regions; left != 0; left &= left - 1) {
      const auto region = static_cast<std::size_t>(std::countr_zero(left));
      const RegionUse& use = kUses[region];
      if (lanes[region] == 0) continue;
      if (use.list >= 0 || use.large >= 0) add_to(use, lanes_of(lanes[region]), d, x);
      if (use.jaw_off >= 0) count_off(use, lanes[region], d, x);
    }
  }

  /// RegionRules::region_of, line by line, with float rounding (1e-5 mm). Returns a bit for each region found.
  HWY_NOINLINE std::uint32_t apply_rules(const M16& asked, const Points16& d, const F16& x,
                                         std::array<std::uint32_t, kRegions>& lanes) const {
    const RegionNumbers& n = task_.rules;
    std::array<F16, kFaces> distance;
    for (std::size_t f = 0; f < kFaces; ++f) distance[f] = apply(task_.frame.height[f], d);
    const auto to = [&](Face f) -> const F16& { return distance[static_cast<std::size_t>(f)]; };
    const auto number = [](double value) { return f16(static_cast<float>(value)); };
    const auto beside = [&](const EdgeRule& e) { return number(e.sign) * to(e.edge) >= number(e.least); };
    const auto holds = [&](const FaceRule& rule) {
      M16 all = abs(to(rule.face)) <= number(n.gate);
      for (const EdgeRule& e : rule.edges) all = all & beside(e);
      return all;
    };
    const F16 s = apply(task_.frame.along[static_cast<std::size_t>(Face::seat)], d);
    const F16 casing_s = abs(s) - number(n.casing_s);
    const F16 radius2 = x * x + casing_s * casing_s;
    const M16 in_casing = radius2 < number(n.casing_clear * n.casing_clear);
    const M16 on_seat = holds(n.seat);
    M16 left = asked;
    std::uint32_t regions = 0;
    const auto found = [&](Region region, const M16& in) {
      const std::uint32_t there = bits(in);
      lanes[static_cast<std::size_t>(region)] |= there;
      regions |= static_cast<std::uint32_t>(there != 0) << static_cast<unsigned>(region);
    };
    const auto take = [&](const M16& which) {
      const M16 taken = left & which;
      left = and_not(which, left);
      return taken;
    };
    const M16 crop = take(and_not(in_casing, (abs(x) <= number(n.crop_half_x)) & (abs(s) <= number(n.crop_half_s))));
    found(Region::seat_crop, crop & on_seat);
    found(Region::seat_off, and_not(on_seat, crop));
    const M16 rim = take(radius2 <= number(n.casing_reach * n.casing_reach));
    const M16 outer = s > f16(0.0F);
    found(Region::casing_outer, rim & outer);
    found(Region::casing_inner, and_not(outer, rim));
    const M16 low = take(abs(to(Face::top)) <= number(n.gate));
    M16 clear_of_block = beside(n.around_block[0]);
    for (const EdgeRule& e : n.around_block) clear_of_block = clear_of_block | beside(e);
    found(Region::top, low & clear_of_block);
    take(in_casing);
    found(Region::seat_rest, take(on_seat));
    found(Region::jaw_inner, take(and_not(outer, holds(n.jaw_inner))));
    found(Region::jaw_outer, take(outer & holds(n.jaw_outer)));
    if (!any(left)) return regions;
    const auto stands_over = [&](const FaceRule& rule) {
      const F16& off = to(rule.face);
      const F16 size = abs(off);
      M16 near = size <= number(n.depth);
      M16 above = size > number(n.gate);
      for (const EdgeRule& e : rule.edges) {
        const F16 edge = to(e.edge);
        near = near & (number(e.sign) * (edge - number(e.per_off) * off) >= number(e.least));
        above = above & (number(e.sign) * (edge - number(e.per_height) * off) >= number(e.least));
      }
      return (size > number(n.gate)) & (near | above);
    };
    found(Region::jaw_off_inner, take(stands_over(n.jaw_inner)));
    found(Region::jaw_off_outer, take(stands_over(n.jaw_outer)));
    return regions;
  }

  /// Counts points at the place of a jaw, one by one, because they are few.
  HWY_NOINLINE void count_off(const RegionUse& use, std::uint32_t lanes, const Points16& d, const F16& x) {
    alignas(64) std::array<float, kLanes> u;
    alignas(64) std::array<float, kLanes> v;
    store(x, u.data());
    store(apply(task_.frame.along[static_cast<std::size_t>(use.face)], d), v.data());
    const auto jaw = static_cast<std::size_t>(static_cast<unsigned char>(use.jaw_off));
    for (; lanes != 0; lanes &= lanes - 1) {
      const auto lane = static_cast<std::size_t>(std::countr_zero(lanes));
      ++out_.jaw_off[jaw][task_.jaw[jaw].place_of(u[lane], v[lane])];
    }
  }

  HWY_NOINLINE void add_to(const RegionUse& use, const M16& in, const Points16& d, const F16& x) {
    const auto face = static_cast<std::size_t>(use.face);
    const F16 v = apply(task_.frame.along[face], d);
    const F16 h = apply(task_.frame.height[face], d);
    if (use.list >= 0) append(static_cast<PointList>(use.list), in, x, v, h);
    if (use.large < 0) return;
    const auto large = static_cast<std::size_t>(static_cast<unsigned char>(use.large));
    const F16 off = above(task_.tilt[large], x, v, h);
    const F16 size = abs(off);
    face_points_[large] = face_points_[large] + keep(in, f16(1.0F));
    const M16 inner = in & (size <= f16(task_.inner_mm[large]));
    tilted_[large].add(inner, x, v, off);
    const M16 listed = and_not(inner, in & (size <= f16(task_.outer_mm[large])));
    if (any(listed)) append(kEdges[large], listed, x, v, off);
  }

  const SurveyTask& task_;
  PointPool& pool_;
  MapLanes map_;
  SurfaceLanes surface_;
  SurveySums& out_;
  DistanceLanes distances_;
  std::array<F16, 12 - DistanceLanes::kWithin> beyond_;
  D16 sum_, squares_;
  std::array<TiltedLanes, kLargeFaces> tilted_;
  std::array<TiltedTotals, kLargeFaces> totals_;
  std::array<F16, kLargeFaces> face_points_;
  std::array<Cursor, kPointLists> cursors_;
  int since_flush_ = 0;
};

void survey_lanes(const float* xyz, std::size_t count, std::size_t stride, const SurveyTask& task, PointPool& pool,
                  const MapSums& map, const SurfaceSums& surface, SurveySums& sums) {
  Surveyor surveyor(task, pool, map, surface, sums);
  const std::size_t whole = count / kLanes;
  surveyor.survey(xyz, whole, stride);
  if (count % kLanes != 0) surveyor.survey_rest(whole, xyz + 3 * kLanes * whole, count % kLanes);
  surveyor.close();
}

}  // namespace HWY_NAMESPACE
}  // namespace slabd::algo
HWY_AFTER_NAMESPACE();

#if HWY_ONCE

namespace slabd::algo {
HWY_EXPORT(survey_lanes);

void survey_points(const float* xyz, std::size_t count, std::size_t stride, const SurveyTask& task, PointPool& pool,
                   const MapSums& map, const SurfaceSums& surface, SurveySums& sums) {
  HWY_DYNAMIC_DISPATCH(survey_lanes)(xyz, count, stride, task, pool, map, surface, sums);
}

}  // namespace slabd::algo

#endif
