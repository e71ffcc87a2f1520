// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <string>
#include <vector>

#include "config/config.h"

namespace slabd::config {

/// Text files in a new folder. Problems are returned without the folder's name, so that whole messages can be compared.
class TextFiles {
 public:
  TextFiles() {
    std::string name = (std::filesystem::temp_directory_path() / "slabd-text-XXXXXX").string();
    EXPECT_NE(mkdtemp(name.data()), nullptr);
    folder_ = name;
  }
  ~TextFiles() {
    std::error_code ec;
    std::filesystem::remove_all(folder_, ec);
  }
  TextFiles(const TextFiles&) = delete;
  TextFiles& operator=(const TextFiles&) = delete;

  std::string write(const std::string& name, const std::string& text) const {
    const std::string path = folder_ + "/" + name;
    std::ofstream(path) << text;
    return path;
  }
  [[nodiscard]] std::vector<std::string> texts(const std::vector<config::Problem>& problems) const {
    std::vector<std::string> list;
    for (const config::Problem& problem : problems) {
      std::string text = problem.text;
      for (std::size_t at = text.find(folder_ + "/"); at != std::string::npos; at = text.find(folder_ + "/"))
        text.erase(at, folder_.size() + 1);
      list.push_back(text);
    }
    return list;
  }
  [[nodiscard]] const std::string& folder() const { return folder_; }

 private:
  std::string folder_;
};

[[nodiscard]] inline std::string read_whole(const std::string& path) {
  std::ifstream file(path);
  std::ostringstream text;
  text << file.rdbuf();
  return text.str();
}

/// Returns `text` with its only occurrence of `from` replaced.
[[nodiscard]] inline std::string with(std::string text, const std::string& from, const std::string& to) {
  const std::size_t at = text.find(from);
  EXPECT_NE(at, std::string::npos) << from;
  if (at == std::string::npos) return text;
  EXPECT_EQ(text.find(from, at + 1), std::string::npos) << from << " occurs twice";
  return text.replace(at, from.size(), to);
}

}  // namespace slabd::config
