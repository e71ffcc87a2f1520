// SPDX-License-Identifier: Apache-2.0
#include "tests/sim/world.h"

#include <cstdio>

#include "tests/sim/allocation.h"

namespace slabd::sim {
namespace {

constexpr std::size_t kLinesKept = 60;

[[gnu::format(printf, 1, 0)]] std::string formatted(const char* format, va_list args) {
  std::array<char, 600> text{};
  std::vsnprintf(text.data(), text.size(), format, args);
  return text.data();
}

}  // namespace

void Trace::line(std::int64_t now_ns, const char* format, ...) {
  const heap::Aside aside;
  va_list args;
  va_start(args, format);
  const std::string text = formatted(format, args);
  va_end(args);
  number(static_cast<std::uint64_t>(now_ns));
  bytes(text.data(), text.size());
  std::array<char, 32> time{};
  std::snprintf(time.data(), time.size(), "%10.3f s  ", static_cast<double>(now_ns) * 1e-9);
  if (loud_) std::printf("%s%s\n", time.data(), text.c_str());
  lines_.push_back(time.data() + text);
  if (lines_.size() > kLinesKept) lines_.pop_front();
}

void World::violated(const char* format, ...) {
  const heap::Aside aside;
  if (!violation.empty()) return;
  va_list args;
  va_start(args, format);
  violation = formatted(format, args);
  va_end(args);
  trace.line(now_ns, "BROKEN: %s", violation.c_str());
}

}  // namespace slabd::sim
