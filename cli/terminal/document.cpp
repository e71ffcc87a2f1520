// SPDX-License-Identifier: Apache-2.0
#include "cli/terminal/document.h"

#include <fmt/core.h>

#include <algorithm>
#include <cctype>
#include <filesystem>

#include "cli/exit.h"
#include "cli/terminal/arguments.h"
#include "cli/terminal/render.h"
#include "report/content.h"
#include "report/json.h"

namespace slabd::cli {

void DocumentOptions::add_to(args::Command& command) {
  command.add_option("--out", out, "A document as well: .pdf, .html, .svg or .png");
  language.add_to(command, "Language of the document");
}

std::string DocumentOptions::extension() const {
  std::string ending = std::filesystem::path(out).extension().string();
  std::transform(ending.begin(), ending.end(), ending.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  return ending;
}

void DocumentOptions::check() const {
  static_cast<void>(wanted());
  const std::string ending = extension();
  if (!out.empty() && ending != ".pdf" && ending != ".html" && ending != ".svg" && ending != ".png")
    stop(kUsage, fmt::format("--out {}: the name must end in .pdf, .html, .svg or .png", out));
}

void DocumentOptions::write(const report::Report& document) const {
  if (out.empty()) return;
  const std::string ending = extension();
  need(ending == ".pdf"   ? report::write_pdf(document, out)
       : ending == ".svg" ? report::write_svg(document, page, out)
       : ending == ".png" ? report::write_png(document, page, dots_per_inch, out)
                          : report::write_html(document, out),
       kBadInput);
}

void TableOutput::add_to(args::Command& command, const std::string& schema) {
  command.add_flag("--json", json, "Print " + schema + " on stdout");
  command.add_flag("--csv", csv, "Print a CSV on stdout")->excludes("--json");
  command.add_flag("--html", html, "Print an HTML document on stdout")->excludes("--json").excludes("--csv");
}

void TableOutput::print(const report::Table& table, report::Json document, const std::string& name) const {
  if (json) {
    report::write_rows(document, name, table);
    fmt::print("{}", document.text());
  } else if (csv) {
    fmt::print("{}{}", report::csv_heading(table), report::csv_rows(table, report::TableFor::spreadsheet));
  } else if (html) {
    report::Report page;
    page.judged = false;
    page.title = table.title;
    page.sections.emplace_back().parts.emplace_back(table);
    fmt::print("{}", report::html(page));
  } else {
    fmt::print("{}\n\n{}", table.title, report::text_of(table, style_for(stdout)));
  }
}

}  // namespace slabd::cli
