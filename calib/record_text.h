// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <array>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "calib/key_lines.h"
#include "calib/session.h"

/// Writing and reading `key = value` records with a checksum. Internal to the room.
namespace slabd::calib {

/// Text between quotes; a quote in it, or a line's end, would break the line.
[[nodiscard]] inline std::string in_quotes(std::string_view text) {
  std::string out = "\"";
  for (const char c : text.substr(0, std::size_t{4096})) out += c == '"' ? '\'' : c == '\n' || c == '\r' ? ' ' : c;
  return out + "\"";
}

/// Lines front to back, the checksum last.
class RecordWriter {
 public:
  RecordWriter& text(std::string_view key, std::string_view value) {
    if (!value.empty()) line(key, in_quotes(value));
    return *this;
  }
  RecordWriter& number(std::string_view key, double value) {
    if (has_value(value)) line(key, number_text(value));
    return *this;
  }
  RecordWriter& count(std::string_view key, std::uint64_t value) { return line(key, std::to_string(value)); }
  RecordWriter& numbers(std::string_view key, std::span<const double> values) {
    std::string row;
    for (const double v : values) row += (row.empty() ? "" : " ") + number_text(v);
    return line(key, row);
  }
  RecordWriter& line(std::string_view key, std::string_view value) {
    text_.append(key).append(" = ").append(value).append("\n");
    return *this;
  }
  RecordWriter& comment(std::string_view words) {
    text_.append("# ").append(words).append("\n");
    return *this;
  }
  [[nodiscard]] std::string done() { return with_checksum(std::move(text_)); }

 private:
  std::string text_;
};

/// KeyFile with what these records need beside it.
class RecordReader {
 public:
  RecordReader(std::vector<KeyLine> lines, std::string_view file) : keys_(std::move(lines), file) {}

  KeyFile& keys() { return keys_; }
  void text(std::string_view key, std::string& out) {
    for (const KeyLine* line : keys_.all(key)) {
      if (line->words.size() == 1)
        out = line->words[0];
      else
        keys_.fault(*line, "must be one text between quotes");
    }
  }
  template <typename Integer>
  void count(std::string_view key, Integer& out, double high = 9e15) {
    double value = static_cast<double>(out);
    keys_.number(key, true, 0.0, high, value);
    out = static_cast<Integer>(value);
  }
  void number(std::string_view key, bool required, double& out) { keys_.number(key, required, -1e12, 1e12, out); }
  template <std::size_t N>
  bool numbers(std::string_view key, std::array<double, N>& out) {
    for (const KeyLine* line : keys_.all(key)) {
      std::vector<double> found;
      if (!keys_.numbers(*line, 0, 1e12, found)) return false;
      if (found.size() != N) {
        keys_.fault(*line, "must be " + std::to_string(N) + " numbers");
        return false;
      }
      std::copy(found.begin(), found.end(), out.begin());
      return true;
    }
    return false;
  }

 private:
  KeyFile keys_;
};

/// The lines of a record whose checksum fits.
[[nodiscard]] Result<RecordReader> reader_of(std::string_view text, std::string_view file_name);

}  // namespace slabd::calib
