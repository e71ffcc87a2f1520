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

/// Station corrections: a robot comes back to a place far better than it knows where that place is. At every taught
/// station something of certified coordinates is measured several times, and
///
///   C_s = argmin sum |C_s A X q - P|^2
///
/// takes up what the reported pose A and the hand-eye calibration X are wrong by there. In production a scan is spliced
/// by C_s A X as long as the robot reports about the pose it reported then. What is left is repeatability: with M
/// visits sigma sqrt(1 + 1 / M). Pure computing, on maintenance only.
///
/// What was seen on a visit was seen from where the scanner sat then. The same visits may be solved with a later
/// hand-eye calibration only if the scanner has not moved on the flange: both calibrations then estimate the same X and
/// differ by no more than they are uncertain. If it has moved, C_s takes up the move as if the robot had erred by it,
/// with the opposite sign in the two rows, and nothing else in a solution shows that.
namespace slabd::calib {

/// What is certified at one station. A seat is its reference point and two unit directions: its normal, and along the
/// seat from the inner to the outer casing. Each direction counts as a point kSeatLeverMm from the reference point.
struct MasterStation {
  int station = 0;              ///< 1..18
  bool is_seat = false;         ///< else reference balls
  std::vector<Vec3> points_mm;  ///< seat: reference point, tips of normal and direction; balls: their centres
};
inline constexpr double kSeatLeverMm = 100.0;
inline constexpr std::size_t kStationBallsMin = 3;
inline constexpr std::size_t kStationBallsMax = 8;

struct MasterCertificate {
  /// slab: the coordinates are those of the slab's own frame, and where it lay is found from all stations together.
  /// base: measured in the robot's base frame (a laser tracker tied to the robot's foot).
  enum class Frame : std::uint8_t { slab, base } frame = Frame::slab;
  std::string id;
  std::string date;    ///< YYYY-MM-DD
  std::string issuer;  ///< may be empty
  std::uint16_t slab_type = 0;
  double sigma_mm = kNoValue;  ///< of a coordinate, k = 1; goes into what the corrections claim
  double temperature_c = 20.0;
  std::vector<MasterStation> stations;  ///< ascending
};

/// Reads the text form, one `key = value` a line, `#` comments:
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
///     ball = 2  -1890.1 700.2 31.0   # three to eight a station, told apart by their order
///
/// config: the text names `file_name`:line, what is wrong and what is allowed. Pure: `text` is the content.
[[nodiscard]] Result<MasterCertificate> parse_master_certificate(std::string_view text, std::string_view file_name);
/// The text form; parse_master_certificate() reads the same numbers back.
[[nodiscard]] std::string master_certificate_text(const MasterCertificate& certificate);
/// A seat as the certificate holds it; `normal` and `along` are made unit and perpendicular.
[[nodiscard]] MasterStation master_seat(int station, const Vec3& p_mm, const Vec3& normal, const Vec3& along);

/// What was seen of it on one visit.
struct StationVisit {
  int station = 0;
  std::string round;            ///< which round it belongs to, such as "slab 12": all stations of one round together
  Pose T_base_flange;           ///< as reported
  std::vector<Vec3> points_mm;  ///< scanner frame, in the certificate's order
  /// The hand-eye calibration in force on the visit: its id, empty if not known, and its numbers where it is another
  /// one than the visits are solved with (not part of the text form).
  std::string hand_eye_id = {};
  std::optional<HandEyeNumbers> hand_eye = {};
  /// Of the seat against the slab's top beside it, where the inspection measured that; not part of the text form.
  double local_slope_rad = kNoValue;
};
/// A seat as the normal inspection measured it; nothing when seat or casings were not measured.
[[nodiscard]] std::optional<StationVisit> seat_visit(const BlockResult& block, const Pose& T_base_flange,
                                                     std::string_view round);

/// Visits as text, one a line, every digit kept: enough to solve again when the hand-eye calibration changes.
///
///     # slabd station visits
///     taken_with = "slab 12" he-3f2a91c07b5e    # optional: the hand-eye calibration in force on that round
///     visit = 3 "slab 12"  x y z qw qx qy qz  x y z  x y z  x y z
[[nodiscard]] std::string visits_text(std::span<const StationVisit> visits);
[[nodiscard]] Result<std::vector<StationVisit>> parse_visits(std::string_view text, std::string_view file_name);

struct StationSettings {
  std::size_t visits_min = 5;
  double spread_max_mm = 0.05;  ///< standard deviation of a station's visits, per axis
  double gate_mm = 1.0;         ///< reported pose of any visit from their mean
  double gate_rad = rad_from_deg(0.05);
  double shift_max_mm = 5.0;  ///< more than a robot's absolute error: a wrong certificate or a wrong station
  double turn_max_rad = rad_from_deg(0.3);  ///< the same of its rotation
  /// A certified slope against the one measured on the block itself may stand out from the other stations by this.
  double slope_max_rad = rad_from_deg(0.06);
  double shape_max_mm = 0.10;  ///< what the certified points differ from the measured ones after the correction
};

/// Why a set of visits gives no corrections. The words of `name` are stable.
enum class StationRefusal : std::uint8_t {
  too_few_visits,
  unknown_station,  ///< a visit to a station the certificate does not have
  wrong_points,     ///< a visit saw another number of points than are certified
  outside_gate,     ///< the robot did not go to the same place every time
  slab_moved,       ///< one round is off as a whole
  spread,           ///< visits scatter more than a robot that repeats
  shape,            ///< what was measured is not what was certified
  shift,            ///< the correction is larger than a robot's error
  placement,        ///< too few stations to find where the slab lies
  copies,           ///< one visit given several times: the same round twice, or visits without any scatter
  turn,             ///< the correction turns the seat further than a robot's error
  slope,            ///< a certified slope that the block itself contradicts
  scanner_moved,    ///< the scanner sits otherwise on the flange than on the visits
};
[[nodiscard]] std::string_view name(StationRefusal refusal);

struct StationReason {
  StationRefusal code{};
  int station = 0;   ///< 0: of all
  std::string text;  ///< what is wrong, with figure and limit
  std::string cure;
};

struct StationSolution {
  int station = 0;
  StationCorrection numbers;     ///< sigma and visits included
  Vec3 shift_mm = Vec3::Zero();  ///< how far the correction moves the station's reference point, base axes
  double turn_rad = 0.0;         ///< ... and turns it
  double spread_rad = kNoValue;
  double shape_mm = kNoValue;  ///< rms of certified against corrected points, means of the visits
  std::string worst_round;     ///< the visit furthest from the others, and how far
  double worst_mm = kNoValue;
};

struct StationsSolution {
  bool ok = false;  ///< false: refused, `reasons` say why; the figures are there as far as they go
  std::vector<StationReason> reasons;
  std::vector<StationSolution> stations;  ///< ascending
  StationTable table;
  Pose T_base_certificate;            ///< identity for frame base
  double pooled_sigma_mm = kNoValue;  ///< repeatability over all stations, per axis
  double pooled_sigma_rad = kNoValue;
  int degrees_of_freedom = 0;
  /// How far the hand-eye calibrations of the visits and the one they are solved with put a seat apart, at most; 0: all
  /// visits were taken with this one. Whether the scanner moved by it or it was estimated otherwise, nobody can tell,
  /// so it is in the sigmas of the table.
  double mount_mm = 0.0;
  double mount_rad = 0.0;
  double before_rms_mm = kNoValue;  ///< 3-D, reference points of all visits against the certificate: hand-eye alone,
                                    ///< after one rigid fit of the slab
  double after_rms_mm = kNoValue;   ///< ... with the corrections
};

/// Solves all stations of the certificate. Refusals are part of the answer. Error (config) only for what is no set of
/// visits at all: none, or numbers that are not finite.
[[nodiscard]] Result<StationsSolution> solve_stations(const MasterCertificate& certificate,
                                                      std::span<const StationVisit> visits,
                                                      const HandEyeNumbers& hand_eye, const StationSettings& settings);

}  // namespace slabd::calib
