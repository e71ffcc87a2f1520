// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <optional>
#include <span>
#include <string_view>

#include "base/base.h"
#include "base/team.h"
#include "hal/hal.h"

/// Reading a scan from a descriptor that is already open, for the drop directory, which must decode, sync and move
/// the very same file; and what a scan file's name says.
namespace slabd::hal {

/// As `read_scan`; `name` (with its extension) is only used to choose the format and in error texts. `fd` stays open.
[[nodiscard]] Result<ScanShape> read_scan_fd(int fd, const char* name, const ScanForm& form, std::span<float> xyz,
                                             Team& team);

/// Opens the regular file `name` below the folder `folder` (AT_FDCWD: `name` is a path) for reading, without following
/// a link. frame_incomplete: it is none; the text shows it as `shown`. The caller owns the descriptor.
[[nodiscard]] Result<int> open_scan(int folder, const char* name, const char* shown);

/// Whether the file accounts for itself: a binary header and as many bytes as it says, behind them at most a tail
/// (hal/scan/scan_window.h). Text, and lists whose length only their content tells, never do: of those nobody can say
/// that the last line was the last. Reads the header, no more. No heap; 256 kB of stack.
[[nodiscard]] bool is_complete_scan(int fd, const char* name, LengthUnit unit);

/// Whether more must come, whoever wrote it: 0 bytes, or fewer than its own header says. Reads the header, no more. No
/// heap; 256 kB of stack.
[[nodiscard]] bool lacks_bytes(int fd, const char* name, LengthUnit unit);

/// Header and data of a binary file as it tells their length, at most the file's; the file's length if it does not
/// tell. Zeros behind are no parts that were not written. No heap; 256 kB of stack.
[[nodiscard]] std::uint64_t bytes_of_data(int fd, const char* name, LengthUnit unit);

/// What reads it.
enum class ScanFamily : std::uint8_t { ply, pcd, text };
inline constexpr const char* kScanFormatsRead = "supported: .ply, .pcd, .xyz, .asc, .txt, .csv";
/// Of an extension without its dot, in any case; none for what slabd does not read.
[[nodiscard]] std::optional<ScanFamily> scan_family(std::string_view extension);

/// What stands behind the last dot of a path's last part; empty without one.
[[nodiscard]] std::string_view extension_of(std::string_view path);

}  // namespace slabd::hal
