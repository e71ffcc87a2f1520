// SPDX-License-Identifier: Apache-2.0
#include "calib/warm_up.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "base/prng.h"

namespace slabd::calib {
namespace {

constexpr double kEvery_s = 60.0;
constexpr double kHour_s = 3'600.0;

/// A scanner whose centre moves by `moved_um(time_s)` along one direction and whose radius grows by `grown_um(time_s)`.
struct Drift {
  std::function<double(double)> moved_um;
  std::function<double(double)> grown_um;
  double noise_um = 1.0;  ///< of one view: per axis, and of the radius
};

std::vector<WarmUpView> views_of(const Drift& drift, std::uint64_t seed, std::size_t count) {
  Prng prng(seed);
  const Vec3 direction(0.6, -0.48, 0.64);
  std::vector<WarmUpView> views;
  for (std::size_t i = 0; i < count; ++i) {
    const double time_s = kEvery_s * static_cast<double>(i);
    const Vec3 noise(prng.normal(), prng.normal(), prng.normal());
    WarmUpView view;
    view.time_s = time_s;
    view.centre_mm = Vec3(1'500.0, 200.0, 900.0) + 1e-3 * (drift.moved_um(time_s) * direction + drift.noise_um * noise);
    view.radius_mm = 19.05 + 1e-3 * (drift.grown_um(time_s) + drift.noise_um * prng.normal());
    views.push_back(view);
  }
  return views;
}

WarmUpReport examined(std::span<const WarmUpView> views, const WarmUpSettings& settings = {}) {
  const Result<WarmUpReport> report = examine_warm_up(views, settings);
  EXPECT_TRUE(report.ok());
  return report.ok() ? report.value() : WarmUpReport{};
}

/// Time of the view after which the scanner is first called stable, as `slabctl scanner warm-up` looks after each view.
std::optional<double> stable_after_s(const Drift& drift, std::uint64_t seed, std::size_t count) {
  const std::vector<WarmUpView> views = views_of(drift, seed, count);
  for (std::size_t n = 1; n <= views.size(); ++n)
    if (examined(std::span(views).first(n)).state == WarmUpState::stable) return views[n - 1].time_s;
  return std::nullopt;
}

Drift still(double noise_um) {
  return {[](double) { return 0.0; }, [](double) { return 0.0; }, noise_um};
}

TEST(WarmUp, needs_enough_views_over_enough_time) {
  const std::vector<WarmUpView> views = views_of(still(0.1), 1, 20);
  EXPECT_EQ(examined({}).state, WarmUpState::few_views);
  EXPECT_EQ(examined(std::span(views).first(5)).state, WarmUpState::few_views);
  EXPECT_EQ(examined(std::span(views).first(5)).views, 5U);
  const WarmUpReport soon = examined(std::span(views).first(10));
  EXPECT_EQ(soon.state, WarmUpState::short_time);
  EXPECT_EQ(soon.window_s, 540.0);
  EXPECT_TRUE(std::isnan(soon.centre_speed_um_per_h));
  EXPECT_EQ(examined(std::span(views).first(11)).state, WarmUpState::stable);
}

TEST(WarmUp, slopes_and_standard_errors_are_those_of_least_squares) {
  // Values 0 1 2 4 at times 0 1 2 3 hours: slope 1.3, residuals -0.2 ... with sum of squares 0.3, s^2 = 0.15, Sxx = 5.
  std::vector<WarmUpView> views;
  const double values_um[] = {0.0, 1.0, 2.0, 4.0};
  for (int i = 0; i < 4; ++i) views.push_back({kHour_s * i, Vec3(0.0, 1e-3 * values_um[i], 5.0), 20.0});
  WarmUpSettings settings;
  settings.views_min = 4;
  const WarmUpReport report = examined(views, settings);
  EXPECT_NEAR(report.centre_um_per_h.y(), 1.3, 1e-9);
  EXPECT_NEAR(report.centre_speed_um_per_h, 1.3, 1e-9);
  EXPECT_NEAR(report.centre_sigma_um_per_h, std::sqrt(0.15 / 5.0), 1e-6);
  EXPECT_NEAR(report.radius_um_per_h, 0.0, 1e-9);
  EXPECT_NEAR(report.factor, 4.303, 0.2) << "Student's t with two degrees of freedom";
}

TEST(WarmUp, one_limit_of_two_is_enough_to_wait) {
  Drift drift = still(0.2);
  drift.grown_um = [](double time_s) { return 60.0 * time_s / kHour_s; };
  EXPECT_EQ(examined(views_of(drift, 3, 40)).state, WarmUpState::drifting);
  std::swap(drift.moved_um, drift.grown_um);
  EXPECT_EQ(examined(views_of(drift, 3, 40)).state, WarmUpState::drifting);
}

TEST(WarmUp, noise_alone_is_soon_stable_and_more_noise_needs_more_views) {
  double sum_s = 0.0;
  double sum_noisy_s = 0.0;
  constexpr std::uint64_t kSeeds = 100;
  for (std::uint64_t seed = 1; seed <= kSeeds; ++seed) {
    const auto at_s = stable_after_s(still(0.5), seed, 91);
    const auto noisy_s = stable_after_s(still(2.0), seed, 91);
    ASSERT_TRUE(at_s && noisy_s) << "seed " << seed;
    sum_s += *at_s;
    sum_noisy_s += *noisy_s;
  }
  RecordProperty("mean_min", std::to_string(sum_s / kSeeds / 60.0));
  EXPECT_LT(sum_s / kSeeds, 20.0 * 60.0);
  EXPECT_GT(sum_noisy_s, sum_s);
}

TEST(WarmUp, much_noise_is_uncertain_not_stable) {
  EXPECT_NE(examined(views_of(still(30.0), 5, 30)).state, WarmUpState::stable);
}

TEST(WarmUp, a_constant_drift_of_twice_the_limit_is_never_stable) {
  Drift drift = still(1.0);
  drift.moved_um = [](double time_s) { return 40.0 * time_s / kHour_s; };
  for (std::uint64_t seed = 1; seed <= 300; ++seed)
    EXPECT_FALSE(stable_after_s(drift, seed, 91).has_value()) << "seed " << seed;
}

TEST(WarmUp, a_decaying_drift_is_stable_only_when_the_next_hour_drifts_less_than_the_limit) {
  struct Scanner {
    double total_um;
    double decay_s;
    double noise_um;
  };
  constexpr std::uint64_t kSeeds = 100;
  std::uint64_t called = 0;
  std::uint64_t wrong = 0;
  double largest_um = 0.0;
  for (const Scanner& scanner : {Scanner{100.0, 1'200.0, 1.0}, {60.0, 1'800.0, 1.0}, {300.0, 900.0, 0.5}}) {
    const auto moved_um = [&scanner](double time_s) {
      return scanner.total_um * (1.0 - std::exp(-time_s / scanner.decay_s));
    };
    const Drift drift{moved_um, [&moved_um](double time_s) { return 0.3 * moved_um(time_s); }, scanner.noise_um};
    for (std::uint64_t seed = 1; seed <= kSeeds; ++seed) {
      const auto at_s = stable_after_s(drift, seed, 181);
      if (!at_s) continue;
      const double next_um = moved_um(*at_s + kHour_s) - moved_um(*at_s);
      ++called;
      if (next_um >= WarmUpSettings{}.centre_um_per_h) ++wrong;
      largest_um = std::max(largest_um, next_um);
    }
  }
  RecordProperty("called_stable", std::to_string(called));
  RecordProperty("wrong", std::to_string(wrong));
  RecordProperty("largest_um", std::to_string(largest_um));
  EXPECT_GT(called, 290U) << "three hours are enough for these scanners";
  EXPECT_EQ(wrong, 0U) << "of " << called << ", largest " << largest_um << " um";
}

TEST(WarmUp, a_view_without_numbers_or_out_of_order_is_named) {
  std::vector<WarmUpView> views = views_of(still(0.1), 1, 8);
  views[3].radius_mm = kNoValue;
  Result<WarmUpReport> report = examine_warm_up(views, {});
  ASSERT_FALSE(report.ok());
  EXPECT_EQ(report.error().text.view(), "view 4: time, centre and radius must be finite numbers");
  views[3].radius_mm = 19.05;
  views[5].time_s = views[4].time_s;
  report = examine_warm_up(views, {});
  ASSERT_FALSE(report.ok());
  EXPECT_NE(report.error().text.view().find("view 6: its time 240.000 s is not after"), std::string_view::npos)
      << report.error().text.view();
}

TEST(WarmUp, states_have_words) {
  EXPECT_EQ(name(WarmUpState::few_views), "few_views");
  EXPECT_EQ(name(WarmUpState::stable), "stable");
}

}  // namespace
}  // namespace slabd::calib
