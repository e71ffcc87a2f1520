// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <string_view>

#include "base/base.h"

/// Reads a scan file once from front to back through one fixed window, so that every format needs the same memory.
/// Never reads beyond the size that the file had at opening, whatever its header states. No heap; the object has
/// limits::kScanReadBytes and is on the stack of the one call that reads the file.
namespace slabd::hal {

/// Largest size of a point, an element or a row: enough for 500 doubles in addition to x, y, z.
inline constexpr std::size_t kScanPointBytesMax = 4'096;
/// Larger counts are rejected before any multiplication: 2^40 * kScanPointBytesMax fits 64 bits, with room for the sum
/// of a file's elements.
inline constexpr std::uint64_t kScanCountMax = std::uint64_t{1} << 40U;

class ScanWindow {
 public:
  /// `name` is only used in error texts; both must outlive the window.
  ScanWindow(int fd, const char* name, std::uint64_t file_bytes) : ScanWindow(fd, name, file_bytes, 0) {}
  ScanWindow(const ScanWindow&) = delete;
  ScanWindow& operator=(const ScanWindow&) = delete;

  /// Another window on the same file, `bytes` after this position; bytes <= left().
  [[nodiscard]] ScanWindow ahead(std::uint64_t bytes) const {
    return ScanWindow(fd_, name_, file_bytes_, offset_ + bytes);
  }

  [[nodiscard]] const char* name() const { return name_; }
  [[nodiscard]] std::uint64_t file_bytes() const { return file_bytes_; }
  /// Offset of the next byte that is not consumed, and the number of bytes from there to the end.
  [[nodiscard]] std::uint64_t offset() const { return offset_; }
  [[nodiscard]] std::uint64_t left() const { return file_bytes_ - offset_; }

  /// Makes the next `bytes` (at most limits::kScanReadBytes) visible. False if the file ends before (`view` then holds
  /// the rest), or cannot be read (`broken`).
  [[nodiscard]] bool have(std::size_t bytes);
  [[nodiscard]] std::string_view view() const { return {&buffer_[begin_], end_ - begin_}; }
  /// Skips visible bytes.
  void consume(std::size_t bytes);
  /// Skips any number of bytes, visible or not; bytes <= left().
  void skip(std::uint64_t bytes);
  /// Copies the next bytes out; large pieces are read directly into `to`. False: as for `have`.
  [[nodiscard]] bool read(void* to, std::size_t bytes);
  /// Copies bytes from any offset without consuming any; offset + bytes <= file_bytes(). False: as `have`.
  [[nodiscard]] bool look_at(std::uint64_t offset, void* to, std::size_t bytes);
  /// Sets the end of the file to `file_bytes` (not before the consumed bytes); later bytes are not data.
  void end_at(std::uint64_t file_bytes);

  [[nodiscard]] bool broken() const { return broken_; }
  /// Reason why `have` or `read` failed: the file could not be read, or ended too early.
  [[nodiscard]] Error failure() const;

 private:
  ScanWindow(int fd, const char* name, std::uint64_t file_bytes, std::uint64_t offset)
      : fd_(fd), name_(name), file_bytes_(file_bytes), offset_(offset) {}
  [[nodiscard]] bool pull(char* to, std::size_t bytes, std::uint64_t offset);

  int fd_;
  const char* name_;
  std::uint64_t file_bytes_;
  std::uint64_t offset_;  ///< of buffer_[begin_] in the file
  std::size_t begin_ = 0;
  std::size_t end_ = 0;
  bool broken_ = false;
  int error_number_ = 0;                             ///< 0 = the file became shorter while it was read
  std::array<char, limits::kScanReadBytes> buffer_;  // not initialised: 256 kB that are read before they are used
};

// A binary scan may have after its data: nothing, one line end, or zeros. PCL's writer allocates a PCD file of its data
// and one memory page and fills only the beginning. Some programs end every file with a line end. With anything else
// the header and the data do not match.

/// The largest memory page of a computer that may run a scanner program (64 kB on some ARM and POWER systems).
inline constexpr std::uint64_t kZeroTailBytesMax = 65'536;

/// True if the bytes from `data_end` to the end of the file are such a tail, or if there are none.
[[nodiscard]] bool is_tail(ScanWindow& window, std::uint64_t data_end);

/// The data are in [data_begin, data_end) of the file, which is not shorter. Success: the window now ends at
/// `data_end`. frame_incomplete: the bytes after it are not such a tail; the text contains the number of surplus bytes.
/// It also reports binary data written in text mode.
[[nodiscard]] Status end_data_at(ScanWindow& window, std::uint64_t data_begin, std::uint64_t data_end);

}  // namespace slabd::hal
