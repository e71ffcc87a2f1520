// SPDX-License-Identifier: Apache-2.0
#include <cmath>

#include "hal/hal.h"
#include "tests/fuzz/fuzz.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace slabd;       // NOLINT(google-build-using-namespace)
  using namespace slabd::hal;  // NOLINT(google-build-using-namespace)
  PoseSample sample;
  PoseLinkCounters counters;
  const auto bytes = std::as_bytes(std::span(data, size));
  if (!decode_pose_datagram(bytes, "FLANGE_POSE", sample, counters)) {
    fuzz::must(counters.foreign + counters.malformed > 0, "what is refused is counted");
    return 0;
  }
  for (const double x : sample.T_base_flange.to_array()) fuzz::must(std::isfinite(x), "a pose is finite");
  const double norm = sample.T_base_flange.rotation.norm();
  fuzz::must(norm > 0.999 && norm < 1.001, "a pose's quaternion is one of unit length");
  return 0;
}
