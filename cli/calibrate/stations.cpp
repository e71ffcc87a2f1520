// SPDX-License-Identifier: Apache-2.0
//
// slabctl calibrate stations: computes corrections of the robot from a mastered slab that the line has inspected
// several times, or from reference balls at the stations. The visits are the stored results of normal inspections, so
// mastering needs no mode of its own: inspect the slab five times, then solve.
#include <fmt/core.h>
#include <algorithm>
#include <array>
#include <functional>
#include <limits>
#include <map>
#include <memory>
#include <optional>
#include <vector>

#include "cli/calibrate/calibrate.h"
#include "cli/client/calibration_change.h"
#include "cli/client/record_options.h"
#include "cli/command.h"
#include "cli/exit.h"
#include "cli/slab_choice.h"
#include "cli/terminal/arguments.h"
#include "cli/terminal/parse.h"
#include "cli/terminal/render.h"
#include "cli/terminal/say.h"
#include "report/json.h"
#include "report/slab_view.h"

namespace slabd::cli {
namespace {

struct Options {
  RecordOptions record;
  std::string certificate;
  std::vector<std::string> slabs;
  std::vector<std::string> visits;
  bool again = false;
  std::uint16_t slab_type = 0;
  calib::StationSettings settings;
  LanguageOption language;
  bool json = false;
};

/// Inputs of a solution.
struct Work {
  calib::MasterCertificate certificate;
  std::string certificate_text;
  std::vector<calib::StationVisit> visits;
  storage::CalibrationRecord hand_eye;
  std::int64_t oldest_utime_us = std::numeric_limits<std::int64_t>::max();  ///< of the visits, if known
  std::int64_t end_utime_us = 0;    ///< expiry of the record that is solved again; 0: never
  double temperature_c = kNoValue;  ///< during the visits
  /// With several robots: places of the visits of all of them, base frame, for the placement of the mastered slab.
  std::vector<calib::StationVisit> of_all;
  std::vector<Pose> T_base_scanner_of_all;
  std::array<bool, limits::kArmsMax> seen_by{};  ///< robots with at least one of these visits
};

bool is_usable(const TieInForce& tie) {
  return !tie.id.empty() && tie.trouble.empty();
}

/// Adds the visits of the scanner `config.by` in one inspection of the mastered slab.
void add_slab(const config::Config& config, storage::Reader& reader, const std::string& name, Work& work) {
  const storage::SlabRecord slab = named_slab(reader, name);
  const SlabHeader& header = slab.summary.header;
  if (header.slab_type != work.certificate.slab_type)
    stop(kBadInput, say("--slabs {}: it is of slab type {}, the certificate is of {}", name, header.slab_type,
                        work.certificate.slab_type));
  const std::string round = fmt::format("slab {}", header.key);
  TieInForce tie;
  if (config.arms.several()) tie = need(reader.cell_calibration(config.arms))->tie;
  for (const calib::MasterStation& s : work.certificate.stations) {
    const storage::SlabBlock* valid = report::latest(slab, s.station);
    if (valid == nullptr || valid->phase != StationPhase::measured) continue;
    const Attempt& attempt = valid->attempt;
    auto visit = calib::seat_visit(valid->block, attempt.T_base_flange, round);
    if (!visit) continue;
    if (config.arms.several()) {
      // Without the corrections that were in force, because they are what is solved.
      const Pose T_robot_scanner = attempt.T_base_flange * T_flange_scanner_of(header, attempt.arm);
      work.of_all.push_back(*visit);
      // By the tie in force, which the corrections will be used with; without one, by that of the inspection.
      const Pose& T_base_robot = is_usable(tie) ? tie.numbers.T_base_robot : attempt.splice.T_base_robot;
      work.seen_by.at(attempt.arm) = true;
      work.T_base_scanner_of_all.push_back(attempt.splice.tied ? T_base_robot * T_robot_scanner : T_robot_scanner);
      if (attempt.by.scanner != config.by.scanner) continue;
    }
    visit->hand_eye_id =
        attempt.arm == 0 ? header.calibration_id.view() : header.more_arms[attempt.arm - 1U].calibration_id.view();
    work.oldest_utime_us = std::min(work.oldest_utime_us, valid->attempt.scan_utime_us);
    work.visits.push_back(std::move(*visit));
  }
}

void add_file(const std::string& path, Work& work) {
  const std::string text = need(text_file(path));
  std::vector<calib::StationVisit> visits = need(calib::parse_visits(text, path));
  for (calib::StationVisit& visit : visits) work.visits.push_back(std::move(visit));
}

void read_certificate(const std::string& text, const std::string& name, Work& work) {
  work.certificate = need(calib::parse_master_certificate(text, name));
  work.certificate_text = text;
}

/// Requires a hand-eye calibration in force, because corrections are relative to it.
void find_hand_eye(const config::Config& config, storage::Reader* reader, Work& work) {
  if (reader != nullptr) {
    auto current = need(reader->current(CalibrationKind::hand_eye, 0, config.by.scanner.view()));
    if (current) {
      work.hand_eye = std::move(*current);
      return;
    }
  }
  stop(kRefused,
       say("no hand-eye calibration is in force, and station corrections hold for one only: calibrate, then slabctl "
           "calibrate apply"));
}

/// Solves the table in force again with the current hand-eye calibration.
void take_again(const Options& options, const config::Config& config, storage::Reader* reader, Work& work) {
  std::uint16_t slab_type = options.slab_type;
  std::optional<storage::CalibrationRecord> record;
  if (reader != nullptr) {
    if (slab_type == 0) {
      const auto line = need(reader->line_calibration(config.by.scanner.view()));
      if (line->tables.size() > 1)
        stop(kUsage, say("--again: several slab types have corrections; say which with --slab-type"));
      if (!line->tables.empty()) slab_type = line->tables[0].table.slab_type;
    }
    record = need(reader->current(CalibrationKind::stations, slab_type, config.by.scanner.view()));
  }
  if (!record)
    stop(kBadInput,
         say("--again: no station corrections are in force; master the stations first (--certificate and --slabs)"));
  read_certificate(record->certificate, say("{}, certificate", record->id), work);
  work.visits = need(calib::parse_visits(record->observations, say("{}, visits", record->id)));
  work.end_utime_us = record->expires_utime_us;
  work.temperature_c = record->temperature_c;
  // Visits from files may lack the calibration they were taken with; it is that of the first solution.
  for (calib::StationVisit& visit : work.visits)
    if (visit.hand_eye_id.empty()) visit.hand_eye_id = record->parent_id;
}

/// Reads the hand-eye calibrations of the visits that are not in force.
void find_earlier_hand_eyes(storage::Reader& reader, Work& work) {
  std::map<std::string, HandEyeNumbers> known;
  for (calib::StationVisit& visit : work.visits) {
    if (visit.hand_eye_id.empty() || visit.hand_eye_id == work.hand_eye.id) continue;
    auto earlier = known.find(visit.hand_eye_id);
    if (earlier == known.end()) {
      const auto record = need(reader.calibration(visit.hand_eye_id));
      const auto* numbers = record ? std::get_if<HandEyeNumbers>(&record->numbers) : nullptr;
      if (numbers == nullptr)
        stop(kRefused,
             say("{}: it was inspected with {}, of which the database has no record, in force is {}: whether "
                 "the scanner sits where it sat cannot be seen; have the line inspect the mastered slab again",
                 visit.round, visit.hand_eye_id, work.hand_eye.id));
      earlier = known.emplace(visit.hand_eye_id, *numbers).first;
    }
    visit.hand_eye = earlier->second;
  }
}

Work gather(const Options& options, const config::Config& config, storage::Reader* reader) {
  Work work;
  find_hand_eye(config, reader, work);
  if (options.again) {
    take_again(options, config, reader, work);
  } else {
    read_certificate(need(text_file(options.certificate)), options.certificate, work);
    for (const std::string& slab : options.slabs) add_slab(config, *reader, slab, work);
    for (const std::string& path : options.visits) add_file(path, work);
  }
  find_earlier_hand_eyes(*reader, work);
  return work;
}

std::string as_json(const Work& work, const calib::StationsSolution& s, const Kept& kept) {
  report::Json json("slabd.station_calibration/1");
  json.field("status", s.ok ? "ok" : "refused").field("id", report::only_if(!kept.id.empty(), kept.id));
  json.field("applied", kept.applied).field("hand_eye_id", work.hand_eye.id).field("certificate", work.certificate.id);
  json.field("slab_type", work.certificate.slab_type).field("visits", work.visits.size());
  json.field("before_rms_mm", s.before_rms_mm).field("after_rms_mm", s.after_rms_mm);
  json.field("pooled_sigma_mm", s.pooled_sigma_mm).field("pooled_sigma_deg", deg_from_rad(s.pooled_sigma_rad));
  json.field("degrees_of_freedom", s.degrees_of_freedom).field("mount_mm", s.mount_mm);
  json.field("mount_deg", deg_from_rad(s.mount_rad));
  json.list("stations", s.stations, [&](const calib::StationSolution& one) {
    json.field("station", one.station).field("visits", one.numbers.visits).field("shift_mm", one.shift_mm);
    json.field("turn_deg", deg_from_rad(one.turn_rad)).field("spread_mm", one.numbers.spread_mm);
    json.field("spread_deg", deg_from_rad(one.spread_rad)).field("sigma_mm", one.numbers.sigma_mm);
    json.field("sigma_deg", deg_from_rad(one.numbers.sigma_rad)).field("shape_mm", one.shape_mm);
    json.field("worst_round", one.worst_round).field("worst_mm", one.worst_mm);
  });
  json.list("reasons", s.reasons, [&](const calib::StationReason& reason) {
    json.field("code", reason.code).field("station", reason.station).field("text", reason.text);
    json.field("cure", reason.cure);
  });
  return json.text();
}

std::string solution_text(const Work& work, const calib::StationsSolution& s) {
  std::string text = say("certificate {} of slab type {}, {} visits, hand-eye {}\n\n", work.certificate.id,
                         work.certificate.slab_type, work.visits.size(), work.hand_eye.id);
  if (!s.stations.empty()) {
    report::Table table{say("station"),     say("visits"),      say("moves seat by (mm)"),
                        say("turns (deg)"), say("spread (mm)"), say("sigma of a visit (mm, deg)")};
    for (const calib::StationSolution& one : s.stations)
      table.add(one.station, one.numbers.visits,
                fmt::format("{:+.3f} {:+.3f} {:+.3f}", one.shift_mm.x(), one.shift_mm.y(), one.shift_mm.z()),
                report::Cell(deg_from_rad(one.turn_rad), 4), report::Cell(one.numbers.spread_mm, 4),
                fmt::format("{:.4f} {:.5f}", one.numbers.sigma_mm, deg_from_rad(one.numbers.sigma_rad)));
    text += fmt::format("{}\n", report::text_of(table));
  }
  if (has_value(s.after_rms_mm))
    text +=
        say("seats against the certificate, rms in space: {:.3f} mm by hand-eye alone, {:.3f} mm corrected\n"
            "one visit repeats to {:.4f} mm and {:.5f} deg per axis (k = 1, {} degrees of freedom)\n",
            s.before_rms_mm, s.after_rms_mm, s.pooled_sigma_mm, deg_from_rad(s.pooled_sigma_rad), s.degrees_of_freedom);
  if (s.mount_mm > 0.0 || s.mount_rad > 0.0)
    text +=
        say("the hand-eye calibration of the visits and {} put a seat {:.3f} mm and {:.4f} deg apart, at most; as the "
            "scanner may have moved by that, it is in the sigma of a visit\n",
            work.hand_eye.id, s.mount_mm, deg_from_rad(s.mount_rad));
  return text;
}

/// Rejects another temperature for visits that are solved again.
void need_their_temperature(const Options& options, const Work& work) {
  const double given_c = options.record.temperature_c;
  if (!options.again || !has_value(given_c) || !has_value(work.temperature_c) || given_c == work.temperature_c) return;
  stop(kUsage, say("--temperature {}: the visits that are solved again were made at {} deg C, as they say", given_c,
                   work.temperature_c));
}

/// Temperature at the visits; NaN if unknown.
double visits_c(const Options& options, const Work& work) {
  return has_value(options.record.temperature_c) ? options.record.temperature_c : work.temperature_c;
}

/// Moves the certified seats of a slab to where they are at the temperature of the visits, by the recipe's [thermal].
/// Returns the largest move in mm; nullopt if the temperature or the expansion is not known, or balls are certified.
std::optional<double> bring_to_visits(const Options& options, const config::Config& config, Work& work) {
  calib::MasterCertificate& certificate = work.certificate;
  const double now_c = visits_c(options, work);
  const bool is_slab = certificate.frame == calib::MasterCertificate::Frame::slab &&
                       std::ranges::all_of(certificate.stations, &calib::MasterStation::is_seat);
  if (!has_value(now_c) || !is_slab) return std::nullopt;
  std::vector<Recipe> recipes;
  std::vector<config::Problem> problems;  // of recipes that are not needed here; `recipe check` names them
  config::load_recipes(config.recipes_dir, recipes, problems);
  const auto recipe = std::ranges::find(recipes, certificate.slab_type, &Recipe::slab_type);
  if (recipe == recipes.end() || !recipe->thermal.given) return std::nullopt;
  ThermalSettings since_certification = recipe->thermal;
  since_certification.reference_c.value = certificate.temperature_c;
  const Thermal thermal = thermal_of(since_certification, now_c);
  double farthest_mm = 0.0;
  double sum_mm2 = 0.0;
  for (calib::MasterStation& station : certificate.stations) {
    const Vec3 seat_mm = station.points_mm.front();
    farthest_mm = std::max(farthest_mm, seat_mm.norm());
    sum_mm2 += seat_mm.squaredNorm();
    // The tips of the seat's directions move with its reference point.
    for (Vec3& point : station.points_mm) point += thermal.expansion * seat_mm;
  }
  const double coordinates = 3.0 * static_cast<double>(certificate.stations.size());
  certificate.sigma_mm = std::hypot(certificate.sigma_mm, thermal.u * std::sqrt(sum_mm2 / coordinates));
  return std::abs(thermal.expansion) * farthest_mm;
}

/// Warns if the slab has expanded since certification, because the corrections include the expansion as a robot error.
void warn_of_temperature(const Options& options, const Work& work) {
  constexpr double kExpansion_per_K = 1e-5;  // concrete and steel
  constexpr double kFar_K = 3.0;
  const double now_c = visits_c(options, work);
  const double off_K = now_c - work.certificate.temperature_c;
  if (has_value(now_c) && std::abs(off_K) <= kFar_K) return;
  double span_mm = 0.0;
  for (const calib::MasterStation& a : work.certificate.stations)
    for (const calib::MasterStation& b : work.certificate.stations)
      span_mm = std::max(span_mm, (a.points_mm.front() - b.points_mm.front()).norm());
  const std::string holds =
      say("certificate {} holds at {:.1f} deg C", work.certificate.id, work.certificate.temperature_c);
  if (has_value(now_c))
    complain(say(
        "warning: {}, the visits were made at {:.1f}: over the {:.0f} mm between its stations that is about {:.3f} mm, "
        "which the corrections take up",
        holds, now_c, span_mm, std::abs(off_K) * kExpansion_per_K * span_mm));
  else
    complain(say(
        "warning: {}, and --temperature does not say what it was at the visits: every K is about {:.3f} mm over the "
        "{:.0f} mm between its stations, which the corrections take up",
        holds, kExpansion_per_K * span_mm, span_mm));
}

void complain_of_reasons(const calib::StationsSolution& s) {
  for (const calib::StationReason& reason : s.reasons)
    complain(say("refused ({}): {}\n  what to do: {}", name(reason.code), quote(reason.text), quote(reason.cure)));
}

/// Leaves out the certified stations that this scanner does not scan, and those that it may scan for another one and
/// was not led to: these stay without a correction of this scanner.
void keep_own_stations(const config::Config& config, Work& work) {
  std::erase_if(work.certificate.stations, [&](const calib::MasterStation& station) {
    const ArmChoice& arms = config.arms.of_station[static_cast<std::size_t>(station.station - 1)];
    const bool is_usual = !arms.empty() && config.arms.list[arms[0]].scanner == config.by.scanner;
    return !is_usual && std::ranges::none_of(work.visits, [&](const calib::StationVisit& visit) {
      return visit.station == station.station;
    });
  });
}

/// Place of the mastered slab in the base of this scanner's robot, from the stations of all robots: those of one robot
/// may be on a line. The corrections of both robots then refer to one place. nullopt: the own stations place it.
std::optional<Pose> place_with_all_robots(const config::Config& config, storage::Reader& reader, const Work& work) {
  const std::optional<Pose> T_base_certificate =
      calib::placement_of(work.certificate, work.of_all, work.T_base_scanner_of_all);
  if (!T_base_certificate || config.by.scanner == config.arms.list[0].scanner) return T_base_certificate;
  const auto cell = need(reader.cell_calibration(config.arms));
  if (!is_usable(cell->tie))
    stop(kRefused, say("the base frames of the two robots are not tied: slabctl calibrate tie"));
  return cell->tie.numbers.T_base_robot.inverse() * *T_base_certificate;
}

int calibrate_stations(const Options& options) {
  set_language(options.language, options.json);
  const bool sources = !options.certificate.empty() && !(options.slabs.empty() && options.visits.empty());
  if (!options.again && !sources)
    stop(kUsage, say("give --certificate with --slabs or --visits, or --again to solve the visits in force once more"));
  const config::Config config = options.record.scanner.of(config_from(options.record.config));
  finish_killed_change(config);
  std::unique_ptr<storage::Reader> reader = open_records(config);
  Work work = gather(options, config, reader.get());
  need_their_temperature(options, work);
  const std::optional<double> moved_mm = bring_to_visits(options, config, work);
  calib::StationSettings settings = options.settings;
  settings.gate_mm = config.splice.gate_mm;
  settings.gate_rad = config.splice.gate_rad;
  if (config.arms.several() && !std::ranges::all_of(work.seen_by, std::identity()) &&
      work.certificate.frame == calib::MasterCertificate::Frame::slab)
    stop(kRefused, say("the corrections of two robots refer to one place of the mastered slab, which the measured "
                       "stations of both give: give the same slabs, scanned by both, again for each scanner "
                       "(--certificate and --slabs)"));
  if (config.arms.several() && !work.of_all.empty())
    settings.T_base_certificate = place_with_all_robots(config, *reader, work);
  if (config.arms.several()) keep_own_stations(config, work);
  const auto& hand_eye = std::get<HandEyeNumbers>(work.hand_eye.numbers);
  const calib::StationsSolution s = need(calib::solve_stations(work.certificate, work.visits, hand_eye, settings));
  if (!moved_mm) warn_of_temperature(options, work);
  if (moved_mm && !options.json)
    fmt::print("{}", say("certificate {} was brought from {:.1f} to {:.1f} deg C: its seats by up to {:.3f} mm\n",
                         work.certificate.id, work.certificate.temperature_c, visits_c(options, work), *moved_mm));
  Kept kept;
  if (!options.json) fmt::print("{}", solution_text(work, s));
  if (!s.ok) {
    if (options.json) fmt::print("{}", as_json(work, s, kept));
    complain_of_reasons(s);
    return kRefused;
  }
  if (!options.record.dry_run) {
    storage::CalibrationRecord record;
    options.record.describe(config, record, work.oldest_utime_us);
    // The age of visits that are solved again does not change.
    if (work.end_utime_us != 0 && (record.expires_utime_us == 0 || record.expires_utime_us > work.end_utime_us))
      record.expires_utime_us = work.end_utime_us;
    if (!has_value(record.temperature_c)) record.temperature_c = work.temperature_c;
    record.numbers = s.table;
    record.parent_id = work.hand_eye.id;
    record.certificate = work.certificate_text;
    record.observations = calib::visits_text(work.visits);
    record.figures = as_json(work, s, kept);
    reader.reset();
    kept = keep_record(config, options.record, record);
  }
  if (options.json) {
    fmt::print("{}", as_json(work, s, kept));
  } else if (kept.status == kDone) {
    fmt::print("{}", kept_text(kept, options.record.dry_run));
  }
  return kept.status;
}

}  // namespace

void add_calibrate_stations(args::Command& group) {
  auto options = std::make_shared<Options>();
  args::Command command = group.add_subcommand(
      "stations", "Correct the robot station by station from a mastered slab or reference balls, five visits each");
  command->footer(
      "\nLay the mastered slab into the cell and have the line inspect it five times without touching it; then give "
      "the\n"
      "five slabs here. What is left after the correction is the robot's repeatability: sigma sqrt(1 + 1/visits).\n"
      "A new hand-eye calibration makes the corrections stale; --again solves the same visits with it, if the scanner "
      "has not\nmoved on the flange since: what a visit saw it saw from where the scanner sat. With two robots, give "
      "the slabs\nagain for each scanner instead.\n"
      "Certificate and visits as text: docs/MASTERING.md.\n\n"
      "Exit status 6: refused, nothing is kept; every reason contains its cure.\n"
      "Example: slabctl calibrate stations --certificate master.txt --slabs 12 13 14 15 16 --apply --reason \"new "
      "robot\"");
  options->record.add_to(*command);
  command->add_option("--certificate", options->certificate, "Certificate of the mastered slab or of the balls");
  command->add_option("--slabs", options->slabs, "Inspections of the mastered slab: keys or slab ids")
      ->delimiter(',')
      ->expected(1, 1000);
  command->add_option("--visits", options->visits, "Files with visits, instead of or beside slabs")->expected(1, 1000);
  command->add_flag("--again", options->again, "Solve the visits in force with the hand-eye calibration in force now");
  command->add_option("--slab-type", options->slab_type, "With --again, when several types have corrections");
  command
      ->add_option("--spread-limit", options->settings.spread_max_mm,
                   "A station's visits may scatter by this, mm per axis")
      ->check(within(0.001, 5.0))
      ->capture_default_str();
  command->add_option("--shift-limit", options->settings.shift_max_mm, "A correction may move a seat by this, mm")
      ->check(within(0.1, 100.0))
      ->capture_default_str();
  options->language.add_to(*command, "Language of the text");
  command->add_flag("--json", options->json, "Print slabd.station_calibration/1 on stdout");
  command->runs([options] { return calibrate_stations(*options); });
}

}  // namespace slabd::cli
