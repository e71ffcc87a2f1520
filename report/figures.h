// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <string_view>

#include "base/base.h"

/// How a number becomes text, in the terminal and in every report. One place, so that no two of them disagree.
namespace slabd::cli {

/// Decimals shown: a micrometre, a ten-thousandth of a degree.
[[nodiscard]] int decimals(ItemUnit unit);
[[nodiscard]] int decimals(ItemId id);

/// "-" for none; zero has no sign.
[[nodiscard]] std::string figure(double value, int decimals);

[[nodiscard]] std::string nominal_figure(const Item& item);
/// Of an item that failed by less than is shown, value, deviation and limits have the decimals that tell it.
[[nodiscard]] std::string value_figure(const Item& item);
[[nodiscard]] std::string deviation_figure(const Item& item);
/// "< 0.001" where rounding would make it zero.
[[nodiscard]] std::string U_figure(const Item& item);
/// "1.3325 .. 1.5486", "<= 1.000", ">= 0.100"; empty when the item has no limits.
[[nodiscard]] std::string limits_figure(const Item& item);

/// "seat_spacing [mm] 3-4"; items `of_slab` name their stations.
[[nodiscard]] std::string item_label(const Item& item, bool of_slab);

/// How flatness was evaluated, in words: "cell mean 1.5 mm, least-squares plane, closed from above"; NaN: the cell is
/// not known any more.
[[nodiscard]] std::string flatness_operator(double cell_mm, const SeatFeature& seat);

/// What scans of the blocks cannot show; every report says so.
inline constexpr std::string_view kNotVisible =
    "not visible to the block scans: length, width, thickness, bottom of the slab";

}  // namespace slabd::cli
