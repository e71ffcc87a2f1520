// SPDX-License-Identifier: Apache-2.0
//
// The smooth part is a random field over the flange's position, a sum of waves (random Fourier features). With wave
// vectors k ~ N(0, 1 / length^2) the correlation of two positions is exp(-r^2 / (2 length^2)). The field belongs to
// the robot and does not depend on the order or number of visits. The repeatability error is drawn from the visit's
// own stream.
#include "emulator/robot_error.h"

#include <cmath>

#include "emulator/slab_scene.h"

namespace slabd::emulator {
namespace {

constexpr std::size_t kComponents = 6;  // x, y, z, about X, Y, Z
/// With this number of waves the field is Gaussian to a few per cent, and a call takes microseconds.
constexpr std::size_t kWaves = 64;
constexpr double kArm_mm = 1500.0;
constexpr std::uint64_t kSmoothStream = 11;
constexpr std::uint64_t kRepeatStream = 12;

Quat turned(const Vec3& w_rad) {
  const double angle = w_rad.norm();
  if (angle == 0.0) return Quat::Identity();
  return Quat(Eigen::AngleAxisd(angle, w_rad / angle));
}

}  // namespace

RobotError::RobotError(const RobotErrorTraits& traits) : traits_(traits) {
  if (traits_.smooth_rad < 0.0) traits_.smooth_rad = traits_.smooth_mm / kArm_mm;
  if (traits_.repeat_rad < 0.0) traits_.repeat_rad = traits_.repeat_mm / kArm_mm;
  Prng random(derived_seed(traits_.seed, kSmoothStream, 0));
  waves_.reserve(kComponents * kWaves);
  for (std::size_t i = 0; i < kComponents * kWaves; ++i) {
    Wave wave;
    for (int axis = 0; axis < 3; ++axis) wave.per_mm[axis] = random.normal() / traits_.smooth_length_mm;
    wave.phase = 2.0 * kPi * random.uniform();
    waves_.push_back(wave);
  }
}

double RobotError::field(std::size_t component, const Vec3& p_mm) const {
  double sum = 0.0;
  for (std::size_t i = component * kWaves; i < (component + 1) * kWaves; ++i)
    sum += std::cos(waves_[i].per_mm.dot(p_mm) + waves_[i].phase);
  return sum * std::sqrt(2.0 / static_cast<double>(kWaves));
}

Pose RobotError::real_mean(const Pose& T_base_flange) const {
  const Vec3& p = T_base_flange.translation_mm;
  const Vec3 off(field(0, p), field(1, p), field(2, p));
  const Vec3 turn(field(3, p), field(4, p), field(5, p));
  return {(turned(traits_.smooth_rad * turn) * T_base_flange.rotation).normalized(), p + traits_.smooth_mm * off};
}

Pose RobotError::real(const Pose& T_base_flange, std::uint64_t visit) const {
  const Pose mean = real_mean(T_base_flange);
  Prng random(derived_seed(traits_.seed, kRepeatStream, visit));
  Vec3 off;
  Vec3 turn;
  for (int axis = 0; axis < 3; ++axis) off[axis] = random.normal();
  for (int axis = 0; axis < 3; ++axis) turn[axis] = random.normal();
  return {(turned(traits_.repeat_rad * turn) * mean.rotation).normalized(),
          mean.translation_mm + traits_.repeat_mm * off};
}

}  // namespace slabd::emulator
