// SPDX-License-Identifier: Apache-2.0
//
// slabctl replay: measures stored slabs again from their scans. With --verify all stored results must be reproduced;
// with --recipe another recipe judges, and the verdicts are compared. One process measures all slabs, or several
// measure a shard each (cli/replay/shard.h).
#include <fmt/core.h>

#include <algorithm>
#include <filesystem>
#include <map>
#include <memory>
#include <optional>

#include "algo/algo.h"
#include "cli/command.h"
#include "cli/database.h"
#include "cli/exit.h"
#include "cli/replay/replay_report.h"
#include "cli/replay/shard.h"
#include "cli/replay/slurm.h"
#include "cli/replay/verify.h"
#include "cli/replay/what_if.h"
#include "cli/slab_choice.h"
#include "cli/terminal/arguments.h"
#include "cli/terminal/parse.h"
#include "cli/terminal/progress.h"
#include "daemon/measure.h"
#include "report/json.h"

namespace slabd::cli {
namespace {

namespace fs = std::filesystem;

struct ReplayOptions {
  DatabaseOptions database;
  SlabChoice choice;
  bool verify = false;
  std::string recipe;
  std::string recipes_dir;
  std::string scans_dir;
  ScanFormOptions form{.unit = "", .columns = ""};
  int threads = config::default_measure_threads();
  bool threads_given = false;
  bool json = false;
  std::string shard;
  std::string out;
  std::string merge;
  int slurm_tasks = 0;
  bool beside_the_line = false;
};

struct ReplaySources {
  std::unique_ptr<storage::Reader> reader;
  std::string recipes_dir;
  ScanForms forms;
};

/// Recipes folder and scan form come from the command line, otherwise from the configuration.
ReplaySources open_sources(const ReplayOptions& options) {
  ReplaySources sources;
  config::Config config;
  if (options.database.db.empty()) config = config_from(options.database.config);
  sources.recipes_dir = options.recipes_dir.empty() ? config.recipes_dir : options.recipes_dir;
  sources.forms = ScanForms(config, options.form);
  sources.reader = open_database(options.database);
  return sources;
}

/// Judges the slab with `recipe`, or leaves it out with the reason.
WhatIfSlab judge_again(storage::Reader& reader, const storage::SlabRecord& record, const Recipe& recipe,
                       Remeasurer& remeasurer) {
  const SlabHeader& slab = record.summary.header;
  const auto out = [&](std::string why) { return left_out_slab(slab, std::move(why)); };
  if (record.summary.ended_utime_us == 0) return out("it is still open");
  if (record.summary.verdict == Verdict::aborted) return out("it was aborted");
  if (recipe.slab_type != slab.slab_type || recipe.stations() != slab.stations)
    return out(fmt::format("it is of slab type {} with {} blocks, the recipe of type {} with {}", slab.slab_type,
                           slab.stations, recipe.slab_type, recipe.stations()));
  const auto stored_basis = basis_of(reader, record, &recipe);
  if (!stored_basis) return out(std::string(stored_basis.error().text.view()));
  if (!stored_basis.value().missing.empty()) return out(stored_basis.value().missing_text());
  const SlabBasis& basis = stored_basis.value().basis;
  std::vector<std::unique_ptr<Remeasured>> again(record.blocks.size());
  std::vector<const BlockResult*> blocks(record.blocks.size(), nullptr);
  for (std::size_t i = 0; i < record.blocks.size(); ++i) {
    const storage::SlabBlock& stored = record.blocks[i];
    const bool valid = i + 1 == record.blocks.size() || record.blocks[i + 1].attempt.station != stored.attempt.station;
    if (!valid || stored.phase != StationPhase::measured) continue;
    again[i] = std::make_unique<Remeasured>();
    remeasurer.measure(slab, basis, stored, *again[i]);
    if (again[i]->scan != Remeasured::Scan::measured)
      return out(fmt::format("block {}: {} ({})", stored.attempt.station, again[i]->note, again[i]->path));
    if (again[i]->altered)
      return out(fmt::format("block {}: the scan was changed: {} ({})", stored.attempt.station, again[i]->note,
                             again[i]->path));
    blocks[i] = was_refused(stored.block, again[i]->block) ? nullptr : &again[i]->block;
  }
  const std::vector<StationRecord> stations = stations_of(record, blocks);
  std::vector<BlockResult> room(limits::kStationsMax);
  auto judged = std::make_unique<SlabResult>();
  daemon::judge_slab(basis, stations, room, *judged);
  return judged_slab(record, stations, *judged);
}

/// Measures one slab after the other.
class SlabMeasurer {
 public:
  /// Reads the recipes. `slabs`: number of slabs that will be measured.
  SlabMeasurer(const ReplayOptions& options, ReplaySources& sources, std::size_t slabs)
      : reader_(*sources.reader),
        kind_(options.recipe.empty() ? ReplayKind::verify : ReplayKind::what_if),
        remeasurer_(options.threads, sources.forms, options.scans_dir) {
    if (kind_ == ReplayKind::what_if) {
      recipe_ = recipe_named(sources.reader.get(), options.recipe);
      warn_unconfirmed(recipe_);
      remeasurer_.use(recipe_);
      return;
    }
    std::vector<config::Problem> problems;
    std::vector<Recipe> recipes = recipes_in(sources.recipes_dir, problems);
    static_cast<void>(report_problems(problems));
    for (const Recipe& recipe : recipes)
      recipe_files_.push_back({std::string(recipe.path.view()), std::string(recipe.sha256.view())});
    recipe_store_.emplace(std::move(recipes));
    progress_.emplace(stderr, slabs);
  }
  SlabMeasurer(const SlabMeasurer&) = delete;
  SlabMeasurer& operator=(const SlabMeasurer&) = delete;

  /// The result is empty if the daemon has pruned the slab meanwhile.
  [[nodiscard]] ReplayRecord measure(std::int64_t key) {
    ReplayRecord out;
    const auto record = need(reader_.slab(key), kNotReachable);
    if (!record) return out;
    const std::string what = fmt::format("measuring slab {} again", key);
    if (kind_ == ReplayKind::what_if) {
      const ProgressNote note(stderr, what + " ...", std::chrono::seconds(1));
      out.judged = judge_again(reader_, *record, recipe_, remeasurer_);
    } else {
      progress_->next(what);
      out.verified = need(replay_slab(reader_, *record, *recipe_store_, remeasurer_), kNotReachable);
      progress_->erase();
    }
    return out;
  }

  [[nodiscard]] ReplayKind kind() const { return kind_; }
  /// The recipe that judges; empty in a verification.
  [[nodiscard]] RecipeName recipe() const {
    return {std::string(recipe_.name.view()), std::string(recipe_.sha256.view()), std::string(recipe_.path.view())};
  }
  /// The readable recipes of the folder in a verification.
  [[nodiscard]] const std::vector<RecipeFile>& recipe_files() const { return recipe_files_; }

 private:
  storage::Reader& reader_;
  ReplayKind kind_;
  Remeasurer remeasurer_;
  Recipe recipe_;
  std::vector<RecipeFile> recipe_files_;
  std::optional<RecipeStore> recipe_store_;
  std::optional<ProgressCount> progress_;
};

/// The keys with the begin of each slab, in the order of the keys.
std::vector<SelectedSlab> selected(storage::Reader& reader, const std::vector<std::int64_t>& keys) {
  storage::SlabFilter all;
  all.limit = 1'000'000'000;
  std::map<std::int64_t, std::int64_t> began_utime_us;
  for (const storage::SlabSummary& slab : need(reader.slabs(all), kNotReachable))
    began_utime_us[slab.header.key] = slab.header.began_utime_us;
  std::vector<SelectedSlab> slabs;
  for (const std::int64_t key : keys)
    if (began_utime_us.contains(key)) slabs.push_back({key, began_utime_us[key]});
  return slabs;
}

/// Control socket of the daemon on this machine, also for a command with --db.
std::string control_socket(const ReplayOptions& options) {
  config::Config config;
  std::vector<config::Problem> ignored;
  config::load_config(options.database.config, config, ignored);
  return config.control_socket;
}

std::string absolute(const std::string& path) {
  return fs::absolute(path).lexically_normal().string();
}

/// Options of this command for each task, with absolute paths and times: a task has another folder and begins later.
std::vector<std::string> task_options(const ReplayOptions& options) {
  std::vector<std::string> words = options.choice.slabs;
  const auto add = [&](const char* option, const std::string& value) {
    if (!value.empty()) words.insert(words.end(), {option, value});
  };
  const auto add_flag = [&](const char* flag, bool given) {
    if (given) words.emplace_back(flag);
  };
  const auto path = [](const std::string& name) { return name.empty() ? name : absolute(name); };
  const SlabChoice& choice = options.choice;
  add_flag("--all", choice.all);
  add("--since", report::iso_time(time_of("--since", choice.since)));
  add("--until", report::iso_time(time_of("--until", choice.until)));
  add("--slab-type", choice.slab_type == 0 ? "" : fmt::format("{}", choice.slab_type));
  add("--verdict", choice.verdict);
  if (options.database.db.empty())
    add("--config", path(options.database.config));
  else
    add("--db", path(options.database.db));
  add_flag("--verify", options.verify);
  add("--recipe", names_stored_recipe(options.recipe) ? options.recipe : path(options.recipe));
  add("--recipes", path(options.recipes_dir));
  add("--scans", path(options.scans_dir));
  add("--unit", options.form.unit);
  add("--columns", options.form.columns);
  add("--threads", fmt::format("{}", options.threads));
  add_flag("--beside-the-line", options.beside_the_line);
  return words;
}

int print_slurm_script(const ReplayOptions& options) {
  options.choice.check();
  std::error_code fault;
  const fs::path program = fs::read_symlink("/proc/self/exe", fault);
  const std::string out = absolute(options.out.empty() ? "replay-shards" : options.out);
  fmt::print("{}", slurm_script({fault ? "slabctl" : program.string(), task_options(options), out, options.slurm_tasks,
                                 options.threads}));
  return kDone;
}

/// Stops if options are given together that exclude each other.
void check_options(const ReplayOptions& options) {
  const bool sharded = !options.shard.empty() || options.slurm_tasks > 0;
  const bool chosen = !options.choice.slabs.empty() || options.choice.has_filter() || options.verify ||
                      !options.recipe.empty() || !options.recipes_dir.empty() || !options.scans_dir.empty() ||
                      !options.database.db.empty() || options.threads_given;
  if (!options.merge.empty() && (chosen || sharded || !options.out.empty() || options.beside_the_line))
    stop(kUsage, "--merge accepts only --json: slabs, recipe and options are stored in the folder");
  if (!options.shard.empty() && options.slurm_tasks > 0)
    stop(kUsage, "--shard and --slurm are given together; the script of --slurm contains --shard");
  if (!options.shard.empty() && options.out.empty()) stop(kUsage, "--shard requires --out: the folder of the results");
  if (sharded && options.json) stop(kUsage, "--json belongs to --merge: a shard writes files");
  if (!sharded && (!options.out.empty() || options.beside_the_line))
    stop(kUsage, "--out and --beside-the-line require --shard or --slurm");
}

ReplayHead head_of(const ReplayOptions& options, const SlabMeasurer& measurer) {
  return {measurer.kind(),   std::string(daemon::software_version().view()),
          options.threads,   std::string(algo::instruction_set()),
          measurer.recipe(), !options.choice.slabs.empty()};
}

int replay_all(const ReplayOptions& options) {
  ReplaySources sources = open_sources(options);
  const std::vector<std::int64_t> keys = chosen_slabs(*sources.reader, options.choice);
  SlabMeasurer measurer(options, sources, keys.size());
  ReplayReport report(head_of(options, measurer), options.json);
  for (const std::int64_t key : keys) report.add(measurer.measure(key));
  return report.end();
}

int replay_shard(const ReplayOptions& options, const Shard& shard) {
  const std::string socket = control_socket(options);
  give_way_to_line(socket);
  ReplaySources sources = open_sources(options);
  const std::vector<std::int64_t> keys = chosen_slabs(*sources.reader, options.choice);
  const auto in_shard = [&](std::int64_t key) { return shard.contains(key); };
  SlabMeasurer measurer(options, sources, static_cast<std::size_t>(std::count_if(keys.begin(), keys.end(), in_shard)));
  const ReplayHead head = head_of(options, measurer);
  Selection selection;
  selection.inputs.kind = name(head.kind);
  selection.inputs.software = head.software;
  selection.inputs.build = build_sha256();
  selection.inputs.threads = head.threads;
  selection.inputs.unit = sources.forms.unit();
  selection.inputs.columns = sources.forms.columns();
  selection.inputs.scans = options.scans_dir;
  selection.inputs.recipe = head.recipe;
  selection.inputs.recipes = measurer.recipe_files();
  selection.named = head.named;
  selection.slabs = selected(*sources.reader, keys);
  return run_shard({shard, options.out, options.beside_the_line ? "" : socket}, selection, head,
                   [&](std::int64_t key) { return measurer.measure(key); });
}

int replay(ReplayOptions options) {
  check_options(options);
  if (!options.merge.empty()) return merge_shards(options.merge, options.json);
  const std::optional<Shard> shard = parse_shard(options.shard);
  if (!shard && options.slurm_tasks == 0) return replay_all(options);
  // The number of threads is part of the output, and must not depend on the machine of a shard.
  if (!options.threads_given) options.threads = 1;
  return shard ? replay_shard(options, *shard) : print_slurm_script(options);
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
      "--shard: several processes measure a part each, on one machine or several, and write a file for each slab into\n"
      "the folder --out; a shard that is run again continues. --merge prints what one process would have printed\n"
      "(docs/REPLAY.md). Exit status 3: a slab is missing, or a file is damaged or has other inputs; 4: a slab is "
      "open\n"
      "on the line of this machine.\n"
      "Examples: slabctl replay SLAB-0042 --verify\n"
      "          slabctl replay --since 7d --verify --json\n"
      "          slabctl replay --all --slab-type 5600 --recipe p5600-new.toml\n"
      "          slabctl replay --all --verify --shard 2/8 --out /srv/replay\n"
      "          slabctl replay --merge /srv/replay --json");
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
  args::Option threads =
      command->add_option("--threads", options->threads, "Threads that measure; the results are the same")
          ->check(args::range(1, 2))
          ->capture_default_str();
  command->add_flag("--json", options->json, "Print slabd.replay/1, with --recipe slabd.what_if/1, on stdout");
  command->add_option("--shard", options->shard, "Measure only part i of n, as i/n; --out has the results")
      ->check([](const std::string& text) {
        return parse_shard(text) ? std::string()
                                 : fmt::format("\"{}\" is not i/n with 1 <= i <= n <= {}", text, kShardsMax);
      });
  command->add_option("--out", options->out, "Folder of the results of all shards");
  command->add_flag("--beside-the-line", options->beside_the_line,
                    "Measure the shard also while a slab is open on the line of this machine");
  command->add_option("--merge", options->merge, "Print the result of all shards in this folder");
  command->add_option("--slurm", options->slurm_tasks, "Print a batch script for Slurm with this number of shards")
      ->check(args::range(1, kSlurmTasksMax));
  command->runs([options, threads] {
    options->threads_given = threads.count() > 0;
    return replay(*options);
  });
}

}  // namespace slabd::cli
