// SPDX-License-Identifier: Apache-2.0
#include "hal/scan/point_readers.h"

#include <gtest/gtest.h>

#include <cstring>
#include <string>
#include <vector>

#include "tests/hal/scan/scan_reading.h"

// Files of several pieces, so that two threads share the work.
namespace slabd::hal {
namespace {

using test::bytes_of;
using test::memory_file;

constexpr std::size_t kPoints = 150'003;  // of 12 bytes: six pieces and seven eighths, not a multiple of sixteen

struct Layout {
  const char* name;
  PointRecord record;
  double mm_per_unit = 1.0;
};

std::vector<Layout> layouts() {
  const PointRecord plain{12, {0, 4, 8}, {}, false};
  return {{"as in memory", plain},
          {"metres", plain, 1000.0},
          {"big-endian", {12, {0, 4, 8}, {}, true}},
          {"doubles between others", {40, {27, 3, 16}, {true, true, false}, false}},
          {"as long as a record may be", {kScanPointBytesMax, {4'084, 0, 2'000}, {}, false}}};
}

/// Every 97th point is missing, in different ways.
std::vector<float> points_of(std::size_t points) {
  std::vector<float> xyz(3 * points);
  for (std::size_t i = 0; i < points; ++i) {
    for (std::size_t axis = 0; axis < 3; ++axis)
      xyz[3 * i + axis] = 0.25F * static_cast<float>((i * (axis + 7)) % 4'001) - 333.0F;
    if (i % 97 == 5) xyz[3 * i + i % 3] = test::kMissing;
    if (i % 97 == 50) xyz[3 * i] = xyz[3 * i + 1] = xyz[3 * i + 2] = 0.0F;
  }
  return xyz;
}

std::string records_of(const std::vector<float>& xyz, const PointRecord& record) {
  std::string bytes;
  for (std::size_t i = 0; i < xyz.size(); i += 3) {
    std::string one(record.bytes, '\x7f');
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const float value = xyz[i + axis];
      one.replace(record.offset[axis], record.is_double[axis] ? 8 : 4,
                  record.is_double[axis] ? bytes_of(static_cast<double>(value), record.big_endian)
                                         : bytes_of(value, record.big_endian));
    }
    bytes += one;
  }
  return bytes;
}

struct Outcome {
  bool ok = false;
  std::vector<float> xyz;
  Settled settled;
  std::uint64_t offset = 0;
  std::string why;
};

/// Reads a file that claims `claimed` bytes, with `head` of them before the points.
Outcome read_with(int threads, const std::string& bytes, std::size_t head, std::uint64_t claimed, const Layout& layout,
                  std::size_t points) {
  const Fd fd = memory_file(bytes);
  Team team(threads);
  ScanWindow window(fd.get(), "scan", claimed);
  EXPECT_TRUE(window.have(head));
  window.consume(head);
  Outcome out;
  out.xyz.assign(3 * points, -1.0F);
  out.ok = read_point_records<float>(window, layout.record, layout.mm_per_unit, out.xyz, out.settled, team);
  out.offset = window.offset();
  if (!out.ok) out.why = window.failure().text.c_str();
  return out;
}

TEST(PointRecords, two_threads_read_what_one_reads) {
  for (const Layout& layout : layouts()) {
    SCOPED_TRACE(layout.name);
    const std::size_t points = layout.record.bytes > 100 ? 1'003 : kPoints;
    const std::string bytes = "head " + records_of(points_of(points), layout.record) + " and more";
    const Outcome one = read_with(1, bytes, 5, bytes.size(), layout, points);
    const Outcome two = read_with(2, bytes, 5, bytes.size(), layout, points);
    ASSERT_TRUE(one.ok && two.ok) << one.why << two.why;
    EXPECT_EQ(one.settled.finite, points - (points + 91) / 97 - (points + 46) / 97);
    EXPECT_EQ(one.settled.zeros, (points + 46) / 97);
    EXPECT_EQ(two.settled, one.settled);
    EXPECT_EQ(std::memcmp(two.xyz.data(), one.xyz.data(), one.xyz.size() * sizeof(float)), 0);
    EXPECT_EQ(one.offset, bytes.size() - 9);
    EXPECT_EQ(two.offset, one.offset) << "the window stands behind the points";
  }
}

// Two files that are too short: one cut by its writer, and one whose header declares points beyond the end.
TEST(PointRecords, two_threads_report_the_same_error_for_a_short_file_as_one) {
  const Layout layout = layouts()[0];
  const std::string bytes = records_of(points_of(kPoints), layout.record);
  for (const std::size_t there : {std::size_t{0}, std::size_t{100'000}, std::size_t{1'000'000}, bytes.size() - 1}) {
    const std::string rest = bytes.substr(0, there);
    for (const std::uint64_t claimed : {std::uint64_t{bytes.size()}, std::uint64_t{rest.size()}}) {
      const Outcome one = read_with(1, rest, 0, claimed, layout, kPoints);
      const Outcome two = read_with(2, rest, 0, claimed, layout, kPoints);
      EXPECT_FALSE(one.ok);
      EXPECT_FALSE(two.ok);
      EXPECT_NE(one.why, "");
      EXPECT_EQ(two.why, one.why);
    }
  }
}

// A second read after a failure must not count points twice.
TEST(PointRecords, a_failure_leaves_no_points_in_the_count) {
  const Layout layout = layouts()[0];
  const std::string bytes = records_of(points_of(kPoints), layout.record);
  const std::string rest = bytes.substr(0, bytes.size() - 1);
  const Outcome one = read_with(1, rest, 0, bytes.size(), layout, kPoints);
  const Outcome two = read_with(2, rest, 0, bytes.size(), layout, kPoints);
  EXPECT_EQ(two.settled, one.settled);
}

}  // namespace
}  // namespace slabd::hal
