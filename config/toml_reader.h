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

/// Strict reader for files written by people. A person must be able to repair the file from the message alone.
/// Therefore every value has its line and column, and all faults are reported, not only the first. An unknown key is a
/// fault whose message contains the nearest known key.
///
/// The TOML library is used only in toml_reader.cpp; its results are converted to the small tree below.
namespace slabd::config {

struct TomlValue {
  enum class Kind : std::uint8_t { boolean, integer, real, text, array, table, date };
  struct Member;

  Kind kind = Kind::table;
  std::uint32_t line = 1;  ///< line of the value, from 1
  std::uint32_t column = 1;
  bool boolean = false;
  std::int64_t integer = 0;
  double real = 0.0;
  std::string text;
  std::vector<TomlValue> items;  ///< elements of an array
  std::vector<Member> members;   ///< members of a table, as written

  [[nodiscard]] const Member* find(std::string_view key) const;
};

struct TomlValue::Member {
  std::string key;
  std::uint32_t line = 1;  ///< line of the key
  std::uint32_t column = 1;
  TomlValue value;
};

inline constexpr std::size_t kTomlBytesMax = 1'000'000;  ///< largest file size

/// The file's bytes, or nullopt and one problem: missing, unreadable, or longer than kTomlBytesMax.
[[nodiscard]] std::optional<std::string> read_text_file(const std::string& path, std::vector<Problem>& problems,
                                                        std::size_t bytes_max = kTomlBytesMax);

/// Maximum nesting of keys and of brackets, each: readers of a tree, and the library when it frees one, recurse once
/// per level. slabd's own files nest at most four levels.
inline constexpr std::size_t kTomlNestingMax = 32;

/// Parses TOML. A syntax error, or nesting beyond kTomlNestingMax, is one problem. `root` then contains the part above
/// the faulty line (possibly empty), so that a reader can still use the tables there.
[[nodiscard]] bool parse_toml(const std::string& path, const std::string& bytes, TomlValue& root,
                              std::vector<Problem>& problems);

/// The candidate with the smallest edit distance (the first of equals); empty without candidates.
[[nodiscard]] std::string_view nearest(std::string_view word, const std::set<std::string, std::less<>>& candidates);

/// Closed range of a number.
struct Allowed {
  double low;
  double high;
};

/// Reader of one table. `optional_*` leave `out` unchanged if the key is absent. All readers leave it unchanged and
/// report a problem if the value is faulty. Absent tables are read like empty ones, at the position of their parent.
/// Every key that is read counts as known; `finish` reports the others.
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
  /// Reads a text of 1..bytes_max bytes.
  void optional_text(std::string_view key, std::string& out, std::size_t bytes_max);
  void required_text(std::string_view key, std::string& out, std::size_t bytes_max);
  /// Reads one of `words` and sets its index.
  void optional_word(std::string_view key, std::size_t& index, const std::vector<std::string_view>& words);
  /// Reads x y z (mm) qw qx qy qz: finite, |x|, |y|, |z| <= reach_mm, quaternion of unit length within 1e-3.
  void required_pose(std::string_view key, std::array<double, 7>& out, double reach_mm);

  /// Reader of a table inside this one. The caller must read and finish it.
  [[nodiscard]] TableReader table(std::string_view key);
  /// The raw value, for types that the readers above do not support; nullptr if absent.
  [[nodiscard]] const TomlValue* value(std::string_view key);

  /// Reports "file:line:column: table.key: fault"; at the key if it is present, else at the table.
  void problem(std::string_view key, const std::string& what);
  /// Reports the same at a value inside `key`.
  void problem_at(const TomlValue& at, std::string_view key, const std::string& what);
  void missing(std::string_view key, const std::string& expected);

  /// Sets the list that receives doubts, including those of inner tables; without it they are dropped.
  void keep_doubts(std::vector<Problem>* doubts) { doubts_ = doubts; }
  /// Reports a value that may be right, in the form of `problem`; the file remains usable.
  void doubt(std::string_view key, const std::string& what);

  /// Reports the keys that were never read.
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

/// Text of a value for messages, as written in the file: 300, 20.0, "abc", a list of 3.
[[nodiscard]] std::string found(const TomlValue& value);
/// Reports a doubt if an angle in degrees is a round number of degrees written in radians: 0.17453 is 10 deg.
void doubt_degrees(TableReader& table, std::string_view key, double angle_deg, Allowed allowed_deg);
/// Value of a number written as integer or real.
[[nodiscard]] std::optional<double> as_number(const TomlValue& value);

}  // namespace slabd::config
