// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>
#include <sqlite3.h>

#include "storage/chain.h"
#include "tests/storage/store_fixture.h"

namespace slabd::storage {
namespace {

GaugeReading reading(const char* gauge, double value, std::uint32_t seq, std::uint32_t slab_no) {
  GaugeReading r;
  r.gauge = gauge;
  r.source = "plc:40";
  r.state = GaugeState::ok;
  r.value = value;
  r.u = 0.08;
  r.u_master = 0.061;
  r.seq = seq;
  r.slab_no = slab_no;
  r.utime_us = 1'700'000'000'000'000;
  r.age_s = 12.5;
  r.check_utime_us = 1'600'000'000'000'000;
  r.check_deviation = -0.03;
  return r;
}

class GaugesTest : public StoreTest {
 protected:
  GaugesTest() {
    open();
    (void)recover();
  }
  /// A slab without scans, with these readings.
  void add_slab(std::int64_t key, const std::vector<GaugeReading>& readings) {
    begin(key, static_cast<std::uint32_t>(key));
    accept(PlcCommand::slab_end, 0, key);
    SlabJob job;
    job.slab_key = key;
    job.slab.verdict = Verdict::not_measured;
    job.slab.reason = 114;
    for (const GaugeReading& r : readings) EXPECT_TRUE(job.slab.gauges.push(r));
    job.record.res_seq = ++res_seq_;
    job.record.kind = 2;
    job.record.cmd_seq = cmd_seq_;
    job.record.verdict = Verdict::not_measured;
    job.ended_utime_us = 2'000'000 * key;
    apply(job);
    acknowledge(res_seq_);
  }
  KeepGaugeCheck check(double value, std::int64_t utime_us) {
    KeepGaugeCheck change;
    change.check.gauge = "length_left";
    change.check.value = value;
    change.check.master_value = 5600.0;
    change.check.master_u = 0.02;
    change.check.within = 0.1;
    change.note = {"anna", "", utime_us};
    change.check.source = "plc:40";
    return change;
  }
};

TEST_F(GaugesTest, readings_come_back_as_they_went) {
  GaugeReading silent;
  silent.gauge = "width";
  silent.source = "modbus:10.0.0.5:502/1/120";
  silent.unit = ItemUnit::deg;
  silent.u = 0.05;
  const std::vector<GaugeReading> readings = {reading("length_left", 5600.123, 4'000'000'000U, 4'100'000'000U), silent};
  add_slab(1, readings);
  const auto record = reader()->slab(1).value();
  ASSERT_TRUE(record.has_value());
  ASSERT_EQ(record->slab.gauges.size(), 2U);
  for (std::size_t i = 0; i < 2; ++i) expect_same(record->slab.gauges[i], readings[i]);
  const auto values = reader()->gauge_values("length_left", 10).value();
  ASSERT_EQ(values.size(), 1U);
  expect_same(values[0].reading, readings[0]);
}

TEST_F(GaugesTest, a_restarted_daemon_knows_what_was_used_and_how_long_a_value_stays_the_same) {
  for (std::int64_t key = 1; key <= 25; ++key)
    add_slab(key, {reading("stuck", 5600.1, static_cast<std::uint32_t>(key), 1),
                   reading("good", 5600.0 + 0.01 * static_cast<double>(key), 1, 1)});
  close();
  open();
  const auto line = recover();
  ASSERT_EQ(line->gauges_used.size(), 2U);
  EXPECT_EQ(line->gauges_used[0].seq, 25U);
  ASSERT_EQ(line->gauge_runs.size(), 2U);
  for (const GaugeRun& run : line->gauge_runs) EXPECT_EQ(run.is_stuck(), run.gauge.view() == "stuck") << run.slabs;
}

TEST_F(GaugesTest, checks_are_only_added) {
  EXPECT_EQ(store_->change(check(5600.05, 1'000)).value(), "length_left-check-1");
  EXPECT_EQ(store_->change(check(5600.05, 1'000)).value(), "length_left-check-1") << "its answer was lost";
  KeepGaugeCheck outside = check(5600.2, 2'000);
  outside.check.passed = true;
  EXPECT_EQ(store_->change(outside).value(), "length_left-check-2");
  const auto checks = reader()->gauge_checks("length_left", 10).value();
  ASSERT_EQ(checks.size(), 2U);
  EXPECT_FALSE(checks[0].check.passed) << "the store decides";
  EXPECT_TRUE(checks[1].check.passed);
  EXPECT_EQ(checks[1].note.who, "anna");
  EXPECT_TRUE(reader()->gauge_checks("width", 10).value().empty());
  close();
  open();
  const auto line = recover();
  ASSERT_EQ(line->gauge_checks.size(), 1U) << "the newest of each gauge";
  EXPECT_EQ(line->gauge_checks[0].utime_us, 2'000);
}

TEST_F(GaugesTest, an_impossible_check_is_refused) {
  const auto refused = [&](const KeepGaugeCheck& change, const char* words) {
    const Result<std::string> done = store_->change(change);
    ASSERT_FALSE(done.ok());
    EXPECT_EQ(done.error().code, Code::config);
    EXPECT_NE(done.error().text.view().find(words), std::string_view::npos) << done.error().text.view();
  };
  refused(check(kNoValue, 1), "a number is missing");
  KeepGaugeCheck nameless = check(5600.0, 1);
  nameless.note.who = " ";
  refused(nameless, "give the name of the operator");
  KeepGaugeCheck without = check(5600.0, 1);
  without.check.gauge = "Länge";
  refused(without, "a check needs the name of its gauge");
  KeepGaugeCheck limitless = check(5600.0, 1);
  limitless.check.within = 0.0;
  refused(limitless, "its limit or u is negative");
}

TEST_F(GaugesTest, an_altered_reading_breaks_the_seal_of_its_slab) {
  add_slab(1, {reading("length_left", 5600.1, 1, 1)});
  close();
  {
    sqlite3* db = nullptr;
    ASSERT_EQ(sqlite3_open(settings_.db_path.c_str(), &db), SQLITE_OK);
    EXPECT_EQ(sqlite3_exec(db, "UPDATE gauge_value SET value = 5600.0", nullptr, nullptr, nullptr), SQLITE_OK);
    EXPECT_EQ(sqlite3_close(db), SQLITE_OK);
  }
  const Result<ChainReport> report = check_chain(settings_.db_path);
  ASSERT_TRUE(report.ok());
  EXPECT_FALSE(report.value().trouble.empty());
}

}  // namespace
}  // namespace slabd::storage
