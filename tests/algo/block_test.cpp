// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <cstring>
#include <functional>
#include <string>

#include "block_inspection.h"

namespace slabd::algo {
namespace {

TEST(Block, measures_a_varied_block_far_better_than_its_tolerances) {
  Prng prng(21);
  const auto around = [&](double middle, double reach) { return middle + reach * (2.0 * prng.uniform() - 1.0); };
  for (std::uint64_t seed = 1; seed <= 4; ++seed) {
    scene::Block block;
    block.cant_ratio = around(40.0, 2.0);
    block.jaw_distance_mm = around(380.0, 0.3);
    block.jaw_angle_inner_deg = around(110.0, 0.5);
    block.jaw_angle_outer_deg = around(110.0, 0.5);
    block.casing_spacing_mm = around(233.0, 0.2);
    block.rim_inner_mm = around(-0.25, 0.15);
    block.rim_outer_mm = around(-0.25, 0.15);
    block.wave_mm = 0.02;
    scene::Scan scan;
    scan.seed = seed;
    scan.organised = seed % 2 == 0;
    scan.displacement =
        scene::displaced(around(0, 2), around(0, 2), around(0, 2), around(0, 0.3), around(0, 0.3), around(0, 0.3));
    const BlockResult r = inspect(scene::take(block, scan));
    const auto value = [&](ItemId id) { return item(r, id).value; };
    // A quarter of a real scan's points; limits are a tenth to a fifth of the line's requirement.
    EXPECT_NEAR(value(ItemId::seat_slope), deg_from_rad(std::atan(1.0 / block.cant_ratio)), 0.001);
    EXPECT_NEAR(item(r, ItemId::seat_slope).companion, block.cant_ratio, 0.03);
    EXPECT_NEAR(value(ItemId::jaw_angle_inner), block.jaw_angle_inner_deg, 0.005);
    EXPECT_NEAR(value(ItemId::jaw_angle_outer), block.jaw_angle_outer_deg, 0.005);
    EXPECT_NEAR(value(ItemId::jaw_distance), block.jaw_distance_mm, 0.005);
    EXPECT_NEAR(value(ItemId::casing_spacing), block.casing_spacing_mm, 0.04);
    EXPECT_NEAR(value(ItemId::casing_protrusion_inner), block.rim_inner_mm, 0.005);
    EXPECT_NEAR(value(ItemId::casing_protrusion_outer), block.rim_outer_mm, 0.005);
    EXPECT_NEAR(value(ItemId::seat_flatness), 0.08, 0.04) << "the wave and the noise of cell means";
    EXPECT_NEAR(value(ItemId::seat_std), 0.033, 0.003);
    EXPECT_NE(r.verdict, Verdict::none);
  }
}

TEST(Block, passes_the_nominal_block) {
  const BlockResult r = inspect(scene::Block{});
  EXPECT_EQ(r.verdict, Verdict::pass);
  EXPECT_EQ(r.reason, 0);
  EXPECT_EQ(r.station, 4);
  EXPECT_EQ(r.items.size(), 11U);
  EXPECT_NEAR(r.casing_inner.radius_mm, 15.0, 0.05);
  EXPECT_GT(r.seat.full_plane.points, 3 * r.seat.plane.points);
  EXPECT_NEAR(r.seat.normal_datum.y() / r.seat.normal_datum.z(), -0.025, 2e-5);
  EXPECT_NEAR(r.seat.normal_datum.norm(), 1.0, 1e-12);
}

TEST(Block, fails_the_slope_only) {
  scene::Block block;
  block.cant_ratio = 35.0;
  expect_only_failure(inspect(block), ItemId::seat_slope);
}
TEST(Block, fails_the_jaw_distance_only) {
  scene::Block block;
  block.jaw_distance_mm = 380.9;
  expect_only_failure(inspect(block), ItemId::jaw_distance);
}
TEST(Block, fails_the_inner_jaw_angle_only) {
  scene::Block block;
  block.jaw_angle_inner_deg = 111.5;
  expect_only_failure(inspect(block), ItemId::jaw_angle_inner);
}
TEST(Block, fails_the_outer_jaw_angle_only) {
  scene::Block block;
  block.jaw_angle_outer_deg = 108.5;
  expect_only_failure(inspect(block), ItemId::jaw_angle_outer);
}
TEST(Block, fails_the_casing_spacing_only) {
  scene::Block block;
  block.casing_spacing_mm = 233.9;
  expect_only_failure(inspect(block), ItemId::casing_spacing);
}
TEST(Block, fails_the_outer_protrusion_only) {
  scene::Block block;
  block.rim_outer_mm = 0.3;
  expect_only_failure(inspect(block), ItemId::casing_protrusion_outer);
}
TEST(Block, fails_the_inner_protrusion_only) {
  scene::Block block;
  block.rim_inner_mm = -0.8;
  expect_only_failure(inspect(block), ItemId::casing_protrusion_inner);
}
TEST(Block, has_no_slope_without_a_slab_top_and_never_takes_another_datum) {
  scene::Block block;
  block.slab_top_seen = false;
  const BlockResult r = inspect(block);
  EXPECT_EQ(r.verdict, Verdict::not_measured);
  EXPECT_EQ(r.reason, kReasonItemBase + 0);
  EXPECT_TRUE(std::isnan(item(r, ItemId::seat_slope).value));
  EXPECT_EQ(item(r, ItemId::jaw_distance).verdict, Verdict::pass);
  EXPECT_FALSE(r.observation.top_ok);
  EXPECT_TRUE(r.observation.ok);
}

/// The same points in a random order.
scene::Cloud without_order(scene::Cloud cloud, std::uint64_t seed) {
  Prng prng(seed);
  const auto at = [&](std::size_t i) { return cloud.xyz.begin() + static_cast<std::ptrdiff_t>(3 * i); };
  for (std::size_t i = cloud.xyz.size() / 3; i > 1; --i) std::swap_ranges(at(i - 1), at(i), at(prng.below(i)));
  return cloud;
}

/// Inspects in a buffer like the daemon's, with capacity for a whole grid.
BlockResult inspect_roomy(const scene::Cloud& cloud) {
  return inspect(cloud, scene::p5600(), Pose::identity(), limits::kScanPointsMax);
}

/// Largest effect of noise and point order on an item: a small part of its U, except for the standard deviation, whose
/// U is nothing else.
double noise_of(const Item& item) {
  constexpr double kWithoutU = 0.0005;
  if (!has_value(item.U)) return kWithoutU;
  return item.id == ItemId::seat_std ? item.U : 0.1 * item.U;
}

class BlockOrder : public testing::TestWithParam<double> {};
INSTANTIATE_TEST_SUITE_P(Rays, BlockOrder, testing::Values(0.0, 600.0),
                         [](const auto& focus) { return focus.param == 0.0 ? "parallel" : "perspective"; });

TEST_P(BlockOrder, is_the_same_within_noise_organised_or_not) {
  scene::Scan scan;
  scan.focus_mm = GetParam();
  const scene::Cloud in_scan_order = scene::take({}, scan);
  const BlockResult a = inspect(in_scan_order);
  scan.organised = true;
  const BlockResult organised = inspect(scene::take({}, scan));
  const BlockResult ordered = inspect_roomy(without_order(in_scan_order, 1));
  const BlockResult no_room = inspect(without_order(in_scan_order, 1));
  for (const BlockResult& b : {organised, ordered, no_room}) {
    ASSERT_EQ(a.items.size(), b.items.size());
    for (std::size_t i = 0; i < a.items.size(); ++i) {
      const double x = a.items[i].value;
      const double y = b.items[i].value;
      EXPECT_EQ(has_value(x), has_value(y)) << info(a.items[i].id).name;
      if (has_value(x) && has_value(y)) {
        EXPECT_NEAR(x, y, noise_of(a.items[i])) << info(a.items[i].id).name << ", U " << a.items[i].U;
      }
    }
    EXPECT_EQ(a.scan.points_finite, b.scan.points_finite);
  }
  EXPECT_GT(organised.scan.points_read, organised.scan.points_finite);
  EXPECT_EQ(ordered.scan.points_read, a.scan.points_read);
  EXPECT_EQ(ordered.scan.points_kept, a.scan.points_kept);
}

TEST(Block, gives_the_same_bits_whatever_order_of_no_meaning_its_points_have) {
  const scene::Cloud cloud = scene::take({}, {});
  const BlockResult first = inspect_roomy(without_order(cloud, 1));
  const BlockResult second = inspect_roomy(without_order(cloud, 2));
  EXPECT_EQ(first.verdict, Verdict::pass);
  for (std::size_t i = 0; i < first.items.size(); ++i) {
    EXPECT_EQ(std::memcmp(&first.items[i].value, &second.items[i].value, sizeof(double)), 0);
    EXPECT_EQ(std::memcmp(&first.items[i].U, &second.items[i].U, sizeof(double)), 0);
  }
  EXPECT_EQ(first.registration.T_scanner_block.to_array(), second.registration.T_scanner_block.to_array());
}

TEST(Block, gives_the_same_bits_again_and_after_another_block) {
  const scene::Cloud cloud = scene::take({}, {});
  BlockInspector inspector;
  inspector.use(scene::p5600());
  const auto run = [&](scene::Cloud c) {
    inspector.begin(1, Pose::identity(), nominal_T_block_scanner());
    Cloud view = c.view();
    EXPECT_TRUE(inspector.denoise(view).ok());
    EXPECT_TRUE(inspector.register_to_model(view).ok()) << inspector.result().registration.note.c_str();
    EXPECT_TRUE(inspector.extract(view).ok());
    inspector.judge(Code::ok);
    return inspector.result();
  };
  const BlockResult first = run(cloud);
  scene::Block other;
  other.cant_ratio = 38.0;
  (void)run(scene::take(other, {}));
  const BlockResult again = run(cloud);
  for (std::size_t i = 0; i < first.items.size(); ++i) {
    EXPECT_EQ(std::memcmp(&first.items[i].value, &again.items[i].value, sizeof(double)), 0);
    EXPECT_EQ(std::memcmp(&first.items[i].companion, &again.items[i].companion, sizeof(double)), 0);
  }
  EXPECT_EQ(first.registration.T_scanner_block.to_array(), again.registration.T_scanner_block.to_array());
  EXPECT_EQ(first.registration.deviation.std_mm, again.registration.deviation.std_mm);
}

TEST(Block, reports_the_seat_in_the_base_frame) {
  const Pose T_base_block = scene::displaced(1000.0, -500.0, 300.0, 10.0, 20.0, 30.0);
  scene::Scan scan;
  scan.displacement = scene::displaced(2.0, -1.0, 1.5, 0.0, 0.0, 0.2);
  const BlockResult r = inspect(scene::take({}, scan), scene::p5600(), T_base_block);
  const Pose truth = T_base_block * scan.displacement;
  const SeatObservation& o = r.observation;
  ASSERT_TRUE(o.ok && o.jaw_ok && o.top_ok);
  EXPECT_LT((o.p_base - truth.translation_mm).norm(), 0.03);
  const double cant = std::atan(1.0 / 40.0);
  EXPECT_LT(angle_between_rad(o.n_base, truth.rotation * Vec3(0.0, -std::sin(cant), std::cos(cant))), 2e-5);
  EXPECT_LT(angle_between_rad(o.top_n_base, truth.rotation * Vec3::UnitZ()), 2e-5);
  const Vec3 jaw(0.0, 190.0 * std::cos(cant) - 10.0 * std::sin(cant), 190.0 * std::sin(cant) + 10.0 * std::cos(cant));
  EXPECT_LT((o.jaw_outer_base - truth * jaw).norm(), 0.03);
}

/// Removes the points within `radius` of a position in the scanner's XY.
void erase_patch(scene::Cloud& cloud, double x, double y, double radius) {
  std::size_t kept = 0;
  for (std::size_t i = 0; i < cloud.xyz.size() / 3; ++i) {
    const double dx = static_cast<double>(cloud.xyz[3 * i]) - x;
    const double dy = static_cast<double>(cloud.xyz[3 * i + 1]) - y;
    if (std::hypot(dx, dy) < radius) continue;
    for (std::size_t k = 0; k < 3; ++k) cloud.xyz[3 * kept + k] = cloud.xyz[3 * i + k];
    ++kept;
  }
  cloud.xyz.resize(3 * kept);
}

/// Keeps the points for which `stays(x, y, z)` is true, in the block's nominal frame.
template <typename Stays>
scene::Cloud only(scene::Cloud cloud, const Stays& stays) {
  std::size_t kept = 0;
  for (std::size_t i = 0; i < cloud.xyz.size() / 3; ++i) {
    const float* p = cloud.xyz.data() + 3 * i;
    const Vec3 block = cloud.T_block_scanner * Vec3(p[0], p[1], p[2]);
    if (!stays(block.x(), block.y(), block.z())) continue;
    for (std::size_t k = 0; k < 3; ++k) cloud.xyz[3 * kept + k] = cloud.xyz[3 * i + k];
    ++kept;
  }
  cloud.xyz.resize(3 * kept);
  return cloud;
}

TEST(Block, has_no_flatness_when_part_of_the_seat_was_not_seen) {
  for (const double side : {12.0, 30.0, 70.0}) {
    SCOPED_TRACE(side);
    const BlockResult r = inspect(only(scene::take({}, {}), [side](double x, double y, double) {
      return std::abs(x - 10.0) > 0.5 * side || std::abs(y + 20.0) > 0.5 * side;
    }));
    EXPECT_TRUE(std::isnan(item(r, ItemId::seat_flatness).value));
    EXPECT_EQ(item(r, ItemId::seat_flatness).verdict, Verdict::not_measured);
    EXPECT_EQ(item(r, ItemId::seat_slope).verdict, Verdict::pass);
    EXPECT_EQ(r.verdict, Verdict::not_measured);
    EXPECT_EQ(r.reason, kReasonItemBase + static_cast<int>(ItemId::seat_flatness));
  }
}

TEST(Block, passes_from_a_coarse_scan) {
  for (const double pitch_mm : {0.373, 0.42}) {
    scene::Scan scan;
    scan.pitch_mm = pitch_mm;
    scan.displacement = scene::displaced(0.3, -0.4, 0.5, 0.1, 0.0, 1.5);
    EXPECT_EQ(inspect(scene::take({}, scan)).verdict, Verdict::pass) << pitch_mm;
  }
}

TEST(Block, has_no_slope_from_a_corner_of_the_slab_top) {
  // 20 mm: the noise of such a corner allows an accurate tilt, but it is not that of the slab.
  for (const double side : {8.0, 20.0, 50.0}) {
    SCOPED_TRACE(side);
    const BlockResult r = inspect(only(scene::take({}, {}), [side](double x, double y, double z) {
      return on_block(z) || (std::abs(x - 145.0) < 0.5 * side && std::abs(y - 60.0) < 0.5 * side);
    }));
    EXPECT_FALSE(r.slab_top.ok);
    EXPECT_FALSE(r.observation.top_ok);
    EXPECT_TRUE(std::isnan(item(r, ItemId::seat_slope).value));
    EXPECT_EQ(r.verdict, Verdict::not_measured);
  }
}

TEST(Block, has_no_slope_from_four_spots_of_the_slab_top) {
  const BlockResult r = inspect(only(scene::take({}, {}), [](double x, double y, double z) {
    return on_block(z) || (std::abs(std::abs(x) - 145.0) < 4.0 && std::abs(std::abs(y) - 200.0) < 4.0);
  }));
  EXPECT_FALSE(r.slab_top.ok) << "far apart, but four spots of dirt would do the same";
}

TEST(Block, has_its_slope_from_a_small_field_of_view) {
  scene::Scan scan;
  scan.field_x_mm = 260.0;
  scan.field_y_mm = 420.0;
  const BlockResult r = inspect(scene::take({}, scan));
  EXPECT_TRUE(r.slab_top.ok);
  EXPECT_EQ(r.verdict, Verdict::pass);
}

TEST(Block, has_no_jaw_angle_from_a_piece_of_the_jaw) {
  const BlockResult narrow = inspect(only(scene::take({}, {}), [](double x, double y, double z) {
    return y < 180.0 || z > 28.0 || !on_block(z) || std::abs(x) < 15.0;
  }));
  EXPECT_FALSE(narrow.jaw_outer.ok);
  EXPECT_TRUE(narrow.jaw_inner.ok);
  EXPECT_EQ(item(narrow, ItemId::jaw_angle_outer).verdict, Verdict::not_measured);
  EXPECT_EQ(item(narrow, ItemId::jaw_distance).verdict, Verdict::not_measured);
  EXPECT_EQ(narrow.verdict, Verdict::not_measured);
  const BlockResult half = inspect(only(scene::take({}, {}), [](double x, double y, double z) {
    return y < 180.0 || z > 28.0 || !on_block(z) || x < 10.0;
  }));
  EXPECT_TRUE(half.jaw_outer.ok);
  EXPECT_EQ(item(half, ItemId::jaw_angle_outer).verdict, Verdict::pass);
  EXPECT_EQ(half.verdict, Verdict::indeterminate) << "half of the face was not seen, or is not there";
  ASSERT_FALSE(half.findings.empty());
  EXPECT_EQ(half.findings[0].kind, FindingKind::missing);
}

TEST(Block, states_the_uncertainty_of_its_standard_deviation) {
  const BlockResult r = inspect(scene::Block{});
  const Item& seat_std = item(r, ItemId::seat_std);
  EXPECT_GT(r.seat.grid_points, 5000U);
  // Its sampling error: between every point and every cell counting as independent.
  EXPECT_GE(seat_std.U, 2.0 * seat_std.value / std::sqrt(2.0 * (static_cast<double>(r.seat.plane.inliers) - 1.0)));
  EXPECT_LE(seat_std.U, 2.0 * seat_std.value / std::sqrt(2.0 * (r.seat.grid_points - 1.0)));
  EXPECT_EQ(seat_std.verdict, Verdict::none);
}

TEST(Block, finds_casings_despite_patches_missing_at_their_edges) {
  scene::Cloud cloud = scene::take({}, {});
  // The scanner looks down with its Y opposite to the block's: the outer casing is at y = -116.5.
  erase_patch(cloud, 0.0, -116.5 + 15.0, 5.0);
  erase_patch(cloud, 15.0, 116.5, 4.0);
  const BlockResult r = inspect(cloud);
  EXPECT_NEAR(item(r, ItemId::casing_spacing).value, 233.0, 0.05);
  EXPECT_NEAR(item(r, ItemId::casing_protrusion_inner).value, -0.25, 0.005);
  EXPECT_NEAR(item(r, ItemId::casing_protrusion_outer).value, -0.25, 0.005);
}

TEST(Block, measures_a_casing_of_which_four_tenths_are_hidden_with_its_uncertainty) {
  scene::Cloud cloud = scene::take({}, {});
  erase_patch(cloud, 0.0, -116.5 + 16.0, 19.0);
  const BlockResult r = inspect(cloud);
  ASSERT_TRUE(r.casing_outer.ok);
  const double sigma = std::sqrt(r.casing_outer.cov_circle(1, 1));
  EXPECT_GT(sigma, 1.5 * std::sqrt(r.casing_inner.cov_circle(1, 1)));
  EXPECT_NEAR(item(r, ItemId::casing_spacing).value, 233.0, 4.0 * sigma + 0.02);
}

TEST(Block, does_not_guess_a_casing_that_is_more_than_half_hidden) {
  scene::Cloud cloud = scene::take({}, {});
  erase_patch(cloud, 0.0, -116.5 + 16.0, 24.0);
  const BlockResult r = inspect(cloud);
  EXPECT_FALSE(r.casing_outer.ok);
  EXPECT_TRUE(r.casing_inner.ok);
  EXPECT_EQ(item(r, ItemId::casing_spacing).verdict, Verdict::not_measured);
  EXPECT_EQ(item(r, ItemId::casing_protrusion_outer).verdict, Verdict::not_measured);
  EXPECT_EQ(item(r, ItemId::casing_protrusion_inner).verdict, Verdict::pass);
  EXPECT_EQ(r.verdict, Verdict::not_measured);
  EXPECT_FALSE(r.observation.ok) << "the seat reference point needs both casings";
}

TEST(Block, is_measured_with_a_tool_lying_on_its_shoulder) {
  scene::Cloud cloud = scene::take({}, {});
  for (std::size_t i = 0; i < cloud.xyz.size() / 3; ++i) {
    float* p = cloud.xyz.data() + 3 * i;
    if (std::abs(p[0] - 40.0F) < 30.0F && std::abs(p[1] + 215.0F) < 12.0F) p[2] -= 20.0F;
  }
  const BlockResult r = inspect(cloud);
  EXPECT_EQ(r.verdict, Verdict::pass);
}

void expect_nothing_measured(const BlockResult& r, Code code) {
  EXPECT_NE(r.registration.status, RegistrationStatus::none) << "reports know four words for a registration";
  EXPECT_EQ(r.verdict, Verdict::not_measured);
  EXPECT_EQ(r.reason, static_cast<std::uint16_t>(code));
  ASSERT_EQ(r.items.size(), 11U) << "the items are listed all the same";
  for (const Item& i : r.items) {
    EXPECT_EQ(i.verdict, Verdict::not_measured);
    EXPECT_TRUE(std::isnan(i.value));
  }
  EXPECT_FALSE(r.observation.ok);
}

TEST(Block, is_not_measured_from_missing_points_only) {
  scene::Cloud cloud;
  cloud.xyz.assign(3 * 100000, std::numeric_limits<float>::quiet_NaN());
  cloud.width = 1000;
  cloud.height = 100;
  expect_nothing_measured(inspect(cloud), Code::too_few_points);
}

TEST(Block, is_not_measured_from_an_empty_scan) {
  expect_nothing_measured(inspect(scene::Cloud{}), Code::too_few_points);
}

TEST(Block, is_not_measured_from_too_few_points) {
  scene::Cloud cloud = scene::take({}, {});
  cloud.xyz.resize(3 * 40000);
  const BlockResult r = inspect(cloud);
  expect_nothing_measured(r, Code::too_few_points);
  EXPECT_EQ(r.registration.status, RegistrationStatus::rejected);
  EXPECT_EQ(r.registration.note.view(), "not tried: too few points");
}

TEST(Block, that_is_not_there_is_not_measured) {
  scene::Block bare;
  bare.present = false;
  expect_nothing_measured(inspect(scene::take(bare, {})), Code::block_not_found);
}

TEST(Block, that_is_not_there_has_no_map_of_another_one) {
  BlockInspector inspector;
  inspector.use(scene::p5600());
  const auto map_of = [&](const scene::Block& block) {
    scene::Cloud cloud = scene::take(block, {});
    Cloud view = cloud.view();
    inspector.begin(1, Pose::identity(), nominal_T_block_scanner());
    Status status = inspector.denoise(view);
    EXPECT_EQ(inspector.deviation_map().columns, 0U) << "not yet";
    if (status) status = inspector.register_to_model(view);
    if (status) status = inspector.extract(view);
    return inspector.deviation_map();
  };
  EXPECT_EQ(map_of({}).columns, limits::kFaceTableX / limits::kDeviationMapCell_mm);
  scene::Block bare;
  bare.present = false;
  EXPECT_EQ(map_of(bare).columns, 0U);
  EXPECT_GT(inspector.result().registration.deviation.count, 0U) << "the test asks what it should";
}

TEST(Block, with_a_rough_seat_is_not_measured_rather_than_guessed) {
  // Every third point around the seat is off by less than denoising removes: no plane has 80 % of them.
  scene::Cloud cloud = scene::take({}, {});
  Prng prng(6);
  for (std::size_t i = 0; i < cloud.xyz.size() / 3; ++i) {
    float* p = cloud.xyz.data() + 3 * i;
    if (std::abs(p[0]) < 80.0F && std::abs(p[1]) < 90.0F && i % 3 == 0)
      p[2] += static_cast<float>(0.2 + 0.35 * prng.uniform());
  }
  expect_nothing_measured(inspect(cloud), Code::fit_failed);
}

TEST(Block, is_refused_when_its_scan_does_not_fit_its_buffer) {
  BlockInspector inspector;
  inspector.use(scene::p5600());
  inspector.begin(1, Pose::identity(), nominal_T_block_scanner());
  std::vector<float> xyz(30);
  Cloud cloud{xyz, 11, 0, 0};
  const Status status = inspector.denoise(cloud);
  ASSERT_FALSE(status.ok());
  EXPECT_EQ(status.error().code, Code::frame_incomplete);
  EXPECT_EQ(inspector.result().registration.status, RegistrationStatus::rejected);
}

TEST(Block, is_not_extracted_without_a_converged_registration) {
  scene::Cloud cloud = scene::take({}, {});
  BlockInspector inspector;
  inspector.use(scene::p5600());
  inspector.begin(1, Pose::identity(), nominal_T_block_scanner());
  EXPECT_FALSE(inspector.extract(cloud.view()).ok());
}

TEST(Block, judged_with_a_code_never_keeps_a_pass) {
  scene::Cloud cloud = scene::take({}, {});
  BlockInspector inspector;
  inspector.use(scene::p5600());
  inspector.begin(1, Pose::identity(), nominal_T_block_scanner());
  Cloud view = cloud.view();
  ASSERT_TRUE(inspector.denoise(view).ok());
  ASSERT_TRUE(inspector.register_to_model(view).ok());
  ASSERT_TRUE(inspector.extract(view).ok());
  inspector.judge(Code::deadline);
  EXPECT_EQ(inspector.result().verdict, Verdict::not_measured);
  EXPECT_EQ(inspector.result().reason, static_cast<std::uint16_t>(Code::deadline));
  for (const Item& i : inspector.result().items) EXPECT_EQ(i.verdict, Verdict::not_measured);
}

TEST(Block, is_indeterminate_within_the_guard_band_and_not_with_simple_acceptance) {
  scene::Block block;
  block.jaw_distance_mm = 380.45;
  EXPECT_EQ(item(inspect(block), ItemId::jaw_distance).verdict, Verdict::indeterminate);
  EXPECT_EQ(inspect(block).verdict, Verdict::indeterminate);
  Recipe simple = scene::p5600();
  simple.guard = 0.0;
  EXPECT_EQ(inspect(scene::take(block, {}), simple).verdict, Verdict::pass);
}

}  // namespace
}  // namespace slabd::algo
