// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "cli/command.h"
#include "hal/plc/plc_map.h"

/// `slabctl plc`: what an integrator of the PLC needs. The tables come from the daemon's own register table and codes,
/// so that documentation and program cannot differ; a test compares them with docs/PLC.md.
namespace slabd::cli {

void add_plc_monitor(args::Command& plc);

/// Both memories at one moment.
struct PlcRegisters {
  hal::HoldingImage holding{};
  hal::InputImage input{};
  hal::WordOrder order = hal::WordOrder::abcd;
  std::string from;     ///< "Modbus/TCP 127.0.0.1:1502, unit 1"
  std::string trouble;  ///< of the daemon's own link to the PLC; empty while there is none
};
/// As the daemon that listens on this control socket sees them; works with every role. scanner_offline: it does not
/// answer, or does not know the question.
[[nodiscard]] Result<PlcRegisters> plc_registers(const std::string& control_socket);

/// Both memories of register map 1.0 as Markdown tables.
[[nodiscard]] std::string register_markdown();
/// The same, one register or bit a line, for import into a PLC's tag list.
[[nodiscard]] std::string register_csv();
/// Every code of CMD_STATUS, REFUSE_CODE, FAULT and REASON with its cure, as a Markdown table.
[[nodiscard]] std::string code_markdown();

}  // namespace slabd::cli
