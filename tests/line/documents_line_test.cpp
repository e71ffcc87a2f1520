// SPDX-License-Identifier: Apache-2.0
//
// The documents of a running line against their published schemas, by an independent validator and without any key
// beyond what is published (tests/cli/validate_json.py). What is written of stored slabs is in
// tests/cli/export_test.cpp.
#include <gtest/gtest.h>

#include <chrono>
#include <fstream>
#include <thread>

#include "processes.h"

namespace slabd::line {
namespace {

TEST(DocumentsLine, what_a_running_line_says_is_what_its_schemas_publish) {
  Box box;
  std::string documents;
  int count = 0;
  const auto keep = [&](const std::string& text) {
    const fs::path path = box.dir / ("document-" + std::to_string(++count) + ".json");
    std::ofstream(path) << text;
    documents += " " + path.native();
  };
  const auto ask = [&](std::vector<std::string> command) {
    command.insert(command.end(), {"--config", box.config.native(), "--json"});
    const Box::Answer answer = box.slabctl(command);
    EXPECT_FALSE(answer.out.empty()) << command[0] << ": " << answer.err;
    keep(answer.out);
  };
  ask({"doctor", "--listen-s", "0.5"});  // of a line where nothing runs
  box.start();
  ASSERT_TRUE(box.ready()) << box.log();
  ask({"status"});
  ask({"robot", "monitor", "--once"});  // nobody sends
  const auto line = box.simulate({"--slab-no", "1", "--defect", "missing=3", "--scans-per-block", "1", "--json"});
  std::this_thread::sleep_for(std::chrono::seconds(2));
  ask({"status"});
  ask({"doctor", "--listen-s", "0.5"});
  ask({"robot", "monitor", "--once"});
  ask({"plc", "monitor", "--once"});
  line->wait();
  keep(read_file(box.dir / "simulate.out"));
  ask({"status"});
  ask({"db", "check"});
  ask({"history"});
  ask({"show", "1"});
  const fs::path found = box.dir / "validated";
  const int status = std::system(("/usr/bin/python3 " + std::string(SLABD_SOURCE_DIR) + "/tests/cli/validate_json.py " +
                                  SLABD_SOURCE_DIR + "/docs/schemas" + documents + " >" + found.native() + " 2>&1")
                                     .c_str());
  EXPECT_EQ(status, 0) << read_file(found);
  EXPECT_NE(read_file(found).find(std::to_string(count) + " documents, 0 faults"), std::string::npos)
      << read_file(found);
}

}  // namespace
}  // namespace slabd::line
