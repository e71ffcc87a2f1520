// SPDX-License-Identifier: Apache-2.0
//
// Where is the block? The robot says so to a millimetre or a few; the scan must say it to a micrometre, and must say
// when there is no block at all (paper 2.4).
//
// ICP, point to plane, against the analytic model: each sampled point is moved into the block frame, given to the
// closest face seen near its place, and the six-parameter step that shortens the distances is solved for (Gauss-
// Newton, Tukey weights). Gates shrink from the search radius to a few sigma. If the start does not lead to a pose at
// which every face is found, starts around it are tried.
//
// A wrong pose that looks converged is the worst outcome. So the pose is accepted only if the step is really tiny, no
// direction is undetermined, and of the points that the model expects on a face most are on it, face by face. A flat
// slab without a block satisfies the first test easily, and none of the others.
#include "algo/registration.h"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>

#include "algo/moments.h"

namespace slabd::algo {
namespace {

using Vec6 = Eigen::Matrix<double, 6, 1, Eigen::DontAlign>;
using Mat6 = Eigen::Matrix<double, 6, 6, Eigen::DontAlign>;

/// Rotations are scaled by the block's size so that all six parameters are lengths of like effect.
constexpr double kLever_mm = 150.0;
/// The pose stands still when no parameter moves the block's rim by more than this.
constexpr double kStepDone_mm = 1e-6;
/// One step never moves the pose further than this.
constexpr double kStepMax_mm = 30.0;
/// Smallest to largest eigenvalue of the normal matrix. A complete block has about 2e-2; without end faces 0.
constexpr double kConditionMin = 1e-3;
/// Share of a single face's points that must be on it. Lower than for the whole: a tool may lie on a shoulder.
constexpr double kFaceShareMin = 0.5;
/// A face seen by fewer sampled points says nothing.
constexpr std::size_t kFacePointsMin = 20;
constexpr std::size_t kCoarsePoints = 8192;
constexpr std::size_t kFinalSteps = 60;

struct Gate {
  double radius_mm;
  int steps;
};
constexpr std::array<Gate, 4> kCoarse = {{{25.0, 5}, {16.0, 5}, {10.0, 5}, {6.0, 5}}};
constexpr Gate kFine = {6.0, 4};
/// The last gate in medians of the worst face (of normal errors: seven medians are 4.7 sigma, Tukey's usual choice),
/// and its floor.
constexpr double kGateMedians = 7.0;
constexpr double kLastGateMin_mm = 0.15;

/// Extra starts, tried only when the splice's own pose does not hold: a grid of 14 mm steps, nearest first.
constexpr std::array<int, 5> kSearchSteps = {0, -1, 1, -2, 2};
constexpr double kSearchStep_mm = 14.0;

struct NormalEquations {
  Mat6 H = Mat6::Zero();
  Vec6 g = Vec6::Zero();
  std::size_t points = 0;
};

class Aligner {
 public:
  Aligner(const RegistrationTask& task, std::span<const Vec3> sample) : task_(task), sample_(sample) {}

  /// One Gauss-Newton step at `gate` on every `stride`-th point; returns the step's length, negative if unsolvable.
  double step(Pose& pose, double gate_mm, std::size_t stride, NormalEquations& eq) const {
    eq = accumulate(pose, gate_mm, stride);
    if (eq.points < 6) return -1.0;
    // A trace of damping: a direction nothing determines then stays where it was instead of running away.
    const Mat6 damped = eq.H + 1e-9 * eq.H.trace() * Mat6::Identity();
    const Eigen::LDLT<Eigen::Matrix<double, 6, 6>> solver(damped);
    Vec6 delta = -solver.solve(Eigen::Matrix<double, 6, 1>(eq.g));
    if (solver.info() != Eigen::Success || !delta.allFinite()) return -1.0;
    const double length = delta.norm();
    if (length > kStepMax_mm) delta *= kStepMax_mm / length;
    const Vec3 turn = delta.tail<3>() / kLever_mm;
    const double angle = turn.norm();
    Pose move;
    move.translation_mm = delta.head<3>();
    if (angle > 0.0) move.rotation = Quat(Eigen::AngleAxisd(angle, Eigen::Vector3d(turn / angle)));
    pose = move * pose;
    return length;
  }

  /// Closest face of a point in the block frame; the wide table while the gate is wide.
  [[nodiscard]] bool face_of(const Vec3& p, double gate_mm, Face& face, double& distance) const {
    const std::uint16_t candidates = gate_mm > FaceTable::kNear_mm ? task_.table.wide_at(p) : task_.table.near_at(p);
    return closest_face(task_.model.planes(), candidates, p, face, distance) && std::abs(distance) < gate_mm;
  }

 private:
  [[nodiscard]] NormalEquations accumulate(const Pose& pose, double gate_mm, std::size_t stride) const {
    NormalEquations eq;
    const Mat3 R = pose.rotation.toRotationMatrix();
    for (std::size_t i = 0; i < sample_.size(); i += stride) {
      const Vec3 p = R * sample_[i] + pose.translation_mm;
      Face face = Face::seat;
      double r = 0.0;
      if (!face_of(p, gate_mm, face, r)) continue;
      const double u = r / gate_mm;
      const double w = (1.0 - u * u) * (1.0 - u * u);
      const Vec3& n = task_.model.plane(face).n;
      const Vec3 lever = p.cross(n) / kLever_mm;
      const std::array<double, 6> j = {n.x(), n.y(), n.z(), lever.x(), lever.y(), lever.z()};
      for (int a = 0; a < 6; ++a) {
        const double wj = w * j[static_cast<std::size_t>(a)];
        eq.g[a] += wj * r;
        for (int b = a; b < 6; ++b) eq.H(a, b) += wj * j[static_cast<std::size_t>(b)];
      }
      ++eq.points;
    }
    for (int a = 0; a < 6; ++a)
      for (int b = 0; b < a; ++b) eq.H(a, b) = eq.H(b, a);
    return eq;
  }

  const RegistrationTask& task_;
  std::span<const Vec3> sample_;
};

/// How well a pose explains the sample, overall and face by face. Only points whose surroundings show a single face
/// vote for that face, so that edges do not blur the picture.
struct Assessment {
  std::size_t in_field = 0;
  std::size_t near_model = 0;
  std::array<std::size_t, kFaces> expected{};
  std::array<std::size_t, kFaces> found{};
  std::array<double, kFaces> residual_sum_mm{};

  [[nodiscard]] double share() const {
    return in_field == 0 ? 0.0 : static_cast<double>(near_model) / static_cast<double>(in_field);
  }
  [[nodiscard]] double share(std::size_t face) const {
    return expected[face] == 0 ? 0.0 : static_cast<double>(found[face]) / static_cast<double>(expected[face]);
  }
};

Assessment assess(const RegistrationTask& task, std::span<const Vec3> sample, std::size_t stride, const Pose& pose) {
  Assessment a;
  const Mat3 R = pose.rotation.toRotationMatrix();
  const double gate = task.settings.registration_gate_mm;
  for (std::size_t i = 0; i < sample.size(); i += stride) {
    const Vec3 p = R * sample[i] + pose.translation_mm;
    if (!FaceTable::inside(p)) continue;
    ++a.in_field;
    const std::uint16_t candidates = task.table.near_at(p);
    Face face = Face::seat;
    double r = 0.0;
    if (!closest_face(task.model.planes(), candidates, p, face, r)) continue;
    const bool near = std::abs(r) <= gate;
    if (near) ++a.near_model;
    if (std::popcount(candidates) != 1) continue;
    const auto f = static_cast<std::size_t>(face);
    ++a.expected[f];
    if (!near) continue;
    ++a.found[f];
    a.residual_sum_mm[f] += std::abs(r);
  }
  return a;
}

/// Empty when the pose explains the scan; else what speaks against it.
FixedString<64> objection(const Assessment& a, const EvaluationSettings& settings, std::size_t stride) {
  FixedString<64> note;
  if (!(a.share() >= settings.registration_share_min)) {
    note.printf("share on the model %.2f, at least %.2f", a.share(), settings.registration_share_min);
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
    if (a.expected[f] < points_min) continue;
    if (a.share(f) < kFaceShareMin) {
      note.printf("%s: share %.2f, at least %.2f", name(static_cast<Face>(f)).data(), a.share(f), kFaceShareMin);
      return note;
    }
    const double mean_mm = a.residual_sum_mm[f] / static_cast<double>(a.found[f]);
    if (mean_mm > 0.5 * settings.registration_gate_mm) {
      note.printf("%s: mean residual %.2f mm, at most %.2f", name(static_cast<Face>(f)).data(), mean_mm,
                  0.5 * settings.registration_gate_mm);
      return note;
    }
  }
  return note;
}

/// One point from each of equal slices of the scan: even coverage, no aliasing with the scan lines.
std::span<const Vec3> draw_sample(const Cloud& cloud, std::span<Vec3> sample) {
  Prng prng(0x5eedU);
  const std::size_t n = cloud.points;
  const std::size_t m = std::min(n, sample.size());
  for (std::size_t i = 0; i < m; ++i) {
    const std::size_t first = i * n / m;
    const std::size_t last = (i + 1) * n / m;
    const float* p = cloud.xyz.data() + 3 * (first + prng.below(last - first));
    sample[i] = Vec3(static_cast<double>(p[0]), static_cast<double>(p[1]), static_cast<double>(p[2]));
  }
  return sample.first(m);
}

/// Tries the spliced pose, then starts around it; returns the first that holds, else the one with the largest share.
Pose coarse_search(const RegistrationTask& task, const Aligner& aligner, std::span<const Vec3> sample,
                   std::size_t stride, int& iterations) {
  Pose best = task.T_block_scanner;
  double best_share = -1.0;
  for (const int ix : kSearchSteps) {
    for (const int iy : kSearchSteps) {
      Pose pose = task.T_block_scanner;
      pose.translation_mm += kSearchStep_mm * Vec3(ix, iy, 0.0);
      NormalEquations eq;
      bool solvable = true;
      for (const Gate& gate : kCoarse)
        for (int i = 0; i < gate.steps && solvable; ++i, ++iterations)
          solvable = aligner.step(pose, gate.radius_mm, stride, eq) >= 0.0;
      const Assessment a = assess(task, sample, stride, pose);
      if (solvable && objection(a, task.settings, stride).empty()) return pose;
      if (a.share() > best_share) {
        best_share = a.share();
        best = pose;
      }
    }
  }
  return best;
}

/// The gate of the last steps. A few sigma, so that dirt and damage have no pull; but no face may be shut out as a
/// whole: on a block whose ends are half a millimetre too long they still say where the middle is.
double last_gate(const Aligner& aligner, std::span<const Vec3> sample, std::size_t stride, const Pose& pose,
                 std::span<double> residuals) {
  const Mat3 R = pose.rotation.toRotationMatrix();
  const double widest = kFine.radius_mm;
  double gate = kLastGateMin_mm;
  for (std::size_t f = 0; f < kFaces; ++f) {
    std::size_t count = 0;
    for (std::size_t i = 0; i < sample.size(); i += stride) {
      Face face = Face::seat;
      double r = 0.0;
      if (aligner.face_of(R * sample[i] + pose.translation_mm, widest, face, r) && static_cast<std::size_t>(face) == f)
        residuals[count++] = std::abs(r);
    }
    if (count < kFacePointsMin) continue;
    const auto middle = residuals.begin() + static_cast<std::ptrdiff_t>(count / 2);
    std::nth_element(residuals.begin(), middle, residuals.begin() + static_cast<std::ptrdiff_t>(count));
    gate = std::max(gate, kGateMedians * *middle);
  }
  return std::min(gate, widest);
}

std::string_view direction_name(const Vec6& v) {
  constexpr std::array<std::string_view, 6> kNames = {"shift along the rail (x)",
                                                      "shift across the rail (y)",
                                                      "height (z)",
                                                      "tilt about x",
                                                      "tilt about y",
                                                      "turn about z"};
  int largest = 0;
  v.cwiseAbs().maxCoeff(&largest);
  return kNames[static_cast<std::size_t>(largest)];
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
  // Shares from the histogram: exact to one of its bins (0.05 um), without a second pass over the scan.
  std::size_t bin = 0;
  std::uint64_t within = 0;
  for (std::size_t k = 0; k < stats.within_sigma.size(); ++k) {
    const double limit_bins = static_cast<double>(k + 1) * stats.std_mm * bins_per_mm;
    for (; bin < histogram.size() && static_cast<double>(bin + 1) <= limit_bins; ++bin) within += histogram[bin];
    stats.within_sigma[k] = static_cast<double>(within) / static_cast<double>(stats.count);
  }
  return stats;
}

/// The final pose's status. The order matters: an undetermined direction explains best what is wrong.
void pass_judgement(const RegistrationTask& task, const Pose& pose, const NormalEquations& eq, bool stands_still,
                    const Assessment& a, RegistrationReport& report) {
  report.share_associated = a.share();
  Eigen::SelfAdjointEigenSolver<Eigen::Matrix<double, 6, 6>> solver;
  solver.compute(eq.H);
  const double largest = solver.eigenvalues()[5];
  const double smallest = std::fmax(solver.eigenvalues()[0], 0.0);
  report.condition = largest > 0.0 && smallest > 0.0 ? largest / smallest : std::numeric_limits<double>::infinity();
  if (eq.points < 6 || !pose.all_finite() || !(smallest > kConditionMin * largest)) {
    report.status = RegistrationStatus::degenerate;
    report.note.printf("nothing in the scan fixes: %s", direction_name(Vec6(solver.eigenvectors().col(0))).data());
    return;
  }
  const FixedString<64> against = objection(a, task.settings, 1);
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
  report.status = stands_still ? RegistrationStatus::converged : RegistrationStatus::iteration_limit;
  if (!stands_still) report.note = "the pose still moves at the iteration limit";
}

}  // namespace

RegistrationReport register_block(const Cloud& cloud, const RegistrationTask& task, const RegistrationWorkspace& work) {
  RegistrationReport report;
  const std::span<const Vec3> sample = draw_sample(cloud, work.sample);
  const std::size_t stride = std::max<std::size_t>(1, sample.size() / kCoarsePoints);
  const Aligner aligner(task, sample);

  Pose pose = coarse_search(task, aligner, sample, stride, report.iterations);
  NormalEquations eq;
  for (int i = 0; i < kFine.steps; ++i, ++report.iterations) (void)aligner.step(pose, kFine.radius_mm, 1, eq);
  const double gate = last_gate(aligner, sample, stride, pose, work.residuals);
  bool stands_still = false;
  for (std::size_t i = 0; i < kFinalSteps && !stands_still; ++i, ++report.iterations) {
    const double moved_mm = aligner.step(pose, gate, 1, eq);
    stands_still = moved_mm >= 0.0 && moved_mm < kStepDone_mm;
    if (moved_mm < 0.0) break;
  }

  report.T_scanner_block = pose.inverse();
  pass_judgement(task, pose, eq, stands_still, assess(task, sample, 1, pose), report);
  report.deviation = deviations(cloud, task, pose, work.histogram);
  return report;
}

}  // namespace slabd::algo
