// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "storage/storage.h"

namespace slabd::args {
class Command;
}  // namespace slabd::args

/// Which stored slabs a command works on: named ones, or all that the filters let through.
namespace slabd::cli {

struct SlabChoice {
  std::vector<std::string> slabs;  ///< keys or slab ids
  bool all = false;
  std::string since;
  std::string until;
  int slab_type = 0;
  std::string verdict;

  void add_to(args::Command& command);
  /// The filters alone; no slab can be named, and without any all are meant.
  void add_filters_to(args::Command& command);
  [[nodiscard]] bool has_filter() const;
};

/// The slab of that name, as find_slab() finds it; stops if there is none.
[[nodiscard]] storage::SlabRecord named_slab(storage::Reader& reader, const std::string& wanted);

/// Keys, each once, oldest first, or as they were named; slabs that are still open only when they are named. Stops if
/// one that was named does not exist; the filters may leave an empty list.
[[nodiscard]] std::vector<std::int64_t> chosen_slabs(storage::Reader& reader, const SlabChoice& choice);

}  // namespace slabd::cli
