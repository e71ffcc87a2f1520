// SPDX-License-Identifier: Apache-2.0
//
// Marks on the concrete: pores, burrs, flash lines, dust, drops, straps, release agent and chalk.
#include <algorithm>
#include <cmath>

#include "emulator/concrete_block.h"
#include "emulator/slab_scene.h"

namespace slabd::simulate {
namespace {

constexpr double kPores = 80.0;
constexpr double kPoreMedianMm = 1.0;
constexpr double kPoreSigma = 0.55;
constexpr double kPoreMinMm = 0.5;
constexpr double kPoreMaxMm = 8.0;
constexpr double kPoreDepthMaxMm = 3.0;
constexpr double kBurrs = 12.0;
constexpr double kBurrMaxMm = 0.6;
constexpr double kFinMm = 0.10;
constexpr double kFinWidthMm = 0.8;
constexpr double kFinShare = 0.6;
constexpr double kDustGrains = 300.0;
constexpr double kDustFilmMm = 0.02;
constexpr double kDrops = 6.0;
constexpr double kStrapWidthMm = 15.0;
constexpr double kStrapMm = 2.0;
constexpr double kFilmMm = 0.03;
constexpr double kChalkMm = 0.03;
constexpr double kChalkStepMm = 0.02;
constexpr double kChalkHalfMm = 4.0;
/// Half of the block as far as things are strewn over it.
constexpr double kStrewnX = 98.0;
constexpr double kStrewnY = 232.0;
/// Half of the seat between the jaws' fillets.
constexpr double kSeatHalfY = 178.0;

double between(Prng& random, double low, double high) {
  return low + (high - low) * random.uniform();
}

double bell(double r, double half) {
  return std::abs(r) < half ? 0.5 * (1.0 + std::cos(kPi * r / half)) : 0.0;
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
        return kFilmMm * film * std::min(1.0, 5.0 * (1.0 - r));
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
      // The scanner sees a step of the reflectivity as one of the height: up on the dark side, down on the light.
      if (off < kChalkHalfMm - 0.5) return kChalkMm * chalk;
      if (off < kChalkHalfMm) return (kChalkMm - kChalkStepMm) * chalk;
      return off < kChalkHalfMm + 0.5 ? kChalkStepMm * chalk : 0.0;
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
    const double size = std::clamp(kPoreMedianMm * std::exp(kPoreSigma * random.normal()), kPoreMinMm, kPoreMaxMm);
    const double depth = std::min(size * between(random, 0.25, 0.5), kPoreDepthMaxMm);
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
    const double height = std::min(burrs * between(random, 0.1, 0.3), kBurrMaxMm);
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
  // Present where the course is in its upper part: the quantile is found on the course itself.
  std::vector<double> values;
  for (double y = -kSeatHalfY; y < kSeatHalfY; y += 1.0) values.push_back(presence.at(y));
  std::sort(values.begin(), values.end());
  const double limit = values[static_cast<std::size_t>((1.0 - kFinShare) * static_cast<double>(values.size()))];
  const HeightField::Window w = field_.window(x - kFinWidthMm, x + kFinWidthMm, -kSeatHalfY, kSeatHalfY);
  for (std::size_t row = w.row_from; row < w.row_to; ++row) {
    const double y = field_.y_mm(row);
    if (presence.at(y) < limit || over_rim(x, y, kFinWidthMm)) continue;
    for (std::size_t column = w.column_from; column < w.column_to; ++column) {
      const double off = std::abs(field_.x_mm(column) - x) / (0.5 * kFinWidthMm);
      if (off < 1.0) field_.z(field_.index(column, row)) += static_cast<float>(kFinMm * fin * (1.0 - off));
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
    // A grain smaller than a cell of the raster keeps its volume, not its height.
    const double volume = kPi / 6.0 * size * size * size;
    const double height = std::min(0.7 * size, volume / node2);
    stamp(x, y, std::max(0.5 * size, 0.5 * field_.step_mm()), [&](double, double) { return height; });
  }
  const RasterField film = RasterField::waves({kHalfXMm, kHalfYMm, 2.0}, 20.0, 120.0, 16, random.next());
  const HeightField::Window w = field_.window(-kStrewnX, kStrewnX, -kStrewnY, kStrewnY);
  for (std::size_t row = w.row_from; row < w.row_to; ++row)
    for (std::size_t column = w.column_from; column < w.column_to; ++column) {
      const std::size_t node = field_.index(column, row);
      if (face_[node] == ConcreteFace::seat)
        field_.z(node) += static_cast<float>(
            kDustFilmMm * dust * std::clamp(film.at(field_.x_mm(column), field_.y_mm(row)) - 1.0, 0.0, 1.0));
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
  const double half = 0.5 * kStrapWidthMm;
  const double aside = effect == Effect::strap ? between(random, 70.0 + half, 95.0 - half) : between(random, 0.0, 40.0);
  const double x = random.uniform() < 0.5 ? -aside : aside;
  const HeightField::Window w = field_.window(x - half, x + half, -kSeatHalfY, kSeatHalfY);
  for (std::size_t row = w.row_from; row < w.row_to; ++row)
    for (std::size_t column = w.column_from; column < w.column_to; ++column) {
      const std::size_t node = field_.index(column, row);
      field_.z(node) = static_cast<float>(seat_z(field_.x_mm(column), field_.y_mm(row)) + kStrapMm * strength(effect));
      face_[node] = ConcreteFace::strap;
    }
}

}  // namespace slabd::simulate
