// SPDX-License-Identifier: Apache-2.0
#include "algo/items/slab_fit.h"

#include <gtest/gtest.h>

#include <cmath>

namespace slabd::algo {
namespace {

constexpr double kReach_mm = 0.5;
constexpr double kPitch_mm = 630.0;

constexpr std::size_t kEveryRow[] = {6, 7, 8, 9};

/// A row with a warp of 0.3 mm, scatter, and one seat low; the reading of that seat, and the largest of the others.
struct Reading {
  double low_mm = 0.0;
  double others_mm = 0.0;
};
Reading read_row(std::size_t seats, std::size_t low, double scatter_mm, double low_mm, Prng& prng) {
  std::array<RowHeight, limits::kPairsMax> row;
  for (std::size_t i = 0; i < seats; ++i) {
    const double along = static_cast<double>(i) - 4.0;
    row[i] = {kPitch_mm * along, 0.3 * along * along / 16.0 + scatter_mm * prng.normal(), true};
  }
  row[low].z_mm -= low_mm;
  const RowParabola fit = fit_row_parabola(std::span(row).first(seats), kReach_mm);
  EXPECT_TRUE(fit.ok);
  Reading reading;
  reading.low_mm = fit.off_mm[low];
  for (std::size_t i = 0; i < seats; ++i)
    if (i != low) reading.others_mm = std::fmax(reading.others_mm, std::abs(fit.off_mm[i]));
  return reading;
}

TEST(RowParabola, one_seat_beyond_its_tolerance_reads_what_it_is) {
  Prng prng(1);
  for (const std::size_t seats : kEveryRow) {
    for (std::size_t low = 0; low < seats; ++low) {
      for (const double off_mm : {0.505, 0.52, 0.55, 0.6, 0.65, 0.7, 0.8, 1.0, 2.0, -0.52, -0.6, -0.8}) {
        const Reading reading = read_row(seats, low, 0.0, off_mm, prng);
        EXPECT_NEAR(reading.low_mm, -off_mm, 1e-6) << seats << " seats, " << low << " off by " << off_mm;
        EXPECT_NEAR(reading.others_mm, 0.0, 1e-6) << seats << " seats, " << low << " off by " << off_mm;
      }
    }
    EXPECT_LT(std::abs(read_row(seats, seats - 1, 0.0, 0.3, prng).low_mm), 0.3) << "in place: it has a say in the warp";
  }
}

TEST(RowParabola, scatter_hides_few_end_seats_and_accuses_few_sound_ones) {
  constexpr int kRows = 1'000;
  for (const std::size_t seats : kEveryRow) {
    Prng prng(5);
    int hidden = 0;
    int accused = 0;
    for (int k = 0; k < kRows; ++k) {
      if (std::abs(read_row(seats, seats - 1, 0.05, 0.6, prng).low_mm) < 0.4) ++hidden;
      const Reading sound = read_row(seats, seats - 1, 0.1, 0.0, prng);
      if (std::fmax(std::abs(sound.low_mm), sound.others_mm) > kReach_mm) ++accused;
    }
    const int hidden_percent = seats == 6 ? 25 : seats == 7 ? 20 : 15;
    const int accused_per_mille = seats == 6 ? 80 : seats == 7 ? 40 : 25;
    EXPECT_LT(hidden, kRows * hidden_percent / 100) << seats << " seats";
    EXPECT_LT(accused, kRows * accused_per_mille / 1'000) << seats << " seats";
  }
}

}  // namespace
}  // namespace slabd::algo
