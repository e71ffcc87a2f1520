// SPDX-License-Identifier: Apache-2.0
#include "daemon/recipe_watch.h"

#include <fmt/format.h>
#include <sys/stat.h>

#include <algorithm>
#include <atomic>
#include <chrono>
#include <condition_variable>
#include <filesystem>
#include <map>
#include <mutex>
#include <thread>
#include <utility>

#include "config/config.h"
#include "config/recipe_keys.h"
#include "daemon/folder_sign.h"

namespace slabd::daemon {
namespace {

namespace fs = std::filesystem;

/// Largest number of keys of a file in a text for display; the answer on the control socket contains all of them.
constexpr std::size_t kKeysMax = 200;

std::string file_name(const std::string& path) {
  return fs::path(path).filename().string();
}

std::vector<std::string> changed_keys(const Recipe& in_use, const Recipe& in_file) {
  const std::vector<config::RecipeKey> a = config::keys_of(in_use);
  const std::vector<config::RecipeKey> b = config::keys_of(in_file);
  std::vector<std::string> list;
  for (std::size_t i = 0; i < a.size() && i < b.size() && list.size() < kKeysMax; ++i)
    if (a[i].value != b[i].value)
      list.push_back(fmt::format("{}: {} in use, {} in the file", a[i].key, a[i].value, b[i].value));
  return list;
}

RecipeDifference difference_of(const Recipe& in_use, const std::string& bytes) {
  RecipeDifference difference{file_name(std::string(in_use.path.view())), "changed", {}, {}};
  Recipe now;
  std::vector<config::Problem> problems;
  config::parse_recipe(std::string(in_use.path.view()), bytes, now, problems);
  if (problems.empty())
    difference.keys = changed_keys(in_use, now);
  else
    difference.problem = problems.front().text;
  return difference;
}

std::string sentence(const std::vector<RecipeDifference>& list) {
  if (list.empty()) return {};
  const RecipeDifference& first = list.front();
  std::string text = "the recipe folder differs from the recipes in use: " + first.file + " is " + first.what;
  if (!first.problem.empty())
    text += " and could not be used: " + first.problem;
  else if (!first.keys.empty())
    text += ", " + first.keys.front();
  else if (first.what == "changed")
    text += ", but no key has another value";
  if (first.keys.size() > 1) text += fmt::format(" (and {} keys more)", first.keys.size() - 1);
  if (list.size() > 1) text += fmt::format("; and {} files more", list.size() - 1);
  return text + "; `slabctl recipe reload` takes the folder up between two slabs";
}

}  // namespace

struct RecipeWatch::State {
  std::string dir;
  GaugeList gauges;
  int period_ms = 0;

  mutable std::mutex mutex;
  std::condition_variable wake;
  bool stop = false;
  std::shared_ptr<const RecipeSet> in_use;
  std::vector<RecipeDifference> differences;
  Text words;
  Reload reload = Reload::none;
  Text reload_text;
  bool note_waits = false;
  std::shared_ptr<const RecipeSet> checked;
  std::atomic<bool> differs{false};
  std::atomic<bool> is_checked{false};

  // Used by the thread only.
  std::string sign_seen;
  bool has_looked = false;
  std::map<std::string, std::string> unused_at_start;  ///< files that were not usable at the start, with their bytes

  void look();
  void check();
  void set_refused(std::string_view why) {
    reload = Reload::refused;
    reload_text = why;
    note_waits = true;
    checked = nullptr;
    is_checked = false;
  }
};

/// Compares the folder with the recipes in use.
void RecipeWatch::State::look() {
  const std::string sign = folder_sign(dir);
  std::shared_ptr<const RecipeSet> used;
  {
    const std::lock_guard lock(mutex);
    used = in_use;
  }
  if (has_looked && sign == sign_seen) return;

  std::vector<config::Problem> unreadable;
  std::map<std::string, std::string> files = config::recipe_files(dir, unreadable);
  std::vector<RecipeDifference> found;
  if (!unreadable.empty() && files.empty()) {
    found.push_back({dir, "unreadable", {}, unreadable.front().text});
  } else {
    for (std::size_t i = 0; i < used->recipes.size(); ++i) {
      const Recipe& recipe = used->recipes[i];
      const auto file = files.find(std::string(recipe.path.view()));
      if (file == files.end()) {
        found.push_back({file_name(std::string(recipe.path.view())), "missing", {}, {}});
        continue;
      }
      if (file->second != used->texts[i].text) found.push_back(difference_of(recipe, file->second));
      files.erase(file);
    }
    if (!has_looked) unused_at_start = files;
    for (const auto& [path, bytes] : files) {
      const auto known = unused_at_start.find(path);
      if (known != unused_at_start.end() && known->second == bytes) continue;
      found.push_back({file_name(path), known == unused_at_start.end() ? "new" : "changed", {}, {}});
    }
  }
  has_looked = true;
  sign_seen = sign;
  const std::lock_guard lock(mutex);
  if (in_use != used) {
    sign_seen.clear();  // recipes were reloaded meanwhile: the next look compares with those
    return;
  }
  words = std::string_view(sentence(found));
  differences = std::move(found);
  differs = !differences.empty();
}

/// Reads the whole folder as at a start. Any problem rejects it, and the recipes in use stay.
void RecipeWatch::State::check() {
  auto set = std::make_shared<RecipeSet>();
  std::vector<config::Problem> problems;
  config::load_recipes(dir, set->recipes, problems, &set->texts, nullptr, &gauges);
  const std::lock_guard lock(mutex);
  if (!problems.empty()) {
    set_refused(fmt::format("the recipes in use stay in force, because the folder could not be used as it is: {}{}",
                            problems.front().text,
                            problems.size() > 1 ? fmt::format(" (and {} problems more)", problems.size() - 1) : ""));
    return;
  }
  reload = Reload::checked;
  checked = std::move(set);
  is_checked = true;
}

RecipeWatch::RecipeWatch(const std::string& dir, std::shared_ptr<const RecipeSet> in_use, int period_ms,
                         const GaugeList& gauges)
    : state_(std::make_shared<State>()) {
  state_->dir = dir;
  state_->gauges = gauges;
  state_->period_ms = period_ms;
  state_->in_use = std::move(in_use);
  // Detached, with its own state, because a look at a share that hangs may return at any time.
  std::thread([state = state_] {
    std::unique_lock lock(state->mutex);
    while (!state->stop) {
      const bool ordered = state->reload == Reload::checking;
      lock.unlock();
      try {
        if (ordered)
          state->check();
        else
          state->look();
      } catch (const std::exception& e) {
        // A file may be too large for the memory.
        const std::lock_guard failed(state->mutex);
        if (ordered) state->set_refused(e.what());
      }
      lock.lock();
      if (state->stop || state->reload == Reload::checking) continue;
      state->wake.wait_for(lock, std::chrono::milliseconds(state->period_ms));
    }
  }).detach();
}

RecipeWatch::~RecipeWatch() {
  const std::lock_guard lock(state_->mutex);
  state_->stop = true;
  state_->wake.notify_all();
}

bool RecipeWatch::differs() const {
  return state_->differs;
}
RecipeWatch::Text RecipeWatch::words() const {
  const std::lock_guard lock(state_->mutex);
  return state_->words;
}
std::vector<RecipeDifference> RecipeWatch::differences() const {
  const std::lock_guard lock(state_->mutex);
  return state_->differences;
}
bool RecipeWatch::order_reload() {
  const std::lock_guard lock(state_->mutex);
  if (state_->reload == Reload::checking || state_->reload == Reload::checked) return false;
  state_->reload = Reload::checking;
  state_->reload_text = "";
  state_->wake.notify_all();
  return true;
}
RecipeWatch::Reload RecipeWatch::reload() const {
  const std::lock_guard lock(state_->mutex);
  return state_->reload;
}
RecipeWatch::Text RecipeWatch::reload_text() const {
  const std::lock_guard lock(state_->mutex);
  return state_->reload_text;
}
std::shared_ptr<const RecipeSet> RecipeWatch::checked() const {
  if (!state_->is_checked) return nullptr;
  const std::lock_guard lock(state_->mutex);
  return state_->checked;
}
void RecipeWatch::taken_up() {
  const std::lock_guard lock(state_->mutex);
  state_->in_use = std::exchange(state_->checked, nullptr);
  state_->is_checked = false;
  state_->reload = Reload::done;
  state_->differences.clear();
  state_->words = "";
  state_->differs = false;
}
void RecipeWatch::refuse(std::string_view why) {
  const std::lock_guard lock(state_->mutex);
  state_->set_refused(why);
}
bool RecipeWatch::next_note(Text& text) {
  const std::lock_guard lock(state_->mutex);
  if (!std::exchange(state_->note_waits, false)) return false;
  text.printf("the recipes are not taken up: %s", state_->reload_text.c_str());
  return true;
}
std::shared_ptr<const RecipeSet> RecipeWatch::in_use() const {
  const std::lock_guard lock(state_->mutex);
  return state_->in_use;
}

}  // namespace slabd::daemon
