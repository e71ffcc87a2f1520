// SPDX-License-Identifier: Apache-2.0
//
// Checks the memory ledger of docs/ARCHITECTURE.md ("Who allocates, and when") with a real daemon. Each line is a
// figure of base/limits.h or daemon/seal.h, and the resident memory of that name does not exceed it. The sum of the
// lines matches the total in base/limits.h.
#include <gtest/gtest.h>
#include <unistd.h>

#include <array>
#include <cmath>
#include <fstream>
#include <sstream>

#include "base/limits.h"
#include "daemon/seal.h"
#include "processes.h"
#include "tests/places/places.h"
#include "tests/places/wait.h"

namespace slabd::line {
namespace {

/// One line of the ledger. "program and libraries" are pages of files: with a page that slabd needs the kernel also
/// maps its neighbours that are in the page cache, so that the same daemon has 10.2 to 11.2 MB of them. That line
/// therefore has a reserve; the other lines are memory that slabd itself has taken.
struct Entry {
  const char* who;
  std::size_t bytes_max;
};
constexpr std::size_t kScans = limits::kScanSlots * limits::kScanSlotBytes;
constexpr std::size_t kPageBytes = 4'096;
constexpr std::array<Entry, 5> kLedger{{
    {"scan buffers", kScans},
    {"workspace of measuring", limits::kWorkspaceBytes},
    {"program and libraries", 14'000'000},
    {"stacks in use", 2'500'000},
    {"all the rest", 8'400'000},
}};
enum Line : std::size_t { scans, workspace, program, stacks, rest };

using Resident = std::array<std::size_t, kLedger.size()>;

std::size_t total(const Resident& resident) {
  std::size_t bytes = 0;
  for (const std::size_t line : resident) bytes += line;
  return bytes;
}

/// Resident memory by its name in the ledger. Large pieces are identified by their sizes, which are all different.
Resident resident_of(pid_t pid) {
  Resident resident{};
  std::ifstream smaps("/proc/" + std::to_string(pid) + "/smaps");
  std::string text;
  std::string name;
  std::size_t bytes = 0;
  const auto is = [&bytes](std::size_t wanted) { return bytes >= wanted && bytes < wanted + kPageBytes; };
  while (std::getline(smaps, text)) {
    std::istringstream words(text);
    std::string first;
    words >> first;
    std::size_t kb = 0;
    if (first == "Size:") {
      words >> kb;
      bytes = 1024 * kb;
    } else if (first == "Rss:") {
      words >> kb;
      const Line line = is(kScans)                                           ? scans
                        : is(limits::kWorkspaceBytes)                        ? workspace
                        : name.starts_with("/")                              ? program
                        : name == "[stack]" || is(daemon::kThreadStackBytes) ? stacks
                                                                             : rest;
      resident[line] += 1024 * kb;
    } else if (first.find('-') != std::string::npos && first.find(':') == std::string::npos) {
      std::string ignored;
      words >> ignored >> ignored >> ignored >> ignored;
      name.clear();
      words >> name;
    }
  }
  return resident;
}

class LedgerLine : public testing::Test {
 protected:
  void TearDown() override {
    if (HasFailure()) std::fprintf(stderr, "---- slabd ----\n%s", box_.log().c_str());
  }
  void compare(const char* when) const {
    const Resident resident = resident_of(box_.pid());
    std::printf("%-14s", when);
    for (std::size_t i = 0; i < kLedger.size(); ++i) {
      EXPECT_LE(resident[i], kLedger[i].bytes_max + kPageBytes) << when << ": " << kLedger[i].who;
      std::printf("  %s %.1f of %.1f MB", kLedger[i].who, static_cast<double>(resident[i]) / 1e6,
                  static_cast<double>(kLedger[i].bytes_max) / 1e6);
    }
    std::printf("  together %.1f MB\n", static_cast<double>(total(resident)) / 1e6);
    EXPECT_GE(resident[scans], kScans) << "there from the start";
    EXPECT_GE(resident[workspace], limits::kWorkspaceBytes) << "there from the start";
    EXPECT_LE(total(resident), limits::kInspectionBytes + limits::kProcessBytes) << when;
  }
  /// Starts the daemon and waits until the loop runs, because only the loop reports figures.
  void start(const std::vector<std::string>& more) {
    box_.start(more);
    ASSERT_TRUE(box_.ready());
    const auto has_figures = [this] {
      return !box_.running() || box_.slabctl({"metrics", "--config", box_.config.native()}).exit_status == 0;
    };
    ASSERT_TRUE(places::wait_until(has_figures, std::chrono::minutes(5))) << "slabd reports no figures\n" << box_.log();
  }
  void inspect_a_slab(const char* number) {
    const Box::Answer slab = box_.slabctl(
        {"simulate", "--config", box_.config.native(), "--points", "quarter", "--slab-no", number, "--seed", number});
    ASSERT_EQ(slab.exit_status, 0) << slab.out << slab.err;
  }
  Box box_;
};

TEST(Ledger, adds_up_to_what_is_promised) {
  std::size_t sum = 0;
  for (const Entry& entry : kLedger) sum += entry.bytes_max;
  EXPECT_LE(sum, limits::kInspectionBytes + limits::kProcessBytes);
  // 160 MB with one scan in flight, 72 MB for every further one.
  EXPECT_LE(sum, 160'000'000 + (limits::kScanSlots - 1) * 72'000'000);
}

TEST(Ledger, is_in_the_architecture_page_with_these_figures) {
  const std::string page = read_file(fs::path(places::source_dir()) / "docs/ARCHITECTURE.md");
  for (const Entry& entry : kLedger) {
    std::array<char, 100> line{};
    std::snprintf(line.data(), line.size(), "| %s | %.1f MB |", entry.who, static_cast<double>(entry.bytes_max) / 1e6);
    EXPECT_NE(page.find(line.data()), std::string::npos) << line.data();
  }
}

TEST_F(LedgerLine, holds_at_the_start_and_after_slabs_answers_and_a_backup) {
  start({});
  compare("at the start");
  inspect_a_slab("1");
  compare("after a slab");
  EXPECT_EQ(box_.slabctl({"db", "backup", "--config", box_.config.native()}).exit_status, 0);
  for (const char* verb : {"status", "metrics"})
    EXPECT_EQ(box_.slabctl({verb, "--config", box_.config.native()}).exit_status, 0);
  compare("after a backup");
  EXPECT_EQ(box_.stop(), 0);
}

TEST_F(LedgerLine, a_sealed_daemon_with_every_page_of_it_resident_is_within_the_promise_too) {
  start({"--seal"});
  inspect_a_slab("1");
  const std::size_t bytes = total(resident_of(box_.pid()));
  std::printf("sealed: %.1f MB\n", static_cast<double>(bytes) / 1e6);
  EXPECT_GE(bytes, limits::kInspectionBytes);
  EXPECT_LE(bytes, 160'000'000 + (limits::kScanSlots - 1) * 72'000'000);
  EXPECT_EQ(box_.stop(), 0);
}

}  // namespace
}  // namespace slabd::line
