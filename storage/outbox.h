// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <variant>
#include <vector>

#include "base/result.h"

/// Rows for the plant's database (table outbox), for slabd-plant. Reading only, in short transactions, so that the
/// write-ahead log is never held.
namespace slabd::storage {

/// The life of one database file. A row keeps its number and its content.
struct Epoch {
  std::string uuid;  ///< 32 hex digits
  std::int64_t began_utime_us = 0;
};

struct OutboxRow {
  std::int64_t seq = 0;
  std::string epoch;
  std::string kind;           ///< as in storage/schema.sql
  std::int64_t about = 0;     ///< number of the row that it is about
  std::int64_t slab_key = 0;  ///< 0: of no slab
  std::int64_t utime_us = 0;
  std::string sha256;  ///< of what was stored when the row was added, hex; of seals that of the chain
};

/// A stored row as named values, in the order of its columns.
struct StoredField {
  std::string name;
  std::variant<std::monostate, std::int64_t, double, std::string> value;
};
using StoredRow = std::vector<StoredField>;

class Outbox {
 public:
  virtual ~Outbox() = default;
  /// All epochs of this file, oldest first. The last one is that of new rows.
  [[nodiscard]] virtual Result<std::vector<Epoch>> epochs() = 0;
  /// Number of the oldest row of an epoch; 0 if it has none.
  [[nodiscard]] virtual Result<std::int64_t> first_seq(std::string_view epoch) = 0;
  /// Number up to which the daemon has noted that rows were sent.
  [[nodiscard]] virtual Result<std::int64_t> sent_seq() = 0;
  /// At most `limit` rows after `seq`, by number.
  [[nodiscard]] virtual Result<std::vector<OutboxRow>> rows_after(std::int64_t seq, std::size_t limit) = 0;
  /// The row with this number; nullopt if there is none.
  [[nodiscard]] virtual Result<std::optional<OutboxRow>> row(std::int64_t seq) = 0;
  /// The stored row that one of kind care, applied, check, gauge_check, mould_reset or event is about; of a calibration
  /// with the record that it puts in force. nullopt if it is gone.
  [[nodiscard]] virtual Result<std::optional<StoredRow>> subject(const OutboxRow& row) = 0;
  /// Epoch in which a slab was first sent; empty if it never was.
  [[nodiscard]] virtual Result<std::string> epoch_of_slab(std::int64_t slab_key) = 0;
};

/// Errors as open_reader(). journal_write in later calls: the file cannot be read.
[[nodiscard]] Result<std::unique_ptr<Outbox>> open_outbox(const std::string& db_path);

}  // namespace slabd::storage
