// SPDX-License-Identifier: Apache-2.0
#include "calib/warm_up.h"

#include <algorithm>
#include <array>
#include <cmath>

namespace slabd::calib {
namespace {

constexpr std::array<std::string_view, kWarmUpStates> kStates = {"few_views", "short_time", "drifting", "uncertain",
                                                                 "stable"};
constexpr double kUmPerHour = 1e3 * 3'600.0;  ///< of one mm/s

struct Slope {
  double per_s = kNoValue;
  double sigma_per_s = kNoValue;
};

/// Least-squares line through value(i) over time. The residuals have n - 2 degrees of freedom.
template <typename Value>
Slope slope_of(std::span<const WarmUpView> views, Value value) {
  const auto n = static_cast<double>(views.size());
  double time = 0.0;
  double mean = 0.0;
  // About the first view, because times may be large numbers.
  const double origin_s = views.front().time_s;
  for (const WarmUpView& view : views) {
    time += view.time_s - origin_s;
    mean += value(view);
  }
  time /= n;
  mean /= n;
  double tt = 0.0;
  double tv = 0.0;
  double vv = 0.0;
  for (const WarmUpView& view : views) {
    const double t = view.time_s - origin_s - time;
    const double v = value(view) - mean;
    tt += t * t;
    tv += t * v;
    vv += v * v;
  }
  Slope slope;
  slope.per_s = tv / tt;
  slope.sigma_per_s = std::sqrt(std::max(0.0, vv - slope.per_s * tv) / (n - 2.0) / tt);
  return slope;
}

/// 97.5 % quantile of Student's t (Cornish and Fisher 1937; to 0.3 % from four degrees of freedom on), at least 2.
double factor_for(std::size_t views) {
  const double f = static_cast<double>(views) - 2.0;
  return std::max(2.0, 1.960 + 2.372 / f + 2.823 / (f * f) + 2.556 / (f * f * f));
}

/// Fraction of a limit that a slope and its uncertainty reach.
double reach(double slope, double sigma, double factor, double limit) {
  return (slope + factor * sigma) / limit;
}

WarmUpReport slopes_of(std::span<const WarmUpView> views) {
  WarmUpReport report;
  report.views = views.size();
  report.window_s = views.back().time_s - views.front().time_s;
  report.factor = factor_for(views.size());
  double squares = 0.0;
  for (int axis = 0; axis < 3; ++axis) {
    const Slope slope = slope_of(views, [axis](const WarmUpView& v) { return v.centre_mm[axis]; });
    report.centre_um_per_h[axis] = kUmPerHour * slope.per_s;
    squares += slope.sigma_per_s * slope.sigma_per_s;
  }
  report.centre_speed_um_per_h = report.centre_um_per_h.norm();
  report.centre_sigma_um_per_h = kUmPerHour * std::sqrt(squares);
  const Slope radius = slope_of(views, [](const WarmUpView& v) { return v.radius_mm; });
  report.radius_um_per_h = kUmPerHour * radius.per_s;
  report.radius_sigma_um_per_h = kUmPerHour * radius.sigma_per_s;
  return report;
}

}  // namespace

std::string_view name(WarmUpState state) {
  return kStates.at(static_cast<std::size_t>(state));
}

Result<WarmUpReport> examine_warm_up(std::span<const WarmUpView> views, const WarmUpSettings& settings) {
  for (std::size_t i = 0; i < views.size(); ++i) {
    const WarmUpView& view = views[i];
    if (!std::isfinite(view.time_s) || !view.centre_mm.allFinite() || !std::isfinite(view.radius_mm))
      return error(Code::config, "view %zu: time, centre and radius must be finite numbers", i + 1);
    if (i > 0 && view.time_s <= views[i - 1].time_s)
      return error(Code::config, "view %zu: its time %.3f s is not after that of the view before, %.3f s", i + 1,
                   view.time_s, views[i - 1].time_s);
  }
  WarmUpReport report;
  report.views = views.size();
  if (!views.empty()) report.window_s = views.back().time_s - views.front().time_s;
  const auto least = static_cast<std::size_t>(std::max(settings.views_min, kWarmUpViewsLeast));
  if (views.size() < least) return report;
  report.state = WarmUpState::short_time;
  if (report.window_s < settings.window_s) return report;

  const auto reach_of = [&settings](const WarmUpReport& r) {
    return std::max(reach(r.centre_speed_um_per_h, r.centre_sigma_um_per_h, r.factor, settings.centre_um_per_h),
                    reach(std::abs(r.radius_um_per_h), r.radius_sigma_um_per_h, r.factor, settings.radius_um_per_h));
  };
  double nearest = kNoValue;
  for (std::size_t first = views.size() - least + 1; first-- > 0;) {
    const std::span<const WarmUpView> newest = views.subspan(first);
    if (newest.back().time_s - newest.front().time_s < settings.window_s) continue;
    const WarmUpReport one = slopes_of(newest);
    const double reached = reach_of(one);
    if (reached >= nearest) continue;  // false for the first, which is compared with NaN
    nearest = reached;
    report = one;
  }
  const bool beyond = report.centre_speed_um_per_h >= settings.centre_um_per_h ||
                      std::abs(report.radius_um_per_h) >= settings.radius_um_per_h;
  report.state = nearest < 1.0 ? WarmUpState::stable : beyond ? WarmUpState::drifting : WarmUpState::uncertain;
  return report;
}

}  // namespace slabd::calib
