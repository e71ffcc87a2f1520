// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <chrono>
#include <cmath>
#include <cstring>
#include <fstream>
#include <functional>
#include <memory>
#include <thread>
#include <vector>

#include "hal/hal.h"
#include "tests/hal/temporary_folder.h"
#include "tests/places/wait.h"

/// A drop directory with emulated scanner software.
namespace slabd::hal {
namespace fs = std::filesystem;
using places::wait_until;
using test::names_in;
using test::read_file;
using test::TemporaryFolder;
using test::write_file;

inline constexpr std::size_t kPoints = limits::kScanPointsMin + 10;

inline void wait_ms(int ms) {
  std::this_thread::sleep_for(std::chrono::milliseconds(ms));
}

/// A clock that the test advances.
class SteppedClock final : public Clock {
 public:
  [[nodiscard]] std::int64_t mono_ns() const override {
    ++asked_;
    return now_ns;
  }
  [[nodiscard]] std::int64_t utime_us() const override { return now_ns / kNsPerUs; }
  /// Waits `ms`, and until the port has looked at the inbox some times: it reads the clock a few times per look. False
  /// if it does not look.
  [[nodiscard]] bool let_look(int ms) const {
    const int before = asked_;
    wait_ms(ms);
    return wait_until([&] { return asked_ >= before + kSomeLooks; });
  }
  /// Advances half a second if the port has looked some times since the last call.
  void pass_if_looked() {
    if (asked_ < passed_at_ + kSomeLooks) return;
    passed_at_ = asked_;
    now_ns += kNsPerS / 2;
  }
  std::atomic<std::int64_t> now_ns = kNsPerS;

 private:
  static constexpr int kSomeLooks = 24;
  mutable std::atomic<int> asked_ = 0;
  int passed_at_ = 0;
};

/// A clock that advances one millisecond at each reading, so that time limits become limits on readings.
class TickingClock final : public Clock {
 public:
  [[nodiscard]] std::int64_t mono_ns() const override { return now_ns_ += kNsPerMs; }
  [[nodiscard]] std::int64_t utime_us() const override { return now_ns_ / kNsPerUs; }

 private:
  mutable std::atomic<std::int64_t> now_ns_ = kNsPerS;
};

class ScanDropTest : public ::testing::Test {
 protected:
  void SetUp() override {
    fs::create_directory(drop());
    open(false);
  }

  void open(bool any_name) { open_with(*clock_, any_name); }
  /// The clock must outlive the port.
  void open_with(const Clock& clock, bool any_name = false, const ScanForm& form = {}) {
    ScanDropSettings settings;
    settings.drop_dir = PathText(drop());
    settings.any_name = any_name;
    settings.form = form;
    auto made = make_scan_drop(settings, clock);
    ASSERT_TRUE(made.ok()) << made.error().text.c_str();
    scanner_ = std::move(made.value());
    scanner_->idle();  // its first look
  }

  std::string drop() const { return folder_ / "drop"; }
  std::string inbox(const std::string& name = "") const { return drop() + "/inbox/" + name; }
  std::string stray(const std::string& name = "") const { return drop() + "/stray/" + name; }
  std::string request_file(const std::string& name = "") const { return drop() + "/request/" + name; }

  ScanRequest request(std::uint16_t seq = 3, std::int64_t timeout_ms = 30'000) const {
    ScanRequest r;
    r.session = 7;
    r.cmd_seq = seq;
    r.slab_id = "S-1";
    r.station = 4;
    r.timeout_ns = ns_from_ms(timeout_ms);
    r.spool_path = PathText(folder_ / "spool/1/04-1");
    return r;
  }

  static std::vector<float> points(float z = 5.0F) {
    std::vector<float> xyz(3 * kPoints);
    for (std::size_t i = 0; i < kPoints; ++i) {
      xyz[3 * i] = static_cast<float>(i);
      xyz[3 * i + 1] = 1.0F;
      xyz[3 * i + 2] = z;
    }
    return xyz;
  }

  /// Writes under another name and renames, as scanner software should do.
  void drop_scan(const std::string& name, float z = 5.0F) const {
    const std::string temporary = drop() + "/" + name + ".writing";
    ASSERT_TRUE(write_ply(temporary.c_str(), points(z), 0, 0).ok());
    fs::rename(temporary, inbox(name));
  }

  /// Runs acquire() on this thread, and `scanner_software` on another as soon as the request exists. A fatal failure
  /// there cancels acquire(), which may have a clock that is stopped. `passing` is such a clock that advances until the
  /// request exists, because the port first waits for a late answer.
  Result<AcquiredScan> acquire(const ScanRequest& r, const std::function<void()>& scanner_software,
                               SteppedClock* passing = nullptr) {
    make_place(fs::path(std::string(r.spool_path.view())));
    const std::string name = std::to_string(r.session) + "-" + std::to_string(r.cmd_seq) + ".json";
    std::atomic<bool> over = false;
    std::thread software([&] {
      const bool asked = wait_until([&] {
        if (over || fs::exists(request_file(name))) return true;
        if (passing != nullptr) passing->pass_if_looked();
        return false;
      });
      EXPECT_TRUE(asked) << "there is no " << name;
      if (asked && !over) scanner_software();
      if (!asked || HasFatalFailure()) cancel_ = true;
    });
    Result<AcquiredScan> result = scanner_->acquire(r, xyz_, cancel_, on_decoded_);
    over = true;
    software.join();
    for (const std::string& left : names_in(request_file()))
      EXPECT_EQ(left, ".unanswered") << "the request must be gone afterwards";
    return result;
  }

  /// The daemon uses a separate path for every attempt.
  static void make_place(const fs::path& place) {
    std::error_code none;
    for (const auto& entry : fs::directory_iterator(place.parent_path(), none))
      if (entry.path().stem() == place.filename()) fs::remove(entry.path());
  }

  /// The same in any format, by rename from outside the inbox.
  void drop_scan_as(ScanFormat format, const std::string& name) const {
    const std::string temporary = drop() + "/writing";
    ASSERT_TRUE(write_scan(temporary.c_str(), format, points(), 0, 0).ok());
    fs::rename(temporary, inbox(name));
  }

  /// Lets the port look at the inbox as it is, then advances the clock.
  static void step(SteppedClock& clock, int ms) {
    ASSERT_TRUE(clock.let_look(60)) << "the port does not look at its inbox";
    clock.now_ns += ms * kNsPerMs;
  }

  /// Writes directly into the inbox, in parts with pauses, as unsuitable software does. The port looks before and after
  /// each pause, and after the last part until it counts as unchanged.
  void write_slowly(SteppedClock& clock, ScanFormat format, const std::string& name, int parts, int pause_ms) const {
    const std::string temporary = drop() + "/whole";
    ASSERT_TRUE(write_scan(temporary.c_str(), format, points(), 0, 0).ok());
    const std::string bytes = read_file(temporary);
    fs::remove(temporary);
    std::ofstream file(inbox(name), std::ios::binary);
    for (int part = 0; part < parts; ++part) {
      const std::size_t begin = bytes.size() * static_cast<std::size_t>(part) / static_cast<std::size_t>(parts);
      const std::size_t end = bytes.size() * static_cast<std::size_t>(part + 1) / static_cast<std::size_t>(parts);
      file << bytes.substr(begin, end - begin) << std::flush;
      const bool is_last = part + 1 == parts;
      step(clock, is_last ? 600 : pause_ms);
      if (is_last || HasFatalFailure()) return;
      ASSERT_TRUE(clock.let_look(60)) << "the port does not look at its inbox";
    }
  }

  void expect_nothing_spooled() const {
    if (!fs::exists(folder_ / "spool")) return;
    for (const auto& entry : fs::recursive_directory_iterator(folder_ / "spool"))
      EXPECT_FALSE(entry.is_regular_file()) << entry.path();
  }

  TemporaryFolder folder_;
  std::unique_ptr<Clock> clock_ = make_system_clock();
  std::unique_ptr<ScannerPort> scanner_;
  std::vector<float> xyz_ = std::vector<float>(3 * 2 * kPoints);
  std::atomic<bool> cancel_ = false;
  ScanDecoded on_decoded_ = [](const AcquiredScan&) {};
};

class ScanDropAnyNameTest : public ScanDropTest {
 protected:
  void SetUp() override {
    fs::create_directory(drop());
    open(true);
  }
};

}  // namespace slabd::hal
