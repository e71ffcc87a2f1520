// SPDX-License-Identifier: Apache-2.0
#include "daemon/station/pose_gate.h"

#include <algorithm>

#include "base/rules.h"

namespace slabd::daemon {
namespace {

bool wrong_frame(const PoseSample& sample, const PoseSettings& settings) {
  return sample.base_id != settings.base_id || sample.tool_id != settings.tool_id;
}

/// True if the sender's numbers do not continue from `before`: samples were lost, repeated or re-ordered, or the sender
/// restarted. If a sender leaves seq at 0, only its clock is checked.
bool breaks_run(const PoseSample& before, const PoseSample& sample, const PoseSettings& settings) {
  const bool counts = before.seq != 0 || sample.seq != 0;
  // Unsigned, because the numbers are external and may have any value.
  const bool next = static_cast<std::uint32_t>(sample.seq) - static_cast<std::uint32_t>(before.seq) == 1U;
  const std::uint64_t step_us =
      static_cast<std::uint64_t>(sample.utime_us) - static_cast<std::uint64_t>(before.utime_us);
  return (counts && !next) || step_us == 0 || step_us > static_cast<std::uint64_t>(settings.gap_us);
}

/// slabd's clock minus the sender's, plus the sample's transport time; the smallest value of many samples is the best.
/// Modulo 2^64, because the numbers are external.
std::uint64_t clocks_apart_us(const PoseSample& sample) {
  return static_cast<std::uint64_t>(sample.arrival_ns / kNsPerUs) - static_cast<std::uint64_t>(sample.utime_us);
}
std::uint64_t less_apart_us(std::uint64_t a, std::uint64_t b) {
  return b - a > std::uint64_t{INT64_MAX} ? b : a;
}

}  // namespace

void PoseGate::Slice::add(const PoseSample& sample, std::uint64_t sample_clocks_apart_us) {
  const Pose& pose = sample.T_base_flange;
  if (samples == 0) {
    first = pose;
    arrival_ns = sample.arrival_ns;
    clocks_apart_us = sample_clocks_apart_us;
  } else {
    away_rad = std::max(away_rad, angle_between_rad(first.rotation, pose.rotation));
    clocks_apart_us = less_apart_us(clocks_apart_us, sample_clocks_apart_us);
  }
  const Vec3 offset_mm = pose.translation_mm - first.translation_mm;
  offset_sum_mm += offset_mm;
  offset_low_mm = offset_low_mm.cwiseMin(offset_mm);
  offset_high_mm = offset_high_mm.cwiseMax(offset_mm);
  const auto& q = pose.rotation.coeffs();
  quat_sum += q.dot(first.rotation.coeffs()) < 0.0 ? Quat::Coefficients(-q) : q;
  estop = estop || sample.estop;
  not_stopped = not_stopped || !sample.stopped;
  ++samples;
}

/// Mean and spread of the slices [first, last]. Translations are summed relative to the first pose, quaternions get its
/// sign before they are averaged: exact enough for poses that differ by microns. The spread of rotations is an upper
/// bound: within a slice the largest angle is added to that of the slice's first pose.
PoseMean PoseGate::mean_of_newest(std::size_t slices) const {
  const Pose& origin = slice(slices - 1).first;
  Vec3 sum = Vec3::Zero();
  Vec3 low = Vec3::Zero();
  Vec3 high = Vec3::Zero();
  QuatSum quat_sum = QuatSum::Zero();
  PoseMean mean;
  for (std::size_t back = slices; back-- > 0;) {
    const Slice& part = slice(back);
    const Vec3 offset = part.first.translation_mm - origin.translation_mm;
    sum += part.samples * offset + part.offset_sum_mm;
    low = low.cwiseMin(offset + part.offset_low_mm);
    high = high.cwiseMax(offset + part.offset_high_mm);
    const double side = part.first.rotation.coeffs().dot(origin.rotation.coeffs()) < 0.0 ? -1.0 : 1.0;
    quat_sum += side * part.quat_sum;
    mean.samples += part.samples;
  }
  mean.T_base_flange.translation_mm = origin.translation_mm + sum / mean.samples;
  mean.T_base_flange.rotation.coeffs() = quat_sum.normalized();
  mean.spread_mm = (high - low).maxCoeff();
  for (std::size_t back = 0; back < slices; ++back) {
    const double away_rad = angle_between_rad(mean.T_base_flange.rotation, slice(back).first.rotation);
    mean.spread_rad = std::max(mean.spread_rad, 2.0 * (away_rad + slice(back).away_rad));
  }
  return mean;
}

void PoseGate::add(const PoseSample& sample) {
  if (slices_ != 0) {
    // A pose in a wrong frame is not part of a run.
    if (breaks_run(newest_, sample, settings_) || wrong_frame(sample, settings_) || wrong_frame(newest_, settings_))
      slices_ = 0;
    // The sender may be another bridge that does not support the flag; standing still is required in any case.
    if (sample.arrival_ns - newest_.arrival_ns >= kForget_ns) stopped_flag_used_ = false;
  }
  if (slices_ == 0 || sample.arrival_ns - slice(0).arrival_ns >= kSlice_ns) {
    newest_place_ = (newest_place_ + 1) % ring_.size();
    ring_[newest_place_] = {};
    slices_ = std::min(slices_ + 1, ring_.size());
  }
  ring_[newest_place_].add(sample, clocks_apart_us(sample));
  newest_ = sample;
  stopped_flag_used_ = stopped_flag_used_ || sample.stopped;
  watch(sample);
}

Code PoseGate::link(std::int64_t now_ns) const {
  if (slices_ == 0) return Code::no_pose;
  if (now_ns - newest_.arrival_ns > settings_.stale_ns) return Code::pose_stale;
  return wrong_frame(newest_, settings_) ? Code::wrong_frame : Code::ok;
}

bool PoseGate::lacks_stopped() const {
  return stopped_flag_used_ && !newest_.stopped;
}

Code PoseGate::settled(std::int64_t now_ns, PoseMean& mean) const {
  if (const Code code = link(now_ns); code != Code::ok) return code;
  const std::int64_t span_ns = settings_.window_ns + settings_.dwell_ns;
  // Window and dwell are one run of samples within the limits: standing still for their total time.
  std::size_t slices = 0;
  std::int64_t samples = 0;
  bool covered = false;
  while (slices < slices_ && !covered) {
    const Slice& part = slice(slices++);
    samples += part.samples;
    covered = newest_.arrival_ns - part.arrival_ns >= span_ns && samples >= settings_.samples_min;
  }
  if (!covered) return Code::not_settled;
  for (std::size_t back = 0; back < slices; ++back)
    if (slice(back).estop || (stopped_flag_used_ && slice(back).not_stopped)) return Code::not_settled;
  const PoseMean candidate = mean_of_newest(slices);
  if (candidate.spread_mm > settings_.settled_mm || candidate.spread_rad > settings_.settled_rad)
    return Code::not_settled;
  mean = candidate;
  return Code::ok;
}

void PoseGate::begin_exposure(const Pose& start) {
  exposure_ = {};
  exposure_.start = start;
  exposure_.verdict = Code::ok;
  exposure_.stopped_flag_used = stopped_flag_used_;
  if (slices_ == 0) return;
  exposure_.newest_utime_us = newest_.utime_us;
  exposure_.clocks_apart_us = clocks_apart_us(newest_);
  for (std::size_t back = 0; back < slices_; ++back)
    exposure_.clocks_apart_us = less_apart_us(exposure_.clocks_apart_us, slice(back).clocks_apart_us);
}

void PoseGate::watch(const PoseSample& sample) {
  Exposure& x = exposure_;
  if (x.verdict != Code::ok) return;
  // Only samples that the sender made later than all known ones show the robot's present position; repeated or late
  // samples do not count. After a long gap the position is unknown. Unsigned, because the numbers are external.
  const std::uint64_t step_us =
      static_cast<std::uint64_t>(sample.utime_us) - static_cast<std::uint64_t>(x.newest_utime_us);
  if (step_us == 0 || step_us > std::uint64_t{INT64_MAX}) return;
  x.newest_utime_us = sample.utime_us;
  x.clocks_apart_us = less_apart_us(x.clocks_apart_us, clocks_apart_us(sample));
  if (step_us > static_cast<std::uint64_t>(settings_.gap_us)) {
    x.verdict = Code::pose_stale;
    return;
  }
  x.stopped_flag_used = x.stopped_flag_used || sample.stopped;
  const Vec3 offset_mm = sample.T_base_flange.translation_mm - x.start.translation_mm;
  const double away_rad = angle_between_rad(sample.T_base_flange.rotation, x.start.rotation);
  if (wrong_frame(sample, settings_)) {
    x.verdict = Code::wrong_frame;
  } else if (offset_mm.norm() > settings_.moved_mm || away_rad > settings_.moved_rad ||
             (x.stopped_flag_used && !sample.stopped)) {
    x.verdict = Code::moved_during_scan;
  }
  ++x.samples;
  x.offset_sum_mm += offset_mm;
  x.offset_low_mm = x.offset_low_mm.cwiseMin(offset_mm);
  x.offset_high_mm = x.offset_high_mm.cwiseMax(offset_mm);
  x.away_rad = std::max(x.away_rad, away_rad);
  const auto& q = sample.T_base_flange.rotation.coeffs();
  x.quat_sum += q.dot(x.start.rotation.coeffs()) < 0.0 ? Quat::Coefficients(-q) : q;
}

Code PoseGate::held_still(std::int64_t to_ns, PoseMean& mean) const {
  const Exposure& x = exposure_;
  if (holds(Rule::robot_still) && x.verdict != Code::ok) return x.verdict;
  if (x.samples == 0) return Code::pose_stale;
  // The time of sending counts, not of arrival: a sample that was under way when the exposure ended does not cover the
  // end.
  const std::uint64_t sent_us = static_cast<std::uint64_t>(x.newest_utime_us) + x.clocks_apart_us;
  const std::uint64_t after_us = sent_us - static_cast<std::uint64_t>(to_ns / kNsPerUs);
  if (after_us == 0 || after_us > std::uint64_t{INT64_MAX}) return Code::pose_stale;
  mean.samples = x.samples;
  mean.T_base_flange.translation_mm = x.start.translation_mm + x.offset_sum_mm / x.samples;
  mean.T_base_flange.rotation.coeffs() = x.quat_sum.normalized();
  mean.spread_mm = (x.offset_high_mm - x.offset_low_mm).maxCoeff();
  mean.spread_rad = 2.0 * x.away_rad;
  return Code::ok;
}

}  // namespace slabd::daemon
