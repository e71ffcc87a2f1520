// SPDX-License-Identifier: Apache-2.0
#include "plant/administration.h"

#include <fmt/format.h>

#include <array>
#include <nlohmann/json.hpp>

#include "plant/sender.h"

namespace slabd::plant {
namespace {

using Json = nlohmann::ordered_json;

constexpr std::array kRoles = {"slabd_plant_writer", "slabd_plant_reader"};
/// Rows of a list on the page.
constexpr const char* kListMax = "20";

void make_roles(Postgres& server) {
  for (const char* role : kRoles) {
    if (server.integer("SELECT count(*) FROM pg_roles WHERE rolname = $1", {role}) > 0) continue;
    try {
      server.run(std::string("CREATE ROLE ") + role + " NOLOGIN");
    } catch (const PostgresFailure& failure) {
      if (failure.lost) throw;
      throw PlantFault{
          fmt::format("the role {} cannot be made: {}. An administrator of the server makes it: CREATE ROLE "
                      "{} NOLOGIN; then repeat --init",
                      role, failure.text, role)};
    }
  }
}

/// Executes work in a transaction.
template <typename Work>
void in_transaction(Postgres& server, const Work& work) {
  server.run("BEGIN");
  try {
    work();
    server.run("COMMIT");
  } catch (const PostgresFailure& failure) {
    if (!failure.lost) server.run("ROLLBACK");
    throw;
  }
}

Json integer_of(const Cell& cell) {
  return cell ? Json(std::stoll(*cell)) : Json(nullptr);
}
Json real_of(const Cell& cell) {
  return cell ? Json(std::stod(*cell)) : Json(nullptr);
}
Json text_of(const Cell& cell) {
  return cell ? Json(*cell) : Json(nullptr);
}

/// Rows as objects; a name that begins with '#' is a whole number, with '~' a number.
Json objects(const Rows& rows, const std::vector<std::string>& names) {
  Json list = Json::array();
  for (const auto& row : rows) {
    Json object = Json::object();
    for (std::size_t i = 0; i < names.size(); ++i) {
      const std::string& name = names[i];
      if (name.front() == '#') {
        object[name.substr(1)] = integer_of(row.at(i));
      } else if (name.front() == '~') {
        object[name.substr(1)] = real_of(row.at(i));
      } else {
        object[name] = text_of(row.at(i));
      }
    }
    list.push_back(std::move(object));
  }
  return list;
}

constexpr const char* kUtime = "(extract(epoch FROM {}) * 1000000)::bigint";

std::string utime(const char* what) {
  return fmt::format(fmt::runtime(kUtime), what);
}

std::string dumped(const Json& document) {
  return document.dump(-1, ' ', false, Json::error_handler_t::replace);
}

}  // namespace

std::string initialise(Postgres& server, const std::string& software) {
  const bool is_there = server.integer("SELECT count(*) FROM pg_namespace WHERE nspname = 'plant'") > 0;
  const std::int64_t version = is_there ? server.integer("SELECT version FROM plant.version") : 0;
  if (version > kPlantVersion)
    throw PlantFault{
        fmt::format("{} has version {} of the schema \"plant\", this program has {}: use the newer slabd-plant",
                    server.place(), version, kPlantVersion)};
  make_roles(server);
  in_transaction(server, [&] {
    if (!is_there) {
      server.run_script(kSchemaText);
      server.run("INSERT INTO plant.version (version, software) VALUES ($1, $2)",
                 {std::to_string(kPlantVersion), software});
    }
    server.run_script(kRightsText);
    server.run("SELECT plant.make_month(now() + m * interval '1 month') FROM generate_series(0, 2) AS m");
  });
  const std::int64_t again = server.integer("SELECT plant.unfold_again()");
  return fmt::format("{}: schema \"plant\" version {} {}{}", server.place(), kPlantVersion,
                     is_there ? "is there" : "made",
                     again > 0 ? fmt::format(", {} documents unfolded again", again) : "");
}

std::string overview(Postgres& server, int days) {
  const std::vector<Cell> since = {std::to_string(days)};
  const std::string recent = "now() - $1::integer * interval '1 day'";
  Json j;
  j["schema"] = "slabd.plant_overview/1";
  j["days"] = days;
  j["lines"] = objects(
      server.run(
          "SELECT l.name, coalesce(s.slabs, 0), coalesce(s.first, 0), coalesce(s.passed, 0), s.passed::double "
          "precision "
          "/ nullif(s.first, 0), " +
              utime("n.newest") + ", " + utime("n.received") +
              ", (SELECT count(*) FROM plant.trouble t JOIN plant.epoch e USING (epoch) WHERE e.line_id = l.line_id) "
              "FROM "
              "plant.line l LEFT JOIN (SELECT line, count(*) AS slabs, count(*) FILTER (WHERE first AND NOT "
              "emulated) AS first, count(*) "
              "FILTER (WHERE first AND NOT emulated AND verdict = 'pass') AS passed FROM plant.v_slab WHERE ended >= " +
              recent +
              " GROUP BY line) s ON s.line = l.name LEFT JOIN LATERAL (SELECT max(s.ended) AS newest, (SELECT "
              "max(i.received) FROM plant.epoch e JOIN LATERAL (SELECT received FROM plant.inbox WHERE epoch = e.epoch "
              "ORDER BY seq DESC LIMIT 1) i ON true WHERE e.line_id = l.line_id) AS received FROM plant.slab s JOIN "
              "plant.epoch e USING (epoch_id) WHERE e.line_id = l.line_id) n ON true ORDER BY l.name",
          since),
      {"line", "#slabs", "#first", "#passed", "~share", "#newest_utime_us", "#received_utime_us", "#troubles"});
  j["days_of"] =
      objects(server.run("SELECT line, ended::date::text, count(*), count(*) FILTER (WHERE verdict = 'pass') "
                         "FROM plant.v_slab WHERE first AND NOT emulated AND ended >= " +
                             recent + " GROUP BY 1, 2 ORDER BY 2, 1",
                         since),
              {"line", "day", "#first", "#passed"});
  j["pareto"] = objects(
      server.run(
          "SELECT line, item, sum(failed), sum(indeterminate), sum(not_measured), sum(slabs) FROM plant.v_pareto "
          "WHERE day >= (" +
              recent + ")::date GROUP BY 1, 2 ORDER BY 3 DESC, 4 DESC, 5 DESC, 2, 1 LIMIT " + kListMax,
          since),
      {"line", "item", "#failed", "#indeterminate", "#not_measured", "#slabs"});
  j["moulds"] = objects(
      server.run("SELECT i.mould, i.slab_type, n.name, count(*), avg(i.value - i.nominal), stddev_samp(i.value - "
                 "i.nominal), count(DISTINCT e.line_id) FROM plant.item i JOIN plant.item_name n USING (item_id) JOIN "
                 "plant.epoch e USING (epoch_id) WHERE NOT i.emulated AND i.mould IS NOT NULL AND i.value IS NOT NULL "
                 "AND i.nominal IS NOT "
                 "NULL AND i.lower < i.upper AND i.ended >= " +
                     recent +
                     " GROUP BY 1, 2, 3 HAVING count(*) >= 5 ORDER BY abs(avg((i.value - i.nominal) / (i.upper - "
                     "i.lower))) DESC LIMIT " +
                     kListMax,
                 since),
      {"#mould", "#slab_type", "item", "#n", "~mean", "~sd", "#lines"});
  return dumped(j);
}

std::string found_slab(Postgres& server, const std::string& slab_id) {
  Json j;
  j["schema"] = "slabd.plant_found/1";
  j["slab_id"] = slab_id;
  j["slabs"] = Json::array();
  const Rows slabs =
      server.run("SELECT line, slab_key, slab_type, mould, " + utime("ended") +
                     ", verdict, reason, disposition, software, epoch FROM plant.v_slab WHERE slab_id = $1 "
                     "ORDER BY ended DESC LIMIT " +
                     kListMax,
                 {slab_id});
  const Json heads = objects(slabs, {"line", "#slab_key", "#slab_type", "#mould", "#ended_utime_us", "verdict",
                                     "#reason", "disposition", "software"});
  for (std::size_t i = 0; i < slabs.size(); ++i) {
    Json slab = heads[i];
    slab["items"] = objects(
        server.run("SELECT item, station, station_to, verdict, value, nominal, lower, upper, u FROM plant.v_item WHERE "
                   "epoch = $1 AND slab_key = $2 AND verdict IN ('fail', 'indeterminate', 'not_measured') ORDER BY "
                   "station, station_to, item",
                   {slabs[i].at(9), slabs[i].at(1)}),
        {"item", "#station", "#station_to", "verdict", "~value", "~nominal", "~lower", "~upper", "~u"});
    j["slabs"].push_back(std::move(slab));
  }
  return dumped(j);
}

}  // namespace slabd::plant
