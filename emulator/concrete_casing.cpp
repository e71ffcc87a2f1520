// SPDX-License-Identifier: Apache-2.0
//
// The casings' rims and the content of their bores.
#include <algorithm>
#include <cmath>

#include "emulator/concrete_block.h"
#include "emulator/slab_scene.h"

namespace slabd::emulator {
namespace {

constexpr double kRimTilt_deg = 0.15;
constexpr double kRimEdge_mm = 0.4;
constexpr double kSlurryShare = 0.15;
constexpr double kSlurryMin_mm = 0.10;
constexpr double kSlurryMax_mm = 0.35;
constexpr double kDropShare = 0.15;
constexpr double kPlugDiameter_mm = 29.0;
constexpr double kPlugDepth_mm = 2.0;
constexpr double kCapDiameter_mm = 40.0;
constexpr double kCapHeight_mm = 2.0;
constexpr double kSandMin_mm = 4.0;
constexpr double kSandMax_mm = 10.0;
constexpr double kWater_mm = 3.0;
constexpr double kThread_mm = 10.0;
constexpr double kClump_mm = 3.0;

/// Value that `share` of the values exceed.
double exceeded_by(std::vector<double> values, double share) {
  if (values.empty()) return 0.0;
  const auto n =
      static_cast<std::ptrdiff_t>(std::clamp(1.0 - share, 0.0, 1.0) * static_cast<double>(values.size() - 1));
  std::nth_element(values.begin(), values.begin() + n, values.end());
  return values[static_cast<std::size_t>(n)];
}

}  // namespace

bool ConcreteBlock::over_rim(double x, double y, double margin_mm) const {
  const double reach = 0.5 * recipe_.block.casing_rim_diameter_mm.value + margin_mm;
  for (const Bore& bore : bores_)
    if (std::hypot(x - bore.centre.x(), y - bore.centre.y()) < reach) return true;
  return false;
}

void ConcreteBlock::set_rims() {
  const BlockTruth& truth = truth_.block;
  const double slope = truth.slope_rad;
  for (std::size_t side = 0; side < 2; ++side) {
    Bore& bore = bores_[side];
    const double s = (side == 0 ? -0.5 : 0.5) * truth.casing_spacing_mm;
    const double h = side == 0 ? truth.protrusion_inner_mm : truth.protrusion_outer_mm;
    const double x = bore.centre.x();
    bore.centre = Vec3(x, s * std::cos(slope) - h * std::sin(slope), s * std::sin(slope) + h * std::cos(slope));
    bore.centre.z() += seat_per_x_ * x;
    bore.radius_mm = 0.5 * recipe_.block.casing_bore_diameter_mm.value;
  }
  truth_.casing_spacing_mm = std::hypot(truth.casing_spacing_mm, bores_[1].centre.x() - bores_[0].centre.x());
  for (std::size_t side = 0; side < 2; ++side) {
    set_rim(side);
    fill_bore(side);
  }
}

void ConcreteBlock::set_rim(std::size_t side) {
  Bore& bore = bores_[side];
  Prng random(seed_of(Effect::rim_tilt, side));
  const double turn = 2.0 * kPi * random.uniform();
  const double tilt = std::tan(rad_from_deg(kRimTilt_deg * strength(Effect::rim_tilt)));
  const double per_x = seat_per_x_ + tilt * std::cos(turn);
  const double per_y = seat_per_y_ + tilt * std::sin(turn);
  bore.axis = Vec3(-per_x, -per_y, 1.0).normalized();
  const double rim_radius = 0.5 * recipe_.block.casing_rim_diameter_mm.value;
  const double edge = kRimEdge_mm * strength(Effect::rim_edge);
  bore.chamfer_mm = edge;
  const HeightField::Window w = field_.window(bore.centre.x(), bore.centre.y(), rim_radius + 1.0);
  for (std::size_t row = w.row_from; row < w.row_to; ++row)
    for (std::size_t column = w.column_from; column < w.column_to; ++column) {
      const double dx = field_.x_mm(column) - bore.centre.x();
      const double dy = field_.y_mm(row) - bore.centre.y();
      const double z = bore.centre.z() + per_x * dx + per_y * dy;
      // Distance in the rim's plane, where the rim is a circle.
      const double r = Vec3(dx, dy, per_x * dx + per_y * dy).norm();
      if (r >= rim_radius) continue;
      const std::size_t node = field_.index(column, row);
      // The height field continues over the bore, as deep as the rim's chamfer: the scan uses the exact circle there.
      field_.z(node) = static_cast<float>(z - std::clamp(bore.radius_mm + edge - r, 0.0, edge));
      face_[node] = side == 0 ? ConcreteFace::rim_inner : ConcreteFace::rim_outer;
    }
  if (strength(Effect::rim_slurry) != 0.0) cover_rim(side, kSlurryShare * strength(Effect::rim_slurry));
  if (strength(Effect::rim_drop) != 0.0) drop_rim(side, kDropShare * strength(Effect::rim_drop));
}

void ConcreteBlock::cover_rim(std::size_t side, double share) {
  const Bore& bore = bores_[side];
  const double rim_radius = 0.5 * recipe_.block.casing_rim_diameter_mm.value;
  const FieldSize size{rim_radius + 1.0, rim_radius + 1.0, kClump_mm / 4.0};
  const RasterField splash = RasterField::grain(size, kClump_mm, seed_of(Effect::rim_slurry, side));
  const RasterField thick = RasterField::grain(size, 2.0 * kClump_mm, seed_of(Effect::rim_slurry, side + 2));
  const auto each = [&](const auto& visit) {
    const HeightField::Window w = field_.window(bore.centre.x(), bore.centre.y(), rim_radius + 1.0);
    for (std::size_t row = w.row_from; row < w.row_to; ++row)
      for (std::size_t column = w.column_from; column < w.column_to; ++column) {
        const double dx = field_.x_mm(column) - bore.centre.x();
        const double dy = field_.y_mm(row) - bore.centre.y();
        const double r = std::hypot(dx, dy);
        if (r < bore.radius_mm || r >= rim_radius) continue;
        // The slurry covers the rim from the outer edge inward.
        const double outward = (r - bore.radius_mm) / (rim_radius - bore.radius_mm);
        visit(field_.index(column, row), dx, dy, splash.at(dx, dy) + 2.0 * outward);
      }
  };
  std::vector<double> values;
  each([&](std::size_t, double, double, double wet) { values.push_back(wet); });
  const double limit = exceeded_by(values, share);
  std::size_t covered = 0;
  each([&](std::size_t node, double dx, double dy, double wet) {
    if (wet <= limit) return;
    const double part = std::clamp(0.5 + 0.25 * thick.at(dx, dy), 0.0, 1.0);
    field_.z(node) += static_cast<float>(kSlurryMin_mm + part * (kSlurryMax_mm - kSlurryMin_mm));
    face_[node] = ConcreteFace::edge;
    ++covered;
  });
  truth_.rim_covered[side] = static_cast<double>(covered) / static_cast<double>(values.size());
}

void ConcreteBlock::drop_rim(std::size_t side, double share) {
  const Bore& bore = bores_[side];
  const ConcreteFace rim = side == 0 ? ConcreteFace::rim_inner : ConcreteFace::rim_outer;
  const double reach = 0.5 * recipe_.block.casing_rim_diameter_mm.value + 1.0;
  const RasterField clumps = RasterField::grain({reach, reach, 0.5}, kClump_mm, seed_of(Effect::rim_drop, side));
  const HeightField::Window w = field_.window(bore.centre.x(), bore.centre.y(), reach);
  std::vector<double> values;
  const auto each = [&](const auto& visit) {
    for (std::size_t row = w.row_from; row < w.row_to; ++row)
      for (std::size_t column = w.column_from; column < w.column_to; ++column) {
        const std::size_t node = field_.index(column, row);
        if (face_[node] == rim)
          visit(node, clumps.at(field_.x_mm(column) - bore.centre.x(), field_.y_mm(row) - bore.centre.y()));
      }
  };
  each([&](std::size_t, double value) { values.push_back(value); });
  const double limit = exceeded_by(values, share);
  each([&](std::size_t node, double value) {
    if (value > limit) gloss_[node] |= kClump;
  });
}

void ConcreteBlock::fill_bore(std::size_t side) {
  Bore& bore = bores_[side];
  // Up to strength 1 only the outer casing is affected.
  const auto has = [&](Effect effect) { return strength(effect) > (side == 1 ? 0.0 : 1.0); };
  Prng random(seed_of(Effect::dirt, side));
  if (strength(Effect::thread) > 0.0) bore.thread_depth_mm = kThread_mm * strength(Effect::thread);
  if (strength(Effect::bore_water) > 0.0) {
    bore.content = Bore::Content::water;
    bore.level_mm = kWater_mm;
  }
  if (strength(Effect::dirt) > 0.0) {
    bore.content = Bore::Content::sand;
    bore.level_mm = kSandMin_mm + (kSandMax_mm - kSandMin_mm) * random.uniform();
  }
  if (has(Effect::plug)) {
    bore.content = Bore::Content::plug;
    bore.level_mm = kPlugDepth_mm;
  }
  if (!has(Effect::cap)) return;
  bore.content = Bore::Content::cap;
  const HeightField::Window w = field_.window(bore.centre.x(), bore.centre.y(), 0.5 * kCapDiameter_mm);
  for (std::size_t row = w.row_from; row < w.row_to; ++row)
    for (std::size_t column = w.column_from; column < w.column_to; ++column) {
      const double dx = field_.x_mm(column) - bore.centre.x();
      const double dy = field_.y_mm(row) - bore.centre.y();
      if (std::hypot(dx, dy) >= 0.5 * kCapDiameter_mm) continue;
      const std::size_t node = field_.index(column, row);
      field_.z(node) = static_cast<float>(bore.centre.z() + kCapHeight_mm -
                                          (bore.axis.x() * dx + bore.axis.y() * dy) / bore.axis.z());
      face_[node] = ConcreteFace::cap;
      gloss_[node] = 0;
    }
}

}  // namespace slabd::emulator
