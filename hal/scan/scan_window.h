// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <string_view>

#include "base/base.h"

/// A scan file read once from front to back through one fixed window, so that every format is read in the same memory.
/// Nothing beyond the size the file had at opening is read, whatever its header claims. No heap; the object is
/// limits::kScanReadBytes large and lives on the stack of the one call that reads the file.
namespace slabd::hal {

/// A point, an element or a row longer than this is not a scanner's: room for 500 doubles beside x, y, z.
inline constexpr std::size_t kScanPointBytesMax = 4'096;
/// Counts beyond this are refused before anything is multiplied with them: 2^40 * kScanPointBytesMax fits 64 bits with
/// room for the sum of a file's elements.
inline constexpr std::uint64_t kScanCountMax = std::uint64_t{1} << 40U;

class ScanWindow {
 public:
  /// `name` is only used in error texts; both must outlive the window.
  ScanWindow(int fd, const char* name, std::uint64_t file_bytes) : ScanWindow(fd, name, file_bytes, 0) {}
  ScanWindow(const ScanWindow&) = delete;
  ScanWindow& operator=(const ScanWindow&) = delete;

  /// Another window on the same file, so many bytes behind what was consumed here; bytes <= left().
  [[nodiscard]] ScanWindow ahead(std::uint64_t bytes) const {
    return ScanWindow(fd_, name_, file_bytes_, offset_ + bytes);
  }

  [[nodiscard]] const char* name() const { return name_; }
  [[nodiscard]] std::uint64_t file_bytes() const { return file_bytes_; }
  /// Place of the next byte that was not consumed yet, and how many the file has from there.
  [[nodiscard]] std::uint64_t offset() const { return offset_; }
  [[nodiscard]] std::uint64_t left() const { return file_bytes_ - offset_; }

  /// Makes the next `bytes` (at most limits::kScanReadBytes) visible. False: the file ends before (`view` then holds
  /// all the rest), or it cannot be read (`broken`).
  [[nodiscard]] bool have(std::size_t bytes);
  [[nodiscard]] std::string_view view() const { return {&buffer_[begin_], end_ - begin_}; }
  /// Steps over visible bytes.
  void consume(std::size_t bytes);
  /// Steps over any number of bytes, visible or not; bytes <= left().
  void skip(std::uint64_t bytes);
  /// Copies the next bytes out; large pieces go straight into `to`. False: as for `have`.
  [[nodiscard]] bool read(void* to, std::size_t bytes);
  /// Copies bytes from any place of the file without consuming any; offset + bytes <= file_bytes(). False: as `have`.
  [[nodiscard]] bool look_at(std::uint64_t offset, void* to, std::size_t bytes);
  /// From here on the file ends at `file_bytes` (not before what was consumed): what is behind is not data.
  void end_at(std::uint64_t file_bytes);

  [[nodiscard]] bool broken() const { return broken_; }
  /// Why `have` or `read` said no: the file could not be read, or ended where more was needed.
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

// What a binary scan may have behind its data: nothing, one line end, or zeros. PCL's writer stretches a PCD file to
// its data and one memory page and fills only the beginning; some programs end every file with a line end. Anything
// else means that the header and the data do not belong together.

/// The largest memory page of a computer that runs a scanner program (64 kB on some ARM and POWER systems).
inline constexpr std::uint64_t kZeroTailBytesMax = 65'536;

/// True if the bytes from `data_end` to the end of the file are such a tail, or there are none.
[[nodiscard]] bool is_tail(ScanWindow& window, std::uint64_t data_end);

/// The data lie in [data_begin, data_end) of the file, which is not shorter. Success: from here on the window ends at
/// `data_end`. frame_incomplete: what is behind is no tail; the text names the number of bytes that are too many, and
/// binary data that were written in text mode if that is why.
[[nodiscard]] Status end_data_at(ScanWindow& window, std::uint64_t data_begin, std::uint64_t data_end);

}  // namespace slabd::hal
