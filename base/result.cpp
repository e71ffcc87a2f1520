// SPDX-License-Identifier: Apache-2.0
#include "base/result.h"

#include <array>
#include <cstdarg>
#include <cstdio>

namespace slabd {

Error error(Code code, const char* format, ...) {
  std::array<char, limits::kErrorTextBytes + 1> text{};
  va_list args;
  va_start(args, format);
  std::vsnprintf(text.data(), text.size(), format, args);
  va_end(args);
  return {code, FixedString<limits::kErrorTextBytes>(text.data())};
}

}  // namespace slabd
