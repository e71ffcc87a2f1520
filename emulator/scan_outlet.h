// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "config/config.h"
#include "hal/hal.h"

/// How the emulated scanner hears requests and delivers scans: as files in a drop directory, or over TCP. One thread
/// uses it.
namespace slabd::simulate {

class ScanOutlet {
 public:
  virtual ~ScanOutlet() = default;
  /// "<session>-<seq>" of a request that was not answered yet, or empty. `trouble` is set when something is wrong.
  [[nodiscard]] virtual std::string pending(std::string& trouble) = 0;
  /// Makes a scan (mm) ready to be delivered; what was ready before is forgotten. `xyz` holds nothing of use
  /// afterwards.
  [[nodiscard]] virtual Status put(std::vector<float>& xyz, std::size_t width, std::size_t height) = 0;
  /// Delivers what is ready as the answer to `name`, which then waits no more.
  [[nodiscard]] virtual Status deliver(const std::string& name) = 0;
  /// Nothing will be delivered for it.
  virtual void give_up(const std::string& name) = 0;
};

/// The one that the daemon's configuration asks for; `format` of dropped files. scanner_offline: the drop directory
/// cannot be used. A daemon that does not listen yet is tried again.
[[nodiscard]] Result<std::unique_ptr<ScanOutlet>> open_outlet(const daemon::Config& config, hal::ScanFormat format);

}  // namespace slabd::simulate
