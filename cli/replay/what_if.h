// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <map>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "cli/terminal/render.h"
#include "report/json.h"
#include "storage/storage.h"

/// Decisions of other limits or nominals on stored slabs: counts by item and by slab.
namespace slabd::cli {

/// Verdicts before and after.
using VerdictPair = std::pair<Verdict, Verdict>;

struct VerdictTally {
  int count = 0;
  std::map<VerdictPair, int> changes;  ///< only verdicts that differ

  void add(Verdict stored, Verdict now);
  [[nodiscard]] int changed() const;
};

class WhatIf {
 public:
  /// Adds a slab that ended with a verdict, and its new results: `stations` with their new blocks, and the slab judged
  /// from them.
  void add(const storage::SlabRecord& stored, std::span<const StationRecord> stations, const SlabResult& now);
  /// Adds a slab without new results; it is not part of any share.
  void leave_out(const SlabHeader& slab, std::string why);

  /// Tables as text.
  [[nodiscard]] std::string text(report::Style style) const;
  /// Fields `slabs`, `slabs_changed`, `share_changed`, `items`, `changed`, `left_out` of the open object.
  void write(report::Json& json) const;
  [[nodiscard]] bool any() const { return slabs_.count > 0; }

 private:
  struct ChangedItem {
    Item stored;
    Item now;
  };
  struct ChangedSlab {
    std::int64_t key = 0;
    std::string slab_id;
    Verdict stored = Verdict::none;
    Verdict now = Verdict::none;
    std::vector<ChangedItem> items;
  };
  struct LeftOut {
    std::int64_t key = 0;
    std::string slab_id;
    std::string why;
  };

  VerdictTally slabs_;
  std::array<VerdictTally, kItemCount> items_;
  std::vector<ChangedSlab> changed_;  ///< slabs with a changed verdict of the slab or of an item
  std::vector<LeftOut> left_out_;
};

}  // namespace slabd::cli
