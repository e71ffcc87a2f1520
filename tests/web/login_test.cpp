// SPDX-License-Identifier: Apache-2.0
//
// Logins, decisions and pins over the sockets of slabd-web, as a browser and as another page send them.
#include <chrono>
#include <fstream>

#include "storage/chain.h"
#include "tests/web/web_process.h"
#include "web/sessions.h"

namespace slabd::web {
namespace {

using namespace std::chrono_literals;

const std::string kAccounts = "users_file = \"web_users\"\n";
constexpr const char* kPassword = "correct horse 17";

struct Login : WebProcess {
  void add_user(const std::string& name, const std::string& role) const {
    std::ofstream(file("password")) << kPassword << '\n';
    const cli::Ended added =
        run("web user add " + name + " --role " + role + " --stdin --config " + config() + " <" + file("password"));
    ASSERT_EQ(added.status, 0) << added.err;
  }
  void start_with_accounts(const std::string& more = "") {
    store_slab();
    write_config(kAccounts + more);
    add_user("mei", "quality");
    add_user("li", "viewer");
    start(kAccounts + more);
  }
  struct Sent {
    std::string cookie;
    std::string origin = "own";
    std::string type = "application/json";
  };
  [[nodiscard]] Reply post(const std::string& target, const std::string& body, const Sent& sent) const {
    const std::string host = "127.0.0.1:" + std::to_string(port_);
    std::string request = "POST " + target + " HTTP/1.1\r\nHost: " + host + "\r\nConnection: close\r\n";
    if (sent.origin == "own") request += "Origin: http://" + host + "\r\n";
    if (sent.origin != "own" && !sent.origin.empty()) request += "Origin: " + sent.origin + "\r\n";
    if (!sent.cookie.empty()) request += "Cookie: a=b; " + sent.cookie + "\r\n";
    request += "Content-Type: " + sent.type + "\r\nContent-Length: " + std::to_string(body.size()) + "\r\n\r\n" + body;
    return ask(port_, request);
  }
  [[nodiscard]] Reply log_in(const std::string& name, const std::string& password) const {
    return post("/api/v1/login", json{{"name", name}, {"password", password}}.dump(), {});
  }
  /// The cookie of a new session, as a browser sends it back.
  [[nodiscard]] std::string cookie_of(const std::string& name) const {
    const Reply reply = log_in(name, kPassword);
    EXPECT_EQ(reply.status, 200) << reply.body;
    const std::string cookie = reply.field("set-cookie");
    EXPECT_NE(cookie.find("; HttpOnly; SameSite=Strict; "), std::string::npos) << cookie;
    return cookie.substr(0, cookie.find(';'));
  }
  [[nodiscard]] json session(const std::string& cookie) const {
    return json::parse(get("/api/v1/session", cookie.empty() ? "" : "Cookie: " + cookie + "\r\n").body);
  }
  const std::string decision_ =
      json{{"decision", "rework"}, {"reason", "burr at block 4"}, {"authority", "Li Wei"}}.dump();
};

TEST_F(Login, a_user_logs_in_and_out) {
  start_with_accounts();
  EXPECT_TRUE(session("")["user"].is_null());
  EXPECT_TRUE(session("")["may_login"]);
  EXPECT_FALSE(session("")["login_required"]);
  const std::string cookie = cookie_of("mei");
  const json mine = session(cookie);
  EXPECT_EQ(mine["user"], "mei");
  EXPECT_EQ(mine["role"], "quality");
  EXPECT_TRUE(mine["may_write"]);
  EXPECT_GT(mine["expires_s"], 43'000);
  EXPECT_FALSE(session(cookie_of("li"))["may_write"]);
  const Reply out = post("/api/v1/logout", "{}", {cookie});
  EXPECT_EQ(out.status, 200);
  EXPECT_NE(out.field("set-cookie").find("Max-Age=0"), std::string::npos);
  EXPECT_TRUE(session(cookie)["user"].is_null()) << "a cookie that was copied is worth nothing then";
  EXPECT_TRUE(session("slabd_session=" + std::string(64, '0'))["user"].is_null());
}

TEST_F(Login, wrong_passwords_have_one_answer_and_are_slowed_down) {
  start_with_accounts();
  const std::string wrong = refused(log_in("mei", "wrong password"), 401);
  EXPECT_EQ(refused(log_in("unknown", kPassword), 401), wrong);
  auto last = std::chrono::steady_clock::now();
  for (int i = 0; i < 3; ++i) {
    last = std::chrono::steady_clock::now();
    EXPECT_EQ(log_in("mei", "wrong password").status, 401) << i;
  }
  const Reply later = log_in("mei", kPassword);
  EXPECT_EQ(later.status, 429) << "five wrong passwords from this address";
  const int wait_s = std::stoi(later.field("retry-after"));
  const double since_s = std::chrono::duration<double>(std::chrono::steady_clock::now() - last).count();
  EXPECT_GE(wait_s + since_s, 9.0);
  EXPECT_LE(wait_s, 10);
  EXPECT_EQ(log().find(kPassword), std::string::npos);
  EXPECT_TRUE(logs("wrong password for \"mei\"")) << log();
}

TEST_F(Login, a_decision_is_stored_with_who_entered_it) {
  start_with_accounts();
  const std::string cookie = cookie_of("mei");
  EXPECT_TRUE(document("/api/v1/slabs/1")["dispositions"].empty());
  const Reply done = post("/api/v1/slabs/1/disposition", decision_, {cookie});
  ASSERT_EQ(done.status, 200) << done.body;
  EXPECT_NE(json::parse(done.body)["text"].get<std::string>().find("disposition 1 of slab 1: rework"),
            std::string::npos);
  const json slab = document("/api/v1/slabs/1");
  ASSERT_EQ(slab["dispositions"].size(), 1U) << "the document is made again";
  EXPECT_EQ(slab["dispositions"][0]["reason"], "burr at block 4");
  EXPECT_EQ(slab["dispositions"][0]["who"], "mei (page)");
  EXPECT_EQ(slab["verdict"], "not_measured") << "the verdict stays";
  EXPECT_TRUE(logs("mei: disposition of slab key:1: done")) << log();
  EXPECT_EQ(storage::check_chain(db()).value().trouble, "");
}

TEST_F(Login, other_users_and_other_pages_write_nothing) {
  start_with_accounts();
  const std::string cookie = cookie_of("mei");
  const std::string target = "/api/v1/slabs/1/disposition";
  EXPECT_EQ(post(target, decision_, {}).status, 401);
  EXPECT_EQ(post(target, decision_, {cookie_of("li")}).status, 403) << "a viewer";
  EXPECT_EQ(post(target, decision_, {cookie, "http://evil.example"}).status, 403);
  EXPECT_EQ(post(target, decision_, {cookie, "null"}).status, 403);
  EXPECT_EQ(post(target, decision_, {cookie, ""}).status, 403) << "no Origin, no Sec-Fetch-Site";
  EXPECT_EQ(post(target, decision_, {cookie, "own", "text/plain"}).status, 415) << "what a form can send";
  EXPECT_EQ(post(target, "[]", {cookie}).status, 400);
  EXPECT_EQ(post(target, "", {cookie}).status, 400);
  EXPECT_EQ(post(target, std::string(9'000, 'x'), {cookie}).status, 413);
  EXPECT_EQ(post("/api/v1/slabs/1", decision_, {cookie}).status, 405);
  EXPECT_EQ(post("/api/v1/slabs/7/disposition", decision_, {cookie}).status, 404);
  const auto with = [&](const char* name, const char* value) {
    json changed = json::parse(decision_);
    changed[name] = value;
    return post(target, changed.dump(), {cookie}).status;
  };
  EXPECT_EQ(with("decision", "pass"), 400);
  EXPECT_EQ(with("decision", "PASS"), 400);
  EXPECT_EQ(with("verdict", "pass"), 400);
  EXPECT_EQ(with("operator", "wang"), 400);
  EXPECT_EQ(with("config", "/etc/passwd"), 400);
  EXPECT_EQ(with("reason", "two\nlines"), 400);
  EXPECT_EQ(with("reason", ""), 400) << "a decision needs a reason";
  EXPECT_TRUE(document("/api/v1/slabs/1")["dispositions"].empty());
  EXPECT_EQ(document("/api/v1/slabs/1")["verdict"], "not_measured");
}

TEST_F(Login, an_account_that_changes_counts_at_once) {
  start_with_accounts();
  const std::string cookie = cookie_of("mei");
  ASSERT_EQ(run("web user role mei --role viewer --config " + config()).status, 0);
  EXPECT_FALSE(session(cookie)["may_write"]);
  ASSERT_EQ(run("web user role mei --role quality --config " + config()).status, 0);
  EXPECT_TRUE(session(cookie)["may_write"]);
  std::ofstream(file("password")) << "another horse 18\n";
  ASSERT_EQ(run("web user password mei --stdin --config " + config() + " <" + file("password")).status, 0);
  EXPECT_TRUE(session(cookie)["user"].is_null()) << "a new password ends the session";
  const std::string of_li = cookie_of("li");
  ASSERT_EQ(run("web user remove li --config " + config()).status, 0);
  EXPECT_TRUE(session(of_li)["user"].is_null());
  EXPECT_EQ(log_in("li", kPassword).status, 401);
  EXPECT_EQ(run("web user add mei --stdin --config " + config() + " <" + file("password")).status, 2) << "exists";
  EXPECT_EQ(run("web user add Mei --stdin --config " + config() + " <" + file("password")).status, 2);
  std::ofstream(file("password")) << "short\n";
  EXPECT_EQ(run("web user add wang --stdin --config " + config() + " <" + file("password")).status, 2);
  cli::expect_mentions(run("web user list --config " + config()).out, "mei                              quality");
  std::ofstream(file("web_users")) << "mei:quality:$6$abc$def\n";
  cli::expect_mentions(run("web user list --config " + config()).err, "web_users:1: this line has no yescrypt hash");
  EXPECT_EQ(log_in("mei", "another horse 18").status, 503);
}

TEST_F(Login, with_viewer_login_documents_are_for_users) {
  start_with_accounts("viewer_login = true\n");
  for (const char* target : {"/api/v1/slabs", "/api/v1/status", "/api/v1/slabs/1/report.pdf", "/api/v1/nothing"})
    EXPECT_EQ(get(target).status, 401) << target;
  for (const char* target : {"/", "/login", "/healthz", "/api/v1/session", "/api/v1/words"})
    EXPECT_EQ(get(target).status, 200) << target;
  EXPECT_TRUE(session("")["login_required"]);
  const std::string cookie = cookie_of("li");
  EXPECT_EQ(get("/api/v1/slabs", "Cookie: " + cookie + "\r\n").status, 200);
  EXPECT_FALSE(session(cookie)["login_required"]);
}

TEST_F(Login, without_accounts_nothing_is_written) {
  store_slab();
  start();
  EXPECT_FALSE(session("")["may_login"]);
  EXPECT_EQ(log_in("mei", kPassword).status, 403);
  EXPECT_EQ(post("/api/v1/slabs/1/disposition", decision_, {}).status, 401);
}

TEST(LoginThrottle, lets_five_attempts_pass_and_then_doubles_the_wait) {
  LoginThrottle throttle;
  const SessionClock::time_point start{};
  for (int i = 0; i < 4; ++i) {
    throttle.failed("name mei", start);
    EXPECT_LE(throttle.wait("name mei", start), 0s);
  }
  throttle.failed("name mei", start);
  EXPECT_EQ(throttle.wait("name mei", start), 10s);
  EXPECT_LE(throttle.wait("name mei", start + 10s), 0s);
  throttle.failed("name mei", start + 10s);
  EXPECT_EQ(throttle.wait("name mei", start + 10s), 20s);
  for (int i = 0; i < 50; ++i) throttle.failed("name mei", start);
  EXPECT_EQ(throttle.wait("name mei", start), 900s);
  EXPECT_LE(throttle.wait("name li", start), 0s);
  throttle.succeeded("name mei");
  EXPECT_LE(throttle.wait("name mei", start), 0s);
}

TEST(Cookie, is_found_by_its_whole_name) {
  EXPECT_EQ(cookie_in("slabd_session=abc", "slabd_session"), "abc");
  EXPECT_EQ(cookie_in("a=b;  slabd_session=abc; c=d", "slabd_session"), "abc");
  for (const char* field : {"", "a=b", "xslabd_session=abc", "slabd_session", "SLABD_SESSION=abc", ";;="})
    EXPECT_EQ(cookie_in(field, "slabd_session"), "") << field;
}

}  // namespace
}  // namespace slabd::web
