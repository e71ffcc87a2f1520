// SPDX-License-Identifier: Apache-2.0
//
// Questions of slabd-web to the daemon's control socket.
#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <memory>
#include <string>
#include <string_view>
#include <thread>
#include <tuple>
#include <vector>

#include "hal/hal.h"
#include "tests/hal/temporary_folder.h"
#include "tests/places/wait.h"
#include "web/live.h"

namespace slabd::web {
namespace {

using Clock = std::chrono::steady_clock;

constexpr std::string_view kState = R"({"schema":"slabd.calibration_state/1"})";

/// A control socket that gives one answer to every question, and counts those about the calibration.
class FakeDaemon {
 public:
  explicit FakeDaemon(const std::string& path) : port_(std::move(hal::make_control_socket(path.c_str()).value())) {}
  [[nodiscard]] int questions() const { return questions_; }

 private:
  void answer(const std::stop_token& end) {
    while (!end.stop_requested()) {
      for (std::string_view line; port_->next(Clock::now().time_since_epoch().count(), line);) {
        if (line.find("calibration") != std::string_view::npos) ++questions_;
        port_->reply(kState);
      }
      std::this_thread::sleep_for(std::chrono::milliseconds(1));
    }
  }

  std::unique_ptr<hal::ControlPort> port_;
  std::atomic<int> questions_{0};
  std::jthread thread_{[this](const std::stop_token& end) { answer(end); }};  // last, because it uses the others
};

TEST(Live, asks_about_the_calibration_once_a_second_for_all_pages) {
  const hal::test::TemporaryFolder folder;
  const FakeDaemon daemon(folder / "control.sock");
  Documents documents({.slabctl = "/bin/false",
                       .config = "",
                       .reports_dir = folder.string(),
                       .answer_s = 60.0,
                       .plant = "",
                       .plant_dsn = ""});
  Live live({folder / "control.sock", "en", "1.0", 60'000}, documents);
  const auto begin = Clock::now();
  {
    std::vector<std::jthread> pages;
    for (int i = 0; i < 8; ++i)
      pages.emplace_back([&] {
        for (int k = 0; k < 10; ++k) EXPECT_EQ(live.calibration(), kState);
      });
  }
  const int asked = daemon.questions();
  EXPECT_LE(asked, 1 + std::chrono::floor<std::chrono::seconds>(Clock::now() - begin).count());
  EXPECT_TRUE(places::wait_until([&] {
    std::ignore = live.calibration();
    return daemon.questions() > asked;
  })) << "an old state is kept";
}

}  // namespace
}  // namespace slabd::web
