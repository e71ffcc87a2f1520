// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <chrono>
#include <cstdint>
#include <memory>
#include <optional>
#include <string>
#include <vector>

/// libpq with ownership and with a time limit on every step. A failing call throws PostgresFailure.
namespace slabd::plant {

struct PostgresFailure {
  std::string text;   ///< the server's or libpq's sentence, one line
  std::string state;  ///< SQLSTATE; empty: the connection failed
  bool lost = false;  ///< the connection cannot be used any more
};

/// Text form of a parameter or of a column; nullopt: NULL.
using Cell = std::optional<std::string>;
using Rows = std::vector<std::vector<Cell>>;

class Postgres {
 public:
  /// Connects. Unless the connection string says otherwise, a server that is not on this computer must prove its name
  /// by a certificate (sslmode=verify-full), and a connection that is cut is noticed after 30 s.
  Postgres(const std::string& dsn, const char* name);

  /// Runs one statement with parameters $1, $2, ...
  Rows run(const std::string& sql, const std::vector<Cell>& parameters = {});
  /// Runs several statements without parameters.
  void run_script(const std::string& sql);
  /// Runs one row's first column; 0 without rows or for NULL.
  std::int64_t integer(const std::string& sql, const std::vector<Cell>& parameters = {});

  /// Name of the server and of the database, for messages.
  [[nodiscard]] const std::string& place() const { return place_; }
  /// Time limit of each later statement.
  void set_patience(std::chrono::seconds patience) { patience_ = patience; }

 private:
  struct Handle;
  struct Closer {
    void operator()(Handle* handle) const;
  };
  void wait_for(bool readable, std::chrono::steady_clock::time_point until);
  Rows take_results();

  std::unique_ptr<Handle, Closer> handle_;
  std::string place_;
  std::chrono::seconds patience_{60};
};

/// Bytes given as hexadecimal digits, in the text form of type bytea.
[[nodiscard]] inline std::string bytea(const std::string& hex) {
  return "\\x" + hex;
}
/// A list of texts in the text form of an array. The texts must be plain: digits, letters, '-'.
[[nodiscard]] std::string array_of(const std::vector<std::string>& plain);

}  // namespace slabd::plant
