// SPDX-License-Identifier: Apache-2.0
//
// status, show and doctor in Chinese, and the choice of the language.
#include <algorithm>
#include <fstream>
#include <nlohmann/json.hpp>

#include "base/calibration.h"
#include "base/jobs.h"
#include "cli/exit.h"
#include "storage/storage.h"
#include "tests/cli/chinese.h"
#include "tests/cli/fake_daemon.h"
#include "tests/cli/slabctl_process.h"

namespace slabd::cli {
namespace {

using nlohmann::json;

/// The status of a line in trouble.
json troubled() {
  json j = {{"schema", "slabd.status/1"}, {"software", "slabd 1.0.0"}, {"state", "fault"}, {"session", 7}};
  j["uptime_s"] = 7'300.5;
  j["fault"] = {
      {"code", 503}, {"text", describe(Code::calibration_missing)}, {"cure", cure(Code::calibration_missing)}};
  j["warn"] = {"verdicts rest on unconfirmed values", "stray files"};
  j["warn_bits"] = kWarnUnconfirmedNominals | kWarnStrayFiles;
  j["emulation"] = {"line"};
  j["emulation_now"] = {"line"};
  j["alike_recipes"] = {{{"a", "P5600"}, {"b", "P4925"}, {"ends_differ", true}, {"text", "P5600 and P4925 ..."}}};
  const json watch = {{"id", "rb-0123456789ab"}, {"checked_utime_us", 1'763'681'281'000'000}, {"passed", false},
                      {"note", "slope off"},     {"due_utime_us", 1'763'681'281'000'000},     {"overdue", true}};
  j["calibration"] = {
      {"source", "applied"},
      {"id", "he-0123456789ab"},
      {"expires_utime_us", 0},
      {"stations", {{{"slab_type", 5600}, {"id", "st-0123456789ab"}, {"mastered", 18}, {"state", "stale"}}}},
      {"reference_block", watch},
      {"monitor_ball", watch},
      {"scanner", {{"id", "sc-0123456789ab"}, {"state", "failed"}, {"expires_utime_us", 0}}}};
  j["maintenance"] = {{"session", "hall"}, {"operator", "li"}, {"views", 3}, {"lease_left_s", 250.0}};
  j["slab"] = {{"no", 8}, {"id", "S-8"}, {"type", 5600}, {"mould", 12}, {"stations_done", 3}, {"stations", 18}};
  j["links"]["plc"] = {{"clients", 1}, {"alive", false}, {"trouble", "connection refused"}};
  j["links"]["pose"] = {
      {"ok", false}, {"code", 201}, {"text", std::string(describe(Code::no_pose)) + ": second sender"},
      {"note", ""},  {"lost", 3},   {"refusal", "10.0.0.3 sends as well"}};
  j["links"]["scanner"] = {{"online", false}, {"strays", 2}, {"text", "drop/request: No such file or directory"}};
  j["links"]["store"] = {{"ok", false}, {"text", "disk I/O error"}};
  j["chain"] = {{"entries", 12}, {"sha256", "0123456789abcdef"}};
  j["results_pending"] = 1;
  j["last_slab"] = {{"no", 7}, {"verdict", "fail"}, {"reason", 402}, {"emulated", true}};
  j["blocks"] = {{"measured", 3}, {"last_ms", 25.0}, {"max_ms", 31.0}};
  j["memory"] = {{"rss_kb", 213'000}, {"peak_kb", 214'000}, {"inspection_bytes", 193'000'000}};
  j["config"] = "/etc/slabd/slabd.toml";
  j["db"] = "/var/lib/slabd/slabd.db";
  return j;
}

using Language = Slabctl;

TEST_F(Language, status_is_chinese_and_quotes_what_the_daemon_says) {
  json status = troubled();
  const std::string socket = file("c.sock");
  {
    const FakeDaemon daemon(socket, status.dump() + "\n");
    const Ended zh = run("status --language zh --socket " + socket);
    EXPECT_EQ(zh.status, kDone) << zh.err;
    expect_chinese(zh.out);
    for (const char* words : {"没有有效的标定", "已运行 2 小时", "没有收到机器人位姿：“second sender”", "不合格",
                              "lost 3 次", "板型 5600，模具 12，"})
      expect_mentions(zh.out, words);
    // The environment is the default of the option.
    ::setenv("SLABD_LANGUAGE", "zh", 1);
    EXPECT_EQ(run("status --socket " + socket).out, zh.out);
    expect_mentions(run("status --language en --socket " + socket).out, "up 7300.5 s, session 7");
    EXPECT_EQ(json::parse(run("status --json --socket " + socket).out), status) << "JSON has one language";
    ::unsetenv("SLABD_LANGUAGE");
  }
  status["links"]["plc"] = {{"clients", 1}, {"alive", true}, {"trouble", ""}};
  status["links"]["pose"] = {{"ok", true}, {"note", ""}};
  for (const char* key : {"fault", "warn", "emulation", "maintenance", "slab", "last_slab", "alike_recipes"})
    status.erase(key);
  fs::remove(socket);
  const FakeDaemon daemon(socket, status.dump() + "\n");
  expect_chinese(run("status --language zh --socket " + socket).out);
}

TEST_F(Language, another_name_is_refused_with_the_allowed_ones) {
  const Ended option = run("status --language fr --socket " + file("c.sock"));
  EXPECT_EQ(option.status, kUsage);
  expect_mentions(option.err, "allowed is en, zh");
  ::setenv("SLABD_LANGUAGE", "fr", 1);
  for (const std::string& command :
       {"status --socket " + file("c.sock"), "doctor --config " + file("none.toml"),
        "report 1 --out x.pdf --db " + file("none.db"), "show 1 --db " + file("none.db")}) {
    const Ended ended = run(command);
    EXPECT_EQ(ended.status, kUsage) << command;
    expect_mentions(ended.err, "SLABD_LANGUAGE=fr: allowed are en and zh");
  }
  ::unsetenv("SLABD_LANGUAGE");
}

TEST_F(Language, an_error_is_chinese_too) {
  const Ended silent = run("status --language zh --socket " + file("none.sock"));
  EXPECT_EQ(silent.status, kNotReachable);
  expect_mentions(silent.err, "没有应答");
  expect_chinese(silent.err);
}

class ShowChinese : public Slabctl {
 protected:
  ShowChinese() {
    store_ = std::move(storage::open_store({file("slabd.db"), file("spool"), 0}).value());
    header_.slab_id = "S-42";
    header_.stations = 18;
    header_.cell_mm = 1.5;
    header_.recipe = "P5600";
    header_.calibration_id = "commissioning-0123456789ab";
    header_.stations_id = "st-0123456789ab";
    header_.scanner_id = "sc-0123456789ab";
    header_.software = "slabd 1.0.0";
    header_.unconfirmed = 3;
    header_.emulated = kEmulatedScan;
    header_.began_utime_us = 1'763'681'281'000'000;
  }
  void apply(const decltype(StoreJob::what)& what) {
    const Status status = store_->apply({1, what});
    ASSERT_TRUE(status.ok()) << status.error().text.view();
  }
  /// Stores a slab with blocks that were measured, not measured, and only scanned.
  void store(std::int64_t key, Verdict verdict, std::uint16_t reason) {
    header_.key = key;
    apply(BeginSlabJob{header_, 1, static_cast<std::uint16_t>(key)});
    Attempt attempt;
    attempt.slab_key = key;
    attempt.number = 1;
    attempt.pose_spread_mm = 0.01;
    attempt.splice.off_mm = attempt.splice.off_rad = 0.5;
    for (std::size_t source = 0; source < kSpliceSources; ++source) {
      attempt.station = static_cast<std::uint8_t>(source + 1);
      attempt.splice.source = static_cast<SpliceSource>(source);
      attempt.splice.calibration_mm = attempt.splice.robot_mm = 0.02;
      apply(AcquiredJob{attempt});
      BlockResult block;
      block.station = attempt.station;
      block.verdict = verdict == Verdict::pass || source > 2 ? Verdict::pass : Verdict::fail;
      block.reason = block.verdict == Verdict::fail ? 604 : 0;
      block.registration.status = RegistrationStatus::converged;
      block.registration.deviation.mean_mm = block.registration.deviation.std_mm = 0.1;
      block.seat.normal_datum = Vec3(0.0, 0.0, 1.0);
      block.seat.flatness_mm = block.seat.flatness_closed_mm = 0.2;
      block.seat.flatness_raw_mm = block.seat.flatness_trimmed_mm = 0.3;
      block.seat.flatness_noise_mm = 0.05;
      block.seat.defect.cells = 4;
      block.seat.defect.area_mm2 = 9.0;
      block.seat.defect.height_mm = -0.5;
      block.seat.defect.limit_mm = 0.4;
      block.scan.step_mm = Vec3(0.1, 0.1, 0.1);
      block.scan.lag_ratio = 1.0;
      SurfaceFinding finding;
      finding.kind = FindingKind::crack;
      finding.length_mm = 40.0;
      finding.width_mm = 2.0;
      finding.area_mm2 = 80.0;
      finding.depth_mm = 3.0;
      EXPECT_TRUE(block.findings.push(finding));
      // A block holds fewer items than there are, so each has some of them.
      for (std::size_t id = 0; id < 10; ++id) {
        Item item;
        item.id = static_cast<ItemId>((id + 4 * source) % kItemCount);
        item.value = 380.9;
        item.upper = id % 2 == 0 ? 380.5 : kNoValue;
        item.U = 0.05;
        item.companion = 0.5;
        item.budget.fill(0.01);
        item.verdict = block.verdict;
        EXPECT_TRUE(block.items.push(item));
      }
      PlcResult record;
      record.kind = 1;
      record.res_seq = static_cast<std::uint16_t>(100 * key + attempt.station);
      record.station = attempt.station;
      apply(BlockJob{key, 1, block, record});
    }
    attempt.station = 10;
    apply(FailedAttemptJob{attempt, 402});
    attempt.station = 11;
    apply(AcquiredJob{attempt});
    SlabResult slab;
    slab.verdict = verdict;
    slab.reason = reason;
    if (verdict != Verdict::aborted) {
      slab.fit.ok = true;
      slab.fit.seats = 7;
      slab.fit.rms_mm = slab.fit.plain_rms_mm = 0.1;
      slab.fit.note.assign("top rolled +0.076 deg to the seats; seat 12 off by 3.00 mm in X");
      Item height;
      height.id = ItemId::seat_vertical;
      height.station = 3;
      height.value = 1.0;
      height.upper = 0.5;
      height.verdict = Verdict::fail;
      EXPECT_TRUE(slab.items.push(height));
    }
    PlcResult record;
    record.kind = 2;
    record.res_seq = static_cast<std::uint16_t>(100 * key + 99);
    apply(SlabJob{key, slab, record, 1'763'681'999'000'000});
  }

  std::unique_ptr<storage::Store> store_;
  SlabHeader header_;
};

TEST_F(ShowChinese, a_passed_a_failed_and_an_aborted_slab) {
  store(1, Verdict::pass, 0);
  header_.guard = 1.0;
  store(2, Verdict::fail, 604);
  header_.emulated = 0;
  store(3, Verdict::aborted, 110);
  const auto shown = [&](const std::string& more) {
    const Ended ended = run("show " + more + " --language zh --db " + file("slabd.db"));
    EXPECT_EQ(ended.status, kDone) << ended.err;
    expect_chinese(ended.out);
    return ended.out;
  };
  for (const std::string key : {"key:1", "key:2", "key:3"}) {
    shown(key);
    shown(key + " --full");
    for (const char* block : {"1", "2", "3", "5", "7", "10", "11", "12"}) shown(key + " --block " + block);
  }
  expect_mentions(shown("key:1"), "结论 + 合格");
  expect_mentions(shown("key:2"), "结论 X 不合格");
  expect_mentions(shown("key:3"), "该板已中止");
  expect_mentions(shown("key:1"), "警告：板顶面相对承轨面侧倾 +0.076°；承轨面 12 在 X 方向偏 3.00 mm");
  expect_mentions(shown("key:1 --block 2"), "请让扫描仪多写几位小数；相邻点的噪声相关（1.0，");
  expect_mentions(shown("key:2 --block 1"), "承轨面坡度 [deg]");
  EXPECT_EQ(run("show key:2 --json --language zh --db " + file("slabd.db")).out,
            run("show key:2 --json --db " + file("slabd.db")).out);
  // Sentences of documents are Chinese only if --language asks for it; keys, names and numbers are the same.
  std::size_t differing = 0;
  for (const std::string command : {"yield", "trend", "trend seat_slope", "compare key:1 key:2 --all"}) {
    const std::string question = command + " --json --db " + file("slabd.db");
    const std::string english = run(question).out;
    const std::string chinese = run(question + " --language zh").out;
    differing += chinese != english ? 1U : 0U;
    ::setenv("SLABD_LANGUAGE", "zh", 1);
    EXPECT_EQ(run(question).out, english) << command;
    ::unsetenv("SLABD_LANGUAGE");
    const json en = json::parse(english).flatten();
    const json zh = json::parse(chinese).flatten();
    ASSERT_EQ(en.size(), zh.size()) << command;
    for (const auto& [key, value] : zh.items()) {
      const bool is_sentence = key.ends_with("/main_reason") || key.ends_with("/note") || key.ends_with("_reason");
      if (is_sentence && value.is_string() && value != "")
        EXPECT_NE(value, en[key]) << command << key;
      else
        EXPECT_EQ(value, en[key]) << command << key;
    }
  }
  EXPECT_GE(differing, 2U);
  const Ended unknown = run("show 77 --language zh --db " + file("slabd.db"));
  EXPECT_EQ(unknown.status, kBadInput);
  expect_chinese(unknown.err);
}

TEST_F(Language, doctor_is_chinese_in_all_its_checks) {
  const std::string recipes = places::source_dir() + "/recipes";
  const auto config = [&](const std::string& plc, const std::string& scanner) {
    return write("slabd.toml",
                 "[plc]\n" + plc +
                     "unit_id = 1\nword_order = \"abcd\"\n"
                     "[robot]\nlcm_url = \"udpm://239.255.76.67:7667?ttl=0\"\nchannel = \"FLANGE_POSE\"\n"
                     "interface = \"lo\"\n[scanner]\n" +
                     scanner + "[storage]\ndb = \"slabd.db\"\nspool_dir = \"spool\"\n[recipes]\ndir = \"" + recipes +
                     "\"\n[cell]\nT_base_slab = [1800.0, 0.0, 400.0, 1.0, 0.0, 0.0, 0.0]\n"
                     "[control]\nsocket = \"c.sock\"\n");
  };
  const std::string server = "role = \"server\"\nlisten = \"127.0.0.1:1502\"\nallow = [\"127.0.0.0/8\"]\n";
  const std::string client = "role = \"client\"\nconnect = \"127.0.0.1:1503\"\n";
  const std::string serial = "role = \"rtu\"\ndevice = \"/dev/null\"\n";
  const std::string drop = "backend = \"drop\"\ndrop_dir = \"drop\"\n";
  const auto look = [&](const std::string& plc) {
    const Ended ended = run("doctor --language zh --listen-s 0.5 --config " + config(plc, drop));
    EXPECT_NE(ended.status, kUsage) << ended.err;
    expect_chinese(ended.out);
    EXPECT_EQ(ended.err, "");
    return ended.out;
  };
  expect_mentions(look(server), "没有应答");
  look(client);
  look(serial);
  {
    const FakeDaemon daemon(file("c.sock"), troubled().dump() + "\n");
    const std::string text = look(server);
    expect_mentions(text, "故障 503");
    expect_mentions(text, "未通过");
    expect_mentions(text, "结论依赖于未经确认的公称值或公差");
  }
  const Ended broken = run("doctor --language zh --config " + write("broken.toml", "[plc]\nrole = 7\n"));
  EXPECT_EQ(broken.status, kBadInput);
  expect_chinese(broken.out);
  const json finding =
      json::parse(run("doctor --json --language zh --config " + file("broken.toml")).out)["findings"][0];
  EXPECT_EQ(finding["check"], "configuration");
  expect_chinese(finding["cure"]);
  EXPECT_NE(finding["cure"],
            json::parse(run("doctor --json --config " + file("broken.toml")).out)["findings"][0]["cure"]);
}

}  // namespace
}  // namespace slabd::cli
