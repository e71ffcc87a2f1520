// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <atomic>
#include <iosfwd>
#include <vector>

#include "emulator/robot_peer.h"
#include "emulator/scanner_peer.h"
#include "emulator/slab_scene.h"

/// Robot and scanner for somebody else's PLC: a real one on the bench, or a test's. Orders come as lines of text, each
/// is answered with one:
///
///   slab N       the N-th slab (from 1) lies in the cell             -> "slab N"
///   station K    the robot goes to station K and stands there        -> "standing K"
///
/// Anything else is answered with "error: ..." and changes nothing.
namespace slabd::simulate {

struct StandBy {
  RobotPeer& robot;
  ScannerPeer& scanner;
  const Recipe& recipe;
  const Cell& cell;
  const std::vector<SlabTruth>& slabs;
};

/// Obeys until the end of `in`, or until `stop` and one more line.
void stand_by(const StandBy& line, std::istream& in, std::ostream& out, const std::atomic<bool>& stop);

}  // namespace slabd::simulate
