// SPDX-License-Identifier: Apache-2.0
//
// slabctl stations: computes the flange pose for every block, checks that all measured features are visible, and
// writes the points for the robot's program; or compares taught points with the plan.
#include <fmt/core.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <limits>
#include <memory>
#include <optional>
#include <sstream>

#include "base/durable.h"
#include "calib/calib.h"
#include "cli/client/calibration_change.h"
#include "cli/client/record_options.h"
#include "cli/command.h"
#include "cli/exit.h"
#include "cli/recipe/recipe_source.h"
#include "cli/stations/krl.h"
#include "cli/stations/station_plan.h"
#include "cli/terminal/arguments.h"
#include "cli/terminal/parse.h"
#include "daemon/station/station_views.h"
#include "report/json.h"

namespace slabd::cli {
namespace {

struct Options {
  std::string config;
  ScannerChoice scanner;
  std::uint16_t type = 0;
  std::string krl;
  bool overwrite = false;
  std::string taught;
  double standoff_mm = 600.0;
  double turn_deg = 0.0;
  Dither dither;
  bool no_dither = false;
  int set = 1;
  ScannerView view;
  double incidence_deg = 70.0;
  bool as_json = false;
};

/// One station: the planned point, and the taught one if given.
struct Row {
  int station = 0;
  Pose planned;
  StationView view;
  std::optional<Pose> taught;
  StationView taught_view;
  std::optional<Pose> mastered;  ///< pose of the robot when the station was mastered
};

struct Sources {
  config::Config config;
  Recipe recipe;
  std::vector<int> stations;  ///< that are planned
  InForce hand_eye;
  std::optional<StationTable> table;
  std::string not_used;  ///< reason why the line does not use it; empty if it does
};

/// Stations that the arm may scan, the usual ones and those with `or`.
std::vector<int> stations_of(const Options& options, const config::Config& line, const Recipe& recipe) {
  const std::size_t arm = options.scanner.arm(line);
  std::vector<int> stations;
  for (int station = 1; station <= recipe.stations(); ++station) {
    const ArmChoice& choice = line.arms.of_station.at(static_cast<std::size_t>(station - 1));
    if (std::find(choice.begin(), choice.end(), arm) != choice.end()) stations.push_back(station);
  }
  if (stations.empty())
    stop(kBadInput, fmt::format("scanner {} has no station of slab type {} ([[station]])", scanner_of_arm(line, arm),
                                recipe.slab_type));
  return stations;
}

/// Places the slab in the base of the robot that carries the scanner, because its poses are.
void move_to_robot(config::Config& config, storage::Reader* reader) {
  const std::optional<Pose> T_robot_slab = find_T_robot_slab(reader, config);
  if (!T_robot_slab)
    stop(kRefused, fmt::format("where robot {} stands is not known: tie it to the first robot (slabctl calibrate tie)",
                               config.by.robot.view()));
  config.T_base_slab = *T_robot_slab;
}

Sources gather(const Options& options) {
  Sources out;
  const config::Config line = config_from(options.config);
  out.config = options.scanner.of(line);
  out.recipe = recipe_of_type(out.config, options.type);
  out.stations = stations_of(options, line, out.recipe);
  const std::unique_ptr<storage::Reader> reader = open_records(out.config);
  move_to_robot(out.config, reader.get());
  out.hand_eye = hand_eye_in_force(reader.get(), out.config);
  if (out.hand_eye.id.empty())
    stop(kBadInput,
         "where the scanner sits on the flange is not known: apply a calibration, or set [calibration] "
         "T_flange_scanner");
  if (reader == nullptr) return out;
  const auto table = reader->current(CalibrationKind::stations, out.recipe.slab_type, out.config.by.scanner.view());
  if (!table.ok() || !table.value()) return out;
  const storage::CalibrationRecord& record = *table.value();
  out.table = std::get<StationTable>(record.numbers);
  if (record.parent_id != out.hand_eye.id.view())
    out.not_used = fmt::format("is stale: solved with {}, in force is {}", record.parent_id, out.hand_eye.id.view());
  else if (record.expires_utime_us != 0 && wall_clock_us() >= record.expires_utime_us)
    out.not_used = fmt::format("expired on {}", report::iso_time(record.expires_utime_us));
  return out;
}

/// Reads taught points: a KRL data list or program, otherwise slabd's own form, one pose a line for the stations in
/// their order.
Stops read_taught(const std::string& path, const std::vector<int>& stations) {
  std::ifstream file(path, std::ios::binary);
  std::ostringstream bytes;
  bytes << file.rdbuf();
  if (!file) stop(kBadInput, fmt::format("{}: cannot be read", path));
  const std::string text = bytes.str();
  Stops taught;
  if (text.find('{') != std::string::npos) {
    taught = need(parse_krl_stops(text, path), kBadInput);
  } else {
    const std::vector<Pose> poses = need(calib::parse_poses(text, path, calib::TableRole::flange), kBadInput).poses;
    if (poses.size() != stations.size())
      stop(kBadInput, fmt::format("{}: {} points, there are {} stations", path, poses.size(), stations.size()));
    for (std::size_t i = 0; i < poses.size(); ++i) taught[stations[i]] = poses[i];
  }
  for (const int station : stations)
    if (!taught.contains(station)) stop(kBadInput, fmt::format("{}: station {} is missing", path, station));
  for (const auto& [station, pose] : taught)
    if (std::find(stations.begin(), stations.end(), station) == stations.end())
      stop(kBadInput, fmt::format("{}: station {} is not one of this scanner and slab type", path, station));
  return taught;
}

/// Pose of the scanner over a block: looking straight down, rotated about its axis.
Pose T_block_scanner(const Options& options) {
  Pose pose = nominal_T_block_scanner();
  pose.translation_mm.z() = options.standoff_mm;
  pose.rotation =
      (pose.rotation * Quat(Eigen::AngleAxisd(rad_from_deg(options.turn_deg), Eigen::Vector3d::UnitZ()))).normalized();
  return pose;
}

/// Station whose stop is used in a set. A set shifts the pattern of stops: neighbours remain neighbours, and no
/// station has the stop of another set.
int station_of_set(int station, int set) {
  constexpr int kApart = 5;
  return (station - 1 + kApart * (set - 1)) % static_cast<int>(limits::kStationsMax) + 1;
}

std::vector<Row> plan(const Options& options, const Sources& sources, const Stops& taught) {
  const auto look = [&](const Pose& T_base_flange, int station) {
    return look_at(sources.recipe, options.view, sources.config.T_base_slab, sources.hand_eye.T_flange_scanner,
                   T_base_flange, station);
  };
  std::vector<Row> rows;
  for (const int station : sources.stations) {
    const auto index = static_cast<std::size_t>(station - 1);
    Row row;
    row.station = station;
    row.planned = planned_flange(
        sources.recipe, sources.config.T_base_slab, sources.hand_eye.T_flange_scanner,
        dithered(T_block_scanner(options), station_of_set(station, options.set), options.dither), station);
    row.view = look(row.planned, station);
    if (const auto found = taught.find(station); found != taught.end()) {
      row.taught = found->second;
      row.taught_view = look(found->second, station);
    }
    if (sources.table && sources.table->station.at(index).visits != 0)
      row.mastered = sources.table->station.at(index).T_base_flange;
    rows.push_back(row);
  }
  return rows;
}

/// Scanner pose over its block, from the taught point if there is one.
Pose stop_of(const Sources& sources, const Row& row) {
  return (sources.config.T_base_slab * T_slab_block(sources.recipe, row.station)).inverse() *
         (row.taught ? *row.taught : row.planned) * sources.hand_eye.T_flange_scanner;
}

/// The two neighbouring stations with the smallest difference of stops, cyclic.
struct Alike {
  int station = 0;
  int next = 0;
  StopDifference differ;
};
Alike most_alike(const Sources& sources, const std::vector<Row>& rows) {
  Alike least;
  if (rows.size() == 1) {
    constexpr double kFar = std::numeric_limits<double>::infinity();
    return {rows[0].station, rows[0].station, {kFar, kFar}};
  }
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const Row& next = rows[(i + 1) % rows.size()];
    const StopDifference d = stop_difference(stop_of(sources, rows[i]), stop_of(sources, next));
    const auto apart = [](const StopDifference& x) {
      return std::max(x.mm / kStopsDiffer_mm, x.deg / deg_from_rad(kStopsDiffer_rad));
    };
    if (least.station == 0 || apart(d) < apart(least.differ)) least = {rows[i].station, next.station, d};
  }
  return least;
}

double off_mm(const Pose& a, const Pose& b) {
  return (a.translation_mm - b.translation_mm).norm();
}
double off_deg(const Pose& a, const Pose& b) {
  return deg_from_rad(angle_between_rad(a.rotation, b.rotation));
}
bool in_gate(const Pose& planned, const Pose& mastered, const SpliceSettings& splice) {
  return off_mm(planned, mastered) <= splice.gate_mm &&
         angle_between_rad(planned.rotation, mastered.rotation) <= splice.gate_rad;
}

/// Faults of a view as text; empty if there are none.
std::string faults(const StationView& view, double look_mm) {
  std::string text;
  const auto add = [&text](const std::string& part) { text += (text.empty() ? "" : "; ") + part; };
  if (view.off_axis_mm > look_mm)
    add(fmt::format("centre {:.0f} mm off the axis, look_mm is {:.0f}", view.off_axis_mm, look_mm));
  if (view.distance_mm <= 0.0) add("the scanner looks away");
  for (std::size_t i = 0; i < kFeatures; ++i) {
    const FeatureView& f = view.feature[i];
    if (f.ok()) continue;
    add(fmt::format("{} {:.0f} % seen (needs {:.0f}), border {:+.0f} mm, incidence up to {:.0f} deg",
                    name(static_cast<Feature>(i)), 100.0 * f.seen, 100.0 * f.needed, f.margin_mm,
                    deg_from_rad(f.incidence_max_rad)));
  }
  return text;
}

std::string pose_text(const Pose& pose) {
  const Vec3& p = pose.translation_mm;
  const KukaAbc abc = kuka_abc_from_rotation(pose.rotation);
  return fmt::format("{:10.3f} {:10.3f} {:10.3f} {:9.4f} {:9.4f} {:9.4f}", p.x(), p.y(), p.z(), deg_from_rad(abc.a_rad),
                     deg_from_rad(abc.b_rad), deg_from_rad(abc.c_rad));
}

std::string table_text(const Sources& sources, const std::vector<Row>& rows) {
  std::string text;
  const double look_mm = sources.config.pose.look_mm;
  text += fmt::format("slab type {} ({}), hand-eye {}{}\n", sources.recipe.slab_type, sources.recipe.name.view(),
                      sources.hand_eye.id.view(), sources.hand_eye.applied ? "" : " (commissioning values)");
  text += "station          X          Y          Z         A         B         C   seen\n";
  for (const Row& row : rows) {
    const std::string wrong = faults(row.view, look_mm);
    text += fmt::format("{:7} {}   {}\n", row.station, pose_text(row.planned), wrong.empty() ? "all" : wrong);
    if (row.taught) {
      const std::string taught_wrong = faults(row.taught_view, look_mm);
      text += fmt::format(" taught {}   {}; {:.2f} mm, {:.3f} deg from the plan\n", pose_text(*row.taught),
                          taught_wrong.empty() ? "all" : taught_wrong, off_mm(row.planned, *row.taught),
                          off_deg(row.planned, *row.taught));
    }
    if (row.mastered) {
      const Pose& stands = row.taught ? *row.taught : row.planned;
      const bool near = in_gate(stands, *row.mastered, sources.config.splice);
      text += fmt::format("        mastered {:.2f} mm, {:.3f} deg away: its correction {}\n",
                          off_mm(stands, *row.mastered), off_deg(stands, *row.mastered),
                          !sources.not_used.empty() ? sources.not_used + ", so it does NOT hold"
                          : near                    ? "holds"
                                                    : "would NOT hold (calibration.station_gate_mm, station_gate_deg)");
    }
  }
  return text;
}

void write_view(report::Json& json, std::string_view key, const StationView& view, double look_mm) {
  json.key(key).begin_object().field("ok", view.ok(look_mm)).field("off_axis_mm", view.off_axis_mm);
  json.field("distance_mm", view.distance_mm).key("features").begin_array();
  for (std::size_t i = 0; i < kFeatures; ++i) {
    const FeatureView& f = view.feature[i];
    json.begin_object().field("feature", static_cast<Feature>(i)).field("ok", f.ok()).field("seen", f.seen);
    json.field("needed", f.needed).field("margin_mm", f.margin_mm);
    json.field("incidence_max_deg", deg_from_rad(f.incidence_max_rad)).end_object();
  }
  json.end_array().end_object();
}

void write_flange(report::Json& json, std::string_view key, const Pose& pose) {
  json.field(key, pose);
  const KukaAbc abc = kuka_abc_from_rotation(pose.rotation);
  const std::array<double, 3> abc_deg = {deg_from_rad(abc.a_rad), deg_from_rad(abc.b_rad), deg_from_rad(abc.c_rad)};
  json.field(std::string(key) + "_abc_deg", abc_deg);
}

std::string json_of(const Sources& sources, const std::vector<Row>& rows, const Alike& alike, bool all_ok) {
  const double look_mm = sources.config.pose.look_mm;
  report::Json json("slabd.stations/1");
  json.field("ok", all_ok).field("slab_type", sources.recipe.slab_type).field("recipe", sources.recipe.name);
  json.field("hand_eye_id", sources.hand_eye.id).field("look_mm", look_mm).key("most_alike").begin_object();
  json.field("station", alike.station).field("next", alike.next).field("differ_mm", alike.differ.mm);
  json.field("differ_deg", alike.differ.deg).field("told_apart", is_told_apart(alike.differ)).end_object();
  json.list("stations", rows, [&](const Row& row) {
    json.field("station", row.station);
    write_flange(json, "T_base_flange", row.planned);
    write_view(json, "view", row.view, look_mm);
    if (row.taught) {
      write_flange(json, "taught", *row.taught);
      json.field("taught_off_mm", off_mm(row.planned, *row.taught));
      json.field("taught_off_deg", off_deg(row.planned, *row.taught));
      write_view(json, "taught_view", row.taught_view, look_mm);
    }
    if (row.mastered) {
      const Pose& stands = row.taught ? *row.taught : row.planned;
      json.field("mastered_off_mm", off_mm(stands, *row.mastered));
      json.field("mastered_off_deg", off_deg(stands, *row.mastered));
      json.field("correction_holds", sources.not_used.empty() && in_gate(stands, *row.mastered, sources.config.splice));
    }
  });
  return json.text();
}

void write_file(const std::string& path, const std::string& text) {
  OutFile file(path, {.synced = true});
  file.write(text);
  need(file.close(), kBadInput);
}

/// Writes FILE.dat and FILE.src; the module has the name of the file. Existing files may contain points that were
/// corrected by hand, so they are only replaced with --overwrite.
void write_krl(const std::string& path, int set, bool overwrite, int stations_of_slab, const std::vector<Row>& rows) {
  std::filesystem::path base(path);
  base.replace_extension();
  const std::string name = base.filename().string();
  const bool is_name = !name.empty() && name.size() <= 24 && !(name[0] >= '0' && name[0] <= '9') &&
                       std::all_of(name.begin(), name.end(), [](char c) {
                         return (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') || c == '_';
                       });
  if (!is_name)
    stop(kBadInput,
         fmt::format("--krl {}: the name of a KRL module has 1..24 letters, digits and _, and begins with a letter",
                     path));
  for (const char* extension : {".dat", ".src"}) {
    std::error_code fault;
    const std::string file = base.string() + extension;
    if (overwrite || !std::filesystem::exists(std::filesystem::symlink_status(file, fault))) continue;
    stop(kBadInput, fmt::format("--krl {}: {} exists already; name another, or say --overwrite", path, file));
  }
  Stops stops;
  for (const Row& row : rows) stops[row.station] = row.planned;
  write_file(base.string() + ".dat", krl_data_list(name, set, stops));
  write_file(base.string() + ".src", krl_program(name, set, stops, stations_of_slab));
}

int stations(Options& options) {
  options.view.incidence_max_rad = rad_from_deg(options.incidence_deg);
  if (options.no_dither) options.dither = {0.0, 0.0};
  const Sources sources = gather(options);
  Stops taught;
  if (!options.taught.empty()) taught = read_taught(options.taught, sources.stations);
  warn_unconfirmed(sources.recipe);
  const std::vector<Row> rows = plan(options, sources, taught);
  const double look_mm = sources.config.pose.look_mm;
  const bool all_ok = std::all_of(rows.begin(), rows.end(), [&](const Row& row) {
    return row.taught ? row.taught_view.ok(look_mm) : row.view.ok(look_mm);
  });
  if (!options.krl.empty()) write_krl(options.krl, options.set, options.overwrite, sources.recipe.stations(), rows);
  const Alike alike = most_alike(sources, rows);
  if (!is_told_apart(alike.differ))
    fmt::print(
        stderr,
        "warning: stations {} and {} are looked at from alike stops ({:.1f} mm, {:.2f} deg): slabd cannot tell by "
        "the pose that a scan is of the right one; plan stops that differ (docs/SCAN_CHECKS.md)\n",
        alike.station, alike.next, alike.differ.mm, alike.differ.deg);
  if (options.as_json)
    fmt::print("{}", json_of(sources, rows, alike, all_ok));
  else
    fmt::print("{}", table_text(sources, rows));
  return all_ok ? kDone : kNotPass;
}

}  // namespace

void add_stations(args::Command& app) {
  auto options = std::make_shared<Options>();
  args::Command command =
      app.add_subcommand("stations", "Poses of the flange over every block, and their fields of view; KRL points");
  command->footer(
      "\nFrom the recipe, [cell] T_base_slab and the hand-eye calibration in force. A feature counts as seen when it "
      "is\n"
      "inside the scanner's view, met steeply enough and not hidden by the block. With --scanner, the stations are "
      "those\n"
      "that this scanner may scan, in the base of its robot. Run the points in T1 first: the way\n"
      "between them and the arm's reach are not looked at.\n"
      "Exit status: 0 everything is seen from every station (the taught ones, with --taught), 1 not.\n"
      "Examples: slabctl stations --krl SLABPTS2 --set 2     writes SLABPTS2.dat and SLABPTS2.src\n"
      "          slabctl stations --taught SLABPTS2.dat --set 2 --json");
  command->add_option("--config", options->config, "The daemon's configuration")->default_val(default_config());
  options->scanner.add_to(*command);
  command->add_option("--slab-type", options->type, "Slab type (default: the longest slab there is a recipe for)");
  args::Option krl = command->add_option("--krl", options->krl, "Write the points as a KRL data list and a subprogram");
  command->add_flag("--overwrite", options->overwrite, "--krl: even if the files exist")->needs(krl);
  command->add_option("--taught", options->taught, "Compare these points: a KRL .dat or .src, or poses one per line");
  command->add_option("--standoff-mm", options->standoff_mm, "Scanner above the block's origin")
      ->check(within(100.0, 3'000.0))
      ->capture_default_str();
  command->add_option("--turn-deg", options->turn_deg, "Scanner turned about its own axis, against the block's X")
      ->check(within(-180.0, 180.0))
      ->capture_default_str();
  args::Option no_dither =
      command->add_flag("--no-dither", options->no_dither, "All stops alike: a pose then proves no scan");
  command
      ->add_option("--dither-mm", options->dither.mm, "Stops differ from station to station by up to +- this per axis")
      ->check(within(0.0, 20.0))
      ->excludes(no_dither)
      ->capture_default_str();
  command
      ->add_option("--dither-deg", options->dither.deg, "... and are turned about the block by up to +- this per axis")
      ->check(within(0.0, 5.0))
      ->excludes(no_dither)
      ->capture_default_str();
  command->add_option("--set", options->set, "Which of four patterns of stops: a program may change them with the slab")
      ->check(args::range(1, 4))
      ->excludes(no_dither)
      ->capture_default_str();
  ScannerView& view = options->view;
  command->add_option("--view-distance-mm", view.distance_mm, "Distance for the next two")
      ->check(within(50.0, 3'000.0))
      ->capture_default_str();
  command->add_option("--view-x-mm", view.x_mm, "Width of the scanner's view, along its X")
      ->check(within(10.0, 3'000.0))
      ->capture_default_str();
  command->add_option("--view-y-mm", view.y_mm, "... along its Y")->check(within(10.0, 3'000.0))->capture_default_str();
  command->add_option("--near-mm", view.near_mm, "Nearest measured point")
      ->check(within(1.0, 3'000.0))
      ->capture_default_str();
  command->add_option("--far-mm", view.far_mm, "Furthest measured point")
      ->check(within(1.0, 5'000.0))
      ->capture_default_str();
  command->add_option("--incidence-deg", options->incidence_deg, "Between ray and normal, at most")
      ->check(within(10.0, 89.0))
      ->capture_default_str();
  command->add_flag("--json", options->as_json, "Print slabd.stations/1");
  command->runs([options] { return stations(*options); });
}

}  // namespace slabd::cli
