// SPDX-License-Identifier: Apache-2.0
//
// The certificate of an artefact, as text. What it says is believed by every later calibration, so it is read strictly:
// no key unknown, missing or twice, nothing guessed, and a frame whose balls could be confused is not an artefact.
#include <algorithm>
#include <cctype>
#include <charconv>
#include <cmath>
#include <optional>
#include <utility>

#include "calib/ball/artefact.h"
#include "calib/ball/artefact_match.h"

namespace slabd::calib {
namespace {

constexpr const char* kKeys =
    "id, date, issuer, ball_radius_mm, ball_radius_U_mm, U_mm, coverage_factor, temperature_c, ball";
constexpr double kCoordinateMostMm = 3000.0;
/// Height of the flattest triangle: less and the frame's rotation about its long side is open.
constexpr double kHeightLeastMm = 20.0;

std::string_view trimmed(std::string_view text) {
  const auto blank = [](char c) { return c == ' ' || c == '\t' || c == '\r'; };
  while (!text.empty() && blank(text.front())) text.remove_prefix(1);
  while (!text.empty() && blank(text.back())) text.remove_suffix(1);
  return text;
}

/// Without a comment; a # between quotes is not one.
std::string_view without_comment(std::string_view line) {
  bool quoted = false;
  for (std::size_t i = 0; i < line.size(); ++i) {
    if (line[i] == '"') quoted = !quoted;
    if (line[i] == '#' && !quoted) return line.substr(0, i);
  }
  return line;
}

std::optional<double> number(std::string_view text) {
  double value = 0.0;
  const auto [end, fault] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (fault != std::errc() || end != text.data() + text.size() || !std::isfinite(value)) return std::nullopt;
  return value;
}

bool is_date(std::string_view text) {
  if (text.size() != 10 || text[4] != '-' || text[7] != '-') return false;
  for (const std::size_t i : {0U, 1U, 2U, 3U, 5U, 6U, 8U, 9U})
    if (std::isdigit(static_cast<unsigned char>(text[i])) == 0) return false;
  const int month = 10 * (text[5] - '0') + (text[6] - '0');
  const int day = 10 * (text[8] - '0') + (text[9] - '0');
  return month >= 1 && month <= 12 && day >= 1 && day <= 31;
}

/// One certificate while it is read.
class Reader {
 public:
  explicit Reader(std::string_view file_name) : file_(file_name) {}

  Status read_line(std::string_view text, int line) {
    line_ = line;
    text = trimmed(without_comment(text));
    if (text.empty()) return success();
    const std::size_t equals = text.find('=');
    if (equals == std::string_view::npos) return fault("'key = value' expected");
    const std::string_view key = trimmed(text.substr(0, equals));
    const std::string_view value = trimmed(text.substr(equals + 1));
    if (key == "ball") return read_ball(value);
    for (Words& words : words_)
      if (key == words.key) return read_words(words, value);
    for (Number& field : numbers_)
      if (key == field.key) return read_number(field, value);
    return error(Code::config, "%s:%d: unknown key '%.*s'; keys are %s", file_.c_str(), line_,
                 static_cast<int>(std::min<std::size_t>(key.size(), 40)), key.data(), kKeys);
  }

  Result<ArtefactCertificate> finish() {
    for (const Words& words : words_)
      if (words.required && !words.seen) return missing(words.key);
    for (const Number& field : numbers_)
      if (field.required && !field.seen) return missing(field.key);
    ArtefactCertificate& c = certificate_;
    c.id = words_[0].value;
    c.date.assign(words_[1].value.view());
    c.issuer = words_[2].value;
    if (!is_date(c.date.view()))
      return error(Code::config, "%s:%d: date '%s': must be a day as YYYY-MM-DD", file_.c_str(), words_[1].line,
                   c.date.c_str());
    c.ball_radius_mm = numbers_[0].value;
    const double coverage = numbers_[3].value;
    c.ball_radius_sigma_mm = numbers_[1].value / coverage;
    c.sigma_mm = numbers_[2].value / coverage;
    c.temperature_c = numbers_[4].value;
    if (const Status checked = check_certificate(c); !checked)
      return error(Code::config, "%s: %s", file_.c_str(), checked.error().text.c_str());
    return std::move(certificate_);
  }

 private:
  struct Words {
    const char* key;
    bool required;
    bool seen = false;
    int line = 0;
    FixedString<64> value{};
  };
  struct Number {
    const char* key;
    bool required;
    double low;
    double high;
    double value;
    bool seen = false;
  };

  Status fault(const char* what) const { return error(Code::config, "%s:%d: %s", file_.c_str(), line_, what); }
  Error missing(const char* key) const {
    return error(Code::config, "%s: the key %s is missing; keys are %s", file_.c_str(), key, kKeys);
  }

  Status read_words(Words& words, std::string_view value) {
    if (words.seen) return error(Code::config, "%s:%d: %s is given twice", file_.c_str(), line_, words.key);
    if (value.size() >= 2 && value.front() == '"' && value.back() == '"') value = value.substr(1, value.size() - 2);
    if (value.empty() || value.size() > words.value.capacity() || value.find('"') != std::string_view::npos)
      return error(Code::config, "%s:%d: %s must be 1 to %zu characters", file_.c_str(), line_, words.key,
                   words.value.capacity());
    if (std::any_of(value.begin(), value.end(),
                    [](char c) { return std::iscntrl(static_cast<unsigned char>(c)) != 0; }))
      return error(Code::config, "%s:%d: %s holds control characters", file_.c_str(), line_, words.key);
    words.seen = true;
    words.line = line_;
    words.value.assign(value);
    return success();
  }

  Status read_number(Number& field, std::string_view value) {
    if (field.seen) return error(Code::config, "%s:%d: %s is given twice", file_.c_str(), line_, field.key);
    const std::optional<double> v = number(value);
    if (!v || *v < field.low || *v > field.high)
      return error(Code::config, "%s:%d: %s must be a number within %g .. %g", file_.c_str(), line_, field.key,
                   field.low, field.high);
    field.seen = true;
    field.value = *v;
    return success();
  }

  Status read_ball(std::string_view value) {
    Vec3 p;
    for (int axis = 0; axis < 3; ++axis) {
      value = trimmed(value);
      const std::size_t end = std::min(value.find_first_of(" \t,"), value.size());
      const std::optional<double> v = number(value.substr(0, end));
      if (!v || std::abs(*v) > kCoordinateMostMm)
        return error(Code::config, "%s:%d: ball must be three coordinates x y z in mm, each within +-%g", file_.c_str(),
                     line_, kCoordinateMostMm);
      p[axis] = *v;
      value.remove_prefix(end);
      value = trimmed(value);
      if (axis < 2 && !value.empty() && value.front() == ',') value.remove_prefix(1);
    }
    if (!value.empty()) return fault("ball must be three coordinates x y z in mm and nothing after them");
    if (certificate_.balls_mm.size() == kArtefactBallsMax)
      return error(Code::config, "%s:%d: an artefact has at most %zu balls", file_.c_str(), line_, kArtefactBallsMax);
    certificate_.balls_mm.push_back(p);
    return success();
  }

  std::string file_;
  int line_ = 0;
  ArtefactCertificate certificate_;
  std::array<Words, 3> words_ = {Words{"id", true}, Words{"date", true}, Words{"issuer", false}};
  std::array<Number, 5> numbers_ = {
      Number{"ball_radius_mm", true, 1.0, 200.0, kNoValue}, Number{"ball_radius_U_mm", true, 0.0, 1.0, kNoValue},
      Number{"U_mm", true, 0.0, 1.0, kNoValue}, Number{"coverage_factor", true, 1.0, 4.0, kNoValue},
      Number{"temperature_c", false, -20.0, 60.0, 20.0}};
};

}  // namespace

Status check_certificate(const ArtefactCertificate& c) {
  const std::vector<Vec3>& balls = c.balls_mm;
  if (balls.size() < kArtefactBallsMin || balls.size() > kArtefactBallsMax)
    return error(Code::config, "%zu balls: an artefact has %zu to %zu", balls.size(), kArtefactBallsMin,
                 kArtefactBallsMax);
  double longest = 0.0;
  std::pair<std::size_t, std::size_t> ends;
  for (std::size_t i = 0; i < balls.size(); ++i)
    for (std::size_t j = i + 1; j < balls.size(); ++j) {
      const double distance = (balls[i] - balls[j]).norm();
      if (!(distance > 2.0 * c.ball_radius_mm))
        return error(Code::config, "balls %zu and %zu are %.3f mm apart, less than their diameter", i + 1, j + 1,
                     distance);
      if (distance > longest) {
        longest = distance;
        ends = {i, j};
      }
    }
  const Vec3 along = (balls[ends.second] - balls[ends.first]).normalized();
  double height = 0.0;
  for (const Vec3& p : balls) height = std::max(height, (p - balls[ends.first]).cross(along).norm());
  if (!(height > kHeightLeastMm))
    return error(Code::config,
                 "the balls lie on a line within %.1f mm: one must be at least %g mm off it, or the frame can turn "
                 "about that line",
                 height, kHeightLeastMm);
  const Assignments own = assign_by_distance(balls, balls, kTellApartMm);
  if (own.found.size() > 1) {
    std::size_t k = 0;
    while (own.found[0][k] == own.found[1][k]) ++k;
    return error(Code::config,
                 "balls %d and %d cannot be told apart by their distances: distances must differ by more than %g mm",
                 own.found[0][k] + 1, own.found[1][k] + 1, kTellApartMm);
  }
  return success();
}

Result<ArtefactCertificate> parse_certificate(std::string_view text, std::string_view file_name) {
  Reader reader(file_name);
  for (int line = 1; !text.empty(); ++line) {
    const std::size_t end = std::min(text.find('\n'), text.size());
    if (const Status read = reader.read_line(text.substr(0, end), line); !read) return read.error();
    text.remove_prefix(std::min(end + 1, text.size()));
  }
  return reader.finish();
}

std::string certificate_text(const ArtefactCertificate& c) {
  std::string text;
  const auto add = [&](const char* key, double value) {
    FixedString<96> line;
    line.printf("%s = %.17g\n", key, value);
    text += line.view();
  };
  const auto quoted = [&](const char* key, std::string_view value) {
    text.append(key).append(" = \"").append(value).append("\"\n");
  };
  quoted("id", c.id.view());
  quoted("date", c.date.view());
  if (!c.issuer.empty()) quoted("issuer", c.issuer.view());
  // Written with k = 1, so that no digit is lost.
  add("coverage_factor", 1.0);
  add("ball_radius_mm", c.ball_radius_mm);
  add("ball_radius_U_mm", c.ball_radius_sigma_mm);
  add("U_mm", c.sigma_mm);
  add("temperature_c", c.temperature_c);
  for (const Vec3& p : c.balls_mm) {
    FixedString<128> line;
    line.printf("ball = %.17g %.17g %.17g\n", p.x(), p.y(), p.z());
    text += line.view();
  }
  return text;
}

}  // namespace slabd::calib
