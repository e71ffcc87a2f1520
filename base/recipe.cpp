// SPDX-License-Identifier: Apache-2.0
#include "base/recipe.h"

namespace slabd {

Pose T_slab_block(const Recipe& recipe, int station) {
  const SlabGeometry& slab = recipe.slab;
  const int pairs = slab.pairs;
  const bool left = station <= pairs;
  const int column = left ? station - 1 : 2 * pairs - station;
  const double x0 = -0.5 * slab.length_mm.value + slab.first_pair_from_end_mm.value;
  const double x = x0 + slab.pitch_mm.value * column;
  const double y = 0.5 * slab.seat_centre_distance_mm.value;
  Pose pose;
  pose.translation_mm = Vec3(x, left ? y : -y, slab.block_origin_z_mm.value);
  pose.rotation = left ? Quat(1.0, 0.0, 0.0, 0.0) : Quat(0.0, 0.0, 0.0, 1.0);
  return pose;
}

Pose nominal_T_block_scanner() {
  return {Quat(0.0, 1.0, 0.0, 0.0), Vec3(0.0, 0.0, 600.0)};
}

int unconfirmed_count(const Recipe& recipe) {
  const BlockGeometry& b = recipe.block;
  const SlabGeometry& s = recipe.slab;
  int count = 0;
  for (const Nominal* n :
       {&b.cant_ratio, &b.jaw_half_distance_mm, &b.jaw_reference_height_mm, &b.jaw_angle_rad, &b.shoulder_outer_z_mm,
        &b.shoulder_inner_z_mm, &b.end_half_length_mm, &b.side_half_width_mm, &b.draft_rad, &b.slab_top_z_mm,
        &b.casing_half_spacing_mm, &b.casing_bore_diameter_mm, &b.casing_rim_diameter_mm, &b.casing_rim_height_mm,
        &s.pitch_mm, &s.first_pair_from_end_mm, &s.seat_centre_distance_mm, &s.block_origin_z_mm}) {
    count += n->confirmed ? 0 : 1;
  }
  const UncertaintySettings& u = recipe.uncertainty;
  if (u.given)
    for (const Nominal* n :
         {&u.scanner_form_mm, &u.scanner_form_length_mm, &u.scanner_length_ppm, &u.reference_mm, &u.reference_rad})
      count += n->confirmed ? 0 : 1;
  const ThermalSettings& thermal = recipe.thermal;
  if (thermal.given)
    for (const Nominal* n : {&thermal.reference_c, &thermal.cte_per_K, &thermal.u_cte_per_K, &thermal.u_temperature_K,
                             &thermal.unknown_low_c})
      count += n->confirmed ? 0 : 1;
  for (const Tolerance& t : recipe.tolerances) {
    if (!has_value(t.lower) && !has_value(t.upper)) continue;
    count += (t.confirmed && t.nominal.confirmed) ? 0 : 1;
  }
  return count;
}

Item blank_item(const Recipe& recipe, ItemId id, int station, int station_to) {
  const Tolerance& t = recipe.tolerance(id);
  Item item;
  item.id = id;
  item.verdict = Verdict::not_measured;
  item.required = t.required;
  item.station = static_cast<std::uint8_t>(station);
  item.station_to = static_cast<std::uint8_t>(station_to);
  item.nominal = t.nominal.value;
  item.lower = t.lower;
  item.upper = t.upper;
  item.U = t.U;
  return item;
}

}  // namespace slabd
