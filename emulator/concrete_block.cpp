// SPDX-License-Identifier: Apache-2.0
#include "emulator/concrete_block.h"

#include <algorithm>
#include <cmath>

#include "emulator/slab_scene.h"

namespace slabd::simulate {
namespace {

/// Nodes of the height field: finer than the pixels of a full scan (0.25 mm at the block), and a fillet of 4 mm is
/// within 0.002 mm of its circle between two of them.
constexpr double kNodeMm = 0.25;
constexpr double kWaveStepMm = 2.0;
constexpr double kGrainStepMm = 0.5;

constexpr double kFilletFootMm = 4.0;
constexpr double kFilletBrowMm = 3.0;
constexpr double kFilletTopMm = 6.0;
constexpr double kFilletScatter = 0.25;
constexpr double kChamferMm = 4.0;
constexpr double kWearShare = 0.4;
constexpr double kGrainMm = 0.010;
constexpr double kGrainLengthMm = 2.0;
constexpr double kReliefMm = 0.15;
constexpr double kWavePeakToValleyMm = 0.03;
constexpr double kOutlineScatterMm = 0.4;
constexpr double kCasingAlongMm = 0.08;
constexpr double kRollDeg = 0.02;
/// The relief of a shoulder begins at its edge with nothing and is complete after this.
constexpr double kReliefFadeMm = 8.0;
/// Kept clear of the ends of a jaw when its waviness is levelled.
constexpr double kJawEndMm = 8.0;
/// Where the block hides its own foot, or the slab top is taken for a fillet.
constexpr double kTopClearX = 112.0;
constexpr double kTopClearY = 247.0;

double within(Prng& random, double amplitude) {
  return amplitude * (2.0 * random.uniform() - 1.0);
}

/// A point of the cross-section: `s` along the bearing plane outward, `h` along its normal; y and z.
Vec3 on_section(double slope_rad, double s, double h) {
  return {0.0, s * std::cos(slope_rad) - h * std::sin(slope_rad), s * std::sin(slope_rad) + h * std::cos(slope_rad)};
}

SectionLine line_through(const Vec3& p, double climb_rad) {
  const double per_mm = std::tan(climb_rad);
  return {p.z() - per_mm * p.y(), per_mm};
}

}  // namespace

/// Everything that a node's height needs beside its section.
struct ConcreteBlock::Outline {
  double tan_draft = 0.0;
  double half_x_plus = 0.0, half_x_minus = 0.0, half_y_outer = 0.0, half_y_inner = 0.0;
  double chamfer_fall = 0.0;  ///< of a chamfer, mm per mm
  double shoulder_inner_z = 0.0, shoulder_outer_z = 0.0;
  SectionLine jaw_inner, jaw_outer;
  std::vector<Section> sections;  ///< by column
  // Worn along the edge: by column for the side faces (inner, outer), by row for the end faces (minus, plus).
  std::array<std::vector<double>, 2> chamfer_side, chamfer_end;
  std::array<std::vector<SectionArc>, 2> top_side, top_end;

  [[nodiscard]] double half_x(double x) const { return x > 0.0 ? half_x_plus : half_x_minus; }
  [[nodiscard]] double half_y(double y) const { return y > 0.0 ? half_y_outer : half_y_inner; }
};

BlockTruth scattered_truth(const Recipe& recipe, const BlockTruth& basis, double strength, std::uint64_t seed) {
  Prng random(derived_seed(seed, 300, 0));
  BlockTruth truth = basis;
  const auto half_of = [&](ItemId id) {
    const Tolerance& t = recipe.tolerance(id);
    return within(random, 0.25 * strength * (t.upper - t.lower));
  };
  truth.slope_rad += rad_from_deg(half_of(ItemId::seat_slope));
  truth.jaw_angle_inner_rad += rad_from_deg(half_of(ItemId::jaw_angle_inner));
  truth.jaw_angle_outer_rad += rad_from_deg(half_of(ItemId::jaw_angle_outer));
  truth.jaw_distance_mm += half_of(ItemId::jaw_distance);
  truth.casing_spacing_mm += half_of(ItemId::casing_spacing);
  truth.protrusion_inner_mm += half_of(ItemId::casing_protrusion_inner);
  truth.protrusion_outer_mm += half_of(ItemId::casing_protrusion_outer);
  return truth;
}

double ConcreteTruth::value(ItemId id) const {
  switch (id) {
    case ItemId::seat_slope: return deg_from_rad(block.slope_rad);
    case ItemId::seat_flatness: return flatness_form_mm;
    case ItemId::jaw_angle_inner: return deg_from_rad(block.jaw_angle_inner_rad);
    case ItemId::jaw_angle_outer: return deg_from_rad(block.jaw_angle_outer_rad);
    case ItemId::jaw_distance: return block.jaw_distance_mm;
    case ItemId::casing_spacing: return casing_spacing_mm;
    case ItemId::casing_protrusion_inner: return block.protrusion_inner_mm;
    case ItemId::casing_protrusion_outer: return block.protrusion_outer_mm;
    default: return kNoValue;
  }
}

ConcreteBlock::ConcreteBlock(const Recipe& recipe, const ConcreteOrder& order)
    : recipe_(recipe), order_(order), field_(kHalfXMm, kHalfYMm, kNodeMm) {
  face_.assign(field_.columns() * field_.rows(), ConcreteFace::slab_top);
  gloss_.assign(face_.size(), 0);
  truth_.block = with_defects(order.truth, order.defects);
}

std::uint64_t ConcreteBlock::seed_of(Effect effect, std::uint64_t which) const {
  return derived_seed(order_.seed, 400 + static_cast<std::uint64_t>(effect), which);
}

double ConcreteBlock::seat_z(double x, double y) const {
  return seat_per_x_ * x + seat_per_y_ * y;
}

double ConcreteBlock::along_seat(double x, double y) const {
  const double slope = truth_.block.slope_rad;
  return y * std::cos(slope) + seat_z(x, y) * std::sin(slope);
}

ConcreteBlock ConcreteBlock::cast(const Recipe& recipe, const ConcreteOrder& order) {
  ConcreteBlock block(recipe, order);
  block.cast_faces();
  if (block.truth_.block.present) {
    block.put_defects();
    block.set_rims();
    block.put_form();
    const Flatness form = block.flatness();
    block.truth_.flatness_form_mm = form.high - form.low;
    block.put_damage();
    block.put_marks();
    const Flatness raw = block.flatness();
    block.truth_.flatness_raw_mm = raw.high - raw.low;
    block.truth_.raw_low_mm = raw.low;
    block.truth_.raw_high_mm = raw.high;
  }
  block.field_.finish();
  return block;
}

void ConcreteBlock::round_edges(Outline& o) const {
  Prng random(seed_of(Effect::fillet));
  std::array<double, 5> radius{};
  constexpr std::array kRadii = {kFilletBrowMm, kFilletFootMm, kFilletFootMm, kFilletBrowMm, kFilletTopMm};
  for (std::size_t i = 0; i < radius.size(); ++i)
    radius[i] = kRadii[i] * strength(Effect::fillet) * (1.0 + within(random, kFilletScatter));
  const double chamfer = kChamferMm * strength(Effect::chamfer);
  const double worn = kWearShare * strength(Effect::wear);
  const auto course = [&](std::uint64_t which) { return EdgeVariation(seed_of(Effect::wear, which)); };
  // A radius or chamfer never vanishes by wear.
  const auto factor = [&](const EdgeVariation& variation, double t) {
    return std::max(0.1, 1.0 + worn * variation.at(t));
  };

  const std::array arcs = {course(0), course(1), course(2), course(3)};
  for (std::size_t column = 0; column < field_.columns(); ++column) {
    const double x = field_.x_mm(column);
    std::array<double, 4> worn_radius{};
    for (std::size_t i = 0; i < 4; ++i) worn_radius[i] = radius[i] * factor(arcs[i], x);
    o.sections[column].round(worn_radius);
  }
  const SectionLine top{top_z_mm_, 0.0};
  const auto foot = [&](double half, double worn_radius) {
    const double steep = -1.0 / o.tan_draft;
    return SectionArc::between({-steep * half, steep}, top, worn_radius);
  };
  for (std::size_t i = 0; i < 2; ++i) {
    const EdgeVariation upper_side = course(4 + i);
    const EdgeVariation lower_side = course(6 + i);
    const EdgeVariation upper_end = course(8 + i);
    const EdgeVariation lower_end = course(10 + i);
    for (std::size_t column = 0; column < field_.columns(); ++column) {
      const double x = field_.x_mm(column);
      o.chamfer_side[i].push_back(chamfer * factor(upper_side, x));
      o.top_side[i].push_back(foot(i == 0 ? o.half_y_inner : o.half_y_outer, radius[4] * factor(lower_side, x)));
    }
    for (std::size_t row = 0; row < field_.rows(); ++row) {
      const double y = field_.y_mm(row);
      o.chamfer_end[i].push_back(chamfer * factor(upper_end, y));
      o.top_end[i].push_back(foot(i == 0 ? o.half_x_minus : o.half_x_plus, radius[4] * factor(lower_end, y)));
    }
  }
}

void ConcreteBlock::cast_faces() {
  const BlockGeometry& b = recipe_.block;
  BlockTruth& truth = truth_.block;
  const double cast = strength(Effect::cast);
  Prng random(seed_of(Effect::cast));
  const auto off = [&] { return within(random, cast * kOutlineScatterMm); };
  Outline o;
  o.shoulder_inner_z = b.shoulder_inner_z_mm.value + off();
  o.shoulder_outer_z = b.shoulder_outer_z_mm.value + off();
  o.half_x_plus = b.end_half_length_mm.value + off();
  o.half_x_minus = b.end_half_length_mm.value + off();
  o.half_y_outer = b.side_half_width_mm.value + off();
  o.half_y_inner = b.side_half_width_mm.value + off();
  top_z_mm_ = b.slab_top_z_mm.value + truth.slab_top_shift_mm + off();
  truth_.roll_rad = rad_from_deg(within(random, cast * kRollDeg));
  for (Bore& bore : bores_) bore.centre.x() = within(random, cast * kCasingAlongMm);
  o.tan_draft = std::tan(b.draft_rad.value);
  o.chamfer_fall = std::cos(b.draft_rad.value) / (1.0 + std::sin(b.draft_rad.value));

  const double slope = truth.slope_rad;
  seat_per_y_ = std::tan(slope);
  seat_per_x_ = std::tan(truth_.roll_rad) / std::cos(slope);
  const double jaw_half = 0.5 * truth.jaw_distance_mm;
  const double height = b.jaw_reference_height_mm.value;
  o.jaw_outer =
      line_through(on_section(slope, truth.jaw_shift_mm + jaw_half, height), slope + (kPi - truth.jaw_angle_outer_rad));
  o.jaw_inner =
      line_through(on_section(slope, truth.jaw_shift_mm - jaw_half, height), slope - (kPi - truth.jaw_angle_inner_rad));
  for (std::size_t i = 0; i < 2; ++i) {
    const SectionLine& jaw = i == 0 ? o.jaw_inner : o.jaw_outer;
    const double y = jaw.at_origin / (seat_per_y_ - jaw.per_mm);
    jaw_corners_[i] = Vec3(0.0, y, jaw.z(y));
  }
  Section section;
  section.shoulder_inner = {o.shoulder_inner_z, 0.0};
  section.shoulder_outer = {o.shoulder_outer_z, 0.0};
  section.jaw_inner = o.jaw_inner;
  section.jaw_outer = o.jaw_outer;
  for (std::size_t column = 0; column < field_.columns(); ++column) {
    section.seat = {seat_per_x_ * field_.x_mm(column), seat_per_y_};
    o.sections.push_back(section);
  }
  round_edges(o);
  truth_.chamfer_mm = kChamferMm * strength(Effect::chamfer);
  Prng again(seed_of(Effect::fillet));
  for (std::size_t i = 0; i < truth_.fillet_mm.size(); ++i) {
    constexpr std::array kRadii = {kFilletBrowMm, kFilletFootMm, kFilletFootMm, kFilletBrowMm, kFilletTopMm};
    truth_.fillet_mm[i] = kRadii[i] * strength(Effect::fillet) * (1.0 + within(again, kFilletScatter));
  }

  const FieldSize smooth{kHalfXMm, kHalfYMm, kWaveStepMm};
  RasterField wave;
  double wave_mm = 0.0;
  if (strength(Effect::wave) != 0.0) {
    wave = RasterField::waves(smooth, 50.0, 150.0, 16, seed_of(Effect::wave));
    double low = 0.0;
    double high = 0.0;
    for (double x = -100.0; x <= 100.0; x += 4.0)
      for (double y = -185.0; y <= 185.0; y += 4.0) {
        low = std::min(low, wave.at(x, y));
        high = std::max(high, wave.at(x, y));
      }
    wave_mm = kWavePeakToValleyMm * strength(Effect::wave) / (high - low);
  }
  RasterField grain;
  const double grain_mm = kGrainMm * strength(Effect::grain);
  if (grain_mm != 0.0)
    grain = RasterField::grain({kHalfXMm, kHalfYMm, kGrainStepMm}, kGrainLengthMm, seed_of(Effect::grain));
  const double relief_mm_rms = kReliefMm * strength(Effect::relief);
  if (relief_mm_rms != 0.0) relief_ = RasterField::waves(smooth, 60.0, 200.0, 24, seed_of(Effect::relief));

  const double seat_nz = std::cos(slope);
  const std::array<double, 2> jaw_nz = {1.0 / std::hypot(1.0, o.jaw_inner.per_mm),
                                        1.0 / std::hypot(1.0, o.jaw_outer.per_mm)};
  const bool has_relief = truth.bump_mm != 0.0 || truth.chip_mm != 0.0 || truth.burr_mm != 0.0 || truth.sunk_mm != 0.0;
  const double end_minus = has_value(truth.top_end_minus_mm) ? truth.top_end_minus_mm : 1e9;
  const double end_plus = has_value(truth.top_end_plus_mm) ? truth.top_end_plus_mm : 1e9;
  const auto beyond_z = static_cast<float>(top_z_mm_ - recipe_.slab.thickness_mm.value);
  // What is added along a face's normal, and levelled before it is.
  std::vector<float> added(face_.size(), 0.0F);
  for (std::size_t row = 0; row < field_.rows(); ++row) {
    const double y = field_.y_mm(row);
    const std::size_t side = y > 0.0 ? 1 : 0;
    const double side_z = (o.half_y(y) - std::abs(y)) / o.tan_draft;
    for (std::size_t column = 0; column < field_.columns(); ++column) {
      const double x = field_.x_mm(column);
      const std::size_t node = field_.index(column, row);
      const std::size_t end = x > 0.0 ? 1 : 0;
      const double end_z = (o.half_x(x) - std::abs(x)) / o.tan_draft;
      double z = top_z_mm_;
      ConcreteFace face = ConcreteFace::slab_top;
      double more = 0.0;
      if (truth.present && std::min(end_z, side_z) > top_z_mm_) {
        const Section& at = o.sections[column];
        const Section::Point p = at.at(y);
        z = p.z;
        face = p.face;
        if (has_relief && face == ConcreteFace::seat) z += relief_mm(truth, x, along_seat(x, y)) / seat_nz;
        // The corner that a defect breaks out of the block, as in BlockSurface.
        if (truth.corner_mm != 0.0 && x > 57.0 && y > 155.0) z -= truth.corner_mm;
        const double chamfer_end = o.chamfer_end[end][row];
        const double chamfer_side = o.chamfer_side[side][column];
        const double end_edge = o.half_x(x) - p.z * o.tan_draft;
        const double side_edge = o.half_y(y) - p.z * o.tan_draft;
        double cut = z - (std::abs(x) - end_edge + chamfer_end) * o.chamfer_fall;
        cut = std::min(cut, z - (std::abs(y) - side_edge + chamfer_side) * o.chamfer_fall);
        cut = std::min(cut, 0.5 * ((end_z + side_z) - chamfer_end / o.tan_draft));
        if (cut < z) {
          z = cut;
          face = ConcreteFace::edge;
        }
        if (end_z < z || side_z < z) {
          face = end_z < side_z ? ConcreteFace::end : ConcreteFace::side;
          z = std::min(end_z, side_z);
        }
        switch (face) {
          case ConcreteFace::seat: more = wave_mm * wave.at(x, y) + grain_mm * grain.at(x, y); break;
          case ConcreteFace::jaw_inner:
          case ConcreteFace::jaw_outer: {
            const std::size_t i = face == ConcreteFace::jaw_outer ? 1 : 0;
            const double v = jaw_corners_[i].y() + (y - jaw_corners_[i].y()) / jaw_nz[i];
            more = wave_mm * wave.at(x, v) + grain_mm * grain.at(x, v);
            break;
          }
          case ConcreteFace::shoulder_inner:
          case ConcreteFace::shoulder_outer: {
            const double from = face == ConcreteFace::shoulder_outer ? y - at.arcs[3].to : at.arcs[0].from - y;
            more = relief_mm_rms * std::min(1.0, from / kReliefFadeMm) * relief_.at(x, y) + grain_mm * grain.at(x, y);
            break;
          }
          default: break;
        }
      }
      if (x < -end_minus || x > end_plus) {
        field_.z(node) = beyond_z;
        face_[node] = ConcreteFace::beyond;
        continue;
      }
      if (z < top_z_mm_ || face == ConcreteFace::slab_top) {
        z = top_z_mm_;
        face = ConcreteFace::slab_top;
      }
      // The fillet at the foot: along an end or side face, and turned about the corner between them.
      if (truth.present && z < top_z_mm_ + 8.0 * kFilletTopMm) {
        const double foot_x = o.half_x(x) - top_z_mm_ * o.tan_draft;
        const double foot_y = o.half_y(y) - top_z_mm_ * o.tan_draft;
        const double dx = std::abs(x) - foot_x;
        const double dy = std::abs(y) - foot_y;
        const SectionArc& by_end = o.top_end[end][row];
        const SectionArc& by_side = o.top_side[side][column];
        const double t_end = dy > 0.0 && dx > 0.0 ? foot_x + std::hypot(dx, dy) : std::abs(x);
        if ((dy <= 0.0 || dx > 0.0) && t_end > by_end.from && t_end < by_end.to && by_end.z(t_end) > z) {
          z = by_end.z(t_end);
          face = ConcreteFace::edge;
        }
        if (dx <= 0.0 && std::abs(y) > by_side.from && std::abs(y) < by_side.to && by_side.z(std::abs(y)) > z) {
          z = by_side.z(std::abs(y));
          face = ConcreteFace::edge;
        }
        if (face == ConcreteFace::edge && z < top_z_mm_ + kFilletTopMm) z += relief_mm_rms * relief_.at(x, y);
      }
      if (face == ConcreteFace::slab_top) {
        more = grain_mm * grain.at(x, y);
        z += relief_mm_rms * relief_.at(x, y);
      }
      field_.z(node) = static_cast<float>(z);
      face_[node] = face;
      added[node] = static_cast<float>(more);
    }
  }
  remove_planes(added);
  for (std::size_t node = 0; node < face_.size(); ++node) {
    const double nz = face_[node] == ConcreteFace::seat        ? seat_nz
                      : face_[node] == ConcreteFace::jaw_inner ? jaw_nz[0]
                      : face_[node] == ConcreteFace::jaw_outer ? jaw_nz[1]
                                                               : 1.0;
    field_.z(node) += static_cast<float>(static_cast<double>(added[node]) / nz);
  }
}

void ConcreteBlock::remove_planes(std::vector<float>& added) {
  const EvaluationSettings& e = recipe_.evaluation;
  PlaneSums seat;
  std::array<PlaneSums, 2> jaws;
  const auto each = [&](const auto& visit) {
    for (std::size_t row = 0; row < field_.rows(); ++row)
      for (std::size_t column = 0; column < field_.columns(); ++column) {
        const std::size_t node = field_.index(column, row);
        visit(field_.x_mm(column), field_.y_mm(row), face_[node], added[node]);
      }
  };
  const auto jaw_of = [](ConcreteFace face) { return face == ConcreteFace::jaw_outer ? std::size_t{1} : 0; };
  each([&](double x, double y, ConcreteFace face, float more) {
    const auto h = static_cast<double>(more);
    if (face == ConcreteFace::seat && std::abs(x) <= e.crop_half_x_mm && std::abs(along_seat(x, y)) <= e.crop_half_s_mm)
      seat.add(x, y, h);
    if ((face == ConcreteFace::jaw_inner || face == ConcreteFace::jaw_outer) &&
        std::abs(x) < recipe_.block.end_half_length_mm.value - kJawEndMm)
      jaws[jaw_of(face)].add(x, y - jaw_corners_[jaw_of(face)].y(), h);
  });
  const Vec3 level = seat.plane();
  const std::array<Vec3, 2> upright = {jaws[0].plane(), jaws[1].plane()};
  each([&](double x, double y, ConcreteFace face, float& more) {
    if (face == ConcreteFace::seat) more -= static_cast<float>(level.dot(Vec3(1.0, x, y)));
    if (face == ConcreteFace::jaw_inner || face == ConcreteFace::jaw_outer)
      more -= static_cast<float>(upright[jaw_of(face)].dot(Vec3(1.0, x, y - jaw_corners_[jaw_of(face)].y())));
  });
}

void ConcreteBlock::level_top(const std::function<bool(double, double)>& seen) {
  if (strength(Effect::relief) == 0.0) return;
  constexpr double kStep = 2.0;
  PlaneSums sums;
  for (double y = -kHalfYMm; y <= kHalfYMm; y += kStep)
    for (double x = -kHalfXMm; x <= kHalfXMm; x += kStep) {
      if (std::abs(x) <= kTopClearX && std::abs(y) <= kTopClearY) continue;
      if (face_[field_.nearest(x, y)] == ConcreteFace::slab_top && seen(x, y)) sums.add(x, y, relief_.at(x, y));
    }
  const Vec3 plane = kReliefMm * strength(Effect::relief) * sums.plane();
  for (std::size_t row = 0; row < field_.rows(); ++row)
    for (std::size_t column = 0; column < field_.columns(); ++column) {
      const std::size_t node = field_.index(column, row);
      if (face_[node] == ConcreteFace::slab_top)
        field_.z(node) -= static_cast<float>(plane.dot(Vec3(1.0, field_.x_mm(column), field_.y_mm(row))));
    }
  field_.finish();
}

ConcreteBlock::Flatness ConcreteBlock::flatness() const {
  const EvaluationSettings& e = recipe_.evaluation;
  const double slope = truth_.block.slope_rad;
  const auto columns = static_cast<std::size_t>(std::lround(2.0 * e.crop_half_x_mm / e.cell_mm));
  const auto rows = static_cast<std::size_t>(std::lround(2.0 * e.crop_half_s_mm / e.cell_mm));
  std::vector<double> sum(columns * rows, 0.0);
  std::vector<double> count(columns * rows, 0.0);
  const HeightField::Window w = field_.window(0.0, 0.0, e.crop_half_s_mm + 1.0);
  for (std::size_t row = w.row_from; row < w.row_to; ++row)
    for (std::size_t column = w.column_from; column < w.column_to; ++column) {
      const double x = field_.x_mm(column);
      const double y = field_.y_mm(row);
      const double cell_x = (x + e.crop_half_x_mm) / e.cell_mm;
      const double cell_s = (along_seat(x, y) + e.crop_half_s_mm) / e.cell_mm;
      if (cell_x < 0.0 || cell_s < 0.0) continue;
      const auto c = static_cast<std::size_t>(cell_x);
      const auto r = static_cast<std::size_t>(cell_s);
      if (c >= columns || r >= rows) continue;
      const double off = static_cast<double>(field_.z(field_.index(column, row))) - seat_z(x, y);
      sum[r * columns + c] += off * std::cos(slope);
      count[r * columns + c] += 1.0;
    }
  PlaneSums sums;
  const auto each = [&](const auto& visit) {
    for (std::size_t r = 0; r < rows; ++r)
      for (std::size_t c = 0; c < columns; ++c)
        if (count[r * columns + c] > 0.0)
          visit((static_cast<double>(c) + 0.5) * e.cell_mm - e.crop_half_x_mm,
                (static_cast<double>(r) + 0.5) * e.cell_mm - e.crop_half_s_mm,
                sum[r * columns + c] / count[r * columns + c]);
  };
  each([&](double x, double s, double h) { sums.add(x, s, h); });
  const Vec3 plane = sums.plane();
  Flatness flat{1e9, -1e9};
  each([&](double x, double s, double h) {
    const double off = h - plane.dot(Vec3(1.0, x, s));
    flat.low = std::min(flat.low, off);
    flat.high = std::max(flat.high, off);
  });
  return flat;
}

}  // namespace slabd::simulate
