// SPDX-License-Identifier: Apache-2.0
#include "hal/gauge/gauge_datagram.h"

#include <algorithm>
#include <charconv>
#include <cmath>

namespace slabd::hal {
namespace {

constexpr std::string_view kBlanks = " \t";
constexpr double kNumberMost = 1e9;  ///< in um, 1 km

std::string_view next_word(std::string_view& line) {
  line.remove_prefix(std::min(line.find_first_not_of(kBlanks), line.size()));
  const std::string_view word = line.substr(0, line.find_first_of(kBlanks));
  line.remove_prefix(word.size());
  return word;
}

template <typename Number>
bool parse(std::string_view word, Number& out) {
  const auto [end, fault] = std::from_chars(word.data(), word.data() + word.size(), out);
  return !word.empty() && fault == std::errc() && end == word.data() + word.size();
}

}  // namespace

std::string_view next_line(std::string_view& text) {
  const std::size_t end = std::min(text.find('\n'), text.size());
  std::string_view line = text.substr(0, end);
  text.remove_prefix(std::min(end + 1, text.size()));
  if (line.ends_with('\r')) line.remove_suffix(1);
  return line;
}

std::optional<GaugeLine> parse_gauge_line(std::string_view line) {
  GaugeLine gauge;
  gauge.name = next_word(line);
  const bool good = !gauge.name.empty() && parse(next_word(line), gauge.number) && parse(next_word(line), gauge.seq) &&
                    parse(next_word(line), gauge.slab_no) && gauge.seq != 0 && next_word(line).empty() &&
                    !(std::abs(gauge.number) > kNumberMost);
  return good ? std::optional(gauge) : std::nullopt;
}

}  // namespace slabd::hal
