// SPDX-License-Identifier: Apache-2.0
#include "item_simulation.h"

#include <algorithm>
#include <cmath>
#include <map>

#include "algo/items/block_items.h"
#include "algo/items/uncertainty.h"
#include "tests/algo/scene.h"

namespace slabd::simulation {
namespace {

using algo::Plane;

Quat turned(const Vec3& rotation_rad) {
  const double angle = rotation_rad.norm();
  return angle > 0.0 ? Quat(Eigen::AngleAxisd(angle, Eigen::Vector3d(rotation_rad / angle))) : Quat(1.0, 0.0, 0.0, 0.0);
}
Pose moved(const Vec3& translation_mm, const Vec3& rotation_rad) {
  return {turned(rotation_rad), translation_mm};
}
double rectangular(Prng& prng, double half_width) {
  return half_width * (2.0 * prng.uniform() - 1.0);
}
Vec3 normal3(Prng& prng, double sigma) {
  const double x = prng.normal();
  const double y = prng.normal();
  const double z = prng.normal();
  return sigma * Vec3(x, y, z);
}

/// Two directions in the plane.
void tangents(const Vec3& n, Vec3& a, Vec3& b) {
  a = (Vec3::UnitX() - n.x() * n).normalized();
  b = n.cross(a);
}

struct PlaneNoise {
  double offset_mm;
  double tilt_rad;
  double factor;
};

PlaneFit plane_fit(const Vec3& normal, const Vec3& centroid, const PlaneNoise& noise, const Errors& errors) {
  PlaneFit fit;
  fit.ok = true;
  fit.normal = normal;
  fit.centroid = centroid;
  fit.offset_mm = normal.dot(centroid);
  fit.points = fit.inliers = errors.points;
  fit.inlier_fraction = 1.0;
  fit.std_mm = errors.noise_mm;
  fit.sigma_offset_mm = noise.offset_mm;
  fit.cov_normal = noise.tilt_rad * noise.tilt_rad * (Mat3::Identity() - normal * normal.transpose());
  return fit;
}

/// Rotates about the centroid and shifts along the normal.
void disturb(PlaneFit& fit, double shift_mm, double tilt_a_rad, double tilt_b_rad) {
  Vec3 a;
  Vec3 b;
  tangents(fit.normal, a, b);
  const Vec3 turned_normal = (fit.normal + tilt_a_rad * a + tilt_b_rad * b).normalized();
  fit.centroid += shift_mm * fit.normal;
  fit.normal = turned_normal;
  fit.offset_mm = fit.normal.dot(fit.centroid);
}
void disturb(PlaneFit& fit, const PlaneNoise& noise, Prng& prng) {
  const double root = std::sqrt(noise.factor);
  const double shift = root * noise.offset_mm * prng.normal();
  const double a = root * noise.tilt_rad * prng.normal();
  const double b = root * noise.tilt_rad * prng.normal();
  disturb(fit, shift, a, b);
}
/// Projects p onto the plane.
Vec3 on(const PlaneFit& plane, const Vec3& p) {
  return p - (plane.normal.dot(p) - plane.offset_mm) * plane.normal;
}

double form(int shape, double x, double s) {
  switch (shape) {
    case 0: return x * x;
    case 1: return s * s;
    case 2: return 0.5 * std::sin(2.0 * kPi * s);
    default: return 0.5 * x * s;
  }
}

double peak_to_valley(std::span<const Vec3> points) {
  const PlaneFit plane = algo::fit_plane_lsq(points, Vec3::UnitZ());
  double low = 1e300;
  double high = -1e300;
  for (const Vec3& p : points) {
    low = std::min(low, plane.normal.dot(p));
    high = std::max(high, plane.normal.dot(p));
  }
  return high - low;
}

/// Cells of the evaluation region: the seat's form, the scanner's bend and noise, relative to their own plane.
double measured_flatness(const Recipe& recipe, const BuiltBlock& built, const Errors& errors, Prng& prng,
                         std::uint32_t& cells) {
  const EvaluationSettings& e = recipe.evaluation;
  const auto columns = static_cast<int>(2.0 * e.crop_half_x_mm / e.cell_mm);
  const auto rows = static_cast<int>(2.0 * e.crop_half_s_mm / e.cell_mm);
  const algo::ScannerModel scanner(recipe.uncertainty);
  // A bend of the stated size between the middle and the ends of the longer side.
  const double bend_mm =
      rectangular(prng, errors.scanner * std::sqrt(3.0) *
                            scanner.difference_mm(2.0 * std::max(e.crop_half_x_mm, e.crop_half_s_mm)));
  std::vector<Vec3> means;
  means.reserve(static_cast<std::size_t>(columns * rows));
  for (int i = 0; i < columns; ++i)
    for (int j = 0; j < rows; ++j) {
      const double x = (2 * i + 1.0) / columns - 1.0;
      const double s = (2 * j + 1.0) / rows - 1.0;
      const double noise = errors.cell_mm > 0.0 ? errors.cell_mm * prng.normal() : 0.0;
      const double z = built.bow_mm * form(built.form_shape, x, s) + bend_mm * s * s + noise;
      means.emplace_back(x * e.crop_half_x_mm, s * e.crop_half_s_mm, z);
    }
  cells = static_cast<std::uint32_t>(means.size());
  return peak_to_valley(means);
}

/// Mean range of n standard normal values (exact integral by the trapezoidal rule).
double mean_range(double n) {
  double sum = 0.0;
  constexpr double kStep = 0.001;
  for (double x = -9.0; x < 9.0; x += kStep) {
    const double upper = 0.5 * std::erfc(x / std::sqrt(2.0));
    sum += kStep * (1.0 - std::exp(n * std::log1p(-upper)) - std::exp(n * std::log(std::max(upper, 1e-300))));
  }
  return sum;
}

}  // namespace

Errors none() {
  Errors e;
  e.seat_offset_mm = e.seat_tilt_rad = e.jaw_offset_mm = e.jaw_tilt_rad = e.top_offset_mm = e.top_tilt_rad = 0.0;
  e.circle_mm = e.rim_mm = e.cell_mm = 0.0;
  e.registration.fill(0.0);
  e.noise_factor = e.scanner = e.station = e.tie = e.reference = 0.0;
  return e;
}

BuiltSlab nominal(const Recipe& recipe) {
  BuiltSlab slab;
  slab.blocks.resize(recipe.stations());
  return slab;
}

BuiltSlab varied(const Recipe& recipe, Prng& prng) {
  BuiltSlab slab = nominal(recipe);
  const double warp = rectangular(prng, 1.0);
  const double twist = rectangular(prng, 0.1);
  const double end_mm = 0.5 * recipe.slab.length_mm.value;
  for (int station = 1; station <= recipe.stations(); ++station) {
    BuiltBlock& b = slab.blocks[static_cast<std::size_t>(station - 1)];
    const Pose T = T_slab_block(recipe, station);
    const double x = T.translation_mm.x() / end_mm;
    const double side = T.translation_mm.y() > 0.0 ? 1.0 : -1.0;
    // In the slab's axes, then converted to the block's own.
    Vec3 off = normal3(prng, 0.08);
    off.z() += warp * (1.0 - x * x) + twist * x * side;
    b.displacement = moved(T.rotation.conjugate() * off, normal3(prng, rad_from_deg(0.02)));
    b.slope_rad = rad_from_deg(0.03) * prng.normal();
    b.cross_slope_rad = rad_from_deg(0.03) * prng.normal();
    b.jaw_angle_inner_rad = rad_from_deg(0.3) * prng.normal();
    b.jaw_angle_outer_rad = rad_from_deg(0.3) * prng.normal();
    b.jaw_yaw_inner_rad = rad_from_deg(0.1) * prng.normal();
    b.jaw_yaw_outer_rad = rad_from_deg(0.1) * prng.normal();
    b.jaw_distance_mm = 0.1 * prng.normal();
    b.casing_spacing_mm = 0.1 * prng.normal();
    b.rim_inner_mm = 0.05 * prng.normal();
    b.rim_outer_mm = 0.05 * prng.normal();
    b.top_tilt_x_rad = rad_from_deg(0.05) * prng.normal();
    b.top_tilt_y_rad = rad_from_deg(0.05) * prng.normal();
    // A third of the seats is flat, the others are bowed up to 0.3 mm.
    b.bow_mm = prng.below(3) == 0 ? 0.0 : rectangular(prng, 0.3);
    b.form_shape = static_cast<int>(prng.below(4));
  }
  return slab;
}

TieNumbers independent_tie(double sigma_mm, double sigma_rad, const Vec3& centre_mm) {
  TieNumbers tie;
  tie.robot = "2";
  tie.centre_mm = centre_mm;
  tie.covariance = Mat6::Zero();
  for (int axis = 0; axis < 3; ++axis) {
    tie.covariance(axis, axis) = sigma_mm * sigma_mm;
    tie.covariance(axis + 3, axis + 3) = sigma_rad * sigma_rad;
  }
  tie.targets = 8;
  return tie;
}

Line::Line(const Recipe& recipe, const algo::StationSigma& sigma, const std::optional<SecondRobot>& second)
    : recipe_(recipe), sigma_(sigma), second_(second) {
  model_.build(recipe.block);
}

Pose Line::tie_error(const Errors& errors, Prng& prng) const {
  if (!second_) return {};
  const Mat6& covariance = second_->tie.covariance;  // of independent errors
  Vec3 shift;
  Vec3 turn;
  for (int axis = 0; axis < 3; ++axis) shift[axis] = errors.tie * std::sqrt(covariance(axis, axis)) * prng.normal();
  for (int axis = 0; axis < 3; ++axis)
    turn[axis] = errors.tie * std::sqrt(covariance(axis + 3, axis + 3)) * prng.normal();
  const Vec3& centre = second_->tie.centre_mm;
  const Quat rotation = turned(turn);
  return {rotation, centre + shift - rotation * centre};
}

void Line::displace(const Pose& motion, std::vector<BlockResult>& blocks) const {
  if (!second_) return;
  for (BlockResult& block : blocks) {
    if (!second_->scans[block.station - 1U]) continue;
    SeatObservation& seen = block.observation;
    seen.p_base = motion * seen.p_base;
    seen.jaw_outer_base = motion * seen.jaw_outer_base;
    seen.n_base = motion.rotation * seen.n_base;
    seen.top_n_base = motion.rotation * seen.top_n_base;
  }
}

void Line::inspect(std::span<const BlockResult> blocks, SlabResult& out) const {
  if (!second_) return algo::inspect_slab(recipe_, blocks, sigma_, T_base_slab(), out);
  std::array<algo::StationSigma, limits::kStationsMax> sigmas;
  sigmas.fill(sigma_);
  for (std::size_t i = 0; i < sigmas.size(); ++i) sigmas[i].arm = second_->scans[i] ? 1 : 0;
  const std::array<ScannerNumbers, limits::kArmsMax> verified{};
  algo::inspect_slab(recipe_, blocks, sigmas, T_base_slab(), out, algo::SlabArms{verified, &second_->tie}, {});
}

Pose Line::T_base_slab() {
  return scene::displaced(2500.0, -300.0, 400.0, 0.4, -0.3, 25.0);
}

ScannersAtJaw outer_jaw_errors(Prng& prng) {
  ScannersAtJaw scanners;
  for (OuterJawErrors& jaw : scanners)
    for (double* error : {&jaw.place, &jaw.length, &jaw.tilt_a, &jaw.tilt_b}) *error = rectangular(prng, 1.0);
  return scanners;
}

BlockResult Line::measure_block(int station, const BuiltBlock& built, const Errors& errors, Prng& prng,
                                const ScannersAtJaw* scanners) const {
  const std::size_t arm = second_ && second_->scans[static_cast<std::size_t>(station - 1)] ? 1 : 0;
  const OuterJawErrors* const of_slab = scanners == nullptr ? nullptr : &scanners->at(arm);
  const BlockGeometry& g = recipe_.block;
  const algo::ScannerModel scanner(recipe_.uncertainty);
  const double spec = errors.scanner * std::sqrt(3.0);  // half widths from standard uncertainties
  const double tilt = spec * scanner.tilt_rad();
  const double place = spec * scanner.place_mm();
  const double reference_rad = errors.reference * recipe_.uncertainty.reference_rad.value;
  const double reference_mm = errors.reference * recipe_.uncertainty.reference_mm.value;
  const double factor = errors.noise_factor;
  const PlaneNoise seat_noise{errors.seat_offset_mm, errors.seat_tilt_rad, factor};
  const PlaneNoise jaw_noise{errors.jaw_offset_mm, errors.jaw_tilt_rad, factor};
  const PlaneNoise top_noise{errors.top_offset_mm, errors.top_tilt_rad, factor};

  BlockResult r;
  r.station = static_cast<std::uint8_t>(station);
  algo::blank_block_items(recipe_, {}, r);

  // The block as built, in its own frame.
  const Vec3 s = model_.along_seat();
  const Quat seat_turn = turned(Vec3(built.slope_rad, built.cross_slope_rad, 0.0));
  const Vec3 n = seat_turn * model_.plane(algo::Face::seat).n;
  r.seat.plane = plane_fit(n, Vec3(0.2, -0.3, 0.0), seat_noise, errors);
  r.seat.full_plane = r.seat.plane;
  r.seat.noise_factor = factor;
  const auto jaw = [&](algo::Face face, double sign, double angle, double yaw) {
    const Vec3 jaw_n = turned(Vec3(sign * angle, 0.0, yaw)) * model_.plane(face).n;
    const double height = g.jaw_reference_height_mm.value;
    const Vec3 at_height =
        (sign * (g.jaw_half_distance_mm.value + 0.5 * built.jaw_distance_mm) + built.jaw_shift_mm) * s +
        height * model_.plane(algo::Face::seat).n;
    // Centroid slightly above the reference height, off the middle.
    Vec3 up = jaw_n.cross(Vec3::UnitX()).normalized();
    if (up.z() < 0.0) up = -up;
    return plane_fit(jaw_n, at_height + 6.0 * up + Vec3(2.0, 0.0, 0.0), jaw_noise, errors);
  };
  r.jaw_inner = jaw(algo::Face::jaw_inner, -1.0, built.jaw_angle_inner_rad, built.jaw_yaw_inner_rad);
  r.jaw_outer = jaw(algo::Face::jaw_outer, 1.0, built.jaw_angle_outer_rad, built.jaw_yaw_outer_rad);
  r.slab_top = plane_fit(turned(Vec3(built.top_tilt_x_rad, built.top_tilt_y_rad, 0.0)) * Vec3::UnitZ(),
                         Vec3(10.0, 20.0, g.slab_top_z_mm.value), top_noise, errors);

  // White noise first: it affects all following values.
  disturb(r.seat.plane, seat_noise, prng);
  disturb(r.jaw_inner, jaw_noise, prng);
  disturb(r.jaw_outer, jaw_noise, prng);
  disturb(r.slab_top, top_noise, prng);
  const auto casing = [&](double sign, double rim_off) {
    CasingFeature c;
    c.ok = true;
    const double root = std::sqrt(factor);
    const double along = sign * (g.casing_half_spacing_mm.value + 0.5 * built.casing_spacing_mm);
    // A circle's covariance is that of its own edge, including correlation of neighbours.
    const double dx = errors.circle_mm * prng.normal();
    const double ds = errors.circle_mm * prng.normal();
    c.centre = on(r.seat.plane, along * s + Vec3(dx, 0.0, 0.0) + ds * s);
    c.radius_mm = 0.5 * g.casing_bore_diameter_mm.value;
    c.edge_points = 48;
    c.rim_points = 5000;
    c.inlier_fraction = 1.0;
    c.sigma_height_mm = errors.rim_mm;
    c.cov_circle = Vec3::Constant(errors.circle_mm * errors.circle_mm).asDiagonal();
    // The fitted seat at the rim is off by its noise, the rim's points by theirs, and the scanner errs between the two.
    const double seat_off = n.dot(c.centre) - n.dot(Vec3(0.2, -0.3, 0.0));
    c.height_mm = g.casing_rim_height_mm.value + rim_off - seat_off + root * errors.rim_mm * prng.normal() +
                  rectangular(prng, spec * scanner.difference_mm((c.centre - r.seat.plane.centroid).norm()));
    return c;
  };
  r.casing_inner = casing(-1.0, built.rim_inner_mm);
  r.casing_outer = casing(1.0, built.rim_outer_mm);

  // Form: every feature tilts independently; seat and jaws shift; the casings shift together and relative to each
  // other.
  const Vec3 shift(rectangular(prng, place), rectangular(prng, place), rectangular(prng, place));
  const double apart = rectangular(prng, spec * scanner.difference_mm(2.0 * g.casing_half_spacing_mm.value));
  const double longer = rectangular(prng, spec * scanner.length_mm(2.0 * g.casing_half_spacing_mm.value));
  r.casing_outer.centre += shift + 0.5 * (apart + longer) * s;
  r.casing_inner.centre += shift - 0.5 * (apart + longer) * s;
  disturb(r.seat.plane, r.seat.plane.normal.dot(shift), 0.0, 0.0);
  disturb(r.jaw_inner, rectangular(prng, place), 0.0, 0.0);
  const double outer_mm = rectangular(prng, place);
  disturb(r.jaw_outer, of_slab == nullptr ? outer_mm : place * of_slab->place, 0.0, 0.0);
  const double length_mm = spec * scanner.length_mm(g.jaw_half_distance_mm.value);
  const double own_mm = rectangular(prng, length_mm);
  const double jaw_longer = of_slab == nullptr ? own_mm : length_mm * of_slab->length;
  disturb(r.jaw_inner, -jaw_longer * r.jaw_inner.normal.dot(s), 0.0, 0.0);
  disturb(r.jaw_outer, jaw_longer * r.jaw_outer.normal.dot(s), 0.0, 0.0);
  for (PlaneFit* plane : {&r.seat.plane, &r.jaw_inner, &r.jaw_outer, &r.slab_top}) {
    const double a = rectangular(prng, tilt);
    const double b = rectangular(prng, tilt);
    const bool is_of_slab = of_slab != nullptr && plane == &r.jaw_outer;
    disturb(*plane, 0.0, is_of_slab ? tilt * of_slab->tilt_a : a, is_of_slab ? tilt * of_slab->tilt_b : b);
  }

  // Reference: angles by the error of the seat's, lengths by a common scale.
  const double turn_a = reference_rad * prng.normal();
  const double turn_b = reference_rad * prng.normal();
  disturb(r.seat.plane, 0.0, turn_a, turn_b);
  const double scale = reference_mm / (2.0 * g.jaw_half_distance_mm.value) * prng.normal();
  for (PlaneFit* plane : {&r.jaw_inner, &r.jaw_outer})
    disturb(*plane, scale * plane->normal.dot(plane->centroid), 0, 0);
  for (CasingFeature* c : {&r.casing_inner, &r.casing_outer}) c->centre += scale * c->centre;

  // The registered frame is slightly off the block's: all features are relative to it.
  std::array<double, 6> m{};
  for (std::size_t i = 0; i < m.size(); ++i) m[i] = errors.registration[i] * std::sqrt(factor) * prng.normal();
  const Pose registered = moved(Vec3(m[0], m[1], m[2]), Vec3(m[3], m[4], m[5]));
  const Pose into = registered;  // T_registered_true
  for (PlaneFit* plane : {&r.seat.plane, &r.seat.full_plane, &r.jaw_inner, &r.jaw_outer, &r.slab_top}) {
    plane->normal = into.rotation * plane->normal;
    plane->centroid = into * plane->centroid;
    plane->offset_mm = plane->normal.dot(plane->centroid);
  }
  for (CasingFeature* c : {&r.casing_inner, &r.casing_outer}) c->centre = into * c->centre;
  r.registration.status = RegistrationStatus::converged;
  r.registration.covariance = Mat6::Zero();
  for (int i = 0; i < 6; ++i)
    r.registration.covariance(i, i) = std::pow(errors.registration[static_cast<std::size_t>(i)], 2);

  r.seat.grid_points = 6'800;
  r.seat.plane.std_mm = errors.noise_mm * (1.0 + std::sqrt(factor / (2.0 * errors.points)) * prng.normal());
  if (errors.flatness) {
    r.seat.flatness_mm = measured_flatness(recipe_, built, errors, prng, r.seat.grid_points);
    static const std::map<std::uint32_t, double> kRange{{6800U, mean_range(6800.0)}};
    const auto known = kRange.find(r.seat.grid_points);
    r.seat.flatness_noise_mm =
        errors.cell_mm * (known != kRange.end() ? known->second : mean_range(r.seat.grid_points));
  }

  // The splice: position of the scanner according to robot and calibration.
  const Pose T_slab = T_slab_block(recipe_, station);
  const double position = errors.station * std::hypot(sigma_.position_mm, sigma_.robot_position_mm);
  const double rotation = errors.station * std::hypot(sigma_.rotation_rad, sigma_.robot_rotation_rad);
  const Vec3 splice_mm = normal3(prng, std::hypot(position, reference_mm));
  const Vec3 splice_rad = normal3(prng, rotation);
  const Pose T_base_block = T_base_slab() * T_slab * moved(splice_mm, splice_rad) * built.displacement;

  algo::compute_block_items(model_, r);
  algo::compute_block_budget(recipe_, {}, {}, r);
  algo::compute_observation(model_, CasingKind::open, T_base_block * registered.inverse(), r);
  for (Item& item : r.items) item.verdict = slabd::judge(item, recipe_.guard);
  r.verdict = combine(r.items.begin(), r.items.end());
  r.reason = reason_for(r.verdict, r.items.begin(), r.items.end(), Code::ok);
  return r;
}

Measured Line::measure(const BuiltSlab& slab, const Errors& errors, Prng& prng) const {
  Measured m;
  Prng copy = prng;  // the other numbers stay as they are
  Prng of_scanner(static_cast<std::uint64_t>(1e15 * copy.uniform()));
  const ScannersAtJaw jaw = outer_jaw_errors(of_scanner);
  for (int station = 1; station <= recipe_.stations(); ++station)
    m.blocks.push_back(measure_block(station, slab.blocks[static_cast<std::size_t>(station - 1)], errors, prng, &jaw));
  if (second_) displace(tie_error(errors, prng), m.blocks);
  inspect(m.blocks, m.slab);
  return m;
}

Recipe recipe_with_uncertainty() {
  Recipe recipe = scene::p5600();
  UncertaintySettings& u = recipe.uncertainty;
  u.given = true;
  u.scanner_form_mm = {0.05, true};
  u.scanner_form_length_mm = {150.0, true};
  u.scanner_length_ppm = {50.0, true};
  u.reference_mm = {0.005, true};
  u.reference_rad = {rad_from_deg(0.001), true};
  return recipe;
}

std::vector<Coverage> coverage(const Line& line, const Errors& errors, int slabs, std::uint64_t seed,
                               int flatness_every) {
  struct Sample {
    std::vector<double> error;
    Coverage figures;
  };
  // Key: item, and true for the slab frame.
  std::map<std::pair<ItemId, bool>, Sample> samples;
  const auto compare = [&](const Item& measured, const Item& truth, bool slab_frame) {
    if (!has_value(measured.value) || !has_value(truth.value)) return;
    // A top that contradicts the seats' frame by chance increases U on purpose; another test covers that.
    if (slab_frame && measured.budget[static_cast<std::size_t>(BudgetPart::registration)] > 0.0) return;
    Sample& s = samples[{measured.id, slab_frame}];
    s.figures.id = measured.id;
    s.figures.slab_frame = slab_frame;
    const double difference = measured.value - truth.value;
    const double error = measured.id == ItemId::seat_flatness ? difference : std::abs(difference);
    s.error.push_back(error);
    ++s.figures.count;
    if (error <= measured.U) ++s.figures.covered;
    s.figures.mean_U += measured.U;
    s.figures.rms += difference * difference;
    for (std::size_t p = 0; p < kBudgetParts; ++p) s.figures.budget[p] += measured.budget[p] * measured.budget[p];
  };
  for (int k = 0; k < slabs; ++k) {
    Prng prng(seed + static_cast<std::uint64_t>(k));
    const BuiltSlab built = varied(line.recipe(), prng);
    Measured truth;
    Measured measured;
    Prng silent(1);
    Prng of_scanner(seed + static_cast<std::uint64_t>(k) + 1'000'000);
    const ScannersAtJaw jaw = outer_jaw_errors(of_scanner);
    for (int station = 1; station <= line.recipe().stations(); ++station) {
      const BuiltBlock& block = built.blocks[static_cast<std::size_t>(station - 1)];
      const bool flat = flatness_every > 0 && (k * line.recipe().stations() + station) % flatness_every == 0;
      Errors with = errors;
      Errors without = none();
      with.flatness = without.flatness = flat;
      without.noise_mm = with.noise_mm;
      without.points = with.points;
      measured.blocks.push_back(line.measure_block(station, block, with, prng, &jaw));
      truth.blocks.push_back(line.measure_block(station, block, without, silent));
      for (const Item& item : measured.blocks.back().items)
        compare(item, *find_item(truth.blocks.back().items.begin(), truth.blocks.back().items.end(), item.id), false);
    }
    line.displace(line.tie_error(errors, prng), measured.blocks);
    line.inspect(measured.blocks, measured.slab);
    line.inspect(truth.blocks, truth.slab);
    for (std::size_t i = 0; i < measured.slab.items.size(); ++i)
      compare(measured.slab.items[i], truth.slab.items[i], true);
  }
  std::vector<Coverage> result;
  for (auto& [key, s] : samples) {
    Coverage& c = s.figures;
    const auto n = static_cast<double>(c.count);
    c.mean_U /= n;
    c.rms = std::sqrt(c.rms / n);
    for (double& part : c.budget) part = std::sqrt(part / n);
    const auto at = s.error.begin() + static_cast<std::ptrdiff_t>(std::ceil(0.95 * n) - 1);
    std::nth_element(s.error.begin(), at, s.error.end());
    c.needed = *at;
    result.push_back(c);
  }
  return result;
}

}  // namespace slabd::simulation
