// SPDX-License-Identifier: Apache-2.0
//
// slabd_accuracy [study...] [--quick] [--seeds N] [--first SEED] [--json]
// slabd_accuracy real [--surface real|clean|ideal] [--effect NAME=STRENGTH]... [--defect NAME=SIZE]... [--table]
#include <fmt/core.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <array>
#include <chrono>
#include <string>
#include <vector>

#include "emulator/concrete_effects.h"
#include "report/json.h"
#include "tests/accuracy/studies.h"

namespace slabd::accuracy {
namespace {

struct Study {
  const char* name;
  bool (*run)(const StudyOptions&, Table&);
  const char* about;
};

constexpr std::array kStudies = {
    Study{"plane", plane_study, "the paper's Table 1: least squares, classical and improved RANSAC"},
    Study{"basin", basin_study, "registration from random starts: basin of convergence"},
    Study{"pose", pose_study, "registration with white noise: is its covariance true?"},
    Study{"denoise", denoise_study, "denoising over a grid of scans: outliers left, surface lost"},
    Study{"repeat", repeat_study, "ten scans of one block: spread of std and flatness"},
    Study{"block", block_study, "full-size scans of varied blocks: error of every item, coverage of U"},
    Study{"perspective", perspective_study, "the same with rays from one centre"},
    Study{"correlated", correlated_study, "the same with noise correlated over 1 mm: does U still cover?"},
    Study{"real", real_study, "real concrete: errors, coverage of U, verdicts of good blocks, defects noticed"},
    Study{"paper", paper_study, "the paper's Tables 4 and 5 and Fig. 17 on drawn concrete"},
    Study{"slab", slab_study, "whole slabs with robot repeatability: slab items, planted defects"},
    Study{"warm", warm_study, "slabs of -10 to 60 deg C: every length at 20 deg C within U"},
    Study{"exposures", exposures_study, "the noise of two scans: different exposures, and one that is given again"},
    Study{"ends", ends_study, "slab types that differ only in the slab's ends, begun rightly and wrongly"},
    Study{"ball", ball_study, "a tooling ball: scatter of its centre, truth of its covariance"},
    Study{"stations", stations_study,
          "a robot that is off: station corrections, seats with and without, coverage of U"},
    Study{"coverage", coverage_study, "slabs at the level of features: U covers, and is no larger than needed"},
    Study{"handeye", handeye_study, "hand-eye calibration: error against the floor, prediction, refusals"},
    Study{"guide", guide_study, "hand-eye calibration: suggested poses against the usual advice"},
};

const Study* find(const std::string& name) {
  const auto found = std::find_if(kStudies.begin(), kStudies.end(), [&](const Study& s) { return s.name == name; });
  return found == kStudies.end() ? nullptr : &*found;
}

struct Outcome {
  const Study* study = nullptr;
  bool carried_out = false;
  Table table;
  double seconds = 0.0;
};

std::string json_of(const std::vector<Outcome>& outcomes) {
  report::Json json("slabd.accuracy/1");
  json.key("studies").begin_array();
  for (const Outcome& outcome : outcomes) {
    json.begin_object().field("study", outcome.study->name).field("carried_out", outcome.carried_out);
    json.field("seconds", outcome.seconds).key("rows").begin_array();
    for (const Table::Row& row : outcome.table.rows()) {
      json.begin_object().field("what", row.what).field("measured", row.measured);
      json.field("unit", row.unit).field("goal", row.goal).field("ok", row.ok);
      json.end_object();
    }
    json.end_array().end_object();
  }
  json.end_array().end_object();
  return json.text();
}

int run(const std::vector<const Study*>& chosen, const StudyOptions& options, bool as_json) {
  std::vector<Outcome> outcomes;
  bool all_ok = true;
  for (const Study* study : chosen) {
    if (!as_json) fmt::print("{}: {}\n", study->name, study->about);
    std::fflush(stdout);
    Outcome& outcome = outcomes.emplace_back();
    outcome.study = study;
    const auto started = std::chrono::steady_clock::now();
    outcome.carried_out = study->run(options, outcome.table);
    outcome.seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - started).count();
    all_ok = all_ok && outcome.carried_out && outcome.table.all_ok();
    if (as_json) continue;
    if (!outcome.table.rows().empty()) outcome.table.print();
    fmt::print("  {:.0f} s{}\n\n", outcome.seconds, outcome.carried_out ? "" : "; NOT CARRIED OUT");
    std::fflush(stdout);
  }
  if (as_json) fmt::print("{}", json_of(outcomes));
  return all_ok ? 0 : 1;
}

}  // namespace
}  // namespace slabd::accuracy

int main(int argc, char** argv) {
  using namespace slabd::accuracy;
  StudyOptions options;
  std::vector<std::string> names;
  bool as_json = false;
  CLI::App app("Studies of accuracy with known truth. Exit status 0: every goal met, 1: not, 2: usage.");
  std::string footer = "\nStudies (default: all)\n";
  for (const Study& study : kStudies) footer += fmt::format("  {:12} {}\n", study.name, study.about);
  footer += "\nEffects of study real, with their usual strengths\n" + slabd::emulator::effect_help();
  footer += "\nDefects of study real, with their usual sizes\n";
  for (const slabd::emulator::ConcreteDefectInfo& defect : slabd::emulator::concrete_defects())
    footer += fmt::format("  {:12} {:4} {}\n", defect.name, defect.usual, defect.meaning);
  app.footer(footer);
  app.add_option("study", names, "Which studies to run");
  app.add_flag("--quick", options.quick, "A tenth of the cases");
  app.add_option("--seeds", options.seeds, "Number of cases instead of the study's own")
      ->check(CLI::Range(1, 1'000'000));
  app.add_option("--first", options.first, "First seed")->capture_default_str();
  app.add_flag("--json", as_json, "Print slabd.accuracy/1 on stdout");
  RealOptions& real = options.real;
  const std::string of_real = "Study real";
  app.add_option("--surface", real.surface, "The concrete: real, clean or ideal")
      ->group(of_real)
      ->capture_default_str();
  app.add_option("--effect", real.effects, "An effect of another strength, NAME=STRENGTH; repeatable")
      ->group(of_real)
      ->allow_extra_args(false);
  app.add_option("--defect", real.defects, "A planted defect, NAME=SIZE or NAME; repeatable")
      ->group(of_real)
      ->allow_extra_args(false);
  app.add_flag("--table", real.table, "Each effect raised and each defect, one line each")->group(of_real);
  app.add_flag("--markdown", real.markdown, "The table as in docs/ACCURACY.md")->group(of_real)->needs("--table");
  app.add_flag("--each", real.each, "Also one line for each scan: error(U) of every item")->group(of_real);
  app.add_flag("--full", real.full_grid, "2048 x 2448 points instead of 1000 x 1428")->group(of_real);
  app.add_option("--step-mm", real.step_mm, "Round coordinates to this")->group(of_real)->check(CLI::Range(0.0, 1.0));
  app.add_option("--out", real.out, "Folder for the scans (PLY) and their truth (JSON)")->group(of_real);
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& stop) {
    return app.exit(stop) == 0 ? 0 : 2;
  }
  options.as_json = as_json;
  std::vector<const Study*> chosen;
  for (const std::string& name : names) {
    chosen.push_back(find(name));
    if (chosen.back() != nullptr) continue;
    fmt::print(stderr, "slabd_accuracy: '{}' is not a study; see --help\n", name);
    return 2;
  }
  if (chosen.empty())
    for (const Study& study : kStudies) chosen.push_back(&study);
  return run(chosen, options, as_json);
}
