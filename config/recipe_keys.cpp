// SPDX-License-Identifier: Apache-2.0
#include "config/recipe_keys.h"

#include <fmt/core.h>

#include "config/recipe_parts.h"

namespace slabd::config {
namespace {

std::string number_text(double value) {
  return has_value(value) ? fmt::format("{}", value) : "-";
}

class Keys {
 public:
  void add(const RecipeKey& key) { list_.push_back(key); }
  void add(std::string key, double value, KeyEffect effect) {
    list_.push_back({std::move(key), number_text(value), effect});
  }
  void add(std::string key, bool value, KeyEffect effect) {
    list_.push_back({std::move(key), value ? "true" : "false", effect});
  }
  void add(std::string key, std::string_view value, KeyEffect effect) {
    list_.push_back({std::move(key), std::string(value), effect});
  }
  [[nodiscard]] std::vector<RecipeKey> take() { return std::move(list_); }

 private:
  std::vector<RecipeKey> list_;
};

/// Keys of the tables, in the order of walk_tables.
class TableKeys {
 public:
  struct Entry {
    std::string_view table;
    RecipeKey key;
    std::optional<NamedNominal> nominal{};
  };

  explicit TableKeys(const Recipe& recipe) { walk_tables(*this, recipe); }
  [[nodiscard]] const std::vector<Entry>& list() const { return list_; }
  /// Assumptions are the tables [uncertainty] and [thermal], which a recipe may omit.
  [[nodiscard]] std::vector<NamedNominal> nominals(bool are_assumptions) const {
    std::vector<NamedNominal> nominals;
    for (const Entry& entry : list_)
      if (entry.nominal && (entry.table == "uncertainty" || entry.table == "thermal") == are_assumptions &&
          has_value(entry.nominal->nominal.value))
        nominals.push_back(*entry.nominal);
    return nominals;
  }

  void table(std::string_view name) {
    table_ = name;
    effect_ = name == "slab" ? KeyEffect::slab : name == "edges" ? KeyEffect::none : KeyEffect::measured;
  }
  void table(std::string_view name, bool given) {
    table(name);
    list_.push_back({table_, {std::string(name), given ? "given" : "-", effect_}});
  }
  void nominal(const char* key, const Nominal& n, Allowed, bool is_angle = false) {
    NamedNominal named{key_of(key), n, is_angle};
    put(key, number_text(shown(named)));
    list_.back().nominal = named;
  }
  void range(const char* key, const Nominal& low, const Nominal& high, Allowed) {
    put(key, fmt::format("[{}, {}]", number_text(low.value), number_text(high.value)));
  }
  void degrees(const char* key, const Nominal& n, Allowed allowed) { nominal(key, n, allowed, true); }
  void number(const char* key, double value, Allowed) { put(key, number_text(value)); }
  void optional(const char* key, double value, Allowed) { put(key, number_text(value)); }
  void angle(const char* key, double value_rad, Allowed) { put(key, number_text(deg_from_rad(value_rad))); }
  void whole(const char* key, double value, std::int64_t, std::int64_t) { put(key, number_text(value)); }
  template <typename Word>
  void word(const char* key, Word value, std::initializer_list<std::string_view> words) {
    put(key, std::string(words.begin()[static_cast<std::size_t>(value)]));
  }

 private:
  [[nodiscard]] std::string key_of(const char* key) const { return std::string(table_) + "." + key; }
  void put(const char* key, std::string value) { list_.push_back({table_, {key_of(key), std::move(value), effect_}}); }

  std::string_view table_;
  KeyEffect effect_ = KeyEffect::none;
  std::vector<Entry> list_;
};

/// True if U of this item also limits the accepted tilt uncertainty of the seat, the slab top or a jaw
/// (algo/inspector.cpp). This applies with a budget too.
bool asks_of_planes(ItemId id) {
  return id == ItemId::seat_slope || id == ItemId::jaw_angle_inner || id == ItemId::jaw_angle_outer;
}

void add_item(Keys& keys, const Recipe& recipe, ItemId id) {
  const Tolerance& t = recipe.tolerance(id);
  const std::string item = "items." + std::string(info(id).name);
  keys.add(item + ".nominal", t.nominal.value, KeyEffect::verdict);
  keys.add(item + ".lower", t.lower, KeyEffect::verdict);
  keys.add(item + ".upper", t.upper, KeyEffect::verdict);
  keys.add(item + ".U", t.U, asks_of_planes(id) ? KeyEffect::measured : KeyEffect::verdict);
  keys.add(item + ".required", t.required, KeyEffect::verdict);
  keys.add(item + ".confirmed", t.confirmed, KeyEffect::none);
  keys.add(item + ".nominal.confirmed", t.nominal.confirmed, KeyEffect::none);
  if (info(id).of_gauges) {
    const FormulaText formula = text_of(recipe.formula(id));
    keys.add(item + ".formula", formula.empty() ? std::string_view("-") : formula.view(), KeyEffect::slab);
  }
}

}  // namespace

std::vector<NamedNominal> geometry_of(const Recipe& recipe) {
  return TableKeys(recipe).nominals(false);
}

std::vector<NamedNominal> uncertainty_of(const Recipe& recipe) {
  return TableKeys(recipe).nominals(true);
}

double shown(const NamedNominal& n) {
  return n.is_angle ? deg_from_rad(n.nominal.value) : n.nominal.value;
}

std::string_view name(KeyEffect effect) {
  switch (effect) {
    case KeyEffect::none: break;
    case KeyEffect::verdict: return "verdict";
    case KeyEffect::slab: return "slab";
    case KeyEffect::measured: return "measured";
  }
  return "none";
}

std::vector<RecipeKey> keys_of(const Recipe& recipe) {
  Keys keys;
  keys.add("name", recipe.name.view(), KeyEffect::none);
  keys.add("slab_type", static_cast<double>(recipe.slab_type), KeyEffect::slab);
  keys.add("slope_datum",
           std::string_view(recipe.slope_datum == SlopeDatum::slab_frame ? "slab_frame" : "local_slab_top"),
           KeyEffect::slab);
  keys.add("remove_warp", recipe.remove_warp, KeyEffect::slab);
  constexpr std::array<std::string_view, 3> kDesigns = {"none", "optional", "required"};
  keys.add("design", kDesigns.at(static_cast<std::size_t>(recipe.design)), KeyEffect::none);
  keys.add("guard", recipe.guard, KeyEffect::verdict);
  const TableKeys tables(recipe);
  for (const TableKeys::Entry& entry : tables.list()) {
    keys.add(entry.key);
    if (entry.nominal) keys.add(entry.key.key + ".confirmed", entry.nominal->nominal.confirmed, KeyEffect::none);
  }
  for (std::size_t i = 0; i < kItemCount; ++i) add_item(keys, recipe, static_cast<ItemId>(i));
  keys.add("items.surface_pores.depth_max_mm", recipe.pores.depth_max_mm, KeyEffect::verdict);
  keys.add("items.surface_pores.share_max", recipe.pores.share_max, KeyEffect::verdict);
  return keys.take();
}

}  // namespace slabd::config
