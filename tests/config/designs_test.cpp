// SPDX-License-Identifier: Apache-2.0
#include "config/designs.h"

#include <gmock/gmock.h>

#include <filesystem>
#include <fstream>

#include "base/prng.h"

namespace slabd::config {
namespace {

std::string heading() {
  return std::string(kDesignHeading) + "\n";
}

/// A sheet of `stations` rows.
std::string sheet(const std::string& id, int stations, double dz_mm = 0.5) {
  std::string text;
  for (int station = 1; station <= stations; ++station)
    text += id + ",5600," + std::to_string(station) + ",1.25,-0.5," + std::to_string(dz_mm) + ",0.1\n";
  return text;
}

std::vector<std::string> problems_of(const std::string& text) {
  DesignSet set;
  parse_designs("d.csv", text, set);
  std::vector<std::string> texts;
  for (const Problem& problem : set.problems) texts.push_back(problem.text);
  EXPECT_TRUE(texts.empty() || set.sheets.empty()) << "a faulty file has no sheet";
  return texts;
}

TEST(Designs, any_number_of_slabs_in_any_order) {
  DesignSet set;
  parse_designs("d.csv", heading() + sheet("B-2", 18) + sheet("A-1", 12), set);
  EXPECT_TRUE(set.problems.empty());
  ASSERT_EQ(set.sheets.size(), 2U);
  EXPECT_EQ(set.sheets[0].slab_id.view(), "A-1");
  EXPECT_EQ(set.sheets[0].stations, 12);
  EXPECT_EQ(set.sheets[1].slab_type, 5600);
  EXPECT_EQ(set.sheets[1].sha256.size(), 64U);
  const auto design = parse_design(set.sheets[1].text.view());
  ASSERT_TRUE(design.ok());
  EXPECT_EQ(design.value().at(18).offset_mm, Vec3(1.25, -0.5, 0.5));
  EXPECT_NEAR(design.value().at(18).slope_rad, rad_from_deg(0.1), 1e-15);
}

TEST(Designs, as_spreadsheets_write_them) {
  std::string text = "\xEF\xBB\xBF" + heading() + sheet("A", 12);
  std::string crlf;
  for (const char c : text) crlf += c == '\n' ? "\r\n" : std::string(1, c);
  EXPECT_TRUE(problems_of(crlf).empty());
  EXPECT_TRUE(problems_of(text + "\n\n").empty()) << "empty lines at the end";
  text.pop_back();
  EXPECT_THAT(problems_of(text),
              ::testing::ElementsAre(::testing::HasSubstr("d.csv:13:1: the last line has no line end")))
      << "a number that was cut off is a number";
}

TEST(Designs, every_fault_is_named_with_line_and_column) {
  using ::testing::ElementsAre;
  using ::testing::HasSubstr;
  EXPECT_THAT(problems_of(""), ElementsAre(HasSubstr("d.csv:1:1: the file is empty")));
  EXPECT_THAT(problems_of("slab_id;slab_type\n"), ElementsAre(HasSubstr("d.csv:1:1: found \"slab_id;slab_type\"")));
  const auto faulty = [](const std::string& line) { return problems_of(heading() + sheet("A", 12) + line + "\n"); };
  EXPECT_THAT(faulty("B,5600,1,0,0,0"), ElementsAre(HasSubstr("d.csv:14:1: found 6 fields, allowed are 7")));
  EXPECT_THAT(faulty("B,5600,1,0,5,0,0,0"), ElementsAre(HasSubstr("found 8 fields, allowed are 7 (decimal point")));
  EXPECT_THAT(faulty(",5600,1,0,0,0,0"), ElementsAre(HasSubstr("d.csv:14:1: slab_id: found \"\"")));
  EXPECT_THAT(faulty("\"B\",5600,1,0,0,0,0"), ElementsAre(HasSubstr("without blanks and quotes")));
  EXPECT_THAT(faulty(std::string(33, 'B') + ",5600,1,0,0,0,0"), ElementsAre(HasSubstr("d.csv:14:1: slab_id")));
  EXPECT_THAT(faulty("B,x,1,0,0,0,0"), ElementsAre("d.csv:14:3: slab_type: found \"x\", allowed is 1..65535"));
  EXPECT_THAT(faulty("B,5600,19,0,0,0,0"), ElementsAre("d.csv:14:8: station: found \"19\", allowed is 1..18"));
  EXPECT_THAT(faulty("B,5600,1,nan,0,0,0"),
              ElementsAre("d.csv:14:10: dx_mm: found \"nan\", allowed is a number within +-50"));
  EXPECT_THAT(faulty("B,5600,1,0,0,50.1,0"), ElementsAre(HasSubstr("d.csv:14:14: dz_mm: found \"50.1\"")));
  EXPECT_THAT(faulty("B,5600,1,0,0,0,1.5"), ElementsAre(HasSubstr("d.csv:14:16: dslope_deg: found \"1.5\"")));
  EXPECT_THAT(faulty("B,5600,1,+-1,0,0,0"), ElementsAre(HasSubstr("d.csv:14:10: dx_mm: found \"+-1\"")));
  EXPECT_THAT(faulty("A,5600,3,0,0,0,0"), ElementsAre("d.csv:14:1: A: station 3 is in line 4 already"));
  EXPECT_THAT(faulty("A,4925,13,0,0,0,0"), ElementsAre("d.csv:14:1: A: slab type 4925, but 5600 in line 2"));
  EXPECT_THAT(faulty("A,5600,14,0,0,0,0"), ElementsAre(HasSubstr("A: 13 stations, but none is 13")));
}

TEST(Designs, foreign_bytes_are_refused_and_never_more) {
  Prng prng(3);
  const std::string good = heading() + sheet("A", 12);
  for (int i = 0; i < 3'000; ++i) {
    std::string text = good;
    for (int k = 0; k < 3; ++k)
      text[static_cast<std::size_t>(prng.uniform() * static_cast<double>(text.size()))] =
          static_cast<char>(256.0 * prng.uniform());
    DesignSet set;
    parse_designs("d.csv", text, set);
    for (const DesignSheet& read : set.sheets) EXPECT_TRUE(parse_design(read.text.view()).ok());
  }
}

TEST(Designs, two_sheets_of_a_slab_are_both_left_out) {
  std::string pattern = (std::filesystem::temp_directory_path() / "designs-test-XXXXXX").string();
  const std::filesystem::path dir = mkdtemp(pattern.data());
  const auto write = [&](const std::string& name, const std::string& text) { std::ofstream(dir / name) << text; };
  write("1.csv", heading() + sheet("A", 12) + sheet("B", 12));
  write("2.csv", heading() + sheet("B", 12, 0.7) + sheet("C", 12));
  write("3.csv", "no sheet");
  write("notes.txt", "not read");
  write(".4.csv", "hidden");
  const DesignSet set = load_designs(dir);
  ASSERT_EQ(set.sheets.size(), 2U);
  EXPECT_NE(find_design(set.sheets, "A"), nullptr);
  EXPECT_EQ(find_design(set.sheets, "B"), nullptr);
  EXPECT_NE(find_design(set.sheets, "C"), nullptr);
  ASSERT_EQ(set.problems.size(), 3U);
  EXPECT_NE(set.problems[0].text.find("notes.txt: is not read"), std::string::npos) << set.problems[0].text;
  EXPECT_NE(set.problems[1].text.find("2.csv:1:1: slab B has a sheet in"), std::string::npos) << set.problems[1].text;
  EXPECT_NE(set.problems[2].text.find("3.csv:1:1:"), std::string::npos);
  EXPECT_TRUE(same(set, load_designs(dir)));
  write("2.csv", heading() + sheet("C", 12));
  EXPECT_FALSE(same(set, load_designs(dir)));
  EXPECT_EQ(load_designs(dir / "absent").problems.size(), 1U);
  EXPECT_TRUE(load_designs("").problems.empty());
  std::filesystem::remove_all(dir);
}

// A sheet that is not read would let its slab be measured as a straight one.
TEST(Designs, whatever_lies_in_the_folder_is_read_or_named) {
  std::string pattern = (std::filesystem::temp_directory_path() / "designs-test-XXXXXX").string();
  const std::filesystem::path dir = mkdtemp(pattern.data());
  std::ofstream(dir / "ORDER.CSV") << heading() + sheet("A", 12);
  std::ofstream(dir / "order.csv~") << "kept by an editor";
  std::filesystem::create_directory(dir / "2026.csv");
  std::string year = heading();
  for (int slab = 0; slab < 2'000; ++slab) year += sheet("S-" + std::to_string(slab), 18);
  ASSERT_GT(year.size(), 1'000'000U);
  std::ofstream(dir / "year.csv") << year;
  const DesignSet set = load_designs(dir);
  EXPECT_EQ(set.sheets.size(), 2'001U);
  ASSERT_EQ(set.problems.size(), 1U);
  EXPECT_NE(set.problems[0].text.find("2026.csv: is not read"), std::string::npos) << set.problems[0].text;
  std::filesystem::remove_all(dir);
}

}  // namespace
}  // namespace slabd::config
