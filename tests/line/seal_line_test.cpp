// SPDX-License-Identifier: Apache-2.0
//
// A real daemon with locked memory (--seal): it inspects slabs, and every stack is resident.
#include <gtest/gtest.h>
#include <unistd.h>

#include <chrono>
#include <fstream>
#include <functional>

#include "daemon/seal.h"
#include "processes.h"

namespace slabd::line {
namespace {

class SealLine : public testing::Test {
 protected:
  void TearDown() override {
    if (HasFailure()) std::fprintf(stderr, "---- slabd ----\n%s", box_.log().c_str());
  }
  [[nodiscard]] double figure(const std::string& name) const {
    const std::string text = box_.slabctl({"metrics", "--config", box_.config.native()}).out;
    const std::size_t at = text.find("\n" + name + " ");
    return at == std::string::npos ? -1.0 : std::stod(text.substr(at + name.size() + 2));
  }
  /// True if `what` becomes true within 30 s while the daemon runs.
  [[nodiscard]] bool comes(const std::function<bool()>& what) {
    const auto end = std::chrono::steady_clock::now() + std::chrono::seconds(30);
    while (box_.running() && std::chrono::steady_clock::now() < end) {
      if (what()) return true;
      ::usleep(100'000);
    }
    return false;
  }
  [[nodiscard]] bool logs(const std::string& text) const { return box_.log().find(text) != std::string::npos; }
  /// Starts the daemon and waits until it has logged the result of the lock.
  void start(const std::string& option) {
    box_.start({option});
    ASSERT_TRUE(box_.ready());
    ASSERT_TRUE(comes([this] { return logs("all memory is locked") || logs("memory cannot be locked"); }))
        << "30 s after its start the daemon has logged neither a lock nor an error";
  }
  [[nodiscard]] bool locking_is_refused() const { return logs("memory cannot be locked"); }
  void inspect(const std::string& slabs) {
    const Box::Answer answer = box_.slabctl(
        {"simulate", "--config", box_.config.native(), "--points", "quarter", "--slabs", slabs, "--slab-no", "1"});
    EXPECT_EQ(answer.exit_status, 0) << answer.out << answer.err;
  }
  Box box_;
};

TEST_F(SealLine, a_daemon_with_locked_memory_inspects_slabs_and_is_backed_up) {
  ASSERT_NO_FATAL_FAILURE(start("--seal"));
  inspect("2");
  EXPECT_EQ(box_.slabctl({"db", "backup", "--config", box_.config.native()}).exit_status, 0);
  const double locked = figure("slabd_memory_locked_bytes");
  std::printf("locked %.1f MB of %.1f MB mapped\n", locked / 1e6, figure("slabd_memory_mapped_bytes") / 1e6);
  EXPECT_EQ(box_.stop(), 0);
  if (locking_is_refused()) GTEST_SKIP() << "the system does not allow the daemon to lock its memory";
  EXPECT_GT(locked, 100e6);
}

TEST_F(SealLine, every_stack_is_there_from_the_start) {
  ASSERT_NO_FATAL_FAILURE(start("--seal"));
  if (locking_is_refused()) GTEST_SKIP() << "the system does not allow the daemon to lock its memory";
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

TEST_F(SealLine, memory_is_locked_before_and_after_the_database_can_be_opened) {
  Box other;
  other.start();
  ASSERT_TRUE(other.ready());
  std::string text = read_file(box_.config);
  for (const char* name : {"slabd.db", "spool"}) {
    const std::string ours = (box_.dir / name).native();
    text.replace(text.find(ours), ours.size(), (other.dir / name).native());
  }
  std::ofstream(box_.config) << text;
  ASSERT_NO_FATAL_FAILURE(start("--seal"));
  EXPECT_EQ(figure("slabd_fault_code"), 502.0);
  const double locked = figure("slabd_memory_locked_bytes");
  EXPECT_EQ(other.stop(), 0);
  ASSERT_TRUE(comes([this] { return figure("slabd_fault_code") == 0.0; }))
      << "30 s after the end of the other daemon the database is not open";
  inspect("1");
  const double later = figure("slabd_memory_locked_bytes");
  EXPECT_EQ(box_.stop(), 0);
  if (locking_is_refused()) GTEST_SKIP() << "the system does not allow the daemon to lock its memory";
  EXPECT_GT(locked, 100e6);
  EXPECT_GT(later, 100e6);
}

}  // namespace
}  // namespace slabd::line
