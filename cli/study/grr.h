// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "base/fields.h"
#include "base/items.h"
#include "cli/study/source.h"
#include "cli/study/statistics.h"

/// Gauge repeatability and reproducibility of crossed studies: every appraiser measures every part equally often. For
/// a robot cell an appraiser is a re-clamping, a homing or a shift. Two methods, as in AIAG MSA-4, chapter III.
namespace slabd::cli::study {

/// Balanced by construction: `value[(part * appraisers + appraiser) * trials + trial]`, all finite.
struct Crossed {
  std::size_t parts = 0;
  std::size_t appraisers = 0;
  std::size_t trials = 0;
  std::vector<double> value;

  [[nodiscard]] double at(std::size_t part, std::size_t appraiser, std::size_t trial) const {
    return value[(part * appraisers + appraiser) * trials + trial];
  }
};
/// Minimum size of a study that is judged.
inline constexpr std::size_t kGrrPartsMin = 10;
inline constexpr std::size_t kGrrAppraisersMin = 2;
inline constexpr std::size_t kGrrTrialsMin = 2;
/// Largest count with a factor of the average-range method.
inline constexpr std::size_t kGrrRangeMax = 20;

/// Standard deviations by source.
struct Components {
  double EV = kNoValue;   ///< repeatability: the same appraiser again
  double AV = kNoValue;   ///< reproducibility: differences between appraisers
  double INT = kNoValue;  ///< appraisers differ from part to part; only in ANOVA without pooling, else 0
  double GRR = kNoValue;  ///< root of the sum of squares of the above
  double PV = kNoValue;   ///< variation of the parts
  double TV = kNoValue;   ///< GRR and PV
  /// True if a negative variance was set to zero: AV, INT, PV.
  bool av_zeroed = false;
  bool int_zeroed = false;
  bool pv_zeroed = false;

  /// 100 GRR / TV.
  [[nodiscard]] double of_variation() const { return 100.0 * GRR / TV; }
  /// 100 * 6 GRR / T.
  [[nodiscard]] double of_tolerance(double tolerance) const { return 600.0 * GRR / tolerance; }
  /// Number of distinct categories, 1.41 PV / GRR (MSA-4 cuts it to an integer).
  [[nodiscard]] double ndc() const { return 1.41 * PV / GRR; }
};

/// EV = R K1; AV = sqrt((X K2)^2 - EV^2 / (parts trials)); PV = Rp K3, with R the mean range of the trials, X the
/// range of the appraisers' means and Rp that of the parts' (MSA-4, fig. III-B 16). K1 = 1 / d2 of the trials; K2 and
/// K3 = 1 / d2* of one range of that number, to the four digits of the handbook. nullopt if a count is below 2 or
/// above kGrrRangeMax.
[[nodiscard]] std::optional<Components> average_range(const Crossed& study);

struct AnovaRow {
  double ss = kNoValue;
  double df = kNoValue;
  double ms = kNoValue;
  double f = kNoValue;
  double p = kNoValue;
};
SLABD_FIELDS(AnovaRow, ss, df, ms, f, p);
enum class Interaction : std::uint8_t {
  automatic,  ///< pooled with the repeatability if it is not significant: p > 0.05 (MSA-4, appendix A)
  keep,
  pool,
};
inline constexpr double kPoolAbove = 0.05;

/// Two-way analysis of variance, parts and appraisers random.
struct Anova {
  AnovaRow part;
  AnovaRow appraiser;
  AnovaRow interaction;
  AnovaRow repeatability;  ///< of the trials only
  AnovaRow pooled;         ///< including the interaction
  AnovaRow total;
  bool is_pooled = false;  ///< true if `components` is of the pooled model
  Components components;
  Components with_interaction;
  Components without_interaction;
};
/// F of part and appraiser is relative to the interaction, or to the pooled repeatability if pooled; F of the
/// interaction is relative to the repeatability. nullopt if a count is below 2.
[[nodiscard]] std::optional<Anova> anova(const Crossed& study, Interaction interaction = Interaction::automatic);

struct GrrJudgement {
  Judgement judgement = Judgement::not_judged;
  bool conditional = false;  ///< between 10 and 30 %: undecided, may be acceptable depending on the cost
  std::string reason;
};
/// Judges by 6 GRR / T if there is a tolerance, otherwise by GRR / TV and ndc. Below 10 % and (TV) ndc of at least 5
/// is capable, above 30 % or ndc below 5 is not, between is undecided. A study with too few parts, appraisers or
/// trials is undecided, and so is one whose trials are all equal.
[[nodiscard]] GrrJudgement judge(const Crossed& study, const Components& components, double tolerance);

// A gauge R&R study as planned: parts, appraisers and trials, assembled from a table.

/// One measurement with its part, appraiser and trial.
struct PlannedReading {
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
  std::vector<std::string> refused;  ///< sentences: the item, and the cell that is missing or filled twice

  [[nodiscard]] Judgement judgement() const;
};

/// Measurements of a plan. `scan` measures a file. `slab` reads one block or all (0) of a stored slab; an id with
/// several inspections is rejected. Both return all measured values. Columns: appraiser, trial, and
///   part, value [, item, lower, upper]   values measured elsewhere;
///   scan, block [, part]                 the part is the block, unless it has a name;
///   slab [, block, part]                 every block is a part; with a name: name/block.
/// Code::config: a column or cell is missing or invalid, with its place.
struct PlanReaders {
  std::function<Result<std::vector<Reading>>(const std::string& path, int block)> scan;
  std::function<Result<std::vector<Reading>>(const std::string& slab, int block)> slab;
};
[[nodiscard]] Result<std::vector<PlannedReading>> planned_readings_of(const CsvTable& plan, const PlanReaders& readers);

/// Studies by item, for `items` (if empty, for all with two parts or with a tolerance in the study). An item with a
/// missing cell is rejected, never completed. `tolerance(item)`: NaN for the recipe's, which must then be the same in
/// all measurements.
[[nodiscard]] GrrStudy grr_study(const std::vector<PlannedReading>& readings_as_planned,
                                 const std::vector<std::string>& items,
                                 const std::function<double(const std::string&)>& tolerance, Interaction interaction);

/// Sources of variation, by both methods.
[[nodiscard]] report::Table components_table(const GrrItem& item, Reader reader = std::nullopt);
[[nodiscard]] std::string grr_json(const GrrStudy& study);
/// One line per item; with `details`, or for one item only, with the tables.
[[nodiscard]] std::string grr_text(const GrrStudy& study, bool details);

}  // namespace slabd::cli::study
