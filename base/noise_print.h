// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

namespace slabd::limits {

// Capacities of the prints of the last exposures.
/// Window over the seat covered by a print: the evaluation region, 102 x 150 mm on all four types, plus a millimetre
/// around it. For a larger region, its middle.
inline constexpr std::size_t kNoiseWindowX_mm = 104;
inline constexpr std::size_t kNoiseWindowS_mm = 152;
/// Places of a print: squares of 4 x 4 cells of 0.5 mm (fine) or 0.75 mm (coarse), one at every second cell. A cell is
/// two point pitches of a full scan, or of a quarter scan. Finer cells are empty or lose the noise that a filter
/// leaves; coarser cells contain surface texture.
inline constexpr std::size_t kNoiseFineColumns = (kNoiseWindowX_mm * 2 - 4) / 2 + 1;
inline constexpr std::size_t kNoiseFineRows = (kNoiseWindowS_mm * 2 - 4) / 2 + 1;
inline constexpr std::size_t kNoiseCoarseColumns = (kNoiseWindowX_mm * 4 / 3 - 4) / 2 + 1;
inline constexpr std::size_t kNoiseCoarseRows = (kNoiseWindowS_mm * 4 / 3 - 4) / 2 + 1;
/// With fewer common places two prints are not compared: random agreement scatters by 1 / sqrt(places), 0.025 here, an
/// eighth of kSameExposure.
inline constexpr std::uint32_t kNoisePlacesMin = 2'000;
/// Number of exposures whose prints are kept: three slabs of 18 and a few retries, as many as fingerprints. A scanner
/// that repeats an older frame repeats one of the last few.
inline constexpr std::size_t kNoisePrintsKept = 64;

}  // namespace slabd::limits

/// The noise of one exposure, reduced to signs. Two exposures have independent noise, even two of the same block. The
/// same exposure has the same noise in any format, order and pose.
namespace slabd {

/// One grid of places over the seat, row by row, one bit each.
template <std::size_t Columns, std::size_t Rows>
struct NoiseSigns {
  static constexpr std::size_t kColumns = Columns;                ///< along the rail
  static constexpr std::size_t kRows = Rows;                      ///< along the seat
  std::array<std::uint64_t, (Columns * Rows + 63) / 64> known{};  ///< enough points were found there
  std::array<std::uint64_t, (Columns * Rows + 63) / 64> high{};   ///< their noise is positive

  void set(std::size_t place, bool positive) {
    const std::uint64_t bit = std::uint64_t{1} << (place % 64);
    known[place / 64] |= bit;
    if (positive) high[place / 64] |= bit;
  }
};

/// Noise print of one exposure, computed in algo/features/seat_noise.h.
struct NoisePrint {
  NoiseSigns<limits::kNoiseFineColumns, limits::kNoiseFineRows> fine;  ///< empty if the scan is not dense enough
  NoiseSigns<limits::kNoiseCoarseColumns, limits::kNoiseCoarseRows> coarse;
  std::uint32_t places = 0;  ///< known places of `coarse`; 0: the print is empty and decides nothing

  [[nodiscard]] bool empty() const { return places == 0; }
};

/// Correlation of two prints: (equal signs - different signs) / places known in both. For two exposures it is 0 with a
/// standard deviation of 0.02 or less; for the same exposure measured again it is 0.8. The fine grid is used if both
/// have one. NaN if fewer than limits::kNoisePlacesMin places are known in both. Takes 1 us.
[[nodiscard]] double noise_correlation(const NoisePrint& a, const NoisePrint& b);

/// Minimum correlation of two prints of the same exposure. tests/accuracy (study "exposures") contains both
/// distributions. Different exposures reach 0.05; a block with three times the usual grain scanned again reaches 0.07.
/// The same exposure with every second row and column left out starts at 0.26.
inline constexpr double kSameExposure = 0.20;

/// A print and its scan.
struct KeptNoise {
  std::int64_t slab_key = 0;
  std::uint8_t station = 0;
  std::uint8_t attempt = 0;
  NoisePrint print;
};

/// Stored form of a print: little-endian words, fine then coarse, each `known` then `high`.
inline constexpr std::size_t kNoisePrintBytes =
    sizeof(std::uint64_t) * 2 *
    (decltype(NoisePrint::fine){}.known.size() + decltype(NoisePrint::coarse){}.known.size());
using NoisePrintBytes = std::array<std::uint8_t, kNoisePrintBytes>;
[[nodiscard]] NoisePrintBytes to_bytes(const NoisePrint& print);
/// False if the bytes are not a print; then `print` is unchanged.
[[nodiscard]] bool from_bytes(std::span<const std::uint8_t> bytes, NoisePrint& print);

}  // namespace slabd
