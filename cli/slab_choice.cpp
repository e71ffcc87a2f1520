// SPDX-License-Identifier: Apache-2.0
#include "cli/slab_choice.h"

#include <fmt/core.h>

#include <algorithm>

#include "cli/exit.h"
#include "cli/terminal/arguments.h"
#include "cli/terminal/parse.h"
#include "cli/terminal/say.h"
#include "report/slab_view.h"

namespace slabd::cli {
bool SlabChoice::has_filter() const {
  return all || !since.empty() || !until.empty() || slab_type != 0 || !verdict.empty();
}

void SlabChoice::check() const {
  if (slabs.empty() != has_filter())
    stop(kUsage, slabs.empty() ? "name slabs, or say --all, --since, --until, --slab-type or --verdict"
                               : "slabs are named and filtered; allowed is one of the two");
}

void SlabChoice::add_to(args::Command& command) {
  command.add_option("SLAB", slabs,
                     "Keys (see history), slab ids or numbers of the line (no:77); of several the newest slab");
  command.add_flag("--all", all, "Every slab that has ended");
  add_filters_to(command);
}

void SlabChoice::add_filters_to(args::Command& command) {
  command.add_option("--since", since, "Slabs that began then or later: 2026-11-20, 2026-11-20T08:00:00Z, 7d, 12h");
  command.add_option("--until", until, "Slabs that began before that");
  command.add_option("--slab-type", slab_type, "Slabs of this SLAB_TYPE")->check(args::range(1, 65'535));
  command.add_option("--verdict", verdict, "Slabs with this verdict")->check(args::one_of(verdict_names()));
}

storage::SlabRecord named_slab(storage::Reader& reader, const std::string& wanted) {
  auto found = need(report::find_slab(reader, wanted));
  if (!found)
    stop(kBadInput, say("no slab with key or id '{}'{}; `slabctl history` lists them", wanted,
                        wanted.find_first_not_of("0123456789") == std::string::npos ? say(", nor SLAB_NO") : ""));
  return std::move(*found);
}

std::vector<storage::Inspection> ended_slabs(storage::Reader& reader, const SlabChoice& choice) {
  storage::InspectionFilter filter;
  filter.slab_type = choice.slab_type;
  if (!choice.since.empty()) filter.since_utime_us = time_of("--since", choice.since);
  if (!choice.until.empty()) filter.until_utime_us = time_of("--until", choice.until);
  filter.of_both_kinds = true;
  auto slabs = need(reader.inspections(filter), kNotReachable).list;
  const Verdict verdict = verdict_from_name(choice.verdict).value_or(Verdict::none);
  if (verdict != Verdict::none)
    std::erase_if(slabs, [&](const storage::Inspection& slab) { return slab.verdict != verdict; });
  return slabs;
}

std::vector<std::int64_t> chosen_slabs(storage::Reader& reader, const SlabChoice& choice) {
  choice.check();
  std::vector<std::int64_t> keys;
  for (const std::string& wanted : choice.slabs) {
    const storage::SlabRecord found = named_slab(reader, wanted);
    // A slab named twice, for example by key and id, counts once.
    const std::int64_t key = found.summary.header.key;
    if (std::find(keys.begin(), keys.end(), key) == keys.end()) keys.push_back(key);
  }
  if (!choice.slabs.empty()) return keys;
  for (const storage::Inspection& slab : ended_slabs(reader, choice)) keys.push_back(slab.slab_key);
  return keys;
}

}  // namespace slabd::cli
