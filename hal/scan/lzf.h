// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <string>
#include <string_view>

#include "hal/scan/scan_window.h"

/// LZF (Marc Lehmann's LibLZF), the compression of PCD's binary_compressed.
///
/// A control byte c < 32 is followed by c + 1 literal bytes. Otherwise it copies (c >> 5) + 2 bytes from a distance of
/// (c & 31) * 256 + d + 1 bytes back, where d is the last byte of the item. If c >> 5 == 7, the byte in between is
/// added to the length. The distance is at most 8 kB, so a stream of any size is decoded through a window of that size.
/// LibLZF itself needs both sides in memory at once.
namespace slabd::hal {

class LzfReader {
 public:
  /// Decodes `in` from its position to the end of the file. `decoded_bytes`: the decoded size that the file states.
  LzfReader(ScanWindow& in, std::uint64_t decoded_bytes) : in_(in), left_(decoded_bytes) {}
  LzfReader(const LzfReader&) = delete;
  LzfReader& operator=(const LzfReader&) = delete;

  /// Reads the next decoded bytes, exactly `bytes` of them.
  [[nodiscard]] Status read(void* to, std::size_t bytes);
  [[nodiscard]] Status skip(std::uint64_t bytes);
  /// frame_incomplete unless the stream and the decoded bytes end together.
  [[nodiscard]] Status finish();

 private:
  [[nodiscard]] Status decode_some();
  [[nodiscard]] Error refuse(const char* why) const;

  static constexpr std::size_t kReach = 8'192;   ///< furthest distance: 13 bits, plus one
  static constexpr std::size_t kItemMax = 264;   ///< longest copy: 7 + 255 + 2
  static constexpr std::size_t kPiece = 32'768;  ///< decoded at a time; fits the first-level cache with the reach
  ScanWindow& in_;
  std::uint64_t left_;     ///< stated bytes that are not decoded yet
  std::size_t begin_ = 0;  ///< start of the decoded bytes that were not handed out
  std::size_t end_ = 0;    ///< end of the decoded bytes
  std::array<char, kReach + kPiece + kItemMax> decoded_;
};

/// `bytes` as one LZF stream (for the writer of compressed PCD; the heap is used).
[[nodiscard]] std::string lzf_compress(std::string_view bytes);

}  // namespace slabd::hal
