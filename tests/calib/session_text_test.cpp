// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include "calib/calib.h"

namespace slabd::calib {
namespace {

SessionSettings some_settings() {
  SessionSettings s;
  s.name = "hall 2";
  s.created = "2026-11-20T23:28:01Z";
  s.config = "/etc/slabd/slabd.toml";
  s.radius_mm = 25.4000000000000021;
  s.has_start = true;
  s.T_flange_scanner = {Quat(0.9, 0.1, -0.2, 0.3).normalized(), Vec3(0.1, 1.0 / 3.0, 180.0)};
  s.start_id = "commissioning-1";
  s.flange_form = "rotation=kuka_abc unit=mm angle=deg";
  return s;
}

CapturedView some_view() {
  CapturedView v;
  v.number = 7;
  v.step = 12;
  v.captured = "2026-11-20T23:29:01Z";
  v.use = ViewUse::fit;
  v.flange_form = "rotation=kuka_abc unit=mm angle=deg";
  v.flange = "1500.1 200.2 900.3 10 -20 179.5";
  v.shots = {{"shot_1.ply", "/drop/a \"b\".ply", 5898399, "04cfa429"}, {"shot_2.ply", "c.ply", 17, "ab"}};
  v.live = {true, 0.004, 0.0003, 100, 145, 1'795'300'000'123'456, 1'795'300'001'123'456};
  v.points = 5557;
  v.rms_mm = 1.0 / 30.0;
  v.T_scanner_target.translation_mm = Vec3(90.789367103980922, -132.3329017353102, 535.13765864964614);
  v.covariance.setIdentity();
  v.covariance(1, 0) = v.covariance(0, 1) = 1.0 / 7.0;
  return v;
}

TEST(SessionText, restores_every_bit) {
  const SessionSettings s = some_settings();
  const Result<SessionSettings> back = parse_session(session_text(s), "session.txt");
  ASSERT_TRUE(back.ok()) << back.error().text.view();
  EXPECT_EQ(session_text(back.value()), session_text(s));
  EXPECT_EQ(back.value().radius_mm, s.radius_mm);
  EXPECT_EQ(back.value().name, "hall 2");

  const CapturedView v = some_view();
  const Result<CapturedView> view = parse_view(view_text(v), "view.txt");
  ASSERT_TRUE(view.ok()) << view.error().text.view();
  EXPECT_EQ(view_text(view.value()), view_text(v));
  EXPECT_EQ(view.value().T_scanner_target.translation_mm, v.T_scanner_target.translation_mm);
  EXPECT_EQ(view.value().covariance, v.covariance);
  EXPECT_EQ(view.value().live.utime_first_us, v.live.utime_first_us);
  EXPECT_EQ(view.value().shots.size(), 2U);
}

TEST(SessionText, names_the_scanner_on_a_line_with_two) {
  SessionSettings s = some_settings();
  EXPECT_EQ(session_text(s).find("scanner ="), std::string::npos) << "as before";
  s.scanner = "right";
  const Result<SessionSettings> back = parse_session(session_text(s), "session.txt");
  ASSERT_TRUE(back.ok()) << back.error().text.view();
  EXPECT_EQ(back.value().scanner, "right");
}

TEST(SessionText, a_file_cut_off_anywhere_is_not_a_view) {
  const std::string text = view_text(some_view());
  for (std::size_t bytes = 0; bytes < text.size(); ++bytes)
    EXPECT_FALSE(parse_view(text.substr(0, bytes), "view.txt").ok()) << bytes << " bytes of " << text.size();
}

TEST(SessionText, a_number_changed_by_hand_is_named) {
  std::string text = view_text(some_view());
  text.replace(text.find("5557"), 4, "5558");
  const Result<CapturedView> view = parse_view(text, "views/007/view.txt");
  ASSERT_FALSE(view.ok());
  EXPECT_NE(view.error().text.view().find("views/007/view.txt: its checksum"), std::string_view::npos);
}

TEST(SessionText, a_view_becomes_what_a_line_of_a_table_becomes) {
  const CapturedView v = some_view();
  const Result<View> view = solver_view(ArtefactKind::ball, v, "view.txt");
  ASSERT_TRUE(view.ok()) << view.error().text.view();
  EXPECT_EQ(view.value().number, 7U);
  ASSERT_TRUE(view.value().reported_abc_rad.has_value());
  EXPECT_NEAR((*view.value().reported_abc_rad)[0], rad_from_deg(10.0), 1e-15);
  EXPECT_EQ(view.value().balls[0].centre_mm, v.T_scanner_target.translation_mm);
  CapturedView bad = v;
  bad.flange = "1500 200 900 10 20";
  const Result<View> refused = solver_view(ArtefactKind::ball, bad, "view.txt");
  ASSERT_FALSE(refused.ok());
  EXPECT_TRUE(refused.error().text.view().starts_with("view.txt:2: ")) << refused.error().text.view();
}

TEST(SessionText, solver_inputs_change_only_with_values_the_solution_depends_on) {
  const SessionSettings s = some_settings();
  const auto inputs = [&](const SessionSettings& settings, const CapturedView& v) {
    return solver_inputs(settings, {solver_view(ArtefactKind::ball, v, "").value()});
  };
  const std::string same = inputs(s, some_view());
  CapturedView later = some_view();
  later.captured = "2027-01-01T00:00:00Z";
  later.step = 99;
  EXPECT_EQ(inputs(s, later), same);
  later.T_scanner_target.translation_mm.x() = std::nextafter(later.T_scanner_target.translation_mm.x(), 1e9);
  EXPECT_NE(inputs(s, later), same);
  SessionSettings noisier = s;
  noisier.noise.robot_mm *= 2.0;
  EXPECT_NE(inputs(noisier, some_view()), same);
}

TEST(SessionText, held_out_views_are_spread_over_the_goal) {
  SessionSettings s;
  std::vector<std::size_t> held;
  for (std::size_t n = 0; n < 20; ++n)
    if (hold_out_next(s, n, held.size())) held.push_back(n + 1);
  EXPECT_EQ(held, (std::vector<std::size_t>{7, 14, 20}));
}

TEST(SessionText, steps_solutions_and_verifications_are_read_back) {
  const ViewChange change{12, 7, "now", "me", "they \"leaned\" on the post"};
  const auto change_back = parse_view_change(change_text(change), "undo.txt");
  ASSERT_TRUE(change_back.ok());
  EXPECT_EQ(change_back.value().undoes, 7U);
  SolvedRecord solved;
  solved.step = 3;
  solved.id = "he-1";
  solved.ok = true;
  solved.numbers = {some_settings().T_flange_scanner, 0.01, 1e-5};
  const auto solved_back = parse_solved(solved_text(solved), "solved.txt");
  ASSERT_TRUE(solved_back.ok());
  EXPECT_TRUE(solved_back.value().ok);
  EXPECT_EQ(solved_back.value().numbers.T_flange_scanner.to_array(), solved.numbers.T_flange_scanner.to_array());
  // A solution without its numbers must never be applicable.
  solved.numbers.sigma_mm = kNoValue;
  EXPECT_FALSE(parse_solved(solved_text(solved), "solved.txt").value().ok);
  VerifiedRecord verified;
  verified.inputs = "ab";
  verified.after_rms_mm = 0.1;
  verified.after_max_mm = 0.2;
  EXPECT_EQ(parse_verified(verified_text(verified), "verified.txt").value().after_max_mm, 0.2);
}

}  // namespace
}  // namespace slabd::calib
