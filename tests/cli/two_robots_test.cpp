// SPDX-License-Identifier: Apache-2.0
//
// Commands on a line with two robots, without a daemon or with one that answers a status. tests/line has the whole
// line.
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "cli/client/arms.h"
#include "cli/exit.h"
#include "cli/simulate/simulate_arms.h"
#include "tests/cli/chinese.h"
#include "tests/cli/fake_daemon.h"
#include "tests/cli/slabctl_process.h"

namespace slabd::cli {
namespace {

using nlohmann::json;

json arm(const std::string& id, bool works) {
  return {{"robot", id},
          {"scanner", "s" + id},
          {"pose", {{"ok", works}, {"code", works ? 0 : 201}, {"text", works ? "no fault" : "no pose"}, {"lost", 0}}},
          {"scanner_link", {{"online", works}, {"strays", 0}, {"text", works ? "" : "no gateway is connected"}}},
          {"calibration", {{"source", "applied"}, {"id", "he-of-" + id}, {"expires_utime_us", 0}}},
          {"acceptance", nullptr},
          {"temperature_c", works ? json(31.5) : json(nullptr)}};
}

/// A line whose second arm does not work.
json two_arms() {
  json status = {{"schema", "slabd.status/1"}, {"software", "slabd 1.0.0"}, {"state", "idle"}, {"session", 7}};
  status["fault"] = {{"code", 0}, {"text", "no fault"}, {"cure", ""}};
  status["warn"] = json::array();
  status["warn_bits"] = 0;
  status["arms"] = {arm("1", true), arm("2", false)};
  status["tie"] = {{"id", "ti-0123456789ab"}, {"robot", "2"}, {"expires_utime_us", 0}, {"trouble", ""}};
  status["links"]["plc"] = {{"clients", 1}, {"alive", true}, {"trouble", ""}};
  status["links"]["pose"] = status["arms"][0]["pose"];
  status["links"]["scanner"] = status["arms"][0]["scanner_link"];
  status["links"]["store"] = {{"ok", true}, {"text", ""}};
  status["calibration"] = status["arms"][0]["calibration"];
  return status;
}

/// A group in which no other test publishes.
const std::string kLcm = "lcm_url = \"udpm://239.255.76.201:17667?ttl=0\"\ninterface = \"lo\"\n";

struct TwoRobots : Slabctl {
  [[nodiscard]] std::string config() const {
    return write("slabd.toml",
                 "[plc]\nlisten = \"127.0.0.1:1502\"\n"
                 "[[robot]]\nid = \"1\"\n" +
                     kLcm + "[[robot]]\nid = \"2\"\nchannel = \"FLANGE_POSE_2\"\n" + kLcm +
                     "[[scanner]]\nid = \"1\"\ndrop_dir = \"" + file("drop-1") +
                     "\"\n"
                     "[[scanner]]\nid = \"s2\"\ndrop_dir = \"" +
                     file("drop-2") +
                     "\"\n"
                     "[[station]]\nnumbers = \"1..9\"\nrobot = \"1\"\nscanner = \"1\"\n"
                     "[[station]]\nnumbers = \"10..18\"\nrobot = \"2\"\nscanner = \"s2\"\nor = \"1\"\n"
                     "[storage]\ndb = \"" +
                     file("slabd.db") + "\"\nspool_dir = \"" + file("spool") +
                     "\"\n"
                     "[recipes]\ndir = \"" +
                     places::source_dir() +
                     "/recipes\"\n"
                     "[cell]\nT_base_slab = [1800.0, 0.0, 400.0, 1.0, 0.0, 0.0, 0.0]\n"
                     "[calibration]\nT_flange_scanner = [0.0, 0.0, 120.0, 1.0, 0.0, 0.0, 0.0]\n"
                     "[control]\nsocket = \"" +
                     file("c.sock") + "\"\n");
  }
};

TEST_F(TwoRobots, a_status_without_a_list_of_arms_has_one_without_a_name) {
  json status = two_arms();
  EXPECT_EQ(arms_in(status).size(), 2U);
  EXPECT_EQ(arms_in(status)[1].scanner, "s2");
  EXPECT_EQ(arms_in(status)[1].calibration["id"], "he-of-2");
  for (const json& list : {json(nullptr), json::array({arm("1", true)}), json("odd")}) {
    status["arms"] = list;
    const std::vector<ArmStatus<json>> arms = arms_in(status);
    ASSERT_EQ(arms.size(), 1U) << list;
    EXPECT_EQ(arms[0].robot, "");
    EXPECT_EQ(arms[0].pose, status["links"]["pose"]);
  }
  EXPECT_EQ(arms_in(json("odd")).size(), 1U);
}

TEST_F(TwoRobots, status_names_each_robot_and_scanner_in_both_languages) {
  const FakeDaemon daemon(file("c.sock"), two_arms().dump() + "\n");
  const Ended english = run("status --language en --config " + config());
  EXPECT_EQ(english.status, 0) << english.err;
  for (const char* words : {"robot 1", "robot 2", "scanner s1", "scanner s2", "no gateway is connected", "he-of-2",
                            "ti-0123456789ab of robot 2", "31.5 deg C"})
    expect_mentions(english.out, words);
  const Ended chinese = run("status --language zh --config " + config());
  for (const char* words : {"机器人 2", "扫描仪 s2", "基座关联"}) expect_mentions(chinese.out, words);
}

TEST_F(TwoRobots, status_without_a_tie_states_what_that_means) {
  json status = two_arms();
  status["tie"] = nullptr;
  const FakeDaemon daemon(file("c.sock"), status.dump() + "\n");
  expect_mentions(run("status --config " + config()).out, "scans of the second robot cannot be used");
}

TEST_F(TwoRobots, doctor_checks_each_robot_and_scanner_and_the_tie) {
  const auto findings = [&](const json& status) {
    const FakeDaemon daemon(file("c.sock"), status.dump() + "\n");
    const Ended ended = run("doctor --no-write --json --listen-s 0.5 --config " + config());
    EXPECT_EQ(ended.status, kNotReachable) << ended.err;
    return json::parse(ended.out)["findings"];
  };
  const auto health = [](const json& list, const std::string& check, const std::string& words) {
    const auto found = std::find_if(list.begin(), list.end(), [&](const json& finding) {
      return finding["check"] == check && finding["saw"].get<std::string>().find(words) != std::string::npos;
    });
    return found == list.end() ? "absent" : (*found)["health"].get<std::string>();
  };
  json status = two_arms();
  json list = findings(status);
  EXPECT_EQ(health(list, "robot poses", "robot 1: none of channel FLANGE_POSE on"), "failed") << list;
  EXPECT_EQ(health(list, "robot poses", "robot 2: none of channel FLANGE_POSE_2 on"), "failed") << list;
  EXPECT_EQ(health(list, "scanner link", "scanner 1: "), "ok");
  EXPECT_EQ(health(list, "scanner link", "scanner s2: "), "failed");
  EXPECT_EQ(health(list, "calibration", "scanner s2: he-of-2"), "ok");
  EXPECT_EQ(health(list, "tie", "ti-0123456789ab"), "ok");

  status["tie"]["trouble"] = "another hand-eye calibration is in force";
  EXPECT_EQ(health(findings(status), "tie", "another hand-eye"), "failed");
  status["tie"] = nullptr;
  EXPECT_EQ(health(findings(status), "tie", "there is none"), "failed");
  status["arms"] = json::array({arm("1", true)});
  list = findings(status);
  EXPECT_EQ(health(list, "scanner link", "another configuration"), "failed") << "the daemon was not restarted";
}

TEST_F(TwoRobots, commission_names_the_robot_that_is_not_there) {
  const FakeDaemon daemon(file("c.sock"), two_arms().dump() + "\n");
  const json steps = json::parse(run("commission --json --config " + config()).out)["steps"];
  EXPECT_EQ(steps[4]["state"], "open");
  EXPECT_EQ(steps[4]["saw"], "2: no pose");
  EXPECT_EQ(steps[5]["state"], "open");
  EXPECT_EQ(steps[5]["saw"], "s2: no gateway is connected");
}

TEST_F(TwoRobots, the_monitor_of_a_robot_must_be_told_which_one) {
  const Ended none = run("robot monitor --once --config " + config());
  EXPECT_EQ(none.status, kUsage);
  expect_mentions(none.err, "1, 2");
  EXPECT_EQ(run("robot monitor --once --robot 3 --config " + config()).status, kUsage);
  const Ended second = run("robot monitor --once --robot 2 --json --config " + config());
  EXPECT_EQ(second.status, kNotReachable) << second.err;
  EXPECT_EQ(json::parse(second.out)["robot"], "2");
  expect_mentions(second.out, "FLANGE_POSE_2");
}

TEST_F(TwoRobots, the_emulated_line_needs_a_tie) {
  const Ended ended = run("simulate --config " + config());
  EXPECT_EQ(ended.status, kBadInput);
  expect_mentions(ended.err, "robot 2 is not tied");
}

TEST_F(TwoRobots, the_tables_of_an_emulated_tie_are_solved) {
  std::string text = content(config());
  const std::string drop = "drop_dir = \"" + file("drop-2") + "\"\n";
  text.replace(text.find(drop), drop.size(), drop + "T_flange_scanner = [10.0, 20.0, 130.0, 1.0, 0.0, 0.0, 0.0]\n");
  const std::string both = " --config " + write("both.toml", text);
  const Ended written = run("simulate tie --views 8 --out " + file("t") + both);
  ASSERT_EQ(written.status, 0) << written.err;
  EXPECT_EQ(run("simulate tie --out " + file("t") + both).status, kUsage) << "the folder is not empty";
  std::string tables;
  for (const char* name : {"flange1", "target1", "names1", "flange2", "target2", "names2"})
    tables += std::string(" --") + name + " " + file("t/") + name + ".txt";
  const Ended solved = run("calibrate tie --json --robot-sigma-mm 0.03" + tables + both);
  ASSERT_EQ(solved.status, 0) << solved.out << solved.err;
  const json tie = json::parse(solved.out);
  EXPECT_EQ(tie["status"], "ok");
  EXPECT_EQ(tie["targets"].size(), 6U);
  // The second robot is opposite the first one, turned by 180 degrees.
  const std::vector<double> T = tie["T_base_robot"];
  EXPECT_NEAR(T[0], 3600.0, 0.3);
  EXPECT_NEAR(T[1], 0.0, 0.3);
  EXPECT_NEAR(T[2], 0.0, 0.3);
  EXPECT_NEAR(std::abs(T[6]), 1.0, 1e-6);
  EXPECT_LT(tie["s0"].get<double>(), 1.5);
}

TEST(FailScanner, names_a_scanner_and_a_station) {
  LineArms arms;
  (void)arms.list.push({PartId("2"), PartId("right")});
  const auto failure = simulate::parse_failure("right@12", arms, 18);
  ASSERT_TRUE(failure.ok());
  EXPECT_EQ(failure.value().arm, 1U);
  EXPECT_EQ(failure.value().station, 12);
  EXPECT_EQ(simulate::parse_failure("", arms, 18).value().station, 0);
  for (const char* text : {"right", "right@", "right@0", "right@19", "right@1x", "left@3", "@3", "2@3"})
    EXPECT_FALSE(simulate::parse_failure(text, arms, 18).ok()) << text;
}

}  // namespace
}  // namespace slabd::cli
