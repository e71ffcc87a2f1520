// SPDX-License-Identifier: Apache-2.0
#include "calib/reference.h"

#include <cmath>

#include "calib/key_lines.h"

namespace slabd::calib {
namespace {

constexpr const char* kKeys =
    "id, date, issuer, slope_deg, slope_U_deg, jaw_distance_mm, jaw_distance_U_mm, coverage_factor, temperature_c, "
    "expansion_per_K, expansion_u_per_K";

/// Share of the limit above which a drift is reported. Repeatability alone (0.017 mm per axis, twice) reaches it once
/// in thirty checks with the usual 0.1 mm.
constexpr double kDriftShare = 0.7;
/// Larger than any drift in a cell.
constexpr double kNoDrift_mm = 5.0;

struct Deviation {
  const char* what;
  const char* unit;
  double off;
  double allowed;  ///< NaN: unknown, never passes
};

double allowed_of(double U_measured, double U_certified, double limit) {
  const double of_uncertainty = std::hypot(U_measured, U_certified);
  return has_value(limit) && limit < of_uncertainty ? limit : of_uncertainty;
}

}  // namespace

Result<ReferenceCertificate> parse_reference_certificate(std::string_view text, std::string_view file_name) {
  Result<std::vector<KeyLine>> lines = key_lines(text, file_name);
  if (!lines.ok()) return lines.error();
  KeyFile file(std::move(lines.value()), file_name);
  ReferenceCertificate c;
  file.text("id", true, c.id);
  file.date("date", c.date);
  file.text("issuer", false, c.issuer);
  double slope_deg = kNoValue;
  double slope_U_deg = kNoValue;
  double coverage = 2.0;
  file.number("slope_deg", true, -20.0, 20.0, slope_deg);
  file.number("slope_U_deg", true, 1e-6, 1.0, slope_U_deg);
  file.number("jaw_distance_mm", true, 10.0, 2'000.0, c.block.jaw_distance_mm);
  file.number("jaw_distance_U_mm", true, 1e-6, 5.0, c.block.jaw_distance_U_mm);
  file.number("coverage_factor", false, 1.0, 4.0, coverage);
  file.number("temperature_c", false, 0.0, 40.0, c.temperature_c);
  file.number("expansion_per_K", false, 0.0, 5e-5, c.expansion_per_K);
  file.number("expansion_u_per_K", false, 0.0, 1e-5, c.expansion_u_per_K);
  if (const Status status = file.finish(kKeys); !status.ok()) return status.error();
  if (!has_value(c.expansion_u_per_K)) c.expansion_u_per_K = 0.1 * c.expansion_per_K;
  c.block.slope_rad = rad_from_deg(slope_deg);
  c.block.slope_U_rad = rad_from_deg(slope_U_deg) * (2.0 / coverage);
  c.block.jaw_distance_U_mm *= 2.0 / coverage;
  return c;
}

Thermal expansion_of(const ReferenceCertificate& certificate, double temperature_c) {
  constexpr double kThermometer_u_K = 1.0;
  ThermalSettings settings;
  settings.given = has_value(certificate.expansion_per_K);
  settings.reference_c.value = certificate.temperature_c;
  settings.cte_per_K.value = certificate.expansion_per_K;
  settings.u_cte_per_K.value = certificate.expansion_u_per_K;
  settings.u_temperature_K.value = kThermometer_u_K;
  settings.unknown_low_c.value = 0.0;
  settings.unknown_high_c.value = 40.0;
  return thermal_of(settings, temperature_c);
}

CalibrationCheck check_block(const ReferenceBlock& certified, const BlockResult& measured, const CheckLimits& limits,
                             const Thermal& expansion) {
  CalibrationCheck check;
  check.kind = CalibrationKind::reference_block;
  const Item* slope = find_item(measured.items.begin(), measured.items.end(), ItemId::seat_slope);
  const Item* jaw = find_item(measured.items.begin(), measured.items.end(), ItemId::jaw_distance);
  if (slope != nullptr) {
    check.slope_rad = rad_from_deg(slope->value);
    check.slope_U_rad = rad_from_deg(slope->U);
  }
  if (jaw != nullptr) {
    Item distance = *jaw;
    undo_reference(distance);
    state_at_reference(expansion, distance.value, distance);
    check.jaw_distance_mm = distance.value;
    check.jaw_distance_U_mm = distance.U;
  }
  const std::array<Deviation, 2> deviations = {
      Deviation{"slope", "deg", deg_from_rad(check.slope_rad - certified.slope_rad),
                deg_from_rad(allowed_of(check.slope_U_rad, certified.slope_U_rad, limits.slope_rad))},
      Deviation{"jaw distance", "mm", check.jaw_distance_mm - certified.jaw_distance_mm,
                allowed_of(check.jaw_distance_U_mm, certified.jaw_distance_U_mm, limits.jaw_distance_mm)}};
  check.passed = true;
  for (const Deviation& d : deviations) {
    if (std::abs(d.off) <= d.allowed) continue;
    check.passed = false;
    FixedString<80> sentence;
    if (!has_value(d.off)) {
      sentence.printf("%s%s was not measured", check.note.empty() ? "" : ", ", d.what);
    } else if (!has_value(d.allowed)) {
      sentence.printf("%sthe uncertainty of the %s is not known", check.note.empty() ? "" : ", ", d.what);
    } else {
      sentence.printf("%s%s is %+.4f %s off, allowed are %.4f", check.note.empty() ? "" : ", ", d.what, d.off, d.unit,
                      d.allowed);
    }
    check.note.append(sentence.view());
  }
  return check;
}

CalibrationCheck check_ball(const MonitorBall& certified, const Vec3& centre_base_mm) {
  CalibrationCheck check;
  check.kind = CalibrationKind::monitor_ball;
  check.off_mm = centre_base_mm - certified.p_base;
  const double off_mm = check.off_mm.norm();
  check.passed = off_mm <= certified.limit_mm;  // false for NaN
  if (!check.passed)
    check.note.printf("the ball is %.3f mm from its place, allowed are %.3f mm%s", off_mm, certified.limit_mm,
                      off_mm > kNoDrift_mm ? ": no drift; wrong pose given, ball moved, or wrong hand-eye" : "");
  else if (off_mm > kDriftShare * certified.limit_mm)
    check.note.printf("the ball is %.3f mm from its place, nearly the allowed %.3f mm: look at the trend", off_mm,
                      certified.limit_mm);
  return check;
}

}  // namespace slabd::calib
