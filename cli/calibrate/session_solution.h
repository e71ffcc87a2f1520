// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "cli/calibrate/session.h"
#include "storage/storage.h"

/// Solving a session, and what is kept of it.
namespace slabd::cli {

struct SessionSolution {
  std::vector<calib::View> views;  ///< of the fit
  calib::HandEye hand_eye;
  calib::SolvedRecord record;  ///< step and time are filled in when it is kept
  std::string figures;         ///< slabd.hand_eye/1
};
/// Solves the views of the fit. The same session gives the same bits. config: no views, or one that cannot be used.
[[nodiscard]] Result<SessionSolution> solve_session(const Session& session);

/// Everything a solution was made from, as it is kept in the database.
[[nodiscard]] std::string observations_text(const Session& session);

/// Stops, with what to do, unless there is a solution of these views that may be verified and applied.
void need_solution(const Session& session);

}  // namespace slabd::cli
