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

/// The one pass over a registered scan that everything measured on it is taken from; survey.h says what for.
namespace slabd::algo {

/// Points whose coordinates are kept, each list in the frame of its face.
enum class PointList : std::uint8_t {
  seat_crop,
  seat_off,
  jaw_inner,
  jaw_outer,
  casing_inner,
  casing_outer,
  seat_edge,  ///< of the whole seat: close to where the fit's threshold cuts
  top_edge,   ///< of the slab top: likewise
};
inline constexpr std::size_t kPointLists = 8;
/// Faces too large for a list: sums are enough for them.
enum class LargeFace : std::uint8_t { seat, top };
inline constexpr std::size_t kLargeFaces = 2;

/// Memory for the lists, in pieces: each block of the scan takes pieces as it needs them.
class PointPool {
 public:
  static constexpr std::size_t kPiece = 1024;
  static constexpr std::uint32_t kNone = ~0U;

  PointPool() = default;
  /// Three floats for each point; `next` and `count`: one for each piece.
  PointPool(std::span<float> memory, std::span<std::uint32_t> next, std::span<std::uint32_t> count)
      : memory_(memory), next_(next), count_(count), pieces_(std::min(next.size(), memory.size() / (3 * kPiece))) {}

  void clear() { taken_.store(0, std::memory_order_relaxed); }
  /// kNone when there is no more.
  [[nodiscard]] std::uint32_t take() {
    const std::size_t piece = taken_.fetch_add(1, std::memory_order_relaxed);
    if (piece >= pieces_) return kNone;
    next_[piece] = kNone;
    count_[piece] = 0;
    return static_cast<std::uint32_t>(piece);
  }
  /// More was asked for than there is: what the lists hold is incomplete.
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
inline constexpr std::uint32_t kFaceBits = 0xfffU;  ///< faces near, bit by bit
inline constexpr unsigned kRegionShift = 12;        ///< 1 + the region; 0: it has to be found by the rules
inline constexpr std::uint32_t kRegionBits = 0xfU << kRegionShift;
/// Codes of how far everything is alike, and near a single face, over a strip three cells wide: towards smaller x,
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

/// Mean distances to the model by place: sums in nm (whole numbers, so that their order does not matter) and counts.
struct MapSums {
  std::span<std::int64_t> sum_nm;
  std::span<std::uint32_t> count;
};

/// What a pass looks for.
struct SurveyTask {
  SurveyFrame frame;
  const std::uint32_t* table = nullptr;
  float gate_mm = 0.0F;              ///< points further from the model belong to no face
  float band_mm = 0.0F;              ///< the table's regions hold so far from the face
  RegionNumbers rules;               ///< for points of which the table does not know the region
  std::array<float, 12> share_mm{};  ///< distances to count points within, ascending
  std::array<Tilt, kLargeFaces> tilt{};
  std::array<float, kLargeFaces> inner_mm{};  ///< |r| <= inner: summed up,
  std::array<float, kLargeFaces> outer_mm{};  ///< up to outer: listed
  std::array<FaceRaster, 2> jaw{};            ///< places of the inner and the outer jaw
};

/// What a pass over one block of the scan found.
struct SurveySums {
  double near = 0.0;  ///< points within the gate of the model, their distances and squares
  double sum_mm = 0.0;
  double sum_mm2 = 0.0;
  std::array<double, 12> within{};  ///< of them, those within share_mm
  std::array<TiltedSums, kLargeFaces> moments{};
  std::array<double, kLargeFaces> points{};  ///< of the face, whether summed up, listed or neither
  std::array<PlaceCounts, 2> jaw_off{};  ///< points in place of the inner and the outer jaw, further off than the gate
  std::array<std::uint32_t, kPointLists> first{};
  std::array<std::uint32_t, kPointLists> last{};
};

static_assert(sizeof(SurveySums) <= 640 && sizeof(SeatPoints) == 48, "limits::kWorkspaceBytes counts with these");

/// Surveys every `stride`-th sixteen of `count` points (scanner frame; NaN: missing). One point of each sixteen,
/// another lane each time, goes into `map`, if it has memory, and some into `surface`, likewise.
void survey_points(const float* xyz, std::size_t count, std::size_t stride, const SurveyTask& task, PointPool& pool,
                   const MapSums& map, const SurfaceSums& surface, SurveySums& sums);

}  // namespace slabd::algo
