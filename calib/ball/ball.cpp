// SPDX-License-Identifier: Apache-2.0
//
// Finds all balls of one scan. Steps: candidates from the whole scan, the points near each candidate, a fit, and its
// gates. A candidate that is not a sphere is dropped; a sphere that fails a gate is reported with its figures.
#include "calib/ball/ball.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <span>
#include <vector>

#include "calib/ball/ball_fit.h"

namespace slabd::calib {
namespace {

// Search for candidates. The ball's cap is a few per cent of millions of points on table, posts and walls.
//
// The radius is known, so every patch of surface determines the only possible centre: one radius behind it, along its
// normal. Patches of the ball all give the same place. Those of a plane give a plane, and those of a cylinder or
// another ball a line or a shell. Votes are counted in cells, and peaks are candidates. Unlike random quadruples of
// points, this uses the whole scan, involves no chance, and gives the same result every time.
//
// A patch is a cell of an eighth of the radius with its neighbours. Their moments are accumulated in one pass over the
// scan, for which every third or fourth point is enough.

/// A place at which much spherical surface has its centre.
struct BallCandidate {
  Vec3 centre_mm = Vec3::Zero();  ///< to about a hundredth of the radius
  double votes = 0.0;             ///< patches of surface, each an eighth of a radius wide
};

constexpr double kCellsPerRadius = 8.0;
/// Number of points sufficient to find a ball; the fit uses all points.
constexpr std::size_t kPointsEnough = 1'500'000;
/// Largest number of cells. A surface in front of a scanner fills about 10^5; a scan that fills more has no surface.
constexpr std::size_t kCellsMax = 1U << 20U;
/// Larger coordinates are faulty points, because they exceed the range of any scanner.
constexpr double kFar_mm = 20'000.0;
constexpr double kPatchPointsMin = 8.0;
/// Largest thickness of a patch in cells; a thicker one is an edge or a cluster.
constexpr double kPatchThickness = 0.25;
/// Smallest number of votes: a cap of 60 degrees gives about 200, a poorly visible third of it this many.
constexpr double kVotesMin = 25.0;

using Index = std::array<std::int32_t, 3>;

/// Hash table of the occupied cells of space, numbered in the order of insertion.
template <typename Content>
class CellTable {
 public:
  explicit CellTable(double edge_mm) : edge_mm_(edge_mm), slots_(1U << 12U, kUidUnknown) {}

  [[nodiscard]] Index index_of(const Vec3& p) const {
    Index index;
    for (int axis = 0; axis < 3; ++axis)
      index[static_cast<std::size_t>(axis)] = static_cast<std::int32_t>(std::floor(p[axis] / edge_mm_));
    return index;
  }
  [[nodiscard]] Vec3 middle(const Index& index) const {
    return edge_mm_ * Vec3(index[0] + 0.5, index[1] + 0.5, index[2] + 0.5);
  }
  /// Returns the cell at `index`, created if necessary; nullptr if the table is full.
  Content* at(const Index& index) {
    std::uint32_t* slot = &slots_[slot_of(index)];
    if (*slot != kUidUnknown) return &cells_[*slot].content;
    if (cells_.size() == kCellsMax) return nullptr;
    if (2 * cells_.size() >= slots_.size()) {
      grow();
      slot = &slots_[slot_of(index)];
    }
    *slot = static_cast<std::uint32_t>(cells_.size());
    cells_.push_back({key_of(index), index, {}});
    return &cells_.back().content;
  }
  [[nodiscard]] const Content* find(const Index& index) const {
    const std::uint32_t number = slots_[slot_of(index)];
    return number == kUidUnknown ? nullptr : &cells_[number].content;
  }
  /// Calls visit(offset, content) for the cells around and at `index`.
  template <typename Visit>
  void around(const Index& index, const Visit& visit) const {
    for (std::int32_t x = -1; x <= 1; ++x)
      for (std::int32_t y = -1; y <= 1; ++y)
        for (std::int32_t z = -1; z <= 1; ++z)
          if (const Content* content = find({index[0] + x, index[1] + y, index[2] + z}); content != nullptr)
            visit(edge_mm_ * Vec3(x, y, z), *content);
  }

  struct Cell {
    std::uint64_t key;
    Index index;
    Content content;
  };
  [[nodiscard]] const std::vector<Cell>& cells() const { return cells_; }

 private:
  static constexpr std::uint32_t kUidUnknown = 0xFFFF'FFFF;

  /// 21 bits per axis: with cells of an eighth of a millimetre that is far beyond kFar_mm.
  [[nodiscard]] static std::uint64_t key_of(const Index& index) {
    std::uint64_t key = 0;
    for (const std::int32_t i : index) key = (key << 21U) | (static_cast<std::uint64_t>(i) & 0x1F'FFFFU);
    return key;
  }
  [[nodiscard]] std::size_t slot_of(std::uint64_t key) const {
    std::size_t slot = static_cast<std::size_t>((key * 0x9E3779B97F4A7C15U) >> 32U) & (slots_.size() - 1);
    while (slots_[slot] != kUidUnknown && cells_[slots_[slot]].key != key) slot = (slot + 1) & (slots_.size() - 1);
    return slot;
  }
  [[nodiscard]] std::size_t slot_of(const Index& index) const { return slot_of(key_of(index)); }
  void grow() {
    slots_.assign(2 * slots_.size(), kUidUnknown);
    for (std::uint32_t i = 0; i < cells_.size(); ++i) slots_[slot_of(cells_[i].key)] = i;
  }

  double edge_mm_;
  std::vector<std::uint32_t> slots_;
  std::vector<Cell> cells_;
};

/// Sums over points, relative to the centre of their cell.
struct Moments {
  float n = 0.0F;
  std::array<float, 3> p{};
  std::array<float, 6> pp{};  ///< xx xy xz yy yz zz
};

struct Votes {
  double n = 0.0;
  Vec3 sum = Vec3::Zero();
};

void add_points(std::span<const float> xyz, CellTable<Moments>& table) {
  const std::size_t points = xyz.size() / 3;
  const std::size_t step = 1 + points / kPointsEnough;
  Index last{};
  Moments* cell = nullptr;
  Vec3 middle;
  for (std::size_t i = 0; i < points; i += step) {
    const Vec3 p(xyz[3 * i], xyz[3 * i + 1], xyz[3 * i + 2]);
    // Also rejects NaN.
    if (!(std::abs(p.x()) < kFar_mm && std::abs(p.y()) < kFar_mm && std::abs(p.z()) < kFar_mm)) continue;
    const Index index = table.index_of(p);
    if (cell == nullptr || index != last) {
      cell = table.at(index);
      if (cell == nullptr) continue;
      last = index;
      middle = table.middle(index);
    }
    const Eigen::Vector3f d = (p - middle).cast<float>();
    cell->n += 1.0F;
    for (int axis = 0; axis < 3; ++axis) cell->p[static_cast<std::size_t>(axis)] += d[axis];
    std::size_t k = 0;
    for (int a = 0; a < 3; ++a)
      for (int b = a; b < 3; ++b) cell->pp[k++] += d[a] * d[b];
  }
}

/// Adds a vote of every patch for the place one radius behind it.
CellTable<Votes> cast_votes(const CellTable<Moments>& table, double edge_mm, double radius_mm,
                            const Vec3& viewpoint_mm) {
  CellTable<Votes> votes(edge_mm);
  for (const auto& cell : table.cells()) {
    double n = 0.0;
    Vec3 sum = Vec3::Zero();
    Mat3 squares = Mat3::Zero();
    table.around(cell.index, [&](const Vec3& off, const Moments& m) {
      const Vec3 p(m.p[0], m.p[1], m.p[2]);
      Mat3 pp;
      pp << m.pp[0], m.pp[1], m.pp[2], m.pp[1], m.pp[3], m.pp[4], m.pp[2], m.pp[4], m.pp[5];
      const auto count = static_cast<double>(m.n);
      n += count;
      sum += p + count * off;
      squares += pp + p * off.transpose() + off * p.transpose() + count * off * off.transpose();
    });
    if (n < kPatchPointsMin) continue;
    const Vec3 mean = sum / n;
    const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> axes(Eigen::Matrix3d(squares / n - mean * mean.transpose()));
    if (std::sqrt(std::max(0.0, axes.eigenvalues()[0])) > kPatchThickness * edge_mm) continue;
    if (axes.eigenvalues()[1] < 4.0 * axes.eigenvalues()[0]) continue;  // points on a line have no normal
    const Vec3 p = table.middle(cell.index) + mean;
    Vec3 normal = axes.eigenvectors().col(0);
    if (normal.dot(viewpoint_mm - p) < 0.0) normal = -normal;
    const Vec3 centre = p - radius_mm * normal;
    Votes* const cell_votes = votes.at(votes.index_of(centre));
    if (cell_votes == nullptr) continue;
    cell_votes->n += 1.0;
    cell_votes->sum += centre;
  }
  return votes;
}

/// Centres of spheres of about `radius_mm` in a scan (3 floats per point, mm, NaN = missing), most votes first, at most
/// `count_max`. Spheres with a radius different by a few per cent are found too, and cylinders and edges may be
/// included. O(points), with at most 80 MB of working memory for any scan.
std::vector<BallCandidate> ball_candidates(std::span<const float> xyz, double radius_mm, const Vec3& viewpoint_mm,
                                           std::size_t count_max) {
  const double edge_mm = radius_mm / kCellsPerRadius;
  CellTable<Moments> table(edge_mm);
  add_points(xyz, table);
  const CellTable<Votes> votes = cast_votes(table, edge_mm, radius_mm, viewpoint_mm);

  std::vector<BallCandidate> peaks;
  for (const auto& cell : votes.cells()) {
    Votes total;
    votes.around(cell.index, [&](const Vec3&, const Votes& v) {
      total.n += v.n;
      total.sum += v.sum;
    });
    if (total.n >= kVotesMin) peaks.push_back({total.sum / total.n, total.n});
  }
  std::stable_sort(peaks.begin(), peaks.end(),
                   [](const BallCandidate& a, const BallCandidate& b) { return a.votes > b.votes; });
  std::vector<BallCandidate> candidates;
  for (const BallCandidate& peak : peaks) {
    if (candidates.size() == count_max) break;
    const bool known = std::any_of(candidates.begin(), candidates.end(), [&](const BallCandidate& other) {
      return (other.centre_mm - peak.centre_mm).norm() < radius_mm;
    });
    if (!known) candidates.push_back(peak);
  }
  return candidates;
}

constexpr double kRadiusLeast_mm = 1.0;
constexpr double kRadiusMost_mm = 200.0;
constexpr int kCountMost = 16;
/// Additional candidates beyond the expected balls: posts, other balls, corners.
constexpr std::size_t kCandidatesSpare = 8;
constexpr int kRadiusViewsMin = 5;
constexpr double kRadiusOffLeast_mm = 0.010;
/// Largest number of points for one candidate: a cap of a full scan has 60 000.
constexpr std::size_t kNearMax = 1U << 20U;

Status check(std::span<const float> xyz, const BallSettings& s) {
  if (xyz.size() % 3 != 0 || xyz.size() / 3 > limits::kScanPointsMax)
    return error(Code::config, "a scan has 3 numbers a point and at most %zu points, got %zu numbers",
                 limits::kScanPointsMax, xyz.size());
  if (!(s.radius_mm >= kRadiusLeast_mm && s.radius_mm <= kRadiusMost_mm))
    return error(Code::config, "ball radius %g mm: must be within %g .. %g", s.radius_mm, kRadiusLeast_mm,
                 kRadiusMost_mm);
  if (s.count < 1 || s.count > kCountMost)
    return error(Code::config, "number of balls %d: must be within 1 .. %d", s.count, kCountMost);
  if (!(s.noise_mm > 0.0 && s.noise_mm <= 1.0))
    return error(Code::config, "scanner noise %g mm: must be above 0 and at most 1", s.noise_mm);
  if (!(s.noise_correlation_mm >= 0.0 && s.noise_correlation_mm <= 20.0))
    return error(Code::config, "noise correlation %g mm: must be within 0 .. 20", s.noise_correlation_mm);
  if (!(s.radius_sigma_mm >= 0.0 && s.radius_sigma_mm <= 1.0))
    return error(Code::config, "uncertainty of the ball radius %g mm: must be within 0 .. 1", s.radius_sigma_mm);
  if (!s.viewpoint_mm.allFinite()) return error(Code::config, "the viewpoint is not finite");
  return success();
}

/// Collects the points of the scan within `half_mm` of a sphere, in the scan's order.
void gather(std::span<const float> xyz, const Vec3& centre_mm, double radius_mm, double half_mm,
            std::vector<Vec3>& near) {
  near.clear();
  const auto reach = static_cast<float>(radius_mm + half_mm);
  const double low = std::max(0.0, radius_mm - half_mm);
  const Eigen::Vector3f c = centre_mm.cast<float>();
  for (std::size_t i = 0; i + 2 < xyz.size() && near.size() < kNearMax; i += 3) {
    const bool inside = std::abs(xyz[i] - c.x()) < reach && std::abs(xyz[i + 1] - c.y()) < reach &&
                        std::abs(xyz[i + 2] - c.z()) < reach;
    if (!inside) continue;
    const Vec3 p = Eigen::Vector3f(xyz[i], xyz[i + 1], xyz[i + 2]).cast<double>();
    const double distance2 = (p - centre_mm).squaredNorm();
    if (distance2 > low * low && distance2 < (radius_mm + half_mm) * (radius_mm + half_mm)) near.push_back(p);
  }
}

/// Returns all spheres of about the radius, judged, each only once.
std::vector<BallReport> measure_all(std::span<const float> xyz, const BallSettings& settings) {
  const std::vector<BallCandidate> candidates = ball_candidates(
      xyz, settings.radius_mm, settings.viewpoint_mm, static_cast<std::size_t>(2 * settings.count) + kCandidatesSpare);
  // The centre from the votes has an error of a few per cent of the radius, and so may the radius.
  const double half_mm = 0.1 * settings.radius_mm + 2.0 * shell_mm(settings);
  std::vector<Vec3> near;
  std::vector<BallReport> balls;
  for (const BallCandidate& candidate : candidates) {
    BallReport ball;
    gather(xyz, candidate.centre_mm, settings.radius_mm, half_mm, near);
    if (!measure_ball(near, candidate.centre_mm, settings, ball)) continue;
    const bool known = std::any_of(balls.begin(), balls.end(), [&](const BallReport& other) {
      return (other.centre_mm - ball.centre_mm).norm() < settings.radius_mm;
    });
    if (known) continue;
    judge_ball(settings, ball);
    balls.push_back(ball);
  }
  std::stable_sort(balls.begin(), balls.end(), [](const BallReport& a, const BallReport& b) {
    return a.ok() != b.ok() ? a.ok() : a.points_used > b.points_used;
  });
  return balls;
}

/// Radius of a ball of half or twice the size, if diameter and radius were confused; NaN if there is none.
double radius_of_another(std::span<const float> xyz, const BallSettings& settings) {
  for (const double factor : {0.5, 2.0}) {
    BallSettings other = settings;
    other.radius_mm = factor * settings.radius_mm;
    if (!check(xyz, other)) continue;
    for (const BallReport& ball : measure_all(xyz, other))
      if (ball.ok() || ball.refusal == BallRefusal::radius) return ball.radius_free_mm;
  }
  return kNoValue;
}

}  // namespace

std::string_view name(BallRefusal refusal) {
  switch (refusal) {
    case BallRefusal::none: return "none";
    case BallRefusal::not_looked_at: return "not_looked_at";
    case BallRefusal::no_points: return "no_points";
    case BallRefusal::not_found: return "not_found";
    case BallRefusal::too_many: return "too_many";
    case BallRefusal::too_few: return "too_few";
    case BallRefusal::few_points: return "few_points";
    case BallRefusal::small_cap: return "small_cap";
    case BallRefusal::azimuth: return "azimuth";
    case BallRefusal::unstable: return "unstable";
    case BallRefusal::noisy: return "noisy";
    case BallRefusal::spoiled: return "spoiled";
    case BallRefusal::radius: return "radius";
    case BallRefusal::repeat: return "repeat";
  }
  return "?";
}

Result<BallView> find_balls(std::span<const float> xyz, const BallSettings& settings) {
  if (const Status checked = check(xyz, settings); !checked) return checked.error();
  BallView view;
  view.points = xyz.size() / 3;
  Vec3 low = Vec3::Constant(std::numeric_limits<double>::infinity());
  Vec3 high = -low;
  for (std::size_t i = 0; i < xyz.size(); i += 3) {
    const Vec3 p = Eigen::Vector3f(xyz[i], xyz[i + 1], xyz[i + 2]).cast<double>();
    if (!p.allFinite()) continue;
    ++view.finite;
    low = low.cwiseMin(p);
    high = high.cwiseMax(p);
  }
  if (view.finite == 0) {
    view.refusal = BallRefusal::no_points;
    view.words.reason.printf("the scan has no points (%llu places, all missing)",
                             static_cast<unsigned long long>(view.points));
    view.words.cure = "check exposure and working distance, and that the scanner's shutter is open";
    return view;
  }
  view.balls = measure_all(xyz, settings);
  const auto wanted = static_cast<std::size_t>(settings.count);
  const auto accepted = static_cast<std::size_t>(
      std::count_if(view.balls.begin(), view.balls.end(), [](const BallReport& ball) { return ball.ok(); }));
  if (accepted == wanted) {
    view.refusal = BallRefusal::none;
  } else if (accepted > wanted) {
    view.refusal = BallRefusal::too_many;
    view.words = words_too_many(settings, accepted);
  } else if (view.balls.empty()) {
    view.refusal = BallRefusal::not_found;
    view.words = words_not_found(settings, (high - low).maxCoeff(), radius_of_another(xyz, settings));
  } else if (wanted == 1) {
    view.refusal = view.balls[0].refusal;
    view.words = view.balls[0].words;
  } else {
    view.refusal = BallRefusal::too_few;
    view.words = words_too_few(settings, accepted, accepted < view.balls.size() ? &view.balls[accepted] : nullptr);
  }
  return view;
}

BallShots average_shots(std::span<const BallReport> shots, const BallSettings& settings) {
  BallShots mean;
  mean.shots = static_cast<int>(shots.size());
  if (shots.empty()) {
    mean.refusal = BallRefusal::no_points;
    mean.words.reason = "no shot was taken";
    mean.words.cure = "scan the ball";
    return mean;
  }
  for (std::size_t i = 0; i < shots.size(); ++i) {
    if (shots[i].ok()) continue;
    mean.refusal = shots[i].refusal;
    mean.worst_shot = static_cast<int>(i) + 1;
    mean.words.reason.printf("shot %zu of %zu: %s", i + 1, shots.size(), shots[i].words.reason.c_str());
    mean.words.cure = shots[i].words.cure;
    return mean;
  }
  const auto count = static_cast<double>(shots.size());
  mean.centre_mm.setZero();
  Mat3 white = Mat3::Zero();
  Mat3 correlated = Mat3::Zero();
  for (const BallReport& shot : shots) {
    mean.centre_mm += shot.centre_mm / count;
    white += shot.cov_white_mm2 / (count * count);
    correlated += shot.cov_correlated_mm2 / count;
  }
  mean.cov_mm2 = white + correlated;
  double squares = 0.0;
  double worst = -1.0;
  for (std::size_t i = 0; i < shots.size(); ++i) {
    const double off = (shots[i].centre_mm - mean.centre_mm).norm();
    squares += off * off;
    if (off > worst) {
      worst = off;
      mean.worst_shot = static_cast<int>(i) + 1;
    }
  }
  if (shots.size() > 1) mean.repeat_mm = std::sqrt(squares / (3.0 * (count - 1.0)));
  if (shots.size() > 1 && !(mean.repeat_mm < settings.repeat_max_mm)) {
    mean.refusal = BallRefusal::repeat;
    mean.words.reason.printf("%zu shots scatter by %.4f mm per axis, allowed is %.4f; shot %d is %.4f mm off the mean",
                             shots.size(), mean.repeat_mm, settings.repeat_max_mm, mean.worst_shot, worst);
    mean.words.cure =
        "wait until the robot has settled, check that ball and post are tight, shade lamps, and take the shots again";
    return mean;
  }
  mean.refusal = BallRefusal::none;
  return mean;
}

// Least squares of dr + dz cos(phi) = 0 over the cap's area: means of cos and cos^2.
double shift_per_radius(double half_angle_rad) {
  const double c = std::cos(half_angle_rad);
  return 1.5 * (1.0 + c) / (1.0 + c + c * c);
}

RadiusCheck check_radius(std::span<const BallReport> balls, const BallSettings& settings) {
  RadiusCheck check;
  double sum = 0.0;
  double shift = 0.0;
  for (const BallReport& ball : balls) {
    if (!ball.ok() || !has_value(ball.radius_free_mm)) continue;
    ++check.views;
    sum += ball.radius_free_mm;
    shift += ball.shift_per_radius.norm();
  }
  if (check.views < 2) return check;
  check.mean_mm = sum / check.views;
  double squares = 0.0;
  for (const BallReport& ball : balls)
    if (ball.ok() && has_value(ball.radius_free_mm))
      squares += (ball.radius_free_mm - check.mean_mm) * (ball.radius_free_mm - check.mean_mm);
  check.sigma_mm = std::sqrt(squares / (check.views * (check.views - 1.0)));
  const double off = settings.radius_mm - check.mean_mm;
  check.shift_mm = off * shift / check.views;
  check.suspicious =
      check.views >= kRadiusViewsMin && std::abs(off) > 3.0 * check.sigma_mm && std::abs(off) > kRadiusOffLeast_mm;
  const double certified_mm = 2.0 * settings.radius_sigma_mm;
  check.covered = check.suspicious && std::abs(off) <= certified_mm;
  if (check.suspicious) {
    check.words.reason.printf(
        "over %d scans the ball shows a radius of %.4f +- %.4f mm, certified are %.4f: if the scans are right, every "
        "centre is %.3f mm too %s the scanner, and the calibration with it; no residual will show that",
        check.views, check.mean_mm, 2.0 * check.sigma_mm, settings.radius_mm, std::abs(check.shift_mm),
        check.shift_mm > 0.0 ? "far from" : "near to");
    if (check.covered) {
      FixedString<64> covered;
      covered.printf("; the certificate's own uncertainty (%.4f mm, k = 2) covers it", certified_mm);
      check.words.reason.append(covered.view());
    }
    check.words.cure =
        "have the effective radius of the ball certified as coated, and measure a step or plane artefact to "
        "distinguish an error of the ball's radius from one of the scanner";
  }
  return check;
}

}  // namespace slabd::calib
