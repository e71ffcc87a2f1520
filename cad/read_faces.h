// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "cad/faces.h"

namespace slabd::cad {

/// Reads a STEP or IGES file into its faces: all solids and loose faces, with the placements of assemblies, in mm.
/// Neighbouring faces of one surface are joined. config: not such a file, or without surfaces, as a tessellated model.
/// A damaged file may end the process.
[[nodiscard]] Result<FaceList> read_faces(const std::string& path, bool iges);

}  // namespace slabd::cad
