// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>

#include "base/result.h"

struct sqlite3;
struct sqlite3_stmt;

/// SQLite's C API with ownership. Inside this room a failing call throws SqlFailure, so that a job is a plain list of
/// steps. The room's public functions catch it and return a Status.
namespace slabd::storage {

struct SqlFailure {
  int result = 0;    ///< extended result code
  std::string text;  ///< SQLite's message and the operation
};

/// Throws SqlFailure if `status` is an error; SQLITE_FULL if the disk is full, so that the caller can distinguish a
/// full disk.
void must(const Status& status);

/// State of a database file and its side files at one moment.
class DatabaseFileState {
 public:
  explicit DatabaseFileState(const std::string& path);
  bool operator==(const DatabaseFileState&) const = default;

 private:
  struct One {
    std::uint64_t device = 0;
    std::uint64_t inode = 0;
    std::int64_t bytes = -1;  ///< -1 if it does not exist
    std::int64_t modified_ns = 0;
    std::int64_t changed_ns = 0;
    bool operator==(const One&) const = default;
  };
  std::array<One, 4> files_;
};

class Connection {
 public:
  struct ReadUnchanged {};
  /// Opens a database that no process has open, without locks or side files (SQLite's "immutable"). The caller must
  /// ensure that it has no log.
  Connection(const std::string& path, ReadUnchanged);
  /// Opens the file without creating any other file. `flags` are SQLITE_OPEN_*.
  Connection(const std::string& path, int flags);
  ~Connection();
  Connection(const Connection&) = delete;
  Connection& operator=(const Connection&) = delete;

  void execute(const std::string& sql);
  /// First column of the first row; 0 or empty without rows.
  [[nodiscard]] std::int64_t integer(const std::string& sql);
  [[nodiscard]] std::string text(const std::string& sql);
  [[nodiscard]] std::int64_t changes() const;
  /// Moves the content of the write-ahead log into the database, as far as readers allow, without waiting for them.
  /// True if all of it was moved.
  bool checkpoint();
  [[nodiscard]] sqlite3* handle() const { return handle_; }
  /// Throws SQLITE_BUSY if a database opened as Still has changed, because data read from it may be inconsistent.
  /// Transaction::commit() calls it.
  void check_still() const;

  /// From now on, texts are returned without control characters (base/plain_text.h).
  void read_plain_text() { reads_plain_text_ = true; }
  [[nodiscard]] bool reads_plain_text() const { return reads_plain_text_; }

 private:
  void open(const std::string& name, int flags);

  sqlite3* handle_ = nullptr;
  bool reads_plain_text_ = false;
  std::string still_path_;  ///< empty if locks protect it
  std::optional<DatabaseFileState> still_;
};

/// A statement prepared once and run many times. Parameters and columns are numbered from the left in the SQL text;
/// `run` and the end of the rows reset it.
class Statement {
 public:
  Statement(Connection& connection, const std::string& sql);
  ~Statement();
  Statement(const Statement&) = delete;
  Statement& operator=(const Statement&) = delete;

  Statement& bind(int index, std::int64_t value);
  Statement& bind(int index, double value);  ///< NaN becomes NULL
  Statement& bind(int index, std::string_view value);
  Statement& bind(int index, std::span<const std::uint8_t> bytes);
  Statement& bind_null(int index);

  /// Returns true if a row is available; false at the end, and the statement is reset.
  [[nodiscard]] bool step();
  /// Runs a statement without rows.
  void run();
  /// Resets the statement before the last row.
  void reset();

  [[nodiscard]] std::int64_t integer(int column) const;
  [[nodiscard]] double real(int column) const;  ///< NULL becomes NaN
  /// Text of a column, valid until the next call. On a connection that reads plain text, a text of one line.
  [[nodiscard]] std::string_view text(int column) const;
  /// As text(), but lines are kept.
  [[nodiscard]] std::string_view document(int column) const;
  /// Text as stored, on every connection: for parsing or comparison, not for display.
  [[nodiscard]] std::string_view stored_text(int column) const;
  [[nodiscard]] std::span<const std::uint8_t> bytes(int column) const;  ///< valid until the next step
  [[nodiscard]] bool is_null(int column) const;
  [[nodiscard]] sqlite3_stmt* handle() const { return handle_; }
  /// Throws: the row cannot have been written by this program.
  [[noreturn]] void refuse(int column, const std::string& why) const;

 private:
  [[nodiscard]] std::string_view readable(std::string_view stored, bool with_lines) const;

  Connection& connection_;
  sqlite3_stmt* handle_ = nullptr;
  mutable std::string plain_;  ///< the last text that was converted
};

/// A transaction that is rolled back unless committed.
class Transaction {
 public:
  Transaction(Connection& connection, const char* begin);
  ~Transaction();
  Transaction(const Transaction&) = delete;
  Transaction& operator=(const Transaction&) = delete;
  void commit();

 private:
  Connection& connection_;
  bool open_ = true;
};

}  // namespace slabd::storage
