// SPDX-License-Identifier: Apache-2.0
//
// The report on A4 sheets. All parts are measured and placed before drawing, so the pages are the same on every
// surface. A section with `together` moves to the next page as a whole; a filler is placed only where a page has room
// for it; a table that does not fit is broken between rows and repeats its heading.
#include <cairo.h>
#include <fmt/core.h>

#include <algorithm>
#include <memory>
#include <numeric>

#include "report/content.h"

namespace slabd::report {
namespace {

constexpr double kLeft = 15.0;
constexpr double kTop = 20.0;
constexpr double kBottom = 283.0;
constexpr double kWidth = kPageWidth_mm - 2.0 * kLeft;
constexpr double kRowHeight = 3.6;
constexpr double kGap = 2.5;

const TextStyle kBody{7.2, false, kBlack, Anchor::left};
const TextStyle kHeading{7.0, true, kBlack, Anchor::left};
constexpr Colour kEmulationInk{0.62, 0.05, 0.10};
/// Pale enough to read tables through it, dark enough to remain on a bad copy.
constexpr Colour kWatermark{0.88, 0.80, 0.80};

/// A part of the report with its position.
struct Placed {
  int page = 0;
  double y = 0.0;
  std::function<void(Canvas&)> draw;  ///< draws with its upper left corner as the origin
};

/// Text cut to the width, with an ellipsis.
std::string fitted(Canvas& canvas, const std::string& text, double width, const TextStyle& style) {
  if (canvas.text_width(text, style) <= width) return text;
  std::string cut = text;
  while (!cut.empty() && canvas.text_width(cut + "…", style) > width) {
    do cut.pop_back();
    while (!cut.empty() && (static_cast<unsigned char>(cut.back()) & 0xC0U) == 0x80U);
    if (!cut.empty() && (static_cast<unsigned char>(cut.back()) & 0x80U) != 0) cut.pop_back();
  }
  return cut + "…";
}

/// A table with column positions: each column is as wide as its heading and its longest cell, scaled to fill the page.
struct Grid {
  Grid(const Table& whole, Canvas& ruler) : table(visible(whole)) {
    for (std::size_t c = 0; c < table.columns.size(); ++c) {
      const Cell* longest = nullptr;
      for (const Table::Row& row : table.rows)
        if (c < row.size() && (longest == nullptr || display_width(row[c].text) > display_width(longest->text)))
          longest = &row[c];
      const double cell = longest == nullptr ? 0.0 : ruler.text_width(longest->text, kHeading);
      const double symbol = longest != nullptr && longest->verdict ? 3.6 : 0.0;
      widths.push_back(std::max(cell + symbol, ruler.text_width(table.columns[c].heading, kHeading)) + 2.0);
    }
    const double sum = std::accumulate(widths.begin(), widths.end(), 0.0);
    for (double& width : widths) width *= kWidth / sum;
  }
  Table table;
  std::vector<double> widths;
};

void draw_cells(Canvas& canvas, const Grid& grid, const Table::Row& cells, double y, const TextStyle& style) {
  double x = 0.0;
  for (std::size_t c = 0; c < std::min(cells.size(), grid.widths.size()); ++c) {
    const double width = grid.widths[c];
    const Verdict verdict = cells[c].verdict.value_or(Verdict::none);
    TextStyle cell = style;
    double at = x + 0.8;
    double room = width - 1.6;
    if (verdict != Verdict::none) {
      canvas.symbol(verdict, at + 1.3, y + 0.5 * kRowHeight, 2.3, kBlack);
      at += 3.6;
      room -= 3.6;
      cell.bold = verdict == Verdict::fail;
    } else if (c > 0 && !grid.table.columns[c].left) {
      cell.anchor = Anchor::right;
      at = x + width - 0.8;
    }
    canvas.text(at, y + 2.7, fitted(canvas, cells[c].text, room, cell), cell);
    x += width;
  }
}

void draw_heading(Canvas& canvas, const Grid& grid) {
  canvas.rectangle(0.0, 0.0, kWidth, kRowHeight + 0.4, Colour{0.90, 0.91, 0.93});
  Table::Row headings;
  for (const Column& column : grid.table.columns) headings.emplace_back(column.heading);
  draw_cells(canvas, grid, headings, 0.2, kHeading);
}

void draw_row(Canvas& canvas, const Grid& grid, const Table::Row& row) {
  const Verdict verdict = verdict_of(row);
  if (verdict == Verdict::fail || verdict == Verdict::indeterminate)
    canvas.rectangle(0.0, 0.0, kWidth, kRowHeight,
                     verdict == Verdict::fail ? Colour{0.98, 0.86, 0.86} : Colour{1.0, 0.95, 0.80});
  TextStyle style = kBody;
  style.bold = verdict == Verdict::fail;
  draw_cells(canvas, grid, row, 0.0, style);
  canvas.line(0.0, kRowHeight, kWidth, kRowHeight, 0.06, kPaleGrey);
}

}  // namespace

struct Pages::Layout {
  explicit Layout(const Report& r)
      : report(r),
        surface(cairo_recording_surface_create(CAIRO_CONTENT_COLOR_ALPHA, nullptr)),
        context(cairo_create(surface)),
        ruler(context) {
    place_all();
  }
  ~Layout() {
    cairo_destroy(context);
    cairo_surface_destroy(surface);
  }
  Layout(const Layout&) = delete;
  Layout& operator=(const Layout&) = delete;

  void next_page() {
    ++page;
    y = kTop;
  }
  void make_room(double height) {
    if (y + height > kBottom && y > kTop) next_page();
  }
  void put(double height, std::function<void(Canvas&)> draw) {
    placed.push_back({page, y, std::move(draw)});
    y += height;
  }

  double height_of(const Paragraph& paragraph) {
    return ruler.paragraph(0.0, 0.0, kWidth - 5.5, paragraph.text, kBody, true) + 1.1;
  }
  static double height_of(const Table& table) {
    return kRowHeight * static_cast<double>(table.rows.size() + 1) + 0.4 + kGap;
  }
  static double height_of(const Figures& figures) {
    double most = 0.0;
    for (const Figure& figure : figures.list) most = std::max(most, figure.height_mm);
    return most + 5.0 + kGap;
  }
  double height_of(const Section& section) {
    double sum = section.title.empty() ? 0.0 : 8.0;
    for (const Part& part : section.parts) sum += std::visit([&](const auto& p) { return height_of(p); }, part);
    return sum;
  }

  void place(const Paragraph& paragraph) {
    const double height = height_of(paragraph);
    make_room(height);
    put(height, [&paragraph](Canvas& canvas) {
      double at = 0.0;
      if (paragraph.verdict != Verdict::none) {
        const VerdictLook look = look_of(paragraph.verdict);
        canvas.rectangle(0.0, 0.0, 3.8, 3.4, look.fill, kBlack, 0.15);
        canvas.symbol(paragraph.verdict, 1.9, 1.7, 2.5, look.ink);
        at = 5.4;
      } else if (paragraph.warning) {
        canvas.rectangle(0.0, 0.0, 3.8, 3.4, kWhite, kBlack, 0.3);
        canvas.text(1.9, 2.7, "!", {8.0, true, kBlack, Anchor::centre});
        at = 5.4;
      }
      TextStyle style = kBody;
      style.bold = paragraph.verdict == Verdict::fail;
      canvas.paragraph(at, 0.0, kWidth - 5.5, paragraph.text, style);
    });
  }

  void place(const Table& table) {
    const auto grid = std::make_shared<const Grid>(table, ruler);
    const auto heading = [grid](Canvas& canvas) { draw_heading(canvas, *grid); };
    make_room(3.0 * kRowHeight);
    put(kRowHeight + 0.4, heading);
    for (const Table::Row& row : grid->table.rows) {
      if (y + kRowHeight > kBottom) {
        next_page();
        put(kRowHeight + 0.4, heading);
      }
      put(kRowHeight, [grid, &row](Canvas& canvas) { draw_row(canvas, *grid, row); });
    }
    y += kGap;
  }

  void place(const Figures& figures) {
    const double height = height_of(figures);
    make_room(height);
    put(height, [&figures](Canvas& canvas) {
      double x = 0.0;
      for (const Figure& figure : figures.list) {
        canvas.text(x, 3.0, figure.title, kHeading);
        canvas.move_origin(x, 5.0);
        figure.draw(canvas);
        canvas.move_origin(-x, -5.0);
        x += figure.width_mm + 1.0;
      }
    });
  }

  void place_title(const Section& section) {
    put(8.0, [&section](Canvas& canvas) {
      double at = 0.0;
      if (section.verdict != Verdict::none) {
        const VerdictLook look = look_of(section.verdict);
        canvas.rectangle(0.0, 0.6, 5.6, 5.6, look.fill, kBlack, 0.2);
        canvas.symbol(section.verdict, 2.8, 3.4, 4.2, look.ink);
        at = 7.2;
      }
      const TextStyle style{10.5, true, kBlack, Anchor::left};
      canvas.text(at, 4.9, section.title, style);
      if (!section.remark.empty())
        canvas.text(at + canvas.text_width(section.title, style) + 3.0, 4.9, section.remark,
                    {8.0, section.verdict == Verdict::fail, kBlack, Anchor::left});
      canvas.line(0.0, 6.9, kWidth, 6.9, 0.25, kGrey);
    });
  }

  void place_all() {
    page = 0;
    y = kTop + (report.judged ? 14.0 : 0.0);  // below the first page's band
    std::vector<const Section*> later;        // fillers that did not fit yet
    const auto fill = [&] {
      std::erase_if(later, [&](const Section* section) {
        const bool fits = y + height_of(*section) <= kBottom;
        if (fits) place(*section);
        return fits;
      });
    };
    for (const Section& section : report.sections) {
      if (section.parts.empty()) continue;
      const bool fits = y + height_of(section) <= kBottom;
      if (section.filler && !fits) {
        later.push_back(&section);
        continue;
      }
      if (section.together && !fits) fill();
      place(section);
    }
    fill();
  }

  void place(const Section& section) {
    // Title and first lines of a section that may be broken stay together.
    make_room(section.together ? std::min(height_of(section), kBottom - kTop) : 8.0 + 3.0 * kRowHeight);
    if (!section.title.empty()) place_title(section);
    for (const Part& part : section.parts) std::visit([&](const auto& p) { place(p); }, part);
    y += 1.5;
  }

  const Report& report;
  cairo_surface_t* surface;
  cairo_t* context;
  Canvas ruler;
  std::vector<Placed> placed;
  int page = 0;
  double y = 0.0;
};

Pages::Pages(const Report& report) : layout_(std::make_unique<Layout>(report)) {}
Pages::~Pages() = default;

int Pages::count() const {
  return layout_->page + 1;
}

void Pages::draw(int page, Canvas& canvas) const {
  const Report& report = layout_->report;
  const Language language = report.language;
  if (report.emulated != 0) {
    for (const double y : {90.0, 160.0, 230.0})
      canvas.slanted_text(0.5 * kPageWidth_mm, y, emulation_mark(report.emulated, language),
                          {54.0, true, kWatermark, Anchor::centre});
    canvas.text(0.5 * kPageWidth_mm, 6.0, emulation_notice(report.emulated, language),
                {8.5, true, kEmulationInk, Anchor::centre});
    canvas.text(0.5 * kPageWidth_mm, 293.5, emulation_notice(report.emulated, language),
                {6.5, true, kEmulationInk, Anchor::centre});
  }
  const TextStyle title{page == 0 ? 14.0 : 8.5, true, kBlack, Anchor::left};
  canvas.text(kLeft, 12.0, report.title, title);
  const TextStyle subject{page == 0 ? 10.0 : 8.5, true, kBlack, Anchor::right};
  const double room = kWidth - canvas.text_width(report.title, title) - 4.0;
  canvas.text(kPageWidth_mm - kLeft, 12.0, fitted(canvas, report.subject, room, subject), subject);
  canvas.line(kLeft, 15.0, kPageWidth_mm - kLeft, 15.0, 0.3);
  if (page == 0 && report.judged) {
    const VerdictLook look = look_of(report.verdict);
    canvas.rectangle(kLeft, 18.0, kWidth, 13.0, look.fill, kBlack, 0.3);
    canvas.symbol(report.verdict, kLeft + 8.0, 24.5, 8.5, look.ink);
    canvas.text(kLeft + 16.0, 26.6,
                report.open ? word(Word::still_open, language) : verdict_word(report.verdict, language),
                {17.0, true, look.ink, Anchor::left});
    if (report.emulated != 0)
      canvas.text(kPageWidth_mm - kLeft - 6.0, 26.6, emulation_mark(report.emulated, language),
                  {17.0, true, kEmulationInk, Anchor::right});
  }
  canvas.line(kLeft, 285.0, kPageWidth_mm - kLeft, 285.0, 0.15, kGrey);
  canvas.text(kPageWidth_mm - kLeft, 289.0,
              fmt::format(fmt::runtime(word(Word::page, language)), page + 1, layout_->page + 1),
              {6.5, false, kGrey, Anchor::right});
  std::string about = report.subject;
  if (report.judged)
    about +=
        fmt::format(": {}", report.open ? word(Word::still_open, language) : verdict_word(report.verdict, language));
  if (report.emulated != 0) about += fmt::format(" ({})", emulation_mark(report.emulated, language));
  canvas.text(kLeft, 289.0, about, {6.5, false, kGrey, Anchor::left});
  for (const Placed& placed : layout_->placed) {
    if (placed.page != page) continue;
    canvas.move_origin(kLeft, placed.y);
    placed.draw(canvas);
    canvas.move_origin(-kLeft, -placed.y);
  }
}

}  // namespace slabd::report
