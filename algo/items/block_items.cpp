// SPDX-License-Identifier: Apache-2.0
//
// Item values from fitted features. All values are between measured features; the registration only defines the
// direction of X and the section x = 0, so its small errors cancel.
#include "algo/items/block_items.h"

#include <array>
#include <cmath>

#include "algo/features/casing.h"
#include "algo/items/uncertainty.h"

namespace slabd::algo {
namespace {

Item& item(BlockResult& result, ItemId id) {
  for (Item& i : result.items)
    if (i.id == id) return i;
  assert(false && "blank_block_items puts every block item there");
  return result.items.back();
}

/// Angle on the free side: the normals of a flat pair are parallel (180 degrees), a closed pair's are opposite (0).
double free_angle_deg(const PlaneFit& a, const PlaneFit& b) {
  return 180.0 - deg_from_rad(angle_between_rad(a.normal, b.normal));
}

}  // namespace

double slope_about_x_rad(const Vec3& n) {
  return std::atan2(-n.y(), n.z());
}

void blank_block_items(const Recipe& recipe, const SlabDesign& design, BlockResult& result) {
  result.items.clear();
  for (std::size_t i = 0; i < kItemCount; ++i) {
    const auto id = static_cast<ItemId>(i);
    if (info(id).scope != ItemScope::block || (info(id).optional && !recipe.tolerance(id).given)) continue;
    const bool has_room = result.items.push(designed_item(recipe, design, id, result.station));
    assert(has_room && "kBlockItemsMax counts the block's items");
    (void)has_room;
  }
}

void compute_block_items(const BlockModel& model, BlockResult& result) {
  const PlaneFit& seat = result.seat.plane;
  if (!seat.ok) return;
  const BlockGeometry& geometry = model.geometry();

  if (result.slab_top.ok) {
    // Datum frame: Z = slab top, X = the registration's X projected onto it.
    const Vec3 z = result.slab_top.normal;
    const Vec3 x = (Vec3::UnitX() - z.x() * z).normalized();
    const Vec3 y = z.cross(x);
    result.seat.normal_datum = Vec3(x.dot(seat.normal), y.dot(seat.normal), z.dot(seat.normal));
    const double slope_rad = slope_about_x_rad(result.seat.normal_datum);
    Item& slope = item(result, ItemId::seat_slope);
    slope.value = deg_from_rad(slope_rad);
    slope.companion = 1.0 / std::tan(slope_rad);
  }

  Item& flatness = item(result, ItemId::seat_flatness);
  flatness.value = result.seat.flatness_mm;
  flatness.companion = result.seat.flatness_min_zone_mm;
  Item& std_item = item(result, ItemId::seat_std);
  std_item.value = seat.std_mm;
  std_item.companion = result.seat.std_cells_mm;

  if (result.jaw_inner.ok) item(result, ItemId::jaw_angle_inner).value = free_angle_deg(seat, result.jaw_inner);
  if (result.jaw_outer.ok) item(result, ItemId::jaw_angle_outer).value = free_angle_deg(seat, result.jaw_outer);
  if (result.jaw_inner.ok && result.jaw_outer.ok) {
    const double height = geometry.jaw_reference_height_mm.value;
    item(result, ItemId::jaw_distance).value =
        (jaw_point(seat, result.jaw_outer, height).p - jaw_point(seat, result.jaw_inner, height).p).norm();
  }

  // The centres are on the seat plane already.
  if (is_located(result.casing_inner) && is_located(result.casing_outer))
    item(result, ItemId::casing_spacing).value = (result.casing_outer.centre - result.casing_inner.centre).norm();
  if (result.casing_inner.ok) item(result, ItemId::casing_protrusion_inner).value = result.casing_inner.height_mm;
  if (result.casing_outer.ok) item(result, ItemId::casing_protrusion_outer).value = result.casing_outer.height_mm;
}

void compute_observation(const BlockModel& model, CasingKind casings, const Pose& T_base_block, BlockResult& result) {
  SeatObservation& o = result.observation;
  o = SeatObservation{};
  const PlaneFit& seat = result.seat.plane;
  if (!seat.ok) return;
  o.n_base = T_base_block.rotation * seat.normal;
  if (casings == CasingKind::capped) {
    o.p_base = T_base_block * middle_of_seat(seat);
    o.ok = true;
  } else if (is_located(result.casing_inner) && is_located(result.casing_outer)) {
    o.p_base = T_base_block * Vec3(0.5 * (result.casing_inner.centre + result.casing_outer.centre));
    o.ok = true;
  }
  if (result.jaw_outer.ok) {
    const double height = model.geometry().jaw_reference_height_mm.value;
    o.jaw_outer_base = T_base_block * jaw_point(seat, result.jaw_outer, height).p;
    o.jaw_ok = true;
  }
  if (result.slab_top.ok) {
    o.top_n_base = T_base_block.rotation * result.slab_top.normal;
    o.top_ok = true;
  }
  compute_observation_sigma(model.geometry(), casings, result);
}

}  // namespace slabd::algo
