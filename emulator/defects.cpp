// SPDX-License-Identifier: Apache-2.0
#include "emulator/defects.h"

#include <fmt/core.h>

#include <array>
#include <charconv>
#include <optional>

namespace slabd::emulator {
namespace {

struct Kind {
  DefectKind kind;
  std::string_view name;
  std::string_view value;  ///< text after K: in help and errors
  double min = 0.0;
  double max = 0.0;
  std::string_view meaning;
  bool whole_slab = false;  ///< written without K
};

constexpr std::array kKinds = {
    Kind{DefectKind::slope, "slope", "N", 20, 200, "bearing plane climbs 1:N"},
    Kind{DefectKind::jaw_angle_inner, "jaw-angle-inner", "DEG", -8, 8, "deviation of the inner jaw angle"},
    Kind{DefectKind::jaw_angle_outer, "jaw-angle-outer", "DEG", -8, 8, "deviation of the outer jaw angle"},
    Kind{DefectKind::jaw_distance, "jaw-distance", "MM", -20, 20, "deviation of the jaw distance"},
    Kind{DefectKind::protrusion_inner, "protrusion-inner", "MM", -5, 5, "deviation of the inner casing's height"},
    Kind{DefectKind::protrusion_outer, "protrusion-outer", "MM", -5, 5, "deviation of the outer casing's height"},
    Kind{DefectKind::casing_spacing, "casing-spacing", "MM", -20, 20, "deviation of the casings' spacing"},
    Kind{DefectKind::bump, "bump", "MM", -5, 5, "dome in the middle of the bearing plane"},
    Kind{DefectKind::chip, "chip", "MM", 0, 5, "spot of 6 mm spalled off the seat, its depth"},
    Kind{DefectKind::burr, "burr", "MM", 0, 5, "ridge of 15 x 4 mm on the seat, its height"},
    Kind{DefectKind::sunk_seat, "sunk-seat", "MM", 0, 30, "bearing plane sunk beyond x = 55 mm"},
    Kind{DefectKind::broken_corner, "broken-corner", "MM", 0, 60,
         "corner of 48 x 85 mm (x > 57, y > 155) broken out of the block, its depth"},
    Kind{DefectKind::missing, "missing", "", 0, 0, "no block there, only the slab's top"},
    Kind{DefectKind::outliers, "outliers", "SHARE", 0, 0.5, "share of outliers in this scan"},
    Kind{DefectKind::noise, "noise", "MM", 0, 1, "noise of this scan"},
    Kind{DefectKind::glove, "glove", "MM", -240, 240, "a glove left on the block, its place along the seat"},
    Kind{DefectKind::cable, "cable", "MM", -105, 105, "a cable of 10 mm over the block, its place along the rail"},
    Kind{DefectKind::robot, "robot", "MM", -20, 20, "the reported flange is this much above the real one"},
    Kind{DefectKind::along, "along", "MM", -20, 20, "block moved along slab X"},
    Kind{DefectKind::lateral, "lateral", "MM", -20, 20, "block moved along slab Y"},
    Kind{DefectKind::vertical, "vertical", "MM", -20, 20, "block moved along slab Z"},
    Kind{DefectKind::large_jaw, "large-jaw", "MM", -20, 20,
         "both jaws of the block moved outward, the casings in place"},
    Kind{DefectKind::corner_level, "corner-level", "MM", -20, 20, "slab twisted to this corner level", true},
    Kind{DefectKind::warp_left, "warp-left", "MM", -20, 20, "row Y > 0 bent, its middle this much up", true},
    Kind{DefectKind::warp_right, "warp-right", "MM", -20, 20, "row Y < 0 bent, its middle this much up", true},
};

const Kind* find_kind(std::string_view name) {
  for (const Kind& kind : kKinds)
    if (kind.name == name) return &kind;
  return nullptr;
}

template <typename Number>
std::optional<Number> number_from(std::string_view text) {
  Number value{};
  const char* end = text.data() + text.size();
  const auto [stop, fault] = std::from_chars(text.data(), end, value);
  if (fault != std::errc{} || stop != end || text.empty()) return std::nullopt;
  return value;
}

std::string form_of(const Kind& kind) {
  if (kind.whole_slab) return fmt::format("{}={}", kind.name, kind.value);
  return fmt::format("{}=K{}{}", kind.name, kind.value.empty() ? "" : ":", kind.value);
}

Error refuse(const std::string& text) {
  return error(Code::config, "--defect %s", text.c_str());
}

}  // namespace

Result<Defect> parse_defect(std::string_view text) {
  const std::size_t equals = text.find('=');
  const Kind* kind = find_kind(text.substr(0, equals));
  if (kind == nullptr) {
    std::string known;
    for (const Kind& k : kKinds) known += fmt::format("{}{}", known.empty() ? "" : ", ", k.name);
    return refuse(fmt::format("'{}': unknown defect, allowed {}", text.substr(0, equals), known));
  }
  const bool has_number = !kind->value.empty();
  const std::string form = form_of(*kind);
  if (equals == std::string_view::npos) return refuse(fmt::format("{}: expected {}", text, form));

  std::string_view rest = text.substr(equals + 1);
  int station = 0;
  if (!kind->whole_slab) {
    const std::size_t colon = rest.find(':');
    const auto block = number_from<int>(rest.substr(0, colon));
    if (!block || *block < 1 || *block > static_cast<int>(limits::kStationsMax))
      return refuse(fmt::format("{}: expected {}, block K is 1..{}", text, form, limits::kStationsMax));
    station = *block;
    if (has_number == (colon == std::string_view::npos)) return refuse(fmt::format("{}: expected {}", text, form));
    if (!has_number) return Defect{kind->kind, station, 0.0};
    rest = rest.substr(colon + 1);
  }
  if (kind->kind == DefectKind::slope && (rest.starts_with("1:") || rest.starts_with("1/"))) rest = rest.substr(2);
  const auto value = number_from<double>(rest);
  if (!value || !(*value >= kind->min && *value <= kind->max))
    return refuse(fmt::format("{}: expected {}, {} is {}..{}", text, form, kind->value, kind->min, kind->max));
  return Defect{kind->kind, station, *value};
}

std::string defect_help() {
  std::string help;
  for (const Kind& kind : kKinds) {
    const std::string form = form_of(kind);
    help += kind.value.empty()
                ? fmt::format("  {:24} {}\n", form, kind.meaning)
                : fmt::format("  {:24} {} ({} {}..{})\n", form, kind.meaning, kind.value, kind.min, kind.max);
  }
  return help;
}

}  // namespace slabd::emulator
