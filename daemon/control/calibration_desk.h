// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <string>
#include <string_view>

#include "base/base.h"
#include "base/calibration.h"
#include "storage/storage.h"

/// Where one change of calibrations lies between the control socket, the storage thread and the station. One at a time:
/// laid and finished by the loop, carried out on the storage thread in between. Nothing is locked, because the change
/// only passes on with a job or its answer.
namespace slabd::daemon {

// Changing calibrations from outside the process.

/// slabctl leaves a change as a file in this folder, because one control line could not hold a record, and tells the
/// daemon its name.
[[nodiscard]] std::string change_folder(const std::string& db_path);
/// A change as JSON, and back; NaN is null, and every digit comes back. config: what is wrong with the text.
[[nodiscard]] std::string change_json(const storage::CalibrationChange& change);
[[nodiscard]] Result<storage::CalibrationChange> parse_change(std::string_view json);

class CalibrationDesk {
 public:
  /// `folder`: where slabctl leaves changes; made here, for the group, when it is not there.
  explicit CalibrationDesk(std::string folder);

  // ---- on the loop's thread ----
  /// Takes the change in `file` (a name inside the folder); `uid` is of the process that asks. config: another change
  /// is under way, the name is not one, or nobody knows who asks.
  [[nodiscard]] Status lay(const std::string& file, std::uint32_t uid);
  [[nodiscard]] bool is_waiting() const { return phase_ == Phase::waiting; }
  void started() { phase_ = Phase::under_way; }
  /// After the storage thread's answer: what is in force now, or nullptr when nothing changed. Valid until the next
  /// lay().
  [[nodiscard]] const LineCalibration* finish();

  // ---- on the storage thread, between started() and finish() ----
  void carry_out(storage::Store* store);

  // ---- of the last change, for whoever asks; while one is under way only file() means anything ----
  [[nodiscard]] const PathText& file() const { return file_; }
  [[nodiscard]] bool is_done() const { return phase_ == Phase::idle && !file_.empty(); }
  [[nodiscard]] bool succeeded() const { return is_done() && error_.code == Code::ok; }
  [[nodiscard]] const CalibrationId& id() const { return shown_id_; }
  [[nodiscard]] const Error& error() const { return shown_error_; }
  /// One sentence for the log.
  [[nodiscard]] FixedString<limits::kErrorTextBytes> summary() const;

 private:
  enum class Phase { idle, waiting, under_way };

  std::string folder_;
  Phase phase_ = Phase::idle;
  PathText file_;
  std::uint32_t uid_ = 0;
  // Written on the storage thread.
  Error error_{Code::ok, {}};
  CalibrationId id_;
  std::unique_ptr<LineCalibration> calibration_;
  // Copies for answers, taken over in finish().
  Error shown_error_{Code::ok, {}};
  CalibrationId shown_id_;
};

}  // namespace slabd::daemon
