// SPDX-License-Identifier: Apache-2.0
//
// The search for pores and damage, step by step: what is expected of each cell (surface_reference.h), cracks
// (surface_cracks.h), places that lie off or are missing (surface_groups.h), and what the recipe's items come to.
#include "algo/survey/surface_damage.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "algo/survey/surface_cracks.h"
#include "algo/survey/surface_groups.h"
#include "algo/survey/surface_reference.h"

namespace slabd::algo {
namespace {

constexpr std::size_t kColumns = kSurfaceColumns;
constexpr std::size_t kCells = kSurfaceCells;
/// Pores up to here are pores where the recipe has no limit for them.
constexpr double kPoreUnlimited_mm = 12.0;

/// From and to which cell of the deviation map anything was seen, line by line.
class FieldOfView {
 public:
  explicit FieldOfView(const DeviationMap& map) : map_(map) {
    for (std::size_t row = 0; row < map.rows; ++row)
      along_x_[row] =
          reach(map.columns, [&](std::size_t column) { return map.count[row * map.columns + column] != 0; });
    for (std::size_t column = 0; column < map.columns; ++column)
      along_y_[column] = reach(map.rows, [&](std::size_t row) { return map.count[row * map.columns + column] != 0; });
  }
  /// Was something seen on all four sides of this place?
  [[nodiscard]] bool surrounds(double x, double y) const {
    const double column = x / map_.cell_mm + 0.5 * static_cast<double>(map_.columns);
    const double row = y / map_.cell_mm + 0.5 * static_cast<double>(map_.rows);
    if (!(column >= 0.0 && row >= 0.0 && column < static_cast<double>(map_.columns) &&
          row < static_cast<double>(map_.rows)))
      return false;
    const auto c = static_cast<std::size_t>(column);
    const auto r = static_cast<std::size_t>(row);
    return along_x_[r].first < c && c < along_x_[r].second && along_y_[c].first < r && r < along_y_[c].second;
  }

 private:
  using Reach = std::pair<std::size_t, std::size_t>;
  template <typename Seen>
  static Reach reach(std::size_t length, const Seen& seen) {
    std::size_t first = 0;
    while (first < length && !seen(first)) ++first;
    std::size_t last = length - 1;
    while (last > first && !seen(last)) --last;
    return {first, last};
  }
  const DeviationMap& map_;
  std::array<Reach, limits::kFaceTableY / limits::kDeviationMapCell_mm> along_x_;
  std::array<Reach, limits::kFaceTableX / limits::kDeviationMapCell_mm> along_y_;
};

/// Where nothing was seen and the scan does not go on beyond, in x and in y, the field of view ends.
void leave_out_beyond_view(const SurfaceTable& table, const DeviationMap& map, SurfaceField& field) {
  const FieldOfView view(map);
  for (std::size_t row = table.rows()[0]; row < table.rows()[1]; ++row)
    for (std::size_t i = row * kColumns; i < (row + 1) * kColumns; ++i)
      if (field.zone[i] != SurfaceZone::none && !field.seen(i) &&
          !view.surrounds(surface_x_mm(i % kColumns), surface_y_mm(row)))
        field.zone[i] = SurfaceZone::none;
}

Item* item_of(BlockResult& result, ItemId id) {
  for (Item& item : result.items)
    if (item.id == id) return &item;
  return nullptr;
}

}  // namespace

void find_pores_and_damage(const BlockModel& model, const SurfaceTable& table, std::span<const SurfaceCell> cells,
                           const DeviationMap& map, std::span<float> memory, Team& team, BlockResult& result) {
  result.findings.clear();
  result.pores = {};
  result.edges.clear();
  if (!result.seat.plane.ok) return;
  static_assert(4 * kCells + kCells + kCells / 2 + kCrackBytes / 2 <= kSurfaceFloats);
  float* next = memory.data();
  const auto floats = [&](std::size_t count) {
    const std::span<float> taken(next, count);
    next += count;
    return taken;
  };
  SurfaceField field;
  field.off = floats(kCells);
  field.face_off = floats(kCells);
  field.cover = floats(kCells);
  field.whole = floats(kCells);
  const std::span<std::uint32_t> stack(reinterpret_cast<std::uint32_t*>(floats(kCells).data()), kCells);
  field.zone = {reinterpret_cast<SurfaceZone*>(floats(kCells / 4).data()), kCells};
  const std::span<std::uint8_t> marks(reinterpret_cast<std::uint8_t*>(floats(kCells / 4).data()), kCells);
  const std::array<std::span<std::byte>, 2> crack_memory = {std::as_writable_bytes(floats(kCrackBytes / 4)),
                                                            std::as_writable_bytes(floats(kCrackBytes / 4))};

  compare_with_expected(model, table, cells, result, team, field);
  result.edges = field.edges;
  leave_out_beyond_view(table, map, field);
  std::array<CrackPaths, 2> cracks;
  team.run(2, [&](std::size_t i) { find_cracks(field, i == 0, crack_memory[i], cracks[i]); });

  Item* pores = item_of(result, ItemId::surface_pores);
  Item* damage = item_of(result, ItemId::block_damage);
  const double pore_max_mm =
      pores != nullptr && has_value(pores->upper) ? kPoreReserve * pores->upper : kPoreUnlimited_mm;
  FoundSurfaces found;
  for (const CrackPaths& paths : cracks)
    for (const CrackPath& path : paths) add_crack(model, table, path, field, found);
  group_cells(model, table, field, pore_max_mm, marks, stack, found);

  result.pores = {found.pore_count,
                  found.pore_largest_mm,
                  found.pore_deepest_mm,
                  found.seen_mm2 > 0.0 ? found.pore_area_mm2 / found.seen_mm2 : kNoValue,
                  {}};
  for (const FoundSurface& one : found.damage) (void)result.findings.push(one.finding);
  for (const FoundSurface& one : found.pores) (void)result.findings.push(one.finding);
  if (pores != nullptr) {
    pores->value = found.pore_largest_mm;
    pores->beside = found.pore_deepest_mm;
  }
  if (damage != nullptr) {
    damage->value = found.damage_extent_mm;
    damage->beside = found.damage_depth_mm;
  }
}

}  // namespace slabd::algo
