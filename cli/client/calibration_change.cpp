// SPDX-License-Identifier: Apache-2.0
//
// A change is first written to a synced file and then sent to the daemon. After a crash either nothing has happened or
// the change is in the database. Repeating the command is safe: a record id is made from its numbers, and applying the
// calibration in force changes nothing.
#include "cli/client/calibration_change.h"

#include <pwd.h>
#include <sys/stat.h>
#include <unistd.h>

#include <chrono>
#include <cstdlib>
#include <nlohmann/json.hpp>
#include <thread>

#include "base/durable.h"
#include "cli/client/control.h"
#include "cli/terminal/say.h"
#include "daemon/control/calibration_changer.h"
#include "hal/hal.h"

namespace slabd::cli {
namespace {

using nlohmann::json;

constexpr auto kPollEvery = std::chrono::milliseconds(50);
constexpr int kPollsMax = 400;  ///< 20 s: longer than any sync that the daemon survives

/// Writes `text` durably to `folder` under a new name; returns the name.
Result<std::string> leave_file(const std::string& folder, const std::string& text) {
  if (::mkdir(folder.c_str(), 0770) == 0) static_cast<void>(::chmod(folder.c_str(), 02770));
  const std::string name = std::to_string(wall_clock_us()) + "-" + std::to_string(::getpid()) + ".json";
  const Status written = write_durably(folder + "/" + name, text, 0660);
  if (!written.ok()) return written.error();
  return name;
}

/// The daemon's "last_change" if it is that of `file` and done, otherwise null.
json outcome_of(const json& state, const std::string& file) {
  const json& last = state.value("last_change", json(nullptr));
  if (!last.is_object() || last.value("file", "") != file || !last.value("done", false)) return nullptr;
  return last;
}

Result<ChangeAnswer> through_daemon(const config::Config& config, const storage::CalibrationChange& change) {
  const Result<std::string> name =
      leave_file(daemon::change_folder(config.storage.db_path), daemon::change_json(change));
  if (!name.ok()) return name.error();
  const std::string path = daemon::change_folder(config.storage.db_path) + "/" + name.value();
  std::string line = json{{"verb", "calibration_change"}, {"file", name.value()}}.dump() + "\n";
  for (int poll = 0; poll < kPollsMax; ++poll) {
    const Result<std::string> answer = ask_daemon(config.control_socket, line);
    if (!answer.ok()) {
      ::unlink(path.c_str());
      return answer.error();
    }
    const json state = json::parse(answer.value(), nullptr, false);
    if (!state.is_object()) return said_error(Code::scanner_offline, say("slabd sent an answer that is not JSON"));
    if (state.contains("error")) {
      const std::string text = state.value("error", "");
      if (text.find("under way") == std::string::npos) {
        ::unlink(path.c_str());
        return said_error(Code::config, say("slabd refused: {}", quote(text)));
      }
    } else {
      line = "{\"verb\":\"calibration\"}\n";
    }
    if (const json last = outcome_of(state, name.value()); last.is_object()) {
      if (!last.value("ok", false)) {
        const int code = last.value("code", static_cast<int>(Code::internal));
        return error(static_cast<Code>(code), "%s", last.value("error", "").c_str());
      }
      const json& open = state.value("open_slab", json(nullptr));
      return ChangeAnswer{last.value("id", ""), true, open.is_object()};
    }
    std::this_thread::sleep_for(kPollEvery);
  }
  return said_error(
      Code::scanner_offline,
      say("slabd has taken the change and has not finished it within 20 s; slabctl calibrate history shows whether "
          "it was carried out"));
}

}  // namespace

Result<ChangeAnswer> change_calibration(const config::Config& config, const storage::CalibrationChange& change) {
  if (daemon_has_database(config.control_socket)) return through_daemon(config, change);
  // The daemon does not answer. If one runs without its socket or starts now, its lock prevents the access.
  Result<std::unique_ptr<storage::Store>> store = storage::open_store(config.storage);
  if (!store.ok()) return store.error();
  const Result<std::string> id = store.value()->change(change);
  if (!id.ok()) return id.error();
  return ChangeAnswer{id.value(), false, false};
}

void finish_killed_change(const config::Config& config) {
  if (storage::is_unfinished(config.storage.db_path) && !daemon_has_database(config.control_socket))
    (void)storage::open_store(config.storage);
}

std::string default_operator() {
  const passwd* user = ::getpwuid(::getuid());
  if (const char* login = std::getenv("SUDO_USER"); login != nullptr && *login != '\0') return login;
  return user != nullptr ? user->pw_name : std::to_string(::getuid());
}

std::int64_t wall_clock_us() {
  return hal::make_system_clock()->utime_us();
}

}  // namespace slabd::cli
