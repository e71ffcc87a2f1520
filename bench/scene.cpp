// SPDX-License-Identifier: Apache-2.0
#include "bench/scene.h"

#include <fmt/core.h>

#include <array>
#include <cmath>
#include <fstream>
#include <unordered_set>

#include "hal/hal.h"

namespace slabd::bench {
namespace {

constexpr double kOff_deg = 0.5;

Rigid rigid_of(const Pose& pose) {
  const Mat4 m = pose.matrix();
  Rigid T{};
  for (int row = 0; row < 4; ++row)
    for (int column = 0; column < 4; ++column) T[static_cast<std::size_t>(4 * row + column)] = m(row, column);
  return T;
}

Vec3 point_of(const Scan& scan, std::size_t i) {
  return {static_cast<double>(scan.xyz[3 * i]), static_cast<double>(scan.xyz[3 * i + 1]),
          static_cast<double>(scan.xyz[3 * i + 2])};
}

void append(std::vector<float>& values, const Vec3& v) {
  for (int axis = 0; axis < 3; ++axis) values.push_back(static_cast<float>(v[axis]));
}

/// Index of a voxel of kVoxel_mm; the scene is smaller than 2^20 voxels in each direction.
std::uint64_t voxel_of(const Vec3& p) {
  constexpr double kMiddle = 1U << 20U;
  const auto part = [](double x) { return static_cast<std::uint64_t>(std::floor(x / kVoxel_mm) + kMiddle); };
  return (part(p.x()) << 42U) | (part(p.y()) << 21U) | part(p.z());
}

template <class Number>
bool write_numbers(const std::string& path, const std::vector<Number>& numbers) {
  std::ofstream out(path, std::ios::binary);
  out.write(reinterpret_cast<const char*>(numbers.data()),
            static_cast<std::streamsize>(numbers.size() * sizeof(Number)));
  out.close();
  if (!out) fmt::print(stderr, "bench: cannot write {}\n", path);
  return static_cast<bool>(out);
}

bool write_scan(const std::string& path, hal::ScanFormat format, const Scan& scan) {
  const Status status = hal::write_scan(path.c_str(), format, scan.xyz, scan.width, scan.height);
  if (!status) fmt::print(stderr, "bench: {}\n", status.error().text.view());
  return status.ok();
}

/// Voxel centroids of the points that are not outliers.
std::vector<float> clean_voxels(const Scan& scan, const std::vector<std::uint8_t>& outlier) {
  struct Sum {
    Vec3 sum = Vec3::Zero();
    double count = 0.0;
  };
  std::unordered_map<std::uint64_t, Sum> voxels;
  for (std::size_t i = 0; i < scan.points(); ++i) {
    if (outlier[i] != 0) continue;
    const Vec3 p = point_of(scan, i);
    Sum& voxel = voxels[voxel_of(p)];
    voxel.sum += p;
    voxel.count += 1.0;
  }
  std::vector<float> xyz;
  xyz.reserve(3 * voxels.size());
  for (const auto& [index, voxel] : voxels) append(xyz, voxel.sum / voxel.count);
  return xyz;
}

}  // namespace

Scene::Scene(const Recipe& recipe, std::uint64_t seed)
    : recipe_(recipe), seed_(seed), block_(emulator::nominal_truth(recipe)) {
  Pose off;
  off.translation_mm = Vec3(2.0, 2.0, 1.0);
  off.rotation = Quat(Eigen::AngleAxisd(rad_from_deg(kOff_deg), Eigen::Vector3d::Ones().normalized()));
  T_scanner_block_ = (off * nominal_T_block_scanner()).inverse();
}

Scan Scene::draw(std::size_t columns, std::size_t rows, emulator::Projection projection) const {
  emulator::ScannerTraits scanner;
  scanner.columns = columns;
  scanner.rows = rows;
  scanner.field_x_mm = kPitch_mm * static_cast<double>(kColumns);
  scanner.field_y_mm = kPitch_mm * static_cast<double>(kRows);
  scanner.projection = projection;
  Scan scan;
  const auto surface = emulator::BlockSurface::make(recipe_, block_, T_scanner_block_, projection);
  const emulator::DrawnScan drawn = emulator::draw_scan(surface.value(), scanner, seed_, scan.xyz);
  scan.width = drawn.width;
  scan.height = drawn.height;
  return scan;
}

Truth Scene::truth() const {
  Truth truth;
  truth.T_block_scanner = rigid_of(T_scanner_block_.inverse());
  truth.T_block_scanner_start = rigid_of(nominal_T_block_scanner());
  truth.seat_normal_block = {0.0, -std::sin(block_.slope_rad), std::cos(block_.slope_rad)};
  return truth;
}

std::vector<std::uint8_t> Scene::labels(const Scan& scan) const {
  const auto surface = emulator::BlockSurface::make(recipe_, block_, T_scanner_block_);
  std::vector<std::uint8_t> labels(scan.points());
  for (std::size_t i = 0; i < scan.points(); ++i) {
    const Vec3 p = point_of(scan, i);
    labels[i] = std::abs(p.z() - surface.value().depth_mm(p.x(), p.y())) > 0.5 ? 1 : 0;
  }
  return labels;
}

std::vector<float> Scene::crop(const Scan& scan) const {
  const Pose start = nominal_T_block_scanner();
  std::vector<float> xyz;
  for (std::size_t i = 0; i < scan.points(); ++i) {
    const Vec3 p = point_of(scan, i);
    const Vec3 at = start * p;
    if (std::abs(at.x()) < kCropX_mm && std::abs(at.y()) < kCropY_mm && std::abs(at.z() - kSlope * at.y()) < kCropZ_mm)
      append(xyz, p);
  }
  return xyz;
}

std::vector<float> Scene::model() const {
  // The rays are much denser than the voxels, so that steep faces are covered as well as level ones. The first ray in
  // a voxel represents it. Normals are exact: differences over a hundredth of a millimetre on a plane. A ray whose two
  // sides differ is near an edge and is left out.
  constexpr double kRay_mm = 0.3;
  constexpr double kStep_mm = 0.01;
  constexpr double kBend_mm = 1e-7;
  const Pose T_scanner_block = nominal_T_block_scanner().inverse();
  const auto made = emulator::BlockSurface::make(recipe_, block_, T_scanner_block);
  const emulator::BlockSurface& surface = made.value();
  const double half_x = 0.5 * kPitch_mm * static_cast<double>(kColumns) + 10.0;
  const double half_y = 0.5 * kPitch_mm * static_cast<double>(kRows) + 10.0;
  const Pose T_block_scanner = nominal_T_block_scanner();
  std::unordered_set<std::uint64_t> taken;
  std::vector<float> values;
  for (double y = -half_y; y <= half_y; y += kRay_mm) {
    for (double x = -half_x; x <= half_x; x += kRay_mm) {
      const double z = surface.depth_mm(x, y);
      const Vec3 p = T_block_scanner * Vec3(x, y, z);
      if (!p.allFinite() || taken.count(voxel_of(p)) != 0) continue;
      const double left = surface.depth_mm(x - kStep_mm, y), right = surface.depth_mm(x + kStep_mm, y);
      const double below = surface.depth_mm(x, y - kStep_mm), above = surface.depth_mm(x, y + kStep_mm);
      // NaN (a bore) fails both comparisons.
      if (!(std::abs(left + right - 2.0 * z) < kBend_mm && std::abs(below + above - 2.0 * z) < kBend_mm)) continue;
      taken.insert(voxel_of(p));
      const Vec3 n_scanner =
          Vec3((right - left) / (2.0 * kStep_mm), (above - below) / (2.0 * kStep_mm), -1.0).normalized();
      append(values, p);
      append(values, T_block_scanner.rotation * n_scanner);
    }
  }
  return values;
}

bool Scene::write(const Scan& organised, const std::string& folder) const {
  const Scan scan = unorganised(organised);
  const Truth known = truth();
  std::vector<double> numbers(known.T_block_scanner.begin(), known.T_block_scanner.end());
  numbers.insert(numbers.end(), known.T_block_scanner_start.begin(), known.T_block_scanner_start.end());
  numbers.insert(numbers.end(), known.seat_normal_block.begin(), known.seat_normal_block.end());
  const std::vector<std::uint8_t> outlier = labels(scan);
  return write_scan(folder + "/scan.ply", hal::ScanFormat::ply, scan) &&
         write_scan(folder + "/scan_organised.ply", hal::ScanFormat::ply, organised) &&
         write_numbers(folder + "/truth.f64", numbers) && write_numbers(folder + "/labels.u8", outlier) &&
         write_numbers(folder + "/clean.f32", clean_voxels(scan, outlier)) &&
         write_numbers(folder + "/crop.f32", crop(scan)) && write_numbers(folder + "/model.f32", model());
}

bool write_as_text(const Scan& organised, const std::string& folder) {
  const Scan scan = unorganised(organised);
  return write_scan(folder + "/scan_ascii.ply", hal::ScanFormat::ply_ascii, scan) &&
         write_scan(folder + "/scan.xyz", hal::ScanFormat::xyz, scan);
}

Scan unorganised(const Scan& organised) {
  Scan scan;
  scan.xyz.reserve(organised.xyz.size());
  for (std::size_t i = 0; i < organised.points(); ++i) {
    if (!std::isfinite(organised.xyz[3 * i + 2])) continue;
    scan.xyz.insert(scan.xyz.end(), &organised.xyz[3 * i], &organised.xyz[3 * i] + 3);
  }
  return scan;
}

Scan shuffled(const Scan& organised) {
  Scan scan = unorganised(organised);
  Prng random(kSeed);
  for (std::size_t i = scan.points(); i > 1; --i) {
    const auto j = static_cast<std::size_t>(random.below(i));
    for (std::size_t axis = 0; axis < 3; ++axis) std::swap(scan.xyz[3 * (i - 1) + axis], scan.xyz[3 * j + axis]);
  }
  return scan;
}

}  // namespace slabd::bench
