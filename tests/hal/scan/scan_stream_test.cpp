// SPDX-License-Identifier: Apache-2.0
#include "hal/scan/scan_stream.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <limits>
#include <memory>
#include <string>
#include <string_view>
#include <vector>

#include "base/prng.h"
#include "hal/scan/scanner_ports.h"
#include "hal/system/crc32c.h"

namespace slabd::hal {
namespace {

using Bytes = std::vector<std::byte>;

TEST(Crc32c, has_the_values_of_its_standard) {
  const auto of = [](std::string_view text) { return crc32c(std::as_bytes(std::span(text))); };
  EXPECT_EQ(of(""), 0U);
  EXPECT_EQ(of("123456789"), 0xE306'9283U);
  EXPECT_EQ(of(std::string(32, '\0')), 0x8A91'36AAU) << "RFC 3720, B.4";
  EXPECT_EQ(of(std::string(32, '\xff')), 0x62A8'AB43U);
}

TEST(Crc32c, is_the_same_with_the_instruction_and_without_at_any_length_and_place) {
  Prng prng(6);
  std::vector<std::byte> bytes(40'000);
  for (std::byte& b : bytes) b = std::byte(prng.next() & 255U);
  // Lengths around one, two and three times the three stretches that are processed in parallel.
  for (const std::size_t length :
       std::array<std::size_t, 14>{0, 1, 7, 8, 9, 63, 6'143, 6'144, 6'145, 12'287, 12'288, 18'432, 18'441, 39'990})
    for (std::size_t from = 0; from < 9; ++from) {
      const auto piece = std::span<const std::byte>(bytes).subspan(from, length);
      EXPECT_EQ(crc32c(piece, 0x1234'5678U), crc32c_by_tables(piece, 0x1234'5678U)) << length << " from " << from;
    }
}

TEST(Crc32c, computed_in_pieces_equals_that_of_the_whole) {
  Prng prng(3);
  Bytes bytes(1'000);
  for (std::byte& b : bytes) b = static_cast<std::byte>(prng.next());
  const std::uint32_t whole = crc32c(bytes);
  for (std::size_t cut = 0; cut <= bytes.size(); cut += 37)
    EXPECT_EQ(crc32c(std::span(bytes).subspan(cut), crc32c(std::span(bytes).first(cut))), whole) << cut;
}

struct Scan {
  ScanStreamHeader header;
  std::vector<float> xyz;

  [[nodiscard]] Bytes header_bytes(std::uint32_t first = 0) const {
    ScanStreamHeader h = header;
    h.first = first;
    const ScanHeaderBytes encoded = encode_scan_header(h);
    return {encoded.begin(), encoded.end()};
  }
  [[nodiscard]] Bytes bytes(std::uint32_t first = 0) const {
    Bytes all = header_bytes(first);
    const auto points = std::as_bytes(std::span(xyz).subspan(3 * std::size_t{first}));
    all.insert(all.end(), points.begin(), points.end());
    return all;
  }
};

Scan scan(std::uint32_t width = 8, std::uint32_t height = 5) {
  Scan s;
  for (std::uint32_t i = 0; i < 3 * width * height; ++i) s.xyz.push_back(0.25F * static_cast<float>(i));
  s.xyz[3] = std::numeric_limits<float>::quiet_NaN();
  s.xyz[10] = std::numeric_limits<float>::infinity();
  s.header = {7, 3, width, height, width * height, 0, LengthUnit::mm, 1'700'000'000'000'000, 0};
  s.header.points_crc = crc32c(std::as_bytes(std::span(s.xyz)));
  return s;
}

struct ScanStreamTest : testing::Test {
  std::vector<float> xyz = std::vector<float>(3 * 100);
  ScanStreamDecoder decoder{xyz};
  ScanStreamTest() { decoder.expect(7, 3); }

  /// Feeds pieces of `piece` bytes, each in a heap block of its exact size, so that a sanitizer detects any read beyond
  /// it.
  Status feed(const Bytes& bytes, std::size_t piece = 1'000) {
    for (std::size_t at = 0; at < bytes.size();) {
      const std::size_t n = std::min({piece, bytes.size() - at, std::max<std::size_t>(1, decoder.wanted())});
      const auto exact = std::make_unique<std::byte[]>(n);
      std::memcpy(exact.get(), &bytes[at], n);
      if (Status status = decoder.feed({exact.get(), n}); !status) return status;
      at += n;
    }
    return success();
  }
  void expect_refused(const Bytes& bytes, std::string_view told) {
    const Status status = feed(bytes);
    ASSERT_FALSE(status.ok()) << told;
    EXPECT_NE(status.error().text.view().find(told), std::string_view::npos) << status.error().text.view();
    EXPECT_FALSE(decoder.complete());
  }
};

TEST_F(ScanStreamTest, a_scan_comes_whole_whatever_pieces_it_comes_in) {
  const Scan s = scan();
  for (const std::size_t piece :
       {std::size_t{1}, std::size_t{7}, std::size_t{64}, std::size_t{65}, std::size_t{4096}}) {
    decoder.expect(7, 3);
    ASSERT_TRUE(feed(s.bytes(), piece).ok());
    ASSERT_TRUE(decoder.complete());
    EXPECT_EQ(decoder.wanted(), 0U);
    EXPECT_EQ(decoder.shape().points, 40U);
    EXPECT_EQ(decoder.shape().finite, 38U);
    EXPECT_EQ(decoder.shape().width, 8U);
    EXPECT_EQ(xyz[0], 0.0F);
    EXPECT_EQ(xyz[119], s.xyz[119]);
    for (const std::size_t missing : {std::size_t{1}, std::size_t{3}})
      for (std::size_t axis = 0; axis < 3; ++axis) EXPECT_TRUE(std::isnan(xyz[3 * missing + axis]));
  }
}

TEST_F(ScanStreamTest, an_emulated_scanner_declares_itself_and_unknown_flags_are_refused) {
  Scan s = scan();
  ASSERT_TRUE(feed(s.bytes()).ok());
  EXPECT_FALSE(decoder.shape().emulated);
  decoder.expect(7, 3);
  s.header.emulated = true;
  ASSERT_TRUE(feed(s.bytes()).ok());
  EXPECT_TRUE(decoder.shape().emulated);
  ScanHeaderBytes header = encode_scan_header(s.header);
  header[36] = std::byte{4};
  const std::uint32_t crc = crc32c(std::span(header).first(60));
  std::memcpy(&header[60], &crc, sizeof crc);
  const Result<ScanStreamHeader> read = decode_scan_header(header);
  ASSERT_FALSE(read.ok());
  EXPECT_NE(read.error().text.view().find("flags 0x00000004"), std::string_view::npos) << read.error().text.view();
}

TEST_F(ScanStreamTest, metres_and_micrometres_become_mm) {
  Scan s = scan();
  s.header.unit = LengthUnit::m;
  ASSERT_TRUE(feed(s.bytes()).ok());
  EXPECT_EQ(xyz[119], 1000.0F * s.xyz[119]);
  decoder.expect(7, 3);
  s.header.unit = LengthUnit::um;
  ASSERT_TRUE(feed(s.bytes()).ok());
  EXPECT_EQ(xyz[119], static_cast<float>(0.001 * static_cast<double>(s.xyz[119])));
}

TEST_F(ScanStreamTest, continues_after_a_cut_at_every_byte) {
  const Scan s = scan();
  const Bytes all = s.bytes();
  for (std::size_t cut = 0; cut < all.size(); ++cut) {
    decoder.expect(7, 3);
    ASSERT_TRUE(feed(Bytes(all.begin(), all.begin() + static_cast<std::ptrdiff_t>(cut))).ok());
    decoder.cut();
    const auto have = static_cast<std::uint32_t>(decoder.points());
    EXPECT_EQ(have, cut < kScanHeaderBytes ? 0U : (cut - kScanHeaderBytes) / kScanPointBytes);
    ASSERT_TRUE(feed(s.bytes(have)).ok()) << cut;
    ASSERT_TRUE(decoder.complete()) << cut;
    EXPECT_EQ(decoder.finite(), 38U);
  }
}

TEST_F(ScanStreamTest, is_amid_a_scan_from_its_first_byte_to_its_last_but_one) {
  const Bytes all = scan().bytes();
  for (std::size_t came = 0; came < all.size(); ++came) {
    EXPECT_EQ(decoder.is_in_scan(), came != 0) << came;
    ASSERT_TRUE(feed({all[came]}).ok());
  }
  EXPECT_FALSE(decoder.is_in_scan());
}

TEST_F(ScanStreamTest, a_sender_that_begins_again_after_a_cut_is_taken_too) {
  const Scan s = scan();
  Bytes part = s.bytes();
  part.resize(300);
  ASSERT_TRUE(feed(part).ok());
  decoder.cut();
  EXPECT_EQ(decoder.starts(), 1U);
  ASSERT_TRUE(feed(s.bytes()).ok());
  EXPECT_TRUE(decoder.complete());
  EXPECT_EQ(decoder.starts(), 2U) << "a copy of the points begins again";
}

TEST_F(ScanStreamTest, another_scan_never_continues_an_interrupted_one) {
  Scan s = scan();
  Bytes part = s.bytes();
  part.resize(kScanHeaderBytes + 10 * kScanPointBytes);
  ASSERT_TRUE(feed(part).ok());
  decoder.cut();
  Scan other = s;
  other.header.utime_us += 1;  // the scanner was triggered again
  expect_refused(s.header_bytes(9), "the scan continues at point 9, but 10");
  decoder.cut();
  EXPECT_EQ(decoder.points(), 10U);
  expect_refused(other.header_bytes(10), "the scan continues at point 10, but 0 of its points were received");
  decoder.cut();
  // The sender has taken another scan, so the first one is not requested any more.
  EXPECT_EQ(decoder.points(), 0U);
  EXPECT_FALSE(decoder.has_header());
  expect_refused(s.header_bytes(10), "the scan continues at point 10, but 0");
  decoder.cut();
  EXPECT_TRUE(feed(other.bytes()).ok());
  EXPECT_TRUE(decoder.complete());
}

TEST(ScanAnswer, is_one_whole_line_however_long_and_strange_its_text) {
  for (const char* piece : {"x", "\"", "\xff", "\xc3\xa9", "\xe8\xbd\xa8", "\xf0\x9f\x9a\x86"}) {
    std::string text;
    while (text.size() + 4 < limits::kErrorTextBytes) text += piece;
    Error why = error(Code::frame_incomplete, "%s", text.c_str());
    const std::string line(scan_answer_json(65'535, 65'535, &why, 4'294'967'295).view());
    EXPECT_TRUE(line.ends_with("\"}\n")) << line;
    EXPECT_LE(line.size(), 640U);
    EXPECT_TRUE(std::all_of(line.begin(), line.end() - 1, [](char c) { return c >= ' ' && c <= '~'; })) << line;
    const std::size_t cut = line.rfind("\\u");
    EXPECT_TRUE(cut == std::string::npos || line.size() - 3 - cut >= 6) << "no escape is cut: " << line;
  }
  const Error why = error(Code::frame_incomplete, "Schiene \xc3\xa9\xe8\xbd\xa8\xf0\x9f\x9a\x86\xc3");
  EXPECT_NE(scan_answer_json(1, 2, &why, 0).view().find("Schiene \\u00e9\\u8f68\\ud83d\\ude86\\u00c3\"}"),
            std::string_view::npos)
      << scan_answer_json(1, 2, &why, 0).c_str();
}

TEST_F(ScanStreamTest, the_answer_to_another_request_is_refused_before_a_point_of_it) {
  Scan s = scan();
  s.header.cmd_seq = 2;
  expect_refused(s.header_bytes(), "answers request 7-2, expected is 7-3");
  decoder.cut();
  s.header.cmd_seq = 3;
  s.header.session = 6;
  expect_refused(s.header_bytes(), "answers request 6-3, expected is 7-3");
  EXPECT_EQ(decoder.points(), 0U);
}

TEST_F(ScanStreamTest, a_point_that_was_damaged_on_the_way_costs_the_scan) {
  const Scan s = scan();
  Bytes bytes = s.bytes();
  bytes[kScanHeaderBytes + 200] ^= std::byte{1};
  expect_refused(bytes, "CRC-32C");
  EXPECT_EQ(decoder.points(), 0U);
  decoder.cut();
  ASSERT_TRUE(feed(s.bytes()).ok());
  EXPECT_TRUE(decoder.complete());
}

TEST_F(ScanStreamTest, every_byte_of_the_header_is_guarded) {
  const Scan s = scan();
  for (std::size_t at = 0; at < kScanHeaderBytes; ++at) {
    Bytes bytes = s.header_bytes();
    bytes[at] ^= std::byte{0x20};
    decoder.expect(7, 3);
    EXPECT_FALSE(feed(bytes).ok()) << at;
  }
}

TEST_F(ScanStreamTest, a_header_that_cannot_be_is_refused_by_name) {
  const auto with = [](auto change) {
    Scan s = scan();
    change(s.header);
    return s.header_bytes();
  };
  expect_refused(with([](ScanStreamHeader& h) { h.count = 0; }), "no points");
  decoder.cut();
  expect_refused(with([](ScanStreamHeader& h) { h.width = 9; }), "width 9 times height 5 is not count 40");
  decoder.cut();
  expect_refused(with([](ScanStreamHeader& h) {
                   h.width = h.height = 0x1'0000;
                   h.count = 0;
                 }),
                 "no points");
  decoder.cut();
  expect_refused(scan().header_bytes(40), "first point 40 of 40");
  decoder.cut();
  expect_refused(with([](ScanStreamHeader& h) { h.unit = static_cast<LengthUnit>(3); }), "unit 3");
  decoder.cut();
  expect_refused(with([](ScanStreamHeader& h) {
                   h.width = h.height = 0;
                   h.count = 101;
                 }),
                 "has 101 points, allowed are 100");
  decoder.cut();
  expect_refused(with([](ScanStreamHeader& h) {
                   h.width = h.height = 0;
                   h.count = 0xFFFF'FFFF;
                 }),
                 "allowed are 100");
  decoder.cut();
  expect_refused(Bytes(kScanHeaderBytes, std::byte{0}), "SLABSCAN");
}

TEST_F(ScanStreamTest, more_bytes_than_a_scan_has_are_refused) {
  const Scan s = scan();
  ASSERT_TRUE(feed(s.bytes()).ok());
  const std::byte one{0};
  EXPECT_FALSE(decoder.feed({&one, 1}).ok());
  EXPECT_TRUE(decoder.complete()) << "the scan itself is good";
}

TEST_F(ScanStreamTest, noise_of_any_kind_is_survived) {
  Prng prng(11);
  const Scan s = scan();
  for (int i = 0; i < 20'000; ++i) {
    Bytes bytes = s.bytes();
    for (std::uint64_t flips = 1 + prng.below(4); flips > 0; --flips)
      bytes[prng.below(bytes.size())] = static_cast<std::byte>(prng.next());
    bytes.resize(prng.below(bytes.size() + 1));
    decoder.expect(7, 3);
    const bool good = feed(bytes, 1 + prng.below(200)).ok();
    EXPECT_LE(decoder.points(), 40U);
    EXPECT_FALSE(decoder.complete() && !good);
  }
}

TEST_F(ScanStreamTest, a_refusal_carries_code_and_reason_in_any_pieces) {
  const std::string reason = "packets are missing\x1b";
  ScanStreamHeader header{7, 3, 303, 0, static_cast<std::uint32_t>(reason.size())};
  header.refused = true;
  header.points_crc = crc32c(std::as_bytes(std::span(reason)));
  const ScanHeaderBytes head = encode_scan_header(header);
  Bytes bytes(head.begin(), head.end());
  for (const char c : reason) bytes.push_back(static_cast<std::byte>(c));
  for (const std::size_t piece : {std::size_t{1}, std::size_t{70}, std::size_t{4096}}) {
    decoder.expect(7, 3);
    ASSERT_TRUE(feed(bytes, piece).ok());
    ASSERT_NE(decoder.refusal(), nullptr);
    EXPECT_EQ(decoder.refusal()->code, Code::frame_incomplete);
    EXPECT_EQ(decoder.refusal()->text.view(), "the gateway has no scan: packets are missing?");
    EXPECT_FALSE(decoder.complete());
    EXPECT_EQ(decoder.wanted(), 0U);
  }
  decoder.expect(7, 3);
  EXPECT_EQ(decoder.refusal(), nullptr);
  bytes.back() ^= std::byte{1};
  expect_refused(bytes, "the reason of a refusal has CRC-32C");
}

TEST_F(ScanStreamTest, a_cut_refusal_begins_again) {
  const std::string reason = "no frame";
  ScanStreamHeader header{7, 3, 302, 0, static_cast<std::uint32_t>(reason.size())};
  header.refused = true;
  header.points_crc = crc32c(std::as_bytes(std::span(reason)));
  const ScanHeaderBytes head = encode_scan_header(header);
  Bytes bytes(head.begin(), head.end());
  for (const char c : reason) bytes.push_back(static_cast<std::byte>(c));
  ASSERT_TRUE(feed({bytes.begin(), bytes.end() - 3}).ok());
  decoder.cut();
  ASSERT_TRUE(feed(scan().bytes()).ok()) << "or a scan follows";
  EXPECT_TRUE(decoder.complete());
}

TEST_F(ScanStreamTest, a_refusal_with_other_numbers_is_not_allowed) {
  for (const auto& [width, height, count] :
       {std::array<std::uint32_t, 3>{300, 0, 5}, {305, 0, 5}, {303, 1, 5}, {303, 0, 0}, {303, 0, 241}}) {
    decoder.expect(7, 3);
    ScanStreamHeader header{7, 3, width, height, count};
    header.refused = true;
    const ScanHeaderBytes head = encode_scan_header(header);
    expect_refused({head.begin(), head.end()}, "scan header: a refusal with");
  }
}

TEST_F(ScanStreamTest, the_scanners_print_is_part_of_the_scan) {
  Scan s = scan();
  s.header.scanner = scanner_print("PhoXi 7 1.13 0badcafe");
  ASSERT_TRUE(feed(s.bytes()).ok());
  EXPECT_EQ(decoder.header().scanner, s.header.scanner);
  ScanStreamHeader other = s.header;
  other.scanner = scanner_print("PhoXi 7 1.14 0badcafe");
  EXPECT_FALSE(other.same_scan(s.header));
  EXPECT_EQ(scanner_print(""), 0U);
  EXPECT_EQ(scanner_print("a"), 0xAF63'DC4C'8601'EC8CU) << "FNV-1a's own example";
}

TEST_F(ScanStreamTest, the_scanners_temperature_is_in_the_upper_half_of_the_flags) {
  Scan s = scan();
  s.header.temperature_ck = temperature_ck_of(31.25);
  EXPECT_EQ(s.header.temperature_ck, 30'440);
  ASSERT_TRUE(feed(s.bytes()).ok());
  EXPECT_NEAR(decoder.shape().scanner_temperature_c, 31.25, 1e-9);
  ScanStreamHeader other = s.header;
  other.temperature_ck = 0;
  EXPECT_FALSE(other.same_scan(s.header));
  EXPECT_TRUE(std::isnan(temperature_c_of(0)));
  for (const double impossible : {-41.0, 126.0, kNoValue}) EXPECT_EQ(temperature_ck_of(impossible), 0) << impossible;
  for (const double allowed : {-40.0, 0.0, 125.0})
    EXPECT_NEAR(temperature_c_of(temperature_ck_of(allowed)), allowed, 0.005) << allowed;
}

TEST_F(ScanStreamTest, a_temperature_that_no_scanner_has_is_refused_with_its_bytes_and_the_allowed_range) {
  for (const unsigned ck : {1U, 23'314U, 39'816U, 65'535U}) {
    decoder.expect(7, 3);
    Scan s = scan();
    s.header.temperature_ck = static_cast<std::uint16_t>(ck);
    expect_refused(s.header_bytes(), "scan header: scanner temperature " + std::to_string(ck) + " in bytes 38..39");
  }
}

}  // namespace
}  // namespace slabd::hal
