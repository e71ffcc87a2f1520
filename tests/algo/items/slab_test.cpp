// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <functional>
#include <vector>

#include "algo/algo.h"
#include "tests/algo/scene.h"

namespace slabd::algo {
namespace {

const Pose kBase = scene::displaced(2500.0, -300.0, 400.0, 0.4, -0.3, 25.0);
const StationSigma kCalibrated = {0.02, rad_from_deg(0.001)};
const double kCant = std::atan(1.0 / 40.0);

/// Eighteen blocks in place that passed separately, with a little noise; each test changes its subject.
struct Slab {
  Recipe recipe = scene::p5600();
  std::vector<BlockResult> blocks = std::vector<BlockResult>(18);
  StationSigma sigma = kCalibrated;

  explicit Slab(double noise_mm = 0.01) {
    Prng prng(3);
    for (int station = 1; station <= 18; ++station) {
      BlockResult& b = block(station);
      b.station = static_cast<std::uint8_t>(station);
      for (const ItemId id : {ItemId::seat_slope, ItemId::seat_flatness, ItemId::jaw_distance}) {
        Item item = blank_item(recipe, id, station);
        item.value = item.nominal;
        item.verdict = Verdict::pass;
        EXPECT_TRUE(b.items.push(item));
      }
      b.verdict = Verdict::pass;
      place(station, noise_mm * Vec3(prng.normal(), prng.normal(), prng.normal()), Quat::Identity());
    }
  }
  BlockResult& block(int station) { return blocks[static_cast<std::size_t>(station - 1)]; }

  /// Puts a seat at its nominal position, displaced by `off` (slab frame) and rotated about its own axes.
  void place(int station, const Vec3& off, const Quat& turn) {
    Pose T_slab = T_slab_block(recipe, station);
    T_slab.translation_mm += off;
    T_slab.rotation = T_slab.rotation * turn;
    const Pose T = kBase * T_slab;
    SeatObservation& o = block(station).observation;
    o.ok = o.jaw_ok = o.top_ok = true;
    o.p_base = T.translation_mm;
    o.n_base = T.rotation * Vec3(0.0, -std::sin(kCant), std::cos(kCant));
    o.jaw_outer_base = T * Vec3(0.0, 190.0 * std::cos(kCant) - 10.0 * std::sin(kCant),
                                190.0 * std::sin(kCant) + 10.0 * std::cos(kCant));
    o.top_n_base = T.rotation * Vec3::UnitZ();
  }
  void displace_all(const std::function<Vec3(int, const Vec3&)>& off) {
    for (int k = 1; k <= 18; ++k) place(k, off(k, T_slab_block(recipe, k).translation_mm), Quat::Identity());
  }
  /// Removes the station's block, as if it had never been scanned.
  void forget(int station) { block(station) = BlockResult{}; }

  SlabResult inspect() {
    SlabResult out;
    out.verdict = Verdict::pass;  // must be overwritten
    inspect_slab(recipe, blocks, sigma, kBase, out);
    return out;
  }
};

const Item& item(const SlabResult& r, ItemId id, int station = -1) {
  const Item* found = find_item(r.items.begin(), r.items.end(), id, station);
  EXPECT_NE(found, nullptr);
  return *found;
}

TEST(Slab, nominal_passes_with_all_items) {
  const SlabResult r = Slab().inspect();
  EXPECT_EQ(r.verdict, Verdict::pass);
  EXPECT_EQ(r.reason, 0);
  EXPECT_EQ(r.items.size(), 18U + 18U + 18U + 16U + 9U + 3U);
  for (const Item& i : r.items) EXPECT_EQ(i.verdict, Verdict::pass) << info(i.id).name << " " << int{i.station};
  for (const Verdict v : r.station_verdict) EXPECT_EQ(v, Verdict::pass);
  EXPECT_TRUE(r.fit.ok);
  EXPECT_EQ(r.fit.seats, 18);
  EXPECT_LT(r.fit.rms_mm, 0.03);
  const Pose error = kBase.inverse() * r.fit.T_base_slab;
  EXPECT_LT(error.translation_mm.norm(), 0.02);
  EXPECT_LT(angle_between_rad(error.rotation, Quat::Identity()), 2e-5);
}

TEST(Slab, perfect_seats_give_nominal_values) {
  const SlabResult r = Slab(0.0).inspect();
  for (const Item& i : r.items)
    EXPECT_NEAR(i.value, i.nominal, i.id == ItemId::large_jaw_distance ? 0.005 : 1e-6) << info(i.id).name;
}

TEST(Slab, finds_its_frame_from_any_place_of_the_base) {
  Slab slab;
  // The nominal pose is only a start; the seats decide.
  SlabResult out;
  inspect_slab(slab.recipe, slab.blocks, slab.sigma, Pose::identity(), out);
  EXPECT_TRUE(out.fit.ok);
  EXPECT_LT((out.fit.T_base_slab.translation_mm - kBase.translation_mm).norm(), 0.02);
}

TEST(Slab, one_displaced_seat_fails_only_that_seat) {
  for (int station = 1; station <= 18; ++station) {
    Slab slab;
    slab.place(station, Vec3(0.0, 0.8, 0.0), Quat::Identity());
    const SlabResult r = slab.inspect();
    for (int k = 1; k <= 18; ++k) {
      const Item& lateral = item(r, ItemId::seat_lateral, k);
      EXPECT_NEAR(lateral.value, k == station ? 0.8 : 0.0, 0.05) << k << " while " << station << " is displaced";
      EXPECT_EQ(lateral.verdict, k == station ? Verdict::fail : Verdict::pass);
      EXPECT_EQ(r.station_verdict[static_cast<std::size_t>(k - 1)], k == station ? Verdict::fail : Verdict::pass) << k;
    }
    EXPECT_EQ(r.verdict, Verdict::fail);
    EXPECT_EQ(r.reason, kReasonItemBase + 10);
    EXPECT_GT(r.fit.plain_rms_mm, r.fit.rms_mm);
  }
}

TEST(Slab, three_displaced_seats_are_found_too) {
  Slab slab;
  for (const int k : {2, 9, 14}) slab.place(k, Vec3(0.0, 1.5, 0.0), Quat::Identity());
  const SlabResult r = slab.inspect();
  for (int k = 1; k <= 18; ++k)
    EXPECT_NEAR(item(r, ItemId::seat_lateral, k).value, (k == 2 || k == 9 || k == 14) ? 1.5 : 0.0, 0.06) << k;
}

TEST(Slab, a_low_seat_is_found_with_its_whole_depth_and_its_neighbours_are_not_lifted_for_it) {
  const SlabResult before = Slab().inspect();
  for (int station = 1; station <= 18; ++station) {
    Slab slab;
    slab.place(station, Vec3(0.0, 0.0, -1.2), Quat::Identity());
    const SlabResult r = slab.inspect();
    const Item& vertical = item(r, ItemId::seat_vertical, station);
    EXPECT_EQ(vertical.verdict, Verdict::fail);
    EXPECT_NEAR(vertical.companion, -1.2, 0.05);
    // At the end of a row the parabola of the others must be extrapolated by a pitch.
    EXPECT_NEAR(vertical.value, -1.2, 0.06) << station;
    for (int k = 1; k <= 18; ++k) {
      if (k == station) continue;
      EXPECT_NEAR(item(r, ItemId::seat_vertical, k).value, item(before, ItemId::seat_vertical, k).value, 0.02)
          << k << " while " << station << " is low";
    }
  }
}

TEST(Slab, warp_is_reported_and_taken_out_of_the_heights) {
  Slab slab;
  const double sag = 1.6;  // mid above ends, both rows
  slab.displace_all(
      [&](int, const Vec3& p) { return Vec3(0.0, 0.0, sag * (1.0 - p.x() * p.x() / (2520.0 * 2520.0))); });
  const SlabResult r = slab.inspect();
  EXPECT_EQ(r.verdict, Verdict::pass);
  EXPECT_NEAR(item(r, ItemId::warp_left).value, sag, 0.02);
  EXPECT_NEAR(item(r, ItemId::warp_right).value, sag, 0.02);
  for (int k = 1; k <= 18; ++k) EXPECT_NEAR(item(r, ItemId::seat_vertical, k).value, 0.0, 0.01);
  EXPECT_GT(std::abs(item(r, ItemId::seat_vertical, 1).companion), 0.3) << "the unremoved height is its companion";

  slab.recipe.remove_warp = false;
  const SlabResult kept = slab.inspect();
  EXPECT_DOUBLE_EQ(item(kept, ItemId::seat_vertical, 1).value, item(kept, ItemId::seat_vertical, 1).companion);
}

TEST(Slab, too_much_warp_fails_the_slab_and_no_station) {
  Slab slab;
  slab.displace_all([](int, const Vec3& p) { return Vec3(0.0, 0.0, 4.0 * (1.0 - p.x() * p.x() / (2520.0 * 2520.0))); });
  const SlabResult r = slab.inspect();
  EXPECT_EQ(item(r, ItemId::warp_left).verdict, Verdict::fail);
  EXPECT_EQ(r.verdict, Verdict::fail);
  EXPECT_EQ(r.reason, kReasonItemBase + 15);
  for (const Verdict v : r.station_verdict) EXPECT_EQ(v, Verdict::pass);
}

TEST(Slab, twist_shows_in_the_corner_level) {
  Slab slab;
  // Opposite corners up: z = c x y, each corner 0.4 mm.
  slab.displace_all([](int, const Vec3& p) { return Vec3(0.0, 0.0, 0.4 * (p.x() / -2520.0) * (p.y() / 758.0)); });
  const SlabResult r = slab.inspect();
  const Item& corner = item(r, ItemId::corner_level);
  EXPECT_NEAR(corner.value, 1.6, 0.05);
  EXPECT_NEAR(corner.companion, 0.4, 0.0125);
  EXPECT_EQ(corner.verdict, Verdict::fail);
}

TEST(Slab, a_seat_along_the_rail_out_of_place_fails_its_two_spacings) {
  Slab slab;
  slab.place(12, Vec3(1.5, 0.0, 0.0), Quat::Identity());
  const SlabResult r = slab.inspect();
  for (const Item& i : r.items) {
    if (i.id != ItemId::seat_spacing) continue;
    const bool touched = i.station == 11 || i.station == 12;
    EXPECT_EQ(i.verdict, touched ? Verdict::fail : Verdict::pass) << int{i.station};
    EXPECT_EQ(i.station_to, i.station + 1);
  }
  // Row Y < 0 runs with falling X: 12 moved towards 11.
  EXPECT_NEAR(item(r, ItemId::seat_spacing, 11).value, 628.5, 0.05);
  EXPECT_NEAR(item(r, ItemId::seat_spacing, 12).value, 631.5, 0.05);
  EXPECT_EQ(find_item(r.items.begin(), r.items.end(), ItemId::seat_spacing, 9), nullptr)
      << "9 and 10 are not neighbours";
  // Both spacings fail because of 12: its neighbours are in place.
  for (int k = 10; k <= 18; ++k)
    EXPECT_EQ(r.station_verdict[static_cast<std::size_t>(k - 1)], k == 12 ? Verdict::fail : Verdict::pass) << k;
  EXPECT_EQ(r.verdict, Verdict::fail);
}

TEST(Slab, large_jaw_distance_counts_for_the_station_whose_jaw_is_out_of_place) {
  Slab slab;
  slab.block(3).observation.jaw_outer_base += kBase.rotation * Vec3(0.0, 1.6, 0.0);
  const SlabResult r = slab.inspect();
  const Item& jaw = item(r, ItemId::large_jaw_distance, 3);
  EXPECT_EQ(jaw.station_to, 16);
  EXPECT_NEAR(jaw.deviation(), 1.6, 0.05);
  EXPECT_EQ(jaw.verdict, Verdict::fail);
  EXPECT_EQ(r.station_verdict[2], Verdict::fail);
  EXPECT_EQ(r.station_reason[2], kReasonItemBase + 13);
  EXPECT_EQ(r.station_verdict[15], Verdict::pass);
  EXPECT_EQ(r.station_verdict[3], Verdict::pass);
}

TEST(Slab, slope_in_the_slab_frame_decides_if_the_recipe_requires_it) {
  for (const int station : {5, 14}) {
    Slab slab;
    // Tilted further outward by 0.2 degrees: 1.63, beyond 1:37.
    slab.place(station, Vec3::Zero(), Quat(Eigen::AngleAxisd(rad_from_deg(0.2), Eigen::Vector3d::UnitX())));
    const SlabResult r = slab.inspect();
    const Item& slope = item(r, ItemId::seat_slope, station);
    EXPECT_NEAR(slope.value, deg_from_rad(kCant) + 0.2, 0.002) << station;
    EXPECT_EQ(slope.verdict, Verdict::fail);
    EXPECT_EQ(r.station_reason[static_cast<std::size_t>(station - 1)], kReasonItemBase + 0);
    EXPECT_EQ(r.verdict, Verdict::fail);

    slab.recipe.slope_datum = SlopeDatum::local_slab_top;
    const SlabResult local = slab.inspect();
    EXPECT_EQ(item(local, ItemId::seat_slope, station).verdict, Verdict::none) << "information";
    EXPECT_EQ(local.verdict, Verdict::pass) << "the block's own slope passed";
  }
}

TEST(Slab, a_failed_local_slope_does_not_count_when_the_slab_frame_decides) {
  Slab slab;
  slab.block(7).items[0].value = 1.8;
  slab.block(7).items[0].verdict = Verdict::fail;
  slab.block(7).verdict = Verdict::fail;
  slab.block(7).reason = kReasonItemBase;
  EXPECT_EQ(slab.inspect().station_verdict[6], Verdict::pass);
  slab.recipe.slope_datum = SlopeDatum::local_slab_top;
  EXPECT_EQ(slab.inspect().station_verdict[6], Verdict::fail);
}

TEST(Slab, a_block_that_fails_fails_the_slab) {
  Slab slab;
  slab.block(18).items[2].verdict = Verdict::fail;
  slab.block(18).verdict = Verdict::fail;
  slab.block(18).reason = kReasonItemBase + 4;
  const SlabResult r = slab.inspect();
  EXPECT_EQ(r.verdict, Verdict::fail);
  EXPECT_EQ(r.reason, kReasonItemBase + 4);
  EXPECT_EQ(r.station_verdict[17], Verdict::fail);
  EXPECT_NE(r.fail_mask, 0);
}

TEST(Slab, with_a_station_missing_is_not_measured) {
  Slab slab;
  slab.forget(6);
  const SlabResult r = slab.inspect();
  EXPECT_TRUE(r.fit.ok);
  EXPECT_EQ(r.fit.seats, 17);
  EXPECT_EQ(r.verdict, Verdict::not_measured);
  EXPECT_EQ(r.station_verdict[5], Verdict::not_measured);
  EXPECT_EQ(r.station_reason[5], static_cast<std::uint16_t>(Code::block_not_found));
  EXPECT_EQ(item(r, ItemId::seat_lateral, 6).verdict, Verdict::not_measured);
  EXPECT_EQ(item(r, ItemId::seat_spacing, 5).verdict, Verdict::not_measured);
  EXPECT_EQ(item(r, ItemId::seat_lateral, 7).verdict, Verdict::pass);
  for (int k = 1; k <= 18; ++k)
    EXPECT_EQ(r.station_verdict[static_cast<std::size_t>(k - 1)], k == 6 ? Verdict::not_measured : Verdict::pass) << k;
}

TEST(Slab, with_a_station_missing_and_another_failing_fails) {
  Slab slab;
  slab.forget(6);
  slab.place(2, Vec3(0.0, 0.8, 0.0), Quat::Identity());
  EXPECT_EQ(slab.inspect().verdict, Verdict::fail);
}

TEST(Slab, a_not_measured_block_keeps_its_code) {
  Slab slab;
  BlockResult& b = slab.block(4);
  b.verdict = Verdict::not_measured;
  b.reason = static_cast<std::uint16_t>(Code::fit_failed);
  for (Item& i : b.items) i.verdict = Verdict::not_measured;
  b.observation = SeatObservation{};
  const SlabResult r = slab.inspect();
  EXPECT_EQ(r.station_verdict[3], Verdict::not_measured);
  EXPECT_EQ(r.station_reason[3], static_cast<std::uint16_t>(Code::fit_failed));
  EXPECT_EQ(r.verdict, Verdict::not_measured);
}

TEST(Slab, even_without_items_a_not_measured_block_never_passes) {
  Slab slab;
  slab.block(4).items.clear();
  slab.block(4).verdict = Verdict::not_measured;
  slab.block(4).reason = static_cast<std::uint16_t>(Code::scanner_offline);
  EXPECT_EQ(slab.inspect().station_verdict[3], Verdict::not_measured);
  slab.block(4).reason = 0;
  EXPECT_EQ(slab.inspect().station_verdict[3], Verdict::not_measured);
}

TEST(Slab, wide_items_without_limits_are_information_unless_required) {
  Slab slab;
  for (const ItemId id : {ItemId::corner_level, ItemId::warp_left, ItemId::warp_right}) {
    Tolerance& t = slab.recipe.tolerances[static_cast<std::size_t>(id)];
    t.lower = t.upper = kNoValue;
    t.required = false;
  }
  EXPECT_EQ(slab.inspect().verdict, Verdict::pass);
  slab.recipe.tolerances[static_cast<std::size_t>(ItemId::corner_level)].required = true;
  EXPECT_EQ(slab.inspect().verdict, Verdict::not_measured);
}

void expect_no_frame(Slab& slab) {
  const SlabResult r = slab.inspect();
  EXPECT_FALSE(r.fit.ok);
  EXPECT_FALSE(r.fit.note.empty());
  for (const Item& i : r.items) {
    EXPECT_EQ(i.verdict, Verdict::not_measured) << info(i.id).name;
    EXPECT_TRUE(std::isnan(i.value));
  }
  EXPECT_EQ(r.verdict, Verdict::not_measured);
  for (const Verdict v : r.station_verdict) EXPECT_EQ(v, Verdict::not_measured) << "slope and place are unknown";
}

TEST(Slab, with_eleven_seats_has_no_frame) {
  Slab slab;
  for (const int k : {2, 4, 6, 8, 11, 13, 15}) slab.forget(k);
  expect_no_frame(slab);
}

TEST(Slab, with_twelve_seats_has_one) {
  Slab slab;
  for (const int k : {2, 4, 6, 11, 13, 15}) slab.forget(k);
  EXPECT_TRUE(slab.inspect().fit.ok);
}

TEST(Slab, with_one_row_has_no_frame) {
  Slab slab;
  for (int k = 10; k <= 18; ++k) slab.forget(k);
  expect_no_frame(slab);
}

TEST(Slab, without_blocks_has_no_frame) {
  Slab slab;
  for (int k = 1; k <= 18; ++k) slab.forget(k);
  expect_no_frame(slab);
  SlabResult out;
  inspect_slab(slab.recipe, {}, slab.sigma, kBase, out);
  EXPECT_EQ(out.verdict, Verdict::not_measured);
}

TEST(Slab, without_a_station_sigma_is_indeterminate_even_under_simple_acceptance) {
  for (const double guard : {1.0, 0.0}) {
    Slab slab;
    slab.recipe.guard = guard;
    slab.sigma = StationSigma{};
    const SlabResult r = slab.inspect();
    EXPECT_TRUE(r.fit.ok);
    for (const Item& i : r.items) {
      EXPECT_EQ(i.verdict, Verdict::indeterminate) << info(i.id).name;
      EXPECT_TRUE(std::isfinite(i.value));
      EXPECT_TRUE(std::isnan(i.U));
    }
    EXPECT_EQ(r.verdict, Verdict::indeterminate);
  }
}

TEST(Slab, uncertainty_combines_recipe_and_stations) {
  const SlabResult r = Slab().inspect();
  EXPECT_NEAR(item(r, ItemId::seat_lateral, 1).U, std::hypot(0.15, 2.0 * 0.02), 1e-12);
  EXPECT_NEAR(item(r, ItemId::seat_spacing, 1).U, std::hypot(0.15, 2.0 * std::sqrt(2.0) * 0.02), 1e-12);
  EXPECT_NEAR(item(r, ItemId::corner_level).U, std::hypot(0.15, 4.0 * 0.02), 1e-12);
  EXPECT_NEAR(item(r, ItemId::warp_left).U, std::hypot(0.15, 2.0 * std::sqrt(1.5) * 0.02), 1e-12);
  EXPECT_NEAR(item(r, ItemId::seat_slope, 1).U, std::hypot(0.03, 2.0 * 0.001), 1e-12);
}

TEST(Slab, with_eight_pairs_uses_its_own_numbering) {
  Slab slab;
  slab.recipe.slab.pairs = 8;
  slab.recipe.slab.length_mm.value = 4970.0;
  for (int k = 1; k <= 16; ++k) slab.place(k, Vec3::Zero(), Quat::Identity());
  slab.blocks.resize(16);
  // Ends of the left row at 1 and 8; the middle of an even row is the mean of 4 and 5.
  slab.place(4, Vec3(0.0, 0.0, 0.3), Quat::Identity());
  slab.place(5, Vec3(0.0, 0.0, 0.5), Quat::Identity());
  const SlabResult r = slab.inspect();
  ASSERT_TRUE(r.fit.ok);
  EXPECT_NEAR(item(r, ItemId::warp_left).value, 0.4, 1e-3);
  EXPECT_NEAR(item(r, ItemId::warp_right).value, 0.0, 1e-3);
  EXPECT_EQ(item(r, ItemId::large_jaw_distance, 1).station_to, 16);
  EXPECT_EQ(r.items.size(), 16U * 3U + 14U + 8U + 3U);
  EXPECT_EQ(r.station_verdict[16], Verdict::none) << "no such station";
}

TEST(Slab, gives_the_same_bits_twice) {
  Slab slab;
  const SlabResult a = slab.inspect();
  const SlabResult b = slab.inspect();
  EXPECT_EQ(a.fit.T_base_slab.to_array(), b.fit.T_base_slab.to_array());
  for (std::size_t i = 0; i < a.items.size(); ++i) EXPECT_EQ(a.items[i].value, b.items[i].value);
}

TEST(Slab, a_block_without_pass_never_passes_whatever_its_items_are) {
  // A record with a missing item: the remaining ones are good.
  for (const Verdict verdict : {Verdict::fail, Verdict::not_measured, Verdict::aborted, Verdict::indeterminate}) {
    for (const int reason : {0, kReasonItemBase + 3, static_cast<int>(Code::fit_failed)}) {
      Slab slab;
      slab.block(4).verdict = verdict;
      slab.block(4).reason = static_cast<std::uint16_t>(reason);
      const SlabResult r = slab.inspect();
      EXPECT_EQ(r.station_verdict[3], Verdict::not_measured) << name(verdict) << " " << reason;
      EXPECT_NE(r.station_reason[3], 0);
      EXPECT_EQ(r.verdict, Verdict::not_measured);
      EXPECT_EQ(r.station_verdict[4], Verdict::pass);
    }
  }
}

TEST(Slab, does_not_pass_with_a_finding_on_a_block_of_good_items) {
  Slab slab;
  ASSERT_TRUE(slab.block(4).findings.push(SurfaceFinding{}));
  slab.block(4).verdict = Verdict::indeterminate;
  slab.block(4).reason = 617;
  const SlabResult r = slab.inspect();
  EXPECT_EQ(r.verdict, Verdict::indeterminate);
  EXPECT_EQ(r.reason, 617);
  for (std::size_t k = 0; k < 18; ++k) EXPECT_EQ(r.station_verdict[k], k == 3 ? Verdict::indeterminate : Verdict::pass);
  EXPECT_EQ(r.station_reason[3], 617);
  EXPECT_EQ(r.open_mask, 0) << "no item is open";

  slab.place(4, Vec3(0.0, 0.8, 0.0), Quat::Identity());
  EXPECT_EQ(slab.inspect().station_verdict[3], Verdict::fail);
}

TEST(Slab, an_interrupted_block_has_the_reason_interrupted) {
  Slab slab;
  BlockResult& b = slab.block(4);
  b.verdict = Verdict::aborted;
  b.reason = 0;
  for (Item& i : b.items) i.verdict = Verdict::not_measured;
  EXPECT_EQ(slab.inspect().station_reason[3], static_cast<std::uint16_t>(Code::interrupted));
  b.reason = static_cast<std::uint16_t>(Code::scanner_offline);
  EXPECT_EQ(slab.inspect().station_reason[3], static_cast<std::uint16_t>(Code::scanner_offline));
}

TEST(Slab, without_any_slab_wide_limit_its_stations_decide) {
  Slab slab;
  for (const ItemId id : {ItemId::seat_spacing, ItemId::large_jaw_distance, ItemId::corner_level, ItemId::warp_left,
                          ItemId::warp_right}) {
    Tolerance& t = slab.recipe.tolerances[static_cast<std::size_t>(id)];
    t.lower = t.upper = kNoValue;
    t.required = false;
  }
  EXPECT_EQ(slab.inspect().verdict, Verdict::pass);
  slab.place(2, Vec3(0.0, 0.8, 0.0), Quat::Identity());
  const SlabResult r = slab.inspect();
  EXPECT_EQ(r.verdict, Verdict::fail);
  EXPECT_EQ(r.reason, kReasonItemBase + 10);
  slab.recipe.slab.pairs = 0;
  slab.blocks.clear();
  EXPECT_EQ(slab.inspect().verdict, Verdict::not_measured) << "no station, nothing to pass";
}

}  // namespace
}  // namespace slabd::algo
