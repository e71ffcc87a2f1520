// SPDX-License-Identifier: Apache-2.0
#include "gateway/genicam/frame.h"

#include <arv.h>

#include <cstring>
#include <optional>
#include <string>

namespace slabd::gateway::genicam {
namespace {

/// Largest parts of a multi-part frame (SFNC names nine components).
constexpr unsigned kPartsMax = 16;

/// Bytes of the first part of a frame with chunks: GigE Vision 2.0, 25.1: [data][id, 4][size, 4] from the end on, the
/// image being the first one. frame_incomplete if the chain does not meet the frame's begin.
Result<std::size_t> first_chunk_bytes(std::span<const std::byte> frame) {
  constexpr std::size_t kTagBytes = 8;
  std::size_t end = frame.size();
  for (;;) {
    if (end < kTagBytes)
      return error(Code::frame_incomplete, "chunk data: a tag of %zu bytes is missing at byte %zu", kTagBytes, end);
    std::array<std::uint8_t, 4> big{};
    std::memcpy(big.data(), &frame[end - 4], big.size());
    const std::size_t bytes =
        (std::size_t{big[0]} << 24U) | (std::size_t{big[1]} << 16U) | (std::size_t{big[2]} << 8U) | std::size_t{big[3]};
    if (bytes > end - kTagBytes)
      return error(Code::frame_incomplete, "chunk data: the chunk before byte %zu declares %zu bytes, left are %zu",
                   end, bytes, end - kTagBytes);
    end -= kTagBytes + bytes;
    if (end == 0) return bytes;
  }
}

}  // namespace

bool is_complete(ArvBuffer* buffer) {
  return arv_buffer_get_status(buffer) == ARV_BUFFER_STATUS_SUCCESS;
}

const char* state_words(ArvBuffer* buffer) {
  switch (arv_buffer_get_status(buffer)) {
    case ARV_BUFFER_STATUS_SUCCESS: return "complete";
    case ARV_BUFFER_STATUS_CLEARED: return "its payload type is none of image, chunk data and multi-part";
    case ARV_BUFFER_STATUS_TIMEOUT: return "packets are missing after the last one arrived";
    case ARV_BUFFER_STATUS_MISSING_PACKETS: return "packets are missing, and the camera cannot send them again";
    case ARV_BUFFER_STATUS_WRONG_PACKET_ID: return "a packet has a number outside the frame";
    case ARV_BUFFER_STATUS_SIZE_MISMATCH: return "the frame is larger than the feature PayloadSize";
    case ARV_BUFFER_STATUS_FILLING: return "the frame is still being received";
    case ARV_BUFFER_STATUS_ABORTED: return "the frame was aborted";
    case ARV_BUFFER_STATUS_UNKNOWN: break;
  }
  return "unknown status";
}

Result<std::span<const std::byte>> component_of(ArvBuffer* buffer, const PointLayout& layout, std::size_t payload_bytes,
                                                std::int64_t component_id) {
  std::size_t received = 0;
  const auto* data = static_cast<const std::byte*>(arv_buffer_get_data(buffer, &received));
  const std::span<const std::byte> frame(data, received);
  const ArvBufferPayloadType type = arv_buffer_get_payload_type(buffer);
  const bool chunks = arv_buffer_has_chunks(buffer) != FALSE;
  const unsigned parts = arv_buffer_get_n_parts(buffer);
  const auto has_geometry = [&](unsigned part) -> Status {
    const Result<PointFormat> format = point_format_of(arv_buffer_get_part_pixel_format(buffer, part));
    if (!format) return error(Code::frame_incomplete, "%s", format.error().text.c_str());
    gint x_padding = 0;
    gint y_padding = 0;
    arv_buffer_get_part_padding(buffer, part, &x_padding, &y_padding);
    const auto width = static_cast<std::uint32_t>(arv_buffer_get_part_width(buffer, part));
    const auto height = static_cast<std::uint32_t>(arv_buffer_get_part_height(buffer, part));
    if (format.value() != layout.format || width != layout.width || height != layout.height || x_padding != 0 ||
        y_padding != 0)
      return error(Code::frame_incomplete,
                   "the frame has %u x %u points of %s with padding %d and %d, the node map has %u x %u of %s; allowed "
                   "padding is 0",
                   width, height, info(format.value()).name, x_padding, y_padding, layout.width, layout.height,
                   info(layout.format).name);
    return success();
  };
  if (type == ARV_BUFFER_PAYLOAD_TYPE_MULTIPART) {
    if (chunks)
      return error(Code::frame_incomplete,
                   "a multi-part frame with chunk data; allowed is feature ChunkModeActive = false with multi-part");
    if (parts == 0 || parts > kPartsMax)
      return error(Code::frame_incomplete, "the frame has %u parts, allowed are 1 to %u", parts, kPartsMax);
    std::size_t sum = 0;
    std::optional<unsigned> found;
    std::string ids;
    for (unsigned i = 0; i < parts; ++i) {
      std::size_t bytes = 0;
      static_cast<void>(arv_buffer_get_part_data(buffer, i, &bytes));
      if (bytes > received - sum)
        return error(Code::frame_incomplete, "the parts have more bytes than the %zu that arrived", received);
      sum += bytes;
      const unsigned id = arv_buffer_get_part_component_id(buffer, i);
      ids += (ids.empty() ? "" : ", ") + std::to_string(id);
      if (id != component_id) continue;
      if (found) return error(Code::frame_incomplete, "the frame has component %u twice", id);
      found = i;
    }
    if (sum != received) return error(Code::frame_incomplete, "%zu bytes arrived, the parts have %zu", received, sum);
    if (!found)
      return error(Code::frame_incomplete, "the frame has components %s, needed is %lld (ComponentIDValue)",
                   ids.c_str(), static_cast<long long>(component_id));
    if (Status status = has_geometry(*found); !status) return status.error();
    std::size_t bytes = 0;
    const auto* part = static_cast<const std::byte*>(arv_buffer_get_part_data(buffer, *found, &bytes));
    if (bytes != layout.bytes())
      return error(Code::frame_incomplete, "the component has %zu bytes, needed are %zu", bytes, layout.bytes());
    return std::span<const std::byte>(part, bytes);
  }
  if (type != ARV_BUFFER_PAYLOAD_TYPE_IMAGE && type != ARV_BUFFER_PAYLOAD_TYPE_EXTENDED_CHUNK_DATA)
    return error(
        Code::frame_incomplete,
        "the frame has GigE Vision payload type %d; allowed are 1 (image), 5 (extended chunk data), 10 (multi-part)",
        static_cast<int>(type));
  if (parts != 1) return error(Code::frame_incomplete, "the image has %u parts, allowed is 1", parts);
  if (Status status = has_geometry(0); !status) return status.error();
  if (!chunks) {
    if (received != layout.bytes())
      return error(Code::frame_incomplete, "%zu bytes arrived, the frame has %zu", received, layout.bytes());
    return frame;
  }
  if (received > payload_bytes || received < layout.bytes())
    return error(Code::frame_incomplete, "%zu bytes arrived, allowed are %zu to %zu (feature PayloadSize)", received,
                 layout.bytes(), payload_bytes);
  const Result<std::size_t> image = first_chunk_bytes(frame);
  if (!image) return image.error();
  if (image.value() != layout.bytes())
    return error(Code::frame_incomplete, "chunk data: the image has %zu bytes, needed are %zu", image.value(),
                 layout.bytes());
  return frame.first(image.value());
}

}  // namespace slabd::gateway::genicam
