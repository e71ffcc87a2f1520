// SPDX-License-Identifier: Apache-2.0
//
// Search for pores and damage, step by step: expected values of each cell (surface_reference.h), cracks
// (surface_damage.h), displaced or missing places (surface_damage.h), and the recipe's items.
#include "algo/survey/surface_damage.h"

#include <algorithm>
#include <array>
#include <cmath>
#include <optional>

#include "algo/survey/surface_reference.h"

namespace slabd::algo {

// Problem: a crack is narrower than a cell of the raster, and may return no points at all. In a single cell it cannot
// be distinguished from noise.
//
// Idea: a crack is long. A window is two cells wide and three long (4 mm); the part of its surface missing relative to
// the windows left and right of it is evidence. Evidence minus a limit is summed along the best path, by dynamic
// programming: noise sums to nothing within a few steps, a crack of 25 mm does not. Compact places, such as a pore or a
// drop of water, are not long enough.

namespace {

/// Minimum missing share of a window that indicates a crack. A crack of 0.8 mm has 0.32; the grid of a scan of 0.35 mm
/// pitch has 0.06 (1 sigma).
constexpr float kLimitMin = 0.15F;
/// Pixels of 0.5 mm alias with the cells: every few windows a whole line of them lacks up to 0.2. The limit is this
/// many times the share exceeded by one window in twenty.
constexpr float kOfScatter = 1.25F;
/// With a higher limit a crack of 0.8 mm cannot be distinguished from the grid.
constexpr float kLimitMax = 0.26F;
/// Upper limit of a window's evidence, so that a hole is not a crack.
constexpr float kMost = 0.45F;
/// Minimum sum over the path of a crack, and its minimum length in steps: 26 mm.
constexpr float kStrengthMin = 1.5F;
constexpr std::size_t kStepsMin = 7;
/// Minimum mean over a path beyond the limit, and minimum straightness: a path through an area of uneven density has
/// neither.
constexpr float kMeanMin = 0.035F;
constexpr double kStraight = 0.7;
constexpr float kAside = 0.025F;  ///< cost of a sideways move by one cell
/// Cells between a window and its neighbours.
constexpr std::size_t kGap = 1;
constexpr std::size_t kWidth = 2;
constexpr std::size_t kReach = 3;  ///< largest sideways move of a path per step
constexpr float kWholeMin = 0.5F;  ///< of a neighbouring window, so that the missing part is not its own

struct Node {
  float strength = 0.0F;
  std::uint8_t from = 0;  ///< kReach + sideways move of the path; kStart: the path starts here
  static constexpr std::uint8_t kStart = 255;
};

/// The raster read along either axis.
struct View {
  const SurfaceField& field;
  bool along_y;
  std::size_t across;
  std::size_t steps;

  [[nodiscard]] std::size_t cell(std::size_t step, std::size_t k, std::size_t at) const {
    const std::size_t along = kCrackStep * step + k;
    return along_y ? along * kSurfaceColumns + at : at * kSurfaceColumns + along;
  }
  /// The surface along an edge is curved, which is not a crack; but a crack may extend to a jaw's foot.
  [[nodiscard]] bool is_asked(std::size_t cell) const {
    const SurfaceZone zone = field.zone[cell];
    return zone == SurfaceZone::face || zone == SurfaceZone::shoulder ||
           (along_y && (zone == SurfaceZone::foot || zone == SurfaceZone::upper_edge));
  }
};

/// Share of the surface in each cell of a step, its three cells together; negative if a cell is excluded.
void gather(const View& view, std::size_t step, std::span<float> whole) {
  std::fill(whole.begin(), whole.end(), 0.0F);
  for (std::size_t k = 0; k < kCrackStep; ++k)
    for (std::size_t at = 0; at < view.across; ++at) {
      const std::size_t cell = view.cell(step, k, at);
      whole[at] = view.is_asked(cell) ? whole[at] + view.field.whole[cell] : -100.0F;
    }
  for (float& share : whole) share /= static_cast<float>(kCrackStep);
}

/// Missing share of the window at `at` relative to its neighbours, or a negative number.
float lack(std::span<const float> whole, std::size_t at) {
  constexpr std::size_t kFlank = kWidth + kGap;
  if (at < kFlank || at + kFlank + kWidth > whole.size()) return -1.0F;
  const auto window = [&](std::size_t i) { return 0.5F * (whole[i] + whole[i + 1]); };
  const float here = window(at);
  const float left = window(at - kFlank);
  const float right = window(at + kFlank);
  if (here < 0.0F || left < kWholeMin || right < kWholeMin) return -1.0F;
  // An area of lower density is bordered by a step, not by a line.
  const float beside = std::min(0.5F * (left + right), 1.15F * std::min(left, right));
  return std::min(1.0F - here / beside, kMost);
}

/// Missing share exceeded by one window in twenty.
float usual_lack(std::span<const float> lacks) {
  constexpr std::size_t kBins = 128;
  constexpr float kBinsPerShare = static_cast<float>(kBins) / kMost;
  std::array<std::uint32_t, kBins> counts{};
  std::uint32_t asked = 0;
  for (const float lack : lacks) {
    if (lack <= -1.0F) continue;
    ++asked;
    ++counts[std::min(static_cast<std::size_t>(std::max(lack, 0.0F) * kBinsPerShare), kBins - 1)];
  }
  std::uint32_t above = 0;
  for (std::size_t k = kBins; k-- > 0;) {
    above += counts[k];
    if (20 * above >= asked) return static_cast<float>(k + 1) / kBinsPerShare;
  }
  return 0.0F;
}

bool is_straight(const CrackPath& path) {
  const auto steps = static_cast<double>(kCrackStep);
  double length = 0.0;
  for (std::size_t k = 1; k < path.steps; ++k)
    length += std::hypot(steps, static_cast<double>(path.at[k]) - static_cast<double>(path.at[k - 1]));
  const double across = static_cast<double>(path.at[path.steps - 1U]) - static_cast<double>(path.at[0]);
  return std::hypot(steps * (path.steps - 1), across) >= kStraight * length;
}

/// Extends the strongest paths step by step. Returns the node at the end of the strongest one.
std::size_t extend_paths(const View& view, std::span<const float> lacks, float limit, std::span<Node> nodes) {
  std::size_t best = 0;
  float strongest_before = 0.0F;
  for (std::size_t step = 0; step < view.steps; ++step) {
    float strongest = 0.0F;
    for (std::size_t at = 0; at < view.across; ++at) {
      const std::size_t i = step * view.across + at;
      Node node{0.0F, Node::kStart};
      // Few windows have evidence, and few paths continue.
      if (lacks[i] - limit + strongest_before <= 0.0F) {
        nodes[i] = node;
        continue;
      }
      if (strongest_before > 0.0F) {
        const std::span<const Node> before = nodes.subspan((step - 1) * view.across, view.across);
        const std::size_t low = at - std::min(at, kReach);
        const std::size_t high = std::min(at + kReach, view.across - 1);
        for (std::size_t k = low; k <= high; ++k) {
          const float strength = before[k].strength - kAside * static_cast<float>(k > at ? k - at : at - k);
          if (strength > node.strength) node = {strength, static_cast<std::uint8_t>(kReach + k - at)};
        }
      }
      node.strength = std::max(0.0F, node.strength + lacks[i] - limit);
      if (node.strength == 0.0F) node.from = Node::kStart;
      nodes[i] = node;
      strongest = std::max(strongest, node.strength);
      if (node.strength > nodes[best].strength) best = i;
    }
    strongest_before = strongest;
  }
  return best;
}

/// The path that ends at node `end`, from its start. Its windows and those near it are not used again.
CrackPath trace_path(const View& view, std::span<const Node> nodes, std::size_t end, std::span<float> lacks) {
  CrackPath path;
  path.along_y = view.along_y;
  path.strength = static_cast<double>(nodes[end].strength);
  std::size_t step = end / view.across;
  std::size_t at = end % view.across;
  for (;;) {
    path.at[path.steps++] = static_cast<std::uint16_t>(at);
    path.first = static_cast<std::uint16_t>(step);
    const std::span<float> row = lacks.subspan(step * view.across, view.across);
    path.missing += static_cast<double>(std::max(row[at], 0.0F)) * static_cast<double>(kWidth * kCrackStep);
    const std::uint8_t from = nodes[step * view.across + at].from;
    const std::size_t low = at - std::min(at, 2 * kReach);
    const std::size_t high = std::min(at + 2 * kReach, view.across - 1);
    for (std::size_t k = low; k <= high; ++k) row[k] = std::min(row[k], 0.0F);
    if (from == Node::kStart || step == 0) break;
    at = at + from - kReach;
    --step;
  }
  std::reverse(path.at.begin(), path.at.begin() + path.steps);
  return path;
}

}  // namespace

bool find_cracks(const SurfaceField& field, bool along_y, std::span<std::byte> memory, CrackPaths& paths) {
  paths.clear();
  const View view{field, along_y, along_y ? kSurfaceColumns : kSurfaceRows,
                  (along_y ? kSurfaceRows : kSurfaceColumns) / kCrackStep};
  constexpr std::size_t kWindows = kSurfaceCells / kCrackStep;
  static_assert(kWindows * (sizeof(Node) + sizeof(float)) <= kCrackBytes);
  static_assert(kSurfaceRows / kCrackStep <= CrackPath::kStepsMax);
  const std::size_t windows = view.steps * view.across;
  const std::span<Node> nodes(reinterpret_cast<Node*>(memory.data()), windows);
  const std::span<float> lacks(reinterpret_cast<float*>(memory.data() + kWindows * sizeof(Node)), windows);
  std::array<float, std::max(kSurfaceRows, kSurfaceColumns)> whole;
  for (std::size_t step = 0; step < view.steps; ++step) {
    gather(view, step, std::span(whole).first(view.across));
    for (std::size_t at = 0; at < view.across; ++at)
      lacks[step * view.across + at] = lack(std::span(whole).first(view.across), at);
  }

  const float limit = std::max(kLimitMin, kOfScatter * usual_lack(lacks));
  if (limit > kLimitMax) return false;

  // A strong path may be too short for a crack; then it is skipped.
  for (std::size_t tries = 0; tries < 2 * kCracksMax && paths.size() < kCracksMax; ++tries) {
    const std::size_t end = extend_paths(view, lacks, limit, nodes);
    if (!(nodes[end].strength >= kStrengthMin)) return true;
    const CrackPath path = trace_path(view, nodes, end, lacks);
    if (path.steps >= kStepsMin && path.strength >= static_cast<double>(kMeanMin) * path.steps && is_straight(path))
      (void)paths.push(path);
  }
  return true;
}

namespace {

constexpr std::size_t kColumns = kSurfaceColumns;
constexpr std::size_t kCells = kSurfaceCells;
/// Upper limit of pores if the recipe has none.
constexpr double kPoreUnlimited_mm = 12.0;

/// The field of view: the convex hull of the deviation map's cells with points, at the intersections of the rays from
/// `eye` with z = 0 in the block's frame. Rays from one centre see more of the slab's top than of a shoulder.
class FieldOfView {
 public:
  FieldOfView(const DeviationMap& map, std::optional<Vec3> eye) : map_(map), eye_(eye) {
    left_.fill(kOutside);
    right_.fill(-kOutside);
  }
  /// `p`: position of a cell with points.
  void add(const Vec3& p) {
    const Place place = place_of(p);
    if (!(place.row >= 0.0 && place.row < static_cast<double>(map_.rows))) return;
    const auto at = static_cast<std::size_t>(place.row + 0.5);
    if (at >= map_.rows) return;
    left_[at] = std::min(left_[at], place.column);
    right_[at] = std::max(right_[at], place.column);
  }
  /// Completes the hull after the last position.
  void close() {
    bulge_out(left_, 1.0);
    bulge_out(right_, -1.0);
  }
  /// True if this position of the block is inside, by `margin` cells of the map.
  [[nodiscard]] bool surrounds(const Vec3& p, double margin) const {
    const auto [column, row] = place_of(p);
    const double low = std::floor(row - margin);
    const double high = std::ceil(row + margin);
    if (!(low >= 0.0 && high < static_cast<double>(map_.rows))) return false;
    const auto first = static_cast<std::size_t>(low);
    const auto last = static_cast<std::size_t>(high);
    const auto below = static_cast<std::size_t>(row);
    const std::size_t above = std::min(below + 1, last);
    return column > std::max(left_[below], left_[above]) + margin &&
           column < std::min(right_[below], right_[above]) - margin && left_[first] < kOutside &&
           left_[last] < kOutside;
  }

 private:
  static constexpr double kOutside = 1e9;
  static constexpr std::size_t kRowsMax = limits::kFaceTableY / limits::kDeviationMapCell_mm;
  using Side = std::array<double, kRowsMax>;
  struct Place {
    double column, row;  ///< in cells of the map, from the centre of the first one
  };
  [[nodiscard]] Place place_of(const Vec3& p) const {
    const Vec3 at = eye_ ? Vec3(*eye_ + (p - *eye_) * (eye_->z() / (eye_->z() - p.z()))) : p;
    return {at.x() / map_.cell_mm + 0.5 * static_cast<double>(map_.columns) - 0.5,
            at.y() / map_.cell_mm + 0.5 * static_cast<double>(map_.rows) - 0.5};
  }

  /// Makes one side of all rows convex; `sign` 1: the left one.
  void bulge_out(Side& side, double sign) const {
    std::array<std::size_t, kRowsMax> corner;
    std::size_t corners = 0;
    for (std::size_t row = 0; row < map_.rows; ++row) {
      if (std::abs(side[row]) >= kOutside) continue;
      const auto is_inside = [&] {
        const std::size_t a = corner[corners - 2];
        const std::size_t b = corner[corners - 1];
        const double by_line =
            side[a] + (side[row] - side[a]) * static_cast<double>(b - a) / static_cast<double>(row - a);
        return sign * (side[b] - by_line) >= 0.0;
      };
      while (corners >= 2 && is_inside()) --corners;
      corner[corners++] = row;
    }
    for (std::size_t k = 0; k + 1 < corners; ++k)
      for (std::size_t row = corner[k] + 1; row < corner[k + 1]; ++row)
        side[row] = side[corner[k]] + (side[corner[k + 1]] - side[corner[k]]) * static_cast<double>(row - corner[k]) /
                                          static_cast<double>(corner[k + 1] - corner[k]);
  }

  const DeviationMap& map_;
  std::optional<Vec3> eye_;
  Side left_;
  Side right_;
};

/// Minimum number of points in a usual cell of the seat, so that a cell without points is a hole in the surface and not
/// in the scan: a pitch of up to 0.6 mm in both directions.
constexpr double kUsualMin = 4.0;

/// True if enough of every face was seen for a verdict without findings. The field of view may end before a shoulder
/// does.
bool saw_enough(const SurfaceTable& table, const SurfaceField& field) {
  std::array<std::uint32_t, kFaces> all{};
  std::array<std::uint32_t, kFaces> seen{};
  surface_cell::for_cells_of(table, [&](std::size_t i) {
    const std::uint16_t entry = table.cells()[i];
    if (!surface_cell::is_judged(entry)) return;
    const auto face = static_cast<std::size_t>(surface_cell::face_of(entry));
    ++all[face];
    if (field.seen(i)) ++seen[face];
  });
  constexpr double kOfSeat = 0.75, kOfJaw = 0.6, kOfShoulder = 0.1;
  for (std::size_t face = 0; face < kFaces; ++face) {
    const bool shoulder = face == static_cast<std::size_t>(Face::shoulder_inner) ||
                          face == static_cast<std::size_t>(Face::shoulder_outer);
    const double least = face == static_cast<std::size_t>(Face::seat) ? kOfSeat : shoulder ? kOfShoulder : kOfJaw;
    if (static_cast<double>(seen[face]) < least * static_cast<double>(all[face])) return false;
  }
  return true;
}

/// Marks cells beyond the field of view: cells without points, with no points of the scan further out in x and in y. It
/// is unknown whether the scanner's rays are parallel, so both cases are tested.
void leave_out_beyond_view(const BlockModel& model, const SurfaceTable& table, const DeviationMap& map, const Vec3& eye,
                           SurfaceField& field) {
  constexpr double kMargin = 1.0, kMarginCentral = 0.25;
  constexpr std::uint32_t kSeenMin = 3;  // fewer points in a cell of the map are strays
  FieldOfView parallel(map, std::nullopt);
  FieldOfView central(map, eye);
  for (std::size_t row = 0; row < map.rows; ++row) {
    // Cells of equal height in a row of the map keep their order from either eye: the first and the last one are
    // enough.
    std::optional<Vec3> last;
    const auto add = [&](const Vec3& p) {
      parallel.add(p);
      central.add(p);
    };
    for (std::size_t column = 0; column < map.columns; ++column) {
      if (map.count[row * map.columns + column] < kSeenMin) continue;
      Vec3 p(map.x_mm(column), map.y_mm(row), 0.0);
      Face face = Face::top;
      if (!model.visible(p.x(), p.y(), face, p.z())) continue;
      if (last && last->z() != p.z()) add(*last);
      if (!last || last->z() != p.z()) add(p);
      last = p;
    }
    if (last) add(*last);
  }
  parallel.close();
  central.close();
  for (std::size_t row = table.rows()[0]; row < table.rows()[1]; ++row)
    for (std::size_t i = row * kColumns; i < (row + 1) * kColumns; ++i) {
      if (field.zone[i] == SurfaceZone::none || field.seen(i)) continue;
      const double x = surface_x_mm(i % kColumns);
      const double y = surface_y_mm(row);
      const Vec3 p(x, y, model.plane(surface_cell::face_of(table.cells()[i])).z_at(x, y));
      if (!parallel.surrounds(p, kMargin) || !central.surrounds(p, kMarginCentral)) field.zone[i] = SurfaceZone::none;
    }
}

Item* item_of(BlockResult& result, ItemId id) {
  for (Item& item : result.items)
    if (item.id == id) return &item;
  return nullptr;
}

}  // namespace

void find_pores_and_damage(const BlockModel& model, const SurfaceTable& table, std::span<const SurfaceCell> cells,
                           const DeviationMap& map, std::span<float> memory, Team& team, BlockResult& result) {
  result.findings.clear();
  result.pores = {};
  result.edges.clear();
  if (!result.seat.plane.ok) return;
  static_assert(4 * kCells + kCells + kCells / 2 + kCrackBytes / 2 <= kSurfaceFloats);
  float* next = memory.data();
  const auto floats = [&](std::size_t count) {
    const std::span<float> taken(next, count);
    next += count;
    return taken;
  };
  SurfaceField field;
  field.off = floats(kCells);
  field.face_off = floats(kCells);
  field.cover = floats(kCells);
  field.whole = floats(kCells);
  const std::span<std::uint32_t> stack(reinterpret_cast<std::uint32_t*>(floats(kCells).data()), kCells);
  field.zone = {reinterpret_cast<SurfaceZone*>(floats(kCells / 4).data()), kCells};
  const std::span<std::uint8_t> marks(reinterpret_cast<std::uint8_t*>(floats(kCells / 4).data()), kCells);
  const std::array<std::span<std::byte>, 2> crack_memory = {std::as_writable_bytes(floats(kCrackBytes / 4)),
                                                            std::as_writable_bytes(floats(kCrackBytes / 4))};

  compare_with_expected(model, table, cells, result, team, field);
  result.edges = field.edges;
  leave_out_beyond_view(model, table, map, result.registration.T_scanner_block.inverse().translation_mm, field);
  // A coarse scan gives no result: neither damage nor its absence.
  if (field.usual[static_cast<std::size_t>(Face::seat)] < kUsualMin) return;
  std::array<CrackPaths, 2> cracks;
  std::array<bool, 2> told{};
  team.run(2, [&](std::size_t i) { told[i] = find_cracks(field, i == 0, crack_memory[i], cracks[i]); });

  Item* pores = item_of(result, ItemId::surface_pores);
  Item* damage = item_of(result, ItemId::block_damage);
  const double pore_max_mm =
      pores != nullptr && has_value(pores->upper) ? kPoreReserve * pores->upper : kPoreUnlimited_mm;
  FoundSurfaces found;
  for (const CrackPaths& paths : cracks)
    for (const CrackPath& path : paths) add_crack(model, table, path, field, found);
  group_cells(model, table, field, pore_max_mm, marks, stack, found);

  result.pores = {found.pore_count,
                  found.pore_largest_mm,
                  found.pore_deepest_mm,
                  found.seen_mm2 > 0.0 ? found.pore_area_mm2 / found.seen_mm2 : kNoValue,
                  {}};
  for (const FoundSurface& one : found.damage) (void)result.findings.push(one.finding);
  if (!told[0] || !told[1] || !saw_enough(table, field)) return;
  // Damage without a limit or without a value is decided by its findings, so pores must not be among them.
  if (damage != nullptr && has_value(damage->upper))
    for (const FoundSurface& one : found.pores) (void)result.findings.push(one.finding);
  if (pores != nullptr) {
    pores->value = found.pore_largest_mm;
    pores->companion = found.pore_deepest_mm;
  }
  if (damage != nullptr) {
    damage->value = found.damage_extent_mm;
    damage->companion = found.damage_depth_mm;
  }
}

}  // namespace slabd::algo
