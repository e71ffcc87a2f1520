// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "base/base.h"
#include "cli/simulate/calibration_scene.h"

namespace slabd::cli::args {
class Command;
}  // namespace slabd::cli::args

/// `slabctl simulate calibration`: the scans of a whole calibration with their truth, for the offline commands.
namespace slabd::cli::simulate {

struct CalibrationOrder {
  CalibrationTraits scene;
  CalibrationScanTraits scan;
  int views = 20;
  std::string poses_file;  ///< if given: the views, one T_base_flange a line in slabd's own form
  int shots = 1;           ///< scans at every pose
  std::string out_dir;
  std::string recipe;  ///< for the reference block
};

/// Makes `out_dir` (it must not exist or be empty) and writes view_01.ply, view_02.ply, ... (with several shots
/// view_01_1.ply, ...), flange.txt (T_base_flange as reported, slabd's own form), certificate.txt (kind artefact) and
/// truth.json. Returns the exit status.
[[nodiscard]] int write_calibration(const CalibrationOrder& order);

/// Writes a text file; stops on an error.
void write_text(const std::filesystem::path& path, const std::string& text);
/// A file's bytes; nullopt if it cannot be read.
[[nodiscard]] std::optional<std::string> text_of(const std::string& path);
/// The views of a file. The Code::config error names file and line.
[[nodiscard]] Result<std::vector<Pose>> poses_in(const std::string& path);

/// Writes certificate.txt (kind artefact), flange.txt and truth.json of a plan of views to a new folder.
void write_calibration_truth(const CalibrationScene& scene, const CalibrationScanTraits& scan,
                             std::span<const Pose> views, int shots, const std::string& out_dir);

void add_simulate_calibration(args::Command& simulate);

}  // namespace slabd::cli::simulate
