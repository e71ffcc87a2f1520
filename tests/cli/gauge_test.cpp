// SPDX-License-Identifier: Apache-2.0
//
// slabctl gauge as a process: a check is stored without a running daemon and decides the exit status, the list of a
// running one names what is wrong, and every document follows its schema.
#include <nlohmann/json.hpp>

#include "tests/cli/fake_daemon.h"
#include "tests/cli/slabctl_process.h"
#include "tests/places/places.h"

namespace slabd::cli {
namespace {

using nlohmann::json;

class GaugeCommand : public Slabctl {
 protected:
  /// Validates the documents with the published schemas.
  [[nodiscard]] bool is_valid(const std::string& documents) const {
    return std::system(("/usr/bin/python3 " + places::source_dir() + "/tests/cli/validate_json.py " +
                        places::source_dir() + "/docs/schemas " + documents)
                           .c_str()) == 0;
  }
  [[nodiscard]] std::string config(const std::string& gauges = kGauges) const {
    return write("slabd.toml",
                 "[scanner]\ndrop_dir = \"drop\"\n[storage]\ndb = \"slabd.db\"\nspool_dir = \"spool\"\n"
                 "[recipes]\ndir = \"" +
                     places::source_dir() +
                     "/recipes\"\n[cell]\nT_base_slab = [1800, 0, 300, 1, 0, 0, 0]\n[control]\nsocket = "
                     "\"control.sock\"\n" +
                     gauges);
  }
  [[nodiscard]] Ended gauge(const std::string& more) const { return run("gauge " + more + " --config " + config()); }
  /// An empty database with the tables of this version.
  void make_database() const {
    ASSERT_EQ(run("simulate history --slabs 5 --recipe " + kRecipe + " --out " + file("slabd.db")).status, 0)
        << content(file("err"));
  }
  /// The daemon's answer to "gauges": one gauge that is stuck and overdue, one that is good, one without a master.
  [[nodiscard]] static json answer() {
    const json overdue{{"value", 5600.0},
                       {"u", 0.02},
                       {"limit", 0.1},
                       {"every_h", 24.0},
                       {"state", "check_overdue"},
                       {"check",
                        {{"utime_us", 1'000'000},
                         {"value", 5600.05},
                         {"deviation", 0.05},
                         {"passed", true},
                         {"due_utime_us", 2'000'000}}}};
    json good = overdue;
    good["state"] = "ok";
    good["check"]["due_utime_us"] = 9'000'000'000'000'000;
    json list;
    list["schema"] = "slabd.gauges/1";
    list["slab_no"] = 10042;
    list["gauges"] = json::array();
    for (const auto& [name, source, master] :
         {std::tuple{"length_left", "plc:40", overdue}, std::tuple{"length_right", "plc:42", good},
          std::tuple{"thickness", "operator", json(nullptr)}}) {
      const bool is_good = std::string_view(name) != "length_left";
      list["gauges"].push_back({{"name", name},
                                {"unit", "mm"},
                                {"source", source},
                                {"channel", source},
                                {"u", 0.05},
                                {"valid_s", 60.0},
                                {"value", 5600.1234},
                                {"age_s", 2.0},
                                {"utime_us", 1'700'000'000'000'000},
                                {"seq", 7},
                                {"slab_no", 10042},
                                {"state", is_good ? "ok" : "check_overdue"},
                                {"reason", is_good ? "" : "its master check is overdue"},
                                {"trouble", ""},
                                {"same_slabs", is_good ? 1 : 25},
                                {"stuck", !is_good},
                                {"master", master}});
    }
    list["udp"] = {{"accepted", 0}, {"repeated", 0}, {"unknown", 0}, {"malformed", 0}, {"foreign", 0}};
    return list;
  }

  /// A person's instrument that is checked with a master.
  static constexpr const char* kPersons =
      "[[gauge]]\nname = \"thickness\"\nunit = \"mm\"\nsource = \"operator\"\nu = 0.05\nvalid_s = 600\n"
      "master = { value = 200.0, u = 0.02, every_h = 24, limit = 0.1 }\n";
  static constexpr const char* kGauges =
      "[[gauge]]\nname = \"length_left\"\nunit = \"mm\"\nsource = \"plc:40\"\nu = 0.05\nvalid_s = 60\n"
      "master = { value = 5600.0, u = 0.02, every_h = 24, limit = 0.1 }\n"
      "[[gauge]]\nname = \"length_right\"\nunit = \"mm\"\nsource = \"plc:42\"\nu = 0.05\nvalid_s = 60\n"
      "master = { value = 5601.0, u = 0.02, every_h = 24, limit = 0.1 }\n"
      "[[gauge]]\nname = \"thickness\"\nunit = \"mm\"\nsource = \"operator\"\nu = 0.05\nvalid_s = 600\n";
};

TEST_F(GaugeCommand, a_check_is_stored_and_decides_the_exit_status) {
  make_database();
  const auto check = [&](const std::string& more) {
    return run("gauge check thickness " + more + " --operator anna --config " + config(kPersons));
  };
  const Ended passed = check("--value 200.05 --json");
  ASSERT_EQ(passed.status, 0) << passed.err;
  ASSERT_TRUE(is_valid(write("check.json", passed.out)));
  EXPECT_EQ(json::parse(passed.out)["id"], "thickness-check-1");
  const Ended failed = check("--value 200.2 --why 'after the knock'");
  EXPECT_EQ(failed.status, 1) << failed.err;
  expect_mentions(failed.out, "FAILED");

  const Ended listed = run("gauge history thickness --checks --json --db " + file("slabd.db"));
  ASSERT_EQ(listed.status, 0) << listed.err;
  ASSERT_TRUE(is_valid(write("checks.json", listed.out)));
  const json checks = json::parse(listed.out)["checks"];
  ASSERT_EQ(checks.size(), 2U);
  EXPECT_EQ(checks[0]["result"], "failed");
  EXPECT_EQ(checks[0]["reason"], "after the knock");
  EXPECT_EQ(checks[1]["operator"], "anna");
  const Ended none = run("gauge history thickness --json --db " + file("slabd.db"));
  ASSERT_EQ(none.status, 0) << none.err;
  ASSERT_TRUE(is_valid(write("values.json", none.out)));
  EXPECT_EQ(run("db check --config " + config()).status, 0);
}

TEST_F(GaugeCommand, a_typed_value_is_scaled_as_an_entered_one) {
  make_database();
  std::string scaled = kPersons;
  scaled.replace(scaled.find("u = 0.05"), 8, "u = 0.05\nscale = 25.4");
  const auto check = [&](const std::string& value) {
    return run("gauge check thickness --value " + value + " --json --config " + config(scaled));
  };
  const Ended passed = check("7.874");  // 199.9996 mm
  EXPECT_EQ(passed.status, 0) << passed.err;
  EXPECT_NEAR(json::parse(passed.out)["value"].get<double>(), 199.9996, 1e-9);
  EXPECT_EQ(check("200").status, 1) << "the number of another scale";
}

TEST_F(GaugeCommand, a_check_of_another_gauge_is_refused_with_its_reason) {
  make_database();
  for (const auto& [arguments, status, words] :
       {std::tuple{"check length_lift --value 1", 2, "did you mean length_left?"},
        std::tuple{"check thickness --value 200", 2, "thickness has no master in the configuration"},
        std::tuple{"check length_left --value 5600", 2, "slabd reads length_left itself (plc:40)"},
        std::tuple{"check length_left", 4, "control.sock"}}) {
    const Ended ended = gauge(arguments);
    EXPECT_EQ(ended.status, status) << arguments << ": " << ended.err;
    expect_mentions(ended.err, words);
  }
  const Ended nameless = run("gauge check thickness --value 200 --operator ' ' --config " + config(kPersons));
  EXPECT_EQ(nameless.status, 3) << nameless.err;
  expect_mentions(nameless.err, "give the name of the operator");
  const Ended none = run("gauge check length_left --value 1 --config " + config(""));
  EXPECT_EQ(none.status, 2);
  expect_mentions(none.err, "there is no [[gauge]]");
}

TEST_F(GaugeCommand, the_value_of_a_slab_is_not_that_of_the_master) {
  make_database();
  const auto check = [&](const std::string& gauges, const json& now) {
    const FakeDaemon daemon(file("control.sock"), now.dump() + "\n");
    return run("gauge check length_left --operator anna --config " + config(gauges));
  };
  const std::string scaled = std::string(kGauges).insert(std::string_view(kGauges).find("u = "), "scale = 0.9995\n");
  std::string instrument = kGauges;
  instrument.replace(instrument.find("plc:40"), 6, "modbus:10.0.0.5:502/1/120");
  const Ended of_slab = check(kGauges, answer());
  EXPECT_EQ(of_slab.status, 6) << of_slab.err;
  expect_mentions(of_slab.err,
                  "the newest value of length_left is of slab 10042: send the master's value with SLAB_NO 0");
  json now = answer();
  now["gauges"][0]["slab_no"] = 0;
  const Ended other = check(scaled, now);
  EXPECT_EQ(other.status, 3) << other.err;
  expect_mentions(other.err, "reads length_left from plc:40, and the configuration has plc:40 x0.9995: restart it");
  now["gauges"][0]["channel"] = "modbus:10.0.0.5:502/1/120 i32";
  const Ended open = check(instrument, now);
  EXPECT_EQ(open.status, 6) << open.err;
  expect_mentions(open.err, "slab 10042 is open, and the master's value would count for it");
}

TEST_F(GaugeCommand, the_list_names_an_overdue_master_and_a_stuck_sensor) {
  const std::string text = answer().dump();
  ASSERT_TRUE(is_valid(write("gauges.json", text)));
  const FakeDaemon daemon(file("control.sock"), text + "\n");
  const Ended listed = gauge("list");
  EXPECT_EQ(listed.status, 1) << listed.err;
  expect_mentions(listed.out, "overdue by");
  expect_mentions(listed.out, "length_left has given the same value for 25 slabs");
  expect_mentions(listed.out, "without a master");
  EXPECT_EQ(json::parse(gauge("list --json").out), answer());
}

TEST_F(GaugeCommand, without_a_daemon_the_list_and_an_entry_say_so) {
  for (const char* arguments : {"list", "enter thickness 200.2 --slab-no 10042"}) {
    const Ended ended = gauge(arguments);
    EXPECT_EQ(ended.status, 4) << arguments;
    expect_mentions(ended.err, "control.sock");
  }
  EXPECT_EQ(gauge("enter thickness 200.2").status, 2) << "a value without a slab is not entered";
}

}  // namespace
}  // namespace slabd::cli
