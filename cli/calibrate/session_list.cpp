// SPDX-License-Identifier: Apache-2.0
//
// slabctl calibrate list, drop, undo: what the session holds, and taking views out of it. Nothing is ever deleted.
#include <fmt/core.h>
#include <map>
#include <memory>

#include "cli/calibrate/calibrate.h"
#include "cli/calibrate/session.h"
#include "cli/client/calibration_desk.h"
#include "cli/exit.h"
#include "cli/terminal/arguments.h"
#include "cli/terminal/parse.h"
#include "cli/terminal/render.h"

namespace slabd::cli {
namespace {

struct Options {
  SessionOptions session;
  std::size_t number = 0;
  std::string why;
  bool json = false;
};

using calib::ViewUse;

std::string state_of(const Session::Entry& e) {
  if (!e.unreadable.empty()) return "UNREADABLE";
  if (e.undone) return "undone";
  if (e.dropped_step != 0) return "dropped";
  switch (e.view.use) {
    case ViewUse::fit: return "fit";
    case ViewUse::held_out: return "held out";
    case ViewUse::refused: break;
  }
  return "refused";
}

std::string note_of(const Session::Entry& e) {
  if (!e.unreadable.empty()) return e.unreadable;
  if (e.dropped_step != 0) return e.dropped_why;
  if (!e.view.accepted()) return e.view.refusal + ": " + e.view.reason;
  return "";
}

/// How every view that counts fits the solution, by number; empty while there is none of these views.
std::map<std::size_t, calib::ViewFit> fits_of(const Session& session) {
  std::map<std::size_t, calib::ViewFit> fits;
  if (!session.solution_is_current()) return fits;
  const auto fit = session.views(ViewUse::fit);
  const auto held_out = session.views(ViewUse::held_out);
  if (!fit.ok() || !held_out.ok()) return fits;
  calib::SolveSettings quick = session.solve_settings();
  quick.convention_test = false;
  const auto solved = calib::solve(session.settings().kind, fit.value(), session.settings().noise, quick);
  if (!solved.ok() || !solved.value().determined) return fits;
  for (const calib::ViewFit& view : solved.value().views) fits[view.number] = view;
  for (const calib::ViewFit& view :
       calib::residuals_of(session.settings().kind, held_out.value(), solved.value().T_flange_scanner,
                           solved.value().targets, session.settings().noise))
    fits[view.number] = view;
  return fits;
}

std::string number(double v, int digits) {
  return has_value(v) ? fmt::format("{:.{}f}", v, digits) : "-";
}

double tilt_of(const Session& session, const Session::Entry& e, const calib::Guide& guide) {
  const auto pose = calib::parse_flange(e.view.flange_form, e.view.flange, "");
  if (!guide.T_flange_scanner || !pose.ok()) return kNoValue;
  return calib::tilt_deg(pose.value(), *guide.T_flange_scanner, session.settings().down_base);
}

std::string view_table(const Session& session, const calib::Guide& guide) {
  const std::map<std::size_t, calib::ViewFit> fits = fits_of(session);
  Table table{"view",       "use<",     "points",           "cap deg",     "rms mm",
              "radius off", "tilt deg", "seen at x y z mm", "residual mm", "note<"};
  for (const Session::Entry& e : session.entries()) {
    const calib::CapturedView& v = e.view;
    const Vec3& p = v.T_scanner_target.translation_mm;
    const auto fit = fits.find(v.number);
    std::string note = note_of(e);
    if (fit != fits.end() && !fit->second.kept) note = "rejected by the solution: look at its scan, or drop it";
    const bool readable = e.unreadable.empty();
    table.add(v.number, state_of(e), readable ? std::to_string(v.points) : "-", number(v.half_angle_deg, 0),
              number(v.rms_mm, 3), number(v.radius_off_mm, 3), readable ? number(tilt_of(session, e, guide), 0) : "-",
              readable && v.accepted() ? fmt::format("{:.0f} {:.0f} {:.0f}", p.x(), p.y(), p.z()) : "-",
              fit != fits.end() ? number(fit->second.residual_mm, 3) : "-", note);
  }
  return text_of(table);
}

void write_views(Json& json, const Session& session, const calib::Guide& guide) {
  const std::map<std::size_t, calib::ViewFit> fits = fits_of(session);
  json.list("views", session.entries(), [&](const Session::Entry& e) {
    const calib::CapturedView& v = e.view;
    const auto fit = fits.find(v.number);
    json.field("view", v.number).field("use", state_of(e)).field("counts", e.counts()).field("note", note_of(e));
    json.field("captured", v.captured).field("points", v.points).field("half_angle_deg", v.half_angle_deg);
    json.field("rms_mm", v.rms_mm).field("radius_off_mm", v.radius_off_mm).field("repeat_mm", v.repeat_mm);
    json.field("tilt_deg", e.unreadable.empty() ? tilt_of(session, e, guide) : kNoValue);
    json.field("T_scanner_target", only_if(e.unreadable.empty() && v.accepted(), v.T_scanner_target));
    json.field("residual_mm", fit != fits.end() ? fit->second.residual_mm : kNoValue);
    json.field("kept", fit == fits.end() || fit->second.kept);
    json.list("shots", v.shots, [&](const calib::KeptShot& shot) { return e.folder + "/" + shot.file; });
  });
}

void write_solution(Json& json, const Session& session) {
  json.key("solution");
  if (!session.solution()) {
    json.null();
    return;
  }
  const calib::SolvedRecord& solved = session.solution()->record;
  json.begin_object().field("id", solved.id).field("status", solved.ok ? "ok" : "refused");
  json.field("current", session.solution_is_current()).field("when", solved.when);
  json.field("predicted_point_sigma_mm", solved.point_sigma_mm).field("s0", solved.s0);
  json.field("inputs_sha256", solved.inputs).field("figures_sha256", solved.figures);
  json.field("verified", session.solution()->verified.has_value()).end_object();
}

int list(const Options& options) {
  const Session session = find_session(options.session);
  const calib::Guide guide = session.guide();
  if (options.json) {
    Json json("slabd.calibration_session/1");
    write_session(json, session);
    json.field("kind", session.settings().kind).field("created", session.settings().created);
    json.field("operator", session.settings().operator_name).field("half_done", session.half_done());
    write_views(json, session, guide);
    write_solution(json, session);
    write_guide(json, session, guide);
    fmt::print("{}", json.text());
    return kDone;
  }
  fmt::print("{}, begun {} by {}\n", session_words(session), session.settings().created,
             session.settings().operator_name);
  for (const std::string& words : session.half_done()) fmt::print("note: {}\n", words);
  if (!session.entries().empty()) fmt::print("{}", view_table(session, guide));
  if (session.solution()) {
    const calib::SolvedRecord& solved = session.solution()->record;
    fmt::print("solved {} as {}{}: predicted point error {} mm{}\n", solved.when, solved.id,
               solved.ok ? "" : " (REFUSED, stored only)", number(solved.point_sigma_mm, 3),
               !session.solution_is_current() ? "; the views have changed since: solve again"
               : session.solution()->verified ? "; verified"
                                              : "; not verified yet");
  }
  fmt::print("{}", guide_text(session, guide));
  return kDone;
}

/// drop and undo end alike: what happened, and where the session stands.
int tell_change(const Options& options, const Session& session, const std::string& what) {
  const calib::Guide guide = session.guide();
  session.leave_next_pose(guide);
  if (options.json) {
    Json json("slabd.calibration_session_change/1");
    write_session(json, session);
    json.field("done", what);
    write_guide(json, session, guide);
    fmt::print("{}", json.text());
  } else {
    fmt::print("{}\n{}\n{}", session_words(session), what, guide_text(session, guide));
  }
  return kDone;
}

int drop(const Options& options) {
  Session session = find_session(options.session);
  need(session.lock());
  need(session.drop(options.number, default_operator(), options.why));
  return tell_change(
      options, session,
      fmt::format("view {} is dropped ({}); slabctl calibrate undo brings it back", options.number, options.why));
}

int undo(const Options& options) {
  Session session = find_session(options.session);
  need(session.lock());
  const std::string undone = need(session.undo(default_operator()));
  return tell_change(options, session, undone);
}

}  // namespace

void add_calibrate_list(args::Command& group) {
  auto options = std::make_shared<Options>();
  args::Command command = group.add_subcommand("list", "The session: every view, what is missing, where to drive next");
  command->footer("\nExample: slabctl calibrate list");
  options->session.add_to(*command);
  command->add_flag("--json", options->json, "Print slabd.calibration_session/1 on stdout");
  command->runs([options] { return list(*options); });
}

void add_calibrate_drop(args::Command& group) {
  auto options = std::make_shared<Options>();
  args::Command command = group.add_subcommand("drop", "Leave a view out of everything; its scans stay");
  command->footer("\nExample: slabctl calibrate drop 7 --why \"somebody leaned on the post\"");
  command->add_option("VIEW", options->number, "Its number in `list`")->required()->check(args::range(1, 9999));
  command->add_option("--why", options->why, "Why; kept with the view")->required()->check(some_words());
  options->session.add_to(*command);
  command->add_flag("--json", options->json, "Print slabd.calibration_session_change/1 on stdout");
  command->runs([options] { return drop(*options); });
}

void add_calibrate_undo(args::Command& group) {
  auto options = std::make_shared<Options>();
  args::Command command = group.add_subcommand("undo", "Take back the newest capture or drop; again: the one before");
  command->footer("\nExample: slabctl calibrate undo");
  options->session.add_to(*command);
  command->add_flag("--json", options->json, "Print slabd.calibration_session_change/1 on stdout");
  command->runs([options] { return undo(*options); });
}

}  // namespace slabd::cli
