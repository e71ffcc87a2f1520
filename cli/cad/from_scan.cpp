// SPDX-License-Identifier: Apache-2.0
//
// slabctl recipe from-scan: the dimensions of a master block from its scan, each with U, as the draft of a recipe. The
// block is measured like every block of the line, with the recipe of a similar slab.
#include <fmt/core.h>

#include <cmath>
#include <filesystem>
#include <memory>
#include <span>

#include "algo/algo.h"
#include "base/durable.h"
#include "base/pages.h"
#include "base/plain_text.h"
#include "cli/cad/cad_commands.h"
#include "cli/cad/draft.h"
#include "cli/command.h"
#include "cli/exit.h"
#include "cli/terminal/arguments.h"
#include "cli/terminal/parse.h"
#include "cli/terminal/render.h"
#include "config/recipe_keys.h"
#include "daemon/measure.h"
#include "report/json.h"
#include "report/table.h"

namespace slabd::cli {
namespace {

struct Options {
  std::string scan;
  std::string like;
  std::string out;
  std::string T_block_scanner;
  ScanFormOptions form;
  int threads = config::default_measure_threads();
  bool json = false;
};

/// A dimension from the scan, in the recipe's unit, with its expanded uncertainty (k = 2).
struct Proposal {
  std::string key;
  double value = kNoValue;
  double U = kNoValue;
  std::string from;
};

struct NotMeasured {
  std::string key;
  std::string why;
};

struct Proposals {
  std::vector<Proposal> list;
  std::vector<NotMeasured> missing;
};

const Item* item_of(const BlockResult& block, ItemId id) {
  for (const Item& item : block.items)
    if (item.id == id && has_value(item.value) && has_value(item.U)) return &item;
  return nullptr;
}

void propose(Proposals& out, const char* key, const BlockResult& block, ItemId id, double factor) {
  if (const Item* const item = item_of(block, id))
    out.list.push_back({key, factor * item->value, factor * item->U, std::string(info(id).name)});
  else
    out.missing.push_back({key, fmt::format("{} was not measured", info(id).name)});
}

/// One number for two features. They must agree within their U, because a recipe has one number for both.
void propose_pair(Proposals& out, const char* key, const BlockResult& block, ItemId inner, ItemId outer) {
  const Item* const a = item_of(block, inner);
  const Item* const b = item_of(block, outer);
  if (a == nullptr || b == nullptr) {
    out.missing.push_back({key, fmt::format("{} was not measured", info(a == nullptr ? inner : outer).name)});
  } else if (std::abs(a->value - b->value) > std::hypot(a->U, b->U)) {
    out.missing.push_back({key, fmt::format("{:.4f} inside and {:.4f} outside differ by more than their U; a recipe "
                                            "has one number",
                                            a->value, b->value)});
  } else {
    // Scanner and reference are common to both, so the mean's U is not smaller.
    out.list.push_back({key, 0.5 * (a->value + b->value), std::max(a->U, b->U),
                        fmt::format("{}, {}", info(inner).name, info(outer).name)});
  }
}

Proposals proposals_of(const BlockResult& block) {
  Proposals out;
  if (const Item* const slope = item_of(block, ItemId::seat_slope)) {
    const double ratio = 1.0 / std::tan(rad_from_deg(slope->value));
    const double U = rad_from_deg(slope->U) * (1.0 + ratio * ratio);  // |d(1/tan a)/da| = 1 + 1/tan^2 a
    out.list.push_back({"block.cant_ratio", ratio, U, "seat_slope, against the local slab top"});
  } else {
    out.missing.push_back({"block.cant_ratio", "seat_slope was not measured"});
  }
  propose(out, "block.jaw_half_distance_mm", block, ItemId::jaw_distance, 0.5);
  propose_pair(out, "block.jaw_angle_deg", block, ItemId::jaw_angle_inner, ItemId::jaw_angle_outer);
  propose(out, "block.casing_half_spacing_mm", block, ItemId::casing_spacing, 0.5);
  propose_pair(out, "block.casing_rim_height_mm", block, ItemId::casing_protrusion_inner,
               ItemId::casing_protrusion_outer);
  return out;
}

BlockResult measured(const Options& options, const Recipe& recipe) {
  Pose T_block_scanner = nominal_T_block_scanner();
  if (!options.T_block_scanner.empty()) {
    const Result<Pose> pose = parse_pose(options.T_block_scanner);
    if (!pose) stop(kUsage, fmt::format("--T-block-scanner: {}", pose.error().text.view()));
    T_block_scanner = pose.value();
  }
  const std::unique_ptr<hal::Clock> clock = hal::make_system_clock();
  Pages memory(limits::kScanSlotBytes);
  const std::span<float> xyz = memory.take<float>(limits::kScanPointsMax * 3);
  Team readers(options.threads);
  const ScanShape shape = need(hal::read_scan(options.scan.c_str(), options.form.form(), xyz, readers), kBadInput);
  if (shape.finite == 0)
    stop(kBadInput, fmt::format("{}: none of its {} points is finite", options.scan, shape.points));
  algo::BlockInspector inspector(options.threads);
  inspector.use(recipe);
  algo::Cloud cloud;
  cloud.xyz = xyz;
  cloud.points = shape.points;
  cloud.width = shape.width;
  cloud.height = shape.height;
  constexpr int kAnyBlock = 1;  // block items do not depend on the station
  const Status status =
      daemon::measure_block(inspector, *clock, kAnyBlock, Pose::identity(), T_block_scanner, cloud, shape, 0.0);
  if (!status) stop(kBadInput, fmt::format("{}: {}", options.scan, status.error().text.view()));
  return inspector.result();
}

std::string as_json(const Options& options, const Recipe& like, const Proposals& proposals) {
  report::Json json("slabd.scan_draft/1");
  json.field("file", options.scan).field("like", like.name).field("like_sha256", like.sha256);
  json.field("draft", options.out);
  json.list("proposed", proposals.list, [&](const Proposal& proposal) {
    json.field("key", proposal.key).field("value", proposal.value).field("U", proposal.U).field("from", proposal.from);
  });
  json.list("not_measured", proposals.missing,
            [&](const NotMeasured& missing) { json.field("key", missing.key).field("why", missing.why); });
  return json.text();
}

std::string as_text(const Recipe& like, const Proposals& proposals) {
  report::Table table{"key", "like", "measured", "U", "from<"};
  for (const Proposal& proposal : proposals.list) {
    double nominal = kNoValue;
    for (const config::NamedNominal& n : config::geometry_of(like))
      if (n.name == proposal.key) nominal = config::shown(n);
    table.add(proposal.key, report::Cell(nominal, 4), report::Cell(proposal.value, 4), report::Cell(proposal.U, 4),
              proposal.from);
  }
  std::string text = report::text_of(table);
  if (!proposals.missing.empty()) text += "\nnot measured:\n";
  for (const NotMeasured& missing : proposals.missing) text += fmt::format("  {}: {}\n", missing.key, missing.why);
  return text;
}

int from_scan(const Options& options) {
  check_draft_path(options.out, {options.scan, options.like});
  const Recipe like = recipe_from(options.like);
  const BlockResult block = measured(options, like);
  const Proposals proposals = proposals_of(block);
  if (proposals.list.empty()) stop(kBadInput, fmt::format("{}: nothing was measured on this block", options.scan));
  const std::string scan = plain(std::filesystem::path(options.scan).filename().string());
  const std::string other = fmt::format("recipe {} sha256 {:.12}, not measured", like.name.view(), like.sha256.view());
  const std::vector<config::NamedNominal> nominals = config::geometry_of(like);
  const auto number = [&](std::string_view key) -> std::optional<DraftNumber> {
    for (const Proposal& proposal : proposals.list)
      if (proposal.key == key)
        return DraftNumber{proposal.value, fmt::format("{}, {}, U {:.4f} (k = 2)", scan, proposal.from, proposal.U)};
    for (const NotMeasured& missing : proposals.missing)
      if (missing.key == key) return std::nullopt;
    if (key == "slab.pairs") return DraftNumber{static_cast<double>(like.slab.pairs), other};
    for (const config::NamedNominal& n : nominals)
      if (n.name == key) return DraftNumber{config::shown(n), other};
    return std::nullopt;
  };
  const auto reason = [&](std::string_view key) -> std::string {
    for (const NotMeasured& missing : proposals.missing)
      if (missing.key == key) return missing.why;
    return "not measured";
  };
  const std::vector<std::string> head = {
      fmt::format("Draft of a recipe from the scan {} of a master block, measured like {}.", scan, like.name.view()),
      "",
      "Every number is unconfirmed. `source` names the item and its U; numbers that a scan of one block cannot give",
      "are those of the other recipe.",
  };
  OutFile out(options.out);
  out.write(draft_text(head, first_bytes(fmt::format("{} draft", like.name.view()), 32), number, reason));
  need(out.close(), kBadInput);
  fmt::print("{}", options.json ? as_json(options, like, proposals) : as_text(like, proposals));
  if (!options.json)
    fmt::print("\n{} is a draft: confirm each number with the drawing, and add what is missing\n", options.out);
  return kDone;
}

}  // namespace

void add_recipe_from_scan(args::Command& recipe) {
  auto options = std::make_shared<Options>();
  args::Command command = recipe.add_subcommand("from-scan", "The draft of a recipe from the scan of a master block");
  command->footer(
      "\nMeasures the block with the recipe of a similar slab, and proposes slope, jaws and casings with their U (k = "
      "2).\n"
      "All other numbers are those of that recipe. See docs/CAD.md.\n"
      "Example: slabctl recipe from-scan master.ply --like p5600.toml --out draft.toml");
  command->add_option("SCAN", options->scan, "Scan file: .ply or .pcd, .xyz .asc .txt .csv")->required();
  command->add_option("--like", options->like, "Recipe of a similar slab")->required();
  command->add_option("--out", options->out, "The draft, .toml")->required();
  command->add_option("--T-block-scanner", options->T_block_scanner,
                      "Pose of the scanner, \"x y z qw qx qy qz\" in mm and a unit quaternion, in the block's frame "
                      "(default 600 mm above, looking down)");
  options->form.add_to(*command);
  command->add_option("--threads", options->threads, "Threads that measure; the results are the same")
      ->check(args::range(1, 2))
      ->capture_default_str();
  command->add_flag("--json", options->json, "Print slabd.scan_draft/1 on stdout");
  command->runs([options] { return from_scan(*options); });
}

}  // namespace slabd::cli
