// SPDX-License-Identifier: Apache-2.0
//
// slabd-web beside a running line: the status follows slabd, and its age grows when slabd is silent.
#include <sys/socket.h>
#include <sys/un.h>

#include <fstream>

#include "tests/web/web_process.h"

namespace slabd::web {
namespace {

struct WebLine : ::testing::Test {
  void start() {
    std::ofstream(box_.config, std::ios::app)
        << "[web]\nlisten = \"127.0.0.1:0\"\nanswer_s = 60\nslabctl = \"" << places::slabctl() << "\"\n";
    web_ =
        std::make_unique<line::Process>(std::vector<std::string>{places::slabd_web(), "--config", box_.config.native()},
                                        box_.dir / "web.out", box_.dir / "web.err");
    port_ = reported_port(*web_, (box_.dir / "web.err").native(), "kiosk");
    ASSERT_NE(port_, 0) << line::read_file(box_.dir / "web.err");
  }
  [[nodiscard]] json status() const { return json::parse(web::get(port_, "/api/v1/status").body, nullptr, false); }
  /// The first status that fulfils the condition.
  template <typename Condition>
  [[nodiscard]] json status_when(const Condition& condition) const {
    json now;
    for (int i = 0; i < 1'200; ++i) {
      now = status();
      if (now.is_object() && condition(now)) return now;
      std::this_thread::sleep_for(std::chrono::milliseconds(100));
    }
    ADD_FAILURE() << "never: " << now.dump(1).substr(0, 2'000);
    return now;
  }
  void validate(const json& document) const {
    const std::string path = (box_.dir / "status.json").native();
    std::ofstream(path) << document;
    EXPECT_EQ(std::system(("/usr/bin/python3 " + places::source_dir() + "/tests/cli/validate_json.py " +
                           places::source_dir() + "/docs/schemas " + path)
                              .c_str()),
              0);
  }

  line::Box box_;
  std::unique_ptr<line::Process> web_;
  std::uint16_t port_ = 0;
};

TEST_F(WebLine, status_follows_a_slab_and_ages_when_slabd_is_killed) {
  box_.start();
  ASSERT_TRUE(box_.ready()) << box_.log();
  start();
  validate(status_when([](const json& now) { return now["reachable"] == true; }));
  const auto line = box_.simulate({"--slab-no", "1", "--scans-per-block", "1", "--json"});
  const json open = status_when([](const json& now) {
    return now["map"].is_object() && now["map"]["ended_utime_us"].is_null() && now["map"]["blocks"][0]["attempts"] == 1;
  });
  EXPECT_EQ(open["last"][0]["ended"], nullptr);
  EXPECT_EQ(open["map"]["blocks"][17]["verdict"], "none");
  EXPECT_EQ(line->wait() / 2, 0);
  const json ended = status_when([](const json& now) { return now["map"]["ended_utime_us"].is_number(); });
  EXPECT_EQ(ended["last"][0]["verdict"], ended["map"]["verdict"]);
  const json counted =
      status_when([](const json& now) { return now["yield"].is_object() && now["yield"]["inspected"] == 1; });
  validate(counted);

  box_.kill_hard();
  const json gone = status_when([](const json& now) { return now["reachable"] == false; });
  EXPECT_TRUE(gone["status"].is_object());
  EXPECT_NE(gone["trouble"], "");
  const json later = status_when([&](const json& now) { return now["age_ms"] > gone["age_ms"].get<int>() + 1'500; });
  EXPECT_EQ(later["reachable"], false);
  validate(later);
}

// A daemon that accepts and never answers.
TEST_F(WebLine, a_silent_daemon_is_not_reachable) {
  const Fd socket(::socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0));
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  (box_.dir / "control.sock").native().copy(&address.sun_path[0], sizeof address.sun_path - 1);
  ASSERT_EQ(::bind(socket.get(), static_cast<const sockaddr*>(static_cast<const void*>(&address)), sizeof address), 0);
  ASSERT_EQ(::listen(socket.get(), 8), 0);
  start();
  const json silent = status_when(
      [](const json& now) { return now["trouble"].get<std::string>().find("no answer") != std::string::npos; });
  EXPECT_EQ(silent["reachable"], false);
  EXPECT_TRUE(silent["age_ms"].is_null());
}

}  // namespace
}  // namespace slabd::web
