// SPDX-License-Identifier: Apache-2.0
//
// One block with Open3D, as a careful user writes it; the jobs are those of pcl_peer.cpp. OMP_NUM_THREADS sets the
// number of threads.
#include <open3d/Open3DConfig.h>
#include <open3d/geometry/BoundingVolume.h>
#include <open3d/geometry/PointCloud.h>
#include <open3d/io/PointCloudIO.h>
#include <open3d/pipelines/registration/Registration.h>
#include <open3d/pipelines/registration/TransformationEstimation.h>
#include <open3d/utility/Logging.h>

#include "bench/peers/peer.h"

namespace {

namespace registration = open3d::pipelines::registration;
using open3d::geometry::PointCloud;
using slabd::bench::Peer;
using slabd::bench::PlaneAnswer;
using slabd::bench::Rigid;

Eigen::Matrix4d matrix_of(const Rigid& T) {
  Eigen::Matrix4d m;
  for (int row = 0; row < 4; ++row)
    for (int column = 0; column < 4; ++column) m(row, column) = T[static_cast<std::size_t>(4 * row + column)];
  return m;
}

Rigid rigid_of(const Eigen::Matrix4d& m) {
  Rigid T{};
  for (int row = 0; row < 4; ++row)
    for (int column = 0; column < 4; ++column) T[static_cast<std::size_t>(4 * row + column)] = m(row, column);
  return T;
}

PointCloud cloud_of(const std::vector<float>& xyz) {
  PointCloud cloud;
  cloud.points_.reserve(xyz.size() / 3);
  for (std::size_t i = 0; i + 2 < xyz.size(); i += 3) cloud.points_.emplace_back(xyz[i], xyz[i + 1], xyz[i + 2]);
  return cloud;
}

PointCloud model_of(const std::vector<float>& values) {
  PointCloud model;
  for (std::size_t i = 0; i + 5 < values.size(); i += 6) {
    model.points_.emplace_back(values[i], values[i + 1], values[i + 2]);
    model.normals_.emplace_back(values[i + 3], values[i + 4], values[i + 5]);
  }
  return model;
}

Eigen::Matrix4d register_points(const PointCloud& source, const PointCloud& model) {
  return registration::RegistrationICP(
             source, model, slabd::bench::kIcpGate_mm, Eigen::Matrix4d::Identity(),
             registration::TransformationEstimationPointToPlane(),
             registration::ICPConvergenceCriteria(1e-6, 1e-6, slabd::bench::kIcpIterationsMax))
      .transformation_;
}

PlaneAnswer segment_plane(const PointCloud& cloud) {
  constexpr int kPointsPerPlane = 3;
  constexpr int kPlanes = 50;  // as many as PCL's default; Open3D's default of 100 has no benefit here
  const auto [plane, inliers] = cloud.SegmentPlane(slabd::bench::kPlaneInlier_mm, kPointsPerPlane, kPlanes);
  PlaneAnswer answer;
  answer.normal = {plane[0], plane[1], plane[2]};
  answer.offset_mm = -plane[3];
  return answer;
}

const double* numbers(const PointCloud& cloud) {
  return cloud.points_.empty() ? nullptr : cloud.points_.front().data();
}
constexpr std::size_t kStride = 3;

void run_block(Peer& peer, bool denoise_all) {
  const PointCloud model = model_of(peer.floats("model.f32"));
  const Eigen::Matrix4d start = matrix_of(peer.truth().T_block_scanner_start);
  peer.begin();
  auto cloud = std::make_shared<PointCloud>();
  open3d::io::ReadPointCloudOption option;
  option.remove_nan_points = option.remove_infinite_points = false;
  open3d::io::ReadPointCloud(peer.path("scan.ply"), *cloud, option);
  peer.lap("read");

  const std::size_t read = cloud->points_.size();
  std::vector<std::size_t> kept;
  if (denoise_all) {
    std::tie(cloud, kept) = cloud->RemoveStatisticalOutliers(slabd::bench::kSorNeighbours, slabd::bench::kSorSigmas);
    peer.lap("outliers");
  }

  cloud->Transform(start);
  peer.lap("transform");
  std::shared_ptr<PointCloud> voxels = cloud->VoxelDownSample(slabd::bench::kVoxel_mm);
  peer.lap("voxels");
  if (!denoise_all) {
    std::tie(voxels, kept) = voxels->RemoveStatisticalOutliers(slabd::bench::kSorNeighbours, slabd::bench::kSorSigmas);
    peer.lap("outliers");
  }

  const Eigen::Matrix4d T = register_points(*voxels, model);
  peer.lap("register");

  cloud->Transform(T);
  PointCloud crop;
  crop.points_.reserve(cloud->points_.size() / 2);
  for (const Eigen::Vector3d& p : cloud->points_) {
    if (std::abs(p.x()) < slabd::bench::kCropX_mm && std::abs(p.y()) < slabd::bench::kCropY_mm &&
        std::abs(p.z() - slabd::bench::kSlope * p.y()) < slabd::bench::kCropZ_mm)
      crop.points_.push_back(p);
  }
  peer.lap("crop");

  PlaneAnswer plane = segment_plane(crop);
  peer.lap("plane");
  slabd::bench::refit_plane(numbers(crop), crop.points_.size(), kStride, slabd::bench::kPlaneInlier_mm, plane);
  peer.lap("refit");
  slabd::bench::spread_about(numbers(crop), crop.points_.size(), kStride, slabd::bench::kPlaneInlier_mm, plane);
  peer.lap("flatness");
  peer.end();

  const Rigid T_block_scanner = slabd::bench::product(rigid_of(T), peer.truth().T_block_scanner_start);
  peer.score_pose(T_block_scanner);
  peer.score_normal(slabd::bench::rotated(slabd::bench::inverse(T_block_scanner), plane.normal));
  peer.figure("plane_points", static_cast<double>(plane.inliers));
  peer.figure("std_mm", plane.std_mm);
  if (denoise_all) {
    std::vector<bool> stays(read, false);
    for (const std::size_t index : kept) stays[index] = true;
    peer.score_denoising(stays);
  }
}

void run_register(Peer& peer) {
  const PointCloud model = model_of(peer.floats("model.f32"));
  PointCloud clean = cloud_of(peer.floats("clean.f32"));
  clean.Transform(matrix_of(peer.truth().T_block_scanner_start));
  peer.begin();
  const Eigen::Matrix4d T = register_points(clean, model);
  peer.lap("register");
  peer.end();
  peer.score_pose(slabd::bench::product(rigid_of(T), peer.truth().T_block_scanner_start));
}

void run_plane(Peer& peer, bool refit) {
  const PointCloud crop = cloud_of(peer.floats("crop.f32"));
  peer.begin();
  PlaneAnswer plane = segment_plane(crop);
  peer.lap("plane");
  if (refit) {
    slabd::bench::refit_plane(numbers(crop), crop.points_.size(), kStride, slabd::bench::kPlaneInlier_mm, plane);
    peer.lap("refit");
  }
  peer.end();
  peer.score_normal(plane.normal);
}

}  // namespace

int main(int argc, char** argv) {
  Peer peer(argc, argv, "Open3D", OPEN3D_VERSION);
  open3d::utility::SetVerbosityLevel(open3d::utility::VerbosityLevel::Error);
  for (int i = 0; i < peer.repeats(); ++i) {
    if (peer.job() == "block-tuned") run_block(peer, false);
    if (peer.job() == "block-spec") run_block(peer, true);
    if (peer.job() == "register") run_register(peer);
    if (peer.job() == "plane") run_plane(peer, false);
    if (peer.job() == "plane-refit") run_plane(peer, true);
  }
  return peer.print();
}
