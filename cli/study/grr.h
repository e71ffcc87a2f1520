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

/// Gauge repeatability and reproducibility of crossed studies: every appraiser measures every part equally often. For a
/// robot cell an appraiser is a re-clamping, a homing or a shift. Two ways, as in AIAG MSA-4, chapter III.
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
/// What a study needs before it is judged: fewer say too little.
inline constexpr std::size_t kGrrPartsMin = 10;
inline constexpr std::size_t kGrrAppraisersMin = 2;
inline constexpr std::size_t kGrrTrialsMin = 2;
/// Factors of the average-range method end here.
inline constexpr std::size_t kGrrRangeMax = 20;

/// Standard deviations by source.
struct Components {
  double EV = kNoValue;   ///< repeatability: the same appraiser again
  double AV = kNoValue;   ///< reproducibility: one appraiser against another
  double INT = kNoValue;  ///< appraisers differ from part to part; only in ANOVA without pooling, else 0
  double GRR = kNoValue;  ///< root of the sum of squares of the above
  double PV = kNoValue;   ///< the parts themselves
  double TV = kNoValue;   ///< GRR and PV
  /// A variance came out negative and was set to zero: AV, INT, PV.
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

/// EV = R K1; AV = sqrt((X K2)^2 - EV^2 / (parts trials)); PV = Rp K3, with R the mean range of the trials, X the range
/// of the appraisers' means and Rp that of the parts' (MSA-4, fig. III-B 16). K1 = 1 / d2 of the trials, K2 and K3 =
/// 1 / d2* of one range of as many, to the four digits of the handbook. Nothing: a count below 2 or above kGrrRangeMax.
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
  automatic,  ///< pooled with the repeatability when it is not significant: p > 0.05 (MSA-4, appendix A)
  keep,
  pool,
};
inline constexpr double kPoolAbove = 0.05;

/// Two-way analysis of variance, parts and appraisers random.
struct Anova {
  AnovaRow part;
  AnovaRow appraiser;
  AnovaRow interaction;
  AnovaRow repeatability;  ///< of the trials alone
  AnovaRow pooled;         ///< with the interaction in it
  AnovaRow total;
  bool is_pooled = false;  ///< which model `components` is of
  Components components;
  Components with_interaction;
  Components without_interaction;
};
/// F of part and appraiser are against the interaction, or against the pooled repeatability when pooled; that of the
/// interaction against the repeatability. Nothing: a count below 2.
[[nodiscard]] std::optional<Anova> anova(const Crossed& study, Interaction interaction = Interaction::automatic);

struct GrrJudgement {
  Judgement judgement = Judgement::not_judged;
  bool conditional = false;  ///< between 10 and 30 %: undecided, may be acceptable for what it costs
  std::string reason;
};
/// By 6 GRR / T when there is a tolerance, else by GRR / TV and ndc: below 10 % and (TV) ndc 5 or more is capable,
/// above 30 % or ndc below 5 not, between is undecided. Fewer parts, appraisers or trials than above are undecided, and
/// so is a study none of whose trials differs from the one before.
[[nodiscard]] GrrJudgement judge(const Crossed& study, const Components& components, double tolerance);

// A gauge R&R study as people plan it: who measured which part how often, put together from a table.

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
