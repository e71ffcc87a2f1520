// SPDX-License-Identifier: Apache-2.0
//
// Input and output are files in memory, so the process needs neither a file system nor a pipe that could fill. Its
// environment is empty: OpenCASCADE reads file names from it. slabd-cad adds a filter of system calls (cad/sandbox).
#include "cli/cad/cad_process.h"

#include <fcntl.h>
#include <poll.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/syscall.h>
#include <sys/wait.h>

#include <array>
#include <cerrno>
#include <chrono>
#include <csignal>
#include <cstdlib>
#include <filesystem>

#include "base/plain_text.h"

namespace slabd::cli {
namespace {

using Clock = std::chrono::steady_clock;

constexpr int kNotExecuted = 127;
constexpr std::size_t kNoteBytesMax = 400;

void limit(__rlimit_resource resource, rlim_t most) {
  const rlimit both{most, most};
  ::setrlimit(resource, &both);
}

[[noreturn]] void become(char* const* arguments, int input, int output, int errors, pid_t parent) {
  ::setpgid(0, 0);
  ::prctl(PR_SET_PDEATHSIG, SIGKILL);
  if (::getppid() != parent) ::_exit(kNotExecuted);
  if (::dup2(input, STDIN_FILENO) < 0 || ::dup2(output, STDOUT_FILENO) < 0 || ::dup2(errors, STDERR_FILENO) < 0)
    ::_exit(kNotExecuted);
  ::close_range(3, ~0U, 0);
  limit(RLIMIT_CPU, kCadProcessor_s);
  limit(RLIMIT_FSIZE, kCadOutputBytesMax);
  limit(RLIMIT_CORE, 0);
  limit(RLIMIT_NOFILE, 32);
#if !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
  limit(RLIMIT_AS, kCadAddressBytesMax);  // a sanitizer maps terabytes
#endif
  ::setpriority(PRIO_PROCESS, 0, 10);  // the inspection comes first
  char* const environment[] = {nullptr};
  ::execve(arguments[0], arguments, environment);
  ::_exit(kNotExecuted);
}

/// Waits for the end of the process; kills it at `end` and then sets `late`. Returns its status as waitpid() does.
int wait_for(pid_t process, Clock::time_point end, bool& late) {
  const Fd handle(static_cast<int>(::syscall(SYS_pidfd_open, process, 0)));
  pollfd event{handle.get(), POLLIN, 0};
  for (;;) {
    const auto left = std::chrono::duration_cast<std::chrono::milliseconds>(end - Clock::now()).count();
    const int ready = ::poll(&event, 1, left > 0 ? static_cast<int>(left) : 0);
    if (ready < 0 && errno == EINTR) continue;
    if (ready > 0) break;
    late = true;
    ::kill(-process, SIGKILL);
    ::kill(process, SIGKILL);  // before it has become the leader of its group
    break;
  }
  int status = 0;
  while (::waitpid(process, &status, 0) < 0 && errno == EINTR) {
  }
  return status;
}

std::string content_of(const Fd& file, std::size_t bytes_max) {
  const off_t size = ::lseek(file.get(), 0, SEEK_END);
  std::string text(std::min(static_cast<std::size_t>(size > 0 ? size : 0), bytes_max), '\0');
  std::size_t done = 0;
  while (done < text.size()) {
    const ssize_t bytes = ::pread(file.get(), text.data() + done, text.size() - done, static_cast<off_t>(done));
    if (bytes < 0 && errno == EINTR) continue;
    if (bytes <= 0) break;
    done += static_cast<std::size_t>(bytes);
  }
  text.resize(done);
  return text;
}

std::string first_line(std::string text) {
  text.resize(std::min(text.find('\n'), text.size()));
  if (constexpr std::string_view kName = "slabd-cad: "; text.starts_with(kName)) text.erase(0, kName.size());
  return plain(text);
}

}  // namespace

Result<std::string> cad_program() {
  std::string path;
  if (const char* const named = std::getenv("SLABD_CAD"); named != nullptr && named[0] != '\0') {
    path = named;
  } else {
    std::error_code fault;
    path = (std::filesystem::read_symlink("/proc/self/exe", fault).parent_path() / "slabd-cad").string();
  }
  if (::access(path.c_str(), X_OK) != 0)
    return error(Code::scanner_offline,
                 "STEP and IGES need slabd-cad, which is not installed (%s): apt install slabd-cad", path.c_str());
  return path;
}

Result<CadAnswer> run_cad(const std::string& program, const std::vector<std::string>& arguments, std::string_view input,
                          const std::string& what) {
  const Clock::time_point end = Clock::now() + std::chrono::seconds(kCadClock_s);
  const Fd in(::memfd_create("cad-input", MFD_CLOEXEC));
  const Fd out(::memfd_create("cad-output", MFD_CLOEXEC));
  const Fd errors(::memfd_create("cad-errors", MFD_CLOEXEC));
  if (!in.is_open() || !out.is_open() || !errors.is_open() || !write_all(in.get(), input.data(), input.size()) ||
      ::lseek(in.get(), 0, SEEK_SET) != 0)
    return error(Code::internal, "no file in memory for slabd-cad: %s", errno_text(errno));
  std::vector<std::string> words = {program};
  words.insert(words.end(), arguments.begin(), arguments.end());
  std::vector<char*> pointers;
  for (std::string& word : words) pointers.push_back(word.data());
  pointers.push_back(nullptr);
  const pid_t parent = ::getpid();
  const pid_t process = ::fork();
  if (process < 0) return error(Code::internal, "slabd-cad cannot be started: %s", errno_text(errno));
  if (process == 0) become(pointers.data(), in.get(), out.get(), errors.get(), parent);

  bool late = false;
  const int status = wait_for(process, end, late);
  CadAnswer answer;
  answer.note = first_line(content_of(errors, kNoteBytesMax));
  const char* const name = what.c_str();
  if (WIFEXITED(status)) {
    const int code = WEXITSTATUS(status);
    if (code == kNotExecuted) return error(Code::internal, "%s cannot be executed", program.c_str());
    if (code != 0)
      return error(Code::config, "%s: %s", name,
                   answer.note.empty() ? "slabd-cad refused it without a reason" : answer.note.c_str());
    answer.output = content_of(out, kCadOutputBytesMax);
    return answer;
  }
  const int signal = WTERMSIG(status);
  if (late || signal == SIGXCPU || signal == SIGKILL)
    return error(Code::config,
                 "%s: slabd-cad was ended at its limit of %d s of processor time or %d s by the clock; "
                 "the file is damaged or too large",
                 name, kCadProcessor_s, kCadClock_s);
  if (signal == SIGXFSZ) return error(Code::config, "%s: the result is larger than 64 MB", name);
  return error(Code::config,
               "%s: cannot be read, it crashed slabd-cad (signal %d); the file is damaged or needs more "
               "than 1 GB of memory",
               name, signal);
}

Result<std::string> read_bounded(const std::string& path, std::uint64_t bytes_max) {
  const Fd file(::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NONBLOCK));
  if (!file.is_open()) return error(Code::config, "%s: %s", path.c_str(), errno_text(errno));
  std::string bytes;
  std::array<char, 65'536> piece{};
  for (;;) {
    const ssize_t count = ::read(file.get(), piece.data(), piece.size());
    if (count < 0) return error(Code::config, "%s: %s", path.c_str(), errno_text(errno));
    if (count == 0) return bytes;
    bytes.append(piece.data(), static_cast<std::size_t>(count));
    if (bytes.size() > bytes_max)
      return error(Code::config, "%s: larger than %llu MB", path.c_str(),
                   static_cast<unsigned long long>(bytes_max / 1'000'000));
  }
}

}  // namespace slabd::cli
