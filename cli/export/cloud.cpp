// SPDX-License-Identifier: Apache-2.0
//
// A slab's scans have 90 million points. They are written one scan at a time: read, denoised as in measuring, moved
// into the frame, thinned, appended. Their number is known only at the end, so the header reserves space for it and is
// written again.
//
// Invariants: memory for one scan, whatever the slab; the same scans give the same bytes (means are summed in scan
// order, cubes are sorted by position).
#include "cli/export/cloud.h"

#include <fmt/core.h>

#include <algorithm>
#include <cmath>
#include <cstring>

#include "algo/algo.h"
#include "algo/block_model.h"
#include "base/durable.h"
#include "base/jobs.h"
#include "base/pages.h"
#include "report/slab_view.h"

namespace slabd::cli {
namespace {

using algo::Face;

constexpr std::size_t kHeaderBytes = 1024;
constexpr std::size_t kBufferBytes = std::size_t{1} << 20U;

/// A PLY file of vertices with appended points.
class VertexFile {
 public:
  VertexFile(const std::string& path, std::string comments, std::string properties)
      : out_(path, {.rewritten = true}), comments_(std::move(comments)), properties_(std::move(properties)) {
    out_.write(header());
  }
  template <typename T>
  void put(T value) {
    std::array<char, sizeof value> raw{};
    std::memcpy(raw.data(), &value, sizeof value);
    buffer_.append(raw.data(), raw.size());
  }
  void put(const Vec3& p) {
    for (const double x : {p.x(), p.y(), p.z()}) put(static_cast<float>(x));
  }
  void end_vertex() {
    ++count_;
    if (buffer_.size() < kBufferBytes) return;
    out_.write(buffer_);
    buffer_.clear();
  }
  [[nodiscard]] std::size_t count() const { return count_; }
  [[nodiscard]] Status close() {
    out_.write(buffer_);
    out_.write_at_start(header());
    return out_.close();
  }

 private:
  [[nodiscard]] std::string header() const {
    const std::string head = "ply\nformat binary_little_endian 1.0\n" + comments_ + "comment unit mm\n";
    const std::string tail = fmt::format("element vertex {}\n{}end_header\n", count_, properties_);
    const std::size_t used = head.size() + tail.size() + std::strlen("comment \n");
    return head + "comment " + std::string(kHeaderBytes > used ? kHeaderBytes - used : 0, '.') + "\n" + tail;
  }

  OutFile out_;
  std::string comments_;
  std::string properties_;
  std::string buffer_;
  std::size_t count_ = 0;
};

/// Reads one scan at a time and removes points that are not on a surface.
class ScanReader {
 public:
  explicit ScanReader(const Recipe& recipe)
      : memory_(limits::kScanSlotBytes), xyz_(memory_.take<float>(limits::kScanPointsMax * 3)) {
    inspector_.use(recipe);
  }
  /// The error contains the reason.
  Status read(const storage::SlabBlock& block, const CloudSettings& settings) {
    const std::string path = scan_at(block, settings.scans_dir);
    const Result<ScanShape> shape = hal::read_scan(path.c_str(), settings.form, xyz_);
    if (!shape) return shape.error();
    cloud_ = {xyz_, shape.value().points, shape.value().width, shape.value().height};
    inspector_.begin(block.attempt.station, Pose::identity(), Pose::identity());
    return inspector_.denoise(cloud_);
  }
  /// Calls f(p_scanner) for every remaining point.
  template <typename F>
  void for_each(const F& f) const {
    for (std::size_t i = 0; i < cloud_.points; ++i)
      if (std::isfinite(xyz_[3 * i])) f(Vec3(xyz_[3 * i], xyz_[3 * i + 1], xyz_[3 * i + 2]));
  }

 private:
  Pages memory_;
  std::span<float> xyz_;
  algo::Cloud cloud_;
  algo::BlockInspector inspector_;
};

/// Collects points by cube and returns their means.
class Thinner {
 public:
  explicit Thinner(double voxel_mm) : voxel_mm_(voxel_mm) {}
  void add(const Vec3& p) {
    const auto cell = [&](double x) {
      return static_cast<std::uint64_t>(static_cast<std::int64_t>(std::floor(x / voxel_mm_)) + (1 << 20)) & 0x1F'FFFFU;
    };
    places_.push_back(
        {(cell(p.x()) << 42U) | (cell(p.y()) << 21U) | cell(p.z()), static_cast<std::uint32_t>(points_.size())});
    points_.push_back({static_cast<float>(p.x()), static_cast<float>(p.y()), static_cast<float>(p.z())});
  }
  template <typename F>
  void give(const F& f) {
    std::sort(places_.begin(), places_.end(),
              [](const Place& a, const Place& b) { return a.cube != b.cube ? a.cube < b.cube : a.point < b.point; });
    for (std::size_t i = 0; i < places_.size();) {
      Vec3 sum = Vec3::Zero();
      std::size_t end = i;
      for (; end < places_.size() && places_[end].cube == places_[i].cube; ++end) {
        const auto& p = points_[places_[end].point];
        sum += Vec3(p[0], p[1], p[2]);
      }
      f(Vec3(sum / static_cast<double>(end - i)));
      i = end;
    }
    places_.clear();
    points_.clear();
  }

 private:
  struct Place {
    std::uint64_t cube;
    std::uint32_t point;
  };
  double voxel_mm_;
  std::vector<Place> places_;
  std::vector<std::array<float, 3>> points_;
};

std::string comments_of(const storage::SlabRecord& record, std::string_view frame) {
  const SlabHeader& slab = record.summary.header;
  std::string id(slab.slab_id.view());
  std::replace_if(
      id.begin(), id.end(), [](unsigned char c) { return c < 0x20; }, '?');
  return fmt::format("comment slabd slab {} {}\ncomment frame {}\n", slab.key, id, frame);
}

}  // namespace

Result<CloudCount> write_block_cloud(const std::string& path, const storage::SlabRecord& record, int station,
                                     const Recipe& recipe, const CloudSettings& settings) {
  const storage::SlabBlock* block = report::latest(record, station);
  if (block == nullptr || block->phase != StationPhase::measured ||
      block->block.registration.status != RegistrationStatus::converged)
    return error(Code::config, "block %d was not found in a scan of this slab", station);
  ScanReader scan(recipe);
  if (const Status read = scan.read(*block, settings); !read) return read.error();

  algo::BlockModel model;
  model.build(recipe.block);
  std::vector<std::uint16_t> wide(algo::FaceTable::kCells);
  std::vector<std::uint16_t> near(algo::FaceTable::kCells);
  std::vector<std::uint16_t> scratch(algo::FaceTable::kCells);
  algo::FaceTable table;
  table.build(model, wide, near, scratch);

  CloudCount count;
  const Pose T_block_scanner = block->block.registration.T_scanner_block.inverse();
  VertexFile file(
      path, comments_of(record, fmt::format("of block {}, as registered", station)),
      "property float x\nproperty float y\nproperty float z\nproperty float deviation_mm\nproperty uchar face\n");
  scan.for_each([&](const Vec3& p_scanner) {
    const Vec3 p = T_block_scanner * p_scanner;
    Face face = Face::seat;
    double deviation = 0.0;
    if (!algo::closest_face(model.planes(), table.wide_at(p), p, face, deviation) ||
        std::abs(deviation) > algo::FaceTable::kWide_mm) {
      ++count.left_out;
      return;
    }
    file.put(p);
    file.put(static_cast<float>(deviation));
    file.put(static_cast<std::uint8_t>(face));
    file.end_vertex();
  });
  count.points = file.count();
  if (const Status closed = file.close(); !closed) return closed.error();
  return count;
}

Result<CloudCount> write_slab_cloud(const std::string& path, const storage::SlabRecord& record, const Recipe& recipe,
                                    const CloudSettings& settings) {
  const SlabHeader& slab = record.summary.header;
  const bool fitted = record.slab.fit.ok;
  const Pose T_slab_base = (fitted ? record.slab.fit.T_base_slab : slab.T_base_slab).inverse();
  CloudCount count;
  VertexFile file(path,
                  comments_of(record, fitted ? "of the slab, as fitted" : "of the slab, as configured (not fitted)"),
                  "property float x\nproperty float y\nproperty float z\nproperty uchar station\n");
  ScanReader scan(recipe);
  Thinner thinner(settings.voxel_mm);
  for (int station = 1; station <= slab.stations; ++station) {
    const storage::SlabBlock* block = report::latest(record, station);
    if (block == nullptr || block->attempt.scan_path.empty()) {
      count.not_scanned.push_back(fmt::format("block {}: no scan of it", station));
      continue;
    }
    if (const Status read = scan.read(*block, settings); !read) {
      count.not_scanned.push_back(fmt::format("block {}: {}", station, read.error().text.view()));
      continue;
    }
    const Pose T_slab_scanner = T_slab_base * stored_T_base_scanner(slab, block->attempt);
    const auto put = [&](const Vec3& p_slab) {
      file.put(p_slab);
      file.put(static_cast<std::uint8_t>(station));
      file.end_vertex();
    };
    scan.for_each([&](const Vec3& p_scanner) {
      const Vec3 p_slab = T_slab_scanner * p_scanner;
      if (settings.voxel_mm > 0.0)
        thinner.add(p_slab);
      else
        put(p_slab);
    });
    if (settings.voxel_mm > 0.0) thinner.give(put);
  }
  count.points = file.count();
  if (count.points == 0) return error(Code::config, "none of the slab's scans is there");
  if (const Status closed = file.close(); !closed) return closed.error();
  return count;
}

}  // namespace slabd::cli
