// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "base/base.h"
#include "calib/calib.h"
#include "hal/hal.h"
#include "storage/storage.h"

/// What the daemon shares with slabctl: configuration and recipes.
namespace slabd::daemon {

// ---- configuration (slabd.toml) ----------------------------------------------------------------------------------

/// A fault in a file, for people: "file:line:column: key: what, allowed range".
struct Problem {
  std::string text;
};

struct Config {
  std::string path;
  std::vector<Problem> doubts;  ///< values that are allowed and probably not meant: another unit, another order
  hal::PlcSettings plc;
  hal::LcmSettings robot;
  PoseSettings pose;
  hal::ScannerBackend scanner_backend = hal::ScannerBackend::drop;
  hal::ScanDropSettings scanner;   ///< backend "drop"; `form` also of what lies in the spool: mm with "tcp"
  hal::ScanStreamSettings stream;  ///< backend "tcp"
  std::int64_t scan_timeout_ns = 10 * kNsPerS;
  std::int64_t settle_timeout_ns = 8 * kNsPerS;
  /// What is assumed of the robot and of commissioning values, and the gate of station corrections.
  SpliceSettings splice;
  storage::StoreSettings storage;
  std::string recipes_dir = "/usr/share/slabd/recipes";
  Pose T_base_slab;
  /// Commissioning values; an empty id: the configuration has none, and slabs wait for an applied calibration.
  calib::Calibration calibration;
  std::int64_t check_interval_us = 24 * 3'600'000'000LL;  ///< between daily checks; 0: none are due
  calib::CheckLimits check_limits;
  CaptureGuard capture;              ///< of views for a calibration
  std::string sessions_dir;          ///< where slabctl keeps calibrations under way; default: beside the database
  int calibration_valid_days = 365;  ///< of what slabctl keeps from now on; 0: for ever
  std::string control_socket = "/run/slabd/control.sock";
  int measure_threads = 1;  ///< [measure] threads: 1 or 2; the results are the same
  bool simulation = false;  ///< [line] simulation: shown to the PLC as STATUS bit 11
};

/// Least number of single-letter insertions, deletions and replacements that turn one word into the other.
[[nodiscard]] std::size_t edit_distance(std::string_view a, std::string_view b);

/// Reads and checks a configuration. Every problem found is reported, not only the first; unknown keys name the
/// nearest known one. Empty `problems` means `config` is usable. A [plc] table that can be read is filled in even
/// when the rest is faulty, so that the daemon can show the PLC its fault.
void load_config(const std::string& path, Config& config, std::vector<Problem>& problems);

// ---- recipes (recipes/*.toml) --------------------------------------------------------------------------------------

/// Reads and checks one recipe; `recipe` is complete only when `problems` stays empty. `doubts` (may be null): values
/// that are allowed and probably not meant.
void load_recipe(const std::string& path, Recipe& recipe, std::vector<Problem>& problems,
                 std::vector<Problem>* doubts = nullptr);

/// The same from a file's bytes, such as storage has kept; `path` is its name in messages and the recipe's path.
void parse_recipe(const std::string& path, const std::string& bytes, Recipe& recipe, std::vector<Problem>& problems,
                  std::vector<Problem>* doubts = nullptr);

/// All *.toml of a folder, sorted by name, but not hidden ones; faulty ones are left out and reported. Of two files for
/// one slab_type, one of them faulty or not, neither is used; and none at all beside a file whose slab_type cannot be
/// told. No recipe is a problem too. `texts` (may be null): their files, in the same order.
void load_recipes(const std::string& dir, std::vector<Recipe>& recipes, std::vector<Problem>& problems,
                  std::vector<storage::RecipeText>* texts = nullptr, std::vector<Problem>* doubts = nullptr);

/// The bytes of all recipe files of a folder, by path; one that cannot be read is reported and left out.
[[nodiscard]] std::map<std::string, std::string> recipe_files(const std::string& dir, std::vector<Problem>& problems);

/// Threads that measure a block when nobody says how many: 2 on a computer with two processors or more, else 1.
[[nodiscard]] int default_measure_threads();

}  // namespace slabd::daemon
