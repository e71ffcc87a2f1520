// SPDX-License-Identifier: Apache-2.0
#include "daemon/recipe_watch.h"

#include <gtest/gtest.h>

#include <chrono>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <thread>

#include "config/config.h"
#include "tests/places/places.h"

namespace slabd::daemon {
namespace {

constexpr int kPeriod_ms = 5;

/// A folder with a recipe of the source tree, in use.
struct RecipesInUse : testing::Test {
  RecipesInUse() {
    std::string name = (std::filesystem::temp_directory_path() / "slabd-recipes-XXXXXX").string();
    EXPECT_NE(mkdtemp(name.data()), nullptr);
    folder = name;
    std::ifstream in(places::source_dir() + "/recipes/p5600.toml");
    std::stringstream all;
    all << in.rdbuf();
    text = all.str();
    write("p5600.toml", text);
    auto set = std::make_shared<RecipeSet>();
    std::vector<config::Problem> problems;
    config::load_recipes(folder, set->recipes, problems, &set->texts);
    EXPECT_TRUE(problems.empty());
    in_use = set;
  }
  ~RecipesInUse() override { std::filesystem::remove_all(folder); }

  /// Replaces the file in one step, because a watch may read it at any time.
  void write(const std::string& name, const std::string& bytes) const {
    std::ofstream(folder + ".new") << bytes;
    std::filesystem::rename(folder + ".new", folder + "/" + name);
  }
  /// The recipe with other jaws.
  [[nodiscard]] std::string tightened() const {
    std::string other = text;
    const std::size_t item = other.find("[items.jaw_distance]");
    const std::size_t tolerance = other.find("tolerance", item);
    EXPECT_NE(tolerance, std::string::npos);
    other.replace(tolerance, other.find('\n', tolerance) - tolerance, "tolerance = 0.35");
    return other;
  }
  template <typename Done>
  static bool comes(const Done& done) {
    for (int i = 0; i < 12'000 && !done(); ++i) std::this_thread::sleep_for(std::chrono::milliseconds(kPeriod_ms));
    return done();
  }

  std::string folder;
  std::string text;
  std::shared_ptr<const RecipeSet> in_use;
};

TEST_F(RecipesInUse, that_equal_the_folder_have_no_difference) {
  RecipeWatch watch(folder, in_use, kPeriod_ms);
  ASSERT_TRUE(watch.order_reload());
  ASSERT_TRUE(comes([&] { return watch.checked() != nullptr; }));
  watch.taken_up();
  EXPECT_FALSE(watch.differs());
  EXPECT_TRUE(watch.words().empty());
}

TEST_F(RecipesInUse, that_differ_are_reported_with_file_and_key) {
  RecipeWatch watch(folder, in_use, kPeriod_ms);
  write("p5600.toml", tightened());
  ASSERT_TRUE(comes([&] { return watch.differs(); }));
  const std::string words(watch.words().view());
  EXPECT_NE(words.find("p5600.toml is changed, items.jaw_distance.lower: 379.5 in use, 379.65 in the file"),
            std::string::npos)
      << words;
  write("p5600.toml", text);
  EXPECT_TRUE(comes([&] { return !watch.differs(); }));
}

TEST_F(RecipesInUse, reports_added_removed_and_unusable_files) {
  RecipeWatch watch(folder, in_use, kPeriod_ms);
  std::filesystem::remove(folder + "/p5600.toml");
  ASSERT_TRUE(comes([&] { return watch.differs(); }));
  EXPECT_EQ(watch.differences().at(0).what, "missing");
  write("p5600.toml", "schema = 3\n");
  ASSERT_TRUE(comes([&] { return !watch.differences().empty() && watch.differences()[0].what == "changed"; }));
  EXPECT_NE(watch.differences()[0].problem, "");
}

TEST_F(RecipesInUse, is_taken_up_whole_when_it_is_good) {
  RecipeWatch watch(folder, in_use, kPeriod_ms);
  write("p5600.toml", tightened());
  ASSERT_TRUE(watch.order_reload());
  ASSERT_TRUE(comes([&] { return watch.checked() != nullptr; }));
  EXPECT_DOUBLE_EQ(watch.checked()->recipes.at(0).tolerance(ItemId::jaw_distance).upper, 380.35);
  EXPECT_EQ(watch.in_use(), in_use) << "not before the loop has taken it up";
  watch.taken_up();
  EXPECT_EQ(watch.reload(), RecipeWatch::Reload::done);
  EXPECT_FALSE(watch.differs());
}

TEST_F(RecipesInUse, a_faulty_folder_keeps_the_recipes_in_use_and_reports_the_reason) {
  RecipeWatch watch(folder, in_use, kPeriod_ms);
  write("p5600.toml", text + "\nno_such_key = 1\n");
  ASSERT_TRUE(watch.order_reload());
  ASSERT_TRUE(comes([&] { return watch.reload() == RecipeWatch::Reload::refused; }));
  EXPECT_EQ(watch.checked(), nullptr);
  EXPECT_NE(std::string(watch.reload_text().view()).find("p5600.toml"), std::string::npos);
  RecipeWatch::Text note;
  EXPECT_TRUE(watch.next_note(note));
  EXPECT_FALSE(watch.next_note(note)) << "once";
  EXPECT_EQ(watch.in_use(), in_use);
}

}  // namespace
}  // namespace slabd::daemon
