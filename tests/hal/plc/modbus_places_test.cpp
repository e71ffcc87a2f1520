// SPDX-License-Identifier: Apache-2.0
//
// Assignment of places to clients, and ownership of the command block.
#include "tests/hal/plc/modbus_server_line.h"

namespace slabd::hal {
namespace {

TEST_F(ModbusServerTest, a_ninth_client_takes_the_place_of_the_longest_idle) {
  std::vector<std::unique_ptr<RawClient>> clients;
  for (int i = 0; i < 8; ++i) {
    clients.push_back(connected());
    now_ns_ += kNsPerS;
  }
  EXPECT_EQ(server_->clients(), 8U);
  EXPECT_EQ(asked(*clients[0], read_frame(1, 4, 0, 1)).size(), 11U);  // now number 2 is the longest idle
  const auto ninth = connected();
  EXPECT_EQ(server_->clients(), 8U);
  EXPECT_TRUE(clients[1]->closed_by_server());
  EXPECT_TRUE(clients[0]->still_open());
  EXPECT_EQ(asked(*ninth, read_frame(1, 4, 0, 1)).size(), 11U);
}

TEST_F(ModbusServerTest, a_thousand_connections_do_not_push_the_plc_off) {
  const auto plc = connected();
  plc->send(write_frame(1, 39, {1}));
  turn();
  static_cast<void>(plc->receive());
  const auto display = connected();
  EXPECT_EQ(asked(*display, read_frame(1, 4, 0, 1)).size(), 11U);
  std::vector<std::unique_ptr<RawClient>> flood;
  for (int i = 0; i < 1000; ++i) {
    flood.push_back(std::make_unique<RawClient>(server_->bound_port()));
    now_ns_ += kNsPerMs;
    turn();
  }
  EXPECT_EQ(server_->clients(), limits::kModbusClientsMax);
  EXPECT_TRUE(plc->still_open());
  EXPECT_TRUE(display->still_open()) << "who has spoken stays before who has not";
  EXPECT_EQ(asked(*plc, read_frame(2, 4, 0, 1)).size(), 11U);
  EXPECT_EQ(server_->counters().displaced, 1000U - 6U);
  // The same if every new client sends a request: the display is displaced, the commanding client is not.
  for (int i = 0; i < 20; ++i) {
    flood.push_back(connected());
    EXPECT_EQ(asked(*flood.back(), read_frame(1, 4, 0, 1)).size(), 11U);
    EXPECT_EQ(asked(*plc, read_frame(3, 4, 0, 1)).size(), 11U);
    now_ns_ += kNsPerMs;
  }
  EXPECT_FALSE(display->still_open());
}

TEST_F(ModbusServerTest, a_commander_that_fell_silent_makes_room_as_others_do) {
  const auto plc = connected();
  plc->send(write_frame(1, 39, {1}));
  turn();
  static_cast<void>(plc->receive());
  now_ns_ += 6 * kNsPerS;
  std::vector<std::unique_ptr<RawClient>> others;
  for (int i = 0; i < 8; ++i) {
    others.push_back(connected());
    EXPECT_EQ(asked(*others.back(), read_frame(1, 4, 0, 1)).size(), 11U);
  }
  EXPECT_TRUE(plc->closed_by_server());
}

TEST_F(ModbusServerTest, read_only_networks_read_and_do_not_write) {
  PlcSettings settings;
  ASSERT_TRUE(settings.allow.push(parse_network("127.0.0.0/8").value()));
  ASSERT_TRUE(settings.read_only.push(parse_network("127.0.0.7").value()));
  open(settings);
  const auto display = connected("127.0.0.7");
  EXPECT_EQ(asked(*display, read_frame(1, 4, 0, 1)).size(), 11U);
  for (const Bytes& write : {write_frame(2, 0, {1}), write_frame(2, 39, {1}), frame(2, {6, 0, 0, 0, 1}),
                             frame(2, {23, 0, 0, 0, 1, 0, 0, 0, 1, 2, 0, 1})}) {
    display->send(write);
    EXPECT_TRUE(turn().empty());
    const Bytes reply = display->receive();
    ASSERT_EQ(reply.size(), 9U);
    EXPECT_EQ(reply[8], 4);
  }
  EXPECT_EQ(server_->counters().read_only, 4U);
  for (const std::uint16_t word : server_->holding()) EXPECT_EQ(word, 0);
  const auto plc = connected("127.0.0.8");
  plc->send(write_frame(3, 0, {1}));
  EXPECT_EQ(turn().size(), 1U);
}

TEST_F(ModbusServerTest, only_allowed_networks_get_in) {
  PlcSettings settings;
  ASSERT_TRUE(settings.allow.push(parse_network("127.0.0.2/31").value()));
  open(settings);
  const auto stranger = connected("127.0.0.1");
  EXPECT_TRUE(stranger->closed_by_server());
  EXPECT_EQ(server_->clients(), 0U);
  const auto plc = connected("127.0.0.3");
  EXPECT_EQ(asked(*plc, read_frame(1, 4, 0, 1)).size(), 11U);
}

TEST_F(ModbusServerTest, the_last_writer_of_the_command_block_owns_it) {
  const auto a = connected();
  const auto b = connected();
  a->send(write_frame(1, 0, {1}));
  auto writes = turn();
  ASSERT_EQ(writes.size(), 1U);
  EXPECT_EQ(writes[0].command_writer, 0U) << "HR 0..3 have no owner";
  a->send(write_frame(2, 10, {1}));
  const std::uint32_t owner_a = turn().at(0).command_writer;
  EXPECT_NE(owner_a, 0U);
  b->send(write_frame(3, 0, {2, 1, 3, 4}));
  EXPECT_EQ(turn().at(0).command_writer, owner_a);
  b->send(write_frame(4, 9, {0, 2}));  // writes HR 10
  const std::uint32_t owner_b = turn().at(0).command_writer;
  EXPECT_NE(owner_b, owner_a);
  a->send(write_frame(5, 39, {7}));
  EXPECT_EQ(turn().at(0).command_writer, owner_a);
  b->send(write_frame(6, 40, {7}));
  EXPECT_EQ(turn().at(0).command_writer, owner_a) << "the gauges have no owner";
  b->send(write_frame(7, 75, {7}));  // refused: changes nothing
  EXPECT_TRUE(turn().empty());
}

TEST_F(ModbusServerTest, a_new_connection_is_a_new_writer_even_on_the_same_port) {
  auto plc = connected();
  plc->send(write_frame(1, 39, {1}));
  const std::uint32_t first = turn().at(0).command_writer;
  plc.reset();
  turn();
  EXPECT_EQ(server_->clients(), 0U);
  plc = connected();
  plc->send(write_frame(1, 39, {2}));
  EXPECT_GT(turn().at(0).command_writer, first);
}

TEST_F(ModbusServerTest, a_flooding_client_displaces_its_own_connections) {
  PlcSettings settings;
  ASSERT_TRUE(settings.allow.push(parse_network("127.0.0.0/8").value()));
  open(settings);
  std::vector<std::unique_ptr<RawClient>> flood;
  for (int i = 0; i < 20; ++i) {
    flood.push_back(connected("127.0.0.9"));
    EXPECT_EQ(asked(*flood.back(), read_frame(1, 4, 0, 1)).size(), 11U);
    now_ns_ += kNsPerMs;
  }
  const auto plc = connected("127.0.0.1");  // reconnected after a loss, without a request yet
  for (int i = 0; i < 100; ++i) {
    flood.push_back(connected("127.0.0.9"));
    EXPECT_EQ(asked(*flood.back(), read_frame(1, 4, 0, 1)).size(), 11U);
    now_ns_ += kNsPerMs;
  }
  EXPECT_TRUE(plc->still_open());
  EXPECT_EQ(asked(*plc, read_frame(2, 4, 0, 1)).size(), 11U);
}

TEST_F(ModbusServerTest, narrower_network_of_allow_and_read_only_decides) {
  PlcSettings settings;
  ASSERT_TRUE(settings.allow.push(parse_network("127.0.0.10/32").value()));
  ASSERT_TRUE(settings.allow.push(parse_network("127.1.0.0/16").value()));
  ASSERT_TRUE(settings.read_only.push(parse_network("127.0.0.0/24").value()));
  ASSERT_TRUE(settings.read_only.push(parse_network("127.1.1.0/24").value()));
  open(settings);
  const auto writes = [&](const char* from) {
    const auto client = connected(from);
    client->send(write_frame(3, 0, {1}));
    return turn().size();
  };
  EXPECT_EQ(writes("127.0.0.10"), 1U);
  EXPECT_EQ(writes("127.0.0.11"), 0U);
  EXPECT_EQ(writes("127.1.2.1"), 1U);
  EXPECT_EQ(writes("127.1.1.1"), 0U);
}

TEST_F(ModbusServerTest, each_write_of_the_command_block_is_counted) {
  const auto plc = connected();
  plc->send(write_frame(1, 10, {1}));
  const std::uint32_t first = turn().at(0).command_writes;
  plc->send(write_frame(2, 0, {1}));
  EXPECT_EQ(turn().at(0).command_writes, first);
  plc->send(write_frame(3, 10, {1}));
  EXPECT_EQ(turn().at(0).command_writes, first + 1);
}

TEST_F(ModbusServerTest, displays_never_take_the_last_two_places) {
  PlcSettings settings;
  ASSERT_TRUE(settings.allow.push(parse_network("127.0.0.0/8").value()));
  ASSERT_TRUE(settings.read_only.push(parse_network("127.0.0.7").value()));
  open(settings);
  const auto quiet_plc = connected("127.0.0.1");
  EXPECT_EQ(asked(*quiet_plc, read_frame(1, 4, 0, 1)).size(), 11U);
  std::vector<std::unique_ptr<RawClient>> displays;
  for (int i = 0; i < 30; ++i) {
    displays.push_back(connected("127.0.0.7"));
    EXPECT_EQ(asked(*displays.back(), read_frame(1, 4, 0, 1)).size(), 11U) << "the newest is served";
    now_ns_ += kNsPerMs;
  }
  EXPECT_EQ(server_->clients(), 7U);
  EXPECT_TRUE(quiet_plc->still_open());
  const auto second = connected("127.0.0.2");
  EXPECT_EQ(server_->clients(), 8U);
  EXPECT_TRUE(displays[29]->still_open());
  // All places are taken: a display is displaced before any client that may write, even one that was silent longer.
  now_ns_ += kNsPerS;
  EXPECT_EQ(asked(*displays[29], read_frame(1, 4, 0, 1)).size(), 11U);
  EXPECT_EQ(asked(*second, read_frame(1, 4, 0, 1)).size(), 11U);
  const auto third = connected("127.0.0.3");
  EXPECT_TRUE(quiet_plc->still_open());
  EXPECT_TRUE(second->still_open());
  EXPECT_EQ(asked(*third, read_frame(1, 4, 0, 1)).size(), 11U);
}

TEST_F(ModbusServerTest, registers_of_two_writers_never_form_one_command) {
  const auto plc = connected();
  const auto stranger = connected();
  plc->send(write_frame(1, 10, {2, 5, 5600}));
  ASSERT_EQ(turn().size(), 1U);
  stranger->send(write_frame(2, 11, {17}));
  PlcInputs seen = turn().at(0);
  EXPECT_EQ(seen.station, 17);
  EXPECT_EQ(seen.command, 0) << "the PLC's words are gone with the PLC's turn";
  plc->send(write_frame(3, 38, {1, 9}));
  seen = turn().at(0);
  EXPECT_EQ(seen.cmd_seq, 9);
  EXPECT_EQ(seen.station, 0) << "a station that the PLC has not written";
  EXPECT_EQ(seen.command, 0);
  // HR 0..3 do not belong to a connection and stay.
  stranger->send(write_frame(4, 0, {8}));
  ASSERT_EQ(turn().size(), 1U);
  plc->send(write_frame(5, 10, {2}));
  EXPECT_EQ(turn().at(0).heartbeat, 8);
}

TEST_F(ModbusServerTest, a_refused_write_takes_no_block_over) {
  const auto plc = connected();
  const auto stranger = connected();
  plc->send(write_frame(1, 10, {2, 5, 5600}));
  ASSERT_EQ(turn().size(), 1U);
  std::vector<unsigned> too_many(36, 1);  // HR 39 and the gauges' 40..74
  too_many.push_back(1);                  // exceeds the map
  stranger->send(write_frame(2, 39, too_many));
  EXPECT_TRUE(turn().empty());
  plc->send(write_frame(3, 39, {9}));
  EXPECT_EQ(turn().at(0).station, 5);
}

}  // namespace
}  // namespace slabd::hal
