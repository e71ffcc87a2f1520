// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <map>
#include <nlohmann/json.hpp>
#include <string>
#include <string_view>
#include <vector>

#include "bench/samples.h"

/// The measurements as one JSON object, and that object as tables.
namespace slabd::bench {

using Json = nlohmann::ordered_json;

/// Keys that the object of `script/bench --json` always contains: a number, or null if it was not measured. `_ms`:
/// milliseconds as `Figure::ms`; the warm floor, the block and its stages on the organised scan.
inline constexpr std::array<std::string_view, 23> kPromisedKeys = {"floor_read_warm_ms",
                                                                   "floor_read_warm_2t_ms",
                                                                   "floor_read_cold_ms",
                                                                   "floor_read_cold_2t_ms",
                                                                   "block_1t_ms",
                                                                   "block_2t_ms",
                                                                   "block_unorganised_1t_ms",
                                                                   "block_shuffled_1t_ms",
                                                                   "block_perspective_1t_ms",
                                                                   "read_ply_ms",
                                                                   "read_ply_cold_ms",
                                                                   "read_ply_cold_2t_ms",
                                                                   "read_xyz_ms",
                                                                   "denoise_1t_ms",
                                                                   "register_1t_ms",
                                                                   "extract_1t_ms",
                                                                   "plane_1t_ms",
                                                                   "allocations_per_block",
                                                                   "rss_mb",
                                                                   "file_to_verdict_1t_ms",
                                                                   "file_to_verdict_unorganised_1t_ms",
                                                                   "slab_verdict_wait_ms",
                                                                   "slab_block_compute_ms"};
/// The same for the programs that slabd is compared with.
inline constexpr std::array<std::string_view, 6> kPromisedPeerKeys = {
    "pcl_tuned_ms",   "open3d_tuned_ms",          "pcl_spec_ms",
    "open3d_spec_ms", "fastest_peer_register_ms", "fastest_peer_plane_ms"};

/// Output of bench/peers: one object per process run.
using PeerRuns = std::vector<Json>;

struct Measured {
  Samples stages;
  PeerRuns peers;    ///< timed; slabd's own runs among them
  PeerRuns counted;  ///< with heap calls counted, not timed
  PeerRuns scored;   ///< on scans of other seeds, for their errors; not timed
  Json growth;       ///< stages of a report for larger scans; they replace those of the same name here
  Json slabs;        ///< output of `slabctl simulate --json` per slab on the real daemon; null if not given
  Json environment;  ///< machine, versions, date, load; printed unchanged
};

[[nodiscard]] Json report(const Measured& measured);

/// The tables of RESULTS.md.
[[nodiscard]] std::string markdown(const Json& report);

}  // namespace slabd::bench
