// SPDX-License-Identifier: Apache-2.0
//
// slabctl history: the newest slabs, one line each.
#include <fmt/core.h>
#include <algorithm>
#include <memory>
#include <vector>

#include "cli/command.h"
#include "cli/database.h"
#include "cli/exit.h"
#include "cli/terminal/arguments.h"
#include "cli/terminal/parse.h"
#include "cli/terminal/render.h"
#include "cli/terminal/say.h"
#include "report/json.h"
#include "report/slab_view.h"
#include "report/words.h"

namespace slabd::cli {
namespace {

struct Options {
  DatabaseOptions database;
  storage::SlabFilter filter;
  std::string since;
  std::string until;
  std::string item;
  std::string verdict;
  std::string disposition;
  LanguageOption language;
  bool json = false;
};

/// The options of the command line as a filter.
storage::SlabFilter filter_of(const Options& options) {
  storage::SlabFilter filter = options.filter;
  if (!options.since.empty()) filter.since_utime_us = time_of("--since", options.since);
  if (!options.until.empty()) filter.until_utime_us = time_of("--until", options.until);
  if (!options.since.empty() && !options.until.empty() && filter.since_utime_us >= filter.until_utime_us)
    stop(kUsage, say("--since {} is not before --until {}", options.since, options.until));
  filter.disposition = disposition_named(options.disposition).value_or(Disposition::none);
  filter.verdict = verdict_from_name(options.verdict).value_or(Verdict::none);
  if (!options.item.empty()) {
    filter.item = item_from_name(options.item);
    if (!filter.item) {
      std::vector<std::string> names;
      for (std::size_t i = 0; i < kItemCount; ++i) names.emplace_back(info(static_cast<ItemId>(i)).name);
      const std::string meant = nearest(options.item, names);
      stop(kUsage, meant.empty() ? say("--item: no item '{}'", options.item)
                                 : say("--item: no item '{}', did you mean '{}'?", options.item, meant));
    }
  }
  return filter;
}

const char* name(storage::HistoryGap::What what) {
  switch (what) {
    case storage::HistoryGap::What::restored: return "restored";
    case storage::HistoryGap::What::begun_anew: return "begun_anew";
    case storage::HistoryGap::What::pruned: return "pruned";
  }
  return "unknown";
}

/// Describes a gap of the history in a sentence.
std::string gap_text(const storage::HistoryGap& gap) {
  if (gap.what == storage::HistoryGap::What::pruned)
    return say("{} slabs up to key {} were taken away by retention", gap.slabs, gap.slab_key);
  const std::string by = say("{} by {}: {}", report::iso_time(gap.note.utime_us), gap.note.who, gap.note.why);
  if (gap.what == storage::HistoryGap::What::begun_anew)
    return say("the history was started again {}; nothing from before is here", by);
  std::string missing = say("slabs up to key {} may be missing", gap.slab_key);
  if (gap.kept_key >= gap.slab_key)
    missing =
        say("no slab is known to be missing, but if the database before it was lost or damaged, it is unknown "
            "after that backup");
  else if (gap.kept_key + 1 == gap.slab_key)
    missing = say("the slab of key {} may be missing", gap.slab_key);
  else if (gap.kept_key > 0)
    missing = say("slabs of keys {} to {} may be missing", gap.kept_key + 1, gap.slab_key);
  return say("the history was restored from {} {}; {}; calibrations and checks from after that backup may be missing",
             gap.source, by, missing);
}

std::string as_json(const std::vector<storage::SlabSummary>& slabs, bool more,
                    const std::vector<storage::HistoryGap>& gaps) {
  report::Json json("slabd.history/1");
  json.list("slabs", slabs, [&](const storage::SlabSummary& slab) {
    json.field("key", slab.header.key).field("slab_id", slab.header.slab_id).field("slab_no", slab.header.slab_no);
    json.field("slab_type", slab.header.slab_type).field("recipe", slab.header.recipe);
    report::write_time(json, "began", slab.header.began_utime_us);
    report::write_time(json, "ended", slab.ended_utime_us);
    json.field("verdict", slab.verdict).field("reason", slab.reason).field("stations_measured", slab.stations_measured);
    json.field("stations", slab.header.stations).field("acknowledged", slab.acknowledged);
    json.field("disposition", report::only_if(slab.disposition != Disposition::none, name(slab.disposition)));
    report::write_emulation(json, slab.header.emulated);
    json.field("mould", report::only_if(slab.header.mould != 0, slab.header.mould));
  });
  json.field("more", more);
  json.list("gaps", gaps, [&](const storage::HistoryGap& gap) {
    json.field("what", name(gap.what)).field("slab_key", gap.slab_key).field("slabs", gap.slabs);
    report::write_time(json, "at", gap.note.utime_us);
    json.field("who", gap.note.who).field("why", gap.note.why).field("source", gap.source);
  });
  return json.text();
}

std::string slabs_text(const std::vector<storage::SlabSummary>& slabs) {
  report::Table table{say("key"),    say("slab no"), say("id<"),      say("type"),
                      say("began<"), say("blocks"),  say("verdict<"), say("reason<")};
  // The column is shown only if it has content.
  const bool emulated = std::any_of(slabs.begin(), slabs.end(),
                                    [](const storage::SlabSummary& slab) { return slab.header.emulated != 0; });
  if (emulated) table.columns.emplace_back(say("emulated<"));
  table.columns.emplace_back(say("mould?"));
  const bool decided = std::any_of(slabs.begin(), slabs.end(), [](const storage::SlabSummary& slab) {
    return slab.disposition != Disposition::none;
  });
  if (decided) table.columns.emplace_back(say("disposition<"));
  for (const storage::SlabSummary& slab : slabs) {
    const bool open = slab.ended_utime_us == 0;
    table.add(slab.header.key, slab.header.slab_no, slab.header.slab_id, slab.header.slab_type,
              report::iso_time(slab.header.began_utime_us),
              fmt::format("{}/{}", slab.stations_measured, slab.header.stations),
              open ? report::Cell(say("open")) : report::Cell(slab.verdict), open ? "" : reason_words(slab.reason));
    if (emulated) table.rows.back().emplace_back(report::emulation_mark(slab.header.emulated, language_in_use()));
    table.rows.back().push_back(slab.header.mould == 0 ? report::Cell("") : report::Cell(slab.header.mould));
    if (decided) table.rows.back().emplace_back(report::disposition_word(slab.disposition, language_in_use()));
  }
  return report::text_of(table, style_for(stdout)) +
         (emulated ? say("! EMULATED: no verdict on concrete; `slabctl show` names what was not real\n") : "");
}

/// Why the list is empty.
std::string none_text(const Options& options) {
  const storage::SlabFilter& f = options.filter;
  const bool any = options.since.empty() && options.until.empty() && options.item.empty() && options.verdict.empty() &&
                   options.disposition.empty() && f.slab_type == 0 && f.mould == 0 && f.id_part.empty() && f.block == 0;
  return any ? say("no slab yet; `slabctl commission` names the next step\n") : say("no slab fits these conditions\n");
}

int show_history(const Options& options) {
  set_language(options.language, options.json);
  storage::SlabFilter filter = filter_of(options);
  const auto reader =
      open_database(options.database, options.json ? storage::TextFor::programs : storage::TextFor::people);
  const std::size_t limit = filter.limit;
  ++filter.limit;  // an additional slab, not shown, detects whether there are more
  auto slabs = need(reader->slabs(filter), kNotReachable);
  const bool more = slabs.size() > limit;
  if (more) slabs.resize(limit);
  const auto gaps = need(reader->gaps(), kNotReachable);
  fmt::print("{}", options.json ? as_json(slabs, more, gaps) : slabs_text(slabs));
  if (!options.json) {
    if (slabs.empty()) fmt::print("{}", none_text(options));
    if (more) fmt::print("{}", say("! more than {}: --limit sets the number\n", limit));
    for (const storage::HistoryGap& gap : gaps) fmt::print("! {}\n", gap_text(gap));
  }
  return kDone;
}

}  // namespace

void DatabaseOptions::add_to(args::Command& command) {
  args::Option config_option =
      command.add_option("--config", config, "Configuration that names the database")->default_val(default_config());
  command.add_option("--db", db, "Database, instead of the configuration's")->excludes(config_option);
}

std::unique_ptr<storage::Reader> open_database(const DatabaseOptions& options, storage::TextFor text) {
  const std::string path = options.db.empty() ? config_from(options.config).storage.db_path : options.db;
  auto reader = storage::open_reader(path, text);
  if (!reader && reader.error().text.view().find("file is not a database") != std::string_view::npos)
    stop(kBadInput, say("{} is not a database of slabd", path));
  return need(std::move(reader), kNotReachable);
}

void add_history(args::Command& app) {
  auto options = std::make_shared<Options>();
  args::Command command = app.add_subcommand("history", "The newest slabs and their verdicts, or those you look for");
  command->footer(
      "\nReads the database while the daemon runs; changes nothing. All conditions must hold. --verdict is the\n"
      "slab's; with --block that station's, with --item the item's. With --item or --block alone: any but pass.\n"
      "Examples: slabctl history --limit 50 --json\n"
      "          slabctl history --since 7d --verdict fail\n"
      "          slabctl history --item jaw_distance --block 11");
  options->database.add_to(*command);
  command->add_option("--limit", options->filter.limit, "How many slabs, newest first")
      ->check(args::range(std::size_t{1}, std::size_t{100'000}))
      ->capture_default_str();
  command->add_option("--since", options->since, "Began then or later: 2026-11-20, 2026-11-20T08:00:00Z, 7d, 12h");
  command->add_option("--until", options->until, "Began before that");
  command->add_option("--slab-type", options->filter.slab_type, "Only this SLAB_TYPE")->check(args::range(1, 65'535));
  command->add_option("--mould", options->filter.mould, "Only slabs of this mould")->check(args::range(1, 65'535));
  command->add_option("--id", options->filter.id_part, "With this somewhere in the slab id");
  command->add_option("--verdict", options->verdict, "With this verdict")->check(args::one_of(verdict_names()));
  command->add_option("--disposition", options->disposition, "With this decision of quality in force")
      ->check(args::one_of({"hold", "release_by_concession", "rework", "scrap", "re_inspect"}));
  command->add_option("--block", options->filter.block, "At this block")
      ->check(args::range(1, static_cast<int>(limits::kStationsMax)));
  command->add_option("--item", options->item, "Only this item, as `slabctl show` names it");
  options->language.add_to(*command, "Language of the text");
  command->add_flag("--json", options->json, "Print slabd.history/1 on stdout");
  command->runs([options] { return show_history(*options); });
}

}  // namespace slabd::cli
