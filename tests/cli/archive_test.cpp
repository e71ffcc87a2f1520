// SPDX-License-Identifier: Apache-2.0
//
// slabctl archive on a stored slab: scans are packed, checked, restored, and measured again from the archive after the
// originals were deleted.
#include <sys/stat.h>

#include <cstdlib>
#include <nlohmann/json.hpp>

#include "tests/cli/stored_slab.h"
#include "tests/places/places.h"

namespace slabd::cli {
namespace {

using nlohmann::json;

struct Archive : StoredSlab {
  void SetUp() override {
    begin();
    measure(3);
    measure(4);
    end();
    fs::create_directories(file("archive"));
  }
  [[nodiscard]] Ended archive(const std::string& more) const {
    return run("archive " + more + " --db " + db() + " --out " + file("archive"));
  }
  [[nodiscard]] std::string packed(int station) const {
    return file("archive/1/" + fs::path(scan(station)).filename().string() + ".slabz");
  }
  [[nodiscard]] Ended replay() const {
    return run("replay 1 --verify --db " + db() + " --recipes " + places::source_dir() + "/recipes --scans " +
               file("archive"));
  }
  /// Output of inspect without the path in the first line and the times.
  [[nodiscard]] std::string inspected(const std::string& path) const {
    const std::string out = run("inspect " + path + " --recipe " + kRecipe + " --block 3").out;
    const std::size_t begin = out.find('\n');
    const std::size_t end = out.find("block 3: ", begin);
    EXPECT_NE(end, std::string::npos) << out;
    return out.substr(begin, end - begin);
  }
  static void change_byte(const std::string& path, std::size_t at) {
    std::string bytes = content(path);
    bytes[at] = static_cast<char>(bytes[at] ^ 0x10);
    std::ofstream(path, std::ios::binary) << bytes;
  }
};

TEST_F(Archive, scans_are_measured_again_from_the_archive_after_the_originals_were_deleted) {
  const std::string original = content(scan(3));
  const Ended ended = archive("SLAB-0042");
  ASSERT_EQ(ended.status, 0) << ended.out << ended.err;
  expect_mentions(ended.out, "03-1.ply");
  expect_mentions(ended.out, "packed 2; ");
  EXPECT_LT(fs::file_size(packed(3)) * 2, original.size());
  EXPECT_EQ(fs::last_write_time(packed(3)), fs::last_write_time(scan(3)));
  EXPECT_EQ(content(scan(3)), original) << "nothing is deleted or changed";

  fs::remove_all(file("spool/1"));
  const Ended replayed = replay();
  EXPECT_EQ(replayed.status, 0) << replayed.out << replayed.err;
  expect_mentions(replayed.out, "identical: 2 of 2 scans measured again");
  expect_mentions(replayed.out, "2 of 2 scans are proven by their checksum");

  const Ended unpacked = run("archive --unpack " + packed(3) + " --out " + file("."));
  EXPECT_EQ(unpacked.status, 0) << unpacked.err;
  EXPECT_TRUE(content(file("03-1.ply")) == original);
  EXPECT_EQ(inspected(packed(3)), inspected(file("03-1.ply")));
  const Ended cloud = run("export cloud 1 --db " + db() + " --recipes " + places::source_dir() + "/recipes --scans " +
                          file("archive") + " --voxel 5 --out " + file("cloud.ply"));
  EXPECT_EQ(cloud.status, 0) << cloud.err;
}

TEST_F(Archive, an_archive_beside_the_scan_is_found_without_an_option) {
  ASSERT_EQ(archive("1").status, 0);
  for (const int station : {3, 4}) {
    fs::remove(scan(station));
    fs::rename(packed(station), scan(station) + ".slabz");
  }
  EXPECT_EQ(replay().status, 0);
}

TEST_F(Archive, a_second_run_packs_nothing_and_a_changed_scan_does_not_replace_its_archive) {
  ASSERT_EQ(archive("1").status, 0);
  const std::string first = content(packed(3));
  const Ended again = archive("--all");
  EXPECT_EQ(again.status, 0) << again.err;
  EXPECT_EQ(again.out.find("03-1.ply"), std::string::npos) << again.out;
  expect_mentions(again.out, "there 2; ");
  // A scan that was only written again.
  const std::string original = content(scan(3));
  std::ofstream(scan(3), std::ios::binary) << original;
  expect_mentions(archive("1").out, "there 2; ");
  EXPECT_EQ(fs::last_write_time(packed(3)), fs::last_write_time(scan(3)));
  // Another scan under the same name.
  change_byte(scan(3), original.size() / 2);
  fs::last_write_time(scan(3), fs::file_time_type::clock::now() + std::chrono::hours(1));
  const Ended other = archive("1");
  EXPECT_EQ(other.status, 3) << other.out;
  expect_mentions(other.err, packed(3) + " holds another file");
  EXPECT_TRUE(content(packed(3)) == first);
}

TEST_F(Archive, a_scan_that_was_changed_after_it_was_measured_is_reported) {
  change_byte(scan(4), fs::file_size(scan(4)) / 2);
  for (const char* counts : {"packed 1, changed 1; ", "there 1, changed 1; ", "there 1, changed 1; "}) {
    const Ended ended = archive("1");
    EXPECT_EQ(ended.status, 1);
    expect_mentions(ended.out, counts);
    expect_mentions(ended.err, "the points are not those that were measured: crc32c ");
  }
}

TEST_F(Archive, a_scan_that_is_gone_counts_only_if_its_slab_was_named) {
  fs::remove(scan(3));
  EXPECT_EQ(archive("1").status, 1);
  EXPECT_EQ(archive("--all").status, 0);
  // Packed before, then deleted: it is there.
  fs::remove(scan(4));
  const Ended ended = archive("--all");
  expect_mentions(ended.out, "there 1, gone 1; ");
  // The only copy is cut off: its last bytes are missing, then nearly all.
  for (const std::uintmax_t kept : {fs::file_size(packed(4)) - 1, std::uintmax_t{20}}) {
    fs::resize_file(packed(4), kept);
    const Ended damaged = archive("--all");
    EXPECT_EQ(damaged.status, 3) << kept;
    expect_mentions(damaged.out, "gone 1, refused 1; ");
    expect_mentions(damaged.err, packed(4) + ": byte ");
  }
}

/// Extends the scan of station 3 to a gigabyte less than what is free on the disk, without using space. It is larger
/// than any file that is packed, so that it is refused for its size if the space is not the reason.
struct ArchiveOnAFullDisk : Archive {
  void SetUp() override {
    Archive::SetUp();
    if (fs::space(dir_).available < 4'000'000'000) GTEST_SKIP() << "the disk is full already";
    if (!resize()) GTEST_SKIP() << "the file system has no files of that size";
  }
  /// The scan leaves a gigabyte of what is free now.
  [[nodiscard]] bool resize() const {
    std::error_code fault;
    fs::resize_file(scan(3), fs::space(dir_).available - 1'000'000'000, fault);
    return !fault;
  }
};

TEST_F(ArchiveOnAFullDisk, the_space_that_slabd_needs_is_left) {
  Ended ended = archive("1");
  // Other programs may have made room meanwhile: the scan is then refused for its size.
  for (int i = 0; i < 5 && ended.status == 3 && resize(); ++i) ended = archive("1");
  EXPECT_EQ(ended.status, 4) << ended.out << ended.err;
  expect_mentions(ended.err, "--out " + file("archive") + ": a scan of ");
  expect_mentions(ended.err, " MB, with 2500.0 MB left for slabd on the same disk, needs ");
  expect_mentions(ended.err, " MB are free");
  EXPECT_TRUE(fs::is_empty(file("archive")));
}

TEST_F(ArchiveOnAFullDisk, another_disk_may_be_filled) {
  std::string other = "/dev/shm/slabctl-test-XXXXXX";
  if (mkdtemp(other.data()) == nullptr) GTEST_SKIP() << "no second file system: /dev/shm cannot be written";
  struct stat here {};
  struct stat there {};
  const bool differs = ::stat(file("archive").c_str(), &here) == 0 && ::stat(other.c_str(), &there) == 0 &&
                       here.st_dev != there.st_dev && fs::space(dir_).capacity != fs::space(other).capacity;
  const Ended ended = run("archive 1 --db " + db() + " --out " + other);
  fs::remove_all(other);
  if (!differs) GTEST_SKIP() << "no second file system: /dev/shm has the one of the test";
  EXPECT_EQ(ended.status, 3) << ended.out << ended.err;
  expect_mentions(ended.out, "packed 1, refused 1; ");
}

TEST_F(Archive, a_damaged_archive_is_named_by_byte) {
  ASSERT_EQ(archive("1").status, 0);
  EXPECT_EQ(run("archive --check " + packed(3) + " " + packed(4)).status, 0);
  change_byte(packed(4), 5'000);
  const Ended checked = run("archive --check " + packed(3) + " " + packed(4));
  EXPECT_EQ(checked.status, 3);
  expect_mentions(checked.out, "whole 1, refused 1; ");
  expect_mentions(checked.err, packed(4) + ": byte ");
  expect_mentions(checked.err, ": damaged between here and byte ");
  EXPECT_EQ(run("archive --unpack " + packed(4) + " --out " + file(".")).status, 3);
  EXPECT_FALSE(fs::exists(file("04-1.ply"))) << "no part of a damaged scan is left";
  fs::remove_all(file("spool/1"));
  const Ended replayed = replay();
  EXPECT_EQ(replayed.status, 1);
  expect_mentions(replayed.out, "block 4 attempt 1: differs: " + packed(4) + ": byte ");
}

TEST_F(Archive, nothing_is_written_over_another_file_or_into_the_spool) {
  ASSERT_EQ(archive("1").status, 0);
  const std::string mine = write("03-1.ply", "mine");
  const Ended ended = run("archive --unpack " + packed(3) + " --out " + file("."));
  EXPECT_EQ(ended.status, 3);
  EXPECT_EQ(content(mine), "mine");
  const Ended spool = run("archive 1 --db " + db() + " --out " + file("spool"));
  EXPECT_EQ(spool.status, 3);
  expect_mentions(spool.err, "it holds the scans themselves");
  EXPECT_FALSE(fs::exists(scan(3) + ".slabz"));
}

TEST_F(Archive, wrong_calls_are_refused) {
  EXPECT_EQ(archive("").status, 2);
  EXPECT_EQ(run("archive 1 --db " + db()).status, 2) << "no --out";
  EXPECT_EQ(archive("1 --check " + scan(3)).status, 2);
  EXPECT_EQ(run("archive --check a --unpack b --out " + file(".")).status, 2);
  EXPECT_EQ(run("archive 1 --db " + db() + " --out " + file("missing")).status, 4);
  EXPECT_FALSE(fs::exists(file("missing"))) << "a share that is not mounted";
  EXPECT_EQ(run("archive --check " + scan(3)).status, 3) << "not an archive";
}

TEST_F(Archive, json_has_every_scan_and_matches_its_schema) {
  const Ended ended = archive("1 --json");
  ASSERT_EQ(ended.status, 0) << ended.err;
  const json document = json::parse(ended.out, nullptr, false);
  ASSERT_EQ(document["scans"].size(), 2U);
  const json& first = document["scans"][0];
  EXPECT_EQ(first["state"], "packed");
  EXPECT_EQ(first["station"], 3);
  EXPECT_EQ(first["bytes"], fs::file_size(scan(3)));
  EXPECT_EQ(first["packed_bytes"], fs::file_size(packed(3)));
  EXPECT_EQ(first["crc32c_stored"], first["crc32c_now"]);
  EXPECT_GT(document["ratio"], 2.0);
  const std::string packing = write("archive.json", ended.out);
  const Ended checked = run("archive --check " + packed(3) + " " + scan(4) + " --json");
  const std::string documents = packing + " " + write("check.json", checked.out);
  const std::string validate = "/usr/bin/python3 " + places::source_dir() + "/tests/cli/validate_json.py ";
  EXPECT_EQ(std::system((validate + places::source_dir() + "/docs/schemas " + documents).c_str()), 0);
}

}  // namespace
}  // namespace slabd::cli
