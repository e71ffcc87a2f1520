// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <string>

#include "plant/postgres.h"

namespace slabd::plant {

/// Text of plant/schema.sql and of plant/rights.sql.
extern const char* const kSchemaText;
extern const char* const kRightsText;

/// Makes the schema and the roles, or brings rights and partitions of an existing one up to date; one transaction.
/// Returns what was done, one line for people. Throws PlantFault if the schema is newer than this program.
[[nodiscard]] std::string initialise(Postgres& server, const std::string& software);

/// slabd.plant_overview/1 of the last `days`.
[[nodiscard]] std::string overview(Postgres& server, int days);
/// slabd.plant_found/1 of a SLAB_ID.
[[nodiscard]] std::string found_slab(Postgres& server, const std::string& slab_id);

}  // namespace slabd::plant
