// SPDX-License-Identifier: Apache-2.0
#include "cli/terminal/render.h"

#include <fmt/core.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>

#include "cli/terminal/say.h"
#include "report/budget_text.h"
#include "report/figures.h"
#include "report/slab_view.h"

namespace slabd::cli {
namespace {

std::string limits_text(const Item& item) {
  const std::string limits = report::limits_figure(item);
  return limits.empty() ? say("info") : limits;
}

/// The item by its key, in Chinese by its name, with unit and stations.
std::string label_of(const Item& item, bool of_slab) {
  std::string label = report::item_label(item, of_slab);
  if (language_in_use() == report::Language::zh)
    label.replace(0, info(item.id).name.size(), report::item_word(item.id, language_in_use()));
  return label;
}

/// True if the conformance is neither practically certain nor practically impossible.
bool is_doubtful(const Item& item) {
  const double probability = conformance_probability(item);
  return probability > 0.0005 && probability < 0.9995;
}

}  // namespace

report::Style style_for(std::FILE* stream) {
  const auto variable = [](const char* key) -> std::string_view {
    const char* text = std::getenv(key);
    return text == nullptr ? std::string_view{} : std::string_view(text);
  };
  report::Style style;
  style.colour = isatty(fileno(stream)) != 0 && variable("NO_COLOR").empty() && variable("TERM") != "dumb";
  for (const char* key : {"LC_ALL", "LC_CTYPE", "LANG"}) {
    const std::string_view locale = variable(key);
    if (locale.empty()) continue;
    style.unicode = locale.find("UTF-8") != std::string_view::npos || locale.find("utf8") != std::string_view::npos;
    break;
  }
  return style;
}

std::string item_table(std::span<const Item> items, report::Style style, bool of_slab) {
  const auto heading = [](report::Word which) { return std::string(report::word(which, language_in_use())); };
  report::Table table{heading(report::Word::characteristic),
                      heading(report::Word::nominal),
                      heading(report::Word::limits),
                      heading(report::Word::measured),
                      heading(report::Word::deviation),
                      "U",
                      say("conforms?"),
                      say("verdict<")};
  for (const Item& item : items) {
    table.add(label_of(item, of_slab), report::nominal_figure(item), limits_text(item), report::value_figure(item),
              report::deviation_figure(item), report::U_figure(item),
              is_doubtful(item) ? fmt::format("{:.1f} %", 100.0 * conformance_probability(item)) : "",
              verdict_cell(item.verdict));
    if (report::is_corrected(item))
      table.add("  " + say("at the slab's temperature"), "", "", report::Cell(item.measured, 3));
    if (const std::string_view companion = info(item.id).companion; !companion.empty() && has_value(item.companion))
      table.add(fmt::format("  {}", translated(companion)), "", "", report::Cell(item.companion, 3));
  }
  return report::text_of(table, style);
}

std::string budget_table(std::span<const Item> items, bool of_slab, bool tied) {
  report::Table table{say("U from, k = 1"), "U (k = 2)"};
  for (std::size_t part = 0; part < kBudgetParts - (tied ? 0 : 1); ++part)
    table.columns.emplace_back(translated(name(static_cast<BudgetPart>(part))));
  for (const Item& item : items) {
    if (!report::has_budget(item) || !has_value(item.value)) continue;
    table.add(label_of(item, of_slab), report::U_figure(item));
    for (const std::string& figure : report::budget_figures(item, tied)) table.rows.back().emplace_back(figure);
  }
  return table.rows.empty() ? "" : report::text_of(table);
}

std::string seat_notes(const SeatFeature& seat, double cell_mm) {
  std::string text;
  if (has_value(seat.flatness_mm)) {
    text += say("flatness from {}", report::flatness_operator(cell_mm, seat, language_in_use()));
    if (has_value(seat.flatness_noise_mm))
      text += say("; a perfectly flat seat would read {:.3f} mm with this noise", seat.flatness_noise_mm);
    text += "\n";
    if (has_value(seat.flatness_raw_mm))
      text += say("flatness closed from above {:.3f}, raw {:.3f}, trimmed to nine tenths {:.3f} mm\n",
                  seat.flatness_closed_mm, seat.flatness_raw_mm, seat.flatness_trimmed_mm);
  }
  const SurfaceDefect& defect = seat.defect;
  if (defect.cells > 0)
    text += say("defect: {:.1f} mm2 {} up to {:.3f} mm at x {:.1f} mm, s {:.1f} mm ({} cells beyond {:.3f} mm)\n",
                defect.area_mm2,
                word(defect.height_mm > 0.0 ? report::Word::standing_out : report::Word::sunk, language_in_use()),
                std::abs(defect.height_mm), defect.x_mm, defect.s_mm, defect.cells, defect.limit_mm);
  return text;
}

std::string surface_lines(const BlockResult& block) {
  std::string text;
  for (const SurfaceFinding& finding : block.findings)
    text += say("finding: {}\n", report::finding_sentence(finding, language_in_use()));
  if (!sentence(block.pores).empty()) text += say("pores: {}\n", report::pore_sentence(block.pores, language_in_use()));
  if (const std::string refused = report::refusal_sentence(block, language_in_use()); !refused.empty())
    text += say("not measured: {}\n", refused);
  const std::string edges = report::edge_sentence(block, language_in_use());
  return edges.empty() ? text : text + say("edges: {}\n", edges);
}

std::string slab_map(std::span<const Verdict> verdicts, report::Style style, std::span<const std::size_t> damaged) {
  const std::size_t pairs = verdicts.size() / 2;
  const auto numbers = [&](bool left) {
    std::string line = "         ";
    for (std::size_t column = 0; column < pairs; ++column)
      line += fmt::format("{:>4}", left ? column + 1 : 2 * pairs - column);
    return line + "\n";
  };
  const auto marks = [&](bool left) {
    std::string line = left ? "  Y > 0  " : "  Y < 0  ";
    std::string behind;
    for (std::size_t column = 0; column < pairs; ++column) {
      const std::size_t i = left ? column : 2 * pairs - column - 1;
      const Verdict verdict = verdicts[i];
      // The count replaces blanks before the next symbol.
      line += std::string(3 - std::min<std::size_t>(3, report::display_width(behind)), ' ').insert(0, behind);
      line += report::coloured(report::symbol(verdict, style), verdict, style);
      behind = i < damaged.size() && damaged[i] > 0 ? fmt::format("!{}", std::min<std::size_t>(damaged[i], 9)) : "";
    }
    return line + behind + "\n";
  };
  return numbers(true) + marks(true) + marks(false) + numbers(false);
}

std::string map_legend(report::Style style) {
  std::string line = "  ";
  for (const Verdict verdict :
       {Verdict::pass, Verdict::fail, Verdict::indeterminate, Verdict::not_measured, Verdict::none})
    line += fmt::format("{} {}   ", report::symbol(verdict, style), verdict_name(verdict));
  line.erase(line.find_last_not_of(' ') + 1);
  return line + "\n";
}

std::string verdict_words(Verdict verdict, report::Style style) {
  return report::cell_text(verdict_cell(verdict), style);
}

report::Cell verdict_cell(Verdict verdict) {
  return {verdict, verdict_name(verdict)};
}

std::string reason_words(std::uint16_t reason) {
  if (reason == 0) return "";
  if (language_in_use() == report::Language::zh) {
    const std::string words = report::reason_sentence(reason, language_in_use());
    const std::string number = fmt::format("{}：", reason);
    return words.starts_with(number) ? words : number + words;
  }
  // warp_left and warp_right share a number; a reason without a bit in the fail mask has its own sentence.
  if (const std::optional<ItemId> item = item_from_reason(reason); item && info(*item).plc_bit >= 0)
    return fmt::format("{}: {}", reason, *item == ItemId::warp_left ? "warp" : info(*item).name);
  return fmt::format("{}: {}", reason, describe(static_cast<Code>(reason)));
}

std::string reason_text(std::uint16_t reason) {
  if (reason == 0 || reason >= kReasonItemBase) return reason_words(reason);
  return say("{}; {}", reason_words(reason), report::cure_words(static_cast<Code>(reason), language_in_use()));
}

}  // namespace slabd::cli
