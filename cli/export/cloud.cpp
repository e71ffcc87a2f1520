// SPDX-License-Identifier: Apache-2.0
//
// A slab's scans have 90 million points. They are written one scan at a time: read, denoised as in measuring, moved
// into the frame, thinned, appended. Their number is known only at the end, so the header reserves space for it and is
// written again.
//
// The page's cloud is one block's, thinned to what a browser turns, in whole numbers.
//
// Invariants: memory for one scan, whatever the slab; the same scans give the same bytes (means are summed in scan
// order, cubes are sorted by position).
#include "cli/export/cloud.h"

#include <fmt/core.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstring>

#include "algo/algo.h"
#include "algo/block_model.h"
#include "base/durable.h"
#include "base/jobs.h"
#include "base/pages.h"
#include "report/json.h"
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

/// Code::config: the file does not hold the points that were measured.
Status need_measured_points(const Attempt& attempt, std::span<const float> points) {
  const std::optional<std::uint32_t>& crc32c = attempt.points_crc32c;
  if (points.size() == 3 * attempt.shape.points && (!crc32c || *crc32c == hal::points_crc32c(points))) return success();
  return error(Code::config,
               "its scan was changed, or is in another unit: its points are not those that were measured");
}

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
    const Result<ScanShape> shape = hal::read_scan(path.c_str(), settings.forms.of(block.attempt), xyz_);
    if (!shape) return shape.error();
    // Before points are removed.
    if (Status same = need_measured_points(block.attempt, xyz_.first(3 * shape.value().points)); !same) return same;
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

/// Signed distance of a point to the nearest face of the recipe's block.
class NearestFace {
 public:
  explicit NearestFace(const Recipe& recipe) {
    model_.build(recipe.block);
    std::vector<std::uint16_t> scratch(algo::FaceTable::kCells);
    table_.build(model_, wide_, near_, scratch);
  }
  /// False if the point is further than FaceTable::kWide_mm from all faces.
  bool find(const Vec3& p_block, Face& face, double& deviation_mm) const {
    return algo::closest_face(model_.planes(), table_.wide_at(p_block), p_block, face, deviation_mm) &&
           std::abs(deviation_mm) <= algo::FaceTable::kWide_mm;
  }

 private:
  std::vector<std::uint16_t> wide_ = std::vector<std::uint16_t>(algo::FaceTable::kCells);
  std::vector<std::uint16_t> near_ = std::vector<std::uint16_t>(algo::FaceTable::kCells);
  algo::BlockModel model_;
  algo::FaceTable table_;
};

std::string comments_of(const storage::SlabRecord& record, std::string_view frame) {
  const SlabHeader& slab = record.summary.header;
  std::string id(slab.slab_id.view());
  std::replace_if(
      id.begin(), id.end(), [](unsigned char c) { return c < 0x20; }, '?');
  return fmt::format("comment slabd slab {} {}\ncomment frame {}\n", slab.key, id, frame);
}

// ---- the page's cloud ----------------------------------------------------------------------------------------------

/// Half edge of the cube around the block's origin whose points are given. A block and the slab around it need 300 mm;
/// a stray point far away would make the step of the coordinates coarse.
constexpr double kCloudReach_mm = 500.0;
/// Whole numbers are -32767..32767; -32768 is a missing one.
constexpr double kWholeMax = 32'767.0;
constexpr std::int16_t kMissing = -32'768;
/// Distances up to FaceTable::kWide_mm, finer than any scanner measures.
constexpr double kDeviationStep_mm = 0.001;
static_assert(algo::FaceTable::kWide_mm < kWholeMax * kDeviationStep_mm);

struct ThinnedScan {
  std::vector<Vec3> p_block;
  std::size_t stride = 1;
  std::size_t left_out = 0;  ///< points taken that are outside the cube
};

/// Takes one point of each `stride` finite ones. The place within the group changes by steps of the golden ratio:
/// with a fixed place, the points of an organised scan would be in a few columns.
ThinnedScan thinned(std::span<const float> xyz, std::size_t finite, const Pose& T_block_scanner) {
  ThinnedScan thin;
  thin.stride = std::max<std::size_t>(1, (finite + kBlockCloudPointsMax - 1) / kBlockCloudPointsMax);
  thin.p_block.reserve(finite / thin.stride + 1);
  constexpr std::uint32_t kGoldenTurn = 0x9E37'79B9U;
  std::uint32_t turn = 0;
  std::size_t in_group = 0;
  for (std::size_t i = 0; i + 2 < xyz.size(); i += 3) {
    if (!std::isfinite(xyz[i])) continue;
    const std::size_t wanted = (std::uint64_t{turn} * thin.stride) >> 32U;
    const bool is_taken = in_group == wanted;
    if (++in_group == thin.stride) {
      in_group = 0;
      turn += kGoldenTurn;
    }
    if (!is_taken) continue;
    const Vec3 p = T_block_scanner * Vec3(xyz[i], xyz[i + 1], xyz[i + 2]);
    if (p.cwiseAbs().maxCoeff() > kCloudReach_mm)
      ++thin.left_out;
    else
      thin.p_block.push_back(p);
  }
  return thin;
}

/// RFC 4648, with padding.
std::string base64(std::span<const std::int16_t> numbers) {
  static_assert(std::endian::native == std::endian::little, "the numbers are written as they are in memory");
  constexpr std::string_view kLetters = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  const auto bytes = std::as_bytes(numbers);
  std::string text;
  text.reserve((bytes.size() + 2) / 3 * 4);
  for (std::size_t i = 0; i < bytes.size(); i += 3) {
    const std::size_t count = std::min<std::size_t>(3, bytes.size() - i);
    std::uint32_t three = 0;
    for (std::size_t k = 0; k < count; ++k) three |= std::to_integer<std::uint32_t>(bytes[i + k]) << (16U - 8U * k);
    for (std::size_t k = 0; k < 4; ++k) text += k > count ? '=' : kLetters[(three >> (18U - 6U * k)) & 0x3FU];
  }
  return text;
}

/// `points` as whole numbers of one step that all three axes share.
void write_points(report::Json& json, std::span<const Vec3> points) {
  Vec3 low = Vec3::Zero();
  Vec3 high = Vec3::Zero();
  if (!points.empty()) low = high = points.front();
  for (const Vec3& p : points) {
    low = low.cwiseMin(p);
    high = high.cwiseMax(p);
  }
  // Whole millimetres, and a step of whole tenths of a micrometre: short in the document.
  const Vec3 origin_mm = (0.5 * (low + high)).array().round();
  const double reach_mm = std::max((high - origin_mm).maxCoeff(), (origin_mm - low).maxCoeff());
  const double step_mm = std::ceil(std::max(reach_mm, 1.0) / kWholeMax * 1e4) / 1e4;
  std::vector<std::int16_t> numbers;
  numbers.reserve(3 * points.size());
  for (const Vec3& p : points)
    for (int axis = 0; axis < 3; ++axis)
      numbers.push_back(static_cast<std::int16_t>(std::round((p[axis] - origin_mm[axis]) / step_mm)));
  json.field("step_mm", step_mm).field("origin_mm", origin_mm).field("xyz", base64(numbers));
}

/// null without a recipe.
void write_deviations(report::Json& json, std::span<const Vec3> points, const Recipe* recipe) {
  json.field("deviation_step_mm", kDeviationStep_mm).key("deviation");
  if (recipe == nullptr) {
    json.null();
    return;
  }
  const NearestFace nearest(*recipe);
  std::vector<std::int16_t> numbers(points.size(), kMissing);
  for (std::size_t i = 0; i < points.size(); ++i) {
    Face face = Face::seat;
    double deviation_mm = 0.0;
    if (nearest.find(points[i], face, deviation_mm))
      numbers[i] = static_cast<std::int16_t>(std::round(deviation_mm / kDeviationStep_mm));
  }
  json.value(base64(numbers));
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

  const NearestFace nearest(recipe);
  CloudCount count;
  const Pose T_block_scanner = block->block.registration.T_scanner_block.inverse();
  VertexFile file(
      path, comments_of(record, fmt::format("of block {}, as registered", station)),
      "property float x\nproperty float y\nproperty float z\nproperty float deviation_mm\nproperty uchar face\n");
  scan.for_each([&](const Vec3& p_scanner) {
    const Vec3 p = T_block_scanner * p_scanner;
    Face face = Face::seat;
    double deviation = 0.0;
    if (!nearest.find(p, face, deviation)) {
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
  if (count.points == 0)
    return error(Code::config, "none of the slab's scans can be used: %s",
                 count.not_scanned.empty() ? "none has a point on a surface" : count.not_scanned.front().c_str());
  if (const Status closed = file.close(); !closed) return closed.error();
  return count;
}

Result<std::string> block_cloud_json(const SlabHeader& slab, const storage::SlabBlock& block, const Recipe* recipe,
                                     const CloudSettings& settings) {
  // As many points as were acquired: a file that has more is another scan.
  const std::size_t floats = 3 * std::min(block.attempt.shape.points, limits::kScanPointsMax);
  Pages memory(limits::array_bytes(floats, sizeof(float)));
  const std::span<float> xyz = memory.take<float>(floats);
  const std::string path = scan_at(block, settings.scans_dir);
  const Result<ScanShape> shape = hal::read_scan(path.c_str(), settings.forms.of(block.attempt), xyz);
  if (!shape) return shape.error();
  const std::span<const float> points = xyz.first(3 * shape.value().points);
  if (Status same = need_measured_points(block.attempt, points); !same) return same.error();

  const ThinnedScan thin = thinned(points, shape.value().finite, block.block.registration.T_scanner_block.inverse());
  report::Json json("slabd.block_cloud/1");
  json.field("key", slab.key).field("slab_id", slab.slab_id).field("station", block.attempt.station);
  json.field("attempt", block.attempt.number).field("points_read", shape.value().points);
  json.field("points", thin.p_block.size()).field("left_out", thin.left_out).field("stride", thin.stride);
  json.field("unit", "mm").field("frame", "block");
  write_points(json, thin.p_block);
  write_deviations(json, thin.p_block, recipe);
  const PlaneFit& seat = block.block.seat.plane;
  json.key("seat");
  if (seat.ok)
    json.begin_object().field("normal", seat.normal).field("offset_mm", seat.offset_mm).end_object();
  else
    json.null();
  return json.text();
}

}  // namespace slabd::cli
