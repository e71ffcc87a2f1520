// SPDX-License-Identifier: Apache-2.0
//
// A damaged database: the input lists bytes of a good one to change (offset, value pairs). An input that begins with
// SQLite's header is the file itself. It is read as by slabctl and then opened as by the daemon.
#include <filesystem>
#include <fstream>
#include <iterator>

#include "base/packed_map.h"
#include "storage/storage.h"
#include "tests/fuzz/fuzz.h"

using namespace slabd;           // NOLINT(google-build-using-namespace)
using namespace slabd::storage;  // NOLINT(google-build-using-namespace)

namespace {

namespace fs = std::filesystem;

StoreSettings settings_in(const std::string& folder) {
  StoreSettings settings;
  settings.db_path = folder + "/db/slabd.db";
  settings.spool_dir = folder + "/spool";
  settings.spool_free_bytes_min = 0;
  return settings;
}

/// A block as measured, with maps of a few cells.
BlockJob measured_block() {
  BlockJob job{1, 1, {}, {}};
  job.block.station = 1;
  job.block.verdict = Verdict::fail;
  job.block.reason = 601;
  job.block.registration.status = RegistrationStatus::converged;
  for (const ItemId id : {ItemId::seat_slope, ItemId::seat_flatness, ItemId::jaw_distance}) {
    Item item;
    item.id = id;
    item.station = 1;
    item.verdict = Verdict::fail;
    item.value = 1.5;
    fuzz::must(job.block.items.push(item), "an item");
  }
  job.record.res_seq = 1;
  job.record.kind = 1;
  job.record.station = 1;
  const auto height_mm = [](std::size_t column, std::size_t row) { return 0.03 * static_cast<double>(column * row); };
  pack_map(12, 9, 4.0, 0.01, height_mm, job.maps.registration);
  pack_map(20, 15, 1.5, 0.001, height_mm, job.maps.seat);
  return job;
}

/// A small good database: a slab, a command, a scan, a block, a calibration.
std::string good_database() {
  const fuzz::InputFile place(".x");
  const StoreSettings settings = settings_in(place.folder());
  {
    auto store = open_store(settings);
    fuzz::must(store.ok() && store.value()->recover().ok(), "a new database");
    SlabHeader header;
    header.key = 1;
    header.slab_id = "S-1";
    header.stations = 18;
    header.recipe = "P5600";
    fuzz::must(store.value()->apply(StoreJob{1, BeginSlabJob{header, 1, 1}}).ok(), "a slab");
    fuzz::must(store.value()->apply(StoreJob{2, CommandJob{1, 2, 2, 3, 1, 5}}).ok(), "a command");
    Attempt attempt;
    attempt.slab_key = 1;
    attempt.station = 1;
    attempt.number = 1;
    attempt.cmd_seq = 2;
    attempt.scan_path.assign(settings.spool_dir + "/1/01-1.ply");
    fuzz::must(store.value()->apply(StoreJob{3, AcquiredJob{attempt}}).ok(), "a scan");
    fuzz::must(store.value()->apply(StoreJob{4, measured_block()}).ok(), "a block");
    CalibrationRecord record;
    record.numbers = ReferenceBlock{};
    record.operator_name = "anna";
    static_cast<void>(store.value()->change(KeepCalibration{record}));
  }
  std::ifstream in(settings.db_path, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

}  // namespace

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  static const std::string good = good_database();
  static const fuzz::InputFile place(".x");
  const std::string_view input = fuzz::text_of(data, size);
  std::string bytes = good;
  if (input.starts_with("SQLite format 3")) {
    bytes = input;
  } else {
    for (std::size_t i = 0; i + 4 <= input.size(); i += 4) {
      const std::size_t at =
          (static_cast<std::size_t>(data[i]) << 16U | static_cast<std::size_t>(data[i + 1]) << 8U | data[i + 2]) %
          bytes.size();
      bytes[at] = static_cast<char>(data[i + 3]);
    }
  }
  std::error_code ec;
  fs::remove_all(place.folder() + "/db", ec);
  fs::create_directories(place.folder() + "/db");
  const StoreSettings settings = settings_in(place.folder());
  std::ofstream(settings.db_path, std::ios::binary) << bytes;
  {
    auto reader = open_reader(settings.db_path);
    if (reader.ok()) {
      static_cast<void>(reader.value()->slabs(10));
      static_cast<void>(reader.value()->slab(1));
      static_cast<void>(reader.value()->values({}));
      if (const auto maps = reader.value()->maps(1, 1, 1); maps.ok() && maps.value() != nullptr) {
        static_cast<void>(unpack_map(maps.value()->registration));
        static_cast<void>(unpack_map(maps.value()->seat));
      }
      static_cast<void>(reader.value()->calibrations());
      static_cast<void>(reader.value()->line_calibration());
      static_cast<void>(reader.value()->applied(10));
      static_cast<void>(reader.value()->checks(10));
    }
  }
  auto store = open_store(settings);
  if (store.ok()) {
    const auto line = store.value()->recover();
    if (line.ok()) static_cast<void>(store.value()->apply(StoreJob{1, SessionJob{9}}));
  } else {
    fuzz::must(fs::exists(settings.db_path), "a database that cannot be used is never replaced by nothing");
  }
  return 0;
}
