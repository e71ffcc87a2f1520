// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "cli/replay/remeasure.h"
#include "storage/storage.h"

/// Stored scans as clouds that other programs open: PLY, binary, little-endian, mm.
namespace slabd::cli {

struct CloudSettings {
  hal::ScanForm form;
  std::string scans_dir;  ///< a copy of the spool, for scans that were moved away
  double voxel_mm = 0.0;  ///< one mean point for each cube of this size; 0: every point
};
struct CloudCount {
  std::size_t points = 0;                ///< written
  std::size_t left_out = 0;              ///< of a block: seen, but not within 25 mm of any of its faces
  std::vector<std::string> not_scanned;  ///< a sentence for each block that is not in the cloud
};

/// One block in its own frame, as it was registered: x, y, z, `deviation_mm` (signed distance to the nearest face of
/// the recipe's block, positive is material too much) and `face` (the order of algo::Face). Points that no surface goes
/// through are left out, as they are in measuring. config: not registered, no scan, or `path` cannot be written.
[[nodiscard]] Result<CloudCount> write_block_cloud(const std::string& path, const storage::SlabRecord& record,
                                                   int station, const Recipe& recipe, const CloudSettings& settings);

/// All blocks of a slab spliced (paper eq. (7)) in the slab frame: x, y, z and `station`. Where the slab was not
/// fitted, the frame is the configured one and a comment says so. One scan is in memory at a time. Errors as above.
[[nodiscard]] Result<CloudCount> write_slab_cloud(const std::string& path, const storage::SlabRecord& record,
                                                  const Recipe& recipe, const CloudSettings& settings);

}  // namespace slabd::cli
