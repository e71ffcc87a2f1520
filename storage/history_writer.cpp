// SPDX-License-Identifier: Apache-2.0
//
// The jobs write the same rows as for a measured slab, seals included. Only the number of commits differs: one commit
// of the daemon waits for the disk, and a year has some two million of them.
#include "storage/history_writer.h"

#include <filesystem>
#include <optional>

#include "storage/files/database.h"
#include "storage/files/folders.h"
#include "storage/files/sqlite.h"
#include "storage/jobs.h"

namespace slabd::storage {
namespace {

/// Some 10 MB of log for each commit.
constexpr int kSlabsPerCommit = 100;

class SqliteHistoryWriter final : public HistoryWriter {
 public:
  explicit SqliteHistoryWriter(const StoreSettings& settings) : settings_(settings) {}

  Status open() {
    std::error_code ec;
    if (std::filesystem::exists(std::filesystem::symlink_status(settings_.db_path, ec)))
      return error(Code::config, "%s exists; a history is written to a new database only", settings_.db_path.c_str());
    const std::string folder = std::filesystem::path(settings_.db_path).parent_path().string();
    if (!folder.empty())
      if (Status status = make_folder(folder); !status.ok()) return status;
    if (Status status = lock_.take(settings_.db_path); !status.ok()) return status;
    Result<std::unique_ptr<Connection>> db = open_for_writing(settings_.db_path);
    if (!db.ok()) return db.error();
    db_ = std::move(db.value());
    return run([&] {
      jobs_.emplace(*db_, settings_, nothing_);
      jobs_->keep_seals();
      transaction_.emplace(*db_, "BEGIN IMMEDIATE");
      jobs_->begin_chain();
    });
  }

  Status apply(const StoreJob& job) override {
    return run([&] {
      if (!transaction_) transaction_.emplace(*db_, "BEGIN IMMEDIATE");
      std::visit(*jobs_, job.what);
      if (const std::optional<Error> answer = jobs_->take_answer()) throw Refusal{*answer};
      if (std::holds_alternative<BeginSlabJob>(job.what) && ++slabs_ % kSlabsPerCommit == 0) commit();
    });
  }

  Status finish() override {
    return run([&] {
      if (transaction_) commit();
      jobs_.reset();
      db_.reset();
    });
  }

 private:
  void commit() {
    transaction_->commit();
    transaction_.reset();
    db_->checkpoint();
  }

  template <typename Work>
  Status run(const Work& work) {
    try {
      work();
      return success();
    } catch (const Refusal& refusal) {
      return refusal.error;
    } catch (const SqlFailure& failure) {
      return error(Code::journal_write, "%s: not written: %s", settings_.db_path.c_str(), failure.text.c_str());
    }
  }

  StoreSettings settings_;
  WriterLock lock_;
  HeldBack nothing_;
  std::unique_ptr<Connection> db_;
  std::optional<Jobs> jobs_;
  std::optional<Transaction> transaction_;
  int slabs_ = 0;
};

}  // namespace

Result<std::unique_ptr<HistoryWriter>> write_history(const StoreSettings& settings) {
  auto writer = std::make_unique<SqliteHistoryWriter>(settings);
  if (Status status = writer->open(); !status.ok()) return status.error();
  return std::unique_ptr<HistoryWriter>(std::move(writer));
}

}  // namespace slabd::storage
