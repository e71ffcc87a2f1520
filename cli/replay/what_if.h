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

/// What other limits or nominals would have decided on stored slabs: counts, item by item and slab by slab.
namespace slabd::cli {

/// Verdicts before and after.
using VerdictPair = std::pair<Verdict, Verdict>;

struct VerdictTally {
  int count = 0;
  std::map<VerdictPair, int> changes;  ///< only those that differ

  void add(Verdict stored, Verdict now);
  [[nodiscard]] int changed() const;
};

class WhatIf {
 public:
  /// A slab that ended with a verdict, and what it would have come to: `stations` with their blocks as they would have
  /// been, and the slab judged from them.
  void add(const storage::SlabRecord& stored, std::span<const StationRecord> stations, const SlabResult& now);
  /// A slab about which nothing can be said; it counts in no share.
  void leave_out(const SlabHeader& slab, std::string why);

  /// Tables for people.
  [[nodiscard]] std::string text(Style style) const;
  /// Fields `slabs`, `slabs_changed`, `share_changed`, `items`, `changed`, `left_out` of the open object.
  void write(Json& json) const;
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
  std::vector<ChangedSlab> changed_;  ///< a verdict of the slab or of an item
  std::vector<LeftOut> left_out_;
};

}  // namespace slabd::cli
