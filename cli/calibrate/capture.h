// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "cli/calibrate/session.h"

/// From scans and a pose to a view of the session.
namespace slabd::cli {

struct ViewRequest {
  std::vector<std::string> scans;  ///< shots of one pose
  std::string flange_form;         ///< words of a format header; empty: neutral
  std::string flange;              ///< numbers, single blanks between
  calib::LiveStamp live;
  bool hold_out = false;
};
struct Taken {
  calib::CapturedView view;
  bool already = false;  ///< it was there
  bool dropped = false;  ///< ... and was dropped: it counts for nothing
};

/// Copies the scans, finds the artefact in them, and makes the view part of the session (whose lock is held), refused
/// or not. config: a scan or pose that cannot be read, the scan of another view; journal_write.
[[nodiscard]] Result<Taken> take_view(Session& session, const ViewRequest& request);

struct LiveOptions {
  int shots = 3;
  bool hold_out = false;
  bool take_over = false;  ///< end a session of another name that is open
};
/// The same from the running daemon: it makes sure that the robot stands still through all shots. scanner_offline,
/// no_pose, and what the daemon says otherwise; journal_write: the session has no copy, the daemon's scans are kept.
[[nodiscard]] Result<Taken> take_live(Session& session, const LiveOptions& options);
/// Gives the line back before its lease is over; says in words how the line stands. A line that the session does not
/// have is left alone, and that is no error.
[[nodiscard]] Result<std::string> end_live(const Session& session);

}  // namespace slabd::cli
