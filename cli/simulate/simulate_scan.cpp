// SPDX-License-Identifier: Apache-2.0
#include "cli/simulate/simulate_scan.h"

#include <fmt/core.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <memory>
#include <optional>

#include "cli/command.h"
#include "cli/exit.h"
#include "cli/simulate/simulate_calibration.h"
#include "cli/terminal/arguments.h"
#include "cli/terminal/parse.h"
#include "emulator/block_drawing.h"
#include "hal/hal.h"
#include "report/json.h"

namespace slabd::cli::simulate {
namespace {

using report::Json;

/// A view off the nominal one by typical errors of robot and slab.
Pose seeded_view(std::uint64_t seed) {
  Prng random(emulator::derived_seed(seed, 4, 0));
  const auto within = [&](double amplitude) { return amplitude * (2.0 * random.uniform() - 1.0); };
  Pose off;
  off.translation_mm = Vec3(within(2.0), within(2.0), within(2.0));
  const double turn_rad = rad_from_deg(0.3);
  off.rotation = rotation_from_kuka_abc(within(turn_rad), within(turn_rad), within(turn_rad));
  return nominal_T_block_scanner() * off;
}

/// Writes fillets, rims, flatness and marks of real concrete.
void write_concrete(report::Json& json, const emulator::ConcreteTruth& truth) {
  json.key("concrete").begin_object().field("flatness_raw", truth.flatness_raw_mm).field("raw_low", truth.raw_low_mm);
  json.field("raw_high", truth.raw_high_mm).field("fillets", truth.fillet_mm).field("chamfer", truth.chamfer_mm);
  json.field("rim_covered", truth.rim_covered);
  json.list("marks", truth.marks, [&](const emulator::PlantedMark& mark) {
    json.field("kind", mark.kind).field("x", mark.x_mm).field("y", mark.y_mm).field("z", mark.z_mm);
    json.field("length", mark.length_mm).field("width", mark.width_mm).field("depth", mark.depth_mm);
    json.field("in_crop", mark.in_crop);
  });
  json.end_object();
}

std::string truth_json(const ScanOrder& order, const Recipe& recipe, const emulator::StationTruth& truth,
                       const Pose& T_scanner_block, const emulator::DrawnBlock& drawn_block) {
  const emulator::DrawnScan& drawn = drawn_block.scan;
  const emulator::BlockTruth& block = truth.block;
  report::Json json("slabd.scan_truth/1");
  json.field("recipe", recipe.name).field("block", order.block).field("seed", order.seed);
  json.field("present", block.present).field("T_scanner_block", T_scanner_block.matrix());
  json.field("slope_deg", deg_from_rad(block.slope_rad)).field("slope_ratio", 1.0 / std::tan(block.slope_rad));
  json.field("jaw_distance", block.jaw_distance_mm).field("jaw_angle_in", deg_from_rad(block.jaw_angle_inner_rad));
  json.field("jaw_angle_out", deg_from_rad(block.jaw_angle_outer_rad)).field("casing_spacing", block.casing_spacing_mm);
  json.field("protrusion_in", block.protrusion_inner_mm).field("protrusion_out", block.protrusion_outer_mm);
  const std::optional<emulator::ConcreteTruth>& concrete = drawn_block.concrete;
  json.field("flatness", concrete ? concrete->flatness_form_mm : emulator::true_flatness_mm(recipe, block));
  json.field("bump", block.bump_mm).field("chip", block.chip_mm).field("burr", block.burr_mm);
  json.field("jaw_shift", block.jaw_shift_mm).field("sunk_seat", block.sunk_mm).field("broken_corner", block.corner_mm);
  json.field("glove", block.glove_s_mm).field("cable", block.cable_x_mm).field("noise", truth.noise_mm);
  json.field("noise_correlation", order.scanner.noise_correlation_mm);
  json.field("perspective", concrete || order.scanner.projection == emulator::Projection::perspective);
  json.field("outlier_share", truth.outlier_share).field("outliers_planted", drawn.outliers);
  json.field("missing", drawn.missing).field("valid", drawn.valid);
  if (concrete) write_concrete(json, *concrete);
  return json.text();
}

/// The requested format, or that of the file's name; it must be readable under that name.
hal::ScanFormat format_of(const ScanOrder& order) {
  const std::optional<hal::ScanFormat> by_name = hal::scan_format_of(order.out);
  if (!by_name)
    cli::stop(cli::kUsage, fmt::format("--out {}: must end in .ply, .pcd, .xyz, .asc, .txt or .csv", order.out));
  if (order.format.empty()) return *by_name;
  const std::optional<hal::ScanFormat> wanted = hal::scan_format_named(order.format);
  if (wanted && hal::extension(*wanted) == hal::extension(*by_name)) return *wanted;
  cli::stop(cli::kUsage, fmt::format("--out {}: --format {} must end in .{}, because readers go by the name", order.out,
                                     order.format, wanted ? hal::extension(*wanted) : "?"));
}

/// Parses --damage, which requires concrete: a polyhedron cannot be damaged.
std::vector<emulator::ConcreteDefect> damage_of(const std::vector<std::string>& texts, bool on_concrete) {
  std::vector<emulator::ConcreteDefect> damage;
  for (const std::string& text : texts) {
    const Result<emulator::ConcreteDefect> one = emulator::parse_concrete_defect(text);
    if (!one || !emulator::is_damage(one.value().kind))
      cli::stop(cli::kUsage, fmt::format("--damage {}: expected NAME or NAME=SIZE, with a name of\n{}", text,
                                         emulator::damage_help()));
    if (!on_concrete) cli::stop(cli::kUsage, fmt::format("--damage {}: needs --surface real or clean", text));
    damage.push_back(one.value());
  }
  return damage;
}

}  // namespace

int write_scan(const ScanOrder& order) {
  const hal::ScanFormat format = format_of(order);
  const Recipe recipe = cli::recipe_from(order.recipe);
  if (order.block < 1 || order.block > recipe.stations())
    cli::stop(cli::kUsage, fmt::format("--block {}: recipe {} has blocks 1..{}", order.block, recipe.name.view(),
                                       recipe.stations()));
  std::vector<emulator::Defect> defects;
  for (const std::string& text : order.defects) {
    defects.push_back(cli::need(emulator::parse_defect(text), cli::kUsage));
  }
  emulator::SlabVariation variation;
  variation.seed = order.seed;
  variation.casting = order.casting;
  const emulator::SlabTruth slab =
      cli::need(emulator::cast_slab(recipe, emulator::Cell{}, variation, defects), cli::kUsage);
  const emulator::StationTruth& truth = slab.at(order.block);
  const Pose T_block_scanner =
      order.nominal_view       ? nominal_T_block_scanner()
      : order.scanner.concrete ? emulator::concrete_view(*order.scanner.concrete, order.seed).T_scanner_block.inverse()
                               : seeded_view(order.seed);
  // The scanner is over the block's nominal position; a block displaced by a defect is off the centre.
  Pose T_nominal_block;
  T_nominal_block.translation_mm = truth.T_slab_block.rotation.conjugate() * truth.offset_slab_mm;
  const Pose T_scanner_block = T_block_scanner.inverse() * T_nominal_block;
  std::vector<float> xyz;
  const Result<emulator::DrawnBlock> block =
      emulator::draw_block(recipe, truth, T_scanner_block, order.scanner,
                           emulator::derived_seed(slab.cast_seed, static_cast<std::uint64_t>(order.block), 0),
                           emulator::derived_seed(order.seed, 5, 0), xyz);
  if (!block) cli::stop(cli::kBadInput, fmt::format("{}: {}", recipe.path.view(), block.error().text.view()));
  const emulator::DrawnScan& drawn = block.value().scan;

  cli::need(hal::write_scan(order.out.c_str(), format, xyz, drawn.width, drawn.height,
                            {.emulator = true, .block = order.block}),
            cli::kNotReachable);
  const std::string truth_path = std::filesystem::path(order.out).replace_extension(".json").string();
  std::ofstream file(truth_path);
  file << truth_json(order, recipe, truth, T_scanner_block, block.value());
  if (!file.flush()) cli::stop(cli::kNotReachable, fmt::format("{} cannot be written", truth_path));
  fmt::print("{}: {} points, {} valid; truth in {}\n", order.out, xyz.size() / 3, drawn.valid, truth_path);
  return cli::kDone;
}

void ScannerOptions::add_to(args::Command& command) {
  command.add_option("--points", points, "Scan size: full (2048 x 2448) or quarter (1024 x 1224)")
      ->check(args::one_of({"full", "quarter"}))
      ->capture_default_str();
  command
      .add_option("--field-x-mm", field_x_mm,
                  "Width of the picture along the rail; a slab's end shows from 2 x 270 mm on, by the recipe")
      ->check(cli::within(100.0, 2'000.0))
      ->capture_default_str();
  command.add_flag("--unorganised", unorganised, "Write only the points that returned, without their grid");
  command.add_flag(
      "--perspective", perspective,
      "Rays from one centre, the scanner's origin, instead of parallel ones: faces hide and throw shadows");
  command
      .add_option("--noise-correlation-mm", noise_correlation_mm,
                  "Noise hangs together over this length along a row (down to 1/e); 0 = every point by itself")
      ->check(cli::within(0.0, 20.0))
      ->capture_default_str();
  command
      .add_option("--noise-shape", noise_shape,
                  "How the correlation falls: gaussian (exp(-r^2/L^2)) or exponential (exp(-(|dx|+|dy|)/L))")
      ->check(args::one_of({"gaussian", "exponential"}))
      ->capture_default_str();
  command
      .add_option("--surface", surface,
                  "The blocks: ideal (polyhedra as drawn), real (real concrete, a real scanner) or clean (few pores, "
                  "little dust); real and clean are always in perspective, their noise is an effect")
      ->check(args::one_of({"ideal", "clean", "real"}))
      ->capture_default_str();
  command
      .add_option("--effect", effects,
                  "Strength of one effect of real concrete, NAME=STRENGTH; 0 off, 1 a good scanner, 3 a bad day; "
                  "repeatable")
      ->take_all()
      ->expected(1)
      ->allow_extra_args(false);
}

std::optional<emulator::EffectStrengths> ScannerOptions::concrete() const {
  const emulator::SurfaceKind kind = cli::need(emulator::surface_named(surface), cli::kUsage);
  if (kind == emulator::SurfaceKind::ideal && effects.empty()) return std::nullopt;
  emulator::EffectStrengths strengths(kind);
  for (const std::string& text : effects)
    if (const std::optional<std::string> refused = strengths.take(text)) cli::stop(cli::kUsage, *refused);
  return strengths;
}

emulator::ScannerTraits ScannerOptions::traits() const {
  emulator::ScannerTraits traits;
  if (points == "quarter") {
    traits.columns /= 2;
    traits.rows /= 2;
  }
  traits.field_x_mm = field_x_mm;
  traits.organised = !unorganised;
  traits.projection = perspective ? emulator::Projection::perspective : emulator::Projection::parallel;
  traits.noise_correlation_mm = noise_correlation_mm;
  traits.noise_shape =
      noise_shape == "exponential" ? emulator::NoiseShape::exponential : emulator::NoiseShape::gaussian;
  return traits;
}

std::vector<std::string> scan_format_names() {
  std::vector<std::string> names;
  for (const hal::ScanFormat format : hal::kScanFormats) names.emplace_back(hal::name(format));
  return names;
}

void add_simulate_scan(args::Command& simulate) {
  struct Options {
    ScanOrder order;
    ScannerOptions scanner;
    std::vector<std::string> damage;
  };
  auto options = std::make_shared<Options>();
  ScanOrder& order = options->order;
  args::Command command = simulate.add_subcommand("scan", "Write one scan of a block and its truth beside it");
  command->footer(
      "\nDefects\n" + emulator::defect_help() + "\nDamage, with its usual size\n" + emulator::damage_help() +
      "\nEffects of real concrete, with their usual strengths\n" + emulator::effect_help() +
      "\nExample: slabctl simulate scan --recipe p5600.toml --block 3 --out scan.ply --defect slope=3:1/37\n"
      "         slabctl simulate scan --recipe p5600.toml --block 3 --out scan.ply --surface real --damage "
      "chip_jaw=12\n"
      "         slabctl simulate scan --recipe p5600.toml --block 3 --out scan.pcd --format pcd-compressed");
  command->add_option("--recipe", order.recipe, "Recipe of the slab type")->required();
  command->add_option("--block", order.block, "Block number on the slab, from 1")->required();
  command->add_option("--out", order.out, "File to write, default: block-K.ply; the truth goes beside it as .json");
  command
      ->add_option("--format", order.format, "How it is written (default: what --out ends in; .asc and .txt are xyz)")
      ->check(args::one_of(scan_format_names()));
  command->add_option("--defect", order.defects, "Planted defect name=K:VALUE, repeatable")
      ->take_all()
      ->expected(1)
      ->allow_extra_args(false);
  command->add_option("--damage", options->damage, "Damage of real concrete, NAME or NAME=SIZE in mm, repeatable")
      ->take_all()
      ->expected(1)
      ->allow_extra_args(false);
  command->add_option("--seed", order.seed, "Decides everything random")->capture_default_str();
  command->add_option("--casting", order.casting, "Scatter of the casting; 0 = exactly as drawn")
      ->check(cli::within(0.0, 10.0))
      ->capture_default_str();
  command->add_flag("--nominal-view", order.nominal_view,
                    "Look from exactly the nominal view, not from up to 2 mm and 0.3 deg off");
  options->scanner.add_to(*command);
  command->runs([options] {
    options->order.scanner = options->scanner.traits();
    options->order.scanner.scanner_seed = options->order.seed;
    options->order.scanner.concrete = options->scanner.concrete();
    options->order.scanner.damage = damage_of(options->damage, options->order.scanner.concrete.has_value());
    ScanOrder& ordered = options->order;
    if (ordered.out.empty()) {
      const std::optional<hal::ScanFormat> format = hal::scan_format_named(ordered.format);
      ordered.out = fmt::format("block-{}.{}", ordered.block, format ? hal::extension(*format) : "ply");
    }
    return write_scan(options->order);
  });
}

namespace {

std::string truth_json(const PlaneOrder& order) {
  report::Json json("slabd.plane_truth/1");
  json.field("a", 1.0).field("b", 2.0).field("c", 1.0).field("seed", order.seed).field("noise_mm", order.noise_mm);
  json.field("points", order.points).field("outliers", order.outliers);
  return json.text();
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
  command->add_option("--out", order->out, "Text file to write (.xyz); the truth goes beside it as .json")
      ->capture_default_str();
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

}  // namespace slabd::cli::simulate
