// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "cli/trend/statistics.h"
#include "report/content.h"

namespace slabd::cli::trend {

/// One characteristic over the slabs, as the trend command shows it.
struct Trend {
  ItemId item = ItemId::seat_slope;
  int block = 0;  ///< 0: mean over the stations of each slab, or an item of the whole slab
  bool is_mean = false;
  int slab_type = 0;  ///< of all its slabs; 0: there is no value
  std::size_t not_measured = 0;
  std::size_t other_limits = 0;     ///< values left out: judged by another nominal or other limits than the newest
  std::uint8_t emulated = 0;        ///< emulation bits of its slabs: all of them are emulated, or none
  std::size_t other_emulation = 0;  ///< slabs left out: emulated where the newest is real, or the other way round
  std::size_t incomplete = 0;       ///< slabs left out of the chart of means, a value of a block missing
  std::vector<std::int64_t> keys;
  std::vector<SlabId> ids;
  std::vector<std::int64_t> began_utime_us;
  std::vector<double> values;
  double nominal = kNoValue;  ///< of the newest slab, and so are the limits
  double lower = kNoValue;
  double upper = kNoValue;
  Individuals chart;
  Individuals singles;    ///< of one block: what capability rests on
  Capability capable;     ///< of `capable_block`: the one asked for, or the worst; nothing while preliminary
  int capable_block = 0;  ///< 0: an item of the whole slab, or none has values enough
  std::vector<StationBias> stations;
};

/// From what the database holds of it, oldest first, of slabs of one type: two have not the same blocks and limits.
[[nodiscard]] Trend trend_of(ItemId item, int block, const std::vector<storage::ItemValue>& values);

/// Individuals above moving ranges, control limits, tolerance when it is in reach; grey while preliminary.
[[nodiscard]] report::Figure chart_figure(const Trend& trend, report::Language language);
/// How far every station is off the others of its slab; empty of one station.
[[nodiscard]] Table stations_table(const Trend& trend, report::Language language);
/// The chart and its figures as a document.
[[nodiscard]] report::Report document_of(const Trend& trend, report::Language language);

/// "1.63 (1.41 .. 1.85)", or why there is none.
[[nodiscard]] std::string index_text(const Index& index);

}  // namespace slabd::cli::trend
