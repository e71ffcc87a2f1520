// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <memory>
#include <string>

#include "base/result.h"
#include "storage/files/sqlite.h"

/// Opening of the database file: ownership checks, and the settings that the other functions rely on.
namespace slabd::storage {

/// Opens or creates the database. Steps: make an existing log durable (storage/files/log_copy.h), check the file
/// (application_id, user_version, quick_check), upgrade an older one (storage/files/upgrade.h), apply the settings.
/// journal_write: the text contains file and figures. A foreign or newer file is unchanged; a damaged slabd database is
/// moved to quarantine (storage/files/quarantine.h). The writer's lock must be held.
[[nodiscard]] Result<std::unique_ptr<Connection>> open_for_writing(const std::string& path);

/// As open_for_writing(), for a file that this process has checked before and closed after a failed call. It omits
/// quick_check, which may take a minute on a database of gigabytes while the line waits.
[[nodiscard]] Result<std::unique_ptr<Connection>> open_again_for_writing(const std::string& path);

/// As open_for_writing(), for a file that is itself a copy: upgraded without another copy.
[[nodiscard]] Result<std::unique_ptr<Connection>> open_copy_for_writing(const std::string& path);

/// As open_for_reading(), for any schema version. journal_write: it is a slabd database and damaged.
[[nodiscard]] Result<std::unique_ptr<Connection>> open_any_version(const std::string& path);

/// Opens an existing database read-only; config if it does not exist or is not a slabd database.
[[nodiscard]] Result<std::unique_ptr<Connection>> open_for_reading(const std::string& path);

/// Performs the first read of a transaction. A process without write permission waits here, for up to 2 s, until a
/// starting slabd has built the index of the log.
void begin_to_read(Connection& db);

/// True if the file starts with the header of a slabd database, whatever its other content.
[[nodiscard]] bool has_our_header(const std::string& path);

/// Implements is_unused() of storage/storage.h.
[[nodiscard]] bool unused_at(const std::string& path);

/// True if a writer was killed before it had made the file a database with a log. Readers fail until the next writer
/// has undone that write.
[[nodiscard]] bool has_half_a_write(const std::string& path);

}  // namespace slabd::storage
