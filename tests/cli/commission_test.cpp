// SPDX-License-Identifier: Apache-2.0
//
// slabctl commission without a daemon; tests/line runs it on a whole line.
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "slabctl_process.h"

namespace slabd::cli {
namespace {

using Commission = Slabctl;

TEST_F(Commission, names_the_first_open_step_and_its_command) {
  const Ended bare = run("commission --config " + file("none.toml"));
  EXPECT_EQ(bare.status, 1);
  expect_mentions(bare.out, "Next: Configuration");
  const std::string config =
      write("slabd.toml", "[storage]\ndb = \"" + file("slabd.db") + "\"\nspool_dir = \"" + file("spool") +
                              "\"\n[recipes]\ndir = \"" + places::source_dir() + "/recipes\"\n[control]\nsocket = \"" +
                              file("none.sock") + "\"\n[cell]\nT_base_slab = [0,0,0,1,0,0,0]\n");
  const Ended configured = run("commission --config " + config);
  EXPECT_EQ(configured.status, 1);
  expect_mentions(configured.out, "numbers are not confirmed");
  expect_mentions(configured.out, "Next: Daemon");
  expect_mentions(configured.out, "systemctl enable --now slabd");
  const auto document = nlohmann::json::parse(run("commission --json --config " + config).out);
  EXPECT_EQ(document["next"], 3);
  EXPECT_EQ(document["steps"].size(), 12U);
  EXPECT_EQ(document["steps"][0]["state"], "done");
}

TEST_F(Commission, the_checklist_is_one_page_in_either_language) {
  for (const char* language : {"en", "zh"}) {
    const std::string page = file(std::string(language) + ".svg");
    const Ended made =
        run("commission --config " + file("none.toml") + " --language " + language + " --page 2 --out " + page);
    EXPECT_EQ(made.status, 2) << "there is no second page";
    const std::string html = file(std::string(language) + ".html");
    EXPECT_EQ(run("commission --config " + file("none.toml") + " --language " + language + " --out " + html).status, 1);
    expect_mentions(content(html), *language == 'e' ? "Commissioning checklist" : "调试检查表");
  }
}

}  // namespace
}  // namespace slabd::cli
