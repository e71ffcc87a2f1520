// SPDX-License-Identifier: Apache-2.0
#include "hal/scan/lzf.h"

#include <algorithm>
#include <cstring>
#include <vector>

// Invariants of the reader: decoded_[0, end_) are the last decoded bytes, at least kReach of them once that many are
// decoded. Every item is copied only after its bytes, its distance and its length were checked.
namespace slabd::hal {

Error LzfReader::refuse(const char* why) const {
  return error(Code::frame_incomplete, "%s: byte %llu: compressed data %s", in_.name(),
               static_cast<unsigned long long>(in_.offset()), why);
}

Status LzfReader::decode_some() {
  const std::size_t kept = std::min(end_, kReach);
  std::memmove(decoded_.data(), &decoded_[end_ - kept], kept);
  begin_ = end_ = kept;
  constexpr std::size_t kItemBytesMax = 1 + 32;
  while (end_ < kReach + kPiece) {
    static_cast<void>(in_.have(kItemBytesMax));  // an item at the very end may be shorter
    if (in_.broken()) return in_.failure();
    const std::string_view item = in_.view();
    if (item.empty()) return success();
    const auto byte = [&](std::size_t i) { return std::size_t{static_cast<unsigned char>(item[i])}; };
    const std::size_t control = byte(0);
    if (control < 32) {
      const std::size_t length = control + 1;
      if (item.size() < 1 + length) return refuse("end within an item");
      if (length > left_) return refuse("decode to more bytes than the file declares");
      std::memcpy(&decoded_[end_], &item[1], length);
      in_.consume(1 + length);
      end_ += length;
      left_ -= length;
      continue;
    }
    const bool is_long = control >> 5U == 7;
    const std::size_t item_bytes = is_long ? 3 : 2;
    if (item.size() < item_bytes) return refuse("end within an item");
    const std::size_t length = (control >> 5U) + (is_long ? byte(1) : 0) + 2;
    const std::size_t distance = (control & 31U) * 256 + byte(item_bytes - 1) + 1;
    if (distance > end_) return refuse("refer to bytes before their beginning");
    if (length > left_) return refuse("decode to more bytes than the file declares");
    // Byte by byte, because the copy may overlap itself; runs are encoded that way.
    for (std::size_t i = 0; i < length; ++i, ++end_) decoded_[end_] = decoded_[end_ - distance];
    in_.consume(item_bytes);
    left_ -= length;
  }
  return success();
}

Status LzfReader::read(void* to, std::size_t bytes) {
  auto* out = static_cast<char*>(to);
  while (bytes > 0) {
    if (begin_ == end_) {
      if (Status status = decode_some(); !status) return status;
      if (begin_ == end_) return refuse("decode to fewer bytes than the file declares");
    }
    const std::size_t part = std::min(bytes, end_ - begin_);
    std::memcpy(out, &decoded_[begin_], part);
    begin_ += part;
    out += part;
    bytes -= part;
  }
  return success();
}

Status LzfReader::skip(std::uint64_t bytes) {
  while (bytes > 0) {
    if (begin_ == end_) {
      if (Status status = decode_some(); !status) return status;
      if (begin_ == end_) return refuse("decode to fewer bytes than the file declares");
    }
    const std::size_t part = std::min<std::uint64_t>(bytes, end_ - begin_);
    begin_ += part;
    bytes -= part;
  }
  return success();
}

Status LzfReader::finish() {
  while (begin_ != end_ || in_.left() > 0) {
    if (begin_ != end_) return refuse("decode to more bytes than the points need");
    if (Status status = decode_some(); !status) return status;
  }
  return left_ == 0 ? success() : refuse("decode to fewer bytes than the file declares");
}

// Greedy: tries only the last position of every hash of three bytes.
std::string lzf_compress(std::string_view bytes) {
  constexpr std::size_t kReach = 8'192;
  constexpr std::size_t kCopyMax = 264;
  constexpr std::size_t kLiteralsMax = 32;
  constexpr std::size_t kNowhere = ~std::size_t{0};
  std::vector<std::size_t> last(1U << 14U, kNowhere);
  std::string out;
  out.reserve(bytes.size() + bytes.size() / kLiteralsMax + 1);
  const auto at = [&](std::size_t i) { return std::uint32_t{static_cast<unsigned char>(bytes[i])}; };
  const auto put = [&](std::size_t value) { out.push_back(static_cast<char>(value)); };
  const auto put_literals = [&](std::size_t begin, std::size_t end) {
    while (begin < end) {
      const std::size_t count = std::min(kLiteralsMax, end - begin);
      put(count - 1);
      out.append(bytes.substr(begin, count));
      begin += count;
    }
  };
  std::size_t literals = 0;  // start of the bytes not written yet
  std::size_t i = 0;
  while (i + 2 < bytes.size()) {
    const std::uint32_t three = at(i) << 16U | at(i + 1) << 8U | at(i + 2);
    std::size_t& candidate = last[(three * 2'654'435'761U) >> 18U];  // Knuth's multiplicative hash
    const std::size_t from = std::exchange(candidate, i);
    if (from == kNowhere || i - from > kReach || bytes.substr(from, 3) != bytes.substr(i, 3)) {
      ++i;
      continue;
    }
    const std::size_t length_max = std::min(kCopyMax, bytes.size() - i);
    std::size_t length = 3;
    while (length < length_max && bytes[from + length] == bytes[i + length]) ++length;
    put_literals(literals, i);
    const std::size_t distance = i - from - 1;
    const std::size_t code = length - 2;
    put(std::min<std::size_t>(code, 7) << 5U | distance >> 8U);
    if (code >= 7) put(code - 7);
    put(distance & 255U);
    i += length;
    literals = i;
  }
  put_literals(literals, bytes.size());
  return out;
}

}  // namespace slabd::hal
