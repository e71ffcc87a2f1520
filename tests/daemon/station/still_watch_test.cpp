// SPDX-License-Identifier: Apache-2.0
#include "daemon/station/still_watch.h"

#include <gtest/gtest.h>

#include <cmath>
#include <string>

#include "base/prng.h"

namespace slabd::daemon {
namespace {

/// Poses at `rate_hz`, whose members a test may change.
class Sender {
 public:
  explicit Sender(double rate_hz = 250.0) : step_ns_(static_cast<std::int64_t>(1e9 / rate_hz)) {}
  PoseSample next() {
    now_ns += step_ns_;
    PoseSample sample;
    sample.arrival_ns = now_ns;
    sample.utime_us = now_ns / 1000 + 77'000'000;
    sample.seq = ++seq;
    sample.T_base_flange = pose;
    return sample;
  }
  std::int64_t now_ns = kNsPerS;
  std::int32_t seq = 0;
  Pose pose{Quat(0.3, 0.5, -0.7, 0.4).normalized(), Vec3(1500.0, 200.0, 900.0)};

 private:
  std::int64_t step_ns_;
};

TEST(StillWatch, settles_after_its_time_at_any_rate) {
  for (const double rate_hz : {25.0, 125.0, 250.0, 2000.0}) {
    StillWatch watch({}, {});
    Sender sender(rate_hz);
    int count = 0;
    while (!watch.settled() && count < 10'000) {
      watch.add(sender.next());
      ++count;
    }
    EXPECT_NEAR(count / rate_hz, 1.0, 1.1 / rate_hz + 1e-3) << rate_hz;
  }
}

TEST(StillWatch, a_few_poses_do_not_prove_standstill) {
  PoseSettings slow;
  slow.gap_us = 1'000'000;
  StillWatch watch({}, slow);
  Sender sender(5.0);
  for (int i = 0; i < 15; ++i) watch.add(sender.next());
  EXPECT_FALSE(watch.settled());
}

TEST(StillWatch, mean_and_spread_are_those_of_the_stretch) {
  CaptureGuard guard;
  StillWatch watch(guard, {});
  Sender sender;
  const Pose stood = sender.pose;
  Prng random(5);
  Vec3 sum_mm = Vec3::Zero();
  double low = 1e9;
  double high = -1e9;
  constexpr int kCount = 400;
  for (int i = 0; i < kCount; ++i) {
    const Vec3 off(0.003 * random.uniform(), 0.006 * random.uniform(), 0.0);
    const double turn = rad_from_deg(0.0008) * random.uniform();
    sender.pose.translation_mm = stood.translation_mm + off;
    sender.pose.rotation = Quat(Eigen::AngleAxisd(turn, Vec3::UnitX())) * stood.rotation;
    sum_mm += off;
    low = std::min(low, off.y());
    high = std::max(high, off.y());
    watch.add(sender.next());
  }
  ASSERT_TRUE(watch.settled());
  EXPECT_EQ(watch.samples(), static_cast<std::uint32_t>(kCount));
  EXPECT_NEAR((watch.mean().translation_mm - stood.translation_mm - sum_mm / kCount).norm(), 0.0, 1e-9);
  EXPECT_NEAR(watch.range().mm(), high - low, 1e-9);
  EXPECT_NEAR(deg_from_rad(angle_between_rad(watch.mean().rotation, stood.rotation)), 0.0004, 5e-5);
}

TEST(StillWatch, sign_of_a_quaternion_is_not_motion) {
  StillWatch watch({}, {});
  Sender sender;
  for (int i = 0; i < 300; ++i) {
    sender.pose.rotation.coeffs() = -sender.pose.rotation.coeffs();
    watch.add(sender.next());
  }
  EXPECT_TRUE(watch.settled());
  EXPECT_EQ(watch.range().rad(), 0.0);
}

TEST(StillWatch, a_slow_drift_never_settles_however_slow_each_step) {
  StillWatch watch({}, {});
  Sender sender;
  bool settled = false;
  for (int i = 0; i < 5'000; ++i) {
    sender.pose.translation_mm.z() += 0.012 / 250.0;  // 0.012 mm a second
    watch.add(sender.next());
    settled = settled || watch.settled();
  }
  EXPECT_FALSE(settled);
  EXPECT_NEAR(watch.recent().mm(), 0.012, 0.001);
}

TEST(StillWatch, whatever_breaks_the_stretch_is_remembered_from_the_mark_on) {
  using Break = StillWatch::Break;
  const auto broken = [](auto change) {
    StillWatch watch({}, {});
    Sender sender;
    for (int i = 0; i < 300; ++i) watch.add(sender.next());
    EXPECT_TRUE(watch.settled());
    watch.mark();
    EXPECT_EQ(watch.first_break().by, Break::none);
    PoseSample sample = sender.next();
    change(sample, sender);
    watch.add(sample);
    EXPECT_FALSE(watch.settled());
    EXPECT_FALSE(watch.describe(watch.first_break()).empty());
    return watch.first_break().by;
  };
  EXPECT_EQ(broken([](PoseSample& s, Sender&) { s.T_base_flange.translation_mm.x() += 0.0101; }), Break::moved);
  EXPECT_EQ(broken([](PoseSample& s, Sender&) { s.seq += 1; }), Break::gap);
  EXPECT_EQ(broken([](PoseSample& s, Sender&) { s.seq -= 1; }), Break::gap);
  EXPECT_EQ(broken([](PoseSample& s, Sender&) { s.utime_us += 200'000; }), Break::gap);
  EXPECT_EQ(broken([](PoseSample& s, Sender&) { s.utime_us -= 200'000; }), Break::gap);
  EXPECT_EQ(broken([](PoseSample& s, Sender&) { s.estop = true; }), Break::estop);
  EXPECT_EQ(broken([](PoseSample& s, Sender&) { s.tool_id = 2; }), Break::wrong_frame);
  EXPECT_EQ(broken([](PoseSample& s, Sender&) { s.base_id = 1; }), Break::wrong_frame);
}

/// Description of the first break after mark(); `change` causes it and may continue.
template <typename Change>
std::string said_of_first(Change change) {
  StillWatch watch({}, {});
  Sender sender;
  for (int i = 0; i < 300; ++i) watch.add(sender.next());
  EXPECT_TRUE(watch.settled());
  watch.mark();
  change(watch, sender);
  return watch.describe(watch.first_break()).c_str();
}

TEST(StillWatch, the_first_break_is_reported_unchanged_whatever_comes_after_it) {
  const std::string wrong_frame = said_of_first([](StillWatch& watch, Sender& sender) {
    PoseSample other = sender.next();
    other.base_id = 3;
    watch.add(other);
    for (int i = 0; i < 300; ++i) watch.add(sender.next());
  });
  EXPECT_EQ(wrong_frame, "base 3 and tool 0 are active, the flange in the robot root are base 0 and tool 0");

  const std::string lost = said_of_first([](StillWatch& watch, Sender& sender) {
    for (const int missing : {100, 3}) {
      sender.seq += missing;
      for (int i = 0; i < 10; ++i) watch.add(sender.next());
    }
  });
  EXPECT_TRUE(lost.starts_with("poses were lost or arrived twice: number 300 was followed by 401,")) << lost;
}

TEST(StillWatch, a_drive_is_reported_with_its_whole_length) {
  const std::string drove = said_of_first([](StillWatch& watch, Sender& sender) {
    const Pose stood = sender.pose;
    for (int i = 0; i <= 800; ++i) {  // 50 mm in two seconds, then at rest
      const double way = i < 500 ? 0.5 - 0.5 * std::cos(kPi * i / 500.0) : 1.0;
      sender.pose.translation_mm = stood.translation_mm + Vec3(0.0, -50.0 * way, 0.0);
      sender.pose.rotation = Quat(Eigen::AngleAxisd(rad_from_deg(2.0 * way), Vec3::UnitZ())) * stood.rotation;
      watch.add(sender.next());
    }
    EXPECT_TRUE(watch.settled());
  });
  EXPECT_TRUE(drove.starts_with("it moved 50.000 mm along base y and turned 2.0000 deg about base z,")) << drove;

  // Poses of another tool do not count for the flange's motion.
  const std::string jolt = said_of_first([](StillWatch& watch, Sender& sender) {
    sender.pose.translation_mm.x() += 0.5;
    watch.add(sender.next());
    PoseSample other = sender.next();
    other.tool_id = 1;
    other.T_base_flange.translation_mm.x() += 200.0;
    watch.add(other);
  });
  EXPECT_TRUE(jolt.starts_with("it moved 0.500 mm along base x")) << jolt;
}

TEST(StillWatch, last_break_is_described_as_it_was) {
  StillWatch watch({}, {});
  Sender sender;
  PoseSample other = sender.next();
  other.base_id = 3;
  watch.add(other);
  watch.add(sender.next());
  EXPECT_TRUE(watch.describe(watch.last_break()).view().starts_with("base 3 and tool 0 are active"));
}

TEST(StillWatch, a_bridge_that_sends_a_queue_of_old_poses_is_refused) {
  StillWatch watch({}, {});
  Sender sender;
  bool settled = false;
  for (int i = 0; i < 2'000; ++i) {
    PoseSample sample = sender.next();
    sample.utime_us = 77'000'000 + i * 8'000;  // two seconds of sending arrive in one
    watch.add(sample);
    settled = settled || watch.settled();
  }
  EXPECT_FALSE(settled);
  EXPECT_EQ(watch.last_break().by, StillWatch::Break::clock);
}

TEST(StillWatch, a_robot_with_the_stopped_flag_must_set_it) {
  StillWatch watch({}, {});
  Sender sender;
  for (int i = 0; i < 400; ++i) {
    PoseSample sample = sender.next();
    sample.stopped = i < 10;
    watch.add(sample);
  }
  EXPECT_FALSE(watch.settled());
  EXPECT_EQ(watch.last_break().by, StillWatch::Break::not_stopped);
}

}  // namespace
}  // namespace slabd::daemon
