// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

/// Results of a study: one figure per row, with its goal.
namespace slabd::accuracy {

class Table {
 public:
  struct Row {
    std::string what;
    double measured = 0.0;
    std::string unit;
    std::string goal;  ///< empty: information without a goal
    bool ok = true;
  };

  /// Adds a figure that must not exceed `limit`. NaN misses every goal.
  void at_most(const std::string& what, double measured, double limit, const std::string& unit);
  /// Adds a figure that must reach `limit`.
  void at_least(const std::string& what, double measured, double limit, const std::string& unit);
  void within(const std::string& what, double measured, double lower, double upper, const std::string& unit);
  /// Adds a figure for information.
  void tell(const std::string& what, double measured, const std::string& unit);

  [[nodiscard]] bool all_ok() const;
  [[nodiscard]] const std::vector<Row>& rows() const { return rows_; }
  void print() const;

 private:
  std::vector<Row> rows_;
};

/// Root mean square; NaN when empty.
[[nodiscard]] double rms(const std::vector<double>& values);
/// The value that `share` (0..1) of the values do not exceed, by nearest rank; NaN when empty.
[[nodiscard]] double quantile(std::vector<double> values, double share);
/// Largest minus smallest; NaN when empty.
[[nodiscard]] double spread(const std::vector<double>& values);
[[nodiscard]] double mean(const std::vector<double>& values);
[[nodiscard]] double largest(const std::vector<double>& values);

}  // namespace slabd::accuracy
