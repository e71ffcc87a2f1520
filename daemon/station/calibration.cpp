// SPDX-License-Identifier: Apache-2.0
//
// Selects the calibration in force. A slab is measured from its first to its last scan with the calibration of its
// begin, also over a restart. Seats spliced with two calibrations would be in two frames. So a change is activated
// between slabs, and the open slab keeps its own copy.
//
// This code never treats a calibration as better than it is. No slab can begin if it is missing, expired or has failed
// its check. A correction that does not hold falls back to the hand-eye alone, with the robot's absolute accuracy in U.
// The scanner's acceptance can only add to U; a missing one is only a warning.
//
// With several arms this holds for each: a slab begins if one arm can be used, and the stations that only another arm
// scans are refused. An arm after the first also needs the tie of its robot's base.
#include <algorithm>
#include <cmath>
#include <limits>

#include "daemon/station/parts.h"

namespace slabd::daemon {
namespace {

/// Uses the configuration's values, if there are any, as long as no calibration was applied.
void commission(const CalibrationId& id, const Pose& T_flange_scanner, LineCalibration& calibration) {
  const bool nothing_applied =
      calibration.source == LineCalibration::Source::missing && calibration.trouble.empty() && calibration.id.empty();
  if (!nothing_applied || id.empty()) return;
  calibration.source = LineCalibration::Source::commissioning;
  calibration.id = id;
  calibration.hand_eye.T_flange_scanner = T_flange_scanner;
}

double distance_to_block_mm(const Station& s, std::size_t arm, std::uint8_t station, const Pose& T_base_flange) {
  const Pose T_base_block = s.slab.header.T_base_slab * T_slab_block(*s.slab.recipe, s.slab.facts.design, station);
  return (in_base_frame(s, arm, T_base_flange).translation_mm - T_base_block.translation_mm).norm();
}

/// True if a mirrored cloud would remain undetected. It looks like a good one, block by block. Only the robot poses and
/// target views of a solved hand-eye calibration contradict it; commissioning values and an adopted calibration
/// (`trouble`) have none. For an open slab the values of its begin count.
bool handedness_unproven(const Station& s, std::size_t arm) {
  const auto unproven = [](const LineCalibration& c) {
    return c.source == LineCalibration::Source::commissioning ||
           (c.source == LineCalibration::Source::applied && !c.trouble.empty());
  };
  return unproven(s.calibration.arm[arm]) || (s.slab.phase != SlabPhase::none && unproven(s.slab.calibration.arm[arm]));
}

void warn_of_applied(const Station& s, std::size_t arm, Actions& actions) {
  const LineCalibration& calibration = s.calibration.arm[arm];
  if (!calibration.trouble.empty())
    log(actions, LogLine::Level::warning, Code::ok, "%s%s, and mirrored scans would not be noticed",
        calibration.trouble.c_str(), arm_words(s, arm).c_str());
}

bool is_uncorrected(SpliceSource source) {
  return source == SpliceSource::not_mastered || source == SpliceSource::stale || source == SpliceSource::expired ||
         source == SpliceSource::outside_gate;
}

}  // namespace

void start_calibration(Station& s, const CellCalibration& stored, Actions& actions) {
  s.calibration = stored;
  for (std::size_t i = 0; i < arm_count(s); ++i) {
    const StationArmSettings& settings = s.settings.arm(i);
    LineCalibration& calibration = s.calibration.arm[i];
    const LineCalibration& of_store = stored.arm[i];
    commission(settings.calibration_id, settings.T_flange_scanner, calibration);
    if (of_store.source == LineCalibration::Source::applied)
      warn_of_applied(s, i, actions);
    else if (!of_store.trouble.empty())
      log(actions, LogLine::Level::error, Code::calibration_missing, "%s%s", of_store.trouble.c_str(),
          arm_words(s, i).c_str());
    if (!of_store.scanner.trouble.empty())
      log(actions, LogLine::Level::warning, Code::ok, "%s%s", of_store.scanner.trouble.c_str(),
          arm_words(s, i).c_str());
    if (calibration.source == LineCalibration::Source::commissioning)
      log(actions, LogLine::Level::warning, Code::ok,
          "%s are commissioning values%s: nothing proves that the scanner's frame is right-handed, and mirrored scans "
          "would not be noticed; apply a calibration (slabctl calibrate new)",
          calibration.id.c_str(), arm_words(s, i).c_str());
  }
}

void recover_slab_calibration(Station& s, const RecoveredLine& line, Actions& actions) {
  s.slab.calibration = line.slab_calibration;
  for (std::size_t i = 0; i < line.slab_calibration.arm.size(); ++i)
    if (const auto& trouble = line.slab_calibration.arm[i].scanner.trouble; !trouble.empty())
      log(actions, LogLine::Level::error, Code::ok, "the open slab continues with the recipe's scanner alone%s: %s",
          arm_words(s, i).c_str(), trouble.c_str());
  // The open slab began with the values in its header, whatever the present configuration.
  commission(line.slab.calibration_id, line.slab.T_flange_scanner, s.slab.calibration.arm[0]);
  for (std::size_t i = 0; i < line.slab.more_arms.size(); ++i)
    commission(line.slab.more_arms[i].calibration_id, line.slab.more_arms[i].T_flange_scanner,
               s.slab.calibration.arm[i + 1]);
}

void on_calibration_changed(Station& s, const CellCalibration& calibration) {
  s.calibration_next = calibration;
  for (std::size_t i = 0; i < arm_count(s); ++i)
    commission(s.settings.arm(i).calibration_id, s.settings.arm(i).T_flange_scanner, s.calibration_next.arm[i]);
  s.calibration_waits = true;
}

/// Corrects the newest time if a new calibration has expired by it: an expired calibration cannot be applied, so the
/// clock of that record was wrong. The database does the same, for every kind of record.
static void follow_clock(Station& s, const CellCalibration& next) {
  const auto came = [&s](bool is_new, std::int64_t expires_utime_us) {
    if (is_new && s.utime_us < expires_utime_us && s.newest_time.utime_us() >= expires_utime_us)
      s.newest_time = NewestTime(s.utime_us);
  };
  for (std::size_t i = 0; i < next.arm.size(); ++i) {
    const LineCalibration& now = s.calibration.arm[i];
    const LineCalibration& then = next.arm[i];
    came(!(then.id == now.id), then.expires_utime_us);
    came(!(then.scanner.id == now.scanner.id), then.scanner.expires_utime_us);
    for (const StationsInForce& table : then.tables) {
      const auto is_it = [&table](const StationsInForce& known) { return known.id == table.id; };
      came(std::none_of(now.tables.begin(), now.tables.end(), is_it), table.expires_utime_us);
    }
  }
  came(!(next.tie.id == s.calibration.tie.id), next.tie.expires_utime_us);
}

/// Changes of one arm, for the log.
struct ArmChange {
  bool hand_eye = false;
  bool scanner = false;
};

static void log_change(const Station& s, std::size_t arm, const ArmChange& change, Actions& actions) {
  const LineCalibration& now = s.calibration.arm[arm];
  const char* when = s.slab.phase == SlabPhase::none ? "" : " from the next slab on";
  const FixedString<64> words = arm_words(s, arm);
  if (change.hand_eye)
    log(actions, LogLine::Level::info, Code::ok, "calibration %s is in force%s%s", now.id.c_str(), when, words.c_str());
  if (change.hand_eye && now.source == LineCalibration::Source::applied) warn_of_applied(s, arm, actions);
  if (change.scanner && now.scanner.id.empty())
    log(actions, LogLine::Level::warning, Code::ok, "no scanner acceptance is in force%s%s: %s", when, words.c_str(),
        now.scanner.trouble.empty() ? "there is none any more" : now.scanner.trouble.c_str());
  else if (change.scanner)
    log(actions, LogLine::Level::info, Code::ok, "scanner acceptance %s is in force%s%s", now.scanner.id.c_str(), when,
        words.c_str());
}

static void activate_calibration(Station& s, Actions& actions) {
  std::array<ArmChange, limits::kArmsMax> changes;
  for (std::size_t i = 0; i < changes.size(); ++i) {
    const LineCalibration& next = s.calibration_next.arm[i];
    changes[i] = {!(s.calibration.arm[i].id == next.id), !(s.calibration.arm[i].scanner.id == next.scanner.id)};
  }
  const bool other_tie = !(s.calibration.tie.id == s.calibration_next.tie.id);
  follow_clock(s, s.calibration_next);
  s.calibration = s.calibration_next;
  s.calibration_waits = false;
  for (std::size_t i = 0; i < arm_count(s); ++i) log_change(s, i, changes[i], actions);
  if (other_tie && !s.calibration.tie.id.empty())
    log(actions, LogLine::Level::info, Code::ok, "tie %s of the two robots is in force%s", s.calibration.tie.id.c_str(),
        s.slab.phase == SlabPhase::none ? "" : " from the next slab on");
}

void advance_calibration(Station& s, Actions& actions) {
  // A SLAB_BEGIN on its way to the database contains the id of its calibration.
  if (s.calibration_waits && !s.command.pending) activate_calibration(s, actions);
  if (s.settings.fault != Code::ok) return;  // an earlier fault was reported already
  if (!s.recovered || s.slab.phase != SlabPhase::none) return;
  for (std::size_t i = 0; i < arm_count(s); ++i) {
    const ArmFault fault = arm_fault(s, i);
    if (fault == s.arm_fault_said[i]) continue;
    s.arm_fault_said[i] = fault;
    if (!fault.any())
      log(actions, LogLine::Level::info, Code::ok, "calibration %s is usable again%s", s.calibration.arm[i].id.c_str(),
          arm_words(s, i).c_str());
    else
      log(actions, LogLine::Level::error, Code::calibration_missing, "%s", describe(s, i, fault).c_str());
  }
}

ArmFault arm_fault(const Station& s, std::size_t arm) {
  ArmFault fault;
  fault.calibration = fault_of(s.calibration.arm[arm], expiry_utime_us(s));
  if (arm > 0) fault.tie = fault_of_tie(s.calibration, s.settings.arms.list[arm].robot, expiry_utime_us(s));
  return fault;
}

FixedString<limits::kErrorTextBytes> describe(const Station& s, std::size_t arm, const ArmFault& fault) {
  FixedString<limits::kErrorTextBytes> text;
  if (s.settings.arms.several() && arm < arm_count(s)) {
    const Arm& by = s.settings.arms.list[arm];
    text.printf("robot %s, scanner %s: ", by.robot.c_str(), by.scanner.c_str());
  }
  text.append(fault.calibration != CalibrationFault::none
                  ? slabd::describe(fault.calibration, s.calibration.arm[arm]).view()
                  : slabd::describe(fault.tie, s.calibration).view());
  return text;
}

CalibrationFault calibration_fault(const Station& s) {
  // An open slab is finished, because its calibration was valid at its begin.
  if (!s.recovered || s.slab.phase != SlabPhase::none) return CalibrationFault::none;
  for (std::size_t i = 1; i < arm_count(s); ++i)
    if (!arm_fault(s, i).any()) return CalibrationFault::none;
  return arm_fault(s, 0).calibration;
}

void put_calibrations(const Station& s, SlabHeader& slab) {
  for (std::size_t i = 0; i < arm_count(s); ++i) {
    const LineCalibration& calibration = s.calibration.arm[i];
    SlabArm arm;
    arm.by = s.settings.arms.list[i];
    if (!arm_fault(s, i).any()) {
      arm.calibration_id = calibration.id;
      if (const StationsInForce* table = usable_table(s, i, slab.slab_type)) arm.stations_id = table->id;
      arm.scanner_id = calibration.scanner.id;
      arm.T_flange_scanner = calibration.hand_eye.T_flange_scanner;
      if (i > 0) slab.tie_id = s.calibration.tie.id;
    }
    if (i > 0) {
      (void)slab.more_arms.push(arm);
      continue;
    }
    slab.calibration_id = arm.calibration_id;
    slab.stations_id = arm.stations_id;
    slab.scanner_id = arm.scanner_id;
    slab.T_flange_scanner = arm.T_flange_scanner;
  }
}

void take_calibrations(Station& s) {
  s.slab.calibration = s.calibration;
  if (s.slab.header.tie_id.empty()) s.slab.calibration.tie = {};
}

/// True if the open slab was begun with another robot or scanner as the first arm, which a restart with another
/// configuration can lead to. Its header names the later arms only, its scans all of them, and its hand-eye calibration
/// the first scanner.
static bool begun_with_another_first(const Station& s) {
  const Arm& first = s.settings.arms.list[0];
  const auto is_of_another = [&first](const StationRecord& record) {
    const bool has_scan = record.phase == StationPhase::acquired || record.phase == StationPhase::measured;
    return has_scan && record.attempt.arm == 0 && !(record.attempt.by == first);
  };
  const auto is_in_its_place = [&first](const SlabArm& later) {
    return later.by.scanner == first.scanner || later.by.robot == first.robot;
  };
  const PartId& of_scanner = s.slab.calibration.arm[0].of_scanner;
  return (!of_scanner.empty() && !(of_scanner == first.scanner)) ||
         std::any_of(s.slab.stations.begin(), s.slab.stations.end(), is_of_another) ||
         std::any_of(s.slab.header.more_arms.begin(), s.slab.header.more_arms.end(), is_in_its_place);
}

bool can_scan(const Station& s, std::size_t arm) {
  const SlabHeader& slab = s.slab.header;
  if (arm == 0) return !begun_with_another_first(s) && (!s.settings.arms.several() || !slab.calibration_id.empty());
  // After a restart the configuration may list other arms than the slab was begun with.
  if (arm > slab.more_arms.size() || arm >= arm_count(s)) return false;
  const SlabArm& of_slab = slab.more_arms[arm - 1];
  const TieInForce& tie = s.slab.calibration.tie;
  return of_slab.by == s.settings.arms.list[arm] && !of_slab.calibration_id.empty() && !tie.id.empty() &&
         tie.trouble.empty();
}

Pose in_base_frame(const Station& s, std::size_t arm, const Pose& T_robot_flange) {
  return arm == 0 ? T_robot_flange : s.slab.calibration.tie.numbers.T_base_robot * T_robot_flange;
}

const StationsInForce* usable_table(const Station& s, std::size_t arm, std::uint16_t slab_type) {
  const StationsInForce* table = s.calibration.arm[arm].table_for(slab_type);
  if (table == nullptr || !(table->hand_eye_id == s.calibration.arm[arm].id)) return nullptr;
  const bool expired = table->expires_utime_us != 0 && expiry_utime_us(s) >= table->expires_utime_us;
  return expired ? nullptr : table;
}

Splice splice_now(const Station& s, std::size_t arm, std::uint8_t station, const Pose& T_base_flange,
                  Actions& actions) {
  // Validity as at the slab's begin. Otherwise corrections that expire during the slab, or appear expired by a wrong
  // clock, would be used for some of its seats and not for others.
  const SlabHeader& slab = s.slab.header;
  const SpliceSettings& settings = s.settings.arm(arm).splice;
  const bool was_usable = arm == 0 ? !slab.stations_id.empty()
                                   : arm <= slab.more_arms.size() && !slab.more_arms[arm - 1].stations_id.empty();
  const std::int64_t when_us = was_usable ? 0 : std::numeric_limits<std::int64_t>::max();
  Splice splice = splice_for(s.slab.calibration, arm, settings, slab.slab_type, station, T_base_flange,
                             distance_to_block_mm(s, arm, station, T_base_flange), when_us);
  // Corrections that exist and are not used are logged; a line without corrections is not logged at each scan.
  if (is_uncorrected(splice.source) && !s.slab.calibration.arm[arm].tables.empty()) {
    if (splice.source == SpliceSource::outside_gate) {
      log(actions, LogLine::Level::warning, Code::ok,
          "station %u is not corrected: the robot is %.3f mm and %.4f deg from its pose when the station was mastered, "
          "allowed are %.3f mm and %.4f deg; U rests on its absolute accuracy",
          station, splice.off_mm, deg_from_rad(splice.off_rad), settings.gate_mm, deg_from_rad(settings.gate_rad));
    } else {
      log(actions, LogLine::Level::warning, Code::ok,
          "station %u is not corrected: its correction is %s; U rests on the robot's absolute accuracy", station,
          splice.source == SpliceSource::stale ? "of another hand-eye calibration or tie (slabctl calibrate stations)"
          : splice.source == SpliceSource::expired ? "expired"
                                                   : "missing");
    }
  }
  return splice;
}

void note_scanner_temperature(Station& s, std::size_t arm, double temperature_c, Actions& actions) {
  const bool was_outside = is_outside_temperature(s, arm);
  s.arms[arm].scanner_temperature_c = temperature_c;
  if (was_outside || !is_outside_temperature(s, arm)) return;
  const ScannerDriftSettings& settings = s.settings.arm(arm).scanner_drift;
  const ScannerNumbers& accepted = s.calibration.arm[arm].scanner.numbers;
  log(actions, LogLine::Level::warning, Code::ok,
      "the scanner has %.1f deg C%s, its acceptance was at %.1f deg C, allowed is a difference of %.1f K ([scanner] "
      "temperature_range_K); U contains %.0f um per m for it",
      temperature_c, arm_words(s, arm).c_str(), accepted.temperature_c, settings.range_K,
      1e6 * scanner_drift(settings, accepted, temperature_c));
}

std::uint16_t calibration_warnings(const Station& s) {
  std::uint16_t warn = 0;
  // With a fault of the start (504, or 502 without a database) calibration, acceptance and checks were not read.
  if (!s.recovered || s.settings.fault != Code::ok) return warn;
  const std::int64_t now = expiry_utime_us(s);
  for (std::size_t i = 0; i < arm_count(s); ++i) {
    const LineCalibration& calibration = s.calibration.arm[i];
    if (calibration.source == LineCalibration::Source::commissioning) warn |= kWarnCommissioningCalibration;
    if (handedness_unproven(s, i)) warn |= kWarnHandednessUnproven;
    if (overdue(calibration.block, s.settings.check_interval_us, now) ||
        overdue(calibration.ball, s.settings.check_interval_us, now))
      warn |= kWarnCheckOverdue;
    if (acceptance_state(calibration.scanner, now, is_outside_temperature(s, i)) != AcceptanceState::verified)
      warn |= kWarnScannerNotVerified;
  }
  // For the open slab, and for the last one until the next begins.
  for (const StationRecord& record : s.slab.stations)
    if (record.attempt.arm < s.slab.calibration.arm.size() && is_uncorrected(record.attempt.splice.source) &&
        !s.slab.calibration.arm[record.attempt.arm].tables.empty())
      warn |= kWarnStationsNotCorrected;
  return warn;
}

}  // namespace slabd::daemon
