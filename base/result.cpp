// SPDX-License-Identifier: Apache-2.0
#include "base/result.h"

#include <array>
#include <cstdarg>
#include <cstdio>

#include "base/items.h"

namespace slabd {

Error error(Code code, const char* format, ...) {
  std::array<char, limits::kErrorTextBytes + 1> text{};
  va_list args;
  va_start(args, format);
  std::vsnprintf(text.data(), text.size(), format, args);
  va_end(args);
  return {code, FixedString<limits::kErrorTextBytes>(text.data())};
}

namespace {

struct Entry {
  Code code;
  std::string_view meaning;
  std::string_view cure;
};

constexpr std::array kTable = {
    Entry{Code::ok, "no fault", "nothing to do"},
    Entry{Code::unknown_command, "the command word is none of 1..5", "correct CMD (HR 10) in the PLC program"},
    Entry{Code::stale_session, "the command carries an old session number",
          "read SESSION (IR 9) again, copy it to SESSION_ECHO (HR 38), write the command again"},
    Entry{Code::busy, "another command is still being carried out, or too many results wait for RES_ACK",
          "wait until BUSY (IR 5 bit 1) is clear; if it is, acknowledge the results (IR 20, HR 2)"},
    Entry{Code::wrong_slab, "no slab is open, the command names another slab, or SLAB_BEGIN came while one is open",
          "IR 14-15 name an open slab: SLAB_END or SLAB_ABORT it first; if none is open, SLAB_BEGIN; keep SLAB_NO "
          "until SLAB_END"},
    Entry{Code::station_range, "the station number is outside 1..number of blocks", "correct STATION (HR 11)"},
    Entry{
        Code::unknown_type, "no usable recipe for this slab type, or a scan shows the slab end of another one",
        "add or repair the recipe file, one for each type; `slabctl config check` names the fault; after SCAN: correct "
        "SLAB_TYPE (HR 12)"},
    Entry{Code::not_enabled, "ENABLE is not set, the PLC heartbeat is missing, or a calibration is under way (STATE 8)",
          "set HR 1 bit 0 and change HR 0 at least every 500 ms; in STATE 8 wait, or end the calibration"},
    Entry{Code::bad_id_text,
          "SLAB_ID is not printable ASCII, not an id by [line] id_pattern, or not the id in the slab's second chip",
          "correct HR 16..31; `[line] id_pattern` in the configuration has the form of an id; if the two chips differ, "
          "or "
          "the second one was not read (HR 35), find out which slab it is"},
    Entry{Code::bad_crc, "CMD_CRC does not match HR 10..36, or the bytes of the block are swapped",
          "write the block again; check the byte and word order"},
    Entry{Code::interrupted, "the command was cut off by a restart or by ABORT, or the slab ended with SLAB_ABORT",
          "give the command again; an aborted slab has no verdict, SLAB_BEGIN measures it again"},
    Entry{Code::bad_sequence, "CMD_SEQ is neither CMD_ACK nor its successor",
          "seed the counter from CMD_ACK (IR 10) and count by one"},
    Entry{Code::no_design, "no design sheet for this slab, or one of another slab type",
          "put its sheet into `[design] dir`; `slabctl doctor` names faulty files (docs/CURVE_SLABS.md)"},
    Entry{Code::unknown_mould, "MOULD and SLAB_ID name different moulds, or the mould in SLAB_ID is not 0..65535",
          "correct MOULD (HR 34) or SLAB_ID (HR 16..31), or `[line] mould_from_id` in the configuration"},
    Entry{
        Code::no_gauge,
        "a gauge has no usable value: missing, too old, of another slab, not plausible, or its master check is due",
        "`slabctl gauge list` names gauge and reason; check it with its master (`slabctl gauge check`); the PLC writes "
        "GAUGE_SLAB_NO and then GAUGE_SEQ (HR 72) before SLAB_END (docs/GAUGES.md)"},
    Entry{Code::attempts_used_up, "the station was scanned 255 times in this slab, the most that are counted",
          "end or abort the slab and begin it again; find out why the station is scanned again and again"},
    Entry{Code::no_pose, "no robot pose has arrived",
          "start the robot bridge; check the network interface and the multicast route"},
    Entry{Code::pose_stale, "the newest robot pose is too old", "check the robot bridge and its network"},
    Entry{Code::not_settled, "the robot did not come to rest",
          "wait longer before SCAN; `slabctl robot monitor` shows spread and lost poses; check the robot's brakes"},
    Entry{Code::outside_window, "the scanner does not look at the commanded station",
          "check the station number, the robot program and [cell] T_base_slab"},
    Entry{Code::moved_during_scan, "the robot moved while the scan was taken", "scan this station again"},
    Entry{Code::wrong_frame, "the pose is not the flange in the robot root",
          "set $TOOL and $BASE to $NULLFRAME in the robot program"},
    Entry{Code::scanner_offline, "the scanner cannot be used: its folder, its share or its connection",
          "check the path, its permissions and the mount; for a stream, the gateway and its connection"},
    Entry{Code::trigger_timeout, "the scanner did not answer in time", "check the scanner program; scan again"},
    Entry{Code::frame_incomplete, "the scan is incomplete, unreadable or not the one that was asked for",
          "scan this station again"},
    Entry{Code::exposure, "reserved: the scan is over- or underexposed", "check the scanner's exposure settings"},
    Entry{Code::too_few_points, "the scan has too few valid points", "check distance, exposure and dirt; scan again"},
    Entry{Code::block_not_found, "no supporting block was found, or the station was never scanned",
          "check the station, the slab's position and that the block is there"},
    Entry{Code::fit_failed, "a required feature could not be measured", "scan again; look for dirt or missing surface"},
    Entry{Code::ambiguous, "reserved: the scan fits the block in more than one way",
          "scan again with the whole block in view"},
    Entry{Code::deadline,
          "the measurement was given up: too much work, or slabd ended while it ran; or no buffer was free",
          "look at the scan (`slabctl inspect`), then scan again; check the computer's load"},
    Entry{Code::store_full, "a disk is full, or has no room for two more slabs",
          "free space on the disk of the scans or of the database; `journalctl -u slabd` shows which"},
    Entry{
        Code::journal_write,
        "the database or the spool of scans could not be written, or the database is damaged or not there",
        "`slabctl status` and `journalctl -u slabd` say which; check the disk and its mount, then reset the fault; a "
        "program that keeps the database locked is named with its process id (`slabctl doctor` names it too): end it; "
        "`slabctl db check` finds damage of the database, and `slabctl db restore` restores a backup"},
    Entry{Code::calibration_missing, "no valid calibration",
          "calibrate and apply it; a line never calibrated takes [calibration] from the config"},
    Entry{Code::config, "the configuration is not usable", "run `slabctl config check`; it names file and line"},
    Entry{Code::internal, "an internal check failed", "note the journal entry and restart the service"},
};

constexpr const Entry* find(Code code) {
  for (const Entry& entry : kTable)
    if (entry.code == code) return &entry;
  return nullptr;
}

/// The item with this REASON if it has a text of its own.
const ItemInfo* find_item(Code code) {
  const std::optional<ItemId> id = item_from_reason(static_cast<int>(code));
  return id && !info(*id).meaning.empty() ? &info(*id) : nullptr;
}

}  // namespace

std::string_view describe(Code code) {
  if (const Entry* entry = find(code)) return entry->meaning;
  const ItemInfo* item = find_item(code);
  return item != nullptr ? item->meaning : "unknown code";
}

std::string_view cure(Code code) {
  if (const Entry* entry = find(code)) return entry->cure;
  const ItemInfo* item = find_item(code);
  return item != nullptr ? item->cure : "note the code and the software version";
}

}  // namespace slabd
