// SPDX-License-Identifier: Apache-2.0
#include "cli/study/charts.h"

#include <algorithm>
#include <cmath>

#include "base/items.h"
#include "report/figures.h"

namespace slabd::cli::study {
namespace {

void include(double value, double& low, double& high) {
  if (!has_value(value)) return;
  if (low > high) {
    low = high = value;
  } else {
    low = std::min(low, value);
    high = std::max(high, value);
  }
}

void widen(double& low, double& high) {
  if (low > high) {  // no value was included
    low = 0.0;
    high = 1.0;
  }
  const double margin = std::max(0.06 * (high - low), 1e-6);
  low -= margin;
  high += margin;
}

constexpr double kTextPt = 5.5;
constexpr int kTicks = 4;

}  // namespace

void Chart::include_x(double x) {
  include(x, x_low_, x_high_);
}
void Chart::include_y(double y) {
  include(y, y_low_, y_high_);
}

void Chart::settle() {
  widen(x_low_, x_high_);
  widen(y_low_, y_high_);
}

void Chart::frame(report::Canvas& canvas) const {
  canvas.rectangle(left_, top_, width_, height_, std::nullopt, report::kGrey, 0.15);
}

void Chart::scales(report::Canvas& canvas, int digits_x, int digits_y) const {
  for (int i = 0; i <= kTicks; ++i) {
    const double share = static_cast<double>(i) / kTicks;
    const double y_here = y_low_ + share * (y_high_ - y_low_);
    canvas.text(left_ - 1.0, y(y_here) + 0.8, report::figure(y_here, digits_y),
                {kTextPt, false, report::kGrey, report::Anchor::right});
    if (digits_x < 0) continue;
    const double x_here = x_low_ + share * (x_high_ - x_low_);
    tick_x(canvas, x_here, report::figure(x_here, digits_x));
  }
}

void Chart::tick_x(report::Canvas& canvas, double at, std::string_view text) const {
  canvas.text(x(at), top_ + height_ + 3.0, text, {kTextPt, false, report::kGrey, report::Anchor::centre});
}

void Chart::level(report::Canvas& canvas, double at, std::string_view label, report::Colour colour, bool dashed) const {
  if (!has_value(at) || at < y_low_ || at > y_high_) return;
  canvas.line(left_, y(at), left_ + width_, y(at), 0.25, colour, dashed);
  canvas.text(left_ + width_ + 1.0, y(at) + 0.8, label, {kTextPt, false, colour, report::Anchor::left});
}

void Chart::line(report::Canvas& canvas, double slope, double intercept, report::Colour colour, bool dashed) const {
  double from = x_low_;
  double to = x_high_;
  if (slope != 0.0) {
    const double at_low = (y_low_ - intercept) / slope;
    const double at_high = (y_high_ - intercept) / slope;
    from = std::max(from, std::min(at_low, at_high));
    to = std::min(to, std::max(at_low, at_high));
  }
  if (from < to)
    canvas.line(x(from), y(intercept + slope * from), x(to), y(intercept + slope * to), 0.25, colour, dashed);
}

void Chart::point(report::Canvas& canvas, double at_x, double at_y, double radius, report::Colour colour) const {
  if (has_value(at_x) && has_value(at_y)) canvas.circle(x(at_x), y(at_y), radius, colour);
}

}  // namespace slabd::cli::study
