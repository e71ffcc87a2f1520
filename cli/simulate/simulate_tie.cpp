// SPDX-License-Identifier: Apache-2.0
//
// Balls around the slab, as both robots of a line see them. Each robot looks down at every ball from several poses,
// with its scanner where the calibration in force has it. The reported poses and the centres have normally distributed
// errors.
#include "cli/simulate/simulate_tie.h"

#include <fmt/core.h>

#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "calib/calib.h"
#include "cli/command.h"
#include "cli/exit.h"
#include "cli/simulate/simulate_arms.h"
#include "cli/simulate/simulate_calibration.h"
#include "cli/terminal/arguments.h"
#include "cli/terminal/parse.h"
#include "emulator/slab_scene.h"

namespace slabd::cli::simulate {
namespace {

namespace fs = std::filesystem;

constexpr std::uint64_t kTieStream = 31;
/// Places of the balls in the slab frame, mm: two rows beside the blocks, at three heights, over most of the slab.
constexpr double kHalfLength_mm = 2'200.0;
constexpr double kHalfWidth_mm = 600.0;
constexpr double kStep_mm = 90.0;
/// The scanner looks at a ball from about this distance, mm, tilted by up to this angle.
constexpr double kStandoff_mm = 600.0;
constexpr double kTilt_deg = 20.0;

struct Options {
  std::string config;
  std::string out_dir = "simulated-tie";
  std::string T_base_robot;
  int balls = 6;
  int views = 4;
  double robot_sigma_mm = 0.03;
  double target_sigma_mm = 0.005;
  std::uint64_t seed = 1;
};

/// Sightings of one robot, a line each.
struct Tables {
  std::vector<Pose> flange;
  std::vector<Pose> target;
  std::string names;
};

Vec3 normal_vector(Prng& random, double sigma) {
  Vec3 v;
  for (int axis = 0; axis < 3; ++axis) v[axis] = sigma * random.normal();
  return v;
}

Quat turned(const Vec3& rotation_rad) {
  return rotation_from_kuka_abc(rotation_rad.z(), rotation_rad.y(), rotation_rad.x());
}

Vec3 ball_place_mm(const Pose& T_base_slab, int ball, int balls) {
  const double along = balls > 1 ? 2.0 * ball / (balls - 1) - 1.0 : 0.0;
  return T_base_slab *
         Vec3(kHalfLength_mm * along, ball % 2 == 0 ? kHalfWidth_mm : -kHalfWidth_mm, kStep_mm * (ball % 3));
}

Tables look(const Options& options, const Pose& T_base_slab, const Pose& T_base_robot, const Pose& T_flange_scanner,
            std::uint64_t robot) {
  Prng random(emulator::derived_seed(options.seed, kTieStream, robot));
  const auto within = [&](double amplitude) { return amplitude * (2.0 * random.uniform() - 1.0); };
  Tables tables;
  for (int ball = 0; ball < options.balls; ++ball)
    for (int view = 0; view < options.views; ++view) {
      const double tilt = rad_from_deg(kTilt_deg);
      const Quat down = T_base_slab.rotation * rotation_from_kuka_abc(0.0, 0.0, kPi);
      const Quat rotation = down * rotation_from_kuka_abc(2.0 * kPi * view / options.views, within(tilt), within(tilt));
      const Vec3 centre(within(60.0), within(40.0), kStandoff_mm + within(30.0));
      const Pose T_base_scanner{rotation.normalized(),
                                ball_place_mm(T_base_slab, ball, options.balls) - rotation * centre};
      Pose reported = T_base_robot.inverse() * T_base_scanner * T_flange_scanner.inverse();
      reported.translation_mm += normal_vector(random, options.robot_sigma_mm);
      reported.rotation =
          (turned(normal_vector(random, calib::robot_rad_for(options.robot_sigma_mm))) * reported.rotation)
              .normalized();
      tables.flange.push_back(reported);
      tables.target.push_back({Quat::Identity(), centre + normal_vector(random, options.target_sigma_mm)});
      tables.names += fmt::format("ball-{}\n", ball + 1);
    }
  return tables;
}

/// The second robot faces the first one across the slab, unless its place is given.
Pose second_base(const Options& options, const Pose& T_base_slab) {
  if (!options.T_base_robot.empty()) return need(parse_pose(options.T_base_robot), kUsage);
  const Vec3& slab = T_base_slab.translation_mm;
  return {rotation_from_kuka_abc(kPi, 0.0, 0.0), Vec3(2.0 * slab.x(), 2.0 * slab.y(), 0.0)};
}

int write_tie(const Options& options) {
  const config::Config config = config_from(options.config);
  if (!config.arms.several())
    stop(kBadInput, fmt::format("{}: this line has one robot ([[robot]], [[scanner]], [[station]])", config.path));
  const std::vector<Pose> scanners = scanners_in_force(config);
  const Pose T_base_robot = second_base(options, config.T_base_slab);
  const fs::path dir = options.out_dir;
  std::error_code fault;
  fs::create_directories(dir, fault);
  if (fault || !fs::is_empty(dir, fault))
    stop(kUsage, fmt::format("--out {}: cannot be made, or is not empty; name a new folder", options.out_dir));
  for (std::size_t robot = 0; robot < scanners.size(); ++robot) {
    const Tables tables = look(options, config.T_base_slab, robot == 0 ? Pose{} : T_base_robot, scanners[robot], robot);
    const auto write = [&](const char* name, const std::string& text) {
      write_text(dir / fmt::format("{}{}.txt", name, robot + 1), text);
    };
    write("flange", calib::write_poses(tables.flange, calib::PoseFormat{}, calib::TableRole::flange));
    write("target", calib::write_poses(tables.target, calib::PoseFormat{}, calib::TableRole::target));
    write("names", tables.names);
  }
  const Vec3& p = T_base_robot.translation_mm;
  const Quat& q = T_base_robot.rotation;
  fmt::print(
      "{}: {} balls, {} views each of robots {} and {}\nT_base_robot {:.3f} {:.3f} {:.3f} {:.9f} {:.9f} {:.9f} "
      "{:.9f}\n",
      options.out_dir, options.balls, options.views, config.arms.list[0].robot.view(), config.arms.list[1].robot.view(),
      p.x(), p.y(), p.z(), q.w(), q.x(), q.y(), q.z());
  return kDone;
}

}  // namespace

void add_simulate_tie(args::Command& simulate) {
  auto options = std::make_shared<Options>();
  args::Command command =
      simulate.add_subcommand("tie", "Write what two robots see of the same balls, for slabctl calibrate tie");
  command->footer(
      "\nExample: slabctl simulate tie --config slabd.toml --out t\n"
      "         slabctl calibrate tie --config slabd.toml --flange1 t/flange1.txt --target1 t/target1.txt\n"
      "           --names1 t/names1.txt --flange2 t/flange2.txt --target2 t/target2.txt --names2 t/names2.txt\n"
      "           --robot-sigma-mm 0.03 --store --apply --reason \"emulated line\"");
  command->add_option("--config", options->config, "The daemon's configuration, of a line with two robots")
      ->default_val(default_config());
  command->add_option("--out", options->out_dir, "Folder to make; must not hold anything yet")->capture_default_str();
  command->add_option("--T-base-robot", options->T_base_robot,
                      "True base of the second robot in that of the first, \"x y z qw qx qy qz\" (default: opposite, "
                      "turned by 180 degrees)");
  command->add_option("--balls", options->balls, "How many balls")->check(args::range(1, 40))->capture_default_str();
  command->add_option("--views", options->views, "Views of each ball by each robot")
      ->check(args::range(1, 10))
      ->capture_default_str();
  command->add_option("--robot-sigma-mm", options->robot_sigma_mm, "Noise of a reported position per axis")
      ->check(within(0.0, 1.0))
      ->capture_default_str();
  command->add_option("--target-sigma-mm", options->target_sigma_mm, "Noise of a ball's centre per axis")
      ->check(within(0.0, 1.0))
      ->capture_default_str();
  command->add_option("--seed", options->seed, "Decides everything random")->capture_default_str();
  command->runs([options] { return write_tie(*options); });
}

}  // namespace slabd::cli::simulate
