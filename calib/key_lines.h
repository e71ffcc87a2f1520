// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "base/result.h"

/// Text form of certificates and observations: one `key = value` per line, `#` comments, text with blanks in quotes.
/// Read strictly: anything not recognised is an error with its line.
namespace slabd::calib {

struct KeyLine {
  int line = 0;
  std::string key;
  std::vector<std::string> words;  ///< words of the value; a quoted one without its quotes
};

/// Returns all lines with content. config: no '=', or an open quote; the text contains `file_name`:line.
[[nodiscard]] Result<std::vector<KeyLine>> key_lines(std::string_view text, std::string_view file_name);

/// Reads the lines of a file by key and reports the unused ones.
class KeyFile {
 public:
  KeyFile(std::vector<KeyLine> lines, std::string_view file_name)
      : lines_(std::move(lines)), file_(file_name), used_(lines_.size(), false) {}

  /// Reads the line with this key, which may occur once. The first error is kept, and later calls then do nothing.
  void text(std::string_view key, bool required, std::string& out);
  void number(std::string_view key, bool required, double low, double high, double& out);
  /// Reads a day, YYYY-MM-DD.
  void date(std::string_view key, std::string& out);
  /// Every line with this key, in the order of the file.
  [[nodiscard]] std::vector<const KeyLine*> all(std::string_view key);
  /// Reads the words from `first` on as numbers; false (and an error) if one is invalid or beyond +-`most`.
  bool numbers(const KeyLine& line, std::size_t first, double most, std::vector<double>& out);
  void fault(const KeyLine& line, const std::string& what);

  /// Returns the first error. Unused lines are an error, and `known` is the list of keys in its text.
  [[nodiscard]] Status finish(std::string_view known);

 private:
  [[nodiscard]] const KeyLine* one(std::string_view key, bool required);
  void fail(const std::string& sentence);

  std::vector<KeyLine> lines_;
  std::string file_;
  std::vector<bool> used_;
  Status status_ = success();
};

/// True for a day as YYYY-MM-DD; the day must be within 1 .. 31 in any month.
[[nodiscard]] bool is_date(std::string_view text);
/// Reads a finite number; false if `word` contains anything else.
[[nodiscard]] bool number_from(std::string_view word, double& out);
/// Text with all digits, so that the same bits are read back.
[[nodiscard]] std::string number_text(double value);

}  // namespace slabd::calib
