// SPDX-License-Identifier: Apache-2.0
#include "calib/key_lines.h"

#include <charconv>
#include <cmath>

namespace slabd::calib {
namespace {

bool is_blank(char c) {
  return c == ' ' || c == '\t' || c == '\r' || c == ',';
}

Error at_line(std::string_view file, int line, const std::string& what) {
  return error(Code::config, "%.*s:%d: %s", static_cast<int>(file.size()), file.data(), line, what.c_str());
}

/// Splits a line at blanks; quotes keep words together, and a # outside of them ends the line. False if a quote is
/// open.
bool split(std::string_view text, std::vector<std::string>& words) {
  std::size_t i = 0;
  while (i < text.size()) {
    if (is_blank(text[i])) {
      ++i;
    } else if (text[i] == '#') {
      return true;
    } else if (text[i] == '"') {
      const std::size_t end = text.find('"', i + 1);
      if (end == std::string_view::npos) return false;
      words.emplace_back(text.substr(i + 1, end - i - 1));
      i = end + 1;
    } else {
      std::size_t end = i;
      while (end < text.size() && !is_blank(text[end]) && text[end] != '#' && text[end] != '"') ++end;
      words.emplace_back(text.substr(i, end - i));
      i = end;
    }
  }
  return true;
}

}  // namespace

bool is_date(std::string_view text) {
  if (text.size() != 10 || text[4] != '-' || text[7] != '-') return false;
  for (const std::size_t i : {0U, 1U, 2U, 3U, 5U, 6U, 8U, 9U})
    if (text[i] < '0' || text[i] > '9') return false;
  const int month = 10 * (text[5] - '0') + (text[6] - '0');
  const int day = 10 * (text[8] - '0') + (text[9] - '0');
  return month >= 1 && month <= 12 && day >= 1 && day <= 31;
}

bool number_from(std::string_view word, double& out) {
  double value = 0.0;
  const auto [end, fault] = std::from_chars(word.data(), word.data() + word.size(), value);
  if (fault != std::errc() || end != word.data() + word.size() || !std::isfinite(value)) return false;
  out = value;
  return true;
}

std::string number_text(double value) {
  FixedString<40> text;
  text.printf("%.17g", value);
  return std::string(text.view());
}

Result<std::vector<KeyLine>> key_lines(std::string_view text, std::string_view file_name) {
  std::vector<KeyLine> lines;
  for (int number = 1; !text.empty(); ++number) {
    const std::size_t end = std::min(text.find('\n'), text.size());
    const std::string_view whole = text.substr(0, end);
    text.remove_prefix(std::min(end + 1, text.size()));
    const std::size_t equals = whole.find('=');
    const std::size_t comment = whole.find('#');
    std::vector<std::string> before;
    const bool closed = split(whole.substr(0, std::min(equals, whole.size())), before);
    if (before.empty() && (equals == std::string_view::npos || comment < equals)) continue;
    if (!closed || before.size() != 1 || equals == std::string_view::npos || comment < equals)
      return at_line(file_name, number, "'key = value' expected");
    KeyLine& line = lines.emplace_back();
    line.line = number;
    line.key = before.front();
    if (!split(whole.substr(equals + 1), line.words)) return at_line(file_name, number, "a quote is not closed");
  }
  return lines;
}

void KeyFile::fail(const std::string& sentence) {
  if (!status_.ok()) return;
  Error why;
  why.code = Code::config;
  why.text.assign(sentence);
  status_ = why;
}

void KeyFile::fault(const KeyLine& line, const std::string& what) {
  if (status_.ok()) status_ = at_line(file_, line.line, line.key + " " + what);
}

const KeyLine* KeyFile::one(std::string_view key, bool required) {
  const KeyLine* found = nullptr;
  for (std::size_t i = 0; i < lines_.size(); ++i) {
    if (lines_[i].key != key) continue;
    used_[i] = true;
    if (found != nullptr) fault(lines_[i], "is given twice");
    found = &lines_[i];
  }
  if (found == nullptr && required) fail(file_ + ": the key " + std::string(key) + " is missing");
  return found;
}

void KeyFile::text(std::string_view key, bool required, std::string& out) {
  const KeyLine* line = one(key, required);
  if (line == nullptr) return;
  if (line->words.size() != 1 || line->words[0].empty() || line->words[0].size() > 64) {
    fault(*line, "must be 1 to 64 characters, between quotes where it holds blanks");
    return;
  }
  out = line->words[0];
}

void KeyFile::date(std::string_view key, std::string& out) {
  const KeyLine* line = one(key, true);
  if (line == nullptr) return;
  if (line->words.size() != 1 || !is_date(line->words[0])) {
    fault(*line, "must be a day as YYYY-MM-DD");
    return;
  }
  out = line->words[0];
}

void KeyFile::number(std::string_view key, bool required, double low, double high, double& out) {
  const KeyLine* line = one(key, required);
  if (line == nullptr) return;
  double value = 0.0;
  if (line->words.size() != 1 || !number_from(line->words[0], value) || value < low || value > high) {
    FixedString<80> range;
    range.printf("must be a number within %g .. %g", low, high);
    fault(*line, std::string(range.view()));
    return;
  }
  out = value;
}

std::vector<const KeyLine*> KeyFile::all(std::string_view key) {
  std::vector<const KeyLine*> found;
  for (std::size_t i = 0; i < lines_.size(); ++i) {
    if (lines_[i].key != key) continue;
    used_[i] = true;
    found.push_back(&lines_[i]);
  }
  return found;
}

bool KeyFile::numbers(const KeyLine& line, std::size_t first, double most, std::vector<double>& out) {
  out.clear();
  for (std::size_t i = first; i < line.words.size(); ++i) {
    double value = 0.0;
    if (!number_from(line.words[i], value) || std::abs(value) > most) {
      FixedString<160> what;
      what.printf("holds \"%.40s\", expected a number within +-%g", line.words[i].c_str(), most);
      fault(line, std::string(what.view()));
      return false;
    }
    out.push_back(value);
  }
  return true;
}

Status KeyFile::finish(std::string_view known) {
  for (std::size_t i = 0; i < lines_.size(); ++i)
    if (!used_[i]) fault(lines_[i], "is not a key of this file; keys are " + std::string(known));
  return status_;
}

}  // namespace slabd::calib
