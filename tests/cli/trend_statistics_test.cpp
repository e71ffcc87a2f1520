// SPDX-License-Identifier: Apache-2.0
#include "cli/trend/statistics.h"

#include <gtest/gtest.h>

#include <cmath>
#include <cstdlib>
#include <ctime>
#include <vector>

#include "base/prng.h"
#include "cli/terminal/parse.h"
#include "cli/trend/distribution.h"

namespace slabd::cli::trend {
namespace {

std::vector<double> normal_values(Prng& prng, std::size_t count, double mean, double sigma) {
  std::vector<double> values;
  for (std::size_t i = 0; i < count; ++i) values.push_back(mean + sigma * prng.normal());
  return values;
}

TEST(Individuals, limits_of_a_worked_example) {
  // Moving ranges 2, 1, 3, 2: mean 2.
  const std::vector<double> values = {10.0, 12.0, 11.0, 14.0, 12.0};
  const Individuals chart = individuals(values);
  EXPECT_DOUBLE_EQ(chart.mean, 11.8);
  EXPECT_DOUBLE_EQ(chart.moving_range, 2.0);
  EXPECT_NEAR(chart.sigma, 2.0 / 1.128, 1e-12);
  EXPECT_NEAR(chart.upper_control, 11.8 + 2.66 * 2.0, 1e-3);
  EXPECT_NEAR(chart.range_control, 3.267 * 2.0, 1e-12);
  EXPECT_TRUE(chart.preliminary());
}

TEST(Individuals, have_no_limits_for_one_value_or_none) {
  EXPECT_EQ(individuals({}).count, 0U);
  const std::vector<double> one = {3.0};
  const Individuals chart = individuals(one);
  EXPECT_EQ(chart.mean, 3.0);
  EXPECT_TRUE(std::isnan(chart.sigma));
  EXPECT_TRUE(std::isnan(chart.upper_control));
}

TEST(Individuals, signal_an_outlier_and_a_shift_but_not_while_preliminary) {
  Prng prng(3);
  std::vector<double> values = normal_values(prng, 60, 0.0, 1.0);
  values[30] = 9.0;
  Individuals chart = individuals(values);
  EXPECT_EQ(chart.signals[30], Signal::beyond_limits);
  for (std::size_t i = 40; i < 60; ++i) values[i] = 1.2 + 0.01 * prng.normal();
  chart = individuals(values);
  EXPECT_EQ(chart.signals[47], Signal::none);
  EXPECT_EQ(chart.signals[48], Signal::nine_on_one_side) << "the ninth value after the shift";
  const std::vector<double> few(values.begin() + 20, values.begin() + 40);
  for (const Signal signal : individuals(few).signals) EXPECT_EQ(signal, Signal::none);
}

TEST(Capability, is_not_stated_from_few_values_without_limits_or_without_scatter) {
  Prng prng(4);
  EXPECT_FALSE(has_value(capability(individuals(normal_values(prng, 24, 0.0, 1.0)), -5.0, 5.0).cpk.value));
  const Individuals enough = individuals(normal_values(prng, 25, 0.0, 1.0));
  EXPECT_TRUE(has_value(capability(enough, -5.0, 5.0).cpk.value));
  EXPECT_FALSE(has_value(capability(enough, kNoValue, kNoValue).cpk.value));
  const std::vector<double> same(30, 1.0);
  EXPECT_FALSE(has_value(capability(individuals(same), -5.0, 5.0).cpk.value));
}

TEST(Capability, has_no_cp_for_a_one_sided_item) {
  Prng prng(5);
  const Capability c = capability(individuals(normal_values(prng, 100, 0.1, 0.1)), kNoValue, 1.0);
  EXPECT_FALSE(has_value(c.cp.value));
  EXPECT_NEAR(c.cpk.value, 3.0, 0.8);
}

// An interval must contain the true value with its stated probability.
TEST(Capability, intervals_hold_the_true_index_95_times_of_100) {
  Prng prng(6);
  constexpr int kTrials = 4000;
  // sigma 1, limits -4.5 .. 4: Cp = 8.5 / 6, Cpk = 4 / 3.
  int cp_held = 0;
  int cpk_held = 0;
  for (int i = 0; i < kTrials; ++i) {
    const Capability c = capability(individuals(normal_values(prng, 60, 0.0, 1.0)), -4.5, 4.0);
    if (c.cp.low <= 8.5 / 6.0 && 8.5 / 6.0 <= c.cp.high) ++cp_held;
    if (c.cpk.low <= 4.0 / 3.0 && 4.0 / 3.0 <= c.cpk.high) ++cpk_held;
  }
  EXPECT_NEAR(cp_held, 0.95 * kTrials, 0.015 * kTrials);
  EXPECT_NEAR(cpk_held, 0.95 * kTrials, 0.015 * kTrials);
}

TEST(Normality, rejects_skewness_two_heaps_and_one_far_value_and_needs_values_that_differ) {
  Prng prng(10);
  const std::vector<double> good = normal_values(prng, 200, 0.0, 1.0);
  EXPECT_GT(normality(good), 0.05);
  std::vector<double> skewed;
  std::vector<double> heaps;
  for (std::size_t i = 0; i < good.size(); ++i) {
    skewed.push_back(std::exp(good[i]));
    heaps.push_back(good[i] + (i % 2 == 0 ? 3.0 : -3.0));
  }
  std::vector<double> far = good;
  far[17] = 9.0;
  for (const std::vector<double>& values : {skewed, heaps, far}) EXPECT_LT(normality(values), 1e-6);
  EXPECT_FALSE(has_value(normality(std::vector<double>(19, 1.0)))) << "too few";
  EXPECT_FALSE(has_value(normality(std::vector<double>(30, 1.0)))) << "without scatter";
}

// Skewness and kurtosis of one sample depend on each other, so the test rejects somewhat more often than its level.
TEST(Normality, rejects_a_normal_sample_rarely) {
  Prng prng(11);
  constexpr int kTrials = 3000;
  int rejected = 0;
  for (int i = 0; i < kTrials; ++i) rejected += normality(normal_values(prng, 100, 3.0, 0.2)) < kFitLevel ? 1 : 0;
  EXPECT_GT(rejected, kFitLevel * kTrials);
  EXPECT_LT(rejected, 3.0 * kFitLevel * kTrials);
}

TEST(Performance, a_weibull_sample_has_the_index_of_the_weibull) {
  Prng prng(12);
  std::vector<double> values;
  for (int i = 0; i < 2000; ++i) values.push_back(2.0 * std::pow(-std::log(1.0 - prng.uniform()), 1.0 / 1.5));
  const Performance of = performance(values, kNoValue, 8.0, true, kValuesMin);
  EXPECT_EQ(of.model, Model::weibull);
  // The true share above 8 is exp(-(8 / 2)^1.5) = exp(-8) = 3.35e-4, a normal quantile of 3.402.
  EXPECT_NEAR(of.ppk.value, 3.402 / 3.0, 0.08);
  EXPECT_LT(of.ppk.low, 3.402 / 3.0);
  EXPECT_GT(of.ppk.high, 3.402 / 3.0);
}

TEST(Performance, few_values_have_a_share_outside_and_no_index) {
  const std::vector<double> values = {1.0, 2.0, 9.0};
  const Performance of = performance(values, 0.0, 5.0, false, kValuesMin);
  EXPECT_EQ(of.outside.count, 1U);
  EXPECT_NEAR(of.outside.share.value, 1.0 / 3.0, 1e-12);
  EXPECT_FALSE(has_value(of.ppk.value));
  EXPECT_FALSE(has_value(performance(values, kNoValue, kNoValue, false, 2).outside.share.value)) << "no limits";
}

// Clopper and Pearson's interval of 3 of 20 in tables: 0.0321 .. 0.3789; of 0 of 60 the upper end 1 - 0.025^(1/60).
TEST(Share, has_the_exact_interval) {
  const study::Estimate share = study::share_of(3, 20);
  EXPECT_DOUBLE_EQ(share.value, 0.15);
  EXPECT_NEAR(share.low, 0.0321, 5e-5);
  EXPECT_NEAR(share.high, 0.3789, 5e-5);
  EXPECT_EQ(study::share_of(0, 60).low, 0.0);
  EXPECT_NEAR(study::share_of(0, 60).high, 1.0 - std::pow(0.025, 1.0 / 60.0), 1e-9);
  EXPECT_EQ(study::share_of(60, 60).high, 1.0);
  EXPECT_FALSE(has_value(study::share_of(0, 0).value));
}

std::vector<Placed> slabs_with(Prng& prng, int slabs, int odd_station, double bias, double drift) {
  std::vector<Placed> values;
  for (int slab = 1; slab <= slabs; ++slab) {
    const double common = prng.normal();  // a common offset of the slab is not a fault of a station
    for (int station = 1; station <= 18; ++station) {
      double value = common + 0.1 * prng.normal();
      if (station == odd_station) value += bias + drift * slab / slabs;
      values.push_back({slab, station, value});
    }
  }
  return values;
}

TEST(StationBias, finds_the_station_that_is_off_and_the_one_that_drifts_and_no_other) {
  Prng prng(7);
  for (const StationBias& s : station_biases(slabs_with(prng, 100, 5, 0.15, 0.0))) {
    EXPECT_EQ(s.biased(), s.station == 5) << s.station << " " << s.bias;
    EXPECT_FALSE(s.drifting()) << s.station;
    if (s.station == 5) {
      EXPECT_NEAR(s.bias, 0.15, 0.04);
    }
  }
  for (const StationBias& s : station_biases(slabs_with(prng, 100, 12, 0.0, 0.3))) {
    EXPECT_EQ(s.drifting(), s.station == 12) << s.station << " " << s.drift;
    if (s.station == 12) {
      EXPECT_NEAR(s.drift, 0.3, 0.12);
    }
  }
}

TEST(StationBias, at_one_station_far_off_does_not_affect_the_others) {
  Prng prng(9);
  for (const StationBias& s : station_biases(slabs_with(prng, 100, 11, 5.0, 0.0)))
    EXPECT_EQ(s.biased(), s.station == 11);
}

TEST(StationBias, says_nothing_of_few_slabs_and_leaves_out_slabs_of_two_stations) {
  Prng prng(8);
  for (const StationBias& s : station_biases(slabs_with(prng, 24, 5, 5.0, 0.0))) EXPECT_FALSE(s.biased());
  const std::vector<Placed> two = {{1, 1, 0.0}, {1, 2, 9.0}};
  EXPECT_TRUE(station_biases(two).empty());
}

TEST(Sparkline, shows_the_newest_values_from_lowest_to_highest) {
  const std::vector<double> values = {99.0, 0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0};
  EXPECT_EQ(sparkline(values, 8, true), "▁▂▃▄▅▆▇█");
  EXPECT_EQ(sparkline(values, 8, false), "_.-~=+*#");
  const std::vector<double> gap = {1.0, kNoValue, 1.0};
  EXPECT_EQ(sparkline(gap, 8, false), "= =");
  EXPECT_EQ(sparkline({}, 8, true), "");
}

/// Time zone of this process while the object lives.
class TimeZone {
 public:
  explicit TimeZone(const char* name) { set(name); }
  ~TimeZone() { set("UTC0"); }
  TimeZone(const TimeZone&) = delete;
  TimeZone& operator=(const TimeZone&) = delete;

 private:
  static void set(const char* name) {
    ::setenv("TZ", name, 1);
    ::tzset();
  }
};

TEST(ParseTime, a_day_begins_at_midnight_of_the_time_zone) {
  const TimeZone zone("CST-8");
  EXPECT_EQ(parse_time("2025-11-21", 0).value(), parse_time("2025-11-20T16:00:00Z", 0).value());
}

TEST(ParseTime, knows_days_seconds_and_ages) {
  const TimeZone zone("UTC0");
  constexpr std::int64_t kNow = 1'763'683'200'000'000;  // 2025-11-21T00:00:00Z
  EXPECT_EQ(parse_time("2025-11-21", 0).value(), kNow);
  EXPECT_EQ(parse_time("2025-11-21T00:00:01Z", 0).value(), kNow + 1'000'000);
  EXPECT_EQ(parse_time("2d", kNow).value(), parse_time("2025-11-19", 0).value());
  EXPECT_EQ(parse_time("30m", kNow).value(), kNow - 1'800'000'000);
  for (const char* wrong : {"", "d", "7", "7w", "-7d", "2025-02-30", "2025-11-21T25:00:00Z", "2025-11-21 00:00:00",
                            "yesterday", "99999999999999999999d", "2025-1-1"})
    EXPECT_FALSE(parse_time(wrong, kNow).ok()) << wrong;
}

}  // namespace
}  // namespace slabd::cli::trend
