// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdarg>
#include <cstdio>
#include <string>

namespace slabd::calib {

/// A text as printf makes it, at most 511 bytes.
[[gnu::format(printf, 1, 2)]] inline std::string sentence(const char* format, ...) {
  std::array<char, 512> text{};
  va_list args;
  va_start(args, format);
  std::vsnprintf(text.data(), text.size(), format, args);
  va_end(args);
  return text.data();
}

}  // namespace slabd::calib
