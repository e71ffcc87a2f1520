// SPDX-License-Identifier: Apache-2.0
//
// A change of calibrations on its way from slabctl to the daemon. Control path: heap and exceptions of the JSON library
// stay in here. Numbers are written so that the same bits come back; NaN is null.
#include <cmath>
#include <exception>
#include <nlohmann/json.hpp>

#include "config/config.h"
#include "daemon/control/calibration_change.h"

namespace slabd::daemon {
namespace {

using Json = nlohmann::json;
using namespace storage;

double number(const Json& j) {
  return j.is_null() ? kNoValue : j.get<double>();
}

Json of(const Vec3& v) {
  return Json::array({v.x(), v.y(), v.z()});
}
Vec3 vector(const Json& j) {
  return {number(j.at(0)), number(j.at(1)), number(j.at(2))};
}
Json of(const Pose& pose) {
  Json list = Json::array();
  for (const double x : pose.to_array()) list.push_back(x);
  return list;
}
Pose pose(const Json& j) {
  // Not Pose::from_array: normalising again would change the last bits, and with them the id.
  Pose p;
  p.translation_mm = vector(j);
  p.rotation = Quat(number(j.at(3)), number(j.at(4)), number(j.at(5)), number(j.at(6)));
  return p;
}

Json of(const ChangeNote& note) {
  return {{"who", note.who}, {"why", note.why}, {"utime_us", note.utime_us}};
}
ChangeNote note(const Json& j) {
  return {j.at("who").get<std::string>(), j.at("why").get<std::string>(), j.at("utime_us").get<std::int64_t>()};
}

struct NumbersJson {
  Json operator()(const HandEyeNumbers& n) const {
    return {{"T_flange_scanner", of(n.T_flange_scanner)}, {"sigma_mm", n.sigma_mm}, {"sigma_rad", n.sigma_rad}};
  }
  Json operator()(const StationTable& n) const {
    Json list = Json::array();
    for (std::size_t i = 0; i < n.station.size(); ++i) {
      const StationCorrection& s = n.station[i];
      if (s.visits == 0) continue;
      list.push_back({{"station", i + 1},
                      {"visits", s.visits},
                      {"T_base_reported", of(s.T_base_reported)},
                      {"T_base_flange", of(s.T_base_flange)},
                      {"sigma_mm", s.sigma_mm},
                      {"sigma_rad", s.sigma_rad},
                      {"spread_mm", s.spread_mm}});
    }
    return {{"slab_type", n.slab_type}, {"stations", list}};
  }
  Json operator()(const ReferenceBlock& n) const {
    return {{"slope_rad", n.slope_rad},
            {"slope_U_rad", n.slope_U_rad},
            {"jaw_distance_mm", n.jaw_distance_mm},
            {"jaw_distance_U_mm", n.jaw_distance_U_mm}};
  }
  Json operator()(const MonitorBall& n) const {
    return {{"p_base", of(n.p_base)}, {"radius_mm", n.radius_mm}, {"limit_mm", n.limit_mm}};
  }
  Json operator()(const ScannerNumbers& n) const {
    return {{"scanner", n.scanner.view()},
            {"PF_mm", n.PF_mm},
            {"PS_mm", n.PS_mm},
            {"RF_mm", n.RF_mm},
            {"form_half_mm", n.form_half_mm},
            {"form_length_mm", n.form_length_mm},
            {"noise_sigma_mm", n.noise_sigma_mm},
            {"noise_correlation_mm", n.noise_correlation_mm},
            {"pitch_mm", n.pitch_mm},
            {"plates", n.plates},
            {"balls", n.balls},
            {"within_limits", n.within_limits}};
  }
};

ScannerNumbers scanner(const Json& j) {
  ScannerNumbers n;
  n.scanner.assign(j.at("scanner").get<std::string>());
  n.PF_mm = number(j.at("PF_mm"));
  n.PS_mm = number(j.at("PS_mm"));
  n.RF_mm = number(j.at("RF_mm"));
  n.form_half_mm = number(j.at("form_half_mm"));
  n.form_length_mm = number(j.at("form_length_mm"));
  n.noise_sigma_mm = number(j.at("noise_sigma_mm"));
  n.noise_correlation_mm = number(j.at("noise_correlation_mm"));
  n.pitch_mm = number(j.at("pitch_mm"));
  n.plates = j.at("plates").get<std::uint16_t>();
  n.balls = j.at("balls").get<std::uint16_t>();
  n.within_limits = j.at("within_limits").get<bool>();
  return n;
}

StationTable stations(const Json& j) {
  StationTable table;
  table.slab_type = j.at("slab_type").get<std::uint16_t>();
  for (const Json& row : j.at("stations")) {
    StationCorrection& s = table.station.at(row.at("station").get<std::size_t>() - 1);
    s.visits = row.at("visits").get<std::uint8_t>();
    s.T_base_reported = pose(row.at("T_base_reported"));
    s.T_base_flange = pose(row.at("T_base_flange"));
    s.sigma_mm = number(row.at("sigma_mm"));
    s.sigma_rad = number(row.at("sigma_rad"));
    s.spread_mm = number(row.at("spread_mm"));
  }
  return table;
}

Json of(const CalibrationRecord& r) {
  return {{"kind", name(r.kind())},
          {"numbers", std::visit(NumbersJson{}, r.numbers)},
          {"parent_id", r.parent_id},
          {"figures", r.figures},
          {"observations", r.observations},
          {"certificate", r.certificate},
          {"operator", r.operator_name},
          {"robot_serial", r.robot_serial},
          {"scanner_serial", r.scanner_serial},
          {"temperature_c", r.temperature_c},
          {"software", r.software},
          {"created_utime_us", r.created_utime_us},
          {"expires_utime_us", r.expires_utime_us}};
}

CalibrationKind kind_of(const Json& j) {
  const auto kind = calibration_kind_named(j.at("kind").get<std::string>());
  if (!kind) throw std::invalid_argument("\"kind\" is no kind of calibration");
  return *kind;
}

CalibrationRecord record(const Json& j) {
  CalibrationRecord r;
  const Json& numbers = j.at("numbers");
  switch (kind_of(j)) {
    case CalibrationKind::hand_eye:
      r.numbers = HandEyeNumbers{pose(numbers.at("T_flange_scanner")), number(numbers.at("sigma_mm")),
                                 number(numbers.at("sigma_rad"))};
      break;
    case CalibrationKind::stations: r.numbers = stations(numbers); break;
    case CalibrationKind::reference_block:
      r.numbers = ReferenceBlock{number(numbers.at("slope_rad")), number(numbers.at("slope_U_rad")),
                                 number(numbers.at("jaw_distance_mm")), number(numbers.at("jaw_distance_U_mm"))};
      break;
    case CalibrationKind::monitor_ball:
      r.numbers =
          MonitorBall{vector(numbers.at("p_base")), number(numbers.at("radius_mm")), number(numbers.at("limit_mm"))};
      break;
    case CalibrationKind::scanner: r.numbers = scanner(numbers); break;
  }
  r.parent_id = j.at("parent_id").get<std::string>();
  r.figures = j.at("figures").get<std::string>();
  r.observations = j.at("observations").get<std::string>();
  r.certificate = j.at("certificate").get<std::string>();
  r.operator_name = j.at("operator").get<std::string>();
  r.robot_serial = j.at("robot_serial").get<std::string>();
  r.scanner_serial = j.at("scanner_serial").get<std::string>();
  r.temperature_c = number(j.at("temperature_c"));
  r.software = j.at("software").get<std::string>();
  r.created_utime_us = j.at("created_utime_us").get<std::int64_t>();
  r.expires_utime_us = j.at("expires_utime_us").get<std::int64_t>();
  return r;
}

Json of(const CalibrationCheck& c) {
  return {{"kind", name(c.kind)},
          {"reference_id", c.reference_id.view()},
          {"hand_eye_id", c.hand_eye_id.view()},
          {"passed", c.passed},
          {"slope_rad", c.slope_rad},
          {"slope_U_rad", c.slope_U_rad},
          {"jaw_distance_mm", c.jaw_distance_mm},
          {"jaw_distance_U_mm", c.jaw_distance_U_mm},
          {"off_mm", of(c.off_mm)},
          {"utime_us", c.utime_us},
          {"who", c.who.view()},
          {"source", c.source.view()},
          {"note", c.note.view()}};
}

CalibrationCheck check(const Json& j) {
  CalibrationCheck c;
  c.kind = kind_of(j);
  c.reference_id.assign(j.at("reference_id").get<std::string>());
  c.hand_eye_id.assign(j.at("hand_eye_id").get<std::string>());
  c.passed = j.at("passed").get<bool>();
  c.slope_rad = number(j.at("slope_rad"));
  c.slope_U_rad = number(j.at("slope_U_rad"));
  c.jaw_distance_mm = number(j.at("jaw_distance_mm"));
  c.jaw_distance_U_mm = number(j.at("jaw_distance_U_mm"));
  c.off_mm = vector(j.at("off_mm"));
  c.utime_us = j.at("utime_us").get<std::int64_t>();
  c.who.assign(j.at("who").get<std::string>());
  c.source.assign(j.at("source").get<std::string>());
  c.note.assign(j.at("note").get<std::string>());
  return c;
}

struct ChangeJson {
  Json operator()(const KeepCalibration& c) const { return {{"keep", of(c.record)}}; }
  Json operator()(const ApplyCalibration& c) const { return {{"apply", {{"id", c.id}, {"note", of(c.note)}}}}; }
  Json operator()(const RollBackCalibration& c) const {
    return {{"roll_back", {{"kind", name(c.kind)}, {"slab_type", c.slab_type}, {"note", of(c.note)}}}};
  }
  Json operator()(const KeepCheck& c) const { return {{"check", of(c.check)}}; }
};

}  // namespace

std::string change_json(const CalibrationChange& change) {
  Json j = std::visit(ChangeJson{}, change);
  j["schema"] = "slabd.calibration_change/1";
  return j.dump(-1, ' ', false, Json::error_handler_t::replace);
}

Result<CalibrationChange> parse_change(std::string_view json) {
  try {
    const Json j = Json::parse(json);
    if (j.value("schema", "") != "slabd.calibration_change/1")
      return error(Code::config, "a calibration change of another schema than slabd.calibration_change/1");
    if (j.contains("keep")) return CalibrationChange(KeepCalibration{record(j.at("keep"))});
    if (j.contains("apply"))
      return CalibrationChange(
          ApplyCalibration{j.at("apply").at("id").get<std::string>(), note(j.at("apply").at("note"))});
    if (j.contains("roll_back")) {
      const Json& back = j.at("roll_back");
      return CalibrationChange(
          RollBackCalibration{kind_of(back), back.at("slab_type").get<std::uint16_t>(), note(back.at("note"))});
    }
    if (j.contains("check")) return CalibrationChange(KeepCheck{check(j.at("check"))});
    return error(Code::config, "a calibration change must be one of keep, apply, roll_back, check");
  } catch (const std::exception& e) {
    return error(Code::config, "a calibration change that cannot be read: %s", e.what());
  }
}

}  // namespace slabd::daemon
