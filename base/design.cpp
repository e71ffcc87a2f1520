// SPDX-License-Identifier: Apache-2.0
#include "base/design.h"

#include <algorithm>
#include <charconv>
#include <cmath>

#include "base/units.h"

namespace slabd {
namespace {

/// The next number of the text, up to `end`; false if there is none.
template <typename Number>
bool take(std::string_view& text, char end, Number& out) {
  const auto [stop, fault] = std::from_chars(text.data(), text.data() + text.size(), out);
  if (fault != std::errc() || stop == text.data() + text.size() || *stop != end) return false;
  text.remove_prefix(static_cast<std::size_t>(stop - text.data()) + 1);
  return true;
}

/// Pose of a block as designed, with its slope.
Pose designed_pose(const Recipe& recipe, const SlabDesign& design, int station) {
  Pose pose = T_slab_block(recipe, design, station);
  pose.rotation = pose.rotation * Quat(Eigen::AngleAxisd(design.at(station).slope_rad, Vec3::UnitX()));
  return pose;
}

/// Nominal place of the seat's reference point and of the outer jaw at its reference height, in the slab frame.
Vec3 seat_point(const Recipe& recipe, const SlabDesign& design, int station) {
  return designed_pose(recipe, design, station).translation_mm;
}
Vec3 outer_jaw(const Recipe& recipe, const SlabDesign& design, int station) {
  const double cant = std::atan(1.0 / recipe.block.cant_ratio.value);
  const double along = recipe.block.jaw_half_distance_mm.value;
  const double above = recipe.block.jaw_reference_height_mm.value;
  return designed_pose(recipe, design, station) *
         Vec3(0.0, along * std::cos(cant) - above * std::sin(cant), along * std::sin(cant) + above * std::cos(cant));
}

double spacing(const Recipe& recipe, const SlabDesign& design, int a, int b) {
  return std::abs(seat_point(recipe, design, b).x() - seat_point(recipe, design, a).x());
}

double corner_level(const Recipe& recipe, const SlabDesign& design) {
  const int n = recipe.slab.pairs;
  const auto z = [&](int station) { return seat_point(recipe, design, station).z(); };
  return z(1) - z(n) + z(n + 1) - z(2 * n);
}

/// Middle of the row above the chord of its ends.
double warp(const Recipe& recipe, const SlabDesign& design, int first, int last) {
  const auto above_chord = [&](int station) {
    const Vec3 a = seat_point(recipe, design, first);
    const Vec3 b = seat_point(recipe, design, last);
    const Vec3 p = seat_point(recipe, design, station);
    return p.z() - (a.z() + (p.x() - a.x()) / (b.x() - a.x()) * (b.z() - a.z()));
  };
  return 0.5 * (above_chord((first + last) / 2) + above_chord((first + last + 1) / 2));
}

/// Value of the item on a slab that is exactly as designed, for items whose nominal follows from the seats' places.
double value_of(const Recipe& recipe, const SlabDesign& design, ItemId id, int station, int station_to) {
  switch (id) {
    case ItemId::seat_slope: return deg_from_rad(design.at(station).slope_rad);
    case ItemId::seat_spacing: return spacing(recipe, design, station, station_to);
    case ItemId::large_jaw_distance:
      return (outer_jaw(recipe, design, station) - outer_jaw(recipe, design, station_to)).norm();
    case ItemId::corner_level: return corner_level(recipe, design);
    case ItemId::warp_left: return warp(recipe, design, 1, recipe.slab.pairs);
    case ItemId::warp_right: return warp(recipe, design, recipe.slab.pairs + 1, recipe.stations());
    default: return 0.0;  // the others do not depend on it, or are deviations from the designed place
  }
}

}  // namespace

Result<SlabDesign> parse_design(std::string_view text) {
  SlabDesign design;
  design.given = !text.empty();
  while (!text.empty()) {
    int station = 0;
    Vec3 offset_mm;
    double slope_deg = 0.0;
    const bool good = take(text, ',', station) && take(text, ',', offset_mm.x()) && take(text, ',', offset_mm.y()) &&
                      take(text, ',', offset_mm.z()) && take(text, ';', slope_deg);
    if (!good || station < 1 || station > static_cast<int>(limits::kStationsMax) || !offset_mm.allFinite() ||
        !std::isfinite(slope_deg))
      return error(Code::config, "the stored design is not rows of station,dx_mm,dy_mm,dz_mm,dslope_deg;");
    design.seats[static_cast<std::size_t>(station - 1)] = {offset_mm, rad_from_deg(slope_deg)};
  }
  return design;
}

const DesignSheet* find_design(std::span<const DesignSheet> sheets, std::string_view slab_id) {
  const auto found = std::lower_bound(sheets.begin(), sheets.end(), slab_id,
                                      [](const DesignSheet& sheet, auto id) { return sheet.slab_id.view() < id; });
  return found != sheets.end() && found->slab_id.view() == slab_id ? &*found : nullptr;
}

Pose T_slab_block(const Recipe& recipe, const SlabDesign& design, int station) {
  Pose pose = T_slab_block(recipe, station);
  pose.translation_mm += design.at(station).offset_mm;
  return pose;
}

BlockGeometry designed_block(const BlockGeometry& block, const SeatDesign& seat) {
  BlockGeometry out = block;
  out.cant_ratio.value = 1.0 / std::tan(std::atan(1.0 / block.cant_ratio.value) + seat.slope_rad);
  out.slab_top_z_mm.value -= seat.offset_mm.z();
  return out;
}

Item designed_item(const Recipe& recipe, const SlabDesign& design, ItemId id, int station, int station_to) {
  Item item = blank_item(recipe, id, station, station_to);
  const bool needs_station = info(id).scope != ItemScope::slab;
  if (!design.given || (needs_station && (station < 1 || station > recipe.stations()))) return item;
  const double shift =
      value_of(recipe, design, id, station, station_to) - value_of(recipe, SlabDesign{}, id, station, station_to);
  item.nominal += shift;
  item.lower += shift;
  item.upper += shift;
  return item;
}

}  // namespace slabd
