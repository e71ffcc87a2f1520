// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <optional>
#include <span>
#include <string_view>

#include "base/base.h"
#include "base/team.h"
#include "hal/hal.h"

/// Reads a scan from an open descriptor, for the drop directory, which must decode, sync and move the same file. Also
/// evaluates a scan file's name.
namespace slabd::hal {

/// As `read_scan`; `name` (with its extension) only selects the format and appears in error texts. `fd` stays open.
[[nodiscard]] Result<ScanShape> read_scan_fd(int fd, const char* name, const ScanForm& form, std::span<float> xyz,
                                             Team& team);

/// As `read_scan_checksum`; `name` as above. `fd` stays open.
[[nodiscard]] Result<ScanChecksum> read_scan_checksum_fd(int fd, const char* name, LengthUnit unit);

/// Opens the regular file `name` below the folder `folder` (AT_FDCWD: `name` is a path) for reading, without following
/// a link. frame_incomplete if it is not one; the text shows it as `shown`. The caller owns the descriptor.
[[nodiscard]] Result<int> open_scan(int folder, const char* name, const char* shown);

/// True if the file proves that it is complete: a binary header, the number of bytes it states, and at most a tail
/// (hal/scan/scan_window.h). False for text, and for lists whose length only their content determines, because their
/// last line may be missing. Reads only header and tail. No heap; 256 kB of stack.
[[nodiscard]] bool is_complete_scan(int fd, const char* name, LengthUnit unit);

/// True if the file is incomplete: 0 bytes, or fewer than its own header states. Reads only the header. No heap; 256 kB
/// of stack.
[[nodiscard]] bool lacks_bytes(int fd, const char* name, LengthUnit unit);

/// Length of header and data of a binary file as its header states it, at most the file's length. The file's length if
/// it is not stated. Zeros after the data are not unwritten parts. No heap; 256 kB of stack.
[[nodiscard]] std::uint64_t bytes_of_data(int fd, const char* name, LengthUnit unit);

/// The reader of a file.
enum class ScanFamily : std::uint8_t { ply, pcd, text };
inline constexpr const char* kScanFormatsRead = "supported: .ply, .pcd, .xyz, .asc, .txt, .csv";
/// Family of an extension without its dot, in upper or lower case; nullopt if slabd does not read it.
[[nodiscard]] std::optional<ScanFamily> scan_family(std::string_view extension);

/// Text after the last dot of a path's last part; empty if there is none.
[[nodiscard]] std::string_view extension_of(std::string_view path);

}  // namespace slabd::hal
