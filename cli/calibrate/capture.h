// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "cli/calibrate/session.h"

/// Adds scans with a pose to a session as a view.
namespace slabd::cli {

struct ViewRequest {
  std::vector<std::string> scans;  ///< all shots of one pose
  std::string flange_form;         ///< words of a format header; empty: slabd's own form
  std::string flange;              ///< numbers, separated by single blanks
  calib::LiveStamp live;
  bool hold_out = false;
};
struct Taken {
  calib::CapturedView view;
  bool already = false;  ///< the view existed before
  bool dropped = false;  ///< the existing view was dropped and is not counted
};

/// Copies the scans, finds the artefact in them, and adds the view to the session (whose lock is held), accepted or
/// rejected. Code::config: a scan or pose that cannot be read, or a scan of another view; Code::journal_write.
[[nodiscard]] Result<Taken> take_view(Session& session, const ViewRequest& request);

struct LiveOptions {
  int shots = 3;
  bool hold_out = false;
  bool take_over = false;  ///< ends an open session of another name
};
/// The same with the running daemon, which ensures that the robot does not move during the shots.
/// Code::scanner_offline, Code::no_pose and other errors of the daemon. Code::journal_write: the session has no copy,
/// and the daemon keeps its scans.
[[nodiscard]] Result<Taken> take_live(Session& session, const LiveOptions& options);
/// Returns the line before its lease ends; the result describes the state of the line. If the session does not hold
/// the line, this is not an error and the line is not changed.
[[nodiscard]] Result<std::string> end_live(const Session& session);

}  // namespace slabd::cli
