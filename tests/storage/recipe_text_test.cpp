// SPDX-License-Identifier: Apache-2.0
//
// Tests for the recipe file with which a slab was begun.
#include <sqlite3.h>

#include "tests/storage/store_fixture.h"

namespace slabd::storage {
namespace {

class RecipeTextTest : public StoreTest {
 protected:
  RecipeTextTest() {
    settings_.recipe_texts = {{"aa11", "p5600", "guard = 1\n# \xC3\xA9\r\n"}, {"aa22", "p4925", "guard = 0\n"}};
  }
  void begin_with(std::int64_t key, std::string_view sha256) {
    BeginSlabJob job{random_header(prng_, key), session_, ++cmd_seq_};
    job.slab.recipe_sha256.assign(sha256);
    apply(job);
    if (key == 1) first_began_us_ = job.slab.began_utime_us;
  }
  std::optional<RecipeText> kept(std::string_view sha256) {
    const auto found = reader()->recipe_text(sha256);
    EXPECT_TRUE(found.ok());
    return found.value();
  }
  std::int64_t first_began_us_ = 0;
};

TEST_F(RecipeTextTest, is_kept_with_the_first_slab_that_names_it) {
  open();
  EXPECT_FALSE(kept("aa11").has_value()) << "nothing was begun with it";
  begin_with(1, "aa11");
  end(1, Verdict::pass);
  begin_with(2, "aa11");
  end(2, Verdict::pass);
  const auto text = kept("aa11");
  ASSERT_TRUE(text.has_value());
  EXPECT_EQ(text->text, settings_.recipe_texts[0].text) << "byte for byte";
  EXPECT_EQ(text->name.view(), "p5600");
  EXPECT_EQ(text->sha256.view(), "aa11");
  EXPECT_EQ(text->kept_utime_us, first_began_us_);
  EXPECT_FALSE(kept("aa22").has_value());
  begin_with(3, "bb33");  // a recipe without a file
  EXPECT_FALSE(kept("bb33").has_value());
}

TEST_F(RecipeTextTest, is_found_by_the_first_characters_when_only_one_begins_so) {
  open();
  begin_with(1, "aa11");
  EXPECT_TRUE(kept("aa").has_value());
  end(1, Verdict::pass);
  begin_with(2, "aa22");
  EXPECT_FALSE(kept("aa").has_value());
  EXPECT_EQ(kept("aa2")->name.view(), "p4925");
  EXPECT_FALSE(kept("").has_value());
  EXPECT_FALSE(kept("%").has_value());
  EXPECT_FALSE(kept("aa111").has_value());
}

TEST_F(RecipeTextTest, a_slab_that_is_refused_leaves_no_text) {
  open();
  begin_with(1, "aa11");
  BeginSlabJob second{random_header(prng_, 2), session_, ++cmd_seq_};
  second.slab.recipe_sha256 = "aa22";
  EXPECT_FALSE(try_apply(second).ok()) << "slab 1 is open";
  EXPECT_FALSE(kept("aa22").has_value());
}

TEST_F(RecipeTextTest, is_neither_changed_nor_deleted) {
  open();
  begin_with(1, "aa11");
  close();
  sqlite3* db = nullptr;
  ASSERT_EQ(sqlite3_open(settings_.db_path.c_str(), &db), SQLITE_OK);
  EXPECT_EQ(sqlite3_exec(db, "UPDATE recipe_text SET text = 'guard = 2'", nullptr, nullptr, nullptr),
            SQLITE_CONSTRAINT);
  EXPECT_EQ(sqlite3_exec(db, "DELETE FROM recipe_text", nullptr, nullptr, nullptr), SQLITE_CONSTRAINT);
  sqlite3_close(db);
}

TEST_F(RecipeTextTest, stays_when_retention_takes_its_slabs_away) {
  settings_.keep_slabs = kKeepSlabsMin;
  open();
  (void)recover();
  for (std::int64_t key = 1; key <= kKeepSlabsMin + 2; ++key) {
    begin_with(key, key <= 2 ? "aa11" : "aa22");
    acknowledge(end(key, Verdict::pass));
  }
  for (int i = 0; i < 20; ++i) store_->idle();
  EXPECT_FALSE(reader()->slab(2).value().has_value());
  EXPECT_TRUE(kept("aa11").has_value()) << "exports and replays of copies still name it";
  EXPECT_TRUE(kept("aa22").has_value());
}

}  // namespace
}  // namespace slabd::storage
