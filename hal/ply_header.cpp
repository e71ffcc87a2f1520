// SPDX-License-Identifier: Apache-2.0
#include "hal/ply_header.h"

#include <algorithm>
#include <charconv>
#include <optional>

// Problem: the header decides how five million vertices are read, and it comes from outside. Idea: one pass over
// lines, each line one small function that either extends the layout or refuses with its number. Invariant: a layout
// is returned only when x, y, z are known and every length was summed without overflow.
namespace slabd::hal {
namespace {

/// Splits off the next word of a header line.
std::string_view take_word(std::string_view& rest) {
  const std::size_t begin = rest.find_first_not_of(" \t");
  if (begin == std::string_view::npos) {
    rest = {};
    return {};
  }
  const std::size_t end = std::min(rest.find_first_of(" \t", begin), rest.size());
  const std::string_view word = rest.substr(begin, end - begin);
  rest.remove_prefix(end);
  return word;
}

std::optional<std::uint64_t> count_from(std::string_view word) {
  std::uint64_t value = 0;
  const auto [end, failed] = std::from_chars(word.data(), word.data() + word.size(), value);
  if (failed != std::errc{} || end != word.data() + word.size() || value > kPlyCountMax) return std::nullopt;
  return value;
}

/// Bytes of a PLY scalar type, 0 for an unknown name.
std::size_t bytes_of(std::string_view type) {
  if (type == "char" || type == "uchar" || type == "int8" || type == "uint8") return 1;
  if (type == "short" || type == "ushort" || type == "int16" || type == "uint16") return 2;
  if (type == "int" || type == "uint" || type == "float" || type == "int32" || type == "uint32" || type == "float32")
    return 4;
  if (type == "double" || type == "float64" || type == "int64" || type == "uint64") return 8;
  return 0;
}

bool is_float(std::string_view type) {
  return type == "float" || type == "float32";
}
bool is_double(std::string_view type) {
  return type == "double" || type == "float64";
}

class HeaderParser {
 public:
  HeaderParser(std::string_view head, const char* file) : head_(head), file_(file) {}

  Result<PlyLayout> parse() {
    if (head_.substr(0, 4) != "ply\n" && head_.substr(0, 5) != "ply\r\n")
      return error(Code::frame_incomplete, "%s: byte 0: not a PLY file (expected the line \"ply\")", file_);
    for (std::string_view line; next_line(line);) {
      if (line_number_ == 1) continue;
      if (line == "end_header") return finish();
      if (Status status = statement(line); !status) return status.error();
    }
    return error(Code::frame_incomplete, "%s: no end_header line in the first %zu bytes (at most %zu are a header)",
                 file_, head_.size(), limits::kScanHeaderBytesMax);
  }

 private:
  /// The text up to the next newline, without a carriage return before it; false when no whole line is left.
  bool next_line(std::string_view& line) {
    const std::size_t end = head_.find('\n', position_);
    if (end == std::string_view::npos) return false;
    line = head_.substr(position_, end - position_);
    if (!line.empty() && line.back() == '\r') line.remove_suffix(1);
    position_ = end + 1;
    ++line_number_;
    return true;
  }

  Status statement(std::string_view line) {
    std::string_view rest = line;
    const std::string_view keyword = take_word(rest);
    if (keyword == "comment") return comment(rest);
    if (keyword == "obj_info") return success();
    if (keyword == "format") return format(rest);
    if (keyword == "element") return element(rest);
    if (keyword == "property") return property(rest);
    return refuse("unknown statement", keyword, "known: format, comment, obj_info, element, property, end_header");
  }

  Status format(std::string_view rest) {
    const std::string_view name = take_word(rest);
    const std::string_view version = take_word(rest);
    if (format_seen_) return refuse("second format line", name);
    if (name == "ascii") return refuse("unsupported format", name, "save the scan as binary PLY");
    if (name != "binary_little_endian" && name != "binary_big_endian")
      return refuse("unknown format", name, "supported: binary_little_endian, binary_big_endian");
    if (version != "1.0") return refuse("unknown PLY version", version, "supported: 1.0");
    layout_.big_endian = name == "binary_big_endian";
    format_seen_ = true;
    return success();
  }

  /// `comment organized width W height H`; every other comment is for people.
  Status comment(std::string_view rest) {
    if (take_word(rest) != "organized") return success();
    const std::string_view text = rest.substr(std::min<std::size_t>(1, rest.size()));
    const bool width_named = take_word(rest) == "width";
    const auto width = count_from(take_word(rest));
    const bool height_named = take_word(rest) == "height";
    const auto height = count_from(take_word(rest));
    // Both sides stay below 2^31 so that their product cannot wrap.
    constexpr std::uint64_t kSideMax = std::uint64_t{1} << 31U;
    if (!width_named || !height_named || !width || !height || *width == 0 || *height == 0 || *width > kSideMax ||
        *height > kSideMax || !take_word(rest).empty())
      return refuse("malformed comment organized", text, "expected: comment organized width W height H, both 1..2^31");
    if (layout_.width != 0) return refuse("second comment organized", text);
    layout_.width = *width;
    layout_.height = *height;
    return success();
  }

  Status element(std::string_view rest) {
    const std::string_view name = take_word(rest);
    const std::string_view number = take_word(rest);
    const auto count = count_from(number);
    if (name.empty() || !count) return refuse("element count", number, "allowed: 0..2^40");
    if (Status status = close_element(); !status) return status;
    if (name == "vertex" && vertex_seen_) return refuse("second element", name);
    in_element_ = true;
    in_vertex_ = name == "vertex";
    vertex_seen_ = vertex_seen_ || in_vertex_;
    count_ = *count;
    stride_ = 0;
    has_list_ = false;
    return success();
  }

  Status property(std::string_view rest) {
    const std::string_view type = take_word(rest);
    if (!in_element_) return refuse("property before any element:", type);
    if (type == "list") return list_property(rest);
    const std::string_view name = take_word(rest);
    const std::size_t bytes = bytes_of(type);
    if (bytes == 0 || name.empty())
      return refuse("unknown property type", type,
                    "known: char uchar short ushort int uint float double, int8..float64");
    if (in_vertex_) {
      if (Status status = coordinate(type, name); !status) return status;
    }
    stride_ += bytes;
    if (stride_ > kPlyStrideMax) return refuse("element too long at property", name, "at most 536 bytes each");
    return success();
  }

  Status list_property(std::string_view rest) {
    const std::string_view count_type = take_word(rest);
    const std::size_t bytes = bytes_of(count_type);
    if (in_vertex_) return refuse("list property in element vertex:", rest, "only scalars have a fixed place");
    if (bytes == 0) return refuse("unknown list count type", count_type);
    has_list_ = true;
    stride_ += bytes;  // an empty list still stores its count
    if (stride_ > kPlyStrideMax) return refuse("element too long at list", rest, "at most 536 bytes each");
    return success();
  }

  Status coordinate(std::string_view type, std::string_view name) {
    constexpr std::string_view kAxes = "xyz";
    const std::size_t axis = name.size() == 1 ? kAxes.find(name[0]) : std::string_view::npos;
    if (axis == std::string_view::npos) return success();
    if (!is_float(type) && !is_double(type)) return refuse("coordinate of type", type, "supported: float, double");
    if (axis_seen_[axis]) return refuse("second property", name);
    axis_seen_[axis] = true;
    layout_.xyz[axis] = {stride_, is_double(type)};
    return success();
  }

  /// Adds the element just described to the lengths.
  Status close_element() {
    if (!in_element_) return success();
    if (in_vertex_) {
      layout_.vertices = count_;
      layout_.stride = stride_;
      layout_.vertex_offset = body_bytes_;  // the header's own length is added at its end
    } else if (!vertex_seen_ && has_list_ && count_ > 0) {
      return refuse("list element before element vertex", {}, "the vertices' place would not be fixed");
    }
    body_bytes_ += count_ * stride_;
    open_ended_ = open_ended_ || (has_list_ && count_ > 0);
    // At most 16 kB of header holds fewer than 2048 elements; each adds below 2^50 bytes, so the sum needs a check.
    if (body_bytes_ > std::uint64_t{1} << 60U) return refuse("elements of more than 2^60 bytes");
    return success();
  }

  Result<PlyLayout> finish() {
    if (!format_seen_) return refuse("no format line before end_header").error();
    if (Status status = close_element(); !status) return status.error();
    if (!vertex_seen_) return refuse("no element vertex").error();
    if (!axis_seen_[0] || !axis_seen_[1] || !axis_seen_[2])
      return refuse("element vertex lacks property x, y or z").error();
    if (layout_.vertices == 0) return error(Code::too_few_points, "%s: element vertex 0: no points at all", file_);
    if (layout_.width != 0 && layout_.width * layout_.height != layout_.vertices)
      return error(Code::frame_incomplete, "%s: organized width %llu height %llu is not the vertex count %llu", file_,
                   static_cast<unsigned long long>(layout_.width), static_cast<unsigned long long>(layout_.height),
                   static_cast<unsigned long long>(layout_.vertices));
    layout_.vertex_offset += position_;
    layout_.bytes_min = position_ + body_bytes_;
    layout_.bytes_exact = !open_ended_;
    return layout_;
  }

  /// "file: header line n: what "subject" (hint)".
  Status refuse(const char* what, std::string_view subject = {}, const char* hint = nullptr) const {
    constexpr std::size_t kShownMax = 60;
    FixedString<kShownMax + 3> quoted;
    if (!subject.empty()) {
      quoted.append(" \"");
      quoted.append(subject.substr(0, kShownMax));
      quoted.append("\"");
    }
    const bool hinted = hint != nullptr;
    return error(Code::frame_incomplete, "%s: header line %zu: %s%s%s%s%s", file_, line_number_, what, quoted.c_str(),
                 hinted ? " (" : "", hinted ? hint : "", hinted ? ")" : "");
  }

  std::string_view head_;
  const char* file_;
  std::size_t position_ = 0;
  std::size_t line_number_ = 0;

  PlyLayout layout_;
  bool format_seen_ = false;
  bool vertex_seen_ = false;
  std::array<bool, 3> axis_seen_{};
  std::uint64_t body_bytes_ = 0;  ///< of all elements so far
  bool open_ended_ = false;

  // The element being described.
  bool in_element_ = false;
  bool in_vertex_ = false;
  bool has_list_ = false;
  std::uint64_t count_ = 0;
  std::size_t stride_ = 0;
};

}  // namespace

Result<PlyLayout> parse_ply_header(std::string_view head, const char* file) {
  return HeaderParser(head, file).parse();
}

}  // namespace slabd::hal
