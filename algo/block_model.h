// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

#include "base/base.h"

/// The block as planes. All in the block frame (mm): X along the rail, Y outward, Z up.
namespace slabd::algo {

/// The faces visible to a scan from above. The order decides ties between faces at equal distance.
enum class Face : std::uint8_t {
  seat,
  jaw_inner,
  jaw_outer,
  shoulder_inner,
  shoulder_outer,
  end_minus,
  end_plus,
  side_inner,
  side_outer,
  top,
  rim_inner,
  rim_outer,
};
inline constexpr std::size_t kFaces = 12;
inline constexpr std::uint16_t kAllFaces = (1U << kFaces) - 1U;
[[nodiscard]] std::string_view name(Face face);
[[nodiscard]] constexpr std::uint16_t bit(Face face) {
  return static_cast<std::uint16_t>(1U << static_cast<unsigned>(face));
}

/// Faces that determine the pose. A rim is excluded: it is not part of the casting, and a cover on it, such as mortar,
/// water or a cap, must not cost the block its pose.
inline constexpr std::uint16_t kPoseFaces =
    static_cast<std::uint16_t>(kAllFaces & ~(bit(Face::rim_inner) | bit(Face::rim_outer)));

/// Plane n.p = d; n has unit length and points to the free side.
struct Plane {
  Vec3 n = Vec3::UnitZ();
  double d = 0.0;
  [[nodiscard]] double distance(const Vec3& p) const { return n.x() * p.x() + n.y() * p.y() + n.z() * p.z() - d; }
  /// Height of the plane at (x, y). The plane must not be vertical.
  [[nodiscard]] double z_at(double x, double y) const { return (d - n.x() * x - n.y() * y) / n.z(); }
};

class BlockModel {
 public:
  /// Computes the planes from nominals; no heap.
  void build(const BlockGeometry& geometry);

  [[nodiscard]] const Plane& plane(Face face) const { return planes_[static_cast<std::size_t>(face)]; }
  [[nodiscard]] const std::array<Plane, kFaces>& planes() const { return planes_; }
  [[nodiscard]] const BlockGeometry& geometry() const { return geometry_; }

  /// Unit vector across the rail along the bearing plane, rising outward.
  [[nodiscard]] const Vec3& along_seat() const { return along_seat_; }
  /// Nominal centre of a casing on the bearing plane.
  [[nodiscard]] Vec3 casing_centre(bool outer) const;

  /// Computes the face visible from above at (x, y) and its height. Returns false inside a casing's bore.
  /// z = max(slab top, min(ends, sides, shoulder, max(bearing plane, jaw))), with the casings cut in.
  [[nodiscard]] bool visible(double x, double y, Face& face, double& z) const;

 private:
  BlockGeometry geometry_;
  std::array<Plane, kFaces> planes_;
  Vec3 along_seat_ = Vec3::UnitY();
};

/// Faces near a position: for each 1 mm cell of (x, y), the faces visible within a wide and within a near distance. A
/// point's face is then found by one lookup and a few plane distances.
class FaceTable {
 public:
  /// Reach of the wide set, which bounds the error of the start pose. The near set is for a pose already found.
  static constexpr int kWide_mm = 25;
  static constexpr int kNear_mm = 2;
  static constexpr std::size_t kCells = limits::kFaceTableX * limits::kFaceTableY;

  /// `wide`, `near`: kCells each, owned by the caller. `scratch`: kCells.
  void build(const BlockModel& model, std::span<std::uint16_t> wide, std::span<std::uint16_t> near,
             std::span<std::uint16_t> scratch);

  /// Bits of faces; 0 outside the table.
  [[nodiscard]] std::uint16_t wide_at(const Vec3& p) const { return at(wide_, p); }
  [[nodiscard]] std::uint16_t near_at(const Vec3& p) const { return at(near_, p); }
  /// All cells, row by row.
  [[nodiscard]] std::span<const std::uint16_t> wide() const { return wide_; }
  [[nodiscard]] std::span<const std::uint16_t> near() const { return near_; }
  [[nodiscard]] static bool inside(const Vec3& p) {
    return p.x() >= -kHalfX && p.x() < kHalfX && p.y() >= -kHalfY && p.y() < kHalfY;
  }

 private:
  static constexpr double kHalfX = 0.5 * static_cast<double>(limits::kFaceTableX);
  static constexpr double kHalfY = 0.5 * static_cast<double>(limits::kFaceTableY);
  [[nodiscard]] static std::uint16_t at(std::span<const std::uint16_t> table, const Vec3& p) {
    if (!inside(p)) return 0;
    return table[static_cast<std::size_t>(p.y() + kHalfY) * limits::kFaceTableX +
                 static_cast<std::size_t>(p.x() + kHalfX)];
  }
  std::span<const std::uint16_t> wide_;
  std::span<const std::uint16_t> near_;
};

/// Finds the face of `candidates` whose plane is closest to `p`; `distance` is signed. False without candidates.
[[nodiscard]] inline bool closest_face(const std::array<Plane, kFaces>& planes, std::uint16_t candidates, const Vec3& p,
                                       Face& face, double& distance) {
  if (candidates == 0) return false;
  double best = 1e300;
  for (unsigned left = candidates; left != 0; left &= left - 1) {
    const auto f = static_cast<unsigned>(__builtin_ctz(left));
    const double r = planes[f].distance(p);
    if (std::abs(r) < best) {
      best = std::abs(r);
      distance = r;
      face = static_cast<Face>(f);
    }
  }
  return best < 1e300;
}

}  // namespace slabd::algo
