// SPDX-License-Identifier: Apache-2.0
//
// Problem: a verdict must be verifiable years later. Idea: measure the stored scans again with the same code and
// compare every stored figure. The same input gives the same bits: on one thread or two, on any instruction set, in
// any build. If a bit differs, an input differs from its record, and the program searches for it: software, recipe,
// calibration, scan file.
//
// Invariant: data that could not be compared is never reported as identical.
#include "cli/replay/verify.h"

#include <fmt/core.h>

#include <algorithm>
#include <array>

#include "daemon/measure.h"
#include "report/slab_view.h"

namespace slabd::cli {
namespace {

bool same(const Pose& a, const Pose& b) {
  return a.to_array() == b.to_array();
}

std::string recipe_words(std::string_view recipe, std::string_view sha256) {
  return fmt::format("{} (sha256 {})", recipe, sha256);
}

Result<const Recipe*> recipe_of(const SlabHeader& slab, storage::Reader& reader, RecipeStore& recipe_store,
                                std::vector<ChangedInput>& changed) {
  const Result<const Recipe*> very = recipe_store.very(slab, reader);
  if (!very || very.value() != nullptr) return very;
  const Recipe* of_type = recipe_store.of_type(slab);
  changed.push_back(
      {"recipe", recipe_words(slab.recipe.view(), slab.recipe_sha256.view()),
       of_type == nullptr
           ? fmt::format("none of slab type {} with {} blocks is there", slab.slab_type, slab.stations)
           : recipe_words(of_type->name.view(), of_type->sha256.view()) + ", " + std::string(of_type->path.view())});
  return of_type;
}

/// Numbers of a kept record with exactly this id, in `found`; nullptr if there is none.
template <typename Numbers>
const Numbers* numbers_in(const std::optional<storage::CalibrationRecord>& found, std::string_view id) {
  return !found || found->id != id ? nullptr : std::get_if<Numbers>(&found->numbers);
}

/// The calibrations of one arm of a slab.
struct ArmRecords {
  std::size_t arm;
  std::string_view hand_eye_id;
  std::string_view stations_id;
  const Pose& T_flange_scanner;
};

/// The effective poses are stored with the slab and its attempts; this compares those of one arm with their source
/// records.
Status check_arm(storage::Reader& reader, const storage::SlabRecord& record, const ArmRecords& of,
                 std::vector<ChangedInput>& changed) {
  if (!of.hand_eye_id.empty() && !of.hand_eye_id.starts_with("commissioning-")) {
    const auto found = reader.calibration(of.hand_eye_id);
    if (!found) return found.error();
    const auto* numbers = numbers_in<HandEyeNumbers>(found.value(), of.hand_eye_id);
    if (numbers == nullptr)
      changed.push_back({"calibration", std::string(of.hand_eye_id), "the database holds no such record"});
    else if (!same(numbers->T_flange_scanner, of.T_flange_scanner))
      changed.push_back({"calibration", std::string(of.hand_eye_id), "its record holds another T_flange_scanner"});
  }
  if (of.stations_id.empty()) return success();
  const auto found = reader.calibration(of.stations_id);
  if (!found) return found.error();
  const auto* table = numbers_in<StationTable>(found.value(), of.stations_id);
  if (table == nullptr) {
    changed.push_back({"stations", std::string(of.stations_id), "the database holds no such record"});
    return success();
  }
  for (const storage::SlabBlock& block : record.blocks) {
    if (block.attempt.arm != of.arm || block.attempt.splice.source != SpliceSource::corrected) continue;
    if (same(table->station[block.attempt.station - 1U].T_base_reported, block.attempt.splice.T_base_reported))
      continue;
    changed.push_back({"stations", std::string(of.stations_id),
                       fmt::format("its record corrects station {} otherwise", block.attempt.station)});
  }
  return success();
}

/// The same for the base of the second robot.
Status check_tie(storage::Reader& reader, const storage::SlabRecord& record, std::vector<ChangedInput>& changed) {
  const std::string_view id = record.summary.header.tie_id.view();
  if (id.empty()) return success();
  const auto found = reader.calibration(id);
  if (!found) return found.error();
  const auto* tie = numbers_in<TieNumbers>(found.value(), id);
  if (tie == nullptr) return success();  // StoredBasis::missing names it
  for (const storage::SlabBlock& block : record.blocks) {
    if (!block.attempt.splice.tied || same(tie->T_base_robot, block.attempt.splice.T_base_robot)) continue;
    changed.push_back({"tie", std::string(id),
                       fmt::format("its record places the robot of station {} otherwise", block.attempt.station)});
  }
  return success();
}

Status check_calibration(storage::Reader& reader, const storage::SlabRecord& record,
                         std::vector<ChangedInput>& changed) {
  const SlabHeader& slab = record.summary.header;
  Status status = check_arm(reader, record,
                            {0, slab.calibration_id.view(), slab.stations_id.view(), slab.T_flange_scanner}, changed);
  for (std::size_t i = 0; status && i < slab.more_arms.size(); ++i) {
    const SlabArm& arm = slab.more_arms[i];
    status = check_arm(reader, record, {i + 1, arm.calibration_id.view(), arm.stations_id.view(), arm.T_flange_scanner},
                       changed);
  }
  return status ? check_tie(reader, record, changed) : status;
}

std::string names_of(const std::vector<ChangedInput>& changed) {
  std::string names;
  for (const ChangedInput& input : changed) names += (names.empty() ? "" : ", ") + input.what;
  return names;
}

/// A version without an exact commit is that of many builds.
std::string this_build(const SlabHeader& slab) {
  const std::string_view version = slab.software.view();
  if (version.ends_with(".dirty") || version.ends_with("unknown"))
    return fmt::format("this may be another build: {} was made of sources that no commit names", version);
  return "this build measures otherwise under the same version";
}

/// Reason for the difference, as far as the records show it.
std::string reason_for_difference(const SlabHeader& slab, const std::vector<ChangedInput>& changed,
                                  const Remeasured& again) {
  std::string why;
  if (!changed.empty()) why = "measured with another " + names_of(changed);
  if (!again.note.empty())
    why += (why.empty() ? "the scan was changed: " : "; and the scan was changed: ") + again.note;
  if (!why.empty()) return why;
  if (again.proven)
    return "no recorded input differs, and the scan's points are those that were measured: " + this_build(slab);
  return "no recorded input differs: the scan's content was changed after it was acquired (no checksum was kept of "
         "it), or " +
         this_build(slab);
}

BlockReplay replay_block(const SlabHeader& slab, const SlabBasis& basis, const storage::SlabBlock& stored,
                         const BlockMaps& maps, const std::vector<ChangedInput>& changed, Remeasurer& remeasurer,
                         Remeasured& again) {
  BlockReplay replay;
  replay.station = stored.attempt.station;
  replay.attempt = stored.attempt.number;
  remeasurer.measure(slab, basis, stored, again);
  replay.scan = again.path;
  replay.why = again.note;
  replay.crc32c_stored = stored.attempt.points_crc32c;
  replay.crc32c_now = again.points_crc32c;
  if (again.scan != Remeasured::Scan::measured) {
    replay.outcome = again.scan == Remeasured::Scan::pruned ? ReplayOutcome::not_verified : ReplayOutcome::differs;
    return replay;
  }
  if (!again.altered && was_refused(stored.block, again.block)) {
    replay.outcome = ReplayOutcome::not_verified;
    replay.why = fmt::format(
        "slabd did not use this scan, or ended while it measured it (reason {}): none of its figures "
        "was stored",
        stored.block.reason);
    return replay;
  }
  storage::compare(stored.block, again.block, replay.comparison);
  storage::compare(maps, again.maps, replay.comparison);
  replay.outcome = replay.comparison.differences.empty() ? ReplayOutcome::identical : ReplayOutcome::differs;
  if (replay.outcome == ReplayOutcome::differs) {
    replay.why = reason_for_difference(slab, changed, again);
  } else if (again.altered) {
    // A result from a changed scan proves nothing, even if it is identical.
    replay.outcome = ReplayOutcome::differs;
    replay.why = "the scan was changed: " + again.note + "; no stored figure shows it";
  }
  return replay;
}

/// Compares the recipe data in the slab's header, which reports print next to the verdict.
void compare_header(const SlabHeader& stored, const Recipe& recipe, storage::Comparison& out) {
  const auto one = [&](const char* figure, double was, double is) {
    ++out.figures;
    if (was != is) out.differences.push_back({figure, fmt::format("{}", was), fmt::format("{}", is)});
  };
  one("unconfirmed", stored.unconfirmed, unconfirmed_count(recipe));
  one("guard", stored.guard, recipe.guard);
  one("cell_mm", stored.cell_mm, recipe.evaluation.cell_mm);
}

ReplayOutcome outcome_of(const SlabReplay& replay, bool slab_open) {
  bool open = slab_open || (replay.blocks.empty() && !replay.slab_compared);
  for (const BlockReplay& block : replay.blocks) {
    if (block.outcome == ReplayOutcome::differs) return ReplayOutcome::differs;
    open = open || block.outcome == ReplayOutcome::not_verified;
  }
  if (!replay.slab.differences.empty()) return ReplayOutcome::differs;
  return open ? ReplayOutcome::not_verified : ReplayOutcome::identical;
}

}  // namespace

std::string_view name(ReplayOutcome outcome) {
  switch (outcome) {
    case ReplayOutcome::identical: return "identical";
    case ReplayOutcome::differs: return "differs";
    case ReplayOutcome::not_verified: break;
  }
  return "not_verified";
}

std::size_t SlabReplay::figures() const {
  std::size_t sum = slab.figures;
  for (const BlockReplay& block : blocks) sum += block.comparison.figures;
  return sum;
}

std::size_t SlabReplay::scans_proven() const {
  return static_cast<std::size_t>(std::count_if(blocks.begin(), blocks.end(), [](const BlockReplay& block) {
    return block.crc32c_stored.has_value() && block.crc32c_stored == block.crc32c_now;
  }));
}

std::size_t SlabReplay::scans_without_checksum() const {
  return static_cast<std::size_t>(std::count_if(
      blocks.begin(), blocks.end(), [](const BlockReplay& block) { return !block.crc32c_stored.has_value(); }));
}

std::size_t SlabReplay::differences() const {
  std::size_t sum = slab.differences.size();
  for (const BlockReplay& block : blocks) sum += block.comparison.differences.size();
  return sum;
}

Result<SlabReplay> replay_slab(storage::Reader& reader, const storage::SlabRecord& record, RecipeStore& recipe_store,
                               Remeasurer& remeasurer) {
  SlabReplay replay;
  const SlabHeader& slab = record.summary.header;
  replay.key = slab.key;
  replay.slab_id = slab.slab_id.view();
  replay.recorded_recipe = slab.recipe.view();
  replay.verdict = record.summary.verdict;
  if (!(slab.software == daemon::software_version()))
    replay.changed.push_back(
        {"software", std::string(slab.software.view()), std::string(daemon::software_version().view())});
  const Result<const Recipe*> found = recipe_of(slab, reader, recipe_store, replay.changed);
  if (!found) return found.error();
  const Recipe* recipe = found.value();
  if (Status status = check_calibration(reader, record, replay.changed); !status) return status.error();
  const auto stored_basis = basis_of(reader, record, recipe);
  if (!stored_basis) return stored_basis.error();
  const SlabBasis& basis = stored_basis.value().basis;
  for (const StoredBasis::Missing& missing : stored_basis.value().missing)
    replay.changed.push_back({missing.what, missing.id,
                              missing.what == "tie"
                                  ? "the database holds no such record, or its numbers were changed; items across the "
                                    "two robots have no budget"
                                  : "the database holds no such record, or its numbers were changed; the recipe's "
                                    "specification is used alone"});
  if (recipe == nullptr) {
    replay.slab_why = "without a recipe nothing can be measured";
    replay.scans_left = std::any_of(record.blocks.begin(), record.blocks.end(), [&](const storage::SlabBlock& stored) {
      return stored.phase == StationPhase::measured && remeasurer.finds_scan(stored);
    });
    return replay;
  }
  replay.recipe = recipe->path.view();
  remeasurer.use(*recipe);

  std::vector<std::unique_ptr<Remeasured>> again(record.blocks.size());
  std::vector<const BlockResult*> blocks(record.blocks.size(), nullptr);
  for (std::size_t i = 0; i < record.blocks.size(); ++i) {
    const storage::SlabBlock& stored = record.blocks[i];
    if (stored.phase != StationPhase::measured) continue;
    const auto maps = reader.maps(slab.key, stored.attempt.station, stored.attempt.number);
    if (!maps) return maps.error();
    again[i] = std::make_unique<Remeasured>();
    replay.blocks.push_back(replay_block(slab, basis, stored, *maps.value(), replay.changed, remeasurer, *again[i]));
    if (again[i]->scan == Remeasured::Scan::measured && !was_refused(stored.block, again[i]->block))
      blocks[i] = &again[i]->block;
  }

  if (recipe->sha256 == slab.recipe_sha256) compare_header(slab, *recipe, replay.slab);
  if (report::is_open(record)) {
    replay.slab_why = "the slab is still open";
  } else if (record.summary.verdict == Verdict::aborted) {
    replay.slab_why = "the slab was aborted: nothing was judged";
  } else {
    // For stations without a scan the stored result is used, so that the judgement is always verified.
    std::vector<BlockResult> room(limits::kStationsMax);
    auto judged = std::make_unique<SlabResult>();
    daemon::judge_slab(basis, stations_of(record, blocks), room, *judged);
    storage::compare(record.slab, *judged, replay.slab);
    replay.slab_compared = true;
    const bool block_differs = std::any_of(replay.blocks.begin(), replay.blocks.end(), [](const BlockReplay& block) {
      return !block.comparison.differences.empty();
    });
    if (!replay.slab.differences.empty())
      replay.slab_why = block_differs ? "its blocks differ"
                        : !replay.changed.empty()
                            ? "judged with another " + names_of(replay.changed)
                            : "no recorded input differs: the stored result is not what they give";
  }
  replay.outcome = outcome_of(replay, report::is_open(record));
  return replay;
}

}  // namespace slabd::cli
