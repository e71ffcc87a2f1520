// SPDX-License-Identifier: Apache-2.0
//
// Curve slabs and warm slabs on the whole line: sheets in a folder, SLAB_BEGIN, scans, verdict, replay.
#include <gtest/gtest.h>
#include <unistd.h>

#include <algorithm>
#include <fstream>
#include <nlohmann/json.hpp>
#include <string>

#include "processes.h"
#include "tests/places/places.h"

namespace slabd::line {
namespace {

using nlohmann::json;

constexpr const char* kHeading = "slab_id,slab_type,station,dx_mm,dy_mm,dz_mm,dslope_deg\n";

/// A left curve (`sign` 1) or a right one.
std::string sheet(const std::string& id, double sign) {
  std::string text;
  for (int station = 1; station <= 18; ++station) {
    const double along = ((station <= 9 ? station : 19 - station) - 5) / 4.0;
    const double side = station <= 9 ? 1.0 : -1.0;
    text += id + ",5600," + std::to_string(station) + "," + std::to_string(side * sign * 2.0 * along) + "," +
            std::to_string(sign * 6.0 * along * along) + "," + std::to_string(side * sign * 4.0) + "," +
            std::to_string(side * sign * 0.2) + "\n";
  }
  return text;
}

struct CurveLine : ::testing::Test {
  void SetUp() override {
    for (const char* folder : {"recipes", "sheets", "moulds"}) fs::create_directories(box_.dir / folder);
    std::string recipe = read_file(places::source_dir() + "/recipes/p5600.toml");
    recipe.replace(recipe.find("design = \"none\""), 15, "design = \"required\"");
    std::ofstream(box_.dir / "recipes/p5600.toml") << recipe << R"([thermal]
reference_c = { value = 20, confirmed = true }
cte_per_K = { value = 1e-5, confirmed = true }
u_cte_per_K = { value = 1e-6, confirmed = true }
u_temperature_K = { value = 2, confirmed = true }
unknown_range_c = { value = [-10, 50], confirmed = true }
)";
    std::string text = read_file(box_.config);
    const std::string installed = places::source_dir() + "/recipes";
    text.replace(text.find(installed), installed.size(), (box_.dir / "recipes").native());
    std::ofstream(box_.config) << text << "[design]\ndir = \"" << (box_.dir / "sheets").native() << "\"\n";
    std::ofstream(box_.dir / "sheets/order-1.csv") << kHeading << sheet("CURVE-1", 1.0) << sheet("CURVE-2", -1.0);
  }
  /// Exit status of a slab that the line inspects.
  int inspect(std::vector<std::string> options) {
    options.insert(options.end(), {"--casting", "0", "--move-s", "0.1"});
    return box_.simulate(options)->wait();
  }
  json stored(const std::string& id) const {
    return json::parse(box_.slabctl({"show", "--json", "--config", box_.config, "--", "id:" + id}).out, nullptr, false);
  }
  /// Number in a register of slabd's, or -1.
  int shown_to_plc(const std::string& name) const {
    const json image = json::parse(
        box_.slabctl({"plc", "monitor", "--once", "--json", "--socket", (box_.dir / "control.sock").native()}).out,
        nullptr, false);
    for (const json& reg : image.value("registers", json::array()))
      if (reg["name"] == name) return reg["raw"].get<int>();
    return -1;
  }
  Box box_;
};

TEST_F(CurveLine, is_judged_by_its_own_sheet_at_the_reference_temperature) {
  box_.start();
  ASSERT_TRUE(box_.ready()) << box_.log();
  EXPECT_EQ(inspect({"--slab-no", "1", "--slab-id", "CURVE-1", "--slab-temperature", "45"}), 0)
      << read_file(box_.dir / "simulate.out") << box_.log();
  const json slab = stored("CURVE-1");
  ASSERT_TRUE(slab.is_object());
  EXPECT_EQ(slab["verdict"], "pass");
  EXPECT_EQ(slab["design"]["seats"][0]["dz_mm"], 4.0);
  int lengths = 0;
  for (const json& item : slab["items"])
    if (item["id"] == "large_jaw_distance") {
      ++lengths;
      EXPECT_NEAR(item["measured"].get<double>() - item["value"].get<double>(), 1'896.0 * 25e-5, 0.01);
      EXPECT_NEAR(item["deviation"], 0.0, 0.3) << item;
    }
  EXPECT_EQ(lengths, 9);

  // Concrete of the neighbour's mould.
  std::ofstream(box_.dir / "moulds/wrong.csv") << kHeading << sheet("CURVE-2", 1.0);
  EXPECT_NE(inspect({"--slab-no", "2", "--slab-id", "CURVE-2", "--cast-by", (box_.dir / "moulds").native()}), 0);
  const json wrong = stored("CURVE-2")["verdict"];
  EXPECT_TRUE(wrong == "fail" || wrong == "not_measured") << wrong;

  // The decision of quality is next to the verdict, also for the PLC.
  const auto decide = [&](const std::string& which) {
    return box_.slabctl({"disposition", "--config", box_.config, "--decision", "rework", "--reason", "wrong mould",
                         "--authority", "Li Wei", "--", which});
  };
  const Box::Answer decided = decide("id:CURVE-2");
  EXPECT_EQ(decided.exit_status, 0) << decided.err;
  EXPECT_EQ(stored("CURVE-2")["verdict"], wrong) << "what was measured stays";
  EXPECT_EQ(stored("CURVE-2")["dispositions"][0]["decision"], "rework");
  EXPECT_EQ(shown_to_plc("DISPOSITION"), 3);
  EXPECT_EQ(shown_to_plc("DISPOSITION_SEQ"), 1);
  EXPECT_EQ(decide("id:CURVE-1").exit_status, 6) << "it passed";

  EXPECT_NE(inspect({"--slab-no", "3", "--slab-id", "STRAIGHT"}), 0);
  EXPECT_NE(read_file(box_.dir / "simulate.err").find("112"), std::string::npos)
      << read_file(box_.dir / "simulate.err") << read_file(box_.dir / "simulate.out");
  EXPECT_FALSE(stored("STRAIGHT").is_object()) << "never the straight nominal";

  const Box::Answer replayed = box_.slabctl({"replay", "--config", box_.config, "id:CURVE-1", "id:CURVE-2"});
  EXPECT_EQ(replayed.exit_status, 0) << replayed.out << replayed.err;
  const Box::Answer shown = box_.slabctl({"design", "show", "--csv", "--config", box_.config, "CURVE-2"});
  std::ofstream(box_.dir / "shown.csv") << shown.out;
  const Box::Answer checked = box_.slabctl({"design", "check", (box_.dir / "shown.csv").native()});
  EXPECT_EQ(checked.exit_status, 0) << shown.out << checked.err;

  // A model of the stored design is that of its sheet.
  const fs::path cad = fs::path(places::slabctl()).parent_path().parent_path() / "cad/slabd-cad";
  if (!fs::exists(cad))
    GTEST_SKIP() << "slabd-cad is not built: OpenCASCADE is not installed (script/apt-packages-cad)";
  setenv("SLABD_CAD", cad.c_str(), 1);
  const auto model = [&](const std::string& file, const std::vector<std::string>& more) {
    std::vector<std::string> order{"export",    "model",   (box_.dir / "recipes/p5600.toml").native(),
                                   "--slab",    "CURVE-1", "--config",
                                   box_.config, "--out",   (box_.dir / file).native()};
    order.insert(order.end(), more.begin(), more.end());
    const Box::Answer made = box_.slabctl(order);
    EXPECT_EQ(made.exit_status, 0) << made.err;
    const std::string text = read_file(box_.dir / file);
    return text.substr(std::min(text.find("DATA;"), text.size()));  // the header has the time
  };
  const std::string of_sheet = model("sheet.step", {"--sheet", (box_.dir / "sheets/order-1.csv").native()});
  EXPECT_GT(of_sheet.size(), 10'000U);
  EXPECT_EQ(model("stored.step", {}), of_sheet);
}

TEST_F(CurveLine, new_sheets_are_used_without_a_restart_and_faulty_ones_are_named) {
  box_.start();
  ASSERT_TRUE(box_.ready()) << box_.log();
  ASSERT_TRUE(box_.logs("design sheets of 2 slabs are in use")) << box_.log();
  std::ofstream(box_.dir / "sheets/order-2.csv.new") << kHeading << sheet("CURVE-3", 1.0);
  fs::rename(box_.dir / "sheets/order-2.csv.new", box_.dir / "sheets/order-2.csv");
  ASSERT_TRUE(box_.logs("design sheets of 3 slabs are in use")) << box_.log();
  std::ofstream(box_.dir / "sheets/order-3.csv") << kHeading << "CURVE-4,5600,1,0,0,900,0\n";
  ASSERT_TRUE(box_.logs("order-3.csv:2:20: dz_mm: found \"900\", allowed is a number within +-50")) << box_.log();
  const Box::Answer doctor = box_.slabctl({"doctor", "--no-write", "--config", box_.config});
  EXPECT_NE(doctor.out.find("order-3.csv:2:20"), std::string::npos) << doctor.out;
}

}  // namespace
}  // namespace slabd::line
