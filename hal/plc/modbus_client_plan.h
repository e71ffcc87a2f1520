// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <cstdint>

#include "hal/plc/plc_map.h"

/// What a client does next, as arithmetic on times: no socket, no thread, so that a test steps the clock.
///
///   - it connects, and after a failure waits 0.2 s, then twice as long each time, 5 s at most;
///   - after connecting it writes everything: what is on the wire after a loss is the present image, never what was to
///     be written before it;
///   - a change of anything but HEARTBEAT and UTIME is written at once and whole (110 registers fit one FC 16); the
///     first 30 registers when the heartbeat moves, at least every 500 ms;
///   - it reads the PLC's half every `poll_ns`.
namespace slabd::hal {

enum class ClientDeed : std::uint8_t { wait, connect, write_all, write_head, read };

class ClientPlan {
 public:
  static constexpr std::size_t kHeadRegisters = 30;
  static constexpr std::int64_t kHeadPeriodNs = ns_from_ms(500);
  static constexpr std::int64_t kBackOffFirstNs = ns_from_ms(200);
  static constexpr std::int64_t kBackOffMaxNs = 5 * kNsPerS;

  explicit ClientPlan(std::int64_t poll_ns) : poll_ns_(poll_ns) {}

  struct Next {
    ClientDeed deed = ClientDeed::wait;
    std::int64_t until_ns = 0;  ///< wait: no longer than this, unless the image changes
  };
  /// `present` is what the PLC should read now.
  [[nodiscard]] Next next(std::int64_t now_ns, const InputImage& present) const {
    if (!connected_) return now_ns >= connect_ns_ ? Next{ClientDeed::connect, 0} : Next{ClientDeed::wait, connect_ns_};
    if (!written_once_ || differs(present)) return {ClientDeed::write_all, 0};
    if (now_ns >= read_ns_) return {ClientDeed::read, 0};
    if (present[kHeartbeat] != written_[kHeartbeat] || now_ns >= head_ns_) return {ClientDeed::write_head, 0};
    return {ClientDeed::wait, std::min(read_ns_, head_ns_)};
  }

  void connected(std::int64_t now_ns) {
    connected_ = true;
    written_once_ = false;
    read_ns_ = now_ns;
  }
  /// Anything went wrong: the connection is gone, whatever was under way with it.
  void failed(std::int64_t now_ns) {
    connected_ = false;
    connect_ns_ = now_ns + back_off_ns_;
    back_off_ns_ = std::min(2 * back_off_ns_, kBackOffMaxNs);
  }
  void wrote_all(std::int64_t now_ns, const InputImage& image) {
    written_ = image;
    written_once_ = true;
    head_ns_ = now_ns + kHeadPeriodNs;
  }
  void wrote_head(std::int64_t now_ns, const InputImage& image) {
    std::copy_n(image.begin(), kHeadRegisters, written_.begin());
    head_ns_ = now_ns + kHeadPeriodNs;
  }
  /// The PLC's half has come: this connection works.
  void has_read(std::int64_t now_ns) {
    read_ns_ = now_ns + poll_ns_;
    back_off_ns_ = kBackOffFirstNs;
  }
  /// What has come may be torn: the next answer tells.
  void read_again(std::int64_t now_ns) { read_ns_ = now_ns; }

 private:
  static constexpr std::size_t kHeartbeat = 4;
  static constexpr std::size_t kUtimeFirst = 22;
  static constexpr std::size_t kUtimeLast = 25;

  [[nodiscard]] bool differs(const InputImage& present) const {
    for (std::size_t i = 0; i < present.size(); ++i)
      if (present[i] != written_[i] && i != kHeartbeat && (i < kUtimeFirst || i > kUtimeLast)) return true;
    return false;
  }

  std::int64_t poll_ns_;
  bool connected_ = false;
  bool written_once_ = false;  ///< on this connection
  InputImage written_{};
  std::int64_t connect_ns_ = 0;
  std::int64_t back_off_ns_ = kBackOffFirstNs;
  std::int64_t read_ns_ = 0;
  std::int64_t head_ns_ = 0;
};

}  // namespace slabd::hal
