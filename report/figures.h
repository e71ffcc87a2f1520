// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>
#include <string_view>

#include "base/base.h"
#include "report/words.h"

/// Number formats of the terminal and all reports, defined once so that they agree.
namespace slabd::report {

/// Decimals shown: a micrometre, a ten-thousandth of a degree.
[[nodiscard]] int decimals(ItemUnit unit);
[[nodiscard]] int decimals(ItemId id);

/// "-" if the value is not finite; zero has no sign.
[[nodiscard]] std::string figure(double value, int decimals);

[[nodiscard]] std::string nominal_figure(const Item& item);
/// Value, deviation and limits of a failed item have enough decimals to show by how much it failed.
[[nodiscard]] std::string value_figure(const Item& item);
[[nodiscard]] std::string deviation_figure(const Item& item);
/// "< 0.001" if rounding would make it zero.
[[nodiscard]] std::string U_figure(const Item& item);
/// "2026-11-20 23:28:01 +08:00", in the zone of the process (TZ); empty if `utime_us` is 0.
[[nodiscard]] std::string local_time(std::int64_t utime_us);

/// "1.3325 .. 1.5486", "<= 1.000", ">= 0.100"; empty if the item has no limits.
[[nodiscard]] std::string limits_figure(const Item& item);

/// "seat_spacing [mm] 3-4"; items `of_slab` name their stations.
[[nodiscard]] std::string item_label(const Item& item, bool of_slab);

/// Flatness operator in words: "cell mean 1.5 mm, least-squares plane, closed from above". NaN: the cell size is
/// unknown.
[[nodiscard]] std::string flatness_operator(double cell_mm, const SeatFeature& seat,
                                            report::Language language = report::Language::en);

/// Characteristics that the block scans cannot measure; printed on every report without gauges.
inline constexpr std::string_view kNotVisible =
    "not visible to the block scans: length, width, thickness, bottom of the slab";
/// The same without those that a gauge measured; empty if it measured all.
[[nodiscard]] std::string not_visible(const SlabResult& slab);
/// "length, width, thickness and bottom", without those that a gauge measured; empty if it measured all.
[[nodiscard]] std::string unseen_dimensions(const SlabResult& slab, Language language);

}  // namespace slabd::report
