// SPDX-License-Identifier: Apache-2.0
//
// slabctl calibrate apply, rollback, history: changes the calibration in force and lists its history.
#include <fmt/core.h>

#include <algorithm>
#include <filesystem>
#include <memory>

#include "cli/calibrate/calibrate.h"
#include "cli/calibrate/session.h"
#include "cli/client/calibration_change.h"
#include "cli/client/record_options.h"
#include "cli/command.h"
#include "cli/exit.h"
#include "cli/terminal/arguments.h"
#include "cli/terminal/parse.h"
#include "cli/terminal/render.h"
#include "cli/terminal/say.h"
#include "report/json.h"

namespace slabd::cli {
namespace {

struct Options {
  std::string config;
  ScannerChoice scanner;
  std::string id;
  std::string kind = "hand_eye";
  std::uint16_t slab_type = 0;
  std::string who;
  std::string why;
  std::size_t limit = 20;
  LanguageOption language;
  bool json = false;
};

storage::ChangeNote note_of(const Options& options) {
  return {options.who.empty() ? default_operator() : options.who, options.why, wall_clock_us()};
}

/// Warns if the acceptance in force is invalid, because a later verification of the scanner was out of its limits.
void warn_of_standing(const config::Config& config, std::string_view id) {
  const auto reader = records_if_readable(config);
  if (!reader.ok()) return complain(retold(reader.error().text.view()));
  if (reader.value() == nullptr) return;
  const auto record = reader.value()->calibration(id);
  if (!record || !record.value()) return;
  const auto line = reader.value()->line_calibration(record.value()->scanner);
  if (!line || line.value()->scanner.id.view() != id ||
      acceptance_state(line.value()->scanner, wall_clock_us()) != AcceptanceState::failed)
    return;
  complain(
      say("warning: the line goes on warning of the scanner: after {} was kept, a verification was out of its "
          "limits; only a new acceptance, from other scans, ends that (slabctl scanner verify --apply)",
          id));
}

/// Warns if the tie that was put in force cannot be used, because it was solved with other hand-eye calibrations.
void warn_of_tie(const config::Config& config, std::string_view id) {
  if (!config.arms.several() || !id.starts_with("ti-")) return;
  const auto reader = records_if_readable(config);
  if (!reader.ok() || reader.value() == nullptr) return;
  const auto cell = reader.value()->cell_calibration(config.arms);
  if (!cell) return;
  const TieFault fault = fault_of_tie(*cell.value(), config.arms.list[1].robot, wall_clock_us());
  if (fault != TieFault::none)
    complain(say("warning: {} cannot be used: {}", id, quote(describe(fault, *cell.value()).view())));
}

void warn_of_one_acceptance(const config::Config& config) {
  if (const std::string why = one_acceptance_for_two(config); !why.empty()) complain(say("warning: {}", why));
}

int carry_out(const Options& options, const storage::CalibrationChange& change) {
  set_language(options.language, options.json);
  const config::Config config = config_from(options.config);
  const Result<ChangeAnswer> changed = change_calibration(config, change);
  if (!changed.ok() && changed.error().code == Code::config) stop(kRefused, changed.error());
  const ChangeAnswer done = need(changed);
  if (options.json) {
    report::Json json("slabd.calibration_applied/1");
    json.field("id", done.id).field("by_daemon", done.by_daemon).field("after_slab", done.after_slab);
    fmt::print("{}", json.text());
  } else {
    fmt::print("{}", say("{} is in force{}\n", done.id,
                         done.after_slab ? say(" from the next slab on; one is open now") : ""));
  }
  warn_of_standing(config, done.id);
  warn_of_tie(config, done.id);
  warn_of_one_acceptance(config);
  return kDone;
}

/// True if the session is of this line. Record ids are made from numbers, so two lines with the same commissioning
/// value have the same id; the configuration distinguishes them. A configuration that was copied or moved is the same
/// line if it has the same database.
bool is_of_line(const Session& session, const std::string& config_path, const config::Config& config) {
  const std::string& begun_with = session.settings().config;
  std::error_code fault;
  if (begun_with.empty() || std::filesystem::equivalent(begun_with, config_path, fault)) return true;
  config::Config begun;
  return std::filesystem::exists(begun_with, fault) && config_from(begun_with, begun) &&
         (begun.storage.db_path == config.storage.db_path ||
          std::filesystem::equivalent(begun.storage.db_path, config.storage.db_path, fault));
}

/// Largest accepted difference between the clocks of two machines.
constexpr std::int64_t kClockSlack_us = std::int64_t{10} * 60 * 1'000'000;

/// Stores the session's solution as a record with all its inputs, and puts it in force.
int apply_session(const SessionOptions& which, RecordOptions record_options, bool yes, bool json_wanted) {
  set_language(which.language, json_wanted);
  Session session = find_session(which);
  need(session.lock());
  need_solution(session);
  const Session::Solution& solution = *session.solution();
  if (!solution.verified || solution.verified->inputs != session.inputs(calib::ViewUse::held_out))
    stop(kRefused, say("{} is not verified{}; next: slabctl calibrate verify", solution.record.id,
                       solution.verified ? say(" with the views that are held out now") : ""));
  record_options.config = !which.config.empty()                ? which.config
                          : !session.settings().config.empty() ? session.settings().config
                                                               : default_config();
  config::Config config;
  if (!config_from(record_options.config, config))
    stop(kBadInput, say("applying needs the daemon's configuration: slabctl calibrate apply --config FILE"));
  ScannerChoice scanner = record_options.scanner;
  if (const std::string& of_session = session.settings().scanner; !of_session.empty()) {
    if (!scanner.id.empty() && scanner.id != of_session)
      stop(kUsage,
           say("--scanner {}: {} is a calibration of scanner {}", scanner.id, session_words(session), of_session));
    scanner.id = of_session;
  }
  config = scanner.of(std::move(config));
  if (!yes && !is_of_line(session, record_options.config, config))
    stop(kRefused, say("{} was begun with {}: its views are of that line's robot and scanner, and {} is "
                       "another line; if it is the same one, say --yes",
                       session_words(session), session.settings().config, record_options.config));
  finish_killed_change(config);
  const InForce now = hand_eye_in_force(config);
  storage::CalibrationRecord same;
  same.numbers = solution.record.numbers;
  same.scanner = config.by.scanner.view();
  // The id of the same numbers with another expiry has an added number behind a dot.
  if (now.id.view().substr(0, now.id.view().find('.')) != storage::calibration_id(same) &&
      now.id.view() != solution.verified->before_id)
    stop(kRefused, say("{} is in force now, and it was verified against {}; next: slabctl calibrate verify --config {}",
                       now.id.empty() ? say("nothing") : std::string(now.id.view()),
                       solution.verified->before_id.empty() ? say("nothing") : solution.verified->before_id,
                       record_options.config));
  storage::CalibrationRecord record;
  if (record_options.operator_name.empty()) record_options.operator_name = session.settings().operator_name;
  record_options.describe(config, record, session.oldest_utime_us());
  // A view time in the future would make the calibration look new at every application.
  if (session.oldest_utime_us() > record.created_utime_us + kClockSlack_us)
    stop(kRefused,
         say("the oldest view was captured at {}, a time to come: the age of this calibration is unknown; "
             "if the clock is behind, set it; if it was ahead when the views were captured, capture them again",
             report::iso_time(session.oldest_utime_us())));
  record.numbers = solution.record.numbers;
  record.observations = observations_text(session);
  record.certificate = session.certificate_text();
  const Result<std::string> figures = text_file(solution.folder + "/figures.json");
  if (!figures.ok() || calib::sha256_hex(figures.value()) != solution.record.figures)
    stop(kBadInput, say("{}/figures.json is missing or was changed: remove that folder, then slabctl calibrate solve",
                        solution.folder));
  record.figures = figures.value();
  record_options.apply = true;
  if (record_options.why.empty()) record_options.why = "calibrated in session " + session.settings().name;
  const Kept kept = keep_record(config, record_options, record);
  if (kept.status != kDone) return kept.status;
  if (json_wanted) {
    report::Json json("slabd.calibration_applied/1");
    json.field("id", kept.id);
    write_session(json, session);
    json.field("after_slab", kept.after_slab).field("replaced", now.id);
    fmt::print("{}", json.text());
  } else {
    const std::string where =
        record_options.config == default_config() ? "" : fmt::format(" --config {}", record_options.config);
    fmt::print("{}", say("{}\n{}slabctl calibrate history{} shows it{}\n", session_words(session),
                         kept_text(kept, false), where,
                         now.applied && now.id.view() != kept.id
                             ? say("; slabctl calibrate rollback --reason \"...\" puts {} back", now.id.view())
                             : ""));
  }
  return kDone;
}

int show_history(const Options& options) {
  set_language(options.language, options.json);
  const config::Config config = config_from(options.config);
  const std::unique_ptr<storage::Reader> reader = open_records(config);
  std::vector<storage::AppliedChange> applied;
  std::vector<storage::CalibrationRecord> records;
  if (reader != nullptr) {
    // The limit counts the changes that are shown: those of one scanner are selected first.
    constexpr std::size_t kLookBack = 100'000;
    applied = need(reader->applied(options.scanner.id.empty() ? options.limit : kLookBack), kNotReachable);
    records = need(reader->calibrations(), kNotReachable);
  }
  if (!options.scanner.id.empty()) {
    // A tie is of both scanners.
    const std::string scanner(options.scanner.of(config).by.scanner.view());
    std::erase_if(applied, [&](const storage::AppliedChange& c) {
      return c.kind != CalibrationKind::tie && c.scanner != scanner;
    });
    applied.resize(std::min(applied.size(), options.limit));
    std::erase_if(records, [&](const storage::CalibrationRecord& r) {
      return r.kind() != CalibrationKind::tie && r.scanner != scanner;
    });
  }
  if (options.json) {
    report::Json json("slabd.calibration_history/1");
    json.list("applied", applied, [&](const storage::AppliedChange& c) {
      json.field("seq", c.seq).field("kind", c.kind).field("slab_type", c.slab_type);
      json.field("action", c.is_rollback ? "rollback" : "apply").field("id", c.calibration_id);
      json.field("scanner", c.scanner).field("replaced", c.replaced_id).field("who", c.note.who);
      json.field("why", c.note.why);
      report::write_time(json, "time", c.note.utime_us);
    });
    json.key("records").begin_array();
    for (const storage::CalibrationRecord& r : records) {
      json.begin_object().field("id", r.id).field("kind", r.kind()).field("slab_type", r.slab_type());
      json.field("scanner", r.scanner).field("parent", r.parent_id).field("operator", r.operator_name);
      json.field("robot_serial", r.robot_serial);
      json.field("scanner_serial", r.scanner_serial).field("temperature_c", r.temperature_c);
      json.field("software", r.software);
      report::write_time(json, "created", r.created_utime_us);
      report::write_time(json, "expires", r.expires_utime_us);
      json.end_object();
    }
    fmt::print("{}", json.text());
    return kDone;
  }
  const auto of_scanner = [&](CalibrationKind kind, const std::string& scanner) {
    const bool shown = config.arms.several() && kind != CalibrationKind::tie;
    return shown ? ", " + say("scanner {}", scanner) : std::string();
  };
  report::Table changes{say("when<"), say("what<"), say("now in force<"), say("before<"), say("who<"), say("why<")};
  for (const storage::AppliedChange& c : applied)
    changes.add(report::iso_time(c.note.utime_us),
                fmt::format("{} {}{}{}", c.is_rollback ? say("rollback") : say("apply"), translated(name(c.kind)),
                            c.slab_type == 0 ? "" : fmt::format(" {}", c.slab_type), of_scanner(c.kind, c.scanner)),
                c.calibration_id, c.replaced_id.empty() ? "-" : c.replaced_id, c.note.who, retold(c.note.why));
  report::Table kept{say("\nkept<"),   say("kind<"),  say("created<"), say("expires<"),
                     say("operator<"), say("robot<"), say("scanner<"), say("holds for<")};
  for (const storage::CalibrationRecord& r : records)
    kept.add(r.id, std::string(translated(name(r.kind()))) + of_scanner(r.kind(), r.scanner),
             report::iso_time(r.created_utime_us),
             r.expires_utime_us == 0 ? say("never") : report::iso_time(r.expires_utime_us), r.operator_name,
             r.robot_serial, r.scanner_serial, r.parent_id);
  fmt::print("{}{}", changes.rows.empty() ? say("no calibration was ever put in force\n") : report::text_of(changes),
             kept.rows.empty() ? "" : report::text_of(kept));
  return kDone;
}

/// Requires a confirmation if replacing the calibration in force by `after` (named `source`) is not a small change.
void confirm_replacing(const config::Config& config, const Pose& after, std::string_view source, bool yes) {
  finish_killed_change(config);
  const InForce now = hand_eye_in_force(config);
  if (!now.applied) return;
  const Pose& before = now.T_flange_scanner;
  SeatShifts seats;
  if (const std::optional<Stop> unknown = find_seat_shifts(config, 0, before, after, seats)) {
    if (!yes) throw *unknown;
    return complain(unknown->sentence);  // --yes was given
  }
  const double turn_deg = deg_from_rad(angle_between_rad(before.rotation, after.rotation));
  const std::string change =
      say("{} is in force; with {} seats of {} move by up to {:.3f} mm, the scanner turns by {:.3f} deg", now.id.view(),
          source, seats.slab, seats.shift_max_mm, turn_deg);
  if (yes || is_small_change(seats.shift_max_mm, turn_deg)) return complain(change);
  stop(kRefused,
       say("{}: above {} mm or {} deg that needs a word of yours, --yes", change, kConfirmAbove_mm, kConfirmAbove_deg));
}

/// The same for a stored hand-eye calibration that is named. Does nothing for other records; the change itself rejects
/// a name that does not exist.
void confirm_applying(const Options& options, bool yes) {
  config::Config config = config_from(options.config);
  const std::unique_ptr<storage::Reader> reader = open_records(config);
  if (reader == nullptr) return;
  const auto kept = need(reader->calibrations());
  const storage::CalibrationRecord* named = nullptr;
  for (const storage::CalibrationRecord& record : kept) {
    if (record.id.compare(0, options.id.size(), options.id) != 0) continue;
    if (record.id == options.id || named == nullptr) named = &record;
    if (record.id == options.id) break;
  }
  const auto* numbers = named == nullptr ? nullptr : std::get_if<HandEyeNumbers>(&named->numbers);
  if (numbers != nullptr)
    confirm_replacing(ScannerChoice{named->scanner}.of(std::move(config)), numbers->T_flange_scanner, named->id, yes);
}

/// Stores the commissioning values as a record, with an uncertainty that the operator states.
int adopt(RecordOptions options, double sigma_mm, double sigma_deg, bool yes) {
  const config::Config config = options.scanner.of(config_from(options.config));
  if (config.calibration.id.empty())
    stop(kBadInput, say("{}: [calibration] T_flange_scanner is missing, there is nothing to adopt", options.config));
  if (options.apply)
    confirm_replacing(config, config.calibration.T_flange_scanner, say("the configuration's value"), yes);
  if (options.why.empty()) options.why = "adopted from " + options.config;
  storage::CalibrationRecord record;
  options.describe(config, record);
  record.numbers = HandEyeNumbers{config.calibration.T_flange_scanner, sigma_mm, rad_from_deg(sigma_deg)};
  record.observations = fmt::format("# adopted from {} ({})\n", options.config, config.calibration.id.view());
  if (options.dry_run) {
    fmt::print("{}", kept_text({}, true));
    return kDone;
  }
  const Kept kept = keep_record(config, options, record);
  if (kept.status == kDone) fmt::print("{}", kept_text(kept, false));
  return kept.status;
}

void add_common(args::Command& command, Options& options) {
  command.add_option("--config", options.config, "The daemon's configuration")->default_val(default_config());
  options.language.add_to(command, "Language of the text");
  command.add_flag("--json", options.json, "JSON on stdout");
}
void add_note(args::Command& command, Options& options) {
  command.add_option("--reason", options.why, "Why, for the history")->required()->check(some_words());
  command.add_option("--operator", options.who, "Name of the operator (default: your login)");
}

}  // namespace

void add_calibrate_apply(args::Command& group) {
  struct Apply {
    Options known;
    SessionOptions session;
    RecordOptions record;
    bool yes = false;
  };
  auto options = std::make_shared<Apply>();
  args::Command command = group.add_subcommand("apply", "Put the session's calibration, or a kept one, in force");
  command->footer(
      "\nWithout ID: the session's, once it is solved and verified, stored with its views, figures and certificate.\n"
      "From the next slab on. Atomic: killed at any moment, either the old one is in force or the new one. Giving it "
      "again changes nothing.\n"
      "How long it may be used counts from the oldest of its views.\n"
      "Exit status 6: refused, the text contains the cure.\n"
      "Examples: slabctl calibrate apply --robot-serial KR120-4711 --scanner-serial S-0815 --temperature 21.5\n"
      "          slabctl calibrate apply he-3f2a91c07b5e --reason \"scanner exchanged\"");
  command->add_option("ID", options->known.id, "Id of a kept record, or its first characters");
  options->session.add_to(*command);
  options->known.scanner.add_to(*command);
  options->record.add_origin_to(*command);
  command->add_option("--reason", options->record.why, "Why, for the history; must be given with ID")
      ->check(some_words());
  command->add_flag(
      "--yes", options->yes,
      "Also where --config is not what the session was begun with, or a kept one moves seats or turns the scanner");
  command->add_flag("--json", options->known.json, "Print slabd.calibration_applied/1 on stdout");
  command->runs([options] {
    Options& known = options->known;
    options->record.scanner = known.scanner;
    if (known.id.empty()) return apply_session(options->session, options->record, options->yes, known.json);
    known.language = options->session.language;
    set_language(known.language, known.json);
    known.config = options->session.config.empty() ? default_config() : options->session.config;
    known.who = options->record.operator_name;
    known.why = options->record.why;
    if (known.why.empty()) stop(kUsage, say("say why, for the history: --reason \"...\""));
    const RecordOptions& given = options->record;
    if (!given.robot_serial.empty() || !given.scanner_serial.empty() || has_value(given.temperature_c) ||
        given.valid_days >= 0)
      stop(kUsage, say("a kept record says what it says: no --robot-serial, --scanner-serial, --temperature or "
                       "--valid-days with "
                       "ID"));
    confirm_applying(known, options->yes);
    return carry_out(known, storage::ApplyCalibration{known.id, note_of(known), known.scanner.id});
  });
}

void add_calibrate_adopt(args::Command& group) {
  struct Adopt {
    RecordOptions record;
    double sigma_mm = kNoValue;
    double sigma_deg = kNoValue;
    bool yes = false;
    LanguageOption language;
  };
  auto options = std::make_shared<Adopt>();
  args::Command command = group.add_subcommand(
      "adopt", "Keep the configuration's T_flange_scanner as a calibration, with an uncertainty you answer for");
  command->footer(
      "\nFor a scanner whose seat was measured otherwise, such as by a laser tracker: the values then have a record, "
      "an\n"
      "expiry and a history, and station corrections can be solved with them. Where another calibration is in force, "
      "what\n"
      "--apply changes at the seats is shown; above 0.2 mm or 0.01 deg it needs --yes.\n"
      "Example: slabctl calibrate adopt --sigma-mm 0.05 --sigma-deg 0.003 --apply --reason \"tracker protocol 17\"");
  options->record.add_to(*command);
  command
      ->add_option("--sigma-mm", options->sigma_mm, "Standard deviation of a point in the field of view, per axis, mm")
      ->required()
      ->check(within(1e-4, 10.0));
  command->add_option("--sigma-deg", options->sigma_deg, "Standard deviation of the scanner's rotation, per axis, deg")
      ->required()
      ->check(within(1e-6, 1.0));
  command->add_flag("--yes", options->yes, "With --apply: what it changes is looked at and wanted");
  options->language.add_to(*command, "Language of the text");
  command->runs([options] {
    set_language(options->language);
    return adopt(options->record, options->sigma_mm, options->sigma_deg, options->yes);
  });
}

void add_calibrate_rollback(args::Command& group) {
  auto options = std::make_shared<Options>();
  args::Command command = group.add_subcommand("rollback", "Put back what was in force before; again: further back");
  command->footer(
      "\nStation corrections hold for one hand-eye calibration: roll that back first.\n"
      "Example: slabctl calibrate rollback --reason \"worse than before\"");
  command->add_option("--kind", options->kind, "Kind of calibration to roll back")
      ->check(args::one_of({"hand_eye", "stations", "reference_block", "monitor_ball", "scanner", "tie"}))
      ->capture_default_str();
  command->add_option("--slab-type", options->slab_type,
                      "SLAB_TYPE of station corrections (default: that of the newest change)");
  options->scanner.add_to(*command);
  add_common(*command, *options);
  add_note(*command, *options);
  command->runs([options] {
    set_language(options->language, options->json);
    const CalibrationKind kind = *calibration_kind_named(options->kind);
    // A tie is of both scanners.
    const config::Config config = config_from(options->config);
    const std::string scanner = kind == CalibrationKind::tie
                                    ? storage::RollBackCalibration{}.scanner
                                    : std::string(options->scanner.of(config).by.scanner.view());
    return carry_out(*options, storage::RollBackCalibration{kind, options->slab_type, note_of(*options), scanner});
  });
}

void add_calibrate_history(args::Command& group) {
  auto options = std::make_shared<Options>();
  args::Command command =
      group.add_subcommand("history", "Calibrations in force over time, with operator and reason; every kept record");
  command->add_option("--limit", options->limit, "How many changes, newest first")
      ->check(args::range(std::size_t{1}, std::size_t{100'000}))
      ->capture_default_str();
  options->scanner.add_to(*command);
  add_common(*command, *options);
  command->runs([options] { return show_history(*options); });
}

std::optional<Stop> find_seat_shifts(const config::Config& config, std::uint16_t slab_type, const Pose& before,
                                     const Pose& after, SeatShifts& out) {
  std::vector<Recipe> recipes;
  std::vector<config::Problem> problems;
  config::load_recipes(config.recipes_dir, recipes, problems);
  const auto recipe = std::find_if(recipes.begin(), recipes.end(),
                                   [&](const Recipe& r) { return slab_type == 0 || r.slab_type == slab_type; });
  if (recipe == recipes.end())
    return Stop{kBadInput, say("no recipe{} in {}: the change at the slab is unknown",
                               slab_type == 0 ? "" : say(" of slab type {}", slab_type), config.recipes_dir)};
  const auto reader = records_if_readable(config);
  if (!reader.ok()) return Stop{kNotReachable, retold(reader.error().text.view())};
  std::unique_ptr<LineCalibration> line;
  if (reader.value() != nullptr) {
    auto read = reader.value()->line_calibration(config.by.scanner.view());
    if (!read.ok()) return Stop{exit_for(read.error().code), retold(read.error().text.view())};
    line = std::move(read.value());
  }
  const StationsInForce* table = line == nullptr ? nullptr : line->table_for(recipe->slab_type);
  // The poses of a table are in the base of the scanner's own robot, the slab is in the base frame of the line.
  const std::optional<Pose> tied = find_T_robot_slab(reader.value().get(), config);
  if (!tied) table = nullptr;
  const Pose T_robot_slab = tied.value_or(config.T_base_slab);
  out.slab = say("slab type {}", recipe->slab_type);
  out.shift_max_mm = 0.0;
  for (int station = 1; station <= recipe->stations(); ++station) {
    const Pose T_base_block = T_robot_slab * T_slab_block(*recipe, station);
    StationShift s;
    s.station = station;
    Pose T_base_flange = T_base_block * nominal_T_block_scanner() * before.inverse();
    if (table != nullptr) {
      const StationCorrection& mastered = table->table.station[static_cast<std::size_t>(station - 1)];
      s.taught = mastered.visits > 0;
      if (s.taught) T_base_flange = mastered.T_base_flange;
    }
    const Vec3 seen = (T_base_flange * before).inverse() * T_base_block.translation_mm;
    s.shift_mm = T_robot_slab.rotation.conjugate() * Vec3(T_base_flange * (after * seen) - T_base_block.translation_mm);
    out.shift_max_mm = std::max(out.shift_max_mm, s.shift_mm.norm());
    out.stations.push_back(s);
  }
  return std::nullopt;
}

}  // namespace slabd::cli
