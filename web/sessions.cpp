// SPDX-License-Identifier: Apache-2.0
#include "web/sessions.h"

#include <sys/random.h>

#include <algorithm>
#include <array>

#include "base/hex.h"

namespace slabd::web {
namespace {

constexpr int kFreeAttempts = 5;
constexpr std::chrono::seconds kFirstWait{10};
constexpr std::chrono::seconds kLongestWait{900};
/// Names and addresses that are remembered. Those whose waiting is over are forgotten first.
constexpr std::size_t kRememberedMax = 4'096;
/// Logins that wait for another's password to be hashed.
constexpr int kWaitingMax = 4;

/// 256 random bits; empty if the system has none.
std::string new_token() {
  std::array<std::uint8_t, 32> bytes{};
  if (::getrandom(bytes.data(), bytes.size(), 0) != static_cast<ssize_t>(bytes.size())) return "";
  return hex(bytes);
}

}  // namespace

SessionClock::duration LoginThrottle::wait(const std::string& who, SessionClock::time_point now) const {
  const auto found = attempts_.find(who);
  return found == attempts_.end() ? SessionClock::duration::zero() : found->second.next - now;
}

void LoginThrottle::failed(const std::string& who, SessionClock::time_point now) {
  if (attempts_.size() >= kRememberedMax && !attempts_.contains(who)) {
    std::erase_if(attempts_, [&](const auto& one) { return one.second.next + kLongestWait < now; });
    if (attempts_.size() >= kRememberedMax) attempts_.erase(attempts_.begin());
  }
  Attempts& attempts = attempts_[who];
  ++attempts.failures;
  attempts.next = now;
  if (attempts.failures < kFreeAttempts) return;
  const int doublings = std::min(attempts.failures - kFreeAttempts, 10);
  attempts.next += std::min(kFirstWait * (1 << doublings), kLongestWait);
}

const config::WebUser* Sessions::user(const std::string& name) const {
  const auto found = std::find_if(users_.begin(), users_.end(), [&](const auto& one) { return one.name == name; });
  return found == users_.end() ? nullptr : &*found;
}

/// Reads the file again if it has changed. While it cannot be read, no user has an account.
void Sessions::read_users() {
  // The open file, because the path may be a link.
  const Fd file(::open(users_file_.c_str(), O_RDONLY | O_CLOEXEC));
  const FileState now = file_state(file.get(), "");
  if (now.known && now.same_content(users_state_) && trouble_.empty()) return;
  users_state_ = now;
  trouble_.clear();
  users_.clear();
  Result<std::vector<config::WebUser>> read = config::read_web_users(users_file_);
  if (read.ok())
    users_ = std::move(read.value());
  else
    trouble_ = read.error().text.view();
}

Sessions::LoginResult Sessions::log_in(const std::string& name, const std::string& password, const std::string& address,
                                       SessionClock::time_point now) {
  using End = LoginResult::End;
  LoginResult result;
  const std::string of_name = "name " + name;
  const std::string of_address = "address " + address;
  std::optional<config::WebUser> known;
  {
    const std::lock_guard lock(mutex_);
    const auto wait = std::max(throttle_.wait(of_name, now), throttle_.wait(of_address, now));
    if (wait > SessionClock::duration::zero()) {
      result.end = End::too_often;
      result.wait = std::chrono::ceil<std::chrono::seconds>(wait);
      return result;
    }
    read_users();
    if (!trouble_.empty()) {
      result.end = End::no_users;
      result.trouble = trouble_;
      return result;
    }
    if (waiting_ >= kWaitingMax) {
      result.end = End::busy;
      return result;
    }
    ++waiting_;
    if (const config::WebUser* const found = user(name); found != nullptr) known = *found;
    // Counted before the password is checked, so that attempts at the same time are counted too.
    throttle_.failed(of_name, now);
    throttle_.failed(of_address, now);
  }
  bool is_right = false;
  {
    const std::lock_guard one_at_a_time(hashing_);
    is_right = config::is_password(known ? &*known : nullptr, password);
  }
  const std::lock_guard lock(mutex_);
  --waiting_;
  if (!is_right) return result;
  throttle_.succeeded(of_name);
  throttle_.succeeded(of_address);
  std::erase_if(sessions_, [&](const auto& one) { return one.second.ends <= now; });
  result.token = new_token();
  if (result.token.empty() || sessions_.size() >= kSessionsMax) {
    result.end = End::busy;
    return result;
  }
  result.end = End::logged_in;
  result.session = {name, known->role, now + kSessionLasts, known->hash};
  sessions_.emplace(result.token, result.session);
  return result;
}

std::optional<Session> Sessions::find(std::string_view token, SessionClock::time_point now) {
  if (token.empty() || !are_possible()) return std::nullopt;
  const std::lock_guard lock(mutex_);
  const auto found = sessions_.find(token);
  if (found == sessions_.end()) return std::nullopt;
  read_users();
  const config::WebUser* const known = user(found->second.user);
  if (!trouble_.empty() && found->second.ends > now) return std::nullopt;  // the file cannot be read at the moment
  if (found->second.ends <= now || known == nullptr || known->hash != found->second.hash) {
    sessions_.erase(found);
    return std::nullopt;
  }
  found->second.role = known->role;
  return found->second;
}

void Sessions::log_out(std::string_view token) {
  const std::lock_guard lock(mutex_);
  if (const auto found = sessions_.find(token); found != sessions_.end()) sessions_.erase(found);
}

std::string_view cookie_in(std::string_view field, std::string_view name) {
  while (!field.empty()) {
    std::string_view pair = field.substr(0, field.find(';'));
    field.remove_prefix(std::min(field.size(), pair.size() + 1));
    while (pair.starts_with(' ')) pair.remove_prefix(1);
    const std::size_t equals = pair.find('=');
    if (equals != std::string_view::npos && pair.substr(0, equals) == name) return pair.substr(equals + 1);
  }
  return {};
}

}  // namespace slabd::web
