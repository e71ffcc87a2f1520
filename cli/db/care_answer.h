// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>

#include "base/result.h"

namespace slabd::cli {

/// The daemon's slabd.care/1.
struct CareAnswer {
  struct Work {
    std::string state;  ///< none, under_way, done, failed
    std::string path;
    std::int64_t done = 0;  ///< pages copied, slabs taken away
    std::string error;
  };
  Work backup;
  Work prune;
};
/// scanner_offline: no such answer; config: the daemon refused, the text says why.
[[nodiscard]] Result<CareAnswer> parse_care(const std::string& line);

}  // namespace slabd::cli
