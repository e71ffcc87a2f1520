// SPDX-License-Identifier: Apache-2.0
//
// docs/OPERATING.md and the journal's catalog contain every code with its remedy. SLABD_UPDATE_DOCS=1 rewrites them.
#include <gtest/gtest.h>

#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <iterator>
#include <string>
#include <vector>

#include "base/result.h"
#include "tests/places/places.h"

namespace slabd {
namespace {

const std::string kPage = places::source_dir() + "/docs/OPERATING.md";
const std::string kCatalog = places::source_dir() + "/systemd/slabd.catalog";

std::string read_file(const std::string& path) {
  std::ifstream in(path);
  return {std::istreambuf_iterator<char>(in), {}};
}

std::vector<std::uint16_t> all_codes() {
  std::vector<std::uint16_t> codes;
  const std::string_view unknown = describe(static_cast<Code>(1));
  for (std::uint16_t code = 100; code < kReasonItemBase; ++code)
    if (describe(static_cast<Code>(code)) != unknown) codes.push_back(code);
  return codes;
}

void expect_content(const std::string& path, const std::string& is, const std::string& should) {
  if (std::getenv("SLABD_UPDATE_DOCS") != nullptr) {
    std::ofstream(path) << should;
    return;
  }
  EXPECT_EQ(is, should) << path << " is stale: run this test with SLABD_UPDATE_DOCS=1";
}

TEST(Operating, every_code_has_a_meaning_and_a_cure_on_the_page) {
  const std::string text = read_file(kPage);
  const std::string begin = "<!-- codes: begin -->\n";
  const std::string end = "<!-- codes: end -->\n";
  ASSERT_NE(text.find(begin), std::string::npos);
  ASSERT_NE(text.find(end), std::string::npos);
  std::string table = "| Code | What it is | What to do |\n|---|---|---|\n";
  for (const std::uint16_t code : all_codes()) {
    const std::string_view what = describe(static_cast<Code>(code));
    const std::string_view todo = cure(static_cast<Code>(code));
    EXPECT_FALSE(what.empty() || todo.empty()) << code;
    EXPECT_NE(todo, cure(static_cast<Code>(1))) << code << " has no cure of its own";
    table += "| " + std::to_string(code) + " | " + std::string(what) + " | " + std::string(todo) + " |\n";
  }
  expect_content(kPage, text, text.substr(0, text.find(begin) + begin.size()) + table + text.substr(text.find(end)));
}

TEST(Operating, the_journals_catalog_explains_every_code) {
  std::string catalog = "# SPDX-License-Identifier: Apache-2.0\n# What journalctl -x says to a line of slabd.\n";
  for (const std::uint16_t code : all_codes()) {
    char id[40];
    std::snprintf(id, sizeof id, "7d1b0f6a9c3e4e52b8a45ab1ec0d%04x", unsigned{code});
    catalog += "\n-- " + std::string(id) + "\nSubject: slabd code " + std::to_string(code) + ": " +
               std::string(describe(static_cast<Code>(code))) +
               "\nDefined-By: slabd\n\n@MESSAGE@\n\nWhat to do: " + std::string(cure(static_cast<Code>(code))) + ".\n";
  }
  expect_content(kCatalog, read_file(kCatalog), catalog);
}

}  // namespace
}  // namespace slabd
