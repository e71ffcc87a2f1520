// SPDX-License-Identifier: Apache-2.0
#include "hal/scan_file.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cerrno>
#include <cmath>
#include <cstring>
#include <limits>

#include "hal/os.h"
#include "hal/ply_header.h"

// Problem: five million points, 60 MB, must become float32 mm in a buffer that exists already, and the file may be
// torn, lying or hostile. Idea: check every length against the file's size first; then either read straight into the
// buffer (float32 x y z of our byte order and nothing else) or decode piece by piece. Invariants: nothing is read
// past the file's size at opening; a point is finite in all three coordinates or NaN in all three.
namespace slabd::hal {
namespace {

static_assert(std::endian::native == std::endian::little, "the direct read takes the file's bytes as floats");

double mm_per(LengthUnit unit) {
  switch (unit) {
    case LengthUnit::mm: return 1.0;
    case LengthUnit::m: return kMmPerM;
    case LengthUnit::um: return 0.001;
  }
  return 1.0;
}

/// Reads exactly `bytes` at `offset`. False at the end of the file (errno 0) or on an error (errno set).
bool read_at(int fd, void* to, std::size_t bytes, std::uint64_t offset) {
  auto* out = static_cast<char*>(to);
  while (bytes > 0) {
    const ssize_t n = pread(fd, out, bytes, static_cast<off_t>(offset));
    if (n < 0 && errno == EINTR) continue;
    if (n <= 0) {
      if (n == 0) errno = 0;
      return false;
    }
    out += n;
    offset += static_cast<std::uint64_t>(n);
    bytes -= static_cast<std::size_t>(n);
  }
  return true;
}

Error read_error(const char* name, std::uint64_t offset) {
  return error(Code::frame_incomplete, "%s: byte %llu: %s", name, static_cast<unsigned long long>(offset),
               errno == 0 ? "the file ended while it was read" : errno_text(errno));
}

/// Converts one point to mm in place; a point with anything not finite becomes all NaN. Returns 1 when finite.
std::size_t finish_point(float* p, float scale) {
  for (int k = 0; k < 3; ++k) p[k] *= scale;
  // inf - inf and NaN - NaN are NaN, finite - finite is 0: one test for three coordinates.
  const float zero = (p[0] - p[0]) + (p[1] - p[1]) + (p[2] - p[2]);
  if (zero == 0.0F) return 1;
  for (int k = 0; k < 3; ++k) p[k] = std::numeric_limits<float>::quiet_NaN();
  return 0;
}

/// float32 x y z of our byte order and nothing else: the file's bytes are the buffer's bytes.
Result<std::size_t> read_direct(int fd, const char* name, const PlyLayout& layout, float scale, std::span<float> xyz) {
  constexpr std::size_t kPointBytes = 3 * sizeof(float);
  constexpr std::size_t kPiecePoints = limits::kScanReadBytes / kPointBytes;
  std::size_t finite = 0;
  for (std::size_t begin = 0; begin < layout.vertices; begin += kPiecePoints) {
    const std::size_t end = std::min<std::size_t>(begin + kPiecePoints, layout.vertices);
    const std::uint64_t offset = layout.vertex_offset + begin * kPointBytes;
    if (!read_at(fd, &xyz[3 * begin], (end - begin) * kPointBytes, offset)) return read_error(name, offset);
    for (std::size_t i = begin; i < end; ++i) finite += finish_point(&xyz[3 * i], scale);
  }
  return finite;
}

/// One coordinate as mm. Doubles are converted before they are rounded to float.
float coordinate_mm(const char* vertex, PlyLayout::Coordinate at, bool big_endian, double scale) {
  if (at.is_double) {
    std::uint64_t bits = 0;
    std::memcpy(&bits, vertex + at.offset, sizeof bits);
    if (big_endian) bits = __builtin_bswap64(bits);
    return static_cast<float>(std::bit_cast<double>(bits) * scale);
  }
  std::uint32_t bits = 0;
  std::memcpy(&bits, vertex + at.offset, sizeof bits);
  if (big_endian) bits = __builtin_bswap32(bits);
  return std::bit_cast<float>(bits) * static_cast<float>(scale);
}

Result<std::size_t> read_pieces(int fd, const char* name, const PlyLayout& layout, double scale, std::span<float> xyz) {
  std::array<char, limits::kScanReadBytes> piece;  // on the stack: reading scans must not touch the heap
  const std::size_t piece_points = piece.size() / layout.stride;
  std::size_t finite = 0;
  for (std::size_t begin = 0; begin < layout.vertices; begin += piece_points) {
    const std::size_t end = std::min<std::size_t>(begin + piece_points, layout.vertices);
    const std::uint64_t offset = layout.vertex_offset + begin * layout.stride;
    if (!read_at(fd, piece.data(), (end - begin) * layout.stride, offset)) return read_error(name, offset);
    const char* vertex = piece.data();
    for (std::size_t i = begin; i < end; ++i, vertex += layout.stride) {
      float* p = &xyz[3 * i];
      for (std::size_t k = 0; k < 3; ++k) p[k] = coordinate_mm(vertex, layout.xyz[k], layout.big_endian, scale);
      finite += finish_point(p, 1.0F);
    }
  }
  return finite;
}

bool is_direct(const PlyLayout& layout) {
  const auto& c = layout.xyz;
  return !layout.big_endian && layout.stride == 3 * sizeof(float) && !c[0].is_double && !c[1].is_double &&
         !c[2].is_double && c[0].offset == 0 && c[1].offset == 4 && c[2].offset == 8;
}

Status check_size(const char* name, const PlyLayout& layout, std::uint64_t file_bytes) {
  const bool too_short = file_bytes < layout.bytes_min;
  const bool too_long = layout.bytes_exact && file_bytes > layout.bytes_min;
  if (!too_short && !too_long) return success();
  return error(Code::frame_incomplete, "%s: byte %llu: the file ends here, its header asks for %s%llu bytes", name,
               static_cast<unsigned long long>(file_bytes), layout.bytes_exact ? "" : "at least ",
               static_cast<unsigned long long>(layout.bytes_min));
}

Result<PlyLayout> read_header(int fd, const char* name, std::uint64_t file_bytes) {
  std::array<char, limits::kScanHeaderBytesMax> head;
  const std::size_t bytes = std::min<std::size_t>(head.size(), file_bytes);
  if (!read_at(fd, head.data(), bytes, 0)) return read_error(name, 0);
  Result<PlyLayout> layout = parse_ply_header({head.data(), bytes}, name);
  if (!layout) return layout;
  if (Status status = check_size(name, layout.value(), file_bytes); !status) return status.error();
  return layout;
}

std::string_view extension(const char* name) {
  const std::string_view whole(name);
  const std::size_t slash = whole.rfind('/');
  const std::string_view file = slash == std::string_view::npos ? whole : whole.substr(slash + 1);
  const std::size_t dot = file.rfind('.');
  return dot == std::string_view::npos ? std::string_view{} : file.substr(dot + 1);
}

bool is_ply(std::string_view ext) {
  return ext.size() == 3 && (ext[0] | 0x20) == 'p' && (ext[1] | 0x20) == 'l' && (ext[2] | 0x20) == 'y';
}

bool write_all(int fd, const void* from, std::size_t bytes) {
  const auto* in = static_cast<const char*>(from);
  while (bytes > 0) {
    const ssize_t n = write(fd, in, bytes);
    if (n < 0 && errno == EINTR) continue;
    if (n < 0) return false;
    in += n;
    bytes -= static_cast<std::size_t>(n);
  }
  return true;
}

}  // namespace

Result<int> open_scan(int folder, const char* name, const char* shown) {
  // O_NONBLOCK: opening a pipe that someone left there must not wait for a writer.
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

Result<ScanShape> read_scan_fd(int fd, const char* name, LengthUnit unit, std::span<float> xyz) {
  if (const std::string_view ext = extension(name); !is_ply(ext))
    return error(Code::frame_incomplete, "%s: format \"%.*s\" is not supported (supported: binary PLY, .ply)", name,
                 static_cast<int>(std::min<std::size_t>(ext.size(), 32)), ext.data() == nullptr ? "" : ext.data());
  struct stat status {};
  if (fstat(fd, &status) != 0) return error(Code::frame_incomplete, "%s: %s", name, errno_text(errno));
  const auto file_bytes = static_cast<std::uint64_t>(status.st_size);
  const Result<PlyLayout> header = read_header(fd, name, file_bytes);
  if (!header) return header.error();
  const PlyLayout& layout = header.value();
  if (layout.vertices > xyz.size() / 3)
    return error(Code::frame_incomplete, "%s: %llu points, allowed are at most %zu", name,
                 static_cast<unsigned long long>(layout.vertices), xyz.size() / 3);

  const double scale = mm_per(unit);
  const Result<std::size_t> finite = is_direct(layout) ? read_direct(fd, name, layout, static_cast<float>(scale), xyz)
                                                       : read_pieces(fd, name, layout, scale, xyz);
  if (!finite) return finite.error();
  return ScanShape{layout.vertices, finite.value(), layout.width, layout.height};
}

Result<ScanShape> read_scan(const char* path, LengthUnit unit, std::span<float> xyz) {
  const Result<int> opened = open_scan(AT_FDCWD, path, path);
  if (!opened) return opened.error();
  const Fd fd(opened.value());
  return read_scan_fd(fd.get(), path, unit, xyz);
}

Status write_ply(const char* path, std::span<const float> xyz, std::size_t width, std::size_t height) {
  const std::size_t points = xyz.size() / 3;
  if (xyz.size() % 3 != 0) return error(Code::config, "%s: %zu floats are not whole points", path, xyz.size());
  if ((width != 0 || height != 0) && width * height != points)
    return error(Code::config, "%s: width %zu height %zu is not the point count %zu", path, width, height, points);

  FixedString<256> header("ply\nformat binary_little_endian 1.0\n");
  FixedString<96> part;
  if (width != 0) {
    part.printf("comment organized width %zu height %zu\n", width, height);
    header.append(part.view());
  }
  part.printf("element vertex %zu\n", points);
  header.append(part.view());
  header.append("property float x\nproperty float y\nproperty float z\nend_header\n");

  Fd fd(open(path, O_WRONLY | O_CREAT | O_TRUNC | O_NOFOLLOW | O_CLOEXEC, 0644));
  const bool opened = fd.is_open();
  if (opened && write_all(fd.get(), header.c_str(), header.size()) &&
      write_all(fd.get(), xyz.data(), xyz.size_bytes()) && close(fd.release()) == 0)
    return success();
  const int why = errno;
  if (opened) unlink(path);  // half a scan is worse than none
  return error(why == ENOSPC || why == EDQUOT ? Code::store_full : Code::internal, "%s: %s", path, errno_text(why));
}

}  // namespace slabd::hal
