// SPDX-License-Identifier: Apache-2.0
//
// Connected cells off their surface, and the classification of such a place: by its depth, its size, its shape, and
// whether it is open towards an outer edge of the block.
#include "algo/survey/surface_damage.h"

#include <algorithm>
#include <array>
#include <cmath>

#include "algo/survey/surface_reference.h"

namespace slabd::algo {
namespace {

using namespace surface_cell;

constexpr std::size_t kColumns = kSurfaceColumns;
constexpr std::size_t kRows = kSurfaceRows;
constexpr std::size_t kCells = kSurfaceCells;
constexpr double kCellArea_mm2 = kSurfaceCell_mm * kSurfaceCell_mm;

/// Limits from which a cell is low or high, mm. Grain, ripple, chalk (0.03), flash (0.1) and burrs (0.3) on a face are
/// below them, as is undulation of a shoulder; along edges the limits cover the variation of chamfers and fillets.
struct Limits {
  float low = 0.0F;
  float low_of_face = 0.0F;  ///< SurfaceField::face_off: an area that is sunk as a whole, a place broken out of an edge
  float weak_of_face = 0.0F;  ///< limit next to a low cell
  float high = 0.0F;
};
constexpr std::size_t kZones = static_cast<std::size_t>(SurfaceZone::behind_edge) + 1;
Limits limits_of(SurfaceZone zone, double edge_wear) {
  constexpr float kNever = 1e9F;
  const auto wear = static_cast<float>(edge_wear);
  switch (zone) {
    case SurfaceZone::none: break;
    case SurfaceZone::face: return {0.3F, 1.0F, 0.15F, 0.7F};
    case SurfaceZone::shoulder: return {0.45F, 2.0F, 0.3F, 0.9F};
    case SurfaceZone::foot:
    case SurfaceZone::upper_edge: return {1.0F, kNever, 0.6F, 1.5F};
    case SurfaceZone::outer_edge: return {2.0F * wear, 1.8F * wear, 0.5F * wear, 4.0F};
    case SurfaceZone::corner: return {1.4F * wear, kNever, 0.5F, 4.0F};
    case SurfaceZone::behind_edge: return {2.0F * wear, 0.6F * wear, 0.3F * wear, 4.0F};
  }
  return {kNever, kNever, kNever, kNever};
}

/// True if the zone is open towards an edge.
bool is_open(SurfaceZone zone) {
  return zone == SurfaceZone::outer_edge || zone == SurfaceZone::corner || zone == SurfaceZone::behind_edge ||
         zone == SurfaceZone::upper_edge;
}

enum Mark : std::uint8_t { kWhole, kWeak, kLow, kEmpty, kHigh };
/// Flag in the stack for a cell without a low surface that weak cells could join.
constexpr std::uint32_t kNotLow = 1U << 31U;

// Limits of reported places, mm and mm^2.
constexpr double kPoreArea_mm2 = 1.75;  ///< 1.5 mm diameter; smaller ones are at most a cell
constexpr double kPoreDepth_mm = 0.3;
/// A place wider than a pore that is this far off is damage: twice the residual of cast concrete and a scanner's form
/// error.
constexpr double kDisplaced_mm = 1.0;
constexpr double kDisplacedShoulder_mm = 2.0;  ///< shoulders undulate
double displaced_mm(FindingFace face) {
  return face == FindingFace::shoulder_inner || face == FindingFace::shoulder_outer ? kDisplacedShoulder_mm
                                                                                    : kDisplaced_mm;
}
/// Share of kDisplaced_mm and kDisplacedShoulder_mm that is the residual of cast concrete and a scanner's form error.
constexpr double kResidual = 0.5;
/// A shallow place wider than this may be the block's form.
constexpr double kForm_mm = 20.0;
constexpr double kMissing_mm2 = limits::kFindingArea_mm2;  ///< a drop of water of 9 mm hides 64
constexpr double kBump_mm2 = 20.0;                         ///< a burr of 4 mm has 13
/// A place at an edge is a chip if it is deeper than any pore, or larger than nearly all of them; pores also occur at
/// edges.
constexpr double kChipDepth_mm = 3.2;
constexpr double kChipExtent_mm = 4.0;
constexpr double kChip_mm2 = 8.0;
/// A long chip is deeper than the deviation of worn chamfers (120 good blocks: at most 1.2 mm and 19 mm^3; the smallest
/// chips of 10 mm at a seat's end: 1.5 mm, 28 mm^3).
constexpr double kLongChip_mm = 6.5;
constexpr double kLongChipDepth_mm = 1.35;
constexpr double kLongChip_mm3 = 23.0;
/// ... and extends further inward than a pore in the chamfer, or is longer than one.
constexpr double kLongChipAcross_mm = 3.5;
constexpr double kNarrowChip_mm = 9.5;
/// A pore in an edge is round. A chip is half of that, longer along the edge than inward; or, if it extends down both
/// faces, as large and deep as few pores are.
constexpr double kChipAspect = 1.25;
constexpr double kRoundChip_mm2 = 48.0;
constexpr double kRoundChipDepth_mm = 2.5;
/// In a corner two chamfers meet (good ones are up to 1.9 mm off), and much of a broken corner is too steep to return
/// points (in a good one, up to nine cells).
constexpr double kCornerDepth_mm = 2.0;
constexpr double kCorner_mm2 = 9.0;
constexpr std::size_t kCornerCells = 5;
constexpr double kCornerEmpty = 10.0;
constexpr std::size_t kCornerEmptyInside = 6;
/// Narrower ones are along the border of the field of view.
constexpr double kCornerEmptyAcross_mm = 5.0;
constexpr double kCornerExtent_mm = 5.4;
/// A good corner may be empty at its very tip or entirely, but is not low with a steep part next to it.
constexpr double kSteepDepth_mm = 1.6;
constexpr std::size_t kSteepEmpty = 3;
constexpr std::size_t kChipCells = 3;
/// Minimum of these on the edge itself: a place behind it is a pore near an edge.
constexpr std::size_t kChipCellsOnEdge = 2;
constexpr double kCrackLength_mm = 25.0;
constexpr double kCrackWidth_mm = 3.0;

FindingFace finding_face(Face face) {
  switch (face) {
    case Face::jaw_inner: return FindingFace::jaw_inner;
    case Face::jaw_outer: return FindingFace::jaw_outer;
    case Face::shoulder_inner: return FindingFace::shoulder_inner;
    case Face::shoulder_outer: return FindingFace::shoulder_outer;
    default: return FindingFace::seat;
  }
}

/// Sums over the cells of a place.
class Place {
 public:
  Place(const BlockModel& model, const SurfaceTable& table, const SurfaceField& field)
      : model_(model), across_(table), table_(table.cells()), field_(field) {}

  void add(std::size_t i, double share) {
    const auto face = static_cast<std::size_t>(table_[i] & kFaceBits);
    const double stretch = 1.0 / model_.planes()[face].n.z();
    const double x = surface_x_mm(i % kColumns);
    const double y = surface_y_mm(i / kColumns);
    const double v = across_.across_mm(i / kColumns);
    if (cells_ == 0) {
      first_u_ = x;
      first_v_ = v;
    }
    const double du = x - first_u_;
    const double dv = v - first_v_;
    ++cells_;
    ++by_face_[face];
    x_ += x;
    y_ += y;
    u_ += du;
    v_ += dv;
    uu_ += du * du;
    uv_ += du * dv;
    vv_ += dv * dv;
    low_x_ = std::min(low_x_, x);
    high_x_ = std::max(high_x_, x);
    low_v_ = std::min(low_v_, v);
    high_v_ = std::max(high_v_, v);
    stretch_ = std::max(stretch_, stretch);
    area_ += share * kCellArea_mm2 * stretch;
    if (field_.zone[i] == SurfaceZone::corner) ++at_corner_;
    if (!field_.seen(i)) {
      ++empty_;
      if (end_of(table_[i]) + side_of(table_[i]) > kTipSteps) ++empty_inside_;
      return;
    }
    const auto off = static_cast<double>(std::abs(field_.off[i]));
    const double cover = std::max(static_cast<double>(field_.cover[i]), 0.3);
    deepest_ = std::max(deepest_, off / cover);
    furthest_ = std::max(furthest_, off);
    volume_ += off * kCellArea_mm2 * stretch;
    if (is_open(field_.zone[i])) ++at_edge_;
    if (is_open(field_.zone[i]) && field_.zone[i] != SurfaceZone::behind_edge) ++on_edge_;
  }

  [[nodiscard]] std::size_t cells() const { return cells_; }
  [[nodiscard]] std::size_t empty() const { return empty_; }
  /// ... without a corner's tip, which chamfers make steep.
  [[nodiscard]] std::size_t empty_inside() const { return empty_inside_; }
  [[nodiscard]] std::size_t at_edge() const { return at_edge_; }
  /// ... on the edge, not only behind it.
  [[nodiscard]] std::size_t on_edge() const { return on_edge_; }
  [[nodiscard]] std::size_t at_corner() const { return at_corner_; }
  [[nodiscard]] double area_mm2() const { return area_; }
  [[nodiscard]] double deepest_mm() const { return deepest_; }
  /// The largest mean deviation of a whole cell.
  [[nodiscard]] double furthest_mm() const { return furthest_; }
  [[nodiscard]] double volume_mm3() const { return volume_; }
  /// Longest extent, along the principal direction of the place, computed from its spread as for a place of uniform
  /// width.
  [[nodiscard]] double extent_mm() const {
    const auto n = static_cast<double>(cells_);
    const double a = uu_ / n - u_ / n * u_ / n;
    const double b = uv_ / n - u_ / n * v_ / n;
    const double c = vv_ / n - v_ / n * v_ / n;
    const double largest = 0.5 * (a + c) + std::sqrt(0.25 * (a - c) * (a - c) + b * b);
    const double by_spread = std::sqrt(12.0 * largest + kSurfaceCell_mm * kSurfaceCell_mm);
    return std::min(by_spread,
                    std::hypot(high_x_ - low_x_ + kSurfaceCell_mm, high_v_ - low_v_ + stretch_ * kSurfaceCell_mm));
  }
  [[nodiscard]] SurfaceFinding finding() const {
    const auto face = static_cast<std::size_t>(std::max_element(by_face_.begin(), by_face_.end()) - by_face_.begin());
    const auto n = static_cast<double>(cells_);
    SurfaceFinding f;
    f.face = finding_face(static_cast<Face>(face));
    const double x = x_ / n;
    const double y = y_ / n;
    f.x_mm = x;
    f.z_mm = model_.planes()[face].z_at(x, y);
    f.s_mm = model_.along_seat().dot(Vec3(x, y, f.z_mm));
    f.length_mm = high_x_ - low_x_ + kSurfaceCell_mm;
    f.width_mm = high_v_ - low_v_ + kSurfaceCell_mm * stretch_;
    f.area_mm2 = area_;
    if (deepest_ > 0.0) {
      f.depth_mm = deepest_;
      f.volume_mm3 = volume_;
    }
    return f;
  }

 private:
  const BlockModel& model_;
  const SurfaceTable& across_;
  std::span<const std::uint16_t> table_;
  const SurfaceField& field_;
  std::array<std::uint32_t, 16> by_face_{};
  static constexpr std::size_t kTipSteps = 3;
  std::size_t cells_ = 0, empty_ = 0, empty_inside_ = 0, at_edge_ = 0, on_edge_ = 0, at_corner_ = 0;
  double first_u_ = 0.0, first_v_ = 0.0;
  double x_ = 0.0, y_ = 0.0, u_ = 0.0, v_ = 0.0, uu_ = 0.0, uv_ = 0.0, vv_ = 0.0;
  double low_x_ = 1e9, high_x_ = -1e9, low_v_ = 1e9, high_v_ = -1e9;
  double stretch_ = 0.0, area_ = 0.0, deepest_ = 0.0, furthest_ = 0.0, volume_ = 0.0;
};

/// Classifies a place of low or empty cells. False if it is not reported.
bool name_low(const Place& place, double pore_max_mm, double edge_wear, FoundSurface& found) {
  SurfaceFinding& f = found.finding;
  const double area = place.area_mm2();
  const std::size_t low = place.cells() - place.empty();
  const double furthest = place.furthest_mm() / edge_wear;
  const bool deep = furthest >= kChipDepth_mm && found.extent_mm >= kChipExtent_mm && area >= kChip_mm2;
  const double across = std::min(f.length_mm, f.width_mm);
  const bool no_pore = std::max(f.length_mm, f.width_mm) >= kChipAspect * across ||
                       (area >= kRoundChip_mm2 && furthest >= kRoundChipDepth_mm);
  const bool wide = no_pore && found.extent_mm >= kLongChip_mm &&
                    (across >= kLongChipAcross_mm || found.extent_mm >= kNarrowChip_mm) &&
                    furthest >= kLongChipDepth_mm && place.volume_mm3() >= edge_wear * edge_wear * kLongChip_mm3;
  const bool corner =
      place.at_corner() >= kCornerCells &&
      ((furthest >= kCornerDepth_mm && found.extent_mm >= kChipExtent_mm && area >= kCorner_mm2) ||
       (furthest >= kSteepDepth_mm && place.empty_inside() >= kSteepEmpty) ||
       (static_cast<double>(place.empty()) >= edge_wear * kCornerEmpty && place.empty_inside() >= kCornerEmptyInside &&
        across >= kCornerEmptyAcross_mm && found.extent_mm >= edge_wear * kCornerExtent_mm));
  if (corner || (place.at_edge() >= kChipCells && place.on_edge() >= kChipCellsOnEdge && (deep || wide))) {
    f.kind = FindingKind::chip;
    return true;
  }
  // The walls of a deep hole hide most of its floor.
  if (place.empty() > low && !(low > 0 && place.deepest_mm() >= kDisplaced_mm)) {
    f.kind = FindingKind::missing;
    return area >= kMissing_mm2;
  }
  if (found.extent_mm >= kCrackLength_mm && area <= kCrackWidth_mm * found.extent_mm) {
    f.kind = FindingKind::crack;
    return true;
  }
  f.kind = FindingKind::pit;
  const double displaced = displaced_mm(f.face);
  if (found.diameter_mm <= pore_max_mm && found.extent_mm <= 2.0 * pore_max_mm) {
    found.is_pore = true;
    return area >= kPoreArea_mm2 && place.deepest_mm() >= kPoreDepth_mm;
  }
  if (place.deepest_mm() >= displaced) return true;
  // Mostly unseen, with a rim that is low.
  if (place.empty() > low && area >= kMissing_mm2) {
    f.kind = FindingKind::missing;
    return true;
  }
  // Wider than a pore and too shallow for damage: a pore beyond its limit. What is wider still, or as shallow as the
  // residual, cannot be told from the block's form.
  found.is_pore = found.extent_mm <= kForm_mm && place.deepest_mm() >= kResidual * displaced;
  return found.is_pore;
}

bool name_high(const Place& place, FoundSurface& found) {
  found.finding.kind = FindingKind::bump;
  return place.area_mm2() >= kBump_mm2 && place.deepest_mm() >= displaced_mm(found.finding.face);
}

void keep_largest(const FoundSurface& found, FixedVector<FoundSurface, limits::kFindingsMax>& list) {
  if (!list.push(found)) {
    if (!(found.finding.area_mm2 > list[list.size() - 1].finding.area_mm2)) return;
    list[list.size() - 1] = found;
  }
  for (std::size_t i = list.size() - 1; i > 0 && list[i].finding.area_mm2 > list[i - 1].finding.area_mm2; --i)
    std::swap(list[i], list[i - 1]);
}

}  // namespace

void FoundSurfaces::add(const FoundSurface& found) {
  if (found.is_pore) {
    ++pore_count;
    pore_area_mm2 += found.finding.area_mm2;
    pore_largest_mm = std::max(pore_largest_mm, found.diameter_mm);
    pore_deepest_mm = std::max(pore_deepest_mm, found.finding.depth_mm);
    keep_largest(found, pores);
    return;
  }
  if (found.extent_mm > damage_extent_mm) {
    damage_extent_mm = found.extent_mm;
    damage_depth_mm = found.finding.depth_mm;
  }
  keep_largest(found, damage);
}

void group_cells(const BlockModel& model, const SurfaceTable& table, const SurfaceField& field, double pore_max_mm,
                 std::span<std::uint8_t> marks, std::span<std::uint32_t> stack, FoundSurfaces& found) {
  std::array<Limits, kZones> limits_in;
  for (std::size_t zone = 0; zone < kZones; ++zone)
    limits_in[zone] = limits_of(static_cast<SurfaceZone>(zone), field.edge_wear);
  std::array<double, kFaces> cell_mm2;
  for (std::size_t face = 0; face < kFaces; ++face) cell_mm2[face] = kCellArea_mm2 / model.planes()[face].n.z();
  for (std::size_t i = 0; i < kCells; ++i) {
    marks[i] = kWhole;
    const SurfaceZone zone = field.zone[i];
    if (zone == SurfaceZone::none) continue;
    if (!field.seen(i)) {
      marks[i] = kEmpty;
      continue;
    }
    found.seen_mm2 += cell_mm2[table.cells()[i] & kFaceBits];
    const Limits& limit = limits_in[static_cast<std::size_t>(zone)];
    const float off = field.off[i];
    if (off < -limit.low || field.face_off[i] < -limit.low_of_face)
      marks[i] = kLow;
    else if (off > limit.high)
      marks[i] = kHigh;
    else if (field.face_off[i] < -limit.weak_of_face)
      marks[i] = kWeak;
  }
  for (std::size_t first = 0; first < kCells; ++first) {
    const std::uint8_t mark = marks[first];
    if (mark < kLow) continue;
    const bool high = mark == kHigh;
    // A hole is partly visible: its floor is low, and the part hidden by its walls is empty.
    const auto belongs = [&](std::uint8_t other, std::uint8_t to) {
      return high ? other == kHigh : other == kLow || other == kEmpty || (other == kWeak && to == kLow);
    };
    Place place(model, table, field);
    std::size_t count = 0;
    const auto take = [&](std::size_t i) {
      const std::uint8_t own = marks[i];
      marks[i] = kWhole;
      // Weak cells are the rim of a place. They contribute a part of their area, but do not connect other cells. At an
      // edge the expected value is too uncertain for a partial area.
      const bool whole = own == kEmpty || is_open(field.zone[i]);
      place.add(i, whole ? 1.0 : static_cast<double>(field.cover[i]));
      if (own != kWeak) stack[count++] = static_cast<std::uint32_t>(i) | (own == kLow ? 0U : kNotLow);
    };
    take(first);
    for (std::size_t next = 0; next < count; ++next) {
      const std::uint8_t own = (stack[next] & kNotLow) != 0 ? std::uint8_t{kEmpty} : std::uint8_t{kLow};
      const std::size_t cell = stack[next] & ~kNotLow;
      const std::size_t column = cell % kColumns;
      const std::size_t row = cell / kColumns;
      for (std::size_t r = row - std::min<std::size_t>(row, 1); r <= std::min(row + 1, kRows - 1); ++r)
        for (std::size_t k = column - std::min<std::size_t>(column, 1); k <= std::min(column + 1, kColumns - 1); ++k)
          if (belongs(marks[r * kColumns + k], own)) take(r * kColumns + k);
    }
    FoundSurface one;
    one.finding = place.finding();
    one.extent_mm = place.extent_mm();
    one.diameter_mm = std::sqrt(4.0 / kPi * place.area_mm2());
    if (high ? name_high(place, one) : name_low(place, pore_max_mm, field.edge_wear, one)) found.add(one);
  }
}

void add_crack(const BlockModel& model, const SurfaceTable& table, const CrackPath& path, SurfaceField& field,
               FoundSurfaces& found) {
  constexpr std::size_t kBeside = 1;
  Place place(model, table, field);
  Place on_path(model, table, field);
  double length = 0.0;
  double low_aside = 1e9, high_aside = -1e9;
  const std::size_t across = path.along_y ? kColumns : kRows;
  for (std::size_t k = 0; k < path.steps; ++k) {
    const std::size_t at = path.at[k];
    const std::size_t step = path.first + k;
    const double aside =
        k == 0 ? 0.0 : kSurfaceCell_mm * (static_cast<double>(at) - static_cast<double>(path.at[k - 1]));
    length += std::hypot(kSurfaceCell_mm * static_cast<double>(kCrackStep), aside);
    low_aside = std::min(low_aside, kSurfaceCell_mm * static_cast<double>(at));
    high_aside = std::max(high_aside, kSurfaceCell_mm * static_cast<double>(at));
    for (std::size_t along = kCrackStep * step; along < kCrackStep * (step + 1); ++along) {
      for (std::size_t beside = at - std::min(at, kBeside); beside <= std::min(at + 1 + kBeside, across - 1);
           ++beside) {
        const std::size_t i = path.along_y ? along * kColumns + beside : beside * kColumns + along;
        if (field.zone[i] == SurfaceZone::none) continue;
        const bool is_low = !field.seen(i) || field.off[i] < -kSurfaceOff_mm;
        if (is_low) place.add(i, 1.0);
        // A crack without points that leaves points in every cell has no low cell.
        if (!is_low && beside == at) on_path.add(i, 1.0);
        field.zone[i] = SurfaceZone::none;
      }
    }
  }
  FoundSurface one;
  if (place.cells() == 0 && on_path.cells() == 0) return;
  one.finding = place.cells() != 0 ? place.finding() : on_path.finding();
  if (place.cells() == 0) {
    one.finding.depth_mm = kNoValue;
    one.finding.volume_mm3 = kNoValue;
  }
  one.finding.kind = FindingKind::crack;
  one.finding.area_mm2 = path.missing * kCellArea_mm2;
  // As long as its path, even if few of its cells are low.
  const double along = kSurfaceCell_mm * static_cast<double>(kCrackStep * path.steps);
  const double aside = high_aside - low_aside + 2.0 * kSurfaceCell_mm;
  one.finding.length_mm = path.along_y ? aside : along;
  one.finding.width_mm = path.along_y ? along : aside;
  one.extent_mm = length;
  one.diameter_mm = std::sqrt(4.0 / kPi * one.finding.area_mm2);
  found.add(one);
}

}  // namespace slabd::algo
