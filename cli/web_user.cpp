// SPDX-License-Identifier: Apache-2.0
//
// slabctl web user: accounts of the page. slabd-web takes a change up with the next request.
#include <fmt/core.h>
#include <termios.h>
#include <unistd.h>

#include <algorithm>
#include <iostream>
#include <memory>
#include <string>
#include <vector>

#include "cli/command.h"
#include "cli/exit.h"
#include "cli/terminal/arguments.h"
#include "cli/terminal/parse.h"
#include "config/web_users.h"

namespace slabd::cli {
namespace {

struct Options {
  std::string config;
  std::string name;
  std::string role = "viewer";
  bool from_stdin = false;
};

/// Terminal without echo until destruction.
class Silence {
 public:
  Silence() {
    is_terminal_ = ::tcgetattr(STDIN_FILENO, &before_) == 0;
    termios silent = before_;
    silent.c_lflag &= ~static_cast<tcflag_t>(ECHO);
    if (is_terminal_) ::tcsetattr(STDIN_FILENO, TCSAFLUSH, &silent);
  }
  ~Silence() {
    if (is_terminal_) ::tcsetattr(STDIN_FILENO, TCSAFLUSH, &before_);
  }
  Silence(const Silence&) = delete;
  Silence& operator=(const Silence&) = delete;

 private:
  termios before_{};
  bool is_terminal_ = false;
};

std::string asked(const char* question) {
  fmt::print(stderr, "{}", question);
  std::string line;
  {
    const Silence silence;
    std::getline(std::cin, line);
  }
  fmt::print(stderr, "\n");
  return line;
}

/// The new password: from the terminal twice, or the first line of the standard input.
std::string new_password(const Options& options) {
  std::string password;
  if (options.from_stdin) {
    std::getline(std::cin, password);
  } else if (::isatty(STDIN_FILENO) == 1) {
    password = asked("New password: ");
    if (asked("Once more: ") != password) stop(kUsage, "the two passwords differ; nothing was changed");
  } else {
    stop(kUsage, "no terminal to type a password in; --stdin takes it from the standard input");
  }
  if (const std::string fault = config::fault_of_password(password, options.name); !fault.empty())
    stop(kUsage, fault + "; nothing was changed");
  return password;
}

std::string users_file(const Options& options) {
  const config::Config config = config_from(options.config);
  if (config.web.users_file.empty())
    stop(kUsage, fmt::format("{}: [web] users_file is missing: it names the file of the accounts, such as "
                             "\"/etc/slabd/web_users\"",
                             options.config));
  return config.web.users_file;
}

/// The accounts; none if the file is not there yet.
std::vector<config::WebUser> users_in(const std::string& path) {
  if (::access(path.c_str(), F_OK) != 0) return {};
  return need(config::read_web_users(path));
}

config::WebUser* found(std::vector<config::WebUser>& users, const std::string& name) {
  const auto user = std::find_if(users.begin(), users.end(), [&](const auto& one) { return one.name == name; });
  return user == users.end() ? nullptr : &*user;
}

config::WebRole role_of(const Options& options) {
  return options.role == "quality" ? config::WebRole::quality : config::WebRole::viewer;
}

int add_user(const Options& options) {
  const std::string path = users_file(options);
  std::vector<config::WebUser> users = users_in(path);
  if (const std::string fault = config::fault_of_user_name(options.name); !fault.empty())
    stop(kUsage, fmt::format("\"{}\" {}", options.name, fault));
  if (found(users, options.name) != nullptr)
    stop(kUsage, fmt::format("{} has an account; slabctl web user password sets a new password, web user role another "
                             "role",
                             options.name));
  users.push_back({options.name, role_of(options), need(config::hash_of_password(new_password(options)))});
  if (const Status written = config::write_web_users(path, users); !written.ok()) stop(kNotReachable, written.error());
  fmt::print("{} may log in, role {}\n", options.name, options.role);
  return kDone;
}

/// Changes the account of a user that exists.
template <typename Change>
int change_user(const Options& options, const char* done, Change&& change) {
  const std::string path = users_file(options);
  std::vector<config::WebUser> users = users_in(path);
  config::WebUser* const user = found(users, options.name);
  if (user == nullptr) stop(kUsage, fmt::format("{} has no account; slabctl web user list shows them", options.name));
  change(users, *user);
  if (const Status written = config::write_web_users(path, users); !written.ok()) stop(kNotReachable, written.error());
  fmt::print("{}: {}\n", options.name, done);
  return kDone;
}

int list_users(const Options& options) {
  const std::vector<config::WebUser> users = users_in(users_file(options));
  for (const config::WebUser& user : users) fmt::print("{:<32} {}\n", user.name, config::name(user.role));
  if (users.empty()) fmt::print("no user can log in: slabctl web user add NAME --role quality\n");
  return kDone;
}

args::Command add_verb(args::Command& group, const char* name, const char* help, Options& options, bool of_one) {
  args::Command command = group.add_subcommand(name, help);
  if (of_one) command->add_option("NAME", options.name, "Name of the user: a-z, 0-9, \".\", \"_\", \"-\"")->required();
  command->add_option("--config", options.config, "Configuration with [web] users_file")->default_val(default_config());
  return command;
}

void add_role(args::Command& command, Options& options) {
  command->add_option("--role", options.role, "viewer: reads; quality: also decides about slabs and pins scans")
      ->check(args::one_of({"viewer", "quality"}));
}

void add_password(args::Command& command, Options& options) {
  command->add_flag("--stdin", options.from_stdin, "Take the password from the standard input, not from the terminal");
}

}  // namespace

void add_web(args::Command& app) {
  args::Command web = app.add_subcommand("web", "The page of slabd-web: who may log in");
  web->require_subcommand(1);
  args::Command users = web.add_subcommand("user", "Accounts of the page ([web] users_file)");
  users->require_subcommand(1);
  users->footer(
      "\nOnly a user with role quality decides about slabs and pins scans on the page. slabd-web takes a change up "
      "with\n"
      "the next request; a new password and a removed account end the sessions of the user.\n"
      "Example: slabctl web user add mei --role quality");

  auto adding = std::make_shared<Options>();
  args::Command add = add_verb(users, "add", "Add an account, with a password that is typed in", *adding, true);
  add_role(add, *adding);
  add_password(add, *adding);
  add->runs([adding] { return add_user(*adding); });

  auto setting = std::make_shared<Options>();
  args::Command password = add_verb(users, "password", "Set a new password", *setting, true);
  add_password(password, *setting);
  password->runs([setting] {
    return change_user(*setting, "the password is set", [&](auto&, config::WebUser& user) {
      user.hash = need(config::hash_of_password(new_password(*setting)));
    });
  });

  auto roles = std::make_shared<Options>();
  args::Command role = add_verb(users, "role", "Change the role", *roles, true);
  add_role(role, *roles);
  role->runs([roles] {
    return change_user(*roles, "the role is changed",
                       [&](auto&, config::WebUser& user) { user.role = role_of(*roles); });
  });

  auto removing = std::make_shared<Options>();
  args::Command remove = add_verb(users, "remove", "Remove an account", *removing, true);
  remove->runs([removing] {
    return change_user(*removing, "the account is removed", [&](std::vector<config::WebUser>& all, config::WebUser&) {
      std::erase_if(all, [&](const config::WebUser& one) { return one.name == removing->name; });
    });
  });

  auto listing = std::make_shared<Options>();
  args::Command list = add_verb(users, "list", "All accounts with their roles", *listing, false);
  list->runs([listing] { return list_users(*listing); });
}

}  // namespace slabd::cli
