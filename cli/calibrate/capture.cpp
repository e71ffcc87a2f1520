// SPDX-License-Identifier: Apache-2.0
//
// slabctl calibrate capture: adds one view, or a folder of views, to the session. The scans are copied first, and the
// copies are evaluated, so that the session contains the evaluated data. An existing view is detected by its pose and
// the content of its scans: a repeated command completes an interrupted one without duplicates. A rejected view is
// stored with its reason and is not counted.
#include <fmt/core.h>
#include <unistd.h>

#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <iostream>
#include <map>
#include <memory>

#include "cli/calibrate/calibrate.h"
#include "cli/calibrate/capture.h"
#include "cli/calibrate/session.h"
#include "cli/client/live_capture.h"
#include "cli/command.h"
#include "cli/exit.h"
#include "cli/terminal/arguments.h"
#include "cli/terminal/say.h"
#include "hal/hal.h"

namespace slabd::cli {
namespace {

namespace fs = std::filesystem;

struct Options {
  SessionOptions session;
  std::vector<std::string> scans;
  std::string flange;
  std::string flange_file;
  std::string set;
  bool live = false;
  bool all = false;
  bool end = false;
  bool take_over = false;
  int shots = 3;
  bool hold_out = false;
  bool json = false;
};

/// A table of poses with its lines as written, so that a view stores the original text.
struct WrittenTable {
  calib::PoseTable table;
  std::string form;
  std::vector<std::string> lines;
};

std::string single_blanks(const std::string& text) {
  std::string out;
  for (const char c : text.substr(0, text.find('#'))) {
    const bool blank = c == ' ' || c == '\t' || c == '\r' || c == ',';
    if (!blank)
      out += c;
    else if (!out.empty() && out.back() != ' ')
      out += ' ';
  }
  if (out.ends_with(' ')) out.pop_back();
  return out;
}

Result<WrittenTable> read_table(const std::string& path) {
  const Result<std::string> text = text_file(path);
  if (!text.ok()) return text.error();
  Result<calib::PoseTable> parsed = calib::parse_poses(text.value(), path, calib::TableRole::flange);
  if (!parsed.ok()) return parsed.error();
  WrittenTable written{std::move(parsed.value()), "", {}};
  std::string rest = text.value();
  for (std::size_t at = 0; at < rest.size();) {
    const std::size_t end = std::min(rest.find('\n', at), rest.size());
    written.lines.push_back(rest.substr(at, end - at));
    at = end + 1;
  }
  constexpr std::string_view kHeader = "format:";
  if (written.table.format.declared)
    for (const std::string& line : written.lines) {
      const std::size_t first = line.find_first_not_of("# \t");
      if (first == std::string::npos || line.find('#') >= first || line.compare(first, kHeader.size(), kHeader) != 0)
        continue;
      written.form = single_blanks(line.substr(first + kHeader.size()));
      break;
    }
  return written;
}

ViewRequest request_from(const WrittenTable& table, std::size_t row) {
  ViewRequest request;
  request.flange_form = table.form;
  request.flange = single_blanks(table.lines[table.table.lines[row] - 1]);
  return request;
}

/// Removes the leading digits of `text`; large numbers are limited to a million, which is not a valid view. Returns
/// false if there are none.
bool take_number(std::string_view& text, std::size_t& number) {
  constexpr std::size_t kNumberMax = 1'000'000;
  const std::size_t digits = std::min(text.find_first_not_of("0123456789"), text.size());
  number = 0;
  for (const char c : text.substr(0, digits))
    number = std::min(10 * number + static_cast<std::size_t>(c - '0'), kNumberMax);
  text.remove_prefix(digits);
  return digits > 0;
}

/// Parses the numbers in "view_07_2.ply": view 7, shot 2. False if it is not the name of a view's scan.
bool numbers_of(const fs::path& file, std::size_t& view, std::size_t& shot) {
  constexpr std::string_view kPrefix = "view_";
  const std::string stem = file.stem().string();
  std::string_view rest = stem;
  if (!rest.starts_with(kPrefix) || !hal::scan_format_of(file.native())) return false;
  rest.remove_prefix(kPrefix.size());
  shot = 1;
  if (!take_number(rest, view)) return false;
  if (rest.empty()) return true;
  if (!rest.starts_with('_')) return false;
  rest.remove_prefix(1);
  return take_number(rest, shot) && rest.empty();
}

/// View requests from a folder with flange.txt and view_NN.ply or view_NN_S.ply: NN is the pose in the table, S the
/// shot. Other files are ignored. Two scans with the same NN and S are rejected, because the right one is unknown.
Result<std::vector<ViewRequest>> requests_from_set(const std::string& dir) {
  const Result<WrittenTable> table = read_table(dir + "/flange.txt");
  if (!table.ok()) return table.error();
  std::map<std::pair<std::size_t, std::size_t>, std::string> scans;
  std::error_code fault;
  for (fs::directory_iterator it(dir, fault), end; !fault && it != end; it.increment(fault)) {
    std::size_t view = 0;
    std::size_t shot = 0;
    if (!numbers_of(it->path().filename(), view, shot)) continue;
    if (view == 0)
      return said_error(Code::config, say("{}: views are numbered from 1, which is the first pose in flange.txt",
                                          it->path().string()));
    const auto [other, is_new] = scans.try_emplace({view, shot}, it->path().string());
    if (is_new) continue;
    const std::string one = it->path().filename().string();
    const std::string two = fs::path(other->second).filename().string();
    return said_error(Code::config,
                      say("{} and {} are both view {}, shot {}; move the one away that was not taken at pose {} of "
                          "flange.txt (in {})",
                          std::min(one, two), std::max(one, two), view, shot, view, dir));
  }
  if (fault) return said_error(Code::config, say("{}: cannot be read: {}", dir, quote(fault.message())));
  std::vector<ViewRequest> requests;
  std::size_t last = 0;
  for (const auto& [key, path] : scans) {
    const std::size_t view = key.first;
    if (view > table.value().table.poses.size())
      return said_error(Code::config, say("{}: flange.txt beside it has {} poses, so there is none for view {}", path,
                                          table.value().table.poses.size(), view));
    if (view != last) requests.push_back(request_from(table.value(), view - 1));
    requests.back().scans.push_back(path);
    last = view;
  }
  if (requests.empty())
    return said_error(Code::config, say("{}: no scan named view_NN.ply or view_NN_SHOT.ply in it", dir));
  return requests;
}

Result<std::vector<ViewRequest>> requests_from(const Options& options, const Session& session) {
  if (!options.set.empty()) return requests_from_set(options.set);
  ViewRequest request;
  if (!options.flange_file.empty()) {
    const std::size_t colon = options.flange_file.rfind(':');
    const std::string line = colon == std::string::npos ? "" : options.flange_file.substr(colon + 1);
    const std::size_t number =
        line.empty() || line.size() > 6 || line.find_first_not_of("0123456789") != std::string::npos
            ? 0
            : static_cast<std::size_t>(std::stoul(line));
    if (number == 0)
      return said_error(Code::config, say("--flange-file {}: expected FILE:LINE, the line as an editor counts it",
                                          options.flange_file));
    const std::string path = options.flange_file.substr(0, colon);
    const Result<WrittenTable> table = read_table(path);
    if (!table.ok()) return table.error();
    const auto& lines = table.value().table.lines;
    const auto row = std::find(lines.begin(), lines.end(), number);
    if (row == lines.end())
      return said_error(Code::config, say("{}:{} holds no pose; poses are on lines {} to {}", path, number,
                                          lines.front(), lines.back()));
    request = request_from(table.value(), static_cast<std::size_t>(row - lines.begin()));
  } else {
    request.flange_form = session.settings().flange_form;
    request.flange = single_blanks(options.flange);
    const Result<Pose> read = calib::parse_flange(request.flange_form, request.flange, "--flange");
    const bool has_comma = options.flange.find(',') != std::string::npos;
    if (!read.ok())
      return said_error(Code::config,
                        retold(read.error().text.view()) +
                            (has_comma ? say("; a comma stands between two numbers: write 1500.2, not 1500,2") : ""));
  }
  request.scans = options.scans;
  return std::vector<ViewRequest>{request};
}

std::string found_text(const Session& session, const calib::CapturedView& v, const calib::Guide& guide) {
  if (!v.accepted()) return say("REFUSED ({}): {}\n  cure: {}", v.refusal, quote(v.reason), quote(v.cure));
  std::string text = v.use == calib::ViewUse::held_out ? say("accepted, held out to verify with") : say("accepted");
  const bool ball = session.settings().kind == calib::ArtefactKind::ball;
  if (ball)
    text += say("; {} points, cap {:.0f} deg, rms {:.3f} mm, free radius {:+.3f} mm", v.points, v.half_angle_deg,
                v.rms_mm, v.radius_off_mm);
  else
    text += say("; balls within {:.3f} mm of the certificate", v.rms_mm);
  if (has_value(v.repeat_mm)) text += say(", {} shots repeat to {:.4f} mm", v.shots.size(), v.repeat_mm);
  const auto pose = calib::parse_flange(v.flange_form, v.flange, "");
  if (guide.T_flange_scanner && pose.ok())
    text +=
        say(", tilt {:.0f} deg", calib::tilt_deg(pose.value(), *guide.T_flange_scanner, session.settings().down_base));
  return text;
}

std::string taken_text(const Session& session, const Taken& taken, const calib::Guide& guide) {
  if (taken.dropped)
    return say(
        "captured already, and DROPPED: it is not used; take another scan, or take the drop back if it was the "
        "last step (slabctl calibrate undo)");
  return (taken.already ? say("captured already, ") : "") + found_text(session, taken.view, guide);
}

void write_view(report::Json& json, const Taken& taken) {
  const calib::CapturedView& v = taken.view;
  json.begin_object().field("view", v.number).field("already", taken.already).field("dropped", taken.dropped);
  json.field("use", v.use).field("status", v.accepted() ? "ok" : "refused").field("refusal", v.refusal);
  json.field("reason", v.reason).field("cure", v.cure).field("shots", v.shots.size()).field("points", v.points);
  json.field("half_angle_deg", v.half_angle_deg).field("rms_mm", v.rms_mm).field("radius_off_mm", v.radius_off_mm);
  json.field("repeat_mm", v.repeat_mm).end_object();
}

/// Captures the views of one command. A failed view is a return value, so that capture_all() continues after a robot
/// motion.
int capture(const Options& options) {
  set_language(options.session.language, options.json);
  const int sources = (options.live ? 1 : 0) + (options.set.empty() ? 0 : 1) + (options.scans.empty() ? 0 : 1);
  const int poses = (options.flange.empty() ? 0 : 1) + (options.flange_file.empty() ? 0 : 1);
  if (sources != 1 || (!options.scans.empty() && poses != 1) || (options.scans.empty() && poses != 0))
    stop(kUsage, say("say where the view comes from: --live (the running line), --scan FILE with --flange \"POSE\" or "
                     "--flange-file FILE:LINE, or --set FOLDER with flange.txt and view_NN.ply"));
  Session session = find_session(options.session);
  if (options.end) {
    const Result<std::string> ended = end_live(session);
    if (!ended.ok()) stop(live_capture_exit(ended.error().code), ended.error());
    if (!options.json) fmt::print("{}: {}\n", session_words(session), ended.value());
    return kDone;
  }
  need(session.lock());
  if (!options.json) fmt::print("{}\n", session_words(session));
  for (const std::string& words : session.half_done()) complain(words);

  report::Json json("slabd.calibration_capture/1");
  write_session(json, session);
  json.key("views").begin_array();
  std::vector<ViewRequest> requests = need(options.live ? Result<std::vector<ViewRequest>>(std::vector<ViewRequest>(1))
                                                        : requests_from(options, session));
  std::size_t refused = 0;
  std::size_t fresh = 0;
  const bool terminal = isatty(STDERR_FILENO) != 0;
  std::size_t done = 0;
  for (ViewRequest& request : requests) {
    request.hold_out = options.hold_out;
    if (terminal && requests.size() > 1) fmt::print(stderr, "\r\x1b[K{}", say("scan {}/{}", ++done, requests.size()));
    const Result<Taken> taken = options.live ? take_live(session, {options.shots, options.hold_out, options.take_over})
                                             : take_view(session, request);
    if (terminal && requests.size() > 1) fmt::print(stderr, "\r\x1b[K");
    if (!taken.ok()) {
      complain(retold(taken.error().text.view()));
      if (options.live) complain(say("no view was taken; cure it and give the command again"));
      if (fresh > 0) complain(say("{} views before it are kept; cure it and give the command again", fresh));
      return options.live ? live_capture_exit(taken.error().code) : exit_for(taken.error().code);
    }
    refused += taken.value().view.accepted() ? 0U : 1U;
    fresh += taken.value().already ? 0U : 1U;
    write_view(json, taken.value());
    if (options.json) continue;
    calib::Guide guide;
    if (requests.size() == 1) guide = session.guide();
    fmt::print("{}", say("view {}: {}\n", taken.value().view.number, taken_text(session, taken.value(), guide)));
  }
  const calib::Guide guide = session.guide();
  session.leave_next_pose(guide);
  json.end_array();
  write_guide(json, session, guide);
  if (options.json)
    fmt::print("{}", json.text());
  else
    fmt::print("{}", guide_text(session, guide));
  if (refused > 0 && !options.json)
    fmt::print("{}", say("{} of {} refused: they are kept and count for nothing; take them again after the cure\n",
                         refused, requests.size()));
  return refused > 0 ? kRefused : kDone;
}

/// Captures views one after the other: a line on stdin reports that the robot is at the next pose.
int capture_all(Options options) {
  for (;;) {
    const int status = capture(options);
    options.take_over = false;  // only for the first view: a later owner of the line is not interrupted
    if (status != kDone && status != kRefused) return status;
    const Session session = find_session(options.session);
    const std::size_t counted = session.counted(calib::ViewUse::fit) + session.counted(calib::ViewUse::held_out);
    if (counted >= session.settings().goal) return kDone;
    fmt::print("{}", say("drive there, stand still, then Enter; q and Enter to stop here\n"));
    std::fflush(stdout);
    std::string line;
    if (!std::getline(std::cin, line) || line.starts_with('q')) return status;
  }
}

}  // namespace

void add_calibrate_capture(args::Command& group) {
  auto options = std::make_shared<Options>();
  args::Command command = group.add_subcommand("capture", "Take a view into the session, and say where to drive next");
  command->footer(
      "\nPoses are T_base_flange as the robot reported them: the flange in the robot root, not a tool. --flange is in "
      "the\n"
      "form that `new` declared; a file declares its form in its header (slabctl calibrate solve --help).\n"
      "The scans are copied. A view that was captured already is recognised and not taken twice.\n"
      "Examples: slabctl calibrate capture --live --all\n"
      "          slabctl calibrate capture --live\n"
      "          slabctl calibrate capture --scan a.ply --scan b.ply --flange \"1500 200 900 0 1 0 0\"\n"
      "          slabctl calibrate capture --scan a.ply --flange-file poses.txt:12\n"
      "          slabctl calibrate capture --set folder\n"
      "Exit status: 0 accepted, 6 refused (kept, with the cure), 2 usage, 3 bad input, 4 daemon or disk.");
  options->session.add_to(*command);
  command->add_option("--scan", options->scans, "Scan of the artefact; several are shots of one pose, averaged");
  command->add_option("--flange", options->flange, "Pose of the flange");
  command->add_option("--flange-file", options->flange_file, "... as FILE:LINE of a table of poses");
  command->add_option("--set", options->set, "Folder with flange.txt and view_NN.ply or view_NN_SHOT.ply: all of them");
  args::Option live = command->add_flag("--live", options->live,
                                        "From the running line: the robot must stand still, no slab may be open");
  command
      ->add_flag("--end", options->end,
                 "With --live: take nothing, give the line back (it comes back by itself "
                 "at the goal, or after 5 minutes)")
      ->needs(live);
  command
      ->add_flag("--take-over", options->take_over,
                 "With --live: end another session that has the line, unless it is taking a view")
      ->needs(live)
      ->excludes("--end");
  command->add_flag("--all", options->all, "With --live: view after view until the goal; Enter when the robot stands")
      ->needs(live)
      ->excludes("--end");
  command->add_option("--shots", options->shots, "With --live: scans that are averaged")
      ->check(args::range(1, 9))
      ->capture_default_str();
  command->add_flag("--hold-out", options->hold_out, "Leave these views out of the fit, to verify with");
  command->add_flag("--json", options->json, "Print slabd.calibration_capture/1 on stdout")->excludes("--all");
  command->runs([options] { return options->all ? capture_all(*options) : capture(*options); });
}

}  // namespace slabd::cli
