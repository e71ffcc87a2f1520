-- SPDX-License-Identifier: Apache-2.0
--
-- From schema version 7 to 8: the scanner's acceptance is a calibration record. SQLite cannot widen a CHECK, so the
-- table of calibrations is made anew; what refers to it by name finds the new one (foreign keys are off meanwhile and
-- checked afterwards). The columns are explained in schema.sql.

CREATE TABLE calibration_new (
  seq              INTEGER PRIMARY KEY,
  id               TEXT NOT NULL UNIQUE,
  kind             TEXT NOT NULL CHECK (kind IN ('hand_eye', 'stations', 'reference_block', 'monitor_ball', 'scanner')),
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
INSERT INTO calibration_new (seq, id, kind, slab_type, parent_id, figures, observations, certificate, operator_name,
                             robot_serial, scanner_serial, temperature_c, software, created_utime_us, expires_utime_us)
  SELECT seq, id, kind, slab_type, parent_id, figures, observations, certificate, operator_name,
         robot_serial, scanner_serial, temperature_c, software, created_utime_us, expires_utime_us FROM calibration;
DROP TRIGGER calibration_stays;
DROP TRIGGER calibration_is_kept;
DROP TABLE calibration;
ALTER TABLE calibration_new RENAME TO calibration;
CREATE TRIGGER calibration_stays BEFORE UPDATE ON calibration
  BEGIN SELECT RAISE(ABORT, 'a calibration record is never changed'); END;
CREATE TRIGGER calibration_is_kept BEFORE DELETE ON calibration
  BEGIN SELECT RAISE(ABORT, 'a calibration record is never deleted'); END;

CREATE TABLE scanner_acceptance (
  calibration_id TEXT PRIMARY KEY REFERENCES calibration (id),
  scanner        TEXT NOT NULL,
  PF_mm REAL, PS_mm REAL, RF_mm REAL,
  form_half_mm REAL, form_length_mm REAL,
  noise_sigma_mm REAL, noise_correlation_mm REAL, pitch_mm REAL,
  plates         INTEGER NOT NULL,
  balls          INTEGER NOT NULL,
  within_limits  INTEGER NOT NULL
) STRICT, WITHOUT ROWID;

ALTER TABLE slab ADD COLUMN scanner_id TEXT NOT NULL DEFAULT '';
