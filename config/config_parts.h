// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cmath>
#include <string>
#include <vector>

#include "config/config.h"
#include "config/toml_reader.h"

/// Internal functions shared by the readers of slabd.toml.
namespace slabd::config {

template <std::size_t Capacity>
void read_text(TableReader& table, std::string_view key, FixedString<Capacity>& out) {
  std::string text(out.view());
  table.optional_text(key, text, Capacity);
  out.assign(text);
}

/// Reads a time in ms from the file and stores it in ns.
inline void read_ms(TableReader& table, std::string_view key, std::int64_t& out_ns, Allowed allowed_ms) {
  double time_ms = static_cast<double>(out_ns) / 1e6;
  table.optional_number(key, time_ms, allowed_ms);
  out_ns = std::llround(time_ms * 1e6);
}

/// Reads "127.0.0.1:1502" into host and port; the port must be at least `port_min`.
void read_endpoint(TableReader& table, std::string_view key, unsigned port_min, FixedString<64>& host,
                   std::uint16_t& port);

/// Reads a list of IPv4 networks or addresses; `out` is unchanged if the key is absent.
void read_networks(TableReader& table, std::string_view key, FixedVector<hal::PlcSettings::Network, 16>& out);

/// Reads a path. A relative path starts at the configuration's folder, independent of the daemon's working directory.
void read_path(TableReader& table, std::string_view key, const std::string& folder, std::string& out);

/// Reads [web]; every fault is a problem of the table.
void read_web(TableReader web, const std::string& folder, WebSettings& out);

/// Reads [plant]; every fault is a problem of the table.
void read_plant(TableReader plant, const std::string& folder, PlantSettings& out);

/// Reads [genicam]; every fault is a problem of the table.
/// `scanner`: id of the scanner that the camera is; empty: not given.
void read_genicam(TableReader genicam, GenicamSettings& out, std::string& scanner);

/// Reads all [[gauge]] and [gauges]; call it after read_plc. Faulty gauges are left out of `config`.
void read_gauges(TableReader& root, const std::string& path, std::vector<Problem>& problems, Config& config);

/// Reads [plc] as far as possible; every fault is a problem of the table.
void read_plc(TableReader plc, hal::PlcSettings& out);

/// The table of a robot or a scanner.
struct PartTable {
  PartId id;
  TableReader table;
  bool is_listed = false;  ///< [[robot]], not [robot]
};

/// The tables [[key]], or the single [key], whose id is "1"; at least one, at most kArmsMax.
[[nodiscard]] std::vector<PartTable> read_parts(TableReader& root, const char* key, const std::string& path,
                                                std::vector<Problem>& problems, std::vector<Problem>* doubts);
/// Reads [[station]]: the arms, and which of them scan which station.
void read_arms(TableReader& root, const std::string& path, const std::vector<PartTable>& robots,
               const std::vector<PartTable>& scanners, std::vector<Problem>& problems, LineArms& out);
/// Place of the part with this id; the first if there is none.
[[nodiscard]] std::size_t part_index(const std::vector<PartTable>& parts, const PartId& id);
/// Checks that the arms share no folder, port or channel.
void check_arms_together(const Config& config, std::vector<PartTable>& robots, std::vector<PartTable>& scanners);

/// True if `path` is `folder` or in it, also through links.
[[nodiscard]] bool lies_in(const std::string& path, const std::string& folder);

/// Checks relations between tables: paths inside one another, addresses used twice, times that do not match. Each fault
/// is a problem of one of the tables.
void check_together(TableReader& root, const Config& config, std::vector<PartTable>& scanners);

}  // namespace slabd::config
