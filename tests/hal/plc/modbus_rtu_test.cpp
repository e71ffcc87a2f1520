// SPDX-License-Identifier: Apache-2.0
//
// The serial slave on a pseudo-terminal, with the test as the master at its other end.
#include <fcntl.h>
#include <gtest/gtest.h>
#include <poll.h>
#include <stdlib.h>
#include <termios.h>
#include <unistd.h>

#include <algorithm>
#include <filesystem>
#include <memory>
#include <utility>
#include <vector>

#include "base/os.h"
#include "base/prng.h"
#include "hal/hal.h"
#include "hal/plc/modbus_codec.h"
#include "tests/hal/temporary_folder.h"

namespace slabd::hal {
namespace {

using Bytes = std::vector<std::uint8_t>;
constexpr std::uint8_t kUnit = 17;

Bytes closed(Bytes bytes) {
  const std::uint16_t crc = crc16_of_bytes(bytes);
  bytes.push_back(static_cast<std::uint8_t>(crc & 0xFFU));
  bytes.push_back(static_cast<std::uint8_t>(crc >> 8U));
  return bytes;
}
Bytes joined(Bytes first, const Bytes& second) {
  first.insert(first.end(), second.begin(), second.end());
  return first;
}
const Bytes kRead = closed({kUnit, 4, 0, 0, 0, 2});
const Bytes kReadAnswer = closed({kUnit, 4, 4, 0x53, 0x4C, 1, 1});
const Bytes kWriteSeq = closed({kUnit, 6, 0, 39, 0, 9});

class RtuTest : public ::testing::Test {
 protected:
  void SetUp() override {
    open_master();
    start({});
  }
  void open_master() {
    master_ = Fd(posix_openpt(O_RDWR | O_NOCTTY | O_NONBLOCK));
    ASSERT_TRUE(master_.is_open());
    ASSERT_EQ(grantpt(master_.get()), 0);
    ASSERT_EQ(unlockpt(master_.get()), 0);
    std::filesystem::remove(device_);
    std::filesystem::create_symlink(ptsname(master_.get()), device_);  // as udev does for adapters
    // Like a cable: no echo and no line discipline before the other end is opened.
    const Fd other(open(device_.c_str(), O_RDWR | O_NOCTTY));
    termios raw{};
    tcgetattr(other.get(), &raw);
    cfmakeraw(&raw);
    tcsetattr(other.get(), TCSANOW, &raw);
  }
  void start(PlcSettings settings) {
    settings.role = PlcRole::rtu;
    settings.unit_id = kUnit;
    settings.device = std::string_view(device_);
    settings.parity = SerialParity::none;  // a pseudo-terminal has no parity
    auto made = make_plc_port(settings);
    ASSERT_TRUE(made.ok()) << made.error().text.c_str();
    line_ = std::move(made.value());
    ASSERT_EQ(line_->trouble(), "");
  }
  void send(const Bytes& bytes) const {
    ASSERT_EQ(write(master_.get(), bytes.data(), bytes.size()), static_cast<ssize_t>(bytes.size()));
  }
  /// Waits until data for the slave arrive, then runs one turn.
  std::vector<PlcInputs> turn() {
    std::array<pollfd, kPlcPollFds> fds{};
    const std::size_t count = line_->poll_fds(fds);
    poll(fds.data(), count, 50);
    std::vector<PlcInputs> writes;
    PlcInputs inputs;
    while (line_->next(now_ns_, inputs)) writes.push_back(inputs);
    return writes;
  }
  [[nodiscard]] Bytes receive() const {
    pollfd p{master_.get(), POLLIN, 0};
    Bytes all;
    while (poll(&p, 1, 5) == 1) {
      Bytes piece(512);
      const ssize_t n = read(master_.get(), piece.data(), piece.size());
      if (n <= 0) break;
      all.insert(all.end(), piece.begin(), piece.begin() + n);
    }
    return all;
  }
  Bytes asked(const Bytes& request) {
    send(request);
    turn();
    return receive();
  }
  void pause() {
    now_ns_ += 100 * kNsPerMs;
    turn();
  }

  test::TemporaryFolder folder_;
  Fd master_;
  std::string device_ = folder_ / "line";
  std::unique_ptr<PlcPort> line_;
  std::int64_t now_ns_ = kNsPerS;
};

TEST_F(RtuTest, the_same_write_twice_is_answered_twice_once_the_adapter_is_known_not_to_echo) {
  for (int i = 0; i < 4; ++i) EXPECT_EQ(asked(kRead), kReadAnswer);
  for (int i = 0; i < 6; ++i) {
    EXPECT_EQ(asked(kWriteSeq), kWriteSeq) << i;
    now_ns_ += kNsPerMs;
  }
}

TEST_F(RtuTest, answers_reads_and_hands_over_each_write) {
  EXPECT_EQ(asked(kRead), kReadAnswer);
  send(kWriteSeq);
  const auto writes = turn();
  ASSERT_EQ(writes.size(), 1U);
  EXPECT_EQ(writes[0].cmd_seq, 9);
  EXPECT_EQ(writes[0].command_writer, 1U);
  EXPECT_EQ(receive(), kWriteSeq) << "the standard's answer to FC 6";
  EXPECT_EQ(asked(closed({kUnit, 23, 0, 39, 0, 1, 0, 38, 0, 1, 2, 0, 5})), closed({kUnit, 23, 2, 0, 9}));
  EXPECT_EQ(line_->holding()[38], 5);
  EXPECT_EQ(line_->clients(), 1U);
  now_ns_ += 3 * kNsPerS;
  turn();
  EXPECT_EQ(line_->clients(), 0U) << "a silent line has no master";
}

TEST_F(RtuTest, a_frame_that_comes_byte_by_byte_is_one_frame) {
  for (const std::uint8_t byte : kRead) {
    send({byte});
    now_ns_ += 4 * kNsPerMs;
    turn();
  }
  EXPECT_EQ(receive(), kReadAnswer);
}

TEST_F(RtuTest, half_a_frame_and_a_pause_is_discarded) {
  send(Bytes(kWriteSeq.begin(), kWriteSeq.begin() + 5));
  EXPECT_TRUE(turn().empty());
  pause();
  EXPECT_EQ(line_->counters().malformed, 1U);
  EXPECT_EQ(asked(kRead), kReadAnswer);
}

TEST_F(RtuTest, other_slaves_broadcasts_and_wrong_checksums_are_ignored) {
  Bytes wrong = kWriteSeq;
  wrong[5] = 10;
  for (const Bytes& frame : {closed({18, 6, 0, 39, 0, 9}), closed({0, 6, 0, 39, 0, 9}), wrong}) {
    EXPECT_EQ(asked(frame), Bytes{});
    pause();
    EXPECT_EQ(line_->holding()[39], 0);
  }
  EXPECT_EQ(asked(kRead), kReadAnswer);
}

TEST_F(RtuTest, a_request_right_behind_another_slaves_traffic_is_answered) {
  // A request to slave 5 and its answer, directly followed by a request to slabd, as from a USB adapter.
  const Bytes foreign = joined(closed({5, 3, 0, 0, 0, 3}), closed({5, 3, 6, 1, 2, 3, 4, 5, 6}));
  EXPECT_EQ(asked(joined(foreign, kRead)), kReadAnswer);
  // More foreign bytes than a frame can hold.
  EXPECT_EQ(asked(joined(Bytes(700, 0x55), kRead)), kReadAnswer);
}

TEST_F(RtuTest, a_request_outside_the_map_is_refused_after_a_pause_only) {
  EXPECT_EQ(asked(closed({kUnit, 3, 0, 75, 0, 1})), closed({kUnit, 0x83, 2}));
  pause();
  EXPECT_EQ(asked(joined({0x55}, closed({kUnit, 3, 0, 75, 0, 1}))), Bytes{}) << "glued: it may be anything";
  pause();
  EXPECT_EQ(asked(closed({kUnit, 3, 0, 0, 0, 0})), closed({kUnit, 0x83, 3}));
  // A frame with a function of unknown length ends with the silence.
  send(closed({kUnit, 7}));
  turn();
  EXPECT_EQ(receive(), Bytes{});
  pause();
  EXPECT_EQ(receive(), closed({kUnit, 0x87, 1}));
}

TEST_F(RtuTest, noise_of_the_line_behind_a_request_costs_a_pause_and_not_the_answer) {
  // A 0 leaves the checksum right; 0xFF does not.
  for (const Bytes& noise : {Bytes{0}, Bytes{0xFF}, Bytes{0, 0}, Bytes{0xFF, 0, 0x55}}) {
    EXPECT_EQ(asked(joined(kRead, noise)), Bytes{}) << "not before the pause: more may come";
    pause();
    EXPECT_EQ(receive(), kReadAnswer);
  }
  send(joined(kWriteSeq, {0}));
  EXPECT_TRUE(turn().empty());
  now_ns_ += 100 * kNsPerMs;
  const auto writes = turn();
  ASSERT_EQ(writes.size(), 1U) << "a write is handed over as any other";
  EXPECT_EQ(writes[0].cmd_seq, 9);
  EXPECT_EQ(receive(), kWriteSeq);
  EXPECT_EQ(asked(joined(closed({kUnit, 3, 0, 75, 0, 1}), {0})), Bytes{});
  pause();
  EXPECT_EQ(receive(), closed({kUnit, 0x83, 2}));
  EXPECT_EQ(line_->counters().malformed, 0U);
}

TEST_F(RtuTest, a_request_followed_by_more_than_noise_or_handled_too_late_gets_no_answer) {
  EXPECT_EQ(asked(joined(kRead, {5, 3, 0, 0})), Bytes{}) << "another device is sending by now";
  pause();
  EXPECT_EQ(receive(), Bytes{});
  EXPECT_EQ(asked(joined(kRead, {0})), Bytes{});
  now_ns_ += kNsPerS;
  turn();
  EXPECT_EQ(receive(), Bytes{}) << "the master has given up";
  EXPECT_EQ(asked(kRead), kReadAnswer);
}

TEST_F(RtuTest, a_served_function_in_a_frame_of_wrong_length_is_malformed_and_not_unknown) {
  // The byte count is three, the quantity two: it is unknown which is wrong.
  EXPECT_EQ(asked(closed({kUnit, 16, 0, 2, 0, 2, 3, 0, 5, 0, 1})), Bytes{});
  pause();
  EXPECT_EQ(receive(), Bytes{});
  EXPECT_EQ(line_->counters().malformed, 1U);
  EXPECT_EQ(line_->holding()[2], 0);
}

TEST_F(RtuTest, replies_that_come_back_late_are_not_answered) {
  // slabd's own replies, after the time in which an echo is expected: an exception reply, answers to a read, FC 16 and
  // FC 23.
  for (const Bytes& reply :
       {closed({kUnit, 0x87, 1}), kReadAnswer, closed({kUnit, 16, 0, 38, 0, 1}), closed({kUnit, 23, 2, 0, 9})}) {
    EXPECT_EQ(asked(reply), Bytes{});
    pause();
    EXPECT_EQ(receive(), Bytes{});
  }
  EXPECT_EQ(line_->counters().exceptions, 0U);
  EXPECT_EQ(asked(kRead), kReadAnswer);
}

TEST_F(RtuTest, a_request_received_twice_before_the_next_turn_is_answered_once) {
  EXPECT_EQ(asked(joined(kRead, kRead)), kReadAnswer);
}

TEST_F(RtuTest, an_adapter_that_echoes_does_not_answer_its_own_frames) {
  send(kWriteSeq);
  ASSERT_EQ(turn().size(), 1U);
  const Bytes reply = receive();
  send(Bytes(reply.begin(), reply.begin() + 3));  // the echo, in two pieces
  EXPECT_TRUE(turn().empty());
  send(Bytes(reply.begin() + 3, reply.end()));
  EXPECT_TRUE(turn().empty());
  EXPECT_EQ(receive(), Bytes{});
  EXPECT_EQ(asked(kRead), kReadAnswer);
  // Later the same bytes are a request again.
  now_ns_ += kNsPerS;
  send(kWriteSeq);
  EXPECT_EQ(turn().size(), 1U);
}

TEST_F(RtuTest, its_own_voice_is_known_however_late_it_comes_back) {
  // Device servers may delay bytes for any time; the master's next request comes after them.
  for (const std::int64_t late_ms : {61, 200, 3'000}) {
    for (int round = 0; round < 5; ++round) {
      ASSERT_EQ(asked(kRead), kReadAnswer);
      now_ns_ += late_ms * kNsPerMs;
      EXPECT_EQ(asked(kReadAnswer), Bytes{});
      ASSERT_EQ(asked(kWriteSeq), kWriteSeq);
      now_ns_ += late_ms * kNsPerMs;
      EXPECT_EQ(asked(kWriteSeq), Bytes{}) << late_ms << " ms: an answer to its own answer never ends";
    }
  }
}

TEST_F(RtuTest, noise_in_front_of_its_own_voice_does_not_make_it_answer_itself) {
  // Noise of a driver that changes direction; also enough of it to look like another slave's frame.
  for (const Bytes& noise : {Bytes{0}, Bytes{0xFF}, Bytes{kUnit}, Bytes{0, 0x55, 0xFF}, Bytes(9, 0x55)}) {
    // Reads first: they must not lead to the conclusion that this adapter does not echo.
    for (int i = 0; i < 5; ++i) {
      ASSERT_EQ(asked(kRead), kReadAnswer);
      EXPECT_EQ(asked(joined(noise, kReadAnswer)), Bytes{});
    }
    send(kWriteSeq);
    ASSERT_EQ(turn().size(), 1U);
    ASSERT_EQ(receive(), kWriteSeq);
    send(noise);  // alone at first
    EXPECT_TRUE(turn().empty());
    send(kWriteSeq);
    EXPECT_TRUE(turn().empty());
    EXPECT_EQ(receive(), Bytes{});
    // After the echo the same bytes are a request.
    EXPECT_EQ(asked(kWriteSeq), kWriteSeq);
    EXPECT_EQ(asked(kWriteSeq), Bytes{}) << "its echo, without noise";
    pause();
  }
}

/// FC 6 to HEARTBEAT.
Bytes heartbeat(std::uint8_t value) {
  return closed({kUnit, 6, 0, 0, 0, value});
}

/// A PLC on a line whose echo comes back after several more requests. Counts the PLC's requests and slabd's frames.
class LateEcho {
 public:
  explicit LateEcho(std::size_t turns_late) : turns_late_(turns_late) {}
  void sent_by_slabd(const Bytes& frame, std::size_t turn) {
    if (!frame.empty()) coming_.push_back({turn + turns_late_, frame});
  }
  std::vector<Bytes> arriving(std::size_t turn) {
    std::vector<Bytes> now;
    while (!coming_.empty() && coming_.front().first <= turn) {
      now.push_back(coming_.front().second);
      coming_.erase(coming_.begin());
    }
    return now;
  }

 private:
  std::size_t turns_late_;
  std::vector<std::pair<std::size_t, Bytes>> coming_;
};

TEST_F(RtuTest, echoes_after_the_next_requests_are_not_answered_and_are_not_a_sign_of_life) {
  for (const bool distinct : {true, false}) {
    for (const bool reads : {true, false}) {
      for (const std::size_t turns_late : {1U, 2U, 5U, 20U}) {
        SCOPED_TRACE(testing::Message() << distinct << reads << turns_late);
        SetUp();
        LateEcho echo(turns_late);
        std::size_t requests = 0;
        std::size_t answers = 0;
        std::uint64_t frames_at_rest = 0;
        // 40 requests, 100 ms apart, then the PLC stops.
        for (std::size_t turns = 0; turns < 200; ++turns, now_ns_ += 100 * kNsPerMs) {
          std::vector<Bytes> came = echo.arriving(turns);
          if (turns < 40) {
            const bool is_read = reads && turns % 2 == 0;
            came.push_back(is_read ? kRead : heartbeat(distinct ? static_cast<std::uint8_t>(turns) : 5));
            ++requests;
          }
          // Sometimes in one piece, with the request in front of the echo.
          if (turns % 3 == 0) std::reverse(came.begin(), came.end());
          for (const Bytes& frame : came) {
            const Bytes answer = asked(frame);
            answers += answer.empty() ? 0U : 1U;
            echo.sent_by_slabd(answer, turns);
          }
          // With the same bytes, a late echo may still be answered in place of a request.
          if (turns < (distinct ? 41 : 160)) frames_at_rest = line_->counters().frames;
        }
        EXPECT_LE(answers, requests) << "an echo was answered";
        EXPECT_GE(answers, distinct ? requests : requests / 2);
        EXPECT_EQ(line_->counters().frames, frames_at_rest) << "slabd answers itself after the PLC has stopped";
        PlcInputs none;
        EXPECT_FALSE(line_->next(now_ns_, none));
        EXPECT_EQ(line_->clients(), 0U);
        EXPECT_EQ(line_->holding()[0], distinct ? 39 : 5) << "an old value was written again";
      }
    }
  }
}

TEST_F(RtuTest, an_echo_that_comes_after_a_newer_value_does_not_write_the_old_one) {
  ASSERT_EQ(asked(kRead), kReadAnswer);
  ASSERT_EQ(asked(kReadAnswer), Bytes{}) << "this adapter echoes";
  EXPECT_EQ(asked(heartbeat(5)), heartbeat(5));
  EXPECT_EQ(asked(heartbeat(5)), Bytes{}) << "the PLC again, before the echo";
  EXPECT_EQ(asked(heartbeat(6)), heartbeat(6));
  EXPECT_EQ(asked(heartbeat(5)), Bytes{}) << "the echo";
  EXPECT_EQ(line_->holding()[0], 6);
  EXPECT_EQ(asked(heartbeat(6)), Bytes{}) << "the echo of the newer value";
  // Echoes that come in time do not delay a PLC that writes two values in turn.
  for (int i = 0; i < 6; ++i) {
    const Bytes write = heartbeat(static_cast<std::uint8_t>(5 + i % 2));
    EXPECT_EQ(asked(write), write) << i;
    EXPECT_EQ(asked(write), Bytes{}) << i;
  }
}

TEST_F(RtuTest, an_echo_and_the_next_request_in_one_piece_are_distinguished) {
  ASSERT_EQ(asked(kRead), kReadAnswer);
  ASSERT_EQ(asked(joined(kReadAnswer, heartbeat(1))), heartbeat(1));
  EXPECT_EQ(asked(joined(heartbeat(2), heartbeat(1))), heartbeat(2)) << "the request in front of the echo";
  EXPECT_EQ(asked(joined(heartbeat(2), heartbeat(2))), heartbeat(2)) << "an echo and the same write again";
  EXPECT_EQ(asked(joined(heartbeat(2), kRead)), kReadAnswer);
  EXPECT_EQ(asked(joined(kReadAnswer, kReadAnswer)), Bytes{});
}

TEST_F(RtuTest, a_plc_that_writes_few_values_in_turn_is_answered_on_a_line_without_echo) {
  for (int i = 0; i < 3; ++i) EXPECT_EQ(asked(kRead), kReadAnswer);
  for (int i = 0; i < 20; ++i) {
    const Bytes write = heartbeat(static_cast<std::uint8_t>(i % 2));
    EXPECT_EQ(asked(write), write) << i;
    now_ns_ += 100 * kNsPerMs;
    EXPECT_EQ(asked(kRead), kReadAnswer);
  }
}

TEST_F(RtuTest, a_repeated_write_gets_an_answer_at_the_second_attempt_while_the_adapter_is_unknown) {
  EXPECT_EQ(asked(kWriteSeq), kWriteSeq);
  EXPECT_EQ(asked(kWriteSeq), Bytes{}) << "it may be the echo";
  EXPECT_EQ(asked(kWriteSeq), kWriteSeq);
}

TEST_F(RtuTest, a_lost_echo_costs_at_most_one_answer_and_only_for_ten_seconds) {
  ASSERT_EQ(asked(kRead), kReadAnswer);
  ASSERT_EQ(asked(kReadAnswer), Bytes{}) << "this adapter echoes";
  EXPECT_EQ(asked(kWriteSeq), kWriteSeq);
  EXPECT_EQ(asked(kWriteSeq), Bytes{});
  EXPECT_EQ(asked(kWriteSeq), kWriteSeq);
  now_ns_ += 11 * kNsPerS;
  EXPECT_EQ(asked(kWriteSeq), kWriteSeq);
}

TEST_F(RtuTest, the_same_write_after_other_slaves_traffic_is_answered_on_a_line_without_echo) {
  const Bytes foreign = joined(closed({5, 3, 0, 0, 0, 3}), closed({5, 3, 6, 1, 2, 3, 4, 5, 6}));
  for (int i = 0; i < 4; ++i) EXPECT_EQ(asked(joined(foreign, kRead)), kReadAnswer);
  for (int i = 0; i < 6; ++i) {
    EXPECT_EQ(asked(joined(foreign, kWriteSeq)), kWriteSeq) << i;
    now_ns_ += kNsPerMs;
  }
}

TEST_F(RtuTest, a_line_that_vanishes_is_opened_again_as_a_new_connection) {
  send(kWriteSeq);
  EXPECT_EQ(turn().at(0).command_writer, 1U);
  master_.reset();
  turn();
  EXPECT_NE(line_->trouble(), "");
  EXPECT_EQ(line_->clients(), 0U);
  std::array<pollfd, kPlcPollFds> fds{};
  EXPECT_EQ(line_->poll_fds(fds), 0U) << "a dead line must not wake the loop";
  open_master();
  turn();
  EXPECT_NE(line_->trouble(), "") << "not before a second has passed";
  now_ns_ += kNsPerS;
  turn();
  EXPECT_EQ(line_->trouble(), "");
  send(kWriteSeq);
  const auto writes = turn();
  ASSERT_EQ(writes.size(), 1U);
  EXPECT_EQ(writes[0].command_writer, 2U);
}

TEST_F(RtuTest, random_bytes_are_neither_commands_nor_the_end) {
  for (std::uint64_t seed = 1; seed <= 4; ++seed) {
    SCOPED_TRACE(seed);
    Prng random(seed);
    for (int i = 0; i < 200; ++i) {
      Bytes noise(1 + random.below(300));
      for (std::uint8_t& byte : noise) byte = static_cast<std::uint8_t>(random.below(256));
      if (i % 3 == 0) noise[0] = kUnit;
      send(noise);
      EXPECT_TRUE(turn().empty());
      static_cast<void>(receive());
    }
    pause();
    static_cast<void>(receive());
    EXPECT_EQ(asked(kRead), kReadAnswer);
  }
}

TEST(RtuSettings, a_line_that_is_not_there_is_a_trouble_with_a_cure_and_no_error) {
  PlcSettings settings;
  settings.role = PlcRole::rtu;
  settings.device = "/dev/no-such-line";
  auto made = make_plc_port(settings);
  ASSERT_TRUE(made.ok());
  EXPECT_NE(made.value()->trouble().find("plugged in"), std::string_view::npos) << made.value()->trouble();
  settings.device = "/dev/null";
  made = make_plc_port(settings);
  ASSERT_TRUE(made.ok());
  EXPECT_NE(made.value()->trouble().find("not a serial line"), std::string_view::npos) << made.value()->trouble();
  settings.unit_id = 248;
  EXPECT_FALSE(make_plc_port(settings).ok());
  settings.unit_id = 17;
  settings.baud = 100;
  EXPECT_FALSE(make_plc_port(settings).ok());
}

}  // namespace
}  // namespace slabd::hal
