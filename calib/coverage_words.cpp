// SPDX-License-Identifier: Apache-2.0
//
// Coverage for the person at the robot. Sides are those of somebody who stands at the robot's foot and looks along base
// +X, corners those of the scanner's own axes, which its picture shows; both are named, because "left" alone has sent
// people the wrong way.
#include <algorithm>

#include "calib/coverage.h"

namespace slabd::calib {
namespace {

constexpr std::array<const char*, kSectors> kSides = {
    "away from the robot", "away and to the left",  "to the left",  "back and to the left",
    "back to the robot",   "back and to the right", "to the right", "away and to the right"};
constexpr std::array<const char*, kSectors> kBaseAxes = {"+X", "+X +Y", "+Y", "-X +Y", "-X", "-X -Y", "-Y", "+X -Y"};
constexpr std::array<const char*, kPlaces> kCorners = {"middle", "+x +y corner", "-x +y corner", "-x -y corner",
                                                       "+x -y corner"};
constexpr std::array<const char*, kDepths> kDistances = {"near", "mid-distance", "far"};

std::string joined(const std::vector<std::string>& words) {
  std::string text;
  for (const std::string& word : words) text += (text.empty() ? "" : ", ") + word;
  return text;
}

}  // namespace

std::string sector_words(std::size_t sector) {
  return kSides[sector % kSectors];
}

std::string place_words(std::size_t place, std::size_t depth) {
  return std::string(kDistances[depth % kDepths]) + " " + kCorners[place % kPlaces];
}

std::string suggestion_words(const Suggestion& s, ArtefactKind kind) {
  FixedString<320> text;
  text.printf(
      "tilt %.0f deg %s (the scanner looks towards base %s), roll %+.0f deg, %s in the %s of the view "
      "(x %.0f, y %.0f, %.0f mm from the scanner)",
      s.tilt_deg, kSides[s.sector % kSectors], kBaseAxes[s.sector % kSectors], s.roll_deg,
      kind == ArtefactKind::ball ? "ball" : "artefact", place_words(s.place, s.depth).c_str(), s.target_scanner.x(),
      s.target_scanner.y(), s.target_scanner.z());
  return std::string(text.view());
}

std::vector<std::string> missing_words(const Coverage& coverage, ArtefactKind kind) {
  std::vector<std::string> missing;
  FixedString<200> text;
  const double spread = coverage.rotation_spread_axes_deg[2];
  if (coverage.views > 1 && spread < kRotationSpreadAdvisedDeg) {
    text.printf("the scanner was turned by %.1f deg (smallest principal spread), it should be 15: tilt more", spread);
    missing.emplace_back(text.view());
  }
  if (coverage.views < kViewsMin) return missing;  // everything is missing: the suggestion says enough
  std::vector<std::string> sides;
  for (std::size_t sector = 0; sector < kSectors; ++sector)
    if (!coverage.sectors[sector]) sides.emplace_back(kSides[sector]);
  if (sides.size() > kSectors - 6) missing.push_back("not yet tilted " + joined(sides));
  for (std::size_t depth = 0; depth < kDepths; ++depth) {
    std::vector<std::string> places;
    for (std::size_t place = 0; place < kPlaces; ++place)
      if (!coverage.cells[depth * kPlaces + place]) places.emplace_back(kCorners[place]);
    if (places.size() > 2 && kind == ArtefactKind::ball)
      missing.push_back(std::string("not yet seen ") + kDistances[depth] + ": " + joined(places));
  }
  return missing;
}

}  // namespace slabd::calib
