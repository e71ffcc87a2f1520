// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <set>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "config/config.h"

/// Files written by people, read strictly. A person must be able to repair the file from the message alone, so every
/// value knows its line and column, every fault is reported (not only the first), and a key nobody asked for is a
/// fault that names the nearest key somebody did ask for.
///
/// The TOML library stays in toml_reader.cpp; what leaves it is the small tree below.
namespace slabd::daemon {

struct TomlValue {
  enum class Kind : std::uint8_t { boolean, integer, real, text, array, table, date };
  struct Member;

  Kind kind = Kind::table;
  std::uint32_t line = 1;  ///< of the value, from 1
  std::uint32_t column = 1;
  bool boolean = false;
  std::int64_t integer = 0;
  double real = 0.0;
  std::string text;
  std::vector<TomlValue> items;  ///< of an array
  std::vector<Member> members;   ///< of a table, as written

  [[nodiscard]] const Member* find(std::string_view key) const;
};

struct TomlValue::Member {
  std::string key;
  std::uint32_t line = 1;  ///< of the key
  std::uint32_t column = 1;
  TomlValue value;
};

inline constexpr std::size_t kTomlBytesMax = 1'000'000;  ///< nobody writes a configuration of a megabyte

/// The file's bytes, or one problem and nothing: missing, unreadable, longer than kTomlBytesMax.
[[nodiscard]] std::optional<std::string> read_text_file(const std::string& path, std::vector<Problem>& problems);

/// Keys and brackets nest at most this deep each: whoever reads a tree, and the library when it lets go of one, calls
/// himself once per level. Nothing of ours nests deeper than four.
inline constexpr std::size_t kTomlNestingMax = 32;

/// Parses TOML. A syntax error, or nesting beyond kTomlNestingMax, is one problem; `root` then holds what stands above
/// the faulty line (possibly nothing), so that a reader may still serve from the tables it could read.
[[nodiscard]] bool parse_toml(const std::string& path, const std::string& bytes, TomlValue& root,
                              std::vector<Problem>& problems);

/// The candidate with the smallest edit distance (the first of equals); empty when there are none.
[[nodiscard]] std::string_view nearest(std::string_view word, const std::set<std::string, std::less<>>& candidates);

/// Closed range of a number.
struct Allowed {
  double low;
  double high;
};

/// One table being read. `optional_*` leave `out` alone when the key is absent; all readers leave it alone when the
/// value is faulty, and report. Absent tables read like empty ones, at the position of their parent. Every key asked
/// for is known; `finish` reports the others.
class TableReader {
 public:
  TableReader(const std::string& file, const TomlValue* table, std::string name, std::vector<Problem>& problems);

  [[nodiscard]] bool has(std::string_view key);

  void optional_number(std::string_view key, double& out, Allowed allowed);
  void required_number(std::string_view key, double& out, Allowed allowed);
  void optional_integer(std::string_view key, std::int64_t& out, std::int64_t low, std::int64_t high);
  void required_integer(std::string_view key, std::int64_t& out, std::int64_t low, std::int64_t high);
  void optional_boolean(std::string_view key, bool& out);
  void required_boolean(std::string_view key, bool& out);
  /// Text of 1..bytes_max bytes.
  void optional_text(std::string_view key, std::string& out, std::size_t bytes_max);
  void required_text(std::string_view key, std::string& out, std::size_t bytes_max);
  /// One of `words`; returns its index.
  void optional_word(std::string_view key, std::size_t& index, const std::vector<std::string_view>& words);
  /// x y z (mm) qw qx qy qz: finite, |x|, |y|, |z| <= reach_mm, quaternion of unit length within 1e-3.
  void required_pose(std::string_view key, std::array<double, 7>& out, double reach_mm);

  /// A table inside this one. It must be read and finished by the caller.
  [[nodiscard]] TableReader table(std::string_view key);
  /// The raw value, for what the readers above do not cover; nullptr when absent.
  [[nodiscard]] const TomlValue* value(std::string_view key);

  /// "file:line:column: table.key: what"; at the key when it is there, else at the table.
  void problem(std::string_view key, const std::string& what);
  /// The same at a value inside `key`.
  void problem_at(const TomlValue& at, std::string_view key, const std::string& what);
  void missing(std::string_view key, const std::string& expected);

  /// Where doubts go, those of tables inside this one too; without it they are dropped.
  void keep_doubts(std::vector<Problem>* doubts) { doubts_ = doubts; }
  /// The same as `problem` for a value that may be right: it does not make the file unusable.
  void doubt(std::string_view key, const std::string& what);

  /// Reports the keys that were never asked for.
  void finish();
  [[nodiscard]] bool present() const { return table_ != nullptr; }

 private:
  [[nodiscard]] std::string path_of(std::string_view key) const;
  void report(std::uint32_t line, std::uint32_t column, std::string_view key, const std::string& what);
  [[nodiscard]] Problem placed(std::uint32_t line, std::uint32_t column, std::string_view key,
                               const std::string& what) const;

  const std::string& file_;
  const TomlValue* table_;
  std::string name_;
  std::vector<Problem>& problems_;
  std::vector<Problem>* doubts_ = nullptr;
  std::set<std::string, std::less<>> known_;
  std::uint32_t line_ = 1;
  std::uint32_t column_ = 1;
};

/// 300, 20.0, "abc", a list of 3: what was found, for messages, as it stands in the file.
[[nodiscard]] std::string found(const TomlValue& value);
/// A doubt of an angle in degrees that is a round number of degrees as radians: 0.17453 is 10 deg.
void doubt_degrees(TableReader& table, std::string_view key, double angle_deg, Allowed allowed_deg);
/// A number written as integer or real.
[[nodiscard]] std::optional<double> as_number(const TomlValue& value);

}  // namespace slabd::daemon
