// SPDX-License-Identifier: Apache-2.0
//
// Denoising over a grid of scans. Point pitch, also twice as wide in one direction; parallel and perspective rays; a
// tilted scanner. Outliers in a narrow and in a wide band, single and in clumps, from a thousandth to a tenth of the
// points. Noise of 0.03 mm with 5 % of the points at five times that; 2 % missing. A point counts as an outlier if it
// is more than a millimetre from the surface, by brute force on the model. Faces at more than 83 degrees to the rays
// are left out, because no scanner measures them.
#include <fmt/core.h>

#include <array>
#include <cmath>
#include <utility>

#include "algo/block_model.h"
#include "algo/denoise/denoise.h"
#include "tests/accuracy/studies.h"
#include "tests/algo/scene.h"

namespace slabd::accuracy {
namespace {

constexpr double kPoints = 350'000.0;
constexpr float kLevel_deg = 60.0F;
constexpr float kUnseen_deg = 83.0F;

struct View {
  double focus_mm;
  double tilt_deg;
  const char* name;
};
constexpr std::array kViews = {View{0.0, 0.0, "parallel"}, View{600.0, 0.0, "perspective"},
                               View{600.0, 5.0, "perspective, tilted 5 deg"}};

struct Share {
  double all = 0.0;
  double hit = 0.0;
  [[nodiscard]] double percent() const { return all > 0.0 ? 100.0 * hit / all : 0.0; }
};

struct Quality {
  Share outliers_left;
  Share level_lost;
  Share steep_lost;
};

bool within_a_millimetre(const algo::BlockModel& model, const Vec3& p) {
  for (double dx = -1.0; dx <= 1.0; dx += 0.1) {
    for (double dy = -1.0; dy <= 1.0; dy += 0.1) {
      algo::Face face = algo::Face::seat;
      double z = 0.0;
      if (model.visible(p.x() + dx, p.y() + dy, face, z) && dx * dx + dy * dy + (p.z() - z) * (p.z() - z) < 1.0)
        return true;
    }
  }
  return false;
}

/// Denoises scans; keeps workspace and model from scan to scan.
class DenoiseBench {
 public:
  DenoiseBench() : cells_(limits::kDenoiseCellsMax + 1), surface_(limits::kDenoiseCellsMax) {
    model_.build(scene::p5600().block);
  }

  void run(scene::Scan scan, Quality& quality) {
    scan.incidence = true;
    const scene::Cloud cloud = scene::take({}, scan);
    std::vector<float> xyz = cloud.xyz;
    order_.resize(limits::kScanPointsMax);
    keep_.resize(limits::kScanPointsMax);
    algo::Cloud view{xyz, xyz.size() / 3, cloud.width, cloud.height};
    ScanCounts counts;
    if (!algo::remove_isolated(view, {order_, keep_, cells_, surface_}, team_, counts)) std::abort();
    for (std::size_t i = 0; i < cloud.xyz.size() / 3; ++i) {
      const float* f = &cloud.xyz[3 * i];
      if (std::isnan(f[0])) continue;
      const bool kept = !std::isnan(xyz[3 * i]);
      if (cloud.outlier[i]) {
        const Vec3 p(static_cast<double>(f[0]), static_cast<double>(f[1]), static_cast<double>(f[2]));
        if (within_a_millimetre(model_, cloud.T_block_scanner * p)) continue;
        count(quality.outliers_left, kept);
      } else if (cloud.incidence_deg[i] <= kUnseen_deg) {
        count(cloud.incidence_deg[i] < kLevel_deg ? quality.level_lost : quality.steep_lost, !kept);
      }
    }
  }

 private:
  static void count(Share& share, bool hit) {
    share.all += 1.0;
    share.hit += hit ? 1.0 : 0.0;
  }

  algo::BlockModel model_;
  std::vector<std::uint32_t> order_;
  std::vector<std::uint8_t> keep_;
  std::vector<std::uint32_t> cells_;
  std::vector<algo::TilePlane> surface_;
  Team team_{1};
};

scene::Scan scan_of(double pitch, double ratio, const View& view, std::uint64_t seed) {
  scene::Scan scan;
  scan.pitch_mm = pitch;
  scan.pitch_ratio = ratio;
  scan.focus_mm = view.focus_mm;
  scan.tail_share = 0.05;
  scan.seed = seed;
  // With a fine pitch the scan covers only part of the field: a corner of the block, with every kind of face.
  const double part = std::min(1.0, std::sqrt(kPoints * pitch * pitch * ratio / (scan.field_x_mm * scan.field_y_mm)));
  scan.field_x_mm *= part;
  scan.field_y_mm *= part;
  scan.displacement = scene::displaced(0.0, 0.0, 0.0, view.tilt_deg, -0.6 * view.tilt_deg, 2.0);
  if (part < 0.9) scan.displacement = scene::displaced(-80.0, -180.0, 0.0, 0.0, 0.0, 0.0) * scan.displacement;
  return scan;
}

}  // namespace

bool denoise_study(const StudyOptions& options, Table& table) {
  DenoiseBench bench;
  const int scans = options.cases(3, 1);
  for (const double share : {0.001, 0.01, 0.1}) {
    for (const double pitch : {0.15, 0.255, 0.4, 0.8}) {
      for (const double ratio : {1.0, 2.0}) {
        if (pitch * ratio > 1.0) continue;
        for (const View& view : kViews) {
          for (const auto& [clump, organised] :
               {std::pair{1, true}, std::pair{5, true}, std::pair{1, false}, std::pair{5, false}}) {
            Quality quality;
            for (const double far_mm : {5.0, 60.0}) {
              for (int i = 0; i < scans; ++i) {
                scene::Scan scan = scan_of(pitch, ratio, view, options.first + static_cast<std::uint64_t>(i));
                scan.outlier_far_mm = far_mm;
                scan.outlier_clump = clump;
                scan.organised = organised;
                // The mean size of a clump is three and a half points.
                scan.outlier_share = clump > 1 ? share / 3.5 : share;
                bench.run(scan, quality);
              }
            }
            const std::string what = fmt::format(
                "{} % outliers{}, pitch {}{}, {}, {}: ", 100.0 * share, clump > 1 ? " in clumps of 2 to 5" : "", pitch,
                ratio > 1.0 ? " x 2" : "", view.name, organised ? "organised" : "not organised");
            table.at_most(what + "outliers left", quality.outliers_left.percent(), 0.1, "%");
            table.at_most(what + "level faces lost", quality.level_lost.percent(), 0.02, "%");
            table.at_most(what + "steep faces lost", quality.steep_lost.percent(), 0.3, "%");
          }
        }
      }
    }
  }
  return true;
}

}  // namespace slabd::accuracy
