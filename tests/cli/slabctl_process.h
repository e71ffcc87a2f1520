// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <gtest/gtest.h>
#include <sys/wait.h>

#include <cstdlib>
#include <filesystem>
#include <fstream>
#include <string>

#include "tests/places/places.h"

/// Runs slabctl as a process with an exit status, in a separate folder.
namespace slabd::cli {

namespace fs = std::filesystem;

inline const std::string kRecipe = places::source_dir() + "/recipes/p5600.toml";

struct Ended {
  int status = -1;
  std::string out;
  std::string err;
};

inline std::string content(const fs::path& file) {
  std::ifstream in(file, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

class Slabctl : public ::testing::Test {
 protected:
  Slabctl() {
    std::string pattern = (fs::temp_directory_path() / "slabctl-test-XXXXXX").string();
    dir_ = mkdtemp(pattern.data());
  }
  ~Slabctl() override { fs::remove_all(dir_); }

  [[nodiscard]] std::string file(const std::string& name) const { return (dir_ / name).string(); }
  [[nodiscard]] std::string write(const std::string& name, const std::string& text) const {
    std::ofstream(file(name), std::ios::binary) << text;
    return file(name);
  }
  /// Runs `slabctl arguments` through the shell, in the C locale so that symbols are ASCII, with local
  /// times in UTC.
  [[nodiscard]] Ended run(const std::string& arguments) const {
    const std::string command =
        "LC_ALL=C TZ=UTC0 " + places::slabctl() + " " + arguments + " >" + file("out") + " 2>" + file("err");
    Ended ended;
    const int status = std::system(command.c_str());
    ended.status = WIFEXITED(status) ? WEXITSTATUS(status) : -1;
    ended.out = content(file("out"));
    ended.err = content(file("err"));
    return ended;
  }
  [[nodiscard]] Ended simulate_scan(const std::string& out, const std::string& more) const {
    return run("simulate scan --points quarter --recipe " + kRecipe + " --block 3 --out " + file(out) + " " + more);
  }

  fs::path dir_;
};

inline void expect_mentions(const std::string& text, const std::string& words) {
  EXPECT_NE(text.find(words), std::string::npos) << "expected '" << words << "' in:\n" << text;
}

}  // namespace slabd::cli
