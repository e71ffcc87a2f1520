// SPDX-License-Identifier: Apache-2.0
#include "algo/features/jaw.h"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <limits>

#include "algo/features/plane_fit.h"
#include "algo/median.h"

namespace slabd::algo {

namespace {

constexpr std::size_t kSteps = FaceProfile::kSteps;
/// Maximum number of a step's points for its median, and the minimum for it to count.
constexpr std::size_t kStepSample = 512;
constexpr std::size_t kStepPointsMin = 12;
constexpr double kMedianSigma = 1.2533;  ///< standard error of a median over that of a mean
/// Part that is flat on any jaw: from this far above its foot to this far below its top, or these shares of a low jaw.
constexpr double kFillet_mm = 10.0;
constexpr double kFilletShare = 0.4;
constexpr double kRounding_mm = 6.0;
constexpr double kRoundingShare = 0.25;
/// A step is on the line within this, plus this many of its own standard deviations.
constexpr double kOnLine_mm = 0.006;
constexpr double kOnLineSigmas = 3.5;
/// ... or within the crests of the waves in its middle, in standard deviations: a sine has 1.4.
constexpr double kWaveCrest = 1.6;
/// ... but at most this: a middle with more scatter is bent, not waved.
constexpr double kWaveMost_mm = 0.03;
/// Extra length for the tail of a fillet or of the light in the corner, which is too low to be detected.
constexpr double kTail_mm = 1.0;
/// Correlation length of a profile's residuals, in steps.
constexpr double kAlikeSteps = 2.0;
/// A jaw is bent if a straight piece of this many steps has another slope than its flat strip. The difference must
/// exceed kBend_rad (0.25 degrees), this many standard deviations of its slope, and this many times the effect of the
/// profile's waves.
constexpr std::size_t kPieceSteps = 7;
constexpr double kBend_rad = 0.0044;
constexpr double kBendSigmas = 3.0;
constexpr double kBendWaves = 2.0;
/// A piece is straight if its sagitta is less than this share of its rise relative to the strip. For a fillet the share
/// is a quarter, for light that decays over 2 mm a third.
constexpr double kStraightShare = 0.15;

/// The largest slope of a straight line through a sine: 2.6 amplitudes over its length, for a period 1.5 times its
/// length; 1.9 for periods up to its length, as along a whole strip. Increased by half, because grain and waves of the
/// concrete add to the ripple.
constexpr double kRippleCrest = 1.5;
constexpr double kRippleLean = 2.6 * kRippleCrest;
constexpr double kRippleLeanOfStrip = 1.9 * kRippleCrest;

double square(double v) {
  return v * v;
}

/// Straight line through the steps [first, last) of a profile.
struct Line {
  double n = 0.0;
  double middle = 0.0;
  double height = 0.0;
  double slope = 0.0;
  double squares = 0.0;  ///< of the positions about their middle

  Line(const FaceProfile& profile, std::size_t first, std::size_t last) {
    for (std::size_t k = first; k < last; ++k) {
      if (!profile.seen(k)) continue;
      n += 1.0;
      middle += FaceProfile::from_foot_mm(k);
      height += profile.height_mm[k];
    }
    if (n == 0.0) return;
    middle /= n;
    height /= n;
    double product = 0.0;
    for (std::size_t k = first; k < last; ++k) {
      if (!profile.seen(k)) continue;
      const double u = FaceProfile::from_foot_mm(k) - middle;
      squares += u * u;
      product += u * (profile.height_mm[k] - height);
    }
    if (squares > 0.0) slope = product / squares;
  }
  [[nodiscard]] double off(const FaceProfile& profile, std::size_t k) const {
    return profile.height_mm[k] - height - slope * (FaceProfile::from_foot_mm(k) - middle);
  }
  /// Standard deviation of the steps [first, last) about the line, beyond their own; they must be the fitted ones.
  [[nodiscard]] double scatter_mm(const FaceProfile& profile, std::size_t first, std::size_t last) const {
    if (n < 3.0) return 0.0;
    double sum = 0.0;
    for (std::size_t k = first; k < last; ++k)
      if (profile.seen(k)) sum += std::max(square(off(profile, k)) - square(profile.sigma_mm[k]), 0.0);
    return std::sqrt(sum / (n - 2.0));
  }
};

double ripple_lean_rad(double amplitude_mm, std::size_t steps, double factor = kRippleLean) {
  return factor * amplitude_mm / (FaceProfile::kStep_mm * static_cast<double>(std::max<std::size_t>(steps, 1)));
}

/// Largest difference between the slopes of straight pieces of the steps [first, last) and `slope`, if it exceeds
/// `least_rad`; else 0. A fillet and the light in the corner have a slope too, but their effect grows towards the edge,
/// so they are curved.
double bend_of(const FaceProfile& profile, std::size_t first, std::size_t last, double slope, double least_rad) {
  double bend = 0.0;
  for (std::size_t from = first; from + kPieceSteps <= last; ++from) {
    const Line piece(profile, from, from + kPieceSteps);
    if (piece.n < static_cast<double>(kPieceSteps)) continue;
    const double mean_square = piece.squares / piece.n;
    double sigma = 0.0;
    double product = 0.0;
    double squares = 0.0;
    for (std::size_t k = from; k < from + kPieceSteps; ++k) {
      const double u = FaceProfile::from_foot_mm(k) - piece.middle;
      const double bow = u * u - mean_square;
      sigma = std::max(sigma, profile.sigma_mm[k]);
      product += bow * piece.off(profile, k);
      squares += bow * bow;
    }
    const double half = 0.5 * static_cast<double>(kPieceSteps - 1) * FaceProfile::kStep_mm;
    const double sagitta = std::abs(product / squares) * half * half;
    const double other = std::abs(piece.slope - slope);
    if (sagitta < kStraightShare * other * 2.0 * half &&
        other - kBendSigmas * sigma / std::sqrt(piece.squares) > least_rad)
      bend = std::max(bend, other);
  }
  return bend;
}

/// Tilt uncertainty for waves of this variance. Each straight piece of a bent jaw defines its angle as much as the flat
/// strip does, so U extends to the furthest. The waves contain the bend, so the larger value counts.
double form_tilt_rad(const FlatStrip& strip, double wave_mm2) {
  return std::max(std::sqrt(wave_mm2 / strip.lever_mm2), 0.5 * strip.bend_rad);
}

std::size_t step_of(double from_foot_mm) {
  return std::min(static_cast<std::size_t>(std::max(from_foot_mm, 0.0) / FaceProfile::kStep_mm), kSteps - 1);
}

}  // namespace

FlatStrip middle_of(const FaceEdges& edges) {
  const double length = edges.length_mm();
  return {std::min(kFillet_mm, kFilletShare * length), length - std::min(kRounding_mm, kRoundingShare * length), true,
          0.0};
}

FaceProfile profile_of(const ListedPoints& points, const FlatPlane& plane, const FaceEdges& edges) {
  FaceProfile profile;
  const SeatFrame& frame = points.frame;
  const double up = plane.n.dot(frame.up);
  const double by_x = plane.n.dot(frame.along_rail);
  const double by_s = plane.n.dot(frame.along_seat);
  const double offset_mm = plane.distance(frame.origin);
  std::array<std::size_t, kSteps> all{};
  const auto for_each = [&](const auto& use) {
    for (const SeatPoints& run : points.runs)
      for (std::size_t i = 0; i < run.size(); ++i) {
        const double from_foot = std::abs(static_cast<double>(run.s[i]) - edges.foot_s_mm);
        if (from_foot < FaceProfile::kStep_mm * static_cast<double>(kSteps)) use(step_of(from_foot), run, i);
      }
  };
  for_each([&](std::size_t k, const SeatPoints&, std::size_t) { ++all[k]; });
  std::array<std::array<double, kStepSample>, kSteps> heights;
  std::array<std::size_t, kSteps> number{};
  std::array<std::size_t, kSteps> taken{};
  for_each([&](std::size_t k, const SeatPoints& run, std::size_t i) {
    if (number[k]++ % (1 + all[k] / kStepSample) != 0 || taken[k] == kStepSample) return;
    heights[k][taken[k]++] = up * static_cast<double>(run.h[i]) + by_x * static_cast<double>(run.x[i]) +
                             by_s * static_cast<double>(run.s[i]) + offset_mm;
  });
  for (std::size_t k = 0; k < kSteps; ++k) {
    if (taken[k] < kStepPointsMin) continue;
    const std::span<double> own(heights[k].data(), taken[k]);
    profile.height_mm[k] = median_of(own);
    for (double& h : own) h = std::abs(h - profile.height_mm[k]);
    profile.sigma_mm[k] = std::max(kMedianSigma * 1.4826 * median_of(own) / std::sqrt(static_cast<double>(taken[k])),
                                   std::numeric_limits<double>::min());
  }
  return profile;
}

FlatStrip find_flat_strip(const FaceProfile& profile, const FaceEdges& edges, double margin_mm, double ripple_mm) {
  const FlatStrip middle = middle_of(edges);
  const std::size_t lowest = step_of(margin_mm);
  const std::size_t highest = std::min(step_of(edges.length_mm() - margin_mm) + 1, kSteps);
  std::size_t first = std::clamp(step_of(middle.from_mm), lowest, highest);
  std::size_t last = std::clamp(step_of(middle.to_mm), first, highest);
  const double waves_mm =
      std::min(kWaveCrest * Line(profile, first, last).scatter_mm(profile, first, last), kWaveMost_mm);
  // Extends outwards in both directions by turns; each accepted step is added to the line.
  bool down = true;
  bool up = true;
  while (down || up) {
    const Line line(profile, first, last);
    const auto on_line = [&](std::size_t k) {
      if (!profile.seen(k)) return true;
      const double own2 = profile.sigma_mm[k] * profile.sigma_mm[k];
      const double lever = FaceProfile::from_foot_mm(k) - line.middle;
      // The uncertainty of the line, from medians like this one.
      const double line2 = line.n > 2.0 ? own2 * (1.0 / line.n + lever * lever / line.squares) : own2;
      const double ripple = kRippleCrest * ripple_mm + ripple_lean_rad(ripple_mm, last - first) * std::abs(lever);
      return std::abs(line.off(profile, k)) <=
             std::max({kOnLine_mm, waves_mm, ripple}) + kOnLineSigmas * std::sqrt(own2 + line2);
    };
    if (down) {
      down = first > lowest && on_line(first - 1);
      if (down) --first;
    }
    if (up) {
      up = last < highest && on_line(last);
      if (up) ++last;
    }
  }
  FlatStrip strip;
  strip.from_mm = first > lowest ? FaceProfile::kStep_mm * static_cast<double>(first) + kTail_mm : margin_mm;
  strip.to_mm =
      last < highest ? FaceProfile::kStep_mm * static_cast<double>(last) - kTail_mm : edges.length_mm() - margin_mm;
  strip.narrowed = first > lowest || last < highest;

  const std::size_t from = strip.narrowed && first > lowest ? std::min(first + 1, last) : first;
  const std::size_t to = strip.narrowed && last < highest ? std::max(last - 1, from) : last;
  const Line line(profile, from, to);
  if (line.n < 3.0 || !(line.squares > 0.0)) return strip;
  strip.wave_mm2 = kAlikeSteps * square(line.scatter_mm(profile, from, to));
  strip.lever_mm2 = line.squares;
  // For a period too long for the residuals the amplitude is known from the seat, but not the phase.
  const double ripple_rad = ripple_lean_rad(ripple_mm, to - from, kRippleLeanOfStrip) / std::sqrt(2.0);
  strip.wave_mm2 = std::max(strip.wave_mm2, square(ripple_rad) * strip.lever_mm2);
  const double waves_rad = std::sqrt(strip.wave_mm2 / strip.lever_mm2);
  strip.bend_rad =
      bend_of(profile, lowest, highest, line.slope,
              std::max({kBend_rad, kBendWaves * waves_rad, kBendWaves * ripple_lean_rad(ripple_mm, kPieceSteps)}));
  strip.form_tilt_rad = form_tilt_rad(strip, strip.wave_mm2);
  return strip;
}

std::array<double, 2> form_tilts_rad(const FlatStrip& inner, const FlatStrip& outer) {
  if (!(inner.lever_mm2 > 0.0) || !(outer.lever_mm2 > 0.0)) return {inner.form_tilt_rad, outer.form_tilt_rad};
  const double wave_mm2 = 0.5 * (inner.wave_mm2 + outer.wave_mm2);
  return {form_tilt_rad(inner, wave_mm2), form_tilt_rad(outer, wave_mm2)};
}

SeatPoints points_of_strip(const ListedPoints& points, const FaceEdges& edges, const FlatStrip& strip,
                           std::span<float> memory) {
  const double a = edges.s_at(strip.from_mm);
  const double b = edges.s_at(strip.to_mm);
  const auto low = static_cast<float>(std::min(a, b));
  const auto high = static_cast<float>(std::max(a, b));
  const std::size_t room = memory.size() / 3;
  const std::size_t every = 1 + points.size() / (room + 1);
  const std::span<float> x = memory.subspan(0, room);
  const std::span<float> s = memory.subspan(room, room);
  const std::span<float> h = memory.subspan(2 * room, room);
  std::size_t count = 0;
  std::size_t number = 0;
  for (const SeatPoints& run : points.runs)
    for (std::size_t i = 0; i < run.size(); ++i) {
      if (!(run.s[i] >= low && run.s[i] <= high) || number++ % every != 0 || count == room) continue;
      x[count] = run.x[i];
      s[count] = run.s[i];
      h[count++] = run.h[i];
    }
  return {x.first(count), s.first(count), h.first(count)};
}

FaceEdges edges_of_jaw(const BlockModel& model, Face jaw, Face shoulder) {
  const SeatFrame frame = frame_of(model.plane(jaw));
  Mat3 A;
  A.row(0) = Vec3::UnitX();
  A.row(1) = frame.up;
  const auto at_edge_with = [&](Face face) {
    const Plane& plane = model.plane(face);
    A.row(2) = plane.n;
    return frame.in_seat(A.inverse() * Vec3(0.0, model.plane(jaw).d, plane.d))[1];
  };
  return {at_edge_with(Face::seat), at_edge_with(shoulder)};
}

JawFit measure_jaw(const JawTask& task) {
  JawFit jaw;
  PlaneStart start;
  SeatPoints kept;
  const auto fit_strip = [&](const FlatStrip& strip) {
    kept = points_of_strip(task.points, task.edges, strip, task.memory);
    ListedPoints points;
    points.frame = task.points.frame;
    points.runs = std::span(&kept, 1);
    points.count = kept.size();
    return fit_plane_over(points, task.up, task.settings, start);
  };
  jaw.plane = fit_plane_over(task.points, task.up, task.settings, start);
  const bool all_of_it = jaw.plane.ok;
  // A plane that was bent by a large fillet, or refused because of it, does not show the flat part.
  if (const PlaneFit middle = all_of_it ? jaw.plane : fit_strip(middle_of(task.edges)); middle.ok || all_of_it) {
    const FaceProfile profile = profile_of(task.points, {middle.normal, middle.offset_mm}, task.edges);
    jaw.strip = find_flat_strip(profile, task.edges, task.margin_mm, task.ripple_mm);
    if (jaw.strip.narrowed) jaw.plane = fit_strip(jaw.strip);
  }
  const std::size_t offered = jaw.strip.narrowed ? kept.size() : task.points.size();
  if (jaw.plane.ok && share_by_area(start, jaw.plane, task.points.frame, task.raster, task.off, offered) <
                          task.settings.inlier_share_min)
    refuse(jaw.plane, PlaneDoubt::area);
  return jaw;
}

}  // namespace slabd::algo
