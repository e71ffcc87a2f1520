// SPDX-License-Identifier: Apache-2.0
//
// slabctl calibrate: the group. What each verb does is in its own file.
#include "cli/calibrate/calibrate.h"

#include "cli/command.h"
#include "cli/terminal/arguments.h"

namespace slabd::cli {

void add_calibrate(args::Command& app, int& exit_status) {
  args::Command group = app.add_subcommand("calibrate", "Where the scanner sits on the flange: hand-eye and stations");
  group->require_subcommand(1);
  add_calibrate_new(*group, exit_status);
  add_calibrate_capture(*group, exit_status);
  add_calibrate_list(*group, exit_status);
  add_calibrate_drop(*group, exit_status);
  add_calibrate_undo(*group, exit_status);
  add_calibrate_solve(*group, exit_status);
  add_calibrate_verify(*group, exit_status);
  add_calibrate_apply(*group, exit_status);
  add_calibrate_rollback(*group, exit_status);
  add_calibrate_history(*group, exit_status);
  add_calibrate_ball(*group, exit_status);
  add_calibrate_artefact(*group, exit_status);
  add_calibrate_block(*group, exit_status);
  add_calibrate_stations(*group, exit_status);
  add_calibrate_reference(*group, exit_status);
  add_calibrate_check(*group, exit_status);
  add_calibrate_adopt(*group, exit_status);
}

}  // namespace slabd::cli
