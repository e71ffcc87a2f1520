// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <string_view>

#include "report/canvas.h"

/// A frame with two scales for the charts of studies.
namespace slabd::cli::study {

inline constexpr report::Colour kChartInk{0.12, 0.25, 0.42};
inline constexpr report::Colour kChartLimit{0.62, 0.05, 0.10};

class Chart {
 public:
  Chart(double left_mm, double top_mm, double width_mm, double height_mm)
      : left_(left_mm), top_(top_mm), width_(width_mm), height_(height_mm) {}

  /// Extends the scale to include this value; NaN changes nothing.
  void include_x(double x);
  void include_y(double y);
  /// Adds a margin on all sides; call it once, after all values are included.
  void settle();

  [[nodiscard]] double x(double value) const { return left_ + width_ * (value - x_low_) / (x_high_ - x_low_); }
  [[nodiscard]] double y(double value) const { return top_ + height_ * (y_high_ - value) / (y_high_ - y_low_); }

  void frame(report::Canvas& canvas) const;
  /// Draws five figures on each scale; none on x if `digits_x` is negative.
  void scales(report::Canvas& canvas, int digits_x, int digits_y) const;
  /// Draws a label below the frame at x.
  void tick_x(report::Canvas& canvas, double at, std::string_view text) const;
  /// Draws a level line across the frame with a label at the right end.
  void level(report::Canvas& canvas, double at, std::string_view label, report::Colour colour, bool dashed) const;
  /// Draws a straight line, clipped at the frame.
  void line(report::Canvas& canvas, double slope, double intercept, report::Colour colour, bool dashed) const;
  void point(report::Canvas& canvas, double at_x, double at_y, double radius, report::Colour colour) const;

 private:
  double left_, top_, width_, height_;
  double x_low_ = 1.0, x_high_ = -1.0;
  double y_low_ = 1.0, y_high_ = -1.0;
};

}  // namespace slabd::cli::study
