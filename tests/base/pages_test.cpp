// SPDX-License-Identifier: Apache-2.0
#include "base/pages.h"

#include <gtest/gtest.h>
#include <sys/mman.h>
#include <unistd.h>

#include <algorithm>
#include <cstdint>
#include <fstream>
#include <numeric>
#include <string>
#include <vector>

namespace slabd {
namespace {

constexpr std::size_t kHugePage = std::size_t{2} << 20U;

/// Kilobytes of the mapping at `address` in huge pages; -1 if the kernel does not report it.
long huge_kb(const void* address) {
  std::ifstream smaps("/proc/self/smaps");
  bool here = false;
  for (std::string line; std::getline(smaps, line);) {
    unsigned long begin = 0;
    unsigned long end = 0;
    if (std::sscanf(line.c_str(), "%lx-%lx ", &begin, &end) == 2) {
      const auto at = reinterpret_cast<std::uintptr_t>(address);
      here = begin <= at && at < end;
    }
    long kb = 0;
    if (here && std::sscanf(line.c_str(), "AnonHugePages: %ld kB", &kb) == 1) return kb;
  }
  return -1;
}

TEST(Pages, hand_out_zeroed_arrays_that_do_not_overlap) {
  Pages pages(limits::array_bytes(1'000'001, sizeof(float)) + limits::array_bytes(3, 1) +
              limits::array_bytes(5'000, sizeof(std::uint32_t)));
  const std::span<float> a = pages.take<float>(1'000'001);
  const std::span<std::uint8_t> b = pages.take<std::uint8_t>(3);
  const std::span<std::uint32_t> c = pages.take<std::uint32_t>(5'000);
  for (const void* begin : {static_cast<void*>(a.data()), static_cast<void*>(b.data()), static_cast<void*>(c.data())})
    EXPECT_EQ(reinterpret_cast<std::uintptr_t>(begin) % limits::kArrayAlignment, 0U);
  EXPECT_EQ(a.size(), 1'000'001U);
  EXPECT_TRUE(std::all_of(a.begin(), a.end(), [](float v) { return v == 0.0F; }));
  std::fill(a.begin(), a.end(), 1.0F);
  std::fill(b.begin(), b.end(), std::uint8_t{2});
  std::iota(c.begin(), c.end(), 3U);
  EXPECT_EQ(std::count(a.begin(), a.end(), 1.0F), 1'000'001);
  EXPECT_EQ(b[2], 2);
  EXPECT_EQ(c[0], 3U);
  EXPECT_EQ(c[4'999], 5'002U);
}

TEST(Pages, are_resident_from_the_start_and_no_larger_than_asked_for) {
  constexpr std::size_t kBytes = 7 * kHugePage + 100'000;
  Pages pages(kBytes);
  const std::span<std::byte> all = pages.take<std::byte>(kBytes - kBytes % limits::kArrayAlignment);
  const auto page = static_cast<std::size_t>(sysconf(_SC_PAGESIZE));
  std::vector<unsigned char> resident((all.size() + page - 1) / page);
  ASSERT_EQ(mincore(all.data(), all.size(), resident.data()), 0);
  EXPECT_EQ(std::count_if(resident.begin(), resident.end(), [](unsigned char r) { return (r & 1U) != 0; }),
            static_cast<long>(resident.size()));
#if !defined(__SANITIZE_ADDRESS__)
  EXPECT_LT(pages.bytes(), kBytes + page);
#endif
}

TEST(Pages, are_huge_where_the_system_has_huge_pages) {
  std::string setting;
  std::getline(std::ifstream("/sys/kernel/mm/transparent_hugepage/enabled"), setting);
  const bool offered = setting.find("[always]") != std::string::npos || setting.find("[madvise]") != std::string::npos;
  Pages pages(8 * kHugePage);
  const std::span<std::byte> all = pages.take<std::byte>(8 * kHugePage);
  EXPECT_EQ(reinterpret_cast<std::uintptr_t>(all.data()) % kHugePage, 0U);
  // With fragmented memory the kernel may have no huge pages to offer, so the test requires only that the mapping
  // works.
  if (offered) {
    EXPECT_GE(huge_kb(all.data()), 0);
    RecordProperty("huge_kb", std::to_string(huge_kb(all.data())));
  }
}

TEST(PagesDeathTest, more_than_the_sum_of_the_limits_ends_the_process) {
  Pages pages(4'096);
  EXPECT_EQ(pages.take<float>(512).size(), 512U);
  EXPECT_DEATH(static_cast<void>(pages.take<float>(513)), "limits.h");
}

}  // namespace
}  // namespace slabd
