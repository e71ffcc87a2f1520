// SPDX-License-Identifier: Apache-2.0
//
// Completion and manual are generated from the command tree: they must contain everything that --help lists.
#include <regex>

#include "storage/storage.h"
#include "tests/cli/slabctl_process.h"
#include "tests/places/places.h"

namespace slabd::cli {
namespace {

class Completion : public Slabctl {
 protected:
  /// Completions of bash for `words`; the last one is the word at the cursor.
  [[nodiscard]] std::string offered(const std::string& words) const {
    const std::string script =
        write("try.sh", "source <(" + places::slabctl() + " completion bash)\nCOMP_WORDS=(" + words +
                            ")\nCOMP_CWORD=$((${#COMP_WORDS[@]} - 1))\n_slabctl\nprintf ' %s ' \"${COMPREPLY[@]}\"\n");
    const std::string command = "bash " + script + " >" + file("offered") + " 2>" + file("offered.err");
    EXPECT_EQ(std::system(command.c_str()), 0);
    EXPECT_EQ(content(file("offered.err")), "");
    return content(file("offered"));
  }
};

TEST_F(Completion, bash_offers_commands_and_their_options_and_no_others) {
  expect_mentions(offered("slabctl re"), " report ");
  expect_mentions(offered("slabctl re"), " recipe ");
  EXPECT_EQ(offered("slabctl re").find("trend"), std::string::npos);
  expect_mentions(offered("slabctl report SLAB --l"), " --language ");
  expect_mentions(offered("slabctl calibrate so"), " solve ");
  EXPECT_EQ(offered("slabctl metrics --la").find("--language"), std::string::npos);
}

TEST_F(Completion, scripts_and_manual_name_every_command) {
  const std::string help = run("--help").out;
  const std::string bash = run("completion bash").out;
  const std::string fish = run("completion fish").out;
  const std::string manual = run("manual").out;
  const std::size_t list = help.find("Subcommands:");
  const std::string below = help.substr(list, help.find("\nExamples") - list);
  const std::regex command("\n  ([a-z-]+) ");
  int commands = 0;
  for (std::sregex_iterator it(below.begin(), below.end(), command), stop; it != stop; ++it, ++commands) {
    const std::string name = (*it)[1];
    expect_mentions(bash, "'slabctl " + name + "')");
    expect_mentions(fish, " -a " + name + " ");
    expect_mentions(manual, "slabctl " + std::regex_replace(name, std::regex("-"), "\\-") + "\"");
  }
  EXPECT_GE(commands, 12);
  EXPECT_EQ(manual.substr(0, 11), ".TH SLABCTL");
  EXPECT_EQ(run("completion tcsh").status, 2);
}

TEST_F(Completion, history_names_the_nearest_item_and_the_form_of_a_time) {
  Ended ended = run("history --db none.db --item jaw_distnace");
  EXPECT_EQ(ended.status, 2);
  expect_mentions(ended.err, "did you mean 'jaw_distance'?");
  ended = run("history --db none.db --since yesterday");
  EXPECT_EQ(ended.status, 2);
  expect_mentions(ended.err, "--since: 'yesterday' is not a time; expected 2026-11-20");
  ended = run("trend seat_slop --db none.db");
  EXPECT_EQ(ended.status, 2);
  expect_mentions(ended.err, "did you mean 'seat_slope'?");
  ended = run("status --watch --socket none.sock");
  EXPECT_EQ(ended.status, 2);
  expect_mentions(ended.err, "--watch needs a terminal");
}

}  // namespace
}  // namespace slabd::cli
