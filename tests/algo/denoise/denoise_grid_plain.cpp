// SPDX-License-Identifier: Apache-2.0
//
// Noise points of a grid, given the planes of its tiles. The rules are those of algo/denoise/denoise_grid_points.cpp
// and algo/denoise/denoise_grid.h; here they are applied to every point separately. Sums are in float and in the
// kernels' order, so that a point exactly on the gate is on the same side of it.
#include "denoise_grid_plain.h"

#include <algorithm>
#include <cmath>

namespace slabd::algo::plain {
namespace {

constexpr int kColumns = GridLayout::kTileColumns;
constexpr int kRows = GridLayout::kTileRows;

/// Weight of a point in the window around another one, by its squared distance.
int weight(int distance2) {
  if (distance2 == 0 || distance2 > 10) return 0;
  if (distance2 <= 2) return 11;
  return distance2 <= 5 ? 6 : 1;
}
constexpr int kReach = 3;
constexpr int kWeightMin = 48;
constexpr int kShareReigning = 46;
constexpr int kShareMin = 55;
constexpr int kShareAmidst = 65;

constexpr int kCalmOffMost = 10;
constexpr int kReignShare = 4;
constexpr int kCompany = 4;
constexpr float kAlikeLeast_mm = 0.15F;
constexpr float kAlikeGates = 0.25F;
constexpr float kGoesOnGate_mm = 0.75F;
constexpr float kGoesOnGates = 0.6F;
constexpr float kOwnSlopeMax = 1.0F;

constexpr int kGroupLength = 16;
constexpr float kGroupStep_mm = 0.36F;
constexpr int kLongGroupLength = 32;
constexpr float kLongGroupStep_mm = 3.0F;

/// A plane relative to the middle of a tile.
struct Sheet {
  TilePlane plane;
  int first_column, first_row;  ///< of the tile

  [[nodiscard]] float z(int column, int row) const {
    return plane.z + plane.per_row * (static_cast<float>(row - first_row) - kTileMidRow) +
           plane.per_column * (static_cast<float>(column - first_column) - kTileMidColumn);
  }
  [[nodiscard]] float gate() const { return gate_of(plane); }
};

/// A surface that rises from a point.
struct Slope {
  float from, a, b;
  int column, row;

  [[nodiscard]] float z(int c, int r) const {
    return a * static_cast<float>(c - column) + from + b * static_cast<float>(r - row);
  }
  [[nodiscard]] float gate() const { return grid_gate_mm(a, b); }
};

class PlainJudge {
 public:
  PlainJudge(const GridLayout& grid, const GridWork& work, std::span<const float> z, bool alike_are_one)
      : grid_(grid), work_(work), z_(z), alike_are_one_(alike_are_one) {}

  Judged judge() {
    const auto columns = static_cast<int>(grid_.columns);
    const auto rows = static_cast<int>(grid_.rows);
    Judged judged;
    judged.off.resize(z_.size());
    judged.verdict.resize(z_.size(), Verdict::missing);
    for (int r = 0; r < rows; ++r)
      for (int c = 0; c < columns; ++c) judged.off[index(c, r)] = is_off(c, r);
    off_ = &judged.off;
    for (int tr = 0; tr < grid_.tile_rows; ++tr)
      for (int tc = 0; tc < grid_.tile_columns; ++tc) judge_tile(tc, tr, judged.verdict);
    keep_groups(judged.verdict, kGroupLength, kGroupStep_mm);
    keep_groups(judged.verdict, kLongGroupLength, kLongGroupStep_mm);
    return judged;
  }

 private:
  [[nodiscard]] std::size_t index(int column, int row) const {
    return static_cast<std::size_t>(row) * grid_.columns + static_cast<std::size_t>(column);
  }
  [[nodiscard]] bool inside(int column, int row) const {
    return column >= 0 && row >= 0 && column < static_cast<int>(grid_.columns) && row < static_cast<int>(grid_.rows);
  }
  [[nodiscard]] float height(int column, int row) const {
    return inside(column, row) ? z_[index(column, row)] : kNoPlane;
  }
  template <typename Surface>
  [[nodiscard]] bool on(const Surface& surface, int column, int row) const {
    return std::abs(height(column, row) - surface.z(column, row)) <= surface.gate();
  }
  [[nodiscard]] bool is_off(int column, int row) const {
    if (!std::isfinite(height(column, row))) return false;
    const int tc = column / kColumns;
    const int tr = row / kRows;
    for (int i = 0; i < 2; ++i)
      if (on(Sheet{work_.planes(tc, tr)[i], kColumns * tc, kRows * tr}, column, row)) return false;
    return true;
  }

  /// True if this share of the points around the point is on the surface.
  template <typename Surface>
  [[nodiscard]] bool holds(const Surface& surface, int column, int row, int share) const {
    int held = 0;
    int present = 0;
    for (int r = -kReach; r <= kReach; ++r) {
      for (int c = -kReach; c <= kReach; ++c) {
        if (std::isfinite(height(column + c, row + r))) present += weight(c * c + r * r);
        if (on(surface, column + c, row + r)) held += weight(c * c + r * r);
      }
    }
    return held >= kWeightMin && 100 * held >= share * present;
  }

  /// The planes of the nine tiles around, relative to this one, its own first.
  [[nodiscard]] std::vector<Sheet> planes_around(int tc, int tr) const {
    std::vector<Sheet> sheets;
    const auto add = [&](int c, int r) {
      if (c < 0 || r < 0 || c >= grid_.tile_columns || r >= grid_.tile_rows) return;
      for (int i = 0; i < 2; ++i) {
        const TilePlane& there = work_.planes(c, r)[i];
        if (std::isnan(there.z) || work_.too_steep(there)) continue;
        const Sheet sheet{moved(there, tc - c, tr - r), kColumns * tc, kRows * tr};
        bool known = false;
        for (const Sheet& other : sheets) {
          const float apart = apart_mm(sheet.plane, other.plane);
          if (apart <= kAlikeLeast_mm || apart <= kAlikeGates * sheet.gate()) known = true;
        }
        if (!known || !alike_are_one_) sheets.push_back(sheet);
      }
    };
    add(tc, tr);
    for (int r = tr - 1; r <= tr + 1; ++r)
      for (int c = tc - 1; c <= tc + 1; ++c)
        if (c != tc || r != tr) add(c, r);
    return sheets;
  }

  void judge_tile(int tc, int tr, std::vector<Verdict>& verdict) const {
    const TilePlane* own = work_.planes(tc, tr);
    int finite = 0;
    int off = 0;
    for (int r = kRows * tr; r < kRows * (tr + 1); ++r) {
      for (int c = kColumns * tc; c < kColumns * (tc + 1); ++c) {
        if (!std::isfinite(height(c, r))) continue;
        ++finite;
        if ((*off_)[index(c, r)]) ++off;
      }
    }
    const bool one_plane = !std::isnan(own[0].z) && std::isnan(own[1].z) && !work_.too_steep(own[0]);
    const bool calm = one_plane && off <= kCalmOffMost;
    const bool reigns = one_plane && kReignShare * off <= finite;
    const std::vector<Sheet> sheets = planes_around(tc, tr);
    for (int r = kRows * tr; r < kRows * (tr + 1); ++r) {
      for (int c = kColumns * tc; c < kColumns * (tc + 1); ++c) {
        if (!std::isfinite(height(c, r))) continue;
        Verdict& here = verdict[index(c, r)];
        if (calm && !(*off_)[index(c, r)])
          here = Verdict::calm;
        else
          here = ask(sheets, reigns, own[0], c, r);
      }
    }
  }

  [[nodiscard]] Verdict ask(const std::vector<Sheet>& sheets, bool reigns, const TilePlane& own, int column,
                            int row) const {
    for (const Sheet& sheet : sheets) {
      if (!on(sheet, column, row)) continue;
      if (holds(sheet, column, row, kShareMin)) return Verdict::explained;
      if (reigns && &sheet == &sheets[0] && holds(sheet, column, row, kShareReigning)) return Verdict::reigning;
      if (sheet.gate() > kGoesOnGate_mm) continue;
      for (int r = row - 1; r <= row + 1; ++r)
        for (int c = column - 1; c <= column + 1; ++c)
          if (on(sheet, c, r) && holds(sheet, c, r, kShareAmidst)) return Verdict::beside;
    }
    if (company(column, row) < kCompany) return Verdict::alone;
    return through(own, column, row) ? Verdict::through : Verdict::no_surface;
  }

  /// Keeps noise that is connected over a length.
  void keep_groups(std::vector<Verdict>& verdict, int length, float step_mm) const {
    struct Place {
      int column, row;
    };
    std::vector<bool> seen(z_.size());
    for (int row = 0; row < static_cast<int>(grid_.rows); ++row) {
      for (int column = 0; column < static_cast<int>(grid_.columns); ++column) {
        if (!is_noise(verdict[index(column, row)]) || seen[index(column, row)]) continue;
        seen[index(column, row)] = true;
        std::vector<Place> group = {{column, row}};
        Place low = group[0];
        Place high = group[0];
        for (std::size_t i = 0; i < group.size(); ++i) {
          const Place at = group[i];
          low = {std::min(low.column, at.column), std::min(low.row, at.row)};
          high = {std::max(high.column, at.column), std::max(high.row, at.row)};
          for (int r = at.row - 1; r <= at.row + 1; ++r) {
            for (int c = at.column - 1; c <= at.column + 1; ++c) {
              if (!inside(c, r) || seen[index(c, r)] || !is_noise(verdict[index(c, r)])) continue;
              if (!(std::abs(height(c, r) - height(at.column, at.row)) <= step_mm)) continue;
              seen[index(c, r)] = true;
              group.push_back({c, r});
            }
          }
        }
        if (1 + std::max(high.column - low.column, high.row - low.row) < length) continue;
        for (const Place& at : group) verdict[index(at.column, at.row)] = Verdict::damage;
      }
    }
  }

  /// Number of the 7 x 7 points around that are on no plane of their tiles.
  [[nodiscard]] int company(int column, int row) const {
    int count = 0;
    for (int r = row - kReach; r <= row + kReach; ++r)
      for (int c = column - kReach; c <= column + kReach; ++c)
        if ((c != column || r != row) && inside(c, r) && (*off_)[index(c, r)]) ++count;
    return count;
  }

  /// True if a surface that is level, or as steep as the tile or as the four neighbours, goes through the point or
  /// continues to it.
  [[nodiscard]] bool through(const TilePlane& own, int column, int row) const {
    const float z = height(column, row);
    const auto through_or_on = [&](float a, float b) {
      if (holds(Slope{z, a, b, column, row}, column, row, kShareMin)) return true;
      for (int r = -1; r <= 1; ++r) {
        for (int c = -1; c <= 1; ++c) {
          const float beside = height(column + c, row + r);
          const float step = beside - z - (a * static_cast<float>(c) + b * static_cast<float>(r));
          if (!(std::abs(step) <= kGoesOnGates * grid_gate_mm(a, b))) continue;
          if (holds(Slope{beside, a, b, column + c, row + r}, column + c, row + r, kShareAmidst)) return true;
        }
      }
      return false;
    };
    if (through_or_on(0.0F, 0.0F) || through_or_on(own.per_column, own.per_row)) return true;
    const float a = 0.5F * (height(column + 1, row) - height(column - 1, row));
    const float b = 0.5F * (height(column, row + 1) - height(column, row - 1));
    if (!(a * a + b * b <= kOwnSlopeMax * kOwnSlopeMax)) return false;
    return holds(Slope{z, a, b, column, row}, column, row, kShareAmidst);
  }

  const GridLayout grid_;
  const GridWork& work_;
  const std::span<const float> z_;
  const bool alike_are_one_;
  const std::vector<bool>* off_ = nullptr;
};

}  // namespace

Judged judge_points(const GridLayout& grid, const GridWork& work, std::span<const float> z, bool alike_are_one) {
  return PlainJudge(grid, work, z, alike_are_one).judge();
}

}  // namespace slabd::algo::plain
