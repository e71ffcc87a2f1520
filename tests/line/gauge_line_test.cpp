// SPDX-License-Identifier: Apache-2.0
//
// Gauges on the whole line: an instrument, a hub and the PLC, with each fault that the emulator plays.
#include <gtest/gtest.h>

#include <fstream>
#include <nlohmann/json.hpp>
#include <string>

#include "processes.h"
#include "tests/places/places.h"
#include "tests/places/ports.h"

namespace slabd::line {
namespace {

using nlohmann::json;

constexpr const char* kItems = R"toml(
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

std::string gauge(const std::string& name, const std::string& source, double master) {
  return "[[gauge]]\nname = \"" + name + "\"\nunit = \"mm\"\nsource = \"" + source +
         "\"\nu = 0.08\nmaster = { value = " + std::to_string(master) + ", u = 0.02, every_h = 12, limit = 0.1 }\n";
}

struct GaugeLine : ::testing::Test {
  void SetUp() override {
    fs::create_directories(box_.dir / "recipes");
    std::ofstream(box_.dir / "recipes/p5600.toml") << read_file(places::source_dir() + "/recipes/p5600.toml") << kItems;
    std::string text = read_file(box_.config);
    const std::string installed = places::source_dir() + "/recipes";
    text.replace(text.find(installed), installed.size(), (box_.dir / "recipes").native());
    std::ofstream(box_.config) << text << gauge("length_left", "plc:40", 5600.0)
                               << gauge("length_right", "plc:42", 5601.0)
                               << gauge("thickness", "udp:" + std::to_string(places::own_port()), 200.0);
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
};

TEST_F(GaugeLine, a_value_counts_for_its_slab_only) {
  box_.start();
  ASSERT_TRUE(box_.ready()) << box_.log();
  for (const auto& [name, value] :
       {std::pair{"length_left", "5600.02"}, {"length_right", "5600.97"}, {"thickness", "200.03"}}) {
    const Box::Answer checked =
        box_.slabctl({"gauge", "check", name, "--value", value, "--operator", "anna", "--config", box_.config});
    ASSERT_EQ(checked.exit_status, 0) << checked.out << checked.err;
  }
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
        Fault{"swapped=length_left,thickness", "thickness", "not_plausible"}}) {
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
