// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "cli/command.h"
#include "hal/plc/plc_map.h"

/// `slabctl plc`: tools for PLC integrators. The tables are generated from the daemon's register table and codes; a
/// test compares them with docs/PLC.md.
namespace slabd::cli {

void add_plc_monitor(args::Command& plc);
void add_plc_command(args::Command& plc);

/// Both memories at the same time.
struct PlcRegisters {
  hal::HoldingImage holding{};
  hal::InputImage input{};
  hal::WordOrder order = hal::WordOrder::abcd;
  std::string from;     ///< "Modbus/TCP 127.0.0.1:1502, unit 1"
  std::string trouble;  ///< fault of the daemon's link to the PLC; empty if there is none
};
/// Registers from the daemon that listens on this control socket, for every role. Code::scanner_offline: it does not
/// answer, or does not support the request.
[[nodiscard]] Result<PlcRegisters> plc_registers(const std::string& control_socket);
/// The same; over Modbus if the daemon is a server and its control socket does not answer.
[[nodiscard]] Result<PlcRegisters> plc_registers(const config::Config& config);

/// Both memories of register map 1.1 as Markdown tables.
[[nodiscard]] std::string register_markdown();
/// The same with one register or bit a line, for import into a PLC's tag list.
[[nodiscard]] std::string register_csv();
/// Every code of CMD_STATUS, REFUSE_CODE, FAULT and REASON with its cure, as a Markdown table.
[[nodiscard]] std::string code_markdown();

}  // namespace slabd::cli
