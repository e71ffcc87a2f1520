// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <map>
#include <set>
#include <string>
#include <tuple>
#include <vector>

#include "storage/storage.h"
#include "tests/sim/line.h"
#include "tests/sim/plc.h"
#include "tests/sim/process.h"

/// Checks slabd's promises after each of its actions against the true state:
///
///   A pass is shown only after it is committed. A slab passes only if each of its blocks is good and was scanned
///   in its present position by a robot at rest. A slab has one verdict. A record shown under a number never
///   changes. Committed data survive the process and a power loss. SESSION is never used twice. CMD_ACK counts by
///   one. All data shown as acquired are in the database.
namespace slabd::sim {

class Promises {
 public:
  Promises(World& world, Line& line) : world_(world), line_(line) {}

  // ---- the database ----
  /// `apply` answered ok, and the process was alive.
  void committed(const StoreJob& job);
  /// `apply` answered an error, or the process died in it: the job may be in the database or not.
  void doubtful(const StoreJob& job);
  /// Checks at a start that every committed row is in the database of the previous process. Doubtful jobs are resolved.
  void check_rows(const char* db_path);
  void recovered(const RecoveredLine& line);

  // ---- the wire ----
  /// Until recovered() a process shows STATE 1, or a fault and numbers that must not be used.
  void process_started() {
    fresh_process_ = true;
    has_store_ = false;
  }
  void shown(const PlcOutputs& out);
  void decided(const Decision& decision);

 private:
  using AttemptKey = std::tuple<std::int64_t, int, int>;  // slab, station, attempt
  struct Record {
    std::int64_t slab_key = 0;
    std::uint16_t kind = 0;
    std::uint16_t station = 0;
    std::uint16_t cmd_seq = 0;
    std::uint32_t slab_no = 0;
    Verdict verdict = Verdict::none;
    bool acknowledged = false;
    bool operator==(const Record&) const = default;
  };
  [[nodiscard]] const char* why_no_pass(std::int64_t slab_key, int& station) const;
  /// nullptr if the scan under this path shows the block of that placement, from a robot at rest; otherwise the reason.
  [[nodiscard]] const char* why_no_scan(const std::string& path, std::uint32_t serial, int station) const;
  void check_block(const BlockJob& job);
  static Record record_of(std::int64_t slab_key, const PlcResult& record);

  World& world_;
  Line& line_;
  std::map<std::uint16_t, Record> records_;     ///< committed, by RES_SEQ
  std::map<AttemptKey, std::string> acquired_;  ///< committed, with the scan's path
  /// Accepted SCANs that have not failed yet, by slab and station.
  std::map<std::pair<std::int64_t, std::uint8_t>, std::uint16_t> asked_;
  std::map<std::int64_t, Verdict> slabs_;  ///< committed ends
  std::map<std::int64_t, std::uint32_t> slab_nos_;
  std::map<std::int64_t, std::uint32_t> placements_;  ///< placements of the slabs at their begin
  std::set<std::uint16_t> acquired_commands_;
  std::map<std::uint16_t, std::pair<AttemptKey, std::string>> doubtful_scans_;  ///< by command; committed or not
  std::map<std::uint16_t, Record> doubtful_records_;                            ///< by RES_SEQ; committed or not
  std::set<std::uint16_t> sessions_;                                            ///< shown
  std::uint16_t session_stored_ = 0;
  std::map<std::uint16_t, Record> shown_records_;
  bool fresh_process_ = true;
  bool has_store_ = false;
  PlcOutputs last_;
};

/// The real store, with its calls observed.
class OverheardStore final : public storage::Store {
 public:
  OverheardStore(std::unique_ptr<storage::Store> store, const char* db_path, Promises& promises, const Process& process)
      : store_(std::move(store)), db_path_(db_path), promises_(promises), process_(process) {}
  [[nodiscard]] Result<std::unique_ptr<RecoveredLine>> recover() override;
  [[nodiscard]] Status apply(const StoreJob& job) override;
  [[nodiscard]] Result<std::string> change(const storage::CalibrationChange& change) override {
    return store_->change(change);
  }
  [[nodiscard]] Result<std::unique_ptr<CellCalibration>> calibration() override { return store_->calibration(); }
  void idle() override { store_->idle(); }
  [[nodiscard]] std::string_view spool_trouble() const override { return store_->spool_trouble(); }
  [[nodiscard]] Status order(const storage::CareOrder& order) override { return store_->order(order); }
  [[nodiscard]] storage::CareState care() const override { return store_->care(); }

 private:
  std::unique_ptr<storage::Store> store_;
  const char* db_path_;
  Promises& promises_;
  const Process& process_;
};

}  // namespace slabd::sim
