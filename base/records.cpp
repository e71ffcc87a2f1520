// SPDX-License-Identifier: Apache-2.0
#include "base/records.h"

#include <algorithm>

namespace slabd {

std::string_view name(RegistrationStatus status) {
  switch (status) {
    case RegistrationStatus::none: return "none";
    case RegistrationStatus::converged: return "converged";
    case RegistrationStatus::iteration_limit: return "iteration_limit";
    case RegistrationStatus::degenerate: return "degenerate";
    case RegistrationStatus::rejected: return "rejected";
  }
  return "none";
}

std::uint16_t reason_for(Verdict verdict, const Item* begin, const Item* end, Code code) {
  if (verdict == Verdict::pass) return 0;
  if (verdict != Verdict::fail && code != Code::ok) return static_cast<std::uint16_t>(code);
  int lowest = -1;
  for (const Item* item = begin; item != end; ++item) {
    if (item->verdict != verdict) continue;
    if (verdict == Verdict::not_measured && !item->required) continue;
    const int bit = info(item->id).plc_bit;
    if (bit >= 0 && (lowest < 0 || bit < lowest)) lowest = bit;
  }
  if (lowest >= 0) return static_cast<std::uint16_t>(kReasonItemBase + lowest);
  return static_cast<std::uint16_t>(code == Code::ok ? Code::fit_failed : code);
}

std::uint16_t fail_mask(const Item* begin, const Item* end) {
  std::uint16_t mask = 0;
  for (const Item* item = begin; item != end; ++item) {
    const int bit = info(item->id).plc_bit;
    if (item->verdict == Verdict::fail && bit >= 0) mask = static_cast<std::uint16_t>(mask | (1U << bit));
  }
  return mask;
}

std::uint16_t open_mask(const Item* begin, const Item* end) {
  std::uint16_t mask = 0;
  for (const Item* item = begin; item != end; ++item) {
    const int bit = info(item->id).plc_bit;
    const bool open = item->verdict == Verdict::indeterminate || item->verdict == Verdict::not_measured;
    if (open && bit >= 0) mask = static_cast<std::uint16_t>(mask | (1U << bit));
  }
  return mask;
}

const Item* find_item(const Item* begin, const Item* end, ItemId id, int station) {
  const Item* found = std::find_if(
      begin, end, [&](const Item& item) { return item.id == id && (station < 0 || item.station == station); });
  return found == end ? nullptr : found;
}

}  // namespace slabd
