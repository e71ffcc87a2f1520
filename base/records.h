// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <string_view>

#include "base/fixed.h"
#include "base/items.h"
#include "base/limits.h"
#include "base/pose.h"
#include "base/result.h"

/// What one block and one slab came to: the values that pass between algo, storage, the station and reports.
namespace slabd {

// Parts of the line that were not the real ones. A slab, an attempt and a record hold them as bits; 0: all were real,
// as far as they say. A result with any bit set is not a verdict on concrete, whatever it reads.

inline constexpr unsigned kEmulatedLine = 1U << 0U;    ///< [line] simulation = true
inline constexpr unsigned kEmulatedRobot = 1U << 1U;   ///< the poses declare themselves emulated (flags, bit 4)
inline constexpr unsigned kCommandedPoses = 1U << 2U;  ///< the poses are not measured (flags, bit 0 is missing)
inline constexpr unsigned kEmulatedScan = 1U << 3U;    ///< the scan declares itself emulated (comment or header)

/// By bit; as JSON, metrics and exports name them.
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
  double share_associated = 0.0;  ///< of the sampled points near the model
  double condition = kNoValue;    ///< of the normal matrix, lengths scaled to the block
  double noise_mm = kNoValue;     ///< robust standard deviation of the points in the last step
  /// Of the small motion (x, y, z in mm, rotation about X, Y, Z in rad; block frame, about the block's origin) that
  /// takes the registered block to the true one, from white noise of `noise_mm`.
  Mat6 covariance = Mat6::Constant(kNoValue);
  FixedString<64> note;  ///< degenerate: which direction; rejected: which gate
  Pose T_scanner_block;
  DeviationStats deviation;
};

struct ScanCounts {
  std::uint64_t points_read = 0;
  std::uint64_t points_finite = 0;
  std::uint64_t isolated_removed = 0;
  std::uint64_t points_kept = 0;
  /// Step to which the coordinates along each axis of the scanner frame were rounded (mm). 0: no step was found, or the
  /// places along this axis are the scanner's own raster and therefore exact.
  Vec3 step_mm = Vec3::Zero();
  /// Size of second differences over that of first ones between neighbours on the seat, squared: 3 where each point has
  /// noise of its own, less where neighbours share it, as after a smoothing filter.
  double lag_ratio = kNoValue;
};

/// Below it the scan was smoothed, or the scanner's own noise hangs together over several points.
inline constexpr double kSmoothedLagRatio = 2.4;

/// Coordinate steps up to here (mm) are usual (three decimals, two of a coarse scanner) and change U by nothing worth
/// telling.
inline constexpr double kUsualStep_mm = 0.01;
/// A warning where the coordinates are rounded more coarsely than usual, or the scan was smoothed; empty otherwise.
[[nodiscard]] FixedString<420> scan_warning(const ScanCounts& scan);

/// Why a plane is not `ok`: the first test that said no.
enum class PlaneDoubt : std::uint8_t {
  none,
  not_fitted,      ///< the scan did not come so far
  no_plane,        ///< too few points, or all on a line
  unsettled,       ///< the inlier set did not stand still
  second_surface,  ///< within the threshold
  share,           ///< too few of the points are inliers
  area,            ///< too little of the area seen is
  support,         ///< too few inliers, not spread far enough, or too noisy for its tilt
  bends,           ///< it hangs on where the threshold cuts
  rival,           ///< another plane holds about as many points
  filled,          ///< a part of it has no noise: computed by the scanner's program, and not seen
};
inline constexpr std::size_t kPlaneDoubts = 11;
[[nodiscard]] std::string_view name(PlaneDoubt doubt);
/// In words, to follow "inner jaw:"; empty for none and not_fitted.
[[nodiscard]] std::string_view reason_of(PlaneDoubt doubt);

/// One fitted plane n.p = d in the block's registered frame (mm).
struct PlaneFit {
  bool ok = false;
  PlaneDoubt doubt = PlaneDoubt::not_fitted;
  Vec3 normal = Vec3::Zero();  ///< unit; towards the free side
  double offset_mm = kNoValue;
  std::uint64_t points = 0;  ///< offered to the fit
  std::uint64_t inliers = 0;
  double inlier_fraction = 0.0;
  double std_mm = kNoValue;                    ///< of the inliers, orthogonal, n - 3
  int iterations = 0;                          ///< refits until the inlier set stood still
  Vec3 centroid = Vec3::Zero();                ///< of the inliers; there offset and tilt are independent
  double sigma_offset_mm = kNoValue;           ///< standard deviation of the height at the centroid, from white noise
  Mat3 cov_normal = Mat3::Constant(kNoValue);  ///< covariance of `normal` (rad^2, rank 2), from white noise
};

/// How a plane would lie otherwise.
struct PlaneShift {
  Vec3 normal = Vec3::Zero();  ///< change of the normal, rad
  double height_mm = 0.0;      ///< of the height at the plane's centroid
};

/// The largest connected group of flatness cells that lie beyond the defect limit on one side of the seat plane.
struct SurfaceDefect {
  double limit_mm = kNoValue;  ///< distance beyond which a cell counts; NaN: the channel was not computed
  std::uint32_t cells = 0;     ///< of the largest group; 0 = no defect
  double area_mm2 = 0.0;
  double height_mm = 0.0;  ///< furthest cell of the group, signed: positive stands out
  double x_mm = 0.0;       ///< centre of the group, along the rail ...
  double s_mm = 0.0;       ///< ... and along the seat
};

struct SeatFeature {
  PlaneFit plane;                    ///< of the evaluation region (the crop)
  PlaneFit full_plane;               ///< of the whole bearing plane, reported beside it
  PlaneShift by_area;                ///< `plane` weighed by area instead of by points: zero unless form meets density
  Vec3 normal_datum = Vec3::Zero();  ///< in the datum frame: Z from the slope datum, X from the registration
  std::uint32_t grid_points = 0;     ///< flatness cells with enough points
  double std_cells_mm = kNoValue;
  /// The one of the two that the recipe judges: peak to valley to the least-squares plane.
  double flatness_mm = kNoValue;
  double flatness_closed_mm =
      kNoValue;                       ///< of the surface closed from above: pits narrower than closing_mm are bridged
  double flatness_raw_mm = kNoValue;  ///< of the cell means as they are, pits and all
  double flatness_trimmed_mm = kNoValue;   ///< of the nine tenths of the cell means nearest to the plane (paper 5.2)
  double flatness_min_zone_mm = kNoValue;  ///< minimum zone of the surface that flatness_mm is told of
  double raw_low_mm = kNoValue;            ///< extremes of single points to the plane
  double raw_high_mm = kNoValue;
  /// Variance of a mean over the one white noise would give it: 1 when neighbouring points err independently. The
  /// larger of what this scan shows and what follows from the scanner's acceptance.
  double noise_factor = kNoValue;
  double flatness_noise_mm = kNoValue;  ///< what a perfectly flat seat would read with this noise
  SurfaceDefect defect;
};

/// An area of the block's surface that is displaced or was not seen: damage, and the larger pores.
enum class FindingKind : std::uint8_t {
  pit,      ///< below the face
  bump,     ///< above it
  crack,    ///< below it or without points, long and narrow
  chip,     ///< below it and open towards an outer edge of the block
  missing,  ///< nothing was seen there
};
inline constexpr std::size_t kFindingKinds = 5;
[[nodiscard]] std::string_view name(FindingKind kind);
/// What was seen of a broken edge belongs to the face from which it was broken.
enum class FindingFace : std::uint8_t { seat, jaw_inner, jaw_outer, shoulder_inner, shoulder_outer };
inline constexpr std::size_t kFindingFaces = 5;
[[nodiscard]] std::string_view name(FindingFace face);

struct SurfaceFinding {
  FindingKind kind = FindingKind::pit;
  FindingFace face = FindingFace::seat;
  double x_mm = 0.0;             ///< centre of the area: along the rail, ...
  double s_mm = 0.0;             ///< ... along the bearing plane, climbing outward, ...
  double z_mm = 0.0;             ///< ... and height of the face there in the block frame
  double length_mm = 0.0;        ///< extent along the rail
  double width_mm = 0.0;         ///< extent on the face across the rail
  double depth_mm = kNoValue;    ///< distance from the face where it is largest, positive; NaN: nothing was seen
  double area_mm2 = 0.0;         ///< on the face
  double volume_mm3 = kNoValue;  ///< between the face and what was seen; NaN: nothing was seen
};

/// Pores of a block: pits up to the size that the recipe counts as a pore (algo/survey/surface_damage.h).
struct PoreSummary {
  std::uint32_t count = 0;       ///< of pores large enough to be counted
  double largest_mm = kNoValue;  ///< diameter of the circle of equal area; 0: there is none, NaN: not looked for
  double deepest_mm = kNoValue;
  double share = kNoValue;  ///< of the area that was seen
  PoreLimits limits;        ///< of the recipe that the block was judged by
};
/// True if the deepest pore, and if the share of the area, is beyond its limit.
[[nodiscard]] bool is_too_deep(const PoreSummary& pores);
[[nodiscard]] bool is_too_much(const PoreSummary& pores);
/// Verdict of surface_pores from its verdict by the diameter: fail if depth or share is beyond its limit. There is no
/// guard band because neither has a U. What was not measured stays so.
[[nodiscard]] Verdict with_pore_limits(Verdict by_diameter, const PoreSummary& pores);
/// "12 pores, largest 8.1 mm, deepest 3.4 mm (more than 3 mm), 0.40 % of the area (at most 1 %)"; empty if pores
/// were not looked for.
[[nodiscard]] FixedString<160> sentence(const PoreSummary& pores);

/// A face that bounds an edge of the block; the names are those of the block model.
enum class EdgeFace : std::uint8_t {
  seat,
  jaw_inner,
  jaw_outer,
  shoulder_inner,
  shoulder_outer,
  end_minus,  ///< the end faces: towards lower and higher x
  end_plus,
  side_inner,  ///< the side faces: towards the track's middle and away from it
  side_outer,
};
inline constexpr std::size_t kEdgeFaces = 9;
[[nodiscard]] std::string_view name(EdgeFace face);

/// A fillet or a chamfer of the block, learned from its own scan. Never judged.
struct EdgeFeature {
  EdgeFace face = EdgeFace::seat;
  EdgeFace face_to = EdgeFace::jaw_inner;
  double radius_mm = kNoValue;   ///< of the arc that touches both faces; NaN: the edge is a chamfer
  double chamfer_mm = kNoValue;  ///< its leg on `face`; NaN: the edge is a fillet
  double nominal_mm = kNoValue;  ///< of the one of both, by the recipe; NaN: the recipe gives none
  std::uint32_t n = 0;           ///< places along the edge that it rests on, 1.25 mm each
};
/// Four fillets along the jaws, chamfers of seat and shoulders at both ends, and of the shoulders at their sides.
inline constexpr std::size_t kEdgesMax = 12;

/// "pit on the seat at x 80 mm, s 2 mm: 42 x 368 mm, 15460 mm2, up to 10.0 mm deep".
[[nodiscard]] FixedString<160> sentence(const SurfaceFinding& finding);

/// Why a casing is not `ok`: the first test that said no. From `rim_points` on its bore is located all the same.
enum class CasingDoubt : std::uint8_t {
  none,
  not_measured,  ///< the scan did not come so far, or the recipe's casings are capped
  edge,          ///< too little of the bore's edge seen, or no circle
  radius,        ///< off by more than a millimetre
  no_hole,       ///< something fills the bore at the height of the rim
  rim_points,    ///< too few seen
  rim_crust,     ///< something on the rim stands over the seat
  rim_form,      ///< no plane most of the way round, tilted, or too rough
  filled,        ///< a part of it has no noise: computed by the scanner's program, and not seen
};
inline constexpr std::size_t kCasingDoubts = 9;
[[nodiscard]] std::string_view name(CasingDoubt doubt);
/// In words, to follow "inner casing:"; empty for none and not_measured.
[[nodiscard]] std::string_view reason_of(CasingDoubt doubt);

struct CasingFeature {
  bool ok = false;
  CasingDoubt doubt = CasingDoubt::not_measured;
  Vec3 centre = Vec3::Zero();   ///< on the seat plane, registered block frame (mm)
  double radius_mm = kNoValue;  ///< of the bore edge
  double height_mm = kNoValue;  ///< of the rim along the seat normal
  std::uint32_t edge_points = 0;
  std::uint32_t rim_points = 0;
  double edge_rms_mm = kNoValue;               ///< of the edge points to the circle
  double inlier_fraction = 0.0;                ///< of the edge's sectors that agree with the circle
  double rim_std_mm = kNoValue;                ///< of the rim's points to its height
  double sigma_height_mm = kNoValue;           ///< of the rim's height, from white noise
  Mat3 cov_circle = Mat3::Constant(kNoValue);  ///< of centre along the rail, centre along the seat, radius (mm^2)
};

/// What the slab fit needs from one block, in the robot's base frame (mm). Measured features, not the registration.
struct SeatObservation {
  bool ok = false;
  bool jaw_ok = false;
  bool top_ok = false;
  Vec3 p_base = Vec3::Zero();          ///< seat reference point: casing mid-point on the seat plane
  Vec3 n_base = Vec3::Zero();          ///< seat normal
  Vec3 jaw_outer_base = Vec3::Zero();  ///< outer jaw at reference height, section x = 0
  Vec3 top_n_base = Vec3::Zero();      ///< normal of the local slab top
  /// Standard uncertainties from the scanner's noise in this scan, block axes; NaN where unknown. The scanner's form
  /// error comes with the slab's budget.
  Vec3 sigma_p_mm = Vec3::Constant(kNoValue);
  Vec3 sigma_jaw_mm = Vec3::Constant(kNoValue);
  Vec3 sigma_n_rad = Vec3::Constant(kNoValue);      ///< of the seat normal's components
  Vec3 sigma_top_n_rad = Vec3::Constant(kNoValue);  ///< of the slab top's
};

/// ms of wall time, measured by the caller of each stage.
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
  std::uint16_t reason = 0;  ///< that of the lowest failing item (ItemInfo::reason), or a Code
  ScanCounts scan;
  RegistrationReport registration;
  SeatFeature seat;
  PlaneFit jaw_inner;
  PlaneFit jaw_outer;
  PlaneFit slab_top;
  CasingFeature casing_inner;
  CasingFeature casing_outer;
  FixedVector<Item, kBlockItemsMax> items;
  /// Damage before pores, each the largest area first; empty: the block is whole as far as the scan shows it.
  FixedVector<SurfaceFinding, limits::kFindingsMax> findings;
  PoreSummary pores;
  FixedVector<EdgeFeature, kEdgesMax> edges;  ///< those that were seen
  SeatObservation observation;
  StageTimes times;
};

/// 18 lateral + 18 vertical + 16 spacings + 9 large jaws + corner level + 2 warps + 18 slopes in the slab frame.
inline constexpr std::size_t kSlabItemsMax = 96;

struct SlabFitReport {
  bool ok = false;
  std::uint8_t seats = 0;
  int iterations = 0;
  double rms_mm = kNoValue;
  double plain_rms_mm = kNoValue;  ///< of the unweighted fit beside it
  Pose T_base_slab;
  FixedString<64> note;
};

struct SlabResult {
  Verdict verdict = Verdict::none;
  std::uint16_t reason = 0;
  std::uint16_t fail_mask = 0;  ///< over the items of all blocks and of the slab, as the PLC reads them
  std::uint16_t open_mask = 0;
  SlabFitReport fit;
  FixedVector<Item, kSlabItemsMax> items;  ///< slab-frame items; block items stay with their blocks
  std::array<Verdict, limits::kStationsMax> station_verdict{};  ///< final, slab items included; [station - 1]
  std::array<std::uint16_t, limits::kStationsMax> station_reason{};
};

/// Verdict and reason of a block whose items came to `by_items`: a finding turns a pass into indeterminate, reason 617,
/// unless the block has the item block_damage, which judges them. Every other verdict is kept, because it is no better.
[[nodiscard]] Verdict with_findings(Verdict by_items, const BlockResult& block);
/// `reason_for` with the block's findings: 617 where the block is indeterminate and no item is.
[[nodiscard]] std::uint16_t reason_with_findings(Verdict verdict, const Item* begin, const Item* end, Code code,
                                                 const BlockResult& block);

/// The verdict's REASON: ItemInfo::reason of the lowest failing item; for not_measured and indeterminate of the lowest
/// such item, or `code` when it names a cause before any item; 0 for pass.
[[nodiscard]] std::uint16_t reason_for(Verdict verdict, const Item* begin, const Item* end, Code code);

/// Bits of IR 38 (`Verdict::fail`) and of IR 39 (indeterminate or not measured, required or not).
[[nodiscard]] std::uint16_t fail_mask(const Item* begin, const Item* end);
[[nodiscard]] std::uint16_t open_mask(const Item* begin, const Item* end);

/// The item with this id (and station, if given), or nullptr.
[[nodiscard]] const Item* find_item(const Item* begin, const Item* end, ItemId id, int station = -1);

}  // namespace slabd
