// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <string_view>

#include "base/base.h"
#include "base/calibration.h"
#include "base/thermal.h"

/// Artefacts that monitor a calibration from day to day. Repeats do not reveal a constant error (a distorting scanner,
/// a worn projector). An artefact with an independently certified slope and jaw distance does.
namespace slabd::calib {

struct ReferenceCertificate {
  std::string id;
  std::string date;
  std::string issuer;  ///< may be empty
  ReferenceBlock block;
  double temperature_c = 20.0;          ///< of the certified values
  double expansion_per_K = kNoValue;    ///< NaN: not stated, and the block's temperature is not taken into account
  double expansion_u_per_K = kNoValue;  ///< its standard uncertainty
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
///     temperature_c = 20             # optional, 20 if absent; of both
///     expansion_per_K = 11.5e-6      # optional; of the block's material
///     expansion_u_per_K = 0.5e-6     # optional, a tenth of the expansion if absent; standard uncertainty
///
/// config: the text contains `file_name`:line, the fault and the allowed values.
[[nodiscard]] Result<ReferenceCertificate> parse_reference_certificate(std::string_view text,
                                                                       std::string_view file_name);

/// The block's expansion since its certification. An unknown temperature (NaN) counts as any of a workshop, 0 to 40
/// deg C. Zero if the certificate has no expansion.
[[nodiscard]] Thermal expansion_of(const ReferenceCertificate& certificate, double temperature_c);

/// Limits in addition to those from the uncertainties; NaN if there are none.
struct CheckLimits {
  double slope_rad = kNoValue;
  double jaw_distance_mm = kNoValue;
};

/// Compares one measurement of the reference block with its certificate. Passed if slope and jaw distance were both
/// measured, each with a U, and are within sqrt(U^2 + U_certificate^2) of the certificate and within `limits`. A larger
/// error means that the U of all verdicts since the last check was too small. The measured distance is stated at the
/// certificate's temperature: what a recipe's [thermal] did for a slab of concrete is undone, and `expansion` is taken
/// off. Sets passed, the measured figures and note; the caller sets ids, time, who and source.
[[nodiscard]] CalibrationCheck check_block(const ReferenceBlock& certified, const BlockResult& measured,
                                           const CheckLimits& limits, const Thermal& expansion = {});

/// Compares the monitor ball with its stored place. A passed check has a note if it nearly failed.
[[nodiscard]] CalibrationCheck check_ball(const MonitorBall& certified, const Vec3& centre_base_mm);

}  // namespace slabd::calib
