// SPDX-License-Identifier: Apache-2.0
#include "ball_scan.h"

#include <algorithm>
#include <cmath>

namespace slabd::calib {
namespace {

constexpr double kFar = std::numeric_limits<double>::infinity();

/// First t >= 0 with |from + t dir| = radius.
double meet_sphere(const Vec3& from, const Vec3& dir, double radius) {
  const double a = dir.squaredNorm();
  const double b = from.dot(dir);
  const double disc = b * b - a * (from.squaredNorm() - radius * radius);
  return disc < 0.0 ? kFar : (-b - std::sqrt(disc)) / a;
}

double meet_post(const Vec3& origin, const Vec3& dir, const ScenePost& post) {
  const Vec3 axis = (post.to_mm - post.from_mm).normalized();
  const Vec3 from = origin - post.from_mm;
  const Vec3 f = from - from.dot(axis) * axis;
  const Vec3 d = dir - dir.dot(axis) * axis;
  const double t = meet_sphere(f, d, post.radius_mm);
  if (!(t < kFar)) return kFar;
  const double along = (from + t * dir).dot(axis);
  return along >= 0.0 && along <= (post.to_mm - post.from_mm).norm() ? t : kFar;
}

std::vector<double> smooth(std::vector<double> field, std::size_t width, std::size_t height, double sigma) {
  const int reach = static_cast<int>(std::ceil(4.0 * sigma));
  std::vector<double> weights;
  double power = 0.0;
  for (int i = -reach; i <= reach; ++i) {
    weights.push_back(std::exp(-0.5 * i * i / (sigma * sigma)));
    power += weights.back() * weights.back();
  }
  for (double& w : weights) w /= std::sqrt(power);
  // The grid is periodic, so that all places have the same variance.
  const auto wrapped = [](int i, std::size_t n) {
    const int size = static_cast<int>(n);
    return static_cast<std::size_t>(((i % size) + size) % size);
  };
  std::vector<double> across(field.size(), 0.0);
  for (std::size_t y = 0; y < height; ++y)
    for (std::size_t x = 0; x < width; ++x)
      for (int k = -reach; k <= reach; ++k)
        across[y * width + x] +=
            weights[static_cast<std::size_t>(k + reach)] * field[y * width + wrapped(static_cast<int>(x) + k, width)];
  std::fill(field.begin(), field.end(), 0.0);
  for (std::size_t y = 0; y < height; ++y)
    for (int k = -reach; k <= reach; ++k) {
      const std::size_t row = wrapped(static_cast<int>(y) + k, height);
      for (std::size_t x = 0; x < width; ++x)
        field[y * width + x] += weights[static_cast<std::size_t>(k + reach)] * across[row * width + x];
    }
  return field;
}

}  // namespace

std::vector<float> draw(const BallScene& scene) {
  const auto width = static_cast<std::size_t>(2.0 * scene.half_width_mm / scene.pitch_mm);
  const std::size_t height = width;
  Prng random(scene.seed);
  std::vector<double> noise(width * height);
  for (double& v : noise) v = random.normal();
  if (scene.correlation_mm > 0.0) noise = smooth(noise, width, height, 0.5 * scene.correlation_mm / scene.pitch_mm);

  std::vector<double> depth(width * height, kFar);
  std::vector<Vec3> origins(width * height);
  std::vector<Vec3> dirs(width * height);
  for (std::size_t i = 0; i < depth.size(); ++i) {
    const double x = (static_cast<double>(i % width) + 0.5) * scene.pitch_mm - scene.half_width_mm;
    const double y = (static_cast<double>(i / width) + 0.5) * scene.pitch_mm - scene.half_width_mm;
    origins[i] = scene.parallel ? Vec3(x, y, 0.0) : Vec3(0.0, 0.0, 0.0);
    dirs[i] = scene.parallel ? Vec3(0.0, 0.0, 1.0) : Vec3(Vec3(x, y, scene.distance_mm).normalized());
    for (const SceneBall& ball : scene.balls)
      depth[i] = std::min(depth[i], meet_sphere(origins[i] - ball.centre_mm, dirs[i], ball.radius_mm));
    for (const ScenePost& post : scene.posts) depth[i] = std::min(depth[i], meet_post(origins[i], dirs[i], post));
    for (const ScenePlane& plane : scene.planes) {
      const double t = (plane.offset_mm - plane.normal.dot(origins[i])) / plane.normal.dot(dirs[i]);
      if (t > 0.0) depth[i] = std::min(depth[i], t);
    }
    if (x > scene.hidden_beyond_x_mm) depth[i] = kFar;
  }
  std::vector<float> xyz(3 * depth.size(), std::numeric_limits<float>::quiet_NaN());
  for (std::size_t i = 0; i < depth.size(); ++i) {
    const double flyer = random.uniform();
    const double place = random.uniform();
    const bool missing = random.uniform() < scene.missing_share;
    if (depth[i] == kFar || missing) continue;
    double t = depth[i] + scene.noise_mm * noise[i];
    double back = 0.0;
    for (const std::size_t next : {i + 1, i - 1, i + width, i - width})
      if (next < depth.size() && depth[next] < kFar) back = std::max(back, depth[next] - depth[i]);
    if (back > 3.0 && flyer < scene.flyer_share) t = depth[i] + place * back;
    const Vec3 p = origins[i] + t * dirs[i];
    for (std::size_t k = 0; k < 3; ++k) xyz[3 * i + k] = static_cast<float>(p[static_cast<Eigen::Index>(k)]);
  }
  return xyz;
}

}  // namespace slabd::calib
