// SPDX-License-Identifier: Apache-2.0
//
// slabctl simulate: PLC, robot and scanner of the line, as peers of a running daemon over the real protocols.
#include <fmt/core.h>
#include <unistd.h>
#include <cmath>
#include <csignal>
#include <fstream>
#include <iostream>
#include <memory>

#include "cli/client/record_options.h"
#include "cli/command.h"
#include "cli/exit.h"
#include "cli/recipe/recipe_source.h"
#include "cli/simulate/mastered_slab.h"
#include "cli/simulate/simulate_arms.h"
#include "cli/simulate/simulate_calibration.h"
#include "cli/simulate/simulate_history.h"
#include "cli/simulate/simulate_report.h"
#include "cli/simulate/simulate_scan.h"
#include "cli/simulate/simulate_tie.h"
#include "cli/stations/krl.h"
#include "cli/terminal/arguments.h"
#include "cli/terminal/parse.h"
#include "config/designs.h"
#include "emulator/line_run.h"

namespace slabd::cli::simulate {
namespace {

struct Options {
  std::string config;
  std::uint32_t slab_no = 1;
  std::string slab_id;
  std::uint16_t type = 0;      ///< 0: that of the longest slab
  std::uint16_t begin_as = 0;  ///< SLAB_TYPE written by the PLC; 0: the slab's own
  std::uint16_t mould = 0;
  int slabs = 1;
  std::vector<std::string> defects;
  emulator::SlabVariation variation;
  ScannerOptions scanner;
  std::string scan_format = "ply";
  emulator::Warming warming;
  std::string scanner_fault;
  std::string gauge_fault;
  std::string stations;  ///< KRL points of the robot program
  std::string backend;   ///< empty: the configuration's backend
  double robot_rate_hz = 125.0;
  std::string rsi;
  double rsi_faults = 0.0;
  double move_s = 0.3;
  int plc_cycle_ms = 5;
  std::string plc_device;  ///< other end of the serial line
  int scans_per_station = 3;
  double temperature_c = kNoValue;
  bool temperature_unknown = false;
  std::string cast_by;      ///< folder of the design sheets of the concrete; empty: the line's
  std::string certificate;  ///< path for a certificate of the slab
  bool stand_by = false;    ///< runs robot and scanner only
  TieError tie_error;
  std::string fail_scanner;  ///< "ID@STATION"
  bool json = false;
};

std::atomic<bool> stop_requested{false};

void on_signal(int) {
  stop_requested = true;
}

/// Ctrl-C ends the run between two PLC cycles; a second one kills the process.
void catch_signals() {
  struct sigaction action = {};
  action.sa_handler = on_signal;
  action.sa_flags = static_cast<int>(SA_RESETHAND);
  sigaction(SIGINT, &action, nullptr);
  sigaction(SIGTERM, &action, nullptr);
}

/// One line on a terminal, rewritten in place; no output elsewhere.
class Progress {
 public:
  Progress(int stations, std::uint32_t slab_no)
      : stations_(stations), slab_no_(slab_no), shown_(isatty(STDERR_FILENO) != 0) {}
  ~Progress() {
    if (shown_) fmt::print(stderr, "\r\x1b[K");
  }
  Progress(const Progress&) = delete;
  Progress& operator=(const Progress&) = delete;

  void operator()(int station, std::string_view doing) const {
    if (!shown_) return;
    const auto filled = static_cast<std::size_t>(24 * station / std::max(1, stations_));
    fmt::print(stderr, "\r\x1b[Kslab {} [{}{}] {}/{} {}", slab_no_, std::string(filled, '#'),
               std::string(24 - filled, '.'), station, stations_, doing);
    std::fflush(stderr);
  }

 private:
  int stations_;
  std::uint32_t slab_no_;
  bool shown_;
};

emulator::PlcTraits plc_traits(const config::Config& config, const Options& options) {
  emulator::PlcTraits traits;
  traits.plc = config.plc;
  traits.device = options.plc_device;
  traits.cycle = std::chrono::milliseconds(options.plc_cycle_ms);
  // A PLC gives an order up after the 2 s of FB_SLABD.st, because its robot waits. Here the daemon may share a busy
  // computer with its line, and a late answer is not a fault: as long as for a scan.
  traits.ack_rewrites = 40;
  return traits;
}

emulator::RobotTraits robot_traits(const config::Config& config, std::size_t arm, const Options& options) {
  const config::ArmSettings& settings = config.arm(arm);
  emulator::RobotTraits traits;
  traits.lcm_url = settings.robot.url.view();
  traits.channel = settings.robot.channel.view();
  traits.rate_hz = options.robot_rate_hz;
  traits.move_s = options.move_s;
  traits.base_id = settings.pose.base_id;
  traits.tool_id = settings.pose.tool_id;
  traits.seed = emulator::derived_seed(options.variation.seed, 6, arm);
  if (arm == 0) traits.rsi = options.rsi;
  traits.rsi_faults = options.rsi_faults;
  return traits;
}

std::string id_of(const Options& options, int index) {
  const std::uint32_t slab_no = options.slab_no + static_cast<std::uint32_t>(index);
  if (options.slab_id.empty()) return fmt::format("SIM-{}", slab_no);
  return options.slabs == 1 ? options.slab_id : fmt::format("{}-{}", options.slab_id, index + 1);
}

std::optional<storage::SlabRecord> read_back(const std::string& db_path, const emulator::SlabOrder& order) {
  const auto reader = storage::open_reader(db_path);
  if (!reader) return std::nullopt;
  const auto keys = reader.value()->find_id(order.slab_id);
  if (!keys || keys.value().empty()) return std::nullopt;
  auto record = reader.value()->slab(keys.value().front());
  if (!record || !record.value() || record.value()->summary.header.slab_no != order.slab_no) return std::nullopt;
  return std::move(record.value());
}

int exit_of(const std::vector<SlabOutcome>& outcomes) {
  for (const SlabOutcome& outcome : outcomes) {
    const emulator::SlabRun& run = outcome.run;
    if (run.finished || run.trouble.interrupted) continue;
    // The daemon rejected the command (a code) or no longer answered.
    return run.trouble.code == Code::ok ? cli::kNotReachable : cli::exit_for(run.trouble.code);
  }
  const bool all_pass = std::all_of(outcomes.begin(), outcomes.end(), [](const SlabOutcome& outcome) {
    return outcome.run.finished && outcome.run.verdict == Verdict::pass;
  });
  return all_pass && !outcomes.empty() ? cli::kDone : cli::kNotPass;
}

template <typename Peer>
Peer started(Result<Peer> peer) {
  const bool wrong = !peer && peer.error().code == Code::config;
  return cli::need(std::move(peer), wrong ? cli::kBadInput : cli::kNotReachable);
}

/// In 0.1 K as the PLC sends it; 0: not known.
std::uint16_t sent_temperature(const Options& options) {
  if (!has_value(options.temperature_c) || options.temperature_unknown) return 0;
  return static_cast<std::uint16_t>(std::lround(10.0 * (options.temperature_c + kKelvinAtZero_c)));
}

/// Relative expansion of the slab's concrete. The emulated slab expands by its own figures if the recipe has none.
double expansion_of(const Options& options, const ThermalSettings& thermal) {
  constexpr double kReference_c = 20.0;
  constexpr double kConcrete_per_K = 1e-5;
  if (!has_value(options.temperature_c)) return 0.0;
  return thermal.given ? thermal.cte_per_K.value * (options.temperature_c - thermal.reference_c.value)
                       : kConcrete_per_K * (options.temperature_c - kReference_c);
}

/// Starts the robot and the scanner of every arm. Each robot begins at the first station that it usually scans.
Arms start_arms(const Options& options, const config::Config& config, const emulator::ScannerTraits& scanner_traits,
                const emulator::ScannerFault& fault, const emulator::SlabTruth& slab) {
  Arms arms;
  for (std::size_t arm = 0; arm < config.arms.list.size(); ++arm) {
    const int first = std::max(1, emulator::first_station(config.arms, arm, slab.stations));
    auto robot = started(emulator::RobotPeer::start(robot_traits(config, arm, options),
                                                    slab.at(first).stop(arm).T_base_flange_reported));
    auto outlet = started(emulator::open_outlet(config.arm(arm), *hal::scan_format_named(options.scan_format)));
    emulator::ScannerTraits traits = scanner_traits;
    if (arm != 0) traits.scanner_seed = emulator::derived_seed(options.variation.seed, 7, arm);
    arms.add(std::move(robot), started(emulator::ScannerPeer::start(traits, std::move(outlet), fault)));
  }
  return arms;
}

/// Runs the slabs with the connected peers.
std::vector<SlabOutcome> run_line(const Options& options, const config::Config& config, const Recipe& recipe,
                                  const emulator::Cell& cell, std::vector<emulator::SlabTruth> truths,
                                  emulator::PlcPeer& plc, const Arms& arms, emulator::GaugePeer* gauges,
                                  const emulator::ScannerFailure& failure) {
  std::vector<SlabOutcome> outcomes;
  outcomes.reserve(truths.size());
  for (int i = 0; i < options.slabs && !stop_requested; ++i) {
    SlabOutcome& outcome = outcomes.emplace_back();
    outcome.truth = truths[static_cast<std::size_t>(i)];
    const emulator::SlabOrder order{options.slab_no + static_cast<std::uint32_t>(i), id_of(options, i),
                                    options.begin_as != 0 ? options.begin_as : recipe.slab_type, options.mould,
                                    sent_temperature(options)};
    {
      const Progress progress(recipe.stations(), order.slab_no);
      const emulator::Line line{plc,
                                arms.peers,
                                config.arms,
                                recipe,
                                cell,
                                options.scans_per_station,
                                plc_traits(config, options),
                                [&](int station, std::string_view doing) { progress(station, doing); },
                                gauges,
                                failure};
      outcome.run = emulator::run_slab(line, order, outcome.truth);
    }
    for (int k = 1; k <= outcome.truth.stations; ++k) {
      const auto index = static_cast<std::size_t>(k - 1);
      outcome.truth.station[index].flatness_mm = arms.scanners[outcome.run.station[index].arm]->flatness_mm(k);
    }
    for (const auto& scanner : arms.scanners)
      if (const std::string trouble = scanner->trouble(); !trouble.empty())
        cli::complain(fmt::format("scanner: {}", trouble));
    outcome.stored = read_back(config.storage.db_path, order);
    if (!outcome.run.finished) break;
  }
  return outcomes;
}

/// The sheets by which the slabs are cast: those of the line, or those of --cast-by.
config::DesignSet cast_designs(const Options& options, const config::Config& config, const Recipe& recipe) {
  config::DesignSet designs;
  if (!options.cast_by.empty())
    designs = config::load_designs(options.cast_by);
  else if (recipe.design != DesignUse::none)
    designs = config::load_designs(config.designs_dir);
  if (!options.cast_by.empty() && !designs.problems.empty()) cli::stop(cli::kBadInput, designs.problems.front().text);
  return designs;
}

/// Casts all slabs before the run, so that an invalid option is detected first.
Result<std::vector<emulator::SlabTruth>> cast_slabs(const Options& options, const Recipe& recipe,
                                                    const emulator::Cell& cell,
                                                    const std::vector<emulator::Defect>& defects,
                                                    const config::DesignSet& designs) {
  std::vector<emulator::SlabTruth> truths;
  for (int i = 0; i < options.slabs; ++i) {
    emulator::SlabVariation variation = options.variation;
    variation.slab_no = options.slab_no + static_cast<std::uint32_t>(i);
    if (const DesignSheet* const sheet = find_design(designs.sheets, id_of(options, i)); sheet != nullptr)
      if (const auto design = parse_design(sheet->text.view())) variation.design = design.value();
    variation.expansion = expansion_of(options, recipe.thermal);
    const Result<emulator::SlabTruth> truth = emulator::cast_slab(recipe, cell, variation, defects);
    if (!truth) return truth.error();
    truths.push_back(truth.value());
  }
  return truths;
}

int simulate(const Options& options) {
  RunFacts facts;
  facts.config = options.config;
  facts.seed = options.variation.seed;
  facts.defect_texts = options.defects;
  for (const std::string& text : options.defects) {
    facts.defects.push_back(cli::need(emulator::parse_defect(text), cli::kUsage));
  }
  emulator::ScannerTraits scanner_traits = options.scanner.traits();
  scanner_traits.scanner_seed = options.variation.seed;
  scanner_traits.warming = options.warming;
  scanner_traits.concrete = options.scanner.concrete();
  const emulator::ScannerFault fault = cli::need(emulator::parse_scanner_fault(options.scanner_fault), cli::kUsage);
  for (int i = 0; i < options.slabs; ++i) {
    if (id_of(options, i).size() <= limits::kSlabIdBytes) continue;
    cli::stop(cli::kUsage,
              fmt::format("--slab-id: '{}' has more than {} characters", id_of(options, i), limits::kSlabIdBytes));
  }
  const config::Config config = cli::config_from(options.config);
  const Recipe recipe = cli::recipe_of_type(config, options.type);
  if ((config.plc.role == hal::PlcRole::rtu) != !options.plc_device.empty() && !options.stand_by)
    cli::stop(cli::kUsage,
              options.plc_device.empty()
                  ? fmt::format("{} has [plc] role = \"rtu\": --plc-device names the other end of the serial line",
                                options.config)
                  : fmt::format("--plc-device: {} has [plc] role = \"{}\", which has no serial line", options.config,
                                hal::kPlcRoles.at(static_cast<std::size_t>(config.plc.role))));
  const emulator::GaugeFault gauge_fault =
      cli::need(emulator::parse_gauge_fault(options.gauge_fault, config.gauges), cli::kUsage);
  // The emulated scanner is where the line believes it is: after a calibration was applied, there.
  emulator::Cell cell = cell_in_force(config, options.tie_error, options.variation.seed);
  facts.arms = config.arms;
  facts.further = cell.further;
  for (std::size_t arm = 0; arm < config.arms.list.size(); ++arm) {
    const std::string_view backend =
        hal::kScannerBackends.at(static_cast<std::size_t>(config.arm(arm).scanner_backend));
    if (!options.backend.empty() && options.backend != backend)
      cli::stop(cli::kUsage,
                fmt::format("--scanner {}: {} has [scanner] backend = \"{}\", and the daemon accepts no other",
                            options.backend, options.config, backend));
  }
  const emulator::ScannerFailure failure =
      cli::need(parse_failure(options.fail_scanner, config.arms, recipe.stations()), cli::kUsage);
  if (!options.stations.empty()) {
    Result<std::vector<Pose>> points = cli::read_krl_points(options.stations);
    if (points && points.value().size() != recipe.stations())
      points = error(Code::config, "%s: %zu points, the slab has %u stations", options.stations.c_str(),
                     points.value().size(), unsigned{recipe.stations()});
    cell.taught = cli::need(std::move(points), cli::kBadInput);
  }
  const std::vector<emulator::SlabTruth> truths =
      cli::need(cast_slabs(options, recipe, cell, facts.defects, cast_designs(options, config, recipe)), cli::kUsage);

  if (!options.certificate.empty()) {
    std::ofstream file(options.certificate);
    file << calib::master_certificate_text(master_certificate(recipe, truths[0]));
    if (!file.flush())
      cli::stop(cli::kBadInput, fmt::format("--certificate-out: cannot write {}", options.certificate));
  }

  catch_signals();
  const Arms arms = start_arms(options, config, scanner_traits, fault, truths[0]);
  if (options.stand_by) {
    emulator::stand_by({arms.peers, config.arms, recipe, cell, truths}, std::cin, std::cout, stop_requested);
    return cli::kDone;
  }
  std::unique_ptr<emulator::GaugePeer> gauges;
  if (!config.gauges.empty())
    gauges = started(emulator::GaugePeer::start(config.gauges, recipe, gauge_fault, options.variation.seed));
  const auto plc = started(emulator::PlcPeer::connect(plc_traits(config, options), stop_requested));
  facts.peer = plc->peer_name();

  const std::vector<SlabOutcome> outcomes =
      run_line(options, config, recipe, cell, truths, *plc, arms, gauges.get(), failure);
  plc->disable();
  if (options.json) {
    fmt::print("{}", simulation_json(recipe, facts, outcomes));
  } else {
    for (const SlabOutcome& outcome : outcomes) fmt::print("{}", outcome_text(recipe, facts, outcome));
  }
  for (const SlabOutcome& outcome : outcomes)
    if (!outcome.run.finished)
      cli::complain(fmt::format("slab {}: {}", outcome.run.order.slab_no, outcome.run.trouble.text));
  return exit_of(outcomes);
}

}  // namespace
}  // namespace slabd::cli::simulate

namespace slabd::cli {

void add_simulate(args::Command& app) {
  auto options = std::make_shared<simulate::Options>();
  args::Command command = app.add_subcommand(
      "simulate", "Be the rest of the line for a running daemon: PLC, robot and scanner, with known truth");
  command->footer("\nDefects (K = block; repeatable)\n" + emulator::defect_help() +
                  "\nEffects of real concrete, with their usual strengths (pose, offset, tilt, standoff: simulate scan "
                  "only)\n" +
                  emulator::effect_help() +
                  "\nExamples: slabctl simulate --config slabd.toml --slab-no 7 --slab-id S-0007\n"
                  "          slabctl simulate --config slabd.toml --points quarter --defect slope=4:1/36 --json\n"
                  "Exit status: 0 every slab passed, 1 not, 4 daemon or network not reachable.");
  command->add_option("--config", options->config, "The daemon's configuration")->default_val(default_config());
  command->add_option("--slab-no", options->slab_no, "SLAB_NO of the first slab; the following count up")
      ->capture_default_str();
  command->add_option("--slab-id", options->slab_id, "SLAB_ID, at most 32 characters (default SIM-<number>)");
  command->add_option("--slab-type", options->type, "SLAB_TYPE (default: the longest slab there is a recipe for)")
      ->check(args::range(1, 65'535));
  command->add_option("--begin-as", options->begin_as, "SLAB_TYPE that the PLC writes, if it is wrong about the slab")
      ->check(args::range(1, 65'535));
  command->add_option("--mould", options->mould, "MOULD that the PLC sends with every slab (default: 0, unknown)")
      ->check(args::range(1, 65'535));
  command->add_option("--slabs", options->slabs, "How many slabs")
      ->check(args::range(1, 100'000))
      ->capture_default_str();
  command->add_option("--defect", options->defects, "Planted defect name=K:VALUE, repeatable; on every slab")
      ->take_all()
      ->expected(1)
      ->allow_extra_args(false);
  emulator::SlabVariation& variation = options->variation;
  command->add_option("--seed", variation.seed, "Decides everything random")->capture_default_str();
  command->add_option("--casting", variation.casting, "Scatter of the blocks, 1 = a good casting, 0 = as drawn")
      ->check(cli::within(0.0, 10.0))
      ->capture_default_str();
  command->add_option("--placement-mm", variation.placement_mm, "How far the slab lies off [cell], up to +- this")
      ->check(cli::within(0.0, 50.0))
      ->capture_default_str();
  command->add_option("--placement-deg", variation.placement_deg, "How far it is turned, up to +- this")
      ->check(cli::within(0.0, 2.0))
      ->capture_default_str();
  variation.dither_mm = 4.0;
  variation.dither_deg = 1.0;
  command
      ->add_option("--dither-mm", variation.dither_mm, "Stops differ from station to station by up to +- this per axis")
      ->check(cli::within(0.0, 20.0))
      ->capture_default_str();
  command->add_option("--dither-deg", variation.dither_deg, "... and are turned about the block by up to +- this")
      ->check(cli::within(0.0, 5.0))
      ->capture_default_str();
  command
      ->add_option("--robot-length-mm", variation.robot_length_mm,
                   "How smooth that error is: 0 = one wave over the cell; 500 = a large robot, --robot-mm is then the "
                   "standard deviation per axis")
      ->check(cli::within(0.0, 10'000.0))
      ->capture_default_str();
  command->add_option("--cast-by", options->cast_by,
                      "Folder of design sheets by which the slabs are cast, if not the line's: a wrong mould");
  args::Option temperature =
      command->add_option("--slab-temperature", options->temperature_c, "Temperature of the slabs, deg C; they expand")
          ->check(cli::within(kSlabTemperatureMin_c, kSlabTemperatureMax_c));
  command->add_flag("--temperature-unknown", options->temperature_unknown, "The PLC does not send it")
      ->needs(temperature);
  command->add_flag("--same-slab", variation.same_slab, "Every slab is the same one, not touched in between");
  command->add_option("--certificate-out", options->certificate,
                      "Write the first slab's true seats as the certificate of a mastered slab");
  command->add_option("--robot-mm", variation.robot_mm, "Error of the reported flange position, smooth over the cell")
      ->check(cli::within(0.0, 10.0))
      ->capture_default_str();
  command
      ->add_option("--robot-sigma-mm", variation.robot_sigma_mm,
                   "Repeatability: normal error of the reported flange position per axis, new at every station")
      ->check(cli::within(0.0, 10.0))
      ->capture_default_str();
  command
      ->add_option("--robot-sigma-deg", variation.robot_sigma_deg,
                   "Repeatability: normal error of the reported flange rotation per axis, new at every station")
      ->check(cli::within(0.0, 1.0))
      ->capture_default_str();
  command->add_option("--robot-rate-hz", options->robot_rate_hz, "Poses per second")
      ->check(cli::within(10.0, 500.0))
      ->capture_default_str();
  args::Option rsi = command->add_option(
      "--rsi", options->rsi, "Send poses as a KUKA controller does (RSI) to slabd-kuka-bridge at ADDRESS:PORT");
  command->add_option("--rsi-faults", options->rsi_faults, "Share of RSI packets that get lost, come late or garbled")
      ->check(cli::within(0.0, 0.9))
      ->needs(rsi);
  command->add_option("--move-s", options->move_s, "Time from one block to the next")
      ->check(cli::within(0.0, 60.0))
      ->capture_default_str();
  command->add_option("--plc-cycle-ms", options->plc_cycle_ms, "Cycle of the PLC's program: how often it looks")
      ->check(args::range(1, 1'000))
      ->capture_default_str();
  command->add_option("--plc-device", options->plc_device,
                      "With [plc] role = \"rtu\": the other end of the serial line, such as that of a socat pty pair");
  command->add_option("--scans-per-block", options->scans_per_station, "SCAN attempts before a block is left out")
      ->check(args::range(1, 20))
      ->capture_default_str();
  options->scanner.add_to(*command);
  command
      ->add_option("--warm-up-s", options->warming.time_constant_s,
                   "Time constant with which the scanner warms up after the start; it states its temperature. 0: warm")
      ->check(cli::within(0.0, 100'000.0))
      ->capture_default_str();
  command->add_option("--warm-up-K", options->warming.rise_K, "With --warm-up-s: rise of its temperature")
      ->check(cli::within(0.0, 60.0))
      ->capture_default_str();
  command->add_option("--scanner-fault", options->scanner_fault,
                      "Fault of the scanner: frame-before (gives the last frame, then takes one), one-block=K "
                      "(always block K), given-again=K (at station K the exposure before, in another form), loop=N (N "
                      "recorded scans again and again)");
  command->add_option("--fail-scanner", options->fail_scanner,
                      "ID@STATION: this scanner loses its power at this station; the PLC goes on with the other robot "
                      "where [[station]] or allows it");
  command
      ->add_option("--tie-error-mm", options->tie_error.mm,
                   "Two robots: distance of the second one's base from its tied place, in a random direction")
      ->check(cli::within(0.0, 50.0))
      ->capture_default_str();
  command->add_option("--tie-error-deg", options->tie_error.deg, "... and its rotation about a random axis")
      ->check(cli::within(0.0, 2.0))
      ->capture_default_str();
  command->add_option("--gauge-fault", options->gauge_fault,
                      "Fault of a gauge: stuck=NAME (value of the first slab), swapped=NAME,NAME, late=NAME (after "
                      "SLAB_END), unit=NAME (metres), previous=NAME (names the slab before), missing=NAME");
  command->add_option("--scan-format", options->scan_format, "In which format the scanner drops its scans")
      ->check(args::one_of(cli::simulate::scan_format_names()))
      ->capture_default_str();
  command->add_option(
      "--stations", options->stations,
      "Drive to these points (KRL, as slabctl stations writes them) instead of straight above each block");
  command->add_option("--scanner", options->backend, "How scans are delivered (default: as configured)")
      ->check(args::one_of({"drop", "tcp"}));
  command->add_flag("--json", options->json, "Print slabd.simulation/1 on stdout");
  command->add_flag("--stand-by", options->stand_by,
                    "Robot and scanner only, for another PLC: orders \"slab N\" and \"station K [ROBOT]\" on stdin");
  command->require_subcommand(0, 1);
  cli::simulate::add_simulate_scan(*command);
  cli::simulate::add_simulate_plane(*command);
  cli::simulate::add_simulate_calibration(*command);
  cli::simulate::add_simulate_history(*command);
  cli::simulate::add_simulate_tie(*command);
  command->runs([options] { return simulate::simulate(*options); });
}

}  // namespace slabd::cli
