// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "cli/study/statistics.h"
#include "cli/trend/distribution.h"
#include "cli/trend/statistics.h"
#include "report/words.h"
#include "storage/storage.h"

/// One characteristic over the slabs: its series, its stability, its capability, and the judgement of all of them.
namespace slabd::cli::trend {

/// Value that represents a slab in the chart.
enum class ValueIs : std::uint8_t {
  single,  ///< of the named block, or of the slab itself
  mean,    ///< of all blocks
  largest  ///< largest deviation of a block, as a size: the mean of seat positions is zero by the fit of the slab
};

/// One slab in the chart.
struct Point {
  std::int64_t key = 0;
  SlabId id;
  std::int64_t began_utime_us = 0;
  std::size_t blocks = 0;    ///< measured places
  double value = kNoValue;   ///< NaN if a place is missing: the mean of fewer blocks is another quantity
  double lowest = kNoValue;  ///< of the single values (of their deviations if the value is the largest deviation) ...
  double highest = kNoValue;
  std::size_t outside = 0;  ///< number of single values outside the limits
  Signal signal = Signal::none;
};

/// A single value outside the limits.
struct OutsideValue {
  std::int64_t key = 0;
  SlabId id;
  Item item;
};

struct Trend {
  ItemId item = ItemId::seat_slope;
  int block = 0;  ///< 0: all stations of each slab, or an item of the whole slab
  ValueIs value_is = ValueIs::single;
  int slab_type = 0;                ///< of all its slabs; 0: no values
  std::size_t not_measured = 0;     ///< values
  std::size_t other_limits = 0;     ///< values left out: judged with another nominal or other limits than the newest
  std::uint8_t emulated = 0;        ///< emulation bits of its slabs, which are all emulated or all real
  std::size_t other_emulation = 0;  ///< slabs left out, because they are emulated and the newest is real, or vice versa
  std::size_t incomplete = 0;       ///< slabs without a value in the chart, because that of a block is missing
  std::size_t places = 0;           ///< measured places of a complete slab
  std::vector<Point> points;        ///< oldest first
  double nominal = kNoValue;        ///< of the newest slab, like the limits
  double lower = kNoValue;
  double upper = kNoValue;
  bool limits_differ = false;  ///< between the blocks: `lower` and `upper` are those of one of them
  Individuals chart;           ///< of the complete points
  Individuals singles;         ///< chart of one block, the basis of capability
  Capability capable;          ///< of `capable_block`: the requested block, or the worst one; NaN while preliminary
  int capable_block = 0;       ///< 0: an item of the whole slab, or too few values
  std::size_t values = 0;      ///< single values of all slabs and blocks, the basis of `whole`
  Performance whole;           ///< indices are NaN if the limits of the blocks differ
  std::vector<OutsideValue> outside;  ///< oldest first
  std::vector<Placed> placed;         ///< the single values, by slab
  std::vector<StationBias> stations;
  study::Judgement judgement = study::Judgement::not_judged;

  [[nodiscard]] std::size_t signals() const;
  /// True if the chart has not more signals than chance gives a stable process.
  [[nodiscard]] bool is_stable() const;
};

/// Trend from the stored values, oldest first, of slabs of one type, because types differ in blocks and limits.
[[nodiscard]] Trend trend_of(ItemId item, int block, const std::vector<storage::ItemValue>& values);

/// Share of the slabs that the rules of the chart mark in a stable process, at most.
inline constexpr double kSignalsByChance = 0.03;

/// Required value of Cpk and Ppk, and the share outside the limits that belongs to it, two-sided.
inline constexpr double kCapable = 1.33;
inline constexpr double kShareCapable = 6.3e-5;

/// Reason of the judgement: "Ppk below 1.33", "3 of 540 values outside the limits", ...
[[nodiscard]] std::string judgement_reason(const Trend& trend, report::Language language);

/// "nine in a row on one side of the mean: slabs 48 to 60 (S-48 .. S-60)", one text for each run of a rule.
[[nodiscard]] std::vector<std::string> signal_lines(const Trend& trend, report::Language language);
[[nodiscard]] std::string signal_words(Signal signal, report::Language language);

}  // namespace slabd::cli::trend
