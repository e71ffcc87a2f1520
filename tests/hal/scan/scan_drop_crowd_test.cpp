// SPDX-License-Identifier: Apache-2.0
//
// A drop directory that is used by others too: thousands of files, files of PCL's writer, a second daemon.
#include <fcntl.h>
#include <sys/file.h>
#include <sys/stat.h>
#include <unistd.h>

#include "tests/hal/scan/scan_drop_fixture.h"

namespace slabd::hal {
namespace {

std::vector<std::string> notes_of(ScannerPort& scanner) {
  std::vector<std::string> notes;
  for (ScannerText text; scanner.next_note(text);) notes.emplace_back(text.view());
  return notes;
}

bool any_holds(const std::vector<std::string>& lines, const std::string& part) {
  return std::any_of(lines.begin(), lines.end(),
                     [&part](const std::string& line) { return line.find(part) != std::string::npos; });
}

// ---- thousands of files

TEST_F(ScanDropTest, thousands_of_strays_are_moved_counted_and_no_scan_is_lost) {
  constexpr std::size_t kStrays = 5'000;
  for (std::size_t i = 0; i < kStrays; ++i) write_file(inbox("9-" + std::to_string(i) + ".ply"), "x");
  const auto first = acquire(request(3), [this] { drop_scan("7-3.ply", 2.0F); });
  ASSERT_TRUE(first.ok()) << first.error().text.c_str();
  EXPECT_EQ(xyz_[2], 2.0F);
  const auto is_emptied = [&] {
    scanner_->idle();
    return names_in(inbox()).empty();
  };
  ASSERT_TRUE(wait_until(is_emptied, std::chrono::minutes(2)))
      << names_in(inbox()).size() << " files stay in the inbox";
  scanner_->idle();
  EXPECT_EQ(scanner_->stray_files(), kStrays);
  const auto second = acquire(request(4), [this] { drop_scan("7-4.ply", 3.0F); });
  ASSERT_TRUE(second.ok()) << second.error().text.c_str();
  EXPECT_EQ(xyz_[2], 3.0F);
  const std::vector<std::string> notes = notes_of(*scanner_);
  ASSERT_FALSE(notes.empty());
  EXPECT_EQ(notes[0].substr(0, 48), "inbox/ is no longer crowded: 5000 files that ans")
      << "the newest word on it, first";
  // Files deleted from stray/ for lack of space are counted too.
  EXPECT_EQ(names_in(stray()).size() + scanner_->deleted().files, kStrays);
}

/// Files that one look may move under TickingClock: those watched individually, and one for each of ten milliseconds.
constexpr std::size_t kInboxLook = 32 + 11;

TEST_F(ScanDropTest, one_look_at_a_crowd_is_bounded_and_makes_progress) {
  const TickingClock ticking;
  open_with(ticking);
  constexpr std::size_t kStrays = 400;
  for (std::size_t i = 0; i < kStrays; ++i) write_file(inbox("9-" + std::to_string(i) + ".ply"), "x");
  std::size_t looks = 0;
  for (std::size_t left = kStrays; left > 0; ++looks) {
    scanner_->idle();
    const std::size_t now = names_in(inbox()).size();
    EXPECT_LT(now, left) << "progress";
    EXPECT_GE(now + kInboxLook, left) << "bounded work";
    left = now;
  }
  EXPECT_GT(looks, kStrays / kInboxLook);
}

TEST_F(ScanDropTest, a_file_being_written_among_many_others_is_not_removed) {
  for (int i = 0; i < 300; ++i) write_file(inbox("preview-" + std::to_string(i) + ".png"), "x");
  scanner_->idle();
  EXPECT_EQ(names_in(inbox()).size(), 300U) << "all of them may still be written";
  const auto begin_ns = clock_->mono_ns();
  std::ofstream growing(inbox("preview-7.png"), std::ios::binary | std::ios::app);
  const auto only_growing_is_left = [&] {
    growing << "more" << std::flush;
    wait_ms(20);
    scanner_->idle();
    return names_in(inbox()).size() == 1;
  };
  ASSERT_TRUE(wait_until(only_growing_is_left)) << names_in(inbox()).size() << " files stay in the inbox";
  EXPECT_GE(clock_->mono_ns() - begin_ns, 4 * kNsPerS);
  EXPECT_EQ(names_in(inbox()), std::vector<std::string>{"preview-7.png"});
  EXPECT_EQ(scanner_->stray_files(), 299U);
  scanner_->idle();
  // On a slow computer a look moves only a part; the crowd is gone when no more than the watched 32 files are left.
  const std::vector<std::string> notes = notes_of(*scanner_);
  bool said = false;
  for (int moved = 300 - 32; moved <= 299 && !said; ++moved)
    said = any_holds(notes, "inbox/ is no longer crowded: " + std::to_string(moved) + " files");
  EXPECT_TRUE(said);
}

// ---- PCL's writer

/// Extends the file to a memory page plus its data, then fills the beginning, as PCL does; the header is not counted.
void write_as_pcl_does(const std::string& path, const std::string& whole) {
  const std::size_t header = whole.find("DATA ");
  const std::size_t data = whole.find('\n', header) + 1;
  const int fd = ::open(path.c_str(), O_RDWR | O_CREAT | O_TRUNC | O_CLOEXEC, 0644);
  ASSERT_GE(fd, 0);
  const auto last = static_cast<off_t>(4'096 + whole.size() - data - 1);
  ASSERT_EQ(pwrite(fd, "", 1, last), 1);
  ASSERT_EQ(pwrite(fd, whole.data(), whole.size(), 0), static_cast<ssize_t>(whole.size()));
  ::close(fd);
}

TEST_F(ScanDropTest, files_of_pcls_writer_are_answers_and_taken_without_waiting) {
  std::uint16_t seq = 3;
  for (const ScanFormat format : {ScanFormat::pcd, ScanFormat::pcd_compressed}) {
    ASSERT_TRUE(write_scan((drop() + "/whole").c_str(), format, points(), 0, 0).ok());
    const std::string whole = read_file(drop() + "/whole");
    // With the ticking clock: a file that is complete according to its header needs two looks, not half a second.
    TickingClock ticking;
    open_with(ticking);
    const std::string name = "7-" + std::to_string(seq);
    const auto result = acquire(request(seq++), [&] {
      write_as_pcl_does(drop() + "/stretched", whole);
      fs::rename(drop() + "/stretched", inbox(name + ".pcd"));
    });
    ASSERT_TRUE(result.ok()) << result.error().text.c_str();
    EXPECT_EQ(result.value().shape.finite, kPoints);
    EXPECT_EQ(xyz_[3 * 100], 100.0F);
    std::vector<float> again(xyz_.size());
    EXPECT_TRUE(read_scan(result.value().path.c_str(), LengthUnit::mm, again).ok());
    EXPECT_EQ(fs::file_size(result.value().path.c_str()),
              4'096 + whole.size() - whole.find('\n', whole.find("DATA ")) - 1);
  }
}

TEST_F(ScanDropTest, a_hole_behind_the_data_does_not_count_as_a_hole_in_the_data) {
  ASSERT_TRUE(write_scan((drop() + "/whole").c_str(), ScanFormat::pcd, points(), 0, 0).ok());
  const std::string whole = read_file(drop() + "/whole");
  const TickingClock ticking;
  open_with(ticking, true);  // a file of any name must be unchanged for some time and have no holes
  std::int64_t begin_ns = 0;
  const auto result = acquire(request(), [&] {
    write_file(drop() + "/stretched", whole);
    fs::resize_file(drop() + "/stretched", whole.size() + 60'000);
    begin_ns = ticking.mono_ns();
    fs::rename(drop() + "/stretched", inbox("scan.pcd"));
  });
  ASSERT_TRUE(result.ok()) << result.error().text.c_str();
  EXPECT_LT(ticking.mono_ns() - begin_ns, 5 * kNsPerS) << "as long as a file with a hole is waited for";
}

TEST_F(ScanDropTest, bytes_behind_the_data_that_are_not_zeros_are_303_and_counted) {
  ASSERT_TRUE(write_scan((drop() + "/whole").c_str(), ScanFormat::pcd, points(), 0, 0).ok());
  const std::string whole = read_file(drop() + "/whole");
  const auto result = acquire(request(), [&] {
    write_file(drop() + "/more", whole + std::string(99, '\0') + "x");
    fs::rename(drop() + "/more", inbox("7-3.pcd"));
  });
  ASSERT_FALSE(result.ok());
  EXPECT_EQ(result.error().code, Code::frame_incomplete);
  EXPECT_NE(result.error().text.view().find("100 bytes too many"), std::string_view::npos)
      << result.error().text.c_str();
}

// ---- one daemon at a time

TEST(FolderLock, is_exclusive_and_names_its_holder_to_the_second) {
  const TemporaryFolder folder;
  const std::string path = folder.string();
  {
    FolderLock first("slabd, process 11 on hall-3, configuration /etc/slabd/a.toml");
    ASSERT_EQ(first.take(path.c_str()), FolderLock::State::ours) << first.text().c_str();
    EXPECT_EQ(first.take(path.c_str()), FolderLock::State::ours) << "again";
    EXPECT_EQ(read_file(folder / ".slabd.lock"), "slabd, process 11 on hall-3, configuration /etc/slabd/a.toml\n");
    FolderLock second("slabd, process 12");
    EXPECT_EQ(second.take(path.c_str()), FolderLock::State::anothers);
    EXPECT_EQ(second.text().view(), "slabd, process 11 on hall-3, configuration /etc/slabd/a.toml");
    EXPECT_EQ(read_file(folder / ".slabd.lock").substr(0, 17), "slabd, process 11") << "not written over";
  }
  FolderLock third("slabd, process 13");
  EXPECT_EQ(third.take(path.c_str()), FolderLock::State::ours) << "the kernel gave it back";
  EXPECT_EQ(read_file(folder / ".slabd.lock"), "slabd, process 13\n");
}

TEST(FolderLock, a_lock_file_that_was_deleted_is_made_and_locked_again) {
  const TemporaryFolder folder;
  FolderLock first("first");
  ASSERT_EQ(first.take(folder.string().c_str()), FolderLock::State::ours);
  fs::remove(folder / ".slabd.lock");
  EXPECT_EQ(first.take(folder.string().c_str()), FolderLock::State::ours);
  FolderLock second("second");
  EXPECT_EQ(second.take(folder.string().c_str()), FolderLock::State::anothers);
}

TEST(FolderLock, failure_to_lock_is_reported_with_its_reason) {
  const TemporaryFolder folder;
  FolderLock lock("first");
  EXPECT_EQ(lock.take((folder.string() + "/not-there").c_str()), FolderLock::State::cannot);
  EXPECT_NE(lock.text().view().find("No such file"), std::string_view::npos) << lock.text().c_str();
  fs::create_symlink("nowhere", folder / ".slabd.lock");
  EXPECT_EQ(lock.take(folder.string().c_str()), FolderLock::State::cannot);
  EXPECT_NE(lock.text().view().find(".slabd.lock cannot be opened"), std::string_view::npos) << lock.text().c_str();
  fs::remove(folder / ".slabd.lock");
  // A lock owner's name with control characters is not written to a terminal.
  write_file(folder / ".slabd.lock", "evil\x1b[2J\nmore");
  const int fd = ::open((folder / ".slabd.lock").c_str(), O_RDONLY | O_CLOEXEC);
  ASSERT_EQ(flock(fd, LOCK_EX | LOCK_NB), 0);
  EXPECT_EQ(lock.take(folder.string().c_str()), FolderLock::State::anothers);
  EXPECT_EQ(lock.text().view(), "evil?[2J");
  ::close(fd);
}

class ScanDropLockTest : public ScanDropTest {
 protected:
  std::unique_ptr<ScannerPort> daemon(const char* owner) const {
    ScanDropSettings settings;
    settings.drop_dir = PathText(drop());
    settings.owner = owner;
    auto made = make_scan_drop(settings, *clock_);
    EXPECT_TRUE(made.ok());
    made.value()->idle();
    return std::move(made.value());
  }
};

TEST_F(ScanDropLockTest, the_second_daemon_changes_no_file_and_continues_when_the_first_has_ended) {
  scanner_ = daemon("the first");
  EXPECT_TRUE(scanner_->online());
  EXPECT_TRUE(scanner_->used_by_another().empty());
  const auto second = daemon("the second");
  EXPECT_FALSE(second->online());
  EXPECT_EQ(std::string(second->used_by_another().view()),
            drop() + " is used by another daemon (the first): one at a time may");
  EXPECT_EQ(second->trouble(), second->used_by_another().view());

  const auto scan = acquire(request(3), [&] {
    // The second daemon does not withdraw requests or move answers.
    second->idle();
    const auto refused = second->acquire(request(9), xyz_, cancel_, on_decoded_);
    EXPECT_FALSE(refused.ok());
    if (!refused.ok()) {
      EXPECT_EQ(refused.error().code, Code::scanner_offline);
    }
    EXPECT_TRUE(fs::exists(request_file("7-3.json")));
    drop_scan("7-3.ply");
  });
  EXPECT_TRUE(scan.ok()) << scan.error().text.c_str();
  EXPECT_EQ(second->stray_files(), 0U);

  scanner_.reset();
  second->idle();
  EXPECT_TRUE(second->online());
  EXPECT_TRUE(second->used_by_another().empty());
}

TEST_F(ScanDropLockTest, a_folder_that_cannot_be_locked_is_used_and_noted_in_one_line) {
  fs::create_symlink("nowhere", drop() + "/.slabd.lock");
  scanner_ = daemon("the first");
  EXPECT_TRUE(scanner_->online());
  const auto scan = acquire(request(3), [&] { drop_scan("7-3.ply"); });
  EXPECT_TRUE(scan.ok());
  scanner_->idle();
  const std::vector<std::string> notes = notes_of(*scanner_);
  ASSERT_EQ(notes.size(), 1U);
  EXPECT_NE(notes[0].find("cannot be locked"), std::string::npos) << notes[0];
}

}  // namespace
}  // namespace slabd::hal
