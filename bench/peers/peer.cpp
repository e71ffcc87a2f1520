// SPDX-License-Identifier: Apache-2.0
#include "bench/peers/peer.h"

#include <dlfcn.h>

#include <Eigen/Eigenvalues>
#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <fstream>
#include <iostream>
#include <nlohmann/json.hpp>

namespace slabd::bench {
namespace {

using HeapCalls = std::uint64_t (*)();
/// The preloaded counter, or nullptr.
HeapCalls heap_counter() {
  static const auto counter = reinterpret_cast<HeapCalls>(dlsym(RTLD_DEFAULT, "slabd_bench_heap_calls"));
  return counter;
}

double peak_rss_mb() {
  std::ifstream status("/proc/self/status");
  for (std::string line; std::getline(status, line);)
    if (line.rfind("VmHWM:", 0) == 0)
      return 1024e-6 * std::strtod(line.c_str() + 6, nullptr);  // the kB of VmHWM are KiB
  return -1.0;
}

[[noreturn]] void give_up(const std::string& why) {
  std::cerr << "bench: " << why << "\n";
  std::exit(2);
}

template <class Number>
std::vector<Number> read_numbers(const std::string& path) {
  std::ifstream in(path, std::ios::binary | std::ios::ate);
  if (!in) give_up("cannot read " + path);
  std::vector<Number> numbers(static_cast<std::size_t>(in.tellg()) / sizeof(Number));
  in.seekg(0);
  in.read(reinterpret_cast<char*>(numbers.data()), static_cast<std::streamsize>(numbers.size() * sizeof(Number)));
  if (!in) give_up("cannot read " + path);
  return numbers;
}

constexpr double kMdegPerRad = 180e3 / 3.14159265358979323846;

}  // namespace

Peer::Peer(int argc, char** argv, std::string name, std::string version)
    : name_(std::move(name)), version_(std::move(version)) {
  for (int i = 1; i + 1 < argc; i += 2) {
    const std::string option = argv[i];
    if (option == "--folder")
      folder_ = argv[i + 1];
    else if (option == "--job")
      job_ = argv[i + 1];
    else if (option == "--repeats")
      repeats_ = std::max(1, std::atoi(argv[i + 1]));
    else if (option == "--threads")
      threads_ = std::max(1, std::atoi(argv[i + 1]));
    else
      give_up("unknown option " + option);
  }
  if (folder_.empty() || job_.empty())
    give_up("usage: " + name_ + " --folder F --job J [--repeats N] [--threads N]; script/bench calls it");
  const std::vector<double> truth = read_numbers<double>(path("truth.f64"));
  if (truth.size() != 35) give_up("truth.f64 has not 35 numbers");
  std::copy_n(truth.begin(), 16, truth_.T_block_scanner.begin());
  std::copy_n(truth.begin() + 16, 16, truth_.T_block_scanner_start.begin());
  std::copy_n(truth.begin() + 32, 3, truth_.seat_normal_block.begin());
}

std::vector<float> Peer::floats(const std::string& file) const {
  return read_numbers<float>(path(file));
}
std::vector<std::uint8_t> Peer::labels() const {
  return read_numbers<std::uint8_t>(path("labels.u8"));
}

void Peer::begin() {
  // The memory for the bookkeeping is allocated here, so that it is not counted. The stages' short names need no heap
  // memory.
  constexpr std::size_t kStagesMax = 16;
  runs_.emplace_back();
  runs_.back().stages.reserve(kStagesMax);
  heap_calls_ = heap_counter() != nullptr ? heap_counter()() : 0;
  watch_.restart();
}

void Peer::lap(const std::string& stage) {
  runs_.back().stages.emplace_back(stage, watch_.lap(threads_));
}

void Peer::end() {
  Repeat& run = runs_.back();
  run.total = watch_.total(threads_);
  if (heap_counter() != nullptr) run.allocations = static_cast<double>(heap_counter()() - heap_calls_);
}

void Peer::score_pose(const Rigid& T_block_scanner) {
  const Rigid off = product(T_block_scanner, inverse(truth_.T_block_scanner));
  figure("pose_error_um", 1e3 * std::hypot(off[3], off[7], off[11]));
  const double sine = 0.5 * std::hypot(off[9] - off[6], off[2] - off[8], off[4] - off[1]);
  figure("turn_error_mdeg", kMdegPerRad * std::atan2(sine, 0.5 * (off[0] + off[5] + off[10] - 1.0)));
}

void Peer::score_normal(const Direction& n) {
  const Direction t = rotated(inverse(truth_.T_block_scanner), truth_.seat_normal_block);
  const double sine = std::hypot(n[1] * t[2] - n[2] * t[1], n[2] * t[0] - n[0] * t[2], n[0] * t[1] - n[1] * t[0]);
  figure("normal_error_mdeg", kMdegPerRad * std::atan2(sine, std::abs(n[0] * t[0] + n[1] * t[1] + n[2] * t[2])));
}

void Peer::score_denoising(const std::vector<bool>& kept) {
  const std::vector<std::uint8_t> outlier = labels();
  if (outlier.size() != kept.size()) give_up("labels.u8 does not belong to this scan");
  double left = 0.0, lost = 0.0;
  for (std::size_t i = 0; i < kept.size(); ++i) {
    if (outlier[i] != 0 && kept[i]) left += 1.0;
    if (outlier[i] == 0 && !kept[i]) lost += 1.0;
  }
  figure("outliers_left", left);
  figure("surface_lost", lost);
}

void Peer::figure(const std::string& name, double value) {
  for (auto& [known, old] : figures_)
    if (known == name) {
      if (!std::isnan(old) && !(old > value)) old = value;
      return;
    }
  figures_.emplace_back(name, value);
}

int Peer::print() const {
  using Json = nlohmann::ordered_json;
  Json json;
  json["peer"] = name_;
  json["version"] = version_;
  json["job"] = job_;
  json["threads"] = threads_;
  for (const Repeat& run : runs_) {
    const auto sample = [](const Sample& of) {
      return Json{{"wall_ms", of.wall_ms}, {"cpu_ms", of.cpu_ms}, {"disturbed", of.disturbed}};
    };
    Json one;
    one["total"] = sample(run.total);
    for (const auto& [stage, lap] : run.stages) one["stages"][stage] = sample(lap);
    if (run.allocations >= 0.0) one["allocations"] = run.allocations;
    json["runs"].push_back(one);
  }
  for (const auto& [name, value] : figures_) json["figures"][name] = value;
  json["peak_rss_mb"] = peak_rss_mb();
  std::cout << json.dump() << std::endl;
  return runs_.empty() ? 1 : 0;
}

Rigid product(const Rigid& a, const Rigid& b) {
  Rigid c{};
  for (std::size_t row = 0; row < 4; ++row)
    for (std::size_t column = 0; column < 4; ++column)
      for (std::size_t k = 0; k < 4; ++k) c[4 * row + column] += a[4 * row + k] * b[4 * k + column];
  return c;
}

Rigid inverse(const Rigid& T) {
  Rigid back{};
  for (std::size_t row = 0; row < 3; ++row) {
    for (std::size_t column = 0; column < 3; ++column) {
      back[4 * row + column] = T[4 * column + row];
      back[4 * row + 3] -= T[4 * column + row] * T[4 * column + 3];
    }
  }
  back[15] = 1.0;
  return back;
}

Direction rotated(const Rigid& T, const Direction& v) {
  Direction out{};
  for (std::size_t row = 0; row < 3; ++row)
    out[row] = T[4 * row] * v[0] + T[4 * row + 1] * v[1] + T[4 * row + 2] * v[2];
  return out;
}

template <class Number>
void refit_plane(const Number* xyz, std::size_t points, std::size_t stride, double reach_mm, PlaneAnswer& plane) {
  constexpr int kStepsMax = 3;
  for (int step = 0; step < kStepsMax; ++step) {
    const Direction n = plane.normal;
    // Sums are relative to the first point: the scanner is 600 mm away, and squares of that would lose digits.
    const double ox = static_cast<double>(xyz[0]), oy = static_cast<double>(xyz[1]), oz = static_cast<double>(xyz[2]);
    const double d = plane.offset_mm - (n[0] * ox + n[1] * oy + n[2] * oz);
    std::size_t count = 0;
    double sx = 0, sy = 0, sz = 0, xx = 0, xy = 0, xz = 0, yy = 0, yz = 0, zz = 0;
    for (std::size_t i = 0; i < points; ++i) {
      const Number* p = xyz + i * stride;
      const double x = static_cast<double>(p[0]) - ox, y = static_cast<double>(p[1]) - oy,
                   z = static_cast<double>(p[2]) - oz;
      if (std::abs(n[0] * x + n[1] * y + n[2] * z - d) > reach_mm) continue;
      ++count;
      sx += x, sy += y, sz += z;
      xx += x * x, xy += x * y, xz += x * z, yy += y * y, yz += y * z, zz += z * z;
    }
    const double w = 1.0 / static_cast<double>(std::max<std::size_t>(count, 1));
    const Eigen::Vector3d c(sx * w, sy * w, sz * w);
    Eigen::Matrix3d scatter;
    scatter << xx * w, xy * w, xz * w, xy * w, yy * w, yz * w, xz * w, yz * w, zz * w;
    scatter -= c * c.transpose();
    const Eigen::Vector3d normal = Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>(scatter).eigenvectors().col(0);
    plane.normal = {normal.x(), normal.y(), normal.z()};
    plane.offset_mm = normal.dot(c + Eigen::Vector3d(ox, oy, oz));
    const bool still = count == plane.inliers;
    plane.inliers = count;
    if (still) break;
  }
}

template <class Number>
void spread_about(const Number* xyz, std::size_t points, std::size_t stride, double reach_mm, PlaneAnswer& plane) {
  double sum2 = 0.0, low = 0.0, high = 0.0;
  std::size_t count = 0;
  for (std::size_t i = 0; i < points; ++i) {
    const Number* p = xyz + i * stride;
    const double r = plane.normal[0] * static_cast<double>(p[0]) + plane.normal[1] * static_cast<double>(p[1]) +
                     plane.normal[2] * static_cast<double>(p[2]) - plane.offset_mm;
    if (std::abs(r) > reach_mm) continue;
    ++count;
    sum2 += r * r;
    low = std::min(low, r);
    high = std::max(high, r);
  }
  plane.std_mm = std::sqrt(sum2 / static_cast<double>(std::max<std::size_t>(count, 1)));
  plane.peak_to_valley_mm = high - low;
}

template void refit_plane<float>(const float*, std::size_t, std::size_t, double, PlaneAnswer&);
template void refit_plane<double>(const double*, std::size_t, std::size_t, double, PlaneAnswer&);
template void spread_about<float>(const float*, std::size_t, std::size_t, double, PlaneAnswer&);
template void spread_about<double>(const double*, std::size_t, std::size_t, double, PlaneAnswer&);

}  // namespace slabd::bench
