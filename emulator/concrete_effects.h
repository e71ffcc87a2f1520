// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <string_view>

#include "base/base.h"

/// Differences between a scan of real concrete and a scan of its drawing, as one table: name, usual strength and
/// meaning. Strength 0 is off, 1 is a plant with a good scanner, 2 to 3 a bad day.
namespace slabd::emulator {

enum class Effect : std::uint8_t {
  cast,
  fillet,
  chamfer,
  wear,
  voids,
  burrs,
  fin,
  fin_crop,
  grain,
  relief,
  wave,
  rim_tilt,
  rim_edge,
  rim_slurry,
  rim_drop,
  thread,
  plug,
  cap,
  dirt,
  bore_water,
  noise,
  incidence,
  ripple,
  patch,
  steep,
  shadow,
  inter,
  flying,
  outliers,
  dropout,
  lens,
  scale,
  dust,
  drops,
  strap,
  strap_crop,
  film,
  chalk,
  pose,
  offset,
  tilt,
  standoff,
  grid_left,
  misfit,
};
inline constexpr std::size_t kEffects = 44;

struct EffectInfo {
  Effect effect{};
  std::string_view name;
  double usual = 0.0;  ///< strength in a realistic scan
  std::string_view meaning;
};
/// All effects in the order of `Effect`.
[[nodiscard]] const std::array<EffectInfo, kEffects>& effects();
[[nodiscard]] const EffectInfo& info(Effect effect);

/// `ideal`: the drawing with noise; `clean`: real concrete with few voids and little dust; `real`: every effect at its
/// usual strength.
enum class SurfaceKind : std::uint8_t { ideal, clean, real };
/// Code::config if the text is not one of the three names; the error lists them.
[[nodiscard]] Result<SurfaceKind> surface_named(std::string_view name);
[[nodiscard]] std::string_view name(SurfaceKind kind);

/// One strength for each effect.
class EffectStrengths {
 public:
  /// All effects off.
  EffectStrengths() = default;
  explicit EffectStrengths(SurfaceKind kind);
  [[nodiscard]] double operator[](Effect effect) const { return strength_[static_cast<std::size_t>(effect)]; }
  void set(Effect effect, double strength) { strength_[static_cast<std::size_t>(effect)] = strength; }
  /// Parses "NAME=STRENGTH", strength 0..10 (standoff -10..10). Returns nullopt on success, otherwise the message to
  /// print. For an unknown name it lists all names, which is longer than an Error allows.
  [[nodiscard]] std::optional<std::string> take(std::string_view text);

 private:
  std::array<double, kEffects> strength_{};
};

/// Help text: every effect with usual strength and meaning, one per line.
[[nodiscard]] std::string effect_help();

/// Defects of a real block. The first group changes dimensions, the second the form of the seat, the third is damage.
enum class ConcreteDefectKind : std::uint8_t {
  depression,
  hump,
  bow,
  slope,
  jaw_distance,
  jaw_angle,
  casing_out,
  casing_sunk,
  spacing,
  chip_corner,
  chip_seat,
  chip_jaw,
  crack,
  crust,
};
inline constexpr std::size_t kConcreteDefects = 14;

struct ConcreteDefectInfo {
  ConcreteDefectKind kind{};
  std::string_view name;
  double usual = 0.0;     ///< size of a defect that must be detected
  std::string_view item;  ///< name of the item that must not pass; empty: damage, reported as a finding
  std::string_view meaning;
};
[[nodiscard]] const std::array<ConcreteDefectInfo, kConcreteDefects>& concrete_defects();
[[nodiscard]] const ConcreteDefectInfo& info(ConcreteDefectKind kind);

struct ConcreteDefect {
  ConcreteDefectKind kind{};
  double size = 0.0;
};
/// True for defects that do not change the block's dimensions: form of the seat and damage.
[[nodiscard]] bool is_damage(ConcreteDefectKind kind);
/// Help text: every such defect with usual size and meaning, one per line.
[[nodiscard]] std::string damage_help();
/// Parses "NAME=SIZE", or "NAME" for the usual size. Code::config if the name is unknown (the error lists all names)
/// or the size is invalid.
[[nodiscard]] Result<ConcreteDefect> parse_concrete_defect(std::string_view text);

}  // namespace slabd::emulator
