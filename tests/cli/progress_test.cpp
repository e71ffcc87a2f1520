// SPDX-License-Identifier: Apache-2.0
#include "cli/terminal/progress.h"

#include <fcntl.h>
#include <gtest/gtest.h>
#include <poll.h>
#include <unistd.h>

#include <cstdlib>
#include <memory>
#include <optional>

#include "emulator/robot_peer.h"
#include "tests/places/wait.h"

namespace slabd::cli {
namespace {

using namespace std::chrono_literals;

/// A pseudo-terminal: `seen_until` returns what a program writes to `stream`.
struct Terminal {
  Terminal() : master(posix_openpt(O_RDWR | O_NOCTTY)) {
    EXPECT_EQ(grantpt(master), 0);
    EXPECT_EQ(unlockpt(master), 0);
    stream = std::fopen(ptsname(master), "w");
    EXPECT_NE(stream, nullptr);
  }
  ~Terminal() {
    std::fclose(stream);
    close(master);
  }
  Terminal(const Terminal&) = delete;
  Terminal& operator=(const Terminal&) = delete;

  /// Reads until `ending` has been received; without it after half a minute.
  [[nodiscard]] std::string seen_until(const std::string& ending) const {
    std::string seen;
    const auto has_ended = [&] {
      pollfd next{master, POLLIN, 0};
      char byte = 0;
      while (!seen.ends_with(ending) && poll(&next, 1, 0) == 1 && read(master, &byte, 1) == 1) seen += byte;
      return seen.ends_with(ending);
    };
    EXPECT_TRUE(places::wait_until(has_ended)) << "\"" << ending << "\" is not written";
    return seen;
  }

  int master = -1;
  std::FILE* stream = nullptr;
};

TEST(ProgressNote, long_work_is_announced_on_a_terminal_and_the_line_is_erased_afterwards) {
  const Terminal terminal;
  {
    const ProgressNote note(terminal.stream, "measuring ...", 0ms);
    EXPECT_EQ(terminal.seen_until("..."), "measuring ...");
  }
  std::fputs("result", terminal.stream);
  std::fflush(terminal.stream);
  EXPECT_EQ(terminal.seen_until("result"), "\r\x1b[Kresult");
}

TEST(ProgressNote, short_work_says_nothing) {
  const Terminal terminal;
  { const ProgressNote note(terminal.stream, "measuring ...", 24h); }
  std::fputs("result", terminal.stream);
  std::fflush(terminal.stream);
  EXPECT_EQ(terminal.seen_until("result"), "result");
}

TEST(ProgressNote, nothing_is_written_without_a_terminal) {
  const std::unique_ptr<std::FILE, int (*)(std::FILE*)> file(std::tmpfile(), &std::fclose);
  { const ProgressNote note(file.get(), "measuring ...", 0ms); }
  EXPECT_EQ(std::ftell(file.get()), 0);
}

TEST(ProgressCount, says_which_piece_of_how_many_and_is_erased) {
  const Terminal terminal;
  {
    ProgressCount progress(terminal.stream, 3);
    progress.next("a.ply");
    EXPECT_EQ(terminal.seen_until("ply"), "\r\x1b[K1 of 3: a.ply");
    progress.next("b.ply");
    const std::string second = terminal.seen_until("left");
    EXPECT_TRUE(second.starts_with("\r\x1b[K2 of 3: b.ply; about ")) << second;
  }
  EXPECT_EQ(terminal.seen_until("K"), "\r\x1b[K");
}

TEST(ProgressCount, a_single_piece_and_a_file_get_nothing) {
  const Terminal terminal;
  {
    ProgressCount progress(terminal.stream, 1);
    progress.next("a.ply");
  }
  std::fputs("result", terminal.stream);
  std::fflush(terminal.stream);
  EXPECT_EQ(terminal.seen_until("result"), "result");
  const std::unique_ptr<std::FILE, int (*)(std::FILE*)> file(std::tmpfile(), &std::fclose);
  {
    ProgressCount progress(file.get(), 5);
    progress.next("a.ply");
  }
  EXPECT_EQ(std::ftell(file.get()), 0);
}

TEST(ProgressCount, the_time_left_is_what_like_pieces_will_take) {
  EXPECT_EQ(time_left(0, 10, 5.0), "");
  EXPECT_EQ(time_left(2, 10, 5.0), "about 20 s left");
  EXPECT_EQ(time_left(1, 21, 30.0), "about 10 min left");
  EXPECT_EQ(time_left(1, 1000, 60.0), "about 16.6 h left");
  EXPECT_EQ(time_left(10, 10, 5.0), "");
}

TEST(RobotPeer, cure_for_a_missing_route_names_the_group_in_use) {
  using emulator::multicast_group;
  EXPECT_EQ(multicast_group("udpm://239.1.2.3:7000?ttl=0"), "239.1.2.3");
  EXPECT_EQ(multicast_group("udpm://239.1.2.3?ttl=0"), "239.1.2.3");
  EXPECT_EQ(multicast_group("udpm://239.1.2.3"), "239.1.2.3");
  EXPECT_EQ(multicast_group("udpm://"), "239.255.76.67");
  EXPECT_EQ(multicast_group("udpm://?ttl=1"), "239.255.76.67");
  // A unicast address has no multicast route on any machine, so the message is tested.
  emulator::RobotTraits traits;
  traits.lcm_url = "udpm://10.9.8.7:7667?ttl=0";
  traits.channel = "FLANGE_POSE";
  const auto peer = emulator::RobotPeer::start(traits, Pose::identity());
  if (!peer.ok()) {
    EXPECT_NE(peer.error().text.view().find("ip route add 10.9.8.7/32 dev lo"), std::string_view::npos)
        << peer.error().text.view();
  }
}

}  // namespace
}  // namespace slabd::cli
