// SPDX-License-Identifier: Apache-2.0
#include "tests/sim/faults.h"

namespace slabd::sim {

std::string_view name(Fault fault) {
  constexpr std::array<std::string_view, kFaults> kNames = {"modbus drop",
                                                            "modbus duplicate",
                                                            "modbus reorder",
                                                            "modbus delay",
                                                            "modbus garbage",
                                                            "modbus exception",
                                                            "modbus half-open",
                                                            "modbus stale transaction",
                                                            "scanner stall",
                                                            "scanner truncated",
                                                            "scanner empty",
                                                            "scanner NaN",
                                                            "scanner duplicate",
                                                            "scanner wrong block",
                                                            "scanner late",
                                                            "scanner frozen",
                                                            "LCM loss",
                                                            "LCM duplicate",
                                                            "LCM reorder",
                                                            "LCM old timestamps",
                                                            "LCM wrong fingerprint",
                                                            "robot moves",
                                                            "clock ahead 1 h",
                                                            "clock back 1 h",
                                                            "monotonic stall",
                                                            "process pause",
                                                            "ENOSPC",
                                                            "EIO",
                                                            "EROFS",
                                                            "fsync failure",
                                                            "slow disk",
                                                            "torn write",
                                                            "spool full",
                                                            "allocation before seal",
                                                            "kill",
                                                            "kill at a write",
                                                            "power loss",
                                                            "config reload",
                                                            "config broken",
                                                            "control flood",
                                                            "calibration views",
                                                            "slow measuring",
                                                            "measuring refuses",
                                                            "PLC restart",
                                                            "PLC ABORT",
                                                            "PLC SLAB_ABORT",
                                                            "PLC not enabled",
                                                            "PLC REPORT",
                                                            "PLC scans again",
                                                            "PLC goes on elsewhere"};
  return kNames[static_cast<std::size_t>(fault)];
}

std::string_view state_name(std::size_t state) {
  constexpr std::array<std::string_view, kStates> kNames = {
      "init",     "recover",         "idle",  "slab open",   "settling",
      "scanning", "waiting for PLC", "fault", "maintenance", "down"};
  return kNames[state];
}

void Totals::add(const Totals& other) {
  seeds += other.seeds;
  failed += other.failed;
  simulated_ns += other.simulated_ns;
  turns += other.turns;
  commits += other.commits;
  restarts += other.restarts;
  power_losses += other.power_losses;
  slabs_begun += other.slabs_begun;
  slabs_judged += other.slabs_judged;
  blocks_passed += other.blocks_passed;
  passes += other.passes;
  passes_taken += other.passes_taken;
  wrong_passes += other.wrong_passes;
  rows_checked += other.rows_checked;
  lost_rows += other.lost_rows;
  stuck += other.stuck;
  scans += other.scans;
  scans_by_second += other.scans_by_second;
  for (std::size_t f = 0; f < kFaults; ++f)
    for (std::size_t s = 0; s < kStates; ++s) injected[f][s] += other.injected[f][s];
}

}  // namespace slabd::sim
