// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <concepts>
#include <cstdint>
#include <string_view>
#include <type_traits>

#include "hal/plc/plc_map.h"

/// The register table of map 1.1; private to this folder. Every register is defined once, here: address, type, scale,
/// unit, meaning. Cursors walk the list (plc_map.cpp): one writes registers from values, one reads them back, one
/// describes them in text. The documentation and `slabctl plc` are made from that text.
namespace slabd::hal {

/// Description of a register without its type, which is the cursor's function, and its value.
struct Reg {
  std::uint16_t address;
  const char* name;
  const char* unit;
  const char* meaning;
  const char* since = "1.0";
};
inline constexpr const char* kSince11 = "1.1";

/// Address of the i-th of `words` 16-bit parts; part 0 is the most significant one.
constexpr std::size_t part_address(std::size_t address, std::size_t words, std::size_t part, WordOrder order) {
  return address + (order == WordOrder::abcd ? part : words - 1 - part);
}
inline std::uint64_t wide_value(std::span<const std::uint16_t> image, std::size_t address, std::size_t words,
                                WordOrder order) {
  std::uint64_t value = 0;
  for (std::size_t part = 0; part < words; ++part)
    value = (value << 16U) | image[part_address(address, words, part, order)];
  return value;
}

/// 1 mm = 1000 um, 1 deg = 1000 millidegrees: one factor for both units.
inline constexpr double kThousandths = 1000.0;

inline constexpr std::uint16_t kRecordFirst = 30;
inline constexpr std::uint16_t kRecordCrc = 62;
inline constexpr std::uint16_t kRecordCopy = 63;
inline constexpr std::uint16_t kSlabIdFirst = 16;
inline constexpr std::uint16_t kSecondChip = 35;
inline constexpr std::uint16_t kCommandCrc = 37;

// ---- words for numbers -------------------------------------------------------------------------------------------

inline constexpr std::array<std::string_view, 9> kStateWords = {
    "init", "recover", "idle", "slab open", "settling", "scanning", "waiting for PLC", "fault", "maintenance"};
inline constexpr std::array<std::string_view, 6> kVerdictWords = {"none",         "pass",    "fail",
                                                                  "not measured", "aborted", "indeterminate"};
inline constexpr std::array<std::string_view, 6> kDispositionWords = {"none",   "hold",  "release by concession",
                                                                      "rework", "scrap", "re-inspect"};
inline constexpr std::array<std::string_view, 6> kCommandWords = {"none",     "SLAB_BEGIN", "SCAN",
                                                                  "SLAB_END", "SLAB_ABORT", "REPORT"};
inline constexpr std::array<std::string_view, 5> kStatusWords = {"none", "accepted", "acquiring", "acquired", "done"};
/// One word for each bit of PlcWarn.
inline constexpr std::array<std::string_view, 16> kWarnWords = {"unconfirmed nominals",
                                                                "commissioning calibration",
                                                                "stray scan files",
                                                                "results wait for RES_ACK",
                                                                "clock behind the records",
                                                                "a recipe is unusable",
                                                                "disk nearly full",
                                                                "no control socket",
                                                                "calibration check overdue",
                                                                "stations without correction",
                                                                "scanner not verified",
                                                                "handedness of the scanner not proven",
                                                                "recipe folder differs from recipes in use",
                                                                "emulation",
                                                                "robot stops alike over neighbouring blocks",
                                                                "a gauge needs care"};
inline constexpr std::array<std::string_view, 3> kKindWords = {"none", "station", "slab"};

/// IR 42..55, by kind of record. A plain number is a station, pair or count.
struct DeviationColumn {
  const char* station_name;
  const char* station_unit;
  const char* slab_name;
  const char* slab_unit;  ///< "" = a plain number
};
inline constexpr std::uint16_t kDeviationFirst = 42;
inline constexpr std::uint16_t kKindSlab = 2;
inline constexpr std::array<DeviationColumn, kPlcDeviations> kDeviations = {{
    {"seat_slope", "deg", "corner_level", "mm"},
    {"jaw_angle_inner", "deg", "warp_left", "mm"},
    {"jaw_angle_outer", "deg", "warp_right", "mm"},
    {"jaw_distance", "mm", "worst seat_spacing", "mm"},
    {"casing_spacing", "mm", "its station", ""},
    {"casing_protrusion_inner", "mm", "worst large_jaw_distance", "mm"},
    {"casing_protrusion_outer", "mm", "its pair", ""},
    {"casing_skew_inner", "mm", "worst seat_slope", "deg"},
    {"casing_skew_outer", "mm", "its station", ""},
    {"seat_lateral", "mm", "worst seat_lateral", "mm"},
    {"seat_vertical", "mm", "its station", ""},
    {"none", "", "worst seat_vertical", "mm"},
    {"none", "", "its station", ""},
    {"none", "", "failed stations", ""},
}};

template <typename Value, typename Of>
concept ValueOrConst = std::same_as<std::remove_const_t<Value>, Of>;

// ---- holding registers: written by the PLC -----------------------------------------------------------------------

template <typename Cursor, ValueOrConst<PlcInputs> Inputs>
void walk_inputs(Cursor& io, Inputs& in) {
  io.u16({0, "PLC_HEARTBEAT", "", "any change, at least every 500 ms; lost after 2.5 s"}, in.heartbeat);
  io.bit({1, "ENABLE", "", "PLC_CONTROL bit 0: automatic; commands are taken only while it is set"}, 0, in.enable);
  io.bit({1, "ABORT", "", "PLC_CONTROL bit 1: gives up the scan in hand; while it is set every SCAN ends with 110"}, 1,
         in.abort);
  io.bit({1, "FAULT_RESET", "", "PLC_CONTROL bit 2, rising edge: clears a fault whose cause is gone"}, 2,
         in.fault_reset);
  io.u16({2, "RES_ACK", "", "copy of RES_SEQ once the record is stored in the PLC"}, in.res_ack);
  io.u16({3, "SYNC_REQ", "", "changed by the PLC after its own restart: slabd begins a new SESSION"}, in.sync_req);
  io.reserved({4, "-", "", "reserved, write 0"}, 6);

  io.word({10, "CMD", "", "what to do"}, in.command, kCommandWords);
  io.u16({11, "STATION", "", "1..18 for SCAN and REPORT of a station, 0 else"}, in.station);
  io.u16({12, "SLAB_TYPE", "", "5600, 4925, 4856, ...: a recipe's slab_type; 0 = of the open slab"}, in.slab_type);
  io.u16({13, "RECIPE", "", "0 = by SLAB_TYPE; else the same number"}, in.recipe);
  io.u32({14, "SLAB_NO", "", "the line's own number; 0 = the open slab"}, in.slab_no);
  io.text({kSlabIdFirst, "SLAB_ID", "",
           "32 bytes ASCII, first character in the high byte; NULs and blanks around it do not belong to it"},
          in.slab_id);
  io.scaled({32, "SLAB_TEMPERATURE", "K", "in 0.1 K, 0 = unknown"}, in.slab_temperature_dk, 10.0);
  io.u16({33, "SLAB_AGE", "h", "since casting, 0 = unknown"}, in.slab_age_h);
  io.u16({34, "MOULD", "", "SLAB_BEGIN: number of the mould that cast the slab, 0 = unknown", kSince11}, in.mould);
  io.u16(
      {kSecondChip, "SECOND_CHIP", "",
       "SLAB_BEGIN: CRC-16/Modbus over the 16 registers of the id in the slab's second chip; 0 = not read", kSince11},
      in.second_chip);
  io.reserved({36, "-", "", "reserved, write 0"}, 1);
  io.computed({kCommandCrc, "CMD_CRC", "", "CRC-16/Modbus over HR 10..36, high bytes first; 0 = not used"});
  io.u16({38, "SESSION_ECHO", "", "SESSION (IR 9) as last read"}, in.session_echo);
  io.u16({kCommandSeqAddress, "CMD_SEQ", "", "written last: the command runs when it becomes CMD_ACK + 1; 1..65535"},
         in.cmd_seq);

  for (std::size_t i = 0; i < limits::kGaugesMax; ++i) io.gauge(i, in.gauge_thousandths[i]);
  io.u16({kGaugeSeqAddress, "GAUGE_SEQ", "",
          "written last: the values and GAUGE_SLAB_NO are taken when it changes; 0 = none were written", kSince11},
         in.gauge_seq);
  io.u32({kGaugeSlabNoAddress, "GAUGE_SLAB_NO", "", "SLAB_NO of the slab that was gauged; 0 = none, such as a master",
          kSince11},
         in.gauge_slab_no);
}

// ---- input registers: written by slabd ---------------------------------------------------------------------------

template <typename Cursor, ValueOrConst<PlcOutputs> Outputs>
void walk_state(Cursor& io, Outputs& out) {
  io.constant({0, "MAGIC", "", "0x534C: this is slabd"}, kMapMagic);
  io.constant(
      {1, "MAP_VERSION", "", "0x0101: map 1.1; the high byte changes if a PLC of an earlier map cannot work with it"},
      kMapVersion);
  io.constant32({2, "WORD_PROBE", "", "0x12345678; reads 0x56781234 when the word order is the other one"}, kWordProbe);
  io.u16({4, "HEARTBEAT", "", "+1 every 500 ms, by the loop that does the work"}, out.heartbeat);
  io.bit({5, "READY", "", "a command would be taken"}, 0, out.ready);
  io.bit({5, "BUSY", "", "a command is being carried out"}, 1, out.busy);
  io.bit({5, "ACQUIRED", "", "scan and pose of the last command are on disk: the robot may leave"}, 2, out.acquired);
  io.bit({5, "RESULT", "", "the record at IR 30 waits for RES_ACK"}, 3, out.result);
  io.bit({5, "SLAB_OPEN", "", "between SLAB_BEGIN and the slab's verdict"}, 4, out.slab_open);
  io.bit({5, "FAULT_PRESENT", "", "FAULT is not 0"}, 5, out.fault_present);
  io.bit({5, "WARN_PRESENT", "", "WARN is not 0"}, 6, out.warn_present);
  io.bit({5, "POSE_OK", "", "robot poses arrive"}, 7, out.pose_ok);
  io.bit({5, "SCANNER_OK", "", "the scanner can be asked"}, 8, out.scanner_ok);
  io.bit({5, "PLC_LINK_OK", "", "PLC_HEARTBEAT moves"}, 9, out.plc_link_ok);
  io.bit({5, "STORE_OK", "", "results can be stored"}, 10, out.store_ok);
  io.bit({5, "SIMULATION", "", "the line is emulated: nothing here is a verdict on concrete"}, 11, out.simulation);
  io.enumerated({6, "STATE", "", "what slabd is doing"}, out.state, PlcState::maintenance, kStateWords);
  io.code({7, "FAULT", "", "code of the fault, 0 = none"}, out.fault);
  io.flags({8, "WARN", "", "a bit each"}, out.warn, kWarnWords);
  io.u16({9, "SESSION", "", "copy it to SESSION_ECHO; changes with every restart of either side"}, out.session);
  io.u16({10, "CMD_ACK", "", "last CMD_SEQ consumed; the next command has CMD_ACK + 1"}, out.cmd_ack);
  io.command_status({11, "CMD_STATUS", "", "of that command; 0x8000 + code: refused or failed"}, out.cmd_status);
  io.u16({12, "ACQ_SEQ", "", "CMD_SEQ whose scan and pose are durable: the robot may leave"}, out.acq_seq);
  io.u16({13, "CUR_STATION", "", "being scanned, 0 = none"}, out.current_station);
  io.u32({14, "SLAB_NO", "", "of the open slab, 0 = none"}, out.slab_no);
  io.u16({16, "SLAB_TYPE", "", "of the open slab"}, out.slab_type);
  io.u16({17, "STATIONS_DONE", "", "how many stations have a durable scan"}, out.stations_done);
  io.stations({18, "STATION_MASK", "", "which: bit 0 = station 1"}, out.station_mask);
  io.u16({20, "RES_PENDING", "", "records that wait for RES_ACK"}, out.results_pending);
  io.u16({21, "REFUSED", "", "counts refused and repeated commands"}, out.refused);
  io.time_us({22, "UTIME", "us", "since 1970-01-01 UTC"}, out.utime_us);
  io.code({26, "REFUSE_CODE", "", "why the last command was refused"}, out.refuse_code);
  io.u16({27, "REFUSE_SEQ", "", "its CMD_SEQ"}, out.refuse_seq);
  io.enumerated({28, "DISPOSITION", "", "decision about the slab of IR 108-109, 0 until one is recorded", kSince11},
                out.disposition, Disposition::re_inspect, kDispositionWords);
  io.u16({29, "DISPOSITION_SEQ", "", "+1 at every change of it, 0 until one is recorded", kSince11},
         out.disposition_seq);
}

/// IR 30..63.
template <typename Cursor, ValueOrConst<PlcResult> Record>
void walk_record(Cursor& io, Record& record) {
  io.u16({kRecordFirst, "RES_SEQ", "", "number of the record, 0 = none"}, record.res_seq);
  io.word({31, "RES_KIND", "", "what the record is about"}, record.kind, kKindWords);
  io.u16({32, "RES_CMD_SEQ", "", "CMD_SEQ of the SCAN or SLAB_END"}, record.cmd_seq);
  io.u16({33, "RES_STATION", "", "1..18, 0 for a slab"}, record.station);
  io.u32({34, "RES_SLAB_NO", "", "the slab"}, record.slab_no);
  io.enumerated({36, "VERDICT", "", "only 1 is a pass"}, record.verdict, Verdict::indeterminate, kVerdictWords);
  io.code({37, "REASON", "", "600 + lowest failing item, or a code; 0 = none"}, record.reason);
  io.items({38, "FAIL_MASK", "", "bit per item that failed"}, record.fail_mask);
  io.items({39, "OPEN_MASK", "", "bit per item that is indeterminate or not measured"}, record.open_mask);
  io.fixed({40, "FLATNESS", "mm", "seat_flatness"}, record.flatness_mm);
  io.fixed({41, "STD", "mm", "seat_std"}, record.std_mm);
  for (std::size_t i = 0; i < kPlcDeviations; ++i) io.deviation(i, record.deviation[i], record.kind == kKindSlab);
  io.u32({56, "POINTS", "", "of the scan"}, record.points);
  io.time_us({58, "SCAN_UTIME", "us", "when the scan was taken, since 1970-01-01 UTC"}, record.scan_utime_us);
  io.computed({kRecordCrc, "RES_CRC", "", "CRC-16/Modbus over IR 30..61, high bytes first"});
  io.computed({kRecordCopy, "RES_SEQ_COPY", "", "equals RES_SEQ, else the record was read in two pieces"});
  io.reserved({64, "-", "", "reserved, reads 0"}, 6);
}

template <typename Cursor, ValueOrConst<PlcOutputs> Outputs>
void walk_slab(Cursor& io, Outputs& out) {
  for (std::size_t station = 0; station < limits::kStationsMax; ++station)
    io.row(static_cast<std::uint16_t>(70 + 2 * station), station, out.table[station]);
  io.enumerated({106, "SLAB_VERDICT", "", "of the last slab, until the next SLAB_BEGIN; only 1 is a pass"},
                out.slab_verdict, Verdict::indeterminate, kVerdictWords);
  io.code({107, "SLAB_REASON", "", "why; 0 = none"}, out.slab_reason);
  io.u32({108, "TABLE_SLAB_NO", "", "slab of IR 70..107"}, out.table_slab_no);
}

}  // namespace slabd::hal
