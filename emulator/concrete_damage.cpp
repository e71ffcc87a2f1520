// SPDX-License-Identifier: Apache-2.0
//
// The defects of a real block: dimensions, form of the seat, damage.
#include <algorithm>
#include <cmath>

#include "emulator/concrete_block.h"
#include "emulator/slab_scene.h"

namespace slabd::simulate {
namespace {

constexpr double kBowlHalfMm = 15.0;
constexpr double kBowHalfXMm = 95.0;
constexpr double kBowHalfSMm = 60.0;
/// Broken concrete is rough.
constexpr double kBreakRoughMm = 0.5;
constexpr double kBreakGrainMm = 3.0;
constexpr double kCrackDepthMm = 3.0;

double bell(double r, double half) {
  return std::abs(r) < half ? 0.5 * (1.0 + std::cos(kPi * r / half)) : 0.0;
}

}  // namespace

std::string_view name(MarkKind kind) {
  constexpr std::array<std::string_view, 6> kNames = {"pore", "burr", "dust", "drop", "damage", "crack"};
  return kNames.at(static_cast<std::size_t>(kind));
}

BlockTruth with_defects(const BlockTruth& basis, const std::vector<ConcreteDefect>& defects) {
  BlockTruth truth = basis;
  for (const ConcreteDefect& defect : defects) {
    switch (defect.kind) {
      case ConcreteDefectKind::slope: truth.slope_rad += rad_from_deg(defect.size); break;
      case ConcreteDefectKind::jaw_distance: truth.jaw_distance_mm += defect.size; break;
      case ConcreteDefectKind::jaw_angle: truth.jaw_angle_outer_rad += rad_from_deg(defect.size); break;
      // The rim stands over the seat by the size itself, wherever the drawing has it.
      case ConcreteDefectKind::casing_out: truth.protrusion_outer_mm = defect.size; break;
      case ConcreteDefectKind::casing_sunk: truth.protrusion_inner_mm -= defect.size; break;
      case ConcreteDefectKind::spacing: truth.casing_spacing_mm += defect.size; break;
      default: break;
    }
  }
  return truth;
}

void ConcreteBlock::mark(PlantedMark planted) {
  const EvaluationSettings& e = recipe_.evaluation;
  planted.in_crop = std::abs(planted.x_mm) <= e.crop_half_x_mm &&
                    std::abs(along_seat(planted.x_mm, planted.y_mm)) <= e.crop_half_s_mm;
  planted.z_mm = field_.height_mm(planted.x_mm, planted.y_mm);
  truth_.marks.push_back(planted);
}

void ConcreteBlock::put_defects() {
  const EvaluationSettings& e = recipe_.evaluation;
  for (const ConcreteDefect& defect : order_.defects) {
    Prng random(derived_seed(order_.seed, 500 + static_cast<std::uint64_t>(defect.kind), 0));
    const auto in_crop = [&](double half) { return (2.0 * random.uniform() - 1.0) * (half - kBowlHalfMm); };
    const double x = in_crop(e.crop_half_x_mm);
    const double y = in_crop(e.crop_half_s_mm);
    if (defect.kind == ConcreteDefectKind::depression || defect.kind == ConcreteDefectKind::hump) {
      const double height = defect.kind == ConcreteDefectKind::hump ? defect.size : -defect.size;
      stamp(x, y, kBowlHalfMm, [&](double dx, double dy) { return height * bell(std::hypot(dx, dy), kBowlHalfMm); });
    } else if (defect.kind == ConcreteDefectKind::bow) {
      // The bell ends within the evaluation region along s, so that the region has its whole height.
      stamp(0.0, 0.0, kBowHalfXMm,
            [&](double dx, double dy) { return defect.size * bell(dx, kBowHalfXMm) * bell(dy, kBowHalfSMm); });
    }
  }
}

void ConcreteBlock::put_damage() {
  for (const ConcreteDefect& defect : order_.defects) {
    Prng random(derived_seed(order_.seed, 500 + static_cast<std::uint64_t>(defect.kind), 1));
    const double size = defect.size;
    const double end = recipe_.block.end_half_length_mm.value;
    const double shoulder = recipe_.block.shoulder_outer_z_mm.value;
    const double tan_draft = std::tan(recipe_.block.draft_rad.value);
    const double sign = random.uniform() < 0.5 ? -1.0 : 1.0;
    const RasterField rough = RasterField::grain({40.0, 40.0, 0.5}, kBreakGrainMm, random.next());
    const auto roughness = [&](double dx, double dy) { return kBreakRoughMm * rough.at(dx, dy); };
    // Lowers the surface to `floor(dx, dy)` where that is below it.
    const auto break_out = [&](double x, double y, double half, const auto& floor) {
      double deepest = 0.0;
      const HeightField::Window w = field_.window(x, y, half);
      for (std::size_t row = w.row_from; row < w.row_to; ++row)
        for (std::size_t column = w.column_from; column < w.column_to; ++column) {
          const std::size_t node = field_.index(column, row);
          if (face_[node] >= ConcreteFace::rim_inner) continue;
          const double z = std::max(top_z_mm_, floor(field_.x_mm(column) - x, field_.y_mm(row) - y));
          deepest = std::max(deepest, static_cast<double>(field_.z(node)) - z);
          if (z < static_cast<double>(field_.z(node))) {
            field_.z(node) = static_cast<float>(z);
            face_[node] = ConcreteFace::edge;
          }
        }
      return deepest;
    };
    switch (defect.kind) {
      case ConcreteDefectKind::chip_corner: {
        // The plane through the points `size` away from the corner along its three edges.
        const double x = sign * (end - shoulder * tan_draft);
        const double y = recipe_.block.side_half_width_mm.value - shoulder * tan_draft;
        mark({MarkKind::damage, x, y, 0.0, size, size, size, false});
        break_out(x, y, 1.5 * size,
                  [&](double dx, double dy) { return shoulder - size - (sign * dx + dy) + roughness(dx, dy); });
        break;
      }
      case ConcreteDefectKind::chip_seat: {
        const double x = sign * end;
        const double y = (2.0 * random.uniform() - 1.0) * 80.0;
        mark({MarkKind::damage, x, y, 0.0, size, size, 0.4 * size, false});
        break_out(x, y, size, [&](double dx, double dy) {
          const double r = std::hypot(dx, dy) / (0.75 * size);
          return seat_z(x, y) + roughness(dx, dy) - 0.4 * size + (r < 1.0 ? 0.4 * size * r * r : 1e3);
        });
        break;
      }
      case ConcreteDefectKind::chip_jaw: {
        // At the upper edge, where the outer jaw meets its shoulder.
        const double x = (2.0 * random.uniform() - 1.0) * (end - 2.0 * size);
        const double jaw_climb = std::tan(truth_.block.slope_rad + kPi - truth_.block.jaw_angle_outer_rad);
        const double y = jaw_corners_[1].y() + (shoulder - jaw_corners_[1].z()) / jaw_climb;
        mark({MarkKind::damage, x, y, 0.0, size, 0.5 * size, 0.35 * size, false});
        break_out(x, y, size, [&](double dx, double dy) {
          const double r = std::hypot(dx / (0.5 * size), dy / (0.5 * size));
          return shoulder + roughness(dx, dy) - 0.45 * size + (r < 1.0 ? 0.35 * size * r * r : 1e3);
        });
        break;
      }
      case ConcreteDefectKind::crack: {
        // From end to end of the seat, within the evaluation region.
        const double y = (2.0 * random.uniform() - 1.0) * 50.0;
        const EdgeVariation course(random.next());
        mark({MarkKind::crack, 0.0, y, 0.0, 2.0 * end, size, kCrackDepthMm, true});
        stamp(0.0, y, end, [&](double dx, double dy) {
          const double off = std::abs(dy - 4.0 * course.at(dx));
          return off < 0.5 * size ? -kCrackDepthMm * (1.0 - off / (0.5 * size)) : 0.0;
        });
        break;
      }
      case ConcreteDefectKind::crust: {
        const Bore& bore = bores_[1];
        const double from = 2.0 * kPi * random.uniform();
        const double rim_radius = 0.5 * recipe_.block.casing_rim_diameter_mm.value;
        const HeightField::Window w = field_.window(bore.centre.x(), bore.centre.y(), rim_radius);
        for (std::size_t row = w.row_from; row < w.row_to; ++row)
          for (std::size_t column = w.column_from; column < w.column_to; ++column) {
            const double dx = field_.x_mm(column) - bore.centre.x();
            const double dy = field_.y_mm(row) - bore.centre.y();
            const double r = std::hypot(dx, dy);
            const double turn = std::remainder(std::atan2(dy, dx) - from, 2.0 * kPi);
            if (r < bore.radius_mm || r > rim_radius || std::abs(turn) > 0.25 * kPi) continue;
            const std::size_t node = field_.index(column, row);
            field_.z(node) =
                static_cast<float>(seat_z(field_.x_mm(column), field_.y_mm(row)) + size + 0.3 * roughness(dx, dy));
            face_[node] = ConcreteFace::edge;
            gloss_[node] = 0;
          }
        mark({MarkKind::damage, bore.centre.x() + 18.5 * std::cos(from), bore.centre.y() + 18.5 * std::sin(from), 0.0,
              26.0, 7.0, -size, false});
        break;
      }
      default: break;
    }
  }
}

}  // namespace slabd::simulate
