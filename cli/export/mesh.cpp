// SPDX-License-Identifier: Apache-2.0
//
// The block is a profile across the rail (side, shoulder, jaw, seat, jaw, shoulder, side) between two end faces. Every
// corner of the profile gives two vertices, where its line along the rail meets the end faces; the end faces are cut
// into strips down to the slab's top. Each half of the seat contains a casing: a rim below (or above) the seat and a
// bore in it.
//
// Invariant: the surface is closed. Every edge belongs to two triangles that traverse it in opposite directions.
// Strips therefore end at vertices that the neighbouring face also has.
#include "cli/export/mesh.h"

#include <array>
#include <cmath>
#include <cstring>
#include <numbers>

#include "algo/algo.h"
#include "algo/block_model.h"
#include "base/durable.h"

namespace slabd::cli {
namespace {

using algo::BlockModel;
using algo::Face;
using Index = std::uint32_t;

/// Segments of a casing's circle; each quarter has a whole number of them.
constexpr Index kSegments = 64;
constexpr double kBoreShown = 0.6;

struct ProfilePoint {
  double y = 0.0;
  double z = 0.0;
};

/// Intersection of two faces along the rail in the section x = 0.
ProfilePoint meet(const BlockModel& model, Face a, Face b) {
  const algo::Plane& p = model.plane(a);
  const algo::Plane& q = model.plane(b);
  const double det = p.n.y() * q.n.z() - p.n.z() * q.n.y();
  return {(p.d * q.n.z() - p.n.z() * q.d) / det, (p.n.y() * q.d - p.d * q.n.y()) / det};
}

class BlockMesh {
 public:
  explicit BlockMesh(const Recipe& recipe) : geometry_(recipe.block) { model_.build(recipe.block); }

  Result<Mesh> build() {
    profile_ = {meet(model_, Face::side_inner, Face::top),
                meet(model_, Face::side_inner, Face::shoulder_inner),
                meet(model_, Face::shoulder_inner, Face::jaw_inner),
                meet(model_, Face::jaw_inner, Face::seat),
                ProfilePoint{0.0, 0.0},
                meet(model_, Face::jaw_outer, Face::seat),
                meet(model_, Face::shoulder_outer, Face::jaw_outer),
                meet(model_, Face::side_outer, Face::shoulder_outer),
                meet(model_, Face::side_outer, Face::top)};
    if (Status drawable = check(); !drawable) return drawable.error();
    for (std::size_t i = 0; i < kPoints; ++i) {
      for (const std::size_t side : {0U, 1U}) {
        top_[i][side] = add(at(profile_[i].y, profile_[i].z, side));
        // The profile begins and ends on the slab's top, where corner and foot are one vertex.
        foot_[i][side] = i == 0 || i + 1 == kPoints ? top_[i][side] : add(at(profile_[i].y, bottom(), side));
      }
    }
    for (std::size_t i = 0; i + 1 < kPoints; ++i) {
      if (i == kSeatInner || i == kSeatOuter)
        seat_half(i);
      else
        quad(top_[i][0], top_[i][1], top_[i + 1][1], top_[i + 1][0]);
      quad(foot_[i][0], foot_[i + 1][0], foot_[i + 1][1], foot_[i][1]);
      quad(foot_[i][1], foot_[i + 1][1], top_[i + 1][1], top_[i][1]);
      quad(top_[i][0], top_[i + 1][0], foot_[i + 1][0], foot_[i][0]);
    }
    return std::move(mesh_);
  }

 private:
  static constexpr std::size_t kPoints = 9;
  static constexpr std::size_t kSeatInner = 3;
  static constexpr std::size_t kSeatOuter = 4;
  using Circle = std::array<Index, kSegments>;

  [[nodiscard]] double bottom() const { return profile_.front().z; }
  /// Point on the end face at x < 0 (side 0) or x > 0.
  [[nodiscard]] Vec3 at(double y, double z, std::size_t side) const {
    const algo::Plane& end = model_.plane(Face::end_plus);
    const double x = (end.d - end.n.z() * z) / end.n.x();
    return {side == 0 ? -x : x, y, z};
  }

  Status check() const {
    for (std::size_t i = 0; i + 1 < kPoints; ++i)
      if (!(profile_[i].y < profile_[i + 1].y))
        return error(Code::config,
                     "the recipe's block cannot be drawn: corner %zu of its profile (y = %.3f mm) does not lie "
                     "outward of corner %zu (y = %.3f mm)",
                     i + 2, profile_[i + 1].y, i + 1, profile_[i].y);
    const double rim = 0.5 * geometry_.casing_rim_diameter_mm.value;
    const double centre = geometry_.casing_half_spacing_mm.value;
    const bool along = rim < at(0.0, profile_[kSeatOuter + 1].z, 1).x();
    const bool across = centre - rim > 0.0 && centre + rim < std::hypot(profile_[5].y, profile_[5].z) &&
                        centre + rim < std::hypot(profile_[3].y, profile_[3].z);
    if (!along || !across || geometry_.casing_bore_diameter_mm.value >= geometry_.casing_rim_diameter_mm.value)
      return error(Code::config, "the recipe's block cannot be drawn: its casings do not lie on the seat");
    return success();
  }

  Index add(const Vec3& p) {
    mesh_.vertices.push_back(p);
    return static_cast<Index>(mesh_.vertices.size() - 1);
  }
  /// Adds nothing if two of the corners are equal.
  void triangle(Index a, Index b, Index c) {
    if (a != b && b != c && c != a) mesh_.triangles.push_back({a, b, c});
  }
  void quad(Index a, Index b, Index c, Index d) {
    triangle(a, b, c);
    triangle(a, c, d);
  }

  Circle circle(const Vec3& centre, double radius) {
    Circle ring{};
    for (Index k = 0; k < kSegments; ++k) {
      const double angle = 2.0 * std::numbers::pi * k / kSegments;
      ring[k] = add(centre + radius * (std::cos(angle) * Vec3::UnitX() + std::sin(angle) * model_.along_seat()));
    }
    return ring;
  }
  void band(const Circle& from, const Circle& to) {
    for (Index k = 0; k < kSegments; ++k) {
      const Index next = (k + 1) % kSegments;
      quad(from[k], from[next], to[next], to[k]);
    }
  }

  void seat_half(std::size_t i) {
    const Vec3 centre = model_.casing_centre(i == kSeatOuter);
    const Vec3 n = model_.plane(Face::seat).n;
    const Vec3 rim_centre = centre + geometry_.casing_rim_height_mm.value * n;
    const double rim = 0.5 * geometry_.casing_rim_diameter_mm.value;
    const double bore = 0.5 * geometry_.casing_bore_diameter_mm.value;
    const Circle edge = circle(centre, rim);
    around({top_[i][0], top_[i][1], top_[i + 1][1], top_[i + 1][0]}, centre, edge);
    const Circle rim_outside = circle(rim_centre, rim);
    const Circle rim_inside = circle(rim_centre, bore);
    const Vec3 floor_centre = centre + kBoreShown * bottom() * n;
    const Circle floor = circle(floor_centre, bore);
    band(edge, rim_outside);
    band(rim_outside, rim_inside);
    band(rim_inside, floor);
    const Index middle = add(floor_centre);
    for (Index k = 0; k < kSegments; ++k) triangle(floor[k], floor[(k + 1) % kSegments], middle);
  }

  /// Adds the face between four corners and a circle in it: from each corner a fan to its nearest arc, and a triangle
  /// on each side between two fans.
  void around(const std::array<Index, 4>& corners, const Vec3& centre, const Circle& ring) {
    const auto angle_of = [&](const Vec3& p) {
      const Vec3 d = p - centre;
      return std::atan2(model_.along_seat().dot(d), d.x());
    };
    std::array<Index, 4> end{};  // end of the arc between corner j and the next one
    for (std::size_t j = 0; j < 4; ++j) {
      const Vec3 middle = 0.5 * (mesh_.vertices[corners[j]] + mesh_.vertices[corners[(j + 1) % 4]]);
      const double turn = angle_of(middle) / (2.0 * std::numbers::pi);
      end[j] = static_cast<Index>(std::lround((turn - std::floor(turn)) * kSegments)) % kSegments;
      triangle(corners[j], corners[(j + 1) % 4], ring[end[j]]);
    }
    for (std::size_t j = 0; j < 4; ++j)
      for (Index k = end[(j + 3) % 4]; k != end[j]; k = (k + 1) % kSegments)
        triangle(corners[j], ring[(k + 1) % kSegments], ring[k]);
  }

  BlockGeometry geometry_;
  BlockModel model_;
  Mesh mesh_;
  std::array<ProfilePoint, kPoints> profile_{};
  std::array<std::array<Index, 2>, kPoints> top_{};   ///< [side]: x < 0, x > 0
  std::array<std::array<Index, 2>, kPoints> foot_{};  ///< below it on the slab's top
};

void append(Mesh& mesh, const Mesh& part, const Pose& pose) {
  const auto first = static_cast<Index>(mesh.vertices.size());
  for (const Vec3& p : part.vertices) mesh.vertices.push_back(pose * p);
  for (const auto& [a, b, c] : part.triangles) mesh.triangles.push_back({first + a, first + b, first + c});
}

Mesh box(const Vec3& low, const Vec3& high) {
  Mesh mesh;
  for (unsigned i = 0; i < 8; ++i)
    mesh.vertices.emplace_back((i & 1U) != 0 ? high.x() : low.x(), (i & 2U) != 0 ? high.y() : low.y(),
                               (i & 4U) != 0 ? high.z() : low.z());
  constexpr std::array<std::array<Index, 4>, 6> kSides = {
      {{0, 2, 3, 1}, {4, 5, 7, 6}, {0, 1, 5, 4}, {2, 6, 7, 3}, {0, 4, 6, 2}, {1, 3, 7, 5}}};
  for (const auto& [a, b, c, d] : kSides) {
    mesh.triangles.push_back({a, b, c});
    mesh.triangles.push_back({a, c, d});
  }
  return mesh;
}

void put_floats(std::string& bytes, const Vec3& p) {
  for (const double x : {p.x(), p.y(), p.z()}) {
    const auto value = static_cast<float>(x);
    std::array<char, sizeof value> raw{};
    std::memcpy(raw.data(), &value, sizeof value);
    bytes.append(raw.data(), raw.size());
  }
}

void put_u32(std::string& bytes, std::uint32_t value) {
  std::array<char, sizeof value> raw{};
  std::memcpy(raw.data(), &value, sizeof value);
  bytes.append(raw.data(), raw.size());
}

std::string stl(const Mesh& mesh, const std::string& title) {
  // Never "solid": that is how the text form begins.
  std::string bytes = ("slabd " + title).substr(0, 80);
  bytes.resize(80, ' ');
  put_u32(bytes, static_cast<std::uint32_t>(mesh.triangles.size()));
  for (const auto& [a, b, c] : mesh.triangles) {
    const Vec3& p = mesh.vertices[a];
    put_floats(bytes, (mesh.vertices[b] - p).cross(mesh.vertices[c] - p).normalized());
    for (const Index corner : {a, b, c}) put_floats(bytes, mesh.vertices[corner]);
    bytes.append(2, '\0');
  }
  return bytes;
}

std::string ply(const Mesh& mesh, const std::string& title) {
  std::string bytes = "ply\nformat binary_little_endian 1.0\ncomment slabd " + title +
                      "\ncomment unit mm\nelement vertex " + std::to_string(mesh.vertices.size()) +
                      "\nproperty float x\nproperty float y\nproperty float z\nelement face " +
                      std::to_string(mesh.triangles.size()) + "\nproperty list uchar int vertex_indices\nend_header\n";
  for (const Vec3& p : mesh.vertices) put_floats(bytes, p);
  for (const auto& [a, b, c] : mesh.triangles) {
    bytes += '\3';
    for (const Index corner : {a, b, c}) put_u32(bytes, corner);
  }
  return bytes;
}

}  // namespace

Result<Mesh> block_mesh(const Recipe& recipe) {
  return BlockMesh(recipe).build();
}

Result<Mesh> slab_mesh(const Recipe& recipe) {
  const Result<Mesh> block = block_mesh(recipe);
  if (!block) return block;
  const SlabGeometry& slab = recipe.slab;
  const Vec3 half(0.5 * slab.length_mm.value, 0.5 * slab.width_mm.value, 0.0);
  Mesh mesh = box(-half - Vec3(0.0, 0.0, slab.thickness_mm.value), half);
  for (int station = 1; station <= recipe.stations(); ++station)
    append(mesh, block.value(), T_slab_block(recipe, station));
  return mesh;
}

Status write_mesh(const std::string& path, const Mesh& mesh, const std::string& title) {
  const bool is_stl = path.ends_with(".stl") || path.ends_with(".STL");
  if (!is_stl && !path.ends_with(".ply") && !path.ends_with(".PLY"))
    return error(Code::config, "%s: allowed are .stl and .ply", path.c_str());
  OutFile out(path);
  out.write(is_stl ? stl(mesh, title) : ply(mesh, title));
  return out.close();
}

}  // namespace slabd::cli
