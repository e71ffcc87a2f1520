// SPDX-License-Identifier: Apache-2.0
#include "tests/storage/store_fixture.h"

#include <algorithm>
#include <bit>
#include <filesystem>
#include <fstream>

#include "storage/files/database.h"

namespace slabd::storage {
namespace {

double number(Prng& prng) {
  // Difficult doubles: full mantissas, tiny and huge, sometimes NaN.
  const std::uint64_t kind = prng.below(8);
  if (kind == 0) return kNoValue;
  if (kind == 1) return prng.normal() * 1e-300;
  if (kind == 2) return static_cast<double>(prng.below(1000));  // a whole number, which SQLite stores as an integer
  return prng.normal() * 1234.5678;
}

Vec3 vector(Prng& prng) {
  return {number(prng), number(prng), number(prng)};
}

template <typename Matrix>
void matrix(Prng& prng, Matrix& out) {
  // Not symmetric, because a covariance symmetric only to rounding must keep its bits too.
  for (int row = 0; row < out.rows(); ++row)
    for (int column = 0; column < out.cols(); ++column) out(row, column) = number(prng);
}

Pose pose(Prng& prng) {
  Pose p;
  // Deliberately not of unit length, because storage must not normalise it.
  p.rotation = Quat(prng.normal(), prng.normal(), prng.normal(), prng.normal());
  p.translation_mm = vector(prng);
  return p;
}

template <std::size_t N>
void word(Prng& prng, FixedString<N>& out) {
  out.printf("w%llu \xc3\xa4 'quoted\"", static_cast<unsigned long long>(prng.below(100'000)));
}

template <typename T>
void integer(Prng& prng, T& out) {
  out = static_cast<T>(1 + prng.below(200));
}

PlaneFit plane(Prng& prng) {
  PlaneFit p;
  p.ok = true;
  p.doubt = static_cast<PlaneDoubt>(prng.below(kPlaneDoubts));
  p.normal = vector(prng);
  p.offset_mm = number(prng);
  p.points = prng.next() >> 20U;
  p.inliers = prng.next() >> 21U;
  p.inlier_fraction = prng.uniform();
  p.std_mm = number(prng);
  integer(prng, p.iterations);
  p.centroid = vector(prng);
  p.sigma_offset_mm = number(prng);
  matrix(prng, p.cov_normal);
  return p;
}

CasingFeature casing(Prng& prng) {
  CasingFeature c;
  c.ok = prng.below(2) == 0;
  c.doubt = static_cast<CasingDoubt>(prng.below(kCasingDoubts));
  c.centre = vector(prng);
  c.radius_mm = number(prng);
  c.height_mm = number(prng);
  integer(prng, c.edge_points);
  integer(prng, c.rim_points);
  for (double* x : {&c.edge_rms_mm, &c.inlier_fraction, &c.rim_std_mm, &c.sigma_height_mm}) *x = number(prng);
  matrix(prng, c.cov_circle);
  return c;
}

SurfaceFinding finding(Prng& prng) {
  SurfaceFinding f;
  f.kind = static_cast<FindingKind>(prng.below(kFindingKinds));
  f.face = static_cast<FindingFace>(prng.below(kFindingFaces));
  for (double* x : {&f.x_mm, &f.s_mm, &f.z_mm, &f.length_mm, &f.width_mm, &f.depth_mm, &f.area_mm2, &f.volume_mm3})
    *x = number(prng);
  return f;
}

EdgeFeature edge(Prng& prng) {
  EdgeFeature e;
  e.face = static_cast<EdgeFace>(prng.below(kEdgeFaces));
  e.face_to = static_cast<EdgeFace>(prng.below(kEdgeFaces));
  for (double* x : {&e.radius_mm, &e.chamfer_mm, &e.nominal_mm}) *x = number(prng);
  integer(prng, e.n);
  return e;
}

Item item(Prng& prng) {
  Item i;
  i.id = static_cast<ItemId>(prng.below(kItemCount));
  i.verdict = static_cast<Verdict>(prng.below(6));
  i.required = prng.below(2) == 0;
  i.station = static_cast<std::uint8_t>(prng.below(19));
  i.station_to = static_cast<std::uint8_t>(prng.below(19));
  for (double* x : {&i.value, &i.nominal, &i.lower, &i.upper, &i.U, &i.companion}) *x = number(prng);
  i.measured = number(prng);
  for (double& part : i.budget) part = number(prng);
  return i;
}

GaugeReading gauge_reading(Prng& prng, std::size_t index) {
  GaugeReading g;
  g.gauge.printf("gauge_%zu", index);
  word(prng, g.source);
  g.unit = prng.below(2) == 0 ? ItemUnit::mm : ItemUnit::deg;
  g.state = static_cast<GaugeState>(prng.below(kGaugeStates));
  for (double* x : {&g.value, &g.u, &g.u_master, &g.age_s, &g.check_deviation}) *x = number(prng);
  g.seq = static_cast<std::uint32_t>(prng.next());
  g.slab_no = static_cast<std::uint32_t>(prng.next());
  g.utime_us = static_cast<std::int64_t>(prng.next() >> 10U);
  g.check_utime_us = static_cast<std::int64_t>(prng.next() >> 10U);
  return g;
}

std::uint64_t bits(double x) {
  return std::bit_cast<std::uint64_t>(std::isnan(x) ? kNoValue : x);
}

#define SAME(field) EXPECT_EQ(a.field, b.field)
#define SAME_BITS(field) EXPECT_EQ(bits(a.field), bits(b.field)) << #field << " " << a.field << " " << b.field

void expect_same(const Vec3& a, const Vec3& b) {
  for (int i = 0; i < 3; ++i) SAME_BITS(operator[](i));
}

template <typename Matrix>
void expect_same_matrix(const Matrix& a, const Matrix& b, const char* what) {
  for (int row = 0; row < a.rows(); ++row)
    for (int column = 0; column < a.cols(); ++column)
      EXPECT_EQ(bits(a(row, column)), bits(b(row, column))) << what << " " << row << " " << column;
}

void expect_same(const Pose& a, const Pose& b) {
  const auto x = a.to_array();
  const auto y = b.to_array();
  for (std::size_t i = 0; i < x.size(); ++i) EXPECT_EQ(bits(x[i]), bits(y[i]));
}

void expect_same(const PlaneFit& a, const PlaneFit& b) {
  SAME(ok);
  SAME(doubt);
  expect_same(a.normal, b.normal);
  SAME_BITS(offset_mm);
  SAME(points);
  SAME(inliers);
  SAME_BITS(inlier_fraction);
  SAME_BITS(std_mm);
  SAME(iterations);
  expect_same(a.centroid, b.centroid);
  SAME_BITS(sigma_offset_mm);
  expect_same_matrix(a.cov_normal, b.cov_normal, "cov_normal");
}

void expect_same(const CasingFeature& a, const CasingFeature& b) {
  SAME(ok);
  SAME(doubt);
  expect_same(a.centre, b.centre);
  SAME_BITS(radius_mm);
  SAME_BITS(height_mm);
  SAME(edge_points);
  SAME(rim_points);
  SAME_BITS(edge_rms_mm);
  SAME_BITS(inlier_fraction);
  SAME_BITS(rim_std_mm);
  SAME_BITS(sigma_height_mm);
  expect_same_matrix(a.cov_circle, b.cov_circle, "cov_circle");
}

void expect_same(const Item& a, const Item& b) {
  SAME(id);
  SAME(verdict);
  SAME(required);
  SAME(station);
  SAME(station_to);
  SAME_BITS(value);
  SAME_BITS(nominal);
  SAME_BITS(lower);
  SAME_BITS(upper);
  SAME_BITS(U);
  SAME_BITS(measured);
  SAME_BITS(companion);
  for (std::size_t part = 0; part < kBudgetParts; ++part) SAME_BITS(budget[part]);
}

template <std::size_t N>
void expect_same_items(const FixedVector<Item, N>& a, const FixedVector<Item, N>& b) {
  ASSERT_EQ(a.size(), b.size());
  for (std::size_t i = 0; i < a.size(); ++i) expect_same(a[i], b[i]);
}

}  // namespace

void expect_same(const SlabHeader& a, const SlabHeader& b) {
  SAME(key);
  SAME(slab_id.view());
  SAME(slab_no);
  SAME(slab_type);
  SAME(stations);
  SAME(temperature_dk);
  SAME(age_h);
  SAME(mould);
  SAME(recipe.view());
  SAME(recipe_sha256.view());
  SAME(design_sha256.view());
  SAME(design_text.view());
  SAME(unconfirmed);
  SAME_BITS(guard);
  SAME_BITS(cell_mm);
  SAME(calibration_id.view());
  SAME(stations_id.view());
  SAME(scanner_id.view());
  SAME(software.view());
  expect_same(a.T_base_slab, b.T_base_slab);
  expect_same(a.T_flange_scanner, b.T_flange_scanner);
  SAME(began_utime_us);
  SAME(emulated);
  SAME(tie_id.view());
  ASSERT_EQ(a.more_arms.size(), b.more_arms.size());
  for (std::size_t i = 0; i < a.more_arms.size(); ++i) {
    SAME(more_arms[i].by.robot.view());
    SAME(more_arms[i].by.scanner.view());
    SAME(more_arms[i].calibration_id.view());
    SAME(more_arms[i].stations_id.view());
    SAME(more_arms[i].scanner_id.view());
    expect_same(a.more_arms[i].T_flange_scanner, b.more_arms[i].T_flange_scanner);
  }
}

void expect_same(const Attempt& a, const Attempt& b) {
  SAME(slab_key);
  SAME(station);
  SAME(number);
  SAME(session);
  SAME(cmd_seq);
  expect_same(a.T_base_flange, b.T_base_flange);
  SAME_BITS(pose_spread_mm);
  SAME(pose_samples);
  SAME(scan_path.view());
  SAME(shape.points);
  SAME(shape.finite);
  SAME(shape.width);
  SAME(shape.height);
  SAME(splice.source);
  SAME(splice.visits);
  expect_same(a.splice.T_base_reported, b.splice.T_base_reported);
  SAME_BITS(splice.off_mm);
  SAME_BITS(splice.off_rad);
  SAME_BITS(splice.calibration_mm);
  SAME_BITS(splice.calibration_rad);
  SAME_BITS(splice.robot_mm);
  SAME_BITS(splice.robot_rad);
  SAME(scan_utime_us);
  SAME_BITS(settle_ms);
  SAME_BITS(acquire_ms);
  SAME(points_crc32c);
  SAME(emulated);
  SAME(fingerprint);
  SAME_BITS(shape.scanner_temperature_c);
  SAME_BITS(scanner_drift);
  SAME(arm);
  SAME(by.robot.view());
  SAME(by.scanner.view());
  SAME(splice.tied);
  expect_same(a.splice.T_base_robot, b.splice.T_base_robot);
}

void expect_same(const PackedMap& a, const PackedMap& b) {
  EXPECT_EQ(a.columns, b.columns);
  EXPECT_EQ(a.rows, b.rows);
  EXPECT_EQ(a.cell_mm, b.cell_mm);
  EXPECT_EQ(a.step_mm, b.step_mm);
  EXPECT_TRUE(std::equal(a.bytes.begin(), a.bytes.end(), b.bytes.begin(), b.bytes.end()));
}

void expect_same(const BlockResult& a, const BlockResult& b) {
  SAME(station);
  SAME(verdict);
  SAME(reason);
  SAME(scan.points_read);
  SAME(scan.points_finite);
  SAME(scan.isolated_removed);
  SAME(scan.points_kept);
  expect_same(a.scan.step_mm, b.scan.step_mm);
  ASSERT_EQ(a.findings.size(), b.findings.size());
  for (std::size_t i = 0; i < a.findings.size(); ++i) {
    SAME(findings[i].kind);
    SAME(findings[i].face);
    SAME_BITS(findings[i].x_mm);
    SAME_BITS(findings[i].s_mm);
    SAME_BITS(findings[i].z_mm);
    SAME_BITS(findings[i].length_mm);
    SAME_BITS(findings[i].width_mm);
    SAME_BITS(findings[i].depth_mm);
    SAME_BITS(findings[i].area_mm2);
    SAME_BITS(findings[i].volume_mm3);
  }
  SAME(pores.count);
  SAME_BITS(pores.largest_mm);
  SAME_BITS(pores.deepest_mm);
  SAME_BITS(pores.share);
  SAME_BITS(pores.limits.depth_max_mm);
  SAME_BITS(pores.limits.share_max);
  ASSERT_EQ(a.edges.size(), b.edges.size());
  for (std::size_t i = 0; i < a.edges.size(); ++i) {
    SAME(edges[i].face);
    SAME(edges[i].face_to);
    SAME_BITS(edges[i].radius_mm);
    SAME_BITS(edges[i].chamfer_mm);
    SAME_BITS(edges[i].nominal_mm);
    SAME(edges[i].n);
  }
  SAME(registration.status);
  SAME(registration.iterations);
  SAME_BITS(registration.share_associated);
  SAME_BITS(registration.condition);
  SAME(registration.note.view());
  expect_same(a.registration.T_scanner_block, b.registration.T_scanner_block);
  SAME(registration.deviation.count);
  SAME_BITS(registration.deviation.mean_mm);
  SAME_BITS(registration.deviation.std_mm);
  for (std::size_t i = 0; i < 6; ++i) SAME_BITS(registration.deviation.within_sigma[i]);
  SAME_BITS(registration.noise_mm);
  expect_same_matrix(a.registration.covariance, b.registration.covariance, "registration.covariance");
  expect_same(a.seat.plane, b.seat.plane);
  expect_same(a.seat.full_plane, b.seat.full_plane);
  expect_same(a.seat.normal_datum, b.seat.normal_datum);
  SAME(seat.grid_points);
  SAME_BITS(seat.std_cells_mm);
  SAME_BITS(seat.flatness_mm);
  SAME_BITS(seat.flatness_min_zone_mm);
  SAME_BITS(seat.flatness_closed_mm);
  SAME_BITS(seat.flatness_raw_mm);
  SAME_BITS(seat.flatness_trimmed_mm);
  SAME_BITS(seat.raw_low_mm);
  SAME_BITS(seat.raw_high_mm);
  SAME_BITS(seat.noise_factor);
  SAME_BITS(seat.flatness_noise_mm);
  SAME_BITS(seat.defect.limit_mm);
  SAME(seat.defect.cells);
  SAME_BITS(seat.defect.area_mm2);
  SAME_BITS(seat.defect.height_mm);
  SAME_BITS(seat.defect.x_mm);
  SAME_BITS(seat.defect.s_mm);
  SAME(pores.count);
  SAME_BITS(pores.largest_mm);
  SAME_BITS(pores.deepest_mm);
  SAME_BITS(pores.share);
  expect_same(a.jaw_inner, b.jaw_inner);
  expect_same(a.jaw_outer, b.jaw_outer);
  expect_same(a.slab_top, b.slab_top);
  expect_same(a.casing_inner, b.casing_inner);
  expect_same(a.casing_outer, b.casing_outer);
  expect_same_items(a.items, b.items);
  SAME(observation.ok);
  SAME(observation.jaw_ok);
  SAME(observation.top_ok);
  expect_same(a.observation.p_base, b.observation.p_base);
  expect_same(a.observation.n_base, b.observation.n_base);
  expect_same(a.observation.jaw_outer_base, b.observation.jaw_outer_base);
  expect_same(a.observation.top_n_base, b.observation.top_n_base);
  expect_same(a.observation.sigma_p_mm, b.observation.sigma_p_mm);
  expect_same(a.observation.sigma_jaw_mm, b.observation.sigma_jaw_mm);
  expect_same(a.observation.sigma_n_rad, b.observation.sigma_n_rad);
  expect_same(a.observation.sigma_top_n_rad, b.observation.sigma_top_n_rad);
  SAME_BITS(times.read_ms);
  SAME_BITS(times.denoise_ms);
  SAME_BITS(times.register_ms);
  SAME_BITS(times.extract_ms);
  SAME_BITS(times.total_ms);
}

void expect_same(const GaugeReading& a, const GaugeReading& b) {
  SAME(gauge);
  SAME(source);
  SAME(unit);
  SAME(state);
  SAME_BITS(value);
  SAME_BITS(u);
  SAME_BITS(u_master);
  SAME(seq);
  SAME(slab_no);
  SAME(utime_us);
  SAME_BITS(age_s);
  SAME(check_utime_us);
  SAME_BITS(check_deviation);
}

void expect_same(const SlabResult& a, const SlabResult& b) {
  SAME(verdict);
  SAME(reason);
  SAME(fit.ok);
  SAME(fit.seats);
  SAME(fit.iterations);
  SAME_BITS(fit.rms_mm);
  SAME_BITS(fit.plain_rms_mm);
  expect_same(a.fit.T_base_slab, b.fit.T_base_slab);
  SAME(fit.note.view());
  expect_same_items(a.items, b.items);
  ASSERT_EQ(a.gauges.size(), b.gauges.size());
  for (std::size_t i = 0; i < a.gauges.size(); ++i) expect_same(a.gauges[i], b.gauges[i]);
  SAME(station_verdict);
  SAME(station_reason);
}

void expect_same(const PlcResult& a, const PlcResult& b) {
  SAME(res_seq);
  SAME(kind);
  SAME(cmd_seq);
  SAME(station);
  SAME(slab_no);
  SAME(verdict);
  SAME(reason);
  SAME(fail_mask);
  SAME(open_mask);
  SAME_BITS(flatness_mm);
  SAME_BITS(std_mm);
  for (std::size_t i = 0; i < kPlcDeviations; ++i) SAME_BITS(deviation[i]);
  SAME(points);
  SAME(scan_utime_us);
  SAME(emulated);
}

#undef SAME
#undef SAME_BITS

// ---- random records ----------------------------------------------------------------------------------------------

SlabHeader random_header(Prng& prng, std::int64_t key) {
  SlabHeader h;
  h.key = key;
  word(prng, h.slab_id);
  h.slab_no = static_cast<std::uint32_t>(prng.next());
  h.slab_type = static_cast<std::uint16_t>(prng.next());
  h.stations = 18;
  integer(prng, h.temperature_dk);
  integer(prng, h.age_h);
  integer(prng, h.mould);
  word(prng, h.recipe);
  word(prng, h.recipe_sha256);
  word(prng, h.design_sha256);
  word(prng, h.design_text);
  integer(prng, h.unconfirmed);
  h.guard = number(prng);
  h.cell_mm = number(prng);
  word(prng, h.calibration_id);
  word(prng, h.stations_id);
  word(prng, h.scanner_id);
  word(prng, h.software);
  h.T_base_slab = pose(prng);
  h.T_flange_scanner = pose(prng);
  h.began_utime_us = static_cast<std::int64_t>(prng.next() >> 10U);
  h.emulated = 15;  // so that no attempt adds a bit
  word(prng, h.tie_id);
  SlabArm arm;
  word(prng, arm.by.robot);
  word(prng, arm.by.scanner);
  word(prng, arm.calibration_id);
  word(prng, arm.stations_id);
  word(prng, arm.scanner_id);
  arm.T_flange_scanner = pose(prng);
  EXPECT_TRUE(h.more_arms.push(arm));
  return h;
}

Attempt random_attempt(Prng& prng, std::int64_t slab_key, int station, int number_of_attempt) {
  Attempt a;
  a.slab_key = slab_key;
  a.station = static_cast<std::uint8_t>(station);
  a.number = static_cast<std::uint8_t>(number_of_attempt);
  a.session = 65'535;
  a.cmd_seq = 65'534;
  a.T_base_flange = pose(prng);
  a.pose_spread_mm = number(prng);
  integer(prng, a.pose_samples);
  word(prng, a.scan_path);
  a.shape = {4'900'000 + prng.below(1000), 4'800'000 + prng.below(1000), 2448, 2048};
  a.shape.scanner_temperature_c = number(prng);
  a.scanner_drift = number(prng);
  a.scan_utime_us = static_cast<std::int64_t>(prng.next() >> 10U);
  a.settle_ms = number(prng);
  a.acquire_ms = number(prng);
  Splice& s = a.splice;
  s.source = static_cast<SpliceSource>(prng.below(kSpliceSources));
  integer(prng, s.visits);
  s.T_base_reported = pose(prng);
  for (double* x : {&s.off_mm, &s.off_rad, &s.calibration_mm, &s.calibration_rad, &s.robot_mm, &s.robot_rad})
    *x = number(prng);
  if (prng.below(4) != 0) a.points_crc32c = static_cast<std::uint32_t>(prng.next());
  a.emulated = static_cast<std::uint8_t>(station % 16);
  if (prng.below(4) != 0) a.fingerprint = static_cast<std::int64_t>(prng.next());
  a.arm = static_cast<std::uint8_t>(prng.below(limits::kArmsMax));
  word(prng, a.by.robot);
  word(prng, a.by.scanner);
  s.tied = prng.below(2) == 0;
  s.T_base_robot = pose(prng);
  return a;
}

BlockMaps random_maps(Prng& prng) {
  BlockMaps maps;
  for (PackedMap* map : {&maps.registration, &maps.seat}) {
    integer(prng, map->columns);
    integer(prng, map->rows);
    map->cell_mm = 1.0 + prng.uniform();
    map->step_mm = prng.uniform();
    const std::uint64_t bytes = 1 + prng.below(limits::kPackedMapBytes);
    for (std::uint64_t i = 0; i < bytes; ++i) EXPECT_TRUE(map->bytes.push(static_cast<std::uint8_t>(prng.below(256))));
  }
  return maps;
}

BlockResult random_block(Prng& prng, int station, Verdict verdict) {
  BlockResult b;
  b.station = static_cast<std::uint8_t>(station);
  b.verdict = verdict;
  integer(prng, b.reason);
  b.scan = {prng.next() >> 12U, prng.next() >> 12U, prng.next() >> 12U, prng.next() >> 12U};
  b.registration.status = static_cast<RegistrationStatus>(prng.below(5));
  integer(prng, b.registration.iterations);
  b.registration.share_associated = prng.uniform();
  b.registration.condition = number(prng);
  word(prng, b.registration.note);
  b.registration.T_scanner_block = pose(prng);
  b.registration.deviation.count = prng.next() >> 12U;
  b.registration.deviation.mean_mm = number(prng);
  b.registration.deviation.std_mm = number(prng);
  for (double& share : b.registration.deviation.within_sigma) share = prng.uniform();
  b.registration.noise_mm = number(prng);
  matrix(prng, b.registration.covariance);
  b.seat.plane = plane(prng);
  b.seat.full_plane = plane(prng);
  b.seat.normal_datum = vector(prng);
  integer(prng, b.seat.grid_points);
  for (double* x : {&b.seat.std_cells_mm, &b.seat.flatness_mm, &b.seat.flatness_closed_mm, &b.seat.flatness_raw_mm,
                    &b.seat.flatness_trimmed_mm, &b.seat.flatness_min_zone_mm, &b.seat.raw_low_mm, &b.seat.raw_high_mm,
                    &b.seat.noise_factor, &b.seat.flatness_noise_mm, &b.seat.defect.limit_mm, &b.seat.defect.area_mm2,
                    &b.seat.defect.height_mm, &b.seat.defect.x_mm, &b.seat.defect.s_mm})
    *x = number(prng);
  integer(prng, b.seat.defect.cells);
  integer(prng, b.pores.count);
  for (double* x : {&b.pores.largest_mm, &b.pores.deepest_mm, &b.pores.share, &b.pores.limits.depth_max_mm,
                    &b.pores.limits.share_max})
    *x = number(prng);
  b.jaw_inner = plane(prng);
  b.jaw_outer = plane(prng);
  b.slab_top = plane(prng);
  b.casing_inner = casing(prng);
  b.casing_outer = casing(prng);
  while (b.items.push(item(prng))) {
  }
  b.observation.ok = prng.below(2) == 0;
  b.observation.jaw_ok = prng.below(2) == 0;
  b.observation.top_ok = prng.below(2) == 0;
  b.observation.p_base = vector(prng);
  b.observation.n_base = vector(prng);
  b.observation.jaw_outer_base = vector(prng);
  b.observation.top_n_base = vector(prng);
  b.observation.sigma_p_mm = vector(prng);
  b.observation.sigma_jaw_mm = vector(prng);
  b.observation.sigma_n_rad = vector(prng);
  b.observation.sigma_top_n_rad = vector(prng);
  b.scan.step_mm = vector(prng);
  while (b.findings.push(finding(prng))) {
  }
  while (b.edges.push(edge(prng))) {
  }
  b.times = {number(prng), number(prng), number(prng), number(prng), number(prng)};
  return b;
}

SlabResult random_slab(Prng& prng, Verdict verdict) {
  SlabResult s;
  s.verdict = verdict;
  integer(prng, s.reason);
  s.fit.ok = prng.below(2) == 0;
  integer(prng, s.fit.seats);
  integer(prng, s.fit.iterations);
  s.fit.rms_mm = number(prng);
  s.fit.plain_rms_mm = number(prng);
  s.fit.T_base_slab = pose(prng);
  word(prng, s.fit.note);
  while (s.items.push(item(prng))) {
  }
  for (Verdict& v : s.station_verdict) v = static_cast<Verdict>(prng.below(6));
  for (std::uint16_t& r : s.station_reason) integer(prng, r);
  while (s.gauges.push(gauge_reading(prng, s.gauges.size()))) {
  }
  return s;
}

PlcResult random_record(Prng& prng, std::uint16_t res_seq, std::uint16_t kind) {
  PlcResult r;
  r.res_seq = res_seq;
  r.kind = kind;
  r.cmd_seq = static_cast<std::uint16_t>(prng.next());
  r.station = static_cast<std::uint16_t>(kind == 1 ? 1 + prng.below(18) : 0);
  r.slab_no = static_cast<std::uint32_t>(prng.next());
  r.verdict = static_cast<Verdict>(prng.below(6));
  integer(prng, r.reason);
  r.fail_mask = static_cast<std::uint16_t>(prng.next());
  r.open_mask = static_cast<std::uint16_t>(prng.next());
  r.flatness_mm = number(prng);
  r.std_mm = number(prng);
  for (double& d : r.deviation) d = number(prng);
  r.points = static_cast<std::uint32_t>(prng.next());
  r.scan_utime_us = static_cast<std::int64_t>(prng.next() >> 10U);
  r.emulated = static_cast<std::uint8_t>(res_seq % 16);
  return r;
}

// ---- the fixture -------------------------------------------------------------------------------------------------

TemporaryFolder::TemporaryFolder(const std::string& where) {
  const bool there = !where.empty() && std::filesystem::is_directory(where);
  const std::filesystem::path parent = there ? std::filesystem::path(where) : std::filesystem::temp_directory_path();
  std::string name = (parent / "slabd-storage-XXXXXX").string();
  const char* made = mkdtemp(name.data());
  EXPECT_NE(made, nullptr);
  path_ = name;
}

TemporaryFolder::~TemporaryFolder() {
  std::error_code ec;
  std::filesystem::remove_all(path_, ec);
}

StoreTest::StoreTest() {
  settings_.db_path = folder_.path() + "/db/slabd.db";
  settings_.spool_dir = folder_.path() + "/spool";
  settings_.spool_free_bytes_min = 1'000'000;
}

void StoreTest::open() {
  store_.reset();
  Result<std::unique_ptr<Store>> store = open_store(settings_);
  ASSERT_TRUE(store.ok()) << store.error().text.view();
  store_ = std::move(store.value());
}

Status StoreTest::try_apply(const decltype(StoreJob::what)& what) {
  return store_->apply({1, what});
}

void StoreTest::apply(const decltype(StoreJob::what)& what) {
  const Status status = try_apply(what);
  ASSERT_TRUE(status.ok()) << status.error().text.view();
}

std::unique_ptr<RecoveredLine> StoreTest::recover() {
  Result<std::unique_ptr<RecoveredLine>> line = store_->recover();
  EXPECT_TRUE(line.ok()) << line.error().text.view();
  return line.ok() ? std::move(line.value()) : std::make_unique<RecoveredLine>();
}

std::unique_ptr<Reader> StoreTest::reader() {
  Result<std::unique_ptr<Reader>> reader = open_reader(settings_.db_path);
  EXPECT_TRUE(reader.ok()) << reader.error().text.view();
  return reader.ok() ? std::move(reader.value()) : nullptr;
}

std::string StoreTest::scan_file(std::int64_t slab_key, int station, int attempt, std::size_t bytes) {
  const std::string slab_folder = settings_.spool_dir + "/" + std::to_string(slab_key);
  std::filesystem::create_directories(slab_folder);
  const std::string path = slab_folder + "/" + std::to_string(station) + "-" + std::to_string(attempt) + ".ply";
  std::ofstream(path) << std::string(bytes, 'x');
  return path;
}

void StoreTest::begin(std::int64_t slab_key, std::uint32_t slab_no) {
  BeginSlabJob job{random_header(prng_, slab_key), session_, ++cmd_seq_};
  job.slab.slab_no = slab_no;
  apply(job);
}

void StoreTest::accept(PlcCommand command, int station, std::int64_t slab_key) {
  apply(CommandJob{session_, ++cmd_seq_, static_cast<std::uint16_t>(command), static_cast<std::uint8_t>(station),
                   slab_key, 1'000'000 + cmd_seq_});
}

Attempt StoreTest::attempt(std::int64_t slab_key, int station, int number_of_attempt) {
  Attempt a = random_attempt(prng_, slab_key, station, number_of_attempt);
  a.session = session_;
  a.cmd_seq = cmd_seq_;
  return a;
}

void StoreTest::acquire(std::int64_t slab_key, int station, int number_of_attempt) {
  accept(PlcCommand::scan, station, slab_key);
  Attempt a = attempt(slab_key, station, number_of_attempt);
  a.scan_path.assign(scan_file(slab_key, station, number_of_attempt, 1000));
  apply(AcquiredJob{a});
}

std::uint16_t StoreTest::measure(std::int64_t slab_key, int station, int number_of_attempt, Verdict verdict) {
  PlcResult record = random_record(prng_, ++res_seq_, 1);
  record.station = static_cast<std::uint16_t>(station);
  record.cmd_seq = cmd_seq_;
  apply(
      BlockJob{slab_key, static_cast<std::uint8_t>(number_of_attempt), random_block(prng_, station, verdict), record});
  return res_seq_;
}

std::uint16_t StoreTest::scan(std::int64_t slab_key, int station, int number_of_attempt, Verdict verdict) {
  acquire(slab_key, station, number_of_attempt);
  return measure(slab_key, station, number_of_attempt, verdict);
}

std::uint16_t StoreTest::end(std::int64_t slab_key, Verdict verdict) {
  accept(PlcCommand::slab_end, 0, slab_key);
  PlcResult record = random_record(prng_, ++res_seq_, 2);
  record.cmd_seq = cmd_seq_;
  apply(SlabJob{slab_key, random_slab(prng_, verdict), record, 5'000'000});
  return res_seq_;
}

void StoreTest::acknowledge(std::uint16_t res_seq) {
  std::vector<std::uint16_t> waiting;
  {
    Result<std::unique_ptr<Connection>> db = open_for_reading(settings_.db_path);
    ASSERT_TRUE(db.ok()) << db.error().text.view();
    Statement rows(*db.value(), "SELECT res_seq FROM result WHERE acknowledged = 0 ORDER BY id");
    while (rows.step()) waiting.push_back(static_cast<std::uint16_t>(rows.integer(0)));
  }
  for (const std::uint16_t next : waiting) {
    apply(AckJob{next});
    if (next == res_seq) return;
  }
  FAIL() << "record " << res_seq << " does not wait";
}

}  // namespace slabd::storage
