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
#include <vector>

#include "tests/hal/temporary_folder.h"
#include "tests/places/wait.h"
#include "web/documents.h"

namespace slabd::web {
namespace {

/// A program that counts from 1 and prints {"n": 1}, then {"n": 2}, ...; from the `last`-th time on it ends with an
/// error.
class RenewedDocuments : public ::testing::Test {
 protected:
  Documents documents(int last) {
    const std::string program = (folder_ / "slabctl");
    // With the name of a file as second argument it waits while that exists.
    std::ofstream(folder_ / "count").flush();
    std::ofstream(program) << "#!/bin/sh\nn=$(($(wc -l <" << (folder_ / "count") << ") + 1))\necho >>"
                           << (folder_ / "count") << "\nwhile [ -e \"${2-/nowhere}\" ]; do sleep 0.01; done\n[ $n -le "
                           << last
                           << " ] || { echo 'slabctl: internal error' >&2; exit 5; }\necho \"{\\\"n\\\": $n}\"\n";
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

}  // namespace
}  // namespace slabd::web
