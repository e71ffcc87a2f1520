// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <cmath>
#include <string>
#include <vector>

#include "base/base.h"

namespace slabd {
namespace {

GaugeSettings gauge(const char* name, GaugeLink link = GaugeLink::plc) {
  GaugeSettings g;
  g.name = name;
  g.source = "plc:40";
  g.link = link;
  g.u = 0.08;
  g.valid_ns = 600 * kNsPerS;
  g.master = {true, 5600.0, 0.02, 0.1, 12 * 3'600'000'000LL};
  return g;
}

constexpr std::int64_t kNow_us = 1'800'000'000'000'000;

GaugeCheck good_check(const GaugeSettings& g) {
  GaugeCheck check;
  check.gauge = g.name;
  check.value = g.master.value + 0.05;
  check.master_value = g.master.value;
  check.master_u = g.master.u;
  check.within = g.master.limit;
  check.passed = true;
  check.utime_us = kNow_us - 3'600'000'000LL;
  return check;
}

GaugeSample sample(double value, std::uint32_t slab_no, std::uint32_t seq, std::int64_t at_s) {
  return {true, value, seq, slab_no, at_s * kNsPerS, kNow_us};
}

const GaugeMoment kSlab{77, 1'000 * kNsPerS, 1'300 * kNsPerS, kNow_us};

TEST(Gauge, a_formula_is_one_of_the_closed_list) {
  struct Case {
    const char* text;
    const char* fault;  ///< empty: it is right
  };
  const std::vector<Case> cases = {
      {"mean(length_left, length_right)", ""},
      {"mean(a)", ""},
      {" difference( a ,b ) ", ""},
      {"plane4_flatness(a, b, c, d)", ""},
      {"range(a, b, c, d, e, f, g, h)", ""},
      {"median(a, b)", "the form \"median\" is unknown; allowed are mean, difference, range and plane4_flatness"},
      {"a + b", "the form \"a + b\" is unknown"},
      {"", "the form \"\" is unknown"},
      {"mean", "mean needs its gauges in brackets"},
      {"mean(a, b", "mean needs its gauges in brackets"},
      {"mean()", "\"\" is not the name of a gauge"},
      {"mean(a,)", "\"\" is not the name of a gauge"},
      {"mean(a, mean(b))", "\"mean(b)\" is not the name of a gauge"},
      {"mean(a, 2)", "\"2\" is not the name of a gauge"},
      {"mean(Left)", "\"Left\" is not the name of a gauge"},
      {"mean(a, a)", "the gauge a is named twice"},
      {"difference(a)", "difference has 1 gauges, allowed are 2"},
      {"difference(a, b, c)", "difference has 3 gauges, allowed are 2"},
      {"range(a)", "range has 1 gauges, allowed are 2..8"},
      {"plane4_flatness(a, b, c)", "plane4_flatness has 3 gauges, allowed are 4"},
      {"mean(a, b, c, d, e, f, g, h, i)", "mean has 9 gauges, allowed are 1..8"},
  };
  for (const Case& c : cases) {
    const Result<GaugeFormula> formula = parse_formula(c.text);
    EXPECT_EQ(formula.ok(), *c.fault == '\0') << c.text;
    if (formula.ok()) continue;
    EXPECT_NE(formula.error().text.view().find(c.fault), std::string_view::npos)
        << c.text << ": " << formula.error().text.view();
  }
}

TEST(Gauge, the_text_of_a_formula_is_read_back) {
  for (const char* text : {"mean(a, b)", "difference(a, b)", "range(a, b, c)", "plane4_flatness(a, b, c, d)"}) {
    const Result<GaugeFormula> formula = parse_formula(text);
    ASSERT_TRUE(formula.ok());
    EXPECT_EQ(text_of(formula.value()).view(), text);
  }
}

GaugeReadings readings(const std::vector<double>& values, double u = 0.1, double u_master = 0.02) {
  GaugeReadings list;
  for (std::size_t i = 0; i < values.size(); ++i) {
    GaugeReading r;
    r.gauge.assign(std::string(1, static_cast<char>('a' + static_cast<int>(i))));
    r.state = GaugeState::ok;
    r.value = values[i];
    r.u = u;
    r.u_master = u_master;
    EXPECT_TRUE(list.push(r));
  }
  return list;
}

FormulaValue value_of(const char* formula, const GaugeReadings& list) {
  return evaluate(parse_formula(formula).value(), list);
}

TEST(Gauge, formulas_have_their_value_and_uncertainty) {
  const FormulaValue mean = value_of("mean(a, b)", readings({5600.0, 5601.0}));
  EXPECT_NEAR(mean.value, 5600.5, 1e-9);
  EXPECT_NEAR(mean.u_gauge, 0.1 / std::sqrt(2.0), 1e-12);
  EXPECT_NEAR(mean.u_master, 0.02, 1e-12) << "one master for both";
  const FormulaValue difference = value_of("difference(a, b)", readings({10.0, 4.0}));
  EXPECT_NEAR(difference.value, 6.0, 1e-12);
  EXPECT_NEAR(difference.u_gauge, 0.1 * std::sqrt(2.0), 1e-12);
  EXPECT_NEAR(difference.u_master, 0.04, 1e-12);
  const FormulaValue range = value_of("range(a, b, c)", readings({1.0, -2.0, 0.5}));
  EXPECT_NEAR(range.value, 3.0, 1e-12);
  EXPECT_NEAR(range.u_gauge, 0.1 * std::sqrt(2.0), 1e-12) << "the middle one has no part";
  EXPECT_NEAR(value_of("range(a, b)", readings({2.0, 2.0})).value, 0.0, 1e-12);
}

// Four points of a tilted plane have flatness 0; one corner up by h gives h / 2, whichever it is.
TEST(Gauge, plane4_flatness_is_the_least_distance_of_two_parallel_planes) {
  EXPECT_NEAR(value_of("plane4_flatness(a, b, c, d)", readings({0.0, 1.0, 3.0, 2.0})).value, 0.0, 1e-12);
  for (std::size_t corner = 0; corner < 4; ++corner) {
    std::vector<double> heights = {0.0, 1.0, 3.0, 2.0};
    heights[corner] += 0.6;
    const FormulaValue flatness = value_of("plane4_flatness(a, b, c, d)", readings(heights));
    EXPECT_NEAR(flatness.value, 0.3, 1e-12) << corner;
    EXPECT_NEAR(flatness.u_gauge, 0.1, 1e-12);
  }
}

TEST(Gauge, a_formula_needs_every_gauge) {
  GaugeReadings list = readings({1.0, 2.0});
  EXPECT_TRUE(std::isnan(value_of("mean(a, b, c)", list).value)) << "c is not there";
  for (std::size_t state = 1; state < kGaugeStates; ++state) {
    list[1].state = static_cast<GaugeState>(state);
    EXPECT_TRUE(std::isnan(value_of("mean(a, b)", list).value)) << name(list[1].state);
    EXPECT_FALSE(reason_of(list[1].state).empty());
  }
}

TEST(Gauge, a_value_counts_for_its_own_slab_only) {
  const GaugeSettings g = gauge("length_left");
  const GaugeCheck check = good_check(g);
  struct Case {
    GaugeSample sample;
    GaugeState state;
    const char* why;
  };
  const std::vector<Case> cases = {
      {sample(5600.1, 77, 5, 1'200), GaugeState::ok, "it names the slab"},
      {sample(5600.1, 77, 5, 900), GaugeState::ok, "gauged before SLAB_BEGIN, upstream"},
      {sample(5600.1, 76, 5, 1'200), GaugeState::other_slab, "the slab before, although it came late"},
      {sample(5600.1, 0, 5, 1'200), GaugeState::other_slab, "no number: a master's, although the slab was open"},
      {sample(5600.1, 77, 5, 600), GaugeState::stale, "older than valid_s"},
      {sample(kNoValue, 77, 5, 1'200), GaugeState::missing, "not a number"},
      {GaugeSample{}, GaugeState::missing, "nothing has arrived"},
  };
  for (const Case& c : cases) EXPECT_EQ(name(bind(g, c.sample, check, nullptr, kSlab).state), name(c.state)) << c.why;
}

TEST(Gauge, only_an_instrument_may_name_no_slab) {
  for (const GaugeLink link : {GaugeLink::plc, GaugeLink::udp, GaugeLink::manual, GaugeLink::modbus}) {
    const GaugeSettings g = gauge("length_left", link);
    const auto state_at = [&](std::int64_t at_s, std::uint32_t slab_no) {
      GaugeMoment slab = kSlab;
      slab.slab_no = slab_no;
      return bind(g, sample(5600.1, 0, 5, at_s), good_check(g), nullptr, slab).state;
    };
    EXPECT_EQ(state_at(1'200, 77) == GaugeState::ok, link == GaugeLink::modbus);
    EXPECT_EQ(state_at(999, 77), GaugeState::other_slab) << "before SLAB_BEGIN";
    EXPECT_EQ(state_at(1'200, 0), GaugeState::ok) << "a line that does not number its slabs";
    EXPECT_EQ(state_at(999, 0), GaugeState::other_slab);
  }
}

TEST(Gauge, a_value_outside_the_measuring_range_does_not_count) {
  GaugeSettings g = gauge("height");
  g.low = 45.0;
  g.high = 55.0;
  for (const double inside : {45.0, 50.0, 55.0})
    EXPECT_EQ(bind(g, sample(inside, 77, 5, 1'200), good_check(g), nullptr, kSlab).state, GaugeState::ok) << inside;
  for (const double outside : {44.999, 55.001, 50.0 / 25.4, 50e3, -50.0})
    EXPECT_EQ(bind(g, sample(outside, 77, 5, 1'200), good_check(g), nullptr, kSlab).state, GaugeState::out_of_range)
        << outside;
}

TEST(Gauge, every_state_is_found_by_its_name) {
  for (std::size_t i = 0; i < kGaugeStates; ++i)
    EXPECT_EQ(gauge_state_of(name(static_cast<GaugeState>(i))), static_cast<GaugeState>(i));
  EXPECT_EQ(gauge_state_of("good"), GaugeState::missing);
}

TEST(Gauge, a_number_that_was_used_does_not_count_again) {
  const GaugeSettings g = gauge("length_left");
  GaugeReading used;
  used.gauge = g.name;
  used.slab_no = 77;
  used.seq = 5;
  EXPECT_EQ(bind(g, sample(5600.1, 77, 5, 1'200), good_check(g), &used, kSlab).state, GaugeState::other_slab)
      << "the slab is inspected again";
  EXPECT_EQ(bind(g, sample(5600.1, 77, 6, 1'200), good_check(g), &used, kSlab).state, GaugeState::ok);
  used.slab_no = 76;
  EXPECT_EQ(bind(g, sample(5600.1, 77, 5, 1'200), good_check(g), &used, kSlab).state, GaugeState::ok);
}

TEST(Gauge, without_a_good_check_in_time_a_value_does_not_count) {
  const GaugeSettings g = gauge("length_left");
  const GaugeSample s = sample(5600.1, 77, 5, 1'200);
  EXPECT_EQ(bind(g, s, {}, nullptr, kSlab).state, GaugeState::unchecked);
  GaugeCheck check = good_check(g);
  check.master_value += 1.0;
  EXPECT_EQ(bind(g, s, check, nullptr, kSlab).state, GaugeState::unchecked) << "another master";
  check = good_check(g);
  check.passed = false;
  EXPECT_EQ(bind(g, s, check, nullptr, kSlab).state, GaugeState::check_failed);
  check = good_check(g);
  check.value = g.master.value + 0.2;
  EXPECT_EQ(bind(g, s, check, nullptr, kSlab).state, GaugeState::check_failed) << "the limit is smaller now";
  check = good_check(g);
  check.utime_us = kNow_us - g.master.every_us - 1;
  EXPECT_EQ(bind(g, s, check, nullptr, kSlab).state, GaugeState::check_overdue);
  check = good_check(g);
  check.utime_us = kNow_us + 3'600'000'001LL;
  EXPECT_EQ(bind(g, s, check, nullptr, kSlab).state, GaugeState::unchecked) << "made with a wrong clock";
  check = good_check(g);
  check.source = "plc:42";
  EXPECT_EQ(bind(g, s, check, nullptr, kSlab).state, GaugeState::unchecked) << "another register";
  GaugeSettings without = g;
  without.master = {};
  EXPECT_EQ(bind(without, s, {}, nullptr, kSlab).state, GaugeState::ok);
}

TEST(Gauge, the_master_adds_what_a_good_check_leaves_open) {
  const GaugeSettings g = gauge("length_left");
  EXPECT_NEAR(master_uncertainty(g.master), std::hypot(0.02, 0.1 / std::sqrt(3.0)), 1e-12);
  EXPECT_EQ(master_uncertainty({}), 0.0);
}

TEST(Gauge, twenty_slabs_with_one_value_are_a_stuck_sensor) {
  GaugeRuns runs;
  for (int slab = 1; slab <= limits::kGaugeStuckSlabs; ++slab) {
    add_slab(runs, readings({5600.0, 200.0 + slab}));
    EXPECT_EQ(runs[0].is_stuck(), slab == limits::kGaugeStuckSlabs) << slab;
    EXPECT_EQ(runs[1].slabs, 1);
  }
  add_slab(runs, readings({kNoValue, 1.0}));
  EXPECT_TRUE(runs[0].is_stuck()) << "a slab without a value proves nothing";
  add_slab(runs, readings({5600.001, 1.0}));
  EXPECT_FALSE(runs[0].is_stuck());
}

TEST(Gauge, names_are_plain) {
  for (const char* good : {"a", "length_left", "t2", "abcdefghijklmnopqrstuvwxyz_12345"})
    EXPECT_TRUE(is_gauge_name(good)) << good;
  for (const char* bad : {"", "2a", "_a", "A", "a b", "a-b", "a\xC3\xA4", "abcdefghijklmnopqrstuvwxyz_123456"})
    EXPECT_FALSE(is_gauge_name(bad)) << bad;
}

}  // namespace
}  // namespace slabd
