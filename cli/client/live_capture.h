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

/// Views for a calibration from the running line: the daemon goes to maintenance (STATE 8, SCAN and SLAB_BEGIN refused
/// with 107), waits until the robot stands, has the scanner scan, and answers with the scan and the pose over it.
///
/// On the control socket (one JSON line each way) it is the verb "capture":
///
///   {"verb":"capture","action":"begin","session":S,"operator":O,"lease_s":300,"take_over":false}
///   {"verb":"capture","action":"shoot","session":S}      begins one; "state" tells when it is done
///   {"verb":"capture","action":"state","session":S}      with a session: also renews the lease
///   {"verb":"capture","action":"release","session":S,"scan":PATH}
///   {"verb":"capture","action":"end","session":S}
///
/// Each is answered at once with slabd.capture/1 (what is open, what the robot does, what became of the last shot) or
/// with slabd.error/1 ("error": sentence with the cure, "code": of base/result.h). A session is known by its name
/// alone: `begin` of the session that is open continues it, so a slabctl that was killed just begins again. Nothing is
/// kept over a restart of the daemon: it comes up idle.
///
/// The lease ends when no action names the session for `lease_s`; the daemon then goes back to idle by itself and logs
/// it.
///
/// Scans lie in `<[storage] spool_dir>/capture/` until `release` names them: no budget deletes them, nor does a
/// restart. Those that nobody has taken after seven days go when the next session begins.
namespace slabd::cli {

struct LiveCaptureBegin {
  std::string session;         ///< 1..100 bytes of text; who begins with the same name goes on
  std::string operator_name;   ///< 1..60 bytes
  std::int64_t lease_s = 300;  ///< 10..3600, renewed by every action
  bool take_over = false;      ///< end a session of another name that is open (never one whose shot is under way)
};

/// What the daemon took. Lengths mm, angles rad.
struct LiveShot {
  std::uint32_t number = 0;  ///< 1, 2, ... of this session, refused ones counted too
  std::string scan_path;     ///< absolute, in the daemon's capture folder: copy it, then release()
  std::uint64_t points = 0;  ///< finite ones
  Pose T_base_flange;        ///< mean of all poses of the window
  double spread_mm = 0.0;    ///< largest peak to valley of x, y, z over the window
  double spread_rad = 0.0;   ///< largest peak to valley of the orientation over the window
  double window_s = 0.0;     ///< from the first pose that counts to the last: a second and more before the request, and
                             ///< through the scan
  std::uint32_t pose_samples = 0;
  std::int32_t first_seq = 0;  ///< of the sender
  std::int32_t last_seq = 0;
  std::int64_t first_utime_us = 0;  ///< sender's clock, of the first and last pose
  std::int64_t last_utime_us = 0;
  std::int64_t requested_utime_us = 0;  ///< daemon's clock: the scanner was asked
  std::int64_t scan_utime_us = 0;       ///< daemon's clock: the scan was there, the exposure over
  std::int32_t base_id = 0;
  std::int32_t tool_id = 0;
  std::vector<std::string> warnings;  ///< sentences: a tool is active, limits are wider than they should be, ...
};

/// One session on the daemon. Ends nothing by itself: a slabctl that leaves without end() leaves the lease.
class LiveCapture {
 public:
  /// `socket`: daemon::Config::control_socket. scanner_offline: the daemon does not answer. busy: a slab is open, a
  /// command or another session is under way; the text names it and what to do. Faults of the line other than a missing
  /// calibration (503) are refused with their own code. config: a name or time out of range.
  [[nodiscard]] static Result<LiveCapture> begin(const std::string& socket, const LiveCaptureBegin& begin);

  /// Takes one view and returns when it is durable, or refused; `said` hears what is going on, for people, whenever it
  /// changes ("waiting until the robot stands: moved 0.034 mm along z", "scanning"). After a refusal nothing is left
  /// and shoot() may simply be called again. not_settled, moved_during_scan: what moved and how much. no_pose,
  /// pose_stale, wrong_frame, scanner_offline, trigger_timeout, frame_incomplete, too_few_points, store_full,
  /// journal_write: as in production. interrupted: ABORT by the PLC, or the session ended meanwhile. busy: another shot
  /// is under way.
  [[nodiscard]] Result<LiveShot> shoot(const std::function<void(std::string_view)>& said);

  /// Renews the lease. wrong_slab: the session is not open any more (lease over, daemon restarted); begin() again.
  [[nodiscard]] Status keep();
  /// The session has its copy: the daemon deletes the scan.
  [[nodiscard]] Status release(const std::string& scan_path);
  /// Back to idle. Ok also when the session was not open any more.
  [[nodiscard]] Status end();

  /// Ends `session` without beginning it, whoever began it: a line that nobody had stays in production all the while.
  struct Ended {
    std::string other;           ///< another session that has the line instead; nothing was done to it. Empty: none
    std::string other_operator;  ///< and whose it is
  };
  [[nodiscard]] static Result<Ended> end(const std::string& socket, const std::string& session);

  /// Sentences of the daemon about this session (guard limits wider than 0.01 mm / 0.001 deg / 1 s, ...).
  [[nodiscard]] const std::vector<std::string>& warnings() const { return warnings_; }

 private:
  LiveCapture(std::string socket, std::string session) : socket_(std::move(socket)), session_(std::move(session)) {}
  [[nodiscard]] Result<std::string> ask(std::string_view action, std::string_view scan_path = {}) const;

  std::string socket_;
  std::string session_;
  std::vector<std::string> warnings_;
};

/// Exit status of a refusal: 4 daemon, robot link or scanner, also when the line is not free; 6 the robot did not stand
/// still; 3 and 5 as everywhere.
[[nodiscard]] Exit live_capture_exit(Code code);

}  // namespace slabd::cli
