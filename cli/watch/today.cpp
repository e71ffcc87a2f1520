// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <map>

#include "cli/watch/screen.h"

namespace slabd::cli::watch {

Today today_of(const std::vector<storage::SlabSummary>& newest_first, std::int64_t since_utime_us,
               report::Language language) {
  constexpr std::size_t kReasonsShown = 3;
  Today today;
  std::map<std::uint16_t, std::size_t> reasons;
  std::vector<double> takts_s;
  std::int64_t later_us = 0;  // end of the slab after this one
  for (const storage::SlabSummary& slab : newest_first) {
    if (slab.ended_utime_us == 0 || slab.verdict == Verdict::aborted) continue;
    if (slab.ended_utime_us < since_utime_us) break;
    ++today.slabs;
    if (slab.verdict == Verdict::pass)
      ++today.passed;
    else
      ++reasons[slab.reason];
    if (later_us > slab.ended_utime_us) takts_s.push_back(1e-6 * static_cast<double>(later_us - slab.ended_utime_us));
    later_us = slab.ended_utime_us;
  }
  if (!takts_s.empty()) {
    const auto middle = takts_s.begin() + static_cast<std::ptrdiff_t>(takts_s.size() / 2);
    std::nth_element(takts_s.begin(), middle, takts_s.end());
    today.takt_s = *middle;
  }
  for (const auto& [reason, times] : reasons)
    today.reasons.emplace_back(report::reason_sentence(reason, language), times);
  std::stable_sort(today.reasons.begin(), today.reasons.end(),
                   [](const auto& a, const auto& b) { return a.second > b.second; });
  if (today.reasons.size() > kReasonsShown) today.reasons.resize(kReasonsShown);
  return today;
}

}  // namespace slabd::cli::watch
