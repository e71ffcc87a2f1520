// SPDX-License-Identifier: Apache-2.0
#include <algorithm>
#include <array>
#include <optional>

#include "report/content.h"
#include "report/data_matrix.h"

namespace slabd::report {
namespace {

constexpr double kWidth_mm = 180.0;
constexpr double kDisposition_mm = 15.0;
constexpr double kSignatures_mm = 19.0;
constexpr double kSymbol_mm = 15.0;
constexpr TextStyle kText{7.2, false, kBlack, Anchor::left};

void draw_disposition(Canvas& canvas, Language language) {
  double x = 0.0;
  for (const std::string& decision :
       {pick(language, "hold", "暂扣"), pick(language, "release by concession", "让步放行"),
        pick(language, "rework", "返工"), pick(language, "scrap", "报废"), pick(language, "inspect again", "复检")}) {
    canvas.rectangle(x, 0.6, 3.2, 3.2, kWhite, kBlack, 0.25);
    canvas.text(x + 4.6, 3.2, decision, kText);
    x += canvas.text_width(decision, kText) + 12.0;
  }
  canvas.text(0.0, 11.0, pick(language, "reason", "理由"), kText);
  canvas.line(16.0, 11.4, kWidth_mm, 11.4, 0.15, kGrey);
}

void draw_signatures(Canvas& canvas, double top, Language language) {
  constexpr double kColumn_mm = (kWidth_mm - kSymbol_mm - 3.0) / 3.0;
  const std::array<std::string, 3> roles = {pick(language, "inspected", "检验"), pick(language, "checked", "复核"),
                                            pick(language, "decided", "批准")};
  for (std::size_t i = 0; i < roles.size(); ++i) {
    const double x = kColumn_mm * static_cast<double>(i);
    canvas.line(x, top + 12.0, x + kColumn_mm - 6.0, top + 12.0, 0.25);
    canvas.text(x, top + 15.2, roles[i] + pick(language, ": name, date, signature", "：姓名、日期、签字"),
                {6.5, false, kGrey, Anchor::left});
  }
}

/// One path of dark modules a row would leave hairlines between them, so that neighbours are one rectangle.
void draw_symbol(Canvas& canvas, double top, const DataMatrix& symbol) {
  const double module_mm = kSymbol_mm / static_cast<double>(symbol.size);
  for (std::size_t row = 0; row < symbol.size; ++row)
    for (std::size_t begin = 0; begin < symbol.size;) {
      std::size_t end = begin;
      while (end < symbol.size && symbol.at(row, end)) ++end;
      if (end > begin)
        canvas.rectangle(kWidth_mm - kSymbol_mm + module_mm * static_cast<double>(begin),
                         top + module_mm * static_cast<double>(row), module_mm * static_cast<double>(end - begin),
                         module_mm, kBlack, std::nullopt, 0.0);
      begin = std::max(end, begin + 1);
    }
}

}  // namespace

Figure signature_figure(bool with_disposition, std::string_view slab_id, Language language) {
  Figure figure;
  figure.title = with_disposition ? pick(language, "Disposition and signatures", "处置与签字")
                                  : pick(language, "Signatures", "签字");
  figure.alt = figure.title;
  figure.width_mm = kWidth_mm;
  figure.height_mm = kSignatures_mm + (with_disposition ? kDisposition_mm : 0.0);
  figure.draw = [with_disposition, language, symbol = data_matrix(slab_id)](Canvas& canvas) {
    const double top = with_disposition ? kDisposition_mm : 0.0;
    if (with_disposition) draw_disposition(canvas, language);
    draw_signatures(canvas, top, language);
    if (symbol.size > 0) draw_symbol(canvas, top, symbol);
  };
  return figure;
}

}  // namespace slabd::report
