// SPDX-License-Identifier: Apache-2.0
//
// The process ends while a view is taken. Views are not journalled, so the scanner may return it for a block.
#include <gtest/gtest.h>

#include "tests/daemon/station/station_line.h"

namespace slabd::daemon {
namespace {

struct UnseenView : testing::Test {
  MemoryStore store;
  Line line{store};

  void SetUp() override { ask(CaptureRequest::Action::begin); }
  void ask(CaptureRequest::Action action) {
    CaptureRequest request;
    request.session = "spring";
    request.operator_name = "anna";
    request.lease_s = 60;
    request.action = action;
    line.feed(request);
    line.run_for(2'500);
  }
  void shoot(std::uint64_t fingerprint) {
    line.fingerprint = fingerprint;
    ask(CaptureRequest::Action::shoot);
  }
  /// Starts a new process and a slab.
  void die() {
    line.start();
    line.scanner_answers = true;
    line.plc.command_writer = 0;
    line.run_for(300);
    line.command(PlcCommand::slab_begin);
    line.run_for(20);
  }
  /// Breaks `job` and all later jobs of its kind.
  void break_disk_at(int job, bool (*is_kind)(const SeenScanJob&)) {
    store.fail_when = [job, is_kind, count = 0](const StoreJob& what) mutable {
      const auto* seen = std::get_if<SeenScanJob>(&what.what);
      return seen != nullptr && is_kind(*seen) && ++count >= job;
    };
  }
};

bool is_mark(const SeenScanJob& job) {
  return job.fingerprint == kUnseenScan;
}
bool is_scan(const SeenScanJob& job) {
  return !is_mark(job);
}
bool is_any(const SeenScanJob&) {
  return true;
}

TEST_F(UnseenView, is_not_requested_before_its_request_is_durable) {
  line.disk_answers = false;
  shoot(0x0F01);
  EXPECT_TRUE(line.scans.empty()) << "the mark is on its way";
  line.disk_answers = true;
  die();
  line.fingerprint = 0x0F03;
  line.scan(4);
  ASSERT_EQ(line.measured.size(), 1U);
  EXPECT_EQ(line.view().acq_seq, line.plc.cmd_seq);
}

TEST_F(UnseenView, is_refused_when_the_disk_cannot_take_its_mark) {
  break_disk_at(1, is_mark);
  shoot(0x0F01);
  EXPECT_TRUE(line.scans.empty());
  EXPECT_EQ(line.station->capture.shot.code, Code::journal_write);
}

TEST_F(UnseenView, stays_marked_when_the_scanner_gives_an_old_scan_in_its_place) {
  shoot(0x0E01);
  EXPECT_EQ(store.seen.back(), 0x0E01U);
  break_disk_at(2, is_mark);
  shoot(0x0E01);  // an old file; the exposure for the view is still to come
  EXPECT_EQ(store.seen.back(), kUnseenScan);
}

TEST_F(UnseenView, stays_marked_until_the_scan_that_was_given_for_it_is_durable) {
  break_disk_at(1, is_scan);
  shoot(0x0E01);
  shoot(0x0E03);
  ASSERT_EQ(line.scans.size(), 2U);
  EXPECT_EQ(store.seen.back(), kUnseenScan);
  // The disk works again for one job, and then the process dies.
  break_disk_at(2, is_any);
  ++line.plc.sync_req;
  line.feed(line.plc);
  line.run_for(40);
  store.fail_when = {};
  die();
  line.fingerprint = 0x0E03;
  line.scan(4);  // the view's points again
  ASSERT_GT(line.scans.size(), 2U);
  EXPECT_TRUE(line.scans[2].request.session == 0 || line.view().cmd_status == failed(Code::frame_incomplete));
  EXPECT_TRUE(line.measured.empty()) << "the view is measured as block 4";
}

}  // namespace
}  // namespace slabd::daemon
