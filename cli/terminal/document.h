// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "report/content.h"
#include "report/table.h"

namespace slabd::args {
class Command;
}  // namespace slabd::args

namespace slabd::cli {

/// --out FILE, whose extension says what the document becomes, and --language.
struct DocumentOptions {
  std::string out;
  std::string language = "en";
  int page = 0;                  ///< of .svg and .png; 0: all, below each other
  double dots_per_inch = 100.0;  ///< of .png

  void add_to(args::Command& command);
  [[nodiscard]] report::Language wanted() const {
    return language == "zh" ? report::Language::zh : report::Language::en;
  }
  /// ".pdf", lower case.
  [[nodiscard]] std::string extension() const;
  /// Stops at a name that ends in none of .pdf, .html, .svg, .png.
  void check() const;
  /// Writes the document if a name was given; stops if that is not possible.
  void write(const report::Report& document) const;
};

class Json;

/// A command whose answer is one table: in the terminal, or what --json, --csv or --html ask for.
struct TableOutput {
  bool json = false;
  bool csv = false;
  bool html = false;
  void add_to(args::Command& command, const std::string& schema);
  /// `document` begins with what JSON has beside the rows, which are its list `name`.
  void print(const Table& table, Json document, const std::string& name) const;
};

}  // namespace slabd::cli
