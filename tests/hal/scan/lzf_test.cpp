// SPDX-License-Identifier: Apache-2.0
#include "hal/scan/lzf.h"

#include <gtest/gtest.h>

#include <array>

#include "tests/hal/scan/scan_reading.h"

namespace slabd::hal {
namespace {

/// Decodes all of `stream` in pieces of `piece` bytes.
Result<std::string> decoded(const std::string& stream, std::size_t bytes, std::size_t piece = 1'000) {
  const Fd fd = test::memory_file(stream);
  ScanWindow window(fd.get(), "stream", stream.size());
  LzfReader reader(window, bytes);
  std::string out(bytes, '?');
  for (std::size_t at = 0; at < bytes; at += piece) {
    const Status status = reader.read(&out[at], std::min(piece, bytes - at));
    if (!status) return status.error();
  }
  if (Status status = reader.finish(); !status) return status.error();
  return out;
}

/// Decoder that follows the definition literally, with all data in memory.
std::string decoded_simply(const std::string& in) {
  std::string out;
  for (std::size_t i = 0; i < in.size();) {
    const unsigned control = static_cast<unsigned char>(in[i++]);
    if (control < 32) {
      out += in.substr(i, control + 1);
      i += control + 1;
      continue;
    }
    std::size_t length = control >> 5U;
    if (length == 7) length += static_cast<unsigned char>(in[i++]);
    const std::size_t back = (control & 31U) * 256U + static_cast<unsigned char>(in[i++]) + 1U;
    for (length += 2; length > 0; --length) out += out[out.size() - back];
  }
  return out;
}

std::string noise(std::size_t bytes, std::uint64_t values, Prng& prng) {
  std::string text;
  for (std::size_t i = 0; i < bytes; ++i) text += static_cast<char>(prng.below(values));
  return text;
}

TEST(Lzf, a_stream_made_by_hand) {
  // "abc", then 4 bytes from 3 back (overlapping), then 300 bytes of the last output in two long copies.
  const std::string stream = std::string(
                                 "\x02"
                                 "abc",
                                 4) +
                             std::string("\x40\x02", 2) + std::string("\xE0\x8F\x00", 3) +
                             std::string("\xE0\x8B\x00", 3);
  const std::string wanted = "abcabca" + std::string(152, 'a') + std::string(148, 'a');
  const auto text = decoded(stream, wanted.size());
  ASSERT_TRUE(text.ok()) << text.error().text.c_str();
  EXPECT_EQ(text.value(), wanted);
  EXPECT_EQ(decoded_simply(stream), wanted);
}

TEST(Lzf, compressed_data_is_restored_in_pieces_of_any_size) {
  Prng prng(3);
  for (const std::uint64_t values : {1U, 2U, 7U, 256U})
    for (const std::size_t bytes : {0U, 1U, 2U, 3U, 31U, 32U, 33U, 264U, 265U, 8'192U, 8'193U, 41'000U, 300'000U}) {
      const std::string text = noise(bytes, values, prng);
      const std::string stream = lzf_compress(text);
      EXPECT_LE(stream.size(), bytes + bytes / 32 + 1);
      if (values == 1 && bytes > 1'000) {
        EXPECT_LT(stream.size(), bytes / 80);
      }
      EXPECT_EQ(decoded_simply(stream), text);
      for (const std::size_t piece : {std::size_t{7}, std::size_t{4'096}, bytes + 1}) {
        const auto back = decoded(stream, bytes, piece);
        ASSERT_TRUE(back.ok()) << back.error().text.c_str();
        ASSERT_TRUE(back.value() == text) << values << " values, " << bytes << " bytes in pieces of " << piece;
      }
    }
}

TEST(Lzf, the_furthest_reference_is_8192_bytes_back) {
  Prng prng(4);
  const std::string first = noise(8'192, 256, prng);
  std::string stream;
  for (std::size_t at = 0; at < first.size(); at += 32) stream += '\x1F' + first.substr(at, 32);
  // The whole again 40 times, by copies of 256 + 8 bytes from 8192 back.
  std::size_t bytes = first.size();
  for (int i = 0; i < 40 * 31; ++i, bytes += 264) stream += "\xFF\xFF\xFF";
  const auto back = decoded(stream, bytes);
  ASSERT_TRUE(back.ok()) << back.error().text.c_str();
  for (std::size_t i = 0; i < bytes; ++i) ASSERT_EQ(back.value()[i], first[i % 8'192]) << i;
}

TEST(Lzf, streams_that_overrun_are_refused) {
  const auto why = [](const std::string& stream, std::size_t bytes) {
    const auto r = decoded(stream, bytes);
    return r ? std::string("accepted") : std::string(r.error().text.view());
  };
  EXPECT_NE(why(std::string("\x02"
                            "abc",
                            4),
                2)
                .find("more bytes than"),
            std::string::npos);
  EXPECT_NE(why(std::string("\x02"
                            "abc",
                            4),
                4)
                .find("fewer bytes than"),
            std::string::npos);
  EXPECT_NE(why(std::string("\x1F"
                            "abc",
                            4),
                32)
                .find("end within an item"),
            std::string::npos);
  EXPECT_NE(why(std::string("\x00"
                            "a\x20",
                            3),
                4)
                .find("end within an item"),
            std::string::npos);
  EXPECT_NE(why(std::string("\x00"
                            "a\xE0\x01",
                            4),
                12)
                .find("end within an item"),
            std::string::npos);
  EXPECT_NE(why(std::string("\x00"
                            "a\x20\x01",
                            4),
                4)
                .find("before their beginning"),
            std::string::npos);
  EXPECT_NE(why(std::string("\x3F\xFF", 2), 3).find("before their beginning"), std::string::npos);
  EXPECT_NE(why(std::string("\x00"
                            "a\xE0\xFF\x00",
                            5),
                100)
                .find("more bytes than"),
            std::string::npos);
  EXPECT_NE(why("", 1).find("fewer bytes than"), std::string::npos);
  EXPECT_EQ(why("", 0), "accepted");
}

}  // namespace
}  // namespace slabd::hal
