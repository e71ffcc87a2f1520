// SPDX-License-Identifier: Apache-2.0
//
// From eighteen blocks to one slab. Every block says where its seat, its outer jaw and its plane are in the robot's
// base frame; one robust rigid fit says where the slab is; the rest is reading coordinates in the slab frame.
//
// Uncertainty: an item's U combines the recipe's default (the measurement inside one scan) with the station's splice
// (robot and hand-eye), which only matters between stations. The station sigma holds at the block's origin; a point
// off it moves with the splice's rotation times its lever. Without a station sigma nothing between stations can be
// decided: such items are indeterminate, never pass.
#include <Eigen/Cholesky>
#include <algorithm>
#include <array>
#include <cmath>

#include "algo/block_items.h"
#include "algo/slab_fit.h"

namespace slabd::algo {
namespace {

constexpr int kSeatsMin = 12;
constexpr int kPitchesMin = 4;
/// A parabola has three parameters: through three seats it would fit their deviations away.
constexpr int kParabolaSeatsMin = 5;
/// A station's own items and the slab items that touch it: slope, lateral, vertical, two spacings, one large jaw.
constexpr std::size_t kStationItemsMax = kBlockItemsMax + 6;

struct Seat {
  bool ok = false;
  bool jaw_ok = false;
  bool tilt_ok = false;
  Vec3 p = Vec3::Zero();          ///< slab frame
  Vec3 nominal = Vec3::Zero();    ///< slab frame
  Vec3 jaw_outer = Vec3::Zero();  ///< slab frame
  double slope_rad = kNoValue;    ///< about the block's X
  double height_off_parabola_mm = kNoValue;
};
/// [station], 1-based; 0 unused.
using Seats = std::array<Seat, limits::kStationsMax + 1>;

const BlockResult* block_of(std::span<const BlockResult> blocks, int station) {
  const auto index = static_cast<std::size_t>(station - 1);
  return index < blocks.size() && blocks[index].verdict != Verdict::none ? &blocks[index] : nullptr;
}

int column_of(int station, int pairs) {
  return station <= pairs ? station - 1 : 2 * pairs - station;
}

/// The fit, or the reason why there is none.
SlabFitReport locate_slab(const Recipe& recipe, std::span<const BlockResult> blocks, const StationSigma& sigma,
                          const Pose& T_base_slab_nominal) {
  std::array<SeatSighting, limits::kStationsMax> sightings;
  std::size_t count = 0;
  std::array<int, 2> in_row{};
  int first = recipe.slab.pairs;
  int last = -1;
  const double cant = std::atan(1.0 / recipe.block.cant_ratio.value);
  const Vec3 n_block(0.0, -std::sin(cant), std::cos(cant));
  for (int station = 1; station <= recipe.stations(); ++station) {
    const BlockResult* block = block_of(blocks, station);
    if (block == nullptr || !block->observation.ok) continue;
    const Pose T = T_slab_block(recipe, station);
    sightings[count++] = {block->observation.p_base, block->observation.n_base, T.translation_mm, T.rotation * n_block};
    ++in_row[station <= recipe.slab.pairs ? 0 : 1];
    first = std::min(first, column_of(station, recipe.slab.pairs));
    last = std::max(last, column_of(station, recipe.slab.pairs));
  }
  SlabFitReport report;
  report.T_base_slab = T_base_slab_nominal;
  report.seats = static_cast<std::uint8_t>(count);
  if (static_cast<int>(count) < kSeatsMin)
    report.note.printf("%zu seats measured, the slab frame needs %d", count, kSeatsMin);
  else if (in_row[0] == 0 || in_row[1] == 0)
    report.note = "only one row of seats measured, the slab frame needs both";
  else if (last - first < kPitchesMin)
    report.note.printf("seats span %d pitches, the slab frame needs %d", last - first, kPitchesMin);
  else
    report = fit_slab(std::span(sightings).first(count), sigma);
  return report;
}

/// Heights of one row over their least-squares parabola in X; untouched (NaN) with too few seats.
void remove_parabola(Seats& seats, int first, int last) {
  Eigen::Matrix3d H = Eigen::Matrix3d::Zero();
  Eigen::Vector3d g = Eigen::Vector3d::Zero();
  int count = 0;
  const auto basis = [](const Seat& seat) {
    const double x = seat.nominal.x() / 1000.0;
    return Eigen::Vector3d(1.0, x, x * x);
  };
  for (int station = first; station <= last; ++station) {
    const Seat& seat = seats[static_cast<std::size_t>(station)];
    if (!seat.ok) continue;
    const Eigen::Vector3d b = basis(seat);
    H += b * b.transpose();
    g += (seat.p.z() - seat.nominal.z()) * b;
    ++count;
  }
  if (count < kParabolaSeatsMin) return;
  const Eigen::Vector3d parabola = H.ldlt().solve(g);
  for (int station = first; station <= last; ++station) {
    Seat& seat = seats[static_cast<std::size_t>(station)];
    if (seat.ok) seat.height_off_parabola_mm = seat.p.z() - seat.nominal.z() - parabola.dot(basis(seat));
  }
}

Seats seats_in_slab_frame(const Recipe& recipe, std::span<const BlockResult> blocks, const Pose& T_base_slab) {
  Seats seats;
  const Pose T_slab_base = T_base_slab.inverse();
  for (int station = 1; station <= recipe.stations(); ++station) {
    Seat& seat = seats[static_cast<std::size_t>(station)];
    const Pose T = T_slab_block(recipe, station);
    seat.nominal = T.translation_mm;
    const BlockResult* block = block_of(blocks, station);
    if (block == nullptr) continue;
    const SeatObservation& o = block->observation;
    seat.ok = o.ok;
    seat.jaw_ok = o.jaw_ok;
    seat.tilt_ok = o.n_base.squaredNorm() > 0.0;
    if (seat.ok) seat.p = T_slab_base * o.p_base;
    if (seat.jaw_ok) seat.jaw_outer = T_slab_base * o.jaw_outer_base;
    // In the block's own axes: the second row's are turned, so that "climbs outward" is positive on both sides.
    if (seat.tilt_ok) seat.slope_rad = slope_about_x_rad(T.rotation.conjugate() * (T_slab_base.rotation * o.n_base));
  }
  remove_parabola(seats, 1, recipe.slab.pairs);
  remove_parabola(seats, recipe.slab.pairs + 1, recipe.stations());
  return seats;
}

/// Fills an item list from seats. Items without a value stay not measured.
class ItemWriter {
 public:
  ItemWriter(const Recipe& recipe, const Seats& seats, bool fitted, const StationSigma& sigma, SlabResult& out)
      : recipe_(recipe), seats_(seats), fitted_(fitted), sigma_(sigma), out_(out) {}

  void slope(int station) {
    Item item = blank_item(recipe_, ItemId::seat_slope, station);
    if (fitted_ && seat(station).tilt_ok) {
      item.value = deg_from_rad(seat(station).slope_rad);
      item.beside = 1.0 / std::tan(seat(station).slope_rad);
    }
    // The frame's own tilt, held by eighteen seats over 1.5 m, is small beside one station's rotation.
    item.U = combined(item.U, deg_from_rad(sigma_.rotation_rad));
    if (recipe_.slope_datum == SlopeDatum::local_slab_top) {
      item.lower = item.upper = kNoValue;
      item.required = false;
    }
    put(item);
  }
  void lateral(int station) {
    Item item = blank_item(recipe_, ItemId::seat_lateral, station);
    if (fitted_ && seat(station).ok) item.value = seat(station).p.y() - seat(station).nominal.y();
    item.U = combined(item.U, sigma_.position_mm);
    put(item);
  }
  void vertical(int station) {
    Item item = blank_item(recipe_, ItemId::seat_vertical, station);
    if (fitted_ && seat(station).ok) {
      const double unremoved = seat(station).p.z() - seat(station).nominal.z();
      item.value = recipe_.remove_warp ? seat(station).height_off_parabola_mm : unremoved;
      item.beside = unremoved;
    }
    item.U = combined(item.U, sigma_.position_mm);
    put(item);
  }
  void spacing(int station) {
    Item item = blank_item(recipe_, ItemId::seat_spacing, station, station + 1);
    if (fitted_ && seat(station).ok && seat(station + 1).ok)
      item.value = std::abs(seat(station + 1).p.x() - seat(station).p.x());
    item.U = combined(item.U, std::sqrt(2.0) * sigma_.position_mm);
    put(item);
  }
  void large_jaw(int station) {
    const int across = opposite_station(recipe_, station);
    Item item = blank_item(recipe_, ItemId::large_jaw_distance, station, across);
    if (fitted_ && seat(station).jaw_ok && seat(across).jaw_ok)
      item.value = (seat(station).jaw_outer - seat(across).jaw_outer).norm();
    // Across the track a jaw point moves with the rotation about X times its height over the block's origin.
    const double cant = std::atan(1.0 / recipe_.block.cant_ratio.value);
    const double lever_mm = recipe_.block.jaw_reference_height_mm.value * std::cos(cant) +
                            recipe_.block.jaw_half_distance_mm.value * std::sin(cant);
    item.U = combined(item.U, std::sqrt(2.0) * std::hypot(sigma_.position_mm, sigma_.rotation_rad * lever_mm));
    put(item);
  }
  void corner_level() {
    const int n = recipe_.slab.pairs;
    Item item = blank_item(recipe_, ItemId::corner_level);
    if (fitted_ && seat(1).ok && seat(n).ok && seat(n + 1).ok && seat(2 * n).ok) {
      item.value = seat(1).p.z() - seat(n).p.z() + seat(n + 1).p.z() - seat(2 * n).p.z();
      item.beside = 0.25 * item.value;
    }
    item.U = combined(item.U, 2.0 * sigma_.position_mm);
    put(item);
  }
  /// Row of stations first..last: middle above the chord of the ends.
  void warp(ItemId id, int first, int last) {
    Item item = blank_item(recipe_, id);
    const int middle_a = (first + last) / 2;
    const int middle_b = (first + last + 1) / 2;
    if (fitted_ && seat(first).ok && seat(last).ok && seat(middle_a).ok && seat(middle_b).ok)
      item.value = 0.5 * (above_chord(middle_a, first, last) + above_chord(middle_b, first, last));
    const double middle_variance = middle_a == middle_b ? 1.0 : 0.5;
    item.U = combined(item.U, std::sqrt(middle_variance + 0.5) * sigma_.position_mm);
    put(item);
  }

 private:
  [[nodiscard]] const Seat& seat(int station) const { return seats_[static_cast<std::size_t>(station)]; }
  [[nodiscard]] double above_chord(int station, int first, int last) const {
    const Vec3& a = seat(first).p;
    const Vec3& b = seat(last).p;
    const double along = (seat(station).p.x() - a.x()) / (b.x() - a.x());
    return seat(station).p.z() - (a.z() + along * (b.z() - a.z()));
  }
  /// Recipe default and 2 sigma (k = 2) of the stations in quadrature; NaN stays NaN.
  [[nodiscard]] static double combined(double default_U, double sigma) {
    return std::hypot(has_value(default_U) ? default_U : 0.0, 2.0 * sigma);
  }
  void put(Item item) {
    item.verdict = judge(item, recipe_.guard);
    // Simple acceptance does not ask for U, but an uncalibrated station cannot decide anything.
    if (item.verdict != Verdict::not_measured && item.verdict != Verdict::none && !has_value(item.U))
      item.verdict = Verdict::indeterminate;
    (void)out_.items.push(item);
  }

  const Recipe& recipe_;
  const Seats& seats_;
  bool fitted_;
  const StationSigma& sigma_;
  SlabResult& out_;
};

void write_items(const Recipe& recipe, const Seats& seats, const StationSigma& sigma, SlabResult& out) {
  ItemWriter write(recipe, seats, out.fit.ok, sigma, out);
  const int pairs = recipe.slab.pairs;
  for (int station = 1; station <= recipe.stations(); ++station) write.slope(station);
  for (int station = 1; station <= recipe.stations(); ++station) write.lateral(station);
  for (int station = 1; station <= recipe.stations(); ++station) write.vertical(station);
  for (int station = 1; station < recipe.stations(); ++station)
    if (station != pairs) write.spacing(station);
  for (int station = 1; station <= pairs; ++station) write.large_jaw(station);
  write.corner_level();
  write.warp(ItemId::warp_left, 1, pairs);
  write.warp(ItemId::warp_right, pairs + 1, recipe.stations());
}

using StationItems = FixedVector<Item, kStationItemsMax>;

/// How far a seat is out of its own place, as far as an item between two seats shows it.
double out_of_place_mm(const Seat& seat, const Item& item) {
  return item.id == ItemId::large_jaw_distance ? std::abs(std::abs(seat.jaw_outer.y()) - 0.5 * item.nominal)
                                               : std::abs(seat.p.x() - seat.nominal.x());
}

/// Does this slab item count for this station? One that spans two stations counts for the one that spoils it: the one
/// that was not measured, or the one further out of its place. Its neighbour must not pay for that.
bool counts_for(const Seats& seats, const Item& item, int station) {
  if (item.station != station && item.station_to != station) return false;
  if (item.station_to == 0 || item.verdict == Verdict::pass) return true;
  const Seat& own = seats[static_cast<std::size_t>(station)];
  const Seat& other = seats[static_cast<std::size_t>(item.station + item.station_to - station)];
  const bool jaw = item.id == ItemId::large_jaw_distance;
  const bool own_ok = jaw ? own.jaw_ok : own.ok;
  const bool other_ok = jaw ? other.jaw_ok : other.ok;
  if (own_ok != other_ok) return !own_ok;
  if (!own_ok) return true;
  return out_of_place_mm(own, item) >= out_of_place_mm(other, item);
}

/// All that decides one station: its block items (the local slope replaced when the slab frame decides) and the slab
/// items that count for it.
StationItems items_of_station(const Recipe& recipe, const BlockResult* block, const Seats& seats,
                              const SlabResult& slab, int station) {
  StationItems items;
  if (block != nullptr) {
    for (const Item& item : block->items)
      if (item.id != ItemId::seat_slope || recipe.slope_datum == SlopeDatum::local_slab_top) (void)items.push(item);
  }
  for (const Item& item : slab.items)
    if (counts_for(seats, item, station)) (void)items.push(item);
  return items;
}

/// The code that explains a block which came to nothing, ok if its items explain it.
Code cause_of(const BlockResult* block) {
  if (block == nullptr) return Code::block_not_found;
  if (block->items.empty() && block->reason == 0) return Code::fit_failed;
  const bool by_item = block->reason == 0 || block->reason >= kReasonItemBase;
  if (block->verdict == Verdict::aborted && by_item) return Code::interrupted;
  if (by_item) return Code::ok;
  return block->verdict == Verdict::not_measured || block->verdict == Verdict::aborted
             ? static_cast<Code>(block->reason)
             : Code::ok;
}

/// The slab's verdict from verdicts already found: fail, then not measured, then indeterminate, then pass.
Verdict worse(Verdict a, Verdict b) {
  constexpr auto rank = [](Verdict v) {
    switch (v) {
      case Verdict::fail: return 4;
      case Verdict::none:
      case Verdict::aborted:
      case Verdict::not_measured: return 3;
      case Verdict::indeterminate: return 2;
      case Verdict::pass: return 1;
    }
    return 3;
  };
  return rank(a) >= rank(b) ? a : b;
}

/// Keeps the reason that ranks first: any code before items, the lowest item among items.
std::uint16_t earlier(std::uint16_t a, std::uint16_t b) {
  if (a == 0) return b;
  if (b == 0) return a;
  return std::min(a, b);
}

void reach_verdicts(const Recipe& recipe, std::span<const BlockResult> blocks, const Seats& seats, SlabResult& out) {
  std::array<StationItems, limits::kStationsMax> of_station;
  // Whatever an item counts for, the slab answers for all of them.
  FixedVector<Item, kSlabItemsMax> of_slab;
  for (const Item& item : out.items)
    if (item.station == 0 || item.station_to != 0) (void)of_slab.push(item);

  // Slab-wide items that a recipe gives no limits decide nothing; what is required and missing does.
  const bool slab_wide_counts = std::any_of(of_slab.begin(), of_slab.end(), [](const Item& item) {
    return item.required || (item.verdict != Verdict::none && item.verdict != Verdict::not_measured);
  });
  const Verdict slab_wide = combine(of_slab.begin(), of_slab.end());
  out.fail_mask = fail_mask(of_slab.begin(), of_slab.end());
  out.open_mask = open_mask(of_slab.begin(), of_slab.end());
  // Without a single station there is nothing that could pass.
  out.verdict = slab_wide_counts ? slab_wide : (recipe.stations() == 0 ? Verdict::not_measured : Verdict::pass);
  for (int station = 1; station <= recipe.stations(); ++station) {
    const auto k = static_cast<std::size_t>(station - 1);
    const BlockResult* block = block_of(blocks, station);
    const Code cause = cause_of(block);
    StationItems& items = of_station[k];
    items = items_of_station(recipe, block, seats, out, station);
    out.fail_mask |= fail_mask(items.begin(), items.end());
    out.open_mask |= open_mask(items.begin(), items.end());
    Verdict verdict = combine(items.begin(), items.end());
    if (cause != Code::ok && verdict != Verdict::fail) verdict = Verdict::not_measured;
    out.station_verdict[k] = verdict;
    out.station_reason[k] = reason_for(verdict, items.begin(), items.end(), cause);
    out.verdict = worse(out.verdict, verdict);
  }

  // The slab's reason: of everything that came to the slab's verdict, the lowest. Codes lie below item numbers.
  if (out.verdict == Verdict::pass) return;
  if (slab_wide_counts && slab_wide == out.verdict)
    out.reason = reason_for(out.verdict, of_slab.begin(), of_slab.end(), Code::ok);
  for (int station = 1; station <= recipe.stations(); ++station) {
    const auto k = static_cast<std::size_t>(station - 1);
    if (out.station_verdict[k] == out.verdict) out.reason = earlier(out.reason, out.station_reason[k]);
  }
}

}  // namespace

void inspect_slab(const Recipe& recipe, std::span<const BlockResult> blocks, const StationSigma& sigma,
                  const Pose& T_base_slab_nominal, SlabResult& out) {
  out = SlabResult{};
  out.fit = locate_slab(recipe, blocks, sigma, T_base_slab_nominal);
  Seats seats;
  if (out.fit.ok) seats = seats_in_slab_frame(recipe, blocks, out.fit.T_base_slab);
  write_items(recipe, seats, sigma, out);
  reach_verdicts(recipe, blocks, seats, out);
}

}  // namespace slabd::algo
