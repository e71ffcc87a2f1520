// SPDX-License-Identifier: Apache-2.0
#include "emulator/robot_peer.h"

#include <lcm/lcm.h>

#include <chrono>
#include <mutex>
#include <optional>
#include <slabd/flange_pose_t.hpp>
#include <thread>
#include <vector>

#include "emulator/rsi_sender.h"

namespace slabd::simulate {
namespace {

using SteadyClock = std::chrono::steady_clock;

constexpr std::int32_t kMeasured = 1;
constexpr std::int32_t kStopped = 2;
constexpr std::int32_t kRunning = 4;
constexpr std::int32_t kEmulated = 16;
/// Encoder tremor of the orientation: that of the position over the arm's reach.
constexpr double kTremorLeverMm = 1000.0;

double seconds_since(SteadyClock::time_point start) {
  return std::chrono::duration<double>(SteadyClock::now() - start).count();
}

/// Starts and ends at rest.
double eased(double share) {
  return share * share * (3.0 - 2.0 * share);
}

Pose between(const Pose& from, const Pose& to, double share) {
  return {from.rotation.slerp(share, to.rotation),
          from.translation_mm + share * (to.translation_mm - from.translation_mm)};
}

}  // namespace

std::string_view multicast_group(std::string_view lcm_url) {
  constexpr std::string_view kScheme = "udpm://";
  constexpr std::string_view kDefaultOfLcm = "239.255.76.67";
  if (!lcm_url.starts_with(kScheme)) return kDefaultOfLcm;
  lcm_url.remove_prefix(kScheme.size());
  const std::string_view group = lcm_url.substr(0, lcm_url.find_first_of(":?"));
  return group.empty() ? kDefaultOfLcm : group;
}

struct RobotPeer::Impl {
  RobotTraits traits;
  lcm_t* lcm = nullptr;
  std::optional<RsiSender> rsi;  // instead

  mutable std::mutex mutex;  // guards the motion
  Pose from;
  Pose to;
  SteadyClock::time_point started;

  std::jthread thread;  // last: joined before the rest goes

  ~Impl() {
    thread.request_stop();
    if (thread.joinable()) thread.join();
    if (lcm != nullptr) lcm_destroy(lcm);
  }

  /// 0 at the start of the motion, 1 when the arm stands.
  [[nodiscard]] double progress() const {
    return traits.move_s > 0.0 ? std::min(1.0, seconds_since(started) / traits.move_s) : 1.0;
  }
  [[nodiscard]] Pose place(double share) const { return share >= 1.0 ? to : between(from, to, eased(share)); }

  void publish_until(const std::stop_token& stop) {
    Prng random(traits.seed);
    const auto period =
        std::chrono::duration_cast<SteadyClock::duration>(std::chrono::duration<double>(1.0 / traits.rate_hz));
    std::vector<std::uint8_t> wire;
    std::int32_t sequence = 0;
    auto next = SteadyClock::now();
    while (!stop.stop_requested()) {
      const Shown shown = sample(random);
      if (rsi)
        rsi->send(shown.T_base_flange, traits.base_id, traits.tool_id, shown.stands, milliseconds_now());
      else
        publish(message_of(shown, sequence++), wire);
      next += period;
      std::this_thread::sleep_until(next);
    }
  }

  void publish(const slabd::flange_pose_t& message, std::vector<std::uint8_t>& wire) const {
    wire.resize(static_cast<std::size_t>(message.getEncodedSize()));
    message.encode(wire.data(), 0, static_cast<int>(wire.size()));
    // A lost datagram is the receiver's business: its gap check is part of what is emulated.
    lcm_publish(lcm, traits.channel.c_str(), wire.data(), static_cast<unsigned>(wire.size()));
  }
  [[nodiscard]] static std::int64_t milliseconds_now() {
    return std::chrono::duration_cast<std::chrono::milliseconds>(SteadyClock::now().time_since_epoch()).count();
  }

  struct Shown {
    Pose T_base_flange;
    bool stands = false;
  };
  /// With the tremor of the encoders.
  Shown sample(Prng& random) const {
    Pose pose;
    bool stands = false;
    {
      const std::lock_guard lock(mutex);
      const double share = progress();
      stands = share >= 1.0;
      pose = place(share);
    }
    const double tremor_rad = traits.tremor_mm / kTremorLeverMm;
    for (int axis = 0; axis < 3; ++axis) pose.translation_mm[axis] += traits.tremor_mm * random.normal();
    const Quat shake = rotation_from_kuka_abc(tremor_rad * random.normal(), tremor_rad * random.normal(),
                                              tremor_rad * random.normal());
    pose.rotation = (pose.rotation * shake).normalized();
    return {pose, stands};
  }

  slabd::flange_pose_t message_of(const Shown& shown, std::int32_t sequence) const {
    const Pose& pose = shown.T_base_flange;
    slabd::flange_pose_t message{};
    message.utime =
        std::chrono::duration_cast<std::chrono::microseconds>(std::chrono::system_clock::now().time_since_epoch())
            .count();
    message.robot_time_us =
        std::chrono::duration_cast<std::chrono::microseconds>(SteadyClock::now().time_since_epoch()).count();
    message.seq = sequence;
    message.base_id = traits.base_id;
    message.tool_id = traits.tool_id;
    message.flags = kMeasured | kRunning | kEmulated | (shown.stands ? kStopped : 0);
    for (int axis = 0; axis < 3; ++axis) message.trans[axis] = m_from_mm(pose.translation_mm[axis]);
    message.quat[0] = pose.rotation.w();
    message.quat[1] = pose.rotation.x();
    message.quat[2] = pose.rotation.y();
    message.quat[3] = pose.rotation.z();
    return message;
  }
};

RobotPeer::RobotPeer(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
RobotPeer::~RobotPeer() = default;

Result<std::unique_ptr<RobotPeer>> RobotPeer::start(const RobotTraits& traits, const Pose& T_base_flange) {
  auto impl = std::make_unique<Impl>();
  impl->traits = traits;
  impl->from = impl->to = T_base_flange;
  impl->started = SteadyClock::now() - std::chrono::hours(1);
  if (!traits.rsi.empty()) {
    Result<RsiSender> rsi = RsiSender::open(traits.rsi, traits.rsi_faults, traits.seed);
    if (!rsi) return rsi.error();
    impl->rsi.emplace(std::move(rsi.value()));
  } else {
    impl->lcm = lcm_create(traits.lcm_url.c_str());
  }
  if (traits.rsi.empty() && impl->lcm == nullptr) {
    const std::string group(multicast_group(traits.lcm_url));
    return error(Code::no_pose,
                 "the robot cannot publish on %s: no route for its multicast group; as root: "
                 "ip route add %s/32 dev lo",
                 traits.lcm_url.c_str(), group.c_str());
  }
  Impl* raw = impl.get();
  impl->thread = std::jthread([raw](const std::stop_token& stop) { raw->publish_until(stop); });
  return std::unique_ptr<RobotPeer>(new RobotPeer(std::move(impl)));
}

void RobotPeer::move_to(const Pose& T_base_flange) {
  const std::lock_guard lock(impl_->mutex);
  impl_->from = impl_->place(impl_->progress());
  impl_->to = T_base_flange;
  impl_->started = SteadyClock::now();
}

bool RobotPeer::standing() const {
  const std::lock_guard lock(impl_->mutex);
  return impl_->progress() >= 1.0;
}

Pose RobotPeer::pose() const {
  const std::lock_guard lock(impl_->mutex);
  return impl_->place(impl_->progress());
}

}  // namespace slabd::simulate
