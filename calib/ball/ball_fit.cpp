// SPDX-License-Identifier: Apache-2.0
//
// Fits a sphere to the points around a candidate: selection of the points on the cap, then the fit.
//
// The border of the cap is critical. Towards the silhouette the surface turns away from the rays and points smear.
// Along every visible edge, pixels mix foreground and background. Therefore points are used up to 60 degrees of
// incidence and not closer than 1.5 mm to an edge. An edge is a place next to an empty cell in a raster across the
// view. Incidence is computed from the ray only (its distance from the centre), because a selection by a point's own
// error would bias the centre.
//
// The estimate is geometric: the sum of Tukey's rho of |p - c| - R. The algebraic fit has an error of 5 to 80 um on
// caps.
#include "calib/ball/ball_fit.h"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>

namespace slabd::calib {
namespace {

constexpr double kTukeySigmas = 4.685;
constexpr double kMadToSigma = 1.4826;
constexpr int kIterationsMax = 60;
/// The scale is updated in the first steps, then it is fixed and the iteration must converge.
constexpr int kScaleSteps = 8;
constexpr double kStep_mm = 1e-8;
constexpr std::size_t kPointsLeast = 60;

/// Largest rms of a free fit, relative to the scanner's noise, for which the surface still counts as a sphere.
constexpr double kSphereRms = 6.0;
constexpr double kSphereRadiusOff = 0.25;  // as a share of the radius

double median_of(std::vector<double>& values) {
  const auto middle = values.begin() + static_cast<std::ptrdiff_t>(values.size() / 2);
  std::nth_element(values.begin(), middle, values.end());
  return *middle;
}

/// Distance of the ray to `p` from the centre, divided by the radius: the sine of its incidence on the sphere.
double sine_of_incidence(const Vec3& p, const Vec3& viewpoint, const Vec3& centre, double radius) {
  return (centre - viewpoint).cross(p - viewpoint).norm() / ((p - viewpoint).norm() * radius);
}

/// Visible part of the ball in cells across the view; used to find the distance of a place from the nearest edge.
class SeenRaster {
 public:
  SeenRaster(double cell_mm, double reach_mm)
      : cell_mm_(cell_mm),
        size_(2 * static_cast<int>(std::ceil(reach_mm / cell_mm)) + 5),
        seen_(static_cast<std::size_t>(size_) * static_cast<std::size_t>(size_), 0) {}

  void mark(double x, double y) { seen_[at(index(x), index(y))] = 1; }

  /// Fills an empty cell with at least six filled neighbours: some pixels are missing, but it is not an edge.
  void close_gaps() {
    std::vector<std::uint8_t> closed = seen_;
    for (int y = 1; y + 1 < size_; ++y)
      for (int x = 1; x + 1 < size_; ++x) {
        int around = 0;
        for (int dy = -1; dy <= 1; ++dy)
          for (int dx = -1; dx <= 1; ++dx) around += seen_[at(x + dx, y + dy)];
        if (around >= 6) closed[at(x, y)] = 1;
      }
    seen_ = std::move(closed);
  }

  /// Clears every cell with an empty one within `rim_mm`.
  void erode(double rim_mm) {
    const int reach = static_cast<int>(std::ceil(rim_mm / cell_mm_));
    std::vector<std::uint8_t> inner = seen_;
    for (int y = 0; y < size_; ++y)
      for (int x = 0; x < size_; ++x) {
        if (seen_[at(x, y)] != 0) continue;
        for (int dy = -reach; dy <= reach; ++dy)
          for (int dx = -reach; dx <= reach; ++dx) {
            if (std::hypot(dx, dy) * cell_mm_ > rim_mm) continue;
            if (x + dx < 0 || x + dx >= size_ || y + dy < 0 || y + dy >= size_) continue;
            inner[at(x + dx, y + dy)] = 0;
          }
      }
    seen_ = std::move(inner);
  }
  [[nodiscard]] bool contains(double x, double y) const { return seen_[at(index(x), index(y))] != 0; }

 private:
  [[nodiscard]] int index(double v) const {
    return std::clamp(static_cast<int>(std::floor(v / cell_mm_)) + size_ / 2, 0, size_ - 1);
  }
  [[nodiscard]] std::size_t at(int x, int y) const {
    return static_cast<std::size_t>(y) * static_cast<std::size_t>(size_) + static_cast<std::size_t>(x);
  }
  double cell_mm_;
  int size_;
  std::vector<std::uint8_t> seen_;
};

/// Selects the points of `near` on the cap of this sphere that pass incidence limit and rim.
CapPoints select_cap(std::span<const Vec3> near, const SphereFit& sphere, const BallSettings& settings, double shell,
                     std::uint64_t& on_sphere) {
  const Mat3 axes = view_axes(sphere.centre_mm, settings.viewpoint_mm);
  struct OnCap {
    Vec3 p;
    double x, y, incidence;
  };
  std::vector<OnCap> cap;
  std::size_t central = 0;  // points in the middle, to estimate the pitch
  const double middle_mm = 0.5 * sphere.radius_mm;
  for (const Vec3& p : near) {
    const Vec3 d = p - sphere.centre_mm;
    if (std::abs(d.norm() - sphere.radius_mm) > shell || d.dot(axes.col(2)) < 0.0) continue;
    const double sine = sine_of_incidence(p, settings.viewpoint_mm, sphere.centre_mm, sphere.radius_mm);
    const double x = d.dot(axes.col(0));
    const double y = d.dot(axes.col(1));
    cap.push_back({p, x, y, std::asin(std::min(1.0, sine))});
    if (x * x + y * y < middle_mm * middle_mm) ++central;
  }
  on_sphere = cap.size();
  if (cap.empty()) return {};
  const double pitch = std::sqrt(kPi * middle_mm * middle_mm / static_cast<double>(std::max<std::size_t>(central, 1)));
  SeenRaster raster(std::clamp(2.2 * pitch, 0.3, 0.2 * sphere.radius_mm), 1.2 * sphere.radius_mm);
  for (const OnCap& c : cap) raster.mark(c.x, c.y);
  raster.close_gaps();
  raster.erode(settings.rim_mm);
  CapPoints chosen;
  for (const OnCap& c : cap) {
    if (c.incidence > settings.incidence_max_rad || !raster.contains(c.x, c.y)) continue;
    chosen.p_mm.push_back(c.p);
    chosen.incidence_rad.push_back(c.incidence);
  }
  return chosen;
}

/// Measures the extent of the cap in each of 36 sectors: the incidence exceeded by five of the sector's points.
void measure_extent(const CapPoints& cap, const SphereFit& fit, const BallSettings& settings, BallReport& report) {
  constexpr std::size_t kSectors = 36;
  constexpr std::size_t kSteps = 180;  // steps of half a degree
  constexpr std::uint32_t kPointsPast = 5;
  const Mat3 axes = view_axes(fit.centre_mm, settings.viewpoint_mm);
  std::array<std::array<std::uint32_t, kSteps>, kSectors> counts{};
  for (std::size_t i = 0; i < cap.p_mm.size(); ++i) {
    const Vec3 d = cap.p_mm[i] - fit.centre_mm;
    if (tukey(d.norm() - fit.radius_mm, fit.scale_mm).weight == 0.0) continue;
    const double azimuth = std::atan2(d.dot(axes.col(1)), d.dot(axes.col(0))) + kPi;
    const auto sector = std::min(kSectors - 1, static_cast<std::size_t>(azimuth / (2.0 * kPi) * kSectors));
    const auto step = std::min(kSteps - 1, static_cast<std::size_t>(cap.incidence_rad[i] / (0.5 * kPi) * kSteps));
    ++counts[sector][step];
  }
  std::vector<double> reaches;
  Vec3 missing = Vec3::Zero();
  int covered = 0;
  const double reach_min = settings.half_angle_min_rad - rad_from_deg(10.0);
  for (std::size_t sector = 0; sector < kSectors; ++sector) {
    std::uint32_t past = 0;
    std::size_t step = kSteps;
    while (step > 0 && past < kPointsPast) past += counts[sector][--step];
    const double reach = past < kPointsPast ? 0.0 : (static_cast<double>(step) + 1.0) / kSteps * 0.5 * kPi;
    if (reach > 0.0) reaches.push_back(reach);
    if (reach >= reach_min) {
      ++covered;
    } else {
      const double azimuth = (static_cast<double>(sector) + 0.5) / kSectors * 2.0 * kPi - kPi;
      missing += std::cos(azimuth) * axes.col(0) + std::sin(azimuth) * axes.col(1);
    }
  }
  report.azimuth_rad = covered * 2.0 * kPi / kSectors;
  report.missing_side = missing.norm() > 1e-9 ? Vec3(missing.normalized()) : Vec3(Vec3::Zero());
  if (reaches.empty()) {
    report.half_angle_rad = 0.0;
    return;
  }
  // Median over the sectors that reach the cap's flank, if any, because a hidden side is a separate fault.
  std::sort(reaches.begin(), reaches.end());
  const auto first = covered > 0 ? std::lower_bound(reaches.begin(), reaches.end(), reach_min) : reaches.begin();
  report.half_angle_rad = *(first + (reaches.end() - first) / 2);
}

}  // namespace

TukeyWeight tukey(double residual_mm, double scale_mm) {
  const double t = residual_mm / (kTukeySigmas * scale_mm);
  const double t2 = t * t;
  if (!(t2 < 1.0)) return {};
  return {(1.0 - t2) * (1.0 - t2), (1.0 - t2) * (1.0 - 5.0 * t2)};
}

Mat3 view_axes(const Vec3& centre_mm, const Vec3& viewpoint_mm) {
  const Vec3 towards = (viewpoint_mm - centre_mm).normalized();
  // As close to scanner X as possible, so that sides can be named.
  const Vec3 seed = std::abs(towards.x()) < 0.9 ? Vec3(Vec3::UnitX()) : Vec3(Vec3::UnitY());
  Mat3 axes;
  axes.col(2) = towards;
  axes.col(0) = (seed - seed.dot(towards) * towards).normalized();
  axes.col(1) = axes.col(2).cross(axes.col(0));
  return axes;
}

double shell_mm(const BallSettings& settings) {
  return std::max(8.0 * settings.noise_mm, 0.08 * settings.radius_mm);
}

SphereFit fit_sphere(std::span<const Vec3> points_mm, const Vec3& centre_mm, double radius_mm, bool free_radius) {
  SphereFit fit;
  fit.centre_mm = centre_mm;
  fit.radius_mm = radius_mm;
  if (points_mm.size() < kPointsLeast) return fit;
  const int unknowns = free_radius ? 4 : 3;
  std::vector<double> sizes(points_mm.size());
  for (fit.iterations = 1; fit.iterations <= kIterationsMax; ++fit.iterations) {
    if (fit.iterations <= kScaleSteps) {
      for (std::size_t i = 0; i < points_mm.size(); ++i)
        sizes[i] = std::abs((points_mm[i] - fit.centre_mm).norm() - fit.radius_mm);
      // Points without any noise (a drawing) would give a scale of zero.
      fit.scale_mm = std::max(kMadToSigma * median_of(sizes), 1e-6);
    }
    Eigen::Matrix4d normal = Eigen::Matrix4d::Zero();
    Eigen::Vector4d right = Eigen::Vector4d::Zero();
    double squares = 0.0;
    fit.kept = 0;
    for (const Vec3& p : points_mm) {
      const Vec3 d = p - fit.centre_mm;
      const double length = d.norm();
      const double residual = length - fit.radius_mm;
      const double weight = tukey(residual, fit.scale_mm).weight;
      if (weight == 0.0 || length == 0.0) continue;
      const Eigen::Vector4d g(d.x() / length, d.y() / length, d.z() / length, 1.0);
      normal += weight * g * g.transpose();
      right += weight * residual * g;
      squares += residual * residual;
      ++fit.kept;
    }
    if (fit.kept < kPointsLeast) return fit;
    fit.rms_mm = std::sqrt(squares / static_cast<double>(fit.kept - 3));
    Eigen::Vector4d step = Eigen::Vector4d::Zero();
    step.head(unknowns) = normal.topLeftCorner(unknowns, unknowns).ldlt().solve(right.head(unknowns));
    if (!step.allFinite() || step.norm() > radius_mm) return fit;
    fit.centre_mm += Vec3(step.head<3>());
    fit.radius_mm += step[3];
    if (fit.iterations >= kScaleSteps && step.norm() < kStep_mm) {
      fit.ok = true;
      return fit;
    }
  }
  fit.iterations = kIterationsMax;
  return fit;
}

bool measure_ball(std::span<const Vec3> near_mm, const Vec3& start_mm, const BallSettings& settings,
                  BallReport& report) {
  // Coarse fit with free radius, which separates a wrong radius from a bad surface.
  SphereFit coarse;
  coarse.centre_mm = start_mm;
  coarse.radius_mm = settings.radius_mm;
  double shell = shell_mm(settings);
  for (int pass = 0; pass < 3; ++pass) {
    const CapPoints cap = select_cap(near_mm, coarse, settings, shell, report.points_near);
    coarse = fit_sphere(cap.p_mm, coarse.centre_mm, coarse.radius_mm, true);
    if (coarse.kept < kPointsLeast || !coarse.centre_mm.allFinite()) return false;
    shell = std::max({8.0 * settings.noise_mm, 8.0 * coarse.scale_mm, 0.02 * settings.radius_mm});
  }
  if (coarse.rms_mm > std::max(kSphereRms * settings.noise_mm, 0.01 * settings.radius_mm) ||
      std::abs(coarse.radius_mm - settings.radius_mm) > kSphereRadiusOff * settings.radius_mm)
    return false;

  const CapPoints cap = select_cap(near_mm, coarse, settings, shell, report.points_near);
  report.points_offered = cap.p_mm.size();
  const SphereFit fixed = fit_sphere(cap.p_mm, coarse.centre_mm, settings.radius_mm, false);
  if (fixed.kept < kPointsLeast || !fixed.centre_mm.allFinite()) return false;
  const SphereFit free = fit_sphere(cap.p_mm, fixed.centre_mm, settings.radius_mm, true);
  report.converged = fixed.ok;
  report.centre_mm = fixed.centre_mm;
  report.points_used = fixed.kept;
  report.iterations = fixed.iterations;
  report.rms_mm = fixed.rms_mm;
  report.kept_share = static_cast<double>(fixed.kept) / static_cast<double>(cap.p_mm.size());
  if (free.ok) {
    report.radius_free_mm = free.radius_mm;
    report.centre_free_mm = free.centre_mm;
    // Computed from its own residuals, because those of a wrong fixed radius are not noise.
    report.radius_free_sigma_mm =
        cap_noise(cap.p_mm, free, settings.viewpoint_mm, settings.noise_correlation_mm).radius_sigma_mm;
  }
  measure_extent(cap, fixed, settings, report);
  const CapNoise noise = cap_noise(cap.p_mm, fixed, settings.viewpoint_mm, settings.noise_correlation_mm);
  report.cov_white_mm2 = noise.cov_white_mm2;
  report.cov_correlated_mm2 = noise.cov_correlated_mm2;
  report.shift_per_radius = noise.shift_per_radius;
  report.correlated_mm = noise.correlated_mm;
  report.correlation_length_mm = noise.correlation_length_mm;
  return true;
}

}  // namespace slabd::calib
