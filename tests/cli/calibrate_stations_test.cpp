// SPDX-License-Identifier: Apache-2.0
//
// Validity of station corrections: hand-eye calibration, age, and temperature of the visits.
#include <fmt/core.h>
#include <nlohmann/json.hpp>
#include <tuple>

#include "base/base.h"
#include "cli/client/calibration_change.h"
#include "cli/command.h"
#include "cli/exit.h"
#include "slabctl_process.h"
#include "tests/places/places.h"

namespace slabd::cli {
namespace {

using nlohmann::json;

constexpr std::int64_t kDay_us = 86'400'000'000;

class CalibrateStations : public Slabctl {
 protected:
  CalibrateStations() { configure("0, 80, 150"); }

  void configure(const std::string& xyz, const std::string& rotation = "1, 0, 0, 0") {
    static_cast<void>(write("slabd.toml",
                            "[scanner]\ndrop_dir = \"drop\"\n[storage]\ndb = \"slabd.db\"\nspool_dir = \"spool\"\n"
                            "[recipes]\ndir = \"" +
                                places::source_dir() +
                                "/recipes\"\n[cell]\nT_base_slab = [1800, 0, 300, 1, 0, 0, 0]\n"
                                "[calibration]\nT_flange_scanner = [" +
                                xyz + ", " + rotation + "]\n[control]\nsocket = \"control.sock\"\n"));
  }
  [[nodiscard]] Ended slabctl(const std::string& what) const { return run(what + " --config " + file("slabd.toml")); }
  [[nodiscard]] Ended adopt(const std::string& sigma_mm, const std::string& more = "") const {
    return slabctl("calibrate adopt --sigma-mm " + sigma_mm + " --sigma-deg 0.003 --apply " + more);
  }
  /// Stores the record and puts it in force at that time.
  [[nodiscard]] std::string put_in_force(const storage::CalibrationRecord& record, std::int64_t utime_us) const {
    config::Config config;
    EXPECT_TRUE(config_from(file("slabd.toml"), config));
    const Result<ChangeAnswer> kept = change_calibration(config, storage::KeepCalibration{record});
    EXPECT_TRUE(kept.ok()) << kept.error().text.view();
    if (!kept.ok()) return "";
    const Result<ChangeAnswer> applied =
        change_calibration(config, storage::ApplyCalibration{kept.value().id, {"anna", "test", utime_us}});
    EXPECT_TRUE(applied.ok()) << applied.error().text.view();
    return kept.value().id;
  }
  [[nodiscard]] storage::CalibrationRecord in_force(CalibrationKind kind, std::uint16_t slab_type = 0) const {
    auto reader = storage::open_reader(file("slabd.db"));
    if (!reader.ok()) return {};
    auto current = reader.value()->current(kind, slab_type);
    return current.ok() && current.value() ? *current.value() : storage::CalibrationRecord{};
  }
  [[nodiscard]] json planned() const { return json::parse(slabctl("stations --slab-type 5600 --json").out); }
  /// Station 1, mastered at its planned flange pose.
  [[nodiscard]] storage::CalibrationRecord table_of_the_plan() const {
    const json row = planned()["stations"][0];
    std::array<double, 7> pose{};
    for (std::size_t i = 0; i < pose.size(); ++i) pose[i] = row["T_base_flange"][i];
    StationTable table;
    table.slab_type = 5600;
    table.station[0] = {5, Pose::identity(), Pose::from_array(pose), 0.02, 1e-5, 0.02};
    storage::CalibrationRecord record;
    record.parent_id = in_force(CalibrationKind::hand_eye).id;
    record.numbers = table;
    record.created_utime_us = wall_clock_us() - 20 * kDay_us;
    return record;
  }
  /// A certificate of two seats at a distance of 1000 mm, and five rounds.
  [[nodiscard]] std::string sources() const {
    std::string visits;
    for (int round = 1; round <= 5; ++round)
      for (int station = 1; station <= 2; ++station) {
        const std::string x = std::to_string(1000 * (station - 1));
        const std::string head = "visit = " + std::to_string(station) + " \"round " + std::to_string(round) + "\" " + x;
        // The flange looks down from 600 mm; the seat is at the origin, with a robot error of 0.3 mm.
        visits += head + " 0 600 0 1 0 0  0.3 -80 " + std::to_string(450.0 + 0.01 * round) + "  0.3 -80 " +
                  std::to_string(350.0 + 0.01 * round) + "  0.3 -180 " + std::to_string(450.0 + 0.012 * round) + "\n";
      }
    return " --certificate " +
           write("master.txt",
                 "id = m\ndate = 2026-01-01\nslab_type = 5600\nframe = base\nU_mm = 0.01\ntemperature_c = 21\n"
                 "seat = 1 0 0 0 0 0 1 0 1 0\nseat = 2 1000 0 0 0 0 1 0 1 0\n") +
           " --visits " + write("visits.txt", visits);
  }
};

TEST_F(CalibrateStations, four_sets_of_stops_share_no_stop_and_each_tells_its_stations_apart) {
  std::vector<json> sets;
  for (const char* set : {"1", "2", "3", "4"}) {
    const Ended told = slabctl(std::string("stations --slab-type 5600 --json --set ") + set);
    ASSERT_EQ(told.status, 0) << told.err;
    EXPECT_EQ(told.err.find("alike stops"), std::string::npos) << told.err;
    sets.push_back(json::parse(told.out));
  }
  for (std::size_t a = 0; a < sets.size(); ++a)
    for (std::size_t b = 0; b < a; ++b)
      for (std::size_t station = 0; station < 18; ++station)
        EXPECT_NE(sets[a]["stations"][station]["T_base_flange"], sets[b]["stations"][station]["T_base_flange"])
            << "sets " << a + 1 << " and " << b + 1 << ", station " << station + 1;
  EXPECT_EQ(slabctl("stations --slab-type 5600 --set 5").status, kUsage);
}

TEST_F(CalibrateStations, corrections_that_the_line_does_not_use_do_not_hold) {
  ASSERT_EQ(adopt("0.05").status, 0);
  storage::CalibrationRecord table = table_of_the_plan();
  static_cast<void>(put_in_force(table, wall_clock_us()));
  EXPECT_TRUE(planned()["stations"][0]["correction_holds"].get<bool>());
  expect_mentions(slabctl("stations --slab-type 5600").out, "its correction holds");
  // A hand-eye calibration with the same numbers and another id: the one used for the solution is not in force.
  ASSERT_EQ(adopt("0.06").status, 0);
  EXPECT_FALSE(planned()["stations"][0]["correction_holds"].get<bool>());
  expect_mentions(slabctl("stations --slab-type 5600").out, "its correction is stale: solved with " + table.parent_id);
  // Expired ten days ago.
  table.parent_id = in_force(CalibrationKind::hand_eye).id;
  table.expires_utime_us = wall_clock_us() - 10 * kDay_us;
  std::get<StationTable>(table.numbers).station[0].sigma_mm = 0.03;
  config::Config config;
  ASSERT_TRUE(config_from(file("slabd.toml"), config));
  table.created_utime_us = wall_clock_us() - 20 * kDay_us;
  static_cast<void>(put_in_force(table, wall_clock_us() - 20 * kDay_us + 1'000'000));
  EXPECT_FALSE(planned()["stations"][0]["correction_holds"].get<bool>());
  expect_mentions(slabctl("stations --slab-type 5600").out, "its correction expired on ");
}

TEST_F(CalibrateStations, commission_counts_only_calibrations_that_the_line_uses) {
  constexpr std::size_t kHandEye = 8;
  constexpr std::size_t kCorrections = 10;
  constexpr std::size_t kDailyCheck = 11;
  const auto step = [this](std::size_t number) {
    const json document = json::parse(slabctl("commission --json").out);
    return document["steps"][number - 1];
  };
  config::Config config;
  ASSERT_TRUE(config_from(file("slabd.toml"), config));
  storage::CalibrationRecord ball;
  ball.numbers = MonitorBall{Vec3(1'000.0, 200.0, 300.0), 19.05, 0.1};
  ball.created_utime_us = wall_clock_us();
  ASSERT_TRUE(change_calibration(config, storage::KeepCalibration{ball}).ok()) << "makes the database";
  expect_mentions(step(kCorrections)["saw"], "[calibration] station_sigma_mm");
  EXPECT_EQ(step(kCorrections)["state"], "open") << "commissioning values without a sigma: no seat can pass";
  ASSERT_EQ(adopt("0.05").status, 0);
  EXPECT_EQ(step(kHandEye)["state"], "done");
  const std::string table = put_in_force(table_of_the_plan(), wall_clock_us());
  EXPECT_EQ(step(kCorrections)["saw"].get<std::string>().find(table), std::string::npos);
  ASSERT_EQ(adopt("0.06").status, 0);
  expect_mentions(step(kCorrections)["saw"], table + " is stale");

  EXPECT_EQ(step(kDailyCheck)["state"], "note");
  CalibrationCheck check;
  check.kind = CalibrationKind::monitor_ball;
  check.reference_id.assign(put_in_force(ball, wall_clock_us()));
  EXPECT_EQ(step(kDailyCheck)["state"], "done");
  check.utime_us = wall_clock_us();
  check.who = "anna";
  check.source = "scan";
  check.note = "the ball is 0.4 mm off";
  ASSERT_TRUE(change_calibration(config, storage::KeepCheck{check}).ok());
  EXPECT_EQ(step(kDailyCheck)["state"], "open");
  expect_mentions(step(kDailyCheck)["saw"], "the ball is 0.4 mm off");

  storage::CalibrationRecord hand_eye = in_force(CalibrationKind::hand_eye);
  std::get<HandEyeNumbers>(hand_eye.numbers).sigma_mm = 0.07;
  hand_eye.created_utime_us = wall_clock_us() - 20 * kDay_us;
  hand_eye.expires_utime_us = wall_clock_us() - 10 * kDay_us;
  static_cast<void>(put_in_force(hand_eye, hand_eye.created_utime_us + 1'000'000));
  EXPECT_EQ(step(kHandEye)["state"], "open");
  expect_mentions(step(kHandEye)["saw"], " has expired");
}

TEST_F(CalibrateStations, solved_again_they_hold_no_longer_than_before) {
  ASSERT_EQ(adopt("0.05").status, 0);
  const Ended first = slabctl("calibrate stations --apply --valid-days 10 --temperature 21" + sources());
  ASSERT_EQ(first.status, 0) << first.err;
  storage::CalibrationRecord record = in_force(CalibrationKind::stations, 5600);
  ASSERT_EQ(adopt("0.06").status, 0);
  const Ended warmer = slabctl("calibrate stations --again --apply --temperature 29");
  EXPECT_EQ(warmer.status, 2) << warmer.out;
  expect_mentions(warmer.err, "--temperature 29: the visits that are solved again were made at 21 deg C");
  const Ended again = slabctl("calibrate stations --again --apply --valid-days 3650");
  ASSERT_EQ(again.status, 0) << again.err;
  const storage::CalibrationRecord second = in_force(CalibrationKind::stations, 5600);
  EXPECT_NE(second.id, record.id);
  EXPECT_EQ(second.expires_utime_us, record.expires_utime_us) << "nothing was measured since";
  EXPECT_EQ(second.temperature_c, 21.0);
  // Expired corrections cannot be solved again and put in force.
  record.created_utime_us = wall_clock_us() - 20 * kDay_us;
  record.expires_utime_us = wall_clock_us() - 10 * kDay_us;
  record.parent_id = in_force(CalibrationKind::hand_eye).id;
  const std::string old = put_in_force(record, record.created_utime_us + 1'000'000);
  const Ended revived = slabctl("calibrate stations --again --apply");
  EXPECT_EQ(revived.status, 6) << revived.out;
  expect_mentions(revived.err, "expired; calibrate again");
  EXPECT_EQ(in_force(CalibrationKind::stations, 5600).id, old);
}

TEST_F(CalibrateStations, a_temperature_far_from_the_certificates_is_said_in_mm) {
  ASSERT_EQ(adopt("0.05").status, 0);
  const std::string solve = "calibrate stations --dry-run" + sources();
  const Ended unsaid = slabctl(solve);
  ASSERT_EQ(unsaid.status, 0) << unsaid.err;
  expect_mentions(unsaid.err, "certificate m holds at 21.0 deg C, and --temperature does not say");
  expect_mentions(unsaid.err, "every K is about 0.010 mm over the 1000 mm");
  const Ended near = slabctl(solve + " --temperature 23.5");
  EXPECT_EQ(near.err.find("temperature"), std::string::npos) << near.err;
  EXPECT_EQ(near.err.find("deg C"), std::string::npos) << near.err;
  expect_mentions(slabctl(solve + " --temperature 29").err,
                  "the visits were made at 29.0: over the 1000 mm between its stations that is about 0.080 mm");
}

TEST_F(CalibrateStations, a_slab_s_certificate_is_brought_to_the_temperature_of_the_visits) {
  ASSERT_EQ(adopt("0.05").status, 0);
  fs::create_directories(file("recipes"));
  std::ignore = write("recipes/p5600.toml", content(kRecipe) + R"([thermal]
reference_c = { value = 20, confirmed = true }
cte_per_K = { value = 1e-5, confirmed = true }
u_cte_per_K = { value = 1e-6, confirmed = true }
u_temperature_K = { value = 2, confirmed = true }
unknown_range_c = { value = [-10, 50], confirmed = true }
)");
  std::string config = content(file("slabd.toml"));
  config.replace(config.find(places::source_dir()), places::source_dir().size(), file(""));
  std::ignore = write("slabd.toml", config);
  const std::string given = sources();
  std::string certificate = content(file("master.txt"));
  certificate.replace(certificate.find("frame = base"), 12, "frame = slab");
  std::ignore = write("master.txt", certificate);
  const Ended solved = slabctl("calibrate stations --dry-run" + given + " --temperature 29");
  expect_mentions(solved.out, "brought from 21.0 to 29.0 deg C: its seats by up to 0.080 mm");
  EXPECT_EQ(solved.err.find("deg C"), std::string::npos) << solved.err;
  expect_mentions(slabctl("calibrate stations --dry-run" + given).err, "--temperature does not say");
}

TEST_F(CalibrateStations, adopting_over_another_calibration_wants_a_word) {
  const Ended first = adopt("0.05");
  ASSERT_EQ(first.status, 0) << first.err;
  EXPECT_EQ(first.out.find("seats"), std::string::npos) << "nothing was in force: " << first.out;
  const std::string before = in_force(CalibrationKind::hand_eye).id;
  configure("30, 80, 150");
  const Ended unsaid = adopt("0.05");
  EXPECT_EQ(unsaid.status, 6) << unsaid.out;
  expect_mentions(unsaid.err, before + " is in force; with the configuration's value seats of slab type ");
  expect_mentions(unsaid.err, "move by up to 30.000 mm");
  expect_mentions(unsaid.err, "--yes");
  EXPECT_EQ(in_force(CalibrationKind::hand_eye).id, before);
  ASSERT_EQ(adopt("0.05", "--yes").status, 0);
  EXPECT_NE(in_force(CalibrationKind::hand_eye).id, before);
  const json history = json::parse(slabctl("calibrate history --json").out);
  EXPECT_EQ(history["applied"][0]["why"], "adopted from " + file("slabd.toml"));
  // Less than a fifth of a millimetre is reported and needs no confirmation.
  configure("30.1, 80, 150");
  const Ended small = adopt("0.05");
  EXPECT_EQ(small.status, 0) << small.err;
  expect_mentions(small.err, "move by up to 0.100 mm");
}

TEST_F(CalibrateStations, a_scanner_tilted_about_what_it_sees_moves_no_seat_and_wants_a_word) {
  ASSERT_EQ(adopt("0.05").status, 0);
  const std::string before = in_force(CalibrationKind::hand_eye).id;
  const double half_rad = 0.5 * rad_from_deg(0.07);
  const Vec3 seen = nominal_T_block_scanner().inverse() * Vec3::Zero();
  const Quat tilt(std::cos(half_rad), std::sin(half_rad), 0.0, 0.0);
  const Vec3 xyz = Vec3(0.0, 80.0, 150.0) + seen - tilt * seen;
  configure(fmt::format("{:.12f}, {:.12f}, {:.12f}", xyz.x(), xyz.y(), xyz.z()),
            fmt::format("{:.15f}, {:.15f}, 0, 0", tilt.w(), tilt.x()));
  const Ended unsaid = adopt("0.05");
  EXPECT_EQ(unsaid.status, 6) << unsaid.out;
  expect_mentions(unsaid.err, "move by up to 0.000 mm, the scanner turns by 0.070 deg");
  // Applying it by name also requires the confirmation.
  const Ended kept = slabctl("calibrate adopt --sigma-mm 0.05 --sigma-deg 0.003");
  ASSERT_EQ(kept.status, 0) << kept.err;
  const std::string id = kept.out.substr(8, kept.out.find(';') - 8);
  const Ended by_name = slabctl("calibrate apply " + id.substr(0, 10) + " --reason tilted");
  EXPECT_EQ(by_name.status, 6) << by_name.out;
  expect_mentions(by_name.err, before + " is in force; with " + id + " seats of slab type ");
  EXPECT_EQ(in_force(CalibrationKind::hand_eye).id, before);
  EXPECT_EQ(slabctl("calibrate apply " + id + " --reason tilted --yes --temperature 20").status, 2);
  ASSERT_EQ(slabctl("calibrate apply " + id + " --reason tilted --yes").status, 0);
  EXPECT_EQ(in_force(CalibrationKind::hand_eye).id, id);
}

}  // namespace
}  // namespace slabd::cli
