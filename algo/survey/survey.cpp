// SPDX-License-Identifier: Apache-2.0
//
// One pass is enough for results that seem to need several:
//
//   - A plane fit selects the points within a threshold, refits, selects again. A scouting pass over a part of the scan
//     (every N-th sixteen) gives the planes of the large faces to a fraction of the noise, and the threshold. The pass
//     then sums the points within the threshold of every plane that close, and lists those for which the exact plane
//     matters: under one per cent. The refits use the sums and the list; their fixed point is that of all points. If it
//     is further off than that, the pass is repeated around it.
//   - The shares within N standard deviations need the standard deviation first. The scouts predict it; points are
//     counted slightly below and slightly above each limit, and the share is interpolated. If the standard deviation is
//     outside that range, the pass is repeated with it.
//
// The scan is divided into fixed blocks. Each has its own sums, added in the order of the blocks, and its own pieces of
// lists, concatenated in that order. So the result does not depend on the threads.
#include "algo/survey/survey.h"

#include <algorithm>
#include <bit>
#include <cmath>

#include "algo/features/jaw.h"

namespace slabd::algo {
namespace {

constexpr std::size_t kBlockPoints = limits::kSurveyBlockPoints;
constexpr std::size_t kLanes = 16;
/// Approximate number of points in the scouting pass.
constexpr std::size_t kScouted = 40'000;
/// Half width of the bracket around a limit of the shares, relative to it. Linear interpolation in between has an error
/// of less than 1e-4.
constexpr double kBracket = 0.02;
/// Half width of the zone around the threshold in which points are listed, relative to it: a quarter of the noise.
constexpr double kEdgeShare = 1.0 / 12.0;
/// Distances are accurate to 1e-5 mm here, so thresholds are at least this.
constexpr double kThresholdMin_mm = 1e-3;
/// Margin of the zone for rounding.
constexpr double kRounding_mm = 3e-5;
/// Maximum number of passes until every plane is within its zone; nearly always one.
constexpr int kPasses = 6;

constexpr std::array<Face, kLargeFaces> kLargeFace = {Face::seat, Face::top};
constexpr std::array<PointList, kLargeFaces> kEdgeList = {PointList::seat_edge, PointList::top_edge};
constexpr std::array<Face, kPointLists> kFaceOfList = {Face::seat, Face::seat, Face::jaw_inner, Face::jaw_outer,
                                                       Face::seat, Face::seat, Face::seat,      Face::top};

SurveyFrame frame_for(const BlockModel& model, const Pose& T_block_scanner) {
  SurveyFrame frame;
  const Vec3 origin = T_block_scanner.inverse().translation_mm;
  Vec3 shift;
  for (int i = 0; i < 3; ++i) {
    frame.shift[static_cast<std::size_t>(i)] = static_cast<float>(origin[i]);
    shift[i] = static_cast<double>(frame.shift[static_cast<std::size_t>(i)]);
  }
  const Mat3 R = T_block_scanner.rotation.toRotationMatrix();
  const Vec3 at_shift = R * shift + T_block_scanner.translation_mm;
  const auto row = [&](const Vec3& direction, double offset) {
    const Vec3 a = R.transpose() * direction;
    return Row{{static_cast<float>(a.x()), static_cast<float>(a.y()), static_cast<float>(a.z())},
               static_cast<float>(direction.dot(at_shift) - offset)};
  };
  frame.x = row(Vec3::UnitX(), 0.0);
  frame.y = row(Vec3::UnitY(), 0.0);
  for (std::size_t f = 0; f < kFaces; ++f) {
    const Plane& plane = model.planes()[f];
    frame.height[f] = row(plane.n, plane.d);
    frame.along[f] = row(plane.n.cross(Vec3::UnitX()), 0.0);
  }
  return frame;
}

/// Everything read of a large face.
constexpr FaceRaster kLargeRaster = FaceRaster::between(
    -0.5 * static_cast<double>(limits::kFaceTableX), 0.5 * static_cast<double>(limits::kFaceTableX),
    -0.5 * static_cast<double>(limits::kFaceTableY), 0.5 * static_cast<double>(limits::kFaceTableY));

/// A jaw from the seat to the shoulder, without edge margins.
FaceRaster raster_of_jaw(const BlockModel& model, const EvaluationSettings& settings, Face jaw, Face shoulder) {
  const FaceEdges edges = edges_of_jaw(model, jaw, shoulder);
  const double half_x = model.geometry().end_half_length_mm.value - settings.edge_margin_mm;
  return FaceRaster::between(-half_x, half_x, std::min(edges.foot_s_mm, edges.top_s_mm) + settings.edge_margin_mm,
                             std::max(edges.foot_s_mm, edges.top_s_mm) - settings.edge_margin_mm);
}

/// First sixteen of a block that is read if every `stride`-th one is. Blocks of 65 536 points are a multiple of the
/// rows of many scanners, and the stride may be too. With equal offsets all blocks would read the same few columns and
/// miss a face beside them. Multiples of the golden ratio do not cluster.
std::size_t first_sixteen(std::size_t block, std::size_t stride) {
  const auto fraction = static_cast<std::uint32_t>(block * 0x9E37'79B9U);
  return static_cast<std::size_t>((std::uint64_t{fraction} * stride) >> 32U);
}

/// Points of each sixteen added to the surface raster: at least six in each of its cells where the scan has as many.
/// `points_per_mm2`: on the seat, in the projection on (x, y). A scan of many points may have few of them there.
std::size_t surface_lanes(const Cloud& cloud, double points_per_mm2) {
  constexpr std::size_t kDense = 2'500'000;
  constexpr std::size_t kSparse = 1'200'000;
  constexpr double kPerCell = 6.0;
  if (cloud.points <= kSparse) return kLanes;
  std::size_t lanes = cloud.points <= kDense ? kLanes / 2 : kLanes / 4;
  if (cloud.width == 0) lanes *= 2;
  const double in_cell = points_per_mm2 * kSurfaceCell_mm * kSurfaceCell_mm / static_cast<double>(kLanes);
  while (lanes < kLanes && in_cell * static_cast<double>(lanes) < kPerCell) lanes *= 2;
  return lanes;
}

/// One pass, merged.
struct Passed {
  SurveySums sums;
  std::array<std::span<const SeatPoints>, kPointLists> runs;
  std::array<std::size_t, kPointLists> points{};
  bool overflown = false;
};

/// `lanes`: see surface_lanes(); 0: without the map and the surface raster.
Passed pass_over(const Cloud& cloud, const SurveyTask& task, std::size_t stride, std::size_t lanes,
                 const SurveyWorkspace& work, Team& team) {
  const bool with_map = lanes != 0;
  const std::size_t blocks = (cloud.points + kBlockPoints - 1) / kBlockPoints;
  work.pool.clear();
  std::array<std::atomic<bool>, 2> taken{};
  const std::size_t slots = with_map ? static_cast<std::size_t>(team.threads()) : 0;
  team.run(slots, [&](std::size_t i) {
    std::fill(work.map[i].sum_nm.begin(), work.map[i].sum_nm.end(), 0);
    std::fill(work.map[i].count.begin(), work.map[i].count.end(), 0U);
    std::fill(work.surface[i].begin(), work.surface[i].end(), SurfaceCell{});
  });
  team.run(blocks, [&](std::size_t b) {
    // Integer sums do not depend on the order, so any unused map is suitable. One thread uses only the first.
    std::size_t slot = 0;
    while (taken[slot].exchange(true, std::memory_order_acquire)) slot = 1 - slot;
    const std::size_t begin = b * kBlockPoints;
    const std::size_t end = std::min(begin + kBlockPoints, cloud.points);
    const std::size_t first = std::min(end, begin + kLanes * first_sixteen(b, stride));
    const std::size_t count = end - first;
    survey_points(cloud.xyz.data() + 3 * first, count, stride, task, work.pool, with_map ? work.map[slot] : MapSums{},
                  with_map ? SurfaceSums{work.surface[slot], lanes, cloud.width, first} : SurfaceSums{},
                  work.blocks[b]);
    taken[slot].store(false, std::memory_order_release);
  });

  if (slots == 2) {
    for (std::size_t i = 0; i < work.map[0].count.size(); ++i) {
      work.map[0].sum_nm[i] += work.map[1].sum_nm[i];
      work.map[0].count[i] += work.map[1].count[i];
    }
    team.run(2, [&](std::size_t half) {
      const std::size_t size = work.surface[0].size();
      for (std::size_t i = half * size / 2; i < (half + 1) * size / 2; ++i) {
        SurfaceCell& sum = work.surface[0][i];
        const SurfaceCell& other = work.surface[1][i];
        sum.sum += other.sum;
        sum.squares += other.squares;
        sum.count += other.count;
      }
    });
  }

  Passed passed;
  passed.overflown = work.pool.overflown();
  SurveySums& all = passed.sums;
  for (std::size_t b = 0; b < blocks; ++b) {
    const SurveySums& one = work.blocks[b];
    all.near += one.near;
    all.sum_mm += one.sum_mm;
    all.sum_mm2 += one.sum_mm2;
    for (std::size_t i = 0; i < all.within.size(); ++i) all.within[i] += one.within[i];
    for (std::size_t i = 0; i < kLargeFaces; ++i) {
      all.moments[i] += one.moments[i];
      all.points[i] += one.points[i];
    }
    for (std::size_t i = 0; i < all.jaw_off.size(); ++i)
      for (std::size_t k = 0; k < FaceRaster::kPlaces; ++k) all.jaw_off[i][k] += one.jaw_off[i][k];
  }
  std::size_t runs = 0;
  // An overflown pool has no more pieces than these either.
  for (std::size_t list = 0; list < kPointLists; ++list) {
    const std::size_t first = runs;
    for (std::size_t b = 0; b < blocks; ++b)
      for (std::uint32_t piece = work.blocks[b].first[list]; piece != PointPool::kNone; piece = work.pool.next(piece)) {
        const SeatPoints points = work.pool.points(piece);
        if (points.size() == 0) continue;
        work.runs[runs++] = points;
        passed.points[list] += points.size();
      }
    passed.runs[list] = work.runs.subspan(first, runs - first);
  }
  return passed;
}

double std_of(const SurveySums& sums) {
  if (!(sums.near >= 2.0)) return kNoValue;
  const double scatter = sums.sum_mm2 - sums.sum_mm * sums.sum_mm / sums.near;
  return std::sqrt(std::fmax(scatter, 0.0) / (sums.near - 1.0));
}

void bracket_shares(double sigma_mm, SurveyTask& task) {
  for (std::size_t k = 0; k < task.share_mm.size() / 2; ++k) {
    const double limit = static_cast<double>(k + 1) * sigma_mm;
    task.share_mm[2 * k] = static_cast<float>((1.0 - kBracket) * limit);
    task.share_mm[2 * k + 1] = static_cast<float>((1.0 + kBracket) * limit);
  }
}

/// False, with `stats` incomplete, if a standard deviation is outside the brackets.
bool state_deviation(const SurveySums& sums, const SurveyTask& task, DeviationStats& stats) {
  stats = DeviationStats{};
  stats.count = static_cast<std::uint64_t>(sums.near);
  if (stats.count < 2) return true;
  const double sigma = std_of(sums);
  for (std::size_t k = 0; k < stats.within_sigma.size(); ++k) {
    const auto low = static_cast<double>(task.share_mm[2 * k]);
    const auto high = static_cast<double>(task.share_mm[2 * k + 1]);
    const double limit = static_cast<double>(k + 1) * sigma;
    if (!(low <= limit && limit <= high)) return false;
    const double part = high > low ? (limit - low) / (high - low) : 1.0;
    stats.within_sigma[k] = (sums.within[2 * k] + part * (sums.within[2 * k + 1] - sums.within[2 * k])) / sums.near;
  }
  stats.mean_mm = sums.sum_mm / sums.near;
  stats.std_mm = sigma;
  return true;
}

/// Computes the length of strips of equal cells, by rows and by columns.
void find_reach(std::span<std::uint32_t> cells) {
  using namespace survey_cell;
  constexpr std::size_t kColumns = limits::kFaceTableX;
  constexpr std::size_t kRows = limits::kFaceTableY;
  const auto kind = [&](std::size_t cell) { return cells[cell] & (kFaceBits | kRegionBits); };
  // Line by line, from both ends.
  const auto along = [&](std::size_t lines, std::size_t length, std::size_t line_step, std::size_t step,
                         std::size_t direction) {
    for (std::size_t line = 1; line + 1 < lines; ++line) {
      const auto cell = [&](std::size_t i) { return line * line_step + i * step; };
      const auto alike = [&](std::size_t i) {
        const std::uint32_t here = kind(cell(i));
        return (here & kRegionBits) != 0 && std::popcount(here & kFaceBits) == 1 && kind(cell(i) - line_step) == here &&
               kind(cell(i) + line_step) == here;
      };
      for (const bool back : {false, true}) {
        const unsigned shift = kReachShift[direction + (back ? 1 : 0)];
        std::size_t reach = 0;
        for (std::size_t k = 1; k < length; ++k) {
          const std::size_t i = back ? length - 1 - k : k;
          const std::size_t from = back ? i + 1 : i - 1;
          reach = alike(i) && alike(from) && kind(cell(i)) == kind(cell(from)) ? reach + 1 : 0;
          const auto code = std::upper_bound(kReachCells.begin(), kReachCells.end(), reach) - kReachCells.begin() - 1;
          cells[cell(i)] |= static_cast<std::uint32_t>(code) << shift;
        }
      }
    }
  };
  along(kRows, kColumns, kColumns, 1, 0);
  along(kColumns, kRows, 1, kColumns, 2);
}

}  // namespace

void SurveyTable::build(const BlockModel& model, const FaceTable& faces, const EvaluationSettings& settings,
                        std::span<std::uint32_t> cells) {
  using namespace survey_cell;
  constexpr auto kColumns = static_cast<int>(limits::kFaceTableX);
  constexpr auto kRows = static_cast<int>(limits::kFaceTableY);
  // A pose and a position in float differ by up to 1e-4 mm from the exact ones.
  constexpr double kGrow_mm = 0.1;
  constexpr double kRim_mm = 1e-6;
  constexpr double kHalfX = 0.5 * kColumns;
  constexpr double kHalfY = 0.5 * kRows;
  rules_.build(model, settings);
  cells_ = cells;
  band_mm_ = std::min(kBand_mm, 0.5 * settings.registration_gate_mm);
  const auto at = [&](int column, int row) -> std::uint32_t& {
    return cells_[static_cast<std::size_t>(row) * limits::kFaceTableX + static_cast<std::size_t>(column)];
  };
  for (int row = 0; row < kRows; ++row) {
    for (int column = 0; column < kColumns; ++column) {
      const double x = column - 0.5 * kColumns;
      const double y = row - 0.5 * kRows;
      const std::uint16_t candidates = faces.near_at({x + 0.5, y + 0.5, 0.0});
      std::uint32_t regions = 0;
      for (std::uint32_t left = candidates; left != 0; left &= left - 1) {
        const Plane& plane = model.planes()[static_cast<std::size_t>(__builtin_ctz(left))];
        for (int k = 0; k < 10; ++k) {
          // Outside the table nothing is measured or looked up.
          const double px =
              std::clamp(x + (k % 2 == 0 ? -kGrow_mm : 1.0 + kGrow_mm), kRim_mm - kHalfX, kHalfX - kRim_mm);
          const double py =
              std::clamp(y + (k / 2 % 2 == 0 ? -kGrow_mm : 1.0 + kGrow_mm), kRim_mm - kHalfY, kHalfY - kRim_mm);
          const double off = k < 4 ? -band_mm_ : band_mm_;
          const Vec3 p =
              k < 8 ? Vec3(px, py, plane.z_at(px, py) + off / plane.n.z())
                    : Vec3(x + 0.5, y + 0.5, plane.z_at(x + 0.5, y + 0.5) + (k == 8 ? off : -off) / plane.n.z());
          regions |= 1U << static_cast<unsigned>(rules_.region_of(p));
        }
      }
      const bool sure = (regions & (regions - 1)) == 0;
      const auto region = static_cast<std::uint32_t>(std::countr_zero(regions));
      at(column, row) = candidates | (sure && regions != 0 ? (1 + region) << kRegionShift : 0U);
    }
  }
  find_reach(cells_);
}

void survey_scan(const Cloud& cloud, const SurveyInput& input, const SurveyWorkspace& work, Team& team,
                 Survey& survey) {
  survey = Survey{};
  SurveyTask task;
  task.frame = frame_for(input.model, input.T_block_scanner);
  task.table = input.table.cells().data();
  task.gate_mm = static_cast<float>(input.settings.registration_gate_mm);
  task.band_mm = static_cast<float>(input.table.band_mm());
  task.rules = input.table.rules().numbers();
  task.jaw = {raster_of_jaw(input.model, input.settings, Face::jaw_inner, Face::shoulder_inner),
              raster_of_jaw(input.model, input.settings, Face::jaw_outer, Face::shoulder_outer)};
  survey.jaw = task.jaw;

  // The scouts list every point of the large faces.
  task.share_mm.fill(std::numeric_limits<float>::max());
  task.inner_mm.fill(-1.0F);
  task.outer_mm.fill(std::numeric_limits<float>::max());
  const std::size_t stride = std::max<std::size_t>(1, cloud.points / kScouted);
  const Passed scouted = pass_over(cloud, task, stride, 0, work, team);
  const auto on_seat = static_cast<double>(stride * scouted.points[static_cast<std::size_t>(PointList::seat_edge)]);
  const std::size_t lanes = surface_lanes(cloud, on_seat / input.seat_mm2);
  team.run(kLargeFaces, [&](std::size_t i) {
    const auto list = static_cast<std::size_t>(kEdgeList[i]);
    const Plane& face = input.model.plane(kLargeFace[i]);
    ListedPoints points;
    points.frame = frame_of(face);
    points.runs = scouted.runs[list];
    points.count = scouted.points[list];
    begin_fit(points, face.n, input.large[i], work.start[i]);
  });
  if (const double sigma = std_of(scouted.sums); has_value(sigma)) bracket_shares(sigma, task);

  const auto survey_around = [&](std::size_t i, const FlatPlane& plane) {
    const LocalPlane local(frame_of(input.model.plane(kLargeFace[i])), plane);
    const double limit = work.start[i].threshold_mm * local.stretch;
    task.tilt[i] = local.tilt();
    task.inner_mm[i] = static_cast<float>((1.0 - kEdgeShare) * limit);
    task.outer_mm[i] = static_cast<float>((1.0 + kEdgeShare) * limit);
  };
  for (std::size_t i = 0; i < kLargeFaces; ++i) {
    PlaneStart& start = work.start[i];
    // No fit: only count.
    task.inner_mm[i] = task.outer_mm[i] = -1.0F;
    if (!start.found) continue;
    start.threshold_mm = std::fmax(start.threshold_mm, kThresholdMin_mm);
    survey_around(i, start.plane);
  }

  for (int pass = 0; pass < kPasses; ++pass) {
    const Passed passed = pass_over(cloud, task, 1, lanes, work, team);
    bool done = state_deviation(passed.sums, task, survey.deviation);
    if (!done) bracket_shares(std_of(passed.sums), task);
    std::array<bool, kLargeFaces> beyond{};
    team.run(kLargeFaces, [&](std::size_t i) {
      const auto list = static_cast<std::size_t>(kEdgeList[i]);
      SummedPoints points;
      points.frame = frame_of(input.model.plane(kLargeFace[i]));
      points.tilt = task.tilt[i];
      points.inner = passed.sums.moments[i];
      points.edge = passed.runs[list];
      points.count = static_cast<std::size_t>(passed.sums.points[i]);
      points.slack_mm = kEdgeShare * work.start[i].threshold_mm - kRounding_mm;
      survey.large[i] = finish_fit(points, input.large[i], work.start[i]);
      beyond[i] = points.asked_beyond;
      if (beyond[i]) refuse(survey.large[i], PlaneDoubt::unsettled);
      // The slope's datum as well: a dark, lower half must not be outvoted by the points of the other half.
      if (survey.large[i].ok && share_by_area(work.start[i], survey.large[i], points.frame, kLargeRaster, {},
                                              points.count) < input.large[i].inlier_share_min)
        refuse(survey.large[i], PlaneDoubt::area);
    });
    for (std::size_t list = 0; list < kPointLists; ++list) {
      survey.lists[list].frame = frame_of(input.model.plane(kFaceOfList[list]));
      survey.lists[list].runs = passed.runs[list];
      survey.lists[list].count = passed.points[list];
    }
    survey.jaw_off = passed.sums.jaw_off;
    survey.overflown = passed.overflown;
    for (std::size_t i = 0; i < kLargeFaces; ++i) {
      if (!beyond[i]) continue;
      done = false;
      const PlaneFit& fit = survey.large[i];
      if (!fit.normal.allFinite() || !std::isfinite(fit.offset_mm)) continue;
      work.start[i].plane = {fit.normal, fit.offset_mm};
      survey_around(i, work.start[i].plane);
    }
    if (done || survey.overflown) break;
  }
}

}  // namespace slabd::algo
