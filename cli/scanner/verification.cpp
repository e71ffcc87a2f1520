// SPDX-License-Identifier: Apache-2.0
#include "cli/scanner/verification.h"

#include <fmt/core.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <span>

#include "config/config.h"
#include "daemon/measure.h"
#include "report/json.h"

namespace slabd::cli {
namespace {

/// Largest value; NaN means not measured.
template <typename List, typename Value>
double worst(const List& list, Value value) {
  double most = kNoValue;
  for (const auto& item : list) most = std::fmax(most, value(item));
  return most;
}

/// Number of items that are apart from all counted ones before them.
template <typename List, typename Apart>
std::size_t places(const List& list, Apart apart) {
  std::vector<const typename List::value_type*> counted;
  for (const auto& item : list)
    if (std::all_of(counted.begin(), counted.end(), [&](const auto* other) { return apart(item, *other); }))
      counted.push_back(&item);
  return counted.size();
}

void write_plate(report::Json& json, const VerifiedPlate& p) {
  json.begin_object().field("file", p.file).field("points", p.figures.points).field("rejected", p.figures.rejected);
  json.field("temperature_c", p.temperature_c);
  json.field("length_mm", p.figures.length_mm).field("RF_mm", p.figures.RF_mm).field("rms_mm", p.figures.rms_mm);
  json.field("form_half_mm", p.figures.form_half_mm).field("noise_sigma_mm", p.figures.noise.sigma_mm);
  json.field("noise_correlation_mm", p.figures.noise.correlation_mm).field("pitch_mm", p.figures.noise.pitch_mm);
  json.end_object();
}

void write_ball(report::Json& json, const VerifiedBall& b) {
  json.begin_object().field("file", b.file).field("points", b.figures.points).field("rejected", b.figures.rejected);
  json.field("temperature_c", b.temperature_c);
  json.field("centre_mm", b.figures.centre_mm).field("diameter_mm", 2.0 * b.figures.radius_mm);
  json.field("PF_mm", b.figures.PF_mm).field("PS_mm", b.figures.PS_mm).field("rms_mm", b.figures.rms_mm).end_object();
}

}  // namespace

std::size_t plate_places(const Verification& v) {
  return places(v.plates, [](const VerifiedPlate& a, const VerifiedPlate& b) {
    return (a.figures.centre_mm - b.figures.centre_mm).norm() >= kPlaceApart_mm ||
           angle_between_rad(a.figures.normal, b.figures.normal) >= kPlaceApart_rad;
  });
}

std::size_t ball_places(const Verification& v) {
  return places(v.balls, [](const VerifiedBall& a, const VerifiedBall& b) {
    return (a.figures.centre_mm - b.figures.centre_mm).norm() >= kPlaceApart_mm;
  });
}

namespace {

/// Temperatures that the scans declare.
std::vector<double> temperatures_in(const Verification& v) {
  std::vector<double> all;
  const auto add = [&all](const auto& list) {
    for (const auto& one : list)
      if (has_value(one.temperature_c)) all.push_back(one.temperature_c);
  };
  add(v.plates);
  add(v.balls);
  return all;
}

}  // namespace

double temperature_of(const Verification& v) {
  if (has_value(v.temperature_c)) return v.temperature_c;
  const std::vector<double> all = temperatures_in(v);
  double sum = 0.0;
  for (const double temperature_c : all) sum += temperature_c;
  return all.empty() ? kNoValue : sum / static_cast<double>(all.size());
}

double temperature_span_K(const Verification& v) {
  const std::vector<double> all = temperatures_in(v);
  if (all.empty()) return 0.0;
  const auto [low, high] = std::minmax_element(all.begin(), all.end());
  return *high - *low;
}

ScannerNumbers numbers_of(const Verification& v) {
  ScannerNumbers n;
  n.scanner.assign(v.scanner);
  n.plates = static_cast<std::uint16_t>(plate_places(v));
  n.balls = static_cast<std::uint16_t>(ball_places(v));
  n.PF_mm = worst(v.balls, [](const VerifiedBall& b) { return b.figures.PF_mm; });
  n.PS_mm = worst(v.balls, [](const VerifiedBall& b) { return std::abs(b.figures.PS_mm); });
  n.RF_mm = worst(v.plates, [](const VerifiedPlate& p) { return p.figures.RF_mm; });
  n.form_half_mm = worst(v.plates, [](const VerifiedPlate& p) { return p.figures.form_half_mm; });
  // The same form error over a smaller length gives a larger tilt.
  n.form_length_mm = -worst(v.plates, [](const VerifiedPlate& p) { return -p.figures.length_mm; });
  n.noise_sigma_mm = worst(v.plates, [](const VerifiedPlate& p) { return p.figures.noise.sigma_mm; });
  n.noise_correlation_mm = worst(v.plates, [](const VerifiedPlate& p) { return p.figures.noise.correlation_mm; });
  n.pitch_mm = worst(v.plates, [](const VerifiedPlate& p) { return p.figures.noise.pitch_mm; });
  n.within_limits = limits_broken(v).empty();
  n.temperature_c = temperature_of(v);
  return n;
}

std::vector<std::string> limits_broken(const Verification& v) {
  std::vector<std::string> broken;
  const auto judge = [&](const char* figure, double value, double limit) {
    if (std::isnan(limit) || value <= limit) return;  // NaN is not within its limit
    broken.push_back(std::isnan(value) ? fmt::format("{} was not measured (allowed {:.4f} mm)", figure, limit)
                                       : fmt::format("{} {:.4f} mm (allowed {:.4f} mm)", figure, value, limit));
  };
  judge("PF", worst(v.balls, [](const VerifiedBall& b) { return b.figures.PF_mm; }), v.limits.PF_mm);
  judge("|PS|", worst(v.balls, [](const VerifiedBall& b) { return std::abs(b.figures.PS_mm); }), v.limits.PS_mm);
  judge("RF", worst(v.plates, [](const VerifiedPlate& p) { return p.figures.RF_mm; }), v.limits.RF_mm);
  return broken;
}

std::string budget_lines(const ScannerNumbers& n) {
  if (n.plates == 0) return "";
  return fmt::format(
      "scanner_form_mm = {{ value = {:.4f}, confirmed = true }}\n"
      "scanner_form_length_mm = {{ value = {:.0f}, confirmed = true }}\n",
      n.form_half_mm, n.form_length_mm);
}

std::string verification_json(const Verification& v, std::int64_t utime_us, std::string_view id, bool in_force) {
  const ScannerNumbers n = numbers_of(v);
  report::Json json("slabd.scanner_verification/1");
  json.field("scanner", n.scanner);
  report::write_time(json, "utc", utime_us);
  json.field("software", daemon::software_version()).field("diameter_mm", v.diameter_mm).field("id", id);
  json.field("in_force", in_force).field("refusal", refusal_of(n)).field("PF_mm", n.PF_mm).field("PS_abs_mm", n.PS_mm);
  json.field("RF_mm", n.RF_mm).field("form_half_mm", n.form_half_mm).field("form_length_mm", n.form_length_mm);
  json.field("noise_sigma_mm", n.noise_sigma_mm).field("noise_correlation_mm", n.noise_correlation_mm);
  json.field("pitch_mm", n.pitch_mm).field("within_limits", n.within_limits).field("temperature_c", n.temperature_c);
  json.field("limit_PF_mm", v.limits.PF_mm);
  json.field("limit_PS_mm", v.limits.PS_mm).field("limit_RF_mm", v.limits.RF_mm).field("uncertainty", budget_lines(n));
  json.key("plates").begin_array();
  for (const VerifiedPlate& plate : v.plates) write_plate(json, plate);
  json.end_array();
  json.key("balls").begin_array();
  for (const VerifiedBall& ball : v.balls) write_ball(json, ball);
  return json.text();
}

}  // namespace slabd::cli
