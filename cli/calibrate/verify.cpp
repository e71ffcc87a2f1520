// SPDX-License-Identifier: Apache-2.0
//
// slabctl calibrate verify: compares the solution with held-out views and with the calibration in force, and prints
// the change at the slab. A calibration can fit its own views and be wrong; held-out views are independent of the fit.
#include <fmt/core.h>
#include <unistd.h>

#include <algorithm>
#include <cstdio>
#include <memory>

#include "cli/calibrate/calibrate.h"
#include "cli/calibrate/session.h"
#include "cli/client/calibration_change.h"
#include "cli/client/record_options.h"
#include "cli/command.h"
#include "cli/exit.h"
#include "cli/terminal/arguments.h"
#include "cli/terminal/render.h"
#include "cli/terminal/say.h"

namespace slabd::cli {
namespace {

constexpr std::size_t kHeldOutMin = 3;

struct Options {
  SessionOptions session;
  std::uint16_t slab_type = 0;
  bool yes = false;
  bool json = false;
};

struct Verification {
  InForce before;
  bool has_before = false;
  std::vector<calib::ViewFit> before_fits, after_fits;  ///< held-out views
  std::vector<calib::ViewFit> before_own, after_own;    ///< the views of the fit, rejected ones left out
  SeatShifts seats;
  double turn_deg = kNoValue;
  double limit_mm = kNoValue;   ///< limit of a held-out view's residual
  double limit_deg = kNoValue;  ///< ... and of its rotation; NaN if the artefact has none
  bool passed = false;
};

calib::Spread mm_of(const std::vector<calib::ViewFit>& fits) {
  std::vector<double> values;
  for (const calib::ViewFit& fit : fits) values.push_back(fit.residual_mm);
  return calib::spread_of(values);
}
calib::Spread deg_of(const std::vector<calib::ViewFit>& fits) {
  std::vector<double> values;
  for (const calib::ViewFit& fit : fits) values.push_back(fit.residual_deg);
  return calib::spread_of(values);
}

Verification carry_out(const Options& options, const Session& session, const SessionSolution& solution) {
  Verification v;
  const calib::SessionSettings& settings = session.settings();
  const std::vector<calib::View> held_out = need(session.views(calib::ViewUse::held_out), kBadInput);
  if (held_out.size() < kHeldOutMin)
    stop(kRefused,
         say("{} views are held out, {} are needed to verify; take more with: slabctl calibrate capture --hold-out",
             held_out.size(), kHeldOutMin));
  std::optional<config::Config> config;
  const std::string config_path = options.session.config.empty() ? settings.config : options.session.config;
  if (!config_if_any(config_path, config)) stop(kBadInput);
  if (config) {
    config = ScannerChoice{settings.scanner}.of(*config);
    v.before = hand_eye_in_force(*config);
    v.has_before = !v.before.id.empty();
  }
  if (!v.has_before && settings.has_start) {
    v.before.T_flange_scanner = settings.T_flange_scanner;
    v.before.id.assign(settings.start_id);
    v.has_before = true;
  }
  const calib::HandEye& after = solution.hand_eye;
  std::vector<calib::View> own;
  for (std::size_t i = 0; i < solution.views.size(); ++i)
    if (after.views[i].kept) own.push_back(solution.views[i]);
  v.after_own = calib::residuals_of(settings.kind, own, after.T_flange_scanner, after.targets, settings.noise);
  if (v.has_before) {
    const Pose& X = v.before.T_flange_scanner;
    const std::vector<Pose> targets = calib::best_targets(settings.kind, own, X);
    v.before_own = calib::residuals_of(settings.kind, own, X, targets, settings.noise);
    v.before_fits = calib::residuals_of(settings.kind, held_out, X, targets, settings.noise);
    v.turn_deg = deg_from_rad(angle_between_rad(X.rotation, after.T_flange_scanner.rotation));
    if (config) {
      if (const auto unknown = find_seat_shifts(*config, options.slab_type, X, after.T_flange_scanner, v.seats))
        throw *unknown;
    } else {
      const Vec3 middle(0.0, 0.0, 0.5 * (settings.fov.near_mm + settings.fov.far_mm));
      v.seats.shift_max_mm = (after.T_flange_scanner * middle - X * middle).norm();
    }
  }
  v.after_fits = calib::residuals_of(settings.kind, held_out, after.T_flange_scanner, after.targets, settings.noise);
  v.limit_mm = calib::kLeaveOneOutRatioMax * after.leave_one_out_mm.median;
  v.passed = mm_of(v.after_fits).max <= v.limit_mm;
  // The rotation residual is needed to detect an artefact that was rotated in place.
  if (settings.kind == calib::ArtefactKind::pose) {
    v.limit_deg = calib::kLeaveOneOutRatioMax * after.leave_one_out_deg.median;
    v.passed = v.passed && deg_of(v.after_fits).max <= v.limit_deg;
  }
  return v;
}

// ---- output ------------------------------------------------------------------------------------------------------

void write_fits(report::Json& json, std::string_view key, const std::vector<calib::ViewFit>& fits) {
  json.key(key);
  if (fits.empty()) {
    json.null();
    return;
  }
  json.begin_object().field("residual_mm", mm_of(fits)).field("residual_deg", deg_of(fits)).end_object();
}

std::string as_json(const Session& session, const SessionSolution& solution, const Verification& v, bool confirmed) {
  report::Json json("slabd.calibration_verification/1");
  write_session(json, session);
  json.field("id", solution.record.id).field("status", v.passed ? "ok" : "refused").field("confirmed", confirmed);
  json.field("held_out", v.after_fits.size()).field("limit_mm", v.limit_mm).field("limit_deg", v.limit_deg);
  json.field("before_id", report::only_if(v.has_before, v.before.id));
  write_fits(json, "before", v.before_fits);
  write_fits(json, "after", v.after_fits);
  write_fits(json, "before_fit_views", v.before_own);
  write_fits(json, "after_fit_views", v.after_own);
  json.field("turn_deg", v.turn_deg).field("shift_max_mm", v.seats.shift_max_mm);
  json.list("stations", v.seats.stations, [&](const StationShift& s) {
    json.field("station", s.station).field("taught", s.taught).field("shift_mm", s.shift_mm);
    json.field("distance_mm", s.shift_mm.norm());
  });
  json.field("next", v.passed && confirmed ? "slabctl calibrate apply" : next_command(session));
  return json.text();
}

std::string verification_text(const Session& session, const SessionSolution& solution, const Verification& v) {
  std::string text = say("{}\n{} on {} views that took no part in the fit\n", session_words(session),
                         solution.record.id, v.after_fits.size());
  const bool pose = session.settings().kind == calib::ArtefactKind::pose;
  report::Table table{say("calibration<"), say("views<"), say("median"), say("rms"), say("max"), say("unit<")};
  const auto add = [&](const std::string& what, const std::string& views, const std::vector<calib::ViewFit>& fits) {
    if (fits.empty()) return;
    const calib::Spread mm = mm_of(fits);
    table.add(what, views, report::Cell(mm.median, 3), report::Cell(mm.rms, 3), report::Cell(mm.max, 3), "mm");
    if (!pose) return;
    const calib::Spread deg = deg_of(fits);
    table.add("", "", report::Cell(deg.median, 4), report::Cell(deg.rms, 4), report::Cell(deg.max, 4), "deg");
  };
  const std::string before = say("before: {}", translated(v.before.id.view()));
  const std::string after = say("after: {}", solution.record.id);
  add(before, say("held out"), v.before_fits);
  add(after, say("held out"), v.after_fits);
  add(before, say("of the fit"), v.before_own);
  add(after, say("of the fit"), v.after_own);
  text += report::text_of(table);
  if (!v.has_before) text += say("nothing is in force to compare with\n");
  if (!v.seats.stations.empty()) {
    text += say("if applied, seats of {} move by (mm, slab axes; the scanner turns by {:.3f} deg):\n", v.seats.slab,
                v.turn_deg);
    table = report::Table{say("station"), "x", "y", "z", say("distance"), say("pose<")};
    for (const StationShift& s : v.seats.stations)
      table.add(s.station, fmt::format("{:+.3f}", s.shift_mm.x()), fmt::format("{:+.3f}", s.shift_mm.y()),
                fmt::format("{:+.3f}", s.shift_mm.z()), report::Cell(s.shift_mm.norm(), 3),
                s.taught ? say("mastered") : say("nominal"));
    text += report::text_of(table);
    if (std::any_of(v.seats.stations.begin(), v.seats.stations.end(), [](const StationShift& s) { return s.taught; }))
      text += say(
          "the station corrections in force hold for the old calibration and become stale; afterwards: slabctl "
          "calibrate stations --again --apply, or master the stations again if the scanner was moved on the flange or "
          "the line has two robots and a certificate of a slab\n");
  } else if (has_value(v.seats.shift_max_mm)) {
    text += say("if applied, the middle of the view moves by {:.3f} mm; the scanner turns by {:.3f} deg\n",
                v.seats.shift_max_mm, v.turn_deg);
  }
  if (v.has_before && mm_of(v.after_fits).rms > mm_of(v.before_fits).rms)
    complain(say("warning: the held-out views fit what is in force better than the new solution; is a change needed?"));
  return text;
}

bool asks_yes() {
  fmt::print("{}", say("Use it? Type yes: "));
  std::fflush(stdout);
  std::array<char, 16> line{};
  return std::fgets(line.data(), static_cast<int>(line.size()), stdin) != nullptr &&
         std::string_view(line.data()).starts_with("yes");
}

int verify(const Options& options) {
  set_language(options.session.language, options.json);
  Session session = find_session(options.session);
  need(session.lock());
  need_solution(session);
  const SessionSolution solution = need(solve_session(session));
  if (solution.record.id != session.solution()->record.id)
    stop(kRefused, say("solving again gives {} and not the {} that is stored: another version of slabctl "
                       "solved it; next: slabctl calibrate solve",
                       solution.record.id, session.solution()->record.id));
  // Later views also contribute to the radius check, and a newer slabctl may have other criteria.
  if (session.solution()->record.ok && !solution.record.ok)
    stop(kRefused, say("{} is refused by now; next: slabctl calibrate solve, which shows why", solution.record.id));
  const Verification v = carry_out(options, session, solution);
  if (!options.json) fmt::print("{}", verification_text(session, solution, v));
  if (!v.passed) {
    const bool placed = mm_of(v.after_fits).max <= v.limit_mm;
    const auto worst = std::max_element(v.after_fits.begin(), v.after_fits.end(), [&](const auto& a, const auto& b) {
      return placed ? a.residual_deg < b.residual_deg : a.residual_mm < b.residual_mm;
    });
    const std::string missed = placed ? say("{:.4f} deg, limit {:.4f} deg", worst->residual_deg, v.limit_deg)
                                      : say("{:.3f} mm, limit {:.3f} mm", worst->residual_mm, v.limit_mm);
    if (options.json) fmt::print("{}", as_json(session, solution, v, false));
    stop(kRefused,
         say("refused (held_out): view {} is missed by {} (four leave-one-out medians)\n  what to do: look at "
             "its scan; if it was disturbed, slabctl calibrate drop {} --reason \"...\" and take another with "
             "capture --hold-out; if it was not, the fit is wrong: take more views near it",
             worst->number, missed, worst->number));
  }
  calib::VerifiedRecord record;
  record.when = report::iso_time(wall_clock_us());
  record.who = default_operator();
  record.inputs = session.inputs(calib::ViewUse::held_out);
  if (v.has_before) record.before_id = v.before.id.view();
  record.before_rms_mm = v.before_fits.empty() ? kNoValue : mm_of(v.before_fits).rms;
  record.after_rms_mm = mm_of(v.after_fits).rms;
  record.after_max_mm = mm_of(v.after_fits).max;
  record.shift_max_mm = v.seats.shift_max_mm;

  const auto& last = session.solution()->verified;
  const bool told_before = last && last->inputs == record.inputs && last->before_id == record.before_id;
  const bool small = is_small_change(v.seats.shift_max_mm, v.turn_deg);
  const bool may_ask = !options.json && isatty(STDIN_FILENO) != 0 && isatty(STDOUT_FILENO) != 0;
  const bool confirmed = small || options.yes || told_before || (may_ask && asks_yes());
  if (confirmed && !told_before) need(session.keep_verified(record));
  if (options.json) fmt::print("{}", as_json(session, solution, v, confirmed));
  if (!confirmed)
    stop(kRefused, say("a change of {} needs a word of yours: look at the shifts, then slabctl calibrate verify --yes",
                       has_value(v.seats.shift_max_mm)
                           ? say("{:.3f} mm and {:.3f} deg (above {} mm or {} deg)", v.seats.shift_max_mm, v.turn_deg,
                                 kConfirmAbove_mm, kConfirmAbove_deg)
                           : say("unknown size")));
  if (!options.json) fmt::print("{}", say("verified; next: slabctl calibrate apply\n"));
  return kDone;
}

}  // namespace

void add_calibrate_verify(args::Command& group) {
  auto options = std::make_shared<Options>();
  args::Command command =
      group.add_subcommand("verify", "Hold the solution against the held-out views; what changes at the slab");
  command->footer(
      "\nCompared with the calibration in force, or the commissioning value. A shift above 0.2 mm, or a turn above "
      "0.01 deg,\n"
      "is to be judged.\n"
      "Example: slabctl calibrate verify\n"
      "Exit status 6: refused, or not confirmed; the text says what to do.");
  options->session.add_to(*command);
  command->add_option("--slab-type", options->slab_type, "Whose stations are shown (default: the first recipe's)");
  command->add_flag("--yes", options->yes, "The shift is looked at and wanted");
  command->add_flag("--json", options->json, "Print slabd.calibration_verification/1 on stdout");
  command->runs([options] { return verify(*options); });
}

}  // namespace slabd::cli
