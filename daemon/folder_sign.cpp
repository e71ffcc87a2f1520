// SPDX-License-Identifier: Apache-2.0
#include "daemon/folder_sign.h"

#include <fmt/format.h>
#include <sys/stat.h>

#include <algorithm>
#include <filesystem>
#include <vector>

namespace slabd::daemon {

namespace fs = std::filesystem;

std::string folder_sign(const std::string& dir) {
  std::vector<std::string> signs;
  std::error_code fault;
  for (fs::directory_iterator entry(dir, fault), end; !fault && entry != end; entry.increment(fault)) {
    struct stat there {};
    if (::stat(entry->path().c_str(), &there) != 0) continue;
    signs.push_back(fmt::format("{} {} {} {}.{} {}.{}\n", entry->path().native(), there.st_ino, there.st_size,
                                there.st_mtim.tv_sec, there.st_mtim.tv_nsec, there.st_ctim.tv_sec,
                                there.st_ctim.tv_nsec));
  }
  std::sort(signs.begin(), signs.end());
  return fault ? "unreadable: " + fault.message() : fmt::format("{}", fmt::join(signs, ""));
}

}  // namespace slabd::daemon
