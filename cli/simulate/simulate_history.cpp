// SPDX-License-Identifier: Apache-2.0
//
// The rows are those of a measured slab, written by the storage functions of the daemon; only scans and maps are
// missing. Every slab is marked as emulated.
#include "cli/simulate/simulate_history.h"

#include <fmt/core.h>

#include <chrono>
#include <filesystem>
#include <memory>
#include <string>

#include "cli/client/calibration_change.h"
#include "cli/command.h"
#include "cli/exit.h"
#include "cli/simulate/simulate_calibration.h"
#include "cli/terminal/arguments.h"
#include "cli/terminal/parse.h"
#include "cli/terminal/progress.h"
#include "daemon/measure.h"
#include "emulator/slab_history.h"
#include "report/json.h"
#include "storage/history_writer.h"

namespace slabd::cli::simulate {
namespace {

/// Slabs between two steps of the progress.
constexpr std::size_t kStep = 500;

struct Options {
  std::string recipe;
  std::string out;
  emulator::HistoryPlan plan;
  double days = 0.0;  ///< 0: every mould casts once a day
};

/// Executes the jobs of one slab, as the daemon does.
class Writer {
 public:
  explicit Writer(const storage::StoreSettings& settings) : writer_(cli::need(storage::write_history(settings))) {
    apply(SessionJob{kSession});
  }

  void add(const emulator::HistorySlab& slab) {
    const SlabHeader& header = slab.header;
    apply(BeginSlabJob{header, kSession, next(cmd_seq_)});
    for (std::size_t i = 0; i < slab.blocks.size(); ++i) {
      const std::uint16_t seq = next(cmd_seq_);
      Attempt attempt = slab.attempts[i];
      attempt.session = kSession;
      attempt.cmd_seq = seq;
      apply(CommandJob{kSession, seq, static_cast<std::uint16_t>(PlcCommand::scan), attempt.station, header.key,
                       attempt.scan_utime_us});
      apply(AcquiredJob{attempt, 0, 0, false});
      BlockJob block;
      block.slab_key = header.key;
      block.attempt = attempt.number;
      block.block = slab.blocks[i];
      block.record = completed(station_record(slab.blocks[i]), header, seq, attempt.scan_utime_us);
      apply(block);
      apply(AckJob{res_seq_});
    }
    const std::uint16_t seq = next(cmd_seq_);
    apply(CommandJob{kSession, seq, static_cast<std::uint16_t>(PlcCommand::slab_end), 0, header.key,
                     slab.ended_utime_us});
    SlabJob end;
    end.slab_key = header.key;
    end.slab = slab.slab;
    end.record = completed(slab_record(slab.slab, header.stations), header, seq, slab.ended_utime_us);
    end.ended_utime_us = slab.ended_utime_us;
    apply(end);
    apply(AckJob{res_seq_});
  }

  void finish() { cli::need(writer_->finish(), cli::kNotReachable); }

 private:
  static constexpr std::uint16_t kSession = 1;

  static std::uint16_t next(std::uint16_t& seq) { return seq = next_sequence(seq); }

  PlcResult completed(PlcResult record, const SlabHeader& header, std::uint16_t cmd_seq, std::int64_t utime_us) {
    record.res_seq = next(res_seq_);
    record.cmd_seq = cmd_seq;
    record.slab_no = header.slab_no;
    record.scan_utime_us = utime_us;
    record.emulated = header.emulated;
    return record;
  }

  void apply(const decltype(StoreJob::what)& what) {
    job_.what = what;
    cli::need(writer_->apply(job_), cli::kNotReachable);
  }

  std::unique_ptr<storage::HistoryWriter> writer_;
  StoreJob job_;
  std::uint16_t cmd_seq_ = 0;
  std::uint16_t res_seq_ = 0;
};

std::string truth_json(const emulator::SlabHistory& history, const emulator::HistoryPlan& plan) {
  report::Json json("slabd.history_truth/1");
  json.field("seed", plan.seed).field("slabs", plan.slabs).field("moulds", plan.moulds).field("days", plan.days);
  json.field("end_utime", plan.end_utime_us);
  json.key("scatter").begin_array();
  for (std::size_t i = 0; i < kItemCount; ++i) {
    const auto item = static_cast<ItemId>(i);
    if (history.scatter(item) == 0.0) continue;
    json.begin_object().field("item", info(item).name).field("unit", name(info(item).unit));
    json.field("std", history.scatter(item)).end_object();
  }
  json.end_array();
  json.list("effects", history.truth(), [&](const emulator::PlantedEffect& effect) {
    json.field("mould", report::only_if(effect.mould != 0, effect.mould)).field("item", info(effect.item).name);
    json.field("station", report::only_if(effect.station != 0, effect.station));
    json.field("station_to", report::only_if(effect.station_to != 0, effect.station_to));
    json.field("bias", effect.bias).field("change_per_day", effect.change_per_day);
  });
  return json.text();
}

int write_history(Options options) {
  const Recipe recipe = cli::recipe_from(options.recipe);
  emulator::HistoryPlan& plan = options.plan;
  plan.days = options.days > 0.0 ? options.days : static_cast<double>(plan.slabs) / static_cast<double>(plan.moulds);
  plan.end_utime_us = cli::wall_clock_us();
  plan.software = daemon::software_version();
  const emulator::SlabHistory history(recipe, plan);
  storage::StoreSettings settings;
  settings.db_path = options.out;
  if (const auto text = text_of(options.recipe))
    settings.recipe_texts.push_back({recipe.sha256, recipe.name, *text, 0});
  const std::string truth_path = std::filesystem::path(options.out).replace_extension(".truth.json").string();
  const auto began = std::chrono::steady_clock::now();
  {
    Writer writer(settings);
    cli::ProgressCount progress(stderr, (plan.slabs + kStep - 1) / kStep);
    emulator::HistorySlab slab;
    for (std::size_t i = 0; i < plan.slabs; ++i) {
      if (i % kStep == 0) progress.next(fmt::format("slab {} of {}", i + 1, plan.slabs));
      history.make(i, slab);
      writer.add(slab);
    }
    writer.finish();
  }
  write_text(truth_path, truth_json(history, plan));
  const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - began).count();
  fmt::print("{}: {} slabs of {} moulds over {:.0f} days, in {:.1f} s; truth in {}\n", options.out, plan.slabs,
             plan.moulds, plan.days, seconds, truth_path);
  return cli::kDone;
}

}  // namespace

void add_simulate_history(args::Command& simulate) {
  auto options = std::make_shared<Options>();
  args::Command command = simulate.add_subcommand(
      "history", "Write a database with years of slabs of many moulds, and their truth beside it");
  command->footer(
      "\nThe records of the slabs, without scans: for `slabctl mould`, `trend`, `yield` and the page. Moulds and\n"
      "stations have planted biases and wear.\n"
      "Example: slabctl simulate history --slabs 3000 --moulds 40 --out history.db\n"
      "         slabctl mould list --db history.db");
  command
      ->add_option("--out", options->out, "Database to write; it must not exist. The truth: its name with .truth.json")
      ->required();
  command->add_option("--recipe", options->recipe, "Recipe of the slab type")
      ->default_val("/usr/share/slabd/recipes/p5600.toml");
  command->add_option("--slabs", options->plan.slabs, "How many slabs")
      ->check(args::range(std::size_t{1}, std::size_t{1'000'000}))
      ->capture_default_str();
  command->add_option("--moulds", options->plan.moulds, "How many moulds cast them, at random")
      ->check(args::range(std::size_t{1}, std::size_t{1'000}))
      ->capture_default_str();
  command->add_option("--days", options->days, "Over how many days, until now; default: each mould casts once a day")
      ->check(cli::within(0.01, 100'000.0));
  command->add_option("--seed", options->plan.seed, "Decides everything random")->capture_default_str();
  command->runs([options] { return write_history(*options); });
}

}  // namespace slabd::cli::simulate
