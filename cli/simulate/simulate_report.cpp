// SPDX-License-Identifier: Apache-2.0
#include "cli/simulate/simulate_report.h"

#include <fmt/core.h>

#include <algorithm>

#include "cli/terminal/render.h"
#include "report/json.h"

namespace slabd::cli::simulate {
namespace {

using report::Json;

/// Block items with a known truth, and their index among a station record's deviations (IR 42..50); flatness has a
/// separate register.
struct Compared {
  ItemId id;
  int deviation_index;
  const char* heading;
};
constexpr std::array kCompared = {
    Compared{ItemId::seat_slope, 0, "slope"},
    Compared{ItemId::seat_flatness, -1, "flatness"},
    Compared{ItemId::jaw_angle_inner, 1, "jaw in"},
    Compared{ItemId::jaw_angle_outer, 2, "jaw out"},
    Compared{ItemId::jaw_distance, 3, "jaw dist"},
    Compared{ItemId::casing_spacing, 4, "spacing"},
    Compared{ItemId::casing_protrusion_inner, 5, "protr in"},
    Compared{ItemId::casing_protrusion_outer, 6, "protr out"},
};

const storage::SlabBlock* stored_block(const SlabOutcome& outcome, int station) {
  const storage::SlabBlock* found = nullptr;
  if (!outcome.stored) return found;
  for (const storage::SlabBlock& block : outcome.stored->blocks)
    if (block.attempt.station == station && block.phase == StationPhase::measured) found = &block;
  return found;
}

const emulator::StationRun& run_of(const SlabOutcome& outcome, int station) {
  return outcome.run.station[static_cast<std::size_t>(station - 1)];
}

std::vector<Verdict> table_verdicts(const SlabOutcome& outcome) {
  std::vector<Verdict> verdicts;
  for (int k = 0; k < outcome.truth.stations; ++k)
    verdicts.push_back(outcome.run.table[static_cast<std::size_t>(k)].verdict);
  return verdicts;
}

/// Median of slabd's computing time for a block without reading, ms; NaN if the database cannot be read.
double block_compute_ms(const SlabOutcome& outcome) {
  std::vector<double> times_ms;
  if (outcome.stored)
    for (const storage::SlabBlock& block : outcome.stored->blocks)
      if (block.phase == StationPhase::measured)
        times_ms.push_back(block.block.times.total_ms - block.block.times.read_ms);
  if (times_ms.empty()) return kNoValue;
  const auto middle = times_ms.begin() + static_cast<std::ptrdiff_t>(times_ms.size() / 2);
  std::nth_element(times_ms.begin(), middle, times_ms.end());
  return *middle;
}

std::string seconds(double s) {
  return s < 0.0 ? "-" : fmt::format("{:.2f}", s);
}

/// Error of the measurement: measured minus planted, in um or millidegrees.
std::string error_text(double measured, double planted) {
  if (!has_value(measured) || !has_value(planted)) return "-";
  return fmt::format("{:+.0f}", 1e3 * (measured - planted));
}

/// Planted difference between the real and the reported position of the flange, in the base of the robot that went
/// there.
Vec3 robot_off_mm(const SlabOutcome& outcome, int station) {
  const emulator::Stop stop = outcome.truth.at(station).stop(run_of(outcome, station).arm);
  return stop.T_base_flange_real.translation_mm - stop.T_base_flange_reported.translation_mm;
}

/// Planted items between seats or of the whole slab: the truth with the record's items.
struct SlabItem {
  Item measured;
  double planted = kNoValue;
};

std::vector<SlabItem> slab_items(const Recipe& recipe, const SlabOutcome& outcome) {
  std::vector<SlabItem> items;
  if (!outcome.stored) return items;
  for (const Item& item : outcome.stored->slab.items) {
    const double planted = emulator::true_slab_value(recipe, outcome.truth, item.id, item.station);
    if (has_value(planted)) items.push_back({item, planted});
  }
  return items;
}

/// Table of the item with the largest error of each kind.
std::string slab_items_text(const std::vector<SlabItem>& items, report::Style style) {
  if (items.empty()) return "";
  report::Table table{"slab item<", "blocks", "true", "measured", "error um", "U um", "verdict<"};
  const auto error = [](const SlabItem& i) { return std::abs(i.measured.value - i.planted); };
  for (const ItemId id : {ItemId::seat_spacing, ItemId::large_jaw_distance, ItemId::corner_level, ItemId::warp_left,
                          ItemId::warp_right}) {
    const SlabItem* worst = nullptr;
    for (const SlabItem& item : items)
      if (item.measured.id == id && has_value(item.measured.value) && (worst == nullptr || error(item) > error(*worst)))
        worst = &item;
    if (worst == nullptr) continue;
    const Item& m = worst->measured;
    table.add(info(id).name, m.station == 0 ? "-" : fmt::format("{}-{}", m.station, m.station_to),
              report::Cell(worst->planted, 3), report::Cell(m.value, 3), error_text(m.value, worst->planted),
              report::Cell(1e3 * m.U, 0), m.verdict);
  }
  return text_of(table, style) +
         "  (of spacings and large jaws the most wrong one; the robot's planted error is part of the error)\n\n";
}

std::string stations_text(const Recipe& recipe, const RunFacts& facts, const SlabOutcome& outcome,
                          report::Style style) {
  report::Table table{"block", "scans", "acquire s", "result s"};
  if (facts.arms.several()) table.columns.emplace_back("by<");
  for (const Compared& item : kCompared) table.columns.emplace_back(item.heading);
  for (const char* heading : {"robot", "verdict<", "reason<"}) table.columns.emplace_back(heading);
  for (int k = 1; k <= outcome.truth.stations; ++k) {
    const emulator::StationRun& run = run_of(outcome, k);
    table.add(k, run.scans, seconds(run.trigger_to_acquired_s), seconds(run.acquired_to_result_s));
    report::Table::Row& row = table.rows.back();
    if (facts.arms.several()) row.emplace_back(std::string(facts.arms.list[run.arm].robot.view()));
    for (const Compared& item : kCompared)
      row.emplace_back(error_text(measured_value(recipe, outcome, k, item.id),
                                  emulator::true_value(recipe, outcome.truth.at(k), item.id)));
    const PlcStationRow& shown = outcome.run.table[static_cast<std::size_t>(k - 1)];
    row.emplace_back(1e3 * robot_off_mm(outcome, k).norm(), 0);
    row.emplace_back(shown.verdict);
    row.emplace_back(run.trouble.empty() ? cli::reason_words(shown.reason) : run.trouble);
  }
  return text_of(table, style) +
         "  (items: measured minus planted, um and millidegrees; robot: real minus reported flange, um)\n\n";
}

/// The item that a defect changes; nullopt for a missing block and for defects of the scan only.
std::optional<ItemId> item_of(emulator::DefectKind kind) {
  switch (kind) {
    case emulator::DefectKind::slope: return ItemId::seat_slope;
    case emulator::DefectKind::jaw_angle_inner: return ItemId::jaw_angle_inner;
    case emulator::DefectKind::jaw_angle_outer: return ItemId::jaw_angle_outer;
    case emulator::DefectKind::jaw_distance: return ItemId::jaw_distance;
    case emulator::DefectKind::protrusion_inner: return ItemId::casing_protrusion_inner;
    case emulator::DefectKind::protrusion_outer: return ItemId::casing_protrusion_outer;
    case emulator::DefectKind::casing_spacing: return ItemId::casing_spacing;
    case emulator::DefectKind::bump:
    case emulator::DefectKind::chip:
    case emulator::DefectKind::burr: return ItemId::seat_flatness;
    case emulator::DefectKind::lateral: return ItemId::seat_lateral;
    case emulator::DefectKind::vertical:
    case emulator::DefectKind::robot: return ItemId::seat_vertical;
    case emulator::DefectKind::along: return ItemId::seat_spacing;
    case emulator::DefectKind::large_jaw: return ItemId::large_jaw_distance;
    case emulator::DefectKind::corner_level: return ItemId::corner_level;
    case emulator::DefectKind::warp_left: return ItemId::warp_left;
    case emulator::DefectKind::warp_right: return ItemId::warp_right;
    case emulator::DefectKind::sunk_seat:
    case emulator::DefectKind::broken_corner:
    case emulator::DefectKind::missing:
    case emulator::DefectKind::outliers:
    case emulator::DefectKind::noise:
    case emulator::DefectKind::glove:
    case emulator::DefectKind::cable: return std::nullopt;
  }
  return std::nullopt;
}

std::string planted_text(const Recipe& recipe, const RunFacts& facts, const SlabOutcome& outcome,
                         const std::vector<SlabItem>& slab) {
  if (facts.defects.empty()) return "";
  report::Table table{"defect", "block", "item<", "true", "measured", "verdict<"};
  for (std::size_t i = 0; i < facts.defects.size(); ++i) {
    const int k = facts.defects[i].station;
    const std::optional<ItemId> id = item_of(facts.defects[i].kind);
    double truth = kNoValue;
    double measured = kNoValue;
    const Item* of_slab = nullptr;
    if (id) {
      for (const SlabItem& item : slab) {
        if (item.measured.id != *id || (k != 0 && item.measured.station != k && item.measured.station_to != k))
          continue;
        of_slab = &item.measured;
        truth = item.planted;
        measured = item.measured.value;
        break;
      }
      if (of_slab == nullptr && k != 0) {
        truth = emulator::true_value(recipe, outcome.truth.at(k), *id);
        measured = measured_value(recipe, outcome, k, *id);
      }
    }
    std::string verdict = of_slab != nullptr ? std::string(name(of_slab->verdict)) : "-";
    if (k != 0) {
      const PlcStationRow& shown = outcome.run.table[static_cast<std::size_t>(k - 1)];
      verdict = fmt::format("{} {}", name(shown.verdict), cli::reason_words(shown.reason));
    }
    table.add(facts.defect_texts[i], k != 0 ? std::to_string(k) : "-", id ? info(*id).name : "-",
              report::Cell(truth, 4), report::Cell(measured, 4), verdict);
  }
  return text_of(table) + "\n";
}

void write_station(report::Json& json, const Recipe& recipe, const RunFacts& facts, const SlabOutcome& outcome, int k) {
  const emulator::StationRun& run = run_of(outcome, k);
  const emulator::StationTruth& truth = outcome.truth.at(k);
  const PlcStationRow& row = outcome.run.table[static_cast<std::size_t>(k - 1)];
  const auto time = [&](const char* key, double s) { json.field(key, s < 0.0 ? kNoValue : s); };
  json.begin_object().field("station", k).field("verdict", row.verdict).field("reason", row.reason);
  json.field("attempts", row.attempts).field("scans", run.scans).field("trouble", run.trouble);
  const Arm& by = facts.arms.list[run.arm];
  json.field("robot", by.robot.view()).field("scanner", by.scanner.view());
  time("trigger_to_acquired_s", run.trigger_to_acquired_s);
  time("acquired_to_result_s", run.acquired_to_result_s);
  json.key("record").begin_object().field("stored", run.has_record).field("verdict", run.record.verdict);
  json.field("reason", run.record.reason).field("fail_mask", run.record.fail_mask);
  json.field("open_mask", run.record.open_mask).field("flatness_mm", run.record.flatness_mm);
  json.field("std_mm", run.record.std_mm).field("points", run.record.points).end_object();
  json.field("T_slab_block", truth.T_slab_block.matrix()).field("robot_off_mm", robot_off_mm(outcome, k));
  json.list("items", kCompared, [&](const Compared& item) {
    json.field("id", info(item.id).name).field("unit", info(item.id).unit);
    json.field("planted", emulator::true_value(recipe, truth, item.id));
    json.field("measured", measured_value(recipe, outcome, k, item.id));
  });
  json.end_object();
}

void write_outcome(report::Json& json, const Recipe& recipe, const RunFacts& facts, const SlabOutcome& outcome) {
  const emulator::SlabRun& run = outcome.run;
  json.begin_object().field("slab_no", run.order.slab_no).field("slab_id", run.order.slab_id);
  json.field("slab_type", run.order.slab_type).field("finished", run.finished).field("continued", run.continued);
  json.field("verdict", run.finished ? run.verdict : Verdict::none).field("reason", run.reason);
  json.field("trouble", run.trouble.text);
  json.field("last_acquired_to_verdict_s",
             run.last_acquired_to_verdict_s < 0.0 ? kNoValue : run.last_acquired_to_verdict_s);
  json.field("block_compute_ms", block_compute_ms(outcome)).field("total_s", run.total_s);
  json.field("T_base_slab", outcome.truth.T_base_slab).field("from_database", outcome.stored.has_value());
  if (outcome.stored) json.field("key", outcome.stored->summary.header.key);
  json.key("stations").begin_array();
  for (int k = 1; k <= outcome.truth.stations; ++k) write_station(json, recipe, facts, outcome, k);
  json.end_array();
  if (outcome.stored) {
    json.key("slab_items").begin_array();
    for (const Item& item : outcome.stored->slab.items) report::write_item(json, item, true);
    json.end_array();
    json.list("slab_items_planted", slab_items(recipe, outcome), [&](const SlabItem& item) {
      json.field("id", info(item.measured.id).name).key("stations").begin_array();
      if (item.measured.station != 0) json.value(item.measured.station);
      if (item.measured.station_to != 0) json.value(item.measured.station_to);
      json.end_array();
      json.field("planted", item.planted).field("measured", item.measured.value);
    });
  }
  json.end_object();
}

}  // namespace

double measured_value(const Recipe& recipe, const SlabOutcome& outcome, int station, ItemId id) {
  if (id == ItemId::seat_lateral || id == ItemId::seat_vertical) {
    if (!outcome.stored) return kNoValue;
    const auto& items = outcome.stored->slab.items;
    const Item* item = find_item(items.begin(), items.end(), id, station);
    return item == nullptr ? kNoValue : item->value;
  }
  if (const storage::SlabBlock* block = stored_block(outcome, station)) {
    const Item* item = find_item(block->block.items.begin(), block->block.items.end(), id);
    return item == nullptr ? kNoValue : item->value;
  }
  const emulator::StationRun& run = run_of(outcome, station);
  if (!run.has_record) return kNoValue;
  if (id == ItemId::seat_flatness) return run.record.flatness_mm;
  for (const Compared& item : kCompared)
    if (item.id == id)
      return recipe.tolerance(id).nominal.value + run.record.deviation[static_cast<std::size_t>(item.deviation_index)];
  return kNoValue;
}

std::string outcome_text(const Recipe& recipe, const RunFacts& facts, const SlabOutcome& outcome) {
  std::string text;
  const report::Style style = cli::style_for(stdout);
  const emulator::SlabRun& run = outcome.run;
  text += fmt::format("slab {} \"{}\"  {}\n\n", run.order.slab_no, run.order.slab_id,
                      run.continued ? "(was already open: continued)" : "");
  text += fmt::format("{}{}\n", cli::slab_map(table_verdicts(outcome), style), cli::map_legend(style));
  const std::vector<SlabItem> slab = slab_items(recipe, outcome);
  text += stations_text(recipe, facts, outcome, style) + slab_items_text(slab, style) +
          planted_text(recipe, facts, outcome, slab);
  if (run.finished) {
    text +=
        fmt::format("slab verdict {}  {}\n", report::verdict_text(run.verdict, style), cli::reason_text(run.reason));
    const double compute_ms = block_compute_ms(outcome);
    text += fmt::format(
        "{} s from the last ACQUIRED to the verdict{}, {:.1f} s in all\n",
        run.last_acquired_to_verdict_s < 0.0 ? "-" : fmt::format("{:.3f}", run.last_acquired_to_verdict_s),
        has_value(compute_ms) ? fmt::format(" (computing on one block: {:.0f} ms)", compute_ms) : std::string(),
        run.total_s);
  } else {
    text += fmt::format("no slab verdict: {}\n", run.trouble.text);
  }
  return text;
}

std::string simulation_json(const Recipe& recipe, const RunFacts& facts, const std::vector<SlabOutcome>& outcomes) {
  report::Json json("slabd.simulation/1");
  json.field("config", facts.config).field("plc", facts.peer).field("recipe", recipe.name);
  json.field("recipe_sha256", recipe.sha256).field("seed", facts.seed).field("defects", facts.defect_texts);
  json.key("arms").begin_array();
  for (std::size_t arm = 0; arm < facts.arms.list.size(); ++arm) {
    json.begin_object().field("robot", facts.arms.list[arm].robot.view());
    json.field("scanner", facts.arms.list[arm].scanner.view());
    if (arm != 0)
      json.field("T_base_robot", facts.further[arm - 1].T_base_robot)
          .field("T_base_robot_real", facts.further[arm - 1].T_base_robot_real);
    json.end_object();
  }
  json.end_array().key("slabs").begin_array();
  for (const SlabOutcome& outcome : outcomes) write_outcome(json, recipe, facts, outcome);
  return json.text();
}

}  // namespace slabd::cli::simulate
