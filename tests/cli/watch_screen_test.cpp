// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include "base/records.h"
#include "cli/watch/screen.h"

namespace slabd::cli::watch {
namespace {

using report::Language;

constexpr report::Style kPlain{false, false};
constexpr report::Style kColour{true, true};

Picture busy_line() {
  Picture p;
  p.age_s = 0.4;
  p.software = "slabd 1.0.0";
  p.state = "scanning";
  p.uptime_s = 7'300.0;
  p.links = {{Link::plc, true, "alive", "", 35.0, false},
             {Link::robot, false, "no poses", "start the robot bridge", 12.0, false},
             {Link::scanner, true, "online", "", 35.0, true},
             {Link::store, true, "writing", "", 35.0, true},
             {Link::calibration, true, "applied", "", 35.0, true}};
  p.warnings = {"one", "two", "three"};
  p.slab_open = true;
  p.slab = "7 \"SLAB-7\"";
  p.stations.assign(18, Verdict::none);
  p.stations[0] = Verdict::pass;
  p.stations[3] = Verdict::fail;
  p.stations_done = 4;
  p.current_station = 5;
  p.map_age_s = 8.0;
  for (std::uint32_t i = 0; i < 30; ++i) p.past.push_back({100 - i, "SLAB-X", Verdict::pass, 0, 600.0 * i});
  return p;
}

std::string joined(const std::vector<std::string>& lines) {
  std::string text;
  for (const std::string& line : lines) text += line + "\n";
  return text;
}

/// A line with two robots, of which the second one is silent.
Picture two_robots() {
  Picture p = busy_line();
  p.links = {{Link::plc, true, "alive", "", 35.0, false},
             {Link::robot, true, "poses", "", 35.0, false, "1"},
             {Link::robot, false, "no poses", "start the robot bridge", 12.0, false, "2"},
             {Link::scanner, true, "online", "", 35.0, true, "1, 2"},
             {Link::store, true, "writing", "", 35.0, true},
             {Link::calibration, true, "applied", "", 35.0, true, "1, 2"},
             {Link::tie, true, "tied", "", 35.0, true}};
  return p;
}

TEST(Screen, each_robot_and_scanner_of_a_line_with_two_is_named) {
  for (const auto& [columns, rows] : {std::pair{80UL, 24UL}, {100UL, 30UL}, {240UL, 67UL}, {20UL, 4UL}})
    for (const std::string& line : screen(two_robots(), columns, rows, kColour, Language::zh))
      EXPECT_LE(report::display_width(line), columns) << line;
  const std::string text = joined(screen(two_robots(), 100, 40, kPlain, Language::en));
  for (const char* words :
       {"robot 1", "robot 2", "-> start the robot bridge", "scanner 1, 2", "calibration 1, 2", "robots tied"})
    EXPECT_NE(text.find(words), std::string::npos) << words << "\n" << text;
}

TEST(Screen, fills_every_size_from_80_by_24_up_and_never_overflows_it) {
  for (const Language language : {Language::en, Language::zh}) {
    for (const auto& [columns, rows] : {std::pair{80UL, 24UL}, {100UL, 30UL}, {240UL, 67UL}, {20UL, 4UL}}) {
      for (const report::Style style : {kPlain, kColour}) {
        for (const double age_s : {0.1, 60.0, kNoValue}) {
          Picture p = busy_line();
          p.age_s = age_s;
          const std::vector<std::string> lines = screen(p, columns, rows, style, language);
          EXPECT_EQ(lines.size(), rows);
          for (const std::string& line : lines) EXPECT_LE(report::display_width(line), columns) << line;
        }
      }
    }
  }
}

TEST(Screen, at_80_by_24_has_all_blocks_links_cures_and_the_last_slabs) {
  const std::string text = joined(screen(busy_line(), 80, 24, kPlain, Language::en));
  for (int station = 1; station <= 18; ++station)
    EXPECT_NE(text.find(" " + std::to_string(station)), std::string::npos) << station;
  for (const char* words : {" 4 X", "[ 5 .]", "now block 5", "-> start the robot bridge", "for 12 s", "for > 35 s",
                            "slabd 1.0.0", "scanning", "age 0 s", "SLAB-X", "10 min ago", "(+1)", "4/18"})
    EXPECT_NE(text.find(words), std::string::npos) << words << "\n" << text;
}

/// The slab has ended with two findings.
Picture failed_slab() {
  Picture p = busy_line();
  p.slab_open = false;
  p.current_station = 0;
  p.stations.assign(18, Verdict::pass);
  p.stations[3] = p.stations[10] = Verdict::fail;
  p.verdict = Verdict::fail;
  p.recipe = "P5600";
  p.clock = "14:05:33";
  p.findings = {{Verdict::fail, "Block 4, seat slope: 1.6366 deg, limits 1.3325 .. 1.5486, U 0.0102"},
                {Verdict::fail, "Block 11, jaw distance: 380.901 mm, limits 379.500 .. 380.500, U 0.050"}};
  p.today = {12, 10, {{"seat slope", 1}, {"jaw distance", 1}}, 252.0};
  return p;
}

TEST(Screen, at_80_by_24_says_why_and_counts_the_day) {
  const std::string text = joined(screen(failed_slab(), 80, 24, kPlain, Language::en));
  for (const char* words :
       {"X FAIL", "Block 4, seat slope: 1.6366 deg, limits 1.3325 .. 1.5486", "Block 11, jaw distance: 380.901 mm",
        "today 12 slabs, 10 passed (83 %)  takt 4 min  1 x seat slope, 1 x jaw distance", "14:05:33", "recipe P5600",
        "-> start the robot bridge", "SLAB-X"})
    EXPECT_NE(text.find(words), std::string::npos) << words << "\n" << text;
  Picture many = failed_slab();
  for (int i = 0; i < 7; ++i) many.findings.push_back(many.findings.back());
  EXPECT_NE(joined(screen(many, 80, 24, kPlain, Language::en)).find("more findings: 7"), std::string::npos);
}

TEST(Screen, writes_the_verdict_in_large_letters_if_there_is_room) {
  const std::string large = joined(screen(failed_slab(), 120, 40, kPlain, Language::en));
  EXPECT_NE(large.find("#####  ###  ##### #"), std::string::npos) << large;
  Picture p = failed_slab();
  for (const Verdict verdict :
       {Verdict::pass, Verdict::fail, Verdict::not_measured, Verdict::aborted, Verdict::indeterminate}) {
    p.verdict = verdict;
    EXPECT_NE(joined(screen(p, 120, 40, kPlain, Language::en)).find("##"), std::string::npos) << name(verdict);
    EXPECT_NE(
        joined(screen(p, 120, 40, kPlain, Language::zh)).find(std::string(report::verdict_word(verdict, Language::zh))),
        std::string::npos);
    for (const std::string& line : screen(p, 80, 40, kColour, Language::en))
      EXPECT_LE(report::display_width(line), 80U);
  }
  p = busy_line();
  EXPECT_EQ(joined(screen(p, 120, 40, kPlain, Language::en)).find("##"), std::string::npos) << "an open slab has none";
}

TEST(Screen, below_80_columns_lists_the_blocks_and_cuts_none_off) {
  for (const std::size_t columns : {40UL, 60UL, 79UL}) {
    const std::vector<std::string> lines = screen(failed_slab(), columns, 24, kPlain, Language::en);
    const std::string text = joined(lines);
    EXPECT_NE(text.find("X FAIL: 4, 11"), std::string::npos) << text;
    EXPECT_NE(text.find("pass: 16 / 18"), std::string::npos) << text;
    EXPECT_NE(text.find("U 0.0102"), std::string::npos) << "the finding is broken into lines\n" << text;
    for (const std::string& line : lines) EXPECT_LE(report::display_width(line), columns);
  }
}

TEST(Today, counts_slabs_yield_reasons_and_takt_since_midnight) {
  std::vector<storage::SlabSummary> newest_first;
  const auto add = [&](std::int64_t ended_s, Verdict verdict, std::uint16_t reason = 0) {
    storage::SlabSummary slab;
    slab.ended_utime_us = 1'000'000 * ended_s;
    slab.verdict = verdict;
    slab.reason = reason;
    newest_first.insert(newest_first.begin(), slab);
  };
  add(900, Verdict::fail, 600);  // yesterday
  add(1000, Verdict::pass);
  add(1300, Verdict::fail, 604);
  add(1500, Verdict::aborted, 110);
  add(1600, Verdict::fail, 604);
  add(1900, Verdict::indeterminate, 600);
  add(0, Verdict::none);  // open
  const Today today = today_of(newest_first, 1'000'000'000, Language::en);
  EXPECT_EQ(today.slabs, 4U);
  EXPECT_EQ(today.passed, 1U);
  ASSERT_EQ(today.reasons.size(), 2U);
  EXPECT_EQ(today.reasons[0], (std::pair<std::string, std::size_t>{"jaw distance", 2}));
  EXPECT_EQ(today.takt_s, 300.0);
}

TEST(Screen, that_is_stale_is_marked_in_the_first_line_and_has_no_colour_of_life) {
  Picture p = busy_line();
  p.age_s = 12.0;
  p.trouble = "connection refused";
  const std::vector<std::string> lines = screen(p, 80, 24, kColour, Language::en);
  EXPECT_NE(lines[0].find("STALE: last answer 12 s ago  connection refused"), std::string::npos) << lines[0];
  for (std::size_t i = 1; i < lines.size(); ++i)
    for (const char* colour : {"\x1b[32m", "\x1b[1;31m", "\x1b[33m"})
      EXPECT_EQ(lines[i].find(colour), std::string::npos) << lines[i];
  p.age_s = kNoValue;
  EXPECT_NE(joined(screen(p, 80, 24, kPlain, Language::en)).find("NO ANSWER"), std::string::npos);
  EXPECT_NE(joined(screen(p, 80, 24, kPlain, Language::zh)).find("无应答"), std::string::npos);
}

TEST(Screen, says_that_the_line_is_emulated_also_of_past_slabs) {
  for (const Language language : {Language::en, Language::zh}) {
    Picture p = busy_line();
    const std::string mark(report::emulation_mark(kEmulatedScan, language));
    EXPECT_EQ(joined(screen(p, 80, 24, kPlain, language)).find(mark), std::string::npos);
    p.emulation = report::emulation_notice(kEmulatedRobot | kEmulatedScan, language);
    std::vector<std::string> lines = screen(p, 120, 24, kPlain, language);
    EXPECT_EQ(lines.size(), 24U);
    EXPECT_NE(joined(lines).find(p.emulation), std::string::npos) << joined(lines);
    p.emulation.clear();
    p.past[0].emulated = kEmulatedLine;
    EXPECT_NE(joined(screen(p, 120, 30, kPlain, language)).find(mark), std::string::npos);
  }
}

TEST(Screen, without_colour_has_no_escape_sequence) {
  EXPECT_EQ(joined(screen(busy_line(), 80, 24, {false, true}, Language::zh)).find('\x1b'), std::string::npos);
}

TEST(Screen, shows_fault_and_cure_before_anything_of_the_past) {
  Picture p = busy_line();
  p.fault = 503;
  p.fault_text = "no valid calibration";
  p.fault_cure = "calibrate";
  const std::string text = joined(screen(p, 80, 24, kPlain, Language::en));
  const std::size_t fault = text.find("FAULT 503: no valid calibration");
  ASSERT_NE(fault, std::string::npos);
  EXPECT_NE(text.find("-> calibrate"), std::string::npos);
  EXPECT_LT(fault, text.find("SLAB-X"));
}

TEST(Age, is_written_in_the_unit_people_think_in) {
  EXPECT_EQ(age_text(2.9, Language::en), "2 s");
  EXPECT_EQ(age_text(150.0, Language::en), "2 min");
  EXPECT_EQ(age_text(7'300.0, Language::en), "2 h");
  EXPECT_EQ(age_text(400'000.0, Language::en), "4 d");
  EXPECT_EQ(age_text(-5.0, Language::en), "0 s") << "a clock that was set back";
  EXPECT_EQ(age_text(kNoValue, Language::en), "?");
  EXPECT_EQ(age_text(2.9, Language::zh), "2 秒");
  EXPECT_EQ(age_text(150.0, Language::zh), "2 分钟");
  EXPECT_EQ(age_text(7'300.0, Language::zh), "2 小时");
  EXPECT_EQ(age_text(400'000.0, Language::zh), "4 天");
}

}  // namespace
}  // namespace slabd::cli::watch
