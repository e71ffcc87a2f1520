// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "cli/trend/statistics.h"
#include "report/content.h"

namespace slabd::cli::trend {

/// One characteristic over the slabs, as shown by the trend command.
struct Trend {
  ItemId item = ItemId::seat_slope;
  int block = 0;  ///< 0: mean over the stations of each slab, or an item of the whole slab
  bool is_mean = false;
  int slab_type = 0;  ///< of all its slabs; 0: no values
  std::size_t not_measured = 0;
  std::size_t other_limits = 0;     ///< values left out: judged with another nominal or other limits than the newest
  std::uint8_t emulated = 0;        ///< emulation bits of its slabs, which are all emulated or all real
  std::size_t other_emulation = 0;  ///< slabs left out, because they are emulated and the newest is real, or vice versa
  std::size_t incomplete = 0;       ///< slabs left out of the chart of means, because the value of a block is missing
  std::vector<std::int64_t> keys;
  std::vector<SlabId> ids;
  std::vector<std::int64_t> began_utime_us;
  std::vector<double> values;
  double nominal = kNoValue;  ///< of the newest slab, like the limits
  double lower = kNoValue;
  double upper = kNoValue;
  Individuals chart;
  Individuals singles;    ///< chart of one block, the basis of capability
  Capability capable;     ///< of `capable_block`: the requested block, or the worst one; NaN while preliminary
  int capable_block = 0;  ///< 0: an item of the whole slab, or too few values
  std::vector<StationBias> stations;
};

/// Trend from the stored values, oldest first, of slabs of one type, because types differ in blocks and limits.
[[nodiscard]] Trend trend_of(ItemId item, int block, const std::vector<storage::ItemValue>& values);

/// Individuals above moving ranges, control limits, tolerance if it is near the values; grey while preliminary.
[[nodiscard]] report::Figure chart_figure(const Trend& trend, report::Language language);
/// Bias of every station from the others of its slab; empty if there is one station only.
[[nodiscard]] Table stations_table(const Trend& trend, report::Language language);
/// The chart and its figures as a document.
[[nodiscard]] report::Report document_of(const Trend& trend, report::Language language);

/// "1.63 (1.41 .. 1.85)", or "-" without a value.
[[nodiscard]] std::string index_text(const Index& index);

}  // namespace slabd::cli::trend
