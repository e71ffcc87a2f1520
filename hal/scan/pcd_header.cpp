// SPDX-License-Identifier: Apache-2.0
#include "hal/scan/pcd_header.h"

#include <cmath>

#include "hal/scan/text_lines.h"

// Problem: as for PLY, but what belongs to one field is spread over four lines (FIELDS, SIZE, TYPE, COUNT) whose order
// is a habit and no law. Idea: every line is taken as a row of words or numbers first; they are laid side by side when
// DATA, the last line, has come. Invariant: a layout is returned only when all four rows have one length, x, y and z
// are known and no length can have overflowed.
namespace slabd::hal {
namespace {

struct Field {
  FixedString<8> name;  ///< only "x", "y" and "z" matter; longer names are cut
  std::uint64_t size = 0;
  char type = 0;
  std::uint64_t count = 1;
};

class HeaderParser {
 public:
  HeaderParser(std::string_view head, const char* file, LengthUnit unit) : head_(head), file_(file), unit_(unit) {}

  Result<PcdLayout> parse() {
    layout_.line_end = first_line_end(head_);
    for (std::string_view line; next_line(line);) {
      if (Status status = statement(line); !status) return status.error();
      if (data_seen_) return finish();
    }
    return error(Code::frame_incomplete,
                 "%s: not a PCD file, or a cut one: no DATA line in the first %zu bytes (at most %zu are a header)",
                 file_, head_.size(), limits::kScanHeaderBytesMax);
  }

 private:
  bool next_line(std::string_view& line) {
    if (!next_header_line(head_, layout_.line_end, position_, line)) return false;
    ++line_number_;
    return true;
  }

  Status statement(std::string_view line) {
    std::string_view rest = line;
    const std::string_view keyword = take_word(rest);
    if (keyword.empty()) return success();
    if (keyword.starts_with('#')) return comment(trimmed(line).substr(1));
    if (keyword == "VERSION") return version(rest);
    if (keyword == "FIELDS") return fields(rest);
    if (keyword == "SIZE") return sizes(rest);
    if (keyword == "TYPE") return types(rest);
    if (keyword == "COUNT") return counts(rest);
    if (keyword == "WIDTH") return number(keyword, rest, width_seen_, width_);
    if (keyword == "HEIGHT") return number(keyword, rest, height_seen_, height_);
    if (keyword == "POINTS") return number(keyword, rest, points_seen_, points_);
    if (keyword == "VIEWPOINT") return viewpoint(rest);
    if (keyword == "DATA") return data(rest);
    return refuse("unknown statement", keyword,
                  "known: VERSION FIELDS SIZE TYPE COUNT WIDTH HEIGHT VIEWPOINT POINTS DATA");
  }

  Status comment(std::string_view text) {
    std::string_view found;
    layout_.emulation.take(text);
    if (comment_agrees(text, unit_, found)) return success();
    return unit_contradicted(file_, line_number_, found, unit_);
  }

  Status version(std::string_view rest) {
    const std::string_view word = take_word(rest);
    if (word == "0.7" || word == ".7" || word == "0.6" || word == ".6") return success();
    return refuse("unknown PCD version", word, "supported: 0.6, 0.7");
  }

  // ---- the four rows

  Status fields(std::string_view rest) {
    if (names_ != 0) return refuse("second FIELDS line");
    for (std::string_view word = take_word(rest); !word.empty(); word = take_word(rest)) {
      if (names_ == kPcdFieldsMax) return refuse("too many fields at", word, "allowed: 64");
      fields_[names_++].name = word.size() == 1 ? word : "other";
    }
    return names_ != 0 ? success() : refuse("FIELDS without a name");
  }

  Status sizes(std::string_view rest) {
    return row(rest, sizes_, [this](Field& field, std::string_view word) {
      const bool known =
          parse_count(word, field.size) && (field.size == 1 || field.size == 2 || field.size == 4 || field.size == 8);
      return known ? success() : refuse("SIZE", word, "allowed: 1, 2, 4, 8");
    });
  }

  Status types(std::string_view rest) {
    return row(rest, types_, [this](Field& field, std::string_view word) {
      field.type = word[0];
      const bool known = word == "F" || word == "I" || word == "U";
      return known ? success() : refuse("TYPE", word, "allowed: F, I, U");
    });
  }

  Status counts(std::string_view rest) {
    return row(rest, counts_, [this](Field& field, std::string_view word) {
      const bool known = parse_count(word, field.count) && field.count >= 1 && field.count <= kScanPointBytesMax;
      return known ? success() : refuse("COUNT", word, "allowed: 1..4096");
    });
  }

  /// One word per field, in their order; how many is checked at the end.
  template <typename Use>
  Status row(std::string_view rest, std::size_t& words, Use use) {
    if (words != 0) return refuse("a second line of this kind");
    for (std::string_view word = take_word(rest); !word.empty(); word = take_word(rest)) {
      if (words == kPcdFieldsMax) return refuse("too many values at", word, "allowed: one per field, at most 64");
      if (Status status = use(fields_[words++], word); !status) return status;
    }
    return success();
  }

  // ---- the rest

  Status number(std::string_view keyword, std::string_view rest, bool& seen, std::uint64_t& value) {
    const std::string_view word = take_word(rest);
    if (seen) return refuse("second line", keyword);
    if (!parse_count(word, value) || !take_word(rest).empty()) return refuse("not a count:", word, "allowed: 0..2^40");
    seen = true;
    return success();
  }

  /// tx ty tz qw qx qy qz of the sensor when the cloud was taken. Checked, so that nothing else hides here.
  Status viewpoint(std::string_view rest) {
    for (int i = 0; i < 7; ++i) {
      const std::string_view word = take_word(rest);
      double value = 0.0;
      if (!parse_number(word, value) || !std::isfinite(value))
        return refuse("VIEWPOINT", word,
                      word.find(',') != std::string_view::npos ? "expected: seven numbers with decimal points"
                                                               : "expected: seven numbers tx ty tz qw qx qy qz");
    }
    return take_word(rest).empty() ? success() : refuse("VIEWPOINT of more than seven numbers");
  }

  Status data(std::string_view rest) {
    const std::string_view word = take_word(rest);
    if (word == "ascii")
      layout_.data = PcdData::ascii;
    else if (word == "binary")
      layout_.data = PcdData::binary;
    else if (word == "binary_compressed")
      layout_.data = PcdData::binary_compressed;
    else
      return refuse("unknown DATA", word, "supported: ascii, binary, binary_compressed");
    data_seen_ = true;
    return success();
  }

  // ---- side by side

  Result<PcdLayout> finish() {
    if (names_ == 0) return refuse("no FIELDS line before DATA").error();
    if (sizes_ != names_ || types_ != names_ || (counts_ != 0 && counts_ != names_))
      return error(Code::frame_incomplete, "%s: header: %zu FIELDS, but %zu SIZE, %zu TYPE, %zu COUNT", file_, names_,
                   sizes_, types_, counts_);
    if (!width_seen_ || !height_seen_) return refuse("no WIDTH or no HEIGHT line before DATA").error();
    if (Status status = find_places(); !status) return status.error();
    if (Status status = count_points(); !status) return status.error();
    layout_.header_bytes = position_;
    layout_.header_lines = line_number_;
    sum_lengths();
    return layout_;
  }

  Status find_places() {
    std::array<bool, 3> seen{};
    for (std::size_t i = 0; i < names_; ++i) {
      const Field& field = fields_[i];
      const std::size_t axis = std::string_view("xyz").find(field.name.view());
      if (axis != std::string_view::npos) {
        if (seen[axis]) return refuse("second field", field.name.view());
        if (field.type != 'F' || field.count != 1 || field.size < 4)
          return refuse("unsupported coordinate", field.name.view(), "supported: TYPE F, SIZE 4 or 8, COUNT 1");
        seen[axis] = true;
        layout_.xyz[axis] = {layout_.stride, layout_.values, field.size == 8};
      }
      layout_.stride += field.size * field.count;
      layout_.values += field.count;
      if (layout_.stride > kScanPointBytesMax) return refuse("a point of more than 4096 bytes");
    }
    return seen[0] && seen[1] && seen[2] ? success() : refuse("FIELDS lacks x, y or z");
  }

  Status count_points() {
    constexpr std::uint64_t kSideMax = std::uint64_t{1} << 31U;  // so that their product cannot wrap
    if (width_ > kSideMax || height_ > kSideMax) return refuse("WIDTH or HEIGHT beyond 2^31");
    layout_.points = width_ * height_;
    if (layout_.points > kScanCountMax) return refuse("WIDTH * HEIGHT beyond 2^40");
    if (points_seen_ && points_ != layout_.points)
      return error(Code::frame_incomplete, "%s: header: POINTS %llu is not WIDTH %llu * HEIGHT %llu", file_,
                   static_cast<unsigned long long>(points_), static_cast<unsigned long long>(width_),
                   static_cast<unsigned long long>(height_));
    if (layout_.points == 0) return error(Code::too_few_points, "%s: WIDTH * HEIGHT is 0: no points at all", file_);
    if (height_ > 1) {
      layout_.width = width_;
      layout_.height = height_;
    }
    return success();
  }

  void sum_lengths() {
    switch (layout_.data) {
      case PcdData::ascii:  // a value as text has a digit and something behind it, the last one needs nothing there
        layout_.bytes_min = position_ + layout_.points * layout_.values * 2 - 1;
        break;
      case PcdData::binary:
        layout_.bytes_min = position_ + layout_.points * layout_.stride;
        layout_.bytes_exact = true;
        break;
      case PcdData::binary_compressed: layout_.bytes_min = position_ + kPcdCompressedPrefixBytes; break;
    }
  }

  /// "file: header line n: what "subject" (hint)".
  Status refuse(const char* what, std::string_view subject = {}, const char* hint = nullptr) const {
    FixedString<70> quoted;
    if (!subject.empty()) quoted.printf(" \"%s\"", shown(subject).c_str());
    const bool hinted = hint != nullptr;
    return error(Code::frame_incomplete, "%s: header line %zu: %s%s%s%s%s", file_, line_number_, what, quoted.c_str(),
                 hinted ? " (" : "", hinted ? hint : "", hinted ? ")" : "");
  }

  std::string_view head_;
  const char* file_;
  LengthUnit unit_;
  std::size_t position_ = 0;
  std::size_t line_number_ = 0;

  PcdLayout layout_;
  std::array<Field, kPcdFieldsMax> fields_;
  std::size_t names_ = 0, sizes_ = 0, types_ = 0, counts_ = 0;  ///< words in each of the four rows
  std::uint64_t width_ = 0, height_ = 0, points_ = 0;
  bool width_seen_ = false, height_seen_ = false, points_seen_ = false, data_seen_ = false;
};

}  // namespace

Result<PcdLayout> parse_pcd_header(std::string_view head, const char* file, LengthUnit unit) {
  return HeaderParser(head, file, unit).parse();
}

}  // namespace slabd::hal
