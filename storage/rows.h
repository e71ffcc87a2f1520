// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <array>
#include <concepts>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <type_traits>
#include <utility>
#include <vector>

#include "base/base.h"
#include "base/jobs.h"
#include "base/record_fields.h"
#include "storage/files/sqlite.h"

/// Mapping of the project's structs to rows. `columns(visitor, struct)` lists column names and members. It uses the
/// field list of the struct (base/record_fields.h); only structs with other column names have their own list here.
/// INSERT, SELECT, binding and reading use the same list, so they cannot differ. A list that does not match schema.sql
/// fails when the statements are prepared.
namespace slabd::storage {

// Visitors of a list of columns: names for the SQL text, binding, reading.
//
// Numbers are stored bit by bit (NaN is NULL; minus zero becomes zero, as SQLite stores REAL). An absent integer is
// NULL. Enumerations are stored as words.

enum class ScanState : std::uint8_t;

/// A covariance: square and stored completely, so that its bits are restored even if it is symmetric only to rounding.
template <int N>
using Square = Eigen::Matrix<double, N, N, Eigen::DontAlign>;

// ---- words -------------------------------------------------------------------------------------------------------

/// Word for a value of an enumeration in the database.
template <typename E>
[[nodiscard]] std::string_view word(E value) {
  return name(value);
}
[[nodiscard]] std::string_view word(ItemId id);
[[nodiscard]] std::string_view word(StationPhase phase);
[[nodiscard]] std::string_view word(ScanState state);

/// Number of values of an enumeration, which are numbered from 0.
template <typename E>
inline constexpr std::size_t kValues = 0;
template <>
inline constexpr std::size_t kValues<Verdict> = 6;
template <>
inline constexpr std::size_t kValues<RegistrationStatus> = 5;
template <>
inline constexpr std::size_t kValues<ItemId> = kItemCount;
template <>
inline constexpr std::size_t kValues<StationPhase> = 5;
template <>
inline constexpr std::size_t kValues<ScanState> = 4;
template <>
inline constexpr std::size_t kValues<SpliceSource> = kSpliceSources;
template <>
inline constexpr std::size_t kValues<CalibrationKind> = kCalibrationKinds;
template <>
inline constexpr std::size_t kValues<PlaneDoubt> = kPlaneDoubts;
template <>
inline constexpr std::size_t kValues<CasingDoubt> = kCasingDoubts;
template <>
inline constexpr std::size_t kValues<ItemUnit> = 2;
template <>
inline constexpr std::size_t kValues<GaugeState> = kGaugeStates;
template <>
inline constexpr std::size_t kValues<FindingKind> = kFindingKinds;
template <>
inline constexpr std::size_t kValues<FindingFace> = kFindingFaces;
template <>
inline constexpr std::size_t kValues<EdgeFace> = kEdgeFaces;

/// Sets `out` to the value with this word; false if there is none.
template <typename E>
[[nodiscard]] bool from_word(std::string_view text, E& out) {
  static_assert(kValues<E> > 0, "declare its number of values");
  for (std::size_t i = 0; i < kValues<E>; ++i) {
    if (word(static_cast<E>(i)) != text) continue;
    out = static_cast<E>(i);
    return true;
  }
  return false;
}

// ---- visitors ----------------------------------------------------------------------------------------------------

/// Collects column names; a pose, a vector, a matrix or an array has several columns.
class Names {
 public:
  template <typename T>
  void operator()(std::string_view name, const T&) {
    list_.emplace_back(name);
  }
  void operator()(std::string_view name, const Pose&) { several(name, {"x", "y", "z", "qw", "qx", "qy", "qz"}); }
  /// A vector's columns are named by the axis instead of the unit: step_mm is step_x, step_y, step_z.
  void operator()(std::string_view name, const Vec3&) {
    for (const std::string_view unit : {"_mm", "_rad"})
      if (name.ends_with(unit)) name.remove_suffix(unit.size());
    several(name, {"x", "y", "z"});
  }
  template <std::size_t N>
  void operator()(std::string_view name, const std::array<double, N>&) {
    for (std::size_t i = 1; i <= N; ++i) list_.push_back(std::string(name) + "_" + std::to_string(i));
  }
  template <int N>
  requires(N > 1) void operator()(std::string_view name, const Square<N>&) {
    for (int row = 1; row <= N; ++row)
      for (int column = 1; column <= N; ++column)
        list_.push_back(std::string(name) + "_" + std::to_string(row) + std::to_string(column));
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
  template <int N>
  requires(N > 1) void put(const Square<N>& m) {
    for (int row = 0; row < N; ++row)
      for (int column = 0; column < N; ++column) put(m(row, column));
  }
  template <std::size_t N>
  void put(const FixedString<N>& text) {
    statement_.bind(index_++, text.view());
  }
  template <std::size_t N>
  void put(const FixedVector<std::uint8_t, N>& bytes) {
    statement_.bind(index_++, std::span<const std::uint8_t>(bytes.data(), bytes.size()));
  }
  void put(const std::string& text) { statement_.bind(index_++, std::string_view(text)); }
  template <std::integral T>
  void put(T value) {
    statement_.bind(index_++, static_cast<std::int64_t>(value));
  }
  template <std::integral T>
  void put(std::optional<T> value) {
    if (value) return put(*value);
    statement_.bind_null(index_++);
  }
  template <typename E>
  requires std::is_enum_v<E>
  void put(E value) { statement_.bind(index_++, word(value)); }

  Statement& statement_;
  int index_;
};

/// Reads members from consecutive columns. Throws if a value does not fit its member: this program did not write the
/// row.
class Fetch {
 public:
  Fetch(Statement& statement, int first) : statement_(statement), column_(first) {}

  template <typename T>
  void operator()(std::string_view name, T& value) {
    name_ = name;
    take(value);
  }
  [[nodiscard]] int next_column() const { return column_; }

 private:
  void take(double& value) { value = statement_.real(column_++); }
  void take(Vec3& v) {
    for (int i = 0; i < 3; ++i) take(v[i]);
  }
  void take(Pose& pose) {
    // Not Pose::from_array, because normalising again would change the last bits.
    std::array<double, 7> a{};
    take(a);
    pose.translation_mm = Vec3(a[0], a[1], a[2]);
    pose.rotation = Quat(a[3], a[4], a[5], a[6]);
  }
  template <std::size_t N>
  void take(std::array<double, N>& values) {
    for (double& x : values) take(x);
  }
  template <int N>
  requires(N > 1) void take(Square<N>& m) {
    for (int row = 0; row < N; ++row)
      for (int column = 0; column < N; ++column) take(m(row, column));
  }
  template <std::size_t N>
  void take(FixedString<N>& text) {
    std::string_view stored = statement_.text(column_);
    if (statement_.stored_text(column_).size() > N)
      statement_.refuse(column_, "is longer than " + std::to_string(N) + " bytes");
    // Escaping control characters may lengthen the text; a character that does not fit is removed completely.
    std::size_t fits = std::min(stored.size(), N);
    while (fits < stored.size() && fits > 0 && (static_cast<unsigned char>(stored[fits]) & 0xC0U) == 0x80U) --fits;
    text.assign(stored.substr(0, fits));
    ++column_;
  }
  template <std::size_t N>
  void take(FixedVector<std::uint8_t, N>& bytes) {
    bytes.clear();
    for (const std::uint8_t byte : statement_.bytes(column_))
      if (!bytes.push(byte)) statement_.refuse(column_, "is longer than " + std::to_string(N) + " bytes");
    ++column_;
  }
  void take(std::string& text) {
    const bool has_lines = name_ == "figures" || name_ == "observations" || name_ == "certificate";
    text = has_lines ? statement_.document(column_) : statement_.text(column_);
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
  template <std::integral T>
  void take(std::optional<T>& value) {
    value.reset();
    if (statement_.is_null(column_)) {
      ++column_;
      return;
    }
    take(value.emplace());
  }
  template <typename E>
  requires std::is_enum_v<E>
  void take(E& value) {
    if (!from_word(statement_.text(column_), value))
      statement_.refuse(column_, "holds an unknown value \"" + std::string(statement_.text(column_)) + "\"");
    ++column_;
  }

  Statement& statement_;
  int column_;
  std::string_view name_;  ///< name of the member being read
};

/// Visits the fields of a record inside a row. A column is named by `prefix` and the field, unless `others` contains
/// another name.
template <typename V, typename Part>
void part(V& v, Part& inner, std::string_view prefix = "",
          std::initializer_list<std::pair<std::string_view, std::string_view>> others = {}) {
  const auto column = [&](std::string_view field, auto& member) {
    if constexpr (std::same_as<V, Names>) {
      const auto* other = std::find_if(others.begin(), others.end(), [&](const auto& o) { return o.first == field; });
      v(other != others.end() ? std::string(other->second) : std::string(prefix) + std::string(field), member);
    } else {
      v(field, member);
    }
  };
  fields(column, inner);
}

// ---- SQL ---------------------------------------------------------------------------------------------------------

[[nodiscard]] std::string joined(const std::vector<std::string>& names, std::string_view separator);
/// SQL text such as "INSERT INTO table (a, b) VALUES (?1, ?2)".
[[nodiscard]] std::string insert_text(std::string_view table, const std::vector<std::string>& names);
/// As insert_text(), but replaces the other columns of an existing row with the same `key`.
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

// ---- parts of rows that are used only in storage -----------------------------------------------------------------

struct BlockKey {
  std::int64_t slab_key = 0;
  std::uint8_t station = 0;  ///< 0: the slab itself
  std::uint8_t attempt = 0;
};
struct SlabKey {
  std::int64_t slab_key = 0;
};
/// Place of a robot and its scanner in a slab: 1 is the second.
struct ArmKey {
  std::int64_t slab_key = 0;
  std::uint8_t arm = 0;
};
struct FeatureName {
  FixedString<16> feature;
};
/// Position of a finding, an edge, an item or a gauge in its list.
struct Position {
  std::uint8_t position = 0;
};
enum class ScanState : std::uint8_t { none, kept, deleting, deleted };
struct AttemptState {
  StationPhase phase = StationPhase::acquired;
  std::uint16_t code = 0;
  std::int64_t scan_bytes = 0;
  ScanState scan_state = ScanState::none;
  std::int64_t measuring_since_ns = 0;
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
SLABD_FIELDS(BlockKey, slab_key, station, attempt);
SLABD_FIELDS(SlabKey, slab_key);
SLABD_FIELDS(ArmKey, slab_key, arm);
SLABD_FIELDS(FeatureName, feature);
SLABD_FIELDS(Position, position);
SLABD_FIELDS(AttemptState, phase, code, scan_bytes, scan_state, measuring_since_ns);
SLABD_FIELDS(SlabEnd, ended_utime_us);
SLABD_FIELDS(StationResult, station, verdict, reason);
SLABD_FIELDS(ResultState, is_repeat, acknowledged);
SLABD_FIELDS(CommandState, status, acquired);

// ---- column lists ------------------------------------------------------------------------------------------------

template <typename V, typename R>
void columns(V& v, R& r) {
  fields(v, r);
}

template <typename V, RecordOf<SlabHeader> R>
void columns(V& v, R& r) {
  part(v, r, "", {{"key", "slab_key"}});
}

template <typename V, RecordOf<SlabArm> R>
void columns(V& v, R& r) {
  v("robot", r.by.robot);
  v("scanner", r.by.scanner);
  SLABD_EACH(r, calibration_id, stations_id, scanner_id, T_flange_scanner)
}

template <typename V, RecordOf<SlabResult> R>
void columns(V& v, R& r) {
  SLABD_EACH(r, verdict, reason)
  part(v, r.fit, "fit_");
}

template <typename V, RecordOf<Attempt> R>
void columns(V& v, R& r) {
  SLABD_EACH(r, slab_key, station)
  v("attempt", r.number);
  SLABD_EACH(r, session, cmd_seq, T_base_flange, pose_spread_mm, pose_samples, scan_path)
  v("scan_points", r.shape.points);
  v("scan_finite", r.shape.finite);
  v("scan_width", r.shape.width);
  v("scan_height", r.shape.height);
  SLABD_EACH(r, scan_utime_us, settle_ms, acquire_ms)
  part(v, r.splice, "splice_",
       {{"source", "splice"}, {"T_base_reported", "T_base_reported"}, {"T_base_robot", "T_base_robot"}});
  SLABD_EACH(r, points_crc32c, asked, emulated, fingerprint)
  v("scanner_temperature_c", r.shape.scanner_temperature_c);
  SLABD_EACH(r, scanner_drift, arm)
  v("robot", r.by.robot);
  v("scanner", r.by.scanner);
}

/// Columns of a block, without its planes, casings, findings, edges and items.
template <typename V, RecordOf<BlockResult> R>
void columns(V& v, R& r) {
  SLABD_EACH(r, verdict, reason)
  part(v, r.scan);
  part(v, r.registration, "registration_",
       {{"share_associated", "share_associated"},
        {"condition", "condition"},
        {"T_scanner_block", "T_scanner_block"},
        {"covariance", "registration_cov"}});
  part(v, r.registration.deviation, "deviation_", {{"within_sigma", "within_sigma"}});
  part(v, r.seat, "seat_");
  part(v, r.seat.defect, "defect_");
  part(v, r.pores, "pores_", {{"count", "pores"}});
  part(v, r.observation, "",
       {{"ok", "observation_ok"}, {"jaw_ok", "observation_jaw_ok"}, {"top_ok", "observation_top_ok"}});
  part(v, r.times);
}

/// Column names, in the order of BudgetPart.
inline constexpr std::array<std::string_view, kBudgetParts> kBudgetColumns = {
    "budget_fit",   "budget_noise",     "budget_scanner", "budget_registration", "budget_calibration",
    "budget_robot", "budget_reference", "budget_thermal", "budget_gauge",        "budget_tie"};

template <typename V, RecordOf<Item> R>
void columns(V& v, R& r) {
  SLABD_EACH(r, id, verdict, required)
  v("from_station", r.station);
  v("to_station", r.station_to);
  SLABD_EACH(r, value, nominal, lower, upper, U)
  v("beside", r.companion);
  SLABD_EACH(r, measured)
  for (std::size_t part = 0; part < kBudgetParts; ++part) v(kBudgetColumns[part], r.budget[part]);
}

}  // namespace slabd::storage
