// SPDX-License-Identifier: Apache-2.0
//
// slabd_bench_packed FILE...: packs and unpacks scan files in memory, one thread, and prints the table of
// docs/ARCHIVE.md: sizes, ratio, speeds, and whether every byte came back. Times are processor time of this process, so
// other load matters little.
#include <fmt/core.h>
#include <sys/resource.h>
#include <unistd.h>

#include <cstdio>
#include <filesystem>
#include <fstream>
#include <iterator>
#include <string>
#include <vector>

#include "hal/hal.h"
#include "hal/scan/packed.h"

namespace slabd::bench {
namespace {

double processor_s() {
  rusage used{};
  getrusage(RUSAGE_SELF, &used);
  const auto seconds = [](const timeval& t) {
    return static_cast<double>(t.tv_sec) + 1e-6 * static_cast<double>(t.tv_usec);
  };
  return seconds(used.ru_utime) + seconds(used.ru_stime);
}

hal::ByteSink into(std::string& bytes) {
  return [&bytes](std::span<const std::byte> piece) {
    bytes.append(static_cast<const char*>(static_cast<const void*>(piece.data())), piece.size());
    return success();
  };
}

struct Sum {
  std::size_t bytes = 0;
  std::size_t packed_bytes = 0;
  double pack_s = 0.0;
  double unpack_s = 0.0;
  double read_s = 0.0;
  bool same = true;
};

void print_row(const std::string& name, const Sum& sum) {
  const double megabytes = 1e-6 * static_cast<double>(sum.bytes);
  fmt::print("| {} | {} | {} | {:.2f} | {:.0f} | {:.0f} | {:.0f} | {} |\n", name, sum.bytes, sum.packed_bytes,
             static_cast<double>(sum.bytes) / static_cast<double>(sum.packed_bytes), megabytes / sum.pack_s,
             megabytes / sum.unpack_s, megabytes / sum.read_s, sum.same ? "yes" : "NO");
}

/// False: the file could not be packed or unpacked.
bool measure(const std::string& path, const std::string& archive, Sum& sum) {
  std::string packed;
  std::string restored;
  const double start_s = processor_s();
  const auto packing = hal::pack_scan(path.c_str(), into(packed));
  const double packed_s = processor_s();
  std::ofstream(archive, std::ios::binary) << packed;
  const double written_s = processor_s();
  const auto unpacking = hal::unpack_scan(archive.c_str(), into(restored));
  const double unpacked_s = processor_s();
  if (!packing || !unpacking) {
    std::fprintf(stderr, "%s\n", packing ? unpacking.error().text.c_str() : packing.error().text.c_str());
    return false;
  }
  std::vector<float> xyz(3 * limits::kScanPointsMax);
  const double read_begin_s = processor_s();
  const bool is_read = hal::read_scan(archive.c_str(), hal::LengthUnit::mm, xyz).ok();
  sum.read_s = processor_s() - read_begin_s;
  std::ifstream in(path, std::ios::binary);
  const std::string original{std::istreambuf_iterator<char>(in), {}};
  sum.bytes = original.size();
  sum.packed_bytes = packed.size();
  sum.pack_s = packed_s - start_s;
  sum.unpack_s = unpacked_s - written_s;
  sum.same = is_read && restored == original;
  return true;
}

int run(int argc, char** argv) {
  const std::string archive =
      (std::filesystem::temp_directory_path() / fmt::format("slabd-bench-{}.slabz", getpid())).string();
  fmt::print("| Scan | Bytes | Packed | Ratio | Pack MB/s | Check MB/s | Read MB/s | Same bytes |\n");
  fmt::print("|---|---|---|---|---|---|---|---|\n");
  Sum all;
  bool good = argc > 1;
  for (int i = 1; i < argc; ++i) {
    Sum one;
    if (!measure(argv[i], archive, one)) {
      good = false;
      continue;
    }
    print_row(std::filesystem::path(argv[i]).filename().string(), one);
    all.bytes += one.bytes;
    all.packed_bytes += one.packed_bytes;
    all.pack_s += one.pack_s;
    all.unpack_s += one.unpack_s;
    all.read_s += one.read_s;
    all.same = all.same && one.same;
  }
  if (all.packed_bytes > 0) print_row(fmt::format("{} scans", argc - 1), all);
  std::error_code ignored;
  std::filesystem::remove(archive, ignored);
  return good && all.same ? 0 : 1;
}

}  // namespace
}  // namespace slabd::bench

int main(int argc, char** argv) {
  return slabd::bench::run(argc, argv);
}
