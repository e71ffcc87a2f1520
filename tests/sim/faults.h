// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <string_view>

#include "base/plc.h"

/// Faults of a simulated life, and the states of slabd in which they occurred.
namespace slabd::sim {

enum class Fault : std::uint8_t {
  // the Modbus link
  modbus_drop,
  modbus_duplicate,
  modbus_reorder,
  modbus_delay,
  modbus_garbage,
  modbus_exception,
  modbus_half_open,
  modbus_stale_transaction,
  // the scanner
  scanner_stall,
  scanner_truncated,
  scanner_empty,
  scanner_nan,
  scanner_duplicate,
  scanner_wrong_block,
  scanner_late,
  scanner_frozen,
  // the robot and its poses
  lcm_loss,
  lcm_duplicate,
  lcm_reorder,
  lcm_old_time,
  lcm_wrong_fingerprint,
  robot_moves,
  // clocks
  clock_ahead,
  clock_back,
  clock_stall,
  process_pause,
  // the disk
  disk_full,
  disk_eio,
  disk_read_only,
  disk_fsync,
  disk_slow,
  torn_write,
  spool_full,
  // the process
  allocation,
  kill,
  kill_at_write,
  power_loss,
  config_reload,
  config_broken,
  control_flood,
  capture,
  measure_slow,
  measure_refuses,  ///< measuring reports that the scan is of another exposure
  // the PLC
  plc_restart,
  plc_abort,
  plc_slab_abort,
  plc_disable,
  plc_report,
  plc_rescan,
  plc_elsewhere,  ///< only in clusters of faults (life.cpp)
  count
};
inline constexpr std::size_t kFaults = static_cast<std::size_t>(Fault::count);
/// The first ones, which may occur alone.
inline constexpr std::size_t kLoneFaults = static_cast<std::size_t>(Fault::plc_elsewhere);
[[nodiscard]] std::string_view name(Fault fault);

/// States 0..8 of the register map, and "no process".
inline constexpr std::size_t kStates = 10;
inline constexpr std::size_t kStateDown = 9;
[[nodiscard]] std::string_view state_name(std::size_t state);

/// Figures of one life, or sums of many; plain numbers, added member by member.
struct Totals {
  std::uint64_t seeds = 0;
  std::uint64_t failed = 0;
  std::int64_t simulated_ns = 0;
  std::uint64_t turns = 0;
  std::uint64_t commits = 0;
  std::uint64_t restarts = 0;
  std::uint64_t power_losses = 0;
  std::uint64_t slabs_begun = 0;
  std::uint64_t slabs_judged = 0;
  std::uint64_t blocks_passed = 0;
  std::uint64_t passes = 0;
  std::uint64_t passes_taken = 0;  ///< verdicts "pass" on which the PLC let a slab go
  std::uint64_t wrong_passes = 0;
  std::uint64_t rows_checked = 0;
  std::uint64_t lost_rows = 0;
  std::uint64_t stuck = 0;
  std::uint64_t scans = 0;
  std::uint64_t scans_by_second = 0;  ///< of them by the second robot
  std::array<std::array<std::uint64_t, kStates>, kFaults> injected{};

  void add(const Totals& other);
};

}  // namespace slabd::sim
