// SPDX-License-Identifier: Apache-2.0
//
// slabd-plant: sends the line's results to the plant's database. slabd does not need it and does not wait for it; a
// server that is away for days costs nothing but disk.
#include <fmt/core.h>
#include <unistd.h>

#include <CLI/CLI.hpp>
#include <algorithm>
#include <csignal>
#include <cstdlib>
#include <ctime>
#include <nlohmann/json.hpp>

#include "base/durable.h"
#include "config/config.h"
#include "plant/administration.h"
#include "plant/sender.h"

namespace slabd::plant {
namespace {

constexpr int kExitUsage = 2;
constexpr int kExitBadInput = 3;
constexpr int kExitUnreachable = 4;
constexpr int kExitInternal = 5;
constexpr auto kLook = std::chrono::seconds(2);           ///< between two looks at an outbox without news
constexpr auto kPatienceFirst = std::chrono::seconds(1);  ///< after a failure, doubled each time
constexpr auto kPatienceMost = std::chrono::seconds(60);
constexpr auto kFaultPatience = std::chrono::seconds(60);  ///< after a fault that needs a person
constexpr auto kHour = std::chrono::hours(1);
constexpr int kDaysDefault = 30;

using Clock = std::chrono::steady_clock;

void say(const std::string& sentence) {
  fmt::print(stderr, "slabd-plant: {}\n", sentence);
}

struct Options {
  std::string config = "/etc/slabd/slabd.toml";
  bool init = false;
  bool check = false;
  bool once = false;
  bool take_over = false;
  bool json = false;
  std::string show;
  int days = kDaysDefault;
};

/// Cure for missing rights, by the work that needs them.
constexpr const char* kSends = "GRANT slabd_plant_writer TO it";
constexpr const char* kShows = "GRANT slabd_plant_reader TO it";
constexpr const char* kMakes =
    "the owner of the database and of the schema \"plant\", or an administrator, runs --init";

/// A server's error with its cure.
std::string sentence_of(const PostgresFailure& failure, const std::string& place, const char* rights = kSends) {
  if (failure.state == "42501") return fmt::format("{}: {}; the role lacks rights: {}", place, failure.text, rights);
  if (failure.state == "53100") return fmt::format("{}: its disk is full: {}", place, failure.text);
  if (failure.state == "3F000" || failure.state == "42P01")
    return fmt::format("{}: {}; its owner makes the schema with slabd-plant --init", place, failure.text);
  return failure.state.empty() ? failure.text : fmt::format("{}: {} (SQLSTATE {})", place, failure.text, failure.state);
}

/// Waits for a signal; true if one came.
bool ended_within(const sigset_t& ends, std::chrono::milliseconds time) {
  const timespec limit{static_cast<time_t>(time.count() / 1'000), static_cast<long>(time.count() % 1'000 * 1'000'000)};
  return ::sigtimedwait(&ends, nullptr, &limit) > 0;
}

class Sender {
 public:
  Sender(const config::Config& config, const Options& options) : config_(config), options_(options) {}

  /// Sends all that waits. Throws PlantFault or PostgresFailure.
  void drain(Line& line, Postgres& server, const sigset_t& ends) {
    const std::string epoch = line.epochs.back().uuid;
    const Result<std::int64_t> noted = line.outbox->sent_seq();
    if (!noted.ok()) throw PlantFault{std::string(noted.error().text.view())};
    if (epoch != epoch_) arrived_ = 0;
    epoch_ = epoch;
    arrived_ = std::max(arrived_, noted.value());
    if (std::exchange(is_new_, false)) {
      // A server that was set back to a backup lacks rows that it had taken.
      if (const std::int64_t there = newest_there(server, line); there < arrived_) {
        say(
            fmt::format("the {} has this line's rows up to {} and had taken them up to {}: it was set back, and they "
                        "are sent again",
                        place_, there, arrived_));
        arrived_ = there;
      }
    }
    for (;;) {
      const Sent sent = send_batch(server, line, arrived_, config_.plant.batch);
      if (sent.newest_seq == 0) break;
      arrived_ = sent.newest_seq;
      total_ += sent.rows;
      if (acknowledge(config_, epoch, arrived_)) acknowledged_ = arrived_;
      if (ended_within(ends, std::chrono::milliseconds(0))) throw Ended{};
    }
    // slabd was away while rows arrived.
    if (arrived_ > acknowledged_ && arrived_ > noted.value() && acknowledge(config_, epoch, arrived_))
      acknowledged_ = arrived_;
  }

  /// The whole life of the process. Returns the exit status.
  int run(const sigset_t& ends) {
    auto patience = kPatienceFirst;
    bool introduced_ever = false;
    for (;;) {
      std::chrono::milliseconds wait = kLook;
      bool may_repeat = false;
      try {
        Line line = open_line(config_);
        Postgres server(config_.plant.dsn, "slabd-plant");
        place_ = server.place();
        introduce(server, config_.plant, line, options_.take_over);
        if (!introduced_ever || !trouble_.empty())
          say(fmt::format("line {} sends to the {}", config_.plant.line, place_));
        introduced_ever = true;
        is_new_ = true;
        trouble_.clear();
        patience = kPatienceFirst;
        write_metrics(true);
        for (Clock::time_point again = Clock::now() + kHour;;) {
          drain(line, server, ends);
          if (options_.once) return done();
          write_metrics(true);
          if (ended_within(ends, kLook)) return done();
          // Opened again each time: a restore puts another file in this place, with another epoch.
          const std::string epoch = line.epochs.back().uuid;
          line = open_line(config_);
          const bool is_another = line.epochs.back().uuid != epoch;
          if (is_another || Clock::now() >= again) break;  // to introduce it, and to make the next month
        }
        continue;
      } catch (const Ended&) {
        return done();
      } catch (const PlantFault& fault) {
        complain(fault.text);
        wait = kFaultPatience;
      } catch (const PostgresFailure& failure) {
        complain(sentence_of(failure, place_));
        // Two lines that bring the same new names at once may wait for each other; the server ends one of them.
        may_repeat = failure.state == "40P01";
        wait = std::exchange(patience, std::min<std::chrono::seconds>(2 * patience, kPatienceMost));
      }
      if (options_.once && !may_repeat) return kExitUnreachable;
      write_metrics(false);
      if (ended_within(ends, wait)) return done();
    }
  }

 private:
  struct Ended {};

  int done() const {
    say(fmt::format("{} rows sent", total_));
    return 0;
  }

  void complain(const std::string& sentence) {
    if (sentence == trouble_) return;  // once, however long it lasts
    trouble_ = sentence;
    say(sentence);
  }

  void write_metrics(bool connected) {
    if (config_.plant.metrics_file.empty()) return;
    const std::string text = fmt::format(
        "# HELP slabd_plant_connected 1: the plant's database takes this line's results\n"
        "# TYPE slabd_plant_connected gauge\nslabd_plant_connected {}\n"
        "# HELP slabd_plant_sent_total Rows sent since the start of slabd-plant\n"
        "# TYPE slabd_plant_sent_total counter\nslabd_plant_sent_total {}\n"
        "# HELP slabd_plant_arrived_seq All rows of the outbox up to this one have arrived\n"
        "# TYPE slabd_plant_arrived_seq gauge\nslabd_plant_arrived_seq {}\n",
        connected ? 1 : 0, total_, arrived_);
    const Status status = write_durably(config_.plant.metrics_file, text);
    const std::string trouble = status.ok() ? "" : std::string(status.error().text.view());
    if (!trouble.empty() && trouble != metrics_trouble_) say(trouble);
    metrics_trouble_ = trouble;
  }

  const config::Config& config_;
  const Options& options_;
  std::string place_ = "plant's database";
  std::string trouble_;
  std::string metrics_trouble_;
  std::string epoch_;
  bool is_new_ = false;  ///< the connection: nothing was sent over it
  std::int64_t arrived_ = 0;
  std::int64_t acknowledged_ = 0;
  std::int64_t total_ = 0;
};

int print_check(const config::Config& config, const Options& options) {
  Line line = open_line(config);
  Postgres server(config.plant.dsn, "slabd-plant --check");
  introduce(server, config.plant, line, false);
  const Result<std::int64_t> sent = line.outbox->sent_seq();
  if (!sent.ok()) throw PlantFault{std::string(sent.error().text.view())};
  const std::vector<EpochCheck> epochs = check(server, line, sent.value());
  std::vector<std::string> names;
  for (const storage::Epoch& epoch : line.epochs) names.push_back(epoch.uuid);
  const std::int64_t troubles =
      server.integer("SELECT count(*) FROM plant.trouble WHERE epoch = ANY ($1)", {array_of(names)});
  const std::int64_t missing = server.integer("SELECT plant.missing_slabs($1)", {array_of(names)});
  std::int64_t newest = sent.value();
  for (const EpochCheck& one : epochs) newest = std::max(newest, one.newest_there);
  constexpr std::size_t kWaitingMax = 100'000;
  const auto waits = line.outbox->rows_after(newest, kWaitingMax);
  if (!waits.ok()) throw PlantFault{std::string(waits.error().text.view())};
  const std::size_t waiting = waits.value().size();
  const bool complete =
      missing == 0 && std::all_of(epochs.begin(), epochs.end(), [](const EpochCheck& one) { return one.equal; });
  if (options.json) {
    nlohmann::ordered_json j{{"schema", "slabd.plant_check/1"}, {"line", config.plant.line}};
    j["epochs"] = nlohmann::ordered_json::array();
    for (const EpochCheck& one : epochs)
      j["epochs"].push_back({{"epoch", one.epoch},
                             {"stored", one.stored},
                             {"there", one.there},
                             {"newest_seq", one.newest_seq},
                             {"newest_there", one.newest_there},
                             {"equal", one.equal},
                             {"sent_again", one.sent_again},
                             {"lost", one.lost},
                             {"other", one.other},
                             {"only_there", one.only_there}});
    j["troubles"] = troubles;
    j["missing_slabs"] = missing;
    j["waiting"] = waiting;
    j["complete"] = complete;
    fmt::print("{}\n", j.dump());
  } else {
    for (const EpochCheck& one : epochs)
      fmt::print(
          "epoch {}: {} rows sent, {} there; {} sent again ({} without their slab), {} with another content, {} "
          "only there\n",
          one.epoch, one.stored, one.there, one.sent_again, one.lost, one.other, one.only_there);
    if (waiting > 0) fmt::print("{} rows wait to be sent\n", waiting);
    if (missing > 0)
      fmt::print(
          "{} slabs have arrived and are not in plant.slab: the owner of the plant's database makes its tables "
          "again from what was sent with SELECT plant.unfold_all()\n",
          missing);
    fmt::print("{} documents could not be unfolded\n{}\n", troubles,
               complete ? "the plant's database is complete" : "the plant's database differs from the outbox");
  }
  return complete && troubles == 0 ? 0 : 1;
}

int run(int argc, char** argv) {
  sigset_t ends;
  ::sigemptyset(&ends);
  for (const int one : {SIGTERM, SIGINT}) ::sigaddset(&ends, one);
  ::sigprocmask(SIG_BLOCK, &ends, nullptr);
  std::signal(SIGPIPE, SIG_IGN);
  std::signal(SIGHUP, SIG_IGN);

  CLI::App app("slabd-plant: sends the results of a line to the plant's database (docs/PLANT.md).", "slabd-plant");
  Options options;
  app.add_option("--config", options.config,
                 "Configuration of slabd; slabd-plant uses [plant], [storage] db and [control] "
                 "socket")
      ->capture_default_str();
  auto* init = app.add_flag("--init", options.init, "Make or upgrade the schema \"plant\", its roles and rights");
  auto* check = app.add_flag("--check", options.check, "Compare all rows that were sent, and send missing ones again");
  auto* once = app.add_flag("--once", options.once, "Send what waits, then end");
  auto* show =
      app.add_option("--show", options.show, "Print a document of the plant's database: overview, or slab=SLAB_ID");
  app.add_flag("--take-over", options.take_over, "This database is the line's from now on, instead of another one")
      ->needs(once);
  app.add_flag("--json", options.json, "Print --check as JSON")->needs(check);
  app.add_option("--days", options.days, "Days of --show overview")
      ->capture_default_str()
      ->needs(show)
      ->check(CLI::Range(1, 3'650));
  init->excludes(check)->excludes(once)->excludes(show);
  check->excludes(once)->excludes(show);
  once->excludes(show);
  app.set_version_flag("--version", std::string("slabd-plant " SLABD_VERSION));
  try {
    app.parse(argc, argv);
  } catch (const CLI::ParseError& fault) {
    return app.exit(fault) == 0 ? 0 : kExitUsage;
  }
  if (!options.show.empty() && options.show != "overview" && !options.show.starts_with("slab=")) {
    say(fmt::format("--show {}: allowed are overview and slab=SLAB_ID", options.show));
    return kExitUsage;
  }
  config::Config config;
  std::vector<config::Problem> problems;
  config::load_config(options.config, config, problems);
  problems.insert(problems.end(), config.plant_problems.begin(), config.plant_problems.end());
  for (const config::Problem& problem : problems) say(problem.text);
  if (!problems.empty()) return kExitBadInput;
  // For readers of the plant page, whose connection is not the line's.
  if (const char* dsn = std::getenv("SLABD_PLANT_DSN"); dsn != nullptr && *dsn != '\0') config.plant.dsn = dsn;
  if (config.plant.dsn.empty()) {
    say(fmt::format("{} has no [plant] dsn, so there is no plant's database", options.config));
    return kExitBadInput;
  }
  try {
    if (!options.show.empty()) {
      Postgres server(config.plant.dsn, "slabd-plant --show");
      fmt::print("{}\n", options.show == "overview" ? overview(server, options.days)
                                                    : found_slab(server, options.show.substr(5)));
      return 0;
    }
    if (options.init) {
      Postgres server(config.plant.dsn, "slabd-plant --init");
      fmt::print("{}\n", initialise(server, SLABD_VERSION));
      return 0;
    }
    if (options.check) return print_check(config, options);
  } catch (const PlantFault& fault) {
    say(fault.text);
    return kExitUnreachable;
  } catch (const PostgresFailure& failure) {
    say(sentence_of(failure, "plant's database", options.init ? kMakes : options.show.empty() ? kSends : kShows));
    return kExitUnreachable;
  }
  return Sender(config, options).run(ends);
}

}  // namespace
}  // namespace slabd::plant

int main(int argc, char** argv) {
  try {
    return slabd::plant::run(argc, argv);
  } catch (const std::exception& fault) {
    fmt::print(stderr, "slabd-plant: internal error: {}\n", fault.what());
    return slabd::plant::kExitInternal;
  }
}
