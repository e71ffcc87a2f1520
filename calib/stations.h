// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "base/base.h"
#include "base/calibration.h"

/// Station corrections. A robot returns to a place far more accurately than it reports the place. At every taught
/// station an object with certified coordinates is measured several times, and
///
///   C_s = argmin sum |C_s A X q - P|^2
///
/// corrects the errors of the reported pose A and of the hand-eye calibration X there. In production a scan is spliced
/// by C_s A X while the reported pose is close to that one. The remaining error is repeatability: with M visits sigma
/// sqrt(1 + 1 / M). Pure computation, on maintenance only.
///
/// Measurements of a visit depend on the scanner's mount at that time. The same visits may be solved with a later
/// hand-eye calibration only if the scanner has not moved on the flange. Then both calibrations estimate the same X and
/// differ by no more than their uncertainty. If the scanner has moved, C_s treats the move as a robot error, with
/// opposite signs in the two rows. No other figure of a solution reveals that.
namespace slabd::calib {

/// Certified values of one station. A seat has a reference point and two unit directions: its normal, and the direction
/// along the seat from the inner to the outer casing. Each direction counts as a point kSeatLever_mm from the reference
/// point.
struct MasterStation {
  int station = 0;              ///< 1..18
  bool is_seat = false;         ///< otherwise reference balls
  std::vector<Vec3> points_mm;  ///< seat: reference point, tips of normal and direction; balls: their centres
};
inline constexpr double kSeatLever_mm = 100.0;
inline constexpr std::size_t kStationBallsMin = 3;
inline constexpr std::size_t kStationBallsMax = 8;

struct MasterCertificate {
  /// slab: the coordinates are in the slab's own frame, and its place is estimated from all stations together. base:
  /// measured in the robot's base frame (by a laser tracker referenced to the robot's foot).
  enum class Frame : std::uint8_t { slab, base } frame = Frame::slab;
  std::string id;
  std::string date;    ///< YYYY-MM-DD
  std::string issuer;  ///< may be empty
  std::uint16_t slab_type = 0;
  double sigma_mm = kNoValue;  ///< of a coordinate, k = 1; included in the uncertainty of the corrections
  double temperature_c = 20.0;
  std::vector<MasterStation> stations;  ///< ascending
};

/// Reads the text form, one `key = value` per line, `#` comments:
///
///     id = master-slab-01
///     date = 2026-03-14
///     issuer = "DKD-K-00000"         # optional
///     slab_type = 5600
///     frame = slab                   # or base
///     U_mm = 0.010                   # expanded uncertainty of a coordinate
///     coverage_factor = 2            # optional, 2 if absent
///     temperature_c = 20.0           # optional, 20 if absent
///     seat = 1  -2520.012 758.004 30.011  0.000000 -0.024992 0.999688  0.000000 0.999688 0.024992
/// ball = 2  -1890.1 700.2 31.0   # three to eight a station, identified by their order
///
/// config: the text contains `file_name`:line, the fault and the allowed values. Pure: `text` is the content.
[[nodiscard]] Result<MasterCertificate> parse_master_certificate(std::string_view text, std::string_view file_name);
/// Text form; parse_master_certificate() reads the same numbers back.
[[nodiscard]] std::string master_certificate_text(const MasterCertificate& certificate);
/// Creates a seat as in the certificate; `normal` and `along` are made unit vectors and perpendicular.
[[nodiscard]] MasterStation master_seat(int station, const Vec3& p_mm, const Vec3& normal, const Vec3& along);

/// Measurements of one visit to a station.
struct StationVisit {
  int station = 0;
  std::string round;            ///< name of its round, such as "slab 12": all stations of one round have the same
  Pose T_base_flange;           ///< as reported by the robot
  std::vector<Vec3> points_mm;  ///< scanner frame, in the order of the certificate
  /// Hand-eye calibration in force at the visit: its id, empty if unknown. Its numbers are set if they differ from the
  /// calibration used to solve (not part of the text form).
  std::string hand_eye_id = {};
  std::optional<HandEyeNumbers> hand_eye = {};
  /// Slope of the seat against the slab's top next to it, if the inspection measured it; not part of the text form.
  double local_slope_rad = kNoValue;
};
/// Visit from the normal inspection of a seat; nullopt if seat or casings were not measured.
[[nodiscard]] std::optional<StationVisit> seat_visit(const BlockResult& block, const Pose& T_base_flange,
                                                     std::string_view round);

/// Visits as text, one per line, with all digits: sufficient to solve again when the hand-eye calibration changes.
///
///     # slabd station visits
///     taken_with = "slab 12" he-3f2a91c07b5e    # optional: the hand-eye calibration in force on that round
///     visit = 3 "slab 12"  x y z qw qx qy qz  x y z  x y z  x y z
[[nodiscard]] std::string visits_text(std::span<const StationVisit> visits);
[[nodiscard]] Result<std::vector<StationVisit>> parse_visits(std::string_view text, std::string_view file_name);

struct StationSettings {
  std::size_t visits_min = 5;
  double spread_max_mm = 0.05;  ///< standard deviation of a station's visits, per axis
  double gate_mm = 1.0;         ///< largest distance of the reported pose of a visit from the mean
  double gate_rad = rad_from_deg(0.05);
  double shift_max_mm = 5.0;                ///< larger than a robot's absolute error: a wrong certificate or station
  double turn_max_rad = rad_from_deg(0.3);  ///< the same for its rotation
  /// Largest deviation of (certified minus measured slope) at a station from the other stations.
  double slope_max_rad = rad_from_deg(0.06);
  double shape_max_mm = 0.10;  ///< largest difference of certified and measured points after the correction
  /// Place of a certificate of frame slab, if it is known (placement_of()); nullopt: from the visits.
  std::optional<Pose> T_base_certificate{};
};

/// Reason why visits give no corrections. The words returned by `name` are stable.
enum class StationRefusal : std::uint8_t {
  too_few_visits,
  unknown_station,  ///< the certificate does not contain the station of a visit
  wrong_points,     ///< a visit has another number of points than certified
  outside_gate,     ///< the robot did not return to the same pose every time
  slab_moved,       ///< all stations of one round are displaced together
  spread,           ///< visits scatter more than a robot's repeatability
  shape,            ///< the measured points do not have the certified shape
  shift,            ///< the correction is larger than a robot's error
  placement,        ///< too few stations to determine the slab's place
  copies,           ///< one visit given several times: the same round twice, or visits without any scatter
  turn,             ///< the correction rotates the seat more than a robot's error
  slope,            ///< a certified slope contradicts the slope measured on the block
  scanner_moved,    ///< the scanner's mount on the flange differs from that at the visits
};
[[nodiscard]] std::string_view name(StationRefusal refusal);

struct StationReason {
  StationRefusal code{};
  int station = 0;   ///< 0: all stations
  std::string text;  ///< description with figure and limit
  std::string cure;
};

struct StationSolution {
  int station = 0;
  StationCorrection numbers;     ///< including sigma and visits
  Vec3 shift_mm = Vec3::Zero();  ///< shift of the station's reference point by the correction, base axes
  double turn_rad = 0.0;         ///< rotation by the correction
  double spread_rad = kNoValue;
  double shape_mm = kNoValue;  ///< rms of certified against corrected points, means of the visits
  std::string worst_round;     ///< the visit farthest from the others, and its distance
  double worst_mm = kNoValue;
};

struct StationsSolution {
  bool ok = false;  ///< false: rejected, with `reasons`; figures are set as far as they were computed
  std::vector<StationReason> reasons;
  std::vector<StationSolution> stations;  ///< ascending
  StationTable table;
  Pose T_base_certificate;            ///< identity for frame base
  double pooled_sigma_mm = kNoValue;  ///< repeatability over all stations, per axis
  double pooled_sigma_rad = kNoValue;
  int degrees_of_freedom = 0;
  /// Largest distance of a seat between the hand-eye calibrations of the visits and the one used to solve; 0 if they
  /// are the same. A move of the scanner and a new estimate of X cannot be distinguished, so it is included in the
  /// table's sigmas.
  double mount_mm = 0.0;
  double mount_rad = 0.0;
  /// 3-D, reference points of all visits against the certificate: hand-eye only, after one rigid fit of the slab
  double before_rms_mm = kNoValue;
  double after_rms_mm = kNoValue;  ///< with the corrections
};

/// Place of a certificate of frame slab: one rigid fit of all visits, each seen from its own pose of the scanner
/// (`T_base_scanner`, [visit]). For the stations of two robots, of which those of one may be on a line. nullopt:
/// another frame, unknown stations or points, or stations that do not determine the place.
[[nodiscard]] std::optional<Pose> placement_of(const MasterCertificate& certificate,
                                               std::span<const StationVisit> visits,
                                               std::span<const Pose> T_base_scanner);

/// Solves all stations of the certificate. Refusals are part of the answer. Error (config) only for invalid input: no
/// visits, or numbers that are not finite.
[[nodiscard]] Result<StationsSolution> solve_stations(const MasterCertificate& certificate,
                                                      std::span<const StationVisit> visits,
                                                      const HandEyeNumbers& hand_eye, const StationSettings& settings);

}  // namespace slabd::calib
