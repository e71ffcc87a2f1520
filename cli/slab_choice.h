// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "storage/storage.h"

namespace slabd::cli::args {
class Command;
}  // namespace slabd::cli::args

/// Selection of the stored slabs of a command: named ones, or all that match the filters.
namespace slabd::cli {

struct SlabChoice {
  std::vector<std::string> slabs;  ///< keys or slab ids
  bool all = false;
  std::string since;
  std::string until;
  int slab_type = 0;
  std::string verdict;

  void add_to(args::Command& command);
  /// Adds only the filters; slabs cannot be named, and without a filter all are selected.
  void add_filters_to(args::Command& command);
  [[nodiscard]] bool has_filter() const;
  /// Stops unless slabs are named or filtered.
  void check() const;
};

/// The slab of that name, as found by find_slab(); stops if it does not exist.
[[nodiscard]] storage::SlabRecord named_slab(storage::Reader& reader, const std::string& wanted);

/// Ended slabs that match the filters, emulated ones included, oldest first; names are not looked at.
[[nodiscard]] std::vector<storage::Inspection> ended_slabs(storage::Reader& reader, const SlabChoice& choice);

/// Keys, each once, oldest first, or in the order of the names; open slabs only if named. Stops if a named slab does
/// not exist; with filters the list may be empty.
[[nodiscard]] std::vector<std::int64_t> chosen_slabs(storage::Reader& reader, const SlabChoice& choice);

}  // namespace slabd::cli
