// SPDX-License-Identifier: Apache-2.0
//
// The calibration in force is the newest row of `applied`; it is not a column that could be set. Rows are only added. A
// rollback is also a row, and contains the row that the next rollback returns to. Apply and rollback are therefore one
// atomic insert each, and the history always matches the calibration in use.
#include "storage/calibrations.h"

#include <sqlite3.h>

#include <algorithm>
#include <cstdlib>

#include "storage/dispositions.h"
#include "storage/gauges.h"
#include "storage/jobs.h"
#include "storage/moulds.h"
#include "storage/rows.h"
#include "storage/storage.h"

namespace slabd::storage {

// Columns of the calibration tables in addition to the field lists; see storage/rows.h.

/// Columns of a record in addition to its numbers.
template <typename V, RecordOf<CalibrationRecord> R>
void columns(V& v, R& r) {
  v("id", r.id);
  part(v, r, "", {{"operator", "operator_name"}});
  v("scanner", r.scanner);
}

/// Key of a row of numbers: its calibration.
struct NumbersOf {
  std::string calibration_id;
};
struct NumbersOfStation {
  std::string calibration_id;
  std::uint8_t station = 0;
};
SLABD_FIELDS(NumbersOf, calibration_id);
SLABD_FIELDS(NumbersOfStation, calibration_id, station);
namespace {

/// observations, certificate and figures together; SQLite's own limit is 1 GB
constexpr std::size_t kTextMax = 32U << 20U;
/// A tie belongs to no single scanner.
constexpr std::string_view kTieScanner = "1";
/// First line of the visits of corrections that were solved while a tie was in force, followed by its id.
constexpr std::string_view kWithTie = "# placed with tie ";

template <typename... Parts>
std::string select(const char* table, const std::string& rest) {
  return "SELECT " + joined(names_of<Parts...>(), ", ") + " FROM " + table + " " + rest;
}

/// True if the tie's numbers are the same: the same calibration kept again has the id with a number behind a dot.
bool is_same_tie(std::string_view a, std::string_view b) {
  return a.substr(0, a.find('.')) == b.substr(0, b.find('.'));
}

/// Tie in force when the corrections of these visits were kept; empty if none is named.
std::string tie_of_visits(std::string_view visits) {
  if (!visits.starts_with(kWithTie)) return "";
  visits.remove_prefix(kWithTie.size());
  return std::string(visits.substr(0, visits.find('\n')));
}

[[noreturn]] void refuse(const std::string& sentence) {
  Error why;
  why.code = Code::config;
  why.text.assign(sentence);
  throw Refusal{why};
}

}  // namespace

// ---- changes -----------------------------------------------------------------------------------------------------

std::string Calibrations::carry_out(const CalibrationChange& change) {
  if (const auto* what = std::get_if<KeepCalibration>(&change)) return keep(what->record);
  if (const auto* what = std::get_if<ApplyCalibration>(&change)) return apply(*what);
  if (const auto* what = std::get_if<RollBackCalibration>(&change)) return roll_back(*what);
  if (const auto* what = std::get_if<KeepDisposition>(&change)) return Dispositions(db_).keep(*what);
  if (const auto* what = std::get_if<ResetMould>(&change)) return Moulds(db_).reset(*what);
  if (const auto* what = std::get_if<KeepGaugeCheck>(&change)) return Gauges(db_).keep(*what);
  return keep(std::get<KeepCheck>(change).check);
}

std::string Calibrations::keep(const CalibrationRecord& given) {
  CalibrationRecord record = given;
  if (record.kind() == CalibrationKind::tie) record.scanner = kTieScanner;
  record.id = calibration_id(record);
  const std::string kind(name(record.kind()));
  if (const std::string nonsense = implausible_value_in(record); !nonsense.empty())
    refuse("this " + kind + " calibration is not kept: " + nonsense);
  if (record.observations.size() + record.certificate.size() + record.figures.size() > kTextMax)
    refuse("this " + kind + " calibration is not kept: its observations and certificate have more than 32 MB");
  // Through the tie in force both robots refer to one place of the mastered slab.
  if (const Row tie = newest(CalibrationKind::tie, 0, kTieScanner);
      record.kind() == CalibrationKind::stations && tie.seq != 0)
    record.observations = std::string(kWithTie) + tie.calibration_id + "\n" + record.observations;
  if (std::string there = kept_already(record); !there.empty()) return there;

  std::vector<std::string> names = {"kind", "slab_type"};
  const std::vector<std::string> rest = names_of<CalibrationRecord>();
  names.insert(names.end(), rest.begin(), rest.end());
  Statement insert(db_, insert_text("calibration", names));
  insert.bind(1, name(record.kind())).bind(2, std::int64_t{record.slab_type()});
  Bind bind(insert, 3);
  columns(bind, record);
  insert.run();

  const NumbersOf of{record.id};
  if (const auto* hand_eye = std::get_if<HandEyeNumbers>(&record.numbers)) {
    Statement row(db_, insert_text("hand_eye", names_of<NumbersOf, HandEyeNumbers>()));
    write_row(row, of, *hand_eye);
  } else if (const auto* table = std::get_if<StationTable>(&record.numbers)) {
    Statement row(db_, insert_text("station_correction", names_of<NumbersOfStation, StationCorrection>()));
    for (std::size_t i = 0; i < table->station.size(); ++i)
      if (table->station[i].visits != 0)
        write_row(row, NumbersOfStation{record.id, static_cast<std::uint8_t>(i + 1)}, table->station[i]);
  } else if (const auto* block = std::get_if<ReferenceBlock>(&record.numbers)) {
    Statement row(db_, insert_text("reference_block", names_of<NumbersOf, ReferenceBlock>()));
    write_row(row, of, *block);
  } else if (const auto* ball = std::get_if<MonitorBall>(&record.numbers)) {
    Statement row(db_, insert_text("monitor_ball", names_of<NumbersOf, MonitorBall>()));
    write_row(row, of, *ball);
  } else if (const auto* scanner = std::get_if<ScannerNumbers>(&record.numbers)) {
    Statement row(db_, insert_text("scanner_acceptance", names_of<NumbersOf, ScannerNumbers>()));
    write_row(row, of, *scanner);
  } else {
    Statement row(db_, insert_text("tie_numbers", names_of<NumbersOf, TieNumbers>()));
    write_row(row, of, std::get<TieNumbers>(record.numbers));
  }
  return record.id;
}

/// Id of this record if it is already stored (a change is repeated if its answer was lost). Otherwise empty, and
/// `record.id` is set to a free id. The same numbers with another certificate or expiry are another record, with a
/// number appended to the id, as are the same corrections with another tie.
std::string Calibrations::kept_already(CalibrationRecord& record) {
  constexpr std::int64_t kSameDay_us = 86'400'000'000;
  const std::string numbers = record.id;
  for (int n = 2;; ++n) {
    const std::optional<CalibrationRecord> there = find_exactly(record.id);
    if (!there) return {};
    const std::int64_t apart = there->expires_utime_us - record.expires_utime_us;
    const bool same_end =
        (there->expires_utime_us == 0) == (record.expires_utime_us == 0) && std::abs(apart) < kSameDay_us;
    const bool same_tie = record.kind() != CalibrationKind::stations ||
                          is_same_tie(tie_of_visits(there->observations), tie_of_visits(record.observations));
    if (same_end && same_tie && there->certificate == record.certificate) return record.id;
    record.id = numbers + "." + std::to_string(n);
  }
}

Calibrations::Row Calibrations::newest(CalibrationKind kind, std::uint16_t slab_type, std::string_view scanner) {
  Statement row(db_,
                "SELECT seq, before_seq, calibration_id FROM applied WHERE kind = ?1 AND slab_type = ?2 "
                "AND scanner = ?3 ORDER BY seq DESC LIMIT 1");
  if (!row.bind(1, name(kind)).bind(2, std::int64_t{slab_type}).bind(3, scanner).step()) return {};
  return {row.integer(0), row.integer(1), std::string(row.text(2))};
}

void Calibrations::check_may_apply(const CalibrationRecord& record, const ChangeNote& note) {
  const std::string not_in_force = record.id + " is not put in force: ";
  if (note.who.empty() || note.why.empty()) refuse(not_in_force + "give an operator and a reason");
  if (!numbers_give_id(record)) refuse(not_in_force + "its numbers in the database were changed after it was kept");
  // The newest record's time replaces a clock that is behind, because a clock set back would make expired calibrations
  // valid again. The newest time may also be wrong, if the clock was ahead before. Therefore applying a new calibration
  // uses its own time.
  const std::int64_t now = is_new(record, note.utime_us) ? note.utime_us : std::max(note.utime_us, newest_utime_us());
  if (record.expires_utime_us != 0 && now >= record.expires_utime_us)
    refuse(not_in_force + "it has expired; calibrate again");
  if (const auto* scanner = std::get_if<ScannerNumbers>(&record.numbers))
    if (const auto why = refusal_of(*scanner); !why.empty()) refuse(not_in_force + std::string(why.view()));
  if (record.kind() == CalibrationKind::tie) {
    const auto hand_eyes = hand_eyes_of_tie(record.parent_id);
    if (!hand_eyes || !is_hand_eye_in_force((*hand_eyes)[0].view()) || !is_hand_eye_in_force((*hand_eyes)[1].view()))
      refuse(not_in_force + "it was solved with the hand-eye calibrations " + record.parent_id +
             ", and these are not in force; tie again (slabctl calibrate tie)");
  }
  if (record.kind() != CalibrationKind::stations) return;
  const Row hand_eye = newest(CalibrationKind::hand_eye, 0, record.scanner);
  if (hand_eye.calibration_id != record.parent_id)
    refuse(not_in_force + "its station corrections were solved with hand-eye calibration " + record.parent_id +
           ", in force is " + (hand_eye.seq == 0 ? "none" : hand_eye.calibration_id) +
           "; solve them again (slabctl calibrate stations)");
}

/// True for the hand-eye calibration in force of any scanner. Commissioning values are in the configuration, so they
/// are compared when the tie is used.
bool Calibrations::is_hand_eye_in_force(std::string_view id) {
  if (!id.starts_with(id_prefix(CalibrationKind::hand_eye))) return true;
  Statement row(db_,
                "SELECT 1 FROM applied AS a WHERE kind = 'hand_eye' AND calibration_id = ?1 AND seq = (SELECT max(seq) "
                "FROM applied AS b WHERE b.kind = 'hand_eye' AND b.scanner = a.scanner) LIMIT 1");
  return row.bind(1, id).step();
}

bool Calibrations::is_new(const CalibrationRecord& record, std::int64_t utime_us) {
  constexpr std::int64_t kDay_us = 86'400'000'000;
  if (record.created_utime_us > utime_us || utime_us - record.created_utime_us > kDay_us) return false;
  Statement before(db_, "SELECT 1 FROM applied WHERE calibration_id = ?1 LIMIT 1");
  return !before.bind(1, std::string_view(record.id)).step();
}

void Calibrations::insert_applied(const CalibrationRecord& record, const Row& replaced, bool is_rollback,
                                  std::int64_t before_seq, const ChangeNote& note) {
  Statement insert(db_,
                   "INSERT INTO applied (kind, slab_type, is_rollback, calibration_id, replaced_id, before_seq, who, "
                   "why, utime_us, scanner) VALUES (?1, ?2, ?3, ?4, ?5, ?6, ?7, ?8, ?9, ?10)");
  insert.bind(1, name(record.kind()))
      .bind(2, std::int64_t{record.slab_type()})
      .bind(3, std::int64_t{is_rollback ? 1 : 0})
      .bind(4, std::string_view(record.id))
      .bind(5, std::string_view(replaced.calibration_id))
      .bind(6, before_seq)
      .bind(7, std::string_view(note.who))
      .bind(8, std::string_view(note.why))
      .bind(9, note.utime_us)
      .bind(10, std::string_view(record.scanner))
      .run();
}

std::string Calibrations::apply(const ApplyCalibration& change) {
  const std::optional<CalibrationRecord> record = find(change.id);
  if (!record) refuse("there is no calibration \"" + change.id + "\"; slabctl calibrate history lists them");
  if (!change.scanner.empty() && record->kind() != CalibrationKind::tie && change.scanner != record->scanner)
    refuse(record->id + " is not put in force: it is of scanner " + record->scanner + ", not of scanner " +
           change.scanner);
  const Row replaced = newest(record->kind(), record->slab_type(), record->scanner);
  check_may_apply(*record, change.note);
  if (replaced.calibration_id == record->id) return record->id;  // repeated because its answer was lost
  insert_applied(*record, replaced, false, replaced.seq, change.note);
  follow_clock(*record, change.note.utime_us);
  return record->id;
}

std::string Calibrations::roll_back(const RollBackCalibration& change) {
  const std::string kind(name(change.kind));
  const std::string scanner = change.kind == CalibrationKind::tie ? std::string(kTieScanner) : change.scanner;
  std::uint16_t slab_type = change.slab_type;
  if (change.kind == CalibrationKind::stations && slab_type == 0) {
    Statement newest_of_kind(
        db_, "SELECT slab_type FROM applied WHERE kind = 'stations' AND scanner = ?1 ORDER BY seq DESC LIMIT 1");
    if (newest_of_kind.bind(1, std::string_view(scanner)).step())
      slab_type = static_cast<std::uint16_t>(newest_of_kind.integer(0));
  }
  const Row now = newest(change.kind, slab_type, scanner);
  if (now.seq == 0) refuse("no calibration of kind " + kind + " is in force that could be rolled back");
  Statement before(db_, "SELECT calibration_id, before_seq FROM applied WHERE seq = ?1");
  if (now.before_seq == 0 || !before.bind(1, now.before_seq).step())
    refuse("before " + now.calibration_id + " no " + kind +
           " calibration was in force, so there is nothing to go back to; apply another one");
  std::string id(before.text(0));
  const std::int64_t before_seq = before.integer(1);
  before.reset();
  const std::optional<CalibrationRecord> record = find(id);
  if (!record) refuse("the calibration before, " + id + ", is not in the database");
  check_may_apply(*record, change.note);
  insert_applied(*record, now, true, before_seq, change.note);
  return id;
}

std::string Calibrations::keep(const CalibrationCheck& check) {
  const std::string reference(check.reference_id.view());
  const std::optional<CalibrationRecord> record = find(reference);
  if (!record || record->kind() != check.kind)
    refuse("this check is not kept: it names no " + std::string(name(check.kind)) + " \"" + reference + "\"");
  Statement insert(db_, insert_text("calibration_check", names_of<CalibrationCheck>()));
  write_row(insert, check);
  return record->id;
}

// ---- reading -----------------------------------------------------------------------------------------------------

CalibrationRecord Calibrations::read(Statement& row) {
  CalibrationRecord record;
  CalibrationKind kind{};
  if (!from_word(row.text(0), kind)) row.refuse(0, "is not a kind of calibration");
  const auto slab_type = static_cast<std::uint16_t>(row.integer(1));
  read_row(row, 2, record);
  const auto numbers = [&](const char* table, auto fresh) {
    Statement one(db_, select<decltype(fresh)>(table, "WHERE calibration_id = ?1"));
    if (!one.bind(1, std::string_view(record.id)).step())
      throw SqlFailure{SQLITE_CORRUPT, "calibration " + record.id + " has no row in " + table};
    read_row(one, 0, fresh);
    record.numbers = fresh;
  };
  switch (kind) {
    case CalibrationKind::hand_eye: numbers("hand_eye", HandEyeNumbers{}); break;
    case CalibrationKind::reference_block: numbers("reference_block", ReferenceBlock{}); break;
    case CalibrationKind::monitor_ball: numbers("monitor_ball", MonitorBall{}); break;
    case CalibrationKind::scanner: numbers("scanner_acceptance", ScannerNumbers{}); break;
    case CalibrationKind::tie: numbers("tie_numbers", TieNumbers{}); break;
    case CalibrationKind::stations: {
      StationTable table;
      table.slab_type = slab_type;
      Statement rows(db_,
                     select<NumbersOfStation, StationCorrection>("station_correction", "WHERE calibration_id = ?1"));
      rows.bind(1, std::string_view(record.id));
      while (rows.step()) {
        NumbersOfStation of;
        StationCorrection correction;
        read_row(rows, 0, of, correction);
        if (of.station < 1 || of.station > limits::kStationsMax) rows.refuse(1, "is not a station");
        table.station[of.station - 1U] = correction;
      }
      record.numbers = table;
      break;
    }
  }
  return record;
}

std::vector<CalibrationRecord> Calibrations::all() {
  std::vector<CalibrationRecord> list;
  Statement rows(db_, "SELECT kind, slab_type, " + joined(names_of<CalibrationRecord>(), ", ") +
                          " FROM calibration ORDER BY seq DESC");
  while (rows.step()) list.push_back(read(rows));
  return list;
}

std::optional<CalibrationRecord> Calibrations::find_exactly(std::string_view id) {
  Statement rows(db_, "SELECT kind, slab_type, " + joined(names_of<CalibrationRecord>(), ", ") +
                          " FROM calibration WHERE id = ?1");
  if (!rows.bind(1, id).step()) return std::nullopt;
  return read(rows);
}

std::optional<CalibrationRecord> Calibrations::find(std::string_view id) {
  if (id.empty()) return std::nullopt;
  if (auto exact = find_exactly(id)) return exact;
  // A prefix is sufficient if only one id begins with it. Compared by substr, because the prefix may contain wildcards.
  Statement rows(db_, "SELECT kind, slab_type, " + joined(names_of<CalibrationRecord>(), ", ") +
                          " FROM calibration WHERE substr(id, 1, length(?1)) = ?1 LIMIT 2");
  std::optional<CalibrationRecord> found;
  rows.bind(1, id);
  while (rows.step()) {
    if (found) {
      rows.reset();
      return std::nullopt;
    }
    found = read(rows);
  }
  return found;
}

std::optional<CalibrationRecord> Calibrations::current(CalibrationKind kind, std::uint16_t slab_type,
                                                       std::string_view scanner) {
  return find(newest(kind, slab_type, kind == CalibrationKind::tie ? kTieScanner : scanner).calibration_id);
}

std::vector<AppliedChange> Calibrations::applied(std::size_t limit) {
  std::vector<AppliedChange> list;
  Statement rows(db_,
                 "SELECT seq, kind, slab_type, is_rollback, calibration_id, replaced_id, who, why, utime_us, scanner "
                 "FROM applied ORDER BY seq DESC LIMIT ?1");
  rows.bind(1, static_cast<std::int64_t>(std::min<std::size_t>(limit, 1'000'000'000)));
  while (rows.step()) {
    AppliedChange& change = list.emplace_back();
    change.seq = rows.integer(0);
    if (!from_word(rows.text(1), change.kind)) rows.refuse(1, "is not a kind of calibration");
    change.slab_type = static_cast<std::uint16_t>(rows.integer(2));
    change.is_rollback = rows.integer(3) == 1;
    change.calibration_id = rows.text(4);
    change.replaced_id = rows.text(5);
    change.note = {std::string(rows.text(6)), std::string(rows.text(7)), rows.integer(8)};
    change.scanner = rows.text(9);
  }
  return list;
}

std::vector<CalibrationCheck> Calibrations::checks(std::size_t limit) {
  std::vector<CalibrationCheck> list;
  Statement rows(db_, select<CalibrationCheck>("calibration_check", "ORDER BY seq DESC LIMIT ?1"));
  rows.bind(1, static_cast<std::int64_t>(std::min<std::size_t>(limit, 1'000'000'000)));
  while (rows.step()) read_row(rows, 0, list.emplace_back());
  return list;
}

// ---- calibrations in force ---------------------------------------------------------------------------------------

void Calibrations::use_hand_eye(const std::optional<CalibrationRecord>& record, LineCalibration& out) {
  if (!record || record->kind() != CalibrationKind::hand_eye) {
    out.trouble = "the calibration in force is not in the database";
    return;
  }
  out.id.assign(record->id);
  if (!numbers_give_id(*record)) {
    out.trouble.printf("the numbers of %s in the database were changed after it was kept", record->id.c_str());
    return;
  }
  out.source = LineCalibration::Source::applied;
  out.of_scanner.assign(record->scanner);
  out.hand_eye = std::get<HandEyeNumbers>(record->numbers);
  out.expires_utime_us = record->expires_utime_us;
  // Views of robot poses and targets would contradict a mirrored point cloud. An adopted calibration has none.
  if (std::string_view(record->observations).starts_with("# adopted from "))
    out.trouble.printf("%s was adopted: no views prove that the scanner's frame is right-handed", record->id.c_str());
}

void Calibrations::use_table(const std::optional<CalibrationRecord>& record, LineCalibration& out) {
  if (!record || record->kind() != CalibrationKind::stations) return;
  if (!numbers_give_id(*record)) {
    out.trouble.printf("the numbers of %s in the database were changed after it was kept; it is not used",
                       record->id.c_str());
    return;
  }
  StationsInForce table;
  table.id.assign(record->id);
  table.hand_eye_id.assign(record->parent_id);
  table.expires_utime_us = record->expires_utime_us;
  table.table = std::get<StationTable>(record->numbers);
  static_cast<void>(out.tables.push(table));  // if there are more slab types than recipes, the rest is never used
}

void Calibrations::use_scanner(const std::optional<CalibrationRecord>& record, ScannerInForce& out) {
  if (!record || record->kind() != CalibrationKind::scanner) {
    out.trouble = "the scanner's acceptance is not in the database; U rests on the recipe's specification";
    return;
  }
  if (!numbers_give_id(*record)) {
    out.trouble.printf("the numbers of %s in the database were changed after it was kept; it is not used",
                       record->id.c_str());
    return;
  }
  out.id.assign(record->id);
  out.numbers = std::get<ScannerNumbers>(record->numbers);
  out.expires_utime_us = record->expires_utime_us;
  // A failed verification is cleared only by a later acceptance, not by applying an older one again. A verification of
  // another named scanner is ignored; one without a name may be of this scanner.
  Statement later(
      db_,
      "SELECT 1 FROM calibration JOIN scanner_acceptance AS seen ON calibration_id = id WHERE within_limits = 0 AND "
      "calibration.scanner = ?3 AND seq > (SELECT seq FROM calibration WHERE id = ?1) AND (seen.scanner = ?2 OR "
      "seen.scanner = '' OR ?2 = '') LIMIT 1");
  later.bind(1, std::string_view(record->id)).bind(2, out.numbers.scanner.view());
  out.failed = later.bind(3, std::string_view(record->scanner)).step();
}

void Calibrations::use_tie(const std::optional<CalibrationRecord>& record, TieInForce& out) {
  if (!record || record->kind() != CalibrationKind::tie) {
    out.trouble = "it is not in the database";
    return;
  }
  out.id.assign(record->id);
  const auto hand_eyes = hand_eyes_of_tie(record->parent_id);
  if (!hand_eyes || !numbers_give_id(*record)) {
    out.trouble.printf("the numbers of %s in the database were changed after it was kept", record->id.c_str());
    return;
  }
  out.numbers = std::get<TieNumbers>(record->numbers);
  out.hand_eye_id = *hand_eyes;
  out.expires_utime_us = record->expires_utime_us;
}

LineCalibration::Watch Calibrations::watch(CalibrationKind kind, std::string_view scanner) {
  LineCalibration::Watch watch;
  const Row row = newest(kind, 0, scanner);
  if (row.seq == 0) return watch;
  watch.reference_id.assign(row.calibration_id);
  Statement first(db_, "SELECT min(utime_us) FROM applied WHERE calibration_id = ?1");
  if (first.bind(1, std::string_view(row.calibration_id)).step()) watch.since_utime_us = first.integer(0);
  first.reset();
  // By kind, not by artefact: a check that failed with one artefact is not cleared by applying another.
  Statement last(db_, select<CalibrationCheck>("calibration_check",
                                               "WHERE kind = ?1 AND reference_id IN (SELECT id FROM calibration WHERE "
                                               "scanner = ?2) ORDER BY seq DESC LIMIT 1"));
  if (!last.bind(1, name(kind)).bind(2, scanner).step()) return watch;
  CalibrationCheck check;
  read_row(last, 0, check);
  watch.checked_utime_us = check.utime_us;
  watch.failed = !check.passed;
  watch.note = check.note.view();
  return watch;
}

void Calibrations::follow_clock(const CalibrationRecord& record, std::int64_t utime_us) {
  if (record.expires_utime_us == 0 || newest_utime_us() < record.expires_utime_us) return;
  Statement(db_, "UPDATE line SET newest_utime_us = ?1").bind(1, utime_us).run();
}

std::int64_t Calibrations::newest_utime_us() {
  return db_.integer("SELECT newest_utime_us FROM line");
}

void Calibrations::in_force(std::string_view scanner, LineCalibration& out) {
  out = LineCalibration{};
  if (const Row row = newest(CalibrationKind::hand_eye, 0, scanner); row.seq != 0)
    use_hand_eye(find(row.calibration_id), out);
  std::vector<std::uint16_t> types;
  Statement rows(db_,
                 "SELECT DISTINCT slab_type FROM applied WHERE kind = 'stations' AND scanner = ?1 ORDER BY slab_type");
  rows.bind(1, scanner);
  while (rows.step()) types.push_back(static_cast<std::uint16_t>(rows.integer(0)));
  for (const std::uint16_t type : types) use_table(current(CalibrationKind::stations, type, scanner), out);
  out.block = watch(CalibrationKind::reference_block, scanner);
  out.ball = watch(CalibrationKind::monitor_ball, scanner);
  if (const Row row = newest(CalibrationKind::scanner, 0, scanner); row.seq != 0)
    use_scanner(find(row.calibration_id), out.scanner);
}

void Calibrations::in_force(const LineArms& arms, CellCalibration& out) {
  out.tie = TieInForce{};
  for (std::size_t i = 0; i < out.arm.size(); ++i) {
    if (i < arms.list.size())
      in_force(arms.list[i].scanner.view(), out.arm[i]);
    else
      out.arm[i] = LineCalibration{};
  }
  if (!arms.several()) return;
  const Row tie = newest(CalibrationKind::tie, 0, kTieScanner);
  if (tie.seq != 0) use_tie(find(tie.calibration_id), out.tie);
  for (std::size_t i = 0; i < out.arm.size(); ++i) check_tie_of_tables(tie.calibration_id, i == 0, out.arm[i]);
}

/// True if a certificate gives its points in the robot's own base, so that no tie is needed to place them.
static bool is_in_base(std::string_view certificate) {
  constexpr std::string_view kBlank = " \t\r";
  constexpr std::string_view kKey = "frame";
  while (!certificate.empty()) {
    std::string_view line = certificate.substr(0, certificate.find('\n'));
    certificate.remove_prefix(std::min(line.size() + 1, certificate.size()));
    line = line.substr(0, line.find('#'));
    line.remove_prefix(std::min(line.find_first_not_of(kBlank), line.size()));
    if (!line.starts_with(kKey)) continue;
    line.remove_prefix(kKey.size());
    line.remove_prefix(std::min(line.find_first_not_of(kBlank), line.size()));
    if (!line.starts_with('=')) continue;
    return line.find("base") != std::string_view::npos;
  }
  return false;
}

/// Makes corrections stale, as with another hand-eye calibration, that placed the mastered slab through another tie
/// than `tie_id`: they contain its error. If none is named, it is the one that was in force when they were first
/// applied; those of the first robot, the line's base, were then solved without one.
void Calibrations::check_tie_of_tables(std::string_view tie_id, bool is_first, LineCalibration& out) {
  Statement then(db_,
                 "SELECT calibration_id FROM applied WHERE kind = 'tie' AND scanner = ?1 AND seq < "
                 "(SELECT min(seq) FROM applied WHERE calibration_id = ?2) ORDER BY seq DESC LIMIT 1");
  for (StationsInForce& table : out.tables) {
    const auto record = find(table.id.view());
    std::string of_then = record ? tie_of_visits(record->observations) : "";
    if (of_then.empty()) {
      if (is_first) continue;
      if (then.bind(1, kTieScanner).bind(2, table.id.view()).step()) of_then = then.text(0);
      then.reset();
    }
    if (is_same_tie(of_then, tie_id) || (record && is_in_base(record->certificate))) continue;
    table.hand_eye_id.clear();
  }
}

void Calibrations::use_slab(const CalibrationId& hand_eye, const CalibrationId& stations, const CalibrationId& scanner,
                            LineCalibration& out) {
  out = LineCalibration{};
  if (!scanner.empty()) use_scanner(find(scanner.view()), out.scanner);
  // Commissioning values are in the configuration, not in the database.
  if (!hand_eye.view().starts_with(id_prefix(CalibrationKind::hand_eye))) return;
  use_hand_eye(find(hand_eye.view()), out);
  if (!stations.empty()) use_table(find(stations.view()), out);
}

void Calibrations::of_slab(const SlabHeader& slab, CellCalibration& out) {
  use_slab(slab.calibration_id, slab.stations_id, slab.scanner_id, out.arm[0]);
  for (std::size_t i = 1; i < out.arm.size(); ++i) {
    const SlabArm arm = i <= slab.more_arms.size() ? slab.more_arms[i - 1] : SlabArm{};
    use_slab(arm.calibration_id, arm.stations_id, arm.scanner_id, out.arm[i]);
  }
  out.tie = TieInForce{};
  if (!slab.tie_id.empty()) use_tie(find(slab.tie_id.view()), out.tie);
}

}  // namespace slabd::storage
