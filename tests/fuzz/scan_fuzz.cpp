// SPDX-License-Identifier: Apache-2.0
//
// Input: a scan file; SCAN_NAME is its file name. One program each for PLY, PCD and text tables.
#include <sys/mman.h>
#include <unistd.h>

#include <cmath>
#include <vector>

#include "hal/scan/scan_file.h"
#include "tests/fuzz/fuzz.h"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  using namespace slabd;       // NOLINT(google-build-using-namespace)
  using namespace slabd::hal;  // NOLINT(google-build-using-namespace)
  static const int fd = memfd_create("scan", MFD_CLOEXEC);
  static std::vector<float> xyz(3 * 20'000);
  static Team readers(2);
  fuzz::must(ftruncate(fd, 0) == 0 && pwrite(fd, data, size, 0) == static_cast<ssize_t>(size), "a file in memory");
  const Result<ScanShape> shape = read_scan_fd(fd, SCAN_NAME, LengthUnit::mm, xyz, readers);
  const bool complete = is_complete_scan(fd, SCAN_NAME, LengthUnit::mm);
  if (!shape) {
    fuzz::must(!shape.error().text.empty(), "an error says why");
    return 0;
  }
  const ScanShape& s = shape.value();
  fuzz::must(s.points > 0 && s.points <= xyz.size() / 3, "the points fit");
  fuzz::must(s.finite <= s.points, "finite ones are points");
  fuzz::must(s.width * s.height == 0 || s.width * s.height == s.points, "an organised scan has all its points");
  std::size_t finite = 0;
  for (std::size_t i = 0; i < s.points; ++i) {
    const bool x = std::isfinite(xyz[3 * i]);
    const bool all = x && std::isfinite(xyz[3 * i + 1]) && std::isfinite(xyz[3 * i + 2]);
    const bool none = std::isnan(xyz[3 * i]) && std::isnan(xyz[3 * i + 1]) && std::isnan(xyz[3 * i + 2]);
    fuzz::must(all || none, "a point is there or missing, nothing between");
    finite += all ? 1U : 0U;
  }
  fuzz::must(finite == s.finite, "finite points are counted right");
  static_cast<void>(complete);
  return 0;
}
