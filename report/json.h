// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <concepts>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "base/base.h"

/// JSON as slabctl prints it: written front to back, so the order of keys is the order of the calls and stays the same
/// from one release to the next. Numbers carry every digit they have; NaN and infinity become null.
namespace slabd::cli {

class Json {
 public:
  Json& begin_object() { return open('{'); }
  Json& end_object() { return close('}'); }
  Json& begin_array() { return open('['); }
  Json& end_array() { return close(']'); }

  Json& key(std::string_view name);
  Json& value(double number);
  Json& value(std::string_view text);
  Json& value(const char* text) { return value(std::string_view(text)); }
  Json& value(bool truth) { return raw(truth ? "true" : "false"); }
  template <std::integral Integer>
  requires(!std::same_as<Integer, bool>) Json& value(Integer number) { return raw(std::to_string(number)); }
  Json& null() { return raw("null"); }

  template <typename Value>
  Json& field(std::string_view name, const Value& v) {
    return key(name).value(v);
  }
  Json& field(std::string_view name, std::span<const double> numbers) { return key(name).row(numbers); }
  /// `[1, 2, null]` on one line.
  Json& row(std::span<const double> numbers);

  /// The finished document, with a newline at its end.
  [[nodiscard]] std::string text() const { return text_ + "\n"; }

 private:
  Json& open(char bracket);
  Json& close(char bracket);
  Json& raw(std::string_view token);
  void separate();
  void indent();

  struct Level {
    bool empty = true;
  };
  std::string text_;
  std::vector<Level> levels_;
  bool after_key_ = false;
};

/// Eight hex digits, or null.
void write_crc32c(Json& json, std::string_view name, const std::optional<std::uint32_t>& crc32c);

/// `{id, unit, nominal, value, deviation, lower, upper, U, verdict, required, conformance_probability, budget}`, then
/// the companion figure under its own name and, for items `of_slab` that belong to stations, `stations`. `budget` holds
/// the standard uncertainties by part (k = 1), null when U is the recipe's.
void write_item(Json& json, const Item& item, bool of_slab = false);

/// `verdict, reason, scan, registration, features, items, timing_ms` of one block, as fields of the open object.
/// `cell_mm` is the flatness cell it was measured with, NaN when nobody knows any more. Covariances are rows; that of
/// the registration is ordered x, y, z (mm), then about X, Y, Z (rad).
void write_block(Json& json, const BlockResult& block, double cell_mm);

/// A pose as `[x, y, z, qw, qx, qy, qz]`, and as four rows.
void write_pose(Json& json, std::string_view name, const Pose& pose);
void write_matrix(Json& json, std::string_view name, const Pose& pose);

/// `emulated`, true or false, and `emulation`, the names of the emulation bits.
void write_emulation(Json& json, std::uint8_t bits);

/// "2026-11-20T23:28:01Z"; null when `utime_us` is 0.
void write_time(Json& json, std::string_view name, std::int64_t utime_us);
[[nodiscard]] std::string iso_time(std::int64_t utime_us);

}  // namespace slabd::cli
