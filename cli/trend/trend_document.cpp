// SPDX-License-Identifier: Apache-2.0
//
// Texts, tables and documents of trends.
#include <fmt/core.h>

#include <algorithm>

#include "cli/trend/multi_vari.h"
#include "cli/trend/trend_figure.h"
#include "report/figures.h"
#include "report/json.h"

namespace slabd::cli::trend {

using report::Language;
using report::pick;

namespace {

std::string place_words(const Item& item, Language language) {
  if (item.station == 0) return pick(language, "the slab", "整板");
  const std::string block = pick(language, "block", "承轨台");
  return item.station_to != 0 ? fmt::format("{} {}-{}", block, item.station, item.station_to)
                              : fmt::format("{} {}", block, item.station);
}

}  // namespace

std::string estimate_text(const study::Estimate& estimate) {
  if (!has_value(estimate.value)) return "-";
  if (!has_value(estimate.low)) return fmt::format("{:.2f}", estimate.value);
  return fmt::format("{:.2f} ({:.2f} .. {:.2f})", estimate.value, estimate.low, estimate.high);
}

std::string outside_text(const Trend& trend, Language language) {
  const study::Estimate& share = trend.whole.outside.share;
  if (!has_value(share.value)) return "-";
  if (trend.whole.outside.count == 0)
    return fmt::format(fmt::runtime(pick(language, "0 of {} (at most {:.2g} %)", "0 / {}（至多 {:.2g} %）")),
                       trend.values, 100.0 * share.high);
  return fmt::format(fmt::runtime(pick(language, "{} of {} ({:.2g} %, {:.2g} .. {:.2g} %)",
                                       "{} / {}（{:.2g} %，{:.2g} .. {:.2g} %）")),
                     trend.whole.outside.count, trend.values, 100.0 * share.value, 100.0 * share.low,
                     100.0 * share.high);
}

std::string model_text(const Performance& performance, Language language) {
  switch (performance.model) {
    case Model::none: return "-";
    case Model::normal: return pick(language, "normal", "正态");
    case Model::lognormal: return pick(language, "lognormal", "对数正态");
    case Model::weibull: return pick(language, "Weibull", "威布尔");
    case Model::percentiles: return pick(language, "percentiles", "百分位数");
  }
  return "-";
}

std::string judgement_word(study::Judgement judgement, Language language) {
  switch (judgement) {
    case study::Judgement::not_judged: break;
    case study::Judgement::capable: return pick(language, "capable", "有能力");
    case study::Judgement::not_capable: return pick(language, "NOT CAPABLE", "能力不足");
    case study::Judgement::undecided: return pick(language, "undecided", "未定");
  }
  return "-";
}

std::string judgement_text(const Trend& trend, Language language) {
  const std::string reason = judgement_reason(trend, language);
  return judgement_word(trend.judgement, language) + (reason.empty() ? "" : pick(language, ": ", "：") + reason);
}

std::vector<std::string> reason_lines(const std::vector<Trend>& trends, Language language) {
  std::vector<std::string> lines;
  for (const Trend& trend : trends)
    if (!judgement_reason(trend, language).empty())
      lines.push_back(fmt::format("{}: {}", report::item_word(trend.item, language), judgement_text(trend, language)));
  return lines;
}

std::vector<std::string> outside_lines(const Trend& trend, std::size_t lines_max, Language language) {
  std::vector<std::string> lines;
  for (auto value = trend.outside.rbegin(); value != trend.outside.rend() && lines.size() < lines_max; ++value)
    lines.push_back(fmt::format("{} {} \"{}\", {}: {} ({})", report::word(report::Word::slab_word, language),
                                value->key, value->id.view(), place_words(value->item, language),
                                report::value_figure(value->item), report::limits_figure(value->item)));
  if (trend.outside.size() > lines.size())
    lines.push_back(
        fmt::format(fmt::runtime(pick(language, "and {} more", "另有 {} 个")), trend.outside.size() - lines.size()));
  return lines;
}

report::Table stations_table(const Trend& trend, Language language) {
  const int digits = report::decimals(trend.item);
  report::Table table{pick(language, "station", "检测位"),
                      pick(language, "slabs", "板数"),
                      pick(language, "bias", "偏倚"),
                      "+-2s",
                      pick(language, "drift", "漂移"),
                      "+-2s",
                      "<"};
  table.title = pick(language, "Each station against the others of its slab", "各检测位与同板其他检测位之差");
  for (const StationBias& s : trend.stations)
    table.add(s.station, s.slabs, report::Cell(s.bias, digits), report::Cell(2.0 * s.bias_sigma, digits),
              report::Cell(s.drift, digits), report::Cell(2.0 * s.drift_sigma, digits),
              s.drifting() ? report::Cell(Verdict::indeterminate, pick(language, "drifts", "漂移"))
              : s.biased() ? pick(language, "biased", "偏倚")
                           : "");
  return table;
}

report::Table capability_table(const std::vector<Trend>& trends, Language language) {
  report::Table table{pick(language, "characteristic", "检测项目") + "<",
                      pick(language, "limits", "限值"),
                      pick(language, "outside", "超限"),
                      pick(language, "at most %", "至多 %"),
                      "Cp",
                      "Cpk",
                      "Pp",
                      "Ppk",
                      pick(language, "distribution", "分布") + "<",
                      pick(language, "signals", "信号"),
                      pick(language, "judgement", "判定") + "<"};
  table.title = pick(language, "Capability of all characteristics", "各检测项目的过程能力");
  for (const Trend& trend : trends) {
    Item limits;
    limits.id = trend.item;
    limits.lower = trend.lower;
    limits.upper = trend.upper;
    const study::Estimate& share = trend.whole.outside.share;
    table.add(fmt::format("{} [{}]", report::item_word(trend.item, language), name(info(trend.item).unit)),
              report::limits_figure(limits),
              has_value(share.value) ? fmt::format("{} / {}", trend.outside.size(), trend.values) : "-",
              report::Cell(100.0 * share.high, 2), report::Cell(trend.capable.cp.value, 2),
              report::Cell(trend.capable.cpk.value, 2), report::Cell(trend.whole.pp.value, 2),
              report::Cell(trend.whole.ppk.value, 2), model_text(trend.whole, language),
              fmt::format("{} / {}", trend.signals(), trend.chart.count),
              report::Cell(study::as_verdict(trend.judgement), judgement_word(trend.judgement, language)));
  }
  return table;
}

namespace {

report::Report empty_document(std::uint8_t emulated, Language language) {
  report::Report document;
  document.language = language;
  document.judged = false;
  document.emulated = emulated;
  document.title = pick(language, "Trend", "趋势");
  return document;
}

report::Table figures_table(const Trend& trend, Language language) {
  const int digits = report::decimals(trend.item);
  report::Table figures{pick(language, "figure", "名称"), pick(language, "value", "数值") + "<"};
  figures.title = pick(language, "Figures", "统计值");
  const auto add = [&](const std::string& key, const report::Cell& value) { figures.add(key, value); };
  add(pick(language, "judgement", "判定"),
      report::Cell(study::as_verdict(trend.judgement), judgement_text(trend, language)));
  add(pick(language, "values outside the limits (95 %)", "超出限值的数值 (95 %)"), outside_text(trend, language));
  add(pick(language, "slabs", "板数"), trend.chart.count);
  add(pick(language, "values not measured", "未测量"), trend.not_measured);
  add(pick(language, "values left out, judged by other limits than the newest", "已剔除：限值与最新板不同的数值"),
      trend.other_limits);
  if (trend.value_is != ValueIs::single)
    add(pick(language, "slabs without a value in the chart, a block's value missing", "图中无数值：缺少承轨台数值的板"),
        trend.incomplete);
  add(pick(language, "mean", "平均值"), report::figure(trend.chart.mean, digits));
  add(pick(language, "control limits", "控制限"),
      fmt::format("{} .. {}", report::figure(trend.chart.lower_control, digits),
                  report::figure(trend.chart.upper_control, digits)));
  add(pick(language, "limits", "限值"),
      fmt::format("{} .. {}", report::figure(trend.lower, digits), report::figure(trend.upper, digits)));
  const std::string few =
      trend.chart.preliminary()
          ? fmt::format(fmt::runtime(pick(language, "not before {} slabs", "至少需要 {} 块板")), kValuesMin)
          : std::string();
  const auto index = [&](const std::string& key, const study::Estimate& estimate) {
    add(key, few.empty() ? estimate_text(estimate) : few);
  };
  index("Cp (95 %)", trend.capable.cp);
  index("Cpk (95 %)", trend.capable.cpk);
  if (few.empty() && trend.value_is != ValueIs::single && trend.capable_block != 0)
    add(pick(language, "Cp and Cpk are of", "Cp、Cpk 取自"),
        fmt::format(fmt::runtime(pick(language, "block {}, the worst, {} values", "最差的承轨台 {}，{} 个数值")),
                    trend.capable_block, trend.singles.count));
  index("Pp (95 %)", trend.whole.pp);
  index("Ppk (95 %)", trend.whole.ppk);
  add(pick(language, "distribution of all values", "全部数值的分布"),
      has_value(trend.whole.p) ? fmt::format("{} (p {:.2g})", model_text(trend.whole, language), trend.whole.p)
                               : model_text(trend.whole, language));
  return figures;
}

}  // namespace

report::Report document_of(const Trend& trend, Language language) {
  constexpr std::size_t kOutsideShown = 20;
  report::Report document = empty_document(trend.emulated, language);
  report::Figure chart = chart_figure(trend, language);
  document.subject = chart.title;
  report::Section section;
  section.parts.emplace_back(report::Figures{{std::move(chart)}});
  section.parts.emplace_back(figures_table(trend, language));
  document.sections.push_back(std::move(section));
  const auto add_lines = [&](const std::string& title, const std::vector<std::string>& lines, Verdict verdict) {
    if (lines.empty()) return;
    report::Section list;
    list.title = title;
    for (const std::string& line : lines) list.parts.emplace_back(report::Paragraph{line, verdict});
    document.sections.push_back(std::move(list));
  };
  add_lines(pick(language, "Values outside the limits, the newest first", "超出限值的数值，最新在前"),
            outside_lines(trend, kOutsideShown, language), Verdict::fail);
  add_lines(pick(language, "Signals of the control chart", "控制图信号"), signal_lines(trend, language),
            Verdict::indeterminate);
  if (trend.stations.empty()) return document;
  report::Section& stations = document.sections.emplace_back();
  stations.parts.emplace_back(report::Figures{{multi_vari_figure(trend, language)}});
  stations.parts.emplace_back(stations_table(trend, language));
  return document;
}

report::Report document_of(const std::vector<Trend>& trends, Language language) {
  std::uint8_t emulated = 0;
  for (const Trend& trend : trends) emulated = static_cast<std::uint8_t>(emulated | trend.emulated);
  report::Report document = empty_document(emulated, language);
  document.title = pick(language, "Capability", "过程能力");
  if (!trends.empty() && trends.front().slab_type != 0)
    document.subject = fmt::format("{} {}", report::word(report::Word::slab_type, language), trends.front().slab_type);
  report::Section& section = document.sections.emplace_back();
  section.parts.emplace_back(capability_table(trends, language));
  for (const std::string& line : reason_lines(trends, language)) section.parts.emplace_back(report::Paragraph{line});
  section.parts.emplace_back(report::Paragraph{pick(
      language,
      "Cp, Cpk: scatter from slab to slab of the worst block. Pp, Ppk: all values of all blocks, by the distribution "
      "named (ISO 22514-2). At most: upper end of the 95 % interval of the share outside. Capable: whole 95 % "
      "intervals of Cpk and Ppk from 1.33 on, a stable chart, and not one value outside the limits.",
      "Cp、Cpk：最差承轨台的板间散布。Pp、Ppk：全部承轨台的全部数值，按所列分布计算 (ISO 22514-2)。至多：超限占比 95 % "
      "区间的上端。有能力：Cpk 与 Ppk 的整个 95 % 区间不低于 1.33，控制图稳定，且没有数值超出限值。")});
  return document;
}

}  // namespace slabd::cli::trend
