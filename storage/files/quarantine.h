// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <string>

#include "base/result.h"

/// A damaged database is evidence and must neither be written to nor be taken for the history. It goes, with its log,
/// into a folder of its own; a short text stays under its name, which no program takes for a database.
namespace slabd::storage {

/// Moves `path`, `path`-wal and `path`-journal to `<path>.quarantine-<time>` and leaves the text. Cut short at any
/// moment, either the database is untouched or is_quarantined() is true and finish_quarantine() moves the rest. The
/// writer's lock must be held. Returns the folder. journal_write: nothing was moved.
[[nodiscard]] Result<std::string> quarantine(const std::string& path, const std::string& why);

/// The text under the database's name, when that is what lies there.
[[nodiscard]] std::optional<std::string> quarantine_note(const std::string& path);

/// Why a whole one went there: restoring was about to put another in its place.
inline constexpr const char* kReplaced = "replaced by slabctl db restore";

/// Where the whole database lies that a restoring was replacing when it was cut short; empty: the note is of a damaged
/// one, or there is none.
[[nodiscard]] std::string replaced_in_quarantine(const std::string& path);

/// Moves what quarantine() was stopped before. Does nothing when no note lies there.
[[nodiscard]] Status finish_quarantine(const std::string& path);

/// Added to a database's name: what restore_database() prepares before it takes its place.
inline constexpr const char* kRestored = ".restored";

/// What shows that there has been a database although no file (or an empty one) lies at `path`: a log, a backup, a
/// restoring that was cut short, a quarantine, scans of slabs in the spool. Empty: nothing.
[[nodiscard]] std::string sign_of_earlier_life(const std::string& path, const std::string& spool_dir);

/// The folder of the newest slab with scans in the spool when its key is above `known_key`; empty: there is none.
[[nodiscard]] std::string scans_above(const std::string& spool_dir, std::int64_t known_key);

/// The largest slab number among the spool's folders, 0: none.
[[nodiscard]] std::int64_t newest_key_in_spool(const std::string& spool_dir);

}  // namespace slabd::storage
