// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "base/base.h"
#include "emulator/line_run.h"
#include "storage/storage.h"

/// Results of an emulated run: the slab as seen by the PLC, planted truth next to measured values, and the times.
namespace slabd::cli::simulate {

/// One slab: truth, PLC data, and (if readable) database contents.
struct SlabOutcome {
  emulator::SlabTruth truth;
  emulator::SlabRun run;
  std::optional<storage::SlabRecord> stored;
};

struct RunFacts {
  std::string config;
  std::string peer;
  std::uint64_t seed = 0;
  std::vector<emulator::Defect> defects;
  std::vector<std::string> defect_texts;
  LineArms arms;
  std::vector<emulator::FurtherArm> further;  ///< as in emulator::Cell
};

/// The measured value of a block item: from the database, otherwise nominal + the result record's deviation (um and
/// millidegree resolution). seat_lateral and seat_vertical are only in the database. NaN if missing.
[[nodiscard]] double measured_value(const Recipe& recipe, const SlabOutcome& outcome, int station, ItemId id);

[[nodiscard]] std::string outcome_text(const Recipe& recipe, const RunFacts& facts, const SlabOutcome& outcome);
[[nodiscard]] std::string simulation_json(const Recipe& recipe, const RunFacts& facts,
                                          const std::vector<SlabOutcome>& outcomes);

}  // namespace slabd::cli::simulate
