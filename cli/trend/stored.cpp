// SPDX-License-Identifier: Apache-2.0
#include "cli/trend/stored.h"

#include <algorithm>
#include <set>

#include "cli/exit.h"

namespace slabd::cli::trend {

Trend read_trend(storage::Reader& reader, storage::ItemFilter filter, bool& other_types) {
  auto values = need(reader.values(filter), kNotReachable);
  if (!values.empty()) {
    filter.slab_type = values.back().slab_type;
    other_types = std::any_of(values.begin(), values.end(),
                              [&](const storage::ItemValue& value) { return value.slab_type != filter.slab_type; });
    if (other_types) values = need(reader.values(filter), kNotReachable);
  }
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

}  // namespace slabd::cli::trend
