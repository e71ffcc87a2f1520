// SPDX-License-Identifier: Apache-2.0
//
// Dependency rules of the source tree: the allowed includes between rooms, the public headers of each room, and that
// headers use no library other than Eigen.
#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <map>
#include <regex>
#include <set>
#include <string>
#include <vector>

#include "tests/places/places.h"

namespace {

namespace fs = std::filesystem;

const std::map<std::string, std::set<std::string>> kMayInclude = {
    {"base", {"base"}},
    {"algo", {"base", "algo"}},
    {"calib", {"base", "calib"}},
    {"hal", {"base", "hal"}},
    {"storage", {"base", "storage"}},
    {"config", {"base", "calib", "hal", "storage", "config"}},
    {"daemon", {"base", "algo", "calib", "hal", "storage", "config", "daemon"}},
    {"report", {"base", "storage", "config", "report"}},
    {"emulator", {"base", "hal", "config", "emulator"}},
    {"cli", {"base", "algo", "calib", "hal", "storage", "config", "daemon", "report", "emulator", "cli"}},
    {"gateway", {"base", "hal", "config", "gateway"}},
    {"web", {"base", "hal", "config", "report", "web"}},
    {"plant", {"base", "hal", "storage", "config", "plant"}},
    {"cad", {"base", "cad"}},
};

/// All headers of base are public.
const std::set<std::string> kPublic = {"algo/algo.h",
                                       "algo/block_model.h",
                                       "calib/calib.h",
                                       "hal/hal.h",
                                       "hal/plc/plc_map.h",
                                       "hal/robot/lcm_wire.h",
                                       "hal/scan/packed.h",
                                       "hal/scan/scan_stream.h",
                                       "hal/system/control_client.h",
                                       "hal/system/journal.h",
                                       "storage/chain.h",
                                       "storage/compare.h",
                                       "storage/history_writer.h",
                                       "storage/outbox.h",
                                       "storage/storage.h",
                                       "config/config.h",
                                       "config/designs.h",
                                       "config/recipe_keys.h",
                                       "config/web_users.h",
                                       "daemon/control/calibration_changer.h",
                                       "daemon/measure.h",
                                       "daemon/slab_ends.h",
                                       "daemon/station/pose_gate.h",
                                       "daemon/station/station_views.h",
                                       "report/budget_text.h",
                                       "report/canvas.h",
                                       "report/content.h",
                                       "report/drawing.h",
                                       "report/figures.h",
                                       "report/findings.h",
                                       "report/json.h",
                                       "report/map_json.h",
                                       "report/retell.h",
                                       "report/say.h",
                                       "report/slab_json.h",
                                       "report/slab_view.h",
                                       "report/table.h",
                                       "report/words.h",
                                       "emulator/block_drawing.h",
                                       "emulator/block_scene.h",
                                       "emulator/gauge_peer.h",
                                       "emulator/line_run.h",
                                       "emulator/plc_peer.h",
                                       "emulator/robot_error.h",
                                       "emulator/robot_peer.h",
                                       "emulator/scan_drawing.h",
                                       "emulator/scan_outlet.h",
                                       "emulator/slab_scene.h",
                                       "emulator/slab_history.h",
                                       "emulator/solid_scene.h",
                                       "emulator/stream_gateway.h",
                                       "emulator/warming.h"};

struct Include {
  fs::path file;
  int line;
  std::string name;
  bool quoted;
};

std::vector<Include> includes_of(const fs::path& file) {
  static const std::regex kPattern("^\\s*#\\s*include\\s*([<\"])([^>\"]+)[>\"]");
  std::vector<Include> found;
  std::ifstream in(file);
  std::string text;
  for (int line = 1; std::getline(in, text); ++line) {
    std::smatch match;
    if (std::regex_search(text, match, kPattern)) found.push_back({file, line, match[2], match[1] == "\""});
  }
  return found;
}

std::vector<fs::path> sources_of(const std::string& room) {
  std::vector<fs::path> files;
  for (const auto& entry : fs::recursive_directory_iterator(fs::path(slabd::places::source_dir()) / room)) {
    const std::string ext = entry.path().extension();
    if (ext == ".h" || ext == ".cpp") files.push_back(entry.path());
  }
  std::sort(files.begin(), files.end());
  return files;
}

std::string room_of(const std::string& include) {
  const std::string first = include.substr(0, include.find('/'));
  return include.find('/') != std::string::npos && kMayInclude.count(first) != 0 ? first : "";
}

std::string where(const Include& include) {
  return fs::relative(include.file, slabd::places::source_dir()).string() + ":" + std::to_string(include.line) +
         " includes " + include.name;
}

TEST(Rooms, include_only_whom_they_may) {
  for (const auto& [room, allowed] : kMayInclude) {
    const std::vector<fs::path> files = sources_of(room);
    ASSERT_FALSE(files.empty()) << room;
    for (const fs::path& file : files)
      for (const Include& include : includes_of(file)) {
        const std::string target = room_of(include.name);
        EXPECT_TRUE(target.empty() || allowed.count(target) != 0) << where(include);
      }
  }
}

TEST(Rooms, enter_another_room_by_its_public_header) {
  for (const auto& [room, allowed] : kMayInclude)
    for (const fs::path& file : sources_of(room))
      for (const Include& include : includes_of(file)) {
        const std::string target = room_of(include.name);
        if (target.empty() || target == room || target == "base") continue;
        EXPECT_TRUE(kPublic.count(include.name) != 0) << where(include);
      }
  for (const std::string& header : kPublic)
    EXPECT_TRUE(fs::exists(fs::path(slabd::places::source_dir()) / header)) << header;
}

TEST(Rooms, station_includes_only_the_vocabulary) {
  const std::vector<fs::path> files = sources_of("daemon/station");
  EXPECT_GE(files.size(), 10U);
  for (const fs::path& file : files)
    for (const Include& include : includes_of(file)) {
      const bool own = include.name.rfind("daemon/station/", 0) == 0;
      EXPECT_TRUE(!include.quoted || own || room_of(include.name) == "base") << where(include);
    }
}

TEST(Rooms, show_no_library_but_eigen_in_their_headers) {
  // Headers of the C and C++ standard libraries and of POSIX; every other <> include is from a library.
  static const std::set<std::string> kPosix = {"fcntl.h",         "netinet/in.h",  "poll.h",
                                               "pthread.h",       "sys/eventfd.h", "sys/stat.h",
                                               "sys/sysmacros.h", "sys/types.h",   "unistd.h"};
  for (const auto& [room, allowed] : kMayInclude)
    for (const fs::path& file : sources_of(room)) {
      // algo/lanes-inl.h is compiled into .cpp files once for each instruction set; it is not used as a header.
      const bool inlined = file.stem().string().ends_with("-inl");
      if (file.extension() != ".h" || inlined) continue;
      for (const Include& include : includes_of(file)) {
        if (include.quoted) {
          EXPECT_FALSE(room_of(include.name).empty()) << where(include) << ": name the room";
          continue;
        }
        const bool standard =
            include.name.find('/') == std::string::npos && include.name.find('.') == std::string::npos;
        const bool eigen = include.name.rfind("Eigen/", 0) == 0;
        EXPECT_TRUE(standard || eigen || kPosix.count(include.name) != 0) << where(include);
      }
    }
}

TEST(Rooms, have_a_namespace_of_their_name) {
  static const std::regex kNamespace("^namespace (slabd[a-z_:]*) \\{$");
  for (const auto& [room, allowed] : kMayInclude)
    for (const fs::path& file : sources_of(room)) {
      const std::string own = room == "base" ? "slabd" : "slabd::" + room;
      std::set<std::string> found;
      std::ifstream in(file);
      std::smatch match;
      for (std::string line; std::getline(in, line);)
        if (std::regex_match(line, match, kNamespace)) found.insert(match[1]);
      // The others are declarations of what another room defines.
      EXPECT_TRUE(found.empty() ||
                  std::any_of(found.begin(), found.end(),
                              [&](const std::string& name) { return name == own || name.starts_with(own + "::"); }))
          << file << " is in " << *found.begin();
    }
}

TEST(Rooms, have_a_licence_line_in_every_source) {
  for (const auto& [room, allowed] : kMayInclude)
    for (const fs::path& file : sources_of(room)) {
      std::ifstream in(file);
      std::string first;
      std::getline(in, first);
      EXPECT_EQ(first, "// SPDX-License-Identifier: Apache-2.0") << file;
    }
}

}  // namespace
