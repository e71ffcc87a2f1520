// SPDX-License-Identifier: Apache-2.0
#include "hal/system/journal.h"

#include <gtest/gtest.h>
#include <sys/socket.h>
#include <sys/un.h>

#include <cstring>
#include <set>
#include <string>

#include "base/os.h"
#include "tests/hal/temporary_folder.h"

namespace slabd::hal {
namespace {

TEST(Journal, a_line_carries_its_code_and_a_message_id_of_its_own) {
  test::TemporaryFolder folder;
  const std::string path = folder / "journal";
  sockaddr_un address{};
  address.sun_family = AF_UNIX;
  std::memcpy(address.sun_path, path.c_str(), path.size());
  const Fd manager(socket(AF_UNIX, SOCK_DGRAM, 0));
  ASSERT_EQ(bind(manager.get(), reinterpret_cast<const sockaddr*>(&address), sizeof address), 0);
  const Journal journal(path.c_str());
  ASSERT_TRUE(journal.say(Priority::error, 502, "not written\nPRIORITY=7"));
  std::array<char, 2048> text{};
  const ssize_t n = recv(manager.get(), text.data(), text.size(), MSG_DONTWAIT);
  ASSERT_GT(n, 0);
  EXPECT_EQ(std::string(text.data(), static_cast<std::size_t>(n)),
            "PRIORITY=3\nSYSLOG_IDENTIFIER=slabd\nMESSAGE_ID=7d1b0f6a9c3e4e52b8a45ab1ec0d01f6\nSLABD_CODE=502\n"
            "MESSAGE=not written PRIORITY=7\n")
      << "a message must not be able to add fields";
  EXPECT_TRUE(journal.say(Priority::info, 0, std::string(5000, 'x'))) << "cut, not lost";
}

TEST(Journal, reports_an_absent_socket_to_the_caller) {
  test::TemporaryFolder folder;
  EXPECT_FALSE(Journal((folder / "nobody").c_str()).say(Priority::info, 0, "hello"));
  EXPECT_FALSE(Journal(std::string(300, 'x').c_str()).say(Priority::info, 0, "hello"));
}

TEST(Journal, every_code_has_an_id_of_32_hex_digits) {
  std::set<std::string> ids;
  for (std::uint16_t code = 0; code < 1000; ++code) {
    const std::string id(message_id(code).view());
    EXPECT_EQ(id.size(), 32U);
    EXPECT_EQ(id.find_first_not_of("0123456789abcdef"), std::string::npos);
    EXPECT_TRUE(ids.insert(id).second);
  }
}

}  // namespace
}  // namespace slabd::hal
