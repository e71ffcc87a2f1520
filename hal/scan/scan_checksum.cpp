// SPDX-License-Identifier: Apache-2.0
//
// Problem: a checksum of the points must not cost the measuring time, which begins as soon as they are there and
// changes them where they lie. Idea: they are read a second time, from the file as it lies in the spool, by what read
// them the first time and a piece at a time, while others measure.
#include <fcntl.h>
#include <sys/stat.h>

#include <algorithm>
#include <array>
#include <cerrno>

#include "hal/hal.h"
#include "hal/scan/declared_unit.h"
#include "hal/scan/pcd_points.h"
#include "hal/scan/ply_points.h"
#include "hal/scan/scan_file.h"
#include "hal/scan/scan_window.h"
#include "hal/scan/settle_points.h"
#include "hal/system/crc32c.h"
#include "hal/system/os.h"

namespace slabd::hal {
namespace {

/// 24 kB: stays in the cache between the reader and the checksum.
constexpr std::size_t kPiecePoints = 2'048;

Result<PointRun> find_records(ScanWindow& window, const char* path, LengthUnit unit) {
  const std::optional<ScanFamily> family = scan_family(extension_of(path));
  if (family == ScanFamily::ply) return find_ply_records(window, unit);
  if (family == ScanFamily::pcd) return find_pcd_records(window, unit);
  return not_in_records(path);
}

}  // namespace

std::uint32_t points_crc32c(std::span<const float> xyz, std::uint32_t before) {
  // A NaN keeps the bits it had in the file, or loses them, by what stands beside it (hal/scan/settle_points.h).
  std::array<float, 3 * kPiecePoints> alike;
  while (!xyz.empty()) {
    const std::size_t count = std::min(xyz.size(), alike.size());
    copy_with_one_nan(xyz.data(), count, alike.data());
    before = crc32c(std::as_bytes(std::span(alike).first(count)), before);
    xyz = xyz.subspan(count);
  }
  return before;
}

Result<ScanChecksum> read_scan_checksum(const char* path, LengthUnit unit) {
  const Result<int> opened = open_scan(AT_FDCWD, path, path);
  if (!opened) return opened.error();
  const Fd fd(opened.value());
  struct stat file {};
  if (fstat(fd.get(), &file) != 0) return error(Code::frame_incomplete, "%s: %s", path, errno_text(errno));
  ScanWindow window(fd.get(), path, static_cast<std::uint64_t>(file.st_size));
  const Result<PointRun> run = find_records(window, path, unit);
  if (!run) return run.error();

  ScanChecksum sum;
  sum.shape = run.value().shape;
  Settled settled;
  Team alone(1);
  // One number beyond a cache line: whole lines would be written past the caches, which is right for a scan only.
  alignas(64) std::array<float, 1 + 3 * kPiecePoints> piece;
  for (std::size_t left = sum.shape.points; left > 0;) {
    const std::size_t points = std::min(left, kPiecePoints);
    const std::span<float> xyz = std::span(piece).subspan(1, 3 * points);
    if (!read_point_records(window, run.value().record, mm_per(unit), xyz, settled, alone)) return window.failure();
    sum.crc32c = points_crc32c(xyz, sum.crc32c);
    left -= points;
  }
  sum.shape.finite = settled.finite;
  sum.shape.zeros = settled.zeros;
  return sum;
}

}  // namespace slabd::hal
