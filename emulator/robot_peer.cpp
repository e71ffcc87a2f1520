// SPDX-License-Identifier: Apache-2.0
#include "emulator/robot_peer.h"

#include <lcm/lcm.h>

#include <arpa/inet.h>
#include <fmt/core.h>
#include <netinet/in.h>
#include <sys/socket.h>
#include <unistd.h>
#include <cerrno>
#include <chrono>
#include <cstdint>
#include <cstring>
#include <mutex>
#include <optional>
#include <slabd/flange_pose_t.hpp>
#include <string>
#include <thread>
#include <utility>
#include <vector>

#include "base/base.h"
#include "base/os.h"

namespace slabd::emulator {
namespace {

/// A KUKA controller's side of RSI: sends the small XML documents over UDP, with the faults of a bad network.
class RsiSender {
 public:
  /// `to`: "HOST:PORT" of the bridge. `faults`: share of packets that are lost, late or corrupted, a third each.
  /// Code::config if `to` is not an address.
  [[nodiscard]] static Result<RsiSender> open(const std::string& to, double faults, std::uint64_t seed);

  /// Sends one cycle. Values are rounded to four decimals, as by the controller (mm, deg).
  void send(const Pose& T_base_flange, std::int16_t base_id, std::int16_t tool_id, bool stopped, std::int64_t ipoc_ms);

 private:
  RsiSender(Fd fd, const sockaddr_in& to, double faults, std::uint64_t seed)
      : fd_(std::move(fd)), to_(to), faults_(faults), random_(seed) {}
  void put(const std::string& text) const;

  Fd fd_;
  sockaddr_in to_{};
  double faults_ = 0.0;
  Prng random_;
  std::string late_;
};

Result<RsiSender> RsiSender::open(const std::string& to, double faults, std::uint64_t seed) {
  const std::size_t colon = to.rfind(':');
  const long port = colon == std::string::npos ? 0 : std::strtol(to.c_str() + colon + 1, nullptr, 10);
  sockaddr_in address{};
  address.sin_family = AF_INET;
  address.sin_port = htons(static_cast<std::uint16_t>(port));
  if (port <= 0 || port > 65'535 || ::inet_pton(AF_INET, to.substr(0, colon).c_str(), &address.sin_addr) != 1)
    return error(Code::config, "--rsi %s: expected ADDRESS:PORT of the bridge, such as 127.0.0.1:49152", to.c_str());
  Fd fd(::socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC, 0));
  if (!fd.is_open()) return error(Code::internal, "no UDP socket: %s", std::strerror(errno));
  return RsiSender(std::move(fd), address, faults, seed);
}

void RsiSender::put(const std::string& text) const {
  // A missing receiver is not an error of the controller.
  (void)::sendto(fd_.get(), text.data(), text.size(), MSG_NOSIGNAL,
                 static_cast<const sockaddr*>(static_cast<const void*>(&to_)), sizeof to_);
}

void RsiSender::send(const Pose& T_base_flange, std::int16_t base_id, std::int16_t tool_id, bool stopped,
                     std::int64_t ipoc_ms) {
  const Vec3& p = T_base_flange.translation_mm;
  const KukaAbc abc = kuka_abc_from_rotation(T_base_flange.rotation);
  std::string text = fmt::format(
      "<Rob Type=\"KUKA\"><RIst X=\"{:.4f}\" Y=\"{:.4f}\" Z=\"{:.4f}\" A=\"{:.4f}\" B=\"{:.4f}\" C=\"{:.4f}\"/>"
      "<Base>{}</Base><Tool>{}</Tool><Stopped>{}</Stopped><Emulated>1</Emulated><Delay D=\"0\"/><IPOC>{}</IPOC></Rob>",
      p.x(), p.y(), p.z(), deg_from_rad(abc.a_rad), deg_from_rad(abc.b_rad), deg_from_rad(abc.c_rad), base_id, tool_id,
      stopped ? 1 : 0, ipoc_ms);
  const double dice = random_.uniform();
  if (dice < faults_ / 3.0) return;
  if (dice < 2.0 * faults_ / 3.0) {
    late_ = text;
    return;
  }
  if (dice < faults_) text.resize(1 + random_.below(text.size() - 1));
  put(text);
  if (!late_.empty()) put(late_);
  late_.clear();
}
using SteadyClock = std::chrono::steady_clock;

constexpr std::int32_t kMeasured = 1;
constexpr std::int32_t kStopped = 2;
constexpr std::int32_t kRunning = 4;
constexpr std::int32_t kEmulated = 16;
/// Encoder tremor of the orientation is that of the position over the arm's reach.
constexpr double kTremorLever_mm = 1000.0;

double seconds_since(SteadyClock::time_point start) {
  return std::chrono::duration<double>(SteadyClock::now() - start).count();
}

/// Position along the motion, which starts and ends at rest.
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
  std::optional<RsiSender> rsi;  // used instead of LCM

  mutable std::mutex mutex;  // guards the motion
  Pose from;
  Pose to;
  SteadyClock::time_point started;

  std::jthread thread;  // last member: joined before the others are destroyed

  ~Impl() {
    thread.request_stop();
    if (thread.joinable()) thread.join();
    if (lcm != nullptr) lcm_destroy(lcm);
  }

  /// 0 at the start of the motion, 1 when the arm has stopped.
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
        // A controller's counter advances by its cycle, however late this process sends.
        rsi->send(shown.T_base_flange, traits.base_id, traits.tool_id, shown.stands, milliseconds_of(next));
      else
        publish(message_of(shown, sequence++), wire);
      next += period;
      std::this_thread::sleep_until(next);
    }
  }

  void publish(const slabd::flange_pose_t& message, std::vector<std::uint8_t>& wire) const {
    wire.resize(static_cast<std::size_t>(message.getEncodedSize()));
    message.encode(wire.data(), 0, static_cast<int>(wire.size()));
    // A lost datagram is not an error here: the receiver's gap check is part of the emulation.
    lcm_publish(lcm, traits.channel.c_str(), wire.data(), static_cast<unsigned>(wire.size()));
  }
  [[nodiscard]] static std::int64_t milliseconds_of(SteadyClock::time_point time) {
    return std::chrono::duration_cast<std::chrono::milliseconds>(time.time_since_epoch()).count();
  }

  struct Shown {
    Pose T_base_flange;
    bool stands = false;
  };
  /// A sample with the tremor of the encoders.
  Shown sample(Prng& random) const {
    Pose pose;
    bool stands = false;
    {
      const std::lock_guard lock(mutex);
      const double share = progress();
      stands = share >= 1.0;
      pose = place(share);
    }
    const double tremor_rad = traits.tremor_mm / kTremorLever_mm;
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

}  // namespace slabd::emulator
