// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

#include "base/result.h"
#include "gateway/genicam/points.h"

using ArvBuffer = struct _ArvBuffer;

/// A frame that Aravis has received.
namespace slabd::gateway::genicam {

/// True if Aravis reports the frame as complete.
[[nodiscard]] bool is_complete(ArvBuffer* buffer);
/// The state that Aravis reports, in words.
[[nodiscard]] const char* state_words(ArvBuffer* buffer);

/// The bytes of the component in a frame that Aravis reports as complete. frame_incomplete: the frame is not what the
/// node map describes: `layout`, `payload_bytes` in all, and in a multi-part frame the part with `component_id`.
[[nodiscard]] Result<std::span<const std::byte>> component_of(ArvBuffer* buffer, const PointLayout& layout,
                                                              std::size_t payload_bytes, std::int64_t component_id);

}  // namespace slabd::gateway::genicam
