// SPDX-License-Identifier: Apache-2.0
//
// slabctl fit-plane and simulate plane: the set-up of the paper's Table 1, from the seed of the published figures,
// with two commands.
#include <nlohmann/json.hpp>
#include <tuple>

#include "base/limits.h"
#include "tests/cli/slabctl_process.h"

namespace slabd::cli {
namespace {

using nlohmann::json;

class FitPlane : public Slabctl {
 protected:
  void draw(const std::string& name, const std::string& more = "") const {
    const Ended ended = run("simulate plane --out " + file(name) + " " + more);
    ASSERT_EQ(ended.status, 0) << ended.err;
  }
  [[nodiscard]] Ended fit(const std::string& name, const std::string& more) const {
    return run("fit-plane " + file(name) + " " + more);
  }
  [[nodiscard]] json fitted(const std::string& name, const std::string& more) const {
    const Ended ended = fit(name, more + " --json");
    EXPECT_EQ(ended.status, 0) << ended.err;
    return json::parse(ended.out, nullptr, false);
  }
  static double number(const json& document, const char* key) { return document[key].get<double>(); }
};

TEST_F(FitPlane, noiseless_plane_is_exact_under_a_fifth_of_outliers) {
  draw("plane.xyz", "--noise 0");
  const json plane = fitted("plane.xyz", "");
  EXPECT_NEAR(number(plane, "a"), 1.0, 1e-9);
  EXPECT_NEAR(number(plane, "b"), 2.0, 1e-9);
  EXPECT_NEAR(number(plane, "c"), 1.0, 1e-9);
  EXPECT_EQ(plane["status"], "ok");
  EXPECT_EQ(plane["points"], 2500);
  EXPECT_EQ(plane["inliers"], 2000);
}

TEST_F(FitPlane, noisy_plane_is_the_fixed_point_of_the_published_vector) {
  draw("plane.xyz");
  const json plane = fitted("plane.xyz", "--threshold 0.03");
  EXPECT_NEAR(number(plane, "a"), 0.9994872364, 1e-9);
  EXPECT_NEAR(number(plane, "b"), 1.9997927646, 1e-9);
  EXPECT_NEAR(number(plane, "c"), 1.0001436124, 1e-9);
  EXPECT_EQ(plane["inliers"], 2000);
  EXPECT_EQ(plane["schema"], "slabd.plane/1");
  EXPECT_EQ(plane["hypotheses"], 104);
  EXPECT_GT(plane["iterations"].get<int>(), 0);
  ASSERT_EQ(plane["normal"].size(), 3U);
  EXPECT_NEAR(plane["normal"][2].get<double>(), 1.0 / std::sqrt(6.0), 1e-3);
  EXPECT_NEAR(number(plane, "offset_mm"), 1.0 / std::sqrt(6.0), 1e-3);
  EXPECT_NEAR(number(plane, "std_mm"), 0.01, 5e-4);
}

TEST_F(FitPlane, without_outliers_least_squares_is_the_published_oracle) {
  draw("plane.xyz", "--outliers 0");
  const json plane = fitted("plane.xyz", "--method lsq");
  EXPECT_NEAR(number(plane, "a"), 0.9995290355, 1e-9);
  EXPECT_NEAR(number(plane, "b"), 1.9998334468, 1e-9);
  EXPECT_NEAR(number(plane, "c"), 1.0002200430, 1e-9);
  EXPECT_EQ(plane["method"], "lsq");
}

TEST_F(FitPlane, comparison_is_the_papers_table_with_the_truth_above_it) {
  draw("plane.xyz");
  const Ended text = fit("plane.xyz", "--compare --threshold 0.03 --set 1 2 1");
  EXPECT_EQ(text.status, 0) << text.err;
  const std::size_t set = text.out.find("\nset  ");
  const std::size_t lsq = text.out.find("\nlsq  ");
  const std::size_t ransac = text.out.find("\nransac  ");
  const std::size_t improved = text.out.find("\nimproved  ");
  EXPECT_LT(set, lsq) << text.out;
  EXPECT_LT(lsq, ransac) << text.out;
  EXPECT_LT(ransac, improved) << text.out;
  EXPECT_NE(improved, std::string::npos);
  expect_mentions(text.out, "1.0000000  2.0000000  1.0000000");
  expect_mentions(text.out, "0.9994872  1.9997928  1.0001436");

  const json table = fitted("plane.xyz", "--compare --threshold 0.03 --set 1 2 1");
  EXPECT_EQ(table["schema"], "slabd.plane_comparison/1");
  ASSERT_EQ(table["methods"].size(), 3U);
  const double of_lsq = number(table["methods"][0], "rms_error");
  const double of_ransac = number(table["methods"][1], "rms_error");
  const double of_improved = number(table["methods"][2], "rms_error");
  EXPECT_GT(of_lsq, 10 * of_ransac) << "every outlier pulls at it";
  EXPECT_GT(of_ransac, 2 * of_improved) << "three points are noisier than two thousand";
  EXPECT_LT(of_improved, 0.001);
}

TEST_F(FitPlane, a_share_below_the_limit_is_not_measured_and_told) {
  draw("plane.xyz");
  const Ended ended = fit("plane.xyz", "--share-min 0.9 --json");
  EXPECT_EQ(ended.status, 1);
  const json plane = json::parse(ended.out);
  EXPECT_EQ(plane["status"], "not_measured");
  EXPECT_NEAR(number(plane, "inlier_fraction"), 0.8, 0.01);
  expect_mentions(ended.err, "not measured: the inliers' share is 0.8");
  expect_mentions(ended.err, "needed is 0.9");
}

TEST_F(FitPlane, points_without_a_plane_are_not_measured) {
  draw("cloud.xyz", "--points 0 --outliers 3000");
  EXPECT_EQ(fit("cloud.xyz", "--threshold 0.03").status, 1);
  const Ended thick = fit("cloud.xyz", "");
  EXPECT_EQ(thick.status, 1) << thick.out;
  expect_mentions(thick.err, "as far from their best plane as they reach along it");
  const Ended line = fit(fs::path(write("line.xyz", "0 0 0\n1 1 1\n2 2 2\n3 3 3\n")).filename().string(), "");
  EXPECT_EQ(line.status, 1);
  expect_mentions(line.err, "not measured");
}

TEST_F(FitPlane, a_plane_that_stands_upright_has_a_normal_and_no_z) {
  std::string text;
  for (int i = 0; i < 10; ++i)
    for (int j = 0; j < 10; ++j) text += "5 " + std::to_string(i) + " " + std::to_string(j) + "\n";
  std::ignore = write("wall.xyz", text);
  const json plane = fitted("wall.xyz", "");
  EXPECT_TRUE(plane["a"].is_null());
  EXPECT_TRUE(plane["c"].is_null());
  EXPECT_NEAR(std::abs(plane["normal"][0].get<double>()), 1.0, 1e-12);
  expect_mentions(fit("wall.xyz", "").out, "is vertical");
}

TEST_F(FitPlane, unit_of_the_file_is_declared) {
  std::ignore = write("metres.xyz", "0 0 1\n1 0 1\n0 1 1\n1 1 1\n");
  EXPECT_NEAR(number(fitted("metres.xyz", "--unit m"), "c"), 1000.0, 1e-9);
  EXPECT_NEAR(number(fitted("metres.xyz", ""), "c"), 1.0, 1e-12);
}

TEST_F(FitPlane, same_seed_same_bytes) {
  draw("one.xyz", "--seed 7");
  draw("two.xyz", "--seed 7");
  draw("other.xyz", "--seed 8");
  EXPECT_EQ(content(file("one.xyz")), content(file("two.xyz")));
  EXPECT_NE(content(file("one.xyz")), content(file("other.xyz")));
  const json truth = json::parse(content(file("one.json")));
  EXPECT_EQ(truth["b"], 2.0);
  EXPECT_EQ(truth["seed"], 7);
}

TEST_F(FitPlane, wrong_use_is_status_2) {
  for (const char* wrong :
       {"--method best", "--contamination 0.95", "--threshold 0", "--set 1 2 1", "--unit inch", "--threshold nan",
        "--contamination nan", "--share-min nan", "--seed -1", "--seed 18446744073709551616"})
    EXPECT_EQ(fit("none.xyz", wrong).status, 2) << wrong;
  const Ended ply = run("simulate plane --out " + file("plane.ply"));
  EXPECT_EQ(ply.status, 2);
  expect_mentions(ply.err, ".xyz");
}

TEST_F(FitPlane, bad_files_are_status_3_and_named) {
  const Ended missing = fit("none.xyz", "");
  EXPECT_EQ(missing.status, 3);
  expect_mentions(missing.err, "none.xyz");
  const Ended torn = fit(fs::path(write("torn.xyz", "0 0 1\n1 0\n")).filename().string(), "");
  EXPECT_EQ(torn.status, 3);
  expect_mentions(torn.err, "torn.xyz");

  // One point too many, in a sparse file of the right length.
  const std::size_t count = limits::kScanPointsMax + 1;
  const std::string header = "ply\nformat binary_little_endian 1.0\nelement vertex " + std::to_string(count) +
                             "\nproperty float x\nproperty float y\nproperty float z\nend_header\n";
  std::ignore = write("many.ply", header);
  fs::resize_file(file("many.ply"), header.size() + 12 * count);
  const Ended many = fit("many.ply", "");
  EXPECT_EQ(many.status, 3);
  expect_mentions(many.err, std::to_string(count));
  expect_mentions(many.err, std::to_string(limits::kScanPointsMax));
}

}  // namespace
}  // namespace slabd::cli
