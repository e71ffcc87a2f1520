// SPDX-License-Identifier: Apache-2.0
#include "tests/mock/mock.h"

#include <algorithm>
#include <cmath>
#include <memory>

#include "tests/places/wait.h"

namespace slabd::hal {
namespace {

std::size_t count_finite(std::span<const float> xyz) {
  std::size_t finite = 0;
  for (std::size_t i = 0; i + 2 < xyz.size(); i += 3)
    finite += std::isfinite(xyz[i]) && std::isfinite(xyz[i + 1]) && std::isfinite(xyz[i + 2]) ? 1U : 0U;
  return finite;
}

}  // namespace

std::size_t MockPlc::poll_fds(std::span<pollfd> /*fds*/) {
  return 0;
}

bool MockPlc::next(std::int64_t /*mono_ns*/, PlcInputs& inputs) {
  if (writes.empty()) return false;
  inputs = writes.front();
  writes.pop_front();
  return true;
}

bool MockPlc::next_note(std::int64_t /*mono_ns*/, PlcNoteText& text) {
  if (notes.empty()) return false;
  text = std::string_view(notes.front());
  notes.pop_front();
  return true;
}

bool MockPose::next(std::int64_t mono_ns, PoseSample& sample) {
  if (!link_trouble.empty() || samples.empty() || samples.front().arrival_ns > mono_ns) return false;
  sample = samples.front();
  samples.pop_front();
  ++link_counters.accepted;
  return true;
}

void MockScanner::answer_with(std::vector<float> points, std::size_t width, std::size_t height) {
  // std::function requires a copyable callable, so the scan is shared.
  const auto kept = std::make_shared<const std::vector<float>>(std::move(points));
  script_.push_back([kept, width, height](std::span<float> xyz, const std::atomic<bool>&) -> Result<ScanShape> {
    if (kept->size() > xyz.size())
      return error(Code::frame_incomplete, "mock scan of %zu points, allowed are at most %zu", kept->size() / 3,
                   xyz.size() / 3);
    std::copy(kept->begin(), kept->end(), xyz.begin());
    return ScanShape{kept->size() / 3, count_finite(*kept), width, height};
  });
}

void MockScanner::answer_with_file(std::string path, LengthUnit unit) {
  script_.push_back([path = std::move(path), unit](std::span<float> xyz, const std::atomic<bool>&) {
    return read_scan(path.c_str(), unit, xyz);
  });
}

void MockScanner::fail_with(Code code) {
  script_.push_back([code](std::span<float>, const std::atomic<bool>&) -> Result<ScanShape> {
    return error(code, "mock scanner: scripted failure");
  });
}

void MockScanner::hang_until_cancelled() {
  script_.push_back([](std::span<float>, const std::atomic<bool>& cancel) -> Result<ScanShape> {
    if (!places::wait_until([&] { return cancel.load(); }))
      return error(Code::trigger_timeout, "mock scanner: not cancelled in 30 s");
    return error(Code::interrupted, "mock scanner: cancelled");
  });
}

Result<AcquiredScan> MockScanner::acquire(const ScanRequest& request, std::span<float> xyz,
                                          const std::atomic<bool>& cancel, const ScanDecoded& decoded) {
  requests.push_back(request);
  if (script_.empty()) return error(Code::trigger_timeout, "mock scanner: nothing left in the script");
  const Step step = std::move(script_.front());
  script_.pop_front();
  const Result<ScanShape> shape = step(xyz, cancel);
  if (!shape) return shape.error();
  if (shape.value().finite < request.points_min)
    return error(Code::too_few_points, "mock scan: %zu points are there, needed are %zu", shape.value().finite,
                 request.points_min);
  AcquiredScan scan;
  scan.shape = shape.value();
  scan.taken_mono_ns = clock_.mono_ns();
  scan.taken_utime_us = clock_.utime_us();
  scan.path = request.spool_path;
  if (!request.spool_path.empty()) scan.path.append(".ply");
  if (!request.spool_path.empty()) {
    const std::span<const float> points(xyz.data(), 3 * scan.shape.points);
    if (Status status = write_ply(scan.path.c_str(), points, scan.shape.width, scan.shape.height); !status)
      return status.error();
  }
  decoded(scan);  // after this call the buffer belongs to the receiver
  return scan;
}

}  // namespace slabd::hal
