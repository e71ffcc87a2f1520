// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "cli/study/grr.h"
#include "cli/study/same_part.h"
#include "cli/study/source.h"

/// A gauge R&R study as people plan it: who measured which part how often, put together from a table.
namespace slabd::cli::study {

/// One measurement and what it stands for.
struct Placing {
  std::string place;  ///< "plan.csv:7"
  std::string part;
  std::string appraiser;
  std::string trial;
  Reading reading;
};

struct GrrItem {
  Reading about;  ///< item and limits
  std::vector<std::string> parts;
  std::vector<std::string> appraisers;
  std::vector<std::string> trials;
  Crossed crossed;
  double tolerance = kNoValue;
  std::optional<Components> by_range;
  Anova by_anova;
  GrrJudgement judged;  ///< of the analysis of variance
};
struct GrrStudy {
  std::string source;
  StudyNotes notes;
  std::vector<GrrItem> items;
  std::vector<std::string> refused;  ///< sentences: which item, which cell is missing or filled twice

  [[nodiscard]] Judgement judgement() const;
};

/// Placings of a plan. `scan` measures a file, `slab` reads a stored slab (one record: an id with several inspections
/// is refused) of which a block is meant, or all (0); both answer with everything measured. Columns: appraiser, trial,
/// and
///   part, value [, item, lower, upper]   values measured elsewhere;
///   scan, block [, part]                 a part is the block, unless it has a name;
///   slab [, block, part]                 every block is a part; with a name: name/block.
/// config: a column or cell that is missing or wrong, with its place.
struct PlanReaders {
  std::function<Result<std::vector<Reading>>(const std::string& path, int block)> scan;
  std::function<Result<std::vector<Reading>>(const std::string& slab, int block)> slab;
};
[[nodiscard]] Result<std::vector<Placing>> placings_of(const CsvTable& plan, const PlanReaders& readers);

/// By item, of `items` (when empty all with two parts, or with a tolerance of the study's own). An item whose table has
/// a hole is refused, never filled up. `tolerance(item)`: NaN for the recipe's, which must then be the same in every
/// placing.
[[nodiscard]] GrrStudy grr_study(const std::vector<Placing>& placings, const std::vector<std::string>& items,
                                 const std::function<double(const std::string&)>& tolerance, Interaction interaction);

/// Sources of variation, by both methods.
[[nodiscard]] Table components_table(const GrrItem& item, Reader reader = std::nullopt);
[[nodiscard]] std::string grr_json(const GrrStudy& study);
/// One line an item; with `details`, or one item only, the tables behind it.
[[nodiscard]] std::string grr_text(const GrrStudy& study, bool details);

}  // namespace slabd::cli::study
