// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>
#include <vector>

#include "cli/replay/remeasure.h"
#include "storage/storage.h"

/// Stored scans as point clouds for other programs: PLY, binary, little-endian, mm; and thinned for the page.
namespace slabd::cli {

struct CloudSettings {
  ScanForms forms;
  std::string scans_dir;  ///< a copy of the spool, for scans that were moved
  double voxel_mm = 0.0;  ///< one mean point per cube of this size; 0: every point
};
struct CloudCount {
  std::size_t points = 0;                ///< points written
  std::size_t left_out = 0;              ///< of a block: points further than 25 mm from all of its faces
  std::vector<std::string> not_scanned;  ///< a sentence for each block that is not in the cloud
};

/// Writes one block in its own frame, as it was registered: x, y, z, `deviation_mm` (signed distance to the nearest
/// face of the recipe's block, positive for excess material) and `face` (the order of algo::Face). Points that are not
/// on a surface are removed, as in measuring. Code::config: the block is not registered or has no scan, the file does
/// not hold the points that were measured, or `path` cannot be written.
[[nodiscard]] Result<CloudCount> write_block_cloud(const std::string& path, const storage::SlabRecord& record,
                                                   int station, const Recipe& recipe, const CloudSettings& settings);

/// Writes all blocks of a slab spliced (paper eq. (7)) in the slab frame: x, y, z and `station`. If the slab was not
/// fitted, the frame is the configured one, and a comment in the file names it. One scan is in memory at a time.
/// Errors as above.
[[nodiscard]] Result<CloudCount> write_slab_cloud(const std::string& path, const storage::SlabRecord& record,
                                                  const Recipe& recipe, const CloudSettings& settings);

/// Largest number of points in slabd.block_cloud/1: as many as a browser turns smoothly; the document has 2.2 MB then.
constexpr std::size_t kBlockCloudPointsMax = 200'000;

/// slabd.block_cloud/1 (docs/schemas/block_cloud.json): points of the scan of `block`, which is a measured and
/// registered attempt of the slab, in the block's frame. They are the points of the file: none is denoised. The same
/// scan gives the same document. `recipe`: that of the slab, for the distances to the block's faces; nullptr: without
/// them. Code::config: the file does not hold the points that were measured. Other errors as hal::read_scan. Memory: 12
/// bytes a point of the scan.
[[nodiscard]] Result<std::string> block_cloud_json(const SlabHeader& slab, const storage::SlabBlock& block,
                                                   const Recipe* recipe, const CloudSettings& settings);

}  // namespace slabd::cli
