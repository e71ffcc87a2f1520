// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "base/arm.h"
#include "base/base.h"
#include "base/id_pattern.h"
#include "calib/calib.h"
#include "hal/hal.h"
#include "storage/storage.h"

/// Configuration and recipes, used by the daemon and slabctl.
namespace slabd::config {

// ---- configuration (slabd.toml) ----------------------------------------------------------------------------------

/// A fault in a file, for people: "file:line:column: key: fault, allowed range".
struct Problem {
  std::string text;
};

/// [web]: the program slabd-web, not the daemon.
struct WebSettings {
  struct Listener {
    FixedString<64> host;    ///< IPv4 address; empty: not used
    std::uint16_t port = 0;  ///< 0: chosen by the kernel
  };
  Listener kiosk{FixedString<64>("127.0.0.1"), 8080};
  Listener lan;
  std::string tls_cert;            ///< PEM file of the LAN listener; empty: without TLS
  std::string tls_key;             ///< PEM file
  bool lan_plain = false;          ///< allows a LAN listener without TLS
  std::vector<std::string> names;  ///< host names of this computer that browsers may use
  std::string users_file;          ///< accounts (config/web_users.h); empty: no user can log in
  bool viewer_login = false;       ///< documents are given only to users that are logged in
  std::string language = "en";     ///< of the page before the reader chooses: "en" or "zh"
  std::string slabctl;             ///< program that makes the documents; empty: the one next to slabd-web
  double answer_s = 5.0;           ///< time limit of a document; a report has six times as much
  std::string slabd_plant;         ///< program that reads the plant's database; empty: the one next to slabd-web
  std::string plant_dsn;           ///< plant's database of the plant page; empty: [plant] dsn
};

/// [plant]: the program slabd-plant, which sends results to the plant's database. docs/PLANT.md.
struct PlantSettings {
  std::string dsn;           ///< libpq's connection string; empty: there is no plant's database
  std::string line;          ///< name of this line there
  double alarm_h = 24.0;     ///< results that wait longer are an alarm
  int batch = 50;            ///< documents in a transaction
  std::string metrics_file;  ///< text file of metrics for Prometheus' node exporter; empty: none
};

/// [genicam]: the program slabd-genicam, which takes the scans of a GigE Vision camera. docs/GENICAM.md.
struct GenicamSettings {
  static constexpr std::size_t kNameBytesMax = 63;      ///< of a feature's entry
  static constexpr std::size_t kAcceptedBytesMax = 64;  ///< as ScannerNumbers::scanner, which contains the same text
  /// Start of an exposure: TriggerSoftware, or AcquisitionStart in mode SingleFrame for cameras without it.
  enum class Trigger : std::uint8_t { software, acquisition_start };
  std::string camera;  ///< address, host name, or id as arv-tool lists it; empty: there is no such camera
  FixedString<64> slabd_host{"127.0.0.1"};  ///< slabd's [scanner] listen
  std::uint16_t slabd_port = 1504;
  std::string component = "Range";  ///< entry of ComponentSelector that has the points
  bool unit_required = true;        ///< unit_check: the camera must state Scan3dDistanceUnit = Millimeter
  int packet_bytes = 1500;          ///< GevSCPSPacketSize, headers of IP and UDP included
  double timeout_s = 8.0;           ///< from the trigger to the last byte of the frame
  Trigger trigger = Trigger::software;
  std::string accepted;   ///< identity of the accepted camera; another one is refused; empty: any
  bool emulated = false;  ///< the camera is a test device: its scans are marked as emulated
};
/// Receive buffer of slabd-genicam's socket, which net.core.rmem_max must permit: at 1 Gbit/s the kernel can hold the
/// packets of 0.13 s, in which the program does not run because the computer is busy. A frame of 60 MB does not fit and
/// need not.
inline constexpr int kGenicamSocketBytes = 33'554'432;

/// Settings of an arm: of its robot, and of the scanner on its flange.
struct ArmSettings {
  Arm by;
  hal::LcmSettings robot;
  PoseSettings pose;
  hal::ScannerBackend scanner_backend = hal::ScannerBackend::drop;
  hal::ScanDropSettings scanner;   ///< backend "drop"; `form` also applies to files in the spool: mm with "tcp"
  hal::ScanStreamSettings stream;  ///< backend "tcp"
  std::int64_t scan_timeout_ns = 10 * kNsPerS;
  std::int64_t settle_timeout_ns = 8 * kNsPerS;
  /// Assumptions about the robot and about commissioning values, and the gate of station corrections.
  SpliceSettings splice;
  ScannerDriftSettings scanner_drift;  ///< [scanner] drift_per_K, temperature_range_K
  calib::WarmUpSettings warm_up;       ///< [scanner.warm_up]
  double warm_up_every_s = 60.0;       ///< between the views of `slabctl scanner warm-up --live`
  double warm_up_give_up_min = 90.0;   ///< it gives up after this time
  /// Commissioning values. With an empty id the configuration has none, and slabs wait for an applied calibration.
  calib::Calibration calibration;
};

/// The base class contains the settings of arm 0, which is the only one of most lines.
struct Config : ArmSettings {
  std::string path;
  std::vector<Problem> doubts;  ///< allowed values that are probably a mistake: another unit, another order
  LineArms arms;
  std::vector<ArmSettings> more_arms;  ///< arms after the first: [arm - 1]
  [[nodiscard]] const ArmSettings& arm(std::size_t index) const {
    return index == 0 ? static_cast<const ArmSettings&>(*this) : more_arms.at(index - 1);
  }
  [[nodiscard]] ArmSettings& arm(std::size_t index) {
    return index == 0 ? static_cast<ArmSettings&>(*this) : more_arms.at(index - 1);
  }
  hal::PlcSettings plc;
  storage::StoreSettings storage;
  std::string recipes_dir = "/usr/share/slabd/recipes";
  std::string designs_dir;  ///< [design] dir; empty: no design sheets
  Pose T_base_slab;
  std::int64_t check_interval_us = 24 * 3'600'000'000LL;  ///< between daily checks; 0: none are due
  calib::CheckLimits check_limits;
  CaptureGuard capture;              ///< limits for calibration views
  std::string sessions_dir;          ///< folder of slabctl's unfinished calibrations; default: next to the database
  int calibration_valid_days = 365;  ///< validity of calibrations stored by slabctl from now on; 0: unlimited
  std::string control_socket = "/run/slabd/control.sock";
  int measure_threads = 1;                 ///< [measure] threads: 1 or 2; the results are the same
  std::optional<IdPattern> id_pattern;     ///< [line] id_pattern: form of a SLAB_ID; nullopt: any text
  std::optional<IdPattern> mould_from_id;  ///< [line] mould_from_id: its only group is the mould; nullopt: not in it
  bool second_chip_required = false;       ///< [line] second_chip = "required": SLAB_BEGIN needs SECOND_CHIP (HR 35)
  GaugeList gauges;                        ///< [[gauge]]
  FixedVector<hal::PlcSettings::Network, 16> gauge_senders;  ///< [gauges] allow: may send gauge values over UDP
  bool simulation = false;                                   ///< [line] simulation: shown to the PLC as STATUS bit 11
  std::string project;  ///< [report] project: printed on reports; empty: not printed
  WebSettings web;
  std::vector<Problem> web_problems;  ///< faults of [web]; the rest may be usable
  PlantSettings plant;
  std::vector<Problem> plant_problems;  ///< faults of [plant]; the rest may be usable
  GenicamSettings genicam;
  std::vector<Problem> genicam_problems;  ///< faults of [genicam]; the rest may be usable
};

/// Smallest number of single-letter insertions, deletions and replacements that convert one word into the other.
[[nodiscard]] std::size_t edit_distance(std::string_view a, std::string_view b);

/// Reads and checks a configuration. All problems found are reported, not only the first; an unknown key is reported
/// with the nearest known one. If `problems` is empty, `config` is usable. A readable [plc] table is filled in even if
/// the rest is faulty, so that the daemon can report the fault to the PLC.
void load_config(const std::string& path, Config& config, std::vector<Problem>& problems);

/// Reads only [genicam], and [scanner] listen as the default of its key `slabd`, so that a computer without slabd needs
/// no more than these. `settings` is usable if `problems` is empty.
void load_genicam(const std::string& path, GenicamSettings& settings, std::vector<Problem>& problems);

// ---- recipes (recipes/*.toml) --------------------------------------------------------------------------------------

/// Reads and checks one recipe; `recipe` is complete only if `problems` stays empty. `doubts` (may be null) receives
/// allowed values that are probably a mistake.
void load_recipe(const std::string& path, Recipe& recipe, std::vector<Problem>& problems,
                 std::vector<Problem>* doubts = nullptr);

/// Reads a recipe from the bytes of a file, such as storage keeps. `path` is its name in messages and the recipe's
/// path.
void parse_recipe(const std::string& path, const std::string& bytes, Recipe& recipe, std::vector<Problem>& problems,
                  std::vector<Problem>* doubts = nullptr);

/// Checks the gauges that a recipe's formulas name: each must be one of the line, in the item's unit. A problem names
/// the recipe's file and line.
void check_formulas(const Recipe& recipe, std::span<const GaugeSettings> gauges, std::vector<Problem>& problems);

/// Reads all *.toml files of a folder except hidden ones, sorted by name; faulty ones are reported and left out. If two
/// files have the same slab_type, neither is used, even if one is faulty. If the slab_type of a file cannot be
/// determined, no recipe is used. A folder without a usable recipe is a problem. `texts` (may be null) receives the
/// files, in the same order. `gauges` (may be null): those of the line, which formulas are checked against.
void load_recipes(const std::string& dir, std::vector<Recipe>& recipes, std::vector<Problem>& problems,
                  std::vector<storage::RecipeText>* texts = nullptr, std::vector<Problem>* doubts = nullptr,
                  const GaugeList* gauges = nullptr);

/// Contents of all recipe files of a folder, by path; an unreadable file is reported and left out.
[[nodiscard]] std::map<std::string, std::string> recipe_files(const std::string& dir, std::vector<Problem>& problems);

/// Default number of threads that measure a block: 2 on a computer with two processors or more, else 1.
[[nodiscard]] int default_measure_threads();

}  // namespace slabd::config
