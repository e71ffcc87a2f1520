// SPDX-License-Identifier: Apache-2.0
#include <fmt/format.h>

#include <algorithm>
#include <cctype>
#include <charconv>
#include <cmath>
#include <filesystem>
#include <map>
#include <optional>

#include "config/config.h"
#include "config/recipe_parts.h"
#include "config/toml_reader.h"

/// Reads recipes/*.toml into Recipe. A recipe determines verdicts, so an incomplete one is rejected: it must contain
/// every nominal and every item. `confirmed` is true if a person has compared the value with the drawing. In the file
/// angles are in degrees (`_deg`) and slopes may be ratios ("1:40"); internally geometry is mm and rad.
namespace slabd::config {
namespace {

/// Angle in degrees of a slope such as "1:40".
std::optional<double> degrees_from_ratio(const TomlValue& value) {
  if (value.kind != TomlValue::Kind::text || !value.text.starts_with("1:")) return std::nullopt;
  const std::string run = value.text.substr(2);
  char* end = nullptr;
  const double n = std::strtod(run.c_str(), &end);
  const bool plain = !run.empty() && run.find_first_not_of("0123456789.") == std::string::npos;
  if (!plain || end != run.c_str() + run.size() || !(n >= 1.0 && n <= 10'000.0)) return std::nullopt;
  return deg_from_rad(std::atan(1.0 / n));
}

/// Reads `{ value = 1.0, confirmed = false }`, optionally with `source`.
void read_nominal(TableReader& table, std::string_view key, Nominal& out, Allowed allowed) {
  const TomlValue* v = table.value(key);
  const std::string expected =
      fmt::format("{{ value = {}..{}, confirmed = true or false }}", allowed.low, allowed.high);
  if (v == nullptr) return table.missing(key, expected);
  if (v->kind != TomlValue::Kind::table)
    return table.problem_at(*v, key, fmt::format("found {}, allowed is {}", found(*v), expected));
  TableReader nominal = table.table(key);
  nominal.required_number("value", out.value, allowed);
  nominal.required_boolean("confirmed", out.confirmed);
  std::string source;  // for people: where a draft has the number from (slabctl recipe from-cad)
  nominal.optional_text("source", source, 400);
  nominal.finish();
}

/// Reads `{ value = [-10, 50], confirmed = false }`.
void read_range(TableReader& table, std::string_view key, Nominal& low, Nominal& high, Allowed allowed) {
  const TomlValue* v = table.value(key);
  const std::string expected =
      fmt::format("{{ value = [low, high] within {}..{}, confirmed = true or false }}", allowed.low, allowed.high);
  if (v == nullptr) return table.missing(key, expected);
  const auto refuse = [&](const TomlValue& at) {
    table.problem_at(at, key, fmt::format("found {}, allowed is {}", found(at), expected));
  };
  if (v->kind != TomlValue::Kind::table) return refuse(*v);
  TableReader range = table.table(key);
  const TomlValue* pair = range.value("value");
  if (pair == nullptr) {
    range.missing("value", "[low, high]");
  } else {
    const bool is_pair = pair->kind == TomlValue::Kind::array && pair->items.size() == 2;
    const std::optional<double> first = is_pair ? as_number(pair->items[0]) : std::nullopt;
    const std::optional<double> second = is_pair ? as_number(pair->items[1]) : std::nullopt;
    if (!first || !second || !(allowed.low <= *first && *first < *second && *second <= allowed.high))
      refuse(*pair);
    else
      low.value = *first, high.value = *second;
  }
  range.required_boolean("confirmed", low.confirmed);
  high.confirmed = low.confirmed;
  range.finish();
}

void read_nominal_deg(TableReader& table, std::string_view key, Nominal& out_rad, Allowed allowed_deg) {
  Nominal angle_deg;
  read_nominal(table, key, angle_deg, allowed_deg);
  doubt_degrees(table, key, angle_deg.value, allowed_deg);
  out_rad = {rad_from_deg(angle_deg.value), angle_deg.confirmed};
}

/// Fills the tables of a recipe; every fault is a problem of its table.
class Reading {
 public:
  explicit Reading(TableReader& root) : root_(root) {}
  ~Reading() { finish(); }
  Reading(const Reading&) = delete;
  Reading& operator=(const Reading&) = delete;

  void table(const char* name) {
    finish();
    now_.emplace(root_.table(name));
  }
  /// Begins an optional table.
  void table(const char* name, bool& given) {
    table(name);
    given = now_->present();
    if (!given) now_.reset();
  }
  void nominal(const char* key, Nominal& out, Allowed allowed) {
    if (now_) read_nominal(*now_, key, out, allowed);
  }
  void degrees(const char* key, Nominal& out_rad, Allowed allowed_deg) {
    if (now_) read_nominal_deg(*now_, key, out_rad, allowed_deg);
  }
  void range(const char* key, Nominal& low, Nominal& high, Allowed allowed) {
    if (now_) read_range(*now_, key, low, high, allowed);
  }
  void number(const char* key, double& out, Allowed allowed) { now_->required_number(key, out, allowed); }
  void optional(const char* key, double& out, Allowed allowed) { now_->optional_number(key, out, allowed); }
  void angle(const char* key, double& out_rad, Allowed allowed_deg) {
    double angle_deg = kNoValue;
    now_->required_number(key, angle_deg, allowed_deg);
    doubt_degrees(*now_, key, angle_deg, allowed_deg);
    out_rad = rad_from_deg(angle_deg);
  }
  template <typename Whole>
  void whole(const char* key, Whole& out, std::int64_t low, std::int64_t high) {
    std::int64_t read = 0;
    now_->required_integer(key, read, low, high);
    out = static_cast<Whole>(read);
  }
  template <typename Word>
  void word(const char* key, Word& out, const std::vector<std::string_view>& words) {
    auto index = static_cast<std::size_t>(out);
    now_->optional_word(key, index, words);
    out = static_cast<Word>(index);
  }

 private:
  void finish() {
    if (now_) now_->finish();
  }

  TableReader& root_;
  std::optional<TableReader> now_;
};

// ---- items ------------------------------------------------------------------------------------------------------

/// Reads a number in the item's unit; degrees may also be written as a slope "1:n".
std::optional<double> read_limit(TableReader& item, std::string_view key, const TomlValue& v, const ItemInfo& info) {
  if (const std::optional<double> number = as_number(v); number && std::isfinite(*number) && std::abs(*number) <= 1e5)
    return number;
  if (info.unit == ItemUnit::deg)
    if (const std::optional<double> degrees = degrees_from_ratio(v)) return degrees;
  item.problem_at(v, key,
                  fmt::format("found {}, allowed is a number of {} within +-100000{}", found(v), name(info.unit),
                              info.unit == ItemUnit::deg ? " or a slope \"1:n\" with n 1..10000" : ""));
  return std::nullopt;
}

/// Reads a nominal. `nominal = 380` has the confirmation of its limits; `nominal = { value = 380, confirmed = true }`
/// has its own.
void read_item_nominal(TableReader& item, const ItemInfo& info, Tolerance& out) {
  const TomlValue* v = item.value("nominal");
  if (v == nullptr) return;
  out.nominal.confirmed = out.confirmed;
  if (v->kind != TomlValue::Kind::table) {
    out.nominal.value = read_limit(item, "nominal", *v, info).value_or(kNoValue);
    return;
  }
  TableReader nominal = item.table("nominal");
  if (const TomlValue* value = nominal.value("value"); value != nullptr)
    out.nominal.value = read_limit(nominal, "value", *value, info).value_or(kNoValue);
  else
    nominal.missing("value", fmt::format("a number of {}", name(info.unit)));
  nominal.required_boolean("confirmed", out.nominal.confirmed);
  nominal.finish();
}

/// Reads either `tolerance` (nominal +- tolerance) or `lower` and / or `upper`, absolute.
void read_limits(TableReader& item, const ItemInfo& info, Tolerance& out) {
  const TomlValue* lower = item.value("lower");
  const TomlValue* upper = item.value("upper");
  const TomlValue* tolerance = item.value("tolerance");
  if (tolerance != nullptr) {
    if (lower != nullptr || upper != nullptr)
      return item.problem("tolerance",
                          "found together with lower or upper; allowed is either tolerance or lower and upper");
    double half = kNoValue;
    item.optional_number("tolerance", half, {1e-6, 1e5});
    out.lower = out.nominal.value - half;
    out.upper = out.nominal.value + half;
    return;
  }
  if (lower != nullptr) out.lower = read_limit(item, "lower", *lower, info).value_or(kNoValue);
  if (upper != nullptr) out.upper = read_limit(item, "upper", *upper, info).value_or(kNoValue);
  if (has_value(out.lower) && has_value(out.upper) && !(out.lower < out.upper))
    item.problem("lower",
                 fmt::format("found {:.6g} with upper {:.6g}, allowed is lower < upper", out.lower, out.upper));
}

/// Rejects limits of an item without a REASON. Such an item is information; a block failed by it would have no reason.
void refuse_judging(TableReader& item, const Tolerance& t) {
  for (const char* key : {"lower", "upper", "tolerance"})
    if (item.has(key))
      item.problem(key,
                   "found a limit of an item that is information and never judged; leave it out, seat_flatness is "
                   "the item that judges the seat's surface");
  if (t.required)
    item.problem("required", "found true for an item that is information and never judged; allowed is false");
}

/// Reads limits of depth and share, in addition to the diameter's. Their confirmation is the item's.
void read_pore_limits(TableReader& item, PoreLimits& out) {
  item.optional_number("depth_max_mm", out.depth_max_mm, {0.5, 50.0});
  item.optional_number("share_max", out.share_max, {1e-4, 1.0});
  for (const char* key : {"depth_max_mm", "share_max"})
    if (item.has(key) && !item.has("upper"))
      item.problem(key, "found without upper; allowed is a limit next to that of the largest diameter");
}

/// Reads `formula = "mean(length_left, length_right)"` of an item that gauges measure.
void read_formula(TableReader& item, GaugeFormula& out) {
  std::string text;
  item.required_text("formula", text, FormulaText::capacity());
  const TomlValue* const at = item.value("formula");
  if (at == nullptr || text.empty()) return;
  const Result<GaugeFormula> formula = parse_formula(text);
  if (!formula.ok()) return item.problem("formula", fmt::format("found \"{}\": {}", text, formula.error().text.view()));
  out = formula.value();
  out.line = at->line;
  if (item.has("U"))
    item.problem("U", "found U of an item that gauges measure; leave it out: U follows from [[gauge]] u and master");
}

/// `is_size`: no value is too small.
void read_item(TableReader item, const ItemInfo& info, bool is_size, Tolerance& out) {
  item.required_boolean("required", out.required);
  item.optional_boolean("confirmed", out.confirmed);
  read_item_nominal(item, info, out);
  read_limits(item, info, out);
  item.optional_number("U", out.U, {1e-6, 1e3});
  if (info.reason < 0) {
    refuse_judging(item, out);
    return item.finish();
  }
  const bool limited = item.has("lower") || item.has("upper") || item.has("tolerance");
  if (limited && !item.has("nominal")) item.missing("nominal", "the value that deviations are counted from");
  if (limited && !item.has("tolerance")) {
    if (!item.has("upper")) item.missing("upper", "a limit: without it any value above would pass");
    if (!item.has("lower") && !is_size) item.missing("lower", "a limit: without it any value below would pass");
  }
  if (out.required && !limited)
    item.problem("required", "found true without lower, upper or tolerance: such an item could never pass");
  item.finish();
}

void read_items(TableReader items, Recipe& recipe) {
  for (std::size_t i = 0; i < kItemCount; ++i) {
    const ItemInfo& item = info(static_cast<ItemId>(i));
    // A missing item is a fault, because otherwise it would silently not be judged.
    if (!items.has(item.name)) {
      if (item.optional) continue;
      items.missing(item.name, "a table; an item that is not judged has required = false and no limits");
      continue;
    }
    recipe.tolerances[i].given = true;
    TableReader table = items.table(item.name);
    if (item.id == ItemId::surface_pores) read_pore_limits(table, recipe.pores);
    bool is_size = item.is_size;
    if (item.of_gauges) {
      GaugeFormula& formula = recipe.formulas[gauge_item_index(item.id)];
      read_formula(table, formula);
      // The other two have a sign.
      is_size = is_size && (formula.kind == FormulaKind::range || formula.kind == FormulaKind::plane4_flatness);
    }
    read_item(std::move(table), item, is_size, recipe.tolerances[i]);
  }
  items.finish();
  // A capped casing is not visible.
  if (recipe.evaluation.casing == CasingKind::capped)
    for (const ItemId id : {ItemId::casing_spacing, ItemId::casing_protrusion_inner, ItemId::casing_protrusion_outer,
                            ItemId::casing_skew_inner, ItemId::casing_skew_outer})
      recipe.tolerances[static_cast<std::size_t>(id)].required = false;
}

// ---- the file ---------------------------------------------------------------------------------------------------

void read_head(TableReader& root, Recipe& recipe) {
  std::string schema;
  root.required_text("schema", schema, 64);
  if (!schema.empty() && schema != "slabd.recipe/1")
    root.problem("schema", fmt::format("found \"{}\", allowed is \"slabd.recipe/1\"", schema));
  std::string recipe_name;
  root.required_text("name", recipe_name, recipe.name.capacity());
  if (std::any_of(recipe_name.begin(), recipe_name.end(),
                  [](char c) { return std::iscntrl(static_cast<unsigned char>(c)) != 0; }))
    root.problem("name", "found a control character, allowed is printable text on one line");
  recipe.name.assign(recipe_name);
  std::int64_t slab_type = 0;
  root.required_integer("slab_type", slab_type, 1, 65'535);  // one register of the PLC
  recipe.slab_type = static_cast<std::uint16_t>(slab_type);
  std::size_t datum = 0;
  if (!root.has("slope_datum")) root.missing("slope_datum", "\"slab_frame\" or \"local_slab_top\"");
  root.optional_word("slope_datum", datum, {"slab_frame", "local_slab_top"});
  recipe.slope_datum = datum == 0 ? SlopeDatum::slab_frame : SlopeDatum::local_slab_top;
  root.required_boolean("remove_warp", recipe.remove_warp);
  std::size_t design = 0;
  root.optional_word("design", design, {"none", "optional", "required"});
  recipe.design = static_cast<DesignUse>(design);
  root.required_number("guard", recipe.guard, {0.0, 2.0});
}

// ---- the folder -------------------------------------------------------------------------------------------------

struct RecipeFile {
  std::string path;
  std::string bytes;
  Recipe recipe;
  bool is_good = false;
  std::optional<std::uint16_t> slab_type;  ///< also read from a faulty file if possible
};

/// False for temporary files of editors (".#p5600.toml", ".p5600.toml.swp").
bool is_recipe_file(const std::filesystem::path& path) {
  return path.extension() == ".toml" && !path.filename().string().starts_with('.');
}

/// Number after "slab_type =" at the start of a line, in a file that need not be valid TOML.
std::optional<std::uint16_t> slab_type_in(std::string_view text) {
  static constexpr std::string_view kKey = "slab_type";
  static constexpr std::string_view kBlank = " \t";
  const auto skip_blanks = [](std::string_view& line) {
    line.remove_prefix(std::min(line.find_first_not_of(kBlank), line.size()));
  };
  while (!text.empty()) {
    std::string_view line = text.substr(0, text.find('\n'));
    text.remove_prefix(std::min(line.size() + 1, text.size()));
    skip_blanks(line);
    if (!line.starts_with(kKey)) continue;
    line.remove_prefix(kKey.size());
    skip_blanks(line);
    if (!line.starts_with('=')) continue;
    line.remove_prefix(1);
    skip_blanks(line);
    std::uint16_t slab_type = 0;
    const auto [end, error] = std::from_chars(line.data(), line.data() + line.size(), slab_type);
    const std::string_view rest(end, static_cast<std::size_t>(line.data() + line.size() - end));
    if (error != std::errc() || slab_type == 0 || rest.find_first_not_of(" \t\r") != rest.find('#')) return {};
    return slab_type;
  }
  return {};
}

RecipeFile read_recipe_file(const std::string& path, std::vector<Problem>& problems, std::vector<Problem>* doubts,
                            const GaugeList* gauges) {
  RecipeFile file;
  file.path = path;
  const std::size_t problems_before = problems.size();
  std::optional<std::string> bytes = read_text_file(path, problems);
  if (!bytes) return file;
  file.bytes = std::move(*bytes);
  parse_recipe(path, file.bytes, file.recipe, problems, doubts);
  if (gauges != nullptr && problems.size() == problems_before)
    check_formulas(file.recipe, {gauges->data(), gauges->size()}, problems);
  file.is_good = problems.size() == problems_before;
  file.slab_type = file.is_good ? std::optional(file.recipe.slab_type) : slab_type_in(file.bytes);
  return file;
}

}  // namespace

void parse_recipe(const std::string& path, const std::string& bytes, Recipe& recipe, std::vector<Problem>& problems,
                  std::vector<Problem>* doubts) {
  recipe = Recipe{};
  recipe.path.assign(path);
  const std::size_t problems_before = problems.size();
  if (path.size() > recipe.path.capacity()) {
    problems.push_back(
        {fmt::format("{}: a path of {} bytes, allowed are {}", path, path.size(), recipe.path.capacity())});
    return;
  }
  if (bytes.size() > storage::kRecipeTextBytes) {
    problems.push_back({fmt::format("{}: found {} bytes, allowed are {} (slabd keeps a recipe with its slabs)", path,
                                    bytes.size(), storage::kRecipeTextBytes)});
    return;
  }
  recipe.sha256.assign(calib::sha256_hex(bytes));
  TomlValue tree;
  if (!parse_toml(path, bytes, tree, problems)) return;

  TableReader root(path, &tree, "", problems);
  root.keep_doubts(doubts);
  read_head(root, recipe);
  {
    Reading tables(root);
    walk_tables(tables, recipe);
  }
  read_items(root.table("items"), recipe);
  // Relations are checked only if all numbers are present.
  if (problems.size() == problems_before) check_relations(root, recipe);
  root.finish();
}

void load_recipe(const std::string& path, Recipe& recipe, std::vector<Problem>& problems,
                 std::vector<Problem>* doubts) {
  recipe = Recipe{};
  recipe.path.assign(path);
  if (const std::optional<std::string> bytes = read_text_file(path, problems))
    parse_recipe(path, *bytes, recipe, problems, doubts);
}

std::map<std::string, std::string> recipe_files(const std::string& dir, std::vector<Problem>& problems) {
  std::map<std::string, std::string> files;
  std::error_code ec;
  for (std::filesystem::directory_iterator it(dir, ec), end; !ec && it != end; it.increment(ec)) {
    if (!is_recipe_file(it->path())) continue;
    const std::string path = it->path().string();
    if (std::optional<std::string> bytes = read_text_file(path, problems)) files.emplace(path, std::move(*bytes));
  }
  if (ec) problems.push_back({fmt::format("{}: the recipe folder cannot be read: {}", dir, ec.message())});
  return files;
}

void load_recipes(const std::string& dir, std::vector<Recipe>& recipes, std::vector<Problem>& problems,
                  std::vector<storage::RecipeText>* texts, std::vector<Problem>* doubts, const GaugeList* gauges) {
  recipes.clear();
  if (texts != nullptr) texts->clear();
  std::vector<std::string> paths;
  std::error_code ec;
  for (std::filesystem::directory_iterator it(dir, ec), end; !ec && it != end; it.increment(ec))
    if (is_recipe_file(it->path())) paths.push_back(it->path().string());
  if (ec) {
    problems.push_back(
        {fmt::format("{}: the recipe folder cannot be read: {}; it is [recipes] dir of the configuration, and slabd's "
                     "package fills it",
                     dir, ec.message())});
    return;
  }
  std::sort(paths.begin(), paths.end());

  std::vector<RecipeFile> files;
  files.reserve(paths.size());
  for (const std::string& path : paths) files.push_back(read_recipe_file(path, problems, doubts, gauges));
  // One of two files may be an old version of the other: a guess could pass bad slabs.
  std::map<std::uint16_t, std::string> path_of_type;
  bool any_type_unknown = false;
  for (const RecipeFile& file : files) {
    if (!file.slab_type) {
      problems.push_back(
          {fmt::format("{}: its slab_type cannot be read, so it may be the better recipe for any type: no recipe is "
                       "used until it is corrected or moved out of the folder",
                       file.path)});
      any_type_unknown = true;
      continue;
    }
    if (const auto [other, is_new] = path_of_type.emplace(*file.slab_type, file.path); !is_new)
      problems.push_back(
          {fmt::format("{}: slab_type: {} is also the type of {}; allowed is one file for each type, and of these none "
                       "is used",
                       file.path, *file.slab_type, other->second)});
  }
  if (any_type_unknown) return;
  for (const RecipeFile& file : files) {
    const auto rival = [&file](const RecipeFile& other) {
      return &other != &file && other.slab_type == file.slab_type;
    };
    if (!file.is_good || std::any_of(files.begin(), files.end(), rival)) continue;
    if (recipes.size() == limits::kRecipesMax) {
      problems.push_back({fmt::format("{}: left out; allowed are {} recipes", file.path, limits::kRecipesMax)});
      continue;
    }
    recipes.push_back(file.recipe);
    if (texts != nullptr) texts->push_back({file.recipe.sha256, file.recipe.name, file.bytes});
  }
  if (recipes.empty())
    problems.push_back({fmt::format("{}: no usable recipe (*.toml) in this folder; slabd cannot measure", dir)});
}

}  // namespace slabd::config
