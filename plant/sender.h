// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <string>
#include <vector>

#include "config/config.h"
#include "plant/postgres.h"
#include "storage/outbox.h"
#include "storage/storage.h"

/// From the outbox of the line's database to the inbox of the plant's. Each row arrives at least once and counts once:
/// a row that is there already is compared by its checksum. slabd learns of what has arrived after the server's COMMIT.
namespace slabd::plant {

/// Version of plant/schema.sql. A newer server takes the documents of an older line; an older server takes none.
inline constexpr int kPlantVersion = 1;

/// A fault that only a person can clear; sending it again would not help.
struct PlantFault {
  std::string text;
};

/// The line's database.
struct Line {
  std::unique_ptr<storage::Outbox> outbox;
  std::unique_ptr<storage::Reader> reader;
  std::vector<storage::Epoch> epochs;
};
/// Throws PlantFault if it cannot be read.
[[nodiscard]] Line open_line(const config::Config& config);

/// Throws PlantFault if the server's schema is missing, older than this program, or if the line's name is another's.
void introduce(Postgres& server, const config::PlantSettings& plant, const Line& line, bool take_over);

struct Sent {
  std::int64_t rows = 0;  ///< that arrived now
  std::int64_t were_there = 0;
  std::int64_t newest_seq = 0;  ///< all rows up to here have arrived; 0: there was none
};
/// Sends the rows after `seq`, at most `limit` and at most some megabytes, in one transaction. Throws PostgresFailure,
/// or PlantFault if a row is there with another content.
[[nodiscard]] Sent send_batch(Postgres& server, Line& line, std::int64_t seq, int limit);

/// Reports to slabd that all rows up to `seq` have arrived. False if it does not answer: the next report counts.
[[nodiscard]] bool acknowledge(const config::Config& config, const std::string& epoch, std::int64_t seq);

struct EpochCheck {
  std::string epoch;
  std::int64_t stored = 0;
  std::int64_t there = 0;
  std::int64_t newest_seq = 0;
  std::int64_t newest_there = 0;
  bool equal = false;
  std::int64_t sent_again = 0;
  std::int64_t lost = 0;
  std::int64_t other = 0;
  std::int64_t only_there = 0;
};
/// Highest number of the line's rows that are there, in any of its epochs.
[[nodiscard]] std::int64_t newest_there(Postgres& server, const Line& line);

/// Compares the outbox up to `seq`, or to the newest row that is there, with the inbox, by epoch, and sends again what
/// is missing there.
[[nodiscard]] std::vector<EpochCheck> check(Postgres& server, Line& line, std::int64_t seq);

}  // namespace slabd::plant
