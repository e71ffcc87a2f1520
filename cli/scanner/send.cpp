// SPDX-License-Identifier: Apache-2.0
//
// slabctl scanner send: delivers scan files over TCP, as a reference for developers of a gateway.
#include <fmt/core.h>

#include <atomic>
#include <chrono>
#include <csignal>
#include <memory>
#include <thread>

#include "cli/command.h"
#include "cli/exit.h"
#include "cli/terminal/arguments.h"
#include "cli/terminal/parse.h"
#include "emulator/stream_gateway.h"

namespace slabd::cli {
namespace {

using Clock = std::chrono::steady_clock;

struct Options {
  std::vector<std::string> files;
  std::string to = "127.0.0.1:1504";
  ScanFormOptions form;
  double wait_s = 60.0;
  std::size_t cut_after = 0;
  double temperature_c = kNoValue;
};

std::atomic<bool> g_stop{false};
void on_signal(int) {
  g_stop = true;
}

struct Scan {
  std::vector<float> xyz;
  ScanShape shape;
};

Scan read(const std::string& path, const hal::ScanForm& form) {
  Scan scan;
  scan.xyz.resize(3 * limits::kScanPointsMax);
  scan.shape = need(hal::read_scan(path.c_str(), form, std::span<float>(scan.xyz)), kBadInput);
  scan.xyz.resize(3 * scan.shape.points);
  return scan;
}

/// Splits "address:port".
bool split(const std::string& to, std::string& host, std::uint16_t& port) {
  const std::size_t colon = to.rfind(':');
  const std::string digits = colon == std::string::npos ? "" : to.substr(colon + 1);
  if (colon == std::string::npos || digits.empty() || digits.size() > 5 ||
      digits.find_first_not_of("0123456789") != std::string::npos || std::stoul(digits) > 65'535)
    return false;
  host = to.substr(0, colon);
  port = static_cast<std::uint16_t>(std::stoul(digits));
  return true;
}

/// Delivers one scan; retries from the cut until `until`.
void deliver(emulator::StreamGateway& gateway, const Scan& scan, const std::string& file, const Options& options,
             Clock::time_point until) {
  const std::int64_t utime_us =
      std::chrono::duration_cast<std::chrono::microseconds>(std::chrono::system_clock::now().time_since_epoch())
          .count();
  // The temperature that the file declares may be replaced, for example to try a warm scanner.
  const double temperature_c =
      has_value(options.temperature_c) ? options.temperature_c : scan.shape.scanner_temperature_c;
  std::size_t cut_after = options.cut_after == 0 ? SIZE_MAX : options.cut_after;
  std::string last = "slabd asked for nothing";
  while (!g_stop && Clock::now() < until) {
    if (const Status up = gateway.connect(); !up) {
      if (up.error().code == Code::config) stop(kUsage, up.error().text.view());
      last = up.error().text.view();
      std::this_thread::sleep_for(std::chrono::milliseconds(200));
      continue;
    }
    std::string note;
    const std::optional<emulator::StreamRequest> request = gateway.next_request(200, note);
    if (!note.empty()) last = "slabd: " + note;
    if (!request) continue;
    const Status sent = gateway.answer(*request, scan.xyz, scan.shape.width, scan.shape.height, utime_us,
                                       std::exchange(cut_after, SIZE_MAX), scan.shape.emulated, temperature_c);
    if (sent) {
      fmt::print(
          "request {} (slab \"{}\", station {}): {}, {} points{}\n", request->name(), request->slab_id,
          request->station, file, scan.shape.points,
          gateway.resumed_from() != 0 ? fmt::format(", {} of them from before the cut", gateway.resumed_from()) : "");
      std::fflush(stdout);
      return;
    }
    last = sent.error().text.view();
    if (sent.error().code != Code::scanner_offline) stop(sent.error());
    fmt::print(stderr, "{}; trying again\n", last);
  }
  stop(kNotReachable, fmt::format("{}: {}", options.to, last));
}

int send(const Options& options) {
  std::string host;
  std::uint16_t port = 0;
  if (!split(options.to, host, port))
    stop(kUsage, fmt::format("--to {}: expected ADDRESS:PORT, such as 127.0.0.1:1504", options.to));
  std::signal(SIGINT, on_signal);
  std::signal(SIGTERM, on_signal);
  emulator::StreamGateway gateway(host, port);
  for (const std::string& file : options.files) {
    const Scan scan = read(file, options.form.form());
    const auto until = Clock::now() + std::chrono::milliseconds(static_cast<std::int64_t>(1e3 * options.wait_s));
    deliver(gateway, scan, file, options, until);
  }
  return kDone;
}

}  // namespace

void add_scanner_send(args::Command& scanner) {
  auto options = std::make_shared<Options>();
  args::Command command = scanner.add_subcommand("send", "Answer slabd's next requests with scan files, over TCP");
  command->footer(
      "\nThe reference of docs/DELIVERY.md: connects as a gateway does, waits for a request, sends the file, prints "
      "what\n"
      "became of it; with several files one request after the other. Goes on where a connection was cut.\n"
      "Exit status: 0 all taken, 1 or 3 a scan was refused, 4 no request or no daemon within --wait-s.\n"
      "Example: slabctl scanner send block.ply --to 127.0.0.1:1504");
  command->add_option("FILES", options->files, "Scans: .ply, .pcd, .xyz")->required();
  command->add_option("--to", options->to, "Address where slabd listens: [scanner] listen")->capture_default_str();
  options->form.add_to(*command);
  command->add_option("--wait-s", options->wait_s, "For each request")->check(within(0.1, 1e6))->capture_default_str();
  command
      ->add_option("--temperature", options->temperature_c,
                   "Temperature of the scanner, deg C, sent with the scans (default: what the file declares)")
      ->check(within(kScannerTemperatureMin_c, kScannerTemperatureMax_c));
  command->add_option("--cut-after", options->cut_after,
                      "Cut the first connection after this number of points and connect again, to try just that");
  command->runs([options] { return send(*options); });
}

}  // namespace slabd::cli
