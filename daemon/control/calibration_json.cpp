// SPDX-License-Identifier: Apache-2.0
//
// A change of calibrations on its way from slabctl to the daemon. Control path: heap and exceptions of the JSON library
// stay in here. Numbers are written so that the same bits come back; NaN is null.
#include <exception>
#include <nlohmann/json.hpp>

#include "config/config.h"
#include "daemon/control/calibration_change.h"
#include "storage/storage.h"

namespace slabd::daemon {
namespace {

using Json = nlohmann::json;
using namespace storage;

// ---- values ------------------------------------------------------------------------------------------------------

template <typename T>
Json of(const T& value) {
  return value;
}
template <std::size_t N>
Json of(const FixedString<N>& text) {
  return text.view();
}
Json of(CalibrationKind kind) {
  return name(kind);
}
Json of(const Vec3& v) {
  return Json::array({v.x(), v.y(), v.z()});
}
Json of(const Pose& pose) {
  return pose.to_array();
}

template <typename T>
void read(const Json& j, T& out) {
  out = j.get<T>();
}
template <std::size_t N>
void read(const Json& j, FixedString<N>& out) {
  out.assign(j.get<std::string>());
}
void read(const Json& j, CalibrationKind& out) {
  const auto kind = calibration_kind_named(j.get<std::string>());
  if (!kind) throw std::invalid_argument("\"kind\" is no kind of calibration");
  out = *kind;
}
void read(const Json& j, double& out) {
  out = j.is_null() ? kNoValue : j.get<double>();
}
void read(const Json& j, Vec3& out) {
  for (std::size_t i = 0; i < 3; ++i) read(j.at(i), out[static_cast<Eigen::Index>(i)]);
}
void read(const Json& j, Pose& out) {
  // Not Pose::from_array: normalising again would change the last bits, and with them the id.
  std::array<double, 7> a{};
  for (std::size_t i = 0; i < a.size(); ++i) read(j.at(i), a.at(i));
  out.translation_mm = Vec3(a[0], a[1], a[2]);
  out.rotation = Quat(a[3], a[4], a[5], a[6]);
}

// ---- records -----------------------------------------------------------------------------------------------------

template <typename Record>
Json object_of(const Record& record) {
  Json j = Json::object();
  const auto write = [&](std::string_view key, const auto& value) { j[std::string(key)] = of(value); };
  fields(write, record);
  return j;
}
template <typename Record>
void read_fields(const Json& j, Record& record) {
  const auto take = [&](std::string_view key, auto& value) { read(j.at(std::string(key)), value); };
  fields(take, record);
}
template <typename Record>
Record record_of(const Json& j) {
  Record record;
  read_fields(j, record);
  return record;
}
template <>
StationTable record_of(const Json& j) {
  StationTable table;
  read(j.at("slab_type"), table.slab_type);
  for (const Json& row : j.at("stations")) read_fields(row, table.station.at(row.at("station").get<std::size_t>() - 1));
  return table;
}

struct NumbersJson {
  template <typename Numbers>
  Json operator()(const Numbers& numbers) const {
    return object_of(numbers);
  }
  Json operator()(const StationTable& table) const {
    Json list = Json::array();
    for (std::size_t i = 0; i < table.station.size(); ++i) {
      if (table.station[i].visits == 0) continue;
      list.push_back(object_of(table.station[i]));
      list.back()["station"] = i + 1;
    }
    return {{"slab_type", table.slab_type}, {"stations", list}};
  }
};

CalibrationKind kind_of(const Json& j) {
  CalibrationKind kind{};
  read(j.at("kind"), kind);
  return kind;
}

Json of(const CalibrationRecord& record) {
  Json j = object_of(record);
  j["kind"] = of(record.kind());
  j["numbers"] = std::visit(NumbersJson{}, record.numbers);
  return j;
}

CalibrationRecord calibration(const Json& j) {
  CalibrationRecord record = record_of<CalibrationRecord>(j);
  const Json& numbers = j.at("numbers");
  switch (kind_of(j)) {
    case CalibrationKind::hand_eye: record.numbers = record_of<HandEyeNumbers>(numbers); break;
    case CalibrationKind::stations: record.numbers = record_of<StationTable>(numbers); break;
    case CalibrationKind::reference_block: record.numbers = record_of<ReferenceBlock>(numbers); break;
    case CalibrationKind::monitor_ball: record.numbers = record_of<MonitorBall>(numbers); break;
    case CalibrationKind::scanner: record.numbers = record_of<ScannerNumbers>(numbers); break;
  }
  return record;
}

struct ChangeJson {
  Json operator()(const KeepCalibration& c) const { return {{"keep", of(c.record)}}; }
  Json operator()(const ApplyCalibration& c) const { return {{"apply", {{"id", c.id}, {"note", object_of(c.note)}}}}; }
  Json operator()(const RollBackCalibration& c) const {
    return {{"roll_back", {{"kind", name(c.kind)}, {"slab_type", c.slab_type}, {"note", object_of(c.note)}}}};
  }
  Json operator()(const KeepCheck& c) const { return {{"check", object_of(c.check)}}; }
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
    if (j.contains("keep")) return CalibrationChange(KeepCalibration{calibration(j.at("keep"))});
    if (j.contains("apply"))
      return CalibrationChange(
          ApplyCalibration{j.at("apply").at("id").get<std::string>(), record_of<ChangeNote>(j.at("apply").at("note"))});
    if (j.contains("roll_back")) {
      const Json& back = j.at("roll_back");
      return CalibrationChange(RollBackCalibration{kind_of(back), back.at("slab_type").get<std::uint16_t>(),
                                                   record_of<ChangeNote>(back.at("note"))});
    }
    if (j.contains("check")) return CalibrationChange(KeepCheck{record_of<CalibrationCheck>(j.at("check"))});
    return error(Code::config, "a calibration change must be one of keep, apply, roll_back, check");
  } catch (const std::exception& e) {
    return error(Code::config, "a calibration change that cannot be read: %s", e.what());
  }
}

}  // namespace slabd::daemon
