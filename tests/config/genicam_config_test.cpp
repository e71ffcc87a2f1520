// SPDX-License-Identifier: Apache-2.0
//
// [genicam] of slabd.toml, which slabd-genicam uses.
#include "tests/config/text_file.h"

namespace slabd::config {
namespace {

using Texts = std::vector<std::string>;

class GenicamConfig : public ::testing::Test {
 protected:
  /// Problems of [genicam]; the rest of the configuration must have none.
  Texts load(const std::string& genicam) {
    std::vector<Problem> problems;
    load_config(files_.write("slabd.toml", "[cell]\nT_base_slab = [1000, 0, 500, 1, 0, 0, 0]\n[genicam]\n" + genicam),
                config_, problems);
    EXPECT_EQ(files_.texts(problems), Texts{});
    return files_.texts(config_.genicam_problems);
  }
  /// Problems that slabd-genicam reports.
  Texts load_alone(const std::string& text) {
    settings_ = {};
    std::vector<Problem> problems;
    load_genicam(files_.write("genicam.toml", text), settings_, problems);
    return files_.texts(problems);
  }
  TextFiles files_;
  Config config_;
  GenicamSettings settings_;
};

TEST_F(GenicamConfig, every_key_is_read) {
  EXPECT_EQ(load("camera = \"192.168.0.30\"\nslabd = \"192.168.0.2:1504\"\ncomponent = \"Depth\"\n"
                 "unit_check = \"if_stated\"\npacket_size = 9000\ntimeout_s = 3.5\ntrigger = \"acquisition_start\"\n"
                 "accepted = \"PhoXi 7 1.13 0badcafe\"\nemulated = true\n"),
            Texts{});
  const GenicamSettings& g = config_.genicam;
  EXPECT_EQ(g.camera, "192.168.0.30");
  EXPECT_EQ(g.slabd_host.view(), "192.168.0.2");
  EXPECT_EQ(g.slabd_port, 1504);
  EXPECT_EQ(g.component, "Depth");
  EXPECT_FALSE(g.unit_required);
  EXPECT_EQ(g.packet_bytes, 9'000);
  EXPECT_EQ(g.timeout_s, 3.5);
  EXPECT_EQ(g.trigger, GenicamSettings::Trigger::acquisition_start);
  EXPECT_EQ(g.accepted, "PhoXi 7 1.13 0badcafe");
  EXPECT_TRUE(g.emulated);
}

TEST_F(GenicamConfig, faults_are_named_and_do_not_concern_the_inspection) {
  for (const char* fault : {"camera = 5", "slabd = \"localhost\"", "unit_check = \"inch\"", "packet_size = 100",
                            "packet_size = 1501", "packet_size = 65000", "timeout_s = 0", "trigger = \"line1\"",
                            "emulated = 1", "component = \"\"", "adress = \"x\""}) {
    const Texts texts = load(std::string(fault) + "\n");
    ASSERT_GE(texts.size(), 1U) << fault;
    EXPECT_TRUE(texts[0].starts_with("slabd.toml:")) << texts[0];
    EXPECT_NE(texts[0].find("genicam."), std::string::npos) << texts[0];
  }
}

TEST_F(GenicamConfig, the_program_reads_only_its_table_and_slabds_address) {
  EXPECT_EQ(load_alone("[genicam]\ncamera = \"cam\"\n"), Texts{});
  EXPECT_EQ(settings_.slabd_host.view(), "127.0.0.1");
  EXPECT_EQ(settings_.slabd_port, 1504);
  EXPECT_EQ(
      load_alone(
          "[scanner]\nbackend = \"tcp\"\nlisten = \"10.0.0.2:2000\"\n[plc]\nrole = 5\n[genicam]\ncamera = \"cam\"\n"),
      Texts{});
  EXPECT_EQ(settings_.slabd_host.view(), "10.0.0.2");
  EXPECT_EQ(settings_.slabd_port, 2000);
  EXPECT_EQ(load_alone("[scanner]\nlisten = \"0.0.0.0:2000\"\n[genicam]\ncamera = \"cam\"\n"), Texts{});
  EXPECT_EQ(settings_.slabd_host.view(), "127.0.0.1");
}

TEST_F(GenicamConfig, the_program_needs_a_camera) {
  for (const char* text : {"", "[genicam]\n", "[scanner]\n"}) {
    const Texts texts = load_alone(text);
    ASSERT_EQ(texts.size(), 1U) << text;
    EXPECT_NE(texts[0].find("genicam.camera"), std::string::npos) << texts[0];
  }
  EXPECT_EQ(load_alone("[genicam\n").size(), 1U);
}

}  // namespace
}  // namespace slabd::config
