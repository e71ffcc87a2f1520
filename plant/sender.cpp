// SPDX-License-Identifier: Apache-2.0
#include "plant/sender.h"

#include <fmt/format.h>
#include <unistd.h>

#include <algorithm>
#include <array>
#include <limits>
#include <map>
#include <nlohmann/json.hpp>
#include <set>

#include "hal/system/control_client.h"
#include "plant/documents.h"

namespace slabd::plant {
namespace {

using storage::OutboxRow;

/// One transaction's documents: a slab has some 30 kB.
constexpr std::size_t kBatchBytesMax = 4'000'000;
constexpr std::size_t kCheckRows = 5'000;
constexpr int kAcknowledge_ms = 2'000;

template <typename T>
T value_of(Result<T> result) {
  if (!result.ok()) throw PlantFault{std::string(result.error().text.view())};
  return std::move(result.value());
}

std::string text(std::int64_t number) {
  return std::to_string(number);
}

std::string host_name() {
  std::array<char, 256> name{};
  return ::gethostname(name.data(), name.size() - 1) == 0 ? name.data() : "unknown";
}

/// End of a slab; nullopt: the document is of another kind.
std::optional<std::int64_t> ended_in(const std::string& document) {
  constexpr std::string_view kKey = "\"ended_utime_us\":";
  const std::size_t at = document.find(kKey);
  if (at == std::string::npos) return std::nullopt;
  return std::strtoll(document.c_str() + at + kKey.size(), nullptr, 10);
}

/// True if the row arrived now, false if it was there with this content.
bool insert(Postgres& server, const OutboxRow& row, const std::string& document) {
  const Rows rows = server.run(
      "INSERT INTO plant.inbox (epoch, seq, kind, sha256, doc) VALUES ($1, $2, $3, $4, $5) ON CONFLICT (epoch, seq) DO "
      "NOTHING RETURNING 1",
      {row.epoch, text(row.seq), row.kind, bytea(row.sha256), document});
  if (!rows.empty()) return true;
  const Rows there = server.run("SELECT encode(sha256, 'hex'), kind FROM plant.inbox WHERE epoch = $1 AND seq = $2",
                                {row.epoch, text(row.seq)});
  const std::string other = there.empty() ? "" : there[0][0].value_or("");
  if (other == row.sha256) return false;
  throw PlantFault{fmt::format(
      "row {} of epoch {} is in the {} with another content ({}, here {} of kind {}): another computer uses a copy of "
      "this line's database, or an older copy was put in its place without slabctl db restore. Nothing was "
      "overwritten, and nothing more is sent. Find out which database is the line's, and give the other one a history "
      "of its own (slabctl db restore)",
      row.seq, row.epoch, server.place(), other.substr(0, 12), row.sha256.substr(0, 12), row.kind)};
}

}  // namespace

Line open_line(const config::Config& config) {
  Line line;
  line.outbox = value_of(storage::open_outbox(config.storage.db_path));
  line.reader = value_of(storage::open_reader(config.storage.db_path, storage::TextFor::programs));
  line.epochs = value_of(line.outbox->epochs());
  if (line.epochs.empty()) throw PlantFault{config.storage.db_path + " has no epoch"};
  return line;
}

void introduce(Postgres& server, const config::PlantSettings& plant, const Line& line, bool take_over) {
  const std::int64_t there = server.integer("SELECT count(*) FROM pg_namespace WHERE nspname = 'plant'");
  if (there == 0)
    throw PlantFault{server.place() + " has no schema \"plant\": its owner makes it with slabd-plant --init"};
  const std::int64_t version = server.integer("SELECT version FROM plant.version");
  if (version < kPlantVersion)
    throw PlantFault{
        fmt::format("{} has version {} of the schema \"plant\", this program needs {}: its owner upgrades "
                    "it with slabd-plant --init",
                    server.place(), version, kPlantVersion)};
  std::vector<std::string> epochs;
  std::vector<std::string> began;
  for (const storage::Epoch& epoch : line.epochs) {
    epochs.push_back(epoch.uuid);
    began.push_back(text(epoch.began_utime_us));
  }
  const Rows refused =
      server.run("SELECT plant.hello($1, $2, $3, $4, $5)",
                 {plant.line, array_of(epochs), array_of(began), host_name(), take_over ? "true" : "false"});
  if (const std::string why = refused.at(0).at(0).value_or(""); !why.empty()) throw PlantFault{why};
  // Made ahead, so that no row has to wait for it.
  server.run("SELECT plant.make_month(now() + m * interval '1 month') FROM generate_series(0, 2) AS m");
}

std::int64_t newest_there(Postgres& server, const Line& line) {
  // A restored line goes on from an older number in an epoch of its own. Rows from that number on that were sent in an
  // earlier epoch are no longer the line's.
  std::int64_t below = std::numeric_limits<std::int64_t>::max();
  for (auto epoch = line.epochs.rbegin(); epoch != line.epochs.rend(); ++epoch) {
    const std::int64_t there = server.integer(
        "SELECT coalesce(max(seq), 0) FROM plant.inbox WHERE epoch = $1 AND seq < $2", {epoch->uuid, text(below)});
    if (there != 0) return there;
    if (const std::int64_t first = value_of(line.outbox->first_seq(epoch->uuid)); first != 0)
      below = std::min(below, first);
  }
  return 0;
}

Sent send_batch(Postgres& server, Line& line, std::int64_t seq, int limit) {
  const std::vector<OutboxRow> rows = value_of(line.outbox->rows_after(seq, static_cast<std::size_t>(limit)));
  Sent sent;
  if (rows.empty()) return sent;
  std::vector<std::string> documents;
  std::size_t bytes = 0;
  std::set<std::int64_t> days;
  for (const OutboxRow& row : rows) {
    documents.push_back(value_of(document_of(row, *line.reader, *line.outbox)));
    bytes += documents.back().size();
    constexpr std::int64_t kDay_us = 86'400'000'000;
    if (const auto ended = ended_in(documents.back())) days.insert(*ended / kDay_us * kDay_us);
    if (bytes > kBatchBytesMax) break;
  }
  // Outside of the transaction: making a partition waits for those that write into the table.
  for (const std::int64_t day : days) server.run("SELECT plant.make_month(plant.time_of($1))", {text(day)});
  server.run("BEGIN");
  try {
    for (std::size_t i = 0; i < documents.size(); ++i) {
      (insert(server, rows[i], documents[i]) ? sent.rows : sent.were_there) += 1;
      sent.newest_seq = rows[i].seq;
    }
    server.run("COMMIT");
  } catch (const PlantFault&) {
    server.run("ROLLBACK");
    throw;
  } catch (const PostgresFailure& failure) {
    if (!failure.lost) server.run("ROLLBACK");
    throw;
  }
  return sent;
}

bool acknowledge(const config::Config& config, const std::string& epoch, std::int64_t seq) {
  const nlohmann::json request{{"verb", "sent"}, {"epoch", epoch}, {"seq", seq}};
  const hal::ControlAnswer answer = hal::ask_control(config.control_socket, request.dump() + "\n", kAcknowledge_ms);
  if (!answer.ok()) return false;
  const auto said = nlohmann::json::parse(answer.line, nullptr, false);
  return said.is_object() && said.value("schema", "") == "slabd.care/1";
}

std::vector<EpochCheck> check(Postgres& server, Line& line, std::int64_t seq) {
  std::map<std::string, EpochCheck> epochs;
  std::int64_t last = 0;
  // Rows that arrived, and of which slabd was not told.
  seq = std::max(
      seq, server.integer("SELECT coalesce(max(seq), 0) FROM plant.inbox WHERE epoch = $1", {line.epochs.back().uuid}));
  for (const storage::Epoch& epoch : line.epochs) epochs[epoch.uuid].epoch = epoch.uuid;
  while (last < seq) {
    std::vector<OutboxRow> rows = value_of(line.outbox->rows_after(last, kCheckRows));
    std::erase_if(rows, [seq](const OutboxRow& row) { return row.seq > seq; });
    if (rows.empty()) break;
    last = rows.back().seq;
    std::map<std::pair<std::string, std::int64_t>, std::string> there;
    for (const storage::Epoch& epoch : line.epochs)
      for (const auto& found : server.run("SELECT seq, encode(sha256, 'hex') FROM plant.inbox WHERE epoch = $1 AND seq "
                                          "BETWEEN $2 AND $3",
                                          {epoch.uuid, text(rows.front().seq), text(last)}))
        there[{epoch.uuid, std::stoll(*found[0])}] = *found[1];
    for (const OutboxRow& row : rows) {
      EpochCheck& of = epochs[row.epoch];
      ++of.stored;
      of.newest_seq = row.seq;
      const auto found = there.find({row.epoch, row.seq});
      if (found != there.end()) {
        if (found->second != row.sha256) ++of.other;
        continue;
      }
      const std::string document = value_of(document_of(row, *line.reader, *line.outbox));
      if (const auto ended = ended_in(document))
        server.run("SELECT plant.make_month(plant.time_of($1))", {text(*ended)});
      if (insert(server, row, document)) ++of.sent_again;
      if (row.kind == "slab" && !ended_in(document)) ++of.lost;
    }
  }
  std::vector<EpochCheck> list;
  for (const storage::Epoch& epoch : line.epochs) {
    EpochCheck& of = epochs[epoch.uuid];
    const Rows rows =
        server.run("SELECT count(*), coalesce(max(seq), 0) FROM plant.inbox WHERE epoch = $1 AND seq <= $2",
                   {epoch.uuid, text(std::max(seq, of.newest_seq))});
    of.there = std::stoll(rows.at(0).at(0).value_or("0"));
    of.newest_there = std::stoll(rows.at(0).at(1).value_or("0"));
    of.only_there = std::max<std::int64_t>(of.there - of.stored, 0);
    const bool is_newest = epoch.uuid == line.epochs.back().uuid;
    of.equal = of.other == 0 && of.there >= of.stored && (!is_newest || of.only_there == 0);
    list.push_back(of);
  }
  return list;
}

}  // namespace slabd::plant
