// SPDX-License-Identifier: Apache-2.0
#include "cli/scanner/acceptance.h"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <unordered_map>

#include "base/prng.h"
#include "calib/calib.h"

// Problem: U depends on assumptions about the scanner. Idea: scan objects whose shape is known better than the scanner
// measures. Two kinds of error are distinguished, because they act differently. Noise averages out over a feature as
// far as neighbouring points are uncorrelated; form does not. Sums are in the order of the points, so the same scan
// gives the same figures.
namespace slabd::cli {
namespace {

constexpr std::size_t kPlatePointsMin = 10'000;
constexpr std::size_t kTriples = 300;  ///< half of the points may be other objects: 1 - (1 - 0.5^3)^300 = 1 - 4e-18
constexpr std::size_t kSampleMax = 5'000;

struct Plane {
  Vec3 centre = Vec3::Zero();
  Vec3 n = Vec3::UnitZ();
  [[nodiscard]] double distance(const Vec3& p) const { return n.dot(p - centre); }
};

std::vector<Vec3> finite_points(std::span<const float> xyz) {
  std::vector<Vec3> points;
  points.reserve(xyz.size() / 3);
  for (std::size_t i = 0; i + 2 < xyz.size(); i += 3) {
    const Vec3 p(static_cast<double>(xyz[i]), static_cast<double>(xyz[i + 1]), static_cast<double>(xyz[i + 2]));
    if (p.allFinite()) points.push_back(p);
  }
  return points;
}

/// Least-squares plane of the points within `gate_mm` of `start`.
Plane refined(const std::vector<Vec3>& points, const Plane& start, double gate_mm) {
  Vec3 sum = Vec3::Zero();
  std::size_t count = 0;
  for (const Vec3& p : points)
    if (std::abs(start.distance(p)) <= gate_mm) {
      sum += p - start.centre;
      ++count;
    }
  if (count < 3) return start;
  Plane plane;
  plane.centre = start.centre + sum / static_cast<double>(count);
  Mat3 scatter = Mat3::Zero();
  for (const Vec3& p : points)
    if (std::abs(start.distance(p)) <= gate_mm) scatter += (p - plane.centre) * (p - plane.centre).transpose();
  plane.n = Eigen::SelfAdjointEigenSolver<Mat3>(scatter).eigenvectors().col(0);
  if (plane.n.dot(start.n) < 0.0) plane.n = -plane.n;
  return plane;
}

/// The plane with the most points within the gate, refined by least squares.
Plane find_plane(const std::vector<Vec3>& points, const AcceptanceSettings& settings) {
  Prng prng(settings.seed);
  std::vector<Vec3> sample;
  for (std::size_t i = 0; i < std::min(kSampleMax, points.size()); ++i)
    sample.push_back(points[prng.below(points.size())]);
  Plane best;
  std::size_t most = 0;
  for (std::size_t t = 0; t < kTriples; ++t) {
    const Vec3& a = sample[prng.below(sample.size())];
    const Vec3& b = sample[prng.below(sample.size())];
    const Vec3& c = sample[prng.below(sample.size())];
    const Vec3 n = (b - a).cross(c - a);
    if (n.norm() < 1.0) continue;
    const Plane plane{a, n.normalized()};
    const auto count = static_cast<std::size_t>(std::count_if(
        sample.begin(), sample.end(), [&](const Vec3& p) { return std::abs(plane.distance(p)) <= settings.gate_mm; }));
    if (count > most) {
      most = count;
      best = plane;
    }
  }
  for (int round = 0; round < 3; ++round) best = refined(points, best, settings.gate_mm);
  return best;
}

/// Range of the residuals without the few largest ones; `rejected` is their number.
double range_of(std::vector<double> residuals, std::size_t& rejected) {
  rejected = static_cast<std::size_t>(kRejectedShareMax * static_cast<double>(residuals.size()));
  const std::size_t kept = residuals.size() - rejected;
  const auto nearer = [](double a, double b) { return std::abs(a) < std::abs(b); };
  if (rejected != 0)
    std::nth_element(residuals.begin(), residuals.begin() + static_cast<std::ptrdiff_t>(kept), residuals.end(), nearer);
  const auto [low, high] =
      std::minmax_element(residuals.begin(), residuals.begin() + static_cast<std::ptrdiff_t>(kept));
  return *high - *low;
}

double rms_of(const std::vector<double>& residuals) {
  double sum = 0.0;
  for (const double r : residuals) sum += r * r;
  return std::sqrt(sum / static_cast<double>(residuals.size()));
}

/// Coordinates on the plate, scaled to about -1 .. 1.
struct PlateFrame {
  Plane plane;
  Vec3 along;
  Vec3 across;
  Vec3 low = Vec3::Constant(1e300);
  Vec3 high = Vec3::Constant(-1e300);

  explicit PlateFrame(const Plane& p) : plane(p) {
    along = (std::abs(p.n.x()) < 0.9 ? Vec3::UnitX() : Vec3::UnitY()).cross(p.n).normalized();
    across = p.n.cross(along);
  }
  [[nodiscard]] Vec3 of(const Vec3& p) const {
    const Vec3 d = p - plane.centre;
    return {along.dot(d), across.dot(d), plane.n.dot(d)};
  }
  void widen(const Vec3& q) {
    low = low.cwiseMin(q);
    high = high.cwiseMax(q);
  }
  [[nodiscard]] double scale() const { return 0.5 * std::max(high.x() - low.x(), high.y() - low.y()); }
};

constexpr int kFormTerms = 15;  ///< terms of a polynomial of 4th order in two variables
using Terms = Eigen::Matrix<double, kFormTerms, 1>;

Terms terms_at(double u, double v) {
  Terms t;
  int k = 0;
  for (int i = 0; i <= 4; ++i)
    for (int j = 0; i + j <= 4; ++j) t[k++] = std::pow(u, i) * std::pow(v, j);
  return t;
}

/// The smooth part of the plate's residuals.
class Form {
 public:
  Form(const PlateFrame& frame, const std::vector<Vec3>& q) : scale_(frame.scale()) {
    Eigen::Matrix<double, kFormTerms, kFormTerms> normal = decltype(normal)::Zero();
    Terms right = Terms::Zero();
    const std::size_t step = std::max<std::size_t>(1, q.size() / 200'000);  // form is smooth: a sample is enough
    for (std::size_t i = 0; i < q.size(); i += step) {
      const Terms t = terms_at(q[i].x() / scale_, q[i].y() / scale_);
      normal.noalias() += t * t.transpose();
      right += q[i].z() * t;
    }
    coefficients_ = normal.ldlt().solve(right);
  }
  [[nodiscard]] double at(const Vec3& q) const { return coefficients_.dot(terms_at(q.x() / scale_, q.y() / scale_)); }

 private:
  double scale_;
  Terms coefficients_;
};

/// Figures from the plate's cells: the scanner's form error, and the length over which it was measured.
struct CellFigures {
  double form_half_mm = kNoValue;  ///< half the range of the means of cells that are well filled
  double length_mm = kNoValue;     ///< longest distance across them
};

CellFigures figures_of_cells(const std::vector<Vec3>& q, double cell_mm) {
  struct Cell {
    double sum = 0.0;
    std::size_t count = 0;
  };
  const auto key_of = [cell_mm](const Vec3& p) {
    const auto column = static_cast<std::uint64_t>(static_cast<std::int64_t>(std::floor(p.x() / cell_mm)) + (1 << 20));
    const auto row = static_cast<std::uint64_t>(static_cast<std::int64_t>(std::floor(p.y() / cell_mm)) + (1 << 20));
    return (column << 32U) | row;
  };
  std::unordered_map<std::uint64_t, Cell> cells;
  std::size_t most = 0;
  for (const Vec3& p : q) {
    Cell& cell = cells[key_of(p)];
    cell.sum += p.z();
    most = std::max(most, ++cell.count);
  }
  double low = 1e300;
  double high = -1e300;
  for (auto& [key, cell] : cells) {
    if (2 * cell.count < most) {
      cell.count = 0;  // at the border, or points of another object that the plane passes through
      continue;
    }
    const double mean = cell.sum / static_cast<double>(cell.count);
    low = std::min(low, mean);
    high = std::max(high, mean);
  }
  if (high < low) return {};
  // Width in 16 directions; between two of them the error is at most 0.5 %, which only makes U larger.
  constexpr int kDirections = 16;
  std::array<double, kDirections> least;
  std::array<double, kDirections> most_along;
  least.fill(1e300);
  most_along.fill(-1e300);
  std::array<Eigen::Vector2d, kDirections> direction;
  for (int i = 0; i < kDirections; ++i) {
    const double angle_rad = kPi * static_cast<double>(i) / kDirections;
    direction[static_cast<std::size_t>(i)] = {std::cos(angle_rad), std::sin(angle_rad)};
  }
  for (const Vec3& p : q) {
    if (cells[key_of(p)].count == 0) continue;
    for (std::size_t i = 0; i < kDirections; ++i) {
      const double along = direction[i].dot(p.head<2>());
      least[i] = std::min(least[i], along);
      most_along[i] = std::max(most_along[i], along);
    }
  }
  CellFigures figures{0.5 * (high - low), 0.0};
  for (std::size_t i = 0; i < kDirections; ++i)
    figures.length_mm = std::max(figures.length_mm, most_along[i] - least[i]);
  return figures;
}

/// Lags of the autocovariance along the rows of the grid.
constexpr std::size_t kLagsMax = 64;

NoiseFigures noise_of(std::span<const float> xyz, const ScanShape& shape, const PlateFrame& frame, const Form& form,
                      const std::vector<Vec3>& q, double gate_mm) {
  NoiseFigures noise;
  double sum2 = 0.0;
  for (const Vec3& p : q) {
    const double r = p.z() - form.at(p);
    sum2 += r * r;
  }
  noise.sigma_mm = std::sqrt(sum2 / static_cast<double>(q.size()));
  if (shape.width < 2 * kLagsMax || shape.height == 0) return noise;
  // Single far points would only add white noise to the correlated part.
  const double far_mm = std::min(gate_mm, 6.0 * noise.sigma_mm);
  std::array<double, kLagsMax + 1> product{};
  std::array<std::size_t, kLagsMax + 1> pairs{};
  std::vector<double> row(shape.width);
  double pitch_sum = 0.0;
  std::size_t pitch_count = 0;
  const std::size_t row_step = std::max<std::size_t>(1, shape.height / 400);  // 400 rows are enough
  for (std::size_t r = 0; r < shape.height; r += row_step) {
    Vec3 before = Vec3::Constant(kNoValue);
    for (std::size_t c = 0; c < shape.width; ++c) {
      const float* p = &xyz[3 * (r * shape.width + c)];
      const Vec3 here = frame.of({static_cast<double>(p[0]), static_cast<double>(p[1]), static_cast<double>(p[2])});
      const double residual = here.allFinite() && std::abs(here.z()) <= gate_mm ? here.z() - form.at(here) : kNoValue;
      row[c] = std::abs(residual) <= far_mm ? residual : kNoValue;
      if (const double step = std::hypot(here.x() - before.x(), here.y() - before.y()); std::isfinite(step)) {
        pitch_sum += step;
        ++pitch_count;
      }
      before = here;
    }
    for (std::size_t lag = 0; lag <= kLagsMax; ++lag)
      for (std::size_t c = 0; c + lag < row.size(); ++c) {
        const double both = row[c] * row[c + lag];
        if (std::isnan(both)) continue;
        product[lag] += both;
        ++pairs[lag];
      }
  }
  if (pitch_count == 0 || pairs[0] == 0) return noise;
  noise.pitch_mm = pitch_sum / static_cast<double>(pitch_count);
  const double variance = product[0] / static_cast<double>(pairs[0]);
  double last = 1.0;
  for (std::size_t lag = 1; lag <= kLagsMax && pairs[lag] != 0; ++lag) {
    const double share = product[lag] / static_cast<double>(pairs[lag]) / variance;
    constexpr double kFallen = 0.36787944117144233;  // 1/e
    if (share <= kFallen) {
      // Neighbours are uncorrelated: the length is below the resolution.
      noise.correlation_mm = lag == 1 && share < 0.05
                                 ? 0.0
                                 : noise.pitch_mm * (static_cast<double>(lag - 1) + (last - kFallen) / (last - share));
      break;
    }
    last = share;
    // Larger lags are not computed: the length is at least this.
    if (lag == kLagsMax) noise.correlation_mm = noise.pitch_mm * static_cast<double>(kLagsMax);
  }
  return noise;
}

struct Sphere {
  Vec3 centre;
  double radius;
};

/// Least-squares fit of the radial distances, with free radius.
Sphere fit_sphere(const std::vector<Vec3>& points, Sphere sphere) {
  for (int round = 0; round < 20; ++round) {
    Eigen::Matrix4d normal = Eigen::Matrix4d::Zero();
    Eigen::Vector4d right = Eigen::Vector4d::Zero();
    for (const Vec3& p : points) {
      const Vec3 d = p - sphere.centre;
      const double length = d.norm();
      Eigen::Vector4d j;
      j << d / length, 1.0;
      normal.noalias() += j * j.transpose();
      right += (length - sphere.radius) * j;
    }
    const Eigen::Vector4d step = normal.ldlt().solve(right);
    sphere.centre += step.head<3>();
    sphere.radius += step[3];
    if (step.norm() < 1e-9) break;
  }
  return sphere;
}

}  // namespace

Result<PlateFigures> judge_plate(std::span<const float> xyz, const ScanShape& shape,
                                 const AcceptanceSettings& settings) {
  const std::vector<Vec3> points = finite_points(xyz);
  if (points.size() < kPlatePointsMin)
    return error(Code::too_few_points, "%zu finite points, a plate needs %zu", points.size(), kPlatePointsMin);
  PlateFrame frame(find_plane(points, settings));
  std::vector<Vec3> q;
  std::vector<double> residuals;
  std::size_t beside = 0;
  for (const Vec3& p : points) {
    const Vec3 on = frame.of(p);
    if (std::abs(on.z()) > settings.gate_mm) {
      if (std::abs(on.z()) <= kBesideGates * settings.gate_mm) ++beside;
      continue;
    }
    q.push_back(on);
    frame.widen(on);
    residuals.push_back(on.z());
  }
  if (q.size() < kPlatePointsMin)
    return error(Code::too_few_points, "the plane with the most points has %zu within %.2f mm, needed are %zu",
                 q.size(), settings.gate_mm, kPlatePointsMin);
  if (const double near = static_cast<double>(beside + q.size()); static_cast<double>(beside) > kBesideShareMax * near)
    return error(
        Code::block_not_found,
        "%.0f %% of the points near the plane lie %.2f to %.2f mm off it, allowed are %.0f %%: the plate is not "
        "flat, or there is an object beside it",
        100.0 * static_cast<double>(beside) / near, settings.gate_mm, kBesideGates * settings.gate_mm,
        100.0 * kBesideShareMax);
  PlateFigures figures;
  figures.points = q.size();
  figures.centre_mm = frame.plane.centre;
  figures.normal = frame.plane.n.dot(frame.plane.centre) > 0.0 ? Vec3(-frame.plane.n) : frame.plane.n;
  figures.rms_mm = rms_of(residuals);
  figures.RF_mm = range_of(std::move(residuals), figures.rejected);
  const CellFigures of_cells = figures_of_cells(q, settings.form_cell_mm);
  figures.form_half_mm = of_cells.form_half_mm;
  figures.length_mm = of_cells.length_mm;
  const Form form(frame, q);
  figures.noise = noise_of(xyz, shape, frame, form, q, settings.gate_mm);
  return figures;
}

Result<BallFigures> judge_ball(std::span<const float> xyz, double diameter_mm, const AcceptanceSettings& settings) {
  calib::BallSettings search;
  search.radius_mm = 0.5 * diameter_mm;
  const Result<calib::BallView> view = calib::find_balls(xyz, search);
  if (!view) return view.error();
  // The gates of a calibration are stricter than those of a scanner test, because a bad scanner must also get figures.
  if (view.value().balls.empty() || !view.value().balls[0].centre_mm.allFinite())
    return error(Code::block_not_found, "no ball of %.3f mm: %s", diameter_mm, view.value().words.reason.c_str());
  Sphere sphere{view.value().balls[0].centre_mm, search.radius_mm};
  std::vector<Vec3> on;
  const std::vector<Vec3> points = finite_points(xyz);
  for (int round = 0; round < 2; ++round) {
    on.clear();
    for (const Vec3& p : points) {
      const Vec3 d = p - sphere.centre;
      if (std::abs(d.norm() - sphere.radius) <= settings.gate_mm &&
          angle_between_rad(d, Vec3(-p)) <= settings.incidence_max_rad)
        on.push_back(p);
    }
    if (on.size() < 1'000) return error(Code::too_few_points, "%zu points on the ball, needed are 1000", on.size());
    sphere = fit_sphere(on, sphere);
  }
  std::vector<double> residuals;
  for (const Vec3& p : on) residuals.push_back((p - sphere.centre).norm() - sphere.radius);
  BallFigures figures;
  figures.points = on.size();
  figures.centre_mm = sphere.centre;
  figures.radius_mm = sphere.radius;
  figures.rms_mm = rms_of(residuals);
  figures.PS_mm = 2.0 * sphere.radius - diameter_mm;
  figures.PF_mm = range_of(std::move(residuals), figures.rejected);
  return figures;
}

}  // namespace slabd::cli
