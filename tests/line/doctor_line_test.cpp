// SPDX-License-Identifier: Apache-2.0
//
// slabctl doctor with a real daemon: it must find each fault, name the remedy, and report no fault on a good line.
#include <fcntl.h>
#include <gtest/gtest.h>
#include <lcm/lcm.h>
#include <modbus.h>
#include <netinet/in.h>
#include <pwd.h>
#include <sched.h>
#include <stdlib.h>
#include <sys/mount.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <bot_core/rigid_transform_t.hpp>
#include <chrono>
#include <csignal>
#include <fstream>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <regex>
#include <slabd/flange_pose_t.hpp>
#include <thread>
#include <vector>

#include "processes.h"
#include "tests/places/places.h"
#include "tests/places/wait.h"

namespace slabd::line {
namespace {

using nlohmann::json;

/// Runs the doctor in a mount namespace in which `folder` is on a disk of its own. Returns 0, or the step that the
/// kernel refused.
int look_at_a_disk(const fs::path& folder, unsigned long flags, const char* options,
                   const std::vector<std::string>& doctor, const fs::path& dir) {
  if (unshare(CLONE_NEWNS) != 0) return 99;
  if (mount(nullptr, "/", nullptr, MS_REC | MS_PRIVATE, nullptr) != 0) return 98;
  if (mount("none", folder.c_str(), "tmpfs", flags, options) != 0) return 97;
  Process process(doctor, dir / "doctor.out", dir / "doctor.err");
  (void)process.wait();
  return 0;
}

class DoctorTest : public testing::Test {
 protected:
  struct Opinion {
    int exit_status = -1;
    json findings;
    /// Health of the first finding of a check that is not ok; "ok" if all are, "" if the check was not made.
    [[nodiscard]] std::string health(const std::string& check) const {
      std::string word;
      for (const json& finding : findings)
        if (finding["check"] == check && (word.empty() || word == "ok")) word = finding["health"];
      return word;
    }
    [[nodiscard]] std::string all() const { return findings.dump(1); }
    [[nodiscard]] bool says(const std::string& text) const { return all().find(text) != std::string::npos; }
  };
  /// True if namespaces are refused, as inside some containers. Another reason for a missing answer is a failure.
  [[nodiscard]] bool namespaces_refused() const {
    const std::string said = read_file(box_.dir / "doctor.err");
    EXPECT_NE(said.find("unshare"), std::string::npos) << said;
    return said.find("unshare") != std::string::npos;
  }
  [[nodiscard]] Opinion examine(std::vector<std::string> more = {}, const char* listen_s = "1") const {
    std::vector<std::string> args = {"doctor", "--config", box_.config.native(), "--json", "--listen-s", listen_s};
    args.insert(args.end(), more.begin(), more.end());
    const Box::Answer answer = box_.slabctl(args);
    const json document = json::parse(answer.out, nullptr, false);
    if (!document.is_object()) return {answer.exit_status, json::array()};
    EXPECT_EQ(document["schema"], "slabd.doctor/1");
    for (const json& finding : document["findings"]) {
      const bool bad = finding["health"] == "failed" || finding["health"] == "warning";
      EXPECT_TRUE(!bad || finding["cure"] != "") << finding;
    }
    return {answer.exit_status, document["findings"]};
  }
  /// Examines until `done`, at most twenty times: the doctor judges the rate of one second, and on a computer with
  /// other work sender or doctor may pause for a part of it.
  template <typename Done>
  [[nodiscard]] Opinion examine_until(const Done& done, const char* listen_s = "1") const {
    Opinion opinion;
    for (int i = 0; i < 20; ++i) {
      opinion = examine({}, listen_s);
      if (done(opinion)) break;
    }
    return opinion;
  }
  /// Findings with the scans' folder on a disk with these mount options; nullopt if the kernel refuses the mount.
  [[nodiscard]] std::optional<Opinion> with_scans_on(unsigned long flags, const char* options) const {
    fs::create_directories(box_.dir / "spool");
    const pid_t child = ::fork();
    if (child == 0)
      _exit(look_at_a_disk(
          box_.dir / "spool", flags, options,
          {places::slabctl(), "doctor", "--config", box_.config.native(), "--json", "--listen-s", "0.5"}, box_.dir));
    int status = -1;
    ::waitpid(child, &status, 0);
    if (!WIFEXITED(status) || WEXITSTATUS(status) != 0) {
      EXPECT_TRUE(WIFEXITED(status) && WEXITSTATUS(status) >= 97);
      return std::nullopt;
    }
    const json document = json::parse(read_file(box_.dir / "doctor.out"), nullptr, false);
    EXPECT_TRUE(document.is_object());
    return Opinion{0, document.is_object() ? document["findings"] : json::array()};
  }
  void start() {
    box_.start();
    ASSERT_TRUE(box_.ready()) << box_.log();
  }

  [[nodiscard]] std::string lcm_url() const {
    std::smatch match;
    const std::string text = read_file(box_.config);
    return std::regex_search(text, match, std::regex("lcm_url = \"([^\"]+)\"")) ? match[1].str() : "";
  }

  Box box_;
};

TEST_F(DoctorTest, with_a_mistake_in_the_configuration_only_the_daemon_is_queried) {
  std::ofstream(box_.config, std::ios::app) << "\n[scanner2]\n";
  Opinion opinion = examine();
  EXPECT_EQ(opinion.exit_status, 3);
  EXPECT_EQ(opinion.health("configuration"), "failed") << opinion.all();
  EXPECT_EQ(opinion.health("daemon"), "failed") << "it does not run";
  EXPECT_EQ(opinion.health("disk speed"), "") << "nothing can be said of the rest";
  start();
  opinion = examine();
  EXPECT_EQ(opinion.exit_status, 3);
  EXPECT_EQ(opinion.health("daemon"), "failed");
  EXPECT_NE(opinion.all().find("fault 504"), std::string::npos) << opinion.all();
  EXPECT_EQ(opinion.health("database"), "") << "writing was not tried yet\n" << opinion.all();
}

TEST_F(DoctorTest, reports_that_the_daemon_does_not_run_and_checks_the_rest) {
  const Opinion opinion = examine();
  EXPECT_EQ(opinion.exit_status, 4);
  EXPECT_EQ(opinion.health("configuration"), "ok");
  EXPECT_EQ(opinion.health("daemon"), "failed");
  EXPECT_EQ(opinion.health("plc port"), "ok") << opinion.all();
  EXPECT_EQ(opinion.health("robot poses"), "failed");
  // The disk of this computer may be slow, and other programs may use it.
  for (const char* check : {"disk speed", "commit time"}) {
    const std::string health = opinion.health(check);
    EXPECT_TRUE(health == "ok" || health == "warning") << check << " " << opinion.all();
  }
}

TEST_F(DoctorTest, the_cure_of_a_robot_link_names_the_group_that_is_configured) {
  std::ifstream in(box_.config);
  std::string text{std::istreambuf_iterator<char>(in), {}};
  in.close();
  const std::regex url("lcm_url = \"udpm://[^\"]*\"");
  ASSERT_TRUE(std::regex_search(text, url)) << text;
  text = std::regex_replace(text, url, "lcm_url = \"udpm://239.255.76.99:7667?ttl=0\"");
  text = std::regex_replace(text, std::regex("\ninterface = \"lo\""), "\ninterface = \"none0\"");
  std::ofstream(box_.config) << text;
  const Opinion opinion = examine();
  ASSERT_EQ(opinion.health("robot link"), "failed") << opinion.all();
  std::string cure;
  for (const json& finding : opinion.findings)
    if (finding["check"] == "robot link") cure = finding["cure"];
  EXPECT_NE(cure.find("ip route get 239.255.76.99"), std::string::npos) << cure;
}

TEST_F(DoctorTest, finds_the_program_that_sits_on_the_daemons_port) {
  const int fd = ::socket(AF_INET, SOCK_STREAM, 0);
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_port = htons(box_.port);
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  ASSERT_EQ(::bind(fd, static_cast<const sockaddr*>(static_cast<const void*>(&address)), sizeof address), 0);
  ASSERT_EQ(::listen(fd, 1), 0);
  EXPECT_EQ(examine().health("plc port"), "failed");
  ::close(fd);
}

TEST_F(DoctorTest, a_file_in_place_of_the_scan_folder_is_found) {
  fs::remove_all(box_.dir / "spool");
  std::ofstream(box_.dir / "spool") << "no folder";
  EXPECT_EQ(examine().health("scans"), "failed");
}

TEST_F(DoctorTest, a_missing_folder_is_to_be_made_and_its_parent_is_not_to_be_handed_over) {
  const fs::path share = box_.dir / "share";
  const std::string scans = (share / "scans").native();
  std::string text = read_file(box_.config);
  const std::string spool = (box_.dir / "spool").native();
  ASSERT_NE(text.find(spool), std::string::npos) << text;
  text.replace(text.find(spool), spool.size(), scans);
  std::ofstream(box_.config) << text;
  fs::create_directory(share);
  ASSERT_EQ(::chmod(share.c_str(), 0555), 0);
  std::vector<std::string> command = {places::slabctl(), "doctor",     "--config",   box_.config.native(),
                                      "--json",          "--no-write", "--listen-s", "0.5"};
  // Root may write everywhere. Without a user slabd the doctor examines for the one that runs it.
  if (::geteuid() == 0 && ::getpwnam("slabd") == nullptr) {
    ASSERT_EQ(::chmod(box_.dir.c_str(), 0755), 0);
    ASSERT_EQ(::chmod(box_.config.c_str(), 0644), 0);
    command.insert(command.begin(), {"/usr/bin/setpriv", "--reuid=65534", "--regid=65534", "--clear-groups"});
  }
  Process doctor(command, box_.dir / "doctor.out", box_.dir / "doctor.err");
  (void)doctor.wait();
  const json document = json::parse(read_file(box_.dir / "doctor.out"), nullptr, false);
  if (!document.is_object()) {
    const std::string said = read_file(box_.dir / "doctor.err");
    ASSERT_NE(said.find("setpriv"), std::string::npos) << said;
    GTEST_SKIP() << "slabctl cannot be run as another user here";
  }
  std::string cure;
  for (const json& finding : document["findings"])
    if (finding["check"] == "scans") {
      EXPECT_EQ(finding["health"], "failed") << finding;
      cure = finding["cure"];
    }
  EXPECT_NE(cure.find("mount that first"), std::string::npos) << cure;
  EXPECT_NE(cure.find("install -d -o "), std::string::npos) << cure;
  EXPECT_TRUE(cure.ends_with(" " + scans)) << cure;
  for (const char* change : {"chown", "chmod", "chgrp"}) EXPECT_EQ(cure.find(change), std::string::npos) << cure;
  EXPECT_EQ(cure.find(share.native()), cure.size() - scans.size()) << "the parent alone is not named: " << cure;
}

TEST_F(DoctorTest, a_daemon_without_plc_and_robot_lacks_heartbeat_and_poses) {
  start();
  const auto scanner_is_online = [this] {
    const json now =
        json::parse(box_.slabctl({"status", "--config", box_.config.native(), "--json"}).out, nullptr, false);
    return now.is_object() && now["links"]["scanner"]["online"] == true;
  };
  ASSERT_TRUE(places::wait_until(scanner_is_online)) << box_.log();
  const Opinion opinion = examine();
  EXPECT_EQ(opinion.exit_status, 4);
  EXPECT_EQ(opinion.health("plc registers"), "ok") << opinion.all();
  EXPECT_EQ(opinion.health("plc heartbeat"), "failed");
  EXPECT_EQ(opinion.health("robot poses"), "failed");
  EXPECT_EQ(opinion.health("scanner link"), "ok");
  EXPECT_EQ(opinion.health("calibration"), "warning") << "commissioning values";
  EXPECT_EQ(opinion.health("acceptance"), "warning") << "the scanner was not verified";
  std::string cures;
  for (const json& finding : opinion.findings)
    if (finding["check"] == "daemon") cures += finding["cure"].get<std::string>() + "\n";
  for (const char* cure :
       {"confirmed = true", "slabctl calibrate new", "slabctl calibrate new, and apply it", "slabctl scanner verify"})
    EXPECT_NE(cures.find(cure), std::string::npos) << cure << " is missing in\n" << cures;
  EXPECT_EQ(cures.find("docs/PLC.md, WARN"), std::string::npos) << "a table without cures is none\n" << cures;
}

TEST_F(DoctorTest, a_heartbeat_that_is_a_bit_moves_as_well_as_a_number) {
  start();
  std::atomic<bool> stop{false};
  std::atomic<double> longest_s{0.2};  // between two heartbeats: this computer may be busy
  std::thread plc([&] {
    const std::unique_ptr<modbus_t, void (*)(modbus_t*)> client(modbus_new_tcp("127.0.0.1", box_.port), modbus_free);
    ASSERT_EQ(modbus_connect(client.get()), 0);
    // Two looks that are 0.4 s or 1.2 s apart read the same value of the bit.
    auto last = std::chrono::steady_clock::now();
    for (std::uint16_t bit = 0; !stop; bit ^= 1U) {
      (void)modbus_write_register(client.get(), 0, bit);
      const auto now = std::chrono::steady_clock::now();
      longest_s = std::max(longest_s.load(), std::chrono::duration<double>(now - last).count());
      last = now;
      std::this_thread::sleep_for(std::chrono::milliseconds(200));
    }
    const auto end = std::chrono::steady_clock::now();
    longest_s = std::max(longest_s.load(), std::chrono::duration<double>(end - last).count());
    modbus_close(client.get());
  });
  // The doctor takes a heartbeat for dead after 1.2 s. It may say so only if this computer has paused.
  int alive = 0;
  double longest_of_all_s = 0.2;
  for (int i = 0; i < 10 && alive < 3; ++i) {
    longest_s = 0.2;
    if (examine().health("plc heartbeat") == "ok")
      ++alive;
    else
      EXPECT_GT(longest_s.load(), 0.6) << "the bit moved all the time";
    longest_of_all_s = std::max(longest_of_all_s, longest_s.load());
  }
  EXPECT_EQ(alive, 3) << "of ten";
  Process monitor(
      {places::slabctl(), "plc", "monitor", "--json", "--interval-ms", "400", "--config", box_.config.native()},
      box_.dir / "monitor.out", box_.dir / "monitor.err");
  const auto pictures = [&] {
    const std::string text = read_file(box_.dir / "monitor.out");
    return std::count(text.begin(), text.end(), '\n');
  };
  for (int i = 0; i < 6'000 && pictures() < 7; ++i) std::this_thread::sleep_for(std::chrono::milliseconds(10));
  monitor.signal(SIGINT);  // before the heartbeat ends
  static_cast<void>(monitor.wait());
  stop = true;
  plc.join();
  std::ifstream lines(box_.dir / "monitor.out");
  int seen = 0;
  for (std::string line; std::getline(lines, line); ++seen) {
    const json picture = json::parse(line, nullptr, false);
    if (!picture.is_object() || seen < 3) continue;
    ASSERT_TRUE(picture["plc_heartbeat_age_s"].is_number()) << picture;
    EXPECT_LT(picture["plc_heartbeat_age_s"].get<double>(), 0.8 + std::max(longest_of_all_s, longest_s.load()));
  }
  EXPECT_GT(seen, 3);
}

TEST_F(DoctorTest, refused_poses_are_reported_with_the_reason_and_a_bridge_that_died_is_found) {
  lcm_t* lcm = lcm_create(lcm_url().c_str());
  ASSERT_NE(lcm, nullptr);
  std::atomic<bool> stop{false};
  std::atomic<double> unit{2.0};
  std::atomic<std::int32_t> flags{1};
  std::thread bridge([&] {
    flange_pose_t pose{};
    for (pose.utime = 1; !stop; pose.utime += 8'000) {
      pose.quat[0] = unit;
      pose.flags = flags;
      std::vector<std::uint8_t> bytes(static_cast<std::size_t>(pose.getEncodedSize()));
      pose.encode(bytes.data(), 0, static_cast<int>(bytes.size()));
      lcm_publish(lcm, "FLANGE_POSE", bytes.data(), static_cast<unsigned>(bytes.size()));
      std::this_thread::sleep_for(std::chrono::milliseconds(8));
    }
  });
  Opinion opinion = examine_until([](const Opinion& seen) { return seen.says("no unit quaternion"); });
  EXPECT_EQ(opinion.health("robot poses"), "failed") << opinion.all();
  EXPECT_NE(opinion.all().find("not_unit"), std::string::npos) << opinion.all();
  EXPECT_NE(opinion.all().find("no unit quaternion"), std::string::npos) << opinion.all();
  unit = 1.0;
  opinion = examine_until([](const Opinion& seen) { return seen.health("robot poses") == "ok"; });
  EXPECT_EQ(opinion.health("robot poses"), "ok") << "without numbers (seq 0) nothing is lost\n" << opinion.all();
  flags = 0;
  opinion = examine_until([](const Opinion& seen) { return seen.health("robot poses") == "warning"; });
  EXPECT_EQ(opinion.health("robot poses"), "warning") << opinion.all();
  EXPECT_NE(opinion.all().find("not measured"), std::string::npos) << opinion.all();
  std::thread death([&] {
    // Some seconds after the doctor has started to listen.
    for (int i = 0; i < 6'000 && !udp_backlog(box_.lcm_port); ++i)
      std::this_thread::sleep_for(std::chrono::milliseconds(10));
    std::this_thread::sleep_for(std::chrono::milliseconds(2'500));
    stop = true;
  });
  opinion = examine({}, "10");
  death.join();
  bridge.join();
  lcm_destroy(lcm);
  EXPECT_EQ(opinion.health("robot poses"), "failed") << opinion.all();
  EXPECT_NE(opinion.all().find("the newest is"), std::string::npos) << opinion.all();
}

TEST_F(DoctorTest, two_programs_that_publish_poses_are_named) {
  std::atomic<bool> stop{false};
  // slabctl inherits their sockets, and is not the one that publishes.
  const std::array<lcm_t*, 2> publishers = {lcm_create(lcm_url().c_str()), lcm_create(lcm_url().c_str())};
  const auto publish = [&](lcm_t* lcm, double x) {
    ASSERT_NE(lcm, nullptr);
    flange_pose_t pose{};
    pose.quat[0] = 1.0;
    pose.trans[0] = x;
    pose.flags = 1;
    for (pose.seq = 1; !stop; ++pose.seq) {
      pose.utime += 8'000;
      std::vector<std::uint8_t> bytes(static_cast<std::size_t>(pose.getEncodedSize()));
      pose.encode(bytes.data(), 0, static_cast<int>(bytes.size()));
      lcm_publish(lcm, "FLANGE_POSE", bytes.data(), static_cast<unsigned>(bytes.size()));
      std::this_thread::sleep_for(std::chrono::milliseconds(8));
    }
    lcm_destroy(lcm);
  };
  std::thread first([&] { publish(publishers[0], 0.0); });
  std::thread second([&] { publish(publishers[1], 0.3); });
  const auto both_are_named = [](const Opinion& seen) {
    return seen.health("robot poses") == "failed" && seen.says("two programs publish poses");
  };
  const Opinion opinion = examine_until(both_are_named, "2");
  stop = true;
  first.join();
  second.join();
  EXPECT_EQ(opinion.health("robot poses"), "failed") << opinion.all();
  EXPECT_NE(opinion.all().find("two programs publish poses"), std::string::npos) << opinion.all();
  EXPECT_NE(opinion.all().find(" (pid " + std::to_string(::getpid()) + ")"), std::string::npos) << opinion.all();
}

TEST_F(DoctorTest, poses_of_another_type_are_named_with_the_key_to_set) {
  lcm_t* lcm = lcm_create(lcm_url().c_str());
  ASSERT_NE(lcm, nullptr);
  std::atomic<bool> stop{false};
  std::thread bridge([&] {
    std::vector<std::uint8_t> bytes(72, 0);
    bot_core::rigid_transform_t pose{};
    pose.quat[0] = 1.0;
    for (pose.utime = 1; !stop; pose.utime += 8'000) {
      pose.encode(bytes.data(), 0, static_cast<int>(bytes.size()));
      lcm_publish(lcm, "FLANGE_POSE", bytes.data(), static_cast<unsigned>(bytes.size()));
      std::this_thread::sleep_for(std::chrono::milliseconds(8));
    }
  });
  const Opinion opinion =
      examine_until([](const Opinion& seen) { return seen.says("of type bot_core.rigid_transform_t"); });
  start();
  std::string status;
  for (int i = 0; i < 600 && status.find("of type bot_core.rigid_transform_t") == std::string::npos; ++i) {
    std::this_thread::sleep_for(std::chrono::milliseconds(100));
    status = box_.slabctl({"status", "--config", box_.config.native()}).out;
  }
  stop = true;
  bridge.join();
  lcm_destroy(lcm);
  EXPECT_EQ(opinion.health("robot poses"), "failed") << opinion.all();
  EXPECT_NE(opinion.all().find("of type bot_core.rigid_transform_t ([pose] type is slabd.flange_pose_t)"),
            std::string::npos)
      << opinion.all();
  EXPECT_NE(opinion.all().find("set [pose] type in slabd.toml"), std::string::npos) << opinion.all();
  EXPECT_NE(status.find("of type bot_core.rigid_transform_t ([pose] type is slabd.flange_pose_t)"), std::string::npos)
      << status;
  EXPECT_NE(status.find("other_type"), std::string::npos) << status;
}

TEST_F(DoctorTest, a_database_and_scans_that_a_group_may_write_are_named_with_the_cure) {
  start();
  const fs::path db = box_.dir / "slabd.db";
  EXPECT_EQ(examine().all().find("could be changed unseen"), std::string::npos);
  ASSERT_EQ(::chmod(db.c_str(), 0660), 0);
  ASSERT_EQ(::chmod((box_.dir / "spool").c_str(), 0777), 0);
  const Opinion opinion = examine();
  EXPECT_EQ(opinion.health("database"), "warning") << opinion.all();
  EXPECT_EQ(opinion.health("scans"), "warning") << opinion.all();
  EXPECT_NE(opinion.all().find("chmod g-w,o-w " + db.native()), std::string::npos) << opinion.all();
  EXPECT_NE(opinion.all().find("every user may write"), std::string::npos) << opinion.all();
}

TEST_F(DoctorTest, another_program_that_locks_the_database_is_named) {
  start();
  std::array<int, 2> ready{};
  ASSERT_EQ(pipe(ready.data()), 0);
  const pid_t other = fork();
  if (other == 0) {
    // POSIX lock of a writer of the log, as SQLite takes it (sqlite.org/walformat.html, WAL_WRITE_LOCK).
    const int fd = ::open((box_.dir / "slabd.db-shm").c_str(), O_RDWR);
    struct flock lock {};
    lock.l_type = F_WRLCK;
    lock.l_start = 120;
    lock.l_len = 1;
    const char answer = fd >= 0 && fcntl(fd, F_SETLKW, &lock) == 0 ? 'y' : 'n';
    (void)!::write(ready[1], &answer, 1);
    while (true) pause();
  }
  char answer = 0;
  EXPECT_EQ(::read(ready[0], &answer, 1), 1);
  EXPECT_EQ(answer, 'y');
  const Opinion opinion = examine();
  kill(other, SIGKILL);
  waitpid(other, nullptr, 0);
  EXPECT_EQ(opinion.health("database lock"), "failed") << opinion.all();
  EXPECT_NE(opinion.all().find("(process " + std::to_string(other) + ")"), std::string::npos) << opinion.all();
}

TEST_F(DoctorTest, an_absent_interface_is_not_a_route_to_the_robot) {
  const auto replaced = [&](const std::string& to) {
    const std::string text = read_file(box_.config);
    std::ofstream(box_.config) << std::regex_replace(text, std::regex("\ninterface = \"[^\"]*\""),
                                                     "\ninterface = \"" + to + "\"");
  };
  EXPECT_EQ(examine().health("robot route"), "ok");
  replaced("127.0.0.1");
  EXPECT_EQ(examine().health("robot route"), "ok");
  replaced("nosuch0");
  EXPECT_EQ(examine().health("robot route"), "failed");
}

TEST_F(DoctorTest, a_device_that_is_not_a_serial_line_is_found_before_the_daemon_starts) {
  const std::string text = read_file(box_.config);
  const auto with = [&](const std::string& device) {
    std::string changed = text;
    const std::size_t listen = changed.find("listen = ");
    changed.replace(listen, changed.find('\n', listen) - listen, "role = \"rtu\"\ndevice = \"" + device + "\"");
    std::ofstream(box_.config) << changed;
    return examine().health("plc line");
  };
  EXPECT_EQ(with("/dev/null"), "failed");
  EXPECT_EQ(with(box_.dir.native()), "failed");
  EXPECT_EQ(with("/dev/no-such-line"), "failed");
  const int master = ::posix_openpt(O_RDWR | O_NOCTTY);
  ASSERT_EQ(::grantpt(master), 0);
  ASSERT_EQ(::unlockpt(master), 0);
  EXPECT_EQ(with(::ptsname(master)), "ok");
  ::close(master);
}

TEST_F(DoctorTest, a_port_of_roots_is_not_the_services) {
  std::string text = read_file(box_.config);
  const std::size_t listen = text.find("listen = ");
  text.replace(listen, text.find('\n', listen) - listen, "listen = \"127.0.0.1:502\"");
  std::ofstream(box_.config) << text;
  // As a user other than root, whatever user runs this test.
  const fs::path out = box_.dir / "doctor.out";
  Process doctor({"/usr/bin/unshare", "--user", places::slabctl(), "doctor", "--config", box_.config.native(), "--json",
                  "--listen-s", "0.5"},
                 out, box_.dir / "doctor.err");
  (void)doctor.wait();
  const json document = json::parse(read_file(out), nullptr, false);
  if (!document.is_object()) {
    ASSERT_TRUE(namespaces_refused());
    GTEST_SKIP() << "the kernel refuses namespaces here";
  }
  unsigned first_free = 0;
  std::ifstream("/proc/sys/net/ipv4/ip_unprivileged_port_start") >> first_free;
  const Opinion opinion{0, document["findings"]};
  const bool free_for_all = first_free <= 502;
  EXPECT_EQ(opinion.health("plc port"), free_for_all ? "ok" : "failed") << opinion.all();
  if (free_for_all) return;
  EXPECT_NE(opinion.all().find("AmbientCapabilities=CAP_NET_BIND_SERVICE"), std::string::npos) << opinion.all();
}

TEST_F(DoctorTest, a_route_over_an_interface_without_an_address_is_a_route) {
  const std::string text = read_file(box_.config);
  std::ofstream(box_.config) << std::regex_replace(text, std::regex("\ninterface = \"[^\"]*\""), "");
  // A separate network, as after `ip route add GROUP/32 dev lo`.
  Process doctor(
      {"/bin/sh", "-c",
       "exec /usr/bin/unshare --net /bin/sh -c 'ip link set lo up && ip route add 239.0.0.0/8 dev lo && exec \"$@\"' "
       "- '" +
           places::slabctl() + "' doctor --json --listen-s 0.5 --config " + box_.config.native()},
      box_.dir / "doctor.out", box_.dir / "doctor.err");
  (void)doctor.wait();
  const json document = json::parse(read_file(box_.dir / "doctor.out"), nullptr, false);
  if (!document.is_object()) {
    ASSERT_TRUE(namespaces_refused());
    GTEST_SKIP() << "the kernel refuses namespaces here";
  }
  const Opinion opinion{0, document["findings"]};
  EXPECT_EQ(opinion.health("robot route"), "ok") << opinion.all();
}

TEST_F(DoctorTest, a_disk_that_can_only_be_read_is_not_writable) {
  const std::optional<Opinion> opinion = with_scans_on(MS_RDONLY, "mode=0777");
  if (!opinion) GTEST_SKIP() << "the kernel refuses mounts here";
  EXPECT_EQ(opinion->health("scans"), "failed") << opinion->all();
  EXPECT_NE(opinion->all().find("is read-only"), std::string::npos) << opinion->all();
}

TEST_F(DoctorTest, a_disk_without_inodes_is_full_whatever_space_it_has) {
  const std::optional<Opinion> opinion = with_scans_on(0, "mode=0777,nr_inodes=40");
  if (!opinion) GTEST_SKIP() << "the kernel refuses mounts here";
  EXPECT_EQ(opinion->health("scan disk"), "failed") << opinion->all();
  EXPECT_NE(opinion->all().find("the inodes are used up"), std::string::npos) << opinion->all();
}

TEST_F(DoctorTest, an_address_that_this_computer_lacks_is_why_no_gateway_connects) {
  const std::string text = read_file(box_.config);
  const std::size_t scanner = text.find("[scanner]");
  ASSERT_NE(scanner, std::string::npos);
  const std::size_t next = text.find("\n[", scanner);
  std::ofstream(box_.config) << text.substr(0, scanner) << "[scanner]\nbackend = \"tcp\"\nlisten = \"192.0.2.7:1504\"\n"
                             << text.substr(next);
  start();
  const Opinion opinion = examine();
  EXPECT_EQ(opinion.health("scanner link"), "failed") << opinion.all();
  EXPECT_NE(opinion.all().find("192.0.2.7"), std::string::npos) << opinion.all();
  EXPECT_NE(opinion.all().find("correct [scanner] listen"), std::string::npos) << opinion.all();
  const Box::Answer status = box_.slabctl({"status", "--config", box_.config.native()});
  EXPECT_NE(status.out.find("stray files; cannot listen for the gateway on 192.0.2.7:1504: "), std::string::npos)
      << status.out;
}

TEST_F(DoctorTest, finds_the_daemons_configuration_from_any_start_folder) {
  box_.launcher = {
      "/bin/sh", "-c",
      "cd '" + box_.dir.native() + "' && exec '" + places::slabd() + "' --config " + box_.config.filename().native()};
  start();
  for (const json& finding : examine().findings)
    EXPECT_FALSE(finding["check"] == "daemon" && finding["saw"].dump().find("it runs with") != std::string::npos)
        << finding;
  const Box::Answer status = box_.slabctl({"status", "--json", "--config", box_.config.native()});
  EXPECT_EQ(json::parse(status.out)["config"], box_.config.native());
}

TEST_F(DoctorTest, a_limit_under_which_a_scan_cannot_be_written_is_found) {
  start();
  EXPECT_EQ(examine().health("limits"), "ok");
  const rlimit small{50'000'000, 50'000'000};
  ASSERT_EQ(::prlimit(box_.pid(), RLIMIT_FSIZE, &small, nullptr), 0);
  const Opinion opinion = examine();
  EXPECT_EQ(opinion.health("limits"), "failed") << opinion.all();
}

TEST_F(DoctorTest, reports_the_interface_to_the_plc) {
  std::string text = read_file(box_.config);
  const std::size_t listen = text.find("listen = ");
  ASSERT_NE(listen, std::string::npos) << text;
  text.insert(listen, "allow = [\"127.0.0.9/32\"]\n");
  std::ofstream(box_.config) << std::regex_replace(text, std::regex("listen = \"127.0.0.1:"), "listen = \"0.0.0.0:");
  const Opinion opinion = examine();
  EXPECT_EQ(opinion.health("plc network"), "note") << "no other computer may connect\n" << opinion.all();
  EXPECT_EQ(opinion.health("plc route"), "ok") << opinion.all();
  EXPECT_NE(opinion.all().find("127.0.0.9 by lo"), std::string::npos) << opinion.all();
}

TEST_F(DoctorTest, a_plc_that_cannot_be_reached_is_reported_by_doctor_and_status) {
  // slabd connects to the PLC, which does not exist.
  std::string text = read_file(box_.config);
  const std::size_t listen = text.find("listen = ");
  ASSERT_NE(listen, std::string::npos) << text;
  text.replace(listen, text.find('\n', listen) - listen, "role = \"client\"\nconnect = \"127.0.0.1:1\"");
  std::ofstream(box_.config) << text;
  box_.start();
  Opinion opinion;
  for (int i = 0; i < 20 && opinion.health("plc link") != "failed"; ++i) opinion = examine();
  EXPECT_EQ(opinion.health("plc link"), "failed") << opinion.all();
  const Box::Answer status = box_.slabctl({"status", "--config", box_.config.native()});
  EXPECT_NE(status.out.find("plc.connect 127.0.0.1:1: connecting: Connection refused"), std::string::npos)
      << status.out;
}

TEST_F(DoctorTest, reports_no_failure_on_a_running_line_and_does_not_disturb_it) {
  start();
  const auto line = box_.simulate({"--slab-no", "1"});
  Opinion opinion;
  for (int i = 0; i < 20; ++i) {
    opinion = examine();
    if (opinion.exit_status == 0) break;
  }
  EXPECT_EQ(opinion.exit_status, 0) << opinion.all();
  for (const char* check : {"plc registers", "plc heartbeat", "robot link", "robot poses", "robot frame", "daemon"})
    EXPECT_NE(opinion.health(check), "failed") << check;
  EXPECT_EQ(opinion.health("robot frame"), "ok");
  EXPECT_EQ(opinion.health("plc heartbeat"), "ok");
  // The slab continues while the doctor runs, and passes.
  EXPECT_EQ(line->wait(), 0) << read_file(box_.dir / "simulate.err");
}

TEST_F(DoctorTest, takes_a_scan_on_request_and_releases_the_line) {
  start();
  const Process cell({places::slabctl(), "simulate", "calibration", "--live", "--kind", "ball", "--views", "3",
                      "--move-s", "0.2", "--config", box_.config.native(), "--out", (box_.dir / "truth").native()},
                     box_.dir / "cell.out", box_.dir / "cell.err");
  Opinion opinion;
  for (int i = 0; i < 20; ++i) {
    opinion = examine({"--scan"});
    if (opinion.health("scan") == "ok") break;
  }
  EXPECT_EQ(opinion.health("scan"), "ok") << opinion.all();
  const json status = json::parse(box_.slabctl({"status", "--config", box_.config.native(), "--json"}).out);
  EXPECT_EQ(status["state"], "idle");
  EXPECT_TRUE(is_emptied(box_.dir / "spool" / "capture")) << "the scan is gone again";
}

}  // namespace
}  // namespace slabd::line
