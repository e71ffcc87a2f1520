// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <sys/stat.h>
#include <sys/types.h>

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "base/fields.h"
#include "base/recipe.h"
#include "config/config.h"

/// slabctl doctor: is everything the line needs in place, from the configuration file to the pose of the robot? In the
/// order in which a line is put together, so that the first thing that is wrong is the first one to mend.
namespace slabd::cli {

enum class Health : std::uint8_t {
  ok,
  note,     ///< right as it is, but worth knowing
  warning,  ///< the line works, with less than it could have
  failed,   ///< the line does not work like this
  unknown   ///< could not be looked at, and why
};

struct Finding {
  std::string check;  ///< what was looked at: "disk", "plc heartbeat"
  Health health = Health::ok;
  std::string saw;
  std::string cure;  ///< what to do; empty when all is well
};
SLABD_FIELDS(Finding, check, health, saw, cure);

/// Collects findings and says each at once.
class Examination {
 public:
  explicit Examination(bool quiet) : quiet_(quiet) {}

  void ok(std::string_view check, std::string saw) { add({std::string(check), Health::ok, std::move(saw), {}}); }
  void note(std::string_view check, std::string saw, std::string cure = {}) {
    add({std::string(check), Health::note, std::move(saw), std::move(cure)});
  }
  void warning(std::string_view check, std::string saw, std::string cure) {
    add({std::string(check), Health::warning, std::move(saw), std::move(cure)});
  }
  void failed(std::string_view check, std::string saw, std::string cure) {
    add({std::string(check), Health::failed, std::move(saw), std::move(cure)});
  }
  void unknown(std::string_view check, std::string why, std::string cure = {}) {
    add({std::string(check), Health::unknown, std::move(why), std::move(cure)});
  }
  [[nodiscard]] const std::vector<Finding>& findings() const { return findings_; }
  [[nodiscard]] bool any(Health health) const;

 private:
  void add(Finding finding);

  bool quiet_;
  std::vector<Finding> findings_;
};

/// Who the daemon runs as: its own user where there is one, else who asks.
struct Account {
  std::string name;
  uid_t uid = 0;
  std::vector<gid_t> groups;
};
inline constexpr const char* kDaemonUser = "slabd";
[[nodiscard]] Account daemon_account();
/// Whether a file's mode lets the account have `want`: 4 read, 2 write, 1 execute or enter. Root may all.
[[nodiscard]] bool may(const Account& account, const struct stat& file, unsigned want);

/// "ok", "note", "warning", "failed", "unknown".
[[nodiscard]] std::string_view name(Health health);

// ---- doctor_files.cpp: what lies on the disk ---------------------------------------------------------------------

/// Configuration and recipes. False when there is no configuration to go on with; `config` then names a control socket
/// all the same, the one slabd takes from it.
[[nodiscard]] bool examine_files(const std::string& config_path, daemon::Config& config, std::vector<Recipe>& recipes,
                                 Examination& report);
/// Folders, who may write to them, free space, and how fast a scan and a commit become durable (writes 64 MB and
/// deletes them).
void examine_disk(const daemon::Config& config, Examination& report);

// ---- doctor_machine.cpp: the computer ----------------------------------------------------------------------------

void examine_machine(const daemon::Config& config, Examination& report);
void examine_clock(Examination& report);
/// What the kernel lets the running daemon have: file sizes, open files, memory.
void examine_limits(const daemon::Config& config, Examination& report);
/// The program of this computer that sends UDP from `port`, "name (pid 12)"; empty where the kernel tells none: another
/// computer's, or another user's.
[[nodiscard]] std::string udp_program(unsigned port);

// ---- doctor_routes.cpp: the way to PLC and robot -----------------------------------------------------------------

void examine_routes(const daemon::Config& config, Examination& report);

// ---- doctor_links.cpp: the daemon and who it talks to ------------------------------------------------------------

/// Asks the daemon; returns its status (slabd.status/1), empty when it does not run.
[[nodiscard]] std::string examine_daemon(const daemon::Config& config, Examination& report);
void examine_plc(const daemon::Config& config, bool daemon_runs, Examination& report);
/// Listens for `seconds`.
void examine_robot(const daemon::Config& config, double seconds, Examination& report);
/// `scan`: has one taken, through the daemon's maintenance state.
void examine_scanner(const daemon::Config& config, const std::string& status, bool scan, Examination& report);
void examine_calibration(const daemon::Config& config, const std::string& status, Examination& report);

}  // namespace slabd::cli
