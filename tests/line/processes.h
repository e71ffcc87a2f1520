// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <sys/types.h>

#include <cstdint>
#include <filesystem>
#include <memory>
#include <optional>
#include <string>
#include <vector>

/// Real processes for whole-line tests: each with its own folder, ports and multicast group, so that tests can run in
/// parallel and next to a production daemon.
namespace slabd::line {

namespace fs = std::filesystem;

/// A child process with stdout and stderr in files. Killed when the object is destroyed.
class Process {
 public:
  Process(const std::vector<std::string>& command, const fs::path& out, const fs::path& err);
  ~Process();
  Process(const Process&) = delete;
  Process& operator=(const Process&) = delete;

  void signal(int number) const;
  /// Exit status, or 128 + signal.
  int wait();
  [[nodiscard]] bool running();
  [[nodiscard]] pid_t pid() const { return pid_; }

 private:
  pid_t pid_ = -1;
  int status_ = -1;
};

/// A sanitizer needs as much memory as the program itself, so memory figures are not checked with one.
#if defined(__SANITIZE_ADDRESS__) || defined(__SANITIZE_THREAD__)
inline constexpr bool kSanitized = true;
#else
inline constexpr bool kSanitized = false;
#endif

[[nodiscard]] std::string read_file(const fs::path& path);
/// Memory that a process has touched itself. The pages of its program and libraries do not count, because the kernel
/// maps and unmaps them as the page cache is filled.
[[nodiscard]] std::int64_t anonymous_kb(pid_t pid);
/// Waits for the deletion of released scans, which the storage thread does when it is idle.
[[nodiscard]] bool is_emptied(const fs::path& folder);
/// Bytes in a UDP port's receive buffer; nullopt if the port is not bound.
[[nodiscard]] std::optional<std::size_t> udp_backlog(std::uint16_t port);

/// Keys of [robot] for tests of the line: a pose may be a second old. On a computer with other work the emulated robot
/// sends late, and a scan would be refused as code 202, which tests/daemon and pose_line_test.cpp test.
inline constexpr const char* kPatientRobot = "stale_ms = 1000\ngap_ms = 1000\n";

/// One configured daemon: writes its slabd.toml, starts and stops it.
class Box {
 public:
  Box();
  ~Box();
  Box(const Box&) = delete;
  Box& operator=(const Box&) = delete;

  /// With additional arguments.
  void start(const std::vector<std::string>& more = {});
  /// Waits until the daemon answers on its port; false if it ended instead.
  [[nodiscard]] bool ready();
  void kill_hard();
  /// Sends SIGTERM and returns the exit status.
  int stop();
  [[nodiscard]] bool running() { return daemon_ && daemon_->running(); }
  [[nodiscard]] pid_t pid() const { return daemon_->pid(); }
  [[nodiscard]] std::string log() const { return read_file(dir / "slabd.err"); }
  /// Waits until the log contains this text: a thread of its own writes it, after what it tells of.
  [[nodiscard]] bool logs(const std::string& text) const;

  struct Answer {
    int exit_status = -1;
    std::string out;
    std::string err;
  };
  /// Runs slabctl to its end. slabctl waits 3 s for slabd's answer, and on a computer with other work a process may be
  /// paused for longer: `status`, `metrics` and `plc monitor` are then repeated while slabd runs.
  [[nodiscard]] Answer slabctl(std::vector<std::string> args) const;
  /// Starts `slabctl simulate` without waiting.
  [[nodiscard]] std::unique_ptr<Process> simulate(std::vector<std::string> args) const;

  /// Prefix of the daemon's command line: env and its variables, or empty.
  std::vector<std::string> launcher;
  fs::path dir;
  fs::path config;
  std::uint16_t port = 0;
  /// Port of the group that robot and daemon share.
  std::uint16_t lcm_port = 0;

 private:
  [[nodiscard]] Answer slabctl_once(const std::vector<std::string>& args) const;

  mutable int late_ = 0;  ///< looks that slabd did not answer within 3 s
  std::unique_ptr<Process> daemon_;
};

}  // namespace slabd::line
