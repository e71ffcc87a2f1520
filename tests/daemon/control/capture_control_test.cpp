// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "base/prng.h"
#include "daemon/loop.h"

namespace slabd::daemon {
namespace {

using nlohmann::json;

CaptureRequest parsed(const char* line) {
  const Result<CaptureRequest> request = parse_capture(line, 1000);
  EXPECT_TRUE(request.ok()) << line;
  return request.ok() ? request.value() : CaptureRequest{};
}

TEST(CaptureControl, requests_are_understood) {
  const CaptureRequest begin = parsed(
      R"({"verb":"capture","action":"begin","session":"spring","operator":"anna","lease_s":120,"take_over":true})");
  EXPECT_EQ(begin.action, CaptureRequest::Action::begin);
  EXPECT_EQ(begin.session.view(), "spring");
  EXPECT_EQ(begin.operator_name.view(), "anna");
  EXPECT_EQ(begin.lease_s, 120);
  EXPECT_TRUE(begin.take_over);
  EXPECT_EQ(begin.uid, 1000U);
  EXPECT_EQ(parsed(R"({"action":"begin","session":"s","operator":"a"})").lease_s, 300);
  EXPECT_EQ(parsed(R"({"action":"release","session":"s","scan":"/spool/capture/1-1.ply"})").scan.view(),
            "/spool/capture/1-1.ply");
  EXPECT_EQ(parsed(R"({"action":"state","session":"s"})").action, CaptureRequest::Action::keep);
}

TEST(CaptureControl, errors_are_named_and_not_truncated) {
  const auto error_of = [](const std::string& line, std::uint32_t uid = 1000) {
    const Result<CaptureRequest> request = parse_capture(line, uid);
    EXPECT_FALSE(request.ok()) << line;
    return request.ok() ? std::string() : std::string(request.error().text.view());
  };
  EXPECT_NE(error_of(R"({"session":"s"})").find("begin, shoot, state, release, end"), std::string::npos);
  EXPECT_NE(error_of(R"({"action":"shoot"})").find("\"session\""), std::string::npos);
  EXPECT_NE(error_of(R"({"action":"shoot","session":")" + std::string(101, 'x') + "\"}").find("1..100"),
            std::string::npos);
  EXPECT_NE(error_of(R"({"action":"begin","session":"s"})").find("\"operator\""), std::string::npos);
  EXPECT_NE(error_of(R"({"action":"begin","session":"s","operator":"a","lease_s":"x"})").find("\"lease_s\""),
            std::string::npos);
  EXPECT_NE(error_of(R"({"action":"release","session":"s"})").find("\"scan\""), std::string::npos);
  EXPECT_NE(error_of(R"({"action":"begin","session":"s","operator":"a"})", hal::ControlPort::kUidUnknown)
                .find("user of this request"),
            std::string::npos);
}

TEST(CaptureControl, the_answer_describes_a_view_and_is_valid_for_any_text) {
  Station station{StationSettings{}};
  station.recovered = true;
  station.capture.phase = Capture::Phase::ready;
  station.capture.session = "spring \xff";
  CaptureShot& shot = station.capture.shot;
  shot.number = 3;
  shot.done = true;
  shot.scan_path = "/spool/capture/1-1.ply";
  shot.T_base_flange = Pose::from_array({1.0, 2.0, 3.0, 0.5, 0.5, 0.5, 0.5});
  shot.spread_mm = 0.004;
  shot.last.tool_id = 2;
  shot.pose_age_us = 3'000'000;
  const json answer = json::parse(capture_json(station));
  EXPECT_EQ(answer["schema"], "slabd.capture/1");
  EXPECT_EQ(answer["phase"], "ready");
  EXPECT_EQ(answer["shot"]["number"], 3);
  EXPECT_EQ(answer["shot"]["ok"], true);
  EXPECT_EQ(answer["shot"]["T_base_flange"].size(), 7U);
  ASSERT_EQ(answer["shot"]["warnings"].size(), 2U);
  EXPECT_NE(answer["shot"]["warnings"][0].get<std::string>().find("tool 2"), std::string::npos);
  EXPECT_NE(answer["shot"]["warnings"][1].get<std::string>().find("3.0 s old"), std::string::npos);

  shot.code = Code::not_settled;
  shot.text = "the robot is not at rest";
  const json refused = json::parse(capture_json(station));
  EXPECT_EQ(refused["shot"]["ok"], false);
  EXPECT_EQ(refused["shot"]["code"], 203);
  EXPECT_FALSE(refused["shot"].contains("scan")) << "a refused view has nothing to take";
}

TEST(CaptureControl, garbage_does_not_stop_the_parser) {
  Prng prng(17);
  const std::string good = R"({"verb":"capture","action":"begin","session":"spring","operator":"anna","lease_s":120})";
  for (int i = 0; i < 2'000; ++i) {
    std::string line = good;
    for (std::uint64_t hits = 1 + prng.below(3); hits > 0; --hits)
      line[prng.below(line.size())] = static_cast<char>(prng.below(256));
    static_cast<void>(parse_capture(line, 1));
  }
}

}  // namespace
}  // namespace slabd::daemon
