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
};

/// Copies the scans, finds the artefact in them, and makes the view part of the session (whose lock is held), refused
/// or not. config: a scan or pose that cannot be read, the scan of another view; journal_write.
[[nodiscard]] Result<Taken> take_view(Session& session, const ViewRequest& request);

/// The same from the running daemon: it makes sure that the robot stands still through all shots. scanner_offline,
/// no_pose, and what the daemon says otherwise.
[[nodiscard]] Result<Taken> take_live(Session& session, int shots, bool hold_out);
/// Gives the line back before its lease is over.
[[nodiscard]] Status end_live(const Session& session);

}  // namespace slabd::cli
