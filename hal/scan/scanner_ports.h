// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <algorithm>
#include <atomic>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <mutex>
#include <string_view>

#include "base/base.h"
#include "base/jobs.h"
#include "base/plain_text.h"
#include "base/rate_limit.h"
#include "hal/hal.h"

/// Parts shared by both scanner ports: detection of a blocked scan thread, its log lines, and the JSON of requests and
/// answers.
namespace slabd::hal {

/// Detects that a thread has been blocked in the operating system for too long. On a network share any call may block
/// as long as the server does, and then only another thread can report it.
class HangWatch {
 public:
  enum class Place : std::uint8_t {
    drop_folder,
    spool,    ///< on this computer's own disk, also for files moved there
    copying,  ///< from a share to the spool; it is unknown which of the two blocks
  };
  struct Hang {
    std::int64_t ns = 0;  ///< blocked for this long; 0: not blocked
    Place place = Place::drop_folder;
  };

  /// Limit for looking at folders, which takes microseconds on a local disk and some tens of ms on a share.
  static constexpr std::int64_t kLook_ns = 3 * kNsPerS;
  /// Limit for reading 60 MB, or storing them: 2 s on a share at full 1 Gbit/s, and a disk may be slow too.
  static constexpr std::int64_t kTake_ns = 10 * kNsPerS;
  /// Least time left for storing after a reading that took nearly all of kTake_ns.
  static constexpr std::int64_t kStoreMin_ns = 2 * kNsPerS;

  explicit HangWatch(const Clock& clock) : clock_(clock) {}

  /// From now on calls may block; they count as hanging after `patience_ns` without another call of enter() or leave().
  void enter(std::int64_t patience_ns, Place place = Place::drop_folder) {
    const std::int64_t now_ns = clock_.mono_ns();
    until_ns_.store(kOutside, std::memory_order_release);
    place_.store(place, std::memory_order_release);
    since_ns_.store(now_ns, std::memory_order_release);
    until_ns_.store(now_ns + patience_ns, std::memory_order_release);
  }
  void leave() { until_ns_.store(kOutside, std::memory_order_release); }

  /// Returns how long the thread has been blocked, once that is too long, and the place. Any thread.
  [[nodiscard]] Hang hang() const {
    // Only until_ns_ decides: start, place and patience read one after the other may be of two calls.
    const std::int64_t until_ns = until_ns_.load(std::memory_order_acquire);
    const std::int64_t now_ns = clock_.mono_ns();
    const Hang found = {now_ns - since_ns_.load(std::memory_order_acquire), place_.load(std::memory_order_acquire)};
    if (now_ns < until_ns || until_ns_.load(std::memory_order_acquire) != until_ns) return {};
    return {std::max<std::int64_t>(1, found.ns), found.place};
  }

 private:
  static constexpr std::int64_t kOutside = std::numeric_limits<std::int64_t>::max();
  const Clock& clock_;
  std::atomic<std::int64_t> since_ns_ = 0;
  std::atomic<Place> place_ = Place::drop_folder;
  std::atomic<std::int64_t> until_ns_ = kOutside;
};

[[nodiscard]] inline ScannerText spool_hang_text(const HangWatch::Hang& hang) {
  ScannerText text;
  text.printf("the spool has been storing a scan for %lld s; look at the disk of storage.spool_dir",
              static_cast<long long>(hang.ns / kNsPerS));
  return text;
}

/// Log lines that one thread adds and another one writes: at once while they are few, then one a second. Lines beyond
/// the capacity are reported as one line with their number. No heap.
class DropNotes {
 public:
  explicit DropNotes(const Clock& clock) : clock_(clock) {}

  void add(const ScannerText& line) {
    const std::lock_guard lock(mutex_);
    if (!lines_.push(line)) ++untold_;
  }
  /// Adds a line that summarises many files. It comes before the lines on single files and replaces an older such line.
  void add_first(const ScannerText& line) {
    const std::lock_guard lock(mutex_);
    first_ = line;
  }
  [[nodiscard]] bool next(ScannerText& line) {
    const std::lock_guard lock(mutex_);
    if (first_.empty() && lines_.empty() && untold_ == 0) return false;
    if (!limit_.permits(clock_.mono_ns())) return false;
    if (!first_.empty()) {
      line = first_;
      first_.clear();
    } else if (!lines_.empty()) {
      line = lines_.front();
      lines_.pop();
    } else {
      line.printf("%llu more files were moved to stray/ or deleted there", static_cast<unsigned long long>(untold_));
      untold_ = 0;
    }
    return true;
  }

 private:
  const Clock& clock_;
  std::mutex mutex_;
  ScannerText first_;
  FixedQueue<ScannerText, 64> lines_;
  std::uint64_t untold_ = 0;
  RateLimit limit_{kNsPerS, 30};
};

/// Appends text inside the quotes of a JSON string, as much as leaves room for `tail_bytes` after it. All but plain
/// ASCII is escaped, so the encoding that a gateway assumes does not matter. A byte that is not UTF-8 becomes the
/// character of that number.
template <std::size_t Capacity>
void append_json_text(FixedString<Capacity>& json, std::string_view text, std::size_t tail_bytes) {
  while (!text.empty()) {
    const CodePoint c = code_point_at(text);
    FixedString<12> escaped;
    if (c.value > 0xFFFF)
      escaped.printf("\\u%04x\\u%04x", static_cast<unsigned>(0xD7C0 + (c.value >> 10U)),
                     static_cast<unsigned>(0xDC00 + (c.value & 0x3FFU)));
    else if (c.value < 0x20 || c.value > 0x7E || c.value == '"' || c.value == '\\')
      escaped.printf("\\u%04x", static_cast<unsigned>(c.value));
    else
      escaped.append(text.substr(0, 1));
    if (json.size() + escaped.size() + tail_bytes > Capacity) return;
    json.append(escaped.view());
    text.remove_prefix(c.bytes);
  }
}

/// slabd.scan_request/1 as one line; `more` are further members, each with a comma before it.
[[nodiscard]] inline FixedString<640> scan_request_json(const ScanRequest& request, std::string_view more = {}) {
  FixedString<640> json;
  json.printf(R"({"schema": "slabd.scan_request/1", "session": %u, "cmd_seq": %u, "slab_id": ")",
              unsigned{request.session}, unsigned{request.cmd_seq});
  FixedString<240> rest;
  rest.printf("\", \"station\": %u", unsigned{request.station});
  if (!request.by.scanner.empty()) {
    FixedString<80> by;
    by.printf(R"(, "scanner": "%s", "robot": "%s")", request.by.scanner.c_str(), request.by.robot.c_str());
    rest.append(by.view());
  }
  rest.append(more);
  rest.append("}\n");
  append_json_text(json, request.slab_id.view(), rest.size());
  json.append(rest.view());
  return json;
}

/// slabd.scan_answer/1 as one line: the result of that request's scan; `why` is null if it was accepted.
[[nodiscard]] inline FixedString<640> scan_answer_json(std::uint16_t session, std::uint16_t cmd_seq, const Error* why,
                                                       std::size_t points) {
  FixedString<640> line;
  line.printf(R"({"schema": "slabd.scan_answer/1", "session": %u, "cmd_seq": %u, "ok": %s, "points": %zu)",
              unsigned{session}, unsigned{cmd_seq}, why == nullptr ? "true" : "false", points);
  constexpr std::string_view kEnd = "}\n";
  if (why != nullptr) {
    FixedString<48> code;
    code.printf(R"(, "code": %d, "error": ")", static_cast<int>(why->code));
    line.append(code.view());
    append_json_text(line, why->text.view(), 1 + kEnd.size());
    line.append("\"");
  }
  line.append(kEnd);
  return line;
}

}  // namespace slabd::hal
