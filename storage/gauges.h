// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "base/jobs.h"
#include "storage/files/sqlite.h"
#include "storage/storage.h"

/// Database rows of gauges: master checks, and values of slabs. Every call must be inside the caller's transaction and
/// throws SqlFailure.
namespace slabd::storage {

class Gauges {
 public:
  explicit Gauges(Connection& db) : db_(db) {}

  /// Adds a check and returns "length_left-check-3". Whether it passed is decided here. The newest check repeated
  /// counts as added. A check that cannot be added throws Refusal (storage/jobs.h).
  std::string keep(const KeepGaugeCheck& change);
  /// Newest first; of one gauge, or of all if the name is empty.
  [[nodiscard]] std::vector<GaugeCheckRecord> checks(std::string_view gauge, std::size_t limit);
  /// Values of ended slabs, newest first.
  [[nodiscard]] std::vector<GaugeSlabValue> values(std::string_view gauge, std::size_t limit);
  /// The newest check of each gauge, the runs of equal values, and the values of the newest slab that has any.
  void read_line(RecoveredLine& line);

 private:
  Connection& db_;
};

}  // namespace slabd::storage
