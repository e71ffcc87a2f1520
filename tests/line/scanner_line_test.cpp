// SPDX-License-Identifier: Apache-2.0
//
// The scanner's acceptance through the real programs: scans of a plate and a ball become a record in the database. The
// running daemon applies it, U follows it, and a slab measured again gives the same numbers.
#include <gtest/gtest.h>

#include <cmath>
#include <functional>
#include <limits>
#include <nlohmann/json.hpp>
#include <thread>

#include "base/calibration.h"
#include "base/prng.h"
#include "hal/hal.h"
#include "processes.h"

namespace slabd::line {
namespace {

using nlohmann::json;

constexpr double kAway_mm = 600.0;
constexpr double kBall_mm = 50.0;  ///< diameter

/// A scan by a scanner with this form error: one ray for each point, noise along the ray.
struct Artefacts {
  double bend_mm = 0.0;    ///< half depth of a bowl over a plate
  double apart_mm = 11.0;  ///< shift of the artefact along the axis between scans

  std::vector<float> scan(std::size_t side, double field_mm, std::uint64_t seed,
                          const std::function<double(double, double)>& depth_at) const {
    Prng prng(seed);
    std::vector<float> xyz;
    for (std::size_t row = 0; row < side; ++row)
      for (std::size_t column = 0; column < side; ++column) {
        const double step = field_mm / static_cast<double>(side);
        const double x = (static_cast<double>(column) + 0.5) * step - 0.5 * field_mm;
        const double y = (static_cast<double>(row) + 0.5) * step - 0.5 * field_mm;
        const double share = (depth_at(x, y) + 0.01 * prng.normal()) / kAway_mm;
        for (const double v : {x * share, y * share, kAway_mm * share}) xyz.push_back(static_cast<float>(v));
      }
    return xyz;
  }
  [[nodiscard]] std::vector<float> plate(std::uint64_t seed) const {
    const double half = 60.0;
    const double away_mm = kAway_mm + apart_mm * static_cast<double>(seed);
    return scan(240, 2.0 * half, seed,
                [&](double x, double y) { return away_mm + bend_mm * ((x * x + y * y) / (half * half) - 1.0); });
  }
  [[nodiscard]] std::vector<float> ball(std::uint64_t seed) const {
    const double off_mm = 0.2 * apart_mm * (static_cast<double>(seed) - 5.0);
    return scan(400, 120.0, seed, [&](double x, double y) {
      // Intersection of the ray and the sphere, as a fraction of the ray's length.
      const Vec3 ray(x, y, kAway_mm);
      const Vec3 centre(off_mm, -off_mm, kAway_mm + apart_mm * static_cast<double>(seed));
      const double along = ray.dot(centre) / ray.squaredNorm();
      const double miss = centre.squaredNorm() - along * along * ray.squaredNorm();
      const double inside = 0.25 * kBall_mm * kBall_mm - miss;
      if (inside < 0.0) return std::numeric_limits<double>::quiet_NaN();
      return kAway_mm * (along - std::sqrt(inside) / ray.norm());
    });
  }
};

struct ScannerLine : testing::Test {
  Box box;

  json status() {
    const Box::Answer answer = box.slabctl({"status", "--config", box.config.native(), "--json"});
    EXPECT_EQ(answer.exit_status, 0) << answer.err;
    return json::parse(answer.out, nullptr, false);
  }
  [[nodiscard]] bool warns() { return (status()["warn_bits"].get<unsigned>() & kWarnScannerNotVerified) != 0; }
  void start() {
    box.start();
    ASSERT_TRUE(box.ready()) << box.log();
    for (int i = 0; i < 3'000; ++i) {
      const Box::Answer answer = box.slabctl({"status", "--config", box.config.native(), "--json"});
      if (answer.exit_status == 0 && json::parse(answer.out)["state"] != "recover") return;
      std::this_thread::sleep_for(std::chrono::milliseconds(20));
    }
    FAIL() << "slabd does not answer: " << box.log();
  }
  /// Writes the scans and returns the names of the files.
  void draw(const std::string& name, Artefacts artefacts, int plates, int balls, double apart_mm = 11.0) {
    artefacts.apart_mm = apart_mm;
    files_ = {"--diameter-mm", std::to_string(kBall_mm)};
    const auto keep = [&](const char* what, int number, std::size_t side, const std::vector<float>& xyz) {
      const std::string path = (box.dir / (name + what + std::to_string(number) + ".ply")).native();
      ASSERT_TRUE(hal::write_ply(path.c_str(), xyz, side, side).ok());
      files_.insert(files_.end(), {std::string("--") + what, path});
    };
    for (int i = 1; i <= plates; ++i) keep("plate", i, 240, artefacts.plate(static_cast<std::uint64_t>(i)));
    for (int i = 1; i <= balls; ++i) keep("ball", i, 400, artefacts.ball(static_cast<std::uint64_t>(i)));
  }
  Box::Answer verify(std::vector<std::string> more) {
    std::vector<std::string> args = {"scanner", "verify"};
    args.insert(args.end(), files_.begin(), files_.end());
    args.insert(args.end(), more.begin(), more.end());
    args.insert(args.end(), {"--config", box.config.native(), "--json"});
    return box.slabctl(args);
  }
  Box::Answer apply(std::vector<std::string> more = {}) {
    more.insert(more.end(), {"--apply", "--operator", "anna", "--reason", "yearly acceptance", "--scanner", "SN7"});
    return verify(more);
  }
  json slab(const std::string& id, const char* number) {
    const Box::Answer line = box.slabctl({"simulate", "--config", box.config.native(), "--points", "quarter",
                                          "--slab-no", number, "--slab-id", id, "--slab-type", "5600", "--seed", "11"});
    EXPECT_LE(line.exit_status, 1) << line.out << line.err;
    return show(id);
  }
  json show(const std::string& id) {
    const Box::Answer shown = box.slabctl({"show", id, "--config", box.config.native(), "--json"});
    EXPECT_EQ(shown.exit_status, 0) << shown.err;
    return json::parse(shown.out, nullptr, false);
  }
  void expect_identical(const std::string& id) {
    const Box::Answer again = box.slabctl({"replay", id, "--verify", "--config", box.config.native(), "--json"});
    EXPECT_EQ(again.exit_status, 0) << again.out << again.err;
    EXPECT_EQ(json::parse(again.out, nullptr, false)["slabs"][0]["outcome"], "identical") << id;
  }
  static json item(const json& slab, const char* id) {
    for (const json& i : slab["blocks"][2]["result"]["items"])
      if (i["id"] == id) return i;
    return nullptr;
  }

 private:
  std::vector<std::string> files_;
};

TEST_F(ScannerLine, an_acceptance_raises_U_of_the_next_slab_and_is_found_again_when_it_is_remeasured) {
  start();
  EXPECT_TRUE(warns()) << "never verified";
  EXPECT_EQ(status()["fault"]["code"], 0) << "which stops nothing";
  EXPECT_TRUE(status()["calibration"]["scanner"].is_null());
  const json before = slab("BEFORE", "1");
  EXPECT_EQ(before["scanner_id"], "");

  draw("bent", {0.2}, kPlatePlacesMin, kBallPlacesMin);
  const Box::Answer accepted = apply({"--valid-days", "365"});
  ASSERT_EQ(accepted.exit_status, 0) << accepted.err;
  const json record = json::parse(accepted.out);
  const std::string id = record["id"];
  EXPECT_EQ(id.substr(0, 3), "sc-");
  EXPECT_TRUE(record["in_force"]);
  EXPECT_GT(record["form_half_mm"].get<double>(), 0.1);
  EXPECT_FALSE(warns());
  EXPECT_EQ(status()["calibration"]["scanner"]["id"], id);
  EXPECT_EQ(status()["calibration"]["scanner"]["state"], "verified");
  EXPECT_GT(status()["calibration"]["scanner"]["expires_utime_us"].get<std::int64_t>(), 0);

  const json after = slab("AFTER", "2");
  EXPECT_EQ(after["scanner_id"], id);
  for (const char* name :
       {"seat_slope", "jaw_angle_inner", "jaw_distance", "casing_spacing", "casing_protrusion_inner"}) {
    const json then = item(before, name);
    const json now = item(after, name);
    EXPECT_GT(now["U"].get<double>(), 1.2 * then["U"].get<double>()) << name;
    EXPECT_GT(now["budget"]["scanner"].get<double>(), 1.5 * then["budget"]["scanner"].get<double>()) << name;
  }
  EXPECT_GT(after["items"][0]["budget"]["scanner"].get<double>(),
            1.5 * before["items"][0]["budget"]["scanner"].get<double>())
      << "items of the slab, too";
  const Box::Answer shown = box.slabctl({"show", "AFTER", "--block", "3", "--config", box.config.native()});
  EXPECT_NE(shown.out.find("and acceptance " + id), std::string::npos) << shown.out;
  const Box::Answer without = box.slabctl({"show", "BEFORE", "--block", "3", "--config", box.config.native()});
  EXPECT_NE(without.out.find("alone, the scanner was not verified"), std::string::npos) << without.out;

  expect_identical("BEFORE");
  expect_identical("AFTER");
  box.kill_hard();
  start();
  EXPECT_EQ(status()["calibration"]["scanner"]["id"], id);
  const json history =
      json::parse(box.slabctl({"calibrate", "history", "--config", box.config.native(), "--json"}).out);
  EXPECT_EQ(history["applied"][0]["kind"], "scanner");
  EXPECT_EQ(history["applied"][0]["why"], "yearly acceptance");
  EXPECT_EQ(history["applied"][0]["who"].get<std::string>().substr(0, 4), "anna");
  EXPECT_EQ(box.stop(), 0);
}

TEST_F(ScannerLine, a_scanner_better_than_its_specification_leaves_U_as_it_is_and_a_bad_one_is_refused_and_warned_of) {
  start();
  const json before = slab("BEFORE", "1");
  draw("few", {0.0}, kPlatePlacesMin - 1, kBallPlacesMin);
  const Box::Answer few = apply();
  EXPECT_EQ(few.exit_status, 6);
  EXPECT_NE(few.err.find("requires 6 and 10"), std::string::npos) << few.err;
  draw("noball", {0.0}, kPlatePlacesMin, 0);
  const Box::Answer no_ball = apply();
  EXPECT_EQ(no_ball.exit_status, 6);
  EXPECT_NE(no_ball.err.find("no scan of a ball"), std::string::npos) << no_ball.err;
  EXPECT_TRUE(json::parse(box.slabctl({"scanner", "history", "--config", box.config.native(), "--json"}).out)["records"]
                  .empty())
      << "what was refused for want of scans is not kept";
  EXPECT_TRUE(warns());
  EXPECT_EQ(verify({"--apply", "--operator", "anna"}).exit_status, 2) << "without a reason";

  draw("same", {0.0}, kPlatePlacesMin, kBallPlacesMin, 0.0);
  const Box::Answer same = apply();
  EXPECT_EQ(same.exit_status, 6);
  EXPECT_NE(same.err.find("the plate was measured in 1 places and the ball in 1"), std::string::npos) << same.err;
  EXPECT_NE(same.err.find("10 scans of 1"), std::string::npos) << same.err;

  draw("good", {0.0}, kPlatePlacesMin, kBallPlacesMin);
  ASSERT_EQ(apply({"--limit-rf-mm", "0.2"}).exit_status, 0);
  EXPECT_FALSE(warns());
  const std::string id = status()["calibration"]["scanner"]["id"];
  const json after = slab("AFTER", "2");
  EXPECT_EQ(after["scanner_id"], id);
  // Another scan of another slab: equal except for noise and pose.
  for (const char* name : {"seat_slope", "jaw_angle_inner", "jaw_distance", "casing_spacing", "seat_flatness"}) {
    const double then = item(before, name)["U"].get<double>();
    EXPECT_NEAR(item(after, name)["U"].get<double>(), then, 0.05 * then) << name;
  }

  draw("bent", {0.2}, kPlatePlacesMin, kBallPlacesMin);
  const Box::Answer bad = apply({"--limit-rf-mm", "0.2"});
  EXPECT_EQ(bad.exit_status, 6);
  EXPECT_NE(bad.err.find("RF "), std::string::npos) << bad.err;
  EXPECT_NE(bad.err.find("kept as sc-"), std::string::npos) << bad.err;
  EXPECT_EQ(status()["calibration"]["scanner"]["id"], id) << "the last good one stays";
  EXPECT_EQ(status()["calibration"]["scanner"]["state"], "failed");
  EXPECT_TRUE(warns());
  EXPECT_EQ(status()["fault"]["code"], 0);
  const Box::Answer doctor = box.slabctl({"doctor", "--config", box.config.native(), "--listen-s", "1"});
  EXPECT_NE(doctor.out.find("out of its limits"), std::string::npos) << doctor.out;
  const Box::Answer old = box.slabctl({"calibrate", "apply", id, "--reason", "again", "--config", box.config.native()});
  EXPECT_EQ(old.exit_status, 0) << old.err;
  EXPECT_NE(old.err.find("the line goes on warning"), std::string::npos) << "in force, and of what use: " << old.err;
  const std::string bad_id = json::parse(bad.out)["id"];
  const Box::Answer forced =
      box.slabctl({"calibrate", "apply", bad_id, "--reason", "it must run", "--config", box.config.native()});
  EXPECT_EQ(forced.exit_status, 6);
  EXPECT_NE(forced.err.find("out of the limits"), std::string::npos) << forced.err;
  EXPECT_EQ(box.stop(), 0);
}

}  // namespace
}  // namespace slabd::line
