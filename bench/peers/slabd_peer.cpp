// SPDX-License-Identifier: Apache-2.0
//
// slabd as one of the compared programs: the same tasks, clocks and counters as the libraries. `block` is the whole
// block from the file to the verdict, as the daemon measures it.
#include <algorithm>
#include <cmath>
#include <iostream>

#include "base/pages.h"
#include "bench/peers/peer.h"
#include "hal/hal.h"
#include "tests/accuracy/block_scan.h"

namespace {

using namespace slabd;
using bench::Peer;

[[noreturn]] void give_up(const Error& failure) {
  std::cerr << "slabd_peer: " << failure.text.view() << "\n";
  std::exit(1);
}

bench::Direction direction_of(const Vec3& v) {
  return {v.x(), v.y(), v.z()};
}

bench::Rigid rigid_of(const Pose& pose) {
  const Mat4 m = pose.matrix();
  bench::Rigid T{};
  for (int row = 0; row < 4; ++row)
    for (int column = 0; column < 4; ++column) T[static_cast<std::size_t>(4 * row + column)] = m(row, column);
  return T;
}

/// Objects that every job needs, created once, as the daemon does at its start.
struct Bench {
  Recipe recipe;
  Pages pages{limits::kScanSlotBytes};
  std::span<float> buffer = pages.take<float>(3 * limits::kScanPointsMax);
  algo::BlockInspector inspector;

  explicit Bench(const Peer& peer) : recipe(accuracy::reference_recipe().value()), inspector(peer.threads()) {
    inspector.use(recipe);
  }

  algo::Cloud read(const std::string& path) {
    const Result<ScanShape> shape = hal::read_scan(path.c_str(), hal::LengthUnit::mm, buffer, inspector.team());
    if (!shape) give_up(shape.error());
    return {buffer, shape.value().points, shape.value().width, shape.value().height};
  }
};

void run_block(Peer& peer, Bench& bench, const char* file) {
  const std::string path = peer.path(file);
  peer.begin();
  algo::Cloud cloud = bench.read(path);
  peer.lap("read");
  algo::BlockInspector& inspector = bench.inspector;
  inspector.begin(1, Pose::identity(), nominal_T_block_scanner());
  Status status = inspector.denoise(cloud);
  peer.lap("outliers");
  if (status) status = inspector.register_to_model(cloud);
  peer.lap("register");
  if (status) status = inspector.extract(cloud);
  inspector.judge(status ? Code::ok : status.error().code);
  peer.lap("extract, judge");
  peer.end();
  if (!status) give_up(status.error());

  const BlockResult& result = inspector.result();
  const bench::Rigid T_scanner_block = rigid_of(result.registration.T_scanner_block);
  peer.score_pose(bench::inverse(T_scanner_block));
  peer.score_normal(bench::rotated(T_scanner_block, direction_of(result.seat.full_plane.normal)));
  peer.figure("plane_points", static_cast<double>(result.seat.full_plane.inliers));
  peer.figure("std_mm", result.seat.full_plane.std_mm);
  double measured = 0.0;
  for (const Item& item : result.items) measured += has_value(item.value) ? 1.0 : 0.0;
  peer.figure("items_measured", measured);
}

void run_denoise(Peer& peer, Bench& bench) {
  algo::Cloud cloud = bench.read(peer.path("scan.ply"));
  const std::vector<float> drawn(cloud.xyz.begin(), cloud.xyz.begin() + static_cast<std::ptrdiff_t>(3 * cloud.points));
  peer.begin();
  bench.inspector.begin(1, Pose::identity(), nominal_T_block_scanner());
  const Status status = bench.inspector.denoise(cloud);
  peer.lap("outliers");
  peer.end();
  if (!status) give_up(status.error());
  // The remaining points are in the order of the scan: a point was kept if it is the next finite one.
  std::vector<bool> kept(drawn.size() / 3, false);
  std::size_t next = 0;
  for (std::size_t i = 0; i < kept.size(); ++i) {
    while (next < cloud.points && !std::isfinite(cloud.xyz[3 * next])) ++next;
    kept[i] = next < cloud.points && std::equal(&drawn[3 * i], &drawn[3 * i] + 3, &cloud.xyz[3 * next]);
    next += kept[i] ? 1U : 0U;
  }
  peer.score_denoising(kept);
}

/// Runs the registration alone on the whole denoised scan, because slabd needs no voxels.
void run_register(Peer& peer, Bench& bench) {
  algo::Cloud cloud = bench.read(peer.path("scan.ply"));
  bench.inspector.begin(1, Pose::identity(), nominal_T_block_scanner());
  Status status = bench.inspector.denoise(cloud);
  peer.begin();
  if (status) status = bench.inspector.register_to_model(cloud);
  peer.lap("register");
  peer.end();
  if (!status) give_up(status.error());
  peer.score_pose(bench::inverse(rigid_of(bench.inspector.result().registration.T_scanner_block)));
}

void run_plane(Peer& peer) {
  const std::vector<float> xyz = peer.floats("crop.f32");
  std::vector<Vec3> points;
  points.reserve(xyz.size() / 3);
  for (std::size_t i = 0; i + 2 < xyz.size(); i += 3)
    points.emplace_back(static_cast<double>(xyz[i]), static_cast<double>(xyz[i + 1]), static_cast<double>(xyz[i + 2]));
  algo::PlaneSettings settings;
  settings.threshold_mm = bench::kPlaneInlier_mm;
  peer.begin();
  const PlaneFit fit = algo::fit_plane(points, Vec3(0.0, 0.0, -1.0), settings);
  peer.lap("plane");
  peer.end();
  peer.score_normal(direction_of(fit.normal));
}

}  // namespace

int main(int argc, char** argv) {
  Peer peer(argc, argv, "slabd", SLABD_VERSION);
  if (peer.job() == "plane") {
    for (int i = 0; i < peer.repeats(); ++i) run_plane(peer);
    return peer.print();
  }
  Bench bench(peer);
  for (int i = 0; i < peer.repeats(); ++i) {
    if (peer.job() == "block") run_block(peer, bench, "scan.ply");
    if (peer.job() == "block-organised") run_block(peer, bench, "scan_organised.ply");
    if (peer.job() == "denoise") run_denoise(peer, bench);
    if (peer.job() == "register") run_register(peer, bench);
  }
  return peer.print();
}
