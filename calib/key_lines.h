// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "base/result.h"

/// The written form of certificates and observations: one `key = value` a line, `#` comments, text between quotes where
/// it holds blanks. Read strictly: what is not understood is an error with its line.
namespace slabd::calib {

struct KeyLine {
  int line = 0;
  std::string key;
  std::vector<std::string> words;  ///< of the value; a quoted one without its quotes
};

/// All lines that say something. config: no '=', an open quote; the text names `file_name`:line.
[[nodiscard]] Result<std::vector<KeyLine>> key_lines(std::string_view text, std::string_view file_name);

/// Takes the lines of a file by key, so that what is left over can be complained about.
class KeyFile {
 public:
  KeyFile(std::vector<KeyLine> lines, std::string_view file_name)
      : lines_(std::move(lines)), file_(file_name), used_(lines_.size(), false) {}

  /// The one line with this key, at most once; the first error found is kept and later calls do nothing more.
  void text(std::string_view key, bool required, std::string& out);
  void number(std::string_view key, bool required, double low, double high, double& out);
  /// A day, YYYY-MM-DD.
  void date(std::string_view key, std::string& out);
  /// Every line with this key, in the order of the file.
  [[nodiscard]] std::vector<const KeyLine*> all(std::string_view key);
  /// The words from `first` on as numbers; false (and an error) when one is none or beyond +-`most`.
  bool numbers(const KeyLine& line, std::size_t first, double most, std::vector<double>& out);
  void fault(const KeyLine& line, const std::string& what);

  /// The first error; lines nobody asked for are one, and `known` is the list of keys it names.
  [[nodiscard]] Status finish(std::string_view known);

 private:
  [[nodiscard]] const KeyLine* one(std::string_view key, bool required);
  void fail(const std::string& sentence);

  std::vector<KeyLine> lines_;
  std::string file_;
  std::vector<bool> used_;
  Status status_ = success();
};

/// A day as YYYY-MM-DD; the day of the month is within 1 .. 31 whatever the month.
[[nodiscard]] bool is_date(std::string_view text);
/// A finite number and nothing else.
[[nodiscard]] bool number_from(std::string_view word, double& out);
/// Every digit, so that the same bits come back.
[[nodiscard]] std::string number_text(double value);

}  // namespace slabd::calib
