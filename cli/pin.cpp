// SPDX-License-Identifier: Apache-2.0
//
// slabctl pin, unpin: keeps a slab's scans independent of the spool's budget. A pin is a file pin.json next to the
// scans: it needs neither database nor daemon, and is archived with the folder. The daemon checks for it before it
// deletes.
#include "cli/command.h"

#include <fmt/core.h>
#include <unistd.h>

#include <algorithm>
#include <cerrno>
#include <chrono>
#include <cstring>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "base/durable.h"
#include "cli/database.h"
#include "cli/exit.h"
#include "cli/slab_choice.h"
#include "cli/terminal/arguments.h"
#include "cli/terminal/parse.h"
#include "report/json.h"
#include "report/slab_view.h"

namespace slabd::cli {
namespace {

namespace fs = std::filesystem;

struct PinOptions {
  std::string config;
  std::string slab;
  std::string reason;
};

struct PinPlace {
  std::int64_t key = 0;
  std::string slab_id;
  std::string file;
  std::vector<std::string> scans;  ///< paths of the scans of the slab's attempts
};

std::size_t scans_there(const PinPlace& place) {
  return static_cast<std::size_t>(std::count_if(place.scans.begin(), place.scans.end(), [](const std::string& scan) {
    std::error_code ignored;
    return fs::is_regular_file(scan, ignored);
  }));
}

/// Path of the slab's pin, and of its scans.
PinPlace place_of(const PinOptions& options) {
  const config::Config config = config_from(options.config);
  DatabaseOptions database;
  database.db = config.storage.db_path;
  const auto reader = open_database(database);
  const storage::SlabRecord found = named_slab(*reader, options.slab);
  PinPlace place;
  place.key = found.summary.header.key;
  place.slab_id = std::string(found.summary.header.slab_id.view());
  const fs::path folder = fs::path(config.storage.spool_dir) / std::to_string(place.key);
  std::error_code ignored;
  if (!fs::is_directory(folder, ignored))
    stop(kBadInput, fmt::format("slab {} \"{}\": its scans are gone ({} is not there)", place.key, place.slab_id,
                                folder.string()));
  place.file = (folder / "pin.json").string();
  // By name, not by whole path: the path of the spool may have changed since the scan was recorded.
  for (const storage::SlabBlock& block : found.blocks)
    if (const fs::path scan(block.attempt.scan_path.view()); scan.has_filename())
      place.scans.push_back((folder / scan.filename()).string());
  return place;
}

int pin(const PinOptions& options) {
  const PinPlace place = place_of(options);
  const std::int64_t now_us =
      std::chrono::duration_cast<std::chrono::microseconds>(std::chrono::system_clock::now().time_since_epoch())
          .count();
  report::Json json("slabd.pin/1");
  json.field("key", place.key).field("slab_id", place.slab_id).field("reason", options.reason);
  report::write_time(json, "pinned", now_us);
  json.field("user", static_cast<unsigned>(::getuid())).end_object();
  need(write_durably(place.file, json.text()), kNotReachable);
  // Counted after writing the pin: the daemon may have been deleting scans, and stops when it finds the pin.
  const std::size_t there = scans_there(place);
  if (there == 0) {
    ::unlink(place.file.c_str());
    stop(kBadInput, fmt::format("slab {} \"{}\": {} ({} is there without one)", place.key, place.slab_id,
                                place.scans.empty() ? "no scan of it is recorded yet" : "its scans are gone",
                                fs::path(place.file).parent_path().string()));
  }
  if (there < place.scans.size())
    complain(fmt::format("slab {} \"{}\": {} of its {} scans are gone already", place.key, place.slab_id,
                         place.scans.size() - there, place.scans.size()));
  fmt::print("slab {} \"{}\": its scans are kept: {}\n", place.key, place.slab_id, options.reason);
  return kDone;
}

int unpin(const PinOptions& options) {
  const PinPlace place = place_of(options);
  if (::unlink(place.file.c_str()) != 0) {
    stop(errno == ENOENT ? kBadInput : kNotReachable,
         errno == ENOENT ? fmt::format("slab {} \"{}\" is not pinned", place.key, place.slab_id)
                         : fmt::format("{} cannot be removed: {}", place.file, std::strerror(errno)));
  }
  fmt::print("slab {} \"{}\": its scans may be deleted again\n", place.key, place.slab_id);
  return kDone;
}

}  // namespace

void add_pin(args::Command& app) {
  auto options = std::make_shared<PinOptions>();
  args::Command pinning = app.add_subcommand("pin", "Keep a slab's scans, whatever the spool's budget");
  pinning->footer(
      "\nPinned scans count against the budget. Pinning writes beside the scans, as root or slabd's user. Example: "
      "slabctl pin SLAB-0042 --reason \"complaint 17\"");
  args::Command unpinning = app.add_subcommand("unpin", "Let a slab's scans be deleted again");
  for (args::Command command : {pinning, unpinning}) {
    command
        ->add_option("SLAB", options->slab,
                     "Key or slab id (key:12, id:12 where a number may be either); of an id the newest slab")
        ->required();
    command->add_option("--config", options->config, "Configuration that names database and spool")
        ->default_val(default_config());
  }
  pinning->add_option("--reason", options->reason, "Why, for later readers")->required()->check(some_words());
  pinning->runs([options] { return pin(*options); });
  unpinning->runs([options] { return unpin(*options); });
}

}  // namespace slabd::cli
