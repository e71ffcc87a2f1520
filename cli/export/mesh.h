// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "base/recipe.h"
#include "base/result.h"

/// The recipe's block and slab as triangle meshes (paper Figs. 2 and 8), mm.
namespace slabd::cli {

struct Mesh {
  std::vector<Vec3> vertices;
  std::vector<std::array<std::uint32_t, 3>> triangles;  ///< counter-clockwise when seen from outside
};

/// The block as drawn, in its own frame, closed: from the slab's top up, with both casings' rims and bores. The recipe
/// does not contain the depth of a bore; it is drawn to six tenths of the way to the slab's top. Code::config: the
/// faces do not meet in the order of a block.
[[nodiscard]] Result<Mesh> block_mesh(const Recipe& recipe);
/// The slab as a box and all blocks on it, in the slab frame, each as a separate closed surface.
[[nodiscard]] Result<Mesh> slab_mesh(const Recipe& recipe);

/// Writes .stl (binary) or .ply (binary, little-endian, shared vertices), by the extension of `path`. `title` is
/// written to the header. Code::config: another extension, or the file cannot be written; in that case no partial file
/// remains.
[[nodiscard]] Status write_mesh(const std::string& path, const Mesh& mesh, const std::string& title);

}  // namespace slabd::cli
