// SPDX-License-Identifier: Apache-2.0
//
// slabctl recipe diff: differences between two recipes, and verdicts of the second one for the stored slabs.
//
// Measured values, budgets and the seats for the slab's items are in the database. Other limits, another guard band
// and another slab geometry can therefore be tested on years of slabs in seconds, without scans. The measured values
// of a block and their U depend on the block's nominals, on [evaluation] and on [uncertainty]. If those differ, the
// output refers to slabctl replay --recipe, which measures the scans again.
#include "cli/recipe/recipe_diff.h"

#include <fmt/core.h>

#include <algorithm>
#include <memory>

#include "base/fields.h"
#include "cli/command.h"
#include "cli/database.h"
#include "cli/exit.h"
#include "cli/recipe/recipe_source.h"
#include "cli/replay/remeasure.h"
#include "cli/replay/what_if.h"
#include "cli/slab_choice.h"
#include "cli/terminal/arguments.h"
#include "cli/terminal/render.h"
#include "config/recipe_keys.h"
#include "daemon/measure.h"
#include "report/budget_text.h"
#include "report/json.h"

namespace slabd::cli {
namespace {

using config::KeyEffect;
using config::keys_of;
using config::RecipeKey;

struct DiffOptions {
  DatabaseOptions database;
  SlabChoice choice;
  std::string a;
  std::string b;
  bool stored = false;
  bool json = false;
};

struct KeyDifference {
  std::string key;
  std::string a;
  std::string b;
  KeyEffect effect = KeyEffect::none;
};
SLABD_FIELDS(KeyDifference, key, a, b, effect);

std::vector<KeyDifference> differences_of(const Recipe& a, const Recipe& b) {
  std::vector<KeyDifference> list;
  const std::vector<RecipeKey> of_a = keys_of(a);
  const std::vector<RecipeKey> of_b = keys_of(b);
  for (std::size_t i = 0; i < of_a.size(); ++i)
    if (of_a[i].value != of_b[i].value) list.push_back({of_a[i].key, of_a[i].value, of_b[i].value, of_a[i].effect});
  return list;
}

/// True for items whose U without a budget is the larger one of the recipe's U and that from the scan
/// (algo/items/uncertainty.h).
bool widens_by_scan(ItemId id) {
  return info(id).scope == ItemScope::block && !info(id).U_from_recipe;
}

/// Sets U and verdict of `judged`, which contains the recipe's U. A stored U above that of the original recipe is the
/// U from the scan. Otherwise the U from the scan is unknown and at most the stored U, which is then used. False: the
/// verdict depends on the unknown U.
bool judge_without_budget(const Item& stored, double U_measured_with, double guard, Item& judged) {
  judged.verdict = judge(judged, guard);
  if (!has_value(judged.value) || !has_value(judged.U) || !widens_by_scan(judged.id)) return true;
  if (!has_value(stored.U)) return guard == 0.0 || judged.verdict == Verdict::indeterminate;
  if (stored.U <= judged.U) return true;
  const Verdict by_recipe = judged.verdict;
  judged.U = stored.U;
  judged.verdict = judge(judged, guard);
  return stored.U > U_measured_with || judged.verdict == by_recipe;
}

int rejudge(const Recipe& recipe, const SlabDesign& design, const Recipe* measured_with, BlockResult& block) {
  int unknown = 0;
  for (Item& item : block.items) {
    Item judged = designed_item(recipe, design, item.id, item.station, item.station_to);
    judged.value = item.value;
    judged.companion = item.companion;
    judged.measured = item.measured;
    judged.budget = item.budget;
    if (report::has_budget(item)) {
      judged.U = item.U;
      judged.verdict = judge(judged, recipe.guard);
    } else {
      const double U_measured_with = measured_with == nullptr ? kNoValue : measured_with->tolerance(item.id).U;
      if (!judge_without_budget(item, U_measured_with, recipe.guard, judged)) ++unknown;
    }
    if (item.id == ItemId::surface_pores) {
      block.pores.limits = recipe.pores;
      judged.verdict = with_pore_limits(judged.verdict, block.pores);
    }
    item = judged;
  }
  // A block without a result keeps its reason.
  const Code code = block.reason != 0 && block.reason < kReasonItemBase ? static_cast<Code>(block.reason) : Code::ok;
  if (code != Code::ok) return unknown;
  block.verdict = with_findings(combine(block.items.begin(), block.items.end()), block);
  block.reason = reason_with_findings(block.verdict, block.items.begin(), block.items.end(), code, block);
  return unknown;
}

struct StoredSlabs {
  WhatIf what_if;
  int of_a = 0;       ///< slabs judged with the first recipe
  int unknown_U = 0;  ///< block items whose verdict depends on a U that only the scan contains
};

StoredSlabs judge_stored(storage::Reader& reader, const std::vector<std::int64_t>& keys, const Recipe& a,
                         const Recipe& b) {
  StoredSlabs out;
  std::vector<BlockResult> room(limits::kStationsMax);
  auto judged = std::make_unique<SlabResult>();
  for (const std::int64_t key : keys) {
    const auto found = need(reader.slab(key), kNotReachable);
    if (!found) continue;
    const storage::SlabRecord& record = *found;
    const SlabHeader& slab = record.summary.header;
    if (record.summary.verdict == Verdict::aborted) {
      out.what_if.add(left_out_slab(slab, "it was aborted"));
      continue;
    }
    if (slab.stations != b.stations()) {
      out.what_if.add(left_out_slab(slab, fmt::format("it has {} blocks, the recipe {}", slab.stations, b.stations())));
      continue;
    }
    const bool of_a = slab.recipe_sha256 == a.sha256;
    if (of_a) ++out.of_a;
    const StoredBasis stored = need(basis_of(reader, record, &b), kNotReachable);
    if (!stored.missing.empty()) {
      out.what_if.add(left_out_slab(slab, stored.missing_text()));
      continue;
    }
    const std::vector<StationRecord> stations = rejudged(record, b, of_a ? &a : nullptr, out.unknown_U);
    daemon::judge_slab(stored.basis, stations, room, *judged);
    out.what_if.add(judged_slab(record, stations, *judged));
  }
  return out;
}

void write_recipe(report::Json& json, std::string_view key, const Recipe& recipe) {
  json.key(key).begin_object().field("name", recipe.name).field("slab_type", recipe.slab_type);
  json.field("sha256", recipe.sha256).field("file", recipe.path).end_object();
}

std::string as_json(const Recipe& a, const Recipe& b, const std::vector<KeyDifference>& differences,
                    const StoredSlabs* stored) {
  report::Json json("slabd.recipe_diff/1");
  write_recipe(json, "a", a);
  write_recipe(json, "b", b);
  json.field("differences", differences);
  json.key("stored");
  if (stored == nullptr) {
    json.null();
  } else {
    json.begin_object().field("judged_with_a", stored->of_a).field("unknown_U", stored->unknown_U);
    stored->what_if.write(json);
    json.end_object();
  }
  return json.text();
}

std::string differences_text(const Recipe& a, const Recipe& b, const std::vector<KeyDifference>& differences) {
  std::string text = fmt::format("a: {} ({:.12})  {}\nb: {} ({:.12})  {}\n\n", a.name.view(), a.sha256.view(),
                                 a.path.view(), b.name.view(), b.sha256.view(), b.path.view());
  if (differences.empty()) {
    text += "no key differs\n";
    return text;
  }
  report::Table table{"key", "a", "b", "changes<"};
  for (const KeyDifference& difference : differences)
    table.add(difference.key, difference.a, difference.b, name(difference.effect));
  text += report::text_of(table);
  return text;
}

int diff(const DiffOptions& options) {
  if (!options.stored && options.choice.has_filter())
    stop(kUsage, "--since, --until, --slab-type and --verdict choose stored slabs: say --db or --config too");
  // A recipe from the database requires one: the configuration's, unless another is named.
  std::unique_ptr<storage::Reader> reader;
  if (options.stored || names_stored_recipe(options.a) || names_stored_recipe(options.b)) {
    reader = open_database(options.database);
  }
  const Recipe a = recipe_named(reader.get(), options.a);
  const Recipe b = recipe_named(reader.get(), options.b);
  const std::vector<KeyDifference> differences = differences_of(a, b);
  StoredSlabs stored;
  if (options.stored) {
    SlabChoice choice = options.choice;
    if (choice.slab_type == 0) choice.slab_type = b.slab_type;
    const std::vector<std::int64_t> keys = chosen_slabs(*reader, choice);
    stored = judge_stored(*reader, keys, a, b);
  }
  if (options.json) {
    fmt::print("{}", as_json(a, b, differences, options.stored ? &stored : nullptr));
  } else {
    fmt::print("{}", differences_text(a, b, differences));
    if (options.stored) {
      fmt::print("\nwhat b would have made of the stored values; {} of the slabs were judged with a\n", stored.of_a);
      fmt::print("{}", stored.what_if.text(style_for(stdout)));
    }
  }
  const auto measured = std::count_if(differences.begin(), differences.end(), [](const KeyDifference& difference) {
    return difference.effect == KeyEffect::measured;
  });
  if (options.stored && measured > 0)
    complain(
        fmt::format("warning: {} differences change what is measured; stored values do not show that, `slabctl replay "
                    "--recipe {}` does, from the scans",
                    measured, options.b));
  if (stored.unknown_U > 0)
    complain(
        fmt::format("warning: {} verdicts of block items rest on what a scan adds to b's smaller U, which is not "
                    "stored; they are shown with the stored U where there is one, `slabctl replay --recipe {}` "
                    "tells, from the scans",
                    stored.unknown_U, options.b));
  return kDone;
}

}  // namespace

std::vector<StationRecord> rejudged(const storage::SlabRecord& record, const Recipe& recipe,
                                    const Recipe* measured_with, int& unknown_U) {
  const std::vector<const BlockResult*> as_stored(record.blocks.size(), nullptr);
  std::vector<StationRecord> stations = stations_of(record, as_stored);
  const SlabDesign design = facts_of(record.summary.header).design;
  for (StationRecord& station : stations)
    if (station.phase == StationPhase::measured) unknown_U += rejudge(recipe, design, measured_with, station.block);
  return stations;
}

void add_recipe_diff(args::Command& recipe) {
  auto options = std::make_shared<DiffOptions>();
  args::Command command = recipe.add_subcommand("diff", "Differences of two recipes, and their effect on slabs");
  command->footer(
      "\nThe last column shows what a key changes: verdict and slab follow from stored values, measured only from "
      "scans\n"
      "(slabctl replay --recipe B). With --db or --config also the share of stored slabs of B's slab type whose "
      "verdict\n"
      "would change, item by item.\n"
      "Examples: slabctl recipe diff p5600.toml p5600-new.toml\n"
      "          slabctl recipe diff p5600.toml p5600-new.toml --db /var/lib/slabd/slabd.db --since 30d\n"
      "          slabctl recipe diff slab:SLAB-0042 p5600.toml");
  command->add_option("A", options->a, "Recipe file, or out of the database: slab:SLAB, sha:PREFIX")->required();
  command->add_option("B", options->b, "The same")->required();
  options->choice.add_filters_to(*command);
  options->database.add_to(*command);
  command->add_flag("--json", options->json, "Print slabd.recipe_diff/1 on stdout");
  command->runs([options, command] {
    options->stored = command->count("--db") > 0 || command->count("--config") > 0;
    return diff(*options);
  });
}

}  // namespace slabd::cli
