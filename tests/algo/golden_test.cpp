// SPDX-License-Identifier: Apache-2.0
//
// Same input, same bits: in every run, next to another inspector on another thread, and with every compiler. One fixed
// block is measured and the bits of the results are compared with golden_bits.txt in this folder, a line per stage: the
// first line that differs shows the stage at fault.
//
// A changed algorithm changes bits. If the other tests accept the change, store the new bits:
//
//     SLABD_UPDATE_GOLDEN=1 build/release/tests/algo/algo_golden_test && git diff tests/algo/golden_bits.txt
//
// and commit them with it. Bits that differ between compilers are a bug and not a reason to update. The scan is made
// without the C library's functions; the tested room uses a few (sin, atan2, exp), so another C library may give other
// bits. This one gives others on processors without fused multiply-add, where the last bit of some angle may differ; in
// these scans none does (ctest's golden_without_fma).
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <bit>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <limits>
#include <map>
#include <string>
#include <thread>
#include <vector>

#include "algo/algo.h"
#include "algo/block_model.h"
#include "scene.h"
#include "tests/places/places.h"

namespace slabd::algo {
namespace {

/// FNV-1a over the bits of doubles; all NaN count as equal.
class Bits {
 public:
  Bits& operator<<(double value) {
    std::uint64_t word = std::isnan(value) ? 0x7ff8000000000000U : std::bit_cast<std::uint64_t>(value);
    for (int i = 0; i < 8; ++i, word >>= 8U) hash_ = (hash_ ^ (word & 0xffU)) * 0x100000001b3U;
    return *this;
  }
  Bits& operator<<(std::uint64_t value) { return *this << static_cast<double>(value); }
  Bits& operator<<(const Vec3& v) { return *this << v.x() << v.y() << v.z(); }
  Bits& operator<<(const Mat3& m) {
    for (Eigen::Index i = 0; i < m.size(); ++i) *this << m.data()[i];
    return *this;
  }
  Bits& operator<<(const PlaneFit& f) {
    return *this << f.normal << f.offset_mm << f.inliers << f.std_mm << f.centroid << f.sigma_offset_mm << f.cov_normal;
  }
  Bits& operator<<(const CasingFeature& c) {
    return *this << c.centre << c.radius_mm << c.height_mm << std::uint64_t{c.rim_points} << c.edge_rms_mm
                 << c.cov_circle;
  }
  [[nodiscard]] std::string text() const {
    char hex[20];
    std::snprintf(hex, sizeof hex, "%016llx", static_cast<unsigned long long>(hash_));
    return hex;
  }

 private:
  std::uint64_t hash_ = 0xcbf29ce484222325U;
};

/// Approximately normal, and the same on every machine.
double noise(Prng& prng) {
  double sum = -6.0;
  for (int i = 0; i < 12; ++i) sum += prng.uniform();
  return sum;
}

constexpr std::size_t kColumns = 660;
constexpr std::size_t kRows = 1000;

/// Order of the points: row by row without the missing ones; with them as NaN; without them in a random order.
enum class Order { by_rows, organised, shuffled };
constexpr std::array<Order, 3> kOrders = {Order::by_rows, Order::organised, Order::shuffled};
constexpr const char* suffix(Order order) {
  return order == Order::by_rows ? "" : order == Order::organised ? "_organised" : "_shuffled";
}

void shuffle(std::vector<float>& xyz, Prng& prng) {
  for (std::size_t i = xyz.size() / 3; i > 1; --i) {
    const auto j = static_cast<std::size_t>(prng.below(i));
    for (std::size_t axis = 0; axis < 3; ++axis) std::swap(xyz[3 * (i - 1) + axis], xyz[3 * j + axis]);
  }
}

/// The nominal block sampled every 0.5 mm from slightly off its position, with noise and outliers. Only + - * / and
/// sqrt.
std::vector<float> fixed_scan(std::uint64_t seed, Order order = Order::by_rows) {
  Prng prng(seed);
  BlockModel model;
  model.build(scene::p5600().block);
  // A rotation by rational sine and cosine: 1 mrad about Z.
  constexpr double t = 0.0005;
  constexpr double cosine = (1.0 - t * t) / (1.0 + t * t);
  constexpr double sine = 2.0 * t / (1.0 + t * t);
  std::vector<float> xyz;
  constexpr auto half_rows = static_cast<int>(kRows / 2);
  constexpr auto half_columns = static_cast<int>(kColumns / 2);
  for (int row = -half_rows; row < half_rows; ++row) {
    for (int column = -half_columns; column < half_columns; ++column) {
      const double x = 0.5 * column + 0.2 * prng.uniform();
      const double y = 0.5 * row + 0.2 * prng.uniform();
      Face face = Face::seat;
      double z = 0.0;
      const bool seen = model.visible(x, y, face, z) && prng.uniform() > 0.01;
      z += 0.03 * noise(prng) + (prng.uniform() < 0.002 ? 20.0 * prng.uniform() : 0.0);
      if (!seen) {
        if (order == Order::organised) xyz.insert(xyz.end(), 3, std::numeric_limits<float>::quiet_NaN());
        continue;
      }
      const double bx = cosine * x - sine * y + 0.7;
      const double by = sine * x + cosine * y - 0.4;
      xyz.insert(xyz.end(), {static_cast<float>(bx), static_cast<float>(-by), static_cast<float>(600.0 - (z + 0.3))});
    }
  }
  if (order == Order::shuffled) shuffle(xyz, prng);
  return xyz;
}

using Stages = std::map<std::string, std::string>;

Stages measure(BlockInspector& inspector, const std::vector<float>& scan, Order order = Order::by_rows) {
  // Capacity for the grid recovered from a shuffled scan.
  std::vector<float> xyz(3 * kColumns * kRows + 3 * kColumns);
  xyz.resize(std::max(xyz.size(), scan.size()));
  std::copy(scan.begin(), scan.end(), xyz.begin());
  inspector.begin(1, Pose::identity(), nominal_T_block_scanner());
  const bool organised = order == Order::organised;
  Cloud cloud{xyz, scan.size() / 3, organised ? kColumns : 0, organised ? kRows : 0};
  EXPECT_TRUE(inspector.denoise(cloud).ok());
  EXPECT_TRUE(inspector.register_to_model(cloud).ok());
  EXPECT_TRUE(inspector.extract(cloud).ok());
  inspector.judge(Code::ok);
  const BlockResult& r = inspector.result();
  Stages stages;
  stages["1_denoise"] = (Bits() << r.scan.points_kept).text();
  Bits registration;
  for (const double v : r.registration.T_scanner_block.to_array()) registration << v;
  const DeviationStats& deviation = r.registration.deviation;
  registration << deviation.std_mm << r.registration.noise_mm;
  for (const double share : deviation.within_sigma) registration << share;
  for (Eigen::Index i = 0; i < r.registration.covariance.size(); ++i)
    registration << r.registration.covariance.data()[i];
  stages["2_registration"] = registration.text();
  stages["3_planes"] = (Bits() << r.seat.plane << r.seat.full_plane << r.jaw_inner << r.jaw_outer << r.slab_top).text();
  const SeatFeature& seat = r.seat;
  stages["4_flatness"] = (Bits() << seat.flatness_mm << seat.flatness_min_zone_mm << seat.std_cells_mm
                                 << seat.raw_low_mm << seat.raw_high_mm << seat.noise_factor << seat.flatness_noise_mm
                                 << seat.defect.limit_mm << std::uint64_t{seat.defect.cells})
                             .text();
  stages["5_casings"] = (Bits() << r.casing_inner << r.casing_outer).text();
  Bits items;
  for (const Item& i : r.items) items << i.value << i.U << i.companion;
  stages["6_items"] = items.text();
  Bits cells;
  const DeviationMap map = inspector.deviation_map();
  for (const std::int64_t sum_nm : map.sum_nm) cells << static_cast<double>(sum_nm);
  for (const std::uint32_t count : map.count) cells << std::uint64_t{count};
  stages["7_map"] = cells.text();
  return stages;
}

const std::string kGoldenFile = places::source_dir() + "/tests/algo/golden_bits.txt";

TEST(Golden, a_fixed_block_has_the_bits_it_always_had) {
  BlockInspector inspector;
  inspector.use(scene::p5600());
  Stages stages;
  for (const Order order : kOrders)
    for (const auto& [stage, bits] : measure(inspector, fixed_scan(2026, order), order))
      stages[stage + suffix(order)] = bits;
  if (std::getenv("SLABD_UPDATE_GOLDEN") != nullptr) {
    std::ofstream out(kGoldenFile);
    for (const auto& [stage, bits] : stages) out << stage << ' ' << bits << '\n';
    GTEST_SUCCEED() << "updated " << kGoldenFile;
    return;
  }
  Stages golden;
  std::ifstream in(kGoldenFile);
  std::string stage;
  std::string bits;
  while (in >> stage >> bits) golden[stage] = bits;
  for (const auto& [name, expected] : golden) {
    ASSERT_TRUE(stages.contains(name)) << name;
    EXPECT_EQ(stages.at(name), expected) << name << ": how to take new bits over stands at the head of this file";
  }
  EXPECT_EQ(golden.size(), stages.size());
}

TEST(Golden, one_thread_or_two_and_every_instruction_set_give_the_same_bits) {
  for (const Order order : kOrders) {
    const std::vector<float> scan = fixed_scan(7, order);
    std::map<std::string, Stages> seen;
    for (const InstructionSet set : {InstructionSet::plain, InstructionSet::sse4, InstructionSet::avx2,
                                     InstructionSet::avx512, InstructionSet::best}) {
      if (!limit_instruction_set(set)) continue;
      for (const int threads : {1, 2}) {
        BlockInspector inspector(threads);
        inspector.use(scene::p5600());
        const std::string how = std::string(instruction_set()) + ", threads " + std::to_string(threads);
        seen[how] = measure(inspector, scan, order);
      }
    }
    ASSERT_TRUE(limit_instruction_set(InstructionSet::best));
#if defined(HWY_COMPILE_ONLY_STATIC)
    ASSERT_EQ(seen.size(), 2U) << "built for one instruction set";
#else
    ASSERT_GE(seen.size(), 4U);
    // A processor with better sets must have been tested against the bits of the worst one.
    EXPECT_TRUE(!__builtin_cpu_supports("avx2") || seen.size() >= 6U);
#endif
    for (const auto& [how, stages] : seen) EXPECT_EQ(stages, seen.begin()->second) << how;
  }
}

TEST(Golden, two_inspectors_at_work_together_have_the_bits_of_one) {
  const std::vector<std::vector<float>> scans = {fixed_scan(1), fixed_scan(2)};
  std::vector<Stages> alone(2);
  {
    BlockInspector inspector;
    inspector.use(scene::p5600());
    for (std::size_t i = 0; i < 2; ++i) alone[i] = measure(inspector, scans[i]);
  }
  std::vector<Stages> together(2);
  std::vector<std::thread> threads;
  for (std::size_t i = 0; i < 2; ++i) {
    threads.emplace_back([&, i] {
      BlockInspector inspector;
      inspector.use(scene::p5600());
      // Twice, so that both certainly run at the same time at some point.
      for (int again = 0; again < 2; ++again) together[i] = measure(inspector, scans[i]);
    });
  }
  for (std::thread& thread : threads) thread.join();
  EXPECT_EQ(together, alone);
  EXPECT_NE(alone[0], alone[1]) << "or the comparison could not fail";
}

}  // namespace
}  // namespace slabd::algo
