// SPDX-License-Identifier: Apache-2.0
//
// The calibration routine as a new user performs it, in processes: new, capture, solve, verify, apply. Then the same
// with kill -9 at any moment, and every wrong step: each error must contain the next command.
#include <fcntl.h>
#include <fmt/core.h>
#include <gtest/gtest.h>
#include <signal.h>
#include <unistd.h>

#include <chrono>
#include <cmath>
#include <nlohmann/json.hpp>
#include <thread>
#include <tuple>
#include <vector>

#include "base/base.h"
#include "calib/calib.h"
#include "slabctl_process.h"
#include "storage/storage.h"
#include "tests/cli/chinese.h"
#include "tests/places/places.h"

namespace slabd::cli {
namespace {

using nlohmann::json;

class CalibrateSession : public Slabctl {
 protected:
  CalibrateSession() { ::setenv("XDG_STATE_HOME", file("state").c_str(), 1); }
  ~CalibrateSession() override { ::unsetenv("XDG_STATE_HOME"); }

  /// Writes a configuration with its own folder for database and sessions.
  [[nodiscard]] std::string config(const std::string& name) const {
    fs::create_directories(file(name));
    return write(name + "/slabd.toml", R"([plc]
role = "server"
listen = "127.0.0.1:1502"
unit_id = 1
allow = ["127.0.0.0/8"]
word_order = "abcd"
[robot]
lcm_url = "udpm://239.255.76.67:7667?ttl=0"
channel = "FLANGE_POSE"
interface = "lo"
[scanner]
backend = "drop"
drop_dir = "drop"
[storage]
db = "slabd.db"
spool_dir = "spool"
[recipes]
dir = ")" + places::source_dir() +
                                           R"(/recipes"
[cell]
T_base_slab = [1800.0, 0.0, 400.0, 1.0, 0.0, 0.0, 0.0]
[calibration]
T_flange_scanner = [20.0, -10.0, 200.0, 0.9990482, 0.0, 0.0436194, 0.0]
[control]
socket = "control.sock"
)");
  }
  void simulate(const std::string& name, const std::string& options) const {
    const Ended ended = run("simulate calibration --out " + file(name) + " " + options);
    ASSERT_EQ(ended.status, 0) << ended.err;
  }
  [[nodiscard]] std::string new_in(const std::string& name, const std::string& more = "", int views = 13) const {
    return "calibrate new hall --config " + config(name) +
           " --radius 25.4 --robot-sigma-mm 0.017 --fov 100 140 540 660 --views " + std::to_string(views) + " " + more;
  }
  [[nodiscard]] json list(const std::string& more = "") const {
    const Ended ended = run("calibrate list --json " + more);
    EXPECT_EQ(ended.status, 0) << ended.err;
    return json::parse(ended.out, nullptr, false);
  }
  /// Runs slabctl and kills it after `us`; false if it had already ended.
  bool run_killed(const std::vector<std::string>& arguments, long us) const {
    std::vector<std::string> words = {places::slabctl()};
    words.insert(words.end(), arguments.begin(), arguments.end());
    std::vector<char*> argv;
    for (std::string& word : words) argv.push_back(word.data());
    argv.push_back(nullptr);
    const pid_t pid = ::fork();
    if (pid == 0) {
      const int nowhere = ::open("/dev/null", O_RDWR);
      for (const int fd : {0, 1, 2}) ::dup2(nowhere, fd);
      ::execv(places::slabctl().c_str(), argv.data());
      ::_exit(127);
    }
    std::this_thread::sleep_for(std::chrono::microseconds(us));
    ::kill(pid, SIGKILL);
    int status = 0;
    ::waitpid(pid, &status, 0);
    return WIFSIGNALED(status);
  }
  /// The record in force.
  [[nodiscard]] storage::CalibrationRecord in_force(const std::string& name) const {
    auto reader = storage::open_reader(file(name) + "/slabd.db");
    if (!reader.ok()) return {};
    auto current = reader.value()->current(CalibrationKind::hand_eye);
    return current.ok() && current.value() ? *current.value() : storage::CalibrationRecord{};
  }
};

void expect_next(const Ended& ended, int status, const std::string& words) {
  EXPECT_EQ(ended.status, status) << ended.out << ended.err;
  EXPECT_NE((ended.out + ended.err).find(words), std::string::npos) << "expected '" << words << "' in:\n"
                                                                    << ended.out << ended.err;
}

double length(const json& a, const json& b) {
  double squares = 0.0;
  for (std::size_t i = 0; i < 3; ++i) squares += std::pow(a[i].get<double>() - b[i].get<double>(), 2);
  return std::sqrt(squares);
}

/// The lines of a record's observations without times, paths and operators.
std::string without_times(const std::string& text) {
  std::string kept;
  std::istringstream lines(text);
  for (std::string line; std::getline(lines, line);) {
    bool varies = false;
    for (const char* key : {"captured =", "created =", "config =", "step =", "sha256 ="})
      varies |= line.starts_with(key);
    if (!varies) kept += line + "\n";
  }
  return kept;
}

TEST_F(CalibrateSession, a_session_reads_scans_in_the_form_of_the_configuration) {
  const auto session_text = [&](const std::string& name, const std::string& more) {
    const std::string path = config(name);
    std::ifstream was(path);
    std::string text{std::istreambuf_iterator<char>(was), {}};
    const std::string drop = "drop_dir = \"drop\"\n";
    text.replace(text.find(drop), drop.size(), drop + "unit = \"m\"\ncolumns = \"PosX,PosY,PosZ\"\n");
    static_cast<void>(write(name + "/slabd.toml", text));
    const Ended begun = run("calibrate new hall --config " + path + " --radius 25.4 --robot-sigma-mm 0.017 " + more);
    EXPECT_EQ(begun.status, 0) << begun.err;
    for (const auto& entry : fs::recursive_directory_iterator(file(name))) {
      if (entry.path().filename() != "session.txt") continue;
      std::ifstream session(entry.path());
      return std::string{std::istreambuf_iterator<char>(session), {}};
    }
    return std::string();
  };
  const std::string configured = session_text("a", "");
  EXPECT_NE(configured.find("unit = m\n"), std::string::npos) << configured;
  EXPECT_NE(configured.find("PosX,PosY,PosZ"), std::string::npos) << configured;
  const std::string given = session_text("b", "--unit um --columns 2,3,4");
  EXPECT_NE(given.find("unit = um\n"), std::string::npos) << given;
  EXPECT_NE(given.find("2,3,4"), std::string::npos) << given;
}

TEST_F(CalibrateSession, from_nothing_to_an_applied_calibration_in_six_commands) {
  simulate("set", "--views 13 --seed 3");  // 1
  const Ended begun = run(new_in("a"));    // 2
  expect_next(begun, 0, "first view:");
  const Ended captured = run("calibrate capture --set " + file("set"));  // 3
  expect_next(captured, 0, "view 13/13 (10 for the fit, 3 held out)");
  expect_next(captured, 0, "slabctl calibrate solve");
  const Ended solved = run("calibrate solve");  // 4
  expect_next(solved, 0, "slabctl calibrate verify");
  const Ended verified = run("calibrate verify --yes");  // 5
  expect_next(verified, 0, "slabctl calibrate apply");
  const Ended applied = run("calibrate apply --robot-serial KR-1 --scanner-serial S-1 --temperature 21.5");  // 6
  expect_next(applied, 0, "is in force");

  const storage::CalibrationRecord record = in_force("a");
  EXPECT_EQ(record.robot_serial, "KR-1");
  EXPECT_EQ(record.temperature_c, 21.5);
  EXPECT_NE(record.observations.find("T_base_flange"), std::string::npos);
  const json truth = json::parse(content(file("set/truth.json")));
  const json figures = json::parse(record.figures, nullptr, false);
  EXPECT_EQ(figures["status"], "ok");
  EXPECT_LT(length(figures["T_flange_scanner"], truth["T_flange_scanner"]), 0.15);
  const json listed = list();
  EXPECT_TRUE(listed["solution"]["current"].get<bool>());
  EXPECT_TRUE(listed["solution"]["verified"].get<bool>());
  EXPECT_EQ(listed["views"].size(), 13U);
  EXPECT_LT(listed["views"][0]["residual_mm"].get<double>(), 0.1);
  // The original scans are kept.
  EXPECT_EQ(content(listed["views"][2]["shots"][0].get<std::string>()), content(file("set/view_03.ply")));

  // Neither corrections nor the robot's accuracy: commissioning is not complete, because no seat can pass.
  const std::string path = file("a/slabd.toml");
  for (const char* command : {"commission --config ", "doctor --no-write --config "})
    expect_mentions(run(command + path).out, "no seat can pass");
  std::string stated = content(path);
  stated.insert(stated.find("channel ="), "absolute_sigma_mm = 0.05\nabsolute_sigma_deg = 0.005\n");
  std::ignore = write("a/slabd.toml", stated);
  for (const char* command : {"commission --config ", "doctor --no-write --config "})
    EXPECT_EQ(run(command + path).out.find("no seat can pass"), std::string::npos);

  // The same from tables gives the same result.
  EXPECT_EQ(run("calibrate ball " + file("set/view_*.ply") + " --radius 25.4 --target " + file("t.txt")).status, 0);
  const Ended tables = run("calibrate solve --kind ball --flange " + file("set/flange.txt") + " --target " +
                           file("t.txt") + " --robot-sigma-mm 0.017 --fov 100 140 540 660 --json");
  EXPECT_LT(length(json::parse(tables.out)["T_flange_scanner"], figures["T_flange_scanner"]), 0.1);
}

TEST_F(CalibrateSession, every_step_speaks_chinese) {
  simulate("set", "--views 13 --seed 3");
  ::setenv("SLABD_LANGUAGE", "zh", 1);
  const auto step = [&](const std::string& command, int status = 0) {
    const Ended ended = run("calibrate " + command);
    EXPECT_EQ(ended.status, status) << command << "\n" << ended.out << ended.err;
    if (!ended.out.empty()) expect_chinese(ended.out);
    if (!ended.err.empty()) expect_chinese(ended.err);
    return ended.out + ended.err;
  };
  step("list", 3);
  expect_mentions(step(new_in("a").substr(10)), "第一个视图：");
  step("solve", 3);
  step("verify", 6);
  expect_mentions(step("capture --scan " + file("set/view_01.ply") + " --flange-file " + file("set/flange.txt:1")),
                  "下一个视图：");
  step("capture --scan " + file("set/view_02.ply") + " --flange-file " + file("set/flange.txt:1"), 6);
  step("capture --scan " + file("set/view_02.ply") + " --flange-file " + file("set/flange.txt:99"), 3);
  step("capture --set " + file("set"));
  step("drop 3 --reason \"" + std::string("碰到立柱") + "\"");
  step("list");
  expect_mentions(step("undo"), "重新计入");
  step("list");
  expect_mentions(step("solve"), "下一步：slabctl calibrate verify");
  step("list");
  step("apply", 6);
  step("verify", 6);
  step("verify --yes");
  expect_mentions(step("apply"), "已生效");
  step("history --config " + file("a/slabd.toml"));
  step("rollback --reason x --config " + file("a/slabd.toml"), 6);
  step("adopt --dry-run --sigma-mm 0.05 --sigma-deg 0.003 --config " + file("a/slabd.toml"));
  step("drop 99 --reason x", 3);
  simulate("block", "--kind block --recipe " + kRecipe + " --views 2");
  const std::string at = " --config " + file("a/slabd.toml");
  step("check" + at);
  step("check --live --ball" + at, 3);
  step("reference --certificate " + file("block/certificate.txt") + " --apply --reason x" + at);
  expect_mentions(step("check " + file("block/view_01.ply") + " --recipe " + kRecipe + at), "通过，标准器 rb-");
  step("check " + file("block/view_01.ply") + " --recipe " + kRecipe + at, 6);
  expect_mentions(step("check" + at), "下一次检查到期日");
  ::unsetenv("SLABD_LANGUAGE");
  const std::string english = run("calibrate list --json").out;
  EXPECT_EQ(run("calibrate list --json --language zh").out, english);
}

TEST_F(CalibrateSession, killed_at_any_moment_loses_nothing_and_ends_with_the_same_bits) {
  simulate("set", "--views 13 --seed 4");
  ASSERT_EQ(run(new_in("whole")).status, 0);
  // The kill times are chosen from the durations measured here.
  std::vector<double> took_us;
  for (const char* command : {"capture --set", "solve", "verify --yes", "apply"}) {
    std::string line = std::string("calibrate ") + command;
    if (line.ends_with("--set")) line += " " + file("set");
    const auto begun = std::chrono::steady_clock::now();
    ASSERT_EQ(run(line).status, 0) << command;
    took_us.push_back(std::chrono::duration<double, std::micro>(std::chrono::steady_clock::now() - begun).count());
  }
  const storage::CalibrationRecord whole = in_force("whole");
  ASSERT_FALSE(whole.id.empty());

  ASSERT_EQ(run(new_in("killed")).status, 0);
  const std::string session = file("killed/calibration/hall");
  Prng random(20);
  int killed = 0;
  std::size_t views = 0;
  const auto hit = [&](const std::vector<std::string>& arguments, int times, double us_max) {
    for (int i = 0; i < times; ++i) {
      if (run_killed(arguments, static_cast<long>(random.uniform() * us_max))) {
        ++killed;
      } else {
        us_max *= 0.7;  // the computer was busier when the duration was measured
      }
      const json now = list("--session " + session);  // must always be readable
      std::size_t counted = 0;
      for (const json& view : now["views"]) {
        EXPECT_TRUE(view["counts"].get<bool>()) << view.dump();
        ++counted;
      }
      EXPECT_GE(counted, views) << "a view was lost";
      views = counted;
    }
  };
  hit({"calibrate", "capture", "--set", file("set"), "--session", session}, 12, 0.4 * took_us[0]);
  ASSERT_EQ(run("calibrate capture --set " + file("set") + " --session " + session).status, 0);
  hit({"calibrate", "solve", "--session", session}, 6, took_us[1]);
  ASSERT_EQ(run("calibrate solve --session " + session).status, 0);
  hit({"calibrate", "verify", "--yes", "--session", session}, 4, took_us[2]);
  ASSERT_EQ(run("calibrate verify --yes --session " + session).status, 0);
  hit({"calibrate", "apply", "--session", session}, 8, took_us[3]);
  const Ended applied = run("calibrate apply --session " + session);
  ASSERT_EQ(applied.status, 0) << applied.err;
  EXPECT_GE(killed, 8) << "of 30; the moments were chosen too late to show anything";

  const storage::CalibrationRecord record = in_force("killed");
  EXPECT_EQ(record.id, whole.id);
  EXPECT_EQ(record.figures, whole.figures);
  EXPECT_EQ(without_times(record.observations), without_times(whole.observations));
  // Repeated apply commands count as one application.
  const json history = json::parse(run("calibrate history --json --config " + file("killed/slabd.toml")).out);
  EXPECT_EQ(history["applied"].size(), 1U);
  EXPECT_EQ(history["records"].size(), 1U);
}

TEST_F(CalibrateSession, an_apply_killed_while_it_opened_the_database_is_finished_by_the_next) {
  simulate("set", "--views 13 --seed 4");
  ASSERT_EQ(run(new_in("a")).status, 0);
  for (const std::string& command :
       {"capture --set " + file("set"), std::string("solve"), std::string("verify --yes"), std::string("apply")})
    ASSERT_EQ(run("calibrate " + command).status, 0) << command;
  // State after a process was killed while it copied the log: readers are blocked until a writer has recovered it.
  const std::string copy = file("a") + "/slabd.db-log-copy";
  std::ofstream(copy) << "half of a copy";
  const Ended again = run("calibrate apply");
  EXPECT_EQ(again.status, 0) << again.err;
  EXPECT_FALSE(std::filesystem::exists(copy));
}

TEST_F(CalibrateSession, a_view_from_a_pose_that_has_one_counts_for_nothing) {
  simulate("set", "--views 3 --seed 5");
  simulate("other", "--views 3 --seed 6");
  ASSERT_EQ(run(new_in("a")).status, 0);
  ASSERT_EQ(
      run("calibrate capture --scan " + file("set") + "/view_01.ply --flange-file " + file("set") + "/flange.txt:1")
          .status,
      0);
  // Another scan with the same flange pose.
  expect_next(
      run("calibrate capture --scan " + file("other") + "/view_01.ply --flange-file " + file("set") + "/flange.txt:1"),
      6, "REFUSED (same_pose): the flange is where it was for view 1");
  EXPECT_EQ(list()["views"].size(), 2U);
}

TEST_F(CalibrateSession, two_scans_that_say_the_same_view_and_shot_are_refused) {
  simulate("set", "--views 4 --seed 5");
  ASSERT_EQ(run(new_in("a")).status, 0);
  // A copy of another pose's scan; without the check the order of the folder would select the scan.
  for (const char* twin : {"view_3.ply", "view_003.ply", "view_03_1.ply", "view_03.xyz", "view_000000003.ply"}) {
    fs::copy_file(file("set/view_02.ply"), file("set") + "/" + twin);
    const Ended refused = run("calibrate capture --set " + file("set"));
    EXPECT_EQ(refused.status, 3) << twin << refused.out;
    expect_mentions(refused.err, "view_03.ply");
    expect_mentions(refused.err, twin);
    EXPECT_EQ(list()["views"].size(), 0U) << twin;
    fs::remove(file("set") + "/" + twin);
  }
  expect_next(run("calibrate capture --set " + file("set")), 0, "view 4/13");
}

TEST_F(CalibrateSession, pictures_beside_the_scans_are_none_of_them) {
  simulate("set", "--views 4 --seed 5");
  ASSERT_EQ(run(new_in("a")).status, 0);
  for (const char* other :
       {"set/view_04.png", "set/view_04.ply~", "set/view_04", "set/view_04_old.ply", "set/view_4x.ply"})
    ASSERT_FALSE(write(other, "no scan").empty());
  expect_next(run("calibrate capture --set " + file("set")), 0, "view 4/13");
  EXPECT_EQ(content(list()["views"][3]["shots"][0].get<std::string>()), content(file("set/view_04.ply")));
  // Views numbered from 0 would give every pose to the wrong scan.
  fs::rename(file("set/view_04.ply"), file("set/view_00.ply"));
  expect_next(run("calibrate capture --set " + file("set")), 3, "views are numbered from 1");
}

TEST_F(CalibrateSession, views_that_do_not_fit_each_other_are_said_while_they_are_captured) {
  simulate("set", "--views 10 --seed 5");
  // The robot reports the inverse, without a declaration.
  std::string table = content(file("set") + "/flange.txt");
  table.insert(0, "# format: frames=T_flange_base\n");
  ASSERT_FALSE(write("set/flange.txt", table).empty());
  ASSERT_EQ(run(new_in("a", "", 10)).status, 0);
  const Ended captured = run("calibrate capture --set " + file("set"));
  EXPECT_NE(captured.out.find("THE VIEWS DO NOT FIT EACH OTHER: they miss by"), std::string::npos) << captured.out;
  EXPECT_EQ(captured.out.find("predicted point error"), std::string::npos) << captured.out;
}

TEST_F(CalibrateSession, a_radius_that_the_ball_itself_contradicts_refuses_the_solution) {
  simulate("set", "--views 20 --seed 13");
  std::string wrong = new_in("a", "", 20);
  wrong.replace(wrong.find("--radius 25.4 "), 14, "--radius 25.44 ");
  ASSERT_EQ(run(wrong).status, 0);
  ASSERT_EQ(run("calibrate capture --set " + file("set")).status, 0);
  expect_next(run("calibrate solve"), 6, "ball_radius");
  expect_next(run("calibrate verify --yes"), 6, "not solved");
}

TEST_F(CalibrateSession, error_of_the_radius_is_reported_and_included_in_the_sigma_of_the_record) {
  simulate("set", "--views 13 --seed 13");
  const auto record_of = [this](const std::string& name, const std::string& radius, Ended& solved) {
    std::string begin = new_in(name, radius);
    if (begin.find("--radius 25.4 ") != begin.rfind("--radius ")) begin.erase(begin.find("--radius 25.4 "), 14);
    EXPECT_EQ(run(begin).status, 0);
    EXPECT_EQ(run("calibrate capture --set " + file("set")).status, 0);
    solved = run("calibrate solve");
    EXPECT_EQ(solved.status, 0) << solved.out << solved.err;
    const auto record = calib::parse_solved(content(file(name + "/calibration/hall/solutions/0014/solved.txt")), "");
    EXPECT_TRUE(record.ok());
    return record.ok() ? record.value() : calib::SolvedRecord{};
  };
  Ended solved;
  const calib::SolvedRecord sure = record_of("sure", "--radius-sigma-mm 0", solved);
  EXPECT_EQ(solved.out.find("certified"), std::string::npos) << solved.out;
  EXPECT_NEAR(sure.numbers.sigma_mm, sure.point_sigma_mm / std::sqrt(3.0), 1e-9);
  const calib::SolvedRecord unsure = record_of("unsure", "--radius-sigma-mm 0.05", solved);
  EXPECT_NE(solved.out.find("the certified radius is uncertain by 0.0500 mm"), std::string::npos) << solved.out;
  EXPECT_EQ(unsure.point_sigma_mm, sure.point_sigma_mm) << "the random part";
  // A centre moves along the view by 1.1 to 1.2 times the radius error.
  const double added_mm = std::sqrt(3.0 * (std::pow(unsure.numbers.sigma_mm, 2) - std::pow(sure.numbers.sigma_mm, 2)));
  EXPECT_GT(added_mm / 0.05, 1.0);
  EXPECT_LT(added_mm / 0.05, 1.35);
  // The scans show a radius error of 0.04 mm, which must be reported even if the certificate's uncertainty covers it.
  record_of("off", "--radius 25.44 --radius-sigma-mm 0.025", solved);
  EXPECT_NE(solved.out.find("the certificate's own uncertainty (0.0500 mm, k = 2) covers it"), std::string::npos)
      << solved.out;
}

TEST_F(CalibrateSession, a_solution_that_was_cut_short_keeps_its_number_and_blocks_nothing) {
  simulate("set", "--views 13 --seed 13");
  ASSERT_EQ(run(new_in("a")).status, 0);
  ASSERT_EQ(run("calibrate capture --set " + file("set")).status, 0);
  ASSERT_EQ(run("calibrate solve").status, 0);
  const std::string solutions = file("a/calibration/hall/solutions");
  const std::string whole = content(solutions + "/0014/solved.txt");
  for (const std::string& torn : {whole.substr(0, whole.size() / 2), std::string()}) {
    ASSERT_FALSE(write("a/calibration/hall/solutions/0014/solved.txt", torn).empty());
    fs::remove_all(solutions + "/0015");
    const Ended listed = run("calibrate list");
    expect_next(listed, 0, "solve again");
    expect_next(run("calibrate verify --yes"), 6, "slabctl calibrate solve");
    expect_next(run("calibrate solve"), 0, "(step 15)");
    EXPECT_EQ(content(solutions + "/0014/solved.txt"), torn) << "nothing is written over";
    expect_next(run("calibrate verify --yes"), 0, "slabctl calibrate apply");
  }
}

TEST_F(CalibrateSession, verify_checks_the_verdict_again) {
  simulate("set", "--views 13 --seed 13");
  std::string wrong = new_in("a");
  wrong.replace(wrong.find("--radius 25.4 "), 14, "--radius 25.44 ");
  ASSERT_EQ(run(wrong).status, 0);
  ASSERT_EQ(run("calibrate capture --set " + file("set")).status, 0);
  expect_next(run("calibrate solve --force"), 6, "ball_radius");
  // A record as stored by a slabctl that did not check the radius.
  const std::string path = "a/calibration/hall/solutions/0014/solved.txt";
  auto record = calib::parse_solved(content(file(path)), "solved.txt");
  ASSERT_TRUE(record.ok()) << record.error().text.view();
  ASSERT_FALSE(record.value().ok);
  record.value().ok = true;
  ASSERT_FALSE(write(path, calib::solved_text(record.value())).empty());
  expect_next(run("calibrate verify --yes"), 6, "is refused by now; next: slabctl calibrate solve");
  expect_next(run("calibrate apply"), 6, "slabctl calibrate verify");
}

TEST_F(CalibrateSession, a_database_whose_creation_was_stopped_does_not_stand_in_the_way) {
  simulate("set", "--views 10 --seed 13");
  ASSERT_EQ(run(new_in("a", "", 10)).status, 0);
  ASSERT_EQ(run("calibrate capture --set " + file("set")).status, 0);
  ASSERT_EQ(run("calibrate solve").status, 0);
  // An empty database file, as after an interruption between its creation and its first transaction.
  ASSERT_FALSE(write("a/slabd.db", "").empty());
  EXPECT_EQ(run("calibrate verify --yes").status, 0);
  EXPECT_EQ(run("calibrate history --config " + file("a/slabd.toml")).status, 0);
  expect_next(run("calibrate apply"), 0, "is in force");
  EXPECT_FALSE(in_force("a").id.empty());
  // The same after a kill within that transaction: a page, and a journal that restores an empty file. SQLite's file
  // format, section 3: magic, number of pages in it, nonce, pages before, sector size, page size.
  for (const char* side : {"", "-wal", "-shm"}) fs::remove(file("a/slabd.db") + side);
  std::string journal(
      "\xd9\xd5\x05\xf9\x20\xa1\x63\xd7"
      "\0\0\0\0"
      "abcd"
      "\0\0\0\0"
      "\0\0\2\0"
      "\0\0\x10\0",
      28);
  journal.resize(512, '\0');
  ASSERT_FALSE(write("a/slabd.db", std::string(4096, 'x')).empty());
  ASSERT_FALSE(write("a/slabd.db-journal", journal).empty());
  expect_next(run("calibrate history --config " + file("a/slabd.toml")), 0, "no calibration was ever put in force");
  EXPECT_EQ(run("calibrate verify --yes").status, 0);
  ASSERT_FALSE(write("a/slabd.db", std::string(4096, 'x')).empty());
  ASSERT_FALSE(write("a/slabd.db-journal", journal).empty());
  expect_next(run("calibrate apply"), 0, "is in force");
  EXPECT_FALSE(in_force("a").id.empty());
  // A file of another program is not taken for a database.
  ASSERT_EQ(run(new_in("b", "", 10)).status, 0);
  ASSERT_FALSE(write("b/slabd.db", "not a database, and it is longer than nothing").empty());
  EXPECT_NE(run("calibrate history --config " + file("b/slabd.toml")).status, 0);
  EXPECT_EQ(content(file("b/slabd.db")), "not a database, and it is longer than nothing");
}

TEST_F(CalibrateSession, a_half_copied_scan_is_named_and_counts_for_nothing) {
  simulate("set", "--views 2 --seed 5");
  ASSERT_EQ(run(new_in("a")).status, 0);
  const std::string part = file("a/calibration/hall/views/.part-1");
  fs::create_directories(part);
  std::ofstream(part + "/being-copied.txt") << "view_01.ply with T_base_flange 1 2 3\n";
  std::ofstream(part + "/shot_1.ply") << "ply\nform";
  const Ended shown = run("calibrate list");
  expect_next(shown, 0, "a capture was interrupted and is not used");
  expect_next(shown, 0, "capture it again: view_01.ply");
  EXPECT_EQ(list()["views"].size(), 0U);
  expect_next(run("calibrate capture --set " + file("set")), 0, "view 2/13");
  EXPECT_TRUE(list()["half_done"].empty());
}

TEST_F(CalibrateSession, a_scan_that_went_missing_is_named) {
  simulate("set", "--views 2 --seed 5");
  ASSERT_EQ(run(new_in("a")).status, 0);
  ASSERT_EQ(run("calibrate capture --set " + file("set")).status, 0);
  EXPECT_TRUE(list()["half_done"].empty());
  const std::string scan = file("a") + "/calibration/hall/views/002/shot_1.ply";
  ASSERT_TRUE(fs::remove(scan));
  const json named = list()["half_done"];
  ASSERT_EQ(named.size(), 1U);
  EXPECT_NE(named[0].get<std::string>().find(scan + " is gone"), std::string::npos) << named;
}

TEST_F(CalibrateSession, a_named_configuration_does_not_select_the_session_of_another_line) {
  ASSERT_EQ(run(new_in("hall-a")).status, 0);
  ASSERT_EQ(run(new_in("hall-b")).status, 0);
  EXPECT_EQ(list()["folder"], file("hall-b") + "/calibration/hall") << "the one worked on last";
  EXPECT_EQ(list("--config " + config("hall-a"))["folder"], file("hall-a") + "/calibration/hall");
  const Ended none = run("calibrate apply --config " + config("hall-c"));
  EXPECT_EQ(none.status, 3) << none.out << none.err;
  expect_mentions(none.err, "there is no calibration session yet in " + file("hall-c"));
  ASSERT_EQ(run("calibrate new " + file("anywhere") + "/ --radius 25.4").status, 0);
  EXPECT_EQ(list("--config " + config("hall-c"))["folder"], file("anywhere")) << "begun without a configuration";
}

TEST_F(CalibrateSession, lines_that_keep_their_sessions_in_one_folder_do_not_get_each_others) {
  const auto line = [this](const std::string& name) {
    const std::string path = config(name);
    std::string text = content(path);
    text.replace(text.find("[calibration]\n"), 14, "[calibration]\nsessions_dir = \"" + file("sessions") + "\"\n");
    return write(name + "/slabd.toml", text);
  };
  const std::string a = line("hall-a");
  const std::string b = line("hall-b");
  ASSERT_EQ(run("calibrate new one --config " + a + " --radius 25.4").status, 0);
  // The session is the last and the only one, but it must not be used for the other line.
  for (const char* command : {"list", "solve", "verify", "apply"}) {
    const Ended none = run(std::string("calibrate ") + command + " --config " + b);
    EXPECT_EQ(none.status, 3) << command << none.out << none.err;
    expect_mentions(none.err, "there is no calibration session of " + b + " yet in " + file("sessions"));
    expect_mentions(none.err, "one of " + a);
    expect_mentions(none.err, "slabctl calibrate new");
  }
  EXPECT_EQ(list("--config " + a)["folder"], file("sessions/one"));
  EXPECT_EQ(list("--config " + b + " --session one")["folder"], file("sessions/one")) << "named, it is meant";
  ASSERT_EQ(run("calibrate new two --config " + b + " --radius 25.4").status, 0);
  ASSERT_EQ(run("calibrate list --session one --config " + a).status, 0);
  EXPECT_EQ(list("--config " + b)["folder"], file("sessions/two")) << "the only one of this line";
  ASSERT_EQ(run("calibrate new three --config " + b + " --radius 25.4").status, 0);
  ASSERT_EQ(run("calibrate list --session one --config " + a).status, 0);
  const Ended several = run("calibrate list --config " + b);
  EXPECT_EQ(several.status, 3) << several.out << several.err;
  expect_mentions(several.err, "(three, two)");
}

TEST_F(CalibrateSession, drop_and_undo_go_back_step_by_step_and_delete_nothing) {
  simulate("set", "--views 3 --seed 6");
  ASSERT_EQ(run(new_in("a")).status, 0);
  ASSERT_EQ(run("calibrate capture --set " + file("set")).status, 0);
  expect_next(run("calibrate drop 2 --reason 'an operator leaned on the post'"), 0, "view 2/13");
  EXPECT_EQ(list()["views"][1]["use"], "dropped");
  EXPECT_EQ(list()["views"][1]["note"], "an operator leaned on the post");
  expect_next(run("calibrate drop 2 --reason again"), 3, "slabctl calibrate undo");
  expect_next(run("calibrate drop 9 --reason none"), 3, "slabctl calibrate list");
  expect_next(run("calibrate undo"), 0, "view 2 counts again");
  expect_next(run("calibrate undo"), 0, "view 3 is taken back");
  expect_next(run("calibrate undo"), 0, "view 2 is taken back");
  EXPECT_EQ(list()["coverage"]["views"], 1);
  // A capture that was undone can be repeated as a new view.
  expect_next(run("calibrate capture --set " + file("set")), 0, "view 3/13");
  EXPECT_EQ(list()["views"].size(), 5U);
  EXPECT_TRUE(fs::exists(file("a/calibration/hall/views/003/shot_1.ply")));
}

TEST_F(CalibrateSession, a_dropped_view_tells_why_it_is_dropped_now) {
  simulate("set", "--views 8 --seed 6");
  ASSERT_EQ(run(new_in("a")).status, 0);
  ASSERT_EQ(run("calibrate capture --set " + file("set")).status, 0);
  // Steps 9 and 11: sorted by file name, the later step is first.
  ASSERT_EQ(run("calibrate drop 3 --reason first").status, 0);
  ASSERT_EQ(run("calibrate undo").status, 0);
  ASSERT_EQ(run("calibrate drop 3 --reason second").status, 0);
  EXPECT_EQ(list()["views"][2]["note"], "second");
  expect_next(run("calibrate drop 3 --reason again"), 3, "dropped already (second)");
}

TEST_F(CalibrateSession, a_step_that_cannot_be_read_for_a_while_is_not_given_away) {
  simulate("set", "--views 4 --seed 6");
  ASSERT_EQ(run(new_in("a")).status, 0);
  ASSERT_EQ(run("calibrate capture --set " + file("set")).status, 0);
  const std::string newest = file("a/calibration/hall/views/004/view.txt");
  fs::rename(newest, newest + ".away");
  ASSERT_EQ(run("calibrate drop 4 --reason unreadable").status, 0);
  ASSERT_EQ(run("calibrate drop 2 --reason 'an operator leaned on the post'").status, 0);
  fs::rename(newest + ".away", newest);
  // Each undo takes back exactly one step.
  expect_next(run("calibrate undo"), 0, "view 2 counts again");
  expect_next(run("calibrate undo"), 0, "view 4 counts again");
  const json views = list()["views"];
  for (const json& view : views) EXPECT_TRUE(view["counts"].get<bool>()) << view.dump();
  EXPECT_EQ(views.size(), 4U);
}

TEST_F(CalibrateSession, a_view_that_was_changed_on_the_disk_is_named_and_left_out) {
  simulate("set", "--views 8 --seed 7");
  ASSERT_EQ(run(new_in("a")).status, 0);
  ASSERT_EQ(run("calibrate capture --set " + file("set")).status, 0);
  std::string text = content(file("a/calibration/hall/views/004/view.txt"));
  char& digit = text[text.find("T_scanner_target = ") + 21];
  digit = digit == '1' ? '2' : '1';
  std::ofstream(file("a/calibration/hall/views/004/view.txt")) << text;
  const json views = list()["views"];
  EXPECT_EQ(views[3]["use"], "UNREADABLE");
  EXPECT_FALSE(views[3]["counts"].get<bool>());
  const Ended solved = run("calibrate solve");
  expect_next(solved, 0, "view 4 is left out");
  expect_next(run("calibrate undo"), 0, "view 8 is taken back");
}

TEST_F(CalibrateSession, poses_are_read_as_declared) {
  simulate("set", "--views 3 --shots 2 --seed 8");
  const std::string numbers = content(file("set/flange.txt"));
  ASSERT_EQ(run(new_in("a", "--flange-form kuka")).status, 0);
  // A quaternion, although A, B, C were declared.
  const std::string shots = " --scan " + file("set/view_01_1.ply") + " --scan " + file("set/view_01_2.ply");
  expect_next(run("calibrate capture" + shots + " --flange '1 2 3 1 0 0 0'"), 3, "expected x y z A B C");
  expect_next(run("calibrate capture" + shots + " --flange-file " + file("set/flange.txt") + ":1"), 0,
              "2 shots repeat to");
  // The same scan cannot be two views.
  expect_next(run("calibrate capture" + shots + " --flange-file " + file("set/flange.txt") + ":2"), 3, "another pose");
  expect_next(run("calibrate capture" + shots + " --flange-file " + file("set/flange.txt") + ":99"), 3, "lines 1 to 3");
  expect_next(run("calibrate capture --scan " + file("set/view_02_1.ply") + " --flange '1500 200 900 10 20 170'"), 0,
              "view 2/13");
  EXPECT_EQ(list()["views"][0]["shots"].size(), 2U);
}

TEST_F(CalibrateSession, no_wrong_turn_is_a_dead_end) {
  // No session exists.
  const std::string none = config("none");
  expect_next(run("calibrate list --config " + none), 3, "slabctl calibrate new");
  expect_next(run("calibrate list --session ./nowhere"), 3, "slabctl calibrate new");
  expect_next(run("calibrate new x --config " + none), 2, "--radius");
  expect_next(run("calibrate new x --config " + none + " --kind artefact"), 2, "--certificate");
  expect_next(run("calibrate new x --config " + none + " --radius 25.4 --views 8"), 2, "at least 6");
  expect_next(run("calibrate new x --radius 25.4"), 2, "./x");
  for (const char* name :
       {"' '", "' x'", "'x '", ".hid", "./.hid", "\"$(printf 'x\\ny')\"", "\"$(printf 'x\\033[2Jy')\""}) {
    expect_next(run("calibrate new " + std::string(name) + " --radius 25.4 --config " + none), 2,
                "NAME: a session's name");
  }
  EXPECT_FALSE(fs::exists(file("none/calibration")));
  // An invalid configuration is bad input, whether the session is named or not.
  const std::string faulty = write("faulty.toml", "[plc]\nunitid = 3\n");
  expect_next(run("calibrate list --config " + faulty), 3, "unknown key");
  expect_next(run("calibrate list --session x --config " + faulty), 3, "unknown key");
  simulate("set", "--views 6 --seed 9");
  ASSERT_EQ(run(new_in("a")).status, 0);
  expect_next(run(new_in("a")), 3, "calibrate list --session");
  expect_next(run("calibrate solve"), 3, "slabctl calibrate capture");
  expect_next(run("calibrate verify"), 6, "slabctl calibrate solve");
  expect_next(run("calibrate apply"), 6, "slabctl calibrate solve");
  expect_next(run("calibrate undo"), 3, "slabctl calibrate list");
  expect_next(run("calibrate capture"), 2, "--scan");
  expect_next(run("calibrate capture --scan " + write("bad.ply", "ply\n") + " --flange '0 0 0 1 0 0 0'"), 3, "bad.ply");
  expect_next(run("calibrate capture --set " + file("state")), 3, "flange.txt");
  // A rejected view is stored and listed, but not counted.
  simulate("hidden", "--views 1 --seed 5 --hidden 0.5");
  expect_next(run("calibrate capture --set " + file("hidden")), 6, "cure:");
  EXPECT_EQ(list()["views"][0]["use"], "refused");
  // Too few views: rejected, stored only on request, never applied.
  EXPECT_EQ(run("calibrate capture --set " + file("set")).status, 0);
  EXPECT_EQ(run("calibrate drop 3 --reason test").status, 0);
  const Ended few = run("calibrate solve");
  expect_next(few, 6, "too_few_views");
  expect_next(few, 6, "slabctl calibrate capture");
  EXPECT_TRUE(list()["solution"].is_null());
  expect_next(run("calibrate solve --force"), 6, "never applied");
  expect_next(run("calibrate verify --yes"), 6, "slabctl calibrate solve");
  expect_next(run("calibrate apply"), 6, "never applied");
  // Enough views to solve, too few held out.
  EXPECT_EQ(run("calibrate undo").status, 0);
  expect_next(run("calibrate verify --yes"), 6, "slabctl calibrate solve");
}

TEST_F(CalibrateSession, a_change_above_a_fifth_of_a_millimetre_needs_a_word) {
  simulate("set", "--views 10 --seed 10");
  ASSERT_EQ(run(new_in("a", "", 10)).status, 0);
  ASSERT_EQ(run("calibrate capture --set " + file("set")).status, 0);
  ASSERT_EQ(run("calibrate solve").status, 0);
  const Ended unsaid = run("calibrate verify </dev/null");
  expect_next(unsaid, 6, "slabctl calibrate verify --yes");
  expect_next(run("calibrate apply"), 6, "slabctl calibrate verify");
  const Ended verified = run("calibrate verify --yes --json");
  EXPECT_EQ(verified.status, 0) << verified.err;
  const json told = json::parse(verified.out);
  EXPECT_GT(told["before"]["residual_mm"]["rms"].get<double>(), 10.0);
  EXPECT_LT(told["after"]["residual_mm"]["rms"].get<double>(), 0.1);
  EXPECT_EQ(told["stations"].size(), 16U);  // of the first recipe
  EXPECT_GT(told["shift_max_mm"].get<double>(), 10.0);
  // With one view less, the verified solution is not the one to be applied.
  ASSERT_EQ(run("calibrate drop 1 --reason test").status, 0);
  expect_next(run("calibrate apply"), 6, "slabctl calibrate solve");
  ASSERT_EQ(run("calibrate undo").status, 0);
  ASSERT_EQ(run("calibrate apply").status, 0);
  // Calibrated again from nearly the same views: a small change needs no confirmation.
  simulate("set2", "--views 10 --seed 10 --noise-mm 0.031");
  ASSERT_EQ(run("calibrate new again --config " + file("a/slabd.toml") +
                " --radius 25.4 --robot-sigma-mm 0.017 --fov 100 140 540 660 --views 10")
                .status,
            0);
  ASSERT_EQ(run("calibrate capture --set " + file("set2")).status, 0);
  ASSERT_EQ(run("calibrate solve").status, 0);
  expect_next(run("calibrate verify </dev/null"), 0, "slabctl calibrate apply");
  expect_next(run("calibrate apply"), 0, "slabctl calibrate rollback");
}

TEST_F(CalibrateSession, a_held_out_view_that_is_missed_refuses_the_solution) {
  simulate("set", "--views 13 --seed 11");
  // The pose of the held-out view 13 is wrong by 2 mm.
  std::string table = content(file("set/flange.txt"));
  const std::size_t last = table.rfind('\n', table.size() - 2) + 1;
  const double x = std::stod(table.substr(last));
  table = table.substr(0, last) + std::to_string(x + 2.0) + table.substr(table.find(' ', last));
  std::ofstream(file("set/flange.txt")) << table;
  ASSERT_EQ(run(new_in("a")).status, 0);
  ASSERT_EQ(run("calibrate capture --set " + file("set")).status, 0);
  ASSERT_EQ(run("calibrate solve").status, 0);
  const Ended verified = run("calibrate verify --yes");
  expect_next(verified, 6, "refused (held_out): view 13");
  expect_next(run("calibrate apply"), 6, "slabctl calibrate verify");
  ASSERT_EQ(run("calibrate drop 13 --reason 'wrong pose'").status, 0);
  expect_next(run("calibrate verify --yes"), 6, "capture --hold-out");
}

TEST_F(CalibrateSession, an_artefact_goes_the_same_way) {
  simulate("set", "--kind artefact --views 10 --shots 2 --seed 12");
  ASSERT_EQ(run("calibrate new frame --config " + config("a") + " --kind artefact --certificate " +
                file("set/certificate.txt") + " --robot-sigma-mm 0.017 --fov 100 140 540 660 --views 10")
                .status,
            0);
  expect_next(run("calibrate capture --set " + file("set")), 0, "view 10/10");
  ASSERT_EQ(run("calibrate solve").status, 0);
  ASSERT_EQ(run("calibrate verify --yes").status, 0);
  ASSERT_EQ(run("calibrate apply").status, 0);
  EXPECT_NE(in_force("a").certificate.find("simulated-artefact"), std::string::npos);
}

TEST_F(CalibrateSession, a_held_out_artefact_that_was_turned_where_it_stood_refuses_the_solution) {
  simulate("set", "--kind artefact --views 10 --seed 12");
  // The pose of the held-out view 10 is rotated about the artefact's origin by 0.3 degrees, so that only the rotation
  // is wrong.
  const json truth = json::parse(content(file("set/truth.json")));
  const Vec3 origin(truth["T_base_target"][0], truth["T_base_target"][1], truth["T_base_target"][2]);
  auto table = calib::parse_poses(content(file("set/flange.txt")), "flange.txt", calib::TableRole::flange);
  ASSERT_TRUE(table.ok());
  Pose about;
  about.translation_mm = origin;
  Pose turn;
  turn.rotation = Quat(Eigen::AngleAxisd(rad_from_deg(0.3), Eigen::Vector3d(Vec3(1.0, 2.0, 2.0) / 3.0)));
  Pose& last = table.value().poses.back();
  last = about * turn * about.inverse() * last;
  std::ofstream(file("set/flange.txt")) << calib::write_poses(table.value().poses, calib::PoseFormat{},
                                                              calib::TableRole::flange);
  ASSERT_EQ(run("calibrate new frame --config " + config("a") + " --kind artefact --certificate " +
                file("set/certificate.txt") + " --robot-sigma-mm 0.017 --fov 100 140 540 660 --views 10")
                .status,
            0);
  ASSERT_EQ(run("calibrate capture --set " + file("set")).status, 0);
  ASSERT_EQ(run("calibrate solve").status, 0);
  const Ended verified = run("calibrate verify --yes --json");
  expect_next(verified, 6, "refused (held_out): view 10 is missed by 0.29");
  expect_mentions(verified.err, "deg, limit 0.0");
  const json told = json::parse(verified.out);
  EXPECT_LT(told["after"]["residual_mm"]["max"].get<double>(), told["limit_mm"].get<double>());
  EXPECT_GT(told["after"]["residual_deg"]["max"].get<double>(), told["limit_deg"].get<double>());
}

TEST_F(CalibrateSession, an_old_calibration_is_not_revived_by_applying_it_again) {
  simulate("set", "--views 10 --seed 13");
  ASSERT_EQ(run(new_in("a", "", 10)).status, 0);
  for (const std::string& command : {"capture --set " + file("set"), std::string("solve"), std::string("verify --yes")})
    ASSERT_EQ(run("calibrate " + command).status, 0) << command;
  // One of the views was captured in 2020, the others today.
  const std::string path = "a/calibration/hall/views/001/view.txt";
  auto view = calib::parse_view(content(file(path)), "view.txt");
  ASSERT_TRUE(view.ok());
  ASSERT_EQ(view.value().use, calib::ViewUse::fit);
  view.value().captured = "2020-01-02T00:00:00Z";
  ASSERT_FALSE(write(path, calib::view_text(view.value())).empty());
  const Ended expired = run("calibrate apply");
  expect_next(expired, 6, "may be used until 2021-01-01T00:00:00Z");
  expect_next(expired, 6, "expired; calibrate again");
  EXPECT_TRUE(in_force("a").id.empty());
  ASSERT_EQ(run("calibrate apply --valid-days 14610 --robot-serial KR-1").status, 0);
  EXPECT_EQ(in_force("a").expires_utime_us, (1'577'923'200 + std::int64_t{14610} * 86'400) * 1'000'000);
  const Ended again = run("calibrate apply --valid-days 14610 --robot-serial KR-2");
  EXPECT_EQ(again.status, 0) << again.err;
  expect_mentions(again.err, "is kept already; its serial numbers and temperature are not changed");
  const json history = json::parse(run("calibrate history --json --config " + file("a/slabd.toml")).out);
  EXPECT_EQ(history["records"].size(), 1U);
  EXPECT_EQ(history["records"][0]["robot_serial"], "KR-1");
  // With another expiry the record is stored once more; repeating the command changes nothing.
  for (int i = 0; i < 2; ++i) EXPECT_EQ(run("calibrate apply --valid-days 14600").status, 0);
  EXPECT_TRUE(in_force("a").id.ends_with(".2")) << in_force("a").id;
  // The age of views with a future time is unknown: at each application they would look new.
  for (int i = 1; i <= 10; ++i) {
    const std::string one = fmt::format("a/calibration/hall/views/{:03}/view.txt", i);
    auto from_then = calib::parse_view(content(file(one)), "view.txt");
    ASSERT_TRUE(from_then.ok());
    from_then.value().captured = "2090-01-02T00:00:00Z";
    ASSERT_FALSE(write(one, calib::view_text(from_then.value())).empty());
  }
  const Ended to_come = run("calibrate apply --valid-days 100");
  expect_next(to_come, 6, "2090-01-02T00:00:00Z, a time to come");
}

TEST_F(CalibrateSession, a_certificate_that_was_changed_after_the_beginning_is_not_used) {
  simulate("set", "--kind artefact --views 2 --seed 12");
  ASSERT_EQ(run("calibrate new frame --config " + config("a") + " --kind artefact --certificate " +
                file("set/certificate.txt") + " --robot-sigma-mm 0.017 --fov 100 140 540 660 --views 10")
                .status,
            0);
  const std::string path = "a/calibration/frame/certificate.txt";
  const std::string before = content(file(path));
  ASSERT_FALSE(write(path, before + "# recertified\n").empty());
  expect_next(run("calibrate capture --set " + file("set")), 3, "certificate.txt was changed after the session began");
  ASSERT_FALSE(write(path, before).empty());
  expect_next(run("calibrate capture --set " + file("set")), 0, "view 2/10");
  const auto settings = calib::parse_session(content(file("a/calibration/frame/session.txt")), "session.txt");
  ASSERT_TRUE(settings.ok());
  EXPECT_EQ(settings.value().certificate_sha256, calib::sha256_hex(before));
  EXPECT_EQ(list()["views"].size(), 2U);
}

TEST_F(CalibrateSession, a_session_is_applied_to_its_own_line_only) {
  simulate("set", "--views 10 --seed 13");
  ASSERT_EQ(run(new_in("a", "", 10)).status, 0);
  for (const std::string& command : {"capture --set " + file("set"), std::string("solve"), std::string("verify --yes")})
    ASSERT_EQ(run("calibrate " + command).status, 0) << command;
  // The other line has the same commissioning value, so that only the configuration distinguishes them.
  const std::string elsewhere = "calibrate apply --session " + file("a/calibration/hall") + " --config " + config("b");
  expect_next(run(elsewhere), 6, "was begun with " + file("a/slabd.toml"));
  EXPECT_TRUE(in_force("b").id.empty());
  // Another configuration file with the same database is the same line.
  fs::copy_file(file("a/slabd.toml"), file("a/copy.toml"));
  expect_next(run("calibrate apply --session " + file("a/calibration/hall") + " --config " + file("a/copy.toml")), 0,
              "is in force");
  fs::create_directory_symlink(file("a"), file("by"));
  expect_next(run("calibrate apply --session " + file("a/calibration/hall") + " --config " + file("by/copy.toml")), 0,
              "is in force");
  expect_next(run(elsewhere + " --yes"), 0, "is in force");
  EXPECT_EQ(in_force("b").id, in_force("a").id);
}

TEST_F(CalibrateSession, a_slip_in_a_pose_is_cured_as_the_refusal_says) {
  simulate("set", "--views 4 --seed 5");
  const auto capture = [this](int scan, int line) {
    return run("calibrate capture --scan " + file("set/view_0") + std::to_string(scan) + ".ply --flange-file " +
               file("set/flange.txt") + ":" + std::to_string(line));
  };
  // The second scan with the first one's pose, then with its own pose.
  ASSERT_EQ(run(new_in("a")).status, 0);
  ASSERT_EQ(capture(1, 1).status, 0);
  expect_next(capture(2, 1), 6, "same_pose");
  expect_next(capture(2, 1), 6, "captured already, REFUSED");
  expect_next(capture(2, 2), 0, "view 3: accepted");
  expect_next(capture(2, 2), 0, "view 3: captured already, accepted");
  EXPECT_EQ(list()["views"].size(), 3U);
  // The first view was the wrong one.
  ASSERT_EQ(run(new_in("b")).status, 0);
  ASSERT_EQ(capture(1, 1).status, 0);
  expect_next(capture(2, 1), 6, "drop the other one and capture this again");
  ASSERT_EQ(run("calibrate drop 1 --reason 'wrong pose'").status, 0);
  expect_next(capture(2, 1), 0, "view 3: accepted");
  expect_next(capture(2, 1), 0, "view 3: captured already, accepted");
  expect_next(capture(1, 1), 0, "view 1: captured already, and DROPPED");
  EXPECT_EQ(list()["views"].size(), 3U);
  // A view with the pose of another view.
  ASSERT_EQ(run(new_in("c")).status, 0);
  ASSERT_EQ(capture(1, 1).status, 0);
  ASSERT_EQ(capture(2, 4).status, 0);
  expect_next(capture(2, 2), 3, "slabctl calibrate drop 2 --reason \"wrong pose\", then give this command again");
  ASSERT_EQ(run("calibrate drop 2 --reason 'wrong pose'").status, 0);
  expect_next(capture(2, 2), 0, "view 3: accepted");
  expect_next(run("calibrate capture --set " + file("set")), 0, "view 4/13");
  EXPECT_EQ(list()["views"].size(), 5U) << "1, 2 dropped, 2, 3 and 4";
}

TEST_F(CalibrateSession, a_step_that_was_damaged_leaves_its_view_out_and_blocks_nothing) {
  simulate("set", "--views 4 --seed 6");
  ASSERT_EQ(run(new_in("a")).status, 0);
  ASSERT_EQ(run("calibrate capture --set " + file("set")).status, 0);
  ASSERT_EQ(run("calibrate drop 2 --reason 'an operator leaned on the post'").status, 0);
  const std::string path = "a/calibration/hall/views/002/drop-5.txt";
  const std::string whole = content(file(path));
  for (const std::string& torn : {whole.substr(0, whole.size() / 2), std::string()}) {
    ASSERT_FALSE(write(path, torn).empty());
    const json views = list()["views"];
    EXPECT_EQ(views[1]["use"], "UNREADABLE");
    EXPECT_FALSE(views[1]["counts"].get<bool>());
    expect_mentions(views[1]["note"].get<std::string>(), "drop-5.txt");
    expect_mentions(views[1]["note"].get<std::string>(), "put that file back as it was, or remove it");
    // Its scan is not accepted as a new one.
    expect_next(run("calibrate capture --set " + file("set")), 3, "a scan of view 2");
  }
  ASSERT_EQ(run("calibrate drop 3 --reason test").status, 0);
  EXPECT_TRUE(fs::exists(file("a/calibration/hall/views/003/drop-6.txt"))) << "step 5 is not given away";
  ASSERT_FALSE(write(path, whole).empty());
  EXPECT_EQ(list()["views"][1]["note"], "an operator leaned on the post");
}

TEST_F(CalibrateSession, a_decimal_comma_in_a_pose_is_named) {
  simulate("set", "--views 1 --seed 8");
  ASSERT_EQ(run(new_in("a", "--flange-form kuka")).status, 0);
  const Ended comma =
      run("calibrate capture --scan " + file("set/view_01.ply") + " --flange '1500,25 200 900 10 20 170'");
  expect_next(comma, 3, "write 1500.2, not 1500,2");
  expect_next(comma, 3, "--flange: ");
}

}  // namespace
}  // namespace slabd::cli
