// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>

#include "storage/files/folders.h"

/// The name of the process that keeps a writer out of a database. SQLite says "database is locked" and no more.
namespace slabd::storage {

/// Asks the kernel for the locks that SQLite takes (fcntl, on the database and on the index of its log). The two files
/// are opened once and stay open to the end of the process: to close a file drops the locks of every connection that
/// the process has on it. One thread.
class LockProbe {
 public:
  /// "sqlite3 (process 1234)"; "process 1234" where its name may not be read; empty: no other process holds a lock that
  /// a writer waits for. No heap for the probe itself.
  [[nodiscard]] std::string holder(const std::string& db_path);

 private:
  struct Probed {
    int fd = -1;
    std::optional<FileId> file;
  };
  /// Process that holds a lock on bytes `first`..`last`; 0: none does.
  [[nodiscard]] static std::int64_t owner_of(Probed& probed, const std::string& path, std::int64_t first,
                                             std::int64_t last);
  std::array<Probed, 2> probed_;  ///< database, index of its log
};

/// "sqlite3 (process 1234)", as LockProbe says it.
[[nodiscard]] std::string process_words(std::int64_t pid);

}  // namespace slabd::storage
