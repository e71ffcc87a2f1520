// SPDX-License-Identifier: Apache-2.0
//
// Problem: an ICP that starts 15 mm or 3 degrees off converges to a wrong local minimum. So the whole window is
// searched first, in two independent halves.
//
// Height and tilt come from the scan itself. Its largest level plane is the bearing plane or the slab top; matching it
// to either fixes three of the six degrees of freedom (both are tried, for each of the three largest planes). The other
// three, shift and rotation in that plane, are searched exhaustively: every 4 mm and 2 degrees, counting the points on
// the model's surface. Edges make the right position win: 4 mm off, a strip of 4 mm along every step of the block
// disagrees by centimetres.
//
// Counting points near a surface is robust: dirt, gloves and missing regions lose only their own points.
#include "algo/register/block_search.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <utility>

#include "algo/algo.h"
#include "base/prng.h"

namespace slabd::algo {
namespace {

/// Number of points for finding level planes, and for comparing positions.
constexpr std::size_t kPlanePoints = 1024;
constexpr std::size_t kPlacePoints = 768;
static_assert(kPlacePoints % 16 == 0);
/// Three planes: bearing plane, slab top, and one that may be neither (a tray, the shoulders).
constexpr std::size_t kPlanes = 3;
static_assert(2 * kPlanes == kStartPosesMax, "each plane is read in two ways");
/// For a plane with a tenth of the points, one of 1000 draws has all three points on it with P = 1 - 0.999^1000.
constexpr int kDraws = 1000;
constexpr double kPlaneGate_mm = 1.0;
constexpr double kPlaneShareMin = 0.05;
/// Margin beyond the window's own angle: the cant, and a block that is slightly off.
constexpr double kTiltMargin_rad = rad_from_deg(3.0);
/// Height tolerance of a point relative to the raster: half a step on a 45 degree slope, and the effect of tilts.
constexpr float kHeightGate_mm = 3.0F;
constexpr double kTurnStep_rad = rad_from_deg(2.0);
/// Maximum number of steps to either side, independent of the recipe's window.
constexpr int kShiftStepsMax = 25;
constexpr int kTurnStepsMax = 8;
constexpr float kNowhere_mm = -1e6F;

using Sample = std::array<Vec3, kPlanePoints>;

/// Copies every n-th point of `from`, moved by `pose`.
std::size_t thin_out(std::span<const Vec3> from, const Pose& pose, std::span<Vec3> to) {
  const Mat3 R = pose.rotation.toRotationMatrix();
  const std::size_t count = std::min(from.size(), to.size());
  for (std::size_t i = 0; i < count; ++i) to[i] = R * from[i * from.size() / count] + pose.translation_mm;
  return count;
}

/// The plane through three of the points with the most points near it; upward normal, tilted by at most `tilt_max`.
bool largest_level_plane(std::span<const Vec3> points, double tilt_max_rad, Prng& prng, Plane& best) {
  const double upright_min = std::cos(tilt_max_rad);
  std::size_t most = 0;
  for (int draw = 0; draw < kDraws; ++draw) {
    const Vec3& a = points[prng.below(points.size())];
    const Vec3& b = points[prng.below(points.size())];
    const Vec3& c = points[prng.below(points.size())];
    Vec3 n = (b - a).cross(c - a);
    const double length = n.norm();
    if (!(length > 0.0)) continue;
    n /= n.z() < 0.0 ? -length : length;
    if (n.z() < upright_min) continue;
    const Plane plane{n, n.dot(a)};
    std::size_t near = 0;
    for (const Vec3& p : points) near += std::abs(plane.distance(p)) <= kPlaneGate_mm ? 1U : 0U;
    if (near <= most) continue;
    most = near;
    best = plane;
  }
  return static_cast<double>(most) >= std::max(3.0, kPlaneShareMin * static_cast<double>(points.size()));
}

/// Up to three level planes, largest first, each refitted to its points. Every point belongs to one plane only.
FixedVector<Plane, kPlanes> level_planes(std::span<Vec3> points, double tilt_max_rad) {
  FixedVector<Plane, kPlanes> planes;
  Prng prng(0x1e7e1U);
  while (!planes.full() && points.size() >= 3) {
    Plane plane;
    if (!largest_level_plane(points, tilt_max_rad, prng, plane)) break;
    // The plane's points go to the back: they are fitted, and the next plane is searched in the rest.
    std::size_t others = 0;
    for (std::size_t i = 0; i < points.size(); ++i)
      if (std::abs(plane.distance(points[i])) > kPlaneGate_mm) std::swap(points[others++], points[i]);
    const PlaneFit fit = fit_plane_lsq(points.subspan(others), plane.n);
    if (fit.ok) plane = {fit.normal, fit.offset_mm};
    (void)planes.push(plane);
    points = points.first(others);
  }
  return planes;
}

/// 0, -1, 1, -2, 2, ...: among equally good positions the one nearest to the start is kept.
int outward(int k) {
  return k % 2 == 0 ? k / 2 : -(k + 1) / 2;
}

/// Positions of the block in one plane, compared by the number of points they explain.
class PlaceSearch {
 public:
  PlaceSearch(const HeightMap& heights, const Plane& target, const EvaluationSettings& settings)
      : heights_(heights),
        target_(target),
        shifts_(std::min(static_cast<int>(std::ceil(settings.window_mm / HeightMap::kCell_mm)), kShiftStepsMax)),
        turns_(std::min(static_cast<int>(std::ceil(settings.window_rad / kTurnStep_rad)), kTurnStepsMax)) {}

  /// The motion of `points` (block frame at the start) that moves `seen` onto the target plane and explains most
  /// points.
  StartPose best(std::span<const Vec3> points, const Plane& seen) {
    StartPose best{Pose::identity(), -1};
    for (int t = 0; t <= 2 * turns_; ++t) {
      const Pose laid = laid_onto_target(seen, outward(t) * kTurnStep_rad);
      place(points, laid);
      for (int y = 0; y <= 2 * shifts_; ++y) {
        for (int x = 0; x <= 2 * shifts_; ++x) {
          const Vec3 shift = in_plane(outward(x), outward(y));
          const int explained = count_explained(heights_.raster(), placed_, outward(x), outward(y),
                                                static_cast<float>(shift.z()), kHeightGate_mm, best.points);
          if (explained <= best.points) continue;
          best.points = explained;
          best.T_block_scanner = laid;
          best.T_block_scanner.translation_mm += shift;
        }
      }
    }
    return best;
  }

 private:
  [[nodiscard]] Pose laid_onto_target(const Plane& seen, double turn_rad) const {
    const Quat turn(Eigen::AngleAxisd(turn_rad, Eigen::Vector3d::UnitZ()));
    const Vec3 n = turn * seen.n;
    const Quat upright(Eigen::Quaterniond::FromTwoVectors(Eigen::Vector3d(n), Eigen::Vector3d(target_.n)));
    return {(upright * turn).normalized(), (target_.d - seen.d) * target_.n};
  }
  [[nodiscard]] Vec3 in_plane(int x_steps, int y_steps) const {
    const double x = HeightMap::kCell_mm * x_steps;
    const double y = HeightMap::kCell_mm * y_steps;
    return {x, y, -(target_.n.x() * x + target_.n.y() * y) / target_.n.z()};
  }
  void place(std::span<const Vec3> points, const Pose& pose) {
    const Mat3 R = pose.rotation.toRotationMatrix();
    const std::size_t padded = (points.size() + 15) / 16 * 16;
    for (std::size_t i = points.size(); i < padded; ++i) {
      column_[i] = row_[i] = 0;
      z_[i] = std::numeric_limits<float>::quiet_NaN();
    }
    placed_ = {std::span(column_).first(padded), std::span(row_).first(padded), std::span(z_).first(padded)};
    for (std::size_t i = 0; i < points.size(); ++i) {
      const Vec3 p = R * points[i] + pose.translation_mm;
      // A stray far away has no cell; it is outside the raster for any position of the block.
      const auto cell = [](double mm, int cells) {
        const double c = std::floor(mm / HeightMap::kCell_mm) + 0.5 * cells;
        return static_cast<int>(std::clamp(c, -10000.0, 10000.0));
      };
      column_[i] = cell(p.x(), HeightMap::kColumns);
      row_[i] = cell(p.y(), HeightMap::kRows);
      z_[i] = static_cast<float>(p.z());
    }
  }
  const HeightMap& heights_;
  const Plane& target_;
  int shifts_;
  int turns_;
  PlacedPoints placed_;
  std::array<std::int32_t, kPlacePoints> column_{};
  std::array<std::int32_t, kPlacePoints> row_{};
  std::array<float, kPlacePoints> z_{};
};

/// Inserts after all poses that explain at least as many points.
void insert_sorted(StartPoses& starts, const StartPose& found) {
  (void)starts.push(found);
  for (std::size_t i = starts.size() - 1; i > 0 && starts[i - 1].points < starts[i].points; --i)
    std::swap(starts[i - 1], starts[i]);
}

}  // namespace

void HeightMap::build(const BlockModel& model, std::span<float> cells) {
  for (int row = 0; row < kRows; ++row) {
    for (int column = 0; column < kColumns; ++column) {
      const double x = (column + 0.5 - 0.5 * kColumns) * kCell_mm;
      const double y = (row + 0.5 - 0.5 * kRows) * kCell_mm;
      Face face = Face::seat;
      double z = 0.0;
      cells[static_cast<std::size_t>(row * kColumns + column)] =
          model.visible(x, y, face, z) ? static_cast<float>(z) : kNowhere_mm;
    }
  }
  cells_ = cells;
  beyond_ = static_cast<float>(model.geometry().slab_top_z_mm.value);
}

StartPoses search_block(const BlockModel& model, const HeightMap& heights, const EvaluationSettings& settings,
                        const Pose& T_block_scanner, std::span<const Vec3> sample, Team& team) {
  StartPoses starts;
  Sample memory;
  const std::size_t taken = thin_out(sample, T_block_scanner, memory);
  const auto planes = level_planes(std::span(memory).first(taken), settings.window_rad + kTiltMargin_rad);
  std::array<Vec3, kPlacePoints> points;
  const std::size_t placed = thin_out(sample, T_block_scanner, points);
  // Each assignment of a plane is searched independently, on either thread.
  std::array<StartPose, kStartPosesMax> found;
  team.run(2 * planes.size(), [&](std::size_t k) {
    PlaceSearch search(heights, model.plane(k % 2 == 0 ? Face::seat : Face::top), settings);
    found[k] = search.best(std::span(points).first(placed), planes[k / 2]);
    found[k].T_block_scanner = found[k].T_block_scanner * T_block_scanner;
  });
  for (std::size_t k = 0; k < 2 * planes.size(); ++k) insert_sorted(starts, found[k]);
  return starts;
}

}  // namespace slabd::algo
