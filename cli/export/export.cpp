// SPDX-License-Identifier: Apache-2.0
//
// slabctl export: exports results for other systems. They are written as CSV or JSON slab by slab, so that memory does
// not depend on their number.
#include <fmt/core.h>

#include <algorithm>
#include <cctype>
#include <charconv>
#include <filesystem>
#include <memory>
#include <sstream>

#include "base/durable.h"
#include "cli/cad/cad_commands.h"
#include "cli/command.h"
#include "cli/database.h"
#include "cli/exit.h"
#include "cli/export/cloud.h"
#include "cli/export/mesh.h"
#include "cli/recipe/recipe_source.h"
#include "cli/slab_choice.h"
#include "cli/terminal/arguments.h"
#include "cli/terminal/parse.h"
#include "cli/terminal/progress.h"
#include "config/designs.h"
#include "report/json.h"
#include "report/slab_json.h"
#include "report/slab_view.h"
#include "report/table.h"

namespace slabd::cli {
namespace {

// ---- items as a table (RFC 4180): a row for each item of each slab; new columns are appended -----------------------

/// First column of every row, the version of the columns. A column that changes meaning or position requires a new
/// version.
constexpr const char* kItemRowsVersion = "slabd.items/1";
constexpr const char* kColumns =
    "version,slab_key,slab_id,slab_no,slab_type,began,ended,slab_verdict,slab_reason,recipe,recipe_sha256,guard,"
    "calibration_id,stations_id,software,scope,station,station_to,attempt,scanned,item,unit,nominal,lower,upper,"
    "value,deviation,U,verdict,required,conformance_probability,beside_name,beside,scanner_id,slab_temperature_k,"
    "slab_age_h,slope_datum,emulated,mould,measured,disposition,robot,scanner,tie_id";

report::Table empty_table() {
  report::Table table;
  std::istringstream keys(kColumns);
  for (std::string key; std::getline(keys, key, ',');) table.columns.emplace_back(key, key);
  return table;
}

/// An empty cell for 0.
report::Cell unless_0(int number) {
  return number == 0 ? report::Cell("") : report::Cell(number);
}

/// Calibrations that a row was measured with: those of the robot and scanner of its scan; for an item of the slab those
/// of the first ones.
SlabArm arm_of(const SlabHeader& slab, const Attempt* attempt) {
  if (attempt != nullptr && attempt->arm > 0 && attempt->arm <= slab.more_arms.size())
    return slab.more_arms[attempt->arm - 1U];
  SlabArm first;
  first.by = attempt == nullptr ? Arm{PartId{}, PartId{}} : attempt->by;
  first.calibration_id = slab.calibration_id;
  first.stations_id = slab.stations_id;
  first.scanner_id = slab.scanner_id;
  return first;
}

void add_item(report::Table& table, const storage::SlabRecord& record, const Item& item,
              const storage::SlabBlock* block) {
  const SlabHeader& slab = record.summary.header;
  const Attempt* attempt = block == nullptr ? nullptr : &block->attempt;
  const std::string_view companion = info(item.id).companion;
  const SlabArm arm = arm_of(slab, attempt);
  table.add(
      kItemRowsVersion, slab.key, slab.slab_id, slab.slab_no, slab.slab_type, report::iso_time(slab.began_utime_us),
      report::iso_time(record.summary.ended_utime_us), name(record.summary.verdict), record.summary.reason, slab.recipe,
      slab.recipe_sha256, slab.guard, arm.calibration_id, arm.stations_id, slab.software,
      attempt != nullptr ? "block" : "slab", unless_0(attempt != nullptr ? attempt->station : item.station),
      unless_0(item.station_to), attempt != nullptr ? report::Cell(attempt->number) : "",
      attempt != nullptr ? report::iso_time(attempt->scan_utime_us) : "", info(item.id).name, name(info(item.id).unit),
      item.nominal, item.lower, item.upper, item.value, item.deviation(), item.U, name(item.verdict), item.required,
      conformance_probability(item), companion, companion.empty() ? kNoValue : item.companion, arm.scanner_id,
      slab.temperature_dk == 0 ? kNoValue : slab.temperature_dk / 10.0, unless_0(slab.age_h),
      report::slope_datum(record), slab.emulated != 0, unless_0(slab.mould), item.measured,
      record.summary.disposition == Disposition::none ? "" : name(record.summary.disposition), arm.by.robot,
      arm.by.scanner, slab.tie_id);
}

/// The heading with its line end.
std::string item_heading() {
  return report::csv_heading(empty_table());
}

/// Rows of the valid attempt of each block by station, then of the slab. Times are UTC.
std::string item_rows(const storage::SlabRecord& record, report::TableFor reader) {
  report::Table table = empty_table();
  for (int station = 1; station <= record.summary.header.stations; ++station) {
    const storage::SlabBlock* block = report::latest(record, station);
    if (block == nullptr || block->phase != StationPhase::measured) continue;
    for (const Item& item : block->block.items) add_item(table, record, item, block);
  }
  for (const Item& item : record.slab.items) add_item(table, record, item, nullptr);
  return report::csv_rows(table, reader);
}

struct ExportOptions {
  DatabaseOptions database;
  SlabChoice choice;
  std::string out = "-";
  std::string format;
  bool bom = false;
  bool raw = false;
};

/// Format from --format, otherwise from the file's extension, otherwise csv.
std::string format_of(const ExportOptions& options) {
  if (!options.format.empty()) return options.format;
  std::string extension = std::filesystem::path(options.out).extension().string();
  std::transform(extension.begin(), extension.end(), extension.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  if (options.out == "-" || extension == ".csv") return "csv";
  if (extension == ".json") return "json";
  stop(kUsage, fmt::format("--out {}: allowed are .csv and .json, or say --format", options.out));
}

/// Calls `write(record)` for each slab. An error is a return value, because the written part is still completed.
template <typename Write>
Status for_each(storage::Reader& reader, const std::vector<std::int64_t>& keys, const Write& write) {
  ProgressCount progress(stderr, keys.size());
  for (const std::int64_t key : keys) {
    progress.next(fmt::format("exporting slab {}", key));
    const auto record = reader.slab(key);
    if (!record) return record.error();
    if (record.value()) write(*record.value());
  }
  return success();
}

int export_results(const ExportOptions& options) {
  const std::string format = format_of(options);
  if (options.bom && format != "csv") stop(kUsage, "--bom: JSON has none");
  if (options.raw && format != "csv") stop(kUsage, "--raw: JSON is always as stored");
  const bool as_stored = options.raw || format != "csv";
  const auto reader =
      open_database(options.database, as_stored ? storage::TextFor::programs : storage::TextFor::people);
  const std::vector<std::int64_t> keys = chosen_slabs(*reader, options.choice);

  OutFile out(options.out);
  Status exported = success();
  if (format == "csv") {
    if (options.bom) out.write("\xEF\xBB\xBF");
    out.write(item_heading());
    const report::TableFor reader_of_table = options.raw ? report::TableFor::program : report::TableFor::spreadsheet;
    exported = for_each(*reader, keys,
                        [&](const storage::SlabRecord& record) { out.write(item_rows(record, reader_of_table)); });
  } else if (options.choice.slabs.size() == 1) {
    exported =
        for_each(*reader, keys, [&](const storage::SlabRecord& record) { out.write(report::slab_json(record)); });
  } else {
    bool first = true;
    out.write("{\n\"schema\": \"slabd.export/1\",\n\"slabs\": [\n");
    exported = for_each(*reader, keys, [&](const storage::SlabRecord& record) {
      if (!first) out.write(",\n");
      first = false;
      out.write(report::slab_json(record));
    });
    out.write("]\n}\n");
  }
  need(exported, kNotReachable);
  need(out.close(), kBadInput);
  return kDone;
}

// ---- clouds and models ---------------------------------------------------------------------------------------------

struct CloudOptions {
  DatabaseOptions database;
  std::string slab;
  std::string out;
  std::string recipes_dir;
  ScanFormOptions form{.unit = "", .columns = ""};
  int block = 0;
  CloudSettings cloud;
};

struct ModelOptions {
  std::string recipe;
  std::string out;
  std::string block;  ///< number of the block; without one, a word of CLI11
  ModelChoice choice;
  bool ap214 = false;
  std::string slab;
  std::string sheet;
  DatabaseOptions database;
};

int export_cloud(CloudOptions options) {
  if (options.block != 0 && options.cloud.voxel_mm != 0.0) stop(kUsage, "--voxel: of a block every point is written");
  config::Config config;
  if (options.database.db.empty()) config = config_from(options.database.config);
  options.cloud.forms = ScanForms(config, options.form);
  const auto reader = open_database(options.database);
  const storage::SlabRecord record = named_slab(*reader, options.slab);
  const SlabHeader& slab = record.summary.header;
  std::vector<config::Problem> problems;
  RecipeStore recipe_store(
      recipes_in(options.recipes_dir.empty() ? config.recipes_dir : options.recipes_dir, problems));
  static_cast<void>(report_problems(problems));
  const Recipe* recipe = need(recipe_store.very(slab, *reader), kNotReachable);
  if (recipe == nullptr) recipe = recipe_store.of_type(slab);
  if (recipe == nullptr)
    stop(kBadInput, fmt::format("no recipe of slab type {} with {} blocks; --recipes names their folder",
                                slab.slab_type, slab.stations));
  if (!(recipe->sha256 == slab.recipe_sha256))
    complain(fmt::format("warning: {} is not the recipe that the slab was measured with", recipe->path.view()));
  if (options.block > slab.stations)
    stop(kUsage, fmt::format("--block {}: this slab has blocks 1..{}", options.block, slab.stations));
  if (options.out.empty())
    options.out = options.block == 0 ? fmt::format("slab-{}.ply", slab.slab_no)
                                     : fmt::format("slab-{}-block-{}.ply", slab.slab_no, options.block);
  const CloudCount count =
      need(options.block != 0 ? write_block_cloud(options.out, record, options.block, *recipe, options.cloud)
                              : write_slab_cloud(options.out, record, *recipe, options.cloud),
           kBadInput);
  for (const std::string& sentence : count.not_scanned) complain("left out: " + sentence);
  fmt::print("{}: {} points", options.out, count.points);
  if (count.left_out > 0) fmt::print(", {} further than 25 mm from every face left out", count.left_out);
  fmt::print("\n");
  return kDone;
}

/// The slab's design: from a design sheet, or as stored with the slab.
SlabDesign design_of(const ModelOptions& options, const Recipe& recipe) {
  if (options.slab.empty()) return {};
  if (!options.sheet.empty()) {
    config::DesignSet set;
    config::load_design_file(options.sheet, set);
    if (!report_problems(set.problems)) stop(kBadInput);
    const DesignSheet* const sheet = find_design(set.sheets, options.slab);
    if (sheet == nullptr) stop(kBadInput, fmt::format("{}: no sheet of slab {}", options.sheet, options.slab));
    if (sheet->stations != recipe.stations() || sheet->slab_type != recipe.slab_type)
      stop(kBadInput, fmt::format("{}: slab {} is of another type than recipe {}", options.sheet, options.slab,
                                  recipe.name.view()));
    return need(parse_design(sheet->text.view()), kBadInput);
  }
  const auto reader = open_database(options.database);
  const SlabHeader header = named_slab(*reader, options.slab).summary.header;
  if (header.slab_type != recipe.slab_type || header.stations != recipe.stations())
    stop(kBadInput, fmt::format("slab {} is of another type than recipe {}", options.slab, recipe.name.view()));
  return facts_of(header).design;
}

/// Number behind --block; 0 without one.
int block_number(const std::string& word, const Recipe& recipe) {
  if (word.empty() || word == "true") return 0;
  int number = 0;
  const auto [end, fault] = std::from_chars(word.data(), word.data() + word.size(), number);
  if (fault != std::errc() || end != word.data() + word.size() || number < 1 || number > recipe.stations())
    stop(kUsage, fmt::format("--block {}: recipe {} has blocks 1..{}", word, recipe.name.view(), recipe.stations()));
  return number;
}

int export_model(ModelOptions options) {
  const Recipe recipe = recipe_from(options.recipe);
  const bool block = options.choice.block;
  options.choice.station = block_number(options.block, recipe);
  if (options.out.empty()) options.out = fmt::format("{}-{}.stl", recipe.name.view(), block ? "block" : "slab");
  if (!options.sheet.empty() && options.slab.empty()) stop(kUsage, "--sheet: --slab names the slab in it");
  const SlabDesign design = design_of(options, recipe);
  if (is_cad_file(options.out)) {
    export_cad(recipe, design, options.choice, options.ap214, options.out);
    return kDone;
  }
  if (options.choice.pmi || options.ap214 || design.given || options.choice.station > 0)
    stop(kUsage, "--pmi, --ap214, --slab and the number of --block are of STEP and IGES files");
  const Mesh mesh = need(block ? block_mesh(recipe) : slab_mesh(recipe), kBadInput);
  const std::string title =
      fmt::format("{} of recipe {} {:.12}, mm", block ? "block" : "slab", recipe.name.view(), recipe.sha256.view());
  need(write_mesh(options.out, mesh, title), kBadInput);
  fmt::print("{}: {} triangles\n", options.out, mesh.triangles.size());
  return kDone;
}

void add_cloud(args::Command& parent) {
  auto options = std::make_shared<CloudOptions>();
  args::Command command =
      parent.add_subcommand("cloud", "A slab's scans as one cloud in the slab frame, or one block's");
  command->footer(
      "\nPLY, binary, mm, without the points that no surface goes through. Of a slab: x, y, z, station. Of a block, "
      "in\n"
      "the block's frame as registered: x, y, z, deviation_mm (to the recipe's block), face.\n"
      "Examples: slabctl export cloud SLAB-0042 --voxel 2\n"
      "          slabctl export cloud SLAB-0042 --block 7 --out block7.ply");
  command->add_option("SLAB", options->slab, "Key or slab id (key:12, id:12 where a number may be either)")->required();
  command->add_option("--out", options->out, "PLY file; default: slab-NO.ply or slab-NO-block-K.ply");
  command->add_option("--block", options->block, "This block alone")
      ->check(args::range(1, static_cast<int>(limits::kStationsMax)));
  command
      ->add_option("--voxel", options->cloud.voxel_mm,
                   "One mean point for each cube of this edge length, mm; default: all points")
      ->check(within(0.2, 100.0));
  options->database.add_to(*command);
  command->add_option("--recipes", options->recipes_dir, "Folder with the recipes; default: the configuration's");
  command->add_option("--scans", options->cloud.scans_dir,
                      "A copy of the spool or an archive, for scans that were moved away");
  options->form.add_to(*command);
  command->runs([options] { return export_cloud(*options); });
}

void add_model(args::Command& parent) {
  auto options = std::make_shared<ModelOptions>();
  args::Command command =
      parent.add_subcommand("model", "A recipe's slab as a solid (STEP, IGES) or triangles (STL, PLY)");
  command->footer(
      "\nSTEP AP242, AP214 and IGES need the package slabd-cad. Faces have names: seat_3, jaw_inner_3, jaw_outer_3,\n"
      "casing_inner_3, casing_outer_3, slab_top; of one block without the number. See docs/CAD.md.\n"
      "Examples: slabctl export model p5600.toml --out slab.step --pmi\n"
      "          slabctl export model p5600.toml --block --out block.igs\n"
      "          slabctl export model p5600.toml --slab SLAB-0042 --out curve.step");
  command->add_option("RECIPE", options->recipe, "Recipe file")->required();
  command->add_option("--out", options->out,
                      "File, .step .stp .iges .igs .stl or .ply, mm; default: RECIPE-slab.stl or RECIPE-block.stl");
  const args::Option block = command
                                 ->add_option("--block", options->block,
                                              "One block in its own frame instead of the slab; with its number, as the "
                                              "design of --slab has it")
                                 ->expected(0, 1);
  command->add_flag("--pmi", options->choice.pmi, "With the recipe's tolerances as semantic PMI (STEP AP242)");
  command->add_flag("--ap214", options->ap214, "STEP AP214 instead of AP242, for older programs");
  command->add_option("--slab", options->slab, "With the design that this slab (key or id) was begun with");
  command->add_option("--sheet", options->sheet,
                      "Take the design of --slab from this design sheet, not from the database");
  options->database.add_to(*command);
  command->runs([options, block] {
    options->choice.block = block.count() > 0;
    return export_model(*options);
  });
}

}  // namespace

void add_export(args::Command& app) {
  auto options = std::make_shared<ExportOptions>();
  args::Command command = app.add_subcommand("export", "Results as CSV or JSON, clouds and models, for other programs");
  command->footer(
      "\nCSV: one row for each item (docs/EXPORT.md has the columns), RFC 4180, UTF-8. JSON: of one named slab\n"
      "slabd.slab/1, else slabd.export/1 with such documents (docs/schemas). Reads the database while the daemon "
      "runs.\n"
      "Examples: slabctl export --since 1d --out yesterday.csv --bom\n"
      "          slabctl export SLAB-0042 --out slab.json\n"
      "          slabctl export --all --slab-type 5600 --verdict fail --format json | jq '.slabs[].slab_id'");
  options->choice.add_to(*command);
  options->database.add_to(*command);
  command->add_option("--out", options->out, "File, .csv or .json; - is standard output")->capture_default_str();
  command->add_option("--format", options->format, "csv or json; default: the file's extension, else csv")
      ->check(args::one_of({"csv", "json"}));
  command->add_flag("--bom", options->bom,
                    "Begin CSV with a byte order mark, which Excel needs to see that it is UTF-8");
  command->add_flag("--raw", options->raw,
                    "CSV for a program: text that begins with = + - @ as stored, without an apostrophe before it");
  command->require_subcommand(0, 1);
  add_cloud(*command);
  add_model(*command);
  command->runs([options] { return export_results(*options); });
}

}  // namespace slabd::cli
