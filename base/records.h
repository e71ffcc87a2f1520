// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <string_view>

#include "base/fixed.h"
#include "base/gauge.h"
#include "base/items.h"
#include "base/limits.h"
#include "base/pose.h"
#include "base/result.h"

/// Results of one block and one slab: the values that pass between algo, storage, the station and reports.
namespace slabd {

// Emulated parts of the line, stored as bits in a slab, an attempt and a record. 0: all parts were real, as far as they
// declare. A result with any bit set is not a verdict on concrete, whatever its value.

inline constexpr unsigned kEmulatedLine = 1U << 0U;    ///< [line] simulation = true
inline constexpr unsigned kEmulatedRobot = 1U << 1U;   ///< the poses are declared as emulated (flags, bit 4)
inline constexpr unsigned kCommandedPoses = 1U << 2U;  ///< the poses are not measured (flags, bit 0 is missing)
inline constexpr unsigned kEmulatedScan = 1U << 3U;    ///< the scan is declared as emulated (comment or header)

/// Names of the bits in JSON, metrics and exports, in the order of the bits.
inline constexpr std::array<std::string_view, 4> kEmulationNames = {"line", "robot", "poses", "scan"};

using SlabId = FixedString<limits::kSlabIdBytes>;
using PathText = FixedString<limits::kPathBytes>;

enum class RegistrationStatus : std::uint8_t { none, converged, iteration_limit, degenerate, rejected };
[[nodiscard]] std::string_view name(RegistrationStatus status);

/// Table 4 of the paper: distances of the associated points to the model.
struct DeviationStats {
  std::uint64_t count = 0;
  double mean_mm = kNoValue;
  double std_mm = kNoValue;
  std::array<double, 6> within_sigma{};  ///< share of points within 1..6 std of zero deviation
};

struct RegistrationReport {
  RegistrationStatus status = RegistrationStatus::none;
  int iterations = 0;
  double share_associated = 0.0;  ///< share of the sampled points near the model
  double condition = kNoValue;    ///< condition of the normal matrix, lengths scaled to the block
  double noise_mm = kNoValue;     ///< robust standard deviation of the points in the last step
  /// Covariance of the small motion from the registered block to the true one, for white noise of `noise_mm`. Order: x,
  /// y, z in mm, rotation about X, Y, Z in rad; block frame, about the block's origin.
  Mat6 covariance = Mat6::Constant(kNoValue);
  FixedString<64> note;  ///< degenerate: the direction; rejected: the gate
  Pose T_scanner_block;
  DeviationStats deviation;
};

struct ScanCounts {
  std::uint64_t points_read = 0;
  std::uint64_t points_finite = 0;
  std::uint64_t isolated_removed = 0;
  std::uint64_t points_kept = 0;
  /// Rounding step of the coordinates along each axis of the scanner frame (mm). 0 if no step was found, or if this
  /// axis is the scanner's own raster and therefore exact.
  Vec3 step_mm = Vec3::Zero();
  /// Squared ratio of second to first differences between neighbours on the seat. 3 if the points have independent
  /// noise; less if the noise of neighbours is correlated, as after a smoothing filter.
  double lag_ratio = kNoValue;
};

/// Below this ratio the scan was smoothed, or the scanner's own noise is correlated over several points.
inline constexpr double kSmoothedLagRatio = 2.4;

/// Largest usual coordinate step (mm): three decimals, or two of a coarse scanner. Its effect on U is negligible.
inline constexpr double kUsualStep_mm = 0.01;
/// Warning if the coordinates are rounded more coarsely than usual, or if the scan was smoothed; empty otherwise.
[[nodiscard]] FixedString<420> scan_warning(const ScanCounts& scan);

/// Reason why a plane is not `ok`: the first test that failed.
enum class PlaneDoubt : std::uint8_t {
  none,
  not_fitted,      ///< the scan was not processed up to this step
  no_plane,        ///< too few points, or all on a line
  unsettled,       ///< the inlier set did not converge
  second_surface,  ///< a second surface within the threshold
  share,           ///< too few of the points are inliers
  area,            ///< the inliers cover too little of the visible area
  support,         ///< too few inliers, not spread far enough, or too noisy for the tilt
  bends,           ///< the result depends on where the threshold cuts
  rival,           ///< another plane has about as many points
  filled,          ///< a part has no noise: computed by the scanner's program, not measured
};
inline constexpr std::size_t kPlaneDoubts = 11;
[[nodiscard]] std::string_view name(PlaneDoubt doubt);
/// Reason in words, to follow "inner jaw:"; empty for none and not_fitted.
[[nodiscard]] std::string_view reason_of(PlaneDoubt doubt);

/// One fitted plane n.p = d in the block's registered frame (mm).
/// Difference between a plane and its alternative fit.
struct PlaneShift {
  Vec3 normal = Vec3::Zero();  ///< change of the normal, rad
  double height_mm = 0.0;      ///< change of the height at the plane's centroid
};

struct PlaneFit {
  bool ok = false;
  PlaneDoubt doubt = PlaneDoubt::not_fitted;
  Vec3 normal = Vec3::Zero();  ///< unit length; towards the free side
  double offset_mm = kNoValue;
  std::uint64_t points = 0;  ///< number of points passed to the fit
  std::uint64_t inliers = 0;
  double inlier_fraction = 0.0;
  double std_mm = kNoValue;                    ///< orthogonal, of the inliers, n - 3
  int iterations = 0;                          ///< refits until the inlier set was stable
  Vec3 centroid = Vec3::Zero();                ///< centroid of the inliers, where offset and tilt are independent
  double sigma_offset_mm = kNoValue;           ///< standard deviation of the height at the centroid, from white noise
  Mat3 cov_normal = Mat3::Constant(kNoValue);  ///< covariance of `normal` (rad^2, rank 2), from white noise
  /// The plane with a quarter wider threshold; zero unless it depends on that by more than the noise explains.
  PlaneShift bend;
};

/// The largest connected group of flatness cells beyond the defect limit on one side of the seat plane.
struct SurfaceDefect {
  double limit_mm = kNoValue;  ///< distance beyond which a cell counts; NaN if the defect search was not run
  std::uint32_t cells = 0;     ///< size of the largest group; 0 without a defect
  double area_mm2 = 0.0;
  double height_mm = 0.0;  ///< farthest cell of the group, signed: positive protrudes
  double x_mm = 0.0;       ///< centre of the group, along the rail ...
  double s_mm = 0.0;       ///< ... and along the seat
};

struct SeatFeature {
  PlaneFit plane;       ///< plane of the evaluation region (the crop)
  PlaneFit full_plane;  ///< plane of the whole bearing surface, reported in addition
  PlaneShift by_area;   ///< `plane` weighted by area instead of by points; zero unless form error and point density are
                        ///< correlated
  Vec3 normal_datum = Vec3::Zero();  ///< in the datum frame: Z from the slope datum, X from the registration
  std::uint32_t grid_points = 0;     ///< number of flatness cells with enough points
  double std_cells_mm = kNoValue;
  /// Flatness value that the recipe judges (closed or raw): peak to valley to the least-squares plane.
  double flatness_mm = kNoValue;
  double flatness_closed_mm = kNoValue;    ///< surface closed from above: pits narrower than closing_mm are bridged
  double flatness_raw_mm = kNoValue;       ///< cell means as they are, including pits
  double flatness_trimmed_mm = kNoValue;   ///< nine tenths of the cell means nearest to the plane (paper 5.2)
  double flatness_min_zone_mm = kNoValue;  ///< minimum zone of the surface that flatness_mm refers to
  double raw_low_mm = kNoValue;            ///< extremes of single points to the plane
  double raw_high_mm = kNoValue;
  /// Variance of a mean relative to white noise: 1 if neighbouring points have independent errors. It is the larger of
  /// the value measured in this scan and the value from the scanner's acceptance.
  double noise_factor = kNoValue;
  double flatness_noise_mm = kNoValue;  ///< flatness that a perfectly flat seat would have with this noise
  SurfaceDefect defect;
};

/// An area of the block's surface that is displaced or without points: damage, and the larger pores.
enum class FindingKind : std::uint8_t {
  pit,      ///< below the face
  bump,     ///< above it
  crack,    ///< below it or without points, long and narrow
  chip,     ///< below the face and open towards an outer edge of the block
  missing,  ///< without points
};
inline constexpr std::size_t kFindingKinds = 5;
[[nodiscard]] std::string_view name(FindingKind kind);
/// Face of a finding. A broken edge belongs to the face it was broken from.
enum class FindingFace : std::uint8_t { seat, jaw_inner, jaw_outer, shoulder_inner, shoulder_outer };
inline constexpr std::size_t kFindingFaces = 5;
[[nodiscard]] std::string_view name(FindingFace face);

struct SurfaceFinding {
  FindingKind kind = FindingKind::pit;
  FindingFace face = FindingFace::seat;
  double x_mm = 0.0;             ///< centre of the area along the rail, ...
  double s_mm = 0.0;             ///< ... along the bearing plane, rising outward, ...
  double z_mm = 0.0;             ///< ... and height of the face there in the block frame
  double length_mm = 0.0;        ///< extent along the rail
  double width_mm = 0.0;         ///< extent on the face across the rail
  double depth_mm = kNoValue;    ///< largest distance from the face, positive; NaN without points
  double area_mm2 = 0.0;         ///< on the face
  double volume_mm3 = kNoValue;  ///< volume between the face and the points; NaN without points
};

/// Pores of a block: pits up to the recipe's size of a pore (algo/survey/surface_damage.h).
struct PoreSummary {
  std::uint32_t count = 0;  ///< number of pores large enough to be counted
  /// Diameter of the circle of equal area; 0 if there are none, NaN if pores were not searched.
  double largest_mm = kNoValue;
  double deepest_mm = kNoValue;
  double share = kNoValue;  ///< share of the visible area
  PoreLimits limits;        ///< limits of the recipe that judged the block
};
/// True if the deepest pore, or the share of the area, exceeds its limit.
[[nodiscard]] bool is_too_deep(const PoreSummary& pores);
[[nodiscard]] bool is_too_much(const PoreSummary& pores);
/// Verdict of surface_pores from the verdict by diameter: fail if depth or share exceeds its limit. A guard
/// band is not used because neither has a U. A verdict not_measured is kept.
[[nodiscard]] Verdict with_pore_limits(Verdict by_diameter, const PoreSummary& pores);
/// Sentence such as "12 pores, largest 8.1 mm, deepest 3.4 mm (more than 3 mm), 0.40 % of the area (at most 1 %)".
/// Empty if pores were not searched.
[[nodiscard]] FixedString<160> sentence(const PoreSummary& pores);

/// A face at an edge of the block; the names are those of the block model.
enum class EdgeFace : std::uint8_t {
  seat,
  jaw_inner,
  jaw_outer,
  shoulder_inner,
  shoulder_outer,
  end_minus,  ///< end faces: towards lower and higher x
  end_plus,
  side_inner,  ///< side faces: towards the track's middle and away from it
  side_outer,
};
inline constexpr std::size_t kEdgeFaces = 9;
[[nodiscard]] std::string_view name(EdgeFace face);

/// A fillet or a chamfer of the block, learned from its own scan. Never judged.
struct EdgeFeature {
  EdgeFace face = EdgeFace::seat;
  EdgeFace face_to = EdgeFace::jaw_inner;
  double radius_mm = kNoValue;   ///< radius of the arc tangent to both faces; NaN: the edge is a chamfer
  double chamfer_mm = kNoValue;  ///< leg on `face`; NaN: the edge is a fillet
  double nominal_mm = kNoValue;  ///< nominal radius or leg from the recipe; NaN if it has none
  std::uint32_t n = 0;           ///< number of places along the edge used for the value, 1.25 mm each
};
/// Four fillets along the jaws, chamfers of seat and shoulders at both ends, and of the shoulders at their sides.
inline constexpr std::size_t kEdgesMax = 12;

/// Sentence such as "pit on the seat at x 80 mm, s 2 mm: 42 x 368 mm, 15460 mm2, up to 10.0 mm deep".
[[nodiscard]] FixedString<160> sentence(const SurfaceFinding& finding);

/// Reason why a casing is not `ok`: the first test that failed. From `rim_points` on, the bore was located
/// nevertheless.
enum class CasingDoubt : std::uint8_t {
  none,
  not_measured,  ///< the scan was not processed up to this step, or the recipe's casings are capped
  edge,          ///< too little of the bore's edge is visible, or it is not a circle
  radius,        ///< differs by more than a millimetre
  no_hole,       ///< the bore is filled at the height of the rim
  rim_points,    ///< too few points on the rim
  rim_crust,     ///< an object on the rim rises above the seat
  rim_form,      ///< not a plane for most of the circle, tilted, or too rough
  filled,        ///< a part has no noise: computed by the scanner's program, not measured
};
inline constexpr std::size_t kCasingDoubts = 9;
[[nodiscard]] std::string_view name(CasingDoubt doubt);
/// Reason in words, to follow "inner casing:"; empty for none and not_measured.
[[nodiscard]] std::string_view reason_of(CasingDoubt doubt);

struct CasingFeature {
  bool ok = false;
  CasingDoubt doubt = CasingDoubt::not_measured;
  Vec3 centre = Vec3::Zero();   ///< on the seat plane, registered block frame (mm)
  double radius_mm = kNoValue;  ///< radius of the bore edge
  double height_mm = kNoValue;  ///< height of the rim along the seat normal
  std::uint32_t edge_points = 0;
  std::uint32_t rim_points = 0;
  double edge_rms_mm = kNoValue;               ///< residuals of the edge points to the circle
  double inlier_fraction = 0.0;                ///< share of the edge's sectors that agree with the circle
  double rim_std_mm = kNoValue;                ///< standard deviation of the rim's points to its height
  double sigma_height_mm = kNoValue;           ///< uncertainty of the rim's height, from white noise
  Mat3 cov_circle = Mat3::Constant(kNoValue);  ///< centre along the rail, centre along the seat, radius (mm^2)
};

/// Input of the slab fit from one block, in the robot's base frame (mm): measured features, not the registration.
struct SeatObservation {
  bool ok = false;
  bool jaw_ok = false;
  bool top_ok = false;
  Vec3 p_base = Vec3::Zero();          ///< seat reference point: casing mid-point on the seat plane
  Vec3 n_base = Vec3::Zero();          ///< seat normal
  Vec3 jaw_outer_base = Vec3::Zero();  ///< outer jaw at reference height, section x = 0
  Vec3 top_n_base = Vec3::Zero();      ///< normal of the local slab top
  /// Standard uncertainties from the scanner's noise in this scan, block axes; NaN if unknown. The slab's budget adds
  /// the scanner's form error.
  Vec3 sigma_p_mm = Vec3::Constant(kNoValue);
  Vec3 sigma_jaw_mm = Vec3::Constant(kNoValue);
  Vec3 sigma_n_rad = Vec3::Constant(kNoValue);      ///< components of the seat normal
  Vec3 sigma_top_n_rad = Vec3::Constant(kNoValue);  ///< components of the slab top's normal
};

/// Wall time in ms, measured by the caller of each stage.
struct StageTimes {
  double read_ms = 0.0;
  double denoise_ms = 0.0;
  double register_ms = 0.0;
  double extract_ms = 0.0;
  double total_ms = 0.0;
};

inline constexpr std::size_t kBlockItemsMax = 14;

struct BlockResult {
  std::uint8_t station = 0;
  Verdict verdict = Verdict::none;
  std::uint16_t reason = 0;  ///< ItemInfo::reason of the lowest failing item, or a Code
  ScanCounts scan;
  RegistrationReport registration;
  SeatFeature seat;
  PlaneFit jaw_inner;
  PlaneFit jaw_outer;
  PlaneFit slab_top;
  CasingFeature casing_inner;
  CasingFeature casing_outer;
  FixedVector<Item, kBlockItemsMax> items;
  /// Damage before pores, each with the largest area first. Empty if the scan shows an intact block.
  FixedVector<SurfaceFinding, limits::kFindingsMax> findings;
  PoreSummary pores;
  FixedVector<EdgeFeature, kEdgesMax> edges;  ///< edges that were measured
  SeatObservation observation;
  StageTimes times;
};

/// 18 lateral + 18 vertical + 16 spacings + 9 large jaws + corner level + 2 warps + 18 slopes in the slab frame + 4 of
/// gauges.
inline constexpr std::size_t kSlabItemsMax = 96;

struct SlabFitReport {
  bool ok = false;
  std::uint8_t seats = 0;
  int iterations = 0;
  double rms_mm = kNoValue;
  double plain_rms_mm = kNoValue;  ///< rms of the additional unweighted fit
  Pose T_base_slab;
  FixedString<64> note;
};

struct SlabResult {
  Verdict verdict = Verdict::none;
  std::uint16_t reason = 0;
  std::uint16_t fail_mask = 0;  ///< all items of the blocks and the slab, as the PLC reads them
  std::uint16_t open_mask = 0;
  SlabFitReport fit;
  FixedVector<Item, kSlabItemsMax> items;  ///< slab-frame items; block items are stored with their blocks
  std::array<Verdict, limits::kStationsMax> station_verdict{};  ///< final, including slab items; [station - 1]
  std::array<std::uint16_t, limits::kStationsMax> station_reason{};
  GaugeReadings gauges;  ///< of all gauges of the line, as they counted for this slab
};

/// Verdict of a block whose items gave `by_items`. A finding turns a pass into indeterminate, reason 617, unless the
/// item block_damage has a limit and a value, and judges findings. Other verdicts are kept, as they are not better.
[[nodiscard]] Verdict with_findings(Verdict by_items, const BlockResult& block);
/// `reason_for` including the block's findings: 617 if the block is indeterminate but none of its items is.
[[nodiscard]] std::uint16_t reason_with_findings(Verdict verdict, const Item* begin, const Item* end, Code code,
                                                 const BlockResult& block);

/// REASON of the verdict: ItemInfo::reason of the lowest failing item. For not_measured and indeterminate, the reason
/// of the lowest such item, or `code` if it names an earlier cause. 0 for pass.
[[nodiscard]] std::uint16_t reason_for(Verdict verdict, const Item* begin, const Item* end, Code code);

/// Bits of IR 38 (`Verdict::fail`) and of IR 39 (indeterminate or not measured, required or not).
[[nodiscard]] std::uint16_t fail_mask(const Item* begin, const Item* end);
[[nodiscard]] std::uint16_t open_mask(const Item* begin, const Item* end);

/// The item with this id (and station, if given), or nullptr.
[[nodiscard]] const Item* find_item(const Item* begin, const Item* end, ItemId id, int station = -1);

}  // namespace slabd
