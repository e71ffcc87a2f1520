// SPDX-License-Identifier: Apache-2.0
#include "tests/sim/line.h"

#include <cassert>
#include <cmath>

namespace slabd::sim {
namespace {

Pose shifted(const Pose& pose, const Vec3& by_mm) {
  Pose out = pose;
  out.translation_mm += by_mm;
  return out;
}

double small(Prng& chance, double half_width) {
  return (2.0 * chance.uniform() - 1.0) * half_width;
}

/// Draws the values one after the other; as arguments of one call their order would depend on the compiler.
Vec3 scattered(Prng& chance, const Vec3& half_width) {
  Vec3 off;
  for (Eigen::Index i = 0; i < off.size(); ++i) off[i] = small(chance, half_width[i]);
  return off;
}

}  // namespace

// ---- the robot -----------------------------------------------------------------------------------------------------

Robot::Robot(World& world, std::uint64_t part, const Vec3& home_mm, const Pose& T_base_slab_nominal,
             const Pose& T_flange_scanner)
    : world_(world),
      chance_(world.chance(part)),
      T_base_slab_(T_base_slab_nominal),
      T_flange_scanner_(T_flange_scanner) {
  home_.translation_mm = home_mm;
  to_ = from_ = home_;
}

void Robot::go_to(const Recipe& recipe, int station) {
  const Pose T_base_scanner = T_base_slab_ * T_slab_block(recipe, station) * nominal_T_block_scanner();
  go(T_base_scanner * T_flange_scanner_.inverse());
}

void Robot::go_home() {
  go(home_);
}

void Robot::go(const Pose& target) {
  from_ = T_base_flange(world_.now_ns);
  to_ = target;
  to_.translation_mm += scattered(chance_, Vec3(0.02, 0.02, 0.02));
  leaves_ns_ = world_.now_ns;
  arrives_ns_ = leaves_ns_ + between(chance_, 300 * kMs, 900 * kMs);
}

Pose Robot::T_base_flange(std::int64_t at_ns) const {
  Pose pose = to_;
  if (at_ns < arrives_ns_ && arrives_ns_ > leaves_ns_) {
    const double share =
        std::max(0.0, static_cast<double>(at_ns - leaves_ns_) / static_cast<double>(arrives_ns_ - leaves_ns_));
    pose.translation_mm = from_.translation_mm + share * (to_.translation_mm - from_.translation_mm);
  }
  if (at_ns >= jolt_from_ns_ && at_ns < jolt_to_ns_) pose.translation_mm.x() += 0.4;
  return pose;
}

bool Robot::moves(std::int64_t from_ns, std::int64_t to_ns) const {
  // A distance below the robot's repeatability is not a motion: its target is its present position.
  const bool far = (to_.translation_mm - from_.translation_mm).norm() > 0.1;
  const bool travels = far && from_ns < arrives_ns_ && to_ns > leaves_ns_;
  return travels || (from_ns < jolt_to_ns_ && to_ns > jolt_from_ns_);
}

// ---- the line ------------------------------------------------------------------------------------------------------

Line::Line(World& world_in, std::span<const Recipe> recipes_in, int robots_in)
    : world(world_in), recipes(recipes_in), chance(world_in.chance(3)) {
  T_base_slab.translation_mm = Vec3(1'800.0, 0.0, 400.0);
  robots.reserve(2);  // others refer to its elements
  T_base_robot.emplace_back();
  T_flange_scanner.push_back({Quat::Identity(), Vec3(0.0, 0.0, 120.0)});
  robots.emplace_back(world, 2, Vec3(0.0, 1'500.0, 1'800.0), T_base_slab, T_flange_scanner[0]);
  if (robots_in == 1) return;
  T_base_robot.push_back({rotation_from_kuka_abc(kPi, 0.0, 0.0), Vec3(3'600.0, 40.0, 5.0)});
  T_flange_scanner.push_back({Quat::Identity(), Vec3(7.0, -70.0, 160.0)});
  robots.emplace_back(world, 12, Vec3(3'600.0, -1'500.0, 1'800.0), T_base_slab, T_flange_scanner[1]);
  // By thirds of the slab; one station at each border may be scanned by both.
  (void)arms.list.push(Arm{PartId("2"), PartId("2")});
  for (std::size_t i = 0; i < arms.of_station.size(); ++i) {
    const std::uint8_t usual = i / 6 == 1 ? 1 : 0;
    arms.of_station[i].clear();
    (void)arms.of_station[i].push(usual);
    if (i % 6 == 5) (void)arms.of_station[i].push(static_cast<std::uint8_t>(1 - usual));
  }
}

void Line::lay_down(bool again, bool certainly_good) {
  slab.serial = ++serials_;
  slab.placed_ns = world.now_ns;
  if (!again || slab.recipe == nullptr) {
    slab.slab_no = ++last_no_;
    // Mostly the short recipe, so that a life contains more slabs.
    slab.recipe = &recipes[happens(chance, 0.1) ? 1 : 0];
  }
  slab.blocks = {};
  if (!certainly_good && happens(chance, 0.45)) {
    const auto bad = 1 + chance.below(3);
    for (std::uint64_t i = 0; i < bad; ++i)
      slab.blocks[chance.below(slab.recipe->stations())] = static_cast<BlockTruth>(1 + chance.below(6));
  }
  slab.T_base_slab = shifted(T_base_slab, scattered(chance, Vec3(1.0, 1.0, 0.5)));
  world.trace.line(world.now_ns, "line: slab %u (placement %u) of %u blocks, %s", slab.slab_no, slab.serial,
                   slab.recipe->stations(), slab.good() ? "good" : "not good");
}

void Line::write(const ScanTruth& shown, std::span<float> xyz) const {
  xyz[0] = 1.0F;
  xyz[1] = static_cast<float>(shown.take);
  xyz[2] = static_cast<float>(shown.block);
  xyz[3] = static_cast<float>(shown.serial);
}

ScanTruth Line::read(std::span<const float> xyz) const {
  const auto take = static_cast<std::size_t>(xyz[1]);
  return xyz[0] == 1.0F && take >= 1 && take <= takes.size() ? takes[take - 1] : ScanTruth{};
}

ScanTruth Line::in_spool(const std::string& path) const {
  const auto at = spool.find(path);
  return at == spool.end() ? ScanTruth{} : takes[at->second - 1];
}

ScanTruth& Line::expose(std::size_t arm) {
  ScanTruth& shown = takes.emplace_back();
  shown.take = static_cast<std::uint32_t>(takes.size());
  shown.exposed_ns = world.now_ns;
  if (slab.serial == 0) return shown;
  shown.serial = slab.serial;
  const Pose T_base_scanner = robots[arm].T_base_scanner(world.now_ns);
  for (int k = 1; k <= slab.recipe->stations(); ++k) {
    Pose T_base_block = slab.T_base_slab * T_slab_block(*slab.recipe, k);
    const BlockTruth truth = slab.blocks[static_cast<std::size_t>(k - 1)];
    const Vec3 p = T_base_scanner.inverse() * T_base_block.translation_mm;
    if (std::hypot(p.x(), p.y()) > 250.0) continue;
    if (truth == BlockTruth::slope)
      T_base_block.rotation = T_base_block.rotation * Quat(Eigen::AngleAxisd(rad_from_deg(0.5), Vec3::UnitX()));
    if (truth == BlockTruth::displaced) T_base_block.translation_mm.y() += 1.2;
    shown.block = static_cast<std::uint8_t>(k);
    shown.truth = truth;
    shown.T_scanner_block = T_base_scanner.inverse() * T_base_block;
  }
  return shown;
}

// ---- measuring -----------------------------------------------------------------------------------------------------

void gauge(const Recipe& recipe, const daemon::MeasureBlock& job, const ScanTruth& shown, BlockResult& block) {
  block = {};
  block.station = job.id.station;
  block.scan.points_read = job.shape.points;
  block.scan.points_finite = job.shape.finite;
  Code code = Code::ok;
  const Pose T_base_block_nominal = job.basis.T_base_slab * T_slab_block(recipe, job.id.station);
  const Pose T_base_block = job.T_base_scanner * shown.T_scanner_block;
  const Vec3 off = T_base_block.translation_mm - T_base_block_nominal.translation_mm;
  if (shown.take == 0 || shown.mostly_nan)
    code = Code::too_few_points;
  else if (shown.block == 0 || off.norm() > recipe.evaluation.window_mm)
    code = Code::block_not_found;

  constexpr std::array kItems = {
      ItemId::seat_slope,   ItemId::seat_flatness,  ItemId::jaw_angle_inner,         ItemId::jaw_angle_outer,
      ItemId::jaw_distance, ItemId::casing_spacing, ItemId::casing_protrusion_inner, ItemId::casing_protrusion_outer};
  const auto spoilt = [&](ItemId id) {
    switch (shown.truth) {
      case BlockTruth::slope: return id == ItemId::seat_slope;
      case BlockTruth::jaw: return id == ItemId::jaw_distance;
      case BlockTruth::protrusion: return id == ItemId::casing_protrusion_outer;
      case BlockTruth::flatness: return id == ItemId::seat_flatness;
      default: return false;
    }
  };
  for (const ItemId id : kItems) {
    Item item = blank_item(recipe, id, job.id.station);
    if (code == Code::ok && !(shown.truth == BlockTruth::hidden && id == ItemId::casing_spacing)) {
      const double middle = 0.5 * ((has_value(item.lower) ? item.lower : 0.0) + item.upper);
      const double half = item.upper - middle;
      item.value = spoilt(id) ? item.upper + half : middle + 0.01 * half * (job.id.station % 3);
      item.verdict = judge(item, recipe.guard);
    }
    (void)block.items.push(item);
  }
  block.verdict = code == Code::ok ? combine(block.items.begin(), block.items.end()) : Verdict::not_measured;
  block.reason = reason_for(block.verdict, block.items.begin(), block.items.end(), code);
  block.times.total_ms = 400.0;
  if (code != Code::ok) return;

  block.registration.status = RegistrationStatus::converged;
  block.registration.T_scanner_block = shown.T_scanner_block;
  block.seat.noise_factor = 1.0;
  SeatObservation& o = block.observation;
  const double cant = std::atan(1.0 / recipe.block.cant_ratio.value);
  const double half = recipe.block.jaw_half_distance_mm.value;
  const double height = recipe.block.jaw_reference_height_mm.value;
  o.ok = o.jaw_ok = o.top_ok = true;
  o.p_base = T_base_block.translation_mm;
  o.n_base = T_base_block.rotation * Vec3(0.0, -std::sin(cant), std::cos(cant));
  o.jaw_outer_base = T_base_block * Vec3(0.0, half * std::cos(cant) - height * std::sin(cant),
                                         half * std::sin(cant) + height * std::cos(cant));
  o.top_n_base = T_base_block.rotation * Vec3::UnitZ();
  o.sigma_p_mm = Vec3::Constant(0.005);
  o.sigma_jaw_mm = Vec3::Constant(0.005);
  o.sigma_n_rad = Vec3::Constant(1e-5);
  o.sigma_top_n_rad = Vec3::Constant(1e-5);
}

}  // namespace slabd::sim
