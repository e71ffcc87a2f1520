// SPDX-License-Identifier: Apache-2.0
//
// The screen must be readable from three metres within a second. Therefore the blocks are first and large, every link
// has one word, and the cure is next to the fault. Data that may be outdated is grey. Colour only repeats symbol and
// word.
#include "cli/watch/screen.h"

#include <fmt/core.h>

#include <algorithm>
#include <cmath>

#include "base/plain_text.h"
#include "cli/watch/letters.h"
#include "report/findings.h"

namespace slabd::cli::watch {
namespace {

using report::Language;
using report::verdict_word;

constexpr std::string_view kRed = "1;31";
constexpr std::string_view kGreen = "32";
constexpr std::string_view kYellow = "33";
constexpr std::string_view kBold = "1";
constexpr std::string_view kFaint = "2";
constexpr std::string_view kInverse = "7";
/// Columns of the map with symbols, words and links; a narrower screen has a shorter form.
constexpr std::size_t kColumnsFull = 80;

struct Piece {
  std::string text;
  std::string_view sgr;
};
using Line = std::vector<Piece>;

std::string_view colour_of(Verdict verdict) {
  switch (verdict) {
    case Verdict::pass: return kGreen;
    case Verdict::fail: return kRed;
    case Verdict::indeterminate: return kYellow;
    case Verdict::not_measured:
    case Verdict::aborted: return "35";
    case Verdict::none: break;
  }
  return kFaint;
}

/// The beginning of `text` that fits.
std::string cut(const std::string& text, std::size_t columns) {
  if (report::display_width(text) <= columns) return text;
  std::string out;
  for (std::size_t at = 0; at < text.size();) {
    std::size_t end = at + 1;
    while (end < text.size() && (static_cast<unsigned char>(text[end]) & 0xC0U) == 0x80U) ++end;
    if (report::display_width(out) + report::display_width(text.substr(at, end - at)) > columns) break;
    out += text.substr(at, end - at);
    at = end;
  }
  return out;
}

std::string padded(std::string text, std::size_t columns) {
  const std::size_t width = report::display_width(text);
  if (width < columns) text.append(columns - width, ' ');
  return cut(text, columns);
}

class Composer {
 public:
  Composer(const Picture& picture, std::size_t columns, std::size_t rows, report::Style style, Language language)
      : p_(picture),
        columns_(columns),
        rows_(rows),
        style_(style),
        zh_(language == Language::zh),
        language_(language) {}

  std::vector<std::string> compose() {
    header();
    verdict();
    if (is_narrow())
      lists();
    else
      map();
    findings();
    today();
    links();
    trouble();
    past();
    while (lines_.size() + 1 < rows_) lines_.emplace_back();
    lines_.resize(rows_ - 1);
    add({{say("q quit   l language", "q 退出   l 语言"), kFaint}});
    std::vector<std::string> out;
    for (const Line& line : lines_) out.push_back(render(line));
    return out;
  }

 private:
  [[nodiscard]] std::string say(std::string_view en, std::string_view zh) const { return std::string(zh_ ? zh : en); }
  /// Removes control characters, because texts come from the daemon's answer and from the database.
  void add(Line line) {
    for (Piece& piece : line) piece.text = plain(piece.text);
    lines_.push_back(std::move(line));
  }

  [[nodiscard]] std::string render(const Line& line) const {
    std::string out;
    std::size_t left = columns_;
    for (const Piece& piece : line) {
      const std::string text = cut(piece.text, left);
      left -= std::min(left, report::display_width(text));
      // Data that may be outdated is not coloured.
      const std::string_view sgr = p_.stale() && piece.sgr != kInverse ? kFaint : piece.sgr;
      out += sgr.empty() ? text : report::coloured(text, sgr, style_);
    }
    return out;
  }

  void header() {
    if (p_.stale()) {
      const std::string age = has_value(p_.age_s) ? say("STALE: last answer ", "数据过期：最后应答于 ") +
                                                        age_text(p_.age_s, language_) + say(" ago", "前")
                                                  : say("NO ANSWER from slabd", "slabd 无应答");
      add({{padded(" " + age + "  " + p_.trouble, columns_), kInverse}});
    } else {
      add({{p_.clock.empty() || is_narrow() ? std::string() : p_.clock + "  ", kBold},
           {p_.software + "  ", kBold},
           {p_.state, p_.fault != 0 ? kRed : kBold},
           {say("   up ", "   已运行 ") + age_text(p_.uptime_s, language_) + say("   age ", "   数据 ") +
                age_text(p_.age_s, language_),
            {}}});
    }
    std::string about = p_.slab.empty()
                            ? (p_.past_trouble.empty() ? say("no slab yet", "尚无轨道板") : std::string())
                            : (p_.slab_open ? say("slab ", "轨道板 ") : say("last slab ", "上一块板 ")) + p_.slab;
    if (p_.slab_open)
      about += fmt::format("   {} {}/{}", say("scanned", "已扫描"), p_.stations_done, p_.stations.size());
    if (p_.current_station != 0) about += fmt::format("   {} {}", say("now block", "当前承轨台"), p_.current_station);
    if (!p_.recipe.empty()) about += fmt::format("   {} {}", say("recipe", "配方"), p_.recipe);
    if (has_value(p_.map_age_s))
      about += fmt::format("   {} {}", say("age", "数据"), age_text(p_.map_age_s, language_));
    add({{about, kBold}});
    if (!p_.emulation.empty()) add({{padded(" " + p_.emulation, columns_), kInverse}});
    if (p_.past_trouble.empty() && p_.emulation.empty()) add({});
    if (!p_.past_trouble.empty())
      add({{say(" ! slabs cannot be read: ", " ! 无法读取轨道板记录：") + p_.past_trouble, kYellow}});
  }

  [[nodiscard]] bool is_narrow() const { return columns_ < kColumnsFull; }
  [[nodiscard]] bool is_tall() const { return rows_ >= 34; }

  /// Adds a text on as many lines as it needs, at most `lines_max`.
  void add_broken(const std::string& text, std::string_view sgr, std::size_t lines_max) {
    std::string rest = text;
    for (std::size_t line = 0; line < lines_max && !rest.empty(); ++line) {
      std::string part = cut(rest, columns_);
      if (part.size() < rest.size() && line + 1 < lines_max)
        if (const std::size_t blank = part.rfind(' '); blank != std::string::npos && blank > columns_ / 2)
          part.resize(blank);
      rest.erase(0, part.size());
      rest.erase(0, rest.find_first_not_of(' '));
      if (!rest.empty()) rest.insert(0, "   ");
      add({{part, sgr}});
    }
  }

  /// The verdict of the slab that ended, as large as the screen allows.
  void verdict() {
    if (p_.verdict == Verdict::none) return;
    band_ = fmt::format("7;{}", colour_of(p_.verdict));
    const std::string word(verdict_word(p_.verdict, language_));
    const auto large = large_letters(word);
    const std::size_t width = large.front().size();
    if (is_tall() && width > 0 && width + 4 <= columns_) {
      add({{padded("", columns_), band_}});
      for (const std::string& row : large) add({{centred(row), band_}});
      add({{padded("", columns_), band_}});
    } else {
      const std::size_t rows = rows_ >= 30 ? 3 : 1;
      for (std::size_t row = 0; row < rows; ++row)
        add({{row == rows / 2 ? centred(fmt::format("{} {}", report::symbol(p_.verdict, style_), word))
                              : padded("", columns_),
              band_}});
    }
    if (!is_narrow()) add({});
  }
  [[nodiscard]] std::string centred(const std::string& text) const {
    const std::size_t width = report::display_width(text);
    const std::size_t left = width < columns_ ? (columns_ - width) / 2 : 0;
    return padded(std::string(left, ' ') + text, columns_);
  }

  /// The blocks of each verdict by number, for a screen that is too narrow for the map.
  void lists() {
    for (const Verdict verdict : {Verdict::fail, Verdict::indeterminate, Verdict::not_measured, Verdict::aborted}) {
      std::vector<int> stations;
      for (std::size_t i = 0; i < p_.stations.size(); ++i)
        if (p_.stations[i] == verdict) stations.push_back(static_cast<int>(i + 1));
      if (!stations.empty())
        add_broken(fmt::format(" {} {}: {}", report::symbol(verdict, style_), verdict_word(verdict, language_),
                               report::ranges_text(stations)),
                   colour_of(verdict), 2);
    }
    const auto passed = std::count(p_.stations.begin(), p_.stations.end(), Verdict::pass);
    if (!p_.stations.empty())
      add({{fmt::format(" {} {}: {} / {}", report::symbol(Verdict::pass, style_),
                        verdict_word(Verdict::pass, language_), passed, p_.stations.size()),
            kGreen}});
  }

  /// Reasons with value and limits.
  void findings() {
    const std::size_t lines_max = rows_ >= 50 ? 12 : is_tall() ? 6 : 3;
    const std::size_t shown = p_.findings.size() > lines_max ? lines_max - 1 : p_.findings.size();
    for (std::size_t i = 0; i < shown; ++i)
      add_broken(fmt::format(" {} {}", report::symbol(p_.findings[i].first, style_), p_.findings[i].second),
                 colour_of(p_.findings[i].first), is_narrow() ? 3 : 1);
    if (shown < p_.findings.size())
      add({{fmt::format("   {} {}", say("more findings:", "其他问题："), p_.findings.size() - shown), kFaint}});
  }

  void today() {
    const Today& day = p_.today;
    if (day.slabs == 0) return;
    std::string text =
        fmt::format(" {} {} {}, {} {} ({:.0f} %)", say("today", "今日"), day.slabs, say("slabs", "块板"), day.passed,
                    say("passed", "合格"), 100.0 * static_cast<double>(day.passed) / static_cast<double>(day.slabs));
    if (has_value(day.takt_s)) text += fmt::format("  {} {}", say("takt", "节拍"), age_text(day.takt_s, language_));
    for (std::size_t i = 0; i < day.reasons.size(); ++i)
      text += fmt::format("{}{} x {}", i == 0 ? "  " : ", ", day.reasons[i].second, day.reasons[i].first);
    add_broken(text, kBold, is_narrow() ? 3 : 1);
    if (rows_ >= 30) add({});
  }

  void map() {
    const std::size_t pairs = p_.stations.size() / 2;
    if (pairs == 0) return;
    // A tile: number and symbol; three rows high if there is room.
    const std::size_t tile = std::clamp<std::size_t>((columns_ - 8) / pairs, 6, 16);
    const bool tall = is_tall();
    for (const bool left : {true, false}) {
      for (std::size_t row = 0; row < (tall ? 3U : 1U); ++row) {
        Line line = {{padded(row == (tall ? 1U : 0U) ? (left ? " Y > 0" : " Y < 0") : "", 8), kFaint}};
        for (std::size_t column = 0; column < pairs; ++column) {
          const std::size_t station = left ? column + 1 : 2 * pairs - column;
          const Verdict verdict = p_.stations[station - 1];
          const bool now = p_.current_station == static_cast<int>(station);
          std::string text;
          if (!tall || row == 1)
            text =
                fmt::format("{}{:>2} {}{}", now ? '[' : ' ', station, report::symbol(verdict, style_), now ? ']' : ' ');
          else if (row == 2 && verdict != Verdict::none)
            text = " " + std::string(verdict_word(verdict, language_));
          line.push_back({padded(std::move(text), tile), !p_.past_trouble.empty() ? kFaint
                                                         : now                    ? kBold
                                                                                  : colour_of(verdict)});
        }
        add(std::move(line));
      }
    }
    Line legend = {{"        ", {}}};
    for (const Verdict verdict : {Verdict::pass, Verdict::fail, Verdict::indeterminate, Verdict::not_measured})
      legend.push_back({fmt::format("{} {}   ", report::symbol(verdict, style_), verdict_word(verdict, language_)),
                        colour_of(verdict)});
    add(std::move(legend));
    add({});
  }

  [[nodiscard]] std::string name_of(Link link) const {
    switch (link) {
      case Link::plc: return say("PLC", "PLC");
      case Link::robot: return say("robot", "机器人");
      case Link::scanner: return say("scanner", "扫描仪");
      case Link::store: return say("database", "数据库");
      case Link::calibration: return say("calibration", "标定");
      case Link::tie: return say("robots tied", "基座关联");
    }
    return "";
  }

  void links() {
    for (const LinkState& state : p_.links) {
      Line line = {
          {padded(" " + name_of(state.link) + (state.part.empty() ? "" : " " + state.part),
                  state.part.empty() ? 14 : 18),
           {}},
          {padded(fmt::format("{} {}", report::symbol(state.ok ? Verdict::pass : Verdict::fail, style_), state.word),
                  16),
           state.ok ? kGreen : kRed}};
      if (!is_narrow())
        line.push_back({padded(fmt::format("{}{}", state.at_least ? say("for > ", "已 > ") : say("for ", "已 "),
                                           age_text(state.for_s, language_)),
                               14),
                        kFaint});
      const bool fits = (state.part.empty() ? 44 : 48) + 3 + report::display_width(state.cure) <= columns_;
      const bool has_cure = !state.ok && !state.cure.empty();
      if (has_cure && fits) line.push_back({"-> " + state.cure, kBold});
      add(std::move(line));
      if (has_cure && !fits) add_broken("   -> " + state.cure, kBold, is_narrow() ? 3 : 1);
    }
    add({});
  }

  void trouble() {
    if (p_.fault != 0) {
      add({{fmt::format(" {} {}: {}", say("FAULT", "故障"), p_.fault, p_.fault_text), kRed}});
      add({{"  -> " + p_.fault_cure, kBold}});
    }
    // At least two; more if the list of past slabs still has room.
    const std::size_t room = rows_ > 30 ? p_.warnings.size() : 2;
    for (std::size_t i = 0; i < std::min(room, p_.warnings.size()); ++i) {
      std::string text = " ! " + p_.warnings[i];
      if (i + 1 == room && p_.warnings.size() > room) text += fmt::format("  (+{})", p_.warnings.size() - room);
      add({{text, kYellow}});
    }
    if (p_.fault != 0 || !p_.warnings.empty()) add({});
  }

  void past() {
    for (const PastSlab& slab : p_.past) {
      if (lines_.size() + 1 >= rows_) break;
      const std::string verdict =
          slab.verdict == Verdict::none
              ? say(". open", ". 未结束")
              : fmt::format("{} {}", report::symbol(slab.verdict, style_), verdict_word(slab.verdict, language_));
      add({{padded(fmt::format(" {:>6} {}", slab.number, slab.id), std::min<std::size_t>(30, columns_ / 3)), {}},
           {" " + padded(verdict, 17), colour_of(slab.verdict)},
           {padded(slab.verdict == Verdict::none ? "" : age_text(slab.age_s, language_) + say(" ago", "前"), 12),
            kFaint},
           {std::string(report::emulation_mark(slab.emulated, language_)) + (slab.emulated != 0 ? "  " : ""), kBold},
           {report::reason_sentence(slab.reason, language_), {}}});
    }
  }

  const Picture& p_;
  std::size_t columns_;
  std::size_t rows_;
  report::Style style_;
  bool zh_;
  Language language_;
  std::string band_;  ///< SGR of the verdict's band; the lines refer to it
  std::vector<Line> lines_;
};

}  // namespace

std::string age_text(double age_s, Language language) {
  if (!std::isfinite(age_s)) return "?";
  const bool zh = language == Language::zh;
  const double age = std::max(age_s, 0.0);
  if (age < 100.0) return fmt::format("{:.0f} {}", std::floor(age), zh ? "秒" : "s");
  if (age < 6'000.0) return fmt::format("{:.0f} {}", std::floor(age / 60.0), zh ? "分钟" : "min");
  if (age < 172'800.0) return fmt::format("{:.0f} {}", std::floor(age / 3'600.0), zh ? "小时" : "h");
  return fmt::format("{:.0f} {}", std::floor(age / 86'400.0), zh ? "天" : "d");
}

std::vector<std::string> screen(const Picture& picture, std::size_t columns, std::size_t rows, report::Style style,
                                report::Language language) {
  return Composer(picture, std::max<std::size_t>(columns, 20), std::max<std::size_t>(rows, 4), style, language)
      .compose();
}

}  // namespace slabd::cli::watch
