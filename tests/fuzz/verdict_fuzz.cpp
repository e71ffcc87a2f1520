// SPDX-License-Identifier: Apache-2.0
//
// From a whole scan to the verdict. The input selects a block as built and changes to its scan. Invariants: a pass has
// every required item measured and within its guarded limits, and the block was found; a block built far out of
// tolerance never passes; measuring the same scan on two threads, in another order or in another frame never turns a
// pass into a fail.
//
//   0        the block (kSubjects)
//   1        the compared measurement (kRelations)
//   2        seed of the scan's noise
//   3        bit 0: organised
//   rest     steps of 8 bytes: kind, x, y, radius, value (int16), two more bytes
#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstring>
#include <vector>

#include "algo/algo.h"
#include "base/prng.h"
#include "tests/algo/scene.h"
#include "tests/fuzz/fuzz.h"

using namespace slabd;  // NOLINT(google-build-using-namespace)

namespace {

constexpr std::size_t kHeadBytes = 4;
constexpr std::size_t kStepBytes = 8;
constexpr std::size_t kStepsMax = 8;
constexpr std::size_t kSubjects = 12;
/// Coarser than a scanner, with proportionally wider cells: ten scans a second instead of one.
constexpr double kPitch_mm = 0.85;
constexpr double kCell_mm = 3.0;

/// Blocks: a good one, and one without the slab's top around it (its slope has no datum). The others are out of
/// tolerance by at least twice U, at any place.
scene::Block subject(std::size_t number) {
  scene::Block block;
  switch (number) {
    case 1: block.slab_top_seen = false; break;
    case 2: block.present = false; break;
    case 3: block.cant_ratio = 34.0; break;
    case 4: block.cant_ratio = 46.5; break;
    case 5: block.jaw_distance_mm = 381.2; break;
    case 6: block.jaw_angle_inner_deg = 111.5; break;
    case 7: block.jaw_angle_outer_deg = 108.5; break;
    case 8: block.casing_spacing_mm = 234.5; break;
    case 9: block.rim_inner_mm = -0.8; break;
    case 10: block.rim_outer_mm = 0.3; break;
    case 11: block.wave_mm = 0.8; break;
    default: break;
  }
  return block;
}
bool is_bad(std::size_t number) {
  return number >= 2;
}

Recipe recipe() {
  Recipe r = scene::p5600();
  r.evaluation.cell_mm = kCell_mm;
  return r;
}

struct Subject {
  scene::Cloud cloud;
  Pose T_block_scanner = nominal_T_block_scanner();  ///< start pose of the inspection
  bool may_hide = false;                             ///< a step may have hidden or removed the defect
  bool has_strangers = false;                        ///< some points are far from their neighbours in the grid
  bool has_step = false;                             ///< a plateau on the seat that flatness must detect
};

struct Step {
  std::uint8_t kind;
  double x_mm, y_mm;  ///< in the scanner's frame
  double radius_mm;
  std::int16_t value;
  std::uint8_t more[2];

  explicit Step(const std::uint8_t* at)
      : kind(at[0]),
        x_mm((at[1] - 128) * 1.4),
        y_mm((at[2] - 128) * 2.0),
        radius_mm(0.5 * at[3]),
        value(static_cast<std::int16_t>(static_cast<std::uint16_t>(at[4]) | static_cast<std::uint16_t>(at[5] << 8U))),
        more{at[6], at[7]} {}
};

template <typename Change>
void each_in(Subject& s, const Step& step, const Change& change) {
  const double r2 = step.radius_mm * step.radius_mm;
  for (std::size_t i = 0; i + 2 < s.cloud.xyz.size(); i += 3) {
    const double dx = static_cast<double>(s.cloud.xyz[i]) - step.x_mm;
    const double dy = static_cast<double>(s.cloud.xyz[i + 1]) - step.y_mm;
    if (dx * dx + dy * dy <= r2) change(&s.cloud.xyz[i]);
  }
}

void apply(Subject& s, const Step& step) {
  constexpr float nan = std::numeric_limits<float>::quiet_NaN();
  switch (step.kind % 10) {
    case 0:  // no points there
      each_in(s, step, [nan](float* p) { std::fill_n(p, 3, nan); });
      s.may_hide = true;
      break;
    case 1: {  // higher or lower there; flatness must detect it on the seat if wide and high enough
      const double height_mm = 1e-3 * step.value;
      each_in(s, step, [&](float* p) { p[2] -= static_cast<float>(height_mm); });
      const bool on_seat = std::abs(step.x_mm) + step.radius_mm < 45.0 && std::abs(step.y_mm) + step.radius_mm < 70.0;
      if (on_seat && step.radius_mm >= 8.0 && step.radius_mm <= 25.0 && std::abs(height_mm) >= 1.5 &&
          std::abs(height_mm) <= 20.0 && !s.has_step)
        s.has_step = true;
      else
        s.may_hide = true;
      break;
    }
    case 2: {  // rough there
      Prng prng(step.more[0]);
      const double sigma_mm = 1e-4 * std::abs(step.value);
      each_in(s, step, [&](float* p) { p[2] += static_cast<float>(sigma_mm * prng.normal()); });
      s.may_hide = true;
      break;
    }
    case 3: {  // arbitrary bits as coordinates, in points that are `radius` apart
      const std::uint32_t bits = static_cast<std::uint32_t>(static_cast<std::uint16_t>(step.value)) << 16U |
                                 static_cast<std::uint32_t>(step.more[0]) << 8U | step.more[1];
      const std::size_t stride = 3 * (8 + static_cast<std::size_t>(step.radius_mm * 20.0));
      for (std::size_t i = static_cast<std::size_t>(step.more[0]) % 3; i < s.cloud.xyz.size(); i += stride)
        s.cloud.xyz[i] = std::bit_cast<float>(bits);
      s.may_hide = true;
      s.has_strangers = true;
      break;
    }
    case 4: {  // every n-th point is removed
      const std::size_t keep = 2 + step.more[0] % 7;
      for (std::size_t i = 0; i + 2 < s.cloud.xyz.size(); i += 3)
        if (i / 3 % keep == 0) std::fill_n(&s.cloud.xyz[i], 3, nan);
      break;
    }
    case 5: {  // another start pose of the inspection
      const auto small = [](std::uint8_t b) { return 0.25 * (static_cast<double>(b) - 128.0); };
      s.T_block_scanner = scene::displaced(0.5 * step.x_mm, 0.3 * step.y_mm, small(step.more[0]), 0.0,
                                           0.1 * small(step.more[1]), 1e-4 * step.value) *
                          s.T_block_scanner;
      break;
    }
    case 6: {  // the scanner's scale is wrong
      const auto factor = static_cast<float>(1.0 + 1e-6 * step.value);
      for (float& v : s.cloud.xyz) v *= factor;
      s.may_hide = true;
      break;
    }
    case 7:  // all points there become one
      each_in(s, step, [&](float* p) {
        p[0] = static_cast<float>(step.x_mm);
        p[1] = static_cast<float>(step.y_mm);
        p[2] = static_cast<float>(600.0 - 1e-2 * step.value);
      });
      s.may_hide = true;
      s.has_strangers = true;
      break;
    case 8: {  // cut off
      const std::size_t keep = s.cloud.xyz.size() / 3 * (1 + step.more[0]) / 256;
      std::fill(s.cloud.xyz.begin() + static_cast<std::ptrdiff_t>(3 * keep), s.cloud.xyz.end(), nan);
      s.may_hide = true;
      break;
    }
    default: {  // a tilted object covers it
      each_in(s, step, [&](float* p) {
        p[2] = static_cast<float>(600.0 - 1e-3 * step.value +
                                  0.02 * (step.more[0] - 128) * (static_cast<double>(p[0]) - step.x_mm) /
                                      (1.0 + step.radius_mm));
      });
      s.may_hide = true;
      break;
    }
  }
}

struct Outcome {
  Verdict verdict = Verdict::none;
  std::uint16_t reason = 0;
  std::vector<double> values;
};

/// Measures a copy and checks the invariants of any result.
Outcome measure(algo::BlockInspector& inspector, const scene::Cloud& cloud, const Pose& T_block_scanner,
                const Recipe& recipe) {
  std::vector<float> xyz = cloud.xyz;
  algo::Cloud view{xyz, xyz.size() / 3, cloud.width, cloud.height};
  inspector.begin(1, Pose{}, T_block_scanner);
  Status status = inspector.denoise(view);
  if (status.ok()) status = inspector.register_to_model(view);
  if (status.ok()) status = inspector.extract(view);
  inspector.judge(status.ok() ? Code::ok : status.error().code);
  const BlockResult& result = inspector.result();
  fuzz::must(result.verdict != Verdict::none, "every measurement has a verdict");
  fuzz::must(result.verdict == Verdict::pass || result.reason != 0, "what does not pass says why");
  Outcome outcome{result.verdict, result.reason, {}};
  for (const Item& item : result.items) {
    outcome.values.push_back(item.value);
    fuzz::must(!std::isinf(item.value) && !std::isinf(item.U), "figures are finite");
    fuzz::must(has_value(item.value) || item.verdict != Verdict::pass, "an item without a value does not pass");
    fuzz::must(std::isnan(item.U) || item.U >= 0.0, "U is no less than nothing");
  }
  if (result.verdict != Verdict::pass) return outcome;
  fuzz::must(status.ok(), "a stage that failed does not pass");
  fuzz::must(result.registration.status == RegistrationStatus::converged, "a pass was found");
  for (const Item& item : result.items) {
    if (!item.required) continue;
    const double guard = recipe.guard * item.U;
    fuzz::must(item.verdict == Verdict::pass && has_value(item.value), "a pass has measured all");
    fuzz::must(std::isnan(item.lower) || item.value >= item.lower + guard, "above the lower limit by the guard band");
    fuzz::must(std::isnan(item.upper) || item.value <= item.upper - guard, "below the upper limit by the guard band");
  }
  return outcome;
}

void check_not_opposite(const Outcome& a, const Outcome& b, const char* what) {
  const auto is = [](const Outcome& o, Verdict v) { return o.verdict == v; };
  fuzz::must(!(is(a, Verdict::pass) && is(b, Verdict::fail)) && !(is(a, Verdict::fail) && is(b, Verdict::pass)), what);
}

scene::Cloud moved(const scene::Cloud& cloud, const Pose& T_new_old) {
  scene::Cloud out = cloud;
  for (std::size_t i = 0; i + 2 < out.xyz.size(); i += 3) {
    const Vec3 p = T_new_old * Vec3(static_cast<double>(out.xyz[i]), static_cast<double>(out.xyz[i + 1]),
                                    static_cast<double>(out.xyz[i + 2]));
    for (std::size_t axis = 0; axis < 3; ++axis)
      out.xyz[i + axis] = static_cast<float>(p[static_cast<Eigen::Index>(axis)]);
  }
  return out;
}

scene::Cloud shuffled(const scene::Cloud& cloud, std::uint64_t seed) {
  scene::Cloud out = cloud;
  out.width = out.height = 0;
  Prng prng(seed);
  for (std::size_t i = out.xyz.size() / 3; i > 1; --i) {
    const auto j = static_cast<std::size_t>(prng.below(i));
    std::swap_ranges(out.xyz.begin() + static_cast<std::ptrdiff_t>(3 * (i - 1)),
                     out.xyz.begin() + static_cast<std::ptrdiff_t>(3 * i),
                     out.xyz.begin() + static_cast<std::ptrdiff_t>(3 * j));
  }
  return out;
}

const scene::Cloud& drawn(std::size_t number, bool organised, std::uint8_t seed) {
  // Four scans of every block are cached, because drawing takes longer than measuring.
  static std::array<scene::Cloud, kSubjects * 8> kept;
  const std::size_t of = seed % 4U;
  scene::Cloud& cloud = kept[(number * 2 + (organised ? 1 : 0)) * 4 + of];
  if (!cloud.xyz.empty()) return cloud;
  scene::Scan scan;
  scan.pitch_mm = kPitch_mm;
  scan.organised = organised;
  scan.seed = 1 + of;
  scan.displacement = scene::displaced(1.0 + static_cast<double>(of), -0.8, 0.5, 0.1, -0.2, 0.1);
  cloud = scene::take(subject(number), scan);
  return cloud;
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  if (size < kHeadBytes) return 0;
  static const Recipe reference = recipe();
  static algo::BlockInspector inspector(1);
  static algo::BlockInspector team(2);
  static const bool used = [] {
    inspector.use(reference);
    team.use(reference);
    return true;
  }();
  static_cast<void>(used);

  const std::size_t number = data[0] % kSubjects;
  Subject s{drawn(number, (data[3] & 1U) != 0, data[2])};
  const std::size_t steps = std::min((size - kHeadBytes) / kStepBytes, kStepsMax);
  for (std::size_t i = 0; i < steps; ++i) apply(s, Step(data + kHeadBytes + i * kStepBytes));

  const Outcome outcome = measure(inspector, s.cloud, s.T_block_scanner, reference);
  if (!s.may_hide) {
    fuzz::must(!is_bad(number) || outcome.verdict != Verdict::pass, "a block out of tolerance never passes");
    fuzz::must(!s.has_step || outcome.verdict != Verdict::pass, "a seat with a step never passes");
  }
  if (steps == 0 && number == 0) fuzz::must(outcome.verdict == Verdict::pass, "a good block that is seen well passes");

  switch (data[1] % 3) {
    case 0: {
      const Outcome other = measure(team, s.cloud, s.T_block_scanner, reference);
      fuzz::must(other.verdict == outcome.verdict && other.reason == outcome.reason, "two threads judge as one");
      fuzz::must(
          other.values.size() == outcome.values.size() &&
              std::memcmp(other.values.data(), outcome.values.data(), outcome.values.size() * sizeof(double)) == 0,
          "two threads measure as one, bit by bit");
      break;
    }
    case 1: {
      const Pose T = scene::displaced(12.0, -7.0, 30.0, 0.3, -0.2, 0.5);
      check_not_opposite(outcome, measure(inspector, moved(s.cloud, T), s.T_block_scanner * T.inverse(), reference),
                         "the scanner's frame turns no pass into a fail");
      break;
    }
    default:
      if (s.has_strangers) break;
      check_not_opposite(outcome, measure(inspector, shuffled(s.cloud, 5), s.T_block_scanner, reference),
                         "the order of points turns no pass into a fail");
      break;
  }
  return 0;
}
