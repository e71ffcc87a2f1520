// SPDX-License-Identifier: Apache-2.0
#include <fmt/core.h>

#include <algorithm>
#include <filesystem>
#include <set>
#include <string>
#include <vector>

#include "algo/algo.h"
#include "cli/exit.h"
#include "cli/replay/shard.h"

namespace slabd::cli {
namespace {

/// Faults of one kind: their number, and the first of them.
struct Faults {
  std::size_t count = 0;
  std::string names;

  void add(const std::string& name) {
    constexpr std::size_t kNamed = 10;
    if (++count <= kNamed)
      names += (count == 1 ? "" : ", ") + name;
    else if (count == kNamed + 1)
      names += ", ...";
  }
};

std::string path_in(const std::string& dir, const std::string& file) {
  return (std::filesystem::path(dir) / file).string();
}

/// The one selection of the folder; stops if there is none, or more than one.
Selection selection_in(const std::string& dir, const ShardFolder& folder) {
  if (folder.selections.empty())
    stop(kBadInput, fmt::format("{}: the folder has no selection-*.json; no shard has written into it", dir));
  Selection selection;
  std::string damage = read_selection(path_in(dir, folder.selections.front()), selection);
  if (!damage.empty()) stop(kBadInput, damage);
  if (folder.selections.size() == 1) {
    if (folder.selections.front() != selection.file_name())
      stop(kBadInput, fmt::format("{}: the file was renamed", path_in(dir, folder.selections.front())));
    return selection;
  }
  Selection other;
  damage = read_selection(path_in(dir, folder.selections[1]), other);
  if (!damage.empty()) stop(kBadInput, damage);
  stop(kBadInput, fmt::format("{} has the results of {} replays: {} and {} differ in {}", dir, folder.selections.size(),
                              folder.selections[0], folder.selections[1], difference(selection, other)));
}

/// Reason why a slab's file does not belong to the selection.
std::string other_inputs(const SlabFile& file, const Selection& selection) {
  const auto selected = [&](const SelectedSlab& slab) { return slab.key == file.key; };
  if (file.software != selection.inputs.software) return "by " + file.software;
  if (file.build != selection.inputs.build) return "by another build of " + file.software;
  if (std::none_of(selection.slabs.begin(), selection.slabs.end(), selected)) return "slab not selected";
  return "with another recipe, option or slab of this key";
}

}  // namespace

int merge_shards(const std::string& dir, bool as_json) {
  const ShardFolder folder = shard_folder(dir);
  const Selection selection = selection_in(dir, folder);
  std::set<std::string> others(folder.slabs.begin(), folder.slabs.end());
  std::set<std::string> instruction_sets;
  std::vector<std::string> paths;
  Faults missing;
  Faults damaged;
  Faults other;
  const std::string inputs = selection.inputs_sha256();
  for (const SelectedSlab& slab : selection.slabs) {
    const std::string sha256 = slab_inputs_sha256(inputs, slab);
    const std::string name = slab_file_name(slab.key, sha256);
    if (others.erase(name) == 0) {
      missing.add(fmt::format("{}", slab.key));
      continue;
    }
    SlabFile file;
    paths.push_back(path_in(dir, name));
    if (const std::string damage = read_slab_file(paths.back(), file); !damage.empty())
      damaged.add(damage);
    else if (file.inputs_sha256 != sha256 || file.key != slab.key)
      other.add(fmt::format("{} (renamed, it has the result of slab {})", name, file.key));
    else
      instruction_sets.insert(file.instruction_set);
  }
  for (const std::string& name : others) {
    SlabFile file;
    if (const std::string damage = read_slab_file(path_in(dir, name), file); !damage.empty())
      damaged.add(damage);
    else
      other.add(fmt::format("{} ({})", name, other_inputs(file, selection)));
  }
  Faults foreign;
  for (const std::string& name : folder.foreign) foreign.add(name);
  if (foreign.count > 0)
    complain(fmt::format("{}: {} files are not results of a shard: {}", dir, foreign.count, foreign.names));
  if (other.count > 0)
    complain(fmt::format("{}: {} files have other inputs than {}: {}", dir, other.count, folder.selections.front(),
                         other.names));
  if (damaged.count > 0)
    complain(fmt::format("{} files are damaged; run their shards again: {}", damaged.count, damaged.names));
  if (missing.count > 0)
    complain(fmt::format("{}: {} of {} slabs are missing; run the shards again, finished slabs are kept: {}", dir,
                         missing.count, selection.slabs.size(), missing.names));
  if (foreign.count + other.count + damaged.count + missing.count > 0) stop(kBadInput);

  // Machines may have different instruction sets; the results are the same.
  std::string sets;
  for (const std::string& set : instruction_sets) sets += (sets.empty() ? "" : " and ") + set;
  if (selection.slabs.empty()) sets = algo::instruction_set();
  ReplayReport report({selection.kind(), selection.inputs.software, selection.inputs.threads, sets,
                       selection.inputs.recipe, selection.named},
                      as_json);
  for (const std::string& path : paths) {
    SlabFile file;
    if (const std::string damage = read_slab_file(path, file); !damage.empty()) stop(kBadInput, damage);
    report.add(std::move(file.record));
  }
  return report.end();
}

}  // namespace slabd::cli
