// SPDX-License-Identifier: Apache-2.0
#include <gtest/gtest.h>
#include <netinet/in.h>
#include <signal.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cmath>
#include <fstream>
#include <functional>
#include <limits>
#include <optional>
#include <thread>
#include <vector>

#include "emulator/stream_gateway.h"
#include "hal/hal.h"
#include "hal/scan/scan_stream.h"
#include "hal/system/crc32c.h"
#include "tests/hal/temporary_folder.h"
#include "tests/places/places.h"
#include "tests/places/wait.h"

namespace slabd::line {
namespace {

namespace fs = std::filesystem;
using namespace hal;
namespace test = hal::test;
using emulator::StreamGateway;
using emulator::StreamRequest;
using places::wait_until;
using test::names_in;
using test::TemporaryFolder;

constexpr std::size_t kPoints = limits::kScanPointsMin + 10;

std::vector<float> points(float z) {
  std::vector<float> xyz(3 * kPoints, z);
  for (std::size_t i = 0; i < kPoints; ++i) xyz[3 * i] = static_cast<float>(i);
  xyz[30] = std::nanf("");
  return xyz;
}

class SteppedClock final : public Clock {
 public:
  [[nodiscard]] std::int64_t mono_ns() const override { return now_ns; }
  [[nodiscard]] std::int64_t utime_us() const override { return now_ns / kNsPerUs; }
  std::atomic<std::int64_t> now_ns = kNsPerS;
};

class ScanStreamPortTest : public testing::Test {
 protected:
  void SetUp() override { open("127.0.0.0/8"); }
  void open(const char* allow, std::uint64_t scanner = 0) {
    ScanStreamSettings settings;
    settings.port = 0;
    settings.scanner = scanner;
    ASSERT_TRUE(settings.allow.push(parse_network(allow).value()));
    port_.reset();
    auto made = make_scan_stream(settings, *clock_);
    ASSERT_TRUE(made.ok()) << made.error().text.c_str();
    port_ = std::move(made.value());
  }
  /// Opens the port again, with a clock that the test advances.
  SteppedClock& open_with_stepped_clock() {
    auto stepped = std::make_unique<SteppedClock>();
    SteppedClock& clock = *stepped;
    port_.reset();
    clock_ = std::move(stepped);
    open("127.0.0.0/8");
    return clock;
  }
  ScanRequest request(std::uint16_t seq = 3, std::int64_t timeout_ms = 30'000) const {
    ScanRequest r;
    r.session = 7;
    r.cmd_seq = seq;
    r.slab_id = "S \"1\"";
    r.station = 4;
    r.timeout_ns = ns_from_ms(timeout_ms);
    // The daemon uses a separate path for every attempt.
    r.spool_path = PathText(folder_ / ("spool/1/04-" + std::to_string(seq - 2)));
    return r;
  }
  StreamGateway gateway() const { return {"127.0.0.1", port_->bound_port()}; }
  /// Runs the gateway on its own thread, and acquire() on this one.
  Result<AcquiredScan> acquire(const ScanRequest& r, const std::function<void(StreamGateway&)>& software) {
    std::thread thread([&] {
      StreamGateway g = gateway();
      EXPECT_TRUE(g.connect().ok());
      software(g);
      // Nothing else ends acquire() if the clock is stopped.
      if (HasFailure()) cancel_ = true;
    });
    Result<AcquiredScan> result = port_->acquire(r, xyz_, cancel_, [this](const AcquiredScan&) { ++decoded_; });
    thread.join();
    return result;
  }
  static StreamRequest wait_for(StreamGateway& g) {
    std::string note;
    std::optional<StreamRequest> request;
    const auto has_come = [&] {
      // A connection that slabd has closed may still look open here.
      static_cast<void>(g.connect());
      request = g.next_request(1'000, note);
      return request.has_value();
    };
    EXPECT_TRUE(wait_until(has_come)) << "slabd sends no request";
    return request.value_or(StreamRequest());
  }
  /// A separate gateway: connects, reads the request, sends a header and the first bytes of the points, ends its
  /// sending half and waits for the end.
  void send_bytes(std::uint64_t utime_us, std::uint32_t first, std::size_t bytes_of_points) const {
    const int fd = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_port = htons(port_->bound_port());
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    ASSERT_EQ(connect(fd, reinterpret_cast<const sockaddr*>(&address), sizeof address), 0);
    const std::vector<float> xyz = points(5.0F);
    const auto bytes = std::as_bytes(std::span(xyz));
    ScanStreamHeader header;
    header.session = 7;
    header.cmd_seq = 3;
    header.count = static_cast<std::uint32_t>(kPoints);
    header.first = first;
    header.utime_us = utime_us;
    header.points_crc = crc32c(bytes);
    const ScanHeaderBytes head = encode_scan_header(header);
    char asked = 0;  // the line of the request: slabd listens
    EXPECT_EQ(recv(fd, &asked, 1, 0), 1);
    EXPECT_EQ(send(fd, head.data(), head.size(), MSG_NOSIGNAL), static_cast<ssize_t>(head.size()));
    EXPECT_EQ(send(fd, bytes.data(), bytes_of_points, MSG_NOSIGNAL), static_cast<ssize_t>(bytes_of_points));
    shutdown(fd, SHUT_WR);
    while (recv(fd, &asked, 1, 0) > 0) {
    }
    close(fd);
  }
  /// Answers the request with one message: header and bytes.
  void answer_with(const ScanStreamHeader& header, std::span<const std::byte> bytes) const {
    const int fd = socket(AF_INET, SOCK_STREAM | SOCK_CLOEXEC, 0);
    sockaddr_in address{};
    address.sin_family = AF_INET;
    address.sin_port = htons(port_->bound_port());
    address.sin_addr.s_addr = htonl(INADDR_LOOPBACK);
    ASSERT_EQ(connect(fd, reinterpret_cast<const sockaddr*>(&address), sizeof address), 0);
    const ScanHeaderBytes head = encode_scan_header(header);
    std::string line(1'000, '\0');
    line.resize(static_cast<std::size_t>(std::max<ssize_t>(0, recv(fd, line.data(), line.size(), 0))));
    EXPECT_NE(line.find("\"gateway\": 3"), std::string::npos) << line;
    EXPECT_EQ(send(fd, head.data(), head.size(), MSG_NOSIGNAL), static_cast<ssize_t>(head.size()));
    static_cast<void>(send(fd, bytes.data(), bytes.size(), MSG_NOSIGNAL));
    while (recv(fd, line.data(), line.size(), 0) > 0) {
    }
    close(fd);
  }
  void expect_nothing_left() const {
    const std::string spool = folder_ / "spool/1";
    const auto left = fs::exists(spool) ? names_in(spool) : std::vector<std::string>{};
    EXPECT_TRUE(left.empty()) << left.front();
  }

  TemporaryFolder folder_;
  std::unique_ptr<Clock> clock_ = make_system_clock();
  std::unique_ptr<ScanStreamPort> port_;
  std::vector<float> xyz_ = std::vector<float>(3 * (kPoints + 100));
  std::atomic<bool> cancel_{false};
  int decoded_ = 0;
};

TEST_F(ScanStreamPortTest, a_scan_is_measured_from_the_bytes_in_the_spool) {
  const auto result = acquire(request(), [](StreamGateway& g) {
    const StreamRequest r = wait_for(g);
    EXPECT_EQ(r.name(), "7-3");
    EXPECT_EQ(r.station, 4);
    EXPECT_EQ(r.slab_id, "S \"1\"");
    EXPECT_TRUE(g.answer(r, points(5.0F), 0, 0, 99).ok());
  });
  ASSERT_TRUE(result.ok()) << result.error().text.c_str();
  EXPECT_EQ(decoded_, 1);
  EXPECT_EQ(result.value().shape.points, kPoints);
  EXPECT_EQ(result.value().shape.finite, kPoints - 1);
  EXPECT_TRUE(port_->online());
  EXPECT_EQ(names_in(folder_ / "spool/1"), std::vector<std::string>{"04-1.ply"});
  std::vector<float> again(xyz_.size());
  const auto read = read_scan(result.value().path.c_str(), LengthUnit::mm, std::span<float>(again));
  ASSERT_TRUE(read.ok()) << read.error().text.c_str();
  EXPECT_EQ(read.value().finite, kPoints - 1);
  EXPECT_EQ(std::memcmp(again.data(), xyz_.data(), 12 * kPoints), 0);
}

TEST_F(ScanStreamPortTest, a_disk_that_does_not_store_the_scan_is_reported_while_it_hangs) {
  SteppedClock& clock = open_with_stepped_clock();
  // A pipe in place of the file blocks the program that opens it.
  fs::create_directories(folder_ / "spool/1");
  const std::string pipe = folder_ / "spool/1/04-1.ply.part";
  ASSERT_EQ(mkfifo(pipe.c_str(), 0600), 0);
  std::thread watcher([&] {
    for (int i = 0; i < 1'000 && !port_->hangs(); ++i) {
      std::this_thread::sleep_for(std::chrono::milliseconds(20));
      clock.now_ns += kNsPerS;
    }
    EXPECT_TRUE(port_->hangs());
    EXPECT_TRUE(port_->spool_hangs());
    EXPECT_FALSE(port_->online());
    EXPECT_EQ(port_->trouble().view(),
              "the spool has been storing a scan for 10 s; look at the disk of storage.spool_dir");
    std::ifstream(pipe).ignore(std::numeric_limits<std::streamsize>::max());
  });
  const auto result = acquire(request(3, 10'000'000), [](StreamGateway& g) {
    static_cast<void>(g.answer(wait_for(g), points(5.0F), 0, 0, 99));
  });
  watcher.join();
  ASSERT_FALSE(result.ok()) << "a pipe is not a disk";
  EXPECT_EQ(result.error().code, Code::journal_write);
  EXPECT_FALSE(port_->hangs());
  EXPECT_TRUE(port_->online());
}

TEST_F(ScanStreamPortTest, a_scan_continues_where_its_connection_was_cut) {
  const auto result = acquire(request(), [](StreamGateway& g) {
    EXPECT_FALSE(g.answer(wait_for(g), points(5.0F), 0, 0, 99, 20'000).ok());
    ASSERT_TRUE(g.connect().ok());
    const StreamRequest again = wait_for(g);
    EXPECT_EQ(again.have_points, 20'000U);
    EXPECT_TRUE(g.answer(again, points(5.0F), 0, 0, 99).ok());
  });
  ASSERT_TRUE(result.ok()) << result.error().text.c_str();
  std::vector<float> again(xyz_.size());
  ASSERT_TRUE(read_scan(result.value().path.c_str(), LengthUnit::mm, std::span<float>(again)).ok());
  EXPECT_EQ(std::memcmp(again.data(), xyz_.data(), 12 * kPoints), 0) << "the file has every point once";
}

TEST_F(ScanStreamPortTest, a_scan_taken_again_after_a_cut_keeps_no_point_of_the_first) {
  const auto result = acquire(request(), [](StreamGateway& g) {
    EXPECT_FALSE(g.answer(wait_for(g), points(5.0F), 0, 0, 99, 20'000).ok());
    ASSERT_TRUE(g.connect().ok());
    const StreamRequest again = wait_for(g);
    EXPECT_EQ(again.have_points, 20'000U);
    EXPECT_TRUE(g.answer(again, points(6.0F), 0, 0, 100).ok());
    EXPECT_EQ(g.resumed_from(), 0U) << "another scan does not go on at point 20000";
  });
  ASSERT_TRUE(result.ok()) << result.error().text.c_str();
  for (std::size_t i = 0; i < kPoints; ++i) ASSERT_NE(xyz_[3 * i + 2], 5.0F) << i;
  std::vector<float> again(xyz_.size());
  ASSERT_TRUE(read_scan(result.value().path.c_str(), LengthUnit::mm, std::span<float>(again)).ok());
  EXPECT_EQ(std::memcmp(again.data(), xyz_.data(), 12 * kPoints), 0);
}

TEST_F(ScanStreamPortTest, a_gateway_that_was_restarted_during_a_scan_delivers_its_own) {
  const auto result = acquire(request(), [this](StreamGateway& g) {
    EXPECT_FALSE(g.answer(wait_for(g), points(5.0F), 0, 0, 99, 20'000).ok());
    // A gateway that uses have_points although it has another scan is refused once.
    send_bytes(100, 20'000, 0);
    StreamGateway anew = gateway();
    ASSERT_TRUE(anew.connect().ok());
    const StreamRequest again = wait_for(anew);
    EXPECT_EQ(again.have_points, 0U);
    EXPECT_TRUE(anew.answer(again, points(6.0F), 0, 0, 100).ok());
  });
  ASSERT_TRUE(result.ok()) << result.error().text.c_str();
  for (std::size_t i = 0; i < kPoints; ++i) ASSERT_NE(xyz_[3 * i + 2], 5.0F) << i;
}

TEST_F(ScanStreamPortTest, the_late_answer_to_an_abandoned_request_is_never_used_for_the_next_one) {
  StreamGateway g = gateway();
  ASSERT_TRUE(g.connect().ok());
  port_->idle();
  const auto none = port_->acquire(request(3, 50), xyz_, cancel_, [](const AcquiredScan&) {});
  ASSERT_FALSE(none.ok());
  EXPECT_EQ(none.error().code, Code::trigger_timeout);
  const StreamRequest late = wait_for(g);
  std::thread software([&] { EXPECT_FALSE(g.answer(late, points(5.0F), 0, 0, 99).ok()); });
  std::this_thread::sleep_for(std::chrono::milliseconds(50));
  const auto next = port_->acquire(request(4, 2'000), xyz_, cancel_, [this](const AcquiredScan&) { ++decoded_; });
  // On a loaded computer the late answer comes after the second request too.
  EXPECT_TRUE(wait_until([&] {
    port_->idle();
    return port_->stray_files() >= 1;
  }));
  software.join();
  EXPECT_FALSE(next.ok());
  EXPECT_EQ(decoded_, 0);
  expect_nothing_left();
  const auto good = acquire(request(5), [](StreamGateway& fresh) {
    EXPECT_TRUE(fresh.answer(wait_for(fresh), points(7.0F), 0, 0, 101).ok());
  });
  EXPECT_TRUE(good.ok()) << good.error().text.c_str();
}

TEST_F(ScanStreamPortTest, without_a_gateway_the_scanner_is_offline) {
  const auto none = port_->acquire(request(3, 50), xyz_, cancel_, [](const AcquiredScan&) {});
  ASSERT_FALSE(none.ok());
  EXPECT_EQ(none.error().code, Code::scanner_offline);
  EXPECT_FALSE(port_->online());
  EXPECT_NE(port_->trouble().view().find("no gateway"), std::string_view::npos);
}

TEST_F(ScanStreamPortTest, a_scan_that_stays_cut_is_incomplete_and_leaves_no_file) {
  SteppedClock& clock = open_with_stepped_clock();
  const auto result = acquire(request(3, 3'000), [&](StreamGateway& g) {
    EXPECT_FALSE(g.answer(wait_for(g), points(5.0F), 0, 0, 99, 20'000).ok());
    EXPECT_TRUE(wait_until([&] { return !port_->online(); })) << "the cut is not noticed";
    clock.now_ns += 3 * kNsPerS;
  });
  ASSERT_FALSE(result.ok());
  EXPECT_EQ(result.error().code, Code::frame_incomplete);
  EXPECT_NE(result.error().text.view().find("cut after 20000 points"), std::string_view::npos)
      << result.error().text.c_str();
  EXPECT_EQ(decoded_, 0);
  expect_nothing_left();
}

TEST_F(ScanStreamPortTest, a_scan_that_lacks_as_many_bytes_as_a_header_has_was_cut_too) {
  SteppedClock& clock = open_with_stepped_clock();
  const auto result = acquire(request(3, 3'000), [&](StreamGateway& g) {
    g.close();
    send_bytes(99, 0, 12 * kPoints - kScanHeaderBytes);
    clock.now_ns += 3 * kNsPerS;
  });
  ASSERT_FALSE(result.ok());
  EXPECT_NE(result.error().text.view().find("the connection was cut after"), std::string_view::npos)
      << result.error().text.c_str();
  expect_nothing_left();
}

TEST_F(ScanStreamPortTest, too_few_points_are_reported_to_both_sides) {
  const auto result = acquire(request(), [](StreamGateway& g) {
    const Status status = g.answer(wait_for(g), std::vector<float>(300, 1.0F), 0, 0, 99);
    ASSERT_FALSE(status.ok());
    EXPECT_EQ(status.error().code, Code::too_few_points);
  });
  ASSERT_FALSE(result.ok());
  EXPECT_EQ(result.error().code, Code::too_few_points);
  expect_nothing_left();
}

TEST_F(ScanStreamPortTest, a_spool_that_cannot_be_written_is_reported_to_both_sides) {
  test::write_file(folder_ / "spool", "a file where a folder should be");
  const auto result =
      acquire(request(), [](StreamGateway& g) { EXPECT_FALSE(g.answer(wait_for(g), points(5.0F), 0, 0, 99).ok()); });
  ASSERT_FALSE(result.ok());
  EXPECT_EQ(result.error().code, Code::journal_write);
}

TEST_F(ScanStreamPortTest, a_scan_in_the_spool_is_not_overwritten) {
  fs::create_directories(folder_ / "spool/1");
  test::write_file(folder_ / "spool/1/04-1.ply", "of an earlier slab");
  const auto result =
      acquire(request(), [](StreamGateway& g) { EXPECT_FALSE(g.answer(wait_for(g), points(5.0F), 0, 0, 99).ok()); });
  ASSERT_FALSE(result.ok());
  EXPECT_EQ(result.error().code, Code::journal_write);
  EXPECT_EQ(test::read_file(folder_ / "spool/1/04-1.ply"), "of an earlier slab");
  EXPECT_EQ(names_in(folder_ / "spool/1").size(), 1U);
}

TEST_F(ScanStreamPortTest, only_allowed_addresses_are_served) {
  open("203.0.113.0/24");
  StreamGateway g = gateway();
  ASSERT_TRUE(g.connect().ok()) << "the kernel accepts, slabd hangs up";
  for (int i = 0; i < 6'000 && port_->stray_files() == 0; ++i) {
    port_->idle();
    std::this_thread::sleep_for(std::chrono::milliseconds(10));
  }
  EXPECT_FALSE(port_->online());
  EXPECT_EQ(port_->stray_files(), 1U);
  EXPECT_NE(port_->trouble().view().find("[scanner] allow"), std::string_view::npos) << port_->trouble().view();
}

TEST_F(ScanStreamPortTest, a_restarted_gateway_takes_its_own_place) {
  StreamGateway first = gateway();
  StreamGateway second = gateway();
  ASSERT_TRUE(first.connect().ok());
  port_->idle();
  const auto result =
      acquire(request(), [](StreamGateway& g) { EXPECT_TRUE(g.answer(wait_for(g), points(5.0F), 0, 0, 99).ok()); });
  EXPECT_TRUE(result.ok()) << "although the first connection was never closed";
}

TEST_F(ScanStreamPortTest, cancelling_ends_the_wait) {
  StreamGateway g = gateway();
  ASSERT_TRUE(g.connect().ok());
  cancel_ = true;
  const auto result = port_->acquire(request(), xyz_, cancel_, [](const AcquiredScan&) {});
  ASSERT_FALSE(result.ok());
  EXPECT_EQ(result.error().code, Code::interrupted);
}

/// The gateway of docs/DELIVERY.md, taken from the document.
TEST_F(ScanStreamPortTest, the_documented_gateway_delivers) {
  const std::string text = test::read_file(places::source_dir() + "/docs/DELIVERY.md");
  const std::size_t begin = text.find("```python\n");
  const std::size_t end = text.find("```\n", begin + 10);
  ASSERT_NE(begin, std::string::npos);
  const std::string program = text.substr(begin + 10, end - begin - 10);
  EXPECT_LE(std::count(program.begin(), program.end(), '\n'), 50);
  test::write_file(folder_ / "gateway.py", program);
  const std::vector<float> scan = points(5.0F);
  test::write_file(folder_ / "scan.bin", {reinterpret_cast<const char*>(scan.data()), 4 * scan.size()});
  const std::string to = "127.0.0.1:" + std::to_string(port_->bound_port());
  const std::string script = folder_ / "gateway.py";
  const std::string data = folder_ / "scan.bin";
  const std::string said = folder_ / "said";
  const pid_t python = fork();
  if (python == 0) {
    std::ignore = freopen(said.c_str(), "w", stdout);
    execlp("python3", "python3", script.c_str(), to.c_str(), data.c_str(), nullptr);
    _exit(127);
  }
  for (std::uint16_t seq = 3; seq < 5; ++seq) {
    const auto result = port_->acquire(request(seq), xyz_, cancel_, [](const AcquiredScan&) {});
    EXPECT_TRUE(result.ok()) << result.error().text.c_str();
    EXPECT_TRUE(!result.ok() || result.value().shape.finite == kPoints - 1);
  }
  while (test::read_file(said).find("\"cmd_seq\": 4, \"ok\": true") == std::string::npos)
    std::this_thread::sleep_for(std::chrono::milliseconds(5));
  kill(python, SIGKILL);
  waitpid(python, nullptr, 0);
}

TEST_F(ScanStreamPortTest, a_refusal_ends_the_request_at_once_with_the_gateways_reason) {
  const std::string reason = "12 packets are missing";
  ScanStreamHeader header{7, 3, 303, 0, static_cast<std::uint32_t>(reason.size())};
  header.refused = true;
  header.points_crc = crc32c(std::as_bytes(std::span(reason)));
  std::thread thread([&] { answer_with(header, std::as_bytes(std::span(reason))); });
  const auto result = port_->acquire(request(3, 600'000), xyz_, cancel_, [this](const AcquiredScan&) { ++decoded_; });
  port_.reset();  // closes the connection
  thread.join();
  ASSERT_FALSE(result.ok());
  EXPECT_EQ(result.error().code, Code::frame_incomplete);
  EXPECT_EQ(result.error().text.view(), "the gateway has no scan: 12 packets are missing");
  EXPECT_EQ(decoded_, 0);
  expect_nothing_left();
}

TEST_F(ScanStreamPortTest, only_the_accepted_scanner_is_measured) {
  const std::uint64_t accepted = scanner_print("PhoXi 7 1.13 0badcafe");
  const std::vector<float> xyz = points(5.0F);
  ScanStreamHeader header{7, 3, 0, 0, static_cast<std::uint32_t>(kPoints), 0, LengthUnit::mm, 99};
  header.points_crc = crc32c(std::as_bytes(std::span(xyz)));
  for (const std::uint64_t scanner : {std::uint64_t{0}, scanner_print("PhoXi 7 1.14 0badcafe"), accepted}) {
    open("127.0.0.0/8", accepted);
    header.scanner = scanner;
    std::thread thread([&] { answer_with(header, std::as_bytes(std::span(xyz))); });
    const auto result = port_->acquire(request(), xyz_, cancel_, [](const AcquiredScan&) {});
    port_.reset();
    thread.join();
    EXPECT_EQ(result.ok(), scanner == accepted);
    if (!result.ok()) {
      EXPECT_EQ(result.error().code, Code::frame_incomplete);
      EXPECT_NE(result.error().text.view().find("([genicam] accepted)"), std::string_view::npos);
      expect_nothing_left();
    } else {
      std::ifstream in(result.value().path.c_str(), std::ios::binary);
      std::string head(400, '\0');
      in.read(head.data(), 400);
      char comment[40];
      std::snprintf(comment, sizeof comment, "comment scanner %016llx\n", static_cast<unsigned long long>(accepted));
      EXPECT_NE(head.find(comment), std::string::npos) << head.substr(0, 200);
    }
  }
}

}  // namespace
}  // namespace slabd::line
