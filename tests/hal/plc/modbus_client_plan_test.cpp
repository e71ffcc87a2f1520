// SPDX-License-Identifier: Apache-2.0
#include "hal/plc/modbus_client_plan.h"

#include <gtest/gtest.h>

namespace slabd::hal {
namespace {

constexpr std::int64_t kMs = kNsPerMs;

struct ClientPlanTest : ::testing::Test {
  ClientPlan plan{50 * kMs};
  InputImage image{};
  std::int64_t now = kNsPerS;

  ClientStep step() { return plan.next(now, image).step; }
  /// Carries out the plan until it waits; returns the steps.
  std::vector<ClientStep> work() {
    std::vector<ClientStep> done;
    for (ClientStep d = step(); d != ClientStep::wait && done.size() < 20; d = step()) {
      done.push_back(d);
      if (d == ClientStep::connect) plan.connected(now);
      if (d == ClientStep::write_all) plan.wrote_all(now, image);
      if (d == ClientStep::write_head) plan.wrote_head(now, image);
      if (d == ClientStep::read) plan.has_read(now);
    }
    return done;
  }
};

using Deeds = std::vector<ClientStep>;
using enum ClientStep;

TEST_F(ClientPlanTest, a_new_connection_gets_the_whole_image_and_is_read) {
  EXPECT_EQ(work(), (Deeds{connect, write_all, read}));
}

TEST_F(ClientPlanTest, polls_at_its_period_and_beats_at_least_twice_a_second) {
  work();
  int reads = 0;
  int heads = 0;
  for (int ms = 1; ms <= 2000; ++ms) {
    now += kMs;
    for (const ClientStep d : work()) {
      reads += d == read ? 1 : 0;
      heads += d == write_head ? 1 : 0;
      EXPECT_NE(d, write_all);
    }
  }
  EXPECT_EQ(reads, 40);
  EXPECT_EQ(heads, 4);
}

TEST_F(ClientPlanTest, a_moved_heartbeat_writes_the_head_and_any_other_change_everything) {
  work();
  ++image[4];
  EXPECT_EQ(work(), Deeds{write_head});
  for (std::size_t i = 22; i <= 25; ++i) ++image[i];
  EXPECT_EQ(work(), Deeds{}) << "the time alone is not news";
  for (std::size_t i = 0; i < image.size(); ++i) {
    if (i == 4 || (i >= 22 && i <= 25)) continue;
    ++image[i];
    EXPECT_EQ(work(), Deeds{write_all}) << "IR " << i;
  }
}

TEST_F(ClientPlanTest, after_a_loss_only_the_present_image_is_written) {
  work();
  image[10] = 7;
  EXPECT_EQ(step(), write_all);
  plan.failed(now);  // it broke in the middle: the PLC may have the write or not
  image[10] = 8;
  EXPECT_EQ(step(), wait);
  now += 200 * kMs;
  EXPECT_EQ(work(), (Deeds{connect, write_all, read})) << "once, though two changes were pending";
}

TEST_F(ClientPlanTest, waits_longer_after_every_failure_and_briefly_again_after_a_success) {
  std::vector<std::int64_t> pauses;
  for (int i = 0; i < 8; ++i) {
    EXPECT_EQ(step(), connect);
    plan.failed(now);
    const ClientPlan::Next next = plan.next(now, image);
    ASSERT_EQ(next.step, wait);
    pauses.push_back((next.until_ns - now) / kMs);
    now = next.until_ns - 1;
    EXPECT_EQ(step(), wait);
    now += 1;
  }
  EXPECT_EQ(pauses, (std::vector<std::int64_t>{200, 400, 800, 1600, 3200, 5000, 5000, 5000}));
  // A connection without an answer does not count as a success.
  plan.connected(now);
  plan.failed(now);
  EXPECT_EQ(plan.next(now, image).until_ns - now, 5000 * kMs);
  now += 5000 * kMs;
  work();
  plan.failed(now);
  EXPECT_EQ(plan.next(now, image).until_ns - now, 200 * kMs);
}

}  // namespace
}  // namespace slabd::hal
