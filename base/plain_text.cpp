// SPDX-License-Identifier: Apache-2.0
#include "base/plain_text.h"

#include <array>
#include <cstdio>

namespace slabd {
namespace {

/// True if the first character of `text` must be replaced.
bool replaces(std::string_view text, const CodePoint& point, Lines lines) {
  if (!point.is_utf8) return true;
  if (!is_control(point.value)) return false;
  if (lines == Lines::replaced) return true;
  return point.value != '\n' && point.value != '\t' && point.value != 0xFEFF && !text.starts_with("\r\n");
}

std::string number_of(const CodePoint& point) {
  if (point.value == '\n') return "\\n";
  if (point.value == '\t') return "\\t";
  if (point.value == '\r') return "\\r";
  std::array<char, 16> text{};
  const bool one_byte = point.value < 0x100;
  std::snprintf(text.data(), text.size(),
                one_byte                 ? "\\x%02x"
                : point.value < 0x1'0000 ? "\\u%04x"
                                         : "\\U%08x",
                static_cast<unsigned>(point.value));
  return text.data();
}

}  // namespace

std::string plain(std::string_view text, Lines lines) {
  std::string out;
  out.reserve(text.size());
  while (!text.empty()) {
    const CodePoint point = code_point_at(text);
    if (replaces(text, point, lines))
      out += number_of(point);
    else
      out += text.substr(0, point.bytes);
    text.remove_prefix(point.bytes);
  }
  return out;
}

bool is_plain(std::string_view text, Lines lines) {
  while (!text.empty()) {
    const CodePoint point = code_point_at(text);
    if (replaces(text, point, lines)) return false;
    text.remove_prefix(point.bytes);
  }
  return true;
}

}  // namespace slabd
