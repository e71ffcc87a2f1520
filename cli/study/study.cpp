// SPDX-License-Identifier: Apache-2.0
//
// slabctl study: the paper's tests of the measuring system, for a quality engineer on a production line.
#include "cli/study/study.h"

#include <fmt/core.h>
#include <unistd.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <iostream>
#include <optional>
#include <string>
#include <vector>

#include "cli/client/calibration_change.h"
#include "cli/client/live_capture.h"
#include "cli/client/record_options.h"
#include "cli/command.h"
#include "cli/exit.h"
#include "cli/terminal/arguments.h"

namespace slabd::cli::study {

void ScanOptions::add_to(args::Command& command) {
  command.add_option("--recipe", recipe, "Recipe of the slab type, to measure scans with");
  form.add_to(command);
  threads = config::default_measure_threads();
  command.add_option("--threads", threads, "Threads that measure; the results are the same")
      ->check(args::range(1, 2))
      ->capture_default_str();
}

Recipe ScanOptions::load() const {
  if (recipe.empty()) stop(kUsage, "scans are measured with a recipe: --recipe FILE");
  return recipe_from(recipe);
}

void add_same_part(args::Command& command, std::string& why) {
  command.add_option(
      "--same-part", why,
      "Why slabs of different ids, or scans of different blocks, are one part all the same; it is printed "
      "with the study. Without it they are refused");
}

Exit exit_of(Judgement judgement) {
  return judgement == Judgement::capable || judgement == Judgement::not_judged ? kDone : kNotPass;
}

Assignment parse_assignment(const std::string& option, const std::string& text) {
  const std::size_t equals = text.find('=');
  Assignment read{text.substr(0, equals)};
  const std::string number = equals == std::string::npos ? "" : text.substr(equals + 1);
  const char* const end = number.data() + number.size();
  const auto [rest, fault] = std::from_chars(number.data(), end, read.value);
  if (number.empty() || fault != std::errc{} || rest != end || !std::isfinite(read.value) || read.item.empty())
    stop(kUsage, fmt::format("{} '{}': expected ITEM=VALUE, such as seat_slope=1.4321", option, text));
  return read;
}

}  // namespace slabd::cli::study

namespace slabd::cli {

void add_study(args::Command& app) {
  args::Command group =
      app.add_subcommand("study", "How good is the measuring: repeats, gauge R&R, against a laboratory");
  group->require_subcommand(1);
  study::add_repeat(*group);
  study::add_grr(*group);
  study::add_compare(*group);
}

}  // namespace slabd::cli

// Takes scans from the running daemon with the command for calibration views. Each scan is measured here from the
// robot pose of the daemon; the daemon's copy is released at once.
namespace slabd::cli::study {
namespace {

Stop refused(const Error& why) {
  return {live_capture_exit(why.code), std::string(why.text.view())};
}

bool robot_is_back(std::size_t number, std::size_t count) {
  fmt::print(stderr, "scan {} of {}: press Enter when the robot is there again\n", number, count);
  std::string line;
  return static_cast<bool>(std::getline(std::cin, line));
}

/// Takes a scan. If the robot moved or its poses paused, it is repeated a few times, because this is not an error of
/// the study.
Result<LiveShot> shoot(LiveCapture& line, const std::string& what) {
  constexpr int kTries = 5;
  const bool terminal = isatty(STDERR_FILENO) != 0;
  for (int i = 1;; ++i) {
    Result<LiveShot> shot = line.shoot([&](std::string_view doing) {
      if (terminal) fmt::print(stderr, "\r\x1b[K{}: {}", what, doing);
    });
    if (terminal) fmt::print(stderr, "\r\x1b[K");
    if (shot.ok() || i == kTries) return shot;
    const Code code = shot.error().code;
    if (code != Code::not_settled && code != Code::moved_during_scan && code != Code::pose_stale) return shot;
    complain(fmt::format("{} again: {}", what, shot.error().text.view()));
  }
}

/// Takes all scans. nullopt on success, otherwise the reason.
std::optional<Stop> take_all(const LiveOrder& order, const config::Config& config, const Pose& X, const Recipe& recipe,
                             const Pose& T_robot_slab, LiveCapture& line, std::vector<MeasuredOnce>& measurements) {
  ScanMeter meter(recipe, config.scanner.form, order.threads);
  const Pose T_block_base = (T_robot_slab * T_slab_block(recipe, order.station)).inverse();
  for (std::size_t i = 1; i <= order.count; ++i) {
    if (order.enter && !robot_is_back(i, order.count)) return Stop{kUsage, "stdin ended before the last scan"};
    const Result<LiveShot> shot = shoot(line, fmt::format("scan {}/{}", i, order.count));
    if (!shot.ok()) return refused(shot.error());
    auto readings = meter.measure(shot.value().scan_path, order.station, T_block_base * shot.value().T_base_flange * X);
    // A failed release is ignored, because the daemon deletes the copy after a week.
    static_cast<void>(line.release(shot.value().scan_path));
    if (!readings.ok()) return refused(readings.error());
    const std::vector<Reading>& values = readings.value();
    if (i == 1 && std::none_of(values.begin(), values.end(), [](const Reading& r) { return has_value(r.value); }))
      return Stop{kBadInput, fmt::format("no block was found in the first scan; does the robot stand over block {}?",
                                         order.station)};
    measurements.push_back({fmt::format("scan {}", i), std::move(readings.value())});
  }
  return std::nullopt;
}

}  // namespace

std::vector<MeasuredOnce> live_measurements(const LiveOrder& order, const Recipe& recipe) {
  const config::Config config = order.scanner.of(config_from(order.config));
  std::unique_ptr<storage::Reader> reader = open_records(config);
  const InForce now = hand_eye_in_force(reader.get(), config);
  const std::optional<Pose> T_robot_slab = find_T_robot_slab(reader.get(), config);
  if (!T_robot_slab) stop(kRefused, "the base frames of the two robots are not tied: slabctl calibrate tie");
  reader.reset();
  Result<LiveCapture> line =
      LiveCapture::begin(config.control_socket, {fmt::format("study of block {}", order.station),
                                                 default_operator().substr(0, 60), 300, false, id_if_several(config)});
  if (!line.ok()) throw refused(line.error());
  for (const std::string& warning : line.value().warnings()) complain("warning: " + warning);
  std::vector<MeasuredOnce> measurements;
  const std::optional<Stop> missed =
      take_all(order, config, now.T_flange_scanner, recipe, *T_robot_slab, line.value(), measurements);
  if (missed) complain(missed->sentence);  // printed before the line is returned
  if (const Status ended = line.value().end(); !ended.ok())
    complain(fmt::format("warning: the line stays in maintenance until the lease ends: {}", ended.error().text.view()));
  if (missed) stop(missed->status);
  return measurements;
}

}  // namespace slabd::cli::study
