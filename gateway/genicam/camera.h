// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "base/base.h"
#include "config/config.h"
#include "gateway/genicam/points.h"

/// One GigE Vision camera through Aravis. The only part of slabd that uses Aravis, which has threads and a heap of its
/// own, and believes what a camera sends.
namespace slabd::gateway::genicam {

/// Largest frame: points of 12 bytes, normals of 12, a texture and a confidence of 4 each, for the most points of a
/// scan, and 1 MB of chunk data.
inline constexpr std::size_t kFrameBytesMax = limits::kScanPointsMax * 32 + 1'000'000;
/// Two frames: the one that is received, and a second one so that a frame of an earlier exposure is received whole and
/// discarded instead of filling this one.
inline constexpr std::size_t kFrames = 2;

/// Memory of the two frames, mapped once. Pages are used when a frame is first received into them.
class FrameMemory {
 public:
  /// Throws std::bad_alloc if it cannot be mapped.
  FrameMemory();
  ~FrameMemory();
  FrameMemory(const FrameMemory&) = delete;
  FrameMemory& operator=(const FrameMemory&) = delete;
  [[nodiscard]] std::span<std::byte> frame(std::size_t index) const {
    return {begin_ + index * kFrameBytesMax, kFrameBytesMax};
  }

 private:
  std::byte* begin_ = nullptr;
};

/// The device as it states itself, and its settings.
struct Identity {
  std::string vendor;
  std::string model;
  std::string serial;
  std::string firmware;
  std::uint32_t settings_crc = 0;  ///< CRC-32C of all writable features with their values, transport left out
  /// "MODEL SERIAL FIRMWARE SETTINGS-CRC", at most 64 bytes: the name of the scanner in its acceptance.
  std::string text;
};

/// State of the link to the camera, for the log and --check.
struct LinkFacts {
  std::string camera_address;
  std::string interface_address;
  int packet_bytes = 0;    ///< as the camera accepted it
  bool resends = false;    ///< the camera can send lost packets again
  bool has_clock = false;  ///< its clock proves that a frame was exposed after its trigger
  std::size_t payload_bytes = 0;
};

/// One exposure.
struct Shot {
  std::uint32_t width = 0;
  std::uint32_t height = 0;
  std::size_t finite = 0;               ///< points that are not missing
  std::int64_t utime_us = 0;            ///< this computer's clock when the frame began to arrive
  std::uint64_t packets_requested = 0;  ///< requests for lost packets
  std::uint64_t frames_discarded = 0;   ///< of earlier exposures
  double temperature_c = kNoValue;      ///< DeviceTemperature after the exposure; NaN if the camera does not state it
};

class Camera {
 public:
  /// Connects, takes control, checks the node map and sets component, trigger and packet size.
  /// scanner_offline: the camera does not answer, or another program controls it (after a crash: until its heartbeat
  /// timeout). config: a feature does not fit; the text contains feature, value and allowed values.
  static Result<std::unique_ptr<Camera>> open(const config::GenicamSettings& settings, const FrameMemory& memory);
  ~Camera();
  Camera(const Camera&) = delete;
  Camera& operator=(const Camera&) = delete;

  [[nodiscard]] const Identity& identity() const { return identity_; }
  [[nodiscard]] const LinkFacts& link() const { return link_; }
  [[nodiscard]] const PointLayout& layout() const { return layout_; }
  /// Differences that were accepted, one sentence each, for the log.
  [[nodiscard]] const std::vector<std::string>& notes() const { return notes_; }
  /// True if control was lost: the camera must be opened again.
  [[nodiscard]] bool lost() const;

  /// Takes one exposure that begins after this call, into `xyz` (3 * layout().points() floats, mm). Returns only a
  /// frame that is complete in every byte. trigger_timeout: no frame within [genicam] timeout_s, or `wait_ns` in all;
  /// frame_incomplete: packets are missing, or the frame is not what the node map describes; scanner_offline: control
  /// was lost; interrupted: `stop` returned true. After an error the content of `xyz` is undefined.
  [[nodiscard]] Result<Shot> take(std::int64_t wait_ns, std::span<float> xyz, const std::function<bool()>& stop);

 private:
  struct Aravis;
  Camera(const config::GenicamSettings& settings, const FrameMemory& memory);
  Status configure();
  Status choose_component();
  Status check_geometry();
  Status read_axes();
  Status set_trigger();
  Status set_packet_size();
  Status read_identity();
  void test_clock();
  Status settle_debt(std::int64_t until_ns, const std::function<bool()>& stop);

  const config::GenicamSettings& settings_;
  const FrameMemory& memory_;
  std::unique_ptr<Aravis> aravis_;
  Identity identity_;
  LinkFacts link_;
  PointLayout layout_;
  std::int64_t component_id_ = 0;  ///< in a multi-part frame
  std::vector<std::string> notes_;
  std::int64_t owed_until_ns_ = 0;  ///< until then a frame of an exposure that was given up may arrive
};

/// Ids of the GigE Vision cameras that answer now, as [genicam] camera accepts them. Takes about a second.
[[nodiscard]] std::vector<std::string> cameras_found();

}  // namespace slabd::gateway::genicam
