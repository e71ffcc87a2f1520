// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <atomic>
#include <functional>
#include <memory>

#include "daemon/loop.h"

/// The time in which the database is opened: it is checked page by page, and five gigabytes take a minute on a slow
/// disk. Meanwhile the PLC is not left with a dead connection: it reads STATE 1 (recover), a heartbeat that counts,
/// READY off.
namespace slabd::daemon {

/// Calls `open` on a thread of its own and serves `ports` until it has returned: PLC (writes are taken and do nothing
/// yet), control socket (status), watchdog. `ports.store` is not used. Nullptr when `stop` became true meanwhile: the
/// thread may still be at work, and the process must end without waiting for it.
using OpenStore = std::function<Result<std::unique_ptr<storage::Store>>()>;
[[nodiscard]] std::unique_ptr<Result<std::unique_ptr<storage::Store>>> open_beside_the_line(
    const OpenStore& open, const Ports& ports, const StationSettings& settings, const LoopFigures& figures,
    const std::atomic<bool>& stop);

}  // namespace slabd::daemon
