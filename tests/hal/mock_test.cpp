// SPDX-License-Identifier: Apache-2.0
#include "tests/mock/mock.h"

#include <gtest/gtest.h>

#include <thread>

#include "tests/hal/temporary_folder.h"

namespace slabd::hal {
namespace {

TEST(Mock, clock_moves_only_on_request) {
  ManualClock clock;
  const std::int64_t mono = clock.mono_ns();
  const std::int64_t utime = clock.utime_us();
  EXPECT_EQ(clock.mono_ns(), mono);
  clock.advance(ns_from_ms(5));
  EXPECT_EQ(clock.mono_ns(), mono + 5'000'000);
  EXPECT_EQ(clock.utime_us(), utime + 5'000);
  clock.set_utime_us(1);
  EXPECT_EQ(clock.utime_us(), 1);
  EXPECT_EQ(clock.mono_ns(), mono + 5'000'000);
}

TEST(Mock, plc_gives_writes_in_order_and_keeps_what_was_published) {
  MockPlc plc;
  PlcInputs inputs;
  inputs.cmd_seq = 1;
  plc.write(inputs);
  inputs.cmd_seq = 2;
  plc.write(inputs);
  PlcInputs seen;
  ASSERT_TRUE(plc.next(0, seen));
  EXPECT_EQ(seen.cmd_seq, 1);
  ASSERT_TRUE(plc.next(0, seen));
  EXPECT_EQ(seen.cmd_seq, 2);
  EXPECT_FALSE(plc.next(0, seen));
  PlcOutputs out;
  out.cmd_ack = 2;
  plc.publish(out);
  ASSERT_EQ(plc.published.size(), 1U);
  EXPECT_EQ(plc.published[0].cmd_ack, 2);
}

TEST(Mock, pose_gives_samples_when_their_time_has_come) {
  MockPose pose;
  PoseSample sample;
  sample.arrival_ns = 10;
  pose.push(sample);
  EXPECT_FALSE(pose.next(9, sample));
  pose.link_trouble = "unplugged";
  EXPECT_FALSE(pose.next(10, sample));
  pose.link_trouble.clear();
  EXPECT_TRUE(pose.next(10, sample));
  EXPECT_FALSE(pose.next(11, sample));
}

TEST(Mock, scanner_plays_its_script) {
  test::TemporaryFolder folder;
  ManualClock clock;
  MockScanner scanner(clock);
  const std::vector<float> xyz(3 * limits::kScanPointsMin, 1.0F);
  ASSERT_TRUE(write_ply((folder / "in.ply").c_str(), xyz, 0, 0).ok());
  scanner.answer_with(xyz);
  scanner.answer_with_file(folder / "in.ply", LengthUnit::m);
  scanner.fail_with(Code::exposure);
  scanner.answer_with({1, 2, 3});
  scanner.hang_until_cancelled();

  std::vector<float> out(xyz.size());
  std::atomic<bool> cancel = false;
  ScanRequest request;
  request.spool_path = PathText(folder / "spooled");
  const ScanDecoded ignored = [](const AcquiredScan&) {};
  int told = 0;
  const auto memory = scanner.acquire(request, out, cancel, [&](const AcquiredScan& scan) {
    ++told;
    EXPECT_EQ(scan.path, folder / "spooled.ply");
    EXPECT_EQ(out, xyz);
  });
  ASSERT_TRUE(memory.ok());
  EXPECT_EQ(told, 1);
  EXPECT_EQ(memory.value().path, folder / "spooled.ply");
  EXPECT_TRUE(read_scan(memory.value().path.c_str(), LengthUnit::mm, out).ok());
  request.spool_path.clear();
  ASSERT_TRUE(scanner.acquire(request, out, cancel, ignored).ok());
  EXPECT_EQ(out[0], 1000.0F);
  EXPECT_EQ(scanner.acquire(request, out, cancel, ignored).error().code, Code::exposure);
  EXPECT_EQ(scanner.acquire(request, out, cancel, ignored).error().code, Code::too_few_points);
  std::thread canceller([&] { cancel = true; });
  EXPECT_EQ(scanner.acquire(request, out, cancel, ignored).error().code, Code::interrupted);
  canceller.join();
  EXPECT_EQ(scanner.acquire(request, out, cancel, ignored).error().code, Code::trigger_timeout);
  EXPECT_EQ(scanner.requests.size(), 6U);
}

}  // namespace
}  // namespace slabd::hal
