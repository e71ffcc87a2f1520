// SPDX-License-Identifier: Apache-2.0
#include "emulator/concrete_optics.h"

#include <algorithm>
#include <cmath>

#include "emulator/slab_scene.h"

namespace slabd::emulator {
namespace {

constexpr double kBase_mm = 260.0;
constexpr double kUnevenShare = 0.002;
constexpr double kInter_mm = 0.10;
constexpr double kInterLength_mm = 2.0;
/// A sharp corner is this share of its fillet's radius away from the fillet (two faces at 110 degrees).
constexpr double kCornerToFillet = 0.22;
constexpr double kPlugDiameter_mm = 29.0;
constexpr double kThreadPitch_mm = 3.0;
constexpr double kThread_mm = 0.4;
constexpr double kThreadShare = 0.6;

double unit(std::uint64_t bits) {
  return static_cast<double>(bits & 0xFFFFU) / 65536.0;
}

}  // namespace

ConcreteOptics::ConcreteOptics(const ConcreteOrder& order, const Pose& T_scanner_block, const ConcreteScanner& scanner)
    : effects_(order.effects),
      scanner_(scanner),
      T_scanner_block_(T_scanner_block),
      T_block_scanner_(T_scanner_block.inverse()) {
  Prng random(derived_seed(scanner.seed, 600, 0));
  // The cameras are on both sides of the projector, along the rail or across it.
  const bool across = random.uniform() < 0.5;
  const double projector_aside = 40.0 * (2.0 * random.uniform() - 1.0);
  const Vec3 base = across ? Vec3(0.0, 0.5 * kBase_mm, 0.0) : Vec3(0.5 * kBase_mm, 0.0, 0.0);
  const Vec3 projector = across ? Vec3(projector_aside, 0.0, 0.0) : Vec3(0.0, projector_aside, 0.0);
  eyes_block_ = {T_block_scanner_ * projector, T_block_scanner_ * base, T_block_scanner_ * Vec3(-base)};
  if (effects_[Effect::grid_left] > 0.0) origin_ = -base;
  origin_block_ = T_block_scanner_ * origin_;
  const double uneven = kUnevenShare * effects_[Effect::lens];
  for (double& term : bend_) term = uneven * (2.0 * random.uniform() - 1.0);
}

Vec3 ConcreteOptics::ray(std::size_t column, std::size_t row) const {
  const double u = 2.0 * (static_cast<double>(column) + 0.5) / static_cast<double>(scanner_.columns) - 1.0;
  const double v = 2.0 * (static_cast<double>(row) + 0.5) / static_cast<double>(scanner_.rows) - 1.0;
  const double r2 = u * u + v * v;
  const double x = 0.5 * scanner_.field_x_mm * (u + bend_[0] * u * r2 + bend_[1] * u * v);
  const double y = 0.5 * scanner_.field_y_mm * (v + bend_[2] * v * r2 + bend_[3] * u * v);
  return Vec3((x - origin_.x()) / kPictureDistance_mm, (y - origin_.y()) / kPictureDistance_mm, 1.0);
}

bool ConcreteOptics::in_view(const ConcreteBlock& block, const Vec3& p_block) const {
  const Vec3 p = T_scanner_block_ * p_block - origin_;
  const double x = p.x() / p.z() * kPictureDistance_mm + origin_.x();
  const double y = p.y() / p.z() * kPictureDistance_mm + origin_.y();
  return std::abs(x) < 0.5 * scanner_.field_x_mm && std::abs(y) < 0.5 * scanner_.field_y_mm &&
         block.field().sees(origin_block_, p_block) && cameras_see(block, p_block);
}

bool ConcreteOptics::cameras_see(const ConcreteBlock& block, const Vec3& p_block) const {
  if (effects_[Effect::shadow] == 0.0) return true;
  return std::all_of(eyes_block_.begin(), eyes_block_.end(),
                     [&](const Vec3& eye) { return block.field().sees(eye, p_block); });
}

Seen ConcreteOptics::look(const ConcreteBlock& block, std::size_t column, std::size_t row, std::uint64_t random) const {
  const Vec3 along = T_block_scanner_.rotation * ray(column, row);
  const HeightField& field = block.field();
  Seen seen;
  const double t = field.first_met(origin_block_, along);
  seen.t = static_cast<float>(t);
  if (std::isnan(t)) return seen;
  const Vec3 p = origin_block_ + t * along;
  const std::size_t node = field.nearest(p.x(), p.y());
  seen.face = block.face(node);
  seen.gloss = block.gloss(node);
  if (seen.face == ConcreteFace::beyond) {
    seen.t = std::numeric_limits<float>::quiet_NaN();
    return seen;
  }
  const HeightField::Slope slope = field.slope(p.x(), p.y());
  const Vec3 normal(-slope.per_x, -slope.per_y, 1.0);
  seen.cosine = static_cast<float>(std::max(0.0, -normal.dot(along)) / (normal.norm() * along.norm()));
  if (seen.face == ConcreteFace::rim_inner || seen.face == ConcreteFace::rim_outer) {
    const Bore& bore = block.bores()[seen.face == ConcreteFace::rim_outer ? 1 : 0];
    look_into(block, bore, along, random, seen);
    if (seen.bore != 0) {
      meet_clutter(block, along, seen);
      return seen;
    }
  }
  if (effects_[Effect::inter] != 0.0 && (seen.face == ConcreteFace::seat || seen.face == ConcreteFace::jaw_inner ||
                                         seen.face == ConcreteFace::jaw_outer || seen.face == ConcreteFace::edge)) {
    const std::size_t side = p.y() > 0.0 ? 1 : 0;
    const Vec3& corner = block.jaw_corners()[side];
    const double off = std::hypot(p.y() - corner.y(), p.z() - corner.z());
    const double from_fillet = std::max(0.0, off - kCornerToFillet * block.truth().fillet_mm[side + 1]);
    if (from_fillet < 8.0 * kInterLength_mm)
      seen.nearer = static_cast<float>(kInter_mm * effects_[Effect::inter] * std::exp(-from_fillet / kInterLength_mm));
  }
  if (!cameras_see(block, p)) seen.t = std::numeric_limits<float>::quiet_NaN();
  meet_clutter(block, along, seen);
  return seen;
}

void ConcreteOptics::look_into(const ConcreteBlock& block, const Bore& bore, const Vec3& along, std::uint64_t random,
                               Seen& seen) const {
  const Vec3 from = origin_block_ - bore.centre;
  const double down = -along.dot(bore.axis);
  const double height = from.dot(bore.axis);
  const auto radius_at = [&](double t) {
    const Vec3 q = from + t * along;
    return (q - q.dot(bore.axis) * bore.axis).norm();
  };
  // The edge of the bore is at the bottom of its chamfer.
  if (radius_at((height + bore.chamfer_mm) / down) >= bore.radius_mm) return;
  seen.bore = static_cast<std::uint8_t>(static_cast<int>(bore.content) + 1);
  seen.t = std::numeric_limits<float>::quiet_NaN();
  // Projector and cameras must see the point through the mouth of the bore.
  const auto is_lit = [&](const Vec3& q) {
    if (effects_[Effect::shadow] == 0.0) return true;
    return std::all_of(eyes_block_.begin(), eyes_block_.end(), [&](const Vec3& eye) {
      const Vec3 to = eye - bore.centre - q;
      const Vec3 mouth = q - q.dot(bore.axis) / to.dot(bore.axis) * to;
      return mouth.norm() < bore.radius_mm;
    });
  };
  if (bore.content != Bore::Content::empty) {
    const double floor_t = (height + bore.level_mm) / down;
    const double reach = bore.content == Bore::Content::plug ? 0.5 * kPlugDiameter_mm : bore.radius_mm;
    const Vec3 q = from + floor_t * along;
    const bool returns = bore.content != Bore::Content::water || unit(random) < 0.1;
    if (radius_at(floor_t) < reach) {
      seen.cosine = static_cast<float>(down / along.norm());
      seen.face = ConcreteFace::cap;
      seen.gloss = 0;
      if (returns && is_lit(q)) {
        // Sand is rough, and water returns a wrong height.
        const double off = bore.content == Bore::Content::water  ? 0.8 * (unit(random >> 16U) - 0.5)
                           : bore.content == Bore::Content::sand ? 0.6 * (unit(random >> 16U) - 0.5)
                                                                 : 0.0;
        seen.t = static_cast<float>(floor_t + off);
      }
      return;
    }
  }
  if (bore.thread_depth_mm == 0.0 || unit(random >> 32U) >= kThreadShare) return;
  // The wall is hit at one radius from the axis, with the thread's groove on it.
  const Vec3 a = along - along.dot(bore.axis) * bore.axis;
  const Vec3 f = from - from.dot(bore.axis) * bore.axis;
  const auto wall_t = [&](double radius) {
    const double aa = std::max(a.squaredNorm(), 1e-12);
    const double half_b = f.dot(a);
    return (-half_b + std::sqrt(std::max(0.0, half_b * half_b - aa * (f.squaredNorm() - radius * radius)))) / aa;
  };
  double t = wall_t(bore.radius_mm);
  const double depth = down * t - height;
  t = wall_t(bore.radius_mm + kThread_mm * (0.5 + 0.5 * std::sin(2.0 * kPi * depth / kThreadPitch_mm)));
  if (depth > bore.thread_depth_mm || !is_lit(0.99 * (from + t * along))) return;
  seen.t = static_cast<float>(t);
  seen.cosine = 0.5F;  // the flank of a thread, not the wall behind it
  seen.face = ConcreteFace::cap;
  seen.gloss = 0;
  std::ignore = block;
}

void ConcreteOptics::meet_clutter(const ConcreteBlock& block, const Vec3& along, Seen& seen) const {
  const BlockTruth& truth = block.truth().block;
  if (!has_value(truth.glove_s_mm) && !has_value(truth.cable_x_mm)) return;
  // The same glove and cable as in BlockSurface: half of an ellipsoid on the bearing plane, a cylinder along Y.
  double nearest = std::numeric_limits<double>::infinity();
  const auto meet = [&](const Vec3& f, const Vec3& a) {
    const double aa = a.squaredNorm();
    const double half_b = f.dot(a);
    const double discriminant = half_b * half_b - aa * (f.squaredNorm() - 1.0);
    if (discriminant > 0.0) nearest = std::min(nearest, (-half_b - std::sqrt(discriminant)) / aa);
  };
  if (has_value(truth.glove_s_mm)) {
    const Vec3 half(60.0, 50.0, 15.0);
    const Vec3 centre(0.0, truth.glove_s_mm * std::cos(truth.slope_rad), truth.glove_s_mm * std::sin(truth.slope_rad));
    meet((origin_block_ - centre).cwiseQuotient(half), along.cwiseQuotient(half));
  }
  if (has_value(truth.cable_x_mm)) {
    const Vec3 f = (origin_block_ - Vec3(truth.cable_x_mm, 0.0, 35.0)) / 5.0;
    const Vec3 a = along / 5.0;
    meet(Vec3(f.x(), 0.0, f.z()), Vec3(a.x(), 0.0, a.z()));
  }
  if (!std::isfinite(nearest) || nearest >= static_cast<double>(seen.t)) return;
  seen.t = static_cast<float>(nearest);
  seen.cosine = 0.9F;
  seen.nearer = 0.0F;
  seen.face = ConcreteFace::strap;
  seen.gloss = 0;
}

}  // namespace slabd::emulator
