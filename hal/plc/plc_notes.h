// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>

#include "base/rate_limit.h"
#include "hal/hal.h"

/// Log lines of a link, made from its counters. The first error is logged at once; later lines contain sums and are at
/// least ten seconds apart. A peer that floods the port causes at most six lines a minute.
namespace slabd::hal {

class PlcNotes {
 public:
  /// False without new errors, or too early. `detail` (may be empty) names the peer or the cause and is written last.
  bool next(std::int64_t mono_ns, const PlcLinkCounters& now, const char* detail, PlcNoteText& text) {
    struct Trouble {
      std::uint64_t count;
      const char* what;
    };
    const std::array troubles = {
        Trouble{now.not_allowed - said_.not_allowed, "connections from addresses outside [plc] allow"},
        Trouble{now.read_only - said_.read_only, "writes from addresses in [plc] read_only"},
        Trouble{now.displaced - said_.displaced, "connections closed to make room"},
        Trouble{now.malformed - said_.malformed, "streams or frames that are not Modbus"},
        Trouble{now.late - said_.late, "frames not complete in time"},
        Trouble{now.idle - said_.idle, "connections closed in silence"},
        Trouble{now.unsent - said_.unsent, "replies not taken"},
        Trouble{now.exceptions - said_.exceptions, "requests refused"},
    };
    bool any = false;
    for (const Trouble& trouble : troubles) any = any || trouble.count != 0;
    if (!any || !limit_.permits(mono_ns)) return false;
    said_ = now;
    text = "PLC link:";
    const char* comma = " ";
    for (const Trouble& trouble : troubles) {
      if (trouble.count == 0) continue;
      FixedString<96> part;
      part.printf("%s%llu %s", comma, static_cast<unsigned long long>(trouble.count), trouble.what);
      text.append(part.view());
      comma = ", ";
    }
    if (*detail != '\0') {
      text.append("; last: ");
      text.append(detail);
    }
    return true;
  }

 private:
  PlcLinkCounters said_;
  RateLimit limit_{10 * kNsPerS};
};

}  // namespace slabd::hal
