// SPDX-License-Identifier: Apache-2.0
//
// Problem: find the block. The robot gives its position to a few millimetres; the scan must give it to a micrometre,
// and must detect a missing block (paper 2.4).
//
// Idea: ICP, point to plane, against the analytic model. Each sampled point is moved into the block frame and
// associated with the closest face visible near it. The six-parameter step that reduces the distances is solved for
// (Gauss-Newton, Tukey weights), while the gates shrink. The robot's position, normally right to a few millimetres, is
// tried first. If only the position along the rail is doubtful, the casings' position is tried. If no pose passes every
// test, the whole window is searched (block_search), so any start within it is sufficient.
//
// The last steps use only points with a single face around them. The selection and association of points then depend on
// their position, not on their noise: the estimate has no bias from edges, and its covariance is known. Casings are
// used only if the faces leave a direction open (casing_ties).
//
// A wrong pose that looks converged is the worst outcome. So the pose is accepted only if the step is tiny, no
// direction is undetermined, and on every face most of the points expected by the model are found. A flat slab without
// a block passes the first test easily, but not the others.
#include "algo/register/registration.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <functional>
#include <limits>

#include "algo/moments.h"
#include "algo/points.h"
#include "algo/register/icp.h"

namespace slabd::algo {

namespace {

/// Positions along the rail, a millimetre each, counted from -kReach_mm.
constexpr int kReach_mm = 256;
using Profile = std::array<double, 2 * kReach_mm>;

/// Points this far from the bearing plane belong to it.
constexpr double kHeight_mm = 3.0;
/// Clear of the jaws' feet with any fillet.
constexpr double kClear_mm = 15.0;
/// A position has the whole bearing plane if it has this share of the usual number of points.
constexpr double kHalf = 0.5;
/// Minimum number of sample points per millimetre for detecting an end.
constexpr double kPointsMin = 8.0;
/// Largest gap in the bearing plane: a strap, a dark stroke.
constexpr int kGap_mm = 25;
/// Between these distances beyond an end, the slab's top must be visible with this share of the usual points. Otherwise
/// it is the end of the field of view, not of the block.
constexpr int kBeyondFrom_mm = 8;
constexpr int kBeyondTo_mm = 20;
constexpr double kBeyondShare = 0.3;
/// Maximum deviation of the distance of the ends from nominal.
constexpr double kLengthOff_mm = 10.0;
/// Usual reduction of the bearing plane by a chamfer.
constexpr double kChamfer_mm = 2.0;
constexpr double kBothSigma_mm = 0.5;
constexpr double kOneSigma_mm = 2.0;

}  // namespace

std::optional<Tie> tie_to_ends(const IcpSample& sample, const BlockModel& model, const EvaluationSettings& settings,
                               const Pose& T_block_scanner) {
  const Plane& seat = model.plane(Face::seat);
  const double half_s_mm = model.geometry().jaw_half_distance_mm.value - kClear_mm;
  const Mat3 R = T_block_scanner.rotation.toRotationMatrix();
  const Vec3 t = R * sample.shift + T_block_scanner.translation_mm;
  Profile on_seat{};
  Profile any{};
  for (std::size_t i = 0; i < sample.size(); ++i) {
    if (!(sample.x[i] == sample.x[i])) continue;
    const Vec3 p =
        R * Vec3(static_cast<double>(sample.x[i]), static_cast<double>(sample.y[i]), static_cast<double>(sample.z[i])) +
        t;
    if (!(std::abs(model.along_seat().dot(p)) <= half_s_mm) || !(std::abs(p.x()) < kReach_mm)) continue;
    const auto place = static_cast<std::size_t>(std::floor(p.x()) + kReach_mm);
    any[place] += 1.0;
    if (std::abs(seat.distance(p)) <= kHeight_mm) on_seat[place] += 1.0;
  }
  // Number of points at a position in the middle of the block.
  Profile sorted = on_seat;
  const double half_length_mm = model.geometry().end_half_length_mm.value;
  const auto middle = sorted.begin() + static_cast<std::ptrdiff_t>(half_length_mm);
  std::nth_element(sorted.begin(), middle, sorted.end(), std::greater<>());
  const double full = *middle;
  if (!(full >= kPointsMin)) return std::nullopt;

  // The longest range with a bearing plane.
  int best_from = 0;
  int best_to = -1;
  int from = -1;
  int to = -1;
  for (int k = 0; k < 2 * kReach_mm; ++k) {
    if (on_seat[static_cast<std::size_t>(k)] < kHalf * full) continue;
    if (from < 0 || k - to > kGap_mm) from = k;
    to = k;
    if (to - from > best_to - best_from) {
      best_from = from;
      best_to = to;
    }
  }
  if (best_to < best_from) return std::nullopt;
  const auto count = [&](int k) { return k < 0 || k >= 2 * kReach_mm ? 0.0 : on_seat[static_cast<std::size_t>(k)]; };
  // Edge between a position with half of the bearing plane and the next one without.
  const auto edge_mm = [&](int last, int step) {
    const double inside = count(last);
    const double outside = count(last + step);
    const double part = inside > outside ? std::clamp((inside - kHalf * full) / (inside - outside), 0.0, 1.0) : 0.5;
    return static_cast<double>(last - kReach_mm) + 0.5 + step * part;
  };
  const auto is_end = [&](int last, int step) {
    double beyond = 0.0;
    for (int k = kBeyondFrom_mm; k < kBeyondTo_mm; ++k) {
      const int place = last + step * k;
      if (place >= 0 && place < 2 * kReach_mm) beyond += any[static_cast<std::size_t>(place)];
    }
    return beyond >= kBeyondShare * full * (kBeyondTo_mm - kBeyondFrom_mm);
  };
  const double low_mm = edge_mm(best_from, -1);
  const double high_mm = edge_mm(best_to, 1);
  const bool low = is_end(best_from, -1);
  const bool high = is_end(best_to, 1);
  double off_mm = 0.0;
  double sigma_mm = kBothSigma_mm;
  if (low && high) {
    if (std::abs(high_mm - low_mm + 2.0 * (kChamfer_mm - half_length_mm)) > kLengthOff_mm) return std::nullopt;
    off_mm = 0.5 * (low_mm + high_mm);
  } else if (low || high) {
    off_mm = low ? low_mm + half_length_mm - kChamfer_mm : high_mm - half_length_mm + kChamfer_mm;
    sigma_mm = kOneSigma_mm;
  } else {
    return std::nullopt;
  }
  if (!(std::abs(off_mm) <= settings.window_mm)) return std::nullopt;
  return Tie{T_block_scanner.inverse() * Vec3(off_mm, 0.0, 0.0), Vec3::UnitX(), 0.0, sigma_mm};
}

Tie tie_to_robot(const Pose& T_block_scanner_by_robot) {
  return {T_block_scanner_by_robot.inverse().translation_mm, Vec3::UnitX(), 0.0, kRobotAlongRailSigma_mm};
}

namespace {

/// The pose has converged if a step moves the block's rim by less than this, and a new association by less than
/// kRoundDone_mm: one point in ten thousand may change sides permanently.
constexpr double kStepDone_mm = 1e-6;
constexpr double kRoundDone_mm = 1e-3;
constexpr int kRounds = 20;
constexpr int kRoundSteps = 40;
/// From this round on points are associated half way between the last pose and the new one. Otherwise a point at the
/// edge of two cells may move the pose back and forth permanently.
constexpr int kHalfWayFrom = 4;
/// Ratio of the smallest to the largest eigenvalue of the normal matrix. A complete block has about 2e-2; without end
/// faces 0.
constexpr double kConditionMin = 1e-3;
/// A direction below this part of the required eigenvalue stays open, independent of the last steps.
constexpr double kClearlyOpen = 0.5;
/// After a larger shift the sample is sorted again, because its groups then mix faces.
constexpr double kSortedWithin_mm = 10.0;
/// Minimum share of a single face's points on it. Lower than for the whole block: a glove may be on a jaw.
constexpr double kFaceShareMin = 0.35;
/// Limits for the distances of a face's points, in gates: offset of the face from the model, and scatter (0.58 is any
/// surface that crosses the gate).
constexpr double kFaceMeanMax = 0.5;
constexpr double kFaceSpreadMax = 0.25;
/// A face with fewer sampled points is ignored.
constexpr std::size_t kFacePointsMin = 20;
/// A coarse gate is finished if a step is shorter than this.
constexpr double kCoarseDone_mm = 0.02;
/// Newton's steps are used if steps are shorter than this share of the gate.
constexpr double kNewtonFrom = 0.1;
/// Number of sample points for the search.
constexpr std::size_t kSearchPoints = 2048;

struct Gate {
  double radius_mm;
  int steps;
};
/// The search leaves an error of half a step: 2 to 3 mm and a degree, which is 4 mm at the ends of the block.
constexpr std::array<Gate, 3> kCoarse = {{{12.0, 6}, {8.0, 5}, {6.0, 5}}};
/// The last gate in medians of the worst face (for normal errors seven medians are 4.7 sigma, Tukey's usual choice),
/// and its minimum.
constexpr double kGateMedians = 7.0;
constexpr double kLastGateMin_mm = 0.15;

/// Match of a pose with the sample, overall and per face. Only points with a single face around them count for that
/// face, so that edges do not affect the result.
struct Assessment : FaceCounts {
  [[nodiscard]] double share() const {
    return in_field == 0 ? 0.0 : static_cast<double>(near_model) / static_cast<double>(in_field);
  }
  [[nodiscard]] double share(std::size_t face) const {
    return expected[face] == 0 ? 0.0 : static_cast<double>(found[face]) / static_cast<double>(expected[face]);
  }
  /// Mean and standard deviation of the distances of the points found on a face.
  [[nodiscard]] double mean_mm(std::size_t face) const {
    return found[face] == 0 ? 0.0 : sum_mm[face] / static_cast<double>(found[face]);
  }
  [[nodiscard]] double spread_mm(std::size_t face) const {
    if (found[face] == 0) return 0.0;
    const double mean = mean_mm(face);
    return std::sqrt(std::fmax(sum_mm2[face] / static_cast<double>(found[face]) - mean * mean, 0.0));
  }
  /// Bits of the faces that are really there. A level surface that crosses a steep face is also within its gate over
  /// several millimetres, but not parallel to it: its distances are distributed over the whole gate.
  [[nodiscard]] std::uint16_t confirmed(double gate_mm) const {
    std::uint16_t faces = 0;
    for (std::size_t f = 0; f < kFaces; ++f)
      if (share(f) >= kFaceShareMin && spread_mm(f) <= kFaceSpreadMax * gate_mm)
        faces = static_cast<std::uint16_t>(faces | bit(static_cast<Face>(f)));
    return faces;
  }
};

/// Empty if the pose explains the scan; else the reason against it.
FixedString<64> objection(const Assessment& a, const EvaluationSettings& settings, std::size_t stride) {
  FixedString<64> note;
  if (!(a.share() >= settings.registration_share_min)) {
    note.printf("share on the model %.2f, at least %.2f: turned or other type?", a.share(),
                settings.registration_share_min);
    return note;
  }
  const std::size_t points_min = std::max<std::size_t>(5, kFacePointsMin / stride);
  for (const Face face : {Face::seat, Face::jaw_inner, Face::jaw_outer}) {
    const auto f = static_cast<std::size_t>(face);
    if (a.expected[f] >= points_min) continue;
    note.printf("no points where the %s should be", name(face).data());
    return note;
  }
  for (std::size_t f = 0; f < kFaces; ++f) {
    if (a.expected[f] < points_min || (kPoseFaces & bit(static_cast<Face>(f))) == 0) continue;
    if (a.share(f) < kFaceShareMin) {
      note.printf("%s: share %.2f, at least %.2f", name(static_cast<Face>(f)).data(), a.share(f), kFaceShareMin);
      return note;
    }
    const double gate = settings.registration_gate_mm;
    if (!(std::abs(a.mean_mm(f)) <= kFaceMeanMax * gate) || !(a.spread_mm(f) <= kFaceSpreadMax * gate)) {
      note.printf("%s: %.2f mm off, spread %.2f", name(static_cast<Face>(f)).data(), a.mean_mm(f), a.spread_mm(f));
      return note;
    }
  }
  return note;
}

/// Steps from `pose` with the coarse gates. True if they end at a pose that explains the scan.
bool settle(const RegistrationTask& task, Icp& icp, Pose& pose, Assessment& seen, int& iterations) {
  NormalEquations eq;
  icp.sort_first_part(pose);
  for (const Gate& gate : kCoarse) {
    double step_mm = kCoarseDone_mm;
    for (int i = 0; i < gate.steps && step_mm >= kCoarseDone_mm; ++i, ++iterations)
      step_mm = icp.coarse_step(pose, gate.radius_mm, eq);
    if (step_mm < 0.0) return false;
  }
  seen = {icp.coarse_counts(pose)};
  return objection(seen, task.settings, kSampleParts).empty();
}

/// ICP from each start pose of the search, best first. Returns the first accepted pose, else the one with the largest
/// share.
Pose searched_pose(const RegistrationTask& task, Icp& icp, int& iterations, Team& team) {
  std::array<Vec3, kSearchPoints> points;
  const std::size_t count = icp.take(points);
  Pose best = task.T_block_scanner;
  double best_share = -1.0;
  for (const StartPose& start : search_block(task.model, task.heights, task.settings, task.T_block_scanner,
                                             std::span(points).first(count), team)) {
    Pose pose = start.T_block_scanner;
    Assessment seen;
    if (settle(task, icp, pose, seen, iterations)) return pose;
    if (seen.share() > best_share) {
      best_share = seen.share();
      best = pose;
    }
  }
  return best;
}

/// Seat and jaws determine a pose except for its position along the rail. If they are right and only the rest is wrong,
/// the casings give a new start, at a fraction of the cost of the search. True if its ICP ends at an accepted pose.
bool settle_by_casings(const RegistrationTask& task, const RegistrationWorkspace& work, Icp& icp,
                       const Assessment& seen, Pose& pose, int& iterations, Team& team) {
  constexpr std::uint16_t kNeeded = bit(Face::seat) | bit(Face::jaw_inner) | bit(Face::jaw_outer);
  if ((seen.confirmed(task.settings.registration_gate_mm) & kNeeded) != kNeeded) return false;
  const auto off_mm = casings_off_mm(icp.sample(), task.model, task.settings, pose, work.casings, team);
  if (!off_mm) return false;
  pose.translation_mm.x() -= *off_mm;
  Assessment then;
  return settle(task, icp, pose, then, iterations);
}

/// The gate of the last steps. A few sigma, so that dirt and damage have no influence. But no face may be excluded as a
/// whole: on a block whose ends are half a millimetre too long they still determine the middle.
double last_gate(const Icp& icp) {
  const double gate = std::max(kLastGateMin_mm, kGateMedians * icp.worst_median_mm(kFacePointsMin));
  return std::min(gate, icp.single_face_gate());
}

/// Least determined of the six motions in the normal equations.
struct Determinacy {
  double condition = std::numeric_limits<double>::infinity();
  double largest = 0.0;
  bool complete = false;
  bool clearly_open = false;     ///< incomplete, independent of a few points more or less
  bool only_along_rail = false;  ///< incomplete, but complete if the position along the rail is given
  std::string_view open;         ///< the undetermined direction, if not complete
};

Determinacy determinacy(const NormalEquations& eq) {
  constexpr std::array<std::string_view, 6> kNames = {"shift along the rail (x)",
                                                      "shift across the rail (y)",
                                                      "height (z)",
                                                      "tilt about x",
                                                      "tilt about y",
                                                      "turn about z"};
  Determinacy d;
  Eigen::SelfAdjointEigenSolver<Eigen::Matrix<double, 6, 6>> solver;
  solver.compute(eq.H);
  d.largest = solver.eigenvalues()[5];
  const double smallest = std::fmax(solver.eigenvalues()[0], 0.0);
  if (d.largest > 0.0 && smallest > 0.0) d.condition = d.largest / smallest;
  d.complete = eq.points >= 6 && smallest > kConditionMin * d.largest;
  d.clearly_open = !d.complete && !(smallest > kClearlyOpen * kConditionMin * d.largest);
  // With several open directions the eigenvectors are arbitrary mixtures: name the axis with the largest open part.
  Vec6 open = Vec6::Zero();
  for (int k = 0; k < 6; ++k)
    if (solver.eigenvalues()[k] <= kConditionMin * d.largest) open += Vec6(solver.eigenvectors().col(k)).cwiseAbs2();
  int axis = 0;
  for (int k = 1; k < 6; ++k)
    if (open[k] > open[axis] + 1e-3) axis = k;
  d.open = kNames[static_cast<std::size_t>(axis)];
  if (!d.complete) {
    Eigen::SelfAdjointEigenSolver<Eigen::Matrix<double, 5, 5>> others;
    others.compute(eq.H.bottomRightCorner<5, 5>(), Eigen::EigenvaluesOnly);
    d.only_along_rail = eq.points >= 6 && others.eigenvalues()[0] > kConditionMin * d.largest;
  }
  return d;
}

/// Distances of all points near the model (paper Table 4), at the final pose.
DeviationStats deviations(const Cloud& cloud, const RegistrationTask& task, const Pose& pose,
                          std::span<std::uint32_t> histogram) {
  const double gate = task.settings.registration_gate_mm;
  const double bins_per_mm = static_cast<double>(histogram.size()) / gate;
  const FastTransform transform(pose);
  std::fill(histogram.begin(), histogram.end(), 0U);
  ScalarMoments moments(0.0);
  for (std::size_t i = 0; i < cloud.points; ++i) {
    const Vec3 p = transform(cloud.xyz.data() + 3 * i);
    Face face = Face::seat;
    double r = 0.0;
    if (!closest_face(task.model.planes(), task.table.near_at(p), p, face, r) || !(std::abs(r) < gate)) continue;
    moments.add(r);
    ++histogram[std::min(static_cast<std::size_t>(std::abs(r) * bins_per_mm), histogram.size() - 1)];
  }
  moments.close_block();
  DeviationStats stats;
  stats.count = moments.count();
  if (stats.count < 2) return stats;
  stats.mean_mm = moments.mean();
  stats.std_mm = std::sqrt(moments.variance(1));
  // Shares from the histogram: accurate to one of its bins (0.05 um), without a second pass over the scan.
  std::size_t bin = 0;
  std::uint64_t within = 0;
  for (std::size_t k = 0; k < stats.within_sigma.size(); ++k) {
    const double limit_bins = static_cast<double>(k + 1) * stats.std_mm * bins_per_mm;
    for (; bin < histogram.size() && static_cast<double>(bin + 1) <= limit_bins; ++bin) within += histogram[bin];
    stats.within_sigma[k] = static_cast<double>(within) / static_cast<double>(stats.count);
  }
  return stats;
}

/// A pose after the steps with the narrow gate, and its assessment.
struct FineResult {
  double gate_mm = 0.0;
  bool stands_still = false;
  bool left_open = false;  ///< ended after the first round, see Refine
  Assessment seen;
  Determinacy directions;
};

Pose half_way(const Pose& a, const Pose& b) {
  return {a.rotation.slerp(0.5, b.rotation), 0.5 * (a.translation_mm + b.translation_mm)};
}

/// Required result of a refinement.
enum class Refine : std::uint8_t {
  whole,    ///< a converged pose
  or_open,  ///< or that of the first round, if a direction is clearly open there and must be fixed first
};

/// Steps with the narrow gate; `icp` is sorted for about this pose.
FineResult refine(const RegistrationTask& task, Icp& icp, Refine until, Pose& pose, int& iterations) {
  FineResult fine;
  NormalEquations eq;
  Pose at = pose;
  FaceCounts seen;
  // A missing face determines nothing: where a bare slab passes a jaw's foot, its points look like the jaw's.
  const auto known_directions = [&] {
    return determinacy(icp.information(pose, fine.gate_mm, fine.seen.confirmed(task.settings.registration_gate_mm)));
  };
  for (int round = 0; round < kRounds && !fine.stands_still; ++round) {
    at = round < kHalfWayFrom ? pose : half_way(at, pose);
    seen = icp.associate(at);
    if (round == 0) fine.gate_mm = last_gate(icp);
    double step_mm = std::numeric_limits<double>::infinity();
    bool newton_helps = true;
    for (int i = 0; i < kRoundSteps && step_mm >= kStepDone_mm; ++i, ++iterations) {
      const bool newton = newton_helps && step_mm < kNewtonFrom * fine.gate_mm;
      const double last_mm = step_mm;
      step_mm = icp.step(pose, fine.gate_mm, newton ? Weights::newton : Weights::tukey, eq);
      // Newton's steps are stopped if a step is not shorter than the last one, or not downhill.
      if (newton && !(step_mm >= 0.0 && step_mm < last_mm)) {
        newton_helps = false;
        step_mm = last_mm;
      }
    }
    if (step_mm < 0.0) break;
    fine.stands_still = step_mm < kStepDone_mm && Icp::length_mm(pose * at.inverse()) < kRoundDone_mm;
    if (until == Refine::or_open && round == 0 && !fine.stands_still) {
      fine.seen = {seen};
      fine.directions = known_directions();
      fine.left_open = fine.directions.clearly_open;
      if (fine.left_open) return fine;
    }
  }
  // If the pose has converged, `seen` is from the association with it.
  fine.seen = {fine.stands_still ? seen : icp.counts(pose)};
  fine.directions = known_directions();
  return fine;
}

/// Position along the rail of a block without usable casings: from its ends, else from the robot. Both are used only
/// for this coordinate.
CasingTies without_casings(const RegistrationTask& task, const Icp& icp, const FineResult& fine, const Pose& pose,
                           FixedString<64>& note) {
  CasingTies held{pose, {}};
  constexpr std::uint16_t kNeeded = bit(Face::seat) | bit(Face::jaw_inner) | bit(Face::jaw_outer);
  if ((fine.seen.confirmed(task.settings.registration_gate_mm) & kNeeded) != kNeeded ||
      !fine.directions.only_along_rail)
    return held;
  const std::optional<Tie> ends = tie_to_ends(icp.sample(), task.model, task.settings, pose);
  const Tie tie = ends ? *ends : tie_to_robot(task.T_block_scanner);
  note.printf("along the rail from the %s, +-%.0f mm: no bore is seen", ends ? "ends" : "robot", 2.0 * tie.sigma_mm);
  held.T_block_scanner.translation_mm.x() -= (pose * tie.p_scanner).x() - tie.target_mm;
  (void)held.ties.push(tie);
  return held;
}

/// Sets the final pose's status. The order matters: an undetermined direction is the best explanation of an error.
void pass_judgement(const RegistrationTask& task, const Pose& pose, const FineResult& fine,
                    RegistrationReport& report) {
  report.share_associated = fine.seen.share();
  report.condition = fine.directions.condition;
  if (!fine.directions.complete || !pose.all_finite()) {
    report.status = RegistrationStatus::degenerate;
    report.note.printf("the scan does not determine: %s", fine.directions.open.data());
    return;
  }
  const FixedString<64> against = objection(fine.seen, task.settings, 1);
  if (!against.empty()) {
    report.status = RegistrationStatus::rejected;
    report.note = against;
    return;
  }
  const Pose moved = pose * task.T_block_scanner.inverse();
  const double turned_rad = angle_between_rad(moved.rotation, Quat::Identity());
  if (moved.translation_mm.norm() > task.settings.window_mm || turned_rad > task.settings.window_rad) {
    report.status = RegistrationStatus::rejected;
    report.note.printf("moved %.1f mm, %.2f deg; window %.0f mm, %.1f deg", moved.translation_mm.norm(),
                       deg_from_rad(turned_rad), task.settings.window_mm, deg_from_rad(task.settings.window_rad));
    return;
  }
  report.status = fine.stands_still ? RegistrationStatus::converged : RegistrationStatus::iteration_limit;
  if (!fine.stands_still) report.note = "the pose still moves at the iteration limit";
}

}  // namespace

RegistrationReport register_block(const Cloud& cloud, const RegistrationTask& task, const RegistrationWorkspace& work,
                                  Team& team) {
  RegistrationReport report;
  Icp icp(task.model, task.table, task.settings, cloud, task.T_block_scanner, work.icp, team);
  Pose pose = task.T_block_scanner;
  FineResult fine;
  FixedString<64> along_rail;  // source of the position, if not from faces and casings
  // The last steps from a coarse pose, and their result.
  const auto finish = [&] {
    along_rail = FixedString<64>{};
    icp.hold({}, 0.0);
    icp.sort(pose);
    fine = refine(task, icp, Refine::or_open, pose, report.iterations);
    if (!fine.directions.complete) {
      CasingTies casings = tie_to_casings(cloud, icp.sample(), task.model, task.settings, pose, work.casings, team);
      if (casings.ties.empty()) casings = without_casings(task, icp, fine, pose, along_rail);
      if (!casings.ties.empty()) {
        if (Icp::length_mm(casings.T_block_scanner * pose.inverse()) > kSortedWithin_mm)
          icp.sort(casings.T_block_scanner);
        pose = casings.T_block_scanner;
        icp.hold(casings.ties, 2.0 * kConditionMin * fine.directions.largest);
      }
      if (!casings.ties.empty() || fine.left_open) fine = refine(task, icp, Refine::whole, pose, report.iterations);
    }
    report.note = FixedString<64>{};
    pass_judgement(task, pose, fine, report);
    if (report.status == RegistrationStatus::converged) report.note = along_rail;
  };
  Assessment seen;
  if (settle(task, icp, pose, seen, report.iterations) ||
      settle_by_casings(task, work, icp, seen, pose, report.iterations, team))
    finish();
  if (report.status != RegistrationStatus::converged) {
    pose = searched_pose(task, icp, report.iterations, team);
    finish();
  }

  report.T_scanner_block = pose.inverse();
  if (fine.directions.complete) {
    report.noise_mm = icp.noise_mm(pose, fine.gate_mm);
    report.covariance = icp.covariance(pose, fine.gate_mm);
  }
  // If the pose is accepted, the survey computes the deviations in its own pass.
  if (report.status != RegistrationStatus::converged) report.deviation = deviations(cloud, task, pose, work.histogram);
  return report;
}

}  // namespace slabd::algo
