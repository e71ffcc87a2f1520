// SPDX-License-Identifier: Apache-2.0
//
// slabctl db backup against a daemon that refuses the order. slabd-backup.service repeats it by its exit status.
#include "tests/cli/fake_daemon.h"
#include "tests/cli/slabctl_process.h"

namespace slabd::cli {
namespace {

struct BackupByDaemon : Slabctl {
  [[nodiscard]] std::string config() const {
    return write("slabd.toml",
                 "[plc]\nlisten = \"127.0.0.1:1502\"\n[recipes]\ndir = \"" + places::source_dir() +
                     "/recipes\"\n[cell]\nT_base_slab = [1800, 0, 300, 1, 0, 0, 0]\n[storage]\ndb = \"" +
                     file("slabd.db") + "\"\nspool_dir = \"" + file("spool") +
                     "\"\n[calibration]\nT_flange_scanner = [0, 80, 150, 1, 0, 0, 0]\nstation_sigma_mm = 0.02\n"
                     "station_sigma_deg = 0.001\n[control]\n"
                     "socket = \"" +
                     file("c.sock") + "\"\n");
  }
};

TEST_F(BackupByDaemon, an_order_that_is_refused_has_a_status_of_its_own_and_leaves_no_copy) {
  const FakeDaemon daemon(file("c.sock"), "{\"error\":\"the database is being opened; repeat the request\"}\n");
  const Ended ended = run("db backup --keep 14 --config " + config());
  EXPECT_EQ(ended.status, 6) << ended.out;
  expect_mentions(ended.err, "slabd refused: the database is being opened; repeat the request");
  EXPECT_FALSE(fs::exists(file("backups")));
}

TEST_F(BackupByDaemon, an_answer_of_another_form_is_not_a_refusal) {
  const FakeDaemon daemon(file("c.sock"), "{}\n");
  const Ended ended = run("db backup --config " + config());
  EXPECT_EQ(ended.status, 4) << ended.out;
  expect_mentions(ended.err, "slabd gave an answer that is none");
}

}  // namespace
}  // namespace slabd::cli
