// SPDX-License-Identifier: Apache-2.0
#include "emulator/block_drawing.h"

#include <algorithm>
#include <cmath>

#include "emulator/concrete_optics.h"
#include "emulator/slab_scene.h"

namespace slabd::emulator {

namespace {

constexpr double kNoise_mm = 0.013;
constexpr double kNoiseFactorMax = 5.0;
constexpr double kRipple_mm = 0.010;
constexpr double kPatchNoise = 2.5;
constexpr double kPatchMissing = 0.15;
constexpr double kRimNoise = 2.0;
constexpr double kGlossyNoise = 3.0;
constexpr double kGlossyMissing = 0.3;
constexpr double kWetMissing = 0.85;
constexpr double kSteepFrom_deg = 68.0;
constexpr double kSteepTo_deg = 82.0;
constexpr double kFlyingShare = 0.3;
constexpr double kFlyingStep_mm = 1.0;
constexpr double kFlyingBore_mm = 6.0;  ///< depth of a flying point into a bore without a return
constexpr double kOutlierShare = 0.0005;
constexpr double kOutlier_mm = 30.0;
constexpr double kDropoutShare = 0.01;
constexpr double kLens_mm = 0.012;
constexpr double kScalePpm = 25.0;
constexpr double kPose_mm = 2.0;
constexpr double kPose_deg = 0.3;
constexpr double kMisfit_mm = 0.03;
constexpr double kMisfit_deg = 0.005;

double within(Prng& random, double amplitude) {
  return amplitude * (2.0 * random.uniform() - 1.0);
}

Vec3 random_direction(Prng& random) {
  return Vec3(random.normal(), random.normal(), random.normal()).normalized();
}

/// Form error of the optics over the field: products of Legendre polynomials of degree 2 and 3, without mean and tilt
/// over the field; largest value 1.
class LensForm {
 public:
  explicit LensForm(Prng& random) {
    for (double& weight : weight_) weight = random.normal();
    double largest = 0.0;
    for (int i = -10; i <= 10; ++i)
      for (int k = -10; k <= 10; ++k) largest = std::max(largest, std::abs(at(0.1 * i, 0.1 * k)));
    for (double& weight : weight_) weight /= largest;
  }
  [[nodiscard]] double at(double u, double v) const {
    const auto two = [](double x) { return 1.5 * x * x - 0.5; };
    const auto three = [](double x) { return (2.5 * x * x - 1.5) * x; };
    return weight_[0] * two(u) + weight_[1] * u * v + weight_[2] * two(v) + weight_[3] * three(u) +
           weight_[4] * two(u) * v + weight_[5] * u * two(v) + weight_[6] * three(v);
  }

 private:
  std::array<double, 7> weight_{};
};

/// Errors of the scanner and its surroundings, the same for all pixels.
struct Errors {
  Errors(const ConcreteOrder& order, std::uint64_t scanner_seed)
      : random(derived_seed(scanner_seed, 601, 0)),
        lens(random),
        ripple_period_mm(2.0 + 4.0 * random.uniform()),
        ripple_phase(2.0 * kPi * random.uniform()),
        scale(1.0 + 1e-6 * within(random, kScalePpm * order.effects[Effect::scale])) {
    Prng of_block(derived_seed(order.seed, 603, 0));
    patch_centre = Vec3(within(of_block, 70.0), within(of_block, 150.0), 0.0);
    patch_radius_mm = 0.5 * (40.0 + 50.0 * of_block.uniform());
    misfit.translation_mm = kMisfit_mm * order.effects[Effect::misfit] * random_direction(random);
    const Vec3 axis = random_direction(random);
    const double turn = rad_from_deg(kMisfit_deg * order.effects[Effect::misfit]);
    misfit.rotation = Quat(Eigen::AngleAxisd(turn, Eigen::Vector3d(axis)));
  }
  Prng random;
  LensForm lens;
  double ripple_period_mm;
  double ripple_phase;
  double scale;
  Vec3 patch_centre = Vec3::Zero();  ///< block frame
  double patch_radius_mm = 0.0;
  Pose misfit;  ///< pose error of the second view
};

class Drawing {
 public:
  Drawing(const ConcreteBlock& block, const ConcreteOrder& order, const Pose& T_scanner_block,
          const ConcreteScanner& scanner, std::uint64_t scan_seed)
      : block_(block),
        effects_(order.effects),
        scanner_(scanner),
        optics_(order, T_scanner_block, scanner),
        errors_(order, scanner.seed),
        T_block_scanner_(T_scanner_block.inverse()),
        random_(scan_seed) {
    const auto field = [&](std::size_t columns, std::size_t rows, std::uint64_t which) {
      ScannerTraits raster;
      raster.columns = columns;
      raster.rows = rows;
      return noise_field(raster, derived_seed(scan_seed, which, 0));
    };
    own_ = field(scanner.columns, scanner.rows, 1);
    shared_ = field((scanner.columns + 1) / 2, (scanner.rows + 1) / 2, 2);
    noise_mm_ = has_value(scanner.noise_mm) ? scanner.noise_mm : kNoise_mm * effects_[Effect::noise];
    outlier_share_ =
        has_value(scanner.outlier_share) ? scanner.outlier_share : kOutlierShare * effects_[Effect::outliers];
  }

  DrawnScan draw(std::vector<float>& xyz) {
    look();
    const bool organised = scanner_.organised && effects_[Effect::misfit] == 0.0;
    xyz.resize(3 * seen_.size());
    std::size_t at = 0;
    for (std::size_t row = 0; row < scanner_.rows; ++row)
      for (std::size_t column = 0; column < scanner_.columns; ++column) {
        const Vec3 p = point(column, row);
        if (std::isnan(p.z())) {
          if (!organised) continue;
        } else {
          ++drawn_.valid;
        }
        for (int axis = 0; axis < 3; ++axis) xyz[at++] = static_cast<float>(p[axis]);
      }
    xyz.resize(at);
    if (organised) {
      drawn_.width = scanner_.columns;
      drawn_.height = scanner_.rows;
    }
    return drawn_;
  }

 private:
  void look() {
    seen_.resize(scanner_.columns * scanner_.rows);
    Prng chance(random_.next());
    for (std::size_t row = 0; row < scanner_.rows; ++row)
      for (std::size_t column = 0; column < scanner_.columns; ++column)
        seen_[row * scanner_.columns + column] = optics_.look(block_, column, row, chance.next());
  }

  /// The depth step to a neighbour, or into an empty bore next to the pixel; 0 if there is none.
  [[nodiscard]] double step_beside(std::size_t column, std::size_t row) const {
    const Seen& own = seen_[row * scanner_.columns + column];
    double step = 0.0;
    const auto compare = [&](std::size_t other_column, std::size_t other_row) {
      if (other_column >= scanner_.columns || other_row >= scanner_.rows) return;
      const Seen& other = seen_[other_row * scanner_.columns + other_column];
      double to = static_cast<double>(other.t - own.t);
      if (std::isnan(to)) to = other.bore != 0 && own.bore == 0 ? kFlyingBore_mm : 0.0;
      if (std::abs(to) > std::abs(step)) step = to;
    };
    compare(column + 1, row);
    compare(column - 1, row);
    compare(column, row + 1);
    compare(column, row - 1);
    return std::abs(step) > kFlyingStep_mm ? step : 0.0;
  }

  [[nodiscard]] double missing_share(const Seen& seen, bool in_patch) const {
    double there = 1.0 - kDropoutShare * std::min(100.0, effects_[Effect::dropout]);
    if (in_patch) there *= 1.0 - kPatchMissing;
    if ((seen.gloss & kWet) != 0) there *= 1.0 - kWetMissing;
    if ((seen.gloss & kGlossy) != 0) there *= 1.0 - kGlossyMissing;
    if ((seen.gloss & kClump) != 0) there = 0.0;
    if (effects_[Effect::steep] != 0.0) {
      const double deg = deg_from_rad(std::acos(std::min(1.0, static_cast<double>(seen.cosine))));
      const double gone = (deg - kSteepFrom_deg) / (kSteepTo_deg - kSteepFrom_deg);
      there *= 1.0 - std::clamp(gone * effects_[Effect::steep], 0.0, 1.0);
    }
    return 1.0 - there;
  }

  [[nodiscard]] double noise_of(const Seen& seen, bool in_patch) const {
    double factor = 1.0;
    if (effects_[Effect::incidence] != 0.0)
      factor += effects_[Effect::incidence] *
                (std::min(kNoiseFactorMax, 1.0 / std::max(1e-3, static_cast<double>(seen.cosine))) - 1.0);
    if (in_patch) factor *= 1.0 + (kPatchNoise - 1.0) * effects_[Effect::patch];
    if ((seen.gloss & kGlossy) != 0) factor *= kGlossyNoise;
    const bool plastic = seen.face == ConcreteFace::rim_inner || seen.face == ConcreteFace::rim_outer;
    if (plastic && effects_[Effect::rim_drop] != 0.0) factor *= kRimNoise;
    return noise_mm_ * factor;
  }

  [[nodiscard]] Vec3 point(std::size_t column, std::size_t row) {
    const std::size_t pixel = row * scanner_.columns + column;
    const Seen& seen = seen_[pixel];
    // The number of draws is constant, so that one effect does not change the random numbers of another.
    const std::uint64_t chance = random_.next();
    const std::uint64_t more = random_.next();
    const auto share = [](std::uint64_t bits) { return static_cast<double>(bits & 0xFFFFFFU) / 16777216.0; };
    if (std::isnan(seen.t)) {
      ++drawn_.no_return;
      return Vec3::Constant(kNoValue);
    }
    const Vec3 ray = optics_.ray(column, row);
    double t = static_cast<double>(seen.t);
    const Vec3 exact = optics_.origin() + t * ray;
    bool in_patch = false;
    if (effects_[Effect::patch] != 0.0) {
      const Vec3 on_block = T_block_scanner_ * exact - errors_.patch_centre;
      in_patch = std::hypot(on_block.x(), on_block.y()) < errors_.patch_radius_mm;
    }
    if (share(chance) < missing_share(seen, in_patch)) {
      ++drawn_.missing;
      return Vec3::Constant(kNoValue);
    }
    const std::size_t shared = row / 2 * ((scanner_.columns + 1) / 2) + column / 2;
    double off = noise_of(seen, in_patch) * std::sqrt(0.5) * static_cast<double>(own_[pixel] + shared_[shared]);
    off -= static_cast<double>(seen.nearer);
    if (effects_[Effect::ripple] != 0.0)
      off += kRipple_mm * effects_[Effect::ripple] *
             std::sin(2.0 * kPi * exact.y() / errors_.ripple_period_mm + errors_.ripple_phase);
    if (effects_[Effect::lens] != 0.0) {
      const double u = exact.x() / (0.5 * scanner_.field_x_mm);
      const double v = exact.y() / (0.5 * scanner_.field_y_mm);
      off += kLens_mm * effects_[Effect::lens] * errors_.lens.at(std::clamp(u, -1.0, 1.0), std::clamp(v, -1.0, 1.0));
    }
    if (effects_[Effect::flying] != 0.0) {
      const double step = step_beside(column, row);
      if (step != 0.0 && share(chance >> 24U) < std::min(1.0, kFlyingShare * effects_[Effect::flying]))
        t += step * share(more);
    }
    if (share(more >> 24U) < outlier_share_) {
      const double size = 1.0 + (kOutlier_mm - 1.0) * share(chance >> 40U);
      off += (more >> 63U) != 0 ? size : -size;
      ++drawn_.outliers;
    }
    Vec3 p = optics_.origin() + (t + off / ray.norm()) * ray;
    p *= errors_.scale;
    if (effects_[Effect::misfit] != 0.0 && row % 2 == 1) p = errors_.misfit * p;
    if (scanner_.step_mm > 0.0)
      for (int axis = 0; axis < 3; ++axis) p[axis] = std::round(p[axis] / scanner_.step_mm) * scanner_.step_mm;
    return p;
  }

  const ConcreteBlock& block_;
  EffectStrengths effects_;
  ConcreteScanner scanner_;
  ConcreteOptics optics_;
  Errors errors_;
  Pose T_block_scanner_;
  Prng random_;
  double noise_mm_ = 0.0;
  double outlier_share_ = 0.0;
  std::vector<float> own_, shared_;  ///< noise of each pixel, and of each 2 x 2 pixels
  std::vector<Seen> seen_;
  DrawnScan drawn_;
};

}  // namespace

ConcreteView concrete_view(const EffectStrengths& effects, std::uint64_t seed) {
  Prng random(derived_seed(seed, 602, 0));
  // The scanner is tilted and moved about the block's origin, so that the block stays in its field.
  const double direction = 2.0 * kPi * random.uniform();
  Pose tilt;
  tilt.rotation = Quat(Eigen::AngleAxisd(rad_from_deg(5.0 * effects[Effect::tilt]),
                                         Eigen::Vector3d(std::cos(direction), std::sin(direction), 0.0)));
  Pose above = nominal_T_block_scanner();
  above.translation_mm.z() += 25.0 * effects[Effect::standoff];
  ConcreteView view;
  view.T_block_scanner_reported = tilt * above;
  view.T_block_scanner_reported.translation_mm +=
      effects[Effect::offset] * Vec3(random.uniform() < 0.5 ? -15.0 : 15.0, random.uniform() < 0.5 ? -30.0 : 30.0, 0.0);
  Pose off;
  const double pose_mm = kPose_mm * effects[Effect::pose];
  const double pose_rad = rad_from_deg(kPose_deg * effects[Effect::pose]);
  off.translation_mm = Vec3(within(random, pose_mm), within(random, pose_mm), within(random, pose_mm));
  off.rotation = rotation_from_kuka_abc(within(random, pose_rad), within(random, pose_rad), within(random, pose_rad));
  view.T_scanner_block = (view.T_block_scanner_reported * off).inverse();
  return view;
}

ConcreteScan draw_concrete(const Recipe& recipe, const ConcreteOrder& order, const Pose& T_scanner_block,
                           const ConcreteScanner& scanner, std::uint64_t scan_seed, std::vector<float>& xyz) {
  ConcreteBlock block = ConcreteBlock::cast(recipe, order);
  if (order.effects[Effect::relief] != 0.0) {
    const ConcreteOptics optics(order, T_scanner_block, scanner);
    block.level_top(
        [&](double x, double y) { return optics.in_view(block, Vec3(x, y, block.field().height_mm(x, y))); });
  }
  Drawing drawing(block, order, T_scanner_block, scanner, scan_seed);
  ConcreteScan scan;
  scan.drawn = drawing.draw(xyz);
  scan.truth = block.truth();
  return scan;
}

void expand(double expansion, const Vec3& origin_mm, std::span<float> xyz) {
  if (expansion == 0.0) return;
  for (std::size_t i = 0; i < xyz.size(); ++i)
    xyz[i] +=
        static_cast<float>(expansion * (static_cast<double>(xyz[i]) - origin_mm[static_cast<Eigen::Index>(i % 3)]));
}

Result<DrawnBlock> draw_block(const Recipe& recipe, const StationTruth& station, const Pose& T_scanner_block,
                              const ScannerTraits& traits, std::uint64_t block_seed, std::uint64_t scan_seed,
                              std::vector<float>& xyz) {
  auto surface = BlockSurface::make(recipe, station.block, T_scanner_block, traits.projection);
  if (!surface) return surface.error();
  if (!traits.concrete) {
    ScannerTraits scanner = traits;
    scanner.noise_mm = station.noise_mm;
    scanner.outlier_share = station.outlier_share;
    return DrawnBlock{draw_scan(surface.value(), scanner, scan_seed, xyz), std::nullopt};
  }
  ConcreteScanner scanner;
  scanner.seed = traits.scanner_seed;
  scanner.columns = traits.columns;
  scanner.rows = traits.rows;
  scanner.field_x_mm = traits.field_x_mm;
  scanner.field_y_mm = traits.field_y_mm;
  scanner.organised = traits.organised;
  // A planted defect of this scan's noise or outliers replaces the effect.
  const StationTruth usual;
  if (station.noise_mm != usual.noise_mm) scanner.noise_mm = station.noise_mm;
  if (station.outlier_share != usual.outlier_share) scanner.outlier_share = station.outlier_share;
  ConcreteOrder order;
  order.truth = station.block;
  order.effects = *traits.concrete;
  order.defects = traits.damage;
  order.seed = block_seed;
  ConcreteScan drawn = draw_concrete(recipe, order, T_scanner_block, scanner, scan_seed, xyz);
  return DrawnBlock{drawn.drawn, std::move(drawn.truth)};
}

}  // namespace slabd::emulator
