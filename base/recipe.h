// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>

#include "base/fixed.h"
#include "base/gauge.h"
#include "base/items.h"
#include "base/limits.h"
#include "base/pose.h"

/// A slab type as data. All geometry of a slab is read from a TOML file (`daemon`); none is in the code.
namespace slabd {

/// A nominal value, and whether a person has confirmed it with the drawing. A verdict on unconfirmed numbers has a
/// warning.
struct Nominal {
  double value = kNoValue;
  bool confirmed = false;
};

/// The block in its own frame: origin in the centre of the bearing plane, X along the rail, Y outward, Z up. mm, rad.
struct BlockGeometry {
  Nominal cant_ratio;               ///< slope of the bearing plane, which rises outward 1 : cant_ratio
  Nominal jaw_half_distance_mm;     ///< along the bearing plane, at the reference height
  Nominal jaw_reference_height_mm;  ///< above the bearing plane along its normal
  Nominal jaw_angle_rad;            ///< angle between bearing plane and jaw face, in the free space
  Nominal shoulder_outer_z_mm;
  Nominal shoulder_inner_z_mm;
  Nominal end_half_length_mm;  ///< |x| of the end faces at z = 0
  Nominal side_half_width_mm;  ///< |y| of the side faces at z = 0
  Nominal draft_rad;           ///< draft of end and side faces: |x| = half - z tan(draft)
  Nominal slab_top_z_mm;
  Nominal casing_half_spacing_mm;  ///< along the bearing plane, at x = 0
  Nominal casing_bore_diameter_mm;
  Nominal casing_rim_diameter_mm;
  Nominal casing_rim_height_mm;  ///< along the bearing normal; negative if sunk
};

/// The slab: origin in the centre of its top surface, X along, Y across, Z up. mm.
struct SlabGeometry {
  Nominal length_mm;
  Nominal width_mm;
  Nominal thickness_mm;
  std::uint8_t pairs = 0;
  Nominal pitch_mm;
  Nominal first_pair_from_end_mm;
  Nominal seat_centre_distance_mm;  ///< across the track, between the two rows' block origins
  Nominal block_origin_z_mm;        ///< height of the block origin above the slab top
};

/// Flatness value that the recipe judges.
enum class FlatnessKind : std::uint8_t {
  closed,  ///< surface as a straightedge or a rail pad touches it: pits narrower than closing_mm are bridged
  raw,     ///< surface as it is, including all pores
};
/// Visible part of a casing when blocks are scanned.
enum class CasingKind : std::uint8_t {
  open,    ///< bore and rim are visible
  capped,  ///< a cap covers the casing; its items are not measured and not required
};

/// Regions and criteria of the measurements on a block. mm.
struct EvaluationSettings {
  double crop_half_x_mm = kNoValue;        ///< seat evaluation region, |x|
  double crop_half_s_mm = kNoValue;        ///< seat evaluation region, |s| along the plane
  double cell_mm = kNoValue;               ///< flatness cell
  std::uint16_t cell_points_min = 0;       ///< a cell with fewer points is ignored
  double cells_missing_max = 0.05;         ///< largest share of cells without points; above it flatness is not measured
  double edge_margin_mm = kNoValue;        ///< distance from every edge of a face that is excluded from its fit
  double inlier_share_min = kNoValue;      ///< smallest share of inliers; below it a plane is not measured
  double registration_gate_mm = kNoValue;  ///< a point farther from the model than this belongs to no face
  /// Smallest share of points within the gate; below it the pose is rejected.
  double registration_share_min = kNoValue;
  FlatnessKind flatness = FlatnessKind::closed;
  double closing_mm = 10.0;  ///< pits up to this width are bridged
  CasingKind casing = CasingKind::open;
  double defect_sigmas = 5.0;   ///< distance from the seat plane beyond which cells are a defect, in sigmas
  double window_mm = kNoValue;  ///< a registered pose farther than this from its start is rejected
  double window_rad = kNoValue;
};

/// Radii and legs from the drawing, mm; NaN if the recipe has none. Shown next to the learned values, never judged.
struct EdgeNominals {
  double fillet_seat_mm = kNoValue;      ///< fillet between seat and jaws
  double fillet_shoulder_mm = kNoValue;  ///< fillet between jaws and shoulders
  double chamfer_mm = kNoValue;          ///< chamfer at ends and sides
};

/// Assumptions about the measuring system for the computation of U. If `given` is false, items use the recipe's U.
struct UncertaintySettings {
  bool given = false;
  Nominal scanner_form_mm;         ///< half width of the scanner's form error (rectangular), over ...
  Nominal scanner_form_length_mm;  ///< ... this length (mm); shorter features have a proportionally smaller error
  Nominal scanner_length_ppm;      ///< half width of the scanner's relative length error (rectangular), um per m
  Nominal reference_mm;            ///< standard uncertainty of the length reference artefact
  Nominal reference_rad;           ///< standard uncertainty of the angle reference artefact
};

/// Temperature at which lengths are stated (base/thermal.h). If `given` is false, they are stated as measured.
struct ThermalSettings {
  bool given = false;
  Nominal reference_c;
  Nominal cte_per_K;        ///< expansion of the slab's concrete
  Nominal u_cte_per_K;      ///< its standard uncertainty
  Nominal u_temperature_K;  ///< standard uncertainty of the temperature that the PLC sends
  Nominal unknown_low_c;    ///< range of temperatures when the PLC sends none
  Nominal unknown_high_c;
};

/// Limits of one item. Tolerances are absolute limits of the value, not deviations.
struct Tolerance {
  Nominal nominal;
  double lower = kNoValue;  ///< NaN without a lower limit
  double upper = kNoValue;
  double U = kNoValue;  ///< expanded (k = 2), used if no budget is computed; slab-frame items add the station's
  bool required = false;
  bool confirmed = false;  ///< true if the limits are confirmed
  bool given = false;      ///< true if the recipe contains this item; used for optional items only (ItemInfo::optional)
};

/// Use of design sheets (base/design.h).
enum class DesignUse : std::uint8_t {
  none,      ///< every slab is as the recipe says
  optional,  ///< a slab without a sheet is as the recipe says
  required,  ///< a slab without a sheet cannot begin
};

enum class SlopeDatum : std::uint8_t { slab_frame, local_slab_top };

struct Recipe {
  FixedString<32> name;
  std::uint16_t slab_type = 0;  ///< SLAB_TYPE of the PLC
  FixedString<64> sha256;       ///< SHA-256 of the file's bytes, hex
  FixedString<limits::kPathBytes> path;
  SlabGeometry slab;
  BlockGeometry block;
  EvaluationSettings evaluation;
  EdgeNominals edges;
  UncertaintySettings uncertainty;
  ThermalSettings thermal;
  SlopeDatum slope_datum = SlopeDatum::slab_frame;
  bool remove_warp = true;
  DesignUse design = DesignUse::none;
  double guard = 1.0;  ///< guard band in units of U; 0: simple acceptance
  std::array<Tolerance, kItemCount> tolerances;
  PoreLimits pores;
  std::array<GaugeFormula, kGaugeItems> formulas;  ///< of slab_length, slab_width, slab_thickness, bottom_flatness

  [[nodiscard]] const GaugeFormula& formula(ItemId id) const { return formulas[gauge_item_index(id)]; }
  [[nodiscard]] const Tolerance& tolerance(ItemId id) const { return tolerances[static_cast<std::size_t>(id)]; }
  [[nodiscard]] std::uint8_t stations() const { return static_cast<std::uint8_t>(2 * slab.pairs); }
};

/// Pose of block `station` (1..2*pairs) in the slab frame. Stations 1..pairs: row Y > 0 with increasing X, axes
/// parallel to the slab's. Stations pairs+1..2*pairs: row Y < 0 with decreasing X, rotated 180 degrees about Z, so that
/// Y points outward.
[[nodiscard]] Pose T_slab_block(const Recipe& recipe, int station);

/// Station across the track: 1 <-> 18, 9 <-> 10 on nine pairs.
[[nodiscard]] inline int opposite_station(const Recipe& recipe, int station) {
  return 2 * recipe.slab.pairs + 1 - station;
}

/// Default pose of the scanner over a block: 600 mm above its origin, looking straight down.
[[nodiscard]] Pose nominal_T_block_scanner();

/// Number of unconfirmed nominals and tolerances that a verdict depends on.
[[nodiscard]] int unconfirmed_count(const Recipe& recipe);

/// Creates an item with nominal, limits, U and required from the recipe; without a value, with verdict not_measured.
[[nodiscard]] Item blank_item(const Recipe& recipe, ItemId id, int station = 0, int station_to = 0);

}  // namespace slabd
