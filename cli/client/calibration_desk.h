// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "base/result.h"
#include "config/config.h"
#include "storage/storage.h"

/// The one way slabctl changes calibrations: through the daemon when it runs, because only one process may write the
/// database; else straight into the database, which is locked against a daemon that starts meanwhile.
namespace slabd::cli {

struct DeskAnswer {
  std::string id;  ///< of the record the change was about
  bool by_daemon = false;
  bool after_slab = false;  ///< the daemon has it and uses it from the next slab on; one is open now
};

/// Carries out one change and returns when it is durable. config: refused, nothing was changed, the text says why and
/// what to do. scanner_offline: the daemon runs but did not answer in time; whether it was carried out is then shown by
/// `slabctl calibrate history`. journal_write, store_full: the database could not be written.
[[nodiscard]] Result<DeskAnswer> change_calibration(const daemon::Config& config,
                                                    const storage::CalibrationChange& change);

/// To be called before a command reads what it is about to change: when nobody listens and a change was killed while it
/// opened the database, no reader is let in until a writer has finished that. Should it not succeed, the reader says
/// why.
void finish_killed_change(const daemon::Config& config);

/// "operator" for a note when nobody gave a name: the login name of who runs slabctl.
[[nodiscard]] std::string default_operator();
/// Wall clock, us.
[[nodiscard]] std::int64_t wall_clock_us();

}  // namespace slabd::cli
