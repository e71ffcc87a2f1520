// SPDX-License-Identifier: Apache-2.0
//
// One block with the Point Cloud Library, as a careful user writes it. `block-tuned` removes outliers on the voxels
// only; `block-spec` on the whole cloud, as a method that begins with outlier removal requires. `register` and `plane`
// are those two steps alone, on inputs prepared by the driver.
#include <pcl/common/io.h>
#include <pcl/common/transforms.h>
#include <pcl/filters/statistical_outlier_removal.h>
#include <pcl/filters/voxel_grid.h>
#include <pcl/io/ply_io.h>
#include <pcl/pcl_config.h>
#include <pcl/registration/icp.h>
#include <pcl/registration/transformation_estimation_point_to_plane_lls.h>
#include <pcl/segmentation/sac_segmentation.h>

#include "bench/peers/peer.h"

namespace {

using slabd::bench::Direction;
using slabd::bench::Peer;
using slabd::bench::PlaneAnswer;
using slabd::bench::Rigid;
using Points = pcl::PointCloud<pcl::PointXYZ>;
using Model = pcl::PointCloud<pcl::PointNormal>;

Eigen::Matrix4f matrix_of(const Rigid& T) {
  Eigen::Matrix4f m;
  for (int row = 0; row < 4; ++row)
    for (int column = 0; column < 4; ++column)
      m(row, column) = static_cast<float>(T[static_cast<std::size_t>(4 * row + column)]);
  return m;
}

Rigid rigid_of(const Eigen::Matrix4f& m) {
  Rigid T{};
  for (int row = 0; row < 4; ++row)
    for (int column = 0; column < 4; ++column) T[static_cast<std::size_t>(4 * row + column)] = m(row, column);
  return T;
}

Points::Ptr cloud_of(const std::vector<float>& xyz) {
  auto cloud = std::make_shared<Points>();
  cloud->reserve(xyz.size() / 3);
  for (std::size_t i = 0; i + 2 < xyz.size(); i += 3) cloud->emplace_back(xyz[i], xyz[i + 1], xyz[i + 2]);
  return cloud;
}

Model::Ptr model_of(const std::vector<float>& values) {
  auto model = std::make_shared<Model>();
  model->reserve(values.size() / 6);
  for (std::size_t i = 0; i + 5 < values.size(); i += 6) {
    const float* v = &values[i];
    model->emplace_back(v[0], v[1], v[2], v[3], v[4], v[5]);
  }
  return model;
}

/// Registers point to plane, target tree included; both clouds in the block frame. PCL 1.13 compiles its ICP only for
/// one point type, so the scan has unused normals.
Eigen::Matrix4f register_points(const Points::Ptr& scan, const Model::Ptr& model) {
  auto source = std::make_shared<Model>();
  pcl::copyPointCloud(*scan, *source);
  pcl::IterativeClosestPoint<pcl::PointNormal, pcl::PointNormal> icp;
  icp.setTransformationEstimation(
      std::make_shared<
          pcl::registration::TransformationEstimationPointToPlaneLLS<pcl::PointNormal, pcl::PointNormal>>());
  icp.setInputSource(source);
  icp.setInputTarget(model);
  icp.setMaxCorrespondenceDistance(slabd::bench::kIcpGate_mm);
  icp.setMaximumIterations(slabd::bench::kIcpIterationsMax);
  icp.setTransformationEpsilon(1e-8);
  Model moved;
  icp.align(moved);
  return icp.getFinalTransformation();
}

PlaneAnswer segment_plane(const Points::Ptr& cloud) {
  pcl::SACSegmentation<pcl::PointXYZ> segmentation;
  segmentation.setModelType(pcl::SACMODEL_PLANE);
  segmentation.setMethodType(pcl::SAC_RANSAC);
  segmentation.setDistanceThreshold(slabd::bench::kPlaneInlier_mm);
  segmentation.setOptimizeCoefficients(true);
  segmentation.setInputCloud(cloud);
  pcl::PointIndices inliers;
  pcl::ModelCoefficients plane;
  segmentation.segment(inliers, plane);
  PlaneAnswer answer;
  if (plane.values.size() == 4) {
    answer.normal = {plane.values[0], plane.values[1], plane.values[2]};
    answer.offset_mm = -plane.values[3];
  }
  return answer;
}

const float* numbers(const Points& cloud) {
  return cloud.points.empty() ? nullptr : cloud.points.front().data;
}
constexpr std::size_t kStride = sizeof(pcl::PointXYZ) / sizeof(float);

void run_block(Peer& peer, bool denoise_all) {
  const Model::Ptr model = model_of(peer.floats("model.f32"));
  const Eigen::Matrix4f start = matrix_of(peer.truth().T_block_scanner_start);
  peer.begin();
  auto cloud = std::make_shared<Points>();
  pcl::PLYReader().read(peer.path("scan.ply"), *cloud);
  peer.lap("read");

  pcl::StatisticalOutlierRemoval<pcl::PointXYZ> outliers(denoise_all);
  outliers.setMeanK(slabd::bench::kSorNeighbours);
  outliers.setStddevMulThresh(slabd::bench::kSorSigmas);
  auto kept = cloud;
  if (denoise_all) {
    kept = std::make_shared<Points>();
    outliers.setInputCloud(cloud);
    outliers.filter(*kept);
    peer.lap("outliers");
  }

  auto started = std::make_shared<Points>();
  pcl::transformPointCloud(*kept, *started, start);
  peer.lap("transform");

  auto voxels = std::make_shared<Points>();
  pcl::VoxelGrid<pcl::PointXYZ> grid;
  const auto leaf = static_cast<float>(slabd::bench::kVoxel_mm);
  grid.setLeafSize(leaf, leaf, leaf);
  grid.setInputCloud(started);
  grid.filter(*voxels);
  peer.lap("voxels");

  if (!denoise_all) {
    auto clean = std::make_shared<Points>();
    outliers.setInputCloud(voxels);
    outliers.filter(*clean);
    voxels = clean;
    peer.lap("outliers");
  }

  const Eigen::Matrix4f T = register_points(voxels, model);
  peer.lap("register");

  Points posed;
  pcl::transformPointCloud(*started, posed, T);
  auto crop = std::make_shared<Points>();
  crop->reserve(posed.size() / 2);
  for (const pcl::PointXYZ& p : posed) {
    if (std::abs(p.x) < static_cast<float>(slabd::bench::kCropX_mm) &&
        std::abs(p.y) < static_cast<float>(slabd::bench::kCropY_mm) &&
        std::abs(p.z - static_cast<float>(slabd::bench::kSlope) * p.y) < static_cast<float>(slabd::bench::kCropZ_mm))
      crop->push_back(p);
  }
  peer.lap("crop");

  PlaneAnswer plane = segment_plane(crop);
  peer.lap("plane");
  slabd::bench::refit_plane(numbers(*crop), crop->size(), kStride, slabd::bench::kPlaneInlier_mm, plane);
  peer.lap("refit");
  slabd::bench::spread_about(numbers(*crop), crop->size(), kStride, slabd::bench::kPlaneInlier_mm, plane);
  peer.lap("flatness");
  peer.end();

  const Rigid T_block_scanner = slabd::bench::product(rigid_of(T), peer.truth().T_block_scanner_start);
  peer.score_pose(T_block_scanner);
  peer.score_normal(slabd::bench::rotated(slabd::bench::inverse(T_block_scanner), plane.normal));
  peer.figure("plane_points", static_cast<double>(plane.inliers));
  peer.figure("std_mm", plane.std_mm);
  if (denoise_all) {
    std::vector<bool> stays(cloud->size(), true);
    for (const int removed : *outliers.getRemovedIndices()) stays[static_cast<std::size_t>(removed)] = false;
    peer.score_denoising(stays);
  }
}

void run_register(Peer& peer) {
  const Model::Ptr model = model_of(peer.floats("model.f32"));
  const Points::Ptr clean = cloud_of(peer.floats("clean.f32"));
  const Eigen::Matrix4f start = matrix_of(peer.truth().T_block_scanner_start);
  auto started = std::make_shared<Points>();
  pcl::transformPointCloud(*clean, *started, start);
  peer.begin();
  const Eigen::Matrix4f T = register_points(started, model);
  peer.lap("register");
  peer.end();
  peer.score_pose(slabd::bench::product(rigid_of(T), peer.truth().T_block_scanner_start));
}

void run_plane(Peer& peer, bool refit) {
  const Points::Ptr crop = cloud_of(peer.floats("crop.f32"));
  peer.begin();
  PlaneAnswer plane = segment_plane(crop);
  peer.lap("plane");
  if (refit) {
    slabd::bench::refit_plane(numbers(*crop), crop->size(), kStride, slabd::bench::kPlaneInlier_mm, plane);
    peer.lap("refit");
  }
  peer.end();
  peer.score_normal(plane.normal);
}

}  // namespace

int main(int argc, char** argv) {
  Peer peer(argc, argv, "PCL", PCL_VERSION_PRETTY);
  for (int i = 0; i < peer.repeats(); ++i) {
    if (peer.job() == "block-tuned") run_block(peer, false);
    if (peer.job() == "block-spec") run_block(peer, true);
    if (peer.job() == "register") run_register(peer);
    if (peer.job() == "plane") run_plane(peer, false);
    if (peer.job() == "plane-refit") run_plane(peer, true);
  }
  return peer.print();
}
