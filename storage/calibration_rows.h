// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "storage/rows.h"
#include "storage/storage.h"

/// Columns of the calibration tables that are not in base/record_fields.h; see storage/rows.h.
namespace slabd::storage {

/// What a record has beside its numbers.
SLABD_FIELDS(CalibrationRecord, id, parent_id, figures, observations, certificate, operator_name, robot_serial,
             scanner_serial, temperature_c, software, created_utime_us, expires_utime_us);

/// Which calibration a row of numbers belongs to.
struct NumbersOf {
  std::string calibration_id;
};
struct NumbersOfStation {
  std::string calibration_id;
  std::uint8_t station = 0;
};
SLABD_FIELDS(NumbersOf, calibration_id);
SLABD_FIELDS(NumbersOfStation, calibration_id, station);

}  // namespace slabd::storage
