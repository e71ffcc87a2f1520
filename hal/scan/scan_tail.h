// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>

#include "hal/scan/scan_window.h"

/// What a binary scan may have behind its data: nothing, one line end, or zeros. PCL's writer stretches a PCD file to
/// its data and one memory page and fills only the beginning; some programs end every file with a line end. Anything
/// else means that the header and the data do not belong together.
namespace slabd::hal {

/// The largest memory page of a computer that runs a scanner program (64 kB on some ARM and POWER systems).
inline constexpr std::uint64_t kZeroTailBytesMax = 65'536;

/// True if the bytes from `data_end` to the end of the file are such a tail, or there are none.
[[nodiscard]] bool is_tail(ScanWindow& window, std::uint64_t data_end);

/// The data lie in [data_begin, data_end) of the file, which is not shorter. Success: from here on the window ends at
/// `data_end`. frame_incomplete: what is behind is no tail; the text names the number of bytes that are too many, and
/// binary data that were written in text mode if that is why.
[[nodiscard]] Status end_data_at(ScanWindow& window, std::uint64_t data_begin, std::uint64_t data_end);

}  // namespace slabd::hal
