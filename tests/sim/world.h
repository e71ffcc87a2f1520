// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdarg>
#include <cstdint>
#include <cstring>
#include <deque>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "base/base.h"
#include "base/prng.h"
#include "hal/hal.h"
#include "tests/sim/faults.h"

/// State shared by all parts of a simulated life: time, random sources, active faults, the trace and the violation.
namespace slabd::sim {

inline constexpr std::int64_t kMs = 1'000'000;
inline constexpr std::int64_t kSecond = 1'000 * kMs;
inline constexpr std::int64_t kNever = INT64_MAX;

/// All events, as one number and as the last lines. The same seed must give the same number with every compiler.
class Trace {
 public:
  explicit Trace(bool loud) : loud_(loud) {}

  void bytes(const void* data, std::size_t size) {
    const auto* at = static_cast<const unsigned char*>(data);
    for (; size >= 8; at += 8, size -= 8) {
      std::uint64_t word = 0;
      std::memcpy(&word, at, 8);
      number(word);
    }
    for (std::size_t i = 0; i < size; ++i) number(at[i]);
  }
  void number(std::uint64_t value) { hash_ = ((hash_ ^ value) * 0x9E3779B97F4A7C15U) ^ (hash_ >> 29U); }
  /// Adds a readable line, which also enters the number.
  [[gnu::format(printf, 3, 4)]] void line(std::int64_t now_ns, const char* format, ...);

  [[nodiscard]] std::uint64_t hash() const { return hash_; }
  [[nodiscard]] const std::deque<std::string>& last_lines() const { return lines_; }

 private:
  bool loud_;
  std::uint64_t hash_ = 0xCBF29CE484222325U;
  std::deque<std::string> lines_;
};

/// The active faults and their end times. While a fault is active, single operations fail with a certain probability.
struct Weather {
  std::array<std::int64_t, kFaults> until_ns{};
  [[nodiscard]] bool has(Fault fault, std::int64_t now_ns) const {
    return until_ns[static_cast<std::size_t>(fault)] > now_ns;
  }
  void clear() { until_ns = {}; }
};

struct World {
  World(std::uint64_t seed_in, bool loud) : seed(seed_in), trace(loud) {}

  std::uint64_t seed;
  std::int64_t now_ns = 0;
  Trace trace;
  Weather weather;
  Totals totals;
  std::string violation;  ///< the first broken promise; it ends the life

  // Clocks of slabd's computer.
  std::int64_t mono_offset_ns = 5 * kSecond;
  std::int64_t utime_offset_us = 1'790'000'000'000'000;
  std::int64_t mono_held_ns = 0;  ///< not 0: the monotonic clock stops at this value
  [[nodiscard]] std::int64_t mono_ns() const { return mono_held_ns != 0 ? mono_held_ns : now_ns + mono_offset_ns; }
  [[nodiscard]] std::int64_t utime_us() const { return now_ns / 1000 + utime_offset_us; }

  [[nodiscard]] bool faulty(Fault fault) const { return weather.has(fault, now_ns); }
  /// Probability of a fault: some windows of a fault are storms; in most it is rare, and work continues.
  [[nodiscard]] double often(Fault fault, double in_storm) const {
    const std::int64_t until_ns = weather.until_ns[static_cast<std::size_t>(fault)];
    if (until_ns <= now_ns) return 0.0;
    return until_ns / kMs % 4 == 0 ? in_storm : 0.05 * in_storm;
  }
  /// An independent random source for each part, so that one more draw in one part does not change the others. Without
  /// mixing, seeds would start the same sequence a few draws apart, and neighbouring seeds would give nearly the same
  /// life.
  [[nodiscard]] Prng chance(std::uint64_t part) const { return Prng(Prng(Prng(seed).next() + part).next()); }

  [[gnu::format(printf, 2, 3)]] void violated(const char* format, ...);
};

inline bool happens(Prng& chance, double probability) {
  return chance.uniform() < probability;
}
inline std::int64_t between(Prng& chance, std::int64_t low, std::int64_t high) {
  return low + static_cast<std::int64_t>(chance.below(static_cast<std::uint64_t>(high - low + 1)));
}

class WorldClock final : public hal::Clock {
 public:
  explicit WorldClock(const World& world) : world_(world) {}
  [[nodiscard]] std::int64_t mono_ns() const override { return world_.mono_ns(); }
  [[nodiscard]] std::int64_t utime_us() const override { return world_.utime_us(); }

 private:
  const World& world_;
};

}  // namespace slabd::sim
