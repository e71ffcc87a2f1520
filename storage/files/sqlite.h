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

/// SQLite's C API with ownership. Inside this room a failing call throws SqlFailure, so that a job reads as the list
/// of things it does; the room's public functions catch it and return a Status.
namespace slabd::storage {

struct SqlFailure {
  int result = 0;    ///< extended result code
  std::string text;  ///< SQLite's message and what was being done
};

/// Throws what a file's failing came to. SQLITE_FULL where its disk is full: whoever catches it tells a full disk by
/// that.
void must(const Status& status);

/// From now on SQLite asks the process's std::new_handler when memory runs out. Has to come before anything else is
/// asked of SQLite, a VFS included; later it does nothing.
void use_the_new_handler();

/// A database file and the files beside it, as they are at one moment.
class FileStand {
 public:
  explicit FileStand(const std::string& path);
  bool operator==(const FileStand&) const = default;

 private:
  struct One {
    std::uint64_t device = 0;
    std::uint64_t inode = 0;
    std::int64_t bytes = -1;  ///< -1: not there
    std::int64_t modified_ns = 0;
    std::int64_t changed_ns = 0;
    bool operator==(const One&) const = default;
  };
  std::array<One, 4> files_;
};

class Connection {
 public:
  struct Still {};
  /// For reading a database that no process has open, without locks and without a file beside it (SQLite's
  /// "immutable"). The caller has made sure that no log belongs to it.
  Connection(const std::string& path, Still);
  /// Opens without creating anything but the file. `flags` are SQLITE_OPEN_*.
  Connection(const std::string& path, int flags);
  ~Connection();
  Connection(const Connection&) = delete;
  Connection& operator=(const Connection&) = delete;

  void execute(const std::string& sql);
  /// First column of the first row; 0 or empty when there is none.
  [[nodiscard]] std::int64_t integer(const std::string& sql);
  [[nodiscard]] std::string text(const std::string& sql);
  [[nodiscard]] std::int64_t changes() const;
  /// Moves what is in the write-ahead log into the database, as far as readers allow, without waiting for them. True:
  /// all of it.
  bool checkpoint();
  [[nodiscard]] sqlite3* handle() const { return handle_; }
  /// Throws SQLITE_BUSY when a database that was opened as Still is not still any more: what was read of it may
  /// contradict itself. Transaction::commit() calls it.
  void check_still() const;

  /// From now on texts that are read have no control characters (base/plain_text.h).
  void read_plain_text() { reads_plain_text_ = true; }
  [[nodiscard]] bool reads_plain_text() const { return reads_plain_text_; }

 private:
  void open(const std::string& name, int flags);

  sqlite3* handle_ = nullptr;
  bool reads_plain_text_ = false;
  std::string still_path_;  ///< empty: locks keep it still
  std::optional<FileStand> still_;
};

/// Prepared once, run many times. Parameters and columns count from the left in the order of the SQL text;
/// `run` and the end of the rows leave it ready for the next use.
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

  /// True: a row is there. False: no more rows, the statement is reset.
  [[nodiscard]] bool step();
  /// For statements without rows.
  void run();
  /// Ends reading before the last row.
  void reset();

  [[nodiscard]] std::int64_t integer(int column) const;
  [[nodiscard]] double real(int column) const;  ///< NULL becomes NaN
  /// Valid until the next call. On a connection that reads plain text, a text of one line.
  [[nodiscard]] std::string_view text(int column) const;
  /// As text(), of a text with lines.
  [[nodiscard]] std::string_view document(int column) const;
  /// As stored, on every connection: to be parsed or compared, not to be shown.
  [[nodiscard]] std::string_view stored_text(int column) const;
  [[nodiscard]] std::span<const std::uint8_t> bytes(int column) const;  ///< valid until the next step
  [[nodiscard]] bool is_null(int column) const;
  [[nodiscard]] sqlite3_stmt* handle() const { return handle_; }
  /// A row that cannot have been written by this program.
  [[noreturn]] void refuse(int column, const std::string& why) const;

 private:
  [[nodiscard]] std::string_view readable(std::string_view stored, bool with_lines) const;

  Connection& connection_;
  sqlite3_stmt* handle_ = nullptr;
  mutable std::string plain_;  ///< of the last text that was not plain
};

/// Rolls back unless committed.
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
