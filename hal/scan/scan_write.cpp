// SPDX-License-Identifier: Apache-2.0
#include <fcntl.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cerrno>
#include <charconv>
#include <cstring>
#include <string>
#include <vector>

#include "base/os.h"
#include "hal/hal.h"
#include "hal/scan/lzf.h"

// Writes scans, for the emulated line and for tests: each format as its usual programs write it. After an error the
// file is removed, because a partial scan is worse than none.
namespace slabd::hal {
namespace {

/// A new file that is removed unless `close` reports that all of it was written.
class OutFile {
 public:
  explicit OutFile(const char* path)
      : path_(path), fd_(open(path, O_WRONLY | O_CREAT | O_TRUNC | O_NOFOLLOW | O_CLOEXEC, 0644)) {
    opened_ = fd_.is_open();
    error_number_ = opened_ ? 0 : errno;
  }

  void write(const void* from, std::size_t bytes) {
    if (error_number_ == 0 && !write_all(fd_.get(), from, bytes)) error_number_ = errno;
  }
  void write(std::string_view text) { write(text.data(), text.size()); }

  [[nodiscard]] Status close() {
    if (error_number_ == 0 && ::close(fd_.release()) != 0) error_number_ = errno;
    if (error_number_ == 0) return success();
    if (opened_) unlink(path_);
    const bool full = error_number_ == ENOSPC || error_number_ == EDQUOT;
    return error(full ? Code::store_full : Code::internal, "%s: %s", path_, errno_text(error_number_));
  }

 private:
  const char* path_;
  Fd fd_;
  bool opened_ = false;
  int error_number_ = 0;
};

struct Shape {
  std::size_t points = 0;
  std::size_t width = 0;
  std::size_t height = 0;
  WrittenBy by;
};

Result<Shape> shape_of(const char* path, std::span<const float> xyz, std::size_t width, std::size_t height,
                       WrittenBy by) {
  const std::size_t points = xyz.size() / 3;
  if (xyz.size() % 3 != 0) return error(Code::config, "%s: %zu floats are not whole points", path, xyz.size());
  if ((width != 0 || height != 0) && width * height != points)
    return error(Code::config, "%s: width %zu height %zu is not the point count %zu", path, width, height, points);
  return Shape{points, width, height, by};
}

/// Text of the comment in an emulated scan (hal/scan/text_lines.h reads it); empty for others.
FixedString<64> emulated_comment(const Shape& shape) {
  FixedString<64> text;
  if (shape.by.emulator) text.printf("emulated by slabctl simulate");
  if (shape.by.emulator && shape.by.block > 0) {
    FixedString<16> block;
    block.printf(", block %d", shape.by.block);
    text.append(block.view());
  }
  return text;
}

/// Comment with the scanner's temperature after `mark`, with its line end; empty if it is not known.
FixedString<64> temperature_line(const char* mark, const Shape& shape) {
  FixedString<64> line;
  if (has_value(shape.by.scanner_temperature_c))
    line.printf("%s scanner_temperature_c %.2f\n", mark, shape.by.scanner_temperature_c);
  return line;
}

FixedString<384> ply_header(const char* encoding, const Shape& shape) {
  FixedString<384> header;
  FixedString<96> organised;
  if (shape.width != 0) organised.printf("comment organized width %zu height %zu\n", shape.width, shape.height);
  FixedString<80> emulated;
  if (shape.by.emulator) emulated.printf("comment %s\n", emulated_comment(shape).c_str());
  header.printf(
      "ply\nformat %s 1.0\n%s%s%selement vertex %zu\nproperty float x\nproperty float y\nproperty float "
      "z\nend_header\n",
      encoding, organised.c_str(), emulated.c_str(), temperature_line("comment", shape).c_str(), shape.points);
  return header;
}

FixedString<384> pcd_header(const char* data, const Shape& shape) {
  FixedString<384> header;
  FixedString<80> emulated;
  if (shape.by.emulator) emulated.printf("# %s\n", emulated_comment(shape).c_str());
  header.printf(
      "# .PCD v0.7 - Point Cloud Data file format\n%s%sVERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\n"
      "WIDTH %zu\nHEIGHT %zu\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS %zu\nDATA %s\n",
      emulated.c_str(), temperature_line("#", shape).c_str(), shape.width != 0 ? shape.width : shape.points,
      shape.width != 0 ? shape.height : std::size_t{1}, shape.points, data);
  return header;
}

/// Lines of three numbers, each with the fewest digits that restore the same float.
void write_lines(OutFile& file, std::span<const float> xyz, char separator) {
  constexpr std::size_t kLineMax = 3 * 18;
  std::vector<char> buffer(limits::kScanReadBytes);
  std::size_t used = 0;
  for (std::size_t i = 0; i < xyz.size(); i += 3) {
    if (buffer.size() - used < kLineMax) {
      file.write(buffer.data(), used);
      used = 0;
    }
    for (std::size_t axis = 0; axis < 3; ++axis) {
      char* const begin = buffer.data() + used;
      char* end = std::to_chars(begin, begin + kLineMax / 3 - 1, xyz[i + axis]).ptr;
      *end++ = axis == 2 ? '\n' : separator;
      used += static_cast<std::size_t>(end - begin);
    }
  }
  file.write(buffer.data(), used);
}

void write_big_endian(OutFile& file, std::span<const float> xyz) {
  std::vector<std::uint32_t> piece;
  constexpr std::size_t kPieceFloats = limits::kScanReadBytes / sizeof(float);
  for (std::size_t begin = 0; begin < xyz.size(); begin += kPieceFloats) {
    piece.clear();
    for (const float v : xyz.subspan(begin, std::min(kPieceFloats, xyz.size() - begin)))
      piece.push_back(__builtin_bswap32(std::bit_cast<std::uint32_t>(v)));
    file.write(piece.data(), piece.size() * sizeof(std::uint32_t));
  }
}

/// All x, then all y, then all z, compressed, after both lengths.
void write_compressed(OutFile& file, std::span<const float> xyz) {
  std::vector<float> planes;
  planes.reserve(xyz.size());
  for (std::size_t axis = 0; axis < 3; ++axis)
    for (std::size_t i = axis; i < xyz.size(); i += 3) planes.push_back(xyz[i]);
  std::string bytes(planes.size() * sizeof(float), '\0');
  std::memcpy(bytes.data(), planes.data(), bytes.size());
  const std::string compressed = lzf_compress(bytes);
  const std::array<std::uint32_t, 2> lengths = {static_cast<std::uint32_t>(compressed.size()),
                                                static_cast<std::uint32_t>(bytes.size())};
  file.write(lengths.data(), sizeof lengths);
  file.write(compressed);
}

}  // namespace

Status write_ply(const char* path, std::span<const float> xyz, std::size_t width, std::size_t height, WrittenBy by) {
  const Result<Shape> shape = shape_of(path, xyz, width, height, by);
  if (!shape) return shape.error();
  OutFile file(path);
  file.write(ply_header("binary_little_endian", shape.value()).view());
  file.write(xyz.data(), xyz.size_bytes());
  return file.close();
}

Status write_scan(const char* path, ScanFormat format, std::span<const float> xyz, std::size_t width,
                  std::size_t height, WrittenBy by) {
  if (format == ScanFormat::ply) return write_ply(path, xyz, width, height, by);
  const Result<Shape> checked = shape_of(path, xyz, width, height, by);
  if (!checked) return checked.error();
  const Shape& shape = checked.value();
  // Its lengths have 32 bits; LZF makes at most 33 bytes of 32.
  if (format == ScanFormat::pcd_compressed && xyz.size_bytes() > UINT32_MAX / 33 * 32)
    return error(Code::config, "%s: %zu points are too many for compressed PCD", path, shape.points);
  OutFile file(path);
  switch (format) {
    case ScanFormat::ply: break;
    case ScanFormat::ply_ascii:
      file.write(ply_header("ascii", shape).view());
      write_lines(file, xyz, ' ');
      break;
    case ScanFormat::ply_be:
      file.write(ply_header("binary_big_endian", shape).view());
      write_big_endian(file, xyz);
      break;
    case ScanFormat::pcd:
      file.write(pcd_header("binary", shape).view());
      file.write(xyz.data(), xyz.size_bytes());
      break;
    case ScanFormat::pcd_ascii:
      file.write(pcd_header("ascii", shape).view());
      write_lines(file, xyz, ' ');
      break;
    case ScanFormat::pcd_compressed:
      file.write(pcd_header("binary_compressed", shape).view());
      write_compressed(file, xyz);
      break;
    case ScanFormat::xyz: write_lines(file, xyz, ' '); break;
    case ScanFormat::csv:
      file.write("x,y,z\n");
      write_lines(file, xyz, ',');
      break;
  }
  // Written at the end, because many readers of tables take the first line as names, whatever it begins with.
  if (format == ScanFormat::xyz || format == ScanFormat::csv) {
    if (by.emulator) {
      file.write("# ");
      file.write(emulated_comment(shape).view());
      file.write("\n");
    }
    file.write(temperature_line("#", shape).view());
  }
  return file.close();
}

}  // namespace slabd::hal
