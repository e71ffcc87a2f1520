// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <map>
#include <string>
#include <vector>

#include "base/fields.h"
#include "cli/study/source.h"
#include "cli/study/statistics.h"

/// The paper's Table 6 for every characteristic: what slabd finds against what a laboratory finds on the same things.
namespace slabd::cli::study {

/// What one side says of one thing; repeats are averaged.
struct SideValue {
  Reading reading;
  std::size_t count = 0;  ///< values in the mean
};
/// By thing (a slab id), then item and block.
struct ThingKey {
  std::string id;
  std::string item;
  int block = 0;
  auto operator<=>(const ThingKey&) const = default;
};
SLABD_FIELDS(ThingKey, id, block, item);
using Side = std::map<ThingKey, SideValue>;
/// Averages into what is there already. Readings without value are left out.
void add_to(Side& side, const std::string& id, const Reading& reading);
/// Columns id, item, value; optional block, U (k = 2). config: what is wrong, and where.
[[nodiscard]] Result<Side> side_of(const CsvTable& table);

struct CompareItem {
  std::string item;
  std::vector<ThingKey> things;
  std::vector<Pair> pairs;
  double reference_mean = kNoValue;
  double value_mean = kNoValue;
  Errors errors;
  AgreementLimits limits;
  Regression line;
  std::size_t missing = 0;    ///< things in the reference that were not measured
  double allowed = kNoValue;  ///< largest error that is allowed
  Judgement judgement = Judgement::not_judged;
  std::string reason;
};
struct CompareStudy {
  std::string source;
  StudyNotes notes;
  std::vector<CompareItem> items;
  std::vector<ThingKey> only_reference;
  std::vector<ThingKey> only_measured;
  /// Over all items in mm, as the paper's conclusion 3.
  Errors all_mm;

  [[nodiscard]] Judgement judgement() const;
};
/// `allowed`: by item. Judged only where it is given: capable when everything in the reference was measured, the errors
/// scatter and the limits of agreement with their intervals lie inside; not capable when an error lies outside; else
/// undecided.
[[nodiscard]] CompareStudy compare(const Side& reference, const Side& measured,
                                   const std::map<std::string, double>& allowed);

[[nodiscard]] Table errors_table(const CompareStudy& study, Reader reader = std::nullopt);
[[nodiscard]] Table agreement_table(const CompareStudy& study, Reader reader = std::nullopt);
[[nodiscard]] std::string compare_json(const CompareStudy& study);
[[nodiscard]] std::string compare_text(const CompareStudy& study);

}  // namespace slabd::cli::study
