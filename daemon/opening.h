// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <atomic>
#include <functional>
#include <memory>

#include "daemon/loop.h"

/// Serves the ports while the database is opened: it is checked page by page, and five gigabytes take a minute on a
/// slow disk. Meanwhile the PLC reads STATE 1 (recover), a counting heartbeat and READY off, instead of losing the
/// connection.
namespace slabd::daemon {

/// Calls `open` on its own thread and serves `ports` until it has returned: PLC (writes are accepted without effect),
/// control socket (status), watchdog. `ports.store` is not used. Nullptr if `stop` became true meanwhile: the thread
/// may still be running, and the process must end without waiting for it.
using OpenStore = std::function<Result<std::unique_ptr<storage::Store>>()>;
[[nodiscard]] std::unique_ptr<Result<std::unique_ptr<storage::Store>>> open_beside_the_line(
    const OpenStore& open, const Ports& ports, const StationSettings& settings, const LoopFigures& figures,
    const std::atomic<bool>& stop);

}  // namespace slabd::daemon
