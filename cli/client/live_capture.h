// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <functional>
#include <string>
#include <string_view>
#include <vector>

#include "base/base.h"
#include "base/result.h"
#include "cli/exit.h"

/// Takes views for a calibration with the running line. The daemon goes to maintenance (STATE 8, SCAN and SLAB_BEGIN
/// refused with 107), waits until the robot stops, triggers the scanner, and answers with the scan and the pose during
/// it.
///
/// The control socket has the verb "capture" for it (one JSON line in each direction):
///
///   {"verb":"capture","action":"begin","session":S,"operator":O,"lease_s":300,"take_over":false}
///   {"verb":"capture","action":"shoot","session":S}      starts a view; "state" reports when it is done
///   {"verb":"capture","action":"state","session":S}      with a session: also renews the lease
///   {"verb":"capture","action":"release","session":S,"scan":PATH}
///   {"verb":"capture","action":"end","session":S}
///
/// Each is answered at once with slabd.capture/1 (open session, robot state, result of the last shot) or with
/// slabd.error/1 ("error": sentence with the cure, "code": of base/result.h). A session is identified by its name
/// alone: `begin` of the open session continues it, so a slabctl that was killed begins again. Sessions do not survive
/// a restart of the daemon: it comes up idle.
///
/// The lease ends if no action names the session for `lease_s`; the daemon then returns to idle and logs it.
///
/// Scans are stored in `<[storage] spool_dir>/capture/` until `release` names them; neither a budget nor a restart
/// deletes them. Scans that are not released within seven days are deleted when the next session begins.
namespace slabd::cli {

struct LiveCaptureBegin {
  std::string session;         ///< 1..100 bytes of text; the same name continues a session
  std::string operator_name;   ///< 1..60 bytes
  std::int64_t lease_s = 300;  ///< 10..3600, renewed by every action
  bool take_over = false;      ///< end an open session of another name (never during its shot)
  std::string scanner{};       ///< id of the scanner, on a line with several
};

/// Result of a shot. Lengths mm, angles rad.
struct LiveShot {
  std::uint32_t number = 0;  ///< 1, 2, ... of this session, rejected ones included
  std::string scan_path;     ///< absolute, in the daemon's capture folder: copy it, then call release()
  std::uint64_t points = 0;  ///< finite ones
  Pose T_base_flange;        ///< mean of all poses of the window
  double spread_mm = 0.0;    ///< largest peak to valley of x, y, z over the window
  double spread_rad = 0.0;   ///< largest peak to valley of the orientation over the window
  double window_s = 0.0;     ///< time of the used poses: from at least a second before the request to the scan's end
  std::uint32_t pose_samples = 0;
  std::int32_t first_seq = 0;  ///< of the sender
  std::int32_t last_seq = 0;
  std::int64_t first_utime_us = 0;  ///< sender's clock, of the first and last pose
  std::int64_t last_utime_us = 0;
  std::int64_t requested_utime_us = 0;  ///< daemon's clock: time of the request to the scanner
  std::int64_t scan_utime_us = 0;       ///< daemon's clock: the scan was received, the exposure had ended
  std::int32_t base_id = 0;
  std::int32_t tool_id = 0;
  std::vector<std::string> warnings;  ///< sentences: a tool is active, limits are wider than recommended, ...
};

/// One session on the daemon. It does not end by itself: without end() the lease remains.
class LiveCapture {
 public:
  /// `socket`: daemon::Config::control_socket. Code::scanner_offline: the daemon does not answer. Code::busy: a slab
  /// is open, or a command or another session is in progress; the text names it and the cure. Line faults other than a
  /// missing calibration (503) are returned with their own code. Code::config: a name or time out of range.
  [[nodiscard]] static Result<LiveCapture> begin(const std::string& socket, const LiveCaptureBegin& begin);

  /// Takes one view and returns when it is durable or rejected. `said` receives the progress as text whenever it
  /// changes ("waiting until the robot stands: moved 0.034 mm along z", "scanning"). After a rejection no data remains
  /// and shoot() may be called again. Code::not_settled, moved_during_scan: axis and distance of the motion.
  /// Code::no_pose, pose_stale, wrong_frame, scanner_offline, trigger_timeout, frame_incomplete, too_few_points,
  /// store_full, journal_write: as in production. Code::interrupted: ABORT by the PLC, or the session has ended.
  /// Code::busy: another shot is in progress.
  [[nodiscard]] Result<LiveShot> shoot(const std::function<void(std::string_view)>& said);

  /// Renews the lease. Code::wrong_slab: the session is no longer open (lease over, daemon restarted); call begin()
  /// again.
  [[nodiscard]] Status keep();
  /// Reports that the session has its copy: the daemon deletes the scan.
  [[nodiscard]] Status release(const std::string& scan_path);
  /// Returns to idle. Ok also if the session was no longer open.
  [[nodiscard]] Status end();

  /// Ends `session` without beginning it, whichever process began it. A line in production remains in production.
  struct Ended {
    std::string other;           ///< another session that holds the line, which is not changed; empty if there is none
    std::string other_operator;  ///< operator of that session
  };
  [[nodiscard]] static Result<Ended> end(const std::string& socket, const std::string& session);

  /// Warnings of the daemon about this session (guard limits wider than 0.01 mm / 0.001 deg / 1 s, ...).
  [[nodiscard]] const std::vector<std::string>& warnings() const { return warnings_; }

 private:
  LiveCapture(std::string socket, std::string session) : socket_(std::move(socket)), session_(std::move(session)) {}
  [[nodiscard]] Result<std::string> ask(std::string_view action, std::string_view scan_path = {}) const;

  std::string socket_;
  std::string session_;
  std::vector<std::string> warnings_;
};

/// Exit status of a rejection: 4 for daemon, robot link or scanner, also if the line is not free; 6 if the robot
/// moved; 3 and 5 as for other commands.
[[nodiscard]] Exit live_capture_exit(Code code);

}  // namespace slabd::cli
