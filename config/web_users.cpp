// SPDX-License-Identifier: Apache-2.0
#include "config/web_users.h"

#include <crypt.h>
#include <fmt/format.h>
#include <grp.h>
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <fstream>
#include <memory>
#include <optional>

#include "base/durable.h"
#include "base/plain_text.h"

namespace slabd::config {
namespace {

constexpr std::string_view kMethod = "$y$";
constexpr std::size_t kUsersMax = 200;
constexpr std::size_t kLineBytesMax = 1'024;
constexpr std::array kRoles = {WebRole::viewer, WebRole::quality};
constexpr mode_t kModeOfNew = 0640;
constexpr const char* kGroup = "slabd-web";

std::optional<WebRole> role_named(std::string_view word) {
  const auto found = std::find_if(kRoles.begin(), kRoles.end(), [&](WebRole role) { return name(role) == word; });
  return found == kRoles.end() ? std::nullopt : std::optional(*found);
}

/// Hash with the method and salt of `setting`; empty on a fault. crypt_r needs 32 kB, so the data is not on the stack.
std::string crypted(std::string_view password, const char* setting) {
  const auto data = std::make_unique<crypt_data>();
  const char* const hash = ::crypt_r(std::string(password).c_str(), setting, data.get());
  return hash == nullptr || *hash == '*' ? "" : hash;
}

bool is_equal(std::string_view a, std::string_view b) {
  if (a.size() != b.size()) return false;
  unsigned differences = 0;
  for (std::size_t i = 0; i < a.size(); ++i) differences |= static_cast<unsigned>(a[i] ^ b[i]);
  return differences == 0;
}

std::string fault_of_line(std::string_view line, const std::vector<WebUser>& before, WebUser& user) {
  const std::size_t first = line.find(':');
  const std::size_t second = first == std::string_view::npos ? first : line.find(':', first + 1);
  if (second == std::string_view::npos) return "has not the form NAME:ROLE:HASH";
  user.name = line.substr(0, first);
  if (std::string fault = fault_of_user_name(user.name); !fault.empty()) return fault;
  if (std::any_of(before.begin(), before.end(), [&](const WebUser& other) { return other.name == user.name; }))
    return "names \"" + user.name + "\" a second time";
  const std::optional<WebRole> role = role_named(line.substr(first + 1, second - first - 1));
  if (!role) return "has another role than viewer or quality";
  user.role = *role;
  user.hash = line.substr(second + 1);
  if (!user.hash.starts_with(kMethod) || ::crypt_checksalt(user.hash.c_str()) != CRYPT_SALT_OK)
    return "has no yescrypt hash ($y$...); set the password again";
  return "";
}

}  // namespace

std::string_view name(WebRole role) {
  return role == WebRole::quality ? "quality" : "viewer";
}

std::string fault_of_user_name(std::string_view name) {
  constexpr std::string_view kAllowed = "abcdefghijklmnopqrstuvwxyz0123456789._-";
  const bool fits = !name.empty() && name.size() <= 32 && name.find_first_not_of(kAllowed) == std::string_view::npos;
  return fits ? "" : "has another name than 1 to 32 of a-z, 0-9, \".\", \"_\" and \"-\"";
}

std::string fault_of_password(std::string_view password, std::string_view user_name) {
  if (password.size() < kPasswordBytesMin || password.size() > kPasswordBytesMax)
    return fmt::format("the password has {} bytes, allowed are {} to {}", password.size(), kPasswordBytesMin,
                       kPasswordBytesMax);
  if (!is_plain(password)) return "the password contains a control character, or is not UTF-8";
  if (password.find(user_name) != std::string_view::npos) return "the password contains the name";
  return "";
}

Result<std::vector<WebUser>> read_web_users(const std::string& path) {
  std::ifstream in(path);
  if (!in) return error(Code::config, "%s cannot be read: %s", path.c_str(), errno_text(errno));
  std::vector<WebUser> users;
  std::string line;
  for (int number = 1; std::getline(in, line); ++number) {
    if (line.empty() || line.front() == '#') continue;
    WebUser user;
    std::string fault = line.size() > kLineBytesMax ? "is longer than 1024 bytes" : fault_of_line(line, users, user);
    if (fault.empty() && users.size() == kUsersMax) fault = "is one user more than the 200 that are allowed";
    if (!fault.empty()) return error(Code::config, "%s:%d: this line %s", path.c_str(), number, fault.c_str());
    users.push_back(std::move(user));
  }
  return users;
}

Status write_web_users(const std::string& path, const std::vector<WebUser>& users) {
  struct stat before {};
  const bool is_there = ::stat(path.c_str(), &before) == 0;
  std::string text = "# Accounts of the page of slabd: NAME:ROLE:HASH. Made by slabctl web user.\n";
  for (const WebUser& user : users) text += user.name + ':' + std::string(name(user.role)) + ':' + user.hash + '\n';
  const mode_t mode = is_there ? before.st_mode & 07777 : kModeOfNew;
  if (Status status = write_durably(path, text, mode); !status.ok()) return status;
  if (::geteuid() != 0) return success();
  const group* const reader = is_there ? nullptr : ::getgrnam(kGroup);
  const uid_t owner = is_there ? before.st_uid : 0;
  const gid_t members = is_there ? before.st_gid : reader != nullptr ? reader->gr_gid : 0;
  if (::chown(path.c_str(), owner, members) != 0)
    return error(Code::config, "%s: its owner cannot be set: %s", path.c_str(), errno_text(errno));
  return success();
}

Result<std::string> hash_of_password(std::string_view password) {
  std::array<char, CRYPT_GENSALT_OUTPUT_SIZE> setting{};
  if (::crypt_gensalt_rn(kMethod.data(), 0, nullptr, 0, setting.data(), static_cast<int>(setting.size())) == nullptr)
    return error(Code::internal, "no salt for a password can be made: %s", errno_text(errno));
  std::string hash = crypted(password, setting.data());
  if (hash.empty()) return error(Code::internal, "the password cannot be hashed: %s", errno_text(errno));
  return hash;
}

bool is_password(const WebUser* user, std::string_view password) {
  // The cost of a hash is in its setting; this one has the cost of new passwords.
  constexpr const char* kNobody = "$y$j9T$6nSVAi94.8rItVu0amUah0";
  const std::string hash = crypted(password, user == nullptr ? kNobody : user->hash.c_str());
  return user != nullptr && !hash.empty() && is_equal(hash, user->hash);
}

}  // namespace slabd::config
