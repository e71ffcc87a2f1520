// SPDX-License-Identifier: Apache-2.0
#include "report/figures.h"

#include <fmt/core.h>

#include <array>
#include <cmath>
#include <cstdlib>
#include <ctime>
#include <vector>

#include "report/say.h"

namespace slabd::report {
namespace {

/// Enough decimals to distinguish a failed value from the limit it exceeds. With six extra decimals the difference is
/// a rounding error, and the usual number is returned.
int digits_of(const Item& item) {
  const int usual = decimals(item.id);
  if (item.verdict != Verdict::fail) return usual;
  const double limit = item.value > item.upper ? item.upper : item.value < item.lower ? item.lower : kNoValue;
  if (!has_value(limit)) return usual;
  int digits = usual;
  while (digits < usual + 6 && figure(item.value, digits) == figure(limit, digits)) ++digits;
  return figure(item.value, digits) == figure(limit, digits) ? usual : digits;
}

}  // namespace

int decimals(ItemUnit unit) {
  return unit == ItemUnit::deg ? 4 : 3;
}
int decimals(ItemId id) {
  return decimals(info(id).unit);
}

std::string figure(double value, int decimals) {
  if (!std::isfinite(value)) return "-";
  std::string text = fmt::format("{:.{}f}", value, decimals);
  // A value that is shown as zero has no sign.
  if (text.front() == '-' && text.find_first_of("123456789") == std::string::npos) text.erase(0, 1);
  return text;
}

std::string local_time(std::int64_t utime_us) {
  if (utime_us == 0) return "";
  const auto seconds = static_cast<std::time_t>(utime_us / 1'000'000);
  std::tm parts{};
  localtime_r(&seconds, &parts);
  const long offset_min = parts.tm_gmtoff / 60;
  return fmt::format("{:04}-{:02}-{:02} {:02}:{:02}:{:02} {}{:02}:{:02}", parts.tm_year + 1900, parts.tm_mon + 1,
                     parts.tm_mday, parts.tm_hour, parts.tm_min, parts.tm_sec, offset_min < 0 ? '-' : '+',
                     std::abs(offset_min) / 60, std::abs(offset_min) % 60);
}

std::string nominal_figure(const Item& item) {
  return figure(item.nominal, decimals(item.id));
}
std::string value_figure(const Item& item) {
  return figure(item.value, digits_of(item));
}
std::string deviation_figure(const Item& item) {
  return figure(item.deviation(), digits_of(item));
}
std::string U_figure(const Item& item) {
  const std::string text = figure(item.U, decimals(item.id));
  // An uncertainty is never shown as zero.
  if (!(item.U > 0.0) || text.find_first_of("123456789") != std::string::npos) return text;
  return decimals(item.id) == 4 ? "< 0.0001" : "< 0.001";
}

std::string limits_figure(const Item& item) {
  const int digits = digits_of(item);
  if (!has_value(item.lower) && !has_value(item.upper)) return "";
  if (!has_value(item.lower)) return fmt::format("<= {}", figure(item.upper, digits));
  if (!has_value(item.upper)) return fmt::format(">= {}", figure(item.lower, digits));
  return fmt::format("{} .. {}", figure(item.lower, digits), figure(item.upper, digits));
}

std::string item_label(const Item& item, bool of_slab) {
  std::string label = fmt::format("{} [{}]", info(item.id).name, name(info(item.id).unit));
  if (of_slab && item.station != 0)
    label +=
        item.station_to != 0 ? fmt::format(" {}-{}", item.station, item.station_to) : fmt::format(" {}", item.station);
  return label;
}

std::string flatness_operator(double cell_mm, const SeatFeature& seat, report::Language language) {
  std::string text = has_value(cell_mm) ? say(language, "cell mean {} mm, least-squares plane", cell_mm)
                                        : say(language, "cell mean, least-squares plane");
  // Without pits both values are equal, and so is the judged one.
  if (seat.flatness_closed_mm != seat.flatness_raw_mm) {
    if (seat.flatness_mm == seat.flatness_closed_mm) text += say(language, ", closed from above");
    if (seat.flatness_mm == seat.flatness_raw_mm) text += say(language, ", pits and all");
  }
  return text;
}

std::string unseen_dimensions(const SlabResult& slab, Language language) {
  constexpr std::array<std::array<std::string_view, 2>, kGaugeItems> kNames = {
      {{"length", "板长"}, {"width", "板宽"}, {"thickness", "板厚"}, {"bottom", "板底"}}};
  const bool zh = language == Language::zh;
  std::vector<std::string_view> unseen;
  for (std::size_t i = 0; i < kGaugeItems; ++i) {
    const Item* const item = find_item(slab.items.begin(), slab.items.end(), kGaugeItemIds[i]);
    if (item == nullptr || !has_value(item->value)) unseen.push_back(kNames[i][zh ? 1 : 0]);
  }
  std::string text;
  for (std::size_t i = 0; i < unseen.size(); ++i) {
    if (i > 0) text += i + 1 < unseen.size() ? (zh ? "、" : ", ") : (zh ? "和" : " and ");
    text += unseen[i];
  }
  return text;
}

std::string not_visible(const SlabResult& slab) {
  std::string unseen = unseen_dimensions(slab, Language::en);
  if (unseen.empty()) return unseen;
  if (const std::size_t last = unseen.find(" and "); last != std::string::npos) unseen.replace(last, 5, ", ");
  return "not visible to the block scans: " + unseen + " of the slab";
}

}  // namespace slabd::report
