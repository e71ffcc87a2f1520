// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "base/recipe.h"
#include "base/result.h"

/// The recipe's block and slab as surfaces of triangles (paper Figs. 2 and 8), mm.
namespace slabd::cli {

struct Mesh {
  std::vector<Vec3> vertices;
  std::vector<std::array<std::uint32_t, 3>> triangles;  ///< counter-clockwise seen from outside
};

/// The block as drawn, in its own frame, closed: from the slab's top up, with both casings' rims and bores. How deep a
/// bore is the recipe does not say; it is shown down to six tenths of the way to the slab's top. config: the faces do
/// not meet in the order of a block.
[[nodiscard]] Result<Mesh> block_mesh(const Recipe& recipe);
/// The slab as a box and all blocks on it, in the slab frame; every one of them a closed surface of its own.
[[nodiscard]] Result<Mesh> slab_mesh(const Recipe& recipe);

/// `path` ends with .stl (binary) or .ply (binary, little-endian, shared vertices). `title` goes into the header.
/// config: another extension, or it cannot be written; nothing is left then.
[[nodiscard]] Status write_mesh(const std::string& path, const Mesh& mesh, const std::string& title);

}  // namespace slabd::cli
