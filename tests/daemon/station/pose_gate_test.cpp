// SPDX-License-Identifier: Apache-2.0
#include "daemon/station/pose_gate.h"

#include <gtest/gtest.h>

#include "base/prng.h"

namespace slabd::daemon {
namespace {

struct PoseGateTest : testing::Test {
  PoseSettings settings;
  PoseGate gate{settings};
  std::int64_t now_ns = kNsPerS;
  std::int32_t seq = 100;
  int period_ms = 4;
  double jitter_mm = 0.002;
  bool stopped = false;
  Prng prng{3};
  Vec3 at{1000.0, 500.0, 900.0};

  /// The next pose, sent and received at `ns`.
  PoseSample sample_at(std::int64_t ns) {
    PoseSample sample;
    sample.arrival_ns = ns;
    sample.utime_us = ns / 1000;
    sample.seq = ++seq;
    sample.T_base_flange.translation_mm = at;
    return sample;
  }
  void send(int count) {
    for (int i = 0; i < count; ++i) {
      PoseSample sample = sample_at(now_ns += ns_from_ms(period_ms));
      sample.stopped = stopped;
      sample.T_base_flange.translation_mm += jitter_mm * (prng.uniform() - 0.5) * Vec3(1, 1, 1);
      gate.add(sample);
    }
  }
  /// The robot has stood still long enough for a scan, which starts.
  void expose() {
    send(300);
    PoseMean mean;
    ASSERT_EQ(gate.settled(now_ns, mean), Code::ok);
    gate.begin_exposure(mean.T_base_flange);
  }
  Code held_still(std::int64_t taken_ns) {
    PoseMean mean;
    return gate.held_still(taken_ns, mean);
  }
  Code settled() {
    PoseMean mean;
    return gate.settled(now_ns, mean);
  }
};

TEST_F(PoseGateTest, needs_window_and_dwell_and_then_gives_the_mean) {
  EXPECT_EQ(settled(), Code::no_pose);
  send(124);  // 492 ms of history
  EXPECT_EQ(settled(), Code::not_settled);
  send(2);
  PoseMean mean;
  ASSERT_EQ(gate.settled(now_ns, mean), Code::ok);
  EXPECT_GE(mean.samples, 125U);
  EXPECT_LT((mean.T_base_flange.translation_mm - at).norm(), 0.001);
  EXPECT_LT(mean.spread_mm, 0.0021);
}

TEST_F(PoseGateTest, a_move_restarts_the_window) {
  send(200);
  at.x() += 0.1;
  send(100);
  EXPECT_EQ(settled(), Code::not_settled);
  send(30);
  EXPECT_EQ(settled(), Code::ok);
}

TEST_F(PoseGateTest, shaking_more_than_the_limit_never_settles) {
  jitter_mm = 0.1;
  send(500);
  EXPECT_EQ(settled(), Code::not_settled);
}

TEST_F(PoseGateTest, a_lost_sample_or_a_step_back_in_time_restarts_the_window) {
  send(200);
  ++seq;
  send(50);
  EXPECT_EQ(settled(), Code::not_settled);
  send(100);
  EXPECT_EQ(settled(), Code::ok);
}

TEST_F(PoseGateTest, a_slow_sender_gets_a_longer_window) {
  period_ms = 40;
  send(15);  // 560 ms, but 15 samples
  EXPECT_EQ(settled(), Code::not_settled);
  send(6);
  EXPECT_EQ(settled(), Code::ok);
}

TEST_F(PoseGateTest, names_stale_poses_and_wrong_frames) {
  send(200);
  EXPECT_EQ(gate.link(now_ns + settings.stale_ns), Code::ok);
  EXPECT_EQ(gate.link(now_ns + settings.stale_ns + 1), Code::pose_stale);
  PoseSample sample = sample_at(now_ns + kNsPerMs);
  sample.tool_id = 3;
  gate.add(sample);
  EXPECT_EQ(gate.link(sample.arrival_ns), Code::wrong_frame);
}

TEST_F(PoseGateTest, a_sender_that_supplies_the_stopped_flag_is_taken_at_its_word) {
  stopped = true;
  send(200);
  EXPECT_EQ(settled(), Code::ok);
  stopped = false;
  send(10);
  EXPECT_EQ(settled(), Code::not_settled);
}

TEST_F(PoseGateTest, stopped_flag_of_a_sender_is_no_longer_required_after_a_silence) {
  stopped = true;
  send(200);
  stopped = false;
  send(400);
  EXPECT_EQ(settled(), Code::not_settled);
  EXPECT_TRUE(gate.lacks_stopped());
  // A restarted bridge without the flag; another one is not accepted sooner.
  now_ns += PoseGate::kForget_ns;
  send(100);
  EXPECT_FALSE(gate.lacks_stopped());
  EXPECT_EQ(settled(), Code::not_settled) << "the window begins again";
  send(100);
  EXPECT_EQ(settled(), Code::ok);
  // A moving robot does not settle, although its flag was forgotten.
  now_ns += PoseGate::kForget_ns;
  for (int i = 0; i < 300; ++i) {
    at.x() += 0.001;
    send(1);
    EXPECT_EQ(settled(), Code::not_settled);
  }
  stopped = true;
  send(1);
  stopped = false;
  send(1);
  EXPECT_TRUE(gate.lacks_stopped()) << "said again, asked for again";
}

TEST_F(PoseGateTest, silence_in_an_exposure_does_not_end_the_wish_for_stopped) {
  stopped = true;
  expose();
  // The network delayed the poses by a second: by their sender's clock they have no gap.
  const std::int64_t sent_ns = now_ns;
  for (int i = 1; i <= 10; ++i) {
    PoseSample sample = sample_at(sent_ns + ns_from_ms(period_ms * i));
    sample.arrival_ns += PoseGate::kForget_ns;
    gate.add(sample);
  }
  EXPECT_EQ(held_still(sent_ns), Code::moved_during_scan);
}

TEST_F(PoseGateTest, absurd_numbers_from_outside_only_restart_the_window) {
  send(200);
  PoseSample sample;
  sample.arrival_ns = now_ns + 1;
  for (const std::int64_t utime_us :
       {std::numeric_limits<std::int64_t>::max(), std::numeric_limits<std::int64_t>::min()})
    for (const std::int32_t number :
         {std::numeric_limits<std::int32_t>::max(), std::numeric_limits<std::int32_t>::min()}) {
      sample.utime_us = utime_us;
      sample.seq = number;
      gate.add(sample);
    }
  EXPECT_EQ(settled(), Code::not_settled);
}

TEST_F(PoseGateTest, an_emergency_stop_is_not_a_standstill) {
  send(200);
  PoseSample sample = sample_at(now_ns += kNsPerMs);
  sample.estop = true;
  gate.add(sample);
  EXPECT_EQ(settled(), Code::not_settled);
}

TEST_F(PoseGateTest, watches_an_exposure_longer_than_its_ring) {
  expose();
  send(3);
  at.z() += 0.2;
  send(1);
  at.z() -= 0.2;
  send(2000);  // 8 s: the jump has long left the two-second ring
  EXPECT_EQ(held_still(now_ns - 1), Code::moved_during_scan);
}

TEST_F(PoseGateTest, a_sample_sent_before_the_end_of_the_exposure_has_not_seen_it) {
  expose();
  send(20);
  PoseSample late = sample_at(now_ns + ns_from_ms(4));
  const std::int64_t taken_ns = now_ns + ns_from_ms(10);
  late.arrival_ns = now_ns + ns_from_ms(15);  // 11 ms of transport time
  gate.add(late);
  EXPECT_EQ(held_still(taken_ns), Code::pose_stale);
  now_ns += ns_from_ms(10);
  send(1);
  EXPECT_EQ(held_still(taken_ns), Code::ok);
}

TEST_F(PoseGateTest, a_motion_hidden_in_lost_samples_is_not_a_standstill) {
  expose();
  send(20);
  now_ns += settings.gap_us * kNsPerUs;  // a jolt; the robot has returned before the next sample
  send(20);
  EXPECT_EQ(held_still(now_ns - 1), Code::pose_stale);
  send(200);
  EXPECT_EQ(held_still(now_ns - 1), Code::pose_stale) << "this stays unknown";
}

TEST_F(PoseGateTest, a_repeated_sample_is_not_a_new_pose) {
  expose();
  send(1);
  PoseSample old = sample_at(now_ns);
  old.seq = --seq;
  const std::int64_t taken_ns = now_ns;
  for (int i = 0; i < 50; ++i) {
    now_ns += ns_from_ms(period_ms);
    old.arrival_ns = now_ns;
    if (i == 25) old.utime_us -= 1'000;
    gate.add(old);
  }
  EXPECT_EQ(held_still(taken_ns), Code::pose_stale);
}

TEST_F(PoseGateTest, gives_the_mean_over_the_exposure_once_something_newer_has_come) {
  expose();
  send(1000);
  const std::int64_t taken_ns = now_ns;
  EXPECT_EQ(held_still(taken_ns), Code::pose_stale);
  send(1);
  PoseMean mean;
  ASSERT_EQ(gate.held_still(taken_ns, mean), Code::ok);
  EXPECT_EQ(mean.samples, 1001U);
  EXPECT_LT((mean.T_base_flange.translation_mm - at).norm(), 2e-4);
}

TEST_F(PoseGateTest, averages_rotations_of_either_sign) {
  for (int i = 0; i < 200; ++i) {
    PoseSample sample = sample_at(now_ns += 4 * kNsPerMs);
    Quat q = rotation_from_kuka_abc(0.3, 0.2, 0.1);
    if (i % 2 == 0) q.coeffs() = -q.coeffs();
    sample.T_base_flange.rotation = q;
    gate.add(sample);
  }
  PoseMean mean;
  ASSERT_EQ(gate.settled(now_ns, mean), Code::ok);
  EXPECT_LT(angle_between_rad(mean.T_base_flange.rotation, rotation_from_kuka_abc(0.3, 0.2, 0.1)), 1e-12);
}

/// A sender with any rate, up to far more poses a second than slabd stores.
struct PoseRateTest : testing::TestWithParam<int> {
  PoseSettings settings;
  PoseGate gate{settings};
  std::int64_t now_ns = kNsPerS;
  std::int32_t seq = 0;
  Vec3 at{1000.0, 500.0, 900.0};
  Quat turned = Quat::Identity();

  void send_one() {
    now_ns += kNsPerS / GetParam();
    PoseSample sample;
    sample.arrival_ns = now_ns;
    sample.utime_us = now_ns / 1000;
    sample.seq = ++seq;
    sample.T_base_flange.translation_mm = at;
    sample.T_base_flange.rotation = turned;
    gate.add(sample);
  }
  void send_for(std::int64_t ns) {
    for (const std::int64_t end_ns = now_ns + ns; now_ns < end_ns;) send_one();
  }
  Code settled() {
    PoseMean mean;
    return gate.settled(now_ns, mean);
  }
};

TEST_P(PoseRateTest, settles_after_window_and_dwell_and_not_before) {
  send_for(ns_from_ms(490));
  EXPECT_EQ(settled(), Code::not_settled);
  send_for(ns_from_ms(30));
  PoseMean mean;
  ASSERT_EQ(gate.settled(now_ns, mean), Code::ok);
  EXPECT_GE(mean.samples, static_cast<unsigned>(GetParam() / 2));
  EXPECT_LE(mean.samples, static_cast<unsigned>(GetParam() * 52 / 100 + 2)) << "of all poses, each once";
  send_for(ns_from_ms(10'000));
  EXPECT_EQ(settled(), Code::ok);
}

TEST_P(PoseRateTest, the_longest_standstill_that_can_be_configured_settles) {
  settings.window_ns = ns_from_ms(1'500);
  settings.dwell_ns = 0;
  gate = PoseGate(settings);
  send_for(ns_from_ms(3'000));
  EXPECT_EQ(settled(), Code::ok);
}

TEST_P(PoseRateTest, a_single_pose_off_the_place_is_seen_as_long_as_it_is_in_the_window) {
  send_for(kNsPerS);
  ASSERT_EQ(settled(), Code::ok);
  at.y() += 0.04;  // one pose of four thousand a second
  send_one();
  at.y() -= 0.04;
  for (int ms = 0; ms < 480; ms += 20) {
    EXPECT_EQ(settled(), Code::not_settled) << ms;
    send_for(ns_from_ms(20));
  }
  send_for(ns_from_ms(60));
  EXPECT_EQ(settled(), Code::ok);
}

TEST_P(PoseRateTest, a_single_turned_pose_is_seen) {
  send_for(kNsPerS);
  turned = Quat(Eigen::AngleAxisd(rad_from_deg(0.01), Vec3::UnitZ()));
  send_one();
  turned = Quat::Identity();
  send_for(ns_from_ms(400));
  EXPECT_EQ(settled(), Code::not_settled);
  send_for(ns_from_ms(200));
  EXPECT_EQ(settled(), Code::ok);
}

TEST_P(PoseRateTest, the_mean_is_that_of_all_poses) {
  Vec3 sum = Vec3::Zero();
  Prng prng{5};
  const Vec3 place = at;
  const int count = GetParam() * 51 / 100;
  for (int i = 0; i < count; ++i) {
    const Vec3 offset = 0.01 * Vec3(prng.uniform(), prng.uniform(), prng.uniform());
    at = place + offset;
    send_one();
    sum += offset;
  }
  PoseMean mean;
  ASSERT_EQ(gate.settled(now_ns, mean), Code::ok);
  // The window is a few poses shorter than the poses sent.
  EXPECT_LT((mean.T_base_flange.translation_mm - place - sum / count).norm(), 0.01 * 10.0 / count);
  EXPECT_GT(mean.spread_mm, 0.008);
  EXPECT_LT(mean.spread_mm, 0.0101);
}

INSTANTIATE_TEST_SUITE_P(Hz, PoseRateTest, testing::Values(100, 250, 1'000, 2'000, 4'000));

TEST_F(PoseGateTest, a_pose_in_a_wrong_frame_is_not_part_of_the_next_window) {
  send(10);
  PoseSample sample = sample_at(now_ns += ns_from_ms(period_ms));
  sample.tool_id = 3;
  gate.add(sample);
  send(125);  // 496 ms, 500 with the pose in the wrong frame
  EXPECT_EQ(settled(), Code::not_settled);
  send(1);
  EXPECT_EQ(settled(), Code::ok);
}

}  // namespace
}  // namespace slabd::daemon
