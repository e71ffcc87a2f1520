// SPDX-License-Identifier: Apache-2.0
//
// docs/PLC.md and the function block match the program. SLABD_UPDATE_DOCS=1 writes the generated tables.
#include <gtest/gtest.h>

#include <cstdlib>
#include <fstream>
#include <iterator>
#include <map>
#include <regex>
#include <set>
#include <string>

#include "cli/plc/plc.h"
#include "emulator/plc_peer.h"
#include "hal/plc/plc_map.h"
#include "tests/places/places.h"

namespace slabd::cli {
namespace {

const std::string kDocument = places::source_dir() + "/docs/PLC.md";
const std::string kBlock = places::source_dir() + "/docs/plc/FB_SLABD.st";

std::string read_file(const std::string& path) {
  std::ifstream in(path);
  return {std::istreambuf_iterator<char>(in), {}};
}

void expect_between_marks(const std::string& what, const std::string& generated) {
  std::string text = read_file(kDocument);
  const std::string begin = "<!-- " + what + ": begin -->\n";
  const std::string end = "<!-- " + what + ": end -->\n";
  const std::size_t from = text.find(begin);
  const std::size_t to = text.find(end);
  ASSERT_NE(from, std::string::npos) << begin;
  ASSERT_NE(to, std::string::npos) << end;
  const std::size_t first = from + begin.size();
  if (std::getenv("SLABD_UPDATE_DOCS") != nullptr) {
    text.replace(first, to - first, generated);
    std::ofstream(kDocument) << text;
    return;
  }
  EXPECT_EQ(text.substr(first, to - first), generated)
      << "docs/PLC.md is stale: run this test with SLABD_UPDATE_DOCS=1";
}

TEST(PlcDocs, the_register_table_is_the_programs) {
  expect_between_marks("slabctl plc map", register_markdown());
}

TEST(PlcDocs, the_codes_are_the_programs) {
  expect_between_marks("slabctl plc codes", code_markdown());
}

TEST(PlcDocs, every_register_is_listed_once_and_none_is_missing) {
  std::set<std::size_t> holding;
  std::set<std::size_t> input;
  std::set<std::string> names;
  const hal::RegisterSink sink = [&](const hal::RegisterRow& row, std::string_view) {
    std::set<std::size_t>& seen = row.memory == hal::RegisterRow::Memory::holding ? holding : input;
    for (std::size_t i = 0; i < row.count; ++i)
      EXPECT_TRUE(seen.insert(row.address + i).second || row.bit > 0) << row.name << " at " << row.address;
    if (row.type.empty() || !row.slab_name.empty()) return;
    const std::string memory = row.memory == hal::RegisterRow::Memory::holding ? "HR " : "IR ";
    EXPECT_TRUE(names.insert(memory + std::string(row.name)).second) << row.name;
  };
  hal::list_inputs({}, hal::WordOrder::abcd, sink);
  hal::list_outputs({}, hal::WordOrder::abcd, sink);
  EXPECT_EQ(holding.size(), hal::kHoldingRegisters);
  EXPECT_EQ(input.size(), hal::kInputRegisters);
}

TEST(PlcDocs, registers_are_described_in_words) {
  PlcOutputs outputs;
  outputs.state = PlcState::scanning;
  outputs.cmd_status = 0x8000 + 205;
  outputs.ready = true;
  outputs.record.res_seq = 3;
  outputs.record.kind = 2;
  outputs.record.verdict = Verdict::fail;
  outputs.record.reason = 604;
  outputs.record.deviation[0] = -0.25;
  outputs.record.deviation[4] = 7;
  outputs.table[17] = {Verdict::pass, 2, 0};
  for (const hal::WordOrder order : {hal::WordOrder::abcd, hal::WordOrder::cdab}) {
    hal::InputImage image{};
    hal::encode_outputs(outputs, order, image);
    std::map<std::string, std::string> words;
    hal::list_outputs(image, order, [&](const hal::RegisterRow& row, std::string_view value) {
      words[std::to_string(row.address) + " " + std::string(row.name)] = value;
    });
    EXPECT_EQ(words["2 WORD_PROBE"], "0x12345678");
    EXPECT_EQ(words["5 READY"], "1");
    EXPECT_EQ(words["6 STATE"], "5 scanning");
    EXPECT_EQ(words["11 CMD_STATUS"], "failed: 205 the robot moved while the scan was taken");
    EXPECT_EQ(words["28 DISPOSITION"], "0 none");
    EXPECT_EQ(words["36 VERDICT"], "2 fail");
    EXPECT_EQ(words["37 REASON"], "604 jaw_distance");
    EXPECT_EQ(words["42 corner_level"], "-0.250 mm");
    EXPECT_EQ(words["46 its station"], "7");
    EXPECT_EQ(words["43 warp_left"], "-");
    EXPECT_EQ(words["104 STATION_18"], "1 pass, 2 attempts");
  }
  std::map<std::string, std::string> order;
  hal::list_inputs({}, hal::WordOrder::abcd,
                   [&](const hal::RegisterRow& row, std::string_view value) { order[std::string(row.name)] = value; });
  EXPECT_EQ(order["SLAB_TEMPERATURE"], "unknown");
  EXPECT_EQ(order["SLAB_AGE"], "unknown") << "it was not reported";
  EXPECT_EQ(order["MOULD"], "unknown");
  EXPECT_EQ(order["CMD_SEQ"], "0");
  hal::InputImage wrong{};
  wrong[36] = 77;
  std::string verdict;
  hal::list_outputs(wrong, hal::WordOrder::abcd, [&](const hal::RegisterRow& row, std::string_view value) {
    if (row.address == 0) {
      EXPECT_EQ(value, "0x0000  WRONG");
    }
    if (row.address == 36) verdict = value;
  });
  EXPECT_EQ(verdict, "77 UNKNOWN");
}

/// The first number after `name`, in its own unit.
long long number_behind(const std::string& text, const std::string& name) {
  std::smatch match;
  const std::regex pattern(name + R"([^;]*?(?:T#|:= )(\d+)(MS|S)?)");
  if (!std::regex_search(text, match, pattern)) return -1;
  return std::stoll(match[1]) * (match[2] == "S" ? 1000 : 1);
}

TEST(PlcDocs, the_function_block_has_the_emulators_times_and_repetitions) {
  const std::string text = read_file(kBlock);
  ASSERT_FALSE(text.empty());
  const emulator::PlcTraits traits;
  EXPECT_EQ(number_behind(text, "tonAck\\(IN.*PT := "), traits.ack_timeout.count());
  EXPECT_EQ(number_behind(text, "tonBeat\\(IN.*PT := "), traits.heartbeat.count());
  EXPECT_EQ(number_behind(text, "tonFree\\(IN.*PT := "), traits.result_timeout.count());
  EXPECT_EQ(number_behind(text, "tonReady\\(IN.*PT := "), 3'000);
  EXPECT_EQ(number_behind(text, "uiCmdNow = 2 THEN\\s*tonDone\\(IN.*PT := "), traits.acquire_timeout.count());
  EXPECT_EQ(number_behind(text, "REWRITES_MAX : UINT "), traits.ack_rewrites);
  EXPECT_EQ(number_behind(text, "ATTEMPTS_MAX : UINT "), emulator::kIssueAttempts);
  EXPECT_NE(text.find("uiCode = 103 OR uiCode = 107"), std::string::npos) << "what is tried again later";
}

}  // namespace
}  // namespace slabd::cli
