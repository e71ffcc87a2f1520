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

/// The written forms of a calibration that is done view by view: what was agreed at its beginning, and one record for
/// every view. Text in, values out: nothing here opens a file. Numbers are written with every digit, so that a record
/// read back gives the same bits and a calibration solved again is the same calibration.
namespace slabd::calib {

/// What was agreed when the calibration began; never changed afterwards.
struct SessionSettings {
  ArtefactKind kind = ArtefactKind::ball;
  std::string name;
  std::string created;  ///< UTC, "2026-11-20T23:28:01Z"
  std::string config;   ///< of the daemon, absolute path; empty: none
  std::string operator_name;
  double radius_mm = kNoValue;  ///< ball: certified, effective
  double radius_sigma_mm = 0.003;
  StatedNoise noise;
  double limit_mm = kNoValue;  ///< of the predicted point error; NaN: as SolveSettings
  FieldOfView fov;
  double scanner_noise_mm = 0.05;
  double noise_correlation_mm = 0.0;
  bool parallel = false;     ///< rays parallel to Z
  std::string unit = "mm";   ///< of the scans
  std::string columns;       ///< of scans that are tables: "2,3,4"; empty if they name x, y and z
  std::size_t goal = 20;     ///< views that count, held-out ones among them
  std::size_t held_out = 3;  ///< of these
  /// Words of a table's format header that the poses given on the command line are in; empty: the neutral form.
  std::string flange_form;
  std::string certificate_sha256;   ///< of the artefact's certificate; empty: none
  bool has_start = false;           ///< T_flange_scanner at the beginning is roughly known
  Pose T_flange_scanner;            ///< ... as this: the calibration in force, or the commissioning value
  std::string start_id;             ///< which of them
  Vec3 down_base = -Vec3::UnitZ();  ///< where the scanner looks in production, base frame
};

/// May a view take part in the fit?
enum class ViewUse : std::uint8_t {
  refused,   ///< the artefact was not found well enough
  fit,       ///< takes part
  held_out,  ///< accepted, left out of the fit to verify it
};
[[nodiscard]] std::string_view name(ViewUse use);

/// One scan of a view, as it was kept.
struct KeptShot {
  std::string file;    ///< name inside the view's folder
  std::string source;  ///< where it came from
  std::uint64_t bytes = 0;
  std::string sha256;  ///< of the file, hex
};

/// What the robot said while a view was taken from the running line.
struct LiveStamp {
  bool given = false;
  double spread_mm = kNoValue;   ///< of the poses through the scans, peak to valley
  double spread_deg = kNoValue;  ///< ... of rotation
  std::int64_t seq_first = 0;    ///< LCM sequence numbers
  std::int64_t seq_last = 0;
  std::int64_t utime_first_us = 0;
  std::int64_t utime_last_us = 0;
};

/// One view: where the robot was, which scans, what was found in them.
struct CapturedView {
  std::size_t number = 0;  ///< from 1, never given twice
  std::size_t step = 0;    ///< place in the order of all changes, from 1
  std::string captured;    ///< UTC
  ViewUse use = ViewUse::refused;
  std::string refusal;  ///< word; empty when accepted
  std::string reason;   ///< sentence
  std::string cure;
  std::string flange_form;  ///< format words of `flange`; empty: neutral
  std::string flange;       ///< the numbers as they were given
  std::vector<KeptShot> shots;
  LiveStamp live;

  // What was found; NaN where nothing was.
  std::uint64_t points = 0;
  double half_angle_deg = kNoValue;  ///< of the ball's cap, the smallest of all shots and balls
  double rms_mm = kNoValue;          ///< radial; of an artefact: of its balls against the certificate; the largest
  double radius_off_mm = kNoValue;   ///< free radius minus certified, mean over the shots
  double repeat_mm = kNoValue;       ///< several shots: standard deviation per axis of one
  Pose T_scanner_target;             ///< ball: centre, rotation identity
  Mat6 covariance = Mat6::Zero();    ///< of it, View::target_covariance; ball: scanner axes, upper left 3 x 3

  [[nodiscard]] bool accepted() const { return use != ViewUse::refused; }
};

/// A record as text, ended by a checksum of the lines before it, and back. config: an unknown, repeated or missing key,
/// a value that makes no sense, a checksum that is missing (a torn file) or does not fit (an edited one); the text
/// names `file_name` and the line.
[[nodiscard]] std::string session_text(const SessionSettings& settings);
[[nodiscard]] Result<SessionSettings> parse_session(std::string_view text, std::string_view file_name);
[[nodiscard]] std::string view_text(const CapturedView& view);
[[nodiscard]] Result<CapturedView> parse_view(std::string_view text, std::string_view file_name);

/// A view taken out, or a step undone: what happened to a view after it was captured.
struct ViewChange {
  std::size_t step = 0;
  std::size_t undoes = 0;  ///< the step that this one takes back; 0: the view is dropped
  std::string when;        ///< UTC
  std::string who;
  std::string why;
};
[[nodiscard]] std::string change_text(const ViewChange& change);
[[nodiscard]] Result<ViewChange> parse_view_change(std::string_view text, std::string_view file_name);

/// A solution, short: what it was made from, what came out. The figures stand beside it.
struct SolvedRecord {
  std::size_t step = 0;
  std::string when;
  std::string id;       ///< as storage will name the numbers, "he-..."
  std::string inputs;   ///< SHA-256 of everything it was computed from
  std::string figures;  ///< SHA-256 of the figures beside it
  bool ok = false;      ///< false: refused, and stored because it was asked for; never applied
  HandEyeNumbers numbers;
  double point_sigma_mm = kNoValue;
  double leave_one_out_mm = kNoValue;  ///< median
  double s0 = kNoValue;
};
[[nodiscard]] std::string solved_text(const SolvedRecord& solved);
[[nodiscard]] Result<SolvedRecord> parse_solved(std::string_view text, std::string_view file_name);

/// A solution held against views that took no part in it, and somebody's word that it shall be used.
struct VerifiedRecord {
  std::string when;
  std::string who;
  std::string inputs;     ///< SHA-256 of the held-out views and of what is compared with
  std::string before_id;  ///< what it was compared with; empty: nothing
  double before_rms_mm = kNoValue;
  double after_rms_mm = kNoValue;
  double after_max_mm = kNoValue;
  double shift_max_mm = kNoValue;  ///< by which a seat moves, the largest
};
[[nodiscard]] std::string verified_text(const VerifiedRecord& verified);
[[nodiscard]] Result<VerifiedRecord> parse_verified(std::string_view text, std::string_view file_name);

/// `body` and the line `sha256 = ...` of it; and the body again. config: missing, or does not fit.
[[nodiscard]] std::string with_checksum(std::string body);
[[nodiscard]] Result<std::string> without_checksum(std::string_view text, std::string_view file_name);
/// SHA-256, hex.
[[nodiscard]] std::string sha256_hex(std::string_view bytes);

/// An accepted view as the solver takes it, by the same reading as a line of a table of poses; it is weighed by the
/// stated noise, as there: a scan's own covariance knows nothing of the errors that all its points have in common.
/// config: the pose's numbers are not what its form says; `origin` stands in front of the text.
[[nodiscard]] Result<View> solver_view(ArtefactKind kind, const CapturedView& view, std::string_view origin);
/// Everything a solution of these views depends on, as text: two sets with equal text have the same solution, bit for
/// bit. Times, places and names are not in it; nor is what the balls are certified as, which enters the record's sigmas
/// and the verdict alone.
[[nodiscard]] std::string solver_inputs(const SessionSettings& settings, const std::vector<View>& views);
/// A pose in a declared form: `form` the words of a table's format header, empty for the neutral one. config as above.
[[nodiscard]] Result<Pose> parse_flange(std::string_view form, std::string_view numbers, std::string_view origin);

/// Is the next accepted view to be held out? Spread over the goal, so that verification sees all of the volume: with 20
/// views of which 3 are held out, the 7th, the 14th and the 20th. `counted`, `held_out`: accepted ones so far.
[[nodiscard]] bool hold_out_next(const SessionSettings& settings, std::size_t counted, std::size_t held_out);

}  // namespace slabd::calib
