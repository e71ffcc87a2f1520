// SPDX-License-Identifier: Apache-2.0
//
// Results of a study as pages: a table of figures and charts of them. The figures are those of the terminal and of the
// JSON.
#include "cli/study/study_report.h"

#include <fmt/core.h>

#include <algorithm>
#include <array>
#include <cmath>

#include "cli/exit.h"
#include "cli/study/charts.h"
#include "cli/terminal/arguments.h"
#include "report/figures.h"

namespace slabd::cli::study {
namespace {

using report::Canvas;
using report::Figure;
using report::Figures;
using report::Language;
using report::pick;
using report::Section;

std::string word_of(const std::string& item, Language language) {
  const auto id = item_from_name(item);
  return id ? fmt::format("{} [{}]", report::item_word(*id, language), unit_of(item)) : item;
}

report::Report document(Language language, std::string title, std::string subject) {
  report::Report made;
  made.language = language;
  made.judged = false;
  made.title = std::move(title);
  made.subject = std::move(subject);
  return made;
}

constexpr double kWide_mm = 180.0;
constexpr int kSmallDigits = 5;

// ---- repeats -------------------------------------------------------------------------------------------------------

/// Chart of one block: its values over the runs. `c` is copied, so a figure may outlive the study.
Figure run_chart(const Characteristic& c, Language language) {
  Figure chart;
  chart.title = fmt::format("{}, {} {}", word_of(c.about.item, language), pick(language, "block", "承轨台"),
                            block_text(c.about.block, c.about.block_to));
  const int digits = decimals_of(c.about.item) + 1;
  chart.alt = fmt::format("{}: n = {}, {} {}, s {}", chart.title, c.spread.count, pick(language, "mean", "平均值"),
                          report::figure(c.spread.mean, digits), report::figure(c.spread.std, kSmallDigits));
  chart.width_mm = kWide_mm;
  chart.height_mm = 52.0;
  chart.draw = [c, digits, language](Canvas& canvas) {
    Chart plot(20.0, 2.0, 136.0, 44.0);
    const auto n = static_cast<double>(c.values.size());
    plot.include_x(1.0);
    plot.include_x(n);
    for (const double value : c.values) plot.include_y(value);
    plot.include_y(c.spread.mean - 3.0 * c.spread.std);
    plot.include_y(c.spread.mean + 3.0 * c.spread.std);
    plot.include_y(c.gauge.reference);
    plot.settle();
    plot.frame(canvas);
    plot.scales(canvas, -1, digits);
    plot.level(canvas, c.spread.mean, pick(language, "mean", "平均值"), kChartInk, false);
    plot.level(canvas, c.spread.mean - 3.0 * c.spread.std, "- 3 s", kChartInk, true);
    plot.level(canvas, c.spread.mean + 3.0 * c.spread.std, "+ 3 s", kChartInk, true);
    plot.level(canvas, c.gauge.reference, pick(language, "reference", "参考值"), kChartLimit, false);
    for (std::size_t i = 0; i < c.values.size(); ++i)
      plot.point(canvas, static_cast<double>(i + 1), c.values[i], 0.7, kChartInk);
    plot.tick_x(canvas, 1.0, "1");
    plot.tick_x(canvas, n, std::to_string(c.values.size()));
  };
  return chart;
}

/// Chart of several blocks: all values of each at its index, with a bar from the smallest to the largest.
Figure block_chart(const std::vector<Characteristic>& of_item, Language language) {
  Figure chart;
  chart.title =
      fmt::format("{}, {}", word_of(of_item.front().about.item, language), pick(language, "all blocks", "全部承轨台"));
  const int digits = decimals_of(of_item.front().about.item) + 1;
  double worst = 0.0;
  for (const Characteristic& c : of_item)
    if (has_value(c.spread.range)) worst = std::max(worst, c.spread.range);
  chart.alt = fmt::format("{}: {} {}", chart.title, pick(language, "largest range", "最大极差"),
                          report::figure(worst, kSmallDigits));
  chart.width_mm = kWide_mm;
  chart.height_mm = 52.0;
  chart.draw = [of_item, digits](Canvas& canvas) {
    Chart plot(20.0, 2.0, 150.0, 44.0);
    plot.include_x(1.0);
    plot.include_x(static_cast<double>(of_item.size()));
    for (const Characteristic& c : of_item) {
      plot.include_y(c.spread.smallest);
      plot.include_y(c.spread.largest);
    }
    plot.settle();
    plot.frame(canvas);
    plot.scales(canvas, -1, digits);
    for (std::size_t i = 0; i < of_item.size(); ++i) {
      const Characteristic& c = of_item[i];
      const auto at = static_cast<double>(i + 1);
      plot.tick_x(canvas, at, block_text(c.about.block, c.about.block_to));
      if (c.spread.count == 0) continue;
      canvas.line(plot.x(at), plot.y(c.spread.smallest), plot.x(at), plot.y(c.spread.largest), 0.3, kChartInk);
      for (const double value : c.values) plot.point(canvas, at, value, 0.5, kChartInk);
    }
  };
  return chart;
}

// ---- gauge R&R -----------------------------------------------------------------------------------------------------

Figure component_bars(const GrrItem& item, Language language) {
  const bool by_tolerance = has_value(item.tolerance);
  Figure chart;
  chart.title = pick(language, by_tolerance ? "6 sigma, % of the tolerance" : "% of the total variation",
                     by_tolerance ? "6 sigma 占公差 %" : "占总变差 %");
  const Components c = item.by_anova.components;
  chart.alt =
      fmt::format("{}: GRR {:.1f}", chart.title, by_tolerance ? c.of_tolerance(item.tolerance) : c.of_variation());
  chart.width_mm = 86.0;
  chart.height_mm = 52.0;
  chart.draw = [c, by_tolerance, tolerance = item.tolerance](Canvas& canvas) {
    const std::array<std::pair<const char*, double>, 5> bars = {
        {{"EV", c.EV}, {"AV", c.AV}, {"INT", c.INT}, {"GRR", c.GRR}, {"PV", c.PV}}};
    double largest = 10.0;
    const auto percent = [&](double sigma) { return by_tolerance ? 600.0 * sigma / tolerance : 100.0 * sigma / c.TV; };
    for (const auto& [name, sigma] : bars) largest = std::max(largest, percent(sigma));
    constexpr double kLeft = 10.0;
    constexpr double kLength = 58.0;
    double y = 4.0;
    for (const auto& [name, sigma] : bars) {
      const double length = kLength * percent(sigma) / largest;
      canvas.text(kLeft - 1.5, y + 4.0, name, {6.5, false, report::kBlack, report::Anchor::right});
      canvas.rectangle(kLeft, y, std::max(length, 0.1), 6.0, kChartInk);
      canvas.text(kLeft + length + 1.0, y + 4.0, report::figure(percent(sigma), 1),
                  {6.0, false, report::kGrey, report::Anchor::left});
      y += 9.0;
    }
    for (const double limit : {10.0, 30.0})
      if (limit <= largest)
        canvas.line(kLeft + kLength * limit / largest, 2.0, kLeft + kLength * limit / largest, y, 0.25, kChartLimit,
                    true);
  };
  return chart;
}

/// Each appraiser's mean of each part less the part's mean: level lines of equal height mean agreement.
Figure appraiser_lines(const GrrItem& item, Language language) {
  Figure chart;
  chart.title = pick(language, "each appraiser's mean, less the part's", "各评价人均值与零件均值之差");
  chart.alt = chart.title;
  chart.width_mm = 92.0;
  chart.height_mm = 52.0;
  chart.draw = [study = item.crossed, names = item.appraisers,
                digits = decimals_of(item.about.item) + 1](Canvas& canvas) {
    Chart plot(16.0, 2.0, 58.0, 44.0);
    std::vector<std::vector<double>> off(study.appraisers, std::vector<double>(study.parts));
    for (std::size_t p = 0; p < study.parts; ++p) {
      double part = 0.0;
      for (std::size_t a = 0; a < study.appraisers; ++a) {
        for (std::size_t t = 0; t < study.trials; ++t)
          off[a][p] += study.at(p, a, t) / static_cast<double>(study.trials);
        part += off[a][p] / static_cast<double>(study.appraisers);
      }
      for (auto& of_appraiser : off) {
        of_appraiser[p] -= part;
        plot.include_y(of_appraiser[p]);
      }
    }
    plot.include_x(1.0);
    plot.include_x(static_cast<double>(study.parts));
    plot.settle();
    plot.frame(canvas);
    plot.scales(canvas, -1, digits);
    plot.tick_x(canvas, 1.0, "1");
    plot.tick_x(canvas, static_cast<double>(study.parts), std::to_string(study.parts));
    for (std::size_t a = 0; a < off.size(); ++a) {
      const report::Colour colour =
          report::scale_colour(0.85 * static_cast<double>(a) / static_cast<double>(off.size()));
      for (std::size_t p = 0; p < study.parts; ++p) {
        const auto at = static_cast<double>(p + 1);
        plot.point(canvas, at, off[a][p], 0.6, colour);
        if (p > 0) canvas.line(plot.x(at - 1.0), plot.y(off[a][p - 1]), plot.x(at), plot.y(off[a][p]), 0.2, colour);
      }
      if (a < 12)
        canvas.text(75.5, 5.0 + 3.5 * static_cast<double>(a), names[a], {5.5, false, colour, report::Anchor::left});
    }
  };
  return chart;
}

// ---- comparison with a laboratory ----------------------------------------------------------------------------------

Figure scatter_chart(const CompareItem& item, Language language) {
  Figure chart;
  chart.title = pick(language, "measured over reference", "实测值与参考值");
  chart.alt = fmt::format("{}: n = {}", chart.title, item.pairs.size());
  chart.width_mm = 86.0;
  chart.height_mm = 62.0;
  chart.draw = [pairs = item.pairs, line = item.line, digits = decimals_of(item.item), language](Canvas& canvas) {
    Chart plot(18.0, 2.0, 62.0, 50.0);
    for (const Pair& pair : pairs) {
      plot.include_x(pair.reference);
      plot.include_y(pair.value);
    }
    plot.settle();
    plot.frame(canvas);
    plot.scales(canvas, digits, digits);
    plot.line(canvas, 1.0, 0.0, report::kGrey, true);
    if (line.ok) plot.line(canvas, line.slope.value, line.intercept.value, kChartLimit, false);
    for (const Pair& pair : pairs) plot.point(canvas, pair.reference, pair.value, 0.7, kChartInk);
    canvas.text(18.0, 60.0,
                line.ok ? pick(language, "dashed: equal; line: Deming", "虚线：相等；实线：Deming 回归")
                        : pick(language, "dashed: equal; no line", "虚线：相等；无回归线"),
                {5.5, false, report::kGrey, report::Anchor::left});
  };
  return chart;
}

Figure difference_chart(const CompareItem& item, Language language) {
  Figure chart;
  chart.title = pick(language, "difference, with 95 % limits of agreement", "差值与 95 % 一致性界限");
  chart.alt = fmt::format("{}: {} .. {}", chart.title, report::figure(item.limits.lower.value, 4),
                          report::figure(item.limits.upper.value, 4));
  chart.width_mm = 92.0;
  chart.height_mm = 62.0;
  chart.draw = [pairs = item.pairs, limits = item.limits, mean = item.errors.mean.value,
                digits = decimals_of(item.item), language](Canvas& canvas) {
    Chart plot(18.0, 2.0, 56.0, 50.0);
    for (const Pair& pair : pairs) {
      plot.include_x(0.5 * (pair.reference + pair.value));
      plot.include_y(pair.value - pair.reference);
    }
    for (const double y : {limits.lower.low, limits.upper.high, 0.0}) plot.include_y(y);
    plot.settle();
    plot.frame(canvas);
    plot.scales(canvas, digits, digits + 1);
    plot.level(canvas, 0.0, "0", report::kGrey, true);
    plot.level(canvas, mean, pick(language, "mean", "平均值"), kChartInk, false);
    plot.level(canvas, limits.lower.value, "- 1.96 s", kChartLimit, false);
    plot.level(canvas, limits.upper.value, "+ 1.96 s", kChartLimit, false);
    for (const double edge : {limits.lower.low, limits.lower.high, limits.upper.low, limits.upper.high})
      plot.level(canvas, edge, "", kChartLimit, true);
    for (const Pair& pair : pairs)
      plot.point(canvas, 0.5 * (pair.reference + pair.value), pair.value - pair.reference, 0.7, kChartInk);
  };
  return chart;
}

}  // namespace

/// Adds the notes below the title of the first section.
static void add_notes(report::Report& made, const StudyNotes& notes) {
  made.emulated = notes.emulated;
  Section section;
  for (const std::string& sentence : notes.sentences())
    section.parts.emplace_back(report::Paragraph{sentence, Verdict::none, true});
  if (!section.parts.empty()) made.sections.insert(made.sections.begin(), std::move(section));
}

report::Report repeat_report(const RepeatStudy& study, Language language) {
  report::Report made = document(language, pick(language, "Repeatability", "重复性"), study.source);
  Section& figures = made.sections.emplace_back();
  figures.title = pick(language, "Repeats", "重复测量");
  for (const std::string& warning : study.warnings)
    figures.parts.emplace_back(report::Paragraph{warning, Verdict::none, true});
  if (study.judgement() != Judgement::not_judged) {
    figures.verdict = as_verdict(study.judgement());
    figures.parts.emplace_back(gauges_table(study, language));
    for (const Characteristic& c : study.characteristics)
      if (!c.gauge.reason.empty())
        figures.parts.emplace_back(report::Paragraph{fmt::format("{}: {}", title_of(c.about), c.gauge.reason),
                                                     as_verdict(c.gauge.judgement), false});
  }
  for (std::size_t i = 0; i < study.characteristics.size();) {
    std::vector<Characteristic> of_item;
    const std::string item = study.characteristics[i].about.item;
    for (; i < study.characteristics.size() && study.characteristics[i].about.item == item; ++i)
      of_item.push_back(study.characteristics[i]);
    Section& section = made.sections.emplace_back();
    section.title = word_of(item, language);
    section.together = true;
    section.parts.emplace_back(
        Figures{{of_item.size() == 1 ? run_chart(of_item.front(), language) : block_chart(of_item, language)}});
  }
  made.sections.emplace_back().parts.emplace_back(characteristics_table(study, language));
  made.sections.back().title = pick(language, "All figures", "全部统计值");
  add_notes(made, study.notes);
  return made;
}

report::Report grr_report(const GrrStudy& study, Language language) {
  report::Report made = document(language, pick(language, "Gauge R&R", "量具重复性与再现性"), study.source);
  for (const GrrItem& item : study.items) {
    Section& section = made.sections.emplace_back();
    section.title = word_of(item.about.item, language);
    section.verdict = as_verdict(item.judged.judgement);
    section.remark = judgement_word(item.judged.judgement, language);
    section.together = true;
    if (!item.judged.reason.empty())
      section.parts.emplace_back(report::Paragraph{item.judged.reason, as_verdict(item.judged.judgement), false});
    section.parts.emplace_back(Figures{{component_bars(item, language), appraiser_lines(item, language)}});
    section.parts.emplace_back(components_table(item, language));
  }
  Section refused;
  refused.title = pick(language, "Refused", "未采用");
  for (const std::string& sentence : study.refused)
    refused.parts.emplace_back(report::Paragraph{sentence, Verdict::none, true});
  if (!refused.parts.empty()) made.sections.push_back(std::move(refused));
  add_notes(made, study.notes);
  return made;
}

report::Report compare_report(const CompareStudy& study, Language language) {
  report::Report made = document(language, pick(language, "Against a laboratory", "与实验室比对"), study.source);
  Section& errors = made.sections.emplace_back();
  errors.title = pick(language, "Errors", "误差");
  errors.parts.emplace_back(errors_table(study, language));
  errors.parts.emplace_back(agreement_table(study, language));
  const std::size_t unmatched = study.only_reference.size();
  if (unmatched > 0)
    errors.parts.emplace_back(report::Paragraph{
        fmt::format("{}: {}",
                    pick(language, "values of the laboratory that slabd has none for", "无对应实测值的参考值"),
                    unmatched),
        Verdict::none, true});
  for (const CompareItem& item : study.items) {
    Section& section = made.sections.emplace_back();
    section.title = word_of(item.item, language);
    section.verdict = as_verdict(item.judgement);
    section.together = true;
    section.parts.emplace_back(Figures{{scatter_chart(item, language), difference_chart(item, language)}});
    if (!item.line.ok) section.parts.emplace_back(report::Paragraph{item.line.why_not, Verdict::none, false});
  }
  add_notes(made, study.notes);
  return made;
}

}  // namespace slabd::cli::study
