// SPDX-License-Identifier: Apache-2.0
//
// A study with a real daemon: the emulated robot stays above a block, and slabctl repeats its scan.
#include <gtest/gtest.h>

#include <chrono>
#include <fstream>
#include <nlohmann/json.hpp>
#include <thread>

#include "processes.h"
#include "tests/places/places.h"

namespace slabd::line {
namespace {

using nlohmann::json;

class StudyLineTest : public testing::Test {
 protected:
  json status() const {
    const Box::Answer answer = box_.slabctl({"status", "--config", box_.config.native(), "--json"});
    return answer.exit_status == 0 ? json::parse(answer.out, nullptr, false) : json();
  }
  template <typename Until>
  bool wait_until(const Until& until) const {
    for (int i = 0; i < 3'000; ++i) {
      const json now = status();
      if (now.is_object() && until(now)) return true;
      std::this_thread::sleep_for(std::chrono::milliseconds(20));
    }
    return false;
  }
  /// Robot and scanner, ordered to stay above block 3.
  std::unique_ptr<Process> stand_over_block_3() const {
    // A FIFO that slabctl itself holds open has no end, and slabctl is the process that is ended, not a child of it.
    const std::string orders = (box_.dir / "orders").native();
    const std::string command = "mkfifo '" + orders + "' && exec 0<>'" + orders +
                                "' && echo 'slab 1' >&0 && echo 'station 3' >&0 && exec '" + places::slabctl() +
                                "' simulate --config '" + box_.config.native() +
                                "' --points quarter --stand-by --move-s 0.05 --slabs 1";
    return std::make_unique<Process>(std::vector<std::string>{"/bin/bash", "-c", command}, box_.dir / "cell.out",
                                     box_.dir / "cell.err");
  }
  /// The emulated robot moves by about as much as a view may by default.
  void allow_the_robot_to_stir() const {
    std::string text = read_file(box_.config);
    const std::string table = "[calibration]\n";
    const std::size_t at = text.find(table);
    ASSERT_NE(at, std::string::npos);
    text.insert(at + table.size(), "capture_stable_mm = 0.05\ncapture_stable_deg = 0.005\n");
    std::ofstream(box_.config) << text;
  }
  [[nodiscard]] Box::Answer repeat(const std::vector<std::string>& more) const {
    std::vector<std::string> args = {
        "study", "repeat", "--config", box_.config.native(), "--recipe", places::source_dir() + "/recipes/p5600.toml"};
    args.insert(args.end(), more.begin(), more.end());
    return box_.slabctl(args);
  }

  Box box_;
};

TEST_F(StudyLineTest, repeats_are_scanned_by_the_daemon_and_the_line_is_idle_again) {
  allow_the_robot_to_stir();
  box_.start();
  ASSERT_TRUE(box_.ready()) << box_.log();
  const auto cell = stand_over_block_3();
  ASSERT_TRUE(wait_until([](const json& now) { return now["links"]["pose"]["ok"].get<bool>(); })) << box_.log();
  ASSERT_TRUE(wait_until([&](const json&) {
    return read_file(box_.dir / "cell.out").find("standing 3") != std::string::npos;
  })) << read_file(box_.dir / "cell.err");

  const Box::Answer answer = repeat({"--live", "3", "--count", "3", "--json"});
  ASSERT_EQ(answer.exit_status, 0) << answer.err << box_.log();
  const json study = json::parse(answer.out, nullptr, false);
  ASSERT_TRUE(study.is_object()) << answer.out;
  EXPECT_EQ(study["runs"].size(), 3U);
  bool slope = false;
  for (const json& c : study["characteristics"]) {
    if (c["item"] != "seat_slope") continue;
    slope = true;
    EXPECT_EQ(c["block"], 3);
    EXPECT_EQ(c["n"], 3);
    EXPECT_GT(c["range"].get<double>(), 0.0) << "three scans, not one three times";
    EXPECT_LT(c["range"].get<double>(), 0.002);
  }
  EXPECT_TRUE(slope);
  EXPECT_TRUE(wait_until([](const json& now) { return now["state"] == "idle"; })) << status().dump();
  EXPECT_TRUE(is_emptied(box_.dir / "spool" / "capture")) << "every copy was let go";

  // Half a slab away there is another block, but not at the expected position of block 9.
  const Box::Answer wrong = repeat({"--live", "9", "--count", "2"});
  EXPECT_EQ(wrong.exit_status, 3) << wrong.out;
  EXPECT_NE(wrong.err.find("stand over block 9?"), std::string::npos) << wrong.err;
  EXPECT_TRUE(wait_until([](const json& now) { return now["state"] == "idle"; })) << "also after a refusal";
}

TEST_F(StudyLineTest, without_a_daemon_it_fails_with_status_4) {
  const Box::Answer answer = repeat({"--live", "3", "--count", "2"});
  EXPECT_EQ(answer.exit_status, 4);
  EXPECT_EQ(repeat({"--live", "3", "--block", "4"}).exit_status, 2);
}

}  // namespace
}  // namespace slabd::line
