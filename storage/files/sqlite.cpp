// SPDX-License-Identifier: Apache-2.0
#include "storage/files/sqlite.h"

#include <sqlite3.h>
#include <sys/stat.h>

#include <cmath>
#include <limits>

#include "base/plain_text.h"

namespace slabd::storage {
namespace {

[[noreturn]] void fail(sqlite3* handle, const std::string& doing) {
  const int result = handle != nullptr ? sqlite3_extended_errcode(handle) : SQLITE_NOMEM;
  const std::string message = handle != nullptr ? sqlite3_errmsg(handle) : "out of memory";
  // All statements are ours: only a file with other tables can lack what they name.
  if (message.starts_with("no such column") || message.starts_with("no such table") ||
      message.find("has no column named") != std::string::npos)
    throw SqlFailure{result, "a test version of slabd before 1.0 wrote it, with other tables (" + message +
                                 "): begin a new one with slabctl db restore --fresh, which keeps this one in "
                                 "quarantine"};
  throw SqlFailure{result, message + " (SQLite " + std::to_string(result) + ") in: " + doing};
}

const char* kind_of(mode_t mode) {
  if (S_ISDIR(mode)) return "a folder";
  if (S_ISFIFO(mode)) return "a FIFO";
  if (S_ISSOCK(mode)) return "a socket";
  return "a device";
}

/// Percent-encodes every byte that has a meaning in a URI.
std::string uri_of(const std::string& path) {
  constexpr std::string_view kDigits = "0123456789ABCDEF";
  std::string uri = "file:";
  for (const char c : path) {
    const auto byte = static_cast<unsigned char>(c);
    if (c > ' ' && c < 0x7F && c != '%' && c != '?' && c != '#')
      uri += c;
    else
      (uri += '%').append({kDigits[byte >> 4U], kDigits[byte & 0xFU]});
  }
  return uri;
}

std::int64_t nanoseconds(const timespec& time) {
  return time.tv_sec * std::int64_t{1'000'000'000} + time.tv_nsec;
}

}  // namespace

void must(const Status& status) {
  if (status.ok()) return;
  throw SqlFailure{status.error().code == Code::store_full ? SQLITE_FULL : SQLITE_IOERR,
                   std::string(status.error().text.view())};
}

DatabaseFileState::DatabaseFileState(const std::string& path) {
  constexpr std::array kSides = {"", "-wal", "-shm", "-journal"};
  static_assert(std::tuple_size_v<decltype(files_)> == kSides.size());
  for (std::size_t i = 0; i < kSides.size(); ++i) {
    struct stat there {};
    if (::stat((path + kSides[i]).c_str(), &there) != 0) continue;
    files_[i] = {there.st_dev, there.st_ino, there.st_size, nanoseconds(there.st_mtim), nanoseconds(there.st_ctim)};
  }
}

// ---- Connection --------------------------------------------------------------------------------------------------

Connection::Connection(const std::string& path, int flags) {
  // Opening a FIFO would block until its other end is opened.
  struct stat there {};
  if (::stat(path.c_str(), &there) == 0 && !S_ISREG(there.st_mode))
    throw SqlFailure{SQLITE_CANTOPEN, path + " is " + kind_of(there.st_mode) + ", not a database file"};
  open(path, flags);
}

Connection::Connection(const std::string& path, ReadUnchanged) : still_path_(path), still_(DatabaseFileState(path)) {
  open(uri_of(path) + "?immutable=1", SQLITE_OPEN_READONLY | SQLITE_OPEN_URI);
}

void Connection::check_still() const {
  if (still_ && !(DatabaseFileState(still_path_) == *still_))
    throw SqlFailure{SQLITE_BUSY, "it was changed while it was read: slabd was started meanwhile; try again"};
}

void Connection::open(const std::string& name, int flags) {
  if (sqlite3_open_v2(name.c_str(), &handle_, flags, nullptr) == SQLITE_OK) {
    sqlite3_extended_result_codes(handle_, 1);
    return;
  }
  const int result = handle_ != nullptr ? sqlite3_extended_errcode(handle_) : SQLITE_NOMEM;
  std::string text = handle_ != nullptr ? sqlite3_errmsg(handle_) : "out of memory";
  sqlite3_close_v2(handle_);
  throw SqlFailure{result, std::move(text)};
}

Connection::~Connection() {
  sqlite3_close_v2(handle_);
}

void Connection::execute(const std::string& sql) {
  if (sqlite3_exec(handle_, sql.c_str(), nullptr, nullptr, nullptr) != SQLITE_OK) fail(handle_, sql.substr(0, 120));
}

std::int64_t Connection::integer(const std::string& sql) {
  Statement statement(*this, sql);
  return statement.step() ? statement.integer(0) : 0;
}

std::string Connection::text(const std::string& sql) {
  Statement statement(*this, sql);
  return statement.step() ? std::string(statement.text(0)) : std::string();
}

std::int64_t Connection::changes() const {
  return sqlite3_changes64(handle_);
}

bool Connection::checkpoint() {
  int in_log = 0;
  int moved = 0;
  const int result = sqlite3_wal_checkpoint_v2(handle_, nullptr, SQLITE_CHECKPOINT_PASSIVE, &in_log, &moved);
  if (result == SQLITE_BUSY || result == SQLITE_LOCKED) return false;
  if (result != SQLITE_OK) fail(handle_, "checkpoint");
  return moved == in_log;
}

// ---- Statement ---------------------------------------------------------------------------------------------------

Statement::Statement(Connection& connection, const std::string& sql) : connection_(connection) {
  if (sqlite3_prepare_v3(connection.handle(), sql.c_str(), -1, SQLITE_PREPARE_PERSISTENT, &handle_, nullptr) !=
      SQLITE_OK)
    fail(connection.handle(), sql.substr(0, 120));
}

Statement::~Statement() {
  sqlite3_finalize(handle_);
}

Statement& Statement::bind(int index, std::int64_t value) {
  if (sqlite3_bind_int64(handle_, index, value) != SQLITE_OK) fail(connection_.handle(), "bind");
  return *this;
}

Statement& Statement::bind(int index, double value) {
  if (std::isnan(value)) return bind_null(index);
  if (sqlite3_bind_double(handle_, index, value) != SQLITE_OK) fail(connection_.handle(), "bind");
  return *this;
}

Statement& Statement::bind(int index, std::string_view value) {
  // An empty view may contain a null pointer, which SQLite would store as NULL.
  const char* bytes = value.empty() ? "" : value.data();
  if (sqlite3_bind_text64(handle_, index, bytes, value.size(), SQLITE_TRANSIENT, SQLITE_UTF8) != SQLITE_OK)
    fail(connection_.handle(), "bind");
  return *this;
}

Statement& Statement::bind(int index, std::span<const std::uint8_t> bytes) {
  const void* data = bytes.empty() ? static_cast<const void*>("") : bytes.data();
  if (sqlite3_bind_blob64(handle_, index, data, bytes.size(), SQLITE_TRANSIENT) != SQLITE_OK)
    fail(connection_.handle(), "bind");
  return *this;
}

Statement& Statement::bind_null(int index) {
  if (sqlite3_bind_null(handle_, index) != SQLITE_OK) fail(connection_.handle(), "bind");
  return *this;
}

bool Statement::step() {
  const int result = sqlite3_step(handle_);
  if (result == SQLITE_ROW) return true;
  if (result != SQLITE_DONE) {
    const int code = sqlite3_extended_errcode(connection_.handle());
    std::string text = std::string(sqlite3_errmsg(connection_.handle())) + " (SQLite " + std::to_string(code) +
                       ") in: " + std::string(sqlite3_sql(handle_)).substr(0, 80);
    sqlite3_reset(handle_);
    throw SqlFailure{code, std::move(text)};
  }
  sqlite3_reset(handle_);
  return false;
}

void Statement::run() {
  if (step()) reset();
}

void Statement::reset() {
  sqlite3_reset(handle_);
}

std::int64_t Statement::integer(int column) const {
  if (sqlite3_column_type(handle_, column) != SQLITE_INTEGER) refuse(column, "is not a whole number");
  return sqlite3_column_int64(handle_, column);
}

double Statement::real(int column) const {
  if (is_null(column)) return std::numeric_limits<double>::quiet_NaN();
  if (sqlite3_column_type(handle_, column) != SQLITE_FLOAT) refuse(column, "is not a number");
  return sqlite3_column_double(handle_, column);
}

std::string_view Statement::stored_text(int column) const {
  if (sqlite3_column_type(handle_, column) != SQLITE_TEXT) refuse(column, "is not text");
  const void* bytes = sqlite3_column_text(handle_, column);
  const int size = sqlite3_column_bytes(handle_, column);
  return {static_cast<const char*>(bytes), static_cast<std::size_t>(size)};
}

std::string_view Statement::readable(std::string_view stored, bool with_lines) const {
  const Lines lines = with_lines ? Lines::kept : Lines::replaced;
  if (!connection_.reads_plain_text() || is_plain(stored, lines)) return stored;
  plain_ = plain(stored, lines);
  return plain_;
}

std::string_view Statement::text(int column) const {
  return readable(stored_text(column), false);
}

std::string_view Statement::document(int column) const {
  return readable(stored_text(column), true);
}

std::span<const std::uint8_t> Statement::bytes(int column) const {
  if (sqlite3_column_type(handle_, column) != SQLITE_BLOB) refuse(column, "is not a run of bytes");
  const void* data = sqlite3_column_blob(handle_, column);
  return {static_cast<const std::uint8_t*>(data), static_cast<std::size_t>(sqlite3_column_bytes(handle_, column))};
}

bool Statement::is_null(int column) const {
  return sqlite3_column_type(handle_, column) == SQLITE_NULL;
}

void Statement::refuse(int column, const std::string& why) const {
  const char* table = sqlite3_column_table_name(handle_, column);
  const char* name = sqlite3_column_name(handle_, column);
  throw SqlFailure{SQLITE_CORRUPT, std::string("column ") + (table != nullptr ? table : "?") + "." +
                                       (name != nullptr ? name : "?") + " " + why};
}

// ---- Transaction -------------------------------------------------------------------------------------------------

Transaction::Transaction(Connection& connection, const char* begin) : connection_(connection) {
  connection.execute(begin);
}

Transaction::~Transaction() {
  // A failed rollback is ignored: the code that handles the original failure closes the connection.
  if (open_ && sqlite3_get_autocommit(connection_.handle()) == 0)
    sqlite3_exec(connection_.handle(), "ROLLBACK", nullptr, nullptr, nullptr);
}

void Transaction::commit() {
  connection_.execute("COMMIT");
  open_ = false;
  connection_.check_still();
}

}  // namespace slabd::storage
