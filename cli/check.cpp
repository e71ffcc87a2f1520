// SPDX-License-Identifier: Apache-2.0
//
// slabctl config check, recipe check, recipe show (recipe diff: cli/recipe): check files with the daemon's parsers.
#include <fmt/core.h>

#include <cmath>
#include <memory>
#include <vector>

#include "cli/cad/cad_commands.h"
#include "cli/command.h"
#include "cli/database.h"
#include "cli/exit.h"
#include "cli/recipe/recipe_diff.h"
#include "cli/recipe/recipe_source.h"
#include "cli/terminal/arguments.h"
#include "cli/terminal/render.h"
#include "config/designs.h"
#include "config/recipe_keys.h"
#include "daemon/slab_ends.h"
#include "report/figures.h"
#include "report/json.h"

namespace slabd::cli {
namespace {

using config::geometry_of;
using config::NamedNominal;
using config::uncertainty_of;

std::vector<NamedNominal> nominals_of(const Recipe& recipe) {
  std::vector<NamedNominal> list = geometry_of(recipe);
  for (const NamedNominal& assumption : uncertainty_of(recipe)) list.push_back(assumption);
  return list;
}

std::vector<Item> tolerances_of(const Recipe& recipe) {
  std::vector<Item> items;
  for (std::size_t i = 0; i < kItemCount; ++i) {
    const auto id = static_cast<ItemId>(i);
    if (!info(id).optional || recipe.tolerance(id).given) items.push_back(blank_item(recipe, id));
  }
  return items;
}

std::string recipe_json(const Recipe& recipe) {
  report::Json json("slabd.recipe/1");
  json.field("name", recipe.name).field("slab_type", recipe.slab_type).field("sha256", recipe.sha256);
  json.field("file", recipe.path).field("pairs", recipe.slab.pairs).field("stations", recipe.stations());
  json.field("slope_datum", recipe.slope_datum == SlopeDatum::slab_frame ? "slab_frame" : "local_slab_top");
  json.field("remove_warp", recipe.remove_warp).field("guard", recipe.guard);
  json.field("unconfirmed", unconfirmed_count(recipe)).field("uncertainty_budget", recipe.uncertainty.given);
  json.field("defect_sigmas", recipe.evaluation.defect_sigmas).key("nominals").begin_object();
  for (const NamedNominal& n : nominals_of(recipe)) {
    json.key(n.name)
        .begin_object()
        .field("value", config::shown(n))
        .field("confirmed", n.nominal.confirmed)
        .end_object();
  }
  json.end_object();
  json.key("edges").begin_object().field("fillet_seat_mm", recipe.edges.fillet_seat_mm);
  json.field("fillet_shoulder_mm", recipe.edges.fillet_shoulder_mm).field("chamfer_mm", recipe.edges.chamfer_mm);
  json.end_object();
  json.list("items", tolerances_of(recipe), [&](const Item& item) {
    const Tolerance& t = recipe.tolerance(item.id);
    json.field("id", info(item.id).name).field("unit", info(item.id).unit).field("nominal", item.nominal);
    json.field("lower", item.lower).field("upper", item.upper).field("U", item.U).field("required", item.required);
    json.field("confirmed", t.confirmed && t.nominal.confirmed);
    if (item.id == ItemId::surface_pores)
      json.field("depth_max_mm", recipe.pores.depth_max_mm).field("share_max", recipe.pores.share_max);
    if (info(item.id).of_gauges) json.field("formula", text_of(recipe.formula(item.id)).view());
  });
  return json.text();
}

std::string recipe_text(const Recipe& recipe) {
  std::string text;
  const auto mark = [](bool confirmed) { return confirmed ? std::string("confirmed") : std::string("assumed"); };
  text += fmt::format("recipe {}  slab type {}  {} blocks\nsha256 {}\n", recipe.name.view(), recipe.slab_type,
                      recipe.stations(), recipe.sha256.view());
  text += fmt::format("slope datum {}, remove_warp {}, guard band {} U, defects beyond {} sigma\n",
                      recipe.slope_datum == SlopeDatum::slab_frame ? "slab_frame" : "local_slab_top",
                      recipe.remove_warp, recipe.guard, recipe.evaluation.defect_sigmas);
  text +=
      fmt::format("{}\n", recipe.uncertainty.given
                              ? "U is computed from [uncertainty]; an item's own U counts where that is not possible"
                              : "no [uncertainty]: every item has its own U");
  text += recipe.thermal.given ? fmt::format("lengths at {:g} deg C\n\n", recipe.thermal.reference_c.value)
                               : "no [thermal]: lengths are those at the slab's own temperature\n\n";
  report::Table table{"nominal", "value", "state<"};
  constexpr double kFewDigits = 1e-3;  // smaller numbers, such as an expansion, are written with all of theirs
  for (const NamedNominal& n : nominals_of(recipe))
    table.add(
        n.name,
        std::abs(config::shown(n)) < kFewDigits ? report::Cell(config::shown(n)) : report::Cell(config::shown(n), 4),
        mark(n.nominal.confirmed));
  text += fmt::format("{}\n", report::text_of(table));
  table = report::Table{"item", "unit", "nominal", "lower", "upper", "U", "required", "state<"};
  for (const Item& item : tolerances_of(recipe)) {
    const Tolerance& t = recipe.tolerance(item.id);
    table.add(info(item.id).name, name(info(item.id).unit), report::Cell(item.nominal, 4), report::Cell(item.lower, 4),
              report::Cell(item.upper, 4), report::Cell(item.U, 4), item.required ? "yes" : "no",
              mark(t.confirmed && t.nominal.confirmed));
  }
  text += fmt::format("{}\n", report::text_of(table));
  if (has_value(recipe.pores.depth_max_mm))
    text += fmt::format("surface_pores: depth at most {:g} mm\n", recipe.pores.depth_max_mm);
  if (has_value(recipe.pores.share_max))
    text += fmt::format("surface_pores: at most {:g} % of the area\n", 100.0 * recipe.pores.share_max);
  for (const ItemId id : kGaugeItemIds)
    if (recipe.tolerance(id).given)
      text += fmt::format("{}: {} of the gauges\n", info(id).name, text_of(recipe.formula(id)).view());
  text += fmt::format("{}\n", report::kNotVisible);
  return text;
}

}  // namespace

void warn_unconfirmed(const Recipe& recipe) {
  const int count = unconfirmed_count(recipe);
  if (count > 0)
    complain(fmt::format(
        "warning: {} nominals and tolerances of recipe {} are assumed, not confirmed; verdicts depend on them", count,
        recipe.name.view()));
  std::string assumed;
  for (const NamedNominal& n : uncertainty_of(recipe))
    if (!n.nominal.confirmed) assumed += (assumed.empty() ? "" : ", ") + std::string(n.name);
  if (!assumed.empty()) complain(fmt::format("warning: U rests on unconfirmed assumptions: {}", assumed));
}

namespace {

// ---- checking ----------------------------------------------------------------------------------------------------

/// Result of a check, collected from all files and printed once, as text or as slabd.check/1.
struct Check {
  std::vector<config::Problem> problems;
  std::vector<config::Problem> doubts;  ///< allowed settings that are probably mistakes
  std::vector<Recipe> recipes;          ///< the valid ones
  bool commissioning = false;
};

std::string check_json(const std::vector<std::string>& files, const Check& check) {
  report::Json json("slabd.check/1");
  json.field("ok", check.problems.empty()).field("files", files);
  json.list("problems", check.problems, &config::Problem::text);
  json.key("doubts").begin_array();
  for (const config::Problem& doubt : check.doubts) json.value(doubt.text);
  for (const daemon::AlikeRecipes& alike : daemon::alike_recipes(check.recipes)) json.value(daemon::text_of(alike));
  json.end_array();
  json.list("recipes", check.recipes, [&](const Recipe& recipe) {
    json.field("file", recipe.path).field("name", recipe.name).field("slab_type", recipe.slab_type);
    json.field("stations", recipe.stations()).field("sha256", recipe.sha256);
    json.field("unconfirmed", unconfirmed_count(recipe)).field("guard", recipe.guard);
  });
  json.field("commissioning_calibration", check.commissioning);
  return json.text();
}

/// Prints the result. Problems and warnings go to stderr in both forms, like all messages.
int conclude(const std::vector<std::string>& files, const Check& check, bool json) {
  const bool ok = report_problems(check.problems);
  if (json) fmt::print("{}", check_json(files, check));
  for (const config::Problem& doubt : check.doubts) complain("warning: " + doubt.text);
  if (check.commissioning)
    complain(
        "warning: [calibration] holds commissioning values; they count until a calibration is applied, and do "
        "not prove that the scanner's frame is right-handed");
  for (const daemon::AlikeRecipes& alike : daemon::alike_recipes(check.recipes))
    complain(fmt::format("warning: {}", daemon::text_of(alike).view()));
  for (const Recipe& recipe : check.recipes) {
    if (!json)
      fmt::print("{}: good: {}, slab type {}, {} blocks, sha256 {}\n", recipe.path.view(), recipe.name.view(),
                 recipe.slab_type, recipe.stations(), recipe.sha256.view());
    warn_unconfirmed(recipe);
  }
  return ok ? kDone : kBadInput;
}

/// Adds the recipe or its problems; true if it is valid.
bool check_recipe(const std::string& file, Check& check) {
  const std::size_t before = check.problems.size();
  Recipe recipe;
  config::load_recipe(file, recipe, check.problems, &check.doubts);
  if (check.problems.size() != before) return false;
  check.recipes.push_back(recipe);
  return true;
}

int check_recipes(const std::vector<std::string>& files, bool json) {
  Check check;
  for (const std::string& file : files) static_cast<void>(check_recipe(file, check));
  return conclude(files, check, json);
}

int show_recipe(const std::string& file, bool json) {
  Check check;
  if (!check_recipe(file, check)) return conclude({file}, check, json);
  const Recipe& recipe = check.recipes.front();
  warn_unconfirmed(recipe);
  if (json) {
    fmt::print("{}", recipe_json(recipe));
  } else {
    fmt::print("{}", recipe_text(recipe));
  }
  return kDone;
}

/// Prints the stored bytes, so that they can be written to a file again; with --json like a file.
int show_stored(const DatabaseOptions& database, const std::string& word, bool json) {
  const auto reader = open_database(database);
  const storage::RecipeText text = stored_recipe(*reader, word);
  Recipe recipe;
  const bool good = recipe_from(text, recipe);
  if (!json) std::fwrite(text.text.data(), 1, text.text.size(), stdout);
  if (good && json) fmt::print("{}", recipe_json(recipe));
  return good ? kDone : kBadInput;
}

int check_config(const std::string& file, bool json) {
  Check check;
  config::Config config;
  config::load_config(file, config, check.problems);
  for (const auto* beside : {&config.web_problems, &config.plant_problems, &config.genicam_problems})
    check.problems.insert(check.problems.end(), beside->begin(), beside->end());
  check.doubts = config.doubts;
  if (check.problems.empty()) {
    if (!json) fmt::print("{}: good{}\n", file, check.doubts.empty() ? "" : ", but see the warnings");
    check.commissioning = !config.calibration.id.empty();
    config::load_recipes(config.recipes_dir, check.recipes, check.problems, nullptr, &check.doubts, &config.gauges);
    const config::DesignSet designs = config::load_designs(config.designs_dir);
    check.problems.insert(check.problems.end(), designs.problems.begin(), designs.problems.end());
  }
  return conclude({file}, check, json);
}

struct Options {
  std::vector<std::string> files;
  std::string file;
  DatabaseOptions database;
  std::string slab;
  std::string sha256;
  bool json = false;
};

}  // namespace

void add_config(args::Command& app) {
  auto options = std::make_shared<Options>();
  args::Command config = app.add_subcommand("config", "The daemon's configuration");
  config->require_subcommand(1);
  args::Command check =
      config->add_subcommand("check", "Name every fault of a configuration and of the recipes it uses");
  check->add_option("FILE,--config", options->file, "Configuration")->default_val(default_config());
  check->add_flag("--json", options->json, "Print slabd.check/1 on stdout");
  check->runs([options] { return check_config(options->file, options->json); });
}

void add_recipe(args::Command& app) {
  auto options = std::make_shared<Options>();
  args::Command recipe = app.add_subcommand("recipe", "Slab types");
  recipe->require_subcommand(1);
  args::Command check = recipe->add_subcommand("check", "Name every fault of recipe files");
  check->add_option("FILE", options->files, "Recipe files")->required();
  check->add_flag("--json", options->json, "Print slabd.check/1 on stdout");
  check->runs([options] { return check_recipes(options->files, options->json); });
  args::Command show = recipe->add_subcommand("show", "Print nominals and tolerances, and who has confirmed them");
  show->footer(
      "\n--slab and --sha256 print the file that the database has kept, byte for byte.\n"
      "Examples: slabctl recipe show p5600.toml\n"
      "          slabctl recipe show --slab SLAB-0042 > p5600-then.toml");
  show->add_option("FILE", options->file, "Recipe file");
  show->add_option("--slab", options->slab, "The recipe that this slab (key or id) was begun with");
  show->add_option("--sha256", options->sha256,
                   "The recipe with this SHA-256, or the only one whose SHA-256 begins so");
  options->database.add_to(*show);
  show->add_flag("--json", options->json, "Print slabd.recipe/1 on stdout; of a faulty file slabd.check/1");
  show->runs([options] {
    const Options& o = *options;
    if (int{!o.file.empty()} + int{!o.slab.empty()} + int{!o.sha256.empty()} != 1)
      stop(kUsage, "say which recipe: one of FILE, --slab SLAB and --sha256 S");
    if (!o.file.empty()) return show_recipe(o.file, o.json);
    return show_stored(o.database, o.slab.empty() ? "sha:" + o.sha256 : "slab:" + o.slab, o.json);
  });
  add_recipe_diff(*recipe);
  add_recipe_from_cad(*recipe);
  add_recipe_drafts(*recipe);
  add_recipe_from_scan(*recipe);
  add_recipe_reload(*recipe);
}

}  // namespace slabd::cli
