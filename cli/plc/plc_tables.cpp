// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <memory>
#include <nlohmann/json.hpp>

#include "base/items.h"
#include "base/result.h"
#include "cli/exit.h"
#include "cli/plc/plc.h"
#include "cli/terminal/arguments.h"
#include "hal/plc/plc_map.h"

namespace slabd::cli {
namespace {

using hal::RegisterRow;

void each_row(RegisterRow::Memory memory, const std::function<void(const RegisterRow&)>& take) {
  const hal::RegisterSink sink = [&](const RegisterRow& row, std::string_view) { take(row); };
  if (memory == RegisterRow::Memory::holding) {
    hal::list_inputs({}, hal::WordOrder::abcd, sink);
  } else {
    hal::list_outputs({}, hal::WordOrder::abcd, sink);
  }
}

std::string address_text(const RegisterRow& row) {
  if (row.bit >= 0) return fmt::format("{}.{}", row.address, row.bit);
  if (row.count > 1) return fmt::format("{}-{}", row.address, row.address + row.count - 1);
  return fmt::format("{}", row.address);
}

std::string words_text(const RegisterRow& row) {
  std::string text;
  for (std::size_t i = 0; i < row.words.size(); ++i)
    text += fmt::format("{}{} {}", i == 0 ? "" : ", ", i, row.words[i]);
  return text;
}

std::string meaning_text(const RegisterRow& row) {
  if (!row.slab_name.empty())
    return fmt::format("deviation from nominal, 0x8000 = none, saturated; {} in a slab's record", row.slab_name);
  const std::string words = words_text(row);
  if (words.empty()) return std::string(row.meaning);
  return fmt::format("{}: {}", row.meaning, words);
}

std::string table(RegisterRow::Memory memory, const char* prefix) {
  std::string text = fmt::format("| {} | Name | Type | Unit | Meaning | Since |\n|---|---|---|---|---|---|\n", prefix);
  each_row(memory, [&](const RegisterRow& row) {
    if (row.series > 1) return;  // the first row of the station table, or of the gauges, represents all
    std::string address = address_text(row);
    std::string name(row.name);
    std::string unit(row.unit);
    if (row.series == 1) {
      address = fmt::format("{}, {}, .. {}", row.address, row.address + 2, row.address + 2 * (row.series_rows - 1));
      name.replace(name.find('1'), 1, "k");
    }
    if (!row.slab_name.empty()) {
      name = fmt::format("{} / {}", row.name, row.slab_name);
      unit = fmt::format("{} / {}", row.unit.empty() ? "-" : row.unit, row.slab_unit.empty() ? "-" : row.slab_unit);
    }
    text +=
        fmt::format("| {} | {} | {} | {} | {} | {} |\n", address, name, row.type, unit, meaning_text(row), row.since);
  });
  return text;
}

std::string csv_text(std::string_view text) {
  std::string quoted = "\"";
  for (const char c : text) quoted += c == '"' ? std::string("\"\"") : std::string(1, c);
  return quoted + "\"";
}

/// Calls use(code, meaning, cure) for the codes of the interface, then for the items.
template <typename Use>
void each_code(Use&& use) {
  const std::string_view unknown = describe(static_cast<Code>(1));
  for (std::uint16_t code = 100; code < kReasonItemBase; ++code)
    if (const std::string_view what = describe(static_cast<Code>(code)); what != unknown)
      use(unsigned{code}, std::string(what), std::string(cure(static_cast<Code>(code))));
  for (std::size_t item = 0; item < 16; ++item)
    use(static_cast<unsigned>(kReasonItemBase + item),
        fmt::format("item {}, {}: failed; with VERDICT 3 not measured, with 5 indeterminate", item,
                    info(static_cast<ItemId>(item)).name),
        "`slabctl show` names value, limits and U; look at the block");
  for (std::size_t i = 0; i < kItemCount; ++i) {
    const ItemInfo& item = info(static_cast<ItemId>(i));
    if (!item.meaning.empty())
      use(static_cast<unsigned>(item.reason),
          fmt::format("item {}: {}; no bit in FAIL_MASK or OPEN_MASK", item.name, item.meaning),
          std::string(item.cure));
  }
}

nlohmann::ordered_json code_json() {
  nlohmann::ordered_json list = nlohmann::ordered_json::array();
  each_code([&](unsigned code, const std::string& what, const std::string& todo) {
    list.push_back({{"code", code}, {"what", what}, {"cure", todo}});
  });
  return {{"schema", "slabd.plc_codes/1"}, {"codes", std::move(list)}};
}

nlohmann::ordered_json register_json() {
  nlohmann::ordered_json list = nlohmann::ordered_json::array();
  for (const auto memory : {RegisterRow::Memory::holding, RegisterRow::Memory::input})
    each_row(memory, [&](const RegisterRow& row) {
      nlohmann::ordered_json j = {
          {"memory", memory == RegisterRow::Memory::holding ? "holding" : "input"},
          {"address", row.address},
          {"registers", row.count},
          {"bit", row.bit < 0 ? nlohmann::ordered_json(nullptr) : nlohmann::ordered_json(row.bit)},
          {"name", row.name},
          {"type", row.type},
          {"unit", row.unit},
          {"meaning", row.meaning},
          {"since", row.since}};
      if (!row.words.empty()) j["words"] = std::vector<std::string>(row.words.begin(), row.words.end());
      if (!row.slab_name.empty()) j["slab"] = {{"name", row.slab_name}, {"unit", row.slab_unit}};
      list.push_back(std::move(j));
    });
  return {{"schema", "slabd.plc_map/1"},
          {"version", fmt::format("{}.{}", hal::kMapVersion >> 8U, hal::kMapVersion & 0xFFU)},
          {"registers", std::move(list)}};
}

}  // namespace

std::string register_markdown() {
  return "**Holding registers, written by the PLC**\n\n" + table(RegisterRow::Memory::holding, "HR") +
         "\n**Input registers, written by slabd**\n\n" + table(RegisterRow::Memory::input, "IR");
}

std::string register_csv() {
  std::string text = "memory,address,bit,registers,name,type,unit,meaning,since\n";
  for (const auto memory : {RegisterRow::Memory::holding, RegisterRow::Memory::input})
    each_row(memory, [&](const RegisterRow& row) {
      text += fmt::format("{},{},{},{},{},{},{},{},{}\n", memory == RegisterRow::Memory::holding ? "HR" : "IR",
                          row.address, row.bit < 0 ? "" : std::to_string(row.bit), row.count, csv_text(row.name),
                          csv_text(row.type), csv_text(row.unit), csv_text(meaning_text(row)), row.since);
    });
  return text;
}

std::string code_markdown() {
  std::string text = "| Code | What it is | What to do |\n|---|---|---|\n";
  each_code([&](unsigned code, const std::string& what, const std::string& cure) {
    text += fmt::format("| {} | {} | {} |\n", code, what, cure);
  });
  return text;
}

std::string code_csv() {
  std::string text = "code,what,cure\n";
  each_code([&](unsigned code, const std::string& what, const std::string& cure) {
    text += fmt::format("{},{},{}\n", code, csv_text(what), csv_text(cure));
  });
  return text;
}

void add_plc(args::Command& app) {
  struct Options {
    bool csv = false;
    bool json = false;
  };
  args::Command plc = app.add_subcommand("plc", "For the PLC's programmer: live registers, the map, the codes");
  plc->require_subcommand(1);
  auto options = std::make_shared<Options>();
  args::Command map = plc->add_subcommand("map", "Register map 1.1, as docs/PLC.md has it");
  args::Option csv = map->add_flag("--csv", options->csv, "For import into a tag list");
  map->add_flag("--json", options->json, "slabd.plc_map/1")->excludes(csv);
  map->runs([options] {
    fmt::print("{}", options->csv    ? register_csv()
                     : options->json ? register_json().dump(2) + "\n"
                                     : register_markdown());
    return kDone;
  });
  auto told = std::make_shared<Options>();
  args::Command codes = plc->add_subcommand("codes", "Every code with its cure");
  args::Option codes_csv = codes->add_flag("--csv", told->csv, "For import into a tag list");
  codes->add_flag("--json", told->json, "slabd.plc_codes/1")->excludes(codes_csv);
  codes->runs([told] {
    fmt::print("{}", told->csv ? code_csv() : told->json ? code_json().dump(2) + "\n" : code_markdown());
    return kDone;
  });
  add_plc_monitor(*plc);
  add_plc_command(*plc);
}

}  // namespace slabd::cli
