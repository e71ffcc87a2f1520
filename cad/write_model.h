// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <iosfwd>

#include "cad/order.h"

/// CAD files of an ordered model.
namespace slabd::cad {

enum class Form : std::uint8_t {
  step_ap242,  ///< ISO 10303-242, the only one with tolerances
  step_ap214,  ///< ISO 10303-214
  iges,        ///< IGES 5.3, solids as B-rep entities
};

/// Number of faces and the volume of what was written.
struct WrittenModel {
  int faces = 0;
  double volume_mm3 = 0.0;
};

/// Builds the solid and writes it, in mm, with named faces. config: the geometry cannot be built (with the reason); the
/// stream may then contain the beginning of a file.
[[nodiscard]] Result<WrittenModel> write_model(const ModelOrder& order, Form form, std::ostream& out);

}  // namespace slabd::cad
