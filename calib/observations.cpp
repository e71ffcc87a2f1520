// SPDX-License-Identifier: Apache-2.0
//
// Tables of poses as text. A table declares its content or is in the neutral form; numbers are never interpreted by
// their size. Every error contains origin and line, so that the author can find it.
#include "calib/observations.h"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <cstdarg>
#include <cstdio>

namespace slabd::calib {
namespace {

constexpr double kUnitTolerance = 1e-3;
constexpr double kPositionMax_mm = 100'000.0;
constexpr std::string_view kBlanks = " \t\r";
constexpr std::string_view kHeader = "format:";

constexpr std::size_t numbers_of(RotationForm form) {
  switch (form) {
    case RotationForm::kuka_abc: return 6;
    case RotationForm::none: return 3;
    default: return 7;
  }
}

constexpr const char* columns_of(RotationForm form) {
  switch (form) {
    case RotationForm::quaternion_wxyz: return "x y z qw qx qy qz";
    case RotationForm::quaternion_xyzw: return "x y z qx qy qz qw";
    case RotationForm::kuka_abc: return "x y z A B C";
    case RotationForm::none: return "x y z";
  }
  return "";
}

constexpr const char* frames_of(TableRole role, bool inverse) {
  if (role == TableRole::flange) return inverse ? "T_flange_base" : "T_base_flange";
  return inverse ? "T_target_scanner" : "T_scanner_target";
}

/// Removes and returns the next word of `text`; empty at its end.
std::string_view next_word(std::string_view& text) {
  const std::size_t from = std::min(text.find_first_not_of(kBlanks), text.size());
  const std::size_t to = std::min(text.find_first_of(kBlanks, from), text.size());
  const std::string_view word = text.substr(from, to - from);
  text.remove_prefix(to);
  return word;
}

/// Place of an error in a text: "flange.txt:12".
struct Place {
  std::string_view origin;
  std::size_t line;
};

/// Error with the text "origin:line: sentence".
[[gnu::format(printf, 2, 3)]] Error at(const Place& place, const char* format, ...) {
  std::array<char, limits::kErrorTextBytes> text{};
  va_list args;
  va_start(args, format);
  std::vsnprintf(text.data(), text.size(), format, args);
  va_end(args);
  return error(Code::config, "%.*s:%zu: %s", static_cast<int>(std::min<std::size_t>(place.origin.size(), 120)),
               place.origin.data(), place.line, text.data());
}

int width(std::string_view word) {
  return static_cast<int>(std::min<std::size_t>(word.size(), 40));
}

/// File name for a sentence; only the end of a long one, which contains the name.
std::string_view ending(std::string_view origin) {
  constexpr std::size_t kMost = 80;
  return origin.size() > kMost ? origin.substr(origin.size() - kMost) : origin;
}

/// Parses the header line after "format:".
Result<PoseFormat> parse_header(std::string_view text, const Place& place, TableRole role) {
  PoseFormat format;
  format.declared = true;
  bool said_unit = false;
  bool said_angle = false;
  for (std::string_view word = next_word(text); !word.empty(); word = next_word(text)) {
    const std::size_t equals = word.find('=');
    const std::string_view key = word.substr(0, equals);
    const std::string_view value = equals == std::string_view::npos ? "" : word.substr(equals + 1);
    const auto wrong = [&](const char* allowed) {
      return at(place, "'%.*s' is not understood; %.*s= is one of %s", width(word), word.data(), width(key), key.data(),
                allowed);
    };
    if (key == "rotation") {
      bool known = false;
      for (const RotationForm form :
           {RotationForm::quaternion_wxyz, RotationForm::quaternion_xyzw, RotationForm::kuka_abc, RotationForm::none})
        if (value == name(form)) {
          format.rotation = form;
          known = true;
        }
      if (!known) return wrong("quaternion_wxyz, quaternion_xyzw, kuka_abc, none");
    } else if (key == "unit") {
      if (value != "mm" && value != "m") return wrong("mm, m");
      format.metres = value == "m";
      said_unit = true;
    } else if (key == "angle") {
      if (value != "deg" && value != "rad") return wrong("deg, rad");
      format.radians = value == "rad";
      said_angle = true;
    } else if (key == "frames") {
      format.inverse = value == frames_of(role, true);
      if (!format.inverse && value != frames_of(role, false))
        return role == TableRole::flange ? wrong("T_base_flange, T_flange_base")
                                         : wrong("T_scanner_target, T_target_scanner");
    } else if (key == "labels") {
      if (value != "view,ball") return wrong("view,ball");
      if (role == TableRole::flange) return at(place, "labels=view,ball belongs into the target table");
      format.labelled = true;
    } else {
      return at(place, "'%.*s' is not a key of a format line; keys are rotation, unit, angle, frames, labels",
                width(key), key.data());
    }
  }
  if (format.rotation == RotationForm::kuka_abc && !(said_unit && said_angle))
    return at(place, "rotation=kuka_abc also needs unit=mm|m and angle=deg|rad");
  if (format.rotation != RotationForm::kuka_abc && said_angle)
    return at(place, "angle= is only valid with rotation=kuka_abc");
  if (format.rotation == RotationForm::none && format.inverse)
    return at(place, "a ball centre alone cannot be inverted; frames=%s", frames_of(role, false));
  if (format.rotation == RotationForm::none && role == TableRole::flange)
    return at(place, "a flange pose has a rotation; rotation=none is for ball centres");
  return format;
}

Pose pose_of(const std::array<double, 7>& numbers, const PoseFormat& format) {
  const double mm = format.metres ? kMmPerM : 1.0;
  const auto rad = [&](double angle) { return format.radians ? angle : rad_from_deg(angle); };
  const std::array<double, 7>& v = numbers;
  Pose pose;
  pose.translation_mm = Vec3(v[0], v[1], v[2]) * mm;
  switch (format.rotation) {
    case RotationForm::quaternion_wxyz: pose.rotation = Quat(v[3], v[4], v[5], v[6]).normalized(); break;
    case RotationForm::quaternion_xyzw: pose.rotation = Quat(v[6], v[3], v[4], v[5]).normalized(); break;
    case RotationForm::kuka_abc: pose.rotation = rotation_from_kuka_abc(rad(v[3]), rad(v[4]), rad(v[5])); break;
    case RotationForm::none: break;
  }
  return format.inverse ? pose.inverse() : pose;
}

Result<std::size_t> parse_label(std::string_view word, const char* what, std::size_t most, const Place& place) {
  std::size_t number = 0;
  const auto [stop, fault] = std::from_chars(word.data(), word.data() + word.size(), number);
  if (fault != std::errc{} || stop != word.data() + word.size() || number < 1 || number > most)
    return at(place, "%s is '%.*s'; a whole number from 1 to %zu is expected", what, width(word), word.data(), most);
  return number - 1;
}

/// Parses one line of numbers and appends it to the table.
Status parse_line(std::string_view line, const Place& place, PoseTable& table) {
  const PoseFormat& format = table.format;
  if (format.labelled) {
    const Result<std::size_t> view = parse_label(next_word(line), "the view", kViewsMax, place);
    if (!view) return view.error();
    const Result<std::size_t> ball = parse_label(next_word(line), "the ball", kBallsMax, place);
    if (!ball) return ball.error();
    table.views.push_back(view.value());
    table.balls.push_back(ball.value());
  }
  const std::size_t wanted = numbers_of(format.rotation);
  std::array<double, 7> numbers{};
  for (std::size_t i = 0; i < wanted; ++i) {
    const std::string_view word = next_word(line);
    if (word.empty()) return at(place, "%zu numbers; expected %s", i, columns_of(format.rotation));
    const auto [stop, fault] = std::from_chars(word.data(), word.data() + word.size(), numbers[i]);
    if (fault != std::errc{} || stop != word.data() + word.size() || !std::isfinite(numbers[i]))
      return at(place, "number %zu is '%.*s'; expected %s, blanks between, decimal points", i + 1, width(word),
                word.data(), columns_of(format.rotation));
  }
  if (const std::string_view more = next_word(line); !more.empty() && more.front() != '#')
    return at(place, "'%.*s' after %zu numbers; expected %s", width(more), more.data(), wanted,
              columns_of(format.rotation));
  if (format.rotation == RotationForm::quaternion_wxyz || format.rotation == RotationForm::quaternion_xyzw) {
    const double length = std::hypot(std::hypot(numbers[3], numbers[4]), std::hypot(numbers[5], numbers[6]));
    if (!(std::abs(length - 1.0) <= kUnitTolerance))
      return at(place, "the quaternion (numbers 4 to 7) has length %.6f, must be 1 within %g", length, kUnitTolerance);
  }
  const Pose pose = pose_of(numbers, format);
  if (const double furthest_mm = pose.translation_mm.cwiseAbs().maxCoeff(); !(furthest_mm <= kPositionMax_mm))
    return at(place, "a position of %g m is beyond any robot; is the table in um or the unit wrong (%s)?",
              m_from_mm(furthest_mm), format.metres ? "m" : "mm");
  if (table.poses.size() == kViewsMax * (format.labelled ? kBallsMax : 1))
    return at(place, "more than %zu views; give the ones that were meant for this calibration", kViewsMax);
  table.poses.push_back(pose);
  table.written.push_back(numbers);
  table.lines.push_back(place.line);
  return success();
}

}  // namespace

std::string_view name(RotationForm form) {
  switch (form) {
    case RotationForm::quaternion_wxyz: return "quaternion_wxyz";
    case RotationForm::quaternion_xyzw: return "quaternion_xyzw";
    case RotationForm::kuka_abc: return "kuka_abc";
    case RotationForm::none: return "none";
  }
  return "";
}

double robot_rad_for(double robot_mm) {
  const StatedNoise defaults;
  return robot_mm * defaults.robot_rad / defaults.robot_mm;
}

Result<PoseTable> parse_poses(std::string_view text, std::string_view origin, TableRole role) {
  PoseTable table;
  if (text.starts_with("\xEF\xBB\xBF")) text.remove_prefix(3);  // skip the byte order mark of some editors
  std::size_t number = 0;
  while (!text.empty()) {
    const std::size_t end = std::min(text.find('\n'), text.size());
    std::string_view line = text.substr(0, end);
    text.remove_prefix(std::min(end + 1, text.size()));
    const Place place{origin, ++number};
    const std::size_t first = line.find_first_not_of(kBlanks);
    if (first == std::string_view::npos) continue;
    if (line[first] != '#') {
      if (Status status = parse_line(line, place, table); !status) return status.error();
      continue;
    }
    std::string_view comment = line.substr(first + 1);
    if (next_word(comment) != kHeader) continue;
    if (table.format.declared) return at(place, "a second format line; a table has one form");
    if (!table.poses.empty()) return at(place, "the format line must be before the first pose");
    const Result<PoseFormat> format = parse_header(comment, place, role);
    if (!format) return format.error();
    table.format = format.value();
  }
  if (table.poses.empty())
    return at({origin, std::max<std::size_t>(number, 1)}, "no pose in it; expected lines of %s",
              columns_of(table.format.rotation));
  return table;
}

Result<std::vector<View>> views_from(ArtefactKind kind, const PoseTable& flange, std::string_view flange_origin,
                                     const PoseTable& target, std::string_view target_origin) {
  const bool labelled = target.format.labelled;
  const std::string_view flange_name = ending(flange_origin);
  const std::string_view target_name = ending(target_origin);
  if (!labelled && flange.poses.size() != target.poses.size())
    return error(
        Code::config,
        "%.*s has %zu poses, %.*s has %zu; each flange pose needs its target on the same line of the other table",
        static_cast<int>(flange_name.size()), flange_name.data(), flange.poses.size(),
        static_cast<int>(target_name.size()), target_name.data(), target.poses.size());
  if (kind == ArtefactKind::pose && target.format.rotation == RotationForm::none)
    return error(Code::config, "%.*s holds ball centres (rotation=none); kind pose needs the target's whole pose",
                 static_cast<int>(target_name.size()), target_name.data());
  if (kind == ArtefactKind::pose && labelled)
    return error(Code::config, "%.*s: labels=view,ball are for balls; kind pose has one artefact",
                 static_cast<int>(target_name.size()), target_name.data());

  std::vector<View> views(flange.poses.size());
  for (std::size_t i = 0; i < views.size(); ++i) {
    views[i].number = i + 1;
    views[i].T_base_flange = flange.poses[i];
    if (flange.format.rotation == RotationForm::kuka_abc && !flange.format.inverse) {
      const std::array<double, 7>& v = flange.written[i];
      std::array<double, 3> abc = {v[3], v[4], v[5]};
      if (!flange.format.radians)
        for (double& angle : abc) angle = rad_from_deg(angle);
      views[i].reported_abc_rad = abc;
    }
  }
  std::size_t balls = 0;
  for (std::size_t i = 0; i < target.poses.size(); ++i) {
    const Place place{target_origin, target.lines[i]};
    const std::size_t v = labelled ? target.views[i] : i;
    if (v >= views.size())
      return at(place, "view %zu, but %.*s has %zu poses", v + 1, static_cast<int>(flange_name.size()),
                flange_name.data(), views.size());
    if (kind == ArtefactKind::pose) {
      views[v].T_scanner_target = target.poses[i];
      continue;
    }
    const std::size_t ball = labelled ? target.balls[i] : 0;
    balls = std::max(balls, ball + 1);
    for (const BallObservation& seen : views[v].balls)
      if (seen.ball == ball) return at(place, "ball %zu for the second time in view %zu", ball + 1, v + 1);
    views[v].balls.push_back({ball, target.poses[i].translation_mm, std::nullopt});
  }
  if (kind == ArtefactKind::pose) return views;
  std::vector<bool> seen(balls, false);
  std::erase_if(views, [](const View& view) { return view.balls.empty(); });
  for (const View& view : views)
    for (const BallObservation& sighting : view.balls) seen[sighting.ball] = true;
  for (std::size_t ball = 0; ball < balls; ++ball)
    if (!seen[ball])
      return error(Code::config, "%.*s: ball %zu is never seen, but ball %zu is; number them without gaps",
                   static_cast<int>(target_name.size()), target_name.data(), ball + 1, balls);
  return views;
}

std::string write_poses(std::span<const Pose> poses, const PoseFormat& format, TableRole role,
                        std::span<const std::size_t> views, std::span<const std::size_t> balls) {
  std::string text;
  const bool neutral =
      format.rotation == RotationForm::quaternion_wxyz && !format.metres && !format.inverse && !format.labelled;
  if (!neutral) {
    text = "# format: rotation=" + std::string(name(format.rotation)) + (format.metres ? " unit=m" : " unit=mm");
    if (format.rotation == RotationForm::kuka_abc) text += format.radians ? " angle=rad" : " angle=deg";
    text += std::string(" frames=") + frames_of(role, format.inverse);
    text += format.labelled ? " labels=view,ball\n" : "\n";
  }
  FixedString<64> number;
  const auto add = [&](double v) {
    number.printf("%s%.17g", text.empty() || text.back() == '\n' ? "" : " ", v);
    text += number.view();
  };
  for (std::size_t i = 0; i < poses.size(); ++i) {
    const Pose pose = format.inverse ? poses[i].inverse() : poses[i];
    if (format.labelled && i < views.size() && i < balls.size()) {
      number.printf("%zu %zu", views[i] + 1, balls[i] + 1);
      text += number.view();
    }
    for (int axis = 0; axis < 3; ++axis) add(pose.translation_mm[axis] / (format.metres ? kMmPerM : 1.0));
    const Quat& q = pose.rotation;
    const KukaAbc abc = kuka_abc_from_rotation(q);
    const auto angle = [&](double rad) { return format.radians ? rad : deg_from_rad(rad); };
    switch (format.rotation) {
      case RotationForm::quaternion_wxyz:
        for (const double v : {q.w(), q.x(), q.y(), q.z()}) add(v);
        break;
      case RotationForm::quaternion_xyzw:
        for (const double v : {q.x(), q.y(), q.z(), q.w()}) add(v);
        break;
      case RotationForm::kuka_abc:
        for (const double v : {abc.a_rad, abc.b_rad, abc.c_rad}) add(angle(v));
        break;
      case RotationForm::none: break;
    }
    text += '\n';
  }
  return text;
}

bool same_place(const Pose& a, const Pose& b) {
  return (a.translation_mm - b.translation_mm).norm() < kSamePlace_mm &&
         angle_between_rad(a.rotation, b.rotation) < rad_from_deg(kSamePlace_deg);
}

}  // namespace slabd::calib
