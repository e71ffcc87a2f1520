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

std::string krl_data_list(std::string_view name, int set, const std::vector<Pose>& T_base_flange) {
  std::string text = fmt::format(
      "&ACCESS RVP\nDEFDAT {} PUBLIC\n"
      ";Flange poses in the robot root: $BASE=$NULLFRAME, $TOOL=$NULLFRAME. Written by slabctl stations --set {}.\n"
      "DECL GLOBAL FRAME STATION{}[{}]\n",
      name, set, set, T_base_flange.size());
  for (std::size_t k = 0; k < T_base_flange.size(); ++k) {
    const Vec3& p = T_base_flange[k].translation_mm;
    const KukaAbc abc = kuka_abc_from_rotation(T_base_flange[k].rotation);
    text += fmt::format("STATION{}[{}]={{X {:.4f},Y {:.4f},Z {:.4f},A {:.6f},B {:.6f},C {:.6f}}}\n", set, k + 1, p.x(),
                        p.y(), p.z(), deg_from_rad(abc.a_rad), deg_from_rad(abc.b_rad), deg_from_rad(abc.c_rad));
  }
  return text + "ENDDAT\n";
}

std::string krl_program(std::string_view name, int set, std::size_t stations) {
  return fmt::format(
      "&ACCESS RVP\nDEF {0}( )\n"
      "  ;One slab with the stops of set {1}. Returns after station {2}, or if the PLC names station 0 (slab "
      "aborted).\n"
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
      "    IF k > {2} THEN\n"
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
      "    IF (k == 0) OR (k == {2}) THEN\n"
      "      EXIT\n"
      "    ENDIF\n"
      "  ENDLOOP\n"
      "END\n",
      name, set, stations);
}

Result<std::vector<Pose>> parse_krl_points(std::string_view text, std::string_view origin) {
  std::vector<std::optional<Pose>> found;
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
    if (found.size() < *station) found.resize(*station);
    if (found[*station - 1]) return at_line(origin, number, fmt::format("station {} is there twice", *station));
    found[*station - 1] = pose.value();
  }
  std::vector<Pose> poses;
  for (std::size_t k = 0; k < found.size(); ++k) {
    if (!found[k]) return at_line(origin, number, fmt::format("station {} is missing", k + 1));
    poses.push_back(*found[k]);
  }
  if (poses.empty()) return at_line(origin, number, "no line like STATION[1]={X 0.0,Y 0.0,Z 0.0,A 0.0,B 0.0,C 0.0}");
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
