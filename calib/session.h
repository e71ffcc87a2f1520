// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "base/base.h"
#include "base/calibration.h"
#include "calib/hand_eye.h"
#include "calib/observations.h"

/// Text forms of a calibration made view by view: the settings from its beginning, and one record per view. No function
/// here opens a file. Numbers are written with all digits, so that reading a record gives the same bits, and solving
/// again gives the same calibration.
namespace slabd::calib {

/// Settings from the beginning of the calibration; never changed later.
struct SessionSettings {
  ArtefactKind kind = ArtefactKind::ball;
  std::string name;
  std::string created;  ///< UTC, "2026-11-20T23:28:01Z"
  std::string config;   ///< the daemon's configuration, absolute path; empty if none
  std::string scanner;  ///< its id on a line with several, or if it is not "1"; else empty
  std::string operator_name;
  double radius_mm = kNoValue;  ///< ball: certified effective radius
  double radius_sigma_mm = 0.003;
  StatedNoise noise;
  double limit_mm = kNoValue;  ///< limit of the predicted point error; NaN: as SolveSettings
  FieldOfView fov;
  double scanner_noise_mm = 0.05;
  double noise_correlation_mm = 0.0;
  bool parallel = false;     ///< rays are parallel to Z
  std::string unit = "mm";   ///< unit of the scans
  std::string columns;       ///< of scans that are tables: "2,3,4"; empty if they name x, y and z
  std::size_t goal = 20;     ///< number of counted views, including held-out ones
  std::size_t held_out = 3;  ///< number of held-out views
  /// Words of the format header for poses from the command line; empty: the neutral form.
  std::string flange_form;
  std::string certificate_sha256;   ///< SHA-256 of the artefact's certificate; empty if none
  bool has_start = false;           ///< an approximate T_flange_scanner was known at the beginning
  Pose T_flange_scanner;            ///< that value: the calibration in force, or the commissioning value
  std::string start_id;             ///< id of that value
  Vec3 down_base = -Vec3::UnitZ();  ///< direction of the scanner's axis in production, base frame
};

/// Use of a view in the fit.
enum class ViewUse : std::uint8_t {
  refused,   ///< the artefact was not found well enough
  fit,       ///< part of the fit
  held_out,  ///< accepted, but left out of the fit for its verification
};
[[nodiscard]] std::string_view name(ViewUse use);

/// One stored scan of a view.
struct KeptShot {
  std::string file;    ///< name inside the view's folder
  std::string source;  ///< original path
  std::uint64_t bytes = 0;
  std::string sha256;  ///< SHA-256 of the file, hex
};

/// Robot data while a view was taken from the running line.
struct LiveStamp {
  bool given = false;
  double spread_mm = kNoValue;   ///< spread of the poses during the scans, peak to valley
  double spread_deg = kNoValue;  ///< spread of the rotations
  std::int64_t seq_first = 0;    ///< LCM sequence numbers
  std::int64_t seq_last = 0;
  std::int64_t utime_first_us = 0;
  std::int64_t utime_last_us = 0;
};

/// One view: robot pose, scans, and results.
struct CapturedView {
  std::size_t number = 0;  ///< from 1, never reused
  std::size_t step = 0;    ///< position in the sequence of all changes, from 1
  std::string captured;    ///< UTC
  ViewUse use = ViewUse::refused;
  std::string refusal;  ///< word; empty if accepted
  std::string reason;   ///< sentence
  std::string cure;
  std::string flange_form;  ///< format words of `flange`; empty: neutral form
  std::string flange;       ///< the numbers as given
  std::vector<KeptShot> shots;
  LiveStamp live;

  // Results; NaN if nothing was found.
  std::uint64_t points = 0;
  double half_angle_deg = kNoValue;  ///< half angle of the ball's cap, the smallest of all shots and balls
  double rms_mm = kNoValue;          ///< largest rms: radial, or of an artefact's balls against the certificate
  double radius_off_mm = kNoValue;   ///< free radius minus certified, mean over the shots
  double repeat_mm = kNoValue;       ///< with several shots: standard deviation of one, per axis
  Pose T_scanner_target;             ///< ball: centre with identity rotation
  /// Covariance of T_scanner_target as View::target_covariance; ball: scanner axes, upper left 3 x 3.
  Mat6 covariance = Mat6::Zero();

  [[nodiscard]] bool accepted() const { return use != ViewUse::refused; }
};

/// Write records as text, followed by a checksum of the lines, and read them. config: an unknown, repeated or missing
/// key, an invalid value, a checksum that is missing (a truncated file) or wrong (an edited one). The text contains
/// `file_name` and the line.
[[nodiscard]] std::string session_text(const SessionSettings& settings);
[[nodiscard]] Result<SessionSettings> parse_session(std::string_view text, std::string_view file_name);
[[nodiscard]] std::string view_text(const CapturedView& view);
[[nodiscard]] Result<CapturedView> parse_view(std::string_view text, std::string_view file_name);

/// Change of a view after its capture: the view was dropped, or a step was undone.
struct ViewChange {
  std::size_t step = 0;
  std::size_t undoes = 0;  ///< the step that this one undoes; 0: the view is dropped
  std::string when;        ///< UTC
  std::string who;
  std::string why;
};
[[nodiscard]] std::string change_text(const ViewChange& change);
[[nodiscard]] Result<ViewChange> parse_view_change(std::string_view text, std::string_view file_name);

/// Summary of a solution: inputs and results. The figures are stored next to it.
struct SolvedRecord {
  std::size_t step = 0;
  std::string when;
  std::string id;       ///< id that storage will assign, "he-..."
  std::string inputs;   ///< SHA-256 of all inputs
  std::string figures;  ///< SHA-256 of the figures next to it
  bool ok = false;      ///< false: rejected, and stored on request; never applied
  HandEyeNumbers numbers;
  double point_sigma_mm = kNoValue;
  double leave_one_out_mm = kNoValue;  ///< median
  double s0 = kNoValue;
};
[[nodiscard]] std::string solved_text(const SolvedRecord& solved);
[[nodiscard]] Result<SolvedRecord> parse_solved(std::string_view text, std::string_view file_name);

/// Verification of a solution with views that are not part of it, and its approval by a person.
struct VerifiedRecord {
  std::string when;
  std::string who;
  std::string inputs;     ///< SHA-256 of the held-out views and of the compared calibration
  std::string before_id;  ///< the compared calibration; empty if none
  double before_rms_mm = kNoValue;
  double after_rms_mm = kNoValue;
  double after_max_mm = kNoValue;
  double shift_max_mm = kNoValue;  ///< largest shift of a seat
};
[[nodiscard]] std::string verified_text(const VerifiedRecord& verified);
[[nodiscard]] Result<VerifiedRecord> parse_verified(std::string_view text, std::string_view file_name);

/// Appends the line `sha256 = ...` to `body`, or checks and removes it. config: the checksum is missing or wrong.
[[nodiscard]] std::string with_checksum(std::string body);
[[nodiscard]] Result<std::string> without_checksum(std::string_view text, std::string_view file_name);
/// SHA-256, hex.
[[nodiscard]] std::string sha256_hex(std::string_view bytes);

/// Converts an accepted view for the solver, by the same parser as a line of a table of poses. It is weighted by the
/// stated noise too, because a scan's own covariance excludes errors common to all its points. config: the numbers do
/// not match the form; `origin` is the prefix of the text.
[[nodiscard]] Result<View> solver_view(ArtefactKind kind, const CapturedView& view, std::string_view origin);
/// Text of all inputs that a solution of these views depends on: equal texts give equal solutions, bit for bit. Times,
/// places and names are excluded. The certified values of the balls are excluded too, because they affect only the
/// record's sigmas and the verdict.
[[nodiscard]] std::string solver_inputs(const SessionSettings& settings, const std::vector<View>& views);
/// Parses a pose in a declared form: `form` is the words of a table's format header, empty for the neutral one. config
/// as above.
[[nodiscard]] Result<Pose> parse_flange(std::string_view form, std::string_view numbers, std::string_view origin);

/// True if the next accepted view is to be held out. Held-out views are spread over the goal, so that verification
/// covers the whole volume. Of 20 views with 3 held out, these are the 7th, the 14th and the 20th. `counted`,
/// `held_out`: accepted ones so far.
[[nodiscard]] bool hold_out_next(const SessionSettings& settings, std::size_t counted, std::size_t held_out);

}  // namespace slabd::calib
