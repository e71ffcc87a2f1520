// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <map>
#include <optional>
#include <tuple>
#include <vector>

#include "hal/plc/plc_map.h"
#include "tests/sim/line.h"
#include "tests/sim/wire.h"

/// A PLC that follows docs/PLC.md: one transfer at a time, commands by the written rules, results stored before they
/// are acknowledged, only VERDICT 1 counts as a pass. Its retentive memory survives its loss of power.
namespace slabd::sim {

/// The PLC's decision on a slab.
struct Decision {
  std::uint32_t slab_no = 0;
  std::uint16_t cmd_seq = 0;
  Verdict verdict = Verdict::none;
};

class Plc {
 public:
  Plc(World& world, Line& line, Wire& wire);

  [[nodiscard]] std::int64_t next_ns() const;
  void act();
  void restart();

  /// Set by a fault; carried out at the right step of the program.
  struct Wishes {
    bool abort = false;       ///< raise ABORT for a moment
    bool slab_abort = false;  ///< give up the slab
    /// Delay after SLAB_END was acknowledged until the slab is given up; negative: never.
    std::int64_t abort_after_end_ns = -1;
    bool report = false;
    bool rescan = false;
    bool wrong_station = false;  ///< the robot goes to a wrong station
    std::int64_t disabled_until_ns = 0;
  } wishes;

  /// New slabs are not placed.
  bool resting = false;
  bool next_is_good = false;
  /// Called with every decision on a slab, before the slab leaves the line.
  std::function<void(const Decision&)> decided;
  [[nodiscard]] bool line_is_empty() const { return kept_.stage == Stage::none; }
  [[nodiscard]] const PlcOutputs& seen() const { return seen_; }

 private:
  enum class Stage : std::uint8_t { none, begin, scan, end };
  enum class Step : std::uint8_t { idle, issue, wait_ack, wait_ready, wait_free, running };
  enum class Transfer : std::uint8_t { none, read, control, command };
  using Key = std::tuple<std::uint32_t, std::uint16_t, std::uint16_t, std::uint16_t>;

  /// Retentive memory.
  struct Kept {
    Stage stage = Stage::none;
    std::uint32_t slab_no = 0;
    std::uint16_t type = 0;
    int stations = 0;
    bool giving_up = false;
    std::vector<std::uint16_t> end_seqs;  ///< of every SLAB_END and SLAB_ABORT written for this slab
    std::array<int, limits::kStationsMax> tries{};
    std::uint16_t sync = 0;
    std::map<Key, PlcResult> results;
  };

  // ---- the link ----
  void transfer();
  void send(Transfer what, const Frame& pdu);
  void on_reply(const Frame& frame);
  // ---- the program ----
  void think();
  void store_result();
  void run_order();
  void order_ended(bool done, Code code);
  void plan();
  void plan_slab();
  void send_robot(int next, int target);
  void order(PlcCommand command, int station);
  void decide(const PlcResult& record);
  void finish_slab();

  World& world_;
  Line& line_;
  Wire& wire_;
  Prng chance_;
  Kept kept_;

  // Lost at a loss of power.
  PlcInputs out_;
  PlcOutputs seen_;
  hal::InputImage image_{};
  bool ever_seen_ = false;
  bool synced_ = false;
  std::uint16_t session_old_ = 0;
  bool session_asked_ = false;
  std::uint32_t connection_ = 0;
  std::uint16_t transaction_ = 0;
  Transfer outstanding_ = Transfer::none;
  std::int64_t deadline_ns_ = 0;
  std::int64_t cycle_ns_ = 0;
  std::int64_t beat_ns_ = 0;
  std::int64_t off_until_ns_ = 0;
  std::int64_t pause_until_ns_ = 0;
  std::int64_t fault_reset_ns_ = 0;
  std::int64_t vanished_ns_ = 0;
  bool want_control_ = false;
  bool want_command_ = false;
  Step step_ = Step::idle;
  int attempts_ = 0;
  int rewrites_ = 0;
  std::int64_t step_ns_ = 0;
  std::uint16_t refused_before_ = 0;
  int reset_ = 0;
  int going_to_ = 0;     ///< station to which a robot is moving, to be scanned then
  std::size_t arm_ = 0;  ///< the robot that is moving
};

}  // namespace slabd::sim
