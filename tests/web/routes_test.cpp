// SPDX-License-Identifier: Apache-2.0
//
// Targets, parameters and fields of requests, without sockets and processes.
#include <gtest/gtest.h>

#include <nlohmann/json.hpp>

#include "base/plc.h"
#include "base/result.h"
#include "report/say.h"
#include "tests/places/places.h"
#include "web/routes.h"
#include "web/words.h"

namespace slabd::web {
namespace {

using Words = std::vector<std::string>;
using nlohmann::json;

/// Words of slabctl; one word "400" or "404" if the document is refused.
Words arguments_of(const std::string& raw) {
  const auto target = parse_target(raw);
  if (!target) return {"no target"};
  const auto found = find_document(*target);
  if (const auto* refusal = std::get_if<Refusal>(&found)) {
    EXPECT_FALSE(refusal->text.empty() || refusal->cure.empty());
    return {std::to_string(refusal->status)};
  }
  return std::get<Request>(found).arguments;
}

TEST(Target, takes_plain_paths_and_decodes_parameters) {
  const auto target = parse_target("/api/v1/slabs?id=A%20b+%E6%9D%BF&limit=5&x=");
  ASSERT_TRUE(target.has_value());
  EXPECT_EQ(target->path, "/api/v1/slabs");
  ASSERT_EQ(target->parameters.size(), 3U);
  EXPECT_EQ(target->parameters[0].value, "A b 板");
  EXPECT_EQ(target->parameters[1].name, "limit");
  EXPECT_EQ(target->parameters[2].value, "");
  for (const char* good : {"/", "/slabs", "/assets/app.js", "/a-b_c.d/0?", "/slabs?limit=5"})
    EXPECT_TRUE(parse_target(good).has_value()) << good;
}

TEST(Target, refuses_every_other_form) {
  const std::string long_path = "/" + std::string(kTargetBytesMax, 'a');
  std::string many = "/?";
  for (std::size_t i = 0; i <= kParametersMax; ++i) many += "a" + std::to_string(i) + "=1&";
  for (const std::string& bad : {std::string(),
                                 std::string("slabs"),
                                 std::string("//"),
                                 std::string("/a//b"),
                                 std::string("/slabs/"),
                                 std::string("/.."),
                                 std::string("/assets/../x"),
                                 std::string("/assets/%2e%2e/x"),
                                 std::string("/./a"),
                                 std::string("/.git"),
                                 std::string("/a%00"),
                                 std::string("/a\0b", 4),
                                 std::string("/a b"),
                                 std::string("/a\\b"),
                                 std::string("http://host/"),
                                 std::string("*"),
                                 std::string("/?a=%"),
                                 std::string("/?a=%4"),
                                 std::string("/?a=%zz"),
                                 std::string("/?a=%00"),
                                 std::string("/?a=%0a"),
                                 std::string("/?a=%1b[0m"),
                                 std::string("/?a=%ff"),
                                 std::string("/?a=1&a=2"),
                                 std::string("/?=1"),
                                 std::string("/?a%20=1"),
                                 long_path,
                                 many})
    EXPECT_FALSE(parse_target(bad).has_value()) << bad;
}

TEST(Routes, a_path_and_its_parameters_become_a_command) {
  EXPECT_EQ(arguments_of("/api/v1/slabs"), (Words{"history", "--json"}));
  EXPECT_EQ(
      arguments_of("/api/v1/slabs?limit=50&verdict=fail&since=7d&item=jaw_distance&block=11"),
      (Words{"history", "--json", "--limit=50", "--verdict=fail", "--since=7d", "--item=jaw_distance", "--block=11"}));
  EXPECT_EQ(arguments_of("/api/v1/slabs/12"), (Words{"show", "--json", "--", "key:12"}));
  EXPECT_EQ(arguments_of("/api/v1/slabs/12/map?language=zh"),
            (Words{"show", "--map", "--json", "--language=zh", "--", "key:12"}));
  EXPECT_EQ(arguments_of("/api/v1/slabs/12/blocks/18"), (Words{"show", "--block=18", "--json", "--", "key:12"}));
  EXPECT_EQ(arguments_of("/api/v1/slabs/12/blocks/7/cloud"),
            (Words{"show", "--block=7", "--cloud", "--json", "--", "key:12"}));
  EXPECT_EQ(arguments_of("/api/v1/slabs/12/report.pdf?full=1&language=en"),
            (Words{"report", "--out={file}", "--full", "--language=en", "--", "key:12"}));
  EXPECT_EQ(arguments_of("/api/v1/slabs/12/report.pdf?full=0"), (Words{"report", "--out={file}", "--", "key:12"}));
  EXPECT_EQ(arguments_of("/api/v1/trends/seat_slope?block=3"),
            (Words{"trend", "--json", "--block=3", "--", "seat_slope"}));
  EXPECT_EQ(arguments_of("/api/v1/compare?a=1&b=2&all=1"),
            (Words{"compare", "--json", "--all", "--", "key:1", "key:2"}));
  EXPECT_EQ(arguments_of("/api/v1/yield?by=day&language=zh"), (Words{"yield", "--json", "--by=day", "--language=zh"}));
  EXPECT_EQ(arguments_of("/api/v1/doctor?language=zh"), (Words{"doctor", "--no-write", "--json", "--language=zh"}));
}

TEST(Words, a_status_in_chinese_keeps_its_keys_and_figures) {
  const json status = {
      {"schema", "slabd.status/1"},
      {"uptime_s", 7'300.5},
      {"fault",
       {{"code", 503}, {"text", describe(Code::calibration_missing)}, {"cure", cure(Code::calibration_missing)}}},
      {"warn", json::array({"verdicts rest on unconfirmed values"})},
      {"warn_bits", kWarnUnconfirmedNominals},
      {"links",
       {{"plc", {{"alive", false}, {"trouble", ""}}},
        {"pose", {{"code", 201}, {"text", std::string(describe(Code::no_pose)) + ": second sender"}, {"lost", 3}}}}}};
  const json chinese = json::parse(status_in_chinese(status.dump()));
  EXPECT_EQ(chinese["fault"]["text"], report::meaning(Code::calibration_missing, report::Language::zh));
  EXPECT_EQ(chinese["fault"]["cure"], report::cure_words(Code::calibration_missing, report::Language::zh));
  EXPECT_EQ(chinese["warn"][0], report::warning_zh(kWarnUnconfirmedNominals));
  EXPECT_EQ(chinese["links"]["pose"]["text"],
            std::string(report::meaning(Code::no_pose, report::Language::zh)) + "：“second sender”");
  EXPECT_EQ(chinese["links"]["plc"], status["links"]["plc"]);
  EXPECT_EQ(chinese["links"]["pose"]["lost"], 3);
  EXPECT_EQ(chinese["uptime_s"], 7'300.5);
  EXPECT_EQ(chinese.size(), status.size());
  EXPECT_EQ(status_in_chinese("null"), "null");
}

TEST(Words, robots_and_scanners_of_a_status_are_translated) {
  const std::string no_pose(describe(Code::no_pose));
  const json arm = {{"robot", "2"},
                    {"scanner", "2"},
                    {"pose", {{"code", 201}, {"text", no_pose}, {"lost", 3}}},
                    {"scanner_link", {{"online", false}, {"text", "gateway 17"}}},
                    {"calibration", {{"reference_block", {{"note", "to the left"}}}}}};
  const json status = {{"arms", json::array({arm, nullptr})}, {"tie", {{"id", "ti-1"}, {"trouble", "to the left"}}}};
  const json chinese = json::parse(status_in_chinese(status.dump()));
  EXPECT_EQ(chinese["arms"][0]["pose"]["text"], report::meaning(Code::no_pose, report::Language::zh));
  EXPECT_EQ(chinese["arms"][0]["pose"]["lost"], 3);
  EXPECT_EQ(chinese["arms"][0]["scanner_link"], arm["scanner_link"]) << "a text that the catalogue does not have";
  EXPECT_EQ(chinese["arms"][0]["calibration"]["reference_block"]["note"], "向左");
  EXPECT_EQ(chinese["arms"][1], nullptr);
  EXPECT_EQ(chinese["tie"]["trouble"], "向左");
}

TEST(Words, notes_and_the_main_reason_are_translated_and_foreign_texts_stay) {
  EXPECT_EQ(
      json::parse(notes_in_chinese(R"({"checks":[{"note":"to the left","who":"to the left"},{"note":"by Li"}]})")),
      json::parse(R"({"checks":[{"note":"向左","who":"to the left"},{"note":"by Li"}]})"));
  EXPECT_EQ(notes_in_chinese("null"), "null");
  const std::string english = report::reason_sentence(401, report::Language::en);
  EXPECT_EQ(json::parse(yield_in_chinese(json{{"main_reason", "3 x " + english}, {"failed", 3}}.dump())),
            (json{{"main_reason", "3 x " + report::reason_sentence(401, report::Language::zh)}, {"failed", 3}}));
  EXPECT_EQ(yield_in_chinese("null"), "null");
  EXPECT_EQ(sentence_in_chinese("slabd does not answer on /run/c.sock: it closed the connection"),
            "slabd 在 /run/c.sock 上没有应答：它关闭了连接");
  EXPECT_EQ(sentence_in_chinese("another text"), "another text");
}

TEST(Routes, an_option_cannot_be_smuggled_in) {
  EXPECT_EQ(arguments_of("/api/v1/slabs?id=--db%3D/etc/passwd"), (Words{"history", "--json", "--id=--db=/etc/passwd"}));
  for (const char* bad :
       {"/api/v1/slabs?limit=-1", "/api/v1/slabs?limit=1%20--db", "/api/v1/slabs?since=--db",
        "/api/v1/slabs?verdict=none", "/api/v1/slabs?block=0", "/api/v1/slabs?block=19", "/api/v1/slabs?item=Seat",
        "/api/v1/slabs?limit=1234567", "/api/v1/slabs?config=/etc/passwd", "/api/v1/slabs?db=x",
        "/api/v1/slabs?limit=", "/api/v1/compare?a=1", "/api/v1/slabs/1/map?language=de",
        "/api/v1/slabs/1/blocks/1/cloud?language=en", "/api/v1/yield?by=week", "/api/v1/slabs/1?limit=3"})
    EXPECT_EQ(arguments_of(bad), Words{"400"}) << bad;
  for (const char* bad :
       {"/api/v1", "/api/v1/slabs/x", "/api/v1/slabs/-1", "/api/v1/slabs/1/blocks/19", "/api/v1/slabs/1/cloud",
        "/api/v1/slabs/1/blocks/0/cloud", "/api/v1/slabs/1234567890123456789", "/api/v1/slabs/1/report.html",
        "/api/v1/trends/A", "/api/v2/slabs", "/api/v1/slabs/1/map/x", "/api/v1/drafts/--db",
        "/api/v1/drafts/a/picture.pdf"})
    EXPECT_EQ(arguments_of(bad), Words{"404"}) << bad;
}

// More slabs need hundreds of MB in slabctl.
TEST(Routes, a_list_of_slabs_is_at_most_as_long_as_that_of_the_page) {
  EXPECT_EQ(arguments_of("/api/v1/slabs?limit=1"), (Words{"history", "--json", "--limit=1"}));
  EXPECT_EQ(arguments_of("/api/v1/slabs?limit=2000"), (Words{"history", "--json", "--limit=2000"}));
  for (const char* bad : {"0", "050", "2001", "3000", "10000", "100000"})
    EXPECT_EQ(arguments_of(std::string("/api/v1/slabs?limit=") + bad), Words{"400"}) << bad;
}

TEST(Routes, only_logins_decisions_and_pins_are_written) {
  const auto write_of = [](const char* raw) { return find_write(*parse_target(raw)); };
  EXPECT_EQ(write_of("/api/v1/login")->write, Write::login);
  EXPECT_EQ(write_of("/api/v1/logout")->write, Write::logout);
  EXPECT_EQ(write_of("/api/v1/slabs/12/disposition")->key, "key:12");
  EXPECT_EQ(write_of("/api/v1/slabs/12/pin")->write, Write::pin);
  EXPECT_EQ(write_of("/api/v1/slabs/12/unpin")->write, Write::unpin);
  for (const char* other : {"/", "/api/v1/slabs/12", "/api/v1/slabs/x/pin", "/api/v1/slabs/12/disposition/1",
                            "/api/v1/calibration", "/api/v1/status", "/login"})
    EXPECT_FALSE(write_of(other)) << other;
}

TEST(Routes, every_page_has_the_same_document_and_nothing_else_has_it) {
  for (const char* page : {"/", "/slabs", "/slabs/7", "/slabs/7/blocks/3", "/trends", "/moulds", "/calibration",
                           "/line", "/compare", "/about", "/login", "/plant", "/drafts", "/drafts/p5600.v2"})
    EXPECT_TRUE(is_page(page)) << page;
  for (const char* other : {"/slab", "/slabs/x", "/slabs/7/blocks/0", "/healthz", "/assets/app.js", "/index.html",
                            "/drafts/.p", "/drafts/-p", "/drafts/a%2Fb"})
    EXPECT_FALSE(is_page(other)) << other;
}

TEST(Fields, host_is_a_name_of_this_computer_with_or_without_a_port) {
  const Words names = {"localhost", "192.168.0.7", "Line-7.example"};
  for (const char* good : {"localhost", "LOCALHOST:8080", "192.168.0.7:1", "line-7.example"})
    EXPECT_TRUE(is_host(good, names)) << good;
  for (const char* bad : {"", ":", "evil.example", "localhost.evil.example", "localhost:x", "192.168.0.70",
                          "[::1]:8080", "localhost,evil", "localhost@evil"})
    EXPECT_FALSE(is_host(bad, names)) << bad;
}

TEST(Fields, if_none_match_is_a_list) {
  EXPECT_TRUE(has_etag("\"a\"", "\"a\""));
  EXPECT_TRUE(has_etag("\"x\", W/\"a\" ,\"y\"", "\"a\""));
  EXPECT_TRUE(has_etag("*", "\"a\""));
  EXPECT_FALSE(has_etag("", "\"a\""));
  EXPECT_FALSE(has_etag("\"ab\"", "\"a\""));
}

TEST(Words, are_those_of_reports_in_both_languages) {
  const auto en = nlohmann::json::parse(words_document("en"));
  const auto zh = nlohmann::json::parse(words_document("zh"));
  EXPECT_EQ(en["items"]["seat_slope"], "seat slope");
  EXPECT_EQ(en["units"]["seat_slope"], "deg");
  EXPECT_EQ(en["items"].size(), zh["items"].size());
  EXPECT_EQ(en["reasons"].size(), zh["reasons"].size());
  EXPECT_GT(en["reasons"].size(), 30U);
  for (const auto& [reason, text] : zh["reasons"].items()) EXPECT_NE(text, en["reasons"][reason]) << reason;
  for (const auto& [check, word] : zh["checks"].items()) {
    EXPECT_NE(word, check) << "no translation";
    EXPECT_EQ(en["checks"][check], check);
  }
  for (const auto& [verdict, word] : zh["verdicts"].items()) EXPECT_NE(word, en["verdicts"][verdict]) << verdict;
}

}  // namespace
}  // namespace slabd::web
