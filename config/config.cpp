// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <algorithm>
#include <cassert>
#include <cctype>
#include <cmath>
#include <filesystem>
#include <thread>
#include <vector>

#include "config/config_parts.h"
#include "hal/robot/lcm_wire.h"
#include "hal/scan/scan_stream.h"

/// Reads slabd.toml into Config. One function per table fills the values it can read and reports the rest. A fault in
/// one table therefore does not hide faults in another, and the PLC can still receive code 504.
namespace slabd::config {
namespace {

constexpr double kReach_mm = 20'000.0;  ///< larger than any cell and any robot
constexpr double kArmMax_mm = 2'000.0;  ///< larger than any distance of a scanner from its flange
// A pose written in metres instead of mm is below both limits; (0, 0, 0) means not entered, as on a test bench.
constexpr double kSlabOffMin_mm = 10.0;
constexpr double kArmMin_mm = 1.0;
/// Limit of window and dwell together. At 250 Hz the ring holds two seconds; the reserve is for a sender that is a
/// third faster.
constexpr double kStandstillMax_ms = 1'500.0;
/// The ring holds this number of poses at any rate of the sender, so that the window always fills.
constexpr std::int64_t kSamplesMinMax = 300;
static_assert(kSamplesMinMax < limits::kPoseRing && kStandstillMax_ms * 250 / 1000 < limits::kPoseRing);
constexpr std::size_t kPathMax = limits::kPathBytes - 64;  ///< reserve for names inside a folder

/// 127.0.0.0/8: by default only this computer is allowed.
template <typename Networks>
void allow_loopback_only(Networks& allow) {
  allow.clear();
  if (!allow.push({0x7F00'0000U, 0xFF00'0000U})) allow.clear();
}

void read_s(TableReader& table, std::string_view key, std::int64_t& out_ns, Allowed allowed_s) {
  double time_s = static_cast<double>(out_ns) / 1e9;
  table.optional_number(key, time_s, allowed_s);
  out_ns = std::llround(time_s * 1e9);
}

void read_deg(TableReader& table, std::string_view key, double& out_rad, Allowed allowed_deg) {
  if (!table.has(key)) return;  // keep the exact default
  double angle_deg = deg_from_rad(out_rad);
  table.optional_number(key, angle_deg, allowed_deg);
  doubt_degrees(table, key, angle_deg, allowed_deg);
  out_rad = rad_from_deg(angle_deg);
}

/// Reads a standard deviation in mm. A value below a micrometre was probably written in metres and would make U too
/// small.
void read_sigma_mm(TableReader& table, std::string_view key, double& out, Allowed allowed) {
  constexpr double kSigmaMin_mm = 0.001;
  table.optional_number(key, out, allowed);
  if (table.has(key) && out > 0.0 && out < kSigmaMin_mm)
    table.doubt(key,
                fmt::format("found {}, metres? the unit is mm, allowed is {}..{}", out, allowed.low, allowed.high));
}

void read_int16(TableReader& table, std::string_view key, std::int16_t& out) {
  std::int64_t number = out;
  table.optional_integer(key, number, -32'768, 32'767);
  out = static_cast<std::int16_t>(number);
}

/// Window and dwell together must fit into the ring, or no robot would ever count as settled.
void check_standstill(TableReader& robot, const PoseSettings& pose) {
  const double total_ms = static_cast<double>(pose.window_ns + pose.dwell_ns) / 1e6;
  if (total_ms > kStandstillMax_ms)
    robot.problem(
        robot.has("dwell_ms") ? "dwell_ms" : "window_ms",
        fmt::format("window_ms and dwell_ms together are {} ms, allowed are {} ms: the daemon remembers 2 s of "
                    "poses, and a longer standstill would never be seen",
                    total_ms, kStandstillMax_ms));
}

void read_robot(TableReader robot, ArmSettings& arm) {
  hal::LcmSettings& lcm = arm.robot;
  PoseSettings& pose = arm.pose;
  read_text(robot, "lcm_url", lcm.url);
  if (!lcm.url.view().starts_with("udpm://"))
    robot.problem("lcm_url", fmt::format("found \"{}\", allowed is \"udpm://group:port?ttl=n\"", lcm.url.view()));
  else if (const auto url = hal::parse_lcm_url(lcm.url.view()); !url.ok())
    robot.problem("lcm_url", std::string(url.error().text.view()));
  read_text(robot, "channel", lcm.channel);
  if (const Status channel = hal::check_lcm_channel(lcm.channel.view()); !channel.ok())
    robot.problem("channel", std::string(channel.error().text.view()));
  read_text(robot, "interface", lcm.interface);
  if (const Status interface = hal::check_lcm_interface(lcm.interface.view()); !interface.ok())
    robot.problem("interface", std::string(interface.error().text.view()));

  read_ms(robot, "window_ms", pose.window_ns, {50.0, kStandstillMax_ms});
  std::int64_t samples_min = pose.samples_min;
  robot.optional_integer("samples_min", samples_min, 3, kSamplesMinMax);
  pose.samples_min = static_cast<int>(samples_min);
  robot.optional_number("settled_mm", pose.settled_mm, {0.001, 1.0});
  read_deg(robot, "settled_deg", pose.settled_rad, {0.0001, 0.1});
  read_ms(robot, "dwell_ms", pose.dwell_ns, {0.0, kStandstillMax_ms});
  check_standstill(robot, pose);
  robot.optional_number("moved_mm", pose.moved_mm, {0.001, 1.0});
  read_deg(robot, "moved_deg", pose.moved_rad, {0.0001, 0.1});
  read_ms(robot, "stale_ms", pose.stale_ns, {10.0, 1'000.0});
  std::int64_t gap_ns = pose.gap_us * kNsPerUs;
  read_ms(robot, "gap_ms", gap_ns, {5.0, 1'000.0});
  pose.gap_us = gap_ns / kNsPerUs;
  read_int16(robot, "base_id", pose.base_id);
  read_int16(robot, "tool_id", pose.tool_id);
  robot.optional_number("look_mm", pose.look_mm, {10.0, 300.0});
  read_s(robot, "settle_timeout_s", arm.settle_timeout_ns, {0.5, 15.0});
  read_sigma_mm(robot, "repeatability_sigma_mm", arm.splice.repeatability_mm, {0.0, 10.0});
  read_deg(robot, "repeatability_sigma_deg", arm.splice.repeatability_rad, {0.0, 1.0});
  read_sigma_mm(robot, "absolute_sigma_mm", arm.splice.absolute_mm, {1e-6, 10.0});
  read_deg(robot, "absolute_sigma_deg", arm.splice.absolute_rad, {1e-6, 1.0});
  robot.finish();
}

/// Reads [pose]: the allowed senders and the message type, of all robots.
void read_pose(TableReader table, Config& config) {
  hal::LcmSettings& lcm = config.robot;
  std::size_t type = static_cast<std::size_t>(lcm.type);
  table.optional_word("type", type, {hal::kPoseTypes[0], hal::kPoseTypes[1]});
  lcm.type = static_cast<hal::PoseType>(type);
  bool other_frame = false;
  for (std::size_t i = 0; i < config.arms.list.size(); ++i)
    other_frame = other_frame || config.arm(i).pose.base_id != 0 || config.arm(i).pose.tool_id != 0;
  if (lcm.type == hal::PoseType::rigid_transform && other_frame)
    table.problem("type",
                  fmt::format("{} does not say which base and tool are active, so robot.base_id and "
                              "robot.tool_id must be 0 and the bridge must publish the flange in the robot root",
                              hal::kPoseTypes[1]));
  read_networks(table, "senders", lcm.senders);
  for (ArmSettings& other : config.more_arms) {
    other.robot.type = lcm.type;
    other.robot.senders = lcm.senders;
  }
  table.finish();
}

/// Returns false and reports a problem if the path is of another operating system.
bool is_path_of_this_computer(TableReader& table, std::string_view key, const std::string& path) {
  if (!table.has(key)) return true;
  const bool drive = path.size() >= 2 && std::isalpha(static_cast<unsigned char>(path[0])) != 0 && path[1] == ':' &&
                     (path.size() == 2 || path[2] == '\\' || path[2] == '/');
  if (drive || path.starts_with("\\\\")) {
    table.problem(key, fmt::format("found \"{}\", a path of Windows; allowed is a path of this computer, such as "
                                   "/mnt/scanner/drop: mount a share of another computer first (docs/DELIVERY.md)",
                                   path));
    return false;
  }
  if (path.find('\\') != std::string::npos)
    table.doubt(key, fmt::format("found \"{}\" with a backslash, which is part of a name here; allowed is a path whose "
                                 "folders are separated by /",
                                 path));
  else if (path.starts_with("//"))
    table.doubt(key, fmt::format("found \"{}\", which is {} on this computer and no share; allowed is a path of this "
                                 "computer, where a share is mounted",
                                 path, path.substr(1)));
  return true;
}

}  // namespace

void read_path(TableReader& table, std::string_view key, const std::string& folder, std::string& out) {
  std::string path = out;
  table.optional_text(key, path, kPathMax);
  if (!is_path_of_this_computer(table, key, path)) return;
  if (!path.starts_with('/')) path = folder + "/" + path;
  if (path.size() > kPathMax) {
    table.problem(key, fmt::format("{} has {} characters, allowed are {}", path, path.size(), kPathMax));
    return;
  }
  out = path;
}

namespace {

/// Three names of a table's columns, and commas.
constexpr std::size_t kColumnsTextMax = 130;

void read_drop(TableReader& scanner, const std::string& folder, hal::ScanDropSettings& out) {
  std::string drop_dir(out.drop_dir.view());
  read_path(scanner, "drop_dir", folder, drop_dir);
  out.drop_dir.assign(drop_dir);
  scanner.optional_boolean("any_name", out.any_name);
  std::size_t unit = static_cast<std::size_t>(out.form.unit);
  scanner.optional_word("unit", unit, {"mm", "m", "um"});
  out.form.unit = static_cast<hal::LengthUnit>(unit);
  std::string columns;
  scanner.optional_text("columns", columns, kColumnsTextMax);
  if (!columns.empty()) {
    const Result<hal::TableColumns> parsed = hal::parse_table_columns(columns);
    if (parsed)
      out.form.columns = parsed.value();
    else
      scanner.problem("columns", std::string(parsed.error().text.view()));
  }
  for (const char* key : {"listen", "allow"})
    if (scanner.has(key)) scanner.problem(key, "backend = \"drop\" does not listen; it needs backend = \"tcp\"");
}

void read_stream(TableReader& scanner, hal::ScanStreamSettings& out) {
  read_endpoint(scanner, "listen", 1, out.host, out.port);
  read_networks(scanner, "allow", out.allow);
  for (const char* key : {"drop_dir", "any_name", "unit", "columns"})
    if (scanner.has(key))
      scanner.problem(key, "backend = \"tcp\" does not use it: each scan carries its request and its unit");
}

double longest(const std::array<double, 7>& pose) {
  return std::max({std::abs(pose[0]), std::abs(pose[1]), std::abs(pose[2])});
}

/// Doubts (0, 0, 0, 1): the identity if qw comes last, but a rotation by 180 degrees if qw comes first.
void doubt_order(TableReader& table, std::string_view key, const std::array<double, 7>& pose) {
  if (std::abs(pose[6]) == 1.0)
    table.doubt(
        key,
        "found the quaternion (0, 0, 0, 1), which is half a turn about z: written as qx, qy, qz, qw? The order is "
        "qw, qx, qy, qz, allowed is any of unit length");
}

std::array<double, 7> read_flange_scanner(TableReader& table) {
  std::array<double, 7> pose = Pose::identity().to_array();
  table.required_pose("T_flange_scanner", pose, kArmMax_mm);
  if (const double mm = longest(pose); mm > 0.0 && mm < kArmMin_mm)
    table.doubt("T_flange_scanner", fmt::format("found x, y, z of at most {} mm, metres? The origin of a scanner is "
                                                "hardly in the flange; the unit is mm, allowed is -{}..{}",
                                                mm, kArmMax_mm, kArmMax_mm));
  doubt_order(table, "T_flange_scanner", pose);
  return pose;
}

void read_warm_up(TableReader warm_up, ArmSettings& arm) {
  std::int64_t views = arm.warm_up.views_min;
  warm_up.optional_integer("views", views, calib::kWarmUpViewsLeast, calib::kWarmUpViewsMost);
  arm.warm_up.views_min = static_cast<int>(views);
  double window_min = arm.warm_up.window_s / 60.0;
  warm_up.optional_number("window_min", window_min, {0.1, 240.0});
  arm.warm_up.window_s = 60.0 * window_min;
  warm_up.optional_number("every_s", arm.warm_up_every_s, {1.0, 3'600.0});
  warm_up.optional_number("centre_um_per_h", arm.warm_up.centre_um_per_h, {0.1, 10'000.0});
  warm_up.optional_number("radius_um_per_h", arm.warm_up.radius_um_per_h, {0.1, 10'000.0});
  warm_up.optional_number("give_up_min", arm.warm_up_give_up_min, {0.5, 1'440.0});
  if (arm.warm_up_give_up_min * 60.0 < arm.warm_up.window_s)
    warm_up.problem("give_up_min",
                    fmt::format("found {}, allowed is window_min ({}) or more", arm.warm_up_give_up_min, window_min));
  warm_up.finish();
}

/// Reads the table of a scanner. `flange_scanner` is the T_flange_scanner of a [[scanner]]; that of scanner "1" is in
/// [calibration].
void read_scanner(const PartTable& part, const std::string& folder, ArmSettings& arm,
                  std::optional<std::array<double, 7>>& flange_scanner) {
  TableReader scanner = part.table;
  std::size_t backend = static_cast<std::size_t>(arm.scanner_backend);
  scanner.optional_word("backend", backend, {hal::kScannerBackends[0], hal::kScannerBackends[1]});
  arm.scanner_backend = static_cast<hal::ScannerBackend>(backend);
  switch (arm.scanner_backend) {
    case hal::ScannerBackend::tcp: read_stream(scanner, arm.stream); break;
    case hal::ScannerBackend::drop: read_drop(scanner, folder, arm.scanner); break;
  }
  read_s(scanner, "timeout_s", arm.scan_timeout_ns, {0.5, 15.0});
  scanner.optional_number("drift_per_K", arm.scanner_drift.per_K, {0.0, 1e-3});
  scanner.optional_number("temperature_range_K", arm.scanner_drift.range_K, {0.5, 100.0});
  read_warm_up(scanner.table("warm_up"), arm);
  if (part.is_listed && scanner.has("T_flange_scanner")) {
    if (part.id.view() == "1")
      scanner.problem("T_flange_scanner", "found for scanner \"1\", allowed is calibration.T_flange_scanner");
    else
      flange_scanner = read_flange_scanner(scanner);
  }
  scanner.finish();
}

/// Reads a number of slabs: 0, or at least kKeepSlabsMin.
void read_count(TableReader& storage, std::string_view key, const char* zero, std::int64_t& out) {
  if (!storage.has(key)) return;
  auto count = static_cast<double>(out);
  storage.optional_number(key, count, {0.0, 1e9});  // accepts 2e4 as a whole number
  if (count != std::floor(count))
    storage.problem(key, fmt::format("found {}, allowed is a whole number", count));
  else if (count > 0.0 && count < static_cast<double>(storage::kKeepSlabsMin))
    storage.problem(key,
                    fmt::format("found {}, allowed is 0 ({}) or {} and more", count, zero, storage::kKeepSlabsMin));
  out = static_cast<std::int64_t>(count);
}

void read_storage(TableReader storage, const std::string& folder, storage::StoreSettings& out) {
  read_path(storage, "db", folder, out.db_path);
  read_path(storage, "spool_dir", folder, out.spool_dir);
  double budget_gb = 0.0;
  storage.optional_number("spool_budget_gb", budget_gb, {0.0, 100'000.0});
  if (budget_gb > 0.0 && budget_gb < 3.0)
    storage.problem(
        "spool_budget_gb",
        fmt::format("found {}, allowed is 0 (keep every scan) or 3..100000; a slab's scans are 1.1 GB", budget_gb));
  out.spool_budget_bytes = static_cast<std::uint64_t>(budget_gb * 1e9);
  read_count(storage, "keep_slabs", "keep every record", out.keep_slabs);
  // By default slabs that did not pass at most double the required space.
  out.keep_failed_slabs = out.keep_slabs;
  const bool says = storage.has("keep_failed_slabs");
  read_count(storage, "keep_failed_slabs", "keep all that did not pass", out.keep_failed_slabs);
  if (says && out.keep_slabs == 0)
    storage.problem(
        "keep_failed_slabs",
        "found with keep_slabs = 0, which keeps every record; allowed only with a keep_slabs that limits them");
  storage.finish();
}

void read_cell(TableReader cell, Pose& T_base_slab) {
  std::array<double, 7> pose = Pose::identity().to_array();
  cell.required_pose("T_base_slab", pose, kReach_mm);
  if (const double mm = longest(pose); mm > 0.0 && mm < kSlabOffMin_mm)
    cell.doubt(
        "T_base_slab",
        fmt::format("found x, y, z of at most {} mm, metres? The centre of a slab is hardly in the robot's foot; "
                    "the unit is mm, allowed is -{}..{}",
                    mm, kReach_mm, kReach_mm));
  doubt_order(cell, "T_base_slab", pose);
  T_base_slab = Pose::from_array(pose);
  cell.finish();
}

void read_checks(TableReader& table, Config& config) {
  double interval_hours = static_cast<double>(config.check_interval_us) / 3.6e9;
  table.optional_number("check_interval_hours", interval_hours, {0.0, 8'760.0});
  config.check_interval_us = std::llround(interval_hours * 3.6e9);
  read_deg(table, "check_slope_limit_deg", config.check_limits.slope_rad, {1e-4, 1.0});
  table.optional_number("check_jaw_limit_mm", config.check_limits.jaw_distance_mm, {1e-4, 5.0});
  std::int64_t valid_days = config.calibration_valid_days;
  table.optional_integer("valid_days", valid_days, 0, 36'500);
  config.calibration_valid_days = static_cast<int>(valid_days);
}

/// Reads limits that may only be wider than the default, because a view affects every scan until the next calibration.
void read_capture(TableReader& table, CaptureGuard& guard) {
  table.optional_number("capture_stable_mm", guard.stable_mm, {CaptureGuard::kStable_mm, 1.0});
  read_deg(table, "capture_stable_deg", guard.stable_rad, {deg_from_rad(CaptureGuard::kStable_rad), 0.1});
  read_s(table, "capture_stable_s", guard.stable_ns, {0.2, static_cast<double>(CaptureGuard::kStable_ns) / 1e9});
}

/// Reads the uncertainty of the commissioning value. Without that value it has no effect, so it may remain when the
/// value is removed. One of mm and deg alone would make every slab item indeterminate.
void read_station_sigma(TableReader& table, const char* key, const char* other, bool commissioned, double& out,
                        Allowed allowed) {
  if (key == std::string_view("station_sigma_mm"))
    read_sigma_mm(table, key, out, allowed);
  else
    table.optional_number(key, out, allowed);
  if (commissioned && table.has(key) && !table.has(other))
    table.problem(key, fmt::format("found without {}; allowed are both or neither", other));
}

/// T_flange_scanner of each arm as configured; nullopt: not given.
using FlangeScanners = std::array<std::optional<std::array<double, 7>>, limits::kArmsMax>;

/// Adds the T_flange_scanner of scanner "1" to `poses`.
void read_first_flange_scanner(TableReader& table, const Config& config, FlangeScanners& poses) {
  if (!table.has("T_flange_scanner")) return;
  const std::array<double, 7> pose = read_flange_scanner(table);
  for (std::size_t i = 0; i < config.arms.list.size(); ++i) {
    if (!(config.arms.list[i].scanner.view() == "1")) continue;
    poses.at(i) = pose;
    return;
  }
  table.problem("T_flange_scanner", "found, but no scanner has the id \"1\"; allowed is scanner.T_flange_scanner");
}

void read_calibration(TableReader table, const std::string& folder, Config& config, FlangeScanners poses) {
  double sigma_mm = kNoValue;  // absent: slab-frame items are indeterminate
  double sigma_deg = kNoValue;
  read_first_flange_scanner(table, config, poses);
  const bool commissioned = std::any_of(poses.begin(), poses.end(), [](const auto& pose) { return pose.has_value(); });
  read_station_sigma(table, "station_sigma_mm", "station_sigma_deg", commissioned, sigma_mm, {1e-6, 10.0});
  read_station_sigma(table, "station_sigma_deg", "station_sigma_mm", commissioned, sigma_deg, {1e-6, 1.0});
  table.optional_number("station_gate_mm", config.splice.gate_mm, {0.01, 20.0});
  read_deg(table, "station_gate_deg", config.splice.gate_rad, {0.001, 1.0});
  read_checks(table, config);
  read_capture(table, config.capture);
  config.sessions_dir = std::filesystem::path(config.storage.db_path).parent_path().native() + "/calibration";
  read_path(table, "sessions_dir", folder, config.sessions_dir);
  table.finish();
  for (std::size_t i = 0; i < config.arms.list.size(); ++i) {
    ArmSettings& arm = config.arm(i);
    arm.splice.gate_mm = config.splice.gate_mm;
    arm.splice.gate_rad = config.splice.gate_rad;
    if (!poses.at(i)) continue;  // the applied calibration is used; without it every slab is rejected with fault 503
    const Result<calib::Calibration> calibration = calib::commissioning(*poses.at(i), sigma_mm, sigma_deg);
    if (!calibration.ok()) {
      table.problem("T_flange_scanner", std::string(calibration.error().text.view()));
      continue;
    }
    arm.calibration = calibration.value();
    arm.splice.commissioning_mm = arm.calibration.station_sigma_mm;
    arm.splice.commissioning_rad = arm.calibration.station_sigma_rad;
  }
}

void read_measure(TableReader measure, int& threads) {
  std::int64_t number = threads;
  measure.optional_integer("threads", number, 1, 2);
  threads = static_cast<int>(number);
  measure.finish();
}

/// Reads a regular expression with `groups` groups, or with any number if it is -1.
void read_pattern(TableReader& table, std::string_view key, int groups, std::optional<IdPattern>& out) {
  std::string text;
  table.optional_text(key, text, IdPattern::kTextBytesMax);
  if (text.empty()) return;
  const Result<IdPattern> pattern = IdPattern::compile(text);
  if (!pattern.ok()) {
    table.problem(
        key, fmt::format("found \"{}\", which is not a regular expression: {}", text, pattern.error().text.view()));
    return;
  }
  if (groups >= 0 && pattern.value().groups() != groups) {
    table.problem(key,
                  fmt::format("found \"{}\" with {} groups, allowed is one group ( ), which contains the number of "
                              "the mould; (?: ) is not counted",
                              text, pattern.value().groups()));
    return;
  }
  out = pattern.value();
}

void read_line(TableReader line, Config& config) {
  line.optional_boolean("simulation", config.simulation);
  read_pattern(line, "id_pattern", -1, config.id_pattern);
  read_pattern(line, "mould_from_id", 1, config.mould_from_id);
  std::size_t second_chip = 0;
  line.optional_word("second_chip", second_chip, {"optional", "required"});
  config.second_chip_required = second_chip == 1;
  line.finish();
}

void read_rest(TableReader& root, const std::string& folder, Config& config) {
  TableReader recipes = root.table("recipes");
  read_path(recipes, "dir", folder, config.recipes_dir);
  recipes.finish();
  TableReader design = root.table("design");
  if (design.has("dir")) read_path(design, "dir", folder, config.designs_dir);
  design.finish();
  TableReader control = root.table("control");
  read_path(control, "socket", folder, config.control_socket);
  // sockaddr_un::sun_path has 108 bytes including the NUL.
  if (config.control_socket.size() > 107)
    control.problem("socket", fmt::format("found a path of {} bytes, allowed are 107", config.control_socket.size()));
  control.finish();
  read_line(root.table("line"), config);
  constexpr std::size_t kProjectBytesMax = 120;
  TableReader quality = root.table("quality");
  quality.optional_boolean("second_person", config.storage.second_person);
  quality.finish();
  TableReader report = root.table("report");
  report.optional_text("project", config.project, kProjectBytesMax);
  report.finish();
}

/// Accepts only scans of the camera of [genicam], as the scanner with this id, or the only one with a stream. If it is
/// not clear which one it is, all of them accept no other, so that no scan of another camera is used.
void accept_camera(TableReader genicam, const std::string& id, Config& config) {
  std::vector<ArmSettings*> streams;
  for (std::size_t i = 0; i < config.arms.list.size(); ++i)
    if (config.arm(i).scanner_backend == hal::ScannerBackend::tcp &&
        (id.empty() || config.arms.list[i].scanner.view() == id))
      streams.push_back(&config.arm(i));
  if (streams.size() > 1 || (streams.empty() && !id.empty()))
    genicam.problem("scanner", fmt::format("{} scanners with backend \"tcp\" fit; name one by its id", streams.size()));
  const bool is_clear = streams.size() == 1;
  for (std::size_t i = 0; !is_clear && i < config.arms.list.size(); ++i) streams.push_back(&config.arm(i));
  for (ArmSettings* const arm : streams) arm->stream.scanner = hal::scanner_print(config.genicam.accepted);
  if (is_clear && genicam.value("slabd") == nullptr) config.genicam.slabd_port = streams[0]->stream.port;
}

}  // namespace

void load_config(const std::string& path, Config& config, std::vector<Problem>& problems) {
  config = Config{};
  config.path = path;
  config.storage.db_path = "/var/lib/slabd/slabd.db";
  config.storage.spool_dir = "/var/lib/slabd/spool";
  config.measure_threads = default_measure_threads();
  allow_loopback_only(config.plc.allow);
  allow_loopback_only(config.gauge_senders);

  const std::optional<std::string> bytes = read_text_file(path, problems);
  if (!bytes) return;
  TomlValue tree;
  const bool complete = parse_toml(path, *bytes, tree, problems);

  // After a syntax error only the tables above it exist. The PLC's table is read for its address; problems for keys
  // "missing" below the error are dropped.
  std::vector<Problem> ignored;
  const std::string folder = std::filesystem::absolute(path).parent_path().native();
  TableReader root(path, &tree, "", complete ? problems : ignored);
  root.keep_doubts(&config.doubts);
  read_plc(root.table("plc"), config.plc);
  read_gauges(root, path, complete ? problems : ignored, config);
  std::vector<Problem>& reported = complete ? problems : ignored;
  std::vector<PartTable> robots = read_parts(root, "robot", path, reported, &config.doubts);
  std::vector<PartTable> scanners = read_parts(root, "scanner", path, reported, &config.doubts);
  read_arms(root, path, robots, scanners, reported, config.arms);
  config.more_arms.resize(config.arms.list.size() - 1);
  FlangeScanners flange_scanners;
  for (std::size_t i = 0; i < config.arms.list.size(); ++i) {
    ArmSettings& arm = config.arm(i);
    arm.by = config.arms.list[i];
    arm.scanner.drop_dir = "/var/lib/slabd/drop";
    allow_loopback_only(arm.stream.allow);
    read_robot(robots[part_index(robots, arm.by.robot)].table, arm);
  }
  read_pose(root.table("pose"), config);
  for (std::size_t i = 0; i < config.arms.list.size(); ++i)
    read_scanner(scanners[part_index(scanners, config.arm(i).by.scanner)], folder, config.arm(i),
                 flange_scanners.at(i));
  read_storage(root.table("storage"), folder, config.storage);
  read_cell(root.table("cell"), config.T_base_slab);
  read_calibration(root.table("calibration"), folder, config, flange_scanners);
  read_measure(root.table("measure"), config.measure_threads);
  read_rest(root, folder, config);
  // A fault in the settings of other programs must not stop the inspection, so their problems have their own lists.
  static_cast<void>(root.value("web"));
  static_cast<void>(root.value("plant"));
  static_cast<void>(root.value("genicam"));
  TableReader of_plant(path, &tree, "", complete ? config.plant_problems : ignored);
  of_plant.keep_doubts(&config.doubts);
  read_plant(of_plant.table("plant"), folder, config.plant);
  config.storage.keep_unsent = !config.plant.dsn.empty();
  config.storage.arms = config.arms;
  TableReader of_web(path, &tree, "", complete ? config.web_problems : ignored);
  of_web.keep_doubts(&config.doubts);
  read_web(of_web.table("web"), folder, config.web);
  TableReader of_genicam(path, &tree, "", complete ? config.genicam_problems : ignored);
  of_genicam.keep_doubts(&config.doubts);
  std::string camera_is;
  read_genicam(of_genicam.table("genicam"), config.genicam, camera_is);
  if (!config.genicam.camera.empty()) accept_camera(of_genicam.table("genicam"), camera_is, config);
  check_together(root, config, scanners);
  check_arms_together(config, robots, scanners);
  root.finish();
}

int default_measure_threads() {
  return std::thread::hardware_concurrency() >= 2 ? 2 : 1;
}

}  // namespace slabd::config
