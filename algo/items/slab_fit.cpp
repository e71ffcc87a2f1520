// SPDX-License-Identifier: Apache-2.0
//
// One frame for the whole slab, from the seats themselves. A plain least-squares fit would distribute a displaced
// seat's error to all its neighbours: 0.8 mm at one corner rotates the frame, and seats that are in place are reported
// as displaced. So the fit is robust. The scale for "displaced" comes from the seats' own scatter on top of each seat's
// uncertainty. A warped slab scatters strongly in height, which increases the height scale and nothing else.
#include "algo/items/slab_fit.h"

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <Eigen/SVD>
#include <algorithm>
#include <array>
#include <cassert>
#include <cmath>
#include <limits>

namespace slabd::algo {
namespace {

using Mat6 = Eigen::Matrix<double, 6, 6>;

/// x, y, z of the reference point (mm) and the two tilts of the seat (rad).
constexpr std::size_t kChannels = 5;
/// Smallest scales: smaller differences always count as noise.
constexpr double kScaleMin_mm = 0.02;
constexpr double kScaleMin_rad = 2e-4;
constexpr int kHuberSteps = 15;
/// Re-weighting can converge slowly if a seat is on the border of being displaced: 6 % a step have been observed.
constexpr int kStepsMax = 1000;
constexpr double kLever_mm = 1000.0;
/// 95 % efficiency relative to least squares if no seat is displaced.
constexpr double kTukey = 4.685;

using PerSeat = std::array<double, limits::kStationsMax>;
using Channels = std::array<PerSeat, kChannels>;

/// Least-squares pose of all points (Kabsch): the plain fit and the start of the robust one. T_slab_base.
Pose plain_fit(std::span<const SeatInModel> seats) {
  Vec3 centre_base = Vec3::Zero();
  Vec3 centre_slab = Vec3::Zero();
  for (const SeatInModel& s : seats) {
    centre_base += s.p_base;
    centre_slab += s.p_slab;
  }
  centre_base /= static_cast<double>(seats.size());
  centre_slab /= static_cast<double>(seats.size());
  Eigen::Matrix3d H = Eigen::Matrix3d::Zero();
  for (const SeatInModel& s : seats) H += (s.p_slab - centre_slab) * (s.p_base - centre_base).transpose();
  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(H, Eigen::ComputeFullU | Eigen::ComputeFullV);
  Eigen::Matrix3d D = Eigen::Matrix3d::Identity();
  D(2, 2) = (svd.matrixU() * svd.matrixV().transpose()).determinant() < 0.0 ? -1.0 : 1.0;
  const Eigen::Matrix3d R = svd.matrixU() * D * svd.matrixV().transpose();
  Pose T_slab_base;
  T_slab_base.rotation = Quat(R).normalized();
  T_slab_base.translation_mm = centre_slab - T_slab_base.rotation * centre_base;
  return T_slab_base;
}

double position_rms(std::span<const SeatInModel> seats, const Pose& T_slab_base) {
  double squares = 0.0;
  for (const SeatInModel& s : seats) squares += (T_slab_base * s.p_base - s.p_slab).squaredNorm();
  return std::sqrt(squares / static_cast<double>(seats.size()));
}

void residuals_of(std::span<const SeatInModel> seats, const Pose& T_slab_base, Channels& r) {
  for (std::size_t i = 0; i < seats.size(); ++i) {
    const Vec3 dp = T_slab_base * seats[i].p_base - seats[i].p_slab;
    const Vec3 dn = T_slab_base.rotation * seats[i].n_base - seats[i].n_slab;
    r[0][i] = dp.x();
    r[1][i] = dp.y();
    r[2][i] = dp.z();
    r[3][i] = dn.x();
    r[4][i] = dn.y();
  }
}

double median_abs(const PerSeat& r, std::size_t count) {
  PerSeat a{};
  for (std::size_t i = 0; i < count; ++i) a[i] = std::abs(r[i]);
  const auto middle = a.begin() + static_cast<std::ptrdiff_t>(count / 2);
  std::nth_element(a.begin(), middle, a.begin() + static_cast<std::ptrdiff_t>(count));
  return *middle;
}

/// Variances of the measured components, at least the smallest scale, which also replaces unknown ones.
Channels variances_of(std::span<const SeatInModel> seats) {
  Channels v{};
  const auto at_least = [](double sigma, double least) {
    const double s = std::isfinite(sigma) ? std::max(sigma, least) : least;
    return s * s;
  };
  for (std::size_t i = 0; i < seats.size(); ++i)
    for (std::size_t c = 0; c < kChannels; ++c)
      v[c][i] = c < 3 ? at_least(seats[i].sigma_p_mm[static_cast<Eigen::Index>(c)], kScaleMin_mm)
                      : at_least(seats[i].sigma_n_rad[static_cast<Eigen::Index>(c - 3)], kScaleMin_rad);
  return v;
}

/// Robust standard deviation: Tukey's M-scale, for which half of the seats may be arbitrary. The median depends on one
/// seat's noise; this scale depends on all seats, so the weights, and with them the frame, follow the noise less.
double scatter_of(const PerSeat& r, std::size_t count) {
  constexpr double kHalfRho = 1.5476;  // mean rho is a half for a normal distribution of this scale
  constexpr int kRounds = 40;
  double scale = 1.4826 * median_abs(r, count);
  for (int round = 0; round < kRounds && scale > 0.0; ++round) {
    double rho = 0.0;
    for (std::size_t i = 0; i < count; ++i) {
      const double v = std::min(std::abs(r[i]) / (kHalfRho * scale), 1.0);
      const double inside = 1.0 - v * v;
      rho += 1.0 - inside * inside * inside;
    }
    scale *= std::sqrt(2.0 * rho / static_cast<double>(count));
  }
  return scale;
}

PerSeat off_median(const PerSeat& r, std::size_t count) {
  PerSeat sorted = r;
  const auto middle = sorted.begin() + static_cast<std::ptrdiff_t>(count / 2);
  std::nth_element(sorted.begin(), middle, sorted.begin() + static_cast<std::ptrdiff_t>(count));
  PerSeat off{};
  for (std::size_t i = 0; i < count; ++i) off[i] = r[i] - *middle;
  return off;
}

/// Scatter of the seats beyond their uncertainties. Tilts are taken about their own median: a rotated frame shows the
/// same tilt at every seat, which must correct the frame and not count as scatter. (One row warped by 3.6 mm once
/// rotated the frame by 0.1 degrees: the other row's heights agreed with that, and the tilts were treated as noise.)
double excess_variance(const PerSeat& r, const PerSeat& variance, std::size_t count, bool tilt) {
  const double scatter = scatter_of(tilt ? off_median(r, count) : r, count);
  return std::max(scatter * scatter - median_abs(variance, count), 0.0);
}

/// Huber first, which converges from a bad start; then Tukey, which gives a displaced seat no influence.
double weight_of(double r, double scale, bool tukey) {
  const double u = std::abs(r) / scale;
  if (!tukey) return u <= 1.345 ? 1.0 : 1.345 / u;
  const double v = u / kTukey;
  return v < 1.0 ? (1.0 - v * v) * (1.0 - v * v) : 0.0;
}

/// Derivative of residual c of a seat with respect to a small motion of the frame.
FrameVector jacobian(const Vec3& p, const Vec3& n, std::size_t c) {
  const bool position = c < 3;
  const Vec3 axis = Vec3::Unit(static_cast<Eigen::Index>(position ? c : c - 3));
  FrameVector j;
  j.head<3>() = position ? axis : Vec3(Vec3::Zero());
  j.tail<3>() = (position ? p : n).cross(axis) / kLever_mm;
  return j;
}

/// The normal equations of one step.
struct Normal {
  Mat6 H = Mat6::Zero();
  FrameVector g = FrameVector::Zero();
  Channels weight{};
  double position_squares = 0.0;
  double position_weight = 0.0;
};

Normal normal_equations(std::span<const SeatInModel> seats, const Pose& T_slab_base, const Channels& r,
                        const Channels& variance, const std::array<double, kChannels>& excess, bool tukey) {
  Normal eq;
  for (std::size_t i = 0; i < seats.size(); ++i) {
    const Vec3 p = T_slab_base * seats[i].p_base;
    const Vec3 n = T_slab_base.rotation * seats[i].n_base;
    for (std::size_t c = 0; c < kChannels; ++c) {
      const FrameVector j = jacobian(p, n, c);
      const double scale_squared = excess[c] + variance[c][i];
      const double robust = weight_of(r[c][i], std::sqrt(scale_squared), tukey);
      const double w = robust / scale_squared;
      eq.weight[c][i] = w;
      eq.H += w * j * j.transpose();
      eq.g += w * r[c][i] * j;
      if (c >= 3) continue;
      eq.position_squares += robust * r[c][i] * r[c][i];
      eq.position_weight += robust;
    }
  }
  return eq;
}

Pose motion(const FrameVector& delta) {
  const Vec3 turn = delta.tail<3>() / kLever_mm;
  Pose move;
  move.translation_mm = delta.head<3>();
  const double angle = turn.norm();
  if (angle > 0.0) move.rotation = Quat(Eigen::AngleAxisd(angle, Eigen::Vector3d(turn / angle)));
  return move;
}

/// d(r weight) / dr of the last weights: the remaining influence of a residual's own change.
double influence_of(double r, double scale) {
  const double v = std::abs(r) / (kTukey * scale);
  return v < 1.0 ? (1.0 - v * v) * (1.0 - 5.0 * v * v) : 0.0;
}

/// Implicit derivative of the solution for fixed scales: -(sum i j j')^-1 i j with i the influences. If doubtful seats
/// make that sum indefinite, the weights are used instead.
void respond(std::span<const SeatInModel> seats, const Pose& T_slab_base, const Channels& r, const Channels& variance,
             const std::array<double, kChannels>& excess, const Normal& eq, std::span<FrameResponse> response) {
  std::array<std::array<FrameVector, kChannels>, limits::kStationsMax> j;
  Channels pull{};
  Mat6 H = Mat6::Zero();
  for (std::size_t i = 0; i < response.size(); ++i)
    for (std::size_t c = 0; c < kChannels; ++c) {
      const double scale_squared = excess[c] + variance[c][i];
      j[i][c] = jacobian(T_slab_base * seats[i].p_base, T_slab_base.rotation * seats[i].n_base, c);
      pull[c][i] = influence_of(r[c][i], std::sqrt(scale_squared)) / scale_squared;
      H += pull[c][i] * j[i][c] * j[i][c].transpose();
    }
  Eigen::LDLT<Mat6> solver(H);
  const bool definite = solver.info() == Eigen::Success && solver.isPositive() && solver.rcond() > 1e-12;
  if (!definite) solver.compute(eq.H);
  for (std::size_t i = 0; i < response.size(); ++i)
    for (std::size_t c = 0; c < kChannels; ++c) {
      FrameVector by = -solver.solve(FrameVector((definite ? pull : eq.weight)[c][i] * j[i][c]));
      by.tail<3>() /= kLever_mm;
      (c < 3 ? response[i].by_p[c] : response[i].by_n[c - 3]) = by;
    }
}

}  // namespace

SlabFitReport fit_slab(std::span<const SeatInModel> seats, std::span<FrameResponse> response) {
  assert(response.empty() || response.size() == seats.size());
  SlabFitReport report;
  report.seats = static_cast<std::uint8_t>(seats.size());
  if (seats.size() < 3 || seats.size() > limits::kStationsMax) {
    report.note.printf("%zu seats, 3 to %zu can be fitted", seats.size(), limits::kStationsMax);
    return report;
  }
  Pose T_slab_base = plain_fit(seats);
  report.plain_rms_mm = position_rms(seats, T_slab_base);

  const Channels variance = variances_of(seats);
  Channels r;
  std::array<double, kChannels> excess{};
  Normal eq;
  for (report.iterations = 1; report.iterations <= kStepsMax; ++report.iterations) {
    residuals_of(seats, T_slab_base, r);
    const bool tukey = report.iterations > kHuberSteps;
    // The scales follow for some steps and are then fixed, so that the steps converge.
    if (report.iterations <= 4 * kHuberSteps)
      for (std::size_t c = 0; c < kChannels; ++c) excess[c] = excess_variance(r[c], variance[c], seats.size(), c >= 3);

    eq = normal_equations(seats, T_slab_base, r, variance, excess, tukey);
    const Eigen::LDLT<Mat6> solver(eq.H);
    const FrameVector delta = -solver.solve(eq.g);
    if (solver.info() != Eigen::Success || !delta.allFinite() || !(solver.rcond() > 1e-12)) {
      report.note = "the seats do not fix the slab's pose";
      return report;
    }
    T_slab_base = motion(delta) * T_slab_base;
    if (report.iterations > 4 * kHuberSteps && delta.norm() < 1e-9) {
      respond(seats, T_slab_base, r, variance, excess, eq, response);
      report.ok = true;
      break;
    }
  }
  if (!report.ok) report.note.printf("the slab's pose still moves after %d steps", kStepsMax);
  // Three components per seat: root mean square per seat, comparable with the plain one.
  report.rms_mm = eq.position_weight > 0.0 ? std::sqrt(3.0 * eq.position_squares / eq.position_weight) : kNoValue;
  report.T_base_slab = T_slab_base.inverse();
  return report;
}

// A slab may be warped within separate limits, so heights of seats are judged after the warp, a parabola per row, is
// subtracted. The parabola must be the warp of the seats that are in place: with nine points and three parameters an
// end seat has enough leverage that a least-squares parabola would follow it and hide two thirds of its error.
//
// The reach at which a seat loses its weight is fixed (the tolerance: a larger deviation is not warp) and not taken
// from the scatter of a few seats. So ordinary rows give almost ordinary least squares.

namespace {

using Mat3d = Eigen::Matrix3d;
using Vec3d = Eigen::Vector3d;

constexpr int kSettleStepsMax = 500;
constexpr double kStill_mm = 1e-12;
/// Cost, in units of a seat without weight, that a solution with a displaced seat may have in addition. With 0.05 mm of
/// scatter the share of end seats 0.6 mm low that read below 0.4 mm falls from 23 to 9 % (9 seats), from 43 to 11 %
/// (8). The share of sound rows with a seat beyond 0.5 mm at 0.1 mm of scatter rises from 0.3 to 0.6 %.
constexpr double kDoubt = 0.3;

/// The same if the cheapest solution has no displaced seat. With fewer seats it costs less to bend the parabola to a
/// low end seat: without scatter, 0.3 made an end seat of six that is 0.6 mm low read 0.09, one of seven that is 0.52
/// low 0.11. The shares above are 21 % (54 with 0.3) and 6.1 % (1.9) for six seats, 17 % (25) and 2.4 % (1.3) for
/// seven. If another seat is displaced already, this allowance would attribute its error to an end seat.
double doubt_of_silence(std::size_t seats) {
  if (seats >= 8) return kDoubt;
  return seats == 7 ? 0.45 : 0.55;
}

Vec3d basis(double x_mm) {
  const double x = x_mm / 1000.0;
  return {1.0, x, x * x};
}

class Row {
 public:
  Row(std::span<const RowHeight> seats, double reach_mm) : seats_(seats), reach_mm_(reach_mm) {}

  [[nodiscard]] double off(std::size_t i, const Vec3d& parabola) const {
    return seats_[i].z_mm - parabola.dot(basis(seats_[i].x_mm));
  }
  [[nodiscard]] bool counts(std::size_t i) const { return seats_[i].counts; }
  [[nodiscard]] std::size_t counting() const {
    return static_cast<std::size_t>(
        std::count_if(seats_.begin(), seats_.end(), [](const RowHeight& h) { return h.counts; }));
  }
  [[nodiscard]] double reach_mm() const { return reach_mm_; }
  [[nodiscard]] double weight(std::size_t i, const Vec3d& parabola) const {
    if (!seats_[i].counts) return 0.0;
    if (!std::isfinite(reach_mm_)) return 1.0;
    const double u = off(i, parabola) / reach_mm_;
    return std::abs(u) < 1.0 ? (1.0 - u * u) * (1.0 - u * u) : 0.0;
  }
  /// Sum of Tukey's rho, in units of its largest value.
  [[nodiscard]] double cost(const Vec3d& parabola) const {
    double sum = 0.0;
    for (std::size_t i = 0; i < seats_.size(); ++i) {
      if (!seats_[i].counts) continue;
      const double u = std::min(std::abs(off(i, parabola)) / reach_mm_, 1.0);
      const double in_place = 1.0 - u * u;
      sum += 1.0 - in_place * in_place * in_place;
    }
    return sum;
  }
  /// Parabola exactly through three seats. False if they are not at three different positions.
  [[nodiscard]] bool through(std::size_t i, std::size_t j, std::size_t k, Vec3d& parabola) const {
    Mat3d A;
    A.row(0) = basis(seats_[i].x_mm);
    A.row(1) = basis(seats_[j].x_mm);
    A.row(2) = basis(seats_[k].x_mm);
    const Eigen::FullPivLU<Mat3d> solver(A);
    if (!solver.isInvertible()) return false;
    parabola = solver.solve(Vec3d(seats_[i].z_mm, seats_[j].z_mm, seats_[k].z_mm));
    return true;
  }
  /// (sum w b b')^-1 with the weights at `parabola`. False if the seats with weight do not determine a parabola.
  [[nodiscard]] bool normal_inverse(const Vec3d& parabola, Mat3d& inverse) const {
    Mat3d H = Mat3d::Zero();
    for (std::size_t i = 0; i < seats_.size(); ++i) {
      const Vec3d b = basis(seats_[i].x_mm);
      H += weight(i, parabola) * b * b.transpose();
    }
    const Eigen::FullPivLU<Mat3d> solver(H);
    if (!solver.isInvertible() || !(solver.rcond() > 1e-9)) return false;
    inverse = solver.inverse();
    return true;
  }
  /// Re-weighted least squares until it converges (each step reduces the cost).
  [[nodiscard]] bool settle(Vec3d& parabola) const {
    for (int step = 0; step < kSettleStepsMax; ++step) {
      Mat3d inverse;
      if (!normal_inverse(parabola, inverse)) return false;
      Vec3d g = Vec3d::Zero();
      for (std::size_t i = 0; i < seats_.size(); ++i) {
        g += weight(i, parabola) * off(i, parabola) * basis(seats_[i].x_mm);
      }
      const Vec3d delta = inverse * g;
      parabola += delta;
      if (delta.norm() < kStill_mm) break;
    }
    return true;
  }
  [[nodiscard]] bool plain(Vec3d& parabola) const {
    parabola.setZero();
    return Row(seats_, kNoValue).settle(parabola);
  }

 private:
  std::span<const RowHeight> seats_;
  double reach_mm_;
};

/// Chooses among parabolas that fit most seats. One may run through an end seat that is displaced by hardly more than
/// the reach, so that no seat appears displaced, another through all other seats. The solution with the displaced seat
/// is chosen unless it costs clearly more.
class Choice {
 public:
  explicit Choice(const Row& row, std::size_t seats) : row_(row), seats_(seats) {}

  void offer(const Vec3d& start) {
    Vec3d parabola = start;
    if (!row_.settle(parabola)) return;
    found_[count_] = {parabola, row_.cost(parabola), largest_off(parabola)};
    if (count_ + 1 < found_.size()) ++count_;
  }
  [[nodiscard]] bool take(Vec3d& parabola) const {
    const Found* best = nullptr;
    for (std::size_t i = 0; i < count_; ++i)
      if (best == nullptr || found_[i].cost < best->cost) best = &found_[i];
    if (best == nullptr) return false;
    const double cheapest = best->cost;
    for (std::size_t i = 0; i < count_; ++i)
      if (found_[i].cost <= cheapest + kDoubt && found_[i].largest_off_mm > best->largest_off_mm + kStill_mm)
        best = &found_[i];
    if (!accuses(*best)) best = &cheapest_accusation(*best, cheapest + doubt_of_silence(row_.counting()));
    parabola = best->parabola;
    return true;
  }

 private:
  struct Found {
    Vec3d parabola = Vec3d::Zero();
    double cost = 0.0;
    double largest_off_mm = 0.0;
  };
  [[nodiscard]] bool accuses(const Found& found) const { return found.largest_off_mm > row_.reach_mm(); }
  [[nodiscard]] const Found& cheapest_accusation(const Found& silent, double limit) const {
    const Found* best = &silent;
    for (std::size_t i = 0; i < count_; ++i) {
      const Found& other = found_[i];
      if (accuses(other) && other.cost <= limit && (best == &silent || other.cost < best->cost)) best = &other;
    }
    return *best;
  }
  [[nodiscard]] double largest_off(const Vec3d& parabola) const {
    double largest = 0.0;
    for (std::size_t i = 0; i < seats_; ++i)
      if (row_.counts(i)) largest = std::fmax(largest, std::abs(row_.off(i, parabola)));
    return largest;
  }

  const Row& row_;
  std::size_t seats_;
  std::array<Found, limits::kPairsMax + 3> found_;
  std::size_t count_ = 0;
};

/// Starts from the plain parabola, from that of all seats but one, and from the best through three.
bool robust(const Row& row, std::span<const RowHeight> heights, Vec3d& parabola) {
  const std::size_t seats = heights.size();
  if (!row.plain(parabola)) return false;
  Choice choice(row, seats);
  choice.offer(parabola);
  Vec3d start = parabola;
  double best_start = std::numeric_limits<double>::infinity();
  for (std::size_t i = 0; i < seats; ++i)
    for (std::size_t j = i + 1; j < seats; ++j)
      for (std::size_t k = j + 1; k < seats; ++k) {
        Vec3d candidate;
        if (!row.counts(i) || !row.counts(j) || !row.counts(k)) continue;
        if (!row.through(i, j, k, candidate)) continue;
        const double cost = row.cost(candidate);
        if (cost >= best_start) continue;
        best_start = cost;
        start = candidate;
      }
  choice.offer(start);
  std::array<RowHeight, limits::kPairsMax> others;
  std::copy(heights.begin(), heights.end(), others.begin());
  for (std::size_t i = 0; i < seats; ++i) {
    if (!row.counts(i)) continue;
    others[i].counts = false;
    Vec3d without;
    if (Row(std::span(others).first(seats), kNoValue).plain(without)) choice.offer(without);
    others[i].counts = true;
  }
  return choice.take(parabola);
}

}  // namespace

RowParabola fit_row_parabola(std::span<const RowHeight> heights, double reach_mm) {
  RowParabola result;
  const auto counting = std::count_if(heights.begin(), heights.end(), [](const RowHeight& h) { return h.counts; });
  if (static_cast<std::size_t>(counting) < kParabolaSeatsMin || heights.size() > limits::kPairsMax) return result;
  const bool plain = !std::isfinite(reach_mm) || !(reach_mm > 0.0);
  const Row row(heights, plain ? kNoValue : reach_mm);
  Vec3d parabola = Vec3d::Zero();
  if (!(plain ? row.plain(parabola) : robust(row, heights, parabola))) return result;
  Mat3d inverse;
  if (!row.normal_inverse(parabola, inverse)) return result;
  std::size_t in_place = 0;
  for (std::size_t i = 0; i < heights.size(); ++i) {
    result.off_mm[i] = row.off(i, parabola);
    result.weight[i] = row.weight(i, parabola);
    if (result.weight[i] > 0.0) ++in_place;
    for (std::size_t k = 0; k < heights.size(); ++k) {
      const double pull = row.weight(k, parabola) * basis(heights[i].x_mm).dot(inverse * basis(heights[k].x_mm));
      result.response[i][k] = (i == k ? 1.0 : 0.0) - pull;
    }
  }
  result.ok = in_place >= kParabolaAgreeMin;
  return result;
}

}  // namespace slabd::algo
