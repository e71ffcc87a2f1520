// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "base/base.h"

/// The order of slabctl to slabd-cad: the JSON document slabd.cad_model/1 (docs/schemas/cad_model.json).
namespace slabd::cad {

/// One block to draw: its geometry, and its place in the frame of the file.
struct OrderedBlock {
  std::string suffix;  ///< of the names of its faces: "_7"; empty for a single block
  Pose pose;
  BlockGeometry geometry;
};

/// One tolerance as semantic PMI. `faces` has one name for a flatness and two for a distance or an angle.
struct OrderedPmi {
  enum class Kind : std::uint8_t { flatness, distance, angle };
  Kind kind = Kind::flatness;
  std::string name;
  std::vector<std::string> faces;
  double nominal = 0.0;  ///< mm, or degrees
  double lower = 0.0;    ///< lowest permitted value
  double upper = 0.0;    ///< highest permitted value; of a flatness the only number
};

struct ModelOrder {
  std::string name;         ///< of the part
  std::string description;  ///< source, such as the recipe and its SHA-256
  std::vector<OrderedBlock> blocks;
  bool has_slab = false;  ///< the slab's body below the blocks, its top at z = 0, centred at x = y = 0
  double length_mm = 0.0;
  double width_mm = 0.0;
  double thickness_mm = 0.0;
  std::vector<OrderedPmi> pmi;
};

/// Reads the document. config: it is not such a document, or its numbers are not finite.
[[nodiscard]] Result<ModelOrder> parse_order(const std::string& text);

}  // namespace slabd::cad
