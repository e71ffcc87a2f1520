// SPDX-License-Identifier: Apache-2.0
#include "cli/replay/replay_report.h"

#include <fmt/core.h>

#include <algorithm>
#include <utility>

#include "cli/exit.h"

namespace slabd::cli {
namespace {

/// Number of differences in the text output; JSON has all.
constexpr std::size_t kDifferencesNamed = 3;

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
                      slab.key, slab.slab_id, slabd::name(slab.verdict), name(slab.outcome), replayed,
                      slab.blocks.size(), slab.figures(), slab.differences());
  text += fmt::format("  {} of {} scans are proven by their checksum to hold the points that were measured{}\n",
                      slab.scans_proven(), slab.blocks.size(), without_checksum(slab));
  if (slab.recipe.starts_with("sha:"))
    text += fmt::format("  recipe {} is no longer in the folder; measured with what the database has kept ({:.16})\n",
                        slab.recorded_recipe, slab.recipe);
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

}  // namespace

std::string_view name(ReplayKind kind) {
  return kind == ReplayKind::verify ? "verify" : "what_if";
}

void write_slab(report::Json& json, const SlabReplay& slab) {
  json.begin_object().field("key", slab.key).field("slab_id", slab.slab_id);
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

void ReplayCount::add(const ReplayRecord& record) {
  if (record.verified) {
    switch (record.verified->outcome) {
      case ReplayOutcome::identical: ++identical; break;
      case ReplayOutcome::differs: ++differs; break;
      case ReplayOutcome::not_verified: ++not_verified; break;
    }
    with_scans += record.verified->scans_left ? 1 : 0;
  }
  if (record.judged) ++(record.judged->left_out.empty() ? judged : left_out);
}

std::string ReplayCount::verified_text() const {
  return fmt::format("identical {}, differ {}, not verified {}", identical, differs, not_verified);
}

int ReplayCount::status(const ReplayHead& head) const {
  if (head.kind == ReplayKind::what_if) return judged > 0 ? kDone : kNotPass;
  // Old scans are deleted regularly: a slab without scans is a finding only if it was named.
  const bool enough = head.named ? not_verified == 0 : identical > 0 && with_scans == 0;
  if (with_scans > 0)
    complain(fmt::format("of the slabs not verified {} could be measured: only the recipe is missing", with_scans));
  return differs == 0 && enough ? kDone : kNotPass;
}

ReplayReport::ReplayReport(ReplayHead head, bool as_json)
    : head_(std::move(head)),
      as_json_(as_json),
      json_(head_.kind == ReplayKind::verify ? "slabd.replay/1" : "slabd.what_if/1") {
  json_.field("software", head_.software);
  if (head_.kind == ReplayKind::verify) {
    json_.field("threads", head_.threads).field("instruction_set", head_.instruction_set);
    json_.key("slabs").begin_array();
  } else {
    json_.field("from", "scans").field("recipe", head_.recipe);
  }
}

void ReplayReport::add(ReplayRecord record) {
  count_.add(record);
  if (record.judged) what_if_.add(std::move(*record.judged));
  if (!record.verified) return;
  if (as_json_) {
    write_slab(json_, *record.verified);
  } else {
    fmt::print("{}", slab_text(*record.verified));
    std::fflush(stdout);
  }
}

int ReplayReport::end() {
  if (head_.kind == ReplayKind::what_if) {
    if (as_json_) {
      what_if_.write(json_);
      fmt::print("{}", json_.text());
    } else {
      fmt::print("what recipe {} ({}) would have decided, measured again from the scans\n", head_.recipe.name,
                 head_.recipe.file);
      fmt::print("{}", what_if_.text(style_for(stdout)));
    }
    return count_.status(head_);
  }
  json_.end_array();
  json_.field("identical", count_.identical).field("differs", count_.differs);
  json_.field("not_verified", count_.not_verified);
  if (as_json_) {
    fmt::print("{}", json_.text());
  } else {
    fmt::print("{}; {} thread{}, {}, {}\n", count_.verified_text(), head_.threads, head_.threads == 1 ? "" : "s",
               head_.instruction_set, head_.software);
  }
  return count_.status(head_);
}

}  // namespace slabd::cli
