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

/// The scanner's half of the line: a thread that answers each request through its outlet with a scan of the block
/// before the scanner.
///
/// Drawing and writing a scan takes longer than delivering it, so the next station's scan is prepared while the daemon
/// measures. A request without a prepared scan is drawn at once.
namespace slabd::emulator {

/// Faults of scanner programs that deliver a scan other than the requested one.
struct ScannerFault {
  bool frame_before = false;  ///< double buffer: delivers the previous frame, then takes the current one
  int one_block = 0;          ///< every scan is a new one of this block; 0: off
  int given_again = 0;  ///< this station is answered with the previous exposure, without grid, in reverse order; 0: off
  int loop = 0;         ///< after N scans these are repeated in their order; 0: off
};
/// Parses "", "frame-before", "one-block=K", "given-again=K", "loop=N". Code::config for any other text.
[[nodiscard]] Result<ScannerFault> parse_scanner_fault(std::string_view text);

class ScannerPeer {
 public:
  [[nodiscard]] static Result<std::unique_ptr<ScannerPeer>> start(const ScannerTraits& traits,
                                                                  std::unique_ptr<ScanOutlet> outlet,
                                                                  const ScannerFault& fault = {});
  ~ScannerPeer();
  ScannerPeer(const ScannerPeer&) = delete;
  ScannerPeer& operator=(const ScannerPeer&) = delete;

  /// Sets the content of the cell, and the arm that carries this scanner; all references must outlive the peer or the
  /// next call.
  void look_at(const Recipe& recipe, const SlabTruth& slab, const Cell& cell, std::size_t arm = 0);
  /// Sets the block before the scanner and the next one (0: none, no scan is drawn in advance).
  void stand_over(int station, int next_station);

  /// The scanner loses its power: it drops its connection and answers no request from now on.
  void switch_off();

  [[nodiscard]] std::uint64_t delivered() const;
  /// True flatness of a block of real concrete of the slab in the cell; NaN: not drawn, or a polyhedron.
  [[nodiscard]] double flatness_mm(int station) const;
  /// The last error; empty if there was none.
  [[nodiscard]] std::string trouble() const;

 private:
  struct Impl;
  explicit ScannerPeer(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace slabd::emulator
