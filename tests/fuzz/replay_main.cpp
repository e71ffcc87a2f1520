// SPDX-License-Identifier: Apache-2.0
//
// Runs a target over files and folders of inputs without libFuzzer: each input and its halves, because truncated
// inputs are the most common ones.
#include <algorithm>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <vector>

#include "tests/fuzz/fuzz.h"

int main(int argc, char** argv) {
  namespace fs = std::filesystem;
  std::vector<fs::path> files;
  for (int i = 1; i < argc; ++i) {
    if (fs::is_directory(argv[i])) {
      for (const auto& entry : fs::recursive_directory_iterator(argv[i]))
        if (entry.is_regular_file()) files.push_back(entry.path());
    } else {
      files.emplace_back(argv[i]);
    }
  }
  std::sort(files.begin(), files.end());
  for (const fs::path& file : files) {
    std::ifstream in(file, std::ios::binary);
    const std::vector<char> bytes{std::istreambuf_iterator<char>(in), {}};
    const auto* data = static_cast<const std::uint8_t*>(static_cast<const void*>(bytes.data()));
    for (const std::size_t size : {bytes.size(), bytes.size() / 2, bytes.size() - bytes.size() / 16})
      static_cast<void>(LLVMFuzzerTestOneInput(data, size));
  }
  std::printf("%zu inputs\n", files.size());
  return files.empty() ? 1 : 0;
}
