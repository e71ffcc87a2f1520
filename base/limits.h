// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstddef>
#include <cstdint>

/// All capacities of the daemon, with the reason for each size. All memory of the inspection path is allocated once
/// from these numbers before the first slab, and never grows. Exceeding a limit is an error with a code, never a
/// reallocation.
namespace slabd::limits {

/// Alignment of the arrays of the inspection path: a cache line, and the widest vector register.
inline constexpr std::size_t kArrayAlignment = 64;
/// Size of an array in `Pages`.
constexpr std::size_t array_bytes(std::size_t count, std::size_t item_bytes) {
  return (count * item_bytes + kArrayAlignment - 1) / kArrayAlignment * kArrayAlignment;
}

// ---- the slab ------------------------------------------------------------------------------------------------
/// Supporting blocks of the longest slab: 9 pairs on P5600. The PLC map's station table has 18 rows.
inline constexpr std::size_t kStationsMax = 18;
inline constexpr std::size_t kPairsMax = kStationsMax / 2;
/// Slab types loaded at once; the line makes four (P5600, P4925, P4856, P5350), the rest is reserve.
inline constexpr std::size_t kRecipesMax = 16;
/// Robots with a scanner on a line (base/arm.h): one for each row of the longest slab.
inline constexpr std::size_t kArmsMax = 2;
/// SLAB_ID occupies 16 registers of two characters (HR 16..31).
inline constexpr std::size_t kSlabIdBytes = 32;

// ---- the scan ------------------------------------------------------------------------------------------------
/// Factor for all capacities that hold points, relative to a 5-megapixel scanner. slabd uses 1. bench/ compiles the
/// measurement with 4 to find how its cost grows.
#ifndef SLABD_SCAN_SIZES
#define SLABD_SCAN_SIZES 1
#endif
inline constexpr std::size_t kScanSizes = SLABD_SCAN_SIZES;
/// A 5-megapixel scanner delivers at most 2448 x 2048 = 5 013 504 points; 20 % reserve for its successor.
inline constexpr std::size_t kScanPointsMax = kScanSizes * 6'000'000;
/// One scan is measured while the next one arrives. A third slot would only hide a scanner that is faster than the
/// computer.
inline constexpr std::size_t kScanSlots = 2;
/// Slots of a line with this number of arms: one more for each further arm, because a scanner that hangs keeps its slot
/// until it answers.
constexpr std::size_t scan_slots(std::size_t arms) {
  return kScanSlots + arms - 1;
}
inline constexpr std::size_t kScanSlotsMax = scan_slots(kArmsMax);
/// Memory for one scan's x y z as float32: 72 MB.
inline constexpr std::size_t kScanSlotBytes = kScanPointsMax * 3 * sizeof(float);
/// Minimum of finite points in a scan of a block (a real scan has a hundred times more); fewer: code 401.
inline constexpr std::size_t kScanPointsMin = 50'000;
/// Largest length of a scan header.
inline constexpr std::size_t kScanHeaderBytesMax = 16'384;
/// Read-ahead size when a scan file is decoded; it fits the second-level cache.
inline constexpr std::size_t kScanReadBytes = 1U << 18U;

// ---- measuring workspace (allocated once by algo::BlockInspector) ----------------------------------------------
/// Neighbourhood cells of the isolation test: three point pitches wide, so nine points each. The largest scan needs
/// 670 000, so it gets slightly coarser cells instead of more.
inline constexpr std::size_t kDenoiseCellsMax = kScanSizes << 19U;
/// Limit of point visits when a scan without a grid is denoised, 6 ns each. A full scan on random rays takes 125
/// million; with a tenth of its points at random places it takes 260 million. A cloud without any surface would take
/// 2 000 million. With this limit the worst clouds end within three seconds, long before the watchdog acts
/// (docs/MEASURING.md).
inline constexpr std::uint64_t kDenoiseLooksMax = kScanSizes * 350'000'000;
/// Points used in one ICP iteration. 2^16 points of 0.03 mm noise determine the pose to about 0.001 mm.
inline constexpr std::size_t kIcpPointsMax = 1U << 16U;
/// Cells of the closest-face table: 400 x 600 mm around the block at 1 mm.
inline constexpr std::size_t kFaceTableX = 400;
inline constexpr std::size_t kFaceTableY = 600;
/// Raster of the model's heights for the block search: the face table's area at 4 mm.
inline constexpr std::size_t kHeightMapCells = (kFaceTableX / 4) * (kFaceTableY / 4);
/// Flatness cells: 102 x 150 mm at 1.5 mm is 68 x 100, plus a quarter for a larger crop in another recipe.
inline constexpr std::size_t kFlatnessCellsMax = 8'500;
/// Points over the evaluation region, which is a seventh of a block seen from above. A scan that contains a whole block
/// and little else has 910 000 there.
inline constexpr std::size_t kSeatPointsMax = kScanSizes << 20U;
/// Runs of these points: the scan is processed in blocks, and each block writes its own runs.
inline constexpr std::size_t kSeatRunsMax = kScanSizes * 2'048;
/// Groups of 64 of these points; the last group of each run may be smaller.
inline constexpr std::size_t kCellGroupsMax = kSeatPointsMax / 64 + kSeatRunsMax;
/// Size of the stratified sample for plane hypotheses. A larger sample does not help; a smaller one can lose the best
/// hypothesis.
inline constexpr std::size_t kPlaneSampleMax = 4'096;
/// Hypotheses of one plane fit: eq. (8) with half the points bad and P = 1 - 1e-6 requires 104; 2^14 suffices for
/// E = 0.9.
inline constexpr std::size_t kPlaneHypothesesMax = 16'384;
/// Angular sectors of a casing's edge: 7.5 degrees, 2 mm of arc. A sector contains many candidates for the innermost
/// point, which reduces that point's distance from the edge. There are still enough sectors for a robust circle.
inline constexpr std::size_t kRimSectors = 48;
/// Findings stored per block, damage first and the largest first. After a few of them a person inspects the block
/// anyway. A block of good concrete has about thirty pores large enough to be listed.
inline constexpr std::size_t kFindingsMax = 32;
/// Displaced or missing area that prevents a pass if no item block_damage judges it: a fifth of the area of one
/// casing's rim.
inline constexpr double kFindingArea_mm2 = 100.0;
/// Cells of the surface raster (algo/survey/surface_raster.h), 1.25 mm: 260 x 550 mm around the block.
inline constexpr std::size_t kSurfaceColumns = 208;
inline constexpr std::size_t kSurfaceRows = 440;
inline constexpr std::size_t kSurfaceCells = kSurfaceColumns * kSurfaceRows;
/// Bins of the histogram of distances to the model (shares within 1..6 sigma): 0.05 um each over a 3 mm gate.
inline constexpr std::size_t kDeviationBins = 1U << 16U;

/// The survey works on the scan in blocks of this many points.
inline constexpr std::size_t kSurveyBlockPoints = 65'536;
inline constexpr std::size_t kSurveyBlocksMax = (kScanPointsMax + kSurveyBlockPoints - 1) / kSurveyBlockPoints;
/// Pieces of 1024 points for the survey's lists: the evaluation region, both casings, the jaws, and points near the
/// planes' thresholds. They use the memory of the index, which is free by then. Each block of the scan may leave a
/// nearly empty piece in each of eight lists. The other pieces hold 1.2 million points; a block seen from above needs
/// 300 000.
inline constexpr std::size_t kSurveyPiecesMax = kScanPointsMax / (3 * 1024);
static_assert((kSurveyPiecesMax - 8 * kSurveyBlocksMax) * 1000 > kSeatPointsMax);
/// Cells of the deviation map, over the face table's area.
inline constexpr std::size_t kDeviationMapCell_mm = 4;
inline constexpr std::size_t kDeviationMapCells =
    (kFaceTableX / kDeviationMapCell_mm) * (kFaceTableY / kDeviationMapCell_mm);

// ---- maps kept with a block (base/packed_map.h) ------------------------------------------------------------------
/// Largest number of columns and of rows of a map: the deviation map has 100 x 150 cells, the seat's 68 x 100.
inline constexpr std::size_t kMapColumnsMax = 512;
/// Memory for one packed map. At 0.03 mm noise the deviation map takes 5 kB and the seat map 2 kB; a rougher map is
/// stored with a larger step. There are two for each block whose result waits to be stored.
inline constexpr std::size_t kPackedMapBytes = 8'192;
/// Resolution of stored heights: far below the noise of one cell and below the resolution of the colour scale.
inline constexpr double kDeviationMapStep_mm = 0.01;
inline constexpr double kSeatMapStep_mm = 0.005;
static_assert(kDeviationMapCells <= kMapColumnsMax * kMapColumnsMax);

/// Bytes of algo's workspace, listed in the order of algo/inspector.cpp; taking more ends the process.
inline constexpr std::size_t kWorkspaceBytes =
    array_bytes(kScanPointsMax, sizeof(std::uint32_t)) +                 // an index of each point
    array_bytes(kScanPointsMax, sizeof(std::uint8_t)) +                  // a label of each point
    array_bytes(kDenoiseCellsMax + 1, sizeof(std::uint32_t)) +           // start of each cell's points
    array_bytes(kDenoiseCellsMax, 3 * sizeof(float)) +                   // the surface in each cell
    array_bytes(kIcpPointsMax, 3 * sizeof(double)) +                     // points used by ICP
    array_bytes(kIcpPointsMax, sizeof(double)) +                         // their residuals
    array_bytes(kDeviationBins, sizeof(std::uint32_t)) +                 // histogram of distances
    3 * array_bytes(kFaceTableX * kFaceTableY, sizeof(std::uint16_t)) +  // face table: wide, near, scratch
    array_bytes(kHeightMapCells, sizeof(float)) +                        // height map
    array_bytes(kFaceTableX * kFaceTableY, sizeof(std::uint32_t)) +      // survey: face at each place,
    array_bytes(kSurveyBlocksMax, 640) +                                 // sums of each block,
    array_bytes(kSurveyPiecesMax, 48) +                                  // runs of points,
    2 * array_bytes(kSurveyPiecesMax, sizeof(std::uint32_t)) +           // their order and sizes,
    2 * array_bytes(kDeviationMapCells, sizeof(std::int64_t)) +          // deviation map of either thread: sums
    2 * array_bytes(kDeviationMapCells, sizeof(std::uint32_t)) +         // and counts
    array_bytes(kSurfaceCells, sizeof(std::uint16_t)) +                  // surface raster: the face of each cell
    array_bytes(kSeatPointsMax, sizeof(float)) +                         // single heights of doubtful flatness cells
    array_bytes(kCellGroupsMax, 2 * sizeof(std::uint16_t)) +         // flatness cells: what groups of points contain,
    array_bytes(2 * kFlatnessCellsMax, 64) +                         // sums of either half of the points,
    2 * array_bytes(kFlatnessCellsMax + 1, sizeof(std::uint32_t)) +  // marks, groups of them
    array_bytes(kFlatnessCellsMax, 3 * sizeof(double));              // and means
/// Memory that the inspection path of a line with this number of arms holds permanently, resident from the start.
constexpr std::size_t inspection_bytes(std::size_t arms) {
  return scan_slots(arms) * kScanSlotBytes + kWorkspaceBytes;
}
inline constexpr std::size_t kInspectionBytes = inspection_bytes(1);
static_assert(kScanSlotsMax == 3 && inspection_bytes(kArmsMax) == kInspectionBytes + kScanSlotBytes,
              "a second arm takes the memory of one scan");
/// Memory of the rest of the process: code, stacks, SQLite's cache and statements, the station and its queues. The
/// kernel decides how many pages of program and libraries it maps, so they have a reserve of 2.8 MB.
inline constexpr std::size_t kProcessBytes = 25'000'000;
static_assert(kScanSlotBytes + kWorkspaceBytes + kProcessBytes <= kScanSizes * 160'000'000,
              "one scan in flight must fit an industrial PC together with its other work");
static_assert(kScanSlotBytes <= kScanSizes * 72'000'000, "and so must every further one");

// ---- robot pose ----------------------------------------------------------------------------------------------
/// 2 s of poses at 250 Hz (4 ms, the fastest robot cycle), rounded up.
inline constexpr std::size_t kPoseRing = 512;
/// One LCM short message: 8 bytes header, channel, 92 bytes of pose; a larger datagram is ignored.
inline constexpr std::size_t kLcmDatagramMax = 1'500;
/// Poses processed per turn of the loop, so that a flood of datagrams cannot starve the PLC.
inline constexpr std::size_t kPosesPerTurn = 64;

// ---- PLC -----------------------------------------------------------------------------------------------------
/// Modbus clients: the PLC, a spare, a display and a diagnosis tool, each twice.
inline constexpr std::size_t kModbusClientsMax = 8;
/// MODBUS Messaging on TCP/IP V1.0b, 4.1: 7 bytes MBAP + 253 bytes PDU.
inline constexpr std::size_t kModbusAduMax = 260;
/// Frames served per client and turn; a client that pipelines requests must not starve the others.
inline constexpr std::size_t kModbusFramesPerTurn = 4;
/// Results waiting for RES_ACK: three whole slabs of 18 stations and a verdict. If it is full, SCAN is rejected (103).
inline constexpr std::size_t kResultQueueMax = 3 * (kStationsMax + 1);

// ---- gauges --------------------------------------------------------------------------------------------------
/// Gauges of a line: as many as HR 40..71 hold, two registers each. A line has two lengths, three widths, four
/// thicknesses and the four heights of the bottom.
inline constexpr std::size_t kGaugesMax = 16;
/// A gauge's name, such as "thickness_left_front".
inline constexpr std::size_t kGaugeNameBytes = 32;
/// Source of a gauge's values, as configured: "modbus:192.168.100.100:65535/255/65535" and a reserve.
inline constexpr std::size_t kGaugeSourceBytes = 64;
/// Gauges in one formula: a mean of the widths at eight places.
inline constexpr std::size_t kFormulaGaugesMax = 8;
/// Slabs in a row with the same value of a gauge after which it is reported as stuck. Slabs scatter by tenths of a
/// millimetre and gauges resolve hundredths, so that even three equal values in a row are unlikely.
inline constexpr int kGaugeStuckSlabs = 20;
/// Share of the nominal by which each gauge of a mean may be off. A slab is never a tenth too long; a gauge in another
/// unit, or one that measures another dimension, is.
inline constexpr double kGaugeOffShareMax = 0.1;
/// Values in one datagram of a gauge hub, one a line: all gauges of the line.
inline constexpr std::size_t kGaugeDatagramBytes = 1'472;  // one Ethernet frame

// ---- the daemon's threads ------------------------------------------------------------------------------------
/// Jobs that may wait for a worker. Storage is the busiest: acknowledgements, a block, a command and a session change
/// can arrive during one slow sync.
inline constexpr std::size_t kWorkerQueue = 64;
/// Actions caused by one event (the largest: a restart that measures a whole slab again).
inline constexpr std::size_t kActionsMax = 64;
/// Number of simultaneous control connections, and the longest line on one.
inline constexpr std::size_t kControlClientsMax = 4;
inline constexpr std::size_t kControlLineBytes = 65'536;

// ---- text ----------------------------------------------------------------------------------------------------
inline constexpr std::size_t kErrorTextBytes = 320;
inline constexpr std::size_t kPathBytes = 256;

static_assert(kActionsMax >= 2 * kStationsMax + 4, "a restart re-presents and re-measures every station at once");
static_assert(kPoseRing >= 2 * 250, "the ring must hold settle window, dwell and exposure start at 250 Hz");

}  // namespace slabd::limits
