// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <string_view>

#include "hal/hal.h"
#include "hal/scan/scan_window.h"

/// Lines, words and numbers of the text formats. Locale-free, bounded, no heap.
namespace slabd::hal {

/// A line that is looked into is at most this long (room for 2,000 columns); a longer one is refused, not cut.
inline constexpr std::size_t kTextLineBytesMax = 32'768;
/// Less than this ahead, and the window is filled up again.
inline constexpr std::size_t kTextAheadMin = 1'024;

/// What ends the lines of a file: LF, perhaps with CR before it, or CR alone (programs of the first Macintosh).
enum class LineEnd : char { lf = '\n', cr = '\r' };

/// By the end of the first line of `head`. CR only if it is not followed by LF.
[[nodiscard]] LineEnd first_line_end(std::string_view head);

/// Length of UTF-8's byte-order mark at the start of `head`; 0 without one.
[[nodiscard]] std::size_t byte_order_mark_bytes(std::string_view head);

/// The next line of a header of `head`, from `position` on, without its end; false if no whole line is left.
[[nodiscard]] bool next_header_line(std::string_view head, LineEnd end, std::size_t& position, std::string_view& line);

/// The header of a scan file line by line, for a parser that refuses a line by its number.
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

/// The rest of a scan file line by line.
class TextLines {
 public:
  /// `lines_before`: how many lines of the file were consumed already.
  TextLines(ScanWindow& window, std::size_t lines_before, LineEnd end = LineEnd::lf)
      : window_(window), number_(lines_before), end_(end) {}

  /// From here on lines have this end.
  void end_lines_with(LineEnd end) { end_ = end; }
  /// The next line without its end (the last may have none); it is valid until the next call. False: at the end of the
  /// file or on an error, `status` tells.
  [[nodiscard]] bool next(std::string_view& line);
  /// Steps over blank lines and one line with something on it, of any length. False as for `next`.
  [[nodiscard]] bool skip();
  /// What is visible of the text behind the line last handed out, which is no longer valid; at least kTextAheadMin
  /// bytes unless the file has fewer. Nothing where lines end with CR alone: such files are rare and read line by line.
  [[nodiscard]] std::string_view ahead();
  /// The first `bytes` of `ahead`, which are `lines` whole lines, have been read.
  void took(std::size_t bytes, std::size_t lines);
  [[nodiscard]] const Status& status() const { return status_; }
  /// Of the line last handed out, from 1.
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
  std::size_t handed_out_ = 0;  ///< bytes of the line last handed out, still in the window
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

/// Without blanks and tabs around it.
[[nodiscard]] std::string_view trimmed(std::string_view text);

/// ASCII letters only; cut to 16 bytes.
[[nodiscard]] FixedString<16> lower_case(std::string_view text);

/// A whole word as a number, exactly rounded: decimal or scientific, a sign allowed; nan and inf in any case and with
/// MSVC's spellings (nan(ind), 1.#QNAN). False: it is none, `value` is untouched.
[[nodiscard]] bool parse_number(std::string_view word, double& value);
/// A whole word as a coordinate in mm, spelt as for `parse_number`: the float or double nearest to what the text says;
/// in another unit than mm converted in double and rounded once more. Beyond all floats: infinite.
template <typename Real>  // float or double
[[nodiscard]] bool parse_coordinate(std::string_view word, double mm_per_unit, Real& mm);
/// Why `word`, which stands between blanks, may not be a number: a decimal comma, or commas that separate. nullptr: no
/// idea.
[[nodiscard]] const char* hint_of_comma(std::string_view word);
/// A whole word as a count of at most kScanCountMax.
[[nodiscard]] bool parse_count(std::string_view word, std::uint64_t& value);

/// Text from a file as it may be shown in an error: cut to 60 bytes, control characters and what is no UTF-8 as '?'.
[[nodiscard]] FixedString<63> shown(std::string_view text);

// PLY, PCD and text scans have no field for a unit of length, so it is configured. Some programs write it into a
// comment or a column name all the same; then it must agree with the configuration.

[[nodiscard]] double mm_per(LengthUnit unit);
[[nodiscard]] const char* name(LengthUnit unit);

/// `text` is what follows the comment's mark. A declaration is "unit", "units", "length unit" or "length_unit", in any
/// case, then a known name of a unit of length (mm, millimetres, m, meters, um, microns, cm, inch, ...), with ':', '=',
/// "is" or "in" between them or not. False: it declares another unit than `configured` (also one that slabd cannot be
/// configured for); `found` is then its word. Comments that declare nothing are for people.
[[nodiscard]] bool comment_agrees(std::string_view text, LengthUnit configured, std::string_view& found);

/// `text` declares a unit that has a known name.
[[nodiscard]] bool declares_unit(std::string_view text);

/// The same for the bare name of a unit, as in a column headed "x [mm]"; an unknown name agrees with everything.
[[nodiscard]] bool unit_name_agrees(std::string_view word, LengthUnit configured);

/// "file: line n: the file says unit "found", but it is to be read in mm ..."
[[nodiscard]] Error unit_contradicted(const char* file, std::size_t line, std::string_view found,
                                      LengthUnit configured);

/// What a comment declares whose first word is "emulated": "emulated by slabctl simulate, block 3".
struct DeclaredEmulation {
  bool emulated = false;
  std::uint8_t block = 0;  ///< 0: not said

  void take(std::string_view comment);
};

}  // namespace slabd::hal
