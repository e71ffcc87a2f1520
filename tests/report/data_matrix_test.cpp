// SPDX-License-Identifier: Apache-2.0
#include "report/data_matrix.h"

#include <dmtx.h>
#include <gtest/gtest.h>

#include <string>

namespace slabd::report {
namespace {

/// Reads the symbol as pixels with a quiet zone, black on white.
std::string read_again(const DataMatrix& symbol) {
  constexpr std::size_t kScale = 6;
  constexpr std::size_t kQuiet = 2;
  const std::size_t edge = (symbol.size + 2 * kQuiet) * kScale;
  std::vector<unsigned char> pixels(3 * edge * edge, 255);
  for (std::size_t y = 0; y < symbol.size * kScale; ++y)
    for (std::size_t x = 0; x < symbol.size * kScale; ++x)
      if (symbol.at(y / kScale, x / kScale))
        for (std::size_t c = 0; c < 3; ++c) pixels[3 * ((y + kQuiet * kScale) * edge + x + kQuiet * kScale) + c] = 0;
  DmtxImage* image = dmtxImageCreate(pixels.data(), static_cast<int>(edge), static_cast<int>(edge), DmtxPack24bppRGB);
  DmtxDecode* decoder = dmtxDecodeCreate(image, 1);
  std::string text;
  if (DmtxRegion* region = dmtxRegionFindNext(decoder, nullptr); region != nullptr) {
    if (DmtxMessage* message = dmtxDecodeMatrixRegion(decoder, region, DmtxUndefined); message != nullptr) {
      text.assign(reinterpret_cast<const char*>(message->output), static_cast<std::size_t>(message->outputIdx));
      dmtxMessageDestroy(&message);
    }
    dmtxRegionDestroy(&region);
  }
  dmtxDecodeDestroy(&decoder);
  dmtxImageDestroy(&image);
  return text;
}

TEST(DataMatrix, is_read_again) {
  for (const std::string text :
       {"A", "SLAB-0042", "CRTS3/5600-2026-000123", "0123456789ABCDEFGHIJKLMNOPQRSTUV", "~!\"#$%&'()"})
    EXPECT_EQ(read_again(data_matrix(text)), text);
}

TEST(DataMatrix, nothing_has_no_symbol) {
  EXPECT_EQ(data_matrix("").size, 0U);
  EXPECT_EQ(data_matrix(std::string(5'000, 'x')).size, 0U);
}

/// The finder: the left and the lower edge are dark, the upper and the right edge alternate (ISO/IEC 16022, 5.1).
TEST(DataMatrix, has_the_finder_pattern) {
  const DataMatrix symbol = data_matrix("SLAB-0042");
  ASSERT_GT(symbol.size, 0U);
  const std::size_t last = symbol.size - 1;
  for (std::size_t k = 0; k <= last; ++k) {
    EXPECT_TRUE(symbol.at(k, 0));
    EXPECT_TRUE(symbol.at(last, k));
    EXPECT_EQ(symbol.at(0, k), k % 2 == 0);
    EXPECT_EQ(symbol.at(k, last), k % 2 == 1);
  }
}

}  // namespace
}  // namespace slabd::report
