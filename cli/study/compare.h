// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <map>
#include <string>
#include <vector>

#include "base/fields.h"
#include "cli/study/source.h"
#include "cli/study/statistics.h"

/// The paper's Table 6 for every characteristic: values of slabd compared with a laboratory's values of the same
/// objects.
namespace slabd::cli::study {

/// Value of one side for one object; repeats are averaged.
struct SideValue {
  Reading reading;
  std::size_t count = 0;  ///< values in the mean
};
/// Key by object (a slab id), then item and block.
struct ThingKey {
  std::string id;
  std::string item;
  int block = 0;
  auto operator<=>(const ThingKey&) const = default;
};
SLABD_FIELDS(ThingKey, id, block, item);
using Side = std::map<ThingKey, SideValue>;
/// Averages the reading into an existing value. Readings without a value are left out.
void add_to(Side& side, const std::string& id, const Reading& reading);
/// Reads columns id, item, value; optional block, U (k = 2). Code::config names the fault and its place.
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
  std::size_t missing = 0;    ///< objects in the reference that were not measured
  double allowed = kNoValue;  ///< largest allowed error
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
/// `allowed`: by item; other items are not judged. Capable if everything in the reference was measured, the errors
/// scatter, and the limits of agreement with their intervals are within it. Not capable if an error exceeds it;
/// otherwise undecided.
[[nodiscard]] CompareStudy compare(const Side& reference, const Side& measured,
                                   const std::map<std::string, double>& allowed);

[[nodiscard]] report::Table errors_table(const CompareStudy& study, Reader reader = std::nullopt);
[[nodiscard]] report::Table agreement_table(const CompareStudy& study, Reader reader = std::nullopt);
[[nodiscard]] std::string compare_json(const CompareStudy& study);
[[nodiscard]] std::string compare_text(const CompareStudy& study);

}  // namespace slabd::cli::study
