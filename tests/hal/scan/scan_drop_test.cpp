// SPDX-License-Identifier: Apache-2.0
#include <sys/stat.h>

#include "tests/hal/scan/scan_drop_fixture.h"

namespace slabd::hal {
namespace {

TEST_F(ScanDropTest, an_answer_is_decoded_and_stored_in_the_spool) {
  std::string request_text;
  const auto before_ns = clock_->mono_ns();
  const auto result = acquire(request(), [&] {
    request_text = read_file(request_file("7-3.json"));
    drop_scan("7-3.ply");
  });
  ASSERT_TRUE(result.ok()) << result.error().text.c_str();
  const AcquiredScan& scan = result.value();
  EXPECT_EQ(request_text,
            "{\"schema\": \"slabd.scan_request/1\", \"session\": 7, \"cmd_seq\": 3, \"slab_id\": \"S-1\", "
            "\"station\": 4}\n");
  EXPECT_EQ(scan.shape.points, kPoints);
  EXPECT_EQ(scan.shape.finite, kPoints);
  EXPECT_EQ(scan.path, folder_ / "spool/1/04-1.ply");
  EXPECT_GE(scan.taken_mono_ns, before_ns);
  EXPECT_LE(scan.taken_mono_ns, clock_->mono_ns());
  EXPECT_NEAR(static_cast<double>(scan.taken_utime_us), static_cast<double>(clock_->utime_us()), 60e6);
  EXPECT_EQ(xyz_[3 * 100], 100.0F);
  std::vector<float> again(xyz_.size());
  EXPECT_TRUE(read_scan(scan.path.c_str(), LengthUnit::mm, again).ok());
  EXPECT_TRUE(names_in(inbox()).empty());
  EXPECT_TRUE(names_in(stray()).empty());
  EXPECT_EQ(scanner_->stray_files(), 0U);
}

TEST_F(ScanDropTest, a_request_of_a_line_with_several_scanners_names_its_robot_and_scanner) {
  ScanRequest to_right = request();
  to_right.by = {PartId("2"), PartId("right")};
  std::string request_text;
  ASSERT_TRUE(acquire(to_right, [&] {
                request_text = read_file(request_file("7-3.json"));
                drop_scan("7-3.ply");
              }).ok());
  EXPECT_EQ(request_text,
            "{\"schema\": \"slabd.scan_request/1\", \"session\": 7, \"cmd_seq\": 3, \"slab_id\": \"S-1\", "
            "\"station\": 4, \"scanner\": \"right\", \"robot\": \"2\"}\n");
}

TEST_F(ScanDropTest, two_scanners_have_a_folder_and_a_lock_each) {
  ScanDropSettings other;
  other.drop_dir = PathText(folder_ / "drop-2");
  other.make_drop_dir = true;
  other.owner = "the same daemon";
  auto second = make_scan_drop(other, *clock_);
  ASSERT_TRUE(second.ok()) << second.error().text.c_str();
  second.value()->idle();
  EXPECT_TRUE(second.value()->online()) << second.value()->trouble().c_str();
  EXPECT_TRUE(second.value()->used_by_another().empty());
  EXPECT_TRUE(fs::exists(folder_ / "drop-2/request"));
  const auto result = acquire(request(), [&] { drop_scan("7-3.ply"); });
  EXPECT_TRUE(result.ok()) << result.error().text.c_str();
  second.value()->idle();
  EXPECT_EQ(second.value()->stray_files(), 0U) << "the answer was not for it";
}

TEST_F(ScanDropTest, the_points_are_there_before_the_scan_is_durable) {
  int told = 0;
  on_decoded_ = [&](const AcquiredScan& scan) {
    ++told;
    EXPECT_EQ(scan.shape.finite, kPoints);
    EXPECT_EQ(scan.path, folder_ / "spool/1/04-1.ply");
    const std::vector<float> sent = points();
    EXPECT_TRUE(std::equal(sent.begin(), sent.end(), xyz_.begin()));
    expect_nothing_spooled();
  };
  const auto result = acquire(request(), [&] { drop_scan("7-3.ply"); });
  ASSERT_TRUE(result.ok()) << result.error().text.c_str();
  EXPECT_EQ(told, 1);
}

TEST_F(ScanDropTest, decoded_points_are_not_announced_without_points) {
  int told = 0;
  on_decoded_ = [&](const AcquiredScan&) { ++told; };
  const auto result = acquire(request(), [&] { write_file(inbox("7-3.e57"), "ASTM-E57"); });
  EXPECT_FALSE(result.ok());
  EXPECT_EQ(told, 0);
}

TEST_F(ScanDropTest, a_slab_id_of_any_bytes_makes_valid_json) {
  ScanRequest r = request();
  r.slab_id = SlabId(std::string_view("a\"b\\c\n\xC3\x7F", 8));
  std::string text;
  static_cast<void>(acquire(r, [&] {
    text = read_file(request_file("7-3.json"));
    cancel_ = true;
  }));
  EXPECT_NE(text.find(R"("slab_id": "a\u0022b\u005cc\u000a\u00c3\u007f", "station")"), std::string::npos) << text;
}

TEST_F(ScanDropTest, a_file_that_existed_before_its_request_is_not_the_answer) {
  drop_scan("7-3.ply", 1.0F);
  const auto result = acquire(request(), [&] {
    EXPECT_TRUE(fs::exists(stray("7-3.ply")));
    drop_scan("7-3.ply", 2.0F);
  });
  ASSERT_TRUE(result.ok()) << result.error().text.c_str();
  EXPECT_EQ(xyz_[2], 2.0F);
  EXPECT_EQ(scanner_->stray_files(), 1U);
}

TEST_F(ScanDropTest, answers_to_other_requests_go_to_stray_at_once) {
  const auto result = acquire(request(), [&] {
    drop_scan("7-2.ply", 1.0F);
    drop_scan("6-3.ply", 1.0F);
    drop_scan("07-3.ply", 1.0F);
    ASSERT_TRUE(wait_until([&] { return names_in(stray()).size() == 3; })) << names_in(stray()).size() << " strays";
    drop_scan("7-3.ply", 2.0F);
  });
  ASSERT_TRUE(result.ok()) << result.error().text.c_str();
  EXPECT_EQ(xyz_[2], 2.0F);
  EXPECT_EQ(scanner_->stray_files(), 3U);
}

TEST_F(ScanDropTest, a_late_answer_is_moved_to_stray_between_scans) {
  const auto result = acquire(request(3, 60), [] {});
  ASSERT_FALSE(result.ok());
  EXPECT_EQ(result.error().code, Code::trigger_timeout);
  drop_scan("7-3.ply");
  scanner_->idle();
  EXPECT_TRUE(names_in(inbox()).empty());
  EXPECT_TRUE(fs::exists(stray("7-3.ply")));
  EXPECT_EQ(scanner_->stray_files(), 1U);
  expect_nothing_spooled();
}

TEST_F(ScanDropTest, strays_of_one_name_are_all_kept) {
  for (int i = 0; i < 3; ++i) {
    drop_scan("7-9.ply", static_cast<float>(i));
    scanner_->idle();
  }
  EXPECT_EQ(names_in(stray()).size(), 3U);
  EXPECT_TRUE(fs::exists(stray("7-9.ply")));
  EXPECT_TRUE(fs::exists(stray("7-9.ply.1")));
  EXPECT_TRUE(fs::exists(stray("7-9.ply.2")));
  EXPECT_EQ(scanner_->stray_files(), 3U);
}

TEST_F(ScanDropTest, unfinished_files_are_kept_and_abandoned_ones_are_moved) {
  write_file(inbox("7-3.ply.part"), "half a scan");
  write_file(inbox("readme"), "?");
  const auto begin_ns = clock_->mono_ns();
  scanner_->idle();
  EXPECT_EQ(names_in(inbox()).size(), 2U) << "another program may be writing";
  const auto is_emptied = [&] {
    scanner_->idle();
    return names_in(inbox()).empty();
  };
  ASSERT_TRUE(wait_until(is_emptied)) << names_in(inbox()).front() << " stays in the inbox";
  EXPECT_GE(clock_->mono_ns() - begin_ns, 5 * kNsPerS);
  EXPECT_EQ(scanner_->stray_files(), 2U);
}

TEST_F(ScanDropTest, a_torn_answer_is_303_and_a_good_repeat_works) {
  SteppedClock stepped;
  open_with(stepped);
  const auto torn = acquire(request(3, 2'000), [&] {
    drop_scan("t");
    fs::resize_file(inbox("t"), fs::file_size(inbox("t")) - 1);
    fs::rename(inbox("t"), inbox("7-3.ply"));
    step(stepped, 2'000);
  });
  ASSERT_FALSE(torn.ok());
  EXPECT_EQ(torn.error().code, Code::frame_incomplete);
  EXPECT_TRUE(names_in(inbox()).empty());
  EXPECT_TRUE(fs::exists(stray("7-3.ply")));
  expect_nothing_spooled();
  const auto repeat = acquire(request(4), [&] {
    drop_scan("7-4.ply");
    step(stepped, 20);
  });
  EXPECT_TRUE(repeat.ok()) << repeat.error().text.c_str();
}

TEST_F(ScanDropTest, an_empty_scan_is_401) {
  const auto result = acquire(request(), [&] {
    std::vector<float> nothing(3 * kPoints, std::numeric_limits<float>::quiet_NaN());
    nothing[0] = nothing[1] = nothing[2] = 1.0F;
    ASSERT_TRUE(write_ply((drop() + "/w.ply").c_str(), nothing, 0, 0).ok());
    fs::rename(drop() + "/w.ply", inbox("7-3.ply"));
  });
  ASSERT_FALSE(result.ok());
  EXPECT_EQ(result.error().code, Code::too_few_points);
  expect_nothing_spooled();
  EXPECT_TRUE(fs::exists(stray("7-3.ply")));
}

TEST_F(ScanDropTest, links_and_folders_are_not_answers_and_are_never_followed) {
  ASSERT_TRUE(write_ply((folder_ / "outside.ply").c_str(), points(), 0, 0).ok());
  const auto link = acquire(request(), [&] { fs::create_symlink(folder_ / "outside.ply", inbox("7-3.ply")); });
  ASSERT_FALSE(link.ok());
  EXPECT_EQ(link.error().code, Code::frame_incomplete);
  EXPECT_TRUE(fs::is_symlink(stray("7-3.ply"))) << "the link itself was moved";
  EXPECT_TRUE(fs::exists(folder_ / "outside.ply"));
  const auto directory = acquire(request(4), [&] { fs::create_directory(inbox("7-4.ply")); });
  ASSERT_FALSE(directory.ok());
  EXPECT_EQ(directory.error().code, Code::frame_incomplete);
  expect_nothing_spooled();
}

TEST_F(ScanDropTest, an_unknown_format_is_named) {
  const auto result = acquire(request(), [&] { write_file(inbox("7-3.e57"), "ASTM-E57"); });
  ASSERT_FALSE(result.ok());
  EXPECT_EQ(result.error().code, Code::frame_incomplete);
  EXPECT_NE(result.error().text.view().find("\"e57\""), std::string_view::npos);
  EXPECT_NE(result.error().text.view().find(".ply, .pcd, .xyz, .asc, .txt, .csv"), std::string_view::npos);
}

TEST_F(ScanDropTest, a_scan_being_written_under_its_number_is_not_the_answer_yet) {
  for (const std::string temporary : {"7-3.part", "7-3.ply.tmp", "7-3"}) {
    const auto result = acquire(request(), [&] {
      write_file(inbox(temporary), "half");
      wait_ms(100);
      ASSERT_TRUE(write_ply(inbox(temporary).c_str(), points(), 0, 0).ok());
      fs::rename(inbox(temporary), inbox("7-3.ply"));
    });
    EXPECT_TRUE(result.ok()) << temporary << ": " << result.error().text.c_str();
  }
  EXPECT_EQ(scanner_->stray_files(), 0U);
}

TEST_F(ScanDropTest, answers_in_every_format_are_read_and_keep_their_extension) {
  std::uint16_t seq = 10;
  for (const ScanFormat format : kScanFormats) {
    const std::string file = "7-" + std::to_string(++seq) + "." + std::string(extension(format));
    const auto result = acquire(request(seq), [&] { drop_scan_as(format, file); });
    ASSERT_TRUE(result.ok()) << name(format) << ": " << result.error().text.c_str();
    EXPECT_EQ(result.value().shape.finite, kPoints);
    EXPECT_EQ(result.value().path, folder_ / "spool/1/04-1." + std::string(extension(format)));
    EXPECT_EQ(xyz_[3 * 100], 100.0F) << name(format);
  }
  const auto upper = acquire(request(30), [&] { drop_scan_as(ScanFormat::xyz, "7-30.ASC"); });
  ASSERT_TRUE(upper.ok()) << upper.error().text.c_str();
  EXPECT_EQ(upper.value().path, folder_ / "spool/1/04-1.asc");
  EXPECT_EQ(scanner_->stray_files(), 0U);
}

TEST_F(ScanDropTest, the_columns_of_the_line_are_those_of_its_tables_and_of_no_other_file) {
  ScanForm form;
  form.columns = parse_table_columns("PosX,PosY,PosZ").value();
  open_with(*clock_, false, form);
  const auto drop_table = [&] {
    std::ofstream table(drop() + "/writing.csv");
    table << "n,PosX,PosY,PosZ\n";
    for (std::size_t i = 0; i < kPoints; ++i) table << i << ',' << i << ",1,5\n";
    table.close();
    fs::rename(drop() + "/writing.csv", inbox("7-3.csv"));
  };
  const auto table = acquire(request(), drop_table);
  ASSERT_TRUE(table.ok()) << table.error().text.c_str();
  EXPECT_EQ(table.value().shape.finite, kPoints);
  EXPECT_EQ(xyz_[3 * 100], 100.0F);
  EXPECT_EQ(xyz_[3 * 100 + 2], 5.0F);
  const auto binary = acquire(request(4), [&] { drop_scan_as(ScanFormat::ply, "7-4.ply"); });
  ASSERT_TRUE(binary.ok()) << binary.error().text.c_str();
}

TEST_F(ScanDropTest, complete_binary_is_read_after_two_looks_and_text_when_it_has_stopped_growing) {
  SteppedClock stepped;
  open_with(stepped);
  for (const ScanFormat format : {ScanFormat::ply, ScanFormat::ply_be, ScanFormat::pcd, ScanFormat::pcd_compressed}) {
    const std::string file = "7-3." + std::string(extension(format));
    const std::int64_t dropped_ns = stepped.now_ns;
    const auto result = acquire(request(), [&] {
      drop_scan_as(format, file);
      ASSERT_TRUE(stepped.let_look(100)) << "the port does not look at its inbox";
      EXPECT_TRUE(fs::exists(inbox(file))) << name(format) << ": its time may not have stepped on yet";
      stepped.now_ns += 20 * kNsPerMs;
    });
    ASSERT_TRUE(result.ok()) << name(format) << ": " << result.error().text.c_str();
    EXPECT_EQ(result.value().taken_mono_ns, dropped_ns);
  }
  for (const ScanFormat format : {ScanFormat::ply_ascii, ScanFormat::pcd_ascii, ScanFormat::xyz, ScanFormat::csv}) {
    const std::string file = "7-3." + std::string(extension(format));
    const std::int64_t dropped_ns = stepped.now_ns;
    const auto result = acquire(request(), [&] {
      drop_scan_as(format, file);
      ASSERT_TRUE(stepped.let_look(200)) << "the port does not look at its inbox";  // ten looks at the inbox
      EXPECT_TRUE(fs::exists(inbox(file))) << name(format) << " was taken before it had stood still";
      stepped.now_ns += 500 * kNsPerMs;
    });
    ASSERT_TRUE(result.ok()) << name(format) << ": " << result.error().text.c_str();
    EXPECT_EQ(result.value().taken_mono_ns, dropped_ns) << "the exposure ended when the file was there";
  }
}

TEST_F(ScanDropTest, a_file_that_grows_under_its_own_name_is_waited_for) {
  SteppedClock stepped;
  open_with(stepped);
  for (const ScanFormat format :
       {ScanFormat::ply, ScanFormat::ply_ascii, ScanFormat::pcd_compressed, ScanFormat::pcd_ascii, ScanFormat::xyz}) {
    const auto result =
        acquire(request(), [&] { write_slowly(stepped, format, "7-3." + std::string(extension(format)), 4, 100); });
    ASSERT_TRUE(result.ok()) << name(format) << ": " << result.error().text.c_str();
    EXPECT_EQ(result.value().shape.finite, kPoints) << name(format);
  }
  EXPECT_EQ(scanner_->stray_files(), 0U);
}

TEST_F(ScanDropTest, a_file_that_stays_short_of_its_header_is_303_in_every_format_that_has_one) {
  SteppedClock stepped;
  open_with(stepped);
  std::uint64_t strays = 0;
  for (const ScanFormat format : kScanFormats) {
    if (format == ScanFormat::xyz || format == ScanFormat::csv) continue;
    const std::string file = "7-3." + std::string(extension(format));
    const auto result = acquire(request(), [&] {
      drop_scan_as(format, "t");
      fs::resize_file(inbox("t"), fs::file_size(inbox("t")) / 2);
      fs::rename(inbox("t"), inbox(file));
      ASSERT_TRUE(stepped.let_look(60)) << "the port does not look at its inbox";
      stepped.now_ns += 4'900 * kNsPerMs;
      ASSERT_TRUE(stepped.let_look(60)) << "the port does not look at its inbox";
      EXPECT_TRUE(fs::exists(inbox(file))) << name(format) << ": its writer may only pause";
      stepped.now_ns += 100 * kNsPerMs;
    });
    ASSERT_FALSE(result.ok()) << name(format);
    EXPECT_EQ(result.error().code, Code::frame_incomplete) << name(format);
    EXPECT_TRUE(names_in(inbox()).empty());
    EXPECT_EQ(scanner_->stray_files(), ++strays);
    expect_nothing_spooled();
  }
}

TEST_F(ScanDropTest, a_writer_may_pause_in_what_certainly_lacks_something) {
  SteppedClock stepped;
  open_with(stepped);
  std::uint16_t seq = 10;
  for (const ScanFormat format : {ScanFormat::ply, ScanFormat::pcd_compressed}) {
    const std::string file = "7-" + std::to_string(++seq) + "." + std::string(extension(format));
    const auto result = acquire(request(seq), [&] { write_slowly(stepped, format, file, 2, 900); });
    ASSERT_TRUE(result.ok()) << name(format) << ": " << result.error().text.c_str();
    EXPECT_EQ(result.value().shape.finite, kPoints);
  }
  // A table that is created at first and written after the scan is computed.
  const auto table = acquire(request(20), [&] {
    write_file(inbox("7-20.xyz"), "");
    step(stepped, 900);
    ASSERT_TRUE(stepped.let_look(60)) << "the port does not look at its inbox";
    write_slowly(stepped, ScanFormat::xyz, "7-20.xyz", 1, 0);
  });
  ASSERT_TRUE(table.ok()) << table.error().text.c_str();
  EXPECT_EQ(table.value().shape.finite, kPoints);
  EXPECT_EQ(scanner_->stray_files(), 0U);
}

TEST_F(ScanDropTest, an_incomplete_file_at_the_timeout_is_303_and_the_error_names_the_missing_part) {
  SteppedClock stepped;
  open_with(stepped);
  const auto cut = acquire(request(3, 2'000), [&] {
    drop_scan_as(ScanFormat::ply, "t");
    fs::resize_file(inbox("t"), 1'000);
    fs::rename(inbox("t"), inbox("7-3.ply"));
    step(stepped, 2'000);
  });
  ASSERT_FALSE(cut.ok());
  EXPECT_EQ(cut.error().code, Code::frame_incomplete) << cut.error().text.c_str();
  EXPECT_NE(cut.error().text.view().find("byte 1000: the file ends here"), std::string_view::npos)
      << cut.error().text.c_str();
  const auto empty = acquire(request(4, 2'000), [&] {
    write_file(inbox("7-4.xyz"), "");
    step(stepped, 2'000);
  });
  ASSERT_FALSE(empty.ok());
  EXPECT_EQ(empty.error().code, Code::frame_incomplete) << empty.error().text.c_str();
  EXPECT_NE(empty.error().text.view().find("0 bytes"), std::string_view::npos) << empty.error().text.c_str();
  EXPECT_EQ(scanner_->stray_files(), 2U);
}

TEST_F(ScanDropTest, text_cut_within_a_line_is_303_and_after_too_few_points_401) {
  ASSERT_TRUE(write_scan((drop() + "/whole").c_str(), ScanFormat::xyz, points(), 0, 0).ok());
  const std::string bytes = read_file(drop() + "/whole");
  const std::size_t end_of_line = bytes.find('\n', bytes.size() / 2) + 1;
  const auto cut_to = [&](std::uint16_t seq, std::size_t size) {
    const auto result = acquire(request(seq), [&] {
      write_file(drop() + "/part", bytes.substr(0, size));
      fs::rename(drop() + "/part", inbox("7-" + std::to_string(seq) + ".xyz"));
    });
    EXPECT_FALSE(result.ok());
    return result ? Code::ok : result.error().code;
  };
  EXPECT_EQ(cut_to(3, end_of_line), Code::too_few_points);
  EXPECT_EQ(cut_to(4, end_of_line + 1), Code::frame_incomplete);
  EXPECT_EQ(scanner_->stray_files(), 2U);
}

TEST_F(ScanDropTest, cancel_ends_the_wait_and_withdraws_the_request) {
  const auto result = acquire(request(), [&] { cancel_ = true; });
  ASSERT_FALSE(result.ok());
  EXPECT_EQ(result.error().code, Code::interrupted);
}

TEST_F(ScanDropTest, requests_of_a_dead_process_are_withdrawn_at_the_start) {
  write_file(request_file("6-9.json"), "{}");
  open(false);
  EXPECT_TRUE(names_in(request_file()).empty());
}

TEST_F(ScanDropTest, a_flood_of_names_does_not_hide_the_answer) {
  const auto result = acquire(request(), [&] {
    for (int i = 0; i < 200; ++i) write_file(inbox("a" + std::to_string(i) + ".tmp"), "x");
    drop_scan("7-3.ply");
  });
  EXPECT_TRUE(result.ok()) << result.error().text.c_str();
}

TEST_F(ScanDropTest, a_missing_folder_is_offline_until_it_is_back) {
  EXPECT_TRUE(scanner_->online());
  fs::rename(drop(), folder_ / "away");
  scanner_->idle();
  EXPECT_FALSE(scanner_->online());
  const auto result = scanner_->acquire(request(), xyz_, cancel_, on_decoded_);
  ASSERT_FALSE(result.ok());
  EXPECT_EQ(result.error().code, Code::scanner_offline);
  fs::rename(folder_ / "away", drop());
  scanner_->idle();
  EXPECT_TRUE(scanner_->online());
}

TEST_F(ScanDropTest, a_spool_that_cannot_be_written_is_an_error_and_the_answer_does_not_stay) {
  write_file(folder_ / "spool", "a file where the folder should be");
  const auto result = acquire(request(), [&] { drop_scan("7-3.ply"); });
  ASSERT_FALSE(result.ok());
  EXPECT_EQ(result.error().code, Code::journal_write);
  EXPECT_TRUE(names_in(inbox()).empty());
  // The scan was good: the error is reported with the place to which its file was moved.
  ScannerText note;
  ASSERT_TRUE(scanner_->next_note(note));
  EXPECT_NE(note.view().find("inbox/7-3.ply was moved to stray/"), std::string_view::npos) << note.c_str();
  EXPECT_NE(note.view().find(result.error().text.view()), std::string_view::npos) << note.c_str();
}

TEST_F(ScanDropTest, a_file_linked_into_the_inbox_is_copied_and_the_spool_file_has_no_other_link) {
  // Software that rewrites one file for every scan and gives it a second name in the inbox.
  const std::string last = drop() + "/last.ply";
  const auto give = [&](const std::string& name, float z) {
    ASSERT_TRUE(write_ply((drop() + "/writing").c_str(), points(z), 0, 0).ok());
    const std::string bytes = read_file(drop() + "/writing");
    std::ofstream(last, std::ios::binary | std::ios::in | std::ios::out) << bytes;
    if (!fs::exists(last)) write_file(last, bytes);
    fs::create_hard_link(last, inbox(name));
  };
  const auto first = acquire(request(3), [&] { give("7-3.ply", 5.0F); });
  ASSERT_TRUE(first.ok()) << first.error().text.c_str();
  ScanRequest next = request(4);
  next.spool_path = PathText(folder_ / "spool/1/05-1");
  ASSERT_TRUE(acquire(next, [&] { give("7-4.ply", 9.0F); }).ok());
  std::vector<float> again(xyz_.size());
  ASSERT_TRUE(read_scan(first.value().path.c_str(), LengthUnit::mm, again).ok());
  EXPECT_EQ(again[2], 5.0F) << "the scan of another block";
  EXPECT_TRUE(names_in(inbox()).empty());
  EXPECT_EQ(names_in(folder_ / "spool/1").size(), 2U) << "no working file is left";
}

TEST_F(ScanDropTest, a_pipe_in_place_of_the_request_file_does_not_block) {
  ASSERT_EQ(mkfifo(request_file(".7-3.json.tmp").c_str(), 0666), 0);
  const auto result = acquire(request(), [&] { drop_scan("7-3.ply"); });
  EXPECT_TRUE(result.ok()) << result.error().text.c_str();
}

TEST_F(ScanDropTest, a_spool_on_another_file_system_gets_a_copy) {
  std::string pattern = "/dev/shm/slabd_hal_XXXXXX";
  ASSERT_NE(mkdtemp(pattern.data()), nullptr) << "the test needs a second file system";
  ScanRequest r = request();
  r.spool_path = PathText(pattern + "/deep/er/04-1");
  const auto result = acquire(r, [&] { drop_scan("7-3.ply"); });
  EXPECT_TRUE(result.ok()) << result.error().text.c_str();
  std::vector<float> again(xyz_.size());
  EXPECT_TRUE(read_scan((pattern + "/deep/er/04-1.ply").c_str(), LengthUnit::mm, again).ok());
  EXPECT_EQ(again[3 * 77], 77.0F);
  EXPECT_EQ(names_in(pattern + "/deep/er").size(), 1U) << "no working file is left";
  EXPECT_TRUE(names_in(inbox()).empty());
  fs::remove_all(pattern);
}

TEST_F(ScanDropTest, a_folder_that_is_not_there_yet_is_reported_by_name_and_used_when_it_comes) {
  ScanDropSettings settings;
  settings.drop_dir = PathText(folder_ / "nowhere");
  const auto made = make_scan_drop(settings, *clock_);
  ASSERT_TRUE(made.ok());
  ScannerPort& scanner = *made.value();
  EXPECT_FALSE(scanner.online());
  const auto result = scanner.acquire(request(), xyz_, cancel_, on_decoded_);
  ASSERT_FALSE(result.ok());
  EXPECT_EQ(result.error().code, Code::scanner_offline);
  EXPECT_NE(result.error().text.view().find("nowhere"), std::string_view::npos);
  fs::create_directory(folder_ / "nowhere");
  scanner.idle();
  EXPECT_TRUE(scanner.online());
}

// ---- files that have their final length before their content --------------------------------------------------------

/// Files as written by programs that copy over a network: the length first, then the content in parts.
class ScanDropFilledTest : public ScanDropTest {
 protected:
  static constexpr std::size_t kMany = 80'000;
  void SetUp() override {
    ScanDropTest::SetUp();
    xyz_.resize(3 * 2 * kMany);
    many_.resize(3 * kMany);
    for (std::size_t i = 0; i < many_.size(); ++i) many_[i] = static_cast<float>(1 + i % 977);
  }
  void fill_slowly(const std::string& name, int parts, int pause_ms) {
    ASSERT_TRUE(write_ply((drop() + "/whole").c_str(), many_, 0, 0).ok());
    const std::string bytes = read_file(drop() + "/whole");
    fs::remove(drop() + "/whole");
    write_file(inbox(name), bytes.substr(0, bytes.find("end_header") + 11));
    fs::resize_file(inbox(name), bytes.size());
    std::fstream file(inbox(name), std::ios::binary | std::ios::in | std::ios::out);
    for (int part = 0; part < parts; ++part) {
      wait_ms(pause_ms);
      const std::size_t begin = bytes.size() * static_cast<std::size_t>(part) / static_cast<std::size_t>(parts);
      const std::size_t end = bytes.size() * static_cast<std::size_t>(part + 1) / static_cast<std::size_t>(parts);
      file.seekp(static_cast<std::streamoff>(begin));
      file << bytes.substr(begin, end - begin) << std::flush;
    }
  }
  std::vector<float> many_;
};

TEST_F(ScanDropFilledTest, are_waited_for_until_all_of_it_is_there) {
  for (const int pause_ms : {20, 150, 900}) {
    const auto seq = static_cast<std::uint16_t>(pause_ms);
    const std::string name = "7-" + std::to_string(seq) + ".ply";
    const auto result = acquire(request(seq), [&] { fill_slowly(name, 4, pause_ms); });
    ASSERT_TRUE(result.ok()) << result.error().text.c_str();
    EXPECT_EQ(result.value().shape.finite, kMany);
    EXPECT_TRUE(std::equal(many_.begin(), many_.end(), xyz_.begin()));
  }
}

TEST_F(ScanDropFilledTest, content_that_never_comes_is_missing_and_not_a_scan_of_fewer_points) {
  const auto result = acquire(request(), [&] {
    ASSERT_TRUE(write_ply((drop() + "/whole").c_str(), many_, 0, 0).ok());
    const std::string bytes = read_file(drop() + "/whole");
    fs::remove(drop() + "/whole");
    write_file(inbox("7-3.ply"), bytes.substr(0, bytes.size() / 2));
    fs::resize_file(inbox("7-3.ply"), bytes.size());
  });
  ASSERT_FALSE(result.ok());
  EXPECT_EQ(result.error().code, Code::frame_incomplete);
  EXPECT_NE(result.error().text.view().find("parts of its data were never written"), std::string_view::npos)
      << result.error().text.c_str();
  expect_nothing_spooled();
}

TEST_F(ScanDropFilledTest, zeros_that_stay_are_points_that_are_missing) {
  std::fill_n(many_.begin() + 3 * 100, 3 * 50, 0.0F);
  const auto result = acquire(request(), [&] {
    ASSERT_TRUE(write_ply((drop() + "/whole").c_str(), many_, 0, 0).ok());
    fs::rename(drop() + "/whole", inbox("7-3.ply"));
  });
  ASSERT_TRUE(result.ok()) << result.error().text.c_str();
  EXPECT_EQ(result.value().shape.finite, kMany - 50);
  EXPECT_EQ(result.value().shape.zeros, 50U);
  EXPECT_TRUE(std::isnan(xyz_[3 * 120]));
}

// ---- any_name ------------------------------------------------------------------------------------------------------

TEST_F(ScanDropAnyNameTest, the_one_file_that_appears_is_the_answer) {
  const auto result = acquire(request(), [&] { drop_scan("Scan 0001.PLY"); });
  ASSERT_TRUE(result.ok()) << result.error().text.c_str();
  EXPECT_EQ(result.value().path, folder_ / "spool/1/04-1.ply");
  EXPECT_TRUE(names_in(inbox()).empty());
}

TEST_F(ScanDropAnyNameTest, a_file_that_grows_is_waited_for) {
  const auto result = acquire(request(), [&] {
    ASSERT_TRUE(write_ply((drop() + "/whole").c_str(), points(), 0, 0).ok());
    const std::string bytes = read_file(drop() + "/whole");
    for (int part = 1; part <= 5; ++part) {
      write_file(inbox("scan.ply"), bytes.substr(0, bytes.size() * static_cast<std::size_t>(part) / 5));
      wait_ms(200);
    }
  });
  EXPECT_TRUE(result.ok()) << result.error().text.c_str();
}

TEST_F(ScanDropAnyNameTest, text_that_grows_is_waited_for) {
  SteppedClock stepped;
  open_with(stepped, true);
  const auto result = acquire(request(), [&] { write_slowly(stepped, ScanFormat::csv, "Scan 2.CSV", 4, 200); });
  ASSERT_TRUE(result.ok()) << result.error().text.c_str();
  EXPECT_EQ(result.value().shape.finite, kPoints);
  EXPECT_EQ(result.value().path, folder_ / "spool/1/04-1.csv");
}

TEST_F(ScanDropAnyNameTest, an_inbox_that_is_not_empty_at_the_request_is_303) {
  drop_scan("old.ply");
  const auto result = scanner_->acquire(request(), xyz_, cancel_, on_decoded_);
  ASSERT_FALSE(result.ok());
  EXPECT_EQ(result.error().code, Code::frame_incomplete);
  EXPECT_NE(result.error().text.view().find("old.ply"), std::string_view::npos);
  expect_nothing_spooled();
}

TEST_F(ScanDropAnyNameTest, two_files_are_not_an_answer_and_the_next_scan_starts_clean) {
  SteppedClock stepped;
  open_with(stepped, true);
  const auto result = acquire(request(3, 1'000), [&] {
    drop_scan("a.ply");
    drop_scan("b.ply");
  });
  ASSERT_FALSE(result.ok());
  EXPECT_EQ(result.error().code, Code::frame_incomplete);
  EXPECT_TRUE(names_in(inbox()).empty());
  EXPECT_EQ(scanner_->stray_files(), 2U);
  // Perhaps neither was the answer, which may still come for some seconds.
  const auto drop_and_step = [&] {
    drop_scan("c.ply");
    step(stepped, 600);
  };
  const auto repeat = acquire(request(4), drop_and_step, &stepped);
  EXPECT_TRUE(repeat.ok()) << repeat.error().text.c_str();
}

TEST_F(ScanDropAnyNameTest, an_exposure_that_is_saved_twice_is_not_the_next_requests) {
  ASSERT_TRUE(acquire(request(3), [&] { drop_scan("scan.PLY"); }).ok());
  for (const std::uint16_t seq : {std::uint16_t{4}, std::uint16_t{5}}) {
    const auto again = acquire(request(seq), [&] { drop_scan_as(ScanFormat::xyz, "scan.xyz"); });
    ASSERT_FALSE(again.ok());
    EXPECT_EQ(again.error().code, Code::frame_incomplete);
    EXPECT_NE(again.error().text.view().find("scan.xyz: the scan before it was a .ply"), std::string_view::npos)
        << again.error().text.c_str();
    EXPECT_TRUE(names_in(inbox()).empty());
    // The answer to the request that was given up.
    std::thread late([&] {
      wait_ms(100);
      drop_scan("scan.ply");
    });
    const auto own = acquire(request(static_cast<std::uint16_t>(seq + 10)), [&] { drop_scan("scan.ply", 6.0F); });
    late.join();
    ASSERT_TRUE(own.ok()) << own.error().text.c_str();
    EXPECT_EQ(xyz_[2], 6.0F);
  }
  // After a restart slabd has no record of that exposure.
  open(true);
  EXPECT_TRUE(acquire(request(6), [&] { drop_scan_as(ScanFormat::xyz, "scan.xyz"); }).ok());
}

TEST_F(ScanDropAnyNameTest, a_file_that_stays_short_of_its_header_is_303) {
  SteppedClock stepped;
  open_with(stepped, true);
  const auto result = acquire(request(3, 2'000), [&] {
    ASSERT_TRUE(write_ply((drop() + "/short").c_str(), points(), 0, 0).ok());
    fs::resize_file(drop() + "/short", 1'000);
    fs::rename(drop() + "/short", inbox("short.ply"));
    step(stepped, 2'000);
  });
  ASSERT_FALSE(result.ok());
  EXPECT_EQ(result.error().code, Code::frame_incomplete);
  EXPECT_NE(result.error().text.view().find("short.ply: not whole within 2.0 s"), std::string_view::npos);
  // Its writer may continue, so the file stays; the next request still gets its own answer.
  EXPECT_EQ(names_in(inbox()).size(), 1U);
  const auto drop_and_step = [&] {
    drop_scan("fresh.ply", 5.0F);
    step(stepped, 600);
  };
  const auto next = acquire(request(4), drop_and_step, &stepped);
  ASSERT_TRUE(next.ok()) << next.error().text.c_str();
  EXPECT_EQ(xyz_[2], 5.0F);
  EXPECT_TRUE(names_in(inbox()).empty());
  EXPECT_EQ(scanner_->stray_files(), 1U);
}

/// Scanner software that is late: after the next request it first answers the previous request, then the present one.
class ScanDropLateTest : public ScanDropAnyNameTest {
 protected:
  /// `before` runs before the next request. Returns the height of the accepted scan.
  float next_scan_after_a_late_one(const std::function<void()>& before = [] {}) {
    std::thread software([&] {
      wait_ms(200);
      before();
      drop_scan("late.ply", 1.0F);
      ASSERT_TRUE(wait_until([&] { return fs::exists(request_file("7-4.json")); })) << "there is no second request";
      drop_scan("own.ply", 2.0F);
    });
    const auto result = scanner_->acquire(request(4), xyz_, cancel_, on_decoded_);
    software.join();
    EXPECT_TRUE(result.ok()) << result.error().text.c_str();
    EXPECT_TRUE(fs::exists(stray("late.ply")));
    EXPECT_TRUE(names_in(request_file()).empty());
    return xyz_[2];
  }
  /// The request is cancelled before an answer came.
  void be_cancelled() {
    const auto cancelled = acquire(request(), [&] { cancel_ = true; });
    ASSERT_FALSE(cancelled.ok());
    ASSERT_EQ(cancelled.error().code, Code::interrupted);
    cancel_ = false;
  }
};

TEST_F(ScanDropLateTest, a_file_that_is_not_a_scan_does_not_answer_a_request) {
  const auto result = acquire(request(), [&] { write_file(inbox("Thumbs.db"), "no scan"); });
  ASSERT_FALSE(result.ok());
  EXPECT_EQ(result.error().code, Code::frame_incomplete);
  EXPECT_EQ(next_scan_after_a_late_one(), 2.0F);
}

TEST_F(ScanDropLateTest, answer_to_a_request_from_before_a_restart_is_waited_for) {
  be_cancelled();
  open(true);
  EXPECT_EQ(next_scan_after_a_late_one(), 2.0F);
}

TEST_F(ScanDropLateTest, a_text_that_exists_already_is_not_the_awaited_answer) {
  be_cancelled();
  EXPECT_EQ(next_scan_after_a_late_one([&] {
              write_file(inbox("readme.txt"), "exports go here\n");
              wait_ms(1'500);
            }),
            2.0F);
}

TEST_F(ScanDropAnyNameTest, a_link_or_a_folder_is_not_an_answer) {
  SteppedClock stepped;
  open_with(stepped, true);
  ASSERT_TRUE(write_ply((folder_ / "outside.ply").c_str(), points(), 0, 0).ok());
  const auto link = acquire(request(3, 1'000), [&] { fs::create_symlink(folder_ / "outside.ply", inbox("x.ply")); });
  ASSERT_FALSE(link.ok());
  EXPECT_EQ(link.error().code, Code::frame_incomplete);
  const auto directory = acquire(
      request(4), [&] { fs::create_directory(inbox("folder")); }, &stepped);
  ASSERT_FALSE(directory.ok());
  EXPECT_EQ(directory.error().code, Code::frame_incomplete);
  EXPECT_TRUE(names_in(inbox()).empty());
}

}  // namespace
}  // namespace slabd::hal
