// SPDX-License-Identifier: Apache-2.0
// Changes around the line: links that come and go, new recipes and design sheets, another daemon, faults. Each is
// logged once, when it has lasted.
#include <algorithm>

#include "daemon/loop.h"
#include "daemon/slab_ends.h"
#include "daemon/station/parts.h"

namespace slabd::daemon {
namespace {

/// Duration after which a state of the PLC link is logged, and age of the last line after which it is logged in any
/// case.
constexpr std::int64_t kPlcNews_ns = kNsPerS;
constexpr std::int64_t kPlcNewsPeriod_ns = 60 * kNsPerS;
constexpr std::int64_t kScannerNews_ns = 2 * kNsPerS;
constexpr std::int64_t kScannerNewsPeriod_ns = 10 * kNsPerS;

/// Why no recipes are taken up in this fault. Of a long cure the first steps, as far as they fit.
RecipeWatch::Text reload_refused_by(Code fault, bool only_restart_clears) {
  RecipeWatch::Text text;
  text.printf("slabd is in fault %u (%.*s)%s: ", static_cast<unsigned>(fault), static_cast<int>(describe(fault).size()),
              describe(fault).data(),
              only_restart_clears ? ", which only a restart clears" : "; try again when it is cleared");
  const std::size_t room = text.capacity() - text.size();
  const std::string_view steps = cure(fault);
  text.append(steps.size() <= room ? steps : steps.substr(0, steps.rfind(';', room)));
  return text;
}

}  // namespace

/// Faults are events for the plant's database. A fault that lasts less than a second is not one.
void Loop::note_fault() {
  constexpr std::int64_t kLasts_ns = kNsPerS;
  const auto code = static_cast<std::uint16_t>(current_fault(*station_));
  const std::uint16_t before = fault_told_;
  if (!fault_seen_.is_news(code, ports_.clock.mono_ns(), {.lasts_ns = kLasts_ns})) return;
  fault_told_ = code;
  const std::int64_t now_us = ports_.clock.utime_us();
  const std::lock_guard lock(events_guard_);
  using Kind = storage::LineEvent::Kind;
  if (before != 0) (void)events_.push({Kind::cleared, static_cast<Code>(before), now_us});
  if (code != 0) (void)events_.push({Kind::fault, static_cast<Code>(code), now_us});
}

/// Two daemons with one drop folder take each other's scans, so the second one stays in fault until the first has
/// ended.
void Loop::look_for_another_daemon() {
  if (ports_.store == nullptr) return;  // the fault of the store is shown
  Code& fault = station_->settings.fault;
  hal::ScannerText text;
  for (std::size_t arm = 0; arm < ports_.arms() && text.empty(); ++arm) text = ports_.scanner_of(arm).used_by_another();
  if (text.empty() == !scanner_is_anothers_) return;
  scanner_is_anothers_ = !text.empty();
  fault = scanner_is_anothers_ ? Code::config : Code::ok;
  if (scanner_is_anothers_)
    say({LogLine::Level::error, static_cast<std::uint16_t>(fault), text.view()});
  else
    say({LogLine::Level::info, static_cast<std::uint16_t>(fault), "the drop folder is this daemon's alone"});
}

/// Design sheets are frozen with a slab at its begin, so that new ones may come at any time but while one is stored.
void Loop::apply_new_designs() {
  Station& s = *station_;
  if (s.command.pending) return;
  const std::shared_ptr<const config::DesignSet> next = ports_.designs->newer_than(designs_in_use_);
  if (next == nullptr) return;
  const bool is_first = designs_in_use_ == nullptr;
  designs_in_use_ = next;
  s.settings.designs = next->sheets;
  s.settings.designs_faulty = !next->problems.empty();
  LogLine line;
  if (!is_first || !next->sheets.empty()) {
    line.level = LogLine::Level::info;
    line.text.printf("design sheets of %zu slabs are in use", next->sheets.size());
    say(line);
  }
  if (next->problems.empty()) return;
  line.level = LogLine::Level::warning;
  line.text.printf("%zu faults in the design sheets; a file with a fault is not used: %s", next->problems.size(),
                   next->problems.front().text.c_str());
  say(line);
}

/// Loads new recipes between two slabs, once the last slab is finished.
void Loop::apply_reloaded_recipes() {
  Station& s = *station_;
  LogLine line;
  if (const bool differs = ports_.recipes->differs(); recipes_differ_.is_news(differs)) {
    line.level = differs ? LogLine::Level::warning : LogLine::Level::info;
    line.text = differs ? ports_.recipes->words() : RecipeWatch::Text("the recipe folder holds what is in use");
    say(line);
  }
  if (ports_.recipes->next_note(line.text)) {
    line.level = LogLine::Level::warning;
    say(line);
  }
  std::shared_ptr<const RecipeSet> next = ports_.recipes->checked();
  if (next == nullptr) return;
  const bool idle = s.recovered && s.settings.fault == Code::ok && s.slab.phase == SlabPhase::none &&
                    !s.command.pending && s.acquisition.phase == Acquisition::Phase::none && s.measuring == 0 &&
                    std::none_of(s.slot_busy.begin(), s.slot_busy.end(), [](bool busy) { return busy; });
  if (!idle) {
    const Code fault = s.settings.fault;
    // The store is opened again in intervals, and the other daemon is looked for: these faults end without a restart.
    const bool only_restart_clears = fault == Code::config && !reopen_ns_ && !scanner_is_anothers_;
    if (fault != Code::ok)
      ports_.recipes->refuse(reload_refused_by(fault, only_restart_clears).view());
    else
      ports_.recipes->refuse(
          "a slab is open, or a scan or a measurement of one is under way; the recipes in use stay in force until it "
          "has ended");
    return;
  }
  s.slab.recipe = nullptr;
  s.settings.recipes = next->recipes;
  s.settings.warn = static_cast<std::uint16_t>(s.settings.warn & ~(kWarnUnconfirmedNominals | kWarnRecipeUnusable));
  for (const Recipe& recipe : next->recipes)
    if (unconfirmed_count(recipe) > 0) s.settings.warn |= kWarnUnconfirmedNominals;
  workers_->use_recipes(next->recipes);
  if (ports_.store != nullptr) ports_.store->use_recipes(next->texts);
  recipes_in_use_ = next;
  ports_.recipes->taken_up();
  line.level = LogLine::Level::info;
  line.text.printf("%zu recipes were taken up; the next slab begins with them", next->recipes.size());
  say(line);
  line.level = LogLine::Level::warning;
  for (const AlikeRecipes& alike : alike_recipes(next->recipes)) {
    line.text = text_of(alike);
    say(line);
  }
}

void Loop::say_of(std::size_t arm, LogLine line) const {
  if (line_arms_.several()) {
    const Arm& by = line_arms_.list[arm];
    const FixedString<limits::kErrorTextBytes> text = line.text;
    line.text.printf("robot %s, scanner %s: %s", by.robot.c_str(), by.scanner.c_str(), text.c_str());
  }
  say(line);
}

void Loop::log_pose_changes(std::size_t arm) {
  const std::int64_t now_ns = ports_.clock.mono_ns();
  const PoseGate& gate = station_->arms[arm].gate;
  LoopArm& seen = arms_[arm];
  const Code code = gate.link(now_ns);
  if (code != seen.pose_link.seen()) {
    if (code == Code::pose_stale) ++figures_.poses[arm].stale;
    if (code == Code::wrong_frame) ++figures_.poses[arm].wrong_frame;
  }
  LogLine line;
  if (seen.pose_link.is_news(code, now_ns, {.lasts_ns = kNsPerS})) {
    line.level = code == Code::ok ? LogLine::Level::info : LogLine::Level::warning;
    line.code = static_cast<std::uint16_t>(code);
    if (code == Code::ok) {
      line.text = "robot poses arrive";
    } else {
      line.text.printf("robot pose: %s; %s", describe(code).data(), cure(code).data());
    }
    say_of(arm, line);
  }
  line.code = 0;
  line.level = LogLine::Level::warning;
  if (!seen.commanded_said && code == Code::ok && figures_.pose_type == hal::PoseType::flange_pose &&
      !gate.newest()->measured) {
    seen.commanded_said = true;
    line.text =
        "the robot marks its poses as commanded (flags, bit 0); a commanded pose can differ from the real one; send "
        "the measured ones (docs/ROBOT.md)";
    say_of(arm, line);
  }
  if (ports_.pose_of(arm).next_note(now_ns, line.text)) say_of(arm, line);
}

void Loop::log_scanner_changes(std::size_t arm) {
  hal::ScannerPort& scanner = ports_.scanner_of(arm);
  const bool online = scanner.online();
  LogLine line;
  // At the start the port's first look is still in progress.
  if (arms_[arm].scanner_online.is_news(online, ports_.clock.mono_ns(),
                                        {.lasts_ns = kScannerNews_ns, .apart_ns = kScannerNewsPeriod_ns})) {
    line.level = online ? LogLine::Level::info : LogLine::Level::warning;
    const Code why_not = scanner.spool_hangs() ? Code::journal_write : Code::scanner_offline;
    line.code = static_cast<std::uint16_t>(online ? Code::ok : why_not);
    const hal::ScannerText why = scanner.trouble();
    line.text.printf("%s%s%s", online ? "the scanner is available again" : "the scanner is not available",
                     online || why.empty() ? "" : ": ", online ? "" : why.c_str());
    say_of(arm, line);
  }
  line.code = 0;
  line.level = LogLine::Level::warning;
  if (scanner.next_note(line.text)) say_of(arm, line);
}

void Loop::log_plc_changes() {
  LogLine line;
  const std::int64_t now_ns = ports_.clock.mono_ns();
  const std::string_view trouble = ports_.plc.trouble();
  if (plc_trouble_.is_news(trouble, now_ns, {.lasts_ns = kPlcNews_ns, .late_ns = kPlcNewsPeriod_ns})) {
    line.level = trouble.empty() ? LogLine::Level::info : LogLine::Level::error;
    line.text = trouble.empty() ? "PLC link is up" : trouble;
    say(line);
  }
  if (!ports_.plc.next_note(now_ns, line.text)) return;
  line.level = LogLine::Level::warning;
  say(line);
}

}  // namespace slabd::daemon
