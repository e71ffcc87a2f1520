-- SPDX-License-Identifier: Apache-2.0
--
-- From schema version 8 to 9. The columns are explained in schema.sql.

CREATE TABLE noise_print (
  id       INTEGER PRIMARY KEY,
  slab_key INTEGER NOT NULL,
  station  INTEGER NOT NULL CHECK (station BETWEEN 1 AND 18),
  attempt  INTEGER NOT NULL CHECK (attempt BETWEEN 1 AND 255),
  bytes    BLOB NOT NULL,
  UNIQUE (slab_key, station, attempt)
) STRICT;

ALTER TABLE block ADD COLUMN step_x REAL DEFAULT 0.0;
ALTER TABLE block ADD COLUMN step_y REAL DEFAULT 0.0;
ALTER TABLE block ADD COLUMN step_z REAL DEFAULT 0.0;

ALTER TABLE block ADD COLUMN seat_flatness_closed_mm REAL;
ALTER TABLE block ADD COLUMN seat_flatness_raw_mm REAL;
ALTER TABLE block ADD COLUMN seat_flatness_trimmed_mm REAL;
ALTER TABLE block ADD COLUMN pores INTEGER NOT NULL DEFAULT 0;
ALTER TABLE block ADD COLUMN pores_largest_mm REAL;
ALTER TABLE block ADD COLUMN pores_deepest_mm REAL;
ALTER TABLE block ADD COLUMN pores_share REAL;
ALTER TABLE block ADD COLUMN pores_depth_max_mm REAL;
ALTER TABLE block ADD COLUMN pores_share_max REAL;

ALTER TABLE plane ADD COLUMN doubt TEXT NOT NULL DEFAULT 'not_fitted';
ALTER TABLE casing ADD COLUMN doubt TEXT NOT NULL DEFAULT 'not_measured';

CREATE TABLE finding (
  slab_key INTEGER NOT NULL,
  station  INTEGER NOT NULL,
  attempt  INTEGER NOT NULL,
  position INTEGER NOT NULL,             -- from 0
  kind     TEXT NOT NULL,                -- pit, bump, crack, chip, missing
  face     TEXT NOT NULL,                -- seat, jaw_inner, jaw_outer
  x_mm REAL, s_mm REAL, z_mm REAL,
  length_mm REAL, width_mm REAL, depth_mm REAL, area_mm2 REAL, volume_mm3 REAL,
  PRIMARY KEY (slab_key, station, attempt, position),
  FOREIGN KEY (slab_key, station, attempt) REFERENCES block ON DELETE CASCADE
) STRICT, WITHOUT ROWID;

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

ALTER TABLE attempt ADD COLUMN asked INTEGER NOT NULL DEFAULT 1;
ALTER TABLE attempt ADD COLUMN measuring_since_ns INTEGER NOT NULL DEFAULT 0;
ALTER TABLE slab ADD COLUMN emulated INTEGER NOT NULL DEFAULT 0;
ALTER TABLE attempt ADD COLUMN emulated INTEGER NOT NULL DEFAULT 0;
ALTER TABLE result ADD COLUMN emulated INTEGER NOT NULL DEFAULT 0;
ALTER TABLE attempt ADD COLUMN fingerprint INTEGER;
CREATE INDEX attempt_by_fingerprint ON attempt (fingerprint) WHERE fingerprint IS NOT NULL;
CREATE INDEX attempt_by_checksum ON attempt (points_crc32c) WHERE fingerprint IS NULL AND points_crc32c IS NOT NULL;

CREATE TABLE slab_seal (
  seq         INTEGER PRIMARY KEY CHECK (seq > 0),
  kind        TEXT NOT NULL CHECK (kind IN ('begun', 'slab', 'reopened', 'pruned', 'care')),
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
