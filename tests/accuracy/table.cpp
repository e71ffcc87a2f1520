// SPDX-License-Identifier: Apache-2.0
#include "tests/accuracy/table.h"

#include <fmt/core.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>

namespace slabd::accuracy {

void Table::at_most(const std::string& what, double measured, double limit, const std::string& unit) {
  rows_.push_back({what, measured, unit, fmt::format("<= {:.6g}", limit), measured <= limit});
}

void Table::at_least(const std::string& what, double measured, double limit, const std::string& unit) {
  rows_.push_back({what, measured, unit, fmt::format(">= {:.6g}", limit), measured >= limit});
}

void Table::within(const std::string& what, double measured, double lower, double upper, const std::string& unit) {
  rows_.push_back(
      {what, measured, unit, fmt::format("{:.6g} .. {:.6g}", lower, upper), measured >= lower && measured <= upper});
}

void Table::tell(const std::string& what, double measured, const std::string& unit) {
  rows_.push_back({what, measured, unit, "", true});
}

bool Table::all_ok() const {
  return std::all_of(rows_.begin(), rows_.end(), [](const Row& row) { return row.ok; });
}

void Table::print() const {
  std::size_t width = 4;
  for (const Row& row : rows_) width = std::max(width, row.what.size());
  fmt::print("  {:{}}  {:>12} {:5} {:>20}  {}\n", "what", width, "measured", "", "goal", "ok");
  for (const Row& row : rows_)
    fmt::print("  {:{}}  {:>12.5g} {:5} {:>20}  {}\n", row.what, width, row.measured, row.unit, row.goal,
               row.goal.empty() ? "" : (row.ok ? "yes" : "NO"));
  std::fflush(stdout);
}

double mean(const std::vector<double>& values) {
  return std::accumulate(values.begin(), values.end(), 0.0) / static_cast<double>(values.size());
}

double rms(const std::vector<double>& values) {
  const double sum = std::inner_product(values.begin(), values.end(), values.begin(), 0.0);
  return std::sqrt(sum / static_cast<double>(values.size()));
}

double largest(const std::vector<double>& values) {
  return values.empty() ? std::numeric_limits<double>::quiet_NaN() : *std::max_element(values.begin(), values.end());
}

double spread(const std::vector<double>& values) {
  if (values.empty()) return std::numeric_limits<double>::quiet_NaN();
  const auto [low, high] = std::minmax_element(values.begin(), values.end());
  return *high - *low;
}

double quantile(std::vector<double> values, double share) {
  if (values.empty()) return std::numeric_limits<double>::quiet_NaN();
  std::sort(values.begin(), values.end());
  const double rank = std::ceil(share * static_cast<double>(values.size())) - 1.0;
  return values[static_cast<std::size_t>(std::clamp(rank, 0.0, static_cast<double>(values.size() - 1)))];
}

}  // namespace slabd::accuracy
