// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <atomic>
#include <functional>
#include <iosfwd>
#include <string>
#include <vector>

#include "base/arm.h"
#include "base/base.h"
#include "emulator/gauge_peer.h"
#include "emulator/plc_peer.h"
#include "emulator/robot_peer.h"
#include "emulator/scanner_peer.h"
#include "emulator/slab_scene.h"

/// The line's program for one slab: SLAB_BEGIN, move and SCAN for each station, SLAB_END, wait for the verdict. It
/// does the same as the PLC program of a real line, with emulated peers instead of the machines.
///
/// The station decides which robot moves. If its scanner or robot fails there and another arm may scan the station, the
/// failed robot moves aside and the other one scans this station, and every further one that it may scan.
namespace slabd::emulator {

struct SlabOrder {
  std::uint32_t slab_no = 0;
  std::string slab_id;
  std::uint16_t slab_type = 0;
  std::uint16_t mould = 0;           ///< sent by the PLC; 0: unknown
  std::uint16_t temperature_dk = 0;  ///< 0.1 K; 0: not known to the PLC
};

/// One station as the line saw it. Times in s; negative: did not happen.
struct StationRun {
  int scans = 0;              ///< SCAN commands given
  std::size_t arm = 0;        ///< arm that moved there for the last one
  std::uint16_t cmd_seq = 0;  ///< of the last one
  std::string trouble;        ///< reason for the failure of the last SCAN
  double trigger_to_acquired_s = -1.0;
  double acquired_to_result_s = -1.0;
  bool has_record = false;
  PlcResult record;
};

struct SlabRun {
  SlabOrder order;
  bool finished = false;   ///< a slab verdict was shown
  bool continued = false;  ///< the slab was already open: finished stations were skipped
  PlcTrouble trouble;      ///< reason for an unfinished slab
  std::array<StationRun, limits::kStationsMax> station{};
  std::array<PlcStationRow, limits::kStationsMax> table{};  ///< as read by the PLC at the end
  Verdict verdict = Verdict::none;
  std::uint16_t reason = 0;
  PlcResult record;                          ///< of the slab
  double last_acquired_to_verdict_s = -1.0;  ///< as seen by the PLC; resolution of a PLC cycle
  double total_s = 0.0;
};

/// A robot with its scanner.
struct ArmPeers {
  RobotPeer* robot = nullptr;
  ScannerPeer* scanner = nullptr;
};

/// A planted failure: the scanner of this arm loses its power when its robot has reached this station.
struct ScannerFailure {
  std::size_t arm = 0;
  int station = 0;  ///< 0: none
};

struct Line {
  PlcPeer& plc;
  const std::vector<ArmPeers>& arms;  ///< as in LineArms::list
  const LineArms& stations;           ///< which arms may scan a station
  const Recipe& recipe;
  const Cell& cell;
  int scans_per_station_max = 3;
  PlcTraits timing;
  std::function<void(int station, std::string_view doing)> progress;
  GaugePeer* gauges = nullptr;  ///< absent: the line has none
  ScannerFailure failure{};
};

/// Runs one slab. Never discards the slab: a station that cannot be scanned is skipped after its attempts, and slabd's
/// verdict takes that into account.
[[nodiscard]] SlabRun run_slab(const Line& line, const SlabOrder& order, const SlabTruth& truth);

// Robot and scanner for an external PLC: a real one on the bench, or a test. Orders are lines of text, each with one
// line as the answer:
//
//   slab N           the N-th slab (from 1) is in the cell                   -> "slab N"
//   station K        the station's robot moves to station K and stops there  -> "standing K"
//   station K ROBOT  the robot with this id does; the others move aside      -> "standing K"
//
// Any other line is answered with "error: ..." and changes nothing.

struct StandBy {
  const std::vector<ArmPeers>& arms;
  const LineArms& stations;
  const Recipe& recipe;
  const Cell& cell;
  const std::vector<SlabTruth>& slabs;
};

/// The first station that an arm usually scans; 0: none.
[[nodiscard]] int first_station(const LineArms& line, std::size_t arm, int stations);

/// Executes orders until the end of `in`, or until `stop` and one more line.
void stand_by(const StandBy& line, std::istream& in, std::ostream& out, const std::atomic<bool>& stop);

}  // namespace slabd::emulator
