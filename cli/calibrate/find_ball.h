// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <span>
#include <string>
#include <vector>

#include "calib/calib.h"
#include "cli/terminal/parse.h"
#include "report/json.h"

namespace slabd::cli::args {
class Command;
}  // namespace slabd::cli::args

/// Output of balls and artefacts found in scans; shared by the offline commands and the capture of views.
namespace slabd::cli {

/// Text: position, sigmas, and every gate with its figure and limit; reason and cure if rejected. Whole lines.
[[nodiscard]] std::string ball_text(const calib::BallReport& ball, const calib::BallSettings& settings);
/// Text of all balls of a view, the view's own rejection first.
[[nodiscard]] std::string ball_view_text(const calib::BallView& view, const calib::BallSettings& settings);
[[nodiscard]] std::string artefact_text(const calib::ArtefactReport& report,
                                        const calib::ArtefactCertificate& certificate,
                                        const calib::ArtefactSettings& settings);

/// Writes fields into the open object. Lengths in mm, angles in degrees, null if not determined.
void write_ball_view(report::Json& json, const calib::BallView& view);
void write_artefact(report::Json& json, const calib::ArtefactReport& report);

/// Options shared by all commands that find balls: --scanner-noise-mm, --noise-correlation-mm, --parallel,
/// --unit, --columns.
struct BallOptions {
  double noise_mm = 0.05;
  double noise_correlation_mm = 0.0;
  bool parallel = false;
  ScanFormOptions form;
  void add_to(args::Command& command);
  /// Settings without radius and count, which the caller sets.
  [[nodiscard]] calib::BallSettings settings() const;
};

/// A view of one ball as a shot of it: the ball's report, with the view's rejection if only the view is rejected.
[[nodiscard]] calib::BallReport as_shot(const calib::BallView& view);

/// Reads the scans one after the other and passes them to `use`. Stops at a scan that cannot be read (bad input), or
/// at invalid settings (usage).
void each_scan(const std::vector<std::string>& paths, const hal::ScanForm& form,
               const std::function<Status(const std::string&, std::span<const float>)>& use);

/// A scan's points (3 floats each, mm). The error's text names the file.
[[nodiscard]] Result<std::vector<float>> scan_points(const std::string& path, const hal::ScanForm& form);

}  // namespace slabd::cli
