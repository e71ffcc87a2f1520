// SPDX-License-Identifier: Apache-2.0
#include "emulator/defects.h"

#include <gtest/gtest.h>

#include <string>

namespace slabd::emulator {
namespace {

void expect_refused(const char* text, const char* mentions) {
  const Result<Defect> defect = parse_defect(text);
  ASSERT_FALSE(defect) << text;
  EXPECT_NE(defect.error().text.view().find("--defect"), std::string_view::npos);
  EXPECT_NE(defect.error().text.view().find(mentions), std::string_view::npos) << defect.error().text.c_str();
}

TEST(Defects, are_read_with_block_and_value) {
  const Result<Defect> defect = parse_defect("jaw-distance=9:-0.75");
  ASSERT_TRUE(defect);
  EXPECT_EQ(defect.value().kind, DefectKind::jaw_distance);
  EXPECT_EQ(defect.value().station, 9);
  EXPECT_DOUBLE_EQ(defect.value().value, -0.75);
}

TEST(Defects, slope_is_a_ratio_in_any_usual_spelling) {
  for (const char* text : {"slope=4:36", "slope=4:1/36", "slope=4:1:36"}) {
    const Result<Defect> defect = parse_defect(text);
    ASSERT_TRUE(defect) << text;
    EXPECT_DOUBLE_EQ(defect.value().value, 36.0);
  }
}

TEST(Defects, missing_takes_no_value) {
  EXPECT_TRUE(parse_defect("missing=18"));
  expect_refused("missing=18:1", "missing=K");
}

TEST(Defects, on_the_whole_slab_name_no_block) {
  const Result<Defect> defect = parse_defect("corner-level=1.25");
  ASSERT_TRUE(defect);
  EXPECT_EQ(defect.value().kind, DefectKind::corner_level);
  EXPECT_EQ(defect.value().station, 0);
  EXPECT_DOUBLE_EQ(defect.value().value, 1.25);
  expect_refused("warp-left=3:1", "warp-left=MM");
  expect_refused("warp-right=21", "-20..20");
  expect_refused("large-jaw=0.9", "large-jaw=K:MM");
}

TEST(Defects, errors_name_option_form_and_range) {
  expect_refused("slop=4:36", "allowed slope");
  expect_refused("slope", "slope=K:N");
  expect_refused("slope=4", "slope=K:N");
  expect_refused("slope=0:36", "1..18");
  expect_refused("slope=19:36", "1..18");
  expect_refused("slope=x:36", "1..18");
  expect_refused("slope=4:", "20..200");
  expect_refused("slope=4:5", "20..200");
  expect_refused("slope=4:36mm", "20..200");
  expect_refused("noise=4:nan", "0..1");
  expect_refused("outliers=4:0.6", "0..0.5");
  expect_refused("bump=4:inf", "-5..5");
  expect_refused("", "unknown");
}

TEST(Defects, help_names_every_defect_with_its_range) {
  const std::string help = defect_help();
  for (const char* name : {"slope=K:N",
                           "jaw-angle-inner=K:DEG",
                           "jaw-angle-outer=K:DEG",
                           "jaw-distance=K:MM",
                           "protrusion-inner=K:MM",
                           "protrusion-outer=K:MM",
                           "casing-spacing=K:MM",
                           "bump=K:MM",
                           "missing=K",
                           "outliers=K:SHARE",
                           "noise=K:MM",
                           "robot=K:MM",
                           "lateral=K:MM",
                           "vertical=K:MM",
                           "chip=K:MM",
                           "burr=K:MM",
                           "sunk-seat=K:MM",
                           "broken-corner=K:MM",
                           "glove=K:MM",
                           "cable=K:MM",
                           "large-jaw=K:MM",
                           "corner-level=MM",
                           "warp-left=MM",
                           "warp-right=MM"})
    EXPECT_NE(help.find(name), std::string::npos) << name;
}

}  // namespace
}  // namespace slabd::emulator
