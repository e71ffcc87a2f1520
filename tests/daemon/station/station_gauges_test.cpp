// SPDX-License-Identifier: Apache-2.0
//
// Gauges in the handshake: only values of the open slab count, whatever the PLC, a hub or a person sends and when.
#include <gtest/gtest.h>

#include <utility>

#include "daemon/station/parts.h"
#include "tests/daemon/station/station_line.h"

namespace slabd::daemon {
namespace {

constexpr std::int32_t kLength_um = 5'600'123;

GaugeSettings gauge(const char* name, GaugeLink link) {
  GaugeSettings g;
  g.name = name;
  g.source = kGaugeLinks.at(static_cast<std::size_t>(link));
  g.link = link;
  g.u = 0.08;
  g.valid_ns = 20 * kNsPerS;
  g.master = {true, 5600.0, 0.02, 0.1, 3'600'000'000LL};
  return g;
}

struct GaugesTest : StationTest {
  GaugeList gauges;

  GaugesTest() {
    add("plc_left", GaugeLink::plc, 0);
    add("plc_right", GaugeLink::plc, 1);
    add("hub", GaugeLink::udp, 0);
    add("tape", GaugeLink::manual, 0);
    add("meter", GaugeLink::modbus, 0);
    line.settings.gauges = {gauges.data(), gauges.size()};
    line.start();
    check_all();
  }
  void add(const char* name, GaugeLink link, std::uint8_t index) {
    GaugeSettings g = gauge(name, link);
    g.plc_index = index;
    EXPECT_TRUE(gauges.push(g));
  }
  /// Every gauge passes its master check now.
  void check_all() {
    for (const GaugeSettings& g : gauges) {
      GaugeCheck check;
      check.gauge = g.name;
      check.value = check.master_value = g.master.value;
      check.master_u = g.master.u;
      check.within = g.master.limit;
      check.passed = true;
      check.utime_us = line.station->utime_us;
      line.feed(GaugeChecked{check});
    }
  }
  /// The PLC writes HR 40..74 in one request.
  void plc_sends(std::uint32_t slab_no, std::int32_t left = kLength_um, std::int32_t right = kLength_um + 10) {
    line.plc.gauge_thousandths[0] = left;
    line.plc.gauge_thousandths[1] = right;
    line.plc.gauge_slab_no = slab_no;
    ++line.plc.gauge_seq;
    line.feed(line.plc);
  }
  void hub_sends(std::uint32_t slab_no, double value = 5600.5, std::uint32_t seq = 1) {
    GaugeSamples samples{};
    samples[2] = {true, value, seq, slab_no, line.station->now_ns, line.station->utime_us};
    line.feed(GaugesSampled{&samples});
  }
  void meter_shows(double value) {
    GaugeSamples samples{};
    samples[4] = {true, value, ++meter_seq, 0, line.station->now_ns, line.station->utime_us};
    line.feed(GaugesSampled{&samples});
  }
  std::uint32_t meter_seq = 0;
  void begin_slab(std::uint32_t slab_no) {
    line.run_for(300);
    line.plc.slab_no = slab_no;
    line.command(PlcCommand::slab_begin);
    line.run_for(20);
    ASSERT_TRUE(line.view().slab_open);
  }
  /// Ends the slab and returns the stored readings.
  GaugeReadings end_slab() {
    line.command(PlcCommand::slab_end);
    line.run_for(200);
    EXPECT_FALSE(line.view().slab_open);
    const SlabJob* job = nullptr;
    for (const StoreJob& one : store.applied)
      if (const auto* end = std::get_if<SlabJob>(&one.what)) job = end;
    EXPECT_NE(job, nullptr);
    (void)line.take_results();
    return job == nullptr ? GaugeReadings{} : job->slab.gauges;
  }
  [[nodiscard]] static std::string_view state(const GaugeReadings& list, std::string_view name_of_gauge) {
    const GaugeReading* reading = find_gauge(list, name_of_gauge);
    return reading == nullptr ? "none" : name(reading->state);
  }
};

TEST_F(GaugesTest, values_of_this_slab_count_and_are_stored_with_it) {
  begin_slab(42);
  plc_sends(42);
  hub_sends(42);
  line.run_for(100);
  const GaugeReadings stored = end_slab();
  ASSERT_EQ(stored.size(), 5U);
  EXPECT_EQ(state(stored, "plc_left"), "ok");
  EXPECT_EQ(state(stored, "hub"), "ok");
  EXPECT_EQ(state(stored, "tape"), "missing");
  const GaugeReading& left = *find_gauge(stored, "plc_left");
  EXPECT_NEAR(left.value, 5600.123, 1e-9);
  EXPECT_EQ(left.seq, line.plc.gauge_seq);
  EXPECT_EQ(left.slab_no, 42U);
  EXPECT_NEAR(left.age_s, 0.1, 0.05);
  EXPECT_EQ(left.check_utime_us, line.station->gauges.checks[0].utime_us);
}

TEST_F(GaugesTest, values_of_the_slab_before_never_count) {
  begin_slab(42);
  plc_sends(42);
  hub_sends(42);
  (void)end_slab();
  begin_slab(43);
  const GaugeReadings silent = end_slab();
  EXPECT_EQ(state(silent, "plc_left"), "other_slab") << "the PLC did not write";
  EXPECT_EQ(state(silent, "hub"), "other_slab");
  begin_slab(44);
  plc_sends(43);
  EXPECT_EQ(state(end_slab(), "plc_left"), "other_slab") << "written again, late";
}

TEST_F(GaugesTest, the_readings_are_fixed_when_slab_end_is_taken) {
  begin_slab(42);
  plc_sends(42);
  line.measuring_works = false;
  line.scan(1);
  line.command(PlcCommand::slab_end);
  line.run_for(40);  // SLAB_END waits for the measurement
  ASSERT_TRUE(line.view().slab_open);
  plc_sends(43, 1, 2);  // the next slab is gauged already
  line.measuring_works = true;
  line.measuring_ends();
  line.run_for(200);
  ASSERT_FALSE(line.view().slab_open);
  EXPECT_EQ(state(line.station->gauges.used, "plc_left"), "ok");
  EXPECT_NEAR(find_gauge(line.station->gauges.used, "plc_left")->value, 5600.123, 1e-9);
}

// SLAB_END, or the end of the slab, cannot be stored, or a fault is shown already. The next slab is gauged before
// SLAB_END is given again.
TEST_F(GaugesTest, readings_stay_those_of_the_first_slab_end_if_it_is_given_again) {
  enum class Hindrance { end, command, fault };
  for (const auto& [slab_no, hindrance] :
       {std::pair(42U, Hindrance::end), std::pair(0U, Hindrance::end), std::pair(42U, Hindrance::command),
        std::pair(0U, Hindrance::command), std::pair(42U, Hindrance::fault), std::pair(0U, Hindrance::fault)}) {
    SCOPED_TRACE(testing::Message() << slab_no << ", hindrance " << static_cast<int>(hindrance));
    line.numbers_slabs = slab_no != 0;
    begin_slab(slab_no);
    if (hindrance == Hindrance::fault) {
      store.fail_when = [](const StoreJob& job) { return std::holds_alternative<BlockJob>(job.what); };
      line.scan(1);
      line.run_for(200);
      ASSERT_NE(line.station->fault, 0);
    }
    plc_sends(slab_no, kLength_um, kNoGaugeRegister);
    if (hindrance == Hindrance::end)
      store.fail_when = [](const StoreJob& job) { return std::holds_alternative<SlabJob>(job.what); };
    if (hindrance == Hindrance::command)
      store.fail_when = [](const StoreJob& job) { return std::holds_alternative<CommandJob>(job.what); };
    line.command(PlcCommand::slab_end);
    line.run_for(200);
    ASSERT_TRUE(line.view().slab_open);
    ASSERT_NE(line.station->fault, 0);
    store.fail_when = nullptr;
    line.plc.fault_reset = true;
    line.feed(line.plc);
    line.plc.fault_reset = false;
    line.run_for(200);
    plc_sends(slab_no == 0 ? 0 : 43, 1, 2);
    // The hub's value is late, but names its slab; the instrument says nothing of it.
    GaugeSamples late{};
    late[2] = {true, 5600.5, ++meter_seq, slab_no, line.station->now_ns, line.station->utime_us};
    late[4] = {true, 5600.5, ++meter_seq, 0, line.station->now_ns, line.station->utime_us};
    line.feed(GaugesSampled{&late});
    ASSERT_TRUE(newest_sample(*line.station, 4).has_value);
    const GaugeReadings stored = end_slab();
    EXPECT_EQ(state(stored, "plc_left"), "ok");
    EXPECT_NEAR(find_gauge(stored, "plc_left")->value, 5600.123, 1e-9);
    EXPECT_NE(state(stored, "plc_right"), "ok");
    EXPECT_EQ(state(stored, "hub") == "ok", slab_no != 0);
    EXPECT_NE(state(stored, "meter"), "ok");
  }
}

TEST_F(GaugesTest, an_instrument_is_not_read_for_a_slab_whose_end_was_given_before_a_restart) {
  for (const bool was_ended : {false, true}) {
    SCOPED_TRACE(was_ended);
    begin_slab(42);
    meter_shows(5600.5);
    if (was_ended) {
      store.fail_when = [](const StoreJob& job) { return std::holds_alternative<SlabJob>(job.what); };
      line.command(PlcCommand::slab_end);
      line.run_for(200);
      store.fail_when = nullptr;
    }
    line.start();
    check_all();
    line.run_for(300);
    ASSERT_TRUE(line.view().slab_open);
    meter_shows(5600.5);
    EXPECT_EQ(state(end_slab(), "meter"), was_ended ? "other_slab" : "ok");
  }
}

TEST_F(GaugesTest, values_are_taken_when_the_sequence_number_changes) {
  begin_slab(42);
  plc_sends(42);
  line.plc.gauge_thousandths[0] = 1;  // the next values are being written
  line.plc.gauge_slab_no = 43;
  line.feed(line.plc);
  const GaugeReadings stored = end_slab();
  EXPECT_EQ(state(stored, "plc_left"), "ok");
  EXPECT_NEAR(find_gauge(stored, "plc_left")->value, 5600.123, 1e-9);
}

TEST_F(GaugesTest, the_same_number_does_not_serve_a_second_inspection) {
  begin_slab(42);
  plc_sends(42);
  (void)end_slab();
  begin_slab(42);
  line.feed(line.plc);
  EXPECT_EQ(state(end_slab(), "plc_left"), "other_slab");
  begin_slab(42);
  plc_sends(42);
  EXPECT_EQ(state(end_slab(), "plc_left"), "ok");
}

TEST_F(GaugesTest, a_value_of_an_instrument_must_come_while_the_slab_is_open) {
  meter_shows(5600.5);
  begin_slab(42);
  EXPECT_EQ(state(end_slab(), "meter"), "other_slab");
  begin_slab(43);
  meter_shows(5600.5);
  EXPECT_EQ(state(end_slab(), "meter"), "ok");
}

// The gauging place is free while the robot scans, so that the master is measured there.
TEST_F(GaugesTest, a_master_that_is_measured_while_a_slab_is_open_does_not_replace_its_values) {
  begin_slab(42);
  plc_sends(42, 5'606'000, kNoGaugeRegister);
  hub_sends(42, 5606.0);
  line.feed(GaugeEntered{3, 5606.0, 42, 1000});
  line.run_for(20);
  plc_sends(0, 5'600'010, 5'601'510);
  hub_sends(0, 5600.01, 2);
  line.feed(GaugeEntered{3, 5600.01, 0, 1000});
  for (const std::size_t i : {0U, 2U, 3U})
    EXPECT_NEAR(newest_sample(*line.station, i).value, 5600.01, 1e-9) << "the check takes it: " << i;
  check_all();
  const GaugeReadings stored = end_slab();
  for (const char* name : {"plc_left", "hub", "tape"}) {
    EXPECT_EQ(state(stored, name), "ok") << name;
    EXPECT_NEAR(find_gauge(stored, name)->value, 5606.0, 1e-9) << name;
  }
  EXPECT_EQ(state(stored, "plc_right"), "missing");
  begin_slab(43);
  const GaugeReadings only_masters = end_slab();
  for (const char* name : {"plc_left", "plc_right", "hub", "tape"}) EXPECT_NE(state(only_masters, name), "ok") << name;
}

TEST_F(GaugesTest, the_last_check_is_in_force_although_the_clock_was_set_back) {
  GaugeCheck check = line.station->gauges.checks[0];
  check.utime_us -= 60'000'000;
  check.value += 1.0;
  check.passed = false;
  line.feed(GaugeChecked{check});
  begin_slab(42);
  plc_sends(42);
  EXPECT_EQ(state(end_slab(), "plc_left"), "check_failed");
}

TEST_F(GaugesTest, an_old_value_is_stale_and_a_missing_one_is_missing) {
  begin_slab(42);
  plc_sends(42, kLength_um, kNoGaugeRegister);
  line.run_for(21'000);
  const GaugeReadings stored = end_slab();
  EXPECT_EQ(state(stored, "plc_left"), "stale");
  EXPECT_EQ(state(stored, "plc_right"), "missing") << "0x80000000";
}

TEST_F(GaugesTest, a_power_cut_between_gauge_and_slab_end_loses_the_value) {
  begin_slab(42);
  plc_sends(42);
  line.start();  // a new process: its registers are empty
  check_all();
  line.plc.gauge_seq = 0;
  line.plc.gauge_thousandths.fill(0);
  line.run_for(600);
  ASSERT_TRUE(line.view().slab_open);
  EXPECT_EQ(state(end_slab(), "plc_left"), "missing");
}

TEST_F(GaugesTest, after_a_restart_the_memory_of_the_plc_may_be_of_any_age) {
  line.settings.plc_memory_lasts = true;
  begin_slab(42);
  plc_sends(42);
  line.start();
  check_all();
  line.run_for(600);  // the first image has the old values
  EXPECT_EQ(state(end_slab(), "plc_left"), "missing");
  begin_slab(43);
  plc_sends(43);
  EXPECT_EQ(state(end_slab(), "plc_left"), "ok");
}

TEST_F(GaugesTest, values_read_again_after_a_lost_connection_are_not_new) {
  line.settings.plc_memory_lasts = true;
  line.start();
  check_all();
  line.plc.gauges_known = false;  // zeros until the registers were read twice alike
  line.feed(line.plc);
  line.plc.gauges_known = true;
  plc_sends(42);
  begin_slab(42);
  EXPECT_EQ(state(end_slab(), "plc_left"), "missing") << "the first values may be of any age";
  begin_slab(43);
  plc_sends(43);
  EXPECT_EQ(state(end_slab(), "plc_left"), "ok");
  begin_slab(44);
  plc_sends(44);
  line.run_for(21'000);
  const std::uint16_t seq = std::exchange(line.plc.gauge_seq, std::uint16_t{0});
  line.plc.gauges_known = false;
  line.feed(line.plc);
  line.plc.gauge_seq = seq;
  line.plc.gauges_known = true;
  line.feed(line.plc);
  EXPECT_EQ(state(end_slab(), "plc_left"), "stale");
}

TEST_F(GaugesTest, numbers_used_before_a_restart_stay_used) {
  begin_slab(42);
  plc_sends(42);
  (void)end_slab();
  line.start();
  check_all();
  begin_slab(42);
  EXPECT_EQ(state(end_slab(), "plc_left"), "other_slab") << "the PLC writes the same block cyclically";
}

TEST_F(GaugesTest, without_a_master_check_in_time_nothing_counts) {
  line.start();  // the checks of this test are not in the store
  begin_slab(42);
  plc_sends(42);
  EXPECT_EQ(state(end_slab(), "plc_left"), "unchecked");
  EXPECT_NE(line.view().warn & kWarnGauge, 0);
  check_all();
  EXPECT_EQ(line.view().warn & kWarnGauge, 0);
  begin_slab(43);
  line.run_for(200);
  line.station->gauges.checks[0].utime_us -= 2 * 3'600'000'000LL;
  plc_sends(43);
  EXPECT_EQ(state(end_slab(), "plc_left"), "check_overdue");
  EXPECT_NE(line.view().warn & kWarnGauge, 0);
}

// The masters of left and right differ by more than their limits. After an exchange of the cables, the check of the
// left gauge reads the master of the right one.
TEST_F(GaugesTest, exchanged_gauges_fail_the_check_of_an_uneven_master) {
  gauges[0].master.value = 5600.0;
  gauges[1].master.value = 5601.5;
  GaugeCheck check;
  check.gauge = gauges[0].name;
  check.master_value = 5600.0;
  check.value = 5601.49;
  check.within = 0.1;
  check.master_u = 0.02;
  check.passed = passes(check);
  check.utime_us = line.station->utime_us;
  line.feed(GaugeChecked{check});
  begin_slab(42);
  plc_sends(42);
  EXPECT_EQ(state(end_slab(), "plc_left"), "check_failed");
}

TEST_F(GaugesTest, a_person_enters_a_value_for_a_slab) {
  begin_slab(42);
  line.feed(GaugeEntered{3, 5600.2, 42, 1000});
  const GaugeReadings stored = end_slab();
  EXPECT_EQ(state(stored, "tape"), "ok");
  EXPECT_NEAR(find_gauge(stored, "tape")->value, 5600.2, 1e-9);
  begin_slab(43);
  EXPECT_EQ(state(end_slab(), "tape"), "other_slab");
}

TEST_F(GaugesTest, a_sensor_that_gives_the_same_value_for_twenty_slabs_is_named) {
  for (std::uint32_t slab_no = 1; slab_no <= 20; ++slab_no) {
    check_all();
    begin_slab(slab_no);
    plc_sends(slab_no, kLength_um, kLength_um + static_cast<std::int32_t>(slab_no));
    (void)end_slab();
    EXPECT_EQ((line.view().warn & kWarnGauge) != 0, slab_no == 20) << slab_no;
  }
  const auto named = [](const std::string& text) {
    return text.find("gauge plc_left has given 5600.1230 for 20 slabs") != std::string::npos;
  };
  EXPECT_EQ(std::count_if(line.logged.begin(), line.logged.end(), named), 1);
  line.start();
  check_all();
  EXPECT_TRUE(run_of(*line.station, "plc_left")->is_stuck()) << "also after a restart";
}

TEST_F(GaugesTest, an_aborted_slab_has_no_values) {
  begin_slab(42);
  plc_sends(42);
  line.command(PlcCommand::slab_abort);
  line.run_for(200);
  ASSERT_FALSE(line.view().slab_open);
  (void)line.take_results();
  begin_slab(42);
  EXPECT_EQ(state(end_slab(), "plc_left"), "ok") << "it was not used";
}

}  // namespace
}  // namespace slabd::daemon
