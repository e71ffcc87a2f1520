// SPDX-License-Identifier: Apache-2.0
#include "cli/simulate/simulate_calibration.h"

#include <fmt/core.h>
#include <unistd.h>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <memory>
#include <optional>
#include <sstream>

#include "calib/calib.h"
#include "cli/command.h"
#include "cli/exit.h"
#include "cli/simulate/calibration_live.h"
#include "cli/simulate/mastered_slab.h"
#include "cli/terminal/arguments.h"
#include "cli/terminal/parse.h"
#include "hal/hal.h"
#include "report/json.h"

namespace slabd::cli::simulate {
namespace {

namespace fs = std::filesystem;
using report::Json;

std::string shot_name(int shots, int view, int shot) {
  return shots == 1 ? fmt::format("view_{:02}.ply", view) : fmt::format("view_{:02}_{}.ply", view, shot);
}

void write_robot(report::Json& json, const emulator::RobotErrorTraits& robot) {
  json.key("robot").begin_object().field("seed", robot.seed).field("smooth_mm", robot.smooth_mm);
  json.field("smooth_length_mm", robot.smooth_length_mm).field("smooth_deg", deg_from_rad(robot.smooth_rad));
  json.field("repeat_mm", robot.repeat_mm).field("repeat_deg", deg_from_rad(robot.repeat_rad)).end_object();
}

void write_scan_traits(report::Json& json, const CalibrationScanTraits& scan) {
  json.key("scanner").begin_object().field("columns", scan.columns).field("rows", scan.rows);
  json.field("noise_mm", scan.noise_mm).field("correlated_mm", scan.correlated_mm);
  json.field("correlation_length_mm", scan.correlation_length_mm).field("flyer_share", scan.flyer_share);
  json.field("outlier_share", scan.outlier_share).field("missing_share", scan.missing_share);
  json.field("projector_mm", scan.projector_mm).field("hidden_share", scan.hidden_share).end_object();
}

void write_view(report::Json& json, const CalibrationScene& scene, const Pose& reported, std::uint64_t visit,
                const std::vector<std::string>& files) {
  const Pose T_scanner_target = scene.T_scanner_target(reported, visit);
  json.begin_object().field("files", files).field("T_base_flange_reported", reported);
  json.field("T_base_flange_real", scene.robot().real(reported, visit)).field("T_scanner_target", T_scanner_target);
  json.key("balls_mm").begin_array();
  for (const Vec3& ball : scene.certificate().balls_mm) json.value(Vec3(T_scanner_target * ball));
  json.end_array().end_object();
}

/// Requires a new or empty folder, because a mix of an old and a new set would give a wrong calibration.
void make_folder(const fs::path& dir) {
  std::error_code fault;
  fs::create_directories(dir, fault);
  if (fault || !fs::is_directory(dir, fault))
    cli::stop(cli::kUsage, fmt::format("--out {}: cannot be made: {}", dir.string(), fault.message()));
  if (!fs::is_empty(dir, fault))
    cli::stop(cli::kUsage, fmt::format("--out {}: is not empty; name a new folder", dir.string()));
}

/// Takes hand-eye calibration and slab position from the daemon's configuration.
void take_cell(const std::string& path, CalibrationTraits& scene) {
  const config::Config config = cli::config_from(path);
  if (!config.calibration.id.empty()) scene.T_flange_scanner = config.calibration.T_flange_scanner;
  scene.T_base_target = config.T_base_slab;
}

}  // namespace

void write_text(const std::filesystem::path& path, const std::string& text) {
  std::ofstream file(path, std::ios::binary);
  file << text;
  if (!file.flush()) cli::stop(cli::kNotReachable, fmt::format("{} cannot be written", path.string()));
}

std::optional<std::string> text_of(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  if (!file) return std::nullopt;
  std::ostringstream text;
  text << file.rdbuf();
  return text.str();
}

Result<std::vector<Pose>> poses_in(const std::string& path) {
  const std::optional<std::string> text = text_of(path);
  if (!text) return error(Code::config, "%s cannot be read", path.c_str());
  Result<calib::PoseTable> table = calib::parse_poses(*text, path, calib::TableRole::flange);
  if (!table) return table.error();
  return std::move(table.value().poses);
}

void write_calibration_truth(const CalibrationScene& scene, const CalibrationScanTraits& scan,
                             std::span<const Pose> views, int shots, const std::string& out_dir) {
  const fs::path dir = out_dir;
  const CalibrationTraits& traits = scene.traits();
  make_folder(dir);
  report::Json json("slabd.calibration_truth/1");
  json.field("kind", traits.kind).field("seed", traits.seed);
  json.field("ball_radius_mm", scene.certificate().balls_mm.empty() ? kNoValue : traits.ball_radius_mm);
  json.field("T_flange_scanner", traits.T_flange_scanner).field("T_base_target", traits.T_base_target);
  write_robot(json, scene.robot().traits());
  write_scan_traits(json, scan);
  json.key("views").begin_array();
  for (std::size_t i = 0; i < views.size(); ++i) {
    std::vector<std::string> files;
    for (int shot = 1; shot <= shots; ++shot) files.push_back(shot_name(shots, static_cast<int>(i + 1), shot));
    write_view(json, scene, views[i], i + 1, files);
  }
  write_text(dir / "flange.txt", calib::write_poses(views, calib::PoseFormat{}, calib::TableRole::flange));
  write_text(dir / "truth.json", json.text());
  if (traits.kind == TargetKind::artefact)
    write_text(dir / "certificate.txt", calib::certificate_text(scene.certificate()));
}

/// Writes the certificate of the drawn block, which is equal to its recipe.
void write_block_certificate(const Recipe& recipe, const fs::path& dir) {
  constexpr std::int64_t kCertifiedUtime_us = 1'767'225'600'000'000;  // 2026-01-01: the same recipe gives the same file
  const std::string text = fmt::format(
      "# the emulated reference block; read by: slabctl calibrate reference --certificate\n"
      "id = emulated-block\ndate = {:.10}\nslope_deg = {:.6f}\nslope_U_deg = 0.0005\njaw_distance_mm = {:.4f}\n"
      "jaw_distance_U_mm = 0.002\n",
      report::iso_time(kCertifiedUtime_us), deg_from_rad(std::atan(1.0 / recipe.block.cant_ratio.value)),
      2.0 * recipe.block.jaw_half_distance_mm.value);
  write_text(dir / "certificate.txt", text);
}

int write_calibration(const CalibrationOrder& order) {
  std::optional<Recipe> recipe;
  if (order.scene.kind == TargetKind::block) {
    recipe = cli::recipe_from(order.recipe);
  }
  const CalibrationScene scene =
      cli::need(CalibrationScene::make(order.scene, recipe ? &*recipe : nullptr), cli::kUsage);
  const fs::path dir = order.out_dir;
  std::vector<Pose> poses = scene.plan_views(order.views);
  if (!order.poses_file.empty()) poses = cli::need(poses_in(order.poses_file), cli::kBadInput);
  write_calibration_truth(scene, order.scan, poses, order.shots, order.out_dir);
  if (recipe) write_block_certificate(*recipe, dir);

  std::vector<float> xyz;
  const bool terminal = isatty(STDERR_FILENO) != 0;
  for (std::size_t view = 1; view <= poses.size(); ++view) {
    if (terminal) fmt::print(stderr, "\r\x1b[Kview {}/{}", view, poses.size());
    for (int shot = 1; shot <= order.shots; ++shot) {
      const Result<emulator::DrawnScan> drawn =
          scene.draw(poses[view - 1], view, order.scan, xyz, static_cast<std::uint64_t>(shot - 1));
      if (!drawn) cli::stop(cli::kUsage, fmt::format("view {}: {}", view, drawn.error().text.view()));
      const std::string path = (dir / shot_name(order.shots, static_cast<int>(view), shot)).string();
      const Status written = hal::write_scan(path.c_str(), hal::ScanFormat::ply, xyz, drawn.value().width,
                                             drawn.value().height, {.emulator = true});
      if (!written) cli::stop(cli::kNotReachable, written.error().text.view());
    }
  }
  if (terminal) fmt::print(stderr, "\r\x1b[K");
  fmt::print(
      "{}: {} views of the {}, flange.txt, {}truth.json\n", order.out_dir, poses.size(), name(order.scene.kind),
      order.scene.kind == TargetKind::artefact || order.scene.kind == TargetKind::block ? "certificate.txt, " : "");
  return cli::kDone;
}

void add_simulate_calibration(args::Command& simulate) {
  struct Options {
    CalibrationOrder order;
    std::string kind = "ball";
    std::string T_flange_scanner;
    std::string T_base_target;
    double repeat_deg = -1.0;
    double smooth_deg = -1.0;
    bool full = false;
    bool unorganised = false;
    bool bare = false;
    bool live = false;
    CalibrationLiveOrder running;
  };
  auto options = std::make_shared<Options>();
  CalibrationOrder& order = options->order;
  args::Command command =
      simulate.add_subcommand("calibration", "Write the scans of a calibration, the robot's poses and the truth");
  command->footer(
      "\nball       a tooling ball on its post, with table, wall, rod and a foreign ball around\n"
      "artefact   three balls on a frame, with a certificate\n"
      "block      the reference block, drawn from the recipe, from near its nominal view\n"
      "plate      a flat plate, for slabctl scanner verify\n"
      "slab       a mastered slab: what five rounds over its stations saw (visits.txt), with its certificate\n\n"
      "--live: nothing is written; robot and scanner of a running daemon stand before the target instead. The robot "
      "goes\n"
      "on when the daemon has scanned a view, so that slabctl calibrate capture --live is all there is to do.\n\n"
      "Example: slabctl simulate calibration --kind ball --out set --views 20 --seed 1\n"
      "         slabctl calibrate ball set/view_*.ply --radius 25.4 --target set/target.txt\n"
      "         slabctl calibrate solve --kind ball --flange set/flange.txt --target set/target.txt");
  command->add_option("--kind", options->kind, "Target of the calibration: ball, artefact, block, plate or slab")
      ->check(args::one_of({"ball", "artefact", "block", "plate", "slab"}))
      ->capture_default_str();
  command->add_option(
      "--out", order.out_dir,
      "Folder to make, default: simulated-KIND; must not hold anything yet (--live: for truth and certificate "
      "alone, default: none)");
  args::Option views = command->add_option("--views", order.views, "How many (kind slab: rounds, then 5)")
                           ->check(args::range(1, 400))
                           ->capture_default_str();
  CalibrationLiveOrder& running = options->running;
  args::Option live = command->add_flag("--live", options->live, "Be robot and scanner of a running daemon");
  args::Option config = command
                            ->add_option("--config", running.config,
                                         "The daemon's configuration; T_flange_scanner and the slab's place in "
                                         "it are taken as true")
                            ->default_val(cli::default_config());
  running.scanner.add_to(command);
  args::Option poses =
      command->add_option("--poses", order.poses_file, "The views, one T_base_flange a line, instead of a plan");
  command
      ->add_option("--follow", running.follow_file,
                   "--live: the robot goes to the last line of this file whenever it changes")
      ->needs(live)
      ->excludes(poses);
  command->add_option("--move-s", running.move_s, "--live: time from one view to the next")
      ->check(cli::within(0.0, 60.0))
      ->capture_default_str();
  command
      ->add_option("--warm-up-s", running.warming.time_constant_s,
                   "--live: time constant with which the scanner warms up; it states its temperature. 0: warm")
      ->check(cli::within(0.0, 100'000.0))
      ->capture_default_str();
  command->add_option("--warm-up-K", running.warming.rise_K, "With --warm-up-s: rise of its temperature")
      ->check(cli::within(0.0, 60.0))
      ->capture_default_str();
  args::Option shots = command->add_option("--shots", order.shots, "Scans at every pose (--live: 3 if not given)")
                           ->check(args::range(1, 9))
                           ->capture_default_str();
  command->add_option("--seed", order.scene.seed, "Decides everything random")->capture_default_str();
  command->add_option("--recipe", order.recipe, "Recipe of the reference block (kind block)");
  command->add_option("--ball-radius-mm", order.scene.ball_radius_mm, "Radius of the balls")
      ->check(cli::within(5.0, 35.0))
      ->capture_default_str();
  command->add_option("--T-flange-scanner", options->T_flange_scanner, "True hand-eye, \"x y z qw qx qy qz\"");
  command->add_option("--T-base-target", options->T_base_target, "Pose of the target, \"x y z qw qx qy qz\"");
  command
      ->add_option("--robot-mm", order.scene.robot.smooth_mm,
                   "Error of the reported position per axis, smooth over the cell (absolute accuracy)")
      ->check(cli::within(0.0, 10.0))
      ->capture_default_str();
  command->add_option("--robot-length-mm", order.scene.robot.smooth_length_mm, "Length over which it changes")
      ->check(cli::within(50.0, 10'000.0))
      ->capture_default_str();
  command->add_option("--robot-deg", options->smooth_deg, "Smooth error of rotation (default: --robot-mm over 1.5 m)")
      ->check(cli::within(0.0, 5.0));
  command->add_option("--robot-sigma-mm", order.scene.robot.repeat_mm, "Repeatability per axis, new at every pose")
      ->check(cli::within(0.0, 10.0))
      ->capture_default_str();
  command
      ->add_option("--robot-sigma-deg", options->repeat_deg,
                   "Repeatability of rotation (default: --robot-sigma-mm over 1.5 m)")
      ->check(cli::within(0.0, 1.0));
  CalibrationScanTraits& scan = order.scan;
  command->add_flag("--full", options->full, "5 million points a scan instead of half a million");
  command->add_option("--noise-mm", scan.noise_mm, "White noise along the rays")
      ->check(cli::within(0.0, 1.0))
      ->capture_default_str();
  command->add_option("--correlated-mm", scan.correlated_mm, "Noise that neighbouring points have in common")
      ->check(cli::within(0.0, 1.0))
      ->capture_default_str();
  command->add_option("--noise-correlation-mm", scan.correlation_length_mm, "Length over which it hangs together")
      ->check(cli::within(0.1, 20.0))
      ->capture_default_str();
  command->add_option("--flyers", scan.flyer_share, "Share of the pixels at edges that lie between front and back")
      ->check(cli::within(0.0, 1.0))
      ->capture_default_str();
  command->add_option("--hidden", scan.hidden_share, "Share of every ball hidden behind a plate")
      ->check(cli::within(0.0, 1.0))
      ->capture_default_str();
  command->add_flag("--unorganised", options->unorganised, "Write only the points that returned, without their grid");
  command->add_flag("--bare", options->bare, "Without table, wall, rod and foreign ball");
  command->runs([options, views, shots, config] {
    CalibrationOrder& o = options->order;
    const auto pose_option = [](const std::string& text, const char* option, Pose& pose) {
      if (text.empty()) return;
      const Result<Pose> parsed = cli::parse_pose(text);
      if (!parsed) cli::stop(cli::kUsage, fmt::format("{}: {}", option, parsed.error().text.view()));
      pose = parsed.value();
    };
    pose_option(options->T_flange_scanner, "--T-flange-scanner", o.scene.T_flange_scanner);
    pose_option(options->T_base_target, "--T-base-target", o.scene.T_base_target);
    o.scene.kind = options->kind == "artefact" ? TargetKind::artefact
                   : options->kind == "block"  ? TargetKind::block
                   : options->kind == "plate"  ? TargetKind::plate
                                               : TargetKind::ball;
    const bool slab = options->kind == "slab";
    if ((o.scene.kind == TargetKind::block || slab) && o.recipe.empty())
      cli::stop(cli::kUsage,
                fmt::format("--kind {}: --recipe gives the shape of the {}", options->kind, options->kind));
    if (slab && options->live)
      cli::stop(cli::kUsage,
                "--kind slab --live: a mastered slab is inspected by the line; slabctl simulate --same-slab "
                "--certificate-out plays that");
    o.scene.robot.seed = o.scene.seed;
    if (options->smooth_deg >= 0.0) o.scene.robot.smooth_rad = rad_from_deg(options->smooth_deg);
    if (options->repeat_deg >= 0.0) o.scene.robot.repeat_rad = rad_from_deg(options->repeat_deg);
    if (options->full) {
      o.scan.columns = CalibrationScanTraits::full().columns;
      o.scan.rows = CalibrationScanTraits::full().rows;
    }
    o.scan.organised = !options->unorganised;
    o.scene.clutter = !options->bare;
    if (options->live) {
      CalibrationLiveOrder& line = options->running;
      line.scene = o.scene;
      line.scan = o.scan;
      line.recipe = o.recipe;
      line.out_dir = o.out_dir;
      line.views = o.views;
      if (shots.count() > 0) line.shots = o.shots;
      line.poses_file = o.poses_file;
      line.keep_flange = !options->T_flange_scanner.empty();
      line.keep_target = !options->T_base_target.empty();
      return run_calibration_live(line);
    }
    if (o.out_dir.empty()) o.out_dir = "simulated-" + options->kind;
    if (options->kind == "slab") {
      if (views.count() == 0) o.views = 5;
      if (config.count() > 0) take_cell(options->running.config, o.scene);
      return write_mastered_slab(o);
    }
    return write_calibration(o);
  });
}

}  // namespace slabd::cli::simulate
