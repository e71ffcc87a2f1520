// SPDX-License-Identifier: Apache-2.0
//
// Problem: a view for a calibration is useless if the arm still swung, if poses were lost, or if the arriving poses are
// old. Idea: one run of poses starts at the request and ends only with a violation. The reported mean and spread are
// those of the whole run, including the scan. Invariant: every pose of the run is within the guard of every other one.
#include "daemon/station/still_watch.h"

#include <algorithm>
#include <cmath>

namespace slabd::daemon {
namespace {

constexpr std::int64_t kSecond_ns = kNsPerS;
/// Allowed drift between the sender's and slabd's clock over a run, for the turn of the loop and a busy computer. A
/// larger drift means that a bridge sends a queue of old poses.
constexpr std::int64_t kClockSlack_us = 250'000;

Vec3 turned_by(const Quat& from, const Quat& to) {
  Quat d = to * from.conjugate();
  if (d.w() < 0.0) d.coeffs() = -d.coeffs();
  const double sine = d.vec().norm();
  if (sine < 1e-300) return Vec3::Zero();
  return d.vec() * (2.0 * std::atan2(sine, d.w()) / sine);
}

/// The axis with the largest motion, and that motion.
FixedString<240> moved_text(const PoseRange& range, const CaptureGuard& guard) {
  Eigen::Index axis_mm = 0;
  Eigen::Index axis_rad = 0;
  const double moved_mm = (range.high_mm - range.low_mm).maxCoeff(&axis_mm);
  const double turned_rad = (range.high_rad - range.low_rad).maxCoeff(&axis_rad);
  FixedString<240> text;
  text.printf("moved %.3f mm along base %c and turned %.4f deg about base %c, allowed are %.3f mm and %.4f deg",
              moved_mm, "xyz"[axis_mm], deg_from_rad(turned_rad), "xyz"[axis_rad], guard.stable_mm,
              deg_from_rad(guard.stable_rad));
  return text;
}

}  // namespace

void StillWatch::begin() {
  const CaptureGuard guard = guard_;
  const PoseSettings settings = settings_;
  *this = StillWatch(guard, settings);
}

void StillWatch::restart(const PoseSample& sample) {
  samples_ = 1;
  first_ = sample;
  newest_ = sample;
  range_.clear();
  sum_mm_.setZero();
  sum_rad_.setZero();
}

void StillWatch::watch_second(const PoseSample& sample) {
  if (any_ && sample.arrival_ns - second_start_.arrival_ns < kSecond_ns) {
    this_second_.add(sample.T_base_flange.translation_mm - second_start_.T_base_flange.translation_mm,
                     turned_by(second_start_.T_base_flange.rotation, sample.T_base_flange.rotation));
    return;
  }
  if (any_) {
    last_second_ = this_second_;
    recent_whole_ = true;
  }
  second_start_ = sample;
  this_second_.clear();
}

StillWatch::Break StillWatch::broken_by(const PoseSample& sample) const {
  if (sample.base_id != settings_.base_id || sample.tool_id != settings_.tool_id) return Break::wrong_frame;
  if (sample.estop) return Break::estop;
  if (stopped_flag_used_ && !sample.stopped) return Break::not_stopped;
  if (samples_ == 0) return Break::none;
  const bool counts = newest_.seq != 0 || sample.seq != 0;
  // Unsigned, because the numbers are external and may have any value.
  const bool next = static_cast<std::uint32_t>(sample.seq) - static_cast<std::uint32_t>(newest_.seq) == 1U;
  const auto since = [](std::int64_t from, std::int64_t to) {
    return static_cast<std::uint64_t>(to) - static_cast<std::uint64_t>(from);
  };
  const std::uint64_t step_us = since(newest_.utime_us, sample.utime_us);
  if ((counts && !next) || step_us == 0 || step_us > static_cast<std::uint64_t>(settings_.gap_us)) return Break::gap;
  const auto sent_us = static_cast<std::int64_t>(since(first_.utime_us, sample.utime_us));
  const std::int64_t arrived_us = (sample.arrival_ns - first_.arrival_ns) / kNsPerUs;
  if (std::abs(sent_us - arrived_us) > kClockSlack_us) return Break::clock;
  return Break::none;
}

void StillWatch::add(const PoseSample& sample) {
  stopped_flag_used_ = stopped_flag_used_ || sample.stopped;
  Broken broken{broken_by(sample), {}, newest_.seq, sample.seq, sample.base_id, sample.tool_id};
  watch_second(sample);
  any_ = true;
  if (marked_break_.by == Break::moved && broken.by != Break::wrong_frame) follow_marked(sample);
  if (broken.by == Break::none && samples_ != 0) {
    const Vec3 off_mm = sample.T_base_flange.translation_mm - first_.T_base_flange.translation_mm;
    const Vec3 off_rad = turned_by(first_.T_base_flange.rotation, sample.T_base_flange.rotation);
    PoseRange range = range_;
    range.add(off_mm, off_rad);
    if (range.mm() > guard_.stable_mm || range.rad() > guard_.stable_rad) {
      broken.by = Break::moved;
      broken.range = range;
    } else {
      range_ = range;
      sum_mm_ += off_mm;
      sum_rad_ += off_rad;
      newest_ = sample;
      ++samples_;
      return;
    }
  }
  if (broken.by != Break::none) {
    last_break_ = broken;
    if (marked_break_.by == Break::none) {
      marked_break_ = broken;
      marked_from_ = first_.T_base_flange;
    }
  }
  restart(sample);
  const bool unusable = broken.by == Break::wrong_frame || broken.by == Break::estop || broken.by == Break::not_stopped;
  if (unusable) samples_ = 0;
}

void StillWatch::follow_marked(const PoseSample& sample) {
  marked_break_.range.add(sample.T_base_flange.translation_mm - marked_from_.translation_mm,
                          turned_by(marked_from_.rotation, sample.T_base_flange.rotation));
}

bool StillWatch::settled() const {
  return samples_ >= static_cast<std::uint32_t>(guard_.samples_min) &&
         newest_.arrival_ns - first_.arrival_ns >= guard_.stable_ns;
}

Pose StillWatch::mean() const {
  if (samples_ == 0) return Pose::identity();
  const Vec3 turn = sum_rad_ / samples_;
  const double angle = turn.norm();
  Pose mean;
  mean.translation_mm = first_.T_base_flange.translation_mm + sum_mm_ / samples_;
  mean.rotation = first_.T_base_flange.rotation;
  if (angle > 0.0) mean.rotation = (Quat(Eigen::AngleAxisd(angle, turn / angle)) * mean.rotation).normalized();
  return mean;
}

FixedString<240> StillWatch::describe(const Broken& broken) const {
  FixedString<240> text;
  switch (broken.by) {
    case Break::none: text.printf("in the last second it %s", moved_text(recent(), guard_).c_str()); break;
    case Break::moved: text.printf("it %s", moved_text(broken.range, guard_).c_str()); break;
    case Break::gap:
      text.printf(
          "poses were lost or arrived twice: number %d was followed by %d, and their times must be at most %lld ms "
          "apart",
          broken.gap_from, broken.gap_to, static_cast<long long>(settings_.gap_us / 1000));
      break;
    case Break::clock:
      text.printf("poses arrive late: the sender's clock and their arrival differ by more and more");
      break;
    case Break::estop: text.printf("the robot reports an emergency stop"); break;
    case Break::not_stopped: text.printf("the robot reports that it is not stopped"); break;
    case Break::wrong_frame:
      text.printf("base %d and tool %d are active, the flange in the robot root are base %d and tool %d",
                  broken.base_id, broken.tool_id, settings_.base_id, settings_.tool_id);
      break;
  }
  return text;
}

}  // namespace slabd::daemon
