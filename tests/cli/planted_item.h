// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "base/items.h"

namespace slabd::cli {

/// An item that passes, with limits of 1.3 and 1.5.
inline Item item_of(ItemId id, int station, double value) {
  Item item;
  item.id = id;
  item.station = static_cast<std::uint8_t>(station);
  item.value = value;
  item.nominal = 1.4;
  item.lower = 1.3;
  item.upper = 1.5;
  item.verdict = Verdict::pass;
  return item;
}

}  // namespace slabd::cli
