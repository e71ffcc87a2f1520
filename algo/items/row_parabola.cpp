// SPDX-License-Identifier: Apache-2.0
//
// A slab may be warped within limits of its own, so heights of seats are judged after the warp, a parabola per row, is
// taken out. The parabola must be the warp of the seats that are in place: nine points and three parameters leave an
// end seat so much leverage that a least-squares parabola would follow it and hide two thirds of its error.
//
// The reach at which a seat loses its say is fixed (the tolerance: whoever is further out than that is no warp), not
// taken from the scatter of a handful of seats, so ordinary rows give ordinary least squares, nearly.
#include "algo/items/row_parabola.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <limits>

namespace slabd::algo {
namespace {

using Mat3d = Eigen::Matrix3d;
using Vec3d = Eigen::Vector3d;

constexpr int kStepsMax = 500;
constexpr double kStill_mm = 1e-12;
/// In costs of a seat that has no say: so much more a solution may cost that accuses a seat. With 0.05 mm of scatter
/// the share of end seats 0.6 mm low that read below 0.4 mm falls from 23 to 9 % (9 seats), from 43 to 11 % (8); the
/// share of sound rows with a seat beyond 0.5 mm at 0.1 mm of scatter rises from 0.3 to 0.6 %.
constexpr double kDoubt = 0.3;

/// The same where what is cheapest accuses nobody. The fewer seats, the less it costs to bend the parabola to a low end
/// seat: without scatter 0.3 let an end seat of six that is 0.6 mm low read 0.09, one of seven that is 0.52 low 0.11.
/// The shares above are 21 % (54 with 0.3) and 6.1 % (1.9) for six seats, 17 % (25) and 2.4 % (1.3) for seven. Where
/// somebody is accused already so much doubt would accuse an end seat of its neighbour's error.
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
  /// Through three seats exactly; false when they are not three places.
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
  /// (sum w b b')^-1 with the weights at `parabola`; false when the seats that count do not fix one.
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
  /// Re-weighted least squares until it stands still (each step lowers the cost).
  [[nodiscard]] bool settle(Vec3d& parabola) const {
    for (int step = 0; step < kStepsMax; ++step) {
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

/// The parabola of the seats that are in place. Several may claim that: one through an end seat that is out of its
/// place by hardly more than the reach, which then is nobody's error, and one through all others. What accuses a seat
/// is believed unless it costs clearly more.
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

/// Started from the plain parabola, from that of all seats but one, and from the best through three.
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
