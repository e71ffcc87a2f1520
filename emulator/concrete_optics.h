// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "base/base.h"
#include "emulator/block_drawing.h"
#include "emulator/concrete_block.h"

/// Geometry of the scanner: positions of cameras and projector, the ray of a pixel, and the point that it hits.
namespace slabd::emulator {

/// The point that a pixel sees, without errors.
struct Seen {
  float t = 0.0F;       ///< position on the pixel's ray: scanner Z beyond the ray's origin, mm; NaN: no return
  float cosine = 1.0F;  ///< cosine of the angle of incidence
  float nearer = 0.0F;  ///< interreflection: distance by which the point seems nearer, mm
  ConcreteFace face = ConcreteFace::beyond;
  std::uint8_t gloss = 0;
  std::uint8_t bore = 0;  ///< 0: not in a casing's bore, otherwise the content's number + 1
};

class ConcreteOptics {
 public:
  ConcreteOptics(const ConcreteOrder& order, const Pose& T_scanner_block, const ConcreteScanner& scanner);

  /// Origin of all rays, scanner frame.
  [[nodiscard]] const Vec3& origin() const { return origin_; }
  /// Direction of a pixel's ray in the scanner frame, z = 1.
  [[nodiscard]] Vec3 ray(std::size_t column, std::size_t row) const;
  /// True if a point of the block frame is in the field of view and visible for the projector and both cameras.
  [[nodiscard]] bool in_view(const ConcreteBlock& block, const Vec3& p_block) const;

  /// Traces the ray of a pixel. `random`: one draw for random returns.
  [[nodiscard]] Seen look(const ConcreteBlock& block, std::size_t column, std::size_t row, std::uint64_t random) const;

 private:
  [[nodiscard]] bool cameras_see(const ConcreteBlock& block, const Vec3& p_block) const;
  void look_into(const ConcreteBlock& block, const Bore& bore, const Vec3& along, std::uint64_t random,
                 Seen& seen) const;
  void meet_clutter(const ConcreteBlock& block, const Vec3& along, Seen& seen) const;

  EffectStrengths effects_;
  ConcreteScanner scanner_;
  Pose T_scanner_block_;
  Pose T_block_scanner_;
  Vec3 origin_ = Vec3::Zero();
  Vec3 origin_block_ = Vec3::Zero();
  std::array<Vec3, 3> eyes_block_{};  ///< projector, cameras
  std::array<double, 4> bend_{};      ///< deviation of rays from the even grid, share of the position by odd terms
};

}  // namespace slabd::emulator
