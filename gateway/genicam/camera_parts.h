// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <atomic>
#include <cstdint>
#include <optional>

#include "gateway/genicam/camera.h"
#include "gateway/genicam/node_map.h"

using ArvCamera = struct _ArvCamera;

/// Aravis' part of a camera, for the files of class Camera.
namespace slabd::gateway::genicam {

struct Camera::Aravis {
  Owned<ArvCamera> camera;
  ArvDevice* device = nullptr;  ///< belongs to `camera`
  std::atomic<bool> control_lost = false;
  std::uint64_t tick_frequency = 0;
  unsigned long signal = 0;  ///< handler of "control-lost"; 0: none

  [[nodiscard]] Nodes nodes() const { return Nodes(device); }
  /// The camera's clock in ns, as Aravis converts time stamps of frames; nullopt if it has none.
  [[nodiscard]] std::optional<std::uint64_t> clock_ns() const;
  Aravis() = default;
  ~Aravis();
  Aravis(const Aravis&) = delete;
  Aravis& operator=(const Aravis&) = delete;
};

}  // namespace slabd::gateway::genicam
