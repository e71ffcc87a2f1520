// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "hal/hal.h"

/// Stand-ins for a robot link and a scanner that could not be set up. The daemon stays up and says why: the PLC sees
/// the link down, and a command that needs it fails with the code.
namespace slabd::daemon {

class AbsentPose : public hal::PosePort {
 public:
  explicit AbsentPose(std::string_view why) : why_(why) {}
  [[nodiscard]] int fd() const override { return -1; }
  [[nodiscard]] bool next(std::int64_t, PoseSample&) override { return false; }
  [[nodiscard]] const hal::PoseLinkCounters& counters() const override { return counters_; }
  [[nodiscard]] std::string_view trouble() const override { return why_.view(); }

 private:
  FixedString<limits::kErrorTextBytes> why_;
  hal::PoseLinkCounters counters_;
};

class AbsentScanner : public hal::ScannerPort {
 public:
  explicit AbsentScanner(const Error& why) : why_(why) {}
  [[nodiscard]] Result<AcquiredScan> acquire(const ScanRequest&, std::span<float>, const std::atomic<bool>&,
                                             const hal::ScanDecoded&) override {
    return why_;
  }
  void idle() override {}
  [[nodiscard]] bool online() const override { return false; }
  [[nodiscard]] std::uint64_t stray_files() const override { return 0; }

 private:
  Error why_;
};

}  // namespace slabd::daemon
