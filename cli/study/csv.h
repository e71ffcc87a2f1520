// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <initializer_list>
#include <string>
#include <string_view>
#include <vector>

#include "base/items.h"
#include "base/result.h"

/// Tables that people keep beside a study: one line of column names, then values. Commas, semicolons or tabs, whichever
/// the first line uses; a byte order mark, blanks around cells, "quoted" cells, empty lines and # comments are fine.
namespace slabd::cli::study {

class CsvTable {
 public:
  /// config: file:line and what is wrong with it; a column named twice, a line with more or fewer cells, no line at
  /// all.
  [[nodiscard]] static Result<CsvTable> read(const std::string& path);
  /// The same of a text; `path` is what errors name.
  [[nodiscard]] static Result<CsvTable> parse(std::string_view text, const std::string& path);

  [[nodiscard]] std::size_t rows() const { return rows_.size(); }
  [[nodiscard]] bool has(std::string_view column) const;
  /// Empty where there is no such column.
  [[nodiscard]] const std::string& cell(std::size_t row, std::string_view column) const;
  /// NaN for an empty cell and where there is no such column. config: no number (a decimal comma is none), not finite.
  [[nodiscard]] Result<double> number(std::size_t row, std::string_view column) const;
  /// Columns lower and upper, each as `number`. config: also a lower limit that is not below the upper one.
  struct Limits {
    double lower = kNoValue;
    double upper = kNoValue;
  };
  [[nodiscard]] Result<Limits> limits(std::size_t row) const;
  /// A block number 1..18; 0 for an empty cell and where there is no such column.
  [[nodiscard]] Result<int> block(std::size_t row, std::string_view column = "block") const;
  /// "plan.csv:7"
  [[nodiscard]] std::string place(std::size_t row) const;
  /// config: names the columns that are missing, and columns that nobody reads (most likely a slip).
  [[nodiscard]] Status expect(std::initializer_list<std::string_view> needed,
                              std::initializer_list<std::string_view> optional) const;

 private:
  struct Row {
    int line = 0;
    std::vector<std::string> cells;
  };
  std::string path_;
  std::vector<std::string> columns_;
  std::vector<Row> rows_;
};

}  // namespace slabd::cli::study
