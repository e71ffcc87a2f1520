// SPDX-License-Identifier: Apache-2.0
#include "bench/report.h"

#include <fmt/core.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <optional>

namespace slabd::bench {
namespace {

int threads_of(const std::string& key) {
  return std::atoi(key.c_str() + key.rfind('/') + 1);
}

Json json_of(const Figure& figure) {
  Json json;
  json["ms"] = figure.ms;
  json["min_ms"] = figure.min_ms;
  json["cpu_ms"] = figure.cpu_ms;
  json["basis"] = figure.basis;
  json["samples"] = figure.samples;
  json["disturbed"] = figure.disturbed;
  return json;
}

/// json[key][...], null if a step is missing.
Json at(const Json& json, std::initializer_list<std::string_view> path) {
  const Json* here = &json;
  for (const std::string_view step : path) {
    if (!here->is_object()) return nullptr;
    const auto found = here->find(std::string(step));
    if (found == here->end()) return nullptr;
    here = &*found;
  }
  return *here;
}

Json stage_ms(const Json& stages, const std::string& key) {
  return at(stages, {key, "ms"});
}

Json quotient(const Json& above, const Json& below) {
  if (!above.is_number() || !below.is_number() || below.get<double>() == 0.0) return nullptr;
  return above.get<double>() / below.get<double>();
}

Sample sample_of(const Json& json) {
  return {json["wall_ms"], json["cpu_ms"], json["disturbed"]};
}

std::string job_name(const Json& run) {
  const int threads = run["threads"].get<int>();
  return run["job"].get<std::string>() + (threads > 1 ? fmt::format(" {}t", threads) : "");
}

/// Square of a number; NaN for any other value, so that the mean is also NaN.
double square_of(const Json& value) {
  return value.is_number() ? value.get<double>() * value.get<double>() : std::numeric_limits<double>::quiet_NaN();
}

bool is_error(const std::string& figure) {
  return figure.find("_error_") != std::string::npos;
}

/// Merges all processes of one program on one job into one entry: times over all repetitions, medians of the stages,
/// and the largest memory. Errors are the root mean square over the scored scans, otherwise the worst.
Json peers_of(const PeerRuns& timed, const PeerRuns& counted, const PeerRuns& scored) {
  Json peers = Json::object();
  std::map<std::pair<std::string, std::string>, std::vector<Sample>> samples;
  std::map<std::pair<std::string, std::string>, std::map<std::string, std::vector<Sample>>> stages;
  for (const Json& run : timed) {
    const std::pair<std::string, std::string> who{run["peer"], job_name(run)};
    peers[who.first]["version"] = run["version"];
    Json& entry = peers[who.first][who.second];  // after `samples`, because a new key moves the others
    entry["threads"] = run["threads"];
    for (const Json& one : run["runs"]) {
      samples[who].push_back(sample_of(one["total"]));
      const Json laps = at(one, {"stages"});
      for (const auto& [stage, lap] : laps.items()) stages[who][stage].push_back(sample_of(lap));
    }
    const Json figures = at(run, {"figures"});
    for (const auto& [name, value] : figures.items()) {
      const Json before = at(entry, {"figures", name});
      const bool worse = !before.is_number() || before.get<double>() < value.get<double>();
      if (worse) entry["figures"][name] = value;
    }
    const Json before = at(entry, {"peak_rss_mb"});
    if (!before.is_number() || before.get<double>() < run["peak_rss_mb"].get<double>())
      entry["peak_rss_mb"] = run["peak_rss_mb"];
    // The stages in execution order.
    const Json last = at(run["runs"].back(), {"stages"});
    for (const auto& [stage, lap] : last.items())
      entry["stages_ms"][stage] = figure_of(stages[who][stage], entry["threads"]).ms;
  }
  for (const auto& [who, list] : samples) {
    Json& entry = peers[who.first][who.second];
    entry.update(json_of(figure_of(list, entry["threads"])));
  }
  std::map<std::pair<std::string, std::string>, double> scans;
  for (const Json& run : scored) scans[{run["peer"], job_name(run)}] += 1.0;
  // Programs that were not timed do not have a column.
  std::erase_if(scans, [&](const auto& scan) { return at(peers, {scan.first.first, scan.first.second}).is_null(); });
  for (const auto& [who, count] : scans) {
    Json& entry = peers[who.first][who.second];
    entry["scans_scored"] = count;
    std::map<std::string, double> squares;
    for (const Json& run : scored) {
      if (run["peer"] != who.first || job_name(run) != who.second) continue;
      const Json figures = at(run, {"figures"});
      for (const auto& [name, value] : figures.items())
        if (is_error(name)) squares[name] += square_of(value);
    }
    for (const auto& [name, sum] : squares) entry["figures"][name] = std::sqrt(sum / count);
  }
  for (const Json& run : counted) {
    // The first repetition allocates the permanent memory; the last one is a steady block.
    const Json allocations = at(run["runs"].back(), {"allocations"});
    if (allocations.is_number()) peers[run["peer"].get<std::string>()][job_name(run)]["allocations"] = allocations;
  }
  return peers;
}

/// The entry of the program with the least time for a job, slabd excluded; null if there is none.
Json fastest(const Json& peers, std::string_view job) {
  Json best;
  for (const auto& [peer, jobs] : peers.items()) {
    if (peer == "slabd") continue;
    const Json entry = at(jobs, {job});
    if (at(entry, {"ms"}).is_number() && (best.is_null() || entry["ms"].get<double>() < best["ms"].get<double>()))
      best = entry;
  }
  return best;
}

/// One line of the table by which the project is judged. `value` reaches a limit (`must`, `aim`) if it is at most the
/// limit, or at least the limit if `more_is_better`.
Json judged(std::string_view what, const Json& value, double must, double aim, bool more_is_better,
            std::string_view unit = "x") {
  Json line;
  line["what"] = what;
  line["value"] = value;
  line["must"] = must;
  line["aim"] = aim;
  line["more_is_better"] = more_is_better;
  line["unit"] = unit;
  if (!value.is_number()) {
    line["verdict"] = "not measured";
    return line;
  }
  const double v = value;
  const auto reaches = [&](double limit) { return more_is_better ? v >= limit : v <= limit; };
  line["verdict"] = reaches(aim) ? "aim reached" : reaches(must) ? "must reached" : "missed";
  return line;
}

/// Time with 1 thread / time with 2 threads of a stage. If one of the figures is not a median of undisturbed wall
/// times, the ratio is that of the minima.
Json gain_of_two(const Json& one, const Json& two) {
  const bool quiet = at(one, {"basis"}) == "wall" && at(two, {"basis"}) == "wall";
  const std::string_view key = quiet ? "ms" : "min_ms";
  return quotient(at(one, {key}), at(two, {key}));
}

/// True if a stage's or a program's figure may be too low because other processes used the machine. It is then not a
/// median of undisturbed wall times, or fewer than two thirds of the samples were undisturbed.
bool rough(const Json& figure) {
  const Json basis = at(figure, {"basis"});
  if (!basis.is_string()) return false;
  return basis != "wall" || 3 * figure["disturbed"].get<int>() > figure["samples"].get<int>();
}

/// The slab with the longest wait for its verdict in units of its block time; null if there is none.
Json slowest_slab(const Json& slabs) {
  Json slowest, most;
  for (const Json& slab : slabs) {
    const Json blocks = quotient(at(slab, {"last_acquired_to_verdict_s"}), at(slab, {"block_compute_ms"}));
    if (!blocks.is_number() || (most.is_number() && most.get<double>() >= blocks.get<double>())) continue;
    most = blocks;
    slowest = slab;
  }
  return slowest;
}

Json judgement(const Json& json) {
  const Json& stages = json["stages"];
  const Json& peers = json["peers"];
  const Json warm = at(stages, {"floor/read_warm/1"}), cold = at(stages, {"floor/read_cold/1"});
  const Json organised = at(stages, {"block/organised/1"}), two = at(stages, {"block/organised/2"});
  const Json in_scan_order = at(stages, {"block/in_scan_order/1"}), shuffled = at(stages, {"block/shuffled/1"});
  const Json pcl = at(peers, {"PCL", "block-tuned"});
  const Json file = at(stages, {"file_to_verdict/ply_organised/1"}), bare_file = at(stages, {"file_to_verdict/ply/1"});
  const Json shipped = at(stages, {"file_to_verdict/ply_organised/2"});
  const Json registering = at(stages, {"block/organised/register/1"});
  const Json perspective = at(stages, {"block/perspective/1"});
  const Json own = at(peers, {"slabd", "block-organised"});
  const Json peer_registering = fastest(peers, "register");
  const Json reading = at(stages, {"read/ply_organised_cold/1"});
  const Json reading_by_two = at(stages, {"read/ply_organised_cold/2"});
  Json lines = Json::array();
  const auto ratio = [&](std::string_view what, const Json& above, const Json& below, double must, double aim,
                         bool more_is_better) {
    Json line = judged(what, quotient(at(above, {"ms"}), at(below, {"ms"})), must, aim, more_is_better);
    line["rough"] = rough(above) || rough(below);
    lines.push_back(line);
  };
  ratio("whole block, organised, 1 thread / warm read pass", organised, warm, 12, 8, false);
  ratio("whole block, unorganised in scan order / warm read pass", in_scan_order, warm, 25, 15, false);
  ratio("whole block, unorganised and shuffled / warm read pass", shuffled, warm, 25, 15, false);
  ratio("whole block, organised, seen in perspective / warm read pass", perspective, warm, 12, 8, false);
  lines.push_back(judged("whole block, 1 thread / 2 threads", gain_of_two(organised, two), 1.7, 1.9, true));
  lines.back()["rough"] = rough(organised) || rough(two);
  ratio("PCL tuned / slabd, both with reading, 1 thread each", pcl, file, 60, 100, true);
  ratio("the same, slabd from the unorganised file that PCL reads", pcl, bare_file, 60, 100, true);
  ratio("the same, slabd on two threads, as it is shipped", pcl, shipped, 60, 100, true);
  for (const auto& [what, figure] : {std::pair("pose error, slabd / PCL tuned", "pose_error_um"),
                                     std::pair("bearing plane's tilt error, slabd / PCL tuned", "normal_error_mdeg")})
    lines.push_back(judged(what, quotient(at(own, {"figures", figure}), at(pcl, {"figures", figure})), 1, 1, false));
  ratio("fastest packaged peer's registration / slabd's", peer_registering, registering, 100, 200, true);
  ratio("binary PLY read after other memory, 1 thread / cold read pass", reading, cold, 2.5, 1.5, false);
  ratio("the same on two threads, as it is shipped / cold read pass on one", reading_by_two, cold, 2.5, 1.5, false);
  lines.push_back(judged("longest wait for a slab's verdict after the last ACQUIRED / one block's computing",
                         quotient(json["slab_verdict_wait_ms"], json["slab_block_compute_ms"]), 2, 1, false));
  lines.push_back(judged("heap allocations per block, in the library", json["allocations_per_block"], 0, 0, false, ""));
  lines.push_back(judged("peak memory, one scan in flight", json["rss_mb"], 160, 160, false, "MB"));
  return lines;
}

// ---- markdown -----------------------------------------------------------------------------------------------------

std::string number(const Json& value) {
  if (!value.is_number()) return "-";
  const double v = value;
  if (v == 0.0) return "0";
  if (std::abs(v) >= 1e6) return fmt::format("{:.3g} M", 1e-6 * v);
  if (std::abs(v) >= 100.0) return fmt::format("{:.0f}", v);
  if (std::abs(v) >= 10.0) return fmt::format("{:.1f}", v);
  if (std::abs(v) >= 0.1) return fmt::format("{:.2f}", v);
  return fmt::format("{:.2g}", v);
}

/// Text of a figure, with a mark if it is not a median of undisturbed wall times.
std::string marked(const Json& figure) {
  const Json ms = at(figure, {"ms"});
  if (!ms.is_number()) return "-";
  const Json basis = at(figure, {"basis"});
  return number(ms) + (basis == "cpu" ? " †" : basis == "min wall" ? " ‡" : "");
}

std::string text(const Json& value) {
  return value.is_string() ? value.get<std::string>() : value.is_null() ? "-" : value.dump();
}

std::string environment_table(const Json& environment) {
  std::string out = "| | |\n|---|---|\n";
  for (const auto& [key, value] : environment.items()) {
    std::string what;
    if (value.is_array()) {
      for (const Json& part : value) what += (what.empty() ? "" : ", ") + text(part);
    } else if (value.is_object()) {
      for (const auto& [name, part] : value.items()) what += (what.empty() ? "" : ", ") + name + " " + text(part);
    } else {
      what = text(value);
    }
    out += fmt::format("| {} | {} |\n", key, what);
  }
  return out;
}

std::string judgement_table(const Json& lines) {
  std::string out = "| What | Must | Aim | Measured | |\n|---|---|---|---|---|\n";
  for (const Json& line : lines) {
    const std::string unit = text(line["unit"]);
    const std::string sign = line["more_is_better"].get<bool>() ? ">= " : "<= ";
    const auto limit = [&](const char* key) {
      return fmt::format("{}{:g}{}{}", sign, line[key].get<double>(), unit.empty() ? "" : " ", unit);
    };
    out += fmt::format("| {} | {} | {} | {} | {} |\n", text(line["what"]), limit("must"), limit("aim"),
                       number(line["value"]),
                       text(line["verdict"]) + (at(line, {"rough"}) == true ? " (busy machine)" : ""));
  }
  return out;
}

/// Part "what" of a stage name "what/threads".
std::string without_threads(const std::string& key) {
  return key.substr(0, key.rfind('/'));
}

std::string stage_table(const Json& json, std::string_view first_words) {
  std::string out =
      "| | 1 thread, ms | min | left out | 2 threads, ms | min | left out | 1 : 2 | / warm read |\n"
      "|---|---|---|---|---|---|---|---|---|\n";
  const Json& stages = json["stages"];
  const Json& warm = json["floor_read_warm_ms"];
  std::string last;
  for (const auto& [key, figure] : stages.items()) {
    if (key.rfind(first_words, 0) != 0) continue;
    const std::string name = without_threads(key);
    if (name == last) continue;
    last = name;
    const Json one = at(stages, {name + "/1"}), two = at(stages, {name + "/2"});
    const auto left_out = [](const Json& of) {
      return of.is_object() ? fmt::format("{}/{}", of["disturbed"].get<int>(), of["samples"].get<int>()) : "-";
    };
    out += fmt::format("| {} | {} | {} | {} | {} | {} | {} | {} | {} |\n", name.substr(name.find('/') + 1), marked(one),
                       number(at(one, {"min_ms"})), left_out(one), marked(two), number(at(two, {"min_ms"})),
                       left_out(two), number(gain_of_two(one, two)), number(quotient(at(one, {"ms"}), warm)));
  }
  return out;
}

std::string growth_table(const Json& json) {
  // Scans of other sizes are compared with the one of five million points of the same run.
  const Json& stages = json["stages"];
  const Json five = at(stages, {"growth/points  5.0 M/1", "ms"});
  std::string out = "| | ms | min | / organised block | ns a point |\n|---|---|---|---|---|\n";
  for (const auto& [key, figure] : stages.items()) {
    // Stage names of single runs have a third part.
    const std::string name = without_threads(key);
    if (key.rfind("growth/", 0) != 0 || std::count(name.begin(), name.end(), '/') != 1) continue;
    constexpr std::string_view kPoints = "growth/points ";
    const bool is_size = name.rfind(kPoints, 0) == 0;
    const Json ms = at(figure, {"ms"});
    const Json ns = is_size ? quotient(ms, std::atof(name.c_str() + kPoints.size())) : Json();
    out += fmt::format("| {} | {} | {} | {} | {} |\n", name.substr(7), marked(figure), number(at(figure, {"min_ms"})),
                       number(quotient(ms, is_size ? five : json["block_1t_ms"])), number(ns));
  }
  return out;
}

struct Column {
  const char* peer;
  const char* job;
  const char* title;
};

std::string block_table(const Json& peers) {
  constexpr Column kColumns[] = {
      {"slabd", "block-organised", "slabd"},     {"slabd", "block-organised 2t", "slabd, 2 threads"},
      {"slabd", "block", "slabd, unorganised"},  {"PCL", "block-tuned", "PCL tuned"},
      {"Open3D", "block-tuned", "Open3D tuned"}, {"Open3D", "block-tuned 2t", "Open3D tuned, 2 threads"},
      {"PCL", "block-spec", "PCL spec"},         {"Open3D", "block-spec", "Open3D spec"}};
  std::vector<Column> shown;
  std::string out = "| |";
  for (const Column& column : kColumns) {
    if (at(peers, {column.peer, column.job}).is_null()) continue;
    shown.push_back(column);
    out += fmt::format(" {} |", column.title);
  }
  out += "\n|---|";
  for (std::size_t i = 0; i < shown.size(); ++i) out += "---|";
  out += "\n";
  const auto row = [&](std::string_view title, const auto& cell) {
    out += fmt::format("| {} |", title);
    for (const Column& column : shown) out += fmt::format(" {} |", cell(at(peers, {column.peer, column.job})));
    out += "\n";
  };
  const auto plain = [&](std::string_view title, std::initializer_list<std::string_view> path) {
    row(title, [&](const Json& entry) { return number(at(entry, path)); });
  };
  row("**total, ms**", [](const Json& entry) { return "**" + marked(entry) + "**"; });
  plain("minimum, ms", {"min_ms"});
  plain("blocks measured", {"samples"});
  for (const char* stage :
       {"read", "outliers", "transform", "voxels", "register", "crop", "plane", "refit", "flatness", "extract, judge"})
    plain(fmt::format("{}, ms", stage), {"stages_ms", stage});
  plain("scans whose errors count (-: the timed one)", {"scans_scored"});
  plain("pose error, um rms", {"figures", "pose_error_um"});
  plain("turn error, mdeg rms", {"figures", "turn_error_mdeg"});
  plain("bearing plane's tilt error, mdeg rms", {"figures", "normal_error_mdeg"});
  plain("standard deviation of the plane, mm", {"figures", "std_mm"});
  plain("peak memory, MB", {"peak_rss_mb"});
  plain("heap allocations per block", {"allocations"});
  return out;
}

std::string step_table(const Json& peers, std::string_view job,
                       std::initializer_list<std::pair<const char*, const char*>> figures) {
  std::string out = "| | ms | min |";
  std::string rule = "\n|---|---|---|";
  for (const auto& [key, title] : figures) {
    out += fmt::format(" {} |", title);
    rule += "---|";
  }
  out += " slabd is faster by | allocations |" + rule + "---|---|\n";
  const Json own = at(peers, {"slabd", job, "ms"});
  for (const auto& [peer, jobs] : peers.items()) {
    for (const std::string& name : {std::string(job), std::string(job) + "-refit"}) {
      const Json entry = at(jobs, {name});
      if (entry.is_null()) continue;
      out += fmt::format("| {}{} | {} | {} |", peer, name == job ? "" : ", refitted on all", marked(entry),
                         number(at(entry, {"min_ms"})));
      for (const auto& [key, title] : figures) out += fmt::format(" {} |", number(at(entry, {"figures", key})));
      out += fmt::format(" {} | {} |\n", peer == "slabd" ? "" : number(quotient(at(entry, {"ms"}), own)),
                         number(at(entry, {"allocations"})));
    }
  }
  return out;
}

std::string denoise_table(const Json& peers) {
  std::string out = "| | ms | outliers left | surface points lost |\n|---|---|---|---|\n";
  const auto row = [&](const char* title, const char* peer, const char* job, const char* stage) {
    const Json entry = at(peers, {peer, job});
    if (entry.is_null()) return;
    out += fmt::format("| {} | {} | {} | {} |\n", title, number(at(entry, {"stages_ms", stage})),
                       number(at(entry, {"figures", "outliers_left"})), number(at(entry, {"figures", "surface_lost"})));
  };
  row("slabd", "slabd", "denoise", "outliers");
  row("PCL statistical (20 neighbours, 2 sigma)", "PCL", "block-spec", "outliers");
  row("Open3D statistical (20 neighbours, 2 sigma)", "Open3D", "block-spec", "outliers");
  return out;
}

}  // namespace

Json report(const Measured& measured) {
  Json json;
  json["schema"] = "slabd.bench/1";
  for (const std::string_view key : kPromisedKeys) json[std::string(key)] = nullptr;
  for (const std::string_view key : kPromisedPeerKeys) json[std::string(key)] = nullptr;
  Json stages = Json::object();
  for (const auto& [key, samples] : measured.stages)
    if (!samples.empty()) stages[key] = json_of(figure_of(samples, threads_of(key)));
  if (measured.growth.is_object()) stages.update(measured.growth);
  const Json peers = peers_of(measured.peers, measured.counted, measured.scored);

  const std::pair<const char*, const char*> kStageOf[] = {
      {"floor_read_warm_ms", "floor/read_warm/1"},
      {"floor_read_warm_2t_ms", "floor/read_warm/2"},
      {"floor_read_cold_ms", "floor/read_cold/1"},
      {"floor_read_cold_2t_ms", "floor/read_cold/2"},
      {"block_1t_ms", "block/organised/1"},
      {"block_2t_ms", "block/organised/2"},
      {"block_unorganised_1t_ms", "block/in_scan_order/1"},
      {"block_shuffled_1t_ms", "block/shuffled/1"},
      {"block_perspective_1t_ms", "block/perspective/1"},
      {"read_ply_ms", "read/ply/1"},
      {"read_ply_cold_ms", "read/ply_organised_cold/1"},
      {"read_ply_cold_2t_ms", "read/ply_organised_cold/2"},
      {"read_xyz_ms", "read/xyz/1"},
      {"denoise_1t_ms", "block/organised/denoise/1"},
      {"register_1t_ms", "block/organised/register/1"},
      {"extract_1t_ms", "block/organised/extract/1"},
      {"plane_1t_ms", "plane/1"},
      {"file_to_verdict_1t_ms", "file_to_verdict/ply_organised/1"},
      {"file_to_verdict_unorganised_1t_ms", "file_to_verdict/ply/1"},
  };
  for (const auto& [key, stage] : kStageOf) json[key] = stage_ms(stages, stage);
  // The organised scan has its grid and 2 % missing points, as current scanners write it.
  json["allocations_per_block"] = at(peers, {"slabd", "block-organised", "allocations"});
  json["rss_mb"] = at(peers, {"slabd", "block-organised", "peak_rss_mb"});
  json["pcl_tuned_ms"] = at(peers, {"PCL", "block-tuned", "ms"});
  json["open3d_tuned_ms"] = at(peers, {"Open3D", "block-tuned", "ms"});
  json["pcl_spec_ms"] = at(peers, {"PCL", "block-spec", "ms"});
  json["open3d_spec_ms"] = at(peers, {"Open3D", "block-spec", "ms"});
  json["fastest_peer_register_ms"] = at(fastest(peers, "register"), {"ms"});
  json["fastest_peer_plane_ms"] = at(fastest(peers, "plane"), {"ms"});
  const Json slab = slowest_slab(measured.slabs);
  if (slab.is_object()) {
    json["slab_verdict_wait_ms"] = 1e3 * slab["last_acquired_to_verdict_s"].get<double>();
    json["slab_block_compute_ms"] = slab["block_compute_ms"];
  }
  json["stages"] = stages;
  json["peers"] = peers;
  json["judged"] = judgement(json);
  json["environment"] = measured.environment;
  return json;
}

std::string markdown(const Json& json) {
  const Json& peers = json["peers"];
  std::string out;
  const auto section = [&](std::string_view title, const std::string& table) {
    out += fmt::format("### {}\n\n{}\n", title, table);
  };
  section("Machine, versions, day", environment_table(json["environment"]));
  section("How it is judged", judgement_table(json["judged"]));
  section("Floors: one pass over the scan", stage_table(json, "floor/"));
  section("One block, points in memory", stage_table(json, "block/"));
  section("Reading, and a file from disk to verdict",
          stage_table(json, "read/") + "\n" + stage_table(json, "file_to_verdict/"));
  section("Every instruction set, one thread", stage_table(json, "sets/"));
  section("How cost grows", growth_table(json));
  section("One block from a binary PLY to its flatness, against other programs", block_table(peers));
  section("Registration alone",
          step_table(peers, "register",
                     {{"pose_error_um", "pose error, um rms"}, {"turn_error_mdeg", "turn error, mdeg rms"}}));
  section("The bearing plane alone", step_table(peers, "plane", {{"normal_error_mdeg", "tilt error, mdeg rms"}}));
  section("Outliers, whole cloud", denoise_table(peers));
  return out;
}

}  // namespace slabd::bench
