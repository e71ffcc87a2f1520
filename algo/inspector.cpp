// SPDX-License-Identifier: Apache-2.0
//
// One block, stage by stage. The constructor allocates all memory; each stage uses parts of it:
//
//     order             denoise: points by cell                 extract: the points listed by the survey
//                       register: points around the casings
//     label             denoise: points to keep                 noise print: its cells
//                       register: points around the casings
//     cell_start        denoise: starts of the cells
//     surface           denoise: the surface in each cell       extract: the surface's raster, and the search on it
//     sample            register: the points ICP works on       extract: the jaws' flat strips, then the cells of the
//     residuals                   ... and their distances                search for damage
//     wide, near        the face table, built by `use`
//     heights           the height map, built by `use`
//     survey_*, map_*   extract: results of the one pass over the scan (algo/survey/survey.h)
//     flatness          extract: their cells
#include <atomic>
#include <cassert>
#include <cmath>
#include <span>
#include <string_view>

#include "algo/algo.h"
#include "algo/block_model.h"
#include "algo/denoise/denoise.h"
#include "algo/features/casing.h"
#include "algo/features/filled_gaps.h"
#include "algo/features/flatness.h"
#include "algo/features/jaw.h"
#include "algo/features/noise_texture.h"
#include "algo/features/plane_fit.h"
#include "algo/features/seat_cells.h"
#include "algo/features/seat_noise.h"
#include "algo/items/block_items.h"
#include "algo/items/uncertainty.h"
#include "algo/register/block_search.h"
#include "algo/register/registration.h"
#include "algo/survey/coordinate_step.h"
#include "algo/survey/segmentation.h"
#include "algo/survey/surface_damage.h"
#include "algo/survey/surface_findings.h"
#include "algo/survey/survey.h"
#include "base/pages.h"
#include "base/team.h"

namespace slabd::algo {

struct BlockInspector::Workspace {
  explicit Workspace(int threads)
      : team(threads),
        pages(limits::kWorkspaceBytes),
        order(pages.take<std::uint32_t>(limits::kScanPointsMax)),
        label(pages.take<std::uint8_t>(limits::kScanPointsMax)),
        cell_start(pages.take<std::uint32_t>(limits::kDenoiseCellsMax + 1)),
        surface(pages.take<TilePlane>(limits::kDenoiseCellsMax)),
        sample(pages.take<float>(kSampleFloats)),
        residuals(pages.take<float>(2 * limits::kIcpPointsMax)),
        histogram(pages.take<std::uint32_t>(limits::kDeviationBins)),
        wide(pages.take<std::uint16_t>(FaceTable::kCells)),
        near(pages.take<std::uint16_t>(FaceTable::kCells)),
        scratch(pages.take<std::uint16_t>(FaceTable::kCells)),
        heights(pages.take<float>(limits::kHeightMapCells)),
        survey_cells(pages.take<std::uint32_t>(SurveyTable::kCells)),
        surface_cells(pages.take<std::uint16_t>(limits::kSurfaceCells)),
        survey_blocks(pages.take<SurveySums>(limits::kSurveyBlocksMax)),
        survey_runs(pages.take<SeatPoints>(limits::kSurveyPiecesMax)),
        piece_next(pages.take<std::uint32_t>(limits::kSurveyPiecesMax)),
        piece_count(pages.take<std::uint32_t>(limits::kSurveyPiecesMax)),
        map_sum{pages.take<std::int64_t>(limits::kDeviationMapCells),
                pages.take<std::int64_t>(limits::kDeviationMapCells)},
        map_count{pages.take<std::uint32_t>(limits::kDeviationMapCells),
                  pages.take<std::uint32_t>(limits::kDeviationMapCells)},
        flatness{pages.take<CellSum>(2 * limits::kFlatnessCellsMax),
                 pages.take<CellRange>(limits::kCellGroupsMax),
                 pages.take<float>(limits::kSeatPointsMax),
                 pages.take<std::uint32_t>(limits::kFlatnessCellsMax + 1),
                 pages.take<std::uint32_t>(limits::kFlatnessCellsMax + 1),
                 pages.take<Vec3>(limits::kFlatnessCellsMax)},
        casings(reinterpret_cast<float*>(order.data()), kCasingTiesFloats),
        raster{raster_in(surface, 0), raster_in(surface, 1)},
        raster_rest(rest_of(surface)),
        pool({reinterpret_cast<float*>(order.data()), order.size()}, piece_next, piece_count) {
    static_assert(sizeof(float) == sizeof(std::uint32_t));
  }

  /// The surface rasters of both threads, and the memory behind them.
  static std::span<SurfaceCell> raster_in(std::span<TilePlane> memory, std::size_t thread) {
    return {reinterpret_cast<SurfaceCell*>(memory.data()) + thread * kSurfaceCells, kSurfaceCells};
  }
  static std::span<float> rest_of(std::span<TilePlane> memory) {
    constexpr std::size_t kRasterFloats = 2 * kSurfaceCells * sizeof(SurfaceCell) / sizeof(float);
    static_assert(kRasterFloats + kSurfaceFloats <= limits::kDenoiseCellsMax * sizeof(TilePlane) / sizeof(float));
    return {reinterpret_cast<float*>(memory.data()) + kRasterFloats, kSurfaceFloats};
  }

  Team team;
  Pages pages;  // first: the arrays below are located in it; limits::kWorkspaceBytes is their sum
  std::span<std::uint32_t> order;
  std::span<std::uint8_t> label;
  std::span<std::uint32_t> cell_start;
  std::span<TilePlane> surface;
  std::span<float> sample;
  std::span<float> residuals;
  std::span<std::uint32_t> histogram;
  std::span<std::uint16_t> wide;
  std::span<std::uint16_t> near;
  std::span<std::uint16_t> scratch;
  std::span<float> heights;
  std::span<std::uint32_t> survey_cells;
  std::span<std::uint16_t> surface_cells;
  std::span<SurveySums> survey_blocks;
  std::span<SeatPoints> survey_runs;
  std::span<std::uint32_t> piece_next;
  std::span<std::uint32_t> piece_count;
  std::array<std::span<std::int64_t>, 2> map_sum;
  std::array<std::span<std::uint32_t>, 2> map_count;
  FlatnessWorkspace flatness;
  std::span<float> casings;                      // in the memory of `order`
  std::array<std::span<SurfaceCell>, 2> raster;  // in the memory of `surface`
  std::span<float> raster_rest;                  // ... also in the memory of `surface`
  PointPool pool;                                // in the memory of `order`
  std::array<PlaneStart, kLargeFaces> plane_start;
  SurveyTable survey_table;
  SurfaceTable surface_table;
  Survey survey;

  Recipe recipe;
  BlockModel model;
  FaceTable table;
  HeightMap height_map;
  FaceExtents extents;
  Pose T_base_block;
  Pose T_base_scanner;
  ScannerNumbers verified;
  double scanner_drift = kNoValue;
  Thermal thermal;
  SeatDesign seat;  ///< of the model
  BlockResult result;
  std::atomic<bool> give_up{false};
  bool has_recipe = false;
  bool has_map = false;  ///< of this block, not of an earlier one
};

namespace {

/// Minimum visible part of a face for its plane to count. A corner of a face fits a plane as well as the whole face
/// does, but its tilt is that of the corner. Required are: a third of the whole face's spread in both directions (a
/// slab top seen past only one end of the block has an eighth); a twentieth of the points that the sparsest scan of the
/// whole face would give (the slab top extends beyond a small field of view); and noise that leaves at most half of the
/// angle's U (k = 2).
PlaneSupport support_of(const FaceExtent& whole, const EvaluationSettings& evaluation, double U_deg) {
  constexpr double kSpreadShare = 1.0 / 3.0;
  constexpr double kPointsShare = 0.05;
  constexpr double kNoiseShare = 0.5;
  const double points_per_mm2 =
      static_cast<double>(evaluation.cell_points_min) / (evaluation.cell_mm * evaluation.cell_mm);
  PlaneSupport support;
  support.inliers_min = static_cast<std::uint64_t>(std::ceil(kPointsShare * whole.area_mm2 * points_per_mm2));
  support.wide_mm = kSpreadShare * whole.wide_mm;
  support.narrow_mm = kSpreadShare * whole.narrow_mm;
  if (has_value(U_deg)) support.tilt_sigma_max_rad = kNoiseShare * 0.5 * rad_from_deg(U_deg);
  return support;
}

/// Region in which flatness is measured.
FlatnessRegion flatness_region(const Recipe& recipe) {
  const EvaluationSettings& evaluation = recipe.evaluation;
  FlatnessRegion region{evaluation.crop_half_x_mm, evaluation.crop_half_s_mm, evaluation.cell_mm,
                        evaluation.cell_points_min};
  region.cells_missing_max = evaluation.cells_missing_max;
  region.defect_sigmas = evaluation.defect_sigmas;
  region.closing_mm = evaluation.closing_mm;
  region.casing_s_mm = recipe.block.casing_half_spacing_mm.value;
  region.casing_clear_mm = 0.5 * recipe.block.casing_rim_diameter_mm.value + evaluation.edge_margin_mm;
  return region;
}

/// Points per mm^2 of seat.
double seat_density(const SeatFeature& seat, const EvaluationSettings& evaluation) {
  const double area_mm2 = evaluation.cell_mm * evaluation.cell_mm * static_cast<double>(seat.grid_points);
  return static_cast<double>(seat.plane.inliers) / area_mm2;
}

void set_edge_nominals(const EdgeNominals& nominals, BlockResult& result) {
  for (EdgeFeature& edge : result.edges) {
    const bool of_seat = edge.face == EdgeFace::seat;
    const double radius_mm = of_seat ? nominals.fillet_seat_mm : nominals.fillet_shoulder_mm;
    edge.nominal_mm = has_value(edge.radius_mm) ? radius_mm : nominals.chamfer_mm;
  }
}

/// Fills the report of a scan that ended before the registration; `note` gives the reason.
void refuse_registration(RegistrationReport& report, std::string_view note) {
  report.status = RegistrationStatus::rejected;
  report.note = note;
}

}  // namespace

BlockInspector::BlockInspector(int threads) : work_(std::make_unique<Workspace>(threads)) {}
BlockInspector::~BlockInspector() = default;

Team& BlockInspector::team() {
  return work_->team;
}

void BlockInspector::use(const Recipe& recipe) {
  work_->recipe = recipe;
  work_->has_recipe = true;
  build_model({});
}

void BlockInspector::build_model(const SeatDesign& seat) {
  Workspace& w = *work_;
  const bool is_as_drawn = seat.slope_rad == 0.0 && seat.offset_mm.z() == 0.0;
  w.model.build(is_as_drawn ? w.recipe.block : designed_block(w.recipe.block, seat));
  w.table.build(w.model, w.wide, w.near, w.scratch);
  w.survey_table.build(w.model, w.table, w.recipe.evaluation, w.survey_cells);
  w.surface_table.build(w.model, w.surface_cells);
  w.height_map.build(w.model, w.heights);
  w.extents = face_extents(w.model, w.recipe.evaluation);
  w.seat = seat;
}

void BlockInspector::give_up() {
  work_->give_up = true;
}

void BlockInspector::begin(int station, const Pose& T_base_block, const Pose& T_base_scanner,
                           const ScannerNumbers& verified, const SlabFacts& slab, double scanner_drift) {
  assert(work_->has_recipe && "use a recipe first");
  work_->T_base_block = T_base_block;
  work_->T_base_scanner = T_base_scanner;
  work_->verified = verified;
  work_->scanner_drift = scanner_drift;
  if (const SeatDesign seat = slab.design.given ? slab.design.at(station) : SeatDesign{};
      seat.slope_rad != work_->seat.slope_rad || seat.offset_mm.z() != work_->seat.offset_mm.z())
    build_model(seat);
  work_->thermal = thermal_of(work_->recipe.thermal, slab.temperature_c);
  work_->result = BlockResult{};
  work_->give_up = false;
  work_->has_map = false;
  work_->result.station = static_cast<std::uint8_t>(station);
  blank_block_items(work_->recipe, slab.design, work_->result);
}

Status BlockInspector::denoise(Cloud& cloud) {
  Workspace& w = *work_;
  if (cloud.points > limits::kScanPointsMax || 3 * cloud.points > cloud.xyz.size()) {
    refuse_registration(w.result.registration, "not tried: incomplete scan");
    return error(Code::frame_incomplete, "scan claims %zu points, its buffer holds %zu and the limit is %zu",
                 cloud.points, cloud.xyz.size() / 3, limits::kScanPointsMax);
  }
  const Vec3 step_mm = cloud.points < limits::kScanPointsMin ? Vec3(Vec3::Zero())
                                                             : find_coordinate_step(cloud, w.order.first(kStepScratch));
  if (!remove_isolated(cloud, {w.order, w.label, w.cell_start, w.surface, &w.give_up}, w.team, w.result.scan)) {
    refuse_registration(w.result.registration, "not tried: too much noise to be judged");
    return error(Code::deadline,
                 "denoising was cancelled: hardly any of the %llu points is on a surface, and testing each of them "
                 "would take longer than a measurement is allowed",
                 static_cast<unsigned long long>(w.result.scan.points_finite));
  }
  w.result.scan.step_mm = step_mm;
  const auto kept = static_cast<std::size_t>(w.result.scan.points_kept);
  if (kept < limits::kScanPointsMin) {
    refuse_registration(w.result.registration, "not tried: too few points");
    return error(Code::too_few_points, "%zu of %llu points left after denoising, at least %zu needed", kept,
                 static_cast<unsigned long long>(w.result.scan.points_read), limits::kScanPointsMin);
  }
  if (int axis = 0; step_mm.maxCoeff(&axis) > 1.01 * kCoordinateStepMax_mm) {
    refuse_registration(w.result.registration, "not tried: coordinates rounded too coarsely");
    return error(Code::frame_incomplete,
                 "the coordinates along %c (scanner frame) are rounded or resampled to %g mm, coarser than %g mm: let "
                 "the scanner "
                 "write more decimals (at least two in mm, five in m) and no raster filled from the nearest points",
                 "xyz"[axis], step_mm[axis], kCoordinateStepMax_mm);
  }
  return success();
}

Status BlockInspector::register_to_model(const Cloud& cloud) {
  Workspace& w = *work_;
  if (cloud.points < limits::kScanPointsMin) {
    refuse_registration(w.result.registration, "not tried: too few points");
    return error(Code::too_few_points, "%zu points, at least %zu needed", cloud.points, limits::kScanPointsMin);
  }
  if (w.give_up) {
    refuse_registration(w.result.registration, "not tried: given up");
    return error(Code::deadline, "the measurement was given up before the registration");
  }
  const RegistrationTask task{w.model, w.table, w.height_map, w.recipe.evaluation,
                              w.T_base_block.inverse() * w.T_base_scanner};
  if (!task.T_block_scanner.all_finite()) {
    refuse_registration(w.result.registration, "not tried: the start pose is not finite");
    return error(Code::no_pose, "the start pose of the registration is not finite");
  }
  w.result.registration =
      register_block(cloud, task, {{w.sample, w.residuals, w.label}, w.histogram, w.casings}, w.team);
  const RegistrationReport& report = w.result.registration;
  switch (report.status) {
    case RegistrationStatus::converged: return success();
    case RegistrationStatus::iteration_limit: return error(Code::fit_failed, "registration: %s", report.note.c_str());
    case RegistrationStatus::none:
    case RegistrationStatus::degenerate:
    case RegistrationStatus::rejected: break;
  }
  return error(Code::block_not_found, "registration %s: %s", name(report.status).data(), report.note.c_str());
}

namespace {

/// Step of the scan's coordinates along a face's normal, mm.
double step_along_mm(const PlaneFit& plane, const BlockResult& result) {
  const Vec3 normal = result.registration.T_scanner_block.rotation * plane.normal;
  return normal.cwiseProduct(result.scan.step_mm).norm();
}

/// Noise of a point where points were measured, even if most of the face was computed. With noise that is everywhere
/// the same, the noisier places have less than 1.25 of it.
double noise_where_seen_mm(const NoiseTexture& texture) {
  return std::max(texture.sigma_mm, 0.8 * texture.filled.noisy_mm);
}

/// The largest place without noise; empty if the rounding of coordinates hides it. Points rounded to one step have no
/// noise either, unless their own noise is a step or more. On a steep face rounding itself looks like noise, so the
/// seat must have that noise too.
FilledPlace filled_place(const NoiseTexture& texture, double seat_noise_mm, double step_mm) {
  const double noise_mm = std::min(noise_where_seen_mm(texture), seat_noise_mm);
  return step_mm > kStepOfNoiseMax * noise_mm ? FilledPlace{} : texture.filled;
}

/// Checks that the faces have the noise of measured points. Refuses jaws that a scanner's program filled in part.
/// Returns an error for such a seat, and for heights that were rounded before a smooth correction or resampling.
/// `cells`: kGapCells. `seat_noise_mm`: noise of a point of the seat.
Status look_at_noise(const Cloud& cloud, const Survey& survey, const SeatFrame& frame, std::span<TextureCell> cells,
                     Team& team, BlockResult& result, double& seat_noise_mm) {
  SeatFeature& seat = result.seat;
  const std::array<PlaneFit*, 2> jaws = {&result.jaw_inner, &result.jaw_outer};
  std::array<NoiseTexture, 3> textures;
  team.run(3, [&](std::size_t which) {
    const std::span<TextureCell> own = cells.subspan(which * kTextureCells, kTextureCells);
    if (which == 0) {
      textures[0] = look_at_texture(input_of(survey.over_crop(), frame, seat.plane), own);
    } else if (jaws[which - 1]->ok) {
      const ListedPoints& points = survey.of(which == 1 ? PointList::jaw_inner : PointList::jaw_outer);
      textures[which] = look_at_texture(input_of(points.runs, points.frame, *jaws[which - 1]), own);
    }
  });
  const NoiseTexture& texture = textures[0];
  seat_noise_mm = texture.sigma_mm;
  const double known_step_mm = step_along_mm(seat.plane, result);
  // Differences of heights in coarse steps do not show a filter.
  if (known_step_mm <= kStepOfNoiseMax * texture.sigma_mm) result.scan.lag_ratio = texture.lag_ratio;
  // The 95 % difference of rounded heights is one or two of their known steps.
  if (const double step_mm = hidden_step_mm(texture); step_mm > std::max(kCoordinateStepMax_mm, 3.0 * known_step_mm)) {
    refuse(seat.plane, PlaneDoubt::not_fitted);
    return error(Code::fit_failed,
                 "the heights have steps of about %.2f mm, rounded before they were corrected or resampled: let the "
                 "scanner's program write more decimals, and switch off its filters",
                 step_mm);
  }
  // The points of a face lack its borders, and the noise along their rows does not show all fillings.
  GapFaces faces{{{frame, &seat.plane}}};
  for (std::size_t side = 0; side < jaws.size(); ++side)
    if (jaws[side]->ok)
      faces[side + 1] = {survey.of(side == 0 ? PointList::jaw_inner : PointList::jaw_outer).frame, jaws[side]};
  const FilledGaps gaps = find_filled_gaps(cloud, result.registration.T_scanner_block.inverse(), faces, cells, team);
  for (std::size_t i = 0; i < gaps.size(); ++i) {
    FilledPlace& filled = textures[i].filled;
    const double noisy_mm = std::max(filled.noisy_mm, gaps[i].noisy_mm);
    if (gaps[i].area_mm2 > filled.area_mm2) filled = gaps[i];
    filled.noisy_mm = noisy_mm;
  }
  const double seen_noise_mm = noise_where_seen_mm(texture);
  if (const FilledPlace filled = filled_place(texture, seen_noise_mm, known_step_mm); filled.cells > 0) {
    refuse(seat.plane, PlaneDoubt::filled);
    return error(
        Code::fit_failed,
        "seat plane: %.0f x %.0f mm at x %.0f mm, s %.0f mm have no noise: they were computed, not seen; switch "
        "off gap filling, smoothing and resampling in the scanner's program (docs/SCANNER.md)",
        filled.width_mm, filled.length_mm, filled.x_mm, filled.s_mm);
  }
  for (std::size_t side = 0; side < jaws.size(); ++side)
    if (filled_place(textures[side + 1], seen_noise_mm, step_along_mm(*jaws[side], result)).cells > 0)
      refuse(*jaws[side], PlaneDoubt::filled);
  return success();
}

}  // namespace

/// Results of one part of `extract` for the next ones.
struct BlockInspector::BlockFit {
  bool has_surface_items = false;
  std::array<JawFit, 2> jaws;
  Flatness flatness;
  double seat_noise_mm = kNoValue;  ///< of a point
};

Error BlockInspector::seat_refused() const {
  const PlaneFit& plane = work_->result.seat.plane;
  return error(Code::fit_failed,
               "seat plane: %s; %llu of %llu points within the threshold after %d refits, at least %.2f of them and of "
               "the area seen needed, spread over at least a third of the crop",
               reason_of(plane.doubt).data(), static_cast<unsigned long long>(plane.inliers),
               static_cast<unsigned long long>(plane.points), plane.iterations,
               work_->recipe.evaluation.inlier_share_min);
}

/// Surveys the scan and fits the planes of seat, jaws and slab top.
Status BlockInspector::fit_faces(const Cloud& cloud, BlockFit& fit) {
  Workspace& w = *work_;
  BlockResult& result = w.result;
  const EvaluationSettings& evaluation = w.recipe.evaluation;
  // Every feature draws its own hypotheses, the same in every run.
  const auto settings_of = [&](const FaceExtent& whole, ItemId angle, std::uint64_t seed) {
    PlaneSettings settings;
    settings.inlier_share_min = evaluation.inlier_share_min;
    // Three standard deviations of the rounding error at the coarsest axis' step.
    settings.threshold_min_mm = std::sqrt(0.75) * result.scan.step_mm.maxCoeff();
    settings.support = support_of(whole, evaluation, w.recipe.tolerance(angle).U);
    settings.seed = seed;
    return settings;
  };
  SeatFeature& seat = result.seat;
  const FaceExtents& extents = w.extents;
  // Only the direction of the slab top is used, and cast tops undulate by tenths of a millimetre. A seat may sink by
  // such an amount towards its edge.
  constexpr double kTopBendShare = 1.0 / 3.0;
  constexpr double kSeatBendShare = 1.0 / 2.0;
  constexpr double kSeatBend_mm = 0.01;
  const double U_deg = w.recipe.tolerance(ItemId::seat_slope).U;
  const double U_rad = has_value(U_deg) ? rad_from_deg(U_deg) : 0.0;
  PlaneSettings of_top = settings_of(extents.top, ItemId::seat_slope, 5);
  of_top.bend_max_rad = kTopBendShare * U_rad;
  const auto settings_of_seat = [&](const FaceExtent& whole, std::uint64_t seed) {
    PlaneSettings settings = settings_of(whole, ItemId::seat_slope, seed);
    settings.bend_max_rad = kSeatBendShare * U_rad;
    settings.bend_max_mm = kSeatBend_mm;
    return settings;
  };
  const Survey& survey = w.survey;
  survey_scan(cloud,
              {w.model,
               w.survey_table,
               evaluation,
               result.registration.T_scanner_block.inverse(),
               {settings_of_seat(extents.full_seat, 2), of_top},
               extents.full_seat.area_mm2},
              {w.pool,
               w.survey_blocks,
               w.survey_runs,
               {MapSums{w.map_sum[0], w.map_count[0]}, MapSums{w.map_sum[1], w.map_count[1]}},
               w.plane_start,
               fit.has_surface_items ? w.raster : std::array<std::span<SurfaceCell>, 2>{}},
              w.team, w.survey);
  w.has_map = true;
  result.registration.deviation = survey.deviation;
  if (survey.overflown)
    return error(Code::fit_failed,
                 "more points over the seat, on the jaws and around the casings than the %zu there is room for",
                 limits::kSurveyPiecesMax * PointPool::kPiece);
  seat.full_plane = survey.large[static_cast<std::size_t>(LargeFace::seat)];
  result.slab_top = survey.large[static_cast<std::size_t>(LargeFace::top)];
  // The scanner errs along its rays, about along the seat's normal; a steep jaw receives a part of that error.
  const double ripple_mm = ripple_amplitude_mm(survey.of(PointList::seat_crop));
  w.team.run(3, [&](std::size_t which) {
    // The seat is checked cell by cell, by its flatness.
    if (which == 0) {
      seat.plane = fit_plane_over(survey.of(PointList::seat_crop), w.model.plane(Face::seat).n,
                                  settings_of_seat(extents.seat_crop, 1));
      return;
    }
    const std::size_t side = which - 1;
    const bool inner = side == 0;
    const Face face = inner ? Face::jaw_inner : Face::jaw_outer;
    const std::span<float> memory = w.sample.subspan(side * (w.sample.size() / 2), w.sample.size() / 2);
    fit.jaws[side] = measure_jaw({survey.of(inner ? PointList::jaw_inner : PointList::jaw_outer), w.model.plane(face).n,
                                  edges_of_jaw(w.model, face, inner ? Face::shoulder_inner : Face::shoulder_outer),
                                  evaluation.edge_margin_mm,
                                  inner ? settings_of(extents.jaw_inner, ItemId::jaw_angle_inner, 3)
                                        : settings_of(extents.jaw_outer, ItemId::jaw_angle_outer, 4),
                                  survey.jaw[side], survey.jaw_off[side], memory,
                                  ripple_mm * std::abs(w.model.plane(face).n.dot(w.model.plane(Face::seat).n))});
  });
  result.jaw_inner = fit.jaws[0].plane;
  result.jaw_outer = fit.jaws[1].plane;
  // The share is of all points seen at the face's place. Otherwise, if half of the seat is five millimetres low, the
  // other half alone would determine the plane.
  const auto count_off = [&](PlaneFit& plane, std::size_t seen, std::size_t off) {
    plane.points = seen + off;
    plane.inlier_fraction =
        plane.points == 0 ? 0.0 : static_cast<double>(plane.inliers) / static_cast<double>(plane.points);
    if (plane.inlier_fraction < evaluation.inlier_share_min) refuse(plane, PlaneDoubt::share);
  };
  count_off(seat.plane, survey.of(PointList::seat_crop).size(), survey.of(PointList::seat_off).size());
  count_off(result.jaw_inner, result.jaw_inner.points, survey.points_off(0));
  count_off(result.jaw_outer, result.jaw_outer.points, survey.points_off(1));
  return seat.plane.ok ? success() : seat_refused();
}

/// Measures the seat's flatness and noise, and the casings.
Status BlockInspector::measure_seat_and_casings(const Cloud& cloud, BlockFit& fit) {
  Workspace& w = *work_;
  BlockResult& result = w.result;
  const Survey& survey = w.survey;
  SeatFeature& seat = result.seat;
  const EvaluationSettings& evaluation = w.recipe.evaluation;
  const BlockGeometry& geometry = w.recipe.block;
  const FlatnessRegion region = flatness_region(w.recipe);
  const SeatFrame frame = SeatFrame::of(w.model);
  const Flatness& flatness = fit.flatness;
  fit.flatness = measure_flatness(survey.over_crop(), frame, seat.plane, region, w.flatness, w.team);
  seat.by_area = flatness.by_area;
  seat.grid_points = flatness.cells;
  seat.std_cells_mm = flatness.std_cells_mm;
  seat.flatness_raw_mm = flatness.lsq_mm;
  seat.flatness_closed_mm = flatness.closed_mm;
  seat.flatness_trimmed_mm = flatness.trimmed_mm;
  const bool closed = evaluation.flatness == FlatnessKind::closed;
  seat.flatness_mm = closed ? flatness.closed_mm : flatness.lsq_mm;
  seat.flatness_min_zone_mm = closed ? flatness.closed_min_zone_mm : flatness.min_zone_mm;
  seat.raw_low_mm = flatness.raw_low_mm;
  seat.raw_high_mm = flatness.raw_high_mm;
  seat.noise_factor = flatness.noise_factor;
  if (has_value(seat.noise_factor))
    seat.noise_factor = std::max(seat.noise_factor, verified_noise_factor(w.verified, seat_density(seat, evaluation)));
  seat.flatness_noise_mm = flatness.noise_mm;
  seat.defect = flatness.defect;
  if (!(flatness.seat_share >= evaluation.inlier_share_min)) {
    refuse(seat.plane, PlaneDoubt::area);
    return seat_refused();
  }

  static_assert(kGapCells * sizeof(TextureCell) <= limits::kScanPointsMax);
  const std::span<TextureCell> cells(reinterpret_cast<TextureCell*>(w.label.data()), kGapCells);
  if (const Status seen = look_at_noise(cloud, survey, frame, cells, w.team, result, fit.seat_noise_mm); !seen)
    return seen;

  const auto casing = [&](PointList where, bool outer) {
    const CasingTask task{w.model.casing_centre(outer),
                          0.5 * geometry.casing_bore_diameter_mm.value,
                          0.5 * geometry.casing_rim_diameter_mm.value,
                          geometry.casing_rim_height_mm.value,
                          evaluation.edge_margin_mm,
                          seat.plane};
    CasingFeature found = measure_casing(survey.of(where).runs, frame, task);
    const std::span<TextureCell> own = cells.subspan(outer ? kTextureCells : 0, kTextureCells);
    if (!found.ok) return found;
    const NoiseTexture texture = look_at_texture(input_of(survey.of(where).runs, frame, seat.plane), own);
    if (filled_place(texture, fit.seat_noise_mm, step_along_mm(seat.plane, result)).cells > 0) {
      found.ok = false;
      found.doubt = CasingDoubt::filled;
    }
    return found;
  };
  if (evaluation.casing == CasingKind::open)
    w.team.run(2, [&](std::size_t which) {
      if (which == 0)
        result.casing_inner = casing(PointList::casing_inner, false);
      else
        result.casing_outer = casing(PointList::casing_outer, true);
    });
  return success();
}

/// Computes the items with their U, and searches for pores and damage.
void BlockInspector::compute_items(const Cloud& cloud, const BlockFit& fit) {
  Workspace& w = *work_;
  BlockResult& result = w.result;
  const PlaneFit& seat = result.seat.plane;
  const EvaluationSettings& evaluation = w.recipe.evaluation;
  compute_block_items(w.model, result);
  // The amplitude of a wave is its standard deviation times the root of two.
  const double scatter2 = seat.std_mm * seat.std_mm - fit.seat_noise_mm * fit.seat_noise_mm;
  const FormDoubt form{form_tilts_rad(fit.jaws[0].strip, fit.jaws[1].strip),
                       evaluation.flatness == FlatnessKind::closed ? fit.flatness.bumps_mm : 0.0,
                       scatter2 > 0.0 ? std::sqrt(2.0 * scatter2) : 0.0};
  compute_block_budget(w.recipe, w.verified, form, result, w.scanner_drift);
  for (Item& item : result.items)
    if (item.id == ItemId::jaw_distance || item.id == ItemId::casing_spacing)
      state_at_reference(w.thermal, item.value, item);
  compute_observation(w.model, evaluation.casing, w.T_base_scanner * result.registration.T_scanner_block, result);
  static_assert(kFindingFloats <= kSampleFloats);
  if (fit.has_surface_items) {
    find_pores_and_damage(w.model, w.surface_table, w.raster[0], deviation_map(), w.raster_rest, w.team, result);
    result.pores.limits = w.recipe.pores;
    set_edge_nominals(w.recipe.edges, result);
    return;
  }
  find_surface_damage(cloud, w.model, result.registration.T_scanner_block.inverse(),
                      {deviation_map(),
                       {&w.survey.of(PointList::jaw_inner), &w.survey.of(PointList::jaw_outer)},
                       seat_density(result.seat, evaluation)},
                      w.sample, w.team, result);
}

Status BlockInspector::extract(const Cloud& cloud) {
  const Workspace& w = *work_;
  if (w.result.registration.status != RegistrationStatus::converged)
    return error(Code::block_not_found, "extract needs a converged registration, it is %s",
                 name(w.result.registration.status).data());
  if (w.give_up) return error(Code::deadline, "the measurement was given up before the features");
  BlockFit fit;
  // A recipe older than the items of pores and damage keeps its search and its results.
  fit.has_surface_items =
      w.recipe.tolerance(ItemId::surface_pores).given || w.recipe.tolerance(ItemId::block_damage).given;
  if (const Status fitted = fit_faces(cloud, fit); !fitted) return fitted;
  if (const Status measured = measure_seat_and_casings(cloud, fit); !measured) return measured;
  compute_items(cloud, fit);
  return success();
}

void BlockInspector::judge(Code code) {
  BlockResult& result = work_->result;
  for (Item& item : result.items)
    item.verdict = code != Code::ok ? Verdict::not_measured
                   : item.id == ItemId::surface_pores
                       ? with_pore_limits(slabd::judge(item, work_->recipe.guard), result.pores)
                       : slabd::judge(item, work_->recipe.guard);
  result.verdict = code == Code::ok ? with_findings(combine(result.items.begin(), result.items.end()), result)
                                    : Verdict::not_measured;
  result.reason = reason_with_findings(result.verdict, result.items.begin(), result.items.end(), code, result);
}

DeviationMap BlockInspector::deviation_map() const {
  if (!work_->has_map) return {};
  return {limits::kFaceTableX / limits::kDeviationMapCell_mm, limits::kFaceTableY / limits::kDeviationMapCell_mm,
          static_cast<double>(limits::kDeviationMapCell_mm), work_->map_sum[0], work_->map_count[0]};
}

SeatMap BlockInspector::seat_map() const {
  const Workspace& w = *work_;
  // The raw extremes have a value if the seat's cells were summed.
  if (!has_value(w.result.seat.raw_low_mm)) return {};
  const FlatnessRegion region = flatness_region(w.recipe);
  const CellGrid grid(region);
  return {grid.columns, grid.rows, region.cell_mm, std::max(region.cell_points_min, 1U),
          w.flatness.sums.first(grid.cells())};
}

void BlockInspector::noise_print(NoisePrint& out) {
  Workspace& w = *work_;
  out = {};
  // As for the seat's map: the survey's lists are then those of this block, and its plane was fitted.
  if (!has_value(w.result.seat.raw_low_mm)) return;
  static_assert(kNoiseCells * sizeof(NoiseCell) <= limits::kScanPointsMax);
  const std::span<NoiseCell> cells(reinterpret_cast<NoiseCell*>(w.label.data()), kNoiseCells);
  make_noise_print(w.survey.over_crop(), SeatFrame::of(w.model), w.result.seat.plane, flatness_region(w.recipe), cells,
                   w.team, out);
}

double SeatMap::mean_mm(std::size_t column, std::size_t row) const {
  const CellSum& sum = cells[row * columns + column];
  return sum.points < points_min ? kNoValue : sum.height() / static_cast<double>(sum.points);
}

const BlockResult& BlockInspector::result() const {
  return work_->result;
}
BlockResult& BlockInspector::result() {
  return work_->result;
}

}  // namespace slabd::algo
