// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <string>

#include "hal/hal.h"
#include "hal/plc/plc_map.h"

/// How the emulated PLC and slabd exchange registers: the PLC asks slabd's server (TCP or serial line), or slabd asks
/// the PLC, which then holds both memories itself. What a PLC program does is the same.
namespace slabd::simulate {

class PlcWire {
 public:
  virtual ~PlcWire() = default;
  /// Connects, or connects anew. False with the reason in fault().
  [[nodiscard]] virtual bool open() = 0;
  /// Nothing is connected any more: a late answer would otherwise be taken for the next one's.
  virtual void close() = 0;
  /// IR 0..109. False: the link is broken, or slabd has written nothing yet.
  [[nodiscard]] virtual bool read(hal::InputImage& image) = 0;
  /// `count` registers of `image` from HR `first` on.
  [[nodiscard]] virtual bool write(int first, int count, const hal::HoldingImage& image) = 0;
  /// HR 3 as it stands in the memory that slabd reads.
  [[nodiscard]] virtual bool read_sync(std::uint16_t& value) = 0;
  /// Why the last call failed, with what to look at.
  [[nodiscard]] virtual std::string fault() const = 0;
  /// Where slabd is: "127.0.0.1:1502", "/dev/ttyS1".
  [[nodiscard]] virtual std::string name() const = 0;
};

/// `plc`: the daemon's settings, of which this is the other end. `device`: the other end of the serial line (rtu only).
/// config when the PLC's server cannot listen at plc.connect.
[[nodiscard]] Result<std::unique_ptr<PlcWire>> make_plc_wire(const hal::PlcSettings& plc, const std::string& device);

}  // namespace slabd::simulate
