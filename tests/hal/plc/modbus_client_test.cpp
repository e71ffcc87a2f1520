// SPDX-License-Identifier: Apache-2.0
//
// The client against a PLC with defined misbehaviour.
#include <arpa/inet.h>
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <poll.h>
#include <sys/socket.h>

#include <atomic>
#include <chrono>
#include <functional>
#include <memory>
#include <mutex>
#include <thread>
#include <vector>

#include "base/os.h"
#include "hal/hal.h"
#include "hal/plc/modbus_codec.h"
#include "hal/plc/plc_map.h"
#include "tests/places/wait.h"

namespace slabd::hal {
namespace {

/// A PLC's Modbus server: 2000 holding registers and one connection at a time.
class FakePlc {
 public:
  enum class Manner : std::uint8_t {
    good,
    deaf,
    late,
    drops_answer,
    refuses_writes,
    garbles,
    drips,
    closes_behind,
    forgets_transaction,
    lags_transaction
  };

  FakePlc() {
    open_listener(0);
    thread_ = std::thread([this] { run(); });
  }
  ~FakePlc() {
    stop_ = true;
    thread_.join();
  }
  FakePlc(const FakePlc&) = delete;
  FakePlc& operator=(const FakePlc&) = delete;

  [[nodiscard]] std::uint16_t port() const { return port_; }
  void set(std::size_t address, std::uint16_t value) {
    const std::lock_guard lock(mutex_);
    memory_[address] = value;
  }
  void order(std::uint16_t station, std::uint16_t cmd_seq) {
    const std::lock_guard lock(mutex_);
    memory_[11] = station;
    memory_[39] = cmd_seq;
  }
  /// The next answer that contains this register has another value in it.
  void tear_next_answer(std::size_t address, std::uint16_t value) {
    const std::lock_guard lock(mutex_);
    torn_at_ = address;
    torn_to_ = value;
    tears_ = true;
  }
  [[nodiscard]] bool tears() const { return tears_; }
  [[nodiscard]] std::uint16_t get(std::size_t address) const {
    const std::lock_guard lock(mutex_);
    return memory_[address];
  }
  /// Power off: the connection breaks, the port is closed, and the memory is blank afterwards.
  void power(bool on) { powered_ = on; }

  std::atomic<Manner> manner = Manner::good;
  std::atomic<int> connections = 0;
  std::atomic<int> writes_of_all = 0;
  std::atomic<int> frames = 0;
  std::atomic<std::size_t> registers_max = 125;
  std::atomic<int> missing_function = 0;
  /// First register and count of every request, in order.
  [[nodiscard]] std::vector<std::pair<std::size_t, std::size_t>> requests() const {
    const std::lock_guard lock(mutex_);
    return requests_;
  }

 private:
  void open_listener(std::uint16_t port) {
    listener_ = Fd(socket(AF_INET, SOCK_STREAM, 0));
    const int on = 1;
    setsockopt(listener_.get(), SOL_SOCKET, SO_REUSEADDR, &on, sizeof on);
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_port = htons(port);
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    ASSERT_EQ(bind(listener_.get(), reinterpret_cast<const sockaddr*>(&address), sizeof address), 0);
    ASSERT_EQ(listen(listener_.get(), 4), 0);
    socklen_t bytes = sizeof address;
    getsockname(listener_.get(), reinterpret_cast<sockaddr*>(&address), &bytes);
    port_ = ntohs(address.sin_port);
  }

  void run() {
    while (!stop_) {
      if (!powered_) {
        peer_.reset();
        listener_.reset();
        const std::lock_guard lock(mutex_);
        memory_.fill(0);
      } else if (!listener_.is_open()) {
        open_listener(port_);
      }
      std::array<pollfd, 2> fds = {pollfd{listener_.get(), POLLIN, 0}, pollfd{peer_.get(), POLLIN, 0}};
      poll(fds.data(), 2, 5);
      if ((fds[0].revents & POLLIN) != 0) {
        peer_ = Fd(accept(listener_.get(), nullptr, nullptr));
        ++connections;
      }
      if ((fds[1].revents & (POLLIN | POLLHUP)) != 0) serve();
    }
  }

  void serve() {
    std::array<std::uint8_t, 260> frame{};
    const ssize_t n = recv(peer_.get(), frame.data(), frame.size(), 0);
    if (n < 12) {
      peer_.reset();
      return;
    }
    ++frames;
    std::vector<std::uint8_t> reply(frame.begin(), frame.begin() + 7);
    const bool keep = fill(std::span(frame).subspan(7), reply);
    reply[4] = static_cast<std::uint8_t>((reply.size() - 6) >> 8U);
    reply[5] = static_cast<std::uint8_t>(reply.size() - 6);
    const Manner now = manner;
    if (now == Manner::forgets_transaction) reply[0] = reply[1] = 0;
    if (now == Manner::lags_transaction) std::swap_ranges(reply.begin(), reply.begin() + 2, before_.begin());
    if (now == Manner::garbles) reply[0] = static_cast<std::uint8_t>(reply[0] + 1);
    if (now == Manner::deaf) return;
    if (now == Manner::drops_answer) {
      peer_.reset();
      return;
    }
    if (now == Manner::late) std::this_thread::sleep_for(std::chrono::milliseconds(600));
    if (now == Manner::drips) {
      for (const std::uint8_t byte : reply) {
        if (::send(peer_.get(), &byte, 1, MSG_NOSIGNAL) != 1 || stop_) break;
        std::this_thread::sleep_for(std::chrono::milliseconds(50));
      }
      return;
    }
    if (keep) ::send(peer_.get(), reply.data(), reply.size(), MSG_NOSIGNAL);
    if (now == Manner::closes_behind) peer_.reset();
  }

  bool fill(std::span<const std::uint8_t> pdu, std::vector<std::uint8_t>& reply) {
    const std::lock_guard lock(mutex_);
    const auto word = [&](std::size_t at) { return static_cast<std::size_t>(pdu[at] << 8U | pdu[at + 1]); };
    const bool both = pdu[0] == 23;
    requests_.emplace_back(word(both ? 5 : 1), word(both ? 7 : 3));
    if (pdu[0] == missing_function) {
      reply.insert(reply.end(), {static_cast<std::uint8_t>(pdu[0] | 0x80), 1});
      return true;
    }
    if (requests_.back().second > registers_max || (both && word(3) > registers_max)) {
      reply.insert(reply.end(), {static_cast<std::uint8_t>(pdu[0] | 0x80), 3});
      return true;
    }
    if (pdu[0] == 16 || both) {
      if (manner == Manner::refuses_writes) {
        reply.insert(reply.end(), {static_cast<std::uint8_t>(pdu[0] | 0x80), 2});
        return true;
      }
      const std::size_t first = word(both ? 5 : 1);
      const std::size_t count = word(both ? 7 : 3);
      if (count == kInputRegisters) ++writes_of_all;
      for (std::size_t i = 0; i < count; ++i)
        memory_[first + i] = static_cast<std::uint16_t>(word((both ? 10U : 6U) + 2 * i));
      if (!both) reply.insert(reply.end(), pdu.begin(), pdu.begin() + 5);
    }
    if (pdu[0] == 3 || both) {
      reply.push_back(pdu[0]);
      reply.push_back(static_cast<std::uint8_t>(2 * word(3)));
      for (std::size_t i = 0; i < word(3); ++i) {
        const bool torn = tears_ && word(1) + i == torn_at_;
        const unsigned value = torn ? torn_to_ : memory_[word(1) + i];
        if (torn) tears_ = false;
        reply.push_back(static_cast<std::uint8_t>(value >> 8U));
        reply.push_back(static_cast<std::uint8_t>(value & 0xFFU));
      }
    }
    return true;
  }

  Fd listener_;
  Fd peer_;
  std::uint16_t port_ = 0;
  mutable std::mutex mutex_;
  std::array<std::uint16_t, 2000> memory_{};
  std::vector<std::pair<std::size_t, std::size_t>> requests_;
  std::array<std::uint8_t, 2> before_{};  ///< transaction number of the preceding request
  std::atomic<bool> tears_ = false;
  std::size_t torn_at_ = 0;
  unsigned torn_to_ = 0;
  std::atomic<bool> powered_ = true;
  std::atomic<bool> stop_ = false;
  std::thread thread_;
};

struct ModbusClientTest : ::testing::Test {
  FakePlc plc;
  PlcSettings settings;
  std::int64_t timeout_ns = 20 * kNsPerS;  ///< longer than a loaded computer delays a good PLC
  std::unique_ptr<PlcPort> port;
  PlcOutputs outputs;
  std::vector<PlcInputs> seen;

  void start() {
    settings.role = PlcRole::client;
    settings.port = plc.port();
    settings.poll_ns = 10 * kNsPerMs;
    settings.timeout_ns = timeout_ns;
    auto made = make_plc_port(settings);
    ASSERT_TRUE(made.ok()) << made.error().text.c_str();
    port = std::move(made.value());
  }
  /// Turns the loop until `done`.
  [[nodiscard]] testing::AssertionResult until(const std::function<bool()>& done) {
    const auto turn = [&] {
      if (done()) return true;
      std::array<pollfd, kPlcPollFds> fds{};
      const std::size_t count = port->poll_fds(fds);
      poll(fds.data(), count, 5);
      PlcInputs inputs;
      while (port->next(0, inputs)) seen.push_back(inputs);
      port->publish(outputs);
      return false;
    };
    if (places::wait_until(turn)) return testing::AssertionSuccess();
    return testing::AssertionFailure() << "the link does not come to this; its trouble: \"" << port->trouble() << '"';
  }
  [[nodiscard]] bool linked() const { return port->trouble().empty(); }
};

TEST_F(ModbusClientTest, moves_both_images) {
  plc.set(0, 7);
  plc.set(39, 12);
  start();
  outputs.session = 321;
  ASSERT_TRUE(until([&] { return plc.get(1009) == 321 && !seen.empty() && seen.back().cmd_seq != 0; }));
  EXPECT_EQ(plc.get(1000), kMapMagic);
  EXPECT_EQ(seen.back().heartbeat, 7);
  EXPECT_EQ(seen.back().cmd_seq, 12);
  EXPECT_EQ(seen.back().command_writer, 1U);
  EXPECT_EQ(port->clients(), 1U);
  plc.set(39, 13);
  ASSERT_TRUE(until([&] { return seen.back().cmd_seq == 13; }));
  outputs.cmd_ack = 13;
  ASSERT_TRUE(until([&] { return plc.get(1010) == 13; }));
  outputs.heartbeat = 99;
  ASSERT_TRUE(until([&] { return plc.get(1004) == 99; }));
}

TEST_F(ModbusClientTest, a_block_that_was_torn_on_its_way_is_never_delivered) {
  plc.order(1, 7);
  start();
  ASSERT_TRUE(until([&] { return !seen.empty() && seen.back().cmd_seq == 7; }));
  for (std::uint16_t station = 2; station < 40; ++station) {
    // An answer that copies registers upwards while the PLC's program writes the next command: its end is already new.
    plc.tear_next_answer(39, static_cast<std::uint16_t>(station + 6));
    ASSERT_TRUE(until([&] { return !plc.tears(); }));
    plc.order(station, static_cast<std::uint16_t>(station + 6));
    ASSERT_TRUE(until([&] { return seen.back().cmd_seq == station + 6; }));
    EXPECT_EQ(seen.back().station, station);
  }
  for (const PlcInputs& inputs : seen) EXPECT_TRUE(inputs.cmd_seq == 0 || inputs.station + 6 == inputs.cmd_seq);
}

TEST_F(ModbusClientTest, bases_word_order_and_read_write_are_as_configured) {
  settings.command_base = 500;
  settings.status_base = 300;
  settings.read_write = true;
  settings.word_order = WordOrder::cdab;
  plc.set(514, 1);
  plc.set(515, 2);
  start();
  ASSERT_TRUE(until([&] { return !seen.empty() && seen.back().slab_no != 0 && plc.get(300) == kMapMagic; }));
  EXPECT_EQ(seen.back().slab_no, 0x00020001U);
  EXPECT_EQ(plc.get(302), 0x5678);
  EXPECT_EQ(plc.get(0), 0);
}

TEST_F(ModbusClientTest, gauges_are_read_by_themselves_if_the_plc_takes_too_few_registers_at_once) {
  settings.gauges = settings.read_write = true;
  settings.registers_max = 48;
  plc.registers_max = 48;
  plc.order(5, 7);
  start();
  ASSERT_TRUE(until([&] { return !seen.empty() && seen.back().cmd_seq == 7; })) << port->trouble();
  for (const auto& [first, count] : plc.requests()) EXPECT_LE(count, 48U) << first;
}

TEST_F(ModbusClientTest, a_plc_that_restarts_gets_the_present_image_and_is_a_new_connection) {
  start();
  outputs.session = 1;
  ASSERT_TRUE(until([&] { return linked() && plc.get(1009) == 1; }));
  plc.power(false);
  ASSERT_TRUE(until([&] { return !linked() && plc.get(1009) == 0; }));
  EXPECT_EQ(port->clients(), 0U);
  for (std::uint16_t session = 2; session < 6; ++session) {  // changes in the meantime are not replayed
    outputs.session = session;
    port->publish(outputs);
  }
  const int before = plc.writes_of_all;
  const int connections = plc.connections;
  plc.power(true);
  ASSERT_TRUE(until([&] { return linked() && plc.get(1009) == 5; }));
  // Once a connection; a slow test computer may need more than one connection.
  EXPECT_GE(plc.writes_of_all, before + 1);
  EXPECT_LE(plc.writes_of_all - before, plc.connections - connections);
  EXPECT_GE(seen.back().command_writer, 2U);
  EXPECT_EQ(seen.back().cmd_seq, 0) << "its memory is blank, and that is reported";
}

TEST_F(ModbusClientTest, every_misbehaviour_ends_the_connection_and_the_next_one_is_good) {
  using enum FakePlc::Manner;
  timeout_ns = 400 * kNsPerMs;
  start();
  ASSERT_TRUE(until([&] { return linked(); }));
  for (const FakePlc::Manner manner : {deaf, late, drops_answer, refuses_writes, garbles, drips}) {
    SCOPED_TRACE(static_cast<int>(manner));
    const int connections = plc.connections;
    plc.manner = manner;
    ++outputs.session;
    ASSERT_TRUE(until([&] { return !linked(); }));
    EXPECT_NE(port->trouble().find("127.0.0.1"), std::string_view::npos) << port->trouble();
    plc.manner = good;
    ASSERT_TRUE(until([&] { return linked() && plc.get(1009) == outputs.session; }));
    EXPECT_GT(plc.connections, connections);
  }
  const PlcLinkCounters& counters = port->counters();
  EXPECT_GE(counters.late, 3U);
  EXPECT_GE(counters.exceptions, 1U);
  EXPECT_GE(counters.malformed, 1U);
}

TEST_F(ModbusClientTest, a_plc_that_lacks_the_registers_is_reported_with_the_key) {
  plc.manner = FakePlc::Manner::refuses_writes;
  start();
  ASSERT_TRUE(until([&] { return port->counters().exceptions > 0; }));
  EXPECT_NE(port->trouble().find("plc.status_base"), std::string_view::npos) << port->trouble();
}

TEST_F(ModbusClientTest, a_plc_that_takes_few_registers_gets_the_words_that_announce_last) {
  using Requests = std::vector<std::pair<std::size_t, std::size_t>>;
  const Requests state_last_100 = {{1064, 46}, {1000, 64}};
  const Requests state_last_48 = {{1064, 46}, {1030, 34}, {1000, 30}};
  const Requests state_last_16 = {{1094, 16}, {1078, 16}, {1064, 14}, {1048, 16},
                                  {1032, 16}, {1030, 2},  {1014, 16}, {1000, 14}};
  for (const auto& [most, writes] : {std::pair{100, state_last_100}, {48, state_last_48}, {16, state_last_16}}) {
    SCOPED_TRACE(most);
    port.reset();
    plc.registers_max = static_cast<std::size_t>(most);
    settings.registers_max = static_cast<std::uint16_t>(most);
    const std::size_t before = plc.requests().size();
    plc.order(5, static_cast<std::uint16_t>(most));
    start();
    outputs.session = static_cast<std::uint16_t>(most);
    ASSERT_TRUE(until([&] { return plc.get(1009) == most && !seen.empty() && seen.back().cmd_seq == most; }));
    EXPECT_EQ(seen.back().station, 5);
    const Requests all = plc.requests();
    const Requests first(all.begin() + static_cast<std::ptrdiff_t>(before),
                         all.begin() + static_cast<std::ptrdiff_t>(before + writes.size()));
    EXPECT_EQ(first, writes);
    for (std::size_t i = before; i < all.size(); ++i) EXPECT_LE(all[i].second, static_cast<std::size_t>(most));
    if (most != 16) continue;
    const Requests from_CMD_SEQ = {{24, 16}, {10, 14}, {0, 10}};
    EXPECT_NE(std::search(all.begin(), all.end(), from_CMD_SEQ.begin(), from_CMD_SEQ.end()), all.end());
  }
}

TEST_F(ModbusClientTest, too_many_registers_for_one_request_are_reported_with_the_key) {
  plc.registers_max = 100;
  start();
  const auto told = [&](const char* text) {
    ASSERT_TRUE(until([&] { return port->trouble().find(text) != std::string_view::npos; }));
    EXPECT_NE(port->trouble().find(text), std::string_view::npos) << port->trouble();
    EXPECT_EQ(port->trouble().find("FC 23"), std::string_view::npos) << port->trouble();
    port.reset();
  };
  told("are 110 registers too many for one request? plc.registers_max = 100 or 48, see its manual");
  settings.registers_max = 100;
  plc.registers_max = 40;
  start();
  told("FC 16 with 46 registers is refused: see its manual for the largest request (plc.registers_max)");
  plc.registers_max = 60;
  start();
  told("are 64 registers too many for one request? plc.registers_max = 48, see its manual");
}

TEST_F(ModbusClientTest, a_function_that_the_plc_lacks_is_named) {
  struct Case {
    int missing;
    bool read_write;
    const char* text;
  };
  for (const Case& c : {Case{16, false, "the PLC does not serve FC 16"}, Case{3, false, "the PLC does not serve FC 3"},
                        Case{23, true, "the PLC does not serve FC 23: plc.read_write = false writes with FC 16"}}) {
    plc.missing_function = c.missing;
    settings.read_write = c.read_write;
    start();
    ASSERT_TRUE(until([&] { return port->trouble().find(c.text) != std::string_view::npos; }));
    EXPECT_NE(port->trouble().find(c.text), std::string_view::npos) << port->trouble();
    EXPECT_EQ(port->trouble().find("FC 23") != std::string_view::npos, c.missing == 23) << port->trouble();
    port.reset();
  }
}

TEST_F(ModbusClientTest, a_plc_that_closes_after_each_answer_is_reported_and_supported) {
  plc.manner = FakePlc::Manner::closes_behind;
  start();
  ASSERT_TRUE(until([&] { return port->trouble().find("plc.keep_connection = false") != std::string_view::npos; }));
  port.reset();
  settings.keep_connection = false;
  seen.clear();
  plc.order(3, 44);
  start();
  outputs.session = 17;
  ASSERT_TRUE(until([&] { return linked() && plc.get(1009) == 17 && !seen.empty() && seen.back().cmd_seq == 44; }));
  const int connections = plc.connections;
  plc.order(4, 45);
  ASSERT_TRUE(until([&] { return seen.back().cmd_seq == 45; }));
  EXPECT_GT(plc.connections, connections);
  EXPECT_EQ(seen.back().command_writer, 1U) << "the same PLC, whatever its connections";
  EXPECT_TRUE(linked());
}

TEST_F(ModbusClientTest, transaction_numbers_that_are_not_the_questions_are_named) {
  using enum FakePlc::Manner;
  timeout_ns = 400 * kNsPerMs;
  plc.manner = forgets_transaction;
  start();
  ASSERT_TRUE(until([&] { return port->trouble().find("transaction number 0") != std::string_view::npos; }));
  plc.manner = good;
  ASSERT_TRUE(until([&] { return linked(); }));
  plc.manner = lags_transaction;
  ASSERT_TRUE(until([&] { return port->trouble().find("of the request before") != std::string_view::npos; }));
  plc.manner = late;
  ASSERT_TRUE(until([&] { return port->trouble().find("plc.timeout_ms is 400") != std::string_view::npos; }));
}

TEST_F(ModbusClientTest, an_unreachable_plc_does_not_delay_the_loop) {
  start();
  port.reset();
  plc.power(false);
  settings.host = "127.0.0.1";
  auto made = make_plc_port(settings);
  ASSERT_TRUE(made.ok());
  port = std::move(made.value());
  ASSERT_TRUE(until([&] { return port->trouble().find("connecting") != std::string_view::npos; }));
  PlcInputs inputs;
  EXPECT_FALSE(port->next(0, inputs));
}

TEST(ModbusClientSettings, faults_are_named) {
  PlcSettings settings;
  settings.role = PlcRole::client;
  const auto fault = [&] {
    const auto made = make_plc_port(settings);
    return made.ok() ? std::string() : std::string(made.error().text.view());
  };
  settings.host = "plc";
  EXPECT_NE(fault().find("plc.connect"), std::string::npos);
  settings.host = "127.0.0.1";
  settings.port = 0;
  EXPECT_NE(fault().find("port 0"), std::string::npos);
  settings.port = 502;
  settings.status_base = 39;
  EXPECT_NE(fault().find("overlap"), std::string::npos);
  settings.status_base = 65'500;
  EXPECT_NE(fault().find("65426"), std::string::npos);
  settings.status_base = 40;
  settings.unit_id = 250;
  EXPECT_NE(fault().find("unit_id"), std::string::npos);
}

}  // namespace
}  // namespace slabd::hal
