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

constexpr std::size_t kColumns = limits::kSurfaceColumns;
constexpr std::size_t kRows = limits::kSurfaceRows;
constexpr std::size_t kCells = limits::kSurfaceCells;
/// Pores up to here are pores where the recipe has no limit for them.
constexpr double kPoreUnlimited_mm = 12.0;

/// Where nothing was seen and the scan does not go on beyond, in x and in y, the field of view ends.
void leave_out_beyond_view(std::span<const SurfaceCell> cells, SurfaceField& field) {
  std::array<std::pair<std::size_t, std::size_t>, kRows> along_x;
  std::array<std::pair<std::size_t, std::size_t>, kColumns> along_y;
  along_x.fill({kColumns, 0});
  along_y.fill({kRows, 0});
  for (std::size_t i = 0; i < kCells; ++i) {
    constexpr std::uint32_t kSeenMin = 2;  // strays come alone
    if (cells[i].count < kSeenMin) continue;
    auto& row = along_x[i / kColumns];
    row = {std::min(row.first, i % kColumns), std::max(row.second, i % kColumns)};
    auto& column = along_y[i % kColumns];
    column = {std::min(column.first, i / kColumns), std::max(column.second, i / kColumns)};
  }
  for (std::size_t i = 0; i < kCells; ++i) {
    if (field.zone[i] == SurfaceZone::none || field.seen(i)) continue;
    const std::size_t row = i / kColumns;
    const std::size_t column = i % kColumns;
    const bool inside = along_x[row].first < column && column < along_x[row].second && along_y[column].first < row &&
                        row < along_y[column].second;
    if (!inside) field.zone[i] = SurfaceZone::none;
  }
}

Item* item_of(BlockResult& result, ItemId id) {
  for (Item& item : result.items)
    if (item.id == id) return &item;
  return nullptr;
}

}  // namespace

void find_pores_and_damage(const BlockModel& model, const SurfaceTable& table, std::span<const SurfaceCell> cells,
                           std::span<float> memory, Team& team, BlockResult& result) {
  result.findings.clear();
  result.pores = {};
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
  leave_out_beyond_view(cells, field);
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

  result.pores = {found.pore_count, found.pore_largest_mm, found.pore_deepest_mm,
                  found.seen_mm2 > 0.0 ? found.pore_area_mm2 / found.seen_mm2 : kNoValue};
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
