// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "hal/scan/drop_folders.h"

namespace slabd::hal {

/// Since when each inbox entry has not changed: the only sign of "finished" that a program without a naming rule
/// gives. Names that vanish are forgotten. No heap; O(entries^2) of at most 32.
class QuietWatch {
 public:
  struct Watched {
    InboxEntry entry;
    std::int64_t since_ns = 0;  ///< seen first in its present state
  };

  void look(std::int64_t now_ns, const InboxEntries& entries) {
    FixedVector<Watched, kInboxEntriesMax> present;
    for (const InboxEntry& entry : entries) {
      const Watched* before = find(entry.name.view());
      const bool unchanged = before != nullptr && before->entry.same_content(entry);
      static_cast<void>(present.push({entry, unchanged ? before->since_ns : now_ns}));
    }
    watched_ = present;
  }
  [[nodiscard]] const FixedVector<Watched, kInboxEntriesMax>& watched() const { return watched_; }

 private:
  [[nodiscard]] const Watched* find(std::string_view name) const {
    for (const Watched& watched : watched_)
      if (watched.entry.name == name) return &watched;
    return nullptr;
  }

  FixedVector<Watched, kInboxEntriesMax> watched_;
};

}  // namespace slabd::hal
