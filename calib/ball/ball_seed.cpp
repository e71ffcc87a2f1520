// SPDX-License-Identifier: Apache-2.0
//
// Where could a ball be? Among millions of points on table, posts and walls its cap is a few per cent.
//
// The radius is known, so every patch of surface names the only place where the centre can be: one radius behind it,
// along its normal. Patches of the ball all name the same place, those of a plane a plane, those of a cylinder or of
// another ball a line or a shell. Votes are counted in cells, and peaks are candidates. In contrast to drawing random
// quadruples of points this takes the whole scan into account, needs no luck, and gives the same answer every time.
//
// Patches are cells of an eighth of the radius with the cells around them; their moments are gathered in one pass over
// the scan, of which every third or fourth point is enough.
#include "calib/ball/ball_seed.h"

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>

namespace slabd::calib {
namespace {

constexpr double kCellsPerRadius = 8.0;
/// Enough points to find a ball with; the fit takes all of them.
constexpr std::size_t kPointsEnough = 1'500'000;
/// A surface before a scanner fills some 10^5 cells; a scan that fills more shows none.
constexpr std::size_t kCellsMax = 1U << 20U;
/// No scanner sees further; a coordinate beyond is a faulty point.
constexpr double kFarMm = 20'000.0;
constexpr double kPatchPointsMin = 8.0;
/// A patch thicker than this many cells is an edge or a clump.
constexpr double kPatchThickness = 0.25;
/// A cap of 60 degrees casts some 200 votes; a third of it, seen badly, this many.
constexpr double kVotesMin = 25.0;

using Index = std::array<std::int32_t, 3>;

/// Cells of space that hold something, found by where they are. They are numbered in the order of their coming.
template <typename Content>
class CellTable {
 public:
  explicit CellTable(double edge_mm) : edge_mm_(edge_mm), slots_(1U << 12U, kNobody) {}

  [[nodiscard]] Index index_of(const Vec3& p) const {
    Index index;
    for (int axis = 0; axis < 3; ++axis)
      index[static_cast<std::size_t>(axis)] = static_cast<std::int32_t>(std::floor(p[axis] / edge_mm_));
    return index;
  }
  [[nodiscard]] Vec3 middle(const Index& index) const {
    return edge_mm_ * Vec3(index[0] + 0.5, index[1] + 0.5, index[2] + 0.5);
  }
  /// The cell there, made if need be; nullptr when there are too many.
  Content* at(const Index& index) {
    std::uint32_t* slot = &slots_[slot_of(index)];
    if (*slot != kNobody) return &cells_[*slot].content;
    if (cells_.size() == kCellsMax) return nullptr;
    if (2 * cells_.size() >= slots_.size()) {
      grow();
      slot = &slots_[slot_of(index)];
    }
    *slot = static_cast<std::uint32_t>(cells_.size());
    cells_.push_back({key_of(index), index, {}});
    return &cells_.back().content;
  }
  [[nodiscard]] const Content* find(const Index& index) const {
    const std::uint32_t number = slots_[slot_of(index)];
    return number == kNobody ? nullptr : &cells_[number].content;
  }
  /// Calls visit(offset, content) for the cells around and at `index`.
  template <typename Visit>
  void around(const Index& index, const Visit& visit) const {
    for (std::int32_t x = -1; x <= 1; ++x)
      for (std::int32_t y = -1; y <= 1; ++y)
        for (std::int32_t z = -1; z <= 1; ++z)
          if (const Content* content = find({index[0] + x, index[1] + y, index[2] + z}); content != nullptr)
            visit(edge_mm_ * Vec3(x, y, z), *content);
  }

  struct Cell {
    std::uint64_t key;
    Index index;
    Content content;
  };
  [[nodiscard]] const std::vector<Cell>& cells() const { return cells_; }

 private:
  static constexpr std::uint32_t kNobody = 0xFFFF'FFFF;

  /// 21 bits each: with cells of an eighth of a millimetre that is far beyond kFarMm.
  [[nodiscard]] static std::uint64_t key_of(const Index& index) {
    std::uint64_t key = 0;
    for (const std::int32_t i : index) key = (key << 21U) | (static_cast<std::uint64_t>(i) & 0x1F'FFFFU);
    return key;
  }
  [[nodiscard]] std::size_t slot_of(std::uint64_t key) const {
    std::size_t slot = static_cast<std::size_t>((key * 0x9E3779B97F4A7C15U) >> 32U) & (slots_.size() - 1);
    while (slots_[slot] != kNobody && cells_[slots_[slot]].key != key) slot = (slot + 1) & (slots_.size() - 1);
    return slot;
  }
  [[nodiscard]] std::size_t slot_of(const Index& index) const { return slot_of(key_of(index)); }
  void grow() {
    slots_.assign(2 * slots_.size(), kNobody);
    for (std::uint32_t i = 0; i < cells_.size(); ++i) slots_[slot_of(cells_[i].key)] = i;
  }

  double edge_mm_;
  std::vector<std::uint32_t> slots_;
  std::vector<Cell> cells_;
};

/// Sums over points, relative to the middle of their cell.
struct Moments {
  float n = 0.0F;
  std::array<float, 3> p{};
  std::array<float, 6> pp{};  ///< xx xy xz yy yz zz
};

struct Votes {
  double n = 0.0;
  Vec3 sum = Vec3::Zero();
};

void add_points(std::span<const float> xyz, CellTable<Moments>& table) {
  const std::size_t points = xyz.size() / 3;
  const std::size_t step = 1 + points / kPointsEnough;
  Index last{};
  Moments* cell = nullptr;
  Vec3 middle;
  for (std::size_t i = 0; i < points; i += step) {
    const Vec3 p(xyz[3 * i], xyz[3 * i + 1], xyz[3 * i + 2]);
    if (!(std::abs(p.x()) < kFarMm && std::abs(p.y()) < kFarMm && std::abs(p.z()) < kFarMm)) continue;  // nor NaN
    const Index index = table.index_of(p);
    if (cell == nullptr || index != last) {
      cell = table.at(index);
      if (cell == nullptr) continue;
      last = index;
      middle = table.middle(index);
    }
    const Eigen::Vector3f d = (p - middle).cast<float>();
    cell->n += 1.0F;
    for (int axis = 0; axis < 3; ++axis) cell->p[static_cast<std::size_t>(axis)] += d[axis];
    std::size_t k = 0;
    for (int a = 0; a < 3; ++a)
      for (int b = a; b < 3; ++b) cell->pp[k++] += d[a] * d[b];
  }
}

/// Every patch votes for the place one radius behind it.
CellTable<Votes> cast_votes(const CellTable<Moments>& table, double edge_mm, double radius_mm,
                            const Vec3& viewpoint_mm) {
  CellTable<Votes> votes(edge_mm);
  for (const auto& cell : table.cells()) {
    double n = 0.0;
    Vec3 sum = Vec3::Zero();
    Mat3 squares = Mat3::Zero();
    table.around(cell.index, [&](const Vec3& off, const Moments& m) {
      const Vec3 p(m.p[0], m.p[1], m.p[2]);
      Mat3 pp;
      pp << m.pp[0], m.pp[1], m.pp[2], m.pp[1], m.pp[3], m.pp[4], m.pp[2], m.pp[4], m.pp[5];
      const auto count = static_cast<double>(m.n);
      n += count;
      sum += p + count * off;
      squares += pp + p * off.transpose() + off * p.transpose() + count * off * off.transpose();
    });
    if (n < kPatchPointsMin) continue;
    const Vec3 mean = sum / n;
    const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> axes(Eigen::Matrix3d(squares / n - mean * mean.transpose()));
    if (std::sqrt(std::max(0.0, axes.eigenvalues()[0])) > kPatchThickness * edge_mm) continue;
    if (axes.eigenvalues()[1] < 4.0 * axes.eigenvalues()[0]) continue;  // points on a line have no normal
    const Vec3 p = table.middle(cell.index) + mean;
    Vec3 normal = axes.eigenvectors().col(0);
    if (normal.dot(viewpoint_mm - p) < 0.0) normal = -normal;
    const Vec3 centre = p - radius_mm * normal;
    Votes* const cell_votes = votes.at(votes.index_of(centre));
    if (cell_votes == nullptr) continue;
    cell_votes->n += 1.0;
    cell_votes->sum += centre;
  }
  return votes;
}

}  // namespace

std::vector<BallCandidate> ball_candidates(std::span<const float> xyz, double radius_mm, const Vec3& viewpoint_mm,
                                           std::size_t count_max) {
  const double edge_mm = radius_mm / kCellsPerRadius;
  CellTable<Moments> table(edge_mm);
  add_points(xyz, table);
  const CellTable<Votes> votes = cast_votes(table, edge_mm, radius_mm, viewpoint_mm);

  std::vector<BallCandidate> peaks;
  for (const auto& cell : votes.cells()) {
    Votes total;
    votes.around(cell.index, [&](const Vec3&, const Votes& v) {
      total.n += v.n;
      total.sum += v.sum;
    });
    if (total.n >= kVotesMin) peaks.push_back({total.sum / total.n, total.n});
  }
  std::stable_sort(peaks.begin(), peaks.end(),
                   [](const BallCandidate& a, const BallCandidate& b) { return a.votes > b.votes; });
  std::vector<BallCandidate> candidates;
  for (const BallCandidate& peak : peaks) {
    if (candidates.size() == count_max) break;
    const bool known = std::any_of(candidates.begin(), candidates.end(), [&](const BallCandidate& other) {
      return (other.centre_mm - peak.centre_mm).norm() < radius_mm;
    });
    if (!known) candidates.push_back(peak);
  }
  return candidates;
}

}  // namespace slabd::calib
