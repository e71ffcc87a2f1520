// SPDX-License-Identifier: Apache-2.0
#include "hal/scan/point_readers.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <optional>

#include "hal/scan/plain_rows.h"
#include "hal/scan/scan_points.h"
#include "hal/scan/text_columns.h"
#include "hal/scan/text_lines.h"

// Problem: a table without a header states neither its number of points nor its format. A table read wrongly (a decimal
// comma taken for a separator, a shifted column) gives a wrong cloud. Idea: the first line sets the format, and every
// other line must match it up to the last needed column. In doubt the file is rejected with the position.
namespace slabd::hal {
namespace {

bool is_comment(std::string_view line) {
  return line.starts_with('#') || line.starts_with("//");
}

template <typename Real>
class TextTable {
 public:
  TextTable(ScanWindow& window, const ScanForm& form, std::span<Real> xyz)
      : window_(window),
        lines_(window, 0),
        unit_(form.unit),
        mm_(mm_per(form.unit)),
        xyz_(xyz),
        chosen_(form.columns) {}

  Result<ScanShape> read() {
    look_at_beginning();
    for (std::string_view line; next(line);) {
      if (!decided_) line = lines_.with_more(line, kTextLineBytesMax);
      const std::string_view text = trimmed(line);
      if (text.empty()) continue;
      Status status = is_comment(text) ? comment(text) : row(line);
      // Also checked after the fields that are read: unwritten or lost parts of a file are zeros and may hide whole
      // lines.
      if (status) status = holds_no_zeros(line);
      if (!status) return status.error();
    }
    if (!lines_.status()) return lines_.status().error();
    if (points_ == 0) return error(Code::too_few_points, "%s: no points at all", window_.name());
    if (count_line_ != 0 && announced_ != points_)
      return error(Code::frame_incomplete, "%s: line %zu announces %llu points, the file has %zu%s", window_.name(),
                   count_line_, static_cast<unsigned long long>(announced_), points_,
                   announced_ > points_ ? ": it was cut, or is still being written" : "");
    if (Status status = refuse_columns(); !status) return status.error();
    const Settled settled = settle_points(xyz_.data(), points_);
    return ScanShape{points_,          settled.finite,        0, 0, false, settled.zeros, emulation_.emulated,
                     emulation_.block, scanner_.temperature_c};
  }

 private:
  /// Skips UTF-8's byte-order mark, which spreadsheets write, and detects the line end.
  void look_at_beginning() {
    static_cast<void>(window_.have(kTextLineBytesMax));  // if it cannot be read, the first line reports it
    window_.consume(byte_order_mark_bytes(window_.view()));
    const std::string_view first = window_.view().substr(0, kTextLineBytesMax);
    if (first.find('\n') == std::string_view::npos) lines_.end_lines_with(first_line_end(first));
  }

  static constexpr std::size_t kRowsToTell = 20;

  /// Rejects a table whose first three columns are not coordinates, if the columns were not named or chosen.
  Status refuse_columns() const {
    if (columns_known_ || row_columns_ < 4 || points_ < kRowsToTell) return success();
    const std::size_t bytes = bytes_in_front();
    if (bytes != 0)
      return refuse_columns(bytes == 3 ? "the first three are a colour and not coordinates"
                                       : "the first four are a colour and not coordinates",
                            from(bytes));
    if (is_height_map())
      return error(
          Code::frame_incomplete,
          "%s: all %zu columns hold the same kind of number: a height map, not points (save the scan as points "
          "x y z)",
          window_.name(), row_columns_);
    std::array<bool, 3> foreign{};
    for (std::size_t axis = 0; axis < 3; ++axis)
      foreign[axis] = is_constant(axis) || ((axis == 0 || foreign[axis - 1]) && climbs(axis));
    if (climbs(0))
      return refuse_columns(sample_.is_whole(0) ? "the first numbers the points and is not x"
                                                : "the first climbs or falls evenly, as a time does, and is not x",
                            fitting(foreign));
    if (row_columns_ >= 5 && (are_indices(0, 1) || are_indices(1, 0)))
      return refuse_columns("the first two are a point's row and column and not x and y", from(2));
    constexpr std::array<const char*, 3> kSame = {"the first is the same in every line and is not x",
                                                  "the second is the same in every line and is not y",
                                                  "the third is the same in every line and is not z"};
    const bool all_constant = foreign[0] && foreign[1] && foreign[2];  // a scan without content
    for (std::size_t axis = 0; axis < 3 && !all_constant; ++axis)
      if (is_constant(axis)) return refuse_columns(kSame[axis], fitting(foreign));
    if (is_brightness())
      return refuse_columns("the first has whole numbers in no order, as a brightness does, and is not x", from(1));
    if (sample_.has_points_side_by_side())
      return error(Code::frame_incomplete,
                   "%s: %zu columns: %zu points side by side, x,y,z,x,y,z: save one point a line (if the first three "
                   "columns are the whole scan, choose them with %s)",
                   window_.name(), row_columns_, row_columns_ / 3, how_to_choose("1,2,3").c_str());
    return success();
  }

  [[nodiscard]] Error refuse_columns(const char* what, const FixedString<40>& three) const {
    return error(Code::frame_incomplete,
                 "%s: of %zu columns %s: choose the columns, as with %s, or name them in a first line", window_.name(),
                 row_columns_, what, how_to_choose(three.view()).c_str());
  }

  /// Three columns that may be x, y and z: the ones from `first` on, counted from 0.
  [[nodiscard]] FixedString<40> from(std::size_t first) const {
    FixedString<40> three("A,B,C");
    if (first + 3 <= row_columns_) three.printf("%zu,%zu,%zu", first + 1, first + 2, first + 3);
    return three;
  }
  /// The first three columns without those of the first three that are `foreign`.
  [[nodiscard]] FixedString<40> fitting(const std::array<bool, 3>& foreign) const {
    std::array<std::size_t, 3> three{};
    std::size_t count = 0;
    for (std::size_t column = 0; column < row_columns_ && count < 3; ++column)
      if (column >= 3 || !foreign[column]) three[count++] = column + 1;
    if (count < 3) return from(1);
    FixedString<40> text;
    text.printf("%zu,%zu,%zu", three[0], three[1], three[2]);
    return text;
  }

  /// The value in the file's own unit; -1 if it is not a whole number >= 0.
  [[nodiscard]] double whole(std::size_t point, std::size_t axis) const {
    const double value = static_cast<double>(xyz_[3 * point + axis]) / mm_;
    const double nearest = std::floor(value + 0.5);
    return nearest >= 0.0 && std::abs(value - nearest) <= 1e-6 * std::max(nearest, 1.0) ? nearest : -1.0;
  }

  /// True if the values rise or fall in even steps in the first lines, some of which may be left out, and never turn
  /// round in the whole file. The first lines alone do not decide: x rises evenly within a profile and then repeats.
  /// The whole file alone does not either: a float holds a time of day in coarse steps.
  [[nodiscard]] bool climbs(std::size_t axis) const {
    const int direction = sample_.even_direction(axis);
    if (direction == 0) return false;
    for (std::size_t i = 0; i < points_; ++i) {
      const Real here = xyz_[3 * i + axis];
      const Real before = xyz_[3 * (i == 0 ? 0 : i - 1) + axis];
      if (!(direction > 0 ? here >= before : here <= before)) return false;
    }
    return true;
  }

  [[nodiscard]] bool is_constant(std::size_t axis) const {
    for (std::size_t i = 0; i < points_; ++i)
      if (!(xyz_[3 * i + axis] == xyz_[axis])) return false;
    return true;
  }

  /// Number of columns of a colour in front of the coordinates, three or four; 0 if there are none. Excludes whole
  /// coordinates with a colour or with a normal after them.
  [[nodiscard]] std::size_t bytes_in_front() const {
    constexpr double kByteMax = 255.0;
    const std::size_t bytes = sample_.bytes_in_front();
    if (bytes < 3 || bytes > 4 || bytes + 3 > row_columns_ || sample_.are_normals(bytes)) return 0;
    for (std::size_t i = 0; i < points_; ++i)
      for (std::size_t axis = 0; axis < 3; ++axis)
        if (const double value = whole(i, axis); value < 0.0 || value > kByteMax) return 0;
    return bytes;
  }

  /// True for whole numbers that jump in the first column and fractions in the next three.
  [[nodiscard]] bool is_brightness() const {
    constexpr double kBrightnessMax = 65'535.0;
    if (!sample_.jumps(0) || !sample_.has_fractions(1) || !sample_.has_fractions(2) || !sample_.has_fractions(3))
      return false;
    for (std::size_t i = 0; i < points_; ++i)
      if (const double value = whole(i, 0); value < 0.0 || value > kBrightnessMax) return false;
    return true;
  }

  /// True for the indices of a grid, some of whose points may be missing: `slow` is constant while `quick` increases by
  /// one, and then increases itself.
  [[nodiscard]] bool are_indices(std::size_t slow, std::size_t quick) const {
    std::size_t runs = 1;
    std::size_t ones = 0;
    for (std::size_t i = 0; i < points_; ++i) {
      const double row = whole(i, slow);
      const double column = whole(i, quick);
      if (row < 0.0 || column < 0.0) return false;
      if (i == 0) continue;
      const double step = row - whole(i - 1, slow);
      const double along = column - whole(i - 1, quick);
      if (step < 0.0 || (step == 0.0 && !(along > 0.0))) return false;
      runs += step > 0.0 ? 1U : 0U;
      ones += step == 0.0 && along == 1.0 ? 1U : 0U;
    }
    return runs > 1 && 2 * ones > points_ - runs;
  }

  /// True for a map of heights: neighbouring heights are similar, unlike the three coordinates of a scan.
  [[nodiscard]] bool is_height_map() const {
    if (columns_known_ || row_columns_ < 4 || points_ < kRowsToTell) return false;
    const std::size_t looked_at = std::min<std::size_t>(points_, 10'000);
    std::size_t alike = 0;
    for (std::size_t i = 0; i < looked_at; ++i) {
      const Real* p = &xyz_[3 * i];
      const auto [low, high] = std::minmax({p[0], p[1], p[2]});
      alike += high - low < static_cast<Real>(0.1) * std::max(std::abs(low), std::abs(high)) ? 1U : 0U;
    }
    return 20 * alike >= 19 * looked_at;
  }

  /// Takes all plain rows and returns the next other line.
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
    return lines_.refuse("column %zu: a byte 0; parts of the file were not written, or it is not text", at + 1);
  }

  Status comment(std::string_view text) {
    std::string_view found;
    const std::string_view words = text.substr(std::min(text.find_first_not_of("#/"), text.size()));
    if (!comment_agrees(words, unit_, found)) return unit_contradicted(window_.name(), lines_.number(), found, unit_);
    emulation_.take(words);
    if (!scanner_.take(words, found)) return temperature_refused(window_.name(), lines_.number(), found);
    return decided_ ? success() : names(names_in_comment(text));
  }

  /// A comment above the points may name the columns ("//X Y Z"); the last such comment counts.
  Status names(std::string_view text) {
    const Separator separator = separator_of(text);
    if (!chosen_.empty()) {
      if (!is_chosen_by_name(chosen_) || !is_line_of_names(text, separator) ||
          !has_chosen_columns(text, separator, chosen_))
        return success();
      named_line_ = lines_.number();
      named_count_ = count_columns(text, separator);
      return find_chosen_columns(lines_, text, separator, unit_, chosen_, named_);
    }
    if (!names_every_axis(text, separator)) {
      note_other_names(text, separator);
      return success();
    }
    named_ = {};
    named_line_ = lines_.number();
    named_count_ = count_columns(text, separator);
    return find_columns(lines_, text, separator, unit_, named_);
  }

  /// Remembers a comment that names columns, but not x, y and z. A sentence, whose words are separated by blanks, does
  /// not count.
  void note_other_names(std::string_view text, Separator separator) {
    if (!is_line_of_names(text, separator)) return;
    const std::optional<LikelyColumns> likely = likely_columns(text, separator);
    if (!likely && separator == Separator::blanks) return;
    other_names_line_ = lines_.number();
    other_names_separator_ = separator;
    other_names_count_ = count_columns(text, separator);
    other_names_.assign(shown(trimmed(text)).view());
    other_names_hint_ = hint_of_encoding(text);
    other_likely_ = likely ? likely->xyz : std::array<std::size_t, 3>{};
  }

  /// Rejects a table whose first row has as many columns as a comment names, if x, y and z need not be its first three.
  Status refuse_other_names() const {
    const bool as_many =
        other_names_line_ != 0 && separator_ == other_names_separator_ && row_columns_ == other_names_count_;
    if (!as_many || row_columns_ <= 3 || other_likely_ == TextColumns{}.xyz) return success();
    return lines_.refuse(
        "the comment on line %zu names the columns, none of them x, y or z: rename three, or choose them with "
        "%s; the names are \"%s\"%s",
        other_names_line_, how_to_choose("A,B,C").c_str(), other_names_.c_str(), other_names_hint_);
  }

  /// Uses the names in a comment if there are as many as columns. Otherwise a comment with x, y and z in the first
  /// three places changes nothing, and any other is ambiguous and rejected.
  Status take_names_of_comment() {
    if (named_line_ == 0) return refuse_other_names();
    columns_known_ = row_columns_ == named_count_;
    if (named_.xyz == TextColumns{}.xyz) return success();
    if (columns_known_) {
      columns_ = named_;
      return success();
    }
    return lines_.refuse(
        "%zu columns, but the comment on line %zu names %zu, and x, y, z are not its first three; which columns are x, "
        "y and z?",
        row_columns_, named_line_, named_count_);
  }

  /// True for the number of points, alone in a line before them: PTS, an option of CloudCompare.
  [[nodiscard]] bool is_count(std::string_view line) {
    if (count_line_ != 0 || points_ != 0 || !parse_count(trimmed(line), announced_)) return false;
    count_line_ = lines_.number();
    return true;
  }

  /// A first line of whole numbers above lines with decimals is a header and not a point. Skipped are column numbers
  /// and width, height and their product, which is the number of points; any other is rejected, because it is unknown.
  Status number_header(std::string_view line, bool& is_header) {
    std::array<std::uint64_t, 3> numbers{};
    if (!is_number_header(line, lines_.behind(), lines_.line_end(), separator_, numbers)) return success();
    is_header = true;
    if (are_column_numbers(line, separator_)) return success();
    const bool is_shape = numbers[0] > 1 && numbers[1] > 1 && numbers[1] <= kScanCountMax / numbers[0] &&
                          numbers[0] * numbers[1] == numbers[2] && count_columns(line, separator_) == 3;
    if (is_shape && count_line_ == 0) {
      announced_ = numbers[2];
      count_line_ = lines_.number();
      return announce();
    }
    return lines_.refuse(
        "\"%s\": whole numbers above lines with decimals are a header and not a point: leave the line out, or begin it "
        "with #",
        shown(trimmed(line)).c_str());
  }

  [[nodiscard]] Status announce() const {
    if (announced_ <= xyz_.size() / 3) return success();
    return lines_.refuse("%llu points, allowed are at most %zu", static_cast<unsigned long long>(announced_),
                         xyz_.size() / 3);
  }

  Status row(std::string_view line) {
    if (is_count(line)) return announce();
    if (!decided_) {
      separator_ = separator_of(line);
      if (points_ == 0 && is_line_of_column_numbers(line, separator_)) return success();
      if (!is_line_of_names(line, separator_)) {
        bool is_header = false;
        if (Status status = number_header(line, is_header); !status || is_header) return status;
      }
      if (is_line_of_names(line, separator_)) {
        // "Units: m" does not name a column.
        std::string_view found;
        if (!comment_agrees(line, unit_, found))
          return unit_contradicted(window_.name(), lines_.number(), found, unit_);
        if (declares_unit(line)) return success();
        decided_ = columns_known_ = true;
        return chosen_.empty() ? find_columns(lines_, line, separator_, unit_, columns_)
                               : find_chosen_columns(lines_, line, separator_, unit_, chosen_, columns_);
      }
      decided_ = true;
      row_columns_ = count_columns(line, separator_);
      sample_.take(line, lines_.behind(), lines_.line_end(), separator_);
      if (Status status = decide_without_names(line); !status) return status;
    }
    plain_ = columns_.xyz == TextColumns{}.xyz;
    if (3 * points_ + 3 > xyz_.size())
      return lines_.refuse("more than %zu points, the most that are allowed", xyz_.size() / 3);
    return point(line);
  }

  /// Determines the columns of x, y and z if no line names the columns.
  Status decide_without_names(std::string_view line) {
    if (chosen_.empty() || named_line_ != 0) {
      if (Status status = take_names_of_comment(); !status) return status;
    } else {
      columns_known_ = true;
      if (Status status = find_chosen_columns(lines_, {}, separator_, unit_, chosen_, columns_); !status) return status;
    }
    if (columns_known_) return success();
    if (is_line_of_tuples(line, separator_))
      return lines_.refuse("%zu columns: the points of a row side by side, x,y,z,x,y,z ...; save one point a line",
                           row_columns_);
    if (row_columns_ <= kTableColumnsMax) return success();
    return lines_.refuse(
        "%zu columns: a height map, not points (save the scan as points x y z, or choose three columns "
        "of points, as with %s)",
        row_columns_, how_to_choose("1,2,3").c_str());
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

  /// "1,5": a decimal comma while another character separates. "5 2": blanks within a field while commas separate.
  [[nodiscard]] const char* hint_for(std::string_view field) const {
    const bool comma_within = field.find(',') != std::string_view::npos;
    const bool blank_within = separator_ == Separator::comma && field.find_first_of(" \t") != std::string_view::npos;
    // "1,5" in quotes between commas comes as two fields.
    const bool quote_cut = separator_ == Separator::comma && (field.starts_with('"') != field.ends_with('"'));
    if (comma_within || blank_within || quote_cut)
      return "a decimal comma is not read: save the scan with decimal points";
    return nullptr;
  }

  ScanWindow& window_;
  TextLines lines_;
  LengthUnit unit_;
  double mm_;
  std::span<Real> xyz_;
  std::size_t points_ = 0;
  bool decided_ = false;
  DeclaredEmulation emulation_;
  DeclaredTemperature scanner_;
  bool plain_ = false;  ///< x, y, z are the first three columns
  Separator separator_ = Separator::blanks;
  TextColumns columns_;
  const TableColumns& chosen_;
  bool columns_known_ = false;   ///< by name or by selection
  std::size_t row_columns_ = 0;  ///< of the first row, when no line names the columns
  std::size_t count_line_ = 0;   ///< line with the number of points; 0: none
  std::uint64_t announced_ = 0;
  std::size_t other_names_line_ = 0;  ///< line of a comment that names columns, but not x, y and z; 0: none
  Separator other_names_separator_ = Separator::blanks;
  std::size_t other_names_count_ = 0;
  FixedString<63> other_names_;
  const char* other_names_hint_ = "";
  FirstRows sample_;
  std::array<std::size_t, 3> other_likely_{};
  std::size_t named_line_ = 0;  ///< line of the comment that names the columns; 0: none
  std::size_t named_count_ = 0;
  TextColumns named_;
};

}  // namespace

template <typename Real>
Result<ScanShape> read_text_points(ScanWindow& window, const ScanForm& form, std::span<Real> xyz) {
  return TextTable<Real>(window, form, xyz).read();
}

template Result<ScanShape> read_text_points(ScanWindow&, const ScanForm&, std::span<float>);
template Result<ScanShape> read_text_points(ScanWindow&, const ScanForm&, std::span<double>);

}  // namespace slabd::hal
