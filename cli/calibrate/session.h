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
#include "config/config.h"
#include "storage/storage.h"

namespace slabd::args {
class Command;
}  // namespace slabd::args

/// A calibration under way, as a folder that people can read:
///
///     session.txt                   what was agreed at its beginning
///     certificate.txt               of the artefact, when there is one
///     views/007/view.txt            pose and what was found; 007/*.ply the scans as they came
///     views/007/drop-12.txt         step 12 dropped it
///     views/003/undo-13.txt         step 13 took a step of this view back
///     next-pose.txt                 the suggested T_base_flange
///     solutions/0014/solved.txt     the result; figures.json; verified.txt
///
/// Every change is one rename of something whole and synced, so a stop at any moment leaves the state before or after
/// it. Nothing is ever changed or deleted, except what a stop left half-copied, and that is named first.
namespace slabd::cli {

class Session {
 public:
  struct Entry {
    calib::CapturedView view;
    std::string folder;
    std::string unreadable;  ///< why view.txt cannot be used; then only view.number is known
    std::size_t dropped_step = 0;
    std::string dropped_why;
    bool undone = false;  ///< its capture was taken back

    /// Takes part in fit or verification.
    [[nodiscard]] bool counts() const { return unreadable.empty() && view.accepted() && dropped_step == 0 && !undone; }
  };
  struct Solution {
    calib::SolvedRecord record;
    std::string folder;
    std::optional<calib::VerifiedRecord> verified;
  };

  /// Makes the folder; `certificate` is kept as text. config: it exists already; journal_write.
  [[nodiscard]] static Status create(const std::string& dir, const calib::SessionSettings& settings,
                                     const std::string& certificate);
  /// Reads everything. config: no session there, or its session.txt cannot be used.
  [[nodiscard]] static Result<Session> open(const std::string& dir);

  [[nodiscard]] const std::string& dir() const { return dir_; }
  [[nodiscard]] const calib::SessionSettings& settings() const { return settings_; }
  [[nodiscard]] const std::string& certificate_text() const { return certificate_text_; }
  [[nodiscard]] const std::vector<Entry>& entries() const { return entries_; }
  /// Words for what a stop left half-done, one each.
  [[nodiscard]] const std::vector<std::string>& half_done() const { return half_done_; }
  /// The newest solution, whatever has changed since.
  [[nodiscard]] const std::optional<Solution>& solution() const { return solution_; }
  /// Is it a solution of the views that count now?
  [[nodiscard]] bool solution_is_current() const { return solution_ && solution_->record.inputs == inputs(); }

  [[nodiscard]] std::size_t counted(calib::ViewUse use) const;
  /// When the first of the views that are solved was captured: a new view among old ones makes them no younger.
  [[nodiscard]] std::int64_t oldest_utime_us() const;
  /// The views of one use, by number. config: one cannot be read as its form says.
  [[nodiscard]] Result<std::vector<calib::View>> views(calib::ViewUse use) const;
  /// SHA-256 of everything a solution is computed from, or a verification.
  [[nodiscard]] std::string inputs(calib::ViewUse use = calib::ViewUse::fit) const;
  [[nodiscard]] calib::SolveSettings solve_settings() const;
  [[nodiscard]] calib::CoverageSettings coverage_settings() const;
  [[nodiscard]] calib::Guide guide() const;
  [[nodiscard]] std::optional<calib::ArtefactCertificate> certificate() const;

  // Changes; each needs the lock. config: another slabctl is changing the session.
  [[nodiscard]] Status lock();
  /// A folder to collect a view's scans in. `intent` says what is being copied, for whoever finds it half-done.
  [[nodiscard]] Result<std::string> begin_view(const std::string& intent);
  /// The view is there from here on; number, step and time are filled in. `part` as begin_view() gave it.
  [[nodiscard]] Status commit_view(const std::string& part, calib::CapturedView& view);
  /// Gives up a begun view: what was copied goes.
  void discard_view(const std::string& part) const;
  /// config: no such view, or dropped already.
  [[nodiscard]] Status drop(std::size_t number, const std::string& who, const std::string& why);
  /// Takes back the newest capture or drop that is not taken back yet; tells which in words. config: nothing left.
  [[nodiscard]] Result<std::string> undo(const std::string& who);
  /// Keeps a solution with its figures; one with the same inputs and figures is there already and stays.
  [[nodiscard]] Status keep_solution(calib::SolvedRecord& record, const std::string& figures);
  /// The suggested pose as a table of one line, next-pose.txt, for whoever moves the robot by it. A hint: a disk that
  /// does not take it is no error.
  void leave_next_pose(const calib::Guide& guide) const;
  [[nodiscard]] Status keep_verified(const calib::VerifiedRecord& record) const;

 private:
  [[nodiscard]] Status read_views();
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
    std::size_t view = 0;  ///< number
    bool is_drop = false;
    bool taken_back = false;
    std::string why;  ///< of a drop
  };
  std::vector<Step> steps_;  ///< captures and drops
  std::size_t last_step_ = 0;
  std::optional<Solution> solution_;
  std::optional<FolderLock> lock_;
};

/// `--session NAME|DIR` and `--config`, and which session a command means.
struct SessionOptions {
  std::string session;
  std::string config;
  void add_to(args::Command& command);
};
/// The session named, else the one last worked on, else the only one in the configuration's folder; it is remembered as
/// last worked on. Stops, with what to do, if there is none.
[[nodiscard]] Session find_session(const SessionOptions& options);
void remember_session(const std::string& dir);
/// Where `name` lies: itself when it is a path (has a slash), else in the folder of the configuration. config: a bare
/// name, and no configuration that says where.
[[nodiscard]] Result<std::string> session_dir(const std::string& name, const std::string& config);
/// The configuration, if there is a usable one: that of `path` (empty: the default place, where none is no error).
/// False: there is one with problems (printed).
[[nodiscard]] bool config_if_any(const std::string& path, std::optional<daemon::Config>& config);

/// "session hall-2 (/var/lib/slabd/calibration/hall-2)"
[[nodiscard]] std::string session_words(const Session& session);

// Solving a session, and what is kept of it.

struct SessionSolution {
  std::vector<calib::View> views;  ///< of the fit
  calib::HandEye hand_eye;
  calib::SolvedRecord record;  ///< step and time are filled in when it is kept
  std::string figures;         ///< slabd.hand_eye/1
};
/// Solves the views of the fit. The same session gives the same bits. config: no views, or one that cannot be used.
[[nodiscard]] Result<SessionSolution> solve_session(const Session& session);

/// Everything a solution was made from, as it is kept in the database.
[[nodiscard]] std::string observations_text(const Session& session);

/// Stops, with what to do, unless there is a solution of these views that may be verified and applied.
void need_solution(const Session& session);

// What a solver is told beside the views: noise, field of view, limit. Shared by `solve`, from tables, and by `new`,
// for a whole session.

struct SolveOptions {
  double robot_sigma_mm = calib::StatedNoise{}.robot_mm;
  double robot_sigma_deg = kNoValue;
  double target_sigma_mm = calib::StatedNoise{}.target_mm;
  double target_sigma_deg = kNoValue;
  double limit_mm = kNoValue;
  std::vector<double> fov;

  void add_to(args::Command& command);
  /// Who states nothing but a position noise for the robot gets rotations in proportion: a robot of 0.7 mm with the
  /// angles of one of 0.06 mm would weigh them a hundred times too much. Targets are not taken to be better for it.
  [[nodiscard]] calib::StatedNoise noise() const;
  [[nodiscard]] calib::SolveSettings settings() const;
  /// What is wrong with --fov; empty: nothing.
  [[nodiscard]] std::string fov_fault() const;
};

// What a change of T_flange_scanner does at the slab: by how much every seat would be found elsewhere.

/// A seat that moves by more wants somebody's word ...
inline constexpr double kConfirmAboveMm = 0.2;
/// ... and a scanner that turns by more: turned about what it sees it moves no seat, and every slope. A tenth of a
/// slope's tolerance, half of its U.
inline constexpr double kConfirmAboveDeg = 0.01;

/// Does a change go into force without a word? One of unknown size (NaN) does not.
[[nodiscard]] inline bool is_small_change(double shift_mm, double turn_deg) {
  return shift_mm <= kConfirmAboveMm && turn_deg <= kConfirmAboveDeg;
}

struct StationShift {
  int station = 0;
  bool taught = false;  ///< by the pose it was mastered at; else by the nominal one
  Vec3 shift_mm;        ///< of the seat's centre, slab axes
};
struct SeatShifts {
  std::vector<StationShift> stations;
  std::string slab;  ///< which recipe the stations are of, in words
  double shift_max_mm = kNoValue;
};

/// Where the seats go when one T_flange_scanner takes the place of another: the robot stands as it was taught, or as it
/// nominally would be, and sees the same. `slab_type` 0: of the first recipe. nullopt if found; else why not.
[[nodiscard]] std::optional<Stop> find_seat_shifts(const daemon::Config& config, std::uint16_t slab_type,
                                                   const Pose& before, const Pose& after, SeatShifts& out);

}  // namespace slabd::cli
