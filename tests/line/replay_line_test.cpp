// SPDX-License-Identifier: Apache-2.0
//
// A whole slab through the real daemon, then measured again from its scans: the results must match the database bit by
// bit.
#include <gtest/gtest.h>

#include <filesystem>
#include <nlohmann/json.hpp>

#include "processes.h"

namespace slabd::line {
namespace {

using Json = nlohmann::json;

TEST(ReplayLine, a_slab_of_the_line_is_reproduced_bit_for_bit_next_to_the_running_daemon) {
  Box box;
  box.start();
  ASSERT_TRUE(box.ready()) << box.log();
  const Box::Answer line =
      box.slabctl({"simulate", "--config", box.config.native(), "--points", "quarter", "--slab-no", "7", "--slab-id",
                   "AGAIN", "--slab-type", "4856", "--defect", "jaw-distance=11:0.9", "--defect", "missing=5"});
  ASSERT_EQ(line.exit_status, 1) << line.out << line.err;

  std::size_t figures = 0;
  for (const char* threads : {"1", "2"}) {
    const Box::Answer again =
        box.slabctl({"replay", "AGAIN", "--verify", "--config", box.config.native(), "--threads", threads, "--json"});
    EXPECT_EQ(again.exit_status, 0) << again.out << again.err;
    const Json slab = Json::parse(again.out, nullptr, false)["slabs"][0];
    EXPECT_EQ(slab["outcome"], "identical");
    EXPECT_GE(slab["blocks"].size(), 16U);
    EXPECT_TRUE(slab["slab"]["compared"]);
    EXPECT_EQ(slab["scans_proven"].get<std::size_t>(), slab["blocks"].size()) << "a checksum of every scan is kept";
    EXPECT_TRUE(slab["changed"].empty()) << slab["changed"];
    EXPECT_TRUE(figures == 0 || figures == slab["figures"].get<std::size_t>());
    figures = slab["figures"].get<std::size_t>();
  }
  EXPECT_GT(figures, 16U * 300);

  // The recipe file does not exist any more: the daemon has stored the recipe with the slab.
  const std::filesystem::path empty = box.config.parent_path() / "empty";
  std::filesystem::create_directories(empty);
  const Box::Answer kept = box.slabctl(
      {"replay", "AGAIN", "--verify", "--config", box.config.native(), "--recipes", empty.native(), "--json"});
  EXPECT_EQ(kept.exit_status, 0) << kept.out << kept.err;
  const Json slab = Json::parse(kept.out, nullptr, false)["slabs"][0];
  EXPECT_EQ(slab["outcome"], "identical");
  EXPECT_TRUE(slab["recipe"].get<std::string>().starts_with("sha:")) << slab["recipe"];
  EXPECT_EQ(box.stop(), 0);
}

}  // namespace
}  // namespace slabd::line
