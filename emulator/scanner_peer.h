// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <memory>
#include <string>
#include <string_view>

#include "base/base.h"
#include "emulator/scan_drawing.h"
#include "emulator/scan_outlet.h"
#include "emulator/slab_scene.h"
#include "hal/hal.h"

/// The scanner's half of the line: a thread that answers each request with a scan of what stands before the scanner
/// then, by the outlet it was given.
///
/// A scan takes longer to draw and to write than to deliver, so the next station's scan is made ready while the daemon
/// measures. A request for which nothing fits is drawn on the spot.
namespace slabd::simulate {

/// What scanner programs do that give another scan than the one that was asked for.
struct ScannerFault {
  bool frame_before = false;  ///< a double buffer: the frame of the request before, then it takes this one's
  int one_block = 0;          ///< every scan is a new one of this block; 0: no
  int given_again = 0;        ///< a station answered with the exposure before, without grid, in reverse order; 0: none
  int loop = 0;               ///< after so many scans those are given again, in their order; 0: no
};
/// "", "frame-before", "one-block=K", "given-again=K", "loop=N". config: none of these.
[[nodiscard]] Result<ScannerFault> parse_scanner_fault(std::string_view text);

class ScannerPeer {
 public:
  [[nodiscard]] static Result<std::unique_ptr<ScannerPeer>> start(const ScannerTraits& traits,
                                                                  std::unique_ptr<ScanOutlet> outlet,
                                                                  const ScannerFault& fault = {});
  ~ScannerPeer();
  ScannerPeer(const ScannerPeer&) = delete;
  ScannerPeer& operator=(const ScannerPeer&) = delete;

  /// What lies in the cell from now on; all three must outlive the peer or the next call.
  void look_at(const Recipe& recipe, const SlabTruth& slab, const Cell& cell);
  /// Which block is before the scanner, and which will be next (0 = none, nothing is drawn ahead).
  void stand_over(int station, int next_station);

  [[nodiscard]] std::uint64_t delivered() const;
  /// True flatness of a block of real concrete that was drawn of the slab in the cell; NaN: not drawn, or a polyhedron.
  [[nodiscard]] double flatness_mm(int station) const;
  /// The last thing that went wrong; empty while all is well.
  [[nodiscard]] std::string trouble() const;

 private:
  struct Impl;
  explicit ScannerPeer(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace slabd::simulate
