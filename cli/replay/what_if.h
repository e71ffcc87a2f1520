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
  void add(const VerdictTally& other);
  [[nodiscard]] int changed() const;
};

/// A slab judged by other limits or nominals, or left out.
struct WhatIfSlab {
  struct ChangedItem {
    Item stored;
    Item now;
  };
  std::int64_t key = 0;
  std::string slab_id;
  std::string left_out;  ///< reason for a slab without new results, which is not part of any share; otherwise empty
  Verdict stored = Verdict::none;
  Verdict now = Verdict::none;
  std::array<VerdictTally, kItemCount> items;  ///< each item once per place
  std::vector<ChangedItem> changed;            ///< items with another verdict
};
/// A slab that ended with a verdict, and its new results: `stations` with their new blocks, and the slab judged from
/// them.
[[nodiscard]] WhatIfSlab judged_slab(const storage::SlabRecord& stored, std::span<const StationRecord> stations,
                                     const SlabResult& now);
[[nodiscard]] WhatIfSlab left_out_slab(const SlabHeader& slab, std::string why);
/// Writes the slab as an object that contains all its members.
void write_slab(report::Json& json, const WhatIfSlab& slab);

class WhatIf {
 public:
  void add(WhatIfSlab slab);

  /// Tables as text.
  [[nodiscard]] std::string text(report::Style style) const;
  /// Fields `slabs`, `slabs_changed`, `share_changed`, `items`, `changed`, `left_out` of the open object.
  void write(report::Json& json) const;

 private:
  VerdictTally slabs_;
  std::array<VerdictTally, kItemCount> items_;
  std::vector<WhatIfSlab> changed_;  ///< slabs with a changed verdict of the slab or of an item
  std::vector<WhatIfSlab> left_out_;
};

}  // namespace slabd::cli
