// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "cli/terminal/say.h"
#include "report/content.h"
#include "report/table.h"

namespace slabd::cli::args {
class Command;
}  // namespace slabd::cli::args

namespace slabd::cli {

/// --out FILE, whose extension selects the format, and --language.
struct DocumentOptions {
  std::string out;
  LanguageOption language;
  int page = 0;                  ///< page of .svg and .png; 0: all, below each other
  double dots_per_inch = 100.0;  ///< for .png

  void add_to(args::Command& command);
  [[nodiscard]] report::Language wanted() const { return language.chosen(); }
  /// The extension, for example ".pdf", in lower case.
  [[nodiscard]] std::string extension() const;
  /// Stops if the extension is not .pdf, .html, .svg or .png, or if the language is unknown.
  void check() const;
  /// Writes the document if a name was given; stops on an error.
  void write(const report::Report& document) const;
};

/// Output of a command with one table: terminal, --json, --csv or --html.
struct TableOutput {
  bool json = false;
  bool csv = false;
  bool html = false;
  void add_to(args::Command& command, const std::string& schema);
  /// `document` contains the JSON fields before the rows, which are written as the list `name`.
  void print(const report::Table& table, report::Json document, const std::string& name) const;
};

}  // namespace slabd::cli
