// SPDX-License-Identifier: Apache-2.0
#include "hal/scan/declared_unit.h"

#include <algorithm>
#include <array>
#include <optional>

#include "hal/scan/text_lines.h"

namespace slabd::hal {
namespace {

/// Metres per unit name. Units that slabd does not read are here too: a file in inches must not pass for mm.
struct UnitName {
  std::string_view name;
  double metres;
};
constexpr std::array<UnitName, 40> kUnitNames = {{
    {"m", 1.0},           {"meter", 1.0},        {"meters", 1.0},      {"metre", 1.0},
    {"metres", 1.0},      {"mm", 1e-3},          {"millimeter", 1e-3}, {"millimeters", 1e-3},
    {"millimetre", 1e-3}, {"millimetres", 1e-3}, {"um", 1e-6},         {"\xC2\xB5m", 1e-6},
    {"\xCE\xBCm", 1e-6},  {"\xB5m", 1e-6},       {"micron", 1e-6},     {"microns", 1e-6},
    {"micrometer", 1e-6}, {"micrometers", 1e-6}, {"micrometre", 1e-6}, {"micrometres", 1e-6},
    {"nm", 1e-9},         {"cm", 1e-2},          {"centimeter", 1e-2}, {"centimeters", 1e-2},
    {"centimetre", 1e-2}, {"centimetres", 1e-2}, {"dm", 1e-1},         {"km", 1e3},
    {"in", 0.0254},       {"inch", 0.0254},      {"inches", 0.0254},   {"mil", 2.54e-5},
    {"mils", 2.54e-5},    {"thou", 2.54e-5},     {"ft", 0.3048},       {"foot", 0.3048},
    {"feet", 0.3048},     {"yd", 0.9144},        {"yard", 0.9144},     {"yards", 0.9144},
}};

double metres_per(LengthUnit unit) {
  switch (unit) {
    case LengthUnit::mm: return 1e-3;
    case LengthUnit::m: return 1.0;
    case LengthUnit::um: return 1e-6;
  }
  return 1e-3;
}

bool is_one_of(std::string_view word, std::initializer_list<std::string_view> words) {
  const FixedString<16> wanted = lower_case(word);
  return std::find(words.begin(), words.end(), wanted.view()) != words.end();
}

/// Words of a comment: what stands between blanks, ':' , '=', ',' and quotes or brackets.
std::string_view take_comment_word(std::string_view& rest) {
  constexpr std::string_view kBetween = " \t:=,;\"'()[]";
  const std::size_t begin = rest.find_first_not_of(kBetween);
  if (begin == std::string_view::npos) {
    rest = {};
    return {};
  }
  const std::size_t end = std::min(rest.find_first_of(kBetween, begin), rest.size());
  const std::string_view word = rest.substr(begin, end - begin);
  rest.remove_prefix(end);
  return word;
}

std::optional<double> metres_of(std::string_view word) {
  if (word.size() > FixedString<16>::capacity()) return std::nullopt;
  const FixedString<16> wanted = lower_case(word);
  for (const UnitName& unit : kUnitNames)
    if (wanted == unit.name) return unit.metres;
  return std::nullopt;
}

/// "unit of length is mm".
bool is_filler(std::string_view word) {
  return is_one_of(word, {"is", "are", "of", "length"});
}

}  // namespace

double mm_per(LengthUnit unit) {
  switch (unit) {
    case LengthUnit::mm: return 1.0;
    case LengthUnit::m: return kMmPerM;
    case LengthUnit::um: return 0.001;
  }
  return 1.0;
}

const char* name(LengthUnit unit) {
  switch (unit) {
    case LengthUnit::mm: return "mm";
    case LengthUnit::m: return "m";
    case LengthUnit::um: return "um";
  }
  return "mm";
}

bool comment_agrees(std::string_view text, LengthUnit configured, std::string_view& found) {
  std::string_view word = take_comment_word(text);
  if (is_one_of(word, {"length"})) word = take_comment_word(text);
  if (!is_one_of(word, {"unit", "units", "length_unit", "length_units"})) return true;
  do {
    found = take_comment_word(text);
  } while (is_filler(found));
  // "units in mm" is not a file in inches.
  if (const std::string_view after = take_comment_word(text); is_one_of(found, {"in"}) && metres_of(after))
    found = after;
  return unit_name_agrees(found, configured);
}

bool declares_unit(std::string_view text) {
  std::string_view found;
  static_cast<void>(comment_agrees(text, LengthUnit::mm, found));
  return metres_of(found).has_value();
}

void DeclaredEmulation::take(std::string_view comment) {
  if (!is_one_of(take_comment_word(comment), {"emulated"})) return;
  emulated = true;
  while (!comment.empty())
    if (take_comment_word(comment) == "block") {
      std::uint64_t number = 0;
      if (parse_count(take_comment_word(comment), number) && number <= limits::kStationsMax)
        block = static_cast<std::uint8_t>(number);
      return;
    }
}

bool unit_name_agrees(std::string_view word, LengthUnit configured) {
  const std::optional<double> metres = metres_of(word);
  return !metres || *metres == metres_per(configured);
}

Error unit_contradicted(const char* file, std::size_t line, std::string_view found, LengthUnit configured) {
  return error(Code::frame_incomplete, "%s: line %zu: the file says unit \"%s\", but \"%s\" is configured (%s)", file,
               line, shown(found).c_str(), name(configured), "[scanner] unit, or --unit; known: mm, m, um");
}

}  // namespace slabd::hal
