// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "base/fields.h"
#include "cli/replay/replay_report.h"

/// Files of a replay in shards: one of the selection, and one of each slab. All shards write the same bytes for the
/// same inputs, so that a shard that runs twice changes nothing. The name of a slab's file contains its inputs: a file
/// of that name is the result. Each file ends with the SHA-256 of its other bytes.
namespace slabd::cli {

struct RecipeFile {
  std::string file;
  std::string sha256;
};
SLABD_FIELDS(RecipeFile, file, sha256);

/// Inputs of every slab of a replay, apart from the slab itself.
struct ReplayInputs {
  std::string kind;  ///< name of the ReplayKind
  std::string software;
  std::string build;  ///< SHA-256 of the program if `software` names no commit; otherwise empty
  int threads = 1;    ///< does not change a result, but is part of the output
  std::string unit;
  std::string columns;
  std::string scans;                ///< --scans
  RecipeName recipe;                ///< of ReplayKind::what_if
  std::vector<RecipeFile> recipes;  ///< of ReplayKind::verify: the recipes of the folder, in its order
};
SLABD_FIELDS(ReplayInputs, kind, software, build, threads, unit, columns, scans, recipe, recipes);

struct SelectedSlab {
  std::int64_t key = 0;
  std::int64_t began_utime_us = 0;  ///< distinguishes slabs of two lines that have the same key
};
SLABD_FIELDS(SelectedSlab, key, began_utime_us);

struct Selection {
  ReplayInputs inputs;
  bool named = false;  ///< the slabs were named, not selected by filters
  std::vector<SelectedSlab> slabs;

  [[nodiscard]] ReplayKind kind() const;
  /// SHA-256 of the inputs, hex.
  [[nodiscard]] std::string inputs_sha256() const;
  /// Content of its file.
  [[nodiscard]] std::string text() const;
  /// "selection-0123456789abcdef.json", from the SHA-256 of the content.
  [[nodiscard]] std::string file_name() const;
};
/// SHA-256 of the inputs of one slab, hex. `inputs_sha256`: that of the selection.
[[nodiscard]] std::string slab_inputs_sha256(const std::string& inputs_sha256, const SelectedSlab& slab);
/// "12-0123456789abcdef.json". `slab_sha256`: slab_inputs_sha256().
[[nodiscard]] std::string slab_file_name(std::int64_t key, const std::string& slab_sha256);

/// First difference between two selections, "software: slabd 1.0.0+a, slabd 1.0.0+b"; empty if they are the same.
[[nodiscard]] std::string difference(const Selection& a, const Selection& b);

/// Content of a slab's file.
struct SlabFile {
  std::string software;
  std::string build;
  std::string inputs_sha256;  ///< slab_inputs_sha256()
  std::string instruction_set;
  std::int64_t key = 0;
  ReplayRecord record;

  [[nodiscard]] std::string text() const;
};

/// Read a file that text() wrote; return the fault as a sentence that names the file and, where it is known, the byte.
/// Empty: no fault. With a fault, `out` is not complete.
[[nodiscard]] std::string read_selection(const std::string& path, Selection& out);
[[nodiscard]] std::string read_slab_file(const std::string& path, SlabFile& out);

/// Files of a folder, each list sorted.
struct ShardFolder {
  std::vector<std::string> selections;
  std::vector<std::string> slabs;    ///< with the name of a slab's file
  std::vector<std::string> foreign;  ///< everything else, without hidden files and files that are being written
};
/// Stops if the folder cannot be read.
[[nodiscard]] ShardFolder shard_folder(const std::string& dir);

}  // namespace slabd::cli
