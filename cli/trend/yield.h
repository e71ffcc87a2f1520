// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>
#include <map>
#include <string>
#include <vector>

#include "cli/study/statistics.h"
#include "report/content.h"
#include "storage/storage.h"

/// First-pass yield: share of slabs that passed at their first inspection.
namespace slabd::cli::trend {

enum class GroupBy : std::uint8_t { day, shift, type, mould };

/// Begin of each shift, minutes after local midnight, rising.
using Shifts = std::vector<int>;
/// "06:00,14:00,22:00". Code::config: the expected form.
[[nodiscard]] Result<Shifts> parse_shifts(const std::string& text);

struct YieldGroup {
  std::string name;           ///< "2026-11-20", "2026-11-20 22:00-06:00", "5600"; a mould's number, 0 if unknown
  std::size_t inspected = 0;  ///< first inspections with a verdict
  std::size_t passed = 0;
  std::size_t failed = 0;
  std::size_t undecided = 0;  ///< indeterminate
  std::size_t not_measured = 0;
  std::size_t aborted = 0;  ///< not inspected
  std::size_t again = 0;    ///< later inspections of a slab that was inspected before; not in the yield
  study::Estimate yield;    ///< 0..1
  std::map<std::uint16_t, std::size_t> reasons;  ///< of first inspections that did not pass
};

/// Groups in the order of time, types and moulds by number. A shift over midnight belongs to the day of its begin.
/// Times are local. `shifts`: used by GroupBy::shift only.
[[nodiscard]] std::vector<YieldGroup> first_pass_yield(const std::vector<storage::Inspection>& inspections, GroupBy by,
                                                       const Shifts& shifts);
/// All groups together.
[[nodiscard]] YieldGroup total_of(const std::vector<YieldGroup>& groups);

/// Yield of each group with its interval.
[[nodiscard]] report::Figure yield_figure(const std::vector<YieldGroup>& groups, report::Language language);

/// A bar of a Pareto chart: one reason.
struct ParetoBar {
  std::string name;
  std::size_t failed = 0;
  std::size_t others = 0;  ///< undecided or stopped
};
/// Bars by falling count with their cumulative share; at most 12, the others together in the last one.
[[nodiscard]] report::Figure pareto_figure(std::vector<ParetoBar> bars, report::Language language);

}  // namespace slabd::cli::trend
