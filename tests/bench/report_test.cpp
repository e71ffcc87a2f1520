// SPDX-License-Identifier: Apache-2.0
#include "bench/report.h"

#include <gtest/gtest.h>

#include <cmath>

namespace slabd::bench {
namespace {

Json run_of(const char* peer, const char* job, std::vector<double> wall_ms, Json figures = Json::object(),
            double allocations = -1.0) {
  Json run = {{"peer", peer}, {"version", "1.0"}, {"job", job}, {"threads", 1}, {"peak_rss_mb", 100.0}};
  for (const double ms : wall_ms) {
    const Json total = {{"wall_ms", ms}, {"cpu_ms", ms}, {"disturbed", false}};
    Json one = {{"total", total}, {"stages", {{"read", total}}}};
    if (allocations >= 0.0) one["allocations"] = allocations;
    run["runs"].push_back(one);
  }
  run["figures"] = std::move(figures);
  return run;
}

Measured whole_run() {
  Measured measured;
  measured.stages["floor/read_warm/1"] = {{1.0, 1.0, false}};
  measured.stages["floor/read_cold/1"] = {{2.0, 2.0, false}};
  measured.stages["block/organised/1"] = {{10.0, 10.0, false}};
  measured.stages["block/organised/2"] = {{5.0, 10.0, false}};
  measured.stages["block/organised/register/1"] = {{2.0, 2.0, false}};
  measured.stages["read/ply_organised_cold/1"] = {{6.0, 6.0, false}};
  measured.stages["read/ply_organised_cold/2"] = {{4.0, 8.0, false}};
  measured.stages["file_to_verdict/ply_organised/1"] = {{20.0, 20.0, false}};
  measured.peers = {run_of("slabd", "block-organised", {16.0}), run_of("PCL", "block-tuned", {2100.0, 1900.0}),
                    run_of("PCL", "register", {600.0}, {{"pose_error_um", 1.0}}),
                    run_of("PCL", "register", {700.0}, {{"pose_error_um", 3.0}}),
                    run_of("Open3D", "register", {500.0}, {{"pose_error_um", 2.0}})};
  measured.counted = {run_of("slabd", "block-organised", {16.0, 16.0}, Json::object(), 0.0)};
  measured.scored = {run_of("PCL", "block-tuned", {1.0}, {{"pose_error_um", 3.0}, {"std_mm", 9.0}}),
                     run_of("PCL", "block-tuned", {1.0}, {{"pose_error_um", 4.0}, {"std_mm", 9.0}}),
                     run_of("slabd", "block-organised", {1.0}, {{"pose_error_um", 1.0}}),
                     run_of("slabd", "block-organised", {1.0}, {{"pose_error_um", 7.0}})};
  measured.slabs = {{{"last_acquired_to_verdict_s", 0.030}, {"block_compute_ms", 20.0}},
                    {{"last_acquired_to_verdict_s", 0.031}, {"block_compute_ms", 40.0}},
                    {{"last_acquired_to_verdict_s", nullptr}, {"block_compute_ms", 40.0}}};
  measured.environment = {{"date", "today"}};
  return measured;
}

const Json& line(const Json& json, const std::string& beginning) {
  for (const Json& one : json["judged"])
    if (one["what"].get<std::string>().rfind(beginning, 0) == 0) return one;
  throw std::out_of_range(beginning);
}

TEST(BenchReport, holds_every_promised_key_even_without_a_measurement) {
  const Json json = report({});
  for (const std::string_view key : kPromisedKeys) EXPECT_TRUE(json.at(std::string(key)).is_null()) << key;
  for (const std::string_view key : kPromisedPeerKeys) EXPECT_TRUE(json.at(std::string(key)).is_null()) << key;
  for (const Json& one : json["judged"]) EXPECT_EQ(one["verdict"], "not measured") << one["what"];
}

TEST(BenchReport, promises_the_keys_that_others_read) {
  for (const char* key : {"floor_read_warm_ms", "floor_read_cold_ms", "block_1t_ms", "block_2t_ms",
                          "block_unorganised_1t_ms", "read_ply_ms", "read_xyz_ms", "register_1t_ms", "plane_1t_ms",
                          "allocations_per_block", "rss_mb", "pcl_tuned_ms", "open3d_tuned_ms"})
    EXPECT_TRUE(report({}).contains(key)) << key;
}

TEST(BenchReport, takes_the_figures_from_stages_and_programs) {
  const Json json = report(whole_run());
  EXPECT_EQ(json["block_1t_ms"], 10.0);
  EXPECT_EQ(json["allocations_per_block"], 0.0);
  EXPECT_EQ(json["rss_mb"], 100.0);
  EXPECT_EQ(json["pcl_tuned_ms"], 2000.0);
  EXPECT_EQ(json["fastest_peer_register_ms"], 500.0);
  EXPECT_TRUE(json["open3d_tuned_ms"].is_null());
}

TEST(BenchReport, keeps_the_worst_error_of_several_runs) {
  EXPECT_EQ(report(whole_run())["peers"]["PCL"]["register"]["figures"]["pose_error_um"], 3.0);
}

TEST(BenchReport, reports_errors_over_all_scans_that_were_scored) {
  const Json json = report(whole_run());
  const Json& pcl = json["peers"]["PCL"]["block-tuned"];
  EXPECT_DOUBLE_EQ(pcl["figures"]["pose_error_um"].get<double>(), std::sqrt(0.5 * (9.0 + 16.0)));
  EXPECT_EQ(pcl["scans_scored"], 2.0);
  EXPECT_FALSE(pcl["figures"].contains("std_mm")) << "the timed runs report what is not an error";
  EXPECT_EQ(pcl["ms"], 2000.0) << "and these are not timed";
  const Json& judged = line(json, "pose error");
  EXPECT_DOUBLE_EQ(judged["value"].get<double>(), std::sqrt(0.5 * (1.0 + 49.0)) / std::sqrt(0.5 * (9.0 + 16.0)));
  EXPECT_EQ(judged["verdict"], "missed");
}

TEST(BenchReport, judges_the_slab_that_waited_longest_for_its_verdict) {
  const Json json = report(whole_run());
  EXPECT_DOUBLE_EQ(json["slab_verdict_wait_ms"].get<double>(), 30.0);
  EXPECT_EQ(json["slab_block_compute_ms"], 20.0);
  EXPECT_DOUBLE_EQ(line(json, "longest wait")["value"].get<double>(), 1.5);
  EXPECT_EQ(line(json, "longest wait")["verdict"], "must reached");
}

TEST(BenchReport, judges_each_ratio_against_must_and_aim) {
  const Json json = report(whole_run());
  EXPECT_EQ(line(json, "whole block, organised")["verdict"], "must reached");   // 10
  EXPECT_EQ(line(json, "whole block, 1 thread")["verdict"], "aim reached");     // 2
  EXPECT_EQ(line(json, "binary PLY")["verdict"], "missed");                     // 3
  EXPECT_EQ(line(json, "the same on two threads")["verdict"], "must reached");  // 2
  EXPECT_EQ(line(json, "PCL tuned")["verdict"], "aim reached");                 // 100
  EXPECT_EQ(line(json, "fastest packaged peer")["verdict"], "aim reached");     // 250
  EXPECT_EQ(line(json, "heap allocations")["verdict"], "aim reached");
}

TEST(BenchReport, marks_the_ratios_that_a_busy_machine_made_rough) {
  Measured measured = whole_run();
  measured.stages["block/organised/1"] = {{12.0, 10.0, true}};
  const Json json = report(measured);
  EXPECT_TRUE(line(json, "whole block, organised")["rough"]);
  EXPECT_FALSE(line(json, "binary PLY")["rough"]);
  // A median of fewer than two thirds of the samples.
  measured.stages["read/ply_organised_cold/1"] = {
      {6.0, 6.0, false}, {6.0, 6.0, false}, {6.0, 6.0, false}, {9.0, 6.0, true}, {9.0, 6.0, true}};
  EXPECT_TRUE(line(report(measured), "binary PLY")["rough"]);
  EXPECT_NE(markdown(json).find("busy machine"), std::string::npos);
  // Minimum against minimum, not CPU time of one thread against the minimum of two.
  EXPECT_EQ(line(json, "whole block, 1 thread")["value"], 12.0 / 5.0);
}

TEST(BenchReport, prints_tables_of_whatever_there_is) {
  EXPECT_NE(markdown(report({})).find("not measured"), std::string::npos);
  const std::string text = markdown(report(whole_run()));
  EXPECT_NE(text.find("| PCL | 650"), std::string::npos) << text;
  EXPECT_NE(text.find("must reached"), std::string::npos);
}

TEST(BenchFigure, is_the_median_of_the_undisturbed_wall_times) {
  const Figure figure = figure_of({{9.0, 5.0, true}, {5.0, 5.0, false}, {5.5, 5.0, false}, {6.0, 5.0, false}}, 1);
  EXPECT_EQ(figure.ms, 5.5);
  EXPECT_STREQ(figure.basis, "wall");
  EXPECT_EQ(figure.disturbed, 1U);
}

TEST(BenchFigure, states_its_basis_when_the_machine_was_too_busy) {
  const std::vector<Sample> busy = {{9.0, 5.0, true}, {8.0, 5.5, true}, {7.0, 6.0, true}};
  EXPECT_STREQ(figure_of(busy, 1).basis, "cpu");
  EXPECT_EQ(figure_of(busy, 1).ms, 5.5);
  EXPECT_STREQ(figure_of(busy, 2).basis, "min wall");
  EXPECT_EQ(figure_of(busy, 2).ms, 7.0);
}

TEST(BenchReport, holds_larger_scans_against_five_million_points_of_the_same_run) {
  Measured measured = whole_run();
  measured.stages["growth/points  0.5 M/1"] = {{99.0, 99.0, false}};
  measured.growth = {{"growth/points  0.5 M/1", {{"ms", 4.0}, {"min_ms", 3.0}, {"basis", "wall"}}},
                     {"growth/points  5.0 M/1", {{"ms", 20.0}, {"min_ms", 19.0}, {"basis", "wall"}}},
                     {"growth/points 20.0 M/1", {{"ms", 50.0}, {"min_ms", 48.0}, {"basis", "wall"}}}};
  const std::string tables = markdown(report(measured));
  EXPECT_NE(tables.find("| points  0.5 M | 4.00 | 3.00 | 0.20 | 8.00 |"), std::string::npos) << tables;
  EXPECT_NE(tables.find("| points 20.0 M | 50.0 | 48.0 | 2.50 | 2.50 |"), std::string::npos) << tables;
}

}  // namespace
}  // namespace slabd::bench
