// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <atomic>
#include <chrono>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "base/base.h"
#include "hal/hal.h"

/// The PLC's half of the line, which works as a PLC program does, one cycle after the other, whoever moves the
/// registers (plc_peer.cpp). Each cycle reads the 110 input registers, stores and acknowledges a result when one is
/// shown, and keeps its heartbeat.
///
/// What a PLC programmer should copy from here: the command number is seeded from CMD_ACK, never from memory; the
/// session is read again after every refusal; a command without an answer is written again under the *same* number;
/// a result is acknowledged only after it is stored; only VERDICT 1 is a pass.
namespace slabd::simulate {

using PlcClock = std::chrono::steady_clock;

/// Writes of one order before it is given up: refused as stale, busy or not enabled.
inline constexpr int kIssueAttempts = 8;

struct PlcTraits {
  hal::PlcSettings plc;  ///< the daemon's, of which this is the other end
  std::string device;    ///< rtu: the other end of the serial line
  std::chrono::milliseconds cycle{5};
  std::chrono::milliseconds heartbeat{250};
  std::chrono::milliseconds ack_timeout{500};
  int ack_rewrites = 3;
  std::chrono::milliseconds acquire_timeout{20'000};
  std::chrono::milliseconds result_timeout{60'000};
  std::chrono::milliseconds link_timeout{30'000};  ///< a lost connection is tried again for so long
};

/// A result record as the PLC stored it, and when.
struct StoredResult {
  PlcResult record;
  PlcClock::time_point at;
};

/// Why a command came to nothing: the code that slabd gave, or Code::ok and the text of a broken link or a timeout.
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
};

class PlcPeer {
 public:
  /// Connects, checks magic, version and word order, and does what a PLC does after its own start: asks for a new
  /// session (SYNC_REQ), sets ENABLE, waits until nothing is busy. scanner_offline when
  /// nothing answers there (the text names host and port), config when it is not map 1.0.
  [[nodiscard]] static Result<std::unique_ptr<PlcPeer>> connect(const PlcTraits& traits, const std::atomic<bool>& stop);
  ~PlcPeer();
  PlcPeer(const PlcPeer&) = delete;
  PlcPeer& operator=(const PlcPeer&) = delete;

  [[nodiscard]] const PlcOutputs& seen() const;
  [[nodiscard]] const std::vector<StoredResult>& results() const;
  [[nodiscard]] std::string_view peer_name() const;

  /// Writes the order and waits until it is accepted; returns its CMD_SEQ. Repeats on stale session, wrong number and
  /// busy. `written` (if given) becomes the time of the first write.
  [[nodiscard]] bool issue(const PlcOrder& order, std::uint16_t& cmd_seq, PlcTrouble& trouble,
                           PlcClock::time_point* written = nullptr);
  /// Cycles until CMD_STATUS of `cmd_seq` is at least `status`, or it failed.
  [[nodiscard]] bool await_status(std::uint16_t cmd_seq, CommandStatus status, std::chrono::milliseconds timeout,
                                  PlcTrouble& trouble);
  /// Cycles until `done` holds.
  [[nodiscard]] bool await(const std::function<bool()>& done, std::chrono::milliseconds timeout, const char* what,
                           PlcTrouble& trouble);
  /// The stored record of this kind and command, or nullptr.
  [[nodiscard]] const StoredResult* result(std::uint32_t slab_no, int kind, int station, std::uint16_t cmd_seq) const;
  /// Leaves: ENABLE off.
  void disable();

 private:
  struct Impl;
  void make_void();
  explicit PlcPeer(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace slabd::simulate
