// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "storage/record_fields.h"
#include "storage/rows.h"

/// Columns of the calibration tables beside the field lists; see storage/rows.h.
namespace slabd::storage {

/// What a record has beside its numbers.
template <typename V, RecordOf<CalibrationRecord> R>
void columns(V& v, R& r) {
  v("id", r.id);
  part(v, r, "", {{"operator", "operator_name"}});
}

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
