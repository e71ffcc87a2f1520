// SPDX-License-Identifier: Apache-2.0
#include "hal/scan/point_readers.h"

#include <algorithm>
#include <atomic>
#include <bit>
#include <concepts>
#include <cstring>

#include "hal/scan/scan_points.h"

// Idea: read the file in pieces that are still in the cache when their numbers are converted and checked. So every byte
// of the file and of the scan passes the memory once. Two threads take the pieces in turn, each through its own window.
// So the file is still read from front to back, which is fastest on a disk or a share.
namespace slabd::hal {
namespace {

static_assert(std::endian::native == std::endian::little, "the direct way takes the file's bytes as floats");

/// Size of a group on the direct path; only the last piece is not a multiple of it.
constexpr std::size_t kGroupPoints = 16;
/// The converting path reads a piece three times, once for each axis, so it should fit the first-level cache.
constexpr std::size_t kRecordPieceBytes = 16'384;

/// True for records of three floats x, y, z in mm in native byte order, read as floats.
template <typename Real>
bool is_direct(const PointRecord& record, double mm_per_unit) {
  return std::same_as<Real, float> && mm_per_unit == 1.0 && !record.big_endian && record.bytes == 3 * sizeof(float) &&
         record.offset == std::array<std::size_t, 3>{0, 4, 8} && record.is_double == std::array<bool, 3>{};
}

template <typename Stored, bool kBigEndian>
Stored load(const char* from) {
  using Bits = std::conditional_t<sizeof(Stored) == 8, std::uint64_t, std::uint32_t>;
  Bits bits = 0;
  std::memcpy(&bits, from, sizeof bits);
  if constexpr (kBigEndian && sizeof(Stored) == 8) bits = __builtin_bswap64(bits);
  if constexpr (kBigEndian && sizeof(Stored) == 4) bits = __builtin_bswap32(bits);
  return std::bit_cast<Stored>(bits);
}

/// Converts the numbers of one axis of all points.
template <typename Stored, bool kBigEndian, typename Real>
void convert_axis(const char* from, std::size_t record_bytes, std::size_t points, double mm_per_unit, Real* to) {
  for (std::size_t i = 0; i < points; ++i, from += record_bytes, to += 3)
    *to = coordinate_mm<Real>(static_cast<double>(load<Stored, kBigEndian>(from)), mm_per_unit);
}

template <typename Real>
void convert(const char* from, const PointRecord& record, std::size_t points, double mm_per_unit, Real* to) {
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const auto axis_converter =
        record.is_double[axis]
            ? (record.big_endian ? convert_axis<double, true, Real> : convert_axis<double, false, Real>)
            : (record.big_endian ? convert_axis<float, true, Real> : convert_axis<float, false, Real>);
    axis_converter(from + record.offset[axis], record.bytes, points, mm_per_unit, to + axis);
  }
}

/// Reads record by record from the window's position.
template <typename Real>
bool read_in_turn(ScanWindow& window, const PointRecord& record, double mm_per_unit, std::span<Real> xyz,
                  Settled& settled) {
  const bool direct = is_direct<Real>(record, mm_per_unit);
  const std::size_t piece_max = direct ? limits::kScanReadBytes / record.bytes / kGroupPoints * kGroupPoints
                                       : std::max<std::size_t>(1, kRecordPieceBytes / record.bytes);
  for (std::size_t left = xyz.size() / 3; left > 0;) {
    const std::size_t points = std::min(left, piece_max);
    if (!window.have(points * record.bytes)) return false;
    Real* const to = &xyz[xyz.size() - 3 * left];
    if constexpr (std::same_as<Real, float>) {
      if (direct) settled += move_and_settle_points(window.view().data(), points, to);
    }
    if (!direct) {
      convert(window.view().data(), record, points, mm_per_unit, to);
      settled += settle_points(to, points);
    }
    window.consume(points * record.bytes);
    left -= points;
  }
  return true;
}

/// False also if one piece could not be read; `settled` is unchanged then.
template <typename Real>
bool read_in_pieces(const ScanWindow& window, const PointRecord& record, double mm_per_unit, std::span<Real> xyz,
                    Settled& settled, Team& team) {
  const std::size_t floats_of_piece = 3 * (limits::kScanReadBytes / record.bytes / kGroupPoints * kGroupPoints);
  const std::size_t pieces = (xyz.size() + floats_of_piece - 1) / floats_of_piece;
  std::atomic<std::size_t> finite = 0, zeros = 0;
  std::atomic<bool> failed = false;
  team.run(pieces, [&](std::size_t piece) {
    if (failed.load(std::memory_order_relaxed)) return;
    const std::size_t at = piece * floats_of_piece;
    ScanWindow own = window.ahead(at / 3 * record.bytes);
    Settled found;
    if (!read_in_turn(own, record, mm_per_unit, xyz.subspan(at, std::min(floats_of_piece, xyz.size() - at)), found))
      failed.store(true, std::memory_order_relaxed);
    finite.fetch_add(found.finite, std::memory_order_relaxed);
    zeros.fetch_add(found.zeros, std::memory_order_relaxed);
  });
  if (failed) return false;
  settled += Settled{finite, zeros};
  return true;
}

}  // namespace

Error not_in_records(const char* name) {
  return error(Code::frame_incomplete, "%s: its points are not records of one length", name);
}

template <typename Real>
bool read_point_records(ScanWindow& window, const PointRecord& record, double mm_per_unit, std::span<Real> xyz,
                        Settled& settled, Team& team) {
  const std::uint64_t bytes = xyz.size() / 3 * std::uint64_t{record.bytes};
  if (team.threads() == 2 && bytes <= window.left() &&
      read_in_pieces(window, record, mm_per_unit, xyz, settled, team)) {
    window.skip(bytes);
    return true;
  }
  // A read error occurs again here and is reported as with one thread.
  return read_in_turn(window, record, mm_per_unit, xyz, settled);
}

template bool read_point_records(ScanWindow&, const PointRecord&, double, std::span<float>, Settled&, Team&);
template bool read_point_records(ScanWindow&, const PointRecord&, double, std::span<double>, Settled&, Team&);

}  // namespace slabd::hal
