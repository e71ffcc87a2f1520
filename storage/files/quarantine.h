// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <optional>
#include <string>

#include "base/result.h"

/// A damaged database is evidence: it must not be modified or used as the history. It is moved with its log into a
/// folder of its own. A short text replaces it, which no program accepts as a database.
namespace slabd::storage {

/// Moves `path`, `path`-wal and `path`-journal to `<path>.quarantine-<time>`, writes the text and returns the folder.
/// If interrupted, either the database is unchanged, or quarantine_note() is set and finish_quarantine() moves the
/// rest. The writer's lock must be held. journal_write: nothing was moved.
[[nodiscard]] Result<std::string> quarantine(const std::string& path, const std::string& why);

/// The text at the database's path; nullopt if the file there is not such a text.
[[nodiscard]] std::optional<std::string> quarantine_note(const std::string& path);

/// Reason for an intact database in quarantine: a restore was about to replace it.
inline constexpr const char* kReplaced = "replaced by slabctl db restore";

/// Path of the intact database that an interrupted restore was replacing; empty if the note is of a damaged one, or if
/// there is none.
[[nodiscard]] std::string replaced_in_quarantine(const std::string& path);

/// Moves the files that an interrupted quarantine() has left. Does nothing without a note.
[[nodiscard]] Status finish_quarantine(const std::string& path);

/// Suffix of the file that restore_database() prepares next to the database.
inline constexpr const char* kRestored = ".restored";

/// Path of a file or folder that proves an earlier database, although none (or an empty file) is at `path`; empty if
/// there is none. Proofs are a log, a backup, an interrupted restore, a quarantine, and scans of slabs in the spool.
[[nodiscard]] std::string traces_of_a_lost_database(const std::string& path, const std::string& spool_dir);

/// Folder of the newest slab with scans in the spool if its key is above `known_key`; empty otherwise.
[[nodiscard]] std::string scans_above(const std::string& spool_dir, std::int64_t known_key);

/// Largest slab key among the spool's folders; 0 if there are none.
[[nodiscard]] std::int64_t newest_key_in_spool(const std::string& spool_dir);

}  // namespace slabd::storage
