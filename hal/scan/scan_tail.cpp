// SPDX-License-Identifier: Apache-2.0
#include "hal/scan/scan_tail.h"

#include <algorithm>
#include <array>
#include <string_view>

namespace slabd::hal {
namespace {

constexpr std::size_t kPieceBytes = 4'096;

/// Calls `use(piece)` for the bytes [begin, end) of the file until it returns false. False: it did, or the file cannot
/// be read.
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

/// A C runtime in text mode writes CR LF where the program wrote LF: then no LF is without a CR before it, and there
/// are as many of them as there are bytes too many.
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
