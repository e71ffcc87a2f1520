// SPDX-License-Identifier: Apache-2.0
//
// slabctl fit-plane: the plane extraction of the measuring core on any cloud, and the comparison of the paper's
// Table 1 (this method, the classical RANSAC, plain least squares) on the same points.
#include <fmt/core.h>
#include <array>
#include <cmath>
#include <memory>
#include <vector>

#include "algo/algo.h"
#include "cli/command.h"
#include "cli/exit.h"
#include "cli/terminal/arguments.h"
#include "cli/terminal/parse.h"
#include "cli/terminal/render.h"
#include "hal/hal.h"
#include "report/json.h"

namespace slabd::cli {
namespace {

constexpr std::array<const char*, 3> kMethods = {"improved", "ransac", "lsq"};
/// A plane that is closer to the vertical than this has no useful z = a x + b y + c.
constexpr double kFlatMin = 1e-9;
/// Factor of the inlier share promised by --contamination; a smaller share is another plane, or none.
constexpr double kPromiseKept = 0.8;
constexpr double kThickMax = 1.0 / 3.0;

struct Options {
  std::string file;
  std::string method = kMethods[0];
  double threshold_mm = 0.0;
  double contamination = 0.5;
  double share_min = kNoValue;
  std::uint64_t seed = 1;
  ScanFormOptions form;
  bool compare = false;
  std::vector<double> set;  ///< a b c, for --compare
  bool json = false;

  [[nodiscard]] algo::PlaneSettings settings() const {
    algo::PlaneSettings s;
    s.contamination = contamination;
    s.threshold_mm = threshold_mm;
    s.seed = seed;
    s.inlier_share_min = has_value(share_min) ? share_min : kPromiseKept * (1.0 - contamination);
    return s;
  }
};

struct Cloud {
  std::size_t read = 0;
  std::vector<Vec3> points;  ///< the finite ones, mm
};

/// z = a x + b y + c; NaN for a vertical plane.
struct Explicit {
  double a = kNoValue;
  double b = kNoValue;
  double c = kNoValue;
};

Explicit explicit_form(const PlaneFit& fit) {
  const Vec3& n = fit.normal;
  if (!(std::abs(n.z()) > kFlatMin)) return {};
  return {-n.x() / n.z(), -n.y() / n.z(), fit.offset_mm / n.z()};
}

Result<Cloud> read_cloud(const Options& options) {
  static_assert(sizeof(Vec3) == 3 * sizeof(double), "points are read in place");
  Cloud cloud;
  cloud.points.resize(limits::kScanPointsMax);
  const std::span<double> xyz(cloud.points[0].data(), 3 * cloud.points.size());
  const Result<ScanShape> shape = hal::read_scan(options.file.c_str(), options.form.form(), xyz);
  if (!shape) return shape.error();
  cloud.read = shape.value().points;
  cloud.points.resize(cloud.read);
  std::erase_if(cloud.points, [](const Vec3& p) { return !p.allFinite(); });
  return cloud;
}

/// True if the points do not form a plane. The tilt's standard error times the root of their number is the ratio of
/// thickness to extent: 0.02 for a good plane, 1 for a cube.
bool is_thick(const PlaneFit& plane) {
  const double tilt_sigma = std::sqrt(plane.cov_normal.trace());
  return tilt_sigma * std::sqrt(static_cast<double>(plane.inliers)) > kThickMax;
}

PlaneFit fit(const Options& options, std::string_view method, const Cloud& cloud) {
  const Vec3 up = Vec3::UnitZ();
  if (method == "lsq") return algo::fit_plane_lsq(cloud.points, up);
  if (method == "ransac") return algo::fit_plane_ransac(cloud.points, up, options.settings());
  PlaneFit plane = algo::fit_plane(cloud.points, up, options.settings());
  plane.ok = plane.ok && !is_thick(plane);
  return plane;
}

std::string_view status_word(const PlaneFit& plane) {
  return plane.ok ? "ok" : "not_measured";
}

/// Reason why a plane counts as not measured, as far as the figures show it.
std::string why_not(const Options& options, std::string_view method, const PlaneFit& plane) {
  const double share_min = options.settings().inlier_share_min;
  if (method != "lsq" && plane.inliers >= 3 && plane.inlier_fraction < share_min)
    return fmt::format("the inliers' share is {:.4f}, needed is {:.4f}", plane.inlier_fraction, share_min);
  if (is_thick(plane)) return "the points stand as far from their best plane as they reach along it";
  if (plane.inliers < 3) return fmt::format("{} points make no plane", plane.inliers);
  return fmt::format(
      "the points are not one plane with outliers beside it (the inliers' share is {:.4f}): another surface close by "
      "or "
      "nearly as large, points on a line, or no fixed point after {} refits",
      plane.inlier_fraction, plane.iterations);
}

// ---- one method --------------------------------------------------------------------------------------------------

void write_fit(report::Json& json, std::string_view method, const PlaneFit& plane) {
  const Explicit e = explicit_form(plane);
  json.field("method", method).field("status", status_word(plane)).field("a", e.a).field("b", e.b).field("c", e.c);
  json.field("normal", plane.normal).field("offset_mm", plane.offset_mm).field("inliers", plane.inliers);
  json.field("points", plane.points).field("inlier_fraction", plane.inlier_fraction).field("std_mm", plane.std_mm);
  json.field("iterations", plane.iterations).field("sigma_offset_mm", plane.sigma_offset_mm);
}

void write_setting(report::Json& json, const Options& options, const Cloud& cloud) {
  const algo::PlaneSettings s = options.settings();
  json.field("file", options.file).field("points_read", cloud.read);
  // null: three robust standard deviations
  json.field("threshold_mm", report::only_if(options.threshold_mm > 0.0, options.threshold_mm));
  json.field("contamination", s.contamination).field("confidence", s.confidence);
  json.field("hypotheses", algo::hypotheses_needed(s.contamination, s.confidence, 3));
  json.field("inlier_share_min", s.inlier_share_min).field("seed", s.seed);
}

std::string threshold_text(const Options& options) {
  return options.threshold_mm > 0.0 ? fmt::format("{} mm", options.threshold_mm) : "3 robust sigmas";
}

std::string fit_text(const Options& options, const Cloud& cloud, const PlaneFit& plane) {
  std::string text;
  const algo::PlaneSettings s = options.settings();
  text += fmt::format("{}: {} points, {} finite\n", options.file, cloud.read, cloud.points.size());
  if (options.method == "lsq") {
    text += "method lsq: all points\n";
  } else {
    text += fmt::format("method {}: {} hypotheses for contamination {}, threshold {}, seed {}\n", options.method,
                        algo::hypotheses_needed(s.contamination, s.confidence, 3), s.contamination,
                        threshold_text(options), s.seed);
  }
  const Explicit e = explicit_form(plane);
  if (has_value(e.a)) {
    text += fmt::format("z = a x + b y + c with a = {:.10f}, b = {:.10f}, c = {:.10f}\n", e.a, e.b, e.c);
  } else {
    text += "the plane is vertical: it has no form z = a x + b y + c\n";
  }
  const Vec3& n = plane.normal;
  text += fmt::format("normal ({:.8f}, {:.8f}, {:.8f}), offset {:.6f} mm\n", n.x(), n.y(), n.z(), plane.offset_mm);
  text +=
      fmt::format("{} of {} points are inliers ({:.4f}), std {:.6f} mm, {} {}\n", plane.inliers, plane.points,
                  plane.inlier_fraction, plane.std_mm, plane.iterations, plane.iterations == 1 ? "refit" : "refits");
  return text;
}

int fit_one(const Options& options, const Cloud& cloud) {
  const PlaneFit plane = fit(options, options.method, cloud);
  if (options.json) {
    report::Json json("slabd.plane/1");
    write_fit(json, options.method, plane);
    write_setting(json, options, cloud);
    fmt::print("{}", json.text());
  } else {
    fmt::print("{}", fit_text(options, cloud, plane));
  }
  if (!plane.ok) complain(fmt::format("{}: not measured: {}", options.file, why_not(options, options.method, plane)));
  return plane.ok ? kDone : kNotPass;
}

// ---- the comparison of Table 1 -----------------------------------------------------------------------------------

/// Root mean square of the three parameters' errors.
double rms_error(const Explicit& e, const std::vector<double>& set) {
  const Vec3 off(e.a - set[0], e.b - set[1], e.c - set[2]);
  return std::sqrt(off.squaredNorm() / 3.0);
}

int compare(const Options& options, const Cloud& cloud) {
  const bool known = !options.set.empty();
  report::Json json("slabd.plane_comparison/1");
  write_setting(json, options, cloud);
  json.field("set", report::only_if(known, options.set)).key("methods").begin_array();
  report::Table table{"method", "a", "b", "c", "rms error?", "std mm", "inliers", "status<"};
  if (known)
    table.add("set", report::Cell(options.set[0], 7), report::Cell(options.set[1], 7), report::Cell(options.set[2], 7));
  bool improved_ok = false;
  for (const char* method : {kMethods[2], kMethods[1], kMethods[0]}) {
    const PlaneFit plane = fit(options, method, cloud);
    const Explicit e = explicit_form(plane);
    improved_ok = plane.ok;  // the last method is slabd's
    json.begin_object();
    write_fit(json, method, plane);
    json.field("rms_error", known ? rms_error(e, options.set) : std::nan("")).end_object();
    table.add(method, report::Cell(e.a, 7), report::Cell(e.b, 7), report::Cell(e.c, 7),
              known ? fmt::format("{:.2e}", rms_error(e, options.set)) : "", report::Cell(plane.std_mm, 6),
              plane.inliers, status_word(plane));
  }
  if (options.json) {
    fmt::print("{}", json.text());
  } else {
    fmt::print("{}: {} points, {} finite; threshold {}, contamination {}, seed {}\n\n{}", options.file, cloud.read,
               cloud.points.size(), threshold_text(options), options.contamination, options.seed,
               report::text_of(table));
  }
  return improved_ok ? kDone : kNotPass;
}

int run_fit(const Options& options) {
  const Cloud cloud = need(read_cloud(options), kBadInput);
  return options.compare ? compare(options, cloud) : fit_one(options, cloud);
}

}  // namespace

void add_fit_plane(args::Command& app) {
  auto options = std::make_shared<Options>();
  args::Command command = app.add_subcommand("fit-plane", "Extract a plane from any cloud; compare methods");
  command->footer(
      "\nimproved  hypotheses on a stratified sample, least truncated error, refit to a fixed point (paper 3.1)\n"
      "ransac    the classical one: the best of K planes through three points, as it is\n"
      "lsq       orthogonal least squares over all points\n\n"
      "The normal points to positive z. Exit status: 0 measured, 1 not measured, 2 usage, 3 bad input.\n\n"
      "The paper's Table 1:\n"
      "  slabctl simulate plane --out plane.xyz\n"
      "  slabctl fit-plane plane.xyz --compare --threshold 0.03 --set 1 2 1");
  command->add_option("FILE", options->file, "Cloud: .ply, .pcd, .xyz, .asc, .txt or .csv")->required();
  command->add_option("--method", options->method, "improved, ransac or lsq")
      ->check(args::one_of(std::vector<std::string>(kMethods.begin(), kMethods.end())))
      ->capture_default_str();
  command->add_option("--threshold", options->threshold_mm, "Inlier distance in mm (default 3 robust sigmas)")
      ->check(within(1e-9, 1e6));
  command
      ->add_option("--contamination", options->contamination,
                   "Largest share of outliers expected; decides the number of hypotheses for P = 1 - 1e-6")
      ->check(within(0.0, 0.9))
      ->capture_default_str();
  command
      ->add_option("--share-min", options->share_min,
                   "Share of inliers below which the plane is not measured (default 0.8 (1 - contamination))")
      ->check(within(0.0, 1.0));
  command->add_option("--seed", options->seed, "Seed of the hypotheses, a whole number from 0")->capture_default_str();
  options->form.add_to(*command);
  args::Option both = command->add_flag("--compare", options->compare, "All three methods side by side");
  command->add_option("--set", options->set, "a b c of the plane that was set, printed above the comparison")
      ->expected(3)
      ->check(finite_number())
      ->needs(both);
  command->add_flag("--json", options->json, "Print slabd.plane/1, or slabd.plane_comparison/1, on stdout");
  command->runs([options] { return run_fit(*options); });
}

}  // namespace slabd::cli
