// SPDX-License-Identifier: Apache-2.0
//
// slabctl design check, design show: design sheets of curve slabs and special slabs.
#include <fmt/core.h>

#include <map>
#include <memory>

#include "cli/command.h"
#include "cli/database.h"
#include "cli/exit.h"
#include "cli/slab_choice.h"
#include "cli/terminal/arguments.h"
#include "cli/terminal/document.h"
#include "cli/terminal/parse.h"
#include "cli/terminal/say.h"
#include "config/designs.h"
#include "report/json.h"

namespace slabd::cli {
namespace {

struct Options {
  std::vector<std::string> files;
  std::string slab;
  DatabaseOptions database;
  TableOutput output;
};

int check_designs(const std::vector<std::string>& files) {
  config::DesignSet set;
  std::map<std::string, std::string> file_of;
  for (const std::string& file : files) {
    const std::size_t slabs = set.sheets.size();
    const std::size_t problems = set.problems.size();
    config::load_design_file(file, set);
    for (std::size_t i = slabs; i < set.sheets.size(); ++i)
      if (const auto [known, is_new] = file_of.emplace(set.sheets[i].slab_id.view(), file); !is_new)
        set.problems.push_back(
            {fmt::format("{}:1:1: slab {} has a sheet in {} too; allowed is one", file, known->first, known->second)});
    if (set.problems.size() == problems) fmt::print("{}", say("{}: good, {} slabs\n", file, set.sheets.size() - slabs));
  }
  return report_problems(set.problems) ? kDone : kBadInput;
}

int show_design(const Options& options) {
  const auto reader = open_database(options.database);
  const SlabHeader header = named_slab(*reader, options.slab).summary.header;
  const SlabDesign design = facts_of(header).design;
  report::Table table{{"slab_id<", "slab_id"},     {"slab_type", "slab_type"}, {"station", "station"},
                      {"dx mm", "dx_mm"},          {"dy mm", "dy_mm"},         {"dz mm", "dz_mm"},
                      {"dslope deg", "dslope_deg"}};
  for (int station = 1; design.given && station <= header.stations; ++station) {
    const SeatDesign& seat = design.at(station);
    table.add(header.slab_id, header.slab_type, station, report::Cell(seat.offset_mm.x(), 3),
              report::Cell(seat.offset_mm.y(), 3), report::Cell(seat.offset_mm.z(), 3),
              report::Cell(deg_from_rad(seat.slope_rad), 4));
  }
  if (!options.output.json && !options.output.csv && !options.output.html)
    fmt::print("{}", design.given ? say("design sheet {}\n", header.design_sha256.view())
                                  : say("no design sheet: the slab is as recipe {} says\n", header.recipe.view()));
  report::Json json("slabd.design/1");
  json.field("slab_id", header.slab_id).field("key", header.key).field("sha256", header.design_sha256);
  if (design.given || options.output.json || options.output.csv) options.output.print(table, json, "seats");
  return kDone;
}

}  // namespace

void add_design(args::Command& app) {
  auto options = std::make_shared<Options>();
  args::Command design = app.add_subcommand("design", "Design sheets of curve slabs and special slabs");
  design->require_subcommand(1);
  args::Command check = design->add_subcommand("check", "Name every fault of design sheets");
  check->footer("\nExample: slabctl design check order-117.csv");
  check
      ->add_option("FILE", options->files,
                   "Files with the columns slab_id,slab_type,station,dx_mm,dy_mm,dz_mm,dslope_deg")
      ->required();
  check->runs([options] { return check_designs(options->files); });
  args::Command show = design->add_subcommand("show", "The design that a slab was begun with");
  show->footer("\nThe CSV is a design sheet.\nExample: slabctl design show SLAB-0042 --csv > SLAB-0042.csv");
  show->add_option("SLAB", options->slab, "Key, SLAB_ID or SLAB_NO")->required();
  options->database.add_to(*show);
  options->output.add_to(*show, "slabd.design/1");
  show->runs([options] { return show_design(*options); });
}

}  // namespace slabd::cli
