// SPDX-License-Identifier: Apache-2.0
#include "cli/parse.h"

#include <array>
#include <charconv>
#include <cmath>

namespace slabd::cli {

Result<Pose> parse_pose(std::string_view text) {
  constexpr std::string_view kSeparators = " ,\t";
  constexpr std::array kNames = {"x", "y", "z", "qw", "qx", "qy", "qz"};
  std::array<double, 7> numbers{};
  std::size_t count = 0;
  for (std::size_t at = text.find_first_not_of(kSeparators); at != std::string_view::npos;
       at = text.find_first_not_of(kSeparators, at)) {
    const std::size_t end = std::min(text.find_first_of(kSeparators, at), text.size());
    if (count == numbers.size()) return error(Code::config, "more than 7 numbers; expected x y z qw qx qy qz");
    const auto [stop, fault] = std::from_chars(text.data() + at, text.data() + end, numbers[count]);
    if (fault != std::errc{} || stop != text.data() + end || !std::isfinite(numbers[count]))
      return error(Code::config, "number %zu (%s) is '%.*s'; expected x y z qw qx qy qz", count + 1, kNames[count],
                   static_cast<int>(end - at), text.data() + at);
    ++count;
    at = end;
  }
  if (count != numbers.size()) return error(Code::config, "%zu numbers; expected x y z qw qx qy qz", count);
  const double length = std::hypot(std::hypot(numbers[3], numbers[4]), std::hypot(numbers[5], numbers[6]));
  if (std::abs(length - 1.0) > 1e-3)
    return error(Code::config, "the quaternion's length is %.6f, allowed 0.999..1.001", length);
  return Pose::from_array(numbers);
}

std::optional<hal::LengthUnit> length_unit(std::string_view name) {
  if (name == "mm") return hal::LengthUnit::mm;
  if (name == "m") return hal::LengthUnit::m;
  if (name == "um") return hal::LengthUnit::um;
  return std::nullopt;
}

}  // namespace slabd::cli
