// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <concepts>
#include <cstdint>
#include <string>
#include <string_view>
#include <type_traits>
#include <utility>
#include <vector>

#include "base/base.h"
#include "base/jobs.h"
#include "storage/sqlite.h"

/// How the project's structs become rows. Each struct is described once, by `columns(visitor, struct)`: a list of
/// column names and members. The same list makes the INSERT, the SELECT, the binding and the reading, so the four
/// cannot drift apart; a list that does not match schema.sql fails when the statements are prepared.
///
/// Numbers keep their bits (NaN is NULL; minus zero becomes zero, as SQLite stores REAL). Enumerations are words.
namespace slabd::storage {

template <typename R, typename T>
concept RowOf = std::same_as<std::remove_const_t<R>, T>;

// ---- parts of rows that exist only here --------------------------------------------------------------------------

struct BlockKey {
  std::int64_t slab_key = 0;
  std::uint8_t station = 0;  ///< 0: of the slab itself
  std::uint8_t attempt = 0;
};
struct SlabKey {
  std::int64_t slab_key = 0;
};
struct FeatureName {
  FixedString<16> feature;
};
struct ItemPosition {
  std::uint8_t position = 0;
};
enum class ScanState : std::uint8_t { none, kept, deleting, deleted };
struct AttemptState {
  StationPhase phase = StationPhase::acquired;
  std::uint16_t code = 0;
  std::int64_t scan_bytes = 0;
  ScanState scan_state = ScanState::none;
};
struct SlabEnd {
  std::int64_t ended_utime_us = 0;
};
struct StationResult {
  std::uint8_t station = 0;
  Verdict verdict = Verdict::none;
  std::uint16_t reason = 0;
};
struct ResultState {
  bool is_repeat = false;
  bool acknowledged = false;
};
struct CommandState {
  std::uint16_t status = 0;
  bool acquired = false;
};

// ---- column lists ------------------------------------------------------------------------------------------------

template <typename V, RowOf<BlockKey> R>
void columns(V& v, R& r) {
  v("slab_key", r.slab_key);
  v("station", r.station);
  v("attempt", r.attempt);
}

template <typename V, RowOf<SlabKey> R>
void columns(V& v, R& r) {
  v("slab_key", r.slab_key);
}

template <typename V, RowOf<FeatureName> R>
void columns(V& v, R& r) {
  v("feature", r.feature);
}

template <typename V, RowOf<ItemPosition> R>
void columns(V& v, R& r) {
  v("position", r.position);
}

template <typename V, RowOf<SlabHeader> R>
void columns(V& v, R& r) {
  v("slab_key", r.key);
  v("slab_id", r.slab_id);
  v("slab_no", r.slab_no);
  v("slab_type", r.slab_type);
  v("stations", r.stations);
  v("temperature_dk", r.temperature_dk);
  v("age_h", r.age_h);
  v("recipe", r.recipe);
  v("recipe_sha256", r.recipe_sha256);
  v("unconfirmed", r.unconfirmed);
  v("guard", r.guard);
  v("calibration_id", r.calibration_id);
  v("software", r.software);
  v("T_base_slab", r.T_base_slab);
  v("T_flange_scanner", r.T_flange_scanner);
  v("began_utime_us", r.began_utime_us);
}

template <typename V, RowOf<SlabEnd> R>
void columns(V& v, R& r) {
  v("ended_utime_us", r.ended_utime_us);
}

template <typename V, RowOf<SlabResult> R>
void columns(V& v, R& r) {
  v("verdict", r.verdict);
  v("reason", r.reason);
  v("fit_ok", r.fit.ok);
  v("fit_seats", r.fit.seats);
  v("fit_iterations", r.fit.iterations);
  v("fit_rms_mm", r.fit.rms_mm);
  v("fit_plain_rms_mm", r.fit.plain_rms_mm);
  v("fit_T_base_slab", r.fit.T_base_slab);
  v("fit_note", r.fit.note);
}

template <typename V, RowOf<StationResult> R>
void columns(V& v, R& r) {
  v("station", r.station);
  v("verdict", r.verdict);
  v("reason", r.reason);
}

template <typename V, RowOf<CommandJob> R>
void columns(V& v, R& r) {
  v("session", r.session);
  v("cmd_seq", r.cmd_seq);
  v("command", r.command);
  v("station", r.station);
  v("utime_us", r.utime_us);
}

template <typename V, RowOf<CommandState> R>
void columns(V& v, R& r) {
  v("status", r.status);
  v("acquired", r.acquired);
}

template <typename V, RowOf<Attempt> R>
void columns(V& v, R& r) {
  v("slab_key", r.slab_key);
  v("station", r.station);
  v("attempt", r.number);
  v("session", r.session);
  v("cmd_seq", r.cmd_seq);
  v("T_base_flange", r.T_base_flange);
  v("pose_spread_mm", r.pose_spread_mm);
  v("pose_samples", r.pose_samples);
  v("scan_path", r.scan_path);
  v("scan_points", r.shape.points);
  v("scan_finite", r.shape.finite);
  v("scan_width", r.shape.width);
  v("scan_height", r.shape.height);
  v("scan_utime_us", r.scan_utime_us);
  v("settle_ms", r.settle_ms);
  v("acquire_ms", r.acquire_ms);
}

template <typename V, RowOf<AttemptState> R>
void columns(V& v, R& r) {
  v("phase", r.phase);
  v("code", r.code);
  v("scan_bytes", r.scan_bytes);
  v("scan_state", r.scan_state);
}

/// What a block has beside its planes, casings and items.
template <typename V, RowOf<BlockResult> R>
void columns(V& v, R& r) {
  v("verdict", r.verdict);
  v("reason", r.reason);
  v("points_read", r.scan.points_read);
  v("points_finite", r.scan.points_finite);
  v("isolated_removed", r.scan.isolated_removed);
  v("points_kept", r.scan.points_kept);
  v("registration_status", r.registration.status);
  v("registration_iterations", r.registration.iterations);
  v("share_associated", r.registration.share_associated);
  v("condition", r.registration.condition);
  v("registration_note", r.registration.note);
  v("T_scanner_block", r.registration.T_scanner_block);
  v("deviation_count", r.registration.deviation.count);
  v("deviation_mean_mm", r.registration.deviation.mean_mm);
  v("deviation_std_mm", r.registration.deviation.std_mm);
  v("within_sigma", r.registration.deviation.within_sigma);
  v("seat_normal", r.seat.normal_datum);
  v("seat_grid_points", r.seat.grid_points);
  v("seat_std_cells_mm", r.seat.std_cells_mm);
  v("seat_flatness_mm", r.seat.flatness_mm);
  v("seat_flatness_min_zone_mm", r.seat.flatness_min_zone_mm);
  v("seat_raw_low_mm", r.seat.raw_low_mm);
  v("seat_raw_high_mm", r.seat.raw_high_mm);
  v("observation_ok", r.observation.ok);
  v("observation_jaw_ok", r.observation.jaw_ok);
  v("observation_top_ok", r.observation.top_ok);
  v("p_base", r.observation.p_base);
  v("n_base", r.observation.n_base);
  v("jaw_outer_base", r.observation.jaw_outer_base);
  v("top_n_base", r.observation.top_n_base);
  v("read_ms", r.times.read_ms);
  v("denoise_ms", r.times.denoise_ms);
  v("register_ms", r.times.register_ms);
  v("extract_ms", r.times.extract_ms);
  v("total_ms", r.times.total_ms);
}

template <typename V, RowOf<PlaneFit> R>
void columns(V& v, R& r) {
  v("ok", r.ok);
  v("normal", r.normal);
  v("offset_mm", r.offset_mm);
  v("points", r.points);
  v("inliers", r.inliers);
  v("inlier_fraction", r.inlier_fraction);
  v("std_mm", r.std_mm);
  v("iterations", r.iterations);
}

template <typename V, RowOf<CasingFeature> R>
void columns(V& v, R& r) {
  v("ok", r.ok);
  v("centre", r.centre);
  v("radius_mm", r.radius_mm);
  v("height_mm", r.height_mm);
  v("edge_points", r.edge_points);
  v("rim_points", r.rim_points);
}

template <typename V, RowOf<Item> R>
void columns(V& v, R& r) {
  v("id", r.id);
  v("verdict", r.verdict);
  v("required", r.required);
  v("from_station", r.station);
  v("to_station", r.station_to);
  v("value", r.value);
  v("nominal", r.nominal);
  v("lower", r.lower);
  v("upper", r.upper);
  v("U", r.U);
  v("beside", r.beside);
}

template <typename V, RowOf<ResultState> R>
void columns(V& v, R& r) {
  v("is_repeat", r.is_repeat);
  v("acknowledged", r.acknowledged);
}

template <typename V, RowOf<PlcResult> R>
void columns(V& v, R& r) {
  v("res_seq", r.res_seq);
  v("kind", r.kind);
  v("cmd_seq", r.cmd_seq);
  v("station", r.station);
  v("slab_no", r.slab_no);
  v("verdict", r.verdict);
  v("reason", r.reason);
  v("fail_mask", r.fail_mask);
  v("open_mask", r.open_mask);
  v("flatness_mm", r.flatness_mm);
  v("std_mm", r.std_mm);
  v("deviation", r.deviation);
  v("points", r.points);
  v("scan_utime_us", r.scan_utime_us);
}

// ---- words -------------------------------------------------------------------------------------------------------

[[nodiscard]] std::string_view word(Verdict verdict);
[[nodiscard]] std::string_view word(RegistrationStatus status);
[[nodiscard]] std::string_view word(ItemId id);
[[nodiscard]] std::string_view word(StationPhase phase);
[[nodiscard]] std::string_view word(ScanState state);
/// False when no value has this word.
[[nodiscard]] bool from_word(std::string_view text, Verdict& out);
[[nodiscard]] bool from_word(std::string_view text, RegistrationStatus& out);
[[nodiscard]] bool from_word(std::string_view text, ItemId& out);
[[nodiscard]] bool from_word(std::string_view text, StationPhase& out);
[[nodiscard]] bool from_word(std::string_view text, ScanState& out);

// ---- visitors ----------------------------------------------------------------------------------------------------

/// Collects column names; a pose, a vector or an array is several columns.
class Names {
 public:
  template <typename T>
  void operator()(std::string_view name, const T&) {
    list_.emplace_back(name);
  }
  void operator()(std::string_view name, const Pose&) { several(name, {"x", "y", "z", "qw", "qx", "qy", "qz"}); }
  void operator()(std::string_view name, const Vec3&) { several(name, {"x", "y", "z"}); }
  template <std::size_t N>
  void operator()(std::string_view name, const std::array<double, N>&) {
    for (std::size_t i = 1; i <= N; ++i) list_.push_back(std::string(name) + "_" + std::to_string(i));
  }
  [[nodiscard]] const std::vector<std::string>& list() const { return list_; }

 private:
  void several(std::string_view name, std::initializer_list<const char*> suffixes) {
    for (const char* suffix : suffixes) list_.push_back(std::string(name) + "_" + suffix);
  }
  std::vector<std::string> list_;
};

/// Binds members to consecutive parameters.
class Bind {
 public:
  Bind(Statement& statement, int first) : statement_(statement), index_(first) {}

  template <typename T>
  void operator()(std::string_view, const T& value) {
    put(value);
  }
  [[nodiscard]] int next_index() const { return index_; }

 private:
  void put(double value) { statement_.bind(index_++, value); }
  void put(const Vec3& v) {
    for (const double x : {v.x(), v.y(), v.z()}) put(x);
  }
  void put(const Pose& pose) {
    for (const double x : pose.to_array()) put(x);
  }
  template <std::size_t N>
  void put(const std::array<double, N>& values) {
    for (const double x : values) put(x);
  }
  template <std::size_t N>
  void put(const FixedString<N>& text) {
    statement_.bind(index_++, text.view());
  }
  template <std::integral T>
  void put(T value) {
    statement_.bind(index_++, static_cast<std::int64_t>(value));
  }
  template <typename E>
  requires std::is_enum_v<E>
  void put(E value) { statement_.bind(index_++, word(value)); }

  Statement& statement_;
  int index_;
};

/// Reads members from consecutive columns. A value that does not fit its member throws: the row was not written by
/// this program.
class Fetch {
 public:
  Fetch(Statement& statement, int first) : statement_(statement), column_(first) {}

  template <typename T>
  void operator()(std::string_view, T& value) {
    take(value);
  }
  [[nodiscard]] int next_column() const { return column_; }

 private:
  void take(double& value) { value = statement_.real(column_++); }
  void take(Vec3& v) {
    for (int i = 0; i < 3; ++i) take(v[i]);
  }
  void take(Pose& pose) {
    // Not Pose::from_array: normalising again would change the last bits.
    std::array<double, 7> a{};
    take(a);
    pose.translation_mm = Vec3(a[0], a[1], a[2]);
    pose.rotation = Quat(a[3], a[4], a[5], a[6]);
  }
  template <std::size_t N>
  void take(std::array<double, N>& values) {
    for (double& x : values) take(x);
  }
  template <std::size_t N>
  void take(FixedString<N>& text) {
    const std::string_view stored = statement_.text(column_);
    if (stored.size() > N) statement_.refuse(column_, "is longer than " + std::to_string(N) + " bytes");
    text.assign(stored);
    ++column_;
  }
  void take(bool& value) {
    const std::int64_t stored = statement_.integer(column_);
    if (stored != 0 && stored != 1) statement_.refuse(column_, "is neither 0 nor 1");
    value = stored == 1;
    ++column_;
  }
  template <std::integral T>
  void take(T& value) {
    const std::int64_t stored = statement_.integer(column_);
    if (!std::in_range<T>(stored)) statement_.refuse(column_, "is out of range: " + std::to_string(stored));
    value = static_cast<T>(stored);
    ++column_;
  }
  template <typename E>
  requires std::is_enum_v<E>
  void take(E& value) {
    if (!from_word(statement_.text(column_), value))
      statement_.refuse(column_, "holds an unknown word \"" + std::string(statement_.text(column_)) + "\"");
    ++column_;
  }

  Statement& statement_;
  int column_;
};

// ---- SQL ---------------------------------------------------------------------------------------------------------

[[nodiscard]] std::string joined(const std::vector<std::string>& names, std::string_view separator);
/// "INSERT INTO table (a, b) VALUES (?1, ?2)"
[[nodiscard]] std::string insert_text(std::string_view table, const std::vector<std::string>& names);
/// The same, replacing the other columns of the row that has the same `key`.
[[nodiscard]] std::string upsert_text(std::string_view table, const std::vector<std::string>& names,
                                      const std::vector<std::string>& key);

/// Column names of a row that consists of these parts.
template <typename... Parts>
[[nodiscard]] std::vector<std::string> names_of() {
  Names names;
  (..., columns(names, static_cast<const Parts&>(Parts{})));
  return names.list();
}

/// Binds the parts of a row from parameter 1 on, and runs the statement.
template <typename... Parts>
void write_row(Statement& statement, const Parts&... parts) {
  Bind bind(statement, 1);
  (..., columns(bind, parts));
  statement.run();
}

/// Reads the parts of the current row from column `first` on; returns the column after them.
template <typename... Parts>
int read_row(Statement& statement, int first, Parts&... parts) {
  Fetch fetch(statement, first);
  (..., columns(fetch, parts));
  return fetch.next_column();
}

}  // namespace slabd::storage
