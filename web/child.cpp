// SPDX-License-Identifier: Apache-2.0
#include "web/child.h"

#include <linux/ioprio.h>
#include <poll.h>
#include <sys/mman.h>
#include <sys/prctl.h>
#include <sys/resource.h>
#include <sys/syscall.h>
#include <sys/wait.h>

#include <array>
#include <cerrno>
#include <chrono>
#include <cmath>
#include <csignal>
#include <cstdlib>

#include "base/plain_text.h"

namespace slabd::web {
namespace {

using End = ChildResult::End;
using Clock = std::chrono::steady_clock;

constexpr int kNotExecuted = 127;
constexpr std::size_t kSentenceBytesMax = 500;
/// The inspection comes first; with 19, a busy computer would leave a document a hundredth of a core.
constexpr int kNice = 10;

/// All that the new process needs. After fork() in a program with threads only async-signal-safe calls are allowed, so
/// everything is prepared before.
struct Plan {
  std::vector<char*> arguments;
  std::vector<char*> environment;
  int input = -1;
  int output = -1;
  int errors = -1;
  rlim_t processor_s = 0;
  pid_t parent = 0;
};

std::vector<char*> pointers(std::vector<std::string>& words) {
  std::vector<char*> list;
  for (std::string& word : words) list.push_back(word.data());
  list.push_back(nullptr);
  return list;
}

void limit(__rlimit_resource resource, rlim_t most) {
  const rlimit both{most, most};
  ::setrlimit(resource, &both);
}

[[noreturn]] void become(const Plan& plan) {
  ::setpgid(0, 0);
  ::prctl(PR_SET_PDEATHSIG, SIGKILL);
  if (::getppid() != plan.parent) ::_exit(kNotExecuted);
  sigset_t none;
  ::sigemptyset(&none);
  ::sigprocmask(SIG_SETMASK, &none, nullptr);
  std::signal(SIGPIPE, SIG_DFL);
  if (::dup2(plan.input, STDIN_FILENO) < 0 || ::dup2(plan.output, STDOUT_FILENO) < 0 ||
      ::dup2(plan.errors, STDERR_FILENO) < 0)
    ::_exit(kNotExecuted);
  ::close_range(3, ~0U, CLOSE_RANGE_CLOEXEC);
  // SIGXCPU, and SIGKILL a second later: alone, SIGKILL says that the unit's memory was used up.
  const rlimit processor{plan.processor_s, plan.processor_s + 1};
  ::setrlimit(RLIMIT_CPU, &processor);
  limit(RLIMIT_FSIZE, kChildOutputBytesMax);
  limit(RLIMIT_CORE, 0);
  limit(RLIMIT_NOFILE, 64);
#if !defined(__SANITIZE_ADDRESS__) && !defined(__SANITIZE_THREAD__)
  limit(RLIMIT_AS, kChildAddressBytesMax);  // a sanitizer maps terabytes
#endif
  // The inspection comes first. SCHED_IDLE is left to the unit (CPUWeight=idle), because without a unit any busy
  // program would stop the page.
  ::setpriority(PRIO_PROCESS, 0, kNice);
  ::syscall(SYS_ioprio_set, IOPRIO_WHO_PROCESS, 0, IOPRIO_PRIO_VALUE(IOPRIO_CLASS_IDLE, 0));
  ::execve(plan.arguments[0], plan.arguments.data(), plan.environment.data());
  static constexpr std::string_view kText = "the program cannot be executed\n";
  static_cast<void>(write_all(STDERR_FILENO, kText.data(), kText.size()));
  ::_exit(kNotExecuted);
}

int left_ms(Clock::time_point end) {
  const auto left = std::chrono::duration_cast<std::chrono::milliseconds>(end - Clock::now()).count();
  return left > 0 ? static_cast<int>(left) : 0;
}

/// Waits for the end of the process; kills it at `end` and when `stop_fd` becomes readable. Returns its status as
/// waitpid() does, and sets `why` if it was killed here.
int wait_for(pid_t process, int stop_fd, Clock::time_point end, End& why) {
  const Fd handle(static_cast<int>(::syscall(SYS_pidfd_open, process, 0)));
  std::array<pollfd, 2> events{pollfd{handle.get(), POLLIN, 0}, pollfd{stop_fd, POLLIN, 0}};
  why = End::exited;
  for (;;) {
    const int ready = ::poll(events.data(), events.size(), left_ms(end));
    if (ready < 0 && errno == EINTR) continue;
    if (events[0].revents != 0) break;
    why = ready > 0 ? End::stopped : End::late;
    ::kill(-process, SIGKILL);
    ::kill(process, SIGKILL);  // before it has become the leader of its group
    break;
  }
  int status = 0;
  while (::waitpid(process, &status, 0) < 0 && errno == EINTR) {
  }
  return status;
}

/// The first line, for people.
std::string sentence_of(const Fd& errors) {
  std::string text(kSentenceBytesMax, '\0');
  const ssize_t bytes = ::pread(errors.get(), text.data(), text.size(), 0);
  text.resize(bytes > 0 ? static_cast<std::size_t>(bytes) : 0);
  text.resize(std::min(text.find('\n'), text.size()));
  if (constexpr std::string_view kName = "slabctl: "; text.starts_with(kName)) text.erase(0, kName.size());
  return plain(text);
}

ChildResult not_started(const char* what) {
  ChildResult result;
  result.sentence = std::string(what) + ": " + errno_text(errno);
  return result;
}

}  // namespace

ChildResult run_child(const ChildOrder& order) {
  const Clock::time_point end =
      Clock::now() + std::chrono::milliseconds(static_cast<std::int64_t>(1'000.0 * order.time_s));
  const Fd input(::open("/dev/null", O_RDONLY | O_CLOEXEC));
  Fd output(::memfd_create("slabctl-output", MFD_CLOEXEC));
  const Fd errors(::memfd_create("slabctl-errors", MFD_CLOEXEC));
  if (!input.is_open() || !output.is_open() || !errors.is_open()) return not_started("no file in memory");
  std::vector<std::string> words = {order.program};
  words.insert(words.end(), order.arguments.begin(), order.arguments.end());
  std::vector<std::string> environment = order.environment;
  const Plan plan{pointers(words), pointers(environment), input.get(),
                  output.get(),    errors.get(),          static_cast<rlim_t>(std::ceil(order.time_s)),
                  ::getpid()};
  const pid_t process = ::fork();
  if (process < 0) return not_started("no process");
  if (process == 0) become(plan);

  ChildResult result;
  const int status = wait_for(process, order.stop_fd, end, result.end);
  result.sentence = sentence_of(errors);
  if (WIFEXITED(status)) {
    // A process that ended by itself just before it was killed has done its work.
    result.end = WEXITSTATUS(status) == kNotExecuted ? End::not_started : End::exited;
    result.status = WEXITSTATUS(status);
  } else if (result.end == End::exited) {
    result.status = WTERMSIG(status);
    result.end = result.status == SIGXFSZ ? End::too_large : result.status == SIGXCPU ? End::late : End::crashed;
  }
  const FileState state = file_state(output.get(), "");
  result.bytes = static_cast<std::uint64_t>(state.bytes);
  result.output = std::move(output);
  return result;
}

}  // namespace slabd::web
