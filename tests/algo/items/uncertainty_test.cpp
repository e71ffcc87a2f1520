// SPDX-License-Identifier: Apache-2.0
#include "algo/items/uncertainty.h"

#include <gtest/gtest.h>

#include <functional>

#include "algo/items/block_items.h"
#include "item_simulation.h"
#include "tests/algo/scene.h"

namespace slabd::algo {
namespace {

using simulation::BuiltBlock;
using simulation::Errors;
using simulation::Line;

constexpr std::array kLinearItems = {
    ItemId::seat_slope,     ItemId::jaw_angle_inner,         ItemId::jaw_angle_outer,        ItemId::jaw_distance,
    ItemId::casing_spacing, ItemId::casing_protrusion_inner, ItemId::casing_protrusion_outer};

const StationSigma kSigma{0.02, rad_from_deg(0.001)};

double part_of(const Item& item, BudgetPart p) {
  return item.budget[static_cast<std::size_t>(p)];
}
const Item& find(const BlockResult& r, ItemId id) {
  return *find_item(r.items.begin(), r.items.end(), id);
}
double rss(const Item& item) {
  double sum = 0.0;
  for (const double u : item.budget) sum += u * u;
  return std::sqrt(sum);
}

/// An asymmetric block: symmetry must not hide a wrong gradient.
BuiltBlock crooked() {
  BuiltBlock b;
  b.slope_rad = rad_from_deg(0.8);
  b.cross_slope_rad = rad_from_deg(-1.1);
  b.jaw_angle_inner_rad = rad_from_deg(3.0);
  b.jaw_angle_outer_rad = rad_from_deg(-2.0);
  b.jaw_yaw_inner_rad = rad_from_deg(2.5);
  b.jaw_yaw_outer_rad = rad_from_deg(1.0);
  b.jaw_distance_mm = 1.3;
  b.casing_spacing_mm = -0.8;
  b.rim_inner_mm = 0.1;
  b.top_tilt_x_rad = rad_from_deg(0.9);
  b.top_tilt_y_rad = rad_from_deg(1.7);
  return b;
}

/// The crooked block without any uncertainty: each test adds the tested one.
struct Block {
  Line line{simulation::recipe_with_uncertainty(), kSigma};
  BlockResult result;

  Block() {
    Prng prng(1);
    result = line.measure_block(3, crooked(), simulation::none(), prng);
    result.seat.noise_factor = 1.0;
    result.registration.covariance.setZero();
  }
  [[nodiscard]] BlockResult budgeted() const {
    BlockResult r = result;
    blank_block_items(line.recipe(), {}, r);
    compute_block_items(line.model(), r);
    compute_block_budget(line.recipe(), {}, {}, r);
    return r;
  }
  /// Values after a change of the features, by the real item functions.
  [[nodiscard]] double value(ItemId id, const std::function<void(BlockResult&)>& change) const {
    BlockResult r = result;
    change(r);
    compute_block_items(line.model(), r);
    return find(r, id).value;
  }
  /// Central difference per unit of `step`.
  [[nodiscard]] double slope(ItemId id, double step, const std::function<void(BlockResult&, double)>& change) const {
    const double plus = value(id, [&](BlockResult& r) { change(r, step); });
    const double minus = value(id, [&](BlockResult& r) { change(r, -step); });
    return (plus - minus) / (2.0 * step);
  }
};

using PlaneOf = PlaneFit& (*)(BlockResult&);
struct NamedPlane {
  const char* name;
  PlaneOf of;
};
constexpr std::array<NamedPlane, 4> kPlanes = {
    NamedPlane{"seat", [](BlockResult& r) -> PlaneFit& { return r.seat.plane; }},
    NamedPlane{"jaw_inner", [](BlockResult& r) -> PlaneFit& { return r.jaw_inner; }},
    NamedPlane{"jaw_outer", [](BlockResult& r) -> PlaneFit& { return r.jaw_outer; }},
    NamedPlane{"slab_top", [](BlockResult& r) -> PlaneFit& { return r.slab_top; }}};

/// Moves a plane. The seat moves its casings too: their centres are on it and their heights are relative to it.
void move_plane(BlockResult& r, PlaneFit& plane, double shift_mm, const Vec3& dn) {
  const Vec3 before = plane.normal;
  const double before_offset = plane.offset_mm;
  plane.normal = (plane.normal + dn).normalized();
  plane.offset_mm = plane.normal.dot(plane.centroid) + shift_mm;
  if (&plane != &r.seat.plane) return;
  for (CasingFeature* c : {&r.casing_inner, &r.casing_outer}) {
    const Vec3 rim = c->centre - (before.dot(c->centre) - before_offset) * before + c->height_mm * before;
    c->height_mm = plane.normal.dot(rim) - plane.offset_mm;
  }
}

TEST(Uncertainty, fit_parts_equal_differences_of_the_real_items_plane_by_plane) {
  const Block block;
  for (const NamedPlane& plane : kPlanes) {
    PlaneFit nominal = plane.of(const_cast<BlockResult&>(block.result));
    Vec3 a = (Vec3(0.3, 0.5, 0.8) - nominal.normal.dot(Vec3(0.3, 0.5, 0.8)) * nominal.normal).normalized();
    const Vec3 b = nominal.normal.cross(a);
    for (const Vec3& direction : {a, b, Vec3(Vec3::Zero())}) {
      const double sigma = 1e-4;
      Block one;
      PlaneFit& fit = plane.of(one.result);
      const bool shift = direction.isZero();
      fit.sigma_offset_mm = shift ? sigma : 0.0;
      fit.cov_normal = sigma * sigma * direction * direction.transpose();
      const BlockResult r = one.budgeted();
      for (const ItemId id : kLinearItems) {
        const double by_difference = block.slope(id, 1e-5, [&](BlockResult& changed, double step) {
          move_plane(changed, plane.of(changed), shift ? step : 0.0, step * direction);
        });
        EXPECT_NEAR(part_of(find(r, id), BudgetPart::fit), sigma * std::abs(by_difference),
                    1e-6 * sigma * std::max(1.0, std::abs(by_difference)))
            << info(id).name << " by " << plane.name << (shift ? " shift" : " tilt");
      }
    }
  }
}

TEST(Uncertainty, effect_of_weighting_the_seat_by_area_is_rectangular_and_not_noise) {
  const Block block;
  const PlaneFit& seat = block.result.seat.plane;
  const Vec3 x = (Vec3::UnitX() - seat.normal.x() * seat.normal).normalized();
  // Tilt and height add with their signs; otherwise a casing at the seat's end would not be level.
  const PlaneShift by_area{1e-4 * (0.4 * x + 0.9 * seat.normal.cross(x)), 3e-3};
  Block one;
  one.result.seat.noise_factor = 9.0;
  one.result.seat.by_area = by_area;
  const BlockResult r = one.budgeted();
  for (const ItemId id : kLinearItems) {
    const double by_difference = block.slope(id, 1e-3, [&](BlockResult& changed, double step) {
      move_plane(changed, changed.seat.plane, step * by_area.height_mm, step * by_area.normal);
    });
    EXPECT_NEAR(part_of(find(r, id), BudgetPart::fit), std::abs(by_difference) / std::sqrt(3.0),
                1e-4 * std::abs(by_difference) + 1e-12)
        << info(id).name;
    EXPECT_EQ(part_of(find(r, id), BudgetPart::noise), 0.0) << info(id).name;
  }
}

TEST(Uncertainty, fit_parts_of_casings_equal_differences) {
  const Block block;
  const Vec3 x = (Vec3::UnitX() - block.result.seat.plane.normal.x() * block.result.seat.plane.normal).normalized();
  const Vec3 s = block.result.seat.plane.normal.cross(x);
  const double sigma = 1e-3;
  for (const bool outer : {false, true}) {
    const auto casing = [outer](BlockResult& r) -> CasingFeature& { return outer ? r.casing_outer : r.casing_inner; };
    for (const int axis : {0, 1}) {
      Block one;
      casing(one.result).cov_circle(axis, axis) = sigma * sigma;
      const double by_difference = block.slope(ItemId::casing_spacing, 1e-4, [&](BlockResult& r, double step) {
        casing(r).centre += step * (axis == 0 ? x : s);
      });
      EXPECT_NEAR(part_of(find(one.budgeted(), ItemId::casing_spacing), BudgetPart::fit),
                  sigma * std::abs(by_difference), 1e-3 * sigma);
    }
    Block one;
    casing(one.result).sigma_height_mm = sigma;
    const BlockResult r = one.budgeted();
    const ItemId own = outer ? ItemId::casing_protrusion_outer : ItemId::casing_protrusion_inner;
    const ItemId other = outer ? ItemId::casing_protrusion_inner : ItemId::casing_protrusion_outer;
    EXPECT_NEAR(part_of(find(r, own), BudgetPart::fit), sigma, 1e-12);
    EXPECT_EQ(part_of(find(r, other), BudgetPart::fit), 0.0);
  }
}

TEST(Uncertainty, registration_parts_equal_differences_of_the_real_items) {
  const Block block;
  const double sigma = 1e-4;
  for (int axis = 0; axis < 6; ++axis) {
    Block one;
    one.result.registration.covariance(axis, axis) = sigma * sigma;
    const BlockResult r = one.budgeted();
    for (const ItemId id : kLinearItems) {
      // The registered frame is off by the motion: every feature is relative to it.
      const double by_difference = block.slope(id, 1e-5, [&](BlockResult& changed, double step) {
        Pose motion;
        if (axis < 3) {
          motion.translation_mm[axis] = step;
        } else {
          motion.rotation = Quat(Eigen::AngleAxisd(step, Eigen::Vector3d(Vec3::Unit(axis - 3))));
        }
        for (const NamedPlane& plane : kPlanes) {
          PlaneFit& fit = plane.of(changed);
          fit.centroid = motion * fit.centroid;
          fit.normal = motion.rotation * fit.normal;
          fit.offset_mm = fit.normal.dot(fit.centroid);
        }
        for (CasingFeature* c : {&changed.casing_inner, &changed.casing_outer}) c->centre = motion * c->centre;
      });
      EXPECT_NEAR(part_of(find(r, id), BudgetPart::registration), sigma * std::abs(by_difference),
                  1e-5 * sigma * std::max(1.0, std::abs(by_difference)))
          << info(id).name << " by axis " << axis;
    }
  }
}

TEST(Uncertainty, observation_sigmas_equal_differences) {
  // One plane direction at a time, as above, compared with the observation itself.
  const Block block;
  const double sigma = 1e-4;
  for (const NamedPlane& plane : kPlanes) {
    Block one;
    PlaneFit& fit = plane.of(one.result);
    const Vec3 tangent = fit.normal.cross(Vec3(0.2, 0.9, -0.4)).normalized();
    fit.cov_normal = sigma * sigma * tangent * tangent.transpose();
    compute_observation(one.line.model(), CasingKind::open, Pose::identity(), one.result);
    const auto observe = [&](double step) {
      BlockResult r = block.result;
      PlaneFit& moved = plane.of(r);
      moved.normal = (moved.normal + step * tangent).normalized();
      moved.offset_mm = moved.normal.dot(moved.centroid);
      if (&moved == &r.seat.plane)
        for (CasingFeature* c : {&r.casing_inner, &r.casing_outer})
          c->centre -= (moved.normal.dot(c->centre) - moved.offset_mm) * moved.normal;
      compute_observation(block.line.model(), CasingKind::open, Pose::identity(), r);
      return r.observation;
    };
    const double step = 1e-5;
    const SeatObservation plus = observe(step);
    const SeatObservation minus = observe(-step);
    const double scale = sigma / (2.0 * step);
    const SeatObservation& o = one.result.observation;
    for (int axis = 0; axis < 3; ++axis) {
      EXPECT_NEAR(o.sigma_p_mm[axis], scale * std::abs(plus.p_base[axis] - minus.p_base[axis]), 1e-3 * sigma)
          << plane.name;
      EXPECT_NEAR(o.sigma_n_rad[axis], scale * std::abs(plus.n_base[axis] - minus.n_base[axis]), 1e-6 * sigma);
      EXPECT_NEAR(o.sigma_top_n_rad[axis], scale * std::abs(plus.top_n_base[axis] - minus.top_n_base[axis]),
                  1e-6 * sigma);
      EXPECT_NEAR(o.sigma_jaw_mm[axis], scale * std::abs(plus.jaw_outer_base[axis] - minus.jaw_outer_base[axis]),
                  1e-3 * sigma)
          << plane.name;
    }
  }
}

TEST(Uncertainty, a_plane_that_depends_on_its_threshold_counts_like_one_that_depends_on_density) {
  const PlaneShift shift{Vec3(1e-5, -2e-5, 0.0), 0.01};
  for (const CasingKind casings : {CasingKind::open, CasingKind::capped}) {
    Block plain;
    Block by_area;
    Block by_bend;
    by_area.result.seat.by_area = shift;
    by_bend.result.seat.plane.bend = shift;
    for (Block* block : {&plain, &by_area, &by_bend})
      compute_observation(block->line.model(), casings, Pose::identity(), block->result);
    const SeatObservation& bend = by_bend.result.observation;
    EXPECT_EQ(bend.sigma_p_mm, by_area.result.observation.sigma_p_mm);
    EXPECT_EQ(bend.sigma_n_rad, by_area.result.observation.sigma_n_rad);
    EXPECT_EQ(bend.sigma_jaw_mm, by_area.result.observation.sigma_jaw_mm);
    EXPECT_GT(bend.sigma_p_mm.z(), plain.result.observation.sigma_p_mm.z());
    EXPECT_GT(bend.sigma_jaw_mm.z(), plain.result.observation.sigma_jaw_mm.z());
  }
  Block by_area;
  Block by_bend;
  by_area.result.seat.by_area = shift;
  by_bend.result.seat.plane.bend = shift;
  EXPECT_EQ(part_of(find(by_bend.budgeted(), ItemId::seat_slope), BudgetPart::fit),
            part_of(find(by_area.budgeted(), ItemId::seat_slope), BudgetPart::fit));
}

TEST(Uncertainty, under_caps_the_reference_point_is_as_sure_as_the_registered_frame) {
  const Block block;
  const double sigma = 1e-4;
  const double step = 1e-5;
  for (int axis = 0; axis < 6; ++axis) {
    Block one;
    one.result.registration.covariance(axis, axis) = sigma * sigma;
    compute_observation(one.line.model(), CasingKind::capped, Pose::identity(), one.result);
    // The frame is off by the motion: the seat is relative to it, and so is the pose in the robot's base.
    const auto observe = [&](double by) {
      Pose motion;
      if (axis < 3)
        motion.translation_mm[axis] = by;
      else
        motion.rotation = Quat(Eigen::AngleAxisd(by, Eigen::Vector3d(Vec3::Unit(axis - 3))));
      BlockResult r = block.result;
      PlaneFit& seat = r.seat.plane;
      seat.centroid = motion * seat.centroid;
      seat.normal = motion.rotation * seat.normal;
      seat.offset_mm = seat.normal.dot(seat.centroid);
      for (CasingFeature* c : {&r.casing_inner, &r.casing_outer}) *c = {};
      compute_observation(block.line.model(), CasingKind::capped, motion.inverse(), r);
      EXPECT_TRUE(r.observation.ok);
      return r.observation.p_base;
    };
    const Vec3 moved = observe(step) - observe(-step);
    for (int k = 0; k < 3; ++k)
      EXPECT_NEAR(one.result.observation.sigma_p_mm[k], sigma / (2.0 * step) * std::abs(moved[k]), 1e-3 * sigma)
          << "axis " << axis << ", " << k;
  }
  // ... and up and down like the seat's plane.
  Block one;
  one.result.seat.plane.sigma_offset_mm = sigma;
  compute_observation(one.line.model(), CasingKind::capped, Pose::identity(), one.result);
  EXPECT_NEAR(one.result.observation.sigma_p_mm.z(), sigma / one.result.seat.plane.normal.z(), 1e-3 * sigma);
  EXPECT_EQ(one.result.observation.sigma_p_mm.x(), 0.0);
}

TEST(Uncertainty, correlated_noise_multiplies_the_variance_of_the_fit) {
  Block block;
  block.result.seat.plane.cov_normal = 1e-10 * (Mat3::Identity());
  block.result.seat.noise_factor = 5.0;
  const Item slope = find(block.budgeted(), ItemId::seat_slope);
  EXPECT_NEAR(part_of(slope, BudgetPart::noise), 2.0 * part_of(slope, BudgetPart::fit), 1e-12);
}

TEST(Uncertainty, scanner_and_reference_parts_follow_the_stated_model) {
  const Block block;
  const BlockResult r = block.budgeted();
  const double u = 0.05 / std::sqrt(3.0);
  const double tilt_deg = deg_from_rad(u / 150.0);
  EXPECT_NEAR(part_of(find(r, ItemId::jaw_angle_inner), BudgetPart::scanner), std::sqrt(2.0) * tilt_deg, 1e-12);
  EXPECT_NEAR(part_of(find(r, ItemId::seat_slope), BudgetPart::scanner), std::sqrt(2.0) * tilt_deg, 1e-4);
  EXPECT_NEAR(part_of(find(r, ItemId::casing_spacing), BudgetPart::scanner),
              std::hypot(std::sqrt(2.0) * u, 50e-6 * find(r, ItemId::casing_spacing).value / std::sqrt(3.0)), 1e-12);
  const double to_rim = (block.result.casing_outer.centre - block.result.seat.plane.centroid).norm();
  EXPECT_NEAR(part_of(find(r, ItemId::casing_protrusion_outer), BudgetPart::scanner), u * to_rim / 150.0, 1e-12);
  // Two jaws far apart, each 1 / cos(lean); the seat's height between them; 50 ppm of 380 mm.
  EXPECT_GT(part_of(find(r, ItemId::jaw_distance), BudgetPart::scanner), std::sqrt(2.0) * u);
  EXPECT_LT(part_of(find(r, ItemId::jaw_distance), BudgetPart::scanner), 2.0 * std::sqrt(2.0) * u);

  EXPECT_NEAR(part_of(find(r, ItemId::seat_slope), BudgetPart::reference), 0.001, 1e-12);
  EXPECT_NEAR(part_of(find(r, ItemId::jaw_distance), BudgetPart::reference), 0.005, 1e-12);
  EXPECT_NEAR(part_of(find(r, ItemId::casing_spacing), BudgetPart::reference),
              0.005 * find(r, ItemId::casing_spacing).value / 380.0, 1e-12);
  for (const Item& i : r.items) {
    EXPECT_EQ(part_of(i, BudgetPart::calibration), 0.0);
    EXPECT_EQ(part_of(i, BudgetPart::robot), 0.0);
  }
}

TEST(Uncertainty, U_is_twice_the_root_sum_of_squares_of_the_budget) {
  Prng prng(5);
  const Line line(simulation::recipe_with_uncertainty(), kSigma);
  Errors errors;
  errors.flatness = true;
  const BlockResult r = line.measure_block(7, crooked(), errors, prng);
  int budgets = 0;
  for (const Item& i : r.items) {
    if (!has_value(i.value)) continue;
    EXPECT_NEAR(i.U, 2.0 * rss(i), 1e-15) << info(i.id).name;
    EXPECT_GT(i.U, 0.0);
    ++budgets;
  }
  EXPECT_EQ(budgets, 9) << "all but the two skews";
}

TEST(Uncertainty, without_settings_items_keep_the_recipes_U_and_no_budget) {
  Prng prng(5);
  const Recipe recipe = scene::p5600();
  const Line line(recipe, kSigma);
  Errors errors;
  errors.scanner = errors.reference = 0.0;
  const BlockResult r = line.measure_block(7, BuiltBlock{}, errors, prng);
  for (const ItemId id : kLinearItems) {
    EXPECT_EQ(find(r, id).U, recipe.tolerance(id).U);
    EXPECT_EQ(rss(find(r, id)), 0.0);
  }
}

TEST(Uncertainty, a_part_that_is_unknown_never_makes_U_small) {
  const Block block;
  const Recipe& recipe = block.line.recipe();
  Block good;
  const BlockResult whole = good.budgeted();
  const auto spoiled = [&](const std::function<void(BlockResult&)>& spoil) {
    Block one;
    spoil(one.result);
    return one.budgeted();
  };
  const auto fell_back = [&](const BlockResult& r, ItemId id) {
    // Not less than the recipe states, nor more than all parts together.
    const double U = find(r, id).U;
    const double of_recipe = recipe.tolerance(id).U;
    return U >= of_recipe && U <= std::max(of_recipe, find(whole, id).U) && rss(find(r, id)) == 0.0;
  };
  BlockResult r = spoiled([](BlockResult& b) { b.seat.noise_factor = kNoValue; });
  for (const ItemId id : kLinearItems) EXPECT_TRUE(fell_back(r, id)) << info(id).name;
  r = spoiled([](BlockResult& b) { b.seat.noise_factor = 0.5; });
  for (const ItemId id : {ItemId::casing_protrusion_inner}) EXPECT_TRUE(fell_back(r, id) || find(r, id).U > 0.0);
  r = spoiled([](BlockResult& b) { b.jaw_outer.cov_normal = Mat3::Constant(kNoValue); });
  EXPECT_TRUE(fell_back(r, ItemId::jaw_angle_outer));
  EXPECT_TRUE(fell_back(r, ItemId::jaw_distance));
  EXPECT_FALSE(fell_back(r, ItemId::jaw_angle_inner));
  r = spoiled([](BlockResult& b) { b.seat.plane.sigma_offset_mm = kNoValue; });
  EXPECT_TRUE(fell_back(r, ItemId::casing_protrusion_inner));
  EXPECT_FALSE(fell_back(r, ItemId::seat_slope)) << "a slope does not ask for a height";
  r = spoiled([](BlockResult& b) { b.casing_inner.cov_circle = Mat3::Constant(kNoValue); });
  EXPECT_TRUE(fell_back(r, ItemId::casing_spacing));
  r = spoiled([](BlockResult& b) { b.registration.covariance = Mat6::Constant(kNoValue); });
  EXPECT_TRUE(fell_back(r, ItemId::jaw_distance));
  EXPECT_FALSE(fell_back(r, ItemId::jaw_angle_outer)) << "angles do not ask for the registration";
  // Without a default in the recipe the result is indeterminate.
  Item item;
  item.value = 0.0;
  item.lower = -1.0;
  item.upper = 1.0;
  Budget budget{};
  budget[0] = kNoValue;
  budget[1] = 0.6;
  EXPECT_FALSE(settle(budget, item));
  EXPECT_FALSE(has_value(item.U));
  EXPECT_EQ(judge(item, 1.0), Verdict::indeterminate);
  // With one it is not smaller than the parts that are known.
  for (const auto& [of_recipe, expected] : {std::pair{0.5, 1.2}, std::pair{1.5, 1.5}}) {
    item.U = of_recipe;
    EXPECT_FALSE(settle(budget, item));
    EXPECT_DOUBLE_EQ(item.U, expected);
    EXPECT_EQ(item.budget, Budget{});
  }
}

TEST(Uncertainty, is_the_sampling_error_for_seat_std_also_without_settings) {
  Prng prng(2);
  const Line line(scene::p5600(), kSigma);
  Errors errors;
  errors.scanner = errors.reference = 0.0;
  errors.noise_factor = 9.0;
  const BlockResult r = line.measure_block(1, BuiltBlock{}, errors, prng);
  const Item& std_item = find(r, ItemId::seat_std);
  EXPECT_NEAR(std_item.U, 2.0 * 3.0 * std_item.value / std::sqrt(2.0 * (errors.points - 1.0)), 1e-12);
}

TEST(FlatnessNoise, multiple_covers_a_flat_seat_and_falls_off_where_the_form_is_clear) {
  // Numbers of cells: measured 95 % quantile over mean of the range of n standard normal values, and a third of its
  // excess more for cells of unequal numbers of points (200 full-size scans: 92.5 % covered without it, 98 % with it).
  EXPECT_NEAR(flatness_noise_multiple(1.0, 1.0, 6800), 1.0 + 0.10 * 4.0 / 3.0, 0.013);
  EXPECT_NEAR(flatness_noise_multiple(1.0, 1.0, 1000), 1.0 + 0.13 * 4.0 / 3.0, 0.026);
  EXPECT_NEAR(flatness_noise_multiple(1.0, 1.0, 100), 1.0 + 0.20 * 4.0 / 3.0, 0.04);
  EXPECT_DOUBLE_EQ(flatness_noise_multiple(30.0, 1.0, 6800), 0.95);
  for (double reading = 0.5; reading < 3.0; reading += 0.01)
    EXPECT_GE(flatness_noise_multiple(reading, 1.0, 6800), flatness_noise_multiple(reading + 0.01, 1.0, 6800));
}

ScannerNumbers verified(double form_half_mm, double form_length_mm, double PS_mm) {
  ScannerNumbers n;
  n.form_half_mm = form_half_mm;
  n.form_length_mm = form_length_mm;
  n.PS_mm = PS_mm;
  return n;
}

TEST(ScannerBudget, uses_the_larger_of_specification_and_verification_term_by_term) {
  const UncertaintySettings u = simulation::recipe_with_uncertainty().uncertainty;  // 0.05 mm over 150 mm, 50 ppm
  const ScannerModel specified(u);
  const auto expect_same = [&](const ScannerModel& model) {
    EXPECT_EQ(model.tilt_rad(), specified.tilt_rad());
    EXPECT_EQ(model.place_mm(), specified.place_mm());
    for (const double d : {0.0, 10.0, 150.0, 233.0, 1e6}) {
      EXPECT_EQ(model.difference_mm(d), specified.difference_mm(d));
      EXPECT_EQ(model.length_mm(d), specified.length_mm(d));
    }
  };
  expect_same(ScannerModel(u, {}));
  expect_same(ScannerModel(u, verified(0.01, 150.0, 0.0)));  // a lucky one reduces nothing
  expect_same(ScannerModel(u, verified(0.01, 150.0, kNoValue)));

  const ScannerModel worse(u, verified(0.10, 150.0, 0.08));
  EXPECT_NEAR(worse.tilt_rad(), 2.0 * specified.tilt_rad(), 1e-15);
  EXPECT_NEAR(worse.place_mm(), 2.0 * specified.place_mm(), 1e-15);
  EXPECT_NEAR(worse.difference_mm(100.0), 2.0 * specified.difference_mm(100.0), 1e-15);
  EXPECT_NEAR(worse.length_mm(380.0), 0.08 / std::sqrt(3.0), 1e-15);
  EXPECT_EQ(worse.length_mm(1e6), specified.length_mm(1e6));

  // A smaller form error over a shorter length: larger tilt, smaller shift.
  const ScannerModel shorter(u, verified(0.04, 60.0, 0.0));
  EXPECT_NEAR(shorter.tilt_rad(), 0.04 / std::sqrt(3.0) / 60.0, 1e-15);
  EXPECT_EQ(shorter.place_mm(), specified.place_mm());
  EXPECT_GT(shorter.difference_mm(50.0), specified.difference_mm(50.0));
  EXPECT_EQ(shorter.difference_mm(1e6), specified.difference_mm(1e6));
}

TEST(Budget, a_spacing_whose_U_the_recipe_states_is_known_no_better_than_its_circles) {
  Block b;
  Recipe recipe = b.line.recipe();
  recipe.uncertainty.given = false;
  const auto stated = [&](double sigma_mm) {
    BlockResult r = b.result;
    r.casing_inner.cov_circle = r.casing_outer.cov_circle = sigma_mm * sigma_mm * Mat3::Identity();
    blank_block_items(recipe, {}, r);
    compute_block_items(b.line.model(), r);
    compute_block_budget(recipe, {}, {}, r);
    return find(r, ItemId::casing_spacing).U;
  };
  const double fixed_mm = stated(0.01);
  EXPECT_GT(fixed_mm, 0.05) << "the recipe's";
  EXPECT_EQ(stated(0.02), fixed_mm);
  EXPECT_NEAR(stated(0.3), 2.0 * std::sqrt(2.0) * 0.3, 1e-3);
}

TEST(Budget, form_doubt_of_the_blocks_own_faces_widens_U_with_and_without_a_budget) {
  Block b;
  b.result.seat.flatness_mm = 0.5;
  b.result.seat.flatness_noise_mm = 0.01;
  b.result.seat.grid_points = 6'800;
  const FormDoubt form{{rad_from_deg(0.2), rad_from_deg(0.3)}, 0.3};
  for (const bool given : {true, false}) {
    Recipe recipe = b.line.recipe();
    recipe.uncertainty.given = given;
    const auto budgeted = [&](const FormDoubt& doubt) {
      BlockResult r = b.result;
      blank_block_items(recipe, {}, r);
      compute_block_items(b.line.model(), r);
      compute_block_budget(recipe, {}, doubt, r);
      return r;
    };
    const BlockResult sure = budgeted({});
    const BlockResult open = budgeted(form);
    const auto wider = [&](ItemId id, double u) {
      const double before = find(sure, id).U;
      EXPECT_GE(find(open, id).U, 2.0 * u - 1e-12);
      EXPECT_LE(find(open, id).U, std::hypot(before, 2.0 * u) + 1e-12);
    };
    wider(ItemId::jaw_angle_inner, 0.2);
    wider(ItemId::jaw_angle_outer, 0.3);
    wider(ItemId::seat_flatness, 0.3 / std::sqrt(3.0));
    EXPECT_GE(find(open, ItemId::jaw_distance).U, find(sure, ItemId::jaw_distance).U);
    EXPECT_EQ(find(open, ItemId::seat_slope).U, find(sure, ItemId::seat_slope).U);
  }
}

TEST(Budget, the_flatness_of_a_smoothed_scan_is_in_its_own_U) {
  Block b;
  b.result.seat.flatness_mm = 1.2;
  b.result.seat.flatness_noise_mm = 0.01;
  b.result.seat.grid_points = 6'800;
  const auto U_of = [&](double lag_ratio, double step_mm) {
    BlockResult r = b.result;
    r.scan.lag_ratio = lag_ratio;
    r.scan.step_mm = Vec3(0.0, 0.0, step_mm);
    blank_block_items(b.line.recipe(), {}, r);
    compute_block_items(b.line.model(), r);
    compute_block_budget(b.line.recipe(), {}, {}, r);
    return find(r, ItemId::seat_flatness).U;
  };
  EXPECT_LT(U_of(2.9, 0.0), 0.3) << "independent noise";
  EXPECT_LT(U_of(kNoValue, 0.0), 0.3) << "a scan without noise";
  EXPECT_GE(U_of(2.0, 0.0), 1.19) << "a mean of neighbours";
  EXPECT_GE(U_of(kNoValue, 0.05), 1.19) << "steps that hide a filter";
}

TEST(Budget, the_form_of_the_seat_widens_the_protrusions_where_it_is_clear_of_the_scanners) {
  const Block b;
  for (const bool given : {true, false}) {
    Recipe recipe = b.line.recipe();
    recipe.uncertainty.given = given;
    const auto U_of = [&](double seat_mm) {
      BlockResult r = b.result;
      blank_block_items(recipe, {}, r);
      compute_block_items(b.line.model(), r);
      FormDoubt form;
      form.seat_mm = seat_mm;
      compute_block_budget(recipe, {}, form, r);
      return find(r, ItemId::casing_protrusion_outer).U;
    };
    EXPECT_EQ(U_of(0.09), U_of(0.0));
    EXPECT_GE(U_of(0.2), 2.0 * std::sqrt(2.0 / 3.0) * 0.2 - 1e-9);
  }
}

TEST(ScannerBudget, a_scanner_that_is_worse_than_specified_makes_every_U_larger_and_a_better_one_none_smaller) {
  Block b;
  b.result.seat.flatness_mm = 0.05;
  b.result.seat.flatness_noise_mm = 0.01;
  b.result.seat.grid_points = 6'800;
  const auto budgeted = [&](const ScannerNumbers& n) {
    BlockResult r = b.result;
    blank_block_items(b.line.recipe(), {}, r);
    compute_block_items(b.line.model(), r);
    compute_block_budget(b.line.recipe(), n, {}, r);
    return r;
  };
  const BlockResult alone = budgeted({});
  const BlockResult better = budgeted(verified(0.001, 300.0, 0.0));
  const BlockResult worse = budgeted(verified(0.15, 150.0, 0.15));
  for (const ItemId id : kLinearItems) {
    EXPECT_EQ(find(better, id).U, find(alone, id).U) << info(id).name;
    EXPECT_GT(find(worse, id).U, find(alone, id).U) << info(id).name;
    EXPECT_EQ(part_of(find(worse, id), BudgetPart::reference), part_of(find(alone, id), BudgetPart::reference));
  }
  EXPECT_GT(find(worse, ItemId::seat_flatness).U, find(alone, ItemId::seat_flatness).U);
}

TEST(ScannerBudget, drift_with_temperature_adds_to_the_scanners_part_and_without_one_no_bit_changes) {
  Block b;
  b.result.seat.flatness_mm = 0.05;
  b.result.seat.flatness_noise_mm = 0.01;
  b.result.seat.grid_points = 6'800;
  const auto budgeted = [&](double drift) {
    BlockResult r = b.result;
    blank_block_items(b.line.recipe(), {}, r);
    compute_block_items(b.line.model(), r);
    compute_block_budget(b.line.recipe(), {}, {}, r, drift);
    return r;
  };
  const BlockResult without = budgeted(kNoValue);
  const BlockResult same = budgeted(0.0);
  constexpr double kDrift = 250e-6;  // 10 K of an aluminium frame
  const BlockResult warm = budgeted(kDrift);
  const auto added = [&](ItemId id) {
    const double before = part_of(find(without, id), BudgetPart::scanner);
    const double after = part_of(find(warm, id), BudgetPart::scanner);
    return std::sqrt(after * after - before * before);
  };
  for (const ItemId id : kLinearItems) {
    EXPECT_EQ(find(same, id).U, find(without, id).U) << info(id).name;
    EXPECT_EQ(find(same, id).budget, find(without, id).budget) << info(id).name;
    EXPECT_GT(find(warm, id).U, find(without, id).U) << info(id).name;
  }
  for (const ItemId id : {ItemId::jaw_distance, ItemId::casing_spacing})
    EXPECT_NEAR(added(id), kDrift * find(without, id).value / std::sqrt(3.0), 1e-6) << info(id).name;
  EXPECT_NEAR(added(ItemId::jaw_angle_inner), deg_from_rad(std::sqrt(2.0 / 3.0) * kDrift), 1e-6);
  EXPECT_GT(find(warm, ItemId::seat_flatness).U, find(without, ItemId::seat_flatness).U);
}

// Both outer jaws are at the same place of the scanner's image.
TEST(ScannerBudget, an_error_at_the_outer_jaw_counts_twice_across_the_track) {
  Recipe recipe = simulation::recipe_with_uncertainty();
  recipe.uncertainty.scanner_form_mm.value = 1e-9;
  const Line line(recipe, {0.02, rad_from_deg(0.001)});
  Prng prng(4);
  Errors errors = simulation::none();
  errors.noise_factor = 1.0;
  const simulation::Measured m = line.measure(simulation::nominal(recipe), errors, prng);
  const Item* item = find_item(m.slab.items.begin(), m.slab.items.end(), ItemId::large_jaw_distance);
  ASSERT_NE(item, nullptr);
  const SeatObservation& seen = m.blocks[0].observation;
  const double length_mm = algo::ScannerModel(recipe.uncertainty).length_mm((seen.jaw_outer_base - seen.p_base).norm());
  EXPECT_NEAR(item->budget[static_cast<std::size_t>(BudgetPart::scanner)], 2.0 * length_mm, 0.02 * length_mm);
}

TEST(ScannerBudget, verified_correlation_requires_a_noise_factor_by_the_density_of_the_scan) {
  ScannerNumbers n;
  EXPECT_EQ(verified_noise_factor(n, 20.0), 1.0) << "nothing was verified";
  n.noise_correlation_mm = 0.0;
  EXPECT_EQ(verified_noise_factor(n, 20.0), 1.0) << "neighbours err by themselves";
  n.noise_correlation_mm = 0.8;
  EXPECT_EQ(verified_noise_factor(n, kNoValue), 1.0);
  // The sum of exp(-r / L) over a lattice of the same density.
  const double pitch = 0.25;
  double sum = 0.0;
  for (int i = -80; i <= 80; ++i)
    for (int j = -80; j <= 80; ++j) sum += std::exp(-pitch * std::hypot(i, j) / 0.8);
  EXPECT_NEAR(verified_noise_factor(n, 1.0 / (pitch * pitch)), sum, 0.02 * sum);
}

}  // namespace
}  // namespace slabd::algo
