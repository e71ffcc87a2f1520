// SPDX-License-Identifier: Apache-2.0
//
// Documents that are given while they are made again.
#include <gtest/gtest.h>
#include <sys/stat.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <string>
#include <thread>
#include <variant>
#include <vector>

#include "tests/hal/temporary_folder.h"
#include "tests/places/wait.h"
#include "web/documents.h"
#include "web/routes.h"
#include "web/words.h"

namespace slabd::web {
namespace {

/// A program that counts from 1 and prints {"n": 1}, then {"n": 2}, ...; from the `last`-th time on it ends with an
/// error. A report contains the same text.
class RenewedDocuments : public ::testing::Test {
 protected:
  Documents documents(int last) {
    const std::string program = (folder_ / "slabctl");
    // With the name of a file as second argument it waits while that exists.
    std::ofstream(folder_ / "count").flush();
    std::ofstream(program) << "#!/bin/sh\nn=$(($(wc -l <" << (folder_ / "count") << ") + 1))\necho >>"
                           << (folder_ / "count") << "\nwhile [ -e \"${2-/nowhere}\" ]; do sleep 0.01; done\n[ $n -le "
                           << last
                           << " ] || { echo 'slabctl: internal error' >&2; exit 5; }\ncase \"${2-}\" in --out=*) exec "
                              ">\"${2#--out=}\" ;; esac\necho \"{\\\"n\\\": $n}\"\n";
    ::chmod(program.c_str(), 0755);
    return Documents({.slabctl = program,
                      .config = "",
                      .reports_dir = folder_.string(),
                      .answer_s = 60.0,
                      .plant = "",
                      .plant_dsn = ""});
  }
  /// Times that the program was started.
  int count() {
    std::ifstream lines(folder_ / "count");
    return static_cast<int>(std::count(std::istreambuf_iterator<char>(lines), {}, '\n'));
  }
  hal::test::TemporaryFolder folder_;
};

TEST_F(RenewedDocuments, are_given_while_they_are_made_again) {
  Documents documents = this->documents(100);
  const DocumentOrder order{.arguments = {"moulds"}, .cache_s = 0.0, .renew_s = 3'600.0};
  EXPECT_EQ(body_of(*documents.get(order)), "{\"n\": 1}\n");
  EXPECT_EQ(body_of(*documents.get(order)), "{\"n\": 1}\n") << "at once, and it is made again";
  EXPECT_TRUE(places::wait_until([&] { return body_of(*documents.get(order)) != "{\"n\": 1}\n"; }));
}

TEST_F(RenewedDocuments, are_an_error_after_their_time_if_they_cannot_be_made) {
  Documents documents = this->documents(1);
  const DocumentOrder order{.arguments = {"moulds"}, .cache_s = 0.0, .renew_s = 0.5};
  EXPECT_EQ(documents.get(order)->status, 200);
  EXPECT_TRUE(places::wait_until([&] { return documents.get(order)->status == 500; }));
}

TEST_F(RenewedDocuments, are_made_before_they_are_given_after_a_write) {
  Documents documents = this->documents(100);
  const DocumentOrder order{.arguments = {"moulds"}, .cache_s = 3'600.0, .renew_s = 3'600.0};
  EXPECT_EQ(body_of(*documents.get(order)), "{\"n\": 1}\n");
  EXPECT_EQ(documents.carry_out({"disposition"})->status, 200);
  EXPECT_EQ(body_of(*documents.get(order)), "{\"n\": 3}\n");
}

// A page in another language and the live picture ask when a verdict arrives.
TEST_F(RenewedDocuments, are_made_again_when_the_line_has_changed_if_they_show_the_present) {
  Documents documents = this->documents(100);
  const DocumentOrder map{.arguments = {"map"}, .cache_s = 2.0};
  const DocumentOrder moulds{.arguments = {"moulds"}, .cache_s = 3'600.0, .renew_s = 3'600.0};
  EXPECT_EQ(body_of(*documents.get(map)), "{\"n\": 1}\n");
  EXPECT_EQ(body_of(*documents.get(moulds)), "{\"n\": 2}\n");
  documents.note_change();
  EXPECT_EQ(body_of(*documents.get(map)), "{\"n\": 3}\n");
  EXPECT_EQ(body_of(*documents.get(moulds)), "{\"n\": 2}\n") << "one slab hardly changes it";
}

TEST_F(RenewedDocuments, about_one_slab_are_made_again_when_the_line_has_changed) {
  Documents documents = this->documents(100);
  for (const char* address : {"/api/v1/slabs/1/report.pdf", "/api/v1/slabs/1/blocks/3/map",
                              "/api/v1/slabs/1/blocks/3/cloud", "/api/v1/compare?a=1&b=2"}) {
    const auto target = parse_target(address);
    ASSERT_TRUE(target.has_value());
    const auto found = find_document(*target);
    const auto* const request = std::get_if<Request>(&found);
    ASSERT_NE(request, nullptr) << address;
    const DocumentOrder order{.arguments = request->arguments,
                              .cache_s = request->route->cache_s,
                              .renew_s = request->route->renew_s,
                              .is_report = request->route->maker == Maker::report};
    const SharedAnswer of_open_slab = documents.get(order);
    EXPECT_EQ(of_open_slab->status, 200) << body_of(*of_open_slab);
    documents.note_change();  // its end
    EXPECT_NE(body_of(*documents.get(order)), body_of(*of_open_slab)) << address;
  }
  EXPECT_EQ(count(), 8);
}

TEST_F(RenewedDocuments, made_for_a_page_are_not_given_to_the_live_picture) {
  Documents documents = this->documents(100);
  const DocumentOrder page{.arguments = {"map", folder_ / "slow"}, .cache_s = 3'600.0};
  const DocumentOrder live{.arguments = page.arguments, .is_live = true};
  EXPECT_EQ(body_of(*documents.get(page)), "{\"n\": 1}\n");
  EXPECT_EQ(body_of(*documents.get(live)), "{\"n\": 2}\n");
  std::ofstream(folder_ / "slow").flush();
  std::string seen;
  std::thread other([&] { std::ignore = documents.get({.arguments = live.arguments, .is_live = true}); });
  ASSERT_TRUE(places::wait_until([&] { return count() == 3; }));
  std::thread again([&] { seen = body_of(*documents.get(live)); });  // the line changed after the third had begun
  std::this_thread::sleep_for(std::chrono::milliseconds(200));
  std::filesystem::remove(folder_ / "slow");
  other.join();
  again.join();
  EXPECT_EQ(seen, "{\"n\": 4}\n");
}

TEST_F(RenewedDocuments, being_made_during_a_write_are_made_again) {
  Documents documents = this->documents(100);
  const DocumentOrder order{.arguments = {"moulds", folder_ / "slow"}, .cache_s = 3'600.0, .renew_s = 3'600.0};
  std::string before;
  std::string after;
  {
    std::ofstream(folder_ / "slow") << "1";
    const std::jthread first([&] { before = body_of(*documents.get(order)); });
    EXPECT_TRUE(places::wait_until([&] { return count() == 1; }));
    EXPECT_EQ(documents.carry_out({"disposition"})->status, 200);
    // Asked for after the write, while the document from before it is still being made.
    const std::jthread second([&] { after = body_of(*documents.get(order)); });
    std::this_thread::sleep_for(std::chrono::milliseconds(50));
    std::filesystem::remove(folder_ / "slow");
  }
  EXPECT_EQ(before, "{\"n\": 1}\n");
  EXPECT_EQ(after, "{\"n\": 3}\n");
  EXPECT_EQ(body_of(*documents.get(order)), "{\"n\": 3}\n") << "and kept";
}

TEST_F(RenewedDocuments, made_ahead_wait_for_their_first_caller) {
  Documents documents = this->documents(100);
  const DocumentOrder order{.arguments = {"moulds"}, .cache_s = 3'600.0, .renew_s = 3'600.0};
  documents.make_ahead({order}, 0.2);
  // Without a caller it is made again and again.
  EXPECT_TRUE(places::wait_until([&] { return count() >= 3; }));
  EXPECT_NE(body_of(*documents.get(order)), "{\"n\": 1}\n");
  // A write removes it, and it is made once more without a caller.
  EXPECT_EQ(documents.carry_out({"disposition"})->status, 200);
  const int written = count();
  EXPECT_TRUE(places::wait_until([&] { return count() > written; }));
}

TEST_F(RenewedDocuments, made_ahead_during_a_write_come_to_all_waiting_callers) {
  for (int round = 0; round < 5; ++round) {
    Documents documents = this->documents(100);
    const DocumentOrder order{.arguments = {"moulds", folder_ / "slow"}, .cache_s = 3'600.0, .renew_s = 3'600.0};
    std::ofstream(folder_ / "slow") << "1";
    documents.make_ahead({order}, 3'600.0);
    EXPECT_TRUE(places::wait_until([&] { return count() == 1; }));
    EXPECT_EQ(documents.carry_out({"disposition"})->status, 200);
    std::array<std::string, 4> given;
    {
      std::vector<std::jthread> asking;
      for (std::string& one : given) asking.emplace_back([&] { one = body_of(*documents.get(order)); });
      std::this_thread::sleep_for(std::chrono::milliseconds(50));
      std::filesystem::remove(folder_ / "slow");
    }
    for (const std::string& one : given) EXPECT_TRUE(one == "{\"n\": 3}\n" || one == "{\"n\": 4}\n") << one;
  }
}

TEST_F(RenewedDocuments, that_cannot_be_made_ahead_are_made_by_their_caller) {
  Documents documents = this->documents(0);
  const DocumentOrder order{.arguments = {"moulds"}, .cache_s = 0.0, .renew_s = 3'600.0};
  documents.make_ahead({order}, 3'600.0);
  EXPECT_EQ(documents.get(order)->status, 500) << "made by itself, or while it is made ahead";
  EXPECT_TRUE(places::wait_until([&] { return count() >= 1; }));
  EXPECT_EQ(documents.get(order)->status, 500) << "afterwards";
}

TEST(WebWrite, that_did_not_end_by_itself_may_have_been_recorded) {
  const hal::test::TemporaryFolder folder;
  const std::string program = folder / "slabctl";
  struct Case {
    const char* command;
    double answer_s;
    const char* reason;
  };
  for (const auto& [command, answer_s, reason] : {Case{"kill -KILL $$", 60.0, "slabctl was ended by signal 9"},
                                                  Case{"exec sleep 1000", 0.1, "slabctl was ended after 0 s"}}) {
    std::ofstream(program) << "#!/bin/sh\n" << command << '\n';
    ::chmod(program.c_str(), 0755);
    Documents documents({.slabctl = program,
                         .config = "",
                         .reports_dir = folder.string(),
                         .answer_s = answer_s,
                         .plant = "",
                         .plant_dsn = ""});
    const SharedAnswer answer = documents.carry_out({"disposition"});
    EXPECT_EQ(answer->status, 503);
    const std::string body = body_of(*answer);
    EXPECT_NE(body.find(reason), std::string::npos) << body;
    const std::string cure = "look at the slab: the change may have been recorded";
    EXPECT_NE(body.find(cure), std::string::npos) << body;
    EXPECT_NE(sentence_in_chinese(cure), cure);
  }
}

}  // namespace
}  // namespace slabd::web
