// SPDX-License-Identifier: Apache-2.0
//
// Gauges on the whole line: an instrument, a hub and the PLC, with each fault that the emulator plays.
#include <gtest/gtest.h>

#include <chrono>
#include <fstream>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "processes.h"
#include "storage/storage.h"
#include "tests/places/places.h"
#include "tests/places/ports.h"

namespace slabd::line {
namespace {

using nlohmann::json;

// The bottom: two heights and their difference, which is small also in a wrong unit.
constexpr const char* kItems = R"toml(
[items.bottom_flatness]
formula = "range(bottom_1, bottom_2)"
nominal = 0
upper = 3.0
required = true
confirmed = true
[items.slab_length]
formula = "mean(length_left, length_right)"
nominal = 5600
tolerance = 3.0
required = true
confirmed = true
[items.slab_thickness]
formula = "mean(thickness)"
nominal = 200
tolerance = 3.0
required = true
confirmed = true
)toml";

struct Gauged {
  std::string name;
  std::string source;
  double master = 0.0;
  double read = 0.0;  ///< its reading of the master
  std::string range;  ///< as in the configuration
};

std::string table(const Gauged& gauge) {
  return "[[gauge]]\nname = \"" + gauge.name + "\"\nunit = \"mm\"\nsource = \"" + gauge.source +
         "\"\nu = 0.08\nmaster = { value = " + std::to_string(gauge.master) +
         ", u = 0.02, every_h = 12, limit = 0.1 }\n" + (gauge.range.empty() ? "" : "range = " + gauge.range + "\n");
}

struct GaugeLine : ::testing::Test {
  void SetUp() override {
    fs::create_directories(box_.dir / "recipes");
    std::ofstream(box_.dir / "recipes/p5600.toml") << read_file(places::source_dir() + "/recipes/p5600.toml") << kItems;
    std::string text = read_file(box_.config);
    const std::string installed = places::source_dir() + "/recipes";
    text.replace(text.find(installed), installed.size(), (box_.dir / "recipes").native());
    const std::string hub = "udp:" + std::to_string(places::own_port());
    gauges_ = {{"length_left", "plc:40", 5600.0, 5600.02, ""},
               {"length_right", "plc:42", 5601.0, 5600.97, ""},
               {"thickness", hub, 200.0, 200.03, ""},
               {"bottom_1", "plc:44", 50.0, 50.01, "[40, 60]"},
               {"bottom_2", "plc:46", 51.0, 51.02, "[40, 60]"}};
    for (const Gauged& gauge : gauges_) text += table(gauge);
    std::ofstream(box_.config) << text;
  }
  /// Stores a master check of each gauge, as if it had been made before slabd started.
  void check_all() {
    storage::StoreSettings settings;
    settings.db_path = box_.dir / "slabd.db";
    settings.spool_dir = box_.dir / "spool";
    auto store = storage::open_store(settings);
    ASSERT_TRUE(store.ok()) << store.error().text.view();
    const std::int64_t now_us =
        std::chrono::duration_cast<std::chrono::microseconds>(std::chrono::system_clock::now().time_since_epoch())
            .count();
    for (const Gauged& gauge : gauges_) {
      storage::KeepGaugeCheck change;
      change.check.gauge = GaugeName(gauge.name);
      change.check.value = gauge.read;
      change.check.master_value = gauge.master;
      change.check.master_u = 0.02;
      change.check.within = 0.1;
      change.check.source = GaugeChannel(gauge.source);
      change.note = {"anna", "", now_us};
      const Result<std::string> id = store.value()->change(change);
      ASSERT_TRUE(id.ok()) << id.error().text.view();
    }
  }
  /// Exit status of a slab that the line inspects with this fault.
  int inspect(int slab_no, const std::string& fault) {
    std::vector<std::string> options{"--casting", "0",
                                     "--move-s",  "0.1",
                                     "--slab-no", std::to_string(slab_no),
                                     "--slab-id", "G-" + std::to_string(slab_no)};
    if (!fault.empty()) options.insert(options.end(), {"--gauge-fault", fault});
    return box_.simulate(options)->wait();
  }
  json stored(int slab_no) const {
    return json::parse(
        box_.slabctl({"show", "--json", "--config", box_.config, "--", "id:G-" + std::to_string(slab_no)}).out, nullptr,
        false);
  }
  static json item(const json& slab, const std::string& id) {
    for (const json& one : slab["items"])
      if (one["id"] == id) return one;
    return {};
  }
  static std::string state(const json& slab, const std::string& name) {
    for (const json& one : slab["gauges"])
      if (one["name"] == name) return one["state"];
    return "not there";
  }
  std::string trouble() const {
    return read_file(box_.dir / "simulate.out") + read_file(box_.dir / "simulate.err") + box_.log();
  }
  Box box_;
  std::vector<Gauged> gauges_;
};

TEST_F(GaugeLine, a_value_counts_for_its_slab_only) {
  check_all();
  box_.start();
  ASSERT_TRUE(box_.ready()) << box_.log();
  EXPECT_EQ(inspect(1, ""), 0) << trouble();
  const json good = stored(1);
  ASSERT_TRUE(good.is_object());
  EXPECT_EQ(good["verdict"], "pass");
  const json length = item(good, "slab_length");
  ASSERT_TRUE(length.is_object());
  EXPECT_EQ(length["verdict"], "pass");
  EXPECT_NEAR(length["value"].get<double>(), 5600.0, 3.0);
  EXPECT_GT(length["U"].get<double>(), 0.1);

  struct Fault {
    const char* fault;
    const char* gauge;
    const char* state;
  };
  int slab_no = 1;
  for (const Fault& played :
       {Fault{"late=length_left", "length_left", "other_slab"}, Fault{"unit=thickness", "thickness", "not_plausible"},
        Fault{"previous=thickness", "thickness", "other_slab"}, Fault{"missing=length_left", "length_left", "missing"},
        Fault{"swapped=length_left,thickness", "thickness", "not_plausible"},
        Fault{"unit=bottom_1", "bottom_1", "out_of_range"}}) {
    EXPECT_NE(inspect(++slab_no, played.fault), 0) << played.fault;
    const json slab = stored(slab_no);
    ASSERT_TRUE(slab.is_object()) << played.fault << trouble();
    EXPECT_EQ(slab["verdict"], "not_measured") << played.fault;
    EXPECT_EQ(slab["reason"], 114) << played.fault;
    EXPECT_EQ(state(slab, played.gauge), played.state) << played.fault << slab["gauges"];
  }

  // The items of gauges are slab items like the others.
  const Box::Answer replayed = box_.slabctl({"replay", "--config", box_.config, "id:G-1", "id:G-3"});
  EXPECT_EQ(replayed.exit_status, 0) << replayed.out << replayed.err;
  const Box::Answer trend = box_.slabctl({"trend", "slab_length", "--json", "--config", box_.config});
  EXPECT_NE(trend.out.find("slab_length"), std::string::npos) << trend.out << trend.err;
  const Box::Answer report =
      box_.slabctl({"report", "--config", box_.config, "id:G-2", "--out", (box_.dir / "report.pdf").native()});
  EXPECT_TRUE(report.exit_status == 0 || report.exit_status == 1) << report.out << report.err;
  EXPECT_GT(fs::file_size(box_.dir / "report.pdf"), 1'000U);
  const Box::Answer history = box_.slabctl({"gauge", "history", "length_left", "--json", "--config", box_.config});
  EXPECT_NE(history.out.find("other_slab"), std::string::npos) << history.out << history.err;
}

}  // namespace
}  // namespace slabd::line
