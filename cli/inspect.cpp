// SPDX-License-Identifier: Apache-2.0
//
// slabctl inspect: measures one block offline with daemon::measure_block, as every scan of the line.
#include <fmt/core.h>
#include <cmath>
#include <cstdio>
#include <cstring>
#include <memory>
#include <optional>
#include <span>

#include "algo/algo.h"
#include "base/durable.h"
#include "base/pages.h"
#include "cli/command.h"
#include "cli/exit.h"
#include "cli/terminal/arguments.h"
#include "cli/terminal/parse.h"
#include "cli/terminal/progress.h"
#include "cli/terminal/render.h"
#include "cli/terminal/say.h"
#include "daemon/measure.h"
#include "report/figures.h"
#include "report/json.h"

namespace slabd::cli {
namespace {

struct Options {
  std::string scan;
  std::string recipe;
  int block = 0;
  std::string T_block_scanner;
  ScanFormOptions form;
  int threads = config::default_measure_threads();
  std::string deviation_map;
  LanguageOption language;
  bool json = false;
};

std::string as_json(const Options& options, const Recipe& recipe, const Pose& T_block_scanner,
                    const BlockResult& block) {
  report::Json json("slabd.inspection/1");
  json.field("software", daemon::software_version()).field("file", options.scan).field("block", options.block);
  json.key("recipe").begin_object().field("name", recipe.name).field("sha256", recipe.sha256);
  json.field("guard", recipe.guard).field("unconfirmed", unconfirmed_count(recipe)).end_object();
  json.field("T_block_scanner_start", T_block_scanner);
  report::write_block(json, block, recipe.evaluation.cell_mm);
  json.field("not_visible", report::kNotVisible);
  return json.text();
}

std::string report_text(const Options& options, const Recipe& recipe, const BlockResult& block) {
  std::string text;
  const report::Style style = style_for(stdout);
  text += say("{}  block {}  recipe {}{}\n", options.scan, options.block, recipe.name.view(),
              recipe.guard == 0.0 ? say("  (simple acceptance: no guard band)") : "");
  text += say("points {} read, {} finite, {} isolated, {} kept\n", block.scan.points_read, block.scan.points_finite,
              block.scan.isolated_removed, block.scan.points_kept);
  const RegistrationReport& registration = block.registration;
  text += say("registration {} after {} iterations", translated(name(registration.status)), registration.iterations);
  if (!registration.note.empty()) text += fmt::format(" ({})", retold(registration.note.view()));
  if (has_value(registration.deviation.std_mm))
    text += say(", deviation {:.3f} +- {:.3f} mm over {} points", registration.deviation.mean_mm,
                registration.deviation.std_mm, registration.deviation.count);
  const Vec3& normal = block.seat.normal_datum;
  text += "\n";
  if (!normal.isZero())
    text += say("seat normal ({:.6f}, {:.6f}, {:.6f}), {} grid points\n", normal.x(), normal.y(), normal.z(),
                block.seat.grid_points);
  text += seat_notes(block.seat, recipe.evaluation.cell_mm) + surface_lines(block);
  text += fmt::format("\n{}\n", item_table(std::span<const Item>(block.items.begin(), block.items.size()), style));
  const std::string verdict = report::verdict_text(block.verdict, style);
  text += block.reason != 0 ? say("block {}: {}  ({})\n", options.block, verdict, reason_text(block.reason))
                            : say("block {}: {}\n", options.block, verdict);
  text += say("{:.0f} ms: read {:.0f}, denoise {:.0f}, register {:.0f}, extract {:.0f}\n", block.times.total_ms,
              block.times.read_ms, block.times.denoise_ms, block.times.register_ms, block.times.extract_ms);
  text += fmt::format("{}\n", translated(report::kNotVisible));
  return text;
}

/// Writes one line for each cell with points.
void write_deviation_map(const std::string& path, const algo::DeviationMap& map) {
  std::string text = "x_mm,y_mm,deviation_mm,points\n";
  for (std::size_t row = 0; row < map.rows; ++row) {
    for (std::size_t column = 0; column < map.columns; ++column) {
      const std::size_t cell = row * map.columns + column;
      if (map.count[cell] == 0) continue;
      text += fmt::format("{:g},{:g},{:.6f},{}\n", map.x_mm(column), map.y_mm(row), map.mean_mm(cell), map.count[cell]);
    }
  }
  OutFile file(path);
  file.write(text);
  const Status written = file.close();
  if (!written) stop(kBadInput, fmt::format("--deviation-map {}", written.error().text.view()));
}

int inspect(const Options& options) {
  set_language(options.language, options.json);
  const Recipe recipe = recipe_from(options.recipe);
  if (options.block < 1 || options.block > recipe.stations())
    stop(kUsage, say("--block {}: recipe {} has blocks 1..{}", options.block, recipe.name.view(), recipe.stations()));
  Pose T_block_scanner = nominal_T_block_scanner();
  if (!options.T_block_scanner.empty()) {
    const Result<Pose> pose = parse_pose(options.T_block_scanner);
    if (!pose) stop(kUsage, fmt::format("--T-block-scanner: {}", pose.error().text.view()));
    T_block_scanner = pose.value();
  }
  warn_unconfirmed(recipe);

  std::optional<ProgressNote> note(std::in_place, stderr, say("measuring ..."), std::chrono::seconds(1));
  const std::unique_ptr<hal::Clock> clock = hal::make_system_clock();
  Pages memory(limits::kScanSlotBytes);
  const std::span<float> xyz = memory.take<float>(limits::kScanPointsMax * 3);
  const std::int64_t read_start_ns = clock->mono_ns();
  Team readers(options.threads);
  const ScanShape shape = need(hal::read_scan(options.scan.c_str(), options.form.form(), xyz, readers), kBadInput);
  if (shape.finite == 0) stop(kBadInput, say("{}: none of its {} points is finite", options.scan, shape.points));
  const double read_ms = ms_from_ns(clock->mono_ns() - read_start_ns);

  algo::BlockInspector inspector(options.threads);
  inspector.use(recipe);
  algo::Cloud cloud;
  cloud.xyz = xyz;
  cloud.points = shape.points;
  cloud.width = shape.width;
  cloud.height = shape.height;
  const Status status =
      daemon::measure_block(inspector, *clock, options.block, Pose::identity(), T_block_scanner, cloud, shape, read_ms);
  note.reset();
  if (!status) complain(fmt::format("{}: {}", options.scan, retold(status.error().text.view())));
  const BlockResult& block = inspector.result();
  if (status.ok())
    if (const auto warning = scan_warning(block.scan); !warning.empty())
      complain(say("warning: {}: {}", options.scan, retold(warning.view())));
  fmt::print("{}",
             options.json ? as_json(options, recipe, T_block_scanner, block) : report_text(options, recipe, block));
  if (!options.deviation_map.empty()) {
    if (block.registration.status != RegistrationStatus::converged)
      complain(say("--deviation-map {}: not written, the block was not found", options.deviation_map));
    else
      write_deviation_map(options.deviation_map, inspector.deviation_map());
  }
  return block.verdict == Verdict::pass ? kDone : kNotPass;
}

}  // namespace

void add_inspect(args::Command& app) {
  auto options = std::make_shared<Options>();
  args::Command command = app.add_subcommand("inspect", "Measure one block in a scan file, as the daemon would");
  command->footer(
      "\nThe slope is measured against the local slab top. Items that need the whole slab are not listed.\n\n"
      "Scans: PLY (ascii, binary of either byte order), PCD 0.6 and 0.7 (ascii, binary, binary_compressed), and "
      "tables\n"
      "of x y z (XYZ, ASC, TXT, CSV: blanks, tabs, commas or semicolons; # and // comments; perhaps a line of names).\n"
      "Points are taken in the frame they are stored in, as the scanner's, +Z towards the part.\n\n"
      "Example: slabctl inspect scan.ply --recipe p5600.toml --block 3 --json");
  command
      ->add_option("SCAN", options->scan,
                   "Scan file: .ply or .pcd (ascii, binary, binary_compressed), .xyz .asc .txt .csv")
      ->required();
  command->add_option("--recipe", options->recipe, "Recipe of the slab type")->required();
  command->add_option("--block", options->block, "Block number on the slab, from 1")->required();
  command->add_option("--T-block-scanner", options->T_block_scanner,
                      "Pose of the scanner, \"x y z qw qx qy qz\" in mm and a unit quaternion, in the block's frame "
                      "(default 600 mm above, looking down)");
  options->form.add_to(*command);
  command->add_option("--threads", options->threads, "Threads that measure; the results are the same")
      ->check(args::range(1, 2))
      ->capture_default_str();
  command->add_option("--deviation-map", options->deviation_map,
                      "Write how far the scan lies from the recipe's block, place by place, to this CSV file: x_mm, "
                      "y_mm (block frame), deviation_mm (mean; positive is too high), points (one in sixteen is "
                      "taken); places without points are left out");
  options->language.add_to(*command, "Language of the text");
  command->add_flag("--json", options->json, "Print slabd.inspection/1 on stdout");
  command->runs([options] { return inspect(*options); });
}

}  // namespace slabd::cli
