// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <string>

#include "base/result.h"
#include "storage/files/sqlite.h"

/// Opening the database file: whose it is, and the settings everything else relies on.
namespace slabd::storage {

/// Opens or creates the database, makes the log durable that lies there (storage/files/log_copy.h), checks it
/// (application_id, user_version, quick_check), brings an older one up to date (storage/files/upgrade.h) and puts the
/// settings in force. journal_write; the text names file and figures. A foreign or newer file is left as it was, a
/// damaged one of ours goes to quarantine (storage/files/quarantine.h); the writer's lock must be held.
[[nodiscard]] Result<std::unique_ptr<Connection>> open_for_writing(const std::string& path);

/// As open_for_writing(), of the file that this process checked before and closed after a call that failed: without
/// quick_check, which may take a minute of a database that is gigabytes, while the line waits.
[[nodiscard]] Result<std::unique_ptr<Connection>> open_again_for_writing(const std::string& path);

/// As open_for_writing(), of a file that is itself a copy: brought up to date without another copy.
[[nodiscard]] Result<std::unique_ptr<Connection>> open_copy_for_writing(const std::string& path);

/// As open_for_reading(), of any schema version. journal_write: it is ours and damaged.
[[nodiscard]] Result<std::unique_ptr<Connection>> open_any_version(const std::string& path);

/// Opens an existing database read-only; config when it does not exist or is not ours.
[[nodiscard]] Result<std::unique_ptr<Connection>> open_for_reading(const std::string& path);

/// The first look at the database in a transaction. Who may not write waits here, for up to 2 s, until a slabd that is
/// just starting has made the index of the log.
void begin_to_read(Connection& db);

/// Whether the file's first bytes are those of a database of ours, whatever the rest is.
[[nodiscard]] bool has_our_header(const std::string& path);

/// As is_unused() in storage/storage.h.
[[nodiscard]] bool unused_at(const std::string& path);

}  // namespace slabd::storage
