// SPDX-License-Identifier: Apache-2.0
#include "tests/sim/ports.h"

#include <cmath>
#include <cstring>
#include <slabd/flange_pose_t.hpp>

#include "tests/sim/allocation.h"

namespace slabd::sim {
namespace {

constexpr std::string_view kChannel = "FLANGE_POSE";
constexpr std::size_t kDatagramsWaiting = 200;  ///< capacity of a socket's buffer

template <typename Datagram>
void put_u32(Datagram& out, std::uint32_t value) {
  for (int shift = 24; shift >= 0; shift -= 8) out.bytes[out.size++] = static_cast<std::byte>((value >> shift) & 0xFFU);
}

}  // namespace

// ---- robot poses ---------------------------------------------------------------------------------------------------

void PoseStream::send() {
  Pose pose = robot_.T_base_flange(sent_ns_);
  if (!is_first_) pose = T_robot_base_ * pose;
  flange_pose_t message{};
  message.utime = sent_ns_ / 1000 + 1'790'000'000'000'000;  // the sender's clock
  if (happens(chance_, world_.often(Fault::lcm_old_time, 0.3))) message.utime -= between(chance_, 1'000, 3'600'000'000);
  message.robot_time_us = -1;
  message.seq = ++seq_;
  message.flags = 1;
  for (int i = 0; i < 3; ++i) message.trans[i] = pose.translation_mm[i] / 1000.0;
  const Quat q = pose.rotation;
  message.quat[0] = q.w();
  message.quat[1] = q.x();
  message.quat[2] = q.y();
  message.quat[3] = q.z();

  Datagram bytes;
  put_u32(bytes, 0x4C433032);  // "LC02"
  put_u32(bytes, static_cast<std::uint32_t>(seq_));
  for (const char c : kChannel) bytes.bytes[bytes.size++] = static_cast<std::byte>(c);
  bytes.bytes[bytes.size++] = std::byte{0};
  const std::size_t at = bytes.size;
  const int size = message.getEncodedSize();
  bytes.size += static_cast<std::size_t>(size);
  message.encode(bytes.bytes.data(), static_cast<int>(at), size);

  // A shock of the robot also shakes its cable.
  const bool shaken = robot_.moves(sent_ns_, sent_ns_ + 1);
  if (happens(chance_, shaken && world_.faulty(Fault::lcm_loss) ? 0.95 : world_.often(Fault::lcm_loss, 0.2))) {
    if (shaken && world_.faulty(Fault::lcm_duplicate)) waiting_.push_back(last_);
    return;
  }
  if (happens(chance_, world_.often(Fault::lcm_wrong_fingerprint, shaken ? 1.0 : 0.2)))
    bytes.bytes[at + 3] ^= std::byte{0x40};
  if (happens(chance_, world_.often(Fault::lcm_duplicate, 0.1))) waiting_.push_back(last_.size == 0 ? bytes : last_);
  if (held_back_.size == 0 && happens(chance_, world_.often(Fault::lcm_reorder, 0.1))) {
    held_back_ = bytes;
    return;
  }
  last_ = bytes;
  waiting_.push_back(bytes);
  if (held_back_.size != 0) waiting_.push_back(std::exchange(held_back_, {}));
}

bool PoseStream::next(PoseSample& sample, hal::PoseLinkCounters& counters) {
  const heap::Aside aside;
  while (sent_ns_ + period_ns_ <= world_.now_ns) {
    sent_ns_ += period_ns_;
    if (world_.now_ns - sent_ns_ > static_cast<std::int64_t>(kDatagramsWaiting) * period_ns_) {
      ++seq_;  // sent while the socket was not read: the buffer was full
      continue;
    }
    send();
  }
  while (!waiting_.empty()) {
    const Datagram datagram = waiting_.front();
    waiting_.pop_front();
    if (hal::decode_pose_datagram(datagram.span(), kChannel, sample, counters)) return true;
  }
  return false;
}

// ---- scanner -------------------------------------------------------------------------------------------------------

SimScanner::SimScanner(Line& line, Process& process, std::size_t arm)
    : line_(line), process_(process), arm_(arm), chance_(line.world.chance(arm == 0 ? 5 : 15)) {
  for (std::size_t i = 0; i < line.takes.size(); ++i) (void)chance_.next();  // other random numbers in each process
}

bool SimScanner::wait(std::int64_t time_ns, const std::atomic<bool>& cancel) {
  const std::int64_t until_ns = line_.world.now_ns + time_ns;
  while (line_.world.now_ns < until_ns && !process_.dead()) {
    if (cancel) return false;
    process_.sleep_until(std::min(until_ns, line_.world.now_ns + 50 * kMs));
  }
  return !cancel && !process_.dead();
}

Result<AcquiredScan> SimScanner::acquire(const ScanRequest& request, std::span<float> xyz,
                                         const std::atomic<bool>& cancel, const hal::ScanDecoded& decoded) {
  World& world = line_.world;
  ++world.totals.scans;
  world.totals.scans_by_second += arm_;
  Robot& robot = line_.robots[arm_];
  std::uint32_t& last_export = line_.last_export[arm_];
  const Error cancelled = error(Code::interrupted, "given up");
  const std::int64_t started_ns = world.mono_ns();
  if (!wait(between(chance_, 20 * kMs, 120 * kMs), cancel)) return cancelled;
  const std::int64_t exposure_ns = between(chance_, 150 * kMs, 500 * kMs);
  const std::size_t take = line_.expose(arm_).take;
  if (world.faulty(Fault::robot_moves) && happens(chance_, 0.7)) {
    const std::int64_t after_ns = between(chance_, 0, exposure_ns);
    robot.jolt(world.now_ns + after_ns, between(chance_, 120 * kMs, 300 * kMs));
  }
  const std::int64_t exposed_ns = world.now_ns;
  if (!wait(exposure_ns, cancel)) return cancelled;
  ScanTruth& shown = line_.takes[take - 1];
  shown.smeared = robot.moves(exposed_ns, world.now_ns);
  if (shown.smeared) world.trace.line(world.now_ns, "the robot moved during the exposure");
  const std::int64_t taken_ns = world.mono_ns();
  const std::int64_t taken_us = world.utime_us();
  // A frozen scanner program exports its last scan under the new name, including one that was never fetched.
  std::size_t exported = take;
  if (world.faulty(Fault::scanner_frozen) && last_export != 0 && happens(chance_, 0.6)) exported = last_export;
  last_export = static_cast<std::uint32_t>(exported);

  if ((world.faulty(Fault::scanner_stall) || world.faulty(Fault::scanner_late)) && happens(chance_, 0.7)) {
    const bool late = world.faulty(Fault::scanner_late);
    // Even if the scanner is frozen or slow, slabd's own clock ends the wait.
    while (world.mono_ns() - started_ns < request.timeout_ns)
      if (!wait(200 * kMs, cancel)) return cancelled;
    if (late) ++stray_;  // its file arrives under a name that is no longer expected
    return error(Code::trigger_timeout, "no scan within %lld s", static_cast<long long>(request.timeout_ns / kNsPerS));
  }
  if (!wait(between(chance_, 40 * kMs, 150 * kMs), cancel)) return cancelled;
  if (world.faulty(Fault::scanner_truncated) && happens(chance_, 0.5))
    return error(Code::frame_incomplete, "the file ends early");
  if (world.faulty(Fault::scanner_empty) && happens(chance_, 0.5)) return error(Code::too_few_points, "no points");
  if (world.faulty(Fault::scanner_duplicate) && happens(chance_, 0.5)) ++stray_;  // the same file again
  AcquiredScan scan;
  scan.shape = {4'800'000, 4'500'000, 2400, 2000};
  if (world.faulty(Fault::scanner_nan) && happens(chance_, 0.7)) {
    shown.mostly_nan = true;
    scan.shape.finite = happens(chance_, 0.5) ? 10 : 200'000;
    if (scan.shape.finite < request.points_min) return error(Code::too_few_points, "10 points are finite");
  }
  line_.write(line_.takes[exported - 1], xyz);
  scan.path = request.spool_path;
  scan.path.append(".ply");
  scan.taken_mono_ns = taken_ns;
  scan.taken_utime_us = taken_us;
  scan.read_ms = 40.0;
  decoded(scan);
  // Written and synced while the scan is measured.
  const bool slow = world.faulty(Fault::disk_slow);
  if (!wait(slow ? between(chance_, 1'000 * kMs, 8'000 * kMs) : between(chance_, 60 * kMs, 400 * kMs), cancel))
    return cancelled;
  if (world.faulty(Fault::spool_full) || world.faulty(Fault::disk_full)) return error(Code::store_full, "no space");
  if (world.faulty(Fault::disk_read_only) || (world.faulty(Fault::disk_eio) && happens(chance_, 0.3)))
    return error(Code::journal_write, "the spool cannot be written");
  line_.spool[std::string(scan.path.view())] = static_cast<std::uint32_t>(exported);
  return scan;
}

// ---- control socket ------------------------------------------------------------------------------------------------

bool ControlRoom::next(std::string& line) {
  const heap::Aside aside;
  const bool flood = world_.faulty(Fault::control_flood);
  const bool capture = world_.faulty(Fault::capture);
  if (!flood && !capture && !in_session_) return false;
  if (flood && happens(chance_, 0.3)) {
    constexpr std::array<std::string_view, 8> kLines = {"{\"verb\":\"status\"}",
                                                        "{\"verb\":\"calibration\"}",
                                                        "{\"verb\":\"capture\",\"action\":\"state\"}",
                                                        "{\"verb\":",
                                                        "",
                                                        "[1,2,3]",
                                                        "{\"verb\":\"calibration_change\",\"file\":\"../../../x\"}",
                                                        "{\"verb\":\"erase everything\"}"};
    line = kLines[chance_.below(kLines.size())];
    return true;
  }
  if (world_.now_ns < next_ns_) return false;
  next_ns_ = world_.now_ns + between(chance_, 200 * kMs, 2'000 * kMs);
  if (!capture) {
    if (!in_session_) return false;
    in_session_ = false;
    if (happens(chance_, 0.4)) return false;  // the client disappears, so the lease must end the session
    line = R"({"verb":"capture","action":"end","session":"monday"})";
    return true;
  }
  in_session_ = true;
  if (!happens(chance_, 0.3))
    line = R"({"verb":"capture","action":"shoot","session":"monday"})";
  else if (!several_scanners_)
    line = R"({"verb":"capture","action":"begin","session":"monday","operator":"me","lease_s":20})";
  else if (happens(chance_, 0.5))
    line = R"({"verb":"capture","action":"begin","session":"monday","operator":"me","lease_s":20,"scanner":"1"})";
  else
    line = R"({"verb":"capture","action":"begin","session":"monday","operator":"me","lease_s":20,"scanner":"2"})";
  return true;
}

}  // namespace slabd::sim
