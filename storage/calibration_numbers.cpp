// SPDX-License-Identifier: Apache-2.0
//
// An id identifies the numbers of a calibration. It is recomputed from the numbers read, so that numbers damaged or
// edited on the disk are not used under the id of checked and applied ones.
#include "storage/calibrations.h"

#include <sha256.h>

#include <array>
#include <cmath>

namespace slabd::storage {
namespace {

constexpr std::array<const char*, kCalibrationKinds> kPrefix = {"he", "st", "rb", "mb", "sc", "ti"};
constexpr std::size_t kIdDigits = 12;
constexpr double kArmMax_mm = 2000.0;
constexpr double kApartMax_mm = 50'000.0;
constexpr std::uint16_t kTargetsMin = 4;  // calib::kTieTargetsMin
constexpr double kUnitTolerance = 1e-6;

/// Converts numbers to text with full precision; minus zero becomes zero, as SQLite stores it, and all NaN are equal.
class Canonical {
 public:
  void operator()(double x) {
    FixedString<40> word;
    word.printf(" %.17g", std::isnan(x) ? kNoValue : x + 0.0);
    text_ += word.view();
  }
  void operator()(std::int64_t x) { text_ += " " + std::to_string(x); }
  void operator()(const Vec3& v) {
    for (const double x : {v.x(), v.y(), v.z()}) (*this)(x);
  }
  void operator()(const Pose& pose) {
    for (const double x : pose.to_array()) (*this)(x);
  }
  void operator()(std::string_view word) { text_ += " " + std::string(word); }
  [[nodiscard]] const std::string& text() const { return text_; }

 private:
  std::string text_;
};

struct WriteNumbers {
  Canonical& out;
  void operator()(const HandEyeNumbers& n) const {
    out(n.T_flange_scanner);
    out(n.sigma_mm);
    out(n.sigma_rad);
  }
  void operator()(const StationTable& n) const {
    out(std::int64_t{n.slab_type});
    for (const StationCorrection& s : n.station) {
      out(std::int64_t{s.visits});
      if (s.visits == 0) continue;
      out(s.T_base_reported);
      out(s.T_base_flange);
      for (const double x : {s.sigma_mm, s.sigma_rad, s.spread_mm}) out(x);
    }
  }
  void operator()(const ReferenceBlock& n) const {
    for (const double x : {n.slope_rad, n.slope_U_rad, n.jaw_distance_mm, n.jaw_distance_U_mm}) out(x);
  }
  void operator()(const MonitorBall& n) const {
    out(n.p_base);
    for (const double x : {n.radius_mm, n.limit_mm}) out(x);
  }
  void operator()(const ScannerNumbers& n) const {
    out(n.scanner.view());
    for (const double x : {n.PF_mm, n.PS_mm, n.RF_mm, n.form_half_mm, n.form_length_mm, n.noise_sigma_mm,
                           n.noise_correlation_mm, n.pitch_mm})
      out(x);
    for (const int x : {int{n.plates}, int{n.balls}, n.within_limits ? 1 : 0}) out(std::int64_t{x});
    // An acceptance without a temperature keeps the id of its numbers alone.
    if (!std::isnan(n.temperature_c)) out(n.temperature_c);
  }
  void operator()(const TieNumbers& n) const {
    out(n.robot.view());
    out(n.T_base_robot);
    out(n.centre_mm);
    for (int row = 0; row < 6; ++row)
      for (int column = 0; column < 6; ++column) out(n.covariance(row, column));
    out(std::int64_t{n.targets});
    out(n.rms_mm);
  }
};

bool is_rigid(const Pose& pose) {
  return pose.all_finite() && std::abs(pose.rotation.norm() - 1.0) < kUnitTolerance;
}
bool positive(double x) {
  return std::isfinite(x) && x > 0.0;
}

/// Reason why these numbers cannot be used; empty if they can.
struct FindNonsense {
  std::string operator()(const HandEyeNumbers& n) const {
    if (!is_rigid(n.T_flange_scanner)) return "T_flange_scanner is not a rigid transform of finite numbers";
    if (n.T_flange_scanner.translation_mm.norm() > kArmMax_mm) return "the scanner sits more than 2 m from the flange";
    if (!positive(n.sigma_mm) || !positive(n.sigma_rad)) return "its uncertainty is not known";
    return {};
  }
  std::string operator()(const StationTable& n) const {
    int mastered = 0;
    for (std::size_t i = 0; i < n.station.size(); ++i) {
      const StationCorrection& s = n.station[i];
      if (s.visits == 0) continue;
      ++mastered;
      if (!is_rigid(s.T_base_reported) || !is_rigid(s.T_base_flange) || !positive(s.sigma_mm) || !positive(s.sigma_rad))
        return "station " + std::to_string(i + 1) + " has numbers that make no sense";
    }
    return mastered == 0 ? "it holds no station" : "";
  }
  std::string operator()(const ReferenceBlock& n) const {
    const bool good = std::isfinite(n.slope_rad) && positive(n.jaw_distance_mm) && positive(n.slope_U_rad) &&
                      positive(n.jaw_distance_U_mm);
    return good ? "" : "slope, jaw distance and their uncertainties must be positive numbers";
  }
  std::string operator()(const MonitorBall& n) const {
    const bool good = n.p_base.allFinite() && positive(n.radius_mm) && positive(n.limit_mm);
    return good ? "" : "place, radius and limit must be finite, radius and limit positive";
  }
  std::string operator()(const ScannerNumbers& n) const {
    for (const double x : {n.PF_mm, n.PS_mm, n.RF_mm, n.form_half_mm, n.form_length_mm, n.noise_sigma_mm,
                           n.noise_correlation_mm, n.pitch_mm})
      if (std::isinf(x) || x < 0.0) return "its figures must be finite and not negative";
    if (n.temperature_c < kScannerTemperatureMin_c || n.temperature_c > kScannerTemperatureMax_c)
      return "its temperature must be -40..125 deg C";
    return n.plates == 0 && n.balls == 0 ? "neither a plate nor a ball was measured" : "";
  }
  std::string operator()(const TieNumbers& n) const {
    if (n.robot.empty()) return "it names no robot";
    if (!is_rigid(n.T_base_robot)) return "T_base_robot is not a rigid transform of finite numbers";
    if (n.T_base_robot.translation_mm.norm() > kApartMax_mm) return "the two robots are more than 50 m apart";
    if (!n.centre_mm.allFinite()) return "the middle of its targets is not known";
    // Variances are positive, and a covariance is at most the product of two standard deviations.
    for (int row = 0; row < 6; ++row) {
      if (!positive(n.covariance(row, row))) return "its covariance is not known";
      for (int column = 0; column < 6; ++column) {
        const double both = n.covariance(row, column);
        if (!std::isfinite(both) || both != n.covariance(column, row) ||
            both * both > n.covariance(row, row) * n.covariance(column, column) * (1.0 + kUnitTolerance))
          return "its covariance is not that of six errors";
      }
    }
    return n.targets < kTargetsMin ? "it rests on fewer than 4 balls" : "";
  }
};

}  // namespace

std::uint16_t CalibrationRecord::slab_type() const {
  const auto* table = std::get_if<StationTable>(&numbers);
  return table == nullptr ? std::uint16_t{0} : table->slab_type;
}

std::string calibration_id(const CalibrationRecord& record) {
  Canonical text;
  text(name(record.kind()));
  text(record.parent_id);
  // Calibrations of the first scanner keep the ids that they have on a line with one.
  if (record.scanner != "1") text(record.scanner);
  std::visit(WriteNumbers{text}, record.numbers);
  std::array<char, SHA256_DIGEST_STRING_LENGTH> hex{};
  SHA256Data(reinterpret_cast<const std::uint8_t*>(text.text().data()), text.text().size(), hex.data());
  return std::string(kPrefix.at(record.numbers.index())) + "-" + std::string(hex.data(), kIdDigits);
}

std::string_view id_prefix(CalibrationKind kind) {
  return kPrefix.at(static_cast<std::size_t>(kind));
}

std::string implausible_value_in(const CalibrationRecord& record) {
  return std::visit(FindNonsense{}, record.numbers);
}

bool numbers_give_id(const CalibrationRecord& record) {
  // Equal numbers with another certificate or expiry have an id with an appended number.
  const std::string numbers = calibration_id(record);
  return record.id == numbers || record.id.starts_with(numbers + ".");
}

}  // namespace slabd::storage
