// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "base/base.h"
#include "base/jobs.h"
#include "base/recipe.h"

/// Records of years of slabs, without scans, with planted effects of the moulds that cast them and of the line that
/// inspected them.
namespace slabd::emulator {

struct HistoryPlan {
  std::size_t slabs = 3'000;
  std::size_t moulds = 40;
  double days = 75.0;
  std::uint64_t seed = 1;
  std::int64_t end_utime_us = 0;  ///< begin of the last slab's inspection
  FixedString<64> software;
};

/// A planted effect on one item, in its unit.
struct PlantedEffect {
  int mould = 0;  ///< 0: of the line
  ItemId item = ItemId::seat_slope;
  int station = 0;
  int station_to = 0;
  double bias = 0.0;            ///< at the begin of the history
  double change_per_day = 0.0;  ///< wear of the mould, or drift of the station
};

/// One slab as the daemon stores it.
struct HistorySlab {
  SlabHeader header;
  std::vector<Attempt> attempts;    ///< by station
  std::vector<BlockResult> blocks;  ///< by station
  SlabResult slab;
  std::int64_t ended_utime_us = 0;
};

class SlabHistory {
 public:
  SlabHistory(const Recipe& recipe, const HistoryPlan& plan);

  /// Planted effects on all items. An item between seats has the effect that follows from theirs.
  [[nodiscard]] std::vector<PlantedEffect> truth() const;
  /// Standard deviation of the values of an item without the effects; 0: no value depends on moulds and stations.
  [[nodiscard]] double scatter(ItemId item) const;
  /// The records of slab `index` (0 .. slabs - 1). Equal plans give equal records, in any order of the calls.
  void make(std::size_t index, HistorySlab& out) const;

 private:
  /// Quantities of one seat from which all items follow. Deviations from the nominal: mm, deg.
  enum Quantity : std::size_t { x, y, z, slope, jaw_inner, jaw_outer, jaw, casings, rim_inner, rim_outer, kQuantities };
  using Seats = std::array<std::array<double, kQuantities>, limits::kStationsMax>;
  struct Effect {
    Seats bias{};
    Seats per_day{};
  };
  struct Deviation {
    ItemId item;
    int station;
    int station_to;
    double value;
    double U;  ///< k = 2
  };

  void plant();
  [[nodiscard]] std::vector<Deviation> deviations(const Seats& seats) const;
  void add_truth(int mould, const Effect& effect, std::vector<PlantedEffect>& list) const;
  void make_block(int station, const std::vector<Deviation>& values, const Seats& seats, Prng& random,
                  const SlabHeader& header, BlockResult& block) const;
  void judge(HistorySlab& out) const;

  Recipe recipe_;
  HistoryPlan plan_;
  std::vector<Effect> moulds_;
  Effect line_;
};

}  // namespace slabd::emulator
