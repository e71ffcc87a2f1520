// SPDX-License-Identifier: Apache-2.0
//
// slabctl calibrate artefact: measures the pose of an artefact of three or more balls in scans, with its certificate.
#include <fmt/core.h>
#include <memory>

#include "base/durable.h"
#include "cli/calibrate/calibrate.h"
#include "cli/calibrate/find_ball.h"
#include "cli/exit.h"
#include "cli/terminal/arguments.h"
#include "cli/terminal/say.h"

namespace slabd::cli {
namespace {

struct Options {
  std::vector<std::string> scans;
  std::string certificate;
  BallOptions ball;
  std::string target;
  LanguageOption language;
  bool json = false;
};

/// The table is matched line by line with the flange poses, so it is not written if a view was rejected.
void write_target(const Options& options, const std::vector<calib::ArtefactReport>& reports) {
  std::vector<Pose> poses;
  for (std::size_t i = 0; i < reports.size(); ++i) {
    if (!reports[i].ok())
      stop(kRefused, say("{} is not written: {} was refused; leave it out, and line {} of the flange poses with it",
                         options.target, options.scans[i], i + 1));
    poses.push_back(reports[i].target.T_scanner_target);
  }
  OutFile file(options.target, {.synced = true});
  file.write(calib::write_poses(poses, calib::PoseFormat{}, calib::TableRole::target));
  need(file.close(Code::journal_write), kNotReachable);
  if (!options.json) fmt::print("{}", say("{}: {} poses\n", options.target, poses.size()));
}

int run_artefact(const Options& options) {
  set_language(options.language, options.json);
  const std::string text = need(text_file(options.certificate), kBadInput);
  const calib::ArtefactCertificate certificate = need(calib::parse_certificate(text, options.certificate), kBadInput);
  calib::ArtefactSettings settings;
  settings.ball = options.ball.settings();
  std::vector<calib::ArtefactReport> reports;
  report::Json json("slabd.artefacts/1");
  json.field("certificate", certificate.id).field("certificate_date", certificate.date).key("views").begin_array();
  std::size_t accepted = 0;
  each_scan(options.scans, options.ball.form.form(), [&](const std::string& path, std::span<const float> xyz) {
    const Result<calib::ArtefactReport> report = calib::find_artefact(xyz, certificate, settings);
    if (!report) return Status(report.error());
    reports.push_back(report.value());
    accepted += report.value().ok() ? 1U : 0U;
    json.begin_object().field("file", path);
    write_artefact(json, report.value());
    json.end_object();
    if (!options.json)
      fmt::print("{}{}", report.value().ok() ? say("{}: accepted\n", path) : say("{}: refused\n", path),
                 artefact_text(report.value(), certificate, settings));
    return success();
  });
  const bool good = accepted == reports.size();
  json.end_array();
  json.field("accepted", accepted).field("status", good ? "ok" : "refused");
  if (options.json)
    fmt::print("{}", json.text());
  else if (reports.size() > 1)
    fmt::print("{}", say("{} of {} scans accepted\n", accepted, reports.size()));
  if (!options.target.empty()) write_target(options, reports);
  return good ? kDone : kRefused;
}

}  // namespace

void add_calibrate_artefact(args::Command& group) {
  auto options = std::make_shared<Options>();
  args::Command command = group.add_subcommand(
      "artefact", "Find an artefact of three or more balls in scans: pose, residuals, why refused");
  command->footer(
      "\nThe certificate is a text file; docs/TARGETS.md describes it.\n"
      "Example: slabctl calibrate artefact view_*.ply --certificate three-ball-01.cert --target target.txt\n"
      "Exit status: 0 every scan accepted, 6 one refused, 2 usage, 3 bad input.");
  command->add_option("SCAN", options->scans, "Scans of the artefact, one a view, in the order of the flange poses")
      ->required();
  command->add_option("--certificate", options->certificate, "Certificate of the laboratory")->required();
  command->add_option(
      "--target", options->target,
      "Write the poses as a target table for `calibrate solve --kind pose`; all scans must be accepted");
  options->ball.add_to(*command);
  options->language.add_to(*command, "Language of the text");
  command->add_flag("--json", options->json, "Print slabd.artefacts/1 on stdout");
  command->runs([options] { return run_artefact(*options); });
}

}  // namespace slabd::cli
