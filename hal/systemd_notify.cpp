// SPDX-License-Identifier: Apache-2.0
#include <systemd/sd-daemon.h>

#include "hal/hal.h"

namespace slabd::hal {
namespace {

/// sd_notify() returns 0 and does nothing when NOTIFY_SOCKET is not set; an unreachable service manager is not ours
/// to report (it will miss the watchdog and restart us).
class SystemdNotify final : public ServiceNotify {
 public:
  void ready() override { sd_notify(0, "READY=1"); }
  void watchdog() override { sd_notify(0, "WATCHDOG=1"); }
  void stopping() override { sd_notify(0, "STOPPING=1"); }
  void status(std::string_view line) override {
    FixedString<512> message("STATUS=");
    // A newline would start another assignment of the protocol.
    message.append(line.substr(0, line.find('\n')));
    sd_notify(0, message.c_str());
  }
};

}  // namespace

std::unique_ptr<ServiceNotify> make_systemd_notify() {
  return std::make_unique<SystemdNotify>();
}

}  // namespace slabd::hal
