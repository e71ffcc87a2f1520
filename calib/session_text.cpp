// SPDX-License-Identifier: Apache-2.0
//
// Records that people may read and edit: `key = value` lines, followed by a checksum. The checksum detects a file that
// was truncated by a power failure or edited by hand. It protects against accidents, not against forgery.
//
// Each record has one list of fields, fields(), which is used for writing with a RecordWriter and for reading with a
// RecordReader.
#include <algorithm>
#include <array>
#include <concepts>
#include <span>

#include "base/fields.h"
#include "calib/key_lines.h"
#include "calib/session.h"

namespace slabd::calib {
namespace {

constexpr std::string_view kChecksumKey = "sha256 = ";
constexpr double kNumberMost = 1e12;
constexpr double kCountMost = 9e15;  ///< exactly representable as a double
constexpr double kStepMost = 1e6;

Error wrong(std::string_view file, const char* what) {
  return error(Code::config, "%.*s: %s", static_cast<int>(file.size()), file.data(), what);
}

/// Text in quotes; inner quotes and line breaks are replaced, because they would break the line.
std::string in_quotes(std::string_view text) {
  std::string out = "\"";
  for (const char c : text.substr(0, std::size_t{4096})) out += c == '"' ? '\'' : c == '\n' || c == '\r' ? ' ' : c;
  return out + "\"";
}

/// Writes lines in order, with the checksum last.
class RecordWriter {
 public:
  static constexpr bool kReads = false;
  using Self = RecordWriter&;

  void comment(std::string_view words) { text_.append("# ").append(words).append("\n"); }
  Self line(std::string_view key, std::string_view value) {
    text_.append(key).append(" = ").append(value).append("\n");
    return *this;
  }
  Self text(std::string_view key, std::string_view value) {
    return value.empty() ? *this : line(key, in_quotes(value));
  }
  /// Writes a value without quotes.
  Self word(std::string_view key, std::string_view value) { return line(key, value); }
  template <typename Enum>
  bool choice(std::string_view key, Enum value, std::initializer_list<Enum> /*all*/) {
    line(key, name(value));
    return true;
  }
  Self number(std::string_view key, double value, bool /*required*/ = false) {
    return has_value(value) ? line(key, number_text(value)) : *this;
  }
  Self count(std::string_view key, std::uint64_t value, double /*most*/ = kCountMost) {
    return line(key, std::to_string(value));
  }
  Self flag(std::string_view key, bool value) { return line(key, value ? "1" : "0"); }
  Self numbers(std::string_view key, std::span<const double> values) {
    std::string row;
    for (const double v : values) row += (row.empty() ? "" : " ") + number_text(v);
    return line(key, row);
  }
  template <std::same_as<double>... Numbers>
  bool row(std::string_view key, const Numbers&... values) {
    numbers(key, std::array{values...});
    return true;
  }
  bool pair(std::string_view key, double /*most*/, std::int64_t first, std::int64_t last) {
    line(key, std::to_string(first) + " " + std::to_string(last));
    return true;
  }
  Self pose(std::string_view key, const Pose& pose, bool given) {
    return given ? numbers(key, pose.to_array()) : *this;
  }
  /// Writes the lower triangle of a symmetric matrix, row by row.
  Self triangle(std::string_view key, const Mat6& m, bool given) {
    std::vector<double> values;
    for (int row = 0; row < 6; ++row)
      for (int column = 0; column <= row; ++column) values.push_back(m(row, column));
    return given ? numbers(key, values) : *this;
  }
  Self shots(std::string_view key, const std::vector<KeptShot>& shots) {
    for (const KeptShot& s : shots)
      line(key, in_quotes(s.file) + " " + std::to_string(s.bytes) + " " + s.sha256 + " " + in_quotes(s.source));
    return *this;
  }
  [[nodiscard]] std::string done() { return with_checksum(std::move(text_)); }

 private:
  std::string text_;
};

/// Reads the same fields from the lines of a file. Missing optional fields leave the member unchanged.
class RecordReader {
 public:
  static constexpr bool kReads = true;
  using Self = RecordReader&;

  RecordReader(std::vector<KeyLine> lines, std::string_view file) : keys_(std::move(lines), file) {}

  void comment(std::string_view /*words*/) {}
  Self text(std::string_view key, std::string& out) {
    for (const KeyLine* line : keys_.all(key)) {
      if (line->words.size() == 1)
        out = line->words[0];
      else
        keys_.fault(*line, "must be one text between quotes");
    }
    return *this;
  }
  Self word(std::string_view key, std::string& out) { return text(key, out); }
  /// Reads one of `all`; if the word is another, returns false and leaves `out` unchanged.
  template <typename Enum>
  bool choice(std::string_view key, Enum& out, std::initializer_list<Enum> all) {
    std::string found;
    text(key, found);
    const auto* const chosen = std::find_if(all.begin(), all.end(), [&](Enum e) { return found == name(e); });
    if (chosen == all.end()) return false;
    out = *chosen;
    return true;
  }
  Self number(std::string_view key, double& out, bool required = false) {
    keys_.number(key, required, -kNumberMost, kNumberMost, out);
    return *this;
  }
  template <typename Integer>
  Self count(std::string_view key, Integer& out, double most = kCountMost) {
    double value = static_cast<double>(out);
    keys_.number(key, true, 0.0, most, value);
    out = static_cast<Integer>(value);
    return *this;
  }
  Self flag(std::string_view key, bool& out) {
    unsigned value = 0;
    count(key, value, 1.0);
    out = value == 1;
    return *this;
  }
  template <std::same_as<double>... Numbers>
  bool row(std::string_view key, Numbers&... out) {
    std::array<double, sizeof...(out)> found{};
    if (!take(key, kNumberMost, found)) return false;
    std::size_t i = 0;
    ((out = found[i++]), ...);
    return true;
  }
  bool pair(std::string_view key, double most, std::int64_t& first, std::int64_t& last) {
    std::array<double, 2> found{};
    if (!take(key, most, found)) return false;
    first = static_cast<std::int64_t>(found[0]);
    last = static_cast<std::int64_t>(found[1]);
    return true;
  }
  /// Not normalised again, so that the same bits are read.
  Self pose(std::string_view key, Pose& out, bool& given) {
    std::array<double, 7> p{};
    given = take(key, kNumberMost, p);
    if (given) out = {Quat(p[3], p[4], p[5], p[6]), Vec3(p[0], p[1], p[2])};
    return *this;
  }
  Self triangle(std::string_view key, Mat6& out, bool& given) {
    std::array<double, 21> values{};
    given = take(key, kNumberMost, values);
    std::size_t i = 0;
    for (int row = 0; row < 6 && given; ++row)
      for (int column = 0; column <= row; ++column) out(row, column) = out(column, row) = values[i++];
    return *this;
  }
  Self shots(std::string_view key, std::vector<KeptShot>& out) {
    for (const KeyLine* line : keys_.all(key)) {
      double bytes = 0.0;
      if (line->words.size() != 4 || !number_from(line->words[1], bytes))
        keys_.fault(*line, "must be file, bytes, sha256, source");
      else
        out.push_back({line->words[0], line->words[3], static_cast<std::uint64_t>(bytes), line->words[2]});
    }
    return *this;
  }
  [[nodiscard]] Status done() { return keys_.finish("those slabctl writes"); }

 private:
  template <std::size_t N>
  bool take(std::string_view key, double most, std::array<double, N>& out) {
    const std::vector<const KeyLine*> lines = keys_.all(key);
    std::vector<double> found;
    if (lines.empty() || !keys_.numbers(*lines.front(), 0, most, found)) return false;
    if (found.size() != N) {
      keys_.fault(*lines.front(), "must be " + std::to_string(N) + " numbers");
      return false;
    }
    std::copy(found.begin(), found.end(), out.begin());
    return true;
  }

  KeyFile keys_;
};

/// Fields of each record in the order of its lines. Returns false if a required one is missing or invalid.
template <typename Form, RecordOf<SessionSettings> Record>
bool fields(Form& f, Record& s) {
  f.comment("a calibration by slabctl calibrate; agreed at its beginning, not to be edited");
  bool whole = f.choice("kind", s.kind, {ArtefactKind::ball, ArtefactKind::pose});
  f.text("name", s.name).text("created", s.created).text("config", s.config).text("operator", s.operator_name);
  f.text("scanner", s.scanner);
  f.number("radius_mm", s.radius_mm, s.kind == ArtefactKind::ball).number("radius_sigma_mm", s.radius_sigma_mm, true);
  f.number("robot_sigma_mm", s.noise.robot_mm, true).number("robot_sigma_rad", s.noise.robot_rad, true);
  f.number("target_sigma_mm", s.noise.target_mm, true).number("target_sigma_rad", s.noise.target_rad, true);
  f.number("limit_mm", s.limit_mm);
  whole = f.row("fov_mm", s.fov.half_x_mm, s.fov.half_y_mm, s.fov.near_mm, s.fov.far_mm) && whole;
  f.number("scanner_noise_mm", s.scanner_noise_mm, true).number("noise_correlation_mm", s.noise_correlation_mm, true);
  f.flag("parallel", s.parallel).word("unit", s.unit).text("columns", s.columns);
  f.count("goal", s.goal, 400.0).count("held_out", s.held_out, 400.0);
  f.text("flange_form", s.flange_form).text("certificate_sha256", s.certificate_sha256);
  whole = f.row("down_base", s.down_base.x(), s.down_base.y(), s.down_base.z()) && whole;
  f.pose("T_flange_scanner_start", s.T_flange_scanner, s.has_start);
  if (Form::kReads || s.has_start) f.text("start_id", s.start_id);
  if constexpr (Form::kReads)
    if (s.has_start) s.T_flange_scanner = Pose::from_array(s.T_flange_scanner.to_array());
  return whole && s.down_base.norm() >= 0.5;
}

template <typename Form, RecordOf<CapturedView> Record>
bool fields(Form& f, Record& v) {
  f.comment("one view, by slabctl calibrate capture; mm and deg, T_scanner_target as x y z qw qx qy qz");
  f.count("view", v.number, 9999.0).count("step", v.step, kStepMost).text("captured", v.captured);
  const bool is_used = f.choice("use", v.use, {ViewUse::refused, ViewUse::fit, ViewUse::held_out});
  f.text("refusal", v.refusal).text("reason", v.reason).text("cure", v.cure);
  f.text("flange_form", v.flange_form).text("T_base_flange", v.flange).shots("shot", v.shots);
  if (Form::kReads || v.live.given) {
    f.number("pose_spread_mm", v.live.spread_mm).number("pose_spread_deg", v.live.spread_deg);
    const bool is_live = f.pair("pose_seq", kNumberMost, v.live.seq_first, v.live.seq_last);
    if constexpr (Form::kReads) v.live.given = is_live;
    f.pair("pose_utime_us", kCountMost, v.live.utime_first_us, v.live.utime_last_us);
  }
  f.count("points", v.points).number("half_angle_deg", v.half_angle_deg).number("rms_mm", v.rms_mm);
  f.number("radius_off_mm", v.radius_off_mm).number("repeat_mm", v.repeat_mm);
  bool is_found = v.accepted();
  bool is_known = v.accepted();
  f.pose("T_scanner_target", v.T_scanner_target, is_found).triangle("covariance", v.covariance, is_known);
  return is_used && v.number != 0 && !v.shots.empty() && !v.flange.empty() && (!v.accepted() || (is_found && is_known));
}

template <typename Form, RecordOf<ViewChange> Record>
bool fields(Form& f, Record& c) {
  f.count("step", c.step, kStepMost).count("undoes", c.undoes, kStepMost);
  f.text("when", c.when).text("who", c.who).text("why", c.why);
  return true;
}

template <typename Form, RecordOf<SolvedRecord> Record>
bool fields(Form& f, Record& s) {
  f.comment("T_flange_scanner maps scanner coordinates to flange coordinates; x y z qw qx qy qz, mm");
  f.count("step", s.step, kStepMost).text("when", s.when).text("id", s.id);
  f.text("inputs", s.inputs).text("figures", s.figures).flag("ok", s.ok);
  bool is_determined = has_value(s.numbers.sigma_mm);
  f.pose("T_flange_scanner", s.numbers.T_flange_scanner, is_determined);
  f.number("sigma_mm", s.numbers.sigma_mm).number("sigma_rad", s.numbers.sigma_rad);
  f.number("point_sigma_mm", s.point_sigma_mm).number("leave_one_out_mm", s.leave_one_out_mm).number("s0", s.s0);
  // Never applicable unless the record is complete.
  if constexpr (Form::kReads)
    s.ok = s.ok && is_determined && has_value(s.numbers.sigma_mm) && has_value(s.numbers.sigma_rad) && !s.id.empty();
  return true;
}

template <typename Form, RecordOf<VerifiedRecord> Record>
bool fields(Form& f, Record& v) {
  f.text("when", v.when).text("who", v.who).text("inputs", v.inputs).text("before_id", v.before_id);
  f.number("before_rms_mm", v.before_rms_mm).number("after_rms_mm", v.after_rms_mm, true);
  f.number("after_max_mm", v.after_max_mm, true).number("shift_max_mm", v.shift_max_mm);
  return true;
}

/// Reads a record with a valid checksum. `lacking`: error text if a required field is invalid.
template <typename Record>
Result<Record> read_record(std::string_view text, std::string_view file_name, const char* lacking = "") {
  const Result<std::string> body = without_checksum(text, file_name);
  if (!body) return body.error();
  Result<std::vector<KeyLine>> lines = key_lines(body.value(), file_name);
  if (!lines) return lines.error();
  RecordReader reader(std::move(lines.value()), file_name);
  Record record;
  const bool whole = fields(reader, record);
  if (const Status status = reader.done(); !status) return status.error();
  if (!whole) return wrong(file_name, lacking);
  return record;
}

template <typename Record>
std::string record_text(const Record& record) {
  RecordWriter writer;
  fields(writer, record);
  return writer.done();
}

}  // namespace

std::string_view name(ViewUse use) {
  switch (use) {
    case ViewUse::refused: return "refused";
    case ViewUse::fit: return "fit";
    case ViewUse::held_out: return "held_out";
  }
  return "?";
}

std::string with_checksum(std::string body) {
  const std::string sum = sha256_hex(body);
  return body.append(kChecksumKey).append(sum).append("\n");
}

Result<std::string> without_checksum(std::string_view text, std::string_view file_name) {
  const std::size_t at = text.rfind(kChecksumKey);
  if (at == std::string_view::npos || (at > 0 && text[at - 1] != '\n') || !text.ends_with('\n'))
    return wrong(file_name, "its last line, the checksum, is missing: the file is cut off");
  std::string body(text.substr(0, at));
  if (text.substr(at + kChecksumKey.size()) != sha256_hex(body) + "\n")
    return wrong(file_name, "its checksum does not fit: the file was changed after it was written");
  return body;
}

std::string session_text(const SessionSettings& settings) {
  return record_text(settings);
}

Result<SessionSettings> parse_session(std::string_view text, std::string_view file_name) {
  return read_record<SessionSettings>(text, file_name, "kind, fov_mm or down_base is missing or makes no sense");
}

std::string view_text(const CapturedView& view) {
  return record_text(view);
}

Result<CapturedView> parse_view(std::string_view text, std::string_view file_name) {
  return read_record<CapturedView>(text, file_name,
                                   "view, use, shot, T_base_flange or T_scanner_target is missing or makes no sense");
}

std::string change_text(const ViewChange& change) {
  return record_text(change);
}

Result<ViewChange> parse_view_change(std::string_view text, std::string_view file_name) {
  return read_record<ViewChange>(text, file_name);
}

std::string solved_text(const SolvedRecord& solved) {
  return record_text(solved);
}

Result<SolvedRecord> parse_solved(std::string_view text, std::string_view file_name) {
  return read_record<SolvedRecord>(text, file_name);
}

std::string verified_text(const VerifiedRecord& verified) {
  return record_text(verified);
}

Result<VerifiedRecord> parse_verified(std::string_view text, std::string_view file_name) {
  return read_record<VerifiedRecord>(text, file_name);
}

Result<View> solver_view(ArtefactKind kind, const CapturedView& view, std::string_view origin) {
  const auto table = [](std::string_view form, std::string_view numbers) {
    return (form.empty() ? std::string() : "# format: " + std::string(form) + "\n") + std::string(numbers) + "\n";
  };
  const Result<PoseTable> flange = parse_poses(table(view.flange_form, view.flange), origin, TableRole::flange);
  if (!flange) return flange.error();
  const std::array one = {view.T_scanner_target};
  const Result<PoseTable> target =
      parse_poses(write_poses(one, PoseFormat{}, TableRole::target), origin, TableRole::target);
  if (!target) return target.error();
  Result<std::vector<View>> views = views_from(kind, flange.value(), origin, target.value(), origin);
  if (!views) return views.error();
  View found = views.value().front();
  found.number = view.number;
  return found;
}

std::string solver_inputs(const SessionSettings& s, const std::vector<View>& views) {
  RecordWriter w;
  w.line("kind", name(s.kind));
  w.row("noise", s.noise.robot_mm, s.noise.robot_rad, s.noise.target_mm, s.noise.target_rad);
  w.number("limit_mm", s.limit_mm);
  w.row("fov_mm", s.fov.half_x_mm, s.fov.half_y_mm, s.fov.near_mm, s.fov.far_mm);
  for (const View& view : views) {
    w.count("view", view.number);
    w.numbers("T_base_flange", view.T_base_flange.to_array());
    if (view.reported_abc_rad) w.numbers("reported_abc_rad", *view.reported_abc_rad);
    for (const BallObservation& seen : view.balls)
      w.numbers("centre_mm", std::span<const double>(seen.centre_mm.data(), 3));
    w.numbers("T_scanner_target", view.T_scanner_target.to_array());
  }
  return w.done();
}

Result<Pose> parse_flange(std::string_view form, std::string_view numbers, std::string_view origin) {
  CapturedView view;
  view.flange_form = form;
  view.flange = numbers;
  const Result<View> read = solver_view(ArtefactKind::pose, view, origin);
  if (read) return read.value().T_base_flange;
  // The line number refers to a temporary table, so it is removed from the error.
  std::string text(read.error().text.view());
  const std::string named = std::string(origin) + ":";
  const std::size_t end = text.find(':', named.size());
  if (text.starts_with(named) && end != std::string::npos && text.find_first_not_of("0123456789", named.size()) == end)
    text.erase(named.size(), end - named.size() + 1);
  return error(read.error().code, "%s", text.c_str());
}

bool hold_out_next(const SessionSettings& settings, std::size_t counted, std::size_t held_out) {
  const std::size_t goal = std::max<std::size_t>(settings.goal, 1);
  return held_out < (counted + 1) * settings.held_out / goal;
}

}  // namespace slabd::calib
