// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <atomic>
#include <chrono>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "base/base.h"
#include "hal/hal.h"

/// The PLC's half of the line, which works in cycles as a PLC program does, for any register transport (plc_peer.cpp).
/// Each cycle reads the 110 input registers, stores and acknowledges a result if one is shown, and sends the
/// heartbeat.
///
/// Rules for PLC programmers: the command number starts from CMD_ACK, never from memory; the session is read again
/// after every refusal; a command without an answer is written again under the *same* number; a result is acknowledged
/// only after it is stored; only VERDICT 1 is a pass.
namespace slabd::emulator {

using PlcClock = std::chrono::steady_clock;

/// Maximum number of writes of one order that is refused as stale, busy or not enabled.
inline constexpr int kIssueAttempts = 8;

struct PlcTraits {
  hal::PlcSettings plc;  ///< the daemon's settings; this is the opposite end
  std::string device;    ///< rtu: the other end of the serial line
  std::chrono::milliseconds cycle{5};
  std::chrono::milliseconds heartbeat{250};
  std::chrono::milliseconds ack_timeout{500};
  int ack_rewrites = 3;
  std::chrono::milliseconds acquire_timeout{20'000};
  std::chrono::milliseconds result_timeout{60'000};
  std::chrono::milliseconds link_timeout{30'000};  ///< time for which a lost connection is retried
};

/// A result record with the time at which the PLC stored it.
struct StoredResult {
  PlcResult record;
  PlcClock::time_point at;
};

/// Reason for a failed command: slabd's code, or Code::ok and the text of a broken link or a timeout.
struct PlcTrouble {
  Code code = Code::ok;
  bool link_lost = false;
  bool interrupted = false;  ///< `stop` was set
  std::string text;
};

struct PlcOrder {
  PlcCommand command = PlcCommand::none;
  int station = 0;
  std::uint16_t slab_type = 0;
  std::uint32_t slab_no = 0;
  std::string slab_id;
  std::uint16_t mould = 0;  ///< 0: unknown
  std::uint16_t temperature_dk = 0;
  std::string second_chip;  ///< id in the slab's second chip; empty: not read
};

class PlcPeer {
 public:
  /// Connects, checks magic, version and word order, and starts as a PLC does: requests a new session (SYNC_REQ), sets
  /// ENABLE, waits until slabd is not busy. Code::scanner_offline if the server does not answer (the text names host
  /// and port), Code::config if the map is not 1.1.
  [[nodiscard]] static Result<std::unique_ptr<PlcPeer>> connect(const PlcTraits& traits, const std::atomic<bool>& stop);
  ~PlcPeer();
  PlcPeer(const PlcPeer&) = delete;
  PlcPeer& operator=(const PlcPeer&) = delete;

  [[nodiscard]] const PlcOutputs& seen() const;
  [[nodiscard]] const std::vector<StoredResult>& results() const;
  [[nodiscard]] std::string_view peer_name() const;

  /// Writes the order and waits until it is accepted; returns its CMD_SEQ. Repeats the order on stale session, wrong
  /// number, busy and not enabled. `written` (if given) becomes the time of the first write.
  [[nodiscard]] bool issue(const PlcOrder& order, std::uint16_t& cmd_seq, PlcTrouble& trouble,
                           PlcClock::time_point* written = nullptr);
  /// Runs cycles until CMD_STATUS of `cmd_seq` is at least `status`, or the command failed.
  [[nodiscard]] bool await_status(std::uint16_t cmd_seq, CommandStatus status, std::chrono::milliseconds timeout,
                                  PlcTrouble& trouble);
  /// Runs cycles until `done` returns true.
  [[nodiscard]] bool await(const std::function<bool()>& done, std::chrono::milliseconds timeout, const char* what,
                           PlcTrouble& trouble);
  /// The stored record of this kind and command, or nullptr.
  [[nodiscard]] const StoredResult* result(std::uint32_t slab_no, int kind, int station, std::uint16_t cmd_seq) const;
  /// Writes HR 40..74 in one request, with the next GAUGE_SEQ. A failure is detected by the next cycle.
  void write_gauges(const std::array<std::int32_t, limits::kGaugesMax>& thousandths, std::uint32_t slab_no);
  /// Clears ENABLE.
  void disable();

 private:
  struct Impl;
  void make_void();
  explicit PlcPeer(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace slabd::emulator
