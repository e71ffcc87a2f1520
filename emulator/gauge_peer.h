// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <string_view>

#include "base/base.h"

/// The gauges of the emulated line: instruments (Modbus), a hub (UDP), and the numbers that the PLC forwards. Which
/// dimension a gauge measures follows from the recipe's formulas. `manual` gauges are silent.
namespace slabd::emulator {

/// One fault, played with every slab.
struct GaugeFault {
  enum class Kind : std::uint8_t {
    none,
    stuck,     ///< the gauge always gives the value of the first slab
    swapped,   ///< two gauges give each other's value
    late,      ///< the PLC's values, or this gauge's, come after SLAB_END
    unit,      ///< metres instead of mm
    previous,  ///< the value names the slab before
    missing,   ///< no value
  };
  Kind kind = Kind::none;
  GaugeName gauge;
  GaugeName other;  ///< swapped
};
/// Parses "stuck=NAME", "swapped=NAME,NAME", "late=NAME", "unit=NAME", "previous=NAME" or "missing=NAME"; an empty text
/// gives Kind::none. config: the text names what is allowed.
[[nodiscard]] Result<GaugeFault> parse_gauge_fault(std::string_view text, const GaugeList& gauges);

/// Values that the PLC forwards.
struct PlcGauges {
  bool any = false;  ///< the line has gauges of the PLC
  bool late = false;
  std::uint32_t slab_no = 0;
  std::array<std::int32_t, limits::kGaugesMax> thousandths{};
};

class GaugePeer {
 public:
  /// Starts the servers of the Modbus instruments. config: one cannot listen at its address.
  [[nodiscard]] static Result<std::unique_ptr<GaugePeer>> start(const GaugeList& gauges, const Recipe& recipe,
                                                                const GaugeFault& fault, std::uint64_t seed);
  ~GaugePeer();
  GaugePeer(const GaugePeer&) = delete;
  GaugePeer& operator=(const GaugePeer&) = delete;

  /// Gauges the slab: the instruments show its values, the hub sends them, and the PLC's are returned.
  PlcGauges measure(std::uint32_t slab_no);
  /// Sends what a fault has held back, after SLAB_END.
  void send_late();
  /// The number of a gauge of the last slab, in its unit, without a fault.
  [[nodiscard]] double true_value(std::string_view gauge) const;

 private:
  struct Impl;
  explicit GaugePeer(std::unique_ptr<Impl> impl);
  std::unique_ptr<Impl> impl_;
};

}  // namespace slabd::emulator
