// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "base/result.h"
#include "config/config.h"
#include "storage/storage.h"

/// Changes calibrations. The daemon carries out the change if it runs, because only one process may write the
/// database. Otherwise slabctl writes the database, which is locked against a starting daemon.
namespace slabd::cli {

struct ChangeAnswer {
  std::string id;  ///< id of the changed record
  bool by_daemon = false;
  bool after_slab = false;  ///< the daemon uses the change from the next slab on, because a slab is open
};

/// Carries out one change and returns when it is durable. Code::config: rejected without a change, with reason and
/// cure. Code::scanner_offline: the daemon did not answer in time; `slabctl calibrate history` shows whether the
/// change was carried out. Code::journal_write, Code::store_full: the database could not be written.
[[nodiscard]] Result<ChangeAnswer> change_calibration(const config::Config& config,
                                                      const storage::CalibrationChange& change);

/// Call this before reading data that the command will change. If a change was killed while it opened the database,
/// readers have no access until a writer has recovered it. If that fails, the reader reports the error.
void finish_killed_change(const config::Config& config);

/// Login name of the user of slabctl, "operator" if unknown.
[[nodiscard]] std::string default_operator();
/// Wall clock, us.
[[nodiscard]] std::int64_t wall_clock_us();

}  // namespace slabd::cli
