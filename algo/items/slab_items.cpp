// SPDX-License-Identifier: Apache-2.0
//
// Slab items from the blocks. Every block gives its seat, its outer jaw and its plane in the robot's base frame. One
// robust rigid fit locates the slab; the items are coordinates in the slab frame.
//
// Every item's gradient by its observations is computed next to its formula; slab_budget.h computes a budget from it,
// including the frame's own uncertainty. The slab's top, which is not part of any fit, must agree with the frame's
// roll; otherwise the roll is uncertain by the difference (slab_budget.h). Without a budget (not required by the
// recipe), U combines the recipe's default for errors inside one scan with the station's splice. Without a station
// sigma, items between stations are indeterminate and never pass.
#include <algorithm>
#include <array>
#include <cmath>

#include "algo/items/block_items.h"
#include "algo/items/slab_budget.h"
#include "algo/items/slab_fit.h"
#include "algo/items/slab_seats.h"

namespace slabd::algo {
namespace {

constexpr int kSeatsMin = 12;
constexpr int kPitchesMin = 4;

int column_of(int station, int pairs) {
  return station <= pairs ? station - 1 : 2 * pairs - station;
}

double cant_rad(const Recipe& recipe) {
  return std::atan(1.0 / recipe.block.cant_ratio.value);
}

/// The station's errors from its scan. The levers are nominal: they are valid within the tolerances.
StationErrors errors_of(const Recipe& recipe, const BlockResult& block, const Pose& T_slab_block,
                        double designed_slope_rad) {
  const SeatObservation& o = block.observation;
  const double cant = cant_rad(recipe) + designed_slope_rad;
  const double half = recipe.block.jaw_half_distance_mm.value;
  const double height = recipe.block.jaw_reference_height_mm.value;
  // A jaw leans outward: its point moves by 1 / cos for a shift of the jaw and by tan for one of the seat.
  const double lean = recipe.block.jaw_angle_rad.value - 0.5 * kPi;
  StationErrors e;
  e.jaw_per_shift = std::hypot(1.0 / std::cos(lean), std::tan(lean));
  e.jaw_per_tilt_mm = half * std::tan(lean);
  e.p_noise = o.sigma_p_mm.cwiseAbs2();
  e.n_noise = o.sigma_n_rad.cwiseAbs2();
  e.jaw_noise = o.sigma_jaw_mm.cwiseAbs2();
  e.noise_factor = block.seat.noise_factor;
  e.place = T_slab_block.translation_mm;
  e.normal = T_slab_block.rotation * Vec3(0.0, -std::sin(cant), std::cos(cant));
  e.jaw_lever = T_slab_block.rotation * Vec3(0.0, half * std::cos(cant) - height * std::sin(cant),
                                             half * std::sin(cant) + height * std::cos(cant));
  return e;
}

/// True if all values that the seat's budget needs are known.
bool is_known(const BlockResult& block) {
  const SeatObservation& o = block.observation;
  return o.sigma_p_mm.allFinite() && o.sigma_n_rad.allFinite() && std::isfinite(block.seat.noise_factor);
}

/// Seats that define the frame, [station]. If budgets are required, a seat of unknown uncertainty would make every
/// budget unknown, so it is excluded as long as enough others remain.
using Members = std::array<bool, limits::kStationsMax + 1>;
Members members_of(const Recipe& recipe, std::span<const BlockResult> blocks) {
  Members seen{};
  Members known{};
  int count = 0;
  for (int station = 1; station <= recipe.stations(); ++station) {
    const BlockResult* block = block_of(blocks, station);
    const auto k = static_cast<std::size_t>(station);
    seen[k] = block != nullptr && block->observation.ok;
    known[k] = seen[k] && is_known(*block);
    count += known[k] ? 1 : 0;
  }
  return recipe.uncertainty.given && count >= kSeatsMin ? known : seen;
}

/// Fits the slab, or returns the reason for a failure. Stores the stations' errors and the frame's response in the
/// budget.
/// The model has the slab's temperature: with unequal rows, seats of an expanded slab would shift the frame.
SlabFitReport locate_slab(const Recipe& recipe, std::span<const BlockResult> blocks, const Members& members,
                          const Pose& T_base_slab_nominal, const SlabDesign& design, const Thermal& thermal,
                          SlabBudget& budget) {
  std::array<SeatInModel, limits::kStationsMax> sightings;
  std::array<int, limits::kStationsMax> station_of{};
  std::size_t count = 0;
  std::array<int, 2> in_row{};
  int first = recipe.slab.pairs;
  int last = -1;
  for (int station = 1; station <= recipe.stations(); ++station) {
    const BlockResult* block = block_of(blocks, station);
    if (block == nullptr) continue;
    const Pose T = T_slab_block(recipe, design, station);
    const StationErrors errors = errors_of(recipe, *block, T, design.at(station).slope_rad);
    budget.set(station, errors);
    if (!members[static_cast<std::size_t>(station)]) continue;
    station_of[count] = station;
    sightings[count++] = {block->observation.p_base,
                          block->observation.n_base,
                          (1.0 + thermal.expansion) * T.translation_mm,
                          errors.normal,
                          budget.known_p_mm(station),
                          budget.known_n_rad(station)};
    ++in_row[station <= recipe.slab.pairs ? 0 : 1];
    first = std::min(first, column_of(station, recipe.slab.pairs));
    last = std::max(last, column_of(station, recipe.slab.pairs));
  }
  SlabFitReport report;
  report.T_base_slab = T_base_slab_nominal;
  report.seats = static_cast<std::uint8_t>(count);
  if (static_cast<int>(count) < kSeatsMin) {
    report.note.printf("%zu seats measured, the slab frame needs %d", count, kSeatsMin);
  } else if (in_row[0] == 0 || in_row[1] == 0) {
    report.note = "only one row of seats measured, the slab frame needs both";
  } else if (last - first < kPitchesMin) {
    report.note.printf("seats span %d pitches, the slab frame needs %d", last - first, kPitchesMin);
  } else {
    std::array<FrameResponse, limits::kStationsMax> response{};
    report = fit_slab(std::span(sightings).first(count), std::span(response).first(count));
    for (std::size_t i = 0; i < count; ++i) budget.set(station_of[i], response[i]);
  }
  return report;
}

/// A seat whose distance from its row's warp exceeds its tolerance is not part of the warp.
double warp_reach_mm(const Recipe& recipe) {
  const Tolerance& t = recipe.tolerance(ItemId::seat_vertical);
  return 0.5 * (t.upper - t.lower);
}

/// Fits the warp of the row of stations first..last.
void find_warp(Seats& seats, int first, int last, double reach_mm, RowParabola& warp) {
  std::array<RowHeight, limits::kPairsMax> row;
  std::size_t count = 0;
  for (int station = first; station <= last; ++station) {
    const Seat& seat = seats[station];
    if (!seat.ok) continue;
    seats.place_in_row[static_cast<std::size_t>(station)] = static_cast<int>(count);
    row[count++] = {seat.nominal.x(), seat.p.z() - seat.nominal.z(), seat.counts};
  }
  warp = fit_row_parabola(std::span(row).first(count), reach_mm);
}

Seats seats_in_slab_frame(const Recipe& recipe, std::span<const BlockResult> blocks, const Members& members,
                          const SlabDesign& design, const Pose& T_base_slab) {
  Seats seats;
  seats.place_in_row.fill(-1);
  const Pose T_slab_base = T_base_slab.inverse();
  for (int station = 1; station <= recipe.stations(); ++station) {
    Seat& seat = seats.at[static_cast<std::size_t>(station)];
    const Pose T = T_slab_block(recipe, design, station);
    seat.nominal = T.translation_mm;
    const BlockResult* block = block_of(blocks, station);
    if (block == nullptr) continue;
    const SeatObservation& o = block->observation;
    seat.ok = o.ok;
    seat.counts = members[static_cast<std::size_t>(station)];
    seat.jaw_ok = o.jaw_ok;
    seat.tilt_ok = o.n_base.squaredNorm() > 0.0;
    if (seat.ok) seat.p = T_slab_base * o.p_base;
    if (seat.jaw_ok) seat.jaw_outer = T_slab_base * o.jaw_outer_base;
    if (!seat.tilt_ok) continue;
    seat.n = T_slab_base.rotation * o.n_base;
    // In the block's own axes: the second row's are rotated, so that "rises outward" is positive on both sides.
    seat.slope_rad = slope_about_x_rad(T.rotation.conjugate() * seat.n);
  }
  const int pairs = recipe.slab.pairs;
  find_warp(seats, 1, pairs, warp_reach_mm(recipe), seats.warp[0]);
  find_warp(seats, pairs + 1, recipe.stations(), warp_reach_mm(recipe), seats.warp[1]);
  return seats;
}

/// Rotation of a block about the vertical against its nominal place, from its casings to its outer jaw. NaN if one of
/// the two is not known.
double turned_rad(const Recipe& recipe, const Seats& seats, int station) {
  const Seat& seat = seats[station];
  if (!seat.ok || !seat.jaw_ok) return kNoValue;
  const Vec3 outward = T_slab_block(recipe, station).rotation.conjugate() * (seat.jaw_outer - seat.p);
  return std::atan2(-outward.x(), outward.y());
}

/// Writes remarks about the frame. Items do not show these errors: none measures a row's height, its position along
/// the rail or a block's rotation about the vertical.
void note_frame(const Recipe& recipe, const RollCheck& check, const Seats& seats, const Thermal& thermal,
                SlabFitReport& fit) {
  if (!check.seen)
    fit.note = "slab top unseen, roll unconfirmed";
  else if (check.u_rad > 0.0)
    fit.note.printf("top rolled %+.3f deg to the seats", deg_from_rad(check.roll_rad));
  const Tolerance& spacing = recipe.tolerance(ItemId::seat_spacing);
  constexpr double kUnlimited_mm = 1.0;  // limit if no spacing is judged
  double most_mm =
      has_value(spacing.lower) && has_value(spacing.upper) ? 0.5 * (spacing.upper - spacing.lower) : kUnlimited_mm;
  FixedString<32> along;
  for (int station = 1; station <= recipe.stations(); ++station) {
    const Seat& seat = seats[station];
    const double off_mm = seat.p.x() - (1.0 + thermal.expansion) * seat.nominal.x();
    if (!seat.ok || !(std::abs(off_mm) > most_mm)) continue;
    most_mm = std::abs(off_mm);
    // Both remarks must fit into the note: large values need no hundredths.
    along.printf("seat %d off by %.*f mm in X", station, most_mm < 9.995 ? 2 : most_mm < 99.95 ? 1 : 0, off_mm);
  }
  // Casings may be cast a millimetre off along the rail, which looks like 0.3 deg.
  double turned_most_rad = rad_from_deg(0.5);
  FixedString<32> turned;
  for (int station = 1; station <= recipe.stations(); ++station) {
    const double by_rad = turned_rad(recipe, seats, station);
    if (!(std::abs(by_rad) > turned_most_rad)) continue;
    turned_most_rad = std::abs(by_rad);
    turned.printf("seat %d turned %+.2f deg", station, deg_from_rad(by_rad));
  }
  // There is room for one remark about a seat.
  if (along.empty()) along = turned;
  if (!along.empty() && !fit.note.empty()) fit.note.append("; ");
  fit.note.append(along.view());
}

/// Collects an item's gradient; each observation also moves with the frame.
class Gradient {
 public:
  explicit Gradient(const Seats& seats) : seats_(seats) {}
  void p(int station, const Vec3& g) { at(value_.p, station, g, seats_[station].p); }
  void jaw(int station, const Vec3& g) { at(value_.jaw, station, g, seats_[station].jaw_outer); }
  void n(int station, const Vec3& g) {
    value_.n[static_cast<std::size_t>(station)] += g;
    value_.frame.tail<3>() += seats_[station].n.cross(g);
  }
  [[nodiscard]] const SlabGradient& value() const { return value_; }
  /// Change of the value per relative expansion of the slab: all points move along their distance from its centre.
  [[nodiscard]] double by_expansion_mm() const {
    double sum = 0.0;
    for (int station = 1; station <= static_cast<int>(limits::kStationsMax); ++station) {
      const auto k = static_cast<std::size_t>(station);
      sum += value_.p[k].dot(seats_[station].p) + value_.jaw[k].dot(seats_[station].jaw_outer);
    }
    return sum;
  }

 private:
  void at(SlabGradient::PerStation& which, int station, const Vec3& g, const Vec3& place) {
    which[static_cast<std::size_t>(station)] += g;
    value_.frame.head<3>() += g;
    value_.frame.tail<3>() += place.cross(g);
  }
  const Seats& seats_;
  SlabGradient value_;
};

/// Fills an item list from seats. Items without a value stay not measured.
class ItemWriter {
 public:
  ItemWriter(const Recipe& recipe, const SlabDesign& design, const Seats& seats, const SlabBudget& budget,
             const Thermal& thermal, SlabResult& out)
      : recipe_(recipe),
        design_(design),
        seats_(seats),
        budget_(budget),
        thermal_(thermal),
        fitted_(out.fit.ok),
        out_(out) {}

  void slope(int station) {
    Item item = designed_item(recipe_, design_, ItemId::seat_slope, station);
    Gradient g(seats_);
    if (fitted_ && seats_[station].tilt_ok) {
      item.value = deg_from_rad(seats_[station].slope_rad);
      item.companion = 1.0 / std::tan(seats_[station].slope_rad);
      const Quat turn = T_slab_block(recipe_, station).rotation;
      const Vec3 n = turn.conjugate() * seats_[station].n;
      g.n(station, turn * Vec3(Vec3(0.0, -n.z(), n.y()) / (n.y() * n.y() + n.z() * n.z())));
    }
    if (recipe_.slope_datum == SlopeDatum::local_slab_top) {
      item.lower = item.upper = kNoValue;
      item.required = false;
    }
    put(item, g, deg_from_rad(rotation_sigma(station)));
  }
  void lateral(int station) {
    Item item = designed_item(recipe_, design_, ItemId::seat_lateral, station);
    Gradient g(seats_);
    if (fitted_ && seats_[station].ok) {
      item.value = seats_[station].p.y() - seats_[station].nominal.y();
      g.p(station, Vec3::UnitY());
    }
    put(item, g, position_sigma(station));
  }
  void vertical(int station) {
    Item item = designed_item(recipe_, design_, ItemId::seat_vertical, station);
    Gradient g(seats_);
    if (fitted_ && seats_[station].ok) {
      item.companion = seats_[station].p.z() - seats_[station].nominal.z();
      if (!recipe_.remove_warp) {
        item.value = item.companion;
        g.p(station, Vec3::UnitZ());
      } else {
        over_warp(station, item, g);
      }
    }
    put(item, g, position_sigma(station));
  }
  void spacing(int station) {
    Item item = designed_item(recipe_, design_, ItemId::seat_spacing, station, station + 1);
    Gradient g(seats_);
    if (fitted_ && seats_[station].ok && seats_[station + 1].ok) {
      const double along = seats_[station + 1].p.x() - seats_[station].p.x();
      item.value = std::abs(along);
      const Vec3 direction = along < 0.0 ? Vec3(-Vec3::UnitX()) : Vec3(Vec3::UnitX());
      g.p(station + 1, direction);
      g.p(station, -direction);
    }
    put(item, g, std::hypot(position_sigma(station), position_sigma(station + 1)));
  }
  void large_jaw(int station) {
    const int across = opposite_station(recipe_, station);
    Item item = designed_item(recipe_, design_, ItemId::large_jaw_distance, station, across);
    Gradient g(seats_);
    if (fitted_ && seats_[station].jaw_ok && seats_[across].jaw_ok) {
      const Vec3 between = seats_[station].jaw_outer - seats_[across].jaw_outer;
      item.value = between.norm();
      g.jaw(station, between / item.value);
      g.jaw(across, -between / item.value);
    }
    // Across the track a jaw point moves with the rotation about X times its height above the block's origin.
    const double cant = cant_rad(recipe_);
    const double lever_mm = recipe_.block.jaw_reference_height_mm.value * std::cos(cant) +
                            recipe_.block.jaw_half_distance_mm.value * std::sin(cant);
    const auto of = [&](int s) { return std::hypot(position_sigma(s), rotation_sigma(s) * lever_mm); };
    put(item, g, std::hypot(of(station), of(across)));
  }
  void corner_level() {
    const int n = recipe_.slab.pairs;
    Item item = designed_item(recipe_, design_, ItemId::corner_level);
    Gradient g(seats_);
    if (fitted_ && seats_[1].ok && seats_[n].ok && seats_[n + 1].ok && seats_[2 * n].ok) {
      item.value = seats_[1].p.z() - seats_[n].p.z() + seats_[n + 1].p.z() - seats_[2 * n].p.z();
      item.companion = 0.25 * item.value;
      g.p(1, Vec3::UnitZ());
      g.p(n, -Vec3::UnitZ());
      g.p(n + 1, Vec3::UnitZ());
      g.p(2 * n, -Vec3::UnitZ());
    }
    put(item, g,
        std::hypot(std::hypot(position_sigma(1), position_sigma(n)),
                   std::hypot(position_sigma(n + 1), position_sigma(2 * n))));
  }
  /// Warp of the row of stations first..last: middle above the chord of the ends.
  void warp(ItemId id, int first, int last) {
    Item item = designed_item(recipe_, design_, id);
    Gradient g(seats_);
    const int middle_a = (first + last) / 2;
    const int middle_b = (first + last + 1) / 2;
    if (fitted_ && seats_[first].ok && seats_[last].ok && seats_[middle_a].ok && seats_[middle_b].ok)
      item.value = 0.5 * (above_chord(middle_a, first, last, g) + above_chord(middle_b, first, last, g));
    const double middle = middle_a == middle_b ? position_sigma(middle_a)
                                               : 0.5 * std::hypot(position_sigma(middle_a), position_sigma(middle_b));
    put(item, g, std::hypot(middle, 0.5 * std::hypot(position_sigma(first), position_sigma(last))));
  }

 private:
  [[nodiscard]] double position_sigma(int station) const {
    return std::hypot(budget_.sigma(station).position_mm, budget_.sigma(station).robot_position_mm);
  }
  [[nodiscard]] double rotation_sigma(int station) const {
    return std::hypot(budget_.sigma(station).rotation_rad, budget_.sigma(station).robot_rotation_rad);
  }

  /// Height of a seat above its row's warp, if the row has a fitted one.
  void over_warp(int station, Item& item, Gradient& g) {
    const int pairs = recipe_.slab.pairs;
    const bool left = station <= pairs;
    const RowParabola& warp = seats_.warp[left ? 0 : 1];
    if (!warp.ok) return;
    const auto place = [&](int s) { return seats_.place_in_row[static_cast<std::size_t>(s)]; };
    const auto own = static_cast<std::size_t>(place(station));
    item.value = warp.off_mm[own];
    for (int s = left ? 1 : pairs + 1; s <= (left ? pairs : recipe_.stations()); ++s)
      if (place(s) >= 0) g.p(s, warp.response[own][static_cast<std::size_t>(place(s))] * Vec3::UnitZ());
  }
  /// Half of a warp, so the gradient counts half. The chord's slope is too small for errors in X to matter.
  double above_chord(int station, int first, int last, Gradient& g) {
    const Vec3& a = seats_[first].p;
    const Vec3& b = seats_[last].p;
    const double along = (seats_[station].p.x() - a.x()) / (b.x() - a.x());
    g.p(station, 0.5 * Vec3::UnitZ());
    g.p(first, -0.5 * (1.0 - along) * Vec3::UnitZ());
    g.p(last, -0.5 * along * Vec3::UnitZ());
    return seats_[station].p.z() - (a.z() + along * (b.z() - a.z()));
  }
  /// U without a budget: the recipe's default and two sigma of the stations in quadrature; NaN stays NaN. If the recipe
  /// requires budgets and has no default for this item, U is NaN: the scan's contribution is unknown, not zero.
  [[nodiscard]] double default_U(double of_recipe, double station_sigma) const {
    if (recipe_.uncertainty.given && !has_value(of_recipe)) return kNoValue;
    return std::hypot(has_value(of_recipe) ? of_recipe : 0.0, 2.0 * station_sigma);
  }
  /// Simple acceptance ignores the uncertainty of a good measurement, but not that of a contradicted frame.
  [[nodiscard]] static bool passes_rolled(Item item, double of_roll) {
    if (!(of_roll > 0.0)) return true;
    item.U = of_roll;
    return judge(item, 1.0) == Verdict::pass;
  }
  void put(Item item, const Gradient& gradient, double station_sigma) {
    const double unit = info(item.id).unit == ItemUnit::deg ? deg_from_rad(1.0) : 1.0;
    const double of_roll = 2.0 * unit * budget_.of_roll(gradient.value());
    item.U = std::hypot(default_U(item.U, station_sigma), of_roll);
    if (const double of_tie = 2.0 * unit * budget_.of_tie(gradient.value()); of_tie != 0.0)
      item.U = std::hypot(item.U, of_tie);
    if (recipe_.uncertainty.given && has_value(item.value)) settle(budget_.budget(gradient.value(), unit), item);
    if (info(item.id).unit == ItemUnit::mm) state_at_reference(thermal_, gradient.by_expansion_mm(), item);
    item.verdict = judge(item, recipe_.guard);
    if (item.verdict == Verdict::pass && !passes_rolled(item, of_roll)) item.verdict = Verdict::indeterminate;
    (void)out_.items.push(item);
  }

  const Recipe& recipe_;
  const SlabDesign& design_;
  const Seats& seats_;
  const SlabBudget& budget_;
  const Thermal& thermal_;
  bool fitted_;
  SlabResult& out_;
};

void write_items(const Recipe& recipe, ItemWriter& write) {
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

}  // namespace

void inspect_slab(const Recipe& recipe, std::span<const BlockResult> blocks, const StationSigma& sigma,
                  const Pose& T_base_slab_nominal, SlabResult& out, const ScannerNumbers& verified,
                  const SlabFacts& slab) {
  std::array<StationSigma, limits::kStationsMax> sigmas;
  sigmas.fill(sigma);
  inspect_slab(recipe, blocks, sigmas, T_base_slab_nominal, out, verified, slab);
}

void inspect_slab(const Recipe& recipe, std::span<const BlockResult> blocks, std::span<const StationSigma> sigmas,
                  const Pose& T_base_slab_nominal, SlabResult& out, const ScannerNumbers& verified,
                  const SlabFacts& slab) {
  inspect_slab(recipe, blocks, sigmas, T_base_slab_nominal, out, SlabArms{{&verified, 1}, nullptr}, slab);
}

void inspect_slab(const Recipe& recipe, std::span<const BlockResult> blocks, std::span<const StationSigma> sigmas,
                  const Pose& T_base_slab_nominal, SlabResult& out, const SlabArms& arms, const SlabFacts& slab) {
  out = SlabResult{};
  SlabBudget budget(recipe, arms, sigmas);
  const Members members = members_of(recipe, blocks);
  const Thermal thermal = thermal_of(recipe.thermal, slab.temperature_c);
  out.fit = locate_slab(recipe, blocks, members, T_base_slab_nominal, slab.design, thermal, budget);
  Seats seats;
  if (out.fit.ok) {
    seats = seats_in_slab_frame(recipe, blocks, members, slab.design, out.fit.T_base_slab);
    const RollCheck check = check_roll(recipe, blocks, out.fit.T_base_slab, budget);
    budget.set_roll(check.u_rad);
    if (arms.tie != nullptr) budget.set_tie(*arms.tie, out.fit.T_base_slab);
    note_frame(recipe, check, seats, thermal, out.fit);
  }
  ItemWriter write(recipe, slab.design, seats, budget, thermal, out);
  write_items(recipe, write);
  measure_gauge_items(recipe, slab, thermal, out);
  reach_verdicts(recipe, blocks, seats, out);
}

}  // namespace slabd::algo
