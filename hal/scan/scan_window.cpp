// SPDX-License-Identifier: Apache-2.0
#include "hal/scan/scan_window.h"

#include <unistd.h>

#include <algorithm>
#include <array>
#include <cassert>
#include <cerrno>
#include <cstring>
#include <string_view>

#include "base/os.h"

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

namespace {

constexpr std::size_t kPieceBytes = 4'096;

/// Calls `use(piece)` for the bytes [begin, end) of the file until it returns false. Returns false if it did, or if the
/// file cannot be read.
template <typename Use>
bool for_each_piece(ScanWindow& window, std::uint64_t begin, std::uint64_t end, Use use) {
  std::array<char, kPieceBytes> piece;
  while (begin < end) {
    const std::size_t bytes = std::min<std::uint64_t>(piece.size(), end - begin);
    if (!window.look_at(begin, piece.data(), bytes) || !use(std::string_view(piece.data(), bytes))) return false;
    begin += bytes;
  }
  return true;
}

/// Detects that a C runtime in text mode wrote CR LF for LF: every LF has a CR before it, and there are as many as
/// surplus bytes.
bool is_written_in_text_mode(ScanWindow& window, std::uint64_t data_begin, std::uint64_t too_many) {
  std::uint64_t line_feeds = 0;
  char before = '\0';
  const bool all_behind_cr =
      for_each_piece(window, data_begin, window.file_bytes(), [&before, &line_feeds](std::string_view piece) {
        for (const char c : piece) {
          if (c == '\n' && before != '\r') return false;
          line_feeds += c == '\n' ? 1U : 0U;
          before = c;
        }
        return true;
      });
  return all_behind_cr && line_feeds == too_many;
}

}  // namespace

bool is_tail(ScanWindow& window, std::uint64_t data_end) {
  const std::uint64_t bytes = window.file_bytes() - data_end;
  if (bytes == 0) return true;
  if (bytes > kZeroTailBytesMax) return false;
  if (bytes <= 2) {
    std::array<char, 2> end{};
    if (!window.look_at(data_end, end.data(), bytes)) return false;
    const std::string_view text(end.data(), bytes);
    if (text == "\n" || text == "\r\n") return true;
  }
  return for_each_piece(window, data_end, window.file_bytes(),
                        [](std::string_view piece) { return piece.find_first_not_of('\0') == std::string_view::npos; });
}

Status end_data_at(ScanWindow& window, std::uint64_t data_begin, std::uint64_t data_end) {
  if (is_tail(window, data_end)) {
    window.end_at(data_end);
    return success();
  }
  if (window.broken()) return window.failure();
  const std::uint64_t too_many = window.file_bytes() - data_end;
  const bool text_mode = is_written_in_text_mode(window, data_begin, too_many);
  if (window.broken()) return window.failure();
  return error(Code::frame_incomplete, "%s: byte %llu: %llu %s too many behind the data that the header announces%s",
               window.name(), static_cast<unsigned long long>(data_end), static_cast<unsigned long long>(too_many),
               too_many == 1 ? "byte" : "bytes",
               text_mode ? " (every LF has a CR before it: binary data were written in text mode; the writing program "
                           "must open the file as binary)"
                         : "");
}

}  // namespace slabd::hal
