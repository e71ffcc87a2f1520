// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>
#include <set>
#include <sstream>

#include "base/prng.h"
#include "daemon/loop.h"
#include "tests/mock/mock.h"

namespace slabd::daemon {
namespace {

using nlohmann::json;

class StatusTest : public ::testing::Test {
 protected:
  json ask(const std::string& line) {
    const std::string text = answer_control(line, station_, ports_, figures_, changer_,
                                            [this](const Event& event) { step(station_, event, actions_); });
    EXPECT_EQ(text.find('\n'), std::string::npos) << "an answer is one line";
    const json answer = json::parse(text, nullptr, false);
    EXPECT_TRUE(answer.is_object()) << text;
    return answer;
  }

  hal::ManualClock clock_;
  hal::MockNotify notify_;
  hal::MockPlc plc_;
  hal::MockPose pose_;
  hal::MockScanner scanner_{clock_};
  const Ports ports_{plc_, pose_, scanner_, nullptr, nullptr, clock_, notify_};
  Station station_{StationSettings{}};
  LoopFigures figures_;
  CalibrationChanger changer_{""};
  Actions actions_;
};

TEST_F(StatusTest, status_is_reported) {
  figures_.config_path = "/etc/slabd/slabd.toml";
  const json answer = ask(R"({"verb":"status"})");
  EXPECT_EQ(answer["schema"], "slabd.status/1");
  EXPECT_EQ(answer["state"], "recover");
  EXPECT_EQ(answer["config"], "/etc/slabd/slabd.toml");
  EXPECT_TRUE(answer["slab"].is_null());
}

TEST_F(StatusTest, bytes_that_are_not_text_do_not_stop_the_answer) {
  figures_.config_path = "/etc/\xff\xfe/slabd\xc3.toml";
  figures_.db_path = "/srv/\x80.db";
  pose_.link_trouble = "interface \"\xe4\": no such device";
  station_.slab.phase = SlabPhase::open;
  station_.slab.header.slab_id = "SLAB-\xff";
  const json answer = ask(R"({"verb":"status"})");
  EXPECT_EQ(answer["config"], "/etc/\xef\xbf\xbd\xef\xbf\xbd/slabd\xef\xbf\xbd.toml");
  EXPECT_EQ(answer["slab"]["id"], "SLAB-\xef\xbf\xbd");
}

TEST_F(StatusTest, oddities_of_accepted_poses_are_noted) {
  const auto note = [this](bool measured, bool stopped, int after_ms = 4) {
    station_.now_ns += ns_from_ms(after_ms);
    PoseSample sample;
    sample.arrival_ns = station_.now_ns;
    sample.measured = measured;
    sample.stopped = stopped;
    station_.arms[0].gate.add(sample);
    return ask(R"({"verb":"status"})")["links"]["pose"]["note"].get<std::string>();
  };
  EXPECT_EQ(ask(R"({"verb":"status"})")["links"]["pose"]["note"], "");
  EXPECT_EQ(note(true, false), "");
  EXPECT_EQ(note(true, true), "");
  EXPECT_NE(note(true, false).find("does not say \"stopped\""), std::string::npos);
  EXPECT_EQ(note(true, false, 1'000), "") << "perhaps another program, which does not know the flag";
  EXPECT_NE(note(false, false).find("not measured"), std::string::npos);
  figures_.pose_type = hal::PoseType::rigid_transform;
  EXPECT_EQ(note(false, false), "") << "this message cannot say it";
}

TEST_F(StatusTest, a_line_with_one_arm_lists_it) {
  const json answer = ask(R"({"verb":"status"})");
  ASSERT_EQ(answer["arms"].size(), 1U);
  const json& arm = answer["arms"][0];
  EXPECT_EQ(arm["robot"], "1");
  EXPECT_EQ(arm["scanner"], "1");
  EXPECT_EQ(arm["pose"], answer["links"]["pose"]);
  EXPECT_EQ(arm["scanner_link"], answer["links"]["scanner"]);
  EXPECT_EQ(arm["calibration"], answer["calibration"]);
  EXPECT_EQ(arm["acceptance"], answer["calibration"]["scanner"]);
  EXPECT_TRUE(answer["tie"].is_null());
  const std::string metrics = ask(R"({"verb":"metrics"})")["text"];
  EXPECT_EQ(metrics.find("scanner=\""), std::string::npos) << "no series has a label that a line with one arm lacks";
  EXPECT_EQ(metrics.find("slabd_tie_ok"), std::string::npos);
}

TEST(StatusOfTwoArms, names_the_links_the_calibration_and_the_tie_of_each) {
  hal::ManualClock clock;
  hal::MockNotify notify;
  hal::MockPlc plc;
  hal::MockPose pose;
  hal::MockPose pose_2;
  hal::MockScanner scanner{clock};
  hal::MockScanner scanner_2{clock};
  Ports ports{plc, pose, scanner, nullptr, nullptr, clock, notify};
  ASSERT_TRUE(ports.more_arms.push({&pose_2, &scanner_2}));
  StationSettings settings;
  ASSERT_TRUE(settings.arms.list.push(Arm{PartId("2"), PartId("right")}));
  ASSERT_TRUE(settings.more_arms.push(StationArmSettings{}));
  const auto station = std::make_unique<Station>(settings);
  LoopFigures figures;
  CalibrationChanger changer{""};
  Actions actions;
  const auto ask = [&](const std::string& line) {
    return json::parse(answer_control(line, *station, ports, figures, changer,
                                      [&](const Event& event) { step(*station, event, actions); }));
  };
  LinkStatus online;
  online.scanner_online = true;
  online.stray_files = 3;
  online.arm = 1;
  step(*station, online, actions);
  station->calibration.arm[1].id = "he-2";
  station->calibration.arm[1].scanner.id = "sc-2";
  station->arms[1].scanner_temperature_c = 31.5;
  station->calibration.tie.id = "ti-1";
  station->calibration.tie.numbers.robot = "2";
  json answer = ask(R"({"verb":"status"})");
  ASSERT_EQ(answer["arms"].size(), 2U);
  EXPECT_EQ(answer["arms"][1]["robot"], "2");
  EXPECT_EQ(answer["arms"][1]["scanner"], "right");
  EXPECT_EQ(answer["arms"][1]["scanner_link"]["online"], true);
  EXPECT_EQ(answer["arms"][1]["scanner_link"]["strays"], 3);
  EXPECT_EQ(answer["arms"][0]["scanner_link"]["online"], false);
  EXPECT_EQ(answer["links"]["scanner"]["online"], false) << "the first one's";
  EXPECT_EQ(answer["arms"][1]["calibration"]["id"], "he-2");
  EXPECT_EQ(answer["arms"][1]["acceptance"]["id"], "sc-2");
  EXPECT_EQ(answer["arms"][1]["temperature_c"], 31.5);
  EXPECT_EQ(answer["tie"]["id"], "ti-1");
  EXPECT_EQ(answer["tie"]["robot"], "2");
  EXPECT_NE(answer["tie"]["trouble"], "") << "of other hand-eye calibrations";
  station->calibration.tie.hand_eye_id[1] = "he-2";
  answer = ask(R"({"verb":"status"})");
  EXPECT_EQ(answer["tie"]["trouble"], "");
  EXPECT_EQ(answer["memory"]["inspection_bytes"], limits::kInspectionBytes + limits::kScanSlotBytes);
  const std::string metrics = ask(R"({"verb":"metrics"})")["text"];
  EXPECT_NE(metrics.find("\nslabd_scanner_online 0\nslabd_scanner_online{scanner=\"right\"} 1\n"), std::string::npos)
      << metrics;
  EXPECT_NE(metrics.find("slabd_pose_datagrams_total{what=\"accepted\",scanner=\"right\"} 0\n"), std::string::npos);
  EXPECT_NE(metrics.find("\nslabd_tie_ok 1\n"), std::string::npos);
  const json state = ask(R"({"verb":"calibration"})");
  EXPECT_EQ(state["arms"][1]["in_force"]["id"], "he-2");
  EXPECT_EQ(state["tie"]["id"], "ti-1");
}

TEST_F(StatusTest, stops_that_are_alike_are_reported_with_the_command_that_plans_others) {
  EXPECT_EQ(ask(R"({"verb":"status"})").dump().find("stops alike"), std::string::npos);
  station_.stop_alike = 4;
  const std::string answer = ask(R"({"verb":"status"})").dump();
  EXPECT_NE(answer.find("the robot stops alike over neighbouring blocks"), std::string::npos) << answer;
  EXPECT_NE(answer.find("slabctl stations"), std::string::npos) << answer;
}

TEST_F(StatusTest, metrics_are_written_in_the_prometheus_format) {
  figures_.block_max_ms = 1500.0;
  station_.settings.software = "slabd \"x\\1\"";
  const json answer = ask(R"({"verb":"metrics","reset":true})");
  EXPECT_EQ(answer["schema"], "slabd.metrics/1");
  const std::string text = answer["text"];
  EXPECT_NE(text.find("\nslabd_block_max_seconds 1.5\n"), std::string::npos) << text;
  EXPECT_NE(text.find("slabd_info{software=\"slabd \\\"x\\\\1\\\"\"} 1\n"), std::string::npos) << text;
  // Every metric has one help text, before its first line.
  std::set<std::string> explained;
  std::istringstream lines(text);
  for (std::string line; std::getline(lines, line);) {
    const std::string name =
        line.starts_with("# ") ? line.substr(7, line.find(' ', 7) - 7) : line.substr(0, line.find_first_of(" {"));
    if (line.starts_with("# HELP ")) {
      EXPECT_TRUE(explained.insert(name).second) << name;
    } else {
      EXPECT_TRUE(explained.contains(name)) << line;
    }
  }
  EXPECT_GT(explained.size(), 20U);
  EXPECT_EQ(figures_.block_max_ms, 0.0) << "since the reset";
}

TEST_F(StatusTest, every_request_is_answered) {
  EXPECT_EQ(ask("")["schema"], "slabd.error/1");
  EXPECT_EQ(ask("[]")["schema"], "slabd.error/1");
  EXPECT_EQ(ask("{\"verb\":7}")["schema"], "slabd.error/1");
  EXPECT_EQ(ask("{\"verb\":\"stop\"}")["error"],
            "unknown verb; known: status, calibration, plc_image, metrics, care, backup, prune, sent, recipes, "
            "gauges, gauge_enter, calibration_change, capture");
  EXPECT_EQ(ask("{\"verb\":\"\xff\"}")["schema"], "slabd.error/1");
  EXPECT_EQ(ask(std::string(60'000, '['))["schema"], "slabd.error/1");
  Prng prng(11);
  const std::string good = R"({"verb":"status","number":1e999,"text":"\u00e4"})";
  for (int i = 0; i < 2000; ++i) {
    std::string line = good;
    for (std::uint64_t hits = 1 + prng.below(3); hits > 0; --hits)
      line[prng.below(line.size())] = static_cast<char>(prng.below(256));
    static_cast<void>(ask(line));
  }
}

}  // namespace
}  // namespace slabd::daemon
