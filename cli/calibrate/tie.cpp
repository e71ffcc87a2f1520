// SPDX-License-Identifier: Apache-2.0
//
// slabctl calibrate tie: computes the place of the second robot's base in the base frame of the line, from balls that
// both robots have measured.
#include <fmt/core.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <filesystem>
#include <memory>

#include "cli/calibrate/calibrate.h"
#include "cli/client/calibration_change.h"
#include "cli/client/record_options.h"
#include "cli/client/scanner_choice.h"
#include "cli/command.h"
#include "cli/exit.h"
#include "cli/terminal/arguments.h"
#include "cli/terminal/parse.h"
#include "cli/terminal/render.h"
#include "cli/terminal/say.h"
#include "daemon/measure.h"
#include "report/json.h"

namespace slabd::cli {
namespace {

/// Tables of one robot.
struct Tables {
  std::string flange;
  std::string target;
  std::string names;
  std::string hand_eye;
};

struct Options {
  std::array<Tables, limits::kArmsMax> robot;
  double robot_sigma_mm = calib::StatedNoise{}.robot_mm;
  double robot_sigma_deg = kNoValue;
  double target_sigma_mm = calib::StatedNoise{}.target_mm;
  double hand_eye_sigma_mm = 0.0;
  double hand_eye_sigma_deg = 0.0;
  std::string certificate;
  bool store = false;
  RecordOptions record;
  LanguageOption language;
  bool json = false;

  [[nodiscard]] bool hand_eyes_given() const { return !robot[0].hand_eye.empty(); }
};

/// Inputs and result.
struct Work {
  std::array<std::string, limits::kArmsMax> robot{"1", "2"};  ///< ids
  std::array<std::string, limits::kArmsMax> hand_eye_id;      ///< empty: given by its numbers
  std::array<calib::TieArm, limits::kArmsMax> arm;
  std::vector<std::string> balls;  ///< names, in the order of the sightings
  std::string observations;
  std::vector<Vec3> slab_mm;  ///< corners of the longest slab, base frame; empty without a configuration
  calib::Tie tie;
  calib::StatedNoise noise;
};

std::string ball_name(const Work& work, std::size_t target) {
  return target < work.balls.size() ? work.balls[target] : std::to_string(target + 1);
}

void read_sightings(const Tables& tables, std::size_t robot, Work& work) {
  const std::string flange_text = need(text_file(tables.flange), kBadInput);
  const std::string target_text = need(text_file(tables.target), kBadInput);
  const std::string names_text = tables.names.empty() ? "" : need(text_file(tables.names), kBadInput);
  const auto flange = need(calib::parse_poses(flange_text, tables.flange, calib::TableRole::flange), kBadInput);
  const auto target = need(calib::parse_poses(target_text, tables.target, calib::TableRole::target), kBadInput);
  const auto views =
      need(calib::views_from(calib::ArtefactKind::ball, flange, tables.flange, target, tables.target), kBadInput);
  const std::vector<std::string> names = calib::parse_target_names(names_text);
  const auto sightings = calib::tie_sightings(views, target.format.labelled, names, work.balls);
  if (!sightings)
    stop(kBadInput, fmt::format("{}: {}", tables.names.empty() ? tables.target : tables.names,
                                retold(sightings.error().text.view())));
  work.arm[robot].sightings = sightings.value();
  work.arm[robot].noise = work.noise;
  work.observations += fmt::format("# robot {}: flange poses, ball centres, names\n{}\n{}\n{}\n", work.robot[robot],
                                   flange_text, target_text, names_text);
}

/// Takes the hand-eye calibrations from the options. A tie of these is not kept, because a record names the
/// calibrations that it belongs to.
void take_given_hand_eyes(const Options& options, Work& work) {
  for (std::size_t robot = 0; robot < work.arm.size(); ++robot) {
    const Result<Pose> pose = parse_pose(options.robot[robot].hand_eye);
    if (!pose) stop(kUsage, fmt::format("--hand-eye{}: {}", robot + 1, retold(pose.error().text.view())));
    work.arm[robot].hand_eye = {pose.value(), options.hand_eye_sigma_mm, rad_from_deg(options.hand_eye_sigma_deg)};
  }
}

/// Takes those in force for the two scanners of the line, otherwise the commissioning values.
void take_hand_eyes_in_force(const config::Config& config, Work& work) {
  if (!config.arms.several())
    stop(kBadInput,
         say("{}: this line has one robot; a tie needs two ([[robot]], [[scanner]], [[station]])", config.path));
  const std::unique_ptr<storage::Reader> reader = open_records(config);
  for (std::size_t robot = 0; robot < work.arm.size(); ++robot) {
    const std::string scanner = scanner_of_arm(config, robot);
    work.robot[robot] = config.arms.list[robot].robot.view();
    HandEyeNumbers& numbers = work.arm[robot].hand_eye;
    const auto current =
        reader == nullptr ? std::nullopt : need(reader->current(CalibrationKind::hand_eye, 0, scanner));
    if (current) {
      work.hand_eye_id[robot] = current->id;
      numbers = std::get<HandEyeNumbers>(current->numbers);
      continue;
    }
    const calib::Calibration& commissioning = config.arm(robot).calibration;
    if (commissioning.id.empty())
      stop(kRefused, say("scanner {} has no hand-eye calibration, and a tie holds for two only: calibrate it, then "
                         "slabctl calibrate apply --scanner {}",
                         scanner, scanner));
    work.hand_eye_id[robot] = commissioning.id.view();
    numbers = {commissioning.T_flange_scanner, commissioning.station_sigma_mm, commissioning.station_sigma_rad};
  }
}

void find_slab(const config::Config& config, Work& work) {
  std::vector<Recipe> recipes;
  std::vector<config::Problem> problems;  // of recipes that are not needed here; `recipe check` names them
  config::load_recipes(config.recipes_dir, recipes, problems);
  const auto longest = std::max_element(recipes.begin(), recipes.end(), [](const Recipe& a, const Recipe& b) {
    return a.slab.length_mm.value < b.slab.length_mm.value;
  });
  if (longest == recipes.end()) return;
  for (const double x : {-0.5, 0.5})
    for (const double y : {-0.5, 0.5})
      work.slab_mm.push_back(config.T_base_slab * Vec3(x * longest->slab.length_mm.value,
                                                       y * longest->slab.seat_centre_distance_mm.value, 0.0));
}

/// Uncertainty by the tie where it is largest on the slab, k = 1, in space; NaN if it is not known.
double at_the_far_end_mm(const Work& work) {
  double largest = kNoValue;
  if (!work.tie.determined) return largest;
  for (const Vec3& corner : work.slab_mm) {
    const double sigma = calib::tie_sigma_mm(work.tie.numbers, corner);
    if (!(sigma <= largest)) largest = sigma;
  }
  return largest;
}

std::string as_json(const Work& work, const Kept& kept) {
  const calib::Tie& tie = work.tie;
  report::Json json("slabd.tie/1");
  json.field("software", daemon::software_version()).field("status", tie.ok ? "ok" : "refused");
  json.field("id", report::only_if(!kept.id.empty(), kept.id)).field("applied", kept.applied);
  json.field("robots", work.robot).field("hand_eye_ids", work.hand_eye_id);
  json.field("T_base_robot", report::only_if(tie.determined, tie.numbers.T_base_robot));
  json.field("centre_mm", report::only_if(tie.determined, tie.numbers.centre_mm));
  json.field("covariance", report::only_if(tie.determined, tie.numbers.covariance));
  json.field("residual_mm", tie.residual_mm).field("leave_one_out_mm", tie.leave_one_out_mm);
  json.field("s0", tie.s0).field("degrees_of_freedom", tie.degrees_of_freedom).field("condition", tie.condition);
  json.field("spread_axes_mm", tie.spread_axes_mm).field("far_end_sigma_mm", at_the_far_end_mm(work));
  json.list("targets", tie.targets, [&](const calib::TieTarget& target) {
    json.field("name", ball_name(work, target.target)).field("views", target.views);
    json.field("p_base_mm", target.p_base).field("residual_mm", target.residual_mm);
    json.field("leave_one_out_mm", target.leave_one_out_mm).field("sigmas", target.sigmas);
  });
  json.list("seen_by_one", tie.seen_by_one, [&](const std::size_t target) { return ball_name(work, target); });
  json.key("stated_noise").begin_object().field("robot_sigma_mm", work.noise.robot_mm);
  json.field("robot_sigma_deg", deg_from_rad(work.noise.robot_rad)).field("target_sigma_mm", work.noise.target_mm);
  json.end_object();
  json.list("reasons", tie.reasons, [&](const calib::TieReason& reason) {
    json.field("code", reason.code).field("text", reason.text).field("cure", reason.cure);
  });
  return json.text();
}

std::string number(double value, int digits) {
  return has_value(value) ? fmt::format("{:.{}f}", value, digits) : "-";
}

std::string as_text(const Work& work) {
  const calib::Tie& tie = work.tie;
  std::string text = say("{} balls seen by robots {} and {}; hand-eye {} and {}\n\n", tie.targets.size(), work.robot[0],
                         work.robot[1], work.hand_eye_id[0].empty() ? say("given") : work.hand_eye_id[0],
                         work.hand_eye_id[1].empty() ? say("given") : work.hand_eye_id[1]);
  report::Table table{say("ball<"), say("views"), say("residual (mm)"), say("leave-one-out (mm)"), say("sigmas")};
  for (const calib::TieTarget& target : tie.targets)
    table.add(ball_name(work, target.target), fmt::format("{} + {}", target.views[0], target.views[1]),
              number(target.residual_mm, 3), number(target.leave_one_out_mm, 3), number(target.sigmas, 1));
  if (!tie.targets.empty()) text += report::text_of(table) + "\n";
  for (const std::size_t target : tie.seen_by_one)
    text += say("ball {} was seen by one robot only and is not used\n", ball_name(work, target));
  if (!tie.determined) return text + say("the base of the second robot is not determined by these balls\n");
  text += say("T_base_robot maps coordinates of robot {} to the base frame of the line\n", work.robot[1]) +
          pose_in_three_forms(tie.numbers.T_base_robot);
  const Mat6& c = tie.numbers.covariance;
  const auto sigma = [&](int axis) { return std::sqrt(c(axis, axis)); };
  text += say("residuals rms {:.3f} mm, {:.2f} times the stated noise; condition {:.3g} (at most {:.0f})\n",
              tie.residual_mm.rms, tie.s0, tie.condition, calib::kTieConditionMax);
  text +=
      say("sigma of the base in the middle of the balls {:.3f} / {:.3f} / {:.3f} mm, {:.4f} / {:.4f} / {:.4f} deg\n",
          sigma(0), sigma(1), sigma(2), deg_from_rad(sigma(3)), deg_from_rad(sigma(4)), deg_from_rad(sigma(5)));
  if (const double far_mm = at_the_far_end_mm(work); has_value(far_mm))
    text += say("sigma at the far end of the slab {:.3f} mm in space (k = 1)\n", far_mm);
  return text;
}

void complain_of_reasons(const calib::Tie& tie) {
  for (const calib::TieReason& reason : tie.reasons)
    complain(say("refused ({}): {}\n  what to do: {}", name(reason.code), quote(reason.text), quote(reason.cure)));
}

calib::StatedNoise noise_of(const Options& options) {
  calib::StatedNoise noise;
  noise.robot_mm = options.robot_sigma_mm;
  noise.robot_rad = has_value(options.robot_sigma_deg) ? rad_from_deg(options.robot_sigma_deg)
                                                       : calib::robot_rad_for(options.robot_sigma_mm);
  noise.target_mm = options.target_sigma_mm;
  return noise;
}

int calibrate_tie(const Options& options) {
  set_language(options.language, options.json);
  if (options.robot[0].hand_eye.empty() != options.robot[1].hand_eye.empty())
    stop(kUsage, say("give --hand-eye1 and --hand-eye2, or neither: then those in force count"));
  if (options.robot[0].names.empty() != options.robot[1].names.empty())
    stop(kUsage, say("give --names1 and --names2, or neither"));
  if (options.hand_eyes_given() && options.store)
    stop(kUsage, say("--store keeps a tie of the hand-eye calibrations in force: no --hand-eye1, --hand-eye2 with it"));
  Work work;
  work.noise = noise_of(options);
  config::Config config;
  if (options.hand_eyes_given()) {
    take_given_hand_eyes(options, work);
    std::error_code fault;
    if (std::filesystem::exists(options.record.config, fault) && config_from(options.record.config, config))
      find_slab(config, work);
  } else {
    config = config_from(options.record.config);
    finish_killed_change(config);
    take_hand_eyes_in_force(config, work);
    find_slab(config, work);
  }
  for (std::size_t robot = 0; robot < work.arm.size(); ++robot) read_sightings(options.robot[robot], robot, work);
  work.tie = need(calib::solve_tie(work.arm[0], work.arm[1], work.balls), kBadInput);
  work.tie.numbers.robot.assign(work.robot[1]);
  Kept kept;
  if (!options.json) fmt::print("{}", as_text(work));
  if (!work.tie.ok) {
    if (options.json) fmt::print("{}", as_json(work, kept));
    complain_of_reasons(work.tie);
    return kRefused;
  }
  if (options.store) {
    storage::CalibrationRecord record;
    options.record.describe(config, record);
    record.scanner = storage::CalibrationRecord{}.scanner;  // of no scanner in particular
    record.numbers = work.tie.numbers;
    record.parent_id = tie_parent(CalibrationId(work.hand_eye_id[0]), CalibrationId(work.hand_eye_id[1])).view();
    record.observations = work.observations;
    if (!options.certificate.empty()) record.certificate = need(text_file(options.certificate), kBadInput);
    record.figures = as_json(work, kept);
    kept = keep_record(config, options.record, record);
  }
  if (options.json) {
    fmt::print("{}", as_json(work, kept));
  } else if (options.store && kept.status == kDone) {
    fmt::print("{}", kept_text(kept, false));
  }
  return kept.status;
}

constexpr const char* kFooter = R"(
Fix six to eight balls in the cell, spread over the length of the slab and to both sides, where both robots reach them.
Measure every ball with both robots, each through its own scanner, from several poses. FLANGE and TARGET are tables as
of `calibrate solve --kind ball`, the flange poses in the base of the robot itself. The balls are told apart by labels in
the target tables (labels=view,ball), by names (one for each line of the target table, equal names are one ball),
otherwise by their order: line K of both tables is ball K.

A tie holds for the two hand-eye calibrations it was solved with. Apply these first; after a new one tie again.
A refused result prints the same figures, says why and what to do, and ends with status 6.

Example: slabctl calibrate tie --flange1 f1.txt --target1 t1.txt --names1 n1.txt --flange2 f2.txt --target2 t2.txt
           --names2 n2.txt --store --apply --reason "second robot")";

}  // namespace

void add_calibrate_tie(args::Command& group) {
  auto options = std::make_shared<Options>();
  args::Command command =
      group.add_subcommand("tie", "Base of the second robot in the base frame, from balls that both robots measured");
  command->footer(kFooter);
  for (std::size_t robot = 0; robot < options->robot.size(); ++robot) {
    Tables& tables = options->robot[robot];
    const std::string n = std::to_string(robot + 1);
    const std::string of = robot == 0 ? " of the first robot" : " of the second robot";
    command->add_option("--flange" + n, tables.flange, "Table of T_base_flange" + of)->required();
    command->add_option("--target" + n, tables.target, "Table of ball centres" + of)->required();
    command->add_option("--names" + n, tables.names, "Names of the balls, a line for each line of its target table");
    command->add_option("--hand-eye" + n, tables.hand_eye,
                        "T_flange_scanner" + of + ", \"x y z qw qx qy qz\" (default: that in force)");
  }
  command
      ->add_option("--hand-eye-sigma-mm", options->hand_eye_sigma_mm,
                   "With --hand-eye1: sigma of a point in the field of view, per axis, mm")
      ->check(at_least(0.0))
      ->capture_default_str();
  command
      ->add_option("--hand-eye-sigma-deg", options->hand_eye_sigma_deg,
                   "With --hand-eye1: sigma of the scanner's rotation, per axis, deg")
      ->check(at_least(0.0))
      ->capture_default_str();
  command->add_option("--robot-sigma-mm", options->robot_sigma_mm, "Robots' position noise per axis")
      ->check(at_least(0.0))
      ->capture_default_str();
  command
      ->add_option("--robot-sigma-deg", options->robot_sigma_deg,
                   "Robots' rotation noise per axis; default 0.0023 per 0.06 mm of their position noise")
      ->check(at_least(0.0));
  command->add_option("--target-sigma-mm", options->target_sigma_mm, "Noise of a ball's centre")
      ->check(at_least(0.0))
      ->capture_default_str();
  command->add_option("--certificate", options->certificate, "Text about the balls that is kept with the tie");
  command->add_option("--config", options->record.config, "The daemon's configuration")->default_val(default_config());
  args::Option store = command->add_flag("--store", options->store, "Keep the tie as a record");
  options->record.add_origin_to(*command);
  args::Option apply = command->add_flag("--apply", options->record.apply, "Put it in force at once")->needs(store);
  command->add_option("--reason", options->record.why, "Why it is put in force, for the history")
      ->check(some_words())
      ->needs(apply);
  options->language.add_to(*command, "Language of the text");
  command->add_flag("--json", options->json, "Print slabd.tie/1 on stdout");
  command->runs([options] { return calibrate_tie(*options); });
}

}  // namespace slabd::cli
