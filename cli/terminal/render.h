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

/// Terminal output: the table of a block's characteristics, and the map of a slab. Verdicts are a symbol and a word;
/// colour is additional.
namespace slabd::cli {

/// Colour on a terminal unless NO_COLOR is set or TERM is dumb; symbols beyond ASCII if the locale is UTF-8.
[[nodiscard]] report::Style style_for(std::FILE* stream);

/// characteristic, nominal, limits, measured, deviation, U, verdict; items `of_slab` name their stations. If the
/// conformance of a value is neither certain nor impossible, a column contains its probability.
[[nodiscard]] std::string item_table(std::span<const Item> items, report::Style style, bool of_slab = false);

/// A line for each item with a budget: U (k = 2) and its parts (k = 1), that of the tie only if `tied`. Empty if there
/// are none.
[[nodiscard]] std::string budget_table(std::span<const Item> items, bool of_slab, bool tied = false);

/// Whole lines: the flatness operator, the part of flatness that is noise, and the largest defect if there is one.
/// Empty if there are none.
[[nodiscard]] std::string seat_notes(const SeatFeature& seat, double cell_mm);

/// Surface of the block: a line for each finding, the largest first, one for the pores, one for the edges; empty if
/// there are none.
[[nodiscard]] std::string surface_lines(const BlockResult& block);

/// The blocks on the slab as seen from above: row Y > 0 above row Y < 0, X to the right. `verdicts` has one entry per
/// station, [station - 1], an even number. `damaged` has the number of findings that are not small pores, in the same
/// order; it is shown after the symbol. Empty: unknown.
[[nodiscard]] std::string slab_map(std::span<const Verdict> verdicts, report::Style style,
                                   std::span<const std::size_t> damaged = {});
/// One line with the symbols of the map and their words.
[[nodiscard]] std::string map_legend(report::Style style);

/// Symbol and word of a verdict in the chosen language, coloured: "✓ pass".
[[nodiscard]] std::string verdict_words(Verdict verdict, report::Style style);
/// The same as a cell of a table.
[[nodiscard]] report::Cell verdict_cell(Verdict verdict);

/// REASON as text: "605: casing_spacing" or "402: no supporting block was found ...; <cure>".
[[nodiscard]] std::string reason_text(std::uint16_t reason);
/// The same without the cure, for tables.
[[nodiscard]] std::string reason_words(std::uint16_t reason);

}  // namespace slabd::cli
