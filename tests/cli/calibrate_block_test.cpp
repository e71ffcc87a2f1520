// SPDX-License-Identifier: Apache-2.0
//
// slabctl calibrate block as a process: finds the scanner's pose from tilted scans of a block, registered one after
// the other.
#include <cmath>
#include <nlohmann/json.hpp>

#include "calib/calib.h"
#include "tests/cli/slabctl_process.h"
#include "tests/places/places.h"

namespace slabd::cli {
namespace {

using nlohmann::json;

class CalibrateBlock : public Slabctl {
 protected:
  const Pose X_ = {Quat(0.9961947018, 0.0, 0.0871557002, 0.0).normalized(), Vec3(40.0, -25.0, 180.0)};
  const std::string recipe_ = places::source_dir() + "/recipes/p5600.toml";

  /// Straight down first, then 22 degrees to eight sides, also rotated about the view.
  void draw(int views) const {
    std::vector<Pose> flange;
    const Vec3 block(1500.0, 200.0, 600.0);
    for (int i = 0; i < views; ++i) {
      const double side = 2.0 * kPi * i / 8.0;
      const Quat tilt(
          Eigen::AngleAxisd(rad_from_deg(i == 0 ? 0.0 : 22.0), Eigen::Vector3d(std::cos(side), std::sin(side), 0.0)));
      const Quat roll(
          Eigen::AngleAxisd(rad_from_deg(i % 2 == 0 ? 25.0 : -35.0) * (i == 0 ? 0.0 : 1.0), Eigen::Vector3d::UnitZ()));
      Pose T_base_scanner;
      T_base_scanner.rotation = (tilt * Quat(0.0, 1.0, 0.0, 0.0) * roll).normalized();
      T_base_scanner.translation_mm = block - T_base_scanner.rotation * Vec3(0.0, 0.0, 600.0);
      flange.push_back(T_base_scanner * X_.inverse());
    }
    ASSERT_FALSE(write("poses.txt", calib::write_poses(flange, calib::PoseFormat{}, calib::TableRole::flange)).empty());
    const Ended drawn = run("simulate calibration --kind block --recipe " + recipe_ + " --poses " + file("poses.txt") +
                            " --out " + file("set") + " --seed 2 --robot-sigma-mm 0.017");
    ASSERT_EQ(drawn.status, 0) << drawn.err;
  }
  [[nodiscard]] std::string block(int views, const std::string& start) const {
    std::string command = "calibrate block";
    for (int i = 1; i <= views; ++i) command += " " + file("set") + "/view_0" + std::to_string(i) + ".ply";
    return command + " --recipe " + recipe_ + " --flange " + file("set") + "/flange.txt --start \"" + start +
           "\" --target " + file("target.txt");
  }
};

TEST_F(CalibrateBlock, a_block_seen_from_all_sides_is_an_artefact) {
  draw(9);
  // The start pose is off by 9 mm and 1.4 degrees. A hard link to the existing table shows that it is replaced and not
  // written in place.
  fs::create_hard_link(write("target.txt", "what was there"), file("old.txt"));
  const Ended found = run(block(9, "45 -20 185 0.995 0 0.0998 0"));
  ASSERT_EQ(found.status, 0) << found.out << found.err;
  EXPECT_EQ(content(file("old.txt")), "what was there");
  const Ended solved =
      run("calibrate solve --json --kind pose --flange " + file("set") + "/flange.txt --target " + file("target.txt") +
          " --robot-sigma-mm 0.017 --target-sigma-mm 0.02 --target-sigma-deg 0.005");
  ASSERT_EQ(solved.status, 0) << solved.out << solved.err;
  const json out = json::parse(solved.out);
  std::array<double, 7> X{};
  for (std::size_t k = 0; k < 7; ++k) X[k] = out["T_flange_scanner"][k];
  const Pose off = X_.inverse() * Pose::from_array(X);
  // Position of a point 600 mm in front of the scanner.
  EXPECT_LT((off * Vec3(0.0, 0.0, 600.0) - Vec3(0.0, 0.0, 600.0)).norm(), 0.1);
}

TEST_F(CalibrateBlock, a_scan_without_the_block_where_it_should_be_is_refused_and_nothing_is_written) {
  draw(2);
  // The poses of the two views are exchanged: the first one does not look straight down.
  std::string table = content(file("set") + "/flange.txt");
  ASSERT_FALSE(write("turned.txt", table).empty());
  std::string command = block(2, "40 -25 180 0.9961947 0 0.0871557 0");
  const std::string first = file("set") + "/view_01.ply";
  const std::string second = file("set") + "/view_02.ply";
  command.replace(command.find(first), first.size(), second);
  const Ended refused = run(command);
  EXPECT_EQ(refused.status, 6) << refused.out << refused.err;
  EXPECT_NE(refused.err.find("Remedy"), std::string::npos) << refused.err;
  EXPECT_NE(run("calibrate block " + first + " " + second + " " + first + " --recipe " + recipe_ + " --flange " +
                file("set") + "/flange.txt --start \"40 -25 180 0.9961947 0 0.0871557 0\"")
                .err.find("2 poses for 3 scans"),
            std::string::npos);
}

}  // namespace
}  // namespace slabd::cli
