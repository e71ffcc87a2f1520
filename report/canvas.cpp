// SPDX-License-Identifier: Apache-2.0
#include "report/canvas.h"

#include <cairo.h>
#include <pango/pangocairo.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <memory>
#include <numbers>

namespace slabd::report {
namespace {

constexpr double kMmPerPoint = 25.4 / 72.0;

struct Unref {
  void operator()(PangoLayout* layout) const { g_object_unref(layout); }
};
using Layout = std::unique_ptr<PangoLayout, Unref>;

/// Text is laid out at a hundred times its size and scaled down, because Pango rounds to whole units.
constexpr double kLayoutScale = 100.0;

Layout layout_of(cairo_t* context, std::string_view text, const TextStyle& style) {
  Layout layout(pango_cairo_create_layout(context));
  PangoFontDescription* font = pango_font_description_new();
  // The second family contains the Chinese characters that the first does not.
  pango_font_description_set_family(font, "DejaVu Sans, Noto Sans CJK SC");
  pango_font_description_set_weight(font, style.bold ? PANGO_WEIGHT_BOLD : PANGO_WEIGHT_NORMAL);
  pango_font_description_set_absolute_size(font, style.size_pt * kMmPerPoint * kLayoutScale * PANGO_SCALE);
  pango_layout_set_font_description(layout.get(), font);
  pango_font_description_free(font);
  PangoContext* pango = pango_layout_get_context(layout.get());
  pango_cairo_context_set_resolution(pango, 72.0);
  cairo_font_options_t* options = cairo_font_options_create();
  cairo_font_options_set_hint_style(options, CAIRO_HINT_STYLE_NONE);
  cairo_font_options_set_hint_metrics(options, CAIRO_HINT_METRICS_OFF);
  pango_cairo_context_set_font_options(pango, options);
  cairo_font_options_destroy(options);
  pango_layout_context_changed(layout.get());
  pango_layout_set_text(layout.get(), text.data(), static_cast<int>(text.size()));
  return layout;
}

double mm_of(int pango_units) {
  return static_cast<double>(pango_units) / PANGO_SCALE / kLayoutScale;
}

void show(cairo_t* context, PangoLayout* layout) {
  cairo_save(context);
  cairo_scale(context, 1.0 / kLayoutScale, 1.0 / kLayoutScale);
  pango_cairo_show_layout(context, layout);
  cairo_restore(context);
}

}  // namespace

VerdictLook look_of(Verdict verdict) {
  // Lightness falls from pass to fail; the ink colour contrasts with the fill.
  switch (verdict) {
    case Verdict::pass: return {{0.84, 0.94, 0.87}, {0.05, 0.35, 0.18}};
    case Verdict::fail: return {{0.62, 0.05, 0.10}, kWhite};
    case Verdict::indeterminate: return {{0.98, 0.80, 0.36}, {0.25, 0.16, 0.0}};
    case Verdict::not_measured:
    case Verdict::aborted: return {{0.55, 0.50, 0.66}, kBlack};
    case Verdict::none: break;
  }
  return {kWhite, kGrey};
}

Colour scale_colour(double share) {
  static constexpr std::array<std::array<int, 3>, 11> kViridis = {{{68, 1, 84},
                                                                   {72, 36, 117},
                                                                   {65, 68, 135},
                                                                   {53, 95, 141},
                                                                   {42, 120, 142},
                                                                   {33, 145, 140},
                                                                   {34, 168, 132},
                                                                   {68, 191, 112},
                                                                   {122, 209, 81},
                                                                   {189, 223, 38},
                                                                   {253, 231, 37}}};
  const double at = std::clamp(share, 0.0, 1.0) * 10.0;
  const auto low = static_cast<std::size_t>(std::min(std::floor(at), 9.0));
  const double rest = at - static_cast<double>(low);
  const auto mix = [&](std::size_t c) {
    return ((1.0 - rest) * kViridis[low][c] + rest * kViridis[low + 1][c]) / 255.0;
  };
  return {mix(0), mix(1), mix(2)};
}

void Canvas::set(Colour colour) {
  cairo_set_source_rgb(context_, colour.r, colour.g, colour.b);
}

void Canvas::line(double x0, double y0, double x1, double y1, double width, Colour colour, bool dashed) {
  static constexpr std::array<double, 2> kDashes = {1.2, 0.8};
  set(colour);
  cairo_set_line_width(context_, width);
  cairo_set_dash(context_, kDashes.data(), dashed ? 2 : 0, 0.0);
  cairo_move_to(context_, x0, y0);
  cairo_line_to(context_, x1, y1);
  cairo_stroke(context_);
  cairo_set_dash(context_, nullptr, 0, 0.0);
}

void Canvas::rectangle(double x, double y, double width, double height, std::optional<Colour> fill,
                       std::optional<Colour> stroke, double stroke_width, bool dashed) {
  static constexpr std::array<double, 2> kDashes = {1.2, 0.8};
  cairo_rectangle(context_, x, y, width, height);
  if (fill) {
    set(*fill);
    cairo_fill_preserve(context_);
  }
  if (stroke) {
    set(*stroke);
    cairo_set_line_width(context_, stroke_width);
    cairo_set_dash(context_, kDashes.data(), dashed ? 2 : 0, 0.0);
    cairo_stroke_preserve(context_);
    cairo_set_dash(context_, nullptr, 0, 0.0);
  }
  cairo_new_path(context_);
}

void Canvas::circle(double x, double y, double radius, std::optional<Colour> fill, std::optional<Colour> stroke,
                    double stroke_width) {
  cairo_new_path(context_);
  cairo_arc(context_, x, y, radius, 0.0, 2.0 * std::numbers::pi);
  if (fill) {
    set(*fill);
    cairo_fill_preserve(context_);
  }
  if (stroke) {
    set(*stroke);
    cairo_set_line_width(context_, stroke_width);
    cairo_stroke_preserve(context_);
  }
  cairo_new_path(context_);
}

void Canvas::hatch(double x, double y, double width, double height) {
  cairo_save(context_);
  cairo_rectangle(context_, x, y, width, height);
  cairo_clip(context_);
  set(kPaleGrey);
  cairo_set_line_width(context_, 0.12);
  for (double at = -height; at < width; at += 1.4) {
    cairo_move_to(context_, x + at, y + height);
    cairo_line_to(context_, x + at + height, y);
  }
  cairo_stroke(context_);
  cairo_restore(context_);
}

void Canvas::text(double x, double y, std::string_view text, const TextStyle& style) {
  const Layout layout = layout_of(context_, text, style);
  int width = 0;
  pango_layout_get_size(layout.get(), &width, nullptr);
  const double wide = mm_of(width);
  const double left = style.anchor == Anchor::left ? x : style.anchor == Anchor::centre ? x - 0.5 * wide : x - wide;
  set(style.colour);
  cairo_move_to(context_, left, y - mm_of(pango_layout_get_baseline(layout.get())));
  show(context_, layout.get());
  cairo_new_path(context_);
}

void Canvas::slanted_text(double x, double y, std::string_view text, const TextStyle& style) {
  TextStyle centred = style;
  centred.anchor = Anchor::centre;
  cairo_save(context_);
  cairo_translate(context_, x, y);
  cairo_rotate(context_, -0.25 * std::numbers::pi);
  this->text(0.0, 0.0, text, centred);
  cairo_restore(context_);
}

double Canvas::text_width(std::string_view text, const TextStyle& style) {
  const Layout layout = layout_of(context_, text, style);
  int width = 0;
  pango_layout_get_size(layout.get(), &width, nullptr);
  return mm_of(width);
}

double Canvas::paragraph(double x, double y, double width, std::string_view text, const TextStyle& style,
                         bool measure_only, double height_max) {
  const Layout layout = layout_of(context_, text, style);
  pango_layout_set_width(layout.get(), static_cast<int>(width * kLayoutScale * PANGO_SCALE));
  pango_layout_set_wrap(layout.get(), PANGO_WRAP_WORD_CHAR);
  if (height_max > 0.0) {
    pango_layout_set_height(layout.get(), static_cast<int>(height_max * kLayoutScale * PANGO_SCALE));
    pango_layout_set_ellipsize(layout.get(), PANGO_ELLIPSIZE_END);
  }
  int height = 0;
  pango_layout_get_size(layout.get(), nullptr, &height);
  if (!measure_only) {
    set(style.colour);
    cairo_move_to(context_, x, y);
    show(context_, layout.get());
    cairo_new_path(context_);
  }
  return mm_of(height);
}

void Canvas::symbol(Verdict verdict, double x, double y, double size, Colour ink) {
  const double h = 0.5 * size;
  const double width = std::max(0.16 * size, 0.2);
  cairo_save(context_);
  cairo_set_line_cap(context_, CAIRO_LINE_CAP_ROUND);
  cairo_set_line_join(context_, CAIRO_LINE_JOIN_ROUND);
  set(ink);
  cairo_set_line_width(context_, width);
  switch (verdict) {
    case Verdict::pass:
      cairo_move_to(context_, x - 0.7 * h, y + 0.05 * h);
      cairo_line_to(context_, x - 0.2 * h, y + 0.6 * h);
      cairo_line_to(context_, x + 0.75 * h, y - 0.65 * h);
      break;
    case Verdict::fail:
      cairo_move_to(context_, x - 0.65 * h, y - 0.65 * h);
      cairo_line_to(context_, x + 0.65 * h, y + 0.65 * h);
      cairo_move_to(context_, x - 0.65 * h, y + 0.65 * h);
      cairo_line_to(context_, x + 0.65 * h, y - 0.65 * h);
      break;
    case Verdict::indeterminate: {
      // Three quarters of a ring, a stem and a dot.
      cairo_new_path(context_);
      cairo_arc(context_, x, y - 0.35 * h, 0.42 * h, -std::numbers::pi, 0.5 * std::numbers::pi);
      cairo_line_to(context_, x, y + 0.3 * h);
      cairo_stroke(context_);
      cairo_arc(context_, x, y + 0.75 * h, 0.6 * width, 0.0, 2.0 * std::numbers::pi);
      cairo_fill(context_);
      break;
    }
    case Verdict::not_measured:
    case Verdict::aborted:
      cairo_new_path(context_);
      cairo_arc(context_, x, y, 0.6 * h, 0.0, 2.0 * std::numbers::pi);
      cairo_new_sub_path(context_);
      cairo_move_to(context_, x - 0.75 * h, y + 0.75 * h);
      cairo_line_to(context_, x + 0.75 * h, y - 0.75 * h);
      break;
    case Verdict::none:
      cairo_move_to(context_, x - 0.4 * h, y);
      cairo_line_to(context_, x + 0.4 * h, y);
      break;
  }
  cairo_stroke(context_);
  cairo_restore(context_);
}

void Canvas::cells(double x, double y, double width, double height, std::size_t columns, std::size_t rows,
                   std::span<const std::uint32_t> argb) {
  cairo_surface_t* image =
      cairo_image_surface_create(CAIRO_FORMAT_ARGB32, static_cast<int>(columns), static_cast<int>(rows));
  cairo_surface_flush(image);
  const auto stride = static_cast<std::size_t>(cairo_image_surface_get_stride(image));
  unsigned char* bytes = cairo_image_surface_get_data(image);
  if (bytes != nullptr) {
    for (std::size_t row = 0; row < rows; ++row)
      std::memcpy(bytes + row * stride, argb.data() + (rows - 1 - row) * columns, columns * sizeof(std::uint32_t));
    cairo_surface_mark_dirty(image);
    cairo_save(context_);
    cairo_translate(context_, x, y);
    cairo_scale(context_, width / static_cast<double>(columns), height / static_cast<double>(rows));
    cairo_set_source_surface(context_, image, 0.0, 0.0);
    cairo_pattern_set_filter(cairo_get_source(context_), CAIRO_FILTER_NEAREST);
    cairo_paint(context_);
    cairo_restore(context_);
  }
  cairo_surface_destroy(image);
}

void Canvas::move_origin(double x, double y) {
  cairo_translate(context_, x, y);
}

}  // namespace slabd::report
