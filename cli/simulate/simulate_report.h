// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "base/base.h"
#include "emulator/line_run.h"
#include "storage/storage.h"

/// What came of an emulated run: the slab as the PLC saw it, planted truth beside measured values, and the times.
namespace slabd::simulate {

/// One slab: truth, what the PLC saw, and (if readable) what the database holds.
struct SlabOutcome {
  SlabTruth truth;
  SlabRun run;
  std::optional<storage::SlabRecord> stored;
};

struct RunFacts {
  std::string config;
  std::string peer;
  std::uint64_t seed = 0;
  std::vector<Defect> defects;
  std::vector<std::string> defect_texts;
};

/// The measured value of a block item: from the database, else nominal + the result record's deviation (um and
/// millidegree resolution); of seat_lateral and seat_vertical only from the database. NaN when there is none.
[[nodiscard]] double measured_value(const Recipe& recipe, const SlabOutcome& outcome, int station, ItemId id);

[[nodiscard]] std::string outcome_text(const Recipe& recipe, const RunFacts& facts, const SlabOutcome& outcome);
[[nodiscard]] std::string simulation_json(const Recipe& recipe, const RunFacts& facts,
                                          const std::vector<SlabOutcome>& outcomes);

}  // namespace slabd::simulate
