// SPDX-License-Identifier: Apache-2.0
//
// A seat has ten quantities. Each is the sum of the mould's effect, the station's effect and a random part. Items of
// blocks are quantities; items between seats follow from those of their seats, and their truth as well.
#include "emulator/slab_history.h"

#include <algorithm>
#include <cmath>
#include <cstdio>

#include "base/plc.h"
#include "emulator/slab_scene.h"

namespace slabd::emulator {
namespace {

constexpr std::uint64_t kPlantStream = 31;
constexpr std::uint64_t kSlabStream = 32;
constexpr double kDay_us = 86'400e6;

/// Share of a mould's seats with a bias, by quantity, and share of the moulds with a seat that wears.
constexpr double kBiasedSeats = 0.05;
constexpr double kWornMoulds = 0.15;
constexpr int kBiasedStations = 2;
/// Sizes of planted biases, as a share of the scale of the quantity: 0.05 to 0.3 mm.
constexpr double kBiasMin = 0.05;
constexpr double kBiasMax = 0.3;

struct QuantityTraits {
  double scatter;  ///< standard deviation from slab to slab
  double scale;    ///< unit of the planted biases
  double U;        ///< expanded uncertainty of its items, k = 2
};
// x, y, z, slope (deg), jaw_inner (deg), jaw_outer (deg), jaw, casings, rim_inner, rim_outer
constexpr std::array<QuantityTraits, 10> kTraits = {{{0.06, 1.0, 0.10},
                                                     {0.08, 1.0, 0.10},
                                                     {0.08, 1.0, 0.10},
                                                     {0.015, 0.15, 0.006},
                                                     {0.05, 0.5, 0.02},
                                                     {0.05, 0.5, 0.02},
                                                     {0.06, 0.8, 0.05},
                                                     {0.04, 0.5, 0.04},
                                                     {0.02, 0.2, 0.03},
                                                     {0.02, 0.2, 0.03}}};
constexpr double kWarpScatter_mm = 0.4;
constexpr double kPoints = 4.9e6;
constexpr std::int64_t kStation_us = 7'000'000;

double of_size(Prng& random, double low, double high) {
  const double size = low + (high - low) * random.uniform();
  return random.uniform() < 0.5 ? -size : size;
}

Verdict worst(Verdict a, Verdict b) {
  for (const Verdict verdict : {Verdict::fail, Verdict::not_measured, Verdict::indeterminate})
    if (a == verdict || b == verdict) return verdict;
  return Verdict::pass;
}

std::uint16_t earlier(std::uint16_t a, std::uint16_t b) {
  return a == 0 || (b != 0 && b < a) ? b : a;
}

/// Item with a value and its U, judged.
Item item_with(const Recipe& recipe, ItemId id, int station, int station_to, double deviation, double U) {
  Item item = blank_item(recipe, id, station, station_to);
  item.value = (has_value(item.nominal) ? item.nominal : 0.0) + deviation;
  item.U = U;
  item.budget[static_cast<std::size_t>(BudgetPart::fit)] = 0.5 * U;
  item.verdict = judge(item, recipe.guard);
  return item;
}

bool is_listed(const Recipe& recipe, ItemId id) {
  return !info(id).optional || recipe.tolerance(id).given;
}

}  // namespace

SlabHistory::SlabHistory(const Recipe& recipe, const HistoryPlan& plan) : recipe_(recipe), plan_(plan) {
  plant();
}

void SlabHistory::plant() {
  Prng random(derived_seed(plan_.seed, kPlantStream, 0));
  const std::size_t stations = recipe_.stations();
  moulds_.resize(plan_.moulds);
  for (Effect& mould : moulds_) {
    for (std::size_t station = 0; station < stations; ++station)
      for (std::size_t q = 0; q < kQuantities; ++q)
        if (random.uniform() < kBiasedSeats)
          mould.bias[station][q] = kTraits[q].scale * of_size(random, kBiasMin, kBiasMax);
    // Wear lowers the seat's form: the seat of the slab becomes higher. 0.3 mm over the history.
    if (random.uniform() < kWornMoulds) mould.per_day[random.below(stations)][z] = 0.3 / plan_.days;
  }
  for (const Quantity q : {y, z, slope})
    for (int i = 0; i < kBiasedStations; ++i)
      line_.bias[random.below(stations)][q] = kTraits[q].scale * of_size(random, kBiasMin, kBiasMax);
}

std::vector<SlabHistory::Deviation> SlabHistory::deviations(const Seats& seats) const {
  std::vector<Deviation> list;
  const int stations = recipe_.stations();
  const int pairs = stations / 2;
  const auto at = [&](int station, Quantity q) { return seats[static_cast<std::size_t>(station - 1)][q]; };
  const auto add = [&](ItemId item, int station, int to, double value, double U) {
    list.push_back({item, station, to, value, U});
  };
  const auto add_own = [&](ItemId item, int station, Quantity q) {
    add(item, station, 0, at(station, q), kTraits[q].U);
  };
  for (int k = 1; k <= stations; ++k) {
    add_own(ItemId::seat_slope, k, slope);
    add_own(ItemId::jaw_angle_inner, k, jaw_inner);
    add_own(ItemId::jaw_angle_outer, k, jaw_outer);
    add_own(ItemId::jaw_distance, k, jaw);
    add_own(ItemId::casing_spacing, k, casings);
    add_own(ItemId::casing_protrusion_inner, k, rim_inner);
    add_own(ItemId::casing_protrusion_outer, k, rim_outer);
    add_own(ItemId::seat_lateral, k, y);
    add_own(ItemId::seat_vertical, k, z);
    // Row Y < 0 is numbered with falling X.
    if (k != pairs && k != stations)
      add(ItemId::seat_spacing, k, k + 1, k < pairs ? at(k + 1, x) - at(k, x) : at(k, x) - at(k + 1, x), 0.12);
  }
  for (int k = 1; k <= pairs; ++k) {
    const int other = opposite_station(recipe_, k);
    add(ItemId::large_jaw_distance, k, other, at(k, y) - at(other, y) + 0.5 * (at(k, jaw) + at(other, jaw)), 0.12);
  }
  add(ItemId::corner_level, 0, 0, at(1, z) - at(pairs, z) + at(pairs + 1, z) - at(stations, z), 0.2);
  return list;
}

void SlabHistory::add_truth(int mould, const Effect& effect, std::vector<PlantedEffect>& list) const {
  const std::vector<Deviation> biases = deviations(effect.bias);
  const std::vector<Deviation> changes = deviations(effect.per_day);
  for (std::size_t i = 0; i < biases.size(); ++i)
    if (biases[i].value != 0.0 || changes[i].value != 0.0)
      list.push_back(
          {mould, biases[i].item, biases[i].station, biases[i].station_to, biases[i].value, changes[i].value});
}

std::vector<PlantedEffect> SlabHistory::truth() const {
  std::vector<PlantedEffect> list;
  for (std::size_t i = 0; i < moulds_.size(); ++i) add_truth(static_cast<int>(i + 1), moulds_[i], list);
  add_truth(0, line_, list);
  return list;
}

double SlabHistory::scatter(ItemId item) const {
  const auto of = [](Quantity q) { return kTraits[q].scatter; };
  switch (item) {
    case ItemId::seat_slope: return of(slope);
    case ItemId::jaw_angle_inner: return of(jaw_inner);
    case ItemId::jaw_angle_outer: return of(jaw_outer);
    case ItemId::jaw_distance: return of(jaw);
    case ItemId::casing_spacing: return of(casings);
    case ItemId::casing_protrusion_inner: return of(rim_inner);
    case ItemId::casing_protrusion_outer: return of(rim_outer);
    case ItemId::seat_lateral: return of(y);
    case ItemId::seat_vertical: return of(z);
    case ItemId::seat_spacing: return std::sqrt(2.0) * of(x);
    case ItemId::large_jaw_distance: return std::hypot(std::sqrt(2.0) * of(y), std::sqrt(0.5) * of(jaw));
    case ItemId::corner_level: return 2.0 * of(z);
    default: return 0.0;
  }
}

void SlabHistory::make_block(int station, const std::vector<Deviation>& values, const Seats& seats, Prng& random,
                             const SlabHeader& header, BlockResult& block) const {
  block = {};
  block.station = static_cast<std::uint8_t>(station);
  block.scan.points_read = block.scan.points_finite = static_cast<std::uint64_t>(kPoints);
  block.scan.isolated_removed = random.below(20'000);
  block.scan.points_kept = block.scan.points_finite - block.scan.isolated_removed;
  block.registration.status = RegistrationStatus::converged;
  block.registration.iterations = 4;
  block.registration.share_associated = 0.95;
  block.registration.T_scanner_block = nominal_T_block_scanner();
  const double flatness = 0.2 * std::exp(0.3 * random.normal());
  block.seat.flatness_mm = block.seat.flatness_closed_mm = flatness;
  block.seat.std_cells_mm = 0.15 * flatness;
  for (std::size_t i = 0; i < kItemCount; ++i) {
    const auto id = static_cast<ItemId>(i);
    if (info(id).scope != ItemScope::block || !is_listed(recipe_, id)) continue;
    const auto found = std::find_if(values.begin(), values.end(),
                                    [&](const Deviation& d) { return d.item == id && d.station == station; });
    Item item = blank_item(recipe_, id, station);
    const double U = has_value(item.U) ? item.U : 0.05;
    if (found != values.end())
      item = item_with(recipe_, id, station, 0, found->value, found->U);
    else if (id == ItemId::seat_flatness)
      item = item_with(recipe_, id, station, 0, flatness, 0.05);
    else if (id == ItemId::seat_std)
      item = item_with(recipe_, id, station, 0, block.seat.std_cells_mm, U);
    else if (id == ItemId::surface_pores || id == ItemId::block_damage)
      item = item_with(recipe_, id, station, 0, 0.0, U);
    (void)block.items.push(item);
  }
  if (is_listed(recipe_, ItemId::surface_pores))
    block.pores.largest_mm = block.pores.deepest_mm = block.pores.share = 0.0;
  const Pose T_slab_block = slabd::T_slab_block(recipe_, station);
  const auto& seat = seats[static_cast<std::size_t>(station - 1)];
  block.observation.ok = block.observation.jaw_ok = block.observation.top_ok = true;
  block.observation.p_base =
      header.T_base_slab.translation_mm + T_slab_block.translation_mm + Vec3(seat[x], seat[y], seat[z]);
  block.observation.n_base = T_slab_block.rotation * Vec3(0.0, -0.025, 1.0).normalized();
  block.observation.top_n_base = Vec3::UnitZ();
  block.verdict = combine(block.items.begin(), block.items.end());
  block.reason = reason_for(block.verdict, block.items.begin(), block.items.end(), Code::ok);
}

void SlabHistory::judge(HistorySlab& out) const {
  SlabResult& slab = out.slab;
  slab.verdict = Verdict::pass;
  slab.reason = 0;
  const auto is_replaced = [&](const Item& item) {
    return item.id == ItemId::seat_slope && recipe_.slope_datum == SlopeDatum::slab_frame;
  };
  const auto take = [&](const FixedVector<Item, kSlabItemsMax>& items, std::size_t station) {
    const Verdict verdict = combine(items.begin(), items.end());
    const std::uint16_t reason = reason_for(verdict, items.begin(), items.end(), Code::ok);
    slab.fail_mask = static_cast<std::uint16_t>(slab.fail_mask | fail_mask(items.begin(), items.end()));
    slab.open_mask = static_cast<std::uint16_t>(slab.open_mask | open_mask(items.begin(), items.end()));
    const Verdict before = slab.verdict;
    slab.verdict = worst(before, verdict);
    if (slab.verdict != before) slab.reason = 0;
    if (verdict == slab.verdict) slab.reason = earlier(slab.reason, reason);
    if (station == 0) return;
    slab.station_verdict[station - 1] = verdict;
    slab.station_reason[station - 1] = reason;
  };
  FixedVector<Item, kSlabItemsMax> items;
  for (std::size_t station = 1; station <= out.blocks.size(); ++station) {
    items.clear();
    for (const Item& item : out.blocks[station - 1].items)
      if (!is_replaced(item)) (void)items.push(item);
    for (const Item& item : slab.items)
      if (item.station == station) (void)items.push(item);
    take(items, station);
  }
  items.clear();
  for (const Item& item : slab.items)
    if (item.station == 0) (void)items.push(item);
  take(items, 0);
}

void SlabHistory::make(std::size_t index, HistorySlab& out) const {
  Prng random(derived_seed(plan_.seed, kSlabStream, index));
  const std::size_t mould = random.below(moulds_.size());
  const double day =
      plan_.days * static_cast<double>(index) / static_cast<double>(std::max<std::size_t>(plan_.slabs - 1, 1));
  const std::size_t stations = recipe_.stations();
  Seats seats{};
  for (std::size_t k = 0; k < stations; ++k)
    for (std::size_t q = 0; q < kQuantities; ++q)
      seats[k][q] = moulds_[mould].bias[k][q] + line_.bias[k][q] +
                    day * (moulds_[mould].per_day[k][q] + line_.per_day[k][q]) + kTraits[q].scatter * random.normal();
  SlabHeader& header = out.header;
  header = {};
  header.key = static_cast<std::int64_t>(index + 1);
  char id[33];
  (void)std::snprintf(id, sizeof id, "HIS-%06zu", index + 1);
  header.slab_id.assign(id);
  header.slab_no = static_cast<std::uint32_t>(index + 1);
  header.slab_type = recipe_.slab_type;
  header.stations = recipe_.stations();
  header.temperature_dk = static_cast<std::uint16_t>(2'880 + random.below(150));
  header.age_h = static_cast<std::uint16_t>(24 + random.below(48));
  header.mould = static_cast<std::uint16_t>(mould + 1);
  header.recipe = recipe_.name;
  header.recipe_sha256 = recipe_.sha256;
  header.unconfirmed = static_cast<std::uint16_t>(unconfirmed_count(recipe_));
  header.guard = recipe_.guard;
  header.cell_mm = recipe_.evaluation.cell_mm;
  header.calibration_id = "emulated-history";
  header.software = plan_.software;
  header.T_base_slab.translation_mm = Vec3(1'800.0, 0.0, 300.0);
  header.emulated = static_cast<std::uint8_t>(kEmulatedLine | kEmulatedRobot | kEmulatedScan);
  header.began_utime_us = plan_.end_utime_us - static_cast<std::int64_t>((plan_.days - day) * kDay_us);

  const std::vector<Deviation> values = deviations(seats);
  out.attempts.resize(stations);
  out.blocks.resize(stations);
  for (std::size_t k = 0; k < stations; ++k) {
    make_block(static_cast<int>(k + 1), values, seats, random, header, out.blocks[k]);
    Attempt& attempt = out.attempts[k];
    attempt = {};
    attempt.slab_key = header.key;
    attempt.station = static_cast<std::uint8_t>(k + 1);
    attempt.number = 1;
    attempt.T_base_flange.translation_mm = header.T_base_slab.translation_mm +
                                           T_slab_block(recipe_, attempt.station).translation_mm +
                                           Vec3(0.0, 0.0, 600.0);
    attempt.pose_spread_mm = 0.002;
    attempt.pose_samples = 37;
    attempt.shape.points = attempt.shape.finite = static_cast<std::size_t>(kPoints);
    attempt.scan_utime_us = header.began_utime_us + static_cast<std::int64_t>(k + 1) * kStation_us;
    attempt.emulated = header.emulated;
    attempt.fingerprint = static_cast<std::int64_t>(random.next() | 1U);
  }
  out.slab = {};
  out.slab.fit.ok = true;
  out.slab.fit.seats = recipe_.stations();
  out.slab.fit.iterations = 3;
  out.slab.fit.rms_mm = out.slab.fit.plain_rms_mm = 0.1;
  out.slab.fit.T_base_slab = header.T_base_slab;
  for (const Deviation& d : values) {
    const bool of_seat = d.item == ItemId::seat_slope && recipe_.slope_datum == SlopeDatum::slab_frame;
    if (info(d.item).scope == ItemScope::block && !of_seat) continue;
    (void)out.slab.items.push(item_with(recipe_, d.item, d.station, d.station_to, d.value, d.U));
  }
  for (const ItemId warp : {ItemId::warp_left, ItemId::warp_right})
    (void)out.slab.items.push(item_with(recipe_, warp, 0, 0, kWarpScatter_mm * random.normal(), 0.15));
  judge(out);
  out.ended_utime_us = header.began_utime_us + static_cast<std::int64_t>(stations + 1) * kStation_us;
}

}  // namespace slabd::emulator
