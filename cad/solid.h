// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <map>
#include <string>

#include "cad/order.h"

class TopoDS_Shape;

namespace slabd::cad {

/// The ordered model as one closed solid, and its named faces: `seat`, `jaw_inner`, `jaw_outer`, `casing_inner`,
/// `casing_outer` with the block's suffix, and `slab_top`. For a single block slab_top is the face that it rests on, in
/// the plane of the slab's top. Shoulders, end faces, sides and rims have no name. config: it cannot be built.
[[nodiscard]] Status build_solid(const ModelOrder& order, TopoDS_Shape& solid,
                                 std::map<std::string, TopoDS_Shape>& faces);

}  // namespace slabd::cad
