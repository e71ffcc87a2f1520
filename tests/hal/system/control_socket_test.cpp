// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <memory>

#include "base/os.h"
#include "hal/hal.h"
#include "tests/hal/temporary_folder.h"

namespace slabd::hal {
namespace {

using test::TemporaryFolder;

Fd connected(const std::string& path) {
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  std::memcpy(address.sun_path, path.c_str(), path.size());
  Fd fd(socket(AF_UNIX, SOCK_STREAM, 0));
  EXPECT_EQ(connect(fd.get(), reinterpret_cast<const sockaddr*>(&address), sizeof address), 0) << std::strerror(errno);
  return fd;
}

void send_text(const Fd& fd, const std::string& text) {
  EXPECT_EQ(send(fd.get(), text.data(), text.size(), MSG_NOSIGNAL), static_cast<ssize_t>(text.size()));
}

std::string received(const Fd& fd) {
  std::string text(1 << 18, '\0');
  const ssize_t n = recv(fd.get(), text.data(), text.size(), MSG_DONTWAIT);
  text.resize(n > 0 ? static_cast<std::size_t>(n) : 0);
  return text;
}

bool closed(const Fd& fd) {
  char byte = 0;
  const ssize_t n = recv(fd.get(), &byte, 1, MSG_DONTWAIT | MSG_PEEK);
  return n == 0 || (n < 0 && errno != EAGAIN);
}

class ControlSocketTest : public ::testing::Test {
 protected:
  void SetUp() override {
    auto made = make_control_socket(path_.c_str());
    ASSERT_TRUE(made.ok()) << made.error().text.c_str();
    port_ = std::move(made.value());
  }
  /// Runs one turn; each line is answered with itself in brackets. Returns their number.
  int turn() {
    int lines = 0;
    for (std::string_view line; port_->next(now_ns_, line); ++lines) port_->reply("<" + std::string(line) + ">");
    return lines;
  }
  bool poll_wakes() {
    std::array<pollfd, kControlPollFds> fds{};
    const std::size_t count = port_->poll_fds(fds);
    return poll(fds.data(), count, 0) > 0;
  }

  TemporaryFolder folder_;
  std::string path_ = folder_ / "control.sock";
  std::unique_ptr<ControlPort> port_;
  std::int64_t now_ns_ = kNsPerS;
};

TEST_F(ControlSocketTest, a_line_is_answered) {
  const Fd client = connected(path_);
  send_text(client, "{\"verb\": \"status\"}\n");
  EXPECT_EQ(turn(), 1);
  EXPECT_EQ(received(client), "<{\"verb\": \"status\"}>\n");
}

TEST_F(ControlSocketTest, a_line_in_pieces_is_one_line) {
  const Fd client = connected(path_);
  send_text(client, "{\"verb\"");
  EXPECT_EQ(turn(), 0);
  send_text(client, ": 1}\n");
  EXPECT_EQ(turn(), 1);
  EXPECT_EQ(received(client), "<{\"verb\": 1}>\n");
}

TEST_F(ControlSocketTest, lines_of_a_flood_are_served_one_a_turn_and_poll_is_woken_for_the_rest) {
  const Fd client = connected(path_);
  send_text(client, "a\nb\nc\n");
  EXPECT_EQ(turn(), 1);
  EXPECT_TRUE(poll_wakes());
  EXPECT_EQ(turn(), 1);
  EXPECT_EQ(turn(), 1);
  EXPECT_EQ(turn(), 0);
  EXPECT_FALSE(poll_wakes());
  EXPECT_EQ(received(client), "<a>\n<b>\n<c>\n");
}

TEST_F(ControlSocketTest, a_client_that_shut_down_its_half_is_still_answered) {
  const Fd client = connected(path_);
  send_text(client, "a\nb\n");
  shutdown(client.get(), SHUT_WR);
  for (int i = 0; i < 4; ++i) turn();
  EXPECT_EQ(received(client), "<a>\n<b>\n");
  EXPECT_TRUE(closed(client));
}

TEST_F(ControlSocketTest, answers_go_to_the_one_who_asked) {
  const Fd one = connected(path_);
  const Fd two = connected(path_);
  send_text(two, "two\n");
  send_text(one, "one\n");
  EXPECT_EQ(turn(), 2);
  EXPECT_EQ(received(one), "<one>\n");
  EXPECT_EQ(received(two), "<two>\n");
}

TEST_F(ControlSocketTest, the_longest_line_passes_and_a_longer_one_closes) {
  const Fd good = connected(path_);
  const std::string longest(limits::kControlLineBytes - 1, 'x');
  send_text(good, longest + "\n");
  int lines = 0;
  for (int i = 0; i < 50 && lines == 0; ++i) lines = turn();
  EXPECT_EQ(lines, 1);
  EXPECT_EQ(received(good).size(), longest.size() + 3);
  const Fd bad = connected(path_);
  send_text(bad, longest + "xx");
  for (int i = 0; i < 50; ++i) EXPECT_EQ(turn(), 0);
  EXPECT_TRUE(closed(bad));
  EXPECT_FALSE(closed(good));
}

TEST_F(ControlSocketTest, ten_idle_seconds_close_even_a_dripping_client) {
  const Fd client = connected(path_);
  turn();
  now_ns_ += 9 * kNsPerS;
  send_text(client, "x");
  turn();
  EXPECT_FALSE(closed(client));
  now_ns_ += 2 * kNsPerS;
  turn();
  EXPECT_TRUE(closed(client));
}

TEST_F(ControlSocketTest, a_fifth_client_waits_for_a_place) {
  std::vector<Fd> clients;
  for (std::size_t i = 0; i < limits::kControlClientsMax; ++i) clients.push_back(connected(path_));
  const Fd fifth = connected(path_);
  send_text(fifth, "hello\n");
  EXPECT_EQ(turn(), 0);
  EXPECT_FALSE(poll_wakes()) << "a waiting client must not spin the loop";
  clients.pop_back();
  EXPECT_EQ(turn(), 0);
  EXPECT_EQ(turn(), 1);
  EXPECT_EQ(received(fifth), "<hello>\n");
}

TEST_F(ControlSocketTest, a_silent_client_is_replaced_by_the_next_and_a_requesting_client_is_not) {
  std::vector<Fd> silent;
  for (std::size_t i = 1; i < limits::kControlClientsMax; ++i) silent.push_back(connected(path_));
  const Fd asks = connected(path_);
  EXPECT_EQ(turn(), 0);
  now_ns_ += 2 * kNsPerS;
  send_text(asks, "here\n");
  EXPECT_EQ(turn(), 1);
  const Fd next = connected(path_);
  send_text(next, "hello\n");
  EXPECT_EQ(turn(), 1);
  EXPECT_EQ(received(next), "<hello>\n");
  EXPECT_EQ(received(asks), "<here>\n");
  EXPECT_FALSE(closed(asks));
  EXPECT_EQ(std::count_if(silent.begin(), silent.end(), closed), 1);
}

TEST_F(ControlSocketTest, clients_that_sent_requests_while_the_daemon_was_paused_are_answered) {
  std::vector<Fd> clients;
  for (std::size_t i = 0; i < limits::kControlClientsMax; ++i) clients.push_back(connected(path_));
  EXPECT_EQ(turn(), 0);
  const Fd next = connected(path_);
  for (const Fd& client : clients) send_text(client, "me\n");
  now_ns_ += 2 * kNsPerS;
  EXPECT_EQ(turn(), 4);
  for (const Fd& client : clients) EXPECT_EQ(received(client), "<me>\n");
}

TEST_F(ControlSocketTest, a_client_that_never_reads_is_closed) {
  const Fd client = connected(path_);
  const std::string answer(200'000, 'y');
  for (int i = 0; i < 100 && !closed(client); ++i) {
    if (send(client.get(), "q\n", 2, MSG_NOSIGNAL) < 0) break;
    std::string_view line;
    while (port_->next(now_ns_, line)) port_->reply(answer);
    now_ns_ += kNsPerS / 10;  // slow enough for the rate limit
  }
  EXPECT_LT(send(client.get(), "q\n", 2, MSG_NOSIGNAL), 0);
}

TEST_F(ControlSocketTest, twenty_requests_a_second_are_answered_and_the_next_closes) {
  const Fd client = connected(path_);
  for (int second = 0; second < 3; ++second) {
    for (int i = 0; i < 20; ++i) {
      send_text(client, "q\n");
      EXPECT_EQ(turn(), 1) << second << " " << i;
      now_ns_ += kNsPerS / 25;
    }
    now_ns_ += kNsPerS / 5;
  }
  const Fd other = connected(path_);
  std::string flood;
  for (int i = 0; i < 21; ++i) flood += "q\n";
  send_text(client, flood);
  int answered = 0;
  for (int i = 0; i < 40; ++i) answered += turn();
  EXPECT_EQ(answered, 20);
  received(client);
  EXPECT_TRUE(closed(client));
  send_text(other, "x\n");
  EXPECT_EQ(turn(), 1) << "each connection has a limit of its own";
}

TEST_F(ControlSocketTest, the_user_behind_a_line_is_known) {
  const Fd client = connected(path_);
  EXPECT_EQ(port_->peer_uid(), ControlPort::kUidUnknown);
  send_text(client, "x\n");
  std::string_view line;
  ASSERT_TRUE(port_->next(now_ns_, line));
  EXPECT_EQ(port_->peer_uid(), getuid());
  EXPECT_FALSE(port_->next(now_ns_, line));
  EXPECT_EQ(port_->peer_uid(), ControlPort::kUidUnknown);
}

TEST_F(ControlSocketTest, the_socket_is_for_owner_and_group_only) {
  struct stat status {};
  ASSERT_EQ(stat(path_.c_str(), &status), 0);
  EXPECT_EQ(status.st_mode & 0777U, 0660U);
}

TEST_F(ControlSocketTest, a_second_daemon_is_refused_and_a_dead_ones_socket_is_taken_over) {
  const auto second = make_control_socket(path_.c_str());
  ASSERT_FALSE(second.ok());
  EXPECT_NE(second.error().text.view().find("another process"), std::string_view::npos);
  const Fd still_served = connected(path_);
  send_text(still_served, "x\n");
  EXPECT_EQ(turn(), 1) << "the first one was not disturbed (the probe itself is a client that left)";
  port_.reset();
  EXPECT_FALSE(std::filesystem::exists(path_));
  {
    // A killed process leaves its socket behind.
    sockaddr_un address{};
    address.sun_family = AF_UNIX;
    std::memcpy(address.sun_path, path_.c_str(), path_.size());
    const Fd dead(socket(AF_UNIX, SOCK_STREAM, 0));
    ASSERT_EQ(bind(dead.get(), reinterpret_cast<const sockaddr*>(&address), sizeof address), 0);
  }
  ASSERT_TRUE(std::filesystem::exists(path_));
  const auto third = make_control_socket(path_.c_str());
  EXPECT_TRUE(third.ok()) << third.error().text.c_str();
}

TEST(ControlSocketPath, files_missing_folders_and_long_paths_are_refused) {
  TemporaryFolder folder;
  test::write_file(folder / "file", "precious");
  EXPECT_FALSE(make_control_socket((folder / "file").c_str()).ok());
  EXPECT_EQ(test::read_file(folder / "file"), "precious");
  EXPECT_FALSE(make_control_socket((folder / "none/control.sock").c_str()).ok());
  EXPECT_FALSE(make_control_socket((folder / std::string(120, 'x')).c_str()).ok());
  EXPECT_FALSE(make_control_socket("").ok());
}

}  // namespace
}  // namespace slabd::hal
