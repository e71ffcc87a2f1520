// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "base/result.h"

/// Accounts of the page ([web] users_file): who may log in, and what for. One line for each, NAME:ROLE:HASH; "#" begins
/// a comment. The hash is yescrypt's (crypt(5)), so that a stolen file costs 16 MB and 0.1 s for each guess.
namespace slabd::config {

enum class WebRole : std::uint8_t {
  viewer,   ///< reads
  quality,  ///< reads, decides about slabs, pins scans
};
[[nodiscard]] std::string_view name(WebRole role);

struct WebUser {
  std::string name;
  WebRole role = WebRole::viewer;
  std::string hash;
};

inline constexpr std::size_t kPasswordBytesMin = 10;
inline constexpr std::size_t kPasswordBytesMax = 128;

/// Fault of a name or a password; empty if it has none.
[[nodiscard]] std::string fault_of_user_name(std::string_view name);
[[nodiscard]] std::string fault_of_password(std::string_view password, std::string_view user_name);

/// Reads the file. config: the text contains path:line, the fault and what is allowed.
[[nodiscard]] Result<std::vector<WebUser>> read_web_users(const std::string& path);
/// Replaces the file. An existing one keeps owner, group and mode; a new one is for its owner and group (0640), which
/// is that of slabd-web if it exists and the caller is root.
[[nodiscard]] Status write_web_users(const std::string& path, const std::vector<WebUser>& users);

/// Hash of a password, with a new salt. internal: the system has no random numbers. 0.1 s, 16 MB.
[[nodiscard]] Result<std::string> hash_of_password(std::string_view password);
/// True if it is the user's password. nullptr, an unknown user, takes as long and is false, so that the time does not
/// tell which names exist. 0.1 s, 16 MB.
[[nodiscard]] bool is_password(const WebUser* user, std::string_view password);

}  // namespace slabd::config
