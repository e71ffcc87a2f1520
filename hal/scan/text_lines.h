// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <string_view>

#include "hal/hal.h"
#include "hal/scan/scan_window.h"

/// Lines, words and numbers of the text formats. Locale-free, bounded, no heap.
namespace slabd::hal {

/// Longest line that is parsed (room for 2,000 columns); a longer one is rejected, not cut.
inline constexpr std::size_t kTextLineBytesMax = 32'768;
/// The window is refilled if fewer bytes than this are ahead.
inline constexpr std::size_t kTextAheadMin = 1'024;

/// Line ends of a file: LF, possibly with CR before it, or CR alone (programs of the first Macintosh).
enum class LineEnd : char { lf = '\n', cr = '\r' };

/// Determined from the end of the first line of `head`. CR only if it is not followed by LF.
[[nodiscard]] LineEnd first_line_end(std::string_view head);

/// Length of UTF-8's byte-order mark at the start of `head`; 0 without one.
[[nodiscard]] std::size_t byte_order_mark_bytes(std::string_view head);

/// The next line of a header in `head`, from `position` on, without its end; false if only a partial line is left.
[[nodiscard]] bool next_header_line(std::string_view head, LineEnd end, std::size_t& position, std::string_view& line);

/// Reads the header of a scan file line by line, for a parser that reports errors by line number.
class HeaderLines {
 protected:
  HeaderLines(std::string_view head, const char* file) : head_(head), file_(file), line_end_(first_line_end(head)) {}

  bool next_line(std::string_view& line);
  /// "file: header line n: what "subject" (hint)".
  [[nodiscard]] Error refuse(const char* what, std::string_view subject = {}, const char* hint = nullptr) const;

  std::string_view head_;
  const char* file_;
  LineEnd line_end_;
  std::size_t position_ = 0;
  std::size_t line_number_ = 0;
};

/// Reads the rest of a scan file line by line.
class TextLines {
 public:
  /// `lines_before`: number of lines of the file already consumed.
  TextLines(ScanWindow& window, std::size_t lines_before, LineEnd end = LineEnd::lf)
      : window_(window), number_(lines_before), end_(end) {}

  /// Sets the line end for the following lines.
  void end_lines_with(LineEnd end) { end_ = end; }
  /// Returns the next line without its end (the last may have none), valid until the next call. False at the end of the
  /// file or on an error; `status` returns which.
  [[nodiscard]] bool next(std::string_view& line);
  /// The visible text after the last line returned, which stays valid. It ends anywhere within a line.
  [[nodiscard]] std::string_view behind() const { return window_.view().substr(handed_out_); }
  /// The last line returned, after more of the file has been made visible: up to `bytes` behind it.
  [[nodiscard]] std::string_view with_more(std::string_view line, std::size_t bytes);
  [[nodiscard]] LineEnd line_end() const { return end_; }
  /// Skips blank lines and one line that is not blank, of any length. False as for `next`.
  [[nodiscard]] bool skip();
  /// The visible text after the last line returned, which is no longer valid; at least kTextAheadMin bytes unless the
  /// file has fewer. Empty if lines end with CR alone: such files are rare and are read line by line.
  [[nodiscard]] std::string_view ahead();
  /// Consumes the first `bytes` of `ahead`, which are `lines` complete lines.
  void took(std::size_t bytes, std::size_t lines);
  [[nodiscard]] const Status& status() const { return status_; }
  /// Number of the last line returned, from 1.
  [[nodiscard]] std::size_t number() const { return number_; }

  [[nodiscard]] const char* file() const { return window_.name(); }

  /// "file: line n: ..." with a printf-formatted sentence.
  [[nodiscard, gnu::format(printf, 2, 3)]] Error refuse(const char* format, ...) const;
  /// "file: line n, column c: "word" is not a number (hint)"; `word` is a part of `line`.
  [[nodiscard]] Error not_a_number(std::string_view line, std::string_view word, const char* hint = nullptr) const;

 private:
  ScanWindow& window_;
  std::size_t number_;
  LineEnd end_;
  std::size_t handed_out_ = 0;  ///< bytes of the last line returned, still in the window
  Status status_ = success();
};

/// Splits off the next word between blanks and tabs; empty at the end of the line.
[[nodiscard]] inline std::string_view take_word(std::string_view& rest) {
  const auto is_blank = [](char c) { return c == ' ' || c == '\t'; };
  std::size_t begin = 0;
  while (begin < rest.size() && is_blank(rest[begin])) ++begin;
  std::size_t end = begin;
  while (end < rest.size() && !is_blank(rest[end])) ++end;
  const std::string_view word = rest.substr(begin, end - begin);
  rest.remove_prefix(end);
  return word;
}

/// The text without blanks and tabs around it.
[[nodiscard]] std::string_view trimmed(std::string_view text);

/// Text in lower case (ASCII letters only), cut to 16 bytes.
[[nodiscard]] FixedString<16> lower_case(std::string_view text);

/// Parses a whole word as a number, exactly rounded: decimal or scientific, with optional sign. Accepts nan and inf in
/// upper or lower case and in MSVC's spellings (nan(ind), 1.#QNAN). False if it is not a number; `value` is unchanged
/// then.
[[nodiscard]] bool parse_number(std::string_view word, double& value);
/// Parses a whole word as a coordinate in mm, spelt as for `parse_number`: the float or double nearest to the text. In
/// another unit than mm it is converted in double and rounded once more. Infinite if beyond the range of float.
template <typename Real>  // float or double
[[nodiscard]] bool parse_coordinate(std::string_view word, double mm_per_unit, Real& mm);
/// Hint why `word`, delimited by blanks, is not a number: a decimal comma, or commas that separate. nullptr if there is
/// none.
[[nodiscard]] const char* hint_of_comma(std::string_view word);
/// Parses a whole word as a count of at most kScanCountMax.
[[nodiscard]] bool parse_count(std::string_view word, std::uint64_t& value);

/// True if the text is UTF-8 throughout.
[[nodiscard]] bool is_utf8(std::string_view text);
/// "" or a hint that the names of a file in `line` are not UTF-8, to be appended to a message.
[[nodiscard]] const char* hint_of_encoding(std::string_view line);
/// Text from a file for an error message: cut to 60 bytes; control characters and invalid UTF-8 become '?'.
[[nodiscard]] FixedString<63> shown(std::string_view text);

// PLY, PCD and text scans have no field for a unit of length, so it is configured. Some programs write it into a
// comment or a column name; then it must agree with the configuration.

[[nodiscard]] double mm_per(LengthUnit unit);
[[nodiscard]] const char* name(LengthUnit unit);

/// False if the comment `text` (without its mark) declares another unit than `configured`; `found` is then its word. A
/// declaration is "unit", "units", "length unit" or "length_unit", in upper or lower case, and a known name of a unit
/// (mm, millimetres, m, meters, um, microns, cm, inch, ...). ':', '=', "is" or "in" may be between them. Units that
/// slabd cannot be configured for count too. Comments without a declaration are ignored.
[[nodiscard]] bool comment_agrees(std::string_view text, LengthUnit configured, std::string_view& found);

/// True if `text` declares a unit that has a known name.
[[nodiscard]] bool declares_unit(std::string_view text);

/// The same for the bare name of a unit, as in a column headed "x [mm]"; an unknown name agrees with any unit.
[[nodiscard]] bool unit_name_agrees(std::string_view word, LengthUnit configured);

/// "file: line n: the file declares unit "found", but it is to be read in mm ..."
[[nodiscard]] Error unit_contradicted(const char* file, std::size_t line, std::string_view found,
                                      LengthUnit configured);

/// Temperature in a comment whose first word is "scanner_temperature_c": "scanner_temperature_c 31.2".
struct DeclaredTemperature {
  double temperature_c = kNoValue;  ///< NaN: not declared

  /// False if the comment declares a temperature that is not a number from -40 to 125 deg C; `found` is then its word.
  [[nodiscard]] bool take(std::string_view comment, std::string_view& found);
};
/// "file: line n: scanner_temperature_c "found" ..."
[[nodiscard]] Error temperature_refused(const char* file, std::size_t line, std::string_view found);

/// Content of a comment whose first word is "emulated": "emulated by slabctl simulate, block 3".
struct DeclaredEmulation {
  bool emulated = false;
  std::uint8_t block = 0;  ///< 0: not stated

  void take(std::string_view comment);
};

}  // namespace slabd::hal
