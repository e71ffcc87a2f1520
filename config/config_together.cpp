// SPDX-License-Identifier: Apache-2.0
//
// Checks for values that are valid alone but not together. An undetected conflict appears at run time as "no such
// file", or as a folder that is emptied.
#include <fmt/format.h>
#include <sys/stat.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <deque>
#include <filesystem>
#include <future>
#include <memory>
#include <optional>
#include <thread>
#include <utility>
#include <vector>

#include "config/config_parts.h"

namespace slabd::config {
namespace {

struct Place {
  const char* table;
  const char* key;
  std::string path;
};

/// Normalised path with a slash at its end.
std::string named(const std::filesystem::path& path) {
  std::string place = path.lexically_normal().native();
  if (!place.ends_with('/')) place += '/';
  return place;
}

using FileId = std::pair<dev_t, ino_t>;

/// Resolved location of a path. Links are followed, including those to targets that do not exist yet. Folders are also
/// compared by device and inode, because a bind mount shows one folder under two names.
struct RealPlace {
  std::string path;              ///< with a slash at its end
  std::optional<FileId> itself;  ///< nullopt if it does not exist
  std::vector<FileId> above;     ///< the existing folders that contain it, and itself
};

std::optional<FileId> id_of(const std::filesystem::path& path) {
  struct stat there {};
  if (::stat(path.c_str(), &there) != 0) return std::nullopt;
  return FileId{there.st_dev, there.st_ino};
}

RealPlace look_at(const std::string& path) {
  constexpr int kLinksMax = 40;  // the kernel's limit
  std::error_code fault;
  std::deque<std::filesystem::path> left;
  for (const auto& part : std::filesystem::absolute(path, fault)) left.push_back(part);
  std::filesystem::path real = "/";
  for (int links = 0; !left.empty();) {
    const std::filesystem::path part = left.front();
    left.pop_front();
    if (part.empty() || part == "." || part == "/") continue;
    if (part == "..") {
      real = real.parent_path();
      continue;
    }
    const std::filesystem::path next = real / part;
    std::error_code no_link;
    const std::filesystem::path target = std::filesystem::read_symlink(next, no_link);
    if (no_link || ++links > kLinksMax) {
      real = next;
      continue;
    }
    if (target.is_absolute()) real = "/";
    const std::vector<std::filesystem::path> parts(target.begin(), target.end());
    left.insert(left.begin(), parts.begin(), parts.end());
  }
  RealPlace place{named(real), id_of(real), {}};
  for (std::filesystem::path folder = real; folder != "/"; folder = folder.parent_path())
    if (const auto id = id_of(folder)) place.above.push_back(*id);
  return place;
}

/// Resolves a path in a thread, because access to a share that hangs does not return. After 3 s the unresolved name is
/// used.
RealPlace real_place(const std::string& path) {
  constexpr auto kPatience = std::chrono::seconds(3);
  const auto looked = std::make_shared<std::promise<RealPlace>>();
  std::future<RealPlace> place = looked->get_future();
  std::thread([looked, path] {
    try {
      looked->set_value(look_at(path));
    } catch (const std::exception&) {
      looked->set_exception(std::current_exception());
    }
  }).detach();
  try {
    if (place.wait_for(kPatience) == std::future_status::ready) return place.get();
  } catch (const std::exception&) {
  }
  return {named(path), std::nullopt, {}};
}

}  // namespace

bool lies_in(const std::string& path, const std::string& folder) {
  if (path.empty()) return false;  // not used
  if (named(path).starts_with(named(folder))) return true;
  const RealPlace inner = real_place(path);
  const RealPlace outer = real_place(folder);
  return inner.path.starts_with(outer.path) ||
         (outer.itself && std::find(inner.above.begin(), inner.above.end(), *outer.itself) != inner.above.end());
}

namespace {

/// Path for a message, with its resolved location if that differs.
std::string told(const std::string& path) {
  const std::string real = real_place(path).path;
  if (real == named(path)) return path;
  return fmt::format("{} (really {})", path, real.substr(0, real.size() - 1));
}

/// The scanner's folder may be written by others, and slabd moves and deletes its files. Therefore slabd's own files
/// must not be in it, and it must not be in a folder that slabd treats as its own.
void check_drop_dir(TableReader& root, const Config& config, const ArmSettings& arm, TableReader& scanner) {
  if (arm.scanner_backend != hal::ScannerBackend::drop) return;
  const std::string drop_dir(arm.scanner.drop_dir.view());
  for (const Place& place :
       {Place{"storage", "db", config.storage.db_path}, Place{"storage", "spool_dir", config.storage.spool_dir},
        Place{"calibration", "sessions_dir", config.sessions_dir}, Place{"recipes", "dir", config.recipes_dir},
        Place{"design", "dir", config.designs_dir}, Place{"control", "socket", config.control_socket}})
    if (lies_in(place.path, drop_dir))
      root.table(place.table)
          .problem(place.key,
                   fmt::format("found {}, which is in the scanner's folder {} (scanner.drop_dir), where slabd moves "
                               "and deletes files that it did not request; allowed is a place outside of it",
                               told(place.path), told(drop_dir)));
  for (const Place& place : {Place{"storage", "spool_dir", config.storage.spool_dir},
                             Place{"calibration", "sessions_dir", config.sessions_dir}})
    if (lies_in(drop_dir, place.path))
      scanner.problem("drop_dir", fmt::format("found {}, which is in {} ({}.{}); allowed is a place outside of it",
                                              told(drop_dir), told(place.path), place.table, place.key));
}

/// Database and socket are files: neither may be one of the folders, contain one, or be the other.
void check_files(TableReader& root, const Config& config) {
  const Place db{"storage", "db", config.storage.db_path};
  const Place socket{"control", "socket", config.control_socket};
  std::vector<Place> places = {{"storage", "spool_dir", config.storage.spool_dir},
                               {"calibration", "sessions_dir", config.sessions_dir},
                               {"recipes", "dir", config.recipes_dir}};
  for (std::size_t i = 0; i < config.arms.list.size(); ++i)
    if (const ArmSettings& arm = config.arm(i); arm.scanner_backend == hal::ScannerBackend::drop)
      places.push_back({"scanner", "drop_dir", std::string(arm.scanner.drop_dir.view())});
  const auto hold_nothing = [&](const Place& file) {
    for (const Place& place : places)
      if (lies_in(place.path, file.path))
        root.table(file.table)
            .problem(file.key,
                     fmt::format("found {}, which is a file and cannot be or hold {} ({}.{}); allowed is another place",
                                 told(file.path), told(place.path), place.table, place.key));
  };
  hold_nothing(db);
  places.push_back(db);
  hold_nothing(socket);
  for (const char* side : {"-wal", "-shm", ".writer"})
    if (named(socket.path) == named(db.path + side) || real_place(socket.path).path == real_place(db.path + side).path)
      root.table(socket.table)
          .problem(socket.key,
                   fmt::format("found {}, which is the name of a file that belongs to storage.db; allowed is another "
                               "place",
                               socket.path));
}

/// Rejects two listeners on one port: the second one would never be able to bind.
void check_listeners(const Config& config, const ArmSettings& arm, TableReader& scanner) {
  const bool both = config.plc.role == hal::PlcRole::server && arm.scanner_backend == hal::ScannerBackend::tcp;
  if (!both || config.plc.port != arm.stream.port) return;
  const auto of_plc = hal::parse_network(config.plc.host.view());
  const auto of_scanner = hal::parse_network(arm.stream.host.view());
  if (!of_plc.ok() || !of_scanner.ok()) return;
  const auto a = of_plc.value().address;
  const auto b = of_scanner.value().address;
  if (a != b && a != 0 && b != 0) return;  // 0.0.0.0 matches every address
  scanner.problem("listen", fmt::format("found \"{}:{}\", where the PLC is listened for already (plc.listen); allowed "
                                        "is another port",
                                        arm.stream.host.view(), arm.stream.port));
}

void check_timeouts(const ArmSettings& arm, TableReader& scanner) {
  // The PLC waits 20 s for "acquired"; one second is reserved for the disk.
  const double total_s = static_cast<double>(arm.settle_timeout_ns + arm.scan_timeout_ns) / 1e9;
  if (total_s > 19.0)
    scanner.problem("timeout_s", fmt::format("with robot.settle_timeout_s a scan may take {} s, allowed are 19 s: the "
                                             "PLC gives up after 20 s",
                                             total_s));
}

}  // namespace

void check_together(TableReader& root, const Config& config, std::vector<PartTable>& scanners) {
  const auto each_scanner = [&](const auto& check) {
    for (std::size_t i = 0; i < config.arms.list.size(); ++i)
      check(config.arm(i), scanners[part_index(scanners, config.arm(i).by.scanner)].table);
  };
  each_scanner([](const ArmSettings& arm, TableReader& scanner) { check_timeouts(arm, scanner); });
  each_scanner([&](const ArmSettings& arm, TableReader& scanner) { check_drop_dir(root, config, arm, scanner); });
  check_files(root, config);
  each_scanner([&](const ArmSettings& arm, TableReader& scanner) { check_listeners(config, arm, scanner); });
}

}  // namespace slabd::config
