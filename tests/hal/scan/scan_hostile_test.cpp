// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>

#include <cmath>
#include <cstdlib>

#include "hal/scan/lzf.h"
#include "tests/hal/scan/scan_reading.h"

// Good files, damaged at random. The result must be an error with a text, or a cloud that meets the reader's
// guarantees. The sanitizer presets run the same test; SLABD_SCAN_MUTATIONS=200000 runs it longer.
namespace slabd::hal {
namespace {

using test::bytes_of;

struct Sample {
  std::string name;
  std::string bytes;
  std::size_t header = 0;  ///< bytes before the data
};

std::string ply_head(const std::string& format, const std::string& extra) {
  return "ply\nformat " + format + " 1.0\ncomment organized width 5 height 4\nelement camera 2\nproperty short id\n" +
         "element vertex 20\nproperty float x\nproperty double y\n" + extra + "property float z\nelement face 1\n" +
         "property list uchar int vertex_indices\nend_header\n";
}

std::string ply_binary(bool big, bool list) {
  const std::string extra = list ? "property list uchar short seen\n" : "property uchar red\n";
  std::string bytes = ply_head(big ? "binary_big_endian" : "binary_little_endian", extra) + "iiii";
  for (int i = 1; i <= 20; ++i) {
    bytes += bytes_of(static_cast<float>(i), big) + bytes_of(i * 0.5, big);
    bytes +=
        list ? bytes_of(static_cast<std::uint8_t>(i % 3)) + std::string(2U * static_cast<unsigned>(i % 3), 's') : "r";
    bytes += bytes_of(-static_cast<float>(i), big);
  }
  return bytes + bytes_of(std::uint8_t{3}) + std::string(12, 'f');
}

std::string rows(char separator, const std::string& extra) {
  std::string text;
  for (int i = 1; i <= 20; ++i)
    text += std::to_string(i) + separator + std::to_string(i * 0.5) + separator + extra + std::to_string(-i) + "\n";
  return text;
}

std::string pcd_head(const std::string& data) {
  return "# .PCD v0.7\nVERSION 0.7\nFIELDS x y rgb z\nSIZE 4 8 4 4\nTYPE F F U F\nCOUNT 1 1 1 1\nWIDTH 5\nHEIGHT 4\n"
         "VIEWPOINT 0 0 0 1 0 0 0\nPOINTS 20\nDATA " +
         data + "\n";
}

std::vector<Sample> samples() {
  std::vector<Sample> all;
  const auto add = [&](const std::string& name, const std::string& bytes, const std::string& end_of_header) {
    const std::size_t at = end_of_header.empty() ? 0 : bytes.find(end_of_header) + end_of_header.size();
    all.push_back({name, bytes, at});
  };
  for (const bool big : {false, true})
    for (const bool list : {false, true}) add("a.ply", ply_binary(big, list), "end_header\n");
  add("a.ply", ply_head("ascii", "property list uchar int n\n") + "1\n2\n" + rows(' ', "2 7 7 ") + "3 0 1 2\n",
      "end_header\n");
  std::string binary, planes;
  for (int i = 1; i <= 20; ++i)
    binary += bytes_of(static_cast<float>(i)) + bytes_of(i * 0.5) + "rgb " + bytes_of(-static_cast<float>(i));
  for (const auto& [begin, size] : {std::pair{0U, 4U}, {4U, 8U}, {12U, 4U}, {16U, 4U}})
    for (unsigned i = 0; i < 20; ++i) planes += binary.substr(20U * i + begin, size);
  const std::string stream = lzf_compress(planes);
  add("a.pcd", pcd_head("ascii") + rows(' ', "255 "), "ascii\n");
  add("a.pcd", pcd_head("binary") + binary, "binary\n");
  add("a.pcd",
      pcd_head("binary_compressed") + bytes_of(static_cast<std::uint32_t>(stream.size())) +
          bytes_of(static_cast<std::uint32_t>(planes.size())) + stream,
      "compressed\n");
  add("a.xyz", "# by hand\n" + rows(' ', ""), "hand\n");
  add("a.csv", "x,y,z\n" + rows(',', ""), "z\n");
  add("a.csv", "z [mm];y [mm];x [mm]\n" + rows(';', ""), "x [mm]\n");
  return all;
}

constexpr std::size_t kCapacity = 32;

/// Reads damaged bytes and checks every guarantee. Returns true if they were accepted.
bool keeps_its_promises(const Sample& sample, const std::string& bytes, const std::string& what) {
  const test::Read r = test::read_bytes(bytes, sample.name, LengthUnit::mm, kCapacity);
  if (!r.shape) {
    const Code code = r.shape.error().code;
    EXPECT_TRUE(code == Code::frame_incomplete || code == Code::too_few_points) << what;
    EXPECT_NE(r.why().find(sample.name), std::string::npos) << what << r.why();
    for (const char c : r.why()) EXPECT_TRUE(c >= ' ' && c <= '~') << what << ": raw bytes in an error text";
    return false;
  }
  const ScanShape& shape = r.shape.value();
  EXPECT_GT(shape.points, 0U) << what;
  EXPECT_LE(shape.points, kCapacity) << what;
  EXPECT_TRUE(shape.width == 0 || shape.width * shape.height == shape.points) << what;
  std::size_t finite = 0;
  for (std::size_t i = 0; i < shape.points; ++i) {
    const int missing = std::isnan(r.xyz[3 * i]) + std::isnan(r.xyz[3 * i + 1]) + std::isnan(r.xyz[3 * i + 2]);
    EXPECT_TRUE(missing == 0 || missing == 3) << what;
    for (std::size_t k = 0; k < 3; ++k) EXPECT_FALSE(std::isinf(r.xyz[3 * i + k])) << what;
    finite += missing == 0 ? 1 : 0;
  }
  EXPECT_EQ(finite, shape.finite) << what;
  return true;
}

TEST(ScanHostile, the_samples_are_good) {
  for (const Sample& sample : samples()) {
    const test::Read r = test::read_bytes(sample.bytes, sample.name);
    ASSERT_TRUE(r.shape.ok()) << r.why();
    EXPECT_EQ(r.shape.value().finite, 20U);
  }
}

TEST(ScanHostile, a_file_cut_anywhere_is_refused_if_its_header_declares_the_length) {
  for (const Sample& sample : samples())
    for (std::size_t bytes = 0; bytes < sample.bytes.size(); ++bytes) {
      const std::string what = sample.name + " cut to " + std::to_string(bytes) + " bytes: ";
      const bool accepted = keeps_its_promises(sample, sample.bytes.substr(0, bytes), what);
      const bool is_table = sample.name == "a.xyz" || sample.name == "a.csv";
      // The last number of a text may lose digits undetected; therefore text files must be unchanged for some time
      // first.
      const bool is_text = is_table || sample.bytes.find("ascii") != std::string::npos;
      const bool in_last_line = bytes > sample.bytes.rfind('\n', sample.bytes.size() - 2);
      const bool must_refuse = !is_table && !(is_text && in_last_line);
      EXPECT_FALSE(accepted && must_refuse) << what;
    }
}

TEST(ScanHostile, random_damage_is_refused_or_harmless) {
  const char* wanted = std::getenv("SLABD_SCAN_MUTATIONS");
  const long rounds = wanted == nullptr ? 30'000 : std::atol(wanted);
  const std::vector<Sample> good = samples();
  const std::vector<std::string> words = {"4294967295", "-1",  "0",    "1099511627776", "18446744073709551616",
                                          "nan",        "1e9", "\xFF", "list uint",     std::string(1, '\0'),
                                          "\n",         "\r",  ",",    "property",      "binary"};
  Prng prng(20260807);
  int accepted = 0;
  for (long round = 0; round < rounds; ++round) {
    const Sample& sample = good[prng.below(good.size())];
    std::string bytes = sample.bytes;
    for (std::uint64_t changes = 1 + prng.below(4); changes > 0 && !bytes.empty(); --changes) {
      const bool in_header = sample.header > 0 && prng.below(2) == 0;
      const std::size_t at = prng.below(in_header ? std::min(sample.header, bytes.size()) : bytes.size());
      switch (prng.below(6)) {
        case 0: bytes[at] = static_cast<char>(prng.below(256)); break;
        case 1: bytes[at] = static_cast<char>(bytes[at] ^ (1 << prng.below(8))); break;
        case 2: bytes.erase(at, 1 + prng.below(8)); break;
        case 3: bytes.insert(at, words[prng.below(words.size())]); break;
        case 4: bytes.insert(at, bytes.substr(prng.below(bytes.size()), prng.below(40))); break;
        default: bytes.resize(at); break;
      }
    }
    accepted += keeps_its_promises(sample, bytes, "round " + std::to_string(round) + ": ");
    ASSERT_FALSE(HasFailure()) << "seed 20260807, round " << round;
  }
  EXPECT_GT(accepted, rounds / 20) << "the damage never reaches the data";
}

TEST(ScanHostile, noise_behind_a_good_name_is_refused) {
  Prng prng(1);
  for (const std::string name : {"a.ply", "a.pcd", "a.xyz", "a.csv"})
    for (const std::size_t bytes : {1U, 100U, 16'384U, 300'000U}) {
      std::string noise;
      for (std::size_t i = 0; i < bytes; ++i) noise += static_cast<char>(prng.below(256));
      EXPECT_FALSE(test::read_bytes(noise, name).shape.ok()) << name << " " << bytes;
      EXPECT_FALSE(test::read_bytes(std::string(bytes, '\0'), name).shape.ok()) << name << " " << bytes;
    }
}

}  // namespace
}  // namespace slabd::hal
