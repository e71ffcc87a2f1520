// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <string>
#include <vector>

#include "base/base.h"

/// A CAD model as its faces, without OpenCASCADE. mm, in the file's own frame.
namespace slabd::cad {

enum class FaceKind : std::uint8_t { plane, cylinder, other };

/// A circular edge of a plane face.
struct Circle {
  Vec3 centre = Vec3::Zero();
  double radius_mm = 0.0;
};

struct ModelFace {
  int number = 0;  ///< from 1, in the order of the file
  FaceKind kind = FaceKind::other;
  Vec3 p = Vec3::Zero();       ///< point of the plane or the axis
  Vec3 n = Vec3::UnitZ();      ///< normal of the plane to the free side, or direction of the axis; unit length
  double radius_mm = 0.0;      ///< of a cylinder
  bool hollow = false;         ///< the material is outside of the cylinder
  Vec3 centre = Vec3::Zero();  ///< centre of area
  double area_mm2 = 0.0;
  std::vector<Circle> circles;
  std::vector<Vec3> corners;                   ///< points of the boundary
  std::vector<std::array<Vec3, 3>> triangles;  ///< for the picture
};

/// Sine of the angle of directions that count as parallel.
inline constexpr double kParallel = 1e-5;

[[nodiscard]] inline bool parallel(const Vec3& a, const Vec3& b) {
  return a.cross(b).norm() < kParallel;
}

struct FaceList {
  std::vector<ModelFace> faces;
  std::string unit;        ///< of the file, as it names it: "millimetre", "INCH"
  bool has_sides = false;  ///< normals point to the free side; false for loose faces that do not close
  int solids = 0;
};

}  // namespace slabd::cad
