// SPDX-License-Identifier: Apache-2.0
//
// The sheet that the fitter of a mould takes along. A correction is printed only where the deviation goes with the
// mould; scatter that is corrected becomes a new error.
#include <fmt/core.h>

#include <algorithm>
#include <cmath>

#include "cli/mould/ledger.h"
#include "report/canvas.h"
#include "report/figures.h"

namespace slabd::cli::mould {

using report::Language;
using report::pick;

namespace {

constexpr double kBase_mm = 100.0;  ///< a slope is stated over this length

/// Slope in mm per 100 mm; differs from the true one by 0.1 % at the seat's cant.
double per_100(double deg) {
  return kBase_mm * std::tan(rad_from_deg(deg));
}

const Found* effect_at(const std::vector<Found>& effects, ItemId item, int station) {
  for (const Found& found : effects)
    if (found.item->item == item && found.at().station == station && found.at().station_to == 0) return &found;
  return nullptr;
}

/// Deviation to correct. A seat that drifts is corrected by its deviation now.
double to_correct(const MouldEffect& effect) {
  return effect.drifts ? effect.ewma : effect.bias;
}

/// Half of the 95 % interval of to_correct().
double U_of(const MouldEffect& effect) {
  return effect.drifts ? 2.0 * effect.ewma_u : effect.U;
}

/// True if to_correct() is proven. Where it drifts, the mean over the past proves nothing about now.
bool is_signal(const Found* found) {
  if (found == nullptr) return false;
  const MouldEffect& effect = *found->effect;
  return effect.drifts ? std::abs(effect.ewma) >= kSignal * effect.ewma_u : effect.signal == Signal::mould;
}

int stations_of(const std::vector<Found>& effects) {
  int stations = 0;
  for (const Found& found : effects) stations = std::max({stations, found.at().station, found.at().station_to});
  return stations;
}

/// One seat in the map.
struct Seat {
  bool known = false;
  bool grey = true;
  double shim_mm = kNoValue;   ///< NaN: nothing to correct
  double slope_mm = kNoValue;  ///< per 100 mm
};

std::vector<Seat> seats_of(const std::vector<Found>& effects) {
  std::vector<Seat> seats(static_cast<std::size_t>(stations_of(effects)));
  for (std::size_t i = 0; i < seats.size(); ++i) {
    const Found* height = effect_at(effects, ItemId::seat_vertical, static_cast<int>(i + 1));
    const Found* slope = effect_at(effects, ItemId::seat_slope, static_cast<int>(i + 1));
    for (const Found* found : {height, slope}) {
      if (found == nullptr) continue;
      seats[i].known = true;
      seats[i].grey = seats[i].grey && found->effect->signal == Signal::grey;
    }
    if (is_signal(height)) seats[i].shim_mm = to_correct(*height->effect);
    if (is_signal(slope)) seats[i].slope_mm = per_100(to_correct(*slope->effect));
  }
  return seats;
}

std::string signed_figure(double value, int digits) {
  const std::string text = report::figure(value, digits);
  return value > 0.0 && text != "-" ? "+" + text : text;
}

void draw_seat(report::Canvas& canvas, const Seat& seat, std::size_t station, double x, double y, double w, double h) {
  const bool marked = has_value(seat.shim_mm) || has_value(seat.slope_mm);
  // Colour is additional: a correction is a number in a thick frame.
  const report::Colour fill = !seat.known || seat.grey ? report::kPaleGrey
                              : marked                 ? report::Colour{1.0, 0.88, 0.6}
                                                       : report::kWhite;
  canvas.rectangle(x - 0.5 * w, y - 0.5 * h, w, h, fill, report::kBlack, marked ? 0.7 : 0.2);
  canvas.text(x, y - 5.5, std::to_string(station), {9.0, true, report::kBlack, report::Anchor::centre});
  const report::TextStyle style{8.0, marked, report::kBlack, report::Anchor::centre};
  if (has_value(seat.shim_mm)) canvas.text(x, y + 1.5, signed_figure(seat.shim_mm, 2), style);
  if (has_value(seat.slope_mm)) canvas.text(x, y + 7.5, signed_figure(seat.slope_mm, 3), style);
  if (!marked) canvas.text(x, y + 3.0, seat.known && !seat.grey ? "0" : "-", style);
}

report::Figure map_figure(const std::vector<Found>& effects, Language language) {
  report::Figure figure;
  const std::vector<Seat> seats = seats_of(effects);
  figure.title = pick(language, "Shim at each seat: mm, below it mm per 100 mm across the rail",
                      "各承轨槽垫片：mm，下方为横向每 100 mm 的 mm 数");
  figure.width_mm = 180.0;
  figure.height_mm = 62.0;
  figure.alt = pick(language, "Map of the seats with the shim of each.", "承轨槽平面图及各处垫片。");
  for (std::size_t i = 0; i < seats.size(); ++i) {
    if (has_value(seats[i].shim_mm))
      figure.alt += fmt::format(" {}: {} mm.", i + 1, signed_figure(seats[i].shim_mm, 2));
    if (has_value(seats[i].slope_mm))
      figure.alt += fmt::format(" {}: {} mm / 100 mm.", i + 1, signed_figure(seats[i].slope_mm, 3));
  }
  figure.draw = [seats](report::Canvas& canvas) {
    const std::size_t pairs = seats.size() / 2;
    canvas.rectangle(10.0, 1.0, 169.0, 56.0, report::Colour{0.965, 0.965, 0.96}, report::kGrey, 0.4);
    const double pitch = 167.0 / static_cast<double>(std::max<std::size_t>(pairs, 1));
    for (std::size_t i = 1; i <= 2 * pairs; ++i) {
      const std::size_t column = i <= pairs ? i - 1 : 2 * pairs - i;
      const double x = 11.0 + pitch * (static_cast<double>(column) + 0.5);
      draw_seat(canvas, seats[i - 1], i, x, i <= pairs ? 16.0 : 42.0, pitch - 2.6, 22.0);
    }
    canvas.text(0.0, 17.0, "Y > 0", {6.5, false, report::kGrey, report::Anchor::left});
    canvas.text(0.0, 43.0, "Y < 0", {6.5, false, report::kGrey, report::Anchor::left});
    canvas.line(12.0, 29.0, 22.0, 29.0, 0.25, report::kGrey);
    canvas.line(22.0, 29.0, 20.6, 28.3, 0.25, report::kGrey);
    canvas.line(22.0, 29.0, 20.6, 29.7, 0.25, report::kGrey);
    canvas.text(23.2, 29.8, "X", {6.5, false, report::kGrey, report::Anchor::left});
  };
  return figure;
}

std::string seat_remark(const Found* height, const Found* slope, Language language) {
  bool grey = true;
  bool separable = false;
  bool drifts = false;
  for (const Found* found : {height, slope}) {
    if (found == nullptr) continue;
    grey = grey && found->effect->signal == Signal::grey;
    separable = separable || found->item->model.separates(found->place);
    drifts = drifts || found->effect->drifts;
  }
  if (grey) return pick(language, "fewer than 5 slabs", "少于 5 块板");
  if (!separable) return pick(language, "too few moulds", "模具过少");
  std::string text =
      is_signal(height) || is_signal(slope) ? pick(language, "correct", "调整") : pick(language, "leave", "不调整");
  if (drifts) text += pick(language, ", drifts", "，漂移");
  return text;
}

std::vector<std::string> conventions(Language language) {
  return {
      pick(language,
           "Sign of the height: the slab is cast with its seats down. A positive shim goes under the form of the seat; "
           "the form rises and the seat of the next slab becomes lower by that amount. A negative one is taken away.",
           "高度符号：板的承轨面朝下浇筑。正值为在承轨槽模下加垫片；槽模升高，下一块板的承轨面降低相同数值。"
           "负值为抽去垫片。"),
      pick(
          language,
          "Sign of the slope: mm per 100 mm across the rail. Positive: put the shim under the outer end of the form, "
          "away from the track's middle, because the seat of the slab climbs outward too steeply.",
          "坡度符号：横向每 100 mm 的 mm 数。正值：垫片加在槽模外端（远离线路中心一侧），因为板的承轨面向外爬升过陡。"),
      pick(
          language,
          "bias: deviation of this mould's slabs from those of the other moulds at the same station. U: half of its 95 "
          "% interval. n: slabs. A correction is given from four standard errors on; below that it is scatter, and "
          "correcting scatter adds an error. Where the deviation drifts, bias, U and correction are those of now.",
          "偏倚：本模具的板与其他模具的板在同一检测位之差。U：其 95 % 区间的半宽。n：板数。"
          "达到四倍标准误差才给出调整值；低于此值为随机散布，对其调整会增加误差。有漂移处，偏倚、U "
          "和调整值均取当前值。"),
      pick(language,
           "After the correction: slabctl mould reset, so that the slabs cast from then on have figures of their own. "
           "No figure of this sheet affects a verdict.",
           "调整后执行：slabctl mould reset，此后浇筑的板单独统计。本表数值不影响任何判定。")};
}

}  // namespace

report::Table seats_table(const Ledger& ledger, std::size_t row, Language language) {
  const std::vector<Found> effects = effects_of(ledger, row);
  report::Table table{{pick(language, "station", "检测位"), "station"},
                      {"n", "n"},
                      {pick(language, "shim mm", "垫片 mm"), "shim_mm"},
                      {pick(language, "height bias mm", "高度偏倚 mm"), "height_bias_mm"},
                      {"U", "height_U_mm"},
                      {pick(language, "shim mm/100 mm", "坡度垫片 mm/100 mm"), "slope_shim_mm_per_100"},
                      {pick(language, "slope bias mm/100 mm", "坡度偏倚 mm/100 mm"), "slope_bias_mm_per_100"},
                      {"U", "slope_U_mm_per_100"},
                      {pick(language, "do", "措施") + std::string("<"), "action"}};
  table.title = pick(language, "Each seat", "各承轨槽");
  const auto bias = [](const Found* found) { return found != nullptr ? to_correct(*found->effect) : kNoValue; };
  const auto shim = [](const Found* found) { return is_signal(found) ? to_correct(*found->effect) : kNoValue; };
  const auto U = [](const Found* found) { return found != nullptr ? U_of(*found->effect) : kNoValue; };
  for (int station = 1; station <= stations_of(effects); ++station) {
    const Found* height = effect_at(effects, ItemId::seat_vertical, station);
    const Found* slope = effect_at(effects, ItemId::seat_slope, station);
    const std::size_t n = height != nullptr ? height->effect->n : slope != nullptr ? slope->effect->n : 0;
    table.add(station, n, report::Cell(shim(height), 2), report::Cell(bias(height), 3), report::Cell(U(height), 3),
              report::Cell(per_100(shim(slope)), 3), report::Cell(per_100(bias(slope)), 4),
              report::Cell(per_100(U(slope)), 4), seat_remark(height, slope, language));
  }
  return table;
}

report::Report sheet_of(const Ledger& ledger, std::size_t row, Language language) {
  const Row& r = ledger.rows[row];
  report::Report sheet;
  sheet.language = language;
  sheet.judged = false;
  sheet.emulated = ledger.emulated;
  sheet.title = pick(language, "Sheet of a mould", "模具调整单");
  sheet.subject = fmt::format(fmt::runtime(pick(language, "mould {}, epoch {}", "模具 {}，周期 {}")), r.mould, r.epoch);
  report::Section& first = sheet.sections.emplace_back();
  first.parts.emplace_back(report::Paragraph{fmt::format(
      fmt::runtime(pick(language, "Slab type {}, {} slabs, cast {} to {}.", "板型 {}，{} 块板，浇筑时间 {} 至 {}。")),
      r.slab_type, r.slabs, report::local_time(r.first_utime_us), report::local_time(r.last_utime_us))});
  // Every page states that the slabs are emulated.
  for (const std::string& remark : remarks_of(ledger, language))
    if (ledger.emulated == 0 || remark != report::emulation_notice(ledger.emulated, language))
      first.parts.emplace_back(report::Paragraph{remark, Verdict::none, true});
  const std::vector<Found> effects = effects_of(ledger, row);
  first.parts.emplace_back(report::Figures{{map_figure(effects, language)}});
  first.parts.emplace_back(seats_table(ledger, row, language));
  report::Section& signs = sheet.sections.emplace_back();
  signs.title = pick(language, "How to read it", "说明");
  signs.together = true;
  for (const std::string& line : conventions(language)) signs.parts.emplace_back(report::Paragraph{line});
  if (report::Table table = effects_table(ledger, row, false, language); !table.rows.empty())
    sheet.sections.emplace_back().parts.emplace_back(std::move(table));
  if (report::Table table = line_table(ledger, language); !table.rows.empty())
    sheet.sections.emplace_back().parts.emplace_back(std::move(table));
  return sheet;
}

}  // namespace slabd::cli::mould
