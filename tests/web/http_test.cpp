// SPDX-License-Identifier: Apache-2.0
//
// Requests of browsers and of attackers on the sockets of slabd-web.
#include <arpa/inet.h>
#include <signal.h>
#include <sys/socket.h>

#include <atomic>
#include <sstream>

#include "tests/web/web_process.h"

namespace slabd::web {
namespace {

using Clock = std::chrono::steady_clock;

struct Http : WebProcess {
  [[nodiscard]] Reply raw(const std::string& request) const { return ask(port_, request); }
  [[nodiscard]] std::string host() const { return "Host: 127.0.0.1:" + std::to_string(port_) + "\r\n"; }
};

double seconds_since(Clock::time_point begin) {
  return std::chrono::duration<double>(Clock::now() - begin).count();
}

TEST_F(Http, every_answer_has_the_security_fields) {
  store_slab();
  start();
  for (const char* target : {"/", "/slabs/1", "/assets/none.js", "/api/v1/slabs", "/api/v1/nothing", "/healthz"}) {
    const Reply reply = get(target);
    EXPECT_EQ(reply.field("x-content-type-options"), "nosniff") << target;
    EXPECT_EQ(reply.field("referrer-policy"), "no-referrer") << target;
    EXPECT_EQ(reply.field("cross-origin-resource-policy"), "same-origin") << target;
    const std::string policy = reply.field("content-security-policy");
    EXPECT_TRUE(policy.starts_with("default-src 'none'; ")) << policy;
    EXPECT_EQ(policy.find("unsafe"), std::string::npos) << policy;
    EXPECT_TRUE(reply.field("access-control-allow-origin").empty()) << target;
  }
  EXPECT_EQ(get("/").field("content-type"), "text/html; charset=utf-8");
  EXPECT_EQ(get("/slabs/1/blocks/4").body, get("/").body);
}

TEST_F(Http, an_unchanged_document_is_not_sent_again) {
  store_slab();
  start();
  for (const char* target : {"/", "/api/v1/slabs/1", "/api/v1/words"}) {
    const Reply first = get(target);
    ASSERT_EQ(first.status, 200) << target;
    EXPECT_EQ(first.field("cache-control"), "no-cache");
    const std::string etag = first.field("etag");
    EXPECT_EQ(etag.size(), 34U) << etag;
    const Reply again = get(target, "If-None-Match: \"x\", " + etag + "\r\n");
    EXPECT_EQ(again.status, 304) << target;
    EXPECT_TRUE(again.body.empty());
    EXPECT_EQ(again.field("etag"), etag);
    EXPECT_EQ(get(target, "If-None-Match: \"x\"\r\n").status, 200);
  }
  const Reply status = get("/api/v1/status");
  EXPECT_EQ(get("/api/v1/status", "If-None-Match: \"x\"\r\n").status, 200);
  EXPECT_FALSE(status.field("etag").empty());
}

TEST_F(Http, only_get_head_and_writes_of_a_known_host_are_answered) {
  store_slab();
  start("names = [\"line-7.example\"]\n");
  for (const char* method : {"POST", "PUT", "DELETE", "OPTIONS", "TRACE", "PATCH", "NONSENSE"}) {
    const Reply reply =
        raw(std::string(method) + " /api/v1/status HTTP/1.1\r\n" + host() + "Connection: close\r\n\r\n");
    EXPECT_EQ(reply.status, 405) << method;
    EXPECT_EQ(reply.field("allow"), "GET, HEAD, POST") << method;
  }
  EXPECT_EQ(raw("POST / HTTP/1.1\r\n" + host() + "Content-Length: 5\r\nConnection: close\r\n\r\nabcde").status, 405);
  EXPECT_EQ(raw("GET / HTTP/1.1\r\n" + host() + "Content-Length: 5\r\nConnection: close\r\n\r\nabcde").status, 400);
  const Reply head = raw("HEAD /api/v1/slabs HTTP/1.1\r\n" + host() + "Connection: close\r\n\r\n");
  EXPECT_EQ(head.status, 200);
  EXPECT_TRUE(head.body.empty());
  EXPECT_EQ(head.field("content-length"), std::to_string(get("/api/v1/slabs").body.size()));
  const auto status_for = [&](const std::string& name) {
    return raw("GET / HTTP/1.1\r\nHost: " + name + "\r\nConnection: close\r\n\r\n").status;
  };
  EXPECT_EQ(status_for("localhost:" + std::to_string(port_)), 200);
  EXPECT_EQ(status_for("LINE-7.example"), 200);
  EXPECT_EQ(status_for("evil.example"), 421);
  EXPECT_EQ(status_for("evil.example:" + std::to_string(port_)), 421);
  EXPECT_EQ(raw("GET / HTTP/1.0\r\n\r\n").status, 421);
}

TEST_F(Http, tricks_with_paths_and_long_requests_reach_nothing) {
  store_slab();
  start();
  for (const char* target :
       {"/../etc/passwd", "/assets/../../etc/passwd", "/assets/%2e%2e/%2e%2e/etc/passwd", "/assets/..%2fsecret",
        "/assets//etc/passwd", "/%00", "/assets/index.html%00.js", "//", "/./", "/slabs/1/../2", "/api/v1/slabs/%31",
        "/api/v1/slabs?id=%00", "/api/v1/slabs?id=%0d%0aX:1", "/api/v1/slabs?limit=1&limit=2"}) {
    const Reply reply = get(target);
    EXPECT_EQ(reply.status, 400) << target;
    EXPECT_EQ(reply.body.find("root:"), std::string::npos);
  }
  EXPECT_EQ(get("/" + std::string(2'000, 'a')).status, 400);
  EXPECT_EQ(get("/assets/.bash_history").status, 400);
  const int long_fields = get("/", "X-Long: " + std::string(100'000, 'a') + "\r\n").status;
  EXPECT_TRUE(long_fields == 431 || long_fields == 413 || long_fields == 0) << long_fields;
  const int long_line = get("/" + std::string(100'000, 'a')).status;
  EXPECT_TRUE(long_line == 414 || long_line == 431 || long_line == 0) << long_line;
  EXPECT_EQ(raw("\x16\x03\x01 TLS to a port without TLS\r\n\r\n").status / 100 % 2, 0);
  EXPECT_EQ(get("/healthz").status, 200);
}

TEST_F(Http, half_open_connections_on_the_lan_do_not_reach_the_kiosk) {
  store_slab();
  start("lan_listen = \"127.0.0.1:0\"\n");
  ASSERT_NE(lan_port_, 0);
  EXPECT_EQ(web::get(lan_port_, "/healthz").status, 200);
  std::vector<Fd> open;
  for (int i = 0; i < 200; ++i) {
    open.push_back(connected_to(lan_port_));
    static constexpr std::string_view kHalf = "GET / HTTP/1.1\r\nHost: ";
    if (open.back().is_open()) static_cast<void>(::send(open.back().get(), kHalf.data(), kHalf.size(), MSG_NOSIGNAL));
  }
  for (int i = 0; i < 20; ++i) {
    EXPECT_EQ(get("/healthz").status, 200);
    EXPECT_EQ(get("/api/v1/slabs").status, 200);
  }
  EXPECT_LT(memory_kb(), line::kSanitized ? 1'000'000 : 64'000);
  // The half-open ones end at the time limit.
  int status = 0;
  for (int i = 0; i < 600 && status != 200; ++i) {
    status = web::get(lan_port_, "/healthz").status;
    std::this_thread::sleep_for(std::chrono::milliseconds(100));
  }
  EXPECT_EQ(status, 200);
}

/// Runs openssl; its output.
std::string openssl(const std::string& arguments, const std::string& out) {
  static_cast<void>(std::system(("openssl " + arguments + " >" + out + " 2>&1").c_str()));
  return line::read_file(out);
}

TEST_F(Http, the_lan_listener_speaks_tls_with_its_certificate) {
  store_slab();
  openssl("req -x509 -newkey ec -pkeyopt ec_paramgen_curve:prime256v1 -nodes -days 2 -subj /CN=localhost -keyout " +
              file("web.key") + " -out " + file("web.pem"),
          file("made"));
  start("lan_listen = \"0.0.0.0:0\"\ntls_cert = \"web.pem\"\ntls_key = \"web.key\"\n");
  ASSERT_NE(lan_port_, 0) << log();
  cli::expect_mentions(log(), "lan: https://0.0.0.0:");
  const std::string place = "127.0.0.1:" + std::to_string(lan_port_);
  static_cast<void>(write("request", "GET /healthz HTTP/1.1\r\nHost: localhost\r\nConnection: close\r\n\r\n"));
  const std::string client =
      "s_client -quiet -CAfile " + file("web.pem") + " -verify_return_error -connect " + place + " <" + file("request");
  cli::expect_mentions(openssl(client, file("answer")), "\r\n\r\nok\n");
  EXPECT_EQ(openssl(client + " -tls1_1", file("old")).find("HTTP/1.1 200"), std::string::npos);
  EXPECT_NE(web::get(lan_port_, "/healthz").status, 200) << "an answer without TLS";
}

TEST_F(Http, a_certificate_or_key_without_content_stops_it_before_it_listens) {
  store_slab();
  const std::string lan = "lan_listen = \"127.0.0.1:0\"\ntls_cert = \"web.pem\"\ntls_key = \"web.key\"\n";
  write_config(lan);
  const auto expect_refused = [&](const std::string& reason) {
    fs::remove(file("web.err"));
    line::Process refused({places::slabd_web(), "--config", config()}, file("web.out"), file("web.err"));
    EXPECT_EQ(reported_port(refused, file("web.err"), "lan"), 0) << log();
    if (refused.running()) refused.signal(SIGTERM);
    EXPECT_EQ(refused.wait(), 3) << log();
    cli::expect_mentions(log(), reason);
    EXPECT_EQ(log().find("kiosk: "), std::string::npos) << log();
  };
  static_cast<void>(write("web.key", "a key"));
  expect_refused(file("web.pem") + ": No such file or directory");
  static_cast<void>(write("web.pem", ""));
  expect_refused(file("web.pem") + ": is empty");
  static_cast<void>(write("web.pem", "a certificate"));
  static_cast<void>(write("web.key", ""));
  expect_refused(file("web.key") + ": is empty");
  fs::remove(file("web.key"));
  expect_refused(file("web.key") + ": No such file or directory");
}

TEST_F(Http, a_lan_address_that_this_computer_does_not_have_leaves_the_kiosk_alone) {
  store_slab();
  start("lan_listen = \"198.51.100.7:0\"\nlan_plain = true\n");  // RFC 5737: for documents, no computer has it
  ASSERT_NE(lan_port_, 0) << log();
  cli::expect_mentions(log(), "/ as soon as this computer has this address");
  EXPECT_EQ(get("/healthz").status, 200);
}

TEST_F(Http, a_process_that_hangs_is_killed_and_others_are_answered) {
  store_slab();
  const std::string pids = file("pids");
  const std::string slow = write("slow", "#!/bin/sh\necho $$ >>" + pids + "\nexec sleep 1000\n");
  fs::permissions(slow, fs::perms::owner_all);
  start("slabctl = \"" + slow + "\"\nanswer_s = 10\n");
  Reply late;
  std::thread asking([&] { late = get("/api/v1/slabs"); });
  EXPECT_EQ(get("/healthz").status, 200);
  EXPECT_EQ(get("/").status, 200);
  EXPECT_EQ(get("/api/v1/status").status, 200);
  asking.join();
  cli::expect_mentions(refused(late, 504), "slabctl was ended after 10 s; ask for fewer slabs");
  process_->signal(SIGTERM);
  EXPECT_EQ(process_->wait(), 0);
  std::istringstream lines(line::read_file(pids));
  int count = 0;
  for (pid_t pid = 0; lines >> pid; ++count) EXPECT_NE(::kill(pid, 0), 0) << "process " << pid << " runs still";
  EXPECT_GE(count, 1);
}

// As the kernel does when the unit has no memory left.
TEST_F(Http, a_process_that_was_killed_is_not_reported_as_late) {
  store_slab();
  const std::string killed = write("killed", "#!/bin/sh\nkill -KILL $$\n");
  fs::permissions(killed, fs::perms::owner_all);
  start("slabctl = \"" + killed + "\"\nanswer_s = 60\n");
  cli::expect_mentions(refused(get("/api/v1/slabs"), 500), "slabctl was ended by signal 9; ask for fewer slabs");
}

TEST_F(Http, more_documents_than_can_wait_are_refused_with_a_sentence) {
  store_slab();
  const std::string hold = write("hold", "");
  const std::string slow = write("slow", "#!/bin/sh\nwhile [ -e " + hold + " ]; do sleep 0.1; done\n");
  fs::permissions(slow, fs::perms::owner_all);
  start("slabctl = \"" + slow + "\"\n");
  std::vector<std::thread> asking;
  std::atomic<int> refusals{0};
  for (int i = 0; i < 28; ++i)
    asking.emplace_back([this, i, &refusals] {
      const Reply reply = get("/api/v1/slabs?limit=" + std::to_string(i + 1));
      if (reply.status != 503) return;
      ++refusals;
      EXPECT_EQ(reply.field("retry-after"), "2");
      cli::expect_mentions(refused(reply, 503), "too many documents are wanted at once");
    });
  EXPECT_TRUE(places::wait_until([&] { return refusals >= 8; }));
  fs::remove(hold);
  for (std::thread& one : asking) one.join();
}

TEST_F(Http, sigterm_ends_it_at_once_also_while_a_document_is_made) {
  store_slab();
  const std::string slow = write("slow", "#!/bin/sh\nexec sleep 1000\n");
  fs::permissions(slow, fs::perms::owner_all);
  start("slabctl = \"" + slow + "\"\n");
  std::thread waiting([this] { EXPECT_NE(get("/api/v1/slabs").status, 200); });
  std::this_thread::sleep_for(std::chrono::milliseconds(300));
  const auto begin = Clock::now();
  process_->signal(SIGTERM);
  EXPECT_EQ(process_->wait(), 0) << log();
  EXPECT_LT(seconds_since(begin), 20.0);
  waiting.join();
}

TEST_F(Http, memory_stays_small_over_ten_thousand_requests) {
  store_slab();
  start();
  EXPECT_EQ(get("/api/v1/slabs/1").status, 200);
  const Fd socket = connected_to(port_);
  const std::string kept = "GET /api/v1/slabs/1 HTTP/1.1\r\n" + host() + "\r\n";
  std::string bytes(65'536, '\0');
  long middle_kb = 0;
  for (int i = 0; i < 10'000; ++i) {
    // Most over one connection, as of a page that stays open.
    if (i % 20 == 0) {
      ASSERT_EQ(get(i % 40 == 0 ? "/api/v1/status" : "/").status, 200);
    } else {
      static_cast<void>(::send(socket.get(), kept.data(), kept.size(), MSG_NOSIGNAL));
      const ssize_t got = ::recv(socket.get(), bytes.data(), bytes.size(), 0);
      ASSERT_GT(got, 0);
      const std::size_t length = std::strtoul(bytes.c_str() + bytes.find("Content-Length: ") + 16, nullptr, 10);
      std::size_t left = bytes.find("\r\n\r\n") + 4 + length - static_cast<std::size_t>(got);
      while (left > 0) {
        const ssize_t more = ::recv(socket.get(), bytes.data(), std::min(bytes.size(), left), 0);
        ASSERT_GT(more, 0);
        left -= static_cast<std::size_t>(more);
      }
    }
    if (i == 5'000) middle_kb = memory_kb();
  }
  if (line::kSanitized) return;
  EXPECT_LT(memory_kb(), 64'000);
  EXPECT_LT(memory_kb(), middle_kb + 2'000);
  RecordProperty("resident_kb", static_cast<int>(memory_kb()));
}

TEST_F(Http, a_faulty_configuration_is_reported_with_file_and_line) {
  write_config("lan_listen = \"0.0.0.0:8080\"\n");
  line::Process refused({places::slabd_web(), "--config", config()}, file("web.out"), file("web.err"));
  EXPECT_EQ(refused.wait(), 3);
  cli::expect_mentions(log(), "slabd.toml:19:14: web.lan_listen: found \"0.0.0.0:8080\" without tls_cert and tls_key");
  write_config("lan_listen = \"0.0.0.0:8080\"\n");
  EXPECT_EQ(run("config check " + config()).status, 3);
}

}  // namespace
}  // namespace slabd::web
