// SPDX-License-Identifier: Apache-2.0
#include "cli/simulate/simulate_plane.h"

#include <fmt/core.h>
#include <cmath>
#include <filesystem>
#include <fstream>
#include <memory>

#include "cli/command.h"
#include "cli/exit.h"
#include "cli/terminal/arguments.h"
#include "cli/terminal/parse.h"
#include "report/json.h"

namespace slabd::simulate {
namespace {

std::string truth_json(const PlaneOrder& order) {
  cli::Json json("slabd.plane_truth/1");
  json.field("a", 1.0).field("b", 2.0).field("c", 1.0).field("seed", order.seed).field("noise_mm", order.noise_mm);
  json.field("points", order.points).field("outliers", order.outliers);
  return json.text();
}

void write_text(const std::string& path, const std::string& text) {
  std::ofstream file(path, std::ios::binary);
  file << text;
  if (!file.flush()) cli::stop(cli::kNotReachable, fmt::format("{} cannot be written", path));
}

int write_plane(const PlaneOrder& order) {
  const std::filesystem::path path(order.out);
  if (path.extension() != ".xyz")
    cli::stop(cli::kUsage, fmt::format("--out {}: this is written as text; the name must end in .xyz", order.out));
  std::string text;
  for (const Vec3& p : draw_plane(order)) text += fmt::format("{} {} {}\n", p.x(), p.y(), p.z());
  const std::string truth_path = std::filesystem::path(path).replace_extension(".json").string();
  write_text(order.out, text);
  write_text(truth_path, truth_json(order));
  fmt::print("{}: {} points of z = x + 2 y + 1 with {} mm of noise, {} outliers; truth in {}\n", order.out,
             order.points, order.noise_mm, order.outliers, truth_path);
  return cli::kDone;
}

}  // namespace

std::vector<Vec3> draw_plane(const PlaneOrder& order) {
  Prng random(order.seed);
  const Vec3 normal = Vec3(1.0, 2.0, -1.0) / std::sqrt(6.0);
  std::vector<Vec3> points;
  points.reserve(order.points + order.outliers);
  const auto side = [&] { return 2.0 * random.uniform() - 1.0; };
  for (std::size_t i = 0; i < order.points; ++i) {
    const double x = side();
    const double y = side();
    double twelve = 0.0;
    for (int k = 0; k < 12; ++k) twelve += random.uniform();
    points.push_back(Vec3(x, y, x + 2.0 * y + 1.0) + order.noise_mm * (twelve - 6.0) * normal);
  }
  for (std::size_t i = 0; i < order.outliers; ++i) {
    const double x = side();
    const double y = side();
    points.emplace_back(x, y, 6.0 * random.uniform() - 2.0);
  }
  return points;
}

void add_simulate_plane(args::Command& simulate) {
  auto order = std::make_shared<PlaneOrder>();
  args::Command command =
      simulate.add_subcommand("plane", "Write the plane with outliers of the paper's Table 1, and its truth beside it");
  command->footer(
      "\nExample: slabctl simulate plane --out plane.xyz\n"
      "         slabctl fit-plane plane.xyz --compare --threshold 0.03 --set 1 2 1");
  command->add_option("--out", order->out, "Text file to write (.xyz); the truth goes beside it as .json")->required();
  command->add_option("--seed", order->seed, "Decides everything random")->capture_default_str();
  command->add_option("--points", order->points, "Points of the plane")
      ->check(args::range(std::size_t{0}, limits::kScanPointsMax))
      ->capture_default_str();
  command->add_option("--outliers", order->outliers, "Points beside it")
      ->check(args::range(std::size_t{0}, limits::kScanPointsMax))
      ->capture_default_str();
  command->add_option("--noise", order->noise_mm, "Standard deviation along the normal, mm")
      ->check(cli::within(0.0, 100.0))
      ->capture_default_str();
  command->runs([order] { return write_plane(*order); });
}

}  // namespace slabd::simulate
