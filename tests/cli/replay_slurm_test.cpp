// SPDX-License-Identifier: Apache-2.0
//
// slabctl replay --slurm on a real Slurm of two nodes on this computer (tests/cli/slurm_cluster): 60 slabs in 20
// shards, while tasks, a node's daemon and the controller are killed. The merged result is byte for byte that of one
// process.
#include <chrono>
#include <cstdlib>
#include <thread>

#include "tests/cli/replay_shards.h"

namespace slabd::cli {
namespace {

constexpr int kSlabs = 60;
constexpr int kTasks = 20;

struct ReplaySlurm : ReplayShards {
  void SetUp() override {
    if (cluster("check") != 0) GTEST_SKIP() << "Slurm and munge are not installed (script/apt-packages-slurm)";
    scans_are_links_ = true;
    begin();
    measure(3);
    measure(4);
    end();
    for (int key = 2; key <= kSlabs; ++key) add_copy(key);
    ASSERT_EQ(cluster("start"), 0) << content(file("cluster/log"));
  }
  void TearDown() override {
    if (!::testing::Test::IsSkipped()) cluster("stop");
    ReplayShards::TearDown();
  }
  /// A step of the script, in a folder of this test.
  int cluster(const std::string& step) const {
    return std::system((places::source_dir() + "/tests/cli/slurm_cluster " + file("cluster") + " " + step).c_str());
  }
  [[nodiscard]] Ended slurm(const std::string& command) const {
    return line_of("SLURM_CONF=" + file("cluster") + "/slurm.conf " + command);
  }
  /// Output of a shell's command.
  [[nodiscard]] Ended line_of(const std::string& command) const {
    Ended ended;
    ended.status = std::system(("{ " + command + "; } >" + file("slurm.out") + " 2>&1").c_str());
    ended.out = content(file("slurm.out"));
    return ended;
  }
  void submit() {
    const Ended sent = slurm("sbatch --parsable --output=" + file("cluster") + "/task-%a.out " + file("job.sh"));
    ASSERT_EQ(sent.status, 0) << sent.out;
  }
  [[nodiscard]] std::string queue() const { return slurm("squeue --noheader --format='%i %T %r'").out; }
  /// Slurm holds a task whose node was lost while it began, until a person releases it; here it is cancelled.
  void wait_for_the_end() {
    const auto begun = std::chrono::steady_clock::now();
    while (std::chrono::steady_clock::now() - begun < std::chrono::minutes(15)) {
      const Ended jobs = slurm(
          "squeue --noheader --array --states=all --format='%T %r' | grep -v -E "
          "'^(COMPLETED|FAILED|CANCELLED|NODE_FAIL)|held'; true");
      if (jobs.status == 0 && jobs.out.empty()) {
        static_cast<void>(slurm("scancel --user=$(id -un)"));
        static_cast<void>(slurm("scontrol update nodename=node1,node2 state=resume"));
        return;
      }
      std::this_thread::sleep_for(std::chrono::milliseconds(300));
    }
    FAIL() << "the jobs do not end: " << queue();
  }
};

TEST_F(ReplaySlurm, kills_of_any_part_do_not_change_the_merged_result) {
  const std::string command = verify();
  const Ended alone = run(command + " --threads 1 --json");
  ASSERT_EQ(alone.status, kDone) << alone.err;
  const Ended script = run(command + " --slurm " + std::to_string(kTasks) + " --out " + file("shards"));
  ASSERT_EQ(script.status, kDone) << script.err;
  put("job.sh", script.out);
  submit();
  using std::chrono::milliseconds;
  int tasks_killed = 0;
  for (const std::string victim : {"task", "node", "task", "controller", "node"}) {
    std::this_thread::sleep_for(milliseconds(1'500));
    const int status = cluster("kill_" + victim);
    if (victim == "task" && status == 0) ++tasks_killed;
  }
  EXPECT_GE(tasks_killed, 1);
  wait_for_the_end();
  // Shards that were killed are missing, and are named; the same script completes them.
  const Ended early = run("replay --merge " + file("shards"));
  if (early.status != kDone) expect_mentions(early.err, "missing");
  // Slurm ends tasks also by itself, when a node of a busy computer does not answer in time.
  Ended merged;
  for (int rounds = 0; rounds < 5; ++rounds) {
    submit();
    wait_for_the_end();
    if (HasFatalFailure()) return;
    merged = run("replay --merge " + file("shards") + " --json");
    if (merged.status == kDone) break;
  }
  EXPECT_EQ(merged.status, kDone) << merged.err << content(file("cluster/log"));
  EXPECT_TRUE(merged.out == alone.out) << merged.out.size() << " and " << alone.out.size() << " bytes";
}

}  // namespace
}  // namespace slabd::cli
