// SPDX-License-Identifier: Apache-2.0
//
// The watch command: a loop of query, read and draw. The state of the links is from the daemon. Its duration is
// measured by this process; "for >" means that the state is older than the process.
#include "cli/watch/screen.h"

#include <fmt/core.h>
#include <poll.h>
#include <sys/ioctl.h>
#include <sys/stat.h>
#include <termios.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <chrono>
#include <csignal>
#include <ctime>
#include <map>
#include <memory>
#include <nlohmann/json.hpp>

#include "cli/client/arms.h"
#include "cli/client/control.h"
#include "cli/command.h"
#include "cli/exit.h"
#include "report/findings.h"
#include "report/slab_view.h"

namespace slabd::cli::watch {
namespace {

using nlohmann::json;
using report::Language;
using Clock = std::chrono::steady_clock;

volatile std::sig_atomic_t g_stop = 0;

double seconds_since(Clock::time_point then) {
  return std::chrono::duration<double>(Clock::now() - then).count();
}
double seconds_since(std::int64_t utime_us) {
  const auto now = std::chrono::system_clock::now().time_since_epoch();
  return std::chrono::duration<double>(now).count() - 1e-6 * static_cast<double>(utime_us);
}

/// Slabs on the largest screen, and those of a day on the fastest line: one slab a minute.
constexpr std::size_t kSlabsShown = 40;
constexpr std::size_t kSlabsADayMax = 24 * 60;
/// A slab that ends today may have begun before midnight.
constexpr std::int64_t kSlabTime_us = 6 * 3'600'000'000LL;

std::tm local_now() {
  const std::time_t now = std::time(nullptr);
  std::tm parts{};
  localtime_r(&now, &parts);
  return parts;
}
std::string clock_text() {
  const std::tm parts = local_now();
  return fmt::format("{:02}:{:02}:{:02}", parts.tm_hour, parts.tm_min, parts.tm_sec);
}
std::int64_t midnight_utime_us() {
  std::tm parts = local_now();
  parts.tm_hour = parts.tm_min = parts.tm_sec = 0;
  parts.tm_isdst = -1;
  return 1'000'000LL * std::mktime(&parts);
}

/// The value at a path, or `otherwise`; a newer or older daemon may have other keys.
template <typename T>
T at(const json& document, std::initializer_list<const char*> path, T otherwise) {
  const json* node = &document;
  for (const char* key : path) {
    if (!node->is_object() || !node->contains(key)) return otherwise;
    node = &(*node)[key];
  }
  if constexpr (std::is_same_v<T, std::string>) {
    return node->is_string() ? node->template get<T>() : otherwise;
  } else if constexpr (std::is_same_v<T, bool>) {
    return node->is_boolean() ? node->template get<T>() : otherwise;
  } else {
    return node->is_number() ? node->template get<T>() : otherwise;
  }
}

/// Stores the time of the last change of a link's state.
class Since {
 public:
  /// `what`: the state as a word that does not depend on the language.
  void note(LinkState& state, const std::string& what) {
    Seen& seen = seen_[{state.link, state.part}];
    if (seen.word.empty()) {
      seen = {what, Clock::now(), true};
    } else if (seen.word != what) {
      seen = {what, Clock::now(), false};
    }
    state.for_s = seconds_since(seen.when);
    state.at_least = seen.at_least;
  }

 private:
  struct Seen {
    std::string word;
    Clock::time_point when;
    bool at_least = true;
  };
  std::map<std::pair<Link, std::string>, Seen> seen_;
};

/// Takes over the terminal and restores it: alternate screen, no echo, no cursor.
class Terminal {
 public:
  Terminal() {
    tcgetattr(STDIN_FILENO, &before_);
    termios raw = before_;
    raw.c_lflag &= ~static_cast<tcflag_t>(ICANON | ECHO);
    tcsetattr(STDIN_FILENO, TCSANOW, &raw);
    write_all("\x1b[?1049h\x1b[?25l");
  }
  ~Terminal() {
    write_all("\x1b[?25h\x1b[?1049l");
    tcsetattr(STDIN_FILENO, TCSANOW, &before_);
  }
  Terminal(const Terminal&) = delete;
  Terminal& operator=(const Terminal&) = delete;

  static void write_all(std::string_view text) {
    while (!text.empty()) {
      const ssize_t written = ::write(STDOUT_FILENO, text.data(), text.size());
      if (written <= 0) return;
      text.remove_prefix(static_cast<std::size_t>(written));
    }
  }
  static void draw(const Picture& picture, report::Style style, Language language) {
    winsize size{};
    if (::ioctl(STDOUT_FILENO, TIOCGWINSZ, &size) != 0 || size.ws_col == 0) size = {24, 80, 0, 0};
    std::string out = "\x1b[H";
    const std::vector<std::string> lines = screen(picture, size.ws_col, size.ws_row, style, language);
    // Lines are written one by one and cleared to their end, to avoid flicker.
    for (std::size_t i = 0; i < lines.size(); ++i) out += (i == 0 ? "" : "\r\n") + lines[i] + "\x1b[K";
    write_all(out + "\x1b[J");
  }

 private:
  termios before_{};
};

class Watcher {
 public:
  Watcher(std::string socket, Language language) : socket_(std::move(socket)), language_(language) {}

  void turn_language() { language_ = language_ == Language::en ? Language::zh : Language::en; }
  [[nodiscard]] Language language() const { return language_; }

  const Picture& look() {
    const Result<std::string> answer = ask_daemon(socket_, "{\"verb\":\"status\"}\n");
    const json status = answer ? json::parse(answer.value(), nullptr, false) : json();
    if (status.is_object() && at<std::string>(status, {"schema"}, "") == "slabd.status/1") {
      answered_ = Clock::now();
      has_answer_ = true;
      picture_.trouble.clear();
      take(status);
    } else {
      picture_.trouble = answer ? std::string("no slabd.status/1 answer") : std::string(answer.error().text.view());
    }
    picture_.age_s = has_answer_ ? seconds_since(answered_) : kNoValue;
    return picture_;
  }

 private:
  [[nodiscard]] std::string say(std::string_view en, std::string_view zh) const {
    return std::string(language_ == Language::zh ? zh : en);
  }

  void take(const json& status) {
    Picture& p = picture_;
    p.clock = clock_text();
    p.software = at<std::string>(status, {"software"}, "slabd");
    p.state = report::state_word(at<std::string>(status, {"state"}, "?"), language_);
    p.uptime_s = at<double>(status, {"uptime_s"}, 0.0);
    p.fault = at<std::uint16_t>(status, {"fault", "code"}, 0);
    p.fault_text = at<std::string>(status, {"fault", "text"}, "");
    p.fault_cure = at<std::string>(status, {"fault", "cure"}, "");
    if (language_ == Language::zh && p.fault != 0) {
      p.fault_text = report::meaning(static_cast<Code>(p.fault), language_);
      p.fault_cure = report::cure_words(static_cast<Code>(p.fault), language_);
    }
    p.warnings = warnings_at(status, language_);
    p.emulation =
        report::emulation_banner(emulation_at(status, "emulation"), emulation_at(status, "emulation_now"), language_);
    p.slab_open = status.contains("slab") && status["slab"].is_object();
    p.stations_done = at<int>(status, {"slab", "stations_done"}, 0);
    p.current_station = p.slab_open ? at<int>(status, {"slab", "current_station"}, 0) : 0;
    take_links(status);
    read_database(at<std::string>(status, {"db"}, ""));
  }

  void take_links(const json& status) {
    picture_.links.clear();
    const auto add = [&](Link link, bool ok, std::string word, std::string cure, const std::string& what = {},
                         const std::string& part = {}) {
      LinkState state{link, ok, std::move(word), std::move(cure)};
      state.part = part;
      since_.note(state, what.empty() ? (ok ? "up" : "down") : what);
      picture_.links.push_back(std::move(state));
    };
    const std::vector<ArmStatus<json>> arms = arms_in(status);
    const bool plc = at<bool>(status, {"links", "plc", "alive"}, false);
    add(Link::plc, plc, plc ? say("alive", "在线") : say("silent", "无心跳"),
        at<int>(status, {"links", "plc", "clients"}, 0) == 0
            ? say("no client connected: check cable and PLC address", "无连接：检查网线和 PLC 地址")
            : say("its heartbeat (HR 0) does not change: check the PLC program", "心跳 (HR 0) 不变：检查 PLC 程序"));
    for (const ArmStatus<json>& arm : arms) {
      const bool robot = at<bool>(arm.pose, {"ok"}, false);
      const auto code = static_cast<Code>(at<std::uint16_t>(arm.pose, {"code"}, 0));
      add(Link::robot, robot, robot ? say("poses", "有位姿") : say("no poses", "无位姿"),
          std::string(report::cure_words(code, language_)), {}, arm.robot);
    }
    for (const ArmStatus<json>& arm : arms) {
      const bool scanner = at<bool>(arm.scanner_link, {"online"}, false);
      add(Link::scanner, scanner, scanner ? say("online", "在线") : say("offline", "离线"),
          std::string(report::cure_words(Code::scanner_offline, language_)), {}, arm.scanner);
    }
    const bool store = at<bool>(status, {"links", "store", "ok"}, false);
    // A full disk needs free space, not a backup.
    const Code failed = picture_.fault == static_cast<int>(Code::store_full) ? Code::store_full : Code::journal_write;
    add(Link::store, store, store ? say("writing", "正常") : say("failed", "故障"),
        std::string(report::cure_words(failed, language_)));
    for (const ArmStatus<json>& arm : arms) {
      const std::string source = at<std::string>(arm.calibration, {"source"}, "missing");
      const bool applied = source == "applied";
      const std::string word = applied                     ? say("applied", "已生效")
                               : source == "commissioning" ? say("commissioning", "调试值")
                               : source == "missing"       ? say("missing", "缺失")
                                                           : source;
      add(Link::calibration, applied, word, say("calibrate: slabctl calibrate", "请标定：slabctl calibrate"), source,
          arm.scanner);
    }
    if (arms.size() > 1) {
      const bool tied = at<std::string>(status, {"tie", "trouble"}, "none").empty();
      add(Link::tie, tied, tied ? say("tied", "已关联") : say("not tied", "未关联"),
          say("tie the robots' bases: slabctl calibrate tie", "请关联机器人基座：slabctl calibrate tie"));
    }
    join_equal_links();
  }

  /// Joins the links of the arms that are all up into one line, because the screen is small.
  void join_equal_links() {
    std::vector<LinkState>& links = picture_.links;
    for (std::size_t i = 0; i + 1 < links.size();) {
      LinkState& first = links[i];
      const LinkState& next = links[i + 1];
      if (first.link != next.link || !first.ok || !next.ok || first.word != next.word) {
        ++i;
        continue;
      }
      first.part += ", " + next.part;
      if (next.for_s < first.for_s) first.at_least = next.at_least;
      first.for_s = std::min(first.for_s, next.for_s);
      links.erase(links.begin() + static_cast<std::ptrdiff_t>(i) + 1);
    }
  }

  /// Keeps the last read data, which the screen shows as outdated.
  void cannot_read(const Error& why) {
    picture_.past_trouble = why.text.view();
    reader_.reset();
  }
  /// Reads the slabs from the database.
  void read_database(const std::string& path) {
    // The open file remains readable after another database replaces it (slabctl db restore), and would be shown
    // permanently. If the file is missing, the reader reports it.
    struct stat now {};
    const bool there = ::stat(path.c_str(), &now) == 0;
    const bool same = there && now.st_dev == reader_file_.st_dev && now.st_ino == reader_file_.st_ino;
    if (reader_ == nullptr || !same) {
      reader_.reset();
      counted_.reset();
      auto opened = storage::open_reader(path);
      if (!opened) return cannot_read(opened.error());
      reader_ = std::move(opened.value());
      reader_file_ = now;
    }
    storage::SlabFilter filter;
    filter.limit = kSlabsShown;
    const auto slabs = reader_->slabs(filter);
    if (!slabs) return cannot_read(slabs.error());
    picture_.past_trouble.clear();
    Picture& p = picture_;
    p.past.clear();
    if (slabs.value().empty()) {
      p.slab.clear();
      p.stations.clear();
      p.findings.clear();
      p.verdict = Verdict::none;
      p.map_age_s = kNoValue;
      return;
    }
    for (const storage::SlabSummary& slab : slabs.value())
      p.past.push_back({slab.header.slab_no, std::string(slab.header.slab_id.view()), slab.verdict, slab.reason,
                        slab.ended_utime_us == 0 ? kNoValue : seconds_since(slab.ended_utime_us),
                        slab.header.emulated});
    const storage::SlabSummary& newest = slabs.value().front();
    const auto record = reader_->slab(newest.header.key);
    if (!record) return cannot_read(record.error());
    if (!record.value()) return;
    p.slab = fmt::format("{} \"{}\"", newest.header.slab_no, newest.header.slab_id.view());
    p.stations.clear();
    std::int64_t newest_us = newest.ended_utime_us;
    for (int station = 1; station <= newest.header.stations; ++station) {
      p.stations.push_back(report::shown(*record.value(), station).verdict);
      if (const storage::SlabBlock* block = report::latest(*record.value(), station))
        newest_us = std::max(newest_us, block->attempt.scan_utime_us);
    }
    p.map_age_s = newest_us == 0 ? kNoValue : seconds_since(newest_us);
    p.verdict = report::is_open(*record.value()) ? Verdict::none : newest.verdict;
    p.recipe = newest.header.recipe.view();
    p.findings.clear();
    for (const report::Finding& finding : report::findings_of(*record.value(), language_))
      p.findings.emplace_back(finding.verdict, report::sentence_of(finding, language_));
    count_today(slabs.value());
  }

  /// Counts the day again after a slab, after midnight and in another language only, because it reads many slabs.
  void count_today(const std::vector<storage::SlabSummary>& newest) {
    std::int64_t last_us = 0;
    for (const storage::SlabSummary& slab : newest) last_us = std::max(last_us, slab.ended_utime_us);
    const Counted now{last_us, midnight_utime_us(), language_};
    if (counted_ == now) return;
    storage::SlabFilter filter;
    filter.limit = kSlabsADayMax;
    filter.since_utime_us = now.midnight_utime_us - kSlabTime_us;
    const auto slabs = reader_->slabs(filter);
    if (!slabs) return cannot_read(slabs.error());
    counted_ = now;
    picture_.today = today_of(slabs.value(), now.midnight_utime_us, language_);
  }

  std::string socket_;
  Language language_;
  Picture picture_;
  Since since_;
  bool has_answer_ = false;
  Clock::time_point answered_{};
  std::unique_ptr<storage::Reader> reader_;
  /// State of the day's counters.
  struct Counted {
    std::int64_t last_utime_us = 0;
    std::int64_t midnight_utime_us = 0;
    Language language = Language::en;
    bool operator==(const Counted&) const = default;
  };
  std::optional<Counted> counted_;
  struct stat reader_file_ {};  ///< identity of the file that `reader_` has open
};

}  // namespace

int run(const std::string& socket, Language language) {
  if (isatty(STDOUT_FILENO) == 0 || isatty(STDIN_FILENO) == 0)
    stop(kUsage, "--watch needs a terminal; `slabctl status --json` is for programs");
  struct sigaction action {};
  action.sa_handler = [](int) { g_stop = 1; };
  sigaction(SIGINT, &action, nullptr);
  sigaction(SIGTERM, &action, nullptr);
  const Terminal terminal;
  const report::Style style = style_for(stdout);
  Watcher watcher(socket, language);
  while (g_stop == 0) {
    Terminal::draw(watcher.look(), style, watcher.language());
    // Waits for a second, a key, or the end of the terminal; a resized window also interrupts.
    pollfd input{STDIN_FILENO, POLLIN, 0};
    if (::poll(&input, 1, 1000) <= 0) continue;
    char key = 0;
    if (::read(STDIN_FILENO, &key, 1) <= 0 || key == 'q' || key == 'Q') break;
    if (key == 'l' || key == 'L') watcher.turn_language();
  }
  return kDone;
}

}  // namespace slabd::cli::watch
