// SPDX-License-Identifier: Apache-2.0
#include "base/dither.h"

#include <array>
#include <cassert>

#include "base/limits.h"

namespace slabd {
namespace {

/// Shift along X, Y, Z and rotation about X, Y, Z, as fractions of the amplitudes. Found by a random search that
/// maximises the smallest distance. No rule connects the rows, so that differences of two stops do not repeat.
constexpr std::array<std::array<double, 6>, limits::kStationsMax> kPattern = {{
    {{1.00, 1.00, 0.15, -0.90, 1.00, 0.40}},
    {{-0.05, 0.00, -0.60, 0.80, -1.00, -0.80}},
    {{0.00, -0.60, 0.95, -0.75, -1.00, 0.80}},
    {{-1.00, 1.00, 1.00, 0.95, 0.40, 1.00}},
    {{-0.20, -1.00, -1.00, -1.00, 1.00, -0.75}},
    {{1.00, -0.05, -0.25, -0.05, -0.75, -0.20}},
    {{0.10, 1.00, 1.00, 0.00, 1.00, 1.00}},
    {{-1.00, 0.35, -0.05, 0.70, 1.00, -1.00}},
    {{0.45, -0.95, 0.05, 0.85, -0.25, 0.05}},
    {{0.90, 0.95, -1.00, -0.65, 0.00, -1.00}},
    {{-1.00, -0.25, -1.00, -0.85, 0.10, 0.95}},
    {{-0.90, -0.05, 1.00, 1.00, 0.90, 0.05}},
    {{-0.05, 0.95, -0.05, 1.00, -1.00, 0.95}},
    {{1.00, 0.20, 1.00, -1.00, -0.35, -0.05}},
    {{-0.70, -0.65, 0.15, -0.05, 1.00, -0.25}},
    {{-0.90, 0.80, -1.00, 1.00, 0.00, -1.00}},
    {{1.00, -0.90, -1.00, -1.00, -1.00, -0.90}},
    {{1.00, -0.90, 1.00, 0.10, -0.40, 0.85}},
}};

}  // namespace

Pose dithered(const Pose& T_block_scanner, int station, const Dither& dither) {
  assert(station >= 1 && station <= static_cast<int>(limits::kStationsMax));
  const std::array<double, 6>& share = kPattern.at(static_cast<std::size_t>(station - 1));
  Pose move;
  move.translation_mm = dither.mm * Vec3(share[0], share[1], share[2]);
  const Vec3 turn_rad = rad_from_deg(dither.deg) * Vec3(share[3], share[4], share[5]);
  if (turn_rad.norm() > 0.0)
    move.rotation = Quat(Eigen::AngleAxisd(turn_rad.norm(), Eigen::Vector3d(turn_rad.normalized())));
  return move * T_block_scanner;
}

StopDifference stop_difference(const Pose& T_block_scanner, const Pose& other) {
  const Pose a = T_block_scanner.inverse();
  const Pose b = other.inverse();
  return {(a.translation_mm - b.translation_mm).norm(), deg_from_rad(angle_between_rad(a.rotation, b.rotation))};
}

bool is_told_apart(const StopDifference& difference) {
  return difference.mm > kStopsDiffer_mm || difference.deg > deg_from_rad(kStopsDiffer_rad);
}

}  // namespace slabd
