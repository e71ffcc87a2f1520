// SPDX-License-Identifier: Apache-2.0
#include "daemon/station/station_views.h"

#include <Eigen/Cholesky>
#include <algorithm>

namespace slabd::daemon {
namespace {

// Deviation of a good seat's registered position from the slab's rigid placement, standard deviation per axis. Sources:
// casting (0.05 mm), registration of a real form to the nominal one, the robot's repeatability.
constexpr double kSeatSigma_mm = 0.10;
constexpr double kSeatSigma_rad = 0.02 * kPi / 180.0;
// Tolerance in standard deviations; larger if the slab's seats scatter more (a robot without corrections), up to a
// maximum.
constexpr double kSigmas = 5.0;
constexpr double kToleranceMmMax = 1.2;
constexpr double kToleranceRadMax = 0.15 * kPi / 180.0;
// Two scans of one block from one stop differ by the robot's repeatability only.
constexpr double kSameView_mm = 0.3;
constexpr double kSameView_rad = 0.04 * kPi / 180.0;
// Difference in the placement of two slabs. The first scan of a slab can only be compared with earlier slabs.
constexpr double kPlacedAnew_mm = 6.0;
constexpr double kPlacedAnew_rad = 0.15 * kPi / 180.0;
// Uncertainty of a slab's placement before its first scan.
constexpr double kPlacedSigma_mm = 20.0;
constexpr double kPlacedSigma_rad = 0.2 * kPi / 180.0;
constexpr int kFitTurns = 8;
constexpr double kOutlierSigmas = 3.0;

using Vec6 = Eigen::Matrix<double, 6, 1>;
using Solved6 = Eigen::Matrix<double, 6, 6>;

Vec3 rotation_vector(const Quat& q) {
  const double s = q.w() < 0.0 ? -1.0 : 1.0;
  const Vec3 v = s * q.vec();
  const double n = v.norm();
  return n < 1e-12 ? Vec3(2.0 * v) : Vec3(2.0 * std::atan2(n, s * q.w()) / n * v);
}

/// A small motion of one block in the base frame, from its nominal position.
struct Shift {
  Vec3 p_base = Vec3::Zero();  ///< nominal position
  Vec3 mm = Vec3::Zero();
  Vec3 rad = Vec3::Zero();
};

/// Displacement of the block if the scan was taken from this stop and shows its block.
Shift shift_from(const Pose& T_base_scanner, const Pose& T_base_block, const Pose& T_scanner_block) {
  const Pose there = T_base_scanner * T_scanner_block;
  Shift shift;
  shift.p_base = T_base_block.translation_mm;
  shift.mm = there.translation_mm - T_base_block.translation_mm;
  shift.rad = rotation_vector((there.rotation * T_base_block.rotation.conjugate()).normalized());
  return shift;
}

struct Off {
  double mm = 0.0;
  double rad = 0.0;
};
struct Tolerance {
  double mm = 0.0;
  double rad = 0.0;
};

using Shifts = FixedVector<Shift, limits::kStationsMax>;

/// A slab's rigid displacement from its nominal place, fitted to the shifts of its blocks; displaced seats have less
/// weight.
class Placement {
 public:
  explicit Placement(const Shifts& shifts) : count_(shifts.size()) {
    if (shifts.empty()) return;
    for (const Shift& shift : shifts) centre_ += shift.p_base / static_cast<double>(shifts.size());
    std::array<double, limits::kStationsMax> weight{};
    weight.fill(1.0);
    double scatter = 1.0;
    for (int turn = 0; turn < kFitTurns; ++turn) {
      Solved6 normal = Solved6::Zero();
      Vec6 right = Vec6::Zero();
      normal.diagonal().head<3>().setConstant(1.0 / (kPlacedSigma_mm * kPlacedSigma_mm));
      normal.diagonal().tail<3>().setConstant(1.0 / (kPlacedSigma_rad * kPlacedSigma_rad));
      for (std::size_t i = 0; i < shifts.size(); ++i) {
        const Eigen::Matrix<double, 3, 6> J = jacobian(shifts[i].p_base);
        const double w_mm = weight[i] / (kSeatSigma_mm * kSeatSigma_mm);
        const double w_rad = weight[i] / (kSeatSigma_rad * kSeatSigma_rad);
        normal += w_mm * J.transpose() * J;
        right += w_mm * J.transpose() * shifts[i].mm;
        normal.bottomRightCorner<3, 3>().diagonal().array() += w_rad;
        right.tail<3>() += w_rad * shifts[i].rad;
      }
      const Eigen::LDLT<Solved6> solver(normal);
      motion_ = solver.solve(right);
      covariance_ = solver.solve(Solved6::Identity());
      double sum = 0.0;
      double weights = 0.0;
      for (std::size_t i = 0; i < shifts.size(); ++i) {
        const Off off = off_of(shifts[i]);
        const double r2 = off.mm * off.mm / (3.0 * kSeatSigma_mm * kSeatSigma_mm) +
                          off.rad * off.rad / (3.0 * kSeatSigma_rad * kSeatSigma_rad);
        weight[i] = 1.0 / (1.0 + r2 / (kOutlierSigmas * kOutlierSigmas));
        sum += weight[i] * 0.5 * r2;
        weights += weight[i];
      }
      // Six parameters for six numbers a seat: one seat gives no estimate of the scatter.
      const double freedom = weights * (1.0 - 1.0 / static_cast<double>(shifts.size()));
      scatter = freedom > 0.5 ? std::sqrt(sum / freedom) : 1.0;
    }
    scatter_ = std::max(1.0, scatter);
  }

  [[nodiscard]] bool is_known() const { return count_ > 0; }
  [[nodiscard]] Off off_of(const Shift& shift) const {
    return {Vec3(shift.mm - jacobian(shift.p_base) * motion_).norm(), Vec3(shift.rad - motion_.tail<3>()).norm()};
  }
  /// Range of a good seat's position, as far as known from the scans so far: one block gives little information about
  /// the other end of the slab.
  [[nodiscard]] Tolerance scatter_at(const Vec3& p_base) const {
    const Eigen::Matrix<double, 3, 6> J = jacobian(p_base);
    const Eigen::Matrix3d of_place = J * covariance_ * J.transpose();
    const double place_mm2 = of_place.diagonal().maxCoeff() + kSeatSigma_mm * kSeatSigma_mm;
    const double place_rad2 = covariance_.diagonal().tail<3>().maxCoeff() + kSeatSigma_rad * kSeatSigma_rad;
    return {kSigmas * scatter_ * std::sqrt(place_mm2), kSigmas * scatter_ * std::sqrt(place_rad2)};
  }
  /// Tolerance within which a seat at this position agrees.
  [[nodiscard]] Tolerance tolerance_at(const Vec3& p_base) const {
    const Tolerance scatter = scatter_at(p_base);
    return {std::min(kToleranceMmMax, scatter.mm), std::min(kToleranceRadMax, scatter.rad)};
  }

 private:
  /// t + w x (p - centre), over (t, w).
  [[nodiscard]] Eigen::Matrix<double, 3, 6> jacobian(const Vec3& p_base) const {
    const Vec3 r = p_base - centre_;
    Eigen::Matrix<double, 3, 6> J = Eigen::Matrix<double, 3, 6>::Zero();
    J.leftCols<3>().setIdentity();
    J(0, 4) = r.z();
    J(0, 5) = -r.y();
    J(1, 3) = -r.z();
    J(1, 5) = r.x();
    J(2, 3) = r.y();
    J(2, 4) = -r.x();
    return J;
  }

  std::size_t count_ = 0;
  Vec3 centre_ = Vec3::Zero();
  Vec6 motion_ = Vec6::Zero();
  Solved6 covariance_ = Solved6::Zero();
  double scatter_ = 1.0;
};

Shift own_shift(const View& view) {
  return shift_from(view.T_base_scanner, view.T_base_block, view.T_scanner_block);
}

std::size_t index_of(int station) {
  return static_cast<std::size_t>(station - 1);
}

Off between(const Pose& a, const Pose& b) {
  return {(a.translation_mm - b.translation_mm).norm(), angle_between_rad(a.rotation, b.rotation)};
}

/// Nominal view of a stop: the pose of its block if the slab is at its nominal place.
Pose nominal_view(const View& stop) {
  return stop.T_base_scanner.inverse() * stop.T_base_block;
}

/// Compares the current scan with the other views.
class Comparison {
 public:
  Comparison(const Views& views, int station, const View& view) : views_(views), station_(station), view_(view) {
    for (std::size_t i = 0; i < views.slab.size(); ++i)
      if (views.slab[i].seen || views.last[i].seen) count_ = std::max(count_, static_cast<int>(i) + 1);
    count_ = std::max(count_, station);
  }

  ViewFinding run() {
    Shifts of_slab;
    for (std::size_t i = 0; i < views_.slab.size(); ++i)
      if (views_.slab[i].seen && i != index_of(station_)) (void)of_slab.push(own_shift(views_.slab[i]));
    Shifts of_last;
    for (const View& view : views_.last)
      if (view.seen) (void)of_last.push(own_shift(view));
    const Placement slab(of_slab);
    const Placement last(of_last);
    if (!does_not_lie_at_its_own(slab.is_known() ? slab : last, slab.is_known())) return finding_;
    if (slab.is_known()) look_from_every_stop(slab);
    if (last.is_known()) look_from_last_slab(last);
    look_from_neighbours(-1);
    look_from_neighbours(+1);
    look_at_recent();
    return finding_;
  }

 private:
  bool does_not_lie_at_its_own(const Placement& placement, bool is_this_slab) {
    const Shift shift = own_shift(view_);
    const Off off = placement.off_of(shift);
    finding_.own_off_mm = off.mm;
    finding_.own_off_rad = off.rad;
    Tolerance tolerance = placement.is_known() ? placement.scatter_at(shift.p_base) : Tolerance{};
    if (!is_this_slab) {
      tolerance.mm += kPlacedAnew_mm;
      tolerance.rad += kPlacedAnew_rad;
    }
    return off.mm > kSeatOff_mm + tolerance.mm || off.rad > kSeatOff_rad + tolerance.rad;
  }

  /// Refuses the scan if it agrees with a scan of `stop`'s block from that stop.
  void try_stop(const View& stop, int stop_station, bool of_last_slab, const Placement& placement) {
    if (!stops_differ(stop, view_)) return;
    const Shift shift = shift_from(stop.T_base_scanner, stop.T_base_block, view_.T_scanner_block);
    const Tolerance tolerance = placement.tolerance_at(shift.p_base);
    note(placement.off_of(shift), tolerance, stop_station, of_last_slab);
  }

  void note(const Off& off, const Tolerance& tolerance, int stop_station, bool of_last_slab) {
    if (off.mm > tolerance.mm || off.rad > tolerance.rad) return;
    if (finding_.is_refused && off.mm >= finding_.other_off_mm) return;
    finding_.is_refused = true;
    finding_.station = stop_station;
    finding_.of_last_slab = of_last_slab;
    finding_.other_off_mm = off.mm;
    finding_.other_off_rad = off.rad;
  }

  /// Stop of this slab, or of the last slab if this one has not reached it yet, because the robot program is the same.
  [[nodiscard]] const View* stop_at(std::size_t index) const {
    if (views_.slab[index].seen) return &views_.slab[index];
    return views_.last[index].seen ? &views_.last[index] : nullptr;
  }

  void look_from_every_stop(const Placement& slab) {
    for (std::size_t i = 0; i < views_.slab.size(); ++i)
      if (const View* stop = stop_at(i); stop != nullptr && i != index_of(station_))
        try_stop(*stop, static_cast<int>(i) + 1, false, slab);
  }

  void look_from_last_slab(const Placement& last) {
    for (std::size_t i = 0; i < views_.last.size(); ++i)
      if (views_.last[i].seen) try_stop(views_.last[i], static_cast<int>(i) + 1, true, last);
  }

  /// Checks whether every scan of this slab is one stop behind or ahead: then they agree with one another as scans from
  /// there.
  void look_from_neighbours(int step) {
    const auto neighbour = [&](std::size_t index) -> const View* {
      return stop_at(static_cast<std::size_t>((static_cast<int>(index) + step + count_) % count_));
    };
    Shifts shifts;
    for (std::size_t i = 0; i < views_.slab.size(); ++i) {
      const View* stop = neighbour(i);
      if (views_.slab[i].seen && i != index_of(station_) && stop != nullptr)
        (void)shifts.push(shift_from(stop->T_base_scanner, stop->T_base_block, views_.slab[i].T_scanner_block));
    }
    const View* stop = neighbour(index_of(station_));
    if (shifts.empty() || stop == nullptr) return;
    try_stop(*stop, (station_ - 1 + step + count_) % count_ + 1, false, Placement(shifts));
  }

  /// Checks for the repeated view of another stop, independent of the robot's real position.
  void look_at_recent() {
    for (const View& other : views_.recent)
      if (stops_differ(other, view_))
        note(between(other.T_scanner_block, view_.T_scanner_block), {kSameView_mm, kSameView_rad}, 0, false);
  }

  const Views& views_;
  int station_;
  const View& view_;
  int count_ = 1;  ///< number of stations seen so far
  ViewFinding finding_;
};

}  // namespace

void Views::begin_slab() {
  const bool any = std::any_of(slab.begin(), slab.end(), [](const View& view) { return view.seen; });
  if (any) last = slab;
  slab = {};
}

void Views::keep(int station, const View& view, bool is_refused) {
  if (recent.full()) recent.erase(0);
  (void)recent.push(view);
  if (!is_refused) slab[index_of(station)] = view;
}

ViewFinding compare_view(const Views& views, int station, const View& view) {
  if (!view.seen) return {};
  return Comparison(views, station, view).run();
}

FixedString<limits::kErrorTextBytes> text_of(const ViewFinding& finding, int station) {
  FixedString<limits::kErrorTextBytes> text;
  if (finding.station == 0)
    text.printf("the scan shows its block as an earlier scan from another stop does");
  else
    text.printf("the scan shows its block where the stop of station %d%s would see it", finding.station,
                finding.of_last_slab ? " of the slab before" : "");
  FixedString<limits::kErrorTextBytes> figures;
  figures.printf(
      " (%.2f mm, %.3f deg off), not where station %d's does (%.2f mm, %.3f deg off): the scanner gave another "
      "exposure, or these are not the robot's poses",
      finding.other_off_mm, deg_from_rad(finding.other_off_rad), station, finding.own_off_mm,
      deg_from_rad(finding.own_off_rad));
  text.append(figures.view());
  return text;
}

static_assert(kStopsDiffer_mm >= kSeatOff_mm + kSigmas * kSeatSigma_mm - 1e-9,
              "a seat out of place is not another stop");
static_assert(kStopsDiffer_rad >= kSeatOff_rad + kSigmas * kSeatSigma_rad - 1e-9,
              "a seat that is turned is not another stop");

bool stops_differ(const View& a, const View& b) {
  const Off off = between(nominal_view(a), nominal_view(b));
  return off.mm > kStopsDiffer_mm || off.rad > kStopsDiffer_rad;
}

int stop_like_the_next(const SlabViews& views) {
  std::size_t count = 0;
  for (std::size_t i = 0; i < views.size(); ++i)
    if (views[i].seen) count = i + 1;
  if (count < 2) return 0;
  for (std::size_t i = 0; i < count; ++i) {
    const View& next = views[(i + 1) % count];
    if (views[i].seen && next.seen && !stops_differ(views[i], next)) return static_cast<int>(i) + 1;
  }
  return 0;
}

}  // namespace slabd::daemon
