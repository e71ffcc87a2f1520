// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <concepts>
#include <cstdint>
#include <functional>
#include <iterator>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <type_traits>
#include <utility>
#include <vector>

#include "base/base.h"

/// JSON as slabctl prints it, written front to back: keys are in the order of the calls and stay in that order between
/// releases. Numbers have all digits; NaN and infinity become null.
namespace slabd::report {

class Json {
 public:
  Json() = default;
  /// A document: an object whose first field is its schema.
  explicit Json(std::string_view schema) { begin_object().field("schema", schema); }

  Json& begin_object() { return open('{'); }
  Json& end_object() { return close(); }
  Json& begin_array() { return open('['); }
  Json& end_array() { return close(); }

  Json& key(std::string_view name);
  Json& null() { return raw("null"); }
  Json& value(std::string_view text);
  /// Numbers, booleans and texts; an enumeration by its `name`; an empty optional as null; a pose as `[x, y, z, qw,
  /// qx, qy, qz]`, a vector as one row, a matrix as rows; a range as a list; a record as the object of its fields
  /// (base/fields.h).
  template <typename T>
  requires(!std::convertible_to<const T&, std::string_view>) Json& value(const T& v) {
    if constexpr (std::same_as<T, bool>) {
      return raw(v ? "true" : "false");
    } else if constexpr (std::integral<T>) {
      return raw(std::to_string(v));
    } else if constexpr (std::floating_point<T>) {
      return row(std::span<const double>(&v, 1), "", "");
    } else if constexpr (std::is_enum_v<T>) {
      return value(std::string_view(name(v)));
    } else if constexpr (std::same_as<T, Pose>) {
      return value(v.to_array());
    } else if constexpr (requires { v.has_value(); }) {
      return v ? value(*v) : null();
    } else if constexpr (requires { v.view(); }) {
      return value(std::string_view(v.view()));
    } else if constexpr (std::derived_from<T, Eigen::MatrixBase<T>>) {
      if constexpr (T::ColsAtCompileTime == 1) {
        const auto numbers = v.eval();
        return row({numbers.data(), static_cast<std::size_t>(numbers.size())});
      }
      begin_array();
      for (Eigen::Index i = 0; i < v.rows(); ++i) {
        const auto numbers = v.row(i).eval();
        row({numbers.data(), static_cast<std::size_t>(numbers.size())});
      }
      return end_array();
    } else if constexpr (std::convertible_to<const T&, std::span<const double>>) {
      return row(v);
    } else if constexpr (requires { std::begin(v); }) {
      begin_array();
      for (const auto& element : v) value(element);
      return end_array();
    } else {
      begin_object();
      fields(*this, v);
      return end_object();
    }
  }

  template <typename T>
  Json& field(std::string_view name, const T& v) {
    key(name);
    return value(v);
  }
  /// Writes `name: [...]`, for each element of `range` the value that `write(element)` returns. If it returns void,
  /// the element is an object with the fields that it writes.
  template <typename Range, typename Write>
  Json& list(std::string_view name, const Range& range, Write&& write) {
    key(name).begin_array();
    for (const auto& element : range) {
      if constexpr (std::is_void_v<std::invoke_result_t<Write&, decltype(element)>>) {
        begin_object();
        std::invoke(write, element);
        end_object();
      } else {
        value(std::invoke(write, element));
      }
    }
    return end_array();
  }

  /// One field of a record. Angles are written in degrees.
  template <typename T>
  void operator()(std::string_view name, const T& v) {
    if constexpr (std::same_as<T, double>) {
      if (name.ends_with("_rad")) {
        field(std::string(name.substr(0, name.size() - 3)) + "deg", deg_from_rad(v));
        return;
      }
    }
    field(name, v);
  }

  /// The finished document with a final newline; closes open objects and arrays.
  [[nodiscard]] std::string text() const;

 private:
  Json& open(char bracket);
  Json& close();
  Json& raw(std::string_view token);
  /// `[1, 2, null]` on one line.
  Json& row(std::span<const double> numbers, std::string_view begin = "[", std::string_view end = "]");
  void separate();
  void indent();

  struct Level {
    char bracket;
    bool empty = true;
  };
  std::string text_;
  std::vector<Level> levels_;
  bool after_key_ = false;
};

/// Writes the fields of a record into the open object. `choose(name)` is called before each field; it may write other
/// fields first and returns false to leave the field out.
template <typename Record, typename Choose>
void write_fields(Json& json, const Record& record, Choose choose) {
  const auto each = [&](std::string_view name, const auto& member) {
    if (choose(name)) json(name, member);
  };
  fields(each, record);
}

/// Null unless `is_given`.
template <typename T>
[[nodiscard]] std::optional<T> only_if(bool is_given, T value) {
  return is_given ? std::optional<T>(std::move(value)) : std::nullopt;
}

/// Eight hex digits, or null.
void write_crc32c(Json& json, std::string_view name, const std::optional<std::uint32_t>& crc32c);

/// `{id, unit, nominal, value, deviation, lower, upper, U, verdict, required, conformance_probability, budget}`, then
/// the companion figure under its own name and, for items `of_slab` that belong to stations, `stations`. `budget` holds
/// the standard uncertainties by part (k = 1), null when U is the recipe's.
void write_item(Json& json, const Item& item, bool of_slab = false);

/// Writes `verdict, reason, scan, registration, features, items, timing_ms` of one block as fields of the open object.
/// `cell_mm` is the flatness cell of the measurement, NaN if unknown. Covariances are rows; that of the registration
/// is ordered x, y, z (mm), then about X, Y, Z (rad).
void write_block(Json& json, const BlockResult& block, double cell_mm);

/// `emulated`, true or false, and `emulation`, the names of the emulation bits.
void write_emulation(Json& json, std::uint8_t bits);

/// "2026-11-20T23:28:01Z"; null when `utime_us` is 0.
void write_time(Json& json, std::string_view name, std::int64_t utime_us);
[[nodiscard]] std::string iso_time(std::int64_t utime_us);

}  // namespace slabd::report
