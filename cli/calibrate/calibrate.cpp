// SPDX-License-Identifier: Apache-2.0
//
// slabctl calibrate: the command group. Each subcommand is in its own file.
#include "cli/calibrate/calibrate.h"

#include "cli/command.h"
#include "cli/terminal/arguments.h"

namespace slabd::cli {

void add_calibrate(args::Command& app) {
  args::Command group =
      app.add_subcommand("calibrate", "Pose of the scanner on the flange: hand-eye, stations, tie of two robots");
  group->require_subcommand(1);
  add_calibrate_new(*group);
  add_calibrate_capture(*group);
  add_calibrate_list(*group);
  add_calibrate_drop(*group);
  add_calibrate_undo(*group);
  add_calibrate_solve(*group);
  add_calibrate_verify(*group);
  add_calibrate_apply(*group);
  add_calibrate_rollback(*group);
  add_calibrate_history(*group);
  add_calibrate_ball(*group);
  add_calibrate_artefact(*group);
  add_calibrate_block(*group);
  add_calibrate_stations(*group);
  add_calibrate_tie(*group);
  add_calibrate_reference(*group);
  add_calibrate_check(*group);
  add_calibrate_adopt(*group);
}

}  // namespace slabd::cli
