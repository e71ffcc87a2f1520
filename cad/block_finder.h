// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <map>
#include <string>
#include <vector>

#include "cad/finder.h"

namespace slabd::cad {

/// One number of one block, and its faces.
struct BlockValue {
  double value = 0.0;
  std::vector<int> faces;
};

/// A block that was found: its frame, its numbers by key of the recipe's table [block], and what it lacks.
struct FoundBlock {
  Vec3 origin = Vec3::Zero();
  Vec3 x = Vec3::UnitX();  ///< along the rail
  Vec3 y = Vec3::UnitY();  ///< outward
  Vec3 z = Vec3::UnitZ();  ///< up, normal of the slab's top
  std::map<std::string, BlockValue> values;
  std::map<std::string, std::string> missing;  ///< key, reason
  std::vector<NamedFace> names;                ///< without the block's number
  std::vector<double> radii_mm;                ///< of its fillets and chamfers
  int top_face = 0;                            ///< face of the slab's top; 0 if it was not found
  bool top_is_foot = false;                    ///< it is the face on which the block rests
  int score = 0;                               ///< features that were found
};

/// All blocks of the model, each seat once.
[[nodiscard]] std::vector<FoundBlock> find_blocks(const FaceList& model, double reference_mm);

}  // namespace slabd::cad
