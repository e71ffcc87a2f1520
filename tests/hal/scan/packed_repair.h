// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <cstring>
#include <span>
#include <string>

#include "hal/system/crc32c.h"

/// Gives a damaged archive (hal/scan/packed.cpp) correct checksums, as an attacker would, so that the checks behind
/// them are reached.
namespace slabd::hal::test {

inline std::uint32_t number_at(const std::string& bytes, std::size_t at, std::size_t size) {
  std::uint32_t number = 0;
  std::memcpy(&number, &bytes[at], size);
  return number;
}

inline void put_at(std::string& bytes, std::size_t at, std::uint32_t number) {
  std::memcpy(&bytes[at], &number, sizeof number);
}

inline std::uint32_t crc_of(const std::string& bytes, std::size_t at, std::size_t size, std::uint32_t before) {
  return crc32c(std::as_bytes(std::span(bytes).subspan(at, size)), before);
}

/// Size of the head of the file, with the name; of the head of a block, and its part before the checksum.
inline std::size_t packed_head_bytes(const std::string& archive) {
  return 32 + number_at(archive, 14, 2);
}
inline constexpr std::size_t kBlockHead = 20;
inline constexpr std::size_t kBlockFields = 16;

inline std::string with_checksums(std::string archive) {
  if (archive.size() < 32 || archive.size() < packed_head_bytes(archive)) return archive;
  std::size_t at = packed_head_bytes(archive);
  put_at(archive, 28, 0);
  std::uint32_t crc = crc_of(archive, 0, at, 0);
  put_at(archive, 28, crc);
  while (archive.size() - at >= kBlockHead) {
    const std::size_t packed = number_at(archive, at + 8, 4);
    if (packed > archive.size() - at - kBlockHead) break;
    crc = crc_of(archive, at, kBlockFields, crc);
    crc = crc_of(archive, at + kBlockHead, packed, crc);
    put_at(archive, at + kBlockFields, crc);
    at += kBlockHead + packed;
  }
  return archive;
}

}  // namespace slabd::hal::test
