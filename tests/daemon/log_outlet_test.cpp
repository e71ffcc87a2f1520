// SPDX-License-Identifier: Apache-2.0
#include "daemon/log_outlet.h"

#include <fcntl.h>
#include <gtest/gtest.h>
#include <poll.h>
#include <unistd.h>

#include <array>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <regex>
#include <set>
#include <string>

#include "tests/places/places.h"
#include "tests/places/wait.h"

namespace slabd::daemon {
namespace {

TEST(LogOutlet, never_waits_for_an_unread_stderr_and_counts_lost_lines) {
  std::array<int, 2> ends{};
  ASSERT_EQ(::pipe(ends.data()), 0);
  ASSERT_GT(::fcntl(ends[1], F_SETPIPE_SZ, 4096), 0);  // becomes full long before the queue
  const int real = ::dup(STDERR_FILENO);
  ::dup2(ends[1], STDERR_FILENO);
  start_log_outlet();
  const std::uint64_t before = log_lines_lost();
  const std::string line = "info: slabd: " + std::string(200, 'x') + "\n";
  for (int i = 0; i < 5'000; ++i) put_log(line);  // a megabyte: more than the capacity of pipe and queue
  const std::uint64_t lost = log_lines_lost() - before;
  EXPECT_GT(lost, 0U);
  EXPECT_FALSE(flush_log(0));

  std::string read_back;
  std::array<char, 65'536> piece{};
  const auto read_some = [&] {
    pollfd fd{ends[0], POLLIN, 0};
    if (::poll(&fd, 1, 0) != 1) return;
    const ssize_t n = ::read(ends[0], piece.data(), piece.size());
    if (n > 0) read_back.append(piece.data(), static_cast<std::size_t>(n));
  };
  const auto is_flushed = [&] {
    read_some();
    return flush_log(1);
  };
  EXPECT_TRUE(places::wait_until(is_flushed)) << "the log is read and not written";
  put_log("info: slabd: read again\n");
  const auto is_read_again = [&] {
    read_some();
    return read_back.find("read again\n") != std::string::npos;
  };
  EXPECT_TRUE(places::wait_until(is_read_again)) << "a line after the missing ones is not written";
  // One note, or several with this sum if the writer ran in between.
  const std::regex note("([0-9]+) lines are missing here");
  std::uint64_t noted = 0;
  for (std::sregex_iterator at(read_back.begin(), read_back.end(), note), end; at != end; ++at)
    noted += std::stoull((*at)[1]);
  EXPECT_EQ(noted, lost);
  ::dup2(real, STDERR_FILENO);
  for (const int fd : {ends[0], ends[1], real}) ::close(fd);
}

// A write to stderr blocks if it is not read, and so does the writing thread: finally the loop.
TEST(LogOutlet, is_the_only_one_in_the_daemon_that_writes_to_stderr) {
  namespace fs = std::filesystem;
  const std::set<std::string> allowed = {"daemon/log_outlet.cpp", "base/pages.cpp"};  // the last messages before
                                                                                      // abort()
  const std::regex writes("\\bstderr\\s*[,)]|std::cerr|std::clog|\\bperror\\(");
  int files = 0;
  for (const char* room : {"algo", "base", "calib", "config", "daemon", "hal", "storage"})
    for (const auto& entry : fs::recursive_directory_iterator(fs::path(places::source_dir()) / room)) {
      const std::string extension = entry.path().extension().string();
      if (extension != ".cpp" && extension != ".h") continue;
      const std::string name = fs::relative(entry.path(), places::source_dir()).string();
      ++files;
      if (allowed.count(name) != 0) continue;
      std::ifstream in(entry.path());
      int number = 0;
      for (std::string line; std::getline(in, line);) {
        ++number;
        const std::string code = line.substr(0, line.find("//"));
        EXPECT_FALSE(std::regex_search(code, writes)) << name << ':' << number << ": " << line;
      }
    }
  EXPECT_GT(files, 100);
}

}  // namespace
}  // namespace slabd::daemon
