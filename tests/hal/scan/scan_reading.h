// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <gtest/gtest.h>
#include <sys/mman.h>
#include <unistd.h>

#include <cstring>
#include <limits>
#include <string>
#include <string_view>
#include <vector>

#include "base/os.h"
#include "hal/scan/scan_file.h"

/// Reads scans from bytes in memory as files.
namespace slabd::hal::test {

inline constexpr float kMissing = std::numeric_limits<float>::quiet_NaN();

template <typename T>
std::string bytes_of(T value, bool big_endian = false) {
  std::string bytes(sizeof value, '\0');
  std::memcpy(bytes.data(), &value, sizeof value);
  if (big_endian) bytes = {bytes.rbegin(), bytes.rend()};
  return bytes;
}

struct Read {
  std::vector<float> xyz;  ///< -1 if not written
  Result<ScanShape> shape;

  [[nodiscard]] std::string why() const { return shape ? "" : shape.error().text.c_str(); }
};

/// An in-memory file with these bytes and this name.
inline Fd memory_file(std::string_view bytes) {
  Fd fd(memfd_create("scan", MFD_CLOEXEC));
  EXPECT_TRUE(fd.is_open());
  EXPECT_EQ(write(fd.get(), bytes.data(), bytes.size()), static_cast<ssize_t>(bytes.size()));
  return fd;
}

inline Read read_bytes(std::string_view bytes, const std::string& name, LengthUnit unit = LengthUnit::mm,
                       std::size_t capacity_points = 64) {
  std::vector<float> xyz(3 * capacity_points, -1.0F);
  const Fd fd = memory_file(bytes);
  Team alone(1);
  Result<ScanShape> shape = read_scan_fd(fd.get(), name.c_str(), unit, xyz, alone);

  static Team two(2);
  std::vector<float> again(3 * capacity_points, -1.0F);
  const Result<ScanShape> by_two = read_scan_fd(fd.get(), name.c_str(), unit, again, two);
  EXPECT_EQ(by_two.ok(), shape.ok());
  if (by_two.ok() && shape.ok()) {
    EXPECT_EQ(by_two.value().finite, shape.value().finite);
    EXPECT_EQ(by_two.value().zeros, shape.value().zeros);
    EXPECT_EQ(std::memcmp(again.data(), xyz.data(), again.size() * sizeof(float)), 0);
  } else if (!by_two.ok() && !shape.ok()) {
    EXPECT_EQ(by_two.error().text, shape.error().text);
  }
  return {std::move(xyz), std::move(shape)};
}

/// Expects that the scan is rejected with a text that contains the file's name and `expected`.
inline void expect_refused(std::string_view bytes, const std::string& expected, const std::string& name,
                           Code code = Code::frame_incomplete, LengthUnit unit = LengthUnit::mm) {
  const Read r = read_bytes(bytes, name, unit);
  ASSERT_FALSE(r.shape.ok()) << "should be refused with: " << expected;
  EXPECT_EQ(r.shape.error().code, code) << r.why();
  EXPECT_NE(r.why().find(expected), std::string::npos) << r.why() << "\nshould hold: " << expected;
  EXPECT_NE(r.why().find(name), std::string::npos) << r.why();
}

/// Expects that the scan is read with exactly these points (NaN = missing).
inline void expect_points(std::string_view bytes, const std::string& name, const std::vector<float>& xyz,
                          LengthUnit unit = LengthUnit::mm) {
  const Read r = read_bytes(bytes, name, unit);
  ASSERT_TRUE(r.shape.ok()) << r.why();
  ASSERT_EQ(3 * r.shape.value().points, xyz.size()) << name;
  for (std::size_t i = 0; i < xyz.size(); ++i) {
    if (xyz[i] == xyz[i]) {
      EXPECT_EQ(r.xyz[i], xyz[i]) << name << ": point " << i / 3 << " axis " << i % 3;
    } else {
      EXPECT_NE(r.xyz[i], r.xyz[i]) << name << ": point " << i / 3 << " axis " << i % 3 << " should be missing";
    }
  }
  if (r.xyz.size() == xyz.size()) return;
  EXPECT_EQ(r.xyz[xyz.size()], -1.0F) << "nothing is written beyond the points";
}

}  // namespace slabd::hal::test
