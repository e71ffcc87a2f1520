// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <map>
#include <span>
#include <string>
#include <vector>

#include "cli/study/source.h"
#include "cli/study/statistics.h"

/// The paper's ten repeats (Figs. 18 and 19) and the type-1 study, characteristic by characteristic.
namespace slabd::cli::study {

struct Characteristic {
  Reading about;               ///< item, blocks and limits; its value is of no meaning here
  std::vector<double> values;  ///< one a run, NaN: not measured
  std::size_t missing = 0;
  std::string limits_differ;  ///< which runs were judged by different limits; empty: all by the same
  Spread spread;
  Gauge gauge;
};

struct RepeatStudy {
  std::string source;  ///< "10 scans", "slab T-1"
  StudyNotes notes;
  std::vector<std::string> runs;
  std::vector<std::string> warnings;
  std::vector<Characteristic> characteristics;

  /// The worst of what was judged: not capable, then undecided; not_judged when nothing was.
  [[nodiscard]] Judgement judgement() const;
};

/// What is known of the thing that was measured: by item, or by item and block ("seat_slope@3"), the latter first.
struct GaugeTask {
  std::map<std::string, double> references;
  std::map<std::string, double> tolerances;  ///< else upper minus lower limit, where there are both
};
/// Characteristics by item and block, of `items` (all when empty) at `block` (all when 0). `scans`: the takes come from
/// scans, so two that are equal to the last bit are one scan taken twice, and nothing is capable by them. Runs that
/// were judged by different limits have no tolerance in common: undecided, unless the task states one.
[[nodiscard]] RepeatStudy repeat_study(std::span<const Take> takes, const std::vector<std::string>& items, int block,
                                       const GaugeTask& task, bool scans);

[[nodiscard]] Table characteristics_table(const RepeatStudy& study, Reader reader = std::nullopt);
/// The type-1 study of what has a reference.
[[nodiscard]] Table gauges_table(const RepeatStudy& study, Reader reader = std::nullopt);
[[nodiscard]] std::string repeat_json(const RepeatStudy& study);
/// Tables for people; every block's own line when `details`, or when there is one block only.
[[nodiscard]] std::string repeat_text(const RepeatStudy& study, bool details);

}  // namespace slabd::cli::study
