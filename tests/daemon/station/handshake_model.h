// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "base/plc.h"

/// Model of the handshake between PLC and slabd, small enough to check every state it can reach. It consists of a PLC
/// with a robot, slabd, and a link that loses and repeats command blocks; both sides can die at any moment. Numbers are
/// the real 16-bit ones, started just below their wrap.
///
/// In addition an operator may take manual control of the line and move the robot. A second commander may read SESSION
/// and CMD_ACK and write its own block.
///
/// The model leaves out time (every message may take any time) and the pose window (a robot at the wrong position is
/// scanned). It also leaves out verdicts, and SLAB_BEGIN and SLAB_END, which do not move the robot. ENABLE and the
/// heartbeat arrive at once, because they are levels that are written repeatedly. A second commander that reads before
/// the PLC has commanded this process of slabd would be accepted: the list of addresses must prevent that.
namespace slabd::handshake {

constexpr std::size_t kStations = 2;

/// The rules; each can be switched off.
struct Rules {
  // slabd's
  bool number_is_successor = true;               ///< CMD_SEQ must be the one after CMD_ACK
  bool session_is_echoed = true;                 ///< SESSION_ECHO must be the session shown
  bool session_changes_at_start = true;          ///< of slabd
  bool session_changes_on_request = true;        ///< SYNC_REQ, after the PLC's restart
  bool session_is_durable_first = true;          ///< and shown second
  bool scan_is_durable_first = true;             ///< and ACQUIRED second
  bool result_is_kept = true;                    ///< until it is acknowledged, over restarts
  bool enable_is_required = true;                ///< for a command
  bool one_connection_commands = true;           ///< a block from another connection changes the session and is refused
  bool never_scans_by_itself = true;             ///< an order interrupted by a death is not resumed
  bool session_changes_when_heard_again = true;  ///< after the PLC's heartbeat was lost
  // the PLC's
  bool robot_waits_for_acquired = true;    ///< before it leaves
  bool restarted_plc_waits = true;         ///< until slabd is not BUSY, before it moves the robot
  bool number_follows_ack = true;          ///< CMD_SEQ is derived from CMD_ACK, not from the PLC's own count
  bool result_is_stored_first = true;      ///< and acknowledged second
  bool synchronises = true;                ///< SYNC_REQ after its own start
  bool given_up_means_synchronise = true;  ///< SYNC_REQ after an order was given up or an operator took control
};

constexpr std::uint8_t kPlc = 1;
constexpr std::uint8_t kStranger = 2;

/// A command block: SCAN of a station.
struct Frame {
  std::uint16_t seq = 0;
  std::uint16_t session = 0;
  std::uint8_t station = 0;    ///< from 1; 0: no frame
  std::uint8_t writer = kPlc;  ///< the connection that wrote it
  bool operator==(const Frame&) const = default;
};

enum class Status : std::uint8_t { none, accepted, acquired, failed };
enum class Has : std::uint8_t { nothing, cloud, result };

/// slabd's state: the content of its database, and the process's memory and registers.
struct Slabd {
  enum class Phase : std::uint8_t { idle, journalling, acquiring, storing };

  // durable
  std::uint16_t session_stored = 65533;
  std::uint16_t ack_stored = 65533;
  std::uint16_t acquired_stored = 0;
  Status status_stored = Status::none;
  Frame command_stored;
  std::array<Has, kStations> has{};
  std::array<std::uint8_t, kStations> results{};  ///< stations whose results wait, oldest first; 0: none

  // in memory
  bool up = true;
  std::uint8_t writer = 0;  ///< the commanding connection; 0: none yet
  bool enable = true;       ///< as last written by the PLC
  bool heard = true;        ///< its heartbeat moves
  bool was_lost = false;
  std::uint16_t session = 65533;  ///< shown; 0: none yet
  std::uint16_t session_next = 65533;
  std::uint16_t ack = 65533;
  std::uint16_t acquired = 0;
  Status status = Status::none;
  Phase phase = Phase::idle;
  Frame command;  ///< the command in progress
  Frame judged;   ///< the block evaluated last
  std::array<bool, kStations> cloud_in_memory_only{};

  bool operator==(const Slabd&) const = default;
  [[nodiscard]] bool busy() const { return phase != Phase::idle; }

  // Events. After each of these steps the process may die.
  void receive(const Frame& frame, const Rules& rules);
  void synchronise(const Rules& rules);  ///< SYNC_REQ was changed
  void session_was_stored();
  void command_was_stored();
  void scan(const Rules& rules);  ///< points and pose are taken and being written
  void scan_failed();
  void scan_was_stored();
  void measured(std::size_t index);
  void acknowledged();  ///< the PLC has the oldest result
  void die();
  void start(const Rules& rules);
  void lose_heartbeat();
  void hear_heartbeat(const Rules& rules);

 private:
  void change_session(const Rules& rules);
};

/// The PLC's state.
struct Plc {
  enum class Phase : std::uint8_t { started, synchronising, homing, choosing, commanding, awaiting, in_hand, finished };
  Phase phase = Phase::started;
  std::uint16_t session_before = 0;
  std::uint16_t own_count = 65533;
  Frame command;  ///< copy of the last block it wrote
  std::uint8_t target = 0;
  std::uint8_t to_store = 0;             ///< acknowledged, not yet stored (without result_is_stored_first)
  std::array<bool, kStations> stored{};  ///< in retentive memory
  bool operator==(const Plc&) const = default;
};

struct World {
  Slabd slabd;
  Plc plc;
  std::uint8_t robot = 0;              ///< station of the robot; 0: home
  std::array<bool, kStations> left{};  ///< the robot has left and counts the scan as taken
  Frame wire;                          ///< block in transfer
  std::array<Frame, 2> old;            ///< sent before; each may be repeated
  Frame stranger;                      ///< of the second commander, not sent yet
  std::uint8_t deaths = 0;
  std::uint8_t repeats = 0;
  std::uint8_t failures = 0;
  std::uint8_t given_up = 0;
  std::uint8_t strangers = 0;
  bool operator==(const World&) const = default;
};

/// Largest number of mishaps of each kind.
struct Mishaps {
  std::uint8_t deaths = 3;          ///< of either side
  std::uint8_t repeats = 1;         ///< old blocks that come again
  std::uint8_t failures = 1;        ///< failed scans
  std::uint8_t given_up = 0;        ///< orders given up, or manual control taken
  std::uint8_t strangers = 0;       ///< blocks of a second commander
  bool deaths_are_noticed = false;  ///< slabd detects the missing heartbeat of every PLC that dies
};

struct Finding {
  std::size_t states = 0;
  std::string violation;           ///< empty: none
  std::vector<std::string> story;  ///< the shortest path to it
};

/// Checks every state. Violations are a scan of a station without the robot there, a station left without a durable
/// scan, and a result lost by both sides. A state from which the slab cannot be finished without further mishaps is a
/// violation too.
[[nodiscard]] Finding explore(const Rules& rules, const Mishaps& mishaps);

}  // namespace slabd::handshake
