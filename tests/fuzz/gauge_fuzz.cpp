// SPDX-License-Identifier: Apache-2.0
#include "hal/gauge/gauge_datagram.h"
#include "tests/fuzz/fuzz.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace slabd;       // NOLINT(google-build-using-namespace)
  using namespace slabd::hal;  // NOLINT(google-build-using-namespace)
  std::string_view text(reinterpret_cast<const char*>(data), size);
  while (!text.empty()) {
    const std::size_t left = text.size();
    const std::string_view line = next_line(text);
    fuzz::must(text.size() < left, "every line takes a part of the text");
    fuzz::must(line.find('\n') == std::string_view::npos, "a line has no end in it");
    const auto gauge = parse_gauge_line(line);
    if (gauge) fuzz::must(gauge->seq != 0 && !gauge->name.empty(), "a value has a name and a sequence number");
  }
  return 0;
}
