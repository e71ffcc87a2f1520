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

/// slabctl doctor: checks everything that the line requires, from the configuration file to the robot's pose. The
/// order is that of the assembly of a line, so that the first fault is the first one to repair.
namespace slabd::cli {

enum class Health : std::uint8_t {
  ok,
  note,     ///< correct, with additional information
  warning,  ///< the line works with reduced performance or safety
  failed,   ///< the line does not work
  unknown   ///< could not be checked; the text contains the reason
};

struct Finding {
  std::string check;  ///< checked item: "disk", "plc heartbeat"
  Health health = Health::ok;
  std::string saw;
  std::string cure;  ///< cure; empty if ok
};
SLABD_FIELDS(Finding, check, health, saw, cure);

/// Collects findings and prints each one at once.
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
  /// Robot or scanner of the findings from now on, which precedes what they state; empty: none is named.
  void set_subject(std::string subject) { subject_ = std::move(subject); }
  [[nodiscard]] const std::vector<Finding>& findings() const { return findings_; }
  [[nodiscard]] bool any(Health health) const;

 private:
  void add(Finding finding);

  bool quiet_;
  std::string subject_;
  std::vector<Finding> findings_;
};

/// User of the daemon: its own account if it exists, otherwise the current user.
struct DaemonUser {
  std::string name;
  uid_t uid = 0;
  std::vector<gid_t> groups;
};
inline constexpr const char* kDaemonUser = "slabd";
[[nodiscard]] DaemonUser daemon_user();
/// True if a file's mode gives the account the access `want`: 4 read, 2 write, 1 execute or enter. Root has every
/// access.
[[nodiscard]] bool may(const DaemonUser& account, const struct stat& file, unsigned want);

/// "ok", "note", "warning", "failed", "unknown".
[[nodiscard]] std::string_view name(Health health);

// ---- doctor_files.cpp: files and folders -------------------------------------------------------------------------

/// Checks configuration and recipes. False without a usable configuration; `config` then still contains the
/// control socket that slabd takes from it.
[[nodiscard]] bool examine_files(const std::string& config_path, config::Config& config, std::vector<Recipe>& recipes,
                                 Examination& report);
/// Checks folders, write permissions and free space. `with_speed`: also the time until a scan and a commit are durable
/// (writes 64 MB and deletes them).
void examine_disk(const config::Config& config, bool with_speed, Examination& report);

// ---- doctor_machine.cpp: the computer ----------------------------------------------------------------------------

void examine_machine(const config::Config& config, Examination& report);
void examine_clock(Examination& report);
/// Checks the kernel's limits of the running daemon: file sizes, open files, memory.
void examine_limits(const config::Config& config, Examination& report);
/// The local program that sends UDP from `port`, "name (pid 12)"; empty if unknown: on another computer, or of another
/// user.
[[nodiscard]] std::string udp_program(unsigned port);

// ---- doctor_routes.cpp: routes to PLC and robot ------------------------------------------------------------------

void examine_routes(const config::Config& config, Examination& report);

// ---- doctor_camera.cpp: a GigE Vision camera ----------------------------------------------------------------------

/// Checks packet size and socket buffers for the camera of [genicam], and that the accepted camera is the one that was
/// verified. Reports nothing without a camera.
void examine_camera(const config::Config& config, Examination& report);

// ---- doctor_plc.cpp ----------------------------------------------------------------------------------------------

void examine_plc(const config::Config& config, bool daemon_runs, Examination& report);

// ---- doctor_robot.cpp --------------------------------------------------------------------------------------------

/// Receives the poses of each robot for `seconds`.
void examine_robots(const config::Config& config, double seconds, Examination& report);

// ---- doctor_links.cpp: daemon, scanner and calibrations ----------------------------------------------------------

/// Queries the daemon; returns its status (slabd.status/1), empty if it does not run.
[[nodiscard]] std::string examine_daemon(const config::Config& config, Examination& report);
/// Names the robot or the scanner of an arm in the findings, on a line with several: "robot 2".
void name_part(const config::Config& config, const std::string& part, const PartId& id, Examination& report);
/// `scan`: takes a scan with each scanner in the daemon's maintenance state.
void examine_scanners(const config::Config& config, const std::string& status, bool scan, Examination& report);
/// Calibrations of each scanner, and the tie of two robots.
void examine_calibrations(const config::Config& config, const std::string& status, Examination& report);

// ---- doctor_gauges.cpp -------------------------------------------------------------------------------------------

void examine_gauges(const config::Config& config, bool daemon_runs, Examination& report);

}  // namespace slabd::cli
