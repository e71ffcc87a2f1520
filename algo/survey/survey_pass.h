// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <span>

#include "algo/block_model.h"
#include "algo/features/seat_points.h"
#include "algo/survey/segmentation.h"
#include "algo/survey/surface_raster.h"
#include "base/base.h"

/// The only pass over a registered scan; all measurements use its results. survey.h has its purpose.
namespace slabd::algo {

/// Lists of points whose coordinates are kept, each in the frame of its face.
enum class PointList : std::uint8_t {
  seat_crop,
  seat_off,
  jaw_inner,
  jaw_outer,
  casing_inner,
  casing_outer,
  seat_edge,  ///< of the whole seat: close to where the fit's threshold cuts
  top_edge,   ///< the same for the slab top
};
inline constexpr std::size_t kPointLists = 8;
/// Faces too large for a list: sums are enough for them.
enum class LargeFace : std::uint8_t { seat, top };
inline constexpr std::size_t kLargeFaces = 2;

/// Memory for the lists, in pieces: each block of the scan takes pieces as needed.
class PointPool {
 public:
  static constexpr std::size_t kPiece = 1024;
  static constexpr std::uint32_t kNone = ~0U;

  PointPool() = default;
  /// Three floats for each point; `next` and `count`: one for each piece.
  PointPool(std::span<float> memory, std::span<std::uint32_t> next, std::span<std::uint32_t> count)
      : memory_(memory), next_(next), count_(count), pieces_(std::min(next.size(), memory.size() / (3 * kPiece))) {}

  void clear() { taken_.store(0, std::memory_order_relaxed); }
  /// Takes a piece; kNone if the pool is empty.
  [[nodiscard]] std::uint32_t take() {
    const std::size_t piece = taken_.fetch_add(1, std::memory_order_relaxed);
    if (piece >= pieces_) return kNone;
    next_[piece] = kNone;
    count_[piece] = 0;
    return static_cast<std::uint32_t>(piece);
  }
  /// True if more pieces were requested than exist: the lists are incomplete.
  [[nodiscard]] bool overflown() const { return taken_.load(std::memory_order_relaxed) > pieces_; }

  [[nodiscard]] float* at(std::uint32_t piece) { return memory_.data() + 3 * kPiece * piece; }
  [[nodiscard]] std::uint32_t& next(std::uint32_t piece) { return next_[piece]; }
  [[nodiscard]] std::uint32_t& count(std::uint32_t piece) { return count_[piece]; }
  [[nodiscard]] SeatPoints points(std::uint32_t piece) const {
    const float* p = memory_.data() + 3 * kPiece * piece;
    const std::size_t n = count_[piece];
    return {{p, n}, {p + kPiece, n}, {p + 2 * kPiece, n}};
  }

 private:
  std::span<float> memory_;
  std::span<std::uint32_t> next_;
  std::span<std::uint32_t> count_;
  std::size_t pieces_ = 0;
  std::atomic<std::size_t> taken_{0};
};

/// Plane h = a0 + a1 * u + a2 * v in the frame of a face; exact as floats.
struct Tilt {
  float a0 = 0.0F;
  float a1 = 0.0F;
  float a2 = 0.0F;
};
/// Sums over points of u, v and r = h - (a0 + a1 u + a2 v).
struct TiltedSums {
  double count = 0.0;
  std::array<double, 9> sums{};  ///< u v r, uu uv ur, vv vr, rr
  TiltedSums& operator+=(const TiltedSums& other) {
    count += other.count;
    for (std::size_t i = 0; i < sums.size(); ++i) sums[i] += other.sums[i];
    return *this;
  }
};

/// Entry of the survey's table, one for each 1 mm cell of (x, y) in the block frame.
namespace survey_cell {
inline constexpr std::uint32_t kFaceBits = 0xfffU;  ///< bits of the faces near the cell
inline constexpr unsigned kRegionShift = 12;        ///< 1 + the region; 0: it must be found by the rules
inline constexpr std::uint32_t kRegionBits = 0xfU << kRegionShift;
/// Codes of the distance over which a strip three cells wide has one region near a single face: towards smaller x,
/// larger x, smaller y, larger y.
inline constexpr std::array<unsigned, 4> kReachShift = {16, 20, 24, 28};
inline constexpr std::array<std::uint8_t, 16> kReachCells = {0,  2,  3,  4,  6,  8,  11,  15,
                                                             20, 26, 34, 44, 58, 76, 100, 130};
}  // namespace survey_cell

/// a . (p - shift) + b: a coordinate of the block frame from a point of the scanner's.
struct Row {
  std::array<float, 3> a{};
  float b = 0.0F;
};
struct SurveyFrame {
  std::array<float, 3> shift{};  ///< scanner frame, close to the block's origin
  Row x, y;
  std::array<Row, kFaces> along{};   ///< v: on the face, across the rail
  std::array<Row, kFaces> height{};  ///< above the face
};

/// Mean distances to the model by place: sums in nm (integers, so that their order does not matter) and counts.
struct MapSums {
  std::span<std::int64_t> sum_nm;
  std::span<std::uint32_t> count;
};

/// Input of a pass.
struct SurveyTask {
  SurveyFrame frame;
  const std::uint32_t* table = nullptr;
  float gate_mm = 0.0F;              ///< points further from the model belong to no face
  float band_mm = 0.0F;              ///< the table's regions are valid up to this distance from the face
  RegionNumbers rules;               ///< for points whose region is not in the table
  std::array<float, 12> share_mm{};  ///< distances to count points within, ascending
  std::array<Tilt, kLargeFaces> tilt{};
  std::array<float, kLargeFaces> inner_mm{};  ///< |r| <= inner: summed
  std::array<float, kLargeFaces> outer_mm{};  ///< up to outer: listed
  std::array<FaceRaster, 2> jaw{};            ///< places of the inner and the outer jaw
};

/// Results of a pass over one block of the scan.
struct SurveySums {
  double near = 0.0;  ///< points within the gate of the model; next two: their distances and squared distances
  double sum_mm = 0.0;
  double sum_mm2 = 0.0;
  std::array<double, 12> within{};  ///< of these, the points within share_mm
  std::array<TiltedSums, kLargeFaces> moments{};
  std::array<double, kLargeFaces> points{};  ///< points of the face: summed, listed or neither
  std::array<PlaceCounts, 2> jaw_off{};  ///< points at the inner and the outer jaw's place, off by more than the gate
  std::array<std::uint32_t, kPointLists> first{};
  std::array<std::uint32_t, kPointLists> last{};
};

static_assert(sizeof(SurveySums) <= 640 && sizeof(SeatPoints) == 48, "limits::kWorkspaceBytes counts with these");

/// Surveys every `stride`-th sixteen of `count` points (scanner frame; NaN: missing). Adds one point of each sixteen,
/// in changing lanes, to `map` if it has memory, and some to `surface` if it has.
void survey_points(const float* xyz, std::size_t count, std::size_t stride, const SurveyTask& task, PointPool& pool,
                   const MapSums& map, const SurfaceSums& surface, SurveySums& sums);

}  // namespace slabd::algo
