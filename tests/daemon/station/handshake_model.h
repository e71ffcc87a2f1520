// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "base/plc.h"

/// The handshake between PLC and slabd as a model small enough to look at every state it can get into: a PLC with a
/// robot, slabd, a link that loses and repeats command blocks, and both sides dying at any moment. Numbers are the real
/// 16-bit ones, started just below their wrap.
///
/// Beside them there are an operator, who takes the line in hand and moves the robot, and a second commander, who has
/// read SESSION and CMD_ACK and writes a block of his own.
///
/// What the model leaves out: time (every message may take any time), the pose window (a robot in the wrong place is
/// scanned), verdicts (a result is a result), SLAB_BEGIN and SLAB_END (they move no robot). ENABLE and the heartbeat
/// arrive at once: they are levels, written again and again. A second commander who reads before the PLC has commanded
/// this process of slabd would be believed: who may command at all is for the list of addresses.
namespace slabd::handshake {

constexpr std::size_t kStations = 2;

/// The rules, each of which can be taken away.
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
  bool one_connection_commands = true;           ///< a block over another one changes the session and is refused
  bool never_scans_by_itself = true;             ///< an order that a death cut off is not taken up again
  bool session_changes_when_heard_again = true;  ///< when the PLC's heartbeat was lost
  // the PLC's
  bool robot_waits_for_acquired = true;    ///< before it leaves
  bool restarted_plc_waits = true;         ///< until slabd is not BUSY, before it moves the robot
  bool number_follows_ack = true;          ///< CMD_SEQ is made from CMD_ACK, not from a count of the PLC's own
  bool result_is_stored_first = true;      ///< and acknowledged second
  bool synchronises = true;                ///< SYNC_REQ after its own start
  bool given_up_means_synchronise = true;  ///< SYNC_REQ when an order was given up or the line taken in hand
};

constexpr std::uint8_t kPlc = 1;
constexpr std::uint8_t kStranger = 2;

/// A command block: SCAN of a station.
struct Frame {
  std::uint16_t seq = 0;
  std::uint16_t session = 0;
  std::uint8_t station = 0;    ///< from 1; 0: no frame
  std::uint8_t writer = kPlc;  ///< whose connection
  bool operator==(const Frame&) const = default;
};

enum class Status : std::uint8_t { none, accepted, acquired, failed };
enum class Has : std::uint8_t { nothing, cloud, result };

/// slabd's half: what is in its database, and what the process knows and shows.
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
  std::uint8_t writer = 0;  ///< who commands; 0: nobody yet
  bool enable = true;       ///< as the PLC has written it
  bool heard = true;        ///< its heartbeat moves
  bool was_lost = false;
  std::uint16_t session = 65533;  ///< shown; 0: none yet
  std::uint16_t session_next = 65533;
  std::uint16_t ack = 65533;
  std::uint16_t acquired = 0;
  Status status = Status::none;
  Phase phase = Phase::idle;
  Frame command;  ///< being carried out
  Frame judged;   ///< the block last looked at
  std::array<bool, kStations> cloud_in_memory_only{};

  bool operator==(const Slabd&) const = default;
  [[nodiscard]] bool busy() const { return phase != Phase::idle; }

  // What happens to it. Each is a step that may be followed by the process's death.
  void receive(const Frame& frame, const Rules& rules);
  void synchronise(const Rules& rules);  ///< SYNC_REQ was changed
  void session_was_stored();
  void command_was_stored();
  void scan(const Rules& rules);  ///< points and pose are taken; they are written away
  void scan_failed();
  void scan_was_stored();
  void measured(std::size_t index);
  void acknowledged();  ///< the oldest result is with the PLC
  void die();
  void start(const Rules& rules);
  void lose_heartbeat();
  void hear_heartbeat(const Rules& rules);

 private:
  void change_session(const Rules& rules);
};

/// The PLC's half.
struct Plc {
  enum class Phase : std::uint8_t { started, synchronising, homing, choosing, commanding, awaiting, in_hand, finished };
  Phase phase = Phase::started;
  std::uint16_t session_before = 0;
  std::uint16_t own_count = 65533;
  Frame command;  ///< its memory of the block it wrote
  std::uint8_t target = 0;
  std::uint8_t to_store = 0;             ///< acknowledged, not yet stored (without result_is_stored_first)
  std::array<bool, kStations> stored{};  ///< in retentive memory
  bool operator==(const Plc&) const = default;
};

struct World {
  Slabd slabd;
  Plc plc;
  std::uint8_t robot = 0;              ///< station it stands at; 0: home
  std::array<bool, kStations> left{};  ///< the robot has gone on, believing the scan to be taken
  Frame wire;                          ///< on its way
  std::array<Frame, 2> old;            ///< sent before, any of which may come again
  Frame stranger;                      ///< of the second commander, not sent yet
  std::uint8_t deaths = 0;
  std::uint8_t repeats = 0;
  std::uint8_t failures = 0;
  std::uint8_t given_up = 0;
  std::uint8_t strangers = 0;
  bool operator==(const World&) const = default;
};

/// How much goes wrong at most.
struct Mishaps {
  std::uint8_t deaths = 3;          ///< of either side
  std::uint8_t repeats = 1;         ///< old blocks that come again
  std::uint8_t failures = 1;        ///< scans that come to nothing
  std::uint8_t given_up = 0;        ///< orders given up, lines taken in hand
  std::uint8_t strangers = 0;       ///< blocks of a second commander
  bool deaths_are_noticed = false;  ///< slabd misses the heartbeat of every PLC that dies
};

struct Finding {
  std::size_t states = 0;
  std::string violation;           ///< empty: none
  std::vector<std::string> story;  ///< the shortest way to it
};

/// Looks at every state. A violation is a scan of a station at which the robot does not stand, a station left behind
/// without a durable scan, a result that neither side has, or a state from which the slab cannot be finished although
/// nothing more goes wrong.
[[nodiscard]] Finding explore(const Rules& rules, const Mishaps& mishaps);

}  // namespace slabd::handshake
