// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "cad/faces.h"

/// Finds the supporting blocks of a slab in a CAD model by geometry. Names, layers, colours and the order of the faces
/// have no effect. Pure.
namespace slabd::cad {

/// A number of a recipe ("block.cant_ratio"), in the recipe's unit, and the faces that it is from.
struct FoundValue {
  std::string key;
  double value = 0.0;
  std::vector<int> faces;
  std::string note;  ///< how it follows from the faces
};

struct MissingValue {
  std::string key;
  std::string why;
};

/// A face that has a meaning: "seat_3".
struct NamedFace {
  std::string name;
  int face = 0;
};

struct Findings {
  int blocks = 0;
  std::vector<FoundValue> found;
  std::vector<MissingValue> not_found;
  std::vector<std::string> remarks;  ///< of what a person must look at
  std::vector<NamedFace> names;
};

/// `reference_mm`: the height above the seat at which the distance of the jaws is stated.
[[nodiscard]] Findings find_slab(const FaceList& model, double reference_mm);

/// The document slabd.cad_findings/1. `confined`: the process has its filter of system calls.
[[nodiscard]] std::string findings_json(const FaceList& model, const Findings& findings, bool confined);

}  // namespace slabd::cad
