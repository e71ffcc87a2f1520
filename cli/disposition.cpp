// SPDX-License-Identifier: Apache-2.0
//
// slabctl disposition: what quality decided about a slab that did not pass. The measured verdict never changes.
#include <fmt/core.h>

#include <memory>

#include "cli/client/calibration_change.h"
#include "cli/client/record_options.h"
#include "cli/command.h"
#include "cli/database.h"
#include "cli/exit.h"
#include "cli/slab_choice.h"
#include "cli/terminal/arguments.h"
#include "cli/terminal/document.h"
#include "cli/terminal/parse.h"
#include "cli/terminal/render.h"
#include "cli/terminal/say.h"
#include "report/json.h"
#include "report/slab_view.h"

namespace slabd::cli {
namespace {

struct Options {
  std::string config;
  std::string slab;
  std::string decision;
  storage::DispositionRecord record;
  LanguageOption language;
};

/// A decision cannot be taken back, so a number that names two slabs names none.
void refuse_two_slabs(storage::Reader& reader, const std::string& wanted, const SlabHeader& slab) {
  const report::SlabName name = report::slab_name(wanted);
  if (!name.key || wanted.find_first_not_of("0123456789") != std::string::npos || *name.key != slab.key) return;
  const auto others = need(reader.find_no(static_cast<std::uint32_t>(*name.key)), kNotReachable);
  if (others.empty() || slab.slab_no == static_cast<std::uint32_t>(*name.key)) return;
  stop(kBadInput, say("{} is the key of slab {} and the SLAB_NO of slab {}: name it as key:{} or no:{}", wanted,
                      quote(slab.slab_id.view()), others.front(), wanted, wanted));
}

int decide(Options options) {
  set_language(options.language, false);
  const config::Config config = config_from(options.config);
  DatabaseOptions database;
  database.db = config.storage.db_path;
  const auto reader = open_database(database);
  const storage::SlabSummary slab = named_slab(*reader, options.slab).summary;
  refuse_two_slabs(*reader, options.slab, slab.header);
  storage::DispositionRecord& record = options.record;
  record.slab_key = slab.header.key;
  record.decision = disposition_named(options.decision).value_or(Disposition::none);
  record.utime_us = wall_clock_us();
  if (record.who.empty()) record.who = default_operator();
  const Result<ChangeAnswer> answer = change_calibration(config, storage::KeepDisposition{record});
  if (!answer.ok())
    stop(answer.error().code == Code::config ? kRefused : kNotReachable, quote(answer.error().text.view()));
  fmt::print("{}", say("{}: SLAB_ID {}, SLAB_NO {} (measured: {}, which stays)\n", answer.value().id,
                       quote(slab.header.slab_id.view()), slab.header.slab_no, verdict_name(slab.verdict)));
  return kDone;
}

}  // namespace

void add_disposition(args::Command& app) {
  auto options = std::make_shared<Options>();
  args::Command command =
      app.add_subcommand("disposition", "Record what quality decided about a slab that did not pass");
  command->footer(
      "\nDecisions are only added; the last one is in force. Verdict and values stay what was measured.\n"
      "Example: slabctl disposition SLAB-0042 --decision rework --reason \"burr at block 4\" --authority \"Li Wei\"");
  command->add_option("SLAB", options->slab, "Key, SLAB_ID or SLAB_NO")->required();
  command->add_option("--decision", options->decision, "Decision about the slab")
      ->required()
      ->check(args::one_of({"hold", "release_by_concession", "rework", "scrap", "re_inspect"}));
  command->add_option("--reason", options->record.reason, "Why")->required()->check(some_words());
  command->add_option("--authority", options->record.authority, "Name of the person who decided")
      ->required()
      ->check(some_words());
  command->add_option("--second", options->record.second, "The second person ([quality] second_person asks for one)");
  command->add_option("--operator", options->record.who, "Name of the person who enters it (default: your login)");
  command->add_option("--config", options->config, "Configuration")->default_val(default_config());
  options->language.add_to(*command, "Language of the answer");
  command->runs([options] { return decide(*options); });
}

}  // namespace slabd::cli
