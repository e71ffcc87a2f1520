// SPDX-License-Identifier: Apache-2.0
#include "hal/robot/pose_screen.h"

#include <gtest/gtest.h>

#include <string>

namespace slabd::hal {
namespace {

struct PoseScreenTest : testing::Test {
  PoseScreen screen;
  PoseLinkCounters counters;
  PosePublisher robot{0xC0A8'0A02, 41'000};
  PosePublisher other{0xC0A8'0A07, 39'000};
  std::int64_t now_ns = 5 * kNsPerS;
  std::int32_t seq = 10;
  std::int64_t utime_us = 1'000'000;
  Vec3 at{1000.0, 0.0, 500.0};

  bool offer(const PosePublisher& from, std::int32_t number, std::int64_t time_us) {
    PoseSample sample;
    sample.seq = number;
    sample.utime_us = time_us;
    sample.T_base_flange.translation_mm = at;
    return screen.admit(from, now_ns, sample, counters);
  }
  bool send() {
    now_ns += ns_from_ms(4);
    utime_us += 4'000;
    return offer(robot, ++seq, utime_us);
  }
};

TEST_F(PoseScreenTest, poses_of_a_correct_sender_are_used_and_no_fault_is_counted) {
  for (int i = 0; i < 500; ++i) ASSERT_TRUE(send());
  PoseNoteText text;
  EXPECT_FALSE(screen.next_note(now_ns, counters, text));
  EXPECT_TRUE(screen.refusal(now_ns).empty());
}

TEST_F(PoseScreenTest, a_late_old_datagram_is_rejected) {
  ASSERT_TRUE(send());
  ASSERT_TRUE(send());
  EXPECT_FALSE(offer(robot, seq - 1, utime_us - 4'000));
  EXPECT_EQ(counters.time_back, 1U);
  EXPECT_FALSE(offer(robot, seq, utime_us));
  EXPECT_EQ(counters.repeated, 1U);
  EXPECT_TRUE(send());
  EXPECT_EQ(counters.gaps, 0U) << "what was refused does not break the numbering";
}

TEST_F(PoseScreenTest, a_clock_that_was_set_back_is_accepted_after_a_second) {
  ASSERT_TRUE(send());
  utime_us -= 3'600'000'000;
  int refused = 0;
  while (refused < 1'000 && !send()) ++refused;
  EXPECT_NEAR(refused, 249, 2);
  EXPECT_TRUE(send());
}

TEST_F(PoseScreenTest, a_clock_that_does_not_run_is_refused_by_name) {
  ASSERT_TRUE(send());
  EXPECT_FALSE(offer(robot, seq + 1, utime_us));
  EXPECT_EQ(counters.time_back, 1U);
  EXPECT_NE(screen.refusal(now_ns).find("clock"), std::string_view::npos);
  EXPECT_NE(screen.refusal(now_ns).find("192.168.10.2:41000"), std::string_view::npos) << screen.refusal(now_ns);
}

TEST_F(PoseScreenTest, a_utime_in_another_unit_is_refused_by_name) {
  for (const auto& [step, unit] : {std::pair{4'000'000, "nanoseconds"}, {4, "milliseconds"}}) {
    screen = {};
    int believed = 0;
    for (int i = 0; i < 500; ++i) {
      now_ns += ns_from_ms(4);
      believed += offer(robot, ++seq, utime_us += step) ? 1 : 0;
    }
    EXPECT_NEAR(believed, 251, 3) << "a second, until it is known";
    EXPECT_NE(screen.refusal(now_ns).find(unit), std::string_view::npos) << screen.refusal(now_ns);
    EXPECT_GT(counters.time_unit, 200U);
    // With the fault corrected, poses are accepted again.
    for (int i = 0; i < 300; ++i) static_cast<void>(send());
    EXPECT_TRUE(send());
  }
}

TEST_F(PoseScreenTest, a_clock_set_forward_or_messages_in_bursts_are_distinguished_from_another_time_unit) {
  for (int i = 0; i < 2'000; ++i) {
    if (i % 300 == 0) utime_us += i % 600 == 0 ? 3'600'000'000 : 500'000'000;
    now_ns += i % 10 == 0 ? ns_from_ms(40) : 1'000;
    utime_us += 4'000;
    ASSERT_TRUE(offer(robot, ++seq, utime_us)) << i << ' ' << screen.refusal(now_ns);
  }
  EXPECT_EQ(counters.time_unit, 0U);
}

TEST_F(PoseScreenTest, a_new_socket_for_each_message_is_distinguished_from_two_programs) {
  ASSERT_TRUE(send());
  for (int i = 1; i <= 20; ++i) {
    now_ns += ns_from_ms(4);
    static_cast<void>(offer({robot.address, static_cast<std::uint16_t>(robot.port + i)}, ++seq, utime_us += 4'000));
  }
  EXPECT_NE(screen.refusal(now_ns).find("new socket for each message"), std::string_view::npos)
      << screen.refusal(now_ns);
  // Two programs on one computer, each with its own numbers.
  for (int i = 0; i < 20; ++i) {
    now_ns += ns_from_ms(4);
    static_cast<void>(offer({robot.address, static_cast<std::uint16_t>(robot.port + i % 2)}, 500 * (i % 2) + i / 2 + 1,
                            utime_us += 4'000));
  }
  EXPECT_NE(screen.refusal(now_ns).find("two programs"), std::string_view::npos) << screen.refusal(now_ns);
}

TEST_F(PoseScreenTest, a_new_socket_every_few_messages_is_distinguished_from_two_programs) {
  for (const bool numbered : {true, false}) {
    screen = {};
    ASSERT_TRUE(send());
    for (int i = 0; i < 100; ++i) {
      now_ns += ns_from_ms(4);
      const PosePublisher socket{robot.address, static_cast<std::uint16_t>(robot.port + i / 10)};
      static_cast<void>(offer(socket, numbered ? ++seq : 0, utime_us += 4'000));
    }
    EXPECT_NE(screen.refusal(now_ns).find("opens a new socket every few messages"), std::string_view::npos)
        << screen.refusal(now_ns);
  }
}

TEST_F(PoseScreenTest, two_sockets_of_one_program_are_recognized_by_their_numbers) {
  ASSERT_TRUE(send());
  for (int i = 0; i < 20; ++i) {
    now_ns += ns_from_ms(4);
    static_cast<void>(offer({robot.address, static_cast<std::uint16_t>(robot.port + i % 2)}, ++seq, utime_us += 4'000));
  }
  EXPECT_NE(screen.refusal(now_ns).find("uses several sockets in turn"), std::string_view::npos)
      << screen.refusal(now_ns);
}

TEST_F(PoseScreenTest, a_bridge_that_is_restarted_now_and_then_is_not_a_sender_with_new_sockets) {
  for (std::uint16_t run = 0; run < 10; ++run) {
    robot.port = static_cast<std::uint16_t>(42'000 + run);
    seq = 0;
    ASSERT_TRUE(send());
    now_ns += 20 * kNsPerS;
  }
  now_ns -= 20 * kNsPerS;
  EXPECT_FALSE(offer({robot.address, 50'000}, 1, utime_us + 1));
  EXPECT_NE(screen.refusal(now_ns).find("two programs"), std::string_view::npos) << screen.refusal(now_ns);
}

TEST_F(PoseScreenTest, a_utime_in_seconds_is_refused_by_name) {
  utime_us = 1'790'000'000;
  for (int i = 0; i < 2'000; ++i) {
    now_ns += ns_from_ms(4);
    static_cast<void>(offer(robot, ++seq, utime_us + i / 250));
  }
  EXPECT_NE(screen.refusal(now_ns).find("utime counts in seconds and not in microseconds"), std::string_view::npos)
      << screen.refusal(now_ns);
  const std::uint64_t named = counters.time_unit;
  EXPECT_GT(named, 1'000U);
  // With the fault corrected, poses are accepted again.
  for (int i = 0; i < 10; ++i) static_cast<void>(send());
  EXPECT_TRUE(send());
  // A clock that stands still is not a clock in seconds.
  for (int i = 0; i < 2'000; ++i) {
    now_ns += ns_from_ms(4);
    EXPECT_FALSE(i > 0 && i < 200 && offer(robot, ++seq, utime_us));
    static_cast<void>(offer(robot, ++seq, utime_us));
  }
  EXPECT_EQ(counters.time_unit, named);
}

TEST_F(PoseScreenTest, lost_messages_are_counted_one_by_one) {
  ASSERT_TRUE(send());
  seq += 3;
  ASSERT_TRUE(send());
  EXPECT_EQ(counters.gaps, 1U);
  EXPECT_EQ(counters.lost, 3U);
  seq = 0;  // the sender restarted
  ASSERT_TRUE(send());
  EXPECT_EQ(counters.gaps, 2U);
  EXPECT_EQ(counters.lost, 3U);
}

TEST_F(PoseScreenTest, a_jump_is_accepted_when_the_next_pose_confirms_it) {
  ASSERT_TRUE(send());
  at.x() += 400.0;
  EXPECT_FALSE(send());
  EXPECT_EQ(counters.jumps, 1U);
  EXPECT_NE(screen.refusal(now_ns).find("a jump of 400.0 mm"), std::string_view::npos) << screen.refusal(now_ns);
  EXPECT_TRUE(send());
  EXPECT_EQ(counters.jumps, 1U);
}

TEST_F(PoseScreenTest, a_single_torn_pose_is_never_used) {
  ASSERT_TRUE(send());
  for (int i = 0; i < 50; ++i) {
    at.z() += 100.0;
    EXPECT_FALSE(send());
    at.z() -= 100.0;
    EXPECT_TRUE(send());
  }
  EXPECT_EQ(counters.jumps, 50U);
}

TEST_F(PoseScreenTest, neither_publisher_is_used_while_two_publish) {
  ASSERT_TRUE(send());
  for (int i = 0; i < 100; ++i) {
    EXPECT_FALSE(offer(other, i, utime_us + 1'000 + i));
    EXPECT_FALSE(send());
  }
  EXPECT_EQ(counters.second_publisher, 200U);
  EXPECT_NE(screen.refusal(now_ns).find("192.168.10.7:39000"), std::string_view::npos) << screen.refusal(now_ns);
  now_ns += PoseScreen::kSilent_ns;  // the other one is stopped
  EXPECT_TRUE(send());
}

TEST_F(PoseScreenTest, a_bridge_that_was_restarted_is_taken_over_when_the_old_one_is_silent) {
  ASSERT_TRUE(send());
  robot.port = 41'001;
  utime_us -= 10'000'000;
  seq = 0;
  int refused = 0;
  while (refused < 1'000 && !send()) ++refused;
  EXPECT_NEAR(refused, 249, 2);
  EXPECT_EQ(counters.time_back, 0U) << "a new program has its own clock";
  EXPECT_EQ(counters.second_publisher, 0U) << "the old one never spoke again";
  PoseNoteText note;
  ASSERT_TRUE(screen.next_note(now_ns, counters, note));
  EXPECT_NE(note.view().find("1 times another sender (" + std::to_string(refused) + " of its poses"),
            std::string_view::npos)
      << note.view();
  EXPECT_EQ(counters.gaps, 0U);
}

TEST_F(PoseScreenTest, senders_that_follow_each_other_after_a_silence_do_not_count_as_two_publishers) {
  for (std::uint16_t run = 0; run < 5; ++run) {
    robot.port = static_cast<std::uint16_t>(42'000 + run);
    for (int i = 0; i < 20; ++i) EXPECT_TRUE(send());
    now_ns += PoseScreen::kSilent_ns;
  }
  EXPECT_EQ(counters.second_publisher, 0U);
  PoseNoteText note;
  ASSERT_TRUE(screen.next_note(now_ns, counters, note));
  EXPECT_NE(note.view().find("4 times another sender (0 of"), std::string_view::npos) << note.view();
}

TEST_F(PoseScreenTest, a_sender_that_comes_back_shows_that_there_were_two) {
  ASSERT_TRUE(send());
  for (int i = 0; i < 10; ++i) EXPECT_FALSE(offer(other, i, utime_us + 1'000 + i));
  EXPECT_EQ(counters.second_publisher, 0U) << "not known yet";
  EXPECT_FALSE(send());
  EXPECT_EQ(counters.second_publisher, 11U) << "now it is";
}

TEST_F(PoseScreenTest, two_newcomers_while_the_old_sender_is_silent_are_two_publishers) {
  ASSERT_TRUE(send());
  const PosePublisher third{other.address, 50'001};
  for (int i = 0; i < 10; ++i) {
    now_ns += 4 * kNsPerMs;
    EXPECT_FALSE(offer(other, i, utime_us + 1'000 + i));
    EXPECT_FALSE(offer(third, i, utime_us + 1'000 + i));
  }
  EXPECT_GE(counters.second_publisher, 19U);
}

TEST_F(PoseScreenTest, times_at_the_ends_of_their_range_are_harmless) {
  constexpr std::int64_t kMin = std::numeric_limits<std::int64_t>::min();
  constexpr std::int64_t kMax = std::numeric_limits<std::int64_t>::max();
  EXPECT_TRUE(offer(robot, std::numeric_limits<std::int32_t>::max(), kMax));
  EXPECT_TRUE(offer(robot, std::numeric_limits<std::int32_t>::min(), kMin)) << "one step on, wrapped";
  EXPECT_FALSE(offer(robot, 0, 0));
  EXPECT_FALSE(offer(robot, 0, kMax));
}

TEST_F(PoseScreenTest, logs_at_once_and_then_once_in_ten_seconds) {
  ASSERT_TRUE(send());
  EXPECT_FALSE(offer(robot, seq, utime_us));
  PoseNoteText text;
  ASSERT_TRUE(screen.next_note(now_ns, counters, text));
  EXPECT_NE(text.view().find("1 repeated"), std::string_view::npos) << text.view();
  EXPECT_FALSE(screen.next_note(now_ns, counters, text)) << "nothing new";
  EXPECT_FALSE(offer(robot, seq, utime_us));
  EXPECT_FALSE(screen.next_note(now_ns + 9 * kNsPerS, counters, text)) << "too early";
  EXPECT_TRUE(screen.next_note(now_ns + 10 * kNsPerS, counters, text));
}

}  // namespace
}  // namespace slabd::hal
