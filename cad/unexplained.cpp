// SPDX-License-Identifier: Apache-2.0
#include "cad/unexplained.h"

#include <fmt/core.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <set>
#include <string>

namespace slabd::cad {
namespace {

constexpr double kSame_mm = 2e-3;
constexpr double kAreaMin_mm2 = 1.0;
/// Faces of a block are nearer to its origin than this.
constexpr double kReach_mm = 420.0;
constexpr double kBlendMax_mm = 15.0;  ///< largest radius of a fillet
constexpr double kFreeFormMin_mm = 40.0;
constexpr std::size_t kRemarksMax = 12;

struct Plane {
  Vec3 p;
  Vec3 n;
};
struct Cylinder {
  Vec3 p;
  Vec3 axis;
  double radius_mm;
};

/// Distance of a point from a line.
double off_axis(const Vec3& point, const Vec3& p, const Vec3& axis) {
  const Vec3 off = point - p;
  return (off - off.dot(axis) * axis).norm();
}

double extent(const ModelFace& face) {
  double largest = 0.0;
  for (const Vec3& a : face.corners)
    for (const Vec3& b : face.corners) largest = std::max(largest, (a - b).norm());
  return largest;
}

/// Surfaces that one block has by the numbers found, at the place where it was found.
class Explained {
 public:
  Explained(const FoundBlock& block, const std::map<std::string, double>& numbers, double reference_mm)
      : block_(block), numbers_(numbers) {
    if (!has("cant_ratio")) return;
    const double cant = std::atan(1.0 / number("cant_ratio"));
    along_ = std::cos(cant) * block.y + std::sin(cant) * block.z;
    n_ = -std::sin(cant) * block.y + std::cos(cant) * block.z;
    planes_.push_back({block.origin, n_});
    add_jaws(reference_mm);
    add_level("shoulder_inner_z_mm");
    add_level("shoulder_outer_z_mm");
    add_level("slab_top_z_mm");
    add_walls("end_half_length_mm", block.x);
    add_walls("side_half_width_mm", block.y);
    add_casings();
  }

  [[nodiscard]] bool explains(const ModelFace& face) const {
    if ((face.centre - block_.origin).norm() > kReach_mm) return false;
    if (face.kind == FaceKind::plane)
      return std::any_of(planes_.begin(), planes_.end(), [&](const Plane& plane) { return lies_on(face, plane); }) ||
             is_floor_of_a_casing(face) || is_chamfer(face);
    return std::any_of(cylinders_.begin(), cylinders_.end(), [&](const Cylinder& cylinder) {
      return parallel(face.n, cylinder.axis) && std::abs(face.radius_mm - cylinder.radius_mm) < kSame_mm &&
             off_axis(face.p + (face.centre - face.p).dot(face.n) * face.n, cylinder.p, cylinder.axis) < kSame_mm;
    });
  }
  [[nodiscard]] const Vec3& normal() const { return n_; }

  static bool lies_on(const ModelFace& face, const Plane& plane) {
    return parallel(face.n, plane.n) && std::abs(plane.n.dot(face.centre - plane.p)) < kSame_mm;
  }

 private:
  [[nodiscard]] bool has(const char* key) const { return numbers_.contains(std::string("block.") + key); }
  [[nodiscard]] double number(const char* key) const { return numbers_.at(std::string("block.") + key); }

  void add_jaws(double reference_mm) {
    if (!has("jaw_half_distance_mm") || !has("jaw_angle_deg")) return;
    const double angle = rad_from_deg(number("jaw_angle_deg"));
    for (const double sign : {-1.0, 1.0})
      planes_.push_back({block_.origin + sign * number("jaw_half_distance_mm") * along_ + reference_mm * n_,
                         -std::sin(angle) * sign * along_ - std::cos(angle) * n_});
  }
  void add_level(const char* key) {
    if (has(key)) planes_.push_back({block_.origin + number(key) * block_.z, block_.z});
  }
  void add_walls(const char* key, const Vec3& axis) {
    if (!has(key) || !has("draft_deg")) return;
    const double draft = rad_from_deg(number("draft_deg"));
    for (const double sign : {-1.0, 1.0})
      planes_.push_back(
          {block_.origin + sign * number(key) * axis, sign * std::cos(draft) * axis + std::sin(draft) * block_.z});
  }
  void add_casings() {
    if (!has("casing_half_spacing_mm")) return;
    for (const double sign : {-1.0, 1.0}) {
      axes_.push_back(block_.origin + sign * number("casing_half_spacing_mm") * along_);
      for (const char* key : {"casing_bore_diameter_mm", "casing_rim_diameter_mm"})
        if (has(key)) cylinders_.push_back({axes_.back(), n_, 0.5 * number(key)});
    }
    if (has("casing_rim_height_mm")) planes_.push_back({block_.origin + number("casing_rim_height_mm") * n_, n_});
  }

  [[nodiscard]] bool is_floor_of_a_casing(const ModelFace& face) const {
    if (!has("casing_bore_diameter_mm") || !parallel(face.n, n_)) return false;
    const double radius = 0.5 * number("casing_bore_diameter_mm");
    return face.area_mm2 < 1.01 * kPi * radius * radius && std::any_of(axes_.begin(), axes_.end(), [&](const Vec3& at) {
             return off_axis(face.centre, at, n_) < 0.1 && n_.dot(face.centre - at) < -radius;
           });
  }

  [[nodiscard]] bool is_chamfer(const ModelFace& face) const {
    const auto chamfer = block_.values.find("edges.chamfer_mm");
    return chamfer != block_.values.end() && std::find(chamfer->second.faces.begin(), chamfer->second.faces.end(),
                                                       face.number) != chamfer->second.faces.end();
  }

  const FoundBlock& block_;
  const std::map<std::string, double>& numbers_;
  Vec3 along_ = Vec3::Zero();
  Vec3 n_ = Vec3::Zero();
  std::vector<Plane> planes_;
  std::vector<Cylinder> cylinders_;
  std::vector<Vec3> axes_;
};

/// Planes of the slab's body: the faces that its numbers are from, the tops under the blocks included.
std::vector<Plane> body_planes(const FaceList& model, const std::vector<FoundBlock>& blocks, const Findings& findings) {
  std::set<int> numbers;
  for (const FoundBlock& block : blocks) numbers.insert(block.top_face);
  for (const FoundValue& value : findings.found)
    for (const char* key : {"slab.length_mm", "slab.width_mm", "slab.thickness_mm"})
      if (value.key == key) numbers.insert(value.faces.begin(), value.faces.end());
  std::vector<Plane> planes;
  for (const ModelFace& face : model.faces)
    if (numbers.contains(face.number) && face.kind == FaceKind::plane) planes.push_back({face.centre, face.n});
  return planes;
}

/// A fillet, or a small free-form face between fillets.
bool is_blend(const ModelFace& face, const std::vector<Explained>& explained) {
  if (face.kind == FaceKind::other) return extent(face) < kFreeFormMin_mm;
  if (face.kind != FaceKind::cylinder || face.radius_mm > kBlendMax_mm) return false;
  return std::none_of(explained.begin(), explained.end(),
                      [&](const Explained& one) { return face.n.cross(one.normal()).norm() < 1e-3; });
}

std::string described(const ModelFace& face) {
  switch (face.kind) {
    case FaceKind::plane: return fmt::format("a plane of {:.0f} mm2", face.area_mm2);
    case FaceKind::cylinder:
      return fmt::format("a {} of diameter {:.2f} mm", face.hollow ? "hole" : "cylinder", 2.0 * face.radius_mm);
    case FaceKind::other: break;
  }
  return fmt::format("a free-form face of {:.0f} mm2", face.area_mm2);
}

}  // namespace

void remark_unexplained(const FaceList& model, const std::vector<FoundBlock>& blocks, double reference_mm,
                        Findings& findings) {
  std::map<std::string, double> numbers;
  for (const FoundValue& value : findings.found) numbers[value.key] = value.value;
  std::vector<Explained> explained;
  explained.reserve(blocks.size());
  for (const FoundBlock& block : blocks) explained.emplace_back(block, numbers, reference_mm);
  const std::vector<Plane> body = body_planes(model, blocks, findings);
  std::size_t count = 0;
  for (const ModelFace& face : model.faces) {
    if (face.area_mm2 < kAreaMin_mm2 || is_blend(face, explained)) continue;
    if (std::any_of(explained.begin(), explained.end(), [&](const Explained& one) { return one.explains(face); }))
      continue;
    if (face.kind == FaceKind::plane &&
        std::any_of(body.begin(), body.end(), [&](const Plane& plane) { return Explained::lies_on(face, plane); }))
      continue;
    if (++count > kRemarksMax) continue;
    std::size_t nearest = 0;
    for (std::size_t i = 1; i < blocks.size(); ++i)
      if ((face.centre - blocks[i].origin).norm() < (face.centre - blocks[nearest].origin).norm()) nearest = i;
    const Vec3 off = face.centre - blocks[nearest].origin;
    findings.remarks.push_back(fmt::format(
        "face {}, {}, is not explained by the numbers found: {:.1f} mm along the rail, {:.1f} mm outward and {:.1f} mm "
        "above the seat's middle{}",
        face.number, described(face), off.dot(blocks[nearest].x), off.dot(blocks[nearest].y),
        off.dot(blocks[nearest].z), blocks.size() > 1 ? fmt::format(" of block {}", nearest + 1) : ""));
  }
  if (count > kRemarksMax)
    findings.remarks.push_back(
        fmt::format("{} more faces are not explained by the numbers found", count - kRemarksMax));
}

}  // namespace slabd::cad
