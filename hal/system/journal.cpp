// SPDX-License-Identifier: Apache-2.0
#include "hal/system/journal.h"

#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <unistd.h>

#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <cstring>

#include "base/os.h"
#include "hal/hal.h"

namespace slabd::hal {

FixedString<32> message_id(std::uint16_t code) {
  FixedString<32> id;
  id.printf("7d1b0f6a9c3e4e52b8a45ab1ec0d%04x", unsigned{code});
  return id;
}

bool stderr_is_journal() {
  const char* stream = std::getenv("JOURNAL_STREAM");
  struct stat there {};
  if (stream == nullptr || ::fstat(STDERR_FILENO, &there) != 0) return false;
  FixedString<64> ours;
  ours.printf("%ju:%ju", static_cast<std::uintmax_t>(there.st_dev), static_cast<std::uintmax_t>(there.st_ino));
  return ours.view() == stream;
}

Journal::Journal(const char* socket_path)
    : fd_(::socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0)), path_(socket_path) {}

bool Journal::say(Priority priority, std::uint16_t code, std::string_view message) const {
  if (!fd_.is_open() || path_.empty()) return false;
  FixedString<512> text;
  for (const char c : message)
    text.append(std::string_view(c == '\n' ? " " : &c, 1));  // a line end would end the field
  FixedString<900> datagram;
  datagram.printf("PRIORITY=%u\nSYSLOG_IDENTIFIER=slabd\nMESSAGE_ID=%s\nSLABD_CODE=%u\nMESSAGE=%s\n",
                  static_cast<unsigned>(priority), message_id(code).c_str(), unsigned{code}, text.c_str());
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  std::memcpy(address.sun_path, path_.c_str(), path_.size());
  const std::size_t size = offsetof(sockaddr_un, sun_path) + path_.size() + 1;
  const ssize_t sent =
      ::sendto(fd_.get(), datagram.c_str(), datagram.size(), MSG_NOSIGNAL,
               static_cast<const sockaddr*>(static_cast<const void*>(&address)), static_cast<socklen_t>(size));
  return sent == static_cast<ssize_t>(datagram.size());
}

namespace {

/// sd_notify(3), reimplemented because the original blocks while the service manager does not read, and this thread
/// answers the PLC. A message that finds no space is dropped. A service manager that misses the watchdog restarts
/// slabd; one that no longer reads does not.
class SystemdNotify final : public ServiceNotify {
 public:
  SystemdNotify() {
    const char* path = std::getenv("NOTIFY_SOCKET");
    if (path == nullptr || (path[0] != '/' && path[0] != '@')) return;
    const std::size_t length = std::strlen(path);
    if (length < 2 || length >= sizeof address_.sun_path) return;
    address_.sun_family = AF_UNIX;
    std::memcpy(address_.sun_path, path, length);
    if (path[0] == '@') address_.sun_path[0] = '\0';  // an abstract name, not a file
    address_bytes_ = static_cast<socklen_t>(offsetof(sockaddr_un, sun_path) + length);
    socket_ = Fd(::socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0));
  }

  void ready() override { is_told_ready_ = say("READY=1"); }
  void watchdog() override {
    if (!is_told_ready_) is_told_ready_ = say("READY=1");
    say("WATCHDOG=1");
  }
  void stopping() override { say("STOPPING=1"); }
  void status(std::string_view line) override {
    FixedString<512> message("STATUS=");
    // A newline would start another assignment of the protocol.
    message.append(line.substr(0, line.find('\n')));
    say(message.view());
  }

 private:
  /// Sends a message; false if the receiver had no space for it.
  bool say(std::string_view message) const {
    return !socket_.is_open() || ::sendto(socket_.get(), message.data(), message.size(), MSG_NOSIGNAL | MSG_DONTWAIT,
                                          reinterpret_cast<const sockaddr*>(&address_), address_bytes_) >= 0;
  }

  sockaddr_un address_{};
  socklen_t address_bytes_ = 0;
  Fd socket_;
  bool is_told_ready_ = true;  ///< true if READY=1 was sent or is not needed
};

}  // namespace

std::unique_ptr<ServiceNotify> make_systemd_notify() {
  return std::make_unique<SystemdNotify>();
}

}  // namespace slabd::hal
