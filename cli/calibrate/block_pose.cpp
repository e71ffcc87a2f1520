// SPDX-License-Identifier: Apache-2.0
//
// slabctl calibrate block: a supporting block, or the reference block, as an artefact with a full pose. Its pose in a
// scan is that of the registration of every inspection, computed by the same code.
//
// A registration requires a start pose to about 15 mm and 3 degrees, and the views of a calibration are tilted to all
// sides. The first view looks straight down as on the line. For the next ones the start pose follows from the robot's
// poses and the approximate scanner pose. From kViewsMin views on, the scanner pose is the solution of the views so
// far.
#include <fmt/core.h>
#include <memory>
#include <span>

#include "algo/algo.h"
#include "base/durable.h"
#include "base/pages.h"
#include "cli/calibrate/calibrate.h"
#include "cli/client/record_options.h"
#include "cli/command.h"
#include "cli/exit.h"
#include "cli/terminal/arguments.h"
#include "cli/terminal/parse.h"
#include "cli/terminal/say.h"
#include "daemon/measure.h"

namespace slabd::cli {
namespace {

struct Options {
  std::vector<std::string> scans;
  std::string recipe;
  std::string flange;
  std::string start;
  std::string config;
  ScannerChoice scanner;
  std::string target;
  ScanFormOptions form;
  LanguageOption language;
  bool json = false;
};

/// Approximate scanner pose: from --start, otherwise from the configuration.
Pose find_start(const Options& options) {
  if (!options.start.empty()) return need(calib::parse_flange("", options.start, "--start"));
  config::Config config;
  if (!config_from(options.config, config))
    stop(kUsage, say("--start gives the rough pose of the scanner (T_flange_scanner), or --config where to read it"));
  return hand_eye_in_force(options.scanner.of(std::move(config))).T_flange_scanner;
}

/// Finds the block's pose in a scan.
class BlockFinder {
 public:
  explicit BlockFinder(const Recipe& recipe)
      : memory_(limits::kScanSlotBytes),
        xyz_(memory_.take<float>(limits::kScanPointsMax * 3)),
        clock_(hal::make_system_clock()),
        inspector_(config::default_measure_threads()) {
    inspector_.use(recipe);
  }

  /// `T_block_scanner`: start pose of the registration.
  Result<RegistrationReport> find(const std::string& path, const hal::ScanForm& form, const Pose& T_block_scanner) {
    const Result<ScanShape> read = hal::read_scan(path.c_str(), form, xyz_, inspector_.team());
    if (!read.ok()) return read.error();
    const ScanShape& shape = read.value();
    const algo::Cloud cloud{xyz_, shape.points, shape.width, shape.height};
    // Items that cannot be measured from this direction are ignored, because only the registration is used.
    const Status measured =
        daemon::measure_block(inspector_, *clock_, 1, Pose::identity(), T_block_scanner, cloud, shape, 0.0);
    why_not_ = measured.ok() ? "" : code_text(measured.error().code, measured.error().text.view());
    return inspector_.result().registration;
  }
  /// Reason why the block was not found, with hints from the scan's size and position about its unit and frame.
  [[nodiscard]] const std::string& why_not() const { return why_not_; }

 private:
  Pages memory_;
  std::span<float> xyz_;
  std::unique_ptr<hal::Clock> clock_;
  algo::BlockInspector inspector_;
  std::string why_not_;
};

/// Updates the poses of scanner and block from the views so far; does nothing with fewer than kViewsMin views.
void learn(std::span<const calib::View> views, Pose& X, Pose& T_base_block) {
  if (views.size() < calib::kViewsMin) return;
  calib::SolveSettings quick;
  quick.convention_test = false;
  const Result<calib::HandEye> solved = calib::solve(calib::ArtefactKind::pose, views, {}, quick);
  if (!solved.ok() || !solved.value().determined) return;
  X = solved.value().T_flange_scanner;
  T_base_block = solved.value().targets.front();
}

int run_block(const Options& options) {
  set_language(options.language, options.json);
  const Recipe recipe = recipe_from(options.recipe);
  const std::string text = need(text_file(options.flange));
  const calib::PoseTable flange = need(calib::parse_poses(text, options.flange, calib::TableRole::flange));
  if (flange.poses.size() < options.scans.size())
    stop(kBadInput, say("{}: {} poses for {} scans; one line for each scan, in their order", options.flange,
                        flange.poses.size(), options.scans.size()));
  Pose X = find_start(options);

  BlockFinder finder(recipe);
  std::vector<calib::View> views;
  Pose T_base_block = flange.poses.front() * X * nominal_T_block_scanner().inverse();
  report::Json json("slabd.block_poses/1");
  json.field("recipe", recipe.name).key("views").begin_array();
  for (std::size_t i = 0; i < options.scans.size(); ++i) {
    const Pose& T_base_flange = flange.poses[i];
    const RegistrationReport r =
        need(finder.find(options.scans[i], options.form.form(), T_base_block.inverse() * T_base_flange * X));
    const bool ok = r.status == RegistrationStatus::converged && r.T_scanner_block.all_finite();
    json.begin_object().field("file", options.scans[i]).field("status", ok ? "ok" : "refused").field("note", r.note);
    json.field("share_associated", r.share_associated);
    if (ok) json.field("T_scanner_block", r.T_scanner_block);
    json.end_object();
    if (!options.json)
      fmt::print("{}", ok ? say("{}: found; {:.0f} % of the points belong to the block, noise {:.3f} mm\n",
                                options.scans[i], 100.0 * r.share_associated, r.noise_mm)
                          : say("{}: REFUSED: the block was not found ({})\n", options.scans[i], finder.why_not()));
    if (!ok) continue;
    calib::View& view = views.emplace_back();
    view.T_base_flange = T_base_flange;
    view.T_scanner_target = r.T_scanner_block;
    view.number = i + 1;
    if (views.size() == 1) T_base_block = T_base_flange * X * r.T_scanner_block;
    learn(views, X, T_base_block);
  }
  const bool good = views.size() == options.scans.size();
  json.end_array();
  json.field("accepted", views.size()).field("status", good ? "ok" : "refused");
  if (options.json) fmt::print("{}", json.text());
  if (!good)
    stop(kRefused,
         say("{} of {} scans refused, {} is not written. Remedy: the first view must look straight down at "
             "the block from 600 mm, --start be right to about 10 mm and 2 deg, and the whole block be in the "
             "picture; leave a refused scan out, and its line of {} with it",
             options.scans.size() - views.size(), options.scans.size(),
             options.target.empty() ? say("the table") : options.target, options.flange));
  if (options.target.empty()) return kDone;
  std::vector<Pose> poses;
  for (const calib::View& view : views) poses.push_back(view.T_scanner_target);
  OutFile file(options.target, {.synced = true});
  file.write(calib::write_poses(poses, calib::PoseFormat{}, calib::TableRole::target));
  need(file.close(Code::journal_write), kNotReachable);
  if (!options.json)
    fmt::print("{}", say("{}: {} poses\nnext: slabctl calibrate solve --kind pose --flange {} --target {}\n",
                         options.target, poses.size(), options.flange, options.target));
  return kDone;
}

}  // namespace

void add_calibrate_block(args::Command& group) {
  auto options = std::make_shared<Options>();
  args::Command command =
      group.add_subcommand("block", "Find a block in tilted scans by registration: an artefact at hand");
  command->footer(
      "\nThe block must stand still, and the first view look straight down at it from 600 mm, as on the line. Further\n"
      "views are tilted 20 to 35 deg to all sides; where the block is in them follows from the robot's poses.\n"
      "Example: slabctl calibrate block view_*.ply --recipe p5600.toml --flange flange.txt --target target.txt\n"
      "Exit status: 0 every scan accepted, 6 one refused, 2 usage, 3 bad input.");
  command->add_option("SCAN", options->scans, "Scans of the block, one a view, in the order of the flange poses")
      ->required();
  command->add_option("--recipe", options->recipe, "Recipe whose block it is")->required();
  command->add_option("--flange", options->flange, "Table of T_base_flange, one line a scan")->required();
  command->add_option("--start", options->start,
                      "Roughly T_flange_scanner, \"x y z qw qx qy qz\" (default: what the configuration uses)");
  command->add_option("--config", options->config, "The daemon's configuration")->default_val(default_config());
  options->scanner.add_to(*command);
  command->add_option("--target", options->target,
                      "Write the poses as a target table for `calibrate solve --kind pose`; all must be accepted");
  options->form.add_to(*command);
  options->language.add_to(*command, "Language of the text");
  command->add_flag("--json", options->json, "Print slabd.block_poses/1 on stdout");
  command->runs([options] { return run_block(*options); });
}

}  // namespace slabd::cli
