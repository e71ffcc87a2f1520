// SPDX-License-Identifier: Apache-2.0
#include "cli/trend/stored.h"

#include <algorithm>
#include <set>
#include <span>
#include <utility>

#include "cli/exit.h"

namespace slabd::cli::trend {

namespace {

/// Values held in memory at once.
constexpr std::size_t kValuesMax = 2'000'000;

/// Leaves out emulated or real slabs, whichever the newest is not.
Trend trend_from(const storage::ItemFilter& filter, std::vector<storage::ItemValue> values) {
  const bool emulated = !values.empty() && values.back().emulated != 0;
  std::set<std::int64_t> others;
  for (const storage::ItemValue& value : values)
    if ((value.emulated != 0) != emulated) others.insert(value.slab_key);
  std::erase_if(values, [&](const storage::ItemValue& value) { return (value.emulated != 0) != emulated; });
  Trend t = trend_of(filter.item, filter.block, values);
  for (const storage::ItemValue& value : values) t.emulated = static_cast<std::uint8_t>(t.emulated | value.emulated);
  t.other_emulation = others.size();
  return t;
}

}  // namespace

Trend read_trend(storage::Reader& reader, storage::ItemFilter filter, bool& other_types) {
  auto values = need(reader.values(filter), kNotReachable);
  if (!values.empty()) {
    filter.slab_type = values.back().slab_type;
    other_types = std::any_of(values.begin(), values.end(),
                              [&](const storage::ItemValue& value) { return value.slab_type != filter.slab_type; });
    if (other_types) values = need(reader.values(filter), kNotReachable);
  }
  return trend_from(filter, std::move(values));
}

std::vector<Trend> read_trends(storage::Reader& reader, storage::ItemFilter filter) {
  std::vector<Trend> trends;
  std::vector<ItemId> items;
  for (std::size_t i = 0; i < kItemCount; ++i) items.push_back(static_cast<ItemId>(i));
  const std::size_t at_once =
      std::clamp<std::size_t>(kValuesMax / (filter.slabs * limits::kStationsMax), 1, kItemCount);
  for (std::size_t first = 0; first < items.size(); first += at_once) {
    const std::span<const ItemId> some =
        std::span<const ItemId>(items).subspan(first, std::min(at_once, items.size() - first));
    auto values = need(reader.values_of(filter, some), kNotReachable);
    for (std::size_t i = 0; i < some.size(); ++i) {
      filter.item = some[i];
      trends.push_back(trend_from(filter, std::move(values[i])));
    }
  }
  return trends;
}

}  // namespace slabd::cli::trend
