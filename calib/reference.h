// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <string_view>

#include "base/base.h"
#include "base/calibration.h"

/// The artefacts that watch over a calibration from day to day. Repeats cannot show what is wrong by the same amount
/// every time (a scanner that bends its picture, a worn projector); an artefact whose slope and jaw distance somebody
/// else has measured can.
namespace slabd::calib {

struct ReferenceCertificate {
  std::string id;
  std::string date;
  std::string issuer;  ///< may be empty
  ReferenceBlock block;
};

/// Reads the text form:
///
///     id = ref-block-01
///     date = 2026-03-14
///     issuer = "DKD-K-00000"         # optional
///     slope_deg = 1.4321
///     slope_U_deg = 0.0020           # expanded
///     jaw_distance_mm = 380.012
///     jaw_distance_U_mm = 0.006
///     coverage_factor = 2            # optional, 2 if absent; of both
///
/// config: the text names `file_name`:line, what is wrong and what is allowed.
[[nodiscard]] Result<ReferenceCertificate> parse_reference_certificate(std::string_view text,
                                                                       std::string_view file_name);

/// Limits beside those that follow from the uncertainties; NaN: none.
struct CheckLimits {
  double slope_rad = kNoValue;
  double jaw_distance_mm = kNoValue;
};

/// Compares one measurement of the reference block with its certificate. Passed when slope and jaw distance were both
/// measured, each with a U, and lie within sqrt(U^2 + U_certificate^2) of the certificate and within `limits`: a larger
/// error says that the U of every verdict since the last check was not true. Fills passed, the measured figures and
/// note; the caller fills ids, time, who and source.
[[nodiscard]] CalibrationCheck check_block(const ReferenceBlock& certified, const BlockResult& measured,
                                           const CheckLimits& limits);

/// Compares the monitor ball with its place. A note on a check that passed says that it nearly failed.
[[nodiscard]] CalibrationCheck check_ball(const MonitorBall& certified, const Vec3& centre_base_mm);

}  // namespace slabd::calib
