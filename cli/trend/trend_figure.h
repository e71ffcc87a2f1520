// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "cli/trend/series.h"
#include "report/content.h"

/// Pictures and tables of trends.
namespace slabd::cli::trend {

/// Values above moving ranges, control limits, tolerance if it is near the values, and a legend; grey while
/// preliminary. A chart of several blocks shows the range of each slab's single values and marks those outside the
/// limits, because a mean hides them.
[[nodiscard]] report::Figure chart_figure(const Trend& trend, report::Language language);
/// Bias of every station from the others of its slab; empty if there is one station only.
[[nodiscard]] report::Table stations_table(const Trend& trend, report::Language language);
/// One row for each characteristic: limits, share outside, indices, distribution, stability, judgement.
[[nodiscard]] report::Table capability_table(const std::vector<Trend>& trends, report::Language language);

/// The chart and its figures as a document.
[[nodiscard]] report::Report document_of(const Trend& trend, report::Language language);
/// The table over all characteristics as a document.
[[nodiscard]] report::Report document_of(const std::vector<Trend>& trends, report::Language language);

/// "1.63 (1.41 .. 1.85)", "1.63" without an interval, "-" without a value.
[[nodiscard]] std::string estimate_text(const study::Estimate& estimate);
/// "3 of 540 (0.56 %, 0.11 .. 1.62 %)"; "0 of 540 (at most 0.68 %)"; "-" without limits.
[[nodiscard]] std::string outside_text(const Trend& trend, report::Language language);
/// "normal", "lognormal", "Weibull", or "percentiles" if no distribution fits.
[[nodiscard]] std::string model_text(const Performance& performance, report::Language language);
/// "capable", and with its reason.
[[nodiscard]] std::string judgement_word(study::Judgement judgement, report::Language language);
[[nodiscard]] std::string judgement_text(const Trend& trend, report::Language language);
/// "jaw distance: undecided: 3 of 540 values outside the limits", one for each characteristic with a reason.
[[nodiscard]] std::vector<std::string> reason_lines(const std::vector<Trend>& trends, report::Language language);
/// The values outside the limits, the newest first, at most `lines_max` and a line with the number of the others.
[[nodiscard]] std::vector<std::string> outside_lines(const Trend& trend, std::size_t lines_max,
                                                     report::Language language);

}  // namespace slabd::cli::trend
