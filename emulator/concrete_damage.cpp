// SPDX-License-Identifier: Apache-2.0
//
// The defects of a real block: dimensions, form of the seat, damage.
#include <algorithm>
#include <cmath>

#include "emulator/concrete_block.h"
#include "emulator/slab_scene.h"

namespace slabd::emulator {
namespace {

constexpr double kBowlHalf_mm = 15.0;
constexpr double kBowHalfX_mm = 95.0;
constexpr double kBowHalfS_mm = 60.0;
/// Roughness of broken concrete.
constexpr double kBreakRough_mm = 0.5;
constexpr double kBreakGrain_mm = 3.0;
constexpr double kCrackDepth_mm = 3.0;

double bell(double r, double half) {
  return std::abs(r) < half ? 0.5 * (1.0 + std::cos(kPi * r / half)) : 0.0;
}

}  // namespace

std::string_view name(MarkKind kind) {
  constexpr std::array<std::string_view, 6> kNames = {"pore", "burr", "dust", "drop", "damage", "crack"};
  return kNames.at(static_cast<std::size_t>(kind));
}

BlockTruth with_defects(const BlockTruth& basis, const std::vector<ConcreteDefect>& defects) {
  BlockTruth truth = basis;
  for (const ConcreteDefect& defect : defects) {
    switch (defect.kind) {
      case ConcreteDefectKind::slope: truth.slope_rad += rad_from_deg(defect.size); break;
      case ConcreteDefectKind::jaw_distance: truth.jaw_distance_mm += defect.size; break;
      case ConcreteDefectKind::jaw_angle: truth.jaw_angle_outer_rad += rad_from_deg(defect.size); break;
      // The rim protrudes by the size, whatever the nominal protrusion.
      case ConcreteDefectKind::casing_out: truth.protrusion_outer_mm = defect.size; break;
      case ConcreteDefectKind::casing_sunk: truth.protrusion_inner_mm -= defect.size; break;
      case ConcreteDefectKind::spacing: truth.casing_spacing_mm += defect.size; break;
      default: break;
    }
  }
  return truth;
}

void ConcreteBlock::mark(PlantedMark planted) {
  const EvaluationSettings& e = recipe_.evaluation;
  planted.in_crop = std::abs(planted.x_mm) <= e.crop_half_x_mm &&
                    std::abs(along_seat(planted.x_mm, planted.y_mm)) <= e.crop_half_s_mm;
  planted.z_mm = field_.height_mm(planted.x_mm, planted.y_mm);
  truth_.marks.push_back(planted);
}

void ConcreteBlock::put_defects() {
  const EvaluationSettings& e = recipe_.evaluation;
  for (const ConcreteDefect& defect : order_.defects) {
    Prng random(derived_seed(order_.seed, 500 + static_cast<std::uint64_t>(defect.kind), 0));
    const auto in_crop = [&](double half) { return (2.0 * random.uniform() - 1.0) * (half - kBowlHalf_mm); };
    const double x = in_crop(e.crop_half_x_mm);
    const double y = in_crop(e.crop_half_s_mm);
    if (defect.kind == ConcreteDefectKind::depression || defect.kind == ConcreteDefectKind::hump) {
      const double height = defect.kind == ConcreteDefectKind::hump ? defect.size : -defect.size;
      stamp(x, y, kBowlHalf_mm, [&](double dx, double dy) { return height * bell(std::hypot(dx, dy), kBowlHalf_mm); });
    } else if (defect.kind == ConcreteDefectKind::bow) {
      // The bell ends within the evaluation region along s, so that its whole height is in the region.
      stamp(0.0, 0.0, kBowHalfX_mm,
            [&](double dx, double dy) { return defect.size * bell(dx, kBowHalfX_mm) * bell(dy, kBowHalfS_mm); });
    }
  }
}

/// Broken concrete: the size, the end of the block, and the roughness of the break.
struct ConcreteBlock::Break {
  double size_mm;
  double sign;  ///< end of the block, along x
  Prng& random;
  const RasterField& grain;

  [[nodiscard]] double roughness_mm(double dx, double dy) const { return kBreakRough_mm * grain.at(dx, dy); }
};

template <typename Floor>
void ConcreteBlock::break_out(double x, double y, double half_mm, const Floor& floor) {
  const HeightField::Window w = field_.window(x, y, half_mm);
  for (std::size_t row = w.row_from; row < w.row_to; ++row)
    for (std::size_t column = w.column_from; column < w.column_to; ++column) {
      const std::size_t node = field_.index(column, row);
      if (face_[node] >= ConcreteFace::rim_inner) continue;
      const double z = std::max(top_z_mm_, floor(field_.x_mm(column) - x, field_.y_mm(row) - y));
      if (z < static_cast<double>(field_.z(node))) {
        field_.z(node) = static_cast<float>(z);
        face_[node] = ConcreteFace::edge;
      }
    }
}

void ConcreteBlock::chip_corner(const Break& b) {
  const double end = recipe_.block.end_half_length_mm.value;
  const double shoulder = recipe_.block.shoulder_outer_z_mm.value;
  const double tan_draft = std::tan(recipe_.block.draft_rad.value);
  // The plane through the points at distance `size` from the corner along its three edges.
  const double x = b.sign * (end - shoulder * tan_draft);
  const double y = recipe_.block.side_half_width_mm.value - shoulder * tan_draft;
  mark({MarkKind::damage, x, y, 0.0, b.size_mm, b.size_mm, b.size_mm, false});
  break_out(x, y, 1.5 * b.size_mm,
            [&](double dx, double dy) { return shoulder - b.size_mm - (b.sign * dx + dy) + b.roughness_mm(dx, dy); });
}

void ConcreteBlock::chip_seat(const Break& b) {
  const double x = b.sign * recipe_.block.end_half_length_mm.value;
  const double y = (2.0 * b.random.uniform() - 1.0) * 80.0;
  mark({MarkKind::damage, x, y, 0.0, b.size_mm, b.size_mm, 0.4 * b.size_mm, false});
  break_out(x, y, b.size_mm, [&](double dx, double dy) {
    const double r = std::hypot(dx, dy) / (0.75 * b.size_mm);
    return seat_z(x, y) + b.roughness_mm(dx, dy) - 0.4 * b.size_mm + (r < 1.0 ? 0.4 * b.size_mm * r * r : 1e3);
  });
}

/// At the upper edge between the outer jaw and its shoulder.
void ConcreteBlock::chip_jaw(const Break& b) {
  const double shoulder = recipe_.block.shoulder_outer_z_mm.value;
  const double x = (2.0 * b.random.uniform() - 1.0) * (recipe_.block.end_half_length_mm.value - 2.0 * b.size_mm);
  const double jaw_climb = std::tan(truth_.block.slope_rad + kPi - truth_.block.jaw_angle_outer_rad);
  const double y = jaw_corners_[1].y() + (shoulder - jaw_corners_[1].z()) / jaw_climb;
  mark({MarkKind::damage, x, y, 0.0, b.size_mm, 0.5 * b.size_mm, 0.35 * b.size_mm, false});
  break_out(x, y, b.size_mm, [&](double dx, double dy) {
    const double r = std::hypot(dx / (0.5 * b.size_mm), dy / (0.5 * b.size_mm));
    return shoulder + b.roughness_mm(dx, dy) - 0.45 * b.size_mm + (r < 1.0 ? 0.35 * b.size_mm * r * r : 1e3);
  });
}

/// Crosses the whole seat, within the evaluation region.
void ConcreteBlock::crack(const Break& b) {
  const double end = recipe_.block.end_half_length_mm.value;
  const double y = (2.0 * b.random.uniform() - 1.0) * 50.0;
  const EdgeVariation course(b.random.next());
  mark({MarkKind::crack, 0.0, y, 0.0, 2.0 * end, b.size_mm, kCrackDepth_mm, true});
  stamp(0.0, y, end, [&](double dx, double dy) {
    const double off = std::abs(dy - 4.0 * course.at(dx));
    return off < 0.5 * b.size_mm ? -kCrackDepth_mm * (1.0 - off / (0.5 * b.size_mm)) : 0.0;
  });
}

/// A quarter of the outer rim under mortar that is higher than the seat.
void ConcreteBlock::crust(const Break& b) {
  const Bore& bore = bores_[1];
  const double from = 2.0 * kPi * b.random.uniform();
  const double rim_radius = 0.5 * recipe_.block.casing_rim_diameter_mm.value;
  const HeightField::Window w = field_.window(bore.centre.x(), bore.centre.y(), rim_radius);
  for (std::size_t row = w.row_from; row < w.row_to; ++row)
    for (std::size_t column = w.column_from; column < w.column_to; ++column) {
      const double dx = field_.x_mm(column) - bore.centre.x();
      const double dy = field_.y_mm(row) - bore.centre.y();
      const double r = std::hypot(dx, dy);
      const double turn = std::remainder(std::atan2(dy, dx) - from, 2.0 * kPi);
      if (r < bore.radius_mm || r > rim_radius || std::abs(turn) > 0.25 * kPi) continue;
      const std::size_t node = field_.index(column, row);
      field_.z(node) =
          static_cast<float>(seat_z(field_.x_mm(column), field_.y_mm(row)) + b.size_mm + 0.3 * b.roughness_mm(dx, dy));
      face_[node] = ConcreteFace::edge;
      gloss_[node] = 0;
    }
  mark({MarkKind::damage, bore.centre.x() + 18.5 * std::cos(from), bore.centre.y() + 18.5 * std::sin(from), 0.0, 26.0,
        7.0, -b.size_mm, false});
}

void ConcreteBlock::put_damage() {
  for (const ConcreteDefect& defect : order_.defects) {
    Prng random(derived_seed(order_.seed, 500 + static_cast<std::uint64_t>(defect.kind), 1));
    const double sign = random.uniform() < 0.5 ? -1.0 : 1.0;
    const RasterField grain = RasterField::grain({40.0, 40.0, 0.5}, kBreakGrain_mm, random.next());
    const Break broken{defect.size, sign, random, grain};
    switch (defect.kind) {
      case ConcreteDefectKind::chip_corner: chip_corner(broken); break;
      case ConcreteDefectKind::chip_seat: chip_seat(broken); break;
      case ConcreteDefectKind::chip_jaw: chip_jaw(broken); break;
      case ConcreteDefectKind::crack: crack(broken); break;
      case ConcreteDefectKind::crust: crust(broken); break;
      default: break;
    }
  }
}

// Marks on the concrete: pores, burrs, flash lines, dust, drops, straps, release agent and chalk.

namespace {

constexpr double kPores = 80.0;
constexpr double kPoreMedian_mm = 1.0;
constexpr double kPoreSigma = 0.55;
constexpr double kPoreMin_mm = 0.5;
constexpr double kPoreMax_mm = 8.0;
constexpr double kPoreDepthMax_mm = 3.0;
constexpr double kBurrs = 12.0;
constexpr double kBurrMax_mm = 0.6;
constexpr double kFin_mm = 0.10;
constexpr double kFinWidth_mm = 0.8;
constexpr double kFinShare = 0.6;
constexpr double kDustGrains = 300.0;
constexpr double kDustFilm_mm = 0.02;
constexpr double kDrops = 6.0;
constexpr double kStrapWidth_mm = 15.0;
constexpr double kStrap_mm = 2.0;
constexpr double kFilm_mm = 0.03;
constexpr double kChalk_mm = 0.03;
constexpr double kChalkStep_mm = 0.02;
constexpr double kChalkHalf_mm = 4.0;
/// Half size of the area of the block over which marks are scattered.
constexpr double kStrewnX = 98.0;
constexpr double kStrewnY = 232.0;
/// Half of the seat between the jaws' fillets.
constexpr double kSeatHalfY = 178.0;

double between(Prng& random, double low, double high) {
  return low + (high - low) * random.uniform();
}

int count_of(double usual, double strength) {
  return static_cast<int>(std::lround(usual * strength));
}

}  // namespace

void ConcreteBlock::put_form() {
  if (strength(Effect::strap) != 0.0) put_strap(Effect::strap);
  if (strength(Effect::strap_crop) != 0.0) put_strap(Effect::strap_crop);
  if (const double film = strength(Effect::film); film != 0.0) {
    Prng random(seed_of(Effect::film));
    for (int i = 0; i < 5; ++i) {
      const double half_x = between(random, 8.0, 30.0);
      const double half_y = between(random, 5.0, 15.0);
      const double half = std::max(half_x, half_y);
      const double x = between(random, -70.0, 70.0);
      const double y = between(random, -150.0, 150.0);
      stamp(x, y, half, [&](double dx, double dy) {
        const double r = std::hypot(dx / half_x, dy / half_y);
        if (r >= 1.0) return 0.0;
        gloss_[field_.nearest(x + dx, y + dy)] |= kGlossy;
        return kFilm_mm * film * std::min(1.0, 5.0 * (1.0 - r));
      });
    }
  }
  if (const double chalk = strength(Effect::chalk); chalk != 0.0) {
    Prng random(seed_of(Effect::chalk));
    const double x = between(random, -35.0, 35.0);
    const double lean = between(random, -0.1, 0.1);
    const double y = between(random, -40.0, 40.0);
    stamp(x, y, 70.0, [&](double dx, double dy) {
      const double off = std::abs(dx - lean * dy);
      // The scanner measures a step of the reflectivity as a step of the height: up on the dark side, down on the
      // light.
      if (off < kChalkHalf_mm - 0.5) return kChalk_mm * chalk;
      if (off < kChalkHalf_mm) return (kChalk_mm - kChalkStep_mm) * chalk;
      return off < kChalkHalf_mm + 0.5 ? kChalkStep_mm * chalk : 0.0;
    });
  }
}

void ConcreteBlock::put_marks() {
  put_pores();
  put_burrs();
  put_fin(Effect::fin);
  put_fin(Effect::fin_crop);
  put_dust();
  put_drops();
}

void ConcreteBlock::put_pores() {
  Prng random(seed_of(Effect::voids));
  const int count = count_of(kPores, strength(Effect::voids));
  for (int i = 0; i < count; ++i) {
    const double x = between(random, -kStrewnX, kStrewnX);
    const double y = between(random, -kStrewnY, kStrewnY);
    const double size = std::clamp(kPoreMedian_mm * std::exp(kPoreSigma * random.normal()), kPoreMin_mm, kPoreMax_mm);
    const double depth = std::min(size * between(random, 0.25, 0.5), kPoreDepthMax_mm);
    const double long_way = between(random, 1.0, 1.25);
    const double turn = between(random, 0.0, kPi);
    const double steepness = between(random, 0.35, 0.8);  // of the rim: 0.5 is half of an ellipsoid
    if (over_rim(x, y, size)) continue;
    mark({MarkKind::pore, x, y, 0.0, size * long_way, size / long_way, depth, false});
    const double half_a = 0.5 * size * long_way;
    const double half_b = 0.5 * size / long_way;
    const double c = std::cos(turn);
    const double s = std::sin(turn);
    stamp(x, y, half_a, [&](double dx, double dy) {
      const double r2 = std::pow((c * dx + s * dy) / half_a, 2) + std::pow((c * dy - s * dx) / half_b, 2);
      return r2 < 1.0 ? -depth * std::pow(1.0 - r2, steepness) : 0.0;
    });
  }
}

void ConcreteBlock::put_burrs() {
  const double burrs = strength(Effect::burrs);
  if (burrs == 0.0) return;
  Prng random(seed_of(Effect::burrs));
  for (int i = 0; i < count_of(kBurrs, 1.0); ++i) {
    const double x = between(random, -kStrewnX, kStrewnX);
    const double y = between(random, -kStrewnY, kStrewnY);
    const double height = std::min(burrs * between(random, 0.1, 0.3), kBurrMax_mm);
    const double width = between(random, 1.0, 4.0);
    if (over_rim(x, y, width)) continue;
    mark({MarkKind::burr, x, y, 0.0, width, width, -height, false});
    stamp(x, y, 0.5 * width, [&](double dx, double dy) { return height * bell(std::hypot(dx, dy), 0.5 * width); });
  }
}

void ConcreteBlock::put_fin(Effect effect) {
  const double fin = strength(effect);
  if (fin == 0.0) return;
  Prng random(seed_of(effect));
  const double aside = effect == Effect::fin ? between(random, 56.0, 95.0) : between(random, 5.0, 45.0);
  const double x = random.uniform() < 0.5 ? -aside : aside;
  const EdgeVariation presence(random.next());
  // The fin is present where `presence` is in its upper quantile, which is computed from its values.
  std::vector<double> values;
  for (double y = -kSeatHalfY; y < kSeatHalfY; y += 1.0) values.push_back(presence.at(y));
  std::sort(values.begin(), values.end());
  const double limit = values[static_cast<std::size_t>((1.0 - kFinShare) * static_cast<double>(values.size()))];
  const HeightField::Window w = field_.window(x - kFinWidth_mm, x + kFinWidth_mm, -kSeatHalfY, kSeatHalfY);
  for (std::size_t row = w.row_from; row < w.row_to; ++row) {
    const double y = field_.y_mm(row);
    if (presence.at(y) < limit || over_rim(x, y, kFinWidth_mm)) continue;
    for (std::size_t column = w.column_from; column < w.column_to; ++column) {
      const double off = std::abs(field_.x_mm(column) - x) / (0.5 * kFinWidth_mm);
      if (off < 1.0) field_.z(field_.index(column, row)) += static_cast<float>(kFin_mm * fin * (1.0 - off));
    }
  }
}

void ConcreteBlock::put_dust() {
  const double dust = strength(Effect::dust);
  if (dust == 0.0) return;
  Prng random(seed_of(Effect::dust));
  const double node2 = field_.step_mm() * field_.step_mm();
  for (int i = 0; i < count_of(kDustGrains, dust); ++i) {
    const double x = between(random, -kStrewnX, kStrewnX);
    const double y = between(random, -kStrewnY, kStrewnY);
    const double size = between(random, 0.1, 0.5);
    // A grain smaller than a raster cell keeps its volume, not its height.
    const double volume = kPi / 6.0 * size * size * size;
    const double height = std::min(0.7 * size, volume / node2);
    stamp(x, y, std::max(0.5 * size, 0.5 * field_.step_mm()), [&](double, double) { return height; });
  }
  const RasterField film = RasterField::waves({kHalfX_mm, kHalfY_mm, 2.0}, 20.0, 120.0, 16, random.next());
  const HeightField::Window w = field_.window(-kStrewnX, kStrewnX, -kStrewnY, kStrewnY);
  for (std::size_t row = w.row_from; row < w.row_to; ++row)
    for (std::size_t column = w.column_from; column < w.column_to; ++column) {
      const std::size_t node = field_.index(column, row);
      if (face_[node] == ConcreteFace::seat)
        field_.z(node) += static_cast<float>(
            kDustFilm_mm * dust * std::clamp(film.at(field_.x_mm(column), field_.y_mm(row)) - 1.0, 0.0, 1.0));
    }
}

void ConcreteBlock::put_drops() {
  const int count = count_of(kDrops, strength(Effect::drops));
  Prng random(seed_of(Effect::drops));
  for (int i = 0; i < count; ++i) {
    const double half = 0.5 * between(random, 4.0, 9.0);
    const double height = 0.3 * half;
    const double x = between(random, -90.0, 90.0);
    const double y = between(random, -kSeatHalfY, kSeatHalfY);
    if (over_rim(x, y, half)) continue;
    mark({MarkKind::drop, x, y, 0.0, 2.0 * half, 2.0 * half, -height, false});
    stamp(x, y, half, [&](double dx, double dy) {
      const double r2 = (dx * dx + dy * dy) / (half * half);
      if (r2 >= 1.0) return 0.0;
      gloss_[field_.nearest(x + dx, y + dy)] |= kWet;
      return height * std::sqrt(1.0 - r2);
    });
  }
}

void ConcreteBlock::put_strap(Effect effect) {
  Prng random(seed_of(effect));
  const double half = 0.5 * kStrapWidth_mm;
  const double aside = effect == Effect::strap ? between(random, 70.0 + half, 95.0 - half) : between(random, 0.0, 40.0);
  const double x = random.uniform() < 0.5 ? -aside : aside;
  const HeightField::Window w = field_.window(x - half, x + half, -kSeatHalfY, kSeatHalfY);
  for (std::size_t row = w.row_from; row < w.row_to; ++row)
    for (std::size_t column = w.column_from; column < w.column_to; ++column) {
      const std::size_t node = field_.index(column, row);
      field_.z(node) = static_cast<float>(seat_z(field_.x_mm(column), field_.y_mm(row)) + kStrap_mm * strength(effect));
      face_[node] = ConcreteFace::strap;
    }
}

}  // namespace slabd::emulator
