// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "cli/study/compare.h"
#include "cli/study/grr.h"
#include "cli/study/repeat.h"
#include "cli/terminal/document.h"
#include "report/content.h"

/// Studies as documents, drawn by the code of the slab reports.
namespace slabd::cli::study {

/// One chart per item: over the runs for one block, over the blocks for several (the paper's Figs. 18 and 19).
[[nodiscard]] report::Report repeat_report(const RepeatStudy& study, report::Language language);
/// Components, and the means of each appraiser for each part.
[[nodiscard]] report::Report grr_report(const GrrStudy& study, report::Language language);
/// Measured over reference values with the line, and differences with the limits of agreement.
[[nodiscard]] report::Report compare_report(const CompareStudy& study, report::Language language);

}  // namespace slabd::cli::study
