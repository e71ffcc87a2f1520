// SPDX-License-Identifier: Apache-2.0
//
// slabctl writes a change to a file and sends its name over the control socket. Users who may write to the socket are
// in the daemon's group and may apply a calibration. The file is therefore read from one folder only, by a plain name,
// without following links, and the database checks the change.
#include "daemon/control/calibration_changer.h"

#include <fcntl.h>
#include <sys/stat.h>
#include <unistd.h>
#include <nlohmann/json.hpp>

#include <cerrno>
#include <cstring>
#include <exception>
#include <filesystem>

#include "base/os.h"
#include "config/config.h"
#include "storage/storage.h"

namespace slabd::daemon {
namespace {

constexpr std::size_t kChangeBytesMax = 64U << 20U;
constexpr std::uint32_t kUidUnknown = 0xFFFF'FFFF;

/// Letters, digits, '-', '_' and '.', and no leading dot, so that the path cannot leave the folder.
bool is_plain_name(const std::string& name) {
  if (name.empty() || name.size() > 100 || name.front() == '.') return false;
  for (const char c : name) {
    const bool plain =
        (c >= '0' && c <= '9') || (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || c == '-' || c == '_' || c == '.';
    if (!plain) return false;
  }
  return true;
}

Result<std::string> read_change(const std::string& path) {
  const Fd file(::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NOFOLLOW | O_NONBLOCK));
  if (!file.is_open()) return error(Code::config, "cannot open %s: %s", path.c_str(), std::strerror(errno));
  struct stat status {};
  const bool regular = ::fstat(file.get(), &status) == 0 && S_ISREG(status.st_mode);
  if (!regular || static_cast<std::size_t>(status.st_size) > kChangeBytesMax)
    return error(Code::config, "%s is not a regular file of at most 64 MB", path.c_str());
  std::string text(static_cast<std::size_t>(status.st_size), '\0');
  std::size_t got = 0;
  while (got < text.size()) {
    const ssize_t n = ::read(file.get(), text.data() + got, text.size() - got);
    if (n < 0 && errno == EINTR) continue;
    if (n <= 0) break;
    got += static_cast<std::size_t>(n);
  }
  if (got != text.size()) return error(Code::config, "%s was cut short while it was read", path.c_str());
  return text;
}

/// Adds the requesting user to the history, whatever name was given.
void note_user(storage::CalibrationChange& change, std::uint32_t uid) {
  const std::string user = " (uid " + std::to_string(uid) + ")";
  if (auto* apply = std::get_if<storage::ApplyCalibration>(&change); apply != nullptr && !apply->note.who.empty())
    apply->note.who += user;
  if (auto* back = std::get_if<storage::RollBackCalibration>(&change); back != nullptr && !back->note.who.empty())
    back->note.who += user;
  if (auto* kept = std::get_if<storage::KeepDisposition>(&change); kept != nullptr && !kept->record.who.empty())
    kept->record.who += user;
  if (auto* check = std::get_if<storage::KeepGaugeCheck>(&change); check != nullptr && !check->note.who.empty())
    check->note.who += user;
  if (auto* reset = std::get_if<storage::ResetMould>(&change); reset != nullptr && !reset->note.who.empty())
    reset->note.who += user;
}

/// The command that shows whether a change was made.
struct WhereToLook {
  std::string_view operator()(const storage::KeepDisposition&) const { return "history --disposition, show"; }
  std::string_view operator()(const storage::ResetMould&) const { return "mould show"; }
  std::string_view operator()(const storage::KeepGaugeCheck&) const { return "gauge history"; }
  std::string_view operator()(const storage::KeepPin&) const { return "pin --show"; }
  template <typename OfCalibrations>
  std::string_view operator()(const OfCalibrations&) const {
    return "calibrate history";
  }
};

}  // namespace

std::string change_folder(const std::string& db_path) {
  return db_path.empty() ? "" : db_path.substr(0, db_path.rfind('/') + 1) + "changes";
}

CalibrationChanger::CalibrationChanger(std::string folder) : folder_(std::move(folder)) {
  // Users of the control socket may write a file here. If the folder cannot be made, reading a change reports it.
  if (!folder_.empty() && ::mkdir(folder_.c_str(), 0770) == 0) static_cast<void>(::chmod(folder_.c_str(), 02770));
}

Status CalibrationChanger::accept(const std::string& file, std::uint32_t uid) {
  if (folder_.empty()) return slabd::error(Code::config, "the daemon has no database");
  if (phase_ != Phase::idle) return slabd::error(Code::busy, "another change of calibrations is under way; try again");
  if (uid == kUidUnknown) return slabd::error(Code::config, "the user of this request is unknown");
  if (!is_plain_name(file))
    return slabd::error(Code::config, "\"file\" must be a plain name of a file in %s", folder_.c_str());
  phase_ = Phase::waiting;
  file_.assign(file);
  uid_ = uid;
  error_ = {Code::ok, {}};
  id_.clear();
  calibration_.reset();
  disposition_.reset();
  gauge_check_.reset();
  return success();
}

void CalibrationChanger::carry_out(storage::Store* store) {
  const std::string path = folder_ + "/" + file_.c_str();
  try {
    const Result<std::string> text = read_change(path);
    if (!text.ok()) {
      error_ = text.error();
      return;
    }
    Result<storage::CalibrationChange> change = parse_change(text.value());
    if (!change.ok()) {
      error_ = change.error();
    } else if (store == nullptr) {
      error_ = slabd::error(Code::journal_write, "the daemon has no usable database");
    } else {
      note_user(change.value(), uid_);
      const Result<std::string> done = store->change(change.value());
      if (done.ok()) {
        id_.assign(done.value());
        if (const auto* kept = std::get_if<storage::KeepDisposition>(&change.value())) disposition_ = kept->record;
        if (const auto* kept = std::get_if<storage::KeepGaugeCheck>(&change.value())) {
          gauge_check_ = kept->check;
          gauge_check_->passed = passes(kept->check);
          gauge_check_->utime_us = kept->note.utime_us;
        }
      } else {
        error_ = done.error();
      }
      // A change that was refused was not stored. One that failed may be stored, so the database is read again.
      if (done.ok() || error_.code != Code::config) {
        Result<std::unique_ptr<CellCalibration>> now = store->calibration();
        if (now.ok()) calibration_ = std::move(now.value());
        if (done.ok() && !now.ok()) error_ = now.error();
      }
      if (!done.ok() && error_.code != Code::config) {
        error_.text.append("; it may have been made nevertheless: see slabctl ");
        error_.text.append(std::visit(WhereToLook{}, change.value()));
      }
    }
  } catch (const std::exception& e) {
    error_ = slabd::error(Code::internal, "%s: %s", path.c_str(), e.what());
  }
  ::unlink(path.c_str());
}

const CellCalibration* CalibrationChanger::finish() {
  phase_ = Phase::idle;
  shown_error_ = error_;
  shown_id_ = id_;
  return calibration_.get();
}

FixedString<limits::kErrorTextBytes> CalibrationChanger::summary() const {
  FixedString<limits::kErrorTextBytes> text;
  if (succeeded()) {
    text.printf("%s %s by uid %u: %s", disposition() != nullptr ? "decision" : "calibration change", file_.c_str(),
                uid_, id_.c_str());
  } else {
    text.printf("change %s by uid %u refused: %s", file_.c_str(), uid_, error_.text.c_str());
  }
  return text;
}

// A change of calibrations as JSON, from slabctl to the daemon. Control path: heap and exceptions of the JSON library
// are confined to this file. Numbers are written so that the same bits are restored; NaN is null.

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
Json of(ItemUnit unit) {
  return std::string(name(unit));
}
Json of(CalibrationKind kind) {
  return name(kind);
}
Json of(Disposition decision) {
  return std::string(name(decision));
}
Json of(const Vec3& v) {
  return Json::array({v.x(), v.y(), v.z()});
}
Json of(const Pose& pose) {
  return pose.to_array();
}
Json of(const Mat6& m) {
  Json rows = Json::array();
  for (Eigen::Index row = 0; row < 6; ++row) {
    rows.push_back(Json::array());
    for (Eigen::Index column = 0; column < 6; ++column) rows.back().push_back(m(row, column));
  }
  return rows;
}

template <typename T>
void read(const Json& j, T& out) {
  out = j.get<T>();
}
template <std::size_t N>
void read(const Json& j, FixedString<N>& out) {
  out.assign(j.get<std::string>());
}
void read(const Json& j, ItemUnit& out) {
  out = j.get<std::string>() == name(ItemUnit::deg) ? ItemUnit::deg : ItemUnit::mm;
}
void read(const Json& j, CalibrationKind& out) {
  const auto kind = calibration_kind_named(j.get<std::string>());
  if (!kind) throw std::invalid_argument("\"kind\" is not a kind of calibration");
  out = *kind;
}
void read(const Json& j, Disposition& out) {
  const auto decision = disposition_named(j.get<std::string>());
  if (!decision) throw std::invalid_argument("\"decision\" is not a decision about a slab");
  out = *decision;
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
void read(const Json& j, Mat6& out) {
  for (std::size_t row = 0; row < 6; ++row)
    for (std::size_t column = 0; column < 6; ++column)
      read(j.at(row).at(column), out(static_cast<Eigen::Index>(row), static_cast<Eigen::Index>(column)));
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
  j["scanner"] = record.scanner;
  j["numbers"] = std::visit(NumbersJson{}, record.numbers);
  return j;
}

CalibrationRecord calibration(const Json& j) {
  CalibrationRecord record = record_of<CalibrationRecord>(j);
  record.scanner = j.value("scanner", "1");
  const Json& numbers = j.at("numbers");
  switch (kind_of(j)) {
    case CalibrationKind::hand_eye: record.numbers = record_of<HandEyeNumbers>(numbers); break;
    case CalibrationKind::stations: record.numbers = record_of<StationTable>(numbers); break;
    case CalibrationKind::reference_block: record.numbers = record_of<ReferenceBlock>(numbers); break;
    case CalibrationKind::monitor_ball: record.numbers = record_of<MonitorBall>(numbers); break;
    case CalibrationKind::scanner: record.numbers = record_of<ScannerNumbers>(numbers); break;
    case CalibrationKind::tie: record.numbers = record_of<TieNumbers>(numbers); break;
  }
  return record;
}

struct ChangeJson {
  Json operator()(const KeepCalibration& c) const { return {{"keep", of(c.record)}}; }
  Json operator()(const ApplyCalibration& c) const {
    return {{"apply", {{"id", c.id}, {"note", object_of(c.note)}, {"scanner", c.scanner}}}};
  }
  Json operator()(const RollBackCalibration& c) const {
    return {
        {"roll_back",
         {{"kind", name(c.kind)}, {"slab_type", c.slab_type}, {"note", object_of(c.note)}, {"scanner", c.scanner}}}};
  }
  Json operator()(const KeepCheck& c) const { return {{"check", object_of(c.check)}}; }
  Json operator()(const KeepDisposition& c) const { return {{"disposition", object_of(c.record)}}; }
  Json operator()(const ResetMould& c) const {
    return {{"reset_mould", {{"mould", c.mould}, {"from_utime_us", c.from_utime_us}, {"note", object_of(c.note)}}}};
  }
  Json operator()(const KeepGaugeCheck& c) const {
    return {{"gauge_check", {{"check", object_of(c.check)}, {"note", object_of(c.note)}}}};
  }
  Json operator()(const KeepPin& c) const { return {{"pin", {{"slab_key", c.slab_key}, {"text", c.text}}}}; }
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
      return CalibrationChange(ApplyCalibration{j.at("apply").at("id").get<std::string>(),
                                                record_of<ChangeNote>(j.at("apply").at("note")),
                                                j.at("apply").value("scanner", "")});
    if (j.contains("roll_back")) {
      const Json& back = j.at("roll_back");
      return CalibrationChange(RollBackCalibration{kind_of(back), back.at("slab_type").get<std::uint16_t>(),
                                                   record_of<ChangeNote>(back.at("note")), back.value("scanner", "1")});
    }
    if (j.contains("check")) return CalibrationChange(KeepCheck{record_of<CalibrationCheck>(j.at("check"))});
    if (j.contains("disposition"))
      return CalibrationChange(KeepDisposition{record_of<DispositionRecord>(j.at("disposition"))});
    if (j.contains("reset_mould")) {
      const Json& reset = j.at("reset_mould");
      return CalibrationChange(ResetMould{reset.at("mould").get<std::uint16_t>(),
                                          reset.at("from_utime_us").get<std::int64_t>(),
                                          record_of<ChangeNote>(reset.at("note"))});
    }
    if (j.contains("gauge_check")) {
      const Json& kept = j.at("gauge_check");
      return CalibrationChange(
          KeepGaugeCheck{record_of<GaugeCheck>(kept.at("check")), record_of<ChangeNote>(kept.at("note"))});
    }
    if (j.contains("pin"))
      return CalibrationChange(
          KeepPin{j.at("pin").at("slab_key").get<std::int64_t>(), j.at("pin").at("text").get<std::string>()});
    return error(Code::config,
                 "a calibration change must be one of keep, apply, roll_back, check, disposition, reset_mould, "
                 "gauge_check, pin");
  } catch (const std::exception& e) {
    return error(Code::config, "a calibration change that cannot be read: %s", e.what());
  }
}

}  // namespace slabd::daemon
