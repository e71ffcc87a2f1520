// SPDX-License-Identifier: Apache-2.0
#include "cli/stations/krl.h"

#include <fmt/format.h>

#include <array>
#include <charconv>
#include <cmath>
#include <fstream>
#include <optional>
#include <sstream>

#include "calib/calib.h"

namespace slabd::cli {
namespace {

constexpr double kReach_mm = 20'000.0;
constexpr double kTurn_deg = 360.0;

bool is_space(char c) {
  return c == ' ' || c == '\t' || c == '\r';
}

std::string upper(std::string_view text) {
  std::string out(text);
  for (char& c : out)
    if (c >= 'a' && c <= 'z') c = static_cast<char>(c - 'a' + 'A');
  return out;
}

/// The line without blanks and without a comment after ';'.
std::string bare(std::string_view line) {
  std::string out;
  for (const char c : upper(line.substr(0, line.find(';'))))
    if (!is_space(c)) out += c;
  return out;
}

Error at_line(std::string_view origin, std::size_t line, const std::string& what) {
  return error(Code::config, "%.*s:%zu: %s", static_cast<int>(origin.size()), origin.data(), line, what.c_str());
}

/// The number after "X " in "X 1.0,Y 2,..."; a blank separates names and numbers in the file.
std::optional<double> member(std::string_view members, std::string_view name) {
  std::size_t at = 0;
  while (at < members.size()) {
    const std::size_t end = std::min(members.find(',', at), members.size());
    std::string_view part = members.substr(at, end - at);
    at = end + 1;
    while (!part.empty() && is_space(part.front())) part.remove_prefix(1);
    while (!part.empty() && is_space(part.back())) part.remove_suffix(1);
    const std::size_t blank = part.find_first_of(" \t");
    if (blank == std::string_view::npos || upper(part.substr(0, blank)) != name) continue;
    std::string_view number = part.substr(part.find_first_not_of(" \t", blank));
    if (!number.empty() && number.front() == '+') number.remove_prefix(1);
    double value = 0.0;
    const auto [rest, failed] = std::from_chars(number.data(), number.data() + number.size(), value);
    if (failed != std::errc{} || rest != number.data() + number.size() || !std::isfinite(value)) return std::nullopt;
    return value;
  }
  return std::nullopt;
}

Result<Pose> pose_of(std::string_view members, std::string_view origin, std::size_t line) {
  constexpr std::array<std::string_view, 6> kNames = {"X", "Y", "Z", "A", "B", "C"};
  std::array<double, 6> v{};
  for (std::size_t i = 0; i < v.size(); ++i) {
    const std::optional<double> value = member(members, kNames[i]);
    const double limit = i < 3 ? kReach_mm : kTurn_deg;
    if (!value) return at_line(origin, line, fmt::format("{} is missing or is not a number", kNames[i]));
    if (std::abs(*value) > limit)
      return at_line(origin, line, fmt::format("{} is {}, allowed -{} .. {}", kNames[i], *value, limit, limit));
    v[i] = *value;
  }
  return Pose{rotation_from_kuka_abc(rad_from_deg(v[3]), rad_from_deg(v[4]), rad_from_deg(v[5])),
              Vec3(v[0], v[1], v[2])};
}

/// "STATION[12]={" -> 12; nullopt for other lines.
std::optional<std::size_t> station_of(const std::string& line) {
  const std::size_t open = line.find('[');
  if (open == std::string::npos || open == 0 || line.starts_with("DECL") || line.starts_with("SIGNAL"))
    return std::nullopt;
  std::size_t index = 0;
  const auto [rest, failed] = std::from_chars(line.data() + open + 1, line.data() + line.size(), index);
  if (failed != std::errc{} || !std::string_view(rest, line.data() + line.size()).starts_with("]={"))
    return std::nullopt;
  return index;
}

}  // namespace

std::string krl_data_list(std::string_view name, int set, const Stops& stops) {
  std::string text = fmt::format(
      "&ACCESS RVP\nDEFDAT {} PUBLIC\n"
      ";Flange poses in the robot root: $BASE=$NULLFRAME, $TOOL=$NULLFRAME. Written by slabctl stations --set {}.\n"
      "DECL GLOBAL FRAME STATION{}[{}]\n",
      name, set, set, stops.empty() ? 0 : stops.rbegin()->first);
  for (const auto& [station, T_base_flange] : stops) {
    const Vec3& p = T_base_flange.translation_mm;
    const KukaAbc abc = kuka_abc_from_rotation(T_base_flange.rotation);
    text += fmt::format("STATION{}[{}]={{X {:.4f},Y {:.4f},Z {:.4f},A {:.6f},B {:.6f},C {:.6f}}}\n", set, station,
                        p.x(), p.y(), p.z(), deg_from_rad(abc.a_rad), deg_from_rad(abc.b_rad), deg_from_rad(abc.c_rad));
  }
  return text + "ENDDAT\n";
}

namespace {

/// A KRL condition on k that is true at the stations without a stop, up to the highest number that the PLC can name.
std::string without_stop(const Stops& stops) {
  std::string condition;
  const auto add = [&](const std::string& part) { condition += (condition.empty() ? "" : " OR ") + part; };
  int next = 1;
  for (const auto& [station, pose] : stops) {
    if (station == next + 1) add(fmt::format("(k == {})", next));
    if (station > next + 1) add(fmt::format("((k >= {}) AND (k <= {}))", next, station - 1));
    next = station + 1;
  }
  add(condition.empty() ? fmt::format("k > {}", next - 1) : fmt::format("(k > {})", next - 1));
  return condition;
}

}  // namespace

std::string krl_program(std::string_view name, int set, const Stops& stops, int stations_of_slab) {
  const bool has_all = stops.size() == static_cast<std::size_t>(stations_of_slab);
  return fmt::format(
      "&ACCESS RVP\nDEF {0}( )\n"
      "  ;One slab with the stops of set {1}. Returns {2}\n"
      "  ;The calling program contains the loop over the slabs, and RSI_CREATE and RSI_ON (docs/ROBOT.md).\n"
      "  ;The PLC names the station on $IN[1..5] and holds $IN[17] until slabd reports ACQUIRED.\n"
      "  ;First run in T1, station by station: the way between them is not checked against the cell.\n"
      "  DECL INT k\n"
      "  SIGNAL STATION_IN $IN[1] TO $IN[5]\n"
      "  BAS(#INITMOV, 0)\n"
      "  $BASE = $NULLFRAME\n"
      "  $TOOL = $NULLFRAME\n"
      "  LOOP\n"
      "    WAIT FOR $IN[17]\n"
      "    k = STATION_IN\n"
      "    IF {3} THEN\n"
      "      HALT\n"
      "    ENDIF\n"
      "    IF k > 0 THEN\n"
      "      $SEN_PREA[3] = 0\n"
      "      PTP STATION{1}[k]\n"
      "      WAIT SEC 0\n"
      "      $SEN_PREA[3] = 1\n"
      "    ENDIF\n"
      "    $OUT[17] = TRUE\n"
      "    WAIT FOR NOT $IN[17]\n"
      "    $OUT[17] = FALSE\n"
      "    IF {4} THEN\n"
      "      EXIT\n"
      "    ENDIF\n"
      "  ENDLOOP\n"
      "END\n",
      name, set,
      has_all ? fmt::format("after station {}, or if the PLC names station 0 (slab aborted).", stations_of_slab)
              : std::string("if the PLC names station 0 (slab ended or aborted): the other\n"
                            "  ;robot may scan the last station."),
      without_stop(stops), has_all ? fmt::format("(k == 0) OR (k == {})", stations_of_slab) : "k == 0");
}

Result<Stops> parse_krl_stops(std::string_view text, std::string_view origin) {
  Stops stops;
  std::size_t number = 0;
  for (std::size_t at = 0; at <= text.size();) {
    const std::size_t end = std::min(text.find('\n', at), text.size());
    const std::string_view line = text.substr(at, end - at);
    at = end + 1;
    ++number;
    const std::optional<std::size_t> station = station_of(bare(line));
    if (!station) continue;
    if (*station < 1 || *station > limits::kStationsMax)
      return at_line(origin, number, fmt::format("station {}, allowed 1..{}", *station, limits::kStationsMax));
    const std::size_t open = line.find('{');
    const std::size_t close = line.find('}');
    if (close == std::string_view::npos) return at_line(origin, number, "the closing brace is missing");
    const Result<Pose> pose = pose_of(line.substr(open + 1, close - open - 1), origin, number);
    if (!pose) return pose.error();
    if (!stops.try_emplace(static_cast<int>(*station), pose.value()).second)
      return at_line(origin, number, fmt::format("station {} is there twice", *station));
  }
  if (stops.empty()) return at_line(origin, number, "no line like STATION[1]={X 0.0,Y 0.0,Z 0.0,A 0.0,B 0.0,C 0.0}");
  return stops;
}

Result<std::vector<Pose>> parse_krl_points(std::string_view text, std::string_view origin) {
  const Result<Stops> stops = parse_krl_stops(text, origin);
  if (!stops) return stops.error();
  std::vector<Pose> poses;
  for (const auto& [station, pose] : stops.value()) {
    if (static_cast<std::size_t>(station) != poses.size() + 1)
      return error(Code::config, "%.*s: station %zu is missing", static_cast<int>(origin.size()), origin.data(),
                   poses.size() + 1);
    poses.push_back(pose);
  }
  return poses;
}

Result<std::vector<Pose>> read_krl_points(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  std::ostringstream bytes;
  bytes << file.rdbuf();
  if (!file) return error(Code::config, "%s: cannot be read", path.c_str());
  return parse_krl_points(bytes.str(), path);
}

}  // namespace slabd::cli
