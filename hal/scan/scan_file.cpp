// SPDX-License-Identifier: Apache-2.0
#include "hal/scan/scan_file.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <cerrno>

#include "base/os.h"
#include "hal/hal.h"
#include "hal/scan/packed.h"
#include "hal/scan/point_readers.h"
#include "hal/scan/scan_points.h"
#include "hal/scan/scan_window.h"
#include "hal/scan/text_lines.h"
#include "hal/system/crc32c.h"

// Problem: five million points, 60 MB, must become float32 mm in an existing buffer, and the file may be torn, wrong or
// hostile. Idea: the extension selects the reader; every reader gets the same window on a file of known size, and the
// same buffer. Invariants: no byte past the file's size at opening is read; a point is finite in all three coordinates
// or NaN in all three.
namespace slabd::hal {
namespace {

/// The file's size; -1 if it cannot be read.
off_t size_of(int fd) {
  struct stat status {};
  return fstat(fd, &status) == 0 ? status.st_size : -1;
}

Error unknown_format(const char* name, std::string_view extension) {
  return error(Code::frame_incomplete, "%s: format \"%.*s\" is not supported (%s)", name,
               static_cast<int>(std::min<std::size_t>(extension.size(), 32)),
               extension.data() == nullptr ? "" : extension.data(), kScanFormatsRead);
}

}  // namespace

Result<int> open_scan(int folder, const char* name, const char* shown) {
  // O_NONBLOCK: opening a pipe must not wait for a writer.
  Fd fd(openat(folder, name, O_RDONLY | O_NOFOLLOW | O_NONBLOCK | O_CLOEXEC));
  if (!fd.is_open()) {
    const char* why = errno == ELOOP ? "a link, links are not followed" : errno_text(errno);
    return error(Code::frame_incomplete, "%s: %s", shown, why);
  }
  struct stat status {};
  if (fstat(fd.get(), &status) != 0) return error(Code::frame_incomplete, "%s: %s", shown, errno_text(errno));
  if (!S_ISREG(status.st_mode)) return error(Code::frame_incomplete, "%s: not a regular file", shown);
  return fd.release();
}

namespace {

/// Detects UTF-16 by its byte-order mark, or by the zeros of its ASCII characters. No readable format begins like that.
bool is_utf16(std::string_view head) {
  if (head.starts_with("\xFF\xFE") || head.starts_with("\xFE\xFF")) return true;
  if (head.size() < 4) return false;
  const auto is_text = [](char c) { return (c >= ' ' && c <= '~') || c == '\t' || c == '\r' || c == '\n'; };
  const bool little = is_text(head[0]) && head[1] == '\0' && is_text(head[2]) && head[3] == '\0';
  const bool big = head[0] == '\0' && is_text(head[1]) && head[2] == '\0' && is_text(head[3]);
  return little || big;
}

template <typename Real>
Result<ScanShape> read_points_fd(int fd, const char* name, const ScanForm& form, std::span<Real> xyz, Team& team) {
  const std::string_view extension = extension_of(name);
  const std::optional<ScanFamily> family = scan_family(extension);
  if (!family) return unknown_format(name, extension);
  const off_t bytes = size_of(fd);
  if (bytes < 0) return error(Code::frame_incomplete, "%s: %s", name, errno_text(errno));
  if (bytes == 0) return error(Code::frame_incomplete, "%s: 0 bytes, the file is empty", name);
  ScanWindow window(fd, name, static_cast<std::uint64_t>(bytes));
  if (!window.have(4) && window.broken()) return window.failure();
  if (is_utf16(window.view().substr(0, 4)))
    return error(Code::frame_incomplete, "%s: UTF-16 text, two bytes for each character: save it as UTF-8 or ASCII",
                 name);
  switch (*family) {
    case ScanFamily::ply: return read_ply(window, form.unit, xyz, team);
    case ScanFamily::pcd: return read_pcd(window, form.unit, xyz, team);
    case ScanFamily::text: return read_text_points(window, form, xyz);
  }
  return unknown_format(name, extension);
}

/// By its content or by its name, so that damage at the start is reported as such.
bool is_archive(int fd, const char* path) {
  return is_packed(fd) || std::string_view(path).ends_with(kPackedExtension);
}

template <typename Real>
Result<ScanShape> read_points(const char* path, const ScanForm& form, std::span<Real> xyz, Team& team) {
  const Result<int> opened = open_scan(AT_FDCWD, path, path);
  if (!opened) return opened.error();
  const Fd fd(opened.value());
  if (!is_archive(fd.get(), path)) return read_points_fd(fd.get(), path, form, xyz, team);
  const Result<UnpackedScan> unpacked = unpack_into_memory(fd.get(), path, Proof::checksums);
  if (!unpacked) return unpacked.error();
  return read_points_fd(unpacked.value().fd.get(), unpacked.value().name.c_str(), form, xyz, team);
}

}  // namespace

Result<ScanShape> read_scan_fd(int fd, const char* name, const ScanForm& form, std::span<float> xyz, Team& team) {
  return read_points_fd(fd, name, form, xyz, team);
}

Result<ScanShape> read_scan(const char* path, const ScanForm& form, std::span<float> xyz, Team& team) {
  return read_points(path, form, xyz, team);
}

Result<ScanShape> read_scan(const char* path, const ScanForm& form, std::span<float> xyz) {
  Team alone(1);
  return read_points(path, form, xyz, alone);
}

Result<ScanShape> read_scan(const char* path, const ScanForm& form, std::span<double> xyz) {
  Team alone(1);
  return read_points(path, form, xyz, alone);
}

namespace {

/// Length that the header of a PLY or PCD file states.
StatedBytes stated_bytes(ScanWindow& window, ScanFamily family, LengthUnit unit) {
  return family == ScanFamily::ply ? bytes_stated_by_ply(window, unit) : bytes_stated_by_pcd(window, unit);
}

}  // namespace

bool is_complete_scan(int fd, const char* name, LengthUnit unit) {
  const std::optional<ScanFamily> family = scan_family(extension_of(name));
  const off_t bytes = size_of(fd);
  if (!family || *family == ScanFamily::text || bytes < 0) return false;
  ScanWindow window(fd, name, static_cast<std::uint64_t>(bytes));
  const std::uint64_t stated = stated_bytes(window, *family, unit).exact;
  return stated != 0 && stated <= window.file_bytes() && is_tail(window, stated);
}

std::uint64_t bytes_of_data(int fd, const char* name, LengthUnit unit) {
  const std::optional<ScanFamily> family = scan_family(extension_of(name));
  const off_t bytes = size_of(fd);
  if (bytes <= 0) return 0;
  const auto file_bytes = static_cast<std::uint64_t>(bytes);
  if (!family || *family == ScanFamily::text) return file_bytes;
  ScanWindow window(fd, name, file_bytes);
  const std::uint64_t stated = stated_bytes(window, *family, unit).exact;
  return stated == 0 ? file_bytes : std::min(stated, file_bytes);
}

bool lacks_bytes(int fd, const char* name, LengthUnit unit) {
  const std::optional<ScanFamily> family = scan_family(extension_of(name));
  const off_t bytes = size_of(fd);
  if (bytes == 0) return true;
  if (!family || *family == ScanFamily::text || bytes < 0) return false;
  ScanWindow window(fd, name, static_cast<std::uint64_t>(bytes));
  const StatedBytes stated = stated_bytes(window, *family, unit);
  return std::max(stated.least, stated.exact) > window.file_bytes();
}

// One table of the formats that can be written and one of the extensions that can be read.

namespace {

struct WrittenFormat {
  ScanFormat format;
  std::string_view name;
  std::string_view extension;
};
constexpr std::array<WrittenFormat, kScanFormats.size()> kWritten = {{
    {ScanFormat::ply, "ply", "ply"},
    {ScanFormat::ply_ascii, "ply-ascii", "ply"},
    {ScanFormat::ply_be, "ply-be", "ply"},
    {ScanFormat::pcd, "pcd", "pcd"},
    {ScanFormat::pcd_ascii, "pcd-ascii", "pcd"},
    {ScanFormat::pcd_compressed, "pcd-compressed", "pcd"},
    {ScanFormat::xyz, "xyz", "xyz"},
    {ScanFormat::csv, "csv", "csv"},
}};

struct ReadExtension {
  std::string_view extension;
  ScanFamily family;
};
constexpr std::array<ReadExtension, 6> kRead = {{{"ply", ScanFamily::ply},
                                                 {"pcd", ScanFamily::pcd},
                                                 {"xyz", ScanFamily::text},
                                                 {"asc", ScanFamily::text},
                                                 {"txt", ScanFamily::text},
                                                 {"csv", ScanFamily::text}}};

const WrittenFormat& row_of(ScanFormat format) {
  return kWritten[static_cast<std::size_t>(format)];
}

}  // namespace

std::string_view name(ScanFormat format) {
  return row_of(format).name;
}

std::string_view extension(ScanFormat format) {
  return row_of(format).extension;
}

std::optional<ScanFormat> scan_format_named(std::string_view wanted) {
  for (const WrittenFormat& row : kWritten)
    if (row.name == wanted) return row.format;
  return std::nullopt;
}

std::optional<ScanFormat> scan_format_of(std::string_view path) {
  const std::string_view file_extension = extension_of(path);
  const std::optional<ScanFamily> family = scan_family(file_extension);
  if (!family) return std::nullopt;
  if (*family == ScanFamily::ply) return ScanFormat::ply;
  if (*family == ScanFamily::pcd) return ScanFormat::pcd;
  return lower_case(file_extension).view() == "csv" ? ScanFormat::csv : ScanFormat::xyz;
}

std::string_view extension_of(std::string_view path) {
  const std::size_t slash = path.rfind('/');
  const std::string_view file = slash == std::string_view::npos ? path : path.substr(slash + 1);
  const std::size_t dot = file.rfind('.');
  return dot == std::string_view::npos ? std::string_view{} : file.substr(dot + 1);
}

std::optional<ScanFamily> scan_family(std::string_view file_extension) {
  const FixedString<16> lower = lower_case(file_extension);
  for (const ReadExtension& row : kRead)
    if (lower == row.extension) return row.family;
  return std::nullopt;
}

// Problem: the checksum of the points must not delay the measurement, which starts when they arrive and changes them in
// the buffer. Idea: read them a second time from the spool file, with the same reader and in pieces, while other
// threads measure.

namespace {

/// 24 kB: remains in the cache between the reader and the checksum.
constexpr std::size_t kPiecePoints = 2'048;

Result<PointRun> find_records(ScanWindow& window, const char* path, LengthUnit unit) {
  const std::optional<ScanFamily> family = scan_family(extension_of(path));
  if (family == ScanFamily::ply) return find_ply_records(window, unit);
  if (family == ScanFamily::pcd) return find_pcd_records(window, unit);
  return not_in_records(path);
}

}  // namespace

std::uint32_t points_crc32c(std::span<const float> xyz, std::uint32_t before) {
  // The bits of a NaN are kept or replaced depending on its neighbours (hal/scan/scan_points.h).
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
  if (!is_archive(fd.get(), path)) return read_scan_checksum_fd(fd.get(), path, unit);
  const Result<UnpackedScan> unpacked = unpack_into_memory(fd.get(), path, Proof::checksums);
  if (!unpacked) return unpacked.error();
  return read_scan_checksum_fd(unpacked.value().fd.get(), unpacked.value().name.c_str(), unit);
}

Result<ScanChecksum> read_scan_checksum_fd(int fd, const char* name, LengthUnit unit) {
  const off_t bytes = size_of(fd);
  if (bytes < 0) return error(Code::frame_incomplete, "%s: %s", name, errno_text(errno));
  ScanWindow window(fd, name, static_cast<std::uint64_t>(bytes));
  const Result<PointRun> run = find_records(window, name, unit);
  if (!run) return run.error();

  ScanChecksum sum;
  sum.shape = run.value().shape;
  Settled settled;
  Team alone(1);
  // One number beyond a cache line: complete lines would be written past the caches, which is useful for a scan only.
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
