// SPDX-License-Identifier: Apache-2.0
//
// Compares calibrations from suggested poses alone, starting 30 mm and 10 degrees off, with random views by the usual
// advice. Figures: the predicted point error for the same number of views, the actual error, and the number of
// suggestions with the target outside the picture.
#include <fmt/core.h>

#include "tests/accuracy/studies.h"
#include "tests/calib/driven.h"
#include "tests/calib/hand_eye_scene.h"

namespace slabd::accuracy {
namespace {

using calib::ArtefactKind;
namespace driven = calib::driven;

void study_kind(const StudyOptions& options, ArtefactKind kind, std::size_t views, Table& table) {
  const int seeds = options.cases(40, 12);
  std::vector<double> followed, advised, found;
  int missed = 0;
  int refused = 0;
  int better = 0;
  for (int i = 0; i < seeds; ++i) {
    const std::uint64_t seed = options.first + static_cast<std::uint64_t>(i);
    driven::Cell cell;
    if (kind == ArtefactKind::pose) cell.settings.target_radius_mm = 60.0;
    const Pose start = driven::bad_start(cell, 30.0, 10.0, seed);
    const driven::Driven ours = driven::follow(cell, kind, views, start, seed);
    const driven::Driven usual = driven::advice(cell, kind, views, seed);
    missed += ours.missed;
    followed.push_back(driven::worth_mm(cell, kind, ours.views));
    advised.push_back(driven::worth_mm(cell, kind, usual.views));
    better += followed.back() < advised.back() ? 1 : 0;
    const Result<calib::HandEye> solved = calib::solve(kind, ours.views, cell.noise);
    if (!solved || !solved.value().ok) {
      ++refused;
      continue;
    }
    found.push_back(
        calib::scene::point_error_mm(solved.value().T_flange_scanner, cell.T_flange_scanner, cell.settings.fov));
  }
  const std::string what = fmt::format("{}, {} views", name(kind), views);
  table.at_most(fmt::format("{}: predicted error, suggestions over advice ({:.4f} mm)", what, rms(advised)),
                rms(followed) / rms(advised), 1.0, "");
  table.at_most(what + ": error made over error predicted", rms(found) / rms(followed), 1.3, "");
  table.tell(fmt::format("{}: of {} seeds, suggestions better in", what, seeds), better, "");
  table.at_most(what + ": refused", refused, 0.0, "");
  table.at_most(what + ": suggestions with the target out of the picture, a calibration",
                static_cast<double>(missed) / seeds, 1.0, "");
}

}  // namespace

bool guide_study(const StudyOptions& options, Table& table) {
  for (const ArtefactKind kind : {ArtefactKind::ball, ArtefactKind::pose})
    for (const std::size_t views : {8U, 12U, 17U, 25U}) study_kind(options, kind, views, table);
  return true;
}

}  // namespace slabd::accuracy
