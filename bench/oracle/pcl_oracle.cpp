// SPDX-License-Identifier: Apache-2.0
//
// Scans with known truth, measured by slabd's core and by the Point Cloud Library. Both are held to the truth; that
// they agree with each other is then no accident. A third figure says what the scanner's noise alone explains.
//
// PCL gets what a careful user would give it: the threshold slabd uses, reaches in pitches of the scan (the best of
// those tried), double precision where it has it, and the denoised scan to register. Times are CPU seconds of the call
// itself, so that other programs on the machine do not count.
#include <fmt/core.h>
#include <pcl/common/centroid.h>
#include <pcl/common/eigen.h>
#include <pcl/features/normal_3d.h>
#include <pcl/filters/radius_outlier_removal.h>
#include <pcl/filters/statistical_outlier_removal.h>
#include <pcl/registration/correspondence_rejection_surface_normal.h>
#include <pcl/registration/icp.h>
#include <pcl/search/kdtree.h>
#include <pcl/segmentation/sac_segmentation.h>

#include <CLI/CLI.hpp>
#include <cmath>
#include <ctime>
#include <functional>

#include "tests/accuracy/block_scan.h"

namespace slabd::oracle {
namespace {

using Points = pcl::PointCloud<pcl::PointXYZ>;
using Oriented = pcl::PointCloud<pcl::PointNormal>;

double cpu_seconds_of(const std::function<void()>& work) {
  const std::clock_t started = std::clock();
  work();
  return static_cast<double>(std::clock() - started) / CLOCKS_PER_SEC;
}

/// A nominal block, seen from a little beside the nominal view, and its scan.
struct Scene {
  Recipe recipe;
  accuracy::Sight sight;
  simulate::ScannerTraits scanner;
  std::vector<float> xyz;  ///< unorganised
  std::size_t outliers = 0;

  [[nodiscard]] double pitch_mm() const {
    return std::max(scanner.field_x_mm / static_cast<double>(scanner.columns),
                    scanner.field_y_mm / static_cast<double>(scanner.rows));
  }
};

simulate::BlockSurface surface_of(const Scene& scene) {
  return simulate::BlockSurface::make(scene.recipe, scene.sight.station.block, scene.sight.T_scanner_block).value();
}

void draw(Scene& scene, std::uint64_t seed) {
  scene.outliers = simulate::draw_scan(surface_of(scene), scene.scanner, seed, scene.xyz).outliers;
}

Points::Ptr cloud_of(std::span<const float> xyz) {
  auto cloud = std::make_shared<Points>();
  for (std::size_t i = 0; i + 2 < xyz.size(); i += 3) cloud->emplace_back(xyz[i], xyz[i + 1], xyz[i + 2]);
  return cloud;
}

/// What one program made of one stage, over all scans.
struct Score {
  const char* who;
  double error2[2] = {0.0, 0.0};  ///< sums of squares
  double seconds = 0.0;
  std::size_t outliers_left = 0;
  std::size_t surface_lost = 0;

  void add(double first, double second, double time) {
    error2[0] += first * first;
    error2[1] += second * second;
    seconds += time;
  }
};

/// Scores of one stage: slabd's first, then PCL's.
using Stage = std::vector<Score>;

/// "1 : 12.3", or what can be said when slabd's figure is zero.
std::string ratio(double slabd, double pcl) {
  return slabd > 0.0 ? fmt::format("1 : {:.3g}", pcl / slabd) : fmt::format("0 : {:.3g}", pcl);
}

/// Root mean square errors and mean times.
void print_errors(const Stage& stage, const char* first, const char* second, std::size_t scans) {
  const auto rms = [&](const Score& score, int which) {
    return std::sqrt(score.error2[which] / static_cast<double>(scans));
  };
  fmt::print("  {:44} {:>12} {:>12} {:>10}   slabd : PCL\n", "", first, second, "CPU s");
  for (const Score& score : stage) {
    fmt::print("  {:44} {:12.6f} {:12.6f} {:10.3f}", score.who, rms(score, 0), rms(score, 1),
               score.seconds / static_cast<double>(scans));
    if (std::string_view(score.who).starts_with("PCL"))
      fmt::print("   {}, {}, {}", ratio(rms(stage[0], 0), rms(score, 0)), ratio(rms(stage[0], 1), rms(score, 1)),
                 ratio(stage[0].seconds, score.seconds));
    fmt::print("\n");
  }
}

// ---- the seat plane ---------------------------------------------------------------------------------------------

/// Tilt (deg) and height (mm) errors of a plane n.p = d (scanner frame) against the true bearing plane, which goes
/// through the block's origin.
void score_plane(const Scene& scene, Score& score, const Vec3& n, double d, double seconds) {
  const double slope = scene.sight.station.block.slope_rad;
  const Pose& T = scene.sight.T_scanner_block;
  const Vec3 truth = T.rotation * Vec3(0.0, -std::sin(slope), std::cos(slope));
  const Vec3 up = n.dot(truth) < 0.0 ? Vec3(-n) : n;
  score.add(deg_from_rad(angle_between_rad(up, truth)), n.dot(T.translation_mm) - d, seconds);
}

Stage plane_stage() {
  return {{"slabd fit_plane"},
          {"PCL SACSegmentation, optimised (float)"},
          {"PCL ..., its inliers fitted again in double"},
          {"noise alone"}};
}

void compare_planes(const Scene& scene, Stage& stage) {
  const Pose T_block_scanner = scene.sight.T_scanner_block.inverse();
  std::vector<Vec3> points;
  Points cloud;
  for (std::size_t i = 0; i < scene.xyz.size(); i += 3) {
    const Vec3 p(static_cast<double>(scene.xyz[i]), static_cast<double>(scene.xyz[i + 1]),
                 static_cast<double>(scene.xyz[i + 2]));
    const Vec3 at = T_block_scanner * p;
    if (std::abs(at.x()) > 51.0 || std::abs(at.y()) > 75.0 || std::abs(at.z()) > 30.0) continue;
    points.push_back(p);
    cloud.emplace_back(scene.xyz[i], scene.xyz[i + 1], scene.xyz[i + 2]);
  }
  PlaneFit fit;
  const algo::PlaneSettings settings;
  const double time = cpu_seconds_of([&] { fit = algo::fit_plane(points, Vec3(0, 0, -1), settings); });
  score_plane(scene, stage[0], fit.normal, fit.offset_mm, time);
  stage[3].add(deg_from_rad(std::sqrt(fit.cov_normal.trace())), fit.sigma_offset_mm, 0.0);

  pcl::SACSegmentation<pcl::PointXYZ> segmentation;
  segmentation.setModelType(pcl::SACMODEL_PLANE);
  segmentation.setMethodType(pcl::SAC_RANSAC);
  segmentation.setDistanceThreshold(3.0 * scene.scanner.noise_mm);
  segmentation.setProbability(settings.confidence);
  segmentation.setMaxIterations(algo::hypotheses_needed(settings.contamination, settings.confidence, 3));
  segmentation.setOptimizeCoefficients(true);
  segmentation.setInputCloud(cloud.makeShared());
  pcl::PointIndices inliers;
  pcl::ModelCoefficients plane;
  const double segment_time = cpu_seconds_of([&] { segmentation.segment(inliers, plane); });
  const Vec3 n(static_cast<double>(plane.values[0]), static_cast<double>(plane.values[1]),
               static_cast<double>(plane.values[2]));
  score_plane(scene, stage[1], n, -static_cast<double>(plane.values[3]), segment_time);

  Vec3 normal;
  Eigen::Vector4d centroid;
  const double refit_time = cpu_seconds_of([&] {
    Eigen::Matrix3d covariance;
    double least = 0.0;
    pcl::computeMeanAndCovarianceMatrix(cloud, inliers.indices, covariance, centroid);
    pcl::eigen33(covariance, least, normal);
  });
  score_plane(scene, stage[2], normal, normal.dot(centroid.head<3>()), segment_time + refit_time);
}

// ---- outliers -----------------------------------------------------------------------------------------------------

/// Outliers are planted along z, at least 1 mm off; so what stands off the surface by half of that is one.
struct Census {
  std::size_t surface = 0;
  std::size_t outliers = 0;
};

Census take_census(const simulate::BlockSurface& surface, std::span<const float> xyz) {
  Census census;
  for (std::size_t i = 0; i + 2 < xyz.size(); i += 3) {
    const double depth = surface.depth_mm(static_cast<double>(xyz[i]), static_cast<double>(xyz[i + 1]));
    ++(std::abs(static_cast<double>(xyz[i + 2]) - depth) < 0.5 ? census.surface : census.outliers);
  }
  return census;
}

std::vector<float> floats_of(const Points& cloud) {
  std::vector<float> xyz;
  for (const pcl::PointXYZ& p : cloud) xyz.insert(xyz.end(), {p.x, p.y, p.z});
  return xyz;
}

Stage outlier_stage() {
  return {{"slabd denoise"}, {"PCL RadiusOutlierRemoval"}, {"PCL StatisticalOutlierRemoval"}};
}

/// Both programs get the raw scan; `denoised` becomes slabd's. PCL's parameters are those, of five or six tried each,
/// with the smallest sum of outliers left and surface lost.
void compare_denoising(const Scene& scene, algo::BlockInspector& inspector, std::vector<float>& denoised, Stage& stage,
                       Census& planted) {
  const simulate::BlockSurface surface = surface_of(scene);
  const Census before = take_census(surface, scene.xyz);
  planted.surface += before.surface;
  planted.outliers += before.outliers;
  if (before.outliers != scene.outliers)
    fmt::print(stderr, "{} outliers were planted, {} are counted\n", scene.outliers, before.outliers);
  const auto score = [&](Score& of, std::span<const float> kept, double seconds) {
    const Census after = take_census(surface, kept);
    of.outliers_left += after.outliers;
    of.surface_lost += before.surface - after.surface;
    of.seconds += seconds;
  };
  denoised = scene.xyz;
  algo::Cloud cloud{denoised, denoised.size() / 3, 0, 0};
  Status status = success();
  double time = cpu_seconds_of([&] { status = inspector.denoise(cloud); });
  if (!status) fmt::print(stderr, "slabd denoise: {}\n", status.error().text.view());
  denoised.resize(3 * cloud.points);
  score(stage[0], denoised, time);

  const Points::Ptr input = cloud_of(scene.xyz);
  Points kept;
  pcl::RadiusOutlierRemoval<pcl::PointXYZ> radius;
  radius.setInputCloud(input);
  radius.setRadiusSearch(2.3 * scene.pitch_mm());
  radius.setMinNeighborsInRadius(2);
  time = cpu_seconds_of([&] { radius.filter(kept); });
  score(stage[1], floats_of(kept), time);
  pcl::StatisticalOutlierRemoval<pcl::PointXYZ> statistical;
  statistical.setInputCloud(input);
  statistical.setMeanK(8);
  statistical.setStddevMulThresh(1.0);
  time = cpu_seconds_of([&] { statistical.filter(kept); });
  score(stage[2], floats_of(kept), time);
}

void print_outliers(const Stage& stage, const Census& planted, std::size_t scans) {
  fmt::print("  {:44} {:>12} {:>12} {:>10}   slabd : PCL\n", "", "left", "surface lost", "CPU s");
  for (const Score& score : stage) {
    fmt::print("  {:44} {:12} {:12} {:10.3f}", score.who, score.outliers_left, score.surface_lost,
               score.seconds / static_cast<double>(scans));
    if (&score != stage.data())
      fmt::print("   {} : {}, {} : {}, {}", stage[0].outliers_left, score.outliers_left, stage[0].surface_lost,
                 score.surface_lost, ratio(stage[0].seconds, score.seconds));
    fmt::print("\n");
  }
  fmt::print("  of {} planted outliers and {} surface points\n", planted.outliers, planted.surface);
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

/// Displacement of the block's origin (mm) and rotation (deg) against the truth.
void score_pose(const Scene& scene, Score& score, const Pose& T_scanner_block, double seconds) {
  const Pose off = scene.sight.T_scanner_block.inverse() * T_scanner_block;
  score.add(off.translation_mm.norm(), deg_from_rad(angle_between_rad(off.rotation, Quat::Identity())), seconds);
}

Stage pose_stage() {
  return {{"slabd register_to_model"}, {"PCL ICP with normals (double), every n-th"}, {"noise alone"}, {"the start"}};
}

/// PCL knows no analytic model: it gets a noise-free scan of the same block from the nominal view.
Oriented::Ptr perfect_scan(const Scene& scene) {
  Scene perfect = scene;
  perfect.sight.T_scanner_block = nominal_T_block_scanner().inverse();
  perfect.scanner.noise_mm = perfect.scanner.outlier_share = perfect.scanner.missing_share = 0.0;
  perfect.scanner.columns = 1024;
  perfect.scanner.rows = 1224;
  draw(perfect, 1);
  return with_normals(cloud_of(perfect.xyz));
}

void compare_poses(const Scene& scene, algo::BlockInspector& inspector, std::vector<float>& denoised,
                   const Oriented::Ptr& target, Stage& stage) {
  const Pose T_start = nominal_T_block_scanner().inverse();
  score_pose(scene, stage[3], T_start, 0.0);
  const algo::Cloud cloud{denoised, denoised.size() / 3, 0, 0};
  Status status = success();
  double time = cpu_seconds_of([&] { status = inspector.register_to_model(cloud); });
  if (!status) fmt::print(stderr, "slabd register_to_model: {}\n", status.error().text.view());
  const RegistrationReport& report = inspector.result().registration;
  score_pose(scene, stage[0], report.T_scanner_block, time);
  stage[2].add(std::sqrt(report.covariance.topLeftCorner<3, 3>().trace()),
               deg_from_rad(std::sqrt(report.covariance.bottomRightCorner<3, 3>().trace())), 0.0);

  // As many points as slabd's own ICP uses; all of a full scan would take PCL minutes.
  const Oriented::Ptr all = with_normals(cloud_of(denoised));
  auto source = std::make_shared<Oriented>();
  const std::size_t stride = std::max<std::size_t>(1, all->size() / limits::kIcpPointsMax);
  for (std::size_t i = 0; i < all->size(); i += stride) source->push_back((*all)[i]);
  pcl::IterativeClosestPointWithNormals<pcl::PointNormal, pcl::PointNormal, double> icp;
  icp.setInputSource(source);
  icp.setInputTarget(target);
  icp.setMaximumIterations(100);
  // Steps of 1e-4 mm (squared) or 4.5e-7 rad (as a cosine); a hundredth of that it did not reach in 100 steps.
  icp.setTransformationEpsilon(1e-8);
  icp.setTransformationRotationEpsilon(1.0 - 1e-13);
  icp.setEuclideanFitnessEpsilon(1e-9);
  // Pairs whose normals are more than 11 degrees apart are dropped: without that, edges shift the block by 0.01 mm.
  auto rejector = std::make_shared<pcl::registration::CorrespondenceRejectorSurfaceNormal>();
  rejector->setThreshold(0.98);
  icp.addCorrespondenceRejector(rejector);
  Oriented moved;
  time = 0.0;
  Eigen::Matrix4d T = Eigen::Matrix4d::Identity();
  for (const double reach_mm : {20.0, 3.0, 0.5}) {
    icp.setMaxCorrespondenceDistance(reach_mm);
    time += cpu_seconds_of([&] { icp.align(moved, T); });
    T = icp.getFinalTransformation();
    using Criteria = pcl::registration::DefaultConvergenceCriteria<double>;
    if (icp.getConvergeCriteria()->getConvergenceState() == Criteria::CONVERGENCE_CRITERIA_ITERATIONS)
      fmt::print(stderr, "PCL ICP, reach {} mm: still moving after 100 steps\n", reach_mm);
  }
  // T takes the scan into the nominal view's scanner frame.
  Pose T_nominal_scanner;
  T_nominal_scanner.rotation = Quat(Eigen::Quaterniond(T.topLeftCorner<3, 3>()));
  T_nominal_scanner.translation_mm = T.topRightCorner<3, 1>();
  score_pose(scene, stage[1], T_nominal_scanner.inverse() * T_start, time);
}

}  // namespace
}  // namespace slabd::oracle

int main(int argc, char** argv) {
  using namespace slabd;
  std::uint64_t seed = 1;
  std::size_t scans = 3;
  std::string points = "quarter";
  CLI::App app("Scans with known truth, measured by slabd's core and by PCL");
  app.add_option("--seed", seed, "Decides noise and views")->capture_default_str();
  app.add_option("--scans", scans, "Scans, each from another view")->check(CLI::Range(1, 1000))->capture_default_str();
  app.add_option("--points", points, "full or quarter")
      ->check(CLI::IsMember({"full", "quarter"}))
      ->capture_default_str();
  CLI11_PARSE(app, argc, argv);

  const std::optional<Recipe> recipe = accuracy::reference_recipe();
  if (!recipe) return 3;
  oracle::Scene scene{*recipe, {}, {}, {}};
  scene.scanner.organised = false;
  if (points == "quarter") {
    scene.scanner.columns /= 2;
    scene.scanner.rows /= 2;
  }
  algo::BlockInspector inspector;
  inspector.use(*recipe);
  oracle::Stage planes = oracle::plane_stage();
  oracle::Stage outliers = oracle::outlier_stage();
  oracle::Stage poses = oracle::pose_stage();
  oracle::Census planted;
  pcl::PointCloud<pcl::PointNormal>::Ptr target;
  for (std::size_t scan = 0; scan < scans; ++scan) {
    scene.sight = accuracy::varied_sight(*recipe, seed + scan);
    scene.sight.station.block = simulate::nominal_truth(*recipe);
    if (!target) target = oracle::perfect_scan(scene);
    oracle::draw(scene, simulate::derived_seed(seed + scan, 12, 0));
    std::vector<float> denoised;
    inspector.begin(1, Pose::identity(), nominal_T_block_scanner());
    oracle::compare_planes(scene, planes);
    oracle::compare_denoising(scene, inspector, denoised, outliers, planted);
    oracle::compare_poses(scene, inspector, denoised, target, poses);
    fmt::print(stderr, "scan {} of {} done\n", scan + 1, scans);
  }
  fmt::print("seat plane\n");
  oracle::print_errors(planes, "tilt deg", "height mm", scans);
  fmt::print("outliers\n");
  oracle::print_outliers(outliers, planted, scans);
  fmt::print("pose of the block\n");
  oracle::print_errors(poses, "place mm", "turn deg", scans);
  return 0;
}
