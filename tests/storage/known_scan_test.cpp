// SPDX-License-Identifier: Apache-2.0
//
// A scanner that repeats recorded scans: every attempt in the history is recognised by its points.
#include "tests/storage/store_fixture.h"

namespace slabd::storage {
namespace {

struct KnownScanTest : StoreTest {
  KnownScanTest() {
    open();
    (void)recover();
  }

  /// Accepts and records one scan; `take` identifies the recorded exposure.
  Status take_scan(std::int64_t slab, int station, int number, std::int64_t take, bool refuse_known = true) {
    accept(PlcCommand::scan, station, slab);
    Attempt a = attempt(slab, station, number);
    a.fingerprint = take;
    a.points_crc32c = static_cast<std::uint32_t>(7 * take);
    a.shape.points = 5'000'000;
    a.shape.finite = 4'900'000 + static_cast<std::uint64_t>(take);
    AcquiredJob job{a, static_cast<std::uint64_t>(take)};
    job.refuse_known = refuse_known;
    return try_apply(job);
  }
};

TEST_F(KnownScanTest, a_loop_of_72_scans_is_refused_from_its_second_round_on_also_after_a_restart) {
  constexpr int kLoop = 72;
  int taken = 0;
  for (std::int64_t slab = 1; slab <= 8; ++slab) {
    begin(slab);
    for (int station = 1; station <= 18; ++station, ++taken) {
      const Status status = take_scan(slab, station, 1, 1'000 + taken % kLoop);
      EXPECT_EQ(status.ok(), taken < kLoop) << "scan " << taken;
      if (!status.ok()) {
        EXPECT_EQ(status.error().code, Code::frame_incomplete);
      }
    }
    end(slab, Verdict::not_measured);
    if (slab == 5) {
      open();
      (void)recover();
    }
  }
  EXPECT_EQ(taken, 144);
}

TEST_F(KnownScanTest, a_refused_scan_is_kept_as_a_failed_attempt_and_the_earlier_slab_and_scan_are_named) {
  begin(1);
  ASSERT_TRUE(take_scan(1, 6, 1, 4711).ok());
  ASSERT_TRUE(take_scan(1, 7, 1, 4712).ok());
  const Status status = take_scan(1, 8, 1, 4711);
  ASSERT_FALSE(status.ok());
  EXPECT_EQ(status.error().text.view(),
            "station 8: the scanner gave the points that slab 1 station 6 had in scan 1; restart the scanner program");
  const auto line = recover();
  EXPECT_EQ(line->stations[7].phase, StationPhase::failed);
  EXPECT_EQ(line->stations[7].code, 303);
  EXPECT_EQ(line->stations[7].attempts, 1);
  EXPECT_EQ(line->stations[6].phase, StationPhase::acquired);
  // The station's next scan is a different one.
  EXPECT_TRUE(take_scan(1, 8, 2, 4713).ok());
}

TEST_F(KnownScanTest, the_same_attempt_recorded_again_is_itself) {
  begin(1);
  ASSERT_TRUE(take_scan(1, 6, 1, 4711).ok());
  cmd_seq_ = static_cast<std::uint16_t>(cmd_seq_ - 1);
  EXPECT_TRUE(take_scan(1, 6, 1, 4711).ok()) << "the answer to the first was lost";
}

TEST_F(KnownScanTest, an_emulated_line_may_repeat_its_scans) {
  begin(1);
  ASSERT_TRUE(take_scan(1, 6, 1, 4711).ok());
  EXPECT_TRUE(take_scan(1, 7, 1, 4711, false).ok());
}

}  // namespace
}  // namespace slabd::storage
