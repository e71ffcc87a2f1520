// SPDX-License-Identifier: Apache-2.0
//
// Applies every known mistaken reading of the poses to the views and compares how well they then agree. Only residuals
// of a complete solution decide. The two invariants of a pair of motions (equal angles, equal shifts along the axes)
// are reported too. They need no solution and locate a mistake, but an inverted target satisfies both, and transposed
// rotations the first.
#include "calib/conventions.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <numeric>
#include <utility>

#include "calib/adjustment.h"
#include "calib/hand_eye.h"
#include "calib/mathematics.h"

namespace slabd::calib {
namespace {

constexpr std::size_t kViewsToTell = 5;
constexpr double kStatedOffSigmas = 3.0;
constexpr double kTimesBetter = 5.0;
/// Readings with residuals up to this factor of the best one explain the views equally well.
constexpr double kAsWell = 1.5;
constexpr int kSubsets = 20;
constexpr std::size_t kRefined = 4;
constexpr double kTurnToTell_rad = rad_from_deg(5.0);
/// A view is explained if its residual is below this many sigmas.
constexpr double kExplainedSigmas = 3.0;
/// A slip is reported if it leaves at most this share of the views unexplained, and less than the stated reading by at
/// least kSlipGainMin.
constexpr double kSlipUnexplainedMax = 0.15;
constexpr double kSlipGainMin = 0.1;
/// With fewer redundant equations, one of many slips fits by chance.
constexpr int kSlipSpareMin = 9;

using Angles = std::array<double, 3>;

/// A way to interpret three angles (A, B, C) as a rotation.
struct AngleOrder {
  const char* name;
  std::array<int, 3> axes;  ///< axes of the three turns, each about the axes turned by the previous ones
  bool reversed;            ///< the angles are used as C, B, A
};
constexpr std::array kOrders = {
    AngleOrder{"Z-Y-X of (A, B, C)", {2, 1, 0}, false},
    AngleOrder{"X-Y-Z of (A, B, C)", {0, 1, 2}, false},
    AngleOrder{"Z-Y-X of (C, B, A), that is fixed axes X-Y-Z of (A, B, C)", {2, 1, 0}, true},
    AngleOrder{"X-Y-Z of (C, B, A), that is fixed axes Z-Y-X of (A, B, C)", {0, 1, 2}, true},
    AngleOrder{"Z-Y-Z of (A, B, C)", {2, 1, 2}, false},
    AngleOrder{"Z-X-Z of (A, B, C)", {2, 0, 2}, false},
    AngleOrder{"Z-X-Y of (A, B, C)", {2, 0, 1}, false},
    AngleOrder{"X-Z-Y of (A, B, C)", {0, 2, 1}, false},
    AngleOrder{"Y-X-Z of (A, B, C)", {1, 0, 2}, false},
    AngleOrder{"Y-Z-X of (A, B, C)", {1, 2, 0}, false},
};
constexpr const AngleOrder& kKuka = kOrders[0];

Quat turn(int axis, double angle_rad) {
  return Quat(Eigen::AngleAxisd(angle_rad, Eigen::Vector3d::Unit(axis)));
}

Quat rotation_of(const AngleOrder& order, Angles abc) {
  if (order.reversed) std::swap(abc[0], abc[2]);
  return turn(order.axes[0], abc[0]) * turn(order.axes[1], abc[1]) * turn(order.axes[2], abc[2]);
}

/// Angles as a controller displays them: the middle one in -90..90 deg, or 0..180 deg if first and last axis are equal.
Angles angles_of(const AngleOrder& order, const Quat& rotation) {
  const Mat3 R = rotation.toRotationMatrix();
  const auto [i, j, k] = order.axes;
  Angles abc{};
  if (i != k) {
    const double sign = (j - i + 3) % 3 == 1 ? 1.0 : -1.0;
    abc[1] = std::atan2(sign * R(i, k), std::hypot(R(i, i), R(i, j)));
    abc[0] = std::atan2(-sign * R(j, k), R(k, k));
    abc[2] = std::atan2(-sign * R(i, j), R(i, i));
  } else {
    const int l = 3 - i - j;
    const double sign = (j - i + 3) % 3 == 1 ? 1.0 : -1.0;
    abc[1] = std::atan2(std::hypot(R(i, j), R(i, l)), R(i, i));
    abc[0] = std::atan2(R(j, i), -sign * R(l, i));
    abc[2] = std::atan2(R(i, j), sign * R(i, l));
  }
  if (order.reversed) std::swap(abc[0], abc[2]);
  return abc;
}

enum class Side { flange, target };

Pose& pose_of(View& view, Side side) {
  return side == Side::flange ? view.T_base_flange : view.T_scanner_target;
}

/// A, B, C as reported, or as KUKA would report the rotation.
Angles reported(const View& view, Side side) {
  if (side == Side::flange && view.reported_abc_rad) return *view.reported_abc_rad;
  return angles_of(kKuka, side == Side::flange ? view.T_base_flange.rotation : view.T_scanner_target.rotation);
}

struct Reading {
  std::string name;
  std::string cure;
  ConventionError changes;
  std::function<void(View&)> apply;
  int shift = 0;  ///< number of lines by which the target table is moved
};

void scale(View& view, Side side, double factor) {
  if (side == Side::flange) {
    view.T_base_flange.translation_mm *= factor;
    return;
  }
  view.T_scanner_target.translation_mm *= factor;
  for (BallObservation& seen : view.balls) seen.centre_mm *= factor;
}

using Format = std::optional<PoseFormat>;

void add_rotation_readings(Side side, const Format& format, std::vector<Reading>& readings) {
  const std::string table = side == Side::flange ? "flange" : "target";
  const std::string frame = side == Side::flange ? "T_base_flange" : "T_scanner_target";
  const std::string inverse = side == Side::flange ? "T_flange_base" : "T_target_scanner";
  const bool quaternions = !format || format->rotation != RotationForm::kuka_abc;
  const auto declares = [&](RotationForm form) { return format && format->rotation == form; };
  const auto add = [&](const std::string& name, const std::string& cure, auto change) {
    readings.push_back({name, cure, ConventionError::convention, [=](View& view) { change(view); }, 0});
  };
  add("the " + table + " rotations are transposed", "write the active rotation, axes of the child as columns: " + frame,
      [=](View& v) { pose_of(v, side).rotation = pose_of(v, side).rotation.conjugate(); });
  const auto invert = [=](View& v) { pose_of(v, side) = pose_of(v, side).inverse(); };
  if (format && format->inverse)
    add("the " + table + " table holds " + frame + " and declares " + inverse,
        "declare its content: # format: frames=" + frame, invert);
  else
    add("the " + table + " poses are inverted, " + inverse + " instead of " + frame,
        "write " + frame + ", or declare the content of the table: # format: frames=" + inverse, invert);
  if (quaternions && !declares(RotationForm::quaternion_xyzw))
    add("the " + table + " quaternions are written x y z w",
        "write qw first, or declare it: # format: rotation=quaternion_xyzw", [=](View& v) {
          const Quat q = pose_of(v, side).rotation;
          pose_of(v, side).rotation = Quat(q.z(), q.w(), q.x(), q.y());
        });
  if (quaternions && !declares(RotationForm::quaternion_wxyz))
    add("the " + table + " quaternions are written w x y z, not x y z w",
        "declare it: # format: rotation=quaternion_wxyz", [=](View& v) {
          const Quat q = pose_of(v, side).rotation;
          pose_of(v, side).rotation = Quat(q.x(), q.y(), q.z(), q.w());
        });
  const std::string convert =
      "convert the angles of the controller in the order it documents; slabd reads KUKA's A, B, C "
      "as R = Rz(A) Ry(B) Rx(C)";
  for (const AngleOrder& order : kOrders) {
    if (&order == &kKuka) continue;
    add("the " + table + " angles that were reported are " + order.name + ", not Z-Y-X (KUKA)", convert,
        [=, &order](View& v) { pose_of(v, side).rotation = rotation_of(order, reported(v, side)); });
    add("the " + table + " rotations were computed as " + order.name + ", and the angles are KUKA's, Z-Y-X", convert,
        [=, &order](View& v) {
          pose_of(v, side).rotation = rotation_of(kKuka, angles_of(order, pose_of(v, side).rotation));
        });
  }
  add("the " + table + " angles that were reported are a rotation vector", convert, [=](View& v) {
    // A rotation has two sets of angles; controllers do not display a rotation vector longer than 180 degrees.
    Angles abc = reported(v, side);
    if (std::hypot(abc[0], abc[1], abc[2]) > kPi)
      abc = {abc[0] - std::copysign(kPi, abc[0]), std::copysign(kPi, abc[1]) - abc[1],
             abc[2] - std::copysign(kPi, abc[2])};
    pose_of(v, side).rotation = exp_rotation(Vec3(abc[0], abc[1], abc[2]));
  });
  const auto times = [=](double factor) {
    return [=](View& v) {
      Angles abc = reported(v, side);
      for (double& angle : abc) angle *= factor;
      pose_of(v, side).rotation = rotation_of(kKuka, abc);
    };
  };
  const bool angles = declares(RotationForm::kuka_abc);
  const auto unit_cure = [&](const char* unit) {
    return angles || !format ? std::string("declare it: # format: rotation=kuka_abc angle=") + unit
                             : std::string("convert the angles of the controller again, as ") +
                                   (unit[0] == 'd' ? "degrees" : "radians");
  };
  if (!angles || !format->radians)
    add("the " + table + " angles are radians that were read as degrees", unit_cure("rad"), times(180.0 / kPi));
  if (!angles || format->radians)
    add("the " + table + " angles are degrees that were read as radians", unit_cure("deg"), times(kPi / 180.0));
}

/// Adds the reading that the scanner's frame is left-handed. Mirrored x, y and z differ only by a half turn, which the
/// hand-eye transform absorbs, so one of them represents all. A pose fitted to a mirrored cloud is again a rotation,
/// that of the artefact's mirror image. It is M R F with F a reflection in the target's own frame. The target's unknown
/// rotation absorbs F except for its sign.
void add_mirror_reading(std::span<const View> views, std::vector<Reading>& readings) {
  std::size_t behind = 0;
  std::size_t sightings = 0;
  for (const View& view : views) {
    if (view.balls.empty()) {
      ++sightings;
      behind += view.T_scanner_target.translation_mm.z() < 0.0 ? 1U : 0U;
    }
    for (const BallObservation& seen : view.balls) {
      ++sightings;
      behind += seen.centre_mm.z() < 0.0 ? 1U : 0U;
    }
  }
  const int axis = 2 * behind > sightings ? 2 : 0;
  readings.push_back(
      {std::string("the scanner's ") + (axis == 2 ? "z" : "x") + " axis is mirrored: its frame is left-handed",
       axis == 2 ? "have the scanner's software export a right-handed frame with +Z towards the part"
                 : "have the scanner's software export a right-handed frame; x or y is mirrored (the "
                   "two differ by half a turn about z and cannot be distinguished here)",
       ConventionError::handedness,
       [axis](View& v) {
         v.T_scanner_target.translation_mm[axis] *= -1.0;
         const Quat half_turn(Eigen::AngleAxisd(kPi, Eigen::Vector3d::Unit(axis)));
         v.T_scanner_target.rotation = (half_turn * v.T_scanner_target.rotation).normalized();
         for (BallObservation& seen : v.balls) seen.centre_mm[axis] *= -1.0;
       },
       0});
}

std::vector<Reading> readings_for(ArtefactKind kind, std::span<const View> views, const DeclaredFormats& declared) {
  std::vector<Reading> readings;
  readings.push_back({"the poses are as stated", "", ConventionError::none, [](View&) {}, 0});
  const auto metres = [&](Side side, const std::string& table, const Format& format) {
    if (format && format->metres)
      readings.push_back({"the " + table + " positions are in millimetres, and the table declares unit=m",
                          "declare what it holds: # format: unit=mm", ConventionError::units,
                          [=](View& view) { scale(view, side, 1.0 / kMmPerM); }, 0});
    else
      readings.push_back({"the " + table + " positions are in metres",
                          "write millimetres, or declare it in the " + table + " table: # format: unit=m",
                          ConventionError::units, [=](View& view) { scale(view, side, kMmPerM); }, 0});
  };
  metres(Side::flange, "flange", declared.flange);
  metres(Side::target, "target", declared.target);
  add_mirror_reading(views, readings);
  add_rotation_readings(Side::flange, declared.flange, readings);
  if (kind == ArtefactKind::pose) {
    add_rotation_readings(Side::target, declared.target, readings);
    readings.push_back({"the flange rotations are transposed and the target poses inverted",
                        "write the active T_base_flange, axes of the flange as columns, and T_scanner_target",
                        ConventionError::convention,
                        [](View& v) {
                          v.T_base_flange.rotation = v.T_base_flange.rotation.conjugate();
                          v.T_scanner_target = v.T_scanner_target.inverse();
                        },
                        0});
  }
  for (const int shift : {1, -1})
    readings.push_back(
        {shift > 0 ? "every target belongs to the flange pose one line above"
                   : "every target belongs to the flange pose one line below",
         "pair every target with the pose it was scanned from; a line is missing or too many in one table",
         ConventionError::pairing, [](View&) {}, shift});
  return readings;
}

/// Combines the flange pose of view `pose` with the sighting of view `target`.
View paired(std::span<const View> views, std::size_t pose, std::size_t target) {
  View view = views[target];
  view.number = views[pose].number;
  view.T_base_flange = views[pose].T_base_flange;
  view.reported_abc_rad = views[pose].reported_abc_rad;
  return view;
}

std::vector<View> read_as(const Reading& reading, std::span<const View> views) {
  std::vector<View> read(views.begin(), views.end());
  for (View& view : read) reading.apply(view);
  if (reading.shift == 0) return read;
  std::vector<View> shifted;
  for (std::size_t i = 0; i < views.size(); ++i) {
    const std::ptrdiff_t from = static_cast<std::ptrdiff_t>(i) + reading.shift;
    if (from < 0 || from >= static_cast<std::ptrdiff_t>(views.size())) continue;
    shifted.push_back(paired(read, i, static_cast<std::size_t>(from)));
  }
  return shifted;
}

double median(std::span<const double> values) {
  return spread_of(values).median;
}

/// Compares the motions between two views on both sides of X: angle, and shift along the axis.
void compare_motions(std::span<const View> views, Hypothesis& hypothesis) {
  std::vector<double> angles;
  std::vector<double> pitches;
  for (std::size_t i = 0; i < views.size(); ++i)
    for (std::size_t j = i + 1; j < views.size(); ++j) {
      const Pose A = views[j].T_base_flange.inverse() * views[i].T_base_flange;
      const Pose B = views[j].T_scanner_target * views[i].T_scanner_target.inverse();
      const Vec3 a = log_rotation(A.rotation);
      const Vec3 b = log_rotation(B.rotation);
      angles.push_back(deg_from_rad(std::abs(a.norm() - b.norm())));
      if (std::min(a.norm(), b.norm()) < kTurnToTell_rad) continue;
      pitches.push_back(std::abs(A.translation_mm.dot(a.normalized()) - B.translation_mm.dot(b.normalized())));
    }
  hypothesis.angle_mismatch_deg = median(std::move(angles));
  hypothesis.pitch_mismatch_mm = median(std::move(pitches));
}

struct Tried {
  Hypothesis hypothesis;
  std::vector<View> views;
  State state;
};

void measure(ArtefactKind kind, const StatedNoise& noise, Tried& tried) {
  const Equations equations(kind, tried.views);
  tried.hypothesis.sigmas = robust_size(equations, {noise}, tried.state);
  std::vector<double> mm;
  std::vector<double> deg;
  for (const ViewFit& fit : residuals_of(kind, tried.views, tried.state.X, tried.state.targets, noise)) {
    mm.push_back(fit.residual_mm);
    deg.push_back(fit.residual_deg);
  }
  tried.hypothesis.residual_mm = median(std::move(mm));
  tried.hypothesis.residual_deg = median(std::move(deg));
}

void refine(ArtefactKind kind, const StatedNoise& noise, Tried& tried) {
  const Equations equations(kind, tried.views);
  std::vector<std::size_t> all(equations.size());
  std::iota(all.begin(), all.end(), std::size_t{0});
  Tried refined = tried;
  refined.state = adjust_and_weigh(equations, all, {noise}, tried.state, true).state;
  measure(kind, noise, refined);
  if (refined.hypothesis.sigmas < tried.hypothesis.sigmas) tried = std::move(refined);
}

/// Share of the views with a residual beyond kExplainedSigmas.
double unexplained(ArtefactKind kind, const StatedNoise& noise, std::span<const View> views, const State& state) {
  std::size_t count = 0;
  for (const ViewFit& fit : residuals_of(kind, views, state.X, state.targets, noise))
    count += fit.sigmas <= kExplainedSigmas ? 0U : 1U;
  return static_cast<double>(count) / static_cast<double>(views.size());
}

/// From view `from` on, the two tables are shifted by one line.
struct Slip {
  std::size_t from = 0;
  int shift = 0;  ///< 1: view `from`'s target has no flange pose; -1: view `from`'s flange pose has no target
};

std::vector<View> slipped(std::span<const View> views, const Slip& slip) {
  std::vector<View> read(views.begin(), views.begin() + static_cast<std::ptrdiff_t>(slip.from));
  for (std::size_t i = slip.from; i < views.size(); ++i) {
    if (slip.shift < 0 && i > slip.from) read.push_back(paired(views, i, i - 1));
    if (slip.shift > 0 && i + 1 < views.size()) read.push_back(paired(views, i, i + 1));
  }
  return read;
}

Tried tried_slip(const Slip& slip, std::span<const View> views) {
  const std::size_t number = views[slip.from].number != 0 ? views[slip.from].number : slip.from + 1;
  const std::string row = std::to_string(number);
  Tried tried;
  tried.hypothesis.changes = ConventionError::pairing;
  if (slip.shift < 0) {
    tried.hypothesis.name = "from line " + row +
                            " on every target belongs to the flange pose one line below: flange pose " + row +
                            " has no target";
    tried.hypothesis.cure = "the picture of flange pose " + row + " failed or its target is missing: take pose " + row +
                            " out of the flange table, and pair every target with the pose it was scanned from";
  } else {
    tried.hypothesis.name = "from line " + row + " on every target belongs to the flange pose one line above: target " +
                            row + " has no flange pose";
    tried.hypothesis.cure = "take target " + row +
                            " out of the target table or give its flange pose, and pair every target with the pose it "
                            "was scanned from";
  }
  tried.views = slipped(views, slip);
  return tried;
}

int spare_equations(ArtefactKind kind, std::span<const View> views) {
  const Equations equations(kind, views);
  int spare = -equations.parameters();
  for (std::size_t i = 0; i < equations.size(); ++i) spare += equations.rows(i);
  return spare;
}

/// The slip that explains the views best, if it explains nearly all of them and clearly more than the stated reading.
/// Wherever the slip begins, one half of the views is consistent, as stated or shifted by one line. That half
/// determines the scanner's pose, and all possible beginnings are tested with it.
std::optional<Tried> best_slip(ArtefactKind kind, std::span<const View> views, const StatedNoise& noise,
                               const State& as_stated) {
  const std::size_t n = views.size();
  if (n < kViewsToTell + 1 || spare_equations(kind, views) < kSlipSpareMin) return std::nullopt;
  const double stated = unexplained(kind, noise, views, as_stated);
  if (stated < kSlipGainMin) return std::nullopt;
  const auto solved = [&](std::span<const View> some) -> std::optional<State> {
    const Equations equations(kind, some);
    if (some.size() < 3) return std::nullopt;
    std::vector<std::size_t> chosen(equations.size());
    std::iota(chosen.begin(), chosen.end(), std::size_t{0});
    return adjust_and_weigh(equations, chosen, {noise}, starting_points(equations, {noise}, kSubsets).front(), true)
        .state;
  };
  std::optional<Slip> best;
  double least = 1.0;
  const auto hold = [&](const State& state, const Slip& slip) {
    const std::vector<View> read = slipped(views, slip);
    const double left = unexplained(kind, noise, read, state);
    if (left < least) {
      least = left;
      best = slip;
    }
  };
  const std::size_t half = n / 2;
  if (const std::optional<State> first = solved(views.first((n + 1) / 2)))
    for (std::size_t from = half; from + 1 < n; ++from)
      for (const int shift : {-1, 1}) hold(*first, {from, shift});
  for (const int shift : {-1, 1}) {
    const std::vector<View> last = slipped(views.subspan(shift < 0 ? half - 1 : half), {0, shift});
    const std::optional<State> second = solved(last);
    if (!second) continue;
    for (std::size_t from = 1; from < half; ++from) hold(*second, {from, shift});
  }
  if (!best) return std::nullopt;
  Tried tried = tried_slip(*best, views);
  const Equations equations(kind, tried.views);
  tried.state = starting_points(equations, {noise}, kSubsets).front();
  measure(kind, noise, tried);
  refine(kind, noise, tried);
  const double left = unexplained(kind, noise, tried.views, tried.state);
  if (left > kSlipUnexplainedMax || left > stated - kSlipGainMin || !(tried.hypothesis.sigmas <= kReadingFitsSigmas))
    return std::nullopt;
  if (kind == ArtefactKind::pose) compare_motions(tried.views, tried.hypothesis);
  return tried;
}

/// Place of the target in a view: of the pose, or of the first ball.
const Vec3& place_of(ArtefactKind kind, const View& view) {
  return kind == ArtefactKind::pose ? view.T_scanner_target.translation_mm : view.balls.front().centre_mm;
}

}  // namespace

SameTarget same_target(ArtefactKind kind, std::span<const View> views, const StatedNoise& noise) {
  constexpr double kSameBall_mm = 1e-6;
  constexpr double kSameSigmas = 5.0;
  constexpr double kApartSigmas = 10.0;
  const bool pose = kind == ArtefactKind::pose;
  const double same_mm = pose ? std::max(kSameBall_mm, kSameSigmas * noise.target_mm) : kSameBall_mm;
  const double same_rad = std::max(1e-9, kSameSigmas * noise.target_rad);
  const double apart_mm = kApartSigmas * std::hypot(noise.robot_mm, noise.target_mm);
  const double apart_rad = kApartSigmas * std::hypot(noise.robot_rad, noise.target_rad);
  const auto same = [&](const View& a, const View& b) {
    if (pose)
      return (place_of(kind, a) - place_of(kind, b)).norm() <= same_mm &&
             angle_between_rad(a.T_scanner_target.rotation, b.T_scanner_target.rotation) <= same_rad;
    if (a.balls.size() != b.balls.size()) return false;
    for (std::size_t k = 0; k < a.balls.size(); ++k)
      if (a.balls[k].ball != b.balls[k].ball || (a.balls[k].centre_mm - b.balls[k].centre_mm).norm() > same_mm)
        return false;
    return true;
  };
  const auto moved = [&](const View& a, const View& b) {
    const double shift_mm = (a.T_base_flange.translation_mm - b.T_base_flange.translation_mm).norm();
    const double turn_rad = angle_between_rad(a.T_base_flange.rotation, b.T_base_flange.rotation);
    return !same_place(a.T_base_flange, b.T_base_flange) && (shift_mm > apart_mm || turn_rad > apart_rad);
  };
  SameTarget largest;
  for (std::size_t i = 0; i < views.size(); ++i) {
    SameTarget group;
    group.views.push_back(i);
    for (std::size_t j = i + 1; j < views.size(); ++j) {
      if (!same(views[i], views[j])) continue;
      const bool other_place =
          std::all_of(group.views.begin(), group.views.end(), [&](std::size_t k) { return moved(views[k], views[j]); });
      if (other_place) group.views.push_back(j);
    }
    if (group.views.size() > largest.views.size()) largest = std::move(group);
  }
  for (const std::size_t i : largest.views)
    for (const std::size_t j : largest.views) {
      const Pose& a = views[i].T_base_flange;
      const Pose& b = views[j].T_base_flange;
      largest.moved_mm = std::max(largest.moved_mm, (a.translation_mm - b.translation_mm).norm());
      largest.turned_rad = std::max(largest.turned_rad, angle_between_rad(a.rotation, b.rotation));
    }
  return largest;
}

ConventionReport test_conventions(ArtefactKind kind, std::span<const View> views, const StatedNoise& noise,
                                  const DeclaredFormats& declared) {
  ConventionReport report;
  if (views.size() < kViewsToTell) return report;
  std::vector<Tried> all;
  for (const Reading& reading : readings_for(kind, views, declared)) {
    Tried tried;
    tried.hypothesis.name = reading.name;
    tried.hypothesis.cure = reading.cure;
    tried.hypothesis.changes = reading.changes;
    tried.views = read_as(reading, views);
    if (tried.views.size() < kViewsToTell) continue;
    const Equations equations(kind, tried.views);
    tried.state = starting_points(equations, {noise}, kSubsets).front();
    measure(kind, noise, tried);
    if (kind == ArtefactKind::pose) compare_motions(tried.views, tried.hypothesis);
    all.push_back(std::move(tried));
  }
  const auto better = [](const Tried& a, const Tried& b) { return a.hypothesis.sigmas < b.hypothesis.sigmas; };
  std::stable_sort(all.begin() + 1, all.end(), better);
  refine(kind, noise, all[0]);
  const std::size_t refined = std::min(all.size(), kRefined + 1);
  for (std::size_t k = 1; k < refined; ++k) refine(kind, noise, all[k]);
  std::stable_sort(all.begin() + 1, all.end(), better);

  const double stated = all[0].hypothesis.sigmas;
  const double best = all[1].hypothesis.sigmas;
  if (stated > kStatedOffSigmas) {
    report.stated_fits = false;
    if (best * kTimesBetter < stated && best <= kReadingFitsSigmas) {
      // An inverted target and an inverted flange differ only in the scanner's place; the one closer to its flange is
      // chosen.
      report.fits = 1;
      for (std::size_t k = 2; k < all.size() && all[k].hypothesis.sigmas < kAsWell * best; ++k)
        if (all[k].state.X.translation_mm.norm() < 0.99 * all[report.fits].state.X.translation_mm.norm())
          report.fits = k;
    }
  }
  // If most lines follow the slip, moving the whole table by one line fits almost as well.
  const bool moved = report.fits != 0 && all[report.fits].hypothesis.changes == ConventionError::pairing;
  if (report.fits == 0 || moved) {
    std::optional<Tried> slip = best_slip(kind, views, noise, all[0].state);
    const auto left = [&](const Tried& tried) { return unexplained(kind, noise, tried.views, tried.state); };
    if (slip && (!moved || left(*slip) < left(all[report.fits]))) {
      report.stated_fits = false;
      report.fits = 1;
      all.insert(all.begin() + 1, std::move(*slip));
    }
  }
  for (Tried& tried : all) report.tried.push_back(std::move(tried.hypothesis));
  return report;
}

}  // namespace slabd::calib
