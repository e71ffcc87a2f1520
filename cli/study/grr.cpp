// SPDX-License-Identifier: Apache-2.0
#include "cli/study/grr.h"

#include <fmt/core.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "cli/study/statistics.h"

namespace slabd::cli::study {
namespace {

/// 1 / d2 and 1 / d2* (for one range: d2*^2 = d2^2 + d3^2) of ranges of 2, 3, ... 20 normal values.
constexpr std::array kOneOverD2 = {0.8862, 0.5908, 0.4857, 0.4299, 0.3946, 0.3698, 0.3512, 0.3367, 0.3249, 0.3152,
                                   0.3069, 0.2998, 0.2935, 0.2880, 0.2831, 0.2787, 0.2747, 0.2711, 0.2677};
constexpr std::array kOneOverD2Star = {0.7071, 0.5231, 0.4467, 0.4030, 0.3742, 0.3534, 0.3375, 0.3249, 0.3146, 0.3059,
                                       0.2985, 0.2921, 0.2864, 0.2814, 0.2770, 0.2729, 0.2692, 0.2659, 0.2628};
static_assert(kOneOverD2.size() == kGrrRangeMax - 1 && kOneOverD2Star.size() == kGrrRangeMax - 1);

bool crossed(const Crossed& study) {
  return std::min({study.parts, study.appraisers, study.trials}) >= 2 &&
         study.value.size() == study.parts * study.appraisers * study.trials;
}

/// Means over all factors except the named ones.
struct Means {
  double all = 0.0;
  std::vector<double> part;
  std::vector<double> appraiser;
  std::vector<double> cell;  ///< [part * appraisers + appraiser]
};

Means means_of(const Crossed& s) {
  Means means;
  means.part.assign(s.parts, 0.0);
  means.appraiser.assign(s.appraisers, 0.0);
  means.cell.assign(s.parts * s.appraisers, 0.0);
  for (std::size_t p = 0; p < s.parts; ++p)
    for (std::size_t a = 0; a < s.appraisers; ++a) {
      double sum = 0.0;
      for (std::size_t t = 0; t < s.trials; ++t) sum += s.at(p, a, t);
      means.cell[p * s.appraisers + a] = sum / static_cast<double>(s.trials);
      means.part[p] += sum / static_cast<double>(s.appraisers * s.trials);
      means.appraiser[a] += sum / static_cast<double>(s.parts * s.trials);
      means.all += sum / static_cast<double>(s.parts * s.appraisers * s.trials);
    }
  return means;
}

/// True if repeated trials differ. EV does not show it, because pooled with the interaction it is above 0 even if all
/// trials are equal.
bool trials_scatter(const Crossed& study) {
  for (std::size_t i = 0; i < study.parts; ++i)
    for (std::size_t j = 0; j < study.appraisers; ++j)
      for (std::size_t t = 1; t < study.trials; ++t)
        if (study.at(i, j, t) != study.at(i, j, 0)) return true;
  return false;
}

double range_of(const std::vector<double>& values) {
  const auto [low, high] = std::minmax_element(values.begin(), values.end());
  return *high - *low;
}

double root(double variance, bool& zeroed) {
  zeroed = variance < 0.0;
  return zeroed ? 0.0 : std::sqrt(variance);
}

void add_up(Components& c) {
  c.GRR = std::sqrt(c.EV * c.EV + c.AV * c.AV + c.INT * c.INT);
  c.TV = std::sqrt(c.GRR * c.GRR + c.PV * c.PV);
}

AnovaRow row(double ss, double df) {
  AnovaRow row;
  row.ss = ss;
  row.df = df;
  row.ms = ss / df;
  return row;
}

void test_against(AnovaRow& row, const AnovaRow& below) {
  row.f = row.ms / below.ms;
  row.p = fisher_tail(row.f, row.df, below.df);
}

}  // namespace

std::optional<Components> average_range(const Crossed& study) {
  if (!crossed(study) || std::max({study.parts, study.appraisers, study.trials}) > kGrrRangeMax) return std::nullopt;
  const Means means = means_of(study);
  double ranges = 0.0;
  for (std::size_t p = 0; p < study.parts; ++p)
    for (std::size_t a = 0; a < study.appraisers; ++a) {
      std::vector<double> trials;
      for (std::size_t t = 0; t < study.trials; ++t) trials.push_back(study.at(p, a, t));
      ranges += range_of(trials);
    }
  Components c;
  c.EV = ranges / static_cast<double>(study.parts * study.appraisers) * kOneOverD2[study.trials - 2];
  const double apart = range_of(means.appraiser) * kOneOverD2Star[study.appraisers - 2];
  c.AV = root(apart * apart - c.EV * c.EV / static_cast<double>(study.parts * study.trials), c.av_zeroed);
  c.INT = 0.0;
  c.PV = range_of(means.part) * kOneOverD2Star[study.parts - 2];
  add_up(c);
  return c;
}

std::optional<Anova> anova(const Crossed& study, Interaction interaction) {
  if (!crossed(study)) return std::nullopt;
  const auto p = static_cast<double>(study.parts);
  const auto a = static_cast<double>(study.appraisers);
  const auto r = static_cast<double>(study.trials);
  const Means means = means_of(study);
  const auto square = [](double x) { return x * x; };
  // Sums are formed from differences, to avoid cancellation of large numbers.
  double parts = 0.0;
  double appraisers = 0.0;
  double both = 0.0;
  double trials = 0.0;
  double total = 0.0;
  for (const double mean : means.part) parts += a * r * square(mean - means.all);
  for (const double mean : means.appraiser) appraisers += p * r * square(mean - means.all);
  for (std::size_t i = 0; i < study.parts; ++i)
    for (std::size_t j = 0; j < study.appraisers; ++j) {
      const double cell = means.cell[i * study.appraisers + j];
      both += r * square(cell - means.part[i] - means.appraiser[j] + means.all);
      for (std::size_t t = 0; t < study.trials; ++t) {
        trials += square(study.at(i, j, t) - cell);
        total += square(study.at(i, j, t) - means.all);
      }
    }
  Anova result;
  result.part = row(parts, p - 1.0);
  result.appraiser = row(appraisers, a - 1.0);
  result.interaction = row(both, (p - 1.0) * (a - 1.0));
  result.repeatability = row(trials, p * a * (r - 1.0));
  result.pooled = row(both + trials, result.interaction.df + result.repeatability.df);
  result.total = row(total, p * a * r - 1.0);
  test_against(result.interaction, result.repeatability);

  Components& with = result.with_interaction;
  with.EV = std::sqrt(result.repeatability.ms);
  with.INT = root((result.interaction.ms - result.repeatability.ms) / r, with.int_zeroed);
  with.AV = root((result.appraiser.ms - result.interaction.ms) / (p * r), with.av_zeroed);
  with.PV = root((result.part.ms - result.interaction.ms) / (a * r), with.pv_zeroed);
  add_up(with);
  Components& without = result.without_interaction;
  without.EV = std::sqrt(result.pooled.ms);
  without.INT = 0.0;
  without.AV = root((result.appraiser.ms - result.pooled.ms) / (p * r), without.av_zeroed);
  without.PV = root((result.part.ms - result.pooled.ms) / (a * r), without.pv_zeroed);
  add_up(without);

  result.is_pooled =
      interaction == Interaction::pool || (interaction == Interaction::automatic && result.interaction.p > kPoolAbove);
  const AnovaRow& below = result.is_pooled ? result.pooled : result.interaction;
  test_against(result.part, below);
  test_against(result.appraiser, below);
  result.components = result.is_pooled ? without : with;
  return result;
}

GrrJudgement judge(const Crossed& study, const Components& components, double tolerance) {
  GrrJudgement said;
  said.judgement = Judgement::undecided;
  if (study.parts < kGrrPartsMin || study.appraisers < kGrrAppraisersMin || study.trials < kGrrTrialsMin) {
    said.reason = fmt::format("too few: {} parts, {} appraisers, {} trials; {}, {} and {} at least", study.parts,
                              study.appraisers, study.trials, kGrrPartsMin, kGrrAppraisersMin, kGrrTrialsMin);
    return said;
  }
  if (!(components.GRR > 0.0)) {
    said.reason = "no scatter at all: coarse figures, or the same scans taken again";
    return said;
  }
  const bool by_tolerance = has_value(tolerance);
  if (by_tolerance && !usable_tolerance(tolerance)) {
    said.reason = unusable_text(tolerance);
    return said;
  }
  const double percent = by_tolerance ? components.of_tolerance(tolerance) : components.of_variation();
  const char* of = by_tolerance ? "the tolerance" : "the total variation";
  if (percent > 30.0 || (!by_tolerance && std::floor(components.ndc()) < 5.0)) {
    said.judgement = Judgement::not_capable;
    said.reason = percent > 30.0
                      ? fmt::format("{:.1f} % of {}: above 30 %", percent, of)
                      : fmt::format("distinguishes {:.0f} categories, below 5", std::floor(components.ndc()));
  } else if (!trials_scatter(study)) {
    said.reason = "the trials do not scatter at all: coarse figures, or the same scans taken again";
  } else if (percent < 10.0) {
    said.judgement = Judgement::capable;
  } else {
    said.conditional = true;
    said.reason = fmt::format("{:.1f} % of {}: between 10 and 30 %, a decision of people", percent, of);
  }
  return said;
}

}  // namespace slabd::cli::study
