// SPDX-License-Identifier: Apache-2.0
#include <gmock/gmock.h>

#include "hal/scan/scan_stream.h"
#include "tests/config/text_file.h"
#include "tests/places/places.h"

namespace slabd::config {
namespace {

using ::testing::ElementsAre;
using ::testing::HasSubstr;
using Texts = std::vector<std::string>;

const std::string kCell = "[cell]\nT_base_slab = [1000, 0, 500, 1, 0, 0, 0]\n";
const std::string kCalibration =
    "[calibration]\nT_flange_scanner = [0, 0, 120.5, 1, 0, 0, 0]\nstation_sigma_mm = 0.02\nstation_sigma_deg = 0.001\n"
    "station_gate_mm = 0.8\n";
const std::string kRobots =
    "[[robot]]\nid = \"1\"\nbase_id = 4\n"
    "[[robot]]\nid = \"right\"\nchannel = \"FLANGE_POSE_2\"\nsettled_mm = 0.05\nabsolute_sigma_mm = 0.7\n";
const std::string kScanners =
    "[[scanner]]\nid = \"1\"\ndrop_dir = \"/srv/drop-1\"\ntimeout_s = 9\n"
    "[[scanner]]\nid = \"2\"\nbackend = \"tcp\"\nlisten = \"127.0.0.1:1505\"\ntimeout_s = 7\n"
    "T_flange_scanner = [0, 0, 130, 1, 0, 0, 0]\n";
const std::string kStations =
    "[[station]]\nnumbers = \"1..8\"\nrobot = \"1\"\nscanner = \"1\"\n"
    "[[station]]\nnumber = 9\nrobot = \"1\"\nscanner = \"1\"\nor = \"2\"\n"
    "[[station]]\nnumbers = \"10, 11..18\"\nrobot = \"right\"\nscanner = \"2\"\n";
const std::string kTwo = kCell + kCalibration + kRobots + kScanners + kStations;

class ArmsTest : public ::testing::Test {
 protected:
  Texts load(const std::string& text) {
    std::vector<Problem> problems;
    load_config(files_.write("slabd.toml", text), config_, problems);
    return files_.texts(problems);
  }
  /// The only problem of this file; it names file and line.
  std::string problem_of(const std::string& text) {
    const Texts problems = load(text);
    EXPECT_EQ(problems.size(), 1U) << ::testing::PrintToString(problems);
    if (problems.empty()) return {};
    EXPECT_TRUE(problems[0].starts_with("slabd.toml:")) << problems[0];
    return problems[0];
  }
  [[nodiscard]] std::vector<int> arms_of(int station) const {
    std::vector<int> list;
    const ArmChoice& choice = config_.arms.of_station.at(static_cast<std::size_t>(station - 1));
    for (const std::uint8_t arm : choice) list.push_back(arm);
    return list;
  }
  TextFiles files_;
  Config config_;
};

TEST_F(ArmsTest, a_line_with_one_robot_and_one_scanner_has_one_arm_for_every_station) {
  EXPECT_EQ(load(kCell + kCalibration), Texts{});
  ASSERT_EQ(config_.arms.list.size(), 1U);
  EXPECT_EQ(config_.arms.list[0], Arm{});
  EXPECT_EQ(config_.by, Arm{});
  EXPECT_FALSE(config_.arms.several());
  EXPECT_TRUE(config_.more_arms.empty());
  for (int station = 1; station <= 18; ++station) EXPECT_THAT(arms_of(station), ElementsAre(0)) << station;
}

TEST_F(ArmsTest, two_arms_are_read_with_their_stations) {
  ASSERT_EQ(load(kTwo), Texts{});
  ASSERT_EQ(config_.arms.list.size(), 2U);
  EXPECT_EQ(config_.arms.list[0], (Arm{PartId("1"), PartId("1")}));
  EXPECT_EQ(config_.arms.list[1], (Arm{PartId("right"), PartId("2")}));
  for (int station = 1; station <= 8; ++station) EXPECT_THAT(arms_of(station), ElementsAre(0)) << station;
  EXPECT_THAT(arms_of(9), ElementsAre(0, 1)) << "the usual one first";
  for (int station = 10; station <= 18; ++station) EXPECT_THAT(arms_of(station), ElementsAre(1)) << station;
}

TEST_F(ArmsTest, each_arm_has_its_own_settings) {
  ASSERT_EQ(load(kTwo + "[pose]\nsenders = [\"10.0.0.0/8\"]\n"), Texts{});
  ASSERT_EQ(config_.more_arms.size(), 1U);
  const ArmSettings& second = config_.arm(1);
  EXPECT_EQ(config_.pose.base_id, 4);
  EXPECT_EQ(second.pose.base_id, 0);
  EXPECT_EQ(config_.robot.channel.view(), "FLANGE_POSE");
  EXPECT_EQ(second.robot.channel.view(), "FLANGE_POSE_2");
  EXPECT_EQ(second.pose.settled_mm, 0.05);
  EXPECT_EQ(second.splice.absolute_mm, 0.7);
  EXPECT_FALSE(has_value(config_.splice.absolute_mm));
  EXPECT_EQ(config_.scanner.drop_dir.view(), "/srv/drop-1");
  EXPECT_EQ(second.scanner_backend, hal::ScannerBackend::tcp);
  EXPECT_EQ(second.stream.port, 1505);
  EXPECT_EQ(second.stream.allow.size(), 1U) << "this computer";
  EXPECT_EQ(config_.scan_timeout_ns, 9 * kNsPerS);
  EXPECT_EQ(second.scan_timeout_ns, 7 * kNsPerS);
  EXPECT_EQ(config_.calibration.T_flange_scanner.translation_mm.z(), 120.5);
  EXPECT_EQ(second.calibration.T_flange_scanner.translation_mm.z(), 130.0);
  EXPECT_TRUE(second.calibration.id.view().starts_with("commissioning-"));
  EXPECT_EQ(second.splice.commissioning_mm, 0.02) << "stated once, for all";
  EXPECT_EQ(second.splice.gate_mm, 0.8);
  EXPECT_EQ(second.robot.senders.size(), 1U) << "[pose] is common";
}

TEST_F(ArmsTest, a_scanner_without_commissioning_values_waits_for_its_calibration) {
  ASSERT_EQ(load(with(kTwo, "T_flange_scanner = [0, 0, 130, 1, 0, 0, 0]\n", "")), Texts{});
  EXPECT_FALSE(config_.calibration.id.empty());
  EXPECT_TRUE(config_.arm(1).calibration.id.empty());
}

TEST_F(ArmsTest, the_accepted_camera_is_the_scanner_with_a_stream) {
  const std::string camera = "[genicam]\ncamera = \"10.0.0.9\"\naccepted = \"Range 7\"\n";
  ASSERT_EQ(load(kTwo + camera), Texts{});
  EXPECT_EQ(files_.texts(config_.genicam_problems), Texts{});
  EXPECT_EQ(config_.stream.scanner, 0U);
  EXPECT_EQ(config_.arm(1).stream.scanner, hal::scanner_print("Range 7"));
  EXPECT_EQ(config_.genicam.slabd_port, 1505);
  ASSERT_EQ(load(kTwo + camera + "scanner = \"1\"\n"), Texts{});
  EXPECT_EQ(config_.genicam_problems.size(), 1U) << "scanner 1 delivers files";
  EXPECT_EQ(config_.arm(1).stream.scanner, hal::scanner_print("Range 7")) << "no other camera is used meanwhile";
}

TEST_F(ArmsTest, a_camera_that_may_be_either_of_two_streams_is_named) {
  const std::string two = with(kTwo, "drop_dir = \"/srv/drop-1\"", "backend = \"tcp\"\nlisten = \"127.0.0.1:1504\"");
  const std::string camera = "[genicam]\ncamera = \"10.0.0.9\"\naccepted = \"Range 7\"\n";
  ASSERT_EQ(load(two + camera), Texts{});
  EXPECT_EQ(config_.genicam_problems.size(), 1U);
  EXPECT_EQ(config_.stream.scanner, hal::scanner_print("Range 7"));
  EXPECT_EQ(config_.arm(1).stream.scanner, hal::scanner_print("Range 7"));
  ASSERT_EQ(load(two + camera + "scanner = \"2\"\n"), Texts{});
  EXPECT_EQ(files_.texts(config_.genicam_problems), Texts{});
  EXPECT_EQ(config_.stream.scanner, 0U);
  EXPECT_EQ(config_.genicam.slabd_port, 1505);
  GenicamSettings alone;
  std::vector<Problem> problems;
  load_genicam(files_.write("slabd.toml", two + camera + "scanner = \"2\"\n"), alone, problems);
  EXPECT_EQ(files_.texts(problems), Texts{});
  EXPECT_EQ(alone.slabd_port, 1505);
  load_genicam(files_.write("slabd.toml", two + camera), alone, problems);
  EXPECT_EQ(problems.size(), 1U);
}

TEST_F(ArmsTest, an_alternative_may_be_a_table) {
  ASSERT_EQ(load(with(kTwo, "or = \"2\"", "or = { robot = \"right\", scanner = \"2\" }")), Texts{});
  EXPECT_THAT(arms_of(9), ElementsAre(0, 1));
}

TEST_F(ArmsTest, a_scanner_that_is_only_an_alternative_is_on_the_robot_that_is_left) {
  ASSERT_EQ(load(kCell + kCalibration + kRobots + kScanners +
                 "[[station]]\nnumbers = \"1..18\"\nrobot = \"1\"\nscanner = \"1\"\nor = \"2\"\n"),
            Texts{});
  EXPECT_EQ(config_.arms.list[1], (Arm{PartId("right"), PartId("2")}));
  EXPECT_THAT(arms_of(18), ElementsAre(0, 1));
}

TEST_F(ArmsTest, one_listed_robot_and_scanner_need_no_stations) {
  ASSERT_EQ(load(kCell + "[[robot]]\nid = \"kuka\"\n"
                         "[[scanner]]\nid = \"left\"\nT_flange_scanner = [0, 0, 130, 1, 0, 0, 0]\n"),
            Texts{});
  ASSERT_EQ(config_.arms.list.size(), 1U);
  EXPECT_EQ(config_.by, (Arm{PartId("kuka"), PartId("left")}));
  EXPECT_EQ(config_.calibration.T_flange_scanner.translation_mm.z(), 130.0);
}

TEST_F(ArmsTest, a_table_and_a_list_together_are_refused) {
  EXPECT_FALSE(load(kTwo + "[robot]\nchannel = \"X\"\n").empty());
  EXPECT_FALSE(load("[scanner]\ntimeout_s = 9\n" + kTwo).empty());
}

TEST_F(ArmsTest, an_id_is_short_plain_and_unique) {
  EXPECT_THAT(load(with(kTwo, "id = \"right\"", "id = \"the right\"")).at(0), HasSubstr("robot.id: found"));
  EXPECT_THAT(load(with(kTwo, "id = \"right\"", "id = \"a-name-of-17-byte\"")).at(0), HasSubstr("1..16 bytes"));
  EXPECT_THAT(load(with(kTwo, "id = \"2\"", "id = \"1\"")).at(0), HasSubstr("\"1\" twice"));
  EXPECT_THAT(load(with(kTwo, "[[robot]]\nid = \"right\"\n", "[[robot]]\n")).at(0), HasSubstr("robot.id: missing"));
  EXPECT_THAT(load(kCell + "[robot]\nid = \"2\"\n").at(0), HasSubstr("unknown key"));
}

TEST_F(ArmsTest, more_than_two_robots_are_refused) {
  const Texts problems = load(kTwo + "[[robot]]\nid = \"3\"\nchannel = \"C\"\n");
  ASSERT_FALSE(problems.empty());
  EXPECT_THAT(problems[0], HasSubstr("found 3 tables [[robot]], allowed are 2"));
}

TEST_F(ArmsTest, two_robots_need_stations) {
  EXPECT_THAT(problem_of(kCell + kCalibration + kRobots + kScanners), HasSubstr("station: missing; expected"));
}

TEST_F(ArmsTest, every_station_is_named_exactly_once) {
  EXPECT_THAT(problem_of(with(kTwo, "10, 11..18", "10, 11..16")), HasSubstr("stations 17, 18 are in no [[station]]"));
  EXPECT_THAT(problem_of(with(kTwo, "10, 11..18", "9..18")), HasSubstr("found station 9 a second time"));
  for (const char* wrong : {"0..8", "1..19", "8..1", "1..8, 3", "1...8", "one", "1..", ",", "1..8,"})
    EXPECT_THAT(problem_of(with(kTwo, "\"1..8\"", "\"" + std::string(wrong) + "\"")),
                HasSubstr("allowed are ranges of stations 1..18"))
        << wrong;
  EXPECT_THAT(problem_of(with(kTwo, "number = 9", "number = 19")), HasSubstr("station.number: found 19, allowed is"));
  EXPECT_THAT(problem_of(with(kTwo, "number = 9", "number = 9\nnumbers = \"9\"")), HasSubstr("none or both"));
  EXPECT_THAT(problem_of(with(kTwo, "number = 9\n", "")), HasSubstr("none or both"));
}

TEST_F(ArmsTest, a_station_names_a_known_robot_and_scanner) {
  EXPECT_THAT(problem_of(with(kTwo, "\"10, 11..18\"\nrobot = \"right\"", "\"10, 11..18\"\nrobot = \"2\"")),
              HasSubstr("station.robot: found \"2\", allowed is one of \"1\", \"right\""));
  EXPECT_THAT(problem_of(with(kTwo, "or = \"2\"", "or = \"3\"")),
              HasSubstr("station.or: found \"3\", allowed is one of \"1\", \"2\""));
  EXPECT_THAT(problem_of(with(kTwo, "\"10, 11..18\"\nrobot = \"right\"\n", "\"10, 11..18\"\n")),
              HasSubstr("station.robot: missing"));
  EXPECT_THAT(problem_of(with(kTwo, "or = \"2\"", "or = \"1\"")), HasSubstr("allowed are the others"));
  EXPECT_THAT(problem_of(with(kTwo, "or = \"2\"", "other = \"2\"")), HasSubstr("unknown key"));
}

TEST_F(ArmsTest, a_scanner_is_on_one_robot_and_a_robot_has_one_scanner) {
  EXPECT_THAT(load(with(kTwo, "robot = \"right\"\nscanner = \"2\"", "robot = \"right\"\nscanner = \"1\"")).at(0),
              HasSubstr("found scanner \"1\" on robot \"1\" and on robot \"right\""));
  EXPECT_THAT(load(with(kTwo, "or = \"2\"", "or = { robot = \"1\", scanner = \"2\" }")).at(0),
              HasSubstr("found scanner \"2\" on robot \"right\" and on robot \"1\""));
}

TEST_F(ArmsTest, a_robot_that_scans_nothing_is_refused) {
  const Texts problems = load(kCell + kCalibration + kRobots + kScanners +
                              "[[station]]\nnumbers = \"1..18\"\nrobot = \"1\"\nscanner = \"1\"\n");
  ASSERT_EQ(problems.size(), 2U);
  EXPECT_THAT(problems[0], HasSubstr("robot \"right\" scans no station"));
  EXPECT_THAT(problems[1], HasSubstr("scanner \"2\" scans no station"));
}

TEST_F(ArmsTest, arms_do_not_share_channel_folder_or_port) {
  EXPECT_THAT(problem_of(with(kTwo, "channel = \"FLANGE_POSE_2\"\n", "")), HasSubstr("robot.channel: found channel"));
  EXPECT_EQ(load(with(kTwo, "channel = \"FLANGE_POSE_2\"", "lcm_url = \"udpm://239.255.76.68:7668?ttl=0\"")), Texts{})
      << "the same channel at another address";
  const std::string drop = with(kTwo, "backend = \"tcp\"\nlisten = \"127.0.0.1:1505\"", "drop_dir = \"/srv/drop-2\"");
  EXPECT_EQ(load(drop), Texts{});
  EXPECT_THAT(problem_of(with(drop, "/srv/drop-2", "/srv/drop-1")), HasSubstr("scanner.drop_dir: found"));
  EXPECT_THAT(problem_of(with(drop, "/srv/drop-2", "/srv/drop-1/right")), HasSubstr("scanner.drop_dir: found"));
  const std::string tcp = with(kTwo, "drop_dir = \"/srv/drop-1\"", "backend = \"tcp\"\nlisten = \"127.0.0.1:1504\"");
  EXPECT_EQ(load(tcp), Texts{});
  EXPECT_THAT(problem_of(with(tcp, "127.0.0.1:1505", "0.0.0.0:1504")), HasSubstr("scanner.listen: found"));
}

TEST_F(ArmsTest, the_checks_of_a_scanner_apply_to_each) {
  EXPECT_THAT(problem_of(with(kTwo, "timeout_s = 7", "timeout_s = 12")), HasSubstr("allowed are 19 s"));
  EXPECT_THAT(problem_of(with(kTwo, "127.0.0.1:1505", "127.0.0.1:1502")), HasSubstr("plc.listen"));
  const std::string drop = with(kTwo, "backend = \"tcp\"\nlisten = \"127.0.0.1:1505\"", "drop_dir = \"/srv/two\"");
  EXPECT_FALSE(load(drop + "[storage]\nspool_dir = \"/srv/two/spool\"\n").empty());
}

TEST_F(ArmsTest, commissioning_values_belong_to_one_place) {
  EXPECT_THAT(problem_of(with(kTwo, "drop_dir = \"/srv/drop-1\"",
                              "drop_dir = \"/srv/drop-1\"\nT_flange_scanner = [0, 0, 99, 1, 0, 0, 0]")),
              HasSubstr("allowed is calibration.T_flange_scanner"));
  EXPECT_THAT(problem_of(kCell + kCalibration + "[[scanner]]\nid = \"left\"\n"),
              HasSubstr("no scanner has the id \"1\""));
  EXPECT_THAT(load(kCell + "[scanner]\nT_flange_scanner = [0, 0, 130, 1, 0, 0, 0]\n").at(0), HasSubstr("unknown key"));
}

TEST_F(ArmsTest, the_example_of_a_line_with_two_robots_is_good) {
  std::vector<Problem> problems;
  load_config(places::source_dir() + "/systemd/slabd-two-robots.toml", config_, problems);
  EXPECT_EQ(files_.texts(problems), Texts{});
  ASSERT_EQ(config_.arms.list.size(), 2U);
  EXPECT_THAT(arms_of(9), ElementsAre(0));
  EXPECT_THAT(arms_of(12), ElementsAre(1, 0));
  EXPECT_THAT(arms_of(18), ElementsAre(1));
}

}  // namespace
}  // namespace slabd::config
