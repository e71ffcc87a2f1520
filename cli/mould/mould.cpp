// SPDX-License-Identifier: Apache-2.0
//
// slabctl mould list, show, sheet, reset: how the slabs of each mould deviate, what to correct, and the times at which
// a mould was adjusted.
#include <fmt/core.h>

#include <algorithm>
#include <memory>

#include "base/durable.h"
#include "cli/client/calibration_change.h"
#include "cli/command.h"
#include "cli/database.h"
#include "cli/exit.h"
#include "cli/mould/ledger.h"
#include "cli/terminal/arguments.h"
#include "cli/terminal/document.h"
#include "cli/terminal/parse.h"
#include "cli/terminal/render.h"
#include "report/figures.h"

namespace slabd::cli {
namespace {

using mould::Ledger;
using report::pick;

struct Options {
  DatabaseOptions database;
  std::uint16_t mould = 0;
  int epoch = 0;  ///< 0: the newest with slabs
  std::size_t castings = storage::MouldFilter{}.castings;
  int slab_type = 0;
  std::string since;
  std::string until;
  LanguageOption language;
  DocumentOptions document;
  TableOutput output;
  bool full = false;
};

struct ResetOptions {
  std::string config;
  std::uint16_t mould = 0;
  std::string since;
  std::string who;
  std::string why;
};

Ledger read_ledger(const Options& options) {
  storage::MouldFilter filter;
  filter.castings = options.castings;
  filter.slab_type = options.slab_type;
  if (!options.since.empty()) filter.since_utime_us = time_of("--since", options.since);
  if (!options.until.empty()) filter.until_utime_us = time_of("--until", options.until);
  const auto reader = open_database(options.database);
  return mould::ledger_of(need(reader->mould_records(filter), kNotReachable));
}

/// Rows of a mould with slabs, oldest epoch first; stops if there are none.
std::vector<std::size_t> rows_of(const Ledger& ledger, const Options& options) {
  std::vector<std::size_t> rows;
  for (std::size_t i = 0; i < ledger.rows.size(); ++i)
    if (ledger.rows[i].mould == options.mould && ledger.rows[i].slabs > 0) rows.push_back(i);
  if (rows.empty())
    stop(kBadInput, fmt::format("no ended slab of mould {} in this selection; `slabctl mould list` lists the moulds",
                                options.mould));
  return rows;
}

void print_remarks(const Ledger& ledger, report::Language language) {
  for (const std::string& remark : mould::remarks_of(ledger, language)) fmt::print("! {}\n", remark);
}

int list_moulds(const Options& options) {
  const Ledger ledger = read_ledger(options);
  if (options.output.json) {
    fmt::print("{}", mould::as_json(ledger, 0));
    return kDone;
  }
  const report::Language language = options.language.chosen();
  options.output.print(mould::moulds_table(ledger, language), report::Json(), "moulds");
  if (options.output.csv || options.output.html) return kDone;
  if (const report::Table line = mould::line_table(ledger, language); !line.rows.empty())
    fmt::print("\n{}\n\n{}", line.title, report::text_of(line, style_for(stdout)));
  print_remarks(ledger, language);
  return kDone;
}

int show_mould(const Options& options) {
  const Ledger ledger = read_ledger(options);
  const std::vector<std::size_t> rows = rows_of(ledger, options);
  if (options.output.json) {
    fmt::print("{}", mould::as_json(ledger, options.mould));
    return kDone;
  }
  const report::Language language = options.language.chosen();
  const report::Style style = style_for(stdout);
  for (const std::size_t row : rows) {
    const mould::Row& r = ledger.rows[row];
    fmt::print(fmt::runtime(pick(language, "mould {}, epoch {}, slab type {}: {} slabs, cast {} to {}\n",
                                 "模具 {}，周期 {}，板型 {}：{} 块板，浇筑时间 {} 至 {}\n")),
               r.mould, r.epoch, r.slab_type, r.slabs, report::iso_time(r.first_utime_us),
               report::iso_time(r.last_utime_us));
    const report::Table effects = mould::effects_table(ledger, row, options.full, language);
    if (effects.rows.empty())
      fmt::print("{}\n", pick(language, "no effect of this mould is proven; --full shows all",
                              "未证实该模具有任何效应；--full 显示全部"));
    else
      fmt::print("{}\n\n{}", effects.title, report::text_of(effects, style));
    fmt::print("\n");
  }
  for (const storage::MouldReset& reset : ledger.resets)
    if (reset.mould == options.mould)
      fmt::print(fmt::runtime(pick(language, "reset from {}: {} ({})\n", "自 {} 起重置：{}（{}）\n")),
                 report::iso_time(reset.from_utime_us), reset.note.why, reset.note.who);
  print_remarks(ledger, language);
  return kDone;
}

int write_sheet(const Options& options) {
  const bool csv = options.document.extension() == ".csv";
  if (!csv && options.document.extension() != ".pdf" && options.document.extension() != ".html")
    stop(kUsage, fmt::format("--out {}: the name must end in .pdf, .html or .csv", options.document.out));
  const report::Language language = options.document.wanted();
  const Ledger ledger = read_ledger(options);
  const std::vector<std::size_t> rows = rows_of(ledger, options);
  const auto type_of = [&](std::size_t i) { return ledger.rows[i].slab_type; };
  for (const std::size_t i : rows)
    if (type_of(i) != type_of(rows.front()))
      stop(kUsage, fmt::format("mould {} has cast slabs of types {} and {}: choose one with --slab-type", options.mould,
                               type_of(rows.front()), type_of(i)));
  const auto row =
      options.epoch == 0 ? std::prev(rows.end()) : std::find_if(rows.begin(), rows.end(), [&](std::size_t i) {
        return ledger.rows[i].epoch == options.epoch;
      });
  if (row == rows.end()) stop(kBadInput, fmt::format("mould {} has no slab of epoch {}", options.mould, options.epoch));
  if (csv) {
    const report::Table table = mould::seats_table(ledger, *row, language);
    need(write_durably(options.document.out,
                       report::csv_heading(table) + report::csv_rows(table, report::TableFor::spreadsheet)),
         kBadInput);
  } else {
    options.document.write(mould::sheet_of(ledger, *row, language));
  }
  const mould::Row& r = ledger.rows[*row];
  fmt::print("{}: mould {}, epoch {}, slab type {}, {} slabs\n", options.document.out, r.mould, r.epoch, r.slab_type,
             r.slabs);
  if (!r.current) complain(fmt::format("mould {} was reset after these slabs were cast", r.mould));
  return kDone;
}

int reset_mould(const ResetOptions& options) {
  const config::Config config = config_from(options.config);
  finish_killed_change(config);
  storage::ResetMould reset;
  reset.mould = options.mould;
  reset.note = {options.who.empty() ? default_operator() : options.who, options.why, wall_clock_us()};
  reset.from_utime_us = options.since.empty() ? reset.note.utime_us : time_of("--since", options.since);
  const ChangeAnswer done = need(change_calibration(config, reset));
  fmt::print("{}: slabs cast from {} on have figures of their own\n", done.id, report::iso_time(reset.from_utime_us));
  return kDone;
}

void add_selection(args::Command& command, Options& options) {
  command.add_option("--castings", options.castings, "How many slabs of each mould, the newest")
      ->check(args::range(std::size_t{1}, std::size_t{100'000}))
      ->capture_default_str();
  command.add_option("--slab-type", options.slab_type, "Only slabs of this SLAB_TYPE")->check(args::range(1, 65'535));
  command.add_option("--since", options.since, "Inspected then or later: 2026-11-20, 2026-11-20T08:00:00Z, 7d, 12h");
  command.add_option("--until", options.until, "Inspected before that");
  options.database.add_to(command);
}

args::Command add_one(args::Command& app, const std::string& name, const std::string& help, std::uint16_t& mould) {
  args::Command command = app.add_subcommand(name, help);
  command->add_option("MOULD", mould, "Its number, as the PLC sends it")->required()->check(args::range(1, 65'535));
  return command;
}

}  // namespace

void add_mould(args::Command& app) {
  args::Command moulds = app.add_subcommand("mould", "How the slabs of each mould deviate, and what to correct");
  moulds->require_subcommand(1);
  moulds->footer(
      "\nA deviation that goes with a mould is the mould's; one that all moulds have at a station is the inspection\n"
      "line's. An effect is signalled from four standard errors on, and shown grey below five slabs. No figure\n"
      "affects a verdict.");

  auto list = std::make_shared<Options>();
  args::Command listing = moulds.add_subcommand("list", "All moulds, their signals, and the effects of the line");
  add_selection(listing, *list);
  list->output.add_to(listing, "slabd.moulds/1");
  list->language.add_to(listing, "Language of the screen");
  listing->runs([list] { return list_moulds(*list); });

  auto show = std::make_shared<Options>();
  args::Command showing = add_one(moulds, "show", "One mould: its effects, its epochs", show->mould);
  showing->add_flag("--full", show->full, "Also effects without a signal");
  add_selection(showing, *show);
  showing->add_flag("--json", show->output.json, "Print slabd.moulds/1 on stdout");
  show->language.add_to(showing, "Language of the screen");
  showing->runs([show] { return show_mould(*show); });

  auto sheet = std::make_shared<Options>();
  args::Command sheets =
      add_one(moulds, "sheet", "Write the sheet for the fitter: the shim at each seat", sheet->mould);
  sheets->footer("\nExample: slabctl mould sheet 7 --out mould-7.pdf --language zh");
  sheets->add_option("--out", sheet->document.out, "File to write: .pdf, .html or .csv")->required();
  sheets->add_option("--epoch", sheet->epoch, "Epoch; default: the newest with slabs")->check(args::range(1, 10'000));
  sheet->document.language.add_to(sheets, "Language of the document");
  add_selection(sheets, *sheet);
  sheets->runs([sheet] { return write_sheet(*sheet); });

  auto reset = std::make_shared<ResetOptions>();
  args::Command resetting = add_one(moulds, "reset", "Begin a new epoch of a mould that was adjusted", reset->mould);
  resetting->footer(
      "\nThe slabs cast until then keep their figures. Time of casting: begin of the inspection minus AGE of the PLC.\n"
      "Example: slabctl mould reset 7 --why \"shims of sheet 2026-11-20 set\"");
  resetting->add_option("--why", reset->why, "Reason, for the history")->required()->check(some_words());
  resetting->add_option("--since", reset->since, "When it was adjusted; default: now");
  resetting->add_option("--operator", reset->who, "Name of the operator (default: your login)");
  resetting->add_option("--config", reset->config, "The daemon's configuration")->default_val(default_config());
  resetting->runs([reset] { return reset_mould(*reset); });
}

}  // namespace slabd::cli
