// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <cstdint>

#include "hal/plc/plc_map.h"

/// Decides the next step of the client from times alone, without socket or thread, so that a test sets the clock.
///
///   - It connects. After a failure it waits 0.2 s, then twice as long each time, at most 5 s.
///   - After connecting it writes all registers of the present image, not what was to be written before the loss.
///   - If anything but HEARTBEAT and UTIME changes, it writes all 110 registers at once, which fit one FC 16.
///   - It writes the first 30 registers when the heartbeat moves, at least every 500 ms.
///   - It reads the PLC's registers every `poll_ns`.
namespace slabd::hal {

enum class ClientStep : std::uint8_t { wait, connect, write_all, write_head, read };

class ClientPlan {
 public:
  static constexpr std::size_t kHeadRegisters = 30;
  static constexpr std::int64_t kHeadPeriod_ns = ns_from_ms(500);
  static constexpr std::int64_t kBackOffFirst_ns = ns_from_ms(200);
  static constexpr std::int64_t kBackOffMax_ns = 5 * kNsPerS;

  explicit ClientPlan(std::int64_t poll_ns) : poll_ns_(poll_ns) {}

  struct Next {
    ClientStep step = ClientStep::wait;
    std::int64_t until_ns = 0;  ///< wait: until this time at the latest, or until the image changes
  };
  /// Returns the next step. `present` is the image that the PLC should read now.
  [[nodiscard]] Next next(std::int64_t now_ns, const InputImage& present) const {
    if (!connected_) return now_ns >= connect_ns_ ? Next{ClientStep::connect, 0} : Next{ClientStep::wait, connect_ns_};
    if (!written_once_ || differs(present)) return {ClientStep::write_all, 0};
    if (now_ns >= read_ns_) return {ClientStep::read, 0};
    if (present[kHeartbeat] != written_[kHeartbeat] || now_ns >= head_ns_) return {ClientStep::write_head, 0};
    return {ClientStep::wait, std::min(read_ns_, head_ns_)};
  }

  void connected(std::int64_t now_ns) {
    connected_ = true;
    written_once_ = false;
    read_ns_ = now_ns;
  }
  /// After any error: the connection is closed, and a request that was under way is lost.
  void failed(std::int64_t now_ns) {
    connected_ = false;
    connect_ns_ = now_ns + back_off_ns_;
    back_off_ns_ = std::min(2 * back_off_ns_, kBackOffMax_ns);
  }
  void wrote_all(std::int64_t now_ns, const InputImage& image) {
    written_ = image;
    written_once_ = true;
    head_ns_ = now_ns + kHeadPeriod_ns;
  }
  void wrote_head(std::int64_t now_ns, const InputImage& image) {
    std::copy_n(image.begin(), kHeadRegisters, written_.begin());
    head_ns_ = now_ns + kHeadPeriod_ns;
  }
  /// The PLC's registers were read, so this connection works.
  void has_read(std::int64_t now_ns) {
    read_ns_ = now_ns + poll_ns_;
    back_off_ns_ = kBackOffFirst_ns;
  }
  /// Requests a second answer at once, because the last one may be torn.
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
  std::int64_t back_off_ns_ = kBackOffFirst_ns;
  std::int64_t read_ns_ = 0;
  std::int64_t head_ns_ = 0;
};

}  // namespace slabd::hal
