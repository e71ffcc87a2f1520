// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <string>

#include "config/designs.h"

/// Reads the folder of design sheets at the start and whenever it changes, in a thread of its own, because a share that
/// hangs must not block the loop.
namespace slabd::daemon {

class DesignWatch {
 public:
  /// `at_start` was read from `dir`. The folder is looked at about every `period_ms`.
  DesignWatch(const std::string& dir, std::shared_ptr<const config::DesignSet> at_start, int period_ms = 2'000);
  /// Does not wait for a look that hangs.
  ~DesignWatch();
  DesignWatch(const DesignWatch&) = delete;
  DesignWatch& operator=(const DesignWatch&) = delete;

  /// The newest sheets, if they are other than `known`; else nullptr. Does not wait for the folder.
  [[nodiscard]] std::shared_ptr<const config::DesignSet> newer_than(
      const std::shared_ptr<const config::DesignSet>& known) const;

 private:
  struct State;
  std::shared_ptr<State> state_;
};

}  // namespace slabd::daemon
