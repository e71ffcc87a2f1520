// SPDX-License-Identifier: Apache-2.0
#pragma once

#include "base/record_fields.h"
#include "storage/storage.h"

/// Field lists of records that storage defines; see base/fields.h.
namespace slabd::storage {

SLABD_FIELDS(ChangeNote, who, why, utime_us);

/// What a record has beside its id and its numbers.
template <typename V, RecordOf<CalibrationRecord> R>
void fields(V& v, R& r) {
  SLABD_EACH(r, parent_id, figures, observations, certificate)
  v("operator", r.operator_name);
  SLABD_EACH(r, robot_serial, scanner_serial, temperature_c, software, created_utime_us, expires_utime_us)
}

}  // namespace slabd::storage
