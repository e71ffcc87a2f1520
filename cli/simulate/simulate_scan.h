// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "base/base.h"
#include "emulator/scan_drawing.h"
#include "emulator/slab_scene.h"

namespace slabd::cli::args {
class Command;
}  // namespace slabd::cli::args

/// `slabctl simulate scan`: one scan with its truth, for offline inspection.
namespace slabd::cli::simulate {

struct ScanOrder {
  std::string recipe;
  int block = 1;
  std::string out;
  std::string format;  ///< a name of hal::ScanFormat; empty: by the extension of `out`
  std::vector<std::string> defects;
  std::uint64_t seed = 1;
  emulator::ScannerTraits scanner;
  bool nominal_view = false;  ///< exactly the nominal view instead of one up to 2 mm and 0.3 degrees off
  double casting = 1.0;
};

/// Writes the scan and <out>.json (the extension replaced). Returns the exit status.
[[nodiscard]] int write_scan(const ScanOrder& order);

void add_simulate_scan(args::Command& simulate);

/// Values of --format and --scan-format.
[[nodiscard]] std::vector<std::string> scan_format_names();

/// Options shared by all emulated scans: --points, --unorganised, --perspective, --noise-correlation-mm,
/// --noise-shape, --surface, --effect.
struct ScannerOptions {
  std::string points = "full";
  double field_x_mm = emulator::ScannerTraits{}.field_x_mm;
  bool unorganised = false;
  bool perspective = false;
  double noise_correlation_mm = 0.0;
  std::string noise_shape = "gaussian";
  std::string surface = "ideal";
  std::vector<std::string> effects;  ///< NAME=STRENGTH
  /// Strengths for real concrete, if requested by a surface other than ideal or by an effect. Stops if a name or
  /// strength is invalid.
  [[nodiscard]] std::optional<emulator::EffectStrengths> concrete() const;
  void add_to(args::Command& command);
  [[nodiscard]] emulator::ScannerTraits traits() const;
};

// `slabctl simulate plane`: the set-up of the paper's Table 1, a plane with noise and outliers, as XYZ text.

struct PlaneOrder {
  std::string out = "plane.xyz";
  std::uint64_t seed = 2024;
  std::size_t points = 2000;
  std::size_t outliers = 500;
  double noise_mm = 0.01;
};

/// Points of z = x + 2 y + 1 over |x|, |y| <= 1 with noise along the normal (sum of twelve uniform numbers). Outliers
/// are distributed evenly over the box around it. The same seed gives the same points on every machine.
[[nodiscard]] std::vector<Vec3> draw_plane(const PlaneOrder& order);

void add_simulate_plane(args::Command& simulate);

}  // namespace slabd::cli::simulate
