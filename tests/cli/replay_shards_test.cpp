// SPDX-License-Identifier: Apache-2.0
//
// slabctl replay --shard, --merge and --slurm on five stored slabs of two blocks: several processes print what one
// prints, and a folder with missing, foreign or damaged files is refused.
#include <cmath>
#include <cstdlib>
#include <nlohmann/json.hpp>

#include "calib/calib.h"
#include "cli/replay/shard.h"
#include "tests/cli/fake_daemon.h"
#include "tests/cli/replay_shards.h"

namespace slabd::cli {
namespace {

using nlohmann::json;

/// The text of a file of a shard with its last field made right for the rest.
std::string with_new_checksum(std::string text) {
  const std::string key = ",\n  \"sha256\": \"";
  const std::size_t at = text.rfind(key);
  text.resize(at);
  return text + key + calib::sha256_hex(text) + "\"\n}\n";
}

std::string replaced(std::string text, const std::string& part, const std::string& other) {
  const std::size_t at = text.find(part);
  EXPECT_NE(at, std::string::npos) << part << " in " << text;
  return at == std::string::npos ? text : text.replace(at, part.size(), other);
}

TEST_F(ReplayShards, in_any_order_give_the_bytes_of_one_process) {
  for (const std::string& command : {verify(), what_if()}) {
    fs::remove_all(file("a"));
    fs::remove_all(file("b"));
    run_shards(command, "a", {3, 1, 2});
    run_shards(command, "b", {2, 3, 1});
    EXPECT_EQ(files("a"), files("b"));
    EXPECT_EQ(files("a").size(), 6U) << "five slabs and the selection";
    for (const char* form : {"", "--json"}) {
      const Ended one = run(command + " --threads 1 " + form);
      const Ended merged = merge("a", form);
      EXPECT_EQ(merged.out, one.out);
      EXPECT_EQ(merged.status, one.status) << command;
      EXPECT_GT(merged.out.size(), 200U);
    }
  }
}

TEST_F(ReplayShards, shards_of_named_slabs_keep_the_order_of_the_names_and_the_exit_status) {
  const std::string command = "replay 5 1 3 --db " + db() + " --recipes " + places::source_dir() + "/recipes";
  run_shards(command, "a");
  const Ended one = run(command + " --threads 1");
  const Ended merged = merge("a");
  EXPECT_EQ(merged.out, one.out);
  EXPECT_EQ(one.status, kNotPass) << "slab 3 was named and has no scans";
  EXPECT_EQ(merged.status, one.status);
}

TEST_F(ReplayShards, a_repeated_shard_measures_nothing_and_a_damaged_file_is_measured_again) {
  run_shards(what_if(), "a");
  const auto before = files("a");
  const auto written = fs::last_write_time(file("a/" + slab_file("a", 1)));
  for (int index = 1; index <= kShards; ++index)
    expect_mentions(run_shard(what_if(), index, "a").out, ", 0 measured now, ");
  EXPECT_EQ(fs::last_write_time(file("a/" + slab_file("a", 1))), written);
  std::ofstream(file("a/" + slab_file("a", 4))) << "{";
  std::string messages;
  for (int index = 1; index <= kShards; ++index) messages += run_shard(what_if(), index, "a").err;
  expect_mentions(messages, slab_file("a", 4) +
                                ": not valid JSON at byte 2: the file was damaged or cut; the slab is "
                                "measured again");
  EXPECT_EQ(files("a"), before);
}

TEST_F(ReplayShards, the_merge_ignores_half_written_files_and_refuses_missing_slabs) {
  run_shards(verify(), "a", {1, 2});
  std::size_t missing = 6 - files("a").size();
  ASSERT_GT(missing, 0U) << "shard 3 has slabs";
  const Ended early = merge("a");
  EXPECT_EQ(early.status, kBadInput);
  EXPECT_TRUE(early.out.empty());
  expect_mentions(early.err, std::to_string(missing) + " of 5 slabs are missing");
  run_shards(verify(), "a", {3});
  const Ended whole = merge("a");
  put("a/" + slab_file("a", 2) + ".part-k3x9qa", "{\"schema\": ");
  put("a/.nfs0001", "of a file system");
  EXPECT_EQ(merge("a").out, whole.out);
  fs::remove(file("a/" + slab_file("a", 5)));
  const Ended ended = merge("a");
  EXPECT_EQ(ended.status, kBadInput);
  expect_mentions(ended.err, "1 of 5 slabs are missing; run the shards again, finished slabs are kept: 5\n");
  EXPECT_EQ(merge("none").status, kBadInput);
  fs::create_directories(file("empty"));
  expect_mentions(merge("empty").err, "has no selection-*.json");
}

TEST_F(ReplayShards, a_folder_belongs_to_one_recipe_one_build_and_one_selection) {
  run_shards(what_if(), "a");
  const auto before = files("a");
  // Another recipe, another mode, fewer slabs.
  const Ended recipe = run_shard(all("--recipe " + kRecipe), 1, "a");
  EXPECT_EQ(recipe.status, kBadInput);
  expect_mentions(recipe.err, "has the results of another replay");
  expect_mentions(recipe.err, "differs from this command in recipe: \"" + wider_);
  expect_mentions(run_shard(verify(), 1, "a").err, "in kind: \"what_if\", \"verify\"");
  expect_mentions(run_shard(what_if() + " --since 2025-11-21T00:10:00Z", 1, "a").err, "in slabs: 5 from 1 to 5, ");
  EXPECT_EQ(files("a"), before);

  // Files of another recipe, copied into the folder.
  run_shards(all("--recipe " + kRecipe), "b");
  fs::copy_file(file("b/" + slab_file("b", 2)), file("a/" + slab_file("b", 2)));
  const Ended mixed = merge("a");
  EXPECT_EQ(mixed.status, kBadInput);
  EXPECT_TRUE(mixed.out.empty());
  expect_mentions(mixed.err, slab_file("b", 2) + " (with another recipe, option or slab of this key)");
  fs::remove(file("a/" + slab_file("b", 2)));
  fs::copy_file(file("b/" + selection_file("b")), file("a/" + selection_file("b")));
  expect_mentions(merge("a").err, "has the results of 2 replays: ");
  fs::remove(file("a/" + selection_file("b")));

  // A file of another build.
  const std::string version(daemon::software_version().view());
  const std::string name = "2-0123456789abcdef.json";
  put("a/" + name, with_new_checksum(replaced(content(file("a/" + slab_file("a", 2))), version, "slabd 0.0.9")));
  expect_mentions(merge("a").err,
                  "1 files have other inputs than " + selection_file("a") + ": " + name + " (by slabd 0.0.9)");
  fs::remove(file("a/" + name));
  EXPECT_EQ(merge("a").status, kDone);

  // A result under the name of another slab.
  const std::string other = content(file("a/" + slab_file("a", 4)));
  put("a/" + slab_file("a", 5), other);
  expect_mentions(merge("a").err, slab_file("a", 5) + " (renamed, it has the result of slab 4)");
}

TEST_F(ReplayShards, damaged_and_foreign_files_are_named) {
  run_shards(verify(), "a");
  const std::string name = slab_file("a", 4);
  const std::string good = content(file("a/" + name));
  const std::string selection = selection_file("a");
  const std::string good_selection = content(file("a/" + selection));
  put("a/" + name, good.substr(0, good.size() / 2));
  Ended ended = merge("a");
  EXPECT_EQ(ended.status, kBadInput);
  EXPECT_TRUE(ended.out.empty());
  expect_mentions(ended.err, name + ": not valid JSON at byte ");
  put("a/" + name, replaced(good, "\"identical\"", "\"idenTical\""));
  expect_mentions(merge("a").err, name + ": its last field is not the SHA-256 of its ");
  put("a/" + name, good);
  put("a/" + selection, replaced(good_selection, "\"total\": 5", "\"total\": 6"));
  ended = merge("a");
  EXPECT_EQ(ended.status, kBadInput);
  expect_mentions(ended.err, selection + ": its last field is not the SHA-256");
  put("a/" + selection, good_selection);
  put("a/notes.txt", "of a person");
  ended = merge("a");
  EXPECT_EQ(ended.status, kBadInput);
  expect_mentions(ended.err, "1 files are not results of a shard: notes.txt");
  fs::remove(file("a/notes.txt"));
  EXPECT_EQ(merge("a").err, "");
}

TEST_F(ReplayShards, the_files_are_what_their_published_schemas_say) {
  run_shards(verify(), "a");
  run_shards(what_if(), "b");
  const std::string schemas = places::source_dir() + "/docs/schemas ";
  const std::string validate = "/usr/bin/python3 " + places::source_dir() + "/tests/cli/validate_json.py " + schemas +
                               file("a") + "/*.json " + file("b") + "/*.json >" + file("valid");
  EXPECT_EQ(std::system(validate.c_str()), 0) << content(file("valid"));
  expect_mentions(content(file("valid")), "12 documents, 0 faults");
}

TEST_F(ReplayShards, the_batch_script_is_valid_and_its_tasks_can_be_merged) {
  const Ended script = run(verify() + " --since 2025-01-01 --slurm 2 --out '" + file("a b") + "'");
  EXPECT_EQ(script.status, kDone) << script.err;
  const std::string path = write("job.sh", script.out);
  EXPECT_EQ(std::system(("bash -n " + path).c_str()), 0) << script.out;
  for (const char* line :
       {"#SBATCH --array=0-1\n", "#SBATCH --mem=", "#SBATCH --nice=", "#SBATCH --requeue\n",
        "##SBATCH --constraint=", " --since 2025-01-01T00:00:00Z ", " --shard $((SLURM_ARRAY_TASK_ID + 1))/2 --out '"})
    expect_mentions(script.out, line);
  expect_mentions(script.out, " replay --merge '" + file("a b") + "'\n");
  for (const char* task : {"1", "0"}) {
    const std::string command = std::string("cd / && SLURM_ARRAY_TASK_ID=") + task + " bash " + path + " >/dev/null";
    EXPECT_NE(std::system(command.c_str()), -1);
  }
  EXPECT_EQ(run("replay --merge '" + file("a b") + "'").out, run(verify() + " --since 2025-01-01 --threads 1").out);
}

TEST_F(ReplayShards, a_shard_does_not_begin_while_a_slab_is_open_on_the_line) {
  const std::string socket = file("c.sock");
  ::setenv("SLABD_CONFIG", write("slabd.toml", "[control]\nsocket = \"" + socket + "\"\n").c_str(), 1);
  const json open = {{"schema", "slabd.status/1"}, {"slab", {{"id", "S-8"}}}};
  const json idle = {{"schema", "slabd.status/1"}, {"slab", nullptr}};
  int slabs_of_shard = 0;
  for (int key = 1; key <= 5; ++key) slabs_of_shard += Shard{1, kShards}.contains(key) ? 1 : 0;
  ASSERT_GT(slabs_of_shard, 0);
  {
    const FakeDaemon daemon(socket, open.dump() + "\n");
    const Ended ended = run_shard(what_if(), 1, "a");
    EXPECT_EQ(ended.status, kNotReachable);
    expect_mentions(ended.err, "slab \"S-8\" is open on this line");
    expect_mentions(ended.err, "--beside-the-line");
    EXPECT_EQ(files("a").size(), 1U) << "only the selection";
    EXPECT_LE(run_shard(what_if() + " --beside-the-line", 1, "b").status, kNotPass);
  }
  fs::remove(socket);
  {
    const FakeDaemon daemon(socket, "of another program\n");
    const Ended ended = run_shard(what_if(), 1, "a");
    EXPECT_EQ(ended.status, kNotReachable);
    expect_mentions(ended.err, "a slab may be open on this line");
  }
  fs::remove(socket);
  {
    const FakeDaemon daemon(socket, idle.dump() + "\n");
    EXPECT_LE(run_shard(what_if(), 1, "a").status, kNotPass);
  }
  ::unsetenv("SLABD_CONFIG");
  EXPECT_EQ(files("a"), files("b"));
}

TEST_F(ReplayShards, wrong_use_is_a_usage_error) {
  for (const char* shard :
       {"0/3", "4/3", "x", "1", "1/", "/3", "-1/3", "1/0", "1/3/5", "1/9999999999", "+1/3", "' 1/3'"})
    EXPECT_EQ(run(verify() + " --out " + file("a") + " --shard " + shard).status, kUsage) << shard;
  EXPECT_EQ(run(verify() + " --shard 1/3").status, kUsage) << "without --out";
  EXPECT_EQ(run(verify() + " --shard 1/3 --json --out " + file("a")).status, kUsage);
  EXPECT_EQ(run(verify() + " --shard 1/3 --slurm 3 --out " + file("a")).status, kUsage);
  EXPECT_EQ(run(verify() + " --out " + file("a")).status, kUsage) << "without --shard";
  EXPECT_EQ(run(verify() + " --beside-the-line").status, kUsage) << "without --shard";
  EXPECT_EQ(run(verify() + " --merge " + file("a")).status, kUsage);
  EXPECT_EQ(run("replay --slurm 3 --db " + db()).status, kUsage) << "no slab is selected";
  EXPECT_EQ(run(verify() + " --slurm 0").status, kUsage);
  EXPECT_FALSE(fs::exists(file("a")));
}

TEST(ReplayShard, has_each_slab_exactly_once) {
  for (const int count : {1, 2, 7, 64}) {
    std::vector<int> slabs(static_cast<std::size_t>(count));
    for (std::int64_t key = 1; key <= 6'400; ++key) {
      int shards = 0;
      for (int index = 1; index <= count; ++index) {
        if (!Shard{index, count}.contains(key)) continue;
        ++shards;
        ++slabs[static_cast<std::size_t>(index - 1)];
      }
      ASSERT_EQ(shards, 1) << key;
    }
    for (const int number : slabs) EXPECT_NEAR(number, 6'400 / count, 6'400 / count / 2) << count;
  }
  EXPECT_EQ(parse_shard("2/8")->index, 2);
  EXPECT_EQ(parse_shard("2/8")->count, 8);
}

TEST(ReplayShard, file_keeps_every_bit_of_a_result) {
  const fs::path path = fs::temp_directory_path() / ("replay-shard-" + std::to_string(::getpid()) + ".json");
  SlabFile file{"slabd 1.0.0", "", std::string(64, '0'), "AVX2", 7, {}};
  WhatIfSlab slab;
  slab.key = 7;
  slab.slab_id = "a\"b\\c\n\x1b";
  slab.stored = Verdict::none;
  slab.now = Verdict::indeterminate;
  slab.items[2].add(Verdict::pass, Verdict::pass);
  slab.items[2].add(Verdict::pass, Verdict::fail);
  Item item;
  item.id = ItemId::jaw_angle_inner;
  item.station = 18;
  item.value = std::nextafter(0.1, 1.0);
  item.lower = 380.0;
  item.upper = 1e300;
  slab.changed.push_back({item, item});
  file.record.judged = slab;
  std::ofstream(path, std::ios::binary) << file.text();
  SlabFile read;
  EXPECT_EQ(read_slab_file(path, read), "");
  EXPECT_EQ(read.text(), file.text());
  EXPECT_EQ(read.record.judged->slab_id, slab.slab_id);
  EXPECT_EQ(read.record.judged->changed[0].stored.value, item.value);
  EXPECT_TRUE(std::isnan(read.record.judged->changed[0].now.U));
  EXPECT_EQ(read.record.judged->items[2].count, 2);

  file.record.judged.reset();
  std::ofstream(path, std::ios::binary) << file.text();
  EXPECT_EQ(read_slab_file(path, read), "") << "a slab that was deleted has no result";
  EXPECT_FALSE(read.record.judged || read.record.verified);
  fs::remove(path);
}

}  // namespace
}  // namespace slabd::cli
