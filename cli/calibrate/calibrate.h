// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "base/fields.h"
#include "calib/calib.h"
#include "report/json.h"

namespace slabd::calib {
SLABD_FIELDS(Spread, median, rms, max);
}  // namespace slabd::calib

namespace slabd::cli::args {
class Command;
}  // namespace slabd::cli::args

/// The subcommands of `slabctl calibrate`, one file each. Each function adds one to the group.
namespace slabd::cli {

void add_calibrate_new(args::Command& group);
void add_calibrate_capture(args::Command& group);
void add_calibrate_list(args::Command& group);
void add_calibrate_drop(args::Command& group);
void add_calibrate_undo(args::Command& group);
void add_calibrate_verify(args::Command& group);
void add_calibrate_ball(args::Command& group);
void add_calibrate_artefact(args::Command& group);
void add_calibrate_block(args::Command& group);
void add_calibrate_solve(args::Command& group);
void add_calibrate_stations(args::Command& group);
void add_calibrate_tie(args::Command& group);
void add_calibrate_reference(args::Command& group);
void add_calibrate_check(args::Command& group);
void add_calibrate_apply(args::Command& group);
void add_calibrate_adopt(args::Command& group);
void add_calibrate_rollback(args::Command& group);
void add_calibrate_history(args::Command& group);

// Output of a session after every step.

class Session;
/// Coverage of the views, missing directions, and the suggested next pose in words, as quaternion and for KUKA.
[[nodiscard]] std::string guide_text(const Session& session, const calib::Guide& guide);
/// The same as fields of the open object: `coverage`, `suggestion` (null: not needed), `next` (a command).
void write_guide(report::Json& json, const Session& session, const calib::Guide& guide);
/// Writes `session` and `folder` as fields of the open object.
void write_session(report::Json& json, const Session& session);
/// The command for the next step.
[[nodiscard]] std::string next_command(const Session& session);

// Output of a hand-eye result, for every command that solves.

/// Text: the transform in three notations, every figure with unit and meaning, warnings, reasons for rejection with
/// cures.
[[nodiscard]] std::string hand_eye_text(calib::ArtefactKind kind, const calib::HandEye& result,
                                        const calib::StatedNoise& noise);
/// Writes the fields of slabd.hand_eye/1 into the open object: status, T_flange_scanner, target, figures, reasons,
/// warnings. Views are numbered from 1. Missing values are null.
void write_hand_eye(report::Json& json, calib::ArtefactKind kind, const calib::HandEye& result,
                    const calib::StatedNoise& noise);

/// A transform in three notations (4 x 4, quaternion w first, KUKA X Y Z A B C) as indented lines.
[[nodiscard]] std::string pose_in_three_forms(const Pose& pose);

/// Contents of a text file of at most 16 MB. Code::config with the reason if it cannot be read.
[[nodiscard]] Result<std::string> text_file(const std::string& path);

}  // namespace slabd::cli
