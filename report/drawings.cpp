// SPDX-License-Identifier: Apache-2.0
#include <fmt/core.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "report/content.h"
#include "report/figures.h"
#include "report/slab_view.h"

namespace slabd::report {
namespace {

std::uint32_t argb_of(Colour c) {
  const auto byte = [](double share) { return static_cast<std::uint32_t>(std::lround(255.0 * share)); };
  return 0xFF00'0000U | byte(c.r) << 16U | byte(c.g) << 8U | byte(c.b);
}

std::size_t stations_of(const storage::SlabRecord& record) {
  return record.summary.header.stations;
}

std::string list_words(const std::vector<int>& stations) {
  std::string text;
  for (const int station : stations) text += (text.empty() ? "" : ", ") + std::to_string(station);
  return text;
}

/// Position of a map in the drawing; converts block millimetres to drawing coordinates.
struct Frame {
  double left = 0.0;
  double top = 0.0;
  double width = 0.0;
  double height = 0.0;
  double mm_wide = 0.0;  ///< width of the map on the block
  double mm_high = 0.0;

  [[nodiscard]] double x(double x_mm) const { return left + width * (0.5 + x_mm / mm_wide); }
  [[nodiscard]] double y(double y_mm) const { return top + height * (0.5 - y_mm / mm_high); }
};

std::size_t draw_cells(Canvas& canvas, const Frame& frame, const DrawnMap& map, double scale_mm) {
  std::vector<std::uint32_t> argb(map.heights_mm.size(), 0);
  std::size_t beyond = 0;
  for (std::size_t i = 0; i < argb.size(); ++i) {
    const double height = static_cast<double>(map.heights_mm[i]);
    if (!std::isfinite(height)) continue;
    if (std::abs(height) > scale_mm) ++beyond;
    argb[i] = argb_of(scale_colour(0.5 + 0.5 * height / scale_mm));
  }
  canvas.hatch(frame.left, frame.top, frame.width, frame.height);
  canvas.cells(frame.left, frame.top, frame.width, frame.height, map.columns, map.rows, argb);
  canvas.rectangle(frame.left, frame.top, frame.width, frame.height, std::nullopt, kBlack, 0.15);
  return beyond;
}

void draw_axes(Canvas& canvas, const Frame& frame, double tick_mm) {
  const TextStyle small{5.5, false, kGrey, Anchor::centre};
  for (double at = -std::floor(0.5 * frame.mm_wide / tick_mm) * tick_mm; at <= 0.5 * frame.mm_wide; at += tick_mm) {
    canvas.line(frame.x(at), frame.top + frame.height, frame.x(at), frame.top + frame.height + 0.8, 0.12);
    canvas.text(frame.x(at), frame.top + frame.height + 3.0, report::figure(at, 0), small);
  }
  TextStyle right = small;
  right.anchor = Anchor::right;
  for (double at = -std::floor(0.5 * frame.mm_high / tick_mm) * tick_mm; at <= 0.5 * frame.mm_high; at += tick_mm) {
    canvas.line(frame.left - 0.8, frame.y(at), frame.left, frame.y(at), 0.12);
    canvas.text(frame.left - 1.2, frame.y(at) + 0.7, report::figure(at, 0), right);
  }
}

void draw_scale(Canvas& canvas, double x, double top, double height, double scale_mm) {
  constexpr std::size_t kSteps = 64;
  std::array<std::uint32_t, kSteps> argb{};
  for (std::size_t i = 0; i < kSteps; ++i)
    argb[i] = argb_of(scale_colour((static_cast<double>(i) + 0.5) / static_cast<double>(kSteps)));
  canvas.cells(x, top, 2.6, height, 1, kSteps, argb);
  canvas.rectangle(x, top, 2.6, height, std::nullopt, kBlack, 0.12);
  const int digits = scale_mm < 0.1 ? 3 : 2;
  for (const double share : {1.0, 0.5, 0.0, -0.5, -1.0}) {
    const double y = top + 0.5 * height * (1.0 - share);
    canvas.line(x + 2.6, y, x + 3.3, y, 0.12);
    canvas.text(x + 3.8, y + 0.7, fmt::format("{}{}", share > 0.0 ? "+" : "", report::figure(share * scale_mm, digits)),
                {5.5, false, kBlack, Anchor::left});
  }
}

void draw_no_map(Canvas& canvas, double width, double height, Language language) {
  canvas.rectangle(0.0, 0.0, width, height, std::nullopt, kPaleGrey, 0.2, true);
  canvas.paragraph(2.0, 0.35 * height, width - 4.0, word(Word::no_map, language), {7.0, false, kGrey, Anchor::left});
}

constexpr double kMapWidth_mm = 60.0;
constexpr double kMapHeight_mm = 46.0;

Figure map_figure(const std::optional<DrawnMap>& map, double scale_mm, Word title, int station, Language language,
                  const std::function<void(Canvas&, const Frame&)>& over) {
  Figure figure;
  figure.title = word(title, language);
  figure.width_mm = kMapWidth_mm;
  figure.height_mm = kMapHeight_mm;
  if (!map) {
    figure.alt = fmt::format("{}: {}", fmt::format(fmt::runtime(word(Word::block, language)), station),
                             word(Word::no_map, language));
    figure.draw = [language](Canvas& canvas) {
      draw_no_map(canvas, kMapWidth_mm - 6.0, kMapHeight_mm - 8.0, language);
    };
    return figure;
  }
  double low = 0.0;
  double high = 0.0;
  for (const float height : map->heights_mm) {
    if (!std::isfinite(height)) continue;
    low = std::min(low, static_cast<double>(height));
    high = std::max(high, static_cast<double>(height));
  }
  figure.alt = fmt::format("{}, {}: {} .. {} mm", fmt::format(fmt::runtime(word(Word::block, language)), station),
                           word(title, language), report::figure(low, 3), report::figure(high, 3));
  figure.draw = [&map = *map, scale_mm, language, over](Canvas& canvas) {
    Frame frame;
    frame.mm_wide = map.cell_mm * static_cast<double>(map.columns);
    frame.mm_high = map.cell_mm * static_cast<double>(map.rows);
    frame.left = 7.0;
    frame.top = 0.0;
    frame.height = kMapHeight_mm - 7.5;
    frame.width = frame.height * frame.mm_wide / frame.mm_high;
    const std::size_t beyond = draw_cells(canvas, frame, map, scale_mm);
    draw_axes(canvas, frame, frame.mm_high > 300.0 ? 100.0 : 25.0);
    over(canvas, frame);
    const double right = frame.left + frame.width + 2.5;
    draw_scale(canvas, right, 1.5, frame.height - 5.0, scale_mm);
    if (beyond > 0)
      canvas.text(0.0, kMapHeight_mm - 1.6, fmt::format(fmt::runtime(word(Word::outside_scale, language)), beyond),
                  {5.5, false, kGrey, Anchor::left});
  };
  return figure;
}

/// More labels would cover the map.
constexpr std::size_t kMarksNamed = 6;

/// Draws the bounding box of a finding. The seat coordinate s and y differ by less than the line width.
void draw_finding(Canvas& canvas, const Frame& frame, const SurfaceFinding& finding, bool named, Language language) {
  constexpr double kLeast_mm = 1.2;
  const double width = std::max(kLeast_mm, frame.width * finding.length_mm / frame.mm_wide);
  const double height = std::max(kLeast_mm, frame.height * finding.width_mm / frame.mm_high);
  const double x = frame.x(finding.x_mm);
  const double y = frame.y(finding.s_mm);
  canvas.rectangle(x - 0.5 * width, y - 0.5 * height, width, height, std::nullopt, kWhite, 0.8);
  canvas.rectangle(x - 0.5 * width, y - 0.5 * height, width, height, std::nullopt, kBlack, 0.35);
  if (!named) return;
  const std::string mark = finding_mark(finding, language);
  TextStyle style{4.6, true, kBlack, Anchor::left};
  // The label is drawn on the side with more room.
  const double wide = canvas.text_width(mark, style);
  const bool right = finding.x_mm <= 0.0;
  const double left = std::clamp(right ? x + 0.5 * width + 0.5 : x - 0.5 * width - 0.5 - wide, frame.left,
                                 std::max(frame.left, frame.left + frame.width - wide));
  canvas.rectangle(left - 0.2, y - 1.0, wide + 0.4, 2.0, kWhite);
  canvas.text(left, y + 0.6, mark, style);
}

Colour verdict_line(Verdict verdict) {
  return verdict == Verdict::pass   ? Colour{0.05, 0.45, 0.22}
         : verdict == Verdict::fail ? look_of(Verdict::fail).fill
                                    : Colour{0.55, 0.36, 0.0};
}

/// One row of the tolerance chart: value and U between the limits.
void draw_tolerance(Canvas& canvas, const Item& item, double y, double left, double width, Language language) {
  canvas.text(0.0, y + 0.9, item_word(item.id, language), {5.8, item.verdict == Verdict::fail, kBlack, Anchor::left});
  const bool both = has_value(item.lower) && has_value(item.upper);
  const double low = both ? item.lower : has_value(item.upper) ? std::min(0.0, item.upper) : item.lower;
  const double high = both ? item.upper : has_value(item.upper) ? item.upper : item.lower + 1.0;
  if (!(high > low)) return;
  // The chart shows a fifth of the band beyond either limit. Values further out are drawn at the edge with an
  // arrowhead.
  const auto place = [&](double value) {
    return left + width * std::clamp((value - low) / (high - low) / 1.4 + 0.2 / 1.4, 0.0, 1.0);
  };
  canvas.rectangle(place(low), y - 1.3, place(high) - place(low), 2.6, Colour{0.93, 0.93, 0.93});
  canvas.line(left, y, left + width, y, 0.1, kPaleGrey);
  if (has_value(item.lower)) canvas.line(place(low), y - 1.6, place(low), y + 1.6, 0.35);
  if (has_value(item.upper)) canvas.line(place(high), y - 1.6, place(high), y + 1.6, 0.35);
  if (has_value(item.nominal)) canvas.line(place(item.nominal), y - 0.8, place(item.nominal), y + 0.8, 0.15, kGrey);
  if (!has_value(item.value)) {
    canvas.symbol(item.verdict, left + 0.5 * width, y, 2.4, kGrey);
    return;
  }
  const Colour colour = verdict_line(item.verdict);
  if (has_value(item.U)) canvas.line(place(item.value - item.U), y, place(item.value + item.U), y, 0.7, colour);
  if (item.verdict == Verdict::fail) {
    canvas.symbol(Verdict::fail, place(item.value), y, 2.6, colour);
  } else {
    canvas.circle(place(item.value), y, 0.75, colour);
  }
}

/// Draws a dot for each finding of a block that is drawn w x h around (x, y). Blocks of the second row are turned.
void draw_damage(Canvas& canvas, const storage::SlabRecord& record, int station, double x, double y, double w,
                 double h) {
  constexpr double kBlockHalfX_mm = 110.0;
  constexpr double kBlockHalfY_mm = 245.0;
  const double turn = static_cast<std::size_t>(station) <= stations_of(record) / 2 ? 1.0 : -1.0;
  for (const SurfaceFinding& finding : damage_of(record, station))
    canvas.circle(x + turn * 0.5 * w * std::clamp(finding.x_mm / kBlockHalfX_mm, -1.0, 1.0),
                  y - turn * 0.5 * h * std::clamp(finding.s_mm / kBlockHalfY_mm, -1.0, 1.0), 0.7, kWhite, kBlack, 0.3);
}

}  // namespace

Figure slab_map_figure(const storage::SlabRecord& record, Language language) {
  Figure figure;
  const std::size_t stations = stations_of(record);
  figure.title = word(Word::map_title, language);
  figure.width_mm = 180.0;
  figure.height_mm = 66.0;
  figure.alt = word(Word::map_alt, language);
  for (const Verdict verdict :
       {Verdict::fail, Verdict::indeterminate, Verdict::not_measured, Verdict::aborted, Verdict::pass, Verdict::none}) {
    std::vector<int> found;
    for (std::size_t i = 1; i <= stations; ++i)
      if (shown(record, static_cast<int>(i)).verdict == verdict) found.push_back(static_cast<int>(i));
    if (!found.empty()) figure.alt += fmt::format(" {}: {}.", verdict_word(verdict, language), list_words(found));
  }
  std::vector<int> damaged;
  for (std::size_t i = 1; i <= stations; ++i)
    if (!damage_of(record, static_cast<int>(i)).empty()) damaged.push_back(static_cast<int>(i));
  if (!damaged.empty())
    figure.alt += fmt::format(" {}: {}.", item_word(ItemId::block_damage, language), list_words(damaged));
  figure.draw = [&record, stations, language](Canvas& canvas) {
    const std::size_t pairs = stations / 2;
    canvas.rectangle(10.0, 1.0, 169.0, 56.0, Colour{0.965, 0.965, 0.96}, kGrey, 0.4);
    const double pitch = 167.0 / static_cast<double>(pairs);
    for (std::size_t i = 1; i <= 2 * pairs; ++i) {
      const bool positive = i <= pairs;
      const std::size_t column = positive ? i - 1 : 2 * pairs - i;
      const double x = 11.0 + pitch * (static_cast<double>(column) + 0.5);
      const double y = positive ? 16.0 : 42.0;
      const auto [verdict, reason] = shown(record, static_cast<int>(i));
      const VerdictLook look = look_of(verdict);
      const double w = pitch - 2.6;
      const double h = 22.0;
      canvas.rectangle(x - 0.5 * w, y - 0.5 * h, w, h, look.fill, kBlack,
                       verdict == Verdict::pass || verdict == Verdict::none ? 0.2 : 0.7);
      canvas.text(x, y - 6.4, std::to_string(i), {9.0, true, look.ink, Anchor::centre});
      canvas.symbol(verdict, x, y - 0.6, 7.5, look.ink);
      draw_damage(canvas, record, static_cast<int>(i), x, y, w, h);
      if (verdict != Verdict::pass && verdict != Verdict::none) {
        const std::string why = reason_sentence(reason, language);
        const TextStyle style{6.0, true, look.ink, Anchor::left};
        canvas.paragraph(x - 0.5 * w + 0.7, y + 4.4, w - 1.4, why.substr(0, why.find(',')), style, false,
                         0.5 * h - 4.4);
      }
    }
    canvas.text(0.0, 17.0, word(Word::row_positive, language), {6.5, false, kGrey, Anchor::left});
    canvas.text(0.0, 43.0, word(Word::row_negative, language), {6.5, false, kGrey, Anchor::left});
    canvas.line(12.0, 29.0, 22.0, 29.0, 0.25, kGrey);
    canvas.line(22.0, 29.0, 20.6, 28.3, 0.25, kGrey);
    canvas.line(22.0, 29.0, 20.6, 29.7, 0.25, kGrey);
    canvas.text(23.2, 29.8, "X", {6.5, false, kGrey, Anchor::left});
    double x = 12.0;
    for (const Verdict verdict :
         {Verdict::pass, Verdict::fail, Verdict::indeterminate, Verdict::not_measured, Verdict::none}) {
      const VerdictLook look = look_of(verdict);
      canvas.rectangle(x, 59.2, 4.6, 4.6, look.fill, kBlack, 0.2);
      canvas.symbol(verdict, x + 2.3, 61.5, 3.4, look.ink);
      const TextStyle style{6.5, false, kBlack, Anchor::left};
      canvas.text(x + 5.8, 62.4, verdict_word(verdict, language), style);
      x += 10.5 + canvas.text_width(verdict_word(verdict, language), style);
    }
  };
  return figure;
}

Figure registration_figure(const SlabPicture& picture, int station, Language language) {
  const auto i = static_cast<std::size_t>(station - 1);
  // Evaluated area of the seat, as far as the seat map covers it.
  const std::optional<DrawnMap>& seat = picture.seat[i];
  const double half_x = seat ? 0.5 * seat->cell_mm * static_cast<double>(seat->columns) : 0.0;
  const double half_y = seat ? 0.5 * seat->cell_mm * static_cast<double>(seat->rows) : 0.0;
  const std::vector<SurfaceFinding> damage = damage_of(*picture.record, station);
  Figure figure = map_figure(picture.registration[i], picture.registration_scale_mm, Word::registration_map, station,
                             language, [half_x, half_y, damage, language](Canvas& canvas, const Frame& frame) {
                               if (half_x > 0.0)
                                 canvas.rectangle(frame.x(-half_x), frame.y(half_y), frame.x(half_x) - frame.x(-half_x),
                                                  frame.y(-half_y) - frame.y(half_y), std::nullopt, kBlack, 0.25, true);
                               for (std::size_t k = 0; k < damage.size(); ++k)
                                 draw_finding(canvas, frame, damage[k], k < kMarksNamed, language);
                             });
  // Text for readers who cannot see the map, and for blocks without a map.
  for (const SurfaceFinding& finding : damage) figure.alt += "; " + finding_sentence(finding, language);
  return figure;
}

Figure seat_figure(const SlabPicture& picture, int station, Language language) {
  const auto i = static_cast<std::size_t>(station - 1);
  const storage::SlabBlock* block = latest(*picture.record, station);
  const SurfaceDefect defect = block != nullptr ? block->block.seat.defect : SurfaceDefect{};
  Figure figure = map_figure(picture.seat[i], picture.seat_scale_mm, Word::seat_map, station, language,
                             [defect](Canvas& canvas, const Frame& frame) {
                               if (defect.cells == 0) return;
                               const double radius =
                                   frame.width / frame.mm_wide * std::sqrt(defect.area_mm2 / 3.14159) + 1.5;
                               const double x = frame.x(defect.x_mm);
                               const double y = frame.y(defect.s_mm);
                               canvas.circle(x, y, radius, std::nullopt, kWhite, 0.9);
                               canvas.circle(x, y, radius, std::nullopt, kBlack, 0.4);
                             });
  return figure;
}

Figure tolerance_figure(std::span<const Item> items, Language language) {
  Figure figure;
  std::vector<Item> drawn;
  for (const Item& item : items)
    if ((has_value(item.lower) || has_value(item.upper)) && (item.required || has_value(item.value)))
      drawn.push_back(item);
  figure.title = word(Word::tolerance_chart, language);
  figure.width_mm = 58.0;
  figure.height_mm = kMapHeight_mm;
  figure.alt = figure.title + ":";
  for (const Item& item : drawn)
    figure.alt += fmt::format(" {} {} ({});", item_word(item.id, language), value_figure(item),
                              verdict_word(item.verdict, language));
  figure.draw = [drawn, language](Canvas& canvas) {
    const double step = drawn.empty() ? 5.0 : std::min(4.6, 40.0 / static_cast<double>(drawn.size()));
    double y = 3.0;
    for (const Item& item : drawn) {
      draw_tolerance(canvas, item, y, 31.0, 26.0, language);
      y += step;
    }
    const TextStyle small{5.2, false, kGrey, Anchor::centre};
    canvas.text(31.0 + 26.0 * 0.2 / 1.4, y + 1.5, word(Word::lower_end, language), small);
    canvas.text(31.0 + 26.0 * 1.2 / 1.4, y + 1.5, word(Word::upper_end, language), small);
  };
  return figure;
}

Figure seats_figure(const storage::SlabRecord& record, Language language) {
  struct Bar {
    double flatness_mm = kNoValue;
    double std_mm = kNoValue;
    double limit_mm = kNoValue;
  };
  std::vector<Bar> bars(stations_of(record));
  Figure figure;
  figure.title = word(Word::chart_title, language);
  figure.width_mm = 180.0;
  figure.height_mm = 62.0;
  figure.alt = figure.title + ".";
  for (std::size_t i = 0; i < bars.size(); ++i) {
    const storage::SlabBlock* block = latest(record, static_cast<int>(i + 1));
    if (block == nullptr || block->phase != StationPhase::measured) continue;
    const Item* flatness = find_item(block->block.items.begin(), block->block.items.end(), ItemId::seat_flatness);
    bars[i].flatness_mm = block->block.seat.flatness_mm;
    if (block->block.seat.plane.ok) bars[i].std_mm = block->block.seat.plane.std_mm;
    if (flatness != nullptr) bars[i].limit_mm = flatness->upper;
    figure.alt +=
        fmt::format(" {}: {}, {}.", i + 1, report::figure(bars[i].flatness_mm, 3), report::figure(bars[i].std_mm, 3));
  }
  figure.draw = [bars, language](Canvas& canvas) {
    const auto panel = [&](double top, Word title, double Bar::*value, Colour colour, bool with_limit) {
      constexpr double kHeight = 22.0;
      double most = 0.0;
      double limit = kNoValue;
      for (const Bar& bar : bars) {
        if (has_value(bar.*value)) most = std::max(most, bar.*value);
        if (with_limit && has_value(bar.limit_mm)) limit = bar.limit_mm;
      }
      // The scale contains the limit, so that a bar shows the share of the limit that is used.
      const double top_value = std::max(has_value(limit) ? std::max(most, limit) : most, 1e-3) * 1.2;
      const double bottom = top + kHeight + 4.0;
      canvas.text(0.0, top + 2.0,
                  has_value(limit) ? fmt::format("{} ({} <= {} mm)", word(title, language),
                                                 word(Word::limits, language), report::figure(limit, 3))
                                   : std::string(word(title, language)),
                  {6.8, true, kBlack, Anchor::left});
      const double pitch = 170.0 / static_cast<double>(bars.size());
      for (std::size_t i = 0; i < bars.size(); ++i) {
        const double x = 9.0 + pitch * static_cast<double>(i);
        canvas.text(x + 0.5 * pitch, bottom + 3.2, std::to_string(i + 1), {6.0, false, kGrey, Anchor::centre});
        const double height = bars[i].*value;
        if (!has_value(height)) {
          canvas.symbol(Verdict::not_measured, x + 0.5 * pitch, bottom - 2.5, 3.0, kGrey);
          continue;
        }
        const double tall = kHeight * height / top_value;
        const bool beyond = has_value(limit) && height > limit;
        canvas.rectangle(x + 0.16 * pitch, bottom - tall, 0.68 * pitch, tall,
                         beyond ? look_of(Verdict::fail).fill : colour, kBlack, 0.1);
        canvas.text(x + 0.5 * pitch, bottom - tall - 0.8, report::figure(height, 3),
                    {5.5, false, kBlack, Anchor::centre});
      }
      canvas.line(9.0, bottom, 179.0, bottom, 0.2);
      if (has_value(limit)) {
        const double y = bottom - kHeight * limit / top_value;
        canvas.line(9.0, y, 179.0, y, 0.35, look_of(Verdict::fail).fill, true);
        canvas.text(8.2, y + 0.8, report::figure(limit, 3), {5.5, false, look_of(Verdict::fail).fill, Anchor::right});
      }
    };
    panel(0.0, Word::flatness, &Bar::flatness_mm, {0.36, 0.53, 0.72}, true);
    panel(31.0, Word::standard_deviation, &Bar::std_mm, {0.72, 0.76, 0.80}, false);
  };
  return figure;
}

}  // namespace slabd::report
