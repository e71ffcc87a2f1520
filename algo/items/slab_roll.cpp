// SPDX-License-Identifier: Apache-2.0
//
// The frame is fitted to seats, and 2 mm between the heights of two rows 1516 mm apart turn it by 0.076 degrees: more
// than half of a slope's tolerance. Nor do the seats' own tilts tell: one row high by 2 mm with slopes 0.146 degrees
// too steep is, turned, two rows level with slopes 0.07 degrees too steep, down to the last seat. Only what is no seat
// can say which, and the slab's top is seen in every scan. It is rough, so it does not take part in the fit; but where
// it contradicts the fit, nobody knows which of the two is right, and the roll is as uncertain as they differ.
#include "algo/items/slab_roll.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "algo/items/slab_seats.h"

namespace slabd::algo {
namespace {

/// Of each row. A pass needs 18 blocks, of which the roughest concrete known leaves 13 with a top.
constexpr std::size_t kTopsMin = 3;
/// Seats and top of a slab that nobody would complain of: half a millimetre over the distance of the rows.
constexpr double kOrdinary_rad = rad_from_deg(0.02);
/// A top so rough that it cannot show a row 1 mm high is no reason to overlook one: 0.067 degrees from block to block.
constexpr double kTopsMax_rad = rad_from_deg(0.02);
/// Without a witness rows may differ by more than any slope's tolerance leaves room for.
constexpr double kUnwitnessed_rad = rad_from_deg(0.1);
/// Standard deviation of a median against that of a mean.
constexpr double kMedian = 1.2533;
/// Standard deviation from the median absolute deviation.
constexpr double kDeviation = 1.4826;

/// Values of one row, or of the whole slab.
class Sample {
 public:
  void add(double v) {
    if (std::isfinite(v)) at_[count_++] = v;
  }
  [[nodiscard]] std::size_t count() const { return count_; }
  /// Of an even number the mean of the two in the middle: the upper one of both rows would look like a roll.
  [[nodiscard]] double median() const {
    std::array<double, limits::kStationsMax> sorted = at_;
    const auto end = sorted.begin() + static_cast<std::ptrdiff_t>(count_);
    std::sort(sorted.begin(), end);
    return count_ == 0 ? 0.0 : 0.5 * (sorted[(count_ - 1) / 2] + sorted[count_ / 2]);
  }
  [[nodiscard]] std::span<const double> values() const { return {at_.data(), count_}; }

 private:
  std::array<double, limits::kStationsMax> at_{};
  std::size_t count_ = 0;
};

double square(double v) {
  return v * v;
}

}  // namespace

RollWitness witness_roll(const Recipe& recipe, std::span<const BlockResult> blocks, const Pose& T_base_slab,
                         const SlabBudget& known) {
  std::array<Sample, 2> rows;
  Sample height_mm;
  Sample tilt_rad;
  const Quat to_slab = T_base_slab.rotation.conjugate();
  for (int station = 1; station <= recipe.stations(); ++station) {
    const BlockResult* block = block_of(blocks, station);
    if (block == nullptr || !block->observation.top_ok) continue;
    const Vec3 n = to_slab * block->observation.top_n_base;
    rows[station <= recipe.slab.pairs ? 0 : 1].add(std::atan2(-n.y(), n.z()));
    height_mm.add(known.known_p_mm(station).z());
    tilt_rad.add(known.known_n_rad(station).y());
  }
  RollWitness witness;
  witness.u_rad = kUnwitnessed_rad;
  if (rows[0].count() < kTopsMin || rows[1].count() < kTopsMin) return witness;
  witness.seen = true;
  witness.roll_rad = 0.5 * (rows[0].median() + rows[1].median());

  Sample off;
  for (const Sample& row : rows)
    for (const double v : row.values()) off.add(std::abs(v - row.median()));
  const double scatter = kMedian * kDeviation * off.median();
  const double tops = 0.5 * std::hypot(scatter / std::sqrt(static_cast<double>(rows[0].count())),
                                       scatter / std::sqrt(static_cast<double>(rows[1].count())));
  // What a robot or a calibration does to one station it may do to a whole row: no averaging.
  const double rows_rad = std::sqrt(2.0) * height_mm.median() / recipe.slab.seat_centre_distance_mm.value;
  const double explained =
      square(kOrdinary_rad) + square(std::min(tops, kTopsMax_rad)) + square(rows_rad) + square(tilt_rad.median());
  witness.explained_rad = std::sqrt(explained);
  witness.u_rad = std::sqrt(std::max(square(witness.roll_rad) - explained, 0.0));
  return witness;
}

}  // namespace slabd::algo
