// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <vector>

#include "base/prng.h"
#include "cli/study/grr.h"
#include "cli/study/statistics.h"

namespace slabd::cli::study {
namespace {

TEST(Distributions, agree_with_printed_tables) {
  EXPECT_NEAR(normal_quantile(0.975), 1.959963985, 1e-9);
  EXPECT_NEAR(student_quantile(0.975, 9.0), 2.262157163, 1e-9);
  EXPECT_NEAR(student_quantile(0.95, 1.0), 6.313751515, 1e-8);
  EXPECT_NEAR(chi_squared_quantile(0.975, 9.0), 19.0227678, 1e-7);
  EXPECT_NEAR(chi_squared_quantile(0.025, 9.0), 2.7003895, 1e-7);
  EXPECT_NEAR(student_two_sided(2.262157163, 9.0), 0.05, 1e-9);
  EXPECT_NEAR(fisher_tail(3.325834530, 5.0, 10.0), 0.05, 1e-8);
}

TEST(Distributions, answer_nan_out_of_range_and_throw_nothing) {
  for (const double p : {0.0, 1.0, -0.1, 1.5, kNoValue}) {
    EXPECT_TRUE(std::isnan(normal_quantile(p)));
    EXPECT_TRUE(std::isnan(student_quantile(p, 9.0)));
    EXPECT_TRUE(std::isnan(chi_squared_quantile(p, 9.0)));
  }
  for (const double nu : {0.0, -1.0, kNoValue}) {
    EXPECT_TRUE(std::isnan(student_quantile(0.9, nu)));
    EXPECT_TRUE(std::isnan(student_two_sided(1.0, nu)));
    EXPECT_TRUE(std::isnan(fisher_tail(1.0, nu, 2.0)));
  }
  EXPECT_EQ(student_two_sided(INFINITY, 3.0), 0.0);
  EXPECT_EQ(fisher_tail(INFINITY, 3.0, 3.0), 0.0);
}

TEST(Spread, has_the_wide_confidence_limits_of_ten_values) {
  std::vector<double> values;
  for (int i = 0; i < 10; ++i) values.push_back(1e6 + i);
  const Spread spread = spread_of(values);
  EXPECT_EQ(spread.mean, 1e6 + 4.5);
  EXPECT_EQ(spread.range, 9.0);
  EXPECT_EQ(spread.deviation_max, 4.5);
  EXPECT_NEAR(spread.std, 3.0276503541, 1e-9);
  EXPECT_NEAR(spread.std_low / spread.std, 0.69, 0.005);
  EXPECT_NEAR(spread.std_high / spread.std, 1.83, 0.005);
}

TEST(Spread, has_no_standard_deviation_for_one_value_and_is_empty_for_none) {
  const std::vector<double> one = {3.0};
  EXPECT_EQ(spread_of(one).range, 0.0);
  EXPECT_TRUE(std::isnan(spread_of(one).std));
  EXPECT_EQ(spread_of({}).count, 0U);
  EXPECT_TRUE(std::isnan(spread_of({}).mean));
}

/// AIAG-type set of ten values about 10.
const std::vector<double> kTen = {10.00, 10.01, 9.99, 10.02, 10.00, 9.98, 10.01, 10.00, 9.99, 10.01};

TEST(Type1, gives_the_reference_figures) {
  const Spread spread = spread_of(kTen);
  EXPECT_NEAR(spread.std, 0.011972190, 5e-10);
  const Gauge gauge = type_1(spread, 0, 10.0, 0.5);
  EXPECT_NEAR(gauge.cg, 1.392115, 5e-7);
  EXPECT_NEAR(gauge.cgk, 1.364273, 5e-7);
  // T 1, s 0.01, bias 0.02, fifty runs.
  Spread fifty;
  fifty.count = 50;
  fifty.mean = 5.02;
  fifty.std = 0.01;
  fifty.std_low = 0.0084;
  fifty.std_high = 0.0125;
  const Gauge other = type_1(fifty, 0, 5.0, 1.0);
  EXPECT_NEAR(other.cg, 3.3333, 5e-5);
  EXPECT_NEAR(other.cgk, 2.6667, 5e-5);
  EXPECT_EQ(other.judgement, Judgement::capable);
}

TEST(Type1, tells_a_bias_from_chance) {
  const Gauge none = type_1(spread_of(kTen), 0, 10.0, 0.5);
  EXPECT_NEAR(none.t, 0.001 / (0.011972190 / std::sqrt(10.0)), 1e-4);
  EXPECT_FALSE(none.biased());
  EXPECT_LT(none.bias_low, 0.0);
  EXPECT_GT(none.bias_high, 0.0);
  const Gauge some = type_1(spread_of(kTen), 0, 9.98, 0.5);
  EXPECT_TRUE(some.biased());
  EXPECT_GT(some.bias_low, 0.0);
}

std::vector<double> normal_values(std::uint64_t seed, std::size_t count, double mean, double sigma) {
  Prng prng(seed);
  std::vector<double> values;
  for (std::size_t i = 0; i < count; ++i) values.push_back(mean + sigma * prng.normal());
  return values;
}

TEST(Type1, calls_nothing_capable_from_too_few_runs_or_with_one_missing) {
  const std::vector<double> fifty = normal_values(1, 50, 10.0, 0.001);
  EXPECT_EQ(type_1(spread_of(fifty), 0, 10.0, 0.5).judgement, Judgement::capable);
  EXPECT_EQ(type_1(spread_of(fifty), 1, 10.0, 0.5).judgement, Judgement::undecided);
  const std::vector<double> fewer(fifty.begin(), fifty.end() - 1);
  const Gauge few = type_1(spread_of(fewer), 0, 10.0, 0.5);
  EXPECT_EQ(few.judgement, Judgement::undecided);
  EXPECT_EQ(few.reason, "too few runs: 49 of 50");
  const std::vector<double> one = {10.0};
  EXPECT_EQ(type_1(spread_of(one), 0, 10.0, 0.5).judgement, Judgement::undecided);
  EXPECT_EQ(type_1(spread_of({}), 50, 10.0, 0.5).judgement, Judgement::undecided);
}

TEST(Type1, judges_nothing_without_a_reference_and_decides_nothing_without_a_tolerance) {
  const Spread spread = spread_of(normal_values(1, 50, 10.0, 0.001));
  EXPECT_EQ(type_1(spread, 0, kNoValue, 0.5).judgement, Judgement::not_judged);
  const Gauge no_width = type_1(spread, 0, 10.0, kNoValue);
  EXPECT_EQ(no_width.judgement, Judgement::undecided);
  EXPECT_EQ(no_width.reason, "no tolerance: it has no two limits");
  EXPECT_TRUE(has_value(no_width.bias)) << "which needs none";
  const Gauge never = type_1(spread_of({}), 50, 10.0, kNoValue);
  EXPECT_EQ(never.judgement, Judgement::undecided);
  EXPECT_EQ(never.reason, "not measured in 50 of 50 runs");
  EXPECT_TRUE(has_value(type_1(spread, 0, kNoValue, 0.5).cg));
}

TEST(Type1, values_that_are_all_the_same_prove_nothing) {
  const std::vector<double> same(60, 0.1);
  const Gauge gauge = type_1(spread_of(same), 0, 0.1, 0.5);
  EXPECT_EQ(gauge.judgement, Judgement::undecided);
  EXPECT_TRUE(std::isnan(gauge.cg));
  EXPECT_TRUE(std::isnan(gauge.cgk));
}

TEST(Type1, says_no_early_when_more_runs_cannot_help) {
  EXPECT_EQ(type_1(spread_of(normal_values(2, 10, 10.0, 0.1)), 0, 10.0, 0.5).judgement, Judgement::not_capable);
  EXPECT_EQ(type_1(spread_of(normal_values(2, 50, 10.04, 0.004)), 0, 10.0, 0.5).judgement, Judgement::not_capable)
      << "no scatter to speak of, but biased";
}

// ---- gauge R&R -----------------------------------------------------------------------------------------------------

/// The data set of AIAG's handbook: ten parts, appraisers A, B, C, three trials each.
Crossed aiag() {
  const double rows[9][10] = {{.29, -.56, 1.34, .47, -.80, .02, .59, -.31, 2.26, -1.36},
                              {.41, -.68, 1.17, .50, -.92, -.11, .75, -.20, 1.99, -1.25},
                              {.64, -.58, 1.27, .64, -.84, -.21, .66, -.17, 2.01, -1.31},
                              {.08, -.47, 1.19, .01, -.56, -.20, .47, -.63, 1.80, -1.68},
                              {.25, -1.22, .94, 1.03, -1.20, .22, .55, .08, 2.12, -1.62},
                              {.07, -.68, 1.34, .20, -1.28, .06, .83, -.34, 2.19, -1.50},
                              {.04, -1.38, .88, .14, -1.46, -.29, .02, -.46, 1.77, -1.49},
                              {-.11, -1.13, 1.09, .20, -1.07, -.67, .01, -.56, 1.45, -1.77},
                              {-.15, -.96, .67, .11, -1.45, -.49, .21, -.49, 1.87, -2.16}};
  Crossed study{10, 3, 3, std::vector<double>(90)};
  for (std::size_t a = 0; a < 3; ++a)
    for (std::size_t t = 0; t < 3; ++t)
      for (std::size_t p = 0; p < 10; ++p) study.value[(p * 3 + a) * 3 + t] = rows[a * 3 + t][p];
  return study;
}

TEST(Grr, average_range_gives_the_reference_figures) {
  const auto c = average_range(aiag());
  ASSERT_TRUE(c.has_value());
  EXPECT_NEAR(c->EV, 0.20186, 5e-6);
  EXPECT_NEAR(c->AV, 0.22967, 5e-6);
  EXPECT_NEAR(c->GRR, 0.30577, 5e-6);
  EXPECT_NEAR(c->PV, 1.10460, 5e-6);
  EXPECT_NEAR(c->TV, 1.14613, 5e-6);
  EXPECT_NEAR(c->of_variation(), 26.68, 0.005);
  EXPECT_NEAR(c->ndc(), 5.09, 0.005);
}

TEST(Grr, anova_gives_the_reference_figures) {
  const auto a = anova(aiag());
  ASSERT_TRUE(a.has_value());
  EXPECT_NEAR(a->appraiser.ss, 3.167262, 5e-7);
  EXPECT_NEAR(a->part.ss, 88.361934, 5e-7);
  EXPECT_NEAR(a->interaction.ss, 0.358982, 5e-7);
  EXPECT_NEAR(a->repeatability.ss, 2.758933, 5e-7);
  EXPECT_NEAR(a->interaction.f, 0.4337, 5e-5);
  EXPECT_NEAR(a->interaction.p, 0.974, 5e-4);
  EXPECT_TRUE(a->is_pooled);
  EXPECT_NEAR(a->components.EV, 0.199933, 5e-7);
  EXPECT_NEAR(a->components.AV, 0.226838, 5e-7);
  EXPECT_NEAR(a->components.GRR, 0.302372, 5e-7);
  EXPECT_NEAR(a->components.PV, 1.042327, 5e-7);
  EXPECT_NEAR(a->components.TV, 1.085300, 5e-7);
  EXPECT_NEAR(a->components.of_variation(), 27.86, 0.005);
  EXPECT_NEAR(a->components.ndc(), 4.86, 0.005);
}

TEST(Grr, sums_of_squares_add_up_and_freedoms_too) {
  const auto a = anova(aiag());
  ASSERT_TRUE(a.has_value());
  EXPECT_NEAR(a->part.ss + a->appraiser.ss + a->interaction.ss + a->repeatability.ss, a->total.ss, 1e-9);
  EXPECT_EQ(a->part.df + a->appraiser.df + a->interaction.df + a->repeatability.df, a->total.df);
  EXPECT_EQ(a->pooled.df, a->interaction.df + a->repeatability.df);
}

Crossed drawn(Prng& prng, std::size_t parts, std::size_t appraisers, std::size_t trials, double ev, double av,
              double inter, double pv) {
  Crossed study{parts, appraisers, trials, {}};
  std::vector<double> of_appraiser;
  for (std::size_t a = 0; a < appraisers; ++a) of_appraiser.push_back(av * prng.normal());
  for (std::size_t p = 0; p < parts; ++p) {
    const double part = pv * prng.normal();
    for (std::size_t a = 0; a < appraisers; ++a) {
      const double both = inter * prng.normal();
      for (std::size_t t = 0; t < trials; ++t)
        study.value.push_back(1000.0 + part + of_appraiser[a] + both + ev * prng.normal());
    }
  }
  return study;
}

TEST(Grr, anova_finds_planted_variances_with_an_interaction) {
  Prng prng(7);
  double ev = 0.0;
  double av = 0.0;
  double inter = 0.0;
  double pv = 0.0;
  constexpr int kStudies = 400;
  int kept = 0;
  for (int i = 0; i < kStudies; ++i) {
    const auto a = anova(drawn(prng, 10, 8, 3, 0.1, 0.3, 0.2, 1.0));
    ASSERT_TRUE(a.has_value());
    kept += a->is_pooled ? 0 : 1;
    ev += a->with_interaction.EV * a->with_interaction.EV / kStudies;
    av += a->with_interaction.AV * a->with_interaction.AV / kStudies;
    inter += a->with_interaction.INT * a->with_interaction.INT / kStudies;
    pv += a->with_interaction.PV * a->with_interaction.PV / kStudies;
  }
  EXPECT_EQ(kept, kStudies) << "such an interaction is significant";
  EXPECT_NEAR(ev, 0.01, 0.0005);
  EXPECT_NEAR(inter, 0.04, 0.002);
  EXPECT_NEAR(av, 0.09, 0.01);
  EXPECT_NEAR(pv, 1.0, 0.08);
}

TEST(Grr, pools_as_told_and_says_which_variance_was_negative) {
  EXPECT_FALSE(anova(aiag(), Interaction::keep)->is_pooled);
  EXPECT_TRUE(anova(aiag(), Interaction::keep)->components.int_zeroed) << "F below 1";
  EXPECT_TRUE(anova(aiag(), Interaction::pool)->is_pooled);
}

TEST(Grr, needs_two_of_everything_and_all_its_values) {
  Prng prng(1);
  EXPECT_FALSE(anova(drawn(prng, 1, 3, 3, 1, 1, 1, 1)).has_value());
  EXPECT_FALSE(anova(drawn(prng, 10, 1, 3, 1, 1, 1, 1)).has_value());
  EXPECT_FALSE(average_range(drawn(prng, 10, 3, 1, 1, 1, 1, 1)).has_value());
  EXPECT_FALSE(average_range(drawn(prng, 21, 3, 2, 1, 1, 1, 1)).has_value()) << "no factor for 21";
  EXPECT_TRUE(average_range(drawn(prng, 20, 3, 2, 1, 1, 1, 1)).has_value());
  Crossed torn = aiag();
  torn.value.pop_back();
  EXPECT_FALSE(anova(torn).has_value());
}

TEST(Grr, is_judged_by_the_tolerance_where_there_is_one) {
  const Crossed study = aiag();
  const Components c = anova(study)->components;
  EXPECT_EQ(judge(study, c, 6.0 * c.GRR / 0.099).judgement, Judgement::capable);
  const GrrJudgement between = judge(study, c, 6.0 * c.GRR / 0.2);
  EXPECT_EQ(between.judgement, Judgement::undecided);
  EXPECT_TRUE(between.conditional);
  EXPECT_EQ(judge(study, c, 6.0 * c.GRR / 0.31).judgement, Judgement::not_capable);
  EXPECT_EQ(judge(study, c, kNoValue).judgement, Judgement::not_capable) << "ndc 4.86 is four categories";
  Crossed few = study;
  few.parts = 9;
  few.value.resize(81);
  EXPECT_EQ(judge(few, c, 1000.0).judgement, Judgement::undecided);
  EXPECT_EQ(judge(study, Components{}, 1.0).judgement, Judgement::undecided);
}

TEST(Grr, trials_that_are_copies_prove_no_repeatability) {
  Prng prng(3);
  const Crossed study = drawn(prng, 10, 3, 2, 0.0, 0.01, 0.01, 1.0);
  for (const Interaction interaction : {Interaction::keep, Interaction::pool, Interaction::automatic}) {
    const Components c = anova(study, interaction)->components;
    ASSERT_GT(c.GRR, 0.0);
    const GrrJudgement judged = judge(study, c, 1000.0);
    EXPECT_EQ(judged.judgement, Judgement::undecided);
    EXPECT_FALSE(judged.conditional);
    EXPECT_NE(judged.reason.find("do not scatter"), std::string::npos) << judged.reason;
    EXPECT_EQ(judge(study, c, c.GRR).judgement, Judgement::not_capable) << "the appraisers alone are too far apart";
  }
}

TEST(Grr, like_type_1_is_undecided_for_a_tolerance_without_positive_width) {
  const Crossed study = aiag();
  const Components c = anova(study)->components;
  const Spread spread = spread_of(normal_values(1, 50, 10.0, 0.001));
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  for (const double tolerance : {-1000.0, -1e-9, 0.0, kInfinity, -kInfinity}) {
    const GrrJudgement judged = judge(study, c, tolerance);
    EXPECT_EQ(judged.judgement, Judgement::undecided) << tolerance;
    EXPECT_FALSE(judged.conditional);
    EXPECT_NE(judged.reason.find("no width above 0"), std::string::npos) << judged.reason;
    const Gauge gauge = type_1(spread, 0, 10.0, tolerance);
    EXPECT_EQ(gauge.judgement, Judgement::undecided) << tolerance;
    EXPECT_TRUE(std::isnan(gauge.cg)) << tolerance;
    EXPECT_NE(gauge.reason.find("no width above 0"), std::string::npos) << gauge.reason;
  }
}

// ---- agreement -----------------------------------------------------------------------------------------------------

std::vector<Pair> pairs_of(std::uint64_t seed, std::size_t count, double slope, double intercept, double x_sigma,
                           double y_sigma, double U_x = kNoValue, double U_y = kNoValue) {
  Prng prng(seed);
  std::vector<Pair> pairs;
  for (std::size_t i = 0; i < count; ++i) {
    const double truth = 10.0 * prng.uniform();
    pairs.push_back({truth + x_sigma * prng.normal(), intercept + slope * truth + y_sigma * prng.normal(), U_x, U_y});
  }
  return pairs;
}

TEST(Agreement, errors_of_a_worked_example) {
  const std::vector<Pair> pairs = {{1.0, 1.1, 0.2, 0.1}, {2.0, 1.8, 0.2, 0.1}, {3.0, 3.4, kNoValue, 0.1}};
  const Errors errors = errors_of(pairs);
  EXPECT_EQ(errors.count, 3U);
  EXPECT_NEAR(errors.mean.value, 0.1, 1e-12);
  EXPECT_NEAR(errors.mean_abs, 0.7 / 3.0, 1e-12);
  EXPECT_NEAR(errors.max_abs, 0.4, 1e-12);
  EXPECT_EQ(errors.worst, 2U);
  EXPECT_NEAR(errors.rms, std::sqrt(0.21 / 3.0), 1e-12);
  EXPECT_NEAR(errors.std, 0.3, 1e-12);
  EXPECT_EQ(errors.en_count, 2U);
  EXPECT_NEAR(errors.en_max, 0.2 / std::sqrt(0.05), 1e-12);
  EXPECT_TRUE(std::isnan(errors_of({}).max_abs));
  EXPECT_TRUE(std::isnan(errors_of(std::span(pairs).first(1)).mean.low));
}

TEST(Agreement, limits_of_a_worked_example) {
  const std::vector<Pair> pairs = {
      {0.0, 1.0, kNoValue, kNoValue}, {5.0, 7.0, kNoValue, kNoValue}, {7.0, 10.0, kNoValue, kNoValue}};
  const AgreementLimits limits = agreement_limits(pairs);
  EXPECT_NEAR(limits.lower.value, 0.04, 1e-12);
  EXPECT_NEAR(limits.upper.value, 3.96, 1e-12);
  EXPECT_NEAR(limits.upper.high - limits.upper.value, 4.302652730 * std::sqrt(1.0 / 3.0 + 1.96 * 1.96 / 4.0), 1e-6);
  EXPECT_TRUE(std::isnan(agreement_limits(std::span(pairs).first(2)).lower.value));
}

TEST(Agreement, limits_hold_the_differences_that_they_promise) {
  int inside = 0;
  constexpr int kSeries = 200;
  for (int seed = 1; seed <= kSeries; ++seed) {
    const AgreementLimits limits = agreement_limits(pairs_of(static_cast<std::uint64_t>(seed), 40, 1.0, 0.5, 0.0, 1.0));
    // The true upper limit is 0.5 + 1.96.
    inside += limits.upper.low < 2.46 && 2.46 < limits.upper.high ? 1 : 0;
  }
  EXPECT_GE(inside, 180) << "of 200; 95 % are promised";
}

TEST(Agreement, deming_is_the_least_weighted_distance) {
  const std::vector<Pair> pairs = pairs_of(5, 30, 1.2, -0.3, 0.5, 0.5, 1.0, 0.7);
  const Regression line = deming(pairs);
  ASSERT_TRUE(line.ok) << line.why_not;
  EXPECT_TRUE(line.ratio_from_U);
  EXPECT_NEAR(line.ratio, 0.49, 1e-12);
  const auto cost = [&](double slope, double intercept) {
    double sum = 0.0;
    for (const Pair& pair : pairs) {
      const double off = pair.value - intercept - slope * pair.reference;
      sum += off * off / (line.ratio + slope * slope);
    }
    return sum;
  };
  const double best = cost(line.slope.value, line.intercept.value);
  for (const double slope : {-1e-3, 0.0, 1e-3})
    for (const double intercept : {-1e-2, 0.0, 1e-2})
      EXPECT_GE(cost(line.slope.value + slope, line.intercept.value + intercept), best);
}

TEST(Agreement, deming_becomes_least_squares_when_the_reference_is_exact) {
  const std::vector<Pair> pairs = pairs_of(6, 30, 0.9, 2.0, 0.0, 0.5, 1e-6, 1.0);
  double x = 0.0;
  double y = 0.0;
  for (const Pair& pair : pairs) {
    x += pair.reference / 30.0;
    y += pair.value / 30.0;
  }
  double xx = 0.0;
  double xy = 0.0;
  for (const Pair& pair : pairs) {
    xx += (pair.reference - x) * (pair.reference - x);
    xy += (pair.reference - x) * (pair.value - y);
  }
  EXPECT_NEAR(deming(pairs).slope.value, xy / xx, 1e-9);
}

TEST(Agreement, deming_intervals_cover_the_line) {
  int slopes = 0;
  int intercepts = 0;
  constexpr int kSeries = 300;
  for (int seed = 1; seed <= kSeries; ++seed) {
    const Regression line = deming(pairs_of(static_cast<std::uint64_t>(seed), 25, 1.0, 0.2, 0.3, 0.3));
    slopes += line.slope.low < 1.0 && 1.0 < line.slope.high ? 1 : 0;
    intercepts += line.intercept.low < 0.2 && 0.2 < line.intercept.high ? 1 : 0;
  }
  EXPECT_GE(slopes, 270) << "of 300; 95 % are promised";
  EXPECT_LE(slopes, 297) << "wider than they need be";
  EXPECT_GE(intercepts, 270);
  EXPECT_LE(intercepts, 297);
}

TEST(Agreement, a_line_through_one_cloud_is_refused) {
  Prng prng(3);
  std::vector<Pair> pairs;
  for (int i = 0; i < 30; ++i)
    pairs.push_back({1.432 + 0.001 * prng.normal(), 1.432 + 0.001 * prng.normal(), kNoValue, kNoValue});
  EXPECT_FALSE(deming(pairs).ok);
  EXPECT_FALSE(deming(std::span(pairs).first(4)).ok);
  std::vector<Pair> exact;
  for (int i = 0; i < 5; ++i) exact.push_back({1.0 * i, 2.0 * i + 1.0, kNoValue, kNoValue});
  const Regression line = deming(exact);
  ASSERT_TRUE(line.ok) << line.why_not;
  EXPECT_NEAR(line.slope.value, 2.0, 1e-12);
  EXPECT_NEAR(line.intercept.value, 1.0, 1e-12);
}

}  // namespace
}  // namespace slabd::cli::study
