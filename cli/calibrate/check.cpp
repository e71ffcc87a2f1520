// SPDX-License-Identifier: Apache-2.0
//
// slabctl calibrate check and reference: artefacts that monitor a calibration. The reference block is measured by
// daemon::measure_block, as every scan of the line, so a check tests the computation of the verdicts.
#include <fmt/core.h>
#include <cmath>
#include <map>
#include <memory>
#include <span>
#include <vector>

#include "algo/algo.h"
#include "base/durable.h"
#include "base/pages.h"
#include "base/record_fields.h"
#include "cli/calibrate/calibrate.h"
#include "cli/calibrate/monitor_ball.h"
#include "cli/client/calibration_change.h"
#include "cli/client/record_options.h"
#include "cli/command.h"
#include "cli/exit.h"
#include "cli/slab_choice.h"
#include "cli/terminal/arguments.h"
#include "cli/terminal/parse.h"
#include "cli/terminal/progress.h"
#include "cli/terminal/render.h"
#include "cli/terminal/say.h"
#include "daemon/measure.h"
#include "report/json.h"
#include "report/slab_view.h"

namespace slabd::cli {
namespace {

constexpr std::size_t kTrendRows = 10;

struct CheckOptions {
  std::string config;
  ScannerChoice scanner;
  std::string scan;
  std::string recipe;
  std::string slab;
  int station = 0;
  bool ball = false;
  double temperature_c = kNoValue;
  BallMeasurement look;
  std::string who;
  std::size_t limit = kTrendRows;
  LanguageOption language;
  bool json = false;
};

struct ReferenceOptions {
  RecordOptions record;
  std::string certificate;
  BallMeasurement look;
  double limit_mm = 0.1;
  LanguageOption language;
};

// ---- reference block ---------------------------------------------------------------------------------------------

/// Requires a recipe of the line, because a check passes by the recipe's U.
void need_recipe_of_line(const Recipe& recipe, const std::string& file, const config::Config& config) {
  std::vector<config::Problem> problems;
  std::vector<Recipe> of_line;
  config::load_recipes(config.recipes_dir, of_line, problems);
  for (const Recipe& one : of_line)
    if (one.sha256 == recipe.sha256) return;
  static_cast<void>(report_problems(problems));
  stop(kRefused, say("{}: none of the recipes in {} is like it, so no verdict is made with its limits and "
                     "uncertainties: check with a recipe of the line, or put this one there",
                     file, config.recipes_dir));
}

BlockResult measure_scan(const CheckOptions& options, const config::Config& config, storage::Reader& reader) {
  if (options.recipe.empty())
    stop(kUsage, say("a scan needs --recipe: the block's shape, and what U is computed from"));
  Recipe recipe = recipe_from(options.recipe);
  need_recipe_of_line(recipe, options.recipe, config);
  // The certificate's own expansion counts, and the artefact is not of concrete.
  recipe.thermal.given = false;
  // Measured with the scanner's acceptance, as on the line.
  const auto line = need(reader.line_calibration(config.by.scanner.view()));
  const ProgressNote note(stderr, say("measuring ..."), std::chrono::seconds(1));
  Pages memory(limits::kScanSlotBytes);
  const std::span<float> xyz = memory.take<float>(limits::kScanPointsMax * 3);
  const ScanShape shape = need(hal::read_scan(options.scan.c_str(), options.look.form.form(config.scanner.form), xyz));
  const std::unique_ptr<hal::Clock> clock = hal::make_system_clock();
  algo::BlockInspector inspector(config::default_measure_threads());
  inspector.use(recipe);
  const algo::Cloud cloud{xyz, shape.points, shape.width, shape.height};
  need(daemon::measure_block(inspector, *clock, 1, Pose::identity(), nominal_T_block_scanner(), cloud, shape, 0.0,
                             line->scanner.numbers, {},
                             scanner_drift(config.scanner_drift, line->scanner.numbers, shape.scanner_temperature_c)));
  return inspector.result();
}

/// The newest checks of this scanner's artefacts, newest first, at most `limit`.
std::vector<CalibrationCheck> checks_of_scanner(const config::Config& config, storage::Reader& reader,
                                                std::size_t limit) {
  if (!config.arms.several()) return need(reader.checks(limit));
  constexpr std::size_t kLookBack = 100'000;
  std::map<std::string, bool> is_own;
  std::vector<CalibrationCheck> own;
  for (const CalibrationCheck& check : need(reader.checks(kLookBack))) {
    const auto [known, is_new] = is_own.try_emplace(std::string(check.reference_id.view()), false);
    if (is_new) {
      const auto reference = need(reader.calibration(known->first));
      known->second = reference && reference->scanner == config.by.scanner.view();
    }
    if (known->second && own.size() < limit) own.push_back(check);
  }
  return own;
}

/// Time of the last check of this scanner's reference blocks; 0: never. A check with a time in the future is ignored,
/// because the clock was wrong.
std::int64_t last_check_utime_us(const config::Config& config, storage::Reader& reader) {
  constexpr std::size_t kLookBack = 1'000;
  std::int64_t newest = 0;
  for (const CalibrationCheck& check : checks_of_scanner(config, reader, kLookBack))
    if (check.kind == CalibrationKind::reference_block && check.utime_us <= wall_clock_us())
      newest = std::max(newest, check.utime_us);
  return newest;
}

/// Result of one station of an inspected slab, for a reference block that is a station of the cell. It is valid only
/// if it was scanned with the calibration in force and after the last check. `source`: its name.
BlockResult take_from_slab(const CheckOptions& options, const config::Config& config, storage::Reader& reader,
                           const CalibrationId& in_force, std::string& source) {
  const storage::SlabRecord slab = named_slab(reader, options.slab);
  const std::int64_t key = slab.summary.header.key;
  const storage::SlabBlock* valid = report::latest(slab, options.station);
  if (valid == nullptr || valid->phase != StationPhase::measured)
    stop(kBadInput, say("--slab {} --station {}: this station was not measured; slabctl show {} lists its blocks",
                        options.slab, options.station, options.slab));
  const Attempt& attempt = valid->attempt;
  if (config.arms.several() && attempt.by.scanner != config.by.scanner)
    stop(kBadInput, say("--slab {} --station {}: scanner {} scanned it, not scanner {}", options.slab, options.station,
                        attempt.by.scanner.view(), config.by.scanner.view()));
  const SlabHeader& header = slab.summary.header;
  const CalibrationId& measured_with =
      attempt.arm == 0 ? header.calibration_id : header.more_arms[attempt.arm - 1U].calibration_id;
  if (!(measured_with == in_force))
    stop(kRefused, say("slab {} was measured with calibration {}, in force is {}: scan the reference block again", key,
                       measured_with.empty() ? say("none") : std::string(measured_with.view()), in_force.view()));
  const std::int64_t checked = last_check_utime_us(config, reader);
  if (valid->attempt.scan_utime_us <= checked)
    stop(kRefused,
         say("slab {} station {} was scanned at {}, before the last check at {}: scan the reference block again", key,
             options.station, report::iso_time(valid->attempt.scan_utime_us), report::iso_time(checked)));
  source = fmt::format("slab key {} station {} attempt {}", key, options.station, valid->attempt.number);
  return valid->block;
}

// ---- monitor ball ------------------------------------------------------------------------------------------------

/// Rejects a passed check from another pose if the last check failed, because the robot error may have the opposite
/// sign there.
void need_clear_elsewhere(const config::Config& config, storage::Reader& reader, const CalibrationCheck& check,
                          const std::string& where) {
  if (check.passed && need(reader.line_calibration(config.by.scanner.view()))->ball.failed)
    stop(kRefused, say("refused: the last check failed, and this one does not clear it: {}", where));
}

InForce need_hand_eye(storage::Reader* reader, const config::Config& config) {
  const InForce now = hand_eye_in_force(reader, config);
  if (now.id.empty())
    stop(kRefused, say("no calibration is in force, and the configuration has no commissioning values"));
  return now;
}

// ---- output ------------------------------------------------------------------------------------------------------

void write_check(report::Json& json, const CalibrationCheck& check) {
  report::write_fields(json, check, [&](std::string_view field) {
    if (field == "utime_us") report::write_time(json, "time", check.utime_us);
    return field != "utime_us";
  });
}

std::string due_text(const LineCalibration::Watch& watch, std::int64_t interval_us) {
  if (watch.reference_id.empty()) return "";
  const std::int64_t last = checked_from_utime_us(watch);
  if (interval_us == 0) return say("no checks are due ([calibration] check_interval_hours = 0)");
  return say("next check due {}{}", report::iso_time(last + interval_us),
             overdue(watch, interval_us, wall_clock_us()) ? say(": OVERDUE") : "");
}

std::string passed_word(bool passed) {
  return passed ? say("passed") : say("FAILED");
}

std::string figures_of(const CalibrationCheck& check) {
  if (check.kind == CalibrationKind::monitor_ball)
    return say("{:.3f} mm off ({:+.3f} {:+.3f} {:+.3f})", check.off_mm.norm(), check.off_mm.x(), check.off_mm.y(),
               check.off_mm.z());
  return say("slope {:.4f} deg, jaw distance {:.4f} mm", deg_from_rad(check.slope_rad), check.jaw_distance_mm);
}

/// Prints the trend, oldest first.
int show_trend(const CheckOptions& options, const config::Config& config, storage::Reader* reader) {
  std::vector<CalibrationCheck> checks;
  std::unique_ptr<LineCalibration> line = std::make_unique<LineCalibration>();
  if (reader != nullptr) {
    checks = checks_of_scanner(config, *reader, options.limit);
    line = need(reader->line_calibration(config.by.scanner.view()));
  }
  if (options.json) {
    report::Json json("slabd.calibration_trend/1");
    for (const auto& [key, watch] :
         {std::pair{"reference_block", &line->block}, std::pair{"monitor_ball", &line->ball}}) {
      json.key(key);
      if (watch->reference_id.empty()) {
        json.null();
        continue;
      }
      const std::int64_t last = checked_from_utime_us(*watch);
      json.begin_object().field("id", watch->reference_id).field("failed", watch->failed);
      report::write_time(json, "checked", watch->checked_utime_us);
      report::write_time(json, "due", config.check_interval_us == 0 ? 0 : last + config.check_interval_us);
      json.field("overdue", overdue(*watch, config.check_interval_us, wall_clock_us())).end_object();
    }
    json.list("checks", checks, [&](const CalibrationCheck& check) { write_check(json, check); });
    fmt::print("{}", json.text());
    return kDone;
  }
  report::Table table{say("when<"), say("what<"), say("result<"), say("measured<"), say("note<")};
  for (auto check = checks.rbegin(); check != checks.rend(); ++check)
    table.add(report::iso_time(check->utime_us), translated(name(check->kind)), passed_word(check->passed),
              figures_of(*check), quote(check->note.view()));
  if (!table.rows.empty()) fmt::print("{}\n", report::text_of(table));
  if (line->block.reference_id.empty() && line->ball.reference_id.empty())
    fmt::print("{}", say("no reference block and no monitor ball is in force: slabctl calibrate reference --help\n"));
  for (const LineCalibration::Watch* watch : {&line->block, &line->ball})
    if (const std::string due = due_text(*watch, config.check_interval_us); !due.empty())
      fmt::print("{}: {}\n", watch->reference_id.view(), due);
  return kDone;
}

// ---- the commands ------------------------------------------------------------------------------------------------

/// Identifies a scan independently of its path: the beginning of its source.
Result<std::string> mark_of(const std::string& scan) {
  const Result<FileDigest> digest = digest_of(scan);
  if (!digest.ok()) return digest.error();
  return fmt::format("sha256 {} ", digest.value().sha256.substr(0, 16));
}

/// Requires a new scan, because a scan that was evaluated before contains no new information. Adds its identification
/// to `source`; stops if it was evaluated before or defines the ball's position.
void need_new(const CheckOptions& options, const config::Config& config, storage::Reader& reader, std::string& source) {
  constexpr std::size_t kLookBack = 10'000;
  if (options.look.live) return;
  if (options.slab.empty()) source = need(mark_of(options.scan)) + source;
  // A file is identified by its content, a station of a slab by its whole name: station 1 is not 12.
  const std::size_t digest_end = std::string_view("sha256 0123456789abcdef ").size();
  const auto same = [&](std::string_view other) {
    return options.slab.empty() ? other.substr(0, digest_end) == source.substr(0, digest_end) : other == source;
  };
  const CalibrationKind kind = options.ball ? CalibrationKind::monitor_ball : CalibrationKind::reference_block;
  const auto reference = need(reader.current(kind, 0, config.by.scanner.view()));
  if (options.ball && reference &&
      reference->observations.find("scan " + source.substr(0, digest_end)) != std::string::npos)
    stop(kRefused,
         say("{} has its place from this scan; a check needs a scan of its own: take a new one", reference->id));
  const auto checks = need(reader.checks(kLookBack));
  for (const CalibrationCheck& check : checks) {
    if (check.kind != kind || !same(check.source.view())) continue;
    stop(kRefused, say("this scan was judged before, at {}: {}; a check needs a scan of its own: take a new one",
                       report::iso_time(check.utime_us), passed_word(check.passed)));
  }
}

/// Expansion of the reference block since its certification.
Thermal expansion_of(const storage::CalibrationRecord& reference, double temperature_c) {
  const auto certificate = need(calib::parse_reference_certificate(reference.certificate, reference.id));
  const Thermal expansion = calib::expansion_of(certificate, temperature_c);
  if (!expansion.given && has_value(temperature_c))
    complain(
        say("warning: the certificate of {} has no expansion_per_K, so --temperature changes nothing", reference.id));
  if (expansion.given && !has_value(temperature_c))
    complain(
        say("warning: --temperature does not say how warm the reference block is: this adds {:.3f} mm to the "
            "uncertainty of the jaw distance",
            2.0 * expansion.u * certificate.block.jaw_distance_mm));
  return expansion;
}

/// Compares with the artefact in force.
CalibrationCheck judge(const CheckOptions& options, const config::Config& config, storage::Reader& reader) {
  const CalibrationKind kind = options.ball ? CalibrationKind::monitor_ball : CalibrationKind::reference_block;
  const auto reference = need(reader.current(kind, 0, config.by.scanner.view()));
  if (!reference)
    stop(kBadInput, say("no {} is in force to compare with: slabctl calibrate reference", translated(name(kind))));
  if (const std::int64_t end = reference->expires_utime_us; end != 0 && wall_clock_us() >= end)
    stop(kRefused,
         say("{} expired on {}: it is not valid any more; have it certified again, then slabctl calibrate reference",
             reference->id, report::iso_time(end)));
  const InForce hand_eye = need_hand_eye(&reader, config);
  CalibrationCheck check;
  std::string source = options.scan;
  if (options.ball) {
    const auto& ball = std::get<MonitorBall>(reference->numbers);
    BallMeasurement look = options.look;
    look.scan = options.scan;
    look.who = options.who;
    // With another radius the ball's centre moves along the view by about the difference.
    if (has_value(look.radius_mm) && std::abs(look.radius_mm - ball.radius_mm) > kSameRadius_mm)
      stop(kBadInput, say("--radius {:g}: {} was taken into use with {:g} mm, and a check compares with that; "
                          "leave --radius out, or take the ball into use again (slabctl calibrate reference)",
                          look.radius_mm, reference->id, ball.radius_mm));
    look.radius_mm = ball.radius_mm;
    const MeasuredBall seen = look_at_ball(config, look, hand_eye.T_flange_scanner);
    check = calib::check_ball(ball, seen.p_base_mm);
    if (options.look.live) source = seen.source;
    need_new(options, config, reader, source);
    if (const std::string where = seen_elsewhere(config, reference->observations, seen); !where.empty()) {
      need_clear_elsewhere(config, reader, check, where);
      complain(say("warning: {}", where));
      check.note.assign((check.note.empty() ? "" : std::string(check.note.view()) + "; ") + kElsewhereNote);
    }
  } else {
    const BlockResult block = options.slab.empty() ? measure_scan(options, config, reader)
                                                   : take_from_slab(options, config, reader, hand_eye.id, source);
    need_new(options, config, reader, source);
    check = calib::check_block(std::get<ReferenceBlock>(reference->numbers), block, config.check_limits,
                               expansion_of(*reference, options.temperature_c));
  }
  check.reference_id.assign(reference->id);
  check.hand_eye_id = hand_eye.id;
  check.utime_us = wall_clock_us();
  check.who.assign(options.who.empty() ? default_operator() : options.who);
  check.source.assign(source);
  return check;
}

int check_calibration(const CheckOptions& options) {
  set_language(options.language, options.json);
  const config::Config config = options.scanner.of(config_from(options.config));
  finish_killed_change(config);
  std::unique_ptr<storage::Reader> reader = open_records(config);
  if (options.ball && options.look.live == !options.scan.empty())
    stop(kUsage, say("--ball needs either a scan with --flange, or --live"));
  if (options.look.live && !options.ball)
    stop(kUsage,
         say("--live is for --ball; the reference block is checked from a scan, or as a station of a slab (--slab)"));
  if (!options.slab.empty() && (!options.scan.empty() || options.station == 0))
    stop(kUsage, say("--slab needs --station, where the reference block stood, and no scan beside it"));
  if (options.scan.empty() && options.slab.empty() && !options.look.live)
    return show_trend(options, config, reader.get());
  if (reader == nullptr) stop(kBadInput, say("nothing is in force to compare with: slabctl calibrate reference"));
  const CalibrationCheck check = judge(options, config, *reader);
  reader.reset();
  const ChangeAnswer kept = need(change_calibration(config, storage::KeepCheck{check}));
  if (options.json) {
    report::Json json("slabd.calibration_check/1");
    write_check(json, check);
    fmt::print("{}", json.text());
  } else {
    fmt::print("{}",
               say("{} against {}: {}\n", passed_word(check.passed), check.reference_id.view(), figures_of(check)));
  }
  if (check.passed && !check.note.empty()) complain(say("warning: {}", quote(check.note.view())));
  if (!check.passed)
    complain(say("{}; slabs are refused (fault 503) until a check passes. Remedy: {}", quote(check.note.view()),
                 check.kind == CalibrationKind::monitor_ball
                     ? say("look whether ball, scanner and robot sit where they sat, clean the ball, let the robot "
                           "warm up, check again from the same pose; if it fails again, calibrate and master the "
                           "stations again, then take the ball into use again and check")
                     : say("clean artefact and scanner, let both warm up, check again; if it fails again, calibrate "
                           "and have the scanner examined")));
  return check.passed ? kDone : kRefused;
}

int take_reference(const ReferenceOptions& options) {
  set_language(options.language);
  const int given =
      (options.certificate.empty() ? 0 : 1) + (options.look.scan.empty() ? 0 : 1) + (options.look.live ? 1 : 0);
  if (given != 1)
    stop(kUsage,
         say("give one of --certificate (reference block), --ball SCAN with --flange, or --live (monitor ball, with "
             "--radius)"));
  const config::Config config = options.record.scanner.of(config_from(options.record.config));
  finish_killed_change(config);
  std::unique_ptr<storage::Reader> reader = open_records(config);
  storage::CalibrationRecord record;
  options.record.describe(config, record);
  if (options.record.valid_days < 0) record.expires_utime_us = 0;  // an artefact has no end unless one is given
  if (!options.certificate.empty()) {
    const std::string text = need(text_file(options.certificate));
    const auto certificate = need(calib::parse_reference_certificate(text, options.certificate));
    record.numbers = certificate.block;
    record.certificate = text;
  } else {
    const InForce hand_eye = need_hand_eye(reader.get(), config);
    BallMeasurement look = options.look;
    look.who = record.operator_name;
    MeasuredBall seen = look_at_ball(config, look, hand_eye.T_flange_scanner);
    if (!look.live) seen.source = need(mark_of(look.scan)) + seen.source;
    const Vec3& p = seen.p_base_mm;
    record.numbers = MonitorBall{p, look.radius_mm, options.limit_mm};
    record.observations = ball_observations(seen, hand_eye.id.view());
    fmt::print("{}", say("ball at {:.3f} {:.3f} {:.3f} mm (base frame), may be found {:.3f} mm from there\n", p.x(),
                         p.y(), p.z(), options.limit_mm));
  }
  if (options.record.dry_run) {
    fmt::print("{}", kept_text({}, true));
    return kDone;
  }
  reader.reset();
  const Kept kept = keep_record(config, options.record, record);
  if (kept.status == kDone) fmt::print("{}", kept_text(kept, false));
  return kept.status;
}

}  // namespace

void add_calibrate_check(args::Command& group) {
  auto options = std::make_shared<CheckOptions>();
  args::Command command = group.add_subcommand(
      "check", "The daily check with the reference block or the monitor ball; without a scan: trend and due date");
  command->footer(
      "\nA check that fails keeps slabs from beginning (fault 503) until one passes; an overdue one is a warning.\n"
      "Passed: within sqrt(U^2 + U_certificate^2), and within [calibration] check_slope_limit_deg, "
      "check_jaw_limit_mm.\n"
      "Exit status 6: the check failed.\n\n"
      "Examples: slabctl calibrate check refblock.ply --recipe p5600.toml\n"
      "          slabctl calibrate check --slab 12 --station 3\n"
      "          slabctl calibrate check ball.ply --ball --flange \"1500 200 900 0 1 0 0\"\n"
      "          slabctl calibrate check --ball --live\n"
      "          slabctl calibrate check");
  command->add_option("SCAN", options->scan, "Scan of the reference block, or of the monitor ball with --ball");
  command->add_option("--config", options->config, "The daemon's configuration")->default_val(default_config());
  options->scanner.add_to(*command);
  command->add_option("--recipe", options->recipe,
                      "Recipe with the shape of the reference block, one of the line's ([recipes] dir)");
  args::Option slab = command->add_option("--slab", options->slab, "Instead of a scan: slab key or id ...");
  command->add_option("--station", options->station, "... and the station where the reference block stood")
      ->check(args::range(1, static_cast<int>(limits::kStationsMax)))
      ->needs(slab);
  command->add_flag("--ball", options->ball, "The scan shows the monitor ball")->excludes(slab);
  command->add_option("--temperature", options->temperature_c, "Temperature of the reference block, deg C")
      ->check(within(0.0, 40.0));
  options->look.add_to(*command);
  command->add_option("--operator", options->who, "Name of the operator (default: your login)");
  command->add_option("--limit", options->limit, "How many checks of the trend are shown")
      ->check(args::range(std::size_t{1}, std::size_t{100'000}))
      ->capture_default_str();
  options->language.add_to(*command, "Language of the text");
  command->add_flag("--json", options->json, "Print slabd.calibration_check/1 or slabd.calibration_trend/1 on stdout");
  command->runs([options] { return check_calibration(*options); });
}

void add_calibrate_reference(args::Command& group) {
  auto options = std::make_shared<ReferenceOptions>();
  args::Command command = group.add_subcommand(
      "reference", "Take a certified reference block, or a ball fixed in the cell, into use for the checks");
  command->footer(
      "\nThe certificate's text form: docs/CALIBRATION.md. The monitor ball needs no certified place: where it is "
      "found\n"
      "now is what later checks are compared with.\n\n"
      "Examples: slabctl calibrate reference --certificate refblock.txt --apply --reason \"recertified\"\n"
      "          slabctl calibrate reference --ball ball.ply --flange \"1500 200 900 0 1 0 0\" --radius 19.05 --apply\n"
      "          slabctl calibrate reference --live --radius 19.05 --apply");
  options->record.add_to(*command);
  command->add_option("--certificate", options->certificate, "Certificate of the reference block");
  command->add_option("--ball", options->look.scan, "Scan of the monitor ball");
  command->add_option("--ball-limit", options->limit_mm, "The ball may be found this far from its place, mm")
      ->check(within(0.001, 10.0))
      ->capture_default_str();
  options->look.add_to(*command);
  options->language.add_to(*command, "Language of the text");
  command->runs([options] { return take_reference(*options); });
}

}  // namespace slabd::cli
