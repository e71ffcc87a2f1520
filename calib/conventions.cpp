// SPDX-License-Identifier: Apache-2.0
//
// Every reading of the poses that people have been seen to produce by mistake is applied to the views, and the views
// are asked how well they then agree. Only residuals of a complete solution decide. The two invariants of a pair of
// motions (equal angles, equal shifts along the axes) are told beside them: they need no solution and show where a
// mistake is, but a target that is inverted passes both, and transposed rotations pass the first.
#include "calib/conventions.h"

#include <algorithm>
#include <cmath>
#include <functional>
#include <numeric>
#include <utility>

#include "calib/adjustment.h"
#include "calib/hand_eye.h"
#include "calib/rotation.h"

namespace slabd::calib {
namespace {

constexpr std::size_t kViewsToTell = 5;
constexpr double kStatedOffSigmas = 3.0;
constexpr double kTimesBetter = 5.0;
/// Readings this near to the best one explain the views as well.
constexpr double kAsWell = 1.5;
constexpr int kSubsets = 20;
constexpr std::size_t kRefined = 4;
constexpr double kTurnToTellRad = rad_from_deg(5.0);

using Angles = std::array<double, 3>;

/// A way to read three angles (A, B, C) as a rotation.
struct AngleOrder {
  const char* name;
  std::array<int, 3> axes;  ///< of the three turns, each about the axes that the ones before have turned
  bool reversed;            ///< the angles are taken as C, B, A
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

/// The angles a controller would show: the middle one in -90..90 deg, or 0..180 deg where first and last axis are one.
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

/// A, B, C as reported, or as KUKA would have reported the rotation.
Angles reported(const View& view, Side side) {
  if (side == Side::flange && view.reported_abc_rad) return *view.reported_abc_rad;
  return angles_of(kKuka, side == Side::flange ? view.T_base_flange.rotation : view.T_scanner_target.rotation);
}

struct Reading {
  std::string name;
  std::string cure;
  Misreading changes;
  std::function<void(View&)> apply;
  int shift = 0;  ///< lines that the target table is moved by
};

void scale(View& view, Side side, double factor) {
  if (side == Side::flange) {
    view.T_base_flange.translation_mm *= factor;
    return;
  }
  view.T_scanner_target.translation_mm *= factor;
  for (BallSighting& seen : view.balls) seen.centre_mm *= factor;
}

void add_rotation_readings(Side side, std::vector<Reading>& readings) {
  const std::string table = side == Side::flange ? "flange" : "target";
  const std::string frame = side == Side::flange ? "T_base_flange" : "T_scanner_target";
  const std::string inverse = side == Side::flange ? "T_flange_base" : "T_target_scanner";
  const auto add = [&](const std::string& name, const std::string& cure, auto change) {
    readings.push_back({name, cure, Misreading::convention, [=](View& view) { change(view); }, 0});
  };
  add("the " + table + " rotations are transposed", "write the active rotation, axes of the child as columns: " + frame,
      [=](View& v) { pose_of(v, side).rotation = pose_of(v, side).rotation.conjugate(); });
  add("the " + table + " poses are inverted, " + inverse + " instead of " + frame,
      "write " + frame + ", or say what the table holds: # format: frames=" + inverse,
      [=](View& v) { pose_of(v, side) = pose_of(v, side).inverse(); });
  add("the " + table + " quaternions are written x y z w",
      "write qw first, or say so: # format: rotation=quaternion_xyzw", [=](View& v) {
        const Quat q = pose_of(v, side).rotation;
        pose_of(v, side).rotation = Quat(q.z(), q.w(), q.x(), q.y());
      });
  add("the " + table + " quaternions are written w x y z, not x y z w", "say so: # format: rotation=quaternion_wxyz",
      [=](View& v) {
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
    // A rotation has two sets of angles; a rotation vector longer than half a turn is not what a controller shows.
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
  add("the " + table + " angles are radians that were read as degrees", "say so: # format: rotation=kuka_abc angle=rad",
      times(180.0 / kPi));
  add("the " + table + " angles are degrees that were read as radians", "say so: # format: rotation=kuka_abc angle=deg",
      times(kPi / 180.0));
}

std::vector<Reading> readings_for(ArtefactKind kind) {
  std::vector<Reading> readings;
  readings.push_back({"the poses are as stated", "", Misreading::none, [](View&) {}, 0});
  const auto metres = [&](Side side, const char* table) {
    readings.push_back({std::string("the ") + table + " positions are in metres",
                        std::string("write millimetres, or say so in the ") + table + " table: # format: unit=m",
                        Misreading::units, [=](View& view) { scale(view, side, kMmPerM); }, 0});
  };
  metres(Side::flange, "flange");
  metres(Side::target, "target");
  add_rotation_readings(Side::flange, readings);
  if (kind == ArtefactKind::pose) {
    add_rotation_readings(Side::target, readings);
    readings.push_back({"the flange rotations are transposed and the target poses inverted",
                        "write the active T_base_flange, axes of the flange as columns, and T_scanner_target",
                        Misreading::convention,
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
         Misreading::convention, [](View&) {}, shift});
  return readings;
}

std::vector<View> read_as(const Reading& reading, std::span<const View> views) {
  std::vector<View> read(views.begin(), views.end());
  for (View& view : read) reading.apply(view);
  if (reading.shift == 0) return read;
  std::vector<View> shifted;
  for (std::size_t i = 0; i < views.size(); ++i) {
    const std::ptrdiff_t from = static_cast<std::ptrdiff_t>(i) + reading.shift;
    if (from < 0 || from >= static_cast<std::ptrdiff_t>(views.size())) continue;
    View view = read[static_cast<std::size_t>(from)];
    view.T_base_flange = read[i].T_base_flange;
    shifted.push_back(std::move(view));
  }
  return shifted;
}

double median(std::span<const double> values) {
  return spread_of(values).median;
}

/// Angle, and shift along the axis, of motions between two views on either side of X.
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
      if (std::min(a.norm(), b.norm()) < kTurnToTellRad) continue;
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

}  // namespace

ConventionReport test_conventions(ArtefactKind kind, std::span<const View> views, const StatedNoise& noise) {
  ConventionReport report;
  if (views.size() < kViewsToTell) return report;
  std::vector<Tried> all;
  for (const Reading& reading : readings_for(kind)) {
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
    if (best * kTimesBetter < stated) {
      // An inverted target is told from an inverted flange by nothing but where the scanner would sit: near its flange.
      report.fits = 1;
      for (std::size_t k = 2; k < all.size() && all[k].hypothesis.sigmas < kAsWell * best; ++k)
        if (all[k].state.X.translation_mm.norm() < 0.99 * all[report.fits].state.X.translation_mm.norm())
          report.fits = k;
    }
  }
  for (Tried& tried : all) report.tried.push_back(std::move(tried.hypothesis));
  return report;
}

}  // namespace slabd::calib
