// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "base/calibration.h"
#include "cli/scanner/acceptance.h"

/// One verification of the scanner: what was looked at, the worst of it, and the record that U will use.
namespace slabd::cli {

struct VerifiedPlate {
  std::string file;
  PlateFigures figures;
};
struct VerifiedBall {
  std::string file;
  BallFigures figures;
};

/// NaN: no such limit.
struct AcceptanceLimits {
  double PF_mm = kNoValue;
  double PS_mm = kNoValue;  ///< of the magnitude
  double RF_mm = kNoValue;
};

struct Verification {
  std::string scanner;            ///< name or serial number, empty: not said
  double diameter_mm = kNoValue;  ///< certified, of the ball as coated
  AcceptanceLimits limits;
  std::vector<VerifiedPlate> plates;
  std::vector<VerifiedBall> balls;
};

/// Places of the volume that were looked at: scans of one place count once (kPlaceApart_mm, kPlaceApart_rad).
[[nodiscard]] std::size_t plate_places(const Verification& verification);
[[nodiscard]] std::size_t ball_places(const Verification& verification);
/// The worst of all places. A figure that has a limit and was not measured is not within it.
[[nodiscard]] ScannerNumbers numbers_of(const Verification& verification);
/// "PF 0.3100 mm (allowed 0.0500)", one for each limit that is not kept.
[[nodiscard]] std::vector<std::string> limits_broken(const Verification& verification);
/// Lines for [uncertainty] of a recipe that shall say what was found; empty: no plate was seen.
[[nodiscard]] std::string budget_lines(const ScannerNumbers& numbers);

/// slabd.scanner_verification/1. `id`: of the record it was kept as, empty: it was not.
[[nodiscard]] std::string verification_json(const Verification& verification, std::int64_t utime_us,
                                            std::string_view id, bool in_force);

}  // namespace slabd::cli
