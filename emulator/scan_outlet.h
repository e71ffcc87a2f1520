// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "config/config.h"
#include "hal/hal.h"

/// Receives requests and delivers scans of the emulated scanner: as files in a drop directory, or over TCP. Used by
/// one thread.
namespace slabd::emulator {

class ScanOutlet {
 public:
  virtual ~ScanOutlet() = default;
  /// "<session>-<seq>" of a request without an answer, or empty. `trouble` is set on an error.
  [[nodiscard]] virtual std::string pending(std::string& trouble) = 0;
  /// Prepares a scan (mm) for delivery and replaces the previous one. The content of `xyz` is unspecified afterwards.
  /// `temperature_c`: of the scanner; NaN: it does not state one.
  [[nodiscard]] virtual Status put(std::vector<float>& xyz, std::size_t width, std::size_t height,
                                   double temperature_c = kNoValue) = 0;
  /// Delivers the prepared scan as the answer to `name`, which is then no longer pending.
  [[nodiscard]] virtual Status deliver(const std::string& name) = 0;
  /// Marks the request as answered without a scan.
  virtual void give_up(const std::string& name) = 0;
};

/// Opens the outlet to the daemon's port for the scanner of this arm; `format`: format of dropped files.
/// Code::scanner_offline if the drop directory cannot be used. The connection is retried if the daemon does not listen
/// yet.
[[nodiscard]] Result<std::unique_ptr<ScanOutlet>> open_outlet(const config::ArmSettings& arm, hal::ScanFormat format);

}  // namespace slabd::emulator
