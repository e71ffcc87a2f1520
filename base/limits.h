// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>

/// Every capacity of the daemon, each with the reason for its size. Everything on the inspection path is allocated
/// once from these numbers before the first slab; nothing grows afterwards. Passing a limit is an error with a code,
/// never a reallocation.
namespace slabd::limits {

/// Arrays of the inspection path begin at multiples of this: a cache line, and the widest vector register.
inline constexpr std::size_t kArrayAlignment = 64;
/// What an array takes up in `Pages`.
constexpr std::size_t array_bytes(std::size_t count, std::size_t item_bytes) {
  return (count * item_bytes + kArrayAlignment - 1) / kArrayAlignment * kArrayAlignment;
}

// ---- the slab ------------------------------------------------------------------------------------------------
/// Supporting blocks of the longest slab: 9 pairs on P5600. The PLC map's station table has 18 rows.
inline constexpr std::size_t kStationsMax = 18;
inline constexpr std::size_t kPairsMax = kStationsMax / 2;
/// Slab types known at once; the line makes four (P5600, P4925, P4856, P5350), the rest is room.
inline constexpr std::size_t kRecipesMax = 16;
/// SLAB_ID occupies 16 registers of two characters (HR 16..31).
inline constexpr std::size_t kSlabIdBytes = 32;

// ---- the scan ------------------------------------------------------------------------------------------------
/// What holds points is so many times as large as a 5-megapixel scanner needs. bench/ compiles the measuring for 4, to
/// see how its cost grows; slabd itself has 1.
#ifndef SLABD_SCAN_SIZES
#define SLABD_SCAN_SIZES 1
#endif
inline constexpr std::size_t kScanSizes = SLABD_SCAN_SIZES;
/// A 5-megapixel scanner delivers 2448 x 2048 = 5 013 504 points at most; 20 % in reserve for its successor.
inline constexpr std::size_t kScanPointsMax = kScanSizes * 6'000'000;
/// One scan is measured while the next one arrives. A third would only hide a scanner that outruns the computer.
inline constexpr std::size_t kScanSlots = 2;
/// Room for one scan's x y z as float32: 72 MB.
inline constexpr std::size_t kScanSlotBytes = kScanPointsMax * 3 * sizeof(float);
/// Fewer finite points than this cannot hold a block (a real scan has a hundred times more): code 401.
inline constexpr std::size_t kScanPointsMin = 50'000;
/// A scan header longer than this is not a header.
inline constexpr std::size_t kScanHeaderBytesMax = 16'384;
/// Read-ahead piece while decoding a scan file; small enough to stay in the second-level cache.
inline constexpr std::size_t kScanReadBytes = 1U << 18U;

// ---- measuring workspace (allocated once by algo::BlockInspector) ----------------------------------------------
/// Neighbourhood cells of the isolation test: three point pitches wide, so nine points each; the largest scan needs
/// 670 000 and gets slightly coarser ones, never more of them.
inline constexpr std::size_t kDenoiseCellsMax = kScanSizes << 19U;
/// Looks at a point that denoising a scan without a grid may take, 6 ns each. A full scan on random rays takes 125
/// million, with a tenth of its points anywhere 260 million; a fog in which nothing is a surface would take 2 000
/// million. With this bound the worst clouds end within three seconds, long before the watchdog looks
/// (docs/MEASURING.md).
inline constexpr std::uint64_t kDenoiseLooksMax = kScanSizes * 350'000'000;
/// Points that take part in one ICP iteration. 2^16 points of 0.03 mm noise fix the pose to about 0.001 mm.
inline constexpr std::size_t kIcpPointsMax = 1U << 16U;
/// Cells of the closest-face table: 400 x 600 mm around the block at 1 mm.
inline constexpr std::size_t kFaceTableX = 400;
inline constexpr std::size_t kFaceTableY = 600;
/// Raster of the model's heights that the search for the block works on: the face table's area at 4 mm.
inline constexpr std::size_t kHeightMapCells = (kFaceTableX / 4) * (kFaceTableY / 4);
/// Flatness cells: 102 x 150 mm at 1.5 mm is 68 x 100; a quarter more for another recipe's crop.
inline constexpr std::size_t kFlatnessCellsMax = 8'500;
/// Points over the evaluation region. It is a seventh of a block seen from above: a scan that shows a whole block and
/// little else puts 910 000 there.
inline constexpr std::size_t kSeatPointsMax = kScanSizes << 20U;
/// Runs they come in: whoever writes them works through the scan in blocks.
inline constexpr std::size_t kSeatRunsMax = kScanSizes * 2'048;
/// Groups of 64 of them; the last one of each run may be smaller.
inline constexpr std::size_t kCellGroupsMax = kSeatPointsMax / 64 + kSeatRunsMax;
/// Stratified sample on which plane hypotheses are scored (notes: more does not help, less loses the best one).
inline constexpr std::size_t kPlaneSampleMax = 4'096;
/// Hypotheses of one plane fit: eq. (8) with half the points bad and P = 1 - 1e-6 asks for 104; 2^14 bounds E = 0.9.
inline constexpr std::size_t kPlaneHypothesesMax = 16'384;
/// Angular sectors of a casing's edge: 7.5 degrees, 2 mm of arc. Wide enough that many points compete for the
/// innermost one, which narrows its gap to the edge; still enough of them for a robust circle.
inline constexpr std::size_t kRimSectors = 48;
/// Findings kept of one block, damage first and the largest first: a person looks at the block after a few of them. A
/// block of good concrete has about thirty pores that are large enough to be listed.
inline constexpr std::size_t kFindingsMax = 32;
/// Displaced or missing area from which a block is not passed by a recipe without the item block_damage: a fifth of
/// what one casing's rim covers.
inline constexpr double kFindingArea_mm2 = 100.0;
/// Cells of the surface raster (algo/survey/surface_raster.h), 1.25 mm: 260 x 550 mm around the block.
inline constexpr std::size_t kSurfaceColumns = 208;
inline constexpr std::size_t kSurfaceRows = 440;
inline constexpr std::size_t kSurfaceCells = kSurfaceColumns * kSurfaceRows;
/// Histogram of distances to the model (shares within 1..6 sigma): bins of 0.05 um over a 3 mm gate.
inline constexpr std::size_t kDeviationBins = 1U << 16U;

/// The survey works on the scan in blocks of this many points.
inline constexpr std::size_t kSurveyBlockPoints = 65'536;
inline constexpr std::size_t kSurveyBlocksMax = (kScanPointsMax + kSurveyBlockPoints - 1) / kSurveyBlockPoints;
/// Pieces of 1024 points for those it lists: over the evaluation region, around both casings, on the jaws, and near the
/// planes' thresholds; they lie in the memory of the index, which is not needed by then. A block of the scan may leave
/// a piece of each of eight lists all but empty; the rest holds 1.2 million points, of which a block seen from above
/// has 300 000.
inline constexpr std::size_t kSurveyPiecesMax = kScanPointsMax / (3 * 1024);
static_assert((kSurveyPiecesMax - 8 * kSurveyBlocksMax) * 1000 > kSeatPointsMax);
/// Cells of the deviation map, over the face table's area.
inline constexpr std::size_t kDeviationMapCell_mm = 4;
inline constexpr std::size_t kDeviationMapCells =
    (kFaceTableX / kDeviationMapCell_mm) * (kFaceTableY / kDeviationMapCell_mm);

// ---- maps kept with a block (base/packed_map.h) ------------------------------------------------------------------
/// Columns, and rows, of a map: the deviation map has 100 x 150 cells, the seat's 68 x 100.
inline constexpr std::size_t kMapColumnsMax = 512;
/// Room for one packed map. Of a scan with 0.03 mm noise the deviation map takes 5 kB and the seat's 2 kB; a rougher
/// one is kept with a wider step. Two of them for each block whose result waits to be stored.
inline constexpr std::size_t kPackedMapBytes = 8'192;
/// Heights are kept to this: well below the noise of one cell, and far below what a colour shows.
inline constexpr double kDeviationMapStep_mm = 0.01;
inline constexpr double kSeatMapStep_mm = 0.005;
static_assert(kDeviationMapCells <= kMapColumnsMax * kMapColumnsMax);

/// Bytes of algo's workspace, array by array as algo/inspector.cpp takes them; taking more ends the process.
inline constexpr std::size_t kWorkspaceBytes =
    array_bytes(kScanPointsMax, sizeof(std::uint32_t)) +                 // an index of each point
    array_bytes(kScanPointsMax, sizeof(std::uint8_t)) +                  // a label of each point
    array_bytes(kDenoiseCellsMax + 1, sizeof(std::uint32_t)) +           // where each cell's points start
    array_bytes(kDenoiseCellsMax, 3 * sizeof(float)) +                   // the surface in each cell
    array_bytes(kIcpPointsMax, 3 * sizeof(double)) +                     // the points ICP works on
    array_bytes(kIcpPointsMax, sizeof(double)) +                         // their residuals
    array_bytes(kDeviationBins, sizeof(std::uint32_t)) +                 // histogram of distances
    3 * array_bytes(kFaceTableX * kFaceTableY, sizeof(std::uint16_t)) +  // face table: wide, near, scratch
    array_bytes(kHeightMapCells, sizeof(float)) +                        // height map
    array_bytes(kFaceTableX * kFaceTableY, sizeof(std::uint32_t)) +      // survey: what each place belongs to,
    array_bytes(kSurveyBlocksMax, 640) +                                 // sums of each block,
    array_bytes(kSurveyPiecesMax, 48) +                                  // runs of points,
    2 * array_bytes(kSurveyPiecesMax, sizeof(std::uint32_t)) +           // their order and sizes,
    2 * array_bytes(kDeviationMapCells, sizeof(std::int64_t)) +          // deviation map of either thread: sums
    2 * array_bytes(kDeviationMapCells, sizeof(std::uint32_t)) +         // and counts
    array_bytes(kSurfaceCells, sizeof(std::uint16_t)) +                  // surface raster: the face of each cell
    array_bytes(kSeatPointsMax, sizeof(float)) +                         // single heights of doubtful flatness cells
    array_bytes(kCellGroupsMax, 2 * sizeof(std::uint16_t)) +             // flatness cells: what groups of points saw,
    array_bytes(2 * kFlatnessCellsMax, 64) +                             // sums of either half of the points,
    2 * array_bytes(kFlatnessCellsMax + 1, sizeof(std::uint32_t)) +      // marks, groups of them
    array_bytes(kFlatnessCellsMax, 3 * sizeof(double));                  // and means
/// What the inspection path holds for ever, every byte of it resident from the start.
inline constexpr std::size_t kInspectionBytes = kScanSlots * kScanSlotBytes + kWorkspaceBytes;
/// What the process adds: code, stacks, SQLite's cache and statements, the station and its queues.
inline constexpr std::size_t kProcessBytes = 20'500'000;
static_assert(kScanSlotBytes + kWorkspaceBytes + kProcessBytes <= kScanSizes * 160'000'000,
              "one scan in flight must fit an industrial PC beside its other work");
static_assert(kScanSlotBytes <= kScanSizes * 72'000'000, "and so must every further one");

// ---- robot pose ----------------------------------------------------------------------------------------------
/// 2 s of poses at 250 Hz (4 ms, the fastest robot cycle), rounded up.
inline constexpr std::size_t kPoseRing = 512;
/// One LCM short message: 8 bytes header, channel, 92 bytes of pose; anything larger is not ours.
inline constexpr std::size_t kLcmDatagramMax = 1'500;
/// Poses handled per turn of the loop, so that a flood of datagrams cannot starve the PLC.
inline constexpr std::size_t kPosesPerTurn = 64;

// ---- PLC -----------------------------------------------------------------------------------------------------
/// Modbus clients: the PLC, a spare, a display, a diagnosis tool, twice.
inline constexpr std::size_t kModbusClientsMax = 8;
/// MODBUS Messaging on TCP/IP V1.0b, 4.1: 7 bytes MBAP + 253 bytes PDU.
inline constexpr std::size_t kModbusAduMax = 260;
/// Frames served per client and turn; a pipelining client must not starve the others.
inline constexpr std::size_t kModbusFramesPerTurn = 4;
/// Results waiting for RES_ACK: three whole slabs of 18 stations and a verdict. Beyond it SCAN is refused (103).
inline constexpr std::size_t kResultQueueMax = 3 * (kStationsMax + 1);

// ---- the daemon's threads ------------------------------------------------------------------------------------
/// Jobs that may wait for a worker. Storage is the busiest: acknowledgements, a block, a command and a session
/// change can meet while one slow sync runs.
inline constexpr std::size_t kWorkerQueue = 64;
/// Actions one event can cause (the largest: restart, which re-measures a whole slab).
inline constexpr std::size_t kActionsMax = 64;
/// Control connections at once, and the longest line on one.
inline constexpr std::size_t kControlClientsMax = 4;
inline constexpr std::size_t kControlLineBytes = 65'536;

// ---- text ----------------------------------------------------------------------------------------------------
inline constexpr std::size_t kErrorTextBytes = 320;
inline constexpr std::size_t kPathBytes = 256;

static_assert(kActionsMax >= 2 * kStationsMax + 4, "a restart re-presents and re-measures every station at once");
static_assert(kPoseRing >= 2 * 250, "the ring must hold settle window, dwell and exposure start at 250 Hz");

}  // namespace slabd::limits
