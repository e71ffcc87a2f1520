// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "base/calibration.h"
#include "cli/scanner/acceptance.h"

/// One verification of the scanner: its scans, the worst figures, and the record for U.
namespace slabd::cli {

struct VerifiedPlate {
  std::string file;
  PlateFigures figures;
  double temperature_c = kNoValue;  ///< of the scanner, as the scan declares it
};
struct VerifiedBall {
  std::string file;
  BallFigures figures;
  double temperature_c = kNoValue;
};

/// NaN: no limit.
struct AcceptanceLimits {
  double PF_mm = kNoValue;
  double PS_mm = kNoValue;  ///< limit of the magnitude
  double RF_mm = kNoValue;
};

struct Verification {
  std::string scanner;            ///< name or serial number; empty if not given
  double diameter_mm = kNoValue;  ///< certified, of the coated ball
  AcceptanceLimits limits;
  double temperature_c = kNoValue;  ///< of the scanner, as given; NaN: as the scans declare it
  std::vector<VerifiedPlate> plates;
  std::vector<VerifiedBall> balls;
};

/// Number of different places in the volume: scans of one place count once (kPlaceApart_mm, kPlaceApart_rad).
[[nodiscard]] std::size_t plate_places(const Verification& verification);
[[nodiscard]] std::size_t ball_places(const Verification& verification);
/// The worst figures of all places. A figure with a limit that was not measured is out of the limit.
[[nodiscard]] ScannerNumbers numbers_of(const Verification& verification);
/// Temperature of the scanner: as given, else the mean of the scans that declare one; NaN if none does.
[[nodiscard]] double temperature_of(const Verification& verification);
/// Largest difference between the temperatures that the scans declare, K; 0 if at most one does.
[[nodiscard]] double temperature_span_K(const Verification& verification);
/// "PF 0.3100 mm (allowed 0.0500)", one for each exceeded limit.
[[nodiscard]] std::vector<std::string> limits_broken(const Verification& verification);
/// Lines for [uncertainty] of a recipe with these figures; empty if no plate was measured.
[[nodiscard]] std::string budget_lines(const ScannerNumbers& numbers);

/// slabd.scanner_verification/1. `id`: id of the stored record, empty if it was not stored.
[[nodiscard]] std::string verification_json(const Verification& verification, std::int64_t utime_us,
                                            std::string_view id, bool in_force);

}  // namespace slabd::cli
