// SPDX-License-Identifier: Apache-2.0
//
// A real daemon and its database: copies while it runs, damage, restoring; and the PLC's registers while the database
// is unusable.
#include <arpa/inet.h>
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <poll.h>
#include <pty.h>
#include <sched.h>
#include <sys/mount.h>
#include <sys/socket.h>
#include <sys/statvfs.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <chrono>
#include <csignal>
#include <cstdlib>
#include <fstream>
#include <nlohmann/json.hpp>

#include "processes.h"
#include "tests/places/places.h"

namespace slabd::line {
namespace {

using nlohmann::json;

/// Reads an input register over Modbus/TCP; -1 without an answer.
int input_register(std::uint16_t port, std::uint8_t address) {
  const int fd = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
  sockaddr_in peer{};
  peer.sin_family = AF_INET;
  peer.sin_port = htons(port);
  peer.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  const std::array<unsigned char, 12> ask = {0, 1, 0, 0, 0, 6, 1, 4, 0, address, 0, 1};
  std::array<unsigned char, 11> answer{};
  int value = -1;
  if (::connect(fd, reinterpret_cast<sockaddr*>(&peer), sizeof peer) == 0 &&
      ::write(fd, ask.data(), ask.size()) == static_cast<ssize_t>(ask.size()) &&
      ::recv(fd, answer.data(), answer.size(), MSG_WAITALL) == static_cast<ssize_t>(answer.size()) && answer[7] == 4)
    value = answer[9] << 8 | answer[10];
  ::close(fd);
  return value;
}
constexpr std::uint8_t kState = 6;
constexpr std::uint8_t kFault = 7;
constexpr int kStateFault = 7;

class CareLine : public testing::Test {
 protected:
  void start() {
    box_.start();
    ASSERT_TRUE(box_.ready()) << box_.log();
    ASSERT_TRUE(box_.logs("Modbus/TCP server")) << box_.log();
  }
  [[nodiscard]] Box::Answer db(std::vector<std::string> args) const {
    args.insert(args.begin(), "db");
    if (args[1] != "verify") {
      args.emplace_back("--config");
      args.push_back(box_.config.native());
    }
    return box_.slabctl(args);
  }
  /// Makes a copy and returns its path.
  [[nodiscard]] std::string backup() const {
    const Box::Answer answer = db({"backup", "--json"});
    EXPECT_EQ(answer.exit_status, 0) << answer.err;
    const json report = json::parse(answer.out, nullptr, false);
    EXPECT_TRUE(report.is_object() && report["whole"].get<bool>()) << answer.out;
    return report.is_object() ? report["file"].get<std::string>() : "";
  }

  Box box_;
};

TEST_F(CareLine, a_running_daemon_is_backed_up_and_the_backup_restored_when_it_has_stopped) {
  start();
  const std::string copy = backup();
  EXPECT_TRUE(copy.starts_with((box_.dir / "backups/slabd-").native())) << copy;
  EXPECT_EQ(db({"verify", copy}).exit_status, 0);
  EXPECT_EQ(db({"check", "--full"}).exit_status, 0);
  EXPECT_EQ(db({"prune", "--keep-slabs", "100"}).exit_status, 0);
  EXPECT_EQ(db({"prune", "--keep-slabs", "5"}).exit_status, 2);

  const Box::Answer early = db({"restore", copy, "--reason", "test"});
  EXPECT_EQ(early.exit_status, 6);
  EXPECT_NE(early.err.find("stop it first"), std::string::npos) << early.err;

  EXPECT_EQ(box_.stop(), 0);
  const Box::Answer done = db({"restore", copy, "--reason", "the disk was changed", "--operator", "anna"});
  EXPECT_EQ(done.exit_status, 0) << done.err;
  start();
  EXPECT_NE(input_register(box_.port, kState), kStateFault) << box_.log();
  const Box::Answer history = box_.slabctl({"history", "--config", box_.config.native()});
  EXPECT_NE(history.out.find("restored from " + copy), std::string::npos) << history.out;
  EXPECT_NE(history.out.find("anna: the disk was changed"), std::string::npos) << history.out;
  EXPECT_EQ(box_.stop(), 0);
}

TEST_F(CareLine, a_copy_on_another_disk_is_checked_there_and_old_ones_go) {
  const std::string out = (box_.dir / "stick.db").native();
  start();
  std::ofstream(out + ".part") << "of a stick that was full, or pulled out";
  const Box::Answer made = db({"backup", "--out", out});
  EXPECT_EQ(made.exit_status, 0) << made.out << made.err;
  EXPECT_FALSE(fs::exists(out + ".part"));
  EXPECT_EQ(db({"verify", out}).exit_status, 0);
  EXPECT_EQ(db({"backup", "--out", out}).exit_status, 3) << "nothing is overwritten";
  EXPECT_EQ(db({"backup", "--keep", "1"}).exit_status, 0);
  int left = 0;
  for (const auto& entry : fs::directory_iterator(box_.dir / "backups")) left += entry.is_regular_file() ? 1 : 0;
  EXPECT_EQ(left, 1);
  EXPECT_EQ(box_.stop(), 0);
  const Box::Answer offline = db({"backup"});
  EXPECT_EQ(offline.exit_status, 0) << "without a daemon too: " << offline.err;
}

/// Not an exit status of slabctl, nor of a program that crashed or was not found.
constexpr int kMountRefused = 97;

/// Runs the command in a mount namespace in which backups are read-only, as for a service unit without write access.
/// Without root that requires a user namespace, which some kernels and containers refuse.
int keep_one_on_a_read_only_disk(const fs::path& backups, const std::vector<std::string>& command,
                                 const fs::path& dir) {
  if (unshare(CLONE_NEWNS) != 0 && unshare(CLONE_NEWUSER | CLONE_NEWNS) != 0) return kMountRefused;
  struct statvfs disk {};
  if (statvfs(backups.c_str(), &disk) != 0) return kMountRefused;
  // The mount options of the disk cannot be removed in a user namespace.
  const unsigned long kept = disk.f_flag & (ST_NOSUID | ST_NODEV | ST_NOEXEC);
  if (mount(nullptr, "/", nullptr, MS_REC | MS_PRIVATE, nullptr) != 0 ||
      mount(backups.c_str(), backups.c_str(), nullptr, MS_BIND, nullptr) != 0 ||
      mount(nullptr, backups.c_str(), nullptr, MS_BIND | MS_REMOUNT | MS_RDONLY | kept, nullptr) != 0)
    return kMountRefused;
  Process process(command, dir / "keep.out", dir / "keep.err");
  return process.wait();
}

TEST_F(CareLine, old_backups_that_cannot_be_deleted_are_a_failure) {
  start();
  (void)backup();
  const pid_t child = ::fork();
  if (child == 0)
    _exit(keep_one_on_a_read_only_disk(
        box_.dir / "backups", {places::slabctl(), "db", "backup", "--keep", "1", "--config", box_.config.native()},
        box_.dir));
  int status = -1;
  ::waitpid(child, &status, 0);
  ASSERT_TRUE(WIFEXITED(status));
  if (WEXITSTATUS(status) == kMountRefused)
    GTEST_SKIP() << "needs a disk that can only be read: neither root's mounts nor a user namespace are allowed here";
  EXPECT_EQ(WEXITSTATUS(status), 4);
  const std::string err = read_file(box_.dir / "keep.err");
  EXPECT_NE(err.find("cannot be deleted"), std::string::npos) << err;
  EXPECT_NE(err.find("systemctl edit slabd-backup"), std::string::npos) << err;
  EXPECT_EQ(box_.stop(), 0);
}

TEST_F(CareLine, a_damaged_database_is_fault_502_with_modbus_up_until_one_is_restored) {
  start();
  const std::string copy = backup();
  EXPECT_EQ(box_.stop(), 0);
  {
    std::fstream file(box_.dir / "slabd.db", std::ios::in | std::ios::out | std::ios::binary);
    for (std::streamoff page = 3; page < 40; ++page) file.seekp(page * 4096) << std::string(2048, '\x5a');
  }
  for (int round = 0; round < 2; ++round) {
    start();
    EXPECT_EQ(input_register(box_.port, kFault), 502) << box_.log();
    EXPECT_EQ(input_register(box_.port, kState), kStateFault);
    EXPECT_TRUE(box_.logs("quarantine")) << box_.log();
    EXPECT_EQ(box_.stop(), 0);
  }
  const Box::Answer history = box_.slabctl({"history", "--config", box_.config.native()});
  EXPECT_EQ(history.exit_status, 4);
  EXPECT_NE(history.err.find("quarantine"), std::string::npos) << history.err;
  const Box::Answer restored = db({"restore", copy, "--reason", "damaged"});
  EXPECT_EQ(restored.exit_status, 0) << restored.err;
  start();
  EXPECT_EQ(input_register(box_.port, kFault), 0) << box_.log();
  EXPECT_EQ(box_.stop(), 0);
}

TEST_F(CareLine, a_lost_database_is_not_created_again_unless_a_person_orders_it) {
  start();
  (void)backup();
  EXPECT_EQ(box_.stop(), 0);
  for (const char* side : {"", "-wal", "-shm"}) fs::remove(box_.dir / (std::string("slabd.db") + side));
  start();
  EXPECT_EQ(input_register(box_.port, kFault), 502) << box_.log();
  EXPECT_TRUE(box_.logs("shows that there was one")) << box_.log();
  EXPECT_EQ(box_.stop(), 0);
  EXPECT_EQ(db({"restore", "--reason", "x"}).exit_status, 2) << "which one?";
  EXPECT_EQ(db({"restore", "--fresh", "--reason", "a new line"}).exit_status, 0);
  start();
  EXPECT_EQ(input_register(box_.port, kFault), 0) << box_.log();
  const Box::Answer history = box_.slabctl({"history", "--config", box_.config.native()});
  EXPECT_NE(history.out.find("started again"), std::string::npos) << history.out;
  EXPECT_EQ(box_.stop(), 0);
}

TEST_F(CareLine, a_database_that_is_deleted_under_the_daemon_is_fault_502_and_can_still_be_saved) {
  start();
  const std::unique_ptr<Process> line = box_.simulate({"--slab-no", "7", "--slab-id", "LAST-7", "--move-s", "0.05"});
  EXPECT_EQ(line->wait(), 0);
  for (const char* side : {"", "-wal", "-shm"}) fs::remove(box_.dir / (std::string("slabd.db") + side));
  for (int i = 0; i < 6'000 && input_register(box_.port, kFault) != 502; ++i) ::usleep(10'000);
  EXPECT_EQ(input_register(box_.port, kFault), 502) << box_.log();
  EXPECT_TRUE(box_.logs("slabctl db backup saves it")) << box_.log();
  const std::string copy = backup();
  EXPECT_EQ(box_.stop(), 0);
  EXPECT_EQ(db({"restore", copy, "--reason", "it was deleted"}).exit_status, 0);
  start();
  EXPECT_EQ(input_register(box_.port, kFault), 0) << box_.log();
  const Box::Answer history = box_.slabctl({"history", "--config", box_.config.native()});
  EXPECT_NE(history.out.find("LAST-7"), std::string::npos) << history.out;
  EXPECT_EQ(box_.stop(), 0);
}

TEST_F(CareLine, a_second_daemon_leaves_the_scanner_alone_until_the_database_is_its_own) {
  start();
  Box other;
  std::string text = read_file(other.config);
  const std::string own = (other.dir / "slabd.db").native();
  text.replace(text.find(own), own.size(), (box_.dir / "slabd.db").native());
  std::ofstream(other.config) << text;
  const fs::path scan = other.dir / "drop/inbox/not-requested.ply";
  fs::create_directories(scan.parent_path());
  std::ofstream(scan) << "ply\n";
  other.start();
  ASSERT_TRUE(other.ready()) << other.log();
  for (int i = 0; i < 6'000 && input_register(other.port, kFault) != 502; ++i) ::usleep(10'000);
  EXPECT_EQ(input_register(other.port, kFault), 502) << other.log();
  EXPECT_TRUE(other.logs("another process works with")) << other.log();
  EXPECT_TRUE(fs::exists(scan)) << other.log();
  EXPECT_EQ(box_.stop(), 0);
  // Retried after a few seconds.
  for (int i = 0; i < 6'000 && (input_register(other.port, kFault) != 0 || fs::exists(scan)); ++i) ::usleep(10'000);
  EXPECT_EQ(input_register(other.port, kFault), 0) << other.log();
  EXPECT_FALSE(fs::exists(scan)) << other.log();
  EXPECT_EQ(other.stop(), 0);
}

/// A daemon with its own database and port, which shares one folder with another daemon.
void share_folder(const Box& box, const Box& with, const std::string& folder) {
  std::string text = read_file(box.config);
  const std::string own = (box.dir / folder).native();
  text.replace(text.find(own), own.size(), (with.dir / folder).native());
  std::ofstream(box.config) << text;
}

bool comes_to_fault(const Box& box, int code) {
  for (int i = 0; i < 6'000 && input_register(box.port, kFault) != code; ++i) ::usleep(10'000);
  return input_register(box.port, kFault) == code;
}

/// The second of two daemons is in fault 504, names the first, and continues when the first has ended.
void expect_one_at_a_time(Box& first, Box& second) {
  second.start();
  ASSERT_TRUE(second.ready()) << second.log();
  EXPECT_TRUE(comes_to_fault(second, 504)) << second.log();
  EXPECT_EQ(input_register(second.port, kState), kStateFault);
  const json status =
      json::parse(second.slabctl({"status", "--json", "--config", second.config.native()}).out, nullptr, false);
  ASSERT_TRUE(status.is_object());
  const std::string text = status["fault"]["text"].get<std::string>();
  EXPECT_NE(text.find("is used by another daemon (slabd, process " + std::to_string(first.pid()) + " on "),
            std::string::npos)
      << text;
  EXPECT_NE(text.find(first.config.native()), std::string::npos) << text;
  EXPECT_EQ(input_register(first.port, kFault), 0) << first.log();
  first.kill_hard();
  EXPECT_TRUE(comes_to_fault(second, 0)) << second.log();
  EXPECT_EQ(second.stop(), 0);
}

TEST_F(CareLine, the_second_of_two_daemons_on_one_drop_folder_is_in_504_and_names_the_first) {
  start();
  Box other;
  share_folder(other, box_, "drop");
  expect_one_at_a_time(box_, other);
}

TEST_F(CareLine, the_second_of_two_daemons_on_one_spool_is_in_504_and_names_the_first) {
  start();
  Box other;
  share_folder(other, box_, "spool");
  expect_one_at_a_time(box_, other);
}

/// Runs `slabctl status --watch` on a separate terminal.
class Watch {
 public:
  explicit Watch(const fs::path& config, const char* language = "en") {
    const winsize size{24, 120, 0, 0};
    pid_ = ::forkpty(&terminal_, nullptr, nullptr, &size);
    if (pid_ != 0) return;
    ::execl(places::slabctl().c_str(), places::slabctl().c_str(), "status", "--watch", "--language", language,
            "--config", config.c_str(), nullptr);
    ::_exit(127);
  }
  ~Watch() {
    ::kill(pid_, SIGKILL);
    ::waitpid(pid_, nullptr, 0);
    ::close(terminal_);
  }
  Watch(const Watch&) = delete;
  Watch& operator=(const Watch&) = delete;

  /// True if a complete new picture with `text` appears within a minute.
  [[nodiscard]] bool shows(const std::string& text) {
    const auto until = std::chrono::steady_clock::now() + std::chrono::seconds(60);
    std::string seen;
    while (std::chrono::steady_clock::now() < until) {
      pollfd ready{terminal_, POLLIN, 0};
      std::array<char, 4096> piece{};
      if (::poll(&ready, 1, 100) <= 0) continue;
      const ssize_t got = ::read(terminal_, piece.data(), piece.size());
      if (got <= 0) return false;
      seen.append(piece.data(), static_cast<std::size_t>(got));
      last = seen;
      if (seen.find(text) != std::string::npos) return true;
      const std::size_t whole = seen.rfind("\x1b[J");
      if (whole != std::string::npos) seen.erase(0, whole);
    }
    return false;
  }
  std::string last;

 private:
  int terminal_ = -1;
  pid_t pid_ = -1;
};

TEST_F(CareLine, the_operators_screen_follows_to_a_database_that_took_the_place_of_its_own) {
  start();
  Watch watch(box_.config);
  ASSERT_TRUE(watch.shows("no slab yet")) << watch.last;
  const std::unique_ptr<Process> line = box_.simulate({"--slab-no", "7", "--slab-id", "OLD-7", "--move-s", "0.05"});
  ASSERT_TRUE(watch.shows("OLD-7")) << watch.last;
  line->signal(SIGTERM);
  static_cast<void>(line->wait());
  EXPECT_EQ(box_.stop(), 0);
  EXPECT_EQ(db({"restore", "--fresh", "--reason", "test", "--lose-calibrations"}).exit_status, 0);
  start();
  EXPECT_TRUE(watch.shows("no slab yet")) << watch.last;
  EXPECT_EQ(box_.stop(), 0);
}

TEST_F(CareLine, the_operators_screen_has_a_chinese_word_for_values_of_commissioning) {
  start();
  Watch watch(box_.config, "zh");
  EXPECT_TRUE(watch.shows("调试值")) << watch.last;
  EXPECT_EQ(box_.stop(), 0);
}

TEST_F(CareLine, figures_are_written_for_prometheus_and_include_a_silent_daemon) {
  const fs::path file = box_.dir / "slabd.prom";
  const std::vector<std::string> ask = {"metrics", "--config", box_.config.native(), "--out", file.native()};
  EXPECT_EQ(box_.slabctl(ask).exit_status, 4);
  EXPECT_NE(read_file(file).find("\nslabd_up 0\n"), std::string::npos);
  start();
  EXPECT_EQ(box_.slabctl(ask).exit_status, 0);
  const std::string text = read_file(file);
  for (const char* line : {"\nslabd_up 1\n", "\nslabd_fault_code 0\n", "\nslabd_store_ok 1\n"})
    EXPECT_NE(text.find(line), std::string::npos) << line << text;
  EXPECT_EQ(std::system(("promtool check metrics <" + file.native()).c_str()), 0) << "Prometheus' own judge";
  EXPECT_EQ(box_.stop(), 0);
}

TEST_F(CareLine, figures_do_not_grow_old_with_a_faulty_configuration) {
  const fs::path file = box_.dir / "slabd.prom";
  const std::vector<std::string> ask = {"metrics", "--config", box_.config.native(), "--out", file.native()};
  const auto is_told = [&](const char* line) {
    const bool told = read_file(file).find(line) != std::string::npos;
    std::ofstream(file) << "old\n";
    return told;
  };
  start();
  EXPECT_EQ(box_.slabctl(ask).exit_status, 0);
  EXPECT_TRUE(is_told("\nslabd_up 1\n"));
  std::ofstream(box_.config, std::ios::app) << "\n[scanner2]\n";
  EXPECT_EQ(box_.slabctl(ask).exit_status, 3);
  EXPECT_TRUE(is_told("\nslabd_fault_code 0\n")) << "it runs on with what it has read";
  EXPECT_EQ(box_.stop(), 0);
  EXPECT_EQ(box_.slabctl(ask).exit_status, 3);
  EXPECT_TRUE(is_told("\nslabd_up 0\n"));
  start();
  EXPECT_EQ(box_.slabctl(ask).exit_status, 3);
  EXPECT_TRUE(is_told("\nslabd_fault_code 504\n"));
  EXPECT_EQ(box_.stop(), 0);
}

TEST_F(CareLine, a_faulty_configuration_is_fault_504_for_every_client) {
  std::ofstream(box_.config, std::ios::app) << "\n[scanner2]\n";
  start();
  EXPECT_EQ(input_register(box_.port, kFault), 504) << box_.log();
  EXPECT_EQ(input_register(box_.port, kState), kStateFault);
  const Box::Answer status = box_.slabctl({"status", "--config", box_.config.native()});
  EXPECT_EQ(status.exit_status, 3);
  EXPECT_NE(status.err.find("scanner2"), std::string::npos) << status.err;
  EXPECT_NE(status.out.find("504: the configuration is not usable"), std::string::npos) << status.out << status.err;
  const Box::Answer monitor = box_.slabctl({"plc", "monitor", "--once", "--config", box_.config.native()});
  EXPECT_EQ(monitor.exit_status, 3);
  EXPECT_NE(monitor.err.find("scanner2"), std::string::npos) << monitor.err;
  EXPECT_NE(monitor.out.find("504"), std::string::npos) << monitor.out << monitor.err;
  EXPECT_EQ(box_.stop(), 0);
  EXPECT_EQ(box_.slabctl({"plc", "monitor", "--once", "--config", box_.config.native()}).exit_status, 3);
}

TEST_F(CareLine, without_recipes_it_shows_504_and_its_database_is_still_backed_up) {
  start();
  EXPECT_EQ(box_.stop(), 0);
  std::string text = read_file(box_.config);
  text.replace(text.find("/recipes"), 8, "/nowhere");
  std::ofstream(box_.config) << text;
  start();
  const Box::Answer status = box_.slabctl({"status", "--config", box_.config.native()});
  EXPECT_EQ(status.exit_status, 0) << status.err;
  EXPECT_NE(status.out.find("504: the configuration is not usable"), std::string::npos) << status.out;
  EXPECT_NE(status.out.find("store        ok no"), std::string::npos) << status.out;
  const Box::Answer doctor = box_.slabctl({"doctor", "--config", box_.config.native(), "--listen-s", "1"});
  EXPECT_NE(doctor.out.find("fault 504"), std::string::npos) << doctor.out;
  EXPECT_EQ(doctor.out.find("another program"), std::string::npos) << doctor.out;
  // The database was not opened, so its content and whether it can be written are unknown.
  for (const char* claim : {"cannot write it", "no calibration has been applied yet", "scanner is not verified"}) {
    EXPECT_EQ(doctor.out.find(claim), std::string::npos) << claim << "\n" << doctor.out;
    EXPECT_EQ(status.out.find(claim), std::string::npos) << claim << "\n" << status.out;
  }
  EXPECT_EQ(db({"backup"}).exit_status, 0);
  EXPECT_EQ(box_.stop(), 0);
}

}  // namespace
}  // namespace slabd::line
