// SPDX-License-Identifier: Apache-2.0
#include "processes.h"

#include <sys/time.h>

#include <arpa/inet.h>
#include <fcntl.h>
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <sys/wait.h>
#include <unistd.h>

#include <array>
#include <cerrno>
#include <chrono>
#include <csignal>
#include <cstdio>
#include <fstream>
#include <sstream>
#include <stdexcept>
#include <thread>

#include "tests/places/places.h"
#include "tests/places/ports.h"
#include "tests/places/wait.h"

namespace slabd::line {
namespace {

void redirect(int target, const fs::path& file) {
  const int fd = ::open(file.c_str(), O_WRONLY | O_CREAT | O_APPEND, 0600);
  if (fd < 0 || ::dup2(fd, target) < 0) ::_exit(127);
  ::close(fd);
}

sockaddr_in loopback(std::uint16_t port) {
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_port = htons(port);
  address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
  return address;
}

/// True if the Modbus server has left STATE 0 and 1 (init, recover): the database is open and memory is allocated. A
/// server that refuses reading closes the connection, and counts as ready then. One that listens and does not answer
/// yet is not ready.
bool answers(std::uint16_t port) {
  const int fd = ::socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
  const timeval patience{1, 0};
  ::setsockopt(fd, SOL_SOCKET, SO_RCVTIMEO, &patience, sizeof patience);
  const sockaddr_in address = loopback(port);
  const std::array<std::uint8_t, 12> read_state = {0, 1, 0, 0, 0, 6, 1, 4, 0, 6, 0, 1};
  std::array<std::uint8_t, 11> answer{};
  errno = 0;
  const bool connected = ::connect(fd, reinterpret_cast<const sockaddr*>(&address), sizeof address) == 0;
  const bool answered =
      connected &&
      ::send(fd, read_state.data(), read_state.size(), MSG_NOSIGNAL) == static_cast<ssize_t>(read_state.size()) &&
      ::recv(fd, answer.data(), answer.size(), MSG_WAITALL) == static_cast<ssize_t>(answer.size());
  const bool waits = connected && !answered && (errno == EAGAIN || errno == EWOULDBLOCK);
  ::close(fd);
  return connected && !waits && (!answered || answer[10] > 1);
}

}  // namespace

Process::Process(const std::vector<std::string>& command, const fs::path& out, const fs::path& err) {
  std::vector<char*> argv;
  for (const std::string& word : command) argv.push_back(const_cast<char*>(word.c_str()));
  argv.push_back(nullptr);
  pid_ = ::fork();
  if (pid_ == 0) {
    redirect(STDOUT_FILENO, out);
    redirect(STDERR_FILENO, err);
    ::execv(argv[0], argv.data());
    ::_exit(127);
  }
  if (pid_ < 0) throw std::runtime_error("fork failed");
}

Process::~Process() {
  if (!running()) return;
  signal(SIGKILL);
  wait();
}

void Process::signal(int number) const {
  ::kill(pid_, number);
}

bool Process::running() {
  if (status_ >= 0) return false;
  int status = 0;
  if (::waitpid(pid_, &status, WNOHANG) == 0) return true;
  status_ = WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
  return false;
}

int Process::wait() {
  if (status_ >= 0) return status_;
  int status = 0;
  ::waitpid(pid_, &status, 0);
  status_ = WIFEXITED(status) ? WEXITSTATUS(status) : 128 + WTERMSIG(status);
  return status_;
}

bool is_emptied(const fs::path& folder) {
  for (int i = 0; i < 3'000 && !fs::is_empty(folder); ++i) ::usleep(20'000);
  return fs::is_empty(folder);
}

std::string read_file(const fs::path& path) {
  std::ifstream in(path, std::ios::binary);
  std::ostringstream text;
  text << in.rdbuf();
  return text.str();
}

std::int64_t anonymous_kb(pid_t pid) {
  std::ifstream status("/proc/" + std::to_string(pid) + "/status");
  for (std::string line; std::getline(status, line);) {
    std::istringstream words(line);
    std::string name;
    std::int64_t kb = 0;
    if (words >> name >> kb && name == "RssAnon:") return kb;
  }
  return -1;
}

std::optional<std::size_t> udp_backlog(std::uint16_t port) {
  std::array<char, 6> hex{};
  std::snprintf(hex.data(), hex.size(), ":%04X", unsigned{port});
  std::ifstream table("/proc/self/net/udp");
  std::optional<std::size_t> bytes;
  for (std::string line; std::getline(table, line);) {
    std::istringstream words(line);
    std::string slot;
    std::string own;
    std::string peer;
    std::string state;
    std::string queues;  // to be sent, and received, in hexadecimal
    words >> slot >> own >> peer >> state >> queues;
    if (own.ends_with(hex.data()))
      bytes = bytes.value_or(0) + std::stoul(queues.substr(queues.find(':') + 1), nullptr, 16);
  }
  return bytes;
}

Box::Box() {
  std::string pattern = (fs::temp_directory_path() / "slabd-line-XXXXXX").native();
  if (::mkdtemp(pattern.data()) == nullptr) throw std::runtime_error("no temporary folder");
  dir = pattern;
  config = dir / "slabd.toml";
  port = places::own_port();
  lcm_port = places::own_port();
  std::ofstream(config) << "[plc]\nlisten = \"127.0.0.1:" << port << "\"\n"
                        << "[robot]\nlcm_url = \"udpm://239.255.77." << lcm_port % 250 + 2 << ":" << lcm_port
                        << "?ttl=0\"\ninterface = \"lo\"\n"
                        << kPatientRobot << "[scanner]\ndrop_dir = \"" << (dir / "drop").native() << "\"\n"
                        << "[storage]\ndb = \"" << (dir / "slabd.db").native() << "\"\nspool_dir = \""
                        << (dir / "spool").native() << "\"\n"
                        << "[recipes]\ndir = \"" << places::source_dir() << "/recipes\"\n"
                        << "[cell]\nT_base_slab = [1800.0, 0.0, 300.0, 1.0, 0.0, 0.0, 0.0]\n"
                        << "[calibration]\nT_flange_scanner = [0.0, 80.0, 150.0, 1.0, 0.0, 0.0, 0.0]\n"
                        << "station_sigma_mm = 0.02\nstation_sigma_deg = 0.001\n"
                        << "[control]\nsocket = \"" << (dir / "control.sock").native() << "\"\n";
}

bool Box::logs(const std::string& text) const {
  return places::wait_until([&] { return log().find(text) != std::string::npos; });
}

Box::~Box() {
  if (late_ > 0) std::fprintf(stderr, "slabd gave no answer within 3 s, %d times\n", late_);
  EXPECT_LE(late_, 5) << "answers later than 3 s";
  daemon_.reset();
  std::error_code ignored;
  fs::remove_all(dir, ignored);
}

void Box::start(const std::vector<std::string>& more) {
  std::vector<std::string> command = launcher;
  command.insert(command.end(), {places::slabd(), "--config", config.native()});
  command.insert(command.end(), more.begin(), more.end());
  daemon_ = std::make_unique<Process>(command, dir / "slabd.out", dir / "slabd.err");
}

bool Box::ready() {
  while (running()) {
    if (answers(port)) return true;
    std::this_thread::sleep_for(std::chrono::milliseconds(20));
  }
  return false;
}

void Box::kill_hard() {
  daemon_->signal(SIGKILL);
  daemon_->wait();
}

int Box::stop() {
  daemon_->signal(SIGTERM);
  return daemon_->wait();
}

Box::Answer Box::slabctl(std::vector<std::string> args) const {
  const bool only_looks = !args.empty() && (args[0] == "status" || args[0] == "metrics" ||
                                            (args[0] == "plc" && args.size() > 1 && args[1] == "monitor"));
  args.insert(args.begin(), places::slabctl());
  Answer answer;
  const auto is_answered = [&] {
    answer = slabctl_once(args);
    const bool late =
        answer.err.find("within 3 s") != std::string::npos || answer.err.find("timed out") != std::string::npos;
    if (!only_looks || !late || daemon_ == nullptr || !daemon_->running()) return true;
    ++late_;
    return false;
  };
  static_cast<void>(places::wait_until(is_answered, std::chrono::minutes(2)));
  return answer;
}

Box::Answer Box::slabctl_once(const std::vector<std::string>& args) const {
  static int count = 0;
  const fs::path out = dir / ("slabctl-" + std::to_string(++count) + ".out");
  const fs::path err = dir / ("slabctl-" + std::to_string(count) + ".err");
  Process process(args, out, err);
  Answer answer;
  answer.exit_status = process.wait();
  answer.out = read_file(out);
  answer.err = read_file(err);
  return answer;
}

std::unique_ptr<Process> Box::simulate(std::vector<std::string> args) const {
  std::vector<std::string> command = {places::slabctl(), "simulate", "--config",
                                      config.native(),   "--points", "quarter"};
  command.insert(command.end(), args.begin(), args.end());
  return std::make_unique<Process>(command, dir / "simulate.out", dir / "simulate.err");
}

}  // namespace slabd::line
