// SPDX-License-Identifier: Apache-2.0
#include "web/documents.h"

#include <fmt/core.h>
#include <sha256.h>
#include <sys/eventfd.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <csignal>
#include <cstdlib>
#include <filesystem>
#include <utility>

#include "base/plain_text.h"
#include "report/json.h"

extern char** environ;  // NOLINT(readability-redundant-declaration)

namespace slabd::web {
namespace {

using Clock = std::chrono::steady_clock;
using End = ChildResult::End;

constexpr double kReportFactor = 6.0;
/// Before every renewal.
constexpr auto kLongAgo = Clock::time_point::min();
/// An error is kept this long, so that a page that repeats a wrong request starts one process a second.
constexpr double kErrorCache_s = 1.0;
/// A document that is kept for no longer is about the present.
constexpr double kBrief_s = 5.0;
/// Exit status of slabctl, which are the same in all versions (cli/exit.h).
constexpr int kUsage = 2;
constexpr int kBadInput = 3;
constexpr int kNotReachable = 4;
constexpr int kRefused = 6;

Clock::duration seconds(double s) {
  return std::chrono::duration_cast<Clock::duration>(std::chrono::duration<double>(s));
}

/// Quoted first half of the SHA-256.
std::string etag_of(SHA256_CTX& context) {
  std::array<char, SHA256_DIGEST_STRING_LENGTH> hex{};
  SHA256_End(&context, hex.data());
  return '"' + std::string(hex.data(), 32) + '"';
}

std::string etag_of(const Fd& file) {
  SHA256_CTX context;
  SHA256_Init(&context);
  std::array<std::uint8_t, 65'536> piece{};
  for (off_t at = 0;;) {
    const ssize_t got = ::pread(file.get(), piece.data(), piece.size(), at);
    if (got <= 0) break;
    SHA256_Update(&context, piece.data(), static_cast<std::size_t>(got));
    at += got;
  }
  return etag_of(context);
}

std::string name_of(const DocumentOrder& order) {
  std::string name;
  for (const std::string& word : order.arguments) name += word + '\n';
  return name;
}

/// True if slabctl printed a whole document. It does so also with status 1 (not pass), 3 and 4 (findings of the
/// doctor), and prints nothing on stdout before an error.
bool is_document(const ChildResult& result) {
  std::array<char, 2> end{};
  if (result.bytes < end.size()) return false;
  const auto at = static_cast<off_t>(result.bytes - end.size());
  return ::pread(result.output.get(), end.data(), end.size(), at) == 2 && end[0] == '}' && end[1] == '\n';
}

/// The error of a slabd-plant that ended by itself without a document.
SharedAnswer refused_by_plant(const ChildResult& result) {
  constexpr std::string_view kName = "slabd-plant: ";
  std::string text = result.sentence.empty() ? "slabd-plant gave no document" : result.sentence;
  if (text.starts_with(kName)) text.erase(0, kName.size());
  if (text.find("has no [plant] dsn") != std::string::npos)
    return error_answer(404, "there is no plant's database here", "docs/PLANT.md describes how to set it up");
  if (result.status == kUsage) return error_answer(400, text, "correct the parameter");
  return error_answer(503, text, "docs/PLANT.md lists the faults of the plant's database");
}

/// The error of a process of slabctl that ended by itself without a document.
SharedAnswer refused(const ChildResult& result) {
  const std::string text = result.sentence.empty() ? "slabctl gave no document" : result.sentence;
  if (result.status == kUsage) return error_answer(400, text, "correct the parameter");
  if (text.starts_with("no slab with key")) return error_answer(404, text, "/api/v1/slabs lists the slabs");
  for (const char* comparison : {"was aborted", "slabs of types"})
    if (text.find(comparison) != std::string::npos) return error_answer(400, text, "choose two other slabs");
  if (text.starts_with("no draft ") || text.find(".png: ") != std::string::npos)
    return error_answer(404, text, "/api/v1/drafts lists the drafts");
  if (text.starts_with("no cloud of")) return error_answer(404, text, "the maps of the block show its surface");
  if (text.starts_with("--block")) return error_answer(404, text, "choose a block of this slab");
  if (result.status == kNotReachable)
    return error_answer(503, text, "start slabd, and see that slabd-web may read its database (slabctl doctor)");
  return error_answer(500, text, "slabctl config check; journalctl -u slabd-web");
}

/// Reason why a process has no exit status; empty if it has one.
std::string end_of(const ChildResult& result, double time_s) {
  switch (result.end) {
    case End::late: return "slabctl was ended after " + std::to_string(static_cast<int>(time_s)) + " s";
    case End::too_large: return "the document is longer than 64 MB";
    case End::crashed: return "slabctl was ended by signal " + std::to_string(result.status);
    case End::not_started: return "slabctl cannot be started: " + result.sentence;
    case End::stopped: return "slabd-web stops";
    case End::exited: break;
  }
  return "";
}

SharedAnswer fault_of(const ChildResult& result, double time_s) {
  const std::string text = end_of(result, time_s);
  switch (result.end) {
    case End::late: return error_answer(504, text, "ask for fewer slabs, or raise [web] answer_s");
    case End::too_large: return error_answer(500, text, "ask for fewer slabs");
    case End::crashed:
      return error_answer(
          500, text,
          result.status == SIGKILL ? "ask for fewer slabs: the unit's memory was used up" : "journalctl -u slabd-web");
    case End::not_started: return error_answer(503, text, "[web] slabctl names the program");
    case End::stopped: return error_answer(503, text, "try again in some seconds");
    case End::exited: break;
  }
  return refused(result);
}

/// A path in the folder that no other order has.
std::string new_report(const std::string& folder, std::string_view type) {
  static std::atomic<unsigned> count{0};
  return folder + "/" + std::to_string(++count) + (type == "image/png" ? ".png" : ".pdf");
}

}  // namespace

SharedAnswer error_answer(int status, const std::string& text, const std::string& cure) {
  auto answer = std::make_shared<Answer>();
  answer->status = status;
  answer->text =
      report::Json("slabd.web_error/1").field("status", status).field("text", text).field("cure", cure).text();
  return answer;
}

SharedAnswer text_answer(std::string text, const std::string& type) {
  auto answer = std::make_shared<Answer>();
  SHA256_CTX context;
  SHA256_Init(&context);
  SHA256_Update(&context, reinterpret_cast<const std::uint8_t*>(text.data()), text.size());
  answer->etag = etag_of(context);
  answer->type = type;
  answer->text = std::move(text);
  return answer;
}

std::string body_of(const Answer& answer) {
  if (!answer.file.is_open()) return answer.text;
  std::string text(answer.bytes, '\0');
  const ssize_t got = ::pread(answer.file.get(), text.data(), text.size(), 0);
  text.resize(got > 0 ? static_cast<std::size_t>(got) : 0);
  return text;
}

Documents::Documents(DocumentsSettings settings)
    : settings_(std::move(settings)), stop_(::eventfd(0, EFD_CLOEXEC | EFD_NONBLOCK)) {
  for (char** at = environ; *at != nullptr; ++at) {
    const std::string_view one(*at);
    if (!one.starts_with("SLABD_") && !one.starts_with("LC_ALL=")) environment_.emplace_back(one);
  }
  environment_.push_back("SLABD_CONFIG=" + settings_.config);
  environment_.emplace_back("LC_ALL=C.UTF-8");
  // Not in its arguments, which all users of the computer can read.
  if (!settings_.plant_dsn.empty()) environment_.push_back("SLABD_PLANT_DSN=" + settings_.plant_dsn);
  renewer_ = std::thread([this] { renew_documents(); });
}

Documents::~Documents() {
  stop();
  renewer_.join();
}

void Documents::stop() {
  const Lock lock(mutex_);
  stopped_ = true;
  const std::uint64_t one = 1;
  static_cast<void>(write_all(stop_.get(), &one, sizeof one));
  changed_.notify_all();
}

Documents::Entry* Documents::find(const std::string& name) {
  const auto found =
      std::find_if(entries_.begin(), entries_.end(), [&](const Entry& entry) { return entry.name == name; });
  if (found == entries_.end()) return nullptr;
  entries_.splice(entries_.begin(), entries_, found);
  return &entries_.front();
}

bool Documents::may_start(const DocumentOrder& order) const {
  if (stopped_) return true;  // and is refused then
  if (running_ >= kChildrenMax || (order.is_report && reports_ > 0)) return false;
  if (order.is_ahead) return waiting_ == 0;
  return order.is_live || live_waiting_ == 0;
}

/// False if the queue is full, or if no process became available within two time limits.
bool Documents::wait_for_process(Lock& lock, const DocumentOrder& order) {
  if (may_start(order)) return true;
  if (waiting_ >= kWaitingMax && !order.is_live) return false;
  int& live = live_waiting_;
  waiting_ += order.is_ahead ? 0 : 1;
  live += order.is_live ? 1 : 0;
  const double factor = order.is_report ? 2.0 * kReportFactor : 2.0;
  const auto ready = [&] {
    if (order.is_live) return stopped_ || running_ < kChildrenMax;
    return may_start(order);
  };
  const bool came = changed_.wait_for(lock, seconds(factor * settings_.answer_s), ready);
  live -= order.is_live ? 1 : 0;
  waiting_ -= order.is_ahead ? 0 : 1;
  return came;
}

void Documents::keep(const std::string& name, SharedAnswer answer, double cache_s) {
  Entry* entry = find(name);
  if (entry == nullptr) return;
  const bool good = answer->status == 200;
  const bool is_old = std::exchange(entry->is_old, false);
  entry->until = is_old ? kLongAgo : Clock::now() + seconds(good ? cache_s : std::min(cache_s, kErrorCache_s));
  entry->answer = std::move(answer);
  entry->is_made = true;
  entry->is_brief = cache_s <= kBrief_s;
  std::uint64_t bytes = 0;
  std::size_t count = 0;
  for (auto at = entries_.begin(); at != entries_.end();) {
    if (at->is_made) {
      bytes += at->answer->bytes + at->answer->text.size();
      ++count;
    }
    const bool is_over = at->is_made && at != entries_.begin() && (count > kKeptMax || bytes > kKeptBytesMax);
    at = is_over ? entries_.erase(at) : std::next(at);
  }
}

SharedAnswer Documents::made(const DocumentOrder& order) const {
  const double time_s = settings_.answer_s * (order.is_report ? kReportFactor : 1.0);
  ChildOrder child{order.is_plant ? settings_.plant : settings_.slabctl, order.arguments, environment_, time_s,
                   stop_.get()};
  if (order.is_plant) child.arguments.push_back("--config=" + settings_.config);
  std::string path;
  if (order.is_report) {
    path = new_report(settings_.reports_dir, order.file_type);
    for (std::string& word : child.arguments)
      if (const std::size_t at = word.find("{file}"); at != std::string::npos) word.replace(at, 6, path);
  }
  ChildResult result = run_child(child);
  auto answer = std::make_shared<Answer>();
  if (order.is_report) {
    answer->file = Fd(::open(path.c_str(), O_RDONLY | O_CLOEXEC | O_NOFOLLOW));
    answer->type = order.file_type;
    answer->bytes = static_cast<std::uint64_t>(file_state(answer->file.get(), "").bytes);
    std::error_code gone;
    std::filesystem::remove(path, gone);
    if (result.end != End::exited || !answer->file.is_open()) return fault_of(result, time_s);
  } else {
    if (order.is_plant && result.end == End::exited && !is_document(result)) return refused_by_plant(result);
    if (result.end != End::exited || !is_document(result)) return fault_of(result, time_s);
    answer->file = std::move(result.output);
    answer->bytes = result.bytes;
  }
  answer->etag = etag_of(answer->file);
  return answer;
}

/// Logs a fault of slabctl or of the computer, not one of a request.
void Documents::log(const DocumentOrder& order, const Answer& answer) {
  const auto now_ns = std::chrono::duration_cast<std::chrono::nanoseconds>(Clock::now().time_since_epoch()).count();
  if (answer.status < 500 || order.is_ahead || stopped_ || !log_limit_.permits(now_ns)) return;
  std::string command;
  for (const std::string& word : order.arguments) command += " " + word;
  fmt::print(stderr, "slabd-web: slabctl{}: {}", plain(command), plain(answer.text, Lines::kept));
}

SharedAnswer Documents::run(Lock& lock, const DocumentOrder& order) {
  ++running_;
  reports_ += order.is_report ? 1 : 0;
  lock.unlock();
  SharedAnswer answer;
  try {
    answer = made(order);
  } catch (const std::exception& fault) {
    answer = error_answer(500, std::string("internal error: ") + fault.what(), "journalctl -u slabd-web");
  }
  lock.lock();
  log(order, *answer);
  --running_;
  reports_ -= order.is_report ? 1 : 0;
  return answer;
}

/// Makes documents again whose time is over. A document that cannot be made keeps its time: once renew_s is over, the
/// next caller gets the error.
void Documents::renew_documents() {
  Lock lock(mutex_);
  while (true) {
    changed_.wait_until(lock, ahead_at_, [&] { return stopped_ || !to_renew_.empty() || Clock::now() >= ahead_at_; });
    if (stopped_) return;
    if (Clock::now() >= ahead_at_) order_ahead();
    if (to_renew_.empty()) continue;
    const DocumentOrder order = std::move(to_renew_.front());
    to_renew_.pop_front();
    SharedAnswer answer;
    if (wait_for_process(lock, order) && !stopped_) answer = run(lock, order);
    // A command that writes may have removed the entry meanwhile, and the document may be older than that.
    // A caller may wait for a document that is made ahead, and then gets its error.
    if (Entry* const entry = find(name_of(order)); entry != nullptr && std::exchange(entry->is_renewed, false)) {
      if (answer != nullptr && (answer->status == 200 || !entry->is_made))
        keep(entry->name, answer, order.cache_s);
      else if (!entry->is_made)  // no process was available; find() put it in front
        entries_.pop_front();
    }
    changed_.notify_all();
  }
}

/// Orders the documents that are made ahead, and sets the next time.
void Documents::order_ahead() {
  const auto now = Clock::now();
  ahead_at_ = now - asked_at_ < seconds(kAheadFor_s) ? now + seconds(ahead_every_s_) : kNeverAhead;
  for (const DocumentOrder& order : ahead_) {
    Entry* entry = find(name_of(order));
    // A caller makes it, or it is made again already.
    if (entry != nullptr && (!entry->is_made || entry->is_renewed)) continue;
    if (entry == nullptr) entry = &entries_.emplace_front(Entry{name_of(order), nullptr, {}, false, false, false});
    entry->is_renewed = true;
    to_renew_.push_back(order);
  }
}

void Documents::make_ahead(std::vector<DocumentOrder> orders, double every_s) {
  const Lock lock(mutex_);
  ahead_ = std::move(orders);
  for (DocumentOrder& order : ahead_) order.is_ahead = true;
  ahead_every_s_ = every_s;
  asked_at_ = ahead_at_ = Clock::now();
  changed_.notify_all();
}

std::optional<SharedAnswer> Documents::wait_for_other(Lock& lock, const DocumentOrder& order) {
  const std::string name = name_of(order);
  const bool was_old = find(name)->is_old;
  const Entry* found = nullptr;
  // The other caller may remove the entry when it gives up.
  const auto is_made = [&] {
    found = find(name);
    return stopped_ || found == nullptr || found->is_made;
  };
  changed_.wait_for(lock, seconds((order.is_report ? 3.0 * kReportFactor : 3.0) * settings_.answer_s), is_made);
  if (found == nullptr || !found->is_made)
    return error_answer(503, "too many documents are wanted at once", "try again in some seconds");
  if (was_old && found->until == kLongAgo) return std::nullopt;
  return found->answer;
}

SharedAnswer Documents::get(const DocumentOrder& order) {
  const std::string name = name_of(order);
  Lock lock(mutex_);
  const auto now = Clock::now();
  // The live picture asks all the time, also if no page is open.
  if (!order.is_live) {
    asked_at_ = now;
    if (!ahead_.empty() && ahead_at_ == kNeverAhead) {
      ahead_at_ = now;
      changed_.notify_all();
    }
  }
  if (Entry* entry = find(name); entry != nullptr) {
    // The live picture asks because something has changed: what was made or begun before may lack it.
    if (order.is_live && !entry->is_made) entry->is_old = true;
    const bool is_kept = entry->is_made && !order.is_live;
    if (is_kept && now < entry->until) return entry->answer;
    if (is_kept && entry->answer->status == 200 && now < entry->until + seconds(order.renew_s)) {
      if (!std::exchange(entry->is_renewed, true)) {
        to_renew_.push_back(order);
        changed_.notify_all();
      }
      return entry->answer;
    }
    if (!entry->is_made)
      if (const auto answer = wait_for_other(lock, order)) return *answer;
    entry = find(name);
    entry->is_made = false;
    entry->is_renewed = false;
  } else {
    entries_.push_front({name, nullptr, {}, false, false, false});
  }
  if (!wait_for_process(lock, order) || stopped_) {
    entries_.remove_if([&](const Entry& entry) { return entry.name == name; });
    changed_.notify_all();
    return error_answer(503, stopped_ ? "slabd-web stops" : "too many documents are wanted at once",
                        "try again in some seconds");
  }
  SharedAnswer answer = run(lock, order);
  keep(name, answer, order.cache_s);
  changed_.notify_all();
  return answer;
}

void Documents::note_change() {
  const Lock lock(mutex_);
  for (Entry& entry : entries_) {
    if (entry.is_made && entry.is_brief) entry.until = kLongAgo;
    if (!entry.is_made && !entry.is_renewed) entry.is_old = true;
  }
}

SharedAnswer Documents::carry_out(const std::vector<std::string>& arguments) {
  // A change waits for slabd's database, up to 20 s.
  constexpr double kWriteFactor = 5.0;
  const std::lock_guard one_at_a_time(writing_);
  const double time_s = kWriteFactor * settings_.answer_s;
  const ChildResult result = run_child({settings_.slabctl, arguments, environment_, time_s, stop_.get()});
  {
    // Whatever the end was, the change may have been made.
    const Lock lock(mutex_);
    entries_.remove_if([](const Entry& entry) { return entry.is_made; });
    for (Entry& entry : entries_) entry.is_old = true;
    if (!ahead_.empty()) {
      ahead_at_ = Clock::now();
      changed_.notify_all();
    }
  }
  if (result.end == End::not_started) return fault_of(result, time_s);
  if (result.end != End::exited)
    return error_answer(503, end_of(result, time_s), "look at the slab: the change may have been recorded");
  Answer printed;
  printed.bytes = result.bytes;
  printed.file = Fd(::fcntl(result.output.get(), F_DUPFD_CLOEXEC, 0));
  const std::string text = body_of(printed);
  if (result.status == 0)
    return text_answer(report::Json("slabd.web_done/1").field("text", text.substr(0, text.find('\n'))).text(),
                       "application/json");
  if (result.status == kRefused) return error_answer(409, result.sentence, "correct what it names");
  if (result.status == kBadInput && !result.sentence.starts_with("no slab with key"))
    return error_answer(409, result.sentence, "correct what it names");
  if (result.status == kNotReachable)
    return error_answer(503, result.sentence, "start slabd, and see that slabd-web may write to it (docs/WEB.md)");
  return refused(result);
}

}  // namespace slabd::web
