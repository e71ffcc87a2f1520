// SPDX-License-Identifier: Apache-2.0
#include "algo/features/ripple.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "algo/median.h"

namespace slabd::algo {
namespace {

constexpr std::size_t kStrips = 3;
constexpr double kStrip_mm = 34.0;
constexpr double kBin_mm = 0.75;
constexpr std::size_t kBins = 240;
/// Half of the window whose mean is taken away: 12.75 mm, more than the longest period.
constexpr std::size_t kHalf = 8;
constexpr std::uint32_t kPointsMin = 8;
constexpr std::size_t kLooked = 65'536;
/// Points are taken in rows of so many, so that no step of the scan's lines meets the bins.
constexpr std::size_t kRow = 61;
/// Bins of a window that must be seen.
constexpr std::size_t kWindowMin = 12;
/// Of these bins at least.
constexpr std::size_t kSeenMin = 100;
/// Square of the median size over the variance, of a normal distribution; of a sine it is 1.
constexpr double kNoiseShare = 0.455;

struct Bin {
  double sum = 0.0;
  double squares = 0.0;
  std::uint32_t count = 0;
  [[nodiscard]] bool seen() const { return count >= kPointsMin; }
  [[nodiscard]] double mean() const { return sum / count; }
  /// Of the mean.
  [[nodiscard]] double variance() const {
    return std::max(squares - sum * sum / count, 0.0) / (static_cast<double>(count) * (count - 1));
  }
};

}  // namespace

double ripple_amplitude_mm(const ListedPoints& seat) {
  std::array<std::array<Bin, kBins>, kStrips> bins{};
  const std::size_t stride = 1 + seat.size() / kLooked;
  std::size_t row = 0;
  for (const SeatPoints& run : seat.runs)
    for (std::size_t first = 0; first < run.size(); first += kRow, ++row) {
      if (row % stride != 0) continue;
      for (std::size_t i = first; i < std::min(first + kRow, run.size()); ++i) {
        const double across = static_cast<double>(run.x[i]) / kStrip_mm + 0.5 * static_cast<double>(kStrips);
        const double along = static_cast<double>(run.s[i]) / kBin_mm + 0.5 * static_cast<double>(kBins);
        if (!(across >= 0.0 && along >= 0.0) || across >= static_cast<double>(kStrips) ||
            along >= static_cast<double>(kBins))
          continue;
        Bin& bin = bins[static_cast<std::size_t>(across)][static_cast<std::size_t>(along)];
        const auto h = static_cast<double>(run.h[i]);
        bin.sum += h;
        bin.squares += h * h;
        ++bin.count;
      }
    }
  std::array<double, kStrips * kBins> sizes;
  std::array<double, kStrips * kBins> noise;
  std::size_t seen = 0;
  for (const auto& strip : bins)
    for (std::size_t k = kHalf; k + kHalf < kBins; ++k) {
      if (!strip[k].seen()) continue;
      double sum = 0.0;
      std::size_t count = 0;
      for (std::size_t i = k - kHalf; i <= k + kHalf; ++i) {
        if (!strip[i].seen()) continue;
        sum += strip[i].mean();
        ++count;
      }
      if (count < kWindowMin) continue;
      sizes[seen] = std::abs(strip[k].mean() - sum / static_cast<double>(count));
      noise[seen++] = strip[k].variance();
    }
  if (seen < kSeenMin) return 0.0;
  const double typical = median_of(std::span(sizes).first(seen));
  const double of_noise = kNoiseShare * median_of(std::span(noise).first(seen));
  return std::sqrt(2.0 * std::max(typical * typical - of_noise, 0.0));
}

}  // namespace slabd::algo
