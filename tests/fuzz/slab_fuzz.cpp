// SPDX-License-Identifier: Apache-2.0
//
// From measured blocks to the slab's verdict. Measuring a whole scan is slow (verdict_fuzz.cpp), so the input modifies
// the results of a good slab's blocks. Invariants: a pass has every station and every required item within its guarded
// limits; a station far out of tolerance never passes; the base frame does not change the verdict.
//
//   0        bits 0, 1: pairs (6, 7, 8, 9), bit 2: slope in the slab frame, bit 3: budgets, bit 4: warp is removed,
//            bit 5: simple acceptance
//   rest     steps of 8 bytes: kind, station, item, three more bytes, value (int16)
#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstring>
#include <vector>

#include "algo/algo.h"
#include "tests/algo/scene.h"
#include "tests/fuzz/fuzz.h"

using namespace slabd;  // NOLINT(google-build-using-namespace)

namespace {

constexpr std::size_t kStepBytes = 8;
constexpr std::size_t kStepsMax = 24;
constexpr std::array<ItemId, 4> kBlockItems = {ItemId::seat_slope, ItemId::seat_flatness, ItemId::jaw_distance,
                                               ItemId::casing_spacing};

Recipe recipe_of(std::uint8_t head) {
  Recipe recipe = scene::p5600();
  recipe.slab.pairs = static_cast<std::uint8_t>(6 + (head & 3U));
  recipe.slab.length_mm.value = 560.0 + 630.0 * (recipe.slab.pairs - 1);
  recipe.slope_datum = (head & 4U) != 0 ? SlopeDatum::slab_frame : SlopeDatum::local_slab_top;
  recipe.uncertainty.given = (head & 8U) != 0;
  recipe.remove_warp = (head & 16U) != 0;
  if ((head & 32U) != 0) recipe.guard = 0.0;
  return recipe;
}

class Slab {
 public:
  explicit Slab(std::uint8_t head)
      : recipe(recipe_of(head)), blocks(recipe.stations()), sigmas(recipe.stations(), {0.005, 2e-6}) {
    for (int station = 1; station <= recipe.stations(); ++station) {
      BlockResult& b = block(station);
      b.station = static_cast<std::uint8_t>(station);
      for (const ItemId id : kBlockItems) {
        Item item = blank_item(recipe, id, station);
        item.value = item.nominal;
        item.U = 0.01;
        fuzz::must(b.items.push(item), "an item");
      }
      place(station, Vec3::Zero());
    }
  }
  BlockResult& block(int station) { return blocks[static_cast<std::size_t>(station - 1)]; }

  void place(int station, const Vec3& off_mm) {
    const double cant = std::atan(1.0 / recipe.block.cant_ratio.value);
    const double half_mm = recipe.block.jaw_half_distance_mm.value;
    const double height_mm = recipe.block.jaw_reference_height_mm.value;
    Pose T = T_slab_block(recipe, station);
    T.translation_mm += off_mm;
    T = T_base_slab * T;
    SeatObservation& o = block(station).observation;
    o.ok = o.jaw_ok = o.top_ok = true;
    o.p_base = T.translation_mm;
    o.n_base = T.rotation * Vec3(0.0, -std::sin(cant), std::cos(cant));
    o.jaw_outer_base = T * Vec3(0.0, half_mm * std::cos(cant) - height_mm * std::sin(cant),
                                half_mm * std::sin(cant) + height_mm * std::cos(cant));
    o.top_n_base = T.rotation * Vec3::UnitZ();
    o.sigma_p_mm = o.sigma_jaw_mm = Vec3::Constant(0.001);
    o.sigma_n_rad = o.sigma_top_n_rad = Vec3::Constant(1e-6);
  }
  /// Computes the verdict of each block, as its inspection does at the end.
  void judge_blocks() {
    for (BlockResult& b : blocks) {
      if (b.items.empty()) continue;
      const bool failed_before = b.verdict == Verdict::not_measured;
      for (Item& item : b.items) item.verdict = failed_before ? Verdict::not_measured : judge(item, recipe.guard);
      const Code code = failed_before ? static_cast<Code>(b.reason) : Code::ok;
      b.verdict = failed_before ? Verdict::not_measured : combine(b.items.begin(), b.items.end());
      b.reason = reason_for(b.verdict, b.items.begin(), b.items.end(), code);
    }
  }

  Recipe recipe;
  std::vector<BlockResult> blocks;
  std::vector<algo::StationSigma> sigmas;
  Pose T_base_slab = scene::displaced(2500.0, -300.0, 400.0, 0.4, -0.3, 25.0);
  std::array<bool, limits::kStationsMax + 1> missing{};  ///< never scanned, or not measured
  std::array<bool, limits::kStationsMax + 1> beside{};   ///< far out of its lateral tolerance
  bool plain = true;                                     ///< observations are unchanged except by `beside`
};

struct Step {
  std::uint8_t kind, station, what;
  std::array<std::uint8_t, 3> more;
  std::int16_t value;
  explicit Step(const std::uint8_t* at)
      : kind(at[0]),
        station(at[1]),
        what(at[2]),
        more{at[3], at[4], at[5]},
        value(static_cast<std::int16_t>(static_cast<std::uint16_t>(at[6]) | static_cast<std::uint16_t>(at[7] << 8U))) {}
  /// A double with arbitrary bits: infinite, NaN, tiny or huge.
  [[nodiscard]] double any() const {
    return std::bit_cast<double>(static_cast<std::uint64_t>(static_cast<std::uint16_t>(value)) << 48U |
                                 static_cast<std::uint64_t>(more[0]) << 40U |
                                 static_cast<std::uint64_t>(more[1]) << 20U | more[2]);
  }
};

void apply(Slab& slab, const Step& step) {
  const int station = 1 + step.station % slab.recipe.stations();
  const auto k = static_cast<std::size_t>(station);
  BlockResult& b = slab.block(station);
  const double off_mm = 1e-3 * step.value;
  switch (step.kind % 10) {
    case 0:  // the block is displaced
      slab.place(station, Vec3::Unit(step.what % 3) * off_mm);
      slab.beside[k] = step.what % 3 == 1 && std::abs(off_mm) >= 1.5;
      if (!slab.beside[k]) slab.plain = false;
      break;
    case 1:  // never scanned
      b = BlockResult{};
      slab.missing[k] = true;
      slab.plain = false;
      break;
    case 2:  // an item is outside its limit, or just within
      if (b.items.empty()) break;
      {
        Item& item = b.items[step.what % b.items.size()];
        item.value = item.nominal + off_mm;
      }
      break;
    case 3:  // any value
    case 4:  // any uncertainty
      if (b.items.empty()) break;
      (step.kind % 10 == 3 ? b.items[step.what % b.items.size()].value : b.items[step.what % b.items.size()].U) =
          step.any();
      break;
    case 5:  // a seat or jaw is not seen
      slab.plain = false;
      if ((step.what & 1U) != 0) b.observation.ok = false;
      if ((step.what & 2U) != 0) b.observation.jaw_ok = false;
      if ((step.what & 4U) != 0) b.observation.n_base = Vec3::Zero();
      break;
    case 6: {  // any coordinate, any doubt
      slab.plain = false;
      SeatObservation& o = b.observation;
      const std::array<Vec3*, 6> vectors = {&o.p_base,     &o.n_base,       &o.jaw_outer_base,
                                            &o.sigma_p_mm, &o.sigma_jaw_mm, &o.sigma_n_rad};
      (*vectors[step.what / 3U % vectors.size()])[step.what % 3U] = step.any();
      break;
    }
    case 7: {  // the uncertainty of the station
      algo::StationSigma& sigma = slab.sigmas[k - 1];
      ((step.what & 1U) != 0 ? sigma.position_mm : sigma.rotation_rad) = std::abs(step.any());
      slab.plain = false;
      break;
    }
    case 8:  // a stage failed
      b.verdict = Verdict::not_measured;
      b.reason = static_cast<std::uint16_t>((step.what & 1U) != 0 ? Code::block_not_found : Code::fit_failed);
      if ((step.what & 2U) != 0) b.items.clear();
      slab.missing[k] = true;
      break;
    default:  // a reason without items
      b.items.clear();
      slab.missing[k] = true;
      break;
  }
}

bool within_guarded_limits(const Item& item, double guard) {
  const double band = guard > 0.0 ? guard * item.U : 0.0;
  return std::isfinite(item.value) && std::isfinite(band) && band >= 0.0 &&
         (has_value(item.lower) || has_value(item.upper)) &&
         (!has_value(item.lower) || item.value >= item.lower + band) &&
         (!has_value(item.upper) || item.value <= item.upper - band);
}

void check_pass(const Slab& slab, const SlabResult& out) {
  fuzz::must(out.reason == 0 && out.fail_mask == 0, "a pass has no reason");
  fuzz::must(out.fit.ok, "a pass has a slab frame");
  for (const Item& item : out.items)
    fuzz::must(!item.required || (item.verdict == Verdict::pass && within_guarded_limits(item, slab.recipe.guard)),
               "a slab that passes has measured all between its seats");
  for (const BlockResult& b : slab.blocks) {
    fuzz::must(b.verdict != Verdict::none && !b.items.empty(), "a slab that passes has all its blocks");
    for (const Item& item : b.items) {
      if (!item.required) continue;
      if (item.id == ItemId::seat_slope && slab.recipe.slope_datum == SlopeDatum::slab_frame) continue;
      fuzz::must(item.verdict == Verdict::pass && within_guarded_limits(item, slab.recipe.guard),
                 "a slab that passes has good blocks");
    }
  }
}

SlabResult inspect(const Slab& slab) {
  SlabResult out;
  out.verdict = Verdict::pass;  // overwrites any previous value
  algo::inspect_slab(slab.recipe, slab.blocks, slab.sigmas, slab.T_base_slab, out);
  return out;
}

void check(const Slab& slab, const SlabResult& out) {
  fuzz::must(out.verdict == Verdict::pass || out.verdict == Verdict::fail || out.verdict == Verdict::not_measured ||
                 out.verdict == Verdict::indeterminate,
             "every slab has a verdict");
  fuzz::must(out.verdict == Verdict::pass || out.reason != 0, "what does not pass says why");
  fuzz::must((out.verdict == Verdict::fail) == (out.fail_mask != 0), "what fails says which item");
  std::size_t displaced = 0;
  for (const bool b : slab.beside) displaced += b ? 1U : 0U;
  for (int station = 1; station <= slab.recipe.stations(); ++station) {
    const auto k = static_cast<std::size_t>(station);
    const Verdict verdict = out.station_verdict[k - 1];
    fuzz::must(verdict != Verdict::none, "every station has a verdict");
    fuzz::must(verdict == Verdict::pass || out.verdict != Verdict::pass, "a slab passes only with all its stations");
    fuzz::must(verdict != Verdict::fail || out.verdict == Verdict::fail, "a station that fails fails the slab");
    fuzz::must((verdict == Verdict::pass) == (out.station_reason[k - 1] == 0), "a station that does not pass says why");
    fuzz::must(!slab.missing[k] || verdict != Verdict::pass, "a station that was not measured never passes");
    // Three seats of at least twelve cannot move the fitted frame.
    if (slab.plain && displaced <= 3)
      fuzz::must(!slab.beside[k] || verdict != Verdict::pass, "a seat out of its place never passes");
  }
  if (out.verdict == Verdict::pass) check_pass(slab, out);
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  if (size < 1) return 0;
  Slab slab(data[0]);
  const std::size_t steps = std::min((size - 1) / kStepBytes, kStepsMax);
  for (std::size_t i = 0; i < steps; ++i) apply(slab, Step(data + 1 + i * kStepBytes));
  slab.judge_blocks();
  const SlabResult out = inspect(slab);
  check(slab, out);
  if (steps == 0) fuzz::must(out.verdict == Verdict::pass, "a good slab passes");

  if (!slab.plain) return 0;
  // The same slab in another frame: no pass becomes a fail.
  const Pose T = scene::displaced(-700.0, 1200.0, 30.0, -0.6, 0.9, 140.0);
  for (BlockResult& b : slab.blocks) {
    SeatObservation& o = b.observation;
    o.p_base = T * o.p_base;
    o.jaw_outer_base = T * o.jaw_outer_base;
    o.n_base = T.rotation * o.n_base;
    o.top_n_base = T.rotation * o.top_n_base;
  }
  slab.T_base_slab = T * slab.T_base_slab;
  const SlabResult there = inspect(slab);
  check(slab, there);
  const auto opposite = [](Verdict a, Verdict b) { return a == Verdict::pass && b == Verdict::fail; };
  fuzz::must(!opposite(out.verdict, there.verdict) && !opposite(there.verdict, out.verdict),
             "the base frame turns no pass into a fail");
  return 0;
}
