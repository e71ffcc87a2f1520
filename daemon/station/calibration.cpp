// SPDX-License-Identifier: Apache-2.0
//
// Selects the calibration in force. A slab is measured from its first to its last scan with the calibration of its
// begin, also over a restart. Seats spliced with two calibrations would be in two frames. So a change is activated
// between slabs, and the open slab keeps its own copy.
//
// This code never treats a calibration as better than it is. No slab can begin if it is missing, expired or has failed
// its check. A correction that does not hold falls back to the hand-eye alone, with the robot's absolute accuracy in U.
// The scanner's acceptance can only add to U; a missing one is only a warning.
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

double distance_to_block_mm(const Station& s, std::uint8_t station, const Pose& T_base_flange) {
  const Pose T_base_block = s.slab.header.T_base_slab * T_slab_block(*s.slab.recipe, s.slab.facts.design, station);
  return (T_base_flange.translation_mm - T_base_block.translation_mm).norm();
}

/// True if a mirrored cloud would remain undetected. It looks like a good one, block by block. Only the robot poses and
/// target views of a solved hand-eye calibration contradict it; commissioning values and an adopted calibration
/// (`trouble`) have none. For an open slab the values of its begin count.
bool handedness_unproven(const Station& s) {
  const auto unproven = [](const LineCalibration& c) {
    return c.source == LineCalibration::Source::commissioning ||
           (c.source == LineCalibration::Source::applied && !c.trouble.empty());
  };
  return unproven(s.calibration) || (s.slab.phase != SlabPhase::none && unproven(s.slab.calibration));
}

void warn_of_applied(const LineCalibration& calibration, Actions& actions) {
  if (!calibration.trouble.empty())
    log(actions, LogLine::Level::warning, Code::ok, "%s, and mirrored scans would not be noticed",
        calibration.trouble.c_str());
}

bool is_uncorrected(SpliceSource source) {
  return source == SpliceSource::not_mastered || source == SpliceSource::stale || source == SpliceSource::expired ||
         source == SpliceSource::outside_gate;
}

}  // namespace

void start_calibration(Station& s, const LineCalibration& stored, Actions& actions) {
  s.calibration = stored;
  commission(s.settings.calibration_id, s.settings.T_flange_scanner, s.calibration);
  if (stored.source == LineCalibration::Source::applied)
    warn_of_applied(stored, actions);
  else if (!stored.trouble.empty())
    log(actions, LogLine::Level::error, Code::calibration_missing, "%s", stored.trouble.c_str());
  if (!stored.scanner.trouble.empty())
    log(actions, LogLine::Level::warning, Code::ok, "%s", stored.scanner.trouble.c_str());
  if (s.calibration.source == LineCalibration::Source::commissioning)
    log(actions, LogLine::Level::warning, Code::ok,
        "%s are commissioning values: nothing proves that the scanner's frame is right-handed, and mirrored scans "
        "would not be noticed; apply a calibration (slabctl calibrate new)",
        s.calibration.id.c_str());
}

void recover_slab_calibration(Station& s, const RecoveredLine& line, Actions& actions) {
  s.slab.calibration = line.slab_calibration;
  if (!line.slab_calibration.scanner.trouble.empty())
    log(actions, LogLine::Level::error, Code::ok, "the open slab continues with the recipe's scanner alone: %s",
        line.slab_calibration.scanner.trouble.c_str());
  // The open slab began with the values in its header, whatever the present configuration.
  commission(line.slab.calibration_id, line.slab.T_flange_scanner, s.slab.calibration);
}

void on_calibration_changed(Station& s, const LineCalibration& calibration) {
  s.calibration_next = calibration;
  commission(s.settings.calibration_id, s.settings.T_flange_scanner, s.calibration_next);
  s.calibration_waits = true;
}

/// Corrects the newest time if a new calibration has expired by it: an expired calibration cannot be applied, so the
/// clock of that record was wrong. The database does the same, for every kind of record.
static void follow_clock(Station& s, const LineCalibration& next) {
  const auto came = [&s](bool is_new, std::int64_t expires_utime_us) {
    if (is_new && s.utime_us < expires_utime_us && s.newest_time.utime_us() >= expires_utime_us)
      s.newest_time = NewestTime(s.utime_us);
  };
  came(!(next.id == s.calibration.id), next.expires_utime_us);
  came(!(next.scanner.id == s.calibration.scanner.id), next.scanner.expires_utime_us);
  for (const StationsInForce& table : next.tables) {
    const auto is_it = [&table](const StationsInForce& known) { return known.id == table.id; };
    came(std::none_of(s.calibration.tables.begin(), s.calibration.tables.end(), is_it), table.expires_utime_us);
  }
}

void advance_calibration(Station& s, Actions& actions) {
  // A SLAB_BEGIN on its way to the database contains the id of its calibration.
  if (s.calibration_waits && !s.command.pending) {
    const bool other = !(s.calibration.id == s.calibration_next.id);
    const bool other_scanner = !(s.calibration.scanner.id == s.calibration_next.scanner.id);
    follow_clock(s, s.calibration_next);
    s.calibration = s.calibration_next;
    s.calibration_waits = false;
    const char* when = s.slab.phase == SlabPhase::none ? "" : " from the next slab on";
    if (other)
      log(actions, LogLine::Level::info, Code::ok, "calibration %s is in force%s", s.calibration.id.c_str(), when);
    if (other && s.calibration.source == LineCalibration::Source::applied) warn_of_applied(s.calibration, actions);
    if (other_scanner && s.calibration.scanner.id.empty())
      log(actions, LogLine::Level::warning, Code::ok, "no scanner acceptance is in force%s: %s", when,
          s.calibration.scanner.trouble.empty() ? "there is none any more" : s.calibration.scanner.trouble.c_str());
    else if (other_scanner)
      log(actions, LogLine::Level::info, Code::ok, "scanner acceptance %s is in force%s",
          s.calibration.scanner.id.c_str(), when);
  }
  if (s.settings.fault != Code::ok) return;  // an earlier fault was reported already
  const CalibrationFault fault = calibration_fault(s);
  if (fault == s.calibration_fault_said || s.slab.phase != SlabPhase::none) return;
  s.calibration_fault_said = fault;
  if (fault == CalibrationFault::none) {
    log(actions, LogLine::Level::info, Code::ok, "calibration %s is usable again", s.calibration.id.c_str());
  } else {
    log(actions, LogLine::Level::error, Code::calibration_missing, "%s", describe(fault, s.calibration).c_str());
  }
}

CalibrationFault calibration_fault(const Station& s) {
  // An open slab is finished, because its calibration was valid at its begin.
  if (!s.recovered || s.slab.phase != SlabPhase::none) return CalibrationFault::none;
  return fault_of(s.calibration, expiry_utime_us(s));
}

const StationsInForce* usable_table(const Station& s, std::uint16_t slab_type) {
  const StationsInForce* table = s.calibration.table_for(slab_type);
  if (table == nullptr || !(table->hand_eye_id == s.calibration.id)) return nullptr;
  const bool expired = table->expires_utime_us != 0 && expiry_utime_us(s) >= table->expires_utime_us;
  return expired ? nullptr : table;
}

Splice splice_now(const Station& s, std::uint8_t station, const Pose& T_base_flange, Actions& actions) {
  // Validity as at the slab's begin. Otherwise corrections that expire during the slab, or appear expired by a wrong
  // clock, would be used for some of its seats and not for others.
  const bool was_usable = !s.slab.header.stations_id.empty();
  const std::int64_t when_us = was_usable ? 0 : std::numeric_limits<std::int64_t>::max();
  Splice splice = splice_for(s.slab.calibration, s.settings.splice, s.slab.header.slab_type, station, T_base_flange,
                             distance_to_block_mm(s, station, T_base_flange), when_us);
  // Corrections that exist and are not used are logged; a line without corrections is not logged at each scan.
  if (is_uncorrected(splice.source) && !s.slab.calibration.tables.empty()) {
    if (splice.source == SpliceSource::outside_gate) {
      log(actions, LogLine::Level::warning, Code::ok,
          "station %u is not corrected: the robot is %.3f mm and %.4f deg from its pose when the station was mastered, "
          "allowed are %.3f mm and %.4f deg; U rests on its absolute accuracy",
          station, splice.off_mm, deg_from_rad(splice.off_rad), s.settings.splice.gate_mm,
          deg_from_rad(s.settings.splice.gate_rad));
    } else {
      log(actions, LogLine::Level::warning, Code::ok,
          "station %u is not corrected: its correction is %s; U rests on the robot's absolute accuracy", station,
          splice.source == SpliceSource::stale ? "of another hand-eye calibration (slabctl calibrate stations --again)"
          : splice.source == SpliceSource::expired ? "expired"
                                                   : "missing");
    }
  }
  return splice;
}

void note_scanner_temperature(Station& s, double temperature_c, Actions& actions) {
  const bool was_outside = is_outside_temperature(s);
  s.scanner_temperature_c = temperature_c;
  if (was_outside || !is_outside_temperature(s)) return;
  log(actions, LogLine::Level::warning, Code::ok,
      "the scanner has %.1f deg C, its acceptance was at %.1f deg C, allowed is a difference of %.1f K ([scanner] "
      "temperature_range_K); U contains %.0f um per m for it",
      temperature_c, s.calibration.scanner.numbers.temperature_c, s.settings.scanner_drift.range_K,
      1e6 * scanner_drift(s.settings.scanner_drift, s.calibration.scanner.numbers, temperature_c));
}

std::uint16_t calibration_warnings(const Station& s) {
  std::uint16_t warn = 0;
  // With a fault of the start (504, or 502 without a database) calibration, acceptance and checks were not read.
  if (!s.recovered || s.settings.fault != Code::ok) return warn;
  if (s.calibration.source == LineCalibration::Source::commissioning) warn |= kWarnCommissioningCalibration;
  if (handedness_unproven(s)) warn |= kWarnHandednessUnproven;
  const std::int64_t now = expiry_utime_us(s);
  if (overdue(s.calibration.block, s.settings.check_interval_us, now) ||
      overdue(s.calibration.ball, s.settings.check_interval_us, now))
    warn |= kWarnCheckOverdue;
  if (acceptance_state(s.calibration.scanner, now, is_outside_temperature(s)) != AcceptanceState::verified)
    warn |= kWarnScannerNotVerified;
  // For the open slab, and for the last one until the next begins.
  for (const StationRecord& record : s.slab.stations)
    if (is_uncorrected(record.attempt.splice.source) && !s.slab.calibration.tables.empty())
      warn |= kWarnStationsNotCorrected;
  return warn;
}

}  // namespace slabd::daemon
