// SPDX-License-Identifier: Apache-2.0
#include "storage/jobs.h"

#include <algorithm>
#include <vector>

#include "base/rules.h"
#include "storage/files/folders.h"

namespace slabd::storage {
namespace {

constexpr std::uint16_t kDone = static_cast<std::uint16_t>(CommandStatus::done);
constexpr std::uint16_t kAccepted = static_cast<std::uint16_t>(CommandStatus::accepted);
constexpr std::uint16_t kAcquired = static_cast<std::uint16_t>(CommandStatus::acquired);
constexpr std::uint16_t kInterrupted = kCommandFailed + static_cast<std::uint16_t>(Code::interrupted);
constexpr std::int64_t kScan = static_cast<std::int64_t>(PlcCommand::scan);

template <typename... Parts>
std::string insert_for(const char* table) {
  return insert_text(table, names_of<Parts...>());
}

template <typename... Parts>
std::string upsert_for(const char* table, const std::vector<std::string>& key) {
  return upsert_text(table, names_of<Parts...>(), key);
}

constexpr const char* kCloseNewest =
    "UPDATE command SET status = ?1 WHERE id = (SELECT max(id) FROM command WHERE status = 1 AND command IN (?2, ?3))";

std::int64_t number(std::uint64_t value) {
  return static_cast<std::int64_t>(value);
}

}  // namespace

Jobs::Jobs(Connection& db, const StoreSettings& settings, const HeldBack& held_back)
    : db_(db),
      settings_(settings),
      held_back_(held_back),
      set_session_(db, "UPDATE line SET session = ?1"),
      newest_(db, "SELECT newest_utime_us FROM line"),
      set_newest_(db, "UPDATE line SET newest_utime_us = ?1 WHERE newest_utime_us < ?1"),
      newest_slab_(db,
                   "SELECT slab.slab_key, slab_result.slab_key FROM slab LEFT JOIN slab_result USING (slab_key) "
                   "ORDER BY slab.slab_key DESC LIMIT 1"),
      slab_attempts_(db, "SELECT count(*) FROM attempt WHERE slab_key = ?1"),
      upsert_slab_(db, upsert_for<SlabHeader>("slab", {"slab_key"})),
      delete_arms_(db, "DELETE FROM slab_arm WHERE slab_key = ?1"),
      insert_arm_(db, insert_for<ArmKey, SlabArm>("slab_arm")),
      has_recipe_(db, "SELECT count(*) FROM recipe_text WHERE sha256 = ?1"),
      insert_recipe_(db, "INSERT INTO recipe_text (sha256, name, text, kept_utime_us) VALUES (?1, ?2, ?3, ?4)"),
      newest_command_(db,
                      "SELECT session, cmd_seq, command, station, coalesce(slab_key, 0), status FROM command "
                      "ORDER BY id DESC LIMIT 1"),
      insert_command_(db,
                      "INSERT INTO command (session, cmd_seq, command, station, utime_us, status, acquired, slab_key) "
                      "VALUES (?1, ?2, ?3, ?4, ?5, ?6, ?7, nullif(?8, 0))"),
      // Sequence numbers repeat after 65535 commands, so the newest one is used.
      close_command_(db,
                     "UPDATE command SET status = ?3, acquired = ?4 WHERE id = "
                     "(SELECT max(id) FROM command WHERE session = ?1 AND cmd_seq = ?2)"),
      close_newest_(db, kCloseNewest),
      attempt_phase_(db, "SELECT phase FROM attempt WHERE slab_key = ?1 AND station = ?2 AND attempt = ?3"),
      upsert_attempt_(db, upsert_for<Attempt, AttemptState>("attempt", {"slab_key", "station", "attempt"})),
      same_fingerprint_(db,
                        "SELECT slab_key, station, attempt FROM attempt WHERE fingerprint = ?1 AND "
                        "(slab_key, station, attempt) <> (?2, ?3, ?4) LIMIT 1"),
      remember_scan_(db, "INSERT OR REPLACE INTO seen_scan (fingerprint) VALUES (?1)"),
      forget_scans_(db, "DELETE FROM seen_scan WHERE id <= (SELECT id FROM seen_scan ORDER BY id DESC LIMIT 1 OFFSET " +
                            std::to_string(kFingerprintsKept) + ")"),
      remember_noise_(db,
                      "INSERT OR REPLACE INTO noise_print (slab_key, station, attempt, bytes) VALUES (?1, ?2, ?3, ?4)"),
      forget_noise_(db,
                    "DELETE FROM noise_print WHERE id <= (SELECT id FROM noise_print ORDER BY id DESC LIMIT 1 OFFSET " +
                        std::to_string(limits::kNoisePrintsKept) + ")"),
      set_emulated_(db, "UPDATE slab SET emulated = emulated | ?2 WHERE slab_key = ?1"),
      set_measured_(db,
                    "UPDATE attempt SET phase = 'measured', code = 0, measuring_since_ns = 0 "
                    "WHERE slab_key = ?1 AND station = ?2 AND attempt = ?3"),
      set_measuring_(db,
                     "UPDATE attempt SET measuring_since_ns = ?4 "
                     "WHERE slab_key = ?1 AND station = ?2 AND attempt = ?3 AND phase = 'acquired'"),
      attempt_command_(db,
                       "SELECT session, cmd_seq FROM attempt WHERE slab_key = ?1 AND station = ?2 AND attempt = ?3"),
      delete_block_(db, "DELETE FROM block WHERE slab_key = ?1 AND station = ?2 AND attempt = ?3"),
      insert_block_(db, insert_for<BlockKey, BlockResult>("block")),
      insert_plane_(db, insert_for<BlockKey, FeatureName, PlaneFit>("plane")),
      insert_casing_(db, insert_for<BlockKey, FeatureName, CasingFeature>("casing")),
      insert_finding_(db, insert_for<BlockKey, Position, SurfaceFinding>("finding")),
      insert_edge_(db, insert_for<BlockKey, Position, EdgeFeature>("edge")),
      delete_items_(db, "DELETE FROM item WHERE slab_key = ?1 AND station = ?2 AND attempt = ?3"),
      insert_item_(db, insert_for<BlockKey, Position, Item>("item")),
      insert_map_(db, insert_for<BlockKey, FeatureName, PackedMap>("map")),
      delete_gauges_(db, "DELETE FROM gauge_value WHERE slab_key = ?1"),
      insert_gauge_(db, insert_for<SlabKey, Position, GaugeReading>("gauge_value")),
      upsert_slab_result_(db, upsert_for<SlabKey, SlabEnd, SlabResult>("slab_result", {"slab_key"})),
      upsert_station_result_(db, upsert_for<SlabKey, StationResult>("station_result", {"slab_key", "station"})),
      delete_unseen_result_(db,
                            "DELETE FROM result WHERE slab_key = ?1 AND kind = ?2 AND station = ?3 "
                            "AND (kind = 2 OR cmd_seq = ?4) AND acknowledged = 0 AND is_repeat = 0"),
      insert_result_(db, insert_for<SlabKey, ResultState, PlcResult>("result")),
      // Only this record: an earlier one, of a slab's end whose commit returned an error, was never shown.
      acknowledge_(db,
                   "UPDATE result SET acknowledged = 1 WHERE id = "
                   "(SELECT min(id) FROM result WHERE acknowledged = 0 AND res_seq = ?1 AND id NOT BETWEEN ?2 AND ?3)"),
      delete_slab_result_(db, "DELETE FROM slab_result WHERE slab_key = ?1"),
      delete_station_results_(db, "DELETE FROM station_result WHERE slab_key = ?1"),
      delete_slab_record_(db, "DELETE FROM result WHERE slab_key = ?1 AND kind = 2 AND is_repeat = 0"),
      reopen_end_(db,
                  "UPDATE command SET status = 1 WHERE status = 4 AND id = (SELECT max(id) FROM command WHERE "
                  "slab_key = ?1 AND command IN (?2, ?3)) AND EXISTS (SELECT 1 FROM slab_result WHERE slab_key = ?1)"),
      reopen_report_(db,
                     "UPDATE command SET status = 1 WHERE status = 4 AND id = (SELECT max(id) FROM command WHERE "
                     "command = ?2) AND EXISTS (SELECT 1 FROM result WHERE res_seq = ?1 AND acknowledged = 0 "
                     "AND is_repeat = 1)"),
      set_acquired_(db,
                    "UPDATE attempt SET phase = 'acquired' "
                    "WHERE slab_key = ?1 AND station = ?2 AND attempt = ?3 AND phase = 'measured'"),
      delete_report_(db, "DELETE FROM result WHERE res_seq = ?1 AND acknowledged = 0 AND is_repeat = 1"),
      last_ended_(db, "SELECT coalesce(max(slab_key), 0) FROM slab_result"),
      unfinished_(db,
                  "SELECT command.session, cmd_seq, command, station, coalesce(command.slab_key, 0), "
                  "slab_result.slab_key IS NULL AND command.id = (SELECT max(id) FROM command AS later WHERE "
                  "later.command = 2 AND later.slab_key = command.slab_key AND later.station = command.station), "
                  "slab_result.slab_key IS NULL AND command = 4 AND command.id = (SELECT max(id) FROM command AS later "
                  "WHERE later.command IN (2, 3, 4) AND later.slab_key = command.slab_key) "
                  "FROM command LEFT JOIN slab_result ON slab_result.slab_key = command.slab_key "
                  "WHERE status = 1 ORDER BY command.id"),
      scan_recorded_(
          db,
          "SELECT count(*), coalesce(max(attempt) FILTER (WHERE asked = 1), 0), "
          "coalesce(sum(session = ?3 AND cmd_seq = ?4), 0) FROM attempt WHERE slab_key = ?1 AND station = ?2"),
      is_ended_(db, "SELECT 1 FROM slab_result WHERE slab_key = ?1") {}

void Jobs::begin_chain() {
  with_seals([](Seals& seals) { seals.begin(); });
}

void Jobs::seal_if_ended(std::int64_t slab_key) {
  const bool ended = is_ended_.bind(1, slab_key).step();
  is_ended_.reset();
  if (ended) with_seals([&](Seals& seals) { seals.seal_if_ended(slab_key); });
}

// ---- sessions, slabs, commands -----------------------------------------------------------------------------------

void Jobs::operator()(const SessionJob& job) {
  set_session_.bind(1, number(job.session)).run();
}

void Jobs::operator()(const BeginSlabJob& job) {
  std::int64_t newest = 0;
  bool open = false;
  if (newest_slab_.step()) {
    newest = newest_slab_.integer(0);
    open = newest_slab_.is_null(1);
    newest_slab_.reset();
  }
  bool again = open && newest == job.slab.key;
  if (again) {
    again = slab_attempts_.bind(1, newest).step() && slab_attempts_.integer(0) == 0;
    slab_attempts_.reset();
  }
  if (open && !again)
    throw Refusal{error(Code::journal_write, "slab %lld cannot begin: slab %lld is still open",
                        static_cast<long long>(job.slab.key), static_cast<long long>(newest))};
  if (!again && job.slab.key <= newest)
    throw Refusal{error(Code::journal_write, "slab key %lld is not above the last one, %lld",
                        static_cast<long long>(job.slab.key), static_cast<long long>(newest))};
  write_row(upsert_slab_, job.slab);
  delete_arms_.bind(1, job.slab.key).run();  // of a first try
  for (std::size_t i = 0; i < job.slab.more_arms.size(); ++i)
    write_row(insert_arm_, ArmKey{job.slab.key, static_cast<std::uint8_t>(i + 1)}, job.slab.more_arms[i]);
  keep_recipe(job.slab);
  insert_command({job.session, job.cmd_seq, static_cast<std::uint16_t>(PlcCommand::slab_begin), 0, job.slab.key,
                  job.slab.began_utime_us},
                 kDone);
}

void Jobs::keep_recipe(const SlabHeader& slab) {
  // Check for existence first, to avoid copying the text.
  const bool kept = has_recipe_.bind(1, slab.recipe_sha256.view()).step() && has_recipe_.integer(0) > 0;
  has_recipe_.reset();
  if (kept) return;
  for (const RecipeText& recipe : settings_.recipe_texts) {
    if (!(recipe.sha256 == slab.recipe_sha256)) continue;
    insert_recipe_.bind(1, recipe.sha256.view())
        .bind(2, recipe.name.view())
        .bind(3, std::string_view(recipe.text))
        .bind(4, slab.began_utime_us)
        .run();
    return;
  }
}

void Jobs::operator()(const CommandJob& job) {
  insert_command(job, kAccepted);
}

void Jobs::undo_end(std::int64_t slab_key) {
  reopen_end_.bind(1, slab_key)
      .bind(2, number(static_cast<std::uint16_t>(PlcCommand::slab_end)))
      .bind(3, number(static_cast<std::uint16_t>(PlcCommand::slab_abort)))
      .run();
  delete_slab_result_.bind(1, slab_key).run();
  delete_station_results_.bind(1, slab_key).run();
  delete_items_.bind(1, slab_key).bind(2, number(0)).bind(3, number(0)).run();
  delete_gauges_.bind(1, slab_key).run();
  delete_slab_record_.bind(1, slab_key).run();
  with_seals([&](Seals& seals) { seals.reopen(slab_key); });
}

void Jobs::undo_block(const BlockKey& key) {
  attempt_command_.bind(1, key.slab_key).bind(2, number(key.station)).bind(3, number(key.attempt));
  if (!attempt_command_.step()) return;
  const auto session = static_cast<std::uint16_t>(attempt_command_.integer(0));
  const auto cmd_seq = static_cast<std::uint16_t>(attempt_command_.integer(1));
  attempt_command_.reset();
  delete_items_.bind(1, key.slab_key).bind(2, number(key.station)).bind(3, number(key.attempt)).run();
  delete_block_.bind(1, key.slab_key).bind(2, number(key.station)).bind(3, number(key.attempt)).run();
  set_acquired_.bind(1, key.slab_key).bind(2, number(key.station)).bind(3, number(key.attempt)).run();
  close_command(session, cmd_seq, kAcquired, true);
  delete_unseen_result(key.slab_key, 1, key.station, cmd_seq);
  seal_if_ended(key.slab_key);
}

void Jobs::undo_report(std::uint16_t res_seq) {
  reopen_report_.bind(1, number(res_seq)).bind(2, number(static_cast<std::uint16_t>(PlcCommand::report))).run();
  delete_report_.bind(1, number(res_seq)).run();
}

void Jobs::insert_command(const CommandJob& command, std::uint16_t status) {
  note_time(command.utime_us);
  if (newest_command_.step()) {
    Statement& s = newest_command_;
    const bool same = s.integer(0) == command.session && s.integer(1) == command.cmd_seq &&
                      s.integer(2) == command.command && s.integer(3) == command.station &&
                      s.integer(4) == command.slab_key && s.integer(5) == status;
    s.reset();
    if (same) return;
  }
  Bind bind(insert_command_, 1);
  columns(bind, command);
  const CommandState state{status, false};
  columns(bind, state);
  insert_command_.bind(bind.next_index(), command.slab_key).run();
}

void Jobs::close_command(std::uint16_t session, std::uint16_t cmd_seq, std::uint16_t status, bool acquired) {
  close_command_.bind(1, number(session))
      .bind(2, number(cmd_seq))
      .bind(3, number(status))
      .bind(4, number(acquired ? 1 : 0))
      .run();
}

void Jobs::note_time(std::int64_t utime_us) {
  // The transaction may have been rolled back, or follow_clock() may have reset the time.
  const std::int64_t stored = newest_.step() ? newest_.integer(0) : 0;
  newest_.reset();
  if (stored != newest_time_.utime_us()) newest_time_ = NewestTime(stored);
  newest_time_.note(utime_us);
  set_newest_.bind(1, newest_time_.utime_us()).run();
}

// ---- attempts and blocks -----------------------------------------------------------------------------------------

AttemptState Jobs::state_of(const Attempt& attempt, StationPhase phase, std::uint16_t code) const {
  AttemptState state;
  state.phase = phase;
  state.code = code;
  const std::string path(attempt.scan_path.view());
  // Only files in the spool may be deleted, so only those are counted.
  if (lies_below(path, settings_.spool_dir)) state.scan_bytes = file_bytes(path);
  state.scan_state = state.scan_bytes > 0 ? ScanState::kept : ScanState::none;
  return state;
}

void Jobs::remember_scan(std::uint64_t fingerprint) {
  if (fingerprint == 0) return;
  remember_scan_.bind(1, number(fingerprint)).run();
  forget_scans_.run();
}

bool Jobs::is_known(const Attempt& a) {
  if (!a.fingerprint) return false;
  same_fingerprint_.bind(1, *a.fingerprint).bind(2, a.slab_key).bind(3, number(a.station)).bind(4, number(a.number));
  if (!same_fingerprint_.step()) return false;
  answer_ =
      error(Code::frame_incomplete,
            "station %u: the scanner gave the points that slab %lld station %lld had in scan %lld; restart the "
            "scanner program",
            a.station, static_cast<long long>(same_fingerprint_.integer(0)),
            static_cast<long long>(same_fingerprint_.integer(1)), static_cast<long long>(same_fingerprint_.integer(2)));
  same_fingerprint_.reset();
  return true;
}

void Jobs::operator()(const AcquiredJob& job) {
  const Attempt& a = job.attempt;
  attempt_phase_.bind(1, a.slab_key).bind(2, number(a.station)).bind(3, number(a.number));
  if (attempt_phase_.step()) {
    const bool measured = attempt_phase_.text(0) == word(StationPhase::measured);
    attempt_phase_.reset();
    if (measured) return;
  }
  if (job.refuse_known && is_known(a)) {
    (*this)(FailedAttemptJob{a, static_cast<std::uint16_t>(Code::frame_incomplete), job.fingerprint, job.keeps_unseen});
    return;
  }
  AttemptState state = state_of(a, StationPhase::acquired, 0);
  state.measuring_since_ns = job.measuring_since_ns;
  write_row(upsert_attempt_, a, state);
  if (a.emulated != 0) set_emulated_.bind(1, a.slab_key).bind(2, number(a.emulated)).run();
  remember_scan(job.fingerprint);
  if (job.keeps_unseen) remember_scan(kUnseenScan);
  close_command(a.session, a.cmd_seq, kAcquired, true);
  note_time(a.scan_utime_us);
  seal_if_ended(a.slab_key);
}

void Jobs::operator()(const FailedAttemptJob& job) {
  const Attempt& a = job.attempt;
  write_row(upsert_attempt_, a, state_of(a, StationPhase::failed, job.code));
  remember_scan(job.fingerprint);
  if (job.keeps_unseen) remember_scan(kUnseenScan);
  close_command(a.session, a.cmd_seq, static_cast<std::uint16_t>(kCommandFailed + job.code), false);
  note_time(a.scan_utime_us);
  seal_if_ended(a.slab_key);
}

void Jobs::operator()(const BlockJob& job) {
  const BlockKey key{job.slab_key, job.block.station, job.attempt};
  attempt_command_.bind(1, key.slab_key).bind(2, number(key.station)).bind(3, number(key.attempt));
  if (!attempt_command_.step())
    throw Refusal{error(Code::journal_write,
                        "a block was measured for slab %lld station %u attempt %u, which was never "
                        "acquired",
                        static_cast<long long>(key.slab_key), key.station, key.attempt)};
  const auto session = static_cast<std::uint16_t>(attempt_command_.integer(0));
  const auto cmd_seq = static_cast<std::uint16_t>(attempt_command_.integer(1));
  attempt_command_.reset();

  insert_block(key, job.block);
  insert_maps(key, job.maps);
  remember_noise(key, job.noise);
  set_measured_.bind(1, key.slab_key).bind(2, number(key.station)).bind(3, number(key.attempt)).run();
  close_command(session, cmd_seq, kDone, true);
  insert_result(key.slab_key, false, job.record);
  seal_if_ended(key.slab_key);
}

void Jobs::insert_block(const BlockKey& key, const BlockResult& block) {
  delete_block_.bind(1, key.slab_key).bind(2, number(key.station)).bind(3, number(key.attempt)).run();
  write_row(insert_block_, key, block);
  const auto plane = [&](const char* name, const PlaneFit& fit) {
    write_row(insert_plane_, key, FeatureName{name}, fit);
  };
  plane("seat", block.seat.plane);
  plane("seat_full", block.seat.full_plane);
  plane("jaw_inner", block.jaw_inner);
  plane("jaw_outer", block.jaw_outer);
  plane("slab_top", block.slab_top);
  write_row(insert_casing_, key, FeatureName{"inner"}, block.casing_inner);
  write_row(insert_casing_, key, FeatureName{"outer"}, block.casing_outer);
  for (const SurfaceFinding& finding : block.findings)
    write_row(insert_finding_, key, Position{static_cast<std::uint8_t>(&finding - block.findings.begin())}, finding);
  for (const EdgeFeature& edge : block.edges)
    write_row(insert_edge_, key, Position{static_cast<std::uint8_t>(&edge - block.edges.begin())}, edge);
  insert_items(key, block.items.begin(), block.items.end());
}

/// Called after insert_block, which deletes the maps of an earlier answer together with their block.
void Jobs::insert_maps(const BlockKey& key, const BlockMaps& maps) {
  if (!maps.registration.empty()) write_row(insert_map_, key, FeatureName{"registration"}, maps.registration);
  if (!maps.seat.empty()) write_row(insert_map_, key, FeatureName{"seat"}, maps.seat);
}

void Jobs::remember_noise(const BlockKey& key, const NoisePrint& noise) {
  if (noise.empty()) return;
  const NoisePrintBytes bytes = to_bytes(noise);
  remember_noise_.bind(1, key.slab_key).bind(2, number(key.station)).bind(3, number(key.attempt));
  remember_noise_.bind(4, std::span<const std::uint8_t>(bytes)).run();
  forget_noise_.run();
}

void Jobs::insert_items(const BlockKey& key, const Item* begin, const Item* end) {
  delete_items_.bind(1, key.slab_key).bind(2, number(key.station)).bind(3, number(key.attempt)).run();
  for (const Item* item = begin; item != end; ++item)
    write_row(insert_item_, key, Position{static_cast<std::uint8_t>(item - begin)}, *item);
}

// ---- results -----------------------------------------------------------------------------------------------------

void Jobs::delete_unseen_result(std::int64_t slab_key, std::uint16_t kind, std::uint16_t station,
                                std::uint16_t cmd_seq) {
  delete_unseen_result_.bind(1, slab_key).bind(2, number(kind)).bind(3, number(station)).bind(4, number(cmd_seq)).run();
}

void Jobs::insert_result(std::int64_t slab_key, bool is_repeat, const PlcResult& record) {
  if (!is_repeat) delete_unseen_result(slab_key, record.kind, record.station, record.cmd_seq);
  write_row(insert_result_, SlabKey{slab_key}, ResultState{is_repeat, false}, record);
  note_time(record.scan_utime_us);
}

void Jobs::operator()(const SlabJob& job) {
  const SlabKey key{job.slab_key};
  begin_chain();
  write_row(upsert_slab_result_, key, SlabEnd{job.ended_utime_us}, job.slab);
  for (std::size_t i = 0; i < job.slab.station_verdict.size(); ++i)
    write_row(upsert_station_result_, key,
              StationResult{static_cast<std::uint8_t>(i + 1), job.slab.station_verdict[i], job.slab.station_reason[i]});
  insert_items({job.slab_key, 0, 0}, job.slab.items.begin(), job.slab.items.end());
  delete_gauges_.bind(1, job.slab_key).run();
  for (const GaugeReading& reading : job.slab.gauges)
    write_row(insert_gauge_, key, Position{static_cast<std::uint8_t>(&reading - job.slab.gauges.begin())}, reading);
  close_newest_.bind(1, number(kDone))
      .bind(2, number(static_cast<std::uint16_t>(PlcCommand::slab_end)))
      .bind(3, number(static_cast<std::uint16_t>(PlcCommand::slab_abort)))
      .run();
  insert_result(job.slab_key, false, job.record);
  note_time(job.ended_utime_us);
  with_seals([&](Seals& seals) { seals.seal(job.slab_key); });
}

void Jobs::operator()(const AckJob& job) {
  acknowledge_.bind(1, number(job.res_seq)).bind(2, held_back_.first_id).bind(3, held_back_.last_id).run();
}

void Jobs::operator()(const ReportJob& job) {
  // A station record is repeated while its slab is open, a slab record after the slab has ended.
  std::int64_t slab_key = 0;
  Statement& newest = job.record.kind == 2 ? last_ended_ : newest_slab_;
  if (newest.step()) {
    slab_key = newest.integer(0);
    newest.reset();
  }
  insert_result(slab_key, true, job.record);
  const std::int64_t report = number(static_cast<std::uint16_t>(PlcCommand::report));
  close_newest_.bind(1, number(kDone)).bind(2, report).bind(3, report).run();
}

void Jobs::operator()(const SeenScanJob& job) {
  remember_scan(job.fingerprint);
}

void Jobs::operator()(const MeasuringJob& job) {
  set_measuring_.bind(1, job.slab_key)
      .bind(2, number(job.station))
      .bind(3, number(job.attempt))
      .bind(4, job.since_ns)
      .run();
}

// ---- restart -----------------------------------------------------------------------------------------------------

void Jobs::interrupt_unfinished() {
  struct Unfinished {
    std::uint16_t session;
    std::uint16_t cmd_seq;
    std::uint8_t station;
    std::int64_t slab_key;
    bool scan;
    bool newest_scan;  ///< newest SCAN of its station, and the slab is open
    bool abort;        ///< newest command of the open slab
  };
  std::vector<Unfinished> list;
  while (unfinished_.step()) {
    Unfinished& u = list.emplace_back();
    u.session = static_cast<std::uint16_t>(unfinished_.integer(0));
    u.cmd_seq = static_cast<std::uint16_t>(unfinished_.integer(1));
    u.station = static_cast<std::uint8_t>(unfinished_.integer(3));
    u.slab_key = unfinished_.integer(4);
    u.scan = unfinished_.integer(2) == kScan;
    u.newest_scan = u.scan && u.slab_key != 0 && unfinished_.integer(5) == 1;
    u.abort = u.slab_key != 0 && unfinished_.integer(6) == 1;
  }
  for (const Unfinished& u : list) {
    if (u.abort) continue;  // read_line() returns it to the station
    if (u.scan) remember_scan(kUnseenScan);
    if (holds(Rule::given_up_scan_recorded) && u.newest_scan)
      insert_failed_scan(u.slab_key, u.station, u.session, u.cmd_seq);
    close_command(u.session, u.cmd_seq, kInterrupted, false);
  }
}

void Jobs::insert_failed_scan(std::int64_t slab_key, std::uint8_t station, std::uint16_t session,
                              std::uint16_t cmd_seq) {
  scan_recorded_.bind(1, slab_key).bind(2, number(station)).bind(3, number(session)).bind(4, number(cmd_seq));
  if (!scan_recorded_.step()) return;
  const std::int64_t last = scan_recorded_.integer(1);
  const bool recorded = scan_recorded_.integer(2) > 0;
  scan_recorded_.reset();
  if (recorded || last >= 0xFF) return;
  Attempt attempt;
  attempt.slab_key = slab_key;
  attempt.station = station;
  attempt.number = static_cast<std::uint8_t>(last + 1);
  attempt.session = session;
  attempt.cmd_seq = cmd_seq;
  // The journal has the station only. If several arms may scan it, the arm is not known.
  const ArmChoice& choice = settings_.arms.of_station.at(station - 1U);
  attempt.by = {PartId{}, PartId{}};
  if (choice.size() == 1) {
    attempt.arm = choice[0];
    attempt.by = settings_.arms.list[choice[0]];
  }
  write_row(upsert_attempt_, attempt,
            AttemptState{StationPhase::failed, static_cast<std::uint16_t>(Code::interrupted), 0, ScanState::none});
}

}  // namespace slabd::storage
