// SPDX-License-Identifier: Apache-2.0
//
// Which session a command means when nobody says: the one this person worked on last, else the only one there is; of
// one line only, where a configuration is named. Every command says which it took. The note of the last one is a
// convenience; without it (no home folder) everything works with --session.
#include <fmt/core.h>
#include <pwd.h>
#include <unistd.h>

#include <cstdlib>
#include <filesystem>

#include "cli/calibrate/calibrate.h"
#include "cli/calibrate/session.h"
#include "cli/command.h"
#include "cli/exit.h"
#include "cli/terminal/arguments.h"

namespace slabd::cli {
namespace {

namespace fs = std::filesystem;

/// Empty: nowhere to keep it.
std::string note_path() {
  if (const char* state = std::getenv("XDG_STATE_HOME"); state != nullptr && *state == '/')
    return std::string(state) + "/slabd/calibration-session";
  const char* home = std::getenv("HOME");
  if (home == nullptr || *home != '/') {
    const passwd* user = ::getpwuid(::getuid());
    home = user == nullptr ? nullptr : user->pw_dir;
  }
  return home == nullptr || *home != '/' ? "" : std::string(home) + "/.local/state/slabd/calibration-session";
}

bool is_session(const std::string& dir) {
  std::error_code fault;
  return fs::exists(dir + "/session.txt", fault);
}

std::string last_session() {
  const std::string path = note_path();
  if (path.empty()) return "";
  const Result<std::string> text = text_file(path);
  if (!text.ok()) return "";
  const std::string dir = text.value().substr(0, text.value().find('\n'));
  return is_session(dir) ? dir : "";
}

std::vector<std::string> sessions_in(const std::string& folder) {
  std::vector<std::string> found;
  std::error_code fault;
  for (fs::directory_iterator it(folder, fault), end; !fault && it != end; it.increment(fault))
    if (is_session(it->path().string())) found.push_back(it->path().string());
  std::sort(found.begin(), found.end());
  return found;
}

constexpr const char* kHowToBegin =
    "begin one with: slabctl calibrate new NAME --kind ball --radius MM (slabctl calibrate new --help explains)";

/// The configuration of the other line that a session was begun with, empty when it may be meant. Who names a
/// configuration means that line: a session of another one must not be solved, let alone applied, for it. One that was
/// begun without a configuration belongs to none.
std::string other_line(const std::string& dir, const std::string& config) {
  if (config.empty()) return "";
  const Result<Session> session = Session::open(dir);
  if (!session.ok()) return "";  // complained of when it is opened
  const std::string& begun_with = session.value().settings().config;
  std::error_code fault;
  return begun_with.empty() || fs::equivalent(begun_with, config, fault) ? "" : begun_with;
}

/// Lines may keep their sessions in one folder. `others` says in words which are left out, and why.
std::vector<std::string> sessions_of_line(const std::string& folder, const std::string& config, std::string& others) {
  std::vector<std::string> found;
  for (const std::string& dir : sessions_in(folder)) {
    const std::string other = other_line(dir, config);
    if (other.empty())
      found.push_back(dir);
    else
      others += fmt::format("{}{} is one of {}", others.empty() ? "" : ", ", fs::path(dir).filename().string(), other);
  }
  return found;
}

std::string which_session(const SessionOptions& options) {
  if (!options.session.empty()) {
    const Result<std::string> dir = session_dir(options.session, options.config);
    if (dir.ok()) return dir.value();
    // A configuration that cannot be used is bad input; without one a bare name says nothing.
    std::error_code fault;
    const bool has_config = !options.config.empty() || fs::exists(kDefaultConfig, fault);
    stop(has_config ? kBadInput : kUsage, dir.error().text.view());
  }
  if (std::string last = last_session(); !last.empty() && other_line(last, options.config).empty()) return last;
  std::optional<daemon::Config> config;
  if (!config_if_any(options.config, config)) stop(kBadInput);
  std::string others;
  const std::vector<std::string> found =
      config ? sessions_of_line(config->sessions_dir, options.config, others) : std::vector<std::string>{};
  if (found.size() == 1) return found.front();
  if (found.empty() && !others.empty())
    stop(kBadInput,
         fmt::format("there is no calibration session of {} yet in {} ({}; --session NAME takes one all the same); {}",
                     options.config, config->sessions_dir, others, kHowToBegin));
  if (found.empty())
    stop(kBadInput, fmt::format("there is no calibration session yet{}; {}",
                                config ? " in " + config->sessions_dir : std::string(), kHowToBegin));
  std::string names;
  for (const std::string& dir : found) names += (names.empty() ? "" : ", ") + fs::path(dir).filename().string();
  stop(kBadInput, fmt::format("there are several calibration sessions ({}); say which with --session NAME", names));
}

}  // namespace

void SessionOptions::add_to(args::Command& command) {
  command.add_option(
      "--session", session,
      "Name or folder (default: the one you worked on last, else the only one there is; with --config, of that line)");
  command.add_option("--config", config, fmt::format("The daemon's configuration (default: {})", kDefaultConfig));
}

bool config_if_any(const std::string& path, std::optional<daemon::Config>& config) {
  const std::string file = path.empty() ? kDefaultConfig : path;
  std::error_code fault;
  if (path.empty() && !fs::exists(file, fault)) return true;
  daemon::Config read;
  if (!config_from(file, read)) return false;
  config = std::move(read);
  return true;
}

Result<std::string> session_dir(const std::string& name, const std::string& config_path) {
  if (name.find('/') != std::string::npos || name == "." || name == "..") return fs::absolute(name).string();
  std::optional<daemon::Config> config;
  if (!config_if_any(config_path, config))
    return error(Code::config, "the configuration says where sessions lie, and cannot be used; give a folder: ./%s",
                 name.c_str());
  if (config) return config->sessions_dir + "/" + name;
  return error(Code::config,
               "'%s' is a bare name, and without a configuration (%s, or --config FILE) there is no place for it; "
               "give a folder: ./%s",
               name.c_str(), kDefaultConfig, name.c_str());
}

Session find_session(const SessionOptions& options) {
  Session session = need(Session::open(which_session(options)), kBadInput);
  remember_session(session.dir());
  return session;
}

void remember_session(const std::string& dir) {
  const std::string path = note_path();
  if (path.empty() || last_session() == dir) return;
  std::error_code fault;
  fs::create_directories(fs::path(path).parent_path(), fault);
  // Failing to remember is no reason to fail.
  if (!fault) static_cast<void>(write_durably(path, dir + "\n"));
}

}  // namespace slabd::cli
