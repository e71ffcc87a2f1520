// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <optional>
#include <string_view>

#include "base/fixed.h"

namespace slabd {

/// VERDICT as the PLC reads it. Zeroed memory is `none`; only `pass` is a pass.
enum class Verdict : std::uint8_t { none = 0, pass = 1, fail = 2, not_measured = 3, aborted = 4, indeterminate = 5 };

/// Word used in JSON, the database and reports: "pass", "fail", "not_measured", ...
[[nodiscard]] std::string_view name(Verdict verdict);

/// Decision of quality about a slab that did not pass, as the PLC reads it (IR 28). The measured verdict stays as it
/// is.
enum class Disposition : std::uint8_t {
  none = 0,
  hold = 1,
  release_by_concession = 2,
  rework = 3,
  scrap = 4,
  re_inspect = 5
};
/// Word used in JSON and the database: "release_by_concession"; empty for a value that is none of them.
[[nodiscard]] std::string_view name(Disposition disposition);
[[nodiscard]] std::optional<Disposition> disposition_named(std::string_view word);

/// Measured characteristics. 0..15 are the bits of the PLC's fail mask. warp_right shares bit 15; seat_std is
/// information only. surface_pores and block_damage have no bit, but a REASON each (ItemInfo::reason); so have the four
/// items that gauges measure (base/gauge.h).
enum class ItemId : std::uint8_t {
  seat_slope = 0,
  seat_flatness = 1,
  jaw_angle_inner = 2,
  jaw_angle_outer = 3,
  jaw_distance = 4,
  casing_spacing = 5,
  casing_protrusion_inner = 6,
  casing_protrusion_outer = 7,
  casing_skew_inner = 8,
  casing_skew_outer = 9,
  seat_lateral = 10,
  seat_vertical = 11,
  seat_spacing = 12,
  large_jaw_distance = 13,
  corner_level = 14,
  warp_left = 15,
  warp_right = 16,
  seat_std = 17,
  surface_pores = 18,
  block_damage = 19,
  slab_length = 20,
  slab_width = 21,
  slab_thickness = 22,
  bottom_flatness = 23,
};
inline constexpr std::size_t kItemCount = 24;

enum class ItemScope : std::uint8_t { block, seat_in_slab, seat_neighbours, seat_pair, slab };
enum class ItemUnit : std::uint8_t { mm, deg };

/// Constant properties of an item; the recipe contains the tolerances.
struct ItemInfo {
  ItemId id;
  std::string_view name;
  ItemScope scope;
  ItemUnit unit;
  int plc_bit;  ///< bit of fail mask IR 38 / IR 39; -1 if none
  int reason;   ///< REASON of a verdict decided by this item; -1 if the item is information and decides nothing
  std::string_view companion = "";  ///< name of `Item::companion` in JSON and reports; empty if the item has none
  bool is_size = false;             ///< needs no lower limit unless a formula gives it a sign; other items need both
  bool nominal_is_zero = false;     ///< whatever the geometry is
  bool U_from_recipe = false;       ///< no U is computed from the scan
  bool of_gauges = false;           ///< value and U follow from the line's gauges by the recipe's formula
  bool optional = false;            ///< a recipe may omit this item; then it is not listed and decides nothing
  std::string_view meaning = "";    ///< describe() and cure() of `reason`, for items without a bit
  std::string_view cure = "";
};
[[nodiscard]] const ItemInfo& info(ItemId id);
[[nodiscard]] std::string_view name(ItemUnit unit);
[[nodiscard]] std::optional<ItemId> item_from_name(std::string_view item_name);
/// First item with this REASON (warp_left for both warps); nullopt if there is none.
[[nodiscard]] std::optional<ItemId> item_from_reason(int reason);

/// Source of an item's standard uncertainty (GUM budget; algo/items/uncertainty.h contains the terms and formulas).
enum class BudgetPart : std::uint8_t {
  fit,           ///< covariance of the fitted features from white noise
  noise,         ///< addition due to correlated noise of neighbouring points
  scanner,       ///< the scanner's specified form and length error
  registration,  ///< section and direction taken from the registered pose
  calibration,   ///< scanner on flange and station correction
  robot,         ///< repeatability
  reference,     ///< the artefact used to set up the system
  thermal,       ///< the slab's temperature and expansion (base/thermal.h)
  gauge,         ///< the gauges' own standard uncertainty; that of their masters is `reference`
  tie,           ///< the second robot's base in the line's base frame
};
inline constexpr std::size_t kBudgetParts = 10;
[[nodiscard]] std::string_view name(BudgetPart part);

inline constexpr double kNoValue = std::numeric_limits<double>::quiet_NaN();
[[nodiscard]] inline bool has_value(double v) {
  return !std::isnan(v);
}

/// One measured characteristic. NaN means not measured, or no such limit. Units: mm, or degrees for angles
/// (`info(id).unit`). Degrees are used internally only here, because tolerances, reports and the PLC use degrees.
struct Item {
  ItemId id = ItemId::seat_slope;
  Verdict verdict = Verdict::none;
  bool required = false;        ///< if not measured, the block or slab is not measured
  std::uint8_t station = 0;     ///< 1..18; 0 for the whole slab
  std::uint8_t station_to = 0;  ///< second station of a spacing or a pair; else 0
  double value = kNoValue;      ///< a length at the recipe's reference temperature, if it has one (base/thermal.h)
  double nominal = kNoValue;
  double lower = kNoValue;  ///< absolute limits of `value`
  double upper = kNoValue;
  double U = kNoValue;          ///< expanded uncertainty, k = 2
  double companion = kNoValue;  ///< second figure of this item, by the name in ItemInfo::companion
  double measured = kNoValue;   ///< `value` before its correction for temperature; NaN if none was made

  /// Standard uncertainties (k = 1, in the item's unit) whose root sum of squares is U / 2. All zero if no budget was
  /// computed; then U is the recipe's default.
  std::array<double, kBudgetParts> budget{};

  [[nodiscard]] double deviation() const { return value - nominal; }
};
/// Limits of surface_pores in addition to the diameter, which is `Item::value`. NaN: no limit.
struct PoreLimits {
  double depth_max_mm = kNoValue;  ///< depth of the deepest pore
  double share_max = kNoValue;     ///< share of the visible area
};

/// Decision by ISO 14253-1 with guard band `guard * U`: pass if inside the limits by the guard band, fail if outside by
/// it, else indeterminate. No value: not_measured. No U (NaN or 0): indeterminate, also with guard 0. An item without
/// limits is information: its verdict is `none`.
[[nodiscard]] Verdict judge(const Item& item, double guard);

/// Probability that the true value is within the limits (JCGM 106, 7.2 and 7.3). The measured value has a normal
/// distribution with u = U / 2. NaN without value, limits or U.
[[nodiscard]] double conformance_probability(const Item& item);

/// Verdict of a block or slab: fail if any item fails, else not_measured if a required item is. Otherwise indeterminate
/// if any item is, else pass. An empty list is not_measured. Unmeasured items that are not required are ignored.
[[nodiscard]] Verdict combine(const Item* begin, const Item* end);

}  // namespace slabd
