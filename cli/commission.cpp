// SPDX-License-Identifier: Apache-2.0
//
// slabctl commission: the steps from a bare computer to the first judged slab, each with its check. It changes nothing.
#include <fmt/core.h>

#include <algorithm>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>
#include <vector>

#include "cli/client/arms.h"
#include "cli/client/calibration_change.h"
#include "cli/client/control.h"
#include "cli/client/record_options.h"
#include "cli/command.h"
#include "cli/exit.h"
#include "cli/terminal/arguments.h"
#include "cli/terminal/document.h"
#include "cli/terminal/render.h"
#include "cli/terminal/say.h"
#include "report/json.h"
#include "storage/storage.h"

namespace slabd::cli {
namespace {

using report::Language;

/// note: the line runs without it, with a larger U or without a check.
enum class StepState : std::uint8_t { done, note, open };
std::string_view name(StepState state) {
  switch (state) {
    case StepState::done: return marked("done");
    case StepState::note: return marked("note");
    case StepState::open: return marked("open");
  }
  return "open";
}

/// Texts of a step.
struct StepText {
  const char* name;
  const char* name_zh;
  const char* check;  ///< when it is done
  const char* check_zh;
  const char* command;  ///< the next thing to do
};

constexpr StepText kSteps[] = {
    {"Configuration", "配置", "slabd reads its configuration without an error", "配置文件无错误",
     "slabctl config check"},
    {"Recipes", "配方", "there is a recipe of every slab type, and each of its numbers is confirmed with the drawing",
     "每种板型都有配方，每个数值都已按图纸确认", "slabctl recipe check FILE"},
    {"Daemon", "守护进程", "slabd runs and has no fault of its own", "slabd 正在运行，自身无故障",
     "systemctl enable --now slabd"},
    {"PLC", "PLC", "the PLC's heartbeat changes; without a PLC program, commands by hand",
     "PLC 心跳在变化；没有 PLC 程序时可手动发命令", "slabctl plc monitor"},
    {"Robot", "机器人", "poses arrive and are accepted", "收到位姿且被接受", "slabctl robot monitor"},
    {"Scanner", "扫描仪", "the scanner is connected; it takes one scan on request", "扫描仪已连接，按要求扫描一次",
     "slabctl doctor --scan"},
    {"Acceptance of the scanner", "扫描仪验收",
     "plate and ball were measured within the limits, and the record is in force", "平板和标准球测量合格，记录已生效",
     "slabctl scanner verify --plate ... --ball ... --diameter-mm D --apply"},
    {"Hand-eye calibration", "手眼标定", "a calibration is in force; not only the configuration's value",
     "标定结果已生效，不是只用配置中的数值", "slabctl calibrate new NAME --kind ball --radius MM --robot-sigma-mm MM"},
    {"Stations", "检测位", "18 stops are taught, and each block is in view", "18 个检测位已示教，每个承轨台都在视野内",
     "slabctl stations"},
    {"Station corrections", "检测位修正", "a mastered slab has given the corrections of each slab type",
     "已用标准板求得每种板型的修正",
     "slabctl calibrate stations --certificate FILE --slabs KEYS --apply, or [robot] absolute_sigma_mm and _deg"},
    {"Daily check", "日常检查", "a reference block or a monitor ball is in use", "已启用标准承轨台或监控球",
     "slabctl calibrate reference --certificate FILE --apply"},
    {"First slab", "第一块板", "a slab has a verdict", "有一块板已有结论",
     "slabctl plc command SLAB_BEGIN --slab-no 1 --slab-type TYPE, SCAN 1 to 18, SLAB_END; or the PLC; or slabctl "
     "simulate"},
};
enum StepNumber : std::size_t {
  kConfiguration,
  kRecipes,
  kDaemon,
  kPlc,
  kRobot,
  kScanner,
  kAcceptance,
  kHandEye,
  kStations,
  kCorrections,
  kDailyCheck,
  kFirstSlab,
  kStepCount
};
static_assert(std::size(kSteps) == kStepCount);

struct Step {
  StepState state = StepState::open;
  std::string saw;
};
using Steps = std::array<Step, kStepCount>;

void look_at_recipes(const config::Config& config, Steps& steps, std::vector<std::uint16_t>& types) {
  std::vector<Recipe> recipes;
  std::vector<config::Problem> problems;
  config::load_recipes(config.recipes_dir, recipes, problems, nullptr, nullptr, &config.gauges);
  Step& step = steps[kRecipes];
  step.saw.clear();
  if (!problems.empty()) {
    step.saw = quote(problems.front().text);
    return;
  }
  int unconfirmed = 0;
  for (const Recipe& recipe : recipes) {
    types.push_back(recipe.slab_type);
    step.saw += (step.saw.empty() ? "" : ", ") + std::string(recipe.name.view());
    unconfirmed += unconfirmed_count(recipe);
  }
  step.state = recipes.empty() ? StepState::open : unconfirmed == 0 ? StepState::done : StepState::note;
  if (recipes.empty()) step.saw = say("{} has no recipe", config.recipes_dir);
  if (unconfirmed > 0) step.saw += say("; {} numbers are not confirmed", unconfirmed);
}

/// The robots, or the scanners, of a line: the step is done if `ok` is true in the status of each. `saw`: what is seen
/// then.
Step look_at_parts(const std::vector<ArmStatus<nlohmann::json>>& arms, bool robots, const std::string& saw) {
  const auto link = [&](const ArmStatus<nlohmann::json>& arm) -> const nlohmann::json& {
    return robots ? arm.pose : arm.scanner_link;
  };
  for (const ArmStatus<nlohmann::json>& arm : arms) {
    const nlohmann::json& state = link(arm);
    if (state.is_object() && state.value(robots ? "ok" : "online", false)) continue;
    const std::string why = state.is_object() ? state.value("text", std::string()) : std::string();
    const std::string text = why.empty() ? say("not connected") : quote(why);
    const std::string& id = robots ? arm.robot : arm.scanner;
    return {StepState::open, id.empty() ? text : say("{}: {}", id, text)};
  }
  return {StepState::done, saw};
}

void look_at_links(const config::Config& config, Steps& steps) {
  const Result<std::string> answer = ask_daemon(config.control_socket, "{\"verb\":\"status\"}\n");
  if (!answer) {
    steps[kDaemon].saw = quote(answer.error().text.view());
    for (const std::size_t k : {kPlc, kRobot, kScanner}) steps[k].saw = say("slabd does not run");
    return;
  }
  const nlohmann::json status = nlohmann::json::parse(answer.value(), nullptr, false);
  if (!status.is_object()) {
    steps[kDaemon].saw = say("{} does not answer with slabd.status/1", config.control_socket);
    for (const std::size_t k : {kPlc, kRobot, kScanner}) steps[k].saw = say("slabd gives no status");
    return;
  }
  const auto text = [&](const char* pointer) {
    return status.value(nlohmann::json::json_pointer(pointer), std::string());
  };
  const auto is = [&](const char* pointer) { return status.value(nlohmann::json::json_pointer(pointer), false); };
  const int fault = status.value(nlohmann::json::json_pointer("/fault/code"), 0);
  // Faults of a missing calibration belong to a later step.
  const bool own_fault = fault != 0 && fault != static_cast<int>(Code::calibration_missing);
  steps[kDaemon] = {own_fault ? StepState::open : StepState::done,
                    own_fault ? say("fault {}: {}; {}", fault, code_text(static_cast<Code>(fault), text("/fault/text")),
                                    code_cure(static_cast<Code>(fault), text("/fault/cure")))
                              : text("/software")};
  steps[kPlc] = {is("/links/plc/alive") ? StepState::done : StepState::note,
                 is("/links/plc/alive") ? say("heartbeat changes") : say("no heartbeat")};
  const std::vector<ArmStatus<nlohmann::json>> arms = arms_in(status);
  steps[kRobot] = look_at_parts(arms, true, say("poses are accepted"));
  steps[kScanner] = look_at_parts(arms, false, say("connected"));
}

void look_at_scanner(storage::Reader& reader, const config::Config& config, std::span<const std::uint16_t> types,
                     Steps& steps) {
  const auto line = need(reader.line_calibration(config.by.scanner.view()), kNotReachable);
  const std::int64_t now_us = wall_clock_us();
  const bool applied = line->source == LineCalibration::Source::applied;
  const bool expired = fault_of(*line, now_us) == CalibrationFault::expired;
  steps[kHandEye] = {applied && !expired ? StepState::done : StepState::open,
                     expired                          ? say("{} has expired", line->id.view())
                     : applied                        ? std::string(line->id.view())
                     : !config.calibration.id.empty() ? say("only the configuration's T_flange_scanner")
                                                      : say("none")};
  const bool accepted = !line->scanner.id.empty() && !line->scanner.failed;
  steps[kAcceptance] = {
      accepted ? StepState::done : StepState::note,
      accepted ? std::string(line->scanner.id.view()) : say("none: U takes the recipe's specification")};
  std::string without;
  std::string unused;
  for (const std::uint16_t type : types) {
    const StationsInForce* table = line->table_for(type);
    const std::string_view why = table == nullptr ? "" : why_unused(*table, line->id, now_us);
    if (table != nullptr && why.empty()) continue;
    without += fmt::format("{}{}", without.empty() ? "" : ", ", type);
    if (table != nullptr) unused += "; " + say("{} is {}", table->id.view(), translated(why));
  }
  // Without both, U of a seat's place and slope is unknown, and a value without U never passes.
  const bool robot_stated = applied ? has_value(config.splice.absolute_mm) && has_value(config.splice.absolute_rad)
                                    : has_value(config.splice.commissioning_mm);
  steps[kCorrections] = {without.empty() && !types.empty() ? StepState::done
                         : robot_stated                    ? StepState::note
                                                           : StepState::open,
                         without.empty() ? say("of every slab type") : say("none for type {}", without) + unused};
  if (steps[kCorrections].state == StepState::open)
    steps[kCorrections].saw +=
        applied ? say("; [robot] absolute_sigma_mm and absolute_sigma_deg are not stated either: no seat can pass")
                : say("; [calibration] station_sigma_mm and station_sigma_deg are not stated either: no seat can pass");
  const bool checked = !line->block.reference_id.empty() || !line->ball.reference_id.empty();
  if (line->block.failed || line->ball.failed) {
    const LineCalibration::Watch& watch = line->block.failed ? line->block : line->ball;
    const std::string note = quote(watch.note.view());
    steps[kDailyCheck] = {StepState::open,
                          watch.reference_id.empty() ? note : say("{}: {}", watch.reference_id.view(), note)};
    return;
  }
  steps[kDailyCheck] = {
      checked ? StepState::done : StepState::note,
      checked ? std::string((line->block.reference_id.empty() ? line->ball : line->block).reference_id.view())
              : say("no reference is in use")};
}

/// The steps of every scanner: each is as far as with the scanner that is least far.
void look_at_calibration(storage::Reader& reader, const config::Config& config, std::span<const std::uint16_t> types,
                         Steps& steps) {
  if (!config.arms.several()) return look_at_scanner(reader, config, types, steps);
  for (std::size_t arm = 0; arm < config.arms.list.size(); ++arm) {
    const std::string scanner = scanner_of_arm(config, arm);
    Steps own = steps;
    look_at_scanner(reader, ScannerChoice{scanner}.of(config), types, own);
    for (const std::size_t step : {kHandEye, kAcceptance, kCorrections, kDailyCheck}) {
      const std::string saw = say("scanner {}", scanner) + ": " + own[step].saw;
      if (arm == 0) {
        steps[step] = {own[step].state, saw};
        continue;
      }
      steps[step].saw += ", " + saw;
      steps[step].state = std::max(steps[step].state, own[step].state);  // `open` is the last one
    }
  }
  const auto cell = need(reader.cell_calibration(config.arms), kNotReachable);
  const TieFault fault = fault_of_tie(*cell, config.arms.list[1].robot, wall_clock_us());
  steps[kHandEye].saw +=
      ", " + (fault == TieFault::none ? std::string(cell->tie.id.view()) : quote(describe(fault, *cell).view()));
  if (fault != TieFault::none) steps[kHandEye].state = StepState::open;
}

void look_at_slabs(storage::Reader& reader, Steps& steps) {
  const auto slabs = need(reader.slabs(100), kNotReachable);
  const auto seen = std::find_if(slabs.begin(), slabs.end(), [](const storage::SlabSummary& slab) {
    return slab.verdict == Verdict::pass || slab.verdict == Verdict::fail || slab.verdict == Verdict::indeterminate;
  });
  steps[kFirstSlab].saw = slabs.empty() ? say("no slab yet") : say("no slab with a verdict among the last 100");
  steps[kStations].saw = say("known when a slab has a verdict");
  steps[kStations].state = StepState::note;
  if (seen == slabs.end()) return;
  const std::string_view verdict = verdict_name(seen->verdict);
  const std::string which = seen->header.emulated != 0
                                ? say("slab {}: {}, of an emulated line", seen->header.slab_no, verdict)
                                : say("slab {}: {}", seen->header.slab_no, verdict);
  steps[kFirstSlab] = {StepState::done, which};
  const bool all = seen->stations_measured == seen->header.stations;
  steps[kStations] = {all ? StepState::done : StepState::note,
                      all ? say("every block was measured")
                          : say("{} of {} blocks were measured", seen->stations_measured, seen->header.stations)};
}

Steps look(const std::string& config_path) {
  Steps steps;
  for (Step& step : steps) step.saw = say("needs the configuration first");
  config::Config config;
  std::vector<config::Problem> problems;
  config::load_config(config_path, config, problems);
  if (!problems.empty()) {
    steps[kConfiguration].saw = quote(problems.front().text);
    return steps;
  }
  steps[kConfiguration] = {StepState::done, config_path};
  std::vector<std::uint16_t> types;
  look_at_recipes(config, steps, types);
  look_at_links(config, steps);
  if (storage::is_unused(config.storage.db_path)) {
    for (const std::size_t k : {kAcceptance, kHandEye, kStations, kCorrections, kDailyCheck, kFirstSlab})
      steps[k].saw = say("the database does not exist yet; slabd makes it");
    return steps;
  }
  const auto reader = need(storage::open_reader(config.storage.db_path), kNotReachable);
  look_at_calibration(*reader, config, types, steps);
  look_at_slabs(*reader, steps);
  return steps;
}

/// The first open step; kStepCount if there is none.
std::size_t next_of(const Steps& steps) {
  return static_cast<std::size_t>(
      std::find_if(steps.begin(), steps.end(), [](const Step& s) { return s.state == StepState::open; }) -
      steps.begin());
}

report::Report checklist(const Steps& steps, Language language) {
  const bool zh = language == Language::zh;
  report::Report made;
  made.language = language;
  made.title = zh ? "调试检查表" : "Commissioning checklist";
  made.subject = zh ? "slabd 轨道板检测" : "slabd, inspection of track slabs";
  made.judged = false;
  report::Section& section = made.sections.emplace_back();
  section.title = zh ? "步骤" : "Steps";
  report::Table table = zh ? report::Table{"序号", "步骤<", "完成条件<", "状态<", "日期<", "签名<"}
                           : report::Table{"no", "step<", "done when<", "state<", "date<", "signature<"};
  for (std::size_t k = 0; k < kStepCount; ++k) {
    const StepText& text = kSteps[k];
    const char* const state = steps[k].state == StepState::done   ? (zh ? "完成" : "done")
                              : steps[k].state == StepState::note ? (zh ? "可运行" : "may run")
                                                                  : (zh ? "未完成" : "open");
    table.add(k + 1, zh ? text.name_zh : text.name, zh ? text.check_zh : text.check, state, "________", "____________");
  }
  section.parts.emplace_back(std::move(table));
  return made;
}

struct Options {
  std::string config;
  bool json = false;
  DocumentOptions document;
};

int commission(const Options& options) {
  options.document.check();
  set_language(options.document.language, options.json);
  const Steps steps = look(options.config);
  const std::size_t next = next_of(steps);
  options.document.write(checklist(steps, options.document.wanted()));
  if (options.json) {
    report::Json json("slabd.commission/1");
    json.field("next", next == kStepCount ? 0 : next + 1).key("steps").begin_array();
    for (std::size_t k = 0; k < kStepCount; ++k)
      json.begin_object()
          .field("step", k + 1)
          .field("name", kSteps[k].name)
          .field("state", steps[k].state)
          .field("saw", steps[k].saw)
          .field("command", kSteps[k].command)
          .end_object();
    json.end_array();
    fmt::print("{}", json.text());
  } else {
    const bool zh = language_in_use() == Language::zh;
    const auto title = [&](std::size_t k) { return zh ? kSteps[k].name_zh : kSteps[k].name; };
    report::Table table{say("number"), say("state<"), say("step<"), say("what is there<")};
    for (std::size_t k = 0; k < kStepCount; ++k)
      table.add(k + 1, k == next ? say("next") : std::string(translated(name(steps[k].state))), title(k), steps[k].saw);
    fmt::print("{}", report::text_of(table, style_for(stdout)));
    if (next == kStepCount)
      fmt::print("{}", say("\nThe line is commissioned. A note names what would make it more accurate or safer.\n"));
    else
      fmt::print("{}", say("\nNext: {}: {}\n  {}\n", title(next), zh ? kSteps[next].check_zh : kSteps[next].check,
                           kSteps[next].command));
  }
  return next == kStepCount ? kDone : kNotPass;
}

}  // namespace

void add_commission(args::Command& app) {
  auto options = std::make_shared<Options>();
  args::Command command =
      app.add_subcommand("commission", "The next step from a bare computer to the first judged slab");
  command->footer(
      "\nChecks twelve steps and changes nothing. A step with a note does not stop the line.\nExit status 0 when every "
      "step is done or has a note, 1 while one is open.\nExamples:\n  slabctl commission\n  slabctl commission --out "
      "checklist.pdf --language zh");
  command->add_option("--config", options->config, "The daemon's configuration")->default_val(default_config());
  command->add_flag("--json", options->json, "slabd.commission/1");
  options->document.add_to(*command);
  command->runs([options] { return commission(*options); });
}

}  // namespace slabd::cli
