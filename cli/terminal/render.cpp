// SPDX-License-Identifier: Apache-2.0
#include "cli/terminal/render.h"

#include <fmt/core.h>
#include <unistd.h>

#include <algorithm>
#include <cmath>
#include <cstdlib>

#include "report/budget_text.h"
#include "report/figures.h"
#include "report/words.h"

namespace slabd::cli {
namespace {

struct Look {
  std::string_view unicode;
  std::string_view ascii;
  std::string_view colour;  ///< SGR parameters
};

Look look_of(Verdict verdict) {
  switch (verdict) {
    case Verdict::pass: return {"✓", "+", "32"};
    case Verdict::fail: return {"✗", "X", "1;31"};
    case Verdict::indeterminate: return {"?", "?", "33"};
    case Verdict::not_measured: return {"∅", "0", "35"};
    case Verdict::aborted: return {"⊘", "/", "35"};
    case Verdict::none: return {"·", ".", "2"};
  }
  return {"·", ".", "2"};
}

std::string padded(const std::string& text, std::size_t width, bool right) {
  const std::string space(width - std::min(width, display_width(text)), ' ');
  return right ? space + text : text + space;
}

std::string limits_text(const Item& item) {
  const std::string limits = limits_figure(item);
  return limits.empty() ? "info" : limits;
}

/// Neither as good as sure nor as good as impossible.
bool is_doubtful(const Item& item) {
  const double probability = conformance_probability(item);
  return probability > 0.0005 && probability < 0.9995;
}

}  // namespace

std::string coloured(std::string_view text, std::string_view colour, Style style) {
  return style.colour ? fmt::format("\x1b[{}m{}\x1b[0m", colour, text) : std::string(text);
}

Style style_for(std::FILE* stream) {
  const auto variable = [](const char* key) -> std::string_view {
    const char* text = std::getenv(key);
    return text == nullptr ? std::string_view{} : std::string_view(text);
  };
  Style style;
  style.colour = isatty(fileno(stream)) != 0 && variable("NO_COLOR").empty() && variable("TERM") != "dumb";
  for (const char* key : {"LC_ALL", "LC_CTYPE", "LANG"}) {
    const std::string_view locale = variable(key);
    if (locale.empty()) continue;
    style.unicode = locale.find("UTF-8") != std::string_view::npos || locale.find("utf8") != std::string_view::npos;
    break;
  }
  return style;
}

std::string_view symbol(Verdict verdict, Style style) {
  return style.unicode ? look_of(verdict).unicode : look_of(verdict).ascii;
}

std::string verdict_text(Verdict verdict, Style style) {
  return coloured(fmt::format("{} {}", symbol(verdict, style), name(verdict)), look_of(verdict).colour, style);
}

std::size_t display_width(std::string_view text) {
  std::size_t width = 0;
  for (std::size_t at = 0; at < text.size();) {
    const auto byte = [&](std::size_t i) {
      return at + i < text.size() ? static_cast<unsigned char>(text[at + i]) : 0U;
    };
    if (text[at] == '\x1b') {
      while (at < text.size() && text[at] != 'm') ++at;
      ++at;
      continue;
    }
    const unsigned first = byte(0);
    const std::size_t length = first < 0x80 ? 1 : first < 0xE0 ? 2 : first < 0xF0 ? 3 : 4;
    unsigned code = length == 1 ? first : first & (0xFFU >> (length + 1));
    for (std::size_t i = 1; i < length; ++i) code = code << 6U | (byte(i) & 0x3FU);
    // East Asian Width W and F (Unicode TR 11), in whole blocks.
    const bool wide = (code >= 0x1100 && code <= 0x115F) || (code >= 0x2E80 && code <= 0xA4CF) ||
                      (code >= 0xAC00 && code <= 0xD7A3) || (code >= 0xF900 && code <= 0xFAFF) ||
                      (code >= 0xFE30 && code <= 0xFE6F) || (code >= 0xFF00 && code <= 0xFF60) ||
                      (code >= 0xFFE0 && code <= 0xFFE6) || (code >= 0x1F300 && code <= 0x3FFFD);
    width += wide ? 2 : 1;
    at += length;
  }
  return width;
}

std::string table(const std::vector<std::vector<std::string>>& rows) {
  std::vector<std::vector<std::string>> cells = rows;
  std::vector<bool> left;
  if (!cells.empty()) {
    for (std::string& heading : cells[0]) {
      const bool marked = heading.ends_with('<');
      if (marked) heading.pop_back();
      left.push_back(left.empty() || marked);
    }
  }
  std::vector<std::size_t> widths(left.size(), 0);
  for (const auto& row : cells)
    for (std::size_t c = 0; c < std::min(row.size(), widths.size()); ++c)
      widths[c] = std::max(widths[c], display_width(row[c]));

  std::string text;
  for (std::size_t r = 0; r < cells.size(); ++r) {
    std::string line;
    for (std::size_t c = 0; c < std::min(cells[r].size(), widths.size()); ++c)
      line += (c == 0 ? "" : "  ") + padded(cells[r][c], widths[c], !left[c]);
    line.erase(line.find_last_not_of(' ') + 1);
    text += line + "\n";
    if (r != 0) continue;
    std::size_t total = 0;
    for (const std::size_t width : widths) total += width + 2;
    text += std::string(total - 2, '-') + "\n";
  }
  return text;
}

std::string item_table(std::span<const Item> items, Style style, bool of_slab) {
  std::vector<std::vector<std::string>> rows = {
      {"characteristic", "nominal", "limits", "measured", "deviation", "U", "verdict<"}};
  const bool with_probability = std::any_of(items.begin(), items.end(), is_doubtful);
  if (with_probability) rows[0].insert(rows[0].begin() + 6, "conforms");
  for (const Item& item : items) {
    rows.push_back({item_label(item, of_slab), nominal_figure(item), limits_text(item), value_figure(item),
                    deviation_figure(item), U_figure(item), verdict_text(item.verdict, style)});
    if (with_probability)
      rows.back().insert(rows.back().begin() + 6,
                         is_doubtful(item) ? fmt::format("{:.1f} %", 100.0 * conformance_probability(item)) : "");
    if (const std::string_view beside = beside_name(item.id); !beside.empty() && has_value(item.beside))
      rows.push_back({fmt::format("  {}", beside), "", "", figure(item.beside, 3), "", "", "", ""});
  }
  return table(rows);
}

std::string budget_table(std::span<const Item> items, bool of_slab) {
  std::vector<std::vector<std::string>> rows = {{"U from, k = 1", "U (k = 2)"}};
  for (std::size_t part = 0; part < kBudgetParts; ++part) rows[0].emplace_back(name(static_cast<BudgetPart>(part)));
  for (const Item& item : items) {
    if (!has_budget(item) || !has_value(item.value)) continue;
    rows.push_back({item_label(item, of_slab), U_figure(item)});
    for (std::string& figure : budget_figures(item)) rows.back().push_back(std::move(figure));
  }
  return rows.size() == 1 ? "" : table(rows);
}

std::string seat_notes(const SeatFeature& seat, double cell_mm) {
  std::string text;
  if (has_value(seat.flatness_mm)) {
    text += fmt::format("flatness from {}", flatness_operator(cell_mm, seat));
    if (has_value(seat.flatness_noise_mm))
      text += fmt::format("; a perfectly flat seat would read {:.3f} mm with this noise", seat.flatness_noise_mm);
    text += "\n";
    if (has_value(seat.flatness_raw_mm))
      text += fmt::format("flatness closed from above {:.3f}, raw {:.3f}, trimmed to nine tenths {:.3f} mm\n",
                          seat.flatness_closed_mm, seat.flatness_raw_mm, seat.flatness_trimmed_mm);
  }
  const SurfaceDefect& defect = seat.defect;
  if (defect.cells > 0)
    text +=
        fmt::format("defect: {:.1f} mm2 {} up to {:.3f} mm at x {:.1f} mm, s {:.1f} mm ({} cells beyond {:.3f} mm)\n",
                    defect.area_mm2, defect.height_mm > 0.0 ? "standing out" : "sunk", std::abs(defect.height_mm),
                    defect.x_mm, defect.s_mm, defect.cells, defect.limit_mm);
  return text;
}

std::string surface_lines(const BlockResult& block) {
  std::string text;
  for (const SurfaceFinding& finding : block.findings) text += fmt::format("finding: {}\n", sentence(finding).view());
  if (const auto pores = sentence(block.pores); !pores.empty()) text += fmt::format("pores: {}\n", pores.view());
  if (const std::string refused = report::refusal_sentence(block, report::Language::en); !refused.empty())
    text += fmt::format("not measured: {}\n", refused);
  const std::string edges = report::edge_sentence(block, report::Language::en);
  return edges.empty() ? text : text + "edges: " + edges + "\n";
}

std::string slab_map(std::span<const Verdict> verdicts, Style style, std::span<const std::size_t> damaged) {
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
      // The count takes the place of blanks in front of the next symbol.
      line += std::string(3 - std::min<std::size_t>(3, display_width(behind)), ' ').insert(0, behind);
      line += coloured(symbol(verdict, style), look_of(verdict).colour, style);
      behind = i < damaged.size() && damaged[i] > 0 ? fmt::format("!{}", std::min<std::size_t>(damaged[i], 9)) : "";
    }
    return line + behind + "\n";
  };
  return numbers(true) + marks(true) + marks(false) + numbers(false);
}

std::string map_legend(Style style) {
  std::string line = "  ";
  for (const Verdict verdict :
       {Verdict::pass, Verdict::fail, Verdict::indeterminate, Verdict::not_measured, Verdict::none})
    line += fmt::format("{} {}   ", symbol(verdict, style), name(verdict));
  line.erase(line.find_last_not_of(' ') + 1);
  return line + "\n";
}

std::string reason_words(std::uint16_t reason) {
  if (reason == 0) return "";
  // warp_left and warp_right share a number; a reason without a bit in the fail mask has a sentence of its own.
  if (const std::optional<ItemId> item = item_from_reason(reason); item && info(*item).plc_bit >= 0)
    return fmt::format("{}: {}", reason, *item == ItemId::warp_left ? "warp" : info(*item).name);
  return fmt::format("{}: {}", reason, describe(static_cast<Code>(reason)));
}

std::string reason_text(std::uint16_t reason) {
  if (reason == 0 || reason >= kReasonItemBase) return reason_words(reason);
  return fmt::format("{}; {}", reason_words(reason), cure(static_cast<Code>(reason)));
}

}  // namespace slabd::cli
