// SPDX-License-Identifier: Apache-2.0
#include <fcntl.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <cerrno>
#include <functional>
#include <mutex>
#include <optional>

#include "base/os.h"
#include "hal/hal.h"
#include "hal/scan/drop_folders.h"
#include "hal/scan/scan_file.h"
#include "hal/scan/scanner_ports.h"
#include "hal/scan/text_lines.h"
#include "hal/system/spool.h"

// Problem: all scans look alike, and a scan assigned to another station would pass an unmeasured slab. Idea: a scan
// counts only if it names the request it answers (`<session>-<seq>.<ext>`). For software that cannot do that, it must
// be the only file that appeared after the request. Invariants:
//   - a file that was in the inbox before the request is never its answer;
//   - the spool file equals the decoded file byte for byte;
//   - without names, the late answer to an earlier request is awaited and set aside before the next request. A request
//     counts as answered only if a scan was read, not if another file appeared, the folder failed or slabd stopped;
//   - a file that has its final length before its content is awaited like one that grows;
//   - after acquire() neither the request nor an answer remains, good or bad, so that a repeat can be dropped.
//
// The folder may be on a network share, whose kernel shows files as they were some seconds ago, and on which any call
// may hang as long as the server does. So only the scanner's thread accesses it (not even the constructor does). That
// thread marks its stay there (HangWatch), and the present state of a file is requested from the server (FileState).
namespace slabd::hal {
namespace {

constexpr std::int64_t kPoll_ns = 20 * kNsPerMs;
/// ... of an inbox with more entries than are watched, and time for moving and deleting such files in one look.
constexpr std::int64_t kCrowdedPoll_ns = 100 * kNsPerMs;
constexpr std::int64_t kCrowd_ns = 10 * kNsPerMs;
/// A file is finished if it has not changed for this time, unless its header proves that it is complete ...
constexpr std::int64_t kFinished_ns = 500 * kNsPerMs;
/// ... and then as soon as two looks this far apart are equal: a file's time has steps of up to 10 ms (the kernel's
/// ticks), so a write within the step of the first look would not change it.
constexpr std::int64_t kTimeStep_ns = 20 * kNsPerMs;
/// ... on a share, where the writing computer sends its data in pieces with pauses.
constexpr std::int64_t kFinishedOnShare_ns = 2 * kNsPerS;
/// ... and a stray if its name is still not an answer after this time.
constexpr std::int64_t kStray_ns = 5 * kNsPerS;

/// The same for a file that is certainly not finished: it has 0 bytes, fewer than its header states, or unwritten
/// parts, which are read as zeros.
constexpr std::int64_t kFilled_ns = 5 * kNsPerS;

void wait_for_next_look(std::int64_t pause_ns) {
  const timespec pause{0, pause_ns};
  nanosleep(&pause, nullptr);
}

/// `<digits>-<digits>`: the form of a request's name.
bool is_request_stem(std::string_view stem) {
  const std::size_t dash = stem.find('-');
  const auto digits = [](std::string_view text) {
    return !text.empty() && std::all_of(text.begin(), text.end(), [](char c) { return c >= '0' && c <= '9'; });
  };
  return dash != std::string_view::npos && digits(stem.substr(0, dash)) && digits(stem.substr(dash + 1));
}

/// Extensions of finished scans. All are answers, also those that the reader then rejects by name; a file with any
/// other extension (7-3.part, 7-3.tmp) may still be written.
bool is_scan_extension(std::string_view extension) {
  constexpr std::array<std::string_view, 6> kNotRead = {"e57", "stl", "obj", "las", "laz", "pts"};
  return scan_family(extension) ||
         std::find(kNotRead.begin(), kNotRead.end(), lower_case(extension).view()) != kNotRead.end();
}

/// The part of a finished scan's name before its extension; empty for every other name.
std::string_view stem_of(std::string_view name) {
  const std::string_view extension = extension_of(name);
  if (!is_scan_extension(extension)) return {};
  return name.substr(0, name.size() - extension.size() - 1);
}

/// A finished answer, and the time at which it was first seen in that state.
struct Answer {
  InboxEntry entry;
  std::int64_t seen_ns = 0;
  bool accounted = false;  ///< its own header proves that it is complete, even if it changed since it was listed
};

class ScanDrop final : public ScannerPort {
 public:
  ScanDrop(const ScanDropSettings& settings, const Clock& clock)
      : settings_(settings),
        clock_(clock),
        readers_(settings.read_threads),
        folders_(settings.drop_dir, settings.owner),
        hang_(clock),
        notes_(clock) {}

  Result<AcquiredScan> acquire(const ScanRequest& request, std::span<float> xyz, const std::atomic<bool>& cancel,
                               const ScanDecoded& decoded) override {
    hang_.enter(HangWatch::kLook_ns);
    Result<AcquiredScan> scan = ask(request, xyz, cancel, decoded);
    hang_.leave();
    return scan;
  }

  void idle() override {
    hang_.enter(HangWatch::kLook_ns);
    if (open_folders()) static_cast<void>(tidy({}));
    hang_.leave();
  }

  bool online() const override { return online_ && !hangs(); }
  std::uint64_t stray_files() const override { return strays_; }
  bool hangs() const override { return hang_.hang().ns != 0; }
  bool spool_hangs() const override {
    const HangWatch::Hang hang = hang_.hang();
    return hang.ns != 0 && hang.place == HangWatch::Place::spool;
  }
  ScannerText used_by_another() const override {
    const std::lock_guard lock(why_mutex_);
    return used_by_another_;
  }
  Deleted deleted() const override { return {deleted_files_, deleted_bytes_}; }
  bool next_note(ScannerText& text) override { return notes_.next(text); }

  ScannerText trouble() const override {
    ScannerText text;
    if (const HangWatch::Hang hang = hang_.hang(); hang.ns != 0) {
      const auto seconds = static_cast<long long>(hang.ns / kNsPerS);
      switch (hang.place) {
        case HangWatch::Place::drop_folder:
          text.printf("%s has not answered for %lld s; if it is a network share, look at its server and mount options",
                      settings_.drop_dir.c_str(), seconds);
          break;
        case HangWatch::Place::spool: return spool_hang_text(hang);
        case HangWatch::Place::copying:
          text.printf(
              "a scan has been on its way from %s to the spool for %lld s; look at the share's server and at "
              "the disk of storage.spool_dir",
              settings_.drop_dir.c_str(), seconds);
          break;
      }
    } else if (!online_) {
      const std::lock_guard lock(why_mutex_);
      text = why_offline_;
    }
    return text;
  }

 private:
  Result<AcquiredScan> ask(const ScanRequest& request, std::span<float> xyz, const std::atomic<bool>& cancel,
                           const ScanDecoded& decoded) {
    if (Status status = open_folders(); !status) return status.error();
    const std::int64_t begin_ns = clock_.mono_ns();
    if (settings_.any_name) {
      // At most half of the time: a scan that is requested too late would be given up too.
      if (asked_before_) answer_may_come_until_ns_ = begun_ns_ + late_answer_ns(request);
      asked_before_ = false;
      if (Status status = outwait_late_answer(begin_ns + request.timeout_ns / 2, xyz, cancel); !status)
        return status.error();
    }
    const std::int64_t timeout_ns = request.timeout_ns - (clock_.mono_ns() - begin_ns);
    NameText stem;
    stem.printf("%u-%u", unsigned{request.session}, unsigned{request.cmd_seq});
    if (Status status = clear_inbox(stem.view()); !status) return status.error();

    NameText request_name(stem.view());
    request_name.append(".json");
    if (Status status = folders_.post_request(request_name.c_str(), scan_request_json(request).view()); !status)
      return status.error();
    const std::int64_t deadline_ns = clock_.mono_ns() + timeout_ns;
    Result<AcquiredScan> scan = wait_and_take(stem.view(), request, deadline_ns, xyz, cancel, decoded);
    if (scan || !settings_.any_name) {
      folders_.withdraw_request(request_name.c_str());
    } else {
      folders_.leave_unanswered(request_name.c_str());
      answer_may_come_until_ns_ = clock_.mono_ns() + late_answer_ns(request);
    }
    return scan;
  }

  [[nodiscard]] std::int64_t late_answer_ns(const ScanRequest& request) const {
    return std::max(settings_.late_answer_ns, request.timeout_ns);
  }

  Result<AcquiredScan> wait_and_take(std::string_view stem, const ScanRequest& request, std::int64_t deadline_ns,
                                     std::span<float> xyz, const std::atomic<bool>& cancel,
                                     const ScanDecoded& decoded) {
    trusted_ = true;
    for (;;) {
      Result<Answer> answer = wait_for_answer(stem, deadline_ns, request.timeout_ns, cancel);
      if (!answer) return answer.error();
      hang_.enter(HangWatch::kTake_ns);
      bool doubted = false;
      Result<AcquiredScan> scan = take(answer.value(), request, xyz, decoded, doubted);
      hang_.enter(HangWatch::kLook_ns);
      // It has the length that its header states, but not its content yet, so it must first stop changing.
      trusted_ = !doubted;
      if (doubted) continue;
      if (!scan) {
        set_aside(answer.value().entry.name, scan.error().text.c_str());
      } else if (settings_.any_name) {
        extension_taken_ = lower_case(extension_of(answer.value().entry.name.view()));
      }
      return scan;
    }
  }

  /// A missing folder (a share not mounted) is not final: the next look tries again.
  Status open_folders() {
    if (!looked_ && settings_.make_drop_dir) folders_.make_drop_dir();
    looked_ = true;
    const Status status = folders_.open();
    note_whether_online(status);
    note_lock();
    if (!status || begun_) return status;
    begun_ = true;
    begun_ns_ = clock_.mono_ns();
    asked_before_ = folders_.withdraw_all_requests() != 0;  // its scanner may still be at work
    return status;
  }

  void note_whether_online(const Status& status) {
    if (!status) {
      const std::lock_guard lock(why_mutex_);
      why_offline_ = status.error().text;
    }
    online_ = status.ok();
  }

  /// Records the owner of the folder, and reports once that its file system does not lock.
  void note_lock() {
    const FolderLock::State state = folders_.lock_state();
    {
      const std::lock_guard lock(why_mutex_);
      used_by_another_.clear();
      if (state == FolderLock::State::anothers) used_by_another_ = why_offline_;
    }
    if (state == FolderLock::State::cannot && !lock_said_) {
      lock_said_ = true;
      ScannerText line;
      line.printf(
          "%.120s cannot be locked (%.100s): make sure that no other slabd uses this folder, because slabd cannot "
          "detect it",
          settings_.drop_dir.c_str(), folders_.lock_text().c_str());
      notes_.add(line);
    }
  }

  void set_aside(const NameText& name, const char* why) {
    ScannerText line;
    if (!folders_.set_aside(name.c_str())) {
      if (errno == ENOENT || name == stuck_.view()) return;
      stuck_ = name;  // retried at each look, but reported once
      line.printf("inbox/%.120s cannot be moved to stray/: %s", name.c_str(), errno_text(errno));
      notes_.add(line);
      return;
    }
    line.printf("inbox/%.120s was moved to stray/: %s", name.c_str(), why);
    notes_.add(line);
    ++strays_;
    trimmed_ = false;
  }

  /// Deletes the oldest entries of stray/ first, each with a log line, because an operator may look for it.
  void trim_stray() {
    DropFolders::StrayLimits limits;
    limits.bytes = settings_.stray_bytes_max;
    trimmed_ = !folders_.trim_stray(limits, trimmed_ones_);
    for (const DropFolders::Trimmed& one : trimmed_ones_) {
      ScannerText line;
      if (!one.deleted) {
        // Retried with the next file.
        line.printf("stray/%.120s cannot be deleted: %s", one.name.c_str(), errno_text(one.error_number));
      } else if (one.held > limits.bytes) {
        line.printf(
            "stray/%.120s (%llu bytes) was deleted: stray/ held %llu bytes, allowed are %llu, it was the oldest",
            one.name.c_str(), static_cast<unsigned long long>(one.bytes), static_cast<unsigned long long>(one.held),
            static_cast<unsigned long long>(limits.bytes));
      } else {
        line.printf(
            "stray/%.120s (%llu bytes) was deleted: stray/ held more than %zu files and folders, it was the oldest",
            one.name.c_str(), static_cast<unsigned long long>(one.bytes), limits.entries);
      }
      notes_.add(line);
      if (!one.deleted) continue;
      ++deleted_files_;
      deleted_bytes_ += one.bytes;
    }
  }

  /// Lists the inbox and moves away files that are certainly not an answer to `awaited` (empty: no request).
  Status tidy(std::string_view awaited) {
    InboxEntries entries;
    if (Status status = look(awaited, entries); !status) return status;
    say_crowd();
    for (const UnchangedTimes::Watched& watched : watch_.watched()) {
      const std::string_view stem = stem_of(watched.entry.name.view());
      if (!awaited.empty() && stem == awaited) continue;
      const bool answers_another = !settings_.any_name && is_request_stem(stem);
      const bool left_behind = clock_.mono_ns() - watched.since_ns >= kStray_ns;
      if (answers_another || left_behind)
        set_aside(watched.entry.name, answers_another ? "its request is over or never was" : "it answers no request");
    }
    clear_crowd(awaited);
    // Also while a scan is awaited, because a disk can be filled within a timeout.
    const std::int64_t begin_ns = clock_.mono_ns();
    do {
      if (!trimmed_) trim_stray();
    } while (!trimmed_ && is_crowd_cleared_ && clock_.mono_ns() - begin_ns < kCrowd_ns);
    return success();
  }

  /// Clears an inbox with more files than are watched. Files unchanged for kStray_ns, by the file system's clock, are
  /// moved at once, as many as one look allows. Files that are being written stay.
  void clear_crowd(std::string_view awaited) {
    is_crowd_cleared_ = false;
    if (!crowd_said_) return;
    const std::optional<std::int64_t> time_ns = folders_.time_ns();
    if (!time_ns) return;
    const std::int64_t begin_ns = clock_.mono_ns();
    const std::uint64_t before = strays_;
    const auto move = [&](const char* name) {
      const std::string_view stem = stem_of(name);
      if (!awaited.empty() && stem == awaited) return true;
      const FileState state = file_state(folders_.inbox_fd(), name);
      const bool answers_another = !settings_.any_name && is_request_stem(stem);
      if (state.known && (answers_another || *time_ns - state.status_ns >= kStray_ns) && folders_.set_aside(name)) {
        ++strays_;
        trimmed_ = false;
      }
      return clock_.mono_ns() - begin_ns < kCrowd_ns;
    };
    folders_.for_each_in_inbox(std::ref(move));  // by reference: a copy would use the heap
    is_crowd_cleared_ = strays_ != before;
    if (!folders_.is_crowded()) say_crowd_is_gone();
  }

  void say_crowd() {
    if (!folders_.is_crowded() || crowd_said_) return;
    crowd_said_ = true;
    crowd_began_ = strays_;
    ScannerText line;
    line.printf("inbox/ holds more than %zu files that answer no request; they are moved to stray/ and counted",
                kInboxEntriesMax);
    notes_.add_first(line);
  }

  void say_crowd_is_gone() {
    ScannerText line;
    line.printf("inbox/ is no longer crowded: %llu files that answer no request were moved to stray/",
                static_cast<unsigned long long>(strays_ - crowd_began_));
    notes_.add_first(line);
    crowd_said_ = false;
  }

  Status look(std::string_view awaited, InboxEntries& entries) {
    FixedString<16> first(awaited);
    if (!awaited.empty()) first.append(".");
    Status status = folders_.list_inbox(settings_.any_name ? std::string_view{} : first.view(), entries);
    if (status) {
      watch_.look(clock_.mono_ns(), entries);
    } else {
      note_whether_online(status);
    }
    return status;
  }

  /// Before the request: the inbox must not contain a file that could be taken for its answer.
  Status clear_inbox(std::string_view stem) {
    if (Status status = tidy({}); !status) return status;
    InboxEntries entries;
    if (Status status = look(stem, entries); !status) return status;
    for (const InboxEntry& entry : entries)
      if (settings_.any_name || stem_of(entry.name.view()) == stem)
        return error(Code::frame_incomplete, "%s/inbox/%.120s exists before the scan was requested",
                     settings_.drop_dir.c_str(), entry.name.c_str());
    return success();
  }

  // ---- waiting

  void pause() {
    hang_.leave();
    // Listing thousands of names takes a processor some milliseconds, which other programs need too.
    wait_for_next_look(folders_.is_crowded() ? kCrowdedPoll_ns : kPoll_ns);
    hang_.enter(HangWatch::kLook_ns);
  }

  /// any_name: waits until the late answer to a failed request has come and was set aside, or can no longer come. It
  /// has come if a scan can be read; other files may be of any origin.
  Status outwait_late_answer(std::int64_t deadline_ns, std::span<float> xyz, const std::atomic<bool>& cancel) {
    while (clock_.mono_ns() < answer_may_come_until_ns_) {
      InboxEntries entries;
      if (Status status = look({}, entries); !status) return status;
      // A copy, because the list changes when a file is set aside.
      const auto watched_now = watch_.watched();
      for (const UnchangedTimes::Watched& watched : watched_now) {
        if (!is_quiet(watched)) continue;
        if (holds_scan(watched.entry, xyz)) answer_may_come_until_ns_ = 0;
        set_aside(watched.entry.name, "its request was given up");
      }
      if (cancel) return error(Code::interrupted, "the scan was cancelled");
      if (clock_.mono_ns() >= deadline_ns)
        return error(Code::trigger_timeout,
                     "an earlier request was cancelled, and its answer may still arrive; without names it cannot be "
                     "distinguished from this one's");
      if (answer_may_come_until_ns_ != 0) pause();
    }
    folders_.forget_unanswered();
    return success();
  }

  /// True if the file can be decoded as a scan, which is the only proof.
  bool holds_scan(const InboxEntry& entry, std::span<float> xyz) {
    if (!entry.regular || stem_of(entry.name.view()).empty()) return false;
    hang_.enter(HangWatch::kTake_ns);
    const Result<int> opened = open_scan(folders_.inbox_fd(), entry.name.c_str(), entry.name.c_str());
    bool is_scan = false;
    if (opened) {
      const Fd fd(opened.value());
      const Result<ScanShape> shape = read_scan_fd(fd.get(), entry.name.c_str(), settings_.form, xyz, readers_);
      is_scan = shape.ok() && shape.value().finite > 0;
    }
    hang_.enter(HangWatch::kLook_ns);
    return is_scan;
  }

  Result<Answer> wait_for_answer(std::string_view stem, std::int64_t deadline_ns, std::int64_t timeout_ns,
                                 const std::atomic<bool>& cancel) {
    for (;;) {
      if (cancel) return error(Code::interrupted, "the scan was cancelled");
      Result<std::optional<Answer>> found = settings_.any_name ? find_only_file() : find_named(stem);
      if (!found) return found.error();
      if (found.value()) return *found.value();
      if (clock_.mono_ns() >= deadline_ns) {
        // Reading it will report what is missing. With any_name the file stays and is moved once it is complete.
        // Otherwise its writer would continue in stray/, and the next request would wait for an answer that never
        // comes.
        if (const UnchangedTimes::Watched* begun = find_begun(stem)) {
          if (!settings_.any_name) return Answer{begun->entry, begun->since_ns};
          return error(Code::frame_incomplete, "%s/inbox/%.120s: not whole within %.1f s: bytes are missing",
                       settings_.drop_dir.c_str(), begun->entry.name.c_str(), ms_from_ns(timeout_ns) / 1e3);
        }
        return error(Code::trigger_timeout, "no answer to request %.*s within %.1f s", static_cast<int>(stem.size()),
                     stem.data(), ms_from_ns(timeout_ns) / 1e3);
      }
      pause();
    }
  }

  Result<std::optional<Answer>> find_named(std::string_view stem) {
    if (Status status = tidy(stem); !status) return status.error();
    for (const UnchangedTimes::Watched& watched : watch_.watched())
      if (stem_of(watched.entry.name.view()) == stem && is_finished(watched))
        return std::optional<Answer>(Answer{watched.entry, watched.since_ns, !is_quiet(watched)});
    return std::optional<Answer>();
  }

  /// An answer that lacks bytes or has a hole: it will be rejected in any case.
  const UnchangedTimes::Watched* find_begun(std::string_view stem) const {
    for (const UnchangedTimes::Watched& watched : watch_.watched()) {
      if (!watched.entry.regular) continue;
      if (!settings_.any_name && stem_of(watched.entry.name.view()) != stem) continue;
      if (const Signs signs = look_into(watched.entry); signs.lacks_bytes || signs.has_hole) return &watched;
    }
    return nullptr;
  }

  /// A file with an answer's name and a binary header that states its length is complete, unless its content was found
  /// missing (`trusted_`). A text table proves nothing, because every part of it is a smaller scan. It must be
  /// unchanged for half a second.
  bool is_finished(const UnchangedTimes::Watched& watched) const {
    if (!watched.entry.regular || is_quiet(watched)) return true;
    if (!trusted_ || clock_.mono_ns() - watched.since_ns < kTimeStep_ns) return false;
    const char* name = watched.entry.name.c_str();
    const Result<int> opened = open_scan(folders_.inbox_fd(), name, name);
    if (!opened) return true;  // take() will report the reason
    const Fd fd(opened.value());
    return is_untouched(fd.get(), watched.entry) && is_complete_scan(fd.get(), name, settings_.form.unit);
  }

  bool is_quiet(const UnchangedTimes::Watched& watched) const {
    const std::int64_t still_ns = clock_.mono_ns() - watched.since_ns;
    if (still_ns < (folders_.on_network() ? kFinishedOnShare_ns : kFinished_ns)) return false;
    if (still_ns >= kFilled_ns) return true;
    const Signs signs = look_into(watched.entry);
    return !signs.lacks_bytes && !signs.has_hole;
  }

  /// Signs that a file is not complete yet. Programs pause while they write; those that copy over a network set the
  /// file's final length first and then fill it.
  struct Signs {
    bool lacks_bytes = false;
    bool has_hole = false;
  };
  Signs look_into(const InboxEntry& entry) const {
    if (!entry.regular) return {};
    const char* name = entry.name.c_str();
    const Result<int> opened = open_scan(folders_.inbox_fd(), name, name);
    if (!opened) return {};
    const Fd fd(opened.value());
    const off_t hole = lseek(fd.get(), 0, SEEK_HOLE);
    const bool has_hole = hole >= 0 && hole < entry.state.bytes &&
                          static_cast<std::uint64_t>(hole) < bytes_of_data(fd.get(), name, settings_.form.unit);
    return {lacks_bytes(fd.get(), name, settings_.form.unit), has_hole};
  }

  /// any_name: exactly one entry, a regular file, untouched for half a second.
  Result<std::optional<Answer>> find_only_file() {
    InboxEntries entries;
    if (Status status = look({}, entries); !status) return status.error();
    if (entries.empty()) return std::optional<Answer>();
    if (entries.size() > 1 || !entries[0].regular) {
      const Error several =
          error(Code::frame_incomplete, "%s/inbox/%.120s: %s", settings_.drop_dir.c_str(), entries[0].name.c_str(),
                entries.size() > 1 ? "is not the only answer to one request" : "not a regular file");
      for (const InboxEntry& entry : entries) set_aside(entry.name, several.text.c_str());
      return several;
    }
    const UnchangedTimes::Watched& only = watch_.watched()[0];
    if (!is_quiet(only)) return std::optional<Answer>();
    if (is_of_another_kind(only.entry.name.view())) {
      const Error another = error(Code::frame_incomplete,
                                  "%s/inbox/%.120s: the scan before it was a .%s; this may be the same exposure saved "
                                  "twice (exactly one file a request; after a change of format restart slabd)",
                                  settings_.drop_dir.c_str(), only.entry.name.c_str(), extension_taken_.c_str());
      set_aside(only.entry.name, another.text.c_str());
      return another;
    }
    return std::optional<Answer>(Answer{only.entry, only.since_ns});
  }

  /// any_name: a program that saves one exposure as scan.ply and a moment later as scan.xyz would answer two requests.
  /// The extension is kept after a refusal, because the other file comes with the next request.
  bool is_of_another_kind(std::string_view name) const {
    const std::string_view extension = extension_of(name);
    return !extension_taken_.empty() && is_scan_extension(extension) &&
           lower_case(extension).view() != extension_taken_.view();
  }

  // ---- taking

  /// `doubted`: no scan was taken, because a file that was complete by its length is not complete yet.
  Result<AcquiredScan> take(const Answer& answer, const ScanRequest& request, std::span<float> xyz,
                            const ScanDecoded& decoded, bool& doubted) {
    const std::int64_t begin_ns = clock_.mono_ns();
    AcquiredScan scan;
    scan.taken_mono_ns = answer.seen_ns;
    scan.taken_utime_us = clock_.utime_us() - (begin_ns - answer.seen_ns) / kNsPerUs;
    const Result<PathText> path = spool_path(request, answer.entry.name.view());
    if (!path) return path.error();
    scan.path = path.value();

    FixedString<limits::kErrorTextBytes> shown;
    shown.printf("%s/inbox/%s", settings_.drop_dir.c_str(), answer.entry.name.c_str());
    const Result<int> opened = open_scan(folders_.inbox_fd(), answer.entry.name.c_str(), shown.c_str());
    if (!opened) return opened.error();
    const Fd fd(opened.value());
    const InboxEntry& found = answer.entry;
    Result<ScanShape> shape = read_scan_fd(fd.get(), shown.c_str(), settings_.form, xyz, readers_);
    const bool untouched = is_untouched(fd.get(), found);
    doubted = answer.accounted && (!shape || shape.value().zeros > 0 || !untouched);
    if (!shape) return shape.error();
    // Also after the longest pause of a writer: it may still write them, into the file in the spool.
    if (!doubted && look_into(found).has_hole)
      return error(Code::frame_incomplete,
                   "%s: parts of its data were never written (write it under another name, then "
                   "rename)",
                   shown.c_str());
    if (doubted || !untouched)
      return error(Code::frame_incomplete, "%s: changed while it was read (write it under another name, then rename)",
                   shown.c_str());
    scan.shape = shape.value();
    if (scan.shape.finite < request.points_min)
      return error(Code::too_few_points, "%s: %zu of %zu points are there, needed are %zu", shown.c_str(),
                   scan.shape.finite, scan.shape.points, request.points_min);
    scan.read_ms = ms_from_ns(clock_.mono_ns() - begin_ns);
    decoded(scan);
    // From here on the disk needs the time. One time limit for both, because the PLC does not wait longer.
    const std::int64_t left_ns = HangWatch::kTake_ns - (clock_.mono_ns() - begin_ns);
    hang_.enter(std::max(left_ns, HangWatch::kStoreMin_ns),
                folders_.on_network() ? HangWatch::Place::copying : HangWatch::Place::spool);
    if (Status status = spool_file(fd.get(), folders_.inbox_fd(), answer.entry.name.c_str(), scan.path); !status)
      return status.error();
    // A program that had the file open before the move can still write to it. A copied file may be gone from its share.
    const FileState now = file_state(fd.get(), "");
    if (!now.known || now.same_content(found.state)) return scan;
    unlink(scan.path.c_str());
    return error(Code::frame_incomplete, "%s: changed while it was moved (write it under another name, then rename)",
                 shown.c_str());
  }

  /// True if the decoded file is the listed one and has not changed meanwhile.
  static bool is_untouched(int fd, const InboxEntry& entry) { return file_state(fd, "").same_content(entry.state); }

  static Result<PathText> spool_path(const ScanRequest& request, std::string_view name) {
    const FixedString<16> extension = lower_case(extension_of(name));
    if (request.spool_path.size() + 1 + extension.size() > PathText::capacity())
      return error(Code::config, "%s: the spool path and \".%s\" exceed %zu bytes", request.spool_path.c_str(),
                   extension.c_str(), PathText::capacity());
    PathText path(request.spool_path);
    path.append(".");
    path.append(extension.view());
    return path;
  }

  ScanDropSettings settings_;
  const Clock& clock_;
  Team readers_;
  DropFolders folders_;
  UnchangedTimes watch_;
  HangWatch hang_;
  DropNotes notes_;
  bool looked_ = false;
  bool begun_ = false;  ///< the folders could be used once; the first time was:
  std::int64_t begun_ns_ = 0;
  bool asked_before_ = false;  ///< any_name: an earlier process requested a scan
  bool trusted_ = true;        ///< the length of the current file proves its content
  NameText stuck_;             ///< name of a file that cannot be moved
  bool lock_said_ = false;
  bool crowd_said_ = false;                    ///< the inbox contains more than is watched
  bool is_crowd_cleared_ = false;              ///< by the last look: files were moved
  std::uint64_t crowd_began_ = 0;              ///< strays at that time
  FixedString<16> extension_taken_;            ///< any_name: of the last accepted scan
  std::int64_t answer_may_come_until_ns_ = 0;  ///< any_name: 0 or past: no answer is outstanding
  bool trimmed_ = false;                       ///< stray/ is within its limits
  DropFolders::TrimmedOnes trimmed_ones_;
  std::atomic<bool> online_ = false;
  std::atomic<std::uint64_t> strays_ = 0;
  std::atomic<std::uint64_t> deleted_files_ = 0;
  std::atomic<std::uint64_t> deleted_bytes_ = 0;
  mutable std::mutex why_mutex_;
  ScannerText why_offline_;
  ScannerText used_by_another_;
};

}  // namespace

Result<std::unique_ptr<ScannerPort>> make_scan_drop(const ScanDropSettings& settings, const Clock& clock) {
  // Room for the suffix below: "/inbox/" and a name.
  if (settings.drop_dir.empty() || settings.drop_dir.size() == PathText::capacity())
    return error(Code::config, "scanner.drop_dir \"%s\" is empty or longer than %zu bytes", settings.drop_dir.c_str(),
                 PathText::capacity() - 1);
  return std::unique_ptr<ScannerPort>(std::make_unique<ScanDrop>(settings, clock));
}

}  // namespace slabd::hal
