// SPDX-License-Identifier: Apache-2.0
//
// The faces of a block with fillets and chamfers, and the textures of the concrete: grain, waviness and relief.
#include <algorithm>
#include <cmath>

#include "emulator/concrete_block.h"
#include "emulator/slab_scene.h"

namespace slabd::emulator {
namespace {

constexpr double kWaveStep_mm = 2.0;
constexpr double kGrainStep_mm = 0.5;
/// Jaw/shoulder, seat/jaw, seat/jaw, jaw/shoulder, slab top.
constexpr std::array kFillet_mm = {3.0, 4.0, 4.0, 3.0, 6.0};
constexpr double kFilletTop_mm = kFillet_mm[4];
constexpr double kFilletScatter = 0.25;
constexpr double kChamfer_mm = 4.0;
constexpr double kWearShare = 0.4;
/// Smallest size of a worn edge, as a share.
constexpr double kWornLeast = 0.1;
constexpr double kGrain_mm = 0.010;
constexpr double kGrainLength_mm = 2.0;
constexpr double kWavePeakToValley_mm = 0.03;
constexpr double kOutlineScatter_mm = 0.4;
constexpr double kCasingAlong_mm = 0.08;
constexpr double kRoll_deg = 0.02;
/// The relief of a shoulder rises from zero at its edge to full height over this distance.
constexpr double kReliefFade_mm = 8.0;
/// Distance from the ends of a jaw that is left out when its waviness is levelled.
constexpr double kJawEnd_mm = 8.0;
/// The corner that a defect breaks out of the block, as in BlockSurface.
constexpr double kCornerX = 57.0;
constexpr double kCornerY = 155.0;

double within(Prng& random, double amplitude) {
  return amplitude * (2.0 * random.uniform() - 1.0);
}

/// A line of the section through the point `s` along the bearing plane outward and `h` along its normal.
SectionLine line_through(double slope_rad, double s, double h, double climb_rad) {
  const double y = s * std::cos(slope_rad) - h * std::sin(slope_rad);
  const double z = s * std::sin(slope_rad) + h * std::cos(slope_rad);
  const double per_mm = std::tan(climb_rad);
  return {z - per_mm * y, per_mm};
}

std::size_t jaw_of(ConcreteFace face) {
  return face == ConcreteFace::jaw_outer ? 1 : 0;
}

bool is_jaw(ConcreteFace face) {
  return face == ConcreteFace::jaw_inner || face == ConcreteFace::jaw_outer;
}

}  // namespace

/// Data for the height of a node.
struct ConcreteBlock::Faces {
  double tan_draft = 0.0;
  std::array<double, 2> half_x{};  ///< at z = 0, minus and plus
  std::array<double, 2> half_y{};  ///< inner and outer
  double chamfer_fall = 0.0;       ///< slope of a chamfer, mm per mm
  Section sharp;                   ///< at x = 0, without arcs
  std::vector<Section> sections;   ///< by column
  // Wear along the edge: by column for the side faces (inner, outer), by row for the end faces (minus, plus).
  std::array<std::vector<double>, 2> chamfer_side, chamfer_end;
  std::array<std::vector<SectionArc>, 2> foot_side, foot_end;
  std::array<double, 2> jaw_nz{};  ///< z of the jaws' normals
  double seat_nz = 1.0;
  bool has_form_defect = false;
  RasterField wave, grain;
  double wave_mm = 0.0, grain_mm = 0.0, relief_mm = 0.0;
};

void ConcreteBlock::shape(Faces& f) {
  const BlockGeometry& b = recipe_.block;
  const BlockTruth& truth = truth_.block;
  const double cast = strength(Effect::cast);
  Prng random(seed_of(Effect::cast));
  const auto off = [&] { return within(random, cast * kOutlineScatter_mm); };
  f.sharp.shoulder_inner = {b.shoulder_inner_z_mm.value + off(), 0.0};
  f.sharp.shoulder_outer = {b.shoulder_outer_z_mm.value + off(), 0.0};
  for (double& half : f.half_x) half = b.end_half_length_mm.value + off();
  for (double& half : f.half_y) half = b.side_half_width_mm.value + off();
  top_z_mm_ = b.slab_top_z_mm.value + truth.slab_top_shift_mm + off();
  truth_.roll_rad = rad_from_deg(within(random, cast * kRoll_deg));
  // The casings move in opposite directions, so that their midpoint, the seat's reference point, remains in place.
  bores_[1].centre.x() = within(random, cast * kCasingAlong_mm);
  bores_[0].centre.x() = -bores_[1].centre.x();
  f.tan_draft = std::tan(b.draft_rad.value);
  f.chamfer_fall = std::cos(b.draft_rad.value) / (1.0 + std::sin(b.draft_rad.value));

  const double slope = truth.slope_rad;
  seat_per_y_ = std::tan(slope);
  seat_per_x_ = std::tan(truth_.roll_rad) / std::cos(slope);
  const double half = 0.5 * truth.jaw_distance_mm;
  const double height = b.jaw_reference_height_mm.value;
  f.sharp.jaw_inner = line_through(slope, truth.jaw_shift_mm - half, height, slope - (kPi - truth.jaw_angle_inner_rad));
  f.sharp.jaw_outer = line_through(slope, truth.jaw_shift_mm + half, height, slope + (kPi - truth.jaw_angle_outer_rad));
  const std::array<SectionLine, 2> jaws = {f.sharp.jaw_inner, f.sharp.jaw_outer};
  for (std::size_t i = 0; i < 2; ++i) {
    const double y = jaws[i].at_origin / (seat_per_y_ - jaws[i].per_mm);
    jaw_corners_[i] = Vec3(0.0, y, jaws[i].z(y));
    f.jaw_nz[i] = 1.0 / std::hypot(1.0, jaws[i].per_mm);
  }
  f.seat_nz = std::cos(slope);
  f.has_form_defect = truth.bump_mm != 0.0 || truth.chip_mm != 0.0 || truth.burr_mm != 0.0 || truth.sunk_mm != 0.0;
}

void ConcreteBlock::round_edges(Faces& f) {
  Prng random(seed_of(Effect::fillet));
  std::array<double, 5>& radius = truth_.fillet_mm;
  for (std::size_t i = 0; i < radius.size(); ++i)
    radius[i] = kFillet_mm[i] * strength(Effect::fillet) * (1.0 + within(random, kFilletScatter));
  truth_.chamfer_mm = kChamfer_mm * strength(Effect::chamfer);
  const double worn = kWearShare * strength(Effect::wear);
  const auto course = [&](std::uint64_t which) { return EdgeVariation(seed_of(Effect::wear, which)); };
  const auto factor = [&](const EdgeVariation& variation, double t) {
    return std::max(kWornLeast, 1.0 + worn * variation.at(t));
  };
  const std::array arcs = {course(0), course(1), course(2), course(3)};
  for (std::size_t column = 0; column < field_.columns(); ++column) {
    const double x = field_.x_mm(column);
    std::array<double, 4> worn_radius{};
    for (std::size_t i = 0; i < 4; ++i) worn_radius[i] = radius[i] * factor(arcs[i], x);
    Section& section = f.sections.emplace_back(f.sharp);
    section.seat = {seat_per_x_ * x, seat_per_y_};
    section.round(worn_radius);
  }
  const auto foot = [&](double half, double worn_radius) {
    const double steep = -1.0 / f.tan_draft;
    return SectionArc::between({-steep * half, steep}, {top_z_mm_, 0.0}, worn_radius);
  };
  for (std::size_t i = 0; i < 2; ++i) {
    const std::array courses = {course(4 + i), course(6 + i), course(8 + i), course(10 + i)};
    for (std::size_t column = 0; column < field_.columns(); ++column) {
      const double x = field_.x_mm(column);
      f.chamfer_side[i].push_back(truth_.chamfer_mm * factor(courses[0], x));
      f.foot_side[i].push_back(foot(f.half_y[i], radius[4] * factor(courses[1], x)));
    }
    for (std::size_t row = 0; row < field_.rows(); ++row) {
      const double y = field_.y_mm(row);
      f.chamfer_end[i].push_back(truth_.chamfer_mm * factor(courses[2], y));
      f.foot_end[i].push_back(foot(f.half_x[i], radius[4] * factor(courses[3], y)));
    }
  }
}

void ConcreteBlock::texture(Faces& f) {
  const FieldSize smooth{kHalfX_mm, kHalfY_mm, kWaveStep_mm};
  if (strength(Effect::wave) != 0.0) {
    f.wave = RasterField::waves(smooth, 50.0, 150.0, 16, seed_of(Effect::wave));
    double low = 0.0;
    double high = 0.0;
    for (double x = -100.0; x <= 100.0; x += 4.0)
      for (double y = -185.0; y <= 185.0; y += 4.0) {
        low = std::min(low, f.wave.at(x, y));
        high = std::max(high, f.wave.at(x, y));
      }
    f.wave_mm = kWavePeakToValley_mm * strength(Effect::wave) / (high - low);
  }
  f.grain_mm = kGrain_mm * strength(Effect::grain);
  if (f.grain_mm != 0.0)
    f.grain = RasterField::grain({kHalfX_mm, kHalfY_mm, kGrainStep_mm}, kGrainLength_mm, seed_of(Effect::grain));
  f.relief_mm = kRelief_mm * strength(Effect::relief);
  if (f.relief_mm != 0.0) relief_ = RasterField::waves(smooth, 60.0, 200.0, 24, seed_of(Effect::relief));
}

ConcreteBlock::Node ConcreteBlock::block_node(const Faces& f, std::size_t column, std::size_t row) const {
  const double x = field_.x_mm(column);
  const double y = field_.y_mm(row);
  const std::size_t end = x > 0.0 ? 1 : 0;
  const std::size_t side = y > 0.0 ? 1 : 0;
  const double end_z = (f.half_x[end] - std::abs(x)) / f.tan_draft;
  const double side_z = (f.half_y[side] - std::abs(y)) / f.tan_draft;
  if (std::min(end_z, side_z) <= top_z_mm_) return {top_z_mm_, 0.0, ConcreteFace::slab_top};
  const Section& section = f.sections[column];
  const Section::Point p = section.at(y);
  Node node{p.z, 0.0, p.face};
  if (f.has_form_defect && p.face == ConcreteFace::seat)
    node.z += relief_mm(truth_.block, x, along_seat(x, y)) / f.seat_nz;
  if (truth_.block.corner_mm != 0.0 && x > kCornerX && y > kCornerY) node.z -= truth_.block.corner_mm;

  const double chamfer_end = f.chamfer_end[end][row];
  const double from_end = std::abs(x) - (f.half_x[end] - p.z * f.tan_draft) + chamfer_end;
  const double from_side = std::abs(y) - (f.half_y[side] - p.z * f.tan_draft) + f.chamfer_side[side][column];
  double cut = node.z - std::max(from_end, from_side) * f.chamfer_fall;
  cut = std::min(cut, 0.5 * (end_z + side_z - chamfer_end / f.tan_draft));  // the vertical edge between both faces
  if (cut < node.z) {
    node.z = cut;
    node.face = ConcreteFace::edge;
  }
  if (end_z < node.z || side_z < node.z) {
    node.face = end_z < side_z ? ConcreteFace::end : ConcreteFace::side;
    node.z = std::min(end_z, side_z);
  }
  if (node.face == ConcreteFace::seat) {
    node.added = f.wave_mm * f.wave.at(x, y) + f.grain_mm * f.grain.at(x, y);
  } else if (is_jaw(node.face)) {
    // Coordinate along the face, so that its texture is not stretched.
    const std::size_t i = jaw_of(node.face);
    const double v = jaw_corners_[i].y() + (y - jaw_corners_[i].y()) / f.jaw_nz[i];
    node.added = f.wave_mm * f.wave.at(x, v) + f.grain_mm * f.grain.at(x, v);
  } else if (node.face == ConcreteFace::shoulder_inner || node.face == ConcreteFace::shoulder_outer) {
    const bool outer = node.face == ConcreteFace::shoulder_outer;
    const double from = outer ? y - section.arcs[3].to : section.arcs[0].from - y;
    node.added = f.relief_mm * std::min(1.0, from / kReliefFade_mm) * relief_.at(x, y) + f.grain_mm * f.grain.at(x, y);
  }
  if (node.z >= top_z_mm_) return node;
  return {top_z_mm_, 0.0, ConcreteFace::slab_top};
}

void ConcreteBlock::round_foot(const Faces& f, std::size_t column, std::size_t row, Node& node) const {
  const double x = field_.x_mm(column);
  const double y = field_.y_mm(row);
  const std::size_t end = x > 0.0 ? 1 : 0;
  const std::size_t side = y > 0.0 ? 1 : 0;
  const double foot_x = f.half_x[end] - top_z_mm_ * f.tan_draft;
  const double dx = std::abs(x) - foot_x;
  const double dy = std::abs(y) - (f.half_y[side] - top_z_mm_ * f.tan_draft);
  const auto raise = [&](const SectionArc& arc, double t) {
    if (t <= arc.from || t >= arc.to || arc.z(t) <= node.z) return;
    node = {arc.z(t), f.relief_mm * relief_.at(x, y), ConcreteFace::edge};
  };
  // Along an end or side face, and rotated about the corner between them.
  if (dy <= 0.0 || dx > 0.0)
    raise(f.foot_end[end][row], dx > 0.0 && dy > 0.0 ? foot_x + std::hypot(dx, dy) : std::abs(x));
  if (dx <= 0.0) raise(f.foot_side[side][column], std::abs(y));
}

void ConcreteBlock::cast_faces() {
  Faces f;
  shape(f);
  round_edges(f);
  texture(f);
  const BlockTruth& truth = truth_.block;
  const double end_minus = has_value(truth.top_end_minus_mm) ? -truth.top_end_minus_mm : -1e9;
  const double end_plus = has_value(truth.top_end_plus_mm) ? truth.top_end_plus_mm : 1e9;
  // Heights along the normals of the faces, which are levelled before they are added.
  std::vector<float> added(face_.size(), 0.0F);
  for (std::size_t row = 0; row < field_.rows(); ++row)
    for (std::size_t column = 0; column < field_.columns(); ++column) {
      const double x = field_.x_mm(column);
      const double y = field_.y_mm(row);
      Node node{top_z_mm_, 0.0, ConcreteFace::slab_top};
      if (x < end_minus || x > end_plus) {
        node = {top_z_mm_ - recipe_.slab.thickness_mm.value, 0.0, ConcreteFace::beyond};
      } else if (truth.present) {
        node = block_node(f, column, row);
        if (node.z < top_z_mm_ + 8.0 * kFilletTop_mm) round_foot(f, column, row, node);
      }
      if (node.face == ConcreteFace::slab_top)
        node.added = f.relief_mm * relief_.at(x, y) + f.grain_mm * f.grain.at(x, y);
      const std::size_t at = field_.index(column, row);
      field_.z(at) = static_cast<float>(node.z);
      face_[at] = node.face;
      added[at] = static_cast<float>(node.added);
    }
  remove_planes(added);
  for (std::size_t at = 0; at < face_.size(); ++at) {
    const ConcreteFace face = face_[at];
    const double nz = face == ConcreteFace::seat ? f.seat_nz : is_jaw(face) ? f.jaw_nz[jaw_of(face)] : 1.0;
    field_.z(at) += static_cast<float>(static_cast<double>(added[at]) / nz);
  }
}

void ConcreteBlock::remove_planes(std::vector<float>& added) const {
  const EvaluationSettings& e = recipe_.evaluation;
  PlaneSums seat;
  std::array<PlaneSums, 2> jaws;
  const auto each = [&](const auto& visit) {
    for (std::size_t row = 0; row < field_.rows(); ++row)
      for (std::size_t column = 0; column < field_.columns(); ++column) {
        const std::size_t at = field_.index(column, row);
        visit(field_.x_mm(column), field_.y_mm(row), face_[at], added[at]);
      }
  };
  each([&](double x, double y, ConcreteFace face, float more) {
    const auto h = static_cast<double>(more);
    if (face == ConcreteFace::seat && std::abs(x) <= e.crop_half_x_mm && std::abs(along_seat(x, y)) <= e.crop_half_s_mm)
      seat.add(x, y, h);
    if (is_jaw(face) && std::abs(x) < recipe_.block.end_half_length_mm.value - kJawEnd_mm)
      jaws[jaw_of(face)].add(x, y - jaw_corners_[jaw_of(face)].y(), h);
  });
  const Vec3 level = seat.plane();
  const std::array<Vec3, 2> upright = {jaws[0].plane(), jaws[1].plane()};
  each([&](double x, double y, ConcreteFace face, float& more) {
    if (face == ConcreteFace::seat) more -= static_cast<float>(level.dot(Vec3(1.0, x, y)));
    if (is_jaw(face))
      more -= static_cast<float>(upright[jaw_of(face)].dot(Vec3(1.0, x, y - jaw_corners_[jaw_of(face)].y())));
  });
}

}  // namespace slabd::emulator
