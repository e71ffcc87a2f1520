// SPDX-License-Identifier: Apache-2.0
#include "calib/calib.h"

#include <sha256.h>

#include <cmath>
#include <cstdio>

namespace slabd::calib {
namespace {

constexpr double kArmMax_mm = 2000.0;
constexpr double kUnitTolerance = 1e-3;

/// Identifier of these numbers: the first 12 hex digits of the SHA-256 of their full-precision text.
FixedString<64> identify(const std::array<double, 7>& pose, double sigma_mm, double sigma_deg) {
  FixedString<512> text;
  text.printf("%.17g %.17g %.17g %.17g %.17g %.17g %.17g %.17g %.17g", pose[0], pose[1], pose[2], pose[3], pose[4],
              pose[5], pose[6], sigma_mm, sigma_deg);
  FixedString<64> id;
  id.printf("commissioning-%.12s", sha256_hex(text.view()).c_str());
  return id;
}

}  // namespace

std::string sha256_hex(std::string_view bytes) {
  std::array<char, SHA256_DIGEST_STRING_LENGTH> hex{};
  SHA256Data(reinterpret_cast<const std::uint8_t*>(bytes.data()), bytes.size(), hex.data());
  return {hex.data()};
}

Result<Calibration> commissioning(const std::array<double, 7>& T_flange_scanner, double station_sigma_mm,
                                  double station_sigma_deg) {
  double norm2 = 0.0;
  double arm2_mm2 = 0.0;
  for (std::size_t i = 0; i < 7; ++i) {
    if (!std::isfinite(T_flange_scanner[i]))
      return error(Code::calibration_missing, "T_flange_scanner[%zu] is not a finite number", i);
    (i < 3 ? arm2_mm2 : norm2) += T_flange_scanner[i] * T_flange_scanner[i];
  }
  if (std::abs(std::sqrt(norm2) - 1.0) > kUnitTolerance)
    return error(Code::calibration_missing,
                 "T_flange_scanner: the quaternion (numbers 4..7: qw qx qy qz) has length %.6f, must be 1 within %g",
                 std::sqrt(norm2), kUnitTolerance);
  if (arm2_mm2 > kArmMax_mm * kArmMax_mm)
    return error(Code::calibration_missing,
                 "T_flange_scanner: the scanner sits %.0f mm from the flange, at most %.0f mm", std::sqrt(arm2_mm2),
                 kArmMax_mm);
  for (const double sigma : {station_sigma_mm, station_sigma_deg})
    if (has_value(sigma) && !(sigma > 0.0 && std::isfinite(sigma)))
      return error(Code::calibration_missing, "station_sigma_mm and station_sigma_deg must be positive, got %g", sigma);

  Calibration calibration;
  calibration.T_flange_scanner = Pose::from_array(T_flange_scanner);
  calibration.station_sigma_mm = station_sigma_mm;
  calibration.station_sigma_rad = rad_from_deg(station_sigma_deg);
  calibration.id = identify(T_flange_scanner, station_sigma_mm, station_sigma_deg);
  return calibration;
}

}  // namespace slabd::calib
