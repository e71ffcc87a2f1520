// SPDX-License-Identifier: Apache-2.0
//
// slabctl show --cloud on a stored slab with its scans: the points are those of the scan, in the block's frame.
#include <array>
#include <cmath>
#include <cstring>
#include <limits>
#include <nlohmann/json.hpp>

#include "cli/exit.h"
#include "tests/cli/stored_slab.h"

namespace slabd::cli {
namespace {

using nlohmann::json;

std::vector<std::int16_t> from_base64(const std::string& text) {
  constexpr std::string_view kLetters = "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string bytes;
  std::uint32_t bits = 0;
  int count = 0;
  for (const char letter : text) {
    const std::size_t value = kLetters.find(letter);
    if (value == std::string_view::npos) break;
    bits = bits << 6U | static_cast<std::uint32_t>(value);
    count += 6;
    if (count < 8) continue;
    count -= 8;
    bytes += static_cast<char>(bits >> static_cast<unsigned>(count) & 0xFFU);
  }
  std::vector<std::int16_t> numbers(bytes.size() / sizeof(std::int16_t));
  std::memcpy(numbers.data(), bytes.data(), numbers.size() * sizeof(std::int16_t));
  return numbers;
}

struct BlockCloud : StoredSlab {
  void SetUp() override {
    begin();
    measure(3);
    end();
  }
  [[nodiscard]] Ended show(const std::string& more) const { return run("show 1 --db " + db() + " " + more); }
  [[nodiscard]] std::string config() const {
    return write("slabd.toml", "[plc]\nlisten = \"127.0.0.1:1502\"\n[recipes]\ndir = \"" + places::source_dir() +
                                   "/recipes\"\n[cell]\nT_base_slab = [1800, 0, 300, 1, 0, 0, 0]\n[storage]\ndb = \"" +
                                   db() + "\"\nspool_dir = \"" + file("moved") +
                                   "\"\n[calibration]\nT_flange_scanner = [0, 80, 150, 1, 0, 0, 0]\n");
  }
  static Vec3 point(const json& document, const std::vector<std::int16_t>& numbers, std::size_t i) {
    Vec3 p;
    for (std::size_t axis = 0; axis < 3; ++axis)
      p[static_cast<Eigen::Index>(axis)] =
          numbers[3 * i + axis] * document["step_mm"].get<double>() + document["origin_mm"][axis].get<double>();
    return p;
  }
};

TEST_F(BlockCloud, has_at_most_200000_points_and_the_seat_is_on_its_plane) {
  const Ended ended = show("--block 3 --cloud --json");
  ASSERT_EQ(ended.status, kDone) << ended.err;
  const json document = json::parse(ended.out, nullptr, false);
  EXPECT_EQ(document["schema"], "slabd.block_cloud/1");
  EXPECT_EQ(document["slab_id"], "SLAB-0042");
  EXPECT_EQ(document["station"], 3);
  EXPECT_EQ(document["attempt"], 1);
  EXPECT_EQ(document["unit"], "mm");
  EXPECT_EQ(document["frame"], "block");
  const std::vector<std::int16_t> xyz = from_base64(document["xyz"]);
  const std::vector<std::int16_t> deviation = from_base64(document["deviation"]);
  const auto points = document["points"].get<std::size_t>();
  EXPECT_LE(points, 200'000U);
  EXPECT_GT(points, 100'000U);
  EXPECT_LT(document["step_mm"].get<double>(), 0.02);
  ASSERT_EQ(xyz.size(), 3 * points);
  ASSERT_EQ(deviation.size(), points);

  // The origin is the centre of the bearing plane. The scan has stray points, which the document keeps.
  const json& seat = document["seat"];
  const Vec3 normal(seat["normal"][0], seat["normal"][1], seat["normal"][2]);
  EXPECT_NEAR(seat["offset_mm"].get<double>(), 0.0, 1.0);
  EXPECT_GT(normal.z(), 0.99);
  std::size_t on_seat = 0;
  std::size_t beyond = 0;
  std::size_t other_deviation = 0;
  for (std::size_t i = 0; i < points; ++i) {
    const Vec3 p = point(document, xyz, i);
    if (std::abs(p.x()) > 50.0 || std::abs(p.y()) > 50.0) continue;
    const double height_mm = normal.dot(p) - seat["offset_mm"].get<double>();
    ++on_seat;
    if (std::abs(height_mm) > 1.0)
      ++beyond;
    else if (std::abs(deviation[i] * document["deviation_step_mm"].get<double>() - height_mm) > 1.0)
      ++other_deviation;
  }
  EXPECT_GT(on_seat, 5'000U);
  EXPECT_LT(beyond, on_seat / 100);
  EXPECT_LT(other_deviation, on_seat / 100);
}

TEST_F(BlockCloud, is_the_scan_moved_by_the_inverse_of_T_scanner_block) {
  const Ended ended = show("--block 3 --cloud --json");
  ASSERT_EQ(ended.status, kDone) << ended.err;
  const json document = json::parse(ended.out, nullptr, false);
  Pages memory(limits::kScanSlotBytes);
  const std::span<float> xyz = memory.take<float>(limits::kScanPointsMax * 3);
  const Result<ScanShape> shape = hal::read_scan(scan(3).c_str(), hal::LengthUnit::mm, xyz);
  ASSERT_TRUE(shape.ok()) << shape.error().text.view();
  EXPECT_EQ(document["points_read"], shape.value().points);
  const auto stride = document["stride"].get<std::size_t>();
  EXPECT_EQ(stride, (shape.value().finite + 199'999) / 200'000);
  const std::size_t taken = document["points"].get<std::size_t>() + document["left_out"].get<std::size_t>();
  EXPECT_GE(taken, shape.value().finite / stride);
  EXPECT_LE(taken, shape.value().finite / stride + 1);
  ASSERT_EQ(document["left_out"], 0);
  // The first group gives its first point.
  std::size_t first = 0;
  while (!std::isfinite(xyz[3 * first])) ++first;
  const Vec3 p_scanner(xyz[3 * first], xyz[3 * first + 1], xyz[3 * first + 2]);
  const Vec3 wanted = stations_[2].block.registration.T_scanner_block.inverse() * p_scanner;
  EXPECT_LE((point(document, from_base64(document["xyz"]), 0) - wanted).cwiseAbs().maxCoeff(),
            0.51 * document["step_mm"].get<double>());
  EXPECT_EQ(show("--block 3 --cloud --json").out, ended.out);
}

TEST_F(BlockCloud, a_scan_in_another_spool_is_found_and_a_gone_or_changed_one_is_refused) {
  const std::string there = show("--block 3 --cloud --json").out;
  fs::rename(file("spool"), file("moved"));
  const std::string by_config = "show 1 --block 3 --cloud --json --config " + config();
  const Ended moved = run(by_config);
  EXPECT_EQ(moved.status, kDone) << moved.err;
  EXPECT_EQ(moved.out, there);

  const std::string path = file("moved/1/03-1.ply");
  std::string bytes = content(path);
  bytes[bytes.size() / 2] = static_cast<char>(bytes[bytes.size() / 2] ^ 0x10);
  std::ofstream(path, std::ios::binary) << bytes;
  const Ended changed = run(by_config);
  EXPECT_EQ(changed.status, kBadInput);
  expect_mentions(changed.err, "no cloud of slab 1 block 3: its scan was changed");

  fs::remove(path);
  const Ended gone = run(by_config);
  EXPECT_EQ(gone.status, kBadInput);
  EXPECT_EQ(gone.out, "");
  expect_mentions(gone.err, "no cloud of slab 1 block 3: its scan is gone (" + path + " is not there)");
}

TEST_F(BlockCloud, needs_a_block_that_was_measured_and_no_other_document) {
  const Ended missing = show("--block 4 --cloud --json");
  EXPECT_EQ(missing.status, kBadInput);
  expect_mentions(missing.err, "no cloud of slab 1 block 4: it was not measured");
  EXPECT_EQ(show("--cloud --json").status, kUsage);
  EXPECT_EQ(show("--block 3 --cloud").status, kUsage);
  EXPECT_EQ(show("--block 3 --cloud --map --json").status, kUsage);
}

/// A slab without stored checksums and without the recipe's text.
struct BlockCloudUnproven : BlockCloud {
  void SetUp() override {
    keeps_proof_ = false;
    begin();
    measure(3);
    end();
  }
};

TEST_F(BlockCloudUnproven, has_distances_only_with_the_recipe_of_the_slab) {
  const Ended without = show("--block 3 --cloud --json");
  ASSERT_EQ(without.status, kDone) << without.err;
  EXPECT_TRUE(json::parse(without.out, nullptr, false)["deviation"].is_null());
  const Ended with = run("show 1 --block 3 --cloud --json --config " + config());
  ASSERT_EQ(with.status, kDone) << with.err;
  EXPECT_TRUE(json::parse(with.out, nullptr, false)["deviation"].is_string());
}

}  // namespace
}  // namespace slabd::cli
