// SPDX-License-Identifier: Apache-2.0
//
// One drawn scan with known truth, measured by slabd's core and by the Point Cloud Library. Both are held to the truth;
// that they agree with each other is then no accident.
#include <fmt/core.h>
#include <pcl/features/normal_3d.h>
#include <pcl/filters/radius_outlier_removal.h>
#include <pcl/filters/statistical_outlier_removal.h>
#include <pcl/registration/icp.h>
#include <pcl/search/kdtree.h>
#include <pcl/segmentation/sac_segmentation.h>

#include <CLI/CLI.hpp>
#include <chrono>
#include <cstdio>
#include <functional>

#include "tests/accuracy/block_scan.h"

namespace slabd::oracle {
namespace {

using Points = pcl::PointCloud<pcl::PointXYZ>;
using Oriented = pcl::PointCloud<pcl::PointNormal>;

double seconds_of(const std::function<void()>& work) {
  const auto started = std::chrono::steady_clock::now();
  work();
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - started).count();
}

/// A nominal block, seen from a little beside the nominal view, and its scan.
struct Scene {
  Recipe recipe;
  accuracy::Sight sight;
  simulate::ScannerTraits scanner;
  std::vector<float> xyz;  ///< unorganised
};

std::vector<float> draw(const Scene& scene, const simulate::ScannerTraits& scanner, std::uint64_t seed) {
  const auto surface =
      simulate::BlockSurface::make(scene.recipe, scene.sight.station.block, scene.sight.T_scanner_block);
  std::vector<float> xyz;
  std::ignore = simulate::draw_scan(surface.value(), scanner, seed, xyz);
  return xyz;
}

Points::Ptr cloud_of(std::span<const float> xyz, std::size_t stride = 1) {
  auto cloud = std::make_shared<Points>();
  for (std::size_t i = 0; i + 2 < xyz.size(); i += 3 * stride) cloud->emplace_back(xyz[i], xyz[i + 1], xyz[i + 2]);
  return cloud;
}

// ---- the seat plane ---------------------------------------------------------------------------------------------

/// Tilt and height errors of a plane n.p = d (scanner frame) against the true bearing plane.
void print_plane(const Scene& scene, const char* who, const Vec3& n, double d, std::size_t inliers, double seconds) {
  const double slope = scene.sight.station.block.slope_rad;
  const Pose& T = scene.sight.T_scanner_block;
  const Vec3 truth = T.rotation * Vec3(0.0, -std::sin(slope), std::cos(slope));
  const Vec3 up = n.dot(truth) < 0.0 ? Vec3(-n) : n;
  const double height = up.dot(T.translation_mm) - (n.dot(truth) < 0.0 ? -d : d);
  fmt::print("  {:40} tilt error {:.6f} deg, height error {:+.6f} mm, {} inliers, {:.2f} s\n", who,
             deg_from_rad(angle_between_rad(up, truth)), -height, inliers, seconds);
}

void compare_planes(const Scene& scene) {
  const Pose T_block_scanner = scene.sight.T_scanner_block.inverse();
  std::vector<Vec3> points;
  auto cloud = std::make_shared<Points>();
  for (std::size_t i = 0; i < scene.xyz.size(); i += 3) {
    const Vec3 p(static_cast<double>(scene.xyz[i]), static_cast<double>(scene.xyz[i + 1]),
                 static_cast<double>(scene.xyz[i + 2]));
    const Vec3 at = T_block_scanner * p;
    if (std::abs(at.x()) > 51.0 || std::abs(at.y()) > 75.0 || std::abs(at.z()) > 30.0) continue;
    points.push_back(p);
    cloud->emplace_back(scene.xyz[i], scene.xyz[i + 1], scene.xyz[i + 2]);
  }
  fmt::print("seat plane: {} points of the evaluation region, outliers included\n", points.size());
  PlaneFit fit;
  double time = seconds_of([&] { fit = algo::fit_plane(points, Vec3(0, 0, -1), {}); });
  print_plane(scene, "slabd fit_plane", fit.normal, fit.offset_mm, fit.inliers, time);

  pcl::SACSegmentation<pcl::PointXYZ> segmentation;
  segmentation.setModelType(pcl::SACMODEL_PLANE);
  segmentation.setMethodType(pcl::SAC_RANSAC);
  segmentation.setDistanceThreshold(0.09);
  segmentation.setMaxIterations(104);
  segmentation.setInputCloud(cloud);
  pcl::PointIndices inliers;
  pcl::ModelCoefficients plane;
  for (const bool optimised : {true, false}) {
    segmentation.setOptimizeCoefficients(optimised);
    time = seconds_of([&] { segmentation.segment(inliers, plane); });
    const Vec3 n(static_cast<double>(plane.values[0]), static_cast<double>(plane.values[1]),
                 static_cast<double>(plane.values[2]));
    print_plane(scene, optimised ? "PCL SACSegmentation, optimised" : "PCL SACSegmentation, three points", n,
                -static_cast<double>(plane.values[3]), inliers.indices.size(), time);
  }
}

// ---- outliers -----------------------------------------------------------------------------------------------------

/// Outliers are planted along z, at least 1 mm off; so what stands off the surface by half of that is one.
struct Census {
  std::size_t surface = 0;
  std::size_t outliers = 0;
};

Census take_census(const Scene& scene, std::span<const float> xyz) {
  const auto surface =
      simulate::BlockSurface::make(scene.recipe, scene.sight.station.block, scene.sight.T_scanner_block);
  Census census;
  for (std::size_t i = 0; i + 2 < xyz.size(); i += 3) {
    const double depth = surface.value().depth_mm(static_cast<double>(xyz[i]), static_cast<double>(xyz[i + 1]));
    ++(std::abs(static_cast<double>(xyz[i + 2]) - depth) < 0.5 ? census.surface : census.outliers);
  }
  return census;
}

std::vector<float> floats_of(const Points& cloud) {
  std::vector<float> xyz;
  for (const pcl::PointXYZ& p : cloud) xyz.insert(xyz.end(), {p.x, p.y, p.z});
  return xyz;
}

void compare_denoising(const Scene& scene) {
  const Census before = take_census(scene, scene.xyz);
  fmt::print("outliers: {} planted more than 1 mm off among {} surface points\n", before.outliers, before.surface);
  const auto print = [&](const char* who, std::span<const float> kept, double seconds) {
    const Census after = take_census(scene, kept);
    fmt::print("  {:40} {:8.4f} % of outliers removed, {:.4f} % of the surface lost, {:.1f} s\n", who,
               100.0 * (1.0 - static_cast<double>(after.outliers) / static_cast<double>(before.outliers)),
               100.0 * (1.0 - static_cast<double>(after.surface) / static_cast<double>(before.surface)), seconds);
  };
  algo::BlockInspector inspector;
  inspector.use(scene.recipe);
  inspector.begin(1, Pose::identity(), nominal_T_block_scanner());
  std::vector<float> own = scene.xyz;
  algo::Cloud cloud{own, own.size() / 3, 0, 0};
  double time = seconds_of([&] { std::ignore = inspector.denoise(cloud); });
  print("slabd denoise", std::span(own).first(3 * cloud.points), time);

  const Points::Ptr input = cloud_of(scene.xyz);
  Points kept;
  pcl::RadiusOutlierRemoval<pcl::PointXYZ> radius;
  radius.setInputCloud(input);
  radius.setRadiusSearch(0.95);
  radius.setMinNeighborsInRadius(3);
  time = seconds_of([&] { radius.filter(kept); });
  print("PCL RadiusOutlierRemoval, 3 in 0.95 mm", floats_of(kept), time);
  pcl::StatisticalOutlierRemoval<pcl::PointXYZ> statistical;
  statistical.setInputCloud(input);
  statistical.setMeanK(8);
  statistical.setStddevMulThresh(1.0);
  time = seconds_of([&] { statistical.filter(kept); });
  print("PCL StatisticalOutlierRemoval, 8, 1 sigma", floats_of(kept), time);
}

// ---- the pose -----------------------------------------------------------------------------------------------------

Oriented::Ptr with_normals(const Points::Ptr& points) {
  pcl::NormalEstimation<pcl::PointXYZ, pcl::Normal> estimation;
  estimation.setInputCloud(points);
  estimation.setSearchMethod(std::make_shared<pcl::search::KdTree<pcl::PointXYZ>>());
  estimation.setKSearch(9);
  pcl::PointCloud<pcl::Normal> normals;
  estimation.compute(normals);
  auto oriented = std::make_shared<Oriented>();
  pcl::concatenateFields(*points, normals, *oriented);
  return oriented;
}

void print_pose(const Scene& scene, const char* who, const Pose& T_scanner_block, double seconds) {
  const Pose off = scene.sight.T_scanner_block.inverse() * T_scanner_block;
  fmt::print("  {:40} off by {:.5f} {:.5f} {:.5f} mm (x y z of the block), {:.6f} deg, {:.1f} s\n", who,
             off.translation_mm.x(), off.translation_mm.y(), off.translation_mm.z(),
             deg_from_rad(angle_between_rad(off.rotation, Quat::Identity())), seconds);
}

void compare_poses(const Scene& scene) {
  fmt::print("pose of the block, from the nominal view ({:.1f} mm and {:.2f} deg off)\n",
             (scene.sight.T_scanner_block * nominal_T_block_scanner()).translation_mm.norm(),
             deg_from_rad(angle_between_rad((scene.sight.T_scanner_block * nominal_T_block_scanner()).rotation,
                                            Quat::Identity())));
  algo::BlockInspector inspector;
  inspector.use(scene.recipe);
  inspector.begin(1, Pose::identity(), nominal_T_block_scanner());
  std::vector<float> own = scene.xyz;
  algo::Cloud cloud{own, own.size() / 3, 0, 0};
  std::ignore = inspector.denoise(cloud);
  Status status = success();
  double time = seconds_of([&] { status = inspector.register_to_model(cloud); });
  if (status)
    print_pose(scene, "slabd register_to_model", inspector.result().registration.T_scanner_block, time);
  else
    fmt::print("  slabd register_to_model: {}\n", status.error().text.view());

  // PCL knows no analytic model: it gets a noise-free scan of the same block from the nominal view, in the block frame.
  Scene perfect = scene;
  perfect.sight.T_scanner_block = nominal_T_block_scanner().inverse();
  simulate::ScannerTraits exact = scene.scanner;
  exact.noise_mm = exact.outlier_share = exact.missing_share = 0.0;
  exact.columns = 1024;
  exact.rows = 1224;
  const Oriented::Ptr target = with_normals(cloud_of(draw(perfect, exact, 1)));
  const std::size_t stride = std::max<std::size_t>(1, cloud.points / 65'536);
  const Oriented::Ptr source = with_normals(cloud_of(std::span(own).first(3 * cloud.points), stride));
  pcl::IterativeClosestPointWithNormals<pcl::PointNormal, pcl::PointNormal, double> icp;
  icp.setInputSource(source);
  icp.setInputTarget(target);
  icp.setMaximumIterations(100);
  icp.setTransformationEpsilon(1e-12);
  icp.setEuclideanFitnessEpsilon(1e-12);
  Oriented moved;
  time = 0.0;
  Eigen::Matrix4d T = Eigen::Matrix4d::Identity();
  for (const double reach_mm : {20.0, 3.0, 0.5}) {
    icp.setMaxCorrespondenceDistance(reach_mm);
    time += seconds_of([&] { icp.align(moved, T); });
    T = icp.getFinalTransformation();
  }
  // T takes the scan into the nominal view's scanner frame.
  Pose T_nominal_scanner;
  T_nominal_scanner.rotation = Quat(Eigen::Quaterniond(T.topLeftCorner<3, 3>()));
  T_nominal_scanner.translation_mm = T.topRightCorner<3, 1>();
  print_pose(scene, icp.hasConverged() ? "PCL ICP with normals" : "PCL ICP with normals (not converged)",
             T_nominal_scanner.inverse() * perfect.sight.T_scanner_block, time);
}

}  // namespace
}  // namespace slabd::oracle

int main(int argc, char** argv) {
  using namespace slabd;
  std::uint64_t seed = 1;
  std::string points = "quarter";
  CLI::App app("One scan with known truth, measured by slabd's core and by PCL");
  app.add_option("--seed", seed, "Decides noise and view")->capture_default_str();
  app.add_option("--points", points, "full or quarter")->check(CLI::IsMember({"full", "quarter"}));
  CLI11_PARSE(app, argc, argv);

  std::setvbuf(stdout, nullptr, _IOLBF, 0);  // stages take minutes: show each when it is done
  const std::optional<Recipe> recipe = accuracy::reference_recipe();
  if (!recipe) return 3;
  oracle::Scene scene{*recipe, accuracy::varied_sight(*recipe, seed), {}, {}};
  scene.sight.station.block = simulate::nominal_truth(*recipe);
  scene.scanner.organised = false;
  if (points == "quarter") {
    scene.scanner.columns /= 2;
    scene.scanner.rows /= 2;
  }
  scene.xyz = oracle::draw(scene, scene.scanner, simulate::derived_seed(seed, 12, 0));
  oracle::compare_planes(scene);
  oracle::compare_denoising(scene);
  oracle::compare_poses(scene);
  return 0;
}
