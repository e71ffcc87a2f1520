// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <string_view>

#include "base/base.h"
#include "base/os.h"
#include "hal/hal.h"

/// Packed scans (.slabz): a scan file without loss in about half its size or less, see docs/ARCHIVE.md for the format.
/// The original file comes back byte for byte. All functions use the heap, 20 MB at most, whatever the file.
namespace slabd::hal {

/// Added to the whole name of the original: 03-1.ply.slabz.
inline constexpr std::string_view kPackedExtension = ".slabz";
/// Largest file that is packed or unpacked: six million points as text of 350 characters each. It limits the memory
/// that a hostile archive can take when it is read as a scan.
inline constexpr std::uint64_t kPackedFileBytesMax = std::uint64_t{1} << 31U;

struct PackedScan {
  std::string name;                ///< of the original file, without its folder
  std::uint64_t bytes = 0;         ///< of the original
  std::uint64_t packed_bytes = 0;  ///< of the archive
  std::string sha256;              ///< of the original, hex
  bool is_predicted = false;       ///< false: the file has no points that slabd can predict
};

/// Receives the next bytes; an error ends the work.
using ByteSink = std::function<Status(std::span<const std::byte>)>;

/// Packs the scan file at `path`: passes the archive to `sink`, front to back. Any file is packed; binary PLY and PCD
/// with float32 coordinates, little-endian, are packed well. frame_incomplete: the file cannot be read. config: it is
/// too large, is packed already, or has a name that cannot be stored.
[[nodiscard]] Result<PackedScan> pack_scan(const char* path, const ByteSink& sink);

/// Passes the original of an archive to `sink`, and checks everything: structure, checksums, size, SHA-256.
/// frame_incomplete: the text names the file, the first byte of the damaged part, and the reason. The sink may have
/// received a part by then.
[[nodiscard]] Result<PackedScan> unpack_scan(const char* path, const ByteSink& sink);

enum class Proof : std::uint8_t {
  checksums,  ///< CRC-32C of each block, packed and restored
  sha256,     ///< also SHA-256 of the restored file; takes as long as unpacking
};
/// The same for an open file; `name` appears in the error texts.
[[nodiscard]] Result<PackedScan> unpack_scan_fd(int fd, const char* name, Proof proof, const ByteSink& sink);

/// Reads name, sizes and SHA-256 from both ends of an archive. frame_incomplete: an end is damaged or missing. The data
/// in between are not checked.
[[nodiscard]] Result<PackedScan> packed_scan_at(const char* path);

struct CheckedScan {
  PackedScan packed;
  std::optional<std::uint32_t> points_crc32c;  ///< as read_scan_checksum(); nullopt if the points are not records
};
/// Checks an archive as unpack_scan(), and computes the checksum of its points.
[[nodiscard]] Result<CheckedScan> check_packed_scan(const char* path, LengthUnit unit);

/// True if the open file begins as an archive.
[[nodiscard]] bool is_packed(int fd);

struct UnpackedScan {
  Fd fd;             ///< the original, a file in memory
  std::string name;  ///< for error texts, ends with the original's name
  PackedScan packed;
};
/// Unpacks an archive into a file in memory.
[[nodiscard]] Result<UnpackedScan> unpack_into_memory(int fd, const char* name, Proof proof);

}  // namespace slabd::hal
