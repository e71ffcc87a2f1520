// SPDX-License-Identifier: Apache-2.0
//
// Problem: which points are noise? Having neighbours is not the criterion: a reflection a millimetre off the seat has
// hundreds, and a good point of a coarse scan on a steep face has two. Noise is a point without a surface through it. A
// surface is a sheet: around each of its points, a large share of all points is in one plane with it, whatever the
// plane's slope.
//
// Idea: lengths are measured in the scan's own pitch. Points are sorted into cells three pitches wide. Most cells are
// level (most of their points are at one height) and so are the cells around them. There a point is noise if it is off
// that height, without further tests. Elsewhere, at edges and on steep faces, each point is tested separately. A slope
// found in its cell or an adjacent one must give a plane through the point that holds enough of the points around it.
// Near points have more weight. Of a full plane's weight an edge has 0.6, a corner 0.36, and a point next to or above a
// face at most about 0.4. A point in the middle of another surface must have more than half.
//
// A strip of two lines has less. Noise by that rule that is connected over a length is kept all the same
// (algo/denoise/denoise.h).
//
// Merged views from one position have one point each on the same rays. Then the pitch is that of the rays. By the
// density of points, a line of the scan would have gaps, and a cell would contain a single ray.
//
// Invariants: the decision on a point depends on the points around it, not on their order (sums of integers, sorted
// samples); the work per point is bounded. Both also hold where views overlap or the scanner paused: of a cell with too
// many points, only those with the lowest hash of their coordinates are used, a sample that is the same in any order.
#include "algo/denoise/denoise.h"

#include <algorithm>
#include <array>
#include <atomic>
#include <bit>
#include <cassert>
#include <cmath>
#include <cstring>
#include <limits>

#include "algo/denoise/point_grid.h"
#include "base/prng.h"

namespace slabd::algo {
namespace {

constexpr float kNone = std::numeric_limits<float>::quiet_NaN();

/// Cell size in pitches: nine points on a surface, enough for a majority.
constexpr float kCellPitches = 3.0F;
/// A cell is level if at least this share of its points, and four, are near their median height. Near is within a pitch
/// and a little noise, so that no steep face counts as level, and at most half a millimetre. Adjacent cells are level
/// at the same height if they differ by at most half a millimetre.
constexpr float kLevelNoise_mm = 0.1F;
constexpr float kLevel_mm = 0.5F;
constexpr float kLevelShare = 0.6F;
constexpr std::size_t kCellPointsMin = 4;
/// If the cells around are level at the same height, points this far from it belong to the surface. Noise with heavy
/// tails does, an outlier of a millimetre does not, with 0.2 mm left for the tilt across a cell.
constexpr float kCalm_mm = 0.6F;
/// Level cells among the eight around: from five on, the cell is part of a level surface; with eight, no other surface
/// is near.
constexpr int kCalmCells = 5;
/// Points of a cell that are used, for its surface and as neighbours: five times the usual number.
constexpr std::size_t kCellSample = 48;
/// Slopes tried in a cell that is not level, and the steepest one accepted: 85 degrees.
constexpr int kSlopeDraws = 24;
constexpr float kSlopeMax = 11.5F;
/// Number of cells around that must share a slope for it to count.
constexpr int kAgreeingCells = 2;
/// Number of cells for estimating the scan's tilt, and for the number of points per ray.
constexpr std::size_t kTiltCells = 1U << 14U;
constexpr std::size_t kRayCells = 1U << 14U;
/// A point is on a plane if its height is within noise plus a third of the plane's rise over a pitch. Across a steep
/// plane that is a third of a row, so that a steep plane never holds two rows of a level surface.
constexpr float kPlaneNoise_mm = 0.45F;
constexpr float kPlanePitches = 0.35F;
/// Neighbours within 3.5 pitches count, with weight (1 - d^2 / R^2)^2: 12.6 in all around a point of a full surface.
constexpr float kReachPitches = 3.5F;
/// This reach to both sides touches at most four cells along each axis.
constexpr std::size_t kNeighboursMax = 4 * 4 * kCellSample;
static_assert(2.0F * kReachPitches < 3.0F * kCellPitches);
/// Minimum share of that weight in a plane with the point; the share that suffices without another condition; and the
/// minimum weight, more than that of four nearest neighbours: a clump of five is noise.
constexpr int kWeightOne = 1024;
constexpr float kShareMin = 0.42F;
constexpr float kShareSure = 0.55F;
constexpr int kWeightMin = 3 * kWeightOne + kWeightOne / 2;
/// Below the sure share the point must be beside the remaining points, as on an edge, not among them: their centre of
/// gravity must be this far away, in units of the reach.
constexpr float kBeside = 0.27F;

bool finite(const float* p) {
  return std::isfinite(p[0]) && std::isfinite(p[1]) && std::isfinite(p[2]);
}

/// Marks points that lack one coordinate as missing.
std::size_t mark_missing(Cloud& cloud) {
  float* xyz = cloud.xyz.data();
  std::size_t there = 0;
  for (std::size_t i = 0; i < cloud.points; ++i) {
    if (finite(xyz + 3 * i))
      ++there;
    else
      std::fill_n(xyz + 3 * i, 3, kNone);
  }
  return there;
}

struct Slope {
  float x = 0.0F;
  float y = 0.0F;
  [[nodiscard]] float steepness() const { return std::sqrt(x * x + y * y); }
};

float plane_gate(const Slope& slope, float pitch_mm) {
  return kPlaneNoise_mm + kPlanePitches * pitch_mm * slope.steepness();
}

/// Sampling order of the points in a cell: pseudo-random and determined only by their coordinates. Points with the same
/// coordinates are interchangeable.
class Draw {
 public:
  explicit Draw(const float* xyz) : xyz_(xyz) {}

  bool operator()(std::uint32_t a, std::uint32_t b) const {
    const Bits of_a = bits(a);
    const Bits of_b = bits(b);
    const std::uint64_t lot_a = lot(of_a);
    const std::uint64_t lot_b = lot(of_b);
    return lot_a != lot_b ? lot_a < lot_b : of_a < of_b;
  }

 private:
  using Bits = std::array<std::uint32_t, 3>;
  [[nodiscard]] Bits bits(std::uint32_t i) const {
    Bits of_point;
    std::memcpy(of_point.data(), xyz_ + 3 * std::size_t{i}, sizeof of_point);
    return of_point;
  }
  [[nodiscard]] static std::uint64_t lot(const Bits& p) {
    return Prng((std::uint64_t{p[0]} << 32U | p[1]) ^ Prng(p[2]).next()).next();
  }

  const float* xyz_;
};

/// Cost of denoising so far, in point visits. The limit is on counted work and not on time, so that the same scan has
/// the same result on every computer.
class WorkCount {
 public:
  explicit WorkCount(const std::atomic<bool>* give_up) : give_up_(give_up) {}

  void looked(std::size_t points) { looks_ += points; }
  /// Counts visits of points at random addresses, one by one.
  void followed(std::size_t points) { looks_ += 2 * points; }
  /// Counts drawn points: each is hashed for every comparison.
  void drew(std::size_t points) { looks_ += kLooksPerDraw * points; }
  void sorted(std::size_t points) { drew(points * static_cast<std::size_t>(std::bit_width(points))); }
  [[nodiscard]] bool used_up() const {
    return looks_ > limits::kDenoiseLooksMax || (give_up_ != nullptr && give_up_->load(std::memory_order_relaxed));
  }

 private:
  static constexpr std::size_t kLooksPerDraw = 8;
  const std::atomic<bool>* give_up_;
  std::uint64_t looks_ = 0;
};

/// Moves the sampled points of every cell to its front.
void draw_samples(const float* xyz, PointGrid& grid, WorkCount& work) {
  for (std::size_t c = 0; c < grid.cells(); ++c) {
    const std::span<std::uint32_t> points = grid.in_cell(c);
    if (points.size() <= kCellSample) continue;
    work.drew(points.size());
    if (work.used_up()) return;
    std::nth_element(points.begin(), points.begin() + kCellSample, points.end(), Draw(xyz));
  }
}

/// The sampled points of a cell.
std::span<const std::uint32_t> sample_of(const PointGrid& grid, std::size_t cell) {
  const std::span<const std::uint32_t> points = grid.in_cell(cell);
  return points.first(std::min(points.size(), kCellSample));
}

/// Median number of points per ray. Points at about the same XY are on one ray; for points at random positions the
/// result is 1.
std::size_t points_of_a_ray(const float* xyz, const PointGrid& grid) {
  constexpr float kSamePitches = 1.0F / 3.0F;
  const float same_mm = kSamePitches * grid.pitch_mm();
  std::array<std::uint32_t, kCellSample + 1> seen{};
  std::uint64_t all = 0;
  const std::size_t step = 1 + grid.cells() / kRayCells;
  for (std::size_t c = 0; c < grid.cells(); c += step) {
    const std::span<const std::uint32_t> points = sample_of(grid, c);
    for (const std::uint32_t i : points) {
      const float* p = xyz + 3 * std::size_t{i};
      const auto on_ray = std::count_if(points.begin(), points.end(), [&](std::uint32_t k) {
        const float* q = xyz + 3 * std::size_t{k};
        const float dx = q[0] - p[0];
        const float dy = q[1] - p[1];
        return dx * dx + dy * dy <= same_mm * same_mm;
      });
      ++seen[static_cast<std::size_t>(on_ray)];
      ++all;
    }
  }
  std::size_t median = 1;
  for (std::uint64_t up_to = seen[0] + seen[1]; 2 * up_to < all; up_to += seen[median]) ++median;
  return median;
}

/// Finds the surface in one cell from its points. Heights are relative to a plane with the scan's own tilt.
class CellJudge {
 public:
  CellJudge(const float* xyz, const PointGrid& grid) : xyz_(xyz), grid_(grid) {}

  void set_tilt(const Slope& tilt) { tilt_ = tilt; }
  [[nodiscard]] float height(std::uint32_t i) const {
    const float* p = xyz_ + 3 * std::size_t{i};
    return p[2] - tilt_.x * p[0] - tilt_.y * p[1];
  }

  [[nodiscard]] TilePlane surface(std::size_t cell) {
    const std::span<const std::uint32_t> points = sample_of(grid_, cell);
    if (points.size() < kCellPointsMin) return {kNone, kNone, kNone};
    count_ = points.size();
    for (std::size_t i = 0; i < count_; ++i) {
      const std::uint32_t k = points[i];
      sample_[i] = {xyz_[3 * std::size_t{k}], xyz_[3 * std::size_t{k} + 1], height(k)};
    }
    const float level = median_height();
    const float gate = std::min(kLevel_mm, kLevelNoise_mm + grid_.pitch_mm());
    std::size_t near = 0;
    for (std::size_t i = 0; i < count_; ++i) near += std::abs(sample_[i].z - level) <= gate ? 1U : 0U;
    return majority(near) ? TilePlane{level, tilt_.x, tilt_.y} : sloped();
  }

 private:
  struct Point {
    float x, y, z;
    [[nodiscard]] bool operator<(const Point& o) const { return z != o.z ? z < o.z : (x != o.x ? x < o.x : y < o.y); }
  };

  [[nodiscard]] bool majority(std::size_t points) const {
    return points >= kCellPointsMin && static_cast<float>(points) >= kLevelShare * static_cast<float>(count_);
  }
  [[nodiscard]] float median_height() {
    const auto middle = sample_.begin() + static_cast<std::ptrdiff_t>(count_ / 2);
    std::nth_element(sample_.begin(), middle, sample_.begin() + static_cast<std::ptrdiff_t>(count_));
    return middle->z;
  }
  /// The plane through three points that holds most of the others, refitted to those.
  [[nodiscard]] TilePlane sloped() {
    std::sort(sample_.begin(), sample_.begin() + static_cast<std::ptrdiff_t>(count_));
    Prng prng(count_);
    Slope best;
    Point foot{};
    std::size_t most = 0;
    for (int draw = 0; draw < kSlopeDraws; ++draw) {
      const Point& a = sample_[prng.below(count_)];
      const Point& b = sample_[prng.below(count_)];
      const Point& c = sample_[prng.below(count_)];
      Slope slope;
      if (!through(a, b, c, slope)) continue;
      const std::size_t held = held_by(slope, a);
      if (held <= most) continue;
      most = held;
      best = slope;
      foot = a;
    }
    if (!majority(most)) return {kNone, kNone, kNone};
    best = refitted(best, foot);
    return {kNone, best.x + tilt_.x, best.y + tilt_.y};
  }
  [[nodiscard]] bool through(const Point& a, const Point& b, const Point& c, Slope& slope) const {
    const float bx = b.x - a.x, by = b.y - a.y, bz = b.z - a.z;
    const float cx = c.x - a.x, cy = c.y - a.y, cz = c.z - a.z;
    const float area = bx * cy - by * cx;
    // Three points of one row do not determine the slope across it.
    if (std::abs(area) < 0.5F * grid_.pitch_mm() * grid_.pitch_mm()) return false;
    slope = {(bz * cy - by * cz) / area, (bx * cz - bz * cx) / area};
    return slope.steepness() <= kSlopeMax;
  }
  [[nodiscard]] static float off(const Slope& slope, const Point& foot, const Point& p) {
    return p.z - foot.z - slope.x * (p.x - foot.x) - slope.y * (p.y - foot.y);
  }
  [[nodiscard]] std::size_t held_by(const Slope& slope, const Point& foot) const {
    const float gate = plane_gate(slope, grid_.pitch_mm());
    std::size_t held = 0;
    for (std::size_t i = 0; i < count_; ++i) held += std::abs(off(slope, foot, sample_[i])) <= gate ? 1U : 0U;
    return held;
  }
  /// Least squares over the points on the plane: three points alone extrapolate badly.
  [[nodiscard]] Slope refitted(const Slope& slope, const Point& foot) const {
    const float gate = plane_gate(slope, grid_.pitch_mm());
    double n = 0.0, x = 0.0, y = 0.0, z = 0.0, xx = 0.0, xy = 0.0, yy = 0.0, xz = 0.0, yz = 0.0;
    for (std::size_t i = 0; i < count_; ++i) {
      const Point& p = sample_[i];
      if (std::abs(off(slope, foot, p)) > gate) continue;
      const double dx = static_cast<double>(p.x - foot.x);
      const double dy = static_cast<double>(p.y - foot.y);
      const double dz = static_cast<double>(p.z - foot.z);
      n += 1.0;
      x += dx, y += dy, z += dz;
      xx += dx * dx, xy += dx * dy, yy += dy * dy, xz += dx * dz, yz += dy * dz;
    }
    xx -= x * x / n, xy -= x * y / n, yy -= y * y / n, xz -= x * z / n, yz -= y * z / n;
    const double det = xx * yy - xy * xy;
    if (!(det > 0.0)) return slope;
    return {static_cast<float>((xz * yy - yz * xy) / det), static_cast<float>((yz * xx - xz * xy) / det)};
  }

  const float* xyz_;
  const PointGrid& grid_;
  Slope tilt_;
  std::array<Point, kCellSample> sample_{};
  std::size_t count_ = 0;
};

/// The tilt of the scan: the median rise between adjacent level cells. A resolution of a thousandth is enough.
Slope typical_tilt(const PointGrid& grid, CellJudge& judge) {
  constexpr int kBins = 2001;
  constexpr float kPerBin = 1e-3F;
  std::array<std::uint32_t, kBins> along_x{};
  std::array<std::uint32_t, kBins> along_y{};
  const auto count = [&](std::array<std::uint32_t, kBins>& bins, float rise) {
    const float bin = std::round(rise / (kPerBin * grid.cell_mm())) + static_cast<float>(kBins / 2);
    if (bin >= 0.0F && bin < static_cast<float>(kBins)) ++bins[static_cast<std::size_t>(bin)];
  };
  const int step = 1 + static_cast<int>(grid.cells() / kTiltCells);
  for (int row = 0; row + 1 < grid.rows(); ++row) {
    for (int column = row % step; column + 1 < grid.columns(); column += step) {
      const float here = judge.surface(grid.cell(column, row)).z;
      if (std::isnan(here)) continue;
      const float right = judge.surface(grid.cell(column + 1, row)).z;
      const float above = judge.surface(grid.cell(column, row + 1)).z;
      if (!std::isnan(right)) count(along_x, right - here);
      if (!std::isnan(above)) count(along_y, above - here);
    }
  }
  const auto median = [](const std::array<std::uint32_t, kBins>& bins) {
    std::uint64_t all = 0;
    for (const std::uint32_t b : bins) all += b;
    std::uint64_t seen = 0;
    int bin = 0;
    while (bin + 1 < kBins && 2 * (seen + bins[static_cast<std::size_t>(bin)]) <= all)
      seen += bins[static_cast<std::size_t>(bin++)];
    return all == 0 ? 0.0F : kPerBin * static_cast<float>(bin - kBins / 2);
  };
  return {median(along_x), median(along_y)};
}

/// Candidate slopes for the points of a cell: those of its cell and the eight around it that a neighbour shares. A cell
/// half full of noise has a slope too, but no neighbour shares it.
class SlopeChoice {
 public:
  SlopeChoice(const PointGrid& grid, std::span<const TilePlane> surface) : grid_(grid), surface_(surface) {}

  [[nodiscard]] std::span<const Slope> around(int column, int row) {
    count_ = 0;
    add(column, row);
    for (int dr = -1; dr <= 1; ++dr)
      for (int dc = -1; dc <= 1; ++dc)
        if (dr != 0 || dc != 0) add(column + dc, row + dr);
    return {slopes_.data(), count_};
  }

 private:
  [[nodiscard]] bool alike(const Slope& a, const Slope& b) const {
    const Slope d{a.x - b.x, a.y - b.y};
    return d.steepness() * kReachPitches * grid_.pitch_mm() <= plane_gate(a, grid_.pitch_mm());
  }
  [[nodiscard]] bool slope_at(int column, int row, Slope& slope) const {
    if (column < 0 || row < 0 || column >= grid_.columns() || row >= grid_.rows()) return false;
    const TilePlane& s = surface_[grid_.cell(column, row)];
    slope = {s.per_column, s.per_row};
    return !std::isnan(s.per_column);
  }
  void add(int column, int row) {
    Slope slope;
    if (!slope_at(column, row, slope)) return;
    for (std::size_t i = 0; i < count_; ++i)
      if (alike(slopes_[i], slope)) return;
    int agreeing = 0;
    Slope other;
    for (int dr = -1; dr <= 1; ++dr)
      for (int dc = -1; dc <= 1; ++dc)
        if ((dr != 0 || dc != 0) && slope_at(column + dc, row + dr, other) && alike(slope, other)) ++agreeing;
    if (agreeing >= kAgreeingCells) slopes_[count_++] = slope;
  }

  const PointGrid& grid_;
  std::span<const TilePlane> surface_;
  std::array<Slope, 9> slopes_{};
  std::size_t count_ = 0;
};

/// Calls f(k, dx, dy, d2) for the sampled points within reach of `p` in XY; at most kNeighboursMax, and `p` may be one
/// of them. Returns the number of visited points.
template <typename F>
[[gnu::always_inline]] inline std::size_t for_each_around(const float* xyz, const PointGrid& grid, const float* p,
                                                          float reach_mm, F&& f) {
  const float reach2 = reach_mm * reach_mm;
  const int c0 = grid.column(p[0] - reach_mm), c1 = grid.column(p[0] + reach_mm);
  const int r0 = grid.row(p[1] - reach_mm), r1 = grid.row(p[1] + reach_mm);
  std::size_t looked = 0;
  for (int r = r0; r <= r1; ++r) {
    for (int c = c0; c <= c1; ++c) {
      const std::span<const std::uint32_t> sample = sample_of(grid, grid.cell(c, r));
      looked += sample.size();
      for (const std::uint32_t k : sample) {
        const float* q = xyz + 3 * std::size_t{k};
        const float dx = q[0] - p[0];
        const float dy = q[1] - p[1];
        const float d2 = dx * dx + dy * dy;
        if (d2 < reach2) f(k, dx, dy, d2);
      }
    }
  }
  return looked;
}

/// Tests for single points whether a surface goes through them. The points around a cell are copied into contiguous
/// arrays once for all points of the cell, so that the search for neighbours is a loop over plain arrays.
class PointJudge {
 public:
  PointJudge(const float* xyz, const PointGrid& grid, std::size_t points_of_ray, WorkCount& work)
      : xyz_(xyz),
        grid_(grid),
        work_(work),
        reach_mm_(kReachPitches * grid.pitch_mm()),
        weight_min_(kWeightMin * static_cast<int>(points_of_ray)) {}

  /// Selects the cell of the next tested points.
  void enter(int column, int row) {
    column0_ = std::max(column - kReachCells, 0);
    row0_ = std::max(row - kReachCells, 0);
    column1_ = std::min(column + kReachCells, grid_.columns() - 1);
    row1_ = std::min(row + kReachCells, grid_.rows() - 1);
    is_copied_ = false;
  }
  [[nodiscard]] bool on_surface(std::uint32_t self, std::span<const Slope> slopes) {
    if (slopes.empty()) return false;
    if (!is_copied_) copy();
    gather(self);
    if (total_ < weight_min_) return false;
    for (const Slope& slope : slopes)
      if (plane_holds(slope)) return true;
    return false;
  }

 private:
  /// A reach of 3.5 pitches to each side touches two more cells of 3 pitches.
  static constexpr int kReachCells = 2;
  static constexpr int kSide = 2 * kReachCells + 1;
  static constexpr std::size_t kCopiesMax = std::size_t{kSide * kSide} * kCellSample;

  void copy() {
    is_copied_ = true;
    std::size_t count = 0;
    for (int r = row0_; r <= row1_; ++r)
      for (int c = column0_; c <= column1_; ++c) {
        start_[start_of(c, r)] = static_cast<std::uint32_t>(count);
        for (const std::uint32_t k : sample_of(grid_, grid_.cell(c, r))) {
          const float* q = xyz_ + 3 * std::size_t{k};
          point_[count] = k;
          x_[count] = q[0];
          y_[count] = q[1];
          z_[count++] = q[2];
        }
        start_[start_of(c, r) + 1] = static_cast<std::uint32_t>(count);
      }
    work_.looked(count);
  }
  [[nodiscard]] std::size_t start_of(int column, int row) const {
    return static_cast<std::size_t>((row - row0_) * (kSide + 1) + (column - column0_));
  }

  /// Collects the points of the cells around, with weights; points out of reach have weight 0.
  void gather(std::uint32_t self) {
    count_ = 0;
    total_ = 0;
    const float* p = xyz_ + 3 * std::size_t{self};
    const float px = p[0], py = p[1], pz = p[2];
    const float reach2 = reach_mm_ * reach_mm_;
    const int c0 = std::max(grid_.column(px - reach_mm_), column0_);
    const int c1 = std::min(grid_.column(px + reach_mm_), column1_);
    const int r0 = std::max(grid_.row(py - reach_mm_), row0_);
    const int r1 = std::min(grid_.row(py + reach_mm_), row1_);
    for (int r = r0; r <= r1; ++r) {
      const std::size_t first = start_[start_of(c0, r)];
      const std::size_t count = start_[start_of(c1, r) + 1] - first;
      const float* x = x_.data() + first;
      const float* y = y_.data() + first;
      const float* z = z_.data() + first;
      const std::uint32_t* k = point_.data() + first;
      float* dx = dx_.data() + count_;
      float* dy = dy_.data() + count_;
      float* dz = dz_.data() + count_;
      int* weight = weight_.data() + count_;
      int total = 0;
      for (std::size_t i = 0; i < count; ++i) {
        dx[i] = x[i] - px;
        dy[i] = y[i] - py;
        dz[i] = z[i] - pz;
        const float d2 = dx[i] * dx[i] + dy[i] * dy[i];
        const float u = 1.0F - d2 / reach2;
        const int within = static_cast<int>(u * u * static_cast<float>(kWeightOne));
        weight[i] = d2 < reach2 && k[i] != self ? within : 0;
        total += weight[i];
      }
      total_ += total;
      count_ += count;
    }
    work_.looked(count_);
  }

  [[nodiscard]] float off(std::size_t i, const Slope& slope) const {
    return dz_[i] - slope.x * dx_[i] - slope.y * dy_[i];
  }
  [[nodiscard]] bool plane_holds(const Slope& slope) const {
    const float gate = plane_gate(slope, grid_.pitch_mm());
    int held = 0;
    for (std::size_t i = 0; i < count_; ++i) held += std::abs(off(i, slope)) <= gate ? weight_[i] : 0;
    work_.looked(count_);
    if (held < weight_min_ || static_cast<float>(held) < kShareMin * static_cast<float>(total_)) return false;
    if (static_cast<float>(held) >= kShareSure * static_cast<float>(total_)) return true;
    return beside_the_rest(slope, gate, total_ - held);
  }

  [[nodiscard]] bool beside_the_rest(const Slope& slope, float gate, int rest) const {
    constexpr float kUnits = 1024.0F;  // per reach; integer sums do not depend on the order
    std::int64_t x = 0;
    std::int64_t y = 0;
    for (std::size_t i = 0; i < count_; ++i) {
      if (weight_[i] == 0 || std::abs(off(i, slope)) <= gate) continue;
      x += std::int64_t{weight_[i]} * static_cast<int>(kUnits * dx_[i] / reach_mm_);
      y += std::int64_t{weight_[i]} * static_cast<int>(kUnits * dy_[i] / reach_mm_);
    }
    const double away = std::hypot(static_cast<double>(x), static_cast<double>(y));
    return away >= static_cast<double>(kBeside * kUnits) * static_cast<double>(rest);
  }

  const float* xyz_;
  const PointGrid& grid_;
  WorkCount& work_;
  float reach_mm_;
  int weight_min_;
  int column0_ = 0, row0_ = 0, column1_ = 0, row1_ = 0;
  bool is_copied_ = false;
  std::array<std::uint32_t, kSide*(kSide + 1)> start_{};
  std::array<std::uint32_t, kCopiesMax> point_{};
  std::array<float, kCopiesMax> x_{}, y_{}, z_{};
  std::array<float, kCopiesMax> dx_{}, dy_{}, dz_{};
  std::array<int, kCopiesMax> weight_{};
  std::size_t count_ = 0;
  int total_ = 0;
};

/// Number of cells around a level cell that are level at about the same height.
int calm_cells_around(const PointGrid& grid, std::span<const TilePlane> surface, int column, int row) {
  const float level = surface[grid.cell(column, row)].z;
  int calm = 0;
  for (int r = std::max(row - 1, 0); r <= std::min(row + 1, grid.rows() - 1); ++r)
    for (int c = std::max(column - 1, 0); c <= std::min(column + 1, grid.columns() - 1); ++c)
      calm += std::abs(surface[grid.cell(c, r)].z - level) <= kLevel_mm ? 1 : 0;
  return calm - 1;
}

/// State of a point.
enum Keep : std::uint8_t {
  kNoise,     ///< no surface goes through it
  kSurface,   ///< a surface goes through it
  kLongOne,   ///< in a long connected group, by the current rule
  kShortOne,  ///< in a short group
  kAsked,     ///< queued
};

/// Sorts the noise of every cell into a defined order, with the sampled points still in front.
void sort_noise(const float* xyz, PointGrid& grid, std::span<const std::uint8_t> keep, WorkCount& work) {
  const auto is_noise = [&](std::uint32_t i) { return keep[i] == kNoise; };
  for (std::size_t c = 0; c < grid.cells(); ++c) {
    const std::span<std::uint32_t> points = grid.in_cell(c);
    const std::size_t sample = std::min(points.size(), kCellSample);
    for (const std::span<std::uint32_t> part : {points.first(sample), points.subspan(sample)}) {
      const auto end = std::partition(part.begin(), part.end(), is_noise);
      if (end - part.begin() <= 1) continue;
      work.sorted(static_cast<std::size_t>(end - part.begin()));
      if (work.used_up()) return;
      std::sort(part.begin(), end, Draw(xyz));
    }
  }
}

/// Keeps connected noise; points within two pitches in XY are connected. A group is followed until it is long or
/// reaches a long one, so each point is followed about once.
class NoiseGroups {
 public:
  NoiseGroups(const float* xyz, const PointGrid& grid, std::span<std::uint8_t> keep, const noise_group::Rule& rule,
              WorkCount& work)
      : xyz_(xyz), grid_(grid), keep_(keep), rule_(rule), work_(work), reach_mm_(kLinkPitches * grid.pitch_mm()) {}

  void follow(std::uint32_t start) {
    const float longest_mm = static_cast<float>(rule_.length - 1) * grid_.pitch_mm();
    size_ = 0;
    const float* first = xyz_ + 3 * std::size_t{start};
    float x0 = first[0], x1 = first[0], y0 = first[1], y1 = first[1];
    bool is_long = false;
    add(start);
    for (std::size_t i = 0; i < size_ && !is_long; ++i) {
      const float* p = xyz_ + 3 * std::size_t{group_[i]};
      work_.followed(for_each_around(xyz_, grid_, p, reach_mm_, [&](std::uint32_t k, float, float, float) {
        const float* q = xyz_ + 3 * std::size_t{k};
        if (std::abs(q[2] - p[2]) > rule_.step_mm) return;
        if (keep_[k] == kLongOne) is_long = true;
        if (keep_[k] != kNoise || size_ == group_.size()) return;
        x0 = std::min(x0, q[0]), x1 = std::max(x1, q[0]);
        y0 = std::min(y0, q[1]), y1 = std::max(y1, q[1]);
        is_long = is_long || std::max(x1 - x0, y1 - y0) >= longest_mm;
        add(k);
      }));
    }
    for (std::size_t i = 0; i < size_; ++i) keep_[group_[i]] = is_long ? kLongOne : kShortOne;
  }

 private:
  static constexpr float kLinkPitches = 2.0F;
  /// A group that is too short has one point per square pitch, 961 in all. If there are more, views overlap, and the
  /// remainder is followed separately. So the starting point matters; sort_noise() makes it reproducible.
  static constexpr std::size_t kGroupMax = 1024;

  void add(std::uint32_t k) {
    keep_[k] = kAsked;
    group_[size_++] = k;
  }
  const float* xyz_;
  const PointGrid& grid_;
  std::span<std::uint8_t> keep_;
  const noise_group::Rule rule_;
  WorkCount& work_;
  float reach_mm_;
  std::array<std::uint32_t, kGroupMax> group_{};
  std::size_t size_ = 0;
};

/// Applies the rules one after the other; long groups then count as surface.
void keep_noise_groups(const float* xyz, PointGrid& grid, std::span<std::uint8_t> keep, WorkCount& work) {
  for (const noise_group::Rule& rule : noise_group::kRules) {
    NoiseGroups groups(xyz, grid, keep, rule, work);
    for (std::size_t c = 0; c < grid.cells(); ++c)
      for (const std::uint32_t i : grid.in_cell(c)) {
        if (keep[i] != kNoise) continue;
        if (work.used_up()) return;
        groups.follow(i);
      }
    std::replace(keep.begin(), keep.end(), std::uint8_t{kLongOne}, std::uint8_t{kSurface});
    std::replace(keep.begin(), keep.end(), std::uint8_t{kShortOne}, std::uint8_t{kNoise});
  }
}

}  // namespace

bool denoise_cloud(Cloud& cloud, const DenoiseWorkspace& work, ScanCounts& counts) {
  counts.points_finite = mark_missing(cloud);
  if (counts.points_finite == 0) return true;
  assert(cloud.points <= work.order.size());

  float* xyz = cloud.xyz.data();
  WorkCount spent(work.give_up);
  PointGrid grid(work.order, work.cell_start);
  grid.build(xyz, cloud.points, kCellPitches);
  draw_samples(xyz, grid, spent);
  if (spent.used_up()) return false;
  const std::size_t points_of_ray = points_of_a_ray(xyz, grid);
  if (points_of_ray > 1) {
    grid.widen(xyz, cloud.points, std::sqrt(static_cast<float>(points_of_ray)), kCellPitches);
    draw_samples(xyz, grid, spent);
    if (spent.used_up()) return false;
  }
  CellJudge cell_judge(xyz, grid);
  cell_judge.set_tilt(typical_tilt(grid, cell_judge));
  for (std::size_t c = 0; c < grid.cells(); ++c) work.surface[c] = cell_judge.surface(c);

  SlopeChoice choice(grid, work.surface);
  PointJudge point_judge(xyz, grid, points_of_ray, spent);
  for (int row = 0; row < grid.rows(); ++row) {
    for (int column = 0; column < grid.columns(); ++column) {
      const std::size_t cell = grid.cell(column, row);
      const float level = work.surface[cell].z;
      const int calm = std::isnan(level) ? 0 : calm_cells_around(grid, work.surface, column, row);
      const std::span<const Slope> slopes = calm < 8 ? choice.around(column, row) : std::span<const Slope>{};
      point_judge.enter(column, row);
      for (const std::uint32_t i : grid.in_cell(cell)) {
        const bool at_level = calm >= kCalmCells && std::abs(cell_judge.height(i) - level) <= kCalm_mm;
        work.keep[i] = at_level || (calm < 8 && point_judge.on_surface(i, slopes)) ? kSurface : kNoise;
        // A cell may contain most of the scan.
        if (spent.used_up()) return false;
      }
    }
  }
  sort_noise(xyz, grid, work.keep, spent);
  keep_noise_groups(xyz, grid, work.keep.first(cloud.points), spent);
  if (spent.used_up()) return false;
  for (std::size_t i = 0; i < cloud.points; ++i) {
    if (std::isnan(xyz[3 * i])) continue;
    if (work.keep[i] == kSurface)
      ++counts.points_kept;
    else
      std::fill_n(xyz + 3 * i, 3, kNone);
  }
  counts.isolated_removed = counts.points_finite - counts.points_kept;
  return true;
}

}  // namespace slabd::algo
