// SPDX-License-Identifier: Apache-2.0
#include "base/noise_print.h"

#include <bit>
#include <limits>

namespace slabd {
namespace {

template <typename Signs>
std::uint32_t known_places(const Signs& signs) {
  std::uint32_t places = 0;
  for (const std::uint64_t word : signs.known) places += static_cast<std::uint32_t>(std::popcount(word));
  return places;
}

/// Number of places known in both, and number of those with different signs.
struct Agreement {
  std::uint32_t places = 0;
  std::uint32_t different = 0;

  [[nodiscard]] double correlation() const {
    return 1.0 - 2.0 * static_cast<double>(different) / static_cast<double>(places);
  }
};

template <typename Signs>
Agreement agreement(const Signs& a, const Signs& b) {
  Agreement result;
  for (std::size_t i = 0; i < a.known.size(); ++i) {
    const std::uint64_t both = a.known[i] & b.known[i];
    result.places += static_cast<std::uint32_t>(std::popcount(both));
    result.different += static_cast<std::uint32_t>(std::popcount((a.high[i] ^ b.high[i]) & both));
  }
  return result;
}

template <typename Print, typename F>
void for_words(Print& print, const F& f) {
  for (auto& word : print.fine.known) f(word);
  for (auto& word : print.fine.high) f(word);
  for (auto& word : print.coarse.known) f(word);
  for (auto& word : print.coarse.high) f(word);
}

}  // namespace

double noise_correlation(const NoisePrint& a, const NoisePrint& b) {
  // For two dense scans use the finer grid, which is less affected by surface texture.
  const Agreement fine = agreement(a.fine, b.fine);
  if (fine.places >= limits::kNoisePlacesMin) return fine.correlation();
  const Agreement coarse = agreement(a.coarse, b.coarse);
  if (coarse.places >= limits::kNoisePlacesMin) return coarse.correlation();
  return std::numeric_limits<double>::quiet_NaN();
}

NoisePrintBytes to_bytes(const NoisePrint& print) {
  NoisePrintBytes bytes;
  std::size_t at = 0;
  for_words(print, [&](std::uint64_t word) {
    for (unsigned shift = 0; shift < 64; shift += 8) bytes[at++] = static_cast<std::uint8_t>(word >> shift);
  });
  return bytes;
}

bool from_bytes(std::span<const std::uint8_t> bytes, NoisePrint& print) {
  if (bytes.size() != kNoisePrintBytes) return false;
  std::size_t at = 0;
  for_words(print, [&](std::uint64_t& word) {
    word = 0;
    for (unsigned shift = 0; shift < 64; shift += 8) word |= std::uint64_t{bytes[at++]} << shift;
  });
  print.places = known_places(print.coarse);
  return true;
}

}  // namespace slabd
