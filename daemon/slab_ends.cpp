// SPDX-License-Identifier: Apache-2.0
//
// Problem: P4856 and P4925 have the same seats; the slabs are 4856 and 4925 mm long. The slab's end is visible only in
// the scans of the outermost blocks, and only if the scanner's field of view reaches that far.
//
// Idea: compute a profile of the slab top along the rail. The top is followed from the block outwards, in steps of 2
// mm, to its end. That is the slab's end if there are points beyond it, lower or after a gap. Otherwise it may be the
// edge of the field of view. Then the scans of inner blocks, where the top continues, prove that the field of view
// reaches further.
//
// A good slab must never be refused. An end counts for another type only within kEnd_mm of that type's end, and never
// within kEnd_mm of the slab's own.
#include "daemon/slab_ends.h"

#include <algorithm>
#include <cmath>
#include <utility>

#include "base/items.h"

namespace slabd::daemon {
namespace {

// Types whose values differ by less give the same items.
constexpr double kSameLength_mm = 1.0;
constexpr double kSame_rad = 0.5 * kPi / 180.0;
constexpr double kSameCant = 1.0;
// A face that is not part of any item may differ by this much and is still registered.
constexpr double kSameFace_mm = 3.0;

/// Length tolerance of a slab, chamfer or broken edge, and the steps of the profile.
constexpr double kEnd_mm = 8.0;
/// Ends that are closer than this cannot be distinguished.
constexpr double kEndsDiffer_mm = 20.0;
/// The field of view must reach this far beyond an end before missing points prove it.
constexpr double kBeyond_mm = 16.0;
constexpr double kTurnedMax = 0.985;  // cosine of 10 degrees

// The profile.
constexpr std::size_t kLooked = 600'000;
constexpr double kStep_mm = 2.0;
constexpr std::size_t kSteps = 544;       // to 1.09 m beyond the block: first_pair_from_end_mm is 1000 at most
constexpr double kFromBlock_mm = 10.0;    // beyond the foot of the end face
constexpr double kAcross = 0.8;           // of the block's half width
constexpr double kTop_mm = 5.0;           // slab top, above or below its nominal height
constexpr double kLower_mm = 20.0;        // points this far below are not slab top
constexpr double kCoveredShare = 0.2;     // of the points of a usual step
constexpr std::uint32_t kCoveredMin = 3;  // points
constexpr std::size_t kGapSteps = 2;
constexpr std::size_t kGoesOnSteps = 5;

struct Profile {
  std::array<std::uint32_t, kSteps> top{};
  std::array<std::uint32_t, kSteps> lower{};
};

/// Points of a usual step: median of the covered steps in the first 25 mm, where every slab has top.
double usual_points(const Profile& profile) {
  std::array<std::uint32_t, 12> first{};
  std::copy_n(profile.top.begin(), first.size(), first.begin());
  std::sort(first.begin(), first.end());
  return static_cast<double>(first[first.size() / 2]);
}

void follow(const Profile& profile, double from_mm, std::size_t side, TopView& view) {
  const double enough = std::max(static_cast<double>(kCoveredMin), kCoveredShare * usual_points(profile));
  const auto covered = [&](std::uint32_t count) { return static_cast<double>(count) >= enough; };
  std::size_t end = 0;
  for (std::size_t i = 0; i < kSteps && i <= end + kGapSteps; ++i)
    if (covered(profile.top[i])) end = i + 1;
  if (end == 0) return;
  std::size_t last = end;
  std::size_t beyond = 0;
  for (std::size_t i = end; i < kSteps; ++i) {
    if (covered(profile.top[i])) last = i + 1;
    if (covered(profile.top[i] + profile.lower[i])) ++beyond;
  }
  view.reach_mm[side] = from_mm + kStep_mm * static_cast<double>(end);
  view.last_mm[side] = from_mm + kStep_mm * static_cast<double>(last);
  view.goes_on[side] = beyond >= kGoesOnSteps;
}

/// Distance from the block's origin to the slab's end next to it; NaN if another block comes first. `side`: 0 towards
/// -x of the block, 1 towards +x.
double end_beside_mm(const Recipe& recipe, int station, std::size_t side) {
  const SlabGeometry& slab = recipe.slab;
  const int pairs = slab.pairs;
  const bool left = station <= pairs;
  const int column = left ? station - 1 : 2 * pairs - station;
  // Blocks of the other row are turned by 180 degrees.
  const bool towards_low = left == (side == 0);
  if (towards_low && column == 0) return slab.first_pair_from_end_mm.value;
  if (!towards_low && column == pairs - 1)
    return slab.length_mm.value - slab.first_pair_from_end_mm.value - slab.pitch_mm.value * (pairs - 1);
  return kNoValue;
}

std::array<double, 2> ends_mm(const Recipe& recipe) {
  return {end_beside_mm(recipe, 1, 0), end_beside_mm(recipe, recipe.slab.pairs, 1)};
}

bool near(const Nominal& a, const Nominal& b, double tolerance) {
  return std::abs(a.value - b.value) <= tolerance;
}

bool same_seats(const Recipe& a, const Recipe& b) {
  const BlockGeometry& x = a.block;
  const BlockGeometry& y = b.block;
  const double window_mm = std::min(a.evaluation.window_mm, b.evaluation.window_mm);
  return a.slab.pairs == b.slab.pairs && near(a.slab.pitch_mm, b.slab.pitch_mm, kSameLength_mm) &&
         near(a.slab.seat_centre_distance_mm, b.slab.seat_centre_distance_mm, kSameLength_mm) &&
         std::abs(T_slab_block(a, 1).translation_mm.x() - T_slab_block(b, 1).translation_mm.x()) < window_mm &&
         near(x.cant_ratio, y.cant_ratio, kSameCant) &&
         near(x.jaw_half_distance_mm, y.jaw_half_distance_mm, kSameLength_mm) &&
         near(x.jaw_reference_height_mm, y.jaw_reference_height_mm, kSameLength_mm) &&
         near(x.jaw_angle_rad, y.jaw_angle_rad, kSame_rad) && near(x.draft_rad, y.draft_rad, 4.0 * kSame_rad) &&
         near(x.shoulder_outer_z_mm, y.shoulder_outer_z_mm, kSameFace_mm) &&
         near(x.shoulder_inner_z_mm, y.shoulder_inner_z_mm, kSameFace_mm) &&
         near(x.end_half_length_mm, y.end_half_length_mm, kSameFace_mm) &&
         near(x.side_half_width_mm, y.side_half_width_mm, kSameFace_mm) &&
         near(x.slab_top_z_mm, y.slab_top_z_mm, kSameFace_mm) &&
         near(x.casing_half_spacing_mm, y.casing_half_spacing_mm, kSameLength_mm) &&
         near(x.casing_bore_diameter_mm, y.casing_bore_diameter_mm, kSameLength_mm) &&
         near(x.casing_rim_diameter_mm, y.casing_rim_diameter_mm, kSameLength_mm) &&
         near(x.casing_rim_height_mm, y.casing_rim_height_mm, kSameLength_mm);
}

bool ends_differ(const Recipe& a, const Recipe& b) {
  const std::array<double, 2> x = ends_mm(a);
  const std::array<double, 2> y = ends_mm(b);
  return std::abs(x[0] - y[0]) >= kEndsDiffer_mm || std::abs(x[1] - y[1]) >= kEndsDiffer_mm;
}

}  // namespace

std::vector<AlikeRecipes> alike_recipes(std::span<const Recipe> recipes) {
  std::vector<AlikeRecipes> alike;
  for (const Recipe& a : recipes)
    for (const Recipe& b : recipes)
      if (a.slab_type < b.slab_type && same_seats(a, b)) alike.push_back({&a, &b, ends_differ(a, b)});
  std::sort(alike.begin(), alike.end(), [](const AlikeRecipes& x, const AlikeRecipes& y) {
    return std::pair(x.a->slab_type, x.b->slab_type) < std::pair(y.a->slab_type, y.b->slab_type);
  });
  return alike;
}

FixedString<limits::kErrorTextBytes> text_of(const AlikeRecipes& alike) {
  FixedString<limits::kErrorTextBytes> text;
  const std::array<double, 2> a = ends_mm(*alike.a);
  const std::array<double, 2> b = ends_mm(*alike.b);
  if (alike.ends_differ) {
    const std::size_t side = std::abs(a[0] - b[0]) >= std::abs(a[1] - b[1]) ? 0 : 1;
    text.printf(
        "%s and %s have the same blocks and differ only in the slab's ends (%g and %g mm from the outermost block): "
        "scans that do not reach %g mm cannot tell them apart, and a slab begun under the wrong type is not noticed",
        alike.a->name.c_str(), alike.b->name.c_str(), a[side], b[side], std::min(a[side], b[side]) + kBeyond_mm);
  } else {
    text.printf(
        "%s and %s have the same blocks and slab ends: no scan distinguishes them, and a slab begun under the wrong "
        "type "
        "is not noticed",
        alike.a->name.c_str(), alike.b->name.c_str());
  }
  return text;
}

TopView look_at_top(std::span<const float> xyz, const Pose& T_block_scanner, const BlockGeometry& block) {
  TopView view;
  const std::size_t points = xyz.size() / 3;
  const Mat3 R = T_block_scanner.rotation.toRotationMatrix();
  const Vec3 t = T_block_scanner.translation_mm;
  const double top = block.slab_top_z_mm.value;
  const Vec3 axis = R.col(2);
  view.seen = true;
  view.turned = R.col(0);
  view.distance_mm = std::abs(axis.z()) > 0.1 ? (top - t.z()) / axis.z() : 0.0;
  view.axis_x_mm = t.x() + view.distance_mm * axis.x();

  const double from_mm =
      block.end_half_length_mm.value + std::tan(block.draft_rad.value) * std::abs(top) + kFromBlock_mm;
  const double across_mm = kAcross * block.side_half_width_mm.value;
  std::array<Profile, 2> profiles;
  // Odd, so that it meets all columns of most grids; with this many points each step holds hundreds in any case.
  const std::size_t stride = std::max<std::size_t>(1, points / kLooked) | 1U;
  for (std::size_t i = 0; i < points; i += stride) {
    const float* p = xyz.data() + 3 * i;
    if (!std::isfinite(p[0]) || !std::isfinite(p[1]) || !std::isfinite(p[2])) continue;
    const Vec3 q = R * Vec3(double{p[0]}, double{p[1]}, double{p[2]}) + t;
    const double beyond = std::abs(q.x()) - from_mm;
    if (!(beyond >= 0.0) || !(beyond < kStep_mm * static_cast<double>(kSteps)) || !(std::abs(q.y()) <= across_mm))
      continue;
    Profile& profile = profiles[q.x() < 0.0 ? 0 : 1];
    const auto step = static_cast<std::size_t>(beyond / kStep_mm);
    if (std::abs(q.z() - top) <= kTop_mm)
      ++profile.top[step];
    else if (q.z() < top - kLower_mm)
      ++profile.lower[step];
  }
  for (std::size_t side = 0; side < 2; ++side) follow(profiles[side], from_mm, side, view);
  return view;
}

void SlabEnds::use(std::span<const Recipe> recipes, const Recipe& recipe) {
  recipe_ = &recipe;
  rivals_.clear();
  views_ = {};
  slab_key_ = 0;
  for (const Recipe& other : recipes)
    if (other.slab_type != recipe.slab_type && same_seats(recipe, other) && ends_differ(recipe, other) &&
        !rivals_.full())
      (void)rivals_.push(&other);
}

/// True if the scan of this station would have shown the slab top beyond `other_mm`. Proved by its own points, or by
/// the width that the scanner sees next to the inner blocks of the same row.
bool SlabEnds::end_was_proven(int station, std::size_t side, double other_mm) const {
  const TopView& view = views_[static_cast<std::size_t>(station - 1)];
  if (view.goes_on[side]) return true;
  constexpr int kInnerMin = 2;
  const int pairs = recipe_->slab.pairs;
  const int first = station <= pairs ? 1 : pairs + 1;
  const double sign = side == 0 ? -1.0 : 1.0;
  int inner = 0;
  double least = 1e300;  // half width of the field on this side, divided by the distance
  for (int k = first; k < first + pairs; ++k) {
    const TopView& other = views_[static_cast<std::size_t>(k - 1)];
    if (!other.seen || has_value(end_beside_mm(*recipe_, k, side)) || !(other.reach_mm[side] > 0.0)) continue;
    if (!(other.turned.dot(view.turned) >= kTurnedMax) || !(other.distance_mm > 0.0)) continue;
    ++inner;
    least = std::min(least, (other.reach_mm[side] - sign * other.axis_x_mm) / other.distance_mm);
  }
  return inner >= kInnerMin && sign * view.axis_x_mm + least * view.distance_mm >= other_mm + kBeyond_mm;
}

SlabEnds::Finding SlabEnds::note(std::int64_t slab_key, int station, const TopView& view) {
  if (slab_key != slab_key_) views_ = {};
  slab_key_ = slab_key;
  views_[static_cast<std::size_t>(station - 1)] = view;
  for (int k = 1; k <= recipe_->stations(); ++k) {
    const TopView& seen = views_[static_cast<std::size_t>(k - 1)];
    for (std::size_t side = 0; side < 2; ++side) {
      const double own_mm = end_beside_mm(*recipe_, k, side);
      const double reach_mm = seen.reach_mm[side];
      if (!seen.seen || !has_value(own_mm) || !(reach_mm > 0.0)) continue;
      // An object may be on the slab before its end.
      if (std::abs(reach_mm - own_mm) <= kEnd_mm || std::abs(seen.last_mm[side] - own_mm) <= kEnd_mm) continue;
      for (const Recipe* other : rivals_) {
        const double other_mm = end_beside_mm(*other, k, side);
        if (!(std::abs(other_mm - own_mm) >= kEndsDiffer_mm)) continue;
        const bool is_its_end = std::abs(reach_mm - other_mm) <= kEnd_mm && end_was_proven(k, side, other_mm);
        const bool goes_on = reach_mm > own_mm + kEnd_mm && reach_mm <= other_mm + kEnd_mm;
        if (is_its_end || goes_on) return {other, k, reach_mm, own_mm, other_mm, !is_its_end};
      }
    }
  }
  return {};
}

double SlabEnds::blind_reach_mm() const {
  double furthest = 0.0;
  for (int k = 1; k <= recipe_->stations(); ++k) {
    const TopView& seen = views_[static_cast<std::size_t>(k - 1)];
    if (!seen.seen) return kNoValue;
    for (std::size_t side = 0; side < 2; ++side) {
      const double own_mm = end_beside_mm(*recipe_, k, side);
      if (!has_value(own_mm)) continue;
      if (std::abs(seen.reach_mm[side] - own_mm) <= kEnd_mm) return kNoValue;
      furthest = std::max(furthest, seen.reach_mm[side]);
    }
  }
  return furthest;
}

FixedString<limits::kErrorTextBytes> text_of(const SlabEnds::Finding& finding, const Recipe& own) {
  FixedString<limits::kErrorTextBytes> text;
  text.printf(
      "the slab was begun as type %u (%s), but %s %.0f mm beyond the block of station %d, as on type %u (%s, %.1f mm) "
      "and not at %.1f mm: is SLAB_TYPE right?",
      unsigned{own.slab_type}, own.name.c_str(),
      finding.top_goes_on ? "its top continues for at least" : "its top ends", finding.seen_mm, finding.station,
      unsigned{finding.other->slab_type}, finding.other->name.c_str(), finding.other_mm, finding.own_mm);
  return text;
}

}  // namespace slabd::daemon
