// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <span>
#include <string_view>

#include "base/base.h"

/// Decides from repeated views of a fixed ball whether a scanner has warmed up.
///
/// Problem: a scanner that was just switched on grows and bends for an hour, and no timer knows its room, its model or
/// how long it was off. Idea: the slopes of the ball's centre and radius over time are the drift itself. A scanner is
/// stable if the slopes, with their own uncertainty, are below limits. Few or noisy views make the uncertainty large,
/// so that they never make a scanner stable.
///
/// The drift of a scanner that warms up decays. Its slope over the past window is therefore larger than the drift of
/// the next hour, and a limit of the slope is also a limit of that drift.
namespace slabd::calib {

/// Allowed values of WarmUpSettings::views_min. Slope and scatter need more than three.
inline constexpr int kWarmUpViewsLeast = 4;
inline constexpr int kWarmUpViewsMost = 1'000;

struct WarmUpSettings {
  int views_min = 6;
  double window_s = 600.0;  ///< the views must span at least this time
  /// Limits of the drift. A drift that decays within an hour moves the ball further by less than its slope times an
  /// hour. The defaults leave a fifth of the usual limit of the monitor ball (0.1 mm). A tenth needs twice the time
  /// with 1 um of noise.
  double centre_um_per_h = 20.0;
  double radius_um_per_h = 20.0;
};

/// One view of the ball. The robot stands at the same pose in all of them.
struct WarmUpView {
  double time_s = 0.0;                        ///< of the exposure, from any origin
  Vec3 centre_mm = Vec3::Constant(kNoValue);  ///< in one frame that does not move, such as the robot's base
  double radius_mm = kNoValue;                ///< from a fit with free radius
};

enum class WarmUpState : std::uint8_t {
  few_views,   ///< fewer than views_min
  short_time,  ///< they span less than the window
  drifting,    ///< a slope alone is beyond its limit
  uncertain,   ///< no slope is, but its uncertainty reaches beyond: more views are needed
  stable,
};
inline constexpr std::size_t kWarmUpStates = 5;
/// "few_views", "short_time", "drifting", "uncertain", "stable".
[[nodiscard]] std::string_view name(WarmUpState state);

/// Slopes over the newest views. The figures are NaN for few_views and short_time.
struct WarmUpReport {
  WarmUpState state = WarmUpState::few_views;
  std::size_t views = 0;  ///< newest views that the slopes are of; before that: all
  double window_s = 0.0;  ///< time that they span
  Vec3 centre_um_per_h = Vec3::Constant(kNoValue);
  double centre_speed_um_per_h = kNoValue;  ///< magnitude of it
  double centre_sigma_um_per_h = kNoValue;  ///< its standard error: root sum of squares of the three
  double radius_um_per_h = kNoValue;
  double radius_sigma_um_per_h = kNoValue;
  /// Factor of the standard error: the 97.5 % quantile of Student's t for views - 2, at least 2. Six views scatter by
  /// chance so little that a factor of 2 would accept four times as many drifts as it seems.
  double factor = kNoValue;
};

/// Examines the views, ascending in time. The slopes are least-squares fits over the newest views that are at least
/// `views_min` and span at least `window_s`. The window that is nearest to stable counts, of all such windows: a longer
/// one averages more noise, and only contains more of a decaying drift. config: a view without numbers, or times that
/// do not ascend; the text has the number of the view.
[[nodiscard]] Result<WarmUpReport> examine_warm_up(std::span<const WarmUpView> views, const WarmUpSettings& settings);

}  // namespace slabd::calib
