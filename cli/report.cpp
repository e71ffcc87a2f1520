// SPDX-License-Identifier: Apache-2.0
//
// slabctl report: a stored slab as a document. It reads only the database, so slabs without scans can be reported.
#include <fmt/core.h>

#include <memory>

#include "cli/command.h"
#include "cli/database.h"
#include "cli/exit.h"
#include "cli/slab_choice.h"
#include "cli/terminal/arguments.h"
#include "cli/terminal/document.h"
#include "cli/terminal/parse.h"
#include "report/content.h"
#include "report/slab_view.h"

namespace slabd::cli {
namespace {

struct Options {
  DatabaseOptions database;
  std::string slab;
  std::string project;
  bool full = false;
  DocumentOptions document;
};

int report_slab(const Options& options) {
  DocumentOptions to = options.document;
  to.check();
  const std::string extension = to.extension();
  if (to.page != 0 && extension != ".svg" && extension != ".png")
    stop(kUsage, "--page is for .svg and .png; a .pdf or .html has all pages");
  const auto reader = open_database(options.database);
  const storage::SlabRecord found = named_slab(*reader, options.slab);
  if (to.out.empty()) to.out = fmt::format("slab-{}.pdf", found.summary.header.slab_no);
  const auto picture = need(report::picture_of(*reader, found), kNotReachable);
  std::string project = options.project;
  if (project.empty() && options.database.db.empty()) project = config_from(options.database.config).project;
  to.write(report::compose(*picture, {to.wanted(), options.full, project}));
  fmt::print("{}\n", to.out);
  return kDone;
}

}  // namespace

void add_report(args::Command& app) {
  auto options = std::make_shared<Options>();
  args::Command command = app.add_subcommand("report", "One slab as a document: PDF, HTML, SVG or PNG");
  command->footer(
      "\nReads the database only; the scans may be gone. A block that was not found in its scan has no maps, and the\n"
      "report states it. The first two pages are the whole answer: verdict, map, findings, basis, notes, signatures. "
      "The\n"
      "blocks with findings follow; --full adds all others, and the tables of the slab. Times are local (TZ).\n"
      "Examples: slabctl report SLAB-0042\n"
      "          slabctl report 12 --out 12.html --language zh\n"
      "          slabctl report 12 --out 12.png --page 1 --dpi 150");
  command
      ->add_option(
          "SLAB", options->slab,
          "Key (see history) or slab id (key:12, id:12 where a number may be either); the newest slab with that id")
      ->required();
  command->add_option("--out", options->document.out,
                      "The file; its extension selects the format; default: slab-NO.pdf");
  options->document.language.add_to(*command, "Language of the words; numbers and ids are the same in all");
  command->add_option("--page", options->document.page, "Page of .svg and .png; 0: all below each other")
      ->check(args::range(0, 1000))
      ->capture_default_str();
  command->add_option("--dpi", options->document.dots_per_inch, "Dots per inch of .png")
      ->check(within(20.0, 600.0))
      ->capture_default_str();
  command->add_flag("--full", options->full, "All blocks, and the tables of the slab");
  command->add_option("--project", options->project, "Name of the project; default: [report] project");
  options->database.add_to(*command);
  command->runs([options] { return report_slab(*options); });
}

}  // namespace slabd::cli
