// SPDX-License-Identifier: Apache-2.0
#include "emulator/concrete_effects.h"

#include <fmt/core.h>

#include <charconv>
#include <cmath>

namespace slabd::emulator {
namespace {

constexpr std::array<EffectInfo, kEffects> kEffectTable = {{
    {Effect::cast, "cast", 1, "dimensions off within half of the tolerances; shoulders, ends, top off by up to 0.4 mm"},
    {Effect::fillet, "fillet", 1,
     "fillets: 4 mm (+-25 %) at seat and jaw, 3 mm at jaw and shoulder, 6 mm at the slab top"},
    {Effect::chamfer, "chamfer", 1, "chamfers of 4 mm at the outer edges of the block"},
    {Effect::wear, "wear", 1, "chamfers and fillets vary by +-40 % along the edge"},
    {Effect::voids, "voids", 1, "80 pores on the block, log-normal, median 1 mm, 0.5..8 mm, up to 3 mm deep"},
    {Effect::burrs, "burrs", 1, "12 protrusions on the block, 0.1..0.3 mm high, 1..4 mm wide"},
    {Effect::fin, "fin", 1, "flash line across the seat next to the evaluation region, 0.1 mm high, 0.8 mm wide"},
    {Effect::fin_crop, "fin_crop", 0, "the same flash line inside the evaluation region"},
    {Effect::grain, "grain", 1, "sand grain, 0.010 mm rms, correlation length 2 mm"},
    {Effect::relief, "relief", 1, "shoulders and slab top undulate by 0.15 mm rms, wavelengths of 60..200 mm"},
    {Effect::wave, "wave", 1, "waviness of 0.03 mm peak to valley, wavelengths of 50..150 mm"},
    {Effect::rim_tilt, "rim_tilt", 1, "rims tilted by 0.15 deg"},
    {Effect::rim_edge, "rim_edge", 1, "chamfer of 0.4 mm at the edge of the bores"},
    {Effect::rim_slurry, "rim_slurry", 0, "cement crust of 0.1..0.35 mm over 15 % of the rims"},
    {Effect::rim_drop, "rim_drop", 1, "rims of dark plastic: 15 % missing in clumps, noise doubled"},
    {Effect::thread, "thread", 0, "returns from the wall of the bores, down to 10 mm"},
    {Effect::plug, "plug", 0, "recessed plug of 29 mm, 2 mm below the rim (1: outer casing, 2: both)"},
    {Effect::cap, "cap", 0, "cap with a flange of 40 mm, 2 mm over the rim (1: outer casing, 2: both)"},
    {Effect::dirt, "dirt", 0, "bores half filled with sand, 4..10 mm below the rim"},
    {Effect::bore_water, "bore_water", 0, "water in the bores 3 mm below the rim: a tenth returns, +-0.4 mm"},
    {Effect::noise, "noise", 1, "0.013 mm along the ray, half of the variance shared by 2 x 2 pixels"},
    {Effect::incidence, "incidence", 1, "noise grows as 1/cos of the incidence"},
    {Effect::ripple, "ripple", 1, "periodic error of 0.010 mm, period 2..6 mm across the track"},
    {Effect::patch, "patch", 1, "a dark or wet patch of 40..90 mm: noise x 2.5, 15 % missing"},
    {Effect::steep, "steep", 1, "dropouts from 68 deg of incidence on, no points from 82 deg on"},
    {Effect::shadow, "shadow", 1, "a point must be seen by the projector and by both cameras (base 260 mm)"},
    {Effect::inter, "inter", 1, "interreflection fills the jaw corner by 0.1 mm, decaying over 2 mm"},
    {Effect::flying, "flying", 1, "at depth steps 30 % of the pixels lie between the surfaces"},
    {Effect::outliers, "outliers", 1, "0.05 % of the points are off by 1..30 mm"},
    {Effect::dropout, "dropout", 1, "1 % of the points missing"},
    {Effect::lens, "lens", 1, "low-order form error of +-0.012 mm over the field; rays off the even grid by 0.2 %"},
    {Effect::scale, "scale", 1, "lengths off by up to 25 ppm"},
    {Effect::dust, "dust", 0.5, "300 grains of 0.1..0.5 mm on the block, a film of dust of up to 0.02 mm in places"},
    {Effect::drops, "drops", 0, "6 water drops of 4..9 mm on the seat, mostly dropouts"},
    {Effect::strap, "strap", 0, "a strap 15 mm wide and 2 mm thick across the seat next to the evaluation region"},
    {Effect::strap_crop, "strap_crop", 0, "the same strap across the evaluation region"},
    {Effect::film, "film", 0, "smears of release agent, 0.03 mm thick, glossy"},
    {Effect::chalk, "chalk", 0, "a chalk stroke 8 mm wide across the seat: 0.03 mm, steps of 0.02 mm at its edges"},
    {Effect::pose, "pose", 1, "block off by 2 mm and 0.3 deg from where the robot reports it"},
    {Effect::offset, "offset", 0, "block 30 mm off the centre of the field across the track, 15 mm along the rail"},
    {Effect::tilt, "tilt", 0, "scanner tilted by 5 deg, as the robot reports"},
    {Effect::standoff, "standoff", 0, "scanner 25 mm further away (negative: nearer), as the robot reports"},
    {Effect::grid_left, "grid_left", 0,
     "the pixel grid belongs to the left camera, 130 mm from the origin of the scan"},
    {Effect::misfit, "misfit", 0, "merged from two views of 0.03 mm and 0.005 deg misfit, unorganised"},
}};

using Kind = ConcreteDefectKind;
constexpr std::array<ConcreteDefectInfo, kConcreteDefects> kDefectTable = {{
    {Kind::depression, "depression", 0.9, "seat_flatness", "bowl 30 mm wide in the evaluation region, its depth in mm"},
    {Kind::hump, "hump", 1.2, "seat_flatness", "hump 30 mm wide in the evaluation region, its height in mm"},
    {Kind::bow, "bow", 1.3, "seat_flatness", "ridge of 190 mm along the rail, mm in the evaluation region"},
    {Kind::slope, "slope", 0.15, "seat_slope", "slope off by this many degrees"},
    {Kind::jaw_distance, "jaw_distance", 0.8, "jaw_distance", "jaws too far apart by this many mm"},
    {Kind::jaw_angle, "jaw_angle", 1.4, "jaw_angle_outer", "outer jaw off by this many degrees"},
    {Kind::casing_out, "casing_out", 0.35, "casing_protrusion_outer", "rim of the outer casing over the seat, mm"},
    {Kind::casing_sunk, "casing_sunk", 0.45, "casing_protrusion_inner", "inner casing sunk further, mm"},
    {Kind::spacing, "spacing", 0.9, "casing_spacing", "casings too far apart by this many mm"},
    {Kind::chip_corner, "chip_corner", 12, "", "corner of the outer shoulder broken out, mm"},
    {Kind::chip_seat, "chip_seat", 10, "", "edge of the seat at the end of the block broken out, mm"},
    {Kind::chip_jaw, "chip_jaw", 15, "", "upper edge of the outer jaw broken out, mm"},
    {Kind::crack, "crack", 0.4, "", "crack across the seat, its width in mm"},
    {Kind::crust, "crust", 1, "casing_protrusion_outer", "mortar on a quarter of the outer rim, mm over the seat"},
}};

constexpr bool in_order() {
  for (std::size_t i = 0; i < kEffects; ++i)
    if (static_cast<std::size_t>(kEffectTable[i].effect) != i) return false;
  for (std::size_t i = 0; i < kConcreteDefects; ++i)
    if (static_cast<std::size_t>(kDefectTable[i].kind) != i) return false;
  return true;
}
static_assert(in_order(), "the tables are indexed by their enumerations");

std::optional<double> number_from(std::string_view text) {
  double value = 0.0;
  const char* end = text.data() + text.size();
  const auto [stop, fault] = std::from_chars(text.data(), end, value);
  if (fault != std::errc{} || stop != end || !std::isfinite(value)) return std::nullopt;
  return value;
}

template <typename Table>
std::string names_of(const Table& table) {
  std::string names;
  for (const auto& row : table) names += fmt::format("{}{}", names.empty() ? "" : ", ", row.name);
  return names;
}

template <typename Table>
auto find_in(const Table& table, std::string_view name) {
  const typename Table::value_type* found = nullptr;
  for (const auto& row : table)
    if (row.name == name) found = &row;
  return found;
}

constexpr double kStrengthMax = 10.0;
constexpr double kSizeMax = 100.0;
constexpr std::array kSurfaceNames = {std::string_view("ideal"), std::string_view("clean"), std::string_view("real")};

}  // namespace

const std::array<EffectInfo, kEffects>& effects() {
  return kEffectTable;
}

const EffectInfo& info(Effect effect) {
  return kEffectTable[static_cast<std::size_t>(effect)];
}

Result<SurfaceKind> surface_named(std::string_view name) {
  for (std::size_t i = 0; i < kSurfaceNames.size(); ++i)
    if (kSurfaceNames[i] == name) return static_cast<SurfaceKind>(i);
  return error(Code::config, "%s", fmt::format("--surface '{}': allowed ideal, clean, real", name).c_str());
}

std::string_view name(SurfaceKind kind) {
  return kSurfaceNames.at(static_cast<std::size_t>(kind));
}

EffectStrengths::EffectStrengths(SurfaceKind kind) {
  if (kind == SurfaceKind::ideal) {
    set(Effect::noise, 1.0);
    return;
  }
  for (const EffectInfo& row : kEffectTable) set(row.effect, row.usual);
  if (kind == SurfaceKind::real) return;
  set(Effect::voids, 0.25);
  set(Effect::dust, 0.2);
}

std::optional<std::string> EffectStrengths::take(std::string_view text) {
  const std::size_t equals = text.find('=');
  const std::string_view wanted = text.substr(0, equals);
  const EffectInfo* row = find_in(kEffectTable, wanted);
  if (row == nullptr) return fmt::format("--effect '{}': unknown effect, allowed {}", wanted, names_of(kEffectTable));
  const double least = row->effect == Effect::standoff ? -kStrengthMax : 0.0;
  const auto strength = equals == std::string_view::npos ? std::nullopt : number_from(text.substr(equals + 1));
  if (!strength || *strength < least || *strength > kStrengthMax)
    return fmt::format("--effect {}: expected {}=STRENGTH, {}..{}", text, wanted, least, kStrengthMax);
  set(row->effect, *strength);
  return std::nullopt;
}

std::string effect_help() {
  std::string help;
  for (const EffectInfo& row : kEffectTable) help += fmt::format("  {:11} {:3} {}\n", row.name, row.usual, row.meaning);
  return help;
}

const std::array<ConcreteDefectInfo, kConcreteDefects>& concrete_defects() {
  return kDefectTable;
}

const ConcreteDefectInfo& info(ConcreteDefectKind kind) {
  return kDefectTable[static_cast<std::size_t>(kind)];
}

bool is_damage(ConcreteDefectKind kind) {
  switch (kind) {
    case ConcreteDefectKind::depression:
    case ConcreteDefectKind::hump:
    case ConcreteDefectKind::bow:
    case ConcreteDefectKind::chip_corner:
    case ConcreteDefectKind::chip_seat:
    case ConcreteDefectKind::chip_jaw:
    case ConcreteDefectKind::crack:
    case ConcreteDefectKind::crust: return true;
    default: return false;
  }
}

std::string damage_help() {
  std::string help;
  for (const ConcreteDefectInfo& row : kDefectTable)
    if (is_damage(row.kind)) help += fmt::format("  {:11} {:4} {}\n", row.name, row.usual, row.meaning);
  return help;
}

Result<ConcreteDefect> parse_concrete_defect(std::string_view text) {
  const std::size_t equals = text.find('=');
  const std::string_view wanted = text.substr(0, equals);
  const ConcreteDefectInfo* row = find_in(kDefectTable, wanted);
  if (row == nullptr)
    return error(Code::config, "%s",
                 fmt::format("--defect '{}': unknown defect, allowed {}", wanted, names_of(kDefectTable)).c_str());
  if (equals == std::string_view::npos) return ConcreteDefect{row->kind, row->usual};
  const auto size = number_from(text.substr(equals + 1));
  if (!size || std::abs(*size) > kSizeMax)
    return error(Code::config, "%s", fmt::format("--defect {}: expected {}=SIZE", text, wanted).c_str());
  return ConcreteDefect{row->kind, *size};
}

}  // namespace slabd::emulator
