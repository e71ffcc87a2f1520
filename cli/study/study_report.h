// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "cli/study/compare.h"
#include "cli/study/grr_study.h"
#include "cli/study/repeat.h"
#include "report/content.h"

namespace slabd::args {
class Command;
}  // namespace slabd::args

/// Studies as documents, by the drawing code of the slab reports.
namespace slabd::cli::study {

/// One chart an item: over the runs for one block, over the blocks for several (the paper's Figs. 18 and 19).
[[nodiscard]] report::Report repeat_report(const RepeatStudy& study, report::Language language);
/// Components, and what each appraiser found on each part.
[[nodiscard]] report::Report grr_report(const GrrStudy& study, report::Language language);
/// Measured over reference with the line, and differences with the limits of agreement.
[[nodiscard]] report::Report compare_report(const CompareStudy& study, report::Language language);

/// What --out asks for.
struct DocumentOptions {
  std::string out;
  std::string language = "en";
  void add_to(args::Command& command);
  [[nodiscard]] report::Language wanted() const {
    return language == "zh" ? report::Language::zh : report::Language::en;
  }
  /// Stops at a name that ends in none of .pdf, .html, .svg, .png.
  void check() const;
};
/// Writes the document, if `path` is not empty.
void write_document(const report::Report& document, const std::string& path);

}  // namespace slabd::cli::study
