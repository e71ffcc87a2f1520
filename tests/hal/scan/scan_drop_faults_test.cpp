// SPDX-License-Identifier: Apache-2.0
//
// Faults around a drop directory: disks, permissions, clocks, replaced files, late answers.
#include <fcntl.h>
#include <sched.h>
#include <sys/mount.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include "hal/scan/drop_folders.h"
#include "hal/scan/scanner_ports.h"
#include "hal/system/spool.h"
#include "tests/hal/scan/scan_drop_fixture.h"

namespace slabd::hal {
namespace {

/// Runs `body` in a separate process, where mounts and users may change. Returns its exit status; 0 is good.
template <typename Body>
int in_own_process(Body body) {
  const pid_t child = fork();
  if (child == 0) _exit(body());
  int status = -1;
  waitpid(child, &status, 0);
  return WIFEXITED(status) ? WEXITSTATUS(status) : -1;
}

bool own_mounts() {
  return (unshare(CLONE_NEWNS) == 0 || unshare(CLONE_NEWUSER | CLONE_NEWNS) == 0) &&
         mount(nullptr, "/", nullptr, MS_REC | MS_PRIVATE, nullptr) == 0;
}

TEST_F(ScanDropTest, a_full_spool_disk_is_501_leaves_no_file_and_a_repeat_works_when_there_is_room) {
  EXPECT_EQ(in_own_process([this] {
              const std::string spool = folder_ / "spool";
              fs::create_directory(spool);
              if (!own_mounts() || mount("tmpfs", spool.c_str(), "tmpfs", 0, "size=200k") != 0) return 1;
              const auto full = acquire(request(), [this] { drop_scan("7-3.ply"); });
              if (full.ok() || full.error().code != Code::store_full) return 2;
              if (fs::exists(spool + "/1/04-1.ply") || fs::exists(spool + "/1/04-1.ply.part")) return 3;
              if (!names_in(inbox()).empty()) return 4;
              if (mount("tmpfs", spool.c_str(), "tmpfs", MS_REMOUNT, "size=10m") != 0) return 5;
              return acquire(request(4), [this] { drop_scan("7-4.ply"); }).ok() ? 0 : 6;
            }),
            0);
}

TEST_F(ScanDropTest, a_full_drop_disk_is_501_before_any_request) {
  EXPECT_EQ(in_own_process([this] {
              if (!own_mounts() || mount("tmpfs", drop().c_str(), "tmpfs", 0, "size=64k") != 0) return 1;
              open(false);
              {
                std::ofstream fill(drop() + "/fill", std::ios::binary);
                while (fill << std::string(4096, 'x') << std::flush) {
                }
              }
              const auto full = scanner_->acquire(request(3, 200), xyz_, cancel_, on_decoded_);
              if (full.ok() || full.error().code != Code::store_full) return 2;
              fs::remove(drop() + "/fill");
              const auto quiet = scanner_->acquire(request(4, 50), xyz_, cancel_, on_decoded_);
              return !quiet.ok() && quiet.error().code == Code::trigger_timeout ? 0 : 3;
            }),
            0);
}

TEST_F(ScanDropTest, folders_that_may_not_be_written_are_reported_offline_until_they_can) {
  constexpr auto kReadOnly = static_cast<fs::perms>(0555);
  fs::permissions(folder_.string(), static_cast<fs::perms>(0755));
  fs::permissions(drop(), static_cast<fs::perms>(0755));
  fs::permissions(request_file(), fs::perms::all);
  fs::permissions(stray(), fs::perms::all);
  fs::permissions(inbox(), kReadOnly);
  EXPECT_EQ(in_own_process([this] {
              if (geteuid() == 0 && setresuid(65'534, 65'534, 65'534) != 0) return 1;  // root may do everything
              const auto refused = scanner_->acquire(request(3, 200), xyz_, cancel_, on_decoded_);
              if (refused.ok() || refused.error().code != Code::scanner_offline) return 2;
              if (refused.error().text.view().find("inbox") == std::string_view::npos) return 3;
              return scanner_->online() ? 4 : 0;
            }),
            0);
  fs::permissions(inbox(), fs::perms::owner_all);
  EXPECT_TRUE(acquire(request(4), [this] { drop_scan("7-4.ply"); }).ok());
}

/// Trims until stray/ holds at most `bytes`.
void trim(const DropFolders& folders, std::uint64_t bytes) {
  DropFolders::StrayLimits limits;
  limits.bytes = bytes;
  DropFolders::TrimmedOnes trimmed;
  while (folders.trim_stray(limits, trimmed)) {
  }
}

TEST_F(ScanDropTest, oldest_file_set_aside_is_deleted_first_when_stray_is_full) {
  for (int i = 1; i <= 10; ++i) {
    const std::string name = "7-" + std::to_string(100 + i) + ".ply";
    drop_scan(name, static_cast<float>(i));
    // A scanner's clock that is a year ahead or behind does not change the order of age.
    const auto off = std::chrono::hours(24 * 365 * (i % 2 == 0 ? 1 : -1));
    fs::last_write_time(inbox(name), fs::file_time_type::clock::now() + off);
    wait_ms(15);  // the file system's clock has a coarse step
    scanner_->idle();
  }
  EXPECT_EQ(names_in(stray()).size(), 10U) << "2 GB have room for all of them";
  DropFolders folders{PathText(drop())};
  ASSERT_TRUE(folders.open().ok());
  const std::uint64_t one = fs::file_size(stray("7-110.ply"));
  trim(folders, 3 * one + one / 2);
  auto left = names_in(stray());
  std::sort(left.begin(), left.end());
  EXPECT_EQ(left, (std::vector<std::string>{"7-108.ply", "7-109.ply", "7-110.ply"}));
  trim(folders, 0);
  EXPECT_TRUE(names_in(stray()).empty());
}

TEST_F(ScanDropTest, folders_in_stray_count_and_are_deleted_with_their_content) {
  const std::string precious = drop() + "/precious";
  write_file(precious, "not in stray/");
  for (const char* name : {"first", "second"}) {
    fs::create_directories(stray(name) + "/a/b");
    write_file(stray(name) + "/a/preview.png", std::string(1'000, 'x'));
    write_file(stray(name) + "/a/b/scan.xml", std::string(500, 'x'));
    fs::create_symlink(precious, stray(name) + "/link");
    wait_ms(15);
  }
  DropFolders folders{PathText(drop())};
  ASSERT_TRUE(folders.open().ok());
  trim(folders, 2'000);
  EXPECT_EQ(names_in(stray()), std::vector<std::string>{"second"});
  trim(folders, 0);
  EXPECT_TRUE(names_in(stray()).empty());
  EXPECT_TRUE(fs::exists(precious));
}

TEST_F(ScanDropTest, small_files_without_end_do_not_fill_stray) {
  // A preview next to each scan, for months.
  for (int i = 0; i < 5'000; ++i) write_file(stray("preview-" + std::to_string(i) + ".png"), "x");
  DropFolders folders{PathText(drop())};
  ASSERT_TRUE(folders.open().ok());
  DropFolders::StrayLimits limits;
  limits.bytes = 1'000'000;
  DropFolders::TrimmedOnes trimmed;
  ASSERT_TRUE(folders.trim_stray(limits, trimmed));
  EXPECT_EQ(trimmed.size(), DropFolders::kTrimmedAtOnce) << "this number in one look, and no more";
  while (folders.trim_stray(limits, trimmed)) {
  }
  EXPECT_EQ(names_in(stray()).size(), limits.entries);
}

TEST_F(ScanDropTest, a_name_that_is_always_the_same_is_set_aside_each_time) {
  DropFolders folders{PathText(drop())};
  ASSERT_TRUE(folders.open().ok());
  for (int i = 0; i < 3'000; ++i) {
    write_file(inbox("export.log"), "x");
    ASSERT_TRUE(folders.set_aside("export.log")) << i;
  }
  EXPECT_EQ(names_in(stray()).size(), 3'000U);
}

TEST_F(ScanDropTest, a_scanner_that_exports_without_end_does_not_fill_the_disk) {
  // Sparse files of 1 GB: only their length counts.
  for (int i = 1; i <= 5; ++i) {
    const std::string name = "7-" + std::to_string(300 + i) + ".ply";
    write_file(drop() + "/part", "x");
    fs::resize_file(drop() + "/part", 900'000'000);
    fs::rename(drop() + "/part", inbox(name));
    wait_ms(15);
    scanner_->idle();
  }
  auto left = names_in(stray());
  std::sort(left.begin(), left.end());
  EXPECT_EQ(left, (std::vector<std::string>{"7-304.ply", "7-305.ply"}));
  EXPECT_EQ(scanner_->stray_files(), 5U) << "what was deleted was counted all the same";
}

std::vector<std::string> notes_of(ScannerPort& scanner) {
  std::vector<std::string> notes;
  for (ScannerText text; scanner.next_note(text);) notes.emplace_back(text.view());
  return notes;
}

TEST_F(ScanDropTest, every_file_that_is_moved_aside_or_deleted_is_one_line_and_counted) {
  ScanDropSettings settings;
  settings.drop_dir = PathText(drop());
  settings.stray_bytes_max = 2'500;
  scanner_ = std::move(make_scan_drop(settings, *clock_).value());
  scanner_->idle();
  for (int i = 1; i <= 4; ++i) {
    write_file(drop() + "/part", std::string(1'000, 'x'));
    fs::rename(drop() + "/part", inbox("7-" + std::to_string(400 + i) + ".ply"));
    wait_ms(15);
    scanner_->idle();
  }
  const std::vector<std::string> notes = notes_of(*scanner_);
  ASSERT_EQ(notes.size(), 6U) << "four moved, two deleted";
  EXPECT_EQ(notes[0], "inbox/7-401.ply was moved to stray/: its request is over or never was");
  EXPECT_EQ(notes[3],
            "stray/7-401.ply (1000 bytes) was deleted: stray/ held 3000 bytes, allowed are 2500, it was the oldest");
  EXPECT_EQ(notes[5].substr(0, 44), "stray/7-402.ply (1000 bytes) was deleted: st");
  EXPECT_EQ(scanner_->deleted().files, 2U);
  EXPECT_EQ(scanner_->deleted().bytes, 2'000U);
  EXPECT_EQ(scanner_->stray_files(), 4U);
}

TEST_F(ScanDropTest, a_flood_of_strays_is_thirty_lines_and_then_one_a_second) {
  for (int round = 0; round < 8; ++round) {
    for (int i = 0; i < 20; ++i) write_file(inbox("9-" + std::to_string(100 * round + i) + ".ply"), "x");
    scanner_->idle();
    scanner_->idle();
  }
  ASSERT_EQ(scanner_->stray_files(), 160U);
  const std::vector<std::string> notes = notes_of(*scanner_);
  EXPECT_GE(notes.size(), 30U);
  EXPECT_LE(notes.size(), 60U) << "one a second more, on a slow computer too";
}

TEST_F(ScanDropTest, trouble_is_visible_to_the_caller_and_cleared_when_it_is_over) {
  EXPECT_TRUE(scanner_->online());
  EXPECT_TRUE(scanner_->trouble().empty());
  fs::rename(drop(), drop() + ".away");
  scanner_->idle();
  EXPECT_FALSE(scanner_->online());
  EXPECT_NE(scanner_->trouble().view().find("the drop folder must exist"), std::string_view::npos);
  fs::rename(drop() + ".away", drop());
  scanner_->idle();
  EXPECT_TRUE(scanner_->online());
  EXPECT_TRUE(scanner_->trouble().empty());
}

TEST(HangWatch, a_call_that_does_not_return_is_reported_after_its_time_limit_and_not_before) {
  SteppedClock clock;
  HangWatch watch(clock);
  EXPECT_EQ(watch.hang().ns, 0);
  watch.enter(3 * kNsPerS);
  clock.now_ns += 3 * kNsPerS - 1;
  EXPECT_EQ(watch.hang().ns, 0);
  clock.now_ns += 1;
  EXPECT_EQ(watch.hang().ns, 3 * kNsPerS);
  EXPECT_EQ(watch.hang().place, HangWatch::Place::drop_folder);
  watch.enter(10 * kNsPerS, HangWatch::Place::spool);  // it returned and enters again
  EXPECT_EQ(watch.hang().ns, 0);
  clock.now_ns += 9 * kNsPerS;
  EXPECT_EQ(watch.hang().ns, 0);
  clock.now_ns += kNsPerS;
  EXPECT_EQ(watch.hang().ns, 10 * kNsPerS);
  EXPECT_EQ(watch.hang().place, HangWatch::Place::spool);
  watch.leave();
  clock.now_ns += 100 * kNsPerS;
  EXPECT_EQ(watch.hang().ns, 0);
}

TEST_F(ScanDropTest, a_disk_that_does_not_store_the_scan_is_reported_as_the_spool_and_not_as_a_share) {
  SteppedClock stepped;
  open_with(stepped);
  // A second name makes it a copy, and opening a pipe in its place blocks.
  fs::create_directories(folder_ / "spool/1");
  const std::string pipe = folder_ / "spool/1/04-1.ply.part";
  ASSERT_EQ(mkfifo(pipe.c_str(), 0600), 0);
  std::atomic<bool> points_are_there = false;
  on_decoded_ = [&](const AcquiredScan&) {
    stepped.now_ns += 9 * kNsPerS;  // reading took most of the time limit; the PLC does not wait another ten seconds
    points_are_there = true;
  };
  std::thread watcher([&] {
    ASSERT_TRUE(wait_until([&] { return points_are_there.load(); })) << "the scan was not read";
    const auto is_reported = [&] {
      if (scanner_->spool_hangs()) return true;
      wait_ms(20);
      stepped.now_ns += 100 * kNsPerMs;
      return false;
    };
    EXPECT_TRUE(wait_until(is_reported));
    EXPECT_TRUE(scanner_->hangs());
    // The first report contains the time limit, so it was not given earlier.
    static_assert(HangWatch::kStoreMin_ns == 2 * kNsPerS);
    EXPECT_EQ(scanner_->trouble().view(),
              "the spool has been storing a scan for 2 s; look at the disk of storage.spool_dir");
    std::ifstream(pipe).ignore(std::numeric_limits<std::streamsize>::max());
  });
  const auto result = acquire(request(), [&] {
    drop_scan("7-3.ply");
    fs::create_hard_link(inbox("7-3.ply"), folder_ / "kept.ply");
    step(stepped, 20);
    ASSERT_TRUE(wait_until([&] { return points_are_there.load(); })) << "the scan was not read";
  });
  watcher.join();
  ASSERT_FALSE(result.ok()) << "a pipe is not a disk";
  EXPECT_EQ(result.error().code, Code::journal_write);
  EXPECT_FALSE(scanner_->hangs());
}

TEST_F(ScanDropTest, whatever_time_the_scanners_computer_has_its_files_are_answers) {
  std::uint16_t seq = 10;
  for (const int years : {-25, -1, 0, 1, 74}) {
    const std::string name = "7-" + std::to_string(++seq) + ".xyz";  // a table: only an unchanged file counts as
                                                                     // complete
    const auto result = acquire(request(seq), [&] {
      const std::string temporary = drop() + "/skewed";
      ASSERT_TRUE(write_scan(temporary.c_str(), ScanFormat::xyz, points(), 0, 0).ok());
      fs::last_write_time(temporary, fs::file_time_type::clock::now() + std::chrono::hours(24 * 365 * years));
      fs::rename(temporary, inbox(name));
    });
    EXPECT_TRUE(result.ok()) << years << " years off: " << result.error().text.c_str();
  }
}

TEST_F(ScanDropTest, an_answer_replaced_by_another_file_is_read_as_one_or_the_other_and_never_as_both) {
  for (int round = 0; round < 20; ++round) {
    const auto seq = static_cast<std::uint16_t>(20 + round);
    const std::string name = "7-" + std::to_string(seq) + ".ply";
    const auto result = acquire(request(seq), [&] {
      drop_scan(name, 5.0F);
      for (int i = 0; i < 5; ++i) {
        const std::string temporary = drop() + "/again";
        ASSERT_TRUE(write_ply(temporary.c_str(), points(6.0F), 0, 0).ok());
        if (::access(inbox(name).c_str(), F_OK) == 0) fs::rename(temporary, inbox(name));
      }
    });
    if (!result.ok()) {
      EXPECT_EQ(result.error().code, Code::frame_incomplete) << result.error().text.c_str();
    } else {
      std::vector<float> spooled(xyz_.size());
      ASSERT_TRUE(read_scan(result.value().path.c_str(), LengthUnit::mm, std::span<float>(spooled)).ok());
      EXPECT_EQ(std::memcmp(spooled.data(), xyz_.data(), 12 * kPoints), 0) << "what was decoded is what is kept";
      const float z = xyz_[2];
      for (std::size_t p = 0; p < kPoints; ++p) ASSERT_EQ(xyz_[3 * p + 2], z) << p;
    }
    scanner_->idle();
  }
}

TEST_F(ScanDropTest, an_answer_that_is_removed_before_it_is_in_the_spool_is_not_a_disk_fault) {
  const std::string answer = inbox() + "/7-3.ply";
  std::ofstream(answer) << "points";
  const int file = ::open(answer.c_str(), O_RDONLY);
  const int folder = ::open(inbox().c_str(), O_RDONLY | O_DIRECTORY);
  fs::remove(answer);
  const Status moved = spool_file(file, folder, "7-3.ply", PathText(folder_ / "spool/1/04-1.ply"));
  ::close(folder);
  ::close(file);
  ASSERT_FALSE(moved.ok());
  EXPECT_EQ(moved.error().code, Code::frame_incomplete);
  EXPECT_NE(moved.error().text.view().find("was removed"), std::string_view::npos) << moved.error().text.view();
  EXPECT_FALSE(fs::exists(folder_ / "spool/1/04-1.ply"));
}

TEST_F(ScanDropTest, no_scan_in_the_spool_is_overwritten_and_the_new_one_is_not_lost) {
  const fs::path spooled = folder_ / "spool/1/04-1.ply";
  fs::create_directories(spooled.parent_path());
  for (const bool linked : {false, true}) {  // moved, and copied
    std::ofstream(spooled) << "of an earlier slab";
    const std::string answer = inbox() + "/7-3.ply";
    std::ofstream(answer) << "points";
    if (linked) fs::create_hard_link(answer, folder_ / "second-name");
    const int file = ::open(answer.c_str(), O_RDONLY);
    const int folder = ::open(inbox().c_str(), O_RDONLY | O_DIRECTORY);
    const Status moved = spool_file(file, folder, "7-3.ply", PathText(spooled.native()));
    ::close(folder);
    ::close(file);
    ASSERT_FALSE(moved.ok());
    EXPECT_EQ(moved.error().code, Code::journal_write);
    EXPECT_NE(moved.error().text.view().find("04-1.ply: this scan exists already"), std::string_view::npos)
        << moved.error().text.view();
    EXPECT_EQ(fs::file_size(spooled), 18U);
    EXPECT_TRUE(fs::exists(answer));
    EXPECT_FALSE(fs::exists(spooled.native() + ".part"));
  }
}

TEST_F(ScanDropAnyNameTest, the_late_answer_to_an_abandoned_request_is_never_used_for_the_next_one) {
  const auto none = acquire(request(3, 60), [] {});
  ASSERT_FALSE(none.ok());
  EXPECT_EQ(none.error().code, Code::trigger_timeout);
  std::thread scanner_that_was_slow([&] {
    wait_ms(100);
    drop_scan("late.ply", 9.0F);
  });
  const auto next = acquire(request(4), [&] { drop_scan("fresh.ply", 5.0F); });
  scanner_that_was_slow.join();
  ASSERT_TRUE(next.ok()) << next.error().text.c_str();
  EXPECT_EQ(xyz_[2], 5.0F);
  EXPECT_TRUE(fs::exists(stray("late.ply")));
}

TEST_F(ScanDropAnyNameTest, an_answer_that_is_still_written_at_the_deadline_ends_the_wait_when_it_is_whole) {
  SteppedClock stepped;
  open_with(stepped, true);
  const std::string whole = folder_ / "whole.ply";
  ASSERT_TRUE(write_ply(whole.c_str(), points(9.0F), 0, 0).ok());
  const auto cut = acquire(request(3, 2'000), [&] {
    fs::copy_file(whole, drop() + "/short");
    fs::resize_file(drop() + "/short", 1'000);
    fs::rename(drop() + "/short", inbox("late.ply"));
    step(stepped, 2'000);
  });
  ASSERT_FALSE(cut.ok());
  EXPECT_EQ(cut.error().code, Code::frame_incomplete);
  std::thread scanner_that_is_slow([&] {
    step(stepped, 300);
    std::ifstream rest(whole, std::ios::binary);
    rest.seekg(1000);
    std::ofstream(inbox("late.ply"), std::ios::binary | std::ios::app) << rest.rdbuf() << std::flush;
    step(stepped, 600);
  });
  // The clock advances less than the wait for an answer that never comes.
  const auto next = acquire(request(4, 8'000), [&] {
    drop_scan("fresh.ply", 5.0F);
    step(stepped, 600);
  });
  scanner_that_is_slow.join();
  ASSERT_TRUE(next.ok()) << next.error().text.c_str();
  EXPECT_EQ(xyz_[2], 5.0F);
  EXPECT_TRUE(fs::exists(stray("late.ply")));
}

TEST_F(ScanDropAnyNameTest, no_scan_is_requested_while_a_late_answer_may_come) {
  const auto none = acquire(request(3, 60), [] {});
  ASSERT_FALSE(none.ok());
  const auto next = acquire(request(4, 200), [] { ADD_FAILURE() << "asked for another scan"; });
  ASSERT_FALSE(next.ok());
  EXPECT_EQ(next.error().code, Code::trigger_timeout);
  EXPECT_NE(next.error().text.view().find("may still arrive"), std::string_view::npos) << next.error().text.view();
}

}  // namespace
}  // namespace slabd::hal
