// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <string_view>

#include "base/base.h"
#include "base/calibration.h"
#include "storage/storage.h"

/// Passes one change of calibrations between the control socket, the storage thread and the station. One change at a
/// time: the loop accepts and finishes it, the storage thread carries it out in between. No lock is needed, because the
/// change is handed over with a job and its answer.
namespace slabd::daemon {

// Changing calibrations from outside the process.

/// slabctl writes a change to a file in this folder, because one control line cannot hold a record, and sends the
/// daemon the file's name.
[[nodiscard]] std::string change_folder(const std::string& db_path);
/// A change as JSON, and back; NaN is null, and every digit is restored. config: the text names the error.
[[nodiscard]] std::string change_json(const storage::CalibrationChange& change);
[[nodiscard]] Result<storage::CalibrationChange> parse_change(std::string_view json);

class CalibrationChanger {
 public:
  /// `folder`: where slabctl writes changes; created here, for the group, if it does not exist.
  explicit CalibrationChanger(std::string folder);

  // ---- on the loop's thread ----
  /// Takes the change in `file` (a name inside the folder); `uid` is that of the requesting process. config: another
  /// change is in progress, the name is not valid, or the user is unknown.
  [[nodiscard]] Status accept(const std::string& file, std::uint32_t uid);
  [[nodiscard]] bool is_waiting() const { return phase_ == Phase::waiting; }
  void started() { phase_ = Phase::under_way; }
  /// After the storage thread's answer: the calibration now in force, or nullptr if it did not change. Valid until the
  /// next accept().
  [[nodiscard]] const CellCalibration* finish();
  /// The decision about a slab that the finished change added; nullptr if it was another change.
  [[nodiscard]] const storage::DispositionRecord* disposition() const {
    return succeeded() && disposition_ ? &*disposition_ : nullptr;
  }

  /// The master check of a gauge that the finished change added; nullptr if it was another change.
  [[nodiscard]] const GaugeCheck* gauge_check() const { return succeeded() && gauge_check_ ? &*gauge_check_ : nullptr; }

  // ---- on the storage thread, between started() and finish() ----
  void carry_out(storage::Store* store);

  // ---- state of the last change; while one is in progress only file() is valid ----
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
  std::unique_ptr<CellCalibration> calibration_;
  std::optional<storage::DispositionRecord> disposition_;
  std::optional<GaugeCheck> gauge_check_;
  // Copies for answers, updated in finish().
  Error shown_error_{Code::ok, {}};
  CalibrationId shown_id_;
};

}  // namespace slabd::daemon
