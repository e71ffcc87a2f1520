// SPDX-License-Identifier: Apache-2.0
#include "cli/terminal/parse.h"

#include <gtest/gtest.h>

#include "cli/command.h"

namespace slabd::cli {
namespace {

TEST(Parse, pose_of_seven_numbers) {
  const Result<Pose> pose = parse_pose(" 1, -2.5 600\t0,1 0 0 ");
  ASSERT_TRUE(pose) << pose.error().text.c_str();
  EXPECT_EQ(pose.value().translation_mm, Vec3(1.0, -2.5, 600.0));
  EXPECT_EQ(pose.value().rotation.x(), 1.0);
}

TEST(Parse, bad_pose_says_which_number_and_what_is_allowed) {
  const auto refused = [](const char* text, const char* mentions) {
    const Result<Pose> pose = parse_pose(text);
    ASSERT_FALSE(pose) << text;
    EXPECT_NE(pose.error().text.view().find(mentions), std::string_view::npos) << pose.error().text.c_str();
  };
  refused("", "0 numbers");
  refused("0 0 600 0 1 0", "6 numbers");
  refused("0 0 600 0 1 0 0 0", "more than 7");
  refused("0 0 6oo 0 1 0 0", "number 3 (z)");
  refused("0 0 nan 0 1 0 0", "number 3 (z)");
  refused("0 0 600 0 1 0.1 0", "0.999..1.001");
  refused("0 0 600 0 0 0 0", "0.999..1.001");
}

TEST(Parse, nearest_command_within_reason) {
  EXPECT_EQ(nearest("simulat", {"inspect", "simulate", "show"}), "simulate");
  EXPECT_EQ(nearest("shwo", {"inspect", "simulate", "show"}), "show");
  EXPECT_EQ(nearest("xyzzyxyzzy", {"inspect", "simulate", "show"}), "");
}

}  // namespace
}  // namespace slabd::cli
