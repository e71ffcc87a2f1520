// SPDX-License-Identifier: Apache-2.0
#include "storage/seals.h"

#include <sha256.h>
#include <sqlite3.h>
#include <algorithm>
#include <bit>
#include <string>
#include <vector>

namespace slabd::storage {

namespace {

// Form 1, schema version 1. Never change a form that seals were made with.
constexpr auto kForm1 = std::to_array<SealedTable>({
    {"slab",
     "slab_key, slab_id, slab_no, slab_type, stations, temperature_dk, age_h, mould, recipe, recipe_sha256, "
     "design_sha256, design_text, unconfirmed, guard, cell_mm, calibration_id, stations_id, scanner_id, software, "
     "T_base_slab_x, "
     "T_base_slab_y, T_base_slab_z, T_base_slab_qw, T_base_slab_qx, T_base_slab_qy, T_base_slab_qz, "
     "T_flange_scanner_x, T_flange_scanner_y, T_flange_scanner_z, T_flange_scanner_qw, T_flange_scanner_qx, "
     "T_flange_scanner_qy, T_flange_scanner_qz, began_utime_us, emulated",
     "", "slab_key"},
    {"slab_result",
     "slab_key, ended_utime_us, verdict, reason, fit_ok, fit_seats, fit_iterations, fit_rms_mm, "
     "fit_plain_rms_mm, fit_T_base_slab_x, fit_T_base_slab_y, fit_T_base_slab_z, fit_T_base_slab_qw, "
     "fit_T_base_slab_qx, fit_T_base_slab_qy, fit_T_base_slab_qz, fit_note",
     "", "slab_key"},
    {"station_result", "slab_key, station, verdict, reason", "", "station"},
    {"attempt",
     "slab_key, station, attempt, session, cmd_seq, T_base_flange_x, T_base_flange_y, T_base_flange_z, "
     "T_base_flange_qw, T_base_flange_qx, T_base_flange_qy, T_base_flange_qz, pose_spread_mm, pose_samples, "
     "scan_path, scan_points, scan_finite, scan_width, scan_height, scan_utime_us, settle_ms, acquire_ms, "
     "phase, code, scan_bytes, splice, splice_visits, T_base_reported_x, T_base_reported_y, T_base_reported_z, "
     "T_base_reported_qw, T_base_reported_qx, T_base_reported_qy, T_base_reported_qz, splice_off_mm, "
     "splice_off_rad, splice_calibration_mm, splice_calibration_rad, splice_robot_mm, splice_robot_rad, "
     "points_crc32c, asked, emulated, fingerprint, scanner_temperature_c, scanner_drift",
     "", "station, attempt"},
    {"block",
     "slab_key, station, attempt, verdict, reason, points_read, points_finite, isolated_removed, points_kept, "
     "registration_status, registration_iterations, share_associated, condition, registration_note, "
     "T_scanner_block_x, T_scanner_block_y, T_scanner_block_z, T_scanner_block_qw, T_scanner_block_qx, "
     "T_scanner_block_qy, T_scanner_block_qz, deviation_count, deviation_mean_mm, deviation_std_mm, "
     "within_sigma_1, within_sigma_2, within_sigma_3, within_sigma_4, within_sigma_5, within_sigma_6, "
     "seat_normal_x, seat_normal_y, seat_normal_z, seat_grid_points, seat_std_cells_mm, seat_flatness_mm, "
     "seat_flatness_min_zone_mm, seat_raw_low_mm, seat_raw_high_mm, observation_ok, observation_jaw_ok, "
     "observation_top_ok, p_base_x, p_base_y, p_base_z, n_base_x, n_base_y, n_base_z, jaw_outer_base_x, "
     "jaw_outer_base_y, jaw_outer_base_z, top_n_base_x, top_n_base_y, top_n_base_z, read_ms, denoise_ms, "
     "register_ms, extract_ms, total_ms, registration_noise_mm, registration_cov_11, registration_cov_12, "
     "registration_cov_13, registration_cov_14, registration_cov_15, registration_cov_16, registration_cov_21, "
     "registration_cov_22, registration_cov_23, registration_cov_24, registration_cov_25, registration_cov_26, "
     "registration_cov_31, registration_cov_32, registration_cov_33, registration_cov_34, registration_cov_35, "
     "registration_cov_36, registration_cov_41, registration_cov_42, registration_cov_43, registration_cov_44, "
     "registration_cov_45, registration_cov_46, registration_cov_51, registration_cov_52, registration_cov_53, "
     "registration_cov_54, registration_cov_55, registration_cov_56, registration_cov_61, registration_cov_62, "
     "registration_cov_63, registration_cov_64, registration_cov_65, registration_cov_66, seat_noise_factor, "
     "seat_flatness_noise_mm, defect_limit_mm, defect_cells, defect_area_mm2, defect_height_mm, defect_x_mm, "
     "defect_s_mm, seat_flatness_closed_mm, seat_flatness_raw_mm, seat_flatness_trimmed_mm, pores, pores_largest_mm, "
     "pores_deepest_mm, pores_share, pores_depth_max_mm, pores_share_max, sigma_p_x, sigma_p_y, sigma_p_z, "
     "sigma_jaw_x, sigma_jaw_y, sigma_jaw_z, sigma_n_x, "
     "sigma_n_y, sigma_n_z, sigma_top_n_x, sigma_top_n_y, sigma_top_n_z, step_x, step_y, step_z, lag_ratio",
     "", "station, attempt"},
    {"plane",
     "slab_key, station, attempt, feature, ok, doubt, normal_x, normal_y, normal_z, offset_mm, points, inliers, "
     "inlier_fraction, std_mm, iterations, centroid_x, centroid_y, centroid_z, sigma_offset_mm, cov_normal_11, "
     "cov_normal_12, cov_normal_13, cov_normal_21, cov_normal_22, cov_normal_23, cov_normal_31, cov_normal_32, "
     "cov_normal_33",
     "", "station, attempt, feature"},
    {"casing",
     "slab_key, station, attempt, feature, ok, doubt, centre_x, centre_y, centre_z, radius_mm, height_mm, "
     "edge_points, rim_points, edge_rms_mm, inlier_fraction, rim_std_mm, sigma_height_mm, cov_circle_11, "
     "cov_circle_12, cov_circle_13, cov_circle_21, cov_circle_22, cov_circle_23, cov_circle_31, cov_circle_32, "
     "cov_circle_33",
     "", "station, attempt, feature"},
    {"finding",
     "slab_key, station, attempt, position, kind, face, x_mm, s_mm, z_mm, length_mm, width_mm, depth_mm, "
     "area_mm2, volume_mm3",
     "", "station, attempt, position"},
    {"edge", "slab_key, station, attempt, position, face, face_to, radius_mm, chamfer_mm, nominal_mm, n", "",
     "station, attempt, position"},
    {"map", "slab_key, station, attempt, feature, columns, rows, cell_mm, step_mm, bytes", "",
     "station, attempt, feature"},
    {"item",
     "slab_key, station, attempt, position, id, verdict, required, from_station, to_station, value, nominal, "
     "lower, upper, U, beside, measured, budget_fit, budget_noise, budget_scanner, budget_registration, "
     "budget_calibration, budget_robot, budget_reference, budget_thermal, budget_gauge",
     "", "station, attempt, position"},
    {"gauge_value",
     "slab_key, position, gauge, source, unit, state, value, u, u_master, seq, slab_no, utime_us, age_s, "
     "check_utime_us, check_deviation",
     "", "position"},
    {"result",
     "id, slab_key, is_repeat, res_seq, kind, cmd_seq, station, slab_no, verdict, reason, fail_mask, "
     "open_mask, flatness_mm, std_mm, deviation_1, deviation_2, deviation_3, deviation_4, deviation_5, "
     "deviation_6, deviation_7, deviation_8, deviation_9, deviation_10, deviation_11, deviation_12, "
     "deviation_13, deviation_14, points, scan_utime_us, emulated",
     " AND is_repeat = 0", "id"},
});

// Form 2: the robots and scanners of a line with several, and the tie between them.
constexpr std::string_view kSlabOfForm2 =
    "slab_key, slab_id, slab_no, slab_type, stations, temperature_dk, age_h, mould, recipe, recipe_sha256, "
    "design_sha256, design_text, unconfirmed, guard, cell_mm, calibration_id, stations_id, scanner_id, software, "
    "T_base_slab_x, "
    "T_base_slab_y, T_base_slab_z, T_base_slab_qw, T_base_slab_qx, T_base_slab_qy, T_base_slab_qz, "
    "T_flange_scanner_x, T_flange_scanner_y, T_flange_scanner_z, T_flange_scanner_qw, T_flange_scanner_qx, "
    "T_flange_scanner_qy, T_flange_scanner_qz, began_utime_us, emulated, tie_id";
constexpr SealedTable kArmsOfForm2 = {
    "slab_arm",
    "slab_key, arm, robot, scanner, calibration_id, stations_id, scanner_id, T_flange_scanner_x, T_flange_scanner_y, "
    "T_flange_scanner_z, T_flange_scanner_qw, T_flange_scanner_qx, T_flange_scanner_qy, T_flange_scanner_qz",
    "", "arm"};
constexpr std::string_view kAttemptOfForm2 =
    "slab_key, station, attempt, session, cmd_seq, T_base_flange_x, T_base_flange_y, T_base_flange_z, "
    "T_base_flange_qw, T_base_flange_qx, T_base_flange_qy, T_base_flange_qz, pose_spread_mm, pose_samples, "
    "scan_path, scan_points, scan_finite, scan_width, scan_height, scan_utime_us, settle_ms, acquire_ms, "
    "phase, code, scan_bytes, splice, splice_visits, T_base_reported_x, T_base_reported_y, T_base_reported_z, "
    "T_base_reported_qw, T_base_reported_qx, T_base_reported_qy, T_base_reported_qz, splice_off_mm, "
    "splice_off_rad, splice_calibration_mm, splice_calibration_rad, splice_robot_mm, splice_robot_rad, "
    "points_crc32c, asked, emulated, fingerprint, scanner_temperature_c, scanner_drift, arm, robot, "
    "scanner, splice_tied, T_base_robot_x, T_base_robot_y, T_base_robot_z, T_base_robot_qw, T_base_robot_qx, "
    "T_base_robot_qy, T_base_robot_qz";
constexpr std::string_view kItemOfForm2 =
    "slab_key, station, attempt, position, id, verdict, required, from_station, to_station, value, nominal, "
    "lower, upper, U, beside, measured, budget_fit, budget_noise, budget_scanner, budget_registration, "
    "budget_calibration, budget_robot, budget_reference, budget_thermal, budget_gauge, budget_tie";
constexpr auto kForm2 = [] {
  std::array<SealedTable, kForm1.size() + 1> form{};
  std::size_t count = 0;
  for (const SealedTable& table : kForm1) {
    form[count] = table;
    if (table.name == "slab") form[count].columns = kSlabOfForm2;
    if (table.name == "attempt") form[count].columns = kAttemptOfForm2;
    if (table.name == "item") form[count].columns = kItemOfForm2;
    ++count;
    if (table.name == "slab") form[count++] = kArmsOfForm2;
  }
  return form;
}();

constexpr SealedTable kDecisions = {"disposition", "slab_key, n, utime_us, who, decision, reason, authority, second",
                                    "", "n"};
constexpr SealedTable kCare = {"care", "seq, what, slab_key, result_id, res_seq, source, who, why, utime_us", "",
                               "seq"};

std::array<std::uint8_t, 8> big_endian(std::uint64_t value) {
  std::array<std::uint8_t, 8> bytes{};
  for (std::size_t i = 0; i < bytes.size(); ++i) bytes.at(i) = static_cast<std::uint8_t>(value >> (56U - 8U * i));
  return bytes;
}

void hash_rows(Statement& rows, const SealedTable& table, Digest& digest) {
  digest.text(table.name);
  const int columns = sqlite3_column_count(rows.handle());
  std::int64_t count = 0;
  for (; rows.step(); ++count)
    for (int i = 0; i < columns; ++i) digest.column(rows, i);
  digest.integer(count);
}

}  // namespace

struct Digest::Sum {
  SHA2_CTX context;
};

Digest::Digest() : sum_(std::make_unique<Sum>()) {
  SHA256Init(&sum_->context);
}

Digest::~Digest() = default;

void Digest::put(const void* data, std::size_t size) {
  SHA256Update(&sum_->context, static_cast<const std::uint8_t*>(data), size);
}

Digest& Digest::bytes(std::span<const std::uint8_t> value) {
  put(value.data(), value.size());
  return *this;
}

Digest& Digest::integer(std::int64_t value) {
  return bytes(big_endian(static_cast<std::uint64_t>(value)));
}

Digest& Digest::text(std::string_view value) {
  integer(static_cast<std::int64_t>(value.size()));
  put(value.data(), value.size());
  return *this;
}

Digest& Digest::column(const Statement& row, int column) {
  sqlite3_stmt* const at = row.handle();
  const int type = sqlite3_column_type(at, column);
  // Type and number (or length) are hashed in one call, because most columns are numbers.
  std::array<std::uint8_t, 9> head{};
  const auto put_head = [&](char letter, std::uint64_t value) {
    head[0] = static_cast<std::uint8_t>(letter);
    const std::array<std::uint8_t, 8> number = big_endian(value);
    std::copy(number.begin(), number.end(), head.begin() + 1);
    put(head.data(), head.size());
  };
  switch (type) {
    case SQLITE_INTEGER: put_head('I', static_cast<std::uint64_t>(sqlite3_column_int64(at, column))); break;
    case SQLITE_FLOAT: put_head('R', std::bit_cast<std::uint64_t>(sqlite3_column_double(at, column))); break;
    case SQLITE_NULL: put("N", 1); break;
    default: {
      const void* const data = type == SQLITE_TEXT ? sqlite3_column_text(at, column) : sqlite3_column_blob(at, column);
      const auto size = static_cast<std::size_t>(sqlite3_column_bytes(at, column));
      put_head(type == SQLITE_TEXT ? 'T' : 'B', size);
      if (size > 0) put(data, size);
    }
  }
  return *this;
}

Sha256 Digest::take() {
  Sha256 sum{};
  SHA256Final(sum.data(), &sum_->context);
  SHA256Init(&sum_->context);
  return sum;
}

std::span<const SealedTable> sealed_tables(std::int64_t form) {
  if (form == 1) return kForm1;
  if (form == 2) return kForm2;
  return {};
}

SlabDigests::SlabDigests(Connection& db, std::int64_t form, SealStatements statements)
    : db_(db), tables_(sealed_tables(form)), statements_(statements), rows_(tables_.size()), digests_(tables_.size()) {}

const std::vector<Sha256>& SlabDigests::of(std::int64_t slab_key) {
  for (std::size_t i = 0; i < tables_.size(); ++i) {
    const SealedTable& table = tables_[i];
    if (rows_[i] == nullptr)
      rows_[i] = std::make_unique<Statement>(
          db_, "SELECT " + std::string(table.columns) + " FROM " + std::string(table.name) + " WHERE slab_key = ?1" +
                   std::string(table.where) + " ORDER BY " + std::string(table.order));
    rows_[i]->reset();  // an error may have ended the previous call
    rows_[i]->bind(1, slab_key);
    hash_rows(*rows_[i], table, digest_);
    digests_[i] = digest_.take();
    if (statements_ == SealStatements::drop) rows_[i].reset();
  }
  return digests_;
}

Sha256 digest_of(const std::vector<Sha256>& tables) {
  Digest digest;
  for (const Sha256& table : tables) digest.bytes(table);
  return digest.take();
}

Sha256 rows_digest(Connection& db, const SealedTable& table, const char* key, std::int64_t value) {
  Statement rows(db, "SELECT " + std::string(table.columns) + " FROM " + std::string(table.name) + " WHERE " + key +
                         " = ?1 ORDER BY " + std::string(table.order));
  rows.bind(1, value);
  Digest digest;
  hash_rows(rows, table, digest);
  return digest.take();
}

Sha256 decisions_digest(Connection& db, std::int64_t slab_key) {
  return rows_digest(db, kDecisions, "slab_key", slab_key);
}

Sha256 care_digest(Connection& db, std::int64_t seq) {
  return rows_digest(db, kCare, "seq", seq);
}

namespace {

constexpr std::string_view kEntry = "slabd seal 1";

std::span<const std::uint8_t> bytes_of(std::string_view text) {
  // An empty view may contain a null pointer.
  return {reinterpret_cast<const std::uint8_t*>(text.empty() ? "" : text.data()), text.size()};
}

Sha256 sha_at(const Statement& row, int column) {
  Sha256 sum{};
  const std::span<const std::uint8_t> bytes = row.bytes(column);
  if (bytes.size() != sum.size()) row.refuse(column, "is not a SHA-256");
  std::copy(bytes.begin(), bytes.end(), sum.begin());
  return sum;
}

}  // namespace

Sha256 seal_of(const Sha256& previous, const SealEntry& entry) {
  Digest digest;
  return digest.text(kEntry)
      .bytes(previous)
      .integer(entry.seq)
      .text(entry.kind)
      .integer(entry.form)
      .integer(entry.about)
      .integer(entry.slab_no)
      .text(entry.slab_id)
      .integer(entry.utime_us)
      .bytes(entry.rows)
      .take();
}

Seals::Seals(Connection& db, SealStatements statements)
    : db_(db),
      digests_(db, kSealForm, statements),
      head_(db, "SELECT seq, sha256 FROM slab_seal ORDER BY seq DESC LIMIT 1"),
      insert_(db,
              "INSERT INTO slab_seal (seq, kind, form, about, slab_no, slab_id, utime_us, rows_sha256, sha256, tables) "
              "VALUES (?1, ?2, ?3, ?4, ?5, ?6, ?7, ?8, ?9, ?10)"),
      newest_of_(db,
                 "SELECT kind, form, rows_sha256 FROM slab_seal WHERE about = ?1 AND kind IN ('slab', 'reopened', "
                 "'pruned') ORDER BY seq DESC LIMIT 1"),
      slab_(db, "SELECT slab_no, slab_id FROM slab WHERE slab_key = ?1"),
      ended_(db, "SELECT ended_utime_us FROM slab_result WHERE slab_key = ?1"),
      now_(db, "SELECT newest_utime_us FROM line") {}

void Seals::append(SealEntry& entry, std::string_view tables) {
  Sha256 previous{};
  entry.seq = 1;
  if (head_.step()) {
    entry.seq = head_.integer(0) + 1;
    previous = sha_at(head_, 1);
    head_.reset();
  }
  const Sha256 sum = seal_of(previous, entry);
  insert_.bind(1, entry.seq)
      .bind(2, std::string_view(entry.kind))
      .bind(3, entry.form)
      .bind(4, entry.about)
      .bind(5, entry.slab_no)
      .bind(6, std::string_view(entry.slab_id))
      .bind(7, entry.utime_us)
      .bind(8, std::span<const std::uint8_t>(entry.rows))
      .bind(9, std::span<const std::uint8_t>(sum))
      .bind(10, bytes_of(tables))
      .run();
}

SealEntry Seals::newest_of(std::int64_t slab_key) {
  SealEntry entry;
  if (newest_of_.bind(1, slab_key).step()) {
    entry.kind = newest_of_.stored_text(0);
    entry.form = newest_of_.integer(1);
    entry.rows = sha_at(newest_of_, 2);
  }
  newest_of_.reset();
  return entry;
}

SealEntry Seals::about_slab(const char* kind, std::int64_t slab_key) {
  SealEntry entry;
  entry.kind = kind;
  entry.about = slab_key;
  if (slab_.bind(1, slab_key).step()) {
    entry.slab_no = slab_.integer(0);
    entry.slab_id = slab_.stored_text(1);
  }
  slab_.reset();
  if (now_.step()) entry.utime_us = now_.integer(0);
  now_.reset();
  return entry;
}

void Seals::begin() {
  const bool is_there = head_.step();
  head_.reset();
  if (is_there) return;
  SealEntry entry = about_slab("begun", 0);
  entry.about = db_.integer("SELECT coalesce(max(slab_key), 0) FROM slab_result");
  append(entry, {});
  const auto all = [this](const char* sql) {
    std::vector<std::int64_t> keys;
    for (Statement rows(db_, sql); rows.step();) keys.push_back(rows.integer(0));
    return keys;
  };
  for (const std::int64_t seq : all("SELECT seq FROM care ORDER BY seq")) note_care(seq);
  for (const std::int64_t key : all("SELECT DISTINCT slab_key FROM disposition ORDER BY slab_key")) note_decision(key);
}

void Seals::seal(std::int64_t slab_key) {
  begin();
  SealEntry entry = about_slab("slab", slab_key);
  if (ended_.bind(1, slab_key).step()) entry.utime_us = ended_.integer(0);
  ended_.reset();
  const std::vector<Sha256>& tables = digests_.of(slab_key);
  entry.rows = digest_of(tables);
  const SealEntry last = newest_of(slab_key);
  if (last.kind == "slab" && last.form == kSealForm && last.rows == entry.rows) return;
  append(entry, {reinterpret_cast<const char*>(tables.data()), tables.size() * sizeof(Sha256)});
}

void Seals::seal_if_ended(std::int64_t slab_key) {
  const bool ended = ended_.bind(1, slab_key).step();
  ended_.reset();
  // If the slab's seal was deleted, a late change must not replace it.
  if (ended && newest_of(slab_key).kind == "slab") seal(slab_key);
}

void Seals::reopen(std::int64_t slab_key) {
  if (newest_of(slab_key).kind != "slab") return;
  SealEntry entry = about_slab("reopened", slab_key);
  append(entry, {});
}

void Seals::prune(std::int64_t slab_key) {
  begin();
  SealEntry entry = about_slab("pruned", slab_key);
  append(entry, {});
  Statement(db_, "UPDATE slab_seal SET tables = x'' WHERE about = ?1 AND kind = 'slab'").bind(1, slab_key).run();
}

void Seals::note_care(std::int64_t seq) {
  begin();
  SealEntry entry = about_slab("care", 0);
  entry.about = seq;
  entry.rows = care_digest(db_, seq);
  append(entry, {});
}

void Seals::note_decision(std::int64_t slab_key) {
  begin();
  SealEntry entry = about_slab("decided", slab_key);
  entry.rows = decisions_digest(db_, slab_key);
  append(entry, {});
}

}  // namespace slabd::storage
