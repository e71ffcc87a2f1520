// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "base/base.h"
#include "config/config.h"

/// Design sheets of curve slabs and special slabs: CSV files, one line a seat.
namespace slabd::config {

/// The sheets of all slabs, by SLAB_ID.
struct DesignSet {
  std::vector<DesignSheet> sheets;  ///< ascending by SLAB_ID, each once
  std::vector<Problem> problems;    ///< a faulty file has no sheet in the set
};

[[nodiscard]] bool same(const DesignSet& a, const DesignSet& b);

/// First line of every file.
inline constexpr std::string_view kDesignHeading = "slab_id,slab_type,station,dx_mm,dy_mm,dz_mm,dslope_deg";

/// Reads all *.csv files of a folder, which may hold any number of slabs each. Every fault is a problem that names
/// file:line:column and what is allowed. A SLAB_ID in two files is a fault of both. An empty `dir` gives an empty set.
[[nodiscard]] DesignSet load_designs(const std::string& dir);
/// Adds the sheets and problems of one file.
void load_design_file(const std::string& path, DesignSet& set);
/// The same of its content; `path` is its name in problems. Pure.
void parse_designs(const std::string& path, std::string_view bytes, DesignSet& set);

}  // namespace slabd::config
