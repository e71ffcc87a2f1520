-- SPDX-License-Identifier: Apache-2.0
--
-- From schema version 4 to 5: what is missing from the history, and keys that must not be used again. The columns are
-- explained in schema.sql.

ALTER TABLE line ADD COLUMN keys_used INTEGER NOT NULL DEFAULT 0;
ALTER TABLE line ADD COLUMN pruned_slabs INTEGER NOT NULL DEFAULT 0;
ALTER TABLE line ADD COLUMN pruned_key INTEGER NOT NULL DEFAULT 0;

CREATE TABLE care (
  seq      INTEGER PRIMARY KEY,
  what     TEXT NOT NULL CHECK (what IN ('restored', 'begun_anew')),
  slab_key INTEGER NOT NULL,               -- keys up to here may have been used before
  result_id INTEGER NOT NULL,              -- the newest result at that time; after it
  res_seq  INTEGER NOT NULL CHECK (res_seq BETWEEN 1 AND 65535),  -- records count on from here: the PLC knows others
  source   TEXT NOT NULL,                  -- the backup
  who      TEXT NOT NULL,
  why      TEXT NOT NULL,
  utime_us INTEGER NOT NULL
) STRICT;
CREATE TRIGGER care_stays BEFORE UPDATE ON care
  BEGIN SELECT RAISE(ABORT, 'a gap in the history is never changed'); END;
CREATE TRIGGER care_is_kept BEFORE DELETE ON care
  BEGIN SELECT RAISE(ABORT, 'a gap in the history is never deleted'); END;
