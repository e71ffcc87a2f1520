// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "base/design.h"

/// The model of a recipe as an order to slabd-cad: the document slabd.cad_model/1.
namespace slabd::cli {

struct ModelChoice {
  bool block = false;  ///< one block in its own frame instead of the slab
  int station = 0;     ///< of the block: its design, if the slab has one; 0 without
  bool pmi = false;    ///< with the recipe's tolerances
};

/// Only the tolerances between faces that have a name are semantic PMI: of block scope seat_slope, seat_flatness,
/// jaw_angle_inner, jaw_angle_outer, jaw_distance and casing_spacing, of the slab seat_spacing (between the outer
/// casings of neighbours). Items without limits are left out.
[[nodiscard]] std::string model_order(const Recipe& recipe, const SlabDesign& design, const ModelChoice& choice,
                                      const std::string& name);

}  // namespace slabd::cli
