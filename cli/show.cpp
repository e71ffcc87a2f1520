// SPDX-License-Identifier: Apache-2.0
//
// slabctl show: prints one slab from the database: its verdict, its findings and its map on one screen, with --full the
// scans and the slab's items, and with --block one block's table, its maps, or points of its scan.
#include <fmt/core.h>
#include <algorithm>
#include <array>
#include <cmath>
#include <filesystem>
#include <memory>
#include <optional>
#include <vector>

#include "cli/command.h"
#include "cli/database.h"
#include "cli/exit.h"
#include "cli/export/cloud.h"
#include "cli/recipe/recipe_source.h"
#include "cli/replay/remeasure.h"
#include "cli/slab_choice.h"
#include "cli/terminal/arguments.h"
#include "cli/terminal/render.h"
#include "cli/terminal/say.h"
#include "report/budget_text.h"
#include "report/figures.h"
#include "report/findings.h"
#include "report/json.h"
#include "report/map_json.h"
#include "report/slab_json.h"
#include "report/slab_view.h"

namespace slabd::cli {
namespace {

using storage::SlabBlock;
using storage::SlabRecord;

struct Options {
  DatabaseOptions database;
  std::string slab;
  int block = 0;
  bool full = false;
  bool map = false;
  bool cloud = false;
  bool json = false;
  LanguageOption language;
};

/// Findings on a screen of 24 lines, next to header, map and basis.
constexpr std::size_t kFindingsShown = 6;

/// One line with the sources of the U of the slab's items.
std::string splice_words(const Splice& splice) {
  const double sigma_mm = std::hypot(splice.calibration_mm, splice.robot_mm);
  const std::string worth = has_value(sigma_mm) ? say("sigma {:.3f} mm per axis", sigma_mm)
                                                : say("of unknown accuracy: [robot] absolute_sigma_mm is not stated");
  switch (splice.source) {
    case SpliceSource::none: return say("not recorded");
    case SpliceSource::commissioning: return say("commissioning values, {}", worth);
    case SpliceSource::corrected: return say("hand-eye and station correction of {} visits, {}", splice.visits, worth);
    case SpliceSource::not_mastered: return say("hand-eye alone (station not mastered), {}", worth);
    case SpliceSource::stale:
      return say("hand-eye alone (correction of another hand-eye calibration or tie), {}", worth);
    case SpliceSource::expired: return say("hand-eye alone (correction expired), {}", worth);
    case SpliceSource::outside_gate:
      return say("hand-eye alone (robot {:.3f} mm and {:.4f} deg from its mastered pose), {}", splice.off_mm,
                 deg_from_rad(splice.off_rad), worth);
  }
  return "";
}

/// Number of stations by source of the splice.
std::string splice_summary(const SlabRecord& record) {
  std::array<int, kSpliceSources> count{};
  double worst_mm = 0.0;
  int stations = 0;
  for (int station = 1; station <= record.summary.header.stations; ++station) {
    const SlabBlock* block = report::latest(record, station);
    if (block == nullptr || block->phase != StationPhase::measured) continue;
    const Splice& splice = block->attempt.splice;
    ++count[static_cast<std::size_t>(splice.source)];
    ++stations;
    const double sigma_mm = std::hypot(splice.calibration_mm, splice.robot_mm);
    worst_mm = sigma_mm > worst_mm || !has_value(sigma_mm) ? sigma_mm : worst_mm;
  }
  std::string text;
  for (std::size_t i = 0; i < count.size(); ++i)
    if (count[i] > 0)
      text += (text.empty() ? "" : say(", ")) +
              say("{} of {} stations {}", count[i], stations, translated(name(static_cast<SpliceSource>(i))));
  if (stations > 0 && has_value(worst_mm)) text += say("; sigma of the worst {:.3f} mm per axis", worst_mm);
  return text;
}

std::string header_text(const SlabRecord& record, report::Style style) {
  std::string text;
  const SlabHeader& header = record.summary.header;
  const bool open = report::is_open(record);
  if (header.emulated != 0)
    text +=
        fmt::format("{}\n", report::coloured(report::emulation_notice(header.emulated, language_in_use()), "7", style));
  text += say("slab {} \"{}\"  key {}  type {}{}\n", header.slab_no, header.slab_id.view(), header.key,
              header.slab_type, header.mould == 0 ? "" : say("  mould {}", header.mould));
  if (!open)
    text += say("verdict {}  {}\n", verdict_words(record.summary.verdict, style), reason_text(record.summary.reason));
  for (const storage::DispositionRecord& d : record.dispositions)
    text += say("disposition {}\n", report::disposition_sentence(d, language_in_use()));
  text += say("began {}  ended {}\n", report::local_time(header.began_utime_us),
              open ? say("- (still open)") : report::local_time(record.summary.ended_utime_us));
  return text;
}

/// Objections with value, limits, U and place.
std::string findings_text(const SlabRecord& record, bool full, report::Style style) {
  const std::vector<report::Finding> findings = report::findings_of(record, language_in_use());
  std::string text;
  const std::size_t lines = full ? findings.size() : std::min(findings.size(), kFindingsShown);
  for (std::size_t i = 0; i < lines; ++i)
    text += fmt::format("  {} {}\n",
                        report::coloured(report::symbol(findings[i].verdict, style), findings[i].verdict, style),
                        report::sentence_of(findings[i], language_in_use()));
  if (lines < findings.size()) text += say("  and {} more (--full shows them)\n", findings.size() - lines);
  return text;
}

std::string shown_id(const CalibrationId& id) {
  return id.empty() ? say("none") : std::string(id.view());
}

/// Recipe, calibrations and what limits the verdict.
std::string basis_text(const SlabRecord& record, bool full) {
  const SlabHeader& header = record.summary.header;
  std::string text = say("recipe {} ({:.12})  calibration {}  {}\n", header.recipe.view(), header.recipe_sha256.view(),
                         header.calibration_id.view(), header.software.view());
  if (!header.design_sha256.empty()) text += say("design sheet {:.12}\n", header.design_sha256.view());
  if (const std::string_view datum = report::slope_datum(record); !datum.empty())
    text += say("slopes are judged against: {}\n", translated(datum));
  if (full && !header.stations_id.empty()) text += say("station corrections {}\n", header.stations_id.view());
  if (full && !header.scanner_id.empty()) text += say("scanner acceptance {}\n", header.scanner_id.view());
  for (const SlabArm& arm : header.more_arms)
    text +=
        say("robot {} with scanner {}: calibration {}, station corrections {}, acceptance {}\n", arm.by.robot.view(),
            arm.by.scanner.view(), shown_id(arm.calibration_id), shown_id(arm.stations_id), shown_id(arm.scanner_id));
  if (!header.tie_id.empty()) text += say("tie of the two robots {}\n", header.tie_id.view());
  if (const std::string splices = splice_summary(record); full && !splices.empty())
    text += say("splice: {}\n", splices);
  if (header.unconfirmed > 0)
    text += say("warning: {} nominals and tolerances of the recipe were not confirmed when this slab was judged\n",
                header.unconfirmed);
  if (header.guard == 0.0) text += say("simple acceptance: guard band 0\n");
  const SlabFitReport& fit = record.slab.fit;
  if (fit.ok && !fit.note.empty()) text += say("warning: {}\n", quote(fit.note.view()));
  return text;
}

std::string map_text(const SlabRecord& record, report::Style style) {
  std::string text;
  std::vector<Verdict> verdicts;
  std::vector<std::size_t> damaged;
  for (int station = 1; station <= record.summary.header.stations; ++station) {
    verdicts.push_back(report::shown(record, station).verdict);
    damaged.push_back(report::damage_of(record, station).size());
  }
  text += slab_map(verdicts, style, damaged) + map_legend(style);
  if (std::any_of(damaged.begin(), damaged.end(), [](std::size_t count) { return count > 0; }))
    text += say("  !N  N findings other than small pores (--block shows them)\n");
  text += "\n";
  return text;
}

std::string blocks_text(const SlabRecord& record, report::Style style) {
  report::Table table{say("block"),    say("attempts"), say("acquire s"), say("measure s"),
                      say("verdict<"), say("reason<"),  say("scan<")};
  const bool several = !record.summary.header.more_arms.empty();
  if (several) table.columns.emplace_back(say("scanner<"));
  for (int station = 1; station <= record.summary.header.stations; ++station) {
    const SlabBlock* block = report::latest(record, station);
    const auto [verdict, reason] = report::shown(record, station);
    if (block == nullptr) {
      table.add(station, 0, "-", "-", verdict_cell(verdict), reason_words(reason), "");
      if (several) table.rows.back().emplace_back("");
      continue;
    }
    const bool measured = block->phase == StationPhase::measured;
    table.add(station, block->attempt.number, report::Cell(block->attempt.acquire_ms / 1e3, 2),
              report::Cell(measured ? block->block.times.total_ms / 1e3 : kNoValue, 2), verdict_cell(verdict),
              reason_words(reason), block->attempt.scan_path);
    if (several) table.rows.back().emplace_back(block->attempt.by.scanner.view());
  }
  return report::text_of(table, style) + "\n";
}

std::string never_judged() {
  return say(
      "the slab was aborted: position, height, spacing and slope in the slab's frame were never judged, and a block "
      "that "
      "passed so far has no verdict");
}

/// Dimensions that no scan shows and no gauge has measured.
std::string unseen_text(const SlabRecord& record) {
  const std::string unseen = report::unseen_dimensions(record.slab, language_in_use());
  return unseen.empty() ? ""
                        : fmt::format(fmt::runtime(report::word(report::Word::not_visible, language_in_use())), unseen);
}

std::string slab_items_text(const SlabRecord& record, report::Style style) {
  std::string text;
  if (report::is_aborted(record)) {
    text += say("slab items: none; {}\n", never_judged());
    return text;
  }
  if (record.slab.items.empty()) {
    text += say("slab items: none before SLAB_END\n");
    return text;
  }
  const SlabFitReport& fit = record.slab.fit;
  if (fit.ok) {
    text +=
        say("slab fit over {} seats: rms {:.3f} mm, unweighted {:.3f} mm\n", fit.seats, fit.rms_mm, fit.plain_rms_mm);
  } else {
    text += say("slab fit: not possible ({})\n", quote(fit.note.view()));
  }
  text += item_table(std::span<const Item>(record.slab.items.begin(), record.slab.items.size()), style, true);
  if (record.slab.gauges.empty()) return text;
  report::Table gauges{say("gauge<"), say("source<"), say("unit<"), say("value"), say("age s"), say("state<")};
  for (const GaugeReading& reading : record.slab.gauges)
    gauges.add(reading.gauge.view(), reading.source.view(), name(reading.unit), report::Cell(reading.value, 4),
               report::Cell(reading.age_s, 1), report::gauge_state_sentence(reading.state, language_in_use()));
  text += "\n" + report::text_of(gauges, style);
  return text;
}

/// The items of a block as they are in force: a slab's item that decides replaces the block's own.
std::vector<Item> own_items(const SlabRecord& record, const SlabBlock& block) {
  std::vector<Item> items;
  for (const Item& item : block.block.items) items.push_back(report::final_item(record, block.attempt.station, item));
  return items;
}

/// The slab's items of this block that its own list does not contain.
std::vector<Item> slab_items_of(const SlabRecord& record, int station, std::span<const Item> own) {
  std::vector<Item> items;
  for (const Item& item : record.slab.items) {
    const bool listed = item.station_to == 0 &&
                        std::any_of(own.begin(), own.end(), [&](const Item& other) { return other.id == item.id; });
    if ((item.station == station || item.station_to == station) && !listed) items.push_back(item);
  }
  return items;
}

/// The parts of every item's U, and their sources.
std::string budget_text(const SlabRecord& record, const SlabBlock& block, std::span<const Item> own,
                        std::span<const Item> in_slab, const std::string& scanner) {
  std::string text;
  const std::string of_block = budget_table(own, false);
  const std::string of_slab = budget_table(in_slab, true, !record.summary.header.tie_id.empty());
  if (of_block.empty() && of_slab.empty()) return text;
  text += fmt::format("{}{}{}", of_block, of_slab.empty() ? "" : "\n", of_slab);
  const SlabHeader& header = record.summary.header;
  const SlabArm* arm = block.attempt.arm == 0 ? nullptr : &header.more_arms[block.attempt.arm - 1U];
  const CalibrationId& calibration_id = arm == nullptr ? header.calibration_id : arm->calibration_id;
  const CalibrationId& stations_id = arm == nullptr ? header.stations_id : arm->stations_id;
  text += say(
      "fit, registration: this scan (slab frame: its roll against the slab's top); noise: the larger of this scan's "
      "and the acceptance's\nscanner: {}\n"
      "calibration, robot: {} ({}{}{})\nreference: recipe {}\n\n",
      scanner, splice_words(block.attempt.splice), calibration_id.view(), stations_id.empty() ? "" : ", ",
      stations_id.view(), header.recipe.view());
  if (!header.tie_id.empty()) text += say("tie: base frames of the two robots, {}\n\n", header.tie_id.view());
  return text;
}

std::string block_text(const SlabRecord& record, int station, const std::string& scanner, report::Style style) {
  const SlabBlock* block = report::latest(record, station);
  const auto [verdict, reason] = report::shown(record, station);
  const std::string conclusion =
      say("block {}: {}  {}\n", station, verdict_words(verdict, style),
          report::is_aborted(record) && verdict == Verdict::none ? never_judged() : reason_text(reason));
  if (block == nullptr) {
    return say("block {} was not scanned\n{}", station, report::is_open(record) ? "" : conclusion);
  }
  std::string text =
      say("block {}, attempt {}, scanned {}, session {} command {}\n", station, block->attempt.number,
          report::iso_time(block->attempt.scan_utime_us), block->attempt.session, block->attempt.cmd_seq);
  text += say("scan {}\n", block->attempt.scan_path.view());
  if (!record.summary.header.more_arms.empty())
    text += say("by robot {} with scanner {}\n", block->attempt.by.robot.view(), block->attempt.by.scanner.view());
  text += say("pose: {} samples, spread {:.4f} mm; settled after {:.2f} s, acquired after {:.2f} s\n",
              block->attempt.pose_samples, block->attempt.pose_spread_mm, block->attempt.settle_ms / 1e3,
              block->attempt.acquire_ms / 1e3);
  text += say("splice: {}\n", splice_words(block->attempt.splice));
  if (block->phase != StationPhase::measured) {
    if (block->phase == StationPhase::acquired)
      text += say("attempt {}: {}\n", block->attempt.number,
                  report::is_aborted(record) ? say("scanned, not measured: the slab was aborted")
                                             : say("scanned, not measured yet"));
    else
      text += say("attempt {}: not measured  {}\n", block->attempt.number, reason_text(block->code));
    return text + conclusion;
  }
  const BlockResult& result = block->block;
  text += say("registration {} after {} iterations, deviation {:.3f} +- {:.3f} mm over {} points\n",
              translated(name(result.registration.status)), result.registration.iterations,
              result.registration.deviation.mean_mm, result.registration.deviation.std_mm,
              result.registration.deviation.count);
  const Vec3& normal = result.seat.normal_datum;
  if (normal.isZero())
    text += say("seat normal -\n");
  else
    text += say("seat normal ({:.6f}, {:.6f}, {:.6f})\n", normal.x(), normal.y(), normal.z());
  text += fmt::format("{}{}\n", seat_notes(result.seat, record.summary.header.cell_mm), surface_lines(result));
  if (const auto warning = scan_warning(result.scan); !warning.empty())
    text += say("warning: {}\n", quote(warning.view()));
  const std::vector<Item> own = own_items(record, *block);
  text += fmt::format("{}", item_table(own, style));
  if (const std::string_view datum = report::slope_datum(record); !datum.empty())
    text += say("seat_slope is that against the datum that decides: {}\n", translated(datum));
  text += "\n";
  const std::vector<Item> in_slab = slab_items_of(record, station, own);
  if (!in_slab.empty()) text += say("in the slab's frame\n{}\n", item_table(in_slab, style, true));
  text += budget_text(record, *block, own, in_slab, scanner) + conclusion;
  text += say("{:.0f} ms: read {:.0f}, denoise {:.0f}, register {:.0f}, extract {:.0f}\n", result.times.total_ms,
              result.times.read_ms, result.times.denoise_ms, result.times.register_ms, result.times.extract_ms);
  return text;
}

/// Note that other slabs have the same SLAB_ID; empty if there are none.
std::string others_of_the_id(storage::Reader& reader, const SlabHeader& header) {
  if (header.slab_id.empty()) return "";
  const std::vector<std::int64_t> keys = need(reader.find_id(header.slab_id.view()), kNotReachable);
  std::string others;
  for (const std::int64_t key : keys)
    if (key != header.key) others += fmt::format("{}{}", others.empty() ? "" : ", ", key);
  return others.empty() ? "" : say("this SLAB_ID was given {} times: also key {}", keys.size(), others);
}

/// slabd.slab_map/1, with a block slabd.block_map/1.
std::string map_document(storage::Reader& reader, const SlabRecord& record, const Options& options) {
  const report::Language language = options.language.chosen();
  if (options.block == 0) return report::slab_map_json(record, language);
  const SlabBlock* const block = report::newest_measured(record, options.block);
  std::unique_ptr<BlockMaps> maps = std::make_unique<BlockMaps>();
  if (block != nullptr)
    maps = need(reader.maps(record.summary.header.key, options.block, block->attempt.number), kNotReachable);
  return report::block_map_json(record, options.block, *maps, language);
}

/// slabd.block_cloud/1 of the attempt whose maps are shown. Its texts are English: it is printed only as JSON.
std::string cloud_document(storage::Reader& reader, const SlabRecord& record, const Options& options) {
  const SlabHeader& slab = record.summary.header;
  const auto none = [&](std::string_view why) {
    return fmt::format("no cloud of slab {} block {}: {}", slab.key, options.block, why);
  };
  const SlabBlock* const block = report::newest_measured(record, options.block);
  if (block == nullptr) stop(kBadInput, none("it was not measured"));
  if (block->block.registration.status != RegistrationStatus::converged)
    stop(kBadInput, none("the block was not found in its scan"));

  CloudSettings settings;
  std::vector<config::Problem> problems;  // of a recipe, which only the distances need
  std::vector<Recipe> of_folder;
  if (options.database.db.empty()) {
    const config::Config config = config_from(options.database.config);
    settings.forms = ScanForms(config, ScanFormOptions{.unit = "", .columns = ""});
    settings.scans_dir = config.storage.spool_dir;
    of_folder = recipes_in(config.recipes_dir, problems);
  }
  const std::string path = scan_at(*block, settings.scans_dir);
  std::error_code ignored;
  if (!std::filesystem::is_regular_file(path, ignored))
    stop(kBadInput, none(fmt::format("its scan is gone ({} is not there)", path)));
  RecipeStore recipes(std::move(of_folder));
  const Recipe* const recipe = need(recipes.very(slab, reader), kNotReachable);
  const Result<std::string> document = block_cloud_json(slab, *block, recipe, settings);
  if (!document && document.error().code == Code::config) stop(kBadInput, none(document.error().text.view()));
  return need(document, kBadInput);
}

int show(const Options& options) {
  set_language(options.language, options.json);
  const auto reader =
      open_database(options.database, options.json ? storage::TextFor::programs : storage::TextFor::people);
  const SlabRecord record = named_slab(*reader, options.slab);
  if (options.block < 0 || options.block > record.summary.header.stations)
    stop(kUsage, say("--block {}: this slab has blocks 1..{}", options.block, record.summary.header.stations));
  if (options.json) {
    fmt::print("{}", options.map     ? map_document(*reader, record, options)
                     : options.cloud ? cloud_document(*reader, record, options)
                                     : report::slab_json(record, options.block));
    return kDone;
  }
  const report::Style style = style_for(stdout);
  std::string text = header_text(record, style);
  if (const std::string others = others_of_the_id(*reader, record.summary.header); !others.empty())
    text += fmt::format("! {}\n", others);
  if (options.block == 0) text += findings_text(record, options.full, style);
  text += "\n" + map_text(record, style);
  if (options.block != 0) {
    const SlabBlock* shown_block = report::latest(record, options.block);
    const std::size_t arm = shown_block == nullptr ? 0 : shown_block->attempt.arm;
    const auto verified = need(scanner_of(*reader, record.summary.header, arm), kNotReachable);
    text += basis_text(record, true) + "\n" +
            block_text(record, options.block,
                       report::scanner_source(record.summary.header, arm, verified, language_in_use()), style);
  } else if (options.full) {
    text += fmt::format("{}\n{}{}{}\n", basis_text(record, true), blocks_text(record, style),
                        slab_items_text(record, style), unseen_text(record));
  } else {
    text += basis_text(record, false);
    if (report::is_aborted(record)) text += say("slab items: none; {}\n", never_judged());
    text += say("--block K: one block's table; --full: scans and the slab's items\n");
  }
  fmt::print("{}", text);
  return kDone;
}

}  // namespace

void add_show(args::Command& app) {
  auto options = std::make_shared<Options>();
  args::Command command = app.add_subcommand("show", "One slab: verdict, findings, map; --block one block's table");
  command->footer("\nExamples: slabctl show 12\n          slabctl show SLAB-0042 --block 7 --json");
  command
      ->add_option("SLAB", options->slab,
                   "Key (see history), slab id or SLAB_NO (key:12, id:12, no:12 where a number may be each); of "
                   "several slabs with "
                   "that id the newest")
      ->required();
  args::Option block = command->add_option("--block", options->block, "Show this block's characteristics");
  block->check(args::range(1, static_cast<int>(limits::kStationsMax)));
  command->add_flag("--full", options->full, "Also the scans of all blocks and the slab's items");
  options->database.add_to(*command);
  options->language.add_to(*command, "Language of the text");
  args::Option json = command->add_flag("--json", options->json, "Print slabd.slab/1 on stdout");
  args::Option map = command->add_flag(
      "--map", options->map,
      "With --json: slabd.slab_map/1, the verdicts and findings; with --block slabd.block_map/1, its maps");
  map->needs(json);
  command
      ->add_flag("--cloud", options->cloud,
                 "With --json and --block: slabd.block_cloud/1, up to 200,000 points of the block's scan")
      ->needs(json)
      ->needs(block)
      ->excludes(map);
  command->runs([options] { return show(*options); });
}

}  // namespace slabd::cli
