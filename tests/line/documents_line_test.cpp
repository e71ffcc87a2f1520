// SPDX-License-Identifier: Apache-2.0
//
// Validates the documents of a running line against their published schemas, with an independent validator and without
// keys beyond the published ones (tests/cli/validate_json.py). tests/cli/export_test.cpp does the same for stored
// slabs.
#include <gtest/gtest.h>

#include <chrono>
#include <fstream>
#include <thread>

#include "cli/client/control.h"
#include "daemon/control/calibration_changer.h"
#include "daemon/loop.h"
#include "hal/hal.h"
#include "hal/scan/scanner_ports.h"
#include "processes.h"
#include "tests/places/places.h"

namespace slabd::line {
namespace {

/// Documents, and the validator's results.
class Documents {
 public:
  explicit Documents(const Box& box) : box_(box) {}
  /// `title`: for a document without its own title.
  void keep(const std::string& text, const std::string& title = "") {
    const fs::path path = box_.dir / ("document-" + std::to_string(++count_) + ".json");
    std::ofstream(path) << text;
    paths_ += " " + (title.empty() ? "" : title + "=") + path.native();
  }
  void keep_file(const fs::path& path) {
    ASSERT_TRUE(fs::exists(path)) << path;
    keep(read_file(path));
  }
  void ask(std::vector<std::string> command) {
    command.emplace_back("--json");
    const Box::Answer answer = box_.slabctl(command);
    EXPECT_FALSE(answer.out.empty()) << command[0] << " " << command[1] << ": " << answer.err;
    keep(answer.out);
  }
  void validate() const {
    const fs::path said = box_.dir / "validated";
    const int status = std::system(("/usr/bin/python3 " + places::source_dir() + "/tests/cli/validate_json.py " +
                                    places::source_dir() + "/docs/schemas" + paths_ + " >" + said.native() + " 2>&1")
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

TEST(DocumentsLine, output_of_a_running_line_matches_its_published_schemas) {
  Box box;
  Documents documents(box);
  const auto ask = [&](std::vector<std::string> command) {
    command.insert(command.end(), {"--config", box.config.native()});
    documents.ask(command);
  };
  ask({"doctor", "--listen-s", "0.5"});  // without a daemon
  box.start();
  ASSERT_TRUE(box.ready()) << box.log();
  ask({"status"});
  ask({"robot", "monitor", "--once"});  // without poses
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
  ask({"commission"});
  ask({"history"});
  ask({"show", "1"});
  EXPECT_EQ(box.slabctl({"pin", "1", "--reason", "complaint \"17\"", "--config", box.config.native()}).exit_status, 0);
  documents.keep_file(box.dir / "spool/1/pin.json");
  documents.validate();
}

TEST(DocumentsLine, output_of_a_calibration_matches_its_published_schemas) {
  const Box box;
  Documents documents(box);
  const std::string views = (box.dir / "views").native();
  const std::string session = (box.dir / "session").native() + "/";
  ASSERT_EQ(box.slabctl({"simulate", "calibration", "--kind", "ball", "--views", "13", "--out", views}).exit_status, 0);
  documents.ask({"calibrate", "ball", views + "/view_01.ply", views + "/view_02.ply", "--radius", "25.4"});
  documents.ask({"calibrate", "ball", views + "/view_01.ply", "--radius", "20"});  // refused
  documents.ask({"calibrate", "new", session, "--config", box.config.native(), "--kind", "ball", "--radius", "25.4",
                 "--robot-sigma-mm", "0.017", "--fov", "100", "140", "540", "660", "--views", "12"});
  documents.ask({"calibrate", "list", "--session", session});  // still empty
  documents.ask({"calibrate", "capture", "--session", session, "--set", views});
  documents.ask({"calibrate", "drop", "3", "--reason", "blurred", "--session", session});
  documents.ask({"calibrate", "undo", "--session", session});
  documents.ask({"calibrate", "list", "--session", session});
  documents.ask({"calibrate", "solve", "--session", session});
  documents.ask({"calibrate", "verify", "--session", session, "--yes"});
  documents.ask({"calibrate", "apply", "--session", session});
  documents.keep_file(views + "/truth.json");
  documents.validate();
}

TEST(DocumentsLine, output_on_calibrations_in_force_and_on_checks_matches_its_published_schemas) {
  const Box box;
  Documents documents(box);
  const std::string recipe = places::source_dir() + "/recipes/p5600.toml";
  const auto ask = [&](std::vector<std::string> command) {
    command.insert(command.end(), {"--config", box.config.native()});
    documents.ask(command);
  };
  const auto done = [&](std::vector<std::string> command) {
    const Box::Answer answer = box.slabctl(command);
    EXPECT_EQ(answer.exit_status, 0) << command[0] << " " << command[1] << ": " << answer.err;
  };
  ask({"calibrate", "history"});  // without stored calibrations
  ask({"calibrate", "check"});
  ask({"scanner", "history"});
  for (const char* sigma : {"0.05", "0.06"})
    done({"calibrate", "adopt", "--sigma-mm", sigma, "--sigma-deg", "0.002", "--reason", "tracker", "--apply",
          "--config", box.config.native()});
  ask({"calibrate", "rollback", "--reason", "worse"});
  const std::string certificate = (box.dir / "reference.txt").native();
  std::ofstream(certificate) << "id = RB-01\ndate = 2026-01-01\nslope_deg = 1.432096\nslope_U_deg = 0.001\n"
                                "jaw_distance_mm = 380.0\njaw_distance_U_mm = 0.01\n";
  done({"calibrate", "reference", "--certificate", certificate, "--apply", "--reason", "new", "--config",
        box.config.native()});
  const std::string scan = (box.dir / "block.ply").native();
  done({"simulate", "scan", "--recipe", recipe, "--block", "1", "--points", "quarter", "--out", scan});
  documents.keep_file(box.dir / "block.json");
  ask({"calibrate", "check", scan, "--recipe", recipe});
  ask({"calibrate", "check"});
  ask({"calibrate", "history"});

  const std::string slab = (box.dir / "mastered").native();
  done({"simulate", "calibration", "--kind", "slab", "--recipe", recipe, "--out", slab, "--config",
        box.config.native()});
  documents.keep_file(slab + "/truth.json");
  const std::vector<std::string> solve = {"calibrate", "stations",          "--certificate", slab + "/certificate.txt",
                                          "--visits",  slab + "/visits.txt"};
  ask(solve);
  std::vector<std::string> refused = solve;
  refused.insert(refused.end(), {"--spread-limit", "0.001"});
  ask(refused);
  std::vector<std::string> put_in_force = solve;
  put_in_force.insert(put_in_force.end(), {"--apply", "--config", box.config.native()});
  done(put_in_force);
  ask({"stations"});  // mastered stations

  const std::string balls = (box.dir / "artefact").native();
  done({"simulate", "calibration", "--kind", "artefact", "--views", "2", "--out", balls, "--config",
        box.config.native()});
  documents.keep_file(balls + "/truth.json");
  documents.ask({"calibrate", "artefact", balls + "/view_01.ply", scan, "--certificate", balls + "/certificate.txt"});
  documents.ask({"calibrate", "block", scan, balls + "/view_01.ply", "--recipe", recipe, "--flange",
                 balls + "/flange.txt", "--start", "0 80 150 1 0 0 0"});
  documents.ask({"scanner", "verify", "--ball", balls + "/view_01.ply", "--diameter-mm", "50.8"});
  const std::string ball = (box.dir / "one_ball").native();
  done({"simulate", "calibration", "--kind", "ball", "--views", "1", "--out", ball, "--config", box.config.native()});
  documents.keep_file(ball + "/truth.json");
  ask({"scanner", "warm-up", ball + "/view_01.ply", "--times", "0", "--flange", "1500 200 900 0 1 0 0", "--radius",
       "25.4"});
  std::vector<float> plate;
  for (int i = 0; i < 40'000; ++i)
    for (const int v : {i % 200 - 100, i / 200 - 100, 600}) plate.push_back(static_cast<float>(v));
  const std::string flat = (box.dir / "plate.ply").native();
  ASSERT_TRUE(hal::write_ply(flat.c_str(), plate, 200, 200).ok());
  ask({"scanner", "verify", "--plate", flat, "--keep"});
  ask({"scanner", "history"});
  done({"simulate", "plane", "--out", (box.dir / "plane.xyz").native()});
  documents.keep_file(box.dir / "plane.json");
  documents.validate();
}

TEST(DocumentsLine, requests_to_the_daemon_and_its_answers_match_their_published_schemas) {
  Box box;
  Documents documents(box);
  box.start();
  ASSERT_TRUE(box.ready()) << box.log();
  const auto ask = [&](const std::string& request, const std::string& schema) {
    // A client with more than 20 requests a second is delayed.
    std::this_thread::sleep_for(std::chrono::milliseconds(60));
    const Result<std::string> answer = cli::ask_daemon((box.dir / "control.sock").native(), request + "\n");
    ASSERT_TRUE(answer.ok()) << answer.error().text.view();
    EXPECT_NE(answer.value().find("\"slabd." + schema + "/1\""), std::string::npos) << answer.value();
    documents.keep(request, "slabd.control_request/1");
    documents.keep(answer.value());
  };
  for (const char* verb : {"status", "calibration", "plc_image", "metrics", "care"})
    ask("{\"verb\":\"" + std::string(verb) + "\"}", verb == std::string("calibration") ? "calibration_state" : verb);
  ask(R"({"verb":"metrics","reset":true})", "metrics");
  ask(R"({"verb":"backup"})", "care");
  ask(R"({"verb":"prune","keep_slabs":1000})", "care");
  ask(R"({"verb":"capture","action":"state","session":"spring"})", "error");
  ask(R"({"verb":"capture","action":"begin","session":"spring","operator":"anna","lease_s":60,"take_over":true})",
      "capture");
  ask(R"({"verb":"capture","action":"shoot","session":"spring"})", "capture");
  ask("{\"verb\":\"status\"}", "status");  // in maintenance
  ask(R"({"verb":"capture","action":"end","session":"spring"})", "capture");
  ask(R"({"verb":"calibration_change","file":"none.json"})", "calibration_state");
  ask("{\"verb\":\"calibration\"}", "calibration_state");

  // States that would take too long to reach in a test, as the daemon writes them.
  daemon::Station station{daemon::StationSettings{}};
  station.recovered = true;
  station.capture.phase = daemon::Capture::Phase::ready;
  station.capture.shot.number = 1;
  documents.keep(daemon::capture_json(station));
  station.capture.shot.done = true;
  documents.keep(daemon::capture_json(station));
  station.capture.shot.code = Code::moved_during_scan;
  documents.keep(daemon::capture_json(station));
  storage::CalibrationRecord record;
  StationTable corrections;
  corrections.station[2].visits = 5;
  for (const decltype(record.numbers)& numbers :
       {decltype(record.numbers)(HandEyeNumbers{}), decltype(record.numbers)(corrections),
        decltype(record.numbers)(ReferenceBlock{}), decltype(record.numbers)(MonitorBall{})}) {
    record.numbers = numbers;
    documents.keep(daemon::change_json(storage::KeepCalibration{record}));
  }
  documents.keep(daemon::change_json(storage::ApplyCalibration{"he-1", {"anna", "new", 1}}));
  documents.keep(daemon::change_json(storage::RollBackCalibration{CalibrationKind::hand_eye, 0, {"anna", "worse", 1}}));
  documents.keep(daemon::change_json(storage::KeepCheck{}));
  ScanRequest request;
  request.slab_id = "S-\xff\"";
  documents.keep(std::string(hal::scan_request_json(request).view()));
  documents.keep(std::string(hal::scan_request_json(request, R"(, "have_points": 7, "timeout_ms": 20000)").view()));
  documents.keep(std::string(hal::scan_answer_json(1, 2, nullptr, 3).view()));
  const Error why = error(Code::too_few_points, "\"few\"");
  documents.keep(std::string(hal::scan_answer_json(1, 2, &why, 0).view()));
  documents.validate();
}

}  // namespace
}  // namespace slabd::line
