// SPDX-License-Identifier: Apache-2.0
#include "emulator/scanner_peer.h"

#include <array>
#include <atomic>
#include <charconv>
#include <chrono>
#include <cmath>
#include <mutex>
#include <optional>
#include <thread>
#include <vector>

#include "emulator/block_drawing.h"

namespace slabd::emulator {
namespace {

using namespace std::chrono_literals;

constexpr auto kWatchPeriod = 5ms;

struct Job {
  const Recipe* recipe = nullptr;
  const SlabTruth* slab = nullptr;
  const Cell* cell = nullptr;
  std::size_t arm = 0;
  std::uint64_t slab_count = 0;  ///< distinguishes the drawings of successive slabs
  int station = 0;
  int next_station = 0;
};

}  // namespace

namespace {
double seconds_since(std::chrono::steady_clock::time_point begin) {
  return std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
}
std::array<double, limits::kStationsMax + 1> no_flatness() {
  std::array<double, limits::kStationsMax + 1> none{};
  none.fill(kNoValue);
  return none;
}
}  // namespace

struct ScannerPeer::Impl {
  ScannerTraits traits;
  std::chrono::steady_clock::time_point begin = std::chrono::steady_clock::now();  ///< when the scanner was switched on
  ScannerFault fault;
  std::unique_ptr<ScanOutlet> outlet;

  mutable std::mutex mutex;  // guards job, delivered, flatness_mm, trouble
  Job job;
  std::array<double, limits::kStationsMax + 1> flatness_mm = no_flatness();
  std::uint64_t delivered = 0;
  std::string trouble;
  std::atomic<bool> off{false};

  // Used by the thread only.
  std::vector<float> xyz;
  std::vector<float> last_exposure;                             ///< mm; kept for given_again
  std::array<std::uint64_t, limits::kStationsMax + 1> scans{};  ///< number of scans drawn of each station
  std::uint64_t drawn_slab = 0;
  int drawn_station = 0;  ///< station of drawn_slab whose scan is prepared; 0: none
  // For a faulty scanner: the data from which a scan is drawn again.
  struct ScanOrder {
    Job job;
    int station = 0;
    std::uint64_t seed = 0;
  };
  std::vector<ScanOrder> recorded;  ///< for fault `loop`
  std::size_t given = 0;
  std::optional<ScanOrder> last_frame;  ///< for fault `frame_before`

  std::jthread thread;  // last member: joined before the others are destroyed

  ~Impl() {
    thread.request_stop();
    if (thread.joinable()) thread.join();
  }

  [[nodiscard]] bool is_faulty() const { return fault.frame_before || fault.one_block != 0 || fault.loop != 0; }

  void complain(const std::string& text) {
    const std::lock_guard lock(mutex);
    trouble = text;
  }

  /// Draws `station` and prepares the scan for delivery.
  bool draw(const Job& now, int station) {
    if (drawn_slab != now.slab_count) scans.fill(0);
    drawn_slab = now.slab_count;
    const auto k = static_cast<std::size_t>(station);
    if (now.slab == nullptr || station < 1 || station > now.slab->stations) {
      drawn_station = 0;
      return false;
    }
    if (station == fault.given_again && !last_exposure.empty()) return put_again(station);
    return draw(ScanOrder{now, station, derived_seed(now.slab->scan_seed, k, ++scans[k])});
  }
  bool draw(const ScanOrder& take) {
    const Job& now = take.job;
    const int station = take.station;
    const std::uint64_t seed = take.seed;
    drawn_station = 0;
    const StationTruth& truth = now.slab->at(station);
    const std::uint64_t block_seed = derived_seed(now.slab->cast_seed, static_cast<std::uint64_t>(station), 0);
    const Pose T = T_scanner_block(*now.slab, *now.cell, station, now.arm);
    const Result<DrawnBlock> block = draw_block(*now.recipe, truth, T, traits, block_seed, seed, xyz);
    if (!block) {
      complain(block.error().text.c_str());
      return false;
    }
    expand(now.slab->expansion, T.translation_mm, xyz);
    const DrawnScan& drawn = block.value().scan;
    if (block.value().concrete) {
      const std::lock_guard lock(mutex);
      flatness_mm[static_cast<std::size_t>(station)] = block.value().concrete->flatness_form_mm;
    }
    const double time_s = seconds_since(begin);
    warm(traits.warming, time_s, xyz);
    if (fault.given_again != 0) last_exposure = xyz;
    if (const Status ready = outlet->put(xyz, drawn.width, drawn.height, temperature_c(traits.warming, time_s));
        !ready) {
      complain(ready.error().text.c_str());
      return false;
    }
    drawn_station = station;
    return true;
  }

  /// Prepares the last drawn points in another form: without the grid and in reverse order.
  bool put_again(int station) {
    drawn_station = 0;
    std::vector<float> again;
    for (std::size_t i = last_exposure.size(); i >= 3; i -= 3)
      if (std::isfinite(last_exposure[i - 3]))
        again.insert(again.end(), &last_exposure[i - 3], &last_exposure[i - 3] + 3);
    if (const Status ready = outlet->put(again, 0, 0); !ready) {
      complain(ready.error().text.c_str());
      return false;
    }
    drawn_station = station;
    return true;
  }

  /// The take that a faulty scanner delivers.
  ScanOrder faulty_order(const Job& now) {
    const int station = fault.one_block != 0 ? fault.one_block : now.station;
    if (drawn_slab != now.slab_count) scans.fill(0);
    drawn_slab = now.slab_count;
    const auto k = static_cast<std::size_t>(station);
    ScanOrder take{now, station, derived_seed(now.slab->scan_seed, k, ++scans[k])};
    if (fault.frame_before) {
      const ScanOrder held = last_frame.value_or(take);
      last_frame = take;
      return held;
    }
    if (fault.loop == 0) return take;
    if (recorded.size() < static_cast<std::size_t>(fault.loop)) {
      recorded.push_back(take);
      return take;
    }
    return recorded[given++ % recorded.size()];
  }

  void answer(const std::string& name, const Job& now) {
    if (is_faulty()) {
      const bool there = now.station >= 1 && now.station <= now.slab->stations && fault.one_block <= now.slab->stations;
      drawn_station = there && draw(faulty_order(now)) ? now.station : 0;
      if (drawn_station == 0) {
        outlet->give_up(name);
        return;
      }
    }
    const bool ready = drawn_station == now.station && drawn_slab == now.slab_count;
    if (!ready && !draw(now, now.station)) {
      outlet->give_up(name);
      return;
    }
    drawn_station = 0;
    if (const Status status = outlet->deliver(name); !status) {
      complain(status.error().text.c_str());
      return;
    }
    const std::lock_guard lock(mutex);
    ++delivered;
  }

  /// "<session>-<seq>" of an unanswered request, or empty.
  std::string pending_request() {
    std::string bad;
    std::string name = outlet->pending(bad);
    if (!bad.empty()) complain(bad);
    return name;
  }

  void watch_until(const std::stop_token& stop) {
    while (!stop.stop_requested()) {
      if (off) {
        outlet.reset();
        return;
      }
      Job now;
      {
        const std::lock_guard lock(mutex);
        now = job;
      }
      if (const std::string name = pending_request(); !name.empty() && now.slab != nullptr && now.station != 0) {
        answer(name, now);
      } else if (const int ahead = wanted(now); ahead != 0) {
        draw(now, ahead);
      } else {
        std::this_thread::sleep_for(kWatchPeriod);
      }
    }
  }

  /// Station to draw in advance: the one before the scanner until its scan is delivered, then the next.
  [[nodiscard]] int wanted(const Job& now) const {
    if (now.slab == nullptr || is_faulty()) return 0;
    const int ahead = now.next_station;
    if (ahead == 0 || (drawn_station == ahead && drawn_slab == now.slab_count)) return 0;
    if (drawn_station == now.station && drawn_slab == now.slab_count) return 0;
    return ahead;
  }
};

Result<ScannerFault> parse_scanner_fault(std::string_view text) {
  ScannerFault fault;
  if (text.empty()) return fault;
  const std::size_t equals = text.find('=');
  const std::string_view name = text.substr(0, equals);
  int number = 0;
  constexpr int kStations = static_cast<int>(limits::kStationsMax);
  if (equals != std::string_view::npos) {
    const auto [rest, failed] = std::from_chars(text.data() + equals + 1, text.data() + text.size(), number);
    if (failed != std::errc{} || rest != text.data() + text.size() || number < 1 || number > 100'000) number = 0;
  }
  if (name == "frame-before" && equals == std::string_view::npos)
    fault.frame_before = true;
  else if (name == "one-block" && number >= 1 && number <= kStations)
    fault.one_block = number;
  else if (name == "given-again" && number >= 1 && number <= kStations)
    fault.given_again = number;
  else if (name == "loop" && number >= 1)
    fault.loop = number;
  else
    return error(Code::config, "--scanner-fault %.*s: frame-before, one-block=K, given-again=K (1..18) or loop=N",
                 static_cast<int>(text.size()), text.data());
  return fault;
}

ScannerPeer::ScannerPeer(std::unique_ptr<Impl> impl) : impl_(std::move(impl)) {}
ScannerPeer::~ScannerPeer() = default;

Result<std::unique_ptr<ScannerPeer>> ScannerPeer::start(const ScannerTraits& traits, std::unique_ptr<ScanOutlet> outlet,
                                                        const ScannerFault& fault) {
  auto impl = std::make_unique<Impl>();
  impl->traits = traits;
  impl->outlet = std::move(outlet);
  impl->fault = fault;
  Impl* raw = impl.get();
  impl->thread = std::jthread([raw](const std::stop_token& stop) { raw->watch_until(stop); });
  return std::unique_ptr<ScannerPeer>(new ScannerPeer(std::move(impl)));
}

void ScannerPeer::look_at(const Recipe& recipe, const SlabTruth& slab, const Cell& cell, std::size_t arm) {
  const std::lock_guard lock(impl_->mutex);
  impl_->job = {&recipe, &slab, &cell, arm, impl_->job.slab_count + 1, 0, 0};
  impl_->flatness_mm = no_flatness();
}

void ScannerPeer::stand_over(int station, int next_station) {
  const std::lock_guard lock(impl_->mutex);
  impl_->job.station = station;
  impl_->job.next_station = next_station;
}

void ScannerPeer::switch_off() {
  impl_->off = true;
}

std::uint64_t ScannerPeer::delivered() const {
  const std::lock_guard lock(impl_->mutex);
  return impl_->delivered;
}

double ScannerPeer::flatness_mm(int station) const {
  const std::lock_guard lock(impl_->mutex);
  return impl_->flatness_mm.at(static_cast<std::size_t>(station));
}

std::string ScannerPeer::trouble() const {
  const std::lock_guard lock(impl_->mutex);
  return impl_->trouble;
}

}  // namespace slabd::emulator
