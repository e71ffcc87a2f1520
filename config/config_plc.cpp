// SPDX-License-Identifier: Apache-2.0
//
// [plc] -> PlcSettings. One table for three roles. A key that the role does not use is rejected, because its author
// would expect an effect.
#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <cassert>

#include "config/config_parts.h"

namespace slabd::config {
namespace {

/// Default slave address on a serial line: not 1, which is the factory setting of every device.
constexpr std::int64_t kRtuUnitId = 17;

/// Rejects keys of another role: they would have no effect.
void refuse_keys_of_other_roles(TableReader& plc, hal::PlcRole role) {
  struct RoleKey {
    const char* key;
    hal::PlcRole role;
  };
  using enum hal::PlcRole;
  static constexpr std::array kKeys = {
      RoleKey{"listen", server},     RoleKey{"allow", server},         RoleKey{"read_only", server},
      RoleKey{"connect", client},    RoleKey{"command_base", client},  RoleKey{"status_base", client},
      RoleKey{"read_write", client}, RoleKey{"registers_max", client}, RoleKey{"keep_connection", client},
      RoleKey{"poll_ms", client},    RoleKey{"timeout_ms", client},    RoleKey{"device", rtu},
      RoleKey{"baud", rtu},          RoleKey{"parity", rtu},           RoleKey{"stop_bits", rtu},
      RoleKey{"rs485", rtu}};
  for (const RoleKey& entry : kKeys)
    if (entry.role != role && plc.has(entry.key))
      plc.problem(entry.key, fmt::format("has no meaning with role = \"{}\"; it belongs to role = \"{}\"",
                                         hal::kPlcRoles.at(static_cast<std::size_t>(role)),
                                         hal::kPlcRoles.at(static_cast<std::size_t>(entry.role))));
}

/// Reads the base addresses of the 40 and the 110 registers in the PLC's memory.
void read_bases(TableReader& plc, hal::PlcSettings& out) {
  std::int64_t command = out.command_base;
  std::int64_t status = out.status_base;
  plc.optional_integer("command_base", command, 0, 65'536 - 40);
  plc.optional_integer("status_base", status, 0, 65'536 - 110);
  if (command < status + 110 && status < command + 40)
    plc.problem(plc.has("status_base") ? "status_base" : "command_base",
                fmt::format("the 110 registers from {} on and the 40 of command_base = {} overlap", status, command));
  out.command_base = static_cast<std::uint16_t>(command);
  out.status_base = static_cast<std::uint16_t>(status);
}

void read_client(TableReader& plc, hal::PlcSettings& out) {
  out.host.clear();  // clear the server's default address
  if (!plc.has("connect")) plc.missing("connect", "the PLC, \"address:port\"");
  read_endpoint(plc, "connect", 1, out.host, out.port);
  read_bases(plc, out);
  plc.optional_boolean("read_write", out.read_write);
  // FC 23 reads the PLC's 40 registers in one request. With gauges there are 75: if the PLC allows fewer, FC 3 reads.
  std::int64_t registers_max = out.registers_max;
  plc.optional_integer("registers_max", registers_max, out.read_write ? 40 : hal::kPlcRegistersMin,
                       hal::kPlcRegistersMax);
  out.registers_max = static_cast<std::uint16_t>(registers_max);
  plc.optional_boolean("keep_connection", out.keep_connection);
  read_ms(plc, "poll_ms", out.poll_ns, {10.0, 500.0});
  read_ms(plc, "timeout_ms", out.timeout_ns, {50.0, 2'000.0});
}

void read_serial(TableReader& plc, hal::PlcSettings& out) {
  if (!plc.has("device")) plc.missing("device", "the serial line, such as \"/dev/ttyS0\"");
  read_text(plc, "device", out.device);
  if (!out.device.empty() && !out.device.view().starts_with('/'))
    plc.problem("device", fmt::format("found \"{}\", allowed is a path such as \"/dev/ttyS0\"", out.device.view()));
  std::int64_t baud = out.baud;
  plc.optional_integer("baud", baud, hal::kSerialBauds.front(), hal::kSerialBauds.back());
  if (std::find(hal::kSerialBauds.begin(), hal::kSerialBauds.end(), baud) == hal::kSerialBauds.end())
    plc.problem("baud", fmt::format("found {}, allowed are {}", baud, fmt::join(hal::kSerialBauds, ", ")));
  out.baud = static_cast<std::uint32_t>(baud);
  std::size_t parity = static_cast<std::size_t>(out.parity);
  plc.optional_word("parity", parity, {"even", "odd", "none"});
  out.parity = static_cast<hal::SerialParity>(parity);
  std::int64_t stop_bits = out.stop_bits;
  plc.optional_integer("stop_bits", stop_bits, 1, 2);
  out.stop_bits = static_cast<std::uint8_t>(stop_bits);
  plc.optional_boolean("rs485", out.rs485);
}

}  // namespace

void read_endpoint(TableReader& table, std::string_view key, unsigned port_min, FixedString<64>& host_out,
                   std::uint16_t& port_out) {
  std::string endpoint;
  table.optional_text(key, endpoint, 64);
  if (endpoint.empty()) return;
  const std::size_t colon = endpoint.rfind(':');
  const std::string port = colon == std::string::npos ? "" : endpoint.substr(colon + 1);
  const bool digits = !port.empty() && port.size() <= 5 && port.find_first_not_of("0123456789") == std::string::npos;
  if (!digits || colon == 0 || std::stoul(port) > 65'535 || std::stoul(port) < port_min) {
    table.problem(key,
                  fmt::format("found \"{}\", allowed is \"address:port\" with port {}..65535", endpoint, port_min));
    return;
  }
  const std::string_view host = std::string_view(endpoint).substr(0, colon);
  if (host.find('/') != std::string_view::npos || !hal::parse_network(host).ok()) {
    table.problem(key,
                  fmt::format("found \"{}\", allowed is an IPv4 address before the port, such as 127.0.0.1", endpoint));
    return;
  }
  host_out.assign(host);
  port_out = static_cast<std::uint16_t>(std::stoul(port));
}

void read_networks(TableReader& plc, std::string_view key, FixedVector<hal::PlcSettings::Network, 16>& out) {
  const TomlValue* list = plc.value(key);
  if (list == nullptr) return;
  const std::size_t capacity = out.capacity();
  if (list->kind != TomlValue::Kind::array || list->items.empty() || list->items.size() > capacity) {
    plc.problem(
        key, fmt::format("found {}, allowed is a list of 1..{} networks like \"10.0.0.0/8\"", found(*list), capacity));
    return;
  }
  out.clear();
  for (const TomlValue& item : list->items) {
    if (item.kind != TomlValue::Kind::text) {
      plc.problem_at(item, key, fmt::format("found {}, allowed is a network like \"10.0.0.0/8\"", found(item)));
      continue;
    }
    const Result<hal::PlcSettings::Network> network = hal::parse_network(item.text);
    if (!network.ok()) {
      plc.problem_at(item, key, fmt::format("found {}: {}", found(item), network.error().text.view()));
      continue;
    }
    const bool room = out.push(network.value());
    assert(room);
    static_cast<void>(room);
  }
}

void read_plc(TableReader plc, hal::PlcSettings& out) {
  std::size_t role = 0;
  plc.optional_word("role", role, {hal::kPlcRoles.begin(), hal::kPlcRoles.end()});
  out.role = static_cast<hal::PlcRole>(role);
  // Modbus over serial line V1.02, 2.2; a PLC connected directly by TCP may also use 0 or 255 (TCP/IP V1.0b, 4.4.2.3).
  const bool client = out.role == hal::PlcRole::client;
  std::int64_t unit_id = out.role == hal::PlcRole::rtu ? kRtuUnitId : out.unit_id;
  plc.optional_integer("unit_id", unit_id, client ? 0 : 1, client ? 255 : 247);
  if (unit_id > 247 && unit_id != 255)
    plc.problem("unit_id", fmt::format("found {}, allowed is 0..247 or 255", unit_id));
  out.unit_id = static_cast<std::uint8_t>(unit_id);
  std::size_t order = out.word_order == hal::WordOrder::abcd ? 0 : 1;
  plc.optional_word("word_order", order, {"abcd", "cdab"});
  out.word_order = order == 0 ? hal::WordOrder::abcd : hal::WordOrder::cdab;
  refuse_keys_of_other_roles(plc, out.role);
  switch (out.role) {
    case hal::PlcRole::server:
      read_endpoint(plc, "listen", 0, out.host, out.port);
      read_networks(plc, "allow", out.allow);
      read_networks(plc, "read_only", out.read_only);
      break;
    case hal::PlcRole::client: read_client(plc, out); break;
    case hal::PlcRole::rtu: read_serial(plc, out); break;
  }
  plc.finish();
}

}  // namespace slabd::config
