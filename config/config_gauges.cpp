// SPDX-License-Identifier: Apache-2.0
//
// [[gauge]] -> GaugeSettings, and the relation of a recipe's formulas to them. Two gauges with one source, or a formula
// that names a gauge that is not there, would measure nothing or the wrong thing on the line, so both are faults here.
#include <fmt/format.h>

#include <algorithm>
#include <charconv>
#include <cmath>

#include "config/config_parts.h"

namespace slabd::config {
namespace {

constexpr int kGaugeRegisterFirst = 40;
constexpr int kGaugeRegisterLast = 70;
constexpr double kValidS = 600.0;  ///< an inspection takes some five minutes
constexpr const char* kSourceForms =
    R"("plc:40" to "plc:70" (even), "modbus:address:port/unit/register", "udp:port" or "operator")";

/// Number in decimal digits that fill the whole text; nullopt if it is not one, or larger than `high`.
std::optional<unsigned> whole_number(std::string_view text, unsigned high) {
  unsigned number = 0;
  const auto [end, fault] = std::from_chars(text.data(), text.data() + text.size(), number);
  if (text.empty() || fault != std::errc() || end != text.data() + text.size() || number > high) return std::nullopt;
  return number;
}

/// Parses "40" or "HR40".
bool parse_plc(std::string_view text, GaugeSettings& out) {
  if (text.starts_with("HR")) text.remove_prefix(2);
  const std::optional<unsigned> address = whole_number(text, kGaugeRegisterLast);
  if (!address || *address < kGaugeRegisterFirst || *address % 2 != 0) return false;
  out.plc_index = static_cast<std::uint8_t>((*address - kGaugeRegisterFirst) / 2);
  return true;
}

/// Parses "10.0.0.5:502/1/120".
bool parse_modbus(std::string_view text, GaugeSettings& out) {
  const std::size_t colon = text.find(':');
  const std::size_t first = text.find('/');
  const std::size_t second = first == std::string_view::npos ? first : text.find('/', first + 1);
  if (colon == std::string_view::npos || second == std::string_view::npos || colon > first) return false;
  const std::string_view host = text.substr(0, colon);
  const auto port = whole_number(text.substr(colon + 1, first - colon - 1), 65'535);
  const auto unit = whole_number(text.substr(first + 1, second - first - 1), 255);
  const auto address = whole_number(text.substr(second + 1), 65'535);
  if (!hal::parse_network(host).ok() || !port || *port == 0 || !unit || !address) return false;
  out.host.assign(host);
  out.port = static_cast<std::uint16_t>(*port);
  out.unit_id = static_cast<std::uint8_t>(*unit);
  out.address = static_cast<std::uint16_t>(*address);
  return true;
}

bool parse_udp(std::string_view text, GaugeSettings& out) {
  const auto port = whole_number(text, 65'535);
  if (!port || *port == 0) return false;
  out.port = static_cast<std::uint16_t>(*port);
  return true;
}

void read_source(TableReader& table, GaugeSettings& out) {
  std::string source;
  table.required_text("source", source, GaugeSource::capacity());
  if (source.empty()) return;
  out.source.assign(source);
  const std::string_view text = source;
  const auto after = [&](std::string_view word) {
    return text.starts_with(word) ? std::optional(text.substr(word.size())) : std::nullopt;
  };
  bool good = false;
  if (text == "operator") {
    out.link = GaugeLink::manual;
    good = true;
  } else if (const auto plc = after("plc:")) {
    out.link = GaugeLink::plc;
    good = parse_plc(*plc, out);
  } else if (const auto modbus = after("modbus:")) {
    out.link = GaugeLink::modbus;
    good = parse_modbus(*modbus, out);
  } else if (const auto udp = after("udp:")) {
    out.link = GaugeLink::udp;
    good = parse_udp(*udp, out);
  }
  if (!good) table.problem("source", fmt::format("found \"{}\", allowed is {}", source, kSourceForms));
}

/// Keys of the number in an instrument's registers.
void read_format(TableReader& table, hal::WordOrder plc_order, GaugeSettings& out) {
  std::size_t order = plc_order == hal::WordOrder::abcd ? 0 : 1;
  if (out.link != GaugeLink::modbus) {
    for (const char* key : {"format", "word_order", "registers"})
      if (table.has(key)) table.problem(key, "has no meaning with this source; it belongs to \"modbus:...\"");
    return;
  }
  auto format = static_cast<std::size_t>(out.format);
  table.optional_word("format", format, {kGaugeFormats.begin(), kGaugeFormats.end()});
  out.format = static_cast<GaugeFormat>(format);
  table.optional_word("word_order", order, {"abcd", "cdab"});
  out.low_word_first = order == 1;
  std::size_t registers = 0;
  table.optional_word("registers", registers, {"holding", "input"});
  out.input_register = registers == 1;
  if (out.address + registers_of(out.format) > 65'536)
    table.problem("source", fmt::format("found register {}, allowed with format {} is 0..65534", out.address,
                                        kGaugeFormats.at(format)));
}

void read_master(TableReader& table, GaugeSettings& out) {
  out.master.given = table.has("master");
  if (!out.master.given) {
    // The instrument of a person is checked where instruments are kept; all others have only this check.
    if (out.link != GaugeLink::manual)
      table.missing("master",
                    "{ value = 5600.012, u = 0.02, every_h = 12, limit = 0.1 }: a gauge that is never "
                    "checked measures nothing");
    return;
  }
  TableReader master = table.table("master");
  double every_h = kNoValue;
  master.required_number("value", out.master.value, {-1e5, 1e5});
  master.required_number("u", out.master.u, {0.0, 100.0});
  master.required_number("every_h", every_h, {0.01, 8'760.0});
  master.required_number("limit", out.master.limit, {1e-6, 100.0});
  if (has_value(every_h)) out.master.every_us = std::llround(every_h * 3.6e9);
  master.finish();
}

/// Reads the measuring range, in the unit of the gauge.
void read_range(TableReader& table, GaugeSettings& out) {
  const TomlValue* const value = table.value("range");
  if (value == nullptr) return;
  constexpr double kMost = 1e5;
  const bool two = value->kind == TomlValue::Kind::array && value->items.size() == 2;
  const std::optional<double> low = two ? as_number(value->items[0]) : std::nullopt;
  const std::optional<double> high = two ? as_number(value->items[1]) : std::nullopt;
  if (!low || !high || !(*low < *high) || !(*low >= -kMost) || !(*high <= kMost))
    return table.problem("range", fmt::format("found {}, allowed are two numbers from {} to {}, the smaller one first",
                                              found(*value), -kMost, kMost));
  out.low = *low;
  out.high = *high;
  if (out.master.given && !(out.master.value >= out.low && out.master.value <= out.high))
    table.problem("range", fmt::format("found {} to {}, allowed is a range that contains the master, {}", out.low,
                                       out.high, out.master.value));
}

/// Everything that decides which number a gauge gives.
std::string channel_of(const GaugeSettings& gauge) {
  std::string text(gauge.source.view());
  if (gauge.link == GaugeLink::modbus) {
    text += fmt::format(" {}", kGaugeFormats.at(static_cast<std::size_t>(gauge.format)));
    if (gauge.low_word_first) text += " cdab";
    if (gauge.input_register) text += " input";
  }
  if (gauge.scale != 1.0) text += fmt::format(" x{}", gauge.scale);
  return text;
}

void read_gauge(TableReader table, hal::WordOrder plc_order, GaugeSettings& out) {
  std::string name;
  table.required_text("name", name, limits::kGaugeNameBytes);
  if (!name.empty() && !is_gauge_name(name))
    table.problem("name", fmt::format("found \"{}\", allowed are up to {} lower-case letters, digits and '_', a letter "
                                      "first",
                                      name, limits::kGaugeNameBytes));
  out.name.assign(name);
  std::size_t unit = 0;
  if (!table.has("unit")) table.missing("unit", "\"mm\" or \"deg\"");
  table.optional_word("unit", unit, {"mm", "deg"});
  out.unit = static_cast<ItemUnit>(unit);
  read_source(table, out);
  read_format(table, plc_order, out);
  table.optional_number("scale", out.scale, {-1e6, 1e6});
  if (out.scale == 0.0) table.problem("scale", "found 0, allowed is any other number: every value would be 0");
  out.channel.assign(channel_of(out));
  table.required_number("u", out.u, {1e-6, 100.0});
  double valid_s = kValidS;
  table.optional_number("valid_s", valid_s, {1.0, 86'400.0});
  out.valid_ns = std::llround(valid_s * 1e9);
  read_master(table, out);
  read_range(table, out);
  table.finish();
}

bool is_same_source(const GaugeSettings& a, const GaugeSettings& b) {
  if (a.link != b.link) return false;
  if (a.link == GaugeLink::plc) return a.plc_index == b.plc_index;
  return a.link == GaugeLink::modbus && a.host == b.host && a.port == b.port && a.unit_id == b.unit_id &&
         a.address == b.address && a.input_register == b.input_register;
}

/// True if a check does not notice that the two are exchanged.
bool has_same_master(const GaugeSettings& a, const GaugeSettings& b) {
  return a.master.given && b.master.given && a.unit == b.unit && a.link == b.link &&
         std::abs(a.master.value - b.master.value) <= a.master.limit + b.master.limit;
}

}  // namespace

void read_gauges(TableReader& root, const std::string& path, std::vector<Problem>& problems, Config& config) {
  TableReader hubs = root.table("gauges");
  read_networks(hubs, "allow", config.gauge_senders);
  hubs.finish();
  const TomlValue* const list = root.value("gauge");
  if (list == nullptr) return;
  if (list->kind != TomlValue::Kind::array) {
    root.problem("gauge", "found one table, allowed are [[gauge]] tables, one of each gauge");
    return;
  }
  if (list->items.size() > limits::kGaugesMax) {
    root.problem("gauge", fmt::format("found {}, allowed are {}", list->items.size(), limits::kGaugesMax));
    return;
  }
  bool same_master_told = false;
  for (const TomlValue& item : list->items) {
    if (item.kind != TomlValue::Kind::table) {
      root.problem_at(item, "gauge", fmt::format("found {}, allowed is a table [[gauge]]", found(item)));
      continue;
    }
    GaugeSettings gauge;
    const std::size_t before = problems.size();
    TableReader table(path, &item, "gauge", problems);
    table.keep_doubts(&config.doubts);
    read_gauge(std::move(table), config.plc.word_order, gauge);
    for (const GaugeSettings& other : config.gauges) {
      if (problems.size() != before) break;
      if (other.name == gauge.name)
        root.problem_at(item, "gauge",
                        fmt::format("found two gauges {}, allowed is each name once", gauge.name.view()));
      else if (is_same_source(other, gauge))
        root.problem_at(item, "gauge",
                        fmt::format("found {} and {} with the same source, {}", other.name.view(), gauge.name.view(),
                                    gauge.source.view()));
      else if (has_same_master(other, gauge) && !std::exchange(same_master_told, true))
        root.doubt("gauge", fmt::format("found {} and {} with masters of the same size: their checks do not notice if "
                                        "the two are exchanged; allowed are masters that differ by more than both "
                                        "limits (docs/GAUGES.md)",
                                        other.name.view(), gauge.name.view()));
    }
    if (problems.size() == before && gauge.master.value == 0.0)
      root.doubt("gauge",
                 fmt::format("found {} with a master of 0: its check notices neither a wrong unit or scale nor "
                             "a sensor that always gives 0; allowed is a master near the values of a slab",
                             gauge.name.view()));
    if (problems.size() == before) static_cast<void>(config.gauges.push(gauge));
    config.plc.gauges = config.plc.gauges || gauge.link == GaugeLink::plc;
  }
  // As client, slabd reads the gauges behind the command block in the PLC's memory.
  constexpr int kRegisters = 75;
  const int command = config.plc.command_base;
  const int status = config.plc.status_base;
  const bool overlaps = command < status + 110 && status < command + kRegisters;
  if (config.plc.gauges && config.plc.role == hal::PlcRole::client && (overlaps || command + kRegisters > 65'536))
    root.problem("gauge", fmt::format("with source = \"plc:...\" the PLC has {} registers from plc.command_base {} on; "
                                      "they overlap the 110 from plc.status_base {} on, or end beyond 65535",
                                      kRegisters, command, status));
}

void check_formulas(const Recipe& recipe, std::span<const GaugeSettings> gauges, std::vector<Problem>& problems) {
  const auto fault = [&](ItemId id, const std::string& what) {
    problems.push_back(
        {fmt::format("{}:{}: items.{}.formula: {}", recipe.path.view(), recipe.formula(id).line, info(id).name, what)});
  };
  for (const ItemId id : kGaugeItemIds) {
    for (const GaugeName& name : recipe.formula(id).gauges) {
      const auto of_name = [&](const GaugeSettings& gauge) { return gauge.name == name; };
      const auto gauge = std::find_if(gauges.begin(), gauges.end(), of_name);
      if (gauge == gauges.end()) {
        std::string known;
        for (const GaugeSettings& other : gauges) known += (known.empty() ? "" : ", ") + std::string(other.name.view());
        fault(id, fmt::format("names the gauge {}, allowed are the [[gauge]] of the configuration: {}", name.view(),
                              known.empty() ? "there are none" : known));
      } else if (gauge->unit != info(id).unit) {
        fault(id, fmt::format("names the gauge {}, whose unit is {}; allowed are gauges in {}", name.view(),
                              slabd::name(gauge->unit), slabd::name(info(id).unit)));
      } else if (recipe.formula(id).kind != FormulaKind::mean && !gauge->has_range()) {
        // The value of a mean is near the nominal; that of another formula is small, also in a wrong unit.
        fault(id, fmt::format("names the gauge {} without `range`; allowed in {} are gauges with range = [LOW, HIGH], "
                              "because nothing else would show a value in another unit",
                              name.view(), info(recipe.formula(id).kind).name));
      }
    }
  }
}

}  // namespace slabd::config
