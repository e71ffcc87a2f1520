// SPDX-License-Identifier: Apache-2.0
//
// A real daemon with sealed memory: it inspects slabs, and if memory runs out it keeps running and the slab passes.
#include <arpa/inet.h>
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include <array>
#include <cstdlib>
#include <fstream>
#include <map>

#include "daemon/seal.h"
#include "processes.h"
#include "tests/places/places.h"

namespace slabd::line {
namespace {

/// A connection that closes itself; -1 if it was not accepted.
class Peer {
 public:
  explicit Peer(std::uint16_t port) : fd_(::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0)) {
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_port = htons(port);
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    (void)::connect(fd_, reinterpret_cast<const sockaddr*>(&address), sizeof address);
  }
  explicit Peer(const fs::path& socket) : fd_(::socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0)) {
    sockaddr_un address{};
    address.sun_family = AF_UNIX;
    const timeval patience{2, 0};
    ::setsockopt(fd_, SOL_SOCKET, SO_RCVTIMEO, &patience, sizeof patience);
    socket.native().copy(address.sun_path, sizeof address.sun_path - 1);
    (void)::connect(fd_, reinterpret_cast<const sockaddr*>(&address), sizeof address);
  }
  Peer(Peer&& other) noexcept : fd_(std::exchange(other.fd_, -1)) {}
  Peer& operator=(Peer&&) = delete;
  Peer(const Peer&) = delete;
  Peer& operator=(const Peer&) = delete;
  ~Peer() {
    if (fd_ >= 0) ::close(fd_);
  }
  void send(const std::string& bytes) const { (void)::send(fd_, bytes.data(), bytes.size(), MSG_NOSIGNAL); }
  /// The beginning of an answer; empty if none came.
  [[nodiscard]] std::string receive() const {
    std::array<char, 1024> bytes{};
    const ssize_t got = ::recv(fd_, bytes.data(), bytes.size(), 0);
    return got > 0 ? std::string(bytes.data(), static_cast<std::size_t>(got)) : std::string();
  }

 private:
  int fd_;
};

class SealLine : public testing::Test {
 protected:
  void TearDown() override {
    if (HasFailure()) std::fprintf(stderr, "---- slabd ----\n%s", box_.log().c_str());
  }
  /// Repeated if the daemon has no memory for the answer, which some of these tests provoke.
  [[nodiscard]] double figure(const std::string& name) const {
    for (int i = 0; i < 20; ++i) {
      const std::string text = box_.slabctl({"metrics", "--config", box_.config.native()}).out;
      const std::size_t at = text.find("\n" + name + " ");
      if (at != std::string::npos) return std::stod(text.substr(at + name.size() + 2));
    }
    return -1.0;
  }
  [[nodiscard]] bool locking_is_refused() const {
    return box_.log().find("memory cannot be locked") != std::string::npos;
  }
  /// Provokes all kinds of allocations during the life of `line`: 64 kB of JSON in every form, a hundred Modbus
  /// connections with half a frame each, backups.
  void provoke(Process& line) {
    std::map<std::string, std::string> requests;
    requests["flat"] = "[0";
    while (requests["flat"].size() < 65'000) requests["flat"] += ",0";
    requests["flat"] += "]";
    requests["deep"] = std::string(65'000, '[');
    requests["keys"] = "{\"a\":[]";
    for (int i = 0; requests["keys"].size() < 65'000; ++i) requests["keys"] += ",\"" + std::to_string(i) + "\":{}";
    requests["keys"] += "}";
    requests["long"] = "{\"verb\":\"" + std::string(65'000, 'x') + "\"}";
    for (const char* verb : {"status", "metrics", "calibration", "plc_image", "care", "backup"})
      requests[verb] = std::string("{\"verb\":\"") + verb + "\"}";
    while (line.running()) {
      std::vector<Peer> modbus;
      for (int i = 0; i < 100; ++i) {
        modbus.emplace_back(box_.port);
        modbus.back().send(std::string("\0\1\0\0\0\6\1", 7));
      }
      for (const auto& [name, request] : requests) {
        const Peer peer(box_.dir / "control.sock");
        peer.send(request + "\n");
        if (!peer.receive().empty()) ++answers_;
        // Other clients disconnect before their answer is made.
        Peer(box_.dir / "control.sock").send(request + "\n");
      }
      ASSERT_TRUE(box_.running());
    }
  }
  Box box_;
  int answers_ = 0;
};

TEST_F(SealLine, a_daemon_that_can_take_no_more_memory_inspects_slabs_and_is_backed_up) {
  box_.start({"--seal"});
  ASSERT_TRUE(box_.ready());
  const double limit = figure("slabd_memory_limit_bytes");
  EXPECT_GT(limit, 100e6);
  // Without permission to lock that much memory it logs that and continues.
  EXPECT_TRUE(locking_is_refused() || figure("slabd_memory_locked_bytes") > 100e6);
  const Box::Answer slabs = box_.slabctl(
      {"simulate", "--config", box_.config.native(), "--points", "quarter", "--slabs", "2", "--slab-no", "1"});
  EXPECT_EQ(slabs.exit_status, 0) << slabs.out << slabs.err;
  EXPECT_EQ(box_.slabctl({"db", "backup", "--config", box_.config.native()}).exit_status, 0);
  EXPECT_LT(figure("slabd_memory_mapped_bytes"), limit);
  EXPECT_EQ(figure("slabd_memory_reserve_uses_total"), 0.0) << "20 MB are enough for all that is ever asked";
  std::printf("mapped %.1f MB of %.1f MB, locked %.1f MB\n", figure("slabd_memory_mapped_bytes") / 1e6, limit / 1e6,
              figure("slabd_memory_locked_bytes") / 1e6);
  EXPECT_EQ(box_.stop(), 0);
}

TEST_F(SealLine, every_stack_is_there_from_the_start) {
  box_.start({"--seal"});
  ASSERT_TRUE(box_.ready());
  (void)figure("slabd_uptime_seconds");  // answered only once sealed
  if (locking_is_refused()) {
    EXPECT_NE(box_.log().find("MB are needed, LimitMEMLOCK allows"), std::string::npos) << "nothing is touched then";
    return;
  }
  std::size_t threads = 0;
  for (const auto& task : fs::directory_iterator("/proc/" + std::to_string(box_.pid()) + "/task"))
    threads += task.is_directory() ? 1U : 0U;
  // The stacks in order of their addresses: of the requested size, and completely resident.
  std::size_t stacks = 0;
  std::ifstream smaps("/proc/" + std::to_string(box_.pid()) + "/smaps");
  std::string line;
  std::size_t size_kb = 0;
  while (std::getline(smaps, line)) {
    if (line.starts_with("Size:")) size_kb = std::stoul(line.substr(5));
    if (line.starts_with("Rss:") && size_kb == daemon::kThreadStackBytes / 1024 &&
        std::stoul(line.substr(4)) == size_kb)
      ++stacks;
  }
  EXPECT_GE(stacks, threads - 1) << "of all threads but the first";
  EXPECT_EQ(box_.stop(), 0);
}

TEST_F(SealLine, with_hardly_any_room_it_refuses_answers_and_neither_ends_nor_spoils_a_slab) {
  box_.start({"--seal=4"});
  ASSERT_TRUE(box_.ready());
  const auto line = box_.simulate({});
  provoke(*line);
  EXPECT_EQ(line->wait(), 0) << read_file(box_.dir / "simulate.out") << read_file(box_.dir / "simulate.err");
  EXPECT_GT(answers_, 0);
  EXPECT_GT(figure("slabd_memory_limit_bytes"), 0.0) << "who asks alone is answered";
  EXPECT_EQ(box_.stop(), 0);
}

TEST_F(SealLine, requests_for_memory_that_fail_neither_end_it_nor_spoil_a_slab) {
  box_.launcher = {"/usr/bin/env", "LD_PRELOAD=" + places::failing_malloc(), "SLABD_FAIL_EVERY=41"};
  box_.start({"--seal"});
  ASSERT_TRUE(box_.ready());
  const auto line = box_.simulate({});
  provoke(*line);
  EXPECT_EQ(line->wait(), 0) << read_file(box_.dir / "simulate.out") << read_file(box_.dir / "simulate.err");
  EXPECT_GT(figure("slabd_memory_reserve_uses_total"), 0.0) << "the test bites";
  EXPECT_EQ(box_.stop(), 0);
}

// The thread that opens the database, and the loop that waits for it, end before the process is sealed.
TEST_F(SealLine, the_seal_comes_when_the_database_could_be_opened_at_last) {
  Box other;
  other.start();
  ASSERT_TRUE(other.ready());
  std::string text = read_file(box_.config);
  for (const char* name : {"slabd.db", "spool"}) {
    const std::string ours = (box_.dir / name).native();
    text.replace(text.find(ours), ours.size(), (other.dir / name).native());
  }
  std::ofstream(box_.config) << text;
  box_.start({"--seal"});
  ASSERT_TRUE(box_.ready());
  EXPECT_EQ(figure("slabd_fault_code"), 502.0);
  EXPECT_EQ(figure("slabd_memory_limit_bytes"), 0.0);
  EXPECT_EQ(other.stop(), 0);
  while (figure("slabd_fault_code") == 502.0) ::usleep(100'000);
  EXPECT_GT(figure("slabd_memory_limit_bytes"), 100e6);
  const Box::Answer slab = box_.slabctl({"simulate", "--config", box_.config.native(), "--points", "quarter"});
  EXPECT_EQ(slab.exit_status, 0) << slab.out << slab.err;
  EXPECT_EQ(box_.stop(), 0);
}

}  // namespace
}  // namespace slabd::line
