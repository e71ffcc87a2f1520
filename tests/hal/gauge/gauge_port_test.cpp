// SPDX-License-Identifier: Apache-2.0
//
// Instruments and hubs against the gauge port: a Modbus server made of libmodbus, and datagrams.
#include <arpa/inet.h>
#include <gtest/gtest.h>
#include <modbus/modbus.h>
#include <netinet/in.h>
#include <poll.h>
#include <sys/socket.h>

#include <array>
#include <atomic>
#include <bit>
#include <cmath>
#include <mutex>
#include <thread>

#include "base/os.h"
#include "hal/gauge/gauge_datagram.h"
#include "hal/hal.h"
#include "tests/places/ports.h"
#include "tests/places/wait.h"

namespace slabd::hal {
namespace {

using places::wait_until;

/// A Modbus/TCP server with holding and input registers.
class Instrument {
 public:
  Instrument() {
    context_ = modbus_new_tcp("127.0.0.1", 0);
    listener_ = Fd(::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0));
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    socklen_t bytes = sizeof address;
    EXPECT_EQ(::bind(listener_.get(), reinterpret_cast<const sockaddr*>(&address), bytes), 0);
    EXPECT_EQ(::listen(listener_.get(), 4), 0);
    EXPECT_EQ(::getsockname(listener_.get(), reinterpret_cast<sockaddr*>(&address), &bytes), 0);
    port_ = ntohs(address.sin_port);
    thread_ = std::thread([this] { serve(); });
  }
  ~Instrument() {
    stop_ = true;
    thread_.join();
    modbus_mapping_free(memory_);
    modbus_free(context_);
  }
  Instrument(const Instrument&) = delete;
  Instrument& operator=(const Instrument&) = delete;

  [[nodiscard]] std::uint16_t port() const { return port_; }
  void set(std::size_t address, std::uint16_t value, bool input = false) {
    const std::lock_guard lock(mutex_);
    (input ? memory_->tab_input_registers : memory_->tab_registers)[address] = value;
  }
  std::atomic<bool> silent{false};  ///< takes requests and does not answer
  std::atomic<int> connections{0};

 private:
  void serve() {
    Fd peer;
    while (!stop_) {
      std::array<pollfd, 2> ready = {pollfd{listener_.get(), POLLIN, 0}, pollfd{peer.get(), POLLIN, 0}};
      if (::poll(ready.data(), ready.size(), 20) <= 0) continue;
      if ((ready[0].revents & POLLIN) != 0) {
        peer = Fd(::accept4(listener_.get(), nullptr, nullptr, SOCK_CLOEXEC));
        ++connections;
        continue;
      }
      std::array<std::uint8_t, MODBUS_TCP_MAX_ADU_LENGTH> request{};
      modbus_set_socket(context_, peer.get());
      const int n = modbus_receive(context_, request.data());
      const std::lock_guard lock(mutex_);
      if (n < 0)
        peer.reset();
      else if (n > 0 && !silent)
        modbus_reply(context_, request.data(), n, memory_);
    }
  }

  modbus_t* context_;
  modbus_mapping_t* memory_ = modbus_mapping_new(0, 0, 200, 200);
  std::mutex mutex_;
  Fd listener_;
  std::uint16_t port_ = 0;
  std::atomic<bool> stop_{false};
  std::thread thread_;
};

GaugeSettings instrument_gauge(const char* name, std::uint16_t port, std::uint16_t address, GaugeFormat format) {
  GaugeSettings g;
  g.name = name;
  g.link = GaugeLink::modbus;
  g.host = "127.0.0.1";
  g.port = port;
  g.address = address;
  g.format = format;
  return g;
}

GaugeSample newest(const GaugePort& port, std::size_t index) {
  GaugeSamples samples{};
  port.newest(samples);
  return samples[index];
}

GaugeSenders this_computer() {
  GaugeSenders senders;
  EXPECT_TRUE(senders.push({0x7F00'0000U, 0xFF00'0000U}));
  return senders;
}

TEST(GaugePort, reads_every_format_of_an_instrument) {
  Instrument instrument;
  GaugeList gauges;
  const auto add = [&](const char* name, std::uint16_t address, GaugeFormat format, double scale) {
    GaugeSettings g = instrument_gauge(name, instrument.port(), address, format);
    g.scale = scale;
    EXPECT_TRUE(gauges.push(g));
    return &gauges.back();
  };
  add("i16", 0, GaugeFormat::i16, 0.1);
  add("u16", 0, GaugeFormat::u16, 0.1);
  add("i32", 2, GaugeFormat::i32, 0.001);
  add("swapped", 2, GaugeFormat::i32, 0.001)->low_word_first = true;
  add("u32", 4, GaugeFormat::u32, 1.0);
  add("f32", 6, GaugeFormat::f32, 1.0);
  add("input", 8, GaugeFormat::i16, 1.0)->input_register = true;
  add("none", 10, GaugeFormat::i32, 1.0);
  instrument.set(0, 0xFFFE);
  instrument.set(2, 0x0055);
  instrument.set(3, 0x737B);  // 5 600 123
  instrument.set(4, 0x8000);
  const auto f = std::bit_cast<std::uint32_t>(5600.5F);
  instrument.set(6, static_cast<std::uint16_t>(f >> 16U));
  instrument.set(7, static_cast<std::uint16_t>(f & 0xFFFFU));
  instrument.set(8, 7, true);
  instrument.set(10, 0x8000);
  const auto clock = make_system_clock();
  const auto port = make_gauge_port({gauges.data(), gauges.size()}, this_computer(), *clock);
  ASSERT_TRUE(port.ok());
  ASSERT_TRUE(wait_until([&] { return newest(*port.value(), 7).has_value; })) << port.value()->trouble(7).view();
  EXPECT_NEAR(newest(*port.value(), 0).value, -0.2, 1e-12);
  EXPECT_NEAR(newest(*port.value(), 1).value, 6553.4, 1e-9);
  EXPECT_NEAR(newest(*port.value(), 2).value, 5600.123, 1e-9);
  EXPECT_NEAR(newest(*port.value(), 3).value, 0x737B'0055 * 0.001, 1e-6);
  EXPECT_NEAR(newest(*port.value(), 4).value, 2147483648.0, 1e-3);
  EXPECT_NEAR(newest(*port.value(), 5).value, 5600.5, 1e-9);
  EXPECT_NEAR(newest(*port.value(), 6).value, 7.0, 1e-12);
  EXPECT_TRUE(std::isnan(newest(*port.value(), 7).value)) << "0x80000000: the gauge has none";
  EXPECT_EQ(newest(*port.value(), 0).slab_no, 0U) << "an instrument names no slab";
}

TEST(GaugePort, an_instrument_that_does_not_answer_leaves_its_last_value_and_a_reason) {
  Instrument instrument;
  GaugeList gauges;
  EXPECT_TRUE(gauges.push(instrument_gauge("length", instrument.port(), 0, GaugeFormat::u16)));
  EXPECT_TRUE(gauges.push(instrument_gauge("nowhere", 1, 0, GaugeFormat::u16)));
  EXPECT_TRUE(gauges.push(instrument_gauge("beyond", instrument.port(), 199, GaugeFormat::i32)));
  instrument.set(0, 5);
  const auto clock = make_system_clock();
  const auto port = make_gauge_port({gauges.data(), gauges.size()}, this_computer(), *clock);
  ASSERT_TRUE(port.ok());
  ASSERT_TRUE(wait_until([&] { return newest(*port.value(), 0).has_value; }));
  EXPECT_TRUE(wait_until([&] { return !port.value()->trouble(1).empty(); }));
  EXPECT_NE(port.value()->trouble(1).view().find("does not accept a connection"), std::string_view::npos);
  EXPECT_TRUE(wait_until([&] {
    return port.value()->trouble(2).view().find("refuses register 199 with exception 2") != std::string_view::npos;
  })) << port.value()->trouble(2).view();
  // Each round reads gauge 0 and then the refused register. On a computer with other work an answer may be late, which
  // ends the connection: the rounds are looked at again.
  EXPECT_TRUE(wait_until([&] {
    const int connections = instrument.connections;
    const auto seq = newest(*port.value(), 0).seq;
    return wait_until(
               [&] { return newest(*port.value(), 0).seq >= seq + 2 || instrument.connections != connections; }) &&
           instrument.connections == connections;
  })) << "an exception keeps the connection";
  ASSERT_TRUE(wait_until([&] { return port.value()->trouble(0).empty(); }));
  instrument.silent = true;
  instrument.set(0, 6);
  EXPECT_TRUE(wait_until([&] { return !port.value()->trouble(0).empty(); }));
  const GaugeSample last = newest(*port.value(), 0);
  EXPECT_EQ(last.value, 5.0);
  instrument.silent = false;
  EXPECT_TRUE(wait_until([&] { return newest(*port.value(), 0).value == 6.0; }))
      << "the late answer is not taken for it";
  EXPECT_GT(newest(*port.value(), 0).seq, last.seq);
}

TEST(GaugePort, every_gauge_of_a_silent_instrument_is_in_trouble) {
  Instrument instrument;
  GaugeList gauges;
  EXPECT_TRUE(gauges.push(instrument_gauge("left", instrument.port(), 0, GaugeFormat::u16)));
  EXPECT_TRUE(gauges.push(instrument_gauge("right", instrument.port(), 1, GaugeFormat::u16)));
  instrument.set(0, 5);
  instrument.set(1, 6);
  const auto clock = make_system_clock();
  const auto port = make_gauge_port({gauges.data(), gauges.size()}, this_computer(), *clock);
  ASSERT_TRUE(port.ok());
  const auto in_trouble = [&](std::size_t index) { return !port.value()->trouble(index).empty(); };
  ASSERT_TRUE(wait_until([&] { return newest(*port.value(), 1).has_value && !in_trouble(0) && !in_trouble(1); }));
  instrument.silent = true;
  ASSERT_TRUE(wait_until([&] { return in_trouble(0) && in_trouble(1); }));
  EXPECT_EQ(port.value()->trouble(0).view(), "the instrument does not answer");
  EXPECT_EQ(port.value()->trouble(1).view(), "the instrument does not answer");
  instrument.silent = false;
  EXPECT_TRUE(wait_until([&] { return !in_trouble(0) && !in_trouble(1); }));
}

// ---- datagrams ---------------------------------------------------------------------------------------------------

TEST(GaugeDatagram, a_line_has_four_words) {
  const auto line = parse_gauge_line("length_left  5600.123\t17 10042");
  ASSERT_TRUE(line.has_value());
  EXPECT_EQ(line->name, "length_left");
  EXPECT_EQ(line->number, 5600.123);
  EXPECT_EQ(line->seq, 17U);
  EXPECT_EQ(line->slab_no, 10042U);
  EXPECT_TRUE(std::isnan(parse_gauge_line("a nan 1 0")->number));
  for (const char* bad : {"", "a", "a 1", "a 1 2", "a 1 0 3", "a 1 -2 3", "a 1 2 3 4", "a 1,5 2 3", "a x 2 3",
                          "a 1 4294967296 3", "a 1 2 3x", "{\"a\": 1}"})
    EXPECT_FALSE(parse_gauge_line(bad).has_value()) << bad;
}

TEST(GaugeDatagram, lines_end_with_lf_or_cr_lf) {
  std::string_view text = "a 1 1 1\r\n\nb 2 2 2";
  EXPECT_EQ(next_line(text), "a 1 1 1");
  EXPECT_EQ(next_line(text), "");
  EXPECT_EQ(next_line(text), "b 2 2 2");
  EXPECT_TRUE(text.empty());
}

struct UdpTest : ::testing::Test {
  std::uint16_t port_no = places::own_port();
  GaugeList gauges;
  std::unique_ptr<Clock> clock = make_system_clock();
  std::unique_ptr<GaugePort> port;
  Fd socket{::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0)};

  void start(const GaugeSenders& senders) {
    for (const char* name : {"left", "right"}) {
      GaugeSettings g;
      g.name = name;
      g.link = GaugeLink::udp;
      g.port = port_no;
      EXPECT_TRUE(gauges.push(g));
    }
    auto made = make_gauge_port({gauges.data(), gauges.size()}, senders, *clock);
    ASSERT_TRUE(made.ok()) << made.error().text.view();
    port = std::move(made.value());
  }
  void send(std::string_view text) const {
    sockaddr_in to{};
    to.sin_family = AF_INET;
    to.sin_port = htons(port_no);
    to.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    EXPECT_EQ(::sendto(socket.get(), text.data(), text.size(), 0, reinterpret_cast<const sockaddr*>(&to), sizeof to),
              static_cast<ssize_t>(text.size()));
  }
};

TEST_F(UdpTest, values_of_a_hub_arrive_with_number_and_slab) {
  start(this_computer());
  send("left 5600.1 7 42\nright 5600.3 7 42\n");
  ASSERT_TRUE(wait_until([&] { return newest(*port, 1).has_value; }));
  EXPECT_EQ(newest(*port, 0).value, 5600.1);
  EXPECT_EQ(newest(*port, 1).value, 5600.3);
  EXPECT_EQ(newest(*port, 1).seq, 7U);
  EXPECT_EQ(newest(*port, 1).slab_no, 42U);
}

TEST_F(UdpTest, a_repeated_datagram_does_not_refresh_a_value) {
  start(this_computer());
  send("left 5600.1 7 42\n");
  ASSERT_TRUE(wait_until([&] { return newest(*port, 0).has_value; }));
  const GaugeSample first = newest(*port, 0);
  send("left 5600.9 7 43\n");
  ASSERT_TRUE(wait_until([&] { return port->counters().repeated == 1; }));
  EXPECT_EQ(newest(*port, 0).mono_ns, first.mono_ns);
  EXPECT_EQ(newest(*port, 0).value, 5600.1);
}

TEST_F(UdpTest, other_bytes_are_counted_and_change_nothing) {
  start(this_computer());
  send("left five 7 42\n");
  send("middle 5600 7 42\n");
  send(std::string(2'000, 'x'));
  send("left 5600.1 8 42\n");
  ASSERT_TRUE(wait_until([&] { return port->counters().accepted == 1; }));
  EXPECT_EQ(port->counters().malformed, 2U);
  EXPECT_EQ(port->counters().unknown, 1U);
  ScannerText note;
  EXPECT_TRUE(port->next_note(clock->mono_ns(), note));
  EXPECT_NE(note.view().find("2 lines that are not"), std::string_view::npos) << note.view();
}

TEST_F(UdpTest, other_computers_are_refused) {
  GaugeSenders senders;
  ASSERT_TRUE(senders.push({0x0A00'0000U, 0xFF00'0000U}));
  start(senders);
  send("left 5600.1 7 42\n");
  ASSERT_TRUE(wait_until([&] { return port->counters().foreign == 1; }));
  EXPECT_FALSE(newest(*port, 0).has_value);
}

}  // namespace
}  // namespace slabd::hal
