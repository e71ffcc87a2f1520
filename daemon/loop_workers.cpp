// SPDX-License-Identifier: Apache-2.0
// The loop's work on the threads of storage and scanners, and the deletion of files.
#include <sys/stat.h>
#include <unistd.h>

#include <algorithm>
#include <bit>
#include <cerrno>
#include <cstring>
#include <filesystem>
#include <utility>

#include "daemon/loop.h"
#include "daemon/measure.h"
#include "storage/chain.h"

namespace slabd::daemon {
namespace {

/// Views not fetched within a week are deleted; the operator repeats a calibration that is interrupted for longer.
constexpr std::int64_t kCaptureKept_us = 7 * 86'400'000'000LL;

/// Returns an error if there is not enough memory for a text: the job fails, but the daemon continues.
template <typename Work>
auto or_failed(const Work& work) -> decltype(work()) {
  try {
    return work();
  } catch (const std::exception& e) {
    return error(Code::internal, "%s", e.what());
  }
}

/// The same for work that is retried ten times a second.
template <typename Work>
void or_later(const Work& work) {
  try {
    work();
  } catch (const std::exception&) {
  }
}

}  // namespace

StoreAnswer Loop::do_task(const StoreTask& task) {
  if (const auto* job = std::get_if<StoreJob>(&task)) return store(*job);
  if (std::holds_alternative<ChangeCalibration>(task)) {
    calibration_changer_.carry_out(store_.get());
    return ChangeCalibration{};
  }
  open_store();
  return OpenStore{};
}

void Loop::open_store() {
  recovered_ = or_failed([this]() -> Result<std::unique_ptr<RecoveredLine>> {
    Result<std::unique_ptr<storage::Store>> made = open_(scanner_is_ours_);
    if (!made.ok()) return made.error();
    store_ = std::move(made.value());
    return store_->recover();
  });
  if (!recovered_.ok()) store_ = nullptr;  // data that could not be read must not be overwritten
}

StoreDone Loop::store(const StoreJob& job) {
  StoreDone done;
  done.ticket = job.ticket;
  if (store_ == nullptr) {
    // Commands are refused in this state because of the fault; only the session number may be shown.
    done.code = std::holds_alternative<SessionJob>(job.what) ? Code::ok : Code::journal_write;
    return done;
  }
  const std::int64_t start_ns = ports_.clock.mono_ns();
  const Status status = or_failed([&] { return store_->apply(job); });
  done.commit_ms = ms_from_ns(ports_.clock.mono_ns() - start_ns);
  if (!status.ok()) {
    done.code = status.error().code;
    done.text = status.error().text;
    say({LogLine::Level::error, static_cast<std::uint16_t>(done.code), status.error().text});
  }
  if (const auto* end = std::get_if<SlabJob>(&job.what); end != nullptr && status.ok()) note_chain(end->slab_key);
  if (spool_trouble_.is_news(store_->spool_trouble()) && !spool_trouble_.seen().empty())
    say({LogLine::Level::warning, static_cast<std::uint16_t>(Code::store_full), spool_trouble_.seen()});
  return done;
}

void Loop::keep_events() {
  std::vector<storage::LineEvent> events;
  {
    const std::lock_guard lock(events_guard_);
    for (const NotedEvent& event : events_)
      events.push_back({event.kind, static_cast<std::uint16_t>(event.code),
                        std::string(event.code == Code::ok ? software_version().view() : describe(event.code)),
                        event.utime_us});
  }
  if (events.empty() || !store_->keep_events(events).ok()) return;
  const std::lock_guard lock(events_guard_);
  FixedVector<NotedEvent, kEventsMax> later;
  for (std::size_t i = events.size(); i < events_.size(); ++i) (void)later.push(events_[i]);
  events_ = later;
}

/// The journal is evidence outside of the database.
void Loop::note_chain(std::int64_t slab_key) {
  const storage::ChainHead head = storage::chain_head(*store_);
  if (head.entries == 0) return;
  LogLine line{LogLine::Level::info, static_cast<std::uint16_t>(Code::ok), {}};
  line.text.printf("slab key %lld is sealed: entry %lld of the chain of results, SHA-256 %s",
                   static_cast<long long>(slab_key), static_cast<long long>(head.entries), head.sha256.c_str());
  say(line);
}

void Loop::tell_store_trouble() {
  const std::string_view trouble = store_->trouble();
  if (store_trouble_.is_news(trouble)) {
    if (trouble.empty())
      say({LogLine::Level::info, static_cast<std::uint16_t>(Code::ok), "the database is in its place again"});
    else
      say({LogLine::Level::error, static_cast<std::uint16_t>(Code::journal_write), trouble});
  }
  if (trouble.empty()) return;
  // Posted repeatedly, because a fault that was reset must come back as long as its cause remains.
  StoreDone lost;
  lost.ticket = kNoJobTicket;
  lost.code = Code::journal_write;
  lost.text = trouble;
  (void)store_worker_->post(lost);
}

std::uint64_t fingerprint_of(std::span<const float> xyz) {
  constexpr std::size_t kLooks = 8'191;
  std::uint64_t hash = xyz.size() + 1;
  std::size_t step = xyz.size() / kLooks + 1;
  if (step % 3 == 0) ++step;  // x alone may be the same in every scan, as for parallel rays
  for (std::size_t i = 0; i < xyz.size(); i += step)
    hash = (hash ^ std::bit_cast<std::uint32_t>(xyz[i])) * 0x9E3779B97F4A7C15U ^ (hash >> 31U);
  return hash | 1U;
}

ScanDone Loop::scan(const AcquireScan& job) {
  ScanDone done;
  done.cmd_seq = job.request.cmd_seq;
  done.slot = job.slot;
  done.arm = job.arm;
  std::atomic<bool>& cancel = arms_[job.arm].cancel_scan;
  // Measuring need not wait for the disk. If this early event cannot be posted, it begins when the scan is durable.
  const std::span<float> xyz = workers_->slot(job.slot);
  const auto decoded = [this, &done, xyz](const AcquiredScan& scan) {
    done.scan = scan;
    const std::span<const float> points = xyz.first(std::min(3 * scan.shape.points, xyz.size()));
    done.fingerprint = fingerprint_of(points);
    // From here on the buffer belongs to the measurement, which changes it. Scans in records are read again below,
    // which is fast. For all others the checksum takes a twentieth of the reading time.
    if (!scan.shape.in_records) done.points_crc32c = hal::points_crc32c(points);
    (void)scan_workers_[done.arm]->post(done);
  };
  const Result<AcquiredScan> result =
      or_failed([&] { return ports_.scanner_of(job.arm).acquire(job.request, xyz, cancel, decoded); });
  done.durable = true;
  if (result.ok()) {
    done.scan = result.value();
    if (done.scan.shape.in_records && !cancel) done.points_crc32c = workers_->points_crc32c(done.scan, job.arm);
  } else {
    done.code = result.error().code;
    done.text = result.error().text;
    say_of(job.arm, {LogLine::Level::warning, static_cast<std::uint16_t>(done.code), result.error().text});
  }
  return done;
}

/// Work of the storage thread between two jobs.
void Loop::idle_store() {
  delete_one();
  or_later([this] { tidy_captures(); });
  if (store_ == nullptr) return;
  or_later([this] { keep_events(); });
  or_later([this] { store_->idle(); });
  tell_store_trouble();
}

/// Work of a scanner's thread between two scans.
void Loop::idle_scanner(std::size_t arm) {
  if (scanner_is_ours_) or_later([this, arm] { ports_.scanner_of(arm).idle(); });
}

// ---- deletion ----------------------------------------------------------------------------------------------------

/// Deletes a file later on the storage thread, when it is idle. Deleting sixty megabytes may take a slow disk long, and
/// the PLC waits for its heartbeat.
bool Loop::delete_later(const PathText& path) {
  const std::lock_guard<std::mutex> lock(to_delete_guard_);
  return to_delete_.push(path);
}

bool Loop::delete_one() {
  PathText path;
  {
    const std::lock_guard<std::mutex> lock(to_delete_guard_);
    if (to_delete_.empty()) return false;
    path = to_delete_[0];
    to_delete_.erase(0);
  }
  delete_file(path);
  return true;
}

void Loop::delete_file(const PathText& path) const {
  if (::unlink(path.c_str()) == 0 || errno == ENOENT) return;
  LogLine line{LogLine::Level::warning, 0, {}};
  line.text.printf("%s cannot be deleted: %s", path.c_str(), std::strerror(errno));
  say(line);
}

void Loop::tidy_captures_later(const PathText& folder) {
  const std::lock_guard<std::mutex> lock(to_delete_guard_);
  to_tidy_ = folder;
}

/// Deletes views that were not fetched, a few at a time; the others are deleted at the next calibration.
void Loop::tidy_captures() {
  PathText folder;
  {
    const std::lock_guard<std::mutex> lock(to_delete_guard_);
    if (to_tidy_.empty()) return;
    folder = std::exchange(to_tidy_, {});
  }
  const std::int64_t oldest_us = ports_.clock.utime_us() - kCaptureKept_us;
  std::error_code fault;  // error: the folder does not exist, so it contains no views
  for (std::filesystem::directory_iterator entry(folder.c_str(), fault), end; !fault && entry != end;
       entry.increment(fault)) {
    // The change time is the time of the move to this folder.
    struct stat there {};
    const bool scan = ::lstat(entry->path().c_str(), &there) == 0 && S_ISREG(there.st_mode);
    if (scan && there.st_ctim.tv_sec * std::int64_t{1'000'000} < oldest_us && !delete_later(entry->path().c_str()))
      return;
  }
}

}  // namespace slabd::daemon
