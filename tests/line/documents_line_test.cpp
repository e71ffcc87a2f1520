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

/// Documents, and what the validator says of them.
class Documents {
 public:
  explicit Documents(const Box& box) : box_(box) {}
  void keep(const std::string& text) {
    const fs::path path = box_.dir / ("document-" + std::to_string(++count_) + ".json");
    std::ofstream(path) << text;
    paths_ += " " + path.native();
  }
  void ask(std::vector<std::string> command) {
    command.emplace_back("--json");
    const Box::Answer answer = box_.slabctl(command);
    EXPECT_FALSE(answer.out.empty()) << command[0] << " " << command[1] << ": " << answer.err;
    keep(answer.out);
  }
  void validate() const {
    const fs::path said = box_.dir / "validated";
    const int status =
        std::system(("/usr/bin/python3 " + std::string(SLABD_SOURCE_DIR) + "/tests/cli/validate_json.py " +
                     SLABD_SOURCE_DIR + "/docs/schemas" + paths_ + " >" + said.native() + " 2>&1")
                        .c_str());
    EXPECT_EQ(status, 0) << read_file(said);
    EXPECT_NE(read_file(said).find(std::to_string(count_) + " documents, 0 faults"), std::string::npos)
        << read_file(said);
  }

 private:
  const Box& box_;
  std::string paths_;
  int count_ = 0;
};

TEST(DocumentsLine, what_a_running_line_says_is_what_its_schemas_publish) {
  Box box;
  Documents documents(box);
  const auto ask = [&](std::vector<std::string> command) {
    command.insert(command.end(), {"--config", box.config.native()});
    documents.ask(command);
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
  documents.keep(read_file(box.dir / "simulate.out"));
  ask({"status"});
  ask({"db", "check"});
  ask({"history"});
  ask({"show", "1"});
  documents.validate();
}

TEST(DocumentsLine, what_a_calibration_says_is_what_its_schemas_publish) {
  const Box box;
  Documents documents(box);
  const std::string views = (box.dir / "views").native();
  const std::string session = (box.dir / "session").native() + "/";
  ASSERT_EQ(box.slabctl({"simulate", "calibration", "--kind", "ball", "--views", "20", "--out", views}).exit_status, 0);
  documents.ask({"calibrate", "ball", views + "/view_01.ply", views + "/view_02.ply", "--radius", "25.4"});
  documents.ask({"calibrate", "ball", views + "/view_01.ply", "--radius", "20"});  // refused
  documents.ask({"calibrate", "new", session, "--config", box.config.native(), "--kind", "ball", "--radius", "25.4",
                 "--robot-sigma-mm", "0.017", "--fov", "100", "140", "540", "660", "--views", "12"});
  documents.ask({"calibrate", "list", "--session", session});  // nothing yet
  documents.ask({"calibrate", "capture", "--session", session, "--set", views});
  documents.ask({"calibrate", "drop", "3", "--why", "blurred", "--session", session});
  documents.ask({"calibrate", "undo", "--session", session});
  documents.ask({"calibrate", "list", "--session", session});
  documents.ask({"calibrate", "solve", "--session", session});
  documents.ask({"calibrate", "verify", "--session", session});
  documents.validate();
}

}  // namespace
}  // namespace slabd::line
