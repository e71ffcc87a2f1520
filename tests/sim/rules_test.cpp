// SPDX-License-Identifier: Apache-2.0
//
// Each safety rule of base/rules.h can be removed: it has a place in the product's code that reads it, and
// slabd_sim_rules compiles that file itself.
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <map>
#include <regex>
#include <set>
#include <sstream>
#include <string>

#include "base/rules.h"
#include "tests/places/places.h"

namespace slabd {
namespace {

namespace fs = std::filesystem;

std::string text_of(const fs::path& path) {
  std::stringstream text;
  text << std::ifstream(path).rdbuf();
  return text.str();
}

/// Files of the product that read a rule, by the rule's enumerator.
std::map<std::string, std::set<std::string>> places_of_rules() {
  static const std::regex place(R"(\bholds\(Rule::(\w+)\))");
  const fs::path root(places::source_dir());
  std::map<std::string, std::set<std::string>> found;
  for (const char* room : {"base", "algo", "calib", "hal", "storage", "config", "daemon", "report", "cli"})
    for (const auto& entry : fs::recursive_directory_iterator(root / room)) {
      const bool code = entry.path().extension() == ".cpp" || entry.path().extension() == ".h";
      if (!code || entry.path().filename() == "rules.h") continue;
      const std::string text = text_of(entry.path());
      if (text.find("holds(Rule::") == std::string::npos) continue;  // the regular expression takes longer
      for (std::sregex_iterator at(text.begin(), text.end(), place), end; at != end; ++at)
        found[(*at)[1]].insert(fs::relative(entry.path(), root).generic_string());
    }
  return found;
}

TEST(Rules, have_a_place_each_and_the_name_of_their_enumerator) {
  const std::string header = text_of(fs::path(places::source_dir()) / "base/rules.h");
  const auto found = places_of_rules();
  for (const RuleText& rule : kRuleTexts) {
    const std::string name(rule.name);
    EXPECT_TRUE(found.contains(name)) << name << " is not read by holds() in any file";
    EXPECT_NE(header.find("{Rule::" + name + ", \"" + name + "\","), std::string::npos) << name;
    EXPECT_FALSE(rule.text.empty()) << name;
  }
  EXPECT_EQ(found.size(), kRules);
}

TEST(Rules, are_in_files_that_slabd_sim_rules_compiles) {
  const std::string list = text_of(fs::path(places::source_dir()) / "tests/sim/CMakeLists.txt");
  for (const auto& [rule, files] : places_of_rules())
    for (const std::string& file : files) {
      EXPECT_TRUE(file.ends_with(".cpp")) << rule << ": " << file << " is compiled with and without removable rules";
      EXPECT_NE(list.find("  " + file), std::string::npos)
          << rule << ": " << file << " is not in SLABD_FILES_WITH_RULES";
    }
}

}  // namespace
}  // namespace slabd
