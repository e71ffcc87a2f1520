// SPDX-License-Identifier: Apache-2.0
//
// The short records of a calibration done view by view: what was dropped or undone, solved, verified.
#include "calib/record_text.h"

namespace slabd::calib {

std::string change_text(const ViewChange& c) {
  RecordWriter w;
  w.count("step", c.step).count("undoes", c.undoes).text("when", c.when).text("who", c.who).text("why", c.why);
  return w.done();
}

Result<ViewChange> parse_view_change(std::string_view text, std::string_view file_name) {
  Result<RecordReader> reader = reader_of(text, file_name);
  if (!reader) return reader.error();
  RecordReader& r = reader.value();
  ViewChange c;
  r.count("step", c.step, 1e6);
  r.count("undoes", c.undoes, 1e6);
  r.text("when", c.when);
  r.text("who", c.who);
  r.text("why", c.why);
  if (const Status status = r.keys().finish("those slabctl writes"); !status) return status.error();
  return c;
}

std::string solved_text(const SolvedRecord& s) {
  RecordWriter w;
  w.comment("T_flange_scanner maps scanner coordinates to flange coordinates; x y z qw qx qy qz, mm");
  w.count("step", s.step).text("when", s.when).text("id", s.id).text("inputs", s.inputs).text("figures", s.figures);
  w.count("ok", s.ok ? 1 : 0);
  if (has_value(s.numbers.sigma_mm)) w.numbers("T_flange_scanner", s.numbers.T_flange_scanner.to_array());
  w.number("sigma_mm", s.numbers.sigma_mm).number("sigma_rad", s.numbers.sigma_rad);
  w.number("point_sigma_mm", s.point_sigma_mm).number("leave_one_out_mm", s.leave_one_out_mm).number("s0", s.s0);
  return w.done();
}

Result<SolvedRecord> parse_solved(std::string_view text, std::string_view file_name) {
  Result<RecordReader> reader = reader_of(text, file_name);
  if (!reader) return reader.error();
  RecordReader& r = reader.value();
  SolvedRecord s;
  unsigned ok = 0;
  r.count("step", s.step, 1e6);
  r.text("when", s.when);
  r.text("id", s.id);
  r.text("inputs", s.inputs);
  r.text("figures", s.figures);
  r.count("ok", ok, 1.0);
  std::array<double, 7> pose{};
  const bool determined = r.numbers("T_flange_scanner", pose);
  r.number("sigma_mm", false, s.numbers.sigma_mm);
  r.number("sigma_rad", false, s.numbers.sigma_rad);
  r.number("point_sigma_mm", false, s.point_sigma_mm);
  r.number("leave_one_out_mm", false, s.leave_one_out_mm);
  r.number("s0", false, s.s0);
  if (const Status status = r.keys().finish("those slabctl writes"); !status) return status.error();
  // Never applied unless everything is there.
  s.ok = ok == 1 && determined && has_value(s.numbers.sigma_mm) && has_value(s.numbers.sigma_rad) && !s.id.empty();
  // Not normalised again: the same bits come back.
  if (determined)
    s.numbers.T_flange_scanner = {Quat(pose[3], pose[4], pose[5], pose[6]), Vec3(pose[0], pose[1], pose[2])};
  return s;
}

std::string verified_text(const VerifiedRecord& v) {
  RecordWriter w;
  w.text("when", v.when).text("who", v.who).text("inputs", v.inputs).text("before_id", v.before_id);
  w.number("before_rms_mm", v.before_rms_mm).number("after_rms_mm", v.after_rms_mm);
  w.number("after_max_mm", v.after_max_mm).number("shift_max_mm", v.shift_max_mm);
  return w.done();
}

Result<VerifiedRecord> parse_verified(std::string_view text, std::string_view file_name) {
  Result<RecordReader> reader = reader_of(text, file_name);
  if (!reader) return reader.error();
  RecordReader& r = reader.value();
  VerifiedRecord v;
  r.text("when", v.when);
  r.text("who", v.who);
  r.text("inputs", v.inputs);
  r.text("before_id", v.before_id);
  r.number("before_rms_mm", false, v.before_rms_mm);
  r.number("after_rms_mm", true, v.after_rms_mm);
  r.number("after_max_mm", true, v.after_max_mm);
  r.number("shift_max_mm", false, v.shift_max_mm);
  if (const Status status = r.keys().finish("those slabctl writes"); !status) return status.error();
  return v;
}

}  // namespace slabd::calib
