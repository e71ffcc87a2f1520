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

}  // namespace slabd::hal
