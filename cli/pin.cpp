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
#include <cstring>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "base/durable.h"
#include "base/plain_text.h"
#include "cli/client/calibration_change.h"
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
  std::string who;
  bool show = false;
  bool json = false;
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

/// Path of the slab's pin, and of its scans. `needs_folder`: stops if the folder of the scans is gone.
PinPlace place_of(const PinOptions& options, bool needs_folder) {
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
  if (needs_folder && !fs::is_directory(folder, ignored))
    stop(kBadInput, fmt::format("slab {} \"{}\": its scans are gone ({} is not there)", place.key, place.slab_id,
                                folder.string()));
  place.file = (folder / "pin.json").string();
  // By name, not by whole path: the path of the spool may have changed since the scan was recorded.
  for (const storage::SlabBlock& block : found.blocks)
    if (const fs::path scan(block.attempt.scan_path.view()); scan.has_filename())
      place.scans.push_back((folder / scan.filename()).string());
  return place;
}

/// Writes the pin, or removes it if `text` is empty. slabd writes it for a person who may not write next to the scans,
/// such as the user of slabd-web.
void change_pin(const PinOptions& options, const PinPlace& place, const std::string& text) {
  if (::access(fs::path(place.file).parent_path().c_str(), W_OK | X_OK) != 0) {
    const Result<ChangeAnswer> done =
        change_calibration(config_from(options.config), storage::KeepPin{place.key, text});
    if (!done.ok()) stop(done.error().code == Code::config ? kBadInput : kNotReachable, done.error());
  } else if (!text.empty()) {
    need(write_durably(place.file, text), kNotReachable);
  } else if (::unlink(place.file.c_str()) != 0) {
    stop(errno == ENOENT ? kBadInput : kNotReachable,
         errno == ENOENT ? fmt::format("slab {} \"{}\" is not pinned", place.key, place.slab_id)
                         : fmt::format("{} cannot be removed: {}", place.file, std::strerror(errno)));
  }
}

/// The pin as it is now; nullopt: none.
std::optional<nlohmann::json> pin_of(const PinPlace& place) {
  std::ifstream in(place.file, std::ios::binary);
  if (!in) return std::nullopt;
  const std::string text{std::istreambuf_iterator<char>(in), {}};
  nlohmann::json pin = nlohmann::json::parse(text, nullptr, false);
  return pin.is_object() ? pin : nlohmann::json::object();  // a file of another program counts as a pin, too
}

int show_pin(const PinOptions& options) {
  const PinPlace place = place_of(options, false);
  const std::optional<nlohmann::json> pin = pin_of(place);
  const auto word = [&](const char* key) { return pin->value(key, std::string()); };
  if (!options.json) {
    fmt::print("slab {} \"{}\": {}; {} of {} scans are there\n", place.key, plain(place.slab_id),
               pin ? "its scans are kept since " + plain(word("pinned")) + ": " + plain(word("reason")) : "not pinned",
               scans_there(place), place.scans.size());
    return kDone;
  }
  report::Json out("slabd.pin_state/1");
  out.field("key", place.key).field("slab_id", place.slab_id);
  out.field("scans", place.scans.size()).field("scans_there", scans_there(place)).key("pin");
  if (pin) {
    out.begin_object().field("reason", word("reason")).field("pinned", word("pinned"));
    out.field("user", pin->value("user", 0)).field("who", word("who")).end_object();
  } else {
    out.null();
  }
  fmt::print("{}", out.text());
  return kDone;
}

int pin(const PinOptions& options) {
  if (options.show) return show_pin(options);
  if (options.json) stop(kUsage, "--json is for --show");
  if (options.reason.empty()) stop(kUsage, "--reason is required: why the scans are kept, for later readers");
  const PinPlace place = place_of(options, true);
  report::Json json("slabd.pin/1");
  json.field("key", place.key).field("slab_id", place.slab_id).field("reason", options.reason);
  report::write_time(json, "pinned", wall_clock_us());
  json.field("user", static_cast<unsigned>(::getuid()));
  json.field("who", options.who.empty() ? default_operator() : options.who).end_object();
  change_pin(options, place, json.text());
  // Counted after writing the pin: the daemon may have been deleting scans, and stops when it finds the pin.
  const std::size_t there = scans_there(place);
  if (there == 0) {
    change_pin(options, place, "");
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
  const PinPlace place = place_of(options, true);
  change_pin(options, place, "");
  fmt::print("slab {} \"{}\": its scans may be deleted again\n", place.key, place.slab_id);
  return kDone;
}

}  // namespace

void add_pin(args::Command& app) {
  auto options = std::make_shared<PinOptions>();
  args::Command pinning = app.add_subcommand("pin", "Keep a slab's scans, whatever the spool's budget");
  pinning->footer(
      "\nPinned scans count against the budget. slabd writes the pin for a user who may not write next to the "
      "scans.\nExample: "
      "slabctl pin SLAB-0042 --reason \"complaint 17\"");
  args::Command unpinning = app.add_subcommand("unpin", "Let a slab's scans be deleted again");
  for (args::Command command : {pinning, unpinning}) {
    command
        ->add_option("SLAB", options->slab,
                     "Key or slab id (key:12, id:12 where a number may be either); of an id the newest slab")
        ->required();
    command->add_option("--config", options->config, "Configuration that names database and spool")
        ->default_val(default_config());
    command->add_option("--operator", options->who, "Name of the person (default: your login)");
  }
  pinning->add_option("--reason", options->reason, "Why, for later readers")->check(some_words());
  pinning->add_flag("--show", options->show, "Only show whether the scans are kept, and how many are there");
  pinning->add_flag("--json", options->json, "With --show: print slabd.pin_state/1 on stdout");
  pinning->runs([options] { return pin(*options); });
  unpinning->runs([options] { return unpin(*options); });
}

}  // namespace slabd::cli
