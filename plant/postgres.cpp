// SPDX-License-Identifier: Apache-2.0
#include "plant/postgres.h"

#include <arpa/inet.h>
#include <libpq-fe.h>
#include <poll.h>

#include <algorithm>
#include <array>
#include <cerrno>
#include <cstdlib>
#include <sstream>

namespace slabd::plant {
namespace {

using Clock = std::chrono::steady_clock;

constexpr auto kConnectPatience = std::chrono::seconds(15);

std::string one_line(const char* text) {
  std::string line = text == nullptr ? "" : text;
  while (!line.empty() && (line.back() == '\n' || line.back() == ' ')) line.pop_back();
  std::replace(line.begin(), line.end(), '\n', ' ');
  return line;
}

struct Options {
  explicit Options(const std::string& dsn) {
    char* why = nullptr;
    list = PQconninfoParse(dsn.c_str(), &why);
    if (list == nullptr) {
      PostgresFailure failure{"the connection string cannot be read: " + one_line(why), {}, true};
      PQfreemem(why);
      throw failure;
    }
  }
  ~Options() { PQconninfoFree(list); }
  Options(const Options&) = delete;
  Options& operator=(const Options&) = delete;

  [[nodiscard]] std::string value(const std::string& key) const {
    for (const PQconninfoOption* one = list; one->keyword != nullptr; ++one)
      if (key == one->keyword && one->val != nullptr) return one->val;
    return {};
  }
  PQconninfoOption* list = nullptr;
};

/// A socket, or an address that cannot leave this computer. A name that only begins like one is another computer.
bool is_this_computer(const std::string& place) {
  if (place.empty() || place.front() == '/' || place.front() == '@' || place == "localhost" || place == "::1")
    return true;
  in_addr address{};
  return ::inet_pton(AF_INET, place.c_str(), &address) == 1 && (ntohl(address.s_addr) >> 24U) == IN_LOOPBACKNET;
}

std::string environment(const char* name) {
  const char* const value = std::getenv(name);
  return value == nullptr ? "" : value;
}

/// True if no server that libpq may choose is another computer: each host of the lists, from the string or from the
/// environment. The content of a service file is not known here.
bool are_on_this_computer(const Options& options) {
  if (!options.value("service").empty() || !environment("PGSERVICE").empty()) return false;
  const auto given = [&](const char* key, const char* variable) {
    const std::string value = options.value(key);
    return value.empty() ? environment(variable) : value;
  };
  const std::string addresses = given("hostaddr", "PGHOSTADDR");
  std::istringstream list(addresses.empty() ? given("host", "PGHOST") : addresses);
  for (std::string place; std::getline(list, place, ',');)
    if (!is_this_computer(place)) return false;
  return true;
}

}  // namespace

struct Postgres::Handle {
  PGconn* connection = nullptr;
};

void Postgres::Closer::operator()(Handle* handle) const {
  PQfinish(handle->connection);
  delete handle;
}

Postgres::Postgres(const std::string& dsn, const char* name) : handle_(new Handle) {
  const Options options(dsn);
  std::vector<std::pair<std::string, std::string>> settings;
  for (const PQconninfoOption* one = options.list; one->keyword != nullptr; ++one)
    if (one->val != nullptr) settings.emplace_back(one->keyword, one->val);
  const auto add = [&](const char* key, const std::string& value) {
    if (options.value(key).empty()) settings.emplace_back(key, value);
  };
  if (!are_on_this_computer(options) && std::getenv("PGSSLMODE") == nullptr) add("sslmode", "verify-full");
  add("application_name", name);
  add("tcp_user_timeout", "30000");
  add("keepalives_idle", "10");
  add("keepalives_interval", "5");
  add("keepalives_count", "4");
  add("client_encoding", "UTF8");
  std::vector<const char*> keys;
  std::vector<const char*> values;
  for (const auto& [key, value] : settings) {
    keys.push_back(key.c_str());
    values.push_back(value.c_str());
  }
  keys.push_back(nullptr);
  values.push_back(nullptr);
  place_ = "database " + options.value("dbname") + " on " +
           (options.value("host").empty() ? "this computer" : options.value("host"));
  PGconn* const connection = handle_->connection = PQconnectStartParams(keys.data(), values.data(), 0);
  if (connection == nullptr) throw PostgresFailure{"no memory for a connection", {}, true};
  const auto until = Clock::now() + kConnectPatience;
  for (PostgresPollingStatusType next = PGRES_POLLING_WRITING; next != PGRES_POLLING_OK;) {
    if (next == PGRES_POLLING_FAILED || PQstatus(connection) == CONNECTION_BAD)
      throw PostgresFailure{one_line(PQerrorMessage(connection)), {}, true};
    wait_for(next == PGRES_POLLING_READING, until);
    next = PQconnectPoll(connection);
  }
  (void)PQsetnonblocking(connection, 1);
  PQsetNoticeProcessor(
      connection, [](void*, const char*) {}, nullptr);
  if (const char* database = PQdb(connection))
    place_ = std::string("database ") + database + place_.substr(place_.find(" on "));
}

void Postgres::wait_for(bool readable, Clock::time_point until) {
  for (;;) {
    const auto left = std::chrono::duration_cast<std::chrono::milliseconds>(until - Clock::now()).count();
    pollfd fd{PQsocket(handle_->connection), static_cast<short>(readable ? POLLIN : POLLOUT), 0};
    const int got = left <= 0 ? 0 : ::poll(&fd, 1, static_cast<int>(left));
    if (got > 0) return;
    if (got < 0 && errno == EINTR) continue;
    throw PostgresFailure{place_ + " does not answer", {}, true};
  }
}

Rows Postgres::take_results() {
  PGconn* const connection = handle_->connection;
  const auto until = Clock::now() + patience_;
  while (PQflush(connection) == 1) wait_for(false, until);
  Rows rows;
  std::optional<PostgresFailure> failure;
  for (;;) {
    while (PQisBusy(connection) == 1) {
      wait_for(true, until);
      if (PQconsumeInput(connection) == 0) throw PostgresFailure{one_line(PQerrorMessage(connection)), {}, true};
    }
    PGresult* const result = PQgetResult(connection);
    if (result == nullptr) break;
    const ExecStatusType status = PQresultStatus(result);
    if (status == PGRES_TUPLES_OK) {
      rows.clear();
      for (int row = 0; row < PQntuples(result); ++row) {
        std::vector<Cell>& cells = rows.emplace_back();
        for (int column = 0; column < PQnfields(result); ++column)
          cells.push_back(PQgetisnull(result, row, column) == 1
                              ? Cell{}
                              : Cell{std::string(PQgetvalue(result, row, column),
                                                 static_cast<std::size_t>(PQgetlength(result, row, column)))});
      }
    } else if (status != PGRES_COMMAND_OK && status != PGRES_EMPTY_QUERY && !failure) {
      const char* const state = PQresultErrorField(result, PG_DIAG_SQLSTATE);
      const char* const text = PQresultErrorField(result, PG_DIAG_MESSAGE_PRIMARY);
      failure = {one_line(text != nullptr ? text : PQresultErrorMessage(result)), state != nullptr ? state : "", false};
    }
    PQclear(result);
  }
  if (PQstatus(connection) != CONNECTION_OK)
    throw PostgresFailure{failure ? failure->text : one_line(PQerrorMessage(connection)), {}, true};
  if (failure) throw PostgresFailure(*failure);
  return rows;
}

Rows Postgres::run(const std::string& sql, const std::vector<Cell>& parameters) {
  std::vector<const char*> values;
  values.reserve(parameters.size());
  for (const Cell& parameter : parameters) values.push_back(parameter ? parameter->c_str() : nullptr);
  if (PQsendQueryParams(handle_->connection, sql.c_str(), static_cast<int>(values.size()), nullptr, values.data(),
                        nullptr, nullptr, 0) != 1)
    throw PostgresFailure{one_line(PQerrorMessage(handle_->connection)), {}, true};
  return take_results();
}

void Postgres::run_script(const std::string& sql) {
  if (PQsendQuery(handle_->connection, sql.c_str()) != 1)
    throw PostgresFailure{one_line(PQerrorMessage(handle_->connection)), {}, true};
  (void)take_results();
}

std::int64_t Postgres::integer(const std::string& sql, const std::vector<Cell>& parameters) {
  const Rows rows = run(sql, parameters);
  if (rows.empty() || rows.front().empty() || !rows.front().front()) return 0;
  return std::strtoll(rows.front().front()->c_str(), nullptr, 10);
}

std::string array_of(const std::vector<std::string>& plain) {
  std::string text = "{";
  for (const std::string& one : plain) text += (text.size() > 1 ? "," : "") + one;
  return text + "}";
}

}  // namespace slabd::plant
