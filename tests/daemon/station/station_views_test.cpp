// SPDX-License-Identifier: Apache-2.0
//
// Checks of scans by the robot's pose. Stops are planned as by `slabctl stations`, slabs lie in slightly different
// positions, robots and castings have errors, and scanners return another scan than the requested one.
#include "daemon/station/station_views.h"

#include <gtest/gtest.h>

#include "base/prng.h"
#include "base/recipe.h"
#include "tests/config/reference_recipe.h"

namespace slabd::cli {
namespace {

using daemon::SlabViews;
using daemon::View;
using daemon::ViewFinding;
using daemon::Views;

const Pose kSlab{rotation_from_kuka_abc(0.2, 0.01, -0.02), Vec3(1800.0, 150.0, 300.0)};

const Recipe& recipe() {
  static const Recipe kRecipe = reference_recipe();
  return kRecipe;
}
int stations() {
  return recipe().stations();
}

struct Errors {
  double placement_mm = 5.0;
  double placement_deg = 0.2;
  double casting_mm = 0.3;  ///< largest, per axis
  double casting_deg = 0.05;
  double robot_mm = 0.15;
  double robot_deg = 0.02;
};

Pose small_motion(Prng& prng, double mm, double deg) {
  const auto share = [&] { return 2.0 * prng.uniform() - 1.0; };
  Pose pose;
  pose.translation_mm = mm * Vec3(share(), share(), share());
  pose.rotation =
      rotation_from_kuka_abc(rad_from_deg(deg) * share(), rad_from_deg(deg) * share(), rad_from_deg(deg) * share());
  return pose;
}

/// One slab in the cell: the true positions of its blocks and of the scanner.
class Cell {
 public:
  Cell(std::uint64_t seed, const Errors& errors, const Dither& dither = {})
      : prng_(seed), errors_(errors), dither_(dither) {
    place();
  }

  /// Places another slab.
  void place() {
    placement_ = small_motion(prng_, errors_.placement_mm, errors_.placement_deg);
    for (int k = 1; k <= stations(); ++k)
      T_base_block_[index(k)] =
          kSlab * placement_ * T_slab_block(recipe(), k) * small_motion(prng_, errors_.casting_mm, errors_.casting_deg);
  }
  /// Displaces the seat of station k.
  void displace(int k, const Pose& by) { T_base_block_[index(k)] = T_base_block_[index(k)] * by; }

  [[nodiscard]] Pose nominal_block(int k) const { return kSlab * T_slab_block(recipe(), k); }
  /// Pose of the stop as stated by the robot.
  [[nodiscard]] Pose stop(int k) const { return nominal_block(k) * dithered(nominal_T_block_scanner(), k, dither_); }
  /// Pose of the block in a scan of block `k` from its stop.
  [[nodiscard]] Pose scan(int k) {
    const Pose really = stop(k) * small_motion(prng_, errors_.robot_mm, errors_.robot_deg);
    return really.inverse() * T_base_block_[index(k)];
  }
  [[nodiscard]] View view(int k, const Pose& T_scanner_block) const {
    return {true, stop(k), nominal_block(k), T_scanner_block};
  }

 private:
  static std::size_t index(int k) { return static_cast<std::size_t>(k - 1); }
  Prng prng_;
  Errors errors_;
  Dither dither_;
  Pose placement_;
  std::array<Pose, limits::kStationsMax> T_base_block_{};
};

/// Passes a slab's scans to the comparison, as the daemon does; returns the number of refusals.
template <typename Scan>
int run_slab(Views& views, Cell& cell, const Scan& scan, int from = 1) {
  views.begin_slab();
  int refused = 0;
  for (int k = from; k <= stations(); ++k) {
    const View view = cell.view(k, scan(k));
    const ViewFinding finding = compare_view(views, k, view);
    views.keep(k, view, finding.is_refused);
    refused += finding.is_refused ? 1 : 0;
  }
  return refused;
}

TEST(StationViews, scans_of_their_own_blocks_are_never_refused) {
  for (std::uint64_t seed = 1; seed <= 400; ++seed) {
    Errors errors;
    errors.robot_mm = seed % 2 == 0 ? 0.1 : 0.2;
    Cell cell(seed, errors);
    Views views;
    for (int slab = 0; slab < 3; ++slab) {
      cell.place();
      EXPECT_EQ(run_slab(views, cell, [&](int k) { return cell.scan(k); }), 0) << "seed " << seed << " slab " << slab;
    }
  }
}

TEST(StationViews, a_seat_out_of_place_or_turned_is_measured_and_not_refused) {
  int cases = 0;
  for (std::uint64_t seed = 1; seed <= 60; ++seed)
    for (const double mm : {1.0, 2.0, 3.0, 5.0})
      for (const double deg : {0.0, 0.3, 1.0}) {
        Cell cell(seed, {});
        Views views;
        ASSERT_EQ(run_slab(views, cell, [&](int k) { return cell.scan(k); }), 0);
        cell.place();
        const int k = 1 + static_cast<int>(seed) % stations();
        Pose off;
        const int axis = static_cast<int>(seed / 3) % 3;
        off.translation_mm[axis] = seed % 2 == 0 ? mm : -mm;
        off.rotation = Quat(Eigen::AngleAxisd(rad_from_deg(deg), Eigen::Vector3d(Vec3::Unit((axis + 1) % 3))));
        cell.displace(k, off);
        EXPECT_EQ(run_slab(views, cell, [&](int s) { return cell.scan(s); }), 0)
            << "seed " << seed << ", station " << k << ", " << mm << " mm, " << deg << " deg";
        ++cases;
      }
  EXPECT_EQ(cases, 720);
}

TEST(StationViews, no_slab_passes_with_the_previous_frame) {
  int refused_of_all = 0;
  for (std::uint64_t seed = 1; seed <= 100; ++seed) {
    Cell cell(seed, {});
    Views views;
    ASSERT_EQ(run_slab(views, cell, [&](int k) { return cell.scan(k); }), 0);
    Pose before = cell.scan(stations());
    for (int slab = 0; slab < 2; ++slab) {
      cell.place();
      const int refused = run_slab(views, cell, [&](int k) {
        const Pose given = before;
        before = cell.scan(k);
        return given;
      });
      EXPECT_GE(refused, slab == 0 ? 14 : 6) << "seed " << seed << " slab " << slab;
      refused_of_all += refused;
    }
  }
  EXPECT_GE(refused_of_all, 100 * 2 * stations() * 60 / 100);
}

TEST(StationViews, no_slab_passes_with_one_block_for_all) {
  int refused_of_all = 0;
  for (std::uint64_t seed = 1; seed <= 100; ++seed) {
    Cell cell(seed, {});
    Views views;
    const int block = 1 + static_cast<int>(seed) % stations();
    const int refused = run_slab(views, cell, [&](int) { return cell.scan(block); });
    EXPECT_GE(refused, 14) << "seed " << seed;
    refused_of_all += refused;
  }
  EXPECT_GE(refused_of_all, 100 * (stations() - 1) * 98 / 100);
}

TEST(StationViews, a_single_scan_of_another_block_is_refused) {
  int missed = 0;
  int given = 0;
  for (std::uint64_t seed = 1; seed <= 40; ++seed) {
    Cell cell(seed, {});
    Views good;
    ASSERT_EQ(run_slab(good, cell, [&](int k) { return cell.scan(k); }), 0);
    for (int other = 1; other <= stations(); ++other) {
      const int station = 1 + static_cast<int>(seed) % stations();
      if (other == station) continue;
      Views views = good;
      views.slab[static_cast<std::size_t>(station - 1)] = {};
      ++given;
      missed += compare_view(views, station, cell.view(station, cell.scan(other))).is_refused ? 0 : 1;
    }
  }
  EXPECT_EQ(given, 40 * (stations() - 1));
  EXPECT_EQ(missed, 0);
}

TEST(StationViews, scans_of_the_slab_before_are_refused) {
  for (std::uint64_t seed = 1; seed <= 60; ++seed) {
    Cell cell(seed, {});
    Views views;
    std::array<Pose, limits::kStationsMax> recorded{};
    ASSERT_EQ(run_slab(views, cell, [&](int k) { return recorded[static_cast<std::size_t>(k - 1)] = cell.scan(k); }),
              0);
    cell.place();
    // One station late: the recorded scan of the next stop.
    const int refused =
        run_slab(views, cell, [&](int k) { return recorded[static_cast<std::size_t>(k % stations())]; });
    EXPECT_GE(refused, stations() - 2) << "seed " << seed;
  }
}

TEST(StationViews, equal_stops_are_named_and_not_refused) {
  Cell cell(5, {}, Dither{0.0, 0.0});
  Views views;
  EXPECT_EQ(run_slab(views, cell, [&](int) { return cell.scan(3); }), 0) << "nothing tells these stops apart";
  EXPECT_NE(stop_like_the_next(views.slab), 0);
  Cell apart(5, {});
  Views other;
  EXPECT_EQ(run_slab(other, apart, [&](int k) { return apart.scan(k); }), 0);
  EXPECT_EQ(stop_like_the_next(other.slab), 0);
}

TEST(StationViews, message_names_the_other_stop_and_both_distances) {
  Cell cell(11, {});
  Views views;
  ASSERT_EQ(run_slab(views, cell, [&](int k) { return cell.scan(k); }), 0);
  views.slab[6] = {};
  const ViewFinding finding = compare_view(views, 7, cell.view(7, cell.scan(6)));
  ASSERT_TRUE(finding.is_refused);
  EXPECT_EQ(finding.station, 6);
  EXPECT_GT(finding.own_off_mm, daemon::kSeatOff_mm);
  const std::string text(text_of(finding, 7).view());
  EXPECT_NE(text.find("the stop of station 6 would see it"), std::string::npos) << text;
  EXPECT_NE(text.find("not where station 7's does"), std::string::npos) << text;
}

TEST(Dither, planned_stops_differ_as_documented) {
  StopDifference least{1e9, 1e9};
  StopDifference near{1e9, 1e9};
  const int n = static_cast<int>(limits::kStationsMax);
  for (int a = 1; a <= n; ++a)
    for (int b = a + 1; b <= n; ++b) {
      const StopDifference d =
          stop_difference(dithered(nominal_T_block_scanner(), a, {}), dithered(nominal_T_block_scanner(), b, {}));
      least = {std::min(least.mm, d.mm), std::min(least.deg, d.deg)};
      const int apart = std::min(b - a, n - (b - a));
      if (apart <= 2) near = {std::min(near.mm, d.mm), std::min(near.deg, d.deg)};
      EXPECT_TRUE(is_told_apart(d)) << a << ' ' << b;
    }
  EXPECT_GE(least.mm, 3.9);
  EXPECT_GE(least.deg, 1.0);
  EXPECT_GE(near.mm, 6.5);
  EXPECT_GE(near.deg, 1.6);
}

}  // namespace
}  // namespace slabd::cli
