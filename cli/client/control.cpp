// SPDX-License-Identifier: Apache-2.0
#include "cli/client/control.h"

#include <cerrno>
#include <cstring>
#include <nlohmann/json.hpp>

#include "cli/terminal/say.h"
#include "hal/system/control_client.h"

namespace slabd::cli {
namespace {

using hal::ControlAnswer;

constexpr int kAnswerTimeout_ms = 3'000;

std::string cause_of(const ControlAnswer& answer) {
  switch (answer.fault) {
    case ControlAnswer::Fault::not_accepted: return say("it listens, but takes no question within 3 s");
    case ControlAnswer::Fault::silent: return say("connected, but no answer within 3 s");
    case ControlAnswer::Fault::closed: return say("it closed the connection");
    case ControlAnswer::Fault::too_long: return say("the answer is longer than 64 kB");
    case ControlAnswer::Fault::none:
    case ControlAnswer::Fault::system: break;
  }
  return quote(std::strerror(answer.error_number));
}

}  // namespace

std::int64_t daemon_process(const std::string& path) {
  std::int64_t process = 0;
  static_cast<void>(hal::try_control(path, kAnswerTimeout_ms, &process));
  return process;
}

Result<std::string> ask_daemon(const std::string& path, std::string_view line) {
  ControlAnswer answer = hal::ask_control(path, line, kAnswerTimeout_ms);
  if (answer.ok()) return std::move(answer.line);
  return said_error(
      Code::scanner_offline,
      say("slabd does not answer on {}: {}; is it running (systemctl status slabd), and are you in its group?", path,
          cause_of(answer)));
}

bool daemon_has_database(const std::string& path) {
  const int fault = hal::try_control(path, kAnswerTimeout_ms, nullptr);
  if (fault == EAGAIN || fault == EACCES) return true;
  if (fault != 0) return false;
  const Result<std::string> answer = ask_daemon(path, "{\"verb\":\"status\"}\n");
  if (!answer) return true;
  const nlohmann::json status = nlohmann::json::parse(answer.value(), nullptr, false);
  const nlohmann::json fault_now = status.is_object() ? status.value("fault", nlohmann::json()) : nlohmann::json();
  return !fault_now.is_object() || fault_now.value("code", nlohmann::json()) != static_cast<int>(Code::config);
}

}  // namespace slabd::cli
