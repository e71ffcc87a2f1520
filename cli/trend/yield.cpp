// SPDX-License-Identifier: Apache-2.0
#include "cli/trend/yield.h"

#include <fmt/core.h>

#include <algorithm>
#include <cstdio>
#include <ctime>

#include "report/figures.h"

namespace slabd::cli::trend {
namespace {

using report::Anchor;
using report::Canvas;
using report::Colour;
using report::Language;
using report::pick;
using report::TextStyle;

constexpr Colour kInk{0.12, 0.25, 0.42};
constexpr Colour kBar{0.36, 0.53, 0.72};
constexpr Colour kFailed{0.62, 0.05, 0.10};
constexpr double kLeft_mm = 14.0;
constexpr double kWidth_mm = 152.0;
constexpr double kTop_mm = 4.0;
constexpr double kHeight_mm = 56.0;

std::tm local_parts(std::int64_t utime_us) {
  const auto seconds = static_cast<std::time_t>(utime_us / 1'000'000);
  std::tm parts{};
  localtime_r(&seconds, &parts);
  return parts;
}

std::string day_text(const std::tm& parts) {
  return fmt::format("{:04}-{:02}-{:02}", parts.tm_year + 1900, parts.tm_mon + 1, parts.tm_mday);
}

std::string clock_text(int minutes) {
  return fmt::format("{:02}:{:02}", minutes / 60, minutes % 60);
}

std::string shift_name(std::int64_t utime_us, const Shifts& shifts) {
  std::tm parts = local_parts(utime_us);
  const int minute = parts.tm_hour * 60 + parts.tm_min;
  std::size_t shift = shifts.size();  // the last one of the day before
  for (std::size_t i = 0; i < shifts.size(); ++i)
    if (shifts[i] <= minute) shift = i;
  if (shift == shifts.size()) {
    shift = shifts.size() - 1;
    --parts.tm_mday;  // mktime() makes a valid date of it, also in the hour of a clock change
    parts.tm_hour = 12;
    parts.tm_isdst = -1;
    static_cast<void>(std::mktime(&parts));
  }
  return fmt::format("{} {}-{}", day_text(parts), clock_text(shifts[shift]),
                     clock_text(shifts[(shift + 1) % shifts.size()]));
}

void count(YieldGroup& group, const storage::Inspection& slab) {
  ++group.inspected;
  switch (slab.verdict) {
    case Verdict::pass: ++group.passed; break;
    case Verdict::fail: ++group.failed; break;
    case Verdict::indeterminate: ++group.undecided; break;
    case Verdict::not_measured:
    case Verdict::none:
    case Verdict::aborted: ++group.not_measured; break;
  }
  if (slab.verdict != Verdict::pass) ++group.reasons[slab.reason];
}

void frame(Canvas& canvas) {
  canvas.rectangle(kLeft_mm, kTop_mm, kWidth_mm, kHeight_mm, std::nullopt, report::kGrey, 0.15);
}

double y_of(double share) {
  return kTop_mm + kHeight_mm * (1.0 - share);
}

void percent_scale(Canvas& canvas, double x, Anchor anchor) {
  for (int percent = 0; percent <= 100; percent += 20)
    canvas.text(x, y_of(0.01 * percent) + 0.8, fmt::format("{} %", percent), {5.5, false, report::kGrey, anchor});
}

/// Name below a bar, on as many lines as it needs.
void bar_name(Canvas& canvas, double x, double width, const std::string& name) {
  canvas.paragraph(x + 0.4, kTop_mm + kHeight_mm + 1.0, width - 0.8, name, {5.5, false, report::kBlack, Anchor::left},
                   false, 14.0);
}

}  // namespace

Result<Shifts> parse_shifts(const std::string& text) {
  Shifts shifts;
  std::size_t at = 0;
  while (at <= text.size()) {
    const std::size_t end = std::min(text.find(',', at), text.size());
    const std::string part = text.substr(at, end - at);
    int hour = 0;
    int minute = 0;
    int read = 0;
    const bool is_time = std::sscanf(part.c_str(), "%2d:%2d%n", &hour, &minute, &read) == 2 &&
                         static_cast<std::size_t>(read) == part.size() && hour >= 0 && hour < 24 && minute >= 0 &&
                         minute < 60;
    if (!is_time || (!shifts.empty() && shifts.back() >= hour * 60 + minute))
      return error(Code::config, "\"%s\": begins of the shifts such as 06:00,14:00,22:00, rising", text.c_str());
    shifts.push_back(hour * 60 + minute);
    at = end + 1;
  }
  return shifts;
}

std::vector<YieldGroup> first_pass_yield(const std::vector<storage::Inspection>& inspections, GroupBy by,
                                         const Shifts& shifts) {
  std::vector<YieldGroup> groups;
  std::map<std::string, std::size_t> by_name;
  for (const storage::Inspection& slab : inspections) {
    const std::string name = by == GroupBy::type    ? std::to_string(slab.slab_type)
                             : by == GroupBy::mould ? std::to_string(slab.mould)
                             : by == GroupBy::shift ? shift_name(slab.began_utime_us, shifts)
                                                    : day_text(local_parts(slab.began_utime_us));
    const auto [found, is_new] = by_name.try_emplace(name, groups.size());
    if (is_new) groups.emplace_back().name = name;
    YieldGroup& group = groups[found->second];
    if (slab.verdict == Verdict::aborted) {
      ++group.aborted;
    } else if (slab.again) {
      ++group.again;
    } else {
      count(group, slab);
    }
  }
  for (YieldGroup& group : groups) group.yield = study::share_of(group.passed, group.inspected);
  if (by == GroupBy::type || by == GroupBy::mould)
    std::ranges::sort(groups, {}, [](const YieldGroup& group) { return std::stoi(group.name); });
  return groups;
}

YieldGroup total_of(const std::vector<YieldGroup>& groups) {
  YieldGroup total;
  for (const YieldGroup& group : groups) {
    total.inspected += group.inspected;
    total.passed += group.passed;
    total.failed += group.failed;
    total.undecided += group.undecided;
    total.not_measured += group.not_measured;
    total.aborted += group.aborted;
    total.again += group.again;
    for (const auto& [reason, times] : group.reasons) total.reasons[reason] += times;
  }
  total.yield = study::share_of(total.passed, total.inspected);
  return total;
}

report::Figure yield_figure(const std::vector<YieldGroup>& groups, Language language) {
  constexpr std::size_t kGroupsMax = 40;
  const std::size_t first = groups.size() - std::min(groups.size(), kGroupsMax);
  const std::vector<YieldGroup> shown(groups.begin() + static_cast<std::ptrdiff_t>(first), groups.end());
  report::Figure result;
  result.width_mm = 180.0;
  result.height_mm = 78.0;
  result.title = pick(language, "First-pass yield with 95 % interval", "一次合格率与 95 % 区间");
  if (first > 0)
    result.title += fmt::format(fmt::runtime(pick(language, ", the last {}", "，最近 {} 组")), shown.size());
  result.alt = result.title + ":";
  for (const YieldGroup& group : shown)
    result.alt += fmt::format(" {}: {} / {};", group.name, group.passed, group.inspected);
  result.draw = [shown](Canvas& canvas) {
    frame(canvas);
    percent_scale(canvas, kLeft_mm - 1.0, Anchor::right);
    const double pitch = kWidth_mm / static_cast<double>(std::max<std::size_t>(shown.size(), 1));
    for (std::size_t i = 0; i < shown.size(); ++i) {
      const YieldGroup& group = shown[i];
      const double x = kLeft_mm + pitch * static_cast<double>(i);
      if (pitch >= 9.0 || i == 0 || i + 1 == shown.size()) {
        if (pitch >= 9.0)
          bar_name(canvas, x, pitch, group.name.size() > 8 ? group.name.substr(5) : group.name);  // without the year
        else
          canvas.text(i == 0 ? x : x + pitch, kTop_mm + kHeight_mm + 3.0, group.name,
                      {5.5, false, report::kBlack, i == 0 ? Anchor::left : Anchor::right});
      }
      if (!has_value(group.yield.value)) continue;
      const double middle = x + 0.5 * pitch;
      const double wide = std::min(0.6 * pitch, 14.0);
      const double y = y_of(group.yield.value);
      canvas.rectangle(middle - 0.5 * wide, y, wide, kTop_mm + kHeight_mm - y, kBar, report::kBlack, 0.1);
      canvas.line(middle, y_of(group.yield.low), middle, y_of(group.yield.high), 0.3, kInk);
      for (const double end : {group.yield.low, group.yield.high})
        canvas.line(middle - 0.8, y_of(end), middle + 0.8, y_of(end), 0.3, kInk);
      if (pitch >= 9.0)
        canvas.text(middle, kTop_mm + kHeight_mm - 1.2, fmt::format("{}/{}", group.passed, group.inspected),
                    {5.5, true, report::kWhite, Anchor::centre});
    }
  };
  return result;
}

report::Figure pareto_figure(std::vector<ParetoBar> bars, Language language) {
  constexpr std::size_t kBarsMax = 12;
  const auto size = [](const ParetoBar& bar) { return bar.failed + bar.others; };
  std::ranges::stable_sort(bars, std::greater(), size);
  if (bars.size() > kBarsMax) {
    ParetoBar rest{pick(language, "all others", "其他")};
    for (std::size_t i = kBarsMax - 1; i < bars.size(); ++i) {
      rest.failed += bars[i].failed;
      rest.others += bars[i].others;
    }
    bars.resize(kBarsMax - 1);
    bars.push_back(rest);
  }
  report::Figure result;
  result.width_mm = 180.0;
  result.height_mm = 84.0;
  result.title = pick(language, "Pareto of the reasons", "原因帕累托图");
  result.alt = result.title + ":";
  for (const ParetoBar& bar : bars) result.alt += fmt::format(" {}: {};", bar.name, size(bar));
  result.draw = [bars, size, language](Canvas& canvas) {
    frame(canvas);
    std::size_t total = 0;
    for (const ParetoBar& bar : bars) total += size(bar);
    if (total == 0) return;
    percent_scale(canvas, kLeft_mm + kWidth_mm + 1.0, Anchor::left);
    for (int quarter = 0; quarter <= 4; ++quarter)
      canvas.text(kLeft_mm - 1.0, y_of(0.25 * quarter) + 0.8,
                  std::to_string(total * static_cast<std::size_t>(quarter) / 4),
                  {5.5, false, report::kGrey, Anchor::right});
    const double pitch = kWidth_mm / static_cast<double>(bars.size());
    std::size_t sum = 0;
    double y_before = y_of(0.0);
    for (std::size_t i = 0; i < bars.size(); ++i) {
      const double x = kLeft_mm + pitch * static_cast<double>(i);
      const double failed = static_cast<double>(bars[i].failed) / static_cast<double>(total);
      const double all = static_cast<double>(size(bars[i])) / static_cast<double>(total);
      canvas.rectangle(x + 0.1 * pitch, y_of(all), 0.8 * pitch, y_of(failed) - y_of(all), report::kPaleGrey,
                       report::kBlack, 0.1);
      canvas.rectangle(x + 0.1 * pitch, y_of(failed), 0.8 * pitch, y_of(0.0) - y_of(failed), kFailed, report::kBlack,
                       0.1);
      canvas.text(x + 0.5 * pitch, y_of(all) - 0.8, std::to_string(size(bars[i])),
                  {6.0, true, report::kBlack, Anchor::centre});
      bar_name(canvas, x, pitch, bars[i].name);
      sum += size(bars[i]);
      const double y = y_of(static_cast<double>(sum) / static_cast<double>(total));
      canvas.line(i == 0 ? kLeft_mm : x, y_before, x + pitch, y, 0.3, kInk);
      canvas.circle(x + pitch, y, 0.6, kInk);
      y_before = y;
    }
    const TextStyle small{6.0, false, report::kBlack, Anchor::left};
    double x = kLeft_mm;
    const auto legend = [&](const std::optional<Colour>& colour, const std::string& text) {
      canvas.rectangle(x, 78.5, 2.4, 2.4, colour, report::kBlack, 0.1);
      canvas.text(x + 3.6, 80.6, text, small);
      x += canvas.text_width(text, small) + 9.0;
    };
    legend(kFailed, pick(language, "failed", "不合格"));
    legend(report::kPaleGrey, pick(language, "undecided or not measured", "无法判定或未测量"));
    canvas.line(x, 79.7, x + 3.0, 79.7, 0.3, kInk);
    canvas.text(x + 4.2, 80.6, pick(language, "cumulative share", "累计占比"), small);
  };
  return result;
}

}  // namespace slabd::cli::trend
