// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

namespace slabd::limits {

// Capacities of the prints of the last exposures.
/// Window over the seat that a print covers: the evaluation region, 102 x 150 mm on all four types, and a millimetre
/// around it. Of a larger region the middle.
inline constexpr std::size_t kNoiseWindowX_mm = 104;
inline constexpr std::size_t kNoiseWindowS_mm = 152;
/// Places of a print: squares of 4 x 4 cells of 0.5 mm (fine), 0.75 mm (coarse), one at every second cell. Two point
/// pitches of a full scan and of a quarter one: finer cells are empty or lose what a filter leaves of the noise,
/// coarser ones hold the surface's texture.
inline constexpr std::size_t kNoiseFineColumns = (kNoiseWindowX_mm * 2 - 4) / 2 + 1;
inline constexpr std::size_t kNoiseFineRows = (kNoiseWindowS_mm * 2 - 4) / 2 + 1;
inline constexpr std::size_t kNoiseCoarseColumns = (kNoiseWindowX_mm * 4 / 3 - 4) / 2 + 1;
inline constexpr std::size_t kNoiseCoarseRows = (kNoiseWindowS_mm * 4 / 3 - 4) / 2 + 1;
/// Fewer places than this in common decide nothing: chance scatters by 1 / sqrt(places), 0.025 here, an eighth of
/// kSameExposure.
inline constexpr std::uint32_t kNoisePlacesMin = 2'000;
/// Exposures whose prints are kept: three slabs of 18 and a few repeats, as many as fingerprints. A scanner that gives
/// an older frame again gives one of its last few.
inline constexpr std::size_t kNoisePrintsKept = 64;

}  // namespace slabd::limits

/// The noise of one exposure, reduced to signs. Two exposures have nothing of their noise in common, not even two of
/// the same block; the same exposure has it in any format, order and pose.
namespace slabd {

/// One grid of places over the seat, row by row, a bit each.
template <std::size_t Columns, std::size_t Rows>
struct NoiseSigns {
  static constexpr std::size_t kColumns = Columns;                ///< along the rail
  static constexpr std::size_t kRows = Rows;                      ///< along the seat
  std::array<std::uint64_t, (Columns * Rows + 63) / 64> known{};  ///< enough points were seen there
  std::array<std::uint64_t, (Columns * Rows + 63) / 64> high{};   ///< and their noise is positive

  void set(std::size_t place, bool positive) {
    const std::uint64_t bit = std::uint64_t{1} << (place % 64);
    known[place / 64] |= bit;
    if (positive) high[place / 64] |= bit;
  }
};

/// How algo makes it: algo/features/seat_noise.h.
struct NoisePrint {
  NoiseSigns<limits::kNoiseFineColumns, limits::kNoiseFineRows> fine;  ///< empty if the scan is not dense enough
  NoiseSigns<limits::kNoiseCoarseColumns, limits::kNoiseCoarseRows> coarse;
  std::uint32_t places = 0;  ///< known ones of `coarse`; 0: the print is empty and decides nothing

  [[nodiscard]] bool empty() const { return places == 0; }
};

/// Correlation of two prints: (equal signs - different signs) / places known in both. 0 with a standard deviation of
/// 0.02 or less for two exposures, 0.8 for the same one measured again. The fine grid decides if both have one. NaN if
/// fewer than limits::kNoisePlacesMin places are known in both. 1 us.
[[nodiscard]] double noise_correlation(const NoisePrint& a, const NoisePrint& b);

/// From this correlation on two prints are of one exposure. tests/accuracy (study "exposures") has the distributions on
/// both sides: chance ends at 0.05, a block with three times the usual grain that is scanned again at 0.07; the same
/// exposure with every second row and column left out begins at 0.26.
inline constexpr double kSameExposure = 0.20;

/// A print with the scan that it is of.
struct KeptNoise {
  std::int64_t slab_key = 0;
  std::uint8_t station = 0;
  std::uint8_t attempt = 0;
  NoisePrint print;
};

/// A print as storage keeps it: little-endian words, fine then coarse, of each `known` then `high`.
inline constexpr std::size_t kNoisePrintBytes =
    sizeof(std::uint64_t) * 2 *
    (decltype(NoisePrint::fine){}.known.size() + decltype(NoisePrint::coarse){}.known.size());
using NoisePrintBytes = std::array<std::uint8_t, kNoisePrintBytes>;
[[nodiscard]] NoisePrintBytes to_bytes(const NoisePrint& print);
/// False if the bytes are not those of a print; `print` is untouched then.
[[nodiscard]] bool from_bytes(std::span<const std::uint8_t> bytes, NoisePrint& print);

}  // namespace slabd
