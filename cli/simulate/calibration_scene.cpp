// SPDX-License-Identifier: Apache-2.0
//
// Three steps: the scene in the target's frame, its depth in every pixel from the real scanner pose, and the scanner's
// errors: shadows of the projector, gaps, noise of both kinds, mixed points at edges, outliers.
#include "cli/simulate/calibration_scene.h"

#include <algorithm>
#include <cmath>
#include <limits>

#include "emulator/slab_scene.h"
#include "emulator/solid_scene.h"

namespace slabd::cli::simulate {
namespace {

/// Beyond this incidence a matt surface gives no usable return.
const double kIncidenceCosineMin = std::cos(rad_from_deg(80.0));
/// A depth step that counts as an edge.
constexpr double kEdge_mm = 2.0;
constexpr double kPostRadius_mm = 6.0;
constexpr double kTableBelow_mm = 130.0;
constexpr double kFrameBelow_mm = 60.0;
const Eigen::Vector2d kPlateHalf_mm(100.0, 70.0);
/// Range of target positions that are completely in the picture (350 x 500 mm at 600 mm), and of the scanner's tilt. A
/// block is only registered from near its nominal view.
struct ViewRange {
  double free_x_mm, free_y_mm;  ///< from the centre, at 600 mm
  double near_mm, far_mm;
  double tilt_min_deg, tilt_max_deg;
  double roll_deg;
};
ViewRange range_of(TargetKind kind) {
  switch (kind) {
    case TargetKind::ball: return {105.0, 150.0, 540.0, 660.0, 20.0, 35.0, 90.0};
    case TargetKind::artefact: return {25.0, 70.0, 570.0, 640.0, 20.0, 35.0, 90.0};
    case TargetKind::plate: return {60.0, 120.0, 540.0, 660.0, 0.0, 25.0, 20.0};
    case TargetKind::block: break;
  }
  return {15.0, 5.0, 590.0, 630.0, 0.0, 7.0, 5.0};
}

constexpr std::uint64_t kViewStream = 21;
constexpr std::uint64_t kScanStream = 22;

double within(Prng& random, double amplitude) {
  return amplitude * (2.0 * random.uniform() - 1.0);
}

/// Ball centres that are not flat and whose distances differ by at least 15 mm.
std::vector<Vec3> artefact_balls() {
  return {Vec3(-78.0, -52.0, 0.0), Vec3(92.0, -40.0, 12.0), Vec3(-20.0, 84.0, -10.0)};
}

calib::ArtefactCertificate certify(const CalibrationTraits& traits) {
  calib::ArtefactCertificate c;
  c.id = traits.kind == TargetKind::artefact ? "simulated-artefact" : "simulated-ball";
  c.date = "2026-01-01";
  c.issuer = "slabctl simulate";
  c.ball_radius_mm = traits.ball_radius_mm;
  c.ball_radius_sigma_mm = 0.001;
  c.sigma_mm = 0.001;
  if (traits.kind == TargetKind::artefact) c.balls_mm = artefact_balls();
  if (traits.kind == TargetKind::ball) c.balls_mm = {Vec3::Zero()};
  return c;
}

/// All objects except the block, in the target's frame.
emulator::Solids build(const CalibrationTraits& traits, const calib::ArtefactCertificate& certificate) {
  emulator::Solids solids;
  if (traits.kind == TargetKind::block) return solids;
  const double table_z = -(traits.ball_radius_mm + kTableBelow_mm);
  for (const Vec3& centre : certificate.balls_mm) {
    solids.balls.push_back({centre, traits.ball_radius_mm});
    const double foot = traits.kind == TargetKind::artefact ? -traits.ball_radius_mm - kFrameBelow_mm : table_z;
    solids.posts.push_back({centre, Vec3(centre.x(), centre.y(), foot), kPostRadius_mm});
  }
  if (traits.kind == TargetKind::artefact)
    solids.plates.push_back(
        {Vec3(0.0, 15.0, -traits.ball_radius_mm - kFrameBelow_mm), Vec3(125.0, 0.0, 0.0), Vec3(0.0, 105.0, 0.0)});
  if (traits.kind == TargetKind::plate) {
    // Lifted off the table, as its edges must be free.
    solids.plates.push_back({Vec3::Zero(), Vec3(kPlateHalf_mm.x(), 0.0, 0.0), Vec3(0.0, kPlateHalf_mm.y(), 0.0)});
    solids.posts.push_back({Vec3::Zero(), Vec3(0.0, 0.0, table_z), kPostRadius_mm});
  }
  if (!traits.clutter) return solids;
  solids.plates.push_back({Vec3(0.0, 0.0, table_z), Vec3(600.0, 0.0, 0.0), Vec3(0.0, 600.0, 0.0)});
  // A wall in the back, a rod, and a foreign ball.
  solids.plates.push_back({Vec3(-230.0, 0.0, table_z + 45.0), Vec3(0.0, 250.0, 0.0), Vec3(0.0, 0.0, 45.0)});
  solids.posts.push_back({Vec3(165.0, 130.0, table_z), Vec3(165.0, 130.0, table_z + 80.0), 10.0});
  solids.balls.push_back({Vec3(-150.0, 155.0, table_z + 0.7 * traits.ball_radius_mm), 0.7 * traits.ball_radius_mm});
  return solids;
}

/// Adds a plate before every ball, whose edge hides the given share of the visible disc.
void hide(emulator::Solids& solids_scanner, std::size_t balls, double share) {
  if (share <= 0.0) return;
  for (std::size_t k = 0; k < balls; ++k) {
    const emulator::Ball& ball = solids_scanner.balls[k];
    const double edge_x = (1.0 - 2.0 * share) * ball.radius_mm;
    const double half = 1.5 * ball.radius_mm;
    const Vec3 towards = -ball.centre_mm.normalized();
    const Vec3 across = (Vec3::UnitX() - towards.x() * towards).normalized();
    solids_scanner.plates.push_back({ball.centre_mm + (ball.radius_mm + 10.0) * towards + (edge_x + half) * across,
                                     half * across, half * towards.cross(across)});
  }
}

/// Converts the depth picture into a scan.
class ScanMaker {
 public:
  ScanMaker(const CalibrationScanTraits& traits, std::uint64_t seed, const emulator::Picture& picture,
            const emulator::Solids& solids)
      : traits_(traits), seed_(seed), picture_(picture), solids_(solids) {
    if (traits.correlated_mm > 0.0) {
      emulator::ScannerTraits grid;
      grid.columns = picture.columns;
      grid.rows = picture.rows;
      grid.field_x_mm = picture.field_x_mm;
      grid.field_y_mm = picture.field_y_mm;
      grid.noise_correlation_mm = traits.correlation_length_mm;
      field_ = emulator::noise_field(grid, emulator::derived_seed(seed, 1, 0));
    }
  }

  emulator::DrawnScan make(std::vector<float>& xyz) const {
    emulator::DrawnScan drawn;
    Prng random(seed_);
    xyz.clear();
    xyz.reserve(3 * picture_.depth_mm.size());
    for (std::size_t row = 0; row < picture_.rows; ++row)
      for (std::size_t column = 0; column < picture_.columns; ++column) {
        // Drawn for every pixel, so that a change of the scene does not change other pixels.
        Draws draws;
        draws.edge = random.uniform();
        draws.fault = random.uniform();
        draws.place = random.uniform();
        draws.noise = random.normal();
        const Vec3 ray = picture_.ray(column, row);
        const double z = depth_of(row, column, ray, draws, drawn);
        if (std::isnan(z) && !traits_.organised) continue;
        for (int axis = 0; axis < 3; ++axis)
          xyz.push_back(std::isnan(z) ? std::numeric_limits<float>::quiet_NaN() : static_cast<float>(z * ray[axis]));
        drawn.valid += std::isnan(z) ? 0U : 1U;
      }
    if (traits_.organised) {
      drawn.width = picture_.columns;
      drawn.height = picture_.rows;
    }
    return drawn;
  }

 private:
  [[nodiscard]] double at(std::size_t row, std::size_t column) const {
    return static_cast<double>(picture_.depth_mm[row * picture_.columns + column]);
  }

  /// Random numbers of one pixel.
  struct Draws {
    double edge = 0.0;   ///< for a mixed point at an edge
    double fault = 0.0;  ///< for a missing point or an outlier
    double place = 0.0;  ///< position between front and back, or distance of an outlier
    double noise = 0.0;  ///< standard normal
  };

  /// Largest distance of a neighbour behind `z`; 0 without an edge.
  [[nodiscard]] double step_behind(std::size_t row, std::size_t column, double z) const {
    double behind = 0.0;
    const auto look = [&](std::size_t r, std::size_t c) {
      if (r < picture_.rows && c < picture_.columns) behind = std::max(behind, at(r, c) - z);  // NaN is ignored
    };
    look(row, column + 1);
    look(row, column - 1);
    look(row + 1, column);
    look(row - 1, column);
    return behind > kEdge_mm ? behind : 0.0;
  }

  /// Cosine of the incidence angle, from the neighbouring depths; 1 at the picture's border.
  [[nodiscard]] double incidence_cosine(std::size_t row, std::size_t column, const Vec3& ray, double z) const {
    if (row + 1 >= picture_.rows || column + 1 >= picture_.columns) return 1.0;
    const double right = at(row, column + 1);
    const double below = at(row + 1, column);
    if (std::isnan(right) || std::isnan(below)) return 1.0;
    const Vec3 a = right * picture_.ray(column + 1, row) - z * ray;
    const Vec3 b = below * picture_.ray(column, row + 1) - z * ray;
    return std::abs(a.cross(b).normalized().dot(ray.normalized()));
  }

  [[nodiscard]] bool in_shadow(const Vec3& p) const {
    if (traits_.projector_mm == 0.0) return false;
    const Vec3 projector(traits_.projector_mm, 0.0, 0.0);
    const Vec3 towards = projector - p;
    // The start is slightly off the surface.
    return solids_.first_met(p, towards, 0.5 / towards.norm()) < 1.0;
  }

  double depth_of(std::size_t row, std::size_t column, const Vec3& ray, const Draws& draws,
                  emulator::DrawnScan& drawn) const {
    const double z = at(row, column);
    if (std::isnan(z)) {
      ++drawn.no_return;
      return kNoValue;
    }
    const double behind = step_behind(row, column, z);
    if (behind > 0.0 && draws.edge < traits_.flyer_share) {
      ++drawn.outliers;
      return z + draws.place * behind;
    }
    if (draws.fault < traits_.missing_share) {
      ++drawn.missing;
      return kNoValue;
    }
    if (draws.fault < traits_.missing_share + traits_.outlier_share) {
      ++drawn.outliers;
      return z + (draws.place - 0.5) * 120.0;
    }
    const Vec3 p = z * ray;
    if (incidence_cosine(row, column, ray, z) < kIncidenceCosineMin || in_shadow(p)) {
      ++drawn.no_return;
      return kNoValue;
    }
    double further = traits_.noise_mm * draws.noise;
    if (!field_.empty())
      further += traits_.correlated_mm * static_cast<double>(field_[row * picture_.columns + column]);
    return z + further / ray.norm();
  }

  const CalibrationScanTraits& traits_;
  std::uint64_t seed_;
  const emulator::Picture& picture_;
  const emulator::Solids& solids_;
  std::vector<float> field_;
};

}  // namespace

std::string_view name(TargetKind kind) {
  switch (kind) {
    case TargetKind::ball: return "ball";
    case TargetKind::artefact: return "artefact";
    case TargetKind::block: return "block";
    case TargetKind::plate: return "plate";
  }
  return "?";
}

Result<CalibrationScene> CalibrationScene::make(const CalibrationTraits& traits, const Recipe* recipe) {
  if (!(traits.ball_radius_mm >= 5.0 && traits.ball_radius_mm <= 35.0))
    return error(Code::config, "ball radius %g mm: must be within 5 .. 35", traits.ball_radius_mm);
  if (traits.kind == TargetKind::block && recipe == nullptr)
    return error(Code::config, "a reference block needs a recipe with its shape");
  CalibrationScene scene;
  scene.traits_ = traits;
  scene.robot_ = emulator::RobotError(traits.robot);
  scene.certificate_ = certify(traits);
  if (recipe != nullptr) scene.recipe_ = *recipe;
  return scene;
}

std::vector<Pose> CalibrationScene::plan_views(int count) const {
  Prng random(emulator::derived_seed(traits_.seed, kViewStream, 0));
  const ViewRange range = range_of(traits_.kind);
  std::vector<Pose> flange;
  for (int i = 0; i < count; ++i) {
    // Golden sections distribute tilt, azimuth and roll evenly over any number of views.
    const auto spread = [&](double ratio) { return std::fmod(0.5 + ratio * i, 1.0); };
    const double tilt_deg = range.tilt_min_deg + (range.tilt_max_deg - range.tilt_min_deg) * spread(0.618034);
    const double tilt = rad_from_deg(std::max(0.0, tilt_deg + within(random, 1.0)));
    const double azimuth = 2.0 * kPi * spread(0.381966) + within(random, 0.1);
    const double roll = rad_from_deg(range.roll_deg * (2.0 * spread(0.7548777) - 1.0) + within(random, 3.0));
    const int corner = i % 5;
    const double side_x = corner == 0 ? 0.0 : (corner & 1) != 0 ? 1.0 : -1.0;
    const double side_y = corner == 0 ? 0.0 : (corner & 2) != 0 ? 1.0 : -1.0;
    const double depth = 0.5 * (range.near_mm + range.far_mm + (range.far_mm - range.near_mm) * (i % 3 - 1));
    const double scale = depth / emulator::kPictureDistance_mm;
    Pose T_target_scanner;
    const Vec3 axis(std::cos(azimuth), std::sin(azimuth), 0.0);
    T_target_scanner.rotation = Quat(Eigen::AngleAxisd(tilt, axis)) *
                                Quat(Eigen::AngleAxisd(kPi, Eigen::Vector3d::UnitX())) *
                                Quat(Eigen::AngleAxisd(roll, Eigen::Vector3d::UnitZ()));
    const Vec3 target_scanner(scale * (range.free_x_mm * side_x + within(random, 8.0)),
                              scale * (range.free_y_mm * side_y + within(random, 8.0)), depth + within(random, 5.0));
    T_target_scanner.translation_mm = -(T_target_scanner.rotation * target_scanner);
    flange.push_back(traits_.T_base_target * T_target_scanner * traits_.T_flange_scanner.inverse());
  }
  return flange;
}

Pose CalibrationScene::T_scanner_target(const Pose& T_base_flange, std::uint64_t visit) const {
  return (robot_.real(T_base_flange, visit) * traits_.T_flange_scanner).inverse() * traits_.T_base_target;
}

Result<emulator::DrawnScan> CalibrationScene::draw(const Pose& T_base_flange, std::uint64_t visit,
                                                   const CalibrationScanTraits& scan, std::vector<float>& xyz,
                                                   std::uint64_t shot) const {
  const Pose T_seen = T_scanner_target(T_base_flange, visit);
  if (!(T_seen.translation_mm.z() > 100.0))
    return error(Code::config, "the %s is not in front of the scanner", name(traits_.kind).data());
  emulator::Picture picture;
  picture.distance_mm = emulator::kPictureDistance_mm;
  picture.clear(scan.columns, scan.rows);
  emulator::Solids solids = build(traits_, certificate_).in_frame(T_seen);
  if (traits_.kind == TargetKind::block) {
    const Result<emulator::BlockSurface> surface = emulator::BlockSurface::make(
        *recipe_, emulator::nominal_truth(*recipe_), T_seen, emulator::Projection::perspective);
    if (!surface) return surface.error();
    for (std::size_t row = 0; row < picture.rows; ++row)
      for (std::size_t column = 0; column < picture.columns; ++column) {
        const Vec3 ray = emulator::kPictureDistance_mm * picture.ray(column, row);
        picture.depth_mm[row * picture.columns + column] =
            static_cast<float>(surface.value().depth_mm(ray.x(), ray.y()));
      }
  } else {
    hide(solids, certificate_.balls_mm.size(), scan.hidden_share);
  }
  picture.draw(solids);
  return ScanMaker(scan, emulator::derived_seed(traits_.seed, kScanStream + shot * 100U, visit), picture, solids)
      .make(xyz);
}

}  // namespace slabd::cli::simulate
