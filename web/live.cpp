// SPDX-License-Identifier: Apache-2.0
#include "web/live.h"

#include <fmt/core.h>

#include <array>
#include <cstring>
#include <ctime>
#include <nlohmann/json.hpp>

#include "base/os.h"
#include "hal/system/control_client.h"
#include "web/words.h"

namespace slabd::web {
namespace {

using json = nlohmann::ordered_json;
using hal::ControlAnswer;

constexpr auto kPollPeriod = std::chrono::seconds(1);
constexpr auto kCalibrationPeriod = std::chrono::seconds(1);
constexpr auto kComposePeriod = std::chrono::milliseconds(200);
/// Stored results are read again at least this often, for changes that the status does not show (acknowledgement,
/// retention, another database).
constexpr auto kRefreshPeriod = std::chrono::seconds(30);
/// The same after an attempt that failed.
constexpr auto kTroublePeriod = std::chrono::seconds(5);
/// An older status is not of a daemon that answers.
constexpr std::int64_t kReachableAge_ms = 3'000;
constexpr const char* kHistoryRows = "8";

std::string cause_of(const ControlAnswer& answer) {
  switch (answer.fault) {
    case ControlAnswer::Fault::not_accepted: return "it listens, but takes no question";
    case ControlAnswer::Fault::silent: return "connected, but no answer within 1 s";
    case ControlAnswer::Fault::closed: return "it closed the connection";
    case ControlAnswer::Fault::too_long: return "the answer is longer than 64 kB";
    case ControlAnswer::Fault::none: return "the answer is not slabd.status/1";
    case ControlAnswer::Fault::system: break;
  }
  return errno_text(answer.error_number);
}

/// JSON in ASCII without line ends.
std::string text_of(const json& document) {
  return document.dump(-1, ' ', true, json::error_handler_t::replace);
}

/// The parts of a status that change when a stored result changes.
std::string mark_of(const json& status) {
  json mark = json::array();
  for (const char* key : {"session", "slab", "last_slab", "blocks", "results_pending", "chain"}) {
    const json part = status.value(key, json());
    mark.push_back(std::strcmp(key, "blocks") == 0 && part.is_object() ? part.value("measured", json()) : part);
  }
  return text_of(mark);
}

/// "2026-11-20" in the zone of the process, as slabctl yield names its days.
std::string today() {
  const std::time_t now = std::time(nullptr);
  std::tm local{};
  ::localtime_r(&now, &local);
  std::array<char, 32> text{};
  return {text.data(), std::strftime(text.data(), text.size(), "%Y-%m-%d", &local)};
}

std::int64_t utime_us() {
  return std::chrono::duration_cast<std::chrono::microseconds>(std::chrono::system_clock::now().time_since_epoch())
      .count();
}

}  // namespace

Live::Live(LiveSettings settings, Documents& documents) : settings_(std::move(settings)), documents_(documents) {
  poller_ = std::thread([this] { poll(); });
  refresher_ = std::thread([this] { refresh(); });
}

Live::~Live() {
  {
    const std::lock_guard lock(mutex_);
    stopped_ = true;
  }
  changed_.notify_all();
  poller_.join();
  refresher_.join();
}

std::string Live::calibration() {
  const std::lock_guard lock(asking_);
  if (!calibration_.empty() && Clock::now() - calibration_at_ < kCalibrationPeriod) return calibration_;
  const ControlAnswer answer = hal::ask_control(settings_.socket, "{\"verb\":\"calibration\"}\n", settings_.answer_ms);
  const json document = answer.ok() ? json::parse(answer.line, nullptr, false) : json();
  calibration_ = document.is_object() ? text_of(document) : "null";
  calibration_at_ = Clock::now();  // after the answer, so that callers do not wait for a silent daemon one by one
  return calibration_;
}

void Live::poll() {
  for (Clock::time_point next = Clock::now();; next = std::max(next + kPollPeriod, Clock::now())) {
    std::unique_lock lock(mutex_);
    if (changed_.wait_until(lock, next, [this] { return stopped_; })) return;
    lock.unlock();
    poll_once();
  }
}

void Live::poll_once() {
  const ControlAnswer answer = hal::ask_control(settings_.socket, "{\"verb\":\"status\"}\n", settings_.answer_ms);
  const json status = answer.ok() ? json::parse(answer.line, nullptr, false) : json();
  const bool good = status.is_object() && status.value("schema", "") == "slabd.status/1";
  const std::lock_guard lock(mutex_);
  reachable_ = good;
  if (!good) {
    unreachable_ = fmt::format("slabd does not answer on {}: {}", settings_.socket, cause_of(answer));
    return;
  }
  status_ = text_of(status);
  status_at_ = Clock::now();
  std::string mark = mark_of(status);
  if (mark == mark_) return;
  // Before a page can see the mark and ask for documents because of it.
  documents_.note_change();
  mark_ = std::move(mark);
  last_slab_ = text_of(status.value("last_slab", json()));
  changed_.notify_all();
}

void Live::refresh() {
  std::string seen = "not read yet";
  std::string seen_slab;
  Clock::time_point yield_at;
  for (;;) {
    std::unique_lock lock(mutex_);
    changed_.wait_for(lock, trouble_.empty() ? kRefreshPeriod : kTroublePeriod,
                      [&] { return stopped_ || mark_ != seen; });
    if (stopped_) return;
    const bool with_yield = seen_slab != last_slab_ || Clock::now() - yield_at >= kRefreshPeriod;
    seen = mark_;
    seen_slab = last_slab_;
    if (with_yield) yield_at = Clock::now();
    lock.unlock();
    refresh_once(with_yield);
  }
}

std::string Live::document(const std::vector<std::string>& arguments, std::string& trouble) {
  const SharedAnswer made = documents_.get({.arguments = arguments, .is_live = true});
  const json document = json::parse(body_of(*made), nullptr, false);
  if (made->status == 200 && document.is_object()) return text_of(document);
  if (trouble.empty()) trouble = document.is_object() ? document.value("text", "") : "slabctl gave no JSON";
  return {};
}

bool Live::read_last(std::string& last, std::string& map, std::string& trouble) {
  last = "[]";
  map = "null";
  const std::string history = document({"history", "--json", std::string("--limit=") + kHistoryRows}, trouble);
  if (history.empty()) return true;
  const json rows = json::parse(history).value("slabs", json::array());
  last = text_of(rows);
  if (rows.empty()) return true;
  const json& newest = rows.front();
  const std::string shown = document(
      {"show", "--map", "--json", "--language=" + settings_.language, "--", "key:" + newest.at("key").dump()}, trouble);
  if (shown.empty()) return true;
  map = shown;
  return newest.value("ended", json()).is_null() == json::parse(shown).value("ended_utime_us", json()).is_null();
}

void Live::refresh_once(bool with_yield) {
  std::string trouble;
  std::string last;
  std::string map;
  // Each is a read of its own: where the slab ended between the two, both are read again, so that no answer has a slab
  // in the list as being inspected and its map as passed.
  bool of_one_moment = false;
  for (int reads = 0; reads < 3 && !of_one_moment; ++reads) of_one_moment = read_last(last, map, trouble);
  std::string yield;
  if (with_yield) {
    const std::string day = today();
    const std::string document_of_day = document({"yield", "--json", "--by=day", "--since=2d"}, trouble);
    yield = "null";
    if (!document_of_day.empty())
      for (const json& group : json::parse(document_of_day).value("groups", json::array()))
        if (group.value("group", "") == day) yield = text_of(group);
  }
  const std::lock_guard lock(mutex_);
  last_ = std::move(last);
  map_ = std::move(map);
  if (with_yield) yield_ = std::move(yield);
  trouble_ = std::move(trouble);
}

std::string Live::composed(bool in_chinese) const {
  const bool known = status_ != "null";
  const std::int64_t age_ms = std::chrono::duration_cast<std::chrono::milliseconds>(Clock::now() - status_at_).count();
  const bool reachable = reachable_ && age_ms < kReachableAge_ms;
  std::string trouble = trouble_;
  if (!reachable) trouble = reachable_ ? "slabd-web has not read the answer of slabd in time" : unreachable_;
  if (in_chinese) trouble = sentence_in_chinese(trouble);
  return fmt::format(
      "{{\"schema\":\"slabd.web_status/1\",\"utime_us\":{},\"age_ms\":{},\"reachable\":{},\"trouble\":{},"
      "\"status\":{},\"map\":{},\"last\":{},\"yield\":{},\"slabd_web\":{{\"version\":{},\"language\":{}}}}}\n",
      utime_us(), known ? std::to_string(age_ms) : "null", reachable, text_of(json(trouble)),
      in_chinese ? status_in_chinese(status_) : status_, map_, last_, in_chinese ? yield_in_chinese(yield_) : yield_,
      text_of(json(settings_.version)), text_of(json(settings_.language)));
}

SharedAnswer Live::answer(const std::string& language) {
  const bool in_chinese = language == "zh";
  const std::lock_guard lock(mutex_);
  Composed& newest = composed_.at(in_chinese ? 1 : 0);
  if (newest.answer == nullptr || Clock::now() - newest.at >= kComposePeriod)
    newest = {text_answer(composed(in_chinese), "application/json"), Clock::now()};
  return newest.answer;
}

}  // namespace slabd::web
