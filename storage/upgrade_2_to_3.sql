-- SPDX-License-Identifier: Apache-2.0
--
-- From schema version 2 to 3: calibrations and their history, the daily check, and with every scan how it was spliced.
-- Rows of version 2 say splice 'none': what they were spliced with stands in their slab's header alone. The columns are
-- explained in schema.sql.

ALTER TABLE slab ADD COLUMN stations_id TEXT NOT NULL DEFAULT '';

ALTER TABLE attempt ADD COLUMN splice TEXT NOT NULL DEFAULT 'none';
ALTER TABLE attempt ADD COLUMN splice_visits INTEGER NOT NULL DEFAULT 0;
ALTER TABLE attempt ADD COLUMN T_base_reported_x REAL DEFAULT 0.0;
ALTER TABLE attempt ADD COLUMN T_base_reported_y REAL DEFAULT 0.0;
ALTER TABLE attempt ADD COLUMN T_base_reported_z REAL DEFAULT 0.0;
ALTER TABLE attempt ADD COLUMN T_base_reported_qw REAL DEFAULT 1.0;
ALTER TABLE attempt ADD COLUMN T_base_reported_qx REAL DEFAULT 0.0;
ALTER TABLE attempt ADD COLUMN T_base_reported_qy REAL DEFAULT 0.0;
ALTER TABLE attempt ADD COLUMN T_base_reported_qz REAL DEFAULT 0.0;
ALTER TABLE attempt ADD COLUMN splice_off_mm REAL;
ALTER TABLE attempt ADD COLUMN splice_off_rad REAL;
ALTER TABLE attempt ADD COLUMN splice_calibration_mm REAL;
ALTER TABLE attempt ADD COLUMN splice_calibration_rad REAL;
ALTER TABLE attempt ADD COLUMN splice_robot_mm REAL;
ALTER TABLE attempt ADD COLUMN splice_robot_rad REAL;

CREATE TABLE calibration (
  seq              INTEGER PRIMARY KEY,
  id               TEXT NOT NULL UNIQUE,
  kind             TEXT NOT NULL CHECK (kind IN ('hand_eye', 'stations', 'reference_block', 'monitor_ball')),
  slab_type        INTEGER NOT NULL,
  parent_id        TEXT NOT NULL,
  figures          TEXT NOT NULL,
  observations     TEXT NOT NULL,
  certificate      TEXT NOT NULL,
  operator_name    TEXT NOT NULL,
  robot_serial     TEXT NOT NULL,
  scanner_serial   TEXT NOT NULL,
  temperature_c    REAL,
  software         TEXT NOT NULL,
  created_utime_us INTEGER NOT NULL,
  expires_utime_us INTEGER NOT NULL
) STRICT;
CREATE TRIGGER calibration_stays BEFORE UPDATE ON calibration
  BEGIN SELECT RAISE(ABORT, 'a calibration record is never changed'); END;
CREATE TRIGGER calibration_is_kept BEFORE DELETE ON calibration
  BEGIN SELECT RAISE(ABORT, 'a calibration record is never deleted'); END;

CREATE TABLE hand_eye (
  calibration_id TEXT PRIMARY KEY REFERENCES calibration (id),
  T_flange_scanner_x REAL, T_flange_scanner_y REAL, T_flange_scanner_z REAL,
  T_flange_scanner_qw REAL, T_flange_scanner_qx REAL, T_flange_scanner_qy REAL, T_flange_scanner_qz REAL,
  sigma_mm REAL, sigma_rad REAL
) STRICT, WITHOUT ROWID;

CREATE TABLE station_correction (
  calibration_id TEXT NOT NULL REFERENCES calibration (id),
  station        INTEGER NOT NULL CHECK (station BETWEEN 1 AND 18),
  visits         INTEGER NOT NULL,
  T_base_reported_x REAL, T_base_reported_y REAL, T_base_reported_z REAL,
  T_base_reported_qw REAL, T_base_reported_qx REAL, T_base_reported_qy REAL, T_base_reported_qz REAL,
  T_base_flange_x REAL, T_base_flange_y REAL, T_base_flange_z REAL,
  T_base_flange_qw REAL, T_base_flange_qx REAL, T_base_flange_qy REAL, T_base_flange_qz REAL,
  sigma_mm REAL, sigma_rad REAL,
  spread_mm REAL,
  PRIMARY KEY (calibration_id, station)
) STRICT, WITHOUT ROWID;

CREATE TABLE reference_block (
  calibration_id TEXT PRIMARY KEY REFERENCES calibration (id),
  slope_rad REAL, slope_U_rad REAL, jaw_distance_mm REAL, jaw_distance_U_mm REAL
) STRICT, WITHOUT ROWID;

CREATE TABLE monitor_ball (
  calibration_id TEXT PRIMARY KEY REFERENCES calibration (id),
  p_base_x REAL, p_base_y REAL, p_base_z REAL, radius_mm REAL, limit_mm REAL
) STRICT, WITHOUT ROWID;

CREATE TABLE applied (
  seq            INTEGER PRIMARY KEY,
  kind           TEXT NOT NULL,
  slab_type      INTEGER NOT NULL,
  is_rollback    INTEGER NOT NULL,
  calibration_id TEXT NOT NULL REFERENCES calibration (id),
  replaced_id    TEXT NOT NULL,
  before_seq     INTEGER NOT NULL,
  who            TEXT NOT NULL,
  why            TEXT NOT NULL,
  utime_us       INTEGER NOT NULL
) STRICT;
CREATE INDEX applied_newest ON applied (kind, slab_type, seq);
CREATE TRIGGER applied_stays BEFORE UPDATE ON applied
  BEGIN SELECT RAISE(ABORT, 'the history is never changed'); END;
CREATE TRIGGER applied_is_kept BEFORE DELETE ON applied
  BEGIN SELECT RAISE(ABORT, 'the history is never deleted'); END;

CREATE TABLE calibration_check (
  seq          INTEGER PRIMARY KEY,
  kind         TEXT NOT NULL CHECK (kind IN ('reference_block', 'monitor_ball')),
  reference_id TEXT NOT NULL REFERENCES calibration (id),
  hand_eye_id  TEXT NOT NULL,
  passed       INTEGER NOT NULL,
  slope_rad REAL, slope_U_rad REAL, jaw_distance_mm REAL, jaw_distance_U_mm REAL,
  off_x REAL, off_y REAL, off_z REAL,
  utime_us     INTEGER NOT NULL,
  who          TEXT NOT NULL,
  source       TEXT NOT NULL,
  note         TEXT NOT NULL
) STRICT;
CREATE INDEX calibration_check_newest ON calibration_check (reference_id, seq);
CREATE TRIGGER calibration_check_stays BEFORE UPDATE ON calibration_check
  BEGIN SELECT RAISE(ABORT, 'a check is never changed'); END;
CREATE TRIGGER calibration_check_is_kept BEFORE DELETE ON calibration_check
  BEGIN SELECT RAISE(ABORT, 'a check is never deleted'); END;
