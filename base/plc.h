// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <array>
#include <cstdint>
#include <limits>

#include "base/items.h"
#include "base/limits.h"
#include "base/records.h"

/// The PLC's half and slabd's half of register map 1.1 as values with units. Only `hal/plc/plc_map.h` contains
/// addresses, scales and word order.
namespace slabd {

enum class PlcCommand : std::uint16_t { none = 0, slab_begin = 1, scan = 2, slab_end = 3, slab_abort = 4, report = 5 };

/// GAUGE_VALUE of a gauge without a value.
inline constexpr std::int32_t kNoGaugeRegister = std::numeric_limits<std::int32_t>::min();

/// Values written by the PLC so far (HR 0..74), decoded after each write.
struct PlcInputs {
  std::uint16_t heartbeat = 0;
  bool enable = false;
  bool abort = false;
  bool fault_reset = false;
  std::uint16_t res_ack = 0;
  std::uint16_t sync_req = 0;

  std::uint16_t command = 0;
  std::uint16_t station = 0;
  std::uint16_t slab_type = 0;
  std::uint16_t recipe = 0;  ///< 0: selected by type
  std::uint32_t slab_no = 0;
  std::array<char, limits::kSlabIdBytes> slab_id{};
  std::uint16_t slab_temperature_dk = 0;  ///< 0.1 K; 0 if unknown
  std::uint16_t slab_age_h = 0;           ///< 0 if unknown
  std::uint16_t mould = 0;                ///< number of the mould that cast the slab; 0 if unknown
  std::uint16_t second_chip = 0;          ///< CRC-16/Modbus of the id in the slab's second chip; 0 if it was not read
  bool chips_agree = true;                ///< second_chip is 0 or the CRC of SLAB_ID as written
  bool crc_ok = true;                     ///< CMD_CRC matches, or is 0 (not used)
  std::uint16_t session_echo = 0;
  std::uint16_t cmd_seq = 0;

  // Gauges (HR 40..74), not part of the command block: any connection that may write may be the gauge hub.
  /// Thousandths of a mm or degree; kNoGaugeRegister if the gauge has no value.
  std::array<std::int32_t, limits::kGaugesMax> gauge_thousandths{};
  std::uint16_t gauge_seq = 0;      ///< changes when all of them are written; 0: none was ever written
  std::uint32_t gauge_slab_no = 0;  ///< slab that they belong to; 0: none, such as a master
  bool gauges_known = true;         ///< false: as a Modbus client, not read twice alike on this connection yet

  /// Connection that last wrote HR 10..39; 0 if none. Unique over the life of the process.
  std::uint32_t command_writer = 0;
  /// Number of writes to HR 10..39, so that rewriting the same block counts as a new event.
  std::uint32_t command_writes = 0;
};

enum class PlcState : std::uint16_t {
  init = 0,
  recover = 1,
  idle = 2,
  slab_open = 3,
  settling = 4,
  scanning = 5,
  waiting_for_plc = 6,
  fault = 7,
  maintenance = 8,
};

/// CMD_STATUS values below 0x8000; a rejected or failed command has 0x8000 + code.
enum class CommandStatus : std::uint16_t { none = 0, accepted = 1, acquiring = 2, acquired = 3, done = 4 };
inline constexpr std::uint16_t kCommandFailed = 0x8000;

/// WARN (IR 8), a bit field.
enum PlcWarn : std::uint16_t {
  kWarnUnconfirmedNominals = 1U << 0U,
  kWarnCommissioningCalibration = 1U << 1U,
  kWarnStrayFiles = 1U << 2U,
  kWarnResultsWaiting = 1U << 3U,
  kWarnClockBackwards = 1U << 4U,
  kWarnRecipeUnusable = 1U << 5U,
  kWarnDiskLow = 1U << 6U,
  kWarnControlSocket = 1U << 7U,
  // bits 8 to 10: base/calibration.h
  kWarnHandednessUnproven = 1U << 11U,  ///< no calibration in force proves that the scanner's frame is right-handed
  kWarnRecipesDiffer = 1U << 12U,       ///< the recipe folder differs from the recipes in use
  /// The robot's stops over neighbouring blocks are too similar to assign a scan by its pose.
  kWarnStopsAlike = 1U << 14U,
  kWarnGauge = 1U << 15U,      ///< a gauge is stuck, or its master check is missing, failed or overdue
  kWarnEmulation = 1U << 13U,  ///< robot or scanner is emulated, or was for the data shown to the PLC
};

/// Deviations of a result record, IR 42..55: mm or deg, NaN if none. In kind 2 some of them are station numbers and a
/// count; hal/plc/plc_map.cpp contains the table.
inline constexpr std::size_t kPlcDeviations = 14;

struct PlcResult {
  std::uint16_t res_seq = 0;  ///< 0 without a record
  std::uint16_t kind = 0;     ///< 1 station, 2 slab
  std::uint16_t cmd_seq = 0;
  std::uint16_t station = 0;
  std::uint32_t slab_no = 0;
  Verdict verdict = Verdict::none;
  std::uint16_t reason = 0;
  std::uint16_t fail_mask = 0;
  std::uint16_t open_mask = 0;
  double flatness_mm = kNoValue;
  double std_mm = kNoValue;
  std::array<double, kPlcDeviations> deviation = filled(kNoValue);
  std::uint32_t points = 0;
  std::int64_t scan_utime_us = 0;
  std::uint8_t emulated =
      0;  ///< emulation bits (base/records.h) of its slab when the record was made; read as STATUS bit 11

  [[nodiscard]] static constexpr std::array<double, kPlcDeviations> filled(double v) {
    std::array<double, kPlcDeviations> a{};
    for (double& x : a) x = v;
    return a;
  }
};

struct PlcStationRow {
  Verdict verdict = Verdict::none;
  std::uint8_t attempts = 0;
  std::uint16_t reason = 0;
};

/// All values that the PLC can read (IR 0..109).
struct PlcOutputs {
  std::uint16_t heartbeat = 0;
  // STATUS bits
  bool ready = false;
  bool busy = false;
  bool acquired = false;
  bool result = false;
  bool slab_open = false;
  bool fault_present = false;
  bool warn_present = false;
  bool pose_ok = false;
  bool scanner_ok = false;
  bool plc_link_ok = false;
  bool store_ok = false;
  bool simulation = false;

  PlcState state = PlcState::init;
  std::uint16_t fault = 0;
  std::uint16_t warn = 0;
  std::uint16_t session = 0;
  std::uint16_t cmd_ack = 0;
  std::uint16_t cmd_status = 0;
  std::uint16_t acq_seq = 0;
  std::uint16_t current_station = 0;
  std::uint32_t slab_no = 0;
  std::uint16_t slab_type = 0;
  std::uint16_t stations_done = 0;
  std::uint32_t station_mask = 0;
  std::uint16_t results_pending = 0;
  std::uint16_t refused = 0;
  std::int64_t utime_us = 0;
  std::uint16_t refuse_code = 0;
  std::uint16_t refuse_seq = 0;

  PlcResult record;

  std::array<PlcStationRow, limits::kStationsMax> table{};
  Verdict slab_verdict = Verdict::none;
  std::uint16_t slab_reason = 0;
  Disposition disposition = Disposition::none;  ///< of the slab `table_slab_no`
  std::uint16_t disposition_seq = 0;            ///< counts its changes
  std::uint32_t table_slab_no = 0;              ///< IR 108-109
};

/// Result records of a measured block and of a finished slab, in the order of IR 42..55.
[[nodiscard]] PlcResult station_record(const BlockResult& block);
/// Station record after SLAB_END: verdict and reason are final, and items in the slab frame are included.
[[nodiscard]] PlcResult station_record(const BlockResult& block, const SlabResult& slab);
[[nodiscard]] PlcResult slab_record(const SlabResult& slab, int stations);

/// The successor of a 16-bit sequence number; 0 is never used.
[[nodiscard]] constexpr std::uint16_t next_sequence(std::uint16_t seq) {
  return seq == 0xFFFF ? std::uint16_t{1} : static_cast<std::uint16_t>(seq + 1);
}

}  // namespace slabd
