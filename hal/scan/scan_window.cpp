// SPDX-License-Identifier: Apache-2.0
#include "hal/scan/scan_window.h"

#include <unistd.h>

#include <algorithm>
#include <cassert>
#include <cerrno>
#include <cstring>

#include "hal/system/os.h"

// Invariants: buffer_[begin_, end_) are the file's bytes from offset_ on; offset_ + (end_ - begin_) <= file_bytes_.
namespace slabd::hal {

bool ScanWindow::pull(char* to, std::size_t bytes, std::uint64_t offset) {
  while (bytes > 0) {
    const ssize_t n = pread(fd_, to, bytes, static_cast<off_t>(offset));
    if (n < 0 && errno == EINTR) continue;
    if (n <= 0) {
      broken_ = true;
      error_number_ = n == 0 ? 0 : errno;
      return false;
    }
    to += n;
    offset += static_cast<std::uint64_t>(n);
    bytes -= static_cast<std::size_t>(n);
  }
  return true;
}

bool ScanWindow::have(std::size_t bytes) {
  assert(bytes <= buffer_.size());
  const std::size_t visible = end_ - begin_;
  if (visible >= bytes) return true;
  if (broken_) return false;
  std::memmove(buffer_.data(), &buffer_[begin_], visible);
  begin_ = 0;
  end_ = visible;
  const std::size_t more = std::min<std::uint64_t>(buffer_.size() - visible, left() - visible);
  if (!pull(&buffer_[visible], more, offset_ + visible)) return false;
  end_ += more;
  return end_ >= bytes;
}

void ScanWindow::consume(std::size_t bytes) {
  assert(bytes <= end_ - begin_);
  begin_ += bytes;
  offset_ += bytes;
}

void ScanWindow::skip(std::uint64_t bytes) {
  assert(bytes <= left());
  const std::size_t visible = std::min<std::uint64_t>(bytes, end_ - begin_);
  consume(visible);
  offset_ += bytes - visible;
}

bool ScanWindow::read(void* to, std::size_t bytes) {
  auto* out = static_cast<char*>(to);
  const std::size_t visible = std::min(bytes, end_ - begin_);
  std::memcpy(out, &buffer_[begin_], visible);
  consume(visible);
  const std::size_t rest = bytes - visible;
  if (rest == 0) return true;
  if (rest >= buffer_.size() / 2) {
    if (rest > left() || broken_ || !pull(out + visible, rest, offset_)) return false;
    offset_ += rest;
    return true;
  }
  if (!have(rest)) return false;
  std::memcpy(out + visible, &buffer_[begin_], rest);
  consume(rest);
  return true;
}

bool ScanWindow::look_at(std::uint64_t offset, void* to, std::size_t bytes) {
  assert(offset <= file_bytes_ && bytes <= file_bytes_ - offset);
  return !broken_ && pull(static_cast<char*>(to), bytes, offset);
}

void ScanWindow::end_at(std::uint64_t file_bytes) {
  assert(file_bytes >= offset_ && file_bytes <= file_bytes_);
  file_bytes_ = file_bytes;
  end_ = begin_ + std::min<std::uint64_t>(end_ - begin_, left());
}

Error ScanWindow::failure() const {
  const auto at = static_cast<unsigned long long>(offset_);
  if (!broken_) return error(Code::frame_incomplete, "%s: byte %llu: the file ends within its data", name_, at);
  return error(Code::frame_incomplete, "%s: byte %llu: %s", name_, at,
               error_number_ == 0 ? "the file became shorter while it was read" : errno_text(error_number_));
}

}  // namespace slabd::hal
