// SPDX-License-Identifier: Apache-2.0
#include "config/toml_reader.h"
#include "tests/config/text_file.h"
#include "tests/places/places.h"

namespace slabd::config {
namespace {

using Texts = std::vector<std::string>;

/// The shortest valid configuration; all other keys have defaults.
constexpr const char* kShortest =
    "[cell]\n"
    "T_base_slab = [1000, 0, 500, 1, 0, 0, 0]\n"
    "[calibration]\n"
    "T_flange_scanner = [0, 0, 120.5, 1, 0, 0, 0]\n";

constexpr const char* kEveryKey = R"([plc]
role = "server"
listen = "10.1.2.3:502"
unit_id = 17
allow = ["10.0.0.0/8", "192.168.1.7/32"]
read_only = ["10.9.0.0/16"]
word_order = "cdab"
[robot]
lcm_url = "udpm://239.255.76.99:7777?ttl=1"
channel = "POSE"
interface = "eth1"
window_ms = 400
samples_min = 30
settled_mm = 0.05
settled_deg = 0.004
dwell_ms = 250
moved_mm = 0.1
moved_deg = 0.006
stale_ms = 150
gap_ms = 50.5
base_id = -1
tool_id = 3
look_mm = 100
settle_timeout_s = 6
repeatability_sigma_mm = 0.017
absolute_sigma_mm = 0.7
absolute_sigma_deg = 0.03
repeatability_sigma_deg = 0.002
[scanner]
backend = "drop"
drop_dir = "/srv/drop"
any_name = true
unit = "um"
columns = "PosX, PosY, PosZ"
timeout_s = 12.5
drift_per_K = 3e-6
temperature_range_K = 8
[scanner.warm_up]
views = 8
window_min = 12
every_s = 30
centre_um_per_h = 15
radius_um_per_h = 25
give_up_min = 60
[storage]
db = "/srv/slabd.db"
spool_dir = "/srv/spool"
spool_budget_gb = 500
keep_slabs = 20000
keep_failed_slabs = 50000
[measure]
threads = 1
[recipes]
dir = "/srv/recipes"
[cell]
T_base_slab = [1, -2.5, 3, 0, 0, 0, -1]
[calibration]
T_flange_scanner = [4, 5, 6, 0.7071067811865476, 0, 0.7071067811865476, 0]
station_sigma_mm = 0.02
station_sigma_deg = 0.001
station_gate_mm = 0.8
station_gate_deg = 0.04
check_interval_hours = 12
check_slope_limit_deg = 0.02
check_jaw_limit_mm = 0.1
valid_days = 180
capture_stable_mm = 0.02
capture_stable_deg = 0.002
capture_stable_s = 0.5
[control]
socket = "/srv/control.sock"
[line]
simulation = true
id_pattern = 'C3-[0-9]{4}'
mould_from_id = '-M([0-9]+)'
second_chip = "required"
[report]
project = "Line 7"
)";

class ConfigTest : public ::testing::Test {
 protected:
  Texts load(const std::string& text) {
    std::vector<config::Problem> problems;
    config::load_config(files_.write("slabd.toml", text), config_, problems);
    return files_.texts(problems);
  }
  TextFiles files_;
  config::Config config_;
};

TEST_F(ConfigTest, relative_paths_start_at_the_configurations_folder) {
  EXPECT_EQ(load(std::string(kShortest) + "[storage]\ndb = \"data/slabd.db\"\n"), Texts{});
  const std::string folder = config_.path.substr(0, config_.path.rfind('/'));
  EXPECT_EQ(config_.storage.db_path, folder + "/data/slabd.db");
}

TEST_F(ConfigTest, no_path_of_slabd_is_in_the_scanners_folder) {
  const auto with_drop = [](const std::string& drop, const std::string& rest) {
    return kShortest + ("[scanner]\ndrop_dir = \"" + drop + "\"\n" + rest);
  };
  EXPECT_EQ(load(with_drop("/srv/d", "[storage]\nspool_dir = \"/srv/dd\"\ndb = \"/srv/slabd.db\"\n")), Texts{});
  for (const char* inside : {"[storage]\nspool_dir = \"/srv/d\"\n", "[storage]\nspool_dir = \"/srv/d/inbox\"\n",
                             "[storage]\ndb = \"/srv/x/../d/slabd.db\"\n", "[recipes]\ndir = \"/srv/d/recipes/\"\n",
                             "[control]\nsocket = \"/srv/d/inbox/control.sock\"\n"}) {
    const Texts texts = load(with_drop("/srv/d/", inside));
    ASSERT_GE(texts.size(), 1U) << inside;
    EXPECT_NE(texts[0].find("in the scanner's folder /srv/d"), std::string::npos) << texts[0];
    EXPECT_TRUE(texts[0].starts_with("slabd.toml:8:")) << texts[0];
  }
  const Texts texts = load(with_drop("/srv/spool/drop", "[storage]\nspool_dir = \"/srv/spool\"\n"));
  EXPECT_EQ(texts, Texts{"slabd.toml:6:12: scanner.drop_dir: found /srv/spool/drop, which is in /srv/spool "
                         "(storage.spool_dir); allowed is a place outside of it"});
}

TEST_F(ConfigTest, folders_are_compared_by_what_they_really_are) {
  namespace fs = std::filesystem;
  std::string folder = (fs::temp_directory_path() / "slabd-places-XXXXXX").string();
  ASSERT_NE(mkdtemp(folder.data()), nullptr);
  fs::create_directories(folder + "/drop/stray");
  fs::create_directories(folder + "/data");
  fs::create_directory_symlink(folder + "/drop/stray", folder + "/link");
  fs::create_symlink("drop/stray/new.db", folder + "/dangling.db");
  fs::create_directory_symlink(folder + "/not-there-yet", folder + "/drop-link");
  const auto with = [&](const std::string& drop, const std::string& rest) {
    return kShortest +
           ("[scanner]\ndrop_dir = \"" + folder + drop + "\"\n[storage]\nspool_dir = \"/srv/spool\"\n" + rest);
  };
  EXPECT_EQ(load(with("/drop", "db = \"" + folder + "/data/slabd.db\"\n")), Texts{});
  for (const char* db : {"/link/slabd.db", "/dangling.db"}) {
    const Texts texts = load(with("/drop", "db = \"" + folder + db + "\"\n"));
    ASSERT_GE(texts.size(), 1U) << db;
    EXPECT_NE(texts[0].find("storage.db: found " + folder + db + " (really " + folder + "/drop/stray/"),
              std::string::npos)
        << texts[0];
  }
  EXPECT_GE(load(with("/drop-link", "db = \"" + folder + "/not-there-yet/slabd.db\"\n")).size(), 1U)
      << "also what neither of them is yet";
  fs::remove_all(folder);
}

TEST_F(ConfigTest, the_daemon_starts_with_a_configuration_that_passes_the_check) {
  for (const char* url :
       {"udpm://239.255.78.300:7667?ttl=0", "udpm://10.0.0.1:7667?ttl=0", "udpm://239.255.76.67:7667?ttl=300",
        "udpm://239.255.76.67:7667?tll=0", "udpm://239.255.76.67:0?ttl=0", "udpm://239.255.76.67:7667"}) {
    const Texts texts = load(kShortest + ("[robot]\nlcm_url = \"" + std::string(url) + "\"\n"));
    ASSERT_EQ(texts.size(), 1U) << url;
    EXPECT_TRUE(texts[0].starts_with("slabd.toml:6:11: robot.lcm_url: lcm url \"udpm://")) << texts[0];
  }
  EXPECT_EQ(load(kShortest + std::string("[robot]\nchannel = \"\"\n")).size(), 1U);
  EXPECT_EQ(load(kShortest + std::string("[robot]\ninterface = \"a/b\"\n")).size(), 1U);
  EXPECT_EQ(
      load(kShortest + std::string("[plc]\nlisten = \"127.0.0.0/8:1502\"\n")),
      Texts{"slabd.toml:6:10: plc.listen: found \"127.0.0.0/8:1502\", allowed is an IPv4 address before the port, "
            "such as 127.0.0.1"});
}

TEST_F(ConfigTest, views_of_a_calibration_may_have_wider_limits_and_never_narrower_ones) {
  EXPECT_EQ(load(std::string(kShortest) + "capture_stable_mm = 0.01\ncapture_stable_deg = 0.001\n"), Texts{});
  EXPECT_FALSE(config_.capture.is_wider());
  for (const char* key : {"capture_stable_mm = 0.005\n", "capture_stable_deg = 0.0005\n", "capture_stable_s = 2\n"})
    EXPECT_EQ(load(std::string(kShortest) + key).size(), 1U) << key;
}

TEST_F(ConfigTest, slabs_that_did_not_pass_are_kept_by_a_number_of_their_own) {
  const auto storage = [](const std::string& keys) { return kShortest + ("[storage]\n" + keys); };
  EXPECT_EQ(load(storage("keep_slabs = 500\n")), Texts{});
  EXPECT_EQ(config_.storage.keep_failed_slabs, 500) << "as many more, unless it is said otherwise";
  for (const int failed : {0, 100, 1'000'000'000}) {
    EXPECT_EQ(load(storage("keep_slabs = 100\nkeep_failed_slabs = " + std::to_string(failed) + "\n")), Texts{});
    EXPECT_EQ(config_.storage.keep_failed_slabs, failed);
  }
  EXPECT_EQ(
      load(storage("keep_slabs = 500\nkeep_failed_slabs = 99\n")),
      Texts{"slabd.toml:7:21: storage.keep_failed_slabs: found 99, allowed is 0 (keep all that did not pass) or 100 "
            "and more"});
  EXPECT_EQ(load(storage("keep_slabs = 99\n")),
            Texts{"slabd.toml:6:14: storage.keep_slabs: found 99, allowed is 0 (keep every record) or 100 and more"});
  EXPECT_EQ(load(storage("keep_failed_slabs = 500\n")),
            Texts{"slabd.toml:6:21: storage.keep_failed_slabs: found with keep_slabs = 0, which keeps every record; "
                  "allowed only with a keep_slabs that limits them"});
  EXPECT_EQ(load(storage("keep_slabs = 500\nkeep_failed_slabs = 1000000001\n")).size(), 1U);
}

TEST_F(ConfigTest, only_one_or_two_threads_are_accepted) {
  for (const int threads : {1, 2}) {
    EXPECT_EQ(load(kShortest + ("[measure]\nthreads = " + std::to_string(threads) + "\n")), Texts{});
    EXPECT_EQ(config_.measure_threads, threads);
  }
  for (const std::string found : {"0", "3", "-1"})
    EXPECT_EQ(load(kShortest + ("[measure]\nthreads = " + found + "\n")),
              Texts{"slabd.toml:6:11: measure.threads: found " + found + ", allowed is a whole number 1..2"});
  EXPECT_EQ(load(std::string(kShortest) + "[measure]\nthread = 2\n"),
            Texts{"slabd.toml:6:1: measure.thread: unknown key; the nearest known one is \"threads\""});
}

TEST_F(ConfigTest, patterns_of_ids_are_compiled_when_they_are_read) {
  const auto line = [](const std::string& key) { return kShortest + ("[line]\n" + key + "\n"); };
  EXPECT_EQ(load(line("id_pattern = '(A|B)[0-9]{6}'\nmould_from_id = '^(?:A|B)([0-9]{2})'")), Texts{});
  EXPECT_EQ(load(line("id_pattern = 'A(0-9'")),
            Texts{"slabd.toml:6:14: line.id_pattern: found \"A(0-9\", which is not a regular expression: character 6: "
                  "the ) of a group is missing"});
  EXPECT_FALSE(config_.id_pattern);
  EXPECT_EQ(
      load(line("mould_from_id = 'M[0-9]+'")),
      Texts{"slabd.toml:6:17: line.mould_from_id: found \"M[0-9]+\" with 0 groups, allowed is one group ( ), which "
            "contains the number of the mould; (?: ) is not counted"});
  EXPECT_EQ(load(line("mould_from_id = '(A|B)([0-9]+)'")).size(), 1U);
  EXPECT_EQ(load(line("second_chip = 'always'")).size(), 1U);
  EXPECT_FALSE(config_.second_chip_required);
  EXPECT_FALSE(config_.mould_from_id);
  EXPECT_EQ(load(line("id_pattern = ''")),
            Texts{"slabd.toml:6:14: line.id_pattern: found \"\", allowed is text of 1..128 bytes"});
  EXPECT_EQ(load(line("id_pattern = '" + std::string(129, 'a') + "'")).size(), 1U);
}

TEST_F(ConfigTest, shortest_configuration_gets_the_documented_defaults) {
  EXPECT_EQ(load(kShortest), Texts{});
  EXPECT_EQ(config_.designs_dir, "") << "not the folder of the configuration";
  EXPECT_EQ(config_.plc.host.view(), "127.0.0.1");
  EXPECT_EQ(config_.plc.port, 1502);
  EXPECT_EQ(config_.plc.unit_id, 1);
  EXPECT_EQ(config_.plc.word_order, hal::WordOrder::abcd);
  ASSERT_EQ(config_.plc.allow.size(), 1U);
  EXPECT_EQ(config_.plc.allow[0].address, 0x7F00'0000U);
  EXPECT_EQ(config_.plc.allow[0].mask, 0xFF00'0000U);
  EXPECT_EQ(config_.robot.url.view(), "udpm://239.255.76.67:7667?ttl=0");
  EXPECT_EQ(config_.robot.channel.view(), "FLANGE_POSE");
  EXPECT_EQ(config_.pose.window_ns, 300'000'000);
  EXPECT_EQ(config_.pose.settled_rad, PoseSettings{}.settled_rad) << "a default keeps its bits";
  EXPECT_EQ(config_.scanner.drop_dir.view(), "/var/lib/slabd/drop");
  EXPECT_FALSE(config_.scanner.any_name);
  EXPECT_EQ(config_.scan_timeout_ns, 10'000'000'000);
  EXPECT_EQ(config_.settle_timeout_ns, 8'000'000'000);
  EXPECT_EQ(config_.storage.db_path, "/var/lib/slabd/slabd.db");
  EXPECT_EQ(config_.storage.spool_dir, "/var/lib/slabd/spool");
  EXPECT_EQ(config_.storage.spool_budget_bytes, 0U);
  EXPECT_EQ(config_.storage.keep_slabs, 0) << "nothing is taken away unasked";
  EXPECT_EQ(config_.recipes_dir, "/usr/share/slabd/recipes");
  EXPECT_EQ(config_.control_socket, "/run/slabd/control.sock");
  EXPECT_EQ(config_.measure_threads, config::default_measure_threads());
  EXPECT_FALSE(config_.simulation);
  EXPECT_FALSE(config_.id_pattern) << "any text is an id";
  EXPECT_FALSE(config_.mould_from_id);
  EXPECT_EQ(config_.T_base_slab.translation_mm, Vec3(1000, 0, 500));
  EXPECT_EQ(config_.calibration.T_flange_scanner.translation_mm, Vec3(0, 0, 120.5));
  EXPECT_EQ(config_.splice.repeatability_mm, 0.0);
  EXPECT_EQ(config_.splice.repeatability_rad, 0.0);
  EXPECT_FALSE(has_value(config_.splice.absolute_mm)) << "the error of a robot is not guessed";
  EXPECT_EQ(config_.splice.gate_mm, 1.0);
  EXPECT_EQ(config_.check_interval_us, 86'400'000'000);
  EXPECT_FALSE(has_value(config_.calibration.station_sigma_mm)) << "slab-frame items must come out indeterminate";
}

TEST_F(ConfigTest, every_key_is_taken) {
  EXPECT_EQ(load(kEveryKey), Texts{});
  EXPECT_EQ(config_.measure_threads, 1);
  EXPECT_EQ(config_.plc.host.view(), "10.1.2.3");
  EXPECT_EQ(config_.plc.port, 502);
  EXPECT_EQ(config_.plc.unit_id, 17);
  EXPECT_EQ(config_.plc.allow.size(), 2U);
  EXPECT_EQ(config_.plc.allow[1].address, 0xC0A8'0107U);
  ASSERT_EQ(config_.plc.read_only.size(), 1U);
  EXPECT_EQ(config_.plc.read_only[0].address, 0x0A09'0000U);
  EXPECT_EQ(config_.plc.word_order, hal::WordOrder::cdab);
  EXPECT_EQ(config_.robot.url.view(), "udpm://239.255.76.99:7777?ttl=1");
  EXPECT_EQ(config_.robot.channel.view(), "POSE");
  EXPECT_EQ(config_.robot.interface.view(), "eth1");
  EXPECT_EQ(config_.pose.window_ns, 400'000'000);
  EXPECT_EQ(config_.pose.samples_min, 30);
  EXPECT_EQ(config_.pose.settled_mm, 0.05);
  EXPECT_DOUBLE_EQ(config_.pose.settled_rad, rad_from_deg(0.004));
  EXPECT_EQ(config_.pose.dwell_ns, 250'000'000);
  EXPECT_EQ(config_.pose.moved_mm, 0.1);
  EXPECT_DOUBLE_EQ(config_.pose.moved_rad, rad_from_deg(0.006));
  EXPECT_EQ(config_.pose.stale_ns, 150'000'000);
  EXPECT_EQ(config_.pose.gap_us, 50'500);
  EXPECT_EQ(config_.pose.base_id, -1);
  EXPECT_EQ(config_.pose.tool_id, 3);
  EXPECT_EQ(config_.splice.repeatability_mm, 0.017);
  EXPECT_DOUBLE_EQ(config_.splice.repeatability_rad, rad_from_deg(0.002));
  EXPECT_EQ(config_.splice.absolute_mm, 0.7);
  EXPECT_DOUBLE_EQ(config_.splice.absolute_rad, rad_from_deg(0.03));
  EXPECT_EQ(config_.pose.look_mm, 100.0);
  EXPECT_EQ(config_.settle_timeout_ns, 6'000'000'000);
  EXPECT_EQ(config_.scanner.drop_dir.view(), "/srv/drop");
  EXPECT_TRUE(config_.scanner.any_name);
  EXPECT_EQ(config_.scanner.form.unit, hal::LengthUnit::um);
  EXPECT_EQ(config_.scanner.form.columns.xyz[2].view(), "PosZ");
  EXPECT_EQ(config_.scan_timeout_ns, 12'500'000'000);
  EXPECT_EQ(config_.storage.db_path, "/srv/slabd.db");
  EXPECT_EQ(config_.storage.spool_dir, "/srv/spool");
  EXPECT_EQ(config_.storage.spool_budget_bytes, 500'000'000'000U);
  EXPECT_EQ(config_.storage.keep_slabs, 20'000);
  EXPECT_EQ(config_.storage.keep_failed_slabs, 50'000);
  EXPECT_EQ(config_.recipes_dir, "/srv/recipes");
  EXPECT_EQ(config_.T_base_slab.rotation.z(), -1.0);
  EXPECT_EQ(config_.calibration.station_sigma_mm, 0.02);
  EXPECT_DOUBLE_EQ(config_.calibration.station_sigma_rad, rad_from_deg(0.001));
  EXPECT_EQ(config_.splice.commissioning_mm, 0.02);
  EXPECT_DOUBLE_EQ(config_.splice.commissioning_rad, rad_from_deg(0.001));
  EXPECT_EQ(config_.splice.gate_mm, 0.8);
  EXPECT_DOUBLE_EQ(config_.splice.gate_rad, rad_from_deg(0.04));
  EXPECT_EQ(config_.check_interval_us, 12 * 3'600'000'000LL);
  EXPECT_DOUBLE_EQ(config_.check_limits.slope_rad, rad_from_deg(0.02));
  EXPECT_EQ(config_.check_limits.jaw_distance_mm, 0.1);
  EXPECT_EQ(config_.calibration_valid_days, 180);
  EXPECT_EQ(config_.scanner_drift.per_K, 3e-6);
  EXPECT_EQ(config_.scanner_drift.range_K, 8.0);
  EXPECT_EQ(config_.warm_up.views_min, 8);
  EXPECT_EQ(config_.warm_up.window_s, 720.0);
  EXPECT_EQ(config_.warm_up_every_s, 30.0);
  EXPECT_EQ(config_.warm_up.centre_um_per_h, 15.0);
  EXPECT_EQ(config_.warm_up.radius_um_per_h, 25.0);
  EXPECT_EQ(config_.warm_up_give_up_min, 60.0);
  EXPECT_EQ(config_.capture.stable_mm, 0.02);
  EXPECT_NEAR(deg_from_rad(config_.capture.stable_rad), 0.002, 1e-12);
  EXPECT_EQ(config_.capture.stable_ns, 500'000'000);
  EXPECT_TRUE(config_.capture.is_wider());
  EXPECT_EQ(config_.control_socket, "/srv/control.sock");
  EXPECT_TRUE(config_.simulation);
  ASSERT_TRUE(config_.id_pattern && config_.mould_from_id);
  EXPECT_TRUE(config_.id_pattern->matches("C3-0001"));
  EXPECT_EQ(config_.mould_from_id->first_group("S-M12"), "12");
  EXPECT_TRUE(config_.second_chip_required);
  EXPECT_EQ(config_.project, "Line 7");
}

TEST_F(ConfigTest, all_faults_are_reported_with_line_column_key_and_range) {
  const Texts problems = load(
      "[plc]\n"
      "unitid = 3\n"
      "listen = \"127.0.0.1:99999\"\n"
      "unit_id = 300\n"
      "allow = [\"10.0.0.0/8\", 7]\n"
      "word_order = \"badc\"\n"
      "[robot]\n"
      "settled_mm = \"small\"\n"
      "samples_min = 20.5\n"
      "[scanner]\n"
      "drop_dir = \"\"\n"
      "any_name = 1\n"
      "[storage]\n"
      "spool_budget_gb = 1\n"
      "[cell]\n"
      "T_base_slab = [0, 0, 0, 1, 1, 0, 0]\n"
      "[calibration]\n"
      "T_flange_scanner = [0, 0, 5000, 1, 0, 0, 0]\n"
      "station_sigma_mm = -1\n"
      "[recepies]\n"
      "dir = \"/x\"\n");
  const Texts expected = {
      "slabd.toml:4:11: plc.unit_id: found 300, allowed is a whole number 1..247",
      "slabd.toml:6:14: plc.word_order: found \"badc\", allowed is \"abcd\" or \"cdab\"",
      "slabd.toml:3:10: plc.listen: found \"127.0.0.1:99999\", allowed is \"address:port\" with port 0..65535",
      "slabd.toml:5:24: plc.allow: found 7, allowed is a network like \"10.0.0.0/8\"",
      "slabd.toml:2:1: plc.unitid: unknown key; the nearest known one is \"unit_id\"",
      "slabd.toml:9:15: robot.samples_min: found 20.5, allowed is a whole number 3..300",
      "slabd.toml:8:14: robot.settled_mm: found \"small\", allowed is a number 0.001..1",
      "slabd.toml:11:12: scanner.drop_dir: found \"\", allowed is text of 1..192 bytes",
      "slabd.toml:12:12: scanner.any_name: found 1, allowed is true or false",
      "slabd.toml:14:19: storage.spool_budget_gb: found 1, allowed is 0 (keep every scan) or 3..100000; a slab's scans "
      "are 1.1 GB",
      "slabd.toml:16:15: cell.T_base_slab: the quaternion (qw, qx, qy, qz) has length 1.414214, allowed is 1 within "
      "0.001",
      "slabd.toml:18:27: calibration.T_flange_scanner: number 3 of 7: found 5000, allowed is -2000..2000",
      "slabd.toml:19:20: calibration.station_sigma_mm: found -1, allowed is a number 1e-06..10",
      "slabd.toml:19:20: calibration.station_sigma_mm: found without station_sigma_deg; allowed are both or neither",
      "slabd.toml:20:2: recepies: unknown key; the nearest known one is \"recipes\"",
  };
  EXPECT_EQ(problems, expected);
}

TEST_F(ConfigTest, a_number_with_a_point_is_shown_with_one) {
  EXPECT_EQ(load(std::string(kShortest) + "[robot]\nsamples_min = 20.0\n"),
            Texts{"slabd.toml:6:15: robot.samples_min: found 20.0, allowed is a whole number 3..300"});
}

TEST_F(ConfigTest, slabs_are_whole) {
  const auto storage = [](const std::string& keys) { return kShortest + ("[storage]\n" + keys); };
  EXPECT_EQ(load(storage("keep_slabs = 2e4\n")), Texts{});
  EXPECT_EQ(config_.storage.keep_slabs, 20'000);
  EXPECT_EQ(load(storage("keep_slabs = 1000.7\n")),
            Texts{"slabd.toml:6:14: storage.keep_slabs: found 1000.7, allowed is a whole number"});
  EXPECT_EQ(load(storage("keep_slabs = 1000\nkeep_failed_slabs = 100.5\n")),
            Texts{"slabd.toml:7:21: storage.keep_failed_slabs: found 100.5, allowed is a whole number"});
}

TEST_F(ConfigTest, one_half_of_an_uncertainty_is_refused) {
  EXPECT_EQ(load(std::string(kShortest) + "station_sigma_mm = 0.02\n"),
            Texts{"slabd.toml:5:20: calibration.station_sigma_mm: found without station_sigma_deg; allowed are both or "
                  "neither"});
  EXPECT_EQ(load(std::string(kShortest) + "station_sigma_deg = 0.001\n"),
            Texts{"slabd.toml:5:21: calibration.station_sigma_deg: found without station_sigma_mm; allowed are both or "
                  "neither"});
  // They may remain when the commissioning value is removed because a calibration has been applied.
  EXPECT_EQ(load("[cell]\nT_base_slab = [0,0,0,1,0,0,0]\n[calibration]\nstation_sigma_mm = 0.02\n"), Texts{});
}

TEST_F(ConfigTest, two_do_not_listen_at_one_place) {
  const auto listeners = [](const std::string& plc, const std::string& scanner) {
    return kShortest +
           ("[plc]\nlisten = \"" + plc + "\"\n[scanner]\nbackend = \"tcp\"\nlisten = \"" + scanner + "\"\n");
  };
  for (const char* plc : {"127.0.0.1:1600", "0.0.0.0:1600"})
    EXPECT_EQ(load(listeners(plc, "127.0.0.1:1600")),
              Texts{"slabd.toml:9:10: scanner.listen: found \"127.0.0.1:1600\", where the PLC is listened for already "
                    "(plc.listen); allowed is another port"});
  EXPECT_EQ(load(listeners("127.0.0.1:1600", "0.0.0.0:1600")).size(), 1U);
  EXPECT_EQ(load(listeners("127.0.0.1:1600", "127.0.0.2:1600")), Texts{});
  EXPECT_EQ(load(listeners("127.0.0.1:1601", "127.0.0.1:1600")), Texts{});
  EXPECT_EQ(load(kShortest + std::string("[plc]\nrole = \"client\"\nconnect = \"127.0.0.1:1600\"\n[scanner]\nbackend = "
                                         "\"tcp\"\nlisten = \"127.0.0.1:1600\"\n")),
            Texts{});
}

TEST_F(ConfigTest, a_file_cannot_be_a_folder_or_another_file) {
  const auto places = [](const std::string& db, const std::string& spool, const std::string& socket) {
    return kShortest +
           ("[storage]\ndb = \"" + db + "\"\nspool_dir = \"" + spool + "\"\n[control]\nsocket = \"" + socket + "\"\n");
  };
  EXPECT_EQ(load(places("/srv/slabd.db", "/srv/slabd", "/run/s.sock")), Texts{});
  for (const char* spool : {"/srv/x", "/srv/y/../x/", "/srv/x/spool"}) {
    const Texts texts = load(places("/srv/x", spool, "/run/s.sock"));
    ASSERT_EQ(texts.size(), 1U) << spool;
    EXPECT_TRUE(
        texts[0].starts_with("slabd.toml:6:6: storage.db: found /srv/x, which is a file and cannot be or hold "
                             "/srv/"))
        << texts[0];
  }
  EXPECT_EQ(load(places("/srv/x", "/srv/spool", "/srv/x")),
            Texts{"slabd.toml:9:10: control.socket: found /srv/x, which is a file and cannot be or hold /srv/x "
                  "(storage.db); allowed is another place"});
  EXPECT_EQ(load(places("/srv/slabd.db", "/srv/spool", "/srv/spool")).size(), 1U);
  for (const char* side : {"-wal", "-shm", ".writer"})
    EXPECT_EQ(load(places("/srv/x", "/srv/spool", std::string("/srv/x") + side)),
              Texts{std::string("slabd.toml:9:10: control.socket: found /srv/x") + side +
                    ", which is the name of a file that belongs to storage.db; allowed is another place"});
}

TEST_F(ConfigTest, text_that_nests_too_deeply_is_refused_before_it_is_parsed) {
  const std::string why = ": keys or brackets nest deeper than 32 levels; this is not a configuration";
  std::string key = "a";
  for (int i = 0; i < 40'000; ++i) key += ".a";
  for (const std::string& deep : {key + " = 1", "[" + key + "]", "x = { " + key + " = 1 }",
                                  "x = " + std::string(40'000, '['), "x = " + std::string(40'000, '{')})
    EXPECT_EQ(load("[plc]\nlisten = \"0.0.0.0:1602\"\n" + deep + "\n"), Texts{"slabd.toml:3:1" + why});
  EXPECT_EQ(config_.plc.port, 1602) << "what stands above it counts";
  // Dots in texts, comments and numbers do not nest.
  const std::string dots(200, '.');
  std::string numbers = "[";
  for (int i = 0; i < 100; ++i) numbers += "0.5, ";
  const Texts texts = load(std::string(kShortest) + "[x]\na = \"" + dots + "\\\"" + dots + "\" # " + dots + "\nb = '" +
                           dots + "'\nc = \"\"\"\n\"\n" + dots + "\"\"\"\"\"\nd = " + numbers + "]\n");
  EXPECT_EQ(texts.size(), 1U) << "only that [x] is not known";
}

TEST_F(ConfigTest, a_problem_is_one_line_that_a_terminal_may_show) {
  EXPECT_EQ(load(std::string(kShortest) + "[plc]\nword_order = \"\\u001b[31mr\\u00f6t\\u009b\\n\"\n\"k\\ney\" = 1\n"),
            (Texts{"slabd.toml:6:14: plc.word_order: found \"\\x1B[31mr\xC3\xB6t\\x9B\\x0A\", allowed is \"abcd\" or "
                   "\"cdab\"",
                   "slabd.toml:7:1: plc.k\\x0Aey: unknown key; the nearest known one is \"baud\""}));
}

TEST_F(ConfigTest, the_plc_may_be_polled) {
  const std::string start = kShortest;
  EXPECT_EQ(load(start + "[plc]\nrole = \"client\"\nconnect = \"10.0.0.5:502\"\nunit_id = 255\ncommand_base = 500\n"
                         "status_base = 600\nread_write = true\npoll_ms = 20\ntimeout_ms = 250\nregisters_max = 48\n"
                         "keep_connection = false\n"),
            Texts{});
  EXPECT_EQ(config_.plc.role, hal::PlcRole::client);
  EXPECT_EQ(config_.plc.host.view(), "10.0.0.5");
  EXPECT_EQ(config_.plc.port, 502);
  EXPECT_EQ(config_.plc.unit_id, 255);
  EXPECT_EQ(config_.plc.command_base, 500);
  EXPECT_EQ(config_.plc.status_base, 600);
  EXPECT_TRUE(config_.plc.read_write);
  EXPECT_EQ(config_.plc.registers_max, 48);
  EXPECT_FALSE(config_.plc.keep_connection);
  EXPECT_EQ(config_.plc.poll_ns, 20'000'000);
  EXPECT_EQ(config_.plc.timeout_ns, 250'000'000);

  EXPECT_EQ(load(start + "[plc]\nrole = \"client\"\n"),
            Texts{"slabd.toml:5:1: plc.connect: missing; expected the PLC, \"address:port\""});
  EXPECT_EQ(
      load(start + "[plc]\nrole = \"client\"\nconnect = \"plc:0\"\nunit_id = 250\nstatus_base = 30\npoll_ms = 1\n"),
      (Texts{"slabd.toml:8:11: plc.unit_id: found 250, allowed is 0..247 or 255",
             "slabd.toml:7:11: plc.connect: found \"plc:0\", allowed is \"address:port\" with port 1..65535",
             "slabd.toml:9:15: plc.status_base: the 110 registers from 30 on and the 40 of command_base = 0 overlap",
             "slabd.toml:10:11: plc.poll_ms: found 1, allowed is a number 10..500"}));
  EXPECT_EQ(
      load(start + "[plc]\nrole = \"client\"\nconnect = \"plc:502\"\n"),
      Texts{"slabd.toml:7:11: plc.connect: found \"plc:502\", allowed is an IPv4 address before the port, such as "
            "127.0.0.1"});
}

TEST_F(ConfigTest, the_plc_may_sit_on_a_serial_line) {
  const std::string start = kShortest;
  EXPECT_EQ(load(start + "[plc]\nrole = \"rtu\"\ndevice = \"/dev/ttyS1\"\n"), Texts{});
  EXPECT_EQ(config_.plc.unit_id, 17);
  EXPECT_EQ(config_.plc.baud, 115'200U);
  EXPECT_EQ(config_.plc.parity, hal::SerialParity::even);
  EXPECT_EQ(config_.plc.stop_bits, 1);
  EXPECT_FALSE(config_.plc.rs485);
  EXPECT_EQ(load(start + "[plc]\nrole = \"rtu\"\ndevice = \"/dev/ttyS1\"\nunit_id = 3\nbaud = 19200\n"
                         "parity = \"none\"\nstop_bits = 2\nrs485 = true\n"),
            Texts{});
  EXPECT_EQ(config_.plc.unit_id, 3);
  EXPECT_EQ(config_.plc.baud, 19'200U);
  EXPECT_EQ(config_.plc.parity, hal::SerialParity::none);
  EXPECT_EQ(config_.plc.stop_bits, 2);
  EXPECT_TRUE(config_.plc.rs485);

  EXPECT_EQ(load(start + "[plc]\nrole = \"rtu\"\n"),
            Texts{"slabd.toml:5:1: plc.device: missing; expected the serial line, such as \"/dev/ttyS0\""});
  EXPECT_EQ(
      load(start + "[plc]\nrole = \"rtu\"\ndevice = \"COM1\"\nbaud = 14400\nparity = \"E\"\nstop_bits = 3\n"),
      (Texts{"slabd.toml:7:10: plc.device: found \"COM1\", allowed is a path such as \"/dev/ttyS0\"",
             "slabd.toml:8:8: plc.baud: found 14400, allowed are 1200, 2400, 4800, 9600, 19200, 38400, 57600, 115200",
             "slabd.toml:9:10: plc.parity: found \"E\", allowed is \"even\" or \"odd\" or \"none\"",
             "slabd.toml:10:13: plc.stop_bits: found 3, allowed is a whole number 1..2"}));
}

TEST_F(ConfigTest, a_key_of_another_role_is_refused_by_name) {
  const std::string start = kShortest;
  EXPECT_EQ(
      load(start + "[plc]\nbaud = 9600\nconnect = \"10.0.0.5:502\"\n"),
      (Texts{"slabd.toml:7:11: plc.connect: has no meaning with role = \"server\"; it belongs to role = \"client\"",
             "slabd.toml:6:8: plc.baud: has no meaning with role = \"server\"; it belongs to role = \"rtu\""}));
  EXPECT_EQ(load(start + "[plc]\nrole = \"rtu\"\ndevice = \"/dev/ttyS0\"\nlisten = \"0.0.0.0:502\"\n"),
            Texts{"slabd.toml:8:10: plc.listen: has no meaning with role = \"rtu\"; it belongs to role = \"server\""});
  EXPECT_EQ(load(start + "[plc]\nrole = \"slave\"\n"),
            Texts{"slabd.toml:6:8: plc.role: found \"slave\", allowed is \"server\" or \"client\" or \"rtu\""});
}

TEST_F(ConfigTest, values_that_this_version_does_not_support_are_named) {
  const std::string start = kShortest;
  EXPECT_EQ(load(start + "[scanner]\nbackend = \"gige\"\n"),
            Texts{"slabd.toml:6:11: scanner.backend: found \"gige\", allowed is \"drop\" or \"tcp\""});
  EXPECT_EQ(load(start + "[robot]\nlcm_url = \"tcp://host\"\n"),
            Texts{"slabd.toml:6:11: robot.lcm_url: found \"tcp://host\", allowed is \"udpm://group:port?ttl=n\""});
}

TEST_F(ConfigTest, scans_may_come_over_tcp) {
  const std::string start = kShortest;
  EXPECT_EQ(load(start + "[scanner]\nbackend = \"tcp\"\nlisten = \"10.1.2.3:1600\"\nallow = [\"10.1.2.30\"]\n"),
            Texts{});
  EXPECT_EQ(config_.scanner_backend, hal::ScannerBackend::tcp);
  EXPECT_EQ(config_.stream.host.view(), "10.1.2.3");
  EXPECT_EQ(config_.stream.port, 1600);
  ASSERT_EQ(config_.stream.allow.size(), 1U);
  EXPECT_EQ(config_.stream.allow[0].address, 0x0A01'021EU);
  EXPECT_EQ(config_.scanner.form.unit, hal::LengthUnit::mm) << "what lies in the spool";
  EXPECT_EQ(load(start + "[scanner]\nbackend = \"tcp\"\nunit = \"m\"\n"),
            Texts{"slabd.toml:7:8: scanner.unit: backend = \"tcp\" does not use it: each scan carries its request and "
                  "its unit"});
  EXPECT_EQ(load(start + "[scanner]\nbackend = \"tcp\"\ncolumns = \"2,3,4\"\n").size(), 1U);
  EXPECT_EQ(load(start + "[scanner]\nlisten = \"10.1.2.3:1600\"\n").size(), 1U);
}

TEST_F(ConfigTest, columns_of_tables_are_three_names_or_numbers) {
  const std::string start = kShortest;
  EXPECT_EQ(load(start + "[scanner]\ncolumns = \"2,3,4\"\n"), Texts{});
  EXPECT_EQ(config_.scanner.form.columns.xyz[0].view(), "2");
  EXPECT_EQ(load(start + "[scanner]\ncolumns = \"2,3\"\n"),
            Texts{"slabd.toml:6:11: scanner.columns: columns \"2,3\": expected are three names or numbers with commas "
                  "between, as in 2,3,4"});
}

TEST_F(ConfigTest, pose_type_and_permitted_senders_are_configured) {
  const std::string start = kShortest;
  EXPECT_EQ(load(start + "[pose]\ntype = \"bot_core.rigid_transform_t\"\nsenders = [\"192.168.10.2\"]\n"), Texts{});
  EXPECT_EQ(config_.robot.type, hal::PoseType::rigid_transform);
  ASSERT_EQ(config_.robot.senders.size(), 1U);
  EXPECT_EQ(config_.robot.senders[0].mask, 0xFFFF'FFFFU);
  EXPECT_EQ(load(start + "[pose]\ntype = \"bot_core.pose_t\"\n"),
            Texts{"slabd.toml:6:8: pose.type: found \"bot_core.pose_t\", allowed is \"slabd.flange_pose_t\" or "
                  "\"bot_core.rigid_transform_t\""});
  const Texts blind = load(start + "[robot]\ntool_id = 3\n[pose]\ntype = \"bot_core.rigid_transform_t\"\n");
  ASSERT_EQ(blind.size(), 1U);
  EXPECT_NE(blind[0].find("does not say which base and tool"), std::string::npos) << blind[0];
}

TEST_F(ConfigTest, poses_must_be_there) {
  EXPECT_EQ(load("[cell]\n"),
            (Texts{"slabd.toml:1:1: cell.T_base_slab: missing; expected seven numbers [x, y, z, qw, qx, qy, qz], x y z "
                   "in mm and within +-20000"}));
}

TEST_F(ConfigTest, without_commissioning_values_slabs_wait_for_an_applied_calibration) {
  EXPECT_EQ(load("[cell]\nT_base_slab = [0,0,0,1,0,0,0]\n"), Texts{});
  EXPECT_TRUE(config_.calibration.id.empty());
  EXPECT_FALSE(has_value(config_.splice.commissioning_mm));
}

TEST_F(ConfigTest, values_in_another_unit_are_reported_with_line_key_and_range) {
  const auto doubts = [&](const std::string& text) {
    EXPECT_EQ(load(text), Texts{}) << text;
    Texts texts;
    for (const config::Problem& doubt : config_.doubts)
      texts.push_back(doubt.text.substr(doubt.text.rfind("slabd.toml")));
    return texts;
  };
  EXPECT_EQ(doubts(kShortest), Texts{});
  EXPECT_EQ(doubts("[cell]\nT_base_slab = [0, 0, 0, 1, 0, 0, 0]\n"), Texts{}) << "not entered, as on a test bench";
  EXPECT_EQ(doubts("[cell]\nT_base_slab = [1.5, 0.2, 0.57, 1, 0, 0, 0]\n"),
            Texts{"slabd.toml:2:15: cell.T_base_slab: found x, y, z of at most 1.5 mm, metres? The centre of a slab is "
                  "hardly in the robot's foot; the unit is mm, allowed is -20000..20000"});
  EXPECT_EQ(doubts("[cell]\nT_base_slab = [1500, 200, 570, 1, 0, 0, 0]\n[calibration]\n"
                   "T_flange_scanner = [0.06, -0.01, 0.2, 1, 0, 0, 0]\n"),
            Texts{"slabd.toml:4:20: calibration.T_flange_scanner: found x, y, z of at most 0.2 mm, metres? The origin "
                  "of a scanner is hardly in the flange; the unit is mm, allowed is -2000..2000"});
  EXPECT_EQ(doubts("[cell]\nT_base_slab = [1500, 200, 570, 0, 0, 0, 1]\n"),
            Texts{"slabd.toml:2:15: cell.T_base_slab: found the quaternion (0, 0, 0, 1), which is half a turn about z: "
                  "written as qx, qy, qz, qw? The order is qw, qx, qy, qz, allowed is any of unit length"});
  EXPECT_EQ(
      doubts(std::string(kShortest) + "station_gate_deg = 0.0087266\n[robot]\nabsolute_sigma_mm = 0.0007\n"),
      (Texts{"slabd.toml:7:21: robot.absolute_sigma_mm: found 0.0007, metres? the unit is mm, allowed is 1e-06..10",
             "slabd.toml:5:20: calibration.station_gate_deg: found 0.0087266, which is 0.5 deg in radians; the unit "
             "is degrees, allowed is 0.001..1"}));
  EXPECT_EQ(doubts(std::string(kShortest) + "[scanner]\ndrop_dir = \"//scanpc/slabd\"\n").size(), 1U);
  EXPECT_EQ(doubts(std::string(kShortest) + "[scanner]\ndrop_dir = '/mnt/scans\\today'\n").size(), 1U);
}

TEST_F(ConfigTest, a_path_of_windows_is_refused) {
  for (const char* path : {"C:\\scans", "c:/scans", "D:", "\\\\scanpc\\slabd"})
    EXPECT_EQ(
        load(std::string(kShortest) + "[scanner]\ndrop_dir = '" + path + "'\n"),
        Texts{"slabd.toml:6:12: scanner.drop_dir: found \"" + std::string(path) +
              "\", a path of Windows; allowed is a path of this computer, such as /mnt/scanner/drop: mount a share of "
              "another computer first (docs/DELIVERY.md)"})
        << path;
}

TEST_F(ConfigTest, quaternion_within_a_thousandth_is_taken_and_normalised) {
  EXPECT_EQ(load("[cell]\nT_base_slab = [0,0,0,0.9995,0,0,0]\n[calibration]\nT_flange_scanner=[0,0,0,1,0,0,0]\n"),
            Texts{});
  EXPECT_DOUBLE_EQ(config_.T_base_slab.rotation.norm(), 1.0);
  EXPECT_EQ(
      load("[cell]\nT_base_slab = [0,0,0,0.9985,0,0,0]\n[calibration]\nT_flange_scanner=[0,0,0,1,0,0,0]\n").size(), 1U);
  EXPECT_EQ(load("[cell]\nT_base_slab = [nan,0,0,1,0,0,0]\n[calibration]\nT_flange_scanner=[0,0,0,1,0,0,0]\n"),
            Texts{"slabd.toml:2:16: cell.T_base_slab: number 1 of 7: found nan, allowed is -20000..20000"});
}

TEST_F(ConfigTest, scan_must_end_before_the_plc_gives_up) {
  EXPECT_EQ(load(std::string(kShortest) + "[robot]\nsettle_timeout_s = 10\n[scanner]\ntimeout_s = 10\n"),
            Texts{"slabd.toml:8:13: scanner.timeout_s: with robot.settle_timeout_s a scan may take 20 s, allowed are "
                  "19 s: the PLC gives up after 20 s"});
}

TEST_F(ConfigTest, standstill_must_fit_into_the_poses_that_are_remembered) {
  const std::string start = std::string(kShortest) + "[robot]\n";
  const std::string why =
      ", allowed are 1500 ms: the daemon remembers 2 s of poses, and a longer standstill would never be seen";
  EXPECT_EQ(load(start + "window_ms = 1000\ndwell_ms = 500\n"), Texts{});
  EXPECT_EQ(load(start + "window_ms = 1000\ndwell_ms = 501\n"),
            Texts{"slabd.toml:7:12: robot.dwell_ms: window_ms and dwell_ms together are 1501 ms" + why});
  EXPECT_EQ(load(start + "window_ms = 1400\n"),
            Texts{"slabd.toml:6:13: robot.window_ms: window_ms and dwell_ms together are 1600 ms" + why})
      << "the dwell counts by its default";
  EXPECT_EQ(load(start + "dwell_ms = 1501\n"),
            Texts{"slabd.toml:6:12: robot.dwell_ms: found 1501, allowed is a number 0..1500"});
  EXPECT_EQ(load(start + "samples_min = 301\n"),
            Texts{"slabd.toml:6:15: robot.samples_min: found 301, allowed is a whole number 3..300"});
}

TEST_F(ConfigTest, plc_table_is_filled_in_when_other_tables_are_faulty) {
  EXPECT_FALSE(load("[plc]\nlisten = \"0.0.0.0:1602\"\nunit_id = 9\n[cell]\nT_base_slab = 5\n").empty());
  EXPECT_EQ(config_.plc.port, 1602);
  EXPECT_EQ(config_.plc.unit_id, 9);
}

TEST_F(ConfigTest, plc_table_above_a_syntax_error_is_filled_in) {
  const Texts problems = load("[plc]\nlisten = \"0.0.0.0:1602\"\n[cell\nT_base_slab = 5\n");
  ASSERT_EQ(problems.size(), 1U) << "what is missing because of the syntax error is not reported on top";
  EXPECT_TRUE(problems[0].starts_with("slabd.toml:3:6: not valid TOML: ")) << problems[0];
  EXPECT_EQ(config_.plc.port, 1602);
}

TEST_F(ConfigTest, unreadable_files_are_named) {
  std::vector<config::Problem> problems;
  config::load_config(files_.folder() + "/none.toml", config_, problems);
  config::load_config(files_.folder(), config_, problems);
  config::load_config(files_.write("huge.toml", std::string(kTomlBytesMax + 1, '#')), config_, problems);
  EXPECT_EQ(files_.texts(problems),
            (Texts{"none.toml: cannot be read: no such file", files_.folder() + ": not a regular file",
                   "huge.toml: longer than 1000000 bytes, the most that are allowed here"}));
  problems.clear();
  config::load_config(files_.write("large.toml", kShortest + std::string(900'000, '#')), config_, problems);
  EXPECT_TRUE(problems.empty());
}

TEST_F(ConfigTest, damaged_bytes_never_escape_as_an_exception) {
  const std::string good = kEveryKey;
  Prng prng(7);
  int faulty = 0;
  for (int i = 0; i < 3000; ++i) {
    std::string text = good;
    const std::uint64_t hits = 1 + prng.below(4);
    for (std::uint64_t h = 0; h < hits; ++h) text[prng.below(text.size())] = static_cast<char>(prng.below(256));
    if (prng.below(4) == 0) text.resize(prng.below(text.size()));
    std::vector<config::Problem> problems;
    config::load_config(files_.write("slabd.toml", text), config_, problems);
    faulty += problems.empty() ? 0 : 1;
    for (const config::Problem& problem : problems) EXPECT_NE(problem.text.find("slabd.toml:"), std::string::npos);
  }
  EXPECT_GT(faulty, 1000);
}

TEST_F(ConfigTest, installed_example_is_valid) {
  std::vector<config::Problem> problems;
  config::load_config(places::source_dir() + "/systemd/slabd.toml", config_, problems);
  EXPECT_EQ(files_.texts(problems), Texts{});
}

TEST(EditDistance, agrees_with_its_definition) {
  // Recursive definition.
  struct Slow {
    static std::size_t distance(std::string_view a, std::string_view b) {
      if (a.empty()) return b.size();
      if (b.empty()) return a.size();
      const std::size_t same = distance(a.substr(1), b.substr(1)) + (a[0] == b[0] ? 0 : 1);
      return std::min({same, distance(a.substr(1), b) + 1, distance(a, b.substr(1)) + 1});
    }
  };
  Prng prng(3);
  for (int i = 0; i < 300; ++i) {
    std::string a(prng.below(6), ' ');
    std::string b(prng.below(6), ' ');
    for (char& c : a) c = static_cast<char>('a' + prng.below(3));
    for (char& c : b) c = static_cast<char>('a' + prng.below(3));
    EXPECT_EQ(config::edit_distance(a, b), Slow::distance(a, b)) << a << " " << b;
  }
  EXPECT_EQ(nearest("unitid", {"listen", "role", "unit_id"}), "unit_id");
  EXPECT_EQ(nearest("x", {}), "");
}

}  // namespace
}  // namespace slabd::config
