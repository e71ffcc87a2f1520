// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <map>
#include <span>
#include <string>
#include <vector>

#include "cli/study/source.h"
#include "cli/study/statistics.h"

/// The paper's ten repeats (Figs. 18 and 19) and the type-1 study for every characteristic.
namespace slabd::cli::study {

struct Characteristic {
  Reading about;               ///< item, blocks and limits; its value is unused
  std::vector<double> values;  ///< one per run, NaN: not measured
  std::size_t missing = 0;
  std::string limits_differ;  ///< runs that were judged by different limits; empty if all have the same
  Spread spread;
  Gauge gauge;
};

struct RepeatStudy {
  std::string source;  ///< "10 scans", "slab T-1"
  StudyNotes notes;
  std::vector<std::string> runs;
  std::vector<std::string> warnings;
  std::vector<Characteristic> characteristics;

  /// The worst judgement: not capable, then undecided; not_judged if nothing was judged.
  [[nodiscard]] Judgement judgement() const;
};

/// Known values of the measured object: by item, or by item and block ("seat_slope@3"), which has priority.
struct GaugeTask {
  std::map<std::string, double> references;
  std::map<std::string, double> tolerances;  ///< default: upper minus lower limit, if both exist
};
/// Characteristics by item and block, of `items` (all if empty) at `block` (all if 0). `scans`: the takes are from
/// scans, so two with equal bits are the same scan twice, and nothing is judged capable with them. Runs with different
/// limits have no common tolerance: undecided, unless the task contains one.
[[nodiscard]] RepeatStudy repeat_study(std::span<const MeasuredOnce> measurements,
                                       const std::vector<std::string>& items, int block, const GaugeTask& task,
                                       bool scans);

[[nodiscard]] report::Table characteristics_table(const RepeatStudy& study, Reader reader = std::nullopt);
/// The type-1 study of characteristics with a reference.
[[nodiscard]] report::Table gauges_table(const RepeatStudy& study, Reader reader = std::nullopt);
[[nodiscard]] std::string repeat_json(const RepeatStudy& study);
/// Text tables; with `details`, or for one block only, with a line per block.
[[nodiscard]] std::string repeat_text(const RepeatStudy& study, bool details);

}  // namespace slabd::cli::study
