// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>

#include "base/items.h"

using cairo_t = struct _cairo;

/// Drawing operations of a report: millimetres, x to the right, y down, the same code for PDF, SVG and PNG.
namespace slabd::report {

struct Colour {
  double r = 0.0;
  double g = 0.0;
  double b = 0.0;
};
inline constexpr Colour kBlack{0.0, 0.0, 0.0};
inline constexpr Colour kWhite{1.0, 1.0, 1.0};
inline constexpr Colour kGrey{0.35, 0.35, 0.35};
inline constexpr Colour kPaleGrey{0.82, 0.82, 0.82};

enum class Anchor : std::uint8_t { left, centre, right };

struct TextStyle {
  double size_pt = 8.0;
  bool bold = false;
  Colour colour = kBlack;
  Anchor anchor = Anchor::left;
};

/// Appearance of a verdict. Verdicts differ in symbol, word, colour, and in lightness alone for a grey print.
struct VerdictLook {
  Colour fill;
  Colour ink;
};
[[nodiscard]] VerdictLook look_of(Verdict verdict);

/// Colour of `share` (0 lowest, 1 highest) on a perceptually uniform scale of increasing lightness (viridis, CC0): a
/// grey print keeps the order.
[[nodiscard]] Colour scale_colour(double share);

/// Draws on one page of a Cairo context that the caller owns. Not thread-safe.
class Canvas {
 public:
  explicit Canvas(cairo_t* context) : context_(context) {}

  void line(double x0, double y0, double x1, double y1, double width = 0.2, Colour colour = kBlack,
            bool dashed = false);
  void rectangle(double x, double y, double width, double height, std::optional<Colour> fill,
                 std::optional<Colour> stroke = std::nullopt, double stroke_width = 0.2, bool dashed = false);
  void circle(double x, double y, double radius, std::optional<Colour> fill,
              std::optional<Colour> stroke = std::nullopt, double stroke_width = 0.2);
  /// Diagonal hatching, which marks an area without data.
  void hatch(double x, double y, double width, double height);
  /// One line; y is its baseline.
  void text(double x, double y, std::string_view text, const TextStyle& style);
  /// One line that rises by 45 degrees, centred at (x, y).
  void slanted_text(double x, double y, std::string_view text, const TextStyle& style);
  [[nodiscard]] double text_width(std::string_view text, const TextStyle& style);
  /// Breaks the text into lines of `width`; y is the top. Returns the height; draws nothing if `measure_only`. Lines
  /// that do not fit into `height_max` are cut with an ellipsis; 0 means unlimited.
  double paragraph(double x, double y, double width, std::string_view text, const TextStyle& style,
                   bool measure_only = false, double height_max = 0.0);
  /// Draws the verdict's symbol in a square of `size` around (x, y).
  void symbol(Verdict verdict, double x, double y, double size, Colour ink);
  /// Cells row by row, the first row at the bottom; alpha 0 is transparent.
  void cells(double x, double y, double width, double height, std::size_t columns, std::size_t rows,
             std::span<const std::uint32_t> argb);
  void move_origin(double x, double y);

 private:
  void set(Colour colour);
  cairo_t* context_;
};

}  // namespace slabd::report
