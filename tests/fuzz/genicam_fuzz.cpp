// SPDX-License-Identifier: Apache-2.0
#include <cmath>
#include <cstring>
#include <vector>

#include "gateway/genicam/points.h"
#include "tests/fuzz/fuzz.h"

/// Input: one byte format, one width, one height, one flags, scale, offset and invalid value of each axis as float32;
/// the rest is the frame, repeated or cut to its size.
extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace slabd::gateway::genicam;  // NOLINT(google-build-using-namespace)
  constexpr std::size_t kHead = 4 + 9 * sizeof(float);
  if (size <= kHead) return 0;
  PointLayout layout;
  layout.format = static_cast<PointFormat>(data[0] % kPointFormats.size());
  layout.width = data[1];
  layout.height = data[2];
  for (std::size_t i = 0; i < layout.axes.size(); ++i) {
    std::array<float, 3> numbers{};
    std::memcpy(numbers.data(), data + 4 + 3 * sizeof(float) * i, sizeof numbers);
    layout.axes[i] = {static_cast<double>(numbers[0]), static_cast<double>(numbers[1]), ((data[3] >> i) & 1U) != 0,
                      static_cast<double>(numbers[2])};
  }
  if (!check(layout).ok()) return 0;
  slabd::fuzz::must(point_format_of(info(layout.format).code).value() == layout.format, "a format has its code");

  std::vector<std::byte> frame(layout.bytes());
  for (std::size_t i = 0; i < frame.size(); ++i) frame[i] = std::byte{data[kHead + i % (size - kHead)]};
  const std::size_t gap = first_gap(layout, frame);
  slabd::fuzz::must(gap <= frame.size(), "a gap is in the frame");
  slabd::fuzz::must(gap == frame.size() || frame[gap] == kUnwritten, "a gap begins with an unwritten byte");
  std::vector<float> xyz(3 * layout.points(), 1.0F);
  const std::size_t there = convert(layout, frame, xyz);
  std::size_t finite = 0;
  for (std::size_t i = 0; i < layout.points(); ++i) {
    const bool is_finite = std::isfinite(xyz[3 * i]) && std::isfinite(xyz[3 * i + 1]) && std::isfinite(xyz[3 * i + 2]);
    const bool is_missing = std::isnan(xyz[3 * i]) && std::isnan(xyz[3 * i + 1]) && std::isnan(xyz[3 * i + 2]);
    slabd::fuzz::must(is_finite || is_missing, "a point has three coordinates or none");
    finite += is_finite ? 1 : 0;
  }
  slabd::fuzz::must(finite == there, "the number of points is right");
  return 0;
}
