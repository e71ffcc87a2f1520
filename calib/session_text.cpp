// SPDX-License-Identifier: Apache-2.0
//
// Records that people read and edit at their own risk: `key = value` lines, and a checksum over them as the last one.
// The checksum tells a file that was cut off by a power failure, or changed by hand, from what slabctl wrote. It guards
// against accidents, not against forgery.
#include <sha256.h>

#include <algorithm>
#include <array>

#include "calib/record_text.h"

namespace slabd::calib {
namespace {

constexpr std::string_view kChecksumKey = "sha256 = ";

Error wrong(std::string_view file, const char* what) {
  return error(Code::config, "%.*s: %s", static_cast<int>(file.size()), file.data(), what);
}

/// The lower triangle of a symmetric matrix, row by row.
std::array<double, 21> triangle(const Mat6& m) {
  std::array<double, 21> t{};
  std::size_t i = 0;
  for (int row = 0; row < 6; ++row)
    for (int column = 0; column <= row; ++column) t[i++] = m(row, column);
  return t;
}
Mat6 from_triangle(const std::array<double, 21>& t) {
  Mat6 m;
  std::size_t i = 0;
  for (int row = 0; row < 6; ++row)
    for (int column = 0; column <= row; ++column) m(row, column) = m(column, row) = t[i++];
  return m;
}

}  // namespace

Result<RecordReader> reader_of(std::string_view text, std::string_view file_name) {
  const Result<std::string> body = without_checksum(text, file_name);
  if (!body) return body.error();
  Result<std::vector<KeyLine>> lines = key_lines(body.value(), file_name);
  if (!lines) return lines.error();
  return RecordReader(std::move(lines.value()), file_name);
}

std::string_view name(ViewUse use) {
  switch (use) {
    case ViewUse::refused: return "refused";
    case ViewUse::fit: return "fit";
    case ViewUse::held_out: return "held_out";
  }
  return "?";
}

std::string sha256_hex(std::string_view bytes) {
  std::array<char, SHA256_DIGEST_STRING_LENGTH> hex{};
  SHA256Data(reinterpret_cast<const std::uint8_t*>(bytes.data()), bytes.size(), hex.data());
  return {hex.data()};
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

std::string session_text(const SessionSettings& s) {
  RecordWriter w;
  w.comment("a calibration by slabctl calibrate; agreed at its beginning, not to be edited");
  w.line("kind", name(s.kind)).text("name", s.name).text("created", s.created).text("config", s.config);
  w.text("operator", s.operator_name).number("radius_mm", s.radius_mm).number("radius_sigma_mm", s.radius_sigma_mm);
  w.number("robot_sigma_mm", s.noise.robot_mm).number("robot_sigma_rad", s.noise.robot_rad);
  w.number("target_sigma_mm", s.noise.target_mm).number("target_sigma_rad", s.noise.target_rad);
  w.number("limit_mm", s.limit_mm);
  w.numbers("fov_mm", std::array{s.fov.half_x_mm, s.fov.half_y_mm, s.fov.near_mm, s.fov.far_mm});
  w.number("scanner_noise_mm", s.scanner_noise_mm).number("noise_correlation_mm", s.noise_correlation_mm);
  w.count("parallel", s.parallel ? 1 : 0).line("unit", s.unit).count("goal", s.goal).count("held_out", s.held_out);
  w.text("flange_form", s.flange_form);
  if (!s.certificate_sha256.empty()) w.text("certificate_sha256", s.certificate_sha256);
  w.numbers("down_base", std::array{s.down_base.x(), s.down_base.y(), s.down_base.z()});
  if (s.has_start) w.numbers("T_flange_scanner_start", s.T_flange_scanner.to_array()).text("start_id", s.start_id);
  return w.done();
}

Result<SessionSettings> parse_session(std::string_view text, std::string_view file_name) {
  Result<RecordReader> reader = reader_of(text, file_name);
  if (!reader) return reader.error();
  RecordReader& r = reader.value();
  SessionSettings s;
  std::string kind;
  r.text("kind", kind);
  s.kind = kind == name(ArtefactKind::pose) ? ArtefactKind::pose : ArtefactKind::ball;
  r.text("name", s.name);
  r.text("created", s.created);
  r.text("config", s.config);
  r.text("operator", s.operator_name);
  r.number("radius_mm", s.kind == ArtefactKind::ball, s.radius_mm);
  r.number("radius_sigma_mm", true, s.radius_sigma_mm);
  r.number("robot_sigma_mm", true, s.noise.robot_mm);
  r.number("robot_sigma_rad", true, s.noise.robot_rad);
  r.number("target_sigma_mm", true, s.noise.target_mm);
  r.number("target_sigma_rad", true, s.noise.target_rad);
  r.number("limit_mm", false, s.limit_mm);
  std::array<double, 4> fov{};
  const bool has_fov = r.numbers("fov_mm", fov);
  s.fov = {fov[0], fov[1], fov[2], fov[3]};
  r.number("scanner_noise_mm", true, s.scanner_noise_mm);
  r.number("noise_correlation_mm", true, s.noise_correlation_mm);
  unsigned parallel = 0;
  r.count("parallel", parallel, 1.0);
  s.parallel = parallel == 1;
  r.text("unit", s.unit);
  r.count("goal", s.goal, 400.0);
  r.count("held_out", s.held_out, 400.0);
  r.text("flange_form", s.flange_form);
  r.text("certificate_sha256", s.certificate_sha256);
  std::array<double, 3> down{};
  const bool has_down = r.numbers("down_base", down);
  s.down_base = Vec3(down[0], down[1], down[2]);
  std::array<double, 7> start{};
  s.has_start = r.numbers("T_flange_scanner_start", start);
  if (s.has_start) s.T_flange_scanner = Pose::from_array(start);
  r.text("start_id", s.start_id);
  if (const Status status = r.keys().finish("those slabctl writes"); !status) return status.error();
  if (!has_fov || !has_down || (kind != "ball" && kind != "pose") || s.down_base.norm() < 0.5)
    return wrong(file_name, "kind, fov_mm or down_base is missing or makes no sense");
  return s;
}

std::string view_text(const CapturedView& v) {
  RecordWriter w;
  w.comment("one view, by slabctl calibrate capture; mm and deg, T_scanner_target as x y z qw qx qy qz");
  w.count("view", v.number).count("step", v.step).text("captured", v.captured).line("use", name(v.use));
  w.text("refusal", v.refusal).text("reason", v.reason).text("cure", v.cure);
  w.text("flange_form", v.flange_form).text("T_base_flange", v.flange);
  for (const KeptShot& shot : v.shots)
    w.line("shot",
           in_quotes(shot.file) + " " + std::to_string(shot.bytes) + " " + shot.sha256 + " " + in_quotes(shot.source));
  if (v.live.given) {
    w.number("pose_spread_mm", v.live.spread_mm).number("pose_spread_deg", v.live.spread_deg);
    w.line("pose_seq", std::to_string(v.live.seq_first) + " " + std::to_string(v.live.seq_last));
    w.line("pose_utime_us", std::to_string(v.live.utime_first_us) + " " + std::to_string(v.live.utime_last_us));
  }
  w.count("points", v.points).number("half_angle_deg", v.half_angle_deg).number("rms_mm", v.rms_mm);
  w.number("radius_off_mm", v.radius_off_mm).number("repeat_mm", v.repeat_mm);
  if (v.accepted())
    w.numbers("T_scanner_target", v.T_scanner_target.to_array()).numbers("covariance", triangle(v.covariance));
  return w.done();
}

Result<CapturedView> parse_view(std::string_view text, std::string_view file_name) {
  Result<RecordReader> reader = reader_of(text, file_name);
  if (!reader) return reader.error();
  RecordReader& r = reader.value();
  CapturedView v;
  r.count("view", v.number, 9999.0);
  r.count("step", v.step, 1e6);
  r.text("captured", v.captured);
  std::string use;
  r.text("use", use);
  v.use = use == "fit" ? ViewUse::fit : use == "held_out" ? ViewUse::held_out : ViewUse::refused;
  r.text("refusal", v.refusal);
  r.text("reason", v.reason);
  r.text("cure", v.cure);
  r.text("flange_form", v.flange_form);
  r.text("T_base_flange", v.flange);
  for (const KeyLine* line : r.keys().all("shot")) {
    double bytes = 0.0;
    if (line->words.size() != 4 || !number_from(line->words[1], bytes))
      r.keys().fault(*line, "must be file, bytes, sha256, source");
    else
      v.shots.push_back({line->words[0], line->words[3], static_cast<std::uint64_t>(bytes), line->words[2]});
  }
  std::array<double, 2> pair{};
  v.live.given = r.numbers("pose_seq", pair);
  v.live.seq_first = static_cast<std::int64_t>(pair[0]);
  v.live.seq_last = static_cast<std::int64_t>(pair[1]);
  for (const KeyLine* line : r.keys().all("pose_utime_us")) {
    std::vector<double> times;  // us since 1970: beyond what other numbers may be, and exact in a double
    if (r.keys().numbers(*line, 0, 9e15, times) && times.size() == 2) {
      v.live.utime_first_us = static_cast<std::int64_t>(times[0]);
      v.live.utime_last_us = static_cast<std::int64_t>(times[1]);
    }
  }
  r.number("pose_spread_mm", false, v.live.spread_mm);
  r.number("pose_spread_deg", false, v.live.spread_deg);
  r.count("points", v.points);
  r.number("half_angle_deg", false, v.half_angle_deg);
  r.number("rms_mm", false, v.rms_mm);
  r.number("radius_off_mm", false, v.radius_off_mm);
  r.number("repeat_mm", false, v.repeat_mm);
  std::array<double, 7> pose{};
  std::array<double, 21> covariance{};
  const bool found = r.numbers("T_scanner_target", pose);
  const bool known = r.numbers("covariance", covariance);
  if (const Status status = r.keys().finish("those slabctl writes"); !status) return status.error();
  if (v.number == 0 || v.shots.empty() || v.flange.empty() || (v.accepted() && !(found && known)) ||
      (v.use == ViewUse::refused && use != "refused"))
    return wrong(file_name, "view, use, shot, T_base_flange or T_scanner_target is missing or makes no sense");
  if (v.accepted()) {
    // Not normalised again: the same bits come back.
    v.T_scanner_target = {Quat(pose[3], pose[4], pose[5], pose[6]), Vec3(pose[0], pose[1], pose[2])};
    v.covariance = from_triangle(covariance);
  }
  return v;
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
  w.numbers("noise", std::array{s.noise.robot_mm, s.noise.robot_rad, s.noise.target_mm, s.noise.target_rad});
  w.number("limit_mm", s.limit_mm);
  w.numbers("fov_mm", std::array{s.fov.half_x_mm, s.fov.half_y_mm, s.fov.near_mm, s.fov.far_mm});
  for (const View& view : views) {
    w.count("view", view.number).numbers("T_base_flange", view.T_base_flange.to_array());
    if (view.reported_abc_rad) w.numbers("reported_abc_rad", *view.reported_abc_rad);
    for (const BallSighting& seen : view.balls)
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
  // The line is one of the table that was put together to read it, and nobody has that.
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
