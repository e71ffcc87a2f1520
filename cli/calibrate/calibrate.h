// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "base/fields.h"
#include "calib/calib.h"
#include "report/json.h"

namespace slabd::calib {
SLABD_FIELDS(Spread, median, rms, max);
}  // namespace slabd::calib

namespace slabd::args {
class Command;
}  // namespace slabd::args

/// The verbs of `slabctl calibrate`, one file each. Each adds itself to the group.
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
void add_calibrate_reference(args::Command& group);
void add_calibrate_check(args::Command& group);
void add_calibrate_apply(args::Command& group);
void add_calibrate_adopt(args::Command& group);
void add_calibrate_rollback(args::Command& group);
void add_calibrate_history(args::Command& group);

// How a session is told, after every step of it.

class Session;
/// How far the views reach, what is missing, the suggested next pose in words, as quaternion and for KUKA.
[[nodiscard]] std::string guide_text(const Session& session, const calib::Guide& guide);
/// The same as fields of the open object: `coverage`, `suggestion` (null: none needed), `next` (a command).
void write_guide(Json& json, const Session& session, const calib::Guide& guide);
/// `session` and `folder`, fields of the open object.
void write_session(Json& json, const Session& session);
/// The command that leads on from here.
[[nodiscard]] std::string next_command(const Session& session);

// How a hand-eye result is told, for every verb that solves.

/// For people: the transform in three notations, every figure with unit and meaning, warnings, refusals with cures.
[[nodiscard]] std::string hand_eye_text(calib::ArtefactKind kind, const calib::HandEye& result,
                                        const calib::StatedNoise& noise);
/// The fields of slabd.hand_eye/1, into the open object: status, T_flange_scanner, target, figures, reasons, warnings.
/// Views are numbered from 1. null where there is nothing to tell.
void write_hand_eye(Json& json, calib::ArtefactKind kind, const calib::HandEye& result,
                    const calib::StatedNoise& noise);

/// A transform three ways (4 x 4, quaternion w first, KUKA X Y Z A B C), indented lines.
[[nodiscard]] std::string pose_three_ways(const Pose& pose);

/// A whole text file, at most 16 MB. config: that it cannot be read, and why.
[[nodiscard]] Result<std::string> text_file(const std::string& path);

}  // namespace slabd::cli
