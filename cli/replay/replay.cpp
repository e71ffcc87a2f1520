// SPDX-License-Identifier: Apache-2.0
//
// slabctl replay: measures stored slabs again from their scans. With --verify all stored results must be reproduced;
// with --recipe another recipe judges, and the verdicts are compared.
#include <fmt/core.h>

#include <algorithm>
#include <memory>
#include <optional>

#include "algo/algo.h"
#include "cli/command.h"
#include "cli/database.h"
#include "cli/exit.h"
#include "cli/replay/verify.h"
#include "cli/replay/what_if.h"
#include "cli/slab_choice.h"
#include "cli/terminal/arguments.h"
#include "cli/terminal/parse.h"
#include "cli/terminal/progress.h"
#include "cli/terminal/render.h"
#include "daemon/measure.h"
#include "report/json.h"

namespace slabd::cli {
namespace {

struct ReplayOptions {
  DatabaseOptions database;
  SlabChoice choice;
  bool verify = false;
  std::string recipe;
  std::string recipes_dir;
  std::string scans_dir;
  ScanFormOptions form{.unit = "", .columns = ""};
  int threads = config::default_measure_threads();
  bool json = false;
};

/// Number of differences in the text output; JSON has all.
constexpr std::size_t kDifferencesNamed = 3;

void write_slab(report::Json& json, const SlabReplay& slab) {
  json.begin_object().field("key", slab.header.key).field("slab_id", slab.header.slab_id);
  json.field("verdict", slab.verdict).field("outcome", slab.outcome).field("figures", slab.figures());
  json.field("differences", slab.differences()).field("recipe", slab.recipe).field("scans_proven", slab.scans_proven());
  json.field("changed", slab.changed);
  json.list("blocks", slab.blocks, [&](const BlockReplay& block) {
    json.field("station", block.station).field("attempt", block.attempt).field("scan", block.scan);
    json.field("outcome", block.outcome).field("why", block.why);
    report::write_crc32c(json, "crc32c_stored", block.crc32c_stored);
    report::write_crc32c(json, "crc32c_now", block.crc32c_now);
    fields(json, block.comparison);
  });
  json.key("slab").begin_object().field("compared", slab.slab_compared).field("why", slab.slab_why);
  fields(json, slab.slab);
  json.end_object().end_object();
}

std::string differences_text(const storage::Comparison& comparison) {
  std::string text;
  for (std::size_t i = 0; i < std::min(comparison.differences.size(), kDifferencesNamed); ++i) {
    const storage::Difference& difference = comparison.differences[i];
    text += fmt::format("    {}: stored {}, now {}\n", difference.figure, difference.stored, difference.now);
  }
  if (comparison.differences.size() > kDifferencesNamed)
    text += fmt::format("    and {} more\n", comparison.differences.size() - kDifferencesNamed);
  return text;
}

std::string without_checksum(const SlabReplay& slab) {
  const std::size_t count = slab.scans_without_checksum();
  return count == 0 ? "" : fmt::format("; of {} none was kept", count);
}

std::string slab_text(const SlabReplay& slab) {
  std::string text;
  const auto replayed = std::count_if(slab.blocks.begin(), slab.blocks.end(),
                                      [](const BlockReplay& block) { return block.comparison.figures > 0; });
  text += fmt::format("slab {} \"{}\" ({}): {}: {} of {} scans measured again, {} figures compared, {} differ\n",
                      slab.header.key, slab.header.slab_id.view(), slabd::name(slab.verdict), name(slab.outcome),
                      replayed, slab.blocks.size(), slab.figures(), slab.differences());
  text += fmt::format("  {} of {} scans are proven by their checksum to hold the points that were measured{}\n",
                      slab.scans_proven(), slab.blocks.size(), without_checksum(slab));
  if (slab.recipe.starts_with("sha:"))
    text += fmt::format("  recipe {} is no longer in the folder; measured with what the database has kept ({:.16})\n",
                        slab.header.recipe.view(), slab.recipe);
  for (const ChangedInput& input : slab.changed)
    text += fmt::format("  another {}: recorded {}; now {}\n", input.what, input.stored, input.now);
  for (const BlockReplay& block : slab.blocks) {
    if (block.outcome == ReplayOutcome::identical && block.why.empty()) continue;
    text += fmt::format("  block {} attempt {}: {}: {}\n    scan {}\n", block.station, block.attempt,
                        name(block.outcome), block.why, block.scan);
    text += differences_text(block.comparison);
  }
  if (!slab.slab_why.empty()) text += fmt::format("  slab: {}\n", slab.slab_why);
  text += differences_text(slab.slab);
  return text;
}

struct ReplaySources {
  std::unique_ptr<storage::Reader> reader;
  std::string recipes_dir;
  hal::ScanForm form;
};

/// Recipes folder and scan form come from the command line, otherwise from the configuration.
ReplaySources open_sources(const ReplayOptions& options) {
  ReplaySources sources;
  config::Config config;
  if (options.database.db.empty()) {
    config = config_from(options.database.config);
    sources.form = config.scanner.form;
  }
  sources.recipes_dir = options.recipes_dir.empty() ? config.recipes_dir : options.recipes_dir;
  sources.form = options.form.form(sources.form);
  sources.reader = open_database(options.database);
  return sources;
}

/// Calls `work(record)` for every selected slab, oldest first.
template <typename Work>
void for_each_slab(storage::Reader& reader, const std::vector<std::int64_t>& keys, const Work& work) {
  for (const std::int64_t key : keys) {
    const auto record = need(reader.slab(key), kNotReachable);
    if (record) work(*record);  // otherwise the daemon has pruned it meanwhile
  }
}

int verify(const ReplayOptions& options, ReplaySources& sources, const std::vector<std::int64_t>& keys) {
  std::vector<config::Problem> problems;
  RecipeStore recipe_store(recipes_in(sources.recipes_dir, problems));
  static_cast<void>(report_problems(problems));
  Remeasurer remeasurer(options.threads, sources.form, options.scans_dir);
  std::array<int, 3> count{};
  int with_scans = 0;  // slabs that have scans, among those not verified
  report::Json json("slabd.replay/1");
  json.field("software", daemon::software_version()).field("threads", options.threads);
  json.field("instruction_set", algo::instruction_set()).key("slabs").begin_array();
  ProgressCount progress(stderr, keys.size());
  for_each_slab(*sources.reader, keys, [&](const storage::SlabRecord& record) {
    progress.next(fmt::format("measuring slab {} again", record.summary.header.key));
    const SlabReplay slab = need(replay_slab(*sources.reader, record, recipe_store, remeasurer), kNotReachable);
    progress.erase();
    ++count[static_cast<std::size_t>(slab.outcome)];
    with_scans += slab.scans_left ? 1 : 0;
    if (options.json) {
      write_slab(json, slab);
    } else {
      fmt::print("{}", slab_text(slab));
      std::fflush(stdout);
    }
  });
  const auto [identical, differs, not_verified] = count;
  json.end_array();
  json.field("identical", identical).field("differs", differs).field("not_verified", not_verified);
  if (options.json) {
    fmt::print("{}", json.text());
  } else {
    fmt::print("identical {}, differ {}, not verified {}; {} thread{}, {}, {}\n", identical, differs, not_verified,
               options.threads, options.threads == 1 ? "" : "s", algo::instruction_set(),
               daemon::software_version().view());
  }
  // Old scans are deleted regularly: a slab without scans is a finding only if it was named.
  const bool enough = options.choice.slabs.empty() ? identical > 0 && with_scans == 0 : not_verified == 0;
  if (with_scans > 0)
    complain(fmt::format("of the slabs not verified {} could be measured: only the recipe is missing", with_scans));
  return differs == 0 && enough ? kDone : kNotPass;
}

/// Judges the slab with `recipe`; returns the reason if that is not possible.
std::string decide_anew(storage::Reader& reader, const storage::SlabRecord& record, const Recipe& recipe,
                        Remeasurer& remeasurer, WhatIf& what_if) {
  const SlabHeader& slab = record.summary.header;
  if (record.summary.ended_utime_us == 0) return "it is still open";
  if (record.summary.verdict == Verdict::aborted) return "it was aborted";
  if (recipe.slab_type != slab.slab_type || recipe.stations() != slab.stations)
    return fmt::format("it is of slab type {} with {} blocks, the recipe of type {} with {}", slab.slab_type,
                       slab.stations, recipe.slab_type, recipe.stations());
  const auto verified = scanner_of(reader, slab);
  if (!verified) return std::string(verified.error().text.view());
  if (!verified.value()) return fmt::format("the scanner acceptance {} is not in the database", slab.scanner_id.view());
  std::vector<std::unique_ptr<Remeasured>> again(record.blocks.size());
  std::vector<const BlockResult*> blocks(record.blocks.size(), nullptr);
  for (std::size_t i = 0; i < record.blocks.size(); ++i) {
    const storage::SlabBlock& stored = record.blocks[i];
    const bool valid = i + 1 == record.blocks.size() || record.blocks[i + 1].attempt.station != stored.attempt.station;
    if (!valid || stored.phase != StationPhase::measured) continue;
    again[i] = std::make_unique<Remeasured>();
    remeasurer.measure(slab, *verified.value(), stored, *again[i]);
    if (again[i]->scan != Remeasured::Scan::measured)
      return fmt::format("block {}: {} ({})", stored.attempt.station, again[i]->note, again[i]->path);
    if (again[i]->altered)
      return fmt::format("block {}: the scan was changed: {} ({})", stored.attempt.station, again[i]->note,
                         again[i]->path);
    blocks[i] = &again[i]->block;
  }
  const std::vector<StationRecord> stations = stations_of(record, blocks);
  std::vector<BlockResult> room(limits::kStationsMax);
  auto judged = std::make_unique<SlabResult>();
  daemon::judge_slab({&recipe, slab.T_base_slab, *verified.value(), facts_of(slab)}, stations, room, *judged);
  what_if.add(record, stations, *judged);
  return "";
}

int decide(const ReplayOptions& options, ReplaySources& sources, const std::vector<std::int64_t>& keys) {
  const Recipe recipe = recipe_named(sources.reader.get(), options.recipe);
  warn_unconfirmed(recipe);
  Remeasurer remeasurer(options.threads, sources.form, options.scans_dir);
  remeasurer.use(recipe);
  WhatIf what_if;
  for_each_slab(*sources.reader, keys, [&](const storage::SlabRecord& record) {
    std::optional<ProgressNote> note(std::in_place, stderr,
                                     fmt::format("measuring slab {} again ...", record.summary.header.key),
                                     std::chrono::seconds(1));
    std::string why = decide_anew(*sources.reader, record, recipe, remeasurer, what_if);
    note.reset();
    if (!why.empty()) what_if.leave_out(record.summary.header, std::move(why));
  });
  if (options.json) {
    report::Json json("slabd.what_if/1");
    json.field("software", daemon::software_version()).field("from", "scans").key("recipe").begin_object();
    json.field("name", recipe.name).field("sha256", recipe.sha256).field("file", recipe.path).end_object();
    what_if.write(json);
    fmt::print("{}", json.text());
  } else {
    fmt::print("what recipe {} ({}) would have decided, measured again from the scans\n", recipe.name.view(),
               recipe.path.view());
    fmt::print("{}", what_if.text(style_for(stdout)));
  }
  return what_if.any() ? kDone : kNotPass;
}

int replay(const ReplayOptions& options) {
  ReplaySources sources = open_sources(options);
  const std::vector<std::int64_t> keys = chosen_slabs(*sources.reader, options.choice);
  return options.recipe.empty() ? verify(options, sources, keys) : decide(options, sources, keys);
}

}  // namespace

void add_replay(args::Command& app) {
  auto options = std::make_shared<ReplayOptions>();
  args::Command command =
      app.add_subcommand("replay", "Measure stored slabs again: the same bits? or with another recipe");
  command->footer(
      "\nReads database and scans, changes nothing. --verify (the default): every block is measured again with the\n"
      "poses, calibration and recipe that are recorded, the slab is judged again, and each stored figure must come "
      "out\n"
      "with the same bits. Where one does not, what is not as it was is named: software, recipe, calibration, scan.\n"
      "A scan is proven by the checksum of its points; a recipe whose file is gone comes from the database.\n"
      "--recipe: what that recipe would have decided, item by item. Exit status 0: identical; 1: not, or not enough\n"
      "scans are left (of slabs chosen by filters, those whose scans were deleted for the budget do not count), or a\n"
      "slab has scans and no recipe.\n"
      "Examples: slabctl replay SLAB-0042 --verify\n"
      "          slabctl replay --since 7d --verify --json\n"
      "          slabctl replay --all --slab-type 5600 --recipe p5600-new.toml");
  options->choice.add_to(*command);
  options->database.add_to(*command);
  args::Option verify_flag = command->add_flag("--verify", options->verify, "Every stored figure must come out again");
  command->add_option("--recipe", options->recipe, "Recipe to decide by instead: a file, slab:SLAB or sha:PREFIX")
      ->excludes(verify_flag);
  command->add_option("--recipes", options->recipes_dir,
                      "Folder with the recipes, also former ones; default: the configuration's");
  command->add_option("--scans", options->scans_dir,
                      "A copy of the spool or an archive, for scans that were moved away");
  options->form.add_to(*command);
  command->add_option("--threads", options->threads, "Threads that measure; the results are the same")
      ->check(args::range(1, 2))
      ->capture_default_str();
  command->add_flag("--json", options->json, "Print slabd.replay/1, with --recipe slabd.what_if/1, on stdout");
  command->runs([options] { return replay(*options); });
}

}  // namespace slabd::cli
