// SPDX-License-Identifier: Apache-2.0
#include "algo/row_parabola.h"

#include <gtest/gtest.h>

#include <cmath>

namespace slabd::algo {
namespace {

constexpr double kReach_mm = 0.5;
constexpr double kPitch_mm = 630.0;

/// A row with a warp of 0.3 mm, scatter, and its last seat low; returns what the last seat reads, and the largest of
/// the others.
struct Reading {
  double last_mm = 0.0;
  double others_mm = 0.0;
};
Reading read_row(std::size_t seats, double scatter_mm, double low_mm, Prng& prng) {
  std::array<RowHeight, limits::kPairsMax> row;
  for (std::size_t i = 0; i < seats; ++i) {
    const double along = static_cast<double>(i) - 4.0;
    row[i] = {kPitch_mm * along, 0.3 * along * along / 16.0 + scatter_mm * prng.normal(), true};
  }
  row[seats - 1].z_mm -= low_mm;
  const RowParabola fit = fit_row_parabola(std::span(row).first(seats), kReach_mm);
  EXPECT_TRUE(fit.ok);
  Reading reading;
  reading.last_mm = fit.off_mm[seats - 1];
  for (std::size_t i = 0; i + 1 < seats; ++i) reading.others_mm = std::fmax(reading.others_mm, std::abs(fit.off_mm[i]));
  return reading;
}

TEST(RowParabola, AnEndSeatBeyondItsToleranceReadsWhatItIs) {
  Prng prng(1);
  for (const std::size_t seats : {8U, 9U}) {
    for (const double low_mm : {0.52, 0.55, 0.6, 0.8, 2.0}) {
      const Reading reading = read_row(seats, 0.0, low_mm, prng);
      EXPECT_NEAR(reading.last_mm, -low_mm, 1e-6) << seats;
      EXPECT_NEAR(reading.others_mm, 0.0, 1e-6) << seats;
    }
    EXPECT_LT(std::abs(read_row(seats, 0.0, 0.3, prng).last_mm), 0.3) << "in place: it has a say in the warp";
  }
}

TEST(RowParabola, ScatterHidesFewEndSeatsAndAccusesFewSoundOnes) {
  constexpr int kRows = 1'000;
  for (const std::size_t seats : {8U, 9U}) {
    Prng prng(5);
    int hidden = 0;
    int accused = 0;
    for (int k = 0; k < kRows; ++k) {
      if (std::abs(read_row(seats, 0.05, 0.6, prng).last_mm) < 0.4) ++hidden;
      const Reading sound = read_row(seats, 0.1, 0.0, prng);
      if (std::fmax(std::abs(sound.last_mm), sound.others_mm) > kReach_mm) ++accused;
    }
    EXPECT_LT(hidden, kRows * 15 / 100) << seats << " seats";
    EXPECT_LT(accused, kRows * 25 / 1'000) << seats << " seats";
  }
}

}  // namespace
}  // namespace slabd::algo
