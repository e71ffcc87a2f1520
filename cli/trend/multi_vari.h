// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "cli/trend/series.h"
#include "report/content.h"

/// Multi-vari chart: whether values differ from block to block, from slab to slab, or at random.
namespace slabd::cli::trend {

/// Share of the variance by its source, 0..1, from the slabs in which every block was measured (two-way analysis of
/// variance without repetition; a negative component counts as zero). NaN below three slabs or three blocks.
struct Sources {
  double blocks = kNoValue;  ///< constant differences between blocks: mould, correction of a station
  double slabs = kNoValue;   ///< differences that all blocks of a slab share
  double rest = kNoValue;
};
[[nodiscard]] Sources sources_of(const Trend& trend);

/// For each block three bars next to each other: range and mean of the first, middle and last third of the slabs.
[[nodiscard]] report::Figure multi_vari_figure(const Trend& trend, report::Language language);

}  // namespace slabd::cli::trend
