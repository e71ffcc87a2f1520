// SPDX-License-Identifier: Apache-2.0
//
// slabctl scanner verify: the scanner against a plate and a ball, and what follows for the uncertainty budget.
#include <fmt/core.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <chrono>
#include <cmath>
#include <filesystem>
#include <functional>
#include <memory>

#include "cli/command.h"
#include "cli/durable.h"
#include "cli/exit.h"
#include "cli/json.h"
#include "cli/progress.h"
#include "cli/scanner/acceptance.h"
#include "cli/scanner/scanner.h"
#include "hal/hal.h"

namespace slabd::cli {
namespace {

struct Options {
  std::vector<std::string> plates;
  std::vector<std::string> balls;
  double diameter_mm = kNoValue;
  std::size_t unit = 0;
  AcceptanceSettings settings;
  double limit_pf_mm = kNoValue;
  double limit_ps_mm = kNoValue;
  double limit_rf_mm = kNoValue;
  std::string scanner;
  std::string out;
  std::string config;
  bool keep = false;
  bool as_json = false;
};

struct Plate {
  std::string file;
  PlateFigures figures;
};
struct Ball {
  std::string file;
  BallFigures figures;
};

struct Findings {
  std::vector<Plate> plates;
  std::vector<Ball> balls;
};

/// The guideline asks for the ball in at least ten places of the volume, the plate in six.
constexpr std::size_t kBallPlaces = 10;
constexpr std::size_t kPlatePlaces = 6;

std::int64_t now_us() {
  return std::chrono::duration_cast<std::chrono::microseconds>(std::chrono::system_clock::now().time_since_epoch())
      .count();
}

template <typename List, typename Value>
double worst(const List& list, Value value) {
  double most = kNoValue;
  for (const auto& item : list) most = std::isnan(most) ? value(item) : std::max(most, value(item));
  return most;
}

double worst_pf(const Findings& f) {
  return worst(f.balls, [](const Ball& b) { return b.figures.PF_mm; });
}
double worst_ps(const Findings& f) {
  return worst(f.balls, [](const Ball& b) { return std::abs(b.figures.PS_mm); });
}
double worst_rf(const Findings& f) {
  return worst(f.plates, [](const Plate& p) { return p.figures.RF_mm; });
}
double worst_form(const Findings& f) {
  return worst(f.plates, [](const Plate& p) { return p.figures.form_half_mm; });
}

bool within(double value, double limit) {
  return std::isnan(limit) || value <= limit;  // a figure that is NaN is not within its limit
}
bool passes(const Options& options, const Findings& f) {
  return within(worst_pf(f), options.limit_pf_mm) && within(worst_ps(f), options.limit_ps_mm) &&
         within(worst_rf(f), options.limit_rf_mm);
}

/// Reads each file and judges it; false: printed.
bool each(
    const std::vector<std::string>& files, hal::LengthUnit unit,
    const std::function<std::optional<Error>(const std::string&, std::span<const float>, const ScanShape&)>& judge,
    int& exit_status) {
  std::vector<float> xyz(3 * limits::kScanPointsMax);
  ProgressCount progress(stderr, files.size());
  for (const std::string& file : files) {
    progress.next(file);
    const Result<ScanShape> shape = hal::read_scan(file.c_str(), unit, std::span<float>(xyz));
    if (!shape) {
      complain(shape.error().text.view());
      exit_status = kBadInput;
      return false;
    }
    if (const std::optional<Error> why = judge(file, std::span(xyz).first(3 * shape.value().points), shape.value())) {
      complain(fmt::format("{}: {}", file, why->text.view()));
      exit_status = kBadInput;
      return false;
    }
  }
  return true;
}

std::string figure(double value, const char* format = "{:.4f}") {
  return std::isnan(value) ? "-" : fmt::format(fmt::runtime(format), value);
}

/// What the recipe's [uncertainty] says from now on: the worst form that was seen, and the shortest length a plate was
/// seen over, because the same form over less length tilts more.
std::string budget_lines(const Findings& f) {
  if (f.plates.empty()) return "";
  const double length = -worst(f.plates, [](const Plate& p) { return -p.figures.length_mm; });
  return fmt::format(
      "scanner_form_mm = {{ value = {:.4f}, confirmed = true }}\n"
      "scanner_form_length_mm = {{ value = {:.0f}, confirmed = true }}\n",
      worst_form(f), length);
}

void print(const Options& options, const Findings& f) {
  for (const Plate& p : f.plates)
    fmt::print(
        "plate {}\n  RF {} mm of {} points ({} left out), rms {} mm over {:.0f} mm\n  form +-{} mm; noise {} mm, "
        "correlated over {} mm (points every {} mm)\n",
        p.file, figure(p.figures.RF_mm), p.figures.points, p.figures.rejected, figure(p.figures.rms_mm),
        p.figures.length_mm, figure(p.figures.form_half_mm), figure(p.figures.noise.sigma_mm),
        figure(p.figures.noise.correlation_mm, "{:.2f}"), figure(p.figures.noise.pitch_mm, "{:.3f}"));
  for (const Ball& b : f.balls)
    fmt::print("ball {}\n  PF {} mm, PS {} mm of {} points ({} left out), rms {} mm at ({:.1f}, {:.1f}, {:.1f})\n",
               b.file, figure(b.figures.PF_mm), figure(b.figures.PS_mm, "{:+.4f}"), b.figures.points,
               b.figures.rejected, figure(b.figures.rms_mm), b.figures.centre_mm.x(), b.figures.centre_mm.y(),
               b.figures.centre_mm.z());
  fmt::print("worst: PF {} mm, |PS| {} mm, RF {} mm{}\n", figure(worst_pf(f)), figure(worst_ps(f)), figure(worst_rf(f)),
             passes(options, f) ? "" : "  OUT OF LIMITS");
  if (!f.balls.empty() && f.balls.size() < kBallPlaces)
    complain(fmt::format("warning: VDI/VDE 2634-2 asks for the ball in {} places of the volume, here are {}",
                         kBallPlaces, f.balls.size()));
  if (!f.plates.empty() && f.plates.size() < kPlatePlaces)
    complain(fmt::format("warning: VDI/VDE 2634-2 asks for the plate in {} places of the volume, here are {}",
                         kPlatePlaces, f.plates.size()));
  if (const std::string lines = budget_lines(f); !lines.empty())
    fmt::print("\nfor [uncertainty] of the recipe:\n{}", lines);
}

std::string json_of(const Options& options, const Findings& f) {
  Json json;
  json.begin_object().field("schema", "slabd.scanner_verification/1").field("scanner", options.scanner);
  write_time(json, "utc", now_us());
  json.field("software", daemon::software_version().view()).field("diameter_mm", options.diameter_mm);
  json.field("PF_mm", worst_pf(f)).field("PS_abs_mm", worst_ps(f)).field("RF_mm", worst_rf(f));
  json.field("form_half_mm", worst_form(f)).field("within_limits", passes(options, f));
  json.field("limit_PF_mm", options.limit_pf_mm).field("limit_PS_mm", options.limit_ps_mm);
  json.field("limit_RF_mm", options.limit_rf_mm).field("uncertainty", budget_lines(f));
  json.key("plates").begin_array();
  for (const Plate& p : f.plates) {
    json.begin_object().field("file", p.file).field("points", p.figures.points).field("rejected", p.figures.rejected);
    json.field("length_mm", p.figures.length_mm).field("RF_mm", p.figures.RF_mm).field("rms_mm", p.figures.rms_mm);
    json.field("form_half_mm", p.figures.form_half_mm).field("noise_sigma_mm", p.figures.noise.sigma_mm);
    json.field("noise_correlation_mm", p.figures.noise.correlation_mm).field("pitch_mm", p.figures.noise.pitch_mm);
    json.end_object();
  }
  json.end_array().key("balls").begin_array();
  for (const Ball& b : f.balls) {
    const std::array<double, 3> centre = {b.figures.centre_mm.x(), b.figures.centre_mm.y(), b.figures.centre_mm.z()};
    json.begin_object().field("file", b.file).field("points", b.figures.points).field("rejected", b.figures.rejected);
    json.field("centre_mm", std::span<const double>(centre)).field("diameter_mm", 2.0 * b.figures.radius_mm);
    json.field("PF_mm", b.figures.PF_mm).field("PS_mm", b.figures.PS_mm).field("rms_mm", b.figures.rms_mm).end_object();
  }
  json.end_array().end_object();
  return json.text();
}

/// Beside the database, under the time it was judged at; nothing there is ever replaced.
bool keep(const std::string& config_path, const std::string& record, int& exit_status) {
  daemon::Config config;
  exit_status = kBadInput;
  if (!config_from(config_path, config)) return false;
  const std::filesystem::path folder = scanner_records(config);
  std::error_code fault;
  std::filesystem::create_directories(folder, fault);
  std::string stamp = iso_time(now_us());
  std::erase_if(stamp, [](char c) { return c == '-' || c == ':'; });
  std::filesystem::path path;
  int number = 0;
  do path = folder / fmt::format("{}-{:02}.json", stamp, ++number);
  while (std::filesystem::exists(path, fault));
  const Status written = write_durably(path.string(), record);
  if (written) {
    fmt::print(stderr, "kept as {}\n", path.string());
    return true;
  }
  complain(written.error().text.view());
  exit_status = kNotReachable;
  return false;
}

int verify(const Options& options) {
  if (options.plates.empty() && options.balls.empty()) {
    complain("nothing to look at: --plate FILE..., --ball FILE... --diameter-mm D");
    return kUsage;
  }
  if (!options.balls.empty() && std::isnan(options.diameter_mm)) {
    complain("--ball needs --diameter-mm, the certified diameter of the ball as coated");
    return kUsage;
  }
  Findings f;
  int exit_status = kDone;
  const auto unit = static_cast<hal::LengthUnit>(options.unit);
  const auto plate = [&](const std::string& file, std::span<const float> xyz,
                         const ScanShape& shape) -> std::optional<Error> {
    const Result<PlateFigures> figures = judge_plate(xyz, shape, options.settings);
    if (!figures) return figures.error();
    f.plates.push_back({file, figures.value()});
    return std::nullopt;
  };
  const auto ball = [&](const std::string& file, std::span<const float> xyz, const ScanShape&) -> std::optional<Error> {
    const Result<BallFigures> figures = judge_ball(xyz, options.diameter_mm, options.settings);
    if (!figures) return figures.error();
    f.balls.push_back({file, figures.value()});
    return std::nullopt;
  };
  if (!each(options.plates, unit, plate, exit_status) || !each(options.balls, unit, ball, exit_status))
    return exit_status;
  const std::string record = json_of(options, f);
  if (!options.out.empty()) {
    if (const Status written = write_durably(options.out, record); !written) {
      complain(written.error().text.view());
      return exit_for(written.error().code);
    }
  }
  if (options.keep && !keep(options.config, record, exit_status)) return exit_status;
  if (options.as_json)
    fmt::print("{}", record);
  else
    print(options, f);
  return passes(options, f) ? kDone : kRefused;
}

}  // namespace

void add_scanner_verify(CLI::App& scanner, int& exit_status) {
  auto options = std::make_shared<Options>();
  CLI::App* command =
      scanner.add_subcommand("verify", "The scanner against a plate and a ball: PF, PS, RF, form, noise");
  command->footer(
      "\nPF, PS and RF as in VDI/VDE 2634 part 2. The form of the plate (what does not average away) is what the\n"
      "recipe's [uncertainty] scanner_form_mm stands for; the lines to put there are printed.\n"
      "Exit status: 0 within the limits given (or none given), 3 a scan does not show what it should, 6 out of "
      "limits.\n"
      "Example: slabctl scanner verify --plate p*.ply --ball b*.ply --diameter-mm 50.0123 --keep");
  command->add_option("--plate", options->plates, "Scans of a flat plate, one place each");
  command->add_option("--ball", options->balls, "Scans of one ball, one place each");
  command->add_option("--diameter-mm", options->diameter_mm, "Certified, of the ball as coated")
      ->check(CLI::Range(2.0, 400.0));
  command->add_option("--unit", options->unit, "Of the files: mm, m, um")
      ->transform(
          CLI::CheckedTransformer(std::vector<std::pair<std::string, std::size_t>>{{"mm", 0}, {"m", 1}, {"um", 2}}));
  command->add_option("--gate-mm", options->settings.gate_mm, "Further from plate or ball than this is something else")
      ->check(CLI::Range(0.05, 20.0))
      ->capture_default_str();
  command->add_option("--limit-pf-mm", options->limit_pf_mm, "PF allowed")->check(CLI::Range(0.0, 10.0));
  command->add_option("--limit-ps-mm", options->limit_ps_mm, "|PS| allowed")->check(CLI::Range(0.0, 10.0));
  command->add_option("--limit-rf-mm", options->limit_rf_mm, "RF allowed")->check(CLI::Range(0.0, 10.0));
  command->add_option("--scanner", options->scanner, "Serial number, for the record");
  command->add_option("--out", options->out, "Write slabd.scanner_verification/1, for the records");
  auto* keeps =
      command->add_flag("--keep", options->keep, "Keep the record beside the database, for `slabctl scanner history`");
  command->add_option("--config", options->config, "With --keep: the daemon's configuration")
      ->default_val(kDefaultConfig)
      ->needs(keeps);
  command->add_flag("--json", options->as_json, "Print slabd.scanner_verification/1");
  command->callback([options, &exit_status] { exit_status = verify(*options); });
}

}  // namespace slabd::cli
