// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <initializer_list>
#include <string>
#include <string_view>
#include <vector>

#include "base/items.h"
#include "base/result.h"

/// Tables for studies: one line of column names, then values. The separator is that of the first line: comma,
/// semicolon or tab. A byte order mark, blanks around cells, "quoted" cells, empty lines and # comments are accepted.
namespace slabd::cli::study {

class CsvTable {
 public:
  /// Code::config with file:line and the fault: a duplicate column, a line with more or fewer cells, or an empty file.
  [[nodiscard]] static Result<CsvTable> read(const std::string& path);
  /// The same for a text; `path` is used in errors.
  [[nodiscard]] static Result<CsvTable> parse(std::string_view text, const std::string& path);

  [[nodiscard]] std::size_t rows() const { return rows_.size(); }
  [[nodiscard]] bool has(std::string_view column) const;
  /// Empty if the column does not exist.
  [[nodiscard]] const std::string& cell(std::size_t row, std::string_view column) const;
  /// NaN for an empty cell or a missing column. Code::config if the cell is not a finite number (a decimal comma is
  /// invalid).
  [[nodiscard]] Result<double> number(std::size_t row, std::string_view column) const;
  /// Columns lower and upper, each as `number`. Code::config also if the lower limit is not below the upper one.
  struct Limits {
    double lower = kNoValue;
    double upper = kNoValue;
  };
  [[nodiscard]] Result<Limits> limits(std::size_t row) const;
  /// A block number 1..18; 0 for an empty cell or a missing column.
  [[nodiscard]] Result<int> block(std::size_t row, std::string_view column = "block") const;
  /// "plan.csv:7"
  [[nodiscard]] std::string place(std::size_t row) const;
  /// Code::config: names missing and unknown columns (an unknown one is probably a typing error).
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
