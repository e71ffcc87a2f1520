// SPDX-License-Identifier: Apache-2.0
//
// [plant] of slabd.toml, which slabd-plant uses.
#include "tests/config/text_file.h"

namespace slabd::config {
namespace {

using Texts = std::vector<std::string>;

class PlantConfig : public ::testing::Test {
 protected:
  /// Problems of [plant]; the rest of the configuration must have none.
  Texts load(const std::string& plant) {
    std::vector<Problem> problems;
    load_config(files_.write("slabd.toml", "[cell]\nT_base_slab = [1000, 0, 500, 1, 0, 0, 0]\n[plant]\n" + plant),
                config_, problems);
    EXPECT_EQ(files_.texts(problems), Texts{});
    return files_.texts(config_.plant_problems);
  }
  TextFiles files_;
  Config config_;
};

TEST_F(PlantConfig, without_the_table_retention_does_not_wait) {
  EXPECT_EQ(load(""), Texts{});
  EXPECT_EQ(config_.plant.dsn, "");
  EXPECT_FALSE(config_.storage.keep_unsent);
}

TEST_F(PlantConfig, every_key_is_read) {
  EXPECT_EQ(load("dsn = \"host=db dbname=plant\"\nline = \"hall-2\"\nalarm_h = 6\nbatch = 20\n"
                 "metrics_file = \"plant.prom\"\n"),
            Texts{});
  EXPECT_EQ(config_.plant.dsn, "host=db dbname=plant");
  EXPECT_EQ(config_.plant.line, "hall-2");
  EXPECT_EQ(config_.plant.alarm_h, 6.0);
  EXPECT_EQ(config_.plant.batch, 20);
  EXPECT_EQ(config_.plant.metrics_file, files_.folder() + "/plant.prom");
  EXPECT_TRUE(config_.storage.keep_unsent);
}

TEST_F(PlantConfig, faults_are_named_and_do_not_concern_the_inspection) {
  for (const char* fault :
       {"line = \"hall-2\"", "dsn = \"dbname=plant\"", "dsn = 5\nline = \"a\"", "dsn = \"dbname=p\"\nline = \"a b\"",
        "alarm_h = 0", "batch = 0", "batch = 5000", "password = \"x\""}) {
    const Texts texts = load(std::string(fault) + "\n");
    ASSERT_GE(texts.size(), 1U) << fault;
    EXPECT_TRUE(texts[0].starts_with("slabd.toml:")) << texts[0];
    EXPECT_NE(texts[0].find("plant."), std::string::npos) << texts[0];
  }
}

TEST_F(PlantConfig, a_password_in_the_file_is_doubtful) {
  EXPECT_EQ(load("dsn = \"dbname=plant password=secret\"\nline = \"a\"\n"), Texts{});
  ASSERT_EQ(config_.doubts.size(), 1U);
  EXPECT_NE(config_.doubts[0].text.find("passfile"), std::string::npos);
}

}  // namespace
}  // namespace slabd::config
