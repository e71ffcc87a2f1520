// SPDX-License-Identifier: Apache-2.0
//
// Whole slabs with other roles of slabd: as Modbus client of the emulated PLC, and with both on a serial line (a socat
// pty pair). Tests with independent PLCs are in tests/plc.
#include <gtest/gtest.h>

#include <chrono>
#include <fstream>
#include <nlohmann/json.hpp>
#include <thread>

#include "base/limits.h"
#include "processes.h"

namespace slabd::line {
namespace {

using Json = nlohmann::json;

class RolesLineTest : public testing::Test {
 protected:
  /// Replaces plc.listen by `lines`.
  void give_role(const std::string& lines) {
    std::string text = read_file(box_.config);
    const std::size_t listen = text.find("listen = ");
    ASSERT_NE(listen, std::string::npos);
    text.replace(listen, text.find('\n', listen) - listen, lines);
    std::ofstream(box_.config) << text;
  }
  void start() {
    box_.start();
    for (int i = 0; i < 3'000 && box_.running() && status().is_null(); ++i)
      std::this_thread::sleep_for(std::chrono::milliseconds(20));
    ASSERT_FALSE(status().is_null()) << box_.log();
  }
  [[nodiscard]] Json status() const {
    const Box::Answer answer = box_.slabctl({"status", "--config", box_.config.native(), "--json"});
    return answer.exit_status == 0 ? Json::parse(answer.out, nullptr, false) : Json();
  }
  [[nodiscard]] Box::Answer slab(int number, std::vector<std::string> more = {}) const {
    std::vector<std::string> args = {"simulate", "--config",  box_.config.native(),  "--points",
                                     "quarter",  "--slab-no", std::to_string(number)};
    args.insert(args.end(), more.begin(), more.end());
    return box_.slabctl(args);
  }
  /// Inspects a good slab and a bad one; after the first the daemon's memory must not grow.
  void run_slabs(const std::vector<std::string>& more = {}) {
    const Box::Answer first = slab(1, more);
    ASSERT_EQ(first.exit_status, 0) << first.out << first.err << box_.log();
    const std::int64_t first_kb = anonymous_kb(box_.pid());
    ASSERT_GT(first_kb, 0);
    std::vector<std::string> bad = {"--defect", "slope=4:1/35"};
    bad.insert(bad.end(), more.begin(), more.end());
    EXPECT_EQ(slab(2, bad).exit_status, 1);
    if (!kSanitized) {
      EXPECT_LT(anonymous_kb(box_.pid()), first_kb + 2048);
      EXPECT_LE(1024 * status()["memory"]["peak_kb"].get<std::size_t>(),
                limits::kInspectionBytes + limits::kProcessBytes);
    }
    EXPECT_EQ(box_.stop(), 0);
  }

  Box box_;
};

TEST_F(RolesLineTest, slabs_pass_and_fail_when_slabd_polls_the_plc) {
  give_role("role = \"client\"\nconnect = \"127.0.0.1:" + std::to_string(box_.port) + "\"");
  start();
  run_slabs();
}

TEST_F(RolesLineTest, slabs_pass_and_fail_over_a_serial_line) {
  const fs::path ours = box_.dir / "tty.slabd";
  const fs::path theirs = box_.dir / "tty.plc";
  const Process line(
      {"/usr/bin/socat", "pty,raw,echo=0,link=" + ours.native(), "pty,raw,echo=0,link=" + theirs.native()},
      box_.dir / "socat.out", box_.dir / "socat.err");
  for (int i = 0; i < 3'000 && !(fs::exists(ours) && fs::exists(theirs)); ++i)
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
  ASSERT_TRUE(fs::exists(theirs)) << read_file(box_.dir / "socat.err");
  give_role("role = \"rtu\"\ndevice = \"" + ours.native() + "\"\nparity = \"none\"");
  start();
  EXPECT_EQ(slab(1).exit_status, 2) << "the other end of the line has to be named";
  run_slabs({"--plc-device", theirs.native()});
}

TEST_F(RolesLineTest, a_slabd_that_never_connects_is_reported_by_the_emulated_plc) {
  give_role("role = \"client\"\nconnect = \"127.0.0.1:" + std::to_string(box_.port) + "\"");
  fs::create_directories(box_.dir / "drop" / "request");
  fs::create_directories(box_.dir / "drop" / "inbox");
  const Box::Answer answer = slab(1);
  EXPECT_EQ(answer.exit_status, 4) << answer.err;
  EXPECT_NE(answer.err.find("slabd has not connected"), std::string::npos) << answer.err;
}

}  // namespace
}  // namespace slabd::line
