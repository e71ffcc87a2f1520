// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstdint>
#include <map>
#include <mutex>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "base/os.h"
#include "config/web_users.h"

/// Logins of the page: who is behind a cookie. Sessions are kept in memory only, so a restart of slabd-web ends them.
namespace slabd::web {

using SessionClock = std::chrono::steady_clock;

/// A session ends so long after its login.
inline constexpr std::chrono::hours kSessionLasts{12};
inline constexpr std::size_t kSessionsMax = 256;

struct Session {
  std::string user;
  config::WebRole role = config::WebRole::viewer;
  SessionClock::time_point ends;
  std::string hash;  ///< of the password at the login: a new password ends the session
};

/// Slows down guessing, for a name and for an address: five attempts at once, then one after 10 s, 20 s, 40 s, up to 15
/// minutes. A right password clears both. Not thread-safe.
class LoginThrottle {
 public:
  /// Time until `who` may try again; zero or less: now.
  [[nodiscard]] SessionClock::duration wait(const std::string& who, SessionClock::time_point now) const;
  void failed(const std::string& who, SessionClock::time_point now);
  void succeeded(const std::string& who) { attempts_.erase(who); }

 private:
  struct Attempts {
    int failures = 0;
    SessionClock::time_point next;
  };
  std::map<std::string, Attempts> attempts_;
};

/// Callable from any thread.
class Sessions {
 public:
  /// `users_file` empty: no user can log in.
  explicit Sessions(std::string users_file) : users_file_(std::move(users_file)) {}

  [[nodiscard]] bool are_possible() const { return !users_file_.empty(); }

  struct LoginResult {
    enum class End : std::uint8_t { logged_in, wrong, too_often, busy, no_users } end = End::wrong;
    std::string token;             ///< for the cookie, 64 hex digits
    Session session;               ///< if logged in
    std::chrono::seconds wait{0};  ///< if too often
    std::string trouble;           ///< if no_users: what is wrong with the file
  };
  /// Checks the password, one at a time: 0.1 s and 16 MB. A wrong name has the same end as a wrong password.
  [[nodiscard]] LoginResult log_in(const std::string& name, const std::string& password, const std::string& address,
                                   SessionClock::time_point now);
  /// The session of a token. A user who was removed has none, and a changed role counts at once.
  [[nodiscard]] std::optional<Session> find(std::string_view token, SessionClock::time_point now);
  void log_out(std::string_view token);

 private:
  void read_users();
  [[nodiscard]] const config::WebUser* user(const std::string& name) const;

  const std::string users_file_;
  std::mutex mutex_;
  std::mutex hashing_;
  FileState users_state_;
  std::vector<config::WebUser> users_;
  std::string trouble_;
  std::map<std::string, Session, std::less<>> sessions_;  ///< by token
  LoginThrottle throttle_;
  int waiting_ = 0;
};

/// The value of the cookie with this name in a field Cookie (RFC 6265); empty if it is not there.
[[nodiscard]] std::string_view cookie_in(std::string_view field, std::string_view name);

}  // namespace slabd::web
