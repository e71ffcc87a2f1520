// SPDX-License-Identifier: Apache-2.0
//
// slabctl scanner verify: measures the scanner with a plate and a ball; a stored and applied result is used for U.
#include <fmt/core.h>

#include <cmath>
#include <functional>
#include <map>
#include <memory>
#include <optional>

#include "base/durable.h"
#include "cli/client/calibration_change.h"
#include "cli/client/record_options.h"
#include "cli/command.h"
#include "cli/exit.h"
#include "cli/scanner/verification.h"
#include "cli/terminal/arguments.h"
#include "cli/terminal/parse.h"
#include "cli/terminal/progress.h"
#include "hal/hal.h"

namespace slabd::cli {
namespace {

struct Options {
  std::vector<std::string> plates;
  std::vector<std::string> balls;
  ScanFormOptions form{.unit = "", .columns = ""};  ///< empty: the configuration's, if the record is kept
  AcceptanceSettings settings;
  Verification verification;  ///< scanner, diameter and limits are from the command line
  std::string out;
  RecordOptions record;  ///< --apply, --operator, --reason, --valid-days, --config
  bool keep = false;
  bool as_json = false;
};

/// Reads each file and evaluates it.
void each(
    const std::vector<std::string>& files, const hal::ScanForm& form,
    const std::function<std::optional<Error>(const std::string&, std::span<const float>, const ScanShape&)>& judge,
    std::map<std::uint32_t, std::string>& seen) {
  std::vector<float> xyz(3 * limits::kScanPointsMax);
  ProgressCount progress(stderr, files.size());
  for (const std::string& file : files) {
    progress.next(file);
    const ScanShape shape = need(hal::read_scan(file.c_str(), form, std::span<float>(xyz)), kBadInput);
    const std::span<const float> points = std::span(xyz).first(3 * shape.points);
    // The same scan ten times would count as ten places.
    if (const auto [first, is_new] = seen.try_emplace(hal::points_crc32c(points), file); !is_new)
      stop(kBadInput,
           fmt::format("{}: the same points as {}; every place needs a scan of its own", file, first->second));
    if (const std::optional<Error> why = judge(file, points, shape))
      stop(kBadInput, fmt::format("{}: {}", file, why->text.view()));
  }
}

/// Unit and columns of the scans. A record is of the configuration's scanner, so that its form holds then.
hal::ScanForm form_of(const Options& options) {
  if (!options.keep && !options.record.apply) return options.form.form();
  config::Config config = config_from(options.record.config);
  return options.form.form(options.record.scanner.of(std::move(config)).scanner.form);
}

void look(const Options& options, Verification& v) {
  const auto plate = [&](const std::string& file, std::span<const float> xyz,
                         const ScanShape& shape) -> std::optional<Error> {
    const Result<PlateFigures> figures = judge_plate(xyz, shape, options.settings);
    if (!figures) return figures.error();
    v.plates.push_back({file, figures.value(), shape.scanner_temperature_c});
    return std::nullopt;
  };
  const auto ball = [&](const std::string& file, std::span<const float> xyz,
                        const ScanShape& shape) -> std::optional<Error> {
    const Result<BallFigures> figures = judge_ball(xyz, v.diameter_mm, options.settings);
    if (!figures) return figures.error();
    v.balls.push_back({file, figures.value(), shape.scanner_temperature_c});
    return std::nullopt;
  };
  std::map<std::uint32_t, std::string> seen;  // files by the checksum of their points
  const hal::ScanForm form = form_of(options);
  each(options.plates, form, plate, seen);
  each(options.balls, form, ball, seen);
}

std::string figure(double value, const char* format = "{:.4f}") {
  return std::isnan(value) ? "-" : fmt::format(fmt::runtime(format), value);
}

void warn_of_places(const char* artefact, std::size_t places, std::size_t scans, std::size_t needed) {
  if (scans == 0 || places >= needed) return;
  complain(fmt::format(
      "warning: VDI/VDE 2634-2 asks for the {} in {} places of the volume, here are {} scans of {}; places lie {:.0f} "
      "mm apart{}",
      artefact, needed, scans, places, kPlaceApart_mm,
      std::string_view(artefact) == "plate" ? fmt::format(" or are tilted by {:.0f} deg", deg_from_rad(kPlaceApart_rad))
                                            : ""));
}

void warn(const Verification& v) {
  const ScannerNumbers n = numbers_of(v);
  warn_of_places("ball", n.balls, v.balls.size(), kBallPlacesMin);
  warn_of_places("plate", n.plates, v.plates.size(), kPlatePlacesMin);
  if (n.plates != 0 && std::isnan(n.noise_correlation_mm))
    complain(
        "warning: how far the noise of neighbours hangs together was not seen, because no plate's scan has rows of 128 "
        "points or more; U takes what each scan shows of it");
  constexpr double kSpan_K = 3.0;
  if (const double span_K = temperature_span_K(v); span_K > kSpan_K)
    complain(
        fmt::format("warning: the scanner's temperature changed by {:.1f} K during these scans; let it warm up "
                    "first (slabctl scanner warm-up), then verify again",
                    span_K));
  // Independent noise in every point falls to 1/e within one point.
  constexpr double kSharedPoints = 1.5;
  for (const VerifiedPlate& p : v.plates)
    if (const NoiseFigures& noise = p.figures.noise; noise.correlation_mm > kSharedPoints * noise.pitch_mm)
      return complain(
          fmt::format("warning: {}: neighbours share their noise over {:.1f} points: if it is the scanner's program "
                      "that smooths, fills "
                      "gaps or resamples, switch that off and verify again (docs/SCANNER.md, \"Filters off\")",
                      p.file, noise.correlation_mm / noise.pitch_mm));
}

void print(const Verification& v) {
  for (const VerifiedPlate& p : v.plates)
    fmt::print(
        "plate {}\n  RF {} mm of {} points ({} left out), rms {} mm over {:.0f} mm\n  form +-{} mm; noise {} mm, "
        "correlated over {} mm (points every {} mm)\n",
        p.file, figure(p.figures.RF_mm), p.figures.points, p.figures.rejected, figure(p.figures.rms_mm),
        p.figures.length_mm, figure(p.figures.form_half_mm), figure(p.figures.noise.sigma_mm),
        figure(p.figures.noise.correlation_mm, "{:.2f}"), figure(p.figures.noise.pitch_mm, "{:.3f}"));
  for (const VerifiedBall& b : v.balls)
    fmt::print("ball {}\n  PF {} mm, PS {} mm of {} points ({} left out), rms {} mm at ({:.1f}, {:.1f}, {:.1f})\n",
               b.file, figure(b.figures.PF_mm), figure(b.figures.PS_mm, "{:+.4f}"), b.figures.points,
               b.figures.rejected, figure(b.figures.rms_mm), b.figures.centre_mm.x(), b.figures.centre_mm.y(),
               b.figures.centre_mm.z());
  const ScannerNumbers n = numbers_of(v);
  fmt::print("worst: PF {} mm, |PS| {} mm, RF {} mm{}\n", figure(n.PF_mm), figure(n.PS_mm), figure(n.RF_mm),
             n.within_limits ? "" : "  OUT OF LIMITS");
  fmt::print("for U: form +-{} mm over {} mm, size +-{} mm, noise correlated over {} mm\n", figure(n.form_half_mm),
             figure(n.form_length_mm, "{:.0f}"), figure(n.PS_mm), figure(n.noise_correlation_mm, "{:.2f}"));
  if (has_value(n.temperature_c)) fmt::print("scanner at {:.1f} deg C\n", n.temperature_c);
  if (const std::string lines = budget_lines(n); !lines.empty())
    fmt::print("\nfor [uncertainty] of the recipe, if no acceptance is in force:\n{}", lines);
}

/// Stores the record and puts it in force if it is valid. A record out of its limits is always stored, because the
/// line must warn of it, but never put in force. A failure is printed and returned, because the figures must still be
/// shown.
Exit keep(const Options& options, const Verification& v, std::int64_t utime_us, Kept& kept) {
  Exit status = kDone;
  const ScannerNumbers numbers = numbers_of(v);
  RecordOptions record_options = options.record;
  if (const auto refusal = refusal_of(numbers); record_options.apply && !refusal.empty()) {
    complain(fmt::format("not put in force: {}", refusal.view()));
    for (const std::string& broken : limits_broken(v)) complain(fmt::format("  {}", broken));
    status = kRefused;
    if (numbers.within_limits && !options.keep) return status;
    record_options.apply = false;
  }
  config::Config config;
  if (!config_from(record_options.config, config)) return kBadInput;
  config = record_options.scanner.of(std::move(config));
  storage::CalibrationRecord record;
  record_options.scanner_serial = v.scanner;
  record_options.describe(config, record);
  record.numbers = numbers;
  record.figures = verification_json(v, utime_us, "", false);
  for (const VerifiedPlate& plate : v.plates) record.observations += "plate " + plate.file + "\n";
  for (const VerifiedBall& ball : v.balls) record.observations += "ball " + ball.file + "\n";
  if (!v.balls.empty()) record.certificate = fmt::format("ball diameter {} mm, certified as coated\n", v.diameter_mm);
  kept = keep_record(config, record_options, record);
  if (kept.status != kDone) return kept.status;
  if (kept.applied) {
    fmt::print(stderr, "{}", kept_text(kept, false));
    if (const std::string why = one_acceptance_for_two(config); !why.empty()) complain("warning: " + why);
  } else {
    fmt::print(stderr, "kept as {}{}\n", kept.id,
               numbers.within_limits ? "" : "; the line warns: scanner not verified");
  }
  return status;
}

int verify(const Options& options) {
  if (options.plates.empty() && options.balls.empty())
    stop(kUsage, "nothing to look at: --plate FILE..., --ball FILE... --diameter-mm D");
  Verification v = options.verification;
  if (!options.balls.empty() && std::isnan(v.diameter_mm))
    stop(kUsage, "--ball needs --diameter-mm, the certified diameter of the ball as coated");
  if (options.balls.empty() && !(std::isnan(v.limits.PF_mm) && std::isnan(v.limits.PS_mm)))
    stop(kUsage, "--limit-pf-mm and --limit-ps-mm are limits of the ball's figures: they need --ball FILE...");
  if (options.plates.empty() && !std::isnan(v.limits.RF_mm))
    stop(kUsage, "--limit-rf-mm is a limit of the plate's figure: it needs --plate FILE...");
  look(options, v);
  warn(v);
  const std::int64_t utime_us = wall_clock_us();
  Kept kept;
  const Exit status = options.keep || options.record.apply ? keep(options, v, utime_us, kept) : kDone;
  const std::string document = verification_json(v, utime_us, kept.id, kept.applied);
  if (!options.out.empty()) {
    OutFile out(options.out, {.synced = true, .mode = 0664});
    out.write(document);
    need(out.close(Code::journal_write));
  }
  if (options.as_json)
    fmt::print("{}", document);
  else
    print(v);
  if (status != kDone) return status;
  return numbers_of(v).within_limits ? kDone : kRefused;
}

}  // namespace

void add_scanner_verify(args::Command& scanner) {
  auto options = std::make_shared<Options>();
  args::Command command =
      scanner.add_subcommand("verify", "The scanner against a plate and a ball: PF, PS, RF, form, noise, for U");
  command->footer(
      "\nPF, PS and RF as in VDI/VDE 2634 part 2. With --apply the figures are a record of the database, and U takes "
      "of\n"
      "form, length error and noise correlation the larger of recipe and record, from the next slab on. That needs "
      "the\n"
      "plate in 6 places, the ball in 10 (10 mm apart, or the plate tilted by 5 deg) and every limit kept; what is out "
      "of its limits is kept, and the line warns.\n"
      "Exit status: 0 within the limits given (or none given), 3 a scan does not show what it should, 6 out of limits "
      "or\nnot put in force.\n"
      "Example: slabctl scanner verify --plate p*.ply --ball b*.ply --diameter-mm 50.0123 --limit-pf-mm 0.1 --apply "
      "\\\n"
      "           --operator anna --reason \"yearly acceptance\" --valid-days 365");
  Verification& v = options->verification;
  command->add_option("--plate", options->plates, "Scans of a flat plate, one place each");
  command->add_option("--ball", options->balls, "Scans of one ball, one place each");
  command->add_option("--diameter-mm", v.diameter_mm, "Certified, of the ball as coated")->check(within(2.0, 400.0));
  options->form.add_to(*command);
  command->add_option("--gate-mm", options->settings.gate_mm, "Further from plate or ball than this is something else")
      ->check(within(0.05, 20.0))
      ->capture_default_str();
  command->add_option("--limit-pf-mm", v.limits.PF_mm, "PF allowed")->check(within(0.0, 10.0));
  command->add_option("--limit-ps-mm", v.limits.PS_mm, "|PS| allowed")->check(within(0.0, 10.0));
  command->add_option("--limit-rf-mm", v.limits.RF_mm, "RF allowed")->check(within(0.0, 10.0));
  command
      ->add_option("--temperature", v.temperature_c,
                   "Temperature of the scanner, deg C, for U at others (default: mean of what the scans declare)")
      ->check(within(kScannerTemperatureMin_c, kScannerTemperatureMax_c));
  command->add_option("--scanner", v.scanner, "Name or serial number, for the record");
  command->add_option("--out", options->out, "Write slabd.scanner_verification/1, for the records");
  command->add_flag("--keep", options->keep, "Keep the record in the database, for `slabctl scanner history`");
  RecordOptions& record = options->record;
  args::Option by = command->add_option("--operator", record.operator_name, "With --apply: who accepts the scanner");
  args::Option reason =
      command->add_option("--reason", record.why, "With --apply: why, for the history")->check(some_words());
  command->add_flag("--apply", record.apply, "Keep the record and let U rest on it from the next slab on")
      ->needs(by)
      ->needs(reason);
  command
      ->add_option("--valid-days", record.valid_days,
                   "How long it counts as verified, 0 = without limit (default: [calibration] valid_days)")
      ->check(args::range(0, 36'500));
  command->add_option("--config", record.config, "With --keep or --apply: the daemon's configuration")
      ->default_val(default_config());
  record.scanner.option = "--scanner-id";
  record.scanner.add_to(*command);
  command->add_flag("--json", options->as_json, "Print slabd.scanner_verification/1");
  command->runs([options] { return verify(*options); });
}

}  // namespace slabd::cli
