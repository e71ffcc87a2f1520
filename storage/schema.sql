-- SPDX-License-Identifier: Apache-2.0
--
-- slabd's database, schema version 1. One daemon writes; other programs only read.
--
--   line     one row: the session number last used, the newest wall clock of any record, what retention took away
--   care     when the history was restored from a backup or begun again, by whom and why
--   slab     the values of SLAB_BEGIN and what it was measured with; slab_result is its end (no row: still open)
--   slab_arm  the same of the robots and scanners after the first
--   command  the journal of accepted commands; id is their order
--   attempt  one SCAN of one station; the highest attempt of a station is the valid one, all are kept
--   recipe_text  the files of all recipes that a slab was begun with
--   seen_scan  fingerprints of the last scans' points
--   noise_print  the noise of the last exposures that were measured
--   block    what an attempt measured, with its planes, casings, findings, edges and items
--   map      its deviation from the model, and its seat from the fitted plane, place by place: what a report draws
--   result   the records the PLC is shown; id is the order in which it is shown them
--   slab_seal  the chain of checksums over what is stored of each ended slab
--
--   calibration        every calibration ever kept, with what it was made from; its numbers are in hand_eye,
--                      station_correction, reference_block, monitor_ball, scanner_acceptance or tie_numbers
--   applied            what was put in force when, by whom and why; the newest row of a kind (and slab type) counts
--   calibration_check  the trend of the daily checks
--   gauge_value        what the gauges gave for a slab; gauge_check  when a gauge was checked with its master
--   mould_reset        when a mould was adjusted, by whom and why: a new epoch of its statistics
--
--   event    starts of slabd, and faults that began and ended
--   outbox   what the plant's database is sent, in order; triggers add a row in the transaction of what it is about
--   epoch    the life of this file: a history that was restored from a backup or begun again has a new one
--
-- Lengths in mm, angles in degrees for items, times of day in us since 1970 (utime_us), durations in ms. Rows are
-- ordered by key or id, never by the wall clock. A number that could not be measured is NULL. Verdicts: none, pass,
-- fail, not_measured, aborted, indeterminate. Covariances are whole matrices: _12 is row 1, column 2.
--
-- A change of this file needs the next version number (kSchemaVersion), a step from the version before
-- (storage/schema.cpp.in) and a copy of the old text for the tests. A column that a step adds has a DEFAULT in both: the
-- value of older rows. A step never changes a column that a form of storage/seals.cpp names in an existing row,
-- because the slab would look altered; a new column belongs to a new form.

CREATE TABLE line (
  id              INTEGER PRIMARY KEY CHECK (id = 1),
  session         INTEGER NOT NULL CHECK (session BETWEEN 0 AND 65535),
  newest_utime_us INTEGER NOT NULL,
  keys_used       INTEGER NOT NULL,        -- slab keys up to here may have been used, whatever table slab contains
  pruned_slabs    INTEGER NOT NULL,        -- taken away by retention,
  pruned_key      INTEGER NOT NULL,        -- the newest of them
  sent_seq        INTEGER NOT NULL         -- the plant's database has outbox rows up to here
) STRICT;
INSERT INTO line VALUES (1, 0, 0, 0, 0, 0, 0);

CREATE TABLE slab (
  slab_key           INTEGER PRIMARY KEY CHECK (slab_key > 0),
  slab_id            TEXT NOT NULL,
  slab_no            INTEGER NOT NULL,
  slab_type          INTEGER NOT NULL,
  stations           INTEGER NOT NULL CHECK (stations BETWEEN 1 AND 18),
  temperature_dk     INTEGER NOT NULL,   -- 0.1 K, 0 = unknown
  age_h              INTEGER NOT NULL,   -- hours, 0 = unknown
  mould              INTEGER NOT NULL DEFAULT 0,  -- number of the mould that cast it, 0 = unknown
  recipe             TEXT NOT NULL,
  recipe_sha256      TEXT NOT NULL,
  design_sha256      TEXT NOT NULL,      -- of the next column, empty: as the recipe says
  design_text        TEXT NOT NULL,      -- station,dx_mm,dy_mm,dz_mm,dslope_deg; of each seat
  unconfirmed        INTEGER NOT NULL,   -- nominals and tolerances that were not confirmed
  guard              REAL,               -- guard band in units of U, 0 = simple acceptance
  cell_mm            REAL,               -- flatness cell
  calibration_id     TEXT NOT NULL,
  stations_id        TEXT NOT NULL,      -- station corrections in force, empty: none
  scanner_id         TEXT NOT NULL,      -- the scanner's acceptance in force, empty: none; all three of the first scanner
  tie_id             TEXT NOT NULL,      -- the tie of the two robots' bases in force, empty: none
  software           TEXT NOT NULL,
  T_base_slab_x REAL, T_base_slab_y REAL, T_base_slab_z REAL,
  T_base_slab_qw REAL, T_base_slab_qx REAL, T_base_slab_qy REAL, T_base_slab_qz REAL,
  T_flange_scanner_x REAL, T_flange_scanner_y REAL, T_flange_scanner_z REAL,
  T_flange_scanner_qw REAL, T_flange_scanner_qx REAL, T_flange_scanner_qy REAL, T_flange_scanner_qz REAL,
  began_utime_us     INTEGER NOT NULL,
  emulated           INTEGER NOT NULL    -- what was not real, bits: 1 line, 2 robot, 4 poses, 8 scan; 0: all real
) STRICT;
CREATE TABLE slab_arm (
  slab_key       INTEGER NOT NULL REFERENCES slab (slab_key),
  arm            INTEGER NOT NULL CHECK (arm > 0),
  robot          TEXT NOT NULL,
  scanner        TEXT NOT NULL,
  calibration_id TEXT NOT NULL,          -- as in slab, of this scanner
  stations_id    TEXT NOT NULL,
  scanner_id     TEXT NOT NULL,
  T_flange_scanner_x REAL, T_flange_scanner_y REAL, T_flange_scanner_z REAL,
  T_flange_scanner_qw REAL, T_flange_scanner_qx REAL, T_flange_scanner_qy REAL, T_flange_scanner_qz REAL,
  PRIMARY KEY (slab_key, arm)
) STRICT, WITHOUT ROWID;
CREATE INDEX slab_by_id ON slab (slab_id, slab_key);
CREATE INDEX slab_by_mould ON slab (mould, slab_key);
CREATE INDEX slab_by_time ON slab (began_utime_us);

-- Byte for byte as the daemon read them, so that a verdict can be proven when the file has long been changed. Rows are only
-- added, whatever retention takes away.
CREATE TABLE recipe_text (
  sha256        TEXT PRIMARY KEY,          -- of the text, as slab.recipe_sha256
  name          TEXT NOT NULL,
  text          TEXT NOT NULL,
  kept_utime_us INTEGER NOT NULL
) STRICT;
CREATE TRIGGER recipe_text_stays BEFORE UPDATE ON recipe_text
  BEGIN SELECT RAISE(ABORT, 'a recipe that was used is never changed'); END;
CREATE TRIGGER recipe_text_is_kept BEFORE DELETE ON recipe_text
  BEGIN SELECT RAISE(ABORT, 'a recipe that was used is never deleted'); END;
CREATE TRIGGER recipe_text_is_new BEFORE INSERT ON recipe_text
  WHEN EXISTS (SELECT 1 FROM recipe_text WHERE sha256 = NEW.sha256)
  BEGIN SELECT RAISE(ABORT, 'a recipe that was used is never replaced'); END;

CREATE TABLE slab_result (
  slab_key         INTEGER PRIMARY KEY REFERENCES slab (slab_key),
  ended_utime_us   INTEGER NOT NULL,
  verdict          TEXT NOT NULL,
  reason           INTEGER NOT NULL,
  fit_ok           INTEGER NOT NULL,
  fit_seats        INTEGER NOT NULL,
  fit_iterations   INTEGER NOT NULL,
  fit_rms_mm       REAL,
  fit_plain_rms_mm REAL,
  fit_T_base_slab_x REAL, fit_T_base_slab_y REAL, fit_T_base_slab_z REAL,
  fit_T_base_slab_qw REAL, fit_T_base_slab_qx REAL, fit_T_base_slab_qy REAL, fit_T_base_slab_qz REAL,
  fit_note         TEXT NOT NULL
) STRICT;

CREATE INDEX slab_not_passed ON slab_result (slab_key) WHERE verdict <> 'pass';

-- The verdict of each station after SLAB_END, slab-frame items included.
CREATE TABLE station_result (
  slab_key INTEGER NOT NULL REFERENCES slab (slab_key),
  station  INTEGER NOT NULL CHECK (station BETWEEN 1 AND 18),
  verdict  TEXT NOT NULL,
  reason   INTEGER NOT NULL,
  PRIMARY KEY (slab_key, station)
) STRICT, WITHOUT ROWID;

-- Decisions of quality about slabs that did not pass; the last one of a slab is in force. Rows are only added, and
-- leave with their slab. slab_result keeps what was measured.
CREATE TABLE disposition (
  slab_key  INTEGER NOT NULL,
  n         INTEGER NOT NULL CHECK (n > 0),
  utime_us  INTEGER NOT NULL,
  who       TEXT NOT NULL,                 -- entered it
  decision  TEXT NOT NULL CHECK (decision IN ('hold', 'release_by_concession', 'rework', 'scrap', 're_inspect')),
  reason    TEXT NOT NULL CHECK (reason <> ''),
  authority TEXT NOT NULL CHECK (authority <> ''),  -- decided it
  second    TEXT NOT NULL,                 -- second person, empty: none
  PRIMARY KEY (slab_key, n)
) STRICT, WITHOUT ROWID;
CREATE TRIGGER disposition_stays BEFORE UPDATE ON disposition
  BEGIN SELECT RAISE(ABORT, 'a decision is never changed'); END;
CREATE TRIGGER disposition_is_kept BEFORE DELETE ON disposition
  WHEN EXISTS (SELECT 1 FROM slab WHERE slab_key = OLD.slab_key)
  BEGIN SELECT RAISE(ABORT, 'a decision is never deleted'); END;
CREATE TRIGGER disposition_is_new BEFORE INSERT ON disposition
  WHEN EXISTS (SELECT 1 FROM disposition WHERE slab_key = NEW.slab_key AND n = NEW.n)
  BEGIN SELECT RAISE(ABORT, 'a decision is never replaced'); END;
CREATE TRIGGER disposition_is_of_no_pass BEFORE INSERT ON disposition
  WHEN NOT EXISTS (SELECT 1 FROM slab_result WHERE slab_key = NEW.slab_key AND verdict <> 'pass')
  BEGIN SELECT RAISE(ABORT, 'only a slab that did not pass has decisions'); END;

CREATE TABLE command (
  id       INTEGER PRIMARY KEY,
  session  INTEGER NOT NULL,
  cmd_seq  INTEGER NOT NULL,
  command  INTEGER NOT NULL CHECK (command BETWEEN 1 AND 5),  -- as the PLC writes it
  station  INTEGER NOT NULL,
  slab_key INTEGER REFERENCES slab (slab_key),
  utime_us INTEGER NOT NULL,
  status   INTEGER NOT NULL,             -- CMD_STATUS: 1 accepted, 3 acquired, 4 done, 32768 + code failed
  acquired INTEGER NOT NULL              -- 1: cloud and pose became durable
) STRICT;
CREATE INDEX command_unfinished ON command (id) WHERE status = 1;
-- Retention deletes the commands of one slab, and its reference to the slab is checked, without reading the table.
CREATE INDEX command_by_slab ON command (slab_key);

CREATE TABLE attempt (
  slab_key       INTEGER NOT NULL REFERENCES slab (slab_key),
  station        INTEGER NOT NULL CHECK (station BETWEEN 1 AND 18),
  attempt        INTEGER NOT NULL CHECK (attempt BETWEEN 1 AND 255),
  session        INTEGER NOT NULL,
  cmd_seq        INTEGER NOT NULL,
  T_base_flange_x REAL, T_base_flange_y REAL, T_base_flange_z REAL,
  T_base_flange_qw REAL, T_base_flange_qx REAL, T_base_flange_qy REAL, T_base_flange_qz REAL,
  pose_spread_mm REAL,
  pose_samples   INTEGER NOT NULL,
  scan_path      TEXT NOT NULL,
  scan_points    INTEGER NOT NULL,
  scan_finite    INTEGER NOT NULL,
  scan_width     INTEGER NOT NULL,
  scan_height    INTEGER NOT NULL,
  scan_utime_us  INTEGER NOT NULL,
  settle_ms      REAL,
  acquire_ms     REAL,
  phase          TEXT NOT NULL CHECK (phase IN ('acquired', 'measured', 'failed')),
  code           INTEGER NOT NULL,       -- why it failed
  scan_bytes     INTEGER NOT NULL,
  scan_state     TEXT NOT NULL CHECK (scan_state IN ('none', 'kept', 'deleting', 'deleted')),
  -- How the scan came into the base frame (mm, rad, k = 1): base/calibration.h, Splice.
  splice         TEXT NOT NULL,
  splice_visits  INTEGER NOT NULL,
  T_base_reported_x REAL, T_base_reported_y REAL, T_base_reported_z REAL,
  T_base_reported_qw REAL, T_base_reported_qx REAL, T_base_reported_qy REAL, T_base_reported_qz REAL,
  splice_off_mm REAL, splice_off_rad REAL,
  splice_calibration_mm REAL, splice_calibration_rad REAL, splice_robot_mm REAL, splice_robot_rad REAL,
  points_crc32c INTEGER CHECK (points_crc32c BETWEEN 0 AND 4294967295),  -- of the scan (docs/QUALITY.md); NULL: not taken
  -- 0: the scanner was never asked for it; the attempt does not count, and the station's next SCAN takes this row.
  asked INTEGER NOT NULL,
  -- Its measurement began at this monotonic time (ns since the computer's start) and has not ended; 0: none is under way.
  measuring_since_ns INTEGER NOT NULL,
  emulated INTEGER NOT NULL,             -- as slab.emulated, while this scan was taken
  fingerprint INTEGER,                   -- 64 bits of the points, as a signed number; NULL: none came
  scanner_temperature_c REAL,            -- as the scan declares, NULL: it does not
  scanner_drift REAL,                    -- relative half width of a length's error by it, NULL: not known
  -- Robot and scanner. T_base_flange is in the robot's own base; T_base_robot counts with splice_tied = 1.
  arm INTEGER NOT NULL,                  -- 0: the first ones; else slab_arm.arm
  robot TEXT NOT NULL,                   -- empty: not known, because slabd ended before it scanned
  scanner TEXT NOT NULL,
  splice_tied INTEGER NOT NULL,
  T_base_robot_x REAL, T_base_robot_y REAL, T_base_robot_z REAL,
  T_base_robot_qw REAL, T_base_robot_qx REAL, T_base_robot_qy REAL, T_base_robot_qz REAL,
  PRIMARY KEY (slab_key, station, attempt)
) STRICT, WITHOUT ROWID;
CREATE INDEX attempt_with_scan ON attempt (slab_key, scan_bytes) WHERE scan_state = 'kept';
CREATE INDEX attempt_deleting ON attempt (slab_key) WHERE scan_state = 'deleting';
-- One look-up a scan: has any attempt had these points before?
CREATE INDEX attempt_by_fingerprint ON attempt (fingerprint) WHERE fingerprint IS NOT NULL;

-- A scanner that hangs gives an old scan again under a new name. The newest 64, by id; what is refused because it is one
-- of them is not added.
CREATE TABLE seen_scan (
  id          INTEGER PRIMARY KEY,
  fingerprint INTEGER NOT NULL UNIQUE    -- 64 bits of the points, as a signed number
) STRICT;

-- A scanner that gives an old exposure again in another form gives the same noise (base/noise_print.h). The newest 64, by
-- id. No reference to the attempt: the rows go by their number, whatever retention takes away.
CREATE TABLE noise_print (
  id       INTEGER PRIMARY KEY,
  slab_key INTEGER NOT NULL,
  station  INTEGER NOT NULL CHECK (station BETWEEN 1 AND 18),
  attempt  INTEGER NOT NULL CHECK (attempt BETWEEN 1 AND 255),
  bytes    BLOB NOT NULL,
  UNIQUE (slab_key, station, attempt)
) STRICT;

CREATE TABLE block (
  slab_key INTEGER NOT NULL,
  station  INTEGER NOT NULL,
  attempt  INTEGER NOT NULL,
  verdict  TEXT NOT NULL,                -- provisional; station_result has the final one
  reason   INTEGER NOT NULL,
  points_read INTEGER NOT NULL, points_finite INTEGER NOT NULL,
  isolated_removed INTEGER NOT NULL, points_kept INTEGER NOT NULL,
  registration_status TEXT NOT NULL, registration_iterations INTEGER NOT NULL,
  share_associated REAL, condition REAL, registration_note TEXT NOT NULL,
  T_scanner_block_x REAL, T_scanner_block_y REAL, T_scanner_block_z REAL,
  T_scanner_block_qw REAL, T_scanner_block_qx REAL, T_scanner_block_qy REAL, T_scanner_block_qz REAL,
  deviation_count INTEGER NOT NULL, deviation_mean_mm REAL, deviation_std_mm REAL,
  within_sigma_1 REAL, within_sigma_2 REAL, within_sigma_3 REAL,
  within_sigma_4 REAL, within_sigma_5 REAL, within_sigma_6 REAL,
  seat_normal_x REAL, seat_normal_y REAL, seat_normal_z REAL,   -- in the datum frame
  seat_grid_points INTEGER NOT NULL, seat_std_cells_mm REAL,
  seat_flatness_mm REAL, seat_flatness_min_zone_mm REAL, seat_raw_low_mm REAL, seat_raw_high_mm REAL,
  observation_ok INTEGER NOT NULL, observation_jaw_ok INTEGER NOT NULL, observation_top_ok INTEGER NOT NULL,
  p_base_x REAL, p_base_y REAL, p_base_z REAL,
  n_base_x REAL, n_base_y REAL, n_base_z REAL,
  jaw_outer_base_x REAL, jaw_outer_base_y REAL, jaw_outer_base_z REAL,
  top_n_base_x REAL, top_n_base_y REAL, top_n_base_z REAL,
  read_ms REAL, denoise_ms REAL, register_ms REAL, extract_ms REAL, total_ms REAL,
  -- The small motion that takes the registered block to the true one: x, y, z (mm), then about X, Y, Z (rad).
  registration_noise_mm REAL,
  registration_cov_11 REAL, registration_cov_12 REAL, registration_cov_13 REAL,
  registration_cov_14 REAL, registration_cov_15 REAL, registration_cov_16 REAL,
  registration_cov_21 REAL, registration_cov_22 REAL, registration_cov_23 REAL,
  registration_cov_24 REAL, registration_cov_25 REAL, registration_cov_26 REAL,
  registration_cov_31 REAL, registration_cov_32 REAL, registration_cov_33 REAL,
  registration_cov_34 REAL, registration_cov_35 REAL, registration_cov_36 REAL,
  registration_cov_41 REAL, registration_cov_42 REAL, registration_cov_43 REAL,
  registration_cov_44 REAL, registration_cov_45 REAL, registration_cov_46 REAL,
  registration_cov_51 REAL, registration_cov_52 REAL, registration_cov_53 REAL,
  registration_cov_54 REAL, registration_cov_55 REAL, registration_cov_56 REAL,
  registration_cov_61 REAL, registration_cov_62 REAL, registration_cov_63 REAL,
  registration_cov_64 REAL, registration_cov_65 REAL, registration_cov_66 REAL,
  seat_noise_factor REAL, seat_flatness_noise_mm REAL,
  -- The largest group of cells beyond the limit; limit NULL: the channel was not computed.
  defect_limit_mm REAL, defect_cells INTEGER NOT NULL, defect_area_mm2 REAL, defect_height_mm REAL,
  defect_x_mm REAL, defect_s_mm REAL,
  -- Closed from above, as it is, and of the nine tenths nearest to the plane.
  seat_flatness_closed_mm REAL, seat_flatness_raw_mm REAL, seat_flatness_trimmed_mm REAL,
  -- Pores; NULL: not looked for. The limits of depth and share are the recipe's; NULL: it gives none.
  pores INTEGER NOT NULL, pores_largest_mm REAL, pores_deepest_mm REAL, pores_share REAL,
  pores_depth_max_mm REAL, pores_share_max REAL,
  -- Standard uncertainties inside one scan, block axes: of p_base and jaw_outer_base (mm), of the normals (rad).
  sigma_p_x REAL, sigma_p_y REAL, sigma_p_z REAL,
  sigma_jaw_x REAL, sigma_jaw_y REAL, sigma_jaw_z REAL,
  sigma_n_x REAL, sigma_n_y REAL, sigma_n_z REAL,
  sigma_top_n_x REAL, sigma_top_n_y REAL, sigma_top_n_z REAL,
  -- To what the coordinates of the scan were rounded, by axis of the scanner; 0: to nothing.
  step_x REAL, step_y REAL, step_z REAL, lag_ratio REAL,
  PRIMARY KEY (slab_key, station, attempt),
  FOREIGN KEY (slab_key, station, attempt) REFERENCES attempt
) STRICT, WITHOUT ROWID;

-- Fitted planes in the block's registered frame: seat, seat_full, jaw_inner, jaw_outer, slab_top.
CREATE TABLE plane (
  slab_key INTEGER NOT NULL,
  station  INTEGER NOT NULL,
  attempt  INTEGER NOT NULL,
  feature  TEXT NOT NULL,
  ok       INTEGER NOT NULL,
  doubt    TEXT NOT NULL,                -- none, or why it is not ok: no_plane, unsettled, second_surface, ...
  normal_x REAL, normal_y REAL, normal_z REAL,
  offset_mm REAL,
  points INTEGER NOT NULL, inliers INTEGER NOT NULL, inlier_fraction REAL,
  std_mm REAL,
  iterations INTEGER NOT NULL,
  -- The point at which offset and tilt are independent, and their uncertainty by white noise (mm, rad^2).
  centroid_x REAL, centroid_y REAL, centroid_z REAL,
  sigma_offset_mm REAL,
  cov_normal_11 REAL, cov_normal_12 REAL, cov_normal_13 REAL,
  cov_normal_21 REAL, cov_normal_22 REAL, cov_normal_23 REAL,
  cov_normal_31 REAL, cov_normal_32 REAL, cov_normal_33 REAL,
  PRIMARY KEY (slab_key, station, attempt, feature),
  FOREIGN KEY (slab_key, station, attempt) REFERENCES block ON DELETE CASCADE
) STRICT, WITHOUT ROWID;

-- Casings: inner, outer.
CREATE TABLE casing (
  slab_key INTEGER NOT NULL,
  station  INTEGER NOT NULL,
  attempt  INTEGER NOT NULL,
  feature  TEXT NOT NULL,
  ok       INTEGER NOT NULL,
  doubt    TEXT NOT NULL,                -- none, or why it is not ok: edge, radius, no_hole, rim_points, ...
  centre_x REAL, centre_y REAL, centre_z REAL,
  radius_mm REAL, height_mm REAL,
  edge_points INTEGER NOT NULL, rim_points INTEGER NOT NULL,
  edge_rms_mm REAL, inlier_fraction REAL, rim_std_mm REAL, sigma_height_mm REAL,
  -- Covariance of centre along the rail, centre along the seat, radius (mm^2).
  cov_circle_11 REAL, cov_circle_12 REAL, cov_circle_13 REAL,
  cov_circle_21 REAL, cov_circle_22 REAL, cov_circle_23 REAL,
  cov_circle_31 REAL, cov_circle_32 REAL, cov_circle_33 REAL,
  PRIMARY KEY (slab_key, station, attempt, feature),
  FOREIGN KEY (slab_key, station, attempt) REFERENCES block ON DELETE CASCADE
) STRICT, WITHOUT ROWID;

-- Areas of the block's surface that are displaced or were not seen: damage, then pores, each the largest first. Lengths in mm, block frame: x along the
-- rail, s along the bearing plane, z up. depth and volume NULL: nothing was seen there.
CREATE TABLE finding (
  slab_key INTEGER NOT NULL,
  station  INTEGER NOT NULL,
  attempt  INTEGER NOT NULL,
  position INTEGER NOT NULL,             -- from 0
  kind     TEXT NOT NULL,                -- pit, bump, crack, chip, missing
  face     TEXT NOT NULL,                -- seat, jaw_inner, jaw_outer, shoulder_inner, ...
  x_mm REAL, s_mm REAL, z_mm REAL,
  length_mm REAL, width_mm REAL, depth_mm REAL, area_mm2 REAL, volume_mm3 REAL,
  PRIMARY KEY (slab_key, station, attempt, position),
  FOREIGN KEY (slab_key, station, attempt) REFERENCES block ON DELETE CASCADE
) STRICT, WITHOUT ROWID;

-- Fillets and chamfers, learned from the scan: radius or leg on `face`, mm; the other one is NULL. nominal NULL: the
-- recipe gives none. n: places along the edge that it rests on.
CREATE TABLE edge (
  slab_key INTEGER NOT NULL,
  station  INTEGER NOT NULL,
  attempt  INTEGER NOT NULL,
  position INTEGER NOT NULL,             -- from 0
  face     TEXT NOT NULL,                -- seat, jaw_inner, jaw_outer, shoulder_inner, ...
  face_to  TEXT NOT NULL,                -- jaw_inner, ..., end_minus, end_plus, side_inner, side_outer
  radius_mm REAL, chamfer_mm REAL, nominal_mm REAL,
  n INTEGER NOT NULL,
  PRIMARY KEY (slab_key, station, attempt, position),
  FOREIGN KEY (slab_key, station, attempt) REFERENCES block ON DELETE CASCADE
) STRICT, WITHOUT ROWID;

-- Deviations by place, packed (base/packed_map.h): registration, seat. A block that was not found has none.
CREATE TABLE map (
  slab_key INTEGER NOT NULL,
  station  INTEGER NOT NULL,
  attempt  INTEGER NOT NULL,
  feature  TEXT NOT NULL,
  columns  INTEGER NOT NULL,
  rows     INTEGER NOT NULL,
  cell_mm  REAL NOT NULL,
  step_mm  REAL NOT NULL,
  bytes    BLOB NOT NULL,
  PRIMARY KEY (slab_key, station, attempt, feature),
  FOREIGN KEY (slab_key, station, attempt) REFERENCES block ON DELETE CASCADE
) STRICT;

-- Measured characteristics. Those of a block carry its station and attempt; those of the slab have both 0 there and
-- name their stations in from_station and to_station (0 = the whole slab).
CREATE TABLE item (
  slab_key     INTEGER NOT NULL REFERENCES slab (slab_key),
  station      INTEGER NOT NULL,
  attempt      INTEGER NOT NULL,
  position     INTEGER NOT NULL,         -- in its list, from 0
  id           TEXT NOT NULL,
  verdict      TEXT NOT NULL,
  required     INTEGER NOT NULL,
  from_station INTEGER NOT NULL,
  to_station   INTEGER NOT NULL,
  value REAL, nominal REAL, lower REAL, upper REAL, U REAL, beside REAL,
  measured REAL,                         -- value before its correction for temperature
  -- Standard uncertainties (k = 1) whose root sum of squares is U / 2; all 0: U is the recipe's.
  budget_fit REAL, budget_noise REAL, budget_scanner REAL, budget_registration REAL, budget_calibration REAL,
  budget_robot REAL, budget_reference REAL, budget_thermal REAL, budget_gauge REAL, budget_tie REAL,
  PRIMARY KEY (slab_key, station, attempt, position)
) STRICT, WITHOUT ROWID;
CREATE INDEX item_by_name ON item (id, slab_key);
-- Items that did not pass are rare and looked for: the reader finds them among 100 000 slabs without visiting these.
CREATE INDEX item_not_passed ON item (id, verdict, slab_key) WHERE verdict NOT IN ('pass', 'none');

-- Values of the gauges for a slab, usable or not, as it counted at SLAB_END (base/gauge.h). u and u_master: k = 1.
CREATE TABLE gauge_value (
  slab_key        INTEGER NOT NULL REFERENCES slab (slab_key),
  position        INTEGER NOT NULL,      -- in the configuration, from 0
  gauge           TEXT NOT NULL,
  source          TEXT NOT NULL,         -- as configured: plc:40, modbus:..., udp:..., operator
  unit            TEXT NOT NULL,
  state           TEXT NOT NULL,         -- ok, missing, other_slab, stale, not_plausible, unchecked, check_failed, ...
  value REAL, u REAL, u_master REAL,
  seq             INTEGER NOT NULL,      -- of the sender
  slab_no         INTEGER NOT NULL,      -- named by the sender, 0: none
  utime_us        INTEGER NOT NULL,      -- arrival, 0: no value
  age_s           REAL,                  -- at SLAB_END
  check_utime_us  INTEGER NOT NULL,      -- the master check in force, 0: none
  check_deviation REAL,
  PRIMARY KEY (slab_key, position)
) STRICT, WITHOUT ROWID;
CREATE INDEX gauge_value_by_name ON gauge_value (gauge, slab_key);

CREATE TABLE result (
  id            INTEGER PRIMARY KEY,
  slab_key      INTEGER NOT NULL REFERENCES slab (slab_key),
  is_repeat     INTEGER NOT NULL,        -- 1: shown again on REPORT
  acknowledged  INTEGER NOT NULL,
  res_seq       INTEGER NOT NULL CHECK (res_seq BETWEEN 1 AND 65535),
  kind          INTEGER NOT NULL CHECK (kind IN (1, 2)),  -- 1 station, 2 slab
  cmd_seq       INTEGER NOT NULL,
  station       INTEGER NOT NULL,
  slab_no       INTEGER NOT NULL,
  verdict       TEXT NOT NULL,
  reason        INTEGER NOT NULL,
  fail_mask     INTEGER NOT NULL,
  open_mask     INTEGER NOT NULL,
  flatness_mm   REAL,
  std_mm        REAL,
  deviation_1 REAL, deviation_2 REAL, deviation_3 REAL, deviation_4 REAL, deviation_5 REAL, deviation_6 REAL,
  deviation_7 REAL, deviation_8 REAL, deviation_9 REAL, deviation_10 REAL, deviation_11 REAL, deviation_12 REAL,
  deviation_13 REAL, deviation_14 REAL,
  points        INTEGER NOT NULL,
  scan_utime_us INTEGER NOT NULL,
  emulated      INTEGER NOT NULL         -- slab.emulated when the record was made
) STRICT;
CREATE INDEX result_unacknowledged ON result (id) WHERE acknowledged = 0;
CREATE INDEX result_by_slab ON result (slab_key, kind, id);

CREATE TABLE care (
  seq      INTEGER PRIMARY KEY,
  what     TEXT NOT NULL CHECK (what IN ('restored', 'begun_anew')),
  slab_key INTEGER NOT NULL,               -- keys up to here may have been used before
  result_id INTEGER NOT NULL,              -- the newest result at that time; after it
  res_seq  INTEGER NOT NULL CHECK (res_seq BETWEEN 1 AND 65535),  -- records count on from here: the PLC may hold others
  source   TEXT NOT NULL,                  -- the backup
  who      TEXT NOT NULL,
  why      TEXT NOT NULL,
  utime_us INTEGER NOT NULL
) STRICT;
CREATE TRIGGER care_stays BEFORE UPDATE ON care
  BEGIN SELECT RAISE(ABORT, 'a gap in the history is never changed'); END;
CREATE TRIGGER care_is_kept BEFORE DELETE ON care
  BEGIN SELECT RAISE(ABORT, 'a gap in the history is never deleted'); END;
CREATE TRIGGER care_is_new BEFORE INSERT ON care
  WHEN EXISTS (SELECT 1 FROM care WHERE seq = NEW.seq)
  BEGIN SELECT RAISE(ABORT, 'a gap in the history is never replaced'); END;

-- The chain of results. An entry holds the SHA-256 of the entry before it, so that what was changed behind slabd's back is
-- found (slabctl db check). Entries are only added, and stay when retention takes their slab away.
--   begun     the chain begins here; slabs up to key `about` ended before and have no seal
--   slab      slab `about` has ended: rows_sha256 is that of its rows (storage/seals.h), tables the digest of each table
--   reopened  that end was taken back: the PLC was never shown it
--   pruned    retention took slab `about` away
--   care      row `about` of table care
--   decided   a decision about slab `about` was added: rows_sha256 is that of its rows of table disposition
CREATE TABLE slab_seal (
  seq         INTEGER PRIMARY KEY CHECK (seq > 0),
  kind        TEXT NOT NULL CHECK (kind IN ('begun', 'slab', 'reopened', 'pruned', 'care', 'decided')),
  form        INTEGER NOT NULL,            -- of rows_sha256
  about       INTEGER NOT NULL,
  slab_no     INTEGER NOT NULL,
  slab_id     TEXT NOT NULL,
  utime_us    INTEGER NOT NULL,
  rows_sha256 BLOB NOT NULL,
  sha256      BLOB NOT NULL,               -- of all of this, and of the entry before
  tables      BLOB NOT NULL                -- empty when the slab is pruned
) STRICT;
CREATE INDEX slab_seal_by_subject ON slab_seal (about, kind, seq);
CREATE TRIGGER slab_seal_stays
  BEFORE UPDATE OF seq, kind, form, about, slab_no, slab_id, utime_us, rows_sha256, sha256 ON slab_seal
  BEGIN SELECT RAISE(ABORT, 'a seal is never changed'); END;
CREATE TRIGGER slab_seal_is_kept BEFORE DELETE ON slab_seal
  BEGIN SELECT RAISE(ABORT, 'a seal is never deleted'); END;
CREATE TRIGGER slab_seal_is_new BEFORE INSERT ON slab_seal
  WHEN EXISTS (SELECT 1 FROM slab_seal WHERE seq = NEW.seq)
  BEGIN SELECT RAISE(ABORT, 'a seal is never replaced'); END;

-- ---- calibrations: rows are only ever added --------------------------------------------------------------------------

CREATE TABLE calibration (
  seq              INTEGER PRIMARY KEY,
  id               TEXT NOT NULL UNIQUE,   -- from the SHA-256 of kind, numbers and parent
  kind             TEXT NOT NULL CHECK (kind IN ('hand_eye', 'stations', 'reference_block', 'monitor_ball', 'scanner',
                                                  'tie')),
  slab_type        INTEGER NOT NULL,       -- of station corrections, else 0
  parent_id        TEXT NOT NULL,          -- stations: the hand-eye calibration they hold for; tie: both, with a '+'
  figures          TEXT NOT NULL,          -- JSON
  observations     TEXT NOT NULL,
  certificate      TEXT NOT NULL,
  operator_name    TEXT NOT NULL,
  robot_serial     TEXT NOT NULL,
  scanner_serial   TEXT NOT NULL,
  temperature_c    REAL,
  software         TEXT NOT NULL,
  created_utime_us INTEGER NOT NULL,
  expires_utime_us INTEGER NOT NULL,       -- 0 = never
  scanner          TEXT NOT NULL DEFAULT '1'  -- id of the scanner it is of; a tie has '1'
) STRICT;
CREATE TRIGGER calibration_stays BEFORE UPDATE ON calibration
  BEGIN SELECT RAISE(ABORT, 'a calibration record is never changed'); END;
CREATE TRIGGER calibration_is_kept BEFORE DELETE ON calibration
  BEGIN SELECT RAISE(ABORT, 'a calibration record is never deleted'); END;
CREATE TRIGGER calibration_is_new BEFORE INSERT ON calibration
  WHEN EXISTS (SELECT 1 FROM calibration WHERE seq = NEW.seq OR id = NEW.id)
  BEGIN SELECT RAISE(ABORT, 'a calibration record is never replaced'); END;

CREATE TABLE hand_eye (
  calibration_id TEXT PRIMARY KEY REFERENCES calibration (id),
  T_flange_scanner_x REAL, T_flange_scanner_y REAL, T_flange_scanner_z REAL,
  T_flange_scanner_qw REAL, T_flange_scanner_qx REAL, T_flange_scanner_qy REAL, T_flange_scanner_qz REAL,
  sigma_mm REAL, sigma_rad REAL            -- k = 1, per axis
) STRICT, WITHOUT ROWID;

CREATE TABLE station_correction (
  calibration_id TEXT NOT NULL REFERENCES calibration (id),
  station        INTEGER NOT NULL CHECK (station BETWEEN 1 AND 18),
  visits         INTEGER NOT NULL,
  T_base_reported_x REAL, T_base_reported_y REAL, T_base_reported_z REAL,
  T_base_reported_qw REAL, T_base_reported_qx REAL, T_base_reported_qy REAL, T_base_reported_qz REAL,
  T_base_flange_x REAL, T_base_flange_y REAL, T_base_flange_z REAL,
  T_base_flange_qw REAL, T_base_flange_qx REAL, T_base_flange_qy REAL, T_base_flange_qz REAL,
  sigma_mm REAL, sigma_rad REAL,           -- of one visit, k = 1, per axis
  spread_mm REAL,
  PRIMARY KEY (calibration_id, station)
) STRICT, WITHOUT ROWID;

CREATE TABLE reference_block (
  calibration_id TEXT PRIMARY KEY REFERENCES calibration (id),
  slope_rad REAL, slope_U_rad REAL, jaw_distance_mm REAL, jaw_distance_U_mm REAL   -- U: k = 2
) STRICT, WITHOUT ROWID;

CREATE TABLE monitor_ball (
  calibration_id TEXT PRIMARY KEY REFERENCES calibration (id),
  p_base_x REAL, p_base_y REAL, p_base_z REAL, radius_mm REAL, limit_mm REAL
) STRICT, WITHOUT ROWID;

CREATE TABLE scanner_acceptance (
  calibration_id TEXT PRIMARY KEY REFERENCES calibration (id),
  scanner        TEXT NOT NULL,            -- its name or serial number, empty: not given
  PF_mm REAL, PS_mm REAL, RF_mm REAL,      -- VDI/VDE 2634-2, the worst place; PS as a magnitude
  form_half_mm REAL, form_length_mm REAL,  -- what does not average away, and the shortest length it was seen over
  noise_sigma_mm REAL, noise_correlation_mm REAL, pitch_mm REAL,
  plates         INTEGER NOT NULL,         -- places that were looked at
  balls          INTEGER NOT NULL,
  within_limits  INTEGER NOT NULL,
  temperature_c  REAL                      -- of the scanner during it, NULL: not known
) STRICT, WITHOUT ROWID;

-- The second robot's base in the base frame. Covariance: of its small motion about the centre, base axes, mm and rad.
CREATE TABLE tie_numbers (
  calibration_id TEXT PRIMARY KEY REFERENCES calibration (id),
  robot          TEXT NOT NULL,            -- id of the second robot
  T_base_robot_x REAL, T_base_robot_y REAL, T_base_robot_z REAL,
  T_base_robot_qw REAL, T_base_robot_qx REAL, T_base_robot_qy REAL, T_base_robot_qz REAL,
  centre_x REAL, centre_y REAL, centre_z REAL,
  covariance_11 REAL, covariance_12 REAL, covariance_13 REAL, covariance_14 REAL, covariance_15 REAL, covariance_16 REAL,
  covariance_21 REAL, covariance_22 REAL, covariance_23 REAL, covariance_24 REAL, covariance_25 REAL, covariance_26 REAL,
  covariance_31 REAL, covariance_32 REAL, covariance_33 REAL, covariance_34 REAL, covariance_35 REAL, covariance_36 REAL,
  covariance_41 REAL, covariance_42 REAL, covariance_43 REAL, covariance_44 REAL, covariance_45 REAL, covariance_46 REAL,
  covariance_51 REAL, covariance_52 REAL, covariance_53 REAL, covariance_54 REAL, covariance_55 REAL, covariance_56 REAL,
  covariance_61 REAL, covariance_62 REAL, covariance_63 REAL, covariance_64 REAL, covariance_65 REAL, covariance_66 REAL,
  targets        INTEGER NOT NULL,         -- balls that both robots measured
  rms_mm REAL
) STRICT, WITHOUT ROWID;

CREATE TABLE applied (
  seq            INTEGER PRIMARY KEY,
  kind           TEXT NOT NULL,
  slab_type      INTEGER NOT NULL,
  is_rollback    INTEGER NOT NULL,
  calibration_id TEXT NOT NULL REFERENCES calibration (id),
  replaced_id    TEXT NOT NULL,            -- in force until here, empty: none
  before_seq     INTEGER NOT NULL,         -- the row a rollback goes back to, 0: none
  who            TEXT NOT NULL,
  why            TEXT NOT NULL,
  utime_us       INTEGER NOT NULL,
  scanner        TEXT NOT NULL DEFAULT '1'  -- as calibration.scanner
) STRICT;
CREATE INDEX applied_newest ON applied (kind, slab_type, scanner, seq);
CREATE TRIGGER applied_stays BEFORE UPDATE ON applied
  BEGIN SELECT RAISE(ABORT, 'the history is never changed'); END;
CREATE TRIGGER applied_is_kept BEFORE DELETE ON applied
  BEGIN SELECT RAISE(ABORT, 'the history is never deleted'); END;
CREATE TRIGGER applied_is_new BEFORE INSERT ON applied
  WHEN EXISTS (SELECT 1 FROM applied WHERE seq = NEW.seq)
  BEGIN SELECT RAISE(ABORT, 'the history is never replaced'); END;

CREATE TABLE calibration_check (
  seq          INTEGER PRIMARY KEY,
  kind         TEXT NOT NULL CHECK (kind IN ('reference_block', 'monitor_ball')),
  reference_id TEXT NOT NULL REFERENCES calibration (id),
  hand_eye_id  TEXT NOT NULL,              -- in force at the time, empty: none
  passed       INTEGER NOT NULL,
  slope_rad REAL, slope_U_rad REAL, jaw_distance_mm REAL, jaw_distance_U_mm REAL,  -- as measured; U: k = 2
  off_x REAL, off_y REAL, off_z REAL,      -- monitor ball from its place, base axes (mm)
  utime_us     INTEGER NOT NULL,
  who          TEXT NOT NULL,
  source       TEXT NOT NULL,
  note         TEXT NOT NULL               -- why it failed
) STRICT;
CREATE INDEX calibration_check_newest ON calibration_check (reference_id, seq);
CREATE TRIGGER calibration_check_stays BEFORE UPDATE ON calibration_check
  BEGIN SELECT RAISE(ABORT, 'a check is never changed'); END;
CREATE TRIGGER calibration_check_is_kept BEFORE DELETE ON calibration_check
  BEGIN SELECT RAISE(ABORT, 'a check is never deleted'); END;
CREATE TRIGGER calibration_check_is_new BEFORE INSERT ON calibration_check
  WHEN EXISTS (SELECT 1 FROM calibration_check WHERE seq = NEW.seq)
  BEGIN SELECT RAISE(ABORT, 'a check is never replaced'); END;

-- ---- gauges: rows are only ever added --------------------------------------------------------------------------------

-- A gauge measured its master. The newest row of a gauge counts.
CREATE TABLE gauge_check (
  seq          INTEGER PRIMARY KEY,
  gauge        TEXT NOT NULL,
  unit         TEXT NOT NULL,
  value        REAL NOT NULL,              -- as the gauge read it
  master_value REAL NOT NULL,
  master_u     REAL NOT NULL,              -- k = 1
  within       REAL NOT NULL,              -- largest deviation that passes
  passed       INTEGER NOT NULL CHECK (passed = (abs(value - master_value) <= within)),
  utime_us     INTEGER NOT NULL,
  who          TEXT NOT NULL,
  why          TEXT NOT NULL,
  source       TEXT NOT NULL
) STRICT;
CREATE INDEX gauge_check_newest ON gauge_check (gauge, seq);
CREATE TRIGGER gauge_check_stays BEFORE UPDATE ON gauge_check
  BEGIN SELECT RAISE(ABORT, 'a master check is never changed'); END;
CREATE TRIGGER gauge_check_is_kept BEFORE DELETE ON gauge_check
  BEGIN SELECT RAISE(ABORT, 'a master check is never deleted'); END;
CREATE TRIGGER gauge_check_is_new BEFORE INSERT ON gauge_check
  WHEN EXISTS (SELECT 1 FROM gauge_check WHERE seq = NEW.seq)
  BEGIN SELECT RAISE(ABORT, 'a master check is never replaced'); END;

-- ---- moulds: rows are only ever added --------------------------------------------------------------------------------

CREATE TABLE mould_reset (
  seq           INTEGER PRIMARY KEY,
  mould         INTEGER NOT NULL CHECK (mould BETWEEN 1 AND 65535),
  from_utime_us INTEGER NOT NULL,          -- slabs cast from then on belong to the new epoch
  who           TEXT NOT NULL,
  why           TEXT NOT NULL,
  utime_us      INTEGER NOT NULL
) STRICT;
CREATE INDEX mould_reset_by_mould ON mould_reset (mould, from_utime_us);
CREATE TRIGGER mould_reset_stays BEFORE UPDATE ON mould_reset
  BEGIN SELECT RAISE(ABORT, 'the history of a mould is never changed'); END;
CREATE TRIGGER mould_reset_is_kept BEFORE DELETE ON mould_reset
  BEGIN SELECT RAISE(ABORT, 'the history of a mould is never deleted'); END;
CREATE TRIGGER mould_reset_is_new BEFORE INSERT ON mould_reset
  WHEN EXISTS (SELECT 1 FROM mould_reset WHERE seq = NEW.seq)
  BEGIN SELECT RAISE(ABORT, 'the history of a mould is never replaced'); END;

-- ---- for the plant's database ----------------------------------------------------------------------------------------

-- A fault without a later row "cleared" or "started" is still present.
CREATE TABLE event (
  seq      INTEGER PRIMARY KEY,
  kind     TEXT NOT NULL CHECK (kind IN ('started', 'fault', 'cleared')),
  code     INTEGER NOT NULL,               -- of the fault, 0: of a start
  text     TEXT NOT NULL,                  -- of a start: the software
  utime_us INTEGER NOT NULL
) STRICT;
CREATE TRIGGER event_stays BEFORE UPDATE ON event
  BEGIN SELECT RAISE(ABORT, 'an event is never changed'); END;
CREATE TRIGGER event_is_kept BEFORE DELETE ON event
  BEGIN SELECT RAISE(ABORT, 'an event is never deleted'); END;
CREATE TRIGGER event_is_new BEFORE INSERT ON event
  WHEN EXISTS (SELECT 1 FROM event WHERE seq = NEW.seq)
  BEGIN SELECT RAISE(ABORT, 'an event is never replaced'); END;

-- The plant's database tells rows of equal number apart by the epoch: after a restore the numbers that the backup lacks
-- are used again, for other contents.
CREATE TABLE epoch (
  n              INTEGER PRIMARY KEY,
  uuid           TEXT NOT NULL UNIQUE CHECK (length(uuid) = 32),
  began_utime_us INTEGER NOT NULL
) STRICT;
CREATE TRIGGER epoch_stays BEFORE UPDATE ON epoch
  BEGIN SELECT RAISE(ABORT, 'an epoch is never changed'); END;
CREATE TRIGGER epoch_is_kept BEFORE DELETE ON epoch
  BEGIN SELECT RAISE(ABORT, 'an epoch is never deleted'); END;
CREATE TRIGGER epoch_is_new BEFORE INSERT ON epoch
  WHEN EXISTS (SELECT 1 FROM epoch WHERE n = NEW.n OR uuid = NEW.uuid)
  BEGIN SELECT RAISE(ABORT, 'an epoch is never replaced'); END;
INSERT INTO epoch (uuid, began_utime_us) VALUES (lower(hex(randomblob(16))), unixepoch() * 1000000);

-- `about` is the number of the row in the table of its kind: slab_seal (slab, reopened, decided, care), applied,
-- calibration_check (check), gauge_check, mould_reset, event; of a station that was measured again (remeasured) 1000 x station +
-- attempt. Rows stay, so that what the plant's database lost can be sent again.
CREATE TABLE outbox (
  seq      INTEGER PRIMARY KEY,
  epoch    INTEGER NOT NULL REFERENCES epoch (n),
  kind     TEXT NOT NULL CHECK (kind IN ('slab', 'reopened', 'decided', 'care', 'remeasured', 'applied', 'check',
                                         'gauge_check', 'mould_reset', 'event')),
  about    INTEGER NOT NULL,
  slab_key INTEGER NOT NULL,               -- 0: of no slab
  utime_us INTEGER NOT NULL
) STRICT;
CREATE INDEX outbox_by_slab ON outbox (slab_key, seq) WHERE slab_key > 0;
CREATE TRIGGER outbox_stays BEFORE UPDATE ON outbox
  BEGIN SELECT RAISE(ABORT, 'the outbox is never changed'); END;
CREATE TRIGGER outbox_is_kept BEFORE DELETE ON outbox
  BEGIN SELECT RAISE(ABORT, 'the outbox is never emptied'); END;
CREATE TRIGGER outbox_is_new BEFORE INSERT ON outbox
  WHEN EXISTS (SELECT 1 FROM outbox WHERE seq = NEW.seq)
  BEGIN SELECT RAISE(ABORT, 'a row of the outbox is never replaced'); END;

CREATE TRIGGER slab_seal_is_sent AFTER INSERT ON slab_seal WHEN NEW.kind IN ('slab', 'reopened', 'decided', 'care')
  BEGIN INSERT INTO outbox (epoch, kind, about, slab_key, utime_us) VALUES ((SELECT max(n) FROM epoch), NEW.kind,
    NEW.seq, iif(NEW.kind = 'care', 0, NEW.about), NEW.utime_us); END;
CREATE TRIGGER block_is_sent AFTER INSERT ON block WHEN NEW.attempt > 1
  BEGIN INSERT INTO outbox (epoch, kind, about, slab_key, utime_us) VALUES ((SELECT max(n) FROM epoch), 'remeasured',
    1000 * NEW.station + NEW.attempt, NEW.slab_key, (SELECT newest_utime_us FROM line)); END;
CREATE TRIGGER applied_is_sent AFTER INSERT ON applied
  BEGIN INSERT INTO outbox (epoch, kind, about, slab_key, utime_us) VALUES ((SELECT max(n) FROM epoch), 'applied',
    NEW.seq, 0, NEW.utime_us); END;
CREATE TRIGGER calibration_check_is_sent AFTER INSERT ON calibration_check
  BEGIN INSERT INTO outbox (epoch, kind, about, slab_key, utime_us) VALUES ((SELECT max(n) FROM epoch), 'check',
    NEW.seq, 0, NEW.utime_us); END;
CREATE TRIGGER gauge_check_is_sent AFTER INSERT ON gauge_check
  BEGIN INSERT INTO outbox (epoch, kind, about, slab_key, utime_us) VALUES ((SELECT max(n) FROM epoch), 'gauge_check',
    NEW.seq, 0, NEW.utime_us); END;
CREATE TRIGGER mould_reset_is_sent AFTER INSERT ON mould_reset
  BEGIN INSERT INTO outbox (epoch, kind, about, slab_key, utime_us) VALUES ((SELECT max(n) FROM epoch), 'mould_reset',
    NEW.seq, 0, NEW.utime_us); END;
CREATE TRIGGER event_is_sent AFTER INSERT ON event
  BEGIN INSERT INTO outbox (epoch, kind, about, slab_key, utime_us) VALUES ((SELECT max(n) FROM epoch), 'event',
    NEW.seq, 0, NEW.utime_us); END;
