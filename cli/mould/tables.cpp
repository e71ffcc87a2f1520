// SPDX-License-Identifier: Apache-2.0
//
// Tables and remarks of the ledger, for terminal, CSV, HTML and documents.
#include <fmt/core.h>

#include <algorithm>
#include <cmath>

#include "cli/mould/ledger.h"
#include "report/figures.h"

namespace slabd::cli::mould {

using report::Language;
using report::pick;

namespace {

std::string place_text(const Place& place) {
  if (place.station == 0) return "";
  return place.station_to == 0 ? std::to_string(place.station) : fmt::format("{}-{}", place.station, place.station_to);
}

std::string signal_text(const MouldEffect& effect, bool separable, Language language) {
  std::string text;
  switch (effect.signal) {
    case Signal::grey: text = pick(language, "few slabs", "板数过少"); break;
    case Signal::none: text = separable ? "" : pick(language, "too few moulds", "模具过少"); break;
    case Signal::mould: text = pick(language, "mould", "模具"); break;
    case Signal::line: text = pick(language, "line", "检测线"); break;
  }
  if (effect.drifts) text += (text.empty() ? "" : ", ") + std::string(pick(language, "drifts", "漂移"));
  return text;
}

std::string item_text(ItemId item, Language language) {
  return fmt::format("{} [{}]", report::item_word(item, language), slabd::name(info(item).unit));
}

std::string day_of(std::int64_t utime_us) {
  return utime_us == 0 ? std::string() : report::iso_time(utime_us).substr(0, 10);
}

}  // namespace

report::Table moulds_table(const Ledger& ledger, Language language) {
  report::Table table{{pick(language, "mould", "模具"), "mould"},
                      {pick(language, "epoch", "周期"), "epoch"},
                      {pick(language, "type", "板型"), "slab_type"},
                      {pick(language, "slabs", "板数"), "slabs"},
                      {pick(language, "first cast", "首次浇筑") + std::string("<"), "first"},
                      {pick(language, "last cast", "最近浇筑") + std::string("<"), "last"},
                      {pick(language, "signals", "信号"), "signals"},
                      {pick(language, "drifts", "漂移"), "drifts"},
                      {pick(language, "largest, in U", "最大（以 U 计）"), "largest_in_U"},
                      {pick(language, "of", "项目") + std::string("<"), "item"},
                      {pick(language, "station", "检测位") + std::string("<"), "station"}};
  table.title = pick(language, "Moulds", "模具");
  for (std::size_t row = 0; row < ledger.rows.size(); ++row) {
    std::size_t signals = 0;
    std::size_t drifts = 0;
    Found largest;
    double size = 0.0;
    for (const Found& found : effects_of(ledger, row)) {
      drifts += found.effect->drifts ? 1 : 0;
      if (found.effect->signal != Signal::mould) continue;
      ++signals;
      const double in_U = std::abs(found.effect->bias) / found.effect->U;
      if (in_U <= size) continue;
      size = in_U;
      largest = found;
    }
    const Row& r = ledger.rows[row];
    table.add(r.mould, r.epoch, r.slab_type == 0 ? report::Cell("") : report::Cell(r.slab_type), r.slabs,
              day_of(r.first_utime_us), day_of(r.last_utime_us), signals, drifts,
              report::Cell(signals == 0 ? kNoValue : size, 1),
              signals == 0 ? report::Cell("") : report::Cell(item_text(largest.item->item, language)),
              signals == 0 ? report::Cell("") : report::Cell(place_text(largest.at())));
  }
  return table;
}

report::Table effects_table(const Ledger& ledger, std::size_t row, bool all, Language language) {
  report::Table table{{pick(language, "characteristic", "检测项目") + std::string("<"), "item"},
                      {pick(language, "station", "检测位"), "station"},
                      {pick(language, "slabs", "板数"), "n"},
                      {pick(language, "bias", "偏倚"), "bias"},
                      {"U", "U"},
                      {pick(language, "now", "当前"), "ewma"},
                      {pick(language, "per 100 slabs", "每 100 块板"), "drift_per_100"},
                      {pick(language, "slabs to limit", "距限值板数"), "slabs_to_limit"},
                      {"+-2u", "slabs_to_limit_2u"},
                      {pick(language, "signal", "信号") + std::string("<"), "signal"}};
  table.title = all ? pick(language, "Effects of the mould", "模具效应")
                    : pick(language, "Effects of the mould with a signal", "有信号的模具效应");
  for (const Found& found : effects_of(ledger, row)) {
    const MouldEffect& effect = *found.effect;
    if (!all && effect.signal != Signal::mould && !effect.drifts) continue;
    const int digits = report::decimals(found.item->item);
    const SlabsLeft left = found.left();
    table.add(item_text(found.item->item, language), place_text(found.at()), effect.n,
              report::Cell(effect.bias, digits), report::Cell(effect.U, digits), report::Cell(effect.ewma, digits),
              report::Cell(effect.drift_per_100, digits), report::Cell(left.slabs, 0), report::Cell(2.0 * left.u, 0),
              signal_text(effect, found.item->model.separates(found.place), language));
  }
  return table;
}

report::Table line_table(const Ledger& ledger, Language language) {
  report::Table table{{pick(language, "type", "板型"), "slab_type"},
                      {pick(language, "characteristic", "检测项目") + std::string("<"), "item"},
                      {pick(language, "station", "检测位"), "station"},
                      {pick(language, "moulds", "模具数"), "moulds"},
                      {pick(language, "slabs", "板数"), "n"},
                      {pick(language, "bias", "偏倚"), "bias"},
                      {"U", "U"}};
  table.title = pick(language, "Effects of the inspection line, which all moulds share", "所有模具共有的检测线效应");
  for (const ItemEffects& item : ledger.items)
    for (std::size_t place = 0; place < item.model.line.size(); ++place) {
      const Effect& effect = item.model.line[place];
      if (effect.signal != Signal::line) continue;
      const int digits = report::decimals(item.item);
      table.add(item.slab_type, item_text(item.item, language), place_text(item.places[place]),
                item.model.moulds[place], effect.n, report::Cell(effect.bias, digits), report::Cell(effect.U, digits));
    }
  return table;
}

std::vector<std::string> remarks_of(const Ledger& ledger, Language language) {
  std::vector<std::string> remarks;
  if (ledger.emulated != 0) remarks.push_back(report::emulation_notice(ledger.emulated, language));
  if (ledger.other_emulation > 0)
    remarks.push_back(fmt::format(
        fmt::runtime(ledger.emulated != 0 ? pick(language, "{} real slabs left out: the newest slab is emulated",
                                                 "已剔除 {} 块真实板：最新板为仿真")
                                          : pick(language, "{} emulated slabs left out: the newest slab is real",
                                                 "已剔除 {} 块仿真板：最新板为真实")),
        ledger.other_emulation));
  if (ledger.unknown > 0)
    remarks.push_back(fmt::format(
        fmt::runtime(pick(language, "{} slabs of an unknown mould are left out", "已剔除 {} 块模具未知的板")),
        ledger.unknown));
  const bool few = std::any_of(ledger.items.begin(), ledger.items.end(), [](const ItemEffects& item) {
    return std::any_of(item.model.moulds.begin(), item.model.moulds.end(),
                       [](std::size_t moulds) { return moulds < kMouldsMin; });
  });
  if (few)
    remarks.push_back(fmt::format(
        fmt::runtime(pick(language,
                          "with fewer than {} moulds of {} slabs at a station, effects of the moulds and of the "
                          "inspection line cannot be told apart: no signals there",
                          "某检测位少于 {} 个各有 {} 块板的模具时，无法区分模具与检测线的效应：该处不给信号")),
        kMouldsMin, kSlabsMin));
  return remarks;
}

}  // namespace slabd::cli::mould
