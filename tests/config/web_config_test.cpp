// SPDX-License-Identifier: Apache-2.0
//
// [web] of slabd.toml, which slabd-web uses and the daemon does not.
#include "tests/config/text_file.h"

namespace slabd::config {
namespace {

using Texts = std::vector<std::string>;

class WebConfig : public ::testing::Test {
 protected:
  /// Problems of [web]; the rest of the configuration must have none.
  Texts load(const std::string& web) {
    std::vector<Problem> problems;
    load_config(files_.write("slabd.toml", "[cell]\nT_base_slab = [1000, 0, 500, 1, 0, 0, 0]\n[web]\n" + web), config_,
                problems);
    EXPECT_EQ(files_.texts(problems), Texts{});
    return files_.texts(config_.web_problems);
  }
  TextFiles files_;
  Config config_;
};

TEST_F(WebConfig, by_default_only_this_computer_is_served) {
  EXPECT_EQ(load(""), Texts{});
  EXPECT_EQ(config_.web.kiosk.host.view(), "127.0.0.1");
  EXPECT_EQ(config_.web.kiosk.port, 8080);
  EXPECT_TRUE(config_.web.lan.host.empty());
  EXPECT_EQ(config_.web.language, "en");
}

TEST_F(WebConfig, every_key_is_read) {
  EXPECT_EQ(load("listen = \"127.0.0.2:0\"\nlan_listen = \"10.0.0.7:8443\"\ntls_cert = \"web.pem\"\n"
                 "tls_key = \"/srv/web.key\"\nnames = [\"line-7.example\", \"line-7\"]\nlanguage = \"zh\"\n"
                 "slabctl = \"/opt/slabctl\"\nanswer_s = 20\n"),
            Texts{});
  EXPECT_EQ(config_.web.kiosk.port, 0);
  EXPECT_EQ(config_.web.lan.host.view(), "10.0.0.7");
  EXPECT_EQ(config_.web.lan.port, 8443);
  EXPECT_EQ(config_.web.tls_cert, files_.folder() + "/web.pem");
  EXPECT_EQ(config_.web.tls_key, "/srv/web.key");
  EXPECT_EQ(config_.web.names, (Texts{"line-7.example", "line-7"}));
  EXPECT_EQ(config_.web.language, "zh");
  EXPECT_EQ(config_.web.slabctl, "/opt/slabctl");
  EXPECT_EQ(config_.web.answer_s, 20.0);
}

TEST_F(WebConfig, a_network_without_tls_needs_a_decision) {
  EXPECT_EQ(load("lan_listen = \"0.0.0.0:8081\"\n"),
            Texts{"slabd.toml:4:14: web.lan_listen: found \"0.0.0.0:8081\" without tls_cert and tls_key; allowed is an "
                  "address that begins with 127., a certificate, or lan_plain = true"});
  EXPECT_EQ(load("lan_listen = \"0.0.0.0:8081\"\nlan_plain = true\n"), Texts{});
  EXPECT_EQ(load("lan_listen = \"127.0.0.1:8081\"\n"), Texts{});
}

TEST_F(WebConfig, faults_are_named_and_do_not_concern_the_inspection) {
  EXPECT_EQ(load("lan_listen = \"127.0.0.1:8081\"\ntls_cert = \"a.pem\"\n").size(), 1U);
  EXPECT_EQ(load("tls_cert = \"a.pem\"\ntls_key = \"a.key\"\n").size(), 2U);
  EXPECT_EQ(
      load("lan_listen = \"127.0.0.1:8080\"\n"),
      Texts{"slabd.toml:4:14: web.lan_listen: found the address of web.listen; allowed is another address or port"});
  for (const char* fault : {"listen = 8080", "listen = \"localhost:80\"", "names = \"a\"", "names = [\"a b\"]",
                            "names = [1]", "language = \"de\"", "answer_s = 0", "port = 8080"}) {
    const Texts texts = load(std::string(fault) + "\n");
    ASSERT_EQ(texts.size(), 1U) << fault;
    EXPECT_TRUE(texts[0].starts_with("slabd.toml:4:")) << texts[0];
  }
}

}  // namespace
}  // namespace slabd::config
