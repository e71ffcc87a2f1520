// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "base/base.h"
#include "base/durable.h"
#include "calib/calib.h"
#include "cli/exit.h"
#include "cli/terminal/say.h"
#include "config/config.h"
#include "storage/storage.h"

namespace slabd::cli::args {
class Command;
}  // namespace slabd::cli::args

/// A calibration session, stored as a folder of readable files:
///
///     session.txt                   settings agreed at the beginning
///     certificate.txt               of the artefact, if there is one
///     views/007/view.txt            pose and results; 007/*.ply the original scans
///     views/007/drop-12.txt         step 12 dropped the view
///     views/003/undo-13.txt         step 13 took back a step of this view
///     next-pose.txt                 the suggested T_base_flange
///     solutions/0014/solved.txt     the result; figures.json; verified.txt
///
/// Every change is one rename of a complete, synced entry, so an interruption leaves the state before or after it.
/// Nothing is changed or deleted, except the partial copies of an interrupted capture, which are reported first.
namespace slabd::cli {

class Session {
 public:
  struct Entry {
    calib::CapturedView view;
    std::string folder;
    std::string unreadable;  ///< reason why view.txt cannot be used; then only view.number is valid
    std::size_t dropped_step = 0;
    std::string dropped_why;
    bool undone = false;  ///< its capture was undone

    /// True if the view is used in fit or verification.
    [[nodiscard]] bool counts() const { return unreadable.empty() && view.accepted() && dropped_step == 0 && !undone; }
  };
  struct Solution {
    calib::SolvedRecord record;
    std::string folder;
    std::optional<calib::VerifiedRecord> verified;
  };

  /// Creates the folder; `certificate` is stored as text. Code::config: it exists already; Code::journal_write.
  [[nodiscard]] static Status create(const std::string& dir, const calib::SessionSettings& settings,
                                     const std::string& certificate);
  /// Reads the whole session. Code::config: the folder is not a session, or its session.txt is invalid.
  [[nodiscard]] static Result<Session> open(const std::string& dir);

  [[nodiscard]] const std::string& dir() const { return dir_; }
  [[nodiscard]] const calib::SessionSettings& settings() const { return settings_; }
  [[nodiscard]] const std::string& certificate_text() const { return certificate_text_; }
  [[nodiscard]] const std::vector<Entry>& entries() const { return entries_; }
  /// Descriptions of interrupted operations.
  [[nodiscard]] const std::vector<std::string>& half_done() const { return half_done_; }
  /// The newest solution, even if views have changed since.
  [[nodiscard]] const std::optional<Solution>& solution() const { return solution_; }
  /// True if the solution was computed from the current views.
  [[nodiscard]] bool solution_is_current() const { return solution_ && solution_->record.inputs == inputs(); }

  [[nodiscard]] std::size_t counted(calib::ViewUse use) const;
  /// Capture time of the oldest view of the fit: newer views do not make the calibration newer.
  [[nodiscard]] std::int64_t oldest_utime_us() const;
  /// The views of one use, by number. Code::config if one cannot be parsed.
  [[nodiscard]] Result<std::vector<calib::View>> views(calib::ViewUse use) const;
  /// SHA-256 of all inputs of a solution or a verification.
  [[nodiscard]] std::string inputs(calib::ViewUse use = calib::ViewUse::fit) const;
  [[nodiscard]] calib::SolveSettings solve_settings() const;
  [[nodiscard]] calib::CoverageSettings coverage_settings() const;
  [[nodiscard]] calib::Guide guide() const;
  [[nodiscard]] std::optional<calib::ArtefactCertificate> certificate() const;

  // Changes; each requires the lock. Code::config: another slabctl is changing the session.
  [[nodiscard]] Status lock();
  /// Creates a folder for a view's scans. `intent` describes the copy, in case it is interrupted.
  [[nodiscard]] Result<std::string> begin_view(const std::string& intent);
  /// Makes the view part of the session; sets number, step and time. `part` as returned by begin_view().
  [[nodiscard]] Status commit_view(const std::string& part, calib::CapturedView& view);
  /// Discards a begun view and deletes its copies.
  void discard_view(const std::string& part) const;
  /// Code::config: the view does not exist or is already dropped.
  [[nodiscard]] Status drop(std::size_t number, const std::string& who, const std::string& why);
  /// Takes back the newest capture or drop that has not been taken back; returns its description. Code::config: there
  /// is none.
  [[nodiscard]] Result<std::string> undo(const std::string& who);
  /// Stores a solution with its figures, unless one with the same inputs and figures exists.
  [[nodiscard]] Status keep_solution(calib::SolvedRecord& record, const std::string& figures);
  /// Writes the suggested pose as a table of one line, next-pose.txt, for moving the robot. Write errors are ignored,
  /// because it is a hint.
  void leave_next_pose(const calib::Guide& guide) const;
  [[nodiscard]] Status keep_verified(const calib::VerifiedRecord& record) const;

 private:
  /// An undo is stored with the view whose step it takes back.
  struct Undo {
    std::size_t view = 0;
    std::size_t step = 0;
  };
  void read_views();
  void read_view(std::size_t number, const std::string& folder, std::vector<Undo>& undos);
  void read_view_changes(Entry& entry, std::vector<Undo>& undos);
  void apply_steps(const std::vector<Undo>& undos);
  void read_solutions();
  [[nodiscard]] Status add_step(const Entry& entry, const std::string& word, const calib::ViewChange& change);

  std::string dir_;
  calib::SessionSettings settings_;
  std::string certificate_text_;
  std::vector<Entry> entries_;
  std::vector<std::string> half_done_;
  std::vector<std::string> half_done_paths_;
  struct Step {
    std::size_t step = 0;
    std::size_t view = 0;  ///< number of the view
    bool is_drop = false;
    bool taken_back = false;
    std::string why;  ///< reason of a drop
  };
  std::vector<Step> steps_;  ///< captures and drops
  std::size_t last_step_ = 0;
  std::size_t unreadable_steps_ = 0;  ///< views whose step number is unknown
  std::optional<Solution> solution_;
  std::optional<FileLock> lock_;
};

/// `--session NAME|DIR` and `--config`, which select the session of a command, and `--language`.
struct SessionOptions {
  std::string session;
  std::string config;
  LanguageOption language;
  void add_to(args::Command& command);
};
/// The named session, otherwise the last used one, otherwise the only one in the configuration's folder; it is stored
/// as the last used one. Stops with a cure if there is none.
[[nodiscard]] Session find_session(const SessionOptions& options);
void remember_session(const std::string& dir);
/// Folder of `name`: itself if it is a path (has a slash), otherwise in the configuration's folder. Code::config: a
/// name without a path, and no configuration with a folder.
[[nodiscard]] Result<std::string> session_dir(const std::string& name, const std::string& config);
/// Reads the configuration of `path` (empty: the default path, where it may be missing). False if it has errors, which
/// are printed.
[[nodiscard]] bool config_if_any(const std::string& path, std::optional<config::Config>& config);

/// "session hall-2 (/var/lib/slabd/calibration/hall-2)"
[[nodiscard]] std::string session_words(const Session& session);

// Solution of a session, and its stored form.

struct SessionSolution {
  std::vector<calib::View> views;  ///< of the fit
  calib::HandEye hand_eye;
  calib::SolvedRecord record;  ///< step and time are set when it is stored
  std::string figures;         ///< slabd.hand_eye/1
};
/// Solves the views of the fit. The same session gives the same bits. Code::config if no views exist, or one is
/// invalid.
[[nodiscard]] Result<SessionSolution> solve_session(const Session& session);

/// All inputs of a solution, as stored in the database.
[[nodiscard]] std::string observations_text(const Session& session);

/// Stops with a cure unless there is a solution of the current views that may be verified and applied.
void need_solution(const Session& session);

// Inputs of a solver in addition to the views: noise, field of view, limit. Shared by `solve`, for tables, and `new`,
// for a whole session.

struct SolveOptions {
  double robot_sigma_mm = calib::StatedNoise{}.robot_mm;
  double robot_sigma_deg = kNoValue;
  double target_sigma_mm = calib::StatedNoise{}.target_mm;
  double target_sigma_deg = kNoValue;
  double limit_mm = kNoValue;
  std::vector<double> fov;

  void add_to(args::Command& command);
  /// Stated noise. If only a position noise is given for the robot, the rotation noise is in proportion: the angles of
  /// a 0.06 mm robot with 0.7 mm would get a hundred times too much weight. The noise of the targets is not reduced
  /// for that.
  [[nodiscard]] calib::StatedNoise noise() const;
  [[nodiscard]] calib::SolveSettings settings() const;
  /// Error of --fov; empty if it is valid.
  [[nodiscard]] std::string fov_fault() const;
};

// Effect of a change of T_flange_scanner at the slab: displacement of every seat.

/// A larger displacement of a seat requires a confirmation ...
inline constexpr double kConfirmAbove_mm = 0.2;
/// ... and so does a larger rotation of the scanner: a rotation about the seen point moves no seat, but changes every
/// slope. A tenth of a slope's tolerance, half of its U.
inline constexpr double kConfirmAbove_deg = 0.01;

/// True if a change needs no confirmation. A change of unknown size (NaN) needs one.
[[nodiscard]] inline bool is_small_change(double shift_mm, double turn_deg) {
  return shift_mm <= kConfirmAbove_mm && turn_deg <= kConfirmAbove_deg;
}

struct StationShift {
  int station = 0;
  bool taught = false;  ///< with the taught pose of mastering; otherwise the nominal pose
  Vec3 shift_mm;        ///< displacement of the seat's centre, slab axes
};
struct SeatShifts {
  std::vector<StationShift> stations;
  std::string slab;  ///< the recipe of the stations, in words
  double shift_max_mm = kNoValue;
};

/// Displacement of the seats if one T_flange_scanner replaces another, with the same scans at the taught poses, or at
/// nominal ones. `slab_type` 0: that of the first recipe. nullopt on success, otherwise the reason.
[[nodiscard]] std::optional<Stop> find_seat_shifts(const config::Config& config, std::uint16_t slab_type,
                                                   const Pose& before, const Pose& after, SeatShifts& out);

}  // namespace slabd::cli
