// SPDX-License-Identifier: Apache-2.0
#include "hal/text_points.h"

#include <algorithm>
#include <limits>

#include "hal/declared_unit.h"
#include "hal/plain_rows.h"
#include "hal/settle_points.h"
#include "hal/text_columns.h"
#include "hal/text_lines.h"

// Problem: a table without a header says neither how many points it has nor how it is written, and a table read the
// wrong way (a decimal comma taken for a separator, a column shifted) is a cloud nobody measured. Idea: the first line
// decides, every other line must agree with it to the last column that is needed; in doubt refuse and say where.
namespace slabd::hal {
namespace {

bool is_comment(std::string_view line) {
  return line.starts_with('#') || line.starts_with("//");
}

template <typename Real>
class TextTable {
 public:
  TextTable(ScanWindow& window, LengthUnit unit, std::span<Real> xyz)
      : window_(window), lines_(window, 0), unit_(unit), mm_(mm_per(unit)), xyz_(xyz) {}

  Result<ScanShape> read() {
    step_over_byte_order_mark();
    for (std::string_view line; next(line);) {
      const std::string_view text = trimmed(line);
      if (text.empty()) continue;
      Status status = is_comment(text) ? comment(text) : row(line);
      // Behind what is read, too: parts of a file that were never written, or are lost, are zeros, and lines with them.
      if (status) status = holds_no_zeros(line);
      if (!status) return status.error();
    }
    if (!lines_.status()) return lines_.status().error();
    if (points_ == 0) return error(Code::too_few_points, "%s: no points at all", window_.name());
    const Settled settled = settle_points(xyz_.data(), points_);
    return ScanShape{points_, settled.finite, 0, 0, false, settled.zeros};
  }

 private:
  /// UTF-8's, which spreadsheets write in front.
  void step_over_byte_order_mark() {
    constexpr std::string_view kMark = "\xEF\xBB\xBF";
    if (window_.have(kMark.size()) && window_.view().starts_with(kMark)) window_.consume(kMark.size());
  }

  /// The next line that is not a plain row; those before it are taken.
  bool next(std::string_view& line) {
    while (plain_) {
      const std::span<Real> room = xyz_.subspan(3 * points_);
      const PlainRows plain =
          read_plain_rows(lines_.ahead(), PlainRowForm{separator_, true, 0}, mm_, room.data(), room.size() / 3);
      if (plain.rows == 0) break;
      lines_.took(plain.bytes, plain.rows);
      points_ += plain.rows;
    }
    return lines_.next(line);
  }

  Status holds_no_zeros(std::string_view line) const {
    const std::size_t at = line.find('\0');
    if (at == std::string_view::npos) return success();
    return lines_.refuse("column %zu: a byte 0; parts of the file were not written, or it is no text", at + 1);
  }

  Status comment(std::string_view text) {
    std::string_view found;
    const std::string_view words = text.substr(std::min(text.find_first_not_of("#/"), text.size()));
    if (!comment_agrees(words, unit_, found)) return unit_contradicted(window_.name(), lines_.number(), found, unit_);
    return decided_ ? success() : names(names_in_comment(text));
  }

  /// Above the points a comment may name the columns ("//X Y Z"); the last one that does counts.
  Status names(std::string_view text) {
    const Separator separator = separator_of(text);
    if (!names_every_axis(text, separator)) return success();
    named_ = {};
    named_line_ = lines_.number();
    named_count_ = count_columns(text, separator);
    return find_columns(lines_, text, separator, unit_, named_);
  }

  /// Names in a comment count if there are as many as columns. A sentence in which x, y and z come first says nothing
  /// else than no comment at all; of any other nobody knows what it says.
  Status take_names_of_comment(std::string_view line) {
    if (named_line_ == 0 || named_.xyz == TextColumns{}.xyz) return success();
    const std::size_t count = count_columns(line, separator_);
    if (count == named_count_) {
      columns_ = named_;
      return success();
    }
    return lines_.refuse(
        "%zu columns, but the comment on line %zu names %zu, and x, y, z are not its first three; which columns are x, "
        "y and z?",
        count, named_line_, named_count_);
  }

  Status row(std::string_view line) {
    if (!decided_) {
      decided_ = true;
      separator_ = separator_of(line);
      const bool names = is_line_of_names(line, separator_);
      // "Units: m" names no column.
      std::string_view found;
      if (names && !comment_agrees(line, unit_, found))
        return unit_contradicted(window_.name(), lines_.number(), found, unit_);
      if (names)
        if (Status status = find_columns(lines_, line, separator_, unit_, columns_); !status) return status;
      if (!names)
        if (Status status = take_names_of_comment(line); !status) return status;
      plain_ = columns_.xyz == TextColumns{}.xyz;
      if (names) return success();
    }
    if (3 * points_ + 3 > xyz_.size())
      return lines_.refuse("more than %zu points, the most that are allowed", xyz_.size() / 3);
    return point(line);
  }

  Status point(std::string_view line) {
    FieldReader fields(line, separator_);
    Real* out = &xyz_[3 * points_];
    for (std::size_t column = 0; column < columns_.needed; ++column) {
      std::string_view field;
      if (!fields.next(field))
        return lines_.refuse("%zu columns, needed are %zu%s", column, columns_.needed,
                             column == 1 ? " (separators: blanks, tab, comma or semicolon, one kind per file)" : "");
      for (std::size_t axis = 0; axis < 3; ++axis) {
        if (columns_.xyz[axis] != column) continue;
        out[axis] = std::numeric_limits<Real>::quiet_NaN();
        if (!field.empty() && !parse_coordinate(field, mm_, out[axis]))
          return lines_.not_a_number(line, field, hint_for(field));
      }
    }
    ++points_;
    return success();
  }

  /// "1,5": a decimal comma when something else separates; "5 2": when commas do and blanks stand within a field.
  [[nodiscard]] const char* hint_for(std::string_view field) const {
    const bool comma_within = field.find(',') != std::string_view::npos;
    const bool blank_within = separator_ == Separator::comma && field.find_first_of(" \t") != std::string_view::npos;
    if (comma_within || blank_within) return "a decimal comma is not read: save the scan with decimal points";
    return nullptr;
  }

  ScanWindow& window_;
  TextLines lines_;
  LengthUnit unit_;
  double mm_;
  std::span<Real> xyz_;
  std::size_t points_ = 0;
  bool decided_ = false;
  bool plain_ = false;  ///< x, y, z are the first three columns
  Separator separator_ = Separator::blanks;
  TextColumns columns_;
  std::size_t named_line_ = 0;  ///< of the comment that names the columns; 0: none does
  std::size_t named_count_ = 0;
  TextColumns named_;
};

}  // namespace

template <typename Real>
Result<ScanShape> read_text_points(ScanWindow& window, LengthUnit unit, std::span<Real> xyz) {
  return TextTable<Real>(window, unit, xyz).read();
}

template Result<ScanShape> read_text_points(ScanWindow&, LengthUnit, std::span<float>);
template Result<ScanShape> read_text_points(ScanWindow&, LengthUnit, std::span<double>);

}  // namespace slabd::hal
