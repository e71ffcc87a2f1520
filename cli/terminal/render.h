// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <cstdio>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "base/base.h"
#include "report/table.h"

/// What people see in a terminal: the table of a block's characteristics, and the map of a slab. Verdicts are a symbol
/// and a word; colour only adds to them.
namespace slabd::cli {

/// Colour on a terminal unless NO_COLOR is set or TERM is dumb; symbols beyond ASCII when the locale is UTF-8.
[[nodiscard]] Style style_for(std::FILE* stream);

/// characteristic, nominal, limits, measured, deviation, U, verdict; items `of_slab` name their stations. Where it is
/// neither sure nor impossible that a value lies within its limits, a column says how probable it is.
[[nodiscard]] std::string item_table(std::span<const Item> items, Style style, bool of_slab = false);

/// A line for each item with a budget: U (k = 2) and its parts (k = 1). Empty when no item has one.
[[nodiscard]] std::string budget_table(std::span<const Item> items, bool of_slab);

/// How flatness was evaluated and what of it is noise, and the largest defect when there is one: whole lines, none when
/// there is nothing to say.
[[nodiscard]] std::string seat_notes(const SeatFeature& seat, double cell_mm);

/// What the block's surface shows: a line for each finding, the largest first, one for the pores, one for the edges;
/// empty where nothing was looked for and nothing was found.
[[nodiscard]] std::string surface_lines(const BlockResult& block);

/// The blocks as they lie on the slab, seen from above: row Y > 0 above row Y < 0, X to the right. `verdicts` holds
/// one entry per station, [station - 1], an even number of them. `damaged` likewise: how many findings other than small
/// pores there are, shown behind the symbol; empty: not known.
[[nodiscard]] std::string slab_map(std::span<const Verdict> verdicts, Style style,
                                   std::span<const std::size_t> damaged = {});
/// The symbols of the map with their words, one line.
[[nodiscard]] std::string map_legend(Style style);

/// REASON for people: "605: casing_spacing" or "402: no supporting block was found ...; <cure>".
[[nodiscard]] std::string reason_text(std::uint16_t reason);
/// The same without the cure, for tables.
[[nodiscard]] std::string reason_words(std::uint16_t reason);

}  // namespace slabd::cli
