// SPDX-License-Identifier: Apache-2.0
#include <arpa/inet.h>
#include <gtest/gtest.h>
#include <modbus/modbus.h>
#include <netinet/in.h>
#include <netinet/tcp.h>
#include <sys/socket.h>

#include <atomic>
#include <cerrno>
#include <memory>
#include <thread>
#include <vector>

#include "base/os.h"
#include "hal/hal.h"
#include "hal/plc/plc_map.h"
#include "tests/hal/plc/modbus_server_line.h"

namespace slabd::hal {
namespace {

TEST_F(ModbusServerTest, input_registers_and_their_mirror_show_the_published_image) {
  PlcOutputs out;
  out.heartbeat = 4711;
  out.slab_no = 0xCAFE0001;
  server_->publish(out);
  const auto client = connected();
  const Bytes input = asked(*client, read_frame(7, 4, 0, 110));
  const Bytes mirror = asked(*client, read_frame(7, 3, 1000, 110));
  ASSERT_EQ(input.size(), 9U + 220U);
  InputImage expected;
  encode_outputs(out, WordOrder::abcd, expected);
  for (std::size_t i = 0; i < 110; ++i) EXPECT_EQ((input[9 + 2 * i] << 8) | input[10 + 2 * i], expected[i]) << i;
  EXPECT_EQ(Bytes(input.begin() + 8, input.end()), Bytes(mirror.begin() + 8, mirror.end()));
  EXPECT_EQ(input[0] << 8 | input[1], 7);
}

TEST_F(ModbusServerTest, before_the_first_publish_no_register_reads_as_pass) {
  const auto client = connected();
  const Bytes reply = asked(*client, read_frame(1, 4, 0, 110));
  ASSERT_EQ(reply.size(), 229U);
  EXPECT_EQ(reply[9 + 2 * 6 + 1], 0) << "state init";
  EXPECT_EQ(reply[9 + 2 * 36 + 1], 0) << "verdict none";
}

TEST_F(ModbusServerTest, each_write_is_seen_alone_even_when_pipelined) {
  const auto client = connected();
  client->send(
      joined({write_frame(1, 10, {2, 5}), write_frame(2, 39, {1}), read_frame(3, 3, 10, 2), write_frame(4, 39, {2})}));
  std::array<pollfd, kPlcPollFds> fds{};
  poll(fds.data(), server_->poll_fds(fds), 200);
  PlcInputs inputs;
  ASSERT_TRUE(server_->next(now_ns_, inputs));
  EXPECT_EQ(inputs.station, 5);
  EXPECT_EQ(inputs.cmd_seq, 0) << "the second write must wait for its own call";
  ASSERT_TRUE(server_->next(now_ns_, inputs));
  EXPECT_EQ(inputs.cmd_seq, 1);
  ASSERT_TRUE(server_->next(now_ns_, inputs));
  EXPECT_EQ(inputs.cmd_seq, 2);
  EXPECT_FALSE(server_->next(now_ns_, inputs));
  const Bytes replies = client->receive();
  EXPECT_EQ(replies.size(), 12U + 12U + 13U + 12U);
}

TEST_F(ModbusServerTest, a_read_after_a_write_returns_what_was_published_between_them) {
  const auto client = connected();
  client->send(joined({write_frame(1, 39, {9}), read_frame(2, 4, 10, 1)}));
  std::array<pollfd, kPlcPollFds> fds{};
  poll(fds.data(), server_->poll_fds(fds), 200);
  PlcInputs inputs;
  ASSERT_TRUE(server_->next(now_ns_, inputs));
  PlcOutputs out;
  out.cmd_ack = inputs.cmd_seq;
  server_->publish(out);
  EXPECT_FALSE(server_->next(now_ns_, inputs));
  const Bytes replies = client->receive();
  ASSERT_EQ(replies.size(), 12U + 11U);
  EXPECT_EQ(replies.back(), 9);
}

TEST_F(ModbusServerTest, all_three_write_functions_change_the_registers) {
  const auto client = connected();
  client->send(frame(1, {6, 0, 0, 0x12, 0x34}));
  auto writes = turn();
  ASSERT_EQ(writes.size(), 1U);
  EXPECT_EQ(writes[0].heartbeat, 0x1234);
  client->send(write_frame(2, 2, {77, 78}));
  writes = turn();
  ASSERT_EQ(writes.size(), 1U);
  EXPECT_EQ(writes[0].res_ack, 77);
  EXPECT_EQ(writes[0].sync_req, 78);
  static_cast<void>(client->receive());
  // FC 23: write HR 39 and read HR 38..39 in one request; the write is executed first.
  client->send(frame(3, {23, 0, 38, 0, 2, 0, 39, 0, 1, 2, 0xAB, 0xCD}));
  writes = turn();
  ASSERT_EQ(writes.size(), 1U);
  EXPECT_EQ(writes[0].cmd_seq, 0xABCD);
  const Bytes reply = client->receive();
  EXPECT_EQ(Bytes(reply.begin() + 7, reply.end()), (Bytes{23, 4, 0, 0, 0xAB, 0xCD}));
}

TEST_F(ModbusServerTest, refusals_are_answered_at_once_and_the_connection_stays_open) {
  const auto client = connected();
  const std::vector<std::pair<Bytes, Bytes>> cases = {
      {frame(1, {7}), {0x87, 1}},
      {frame(1, {43, 14, 1, 0}), {0xAB, 1}},
      {frame(1, {17}), {0x91, 1}},
      {read_frame(1, 4, 0, 111), {0x84, 2}},
      {read_frame(1, 4, 0, 0), {0x84, 3}},
      {read_frame(1, 3, 74, 2), {0x83, 2}},
      {write_frame(1, 1000, {1}), {0x90, 2}},
      {write_frame(1, 75, {1}), {0x90, 2}},
      {frame(1, {3, 0}), {0x83, 3}},
      {frame(1, {4, 0, 0, 0, 1, 99, 99, 99, 99}), {0x84, 3}},
  };
  for (const auto& [request, pdu] : cases) {
    client->send(request);
    EXPECT_TRUE(turn().empty());
    const Bytes reply = client->receive();
    ASSERT_EQ(reply.size(), 9U);
    EXPECT_EQ(Bytes(reply.begin() + 7, reply.end()), pdu);
  }
  EXPECT_EQ(asked(*client, read_frame(9, 4, 0, 1)).size(), 11U);
}

TEST_F(ModbusServerTest, a_refused_request_leaves_those_behind_it_alone) {
  const auto client = connected();
  client->send(joined({frame(1, {7}), read_frame(2, 4, 0, 1), frame(3, {99, 1}), read_frame(4, 4, 1, 1)}));
  turn();
  EXPECT_EQ(client->receive().size(), 9U + 11U + 9U + 11U);
}

TEST_F(ModbusServerTest, a_foreign_unit_gets_an_exception_and_units_0_and_255_are_served) {
  const auto client = connected();
  EXPECT_EQ(asked(*client, frame(1, {4, 0, 0, 0, 1}, 2)).back(), 11);
  EXPECT_EQ(asked(*client, frame(1, {4, 0, 0, 0, 1}, 0)).size(), 11U);
  EXPECT_EQ(asked(*client, frame(1, {4, 0, 0, 0, 1}, 255)).size(), 11U);
}

TEST_F(ModbusServerTest, a_stream_without_frames_is_closed) {
  for (const Bytes& nonsense : {Bytes{0, 1, 0, 1, 0, 6, 1, 4, 0, 0, 0, 1}, Bytes{0, 1, 0, 0, 0, 1, 1},
                                Bytes{0, 1, 0, 0, 1, 0, 1, 4}, Bytes{'G', 'E', 'T', ' ', '/', ' '}}) {
    const auto client = connected();
    client->send(nonsense);
    turn();
    EXPECT_TRUE(client->closed_by_server());
  }
  EXPECT_EQ(server_->clients(), 0U);
}

TEST_F(ModbusServerTest, a_dripped_frame_is_served_within_its_deadline_and_does_not_delay_others) {
  const auto slow = connected();
  const auto quick = connected();
  const Bytes request = read_frame(5, 4, 0, 1);
  for (std::size_t i = 0; i < request.size(); ++i) {
    slow->send({request[i]});
    now_ns_ += 20 * kNsPerMs;
    EXPECT_EQ(asked(*quick, read_frame(6, 4, 0, 1)).size(), 11U) << "while the other drips";
  }
  turn();
  EXPECT_EQ(slow->receive().size(), 11U);
}

TEST_F(ModbusServerTest, a_frame_that_stays_unfinished_is_closed_after_its_deadline) {
  const auto client = connected();
  client->send({0, 1, 0});
  turn();
  now_ns_ += ns_from_ms(300);
  turn();
  EXPECT_TRUE(client->still_open());
  client->send({0});  // another byte does not restart the time limit
  now_ns_ += 1;
  turn();
  EXPECT_TRUE(client->closed_by_server());
}

TEST_F(ModbusServerTest, a_silent_client_is_closed_after_a_minute_and_a_speaking_one_is_not) {
  const auto silent = connected();
  const auto speaking = connected();
  now_ns_ += 59 * kNsPerS;
  EXPECT_EQ(asked(*speaking, read_frame(6, 4, 0, 1)).size(), 11U);
  now_ns_ += 2 * kNsPerS;
  turn();
  EXPECT_TRUE(silent->closed_by_server());
  EXPECT_TRUE(speaking->still_open());
  EXPECT_EQ(server_->clients(), 1U);
}

TEST_F(ModbusServerTest, faults_are_counted_and_reported_once_in_ten_seconds) {
  PlcNoteText text;
  EXPECT_FALSE(server_->next_note(now_ns_, text)) << "nothing happened";
  const auto hostile = connected();
  hostile->send({0, 1, 0, 9, 0, 2, 1, 4});
  turn();
  EXPECT_EQ(server_->counters().malformed, 1U);
  ASSERT_TRUE(server_->next_note(now_ns_, text));
  EXPECT_NE(text.view().find("1 streams or frames that are not Modbus"), std::string_view::npos) << text.c_str();
  EXPECT_NE(text.view().find("127.0.0.1"), std::string_view::npos) << text.c_str();
  for (int i = 0; i < 50; ++i) {
    connected()->send({0, 1, 0, 9, 0, 2, 1, 4});
    turn();
    EXPECT_FALSE(server_->next_note(now_ns_, text)) << "too early";
  }
  now_ns_ += 10 * kNsPerS;
  ASSERT_TRUE(server_->next_note(now_ns_, text));
  EXPECT_NE(text.view().find("50 streams"), std::string_view::npos) << text.c_str();
  now_ns_ += 10 * kNsPerS;
  EXPECT_FALSE(server_->next_note(now_ns_, text)) << "nothing new";
}

TEST_F(ModbusServerTest, a_flood_of_frames_is_served_in_slices_and_others_get_their_turn) {
  const auto flood = connected();
  const auto plc = connected();
  Bytes many;
  for (unsigned i = 0; i < 40; ++i) {
    const Bytes one = read_frame(i, 4, 0, 1);
    many.insert(many.end(), one.begin(), one.end());
  }
  flood->send(many);
  plc->send(write_frame(1, 39, {5}));
  const auto writes = turn();
  ASSERT_EQ(writes.size(), 1U) << "served in the first turn";
  EXPECT_EQ(flood->receive().size(), limits::kModbusFramesPerTurn * 11U);
  std::size_t replied = 0;
  for (int i = 0; i < 9; ++i) {
    turn();
    replied += flood->receive().size();
  }
  EXPECT_EQ(replied, 36U * 11U) << "nothing of the rest was lost, and poll() was woken for it";
}

TEST_F(ModbusServerTest, a_client_that_never_reads_is_closed_and_never_waited_for) {
  const auto deaf = connected();
  const Bytes request = read_frame(1, 4, 0, 110);
  // More replies than the kernel buffers at both ends.
  std::size_t asked_count = 0;
  while (server_->clients() == 1 && asked_count < 500'000) {
    const ssize_t n = ::send(deaf->fd(), request.data(), request.size(), MSG_NOSIGNAL | MSG_DONTWAIT);
    if (n > 0) ++asked_count;
    turn(0);
  }
  EXPECT_EQ(server_->clients(), 0U);
  EXPECT_GT(asked_count, 1U) << "not at its first request";
}

TEST_F(ModbusServerTest, word_order_of_the_settings_is_used_in_both_directions) {
  PlcSettings settings;
  settings.word_order = WordOrder::cdab;
  open(settings);
  const auto client = connected();
  const Bytes reply = asked(*client, read_frame(1, 4, 2, 2));
  EXPECT_EQ(Bytes(reply.begin() + 9, reply.end()), (Bytes{0x56, 0x78, 0x12, 0x34}));
  client->send(write_frame(1, 14, {1, 2}));
  EXPECT_EQ(turn().at(0).slab_no, 0x00020001U);
}

TEST_F(ModbusServerTest, random_bytes_never_stop_it_from_serving_the_plc) {
  for (std::uint64_t seed = 1; seed <= 4; ++seed) {
    SCOPED_TRACE(seed);
    Prng prng(seed);
    const auto plc = connected();
    for (int round = 0; round < 150; ++round) {
      const auto attacker = std::make_unique<RawClient>(server_->bound_port());
      Bytes bytes(1 + prng.below(300));
      for (auto& b : bytes) b = static_cast<std::uint8_t>(prng.below(256));
      if (prng.below(2) == 0 && bytes.size() > 8) {  // a plausible header, to pass the first checks
        bytes[2] = bytes[3] = bytes[4] = 0;
        bytes[6] = 1;
        bytes[7] = static_cast<std::uint8_t>(std::array{3, 4, 6, 16, 23, 8}[prng.below(6)]);
      }
      if (::send(attacker->fd(), bytes.data(), bytes.size(), MSG_NOSIGNAL) < 0) continue;
      turn();   // its connection
      turn(1);  // its bytes, if they form a request
      const Bytes reply = asked(*plc, read_frame(7, 4, 0, 2));
      ASSERT_EQ(reply, (Bytes{0, 7, 0, 0, 0, 7, 1, 4, 4, 0x53, 0x4C, 0x01, 0x01}));
    }
  }
}

// ---- with an ordinary client ---------------------------------------------------------------------------------------

TEST_F(ModbusServerTest, libmodbus_as_plc_can_command_and_read) {
  std::atomic<bool> stop = false;
  std::atomic<int> seen_seq = -1;
  std::thread loop([&] {
    std::array<pollfd, kPlcPollFds> fds{};
    PlcInputs inputs;
    while (!stop) {
      poll(fds.data(), server_->poll_fds(fds), 10);
      while (server_->next(now_ns_, inputs)) {
        seen_seq = inputs.cmd_seq;
        PlcOutputs out;
        out.cmd_ack = inputs.cmd_seq;
        server_->publish(out);
      }
    }
  });
  modbus_t* plc = modbus_new_tcp("127.0.0.1", server_->bound_port());
  modbus_set_slave(plc, 1);
  modbus_set_response_timeout(plc, 20, 0);
  ASSERT_EQ(modbus_connect(plc), 0) << modbus_strerror(errno);
  PlcInputs command;
  command.command = 2;
  command.station = 3;
  command.cmd_seq = 1234;
  HoldingImage image;
  encode_inputs(command, WordOrder::abcd, true, image);
  EXPECT_EQ(modbus_write_registers(plc, 0, static_cast<int>(image.size()), image.data()), 75) << modbus_strerror(errno);
  EXPECT_EQ(modbus_write_register(plc, 0, 5), 1) << modbus_strerror(errno);
  InputImage seen{};
  EXPECT_EQ(modbus_read_input_registers(plc, 0, 110, seen.data()), 110) << modbus_strerror(errno);
  EXPECT_EQ(seen[10], 1234);
  HoldingImage back{};
  EXPECT_EQ(modbus_read_registers(plc, 0, 40, back.data()), 40);
  EXPECT_EQ(back[39], 1234);
  std::array<std::uint16_t, 2> values = {8, 9};
  EXPECT_EQ(modbus_write_and_read_registers(plc, 2, 2, values.data(), 1000, 110, seen.data()), 110);
  EXPECT_EQ(modbus_read_registers(plc, 500, 1, back.data()), -1);
  EXPECT_EQ(errno, EMBXILADD);
  EXPECT_EQ(modbus_read_input_registers(plc, 0, 1, seen.data()), 1) << "still in step after an exception";
  modbus_close(plc);
  modbus_free(plc);
  stop = true;
  loop.join();
  EXPECT_EQ(seen_seq, 1234);
}

// ---- settings ------------------------------------------------------------------------------------------------------

TEST(ModbusServerSettings, a_port_in_use_is_named) {
  PlcSettings settings;
  settings.port = 0;
  auto first = make_modbus_server(settings);
  ASSERT_TRUE(first.ok());
  settings.port = first.value()->bound_port();
  auto second = make_modbus_server(settings);
  ASSERT_FALSE(second.ok());
  EXPECT_EQ(second.error().code, Code::config);
  EXPECT_NE(second.error().text.view().find(std::to_string(settings.port)), std::string_view::npos);
}

TEST(ModbusServerSettings, bad_hosts_and_units_are_refused) {
  PlcSettings settings;
  settings.host = "plc.example";
  EXPECT_FALSE(make_modbus_server(settings).ok());
  settings.host = "192.0.2.254";  // TEST-NET: not an address of this computer
  EXPECT_FALSE(make_modbus_server(settings).ok());
  settings.host = "127.0.0.1";
  settings.unit_id = 0;
  EXPECT_FALSE(make_modbus_server(settings).ok());
  settings.unit_id = 248;
  EXPECT_FALSE(make_modbus_server(settings).ok());
}

TEST(ModbusServerSettings, networks_are_parsed_strictly) {
  const auto ten = parse_network("10.0.0.0/8");
  ASSERT_TRUE(ten.ok());
  EXPECT_EQ(ten.value().address, 0x0A000000U);
  EXPECT_EQ(ten.value().mask, 0xFF000000U);
  EXPECT_EQ(parse_network("192.168.7.9").value().mask, 0xFFFFFFFFU);
  EXPECT_EQ(parse_network("0.0.0.0/0").value().mask, 0U);
  for (const char* bad : {"", "10.0.0.0/", "10.0.0.0/33", "10.0.0.0/-1", "10.0.0.1/8", "10.0.0/8", "ten/8",
                          "10.0.0.0/8/8", "10.0.0.0/8 ", "255.255.255.2555/32", "::1/128"})
    EXPECT_FALSE(parse_network(bad).ok()) << bad;
}

}  // namespace
}  // namespace slabd::hal
